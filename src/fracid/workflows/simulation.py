"""A simulated recording with its files, of a rig, a project or a run: ``fracid simulate``."""

from __future__ import annotations

import re
import shlex
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from math import pi
from pathlib import Path
from typing import Any

import numpy as np

from fracid._version import __version__
from fracid.arrays import by_name
from fracid.errors import DataError, InputError, entry_of, typed, unknown_name
from fracid.findings import Words
from fracid.models import MODELS, RIGS, model_from_name, rotary_pendulum
from fracid.models.library import MODEL as LIBRARY
from fracid.problem.experiment import held_inputs, refuse_other_dimensions
from fracid.recording import Recording, inspect_recording, load_recording
from fracid.recording.channel import si_unit, without_unit
from fracid.recording.writing import WRITERS, save_recording
from fracid.runs.saved import SavedRun
from fracid.safety.door import write_files
from fracid.safety.json_files import json_document
from fracid.safety.paths import default_folder, kind_of, refuse_mistaken
from fracid.safety.text import printable
from fracid.solver.trajectory import Trajectory
from fracid.tasks.display import unless_given
from fracid.tasks.progress import Observer
from fracid.twins.twin import Twin
from fracid.units import with_unit
from fracid.workflows.study import run_or_project

SAYS = Words("workflows/simulation.toml")

RELEASE = {"alpha": pi / 18}
"""Where a rig's pendulum is let go, if nothing else is said [rad]: the paper's 10°."""


@dataclass(frozen=True)
class SimulatedRecording:
    """What was simulated, and what its encoders would have recorded."""

    twin: Twin
    run: Trajectory
    recording: Recording
    result: Mapping[str, Any]
    """The truth."""
    files: tuple[Path, ...]


def twin_of(
    source: str, *, recording: str | None, zero: str | None, friction: bool, released: bool, trust: bool
) -> Twin:
    """Make what is to be simulated, before anything is changed.

    Parameters
    ----------
    source : str
        The name of a rig or of a model of the library, ``my_rig.py:model``, a project file or the folder of a run.
    recording : str or None
        Which, of a project or run.
    zero, friction
        Of a rig: where alpha = 0, and whether it has the friction of the real one.
    released : bool
        Whether a rig's pendulum is let go at 10°.
    trust : bool
        Let the project run code of its own.

    Raises
    ------
    InputError
        If there is none of that name, or what is asked of it is not its own.

    Examples
    --------
    >>> twin = twin_of("qube-servo2", recording=None, zero="upright", friction=False, released=True, trust=False)
    >>> twin.model.zero, round(twin.initial["alpha"], 3)
    ('upright', 0.175)
    """
    path = Path(source)
    if path.is_dir() or path.suffix == ".toml":
        for option, value in (("--zero", zero), ("--friction", friction)):
            if value:
                raise InputError(f"{option} is for a rig; {source} says its own. Change a value: --set NAME=VALUE.")
        return _of_fit(path, recording, trust)
    if recording is not None:
        raise InputError(f"--recording is for a project or a run, and {source} is a model: leave it out.")
    return _of_model(source, zero, friction, RELEASE if released else {})


def _of_model(source: str, zero: str | None, friction: bool, release: Mapping[str, float]) -> Twin:
    rig = "srv02-rotpen" if source == "rotary-pendulum" else source  # the model's constants where no rig is named
    if rig in RIGS:
        model = rotary_pendulum(rig, zero or "hanging", **(RIGS[rig].fitted_friction if friction else {}))  # type: ignore[arg-type]
    elif source in LIBRARY:
        if friction:
            raise InputError(f"--friction is for a rig; {source} is a model. Give its friction: --set b_angle=0.01.")
        return Twin.of_library(source, zero)
    elif ".py:" in source:
        model, release = model_from_name(source, zero=zero), {}
    else:
        raise _no_source(source, (*RIGS, *MODELS))
    return Twin.of_model(model, name=_stem(source), initial=release, step=1e-3, end=20.0)


def _no_source(source: str, known: tuple[str, ...]) -> InputError:
    if kind_of(Path(source)) is None and len(Path(source).parts) > 1:
        refuse_mistaken(Path(source), "run")
    if kind_of(Path(source)) == "recording":
        return InputError(SAYS("recording", source=source, check=typed("check", source), init=typed("init", source)))
    hint = unknown_name("rig or model", source, known)
    return InputError(f"{hint}. It is no project and no run either; e.g. fracid simulate srv02-rotpen.")


def _of_fit(path: Path, recording: str | None, trust: bool) -> Twin:
    """A run with its values, or a project with its start; of the recording that is named, or the first."""
    found = run_or_project(path, trust)
    problem, known = found.problem, found.values if isinstance(found, SavedRun) else {}
    project = found.project if isinstance(found, SavedRun) else found
    problem = replace(problem, experiments=project.problem.experiments)  # of a run in windows not these
    there = {e.name: e for e in (*problem.experiments, *project.validation)}
    experiment = entry_of(f"recording of {path}", there, next(iter(there)) if recording is None else recording)
    if experiment in project.validation:
        problem = problem.with_shared(problem.point(known), (experiment,))
    return Twin.of_problem(problem, problem.point(known), experiment)


def driven(twin: Twin, file: Path, channel: Mapping[str, Any], *, to_its_end: bool) -> Twin:
    """Give a twin the input of a file.

    Parameters
    ----------
    twin : Twin
    file : Path
        A recording of the input.
    channel : mapping
        Its column there, and its unit; the only one, if empty.
    to_its_end : bool
        Whether to simulate as long as the file lasts.

    Raises
    ------
    InputError
        If the model has no input, the file does not say which column it is, or it is in the unit of something else.
    """
    if not (inputs := twin.model.inputs):
        raise InputError(f"{twin.model.name} has no input; leave out --input.")
    there = inspect_recording(file)
    here = [n for n in there.signals if without_unit(n) in inputs] or list(there.signals)
    if not channel and len(here) > 1:
        raise InputError(SAYS("columns", file=shlex.quote(str(file)), columns=", ".join(here), name=inputs[0]))
    given = channel or {"column": int(here[0]) if here[0].isdigit() else here[0]}
    if str(given.get("column")) not in there.signals.keys() - there.assumed:  # else its header says the unit
        given = {"unit": si_unit(twin.model.input_unit(inputs[0])), **given}
    read = load_recording(file, {inputs[0]: given})
    refuse_other_dimensions(read, twin.model, ())
    times = read.time - read.time[0]
    last = {"end": float(times[-1])} if to_its_end else {}
    between = {**held_inputs(read.units, twin.model), **twin.between}
    return twin.changed(inputs={inputs[0]: (times, read.signals[inputs[0]])}, between=between, **last)


def simulate_twin(
    twin: Twin, source: str, *, noise: Mapping[str, float], counts: int, seed: int, states: bool, to: Path | None,
    out: Path | None, force: bool, truth: Path | None = None, observer: Observer | None = None,
) -> SimulatedRecording:  # fmt: skip
    """Simulate a twin and write what its encoders would have recorded, a figure, and the truth.

    Parameters
    ----------
    twin : Twin
    source : str
        What it was made of, for the names of the files.
    noise, counts, seed, states
        As of :meth:`fracid.Twin.record`.
    to : Path or None
        One file, and nothing else unless `out` is given too.
    out : Path or None
        The folder; ``runs/RIG-simulated`` if left out.
    force : bool
        Write over a file that is there.
    truth : Path, optional
        A .json file for the true values; the recording then carries none of them.
    observer : Observer
        Hears what the solver warns of.

    Raises
    ------
    InputError
        If a file is there already, or cannot be written.
    DataError
        If the simulation does not reach its end.
    """
    file = to or (out or default_folder(f"{_stem(source)}-simulated")) / f"{_stem(source)}.csv"
    folder = file.parent if to is None else out
    _refuse_over("--to", file, WRITERS, force or (to is None and file.with_suffix(".json").exists()))
    if truth is not None:
        _refuse_over("--truth", truth, (".json",), force)
    watching = unless_given(observer)
    watching.notices(
        SAYS("input-ends", name=name, end=times[-1], last=with_unit(u[-1], twin.model.input_unit(name)))
        for name, (times, u) in (twin.inputs or {}).items()
        if name not in twin.model.input_rates and np.ptp(u) > 0.0 and twin.end > times[-1] + twin.step
    )
    watching.stage("simulation")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        run = twin.simulate()
    watching.notices(warning.message for warning in caught)
    if run.completed and run.fault:
        watching.notice(str(run.fault))
    if not run.completed:
        advice = run.fault.sentence if run.fault else "Give a smaller --step, other values, or an earlier --end."
        advice = advice.replace('method = "bdf2"', "--method bdf2")
        raise DataError(SAYS("not-reached", end=run.time[-1], run=run, advice=advice))
    sensors: dict[str, Any] = {"noise": dict(noise), "counts": counts, "seed": seed}
    recording = twin.record(run, **sensors, states=states)
    record = _record(source, twin, run, sensors)
    watching.stage("figure")
    paths = _written(recording, record, file, folder, truth=truth)
    watching.stage("")
    return SimulatedRecording(twin, run, recording, record, files=paths)


def _stem(source: str) -> str:
    return re.sub(r"\W+", "-", Path(source.split(".py:")[0]).name.removesuffix(".toml")).strip("-") or "model"


# ------------------------------------------------------------------ from a twin to files


def _refuse_over(option: str, file: Path, endings: Iterable[str], force: bool) -> None:
    """A simulation must not take the place of a measurement."""
    if file.suffix.lower() not in endings:
        raise InputError(f"{option} {file} is not possible: expected a file that ends in {', '.join(endings)}.")
    if file.exists() and not force:
        raise InputError(f"{file} is there already; give another name, or write over it: --force.")


def _record(source: str, twin: Twin, run: Trajectory, sensors: Mapping[str, Any]) -> dict[str, Any]:
    """The truth."""
    model, values = twin.model, twin.model.parameter_vector(twin.parameters)
    parameters = {p.name: {"value": float(v), "unit": p.unit} for p, v in zip(model.parameters, values, strict=True)}
    initial = by_name(model.states, model.state_vector(twin.initial))
    return {
        "simulated": True, "source": printable(source), "model": model.name, "zero": model.zero,
        "orders": dict(twin.orders), "parameters": parameters, "initial": initial, "step": twin.step,
        "substeps": twin.substeps, "end": twin.end, "hold": twin.hold, "method": run.method, "memory": run.memory,
        "driven": bool(twin.inputs), **sensors, "outcome": run.outcome.value,
    }  # fmt: skip


def _written(
    made: Recording, record: Mapping[str, Any], file: Path, folder: Path | None, truth: Path | None
) -> tuple[Path, ...]:
    """Write the recording, the truth and the figure; gives the files."""
    files = [save_recording(made, file, note=_note(record, secret=truth is not None))]
    if truth is None and folder is not None:
        truth = folder / f"{file.stem}.json"
    if truth is not None:
        files += write_files(truth.parent, {truth.name: json_document(record)})
    if folder is not None:
        from fracid.plots import recording_overview, save

        files += save(recording_overview(made), folder, file.stem)
    return tuple(files)


def _note(record: Mapping[str, Any], *, secret: bool) -> str:
    """What the file says of itself; without the values, where they are `secret`."""
    zero = f", zero = {record['zero']}" if record["zero"] else ""
    first = f"SIMULATED, not measured: {record['model']} of {record['source']}{zero}"
    last = f"made by fracid {__version__}"
    return "\n".join((first, last) if secret else (first, _values(record), last))


def _values(record: Mapping[str, Any]) -> str:
    orders = ", ".join(f"{n} = {v:.6g}" for n, v in record["orders"].items()) or "fixed orders"
    initial = ", ".join(f"{n} = {v:.6g}" for n, v in record["initial"].items() if v)
    levels = ", ".join(f"{n} {v:.3g}" for n, v in record["noise"].items() if v)
    read = [f"noise {levels}" if levels else "no noise"]
    read += [f"{record['counts']} counts a turn"] if record["counts"] else []
    return SAYS("values", orders=orders, initial=initial or "at rest", record=record, read=", ".join(read))
