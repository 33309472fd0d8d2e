"""``fracid simulate RIG|PROJECT|RUN``: a simulated recording, as a rig's encoders would have read it."""

from __future__ import annotations

import json
import re
import shlex
import sys
import warnings
from collections.abc import Mapping
from math import degrees, pi
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fracid.cli.app import Jobs, Json, Out, Seed, Trust, app, each_once, echo_json, new_console, say_next, typed
from fracid.cli.app import table as new_table
from fracid.cli.completion import ZEROS, from_run, key_of, one_of
from fracid.errors import DataError, InputError

if TYPE_CHECKING:
    from rich.console import Console

    from fracid.recording import Recording
    from fracid.solver.trajectory import Trajectory
    from fracid.twins.twin import Twin

__all__ = ["quantity", "simulate"]

RELEASE = {"alpha": pi / 18}
"""Where a rig's pendulum is let go, if nothing else is said [rad]: the paper's 10°."""

SIMULATE_EXAMPLE = (
    "[bold]Examples[/bold]",
    "fracid simulate srv02-rotpen --order lambda=0.86 --order mu=0.91  [dim](from 10°; writes runs/srv02-rotpen-"
    "simulated)[/dim]",
    "fracid simulate qube-servo2 --friction --initial alpha=60deg --hold 1 --noise 0.05deg --counts 2048 --to "
    "twin.csv  [dim](then: fracid check twin.csv)[/dim]",
    "fracid simulate runs/rig --noise 0.05deg --counts 4096 --to twin.mat  [dim](a twin of its recording)[/dim]",
    "fracid simulate runs/rig --order mu=1 --set b_alpha=2e-4 --end 60  [dim](what if?)[/dim]",
    "fracid simulate srv02-rotpen --input pulse.csv,column=2 --step 2ms",
)

UNITS = {
    "": 1.0, "rad": 1.0, "deg": pi / 180, "°": pi / 180, "turn": 2 * pi, "turns": 2 * pi, "rad/s": 1.0,
    "deg/s": pi / 180, "°/s": pi / 180, "s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0, "V": 1.0, "mV": 1e-3,
}  # fmt: skip
"""What may stand behind a number, in SI."""


@app.command(epilog="\n\n".join(SIMULATE_EXAMPLE))
def simulate(
    source: Annotated[
        str,
        typer.Argument(
            metavar="RIG|PROJECT|RUN",
            help="A rig's name, a project, a run; or my_rig.py:model.",
            autocompletion=key_of("rigs"),
        ),
    ],
    order: Annotated[
        list[str] | None, typer.Option(metavar="NAME=VALUE", help="lambda=0.86; again for more. 1 for a rig.")
    ] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help="A parameter [SI], b_alpha=2e-4; again.")
    ] = None,
    initial: Annotated[
        list[str] | None, typer.Option(metavar="STATE=VALUE", help="alpha=10deg, with a unit; again for more.")
    ] = None,
    end: Annotated[str | None, typer.Option(metavar="S", help="Last time: 20 for a rig, else the recording's.")] = None,
    step: Annotated[str | None, typer.Option(metavar="S", help="Between samples, 1e-3 or 2ms.")] = None,
    substeps: Annotated[
        int | None, typer.Option(metavar="N", help="Steps of the solver to a sample.", min=1, max=1000)
    ] = None,
    hold: Annotated[
        str | None, typer.Option(metavar="S", help="Held still before the release: what fracid check looks for.")
    ] = None,
    method: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="{methods}.", autocompletion=key_of("methods")),
    ] = None,
    input_: Annotated[
        str | None,
        typer.Option(
            "--input",
            metavar="FILE[,FIELD=VALUE]...",
            help="What drives it: a file with time and input, column=2 if need be.",
        ),
    ] = None,
    noise: Annotated[
        list[str] | None,
        typer.Option(metavar="[NAME=]VALUE", help="Standard deviation, 0.05deg, of all angles or one."),
    ] = None,
    counts: Annotated[int, typer.Option(metavar="N", help="Counts a turn of the encoders; 0: none.", min=0)] = 0,
    friction: Annotated[
        bool, typer.Option("--friction", help="With the friction that was found on real recordings of the rig.")
    ] = False,
    zero: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Of a rig: where alpha = 0, hanging or upright.", autocompletion=one_of(*ZEROS)
        ),
    ] = None,
    recording: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Which, of a project or run.", autocompletion=from_run("recordings")),
    ] = None,
    states: Annotated[bool, typer.Option("--states", help="Write all states, fractional rates too.")] = False,
    to: Annotated[
        Path | None, typer.Option("--to", metavar="FILE", help="One file, .csv, .mat or .npz, and nothing else.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Write over a file that is there.")] = False,
    trust: Trust = False,
    out: Out = None,
    seed: Seed = 1,
    jobs: Jobs = 1,
    json_: Json = False,
) -> None:
    """Simulate a rig, a project or a fitted run, and write what its encoders would have recorded.

    A run is simulated with the values that it found, a project with its starting values; what the options name is
    changed.  Writes the recording, a figure, and a JSON file with the truth, ready for fracid check, init and fit.
    Exit code 0 if the simulation reached its end, 3 if not.
    """
    del jobs  # one run is not parallel; every command takes the same options
    twin = _twin(source, recording, zero, friction, input_ is None and not initial, trust)
    twin = _changed(twin, order, set_, initial, end=end, step=step, hold=hold, method=method, substeps=substeps)
    twin = _driven(twin, input_, end)
    levels = _noise(noise, twin)
    folder = None if to is not None and out is None else out or Path("runs") / f"{_stem(source)}-simulated"
    file = to or folder / f"{_stem(source)}.csv"  # type: ignore[operator]
    _refuse_over(file, force or (to is None and file.with_suffix(".json").exists()))
    run, said = _run(twin)
    for sentence in said:
        sys.stderr.write(f"{sentence}\n")
    if not run.completed:
        raise DataError(f"The simulation did not reach its end: at t = {run.time[-1]:.4g} s, {run.outcome.value}. "
                        "Give a smaller --step, other values, or an earlier --end.")  # fmt: skip
    made = twin.record(run, noise=levels, counts=counts, seed=seed, states=states)
    record = _record(source, twin, run, levels, counts, seed)
    files = _write(made, record, file, folder)
    if json_:
        echo_json(record | {"files": [str(path) for path in files]})
    else:
        _show(source, twin, run, made, files, new_console())


# ------------------------------------------------------------------ from text to a twin


def quantity(text: str, option: str, *, unit: str = "") -> float:
    """Parse ``10deg``, ``0.17rad``, ``2ms``, ``0.17``: SI.

    Parameters
    ----------
    text : str
    option : str
        What to type, in messages.
    unit : str
        Those that a bare number lacks, ``deg or rad``; none is missed if left out.

    Raises
    ------
    InputError
        For what is no number, an unknown unit, or a number without a unit where one is needed.

    Examples
    --------
    >>> round(quantity("10deg", "--initial alpha=10deg"), 6), quantity("2ms", "--step 2ms"), quantity("1e-3", "--step")
    (0.174533, 0.002, 0.001)
    """
    found = re.fullmatch(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([^\d\s]*)\s*", text)
    if not found or found[2] not in UNITS:
        raise InputError(f"{text!r} is not possible; expected a number with its unit, e.g. {option}.")
    if unit and not found[2]:
        raise InputError(f"{text!r} has no unit: {unit}? Type for example {option}.")
    return float(found[1]) * UNITS[found[2]]


def _assigned(given: list[str] | None, example: str, unit: Mapping[str, str] | None = None) -> dict[str, float]:
    """Parse ``NAME=VALUE`` of an option that may be given again; a state's name may hold blanks."""
    values: list[tuple[str, float]] = []
    for text in given or ():
        name, equals, value = text.rpartition("=")
        if not equals or not name.strip():
            raise InputError(f"{text!r} is not possible; expected NAME=VALUE, e.g. {example}.")
        shown = f"{example.split()[0]} {name.strip()}={value}{'deg' if unit else ''}" if _is_number(value) else example
        values.append((name.strip(), quantity(value, shown, unit=(unit or {}).get(name.strip(), ""))))
    return each_once(example.split()[0], values)


def _is_number(text: str) -> bool:
    return re.fullmatch(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*", text) is not None


def _twin(source: str, recording: str | None, zero: str | None, friction: bool, released: bool, trust: bool) -> Twin:
    """What the source says, before anything is changed."""
    path = Path(source)
    if path.is_dir() or path.suffix == ".toml":
        for option, given in (("--zero", zero), ("--friction", friction)):
            if given:
                raise InputError(f"{option} is for a rig; {source} says its own. Change a value: --set NAME=VALUE.")
        return _of_run(path, recording, trust) if path.is_dir() else _of_project(path, recording, trust)
    if recording is not None:
        raise InputError(f"--recording is for a project or a run, and {source} is a model: leave it out.")
    return _of_model(source, zero, friction, RELEASE if released else {})


def _of_model(source: str, zero: str | None, friction: bool, release: Mapping[str, float]) -> Twin:
    from fracid.models import RIGS, model_from_name, rotary_pendulum
    from fracid.twins.twin import Twin

    if source in RIGS:
        more = RIGS[source].fitted_friction if friction else {}
        model = rotary_pendulum(source, zero or "hanging", **more)  # type: ignore[arg-type]
    elif ".py:" in source:
        model, release = model_from_name(source, zero=zero), {}
    else:
        raise _no_source(source, RIGS)
    return Twin.of_model(model, name=_stem(source), initial=release, step=1e-3, end=20.0)


def _no_source(source: str, rigs: Mapping[str, Any]) -> InputError:
    from fracid.errors import unknown_name
    from fracid.safety.paths import kind_of, refuse_mistaken

    if kind_of(Path(source)) is None and len(Path(source).parts) > 1:
        refuse_mistaken(Path(source), "run")
    if kind_of(Path(source)) == "recording":
        return InputError(f"{source} is a recording: fracid check {source} looks at it, fracid init {source} writes a "
                          "project of it, which can be simulated.")  # fmt: skip
    hint = unknown_name("rig", source, tuple(rigs))
    return InputError(f"{hint}. It is no project and no run either; e.g. fracid simulate srv02-rotpen.")


def _of_project(path: Path, recording: str | None, trust: bool) -> Twin:
    from fracid.problem.project import load_project
    from fracid.twins.twin import Twin

    project = load_project(path, trust=trust)
    chosen = _chosen({e.name: e for e in (*project.problem.experiments, *project.validation)}, recording, path)
    problem = project.problem
    if chosen in project.validation:
        problem = problem.with_shared(problem.start, (chosen,))
    return Twin.of_problem(problem, problem.start, chosen)


def _of_run(folder: Path, recording: str | None, trust: bool) -> Twin:
    import numpy as np

    from fracid.runs.saved import load_run
    from fracid.twins.twin import Twin

    run = load_run(folder, trust=trust)
    problem, validation = run.problem, run.project.validation
    chosen = _chosen({e.name: e for e in (*problem.experiments, *validation)}, recording, folder)
    if chosen in validation:
        problem = problem.with_shared(run.x, (chosen,))
    found = [run.values.get(u.name, u.range.start) for u in problem.unknowns]
    return Twin.of_problem(problem, np.array(found), chosen)


def _chosen(there: Mapping[str, Any], asked: str | None, where: Path) -> Any:
    from fracid.errors import unknown_name

    if asked is not None and asked not in there:
        raise unknown_name(f"recording of {where}", asked, tuple(there))
    return there[asked] if asked is not None else next(iter(there.values()))


def _changed(
    twin: Twin, order: list[str] | None, parameter: list[str] | None, initial: list[str] | None, **more: Any
) -> Twin:
    """With what the options name."""
    angles = dict.fromkeys(twin.model.outputs, "deg or rad") if twin.model.zero else {}
    fields: dict[str, Any] = {}
    for name, example in (("end", "--end 20"), ("step", "--step 1ms"), ("hold", "--hold 1")):
        if more[name] is not None:
            fields[name] = quantity(more[name], example)
    if fields.get("hold", 0.0) < 0:
        raise InputError(f"hold = {fields['hold']:g} s is not possible; expected 0 or more.")
    if "hold" in fields and "end" not in fields:
        fields["end"] = twin.end + fields["hold"] - twin.hold
    if more["method"] is not None:
        fields["method"] = _method(more["method"])
    if more["substeps"] is not None:
        fields["substeps"] = more["substeps"]
    return twin.changed(
        orders=_assigned(order, "--order mu=0.91"), parameters=_assigned(parameter, "--set b_alpha=2e-4"),
        initial=_assigned(initial, "--initial alpha=10deg", angles), **fields,
    )  # fmt: skip


def _method(name: str) -> str:
    from fracid.errors import unknown_name
    from fracid.solver.methods import METHODS

    if name not in METHODS:
        raise unknown_name("method", name, tuple(METHODS))
    return name


def _driven(twin: Twin, said: str | None, end: str | None) -> Twin:
    """With the input of a file, ``pulse.csv,column=2``; to its end, where no other is said."""
    if said is None:
        return twin
    from fracid.cli.check import column_from_text
    from fracid.recording import inspect_recording, load_recording

    inputs = twin.model.inputs
    if not inputs:
        raise InputError(f"{twin.model.name} has no input; leave out --input.")
    file, _, fields = said.partition(",")
    found = inspect_recording(file)
    here = [n for n in found.signals if n in inputs] or list(found.signals)
    if not fields and len(here) > 1:
        raise InputError(f"{file} has {len(here)} columns besides its time: {', '.join(here)}. "
                         f"Say which drives it: --input {shlex.quote(f'{file},column={here[-1]}')}.")  # fmt: skip
    channel = column_from_text(f"{inputs[0]}={here[0]}" if not fields else f"{inputs[0]}=0,{fields}")[1]
    read = load_recording(file, {inputs[0]: {"unit": "V" if inputs[0] == "voltage" else "1"} | channel})
    times = read.time - read.time[0]
    last = {"end": float(times[-1])} if end is None else {}
    return twin.changed(inputs={inputs[0]: (times, read.signals[inputs[0]])}, **last)


def _noise(given: list[str] | None, twin: Twin) -> dict[str, float]:
    """Output → standard deviation [rad]; a value without a name is that of all."""
    unit = "deg or rad" if twin.model.zero else ""
    levels: list[tuple[str, float]] = []
    for text in given or ():
        name, _, value = text.rpartition("=")
        level = quantity(value, "--noise 0.05deg" if unit else "--noise 0.001", unit=unit)
        levels.append((name.strip() or "all", level))
    said = each_once("--noise", levels)
    of_all = dict.fromkeys(twin.model.outputs, said.pop("all")) if "all" in said else {}
    return of_all | said


def _stem(source: str) -> str:
    return re.sub(r"\W+", "-", Path(source.split(".py:")[0]).name.removesuffix(".toml")).strip("-") or "model"


# ------------------------------------------------------------------ from a twin to files


def _refuse_over(file: Path, force: bool) -> None:
    """A simulation must not take the place of a measurement."""
    from fracid.recording.writing import WRITERS

    if file.suffix.lower() not in WRITERS:
        raise InputError(f"--to {file} is not possible: expected a file that ends in {', '.join(WRITERS)}.")
    if file.exists() and not force:
        raise InputError(f"{file} is there already; give another name, or write over it: --force.")


def _run(twin: Twin) -> tuple[Trajectory, list[str]]:
    """Simulate; gives what the solver warns of, too."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        run = twin.simulate()
    return run, [str(w.message) for w in caught]


def _record(
    source: str, twin: Twin, run: Trajectory, noise: Mapping[str, float], counts: int, seed: int
) -> dict[str, Any]:
    """The truth."""
    model, values = twin.model, twin.model.parameter_vector(twin.parameters)
    parameters = {p.name: {"value": float(v), "unit": p.unit} for p, v in zip(model.parameters, values, strict=True)}
    initial = dict(zip(model.states, model.state_vector(twin.initial).tolist(), strict=True))
    return {
        "simulated": True, "source": source, "model": model.name, "zero": model.zero, "orders": dict(twin.orders),
        "parameters": parameters, "initial": initial, "step": twin.step, "substeps": twin.substeps, "end": twin.end,
        "hold": twin.hold, "method": run.method, "memory": run.memory, "driven": bool(twin.inputs),
        "noise": dict(noise), "counts": counts, "seed": seed, "outcome": run.outcome.value,
    }  # fmt: skip


def _write(made: Recording, record: Mapping[str, Any], file: Path, folder: Path | None) -> list[Path]:
    from fracid.recording.writing import save_recording

    files = [save_recording(made, file, note=_note(record))]
    if folder is None:
        return files
    from fracid.files import write_text
    from fracid.plots import recording_overview, save

    truth = folder / f"{file.stem}.json"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_text(truth, json.dumps(record, indent=2, ensure_ascii=False, allow_nan=False) + "\n")
    except OSError as error:
        raise InputError(f"The folder {folder} cannot be written: {error.strerror}. Give another: --out DIR.") from None
    return [*files, truth, *save(recording_overview(made), folder, file.stem)]


def _note(record: Mapping[str, Any]) -> str:
    """What the file says of itself."""
    from fracid._version import __version__

    orders = ", ".join(f"{n} = {v:.6g}" for n, v in record["orders"].items())
    initial = ", ".join(f"{n} = {v:.6g}" for n, v in record["initial"].items() if v)
    levels = ", ".join(f"{n} {v:.3g}" for n, v in record["noise"].items() if v)
    read = [
        f"noise {levels}" if levels else "no noise",
        f"{record['counts']} counts a turn" if record["counts"] else "",
    ]
    return "\n".join((
        f"SIMULATED, not measured: {record['model']} of {record['source']}"
        + (f", zero = {record['zero']}" if record["zero"] else ""),
        f"{orders}; at the start {initial or 'at rest'}; {record['method']}, step {record['step']:g} s / "
        f"{record['substeps']}; {', '.join(filter(None, read))}; seed {record['seed']}",
        f"made by fracid {__version__}",
    ))  # fmt: skip


# ------------------------------------------------------------------ from results to text


def _show(source: str, twin: Twin, run: Trajectory, made: Recording, files: list[Path], console: Console) -> None:
    from rich.markup import escape

    from fracid.cli.check import print_sketches

    orders = ", ".join(f"{n} {v:g}" for n, v in twin.orders.items())
    console.print(
        f"[bold]{escape(source)}[/bold]: {escape(twin.model.name)}, {twin.model.zero or 'no zero'}; {escape(orders)}; "
        f"{run.method}, memory {run.memory}, step {1e3 * run.step:g} ms, {made.time.size:,} samples to "
        f"{made.time[-1]:g} s: {run.outcome.value}",
        soft_wrap=True,
    )
    table = new_table("signal", "least", "greatest", "at the end", fold=("signal",))
    for name, x in made.signals.items():
        angle = made.units[name] == "rad"
        values = [degrees(v) if angle else v for v in (x.min(), x.max(), x[-1])]
        unit = "°" if angle else "" if made.units[name] == "1" else f" {made.units[name]}"
        table.add_row(escape(name), *(f"{v:.4g}{unit}" for v in values))
    console.print(table)
    print_sketches(console, made)
    kinds = {".json": "truth", ".png": "figure", ".svg": ""}
    for path in files:
        if kind := kinds.get(path.suffix, "recording"):
            console.print(f"{kind:10} {escape(str(path))}", soft_wrap=True)
    say_next(console, (typed("check", files[0]), "what it is worth, as of any recording"))
