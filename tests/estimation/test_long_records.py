"""Long records are searched coarsely and lose nothing: the minimum and its intervals are those of every sample."""

from dataclasses import replace

import numpy as np
import pytest

import fracid
from fracid.errors import Failure, FailureReason
from fracid.estimation import long_records
from fracid.estimation.cost_profile import profile
from fracid.estimation.covariance import uncertainty
from fracid.estimation.horizons import Watch, refined
from fracid.estimation.long_records import as_fitted, coarse_problem, corrected, is_coarse, own_substeps
from fracid.estimation.windows import in_parts, in_windows
from fracid.identification import examination
from fracid.problem import Experiment, Free, Problem
from fracid.problem.coarse import coarser, means
from fracid.workflows.profiles import _on_every_sample

pytestmark = pytest.mark.usefixtures("without_rivals")

RIG = fracid.rotary_pendulum("srv02-rotpen")
STEP, SECONDS = 1e-3, 12.0
ORDERS = {"lambda": Free(1.0, 0.6, 1.2), "mu": Free(1.0, 0.6, 1.2)}
FRICTION = {"b_alpha": Free(5e-4, 0.0, 1e-2), "coulomb_theta": Free(1e-3, 0.0, 1e-1)}


@pytest.fixture(scope="module")
def problem():
    """A release and kicks whose edges lie between coarse samples, read with noise by an encoder."""
    t = STEP * np.arange(round(SECONDS / STEP) + 1)
    volts = np.where((t % 3.007 < 0.203) & (t > 2), 1.0, 0.0)[:, None]
    true = {"b_alpha": 4e-4, "coulomb_theta": 2e-3, "cable_stiffness": 0.02}
    run = fracid.simulate(RIG, orders={"lambda": 0.98, "mu": 0.97}, parameters=true, initial={"alpha": 0.6}, step=STEP,
                          end=SECONDS, inputs=volts, between="hold")  # fmt: skip
    count, rng = 2 * np.pi / 4096, np.random.default_rng(1)
    y = count * np.rint((run.states[:, [0, 2]] + 1e-3 * rng.standard_normal((len(t), 2))) / count)
    e = Experiment("long", STEP, y, volts, between={"voltage": "hold"})
    return Problem(RIG, (e,), ORDERS, {**FRICTION, "cable_stiffness": 0.02})


@pytest.fixture
def coarse(problem, monkeypatch):
    """The same, long enough to be made coarser."""
    monkeypatch.setattr(long_records, "LONG", 10_000)
    monkeypatch.setattr(long_records, "FEWEST", 1_000)
    return coarse_problem(problem)


def test_coarse_errors_at_every_step_are_the_means_of_all_errors(problem, coarse):
    x = problem.start
    whole = replace(coarse, substeps=own_substeps(coarse))
    (errors,), (every,) = whole.errors(x), problem.errors(x)
    k, n = coarse.experiments[0].means, len(errors)
    assert k == 8
    np.testing.assert_allclose(errors, means(every[: (n - 1) * k + k // 2 + 1], k), atol=1e-12)


def test_a_problem_as_fitted_has_the_means_of_the_residuals_of_every_sample(problem, coarse):
    x = 1.001 * problem.start
    (errors,), (every,) = as_fitted(problem, x).errors(x), problem.errors(x)
    k, n = coarse.experiments[0].means, len(errors)
    np.testing.assert_allclose(errors, means(every[: (n - 1) * k + k // 2 + 1], k), atol=1e-10)


@pytest.mark.broad
def test_a_profile_of_a_long_record_is_that_of_every_sample(problem, coarse):
    x = refined(problem, problem.start, Watch()).best.point
    every = profile(problem, x, parameters=["mu"], points=4)
    exact = as_fitted(problem, x)
    assert is_coarse(exact)
    fast = _on_every_sample(profile(exact, x, parameters=["mu"], points=4), problem)
    assert fast.cost == pytest.approx(every.cost, rel=1e-3)
    assert fast.profiles["mu"].cost.min() >= 0.999 * fast.cost
    low, high = every.profiles["mu"].interval95
    np.testing.assert_allclose(fast.profiles["mu"].interval95, (low, high), atol=0.05 * (high - low))


@pytest.mark.broad
def test_a_search_on_coarse_samples_ends_within_a_tenth_of_the_intervals_of_every_sample(problem, coarse):
    assert is_coarse(coarse)
    fit = fracid.identify(problem)
    every = fit.problem
    assert not is_coarse(every)
    assert len(fit.recordings["long"].time) == len(problem.experiments[0].measured)
    best = refined(every, fit.x, Watch()).best
    exact = fit.discretisation.widened(every, best.point, uncertainty(every, best.point))
    half = 1.96 * exact.standard_error
    shared = [i for i, u in enumerate(every.unknowns) if u.kind in ("order", "parameter")]
    assert np.all(np.abs(fit.x - best.point)[:2] < 0.1 * half[:2])  # the orders
    assert np.all(np.abs(fit.x - best.point)[shared] < 0.2 * half[shared])
    np.testing.assert_allclose(fit.uncertainty.standard_error[shared], exact.standard_error[shared], rtol=0.15)
    assert fit.cost == pytest.approx(every.cost(fit.x))
    half_step = replace(every, method="pi2", substeps=2 * every.substeps).cost(fit.x)
    assert fit.discretisation.cost_second_order == pytest.approx(half_step, rel=1e-3)


@pytest.mark.broad
def test_a_posterior_of_a_long_record_is_that_of_every_sample(problem, coarse, monkeypatch):
    x = refined(problem, problem.start, Watch()).best.point
    fast = fracid.posterior(problem, x, draws=1000)
    assert fast.problem is problem
    monkeypatch.setattr(long_records, "LONG", 1_000_000)
    every = fracid.posterior(problem, x, draws=1000)
    assert fast.effective_samples < every.effective_samples
    for n in (u.name for u in problem.unknowns if u.kind in ("order", "parameter")):
        low, high = every.interval(n)
        np.testing.assert_allclose(fast.interval(n), (low, high), atol=0.15 * (high - low))


@pytest.mark.broad
def test_coarse_steps_alone_move_the_minimum_by_more_than_its_interval_and_are_corrected(coarse):
    wrong = refined(coarse, coarse.start, Watch()).best
    exact, best = corrected(coarse, wrong.point, own_substeps(coarse), 1)
    half = 1.96 * uncertainty(exact, best.point).standard_error
    assert np.max(np.abs(wrong.point - best.point)[:2] / half[:2]) > 1
    again = refined(replace(coarse, substeps=own_substeps(coarse)), best.point, Watch()).best
    assert np.max(np.abs(again.point - best.point)[:2] / half[:2]) < 0.05


def test_the_first_part_of_a_coarse_record_and_windows_of_it_keep_their_inputs(coarse):
    x = coarse.start
    (whole,), (part,) = coarse.errors(x), coarse.until(5.0).errors(x)
    np.testing.assert_allclose(part, whole[: len(part)], atol=1e-9)
    for pieces in (in_windows(coarse), in_parts(coarse, 3, ["b_alpha"])):
        for e in pieces.experiments:
            first = round(e.start / e.step)
            inputs = coarse.experiments[0].source.inputs[first * e.means :]
            np.testing.assert_array_equal(e.source.inputs, inputs[: len(e.source.inputs)])
            assert len(e.source.measured) == (len(e.measured) - 1) * e.means + e.means // 2 + 1


def test_what_is_masked_touches_no_coarse_sample_that_counts(problem):
    e = problem.experiments[0]
    spoilt = e.measured.copy()
    spoilt[5000:5011] = 1e6
    masked = coarser(replace(e, measured=spoilt, mask=((5.0, 5.01),)), 8, RIG.inputs)
    assert np.all(np.abs(masked.measured[masked.scored]) < 10)
    assert np.count_nonzero(~masked.scored) <= 4


def test_a_short_record_is_left_as_it_is(problem):
    assert coarse_problem(problem) is problem


def test_held_inputs_lose_no_impulse_on_coarser_steps(problem):
    e = problem.experiments[0]
    for every in (4, 16):
        coarse = coarser(e, every, RIG.inputs)
        n = len(coarse.inputs)
        assert every * coarse.inputs.sum() == pytest.approx(e.inputs[: n * every].sum(), abs=1e-9)


@pytest.mark.broad
def test_many_recordings_with_unknowns_of_their_own_keep_every_sample_and_their_sparse_derivatives(monkeypatch):
    monkeypatch.setattr(long_records, "LONG", 100_000)
    monkeypatch.setattr(long_records, "DENSE", long_records.DENSE // 25)
    t = 5e-3 * np.arange(2000)
    swings = tuple(Experiment(f"{k}", 5e-3, np.cos(9 * t)[:, None] * [0.1, 1.0], np.zeros((1, 1))) for k in range(60))
    many = Problem(RIG, swings, ORDERS, FRICTION)
    assert len(many.names) == 4 + 4 * 60
    assert sum(len(e.measured) for e in swings) > long_records.LONG
    assert coarse_problem(many) is many
    assert is_coarse(coarse_problem(replace(many, initial_state="held")))


@pytest.fixture
def swinging(monkeypatch):
    """A pendulum that a slow torque drives, 70 s at 200 Hz with little noise: one step a sample bends its values."""
    monkeypatch.setattr(long_records, "LONG", 10_000)
    monkeypatch.setattr(long_records, "FEWEST", 1_000)
    model, step, end, finer = fracid.models.model("pendulum"), 5e-3, 70.0, 32
    t = step * np.arange(round(end / step) + 1)
    torque = 0.02 * np.sin(2 * np.pi * 0.31 * t)
    every = np.interp(step / finer * np.arange(finer * (len(t) - 1) + 1), t, torque)[:, None]
    run = fracid.simulate(model, orders=1.0, parameters=SWING, initial={"angle": 0.8}, step=step / finer, end=end,
                          inputs=every)  # fmt: skip
    y = run.states[::finer, :1] + 1e-5 * np.random.default_rng(5).standard_normal((len(t), 1))
    free = {n: Free(1.1 * v, 0.5 * v, 2 * v) for n, v in SWING.items()}
    return Problem(model, (Experiment("swing", step, y, torque[:, None]),), {"mu": 1.0}, free, initial_state="held")


SWING = {"gravity": 0.15, "J": 0.0032, "b_angle": 5e-4}


def test_a_long_record_halves_its_step_as_a_short_one_does(swinging):
    fit = fracid.identify(swinging, fixed_step=False)
    assert fit.substeps > 1
    assert fit.discretisation.refinement.startswith(f"The step was halved to {fit.substeps} a sample; at 1 a sample")
    for name, true in SWING.items():
        low, high = fit.parameters[name].interval95
        assert abs(fit.parameters[name].value - true) < 0.75 * (high - low)


def test_a_long_record_whose_coarse_minimum_no_run_follows_is_searched_on_every_sample(swinging, monkeypatch):
    monkeypatch.setattr(examination, "corrected", lambda *args, **options: Failure(FailureReason.RUN, "diverged"))
    fit = fracid.identify(swinging, fixed_step=True)
    half = 1.96 * fit.uncertainty.standard_error
    every, coarse = (refined(p, p.start, Watch()).best.point for p in (swinging, coarse_problem(swinging)))
    assert np.max(np.abs(fit.x - every) / half) < 0.05 < np.max(np.abs(fit.x - coarse) / half)
