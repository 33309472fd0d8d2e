"""A run taken elsewhere: MATLAB and Octave, C, JavaScript, spreadsheets, control design.

===============  =============================================  =============================
format           files                                          module
===============  =============================================  =============================
``matlab``       ``results.mat``, ``model.m``                   :mod:`fracid.export.matlab`
``c``            ``fracid_model.c``, ``fracid_model.h``         :mod:`fracid.export.c`
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

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from fracid.errors import InputError, unknown_name, writing
from fracid.safety.door import write_text

if TYPE_CHECKING:
    from fracid.runs.saved import SavedRun

HOURS = 10_000_000
"""Steps that the memory of the C function holds where nothing is said: 2.8 h of 1 ms."""


@dataclass(frozen=True)
class Export:
    """What :func:`export_run` wrote."""

    files: tuple[Path, ...]
    notes: tuple[str, ...]
    """What could not be written, and why; what to know of what was."""


def export_run(
    run: SavedRun,
    folder: str | Path,
    formats: Sequence[str] = (),
    *,
    steps: int | None = None,
    precision: Literal["double", "single"] = "double",
) -> Export:
    """Write a run for other programs.

    Parameters
    ----------
    run : SavedRun
        From :func:`fracid.load_run`.
    folder : str or Path
        Where the files go; made where it is missing.
    formats : sequence of str
        Of :data:`FORMATS`; all of them if empty.
    steps : int, optional
        Longest run that the memory of the programs must hold: if left out the longest recording's for ``model.m``, and
        :data:`HOURS` for the C function.
    precision : str
        Of the C function: ``double``, or ``single`` for processors without a double unit.

    Returns
    -------
    Export

    Raises
    ------
    InputError
        For an unknown format, one that is asked for and cannot be written, or a folder that cannot be written.

    Examples
    --------
    >>> list(FORMATS)
    ['matlab', 'c', 'javascript', 'toml', 'csv', 'json', 'state-space']
    """
    for name in formats:
        if name not in FORMATS:
            raise unknown_name("format", name, FORMATS)
    if precision not in ("double", "single"):
        raise unknown_name("precision", precision, ("double", "single"))
    folder = Path(folder)
    files: list[Path] = []
    notes = [*run.notes, *_left_out(run)]
    with writing(f"The folder {folder}"):
        folder.mkdir(parents=True, exist_ok=True)
        for name in formats or FORMATS:
            before = len(files)
            write = partial(_c, single=precision == "single") if name == "c" else FORMATS[name]
            for thing in write(run, folder, steps):
                if isinstance(thing, Path):
                    files.append(thing)
                else:
                    notes.append(thing)
            if formats and len(files) == before:  # nothing of what was asked for
                raise InputError(notes[-1])
    return Export(tuple(files), tuple(dict.fromkeys(notes)))


def _left_out(run: SavedRun) -> Iterator[str]:
    """What no exported model has: outputs that are functions, what channels do."""
    model = run.problem.model
    if functions := [n for n in model.outputs if n not in model.output_states]:
        names = ", ".join(functions)
        yield f"The exported model gives its states; {names} is a function of them, which it does not have."
    channels = {c for e in run.problem.experiments for c in (*e.sensors, *e.actuators)}
    if channels:
        yield f"The exported model is without delay, gain, bias and lowpass of {', '.join(sorted(channels))}."
    if any(kind != "line" for e in run.problem.experiments for kind in e.between.values()):
        yield "The exported model takes inputs as straight lines; where one jumps, give it the mean of both values."


def _matlab(run: SavedRun, folder: Path, steps: int | None) -> Iterator[Path | str]:
    from fracid.export.matlab import matlab_model, matlab_results, no_program, of_recording, write_results
    from fracid.export.recursion import Recursion
    from fracid.export.state_space import integer_model

    write_results(folder / "results.mat", matlab_results(run, integer=integer_model(run).to_matlab()))
    yield folder / "results.mat"
    if reason := no_program(run, "matlab"):
        yield f"{reason} There is no model.m; results.mat has values and curves."
        return
    case = of_recording(run, run.problem.experiments[0].name)
    write_text(folder / "model.m", matlab_model(Recursion.of(run.problem, run.x, steps), case, run.folder.name))
    yield folder / "model.m"
    if run.problem.per_recording:
        yield f"model.m has the constants of the recording {case.name!r}; each other's are in results.mat."


def _c(run: SavedRun, folder: Path, steps: int | None, *, single: bool = False) -> Iterator[Path | str]:
    from fracid.export.c import c_model
    from fracid.export.matlab import no_program, of_recording
    from fracid.export.recursion import Recursion

    if reason := no_program(run, "c"):
        yield f"{reason} There is no C function."
        return
    first = run.problem.experiments[0]
    case = of_recording(run, first.name)
    tables = Recursion.of(run.problem, run.x, steps or HOURS)
    for name, text in c_model(tables, case, run.folder.name, single=single).items():
        write_text(folder / name, text)
        yield folder / name
    if run.problem.per_recording or len({e.step for e in run.problem.experiments}) > 1:
        yield f"fracid_model.c has the step and the constants of the recording {first.name!r}."
    if first.past is not None:
        yield f"fracid_model.c starts without a past; {first.name!r} was fitted with the one that was measured."


def _javascript(run: SavedRun, folder: Path, _steps: int | None) -> Iterator[Path | str]:
    from fracid.export.javascript import javascript_model, no_javascript

    if reason := no_javascript(run.problem):
        yield f"{reason} There is no fracid_model.mjs."
        return
    first = run.problem.experiments[0]
    text = javascript_model(run.problem, run.x, first, run.folder.name)
    write_text(folder / "fracid_model.mjs", text)
    yield folder / "fracid_model.mjs"
    if run.problem.per_recording or len(run.problem.experiments) > 1:
        yield f"fracid_model.mjs has the start and the constants of the recording {first.name!r}."
    if first.past is not None:
        yield f"fracid_model.mjs starts without a past; {first.name!r} was fitted with the one that was measured."


def _toml(run: SavedRun, folder: Path, _steps: int | None) -> Iterator[Path | str]:
    from fracid.export.equations import toml_model
    from fracid.export.matlab import of_recording
    from fracid.safety.door import write_text

    first, model = run.problem.experiments[0], run.problem.model
    values = dict(zip(model.parameter_names, of_recording(run, first.name).parameters.tolist(), strict=True))
    orders = {n: run.result["orders"][n]["value"] for n in model.order_names}
    try:
        text = toml_model(model, values, orders, run.folder.name)
    except InputError as error:
        yield f"{error} There is no model.toml."
        return
    write_text(folder / "model.toml", text)
    yield folder / "model.toml"


def _csv(run: SavedRun, folder: Path, _steps: int | None) -> Iterator[Path | str]:
    from fracid.export.table import csv_tables

    for name, text in csv_tables(run).items():
        write_text(folder / name, text)
        yield folder / name


def _json(run: SavedRun, folder: Path, _steps: int | None) -> Iterator[Path | str]:
    from fracid.export.table import json_text

    write_text(folder / "export.json", json_text(run))
    yield folder / "export.json"


def _state_space(run: SavedRun, folder: Path, _steps: int | None) -> Iterator[Path | str]:
    import json

    from fracid.export.state_space import integer_model, sentences
    from fracid.plots.linear import linear_response
    from fracid.plots.writing import save

    system = integer_model(run)
    text = json.dumps(system.to_json(), ensure_ascii=False, allow_nan=False)
    write_text(folder / "state_space.json", text + "\n")
    yield folder / "state_space.json"
    for posture, linear in system.linear.items():
        if linear.inputs and linear.outputs and linear.G.any():
            yield from save(linear_response(system, posture), folder, f"linear-{posture}")
    yield from sentences(run, system)


FORMATS: dict[str, Callable[[SavedRun, Path, int | None], Iterator[Path | str]]] = {
    "matlab": _matlab, "c": _c, "javascript": _javascript, "toml": _toml, "csv": _csv, "json": _json,
    "state-space": _state_space,
}  # fmt: skip
"""(run, folder, longest run) → the files that it wrote, and sentences."""
