"""The integer-order rival: orders that stand in for friction are told from orders that are there."""

import json
from dataclasses import replace

import numpy as np
import pytest

import fracid
from fracid.identification import identify
from fracid.models import Parameter
from fracid.models.library import from_library
from fracid.models.written.equations import Equation, Equations
from fracid.problem import Experiment, Free, Problem, Tied
from fracid.problem.costs import COSTS
from fracid.selection.integer_rival import (
    Alternative,
    Rival,
    beside_fit,
    freed_friction,
    gain_over,
    integer_rival,
    integer_values,
    judged,
)
from twins import release

RIG = fracid.rotary_pendulum("srv02-rotpen")
BOTH = {"lambda": Free(1.0, 0.3, 1.2), "mu": Free(1.0, 0.5, 1.2)}
COUNT = 2 * np.pi / 4096
DRY = {"coulomb_theta": 2e-3, "coulomb_alpha": 3e-4}


def swing(orders=(1.0, 1.0), parameters=None, *, counts=True, alpha=0.5, end=8.0, outputs=("theta", "alpha")):
    """A release of a rig of those orders and friction, read by an encoder."""
    return release(orders=dict(zip(BOTH, orders, strict=True)), parameters=parameters or {}, alpha=alpha, step=2e-3,
                   end=end, outputs=outputs, counts=counts)  # fmt: skip


def nominal(twin, **options):
    return Problem(RIG, (twin,), **{"orders": BOTH, "initial_state": "held"} | options)


@pytest.mark.few(1)
@pytest.mark.parametrize("counts", [False, True])
@pytest.mark.parametrize("friction", [DRY, {"coulomb_alpha": 1e-3}, DRY | {"b_theta": 0.02, "b_alpha": 1e-4}])
def test_integer_order_data_with_dry_friction_and_a_model_without_it_are_not_called_fractional(friction, counts):
    fit = identify(nominal(swing(parameters=friction, counts=counts)))
    assert any(abs(order.value - 1) > 2e-3 for order in fit.orders.values())  # what the nominal model finds
    assert fit.alternative.gain < -100
    assert any(
        "no evidence of fractional dynamics" in w and "explains the recordings better" in w for w in fit.warnings
    )
    for name in fit.alternative.orders:
        assert fit.orders[name].identifiable == "may stand in for friction that the model lacks"
    for name, true in friction.items():
        assert fit.alternative.parameters[name] == pytest.approx(true, rel=0.1)


def test_a_rest_that_an_encoder_shows_as_one_value_is_one_sample_however_long_it_is():
    friction = {"b_theta": 0.1, "b_alpha": 5e-3, "coulomb_theta": 2e-2, "coulomb_alpha": 2e-3}
    twin = swing(parameters=friction, end=4.0, outputs=("alpha",))
    rest = np.full((8_000, 1), 0.4 * COUNT)  # all that is possible there is within half a step
    twin = replace(twin, measured=np.concatenate([twin.measured, rest]))
    known = nominal(twin, orders={"lambda": 1.0, "mu": 1.0}, parameters=friction, outputs=("alpha",))
    creeping = replace(known, parameters={**known.parameters, "alpha_rest": Free(0.4 * COUNT, -1.0, 1.0)})
    rest_alone = Rival(creeping, creeping.evaluate(creeping.start), "", {})
    assert rest_alone.evaluation.cost < 0.9 * known.evaluate(known.start).cost
    assert gain_over(rest_alone, known, known.evaluate(known.start))[1] > 10


def test_friction_that_is_freed_may_be_as_large_as_what_is_alike_it():
    time = np.arange(0, 1, 0.01)
    e = Experiment("swing", 0.01, np.cos(9 * time)[:, None], 20 * np.sin(time)[:, None])
    names = ["springpot_displacement", "coulomb_displacement"]
    stiff = Problem(from_library("oscillator"), (e,), {"mu": 1.0}, {"k": 300.0}, initial_state="held")
    assert [freed_friction(stiff, [n])[n].upper for n in names] == pytest.approx([300.0, 16.7], rel=0.01)


MASS = {"x": Equation("v"), "v": Equation("-k*x - c*z"), "z": Equation("v", "1 - nu")}


@pytest.mark.parametrize("own", [("nu",), ("nu", "k", "c")])
def test_the_rival_of_an_order_that_is_a_parameter_has_a_spring_or_a_dashpot(own):
    constants = [Parameter(n, "", v, "", lower=0.0) for n, v in {"k": 30.0, "c": 1.0, "nu": 0.5}.items()]
    model = Equations(MASS, {"x": Equation("x")}).model("mass", constants)
    run = fracid.simulate(model, initial={"x": 0.01}, step=5e-3, end=4.0)
    noise = 1e-4 * np.random.default_rng(1).standard_normal(len(run.time))
    twin = Experiment("twin", 5e-3, run.states[:, :1] + noise[:, None], np.zeros((1, 0)), initial={"x": 0.01})
    ranges = {"nu": Free(0.5, 0.02, 1.0), "k": Free(30.0, 0.0, 90.0), "c": Free(1.0, 0.0, 9.0)}
    problem = Problem(model, (twin,), {}, {n: ranges[n] for n in own}, initial_state="rest")
    best = problem.evaluate(problem.start)
    rival = integer_rival(problem, best, {"nu": 0.01})
    assert "nu" not in rival.problem.names
    assert rival.integers in ("nu = 0", "nu = 1")
    assert rival.nested_in(problem)["nu"] == pytest.approx(float(rival.integers[-1]), abs=1e-6)
    assert gain_over(rival, problem, best)[1] > 10


@pytest.mark.broad
@pytest.mark.few(1)
@pytest.mark.parametrize("orders", [(0.8623, 0.9146), (0.95, 0.97)])
def test_fractional_data_keep_their_orders(orders):
    fit = identify(nominal(swing(orders)))
    assert fit.alternative.gain > 10  # tried, and beaten
    assert fit.alternative.warning == ""
    assert fit.warnings == ()
    assert [order.value for order in fit.orders.values()] == pytest.approx(orders, abs=2e-3)
    assert all(order.identifiable == "identifiable" for order in fit.orders.values())


@pytest.mark.broad
def test_fractional_data_with_dry_friction_in_the_model_are_called_fractional():
    free = {n: Free(0.5 * v, 0.0, 10 * v) for n, v in DRY.items()}
    fit = identify(nominal(swing((0.9, 0.95), DRY), parameters=free))
    assert fit.alternative.gain > 10  # the rival frees the viscous friction as well
    assert fit.warnings == ()


@pytest.mark.broad
def test_a_cost_on_alpha_alone_is_compared_by_itself():
    twin = swing(parameters={"coulomb_alpha": 3e-4}, outputs=("alpha",), alpha=0.1745)
    fit = identify(nominal(twin, outputs=("alpha",), cost_function=COSTS["itae"]))
    assert fit.alternative.cost < 0.2 * fit.cost
    assert any("no evidence of fractional dynamics" in w for w in fit.warnings)


ALL = {n: Free(1e-3, 0.0, 0.1) for n in ("b_theta", "b_alpha", "coulomb_theta", "coulomb_alpha")}


def warning(rival, problem, best):
    gain, cost = gain_over(rival, problem, best)[1], rival.evaluation.cost
    nearest = Alternative(rival.structure, (*rival.off,), cost, {}, gain, 100.0, judged=judged(rival, gain))
    return beside_fit(nearest, rival.off, problem, best.cost, best.cost).warning


def test_a_claim_names_the_orders_and_costs_that_stand_beside_it_where_models_were_compared_on_coarser_recordings():
    twin = release("dense", alpha=0.5, step=4e-4, end=4.0, noise=1e-3, orders={"lambda": 1.0, "mu": 1.0},
                   parameters={"b_alpha": 1e-3})  # fmt: skip
    fit = identify(Problem(RIG, (twin,), {"lambda": 1.0, "mu": Free(0.98, 0.5, 1.2)}, initial_state="held"))
    assert fit.claim == "integer"
    assert f"it costs {fit.alternative.cost:.6g}, this one {fit.cost:.6g}, and has" in fit.claim_reasons[0]
    assert fit.claim_reasons[0].startswith(f"μ = {fit.orders['mu'].value:.4g}: ")
    assert fit.claim_reasons[0] == fit.alternative.warning


@pytest.mark.parametrize(
    ("at", "widths", "options"),
    [
        ((1.0, 1.0), {}, {}),  # integer orders
        ((0.98, 1.0), {"lambda": 0.03}, {}),  # off 1 by less than the interval
    ],
)
def test_nothing_is_tried_where_nothing_is_claimed(at, widths, options):
    problem = nominal(swing(end=1.0), **options)
    x = np.concatenate([at, problem.start[2:]])
    assert integer_rival(problem, problem.evaluate(x), widths) is None


@pytest.mark.parametrize(
    "parameters",
    [ALL, {"J_theta": 1e6, "b_alpha": ALL["b_alpha"], "coulomb_alpha": ALL["b_alpha"]}],
    ids=["all friction is free", "the arm's friction is not seen"],
)
def test_where_no_friction_is_left_to_free_the_rival_is_the_same_model_at_order_1(parameters):
    problem = nominal(swing(parameters=DRY, end=3.0), parameters=parameters)
    off = problem.start - 0.02 * (np.arange(len(problem.start)) < 2)
    rival = integer_rival(problem, best := problem.evaluate(off), {})
    assert rival.structure == "every order 1"
    assert rival.parameters == {}
    assert "With every order 1 the same model explains the recordings better" in warning(rival, problem, best)


@pytest.mark.broad
def test_an_order_off_1_by_chance_is_not_called_fractional():
    twin = swing(parameters=DRY, end=3.0, counts=False)
    noise = 3e-2 * np.random.default_rng(28).standard_normal(twin.measured.shape)
    fit = identify(nominal(replace(twin, measured=twin.measured + noise), parameters=ALL))
    missed = [n for n, e in fit.orders.items() if not e.interval95[0] <= 1 <= e.interval95[1]]
    assert missed == ["lambda"]  # of 40 seeds one of two where the interval misses 1, by more than 0.001
    assert -20 < fit.alternative.gain < 10
    assert any("no evidence of fractional dynamics" in w for w in fit.warnings)
    assert all(fit.orders[n].identifiable == "not distinguishable from 1 with these recordings" for n in missed)


def test_an_order_that_the_recordings_do_not_see_is_not_called_off_1():
    """The arm is all but clamped: its order stays where the search left it, 0.9, and no rival has to explain that."""
    twin = swing((1.0, 1.0), {"J_theta": 1e6}, end=3.0, outputs=("alpha",))
    fit = identify(nominal(twin, parameters={"J_theta": 1e12}, outputs=("alpha",),
                           orders={"lambda": Free(0.9, 0.3, 1.2), "mu": BOTH["mu"]}))  # fmt: skip
    assert fit.orders["lambda"].interval95 is None
    assert fit.orders["lambda"].identifiable == "not at all"
    assert fit.alternative is None


@pytest.mark.broad
def test_orders_that_are_tied_have_their_rival_too():
    problem = nominal(swing(parameters=DRY, counts=False), orders={"lambda": BOTH["lambda"], "mu": Tied("lambda")})
    fit = identify(problem)
    assert fit.orders["mu"] == fit.orders["lambda"]
    assert fit.alternative.gain < 0


def test_the_rival_of_the_papers_scheme_is_solved_by_the_second_order_method():
    problem = nominal(swing(end=3.0), method="gl-paper")
    rival = integer_rival(problem, problem.evaluate(np.array([0.9, 0.95])), {})
    exact = replace(
        problem, method="pi2", orders={"lambda": 1.0, "mu": 1.0}, parameters={"b_theta": Free(2.4e-3, 0, 1)}
    )
    assert rival.evaluation.cost == pytest.approx(exact.cost(exact.start), rel=0.05)


def test_the_result_file_holds_the_rival():
    fit = identify(nominal(swing(parameters=DRY, end=3.0)))
    content = json.loads(json.dumps(fit.to_json(), allow_nan=False))["alternative"]
    assert content["structure"] == "every order 1; b_theta, b_alpha, coulomb_theta, coulomb_alpha free"
    assert content["bic_gain_of_the_fractional_model"] < 0 < content["effective_samples"]
    assert content["warning"] in fit.warnings


# --- orders whose integer value is not 1 ------------------------------------------------------------------


def damped(t, x, u, p, out):
    """x'' + c D^(1-r) x + k x = 0, z = D^(1-r) x as D^r z = x'."""
    out[0] = x[1]
    out[1] = -p[0] * x[2] - p[1] * x[0]
    out[2] = x[1]


def dashpot(t, x, u, p, out):
    """The same at r = 0, where z is the speed."""
    out[0] = x[1]
    out[1] = -p[0] * x[1] - p[1] * x[0]


def mount(rhs=damped, **options):
    states = ("x", "x'", "z")[: 3 if rhs is damped else 2]
    constants = (fracid.Parameter("c", "1/s", 0.6, "damping"), fracid.Parameter("k", "1/s^2", 40.0, "stiffness"))
    return fracid.Model("mount", rhs, states, ("v", "v", "r")[: len(states)], {"x": 0}, (), constants, "", "a test",
                        **options)  # fmt: skip


SPRING = {"c": Free(0.5, 0.0, 5.0), "k": Free(38.0, 30.0, 50.0)}
R_IS_0 = {"integer_orders": {"r": 0}}


def struck(model, seed=0, noise=1e-4, **orders):
    run = fracid.simulate(model, orders={"v": 1.0, **orders}, initial={"x": 1.0}, step=1e-2, end=8.0)
    y = run.states[:, [0]] + noise * np.random.default_rng(seed).standard_normal((len(run.states), 1))
    return Experiment("struck", 1e-2, y, np.zeros((1, 0)), initial={"x": 1.0})


def sought(model, experiment):
    free = {"r": Free(0.5, 1e-4, 1.2)} if model.rhs is damped else {}
    return Problem(model, (experiment,), {"v": 1.0, **free}, SPRING, outputs=("x",),
                   initial_state="held")  # fmt: skip


@pytest.mark.broad
def test_the_rival_of_an_order_whose_integer_value_is_0_is_the_dashpot_and_not_the_spring():
    data = struck(mount(), r=0.4)
    fair, unfair = (identify(sought(mount(**declared), data)) for declared in (R_IS_0, {}))
    by_hand = identify(sought(mount(dashpot), data))
    assert fair.orders["r"].value == pytest.approx(0.4, abs=0.01)
    dashpot_alone, spring = fair.alternative.trials[0], unfair.alternative.trials[0]
    assert fair.alternative.structure.startswith("r = 0")
    assert dashpot_alone.cost == pytest.approx(by_hand.cost, rel=2e-3)
    assert fair.alternative.gain > 10
    assert unfair.alternative.structure.startswith("every order 1")
    assert spring.cost > 3 * dashpot_alone.cost  # a spring damps nothing


@pytest.mark.broad
@pytest.mark.parametrize("seed", range(3))
def test_a_dashpot_is_not_called_fractional_however_its_order_is_written(seed):
    fit = identify(sought(mount(**R_IS_0), struck(mount(dashpot), seed, noise=1e-2)))
    assert fit.alternative is None or "r = 0 the same model explains" in fit.alternative.warning
    verdict = fit.orders["r"].identifiable
    assert fit.alternative is None or verdict == "not distinguishable from 0 with these recordings"


def test_by_chance_off_0_is_said_of_0():
    problem = sought(mount(**R_IS_0), struck(mount(dashpot), noise=1e-2))
    rival = integer_rival(problem, best := problem.evaluate(np.array([0.01, 0.6, 40.0])), {"r": 1e-3})
    assert [*rival.off] == ["r"]
    said = warning(rival, problem, best)
    assert "r = 0.01: no evidence of fractional dynamics. With r = 0 the same model explains" in said


def test_an_order_without_an_integer_value_stays_free_and_alone_has_no_rival():
    data = swing((0.9, 0.95), end=2.0)
    arm_only, neither = (replace(RIG, integer_orders=dict.fromkeys(names)) for names in (["lambda"], [*BOTH]))
    problem = Problem(arm_only, (data,), BOTH, initial_state="held")
    rival = integer_rival(problem, problem.evaluate(np.array([0.9, 0.95])), {})
    assert [*rival.off] == ["mu"]
    assert rival.structure.startswith("mu = 1 (lambda free, for its model gives it no integer value)")
    problem = Problem(neither, (data,), BOTH, initial_state="held")
    assert integer_rival(problem, problem.evaluate(np.array([0.9, 0.95])), {}) is None


def test_what_is_fixed_stays_and_what_is_tied_has_its_own_integer():
    model = replace(RIG, integer_orders={"mu": 0})
    problem = Problem(model, (swing(end=1.0),), {"lambda": BOTH["lambda"], "mu": Tied("lambda")})
    assert integer_values(problem) == {"lambda": 1.0, "mu": 1e-9}
    fixed = replace(problem, orders={"lambda": 0.9, "mu": Tied("lambda")})
    assert integer_values(fixed) == fixed.orders


@pytest.mark.broad
def test_the_result_file_says_what_each_order_is_in_the_integer_order_model():
    told = identify(sought(mount(**R_IS_0), struck(mount(), r=0.4))).to_json()["orders"]
    assert {n: order["integer"] for n, order in told.items()} == {"v": 1.0, "r": 0.0}
