"""The noise of a recorded input is in the intervals, and an exact input that looks like noise hardly is."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import fracid
from fracid.estimation.covariance import uncertainty
from fracid.estimation.input_noise import input_noise, with_input_noise
from fracid.estimation.minimum import settled
from fracid.problem import Experiment, Free, Problem
from fracid.selection.claim import OrderFound, claim_of
from fracid.selection.residual_noise import leftovers
from fracid.signals.left_over import LeftOver

T = np.arange(1000) / 50
K, B = 40.0, 0.5


def driven(push, noise, seed, dry=0.0):
    """A mass on a spring, perhaps with dry friction that the problem lacks, and the noise of its load cell."""
    rng = np.random.default_rng(seed)
    moved = solve_ivp(
        lambda t, x: [x[1], np.interp(t, T, push) - B * x[1] - K * x[0] - dry * np.tanh(x[1] / 0.01)],
        (0, T[-1]), [0.0, 0.0], t_eval=T, rtol=1e-8, atol=1e-10, max_step=0.05,
    ).y[:1].T  # fmt: skip
    moved = moved + 0.01 * moved.std() * rng.standard_normal(moved.shape)
    force = (push + noise * push.std() * rng.standard_normal(len(T)))[:, None]
    rig, swing = fracid.model("oscillator", m=1.0, k3=0.0), Experiment("pushed", 0.02, moved, force)
    return Problem(
        rig, (swing,), {"mu": Free(1.0, 0.8, 1.2)},
        {"k": Free(K, 10.0, 90.0), "b_displacement": Free(B, 0.0, 2.0)}, substeps=4,
    )  # fmt: skip


def pushed(push, noise, seed):
    """Standard errors of μ, k and b with and without the noise of the force, and how far off the values are."""
    problem = driven(push, noise, seed)
    here = settled(problem, problem.start)
    known = uncertainty(problem, here.x, near=here)
    off = here.x[:3] - [1.0, K, B]
    within = with_input_noise(problem, here.x, known, near=here)
    return known.standard_error[:3], within.standard_error[:3], off


def test_values_lie_as_far_off_as_the_noise_of_the_input_says():
    sweep = np.sin(2 * T + 0.2 * T**2)
    without, within, off = np.array([pushed(sweep, 0.03, seed) for seed in range(5)]).swapaxes(0, 1)
    assert np.all(np.sqrt(np.mean((off / without) ** 2, axis=0)) > 2.5)
    assert np.all(np.sqrt(np.mean((off / within) ** 2, axis=0)) < 1.6)


@pytest.mark.parametrize("push", [np.sin(2 * T + 0.2 * T**2), np.random.default_rng(9).standard_normal(len(T))])
def test_exact_inputs_widen_little_even_where_they_look_like_noise(push):
    without, within, _ = pushed(push, 0.0, 1)
    assert np.all(within / without < 1.6)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("noise", "dry"), [(0.0, 0.0), (0.07, 0.0), (0.07, 0.15), (0.0, 0.15)])
def test_the_noise_of_the_input_explains_a_residual_and_not_what_the_model_lacks(noise, dry, seed):
    problem = driven(np.sin(2 * T + 0.2 * T**2), noise, seed, dry)
    [left] = leftovers(problem, settled(problem, problem.start).x).values()
    assert left.explained == (noise == dry == 0.0)
    assert (left.inputs, left.noise) == ("force" * (noise > 0.0 and not dry), not dry)


def test_an_exact_command_that_looks_like_noise_explains_no_residual():
    problem = driven(3 * np.random.default_rng(9).standard_normal(len(T)), 0.0, 1, dry=0.15)
    [left] = leftovers(problem, settled(problem, problem.start).x).values()
    assert (left.explained, left.inputs) == (False, "")


def test_a_claim_says_whose_noise_it_is():
    each = {
        "a, x": LeftOver(1e-3, 0.0, 0.1, coloured=True, inputs="force"),
        "b, x": LeftOver(1e-3, 0.0, 0.1, coloured=True),
    }
    found = claim_of([OrderFound("mu", 0.999, 0.002)], None, each)
    assert (found.claim, found.codes) == ("integer", ("inside", "shaken", "coloured"))
    assert "of a, x is correlated as the noise of force makes it" in found.reasons[1]


def test_a_motion_has_no_noise_however_coarse_its_samples():
    assert input_noise(np.sin(np.arange(200) * 0.8)) < 0.1
    assert input_noise(np.repeat([0.0, 5.0, -3.0], 40)) == 0.0
