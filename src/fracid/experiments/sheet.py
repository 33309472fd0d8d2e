"""The sheet of a plan: what to take to the laboratory, and what to expect there.

======================  =========================================================================================
file                    holds
======================  =========================================================================================
``sheet.txt``           the experiments one after the other, and the intervals to expect
``next.toml``           a project for the recordings to come, at the values of now
``next-clamped.toml``   the same of those with the arm clamped
``voltage-N.csv``       the voltage of experiment N, to be played to the motor
``expected-N.csv``      what experiment N should show, with its 95 % band
``plan.json``           the plan for programs
``figures/``            the expected curves, and the interval against angle of release and duration
======================  =========================================================================================
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import Failure, writing
from fracid.estimation.derivatives import jacobian
from fracid.experiments.space import Candidate, DesignSpace
from fracid.experiments.subject import Subject, driven
from fracid.figures import draw
from fracid.problem import Free
from fracid.problem.toml_text import toml_value
from fracid.problem.unknowns import Value, start_of
from fracid.quantiles import NORMAL_95
from fracid.recording import Recording
from fracid.recording.writing import save_recording
from fracid.safety.door import write_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIGNALS = ("time", "variable", "resample")
"""Keys of a recording's table that the next one has too, beside its signals."""


class Sheet(Protocol):
    """What of a plan is written."""

    @property
    def subject(self) -> Subject: ...  # noqa: D102
    @property
    def space(self) -> DesignSpace: ...  # noqa: D102
    @property
    def experiments(self) -> tuple[Candidate, ...]: ...  # noqa: D102
    @property
    def covariance(self) -> FloatArray: ...  # noqa: D102

    def summary(self) -> str:
        """The plan and the intervals to expect, in lines."""

    def to_json(self) -> dict[str, Any]:
        """The plan as plain values."""

    def plot(self) -> Figure:
        """The interval to expect against release and duration."""


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


def expected_curves(plan: Sheet) -> tuple[Expected, ...]:
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
    covariance = plan.covariance
    if subject.intervals:
        vague = np.diag((100 * subject.scale) ** -2.0)
        known = subject.recorded.curvature + vague, subject.recorded.scatter + vague
        covariance = type(subject.recorded)(*known).covariance(subject.scale)
    for c in dict.fromkeys(plan.experiments):
        problem = subject.problem_of(c, plan.space)
        outputs = problem.fitted(problem.start, problem.experiments[0])
        at = [i for i, u in enumerate(problem.unknowns) if u.experiment is None]
        J = jacobian(problem, problem.start, np.array(at))
        if isinstance(outputs, Failure) or isinstance(J, Failure):
            continue
        rows = [subject.names.index(problem.names[i]) for i in at]
        part = covariance[np.ix_(rows, rows)]
        variance = np.einsum("toi,ij,toj->to", J[0], part, J[0])
        half = NORMAL_95 * np.sqrt(np.maximum(variance, 0.0))
        played = subject.problem.model.inputs.index(driven(subject.problem)) if c.voltage is not None else 0
        u = None if c.voltage is None else problem.experiments[0].inputs[:, played]
        names = problem.outputs
        curves.append(Expected(c, problem.experiments[0].time, dict(zip(names, outputs.T, strict=True)),
                               dict(zip(names, half.T, strict=True)), u))  # fmt: skip
    return tuple(curves)


def write_sheet(plan: Sheet, folder: Path) -> tuple[Path, ...]:
    """Write the sheet of a plan into a folder that is made if need be.

    Raises
    ------
    InputError
        If the disk will not take it.
    """
    from fracid.plots import save  # matplotlib is slow to load

    curves, files = expected_curves(plan), []
    with writing(f"The folder {folder}"):
        folder.mkdir(parents=True, exist_ok=True)
        texts = {
            "sheet.txt": _sheet(plan),
            "plan.json": json.dumps(plan.to_json(), indent=2, ensure_ascii=False) + "\n",
        }
        for arm, name in (("free", "next.toml"), ("clamped", "next-clamped.toml")):
            own = [(k, c) for k, c in enumerate(plan.experiments, 1) if c.arm == arm]
            if own:
                texts[name] = "\n".join(_project(plan, own, clamped=arm == "clamped")) + "\n"
        for name, text in texts.items():
            write_text(folder / name, text)
            files.append(folder / name)
    units = plan.subject.problem.model.input_units
    for curve in curves:
        number = plan.experiments.index(curve.candidate) + 1
        if curve.voltage is not None:
            name = driven(plan.subject.problem)
            signal = Recording.of("voltage", curve.time, {name: curve.voltage}, {name: units.get(name, "1")})
            files.append(save_recording(signal, folder / f"voltage-{number}.csv", note=str(curve.candidate)))
        bands = {n: y for o, y in curve.outputs.items() for n, y in
                 ((o, y), (f"{o} low", y - curve.half[o]), (f"{o} high", y + curve.half[o]))}  # fmt: skip
        angles = plan.subject.problem.model.angles
        kinds = {n: "rad" if n.split()[0] in angles else "1" for n in bands}
        expected = Recording.of("expected", curve.time, bands, kinds)
        files.append(save_recording(expected, folder / f"expected-{number}.csv", note=f"{curve.candidate}, 95 % band"))
    files += save(draw("expected_curves", curves, plan.subject.problem.model), folder / "figures", "expected")
    files += save(plan.plot(), folder / "figures", "intervals")
    return tuple(files)


def _sheet(plan: Sheet) -> str:
    lines = [plan.summary(), "", "Experiments"]
    for k, c in enumerate(plan.experiments, 1):
        first = plan.experiments.index(c) + 1
        play = "" if c.voltage is None else f"play voltage-{first}.csv; "
        lines += [f"  {k}. {c}", f"     {play}save it as recording-{k}.csv; compare with expected-{first}.csv"]
    if len({c.arm for c in plan.experiments}) > 1:
        lines += ["", "Recordings with the arm clamped are a project of their own. Fit next-clamped.toml first, and",
                  "give next.toml what it finds as prior = { mean = ..., sd = ... }."]  # fmt: skip
    lines += ["", "Then: fracid check recording-1.csv, and fracid fit next.toml."]
    return "\n".join(lines) + "\n"


# --- the project file --------------------------------------------------------------------------------------


def _project(plan: Sheet, experiments: list[tuple[int, Candidate]], *, clamped: bool) -> Iterator[str]:
    """The lines of a project for recordings that are not there yet."""
    subject, p = plan.subject, plan.subject.problem
    table = subject.table.get("model", {})
    own = {k: table[k] for k in ("name", "rig", "zero", "actuation") if k in table}
    actuation = {"actuation": p.model.inputs[0]} if p.model.name == "rotary-pendulum" and p.model.inputs else {}
    head = own or {"name": p.model.name, **({"zero": p.model.zero} if p.model.zero else {}), **actuation}
    yield f"# Planned by fracid design for {subject.name}: put the recordings where file = ... says, then fit."
    yield "[model]"
    yield from (f"{k} = {toml_value(v)}" for k, v in head.items())
    if ".py:" in str(head["name"]):
        yield "# copy that file beside this one"
    yield "\n[model.parameters]"
    values: dict[str, Value] = {n: v for n, v in p.parameters.items()}
    if not own.get("rig"):
        values = {q.name: q.value for q in p.model.parameters} | values
    if clamped:
        values["J_theta"] = 1e3
    yield from (f"{n} = {_value(v)}" for n, v in values.items())
    yield "\n[model.orders]"
    yield from (f"{n} = {_value(v)}" for n, v in p.orders.items())
    outputs = tuple(plan.space.sensors) or p.outputs
    known = subject.table.get("recording", {})
    for k, c in experiments:
        yield f"\n[[recording]]  # {c}"
        yield f'name = "{k}: {f"{c.release:g}°" if c.release else c.voltage}"\nfile = "recording-{k}.csv"'
        if hidden := {n: v for n, v in known.get("initial", {}).items() if n in p.model.states and n not in outputs}:
            yield f"initial = {toml_value(hidden)}"
        if own_constants := {**p.experiments[0].constants, **dict(c.constants)}:
            yield f"parameters = {toml_value(own_constants)}"
        signals = {n: known[n] for n in (*SIGNALS, *outputs) if n in known}
        missing = {n: {"column": n, "unit": "rad" if n in p.model.angles else "1"} for n in outputs if n not in signals}
        time = {} if "time" in signals else {"time": {"column": 0}}
        yield from (f"{n} = {toml_value(v)}" for n, v in {**time, **signals, **missing}.items())
        if c.voltage is not None:
            name = driven(p)
            column = known.get(name, {"column": name, "unit": p.model.input_units.get(name, "1")})
            between = "line" if name in p.model.input_rates.values() else "hold"
            yield f"{name} = {toml_value({**column, 'between': between})}"
            if "amplifier" in known:
                yield f"amplifier = {toml_value(known['amplifier'])}"
        else:
            yield 'from = "release"'
            if moment := plan.space.moment:
                yield f"release_time = {toml_value({'start': 0.0, 'lower': -moment, 'upper': moment})}"
    yield f'\n[fit]\noutputs = {toml_value(list(outputs))}\ninitial_state = "{plan.space.initial_state}"'
    yield f"weights = {toml_value(p.weights)}\nmethod = {toml_value(p.method)}"
    if p.per_recording:
        yield f"per_recording = {toml_value(list(p.per_recording))}"


def _value(value: Value) -> str:
    """A number, a range, or another's name."""
    if isinstance(value, Free):
        ends = {"start": value.start, "lower": value.lower, "upper": value.upper}
        return toml_value({k: v for k, v in ends.items() if math.isfinite(v)})
    return toml_value(start_of(value)) if isinstance(value, float | int) else toml_value(value.to)
