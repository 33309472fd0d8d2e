"""A Plan: the experiments to do next, their expected intervals, and the sheet to take to the laboratory.

======================  =========================================================================================
file                    holds
======================  =========================================================================================
``sheet.txt``           the experiments one after the other, and the expected intervals
``next.toml``           a project for the recordings so far and to come, at the values of now
``next-clamped.toml``   the same of those with the arm clamped
``voltage-N.csv``       the input of experiment N, by its name, to be played
``expected-N.csv``      what experiment N should show, with its 95 % band
``plan.json``           the plan for programs
``figures/``            the expected curves, and the interval against angle of release and duration
======================  =========================================================================================
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field, PlainSerializer

from fracid.arrays import FloatArray
from fracid.cards import Card, CardDisplay, estimate_text, listed, rounded
from fracid.errors import Failure, InputError
from fracid.estimation.derivatives import jacobian
from fracid.estimation.records import in_words
from fracid.experiments.space import Candidate
from fracid.experiments.subject import SAYS, VAGUE, Subject, driven
from fracid.figures import Figure, Style, draw
from fracid.fit import Fit
from fracid.models.rigs import CLAMPED
from fracid.problem.toml_text import plain_value, reached, toml_document
from fracid.problem.unknowns import Value as Given
from fracid.quantiles import NORMAL_95, normal_interval
from fracid.recording import Recording
from fracid.recording.channel import si_unit
from fracid.recording.writing import save_recording
from fracid.safety.door import write_files
from fracid.safety.json_files import json_document, json_number
from fracid.safety.schema import UNREAD, Beside, Infinite, Listed, Number, Record, computed
from fracid.units import half_of, letter

SIGNALS = ("time", "variable", "resample")
"""Keys of a recording's table that the next one has too, beside its signals."""

TIMES = 1.5
"""From here on an interval is so many times narrower, and below by so many per cent."""

MOST_ROWS = 3
"""Of experiments on a card's text."""


@dataclass(frozen=True)
class Value(Record):
    """A free value, with what is known of it now and what is to be expected.

    Examples
    --------
    >>> [round(end, 4) for end in Value(0.9, "", 0.01, None).interval95]
    [0.8804, 0.9196]
    """

    value: float
    unit: str
    standard_error: Number
    """To be expected after the plan; None where the plan does not show it."""
    standard_error_now: Number
    """Of what has been recorded, predicted in the same way; None where that does not show it."""
    widest: Infinite = math.inf
    """Half-width of an interval that is just narrow enough to use."""

    @computed
    def interval95(self) -> tuple[float, float] | None:
        """To be expected after the plan."""
        return normal_interval(self.value, self.standard_error)

    @computed
    def identifiable(self) -> str:
        """The verdict on that interval, as of a fit."""
        if self.interval95 is None:
            return "not shown by this plan"
        return "practically not" if half_of(self.interval95) > self.widest else "identifiable"

    @property
    def doubt(self) -> str:
        """What stands behind a value that is not identifiable."""
        return "" if self.identifiable == "identifiable" else f" ({in_words(self.identifiable)})"


if TYPE_CHECKING:
    Experiments = tuple[Candidate, ...]
else:
    _written = PlainSerializer(lambda them: [c if isinstance(c, dict) else c.to_json() for c in them])
    Experiments = Annotated[list[dict[str, Any]], _written]


@dataclass(frozen=True, repr=False, kw_only=True)
class Plan(CardDisplay, Record):
    """What :func:`fracid.design` gives."""

    name: Annotated[str, Field(alias="for")]
    criterion: str
    """``D``, ``A``, ``Ds`` or ``T`` (:mod:`fracid.experiments.criteria`)."""
    of: Listed[str]
    """The values to narrow; empty for all."""
    experiments: Experiments
    """Repetitions stand there as often as they are to be done."""
    expected: Mapping[str, Value]
    """Name of each free value → what is to be expected."""
    candidates: int
    """Candidates that are possible."""
    excluded: int
    """Candidates that exceed a limit, or whose simulation fails."""
    distances: Mapping[str, float] | None = None
    """Integer-order alternative → its distance in standard deviations, of a plan against them."""
    alone: Mapping[str, float] | None = None
    """Order → the distance of the nearest of them from a rig on which it alone is off."""
    subject: Beside[Subject] = UNREAD
    landscape: Beside[tuple[tuple[Candidate, Mapping[str, float]], ...]] = UNREAD
    """Each candidate with the standard errors that it alone would leave."""
    covariance: Beside[FloatArray] = UNREAD
    """Covariance of the free values after the plan, shape (n, n)."""

    @computed
    def gain(self) -> dict[str, float | None]:
        """By what factor each interval becomes narrower than the recordings so far predict; None where none is now."""
        return {n: json_number(factor) for n, factor in self.gain_over().items()}

    def gain_over(self, run: Fit | None = None) -> dict[str, float]:
        """By what factor the interval of each value becomes narrower.

        Parameters
        ----------
        run : Fit or SavedRun, optional
            Compares with its intervals; without, with those that the recordings so far predict.

        Returns
        -------
        dict
            Infinite where there is no interval now; values that the plan does not show are left out.

        Raises
        ------
        InputError
            If the run shares no free value with the plan.
        """
        now = {n: v.standard_error_now for n, v in self.expected.items()}
        if run is not None:
            now = {n: None if e.interval95 is None else (e.interval95[1] - e.interval95[0]) / 2 / NORMAL_95
                   for n, e in {**run.orders, **run.parameters}.items() if n in self.expected}  # fmt: skip
            if not now:
                raise InputError(f"The run and the plan share no free value; the plan has {', '.join(self.expected)}.")
        return {n: math.inf if (before := now[n]) is None else before / v.standard_error
                for n, v in self.expected.items() if n in now and v.standard_error is not None}  # fmt: skip

    def plot(self, *, style: str | Style = "screen") -> Figure:
        """Draw the expected interval against angle of release and duration."""
        return draw("design_landscape", self, style=style)

    def write(self, folder: str | Path) -> tuple[Path, ...]:
        """Write the sheet for the laboratory: project files, voltages, expected curves, the figure, plan.json.

        Parameters
        ----------
        folder : str or Path
            Made if it is not there.

        Returns
        -------
        tuple of Path

        Raises
        ------
        InputError
            If the folder cannot be written.
        """
        from fracid.plots import save  # matplotlib is slow to load

        folder, problem, curves = Path(folder), self.subject.problem, expected_curves(self)
        model = problem.model
        texts = {"sheet.txt": _sheet(self), "plan.json": json_document(self.to_json())}
        for arm, name in (("free", "next.toml"), ("clamped", "next-clamped.toml")):
            own = {k: c for k, c in enumerate(self.experiments, 1) if c.arm == arm}
            texts |= {name: _project(self.subject, own, folder)} if own else {}
        signals = {}  # before anything is written: a sheet without them is of no use
        for curve in curves:
            number, note = self.experiments.index(curve.candidate) + 1, str(curve.candidate)
            if curve.voltage is not None:
                name = driven(problem)
                unit = si_unit(model.input_unit(name))
                played = Recording.of("voltage", curve.time, {name: curve.voltage}, {name: unit})
                signals[f"{name}-{number}.csv"] = played, note
            ends = {"": 0, " low": -1, " high": 1}
            parts = [(o, f"{o}{end}", side) for o in curve.outputs for end, side in ends.items()]
            bands = {part: curve.outputs[o] + side * curve.half[o] for o, part, side in parts}
            units = {part: si_unit(self.subject.unit(o)) for o, part, _ in parts}
            signals[f"expected-{number}.csv"] = Recording.of("expected", curve.time, bands, units), f"{note}, 95 % band"
        files = [*write_files(folder, texts)]
        files += [save_recording(signal, folder / name, note=note) for name, (signal, note) in signals.items()]
        files += save(draw("expected_curves", curves, model), folder / "figures", "expected")
        if len({(c.release, c.seconds) for c, _ in self.landscape}) > 1:  # one point shows nothing
            files += save(self.plot(), folder / "figures", "intervals")
        return tuple(files)

    def summary(self) -> str:
        """The card, and the expected intervals of all free values, in lines."""
        lines = [repr(self), "", "Values with their expected 95 % intervals"]
        for n, v in self.expected.items():
            half = None if v.standard_error is None else NORMAL_95 * v.standard_error
            lines.append(f"  {n:<20} {rounded(v.value, half)} {v.unit}".rstrip() + v.doubt)
        return "\n".join(lines)

    def _card(self) -> Card:
        named = self.of or tuple(self.expected)
        rows = [(f"{count} ×", str(c)) for c, count in Counter(self.experiments).items()]
        shown = rows if len(rows) <= MOST_ROWS else [*rows[: MOST_ROWS - 1], ("…", "more experiments")]
        texts = {n: estimate_text(n, v.value, v.interval95, v.unit) + v.doubt for n, v in self.expected.items()}
        excluded = f", {self.excluded} more excluded" if self.excluded else ""
        tail = [("expected", listed(texts[n] for n in named)), *self._comparisons(named),
                ("candidates", f"{self.candidates}{excluded}; criterion {self.criterion}")]  # fmt: skip
        details = [*(rows[MOST_ROWS - 1 :] if len(rows) > MOST_ROWS else []),
                   *((n, text) for n, text in texts.items() if n not in named)]  # fmt: skip
        count = len(self.experiments)
        return Card(f"Plan of {count} experiment{'s' * (count > 1)} for {self.name}", (*shown, *tail), tuple(details))

    def _comparisons(self, named: tuple[str, ...]) -> Iterator[tuple[str, str]]:
        """With what is known now, and with the integer-order alternatives."""
        gains = self.gain_over()
        if any(math.isfinite(g) for g in gains.values()):
            now = {n: v.standard_error_now for n, v in self.expected.items()}
            yield "than now", listed(f"{letter(n)} {narrower(gains[n], now[n])}" for n in named if n in gains)
        if self.distances:
            nearest = min(self.distances, key=self.distances.__getitem__)
            away = f"stays {self.distances[nearest]:.3g} standard deviations away"
            alone = [f"{letter(n)} {d:.3g}" for n, d in (self.alone or {}).items()]
            off = f"; where one order alone is fractional, {listed(alone)}" if len(alone) > 1 else ""
            yield "alternative", f"the nearest, with {nearest}, {away}{off}"


def narrower(factor: float, standard_error: float | None) -> str:
    """By how much an interval becomes narrower, or wider, than that of now, whose standard error is given.

    Examples
    --------
    >>> for factor in (7.31, 1.2, 0.9):
    ...     print(narrower(factor, 0.0062))
    7.3 times narrower than ± 0.012
    17 % narrower than ± 0.012
    11 % wider than ± 0.012
    """
    if standard_error is None:
        return "had no interval"
    change = 100 * (1 / factor - 1)
    by = f"{factor:.2g} times" if factor >= TIMES else f"{abs(change):.2g} %"
    return f"{by} {'wider' if change > 0 else 'narrower'} than ± {NORMAL_95 * standard_error:.2g}"


# --- the sheet ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Expected:
    """What one experiment should show."""

    candidate: Candidate
    time: FloatArray
    """Shape (n_samples,) [s]."""
    outputs: Mapping[str, FloatArray]
    """Simulated, shape (n_samples,) each."""
    half: Mapping[str, FloatArray]
    """Half of the 95 % band from the values' uncertainty now, or after the plan where nothing is recorded."""
    voltage: FloatArray | None
    """Shape (n_samples,)."""


def expected_curves(plan: Plan) -> tuple[Expected, ...]:
    """What each experiment of a plan should show, repetitions once.

    Examples
    --------
    >>> import fracid
    >>> space = fracid.DesignSpace(release=45, seconds=2, rate=100)
    >>> plan = fracid.design(fracid.rotary_pendulum("qube-servo2"), space, experiments=1, free=("mu", "b_alpha"))
    >>> (curve,) = expected_curves(plan)
    >>> round(float(np.degrees(curve.outputs["alpha"][0]))), curve.half["alpha"].shape
    (45, (201,))
    """
    subject, curves = plan.subject, []
    covariance = subject.known(VAGUE).covariance(subject.scale) if subject.intervals else plan.covariance
    for c in dict.fromkeys(plan.experiments):
        problem = subject.problem_of(c)
        outputs = problem.fitted(problem.start, problem.experiments[0])
        at = [i for i, u in enumerate(problem.unknowns) if u.experiment is None]
        J = jacobian(problem, problem.start, np.array(at))
        if isinstance(outputs, Failure) or isinstance(J, Failure):
            continue
        rows = [subject.names.index(problem.names[i]) for i in at]
        part = covariance[np.ix_(rows, rows)]
        variance = np.einsum("toi,ij,toj->to", J[0], part, J[0])
        half = NORMAL_95 * np.sqrt(np.maximum(variance, 0.0))
        u = None if c.voltage is None else subject.space.applied(c.voltage, np.arange(c.samples) / c.rate)
        middle, halves = (dict(zip(problem.outputs, y.T, strict=True)) for y in (outputs, half))
        curves.append(Expected(c, problem.experiments[0].time, middle, halves, voltage=u))
    return tuple(curves)


def _sheet(plan: Plan) -> str:
    lines = [plan.summary(), "", "Experiments"]
    for k, c in enumerate(plan.experiments, 1):
        first = plan.experiments.index(c) + 1
        play = "" if c.voltage is None else f"play {driven(plan.subject.problem)}-{first}.csv; "
        lines += [f"  {k}. {c}", f"     {play}save it as recording-{k}.csv; compare with expected-{first}.csv"]
    if len({c.arm for c in plan.experiments}) > 1:
        lines += ["", SAYS("clamped-first")]
    lines += ["", "Then: fracid check recording-1.csv, and fracid fit next.toml."]
    lines += [SAYS("so-far-in-it" if plan.subject.table else "so-far-beside-it")] * bool(plan.subject.intervals)
    return "\n".join(lines) + "\n"


# --- the project file --------------------------------------------------------------------------------------


def _project(subject: Subject, experiments: Mapping[int, Candidate], folder: Path) -> str:
    """A project for recordings that are not there yet, beside those so far, which no clamped arm has made."""
    p, table = subject.problem, subject.table.get("model", {})
    clamped = any(c.arm == "clamped" for c in experiments.values())
    recordings = [] if clamped else [r | {"file": reached(r["file"], subject.table["home"], folder)}
                                     for r in subject.table.get("recording", ())]  # fmt: skip
    begin = {subject.space.initial_state, *[p.initial_state] * bool(recordings)}  # what says least says it for all
    state = begin.pop() if len(begin) == 1 else "rest" if begin == {"rest", "held"} else "estimate"
    own = {k: v for k, v in table.items() if k not in ("parameters", "orders")}
    actuation = {"actuation": p.model.inputs[0]} if p.model.name == "rotary-pendulum" and p.model.inputs else {}
    head = own or {"name": p.model.name, **({"zero": p.model.zero} if p.model.zero else {}), **actuation}
    values: dict[str, Given] = {} if own.get("rig") else {q.name: q.value for q in p.model.parameters}
    values |= p.parameters
    if clamped:
        values["J_theta"] = CLAMPED
    fit = {"outputs": [*subject.outputs], "initial_state": state, "weights": p.weights, "method": p.method}
    if p.per_recording:
        fit["per_recording"] = list(p.per_recording)
    said = [f"# Planned by fracid design for {subject.name}: put the recordings where file = ... says, then fit."]
    said += ["# The model is a file of yours: copy it beside this one."] * (".py:" in str(head.get("name")))
    said += [f"# recording-{k}.csv: {c}" for k, c in experiments.items()]
    given = {"parameters": values, "orders": p.orders}
    plain = {name: {n: plain_value(v, own=table.get(name, {}).get(n)) for n, v in some.items()}
             for name, some in given.items()}  # fmt: skip
    recordings += [_recording(subject, k, c, state) for k, c in experiments.items()]
    return "\n".join([*said, toml_document({"model": {**head, **plain}, "recording": recordings, "fit": fit})])


def _recording(subject: Subject, number: int, c: Candidate, state: str) -> dict[str, Any]:
    """The table of one experiment, with what the recordings so far say of its signals; it starts without rates."""
    p, outputs, so_far = subject.problem, subject.outputs, subject.table.get("recording", [])
    known = so_far[0] if so_far else {}
    still = () if subject.space.initial_state == state else p.model.rates.values()
    initial = dict.fromkeys((p.model.states[i] for i in still), 0.0) | subject.initial(c)
    entries: dict[str, Any] = {
        "name": f"{len(so_far) + number}: {f'{c.release:g}°' if c.release else c.voltage}",
        "file": f"recording-{number}.csv", "initial": {n: plain_value(v) for n, v in initial.items()},
        "parameters": {**p.experiments[0].constants, **dict(c.constants)},
    }  # fmt: skip
    signals = {n: known[n] for n in (*SIGNALS, *outputs) if n in known}
    missing = {n: {"column": n, "unit": si_unit(subject.unit(n))} for n in outputs if n not in signals}
    entries |= {**({} if "time" in signals else {"time": {"column": 0}}), **signals, **missing}
    if c.voltage is not None:
        name = driven(p)
        column = known.get(name, {"column": name, "unit": p.model.input_unit(name)})
        between = "line" if name in p.model.input_rates.values() else "hold"
        column = column if isinstance(column, Mapping) else {"column": column}
        entries |= {name: {**column, "between": between}, "amplifier": known.get("amplifier", {})}
    else:
        moment = subject.space.moment
        sought = {"start": 0.0, "lower": -moment, "upper": moment} if moment else {}
        entries |= {"from": "release", "release_time": sought}
    return {n: v for n, v in entries.items() if v != {}}
