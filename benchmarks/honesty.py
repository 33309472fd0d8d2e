"""Is each fault of docs/honesty.md said before the answer is wrong by more than its interval, and none without a fault?

    python benchmarks/honesty.py                  # everything; a quarter of an hour beside other work
    python benchmarks/honesty.py late off-zero    # faults by code
    python benchmarks/honesty.py --healthy 300    # so many twins without a fault; 0 for none
    python benchmarks/honesty.py --write          # also puts its tables into docs/honesty.md

**Faults.**  Twins of rigs of the library (:data:`TWINS`: other amplitudes, orders, noise, encoders, sampling rates, one
driven) are spoilt in a ladder of severity from harmless to gross.  fracid is asked before the search; where it is
silent there, the twin is fitted from the truth, and it is asked again.  What a silent answer is worth is told by the
truth: how far the orders are from it, in half their 95 % intervals.  A gross fault that is not said ends the benchmark.

**False alarms.**  Random twins without a fault are asked the same, from starts that are off the truth.  More than
:data:`ALARMS` of them with a finding ends it.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import os
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

import fracid
from fracid.errors import Failure
from fracid.estimation.covariance import Uncertainty, uncertainty
from fracid.estimation.horizons import Watch, refined
from fracid.findings import Finding
from fracid.optimise import Evaluation
from fracid.problem import Experiment, Free, Problem
from fracid.quantiles import NORMAL_95
from fracid.solver.memory import compressed
from fracid.validation.after_search import after, noisy_start, with_start
from fracid.validation.before_search import before
from fracid.validation.discretisation import coarse_step, discretisation_check
from fracid.validation.misfits import POOR

PAGE = Path(__file__).parent.parent / "docs" / "honesty.md"

ALARMS = 0.02
"""Part of the twins without a fault that may have a finding."""

DRY = {
    "srv02-rotpen": (2e-3, 2.5e-4),
    "qube-servo2": (1.5e-4, 5e-5),
    "cazzolato-prime": (1e-3, 3e-4),
    "odrive-furuta": (1e-4, 6e-5),
    "stepper-freeswing": (0.0, 1.8e-4),
}
"""Dry friction of arm and pendulum [N m], as benchmarks/intervals.py has it."""

BUDGET = 25
"""Steps of least squares: from the truth that is plenty, and what is spoilt badly need not be fitted to the end."""

FINE = 4
"""Steps a sample of the run that is the truth."""


# --- twins -------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Twin:
    """A release of a rig, recorded; `drive` volts of a rising sine go to its motor."""

    rig: str
    angle: float
    orders: tuple[float, float]
    noise: float
    """[rad]"""
    counts: int
    """A turn; 0 for a sensor without steps."""
    step: float
    end: float
    drive: float = 0.0
    seed: int = 1

    @property
    def outputs(self) -> tuple[str, ...]:
        return ("alpha",) if self.rig == "stepper-freeswing" else ("theta", "alpha")

    @cached_property
    def model(self) -> fracid.Model:
        dry = dict(zip(("coulomb_theta", "coulomb_alpha"), DRY[self.rig], strict=True))
        return fracid.rotary_pendulum(self.rig).with_parameters(**dry)

    def value(self, name: str) -> float:
        return self.model.parameter(name).value

    @property
    def period(self) -> float:
        """Of small swings, the arm held [s]."""
        return 2 * math.pi * math.sqrt(self.value("C1") / self.value("C4"))

    @cached_property
    def inputs(self) -> np.ndarray:
        if not self.drive:
            return np.zeros((1, 1))
        t = np.arange(round(self.end / self.step) + 1) * self.step
        return (self.drive * np.sin(2 * math.pi / self.period * (0.5 + 0.5 * t / self.end) * t))[:, None]

    def clean(self, model: fracid.Model | None = None, inputs: np.ndarray | None = None) -> np.ndarray:
        """What a perfect sensor would read [rad], shape (n_samples, n_outputs)."""
        u = self.inputs if inputs is None else inputs
        if len(u) > 1:
            grid = np.arange((len(u) - 1) * FINE + 1) / FINE
            u = np.interp(grid, np.arange(len(u)), u[:, 0])[:, None]
        run = fracid.simulate(
            model or self.model, orders=dict(zip(("lambda", "mu"), self.orders, strict=True)), end=self.end,
            initial={"alpha": math.radians(self.angle)}, step=self.step / FINE, inputs=u if len(u) > 1 else None,
        )  # fmt: skip
        assert run.completed, (self, run.reason)
        return run.states[::FINE, [0, 2] if len(self.outputs) == 2 else [2]]

    def read(self, y: np.ndarray) -> np.ndarray:
        """The same with noise and by its encoders."""
        y = y + self.noise * np.random.default_rng(self.seed).standard_normal(y.shape)
        lattice = 2 * math.pi / self.counts if self.counts else 0.0
        return np.ascontiguousarray(lattice * np.rint(y / lattice) if lattice else y)

    @cached_property
    def good(self) -> np.ndarray:
        return self.read(self.clean())

    def problem(self, y: np.ndarray | None = None, model: fracid.Model | None = None,
                lacks: tuple[str, ...] = (), **options: object) -> Problem:  # fmt: skip
        """Identify orders, two inertias and all friction, from the truth."""
        joints, reach = self.outputs, 0.1 * self.value("C4")
        free = {n: Free(self.value(n), 0.3 * self.value(n), 3 * self.value(n))
                for n in (("C1", "C3") if len(joints) == 2 else ("C1",))}  # fmt: skip
        free |= {f"b_{j}": Free(self.value(f"b_{j}"), -reach, reach) for j in joints}
        free |= {f"coulomb_{j}": Free(self.value(f"coulomb_{j}"), 0.0, reach) for j in joints}
        u = options.pop("inputs", self.inputs)
        e = Experiment("twin", options.pop("step", self.step), np.ascontiguousarray(self.good if y is None else y), u)
        orders = {"lambda": Free(self.orders[0], 0.5, 1.3) if len(joints) == 2 else 1.0,
                  "mu": Free(self.orders[1], 0.5, 1.3)}  # fmt: skip
        given = {"outputs": joints, "initial_state": "rest"} | options
        return Problem(model or self.model, (e,), orders, {n: v for n, v in free.items() if n not in lacks}, **given)


TWINS = (
    Twin("srv02-rotpen", 92, (0.95, 0.97), 5e-4, 4096, 4e-3, 8),
    Twin("qube-servo2", 45, (0.9, 0.95), 1e-3, 2048, 2e-3, 5),
    Twin("odrive-furuta", 20, (1.0, 1.0), 5e-4, 8192, 5e-3, 10),
    Twin("srv02-rotpen", 10, (1.0, 0.95), 5e-4, 4096, 4e-3, 8, drive=2.0),
)


# --- what is said ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Said:
    """The answer to one spoilt twin."""

    findings: tuple[Finding, ...]
    off: float | None
    """How far the orders are from the truth, the worst, in CI half-widths; None where nothing was fitted."""


def ask(problem: Problem, codes: tuple[str, ...], start: Problem | None = None) -> Said:
    """Before the search, and, where none of the codes is said there, after it."""
    found = before(start or problem)
    if any(f.code in codes for f in found):
        return Said(found, None)
    best = refined(problem, problem.start, Watch(), budget=BUDGET).best
    known = uncertainty(problem, best.point)
    found += (*after(problem, best.point, known), *poor(problem, best))
    found += noisy_start(problem, best.point, with_start(problem, best.point, known))
    if "step" in codes:
        found += tuple(coarse_step(problem, discretisation_check(problem, best.point, known, 1)))
    return Said(found, off(problem, best, known))


def poor(problem: Problem, best: Evaluation) -> Iterator[Finding]:
    """A fit that is no better than a constant, as :func:`fracid.identify` says it."""
    for e in problem.experiments:
        y = problem.fitted(best.point, e)
        left = np.full(e.measured.shape[1], np.inf) if isinstance(y, Failure) else np.std(e.measured - y, axis=0)
        percent = float(np.min(100 * (1 - left / np.maximum(np.std(e.measured, axis=0), 1e-12))))
        if percent < POOR:
            yield Finding("cannot-explain", e.name, percent, POOR, "% fit", "")


def off(problem: Problem, best: Evaluation, known: Uncertainty | Failure) -> float | None:
    """Of a problem that starts at the truth."""
    if isinstance(known, Failure):
        return None
    times = [abs(best.point[i] - problem.start[i]) / (NORMAL_95 * known.standard_error[i])
             for i in problem.order_indices]  # fmt: skip
    return float(np.nanmax(times)) if np.any(np.isfinite(times)) else None


# --- faults --------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Fault:
    """One way to spoil a twin, from harmless to gross."""

    code: str
    also: tuple[str, ...]
    """Codes by which it is told as well."""
    what: str
    unit: str
    ladder: tuple[float, ...]
    gross: float
    """From here on it must be said; infinite where a silent answer is no wrong one."""
    make: Callable[[Twin, float], Problem | Said]
    needs: str
    """``arm``, ``drive``, ``encoder``, ``smooth`` (no encoder) or ``pendulum``, which all have."""

    def twins(self) -> list[Twin]:
        if self.needs == "smooth":
            return [replace(t, counts=0) for t in TWINS if not t.drive]
        has = {"arm": lambda t: len(t.outputs) == 2, "drive": lambda t: t.drive, "encoder": lambda t: t.counts,
               "release": lambda t: not t.drive,
               "coupled": lambda t: not t.drive and t.rig in ("srv02-rotpen", "qube-servo2")}  # fmt: skip
        return [t for t in TWINS if has.get(self.needs, bool)(t)]


FAULTS: list[Fault] = []


def fault(code: str, what: str, unit: str, ladder: tuple[float, ...], gross: float, *, needs: str = "",
          also: tuple[str, ...] = ()) -> Callable[[Callable[[Twin, float], Problem | Said]], None]:  # fmt: skip
    def register(make: Callable[[Twin, float], Problem | Said]) -> None:
        FAULTS.append(Fault(code, also, what, unit, ladder, gross, make, needs))

    return register


def changed(y: np.ndarray, output: int, column: np.ndarray) -> np.ndarray:
    y = y.copy()
    y[:, output] = column
    return y


def later(x: np.ndarray, samples: float) -> np.ndarray:
    n = np.arange(len(x))
    return np.interp(n - samples, n, x)


ANGLES = (1.0, 3.0, 5.0, 10.0, 45.0, 90.0)


@fault("degrees-as-radians", "degrees, by an encoder", "° of swing", ANGLES[1:], 10, needs="encoder")
def _(t: Twin, s: float) -> Problem:
    t = replace(t, angle=s)
    return t.problem(np.degrees(t.good))


@fault("degrees-as-radians", "degrees, no encoder", "° of swing", ANGLES, 45, needs="smooth", also=("cannot-explain",))
def _(t: Twin, s: float) -> Problem:
    t = replace(t, angle=s)
    return t.problem(np.degrees(t.good))


@fault("radians-as-degrees", "radians, by an encoder", "° of swing", ANGLES[1:], 10, needs="encoder")
def _(t: Twin, s: float) -> Problem:
    t = replace(t, angle=s)
    return t.problem(np.radians(t.good))


@fault("radians-as-degrees", "radians, no encoder", "° of swing", (150, 120, 90, 45, 20), 90, needs="smooth")
def _(t: Twin, s: float) -> Problem:
    t = replace(t, angle=s)
    return t.problem(np.radians(t.good))


@fault("counts-as-radians", "counts, of an encoder", "° of swing", ANGLES, 45, needs="encoder",
       also=("degrees-as-radians",))  # fmt: skip
def _(t: Twin, s: float) -> Problem:
    t = replace(t, angle=s)
    return t.problem(np.rint(t.good * t.counts / (2 * math.pi)))


@fault("wrong-clock", "a clock that is wrong by a factor", "times", (1.002, 1.02, 1.3, 3, 10, 1000), 10,
       also=("cannot-explain",))  # fmt: skip
def _(t: Twin, s: float) -> Problem:
    return t.problem(step=s * t.step, substeps=1)


@fault("jump", "five samples of α read s too high", "°", (0.3, 1, 3, 10, 30, 90), 30)
def _(t: Twin, s: float) -> Problem:
    wild = np.random.default_rng(t.seed).choice(len(t.good) - 2, 5, replace=False) + 1
    y = t.good.copy()
    y[wild, -1] += math.radians(s)
    return t.problem(y)


@fault("jump", "a count that wraps at 180°, rest at s", "°", (0, 150, 180), 180, needs="release")
def _(t: Twin, s: float) -> Problem:
    alpha = t.good[:, -1] + math.radians(s)
    upright = t.model if s == 0 else fracid.rotary_pendulum(t.rig, zero="upright", coulomb_alpha=DRY[t.rig][1])
    return t.problem(changed(t.good, -1, (alpha + math.pi) % (2 * math.pi) - math.pi), upright)


@fault("repeated", "each sample written s times", "times", (1, 2, 3, 5, 10, 20), 3)
def _(t: Twin, s: float) -> Problem:
    return t.problem(t.good[np.arange(len(t.good)) // int(s) * int(s)])


@fault("saturated", "α cut off by s of its largest", "%", (1, 3, 10, 30, 50), 50, needs="release")
def _(t: Twin, s: float) -> Problem:
    limit = (1 - 0.01 * s) * np.abs(t.good[:, -1]).max()
    limit = 2 * math.pi / t.counts * round(limit * t.counts / (2 * math.pi)) if t.counts else limit
    return t.problem(changed(t.good, -1, np.clip(t.good[:, -1], -limit, limit)))


@fault("saturated", "the motor's voltage at its limit, s of it above", "%", (0, 3, 10, 30, 50), 30, needs="drive")
def _(t: Twin, s: float) -> Problem:
    limit = (1 - 0.01 * s) * np.abs(t.inputs).max()
    got = np.clip(t.inputs, -limit, limit)
    return t.problem(t.read(t.clean(inputs=got)), inputs=got)


@fault("aliased", "too few samples a swing", "samples a swing", (60, 30, 16, 10, 5, 3), 5, needs="release",
       also=("coarse-steps",))  # fmt: skip
def _(t: Twin, s: float) -> Problem:
    every = max(1, round(t.period / t.step / s))
    return t.problem(t.good[::every], step=every * t.step, substeps=every)


@fault("aliased", "a line near half the sampling rate", "% of α", (1, 3, 10, 30, 100), 100)
def _(t: Twin, s: float) -> Problem:
    line = 0.01 * s * np.std(t.good[:, -1]) * math.sqrt(2) * np.sin(2 * math.pi * 0.43 * np.arange(len(t.good)))
    return t.problem(changed(t.good, -1, t.good[:, -1] + line))


@fault("wrong-zero", "α's zero off", "°", (1, 3, 8, 12, 30, 180), 12, also=("off-zero", "cannot-explain"))
def _(t: Twin, s: float) -> Problem:
    return t.problem(changed(t.good, -1, t.good[:, -1] + math.radians(s)))


@fault("off-zero", "α's zero off", "°", (0.03, 0.1, 0.3, 1, 3), 1, also=("cannot-explain",))
def _(t: Twin, s: float) -> Problem:
    return t.problem(changed(t.good, -1, t.good[:, -1] + math.radians(s)))


@fault("wrong-sign", "θ's sign; the arm s times as heavy", "times", (10, 3, 1), 1, needs="arm",
       also=("cannot-explain",))  # fmt: skip
def _(t: Twin, s: float) -> Problem:
    model = t.model.with_parameters(J_theta=s * t.value("J_theta"))
    return t.problem(t.read(t.clean(model)) * [-1, 1], model)


@fault("wrong-sign", "the voltage's sign; s times its torque", "times", (0.01, 0.1, 1), 1, needs="drive",
       also=("cannot-explain",))  # fmt: skip
def _(t: Twin, s: float) -> Problem:
    model = t.model.with_parameters(torque_per_volt=s * t.value("torque_per_volt"))
    return t.problem(t.read(t.clean(model)), model, inputs=-t.inputs)


@fault("wrong-sign", "θ and α exchanged; the arm s times as heavy", "times", (10, 3, 1), 1, needs="arm",
       also=("cannot-explain", "wrong-zero"))  # fmt: skip
def _(t: Twin, s: float) -> Problem:
    model = t.model.with_parameters(J_theta=s * t.value("J_theta"))
    return t.problem(t.read(t.clean(model))[:, ::-1], model)


@fault("stiff", "steep dry friction, gl", "|J|h", (0.1, 0.3, 0.8, 1.5, 5, 20), 5, needs="release", also=("step",))
def _(t: Twin, s: float) -> Problem:
    slip = t.value("coulomb_alpha") * t.step ** t.orders[1] / (t.value("C1") * s)
    model = t.model.with_parameters(slip_speed=slip, coulomb_theta=0.0)
    return t.problem(t.read(t.clean(model)), model, method="gl", lacks=("coulomb_theta",))


@fault("coarse-steps", "steps as long as a sampling interval", "samples a swing", (100, 50, 30, 15, 8), 8,
       needs="release", also=("aliased", "step"))  # fmt: skip
def _(t: Twin, s: float) -> Problem:
    every = max(1, round(t.period / t.step / s))
    return t.problem(t.good[::every], step=every * t.step)


@fault("step", "gl in the place of pi2", "samples a swing", (200, 100, 50, 25), 50, needs="release",
       also=("coarse-steps", "stiff", "stopped-short", "cannot-explain"))  # fmt: skip
def _(t: Twin, s: float) -> Problem:
    every = max(1, round(t.period / t.step / s))
    return t.problem(t.good[::every], step=every * t.step, method="gl")


@fault("loose-memory", "a loose memory", "tolerance", (1e-10, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2), 1e-2, needs="release")
def _(t: Twin, s: float) -> Problem:
    t = replace(t, orders=(0.95, 0.97))
    return t.problem(memory=compressed(s))


@fault("short-window", "a short record with much noise", "swings", (12, 6, 3, 1.5), math.inf, needs="release",
       also=("noisy-start",))  # fmt: skip
def _(t: Twin, s: float) -> Problem:
    t = replace(t, noise=1e-2)
    return t.problem(t.good[: round(s * t.period / t.step)], initial_state="estimate")


@fault("cannot-explain", "dry friction that the model lacks", "of gravity", (1e-4, 1e-3, 1e-2, 3e-2, 1e-1), 1e-1,
       needs="release")  # fmt: skip
def _(t: Twin, s: float) -> Problem:
    real = t.model.with_parameters(coulomb_alpha=s * t.value("C4"))
    lacks = ("coulomb_alpha",)
    return t.problem(t.read(t.clean(real)), t.model.with_parameters(coulomb_alpha=0.0), lacks)


@fault("cannot-explain", "a cable that the model lacks", "of gravity", (1e-3, 1e-2, 1e-1, 1), 1, needs="release")
def _(t: Twin, s: float) -> Problem:
    return t.problem(t.read(t.clean(t.model.with_parameters(cable_stiffness=s * t.value("C4")))))


@fault("late", "α read later than θ", "samples", (0.1, 0.3, 1, 2, 5), 2, also=("cannot-explain",))
def _(t: Twin, s: float) -> Problem:
    y = t.clean()
    return t.problem(t.read(changed(y, -1, later(y[:, -1], s))))


@fault("late", "θ read later than α", "samples", (0.1, 0.3, 1, 2, 5), 5, needs="arm", also=("cannot-explain",))
def _(t: Twin, s: float) -> Problem:
    y = t.clean()
    return t.problem(t.read(changed(y, 0, later(y[:, 0], s))))


@fault("late", "a filter on α alone", "ms", (0.3, 1, 3, 10, 30), 30, also=("cannot-explain", "off-zero", "drifts"))
def _(t: Twin, s: float) -> Problem:
    a, y = math.exp(-t.step / (1e-3 * s)), t.clean()
    slow, _ = lfilter([1 - a], [1, -a], y[:, -1], zi=[a * y[0, -1]])
    return t.problem(t.read(changed(y, -1, slow)))


@fault("late", "the voltage recorded later", "samples", (0.1, 0.3, 1, 2, 5), 2, needs="drive")
def _(t: Twin, s: float) -> Problem:
    return t.problem(inputs=later(t.inputs[:, 0], s)[:, None])


@fault("scaled", "α too large", "%", (0.3, 1, 3, 10, 30), 30, also=("cannot-explain", "degrees-as-radians"))
def _(t: Twin, s: float) -> Problem:
    return t.problem(changed(t.good, -1, (1 + 0.01 * s) * t.good[:, -1]))


@fault("drifts", "α's zero drifts", "°", (0.03, 0.1, 0.3, 1, 3), 1, also=("cannot-explain",))
def _(t: Twin, s: float) -> Problem:
    return t.problem(changed(t.good, -1, t.good[:, -1] + np.linspace(0, math.radians(s), len(t.good))))


@fault("play", "play between arm and its encoder", "°", (0.03, 0.1, 0.3, 1), math.inf, needs="arm",
       also=("cannot-explain", "late", "drifts"))  # fmt: skip
def _(t: Twin, s: float) -> Problem:
    y = t.clean()
    return t.problem(t.read(changed(y, 0, with_play(y[:, 0], math.radians(s)))))


def with_play(x: np.ndarray, play: float) -> np.ndarray:
    """What turns with x only when it touches either side."""
    found, at = np.empty_like(x), x[0]
    for k, value in enumerate(x):
        at = min(max(at, value - play / 2), value + play / 2)
        found[k] = at
    return found


@fault("noisy-start", "the start is the first sample; noise", "rad", (1e-5, 1e-4, 1e-3, 3e-3, 1e-2), math.inf,
       needs="release")  # fmt: skip
def _(t: Twin, s: float) -> Problem:
    return replace(t, noise=s).problem(initial_state="held")


# --- runs that do not reach their end: said or not, no orders to be wrong ----------------------------------


def ran(run: fracid.Trajectory) -> Said:
    """A run that reaches its end has no fault; what is said of another must name why."""
    assert run.completed or run.fault is not None, run.reason
    return Said(() if run.fault is None else (run.fault,), None)


def beyond_all_orders(t: Twin, mu: float, method: str) -> Said:
    return ran(fracid.simulate(fracid.rotary_pendulum(t.rig), orders={"lambda": 0.6, "mu": mu}, initial={"alpha": 0.17},
                               step=1e-3, end=20.0, method=method))  # fmt: skip


@fault("unsettled", "μ at λ = 0.6, from 10°", "", (1.0, 1.2, 1.3, 1.4, 1.5, 1.6), 1.4, needs="coupled")
def _(t: Twin, s: float) -> Said:
    return beyond_all_orders(t, s, "pi2")


@fault("blow-up", "the same by gl", "", (1.0, 1.2, 1.3, 1.4, 1.5, 1.6), 1.4, needs="coupled", also=("runs-away",))
def _(t: Twin, s: float) -> Said:
    return beyond_all_orders(t, s, "gl")


@fault("runs-away", "an arm that is pushed", "1/s", (-1, 0, 0.1, 1, 3, 10), 3, needs="release", also=("unsettled",))
def _(t: Twin, s: float) -> Said:
    rig = t.model.with_parameters(b_theta=-s * t.value("J_theta"), coulomb_theta=0.0)
    return ran(fracid.simulate(rig, orders={"lambda": 1.0, "mu": 1.0}, initial={"alpha": math.radians(t.angle)},
                               step=1e-3, end=20.0))  # fmt: skip


@fault("not-finite", "x' = −1/√x, to the end at 2/3 s", "s", (0.2, 0.5, 0.6, 0.7, 1), 0.7, needs="drive")
def _(t: Twin, s: float) -> Said:  # noqa: ARG001
    return ran(fracid.solve_fde(_divided, 1.0, [1.0], step=1e-3, end=s))


def _divided(t, x, u, p, out):  # noqa: ARG001
    out[0] = -1.0 / max(x[0], 0.0) ** 0.5


# --- tables -----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Row:
    """One fault over all its twins."""

    fault: Fault
    first: tuple[int | None, ...]
    """The rung at which each twin's is first said."""
    shown: Finding | None
    """What is said there, by the median twin."""
    silent: float | None
    """The worst of the orders on the rungs before it, in CI half-widths."""
    missed: tuple[str, ...]
    """Gross ones of which nothing was said, in words."""
    gross: int

    def cells(self) -> list[str]:
        f = self.fault
        rungs = sorted(len(f.ladder) if k is None else k for k in self.first)
        show = lambda k: "–" if k == len(f.ladder) else f"{f.ladder[k]:g}"  # noqa: E731
        median, last = rungs[len(rungs) // 2], rungs[-1]
        number, limit = ("–", "–") if self.shown is None else (
            f"{self.shown.number:.3g} {self.shown.unit}".rstrip(), f"{self.shown.limit:.3g}")  # fmt: skip
        silent = "–" if self.silent is None else f"{self.silent:.1f}"
        said = f"{self.gross - len(self.missed)} of {self.gross}" if self.gross else "–"
        return [f"`{f.code}`", f.what, f"{f.ladder[0]:g} … {f.ladder[-1]:g} {f.unit}".rstrip(), show(median),
                show(last), number, limit, silent, said]  # fmt: skip


HEAD = ["code", "made", "severity", "first said at", "the last twin", "the number there", "limit",
        "orders off before, CI half-widths", "gross ones said"]  # fmt: skip


def climb(f: Fault) -> Row:
    """All twins up the ladder."""
    codes, first, shown, silent, missed, gross = (f.code, *f.also), [], [], [], [], 0
    for t in f.twins():
        at = None
        for k, s in enumerate(f.ladder):
            made = f.make(t, s)
            found = made if isinstance(made, Said) else ask(made, codes)
            named = [g for g in found.findings if g.code in codes]
            at = k if at is None and named else at
            shown += [(k, named[0])] if at == k else []
            silent += [found.off] if found.off is not None and not named and at is None else []
            must = f.gross in f.ladder and k >= f.ladder.index(f.gross)
            gross += must
            missed += (
                [f"{f.code}, {f.what}, {s:g} {f.unit}: {t}: {[g.code for g in found.findings]}"]
                if must and not named
                else []
            )
        first.append(at)
    shown.sort(key=lambda pair: pair[0])
    return Row(
        f, tuple(first), shown[len(shown) // 2][1] if shown else None, max(silent, default=None), tuple(missed), gross
    )


def healthy(seeds: range) -> tuple[Counter[str], list[str]]:
    """Findings of random twins without a fault, by code, and in words."""
    found, words = Counter[str](), []
    for seed in seeds:
        rng = np.random.default_rng([1, seed])
        rig = str(rng.choice(list(DRY)))
        driven = rig == "srv02-rotpen" and rng.random() < 0.5
        t = Twin(
            rig, float(np.exp(rng.uniform(np.log(8), np.log(110)))), tuple(rng.uniform(0.9, 1.0, 2)),
            float(np.exp(rng.uniform(np.log(1e-4), np.log(3e-3)))), int(rng.choice([0, 1024, 2048, 4096, 16384])),
            float(rng.choice([1e-3, 2e-3, 4e-3])), 0.1 * int(rng.integers(30, 100)), 2.0 if driven else 0.0, seed,
        )  # fmt: skip
        problem = t.problem()
        said = ask(problem, (), start=off_the_truth(problem, rng))
        codes = {f.code for f in said.findings}
        found.update(codes)
        found["any"] += bool(codes)
        words += [f"false alarm: {f.code} {f.number:.3g} (limit {f.limit:.3g}) {f.where}: {t}" for f in said.findings]
    return found, words


def nth(number: int) -> tuple[list[str], list[str]]:
    """A row's cells, and what was missed: for other processes, to which a function without a name does not travel."""
    row = climb(FAULTS[number])
    return row.cells(), list(row.missed)


def off_the_truth(problem: Problem, rng: np.random.Generator) -> Problem:
    """The same from another start: orders 0.97, constants within a fifth, half the friction."""

    def move(name: str, v: object) -> object:
        if not isinstance(v, Free):
            return v
        start = v.start * (rng.uniform(0.8, 1.2) if name.startswith("C") else 0.5)
        return replace(v, start=float(np.clip(start, v.lower, v.upper)))

    orders = {n: replace(v, start=0.97) if isinstance(v, Free) else v for n, v in problem.orders.items()}
    return replace(problem, orders=orders, parameters={n: move(n, v) for n, v in problem.parameters.items()})


def markdown(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *([cell.replace("|", "\\|") for cell in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def write(text: str) -> None:
    """Put it between the marks of docs/honesty.md."""
    begin, end = "<!-- measured: benchmarks/honesty.py -->", "<!-- end of what is measured -->"
    page = PAGE.read_text(encoding="utf-8")
    page = page[: page.index(begin) + len(begin)] + f"\n\n{text}\n\n" + page[page.index(end) :]
    PAGE.write_text(page, encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("codes", nargs="*", help="faults by code; all if left out")
    parser.add_argument("--healthy", type=int, default=120, help="twins without a fault")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    parser.add_argument("--write", action="store_true", help="put the tables into docs/honesty.md")
    asked = parser.parse_args()
    unknown = set(asked.codes) - {f.code for f in FAULTS}
    if unknown:
        parser.error(f"no fault called {', '.join(sorted(unknown))}; there are {', '.join({f.code for f in FAULTS})}")
    began, rows, misses = time.perf_counter(), [], []
    print(" | ".join(HEAD))
    chosen = [k for k, f in enumerate(FAULTS) if not asked.codes or f.code in asked.codes]
    count = 0 if asked.codes else asked.healthy
    found = Counter[str]()
    with multiprocessing.get_context("fork").Pool(asked.jobs) as pool:
        for cells, missed in pool.imap(nth, chosen):
            rows.append(cells)
            misses += missed
            print(" | ".join(cells), flush=True)
        for part, words in pool.imap_unordered(healthy, [range(k, min(k + 10, count)) for k in range(0, count, 10)]):
            found += part
            print(*words, sep="\n", end="\n" if words else "", flush=True)
    table = markdown(HEAD, rows)
    alarms = ", ".join(f"{n} of {c}" for c, n in sorted(found.items()) if n and c != "any") or "none"
    says = f"**False alarms.** {found['any']} of {count} random twins without a fault have a finding ({alarms})."
    print(f"{says}\n{time.perf_counter() - began:.0f} s")
    if asked.write and not asked.codes:
        write(f"{table}\n\n{says}")
    assert not misses, "gross faults that are not said:\n" + "\n".join(misses)
    assert found["any"] <= ALARMS * count, found


if __name__ == "__main__":
    main()
