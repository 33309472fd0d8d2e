"""Many recordings with unknowns of their own: block by block comes to what all rows and columns together come to."""

from dataclasses import replace

import numpy as np
import pytest

import fracid
from fracid.arrowhead import Arrowhead, Blocks
from fracid.errors import Failure
from fracid.estimation.agreement import spread
from fracid.estimation.covariance import half_width, uncertainty
from fracid.estimation.curvature import curvature
from fracid.estimation.derivatives import by_blocks, jacobian
from fracid.estimation.horizons import Watch, lowest_from, refined
from fracid.estimation.nearly_equal import nearly_equal_minimum
from fracid.problem import Experiment, Free, Problem
from fracid.problem.costs import COSTS
from fracid.validation.discretisation import discretisation_check

pytestmark = pytest.mark.usefixtures("without_rivals")


def recordings(count, samples, step=2e-2):
    """A pendulum that is let go from elsewhere each time, in motion."""
    rig, made = fracid.rotary_pendulum("srv02-rotpen"), []
    for k in range(count):
        rng = np.random.default_rng(k)
        initial = {"alpha": 0.2 + 0.6 * rng.random(), "D^mu alpha": 0.3 * rng.standard_normal()}
        run = fracid.simulate(
            rig, orders={"lambda": 1.0, "mu": 0.97}, initial=initial, step=step, end=step * (samples - 1)
        )
        noisy = run.states[:, [0, 2]] + 1e-3 * rng.standard_normal((samples, 2))
        made.append(Experiment(f"swing {k}", step, noisy, np.zeros((1, 1))))
    return tuple(made)


def problem(experiments, **options):
    rig, orders = fracid.rotary_pendulum("srv02-rotpen"), {"lambda": 1.0, "mu": Free(0.99, 0.6, 1.2)}
    parameters = {"C1": Free(4.4e-3, 1e-3, 1e-2), **options.pop("parameters", {})}
    return Problem(rig, experiments, orders, parameters, **options)


def both(monkeypatch, made, **options):
    """The problem as one, and by blocks."""
    monkeypatch.setattr("fracid.problem.problem.MANY", 10**9)
    whole = problem(made, **options)
    assert whole.blocks is None
    monkeypatch.setattr("fracid.problem.problem.MANY", 2)
    parts = problem(made, **options)
    assert parts.blocks is not None
    return whole, parts


@pytest.fixture(scope="module")
def thirty():
    return recordings(30, 40)


@pytest.mark.broad
@pytest.mark.parametrize("weights", ["equal", "noise"])
def test_a_step_by_blocks_is_the_step_of_all_rows(thirty, monkeypatch, weights):
    whole, parts = both(monkeypatch, thirty, initial_state="rest", weights=weights)
    x, size = whole.start, whole.space.typical
    J, r, blocks = jacobian(whole, x, np.arange(len(x))), whole.residuals(x), parts.blocks
    narrow = by_blocks(parts, x, np.arange(len(x)))
    balance = np.sqrt(np.concatenate([w.ravel() for w in whole.criterion.sample_weights(whole.errors(x))]))
    dense, rows = balance[:, None] * np.concatenate([j.reshape(-1, len(x)) for j in J]), r[: len(balance)]
    cuts = blocks.rows[1:-1]
    R = Arrowhead.of(
        blocks,
        [
            np.column_stack([b[:, None] * j.reshape(len(b), -1), y])
            for b, j, y in zip(np.split(balance, cuts), narrow.parts, np.split(rows, cuts), strict=True)
        ],
    )
    held = np.arange(len(x)) % 7 == 3
    for damping in (1e-3 / size, np.where(held, np.inf, 1e-2 / size)):
        free = np.isfinite(damping)
        tall = np.vstack([dense[:, free], np.diag(damping[free])])
        expected = np.zeros(len(x))
        expected[free] = np.linalg.lstsq(tall, -np.concatenate([rows, np.zeros(free.sum())]))[0]
        np.testing.assert_allclose(R.step(damping) / size, expected / size, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(R.gradient, dense.T @ rows, rtol=1e-9, atol=1e-12 * np.abs(R.gradient).max())


@pytest.mark.broad
@pytest.mark.few(1)
@pytest.mark.parametrize("weights", ["equal", "noise"])
def test_intervals_by_blocks_are_those_of_all_rows(thirty, monkeypatch, weights):
    whole, parts = both(monkeypatch, thirty[:8], weights=weights)
    known, found = uncertainty(whole, whole.start), uncertainty(parts, parts.start)
    assert not isinstance(known, Failure)
    assert not isinstance(found, Failure)
    for name in ("standard_error", "white", "widening", "covariance"):
        np.testing.assert_allclose(getattr(found, name), getattr(known, name), rtol=1e-5, atol=1e-15, err_msg=name)
    everything = np.arange(len(whole.start))
    a, b = (curvature(p, p.start, everything) for p in (whole, parts))
    np.testing.assert_allclose(b.inverse @ b.gradient, a.inverse @ a.gradient, rtol=1e-6, atol=1e-12)


def test_derivatives_by_blocks_are_those_of_all_rows_and_stay_within_the_bounds(thirty, monkeypatch):
    none = {"coulomb_alpha": Free(0.0, 0.0, 1e-2)}  # beyond its bound it would drive the pendulum
    whole, parts = both(monkeypatch, thirty[:3], parameters=none, initial_state="rest")
    x, everything = whole.start, np.arange(len(whole.start))
    narrow = by_blocks(parts, x, everything)
    for k, j in enumerate(jacobian(whole, x, everything)):
        np.testing.assert_allclose(narrow.parts[k], j[..., parts.blocks.columns(k)], rtol=1e-9, atol=1e-12)


def test_what_the_data_do_not_see_is_named_by_blocks_too(thirty, monkeypatch):
    blind = {"C4": Free(4e-4, 1e-4, 1e-3)}  # a product with C1 is all that a free pendulum shows, nearly
    still = tuple(replace(e, measured=0 * e.measured) for e in thirty[:3])
    whole, parts = both(monkeypatch, still, parameters=blind, initial_state="rest")
    known, found = uncertainty(whole, whole.start), uncertainty(parts, parts.start)
    assert known.confounded
    assert sorted(found.confounded) == sorted(known.confounded)
    np.testing.assert_array_equal(np.isnan(found.standard_error), np.isnan(known.standard_error))


@pytest.fixture(scope="module")
def minimum(thirty):
    """Twenty recordings by blocks, and their minimum."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("fracid.problem.problem.MANY", 2)
        made = problem(thirty[:20], parameters={"b_alpha": Free(3e-4, 0.0, 1e-2)})
        yield made, refined(made, made.start, Watch()).best.point


@pytest.mark.broad
def test_the_check_of_the_step_shifts_the_orders_as_a_search_at_half_the_step_does(minimum, monkeypatch):
    made, x = minimum
    known = uncertainty(made, x)
    asked = []
    search = "fracid.validation.discretisation.lowest_from"
    monkeypatch.setattr(search, lambda *a, **k: asked.append(a) or lowest_from(*a, **k))
    fast = discretisation_check(made, x, known, 1)
    assert not asked
    monkeypatch.setattr("fracid.validation.discretisation.nearly_equal_minimum", lambda *_: None)
    full = discretisation_check(made, x, known, 1)
    assert asked
    assert abs(full.shift["mu"]) > 0.02 * half_width(known, x, 0)
    assert fast.shift["mu"] == pytest.approx(full.shift["mu"], abs=0.01 * half_width(known, x, 0))
    assert fast.cost_half_step == full.cost_half_step


@pytest.mark.broad
def test_derivatives_that_do_not_lead_to_the_minimum_leave_it_to_a_search(minimum):
    made, x = minimum
    euler = replace(made, method="gl")
    assert nearly_equal_minimum(euler, x, made, 1) is None
    assert nearly_equal_minimum(made, x, replace(made, cost_function=COSTS["iae"]), 1) is None


def test_each_recording_alone_by_the_derivatives_of_all_is_what_its_own_fit_finds(minimum, monkeypatch):
    made, x = minimum
    made = replace(made, experiments=made.experiments[:6])
    x = x[: len(made.names)]
    with monkeypatch.context() as patch:
        patch.setattr("fracid.estimation.agreement.refit", None)  # not asked
        fast = spread(made, x)
    monkeypatch.setattr("fracid.estimation.agreement.derivatives_of_each", lambda *_: {})
    full = spread(made, x)
    for one, other in zip(fast.unknowns.values(), full.unknowns.values(), strict=True):
        assert np.all(np.abs(one.values - other.values) < 0.05 * other.standard_errors)
        assert one.birge == pytest.approx(other.birge, rel=0.05)


@pytest.mark.broad
def test_the_search_by_blocks_ends_at_the_same_minimum_with_a_tenth_of_the_runs(thirty, monkeypatch):
    whole, parts = both(monkeypatch, thirty, initial_state="rest")
    a, b = (refined(p, p.start, Watch()) for p in (whole, parts))
    assert b.best.cost == pytest.approx(a.best.cost, rel=1e-8)
    np.testing.assert_allclose(b.best.point[:2], a.best.point[:2], rtol=1e-5)
    assert b.evaluations < 0.2 * a.evaluations


@pytest.mark.broad
def test_a_bound_holds_in_a_search_by_blocks(thirty, monkeypatch):
    parameters = {"b_alpha": Free(1e-3, 9e-4, 1e-2)}
    whole, parts = both(monkeypatch, thirty[:6], parameters=parameters, initial_state="rest")
    a, b = (refined(p, p.start, Watch()) for p in (whole, parts))
    assert b.best.point[2] == 9e-4
    assert b.best.cost == pytest.approx(a.best.cost, rel=1e-3)


def test_one_recording_whose_difference_fails_leaves_the_others_their_columns(thirty, monkeypatch):
    _, parts = both(monkeypatch, thirty[:4], initial_state="rest")
    x, last, evaluate_all = parts.start, len(parts.start) - 1, Problem.evaluate_all

    def fails_there(self, points):
        return [e if e.point[last] == x[last] else replace(e, cost=np.inf, residuals=None)
                for e in evaluate_all(self, points)]  # fmt: skip

    monkeypatch.setattr(Problem, "evaluate_all", fails_there)
    found = refined(parts, x, Watch()).best
    assert found.point[last] == x[last]
    assert np.all(found.point[:last] != x[:last])


@pytest.mark.broad
def test_many_recordings_with_starts_of_their_own_end_with_intervals():
    many = problem(recordings(40, 80), parameters={"b_alpha": Free(3e-4, 0.0, 1e-2)})
    assert isinstance(many.blocks, Blocks)
    found = fracid.identify(many, jobs=2)
    mu = found.orders["mu"]
    assert found.evaluations < 500
    assert abs(mu.value - 0.97) < 4 * mu.standard_error < 1e-3
    assert all(r.initial["alpha"].standard_error for r in found.recordings.values())
