"""A controller of an identified model, and over which part of what is known of the model it holds.

Designs are tried on the first of some draws of the unknowns; the one that holds on most of them, and of equals the one
with the least error and input for its distance from instability, is tried on all: what rests by itself is farthest from
instability where nothing is done.  A trial is a simulation of the fractional model with all its friction, with delay,
encoder, noise, sampling and limits as found (:mod:`fracid.solver.closed_loop`).
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from hashlib import sha256
from typing import Any

import numpy as np
from scipy.optimize import differential_evolution, minimize

from fracid.arrays import FloatArray, by_name
from fracid.cards import Card, CardDisplay
from fracid.errors import Failure, InputError, entry_of, refuse_unknown
from fracid.estimation.covariance import uncertainty
from fracid.export.state_space import IntegerModel, moving, positive_sum
from fracid.feedback.pid import pid
from fracid.feedback.regulators import (
    BALANCED,
    REDUCED,
    SAYS,
    SLOWEST,
    UPRIGHT,
    Plant,
    Posture,
    margins,
    posture_of,
    regulator,
)
from fracid.feedback.swing import CATCH, HANGS, law_of, swings, with_swing
from fracid.figures import Figure, Style, draw
from fracid.fit import Fit
from fracid.problem import Experiment, Problem
from fracid.quantiles import NORMAL_95
from fracid.safety.json_files import json_number
from fracid.safety.schema import as_json, record_of
from fracid.schemas.feedback import SECONDS, Conditions, Controller, ControlRecord, Design, Trial, margin_text
from fracid.signals.noise import noise_floor
from fracid.signals.resolution import resolution
from fracid.solver.arguments import Equation, InitialCondition, Options, check_above_0
from fracid.solver.closed_loop import Loop, step_closed
from fracid.solver.memory import compressed
from fracid.solver.right_hand_side import compile_rhs
from fracid.solver.solve import integrate, time_scale
from fracid.tasks.job import Progress, Task
from fracid.tasks.journal import Journal
from fracid.tasks.tasks import Part, run_tasks
from fracid.units import with_unit
from fracid.validation.study_records import binomial95

DRAWS, FIRST = 200, 40
"""Of the unknowns, and those on which all designs are tried."""

WEIGHTS = {"rho": (0.1, 1.0, 10.0), "sigma": (0.03, 0.3)}
"""Of the regulators that are tried: what the input weighs, and how far it is off for the filter."""

OFF = 0.1
"""How far off the posture a trial begins: rad of an angle, and of anything else this part of its range."""

FALLEN = 0.5
"""How far a pendulum may be off [rad]; any other output ten times as far as it begins, or this."""

QUIET = 0.5
"""Over the last quarter of a trial the output that began off is within this part of it (rms)."""

GROWS, MORE = 1.02, (1.5, 2.0, 3.0, 5.0, 8.0)
"""By how much a swing that still grows does in a quarter of a trial, and times of the limit that are tried for one that
does not."""

RANGES = ((-1.0, 1.5), (-2.5, 1.5), (-2.5, 1.0))
"""Decades of the gains, about the whole input for the allowed deviation, over a second, and over a tenth of one."""

ORDERS = tuple(itertools.product((0.6, 0.8, 1.0), (0.7, 0.8, 0.9, 1.0)))
"""Of integral and derivative, that a FOPID is tried with."""

GENERATIONS, PEOPLE, TRIES = 12, 10, 80
"""Of the search for gains by differential evolution, and of that from there on by simplices."""

UNSEEN = 0.01
"""By how much a direction that the recordings do not see may change the response, along a tenth of it."""


@dataclass(frozen=True, repr=False)
class Control(ControlRecord, CardDisplay):
    """A controller with the draws on which it holds."""

    def plot(self, *, style: str | Style = "screen") -> Figure:
        """Open loop, margins over the draws and the motion of the worst; see :func:`fracid.plots.control_loop`."""
        return draw("control_loop", self, style=style)

    def worst_motion(self) -> tuple[FloatArray, dict[str, FloatArray], float]:
        """Constants of the worst draw, its outputs, and the seconds to its end."""
        x, c = np.array(list(self.worst.values())), self.conditions
        time, y, _ = self.loop.run(x, self.design.controller, self.seed + self.worst_draw)
        outputs = {n: y[:, i] + c.reference[n] for i, n in enumerate(c.outputs)}
        return self.loop.problem.unpack(x, self.loop.experiment)[1], outputs, float(time[-1])

    def _card(self) -> Card:
        c, d = self.conditions, self.design
        return Card(f"Control of {self.model} about {c.place}", (
            ("verdict", self.sentence),
            ("controller", f"{d.controller.kind}, {len(d.controller.A)} states, {1 / c.period:.4g} Hz"),
            ("gain margin", margin_text(d.gain_margin, self.gain_margin95, "dB")),
            ("phase margin", margin_text(d.phase_margin, self.phase_margin95, "°")),
            *(("note", n) for n in self.notes),
        ))  # fmt: skip


# --- the loop as it is found ----------------------------------------------------------------------------


@dataclass(frozen=True)
class ClosedLoop:
    """A fitted model with what its controller meets."""

    problem: Problem
    x: FloatArray
    conditions: Conditions

    @property
    def experiment(self) -> Experiment:
        """The first recording, which says what is its own."""
        return self.problem.experiments[0]

    @property
    def channel(self) -> int:
        """Of the input."""
        return self.problem.model.inputs.index(self.conditions.input)

    def delay(self, x: FloatArray) -> float:
        """From the controller to what it sees: off what was given as much as off the fit [s]."""
        given, name = self.conditions.delay, self.conditions.input
        return max(0.0, given + (delay_of(self.problem, x, name) - delay_of(self.problem, self.x, name)))

    def posture(self, x: FloatArray) -> Posture:
        """Where the model rests with other values of the unknowns."""
        c, parameters = self.conditions, self.problem.unpack(x, self.experiment)[1]
        return posture_of(self.problem.model, parameters, c.posture, c.at, channel=self.channel, most=c.most or c.least)

    def plant(self, x: FloatArray) -> Plant:
        """Linearised, and reduced to the band of the loop."""
        orders, parameters, *_ = self.problem.unpack(x, self.experiment)
        c, at, model = self.conditions, self.posture(x), self.problem.model
        band = (SLOWEST * math.pi / c.period, math.pi / c.period)
        sums = {q: positive_sum(q, band, REDUCED) for q in orders.tolist()}
        system = IntegerModel(model, parameters, orders, tuple(sums[q] for q in orders.tolist()))
        linear = system.linearised(at.name, at.states, moving(model, parameters), at.inputs)
        picked = [list(model.output_states).index(n) for n in c.outputs]
        rows = tuple(linear.rows[i] for i in picked)
        size = np.abs(system.C).sum(axis=0)  # of what each z adds to its state
        balanced = replace(linear, outputs=c.outputs, rows=rows, A=linear.A * size[:, None] / size,
                           B=linear.B * size[:, None], C=linear.C[picked] / size)  # fmt: skip
        part = np.abs(system.C / (1j * math.sqrt(band[0] * band[1]) + system.decay))
        part /= part.sum(axis=1, keepdims=True)
        rates = [int(np.abs(linear.F[row]).argmax()) for row in rows]
        return Plant(balanced, self.channel, self.delay(x), part[[*rows, *rates]].T)

    @cached_property
    def fitted(self) -> Plant:
        """That of the fit, with the delay that was given."""
        return self.plant(self.x)

    def run(self, x: FloatArray, controller: Controller, seed: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Time, outputs less their reference and the input after each step, up to the end or the fall.

        It begins off where this model rests; the controller knows where that of the fit does.
        """
        c, model = self.conditions, self.problem.model
        orders, p, *_ = self.problem.unpack(x, self.experiment)
        u = np.zeros((1, len(model.inputs)))
        u[0, self.channel] = c.at_rest
        rows = np.array([model.output_states[n] for n in c.outputs])
        swung = controller.swing and controller.swing.output
        reference = np.array([c.reference[n] for n in c.outputs])
        start = self.posture(x).states
        for n, off in c.off.items():
            start[model.output_states[n]] += off
        h, samples = c.period / c.steps, math.ceil(c.seconds / c.period)
        bounds = np.tile((-np.inf, np.inf), (len(start), 1))
        for n, most in c.within.items():
            if most is not None and n != swung:
                bounds[model.output_states[n]] = c.reference[n] - most, c.reference[n] + most
        noise = np.random.default_rng(seed).standard_normal((samples + 1, len(c.outputs)))
        loop = Loop(
            law_of(controller, c), rows, reference, np.array([c.quanta[n] for n in c.outputs]),
            noise=noise * [c.noise[n] for n in c.outputs], channel=self.channel, per=c.steps,
            delay=round(self.delay(x) / h), applied=np.full(samples * c.steps + 1, c.at_rest),
            state=np.zeros((2, len(controller.A))), seen=np.zeros((4, len(rows))), inputs=u.copy(),
        )  # fmt: skip
        equation = Equation(compile_rhs(model.rhs), orders, u, p, time_scale=time_scale(model, p),
                            relaxing=model.relaxing_states)  # fmt: skip
        run = integrate(equation, InitialCondition(start), h, samples * c.steps,
                        options=Options("pi2", compressed(), limit=self.problem.simulator.limit, bounds=bounds),
                        loop=lambda rhs, run, out: step_closed(rhs, run, loop, out))  # fmt: skip
        y = (run.states[:, rows] - reference)[:: c.steps]
        if swung:  # from the upright posture that it comes to
            y[:, c.outputs.index(swung)] -= 2 * math.pi * round(y[-1, c.outputs.index(swung)] / (2 * math.pi))
        return run.time[:: c.steps], y, loop.applied[: len(run.time) : c.steps]

    def trial(self, x: FloatArray, controller: Controller, seed: int) -> dict[str, Any]:
        """Simulate, and look at the margins; plain JSON values of a :class:`Trial`."""
        c = self.conditions
        time, y, u = self.run(x, controller, seed)
        first = next(iter(c.off))
        i, allowed, last = c.outputs.index(first), c.within[first] or math.inf, 3 * len(y) // 4
        beyond = np.flatnonzero(np.abs(y[:, i]) > allowed)
        up = float(time[beyond[-1]]) if len(beyond) and controller.swing else 0.0
        ends = bool(time[-1] > c.seconds - 1.5 * c.period and up < time[last])
        quiet = float(np.sqrt(np.mean(y[last:, i] ** 2))) <= QUIET * min(abs(c.off[first]), allowed)
        gain, phase, distance = margins(self.plant(x), controller)
        return as_json(Trial, Trial(
            ends and quiet, float(time[-1]), by_name(c.outputs, np.abs(y).max(axis=0)),
            float(np.sqrt(np.mean(y[:, i] ** 2))), effort=float(np.sqrt(np.mean((u - c.at_rest) ** 2))),
            limited=float(np.mean((u <= c.least) | (u >= c.most))), gain_margin=json_number(gain), phase_margin=phase,
            distance=distance, up=up,
        ))  # fmt: skip


def delay_of(problem: Problem, x: FloatArray, channel: str) -> float:
    """What actuator and sensors of the first recording are late [s]."""
    e = problem.experiments[0]
    of = partial(problem.readings, problem.unpack(x, e).parameters)
    late = [r.delay for r in of(e.sensors).values()]
    return max(0.0, max(late, default=0.0) + sum(r.delay for n, r in of(e.actuators).items() if n == channel))


def conditions_of(
    problem: Problem, x: FloatArray, *, posture: str = "", at: Mapping[str, float] | None = None,
    input_: str | None = None, limit: float | None = None, rate: float | None = None, delay: float | None = None,
    off: Mapping[str, float] | None = None, within: Mapping[str, float] | None = None, seconds: float = SECONDS,
    begins: float = OFF,
) -> ClosedLoop:  # fmt: skip
    """The loop as the recordings have it, but for what is given; as of :func:`control`."""
    at, within = at or {}, within or {}
    model, e = problem.model, problem.experiments[0]
    for given, value in {"limit": limit, "rate": rate}.items():
        if value is not None:
            check_above_0(given, value)
    if delay is not None and not 0 <= delay < math.inf:
        raise InputError(f"delay = {delay!r}: expected a number of seconds, 0 or more.")
    if not model.inputs:
        raise InputError(f"{model.name} has no input: there is nothing to control it with.")
    for channel, s in {**e.sensors, **e.actuators}.items():
        if any(s.range(n) != (d, d) for n, d in (("gain", 1.0), ("bias", 0.0), ("lowpass", 0.0))):
            raise InputError(SAYS("sensor", channel=channel))
    name = input_ or next((n for n, u in zip(model.inputs, e.all_inputs.T, strict=True) if u.any()), model.inputs[0])
    refuse_unknown("input", model.inputs, name)
    parameters = problem.unpack(x, e)[1]
    if model.drive and parameters[model.parameter_names.index(model.drive)] == 0.0:
        raise InputError(SAYS("no-drive", model=model, name=name))
    driven = model.inputs.index(name)
    recorded = np.concatenate([f.all_inputs[:, driven] for f in problem.experiments])
    most = limit or float(np.abs(recorded).max())
    if not most > 0:
        raise InputError(SAYS("undriven", name=name, unit=model.input_units.get(name, "SI units")))
    there = posture_of(model, parameters, posture, at, channel=driven, most=most)
    at_rest = float(there.inputs[driven])  # an input of one sign that holds the posture, as a heater's, has no other
    lowest, highest, needed = recorded.min(), recorded.max(), BALANCED * most
    least = 0.0 if at_rest > needed and highest > 0 <= lowest else -most
    most = 0.0 if at_rest < -needed and lowest < 0 >= highest else most
    if not (outputs := tuple(n for n in problem.outputs if n in model.output_states)):
        raise InputError(f"None of {', '.join(problem.outputs)} is a state of {model.name}: a loop needs one.")
    y = {n: np.concatenate([f.measured[:, problem.outputs.index(n)] for f in problem.experiments]) for n in outputs}
    units = {n: e.units.get(n, model.output_unit(n)) for n in outputs}
    first = model.pendulum if model.pendulum in outputs else outputs[-1]
    away = dict(off or {}) or {first: begins * (1.0 if units[first] == "rad" else float(np.ptp(y[first])) or 1.0)}
    refuse_unknown("output", outputs, *away, *within)
    if not next(iter(away.values())):
        raise InputError(SAYS("begins-at-rest", name=next(iter(away))))
    far = {n: FALLEN if n == model.pendulum else 10 * abs(away[n]) if n in away else math.inf for n in outputs}
    period = e.step if rate is None else 1 / rate
    conditions = Conditions(
        there.name, by_name(model.states, there.states), name, model.input_units.get(name, "1"),
        at_rest=at_rest, least=least, most=most,
        delay=delay_of(problem, x, name) if delay is None else delay, period=period,
        steps=max(1, math.ceil(period * problem.substeps / e.step - 1e-9)), outputs=outputs,
        reference={n: float(there.states[model.output_states[n]]) for n in outputs}, units=units,
        quanta={n: resolution(v) or 0.0 for n, v in y.items()},
        noise={n: noise_floor(e.measured[:, problem.outputs.index(n)]) or 0.0 for n in outputs}, off=away,
        within={n: v if math.isfinite(v) else None for n, v in (far | dict(within)).items()}, seconds=seconds,
        at=dict(at),
    )  # fmt: skip
    return ClosedLoop(problem, x, conditions)


# --- draws ----------------------------------------------------------------------------------------------


def draws_of(problem: Problem, x: FloatArray, count: int, seed: int, jobs: int) -> tuple[FloatArray, FloatArray]:
    """Unknowns as probable as their intervals say, within their bounds, and directions that were not seen.

    Raises
    ------
    InputError
        If the unknowns have no intervals.
    """
    if not len(x):
        return np.tile(x, (count, 1)), np.empty((0, 0))
    found = uncertainty(problem, x, jobs=jobs)
    if isinstance(found, Failure):
        raise InputError(f"How sure the values are is not known, so no controller can be judged: {found}")
    known = np.isfinite(np.diag(found.covariance))
    random, points = np.random.default_rng(seed), np.tile(x, (count, 1))
    if known.any():
        some = np.ix_(known, known)
        points[:, known] = random.multivariate_normal(x[known], found.covariance[some], count, check_valid="ignore")
    for i in np.flatnonzero(~known & np.isfinite(found.ends).all(axis=1)):  # at a bound: each side of its own
        z = random.standard_normal(count) / NORMAL_95
        points[:, i] = x[i] + np.where(z < 0, z * (x[i] - found.ends[i, 0]), z * (found.ends[i, 1] - x[i]))
    return problem.space.clipped(points), found.unseen


def _refuse_unseen(loop: ClosedLoop, unseen: FloatArray) -> None:
    """What the recordings cannot tell must not matter to the loop."""
    top = math.pi / loop.conditions.period
    omega = np.geomspace(1e-3 * top, 0.5 * top, 50)
    here = loop.fitted.response(omega, loop.conditions.period)
    for direction in unseen:
        other = loop.problem.space.clipped(loop.x * (1 + 0.1 * direction))
        there = loop.plant(other).response(omega, loop.conditions.period)
        if np.abs(there - here).max() > UNSEEN * np.abs(here).max():
            names = [n for n, d in zip(loop.problem.names, direction, strict=True) if abs(d) > UNSEEN]
            raise InputError(SAYS("not-separated", names=" and ".join(names), loop=loop))


def control(
    fit: Fit,
    *,
    jobs: int = 1,
    journal: Journal | None = None,
    progress: Callable[[Progress], None] | None = None,
    **loop: Any,
) -> Control:
    """Design a controller of a fit, and simulate it over what is known of the model.

    Parameters
    ----------
    fit : Fit or SavedRun
    jobs : int
        Threads; the result is the same for any number.
    journal, progress
        As for :func:`fracid.run_tasks`.
    **loop
        What follows here.
    draws : int
        Of the unknowns.
    points : ndarray, shape (draws, n_unknowns), optional
        The draws, such as those of a posterior, in place of the covariance's.
    seed : int
        Random seed.
    kind : str
        ``lqr``, regulators of several weights; ``pid``, a PID of the output that begins off, beside a fractional one
        of the same effort; or ``swing``, several pumps that swing a pendulum up from hanging before a regulator.
    posture : str
        ``upright`` or ``hanging`` of a pendulum; ``upright`` if left out.
    at : mapping, optional
        Output → its value at the posture.  Where it names some, the others are found, but of a pendulum; where it names
        none, all are 0.
    input_ : str, optional
        The one that is driven.
    limit : float, optional
        The greatest input; that of the recordings if left out.
    rate, delay : float, optional
        Samples a second of the controller, and seconds until its input shows; those of the recording if left out.
    off, within : mapping, optional
        Output → how far from the posture it begins, and may go.
    seconds : float
        Of a simulation.

    Returns
    -------
    Control

    Raises
    ------
    InputError
        For a model without input or posture, a loop whose gain is not identifiable, a delay that it cannot bear, an
        input too weak to swing up.

    Examples
    --------
    >>> import fracid
    >>> from types import SimpleNamespace
    >>> still = fracid.Experiment("twin", 0.01, np.zeros((500, 1)), np.zeros((1, 1)), initial={"angle": 0.3})
    >>> problem = fracid.Problem(fracid.model("pendulum"), (still,), {"mu": 0.97}, initial_state="held")
    >>> found = control(SimpleNamespace(problem=problem, x=problem.start), limit=0.3, draws=2, seconds=4.0)
    >>> found.share, found.design.phase_margin > 30
    (1.0, True)
    """
    return planned(fit, jobs=jobs, **loop).run(jobs=jobs, journal=journal, progress=progress)


def planned(
    fit: Fit, *, draws: int = DRAWS, points: FloatArray | None = None, seed: int = 1, jobs: int = 1, kind: str = "lqr",
    **loop: Any,
) -> Plan:  # fmt: skip
    """What is to be tried; refuses what cannot be controlled."""
    designs, begins = entry_of("kind of controller", KINDS, kind)
    closed, unseen = conditions_of(fit.problem, fit.x, begins=begins, **loop), np.empty((0, 0))
    if (c := closed.conditions).authority <= 0:
        raise InputError(SAYS("at-rest", c=c, needed=with_unit(c.at_rest, c.unit), most=with_unit(c.most, c.unit)))
    if points is None:
        points, unseen = draws_of(fit.problem, fit.x, draws, seed, jobs=jobs)
    _refuse_unseen(closed, unseen)
    return Plan(closed, points, designs(closed, seed), seed)


@dataclass(frozen=True)
class Plan:
    """A loop, draws of its unknowns and the designs to be tried on them."""

    loop: ClosedLoop
    points: FloatArray
    designs: list[Controller]
    seed: int

    def run(self, **how: Any) -> Control:
        """Try the designs on the first draws, and the best on all; `how` is of :func:`fracid.run_tasks`."""
        first, c = min(FIRST, len(self.points)), self.loop.conditions
        total = (len(self.designs) - 1) * first + len(self.points)
        trials = self._tried(self.designs, range(first), Part("trials", 0, total), how)
        tried = tuple(_design(self.loop, d, t) for d, t in zip(self.designs, trials, strict=True))
        up = [float(np.median([t.up for t in some if t.holds] or [0.0])) for some in trials]
        worth = [d.distance**2 / c.weighed(d.error, d.effort) for d in tried]
        best = max(range(len(tried)), key=lambda i: (tried[i].held, -up[i], worth[i]))
        if not tried[best].held and self.designs[0].swing:
            raise InputError(_not_up(self.loop, self.designs, first, self.seed))
        if not tried[best].held:
            late = f" A delay of {1e3 * c.delay:.3g} ms may be more than the loop bears." * (c.delay > 0)
            off = ", ".join(f"{n} {with_unit(v, c.units[n])}" for n, v in c.off.items())
            raise InputError(SAYS("none-holds", count=len(tried), c=c, first=first, off=off,
                                  most=with_unit(c.most, c.unit), late=late))  # fmt: skip
        done, chosen = len(self.designs) * first, self.designs[best]
        (more,) = self._tried([chosen], range(first, len(self.points)), Part("trials", done, total), how)
        judged = (*trials[best], *more)
        near = [(t.holds, t.until, -t.up, t.distance) for t in judged]  # to falling, and then to instability
        worst = near.index(min(near))
        return Control(
            self.loop.problem.model.name, c, _design(self.loop, chosen, judged), tried, trials=judged,
            worst=self.loop.problem.named(self.points[worst]), worst_draw=worst, seed=self.seed,
            share95=binomial95(sum(t.holds for t in judged), len(judged)), notes=(*self._notes(tried, chosen),),
            loop=self.loop,
        )  # fmt: skip

    def _tried(self, designs: list[Controller], draws: range, part: Part, how: Mapping[str, Any]) -> list[list[Trial]]:
        """Of each design its trials."""
        content = json.dumps(as_json(Conditions, self.loop.conditions)).encode() + self.points.tobytes()
        mark = sha256(content).hexdigest()[:12]  # of all that a trial depends on beside its design and draw
        tasks = [
            Task(f"{mark} {d.kind} {json.dumps(d.weights)}, draw {k}", (self.points[k], d, self.seed + k))
            for d in designs for k in draws
        ]  # fmt: skip
        done = iter(run_tasks(self.loop.trial, tasks, part=part, **how).values())
        return [[record_of(Trial, next(done)) for _ in draws] for _ in designs]

    def _notes(self, tried: Sequence[Design], chosen: Controller) -> Iterator[str]:
        """What it rests on, what a FOPID brings beside a PID of the same effort, and how many swings it takes."""
        loop, kinds = self.loop, {d.controller.kind: d for d in tried}
        if not any(np.any(e.all_inputs) for e in loop.problem.experiments):
            yield f"Nothing drove the recordings: what {loop.conditions.input} does rests on constants that were given."
        if set(kinds) == {"PID", "FOPID"}:
            part, whole = kinds["FOPID"], kinds["PID"]
            yield SAYS("fopid", error=part.error / whole.error, effort=part.effort / whole.effort)
        if chosen.swing:  # at the fitted values
            time, y, _ = loop.run(loop.x, chosen, self.seed)
            up = loop.trial(loop.x, chosen, self.seed)["up"]
            slopes = np.diff(y[time <= up, loop.conditions.outputs.index(chosen.swing.output)])
            turns = int(np.count_nonzero(np.diff(np.sign(slopes[slopes != 0]))))
            yield SAYS("swings", count=turns + 1, swings="swing" if not turns else "swings", up=up)


def _regulators(loop: ClosedLoop, _seed: int) -> list[Controller]:
    c = loop.conditions
    allowed = np.array([c.within[n] or max(map(abs, c.off.values())) for n in c.outputs])
    noise = np.array([math.hypot(c.noise[n], c.quanta[n] / math.sqrt(12)) for n in c.outputs])
    noise = np.maximum(noise, 1e-4 * allowed)
    weights = itertools.product(*WEIGHTS.values())
    return [regulator(loop.fitted, c.period, allowed, c.authority, noise, *w) for w in weights]


def _loops(loop: ClosedLoop, seed: int) -> list[Controller]:
    r"""A PID of the output that begins off, and a FOPID of the same effort, tuned on the simulation of the fit.

    A PID minimises the mean of :math:`(y/\bar y)^2 + (u/\bar u)^2`; a FOPID of each of :data:`ORDERS` the same, with no
    more than the PID's effort (rms of u) and an open loop no nearer to −1 (the same maximum sensitivity), which is what
    makes the two comparable.
    """
    c = loop.conditions
    name = next(iter(c.off))
    place = c.outputs.index(name)
    early = loop.fitted.linear.exact_response(np.array([-0.5j / c.period]))[0, place, loop.channel].real

    def made(z: FloatArray, orders: tuple[float, float] = (1.0, 1.0), kind: str = "PID") -> Controller:
        gains = math.copysign(c.authority / abs(c.off[name]), early) * 10**z * np.array([1.0, 1.0, 0.1])
        return pid(gains.tolist(), orders, c.period, place, outputs=len(c.outputs), kind=kind)

    def ran(controller: Controller) -> tuple[float, float, float]:
        """How long it held, the error's and the input's rms."""
        time, y, u = loop.run(loop.x, controller, seed)
        error, effort = (float(np.sqrt(np.mean(v**2))) for v in (y[:, place], u - c.at_rest))
        return float(time[-1]), error, effort

    def judged(z: FloatArray, bounds: tuple[float, float], *fractional: Any) -> float:
        """Less is better; the bounds are of the effort and of the distance from −1."""
        controller, (allowed, distance) = made(z, *fractional), bounds
        held, error, effort = ran(controller)
        near = max(0.0, 1 - margins(loop.fitted, controller)[2] / distance) if distance else 0.0
        short = max(0.0, 1 - held / (c.seconds - 1.5 * c.period)) + max(0.0, effort / allowed - 1) + near
        return c.weighed(error, effort) + 10 * short

    refined = partial(minimize, judged, method="Nelder-Mead", options={"maxfev": TRIES})
    rough = differential_evolution(judged, RANGES, ((np.inf, 0.0),), maxiter=GENERATIONS, popsize=PEOPLE, rng=seed,
                                   polish=False)  # fmt: skip
    z = refined(rough.x, ((np.inf, 0.0),)).x
    plain = made(z)
    bounds = ran(plain)[2], margins(loop.fitted, plain)[2]
    found = {orders: refined(z, (bounds, orders, "FOPID")) for orders in ORDERS}
    best = min(ORDERS, key=lambda orders: found[orders].fun)
    return [plain, made(found[best].x, best, "FOPID")]


def _swings(loop: ClosedLoop, seed: int) -> list[Controller]:
    """Pumps before the regulator that stays farthest from −1, where a pendulum hangs."""
    c, model = loop.conditions, loop.problem.model
    if not model.pendulum or c.posture != UPRIGHT:
        raise InputError(SAYS("no-upright", model=model, posture=c.posture))
    if missing := [n for n in model.output_states if n not in c.outputs]:
        raise InputError(SAYS("unseen", names=" and ".join(missing), outputs=" and ".join(c.outputs)))
    p = loop.problem.unpack(loop.x, loop.experiment)[1]
    tried = swings(loop.fitted.linear, model, moving(model, p), c)
    carried = {tried[0].arm: c.within.get(tried[0].arm) or 1 / abs(tried[0].lift[1])} if tried[0].arm else {}
    near = replace(loop, conditions=replace(c, off={model.pendulum: OFF}, within={**c.within, **carried}))
    held = max(_regulators(near, seed), key=lambda found: margins(loop.fitted, found)[2])
    return [with_swing(held, swing, loop.fitted.begins) for swing in tried]


def _not_up(loop: ClosedLoop, designs: Sequence[Controller], first: int, seed: int) -> str:
    """Why a pendulum does not get up with the fitted values, and what would do."""
    c, place = loop.conditions, loop.conditions.outputs.index(loop.problem.model.pendulum)
    runs = [loop.run(loop.x, d, seed) for d in designs]
    heights = [np.degrees(np.abs(np.remainder(y[:, place], 2 * math.pi) - math.pi)) for _, y, _ in runs]
    best = max(range(len(runs)), key=lambda i: heights[i].max())
    until, (*_, third, fourth) = runs[best][0][-1], np.array_split(heights[best], 4)
    if until < c.seconds - 1.5 * c.period:
        why = SAYS("swing-left", until=until)
    elif heights[best].max() > math.degrees(math.pi - CATCH):
        why = SAYS("swing-not-caught")
    elif fourth.max() > GROWS * third.max():
        why = SAYS("swing-too-short", c=c)
    else:
        why = SAYS("swing-too-weak", enough=_enough(loop, seed))
    return SAYS("not-up", count=len(designs), first=first, c=c, most=with_unit(c.most, c.unit),
                height=heights[best].max(), why=why)  # fmt: skip


def _enough(loop: ClosedLoop, seed: int) -> str:
    """The input with which the fitted values get up."""
    c = loop.conditions
    for times in MORE:
        more = replace(loop, conditions=replace(c, least=times * c.least, most=times * c.most))
        if any(more.trial(loop.x, d, seed)["holds"] for d in _swings(more, seed)):
            return with_unit(times * c.most, c.unit)
    return f"more than {with_unit(MORE[-1] * c.most, c.unit)}"


KINDS = {"lqr": (_regulators, OFF), "pid": (_loops, OFF), "swing": (_swings, HANGS)}
"""What is tried, by name, and how far off it begins."""


def _design(loop: ClosedLoop, controller: Controller, trials: Sequence[Trial]) -> Design:
    held = sum(t.holds for t in trials)
    gain, phase, distance = margins(loop.fitted, controller)
    error, effort = np.median([(t.error, t.effort) for t in trials], axis=0).tolist()
    return Design(controller, len(trials), held, json_number(gain), phase_margin=phase, distance=distance, error=error,
                  effort=effort)  # fmt: skip
