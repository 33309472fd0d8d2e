"""Noise is read off third differences: as large as it is, whatever moves slowly under it."""

import math

import numpy as np
import pytest

from fracid.signals.noise import white_noise
from fracid.signals.resolution import noise_level

TIME = np.arange(20_000) / 1000
MOTIONS = {"rest": 0 * TIME, "line": TIME, "parabola": TIME**2, "swing": np.exp(-0.2 * TIME) * np.cos(7 * TIME)}


@pytest.mark.parametrize("motion", MOTIONS.values(), ids=MOTIONS)
@pytest.mark.parametrize("sigma", [1e-4, 1e-2])
def test_white_noise_is_found_under_a_slow_motion(motion, sigma):
    noisy = motion + sigma * np.random.default_rng(1).standard_normal(TIME.size)
    assert white_noise(noisy) == pytest.approx(sigma, rel=0.03)


@pytest.mark.parametrize("counts", [400, 4096])
def test_the_level_is_no_less_than_the_encoders_rounding(counts):
    q = 2 * math.pi / counts
    seen = np.round(MOTIONS["swing"] / q) * q
    assert noise_level(seen) >= q / math.sqrt(12) * (1 - 1e-9)
    assert noise_level(seen, q) == pytest.approx(noise_level(seen), rel=1e-6)


def test_too_few_samples_have_no_noise_and_a_level_above_nothing():
    assert math.isnan(white_noise(np.zeros(3)))
    assert noise_level(np.zeros(3)) == 1e-9
