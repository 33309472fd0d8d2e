"""Long runs: time, memory and error at 10⁴ to 10⁷ steps:  make scaling  (a minute; takes 1 GB)

Two problems, ``pi2`` and ``gl``, each run in a process of its own:

``pendulum``    T33, the rotary pendulum, 4 states of 2 orders: 5 s in ever finer steps, against the known solution
``relaxation``  D^q x = −x, q = 0.5, 0.8, 0.95 and 1.2, x(0) = 1: ever longer at a step of 10 ms, up to 10⁵ s, against
                the Mittag-Leffler function E_q(−t^q) at the end: a slow decay, all of it memory

*Error* is relative to the largest known value of the state for the pendulum, absolute for the relaxation (which
starts at 1).  *Memory's error* is the largest difference, at any step, from full memory up to 10⁵ steps, and from a
tolerance of 10⁻¹³ beyond, relative to the state's largest value.  *Peak* is what the process grew by over the arrays
that are returned.  Times are processor time.  The exit code is 1 if an error or the peak is above its bound:

- the error of the pendulum: three times what the convergence order foretells from 10⁴ steps;
- the error of the relaxation: three times what it is at 100 s, falling as 1/t, since the start's error is forgotten
  faster than that, and 10⁻¹⁰ from the memory;
- memory's error: 10⁻⁹; for ``gl`` 10⁻⁸, and as much again each 10⁷ steps, since it finds h^q f as a difference of
  terms that are the larger the smaller the step (as measured, and far below its own error);
- peak: 1.25 times the arrays, from 10⁶ steps on.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import time
from dataclasses import asdict, dataclass

import numpy as np
from scipy.special import rgamma
from work_precision import Case, machine, versions, write_section  # beside this file; knows where the tests are

import fracid
from oracles.problems import T33, FractionalProblem

SIZES = (10_000, 100_000, 1_000_000, 10_000_000)
FULL = 100_000
"""Steps up to which full memory is run too: it takes their square."""

PEAK, LARGE = 1.25, 1_000_000
"""The bound on the peak, and the steps from which on it means something."""


def _decay(t, x, u, p, out):  # noqa: ARG001
    for i in range(len(out)):
        out[i] = -x[i]


RELAXATION_STEP = 1e-2


def relaxation(end: float) -> FractionalProblem:
    orders = (0.5, 0.8, 0.95, 1.2)
    at_end = tuple(mittag_leffler_far(q, end) for q in orders)
    return FractionalProblem("relaxation", _decay, orders, ((1.0, 0.0),) * 4, {end: at_end}, step=RELAXATION_STEP)


def mittag_leffler_far(q: float, t: float) -> float:
    """E_q(−t^q) = −Σ (−t^q)^(−k) / Γ(1 − q k), its asymptotic series: to the last digit from t = 100 on."""
    k = np.arange(1, 21)
    return float(-np.sum((-(t**-q)) ** k * rgamma(1 - q * k)))


@dataclass(frozen=True)
class Row:
    """What one run of one process gives."""

    problem: str
    method: str
    memory: str
    steps: int
    seconds: float
    error: float
    memory_error: float
    """Of the compressed memory; 0 for the full."""
    peak: float
    """Growth of the process over the arrays returned; it means something from some 100 MB on."""


# --- one run, in a process of its own --------------------------------------------------------------


def run(problem: str, method: str, memory: str, steps: int) -> Row:
    case = Case(T33 if problem == "pendulum" else relaxation(RELAXATION_STEP * steps))

    def solve(n: int, tolerance: float = 1e-10, memory: str = memory) -> fracid.Trajectory:
        given = case.problem
        return fracid.solve_fde(given.rhs, given.orders, given.initial, parameters=given.parameters, method=method,
                                memory=memory, tolerance=tolerance, step=case.end / n, end=case.end)  # fmt: skip

    solve(1000)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    times = []
    for _ in range(5 if steps < 1_000_000 and memory == "compressed" else 1):
        start = time.process_time()
        trajectory = solve(steps)
        times.append(time.process_time() - start)
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * (1 if sys.platform == "darwin" else 1024)
    arrays = trajectory.states.nbytes + trajectory.time.nbytes
    if problem == "pendulum":
        error = case.error((trajectory.time, trajectory.states))
    else:
        error = float(np.abs(trajectory.states[-1] - case.known[1][-1]).max())
    memory_error = 0.0
    if memory == "compressed":
        other = solve(steps, memory="full") if steps <= FULL else solve(steps, 1e-13)
        largest = np.abs(other.states).max(axis=0)
        memory_error = max(
            float((np.abs(a - b).max(axis=0) / largest).max())
            for a, b in zip(np.array_split(trajectory.states, 64), np.array_split(other.states, 64), strict=True)
        )
    return Row(problem, method, memory, steps, min(times), error, memory_error, grown / arrays)


def in_a_process(*what: str | int) -> Row:
    answer = subprocess.run([sys.executable, __file__, "--run", *map(str, what)], capture_output=True, text=True,
                            check=False)  # fmt: skip
    if answer.returncode:
        sys.exit(answer.stderr)
    return Row(**json.loads(answer.stdout))


# --- all of them -----------------------------------------------------------------------------------


def foretold(row: Row, first: Row) -> float:
    """Bound on the error, from the run of 10⁴ steps."""
    if row.problem == "relaxation":
        return 3 * first.error * first.steps / row.steps + 1e-10
    case = Case(T33)
    return 3 * first.error * (first.steps / row.steps) ** case.convergence_order(row.method) + 1e-9 + case.floor


def failures(rows: list[Row]) -> list[str]:
    found = []
    for row in rows:
        first = next(r for r in rows if (r.problem, r.method, r.memory) == (row.problem, row.method, row.memory))
        bounds = {
            "error": (row.error, foretold(row, first)),
            "memory's error": (row.memory_error, 1e-8 * (1 + row.steps / 1e7) if row.method == "gl" else 1e-9),
            "peak": (row.peak if row.steps >= LARGE else 0.0, PEAK),
        }
        found += [
            f"{row.problem}, {row.method}, {row.memory}, {row.steps} steps: {what} {value:.2e} is above {bound:.2e}."
            for what, (value, bound) in bounds.items()
            if not value <= bound
        ]
    return found


def table(rows: list[Row]) -> str:
    lines = ["| problem | method | memory | steps | time | a step | error | memory's error | peak |",
             "|---|---|---|--:|--:|--:|--:|--:|--:|"]  # fmt: skip
    for r in rows:
        spent = f"{1e3 * r.seconds:.1f} ms" if r.seconds < 1 else f"{r.seconds:.2f} s"
        kept = f"{r.memory_error:.0e}" if r.memory == "compressed" else ""
        peak = f"{r.peak:.2f} ×" if r.steps >= LARGE else ""
        lines.append(f"| {r.problem} | {r.method} | {r.memory} | 10^{round(np.log10(r.steps))} | {spent} | "
                     f"{1e9 * r.seconds / r.steps:.0f} ns | {r.error:.1e} | {kept} | {peak} |")  # fmt: skip
    return "\n".join(lines)


def page(rows: list[Row], failed: list[str]) -> str:
    return f"""
## Long runs

Generated by `make scaling` ([`benchmarks/scaling.py`](../benchmarks/scaling.py) says what is measured and how, and what
must hold: {"it does" if not failed else "see below"}). {machine()}. {versions("fracid", "numpy", "numba")}.
*pendulum*: 5 s of T33 in ever finer steps. *relaxation*: four orders, ever longer at 10 ms a step, up to 28 hours.

{table(rows)}

The pendulum's solution is known to {Case(T33).floor:.0e}.

{chr(10).join(f"- {line}" for line in failed)}
"""


def main() -> None:
    if "--run" in sys.argv:
        problem, method, memory, steps = sys.argv[-4:]
        print(json.dumps(asdict(run(problem, method, memory, int(steps)))))
        return
    rows = [
        in_a_process(problem, method, memory, steps)
        for problem in ("pendulum", "relaxation")
        for method in ("pi2", "gl")
        for memory in ("full", "compressed")
        for steps in SIZES
        if memory == "compressed" or steps <= FULL
    ]
    failed = failures(rows)
    print(table(rows), *failed, sep="\n")
    write_section("scaling", page(rows, failed))
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()
