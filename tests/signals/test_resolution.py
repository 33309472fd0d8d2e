"""The step of an encoder is found from all spacings, and none where there is no encoder."""

import tracemalloc

import numpy as np
import pytest

from fracid.recording.measures import measure_signal
from fracid.signals.resolution import lattice, resolution

Q = 2 * np.pi / 4096
T = np.arange(4000) * 5e-3
SWING = np.exp(-T / 8) * np.cos(6 * T)
COUNTS = np.round(SWING / Q)
ENCODED = COUNTS * Q


def _written_twice():
    x = np.round(ENCODED, 6)
    x[np.argmax(x == x[100])] += 1.7e-9
    return x


def _two_formats():
    return np.where(np.arange(len(T)) % 2, np.round(ENCODED, 4), np.round(ENCODED, 6))


def _interpolated():
    lost = np.random.default_rng(0).random(len(T)) < 0.1
    lost[[0, -1]] = False
    return np.interp(T, T[~lost], ENCODED[~lost])


@pytest.mark.parametrize(
    "written",
    [
        ENCODED,
        ENCODED - np.pi,
        ENCODED.astype(np.float32).astype(float),
        np.round(ENCODED, 5),
        np.radians(np.round(np.degrees(ENCODED), 2)),
        _written_twice(),
        _two_formats(),
        _interpolated(),
        Q * np.round(SWING / Q + np.random.default_rng(1).standard_normal(len(T))),
    ],
    ids=["exact", "offset", "float32", "digits", "degrees", "written twice", "two formats", "interpolated", "dithered"],
)
def test_an_encoder_is_found_however_its_counts_are_written(written):
    report = measure_signal("alpha", "rad", T, written, written)
    assert report.resolution == pytest.approx(Q, rel=1e-5)
    assert report.counts_per_turn == 4096


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("kind", ["white", "swing", "walk", "six digits"])
def test_noise_gets_no_encoder(kind, seed):
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal(int(rng.integers(30, 3000)))
    swing = SWING[: len(noise)] + 2e-3 * noise
    x = {"white": noise, "swing": swing, "walk": np.cumsum(noise), "six digits": np.round(swing, 6)}[kind]
    assert resolution(x) is None


def test_digits_coarser_than_the_noise_are_a_resolution():
    degrees = np.round(np.degrees(SWING) + 0.3 * np.random.default_rng(2).standard_normal(len(T)), 2)
    assert resolution(degrees) == 0.01


def test_the_doubt_of_a_step_is_that_of_its_digits():
    found = lattice(np.round(np.degrees(ENCODED), 2))
    assert abs(found.step - 360 / 4096) < 4 * found.error < 1e-5
    assert lattice(ENCODED).error < 1e-9 * Q


def test_an_even_ramp_is_no_encoder():
    ramp = np.concatenate([np.zeros(50), 0.0118734 * np.arange(20), np.full(50, 0.0118734 * 19)])
    assert resolution(ramp + 1e-9 * np.random.default_rng(3).standard_normal(len(ramp))) is None


def test_digits_of_a_file_are_not_counts_a_turn():
    """A step of 10⁻⁶ rad is 6,283,185.3 counts: of no encoder."""
    rng = np.random.default_rng(4)
    x = np.round(1e-3 * np.sin(6 * T) + 1e-6 * rng.standard_normal(len(T)), 6)
    report = measure_signal("alpha", "rad", T, x, x)
    assert report.resolution == pytest.approx(1e-6)
    assert report.counts_per_turn is None


def test_a_counter_counts_in_ones_whatever_its_noise():
    counts = np.round(SWING * 2**24 / 6 + 300 * np.random.default_rng(5).standard_normal(len(T)))
    assert resolution(counts) == 1.0


def test_two_values_that_are_nearly_one_cost_no_search_through_all_steps_between():
    values = np.append(0.8 * np.cos(np.arange(40) / 20), 0.0964022279865167)
    tracemalloc.start()
    assert resolution(np.insert(values, 17, values[29] + 1.2e-8)) is None
    assert tracemalloc.get_traced_memory()[1] < 2**25
    tracemalloc.stop()


def test_a_step_that_no_value_agrees_with_is_none():
    noise = 0.01 * np.random.default_rng(2593).standard_normal(125)
    noise[-10:] += np.linspace(0.0, 1.0, 10)  # half of what is left lies half a step off its lattice
    assert lattice(noise) is None
