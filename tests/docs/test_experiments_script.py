"""The script behind docs/recording.md computes what the page says that it computes."""

import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fracid.estimation.covariance import uncertainty

SCRIPT = runpy.run_path(str(Path(__file__).parents[2] / "examples" / "what_an_experiment_shows.py"))
experiment, problem_of, least_errors = SCRIPT["experiment"], SCRIPT["problem_of"], SCRIPT["least_errors"]
ALL = (*SCRIPT["CONSTANTS"], "C4")


def relative(problem):
    """The least standard error of each constant, by its size."""
    errors = least_errors(problem)
    return np.array([errors[name] / problem.parameter_starts[name] for name in ALL])


@pytest.mark.broad
def test_a_free_response_tells_no_constant_and_a_known_torque_tells_all():
    free = problem_of(experiment(60, 3.0), free=ALL)
    driven = problem_of(experiment(60, 3.0), experiment(0, 3.0, SCRIPT["pulse"](3.0)), free=ALL)
    assert relative(free).min() > 1.0
    assert relative(driven).max() < 0.1


def test_the_orders_are_told_all_the_same():
    errors = least_errors(problem_of(experiment(60, 3.0), free=ALL))
    assert max(errors["lambda"], errors["mu"]) < 1e-3


@pytest.mark.broad
def test_the_pendulum_alone_tells_less_of_everything():
    both = experiment(60, 3.0)
    alone = replace(both, measured=both.measured[:, 1:])
    more, less = least_errors(problem_of(both)), least_errors(problem_of(alone, outputs=("alpha",)))
    assert all(less[name] >= more[name] for name in less)
    assert less["lambda"] > 5 * more["lambda"]


@pytest.mark.broad
def test_twice_the_record_halves_the_variance():
    once = least_errors(problem_of(experiment(60, 3.0)))
    twice = least_errors(problem_of(experiment(60, 3.0), replace(experiment(60, 3.0), name="again")))
    assert twice["mu"] == pytest.approx(once["mu"] / np.sqrt(2), rel=1e-4)


def test_the_least_errors_are_those_that_a_fit_claims_of_white_noise():
    release, rng = experiment(60, 3.0), np.random.default_rng(1)
    noisy = replace(release, measured=release.measured + SCRIPT["NOISE"] * rng.standard_normal(release.measured.shape))
    problem = problem_of(noisy, free=("b_theta", "coulomb_theta"))
    at_truth = problem_of(release, free=("b_theta", "coulomb_theta")).start
    claimed = uncertainty(problem, at_truth)
    expected = least_errors(problem_of(release, free=("b_theta", "coulomb_theta")))
    np.testing.assert_allclose(claimed.white, [expected[name] for name in problem.names], rtol=0.05)


def test_an_error_is_written_with_two_digits():
    digits = SCRIPT["digits"]
    assert [digits(v) for v in (451.0, 10.4, 2.04, 0.204, 0.00768)] == ["451", "10", "2.0", "0.20", "0.0077"]


@pytest.mark.broad
@pytest.mark.filterwarnings("ignore::fracid.solver.solve.PaperSchemeWarning")
def test_the_pictures_of_the_theory_show_what_it_says():
    pictures = runpy.run_path(str(Path(SCRIPT["__file__"]).with_name("theory_pictures.py")))
    fractional, damped = pictures["order_as_damping"]().axes[0].lines
    assert float(damped.get_label().split()[-1]) == pytest.approx(np.pi / 2 * (1 - 0.95), rel=0.02)
    assert np.max(np.abs(fractional.get_ydata() - damped.get_ydata())) < 0.1
    *raw, exact = (line.get_ydata()[-1] for line in pictures["raw_sums"]().axes[0].lines)
    assert exact > raw[0] > raw[1] > raw[2] > 0  # the smaller the step, the further off


def test_the_table_of_the_design_page_knows_a_rig_with_a_clamped_arm():
    script = runpy.run_path(str(Path(__file__).parents[2] / "examples" / "which_experiment_next.py"))
    row = script["row"]
    row.__globals__["DESIGNS"] = {"habit": {"release": 90, "seconds": 4}}
    name, _, λ, μ, correlation = row("stepper-freeswing")
    assert (name, λ) == ("stepper-freeswing", "–")
    assert float(μ) < 1e-2
    assert float(correlation) > 0.5
