"""An encoder without dither: its edge is one unknown, a rest one fact, and intervals know it."""

import numpy as np
import pytest

import fracid
from fracid.estimation.covariance import uncertainty
from fracid.estimation.rounding import edges, half_widths, noise_in_steps
from fracid.optimise import least_squares, minimise
from fracid.problem import Experiment, Free, Problem
from fracid.quantiles import NORMAL_95
from twins import COUNT, RIG

STEP = 4e-3
TIME = STEP * np.arange(3001)
SWING = 40 * COUNT * np.exp(-TIME / 1.2) * np.cos(7 * TIME)
"""Dies within 7 s, and rests for 5."""


def square(e):
    return e


def read(signal, noise, seed):
    """As an encoder reads it whose marks lie anywhere, with so much noise [counts]: shape (n, 1)."""
    rng = np.random.default_rng(seed)
    edge, stirred = COUNT * rng.random(), signal + noise * COUNT * rng.standard_normal(signal.shape)
    return (COUNT * np.round((stirred - edge) / COUNT) + edge)[:, None]


def problem_of(y):
    e = Experiment("swing", STEP, y, np.zeros((1, 1)))
    return Problem(RIG, (e,), {"lambda": 1.0, "mu": Free(0.95, 0.5, 1.2)}, outputs=("alpha",))


def offset(noise, seed):
    """A zero found as the mean of what is left over, half the width of its interval, and that of white noise."""
    y = read(SWING, noise, seed)
    error = y - SWING[:, None]
    found = edges(problem_of(y), [error - error.mean()], [np.ones((len(y), 1, 1))], square)
    samples = len(y) / problem_of(y).criterion.sample_weights([error])[0].sum()  # so that Σ w is 1 sample
    tables = tuple(samples * t / len(y) for t in found.tables)
    variance = samples**2 * np.diag(found.white) / len(y) ** 2
    deviation = np.sqrt(variance + sum(np.mean(t**2, axis=0) for t in tables))
    half = half_widths(tables, variance) * deviation
    return float(error.mean()), float(half[0]), NORMAL_95 * float(np.std(error)) / np.sqrt(len(y))


@pytest.mark.broad
def test_a_rest_of_a_thousand_samples_is_one_fact():
    draws = np.array([offset(0.1, seed) for seed in range(100)])
    held, white = (np.mean(np.abs(draws[:, 0]) <= draws[:, i]) for i in (1, 2))
    assert 0.9 <= held <= 0.99
    assert white < 0.3


@pytest.mark.parametrize("noise", [0.05, 0.1, 0.2, 0.3])
def test_the_noise_under_the_rounding_is_found_though_the_fit_is_bent_and_the_rest_is_long(noise):
    bent = SWING + 0.2 * COUNT * np.sin(TIME)
    found = [noise_in_steps(read(SWING, noise, seed)[:, 0] - bent, bent, COUNT) for seed in range(10)]
    assert np.mean(found) == pytest.approx(noise, abs=0.03)


def test_where_noise_dithers_or_no_step_is_seen_nothing_is_made_of_rounding():
    ones = [np.ones((len(SWING), 1, 1))]
    dithered, fine = read(SWING, 1.0, 1), (SWING + 1e-4 * np.random.default_rng(1).standard_normal(len(SWING)))[:, None]
    for y in (dithered, fine):
        assert edges(problem_of(y), [y - SWING[:, None]], ones, square) is None


def test_an_output_that_the_model_does_not_explain_keeps_its_own_scatter_too():
    y, ones = read(SWING, 0.1, 1), [np.ones((len(SWING), 1, 1))]
    error = y - SWING[:, None]
    assert edges(problem_of(y), [error], ones, square).alone[0].tolist() == [1.0]
    some, much = (error + part * COUNT * np.sin(3 * TIME)[:, None] for part in (0.4, 1.0))
    assert edges(problem_of(y), [some], ones, square).alone[0].tolist() == [0.0]
    assert edges(problem_of(y), [much], ones, square) is None


@pytest.mark.broad
def test_intervals_hold_the_truth_where_an_undithered_encoder_reads_a_swing_that_comes_to_rest():
    friction = {"b_alpha": 4e-4, "coulomb_alpha": 2.5e-4, "coulomb_theta": 2e-3}
    run = fracid.simulate(RIG, orders={"lambda": 1.0, "mu": 0.95}, initial={"alpha": 0.17}, step=STEP / 4, end=10.0,
                          parameters=friction)  # fmt: skip
    f = run.states[::4, [0, 2]]
    truth = np.array([0.95, 4e-4])
    held = np.zeros(2)
    for seed in range(40):
        y = np.hstack([read(f[:, 0], 0.1, 2 * seed), read(f[:, 1], 0.1, 2 * seed + 1)])
        e = Experiment("swing", STEP, y, np.zeros((1, 1)), initial={"theta": 0.0, "alpha": 0.17})
        free = {"b_alpha": Free(4e-4, 0.0, 1e-2)} | {n: v for n, v in friction.items() if n != "b_alpha"}
        p = Problem(RIG, (e,), {"lambda": 1.0, "mu": Free(0.95, 0.5, 1.2)}, free, initial_state="held", substeps=4)
        x = minimise(p.evaluate, least_squares(p.space, None)).best.point
        held += np.abs(x - truth) <= NORMAL_95 * uncertainty(p, x).standard_error
    assert np.all(held >= 35)
