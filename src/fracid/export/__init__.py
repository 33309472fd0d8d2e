"""A run taken elsewhere: MATLAB and Octave, C, FMUs, JavaScript, spreadsheets, control design.

===============  =============================================  =============================
format           files                                          module
===============  =============================================  =============================
``matlab``       ``results.mat``, ``model.m``                   :mod:`fracid.export.matlab`
``c``            ``fracid_model.c``, ``fracid_model.h``         :mod:`fracid.export.c`
``fmu``          ``MODEL.fmu``: a unit of co-simulation         :mod:`fracid.export.fmu`
``mjcf``         ``MODEL.xml``: rigid bodies for MuJoCo          :mod:`fracid.export.simulators`
``urdf``         ``MODEL.urdf``: the same, a robot description  :mod:`fracid.export.simulators`
``bam``          ``MODEL.json``: a servo's friction for BAM      :mod:`fracid.export.simulators`
``observer``     ``observer.c``: the states from the sensors    :mod:`fracid.export.c_observer`
``javascript``   ``fracid_model.mjs``                           :mod:`fracid.export.javascript`
``toml``         ``model.toml``: the model as equations         :mod:`fracid.export.equations`
``csv``          one a recording: measured, fitted, residual    :mod:`fracid.export.table`
``state-space``  ``state_space.json``, step and Bode figures    :mod:`fracid.export.state_space`
``json``         ``export.json``: the result with its curves    :mod:`fracid.export.table`
===============  =============================================  =============================

Programs (``model.m``, the C function) step as :mod:`fracid.solver.schemes` does, with tables of numbers that
:mod:`fracid.export.recursion` takes out of the compiled loops; the JavaScript makes these tables itself, for any order.
Nothing is written outside of the folder that is given.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from fracid.errors import Failure, InputError, at_least, refuse_unknown, writing
from fracid.export.compilers import PLATFORMS
from fracid.safety.door import write_files
from fracid.safety.kinds import refuse_other_kinds

if TYPE_CHECKING:
    from fracid.runs.saved import SavedRun

HOURS = 10_000_000
"""Steps that the memory of the C function holds where nothing is said: 2.8 h of 1 ms."""


PROGRAMS = ("matlab", "c", "fmu", "javascript")
"""Formats that simulate the model."""


ON_REQUEST = ("mjcf", "urdf", "bam", "observer")
"""Formats that few models have: they are written where they are asked for."""


@dataclass(frozen=True)
class Options:
    """How a run is written.

    Raises
    ------
    InputError
        For a value that means nothing.
    """

    steps: int | None = None
    """Longest run that the memory of the programs must hold: if left out the longest recording's for ``model.m``, and
    :data:`HOURS` for the C function."""
    precision: Literal["double", "single"] = "double"
    """Of the C functions: ``single`` for processors without a double unit."""
    fmi: Literal["2", "3"] = "2"
    """Version of the interface of an FMU: ``2``, which nearly every tool imports, or ``3``."""
    platforms: Sequence[str] = ()
    """For which the FMU holds a library, of :data:`fracid.export.compilers.PLATFORMS`; this one if empty."""
    actuator: str = ""
    """What BAM calls the servo, such as ``xl330``."""
    slow: Mapping[str, float] = field(default_factory=dict)
    """Constants and orders that the observer estimates too, as of :func:`fracid.observer`."""

    def __post_init__(self) -> None:
        """Refuse what means nothing."""
        refuse_other_kinds(self)
        refuse_unknown("platform", PLATFORMS, *self.platforms)
        if self.steps is not None:
            at_least("steps", self.steps, 1)


@dataclass(frozen=True)
class Export:
    """What :func:`export_run` wrote."""

    files: tuple[Path, ...]
    notes: tuple[str, ...]
    """What could not be written, and why; what to know of what was."""


def export_run(run: SavedRun, folder: str | Path, formats: Sequence[str] = (), **options: Any) -> Export:
    """Write a run for other programs.

    Parameters
    ----------
    run : SavedRun
        From :func:`fracid.load_run`.
    folder : str or Path
        Where the files go; made where it is missing.
    formats : sequence of str
        Of :data:`FORMATS`; all but those :data:`ON_REQUEST` if empty.
    **options
        The fields of :class:`fracid.export.Options`: ``steps``, ``precision``, ``fmi``, ``platforms``, ``actuator``,
        ``slow``.

    Returns
    -------
    Export

    Raises
    ------
    InputError
        For an unknown format, one that is asked for and cannot be written, a run of which every simulation fails, or a
        folder that cannot be written.

    Examples
    --------
    >>> list(FORMATS)
    ['matlab', 'c', 'fmu', 'mjcf', 'urdf', 'bam', 'observer', 'javascript', 'toml', 'csv', 'json', 'state-space']
    """
    how, folder = Options(**options), Path(folder)
    refuse_unknown("format", FORMATS, *formats)
    ends = [run.problem.fitted(run.x, e) for e in run.problem.experiments]
    if all(isinstance(end, Failure) for end in ends):
        raise InputError(f"There is nothing to export: {ends[0]}.")
    wanted = formats or [name for name in FORMATS if name not in ON_REQUEST]
    files: list[Path] = []
    refused: list[str] = []
    notes = [*run.notes, *_left_out(run, wanted)]
    with writing(f"The folder {folder}"):
        folder.mkdir(parents=True, exist_ok=True)
        for name in wanted:
            before = len(files)
            try:
                for part in FORMATS[name].write(run, folder, how):
                    if isinstance(part, str):
                        notes.append(part)
                    else:
                        files += [part] if isinstance(part, Path) else write_files(folder, dict([part]), nullcontext())
                if name in PROGRAMS:
                    notes += _of_first(run, files[-1].name)
            except InputError as error:  # what cannot be is no error of the export: there is no such file then
                notes.append(f"{error} There is no {FORMATS[name].file}.")
            if formats and len(files) == before:  # nothing of what was asked for
                refused.append(notes[-1])
    if refused:
        raise InputError(" ".join([*refused, *([f"All else is in {folder}."] if files else [])]))
    return Export(tuple(files), tuple(dict.fromkeys(notes)))


Written = Iterator[Path | tuple[str, str | bytes] | str]
"""Files that are there, names and contents of those to be written, and sentences."""


def _left_out(run: SavedRun, formats: Iterable[str]) -> Iterator[str]:
    """What exported models do not have: outputs that are functions, what channels do."""
    model, tables = run.problem.model, {"matlab", "javascript"}.intersection(formats)
    if not set(PROGRAMS).intersection(formats):
        return
    from fracid.export.javascript import outputs_of

    lacking = [name for name, key in (("MATLAB", "matlab"), ("JavaScript", "javascript"))
               if key in tables and (key == "matlab" or not outputs_of(model)[1])]  # fmt: skip
    if lacking and (functions := [n for n in model.outputs if n not in model.output_states]):
        names = ", ".join(functions)
        yield f"In {' and '.join(lacking)} the model gives its states; {names} is a function of them, which it lacks."
    if channels := {c for e in run.problem.experiments for c in (*e.sensors, *e.actuators)}:
        yield f"The exported model is without delay, gain, bias and lowpass of {', '.join(sorted(channels))}."


def _matlab(run: SavedRun, _folder: Path, options: Options) -> Written:
    from fracid.export.identified import Identified
    from fracid.export.matlab import matlab_model, matlab_results
    from fracid.export.state_space import integer_model

    yield "results.mat", matlab_results(run, integer=integer_model(run).to_matlab())
    model = Identified.of_run(run, options.steps)
    yield "model.m", matlab_model(model.tables, model.case, model.run)


def _c(run: SavedRun, _folder: Path, options: Options) -> Written:
    from fracid.export.c import c_model, error_of_single
    from fracid.export.identified import Identified

    model, single = Identified.of_run(run, options.steps or HOURS), options.precision == "single"
    error = error_of_single(model.tables, model.case) if single else ""
    yield from c_model(model.tables, model.case, model.run, single=single, error=error).items()
    yield from filter(None, [error])


def _of_first(run: SavedRun, file: str) -> Iterator[str]:
    """What a program has of the first recording alone."""
    first = run.problem.experiments[0]
    if run.problem.per_recording or len(run.problem.experiments) > 1:
        yield f"{file} has the step, the start and the constants of the recording {first.name!r}."
    if first.past is not None:
        yield f"{file} starts without a past; {first.name!r} was fitted with the one that was measured."


def _fmu(run: SavedRun, _folder: Path, options: Options) -> Written:
    from fracid.export.fmu import fmu
    from fracid.export.identified import Identified

    model = Identified.of_run(run, options.steps or HOURS)
    archive, notes = fmu(model, options.fmi, options.platforms)
    yield f"{model.identifier}.fmu", archive
    yield from notes


def _rigid(target: str, run: SavedRun, _folder: Path, _options: Options) -> Written:
    from fracid.export import simulators
    from fracid.export.identified import Identified

    model = Identified.of_run(run)
    rig = simulators.rig_of(model, target)
    said = list(rig.lost)
    if target == "MuJoCo":
        name, write = f"{model.identifier}.xml", simulators.mjcf
        said.append(simulators.error_in_mujoco(rig, write(rig)))
    else:
        name, write = f"{model.identifier}.urdf", simulators.urdf
        said += simulators.lost_in_urdf(rig)
    yield name, write(rig, simulators.heading(rig, said))
    yield from said


def _bam(run: SavedRun, _folder: Path, options: Options) -> Written:
    import json

    from fracid.export.identified import Identified
    from fracid.export.simulators import bam

    model = Identified.of_run(run)
    values, lost = bam(model, options.actuator)
    name = f"{model.identifier}.json"
    yield name, json.dumps(values, indent=2, allow_nan=False) + "\n"
    yield from lost
    if not options.actuator:
        yield f'BAM asks for the servo\'s name: write it as "actuator" into {name}, or give --actuator xl330.'
    if run.problem.per_recording:
        yield f"{name} has the constants of the recording {run.problem.experiments[0].name!r}."


def _observer(run: SavedRun, _folder: Path, options: Options) -> Written:
    from fracid.export.c_observer import c_observer, error_of_observer
    from fracid.export.identified import columns_of, source_of
    from fracid.filtering import first_samples, observer

    watch, single = observer(run, slow=options.slow), options.precision == "single"
    samples = first_samples(run.problem, watch.sensors, len(run.problem.experiments[0].measured))
    text = c_observer(watch, *samples, source_of(run), single=single, columns=columns_of(run))
    yield "observer.c", text
    yield error_of_observer(text, watch, *samples, single=single)


def _javascript(run: SavedRun, _folder: Path, _options: Options) -> Written:
    from fracid.export.javascript import javascript_model

    yield "fracid_model.mjs", javascript_model(run.problem, run.x, run.problem.experiments[0], run.folder.name)


def _toml(run: SavedRun, _folder: Path, _options: Options) -> Written:
    from fracid.export.equations import toml_model
    from fracid.export.identified import Identified

    model, identified = run.problem.model, Identified.of_run(run)
    values = {n: q.value for n, q in identified.constants.items()}
    orders = {n: run.result["orders"][n]["value"] for n in model.order_names}
    yield "model.toml", toml_model(model, values, orders, identified.run)


def _csv(run: SavedRun, _folder: Path, _options: Options) -> Written:
    from fracid.export.table import csv_tables

    yield from csv_tables(run).items()


def _json(run: SavedRun, _folder: Path, _options: Options) -> Written:
    from fracid.export.table import json_text

    yield "export.json", json_text(run)


def _state_space(run: SavedRun, folder: Path, _options: Options) -> Written:
    import json

    from fracid.export.identified import source_of
    from fracid.export.state_space import integer_model, sentences
    from fracid.plots.linear import linear_response
    from fracid.plots.writing import save

    system = integer_model(run)
    content = {"run": source_of(run), **system.to_json()}
    yield "state_space.json", json.dumps(content, ensure_ascii=False, allow_nan=False) + "\n"
    for posture, linear in system.linear.items():
        if linear.inputs and linear.outputs and linear.G.any():
            yield from save(linear_response(system, posture), folder, f"linear-{posture}")
    yield from sentences(run, system)


class Format(NamedTuple):
    """One of the table above."""

    write: Callable[[SavedRun, Path, Options], Written]
    """(run, folder, options) → the files that it wrote, and sentences."""
    file: str
    """What there is not where it cannot be written."""


FORMATS = {
    "matlab": Format(_matlab, "model.m"),
    "c": Format(_c, "C function"),
    "fmu": Format(_fmu, "FMU"),
    "mjcf": Format(partial(_rigid, "MuJoCo"), "file for MuJoCo"),
    "urdf": Format(partial(_rigid, "URDF"), "file for URDF"),
    "bam": Format(_bam, "file for BAM"),
    "observer": Format(_observer, "observer.c"),
    "javascript": Format(_javascript, "fracid_model.mjs"),
    "toml": Format(_toml, "model.toml"),
    "csv": Format(_csv, "CSV file"),
    "json": Format(_json, "export.json"),
    "state-space": Format(_state_space, "model of integer order"),
}
"""By name."""
