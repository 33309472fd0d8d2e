"""From the unknowns x to what the model measures: each recording's run, on its own grid.

A trajectory is stepped on the recording's own grid, or `substeps` times finer.  A run that diverges gives no outputs
but its reason.

A release time τ lies between samples as well: the run starts at τ, on its own grid, and is read at the samples
by :meth:`Trajectory.at`, which follows τ smoothly; inputs keep the recording's clock.  It needs a start
at rest, for a motion that is under way can begin anywhere.

A channel that is late, scaled, offset or filtered (:mod:`fracid.problem.sensors`) is so here: outputs after the run,
which goes on a little longer where one may be early, inputs before it.

At uneven samples an output is that of states and inputs there: read between two steps, what jumps at a sample would be
of both sides of the jump.

With a `memo` nothing is simulated twice: outputs are kept under a hash of all that they depend on.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import blake2b
from typing import Any

import numpy as np

from fracid.arrays import ROUNDED, FloatArray
from fracid.errors import Failure, FailureReason
from fracid.models.base import FadingState
from fracid.problem.coarse import means, stepped
from fracid.problem.experiment import Experiment
from fracid.problem.parametrisation import Parametrisation
from fracid.problem.sensors import Reading
from fracid.problem.unknowns import ends_of
from fracid.solver.arguments import Equation, InitialCondition, Options, Relaxations
from fracid.solver.inputs import Driven, between_samples, low_passed, low_passed_steps
from fracid.solver.memory import Memory
from fracid.solver.outputs import output_along
from fracid.solver.right_hand_side import compile_rhs
from fracid.solver.solve import integrate_all, time_scale
from fracid.solver.trajectory import Trajectory, between
from fracid.tasks.simulation_cache import Memo, Recent

GRAVITY = 9.80665
"""[m/s^2]"""

LIMIT = 1e4
"""A state beyond this [rad, rad/s] ends a run as diverged; what is no angle, beyond so many times what was measured."""

UNMEASURED = 1e12
"""The same where something moves that nobody measures, and whose unit may be small: a pressure behind a cylinder."""

ENDLESS = 1e100
"""An output beyond this has no square: one over a parameter that is 0."""


@dataclass(frozen=True, eq=False)
class Simulator:
    """(x, experiment) → trajectory and outputs.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Problem
    >>> still = Experiment("still", 0.1, np.zeros((9, 2)), np.zeros((1, 1)))
    >>> problem = Problem(fracid.rotary_pendulum("srv02-rotpen"), (still,), {"lambda": 0.9, "mu": 0.9})
    >>> problem.simulator.all_outputs([problem.start], still)[0].shape
    (9, 2)
    """

    parametrisation: Parametrisation
    method: str
    memory: Memory
    memo: Memo | Recent | None
    """Has what was simulated before, and keeps what will be."""

    @cached_property
    def all_steps(self) -> int:
        """Of a run of all recordings."""
        return sum(self.steps(e) for e in self.parametrisation.experiments)

    @property
    def work(self) -> int:
        """Of a run of all recordings: steps times states, and what each run takes beside them, in the same unit."""
        p = self.parametrisation
        return len(p.model.states) * self.all_steps + BESIDE * len(p.experiments)

    def all_errors(self, points: Sequence[FloatArray]) -> list[list[FloatArray] | Failure]:
        """Measured minus simulated of each recording [rad], shape (n_samples, n_outputs), or why there is none.

        At each of several points, whose runs go together where they can.  In standard deviations where the recording
        knows these; 0 where a sample is not scored.
        """
        errors: list[list[FloatArray] | Failure] = [[] for _ in points]
        for e in self.parametrisation.experiments:
            left = [k for k, found in enumerate(errors) if not isinstance(found, Failure)]
            for k, outputs in zip(left, self.all_outputs([points[k] for k in left], e), strict=True):
                found = errors[k]
                if isinstance(outputs, Failure):
                    errors[k] = outputs
                elif not isinstance(found, Failure):
                    error = e.in_deviations(e.measured - outputs)
                    found.append(error if e.partly is None else np.where(e.partly, error, 0.0))
        return errors

    def all_outputs(self, points: Sequence[FloatArray], e: Experiment) -> list[FloatArray | Failure]:
        """Simulated outputs [rad], shape (n_samples, n_outputs), or why there are none, at each of several points."""
        if self.memo is None:
            runs = self.trajectories(points, e, range(len(points)))
            return [self._outputs(x, e, runs[k]) for k, x in enumerate(points)]
        keys = [self._key(x, e) for x in points]
        found: dict[bytes, Any] = {key: self.memo.find(key) for key in keys}
        distinct = dict(zip(keys, points, strict=True))
        missing = [k for k, key in enumerate(distinct) if found[key] is None]
        runs = self.trajectories([*distinct.values()], e, missing) if missing else {}
        for k, (key, x) in enumerate(distinct.items()):
            if k in runs:
                found[key] = self.memo.keep(key, self._outputs(x, e, runs[k]))
        return [found[key] for key in keys]

    def _outputs(self, x: FloatArray, e: Experiment, run: Trajectory) -> FloatArray | Failure:
        if not run.completed:
            return Failure(FailureReason.RUN, f"{e.name}: {run.outcome.value} at t = {run.time[-1]:.4g} s")
        p, time = self.parametrisation, self._grid(e)[0].time
        readings = p.readings(p.unpack(x, e).parameters, e.sensors) if e.sensors else {}
        plain = {*p.outputs} - {*p.model.derived, *p.model.output_states, *readings} if e.times is not None else ()
        outputs = [
            self._at_samples(x, e, run, n) if n in plain else
            _read(self._signal(x, e, run, n), time, readings.get(n, Reading()), even=e.times is None) for n in p.outputs
        ]  # fmt: skip
        simulated = means(np.column_stack(outputs), min(p.substeps, e.means))
        if not np.all(np.abs(simulated) < ENDLESS):
            return Failure(FailureReason.RUN, f"{e.name}: an output is not finite")
        return simulated

    def _at_samples(self, x: FloatArray, e: Experiment, run: Trajectory, output: str) -> FloatArray:
        """An output at uneven samples, of states and inputs there: an input that jumps at a sample has jumped."""
        p, u, times = self.parametrisation, self.inputs(x, e).after, np.clip(e.time, run.time[0], run.time[-1])
        jumped = e.step * np.ceil(times / e.step - ROUNDED)
        at = [jumped if e.between.get(n) == "hold" else times for n in p.model.inputs]
        rows = [np.interp(t, run.time[-len(c) :], c) for t, c in zip(at, u.T, strict=True)]
        y, now = p.model.outputs[output], np.reshape(rows, (-1, len(times))).T
        return output_along(y, times, between(run, times), now, p=p.unpack(x, e).parameters)  # type: ignore[arg-type]

    def _signal(self, x: FloatArray, e: Experiment, run: Trajectory, output: str) -> Trajectory:
        """One output on the grid of a run."""
        model = self.parametrisation.model
        y = model.outputs[output]
        if isinstance(y, int):
            return replace(run, states=run.states[:, y : y + 1], orders=run.orders[[y]])
        u, p = self.inputs(x, e).after, self.parametrisation.unpack(x, e).parameters
        values = output_along(y, run.time, run.states, u[-len(run.time) :] if len(u) > 1 else u, p=p)
        # a function begins like the state that rises most steeply
        orders = np.ones(1) if output in model.derived else run.orders.min(keepdims=True)
        if output in model.derived:
            from scipy.interpolate import CubicSpline

            angle, values = values, CubicSpline(run.time, values)(run.time, model.derived[output][1])
            if radius := self.parametrisation.readings(p, e.sensors).get(output, Reading()).radius:
                gravity = -GRAVITY if model.zero == "upright" else GRAVITY
                values = radius * values + gravity * np.sin(angle)
        return replace(run, states=values[:, None], orders=orders)

    def trajectories(self, points: Sequence[FloatArray], e: Experiment, wanted: Sequence[int]) -> dict[int, Trajectory]:
        """The runs of one recording from its release on, on its grid divided by `substeps`, of those points `wanted`.

        To the bit they are what they are where all are wanted, whatever is known of a fit that is resumed.
        """
        grid, substeps = self._grid(e)
        posed = [self._posed(x, e) for x in points]
        options = Options(self.method, self.memory, limit=self.limit)
        return integrate_all(posed, grid.step / substeps, self.steps(e), options=options, wanted=wanted)

    def _posed(self, x: FloatArray, e: Experiment) -> tuple[Equation, InitialCondition]:
        orders, parameters, initial, release = self.parametrisation.unpack(x, e)
        model, history, u = self.parametrisation.model, self.history(x, e), self.inputs(x, e)
        fading = tuple(_relaxations(m, parameters.tolist(), initial.tolist()) for m in model.memories)
        if fading:  # what relaxations hold at the start stands behind the states that are simulated
            n = min(i for m in model.memories for i in m.held)
            orders, initial = orders[:n], initial[:n]
        equation = Equation(
            compile_rhs(model.rhs), orders, u.before, parameters, time_scale=time_scale(model, parameters),
            relaxing=model.relaxing_states, after=u.jumps, fading=fading,
        )  # fmt: skip
        return equation, InitialCondition(initial, time=release, history=history)

    # --- the grid of a run -------------------------------------------------------------------------

    def _grid(self, e: Experiment) -> tuple[Experiment, int]:
        """A recording as its run goes through it, and in how many steps a sample of that."""
        substeps = self.parametrisation.substeps
        return (e, substeps) if e.means == 1 else (self._stepped[e.name], max(1, substeps // e.means))

    @cached_property
    def _stepped(self) -> dict[str, Experiment]:
        """Each coarser recording with a sample a step, or all of its source."""
        p = self.parametrisation
        return {e.name: stepped(e, p.substeps, p.model.inputs) for e in p.experiments if e.means > 1}

    def steps(self, e: Experiment) -> int:
        """Steps of a run: from any release it reaches the last sample, so that all have the same memory."""
        early = max(0.0, -ends_of(e.release_time)[0]) + max((s.earliest for s in e.sensors.values()), default=0.0)
        grid, substeps = self._grid(e)
        return grid.steps * substeps + math.ceil(early * substeps / grid.step)

    def history(self, x: FloatArray, e: Experiment) -> FloatArray | None:
        """The states before the start of one recording, as :func:`fracid.simulate` takes them; None without a past."""
        past = self.parametrisation.pasts.get(e.name)
        return None if past is None else past.states(*self.parametrisation.unpack(x, e)[:2])[:-1]

    def inputs(self, x: FloatArray, e: Experiment) -> Driven:
        """The inputs on the grid of a run from its release; before the first and after the last sample they stay."""
        if e.name in self._fixed_inputs:
            return self._fixed_inputs[e.name]
        values = self.parametrisation.unpack(x, e)
        return self._driven(e, values.release, self.parametrisation.readings(values.parameters, e.actuators))

    @cached_property
    def _fixed_inputs(self) -> dict[str, Driven]:
        """The inputs of those recordings in which no unknown moves them."""
        fixed = [e for e in self.parametrisation.experiments
                 if e.release_time == 0.0 and not any(s.free(n) for n, s in e.actuators.items())]  # fmt: skip
        return {e.name: self._driven(e, 0.0, {n: s.reading(n, {}) for n, s in e.actuators.items()}) for e in fixed}

    def _driven(self, e: Experiment, release: float, actuators: Mapping[str, Reading]) -> Driven:
        """The inputs as actuators make them of those recorded, a column each, or one row for all."""
        (grid, substeps), begun = self._grid(e), self._first(e)
        u = grid.all_inputs
        if not u.size or (len(u) == 1 and not actuators):
            return Driven(u[:1], u[:1])
        count = self.steps(e) + 1 + (0 if e.past is None else len(e.past) * substeps - begun)
        first, spacing = begun / substeps + release / grid.step, 1 / substeps
        driven = []
        for name, column in zip(self.parametrisation.model.inputs, u.T, strict=True):
            delay, gain, bias, lowpass, _ = actuators.get(name, Reading())
            sides = Driven(column, column)
            if len(u) > 1:
                kind = e.between.get(name, "line")
                moved = between_samples(column, kind, first - delay / grid.step, spacing, count=count)
                sides = low_passed_steps(moved, grid.step * spacing, lowpass)
            driven.append(Driven(*(gain * v + bias for v in sides)))
        return Driven(*(np.column_stack(side) for side in zip(*driven, strict=True)))

    def _first(self, e: Experiment) -> int:
        """The step of the past with which the memory begins."""
        past = self.parametrisation.pasts.get(e.name)
        return 0 if past is None or len(e.all_inputs) == 1 else past.release * self.parametrisation.substeps

    @cached_property
    def limit(self) -> float:
        """The state beyond which a run has diverged, here and wherever the identified model is run again."""
        p, model = self.parametrisation, self.parametrisation.model
        seen = {i for n, i in model.output_states.items() if n in p.outputs or model.output_unit(n) == "rad"}
        known = seen.union(model.relaxing_states, (rate for i, rate in model.rates.items() if i in seen))
        limit = LIMIT if len(known) == len(model.states) else UNMEASURED
        return limit * max(float(np.max(p.sizes(e), initial=1.0)) for e in p.experiments)

    # --- what the memo goes by ---------------------------------------------------------------------

    def _key(self, x: FloatArray, e: Experiment) -> bytes:
        """A hash of all that the simulation of one recording depends on."""
        digest = self._constant[e.name].copy()
        own = len(e.measured), e.step, e.release_time, e.means, e.sensors, e.actuators, e.between
        digest.update(repr(own).encode())
        for vector in (*self.parametrisation.unpack(x, e), () if e.times is None else e.times):
            digest.update(np.ascontiguousarray(vector).data)
        return bytes(digest.digest())

    @cached_property
    def _constant(self) -> dict[str, Any]:
        """For each recording the hash of what no unknown changes."""
        p = self.parametrisation
        model, rhs = p.model, getattr(p.model.rhs, "py_func", p.model.rhs)
        how = (model.name, model.zero, model.source, rhs.__module__, rhs.__qualname__, rhs.__code__.co_code,
               p.outputs, self.method, self.memory.name, p.substeps, p.initial_state)  # fmt: skip
        functions = (getattr(h, "py_func", h) for h in p.model.outputs.values() if not isinstance(h, int))
        how += tuple((h.__module__, h.__qualname__, h.__code__.co_code, h.__code__.co_consts) for h in functions)
        digests = {}
        for e in p.experiments:
            arrays = [e.sampled.all_inputs, *([] if e.past is None else [e.past, e.measured])]
            digests[e.name] = blake2b(repr((how, [a.shape for a in arrays])).encode(), digest_size=16)
            for array in arrays:
                digests[e.name].update(np.ascontiguousarray(array).data)
        return digests


def _relaxations(memory: FadingState, p: list[float], x: list[float]) -> Relaxations:
    shares, held = (tuple(v[i] for i in where) for v, where in ((p, memory.shares), (x, memory.held)))
    return Relaxations(memory.state, shares, tuple(math.exp(p[i]) for i in memory.times), held)


BESIDE = 10_000
"""Steps times states that take as long as a run of no step: its tables, its start, its outputs."""

EDGE = 9
"""Within so many steps of the beginning, where a solution rises like t^q, a run is read by its own rule."""


def _read(run: Trajectory, times: FloatArray, reading: Reading, *, even: bool) -> FloatArray:
    """What a sensor shows of a signal at some times [s]; before the run its first value."""
    if reading == Reading() and run.time[0] == 0.0 and even:
        return run.states[:: round((times[1] - times[0]) / run.step), 0][: len(times)]
    y = low_passed(run.states[:, 0], run.step, reading.lowpass)
    then = np.minimum(times - reading.delay, run.time[-1])
    output = np.full(len(times), y[0])
    inner, interior = _evenly(y, then, run) if even else (slice(0, 0), np.empty(0))
    edges = then >= run.time[0]
    edges[inner] = False
    output[inner], output[edges] = interior, between(replace(run, states=y[:, None]), then[edges])[:, 0]
    return np.asarray(reading.gain * output + reading.bias)


def _evenly(y: FloatArray, times: FloatArray, run: Trajectory) -> tuple[slice, FloatArray]:
    """Read the cubic through the nearest four steps where that is the same for all: which times, and its values.

    Times that are whole steps apart lie at the same place between steps, so that Lagrange's weights are theirs all.
    """
    every = round((times[1] - times[0]) / run.step)
    place = (times[0] - run.time[0]) / run.step
    base = math.floor(place)
    s = place - base
    begin = max(0, -((base - EDGE) // every))
    count = (len(y) - 3 - base) // every + 1 - begin
    first = base + every * begin - 1
    weights = (-s * (s - 1) * (s - 2) / 6, (s * s - 1) * (s - 2) / 2, -s * (s + 1) * (s - 2) / 2, s * (s * s - 1) / 6)
    count = max(0, min(count, len(times) - begin))
    values = sum(w * y[first + k :: every][:count] for k, w in enumerate(weights))
    return slice(begin, begin + count), np.asarray(values)
