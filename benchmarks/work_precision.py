"""Error against time, fracid and its peers on the known solutions:  make bench-peers

Every problem of tests/oracles/problems.py is solved by each of fracid's methods with each memory and by what
else there is in Python, in one process, in turn, with halved steps until a call would take longer than the
budget.  Writes docs/work-precision.md and docs/images/work_precision.png; the exit code is 1 where

1. one of fracid's points is less accurate than its convergence order foretells from the coarsest, or
2. some point of a peer has a smaller error than all of fracid's points that take no longer, where times below
   :data:`CALL` count as equal: they are those of calls in Python, not of solving.  A scheme that has no error at all
   (L1 where the solution is a straight line) is said, and left out.

*Error* is the largest at any known time in any known state, relative to the largest known value of that state,
and never below what the solution is known to (:data:`KNOWN_TO`).

*Time* is that of a call with all its setup: arguments checked, kernels built anew.  All run on one thread, so it is
counted as processor time: what a clock on the wall shows where nothing else runs, and the same where something does.
Of several calls, each after one that is not timed where calls are short, it is the median of the faster half.
Compiling a right-hand side and importing are left out; "a first answer" has them, and is wall-clock time.

The peers get the same right-hand side compiled by Numba, which is faster than what their users write, and
``python -O``, which spares pycaputo its assertions and lets all its methods take orders above 1.  The plain loop has
no arguments to check, so it is held against fracid's own core too (``integrate``).
"""

from __future__ import annotations

import argparse
import contextlib
import gc
import importlib
import io
import os
import platform
import re
import subprocess
import sys
import tempfile
import time
import warnings
from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from datetime import date
from functools import cached_property
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from statistics import median

import numba as nb
import numpy as np
import plain
from scipy.interpolate import CubicSpline

import fracid
import fracid.solver.memory
from fracid.solver.arguments import Equation, InitialCondition, Options
from fracid.solver.memory import memory_from_name
from fracid.solver.operators import gl_weights

ROOT = Path(__file__).resolve().parent.parent
PAGE, PICTURE = ROOT / "docs" / "work-precision.md", ROOT / "docs" / "images" / "work_precision.png"
sys.path.insert(0, str(ROOT / "tests"))

from oracles import problems as known_solutions  # noqa: E402
from oracles.problems import FractionalProblem  # noqa: E402

engine = importlib.import_module("fracid.simulate")

MOST, MOST_WHOLE = 5_000_000, 70_000
"""Steps at most, with compressed and with any other memory: what diverges at once would go on for ever."""

CALL = 3e-4
"""Time [s] below which two calls count as equally fast."""

KNOWN_TO = {"T20": 3e-10, "T27": 5e-9, "T33": 1e-8, "M2": np.radians(1e-5)}
"""How well the known solutions are known where it is less than 13 digits, in the unit of the states."""

ROUGHER = {"T4(1.5, 1.2)": 1.5}
"""Convergence order of ``pi2`` where f(t, x(t)) is rougher than t^order: here it begins like t^0.5."""

PACKAGES = ("pycaputo", "fdeint", "torch", "fodeint", "numfracpy", "differint")
MEMORIES = ("compressed", "full")
FLOOR = 1e-8
"""Relative error that the compressed memory and rounding may leave over a whole run."""

FLOOR_STIFF = 2e-7
"""The same on stiff problems, where f is up to 10⁴ times the states, and what is left of its sums and sweeps too."""

Points = tuple[np.ndarray, np.ndarray]
"""Times, shape (n,), and states there, shape (n, n_states)."""


def _t18(t, x, u, p, out):  # noqa: ARG001
    out[0], out[1], out[2], out[3] = x[1], x[2], x[3], 1 + t - x[3] - x[0]


T18 = FractionalProblem(
    "T18", _t18, (0.5,) * 4, (1.0, 0.0, 1.0, 0.0), {t: (1 + t,) for t in (0.5, 1.0, 2.0)}, step=1 / 64
)
"""Bagley and Torvik's y'' + D^1.5 y + y = 1 + t as a system of order 0.5."""


def all_problems() -> list[FractionalProblem]:
    """Those of the module of known solutions, alone or in tuples, and T18."""
    values = [v for value in vars(known_solutions).values() for v in (value if isinstance(value, tuple) else (value,))]
    named = {p.name: p for p in [*values, T18] if isinstance(p, FractionalProblem)}
    number = re.compile(r"T(\d+)")
    return sorted(named.values(), key=lambda p: int(m[1]) if (m := number.match(p.name)) else 1000)


# --- one problem -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Case:
    """A problem in the forms that the solvers want."""

    problem: FractionalProblem

    @cached_property
    def compiled(self) -> Callable:
        """rhs(t, x, u, p, out) in machine code."""
        return engine.compile_rhs(self.problem.rhs)

    @cached_property
    def f(self) -> Callable:
        """f(t, x) → array: the compiled right-hand side in a peer's form."""
        rhs, p, u = self.compiled, self.p, np.zeros(0)

        def f(t: float, x: np.ndarray) -> np.ndarray:
            out = np.empty(len(p_states))
            rhs(t, np.ascontiguousarray(x, dtype=np.float64), u, p, out)
            return out

        p_states = self.x0
        return f

    @cached_property
    def x0(self) -> np.ndarray:
        given = np.array(self.problem.initial, dtype=float)
        return given if given.ndim == 1 else given[:, 0].copy()

    @cached_property
    def slope(self) -> np.ndarray:
        given = np.array(self.problem.initial, dtype=float)
        return np.zeros(len(given)) if given.ndim == 1 else given[:, 1].copy()

    @cached_property
    def orders(self) -> np.ndarray:
        return np.broadcast_to(np.array(self.problem.orders, dtype=float), len(self.x0)).copy()

    @cached_property
    def p(self) -> np.ndarray:
        return np.array(self.problem.parameters, dtype=float)

    @cached_property
    def jacobian(self) -> Callable:
        """J(t, x), by forward differences in machine code: pycaputo's implicit methods solve no system without."""
        rhs, p = self.compiled, self.p
        one = len(self.x0) == 1  # SciPy's scalar root finding wants a number

        def jacobian(t: float, x: np.ndarray) -> np.ndarray:
            J = forward_differences(rhs, t, np.array(x, dtype=np.float64), p)
            return J[0] if one else J

        return jacobian

    @property
    def stiff(self) -> bool:
        return self.problem.name in {p.name for p in known_solutions.STIFF}

    @property
    def end(self) -> float:
        return max(self.problem.solution)

    @cached_property
    def known(self) -> Points:
        return np.array(list(self.problem.solution)), np.array(list(self.problem.solution.values()))

    @cached_property
    def floor(self) -> float:
        """The relative error that the known solution itself may have."""
        scale = np.nanmax(np.abs(self.known[1]), axis=0)
        return max(1e-13, float(np.nanmax(KNOWN_TO.get(self.problem.name, 0.0) / scale)))

    def error(self, points: Points) -> float:
        times, known = self.known
        states = np.array([_at(points, t) for t in times])[:, : known.shape[1]]
        off = np.nanmax(np.abs(states - known) / np.nanmax(np.abs(known), axis=0))
        every = np.all(np.isfinite(states[np.isfinite(known)]))
        return max(self.floor, float(off)) if every else np.inf

    def convergence_order(self, method: str) -> float:
        """What theory promises: 1 + the smallest order, since f(t, x(t)) begins like t^order, and 2 at most."""
        best = engine.METHODS[method].convergence_order
        return min(best, ROUGHER.get(self.problem.name, 1 + self.orders.min()))

    @cached_property
    def levels(self) -> list[int]:
        """Numbers of steps: halvings and doublings of the problem's own step."""
        base = round(self.end / self.problem.step)
        coarse = 0
        while base % 2 ** (coarse + 1) == 0 and base >> (coarse + 1) >= 8:
            coarse += 1
        return [(base >> coarse) << k for k in range(28)]


def _at(points: Points, t: float) -> np.ndarray:
    """The states at a time: of a grid point, or of a cubic spline (graded steps, and very coarse ones)."""
    times, states = points
    near = int(np.argmin(np.abs(times - t)))
    if abs(times[near] - t) <= 1e-9 * max(1.0, t):
        return states[near]
    here = slice(max(0, near - 8), near + 9)
    finite = bool(np.all(np.isfinite(states[here])))
    return CubicSpline(times[here], states[here])(t) if finite else np.full(states.shape[1], np.nan)


@nb.njit(nogil=True, error_model="numpy")
def forward_differences(rhs, t, x, p):
    n, u = len(x), np.zeros(0)
    J, f, moved = np.zeros((n, n)), np.zeros(n), np.zeros(n)
    rhs(t, x, u, p, f)
    for j in range(n):
        kept, d = x[j], 1e-7 * (0.01 + abs(x[j]))
        x[j] = kept + d
        rhs(t, x, u, p, moved)
        x[j] = kept
        J[:, j] = (moved - f) / d
    return J


# --- the solvers -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Solver:
    name: str
    package: str
    solve: Callable[[Case, int], Points]
    """(case, number of steps) → points; raises what the package raises."""

    @property
    def ours(self) -> bool:
        return self.package.startswith("fracid")


def solve_fde(method: str, memory: str) -> Callable[[Case, int], Points]:
    def solve(case: Case, steps: int) -> Points:
        problem = case.problem
        run = fracid.solve_fde(problem.rhs, problem.orders, problem.initial, step=case.end / steps, end=case.end,
                               parameters=problem.parameters, method=method, memory=memory)  # fmt: skip
        return _whole(run, steps)

    return solve


def core(method: str, memory: str) -> Callable[[Case, int], Points]:
    def solve(case: Case, steps: int) -> Points:
        equation = Equation(case.compiled, case.orders, np.zeros((1, 0)), case.p)
        initial, options = InitialCondition(case.x0, case.slope), Options(method, memory_from_name(memory))
        run = engine.integrate(equation, initial, case.end / steps, steps, options)
        return _whole(run, steps)

    return solve


def _whole(run: fracid.Trajectory, steps: int) -> Points:
    """A run that ended early has no error."""
    return (run.time, run.states) if len(run.time) == steps + 1 else (np.linspace(0, 1, 2), np.full((2, 99), np.nan))


def plain_gl(case: Case, steps: int) -> Points:
    h = case.end / steps
    of = {q: gl_weights(q, steps + 1)[::-1] for q in set(case.orders.tolist())}
    weights = np.array([of[q] for q in case.orders.tolist()])
    out = plain.reordered(case.compiled, case.x0, case.slope, h**case.orders, weights, np.zeros(0), case.p, h, steps)
    return np.arange(steps + 1) * h, out


def pycaputo(method: str, *, implicit: bool = False, graded: bool = False, **options) -> Callable[[Case, int], Points]:
    def solve(case: Case, steps: int) -> Points:
        from pycaputo.controller import make_fixed_controller, make_graded_controller
        from pycaputo.derivatives import CaputoDerivative
        from pycaputo.events import StepAccepted
        from pycaputo.fode import caputo
        from pycaputo.stepping import evolve

        if graded:  # 2/order is best in theory; beyond 3 its weights drown in rounding
            grading = min(3.0, max(1.0, 2 / case.orders.min()))
            control = make_graded_controller(tfinal=case.end, nsteps=steps, r=grading)
            first = float(control.timesteps[0])
        else:
            control = make_fixed_controller(case.end / steps, nsteps=steps)
            first = control.dt
        y0 = (case.x0,) if case.orders.max() <= 1 else (case.x0, case.slope)
        if implicit:
            options["source_jac"] = case.jacobian
        solver = getattr(caputo, method)(ds=tuple(CaputoDerivative(q) for q in case.orders.tolist()), control=control,
                                         source=case.f, y0=y0, **options)  # fmt: skip
        times, states = [], []
        for event in evolve(solver, dtinit=first):
            if not isinstance(event, StepAccepted):
                raise RuntimeError(f"{type(event).__name__} at t = {event.t:g}")
            times.append(event.t)
            states.append(event.y)
        return np.array(times), np.array(states)

    return solve


def fdeint(case: Case, steps: int) -> Points:
    import torch
    from FDEint import FDEint

    if len(set(case.orders.tolist())) > 1:
        raise ValueError("alpha must be a scalar fractional order.")  # its own words for a vector

    def f(t, y):
        return torch.from_numpy(case.f(float(t[0, 0]), y[0].numpy()))[None]

    with torch.no_grad():
        t = torch.arange(steps + 1, dtype=torch.float64) * (case.end / steps)
        y = FDEint(f, t, torch.from_numpy(case.x0), torch.tensor(case.orders[0]), dtype=torch.float64)
    return t.numpy(), y[0].numpy()


def fodeint(case: Case, steps: int) -> Points:
    from fodeint import FODEValueError, fodeint

    if len(set(case.orders.tolist())) > 1:
        raise FODEValueError("`a` is one number in (0,1).")
    t = np.linspace(0, case.end, steps + 1)
    return t, fodeint(case.orders[0], lambda y, t: case.f(t, y), case.x0, t)


def numfracpy(case: Case, steps: int) -> Points:
    from numfracpy import FODE, SystemFODEs

    span, h = [0.0, case.end * (1 + 1e-12)], case.end / steps  # it rounds the number of steps down
    with contextlib.redirect_stdout(io.StringIO()):  # it prints
        if len(case.x0) == 1:
            q = float(case.orders[0])
            start = [case.x0[0]] if q <= 1 else [case.x0[0], case.slope[0]]
            t, y = FODE(lambda t, y: float(case.f(t, np.array([y]))[0]), start, span, h, q)
            return t, y[:, None]
        if case.orders.max() > 1:
            raise ValueError("SystemFODEs takes one initial value a state, so no order above 1.")
        parts = [lambda z, i=i: case.f(z[0], np.array(z[1:]))[i] for i in range(len(case.x0))]
        t, y = SystemFODEs(parts, case.x0.tolist(), span, h, case.orders.tolist())
    return t, np.array(y).T


def differint(case: Case, steps: int) -> Points:
    from differint.differint import PCsolver

    if len(case.x0) > 1:
        raise ValueError("PCsolver takes one equation.")
    y = PCsolver([case.x0[0], case.slope[0]], float(case.orders[0]), lambda t, y: case.f(t, np.array([y]))[0],
                 0.0, case.end, steps + 1)  # fmt: skip
    return np.linspace(0, case.end, steps + 1), y[:, None]


def solvers() -> list[Solver]:
    methods = [m for m in engine.METHODS if m != "gl-paper"]  # which is wrong for most of these, and says so
    return [
        *(Solver(f"{m}, {k}", "fracid", solve_fde(m, k)) for m in methods for k in MEMORIES),
        *(Solver(f"{m}, {k}, core", "fracid core", core(m, k)) for m in ("pi2", "gl") for k in MEMORIES),
        Solver("plain GL loop, compiled", "plain loop", plain_gl),
        Solver("ForwardEuler", "pycaputo", pycaputo("ForwardEuler")),
        Solver("WeightedEuler(1/2)", "pycaputo", pycaputo("WeightedEuler", implicit=True, theta=0.5)),
        Solver("PECE", "pycaputo", pycaputo("PECE", corrector_iterations=1)),
        Solver("PE(CE)^3", "pycaputo", pycaputo("PECE", corrector_iterations=3)),
        Solver("ModifiedPECE", "pycaputo", pycaputo("ModifiedPECE", corrector_iterations=1)),
        Solver("ExplicitTrapezoidal", "pycaputo", pycaputo("ExplicitTrapezoidal")),
        Solver("Trapezoidal", "pycaputo", pycaputo("Trapezoidal", implicit=True)),
        Solver("Trapezoidal, graded", "pycaputo", pycaputo("Trapezoidal", implicit=True, graded=True)),
        Solver("PE(CE)^3, graded", "pycaputo", pycaputo("PECE", corrector_iterations=3, graded=True)),
        Solver("L1", "pycaputo", pycaputo("L1", implicit=True)),
        Solver("FDEint", "fdeint", fdeint),
        Solver("fodeint", "fodeint", fodeint),
        Solver("FODE, SystemFODEs", "numfracpy", numfracpy),
        Solver("PCsolver", "differint", differint),
    ]


# --- measuring -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Point:
    steps: int
    error: float
    seconds: float


@dataclass
class Curve:
    """What one solver does on one problem."""

    solver: Solver
    points: list[Point] = field(default_factory=list)
    refusal: str = ""
    last: float = 0.0
    """The time of the last call [s]."""

    @property
    def best(self) -> Point:
        return min(self.points, key=lambda point: point.error)


def measure(case: Case, all_solvers: Iterable[Solver], budget: float) -> list[Curve]:
    """Every solver's errors and times on one problem, level by level, in turn."""
    curves = [Curve(solver) for solver in all_solvers]
    active = [c for c in curves if _warm(c, case)]
    for steps in case.levels:
        times, errors = defaultdict(list), {}
        for turn in range(7):
            for curve in active:
                if turn == 0 or sum(times[id(curve)]) < 0.02:
                    if curve.last < 2e-3:  # what others left in the caches
                        _timed(curve.solver, case, steps)
                    curve.last, points = _timed(curve.solver, case, steps)
                    times[id(curve)].append(curve.last)
                    if turn == 0:
                        errors[id(curve)] = case.error(points)
        for curve in active:
            of = sorted(times[id(curve)])
            curve.points.append(Point(steps, errors[id(curve)], median(of[: (len(of) + 1) // 2])))
        active = [c for c in active if _affordable(c, budget / 3 if c.solver.ours else budget)]
        if not active:
            break
    return curves


def _warm(curve: Curve, case: Case) -> bool:
    """Whether the solver takes the problem at all; if not, its own words are kept."""
    start = time.process_time()
    try:
        curve.solver.solve(case, case.levels[0])
        curve.last = time.process_time() - start
    except Exception as error:
        curve.refusal = f"{type(error).__name__}: {error}".splitlines()[0][:160]
    return not curve.refusal


def _timed(solver: Solver, case: Case, steps: int) -> tuple[float, Points]:
    forget_kernels()
    start = time.process_time()
    try:
        points = solver.solve(case, steps)
    except (ArithmeticError, RuntimeError, ValueError, AssertionError):  # it breaks down at this step
        points = np.linspace(0, 1, 2), np.full((2, 99), np.nan)
    return time.process_time() - start, points


def forget_kernels() -> None:
    """Empty fracid's caches of weights, so that each call builds its own; what it knows of a function stays."""
    for value in vars(fracid.solver.memory).values():
        if hasattr(value, "cache_clear"):
            value.cache_clear()


def _affordable(curve: Curve, budget: float) -> bool:
    """Whether the next level is within the budget, by the growth of the last one, and not in vain."""
    last = curve.points[-1]
    if 2 * last.steps > (MOST if "compressed" in curve.solver.name else MOST_WHOLE):
        return False
    before = curve.points[-2] if len(curve.points) > 1 else last
    growth = min(4.0, max(2.0, last.seconds / before.seconds))
    settled = len(curve.points) > 8 and min(p.error for p in curve.points[:-3]) <= 1.01 * curve.best.error < 1e-6
    return growth * last.seconds <= budget and not settled


# --- what must hold --------------------------------------------------------------------------------


def too_inaccurate(case: Case, curve: Curve) -> list[str]:
    """Points of ours above three times what the convergence order foretells from the coarsest one."""
    method = curve.solver.name.split(",")[0]
    order = case.convergence_order(method)
    asymptotic = [p for p in curve.points if p.steps >= case.end / case.problem.step - 0.5 and p.error < 0.1]
    if not asymptotic:
        hopeless = engine.METHODS[method].convergence_order == 1 or (case.stiff and "implicit" not in method)
        return [] if hopeless else [f"{case.problem.name}: {curve.solver.name} never has an error below 10 %."]
    first = asymptotic[0]
    return [
        f"{case.problem.name}: {curve.solver.name}, {p.steps} steps: error {p.error:.1e}, foretold {bound:.1e}."
        for p in asymptotic
        if p.error > (bound := 3 * first.error * (first.steps / p.steps) ** order + case.floor + left(case, method, p))
    ]


def left(case: Case, method: str, point: Point) -> float:
    """What the compressed memory and rounding may leave.

    ``gl`` of an order above 1 finds h^q f as the difference of far larger terms, so its memory's tolerance of 1e-10
    grows with the steps (as measured); ``pi2`` adds up f itself, and it does not.
    """
    above_one = engine.METHODS[method].family == "gl" and case.orders.max() > 1
    return (FLOOR_STIFF if case.stiff else FLOOR) + 1e-10 * point.steps * above_one


def beaten(case: Case, curves: list[Curve]) -> list[str]:
    """Points of peers that no point of ours matches in both error and time."""
    ours = {name: [p for c in curves if c.solver.package in name for p in c.points]
            for name in (("fracid",), ("fracid", "fracid core"))}  # fmt: skip
    found = []
    for curve in curves:
        rivals = ours["fracid", "fracid core"] if curve.solver.package == "plain loop" else ours[("fracid",)]
        for p in curve.points if not curve.solver.ours else ():
            if exact(curve) or not np.isfinite(p.error):
                continue
            if not any(q.error <= p.error and q.seconds <= max(p.seconds, CALL) for q in rivals):
                found.append(f"{case.problem.name}: {curve.solver.package} {curve.solver.name}, {p.steps} steps: error "
                             f"{p.error:.2e} in {1e3 * p.seconds:.3f} ms; fracid has {least(rivals, p.seconds):.2e} by "
                             f"then, and this error after {1e3 * time_to(rivals, p.error):.3f} ms.")  # fmt: skip
    return found


def exact(curve: Curve) -> bool:
    """Whether a scheme has no error, however large the step: its interpolant and the solution are the same."""
    return len(curve.points) > 2 and max(p.error for p in curve.points[:3]) < 1e-12


def least(points: list[Point], seconds: float) -> float:
    """The smallest error within a time."""
    return min((p.error for p in points if p.seconds <= seconds), default=np.inf)


def time_to(points: list[Point], error: float) -> float:
    """The shortest time [s] to an error."""
    return min((p.seconds for p in points if p.error <= error), default=np.inf)


def converges(curve: Curve) -> bool | None:
    """Whether the error goes on falling: the last by a third below one of the four before.

    None where the solver is too slow for more than one point.
    """
    errors = [p.error for p in curve.points][-5:]
    if len(errors) == 1:
        return None
    return bool(errors[-1] < max(1e-6, 0.67 * max(errors[:-1])))


# --- the page --------------------------------------------------------------------------------------


def machine() -> str:
    """The processor, cores, system, Python."""
    name = platform.processor() or platform.machine()
    with contextlib.suppress(OSError, StopIteration):
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        name = next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    return f"{name}, {os.cpu_count()} cores, {platform.system()}, Python {platform.python_version()}, {date.today()}"


def versions(*packages: str) -> str:
    def of(package: str) -> str:
        try:
            return f"{package} {version(package)}"
        except PackageNotFoundError:
            return f"{package} not installed"

    return ", ".join(map(of, packages))


def write_section(name: str, text: str) -> None:
    """Replace one generated section of the page, and leave the rest."""
    begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    page = PAGE.read_text() if PAGE.exists() else "# Work and precision\n"
    before, found, rest = page.partition(begin)
    after = rest.partition(end)[2] if found else "\n"
    PAGE.write_text(f"{before.rstrip()}\n\n{begin}\n{text.strip()}\n{end}{after}")


def milliseconds(seconds: float) -> str:
    return f"{1e3 * seconds:.3g} ms" if np.isfinite(seconds) else "–"


def page(results: dict[str, list[Curve]], budget: float, cold: list[str], failures: list[str]) -> str:
    return f"""
Generated by `make bench-peers` ([`benchmarks/work_precision.py`](../benchmarks/work_precision.py) says what is measured
and how). {machine()}. {versions("fracid", "numpy", "numba", *PACKAGES)}.
Every solver goes on halving its step until a call would take more than {budget:g} s (fracid: {budget / 3:.2g} s).

![Error against time on every problem](images/{PICTURE.name})

**The smallest error of any peer, and fracid's time to it.** {verdict(failures)}

{best_peer_table(results)}

*Times longer* is the peer's time over fracid's time to the same error.

**Peer by peer.** *Times longer*: median and range over all points of all problems that take {1e3 * CALL:g} ms or more.

{peer_table(results)}

{short_calls(results)}

**A first answer** in a new process, imports and compiling included, T1 in 1000 steps: {"; ".join(cold)}.

{refusals(results)}

{"".join(f"- {line}" + chr(10) for line in failures)}
"""


def verdict(failures: list[str]) -> str:
    """The claim with all its conditions, or how many of its checks fail."""
    if failures:
        return f"{len(failures)} points fail their check, of fracid's accuracy or against a peer; see below."
    return (
        "No point of a peer has a smaller error in the same time, within this budget, times below "
        f"{1e3 * CALL:g} ms counted as equal, and schemes that are exact left out (both below)."
    )


def best_peer_table(results: dict[str, list[Curve]]) -> str:
    rows = ["| problem | best peer | steps | error | its time | fracid's time to it | times longer | best of fracid |",
            "|---|---|--:|--:|--:|--:|--:|--:|"]  # fmt: skip
    for name, curves in results.items():
        ours = [p for c in curves if c.solver.package == "fracid" for p in c.points]
        peers = [c for c in curves if c.solver.package in PACKAGES and c.points and not exact(c)]
        best = min(ours, key=lambda p: p.error)
        mine = f"{best.error:.1e} in {milliseconds(best.seconds)}"
        if not peers:
            rows.append(f"| {name} | none solves it | | | | | | {mine} |")
            continue
        peer = min(peers, key=lambda c: c.best.error)
        there, time_here = peer.best, time_to(ours, peer.best.error)
        rows.append(
            f"| {name} | {peer.solver.package} {peer.solver.name} | {there.steps} | {there.error:.1e} | "
            f"{milliseconds(there.seconds)} | {milliseconds(time_here)} | {there.seconds / time_here:.0f} | {mine} |"
        )
    return "\n".join(rows)


def peer_table(results: dict[str, list[Curve]]) -> str:
    rows = ["| peer | solves | does not converge at these steps | one step only | refuses | times longer (range) |",
            "|---|--:|---|--:|--:|--:|"]  # fmt: skip
    for key in ((s.package, s.name) for s in solvers() if not s.ours):
        solved, diverging, slow, refused, ratios = 0, [], 0, 0, []
        for problem, curves in results.items():
            curve = next(c for c in curves if (c.solver.package, c.solver.name) == key)
            allowed = ("fracid", "fracid core") if key[0] == "plain loop" else ("fracid",)
            ours = [p for c in curves if c.solver.package in allowed for p in c.points]
            refused += bool(curve.refusal)
            if not curve.points:
                continue
            verdict = converges(curve)
            solved, slow = solved + (verdict is True), slow + (verdict is None)
            diverging += [problem] if verdict is False else []
            ratios += [p.seconds / time_to(ours, p.error) for p in curve.points
                       if p.seconds >= CALL and np.isfinite(p.error) and not exact(curve)]  # fmt: skip
        middle = f"{median(ratios):.3g} ({min(ratios):.2g}–{max(ratios):.0f})" if ratios else ""
        cells = (title(key), solved, ", ".join(diverging), slow or "", refused or "", middle)
        rows.append(f"| {' | '.join(map(str, cells))} |")
    return "\n".join(rows)


def title(key: tuple[str, str]) -> str:
    return key[1] if key[0] == "plain loop" else " ".join(key)


def short_calls(results: dict[str, list[Curve]]) -> str:
    """What the clause on short calls leaves out, and schemes without error."""
    least_call = {package: min(p.seconds for cs in results.values() for c in cs if c.solver.package == package
                               for p in c.points) for package in ("fracid", "fracid core")}  # fmt: skip
    loops = [c for cs in results.values() for c in cs if c.solver.package == "plain loop"]
    faster = [(p.steps, p.error) for c in loops for p in c.points if p.seconds < least_call["fracid core"]]
    said = [f"A call of `solve_fde` takes at least {1e3 * least_call['fracid']:.2f} ms, of its core "
            f"{1e3 * least_call['fracid core']:.2f} ms."]  # fmt: skip
    if faster:
        said.append(f"A compiled loop of one's own is faster than that up to {max(faster)[0]} steps; its error is then "
                    f"{min(faster, key=lambda f: f[1])[1]:.1e} or more.")  # fmt: skip
    said += [f"{title((c.solver.package, c.solver.name))} has no error on {problem}: its interpolant is the solution."
             for problem, cs in results.items() for c in cs if not c.solver.ours and c.points and exact(c)]  # fmt: skip
    return " ".join(said)


def refusals(results: dict[str, list[Curve]]) -> str:
    """What each package says of the problems that it does not take."""
    said = defaultdict(lambda: defaultdict(list))
    for problem, curves in results.items():
        for curve in curves:
            if curve.refusal:
                words = (curve.solver.package, curve.refusal)
                said[words][curve.solver.name].append(problem)
    lines = [
        f"- {package}: “{message}” on {'; '.join(f'{len(names)} problems ({solver})' for solver, names in who.items())}"
        for (package, message), who in said.items()
    ]
    lines.append(f"- pycaputo without `python -O`, ForwardEuler of order 1.8: “{alone(ORDER_ABOVE_ONE)[1]}”")
    return "**Refused**, in their own words:\n\n" + "\n".join(lines)


# --- the picture -----------------------------------------------------------------------------------

STYLES = {
    "pycaputo": {"color": "#E69F00", "lw": 0.8, "marker": "o", "ms": 2},
    "pycaputo, graded": {"color": "#D55E00", "lw": 0.8, "marker": "o", "ms": 2},
    "fdeint": {"color": "#CC79A7", "lw": 1, "marker": "^", "ms": 3},
    "fodeint": {"color": "#999999", "lw": 1, "marker": "v", "ms": 3},
    "numfracpy": {"color": "#B8A800", "lw": 1, "marker": "D", "ms": 2.5},
    "plain GL loop, compiled": {"color": "black", "lw": 1, "marker": "s", "ms": 2},
    "fracid gl": {"color": "#009E73", "lw": 1.2, "ls": "--"},
    "fracid pi2, full memory": {"color": "#56B4E9", "lw": 1.6},
    "fracid pi2-implicit": {"color": "#0072B2", "lw": 1.6, "ls": ":"},
    "fracid pi2": {"color": "#0072B2", "lw": 2.2},
    "fracid pi3": {"color": "#004D7A", "lw": 2.2, "ls": "-."},
}
"""Okabe and Ito's colours, which the colour-blind tell apart; drawn in this order."""


def _style(solver: Solver) -> str | None:
    named = {"pi2, compressed": "fracid pi2", "pi2, full": "fracid pi2, full memory", "gl, compressed": "fracid gl",
             "pi2-implicit, compressed": "fracid pi2-implicit", "pi3, compressed": "fracid pi3"}  # fmt: skip
    if solver.ours:
        return named.get(solver.name) if solver.package == "fracid" else None
    if solver.package == "plain loop":
        return solver.name
    graded = solver.package == "pycaputo" and "graded" in solver.name
    return "pycaputo, graded" if graded else solver.package if solver.package in STYLES else None


def draw(results: dict[str, list[Curve]]) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    columns = 4
    rows = -(-len(results) // columns)
    figure, axes = plt.subplots(rows, columns, figsize=(11, 2.3 * rows + 0.7), sharex=True, sharey=True,
                                layout="constrained", squeeze=False)  # fmt: skip
    handles = {}
    for axis, (name, curves) in zip(axes.flat, results.items(), strict=False):
        for label in STYLES:
            for curve in curves:
                points = [p for p in curve.points if p.error < 2]
                if _style(curve.solver) == label and points:
                    (handles[label],) = axis.loglog(
                        [p.seconds for p in points], [p.error for p in points], **STYLES[label]
                    )
        axis.set_title(name, fontsize=9, pad=3)
        axis.grid(color="#DDDDDD", lw=0.5)
        axis.tick_params(labelsize=8)
    for axis in axes.flat[len(results) :]:
        axis.set_visible(False)
    for axis in axes.flat[max(0, len(results) - columns) : len(results)]:  # the lowest of each column
        axis.tick_params(labelbottom=True)
    axes.flat[0].set(xlim=(3e-5, 1.0), ylim=(1e-12, 2.0))
    figure.supxlabel("time of a warm call, setup included [s]", fontsize=9)
    figure.supylabel("largest relative error at the known times", fontsize=9)
    figure.legend([handles[k] for k in reversed(STYLES) if k in handles], [k for k in reversed(STYLES) if k in handles],
                  loc="outside upper center", ncols=5, fontsize=8, frameon=False)  # fmt: skip
    PICTURE.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(PICTURE, dpi=110)


# --- the program -----------------------------------------------------------------------------------


T1_ALONE = {
    "fracid": """
import fracid
def f(t, x, u, p, out):
    out[0] = -x[0]
fracid.solve_fde(f, 0.8, [1.0], step=0.02, end=20.0)
""",
    "pycaputo": """
import numpy as np
from pycaputo.controller import make_fixed_controller
from pycaputo.derivatives import CaputoDerivative
from pycaputo.fode.caputo import PECE
from pycaputo.stepping import evolve
method = PECE(ds=(CaputoDerivative(0.8),), control=make_fixed_controller(0.02, nsteps=1000), source=lambda t, y: -y,
              y0=(np.array([1.0]),), corrector_iterations=1)
for event in evolve(method, dtinit=0.02):
    pass
""",
    "fdeint": """
import torch
from FDEint import FDEint
t = 0.02 * torch.arange(1001, dtype=torch.float64)
FDEint(lambda t, y: -y, t, torch.ones(1, dtype=torch.float64), 0.8, dtype=torch.float64)
""",
    "fodeint": """
import numpy as np
from fodeint import fodeint
fodeint(0.8, lambda y, t: -y, np.array([1.0]), np.linspace(0, 20, 1001))
""",
}
"""T1 as a user of each package writes it."""

ORDER_ABOVE_ONE = (
    T1_ALONE["pycaputo"]
    .replace("PECE", "ForwardEuler")
    .replace("0.8", "1.8")
    .replace("(np.array([1.0]),), corrector_iterations=1", "(np.array([0.5]), np.array([0.0]))")
)


def first_answers() -> list[str]:
    """Wall-clock times of T1_ALONE, the second of two runs; fracid's with an empty cache of compiled loops too."""
    answers = [f"{name} {[alone(code)[0] for _ in range(2)][1]:.1f} s" for name, code in T1_ALONE.items()]
    with tempfile.TemporaryDirectory() as folder:
        first_ever = alone(T1_ALONE["fracid"], NUMBA_CACHE_DIR=folder)[0]
    return [*answers, f"fracid the first time ever on a machine, when it compiles its loops, {first_ever:.0f} s"]


def alone(code: str, **environment: str) -> tuple[float, str]:
    """Run some code in a process of its own: wall-clock seconds, last line of what went wrong."""
    start = time.perf_counter()
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False,
                            env={**os.environ, **environment})  # fmt: skip
    return time.perf_counter() - start, (answer.stderr.strip().splitlines() or ["nothing wrong"])[-1]


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--budget", type=float, default=0.15, help="longest call of a peer [s]; 10 takes an hour")
    arguments.add_argument("--only", nargs="*", help="names of problems, such as T1; writes no page")
    given = arguments.parse_args()
    warnings.simplefilter("ignore")  # peers overflow where they are unstable
    if __debug__:
        print("Type python -O: without it pycaputo takes no order above 1, and is slower.")
    results, failures, inaccurate, started = {}, [], [], time.perf_counter() - time.process_time()
    for problem in all_problems():
        if given.only and problem.name not in given.only:
            continue
        case = Case(problem)
        curves = results[problem.name] = measure(case, solvers(), given.budget)
        gc.collect()
        inaccurate += [line for c in curves if c.solver.ours for line in too_inaccurate(case, c)]
        failures += beaten(case, curves)
        show(problem.name, curves)
    if not given.only:
        draw(results)
        write_section("work-precision", page(results, given.budget, first_answers(), failures + inaccurate))
    print(*inaccurate, *failures, sep="\n")
    share = 100 * time.process_time() / (time.perf_counter() - started)
    print(
        f"\nThis process had {share:.0f} % of a processor. {len(inaccurate)} points of fracid less accurate than "
        f"foretold, {len(failures)} of peers not matched."
    )
    sys.exit(bool(inaccurate or failures))


def show(problem: str, curves: list[Curve]) -> None:
    for c in curves:
        last = c.points[-1] if c.points else None
        orders = [np.log2(a.error / b.error) for a, b in zip(c.points, c.points[1:], strict=False) if b.error > 1e-9][
            -1:
        ]
        said = (f"{last.steps:>9} steps {1e3 * last.seconds:>9.3f} ms  error {last.error:.1e}  order "
                f"{orders[0] if orders else np.nan:5.2f}" if last else f"refused: {c.refusal}")  # fmt: skip
        note = "  DOES NOT CONVERGE" if last and not c.solver.ours and converges(c) is False else ""
        print(f"{problem:<16} {c.solver.package:<12} {c.solver.name:<26} {said}{note}", flush=True)


if __name__ == "__main__":
    main()
