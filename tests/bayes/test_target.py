"""The tempered likelihood of recordings: the sandwich's curvature, closed forms, the project's priors."""

from dataclasses import replace

import numpy as np
import pytest

import fracid
from fracid.bayes import inference
from fracid.bayes.evidence import laplace_evidence, require_evidence
from fracid.bayes.laplace import WeightedDraws
from fracid.bayes.target import approximation, calibrated, joint_prior
from fracid.errors import InputError
from fracid.estimation.covariance import uncertainty
from fracid.problem import Experiment, Free, Problem, Sensor
from fracid.problem.costs import COSTS
from fracid.problem.unknowns import Prior
from twins import RIG, angles, release

SIGMA = 1e-3


def linear(rng, samples=2000, **more):
    """A rig whose constants are known, one angle read by a sensor of unknown gain and bias: a linear model."""
    h = 2.0 / samples
    truth = angles(alpha=0.3, step=h, end=2.0, outputs=("alpha",))[: samples + 1]
    sensor = Sensor(gain=Free(1.0, 0.5, 1.5), bias=Free(0.0, -0.1, 0.1))
    measured = 1.02 * truth + 0.01 + SIGMA * rng.standard_normal(truth.shape)
    swing = Experiment("twin", h, measured, np.zeros((1, 1)), initial={"theta": 0.0, "alpha": 0.3},
                       sensors={"alpha": sensor})  # fmt: skip
    problem = Problem(RIG, (swing,), {"lambda": 0.9, "mu": 0.95}, outputs=("alpha",), initial_state="held", **more)
    return problem, np.column_stack([truth[:, 0], np.ones(len(truth))])


@pytest.mark.broad
def test_the_evidence_of_a_linear_model_with_normal_noise_is_the_closed_form():
    problem, regressors = linear(np.random.default_rng(1))
    drawn = fracid.posterior(problem, draws=800, seed=1)
    sandwich = uncertainty(problem, drawn.x)
    estimated = sandwich.covariance / np.outer(sandwich.widening, sandwich.widening)
    volume = np.log(np.prod(problem.space.upper - problem.space.lower))
    exact = 0.5 * np.linalg.slogdet(2 * np.pi * estimated)[1] - volume
    assert drawn.log_evidence == pytest.approx(exact, abs=0.05)
    assert drawn.trusted
    assert laplace_evidence(problem, drawn.x).log_evidence == pytest.approx(exact, abs=0.05)
    true = SIGMA**2 * np.linalg.inv(regressors.T @ regressors)
    known = 0.5 * np.linalg.slogdet(2 * np.pi * true)[1] - volume
    assert drawn.log_evidence == pytest.approx(known, abs=0.15)  # the sandwich estimates the noise's covariance


@pytest.fixture(scope="module")
def swing():
    """A release whose noise is autocorrelated over twenty samples."""
    e = release(alpha=0.5, step=1e-2, end=3.0)
    noise = np.convolve(np.random.default_rng(2).standard_normal(700), np.ones(40) / np.sqrt(40), "same")[:602]
    e = replace(e, measured=e.measured + SIGMA * noise.reshape(-1, 2))
    free = {"lambda": Free(0.9, 0.5, 1.2), "mu": Free(0.95, 0.5, 1.2)}
    return Problem(RIG, (e,), free, {"b_alpha": Free(2e-4, 0.0, 1e-2)}, initial_state="held")


@pytest.mark.few(1)
@pytest.mark.parametrize("cost", ["rmse", "ise", "huber"])
def test_next_to_the_minimum_the_curvature_is_the_sandwichs(swing, cost):
    problem = replace(swing, cost_function=COSTS[cost])
    likelihood, _ = calibrated(problem, problem.start)
    sandwich = uncertainty(problem, likelihood.centre)
    d = len(likelihood.centre)
    for direction in np.eye(d):
        x = likelihood.centre + 0.05 * direction * sandwich.standard_error / sandwich.widening
        exact = (likelihood.degrees + d) / likelihood.degrees * 0.5 * (x - likelihood.centre) @ likelihood.precision @ (
            x - likelihood.centre
        )  # fmt: skip
        assert -likelihood.log_likelihoods(x[None])[0] == pytest.approx(exact, rel=0.05)


@pytest.mark.broad
def test_a_posterior_is_as_wide_as_the_intervals_of_autocorrelated_residuals(swing):
    drawn = fracid.posterior(swing, draws=1500)
    sandwich = uncertainty(swing, drawn.x)
    widths = np.diff([drawn.interval(name) for name in swing.names])[:, 0]
    np.testing.assert_allclose(widths, 2 * 1.96 * sandwich.standard_error, rtol=0.3)  # one ν for all
    assert np.max(widths / sandwich.white) > 1.5 * 2 * 1.96


@pytest.mark.broad
def test_a_prior_of_the_project_counts_against_the_effective_samples(swing):
    i, flat = swing.names.index("mu"), fracid.posterior(swing, draws=1500)
    mean, sd = flat.mean[i], flat.standard_deviation[i]
    mu = Free(0.95, 0.5, 1.2, prior=Prior(mean + 2 * sd, sd))
    drawn = fracid.posterior(replace(swing, orders=swing.orders | {"mu": mu}), draws=1500)
    assert drawn.mean[i] == pytest.approx(mean + sd, abs=0.2 * sd)
    assert drawn.standard_deviation[i] == pytest.approx(sd / np.sqrt(2), rel=0.25)  # Student's t, not normal
    assert drawn.to_json()["unknowns"]["mu"]["prior"]["kind"] == "normal"


@pytest.mark.broad
def test_a_parameter_at_its_bound_is_drawn_from_there_inwards(swing):
    dry = replace(swing, parameters={"coulomb_alpha": Free(2e-3, 1e-3, 1e-2)})  # there is none
    drawn = fracid.posterior(dry, draws=1500)
    values = drawn.points[:, dry.names.index("coulomb_alpha")]
    assert values.min() >= 1e-3
    assert drawn.trusted
    assert drawn.notes == ("At a bound, and drawn from there inwards: coulomb_alpha.",)


def test_what_the_data_do_not_identify_keeps_its_prior(swing):
    blind = replace(swing, parameters={"coulomb_theta": 0.0, "slip_speed": Free(0.1, 0.05, 0.15), "coulomb_alpha": 0.0})
    likelihood, notes = calibrated(blind, blind.start)
    assert notes == ("The data do not identify slip_speed: there the posterior is the prior.",)
    shape = approximation(likelihood, joint_prior(blind), np.zeros(3, dtype=bool))
    assert np.sqrt(shape.covariance[-1, -1]) == pytest.approx(0.1 / np.sqrt(12), rel=1e-6)


@pytest.mark.broad
def test_the_odds_of_a_parameter_that_is_not_there_are_against_it(swing):
    free = replace(swing, parameters={"b_alpha": Free(2e-4, 0.0, 1e-2), "drag_alpha": Free(0.0, -1e-3, 1e-3)})
    with_drag, without = fracid.posterior(free, draws=600), fracid.posterior(swing, draws=600)
    odds = fracid.log_odds(without, with_drag)
    assert odds > 1
    assert fracid.log_odds(with_drag, without) == pytest.approx(-odds)


# --- what is refused ----------------------------------------------------------------------------------


def test_nothing_free_a_users_own_cost_and_another_method_are_refused_in_a_sentence(swing):
    with pytest.raises(InputError, match="Nothing is free: give at least one order"):
        fracid.posterior(replace(swing, orders={"lambda": 0.9, "mu": 0.95}, parameters={}))
    own = replace(COSTS["rmse"], name="own", loss=None, weight=None, function=lambda time, e: float(np.sum(e**2)))
    with pytest.raises(InputError, match="The cost own is a user's own, of unknown likelihood"):
        fracid.posterior(replace(swing, cost_function=own))
    with pytest.raises(InputError, match="unknown method 'nest': did you mean nested"):
        fracid.posterior(swing, method="nest")


def test_evidence_of_a_parameter_without_bounds_is_refused(swing):
    free = replace(swing, parameters={"b_alpha": Free(2e-4, 0.0, np.inf)})
    with pytest.raises(InputError, match="no bounds, such as b_alpha: give it a lower and an upper one, or a prior"):
        require_evidence(free)
    require_evidence(replace(swing, parameters={"b_alpha": Free(2e-4, 0.0, np.inf, prior=Prior(2e-4, 1e-4))}))


def test_nested_draws_that_missed_the_minimum_are_not_trusted_and_give_no_odds(swing, monkeypatch):
    points = joint_prior(swing).from_unit(np.random.default_rng(1).random((200, 3)))
    sample = WeightedDraws(points, np.full(200, -np.log(200)), -118.0, evidence_error=0.02, simulations=9000)
    monkeypatch.setattr(inference, "nested_sample", lambda *_, **how: sample)
    missed = fracid.posterior(swing, method="nested")
    assert not missed.trusted
    about = laplace_evidence(swing, missed.x).log_evidence
    assert missed.log_mass == pytest.approx(about, abs=0.1)
    assert missed.sentence.startswith("The draws cannot be trusted: they missed the minimum of the fit. Their log ev")
    with pytest.raises(InputError, match=r"no odds of rotary-pendulum\. .* log evidence is -118\.0, .* Narrow"):
        fracid.log_odds(missed, missed)
    assert replace(missed, log_evidence=about).trusted


@pytest.mark.broad
def test_odds_of_other_recordings_are_refused(swing):
    (e,) = swing.experiments
    other = replace(swing, experiments=(replace(e, measured=e.measured + 1e-3),))
    first, second = fracid.posterior(swing, draws=200), fracid.posterior(other, draws=200)
    with pytest.raises(InputError, match="of different recordings"):
        fracid.log_odds(first, second)


@pytest.mark.few(1)
def test_no_point_of_a_higher_cost_is_likelier_than_the_minimum(swing):
    likelihood, _ = calibrated(replace(swing, weights="noise"), swing.start)  # which grows more slowly than squares do
    ranges = 0.2 * (swing.space.upper - swing.space.lower)
    points = swing.space.clipped(likelihood.centre + ranges * (np.random.default_rng(1).random((20, 3)) - 0.5))
    assert max(likelihood.log_likelihoods(points)) < 0.0
