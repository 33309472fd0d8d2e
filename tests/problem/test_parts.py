"""Each part of a problem on its own: x to values, values to a run, errors to a cost."""

import math
from dataclasses import replace

import numpy as np
import pytest

import fracid
from fracid.errors import InputError
from fracid.estimation.records import fit_of
from fracid.problem import Experiment, Free, Prior, Problem, Tied

RIG = fracid.rotary_pendulum("srv02-rotpen")
STEP = 4e-3


def still(name, **options):
    return Experiment(name, STEP, np.tile([0.1, 0.3], (50, 1)), np.zeros((1, 1)), **options)


def problem(*experiments, **options):
    orders = {"lambda": Free(0.9, 0.5, 1.2), "mu": Tied("lambda")}
    constants = {"theta_rest": Free(0.0, -1.0, 1.0), "C1": Free(4e-3, 1e-3, 1e-2)}
    return Problem(RIG, experiments, orders, constants, ("theta_rest",), initial_state="rest", **options)


def test_every_unknown_comes_back_from_the_values_that_the_parametrisation_unpacks():
    parametrisation = problem(still("a"), still("b", release_time=Free(0.0, -0.02, 0.02)))
    x = np.linspace(parametrisation.space.lower, parametrisation.space.upper, 5)[1]
    back = dict.fromkeys(parametrisation.names)
    for e in parametrisation.experiments:
        values = parametrisation.unpack(x, e)
        named = {
            "order": dict(zip(RIG.orders, values.orders, strict=True)),
            "parameter": dict(zip(RIG.parameter_names, values.parameters, strict=True)),
            "initial": dict(zip(RIG.states, values.initial, strict=True)),
            "time": {"release_time": values.release},
        }
        back |= {u.name: named[u.kind][u.target] for u in parametrisation.unknowns if u.experiment in (None, e.name)}
        assert named["order"]["mu"] == named["order"]["lambda"]
    assert list(back.values()) == x.tolist()


def test_the_simulator_runs_what_simulate_does_to_the_bit():
    (e,) = (p := problem(still("a"), method="gl", substeps=2)).experiments
    orders, constants, initial, _ = p.unpack(p.start, e)
    run = fracid.simulate(
        RIG.with_parameters(**dict(zip(RIG.parameter_names, constants.tolist(), strict=True))),
        orders={"lambda": orders[0], "mu": orders[2]}, initial=dict(zip(RIG.states, initial.tolist(), strict=True)),
        step=STEP / 2, end=49 * STEP, method="gl", memory=p.memory,
    )  # fmt: skip
    assert np.array_equal(p.simulate(p.start, e).states, run.states)
    assert np.array_equal(p.fitted(p.start, e), run.states[::2, [0, 2]])


@pytest.mark.parametrize(("z", "cost"), [(0.0, 5.0), (2.0, 5.0 * np.sqrt(1 + 4 / 200))])
def test_the_criterion_is_the_root_mean_square_of_all_recordings_with_the_prior_on_top(z, cost):
    rest = Free(0.0, -1.0, 1.0, Prior(0.0, 0.1))
    p = Problem(RIG, (still("a"), still("b")), {"lambda": 0.9, "mu": 0.9}, {"theta_rest": rest}, initial_state="held")
    evaluation = p.criterion(np.array([0.1 * z]), [np.full((50, 2), 1.0), np.full((50, 2), 7.0)])
    assert evaluation.cost == pytest.approx(cost)
    assert np.sqrt(np.sum(evaluation.residuals**2) / 2) == pytest.approx(cost)


@pytest.mark.parametrize("step", [math.nan, math.inf, 0.0, -0.01, "0.01", None])
def test_a_step_that_no_clock_has_is_refused(step):
    with pytest.raises(InputError, match=r"a: step = .*expected a number"):
        Experiment("a", step, np.zeros((9, 1)), np.zeros((1, 1)))


@pytest.mark.parametrize("deviation", [0.1, [0.1, 0.2], np.zeros((9, 1)), np.full((9, 1), np.nan)])
def test_a_standard_deviation_is_above_0_and_of_each_sample(deviation):
    with pytest.raises(InputError, match=r"a: deviation = .*above 0 for each sample, shape \(9, 1\): numpy.full"):
        Experiment("a", 0.1, np.zeros((9, 1)), np.zeros((1, 1)), deviation=deviation)


def swing(t, x, u, p, out):
    out[0] = x[1]
    out[1] = u[0] + u[1] - p[0] * x[1] - p[1] * x[0]


CONSTANTS = fracid.Parameter("c", "1", 1, ""), fracid.Parameter("k", "1", 4, "")
SPRING = fracid.Model("spring", swing, ("x", "v"), (1.0, "mu"), {"x": 0}, ("f", "g"), CONSTANTS, "", "a test",
                      output_units={"x": "m"})  # fmt: skip
MEASURED, DRIVE = np.sin(0.1 * np.arange(50.0))[:, None], np.cos(0.1 * np.arange(50.0))


def sprung(inputs=np.zeros((50, 2)), model=SPRING, parameters={"k": Free(4, 1, 20)}, initial={}, **options):
    e = Experiment("a", 0.02, MEASURED, inputs, initial=initial)
    return Problem(model, (e,), **{"orders": {"mu": 1}, "parameters": parameters} | options)


@pytest.mark.parametrize("orders", [(1.0, "mu"), ("q", "mu"), ("mu", 1.0)])
def test_a_speed_is_found_at_the_start_whatever_its_own_order_is(orders):
    model = replace(SPRING, orders=orders)
    assert sprung(model=model, orders=dict.fromkeys(model.order_names, 1.0)).names == ("k", "x(0) [a]", "v(0) [a]")


@pytest.mark.parametrize(
    "lay", [np.asfortranarray, lambda u: np.broadcast_to(u, u.shape), lambda u: np.c_[u, u][:, :2]]
)
def test_whole_numbers_and_arrays_of_any_layout_are_simulated_as_any_other(lay):
    drive = np.column_stack([DRIVE, 2 * DRIVE])
    point = np.array([4.0, 0.0, 1.0])
    assert sprung(lay(drive)).cost(point) == sprung(drive, parameters={"k": Free(4.0, 1.0, 20.0)}).cost(point)


def unfinished(t, x, u, p, out):
    out[1] = u[0] + p[0]


@pytest.mark.parametrize(("wrong", "says"), [
    ({"inputs": np.zeros((40, 2))}, r"inputs has the shape \(40, 2\); expected 50 rows, or one for all"),
    ({"inputs": np.zeros(50)}, r"inputs has the shape \(50,\); expected 50 rows"),
    ({"inputs": None}, "a: inputs = None: expected an array of numbers"),
    ({"initial": {"y": 1.0}}, "unknown state in initial of a 'y'"),
    ({"initial": [1.0]}, "a: initial = .* expected a mapping of names"),
    ({"parameters": {"k": (4, 1, 20)}}, r"parameters k = \(4, 1, 20\): expected a number or fracid.Free"),
    ({"parameters": {"k": "c"}}, 'expected a number .* fracid.Tied'),
    ({"orders": [1.0]}, "orders = .*expected a mapping of names"),
    ({"cost_function": "huber"}, "cost_function = 'huber': expected a cost: fracid.problem.costs"),
    ({"memory": "full"}, "memory = 'full': expected a memory: fracid.solver.memory"),
    ({"initial_state": "zero"}, "unknown initial_state 'zero'"),
    ({"experiments": still("a")}, "experiments = .*expected a tuple"),
    ({"model": replace(SPRING, rhs=unfinished)}, r"leaves out\[0\] unwritten"),
])  # fmt: skip
def test_what_a_problem_cannot_be_made_of_is_refused_by_its_name(wrong, says):
    with pytest.raises(InputError, match=says):
        replace(sprung(), **wrong) if "experiments" in wrong else sprung(**wrong)


def test_an_experiment_without_units_has_the_models_and_its_cost_is_the_problems():
    twin = fracid.Recording.of("a", 0.02 * np.arange(50.0), {"x": MEASURED[:, 0]})
    p = sprung(weights="noise")
    assert p.experiments[0].units == Experiment.of(twin, SPRING, ["x"]).units == {"x": "m"}
    own = fit_of(p, p.start, "a", "fit", {}, {})
    assert own.unit("x") == "m"
    assert own.cost == p.cost(p.start)
