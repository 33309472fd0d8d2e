"""An Experiment: a recording as a problem uses it, from time 0, in columns.

Its samples lie on a uniform grid, on which the model is stepped too.  Where they crowd about what happens, as those of
a relaxation do, they stay where they are (`times`): the model is stepped by the smallest of their distances, but for
one in a thousand, and read at them, and the inputs lie on the grid: those that go straight from sample to sample at its
points, and those that are held by their means over its steps.  Where no input varies, longer steps may do.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np

from fracid.arrays import BoolArray, FloatArray, on_grid, real_array, within
from fracid.cards import CardDisplay
from fracid.errors import InputError, brief, refuse_unknown
from fracid.findings import Words
from fracid.models import Model
from fracid.problem.sensors import Sensor
from fracid.problem.unknowns import Free
from fracid.recording import Recording
from fracid.recording.channel import UNITS
from fracid.recording.report import BLANK
from fracid.safety.kinds import refuse_other_kinds
from fracid.signals.resolution import resolution
from fracid.signals.swing import common_period, motion_start
from fracid.solver.inputs import Between
from fracid.solver.trajectory import refuse_masked

SAYS = Words("problem/experiment.toml")

DEVIATION = "_sd"
"""Behind an output's name: the signal that is the standard deviation of its samples."""

LEAST_STEPS = 2000
"""Steps of a model from the first to the last of uneven samples: more than one from sample to sample where these are
few, for what relaxes between them must be followed too."""

AT_FIRST = 100_000
"""Steps, where no input varies, whose corners they must follow: a fit halves them as long as that changes anything."""

MOST_UNEVEN = 10**7
"""Steps of a model from the first to the last of uneven samples: what the compressed memory is certified for."""


@dataclass(frozen=True, repr=False)
class Experiment(CardDisplay):
    """A recording as a problem sees it: from time 0, outputs and inputs in columns."""

    name: str
    step: float
    """Step of the grid [s]."""
    measured: FloatArray
    """Outputs [rad], shape (n_samples, n_outputs)."""
    inputs: FloatArray
    """u on the grid, shape (n_grid, n_inputs), or one row for all; the grid is the samples', but of uneven ones."""
    start: float = 0.0
    """Time of the first sample on the recording's own clock [s]."""
    sha256: str = ""
    """Hash of the file."""
    initial: Mapping[str, float | Free] = field(default_factory=dict)
    """States whose initial value is known, such as a release angle [rad], or to be found within a range of one's own,
    such as the level of a tank that nothing measures: whatever `initial_state` says."""
    weight: float = 1.0
    """As how many samples each of its samples counts."""
    release_time: float | Free = 0.0
    """When the motion begins, from the first sample [s]; until then the initial state is held."""
    past: FloatArray | None = None
    """Outputs before the first sample, from rest on, up to one step before it [rad], shape (n_past, n_outputs)."""
    past_inputs: FloatArray | None = None
    """Inputs then, shape (n_past, n_inputs), or one row for all; None for no inputs."""
    constants: Mapping[str, float] = field(default_factory=dict)
    """Parameter → its value in this recording, whatever holds for all: a mass that was hung on, a gain that was set."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Output → its unit as recorded; the model's or rad where it says nothing.  For people: nothing is converted."""
    sensors: Mapping[str, Sensor] = field(default_factory=dict)
    """Output → its delay, gain, bias and low-pass, of those that have any."""
    actuators: Mapping[str, Sensor] = field(default_factory=dict)
    """Input → the same."""
    between: Mapping[str, Between] = field(default_factory=dict)
    """Input → what it does between its samples (:mod:`fracid.solver.inputs`); ``line`` where it says nothing."""
    mask: tuple[tuple[float, float], ...] = ()
    """From when to when samples are not scored, both included, on the recording's own clock [s]."""
    blanks: tuple[tuple[tuple[float, float], ...], ...] = ()
    """The same of each output alone: where it was not measured, and others were; empty for none."""
    times: FloatArray | None = None
    """Times of uneven samples, from 0 [s], shape (n_samples,); None where they lie on the grid."""
    deviation: FloatArray | None = None
    """Standard deviation of each sample, in its output's unit, shape (n_samples, n_outputs); None where all count
    alike.  Errors are then counted in it."""
    quanta: Mapping[str, float] = field(default_factory=dict)
    """Output → the step of its encoder, 0 for none, where its samples show none: they are read off lines."""
    source: Experiment | None = None
    """The recording at its own rate, where this is a coarser one of it (:mod:`fracid.problem.coarse`)."""
    means: int = 1
    """How many samples of the source each sample is the mean of."""
    whole: Experiment | None = None
    """The recording, where this is a window of it (:mod:`fracid.estimation.windows`)."""
    begun: tuple[FloatArray, FloatArray] | None = None
    """Outputs and their slopes at the start of a window, as the samples on both sides of it show them."""
    since: float = 0.0
    """When this part of a recording begins, from its first sample on [s]: costs that weigh by the time count it."""
    copied: bool = False
    """Whether its arrays are its own already, as those of a part are; else they are copied, so that what is written
    into the caller's later changes nothing."""

    def __post_init__(self) -> None:
        """Take arrays of numbers alone, of whatever package: a table of pandas, say; what is masked is none."""
        for name in ("measured", "inputs", "past", "past_inputs", "times", "deviation"):
            values = getattr(self, name)
            if values is not None:
                refuse_masked(what := f"{self.name}: {name}", values)
                object.__setattr__(self, name, real_array(values, SAYS("no-numbers", what=what), copy=not self.copied))
        object.__setattr__(self, "copied", True)
        refuse_other_kinds(self, f"{self.name}: ")
        if not 0.0 < self.step < math.inf:
            raise InputError(SAYS("step", name=self.name, step=brief(self.step)))
        object.__setattr__(self, "step", float(self.step))
        for name in ("sensors", "actuators"):  # a channel that does nothing is none
            object.__setattr__(self, name, {n: s for n, s in getattr(self, name).items() if s != Sensor()})
        if (at := self.times) is not None and (at.shape != self.measured.shape[:1] or not np.all(np.diff(at) > 0.0)):
            raise InputError(f"{self.name}: times do not increase from sample to sample; expected one [s] for each.")
        if (sd := self.deviation) is not None and (sd.shape != self.measured.shape or not np.all(sd > 0.0)):
            raise InputError(SAYS("deviations", name=self.name, shape=self.measured.shape, deviation=brief(sd)))

    @classmethod
    def of(
        cls, recording: Recording, model: Model, outputs: Sequence[str],
        initial: Mapping[str, float | Free] | None = None, *, before: Recording | None = None, **options: Any,
    ) -> Experiment:  # fmt: skip
        """Take the outputs and the model's inputs out of a recording; `initial` are states at its start:
        a number is known, a range is to find it in.

        The `options` are what else a recording has: its `weight`, its `release_time`, its `sensors` and `actuators`,
        `between`, where a voltage is held if nothing is said, and its `mask`, to which its bridged gaps are added.
        `before` is the recording of what came before, for a start in motion (:meth:`Recording.split` gives both).
        A signal that is called as an output with ``_sd`` behind it is the standard deviation of its samples.

        Raises
        ------
        InputError
            If an output is not among its signals, a signal has a unit that the model's has not, its samples are uneven
            and nobody said that they are meant so (:attr:`Recording.uneven`), a state is unknown, or a mask is outside
            of it.

        Examples
        --------
        >>> import fracid
        >>> twin = Recording.of("twin", np.arange(3.0), {"alpha": np.zeros(3)})
        >>> Experiment.of(twin, fracid.rotary_pendulum(), ["alpha"]).measured.shape
        (3, 1)
        """
        recording = recording.bridge_blanks([n for n in recording.signals if n not in model.inputs])
        if not outputs:
            raise InputError(f"outputs is empty: score at least one of {', '.join(model.outputs)}.")
        for name in outputs:
            if name not in recording.signals:
                raise InputError(SAYS("no-signal", of=recording, name=name, signals=", ".join(recording.signals)))
        sensors = options.get("sensors", {})
        refuse_other_dimensions(recording, model, [n for n, s in sensors.items() if s.gain != 1.0 or s.radius != 0.0])
        if recording.step is None and not recording.uneven:
            raise InputError(f"{recording.name} is not on a uniform grid; resample it first.")
        refuse_unknown(f"state in initial of {recording.name}", model.states, *(initial or {}))
        step = recording.step
        if before is not None:
            options["past"], options["past_inputs"] = _columns(before, model, outputs)
            if step is None:
                raise InputError(f"{recording.name}: a past needs a uniform grid; resample it first (resample = true).")
            if before.step is None or abs(recording.time[0] - before.time[-1] - step) > 1e-3 * step:
                raise InputError(SAYS("past-off-grid", recording=recording))
        measured, inputs = _columns(recording, model, outputs)
        options["between"] = held_inputs(recording.units, model) | dict(options.get("between", {}))
        unknown = chain.from_iterable(recording.blanks.get(n, ()) for n in model.inputs)
        options["mask"] = (*_mask(recording, options.get("mask", ())), *recording.bridged, *unknown)
        blanks = [recording.blanks.get(n, ()) + recording.blanks.get(f"{n}{DEVIATION}", ()) for n in outputs]
        options["blanks"] = tuple(blanks) if any(blanks) else ()
        options["deviation"] = _deviation(recording, outputs)
        if recording.report.resampled and options["deviation"] is None:
            options["quanta"] = {s.name: s.resolution or 0.0 for s in recording.report.signals}
        units = {**recording.units} | {n: model.output_unit(n) for n in recording.assumed}
        if step is None:
            step, inputs = _on_the_grid(recording, model, inputs, options)
        inputs = _with_rates(recording, model, step, inputs, options=options)
        found = cls(
            recording.name, step, measured, inputs, start=float(recording.time[0]), sha256=recording.sha256,
            initial=initial or {}, units={n: units.get(n, "rad") for n in outputs}, copied=True, **options,
        )  # fmt: skip
        if found.samples and (none := [n for n, k in zip(outputs, found.scored.T, strict=True) if not k.any()]):
            raise InputError(SAYS("no-sample", of=recording, name=none[0]))
        return found

    @cached_property
    def time(self) -> FloatArray:
        """From 0 [s], shape (n_samples,)."""
        if self.times is not None:
            return self.times
        return np.arange(len(self.measured), dtype=np.float64) * self.step

    @property
    def weighed_at(self) -> FloatArray:
        """The times by which a cost may weigh, from the recording's first sample on [s], shape (n_samples,)."""
        return self.since + self.time

    @property
    def steps(self) -> int:
        """Steps of the grid from the first sample to the last, or just beyond it."""
        return len(self.measured) - 1 if self.times is None else _steps_to(float(self.times[-1]), self.step)

    @property
    def sampled(self) -> Experiment:
        """The recording at its own rate."""
        return self if self.source is None else self.source

    @property
    def recording(self) -> Experiment:
        """The recording itself, of which this may be a window."""
        return self if self.whole is None else self.whole

    def quantum(self, name: str, samples: FloatArray) -> float:
        """The step of an output's encoder, as its samples show it where it is not known; 0 for none."""
        return self.quanta[name] if name in self.quanta else resolution(samples) or 0.0

    @property
    def most_moved(self) -> FloatArray:
        """The output that moves most, shape (n_samples,)."""
        return np.asarray(self.measured[:, int(np.argmax(np.ptp(self.measured, axis=0)))])

    @property
    def driven(self) -> bool:
        """Whether an input varies: one that is held, at whatever value, sets nothing in motion."""
        return bool(np.ptp(self.inputs, axis=0).max(initial=0.0) > 0.0)

    @cached_property
    def period(self) -> float:
        """Of the output that swings most often [samples]."""
        return common_period(self.measured)

    @property
    def swings(self) -> float:
        """Periods of the output that swings most often, in the whole record; 0 where none does a whole swing."""
        return (len(self.time) - 1) / self.period

    @cached_property
    def standstill(self) -> float:
        """Until when no output moves beyond its noise or a hundredth of its range [s]."""
        return min((self.time[max(0, motion_start(y) - 1)] for y in self.measured.T if np.ptp(y) > 0), default=0.0)

    @property
    def longest_delay(self) -> float:
        """By how much any of its channels may be late, or early [s]."""
        sensors = (*self.sensors.values(), *self.actuators.values())
        return max((max(s.latest, s.earliest) for s in sensors), default=0.0)

    @cached_property
    def scored(self) -> BoolArray:
        """Which samples count, shape (n_samples, n_outputs).

        Not those of the mask and of blanks, nor the first, up to the longest delay: they show what came before the
        start.
        """
        late = max((s.latest for s in self.sensors.values()), default=0.0)
        slack, clock = 1e-6 * self.step, self.start + self.time
        counts = (self.time >= late - slack) & ~within(clock, self.mask, slack)
        return counts[:, None] & ~self.blank

    @property
    def blank(self) -> BoolArray:
        """Where an output was not measured, and others were, shape (n_samples, n_outputs)."""
        clock, spans = self.start + self.time, self.blanks or [()] * self.measured.shape[1]
        return np.column_stack([within(clock, own, 1e-6 * self.step) for own in spans])

    @cached_property
    def partly(self) -> BoolArray | None:
        """The same; None where all count, so that nothing is spent on them."""
        return None if np.all(self.scored) else self.scored

    @property
    def samples(self) -> float:
        """How many samples of an output count, of all on average."""
        return float(np.count_nonzero(self.scored) / self.measured.shape[1])

    @property
    def sparse(self) -> bool:
        """Whether an output is blank in more of the rows than those that are bridged: it is measured now and then."""
        return bool(np.any(np.mean(self.blank, axis=0) > BLANK))

    def until(self, horizon: float) -> Experiment:
        """Keep the first `horizon` seconds, those that are not scored beside them; more until each output has one."""
        n = round(horizon / self.step) + 1 if self.times is None else int(np.count_nonzero(self.times <= horizon))
        counted = np.cumsum(np.any(self.scored, axis=1))
        last = np.searchsorted(counted, min(max(3, n), counted[-1]))
        return self.part(0, 1 + max(int(last), *np.argmax(self.scored, axis=0).tolist()))

    def part(self, first: int, end: int) -> Experiment:
        """Some of its samples, with those of the source that they are means of, and the inputs on a grid that begins
        with the first of them."""
        times, deviation = (None if a is None else a[first:end] for a in (self.times, self.deviation))
        inputs = self.inputs if len(self.inputs) == 1 else self.inputs[first:end]
        if times is not None:
            begin, times = float(times[0]), times - times[0]
            grid = begin + self.step * np.arange(_steps_to(float(times[-1]), self.step) + 1)
            whole = self.step * np.arange(len(self.inputs))  # shifted means of a held input lie on lines too
            inputs = self.inputs if len(whole) == 1 else np.column_stack(
                [np.interp(grid, whole, u) for u in self.inputs.T])  # fmt: skip
        means = slice(first * self.means, (end - 1) * self.means + self.means // 2 + 1)
        source = self.source and self.source.part(means.start, means.stop)
        return replace(
            self, measured=self.measured[first:end], inputs=inputs, times=times, deviation=deviation, source=source,
            start=self.start + float(self.time[first]), since=float(self.weighed_at[first]),
        )  # fmt: skip

    def in_deviations(self, error: FloatArray) -> FloatArray:
        """Errors in standard deviations where these are known, shape (n_samples, n_outputs)."""
        return error if self.deviation is None else error / self.deviation

    @property
    def all_inputs(self) -> FloatArray:
        """The inputs from the first sample of the past on, or one row for all."""
        before = np.zeros((1, self.inputs.shape[1])) if self.past_inputs is None else self.past_inputs
        if self.past is None or (len(before) == len(self.inputs) == 1 and np.array_equal(before, self.inputs)):
            return self.inputs
        parts = ((before, len(self.past)), (self.inputs, len(self.measured)))
        return np.vstack([u if len(u) > 1 else np.repeat(u, n, axis=0) for u, n in parts])

    def first_values(self) -> tuple[FloatArray, FloatArray]:
        """Outputs and their slopes at the start [rad, rad/s], from a parabola through the first samples."""
        return self.begun or self.sampled._first_values

    @cached_property
    def _first_values(self) -> tuple[FloatArray, FloatArray]:
        t = self.time[: first_samples(self.step)]
        parabola = np.polynomial.polynomial.polyfit(t, self.measured[: len(t)], min(2, len(t) - 1))
        return self.measured[0].astype(np.float64), parabola[1]

    @property
    def slope_weights(self) -> FloatArray:
        """v of the slopes at the start: each is v'y of its output's first samples [1/s], shape (n_first,)."""
        t = self.time[: first_samples(self.step)]
        powers = np.polynomial.polynomial.polyvander(t / t[-1], min(2, len(t) - 1))
        return np.asarray(np.linalg.pinv(powers)[1] / t[-1])


def first_samples(step: float) -> int:
    """How many samples the slope at the start is taken from.

    Examples
    --------
    >>> first_samples(0.01), first_samples(0.002)
    (5, 20)
    """
    return max(5, round(0.04 / step))


def refuse_other_dimensions(recording: Recording, model: Model, scaled: Collection[str]) -> None:
    """An angle is in radians, or a pure number; an input in the model's unit, in none, or nobody says in which.

    What a sensor scales, such as a potentiometer, is in its unit.
    """
    for name, unit in {**model.input_units, **model.output_units}.items():
        if (si := UNITS.get(unit, (1.0, unit))) != (1.0, unit):
            raise InputError(SAYS("not-si", name=name, unit=unit, si=si[1]))
    possible: dict[str, tuple[str, ...]] = {n: ("rad", "1") for n in model.angles}
    possible |= {n: (model.output_unit(n), "1") for n in model.derived}
    possible |= {n: ("m", "1", "rad") for n in model.outputs if model.output_unit(n) == "m"}
    measured = {n: u for n, u in model.output_units.items() if u in UNITS and u != "1" and n not in possible}
    possible |= {n: (u, "1") for n, u in {**measured, **model.input_units}.items() if n not in recording.assumed}
    for name, units in possible.items():
        unit = recording.units.get(name, units[0])
        if unit in units or name in scaled:
            continue
        what = "an angle" if name in model.angles else f"a quantity in {units[0]}"
        right = " ".join(repr(u) for u, (_, si) in UNITS.items() if si == units[0])
        rate = {f"{units[0]}/s": "_rate", f"{units[0]}/s^2": "_acceleration"}.get(unit)
        hint = f" Its derivative has a name of its own: type {name}{rate} = {{ ... }}." if rate else ""
        if unit in ("V", "A") and name in model.outputs:
            hint = f" Of a potentiometer type gain = ..., its {unit} in a {units[0]}, or the range of it, and bias."
        if (unit, units[0]) == ("m/s^2", "rad/s^2"):
            hint = " Of an accelerometer type radius = ..., how far it is from the axis [m], or the range of it."
        raise InputError(SAYS("other-unit", recording=recording, name=name, what=what, unit=unit, right=right,
                              hint=hint or ' Is it another column?'))  # fmt: skip


def held_inputs(units: Mapping[str, str], model: Model) -> dict[str, Between]:
    """The inputs of which one takes it that they keep their value between samples: voltages, which converters make."""
    return {n: "hold" for n in model.inputs if units.get(n) == "V"}


def _mask(recording: Recording, mask: Sequence[Sequence[float]]) -> Iterator[tuple[float, float]]:
    """Check that each part of a mask has samples of the recording."""
    begin, end = float(recording.time[0]), float(recording.time[-1])
    for part in mask:
        first, last = part if len(part) == 2 else (math.nan, math.nan)
        if not first < last:
            raise InputError(SAYS("mask-pairs", recording=recording, mask=[list(p) for p in mask],
                                  first=begin + (end - begin) / 4, last=begin + (end - begin) / 3))  # fmt: skip
        if not np.any((recording.time >= first) & (recording.time <= last)):
            raise InputError(SAYS("empty-mask", recording=recording, first=first, last=last, begin=begin, end=end))
        yield float(first), float(last)


def _columns(recording: Recording, model: Model, outputs: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Outputs and inputs side by side; one row of inputs where none was recorded."""
    measured = np.column_stack([recording.signals[name] for name in outputs])
    if not any(name in recording.signals for name in model.inputs):
        return measured, np.zeros((1, len(model.inputs)))
    unsaid = model.input_defaults
    columns = [recording.signals.get(n, np.full(len(measured), unsaid.get(n, 0.0))) for n in model.inputs]
    return measured, np.column_stack(columns)


def _deviation(recording: Recording, outputs: Sequence[str]) -> FloatArray | None:
    """The standard deviations of the samples; of all outputs or of none."""
    names = [f"{n}{DEVIATION}" for n in outputs]
    missing = [n for n, sd in zip(outputs, names, strict=True) if sd not in recording.signals]
    if len(missing) == len(names):
        return None
    if missing:
        raise InputError(f"{recording.name}: sd is given of some outputs, and not of {missing[0]!r}; give it of each.")
    deviation = np.column_stack([recording.signals[n] for n in names])
    if not np.all(deviation > 0):
        k = int(np.argmin(np.min(deviation, axis=1)))
        raise InputError(SAYS("deviation", recording=recording, deviation=deviation[k].min(), time=recording.time[k]))
    return deviation


OF_AN_INPUT, CROWDS = 8, 4.0
"""Steps of the grid from sample to sample of an input that goes in lines: its corners lie between the grid's points.
Not where most samples lie so many steps apart: they crowd elsewhere."""

ODD = 1e-3
"""Share of uneven samples that may lie nearer to the next than a step: a stamp that is off does not set it."""


def _steps_to(end: float, step: float) -> int:
    return math.ceil(end / step * (1 - 1e-9))


def _on_the_grid(
    recording: Recording, model: Model, inputs: FloatArray, options: dict[str, Any]
) -> tuple[float, FloatArray]:
    """The step with which a model goes through uneven samples, and the inputs on its grid; `options` get the times."""
    times = options["times"] = recording.time - recording.time[0]
    step = float(np.quantile(np.diff(times), ODD, method="lower"))
    jitters = np.median(np.diff(times)) < CROWDS * step
    held = np.isin(model.inputs, [*recording.held, *(n for n, rule in options["between"].items() if rule == "hold")])
    drives = len(inputs) > 1 and np.mean(np.any(np.diff(inputs[:, ~held], axis=0) != 0.0, axis=1)) > 0.5
    least, varies = OF_AN_INPUT if drives and jitters else 1, np.ptp(inputs, axis=0) > 0.0
    step *= 1 if np.any(varies) else max(1, _steps_to(float(times[-1]), step) // AT_FIRST)
    many = LEAST_STEPS * (OF_AN_INPUT if np.any(varies[held]) else 1)
    step /= max(math.ceil(many / _steps_to(float(times[-1]), step)), least)
    count = _steps_to(float(times[-1]), step) + 1
    if count > MOST_UNEVEN:
        raise InputError(SAYS("uneven-step", recording=recording, step=step, length=times[-1], count=count,
                              MOST_UNEVEN=MOST_UNEVEN))  # fmt: skip
    if len(inputs) == 1:
        return step, inputs
    grid = np.arange(count, dtype=np.float64) * step
    columns = [on_grid(times, u, grid, step, held=bool(h)) for h, u in zip(held, inputs.T, strict=True)]
    return step, np.column_stack(columns)


def _with_rates(
    recording: Recording, model: Model, step: float, inputs: FloatArray, options: dict[str, Any]
) -> FloatArray:
    """The inputs with the rates of those that were recorded: the slopes of the lines between their samples."""
    rates = {n: of for n, of in model.input_rates.items() if n not in recording.signals and of in recording.signals}
    if not rates or len(inputs) == 1:
        return inputs
    inputs = inputs.copy()
    for name, of in rates.items():
        if options["between"].get(of, "line") != "line" or of in options.get("actuators", {}):
            raise InputError(SAYS("rate-not-line", recording=recording, of=of, name=name))
        slopes = np.diff(inputs[:, model.inputs.index(of)]) / step
        inputs[:, model.inputs.index(name)] = np.append(slopes, slopes[-1:])
        options["between"] = {**options["between"], name: "hold"}
    return inputs
