"""Print the tables of docs/solver.md: measured orders, and where they end.

    python benchmarks/orders.py           # a quarter of a minute
    python benchmarks/orders.py --write   # also puts tables and pictures into docs/

Nothing is timed and nothing is random: a figure differs between machines in its last digit at most.  Errors are the
largest over the states at the last time at which a solution is known, unless a table says otherwise; an order is the
binary logarithm of the last two errors' ratio.  A method that is added to ``METHODS`` has its rows by itself.
"""

import math
import re
import sys
import warnings
from collections.abc import Callable, Iterable
from itertools import pairwise
from math import log2
from pathlib import Path

import numpy as np
from scipy.special import zeta

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "tests"))

from fracid import Trajectory, sensitivities, solve_fde  # noqa: E402
from fracid.solver.arguments import AtRestWarning  # noqa: E402
from fracid.solver.methods import METHODS  # noqa: E402
from fracid.solver.solve import PaperSchemeWarning  # noqa: E402
from oracles import derivatives as recursions  # noqa: E402
from oracles.mittag_leffler import mittag_leffler  # noqa: E402
from oracles.problems import (  # noqa: E402
    LINEAR,
    T1,
    T6,
    T8,
    T11,
    T14,
    T19,
    T20,
    T27,
    T33,
    FractionalProblem,
    m1,
    robinson,
    t2,
    t4,
    t15,
)

PAGE = ROOT / "docs" / "solver.md"
IMAGES = ROOT / "docs" / "images"

# --- runs and errors -------------------------------------------------------------------------------


def end_of(problem: FractionalProblem) -> tuple[float, np.ndarray]:
    """The last time at which the solution is known, and the states there."""
    end = max(problem.solution)
    return end, np.array(problem.solution[end])


def solve(problem: FractionalProblem, step: float, **options: object) -> Trajectory:
    given = {"end": end_of(problem)[0], "parameters": problem.parameters, **options}
    return solve_fde(problem.rhs, problem.orders, problem.initial, step=step, **given)


def error(problem: FractionalProblem, step: float, **options: object) -> float:
    """At the end; inf where the run does not come so far."""
    run, (_, exact) = solve(problem, step, **options), end_of(problem)
    return float(np.nanmax(np.abs(run.states[-1][: len(exact)] - exact))) if run.completed else np.inf


def errors(problem: FractionalProblem, parts: Iterable[float], **options: object) -> list[float]:
    """With the problem's step in so many parts."""
    return [error(problem, problem.step / k, **options) for k in parts]


def relax(t, x, u, p, out):  # noqa: ARG001
    for i in range(len(out)):
        out[i] = -x[i]


def relaxation(order: float, end: float = 2.0, step: float = 1 / 16) -> FractionalProblem:
    """D^q y = −y, y(0) = 1 (and y'(0) = 0): y = E_q(−t^q)."""
    initial = (1.0,) if order <= 1 else ((1.0, 0.0),)
    solution = {end: (float(mittag_leffler(order, -(end**order))),)}
    return FractionalProblem(f"relaxation, order {order:g}", relax, (order,), initial, solution, step=step)


# --- tables ----------------------------------------------------------------------------------------


def table(heads: list[str], rows: Iterable[list[str]], left: int = 1) -> str:
    """Markdown; the first `left` columns are words, the rest numbers."""
    lines = [heads, ["---"] * left + ["--:"] * (len(heads) - left), *rows]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


def shown(values: Iterable[float]) -> list[str]:
    return ["0" if v == 0 else f"{v:.1e}" if v < 1e6 else "diverges" for v in values]


def as_fraction(step: float) -> str:
    """A step as people write it."""
    return f"1/{round(1 / step)}"


def with_order(values: list[float], floor: float = 0.0) -> list[str]:
    """Errors, and their order where the last is above a floor, below which rounding, memory and signs decide."""
    telling = np.all(np.array(values) < 1e6) and values[-1] > floor
    return [*shown(values), f"{log2(values[-2] / values[-1]):.2f}" if telling else "—"]


def methods_table() -> str:
    """Every scheme on three problems."""
    problems = ((t4((0.8, 0.7, 0.9)), "T4, from rest"), (T1, "T1, from 1"), (T20, "T20, pendulum"))
    rows = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PaperSchemeWarning)
        for problem, name in problems:
            for key, method in METHODS.items():
                found = errors(problem, (1, 2, 4), method=key)
                rows.append([name, f"`{key}`", as_fraction(problem.step), *with_order(found, 1e-11),
                             str(method.convergence_order)])  # fmt: skip
    return table(["problem", "method", "h", "error at h", "h/2", "h/4", "measured order", "stated order"], rows, 2)


STARTS = (
    (relaxation(0.1), "t^0.1"), (relaxation(0.3), "t^0.3"), (relaxation(0.6), "t^0.6"), (T1, "t^0.8"),
    (LINEAR[0], "t^0.6"), (LINEAR[1], "t^0.95"), (T33, "t^0.86"), (T19, "t^0.9"), (T20, "t^0.95"), (T27, "t^0.98"),
    (m1(0.0417), "t^0.91"), (T11, "t^0.6"), (t4((1.5, 1.2)), "t^0.5"), (T8, "t^1.8"), (LINEAR[2], "t^1.3"),
    (t4((0.8, 0.7, 0.9)), "t^1.1"), (t2(0.25), "t^3.9"), (t2(0.9), "t^3.6"), (t2(1.5), "t^3.3"), (T6, "t^4"),
    (T14, "t^0.5"),
)  # fmt: skip
"""Problems, and the lowest power below which f is constant along the solution."""


def third_table() -> str:
    """The third order beside the second: the largest error over the known times."""

    def worst(problem: FractionalProblem, part: int, method: str) -> float:
        run = solve(problem, problem.step / part, method=method)
        known = problem.solution.items()
        off = [np.abs(run.states[round(t / run.step)][: len(x)] - x) for t, x in known if round(t / run.step) > 0]
        return float(np.nanmax([np.nanmax(o) for o in off]))

    rows = []
    for problem in (relaxation(0.3), relaxation(0.6), T1, T8, T11, T19, T20, T27, T33, m1(0.0417), t2(0.9), t2(1.5)):
        second, third = ([worst(problem, part, method) for part in (2, 4, 8)] for method in ("pi2", "pi3"))
        rows.append([problem.name, as_fraction(problem.step / 2), *with_order(second), *with_order(third, 1.2e-8),
                     f"{second[1] / third[1]:,.0f}"])  # fmt: skip
    rest = ("h/2", "h/4", "order")
    return table(["problem", "h", "`pi2`: h", *rest, "`pi3`: h", *rest, "gain at h/2"], rows)


def start_table() -> str:
    """The error with and without the start's corrections."""
    rows = [
        [problem.name, begins, as_fraction(problem.step / 2),
         *with_order(errors(problem, (2, 4, 8), corrected=False)),
         *with_order(errors(problem, (2, 4, 8)), 3e-10)]
        for problem, begins in STARTS
    ]  # fmt: skip
    rest = ("h/2", "h/4", "order")
    return table(["problem", "f − f(0) begins like", "h", "bare: h", *rest, "corrected: h", *rest], rows, 2)


def limits_table() -> str:
    """A function that is not Lipschitz, in smaller and smaller steps."""
    rows = [
        [name, *with_order(errors(T14, (4, 8, 16, 32, 64), corrected=corrected))]
        for corrected, name in ((False, "bare"), (True, "corrected"))
    ]
    return table(["T14", "h/4", "h/8", "h/16", "h/32", "h/64", "order"], rows)


def couple(t, x, u, p, out):  # noqa: ARG001
    out[0], out[1] = x[1] - x[0], -x[0] - x[1]


JUMPS = (("one state", relax, (0.5,), (1.0,)), ("one state", relax, (0.25,), (1.0,)),
         ("one state", relax, (0.2,), (1.0,)), ("one state", relax, (0.09,), (1.0,)),
         ("two states", couple, (0.5, 0.59), (1.0, 0.5)))  # fmt: skip
"""Orders at which the set of exponents changes: a sum reaches 1, or comes nearer than 0.09 to another."""


def jump_table() -> str:
    """How far the trajectory jumps where the last order crosses such a value."""
    rows = []
    for name, rhs, orders, initial in JUMPS:
        jumps, off = [], []
        for h in (0.04, 0.02, 0.01):
            below, above = (
                solve_fde(rhs, (*orders[:-1], orders[-1] + d), initial, step=h, end=2.0).states[-1]
                for d in (-1e-12, 1e-12)
            )
            fine = solve_fde(rhs, orders, initial, step=h / 64, end=2.0).states[-1]
            jumps.append(float(np.abs(above - below).max()))
            off.append(float(max(np.abs(below - fine).max(), np.abs(above - fine).max())))
        rows.append([name, ", ".join(f"{q:g}" for q in orders), *shown(jumps), *shown(off)])
    return table(["", "orders", "jump: h = 0.04", "0.02", "0.01", "error: h = 0.04", "0.02", "0.01"], rows, 2)


def sweeps_table() -> str:
    """Corrector sweeps."""
    rows = []
    for problem in (T20, T33):
        for sweeps in (1, 2, 3):
            rows.append([problem.name, f"`corrections={sweeps}`",
                         *with_order(errors(problem, (1, 2, 4), corrections=sweeps))])  # fmt: skip
        rows.append([problem.name, "`pi2-implicit`", *with_order(errors(problem, (1, 2, 4), method="pi2-implicit"))])
    return table(["problem", "", "h", "h/2", "h/4", "order"], rows, 2)


def stiff_table() -> str:
    """Prothero and Robinson's problem, on the slow curve and off it."""
    rows = []
    for off in (0.0, 1.0):
        for order in (0.5, 0.8, 0.99, 1.0):
            for stiffness in (1e2, 1e4, 1e6):
                found = errors(t15(order, stiffness, off), (1, 2, 4), method="pi2-implicit")
                rows.append(["off it" if off else "on the curve", f"{order:g}", f"{stiffness:.0e}",
                             *with_order(found, 2e-12)])  # fmt: skip
    return table(["start", "order q", "L", "h = 1/64", "1/128", "1/256", "measured order"], rows)


def stiff_above_table() -> str:
    """What is left of a fast decay after 15 s, above order 1."""

    def decay(t, x, u, p, out):  # noqa: ARG001
        out[0] = -p[0] * x[0]

    rows = []
    for order in (1.01, 1.05, 1.2, 1.5, 1.8):
        limit = math.gamma(order + 2) / (4 * (2 ** (order + 2) - 1) * zeta(-order - 1))
        for rate in (1e3, 3e4, 1e6):
            runs = [solve_fde(decay, order, [1.0], step=1e-2, end=20.0, parameters=[rate], method=method)
                    for method in ("pi2-implicit", "bdf2")]  # fmt: skip
            late = runs[1].time >= 15
            exact = np.abs(mittag_leffler(order, -rate * runs[1].time[late] ** order)).max()
            left = [np.abs(run.states[late, 0]).max() if len(run.time) == len(late) else math.inf for run in runs]
            rows.append([f"{order:g}", f"{rate:.0e}", f"{rate * 1e-2**order:.3g}", f"{limit:.3g}",
                         *shown([*left, exact])])  # fmt: skip
    return table(["order", "L", "$h^q L$", "limit of `pi2`", "`pi2-implicit`", "`bdf2`", "exact"], rows, 0)


def stiff_methods_table() -> str:
    """Which methods survive stiffness."""
    problems = (t15(0.8, 1e4), robinson((0.7, 0.8, 0.9)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PaperSchemeWarning)
        rows = [[p.name, f"`{key}`", *with_order(errors(p, (1, 2, 4), method=key), 1e-11)]
                for p in problems for key in METHODS if key != "gl-paper"]  # fmt: skip
    return table(["problem", "method", "h = 1/64", "1/128", "1/256", "measured order"], rows, 2)


def memory_table() -> str:
    """The trajectory with compressed memory against that with full memory."""
    rows = []
    for problem in (T33, T8):
        for method in ("pi2", "gl"):
            whole = solve(problem, 1e-3, method=method, memory="full").states
            off = [np.abs(solve(problem, 1e-3, method=method, tolerance=tolerance).states - whole).max()
                   for tolerance in (1e-6, 1e-8, 1e-10, 1e-12)]  # fmt: skip
            rows.append([problem.name, f"{len(whole) - 1:,}", f"`{method}`", *shown(off)])
    return table(["problem", "steps", "method", "1e-6", "1e-8", "1e-10", "1e-12"], rows, 3)


def long_table() -> str:
    """T8, order 1.8, in ever smaller steps: the largest error at t = 1, 5 and 20."""
    known = np.array([T8.solution[t][0] for t in (1.0, 5.0, 20.0)])
    rows = []
    for method in ("gl", "pi2"):
        for tolerance in (1e-8, 1e-10, 1e-12):
            runs = [solve(T8, 20 / n, method=method, tolerance=tolerance, every=n // 20)
                    for n in (4_000, 40_000, 400_000, 4_000_000)]  # fmt: skip
            off = [np.abs(run.states[[1, 5, 20], 0] - known).max() for run in runs]
            rows.append([f"`{method}`", f"{tolerance:g}", *shown(off)])
    return table(["method", "tolerance", "4·10³ steps", "4·10⁴", "4·10⁵", "4·10⁶"], rows)


def ends_table() -> str:
    """Orders from 0.001 to 1.999: D^q y = −y to t = 10."""
    rows = []
    for order in (0.001, 0.01, 0.05, 0.085, 0.1, 0.2, 0.5, 0.9, 0.99, 0.999, 1.0, 1.001, 1.1, 1.5, 1.9, 1.99, 1.999):
        problem = relaxation(order, end=10.0, step=0.04)
        whole, kept = (solve(problem, 0.001, memory=memory).states for memory in ("full", "compressed"))
        rows.append([f"{order:g}", *with_order(errors(problem, (1, 2, 4)), 1e-10), *shown([np.abs(whole - kept).max()]),
                     *shown([error(problem, 0.01, method="gl")])])  # fmt: skip
    return table(["order", "h = 0.04", "0.02", "0.01", "measured order", "compressed − full, 10⁴ steps",
                  "`gl`, h = 0.01"], rows, 0)  # fmt: skip


def large_steps_table() -> str:
    """Steps of the size of the motion itself: the error at t = 5."""
    steps = (1.0, 0.5, 0.2, 0.1, 0.05)
    rows = []
    for problem, name in ((T1, "T1, relaxation of time 1 s"), (T8, "T8, swing of period 6 s"),
                          (T20, "T20, pendulum of period 2 s")):  # fmt: skip
        known = problem.solution[5.0]
        runs = [solve(problem, h, end=5.0) for h in steps]
        size = np.abs(known).max()
        rows.append([name, f"{size:.2f}", *shown(np.abs(run.states[-1] - known).max() for run in runs)])
    return table(["", "x(5)", *(f"h = {h:g} s" for h in steps)], rows)


def dry_friction(t, x, u, p, out):  # noqa: ARG001
    out[0], out[1] = x[1], -9 * x[0] - p[0] * np.tanh(x[1] / p[1])


def friction_table() -> str:
    """An oscillator with dry friction: the largest error over 4 s, against steps 32 times finer than the finest."""
    steps = (1e-2, 5e-3, 2.5e-3, 1.25e-3)
    rows = []
    for order in (1.0, 0.9):
        for slip in (1e-1, 1e-2, 1e-3, 1e-4):

            def motion(h, method="pi2", order=order, slip=slip):
                run = solve_fde(dry_friction, order, [1.0, 0.0], step=h, end=4.0, parameters=[0.5, slip],
                                method=method, every=round(1e-2 / h))  # fmt: skip
                return run.states[:, 0] if run.completed else np.inf

            exact = motion(steps[-1] / 32, "pi2-implicit")
            off = [float(np.abs(motion(h) - exact).max()) for h in steps]
            newton = float(np.abs(motion(steps[-1], "pi2-implicit") - exact).max())
            mean = f"{log2(off[0] / off[-1]) / 3:.2f}" if off[0] < np.inf else "—"
            cells = [text if v < np.inf else "unsettled" for text, v in zip(shown(off), off, strict=True)]
            rows.append([f"{order:g}", f"{slip:g}", *cells, mean, *shown([newton])])
    return table(["order", "slip speed", "h = 10 ms", "5 ms", "2.5 ms", "1.25 ms", "mean order",
                  "`pi2-implicit`, 1.25 ms"], rows, 0)  # fmt: skip


def lorenz(t, x, u, p, out):  # noqa: ARG001
    out[0], out[1], out[2] = 10 * (x[1] - x[0]), x[0] * (28 - x[2]) - x[1], x[0] * x[1] - 8 / 3 * x[2]


LORENZ_STEPS = (4e-3, 2e-3, 1e-3, 5e-4)


def apart(order: float, end: float = 40.0, tolerance: float = 1e-10) -> tuple[np.ndarray, list[np.ndarray]]:
    """Time, and the largest difference over the states between each step and its half."""
    runs = [solve_fde(lorenz, order, [1.0, 1.0, 1.0], step=h, end=end, every=round(4e-3 / h), tolerance=tolerance)
            for h in (*LORENZ_STEPS, LORENZ_STEPS[-1] / 2)]  # fmt: skip
    differences = [np.abs(one.states - half.states).max(axis=1) for one, half in pairwise(runs)]
    return runs[0].time, differences


def chaos_table() -> str:
    """When Lorenz's system leaves the run with half the step."""
    rows = []
    for order in (0.99, 0.995, 1.0):
        time, differences = apart(order)
        for h, d in zip(LORENZ_STEPS, differences, strict=True):
            first = [f"{time[np.argmax((d > size) & (time > 1))]:.1f} s" if np.any((d > size) & (time > 1)) else "never"
                     for size in (0.01, 1)]  # fmt: skip
            rows.append([f"{order:g}", f"{1e3 * h:g} ms", *shown([d[time <= 5].max()]), *first,
                         *shown([d[time > 35].max()])])  # fmt: skip
    return table(["order", "h", "largest to 5 s", "above 0.01 from", "above 1 from", "largest from 35 s on"], rows, 0)


def between_table() -> str:
    """Dense output: the error between the grid points beside that on them, D^q y = −y."""
    rows = []
    for order in (0.3, 0.8, 1.5):
        for every in (1, 4):
            run = solve(relaxation(order, end=4.0), 0.01, every=every)
            wanted = np.linspace(0.003, 3.997, 1997)
            pairs = []
            for times, y in ((run.time[1:], run.states[1:, 0]), (wanted, run.at(wanted)[:, 0])):
                off, early = np.abs(y - mittag_leffler(order, -(times**order))), times < 0.1
                pairs.append((off[early].max(), off[~early].max()))
            rows.append([f"{order:g}", str(every), *shown(np.array(pairs).T.ravel())])
    return table(["order", "`every`", "t < 0.1, on the grid", "between", "t ≥ 0.1, on the grid", "between"], rows, 0)


def pendulum(t, x, u, p, out):  # noqa: ARG001
    out[0] = x[1]
    out[1] = -p[0] * np.sin(x[0]) - p[1] * x[1]


def sensitivity_table() -> str:
    """Derivatives of a run against the complex step through its recursion."""
    h, steps, p, x0 = 0.02, 150, np.array([9.81, 0.2]), np.array([0.17, 0.0])
    recursion_of: dict[str, Callable] = {"gl": recursions.gl, "pi2-implicit": recursions.pi2}
    rows = []
    for method, recursion in recursion_of.items():
        for orders in ((0.95, 0.95), (0.8, 1.1), (1.0, 1.0)):
            found = sensitivities(pendulum, orders, x0, parameters=p, step=h, end=h * steps, method=method,
                                  corrected=False)  # fmt: skip
            off = []
            for kind, values in (("orders", np.array(orders)), ("parameters", p), ("initial", x0)):
                given = {"orders": np.array(orders), "initial": x0, "parameters": p}

                def run(v, kind=kind, given=given, recursion=recursion):
                    return recursion(pendulum, **(given | {kind: v}), step=h, steps=steps)

                exact = [recursions.complex_step(run, values, i) for i in range(len(values))]
                slopes = np.moveaxis(getattr(found, kind), -1, 0)
                off.append(max(np.abs(s - e).max() / np.abs(e).max() for s, e in zip(slopes, exact, strict=True)))
            rows.append([f"`{method}`", f"{orders[0]:g}, {orders[1]:g}", *shown(off)])
    return table(["method", "orders", "∂x/∂order", "∂x/∂p", "∂x/∂x(start)"], rows, 2)


def continued_table() -> str:
    """A run cut in two, its first half the history of the second."""
    rows = []
    for memory in ("full", "compressed"):
        for method in METHODS:
            if method == "gl-paper":
                continue
            whole = solve(T33, 2e-3, method=method, memory=memory)
            half = whole.states[:1001]
            on = solve_fde(T33.rhs, T33.orders, half[-1], history=half[:-1], start=2.0, step=2e-3, end=5.0,
                           parameters=T33.parameters, method=method, memory=memory)  # fmt: skip
            rows.append([f"`{method}`", memory, *shown([np.abs(on.states - whole.states[1000:]).max()])])
    return table(["method", "memory", "largest difference"], rows, 2)


TABLES: dict[str, Callable[[], str]] = {
    "methods": methods_table,
    "third": third_table,
    "sweeps": sweeps_table,
    "memory": memory_table,
    "start": start_table,
    "jumps": jump_table,
    "not-lipschitz": limits_table,
    "stiff-methods": stiff_methods_table,
    "stiff-above": stiff_above_table,
    "stiff": stiff_table,
    "continued": continued_table,
    "between": between_table,
    "sensitivities": sensitivity_table,
    "ends": ends_table,
    "long": long_table,
    "large-steps": large_steps_table,
    "friction": friction_table,
    "chaos": chaos_table,
}
"""By the name that marks their place on the page."""


# --- pictures --------------------------------------------------------------------------------------

BLUE, ORANGE, GREY, INK = "#0072B2", "#D55E00", "#B0B0B0", "#333333"  # told apart by the colour-blind, and in grey


def draw_starts(path: Path) -> None:
    """Error over step, with and without the corrections."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 5.6), layout="constrained")
    problems = (relaxation(0.1), relaxation(0.3), relaxation(0.6), T11, t4((1.5, 1.2)), T14)
    titles = ("relaxation, order 0.1", "relaxation, order 0.3", "relaxation, order 0.6", "T11: f depends on t$^{0.6}$",
              "T4, orders 1.5 and 1.2", "T14: not Lipschitz")  # fmt: skip
    parts = 2 ** np.arange(8)
    for axes, problem, title in zip(figure.subplots(2, 3).flat, problems, titles, strict=True):
        steps = problem.step / parts
        bare, corrected = errors(problem, parts, corrected=False), errors(problem, parts)
        axes.loglog(steps, bare[0] * (steps / steps[0]) ** 2, color=GREY, linewidth=1, linestyle=":")
        axes.loglog(steps, bare, "s-", color=ORANGE, markerfacecolor="white", markersize=5)
        axes.loglog(steps, corrected, "o-", color=BLUE, markersize=4)
        axes.set_title(title, fontsize=10, loc="left", color=INK)
        axes.text(0.97, 0.05, f"order {log2(bare[3] / bare[5]) / 2:.1f} bare", transform=axes.transAxes, ha="right",
                  fontsize=9, color=ORANGE)  # fmt: skip
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(labelsize=8)
        axes.tick_params(which="minor", labelbottom=False, labelleft=False)
    names = ("slope 2", "bare rule", "start corrected")
    figure.legend(figure.axes[0].lines, names, loc="outside upper right", ncols=3, frameon=False, fontsize=9)
    figure.supxlabel("step h", fontsize=10)
    figure.supylabel("error at the end of the run", fontsize=10)
    figure.savefig(path, dpi=130)


def draw_chaos(path: Path) -> None:
    """The difference between a step and its half, over time."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3.4), layout="constrained")
    all_axes = figure.subplots(1, 2, sharey=True)
    for axes, order, words in zip(all_axes, (0.99, 0.995), ("comes to rest", "chaotic"), strict=True):
        time, differences = apart(order)
        for h, d, shade in zip(LORENZ_STEPS, differences, ("#9ecae1", "#6baed6", "#3182bd", "#08306b"), strict=True):
            axes.semilogy(time[1:], d[1:], color=shade, linewidth=1, label=f"{1e3 * h:g} ms")
        axes.set_title(f"Lorenz's system of order {order:g}: {words}", fontsize=10, loc="left", color=INK)
        axes.set_xlabel("t [s]")
        axes.spines[["top", "right"]].set_visible(False)
    all_axes[0].set_ylabel("difference to the run of half the step")
    all_axes[1].legend(title="step", frameon=False, fontsize=8, title_fontsize=8, loc="lower right")
    figure.savefig(path, dpi=130)


def write(name: str, text: str) -> None:
    """Put a table in its place on the page."""
    page, place = PAGE.read_text(), re.compile(rf"(<!-- {name}: begin -->\n).*?(<!-- {name}: end -->)", re.DOTALL)
    if not place.search(page):
        sys.exit(f"{PAGE.name} has no place for the table {name!r}.")
    PAGE.write_text(place.sub(lambda found: f"{found[1]}\n{text}\n\n{found[2]}", page))


def main() -> None:
    warnings.simplefilter("ignore", AtRestWarning)  # these start at rest
    for name, make in TABLES.items():
        text = make()
        print(f"\n{name}: {make.__doc__}\n\n{text}", flush=True)
        if "--write" in sys.argv:
            write(name, text)
    if "--write" in sys.argv:
        draw_starts(IMAGES / "solver-start.png")
        draw_chaos(IMAGES / "solver-chaos.png")


if __name__ == "__main__":
    main()
