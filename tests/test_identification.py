"""Identification end to end on exact and noisy twins: what it finds, what it says, how it ends."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

import fracid
from fracid import identification
from fracid.errors import InputError
from fracid.estimation import horizons
from fracid.estimation.covariance import METHODS
from fracid.estimation.search import search
from fracid.estimation.tangent import tangent
from fracid.identification import examination
from fracid.optimise import EvaluationLog, Outcome, Result, optimiser_from_name
from fracid.problem import Experiment, Free, Problem, Tied
from fracid.problem.costs import COSTS, Cost
from fracid.problem.limits import opened
from fracid.selection.opened_bounds import open_bounds
from fracid.validation import discretisation
from program import no_rivals
from twins import release

RIG = fracid.rotary_pendulum("srv02-rotpen")
WIDE = {"lambda": Free(1.0, 0.5, 1.2), "mu": Free(1.0, 0.5, 1.2)}
STEP = 4e-3


def twin(name="swing", **changes):
    """A release from 0.4 rad, known."""
    return release(name, **{"end": 3.0, "alpha": 0.4, "step": STEP} | changes)


def identify(*given, **options):
    """A fit with no models of integer order beside it; fracid.identify has them."""
    with no_rivals():
        return fracid.identify(*given, **options)


def problem(*experiments, **options):
    return Problem(RIG, experiments or (twin(),), **{"orders": WIDE, "initial_state": "held"} | options)


def free(low=0.3, high=3.0, start=1.0, *names):
    return {n: Free(start * (v := RIG.parameter(n).value), low * v, high * v) for n in names}


# --- what it finds ------------------------------------------------------------------------------------


@pytest.mark.few(1)
@pytest.mark.parametrize("start", [(0.7, 1.1), (1.15, 0.6), (0.55, 0.55)])
def test_orders_are_found_from_far_starts(start):
    orders = {n: Free(s, 0.5, 1.2) for n, s in zip(WIDE, start, strict=True)}
    fit = identify(problem(orders=orders))
    assert fit.orders["lambda"].value == pytest.approx(0.9, abs=1e-6)
    assert fit.orders["mu"].value == pytest.approx(0.95, abs=1e-6)
    assert fit.cost < 1e-7
    assert fit.outcome.startswith("converged")


@pytest.mark.broad
def test_a_search_that_ends_above_the_integer_order_model_within_it_goes_on_from_there(monkeypatch):
    swing = twin(orders={"lambda": 1.0, "mu": 1.0}, noise=1e-3)

    def stuck(problem, *_, **__):
        return Result(problem.evaluate(np.array([0.8, 0.9])), Outcome.CONVERGED, 1), ()

    monkeypatch.setattr(identification, "search", stuck)
    monkeypatch.setattr(examination, "settled", tangent)  # which would leave it, too
    monkeypatch.setattr(examination, "walked", lambda here, known, *_, **__: replace(known, walked=np.zeros(2, bool)))
    heard = []
    fit = fracid.identify(problem(swing), observer=fracid.Observer(recordings=heard.append))
    assert fit.cost == pytest.approx(1e-3, rel=0.1)
    assert fit.cost < 0.1 * problem(swing).cost(np.array([0.8, 0.9]))
    assert (fit.claim, fit.alternative) == ("integer", None)  # all is said of where it ended
    first, last = (recordings["swing"] for recordings in heard)
    assert first.cost > 10 * fit.cost
    assert (last.cost, last.rmse) == (fit.recordings["swing"].cost, fit.recordings["swing"].rmse)


@pytest.mark.broad
def test_orders_and_constants_are_found_together():
    constants = free(0.3, 3.0, 1.3, "C1", "J_theta", "b_theta", "b_alpha")
    fit = identify(problem(parameters=constants))
    for name in constants:
        assert fit.parameters[name].value == pytest.approx(RIG.parameter(name).value, rel=1e-4)
        assert fit.parameters[name].free
    assert fit.orders["mu"].value == pytest.approx(0.95, abs=1e-5)
    assert not fit.parameters["C3"].free


@pytest.fixture(scope="module")
def dragging():
    """A swing whose friction is three times what a project looks for."""
    return twin(orders={"lambda": 1.0, "mu": 1.0}, noise=1e-3, end=6.0, parameters={"b_alpha": 1.5e-3})


def bounded(swing, **options):
    ranges = {"b_alpha": Free(3e-4, 0.0, 5e-4, **options)}
    return problem(swing, orders={"lambda": 1.0, "mu": 1.0}, parameters=ranges, initial_state="held")


def test_a_bound_that_stops_a_search_is_opened_and_the_fit_says_so(dragging):
    fit = identify(bounded(dragging))
    (opening,) = fit.opened_bounds
    assert (opening.name, opening.upper, opening.was, opening.bound) == ("b_alpha", True, 5e-4, 5e-3)
    assert fit.parameters["b_alpha"].value == opening.value == pytest.approx(1.5e-3, rel=0.1)
    assert not fit.parameters["b_alpha"].at_bound
    assert opening.lowered == fit.cost < 0.7 * opening.cost
    assert opening.sentence in fit.warnings
    assert opening.sentence.startswith("b_alpha was stopped by its upper bound, 0.0005 N m s/rad: opened to 0.005, the")
    assert "hard = true in its table keeps a bound" in opening.sentence
    assert fit.to_json()["opened_bounds"][0]["was"] == 5e-4
    assert fit.problem.parameters["b_alpha"].upper == 5e-3


@pytest.mark.broad
def test_a_hard_bound_is_not_opened(dragging):
    fit = identify(bounded(dragging, hard=True))
    assert fit.opened_bounds == ()
    assert fit.parameters["b_alpha"].at_bound


def test_a_bound_beyond_which_nothing_is_to_be_found_stays_and_costs_nothing():
    swing = twin(orders={"lambda": 1.0, "mu": 1.0}, noise=1e-3)
    ranges = {"coulomb_alpha": Free(1e-4, 0.0, 1.0), "C1": Free(RIG.parameter("C1").value, 1e-3, 1e-2)}
    p = problem(swing, orders={"lambda": 1.0, "mu": 1.0}, parameters=ranges, initial_state="held")
    assert opened(p, "coulomb_alpha", upper=False) is None  # a friction below 0 is none
    best = p.evaluate(np.array([0.0, RIG.parameter("C1").value]))
    wider, end = open_bounds(p, best)
    assert wider is p
    assert end is best


def test_a_value_is_reached_that_is_hundreds_of_times_beyond_its_bound_though_the_first_step_to_it_gains_little():
    swing = twin(orders={"lambda": 1.0, "mu": 1.0}, noise=0.2, end=6.0, parameters={"b_alpha": 2e-3})
    ranges = {"b_alpha": Free(3e-6, 0.0, 5e-6)}
    p = problem(swing, orders={"lambda": 1.0, "mu": 1.0}, parameters=ranges, initial_state="held")
    wider, end = open_bounds(p, p.evaluate(np.array([5e-6])))
    assert wider.parameters["b_alpha"].upper == pytest.approx(5e-3)
    assert 1e-3 < end.point[0] < 5e-3


@pytest.mark.parametrize(
    ("name", "given", "upper", "bound"),
    [
        ("b_alpha", (0.1, 0.01, 1.0), True, 10.0),
        ("b_alpha", (0.1, 0.01, 1.0), False, 0.001),
        ("b_alpha", (0.1, -0.01, 1.0), False, None),  # it would drive the rig
        ("torque_per_volt", (-0.1, -1.0, -0.01), False, -10.0),
        ("torque_per_volt", (-0.1, -1.0, -0.01), True, -0.001),
        ("torque_per_volt", (-0.1, -1.0, 0.0), True, None),  # another sign is another rig
        ("presliding_alpha", (0.1, 0.0, 0.2), True, 0.5),  # as far as a joint gives
        ("presliding_alpha", (0.1, 0.0, 0.5), True, None),
        ("theta_rest", (0.0, -1.0, 1.0), True, 6.3),
        ("C1", (1.0, 0.1, np.inf), True, None),
    ],
)
def test_a_bound_opens_as_far_as_a_parameter_means_something(name, given, upper, bound):
    still = Experiment("still", 0.1, np.zeros((9, 2)), np.zeros((1, 1)))
    wider = opened(
        problem(still, orders={"lambda": 1.0, "mu": 1.0}, parameters={name: Free(*given)}), name, upper=upper
    )
    assert (wider and (wider.upper if upper else wider.lower)) == (bound and pytest.approx(bound))


@pytest.mark.broad
def test_the_start_of_a_swing_and_what_each_recording_has_for_itself_are_found():
    rigs = {"a": 0.05, "b": -0.03}
    swings = []
    for name, rest in rigs.items():
        rig = RIG.with_parameters(alpha_rest=rest)
        run = fracid.simulate(rig, orders=[0.9, 0.9, 0.95, 0.95], step=STEP, end=3.0,
                              initial={"theta": 0.1, "alpha": 0.4, "D^mu alpha": 1.0})  # fmt: skip
        swings.append(Experiment(name, STEP, run.states[:, [0, 2]], np.zeros((1, 1))))
    fit = identify(problem(*swings, parameters={"alpha_rest": Free(0.0, -0.2, 0.2)}, per_recording=("alpha_rest",),
                           initial_state="estimate"))  # fmt: skip
    assert fit.cost < 1e-6
    assert "alpha_rest" not in fit.parameters
    for name, rest in rigs.items():
        assert fit.recordings[name].parameters["alpha_rest"].value == pytest.approx(rest, abs=1e-4)
        assert fit.recordings[name].initial["D^mu alpha"].value == pytest.approx(1.0, abs=1e-3)
        assert fit.recordings[name].initial["theta"].free


@pytest.mark.broad
@pytest.mark.few(2)
@pytest.mark.parametrize("name", sorted(COSTS))
def test_every_cost_finds_the_orders_of_a_noisy_twin(name):
    fit = identify(problem(twin(noise=2e-3), cost_function=COSTS[name]))
    for order, true in (("lambda", 0.9), ("mu", 0.95)):
        found = fit.orders[order]
        assert abs(found.value - true) < 4 * found.standard_error < 0.02


@pytest.mark.broad
def test_a_growing_horizon_and_the_integer_orders_leave_a_local_minimum_in_which_plain_least_squares_ends():
    p = problem(orders={"lambda": Free(0.6, 0.5, 1.2), "mu": Free(1.15, 0.5, 1.2)})
    searched, _ = search(p, optimiser_from_name("least-squares"), np.random.default_rng(1))
    assert searched.best.cost > 0.1
    assert fracid.identify(p, optimiser="least-squares").x == pytest.approx(
        [0.9, 0.95], abs=1e-6
    )  # from orders 1, nested
    for starts in (1, 4):
        searched, _ = search(p, optimiser_from_name("multistart"), np.random.default_rng(1), starts=starts)
        assert searched.best.point == pytest.approx([0.9, 0.95], abs=1e-6)


def test_a_users_cost_is_minimised_without_residuals():
    worst = Cost("worst", function=lambda time, residual: float(np.max(np.abs(residual))))
    p = problem(orders={"lambda": 0.9, "mu": WIDE["mu"]}, cost_function=worst)
    fit = identify(p, optimiser="nelder-mead", validation=(twin("other", alpha=0.2),))
    assert fit.orders["mu"].value == pytest.approx(0.95, abs=1e-4)
    assert fit.orders["mu"].interval95 is None
    assert fit.discretisation.shift == {}
    assert "There are no intervals: worst is a user's own cost, of unknown loss" in fit.warnings[0]


# --- threads, seeds, logs -----------------------------------------------------------------------------


@pytest.mark.broad
@pytest.mark.few(1)
@pytest.mark.parametrize("optimiser", ["multistart", "genetic"])
def test_the_result_is_the_same_for_any_number_of_threads(optimiser):
    p = problem(twin(noise=1e-3, end=1.0))
    options = {"generations": 3} if optimiser == "genetic" else {}
    one, three = (
        fracid.identify(
            p, optimiser=optimiser, validation=(twin("other", end=1.0),), jobs=jobs, starts=2, options=options
        )
        for jobs in (1, 3)
    )
    assert json.dumps(one.to_json()) == json.dumps(three.to_json())
    assert np.array_equal(one.x, three.x)


@pytest.mark.broad
def test_another_seed_searches_elsewhere():
    p = problem(twin(end=1.0))
    found = [identify(p, optimiser="genetic", seed=s, options={"generations": 1}).x.tolist() for s in (1, 1, 2)]
    assert found[0] == found[1] != found[2]


@pytest.mark.broad
def test_every_evaluation_of_the_search_is_logged_and_called_back(tmp_path):
    calls = []
    with EvaluationLog(tmp_path / "log.jsonl") as log:
        fit = identify(problem(twin(end=3.0)), log=log, callback=lambda best, n: calls.append((n, best.cost)))
    lines = [json.loads(line) for line in (tmp_path / "log.jsonl").read_text().splitlines()]
    assert len(lines) == fit.evaluations == calls[-1][0]
    assert [n for n, _ in calls] == sorted(n for n, _ in calls)
    assert set(lines[0]["point"]) == {"lambda", "mu"}


# --- validation ---------------------------------------------------------------------------------------


@pytest.mark.broad
def test_a_validation_recording_gets_its_own_start_and_nothing_else():
    fitted, other = twin(noise=1e-3), twin("other", alpha=0.25, noise=1e-3, seed=2, orders=(0.8, 0.8, 0.9, 0.9))
    other = replace(other, initial={})
    p = problem(fitted)
    heard = []
    alone = identify(p)
    both = identify(p, validation=(other,), observer=fracid.Observer(recordings=heard.append))
    assert [list(recordings) for recordings in heard] == [["swing"], ["swing", "other"]]
    assert np.array_equal(heard[1]["other"].fitted["theta"], both.recordings["other"].fitted["theta"])
    assert np.array_equal(alone.x, both.x)
    assert both.cost == alone.cost
    seen = both.recordings["other"]
    assert (seen.use, seen.parameters) == ("validate", {})
    assert seen.rmse["theta"] > 5e-3  # its orders are others, and it may not change them

    free_start = replace(p, initial_state="estimate")
    again = identify(free_start, validation=(other,)).recordings["other"]
    assert all(estimate.free for estimate in again.initial.values())
    assert again.cost < 0.7 * seen.cost


@pytest.mark.broad
def test_a_validation_recording_may_have_its_own_parameters():
    rig = RIG.with_parameters(alpha_rest=0.07)
    run = fracid.simulate(rig, orders=[0.9, 0.9, 0.95, 0.95], initial={"alpha": 0.3}, step=STEP, end=3.0)
    other = Experiment("other", STEP, run.states[:, [0, 2]], np.zeros((1, 1)), initial={"theta": 0.0, "alpha": 0.3})
    p = problem(parameters={"alpha_rest": Free(0.0, -0.2, 0.2)}, per_recording=("alpha_rest",))
    fit = identify(p, validation=(other,))
    assert fit.recordings["swing"].parameters["alpha_rest"].value == pytest.approx(0.0, abs=1e-6)
    assert fit.recordings["other"].parameters["alpha_rest"].value == pytest.approx(0.07, abs=1e-6)


@pytest.mark.broad
def test_a_validation_recording_that_no_run_reaches_the_end_of_is_told():
    high = replace(twin("high"), initial={"theta": 0.0, "alpha": 1e5})
    fit = identify(problem(), validation=(high,))
    assert fit.recordings["high"].cost == math.inf
    assert any("No run of the validation recording reached its end: high: diverged" in w for w in fit.warnings)
    assert fit.to_json()["recordings"]["high"]["rmse"] == {"theta": None, "alpha": None}


def test_recordings_of_one_name_are_refused():
    with pytest.raises(InputError, match="2 recordings are named 'swing'"):
        identify(problem(), validation=(twin(),))


# --- how it ends ----------------------------------------------------------------------------------------


def interrupt_after(evaluations):
    def callback(best, n):
        if n >= evaluations:
            raise KeyboardInterrupt

    return callback


@pytest.mark.few(1)
@pytest.mark.parametrize("optimiser", ["multistart", "genetic", "differential-evolution"])
def test_ctrl_c_keeps_the_best_so_far(optimiser):
    p = problem(twin(noise=1e-3, end=3.0), parameters=free(0.3, 3.0, 1.3, "C1"))
    fit = identify(p, optimiser=optimiser, callback=interrupt_after(9))
    assert fit.outcome == "interrupted: the best so far is kept"
    assert fit.cost == p.cost(fit.x) < math.inf
    assert fit.discretisation is None
    assert "There are no intervals: the search was interrupted." in fit.warnings
    json.dumps(fit.to_json(), allow_nan=False)


@pytest.mark.few(1)
@pytest.mark.parametrize("stage", ["uncertainty", "validation_fit", "discretisation_check", "lowest_from"])
def test_ctrl_c_after_the_search_keeps_its_result(monkeypatch, stage):
    def interrupted(*args, **options):
        raise KeyboardInterrupt

    p, validation = problem(twin(end=1.0)), (twin("other", end=1.0),)
    monkeypatch.setattr(examination, stage, interrupted)
    fit = identify(p, optimiser="genetic", validation=validation, options={"generations": 2})
    assert fit.outcome == "interrupted: the best so far is kept"
    assert fit.cost == p.cost(fit.x)
    assert (fit.uncertainty is None) == (stage == "uncertainty")


def test_ctrl_c_after_a_lower_minimum_leaves_no_claim_of_the_former_one(monkeypatch):
    def interrupted(found):
        if found.restarts:
            raise KeyboardInterrupt

    steps = interrupted, examination.Examination.make_claim, lambda found: found.at.best
    monkeypatch.setattr(examination, "STEPS", tuple(("", "claim", step) for step in steps))
    assert fracid.identify(problem(twin(end=1.0))).claim_reasons == examination.NO_CLAIM.reasons


def test_ctrl_c_inside_a_refinement_counts_too(monkeypatch):
    minimise, searches = horizons.minimise, []

    def second_is_interrupted(*args, **options):
        searches.append(options)
        return minimise(*args, **options | ({"callback": interrupt_after(0)} if len(searches) > 1 else {}))

    monkeypatch.setattr(discretisation, "nearly_equal_minimum", lambda *_: None)
    monkeypatch.setattr(discretisation, "beside", lambda *_: None)
    monkeypatch.setattr(horizons, "minimise", second_is_interrupted)
    fit = identify(problem(twin(end=1.0)), optimiser="least-squares")
    assert fit.outcome.startswith("interrupted")
    assert fit.discretisation is None
    assert fit.uncertainty is not None


def test_a_search_in_which_every_run_fails_gives_a_fit_with_the_reason():
    fit = identify(problem(parameters={"C3": 0.1}))
    assert fit.cost == math.inf
    assert fit.outcome is Outcome.ALL_FAILED
    assert any(w.startswith("No run reached its end: swing: ") and "det M = 0" in w for w in fit.warnings)
    content = json.loads(json.dumps(fit.to_json(), allow_nan=False))
    assert content["cost"]["value"] is None
    assert content["orders"]["mu"]["standard_error"] is None


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"optimiser": "genetik"}, "unknown optimiser 'genetik': did you mean genetic"),
        ({"jobs": 0}, "jobs = 0; expected a whole number, 1 or more"),
        ({"optimiser": "genetic", "options": {"population": 1}}, "population = 1"),
    ],
)
def test_what_cannot_be_is_told(options, message):
    with pytest.raises(InputError, match=message):
        identify(problem(), **options)


def test_nothing_free_is_told():
    with pytest.raises(InputError, match="Nothing is free: give at least one order or parameter a start"):
        identify(problem(orders={"lambda": 0.9, "mu": 0.95}))


# --- what it warns of -----------------------------------------------------------------------------------

INTEGER = {"orders": (1.0, 1.0, 1.0, 1.0), "step": 1e-3, "end": 5.0, "alpha": 0.17}


@pytest.mark.broad
@pytest.mark.parametrize("cost", ["rmse", "itae"])
def test_an_explicit_scheme_manufactures_fractional_orders_and_the_check_says_so(cost):
    # 20 s at 1 kHz, exact and of order 1: Euler's growth is balanced by orders below 1
    exact = twin(**INTEGER | {"end": 20.0})
    alone = replace(exact, measured=np.ascontiguousarray(exact.measured[:, 1:]))
    fit = identify(problem(alone, outputs=("alpha",), method="gl", cost_function=COSTS[cost]))
    assert fit.orders["lambda"].value == pytest.approx(0.88, abs=0.01)
    assert fit.orders["mu"].value == pytest.approx(0.9988, abs=2e-4)
    assert "λ moves by +0.1" in fit.discretisation.warning
    assert "μ moves by +0.00" in fit.discretisation.warning
    assert fit.discretisation.warning.endswith('artefact of the step of gl. Type method = "pi2" in [fit].')
    assert fit.discretisation.warning in fit.warnings
    assert fit.discretisation.orders["lambda"] == pytest.approx(1.0, abs=1e-3)


@pytest.mark.broad
@pytest.mark.parametrize("method", ["gl", "gl-paper"])
def test_a_first_order_fit_of_a_twin_carries_its_check_into_the_result(method):
    twin_of_order_one = twin(noise=1e-3, **INTEGER | {"end": 10.0})
    p = problem(twin_of_order_one, method=method, orders={"lambda": 1.0, "mu": WIDE["mu"]})
    check = identify(p).to_json()["discretisation"]
    assert check["cost_second_order"] != check["cost_half_step"] != check["cost"]
    assert check["shift"]["mu"] == pytest.approx(check["orders"]["mu"] - identify(p).orders["mu"].value)
    assert check["orders"]["mu"] == pytest.approx(1.0, abs=1e-3)  # what the equations say
    assert abs(check["shift"]["mu"]) > 1e-3  # what the scheme made of it
    assert check["warning"].startswith("μ moves by +0.00")
    assert check["warning"].endswith(f'artefact of the step of {method}. Type method = "pi2" in [fit].')


@pytest.mark.broad
def test_the_second_order_method_finds_integer_orders_and_the_check_is_silent():
    fit = fracid.identify(problem(twin(noise=1e-3, seed=2, **INTEGER)))
    for order in fit.orders.values():
        assert order.interval95[0] <= 1.0 <= order.interval95[1]
    assert fit.discretisation.warning == ""
    assert fit.warnings == ()


def test_the_paper_scheme_and_lambda_from_alpha_alone_are_warned_of():
    swing = twin(end=1.0)
    swing = replace(swing, measured=swing.measured[:, 1:])
    fit = identify(problem(swing, outputs=("alpha",), method="gl-paper"), optimiser="genetic",
                   options={"generations": 2})  # fmt: skip
    assert any("gl-paper sums raw x" in w for w in fit.warnings)
    assert any("Only α is scored, and it carries almost no" in w for w in fit.warnings)


@pytest.mark.broad
def test_a_search_that_stops_short_is_told_how_far():
    fit = identify(problem(twin(noise=1e-3, end=1.0)), optimiser="genetic", options={"generations": 1})
    assert "stopped before it converged: least squares from its best point" in fit.warnings[0]


@pytest.mark.broad
def test_a_bound_that_is_reached_is_told():
    fit = identify(problem(orders={"lambda": Free(1.0, 0.95, 1.2), "mu": WIDE["mu"]}))
    assert fit.orders["lambda"].at_bound
    assert fit.orders["lambda"].bound == 0.95
    assert fit.orders["mu"].bound is None
    assert {n: e["bound"] for n, e in fit.to_json()["orders"].items()} == {"lambda": 0.95, "mu": None}
    assert fit.orders["lambda"].identifiable == "at its bound"
    assert "λ lies at its bound: 0.95; widen the bound or extend the model." in fit.warnings


@pytest.mark.broad
def test_confounded_constants_are_named_in_the_result():
    names = ("C1", "C3", "C4", "C6", "J_theta", "b_theta", "b_alpha")
    fit = identify(problem(twin(noise=1e-3), parameters=free(0.3, 3.0, 1.0, *names)), options={})
    C4 = fit.parameters["C4"]
    assert C4.identifiable == "only in a ratio"
    assert C4.reason.startswith("with C1: only C4/C1")
    assert C4.interval95 is None
    assert any("cannot separate C1 and C3 and C4" in w for w in fit.warnings)
    assert fit.orders["mu"].identifiable == "identifiable"


@pytest.mark.broad
def test_recordings_that_do_not_agree_are_told():
    swings = twin("calm", noise=1e-3, seed=1), twin("rough", noise=1e-3, seed=2, parameters={"b_alpha": 4e-3})
    fit = identify(problem(*swings, orders={"lambda": 0.9, "mu": Free(0.95, 0.5, 1.2)}))
    assert list(fit.spread.unknowns) == ["mu"]
    assert fit.spread.unknowns["mu"].birge > 2
    assert any(w.startswith("mu differs from recording to recording by") for w in fit.warnings)
    assert fit.to_json()["spread"]["recordings"] == ["calm", "rough"]
    alone = identify(problem(swings[0], orders={"lambda": 0.9, "mu": Free(0.95, 0.5, 1.2)}))
    assert alone.spread is None


@pytest.mark.broad
def test_what_is_tied_is_checked_with_what_it_follows():
    fit = identify(problem(orders={"lambda": Tied("mu"), "mu": Free(1.0, 0.5, 1.2)}))
    assert fit.discretisation.shift["lambda"] == fit.discretisation.shift["mu"]
    assert fit.orders["lambda"] == fit.orders["mu"]


@pytest.mark.broad
def test_how_far_the_orders_move_with_the_cut_is_found_where_it_is_asked_for():
    asked = identify(problem(orders={"lambda": 0.9, "mu": Free(0.95, 0.5, 1.2)}, initial_state="estimate"), cut=True)
    assert asked.cut.as_fitted.orders == {"mu": asked.orders["mu"].value}
    assert {name.split(" by")[0] for name in asked.cut.treatments} == {"cut later"}
    assert asked.to_json()["cut"]["treatments"]
    none_free = identify(
        problem(orders={"lambda": 0.9, "mu": 0.95}, parameters=free(0.3, 3.0, 1.0, "b_alpha")), cut=True
    )
    assert none_free.cut is None
    assert "The cut was not checked: no order is free." in none_free.warnings


# --- the result -----------------------------------------------------------------------------------------


@pytest.mark.broad
def test_the_result_holds_what_other_programs_rely_on():
    fit = identify(problem(replace(twin(noise=1e-3), start=9.85, sha256="abc")))
    content = json.loads(json.dumps(fit.to_json(), allow_nan=False))
    assert set(content) >= {"model", "method", "memory", "step", "orders", "parameters", "recordings", "cost",
                            "discretisation", "evaluations", "outcome", "seed"}  # fmt: skip
    assert set(content["orders"]["mu"]) >= {"value", "standard_error", "interval95", "free"}
    assert set(content["parameters"]["C1"]) >= {"value", "unit", "standard_error", "interval95", "free", "at_bound",
                                                "identifiable"}  # fmt: skip
    assert content["parameters"]["C1"]["interval_method"] is None
    mu = content["orders"]["mu"]
    assert mu["interval_method"] == "sandwich"
    assert mu["white95"][0] < mu["value"] < mu["white95"][1]
    assert content["interval_methods"] == {n: METHODS[n] for n in ("sandwich", "white", "walk")}
    swing = content["recordings"]["swing"]
    assert (swing["use"], swing["samples"], swing["from"], swing["to"]) == ("fit", 751, 9.85, pytest.approx(12.85))
    assert swing["rmse"]["alpha"] == pytest.approx(1e-3, rel=0.1)
    assert 99 < swing["fit_percent"]["alpha"] <= 100
    assert content["cost"] == {"name": "rmse", "value": fit.cost, "outputs": ["theta", "alpha"]}


@pytest.mark.broad
def test_a_recording_gives_its_residual_and_its_percent_of_fit():
    fit = identify(problem(twin(noise=1e-3)))
    swing = fit.recordings["swing"]
    y, e = swing.measured["alpha"], swing.residual("alpha")
    assert np.array_equal(e, y - swing.fitted["alpha"])
    assert swing.fit_percent["alpha"] == pytest.approx(100 * (1 - np.linalg.norm(e) / np.linalg.norm(y - y.mean())))
    three = {"alpha": np.ones(3)}
    flat = replace(swing, time=np.arange(3.0), measured=three, fitted=three, scored={})
    assert flat.fit_percent == {"alpha": 100.0}
    assert replace(flat, fitted={"alpha": np.zeros(3)}).fit_percent == {"alpha": -np.inf}


@pytest.mark.broad
def test_a_model_that_explains_nothing_is_told():
    other = problem(parameters={"C4": 0.05}, orders={"lambda": 0.9, "mu": Free(1.0, 0.95, 1.05)})
    fit = identify(other)
    (said,) = (w for w in fit.warnings if "swing: the model is no better than a constant for alpha, fit -" in w)
    assert said.endswith("another start may do better, type --multi-start 16.")
    assert not any("--multi-start" in w for w in identify(other, starts=2).warnings)


def test_a_model_that_does_not_fit_has_no_interval_anywhere():
    other = replace(twin("other", noise=1e-3, end=1.0), initial={"alpha": Free(0.5, 0.45, 0.8)})
    wrong = {"parameters": {"C4": 0.05}, "orders": {"lambda": 0.9, "mu": Free(1.0, 0.95, 1.05)}}
    fit = fracid.identify(problem(twin(noise=1e-3, end=1.0), **wrong), validation=(other,))
    assert fit.claim_codes == ("no-fit", "decide-model")
    for e, bound in ((fit.orders["mu"], 0.95), (fit.recordings["other"].initial["alpha"], 0.45)):
        assert (e.bound, e.identifiable, e.reason) == (bound, "at its bound", f"{bound}")
        assert (e.interval95, e.white95, e.standard_error) == (None, None, None)


def test_a_step_too_coarse_for_steep_friction_is_told():
    run = fracid.simulate(RIG, orders=[1.0] * 4, initial={"alpha": 0.4}, step=1e-3, end=3.0,
                          parameters={"coulomb_theta": 0.05, "slip_speed": 5e-3})  # fmt: skip
    swing = Experiment("swing", 0.01, run.states[::10, [0, 2]], np.zeros((1, 1)), initial={"theta": 0.0, "alpha": 0.4})
    steep = {"slip_speed": 5e-3, "coulomb_theta": Free(0.04, 0.0, 0.1)}
    fit = identify(problem(swing, parameters=steep, orders={"lambda": 1.0, "mu": 1.0}))
    assert "The step is too coarse: at half of it the same values cost" in fit.discretisation.warning
    assert "Type substeps = 2 in [fit]" in fit.discretisation.warning
