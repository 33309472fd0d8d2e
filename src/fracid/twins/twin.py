"""Simulated recordings, *twins*: a model runs as a rig would, and encoders with noise read it.

::

    Twin.of_model      a model and what to let it do   ┐
    Twin.of_problem    a project's or a run's problem  ┴→  Twin  ──simulate──→  Trajectory  ──record──→  Recording
                                                                                             save_recording → a file

A twin is what every claim about an identification can be tried on, for its truth is known.  Until the release, `hold`
seconds from the start, the pendulum is held: the outputs stay at their initial values.  From there on the states are
those of :func:`fracid.simulate`, with the memory beginning at the release, ::

    x(t) = x(0)                    for t < hold,
    D^q x = f(t, x, u(t), p)       from then on.

What is recorded of an output y is :func:`fracid.twins.encoder.encoder`'s reading: noise of standard deviation σ, then
rounding to whole counts.  Inputs are recorded as they are.

=========  =================================================================================
ending     what :func:`save_recording` writes
=========  =================================================================================
``.csv``   the note as a comment, then ``time [s],theta [rad],...``, with all digits
``.mat``   MATLAB v5: column vectors ``time``, ``theta``, ..., and the note as ``note``
``.npz``   NumPy: the same as arrays
=========  =================================================================================
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any

import numpy as np

from fracid.arrays import ROUNDED, FloatArray, by_name
from fracid.cards import CardDisplay
from fracid.errors import InputError, at_least, refuse_unknown
from fracid.models import Model
from fracid.models.library import from_library, inputs_of, table_of
from fracid.problem import Experiment, Problem
from fracid.problem.experiment import held_inputs
from fracid.recording import Recording
from fracid.recording.channel import si_unit
from fracid.solver.arguments import check_above_0
from fracid.solver.inputs import Between, Driven, at_other_samples, between_samples
from fracid.solver.outputs import output_along
from fracid.solver.solve import simulate
from fracid.solver.trajectory import Trajectory
from fracid.twins.encoder import SAYS, encoder

MOST = 20_000_000
"""Samples of a recording at most: 160 MB a column."""


@dataclass(frozen=True, repr=False)
class Twin(CardDisplay):
    """What is simulated, all of it given by value."""

    name: str
    """What the recording is called."""
    model: Model
    orders: Mapping[str, float]
    """By name."""
    parameters: Mapping[str, float]
    """By name [SI]; the model's own are taken for those left out."""
    initial: Mapping[str, float]
    """States at the start by name [rad]; 0 where left out."""
    step: float
    """Between samples [s]."""
    end: float
    """Time of the last sample [s]."""
    start: float = 0.0
    """Time of the first sample, as the recording is to say it [s]."""
    hold: float = 0.0
    """When the motion begins, from the first sample [s]; below 0 it began before."""
    method: str = "pi2"
    """A key of :data:`fracid.solver.methods.METHODS`."""
    memory: Any = "compressed"
    """As :func:`fracid.simulate` takes it."""
    substeps: int = 1
    """Steps of the solver to a sample; so many more that the samples of inputs lie on them, where those are even."""
    inputs: Mapping[str, tuple[FloatArray, FloatArray]] | None = None
    """Input → its times, from the first sample [s], and its values; held beyond both ends."""
    between: Mapping[str, Between] = field(default_factory=dict)
    """Input → what it does between the samples (:mod:`fracid.solver.inputs`); ``line`` where it says nothing."""
    history: FloatArray | None = None
    """The states before the start, as :func:`fracid.simulate` takes them."""
    limit: float = 1e100
    """A state beyond this has run away, whatever its unit."""

    def __post_init__(self) -> None:
        """Refuse what is no recording; the model has the states that the values want."""
        values = dict(zip(self.model.parameter_names, self.model.parameter_vector(self.parameters), strict=True))
        model = self.model.equipped(name for name, value in values.items() if value != 0.0)
        gone = set(self.model.states) - set(model.states)
        object.__setattr__(self, "model", model)
        object.__setattr__(self, "initial", {n: v for n, v in self.initial.items() if n not in gone})
        check_above_0("step", self.step)
        check_above_0("end - hold", self.end - self.hold)
        if not 0 < self.end / self.step <= MOST:
            raise InputError(f"{self.end / self.step:.3g} samples are not possible; expected at most {MOST:,}.")
        at_least("substeps", self.substeps, 1, 1000)
        ratios = [self.step * (len(t) - 1) / np.ptp(t) for t, _ in (self.inputs or {}).values() if len(t) > 1]
        finer = math.lcm(*(max(1, Fraction(r).limit_denominator(100).numerator) for r in ratios))
        object.__setattr__(self, "substeps", min(1000, finer * math.ceil(self.substeps / finer)))

    @classmethod
    def of_model(cls, model: Model, *, name: str = "", **fields: Any) -> Twin:
        """Take a model with its own values; orders left out are 1, and voltages keep their value between samples.

        Parameters
        ----------
        model : Model
        name : str
        **given
            Fields of the twin: ``initial``, ``step`` and ``end`` at least.

        Raises
        ------
        InputError
            For a step, an end or substeps that cannot be.

        Examples
        --------
        >>> from fracid import rotary_pendulum
        >>> twin = Twin.of_model(rotary_pendulum(), initial={"alpha": 0.2}, step=0.01, end=3.0, hold=1.0)
        >>> recording = twin.record(twin.simulate(), noise={"alpha": 1e-4}, counts=4096, seed=1)
        >>> list(recording.signals), recording.time.size, recording.report.release
        (['theta', 'alpha'], 301, 1.0)
        """
        orders = dict.fromkeys(model.order_names, 1.0) | dict(fields.pop("orders", {}))
        held = held_inputs({n: model.input_unit(n) for n in model.inputs}, model)
        return cls(name or model.name, model, orders, **{"parameters": {}, "between": held, **fields})

    @classmethod
    def of_library(cls, name: str, zero: str | None = None) -> Twin:
        """Take a model of the library, with the inputs, values and orders that its own file has for a twin.

        Parameters
        ----------
        name : str
            Of one that is a file of equations.
        zero : str, optional
            As of :func:`fracid.model`.

        Examples
        --------
        >>> twin = Twin.of_library("cart-pole")
        >>> recording = twin.record(twin.simulate(), noise={"position": 1e-4}, seed=1)
        >>> {n: unit for n, unit in recording.units.items()}
        {'position': 'm', 'angle': 'rad', 'force': 'N'}
        """
        given = {"initial": {}, "substeps": 8, **table_of(name)["twin"]}  # finer than a fit, which would find itself
        time = given["step"] * np.arange(round(given["end"] / given["step"]) + 1)
        inputs = {n: (time, u) for n, u in inputs_of(name, time).items()}
        return cls.of_model(from_library(name, zero=zero), name=name, **{**given, "inputs": inputs or None})

    @classmethod
    def of_problem(cls, problem: Problem, x: FloatArray, experiment: Experiment) -> Twin:
        """Take what a problem simulates of one recording with the unknowns `x`: its rest, its inputs, its past.

        Parameters
        ----------
        problem : Problem
        x : ndarray, shape (n_unknowns,)
            Those of a fit, or ``problem.start``.
        experiment : Experiment
            One of the problem's.

        Examples
        --------
        >>> from fracid import rotary_pendulum
        >>> from fracid.problem import Free
        >>> model, swing = rotary_pendulum(), np.column_stack([np.zeros(200), 0.2 * np.cos(0.07 * np.arange(200))])
        >>> problem = Problem(model, (Experiment("swing", 0.01, swing, np.zeros((1, 1))),), {"lambda": 1.0, "mu": 1.0},
        ...                   {"b_alpha": Free(1e-4, 0.0, 1e-2)})
        >>> twin = Twin.of_problem(problem, problem.start, problem.experiments[0])
        >>> columns = list(model.outputs.values())
        >>> bool((twin.simulate().states[:, columns] == problem.fitted(problem.start, problem.experiments[0])).all())
        True
        """
        model: Model = problem.model
        if experiment.sensors or experiment.actuators:
            raise InputError(SAYS("sensor", experiment=experiment))
        orders, values, initial, release = problem.unpack(x, experiment)
        inputs: dict[str, tuple[FloatArray, FloatArray]] | None = None
        if len(u := experiment.all_inputs) > 1:  # from the first sample of the past on
            past = 0 if experiment.past is None else len(experiment.past)
            times: FloatArray = np.arange(-past, len(u) - past, dtype=np.float64) * experiment.step
            inputs = {n: (times, u[:, j]) for j, n in enumerate(model.inputs)}
        return cls(
            experiment.name, model, model.named_orders(orders), by_name(model.parameter_names, values),
            initial=by_name(model.states, initial), step=experiment.step, end=float(experiment.time[-1]),
            start=experiment.start, hold=release, method=problem.method, memory=problem.memory,
            substeps=problem.substeps, inputs=inputs, between=experiment.between,
            history=problem.simulator.history(x, experiment), limit=problem.simulator.limit,
        )  # fmt: skip

    def changed(self, **changes: Any) -> Twin:
        """The same with other orders, parameters or initial states by name, or other fields.

        Raises
        ------
        InputError
            For an order, parameter or state that the model does not have, or a field that cannot be so.

        Examples
        --------
        >>> from fracid import rotary_pendulum
        >>> twin = Twin.of_model(rotary_pendulum(), initial={"alpha": 0.2}, step=0.01, end=1.0)
        >>> dict(twin.changed(orders={"mu": 0.9}).orders)
        {'lambda': 1.0, 'mu': 0.9}
        """
        mappings = {name: getattr(self, name) for name in ("orders", "parameters", "initial") if name in changes}
        new = replace(self, **changes | {name: {**old, **changes[name]} for name, old in mappings.items()})
        new.model.state_orders(new.orders)
        new.model.state_vector({**new.initial, **changes.get("initial", {})})
        if new.history is not None and (new.step, new.orders) != (self.step, self.orders):
            raise InputError(SAYS("in-motion", name=self.name))
        return new

    @property
    def time(self) -> FloatArray:
        """Times of the samples, from 0 [s], shape (n_samples,)."""
        return np.asarray(self.step * np.arange(round(self.end / self.step) + 1, dtype=np.float64))

    def simulate(self) -> Trajectory:
        """Simulate all samples; its time is that of the recording, from 0.

        Returns
        -------
        Trajectory
            On the samples' grid; where the run fails (its ``outcome`` says how) up to there.

        Raises
        ------
        InputError
            As :func:`fracid.simulate`.
        """
        h = self.step / self.substeps
        count = (self.time[-1] - self.hold) / h
        steps = max(1, round(count)) if self._whole(h) else math.ceil(count) + 2  # both neighbours of the last sample
        run = simulate(
            self.model, orders=self.model.state_orders(self.orders), initial=self.model.state_vector(self.initial),
            parameters=self.parameters, step=h, start=self.hold, end=self.hold + steps * h, method=self.method,
            memory=self.memory, inputs=self._driven(steps, h), history=self.history, limit=self.limit,
        )  # fmt: skip
        slack = 1e-6 * self.step
        held, reached = self.time < self.hold - slack, self.time <= run.time[-1] + slack
        plateau, moving = self.time[held], self.time[reached & ~held]
        states = run.states[np.rint((moving - self.hold) / h).astype(int)] if self._whole(h) else run.at(moving)
        before = np.repeat(run.states[:1], plateau.size, axis=0)
        return replace(run, time=np.concatenate([plateau, moving]), states=np.vstack([before, states]), origin=0.0)

    def _whole(self, h: float) -> bool:
        """Whether the release is on the grid of steps."""
        return abs(self.hold / h - round(self.hold / h)) < 1e-6

    @property
    def _inputs(self) -> dict[str, tuple[FloatArray, FloatArray]]:
        """With the rates of those that are given, the slopes of the lines between their samples."""
        given = dict(self.inputs or {})
        for rate, of in self.model.input_rates.items():
            if of in given and rate not in given:
                times, values = given[of]
                slopes = np.diff(values) / np.diff(times)
                given[rate] = (times, np.append(slopes, slopes[-1:]))
        unsaid = {n: v for n, v in self.model.input_defaults.items() if given and n not in given}
        return given | {n: (np.zeros(1), np.full(1, v)) for n, v in unsaid.items()}

    def _between(self, name: str) -> Between:
        return self.between.get(name, "hold" if name in self.model.input_rates else "line")

    def _read(self, name: str, samples: FloatArray, step: float) -> FloatArray:
        """An input at samples a step apart, 0 where nothing gives it."""
        given = self._inputs.get(name, (np.zeros(1), np.zeros(1)))
        return at_other_samples(*given, self._between(name), samples, step)

    def _driven(self, steps: int, h: float) -> Driven | None:
        """u on the grid of the run, with a past from its beginning on."""
        if not self._inputs:
            return None
        past = 0 if self.history is None else len(self.history)
        times = np.concatenate([t for t, _ in self._inputs.values()]) / self.step
        spacing = self.step if np.all(abs(times - np.rint(times)) < ROUNDED) else h
        begin = (self.hold - h * past) / spacing
        first = math.floor(begin + 1e-9)
        samples = spacing * np.arange(first, round(self.end / spacing) + 1, dtype=np.float64)
        driven = [between_samples(self._read(name, samples, spacing), self._between(name), begin - first, h / spacing,
                                  count=past + steps + 1) for name in self.model.inputs]  # fmt: skip
        return Driven(*(np.column_stack(side) for side in zip(*driven, strict=True)))

    def record(
        self, run: Trajectory, *, noise: Mapping[str, float] | None = None, counts: int = 0, seed: int = 0,
        states: bool = False,
    ) -> Recording:  # fmt: skip
        """Read a run as encoders would.

        Parameters
        ----------
        run : Trajectory
            Of :meth:`simulate`.
        noise : mapping, optional
            Output → standard deviation of its noise [rad].
        counts : int
            A turn of the encoders; 0 for no rounding.
        seed : int
            Of the noise, and of where the edges of the counts lie.
        states : bool
            All states, as they are, behind the outputs.

        Raises
        ------
        InputError
            For an output that the model does not have, noise below 0, or counts that are no encoder's.
        """
        levels = {n: float((noise or {}).get(n, 0.0)) for n in self.model.outputs}
        refuse_unknown(f"output of {self.model.name}", levels, *(noise or {}))
        if not all(0 <= v < math.inf for v in levels.values()):
            raise InputError(f"noise = {dict(noise or {})} is not possible; expected standard deviations from 0 on.")
        if counts < 0 or 0 < counts < 3:
            raise InputError(f"counts = {counts} is not possible; expected counts a turn, e.g. 4096, or 0.")
        rng, resolution = np.random.default_rng(seed), 2 * math.pi / counts if counts else 0.0
        u = np.array([self._read(n, run.time, run.step) for n in self.model.inputs]).reshape(-1, len(run.time)).T
        p = self.model.parameter_vector(self.parameters)
        units, signals = dict[str, str](), dict[str, FloatArray]()
        for name, y in self.model.outputs.items():
            clean = run.states[:, y] if isinstance(y, int) else output_along(y, run.time, run.states, u, p=p)
            units[name] = si_unit(self.model.output_unit(name))
            turns = name in self.model.output_states and units[name] in ("rad", "1")  # an encoder counts it
            signals[name] = encoder(clean[:, None], levels[name], resolution if turns else 0.0, rng)[:, 0]
        for name in self.inputs or ():
            if name not in self.model.input_rates:
                signals[name], units[name] = self._read(name, run.time, self.step), si_unit(self.model.input_unit(name))
        shown = {i: units[n] for n, i in self.model.output_states.items()}
        for i, name in enumerate(self.model.states if states else ()):
            label = f"state {name}" if name in signals else name
            signals[label], units[label] = run.states[:, i], shown.get(i, "1")
        return Recording.of(self.name, self.start + run.time, signals, units)
