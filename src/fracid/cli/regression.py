"""``fracid regress PROJECT|RECORDING``: the pendulum's constants straight from recordings, by linear regression."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fracid.cli.app import Jobs, Json, Out, Seed, Trust, app, each_once, echo_json, new_console, say_next, typed
from fracid.cli.app import table as new_table
from fracid.cli.check import columns_from_texts, start_from_text, time_from_text
from fracid.cli.completion import ZEROS, key_of, one_of
from fracid.errors import DataError, InputError
from fracid.safety.paths import kind_of, refuse_mistaken

if TYPE_CHECKING:
    from rich.console import Console

    from fracid.models import Model
    from fracid.problem import Free, Problem
    from fracid.problem.project import Project
    from fracid.recording import Recording
    from fracid.regression import Regression

__all__ = ["regress"]

REGRESSION = "regression.json"


class Estimator(StrEnum):
    """Those of :func:`fracid.regress`; spelt out, for its module takes a second to import."""

    iv = "iv"
    tls = "tls"
    huber = "huber"
    tukey = "tukey"
    ols = "ols"


REGRESS_EXAMPLE = (
    "[bold]Examples[/bold]",
    "fracid regress rig.toml  [dim](what it leaves free, and a start for its fit)[/dim]",
    "fracid regress rig.toml --from release --order mu=1 --estimator tukey",
    "fracid regress release.mat --time 0 --column theta=1 --column alpha=2,zero=3.14159 --from release "
    "--rig srv02-rotpen --known C4=0.1944",
    "fracid regress rig.toml --json | jq .parameters.C1",
)


@app.command(epilog="\n\n".join(REGRESS_EXAMPLE))
def regress(
    source: Annotated[Path, typer.Argument(metavar="PROJECT|RECORDING", help="A project, .toml, or a recording.")],
    known: Annotated[
        list[str] | None, typer.Option(metavar="NAME=VALUE", help="A constant that is known [SI]; again for more.")
    ] = None,
    order: Annotated[
        list[str] | None, typer.Option(metavar="NAME=VALUE", help="An order that is known; the others are searched.")
    ] = None,
    term: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="A constant to look for, in place of what is free.")
    ] = None,
    estimator: Annotated[
        Estimator, typer.Option(help="Instruments, total least squares, or plain ones.")
    ] = Estimator.iv,
    cutoff: Annotated[
        float | None, typer.Option(metavar="HZ", help="Of the low-pass, in place of the spectrum's.")
    ] = None,
    each: Annotated[bool, typer.Option("--each", help="Each recording by itself, not all together.")] = False,
    start: Annotated[str | None, typer.Option("--from", metavar="S", help="First time in s, or release.")] = None,
    stop: Annotated[float | None, typer.Option("--to", metavar="S", help="Last time in s.")] = None,
    column: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=COLUMN[,FIELD=VALUE]...", help="Of a recording, as in fracid check."),
    ] = None,
    time: Annotated[str | None, typer.Option(metavar="COLUMN[,unit=ms]", help="Of a recording: its time.")] = None,
    rate: Annotated[float | None, typer.Option(metavar="HZ", help="Of a recording without a time column.")] = None,
    variable: Annotated[str | None, typer.Option(help="Which array of a .mat, .npz or HDF5 file.")] = None,
    rig: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Of a recording: whose values are taken for what is not found.",
            autocompletion=key_of("rigs"),
        ),
    ] = None,
    zero: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Of a recording: where alpha = 0, hanging or upright.", autocompletion=one_of(*ZEROS)
        ),
    ] = None,
    trust: Trust = False,
    out: Out = None,
    seed: Seed = 0,
    jobs: Jobs = 1,
    json_: Json = False,
) -> None:
    """Find the pendulum's constants by robust linear regression, and say which of them to believe.

    The equations are linear in the constants, for given orders; orders that are free are searched.  No trajectory is
    simulated but for the instruments, so this needs no start; it gives one.  Of a project the recordings to be
    fitted are taken together.  Writes regression.json only where --out says where to.  Exit code 0 if a constant was
    identified, 3 if none was.
    """
    del seed, jobs  # nothing here is random or parallel; every command takes the same options
    if kind_of(source) not in ("project", None):
        refuse_mistaken(source, "recording")
    options = {"column": column, "time": time, "rate": rate, "variable": variable, "rig": rig, "zero": zero}
    if source.suffix == ".toml":
        asked = _of_project(source, start, stop, options, trust)
    else:
        asked = _of_recording(source, start, stop, options)
    asked = _as_said(asked, known, order, term)
    found = _regressed(asked, estimator.value, cutoff, each)
    if out is not None:
        _write(found, out)
    if json_:
        echo_json(_record(found))
    else:
        console = new_console()
        _show(found, out, console)
        if source.suffix == ".toml":
            say_next(console, (typed("fit", source, *["--trust"] * trust), "by simulation, from this start"))
        else:
            say_next(console, (typed("init", source), "a project of it, to be fitted by simulation"))
    if not any(c.identified for f in found.regressions.values() for c in f.parameters.values()):
        raise typer.Exit(DataError.exit_code)


@dataclass(frozen=True)
class _Asked:
    """What to regress on what."""

    recordings: tuple[Recording, ...]
    model: Model
    orders: Mapping[str, float | Free]
    terms: tuple[str, ...]
    known: Mapping[str, float]
    problem: Problem | None = None
    """The project's: its start is given too."""
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Found:
    """Regressions by the names of their recordings."""

    asked: _Asked
    regressions: Mapping[str, Regression]


# ------------------------------------------------------------------ what is asked


def _of_project(path: Path, start: str | None, stop: float | None, options: Mapping[str, Any], trust: bool) -> _Asked:
    """What the project fits: its free constants and orders, its fixed ones, its recordings."""
    from fracid.problem import Free
    from fracid.problem.project import load_project
    from fracid.regression import TERMS

    if said := [n for n, v in options.items() if v is not None]:
        raise InputError(f"--{said[0]} is for a recording; the project file says it of each of its own.")
    project = load_project(path, trust=trust)
    problem = project.problem
    free = {u.target for u in problem.unknowns if u.kind == "parameter"}
    tied = {n for n, root in problem.ties.items() if root in free or n in problem.orders}
    orders = {n: problem.orders[problem.ties.get(n, n)] for n in problem.orders}
    notes = [f"{', '.join(sorted(tied))}: tied in the project, found by itself here; the regression knows no ties."]
    asked = _Asked(
        _recordings(project, start, stop), problem.model.with_parameters(**problem.parameter_starts),
        {n: v if isinstance(v, Free) else problem.order_starts[n] for n, v in orders.items()},
        tuple(n for n in TERMS if n in free | tied), {}, problem, tuple(notes if tied else ()),
    )  # fmt: skip
    return _in_motion(asked)


def _recordings(project: Project, start: str | None, stop: float | None) -> tuple[Recording, ...]:
    """The recordings to be fitted, from another start if one is asked for."""
    from fracid.validation.unknown_past import whole_recordings

    fitted = {e.name for e in project.problem.experiments}
    given = project.recordings if start is None else whole_recordings(project)
    seen = (*project.problem.outputs, *project.problem.model.inputs)  # an arm that is not scored may stand still
    trimmed = (r.trim(start_from_text(start), stop) for r in given if r.name in fitted)
    return tuple(replace(r, signals={n: x for n, x in r.signals.items() if n in seen}) for r in trimmed)


def _in_motion(asked: _Asked) -> _Asked:
    """Leave orders as they are where a recording starts in motion: what its memory misses would pass for an order."""
    from fracid.problem import Free
    from fracid.regression.rows import swing_of

    moving = [r.name for r in asked.recordings if swing_of(r, asked.model).in_motion]
    searched = [n for n, v in asked.orders.items() if isinstance(v, Free)]
    if not moving or not searched:
        return asked
    note = (
        f"{', '.join(moving)}: starts in motion, so {' and '.join(searched)} are not searched. Type --from release if "
        "the rig was held still before."
    )
    orders = {n: v.start if isinstance(v, Free) else v for n, v in asked.orders.items()}
    return replace(asked, orders=orders, notes=(*asked.notes, note))


def _of_recording(path: Path, start: str | None, stop: float | None, options: Mapping[str, Any]) -> _Asked:
    """The nine lumped constants of a rig, from one recording."""
    import fracid
    from fracid.problem import Free
    from fracid.regression import LUMPED

    columns = columns_from_texts(options["column"]) or {}
    if "alpha" not in columns:
        raise InputError(
            f"Which column of {path} is the pendulum's angle? Type --column alpha=2,unit=deg and --column theta=1; "
            f"fracid check {path} shows the columns. Or give a project file, .toml."
        )
    recording = fracid.load_recording(
        path, columns, time=time_from_text(options["time"], options["rate"]), start=start_from_text(start), stop=stop,
        variable=options["variable"], resample="needed",
    )  # fmt: skip
    words = {n: options[n] for n in ("rig", "zero") if options[n] is not None}
    model = fracid.rotary_pendulum(**words)
    return _in_motion(_Asked((recording,), model, dict.fromkeys(("lambda", "mu"), Free(1.0, 0.5, 1.2)), LUMPED, {}))


def _as_said(asked: _Asked, known: list[str] | None, order: list[str] | None, term: list[str] | None) -> _Asked:
    """With what the command line knows of constants and orders."""
    from fracid.errors import unknown_name

    orders = each_once("--order", map(_value_of("order"), order or ()))
    for name in orders:
        if name not in asked.orders:
            raise unknown_name("order", name, asked.orders)
    given = each_once("--known", map(_value_of("known"), known or ()))
    asked = replace(asked, orders={**asked.orders, **orders}, terms=tuple(term) if term else asked.terms, known=given)
    return _with_gauge(asked)


def _with_gauge(asked: _Asked) -> _Asked:
    """Where all is looked for, C4 is taken as it is: a common factor of all constants changes no motion."""
    from fracid.regression import LUMPED

    terms = asked.terms or LUMPED
    volts = any("voltage" in r.signals for r in asked.recordings) and "torque_per_volt" not in terms
    torque = any("torque" in r.signals for r in asked.recordings)
    held = [n for n in LUMPED if n not in terms and n in asked.model.parameter_names and asked.model.parameter(n).value]
    if asked.known or volts or torque or held:
        return replace(asked, terms=terms)
    C4 = asked.model.parameter("C4")
    note = (
        f"C4 = {C4.value:.4g} {C4.unit} is taken from the {'project' if asked.problem else 'rig'}: one constant must "
        "be known, for the motion tells only their ratios. Weigh and measure yours, and type --known C4=VALUE."
    )
    return replace(asked, terms=terms, known={"C4": C4.value}, notes=(*asked.notes, note))


def _value_of(option: str) -> Any:
    """A function that reads ``C4=0.19``."""

    def read(text: str) -> tuple[str, float]:
        name, _, value = text.partition("=")
        try:
            return name.strip(), float(value)
        except ValueError:
            example = "C4=0.1944" if option == "known" else "mu=1.0"
            raise InputError(f"--{option} {text!r} is not possible; expected NAME=VALUE, e.g. {example}.") from None

    return read


# ------------------------------------------------------------------ the regression


def _regressed(asked: _Asked, estimator: str, cutoff: float | None, each: bool) -> _Found:
    from fracid.regression import regress as library_regress

    groups = [[r] for r in asked.recordings] if each else [list(asked.recordings)]
    return _Found(asked, {
        ", ".join(r.name for r in group): library_regress(
            group, asked.model, orders=asked.orders, known=asked.known, terms=asked.terms,
            estimator=estimator, cutoff=cutoff,  # type: ignore[arg-type]
        )
        for group in groups
    })  # fmt: skip


def _starts(found: _Found, regression: Regression) -> dict[str, tuple[float, float]]:
    """Unknown of the project → its start there, and the one that the regression gives, where that is another."""
    from fracid.regression import start_of

    problem = found.asked.problem
    if problem is None:
        return {}
    pairs = zip(problem.start.tolist(), start_of(problem, regression).tolist(), strict=True)
    return {n: (old, new) for n, (old, new) in zip(problem.names, pairs, strict=True) if new != old}


# ------------------------------------------------------------------ from results to files and text


def _record(found: _Found) -> dict[str, Any]:
    """One regression as it is, several by name."""
    head = {"notes": list(found.asked.notes), "data_sha256": {r.name: r.sha256 for r in found.asked.recordings}}
    records = {
        name: f.to_json() | {"start": {n: new for n, (_, new) in _starts(found, f).items()}}
        for name, f in found.regressions.items()
    }
    (first, *others) = records.values()
    return {**head, "recordings": records} if others else {**first, **head}


def _write(found: _Found, folder: Path) -> None:
    from fracid.files import write_text

    text = json.dumps(_record(found), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_text(folder / REGRESSION, text)
    except OSError as error:
        raise InputError(f"The folder {folder} cannot be written: {error.strerror}. Give another: --out DIR.") from None


def _show(found: _Found, out: Path | None, console: Console) -> None:
    from rich.markup import escape

    for name, f in found.regressions.items():
        console.print(f"[bold]{escape(name)}[/bold]: {f.estimator}, {f.samples} rows", soft_wrap=True)
        _print_constants(console, f)
        for heading, text in _lines(f):
            console.print(f"  {heading:9} {escape(text)}", soft_wrap=True)
        for heading, text in _start_lines(found, f):
            console.print(f"  {heading:9} {escape(text)}", soft_wrap=True)
        for warning in (f.belief, *f.warnings):
            console.print(f"[yellow]![/yellow] {escape(warning)}", soft_wrap=True)
    for note in found.asked.notes:
        console.print(f"  • {escape(note)}", soft_wrap=True)
    if out is not None:
        console.print(f"result   {escape(str(out / REGRESSION))}", soft_wrap=True)


def _print_constants(console: Console, f: Regression) -> None:
    from rich.markup import escape

    table = new_table("", "value", "95 % interval", "bias", "unit", "", fold=())
    for name, c in f.parameters.items():
        half = "" if c.interval95 is None else f"± {(c.interval95[1] - c.interval95[0]) / 2:.2g}"
        bias = "" if c.bias is None else f"{c.bias:+.1g}"
        table.add_row(*map(escape, (name, f"{c.value:.4g}", half, bias, c.unit, _short(c.verdict))))
    console.print(table)
    doubted = [(n, c.verdict) for n, c in f.parameters.items() if _short(c.verdict) != c.verdict]
    for verdict in dict.fromkeys(verdict for _, verdict in doubted):
        names = ", ".join(n for n, said in doubted if said == verdict)
        console.print(f"[yellow]![/yellow] {escape(f'{names}: {verdict}')}", soft_wrap=True)


def _short(verdict: str) -> str:
    """What a table has room for; the whole stands below it."""
    kinds = ("identified", "known", "biased", "not excited", "only together")
    return next((kind for kind in kinds if verdict.startswith(kind)), "in doubt")


def _lines(f: Regression) -> list[tuple[str, str]]:
    """What stands below the table: what is only known together, orders, fit, filter."""
    together = [("together", f"{name} = {value:.4g}") for name, value in f.combinations.items()]
    orders = ", ".join(f"{n} = {v:.4g}{_searched(f, n)}" for n, v in f.orders.items())
    fit = ", ".join(f"{n}'s equation {percent:.1f} %" for n, percent in f.fit_percent.items())
    noise = f"residual variance {f.noise_ratio:.3g} times what noise explains"
    return [*together, ("orders", orders), ("fit", f"{fit}; {noise}"),
            ("low-pass", f"{f.cutoff:.3g} Hz: {f.cutoff_reason}")]  # fmt: skip


def _searched(f: Regression, name: str) -> str:
    if f.search is None or name not in f.search.interval95:
        return " (given)"
    low, high = f.search.interval95[name]
    return f" ({low:.3g} … {high:.3g})" if high - low < float("inf") else " (not seen)"


def _start_lines(found: _Found, f: Regression) -> list[tuple[str, str]]:
    """What of it a fit of the project would start from."""
    if found.asked.problem is None:
        return []
    changes = [f"{n} = {new:.4g} (from {old:.4g})" for n, (old, new) in _starts(found, f).items()]
    return [("start", ", ".join(changes) or "the project's own: nothing that it frees was identified")]
