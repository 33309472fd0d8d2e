"""Does fracid claim only what is so of models that users write?  Twins of own models, made without fracid.

    python benchmarks/own_models.py                  # 126 of integer order, 48 fractional: some minutes
    python benchmarks/own_models.py --draws 3        # three times as many
    python benchmarks/own_models.py --kinds lumps    # by name; or integer, fractional

Each user's model has one free order.  The truth of integer order has one to three time constants more than that model:
a body with further lumps behind it, a wall that heat creeps into, a ladder of resistors and capacitors, a mass or a
stretched strip on Maxwell elements; or a spring that hardens, a fluid that drags.  The fractional truth is the user's
model with an order of 0.5, 0.7 or 0.9.  SciPy integrates all: of linear truths by a matrix exponential, which is exact,
an order's kernel as a sum of a hundred decaying exponentials.  Noise is 1 to 30 % of the motion, of fractional truths
1 to 5 %, white, or coloured by an AR(0.95) or a low-pass of 30 ms (2 and 3 %).

=================  =======================================================
truth              bar
=================  =======================================================
of integer order   never "fractional"
fractional         "fractional" for 95 % of those that the recording tells
=================  =======================================================

A recording tells an order where the best two relaxations miss the truth itself, without its noise, by more than 10 in
−2 log L of that noise, as SciPy finds without fracid.  Where they miss it by less the noise hides the difference, and a
claim would stand on the number of parameters alone.  Counted beside it: orders that are determined, whose 95 % interval
is narrower than half their distance to their integers.
"""

from __future__ import annotations

import argparse
import math
import time
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares
from scipy.signal import cont2discrete, dlsim, lfilter

import fracid
from fracid import Experiment, Free, Model, Parameter, Problem
from fracid.models.joints import Complement, springpot
from fracid.tasks.job import Task
from fracid.tasks.tasks import run_tasks

POWER = 0.95
TOLD = 10.0
COLOURED = (("AR", 0.02), ("30 ms", 0.03))
"""Noises, in parts of the motion."""

OF_INTEGER = (("white", 0.01), ("white", 0.05), ("white", 0.1), ("white", 0.3), *COLOURED)
OF_FRACTIONAL = (("white", 0.01), ("white", 0.05), *COLOURED)

# --- the users' models -------------------------------------------------------------------------------------------


def body_rhs(t, x, u, p, out):  # noqa: ARG001
    out[0] = (u[0] - p[1] * x[0]) / p[0]


def cell_rhs(t, x, u, p, out):  # noqa: ARG001
    out[0] = u[0] / p[0]


def terminals(t, x, u, p):  # noqa: ARG001
    return x[0] + p[1] * u[0]


def mass_rhs(t, x, u, p, out):  # noqa: ARG001
    out[0] = x[1]
    out[1] = u[0] - p[0] * x[0] - springpot(x, out, 2, x[1], p[1])


def strip_rhs(t, x, u, p, out):  # noqa: ARG001
    springpot(x, out, 0, u[1], p[1])


def strip_force(t, x, u, p):  # noqa: ARG001
    return p[0] * u[0] + p[1] * x[0]


def _constant(name, value):
    return Parameter(name, "1", value, name, lower=0.0)


BODY = Model("body", body_rhs, ("T",), ("q",), {"T": 0}, ("power",),
             (_constant("C", 1.0), _constant("h", 0.3)), "", "a twin")  # fmt: skip
CELL = Model("cell", cell_rhs, ("v",), ("q",), {"V": terminals}, ("current",),
             (_constant("C", 1.0), _constant("R", 0.3)), "", "a twin")  # fmt: skip
MASS = Model("mass", mass_rhs, ("x", "v", "y"), (1.0, 1.0, Complement("nu")), {"x": 0}, ("force",),
             (_constant("k", 10.0), _constant("c", 1.0)), "", "a twin")  # fmt: skip
STRIP = Model("strip", strip_rhs, ("y",), (Complement("nu"),), {"force": strip_force}, ("stretch", "speed"),
              (_constant("k", 1.0), _constant("c", 1.0)), "", "a twin", input_rates={"speed": "stretch"})  # fmt: skip

# --- truths: x' = A x + B u, y = C x + D u -----------------------------------------------------------------------


@dataclass(frozen=True)
class Seen:
    """What is measured, and who looks at it."""

    y: np.ndarray
    model: Model
    order: str
    integers: tuple[float, ...]
    inputs: np.ndarray
    step: float


def seen(A, B, C, D, model, order, integers, inputs, step):
    """A linear system from rest, its inputs straight lines between samples."""
    A, B, C, D, _ = cont2discrete((A, B, C, D), step, method="foh")
    _, y, _ = dlsim((A, B, C, D, step), inputs)
    return Seen(y, model, order, integers, inputs, step)


def memory(q, step, end):
    """Weights and rates of Σ w e^(−s t) = t^(q−1)/Γ(q) from a millionth of a step to a hundred records."""
    spacing = 0.25
    s = np.exp(np.arange(math.log(1e-2 / end), math.log(1e6 / step), spacing))
    w = math.sin(math.pi * q) / math.pi * spacing * s ** (1 - q)
    rest = math.sin(math.pi * q) / math.pi * (s[0] * math.exp(-spacing / 2)) ** (1 - q) / (1 - q)
    return np.array([rest, *w]), np.array([0.0, *s])


def chain(couplings, capacities, loss):
    """Lumps in a row, the first heated: A, B of its temperatures."""
    n = len(capacities)
    A = np.zeros((n, n))
    A[0, 0] = -loss / capacities[0]
    for k, g in enumerate(couplings):
        for a, b in ((k, k + 1), (k + 1, k)):
            A[a, a] -= g / capacities[a]
            A[a, b] += g / capacities[a]
    B = np.zeros((n, 1))
    B[0, 0] = 1 / capacities[0]
    return A, B


def steps_of(rng, count, pieces=4):
    """An input that is switched a few times."""
    edges = np.sort(rng.choice(np.arange(1, count - 1), pieces, replace=False))
    levels = np.concatenate([[0.0], rng.uniform(-1, 1, pieces) + 0.5])
    return levels[np.searchsorted(edges, np.arange(count), side="right")][:, None]


def lumps(rng, more):
    """A body with weaker lumps behind it."""
    step, count = 0.1, 600
    C = [1.0, *rng.uniform(0.1, 0.6, more)]
    g = rng.uniform(0.05, 0.5, more)
    A, B = chain(g, C, rng.uniform(0.05, 0.3))
    return seen(A, B, np.eye(1, len(A)), np.zeros((1, 1)), BODY, "q", (1.0,), steps_of(rng, count), step)


def wall(rng, more):
    """A body with a wall of thirty layers, as thick as heat gets in some time."""
    step, count, n = 0.1, 600, 30
    seconds, capacity = rng.uniform(0.5, 5.0) * more, rng.uniform(0.2, 1.0)
    g = capacity * n / seconds
    A, B = chain([2 * g, *(g for _ in range(n - 1))], [1.0, *(capacity / n for _ in range(n))],
                 rng.uniform(0.05, 0.3))  # fmt: skip
    return seen(A, B, np.eye(1, n + 1), np.zeros((1, 1)), BODY, "q", (1.0,), steps_of(rng, count), step)


def ladder(rng, more):
    """A cell with sections of resistor and capacitor behind its first capacitor, and a resistor before it."""
    step, count = 0.1, 800
    A, B = chain(1 / rng.uniform(1.0, 8.0, more), [1.0, *rng.uniform(0.1, 0.8, more)], 0.0)
    return seen(A, B, np.eye(1, len(A)), np.array([[0.3]]), CELL, "q", (1.0,), steps_of(rng, count), step)


def maxwell(rng, more):
    """A mass on a spring and Maxwell elements, struck."""
    step, count = 0.02, 1000
    c, tau = rng.uniform(0.5, 4.0, more), np.exp(rng.uniform(math.log(0.05), math.log(2.0), more))
    n = 2 + more
    A, B = np.zeros((n, n)), np.zeros((n, 1))
    A[0, 1], A[1, 0], A[1, 2:] = 1.0, -rng.uniform(5, 20), -c
    A[2:, 1], A[2:, 2:] = 1.0, -np.diag(1 / tau)
    B[1, 0] = 1.0
    return seen(A, B, np.eye(1, n), np.zeros((1, 1)), MASS, "nu", (0.0, 1.0), 10 * steps_of(rng, count), step)


def strip(rng, more):
    """A strip of a spring and Maxwell elements, stretched in ramps."""
    step, count = 0.05, 1000
    c, tau = rng.uniform(0.3, 2.0, more), np.exp(rng.uniform(math.log(0.15), math.log(10.0), more))
    y = 1 / tau[:, None]  # y' = (e − y)/τ, force e + Σ c (e − y)
    return seen(-np.diag(1 / tau), y, -c[None], np.array([[1.0 + c.sum()]]), STRIP, "nu", (0.0, 1.0),
                ramps(rng, count, step), step)  # fmt: skip


def ramps(rng, count, step):
    """A stretch that goes up in a few ramps and is held."""
    t = np.arange(count) * step
    at = np.sort(rng.uniform(0.02, 0.8, 3)) * t[-1]
    lasts = rng.uniform(0.2, 2.0, 3)
    parts = zip(at, lasts, rng.uniform(0.3, 1, 3), strict=True)
    return sum(size * np.clip((t - a) / d, 0, 1) for a, d, size in parts)[:, None]


def body_with(w, s, loss):
    """A body whose heat fades by a kernel Σ w e^(−s t): z' = f − s z, f = u − loss·w z."""
    return -np.diag(s) - loss * np.ones((len(w), 1)) * w, np.ones((len(w), 1)), w[None], np.zeros((1, 1))


def cell_with(w, s, resistance):
    """A cell whose charge fades by a kernel, behind a resistor."""
    return -np.diag(s), np.ones((len(w), 1)), w[None], np.array([[resistance]])


def mass_with(w, s, k):
    """A mass on a spring and an element that pulls with a kernel of its speed."""
    n = 2 + len(w)
    A, B = np.zeros((n, n)), np.zeros((n, 1))
    A[0, 1], A[1, 0], A[1, 2:] = 1.0, -k, -w
    A[2:, 1], A[2:, 2:] = 1.0, -np.diag(s)
    B[1, 0] = 1.0
    return A, B, np.eye(1, n), np.zeros((1, 1))


def strip_with(w, s, k):
    """The same of a stretched strip: Σ w ∫ e^(−s(t−t')) v dt' = Σ w (e − y), y' = s (e − y); the slow rest is w·e."""
    return -np.diag(s), s[:, None], -w[None], np.array([[k + w.sum()]])


def fractional_body(rng, q):
    step, count = 0.1, 600
    loss = rng.uniform(0.05, 0.3)
    return seen(*body_with(*memory(q, step, step * count), loss), BODY, "q", (1.0,), steps_of(rng, count), step)


def fractional_cell(rng, q):
    step, count = 0.1, 800
    return seen(*cell_with(*memory(q, step, step * count), 0.3), CELL, "q", (1.0,), steps_of(rng, count), step)


def fractional_mass(rng, q):
    step, count = 0.02, 1000
    (w, s), c, k = memory(q, step, step * count), rng.uniform(0.5, 4.0), rng.uniform(5, 20)
    return seen(*mass_with(c * w, s, k), MASS, "nu", (0.0, 1.0), 10 * steps_of(rng, count), step)


def fractional_strip(rng, q):
    step, count = 0.05, 1000
    (w, s), c = memory(q, step, step * count), rng.uniform(0.3, 2.0)
    return seen(*strip_with(c * w, s, 1.0), STRIP, "nu", (0.0, 1.0), ramps(rng, count, step), step)


def hardening(rng, more):
    """A mass on a dashpot and a spring that hardens: what a linear model lacks."""
    return bent(rng, more, lambda x, _, cubic: cubic * x**3)


def dragged(rng, more):
    """A mass on a spring in a fluid that drags: what a viscous model lacks."""
    return bent(rng, more, lambda _, v, drag: drag * v * abs(v))


def bent(rng, more, force):
    """A mass on a dashpot and a spring, and a force that is not linear, from weak to strong."""
    step, count = 0.02, 1000
    k, c, size = rng.uniform(5, 20), rng.uniform(0.1, 1.0), 0.2 * 3.0**more
    u = 10 * steps_of(rng, count)
    t = step * np.arange(count)

    def rates(now, x):
        return x[1], np.interp(now, t, u[:, 0]) - k * x[0] - c * x[1] - force(x[0], x[1], size)

    run = solve_ivp(rates, (0.0, t[-1]), [0.0, 0.0], t_eval=t, max_step=step, rtol=1e-8, atol=1e-10)
    return Seen(run.y[:1].T, MASS, "nu", (0.0, 1.0), u, step)


INTEGER = {
    "hardening": hardening,
    "dragged": dragged,
    "lumps": lumps,
    "wall": wall,
    "ladder": ladder,
    "maxwell": maxwell,
    "strip": strip,
}
FRACTIONAL = {"a body": fractional_body, "a cell": fractional_cell, "a mass": fractional_mass,
              "a strip": fractional_strip}  # fmt: skip

WITH = {"a body": (body_with, 0.2), "a cell": (cell_with, 0.3), "a mass": (mass_with, 10.0),
        "a strip": (strip_with, 1.0)}  # fmt: skip
"""Truth → the same with any kernel, and where its last constant begins."""

# --- what a recording can tell -----------------------------------------------------------------------------------


def missed_by_two(kind: str, truth: Seen, deviation: float, rho: float) -> float:
    """What the best two relaxations leave of a fractional truth itself, in −2 log L of noise of such a deviation.

    Their kernel is a_0 + Σ a_j e^(−t/τ_j); SciPy fits amplitudes, time constants and the last constant, from four
    starts, to the outputs without noise, both whitened by the autoregression that the noise is.
    """
    system, last = WITH[kind]
    y, step, end = truth.y[:, 0], truth.step, truth.step * len(truth.y)
    rng = np.random.default_rng(0)

    def residual(ln_values: np.ndarray) -> np.ndarray:
        a, tau, own = np.split(np.exp(ln_values), (3, 5))
        rival = seen(*system(a, np.array([0.0, *(1 / tau)]), own[0]), truth.model, truth.order, (), truth.inputs, step)
        left = np.nan_to_num(np.clip(y - rival.y[:, 0], -1e9, 1e9), nan=1e9)
        return lfilter([1.0, -rho], [1.0], left) / (deviation * math.sqrt(1 - rho**2))

    limits = np.log([1e-9] * 3 + [step / 3] * 2 + [1e-6]), np.log([1e4] * 3 + [10 * end] * 2 + [1e3])
    costs = []
    for _ in range(4):
        tau = np.sort(np.exp(rng.uniform(math.log(2 * step), math.log(end / 2), 2)))
        start = np.log([0.3, *np.full(2, rng.uniform(0.3, 2)), *tau, last])
        costs.append(least_squares(residual, np.clip(start, *limits), bounds=limits, max_nfev=60).cost)
    return 2 * float(min(costs))


# --- recordings and fits -----------------------------------------------------------------------------------------


def remembered(kind, step):
    """What noise keeps of itself from sample to sample."""
    return {"white": 0.0, "AR": 0.95, "30 ms": math.exp(-step / 0.03)}[kind]


def coloured(rng, kind, count, step):
    """Noise of standard deviation 1."""
    white, rho = rng.standard_normal(count + 500), remembered(kind, step)
    return math.sqrt(1 - rho**2) * lfilter([1.0], [1.0, -rho], white)[500:]


def recorded(truth, noise, kind, rng):
    """What a user has: a problem."""
    y = truth.y + noise * np.std(truth.y) * coloured(rng, kind, len(truth.y), truth.step)[:, None]
    signals = {next(iter(truth.model.outputs)): y[:, 0], truth.model.inputs[0]: truth.inputs[:, 0]}
    recording = fracid.Recording.of("twin", truth.step * np.arange(len(y)), signals)
    rest = dict.fromkeys(truth.model.states, 0.0)
    lines = {truth.model.inputs[0]: "line"}
    twin = Experiment.of(recording, truth.model, [*truth.model.outputs], rest, between=lines)
    free = {p.name: Free(p.value, 0.0, 100.0 * p.value) for p in truth.model.parameters}
    order = Free(0.9, 0.2, 1.5) if truth.order == "q" else Free(0.4, 0.02, 0.98)
    return Problem(truth.model, (twin,), {truth.order: order}, free, initial_state="held")


def answer(kind: str, variant: float, noise: float, colour: str, seed: int) -> dict[str, Any]:
    """Return what fracid claims of one twin."""
    rng = np.random.default_rng([seed, round(1000 * variant), round(1000 * noise)])
    fractional = kind in FRACTIONAL
    truth = FRACTIONAL[kind](rng, variant) if fractional else INTEGER[kind](rng, int(variant))
    problem = recorded(truth, noise, colour, rng)
    began = time.process_time()
    fit = fracid.identify(problem, fixed_step=False)
    seconds = time.process_time() - began
    found = fit.orders[truth.order]
    true = (1 - variant if truth.order == "nu" else variant) if fractional else None
    off = math.nan if true is None else min(abs(true - i) for i in truth.integers)
    told = missed_by_two(kind, truth, noise * np.std(truth.y), remembered(colour, truth.step)) if fractional else 0.0
    width = math.inf if found.interval95 is None else found.interval95[1] - found.interval95[0]
    return {"kind": kind, "variant": variant, "noise": noise, "colour": colour, "seed": seed, "fractional": fractional,
            "claim": fit.claim, "reasons": list(fit.claim_reasons), "order": found.value, "true": true,
            "determined": width < off / 2, "told": told > TOLD, "seconds": seconds}  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kinds", nargs="*", default=["integer", "fractional"], help="by name; integer, fractional")
    parser.add_argument("--draws", type=int, default=1, help="of each kind, variant and noise")
    parser.add_argument("--seed", type=int, default=1, help="of the first")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    asked = parser.parse_args()
    groups = {"integer": tuple(INTEGER), "fractional": tuple(FRACTIONAL)}
    kinds = [k for name in asked.kinds for k in groups.get(name, (name,))]
    tasks = [
        Task(f"{kind} {variant:g} {noise:g} {colour} {seed}", (kind, variant, noise, colour, seed))
        for seed in range(asked.seed, asked.seed + asked.draws) for kind in kinds
        for variant in ((0.5, 0.7, 0.9) if kind in FRACTIONAL else (1, 2, 3))
        for colour, noise in (OF_FRACTIONAL if kind in FRACTIONAL else OF_INTEGER)
    ]  # fmt: skip
    answers = list(run_tasks(answer, tasks, executor="processes", jobs=asked.jobs).values())
    for kind in kinds:
        print(f"{kind:10}", dict(Counter(a["claim"] for a in answers if a["kind"] == kind)))
    false = [a for a in answers if not a["fractional"] and a["claim"] == "fractional"]
    told, determined = ([a for a in answers if a["fractional"] and a[key]] for key in ("told", "determined"))
    missed, also = ([a for a in some if a["claim"] != "fractional"] for some in (told, determined))
    for a in (*false, *missed):
        print(a["kind"], a["variant"], a["noise"], a["colour"], a["seed"], a["claim"], *a["reasons"], sep="; ")
    integer = sum(not a["fractional"] for a in answers)
    print(f'{len(false)} false "fractional" of {integer}; {len(told) - len(missed)} of {len(told)} orders that the '
          f"recording tells called so, {len(determined) - len(also)} of {len(determined)} determined ones; "
          f"{sum(a['seconds'] for a in answers) / max(1, len(answers)):.2f} s a twin")  # fmt: skip
    return int(bool(false) or len(missed) > (1 - POWER) * len(told))


if __name__ == "__main__":
    raise SystemExit(main())
