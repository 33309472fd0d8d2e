r"""The unknowns x: which they are, where a search of them starts, and what each recording's run takes from them.

Each order and parameter is a number (fixed), :class:`Free` within bounds, or :class:`Tied` to another.  The
unknowns x, in this order, are

1. the free orders, λ and μ of (25), and the free parameters, which all recordings share,
2. for each recording the parameters named in `per_recording`, which it has for itself,
3. for each recording its initial state, unless that is taken as measured, and
4. its release time, where that is free: until then the initial state is held, then the motion begins.

``initial_state`` is one of

=============  ====================================================================================
``estimate``   the scored outputs, their rates and what a joint has given are free: the start may be in motion
``rest``       the scored outputs are free, their rates are 0: a held plateau
``measured``   nothing is free: outputs as measured, rates from the slope of the first samples
``held``       nothing is free: outputs as measured, rates 0: the paper's release
=============  ====================================================================================

What a joint has given at the start, z(0), is counted in its δ: from −1 to 1 of ``presliding_…``.  Where the joint
slides already nothing is free: z is where what it gains and what it forgets are in balance, sliding friction's part of
the breakaway torque.
States of which nothing is measured, and those that only a function of them shows, start at 0, and one named in an
experiment's ``initial`` at its value there; a range there is an unknown, under any ``initial_state``.
The rate of a state i is the state j of which the model says :math:`D^q x_i = x_j`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import KW_ONLY, dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from fracid.arrays import BoolArray, FloatArray, by_name
from fracid.models import Model
from fracid.optimise import Space
from fracid.problem.experiment import Experiment
from fracid.problem.past import Past
from fracid.problem.sensors import Reading, Sensor, integrated
from fracid.problem.unknowns import Free, InitialState, Prior, Tied, Unknown, Values, root_of, starting_value
from fracid.solver.right_hand_side import compile_rhs

SOON = 10
"""A joint that goes further than its δ in so many samples slides from the start: what it had given is forgotten."""

EVERY = ("every output",)
"""In place of the outputs that are scored: all that the model has."""

TURNS = 100.0
"""No angle goes beyond this [rad]: what does is in another unit, whatever is said of it."""


class RunValues(NamedTuple):
    """What the run of one recording takes from x."""

    orders: FloatArray
    """Of each state, shape (n_states,)."""
    parameters: FloatArray
    """p, shape (n_parameters,)."""
    initial: FloatArray
    """x at the release, shape (n_states,)."""
    release: float
    """When the motion begins, from the first sample [s]."""


@dataclass(frozen=True, eq=False, repr=False)
class Parametrisation:
    """Between the unknowns x and what the model has by name.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Problem
    >>> still = Experiment("still", 0.1, np.zeros((9, 2)), np.zeros((1, 1)))
    >>> orders = {"lambda": Free(0.9, 0.5, 1.2), "mu": Tied("lambda")}
    >>> problem = Problem(fracid.rotary_pendulum("srv02-rotpen"), (still,), orders, initial_state="held")
    >>> problem.names, problem.aliases, problem.unpack(np.array([0.8]), still).orders.tolist()
    (('lambda',), {'mu': 'lambda'}, [0.8, 0.8, 0.8, 0.8])
    """

    model: Model
    experiments: tuple[Experiment, ...]
    orders: Values
    """One per order's name: a number is fixed."""
    parameters: Values = field(default_factory=dict)
    """Those that differ from the model's own values: a number is fixed."""
    per_recording: tuple[str, ...] = ()
    """Names of free parameters that each recording has for itself."""
    _: KW_ONLY
    outputs: tuple[str, ...] = EVERY
    """Which are scored: the columns of what was measured."""
    initial_state: InitialState = "estimate"
    substeps: int = 1
    """Steps per sample of the recording."""

    # --- x and its space ---------------------------------------------------------------------------

    @cached_property
    def unknowns(self) -> tuple[Unknown, ...]:
        """The entries of x, in order."""
        units = {p.name: p.unit for p in self.model.parameters}
        orders, free = ({n: v for n, v in of.items() if isinstance(v, Free)} for of in (self.orders, self.parameters))
        unknowns = [Unknown(n, "", "order", n, experiment=None, range=v) for n, v in orders.items()]
        shared = {n: v for n, v in free.items() if n not in self.per_recording}
        unknowns += [Unknown(n, units[n], "parameter", n, experiment=None, range=v) for n, v in shared.items()]
        begun = set[str]()
        for e in self.experiments:
            for name in self.per_recording if (of := e.recording.name) not in begun else ():
                label = f"{name} [{of}]"
                unknowns.append(Unknown(label, units[name], "parameter", name, experiment=of, range=free[name]))
            begun.add(of)
            unknowns += self._initial_unknowns(e)
            if isinstance(e.release_time, Free):
                unknowns.append(Unknown(f"release_time [{e.name}]", "s", "time", "release_time", experiment=e.name,
                                        range=e.release_time))  # fmt: skip
        return tuple(unknowns)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns."""
        return tuple(u.name for u in self.unknowns)

    @cached_property
    def order_indices(self) -> tuple[int, ...]:
        """Which of the unknowns are orders."""
        return tuple(i for i, u in enumerate(self.unknowns) if u.kind == "order")

    @property
    def start(self) -> FloatArray:
        """Where the search starts, shape (n_unknowns,)."""
        return np.array([u.range.start for u in self.unknowns], float)

    @cached_property
    def space(self) -> Space:
        """The unknowns with their bounds, for an optimiser."""
        lower, upper = (np.array([getattr(u.range, side) for u in self.unknowns], float) for side in ("lower", "upper"))
        scale = np.array([math.nan if u.range.scale is None else u.range.scale for u in self.unknowns])
        return Space(self.names, lower, upper, self.start, scale=None if np.all(np.isnan(scale)) else scale)

    def absent(self, x: FloatArray) -> BoolArray:
        """Unknowns of elements that are not there at x and that no small step brings in, shape (n_unknowns,).

        Their cost jumps (:attr:`fracid.models.friction.Friction.jumps`), or they act only with one that is not there.
        """
        kinds, needs = self.model.friction, {p.name: p.needs for p in self.model.parameters}
        values = {p.name: [p.value] for p in self.model.parameters} | {n: [v] for n, v in self.parameter_starts.items()}
        of = [u.target if u.kind == "parameter" else "" for u in self.unknowns]
        values |= {n: [float(v) for v, target in zip(x, of, strict=True) if target == n] for n in of if n}
        absent = [n in kinds and kinds[n].jumps and v == kinds[n].off for n, v in zip(of, x, strict=True)]
        idle = [bool(needs.get(n)) and not any(any(values[other]) for other in needs[n]) for n in of]
        return np.array([a or b for a, b in zip(absent, idle, strict=True)], dtype=bool)

    @cached_property
    def priors(self) -> dict[int, Prior]:
        """Unknown → its prior, of those that have one."""
        return {i: u.range.prior for i, u in enumerate(self.unknowns) if u.range.prior is not None}

    # --- from x to a run ---------------------------------------------------------------------------

    @cached_property
    def pasts(self) -> dict[str, Past]:
        """Of the recordings that start in motion and have one, by name."""
        return {
            e.name: Past(e, self.model, [self.model.output_states[n] for n in self.outputs], self.rates, self.substeps)
            for e in self.experiments if e.past is not None
        }  # fmt: skip

    def unpack(self, x: FloatArray, e: Experiment) -> RunValues:
        """Orders per state, parameters, initial state and release of one recording."""
        vectors = [v.copy() for v in self._fixed[e.name]]
        for i, vector, where, base, sign in self._moves[e.name]:
            vectors[vector][where] = base + sign * x[i]
        orders, parameters, initial, release = vectors
        for state, nu in self.model.complements:
            orders[state] = 1.0 - parameters[nu]
        for name, value in e.constants.items():
            parameters[self.model.parameter_names.index(name)] = value
        if e.sensors and self.initial_state in ("measured", "held"):
            found = [i for i, n in enumerate(self.model.states) if isinstance(e.initial.get(n), Free)]
            taken = self._initial_guess(e, parameters)
            taken[found] = initial[found]
            initial = taken
        if e.past is not None and self.initial_state == "measured":
            rates = [j for j in self.rates.values() if self.model.states[j] not in e.initial]
            initial[rates] = self.pasts[e.name].states(orders, parameters)[-1, rates]
        for z, delta in self._deflected(e):
            slides = self._fixed[e.name][2][z] != 0.0
            initial[z] = self._balance(z, initial, parameters) if slides else initial[z] * parameters[delta]
        for name, other in self.model.follows.items():
            if name not in e.initial:
                initial[self.model.states.index(name)] = initial[self.model.states.index(other)]
        return RunValues(orders, parameters, initial, float(release[0]))

    def readings(self, parameters: FloatArray, sensors: Mapping[str, Sensor]) -> dict[str, Reading]:
        """What the channels of one recording do with the constants of its run, by name."""
        values = by_name(self.model.parameter_names, parameters)
        return {channel: sensor.reading(channel, values) for channel, sensor in sensors.items()}

    @cached_property
    def _moves(self) -> dict[str, list[tuple[int, int, list[int], float, float]]]:
        """For each recording the unknowns that its run takes, those that all share and its own.

        Which, in which of the vectors of :meth:`unpack`, which entries there, and a and b of these: a + b x.
        """
        model, moves = self.model, dict[str | None, list[tuple[int, int, list[int], float, float]]]()
        kinds: dict[str, Iterable[Any]] = {
            "order": model.orders, "parameter": model.parameter_names, "initial": model.states,
            "time": ("release_time",),
        }  # fmt: skip
        for i, u in enumerate(self.unknowns):
            entries = [k for k, n in enumerate(kinds[u.kind]) if self.ties.get(n, n) == u.target]
            own = moves.setdefault(u.experiment, [])
            own.append((i, [*kinds].index(u.kind), entries, 0.0, 1.0))
            if u.kind == "order":
                pots = [k for k, n in model.springpot_orders.items() if self.ties.get(n, n) == u.target]
                own += [(i, 0, pots, 1.0, -1.0)] if pots else []
        return {
            e.name: [m for of in dict.fromkeys((None, e.recording.name, e.name)) for m in moves.get(of, ())]
            for e in self.experiments
        }

    @cached_property
    def _fixed(self) -> dict[str, tuple[FloatArray, ...]]:
        """For each recording what :meth:`unpack` starts from: every value at its own start."""
        orders, parameters = self._model_starts
        return {
            e.name: (orders, parameters, self._initial_guess(e, parameters), np.array([starting_value(e.release_time)]))
            for e in self.experiments
        }

    # --- values and ties ---------------------------------------------------------------------------

    @cached_property
    def order_starts(self) -> dict[str, float]:
        """Every order where the search starts, fixed and tied ones too."""
        roots = {n: root_of("order", n, self.orders) for n in self.orders}
        return {n: starting_value(self.orders[root]) for n, root in roots.items() if root in self.orders}

    @cached_property
    def parameter_starts(self) -> dict[str, float]:
        """Each of `parameters` where the search starts, fixed and tied ones too [SI]."""
        values = {p.name: p.value for p in self.model.parameters} | {**self.parameters}
        roots = {n: root_of("parameter", n, self.parameters) for n in self.parameters}
        return {n: starting_value(values[root]) for n, root in roots.items()}

    @property
    def _model_starts(self) -> tuple[FloatArray, FloatArray]:
        """Orders per state and parameters where the search starts."""
        parameters = self.model.parameter_vector(self.parameter_starts)
        return self.model.state_orders(self.order_starts, parameters), parameters

    @cached_property
    def ties(self) -> dict[str, str]:
        """Each tied order and parameter with the one that it follows in the end, which is tied to none."""
        return {
            n: root_of(what, n, values)
            for what, values in (("order", self.orders), ("parameter", self.parameters))
            for n, v in values.items() if isinstance(v, Tied)
        }  # fmt: skip

    @cached_property
    def own_parameters(self) -> tuple[str, ...]:
        """The parameters that each recording has for itself: those of `per_recording`, and what is tied to them."""
        return (*self.per_recording, *(n for n, root in self.ties.items() if root in self.per_recording))

    @cached_property
    def aliases(self) -> dict[str, str]:
        """By what name a result calls a tied value, and the unknown that it is: ``{"mu": "lambda"}``."""
        return {
            n if u.experiment is None else f"{n} [{u.experiment}]": u.name
            for n, root in self.ties.items() for u in self.unknowns
            if u.target == root and u.kind == ("order" if n in self.orders else "parameter")
        }  # fmt: skip

    # --- the initial state -------------------------------------------------------------------------

    def _initial_unknowns(self, e: Experiment) -> Iterator[Unknown]:
        own = {n: v for n, v in e.initial.items() if isinstance(v, Free)}
        guess = self._initial_guess(e, self._model_starts[1]).tolist()
        reach, late = dict[int, tuple[float, str]](), e.blank[0]  # what is measured later on may have moved until then
        for k, (name, size) in enumerate(zip(self.outputs, self.sizes(e).tolist(), strict=True)):
            i, unit = self.model.output_states.get(name, -1), e.units.get(name, "rad")
            if i >= 0 and self.initial_state in ("estimate", "rest"):
                reach[i] = (3.0 if late[k] else 0.2) * size, unit
            if self.initial_state == "estimate" and i in self.rates:
                j, steps = self.rates[i], np.abs(np.diff(e.sampled.measured[:, k]))
                fastest = 0.0 if unit == "rad" else float(np.max(steps, initial=0.0)) / e.sampled.step
                reach[j] = max(3.0 * size + abs(guess[j]), fastest), f"{unit}/s"
        if self.initial_state == "estimate":
            for i, moved in self._integrated(e).items():
                unit = self.model.output_unit(self._derived[i][0])
                reach[i] = float(np.ptp(moved[0])), unit
                if i in self.model.rates:
                    reach[self.model.rates[i]] = float(np.ptp(moved[1])), f"{unit}/s"
            reach |= {z: (1.0, f"of {self.model.parameter_names[i]}") for z, i in self._deflections if guess[z] == 0.0}
        ranges = {
            i: (Free(guess[i], guess[i] - width, guess[i] + width), unit)
            for i, (width, unit) in reach.items() if self.model.states[i] not in e.initial
        }  # fmt: skip
        ranges |= {(i := self.model.states.index(n)): (v, reach.get(i, (0.0, ""))[1]) for n, v in own.items()}
        for i, (around, unit) in sorted(ranges.items(), key=lambda item: item[0]):
            state = self.model.states[i]
            part = state in self.model.relaxing and state not in own
            yield Unknown(f"{state}(0) [{e.name}]", unit, "initial", state, experiment=e.name, range=around,
                          complete=part)  # fmt: skip

    @cached_property
    def _deflections(self) -> tuple[tuple[int, int], ...]:
        """Of each presliding element its state, and the parameter that is its δ."""
        states, names = self.model.states, self.model.parameter_names
        return tuple((states.index(z), names.index(delta)) for z, delta in self.model.relaxing.items())

    def _deflected(self, e: Experiment) -> Iterator[tuple[int, int]]:
        """Those of which nothing says how they begin."""
        if self.initial_state == "estimate":
            yield from (pair for pair in self._deflections if self.model.states[pair[0]] not in e.initial)

    def _slides(self, e: Experiment, x0: FloatArray, delta: int) -> float:
        """±1, by its direction, where a joint goes further than its δ in the first few samples; else 0."""
        row = self.model.parameters[delta]
        kind = self.model.friction.get(row.name)
        rate = self.rates.get(self.model.output_states.get(kind.joint if kind else "", -1))
        reach = self.parameter_starts.get(row.name, row.value)
        v = 0.0 if rate is None else float(x0[rate])
        return math.copysign(1.0, v) if abs(v) * SOON * e.sampled.step > reach else 0.0

    def _balance(self, z: int, x0: FloatArray, parameters: FloatArray) -> float:
        """The deflection of a joint that slides as fast as at the start: of ż = v − rate·z, v over the rate."""
        x, out = x0.copy(), np.zeros(2 * len(x0))
        x[z] = 0.0
        compile_rhs(self.model.rhs)(0.0, x, np.zeros(max(1, len(self.model.inputs))), parameters, out)
        v, rate = out[z], out[len(x0) + z]
        return float(v / rate) if rate > 0.0 else 0.0

    def _initial_guess(self, e: Experiment, parameters: FloatArray) -> FloatArray:
        """The state at the start as measured: outputs, and the slopes for their rates, or what the past says."""
        x0 = np.zeros(len(self.model.states))
        readings = self.readings(parameters, e.sensors)
        for name, value, slope in zip(self.outputs, *e.first_values(), strict=True):
            if name not in self.model.output_states:
                continue
            i, sensor = self.model.output_states[name], readings.get(name, Reading())
            x0[i] = (value - sensor.bias) / sensor.gain
            if self.initial_state in ("estimate", "measured") and i in self.rates:
                x0[self.rates[i]] = slope / sensor.gain
        for i, (value, slope) in self._integrated(e).items():
            x0[i] = value[0]
            if i in self.model.rates:
                x0[self.model.rates[i]] = slope[0]
        if e.past is not None and e.begun is None:  # a window's slopes are fitted already
            x0 = self.pasts[e.name].states(*self._model_starts)[-1].copy()
        for name, value in e.initial.items():
            x0[self.model.states.index(name)] = starting_value(value)
        for z, delta in self._deflected(e):
            x0[z] = self._slides(e, x0, delta)
        return x0

    @cached_property
    def _derived(self) -> dict[int, tuple[str, str, int]]:
        """State of which derivatives alone are scored → the output that it is, the lowest of those, and its degree."""
        derived = [(of, n, k) for n, (of, k) in self.model.derived.items() if n in self.outputs]
        derived.sort(key=lambda one: -one[2])
        states = self.model.output_states
        return {states[of]: (of, n, k) for of, n, k in derived if of in states and of not in self.outputs}

    def _integrated(self, e: Experiment) -> dict[int, tuple[FloatArray, FloatArray]]:
        """Such a state and its rate, from the derivative as it was recorded: both swing about 0, shape (n_samples,)."""
        steps = np.diff(e.sampled.time, prepend=e.sampled.time[0])
        radii = {n: starting_value(s.radius) or 1.0 for n, s in e.sensors.items()}
        return {i: integrated(e.sampled.measured[:, self.outputs.index(n)] / radii.get(n, 1.0), steps, k)
                for i, (_, n, k) in self._derived.items()}  # fmt: skip

    @cached_property
    def rates(self) -> dict[int, int]:
        """For each scored output's state i the state j with D^q x_i = x_j, where that is no scored output itself."""
        indices = [self.model.output_states[name] for name in self.outputs if name in self.model.output_states]
        return {i: j for i, j in self.model.rates.items() if i in indices and j not in indices}

    @cached_property
    def told(self) -> set[str]:
        """The states that scored outputs tell: themselves, their rates, and those that follow others or relax."""
        model = self.model
        seen = {i for n in self.outputs if (i := model.output_states.get(n)) is not None} | {*self.rates.values()}
        return {*(model.states[i] for i in seen), *model.relaxing, *model.follows}

    def unstated(self, x: FloatArray, e: Experiment) -> list[int]:
        """Which states begin at 0 because no output shows them and nothing states how they begin."""
        free = (u.target for u in self.unknowns if u.kind == "initial" and u.experiment == e.name)
        known, start = {*self.told, *e.initial, *free}, self.unpack(x, e).initial
        return [i for i, n in enumerate(self.model.states) if start[i] == 0.0 and n not in known]

    def sizes(self, e: Experiment) -> FloatArray:
        """The greatest value of each output where that is no angle, five times a small one; else 1; shape (n_outputs,).

        Ranges and limits that are made for angles count in it: a pressure of 10⁵ Pa has not run away, and a probe that
        swings by a nanometre does not begin at 0.2 m.
        """
        greatest = np.max(np.abs(e.sampled.measured), axis=0, initial=0.0)
        angle = np.array([e.units.get(n, "rad") == "rad" for n in self.outputs]) & (greatest <= TURNS)
        return np.where(angle | (greatest == 0), 1.0, np.maximum(greatest, np.minimum(5 * greatest, 1.0)))
