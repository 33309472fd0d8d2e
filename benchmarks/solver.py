"""How fast the solver is, as ratios measured side by side in this process:  make bench

A *run* is a rotary pendulum of 4 states released from 10°, 20,000 steps of 1 ms, kernels built anew as in a
fit, compressed memory.  Times are of warm runs, taken in turn with what they are held against: the median of
the faster half of them, since other programs only ever add.  A bar that is not met is only said; the exit
code is 1 if an accuracy check fails.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import time
import tracemalloc
from collections.abc import Callable
from functools import partial
from statistics import median

import numba as nb
import numpy as np
import plain

import fracid
from fracid.models import RIGS
from fracid.optimise import OPTIMISERS, minimise
from fracid.problem import Experiment, Free, Problem
from fracid.problem.costs import COSTS
from fracid.solver.arguments import Equation, InitialCondition, Options
from fracid.solver.compilation import RHS_SIGNATURE
from fracid.solver.memory import compressed, full
from fracid.solver.operators import gl_weights
from fracid.solver.right_hand_side import compile_rhs
from fracid.solver.solve import integrate

STEP, STEPS = 1e-3, 20_000
PI2 = Options("pi2", compressed())
ORDERS = np.array([0.8623, 0.8623, 0.9146, 0.9146])
START = np.array([0.0, 0.0, np.radians(10), 0.0])
VISCOUS = {"C1": 2.2e-3, "C3": 1.6e-3, "C4": 0.127 * 9.81 * 0.15, "C6": 2.18e-3, "J_theta": 4.02e-3,
           "b_theta": 1.5e-3, "b_alpha": 5e-4}  # fmt: skip
MODELS = {
    "viscous friction": fracid.rotary_pendulum("srv02-rotpen", **VISCOUS),
    "SRV02, Coulomb friction": fracid.rotary_pendulum("srv02-rotpen", **RIGS["srv02-rotpen"].fitted_friction),
}
EVALUATIONS = {"gl": 1, "pi2": 2}  # of the right-hand side a step, with one corrector sweep


class Run:
    """Runs of one model; each call has orders of its own, or its kernels would be known already."""

    def __init__(self, model: fracid.models.Model) -> None:
        self.rhs, self.p, self.u = compile_rhs(model.rhs), model.parameter_vector(None), np.zeros((1, 1))
        self.count = 0

    def __call__(self, method: str, memory=compressed(), steps: int = STEPS, orders=None) -> np.ndarray:  # noqa: B008
        self.count += 1
        q = ORDERS + 1e-9 * self.count if orders is None else orders
        equation = Equation(self.rhs, q, self.u, self.p)
        return integrate(equation, InitialCondition(START), STEP, steps, Options(method, memory)).states

    def plain(self, orders: np.ndarray, loop: Callable) -> np.ndarray:
        weights = np.array([gl_weights(q, STEPS + 1) for q in orders])
        reversed_weights, slope = weights[:, ::-1].copy(), np.zeros(len(START))
        return loop(self.rhs, START, slope, STEP**orders, reversed_weights, self.u[0], self.p, STEP, STEPS)


@nb.njit(nogil=True, error_model="numpy")
def bare(rhs, states, u, p, times):
    """Evaluate f at a run's own states, and nothing else."""
    x, f = np.zeros(states.shape[1]), np.zeros(states.shape[1])
    for n in range(len(states) - 1):
        for _ in range(times):
            for i in range(len(x)):
                x[i] = states[n, i]
            rhs(n * STEP, x, u, p, f)


@nb.njit(nogil=True, error_model="numpy")
def euler(rhs, x0, u, p, out):
    """Forward Euler, without memory: the least that a solver can do, each f waiting for the one before."""
    x, f = x0.copy(), np.zeros(len(x0))
    for n in range(len(out)):
        for i in range(len(x)):
            out[n, i] = x[i]
        rhs(n * STEP, x, u, p, f)
        for i in range(len(x)):
            x[i] += STEP * f[i]


# --- measuring -------------------------------------------------------------------------------------


def times_of(*calls: Callable[[], object], repeat: int) -> list[float]:
    """Typical times [s] of some calls, taken in turn; the first round warms up."""
    times = np.array([[_timed(call) for call in calls] for _ in range(repeat + 1)])[1:]
    return [median(column[: (repeat + 1) // 2]) for column in np.sort(times, axis=0).T]


def _timed(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def row(what: str, measured: str, bar: str = "", met: bool | None = None) -> None:
    print(f"{what:<64} {measured:>22}  {bar:<10} {'' if met is None else 'met' if met else 'NOT MET'}", flush=True)


def at_most(what: str, value: float, bar: float, more: str = "") -> None:
    row(what, f"{value:.2f} x{more}", f"<= {bar:g} x", value <= bar)


def check(what: str, error: float, bound: float) -> None:
    """An accuracy that must hold."""
    row(f"  {what}", f"{error:.1e}", f"<= {bound:g}", error <= bound)
    if not error <= bound:
        sys.exit(f"FAILED: {what}: {error:.1e} is above {bound:g}.")


def difference(a: np.ndarray, b: np.ndarray) -> float:
    """Largest difference of two trajectories, relative to the largest value of each state."""
    return float((np.abs(a - b).max(axis=0) / np.abs(a).max(axis=0)).max())


# --- the rows --------------------------------------------------------------------------------------


def against_the_right_hand_side(name: str, run: Run) -> None:
    states = np.ascontiguousarray(run("pi2"))
    f, args = run.rhs, (run.u[0], run.p)
    gl, pi2, f_gl, f_pi2, least = times_of(
        lambda: run("gl"), lambda: run("pi2"),
        lambda: bare(f, states, *args, EVALUATIONS["gl"]), lambda: bare(f, states, *args, EVALUATIONS["pi2"]),
        lambda: euler(f, START, *args, np.empty_like(states)), repeat=40,
    )  # fmt: skip
    print(f"\n{name}: gl {1e3 * gl:.2f} ms, pi2 {1e3 * pi2:.2f} ms, f alone {1e9 * f_gl / STEPS:.0f} ns a call")
    at_most("pi2 / its 40,000 evaluations of f", pi2 / f_pi2, 3)
    at_most("gl / its 20,000 evaluations of f", gl / f_gl, 3)
    row("gl / forward Euler, which has no memory", f"{gl / least:.2f} x")
    at_most("pi2 / gl", pi2 / gl, 2)
    finer = integrate(Equation(f, ORDERS, run.u, run.p), InitialCondition(START), STEP / 4, 4 * STEPS, PI2)
    angles = [0, 2]
    error = np.abs(finer.states[::4, angles] - run("pi2", orders=ORDERS)[:, angles]).max()
    check("pi2: angles against those of a step of a quarter [rad]", error, 1e-4)


def against_full_memory(name: str, run: Run) -> None:
    print(f"\nCompressed against full memory, {name}")
    loops = [lambda loop=loop: run.plain(ORDERS, loop) for loop in (plain.in_order, plain.reordered)]
    short, in_order, reordered = times_of(lambda: run("gl"), *loops, repeat=5)
    row("gl: plain compiled loop over all the past / compressed", f"{in_order / short:.0f} x", ">= 100 x",
        in_order >= 100 * short)  # fmt: skip
    row("gl: the same, its sums reordered for vector registers / compressed", f"{reordered / short:.0f} x")
    check(
        "gl: difference of the trajectories",
        difference(run.plain(ORDERS, plain.reordered), run("gl", orders=ORDERS)),
        1e-9,
    )
    for method in EVALUATIONS:
        kept, whole = times_of(lambda m=method: run(m), lambda m=method: run(m, full()), repeat=5)
        row(f"{method}: fracid's own full memory, 8 steps at a time / compressed", f"{whole / kept:.0f} x")
        check(f"{method}: difference of the trajectories",
              difference(run(method, full(), orders=ORDERS), run(method, orders=ORDERS)), 1e-9)  # fmt: skip


def long_runs(run: Run) -> None:
    print("\nA million steps")
    for method in EVALUATIONS:
        usual, long = times_of(lambda m=method: run(m), lambda m=method: run(m, steps=1_000_000), repeat=5)
        at_most(f"{method}: time of 10^6 steps / of 2*10^4", long / usual, 70)
    answer = subprocess.run([sys.executable, __file__, "--memory"], capture_output=True, text=True, check=True)
    peak, arrays = map(float, answer.stdout.split())
    at_most(f"pi2: peak memory / output arrays ({arrays / 1e6:.0f} MB), own process", peak / arrays, 1.25)


def print_memory(steps: int = 1_000_000) -> None:
    """Peak over what there was before the run: NumPy's own count, or the process's if that is more."""
    run = Run(MODELS["viscous friction"])
    run("pi2")
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    unit = 1 if sys.platform == "darwin" else 1024
    tracemalloc.start()
    states = run("pi2", steps=steps)
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * unit
    print(max(tracemalloc.get_traced_memory()[1], grown), states.nbytes + 8 * len(states))


def a_derivative(run: Run) -> None:
    print("\nOne derivative more, with respect to the first parameter")
    f, p, e = run.rhs, run.p, 1e-7

    def variational(t, y, u, p, out):
        f(t, y[:4], u, p, out[:4])
        x, g = np.empty(4), np.empty(4)
        for i in range(4):
            x[i] = y[i] + e * y[4 + i]
        p[0] += e
        f(t, x, u, p, g)
        p[0] -= e
        for i in range(4):
            out[4 + i] = (g[i] - out[i]) / e

    along = nb.njit(RHS_SIGNATURE, error_model="numpy", nogil=True)(variational)
    start, orders = np.r_[START, np.zeros(4)], np.r_[ORDERS, ORDERS]

    def augmented() -> np.ndarray:
        return integrate(Equation(along, orders, run.u, p.copy()), InitialCondition(start), STEP, STEPS, PI2).states

    alone, both = times_of(lambda: run("pi2", orders=ORDERS), augmented, repeat=20)
    row("variational equation, f differenced / a run", f"{(both - alone) / alone:.2f} x")
    exact = fracid.sensitivities(f, ORDERS, START, parameters=p, step=STEP, end=STEP * STEPS, inputs=run.u)
    check("difference from fracid.sensitivities, relative",
          difference(augmented()[:, 4:], exact.parameters[:, :, 0]), 1e-3)  # fmt: skip


LUGRE = {
    "C1": 4.369e-3, "C3": 3.892e-3, "C6": 3.483e-3, "J_theta": 1.037e-2, "b_theta": 0.1099, "b_alpha": 4.71e-4,
    "coulomb_theta": 0.0316, "coulomb_alpha": 0.0, "stiction_theta": 0.067, "stribeck_speed_theta": 0.0333,
    "presliding_theta": 8.16e-3, "stiction_alpha": 1.47e-4, "stribeck_speed_alpha": 0.68, "presliding_alpha": 0.0788,
    "presliding_damping_alpha": 9.52e-4, "cable_stiffness": 3.7e-3,
}  # fmt: skip
"""An SRV02's joints, as found on a release from 92° at orders 1."""

FINE = np.radians(0.0127)
"""Rms of α's error that both stay below: half of what rounding to 4096 counts leaves."""


def presliding() -> None:
    """A release of 17,500 samples with LuGre friction in both joints against tanh, each at the step that it needs."""
    tanh = {n: v for n, v in LUGRE.items() if not n.startswith(("presliding", "sti", "stri"))} | {"coulomb_alpha": 2e-4}

    def runs(parameters):
        model = fracid.rotary_pendulum("srv02-rotpen", **parameters)
        rhs, p, start = compile_rhs(model.rhs), model.parameter_vector(), np.zeros(len(model.states))
        start[2] = np.radians(92)

        def run(substeps: int) -> np.ndarray:
            equation = Equation(rhs, np.ones(len(start)), np.zeros((1, 1)), p, relaxing=model.relaxing_states)
            return integrate(equation, InitialCondition(start), 2e-3 / substeps, 17_500 * substeps, PI2).states[
                ::substeps, 2
            ]

        exact = run(64)
        errors = {k: float(np.sqrt(np.mean((run(k) - exact) ** 2))) for k in (1, 2, 3, 4, 6, 8, 12, 16)}
        substeps = min(k for k, error in errors.items() if error < FINE)
        return substeps, partial(run, substeps)

    (n, rich), (m, plain_friction) = runs(LUGRE), runs(tanh)
    a, b = times_of(rich, plain_friction, repeat=15)
    at_most("SRV02, LuGre in both joints / tanh, equally accurate", a / b, 3.0, f"{n} and {m} steps a sample")


def the_papers_search() -> None:
    print("\nThe paper's genetic algorithm: 520 runs of 20,001 samples, gl-paper, ITAE on alpha, 2 threads")
    twin = fracid.simulate(MODELS["viscous friction"], orders=ORDERS, initial=START, step=STEP, end=STEP * STEPS)
    recording = Experiment("twin", STEP, twin.states[:, [2]].copy(), np.zeros((1, 1)))
    free = {name: Free(1.0, 0.5, 1.2) for name in ("lambda", "mu")}
    problem = Problem(MODELS["viscous friction"], (recording,), free, cost_function=COSTS["itae"], outputs=("alpha",),
                      initial_state="held", method="gl-paper")  # fmt: skip
    results = []

    def search() -> None:
        genetic = OPTIMISERS["genetic"].function(problem.space, np.random.default_rng(1))
        results.append(minimise(problem.evaluate, genetic, jobs=2))

    (seconds,) = times_of(search, repeat=3)
    row("the whole search", f"{seconds:.2f} s", "<= 1 s", seconds <= 1)
    check("evaluations other than 520", abs(results[-1].evaluations - 520), 0)
    check("cost of the best point against another search of the same seed",
          abs(results[-1].best.cost / results[0].best.cost - 1), 0)  # fmt: skip


def main() -> None:
    if "--memory" in sys.argv:
        print_memory()
        return
    runs = {name: Run(model) for name, model in MODELS.items()}
    print(f"{'what':<64} {'measured':>22}  {'bar':<10}")
    for name, run in runs.items():
        against_the_right_hand_side(name, run)
    name, run = next(iter(runs.items()))
    against_full_memory(name, run)
    long_runs(run)
    a_derivative(run)
    presliding()
    the_papers_search()


if __name__ == "__main__":
    main()
