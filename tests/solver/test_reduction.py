"""Multi-term equations and linear systems: the reduction is exact, and what the solver makes of it converges."""

import math
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

from fracid import InputError, linear_multi_term, linear_system, multi_term, solve_fde
from fracid.solver.right_hand_side import compile_rhs
from fracid.solver.trajectory import Outcome
from oracles.mittag_leffler import mittag_leffler
from oracles.problems import (
    LINEAR,
    MULTI_TERM,
    STIFF,
    SWIRL,
    T6,
    T14,
    T18,
    caputo,
    free,
    sum_of_powers,
    value,
)  # fmt: skip

by_name = {"ids": lambda v: getattr(v, "name", str(v))}
FORMS = ("chain", "star")
SMOOTH = [p for p in MULTI_TERM if not p.name.startswith("free") and p.name != "thirds"]


def system(problem, form):
    if problem.coefficients:
        return linear_multi_term(problem.coefficients, sum_of_powers, initial=problem.initial,
                                 parameters=problem.forcing, form=form)  # fmt: skip
    return directly(problem, form)


def directly(problem, form):
    return multi_term(problem.g, problem.orders, problem.initial, parameters=problem.parameters, form=form)


def error(problem, step, form="chain", **options):
    """Largest error over all states, each a known derivative, at the known times."""
    s = system(problem, form)
    run = s.solve(step=step, end=max(problem.times), **options)
    assert run.completed
    return max(
        abs(run.states[round(t / step), i] - problem.exact(a, t)) for t in problem.times for a, i in s.column.items()
    )


def known_error(problem, step, **options):
    run = solve_fde(problem.rhs, problem.orders, problem.initial, step=step, end=max(problem.solution),
                    parameters=problem.parameters, **options)  # fmt: skip
    assert run.completed
    return max(np.abs(run.states[round(t / step)][: len(x)] - x).max() for t, x in problem.solution.items())


# --- the reduction, without a solver ------------------------------------------------------------------

STRUCTURES = [(0, 1.5, 2), (0, 0.5, 1), (0, 0.5, 1.8), (1.2, 2.5), (0, 2.5), (0, 0.4, 3.3, 4), (1.5,), (3,), (0, 1, 2),
              (0.3, 1.4, 2), (0, 0.5, 0.7, 2.2, 3), (0.2, 0.4, 0.6), (0.5, 5.5), (1, 1.9999, 2.0001)]  # fmt: skip


def _first_parameter(t, d, u, p):
    return p[0]


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("orders", STRUCTURES, ids=str)
def test_every_state_composes_with_its_driver_for_all_powers_of_time(orders, form):
    # y = t^r has D^a y in closed form; the Caputo derivative of that, of the state's order, must be its right-hand side
    t, a_m = 0.7, orders[-1]
    for r in (0, 1, 2, 3, 4, 5, 6.5):
        y = ((1.0, float(r)),)
        initial = [value(caputo(y, k), 0.0) for k in range(math.ceil(a_m))]
        s = multi_term(_first_parameter, orders, initial, parameters=[value(caputo(y, a_m), t)], form=form)
        x, out = np.array([value(caputo(y, a), t) for a in s.column]), np.empty(len(s.column))
        s.rhs(t, x, np.empty(0), s.parameters, out)
        states = [caputo(y, a) for a in s.column]
        np.testing.assert_allclose(
            out, [value(caputo(state, q), t) for state, q in zip(states, s.orders, strict=True)], atol=1e-9
        )
        assert s.initial[:, 0].tolist() == pytest.approx([value(state, 0.0) for state in states])
        slopes = [value(caputo(state, 1.0), 0.0) if q > 1 else 0.0 for state, q in zip(states, s.orders, strict=True)]
        assert s.initial[:, 1].tolist() == pytest.approx(slopes)
        assert all(0 < q < 2 for q in s.orders)


@pytest.mark.parametrize(
    ("n", "step", "r"), [(0.8, 0.7, 1.0), (0.5, 1.0, 1.0), (1.5, 0.6, 2.0)], ids=["over 1", "over 1, by 1", "over 2"]
)
def test_derivatives_do_not_compose_across_a_whole_number(n, step, r):
    y = ((1.0, r),)
    assert value(caputo(y, n + step), 0.7) == 0
    assert abs(value(caputo(caputo(y, n), step), 0.7)) > 0.1


@pytest.mark.broad
def test_a_chain_that_steps_over_a_whole_number_forgets_the_speed_there():
    # D^1.5 y = 0 from y(0) = 0, y'(0) = 1 is y = t; D^.8 z = D^.7 y stays where it is
    def naive(t, x, u, p, out):
        out[0] = x[1]
        out[1] = 0.0

    def zero(t, d, u, p):
        return 0.0 * d[1]

    assert solve_fde(naive, [0.8, 0.7], [0.0, 0.0], step=0.01, end=1.0).states[-1, 0] == 0
    for form in FORMS:
        s = multi_term(zero, (0, 0.8, 1.5), [0.0, 1.0], form=form)
        run = s.solve(step=0.01, end=1.0)
        assert run.states[-1] == pytest.approx([1, 1 / math.gamma(1.2), 1], rel=5e-3)
        assert list(s.column) == [0, 0.8, 1]


@pytest.mark.parametrize("form", FORMS)
def test_the_function_reads_the_derivatives_in_the_order_that_was_asked(form):
    def sees(t, d, u, p):
        return 10000 * d[0] + 100 * d[1] + d[2] + 0 * len(d)

    s = multi_term(sees, (0.5, 1, 2.2, 3), [0.0, 0.0, 0.0], form=form)
    x, out = np.zeros(len(s.column)), np.empty(len(s.column))
    x[s.column[0.5]], x[s.column[1]], x[s.column[2.2]] = 1, 2, 3
    s.rhs(0.0, x, np.empty(0), s.parameters, out)
    assert out[-1] == 10203


@pytest.mark.parametrize(
    ("orders", "form", "states"),
    [((0, 1.8), "chain", {0: 1.8}), ((0, 1.8), "star", {0: 1.8}), ((1.5,), "chain", {0: 1.5}),
     ((0, 1.5, 2), "chain", {0: 1.5, 1.5: 0.5}), ((0, 1.5, 2), "star", {0: 1, 1: 1, 1.5: 0.5}),
     ((0, 0.6, 1.8), "chain", {0: 0.6, 0.6: 0.4, 1: 0.8}), ((0, 0.6, 1.8), "star", {0: 1.8, 0.6: 0.4, 1: 0.8}),
     ((0, 2.5), "chain", {0: 1, 1: 1.5}), ((0, 2.5), "star", {0: 1, 1: 1.5}),
     ((1.2, 2.5), "chain", {0: 1.2, 1.2: 0.8, 2: 0.5}), ((1.2, 2.5), "star", {0: 1, 1: 1.5, 1.2: 0.8, 2: 0.5})],
)  # fmt: skip
def test_there_are_no_more_states_than_composition_needs(orders, form, states):
    # and a star's whole derivatives are integrated from the highest one: from y' instead, t^0.8 would cost accuracy
    s = multi_term(_first_parameter, orders, [0.0] * math.ceil(orders[-1]), form=form)
    assert list(s.column) == list(states)
    assert s.orders == pytest.approx(list(states.values()))


# --- known solutions -------------------------------------------------------------------------------------


@pytest.mark.few(2)
@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("problem", MULTI_TERM, **by_name)
def test_pi2_converges_to_the_known_solution_in_all_derivatives(problem, form):
    # the chain integrates t^0.4 to t^0.5 where y^(l)(0) is not 0, which costs up to 0.6 of the two orders; and where
    # f is 0 there is no error that could fall, but what a corrected start may add
    coarse, fine = error(problem, 1 / 64, form), error(problem, 1 / 128, form)
    scale = max(abs(problem.exact(a, t)) for a in system(problem, form).column for t in problem.times)
    assert fine < 2e-3 * max(1.0, scale)
    assert fine < coarse / 2**1.3 or fine < 1e-7 * max(1.0, scale)


@pytest.mark.parametrize("problem", SMOOTH, **by_name)
def test_the_star_is_of_second_order_where_the_highest_derivative_is_smooth(problem):
    coarse, fine = error(problem, 1 / 64, "star"), error(problem, 1 / 128, "star")
    assert fine < coarse / 2**1.75 or fine < 1e-10


@pytest.mark.few(8)
@pytest.mark.parametrize("method", ["gl", "gl-sequential"])
@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("problem", [p for p in MULTI_TERM if "100" not in p.name and p is not T18], **by_name)
def test_grunwald_letnikov_schemes_are_of_first_order(problem, form, method):
    coarse, fine = (error(problem, 1 / n, form, method=method) for n in (128, 256))
    assert np.log2(coarse / fine) == pytest.approx(1.0, abs=0.15)


def test_the_chain_is_not_harmed_by_strong_fractional_damping():
    weak, strong = (free("", {2: 1.0, 1.5: c, 0: 1.0}, 0.5, (1.0, 0.0), (2.0, 5.0)) for c in (1.0, 1e4))
    assert error(strong, 1 / 32) < error(weak, 1 / 32)


@pytest.mark.parametrize("form", FORMS)
def test_bagley_and_torvik_s_plate_is_exact_for_a_linear_solution(form):
    assert error(T18, 1 / 16, form) < 1e-12


@pytest.mark.parametrize("problem", LINEAR, **by_name)
def test_a_linear_system_is_the_matrix_mittag_leffler_function(problem):
    size = len(problem.initial)
    s = linear_system(np.reshape(problem.parameters, (size, size)), orders=problem.orders, initial=problem.initial)
    run = s.solve(step=problem.step / 4, end=max(problem.solution))
    for t, x in problem.solution.items():
        np.testing.assert_allclose(run.states[round(4 * t / problem.step)], x, atol=5e-6)


@pytest.mark.broad
def test_t6_and_t14_converge_as_they_should():
    ratios = [known_error(T6, T6.step / k) for k in (2, 4)]
    assert np.log2(ratios[0] / ratios[1]) == pytest.approx(2.0, abs=0.05)
    far = [known_error(T14, T14.step / k) for k in (1, 8)]  # not Lipschitz: 1.26 per halving, in jumps
    assert np.log2(far[0] / far[1]) / 3 > 1.1


@pytest.mark.few(1)
@pytest.mark.parametrize("problem", STIFF, **by_name)
def test_pi2_solves_stiff_problems_at_steps_far_above_their_time_constants(problem):
    coarse, fine = (known_error(problem, problem.step / k) for k in (2, 4))
    assert fine < 2e-5
    assert coarse / fine > 2**1.6


# --- equivalences ------------------------------------------------------------------------------------------


@pytest.mark.few(1)
@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(
    "problem", [p for p in MULTI_TERM if p.name.startswith(("plate", "order", "free B"))], **by_name
)
def test_a_linear_equation_is_the_same_through_either_function(problem, form):
    ours, theirs = (make(problem, form).solve(step=1 / 32, end=1.0).states for make in (system, directly))
    np.testing.assert_allclose(ours, theirs, atol=1e-9 * np.abs(theirs).max())


def _sine(t, u, p):
    return p[0] * np.sin(3 * t)


def test_a_sampled_forcing_acts_as_the_same_function_does():
    plate = {2: 2.0, 1.5: 0.5, 0: 8.0}
    time = np.linspace(0, 4, 401)
    sampled = linear_multi_term(plate, "input", initial=[0.1, 0.0])
    analytic = linear_multi_term(plate, _sine, initial=[0.1, 0.0], parameters=[5.0])
    np.testing.assert_allclose(sampled.solve(step=0.01, end=4.0, inputs=5 * np.sin(3 * time)).states,
                               analytic.solve(step=0.01, end=4.0).states, atol=1e-11)  # fmt: skip


def test_inputs_of_a_linear_system_enter_through_b():
    time = np.linspace(0, 4, 401)
    u = np.column_stack([np.sin(time), np.cos(2 * time)])
    B = np.array([[0.0, 1.0], [2.0, 0.0], [0.5, -1.0]])

    def driven(t, x, u, p, out):
        for i in range(3):
            out[i] = p[3 * i] * x[0] + p[3 * i + 1] * x[1] + p[3 * i + 2] * x[2]
        out[0] += u[1]
        out[1] += 2 * u[0]
        out[2] += 0.5 * u[0] - u[1]

    ours = linear_system(SWIRL, B, orders=[0.7, 0.8, 0.9], initial=[1, 0, 0]).solve(step=0.01, end=4.0, inputs=u)
    theirs = solve_fde(driven, [0.7, 0.8, 0.9], [1, 0, 0], step=0.01, end=4.0, inputs=u, parameters=np.ravel(SWIRL))
    np.testing.assert_allclose(ours.states, theirs.states, atol=1e-12)


def test_a_named_derivative_with_coefficient_zero_is_a_state_and_changes_nothing_else():
    few = linear_multi_term({2: 1.0, 1.5: 0.3, 0: 4.0}, initial=[1.0, 0.0])
    more = linear_multi_term({2: 1.0, 1.5: 0.3, 1: 0.0, 0: 4.0}, initial=[1.0, 0.0])
    assert [list(s.column) for s in (few, more)] == [[0, 1.5], [0, 1, 1.5]]
    a, b = (s.solve(step=1e-3, end=2.0).states[-1, s.column[0]] for s in (few, more))
    assert a == pytest.approx(b, abs=1e-4)


def test_an_equation_of_whole_orders_is_the_ordinary_one():
    s = linear_multi_term({2: 1.0, 1: 0.4, 0: 4.04}, initial=[1.0, -0.2])  # e^(−t/5) cos 2t
    run = s.solve(step=1e-3, end=3.0)
    assert run.states[-1, s.column[0]] == pytest.approx(math.exp(-0.6) * math.cos(6), abs=2e-6)


def test_orders_a_rounding_away_from_a_whole_number_are_that_number():
    s = linear_multi_term({0.1 * 3 / 0.3: 1.0, 1e-12: 1.0}, initial=[1.0])
    assert 0.1 * 3 / 0.3 != 1.0
    assert s.orders.tolist() == [1.0]
    assert dict(s.column) == {0: 0}
    assert multi_term(_first_parameter, (0, 2 + 1e-13), [0, 1]).orders.tolist() == [1.0, 1.0]


# --- compiled once ------------------------------------------------------------------------------------------


def test_equations_that_differ_in_numbers_only_share_one_compiled_function():
    assert (
        linear_multi_term({2: 1, 0: 1}, initial=[0, 0]).rhs is linear_multi_term({1.5: 3, 0.5: 1}, initial=[1, 0]).rhs
    )
    assert linear_system(np.eye(2), orders=0.5, initial=[1, 1]).rhs is linear_multi_term({1: 2}, initial=[0]).rhs
    first, second = (linear_multi_term({a: 1, 0: 1}, _sine, initial=[0, 0], parameters=[1]).rhs for a in (1.5, 2))
    assert first is second
    pair = [multi_term(_first_parameter, (0, 1.5, a), [0, b], parameters=[b]).rhs for a, b in ((2, 1), (1.9, 3))]
    assert pair[0] is pair[1]
    assert compile_rhs(pair[0]) is compile_rhs(pair[1])


def test_what_calls_a_callers_function_is_not_kept_on_disk():
    # Numba's cache does not notice that the function called has changed
    assert compile_rhs(multi_term(_first_parameter, (0, 1.5, 2), [0, 0]).rhs).stats.cache_path is None
    assert compile_rhs(linear_multi_term({1: 1}, _sine, initial=[0]).rhs).stats.cache_path is None
    assert compile_rhs(linear_multi_term({1: 1}, initial=[0]).rhs).stats.cache_path is not None


def test_functions_of_one_name_are_told_apart():
    def make(gain):
        def g(t, d, u, p):
            return gain * d[0]

        return g

    ends = [multi_term(make(k), (0, 0.8), [1.0]).solve(step=0.01, end=1.0).states[-1, 0] for k in (-1.0, -2.0)]
    exact = [mittag_leffler(0.8, -k) for k in (1.0, 2.0)]
    np.testing.assert_allclose(ends, exact, atol=1e-3)


def test_a_division_by_zero_in_the_callers_function_is_an_outcome():
    def pole(t, d, u, p):
        return 1 / (0.5 - t) if t < 0.5 else d[0] / 0.0 if t < 0.0 else 1 / (t - t)

    run = multi_term(pole, (0, 1.5), [0.0, 0.0]).solve(step=0.1, end=1.0)
    assert run.outcome is Outcome.NOT_FINITE


# --- callers' mistakes -----------------------------------------------------------------------------------------


def _wrong_arity(t, x):
    return 0.0


def _returns_nothing(t, d, u, p):
    d[0]


def _too_far(t, d, u, p):
    return d[2]


def _reads_input(t, u, p):
    return u[0]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: multi_term(_first_parameter, (0, -0.5, 2), [0, 0]), "-0.5 is negative; expected 0"),
        (lambda: multi_term(_first_parameter, (0, 1.5, 1.5, 2), [0, 0]), "1.5 is there twice"),
        (lambda: multi_term(_first_parameter, (0, 0.3, 0.1 + 0.2), [0]), "0.3 is there twice"),
        (lambda: multi_term(_first_parameter, (2, 1.5, 0), [0, 0]), r"increasing.*type orders=\(0, 1.5, 2\)"),
        (lambda: multi_term(_first_parameter, (0,), []), r"the highest is 0.*such as orders=\(0, 1.5\)"),
        (lambda: multi_term(_first_parameter, (), [0]), r"such as orders=\(0, 1.5, 2\)"),
        (lambda: multi_term(_first_parameter, (0, float("nan")), [0]), "orders.*finite"),
        (lambda: multi_term(_first_parameter, (0, "two"), [0]), "orders.*expected numbers"),
        (lambda: multi_term(_first_parameter, (0, 1.5), [0]), r"order 1.5 starts from 2 values: y\(0\), y'\(0\)"),
        (lambda: multi_term(_first_parameter, (0, 0.5), [0, 1]), r"order 0.5 starts from 1 value: y\(0\)\."),
        (lambda: multi_term(_first_parameter, (0, 4), [0]), r"y''\(0\), y\^\(3\)\(0\)"),
        (lambda: multi_term(_first_parameter, (0, 1.5), [0, float("inf")]), "initial.*finite"),
        (lambda: multi_term(_first_parameter, (0, 1.5), [0, 0], form="tree"), "no form 'tree'; type 'chain' or 'star'"),
        (lambda: multi_term(_first_parameter, (0, 1.5), [0, 0], parameters=["k"]), "parameters.*numbers"),
        (lambda: multi_term(_wrong_arity, (0, 1), [0]), r"_wrong_arity, takes \(t, x\); it must take \(t, d, u, p\)"),
        (lambda: multi_term(3, (0, 1), [0]), r"g = 3; expected a function \(t, d, u, p\)"),
        (lambda: multi_term(_returns_nothing, (0, 1), [0]).solve(step=0.1, end=1), "_returns_nothing fails"),
        (lambda: multi_term(_too_far, (0, 1, 2), [0, 0]).solve(step=0.1, end=1), "_too_far does not fit"),
        (lambda: linear_multi_term({2: 0.0, 1: 1.0}, initial=[0, 0]), "highest order, 2, is 0.*leave that term out"),
        (lambda: linear_multi_term({-1: 1.0, 1: 1.0}, initial=[0]), "-1 is negative"),
        (lambda: linear_multi_term({}, initial=[0]), "expected a mapping from order to coefficient"),
        (lambda: linear_multi_term([1, 2], initial=[0]), "expected a mapping"),
        (lambda: linear_multi_term({0: 1.0}, initial=[0]), "the highest is 0"),
        (lambda: linear_multi_term({1: float("nan")}, initial=[0]), "coefficients.*finite"),
        (lambda: linear_multi_term({1: 1}, 2.0, initial=[0]), r"forcing = 2.0; expected None, a function \(t, u, p\)"),
        (lambda: linear_multi_term({1: 1.0}, _wrong_arity, initial=[0]), r"must take \(t, u, p\)"),
        (lambda: linear_multi_term({1: 1.0}, "input", initial=[0]).solve(step=0.1, end=1), "u has 0"),
        (lambda: linear_multi_term({1: 1.0}, _reads_input, initial=[0]).solve(step=0.1, end=1), "u has 0"),
        (lambda: linear_system([[1, 2]], orders=1, initial=[0]), r"A has the shape \(1, 2\); expected a square matrix"),
        (lambda: linear_system([[1]], [[1], [2]], orders=1, initial=[0]), r"B has the shape \(2, 1\); expected \(1, "),
        (lambda: linear_system([["x"]], orders=1, initial=[0]), "A = .*numbers"),
        (lambda: linear_system(np.eye(2), orders=1, initial=[0]).solve(step=0.1, end=1), "does not fit"),
    ],
)  # fmt: skip
def test_a_wrong_call_is_told_in_our_words(call, message):
    with pytest.raises(InputError, match=message):
        call()


# --- the example -------------------------------------------------------------------------------------------


@pytest.mark.broad
def test_the_example_prints_errors_that_fall_and_draws_its_figure(tmp_path, monkeypatch, capsys):
    script, figure = Path(__file__).parents[2] / "examples" / "bagley_torvik.py", tmp_path / "plate.png"
    monkeypatch.setattr(sys, "argv", [str(script), str(figure)])
    runpy.run_path(str(script), run_name="__main__")
    rows = [line.split() for line in capsys.readouterr().out.splitlines()[1:-1]]
    assert [row[0] for row in rows] == ["chain"] * 4 + ["star"] * 4
    assert all(float(row[-1]) > 1.3 and float(row[-2]) < 2e-3 for row in rows)
    assert figure.stat().st_size > 10_000
