"""The schemes converge at their order to known solutions, whatever the memory; wrong calls are told."""

import math
import warnings
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fracid.errors import InputError
from fracid.models import rotary_pendulum
from fracid.solver.arguments import StepWarning
from fracid.solver.memory import memory_from_name
from fracid.solver.methods import METHODS
from fracid.solver.solve import PaperSchemeWarning, simulate, solve_fde
from fracid.solver.trajectory import Outcome
from oracles.mittag_leffler import mittag_leffler
from oracles.problems import M2, PROBLEMS, T1, T8, T11, T19, T20, T27, T33, FractionalProblem, m1, t2, t4

by_name = {"ids": lambda v: v.name if hasattr(v, "name") else str(v)}
SCHEMES = ("pi2", "pi2-implicit", "bdf2", "pi3", "gl", "gl-sequential")
SECOND_ORDER = ("pi2", "pi2-implicit", "bdf2")
OF_F = (*SECOND_ORDER, "pi3")


def run(problem, step, **options):
    return solve_fde(problem.rhs, problem.orders, problem.initial, step=step, end=max(problem.solution),
                     parameters=problem.parameters, **options)  # fmt: skip


def errors(problem, step, **options):
    """Largest error over the known states at each known time."""
    trajectory = run(problem, step, **options)
    assert trajectory.completed
    return np.array(
        [np.nanmax(np.abs(trajectory.states[round(t / step)][: len(x)] - x)) for t, x in problem.solution.items()]
    )


def scale(problem):
    return np.nanmax(np.abs(list(problem.solution.values())))


def relaxation(q):
    """D^q y = −y, y(0) = 1."""
    solution = {t: (float(mittag_leffler(q, -(t**q))),) for t in (1.0, 10.0)}
    return FractionalProblem(f"relaxation of order {q}", T1.rhs, (q,), (1.0,), solution, step=1 / 16)


# --- accuracy --------------------------------------------------------------------------------------


@pytest.mark.few(4)
@pytest.mark.parametrize("method", OF_F)
@pytest.mark.parametrize("problem", PROBLEMS, **by_name)
def test_pi2_reaches_the_known_solution(problem, method):
    constant = 4 if method == "bdf2" else 1  # of h²: 1/3 at order 1, where the trapezoidal rule has 1/12
    assert np.all(errors(problem, problem.step / 8, method=method) < constant * 1e-5 * max(1.0, scale(problem)))


@pytest.mark.few(8)
@pytest.mark.parametrize("method", SECOND_ORDER)
@pytest.mark.parametrize(
    ("problem", "plain"),
    [(t2(0.9), 2), (t2(1.5), 2), (t4((0.8, 0.7, 0.9)), 2), (T8, 2), (T20, 2), (T27, 2), (m1(0.0417), 2),
     (T1, 1.8), (relaxation(0.1), 1.1), (relaxation(0.3), 1.3), (relaxation(0.6), 1.6), (T11, 1.6),
     (t4((1.5, 1.2)), 1.5)],
    **by_name,
)  # fmt: skip
def test_pi2_converges_at_order_two_once_the_start_is_corrected(problem, plain, method):
    # Uncorrected, f = f_0 + c t^σ costs 1 + σ orders: σ = q for T1, 0.6 for T11, 0.5 for T4 of order 1.5.
    coarse, fine = (errors(problem, problem.step / k, method=method, corrected=False)[-1] for k in (4, 8))
    assert np.log2(coarse / fine) == pytest.approx(plain, abs=0.12)
    corrected_coarse, corrected = (errors(problem, problem.step / k, method=method)[-1] for k in (4, 8))
    if plain == 2:
        assert np.log2(corrected_coarse / corrected) == pytest.approx(2, abs=0.1)
    else:  # order 2, or an error so small that rounding and memory hide it
        assert np.log2(corrected_coarse / corrected) > 1.9 or corrected < fine / 300
        assert corrected < fine


@pytest.mark.few(6)
@pytest.mark.parametrize(
    "problem",
    [t2(0.9), t2(1.5), T8, T19, T20, T27, T33, m1(0.0), m1(0.0417), T1, T11, relaxation(0.3), relaxation(0.6)],
    **by_name,
)  # fmt: skip
def test_pi3_converges_at_order_three_where_pi2_does_at_two(problem):
    # or is so exact that the memory's tolerance, or the digits that are known, hide it
    coarse, fine = (errors(problem, problem.step / k, method="pi3")[-1] for k in (4, 8))
    second = errors(problem, problem.step / 8, method="pi2")[-1]
    hidden = 5e-9 * scale(problem)
    assert np.log2(coarse / fine) > 2.5 or fine < hidden
    assert fine < second / 5 or fine < hidden


def test_pi3_at_order_one_is_the_rule_of_adams_and_moulton_of_order_four():
    def oscillator(t, x, u, p, out):
        out[0], out[1] = x[1], -9 * x[0]

    coarse, fine = (
        np.abs(run.states[-1, 0] - np.cos(6.0))
        for step in (0.02, 0.01)
        for run in [solve_fde(oscillator, 1.0, [1.0, 0.0], step=step, end=2.0, method="pi3", corrections=3)]
    )
    assert np.log2(coarse / fine) == pytest.approx(4, abs=0.2)


@pytest.mark.few(16)
@pytest.mark.parametrize("method", ["gl", "gl-sequential"])
@pytest.mark.parametrize("problem", PROBLEMS, **by_name)
def test_grunwald_letnikov_schemes_converge_at_order_one(problem, method):
    coarse, fine = (errors(problem, problem.step / k, method=method).max() for k in (4, 8))
    assert np.log2(coarse / fine) == pytest.approx(1.0, abs=0.15)


def test_the_paper_scheme_is_gl_for_a_start_at_zero():
    problem = replace(t4((0.8, 0.7, 0.9)))
    paper, gl = (run(problem, 1e-2, method=method).states for method in ("gl-paper", "gl"))
    np.testing.assert_array_equal(paper, gl)


def test_the_paper_scheme_does_not_converge_for_a_start_that_is_not_zero():
    with pytest.warns(PaperSchemeWarning, match="raw x"):
        wrong = [errors(T1, step, method="gl-paper").max() for step in (1e-2, 1e-3)]
    assert min(wrong) > 0.05
    assert wrong[0] / wrong[1] < 1.5


def test_the_paper_scheme_drops_a_ten_degree_release_within_a_millisecond():
    with pytest.warns(PaperSchemeWarning):
        first = np.degrees(run(T33, 1e-3, method="gl-paper").states[1, 2])
    assert first == pytest.approx(10 * 0.9146, abs=1e-3)  # x¹ = −w_1 x⁰ = μ x⁰


def _oscillator(t, x, u, p, out):
    out[0] = x[1]
    out[1] = -p[0] * np.sin(x[0]) - p[1] * x[1]


@pytest.mark.few(2)
@pytest.mark.parametrize(("method", "tolerance"), [("pi2", 1e-5), ("pi3", 1e-9), ("gl", 5e-2), ("gl-sequential", 5e-3)])
def test_order_one_is_the_ordinary_differential_equation(method, tolerance):
    out = np.empty(2)

    def f(t, x):
        _oscillator(t, x, None, (9.81, 0.2), out)
        return out.copy()

    exact = solve_ivp(f, (0, 10), [1.0, 0.0], rtol=1e-12, atol=1e-12, method="DOP853", t_eval=[10.0]).y[:, -1]
    ours = solve_fde(_oscillator, 1.0, [1.0, 0.0], step=5e-4, end=10.0, parameters=[9.81, 0.2], method=method)
    np.testing.assert_allclose(ours.states[-1], exact, atol=tolerance)


def test_explicit_gl_feeds_energy_into_an_undamped_pendulum_and_the_sequential_scheme_does_not():
    def last_swing(method):
        x = solve_fde(_oscillator, 1.0, [0.1, 0.0], step=1e-3, end=20.0, parameters=[9.81, 0.0], method=method).states
        return np.abs(x[-2000:, 0]).max()

    assert last_swing("gl") > 0.109
    assert last_swing("gl-sequential") == pytest.approx(0.1, rel=2e-3)
    assert last_swing("pi2") == pytest.approx(0.1, rel=1e-3)


# --- memory ----------------------------------------------------------------------------------------


@pytest.mark.few(24)
@pytest.mark.parametrize("method", SCHEMES)
@pytest.mark.parametrize("problem", [T1, t2(0.25), t2(1.5), t4((1.5, 1.2)), T8, T19, T33, M2], **by_name)
def test_compressed_memory_gives_the_trajectory_of_full_memory(problem, method):
    step = problem.step / 2
    whole, kept = (run(problem, step, method=method, memory=memory).states for memory in ("full", "compressed"))
    np.testing.assert_allclose(kept, whole, atol=2e-9 * np.abs(whole).max())


@pytest.mark.few(8)
@pytest.mark.parametrize("method", SCHEMES)
@pytest.mark.parametrize("order", [0.001, 0.3, 0.99, 0.999, 1.0, 1.001, 1.5, 1.999])
def test_compressed_equals_full_for_every_order(method, order):
    initial = [1.0] if order <= 1 else [(1.0, 0.5)]

    def force(t, x, u, p, out):
        out[0] = np.cos(3 * t) - 0.5 * x[0]

    whole, kept = (
        solve_fde(force, order, initial, step=2e-3, end=10.0, method=method, memory=memory).states
        for memory in ("full", "compressed")
    )
    np.testing.assert_allclose(kept, whole, atol=2e-9 * np.abs(whole).max())


def test_a_looser_tolerance_costs_no_more_than_it_says():
    whole = run(T33, 1e-3, memory="full").states
    for tolerance in (1e-4, 1e-6, 1e-8):
        kept = run(T33, 1e-3, tolerance=tolerance).states
        assert np.abs(kept - whole).max() < 100 * tolerance * np.abs(whole).max()


def test_a_short_memory_as_long_as_the_run_is_the_full_memory():
    for method in SCHEMES:
        whole, cut = (run(T19, 1e-2, method=method, memory=memory).states for memory in ("full", "short(2000)"))
        np.testing.assert_array_equal(whole, cut)


@pytest.mark.parametrize("method", SCHEMES)
def test_a_longer_short_memory_is_nearer_to_the_full_one(method):
    whole = run(T19, 1e-2, method=method, memory="full").states
    off = [np.abs(run(T19, 1e-2, method=method, memory=f"short({n})").states - whole).max() for n in (20, 200, 1000)]
    assert off[0] > off[1] > off[2]


def _force(t, x, u, p, out):
    out[0] = np.cos(3 * t)


def history_by_hand(kernel, v, n):
    """The definition: w_1 … w_{n-1} for the samples after the first, and the start's own weight for that."""
    lags = np.arange(1, n)
    start = kernel.start[n] if n <= kernel.lags else 0.5 * kernel.weights[-1]  # short(L) of an integral
    return kernel.at(lags) @ v[n - lags] + start * v[0]


@pytest.mark.few(9)
@pytest.mark.parametrize("memory", ["full", "short(1)", "short(3)", "short(8)", "short(9)", "short(25)"])
@pytest.mark.parametrize("order", [0.6, 1.0, 1.4])
def test_the_integral_is_the_sum_that_the_memory_defines(memory, order):
    h, steps = 0.01, 300
    x = solve_fde(_force, order, [0.0], step=h, end=steps * h, memory=memory, corrected=False).states[:, 0]
    kernel = memory_from_name(memory).kernel("pi", order, steps)
    f = np.cos(3 * h * np.arange(steps + 1))
    by_hand = [h**order * (kernel.weights[0] * f[n] + history_by_hand(kernel, f, n)) for n in range(1, steps + 1)]
    np.testing.assert_allclose(x[1:], by_hand, rtol=1e-12, atol=1e-14)


@pytest.mark.few(6)
@pytest.mark.parametrize("method", SCHEMES)
@pytest.mark.parametrize("memory", ["full", "compressed"])
def test_a_run_is_the_beginning_of_any_longer_run(method, memory):
    end = 0.4  # 80 steps; compressed keeps the rest of its window whole up to 64
    longer = run(replace(T33, solution={end: ()}), 5e-3, method=method, memory=memory).states
    for steps in (1, 2, 7, 8, 9, 16, 17, 18, 25, 40):
        shorter = run(replace(T33, solution={steps * 5e-3: ()}), 5e-3, method=method, memory=memory).states
        np.testing.assert_allclose(shorter, longer[: steps + 1], rtol=1e-9, atol=1e-10)


# --- inputs, initial derivatives, threads -----------------------------------------------------------


def _driven(t, x, u, p, out):
    out[0] = u[0] - x[0]


@pytest.mark.few(1)
@pytest.mark.parametrize(("method", "tolerance"), [("pi2", 1e-6), ("gl", 5e-3), ("gl-sequential", 5e-3)])
def test_a_sampled_input_acts_as_the_same_function_of_time_does(method, tolerance):
    def itself(t, x, u, p, out):
        out[0] = np.sin(2 * t) - x[0]

    time = np.linspace(0, 5, 5001)
    sampled = solve_fde(_driven, 0.8, [0.0], step=1e-3, end=5.0, inputs=np.sin(2 * time), method=method)
    analytic = solve_fde(itself, 0.8, [0.0], step=1e-3, end=5.0, method=method)
    np.testing.assert_allclose(sampled.states, analytic.states, atol=1e-12)


def test_an_initial_derivative_carries_a_free_state_of_order_above_one():
    def free(t, x, u, p, out):
        out[0] = 0.0

    for method in METHODS:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PaperSchemeWarning)
            states = solve_fde(free, 1.5, [(0.0, 2.0)], step=0.01, end=3.0, method=method).states
        if method != "gl-paper":
            np.testing.assert_allclose(states[:, 0], 2 * np.linspace(0, 3, 301), atol=1e-12)


def test_runs_on_many_threads_are_the_runs_on_one():
    orders = np.linspace(0.6, 1.1, 12)

    def last(q):
        return solve_fde(T20.rhs, q, T20.initial, step=5e-3, end=5.0).states[-1]

    alone = [last(q) for q in orders]
    with ThreadPoolExecutor(4) as pool:
        np.testing.assert_array_equal(list(pool.map(last, orders)), alone)


# --- outcomes --------------------------------------------------------------------------------------


def _explodes(t, x, u, p, out):
    out[0] = x[0] ** 2


def _divides_by_zero(t, x, u, p, out):
    out[0] = 1 / (0.5 - x[1]) if t < 0.5 else 1 / (x[1] - x[1])
    out[1] = 0.0


@pytest.mark.few(3)
@pytest.mark.parametrize("method", SCHEMES)
def test_a_diverging_run_ends_with_its_finite_part_and_a_reason(method):
    trajectory = solve_fde(_explodes, 0.9, [2.0], step=1e-3, end=5.0, method=method, limit=1e6)
    assert trajectory.outcome in (Outcome.DIVERGED, Outcome.UNSETTLED)  # of the step over it there is no solution
    assert 1 < len(trajectory.time) == len(trajectory.states) < 5001
    assert np.all(np.isfinite(trajectory.states))


@pytest.mark.parametrize("method", SCHEMES)
def test_without_a_limit_an_overflow_still_ends_the_run(method):
    trajectory = solve_fde(_explodes, 0.9, [2.0], step=1e-3, end=5.0, method=method, limit=np.inf)
    assert not trajectory.completed
    assert np.all(np.isfinite(trajectory.states))


@pytest.mark.parametrize("method", SCHEMES)
def test_a_division_by_zero_ends_the_run_with_a_reason(method):
    trajectory = solve_fde(_divides_by_zero, 0.9, [0.0, 0.0], step=1e-2, end=1.0, method=method)
    assert trajectory.outcome is Outcome.NOT_FINITE
    assert trajectory.time[-1] == pytest.approx(0.5, abs=0.011)
    assert np.all(np.isfinite(trajectory.states))


def _half_written(t, x, u, p, out):
    out[0] = x[1]
    if x[0] > 0.0:
        out[1] = -4.0 * x[0]


@pytest.mark.parametrize("method", SCHEMES)
def test_a_branch_that_leaves_an_entry_of_out_unwritten_ends_the_run_with_a_reason(method):
    trajectory = solve_fde(_half_written, 1.0, [1.0, 0.0], step=1e-2, end=3.0, method=method)
    assert trajectory.time[-1] == pytest.approx(np.pi / 4, abs=0.02)
    newton = "Newton's method does not solve the equation of the step"
    said = newton if method == "pi2-implicit" else "a branch that leaves an entry of out unwritten"
    assert said in trajectory.fault.sentence


# --- callers' mistakes ------------------------------------------------------------------------------


def _returns(t, x, u, p, out):
    return -x


def _too_few(t, x):
    return None


def _out_of_range(t, x, u, p, out):
    out[0] = x[0]
    out[2] = x[0]


def _forgets(t, x, u, p, out):
    out[0] = -x[0]


def _not_numba(t, x, u, p, out):
    out[0] = eval("x[0]")


def _reads_input(t, x, u, p, out):
    out[0] = u[0]


GOOD = {"orders": 0.8, "initial": [1.0], "step": 0.1, "end": 1.0}


@pytest.mark.parametrize(
    ("rhs", "changed", "message"),
    [
        (_t := T1.rhs, {"orders": 0.0}, r"orders\[0\] = 0: an order must lie strictly between 0 and 2"),
        (_t, {"orders": 2.5}, r"orders\[0\] = 2.5"),
        (_t, {"orders": [0.8, 0.9]}, "initial has 1 state; give as many of both, or one order for all"),
        (_t, {"orders": float("nan")}, "finite"),
        (_t, {"orders": "high"}, "expected numbers"),
        (_t, {"initial": [float("nan")]}, "initial.*finite"),
        (
            _t,
            {"initial": [[1.0, 2.0]]},
            r"initial\[0, 1\] = 2, but a state of order 0.8 has no initial derivative",
        ),
        (_t, {"initial": [[1.0, 2.0, 3.0]]}, "shape"),
        (_t, {"step": -0.1}, "step = -0.1.*positive"),
        (_t, {"step": 0.0}, "positive"),
        (_t, {"end": -1.0}, "end = -1.0.*after the start, 0"),
        (_t, {"end": 0.25, "inputs": np.zeros(4)}, r"not a whole number of steps of 0.1.*type end=0.2 or end=0.3"),
        (_t, {"end": 0.25, "history": [[1.0]]}, r"not a whole number of steps of 0.1.*type end=0.2 or end=0.3"),
        (_t, {"start": 2.0}, "end = 1.0: the end must be .* after the start, 2"),
        (_t, {"start": float("inf")}, "start = inf"),
        (_t, {"every": 0}, "every = 0"),
        (_t, {"history": np.zeros((5, 2))}, r"history has the shape \(5, 2\); expected \(n_past, 1\)"),
        (_t, {"history": [float("nan")]}, "history.*finite"),
        (_t, {"times": [0.5, 0.2]}, "times must be .* ascending"),
        (_t, {"times": [0.5, 1.2]}, "times: 1.2 is not between start = 0 and end = 1"),
        (_t, {"bounds": [(2.0, 3.0)]}, r"bounds\[0\] = \(2, 3\): expected lowest < highest, and"),
        (_t, {"bounds": (2.0, 3.0)}, r"bounds has the shape \(2,\); expected \(1, 2\)"),
        (_t, {"bounds": "wide"}, "bounds = 'wide': expected pairs"),
        (_t, {"method": "euler"}, "no method 'euler'; type one of pi2, pi2-implicit, bdf2, pi3, gl"),
        (_t, {"memory": "none"}, "no memory"),
        (_t, {"corrections": 0}, "corrections"),
        (_t, {"inputs": np.zeros(7)}, r"inputs has the shape \(7, 1\); expected \(11, n_inputs\)"),
        (_t, {"parameters": ["a"]}, "parameters.*numbers"),
        (_returns, {}, "_returns returns a value.*out"),
        (_too_few, {}, r"_too_few takes \(t, x\); it must take \(t, x, u, p, out\)"),
        (_out_of_range, {}, "_out_of_range does not fit its arguments.*x and out have 1"),
        (_forgets, {"initial": [1.0, 2.0]}, r"_forgets leaves out\[1\] unwritten"),
        (_not_numba, {}, "_not_numba cannot be compiled by Numba"),
        (_reads_input, {}, "_reads_input does not fit its arguments.*u has 0"),
        (3, {}, "must be a function"),
    ],
)
def test_a_wrong_call_is_told_in_our_words(rhs, changed, message):
    arguments = GOOD | changed
    with pytest.raises(InputError, match=message):
        solve_fde(rhs, arguments.pop("orders"), arguments.pop("initial"), **arguments)


# --- steep friction --------------------------------------------------------------------------------


def _driven_block(t, x, u, p, out):
    """A block on a table: driven by a sine, dry friction of slope p[0]/0.02."""
    out[0] = x[1]
    out[1] = 30 * np.sin(3 * t) - p[0] * np.tanh(x[1] / 0.02)


def test_steep_friction_is_solved_at_steps_where_sweeps_alone_diverge():
    step, friction = 5e-3, 20.0  # step · slope = 5, sweeps contract below 2
    out = np.empty(2)

    def f(t, x):
        _driven_block(t, x, None, (friction,), out)
        return out.copy()

    time = np.arange(0, 4 + step / 2, step)
    exact = solve_ivp(f, (0, 4), [0.0, 0.0], method="Radau", rtol=1e-9, atol=1e-10, t_eval=time).y.T
    ours = solve_fde(_driven_block, 1.0, [0.0, 0.0], step=step, end=4.0, parameters=[friction]).states
    assert np.abs(ours[:, 0] - exact[:, 0]).max() < 2e-3 * np.abs(exact[:, 0]).max()
    assert np.abs(np.diff(ours[:, 1], 2)).max() < 0.5  # no ringing from step to step


@pytest.mark.parametrize("order", [0.85, 0.95, 1.05])
def test_steep_friction_at_fractional_orders_agrees_with_a_step_far_below_its_time_constant(order):
    initial = [(0.0, 0.0), (0.0, 0.0)]
    coarse, fine = (
        solve_fde(_driven_block, order, initial, step=step, end=4.0, parameters=[20.0]).states[:, 0]
        for step in (4e-3, 1.25e-4)
    )
    assert np.abs(coarse - fine[::32]).max() < 5e-3 * np.abs(fine).max()


def _wanders(t, x, u, p, out):
    out[int(10 * t)] = -x[0]


def _rarely(t, x, u, p, out):
    out[0] = -x[0] if t < 100 else p[7]


def _raises(t, x, u, p, out):
    if t > 0.5:
        raise ValueError("too late")
    out[0] = -x[0]


@pytest.mark.few(9)
@pytest.mark.parametrize("method", SCHEMES)
@pytest.mark.parametrize(
    ("rhs", "message"),
    [
        (_wanders, "_wanders fails on the way: IndexError.*x and out have 1 entries"),
        (_rarely, r"_rarely does not fit its arguments: it uses p\[7\]. Here .* p has 0"),
        (_raises, "_raises fails on the way: ValueError: too late"),
    ],
)
def test_a_right_hand_side_that_fails_later_is_told_too_and_does_not_crash(rhs, message, method):
    with pytest.raises(InputError, match=message):
        solve_fde(rhs, 0.8, [1.0], step=0.01, end=1.0, method=method)
    assert np.float64(5e-324) * np.float64(1.0) > 0, "denormal numbers are as they were"


def test_a_right_hand_side_may_have_no_module():
    def decay(t, x, u, p, out):
        out[0] = -x[0]

    decay.__module__ = None  # as one that exec made
    run = solve_fde(decay, 1.0, [1.0], step=0.01, end=1.0)
    assert run.at([1.0])[0, 0] == pytest.approx(math.exp(-1), abs=1e-4)


# --- stiff systems ---------------------------------------------------------------------------------


def _stiff(t, x, u, p, out):
    """Prothero's and Robinson's problem: y = 1 + t², whatever the stiffness p[0]; p[1] = Γ(3 − q)."""
    out[0] = -p[0] * (x[0] - 1 - t * t) + 2 / p[1] * t ** (2 - p[2])


@pytest.mark.few(6)
@pytest.mark.parametrize("stiffness", [1e2, 1e4, 1e6])
@pytest.mark.parametrize("order", [0.3, 0.6, 0.9, 1.0])
def test_the_implicit_method_solves_stiff_systems_at_any_step(order, stiffness):
    parameters = [stiffness, math.gamma(3 - order), order]
    off = [
        np.abs(run.states[:, 0] - 1 - run.time**2).max()
        for step in (1e-1, 1e-2, 1e-3)
        for run in [solve_fde(_stiff, order, [1.0], step=step, end=2.0, parameters=parameters, method="pi2-implicit")]
    ]
    assert off[0] < 1e-2 / stiffness
    assert off[1] < max(off[0] / 10, 1e-14)
    assert off[2] < max(off[1] / 10, 1e-14)


def test_the_implicit_method_relaxes_as_the_mittag_leffler_function_does():
    q, stiffness, step = 0.7, 1e4, 1e-3
    run = solve_fde(_decay, q, [1.0], step=step, end=1.0, parameters=[stiffness], method="pi2-implicit")
    late = run.time > 0.5  # the first instants, of 10⁻⁶ s, are far below the step
    exact = np.array([mittag_leffler(q, -stiffness * t**q) for t in run.time[late]])
    np.testing.assert_allclose(run.states[late, 0], exact, rtol=0.02)


def _decay(t, x, u, p, out):
    out[0] = -p[0] * x[0]


@pytest.mark.parametrize("problem", [T1, T19, T20, T27, T33, M2, t4((1.5, 1.2))], **by_name)
def test_implicit_and_explicit_steps_solve_the_same_equations(problem):
    implicit, explicit = (
        run(problem, problem.step / 4, method=m, corrections=6).states for m in ("pi2-implicit", "pi2")
    )
    np.testing.assert_allclose(implicit, explicit, atol=1e-7 * np.abs(explicit).max())


# --- where and when --------------------------------------------------------------------------------


def test_an_end_that_is_no_whole_number_of_steps_shortens_the_step_and_says_so():
    with pytest.warns(
        StepWarning, match="end = 1 is not a whole number of steps of 0.3; the step is shortened to 0.25"
    ):
        shortened = solve_fde(T1.rhs, 0.8, [1.0], step=0.3, end=1.0)
    assert shortened.step == 0.25
    np.testing.assert_array_equal(shortened.states, solve_fde(T1.rhs, 0.8, [1.0], step=0.25, end=1.0).states)


@pytest.mark.parametrize("method", SCHEMES)
def test_storing_every_kth_sample_stores_those(method):
    whole, thin = (run(T33, 5e-3, method=method, every=k) for k in (1, 7))
    np.testing.assert_array_equal(thin.states, whole.states[::7])
    np.testing.assert_allclose(thin.time, whole.time[::7], rtol=1e-14)
    assert thin.time[-1] <= whole.time[-1]


@pytest.mark.parametrize("method", SCHEMES)
def test_a_later_start_is_the_same_run_with_another_clock(method):
    def driven(t, x, u, p, out):
        out[0] = np.sin(3 * (t - p[0])) - x[0]

    early, late = (
        solve_fde(driven, 0.7, [0.3], step=0.01, start=start, end=start + 2, parameters=[start], method=method)
        for start in (0.0, -1.0)
    )
    np.testing.assert_allclose(late.states, early.states, atol=1e-12)
    assert late.time[0] == -1.0


@pytest.mark.parametrize("problem", [T1, T8, T11, T20, T33, t4((0.8, 0.7, 0.9)), t4((1.5, 1.2))], **by_name)
def test_the_states_between_the_samples_are_as_good_as_those_at_them(problem):
    step, end = problem.step, max(problem.solution)
    coarse, fine = (run(problem, h) for h in (step, step / 16))
    here = coarse.at(fine.time)
    grid_error = np.abs(coarse.states - fine.states[::16]).max(axis=0)
    assert np.all(np.abs(here - fine.states).max(axis=0) <= 3 * grid_error + 2e-5 * np.abs(fine.states).max(axis=0))
    np.testing.assert_allclose(coarse.at(coarse.time), coarse.states, atol=1e-12 * np.abs(fine.states).max())
    wanted = [0.0, 0.3 * step, end / np.pi, end]
    asked = run(problem, step, times=wanted)
    np.testing.assert_array_equal(asked.states, coarse.at(wanted))
    np.testing.assert_array_equal(asked.time, wanted)


def test_a_time_outside_of_the_run_is_told():
    with pytest.raises(InputError, match=r"times: 1.5 is outside of the run, which goes from 0 to 1"):
        solve_fde(T1.rhs, 0.8, [1.0], step=0.1, end=1.0).at([0.5, 1.5])


def test_states_at_times_that_are_no_grid_are_no_grid_to_read_others_from():
    asked = solve_fde(T1.rhs, 0.8, [1.0], step=0.1, end=1.0, times=[0.0, 0.1, 0.2, 1.0])
    with pytest.raises(InputError, match="which are no grid to read others from: leave out times"):
        asked.at([0.5])


def test_a_last_time_that_rounding_puts_above_the_end_is_the_end():
    asked = solve_fde(T1.rhs, 0.8, [1.0], step=0.1, end=0.3, times=np.arange(4) * 0.1)
    assert asked.time[-1] == 0.3 < 3 * 0.1


@pytest.mark.parametrize("method", SCHEMES)
def test_a_run_ends_with_the_first_sample_outside_of_its_bounds(method):
    whole = run(T33, 2e-3, method=method)
    first = int(np.argmax(np.abs(whole.states[:, 2]) > 0.18))
    inside = int(np.argmax(whole.states[:, 2] < 0.05))
    box = np.array([(-np.inf, np.inf)] * 4)
    box[2] = (0.05, 0.18)
    cut = run(T33, 2e-3, method=method, bounds=box)
    assert cut.outcome is Outcome.LEFT
    assert first == 0
    np.testing.assert_array_equal(cut.states, whole.states[: inside + 1])


# --- history ---------------------------------------------------------------------------------------


@pytest.mark.few(30)
@pytest.mark.parametrize("memory", ["full", "compressed", "short(100)"])
@pytest.mark.parametrize("method", SCHEMES)
@pytest.mark.parametrize(
    ("problem", "cut"),
    [(T1, 100), (relaxation(0.2), 3), (T20, 1), (T20, 2), (T11, 40), (T20, 333), (T33, 64), (t4((0.5, 1.0)), 17)],
    **by_name,
)
def test_the_second_half_of_a_run_continues_the_first(problem, cut, method, memory):
    step, steps = problem.step, 400
    options = {"step": step, "parameters": problem.parameters, "method": method, "memory": memory}
    whole = solve_fde(problem.rhs, problem.orders, problem.initial, end=steps * step, **options)
    half = whole.states[: cut + 1]
    on = solve_fde(
        problem.rhs, problem.orders, half[-1], history=half[:-1], start=cut * step, end=steps * step, **options
    )
    settled = 1e-9 if problem is T11 and method == "pi3" else 1e-11  # steep: sweeps are left at that
    np.testing.assert_allclose(on.states, whole.states[cut:], rtol=0, atol=settled * np.abs(whole.states).max())
    np.testing.assert_allclose(on.time, whole.time[cut:], rtol=1e-12)


@pytest.mark.parametrize("method", SCHEMES)
def test_a_history_carries_initial_derivatives_and_inputs_too(method):
    u, cut, steps = np.sin(np.arange(401) * 0.01), 150, 400
    start = [(1.0, -0.5)]
    whole = solve_fde(_driven, 1.5, start, step=0.01, end=4.0, inputs=u, method=method)
    half = whole.states[: cut + 1]
    on = solve_fde(_driven, 1.5, [(half[-1, 0], -0.5)], history=half[:-1], start=1.5, end=4.0, step=0.01, inputs=u,
                   method=method)  # fmt: skip
    np.testing.assert_allclose(on.states, whole.states[cut:], atol=1e-11)
    assert len(on.time) == steps - cut + 1


@pytest.mark.parametrize("method", OF_F)
def test_a_run_goes_on_from_where_it_stands_though_the_model_would_not_have_come_there(method):
    measured = 1 + 0.1 * np.sin(np.arange(200) * 0.05)
    on = solve_fde(T1.rhs, 0.8, measured[-1:], history=measured[:-1, None], step=0.01, end=0.5, method=method)
    assert on.states[0, 0] == measured[-1]
    assert np.abs(np.diff(on.states[:, 0])).max() < 0.02


def test_a_constant_history_is_no_history():
    # Before the start the system stood still, as Caputo's derivative has it: f = 0 there, and nothing is remembered.
    def held(t, x, u, p, out):
        out[0] = -p[0] * x[0] if t > 0 else 0.0

    short, long = (
        solve_fde(held, 0.8, [1.0], step=1e-3, end=1.0, parameters=[1.0], method="gl", history=np.ones((n, 1)))
        for n in (1, 500)
    )
    np.testing.assert_allclose(short.states, long.states, atol=1e-12)


RATE = 2.0


def _inner(value):
    return RATE * value


def _helper(x, i):
    return _inner(x[i])


def _calls_helpers(t, x, u, p, out):
    out[0] = -_helper(x, 0)


def _helper_beyond(t, x, u, p, out):
    out[0] = -_helper(x, int(t) + 0) if t < 0.5 else _helper(x, 7)


def test_a_right_hand_side_may_call_functions_of_its_file():
    x = solve_fde(_calls_helpers, 1.0, [1.0], step=1e-3, end=1.0).states[-1, 0]
    assert x == pytest.approx(math.exp(-RATE), rel=1e-5)


def test_a_wrong_index_in_a_function_that_is_called_is_an_error_and_no_crash():
    with pytest.raises((IndexError, InputError)):
        solve_fde(_helper_beyond, 1.0, [1.0], step=0.1, end=1.0)


def test_a_model_without_orders_is_its_integer_order_model():
    rig = rotary_pendulum("srv02-rotpen")
    options = {"initial": {"alpha": 0.17}, "step": 1e-2, "end": 1.0}
    ones = simulate(rig, orders={"lambda": 1.0, "mu": 1.0}, **options)
    np.testing.assert_array_equal(simulate(rig, **options).states, ones.states)


def test_a_model_that_has_no_integer_value_of_an_order_asks_for_it():
    with pytest.raises(InputError, match=r"the model gives mu no integer value\. Type orders="):
        simulate(replace(rotary_pendulum("srv02-rotpen"), integer_orders={"mu": None}), initial={}, step=0.1, end=1.0)
