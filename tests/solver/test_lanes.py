"""Runs that step together in one loop are the runs one by one."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numba import njit

import fracid
from fracid.estimation.derivatives import jacobian
from fracid.estimation.horizons import Watch, refined
from fracid.models import MODELS
from fracid.problem import Experiment, Free, Problem
from fracid.problem import problem as of_problem
from fracid.solver import lanes, solve
from fracid.solver.arguments import Equation, InitialCondition, Options, Relaxations
from fracid.solver.history import inline
from fracid.solver.memory import compressed
from fracid.solver.right_hand_side import compile_rhs
from fracid.tasks.simulation_cache import Recent

RIG = fracid.rotary_pendulum("srv02-rotpen", zero="hanging")
SHARP = {"coulomb_theta": 0.03, "coulomb_alpha": 1e-3, "slip_speed": 1e-3}
"""So steep that Newton's method goes back in some of the runs, and half as far."""

PRESLIDING = {"coulomb_theta": 0.03, "stiction_theta": 0.05, "presliding_theta": 0.01}


def problem(parameters=None, orders=None, until=3.0, **more):
    still = Experiment("still", 0.002, np.zeros((round(until / 0.002) + 1, 2)), np.zeros((1, 1)),
                       initial={"theta": 0.1, "alpha": 1.0})  # fmt: skip
    free = {"b_theta": Free(0.01, 0.0, 1.0), "b_alpha": Free(1e-4, 0.0, 1.0), "C6": Free(4e-3, 1e-3, 2e-2)}
    orders = orders or {"lambda": Free(0.9, 0.5, 1.0), "mu": Free(0.95, 0.5, 1.0)}
    return Problem(RIG, (still,), orders, {**free, **(parameters or {})}, **more)


def scattered(x, count=8):
    return [x * (1 + 1e-3 * k * np.cos(np.arange(len(x)))) for k in range(count)]


@pytest.mark.parametrize(
    "parameters",
    [{"coulomb_theta": 0.01, "drag_alpha": 1e-4}, SHARP, PRESLIDING],
    ids=["sliding", "sharp", "presliding"],
)
@pytest.mark.parametrize("count", [4, 8, 13])
def test_runs_together_are_the_runs_one_by_one(parameters, count, monkeypatch):
    p = problem(parameters)
    e, points = p.experiments[0], scattered(p.start, count)
    stepped = []
    run_together = lanes.run_together
    monkeypatch.setattr(lanes, "run_together", lambda *a: stepped.append(run_together(*a)) or stepped[-1])
    together = p.simulator.trajectories(points, e, range(count)).values()
    assert stepped
    assert all(states is not None for states in stepped)
    for run, x in zip(together, points, strict=True):
        alone = p.simulate(x, e)
        assert abs(run.states - alone.states).max() < 1e-11
        assert run.outcome is alone.outcome
        assert np.array_equal(run.time, alone.time)


def test_a_jacobian_does_not_depend_on_how_its_runs_go_nor_on_threads(monkeypatch):
    monkeypatch.setattr(of_problem, "WORTH", 1000)
    p, free = problem(), np.arange(5)
    (J,) = jacobian(p, p.start, free)
    (threaded,) = jacobian(p, p.start, free, jobs=2)
    assert np.array_equal(J, threaded)
    monkeypatch.setattr(of_problem, "WORTH", 1e9)
    (alone,) = jacobian(replace(p, together=False), p.start, free)
    assert abs(J - alone).max() < 1e-6 * abs(alone).max()


def test_runs_that_part_or_end_early_go_one_by_one(monkeypatch):
    p = problem({"stiction_theta": Free(0.0, 0.0, 1.0), "coulomb_theta": 0.01})
    e = p.experiments[0]
    points = scattered(p.start)
    points[3][p.names.index("stiction_theta")] = 0.02  # the others have none, and its curve is not asked for
    kept = [p.simulate(x, e) for x in points]
    together = p.simulator.trajectories(points, e, range(8)).values()
    assert all(np.array_equal(a.states, b.states) for a, b in zip(kept, together, strict=True))
    points[3][p.names.index("C6")] = 1e3  # det M
    ends = [run.outcome for run in p.simulator.trajectories(points, e, range(8)).values()]
    assert ends == [p.simulate(x, e).outcome for x in points]


def test_what_lanes_have_not_and_what_is_a_users_own_goes_alone():
    def own(t, x, u, p, out):
        out[0] = math.atan(x[0])

    assert lanes.for_lanes(own) is None
    own.__module__ = "fracid.models.pendulum"
    assert lanes.for_lanes(own) is None
    assert lanes.for_lanes(RIG.rhs.py_func) is not None
    assert not solve.go_together(compile_rhs(RIG.rhs), "gl")


def test_numbers_in_lanes_are_those_of_the_systems_library():
    rng = np.random.default_rng(1)
    values = np.concatenate([
        rng.normal(0, 1, 400), rng.normal(0, 30, 400), rng.normal(0, 1e4, 200), 10.0 ** rng.uniform(-300, 2.7, 200),
        -(10.0 ** rng.uniform(-12, 2, 200)), [0.0, -0.0, 1e6, -1e9, 0.625, 709.5, -708.5, -1e4, 1e4, math.pi / 2],
    ])  # fmt: skip
    for function in (math.sin, math.cos, math.exp, math.tanh):

        @inline
        def each(x, out, function=function):
            for i in range(len(x)):
                out[i] = function(x[i])

        many = np.resize(values, (-(-len(values) // lanes.COUNT), lanes.COUNT))
        found = np.zeros_like(many)
        _in_lanes(each)(many, found)
        with np.errstate(over="ignore"):
            expected = {math.sin: np.sin, math.cos: np.cos, math.exp: np.exp, math.tanh: np.tanh}[function](many)
        assert np.allclose(found, expected, rtol=4e-16, atol=2e-16 if function in (math.sin, math.cos) else 1e-307)
        assert np.array_equal(np.signbit(found[expected != 0]), np.signbit(expected[expected != 0]))


def _in_lanes(each):
    as_lanes = lanes._together

    @njit(_nrt=False)
    def run(x, out):
        each(as_lanes(x), as_lanes(out))

    return run


@pytest.mark.parametrize("name", sorted(set(MODELS) - {"rotary-pendulum"}))
def test_every_model_of_the_library_goes_together(name, monkeypatch):
    model, t = fracid.model(name), 1e-2 * np.arange(501)
    driven = np.column_stack([1 + np.sin((1 + i) * t) for i in range(len(model.inputs))])
    e, stepped = Experiment("e", 1e-2, np.zeros((501, len(model.outputs))), driven), []
    free = {p.name: Free(p.value, 0.5 * p.value, 2 * p.value) for p in model.parameters if 0 < 2 * p.value < p.upper}
    p = Problem(model, (e,), dict.fromkeys(model.order_names, 0.95), free, initial_state="held")
    points, run_together = scattered(p.start), lanes.run_together
    monkeypatch.setattr(lanes, "run_together", lambda *a: stepped.append(run_together(*a)) or stepped[-1])
    together = p.simulator.trajectories(points, e, range(8))
    assert stepped
    assert all(states is not None for states in stepped)
    for k, x in enumerate(points):
        np.testing.assert_allclose(together[k].states, p.simulate(x, e).states, rtol=1e-9, atol=1e-12)


def test_orders_on_both_sides_of_1_go_in_one_loop(monkeypatch):
    p = problem(orders={"lambda": Free(0.95, 0.3, 1.2), "mu": Free(1.0, 0.5, 1.2)})
    e, stepped = p.experiments[0], []
    points = [p.start + np.eye(len(p.start))[0] * by for by in (-0.6, *np.linspace(-0.1, 0.15, 7))]
    run_together = lanes.run_together
    monkeypatch.setattr(lanes, "run_together", lambda *a: stepped.append(run_together(*a)) or stepped[-1])
    together = p.simulator.trajectories(points, e, range(8))
    assert len(stepped) == 8 // lanes.COUNT
    assert all(states is not None for states in stepped)
    assert all(abs(together[k].states - p.simulate(x, e).states).max() < 1e-11 for k, x in enumerate(points))


def test_finite_memories_go_together_where_some_hold_nothing_at_the_start():
    rhs, u, p = compile_rhs(RIG.rhs), np.zeros((1, 1)), RIG.parameter_vector(None)
    options = Options("pi2", compressed())
    posed = [
        (Equation(rhs, np.ones(4), u, p, fading=(Relaxations(3, (0.9, 0.3), (0.2,), (held,)),)),
         InitialCondition(np.array([0.0, 0.0, 1.0, 0.0])))
        for held in (0.0, 0.1, 0.2)
    ]  # fmt: skip
    together = solve.integrate_all(posed, 2e-3, 1000, options, wanted=range(3))
    for k, one in enumerate(posed):
        alone = solve.integrate(*one, 2e-3, 1000, options)
        np.testing.assert_allclose(together[k].states, alone.states, rtol=1e-10, atol=1e-12)


def test_what_a_resumed_fit_knows_already_changes_no_bit_of_the_rest(monkeypatch):
    monkeypatch.setattr(of_problem, "WORTH", 1000)
    p = problem()
    points = scattered(p.start)
    uncut = p.all_errors(points)
    p = replace(p, memo=Recent())
    alone = [p.errors(x)[0] for x in points[:7]]
    known = p.all_errors(points)
    assert np.array_equal(known[7][0], uncut[7][0])
    assert all(np.array_equal(k[0], a) for k, a in zip(known, alone, strict=False))


@pytest.mark.broad
def test_a_search_asks_for_points_of_long_recordings_together_and_finds_the_same(monkeypatch):
    p = problem(until=4.0)
    x = p.start * 1.01
    measured = p.fitted(x, p.experiments[0])
    p = replace(p, experiments=(replace(p.experiments[0], measured=measured),))
    assert p.abreast == 1
    alone = refined(p, p.start, Watch()).best.point
    asked = []
    run_together = lanes.run_together
    monkeypatch.setattr(lanes, "run_together", lambda *a: asked.append(len(a[1])) or run_together(*a))
    monkeypatch.setattr(of_problem, "WORTH", 1000)
    together = refined(replace(p, together=False), p.start, Watch()).best.point
    assert asked
    assert together == pytest.approx(alone, rel=1e-6)


def test_points_whose_errors_take_too_much_room_go_one_by_one(monkeypatch):
    monkeypatch.setattr(of_problem, "WORTH", 1000)
    assert problem().abreast == solve.RUNS
    monkeypatch.setattr(of_problem, "MOST", 1000)
    assert problem().abreast == 1
    assert problem(method="gl").abreast == 1
