"""Correlated residuals: noise of a filter, or something that a model lacks."""

import numpy as np
import pytest
from scipy.signal import lfilter

from fracid.signals.coloured import is_coloured_noise, whitened, whitening_filter

TIME = np.arange(1000) / 50
SWING = np.exp(-TIME / 8) * np.cos(5 * TIME)
DIRECTIONS = np.column_stack([SWING, np.gradient(SWING)])


def asked(e):
    return is_coloured_noise(e, SWING[:, None], lambda: DIRECTIONS)


def noise(seed, ρ):
    return lfilter([1.0], [1.0, -ρ], np.random.default_rng(seed).standard_normal(1500))[500:]


@pytest.mark.few(1)
@pytest.mark.parametrize("ρ", [0.3, 0.8, 0.95])
def test_noise_of_a_filter_is_noise_in_nearly_all_draws(ρ):
    assert sum(asked(noise(seed, ρ)) for seed in range(40)) >= 36


@pytest.mark.parametrize("lacks", [SWING**3, SWING * np.abs(SWING), np.sign(np.gradient(SWING)) * np.exp(-TIME / 8)])
def test_what_goes_with_the_motion_is_no_noise(lacks):
    lacks = lacks - DIRECTIONS @ np.linalg.lstsq(DIRECTIONS, lacks, rcond=None)[0]
    lacks *= 2 / np.std(lacks)
    assert not any(asked(noise(seed, 0.8) / 2 + lacks) for seed in range(10))


def test_noise_that_is_larger_where_the_motion_is_larger_is_told_from_one_that_is_not():
    assert not any(asked((0.05 + np.abs(SWING)) * noise(seed, 0.8)) for seed in range(10))


def test_what_the_unknowns_can_do_is_nothing_that_the_model_lacks():
    assert asked(noise(1, 0.9) + 3 * DIRECTIONS[:, 0])


def test_a_drift_over_the_record_is_no_noise():
    assert not asked(noise(1, 0.0) + 5 * np.sin(TIME / 5))


@pytest.mark.parametrize("slow", [0.3, 1.0])
def test_white_noise_differenced_does_not_count_as_white(slow):
    e = slow * noise(1, 0.995) + np.random.default_rng(2).standard_normal(1000)
    whitening, white = whitening_filter(e)
    assert white
    left = whitened(e, whitening)
    assert np.corrcoef(left[1:], left[:-1])[0, 1] > -0.25
