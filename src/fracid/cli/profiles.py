"""``fracid profile RUN|PROJECT``: how far each unknown can go before the data object, and what they can tell of it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from math import floor, isfinite, log10
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fracid.cli.app import CORES, Jobs, Json, Out, Seed, Trust, app, echo_json, new_console, say_next, typed
from fracid.cli.app import table as new_table
from fracid.cli.completion import from_run
from fracid.errors import DataError, Failure, InputError
from fracid.safety.paths import refuse_mistaken

if TYPE_CHECKING:
    from rich.console import Console

    from fracid.arrays import FloatArray
    from fracid.estimation.block_bootstrap import Bootstrap
    from fracid.estimation.cost_profile import Profiles
    from fracid.estimation.covariance import Uncertainty
    from fracid.estimation.parameter_verdicts import Verdict
    from fracid.problem import Problem

__all__ = ["profile"]

PROFILES = "profiles.json"

PROFILE_EXAMPLE = (
    "[bold]Examples[/bold]",
    "fracid profile runs/rig  [dim](the orders; into the folder of that run)[/dim]",
    "fracid profile runs/rig --parameter mu --parameter b_alpha --joint mu,b_alpha",
    "fracid profile rig.toml --points 20 --out profiled  [dim](fits first)[/dim]",
    "fracid profile runs/rig --json | jq .profiles.mu.interval95",
)


@app.command(epilog="\n\n".join(PROFILE_EXAMPLE))
def profile(
    source: Annotated[Path, typer.Argument(metavar="RUN|PROJECT", help="A run folder, or a project file to fit.")],
    parameter: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="An unknown; may be given again. The free orders if left out.",
            autocompletion=from_run("orders", "parameters"),
        ),
    ] = None,
    joint: Annotated[str | None, typer.Option(metavar="NAME,NAME", help="Two unknowns, together too.")] = None,
    points: Annotated[int, typer.Option(metavar="N", help="Between the ends of an interval, about.")] = 12,
    trust: Trust = False,
    out: Out = None,
    seed: Seed = 1,
    jobs: Jobs = CORES,
    json_: Json = False,
) -> None:
    """Profile unknowns: hold each at a row of values, fit all others, and see where the data object.

    Shows the 95 % interval of the profile beside those of the sandwich and of the bootstrap, and in words what the
    data can tell of each unknown.  Writes profiles.json and a figure.  Exit code 0 if it is done, 3 if no run of the
    model reached the end of the recording.
    """
    found = _profiled(source, parameter, _pair(joint), points, seed, jobs, trust)
    folder = out or (source if source.is_dir() else Path("runs") / f"{source.stem}-profile")
    figure = _write(found, folder)
    if json_:
        echo_json(found.record)
    else:
        console = new_console()
        _show(found, folder, figure, console)
        if folder == source:
            say_next(console, (typed("report", source, "--open", *["--trust"] * trust), "the page, with the profiles"))
        else:
            say_next(console, (typed("fit", source, *["--trust"] * trust), "the whole result, with a page"))


@dataclass(frozen=True)
class _Profiled:
    """Profiles with what stands beside them."""

    profiles: Profiles
    known: Uncertainty | Failure
    bootstrap: Bootstrap | Failure
    verdicts: dict[str, Verdict]
    record: dict[str, Any]
    """The content of profiles.json."""


def _pair(joint: str | None) -> tuple[str, str] | None:
    if joint is None:
        return None
    names = [name.strip() for name in joint.split(",")]
    if len(names) != 2:
        raise InputError(f"--joint {joint!r} is not possible; expected two names, e.g. --joint mu,b_alpha.")
    return names[0], names[1]


def _profiled(
    source: Path, names: list[str] | None, joint: tuple[str, str] | None, points: int, seed: int, jobs: int,
    trust: bool,
) -> _Profiled:  # fmt: skip
    """Load or fit, profile, and look at it in every other way."""
    from fracid.estimation.agreement import spread
    from fracid.estimation.block_bootstrap import bootstrap
    from fracid.estimation.cost_profile import profile as library_profile
    from fracid.estimation.covariance import uncertainty
    from fracid.estimation.parameter_verdicts import identifiability
    from fracid.runs.saved import load_run

    if source.suffix != ".toml":
        refuse_mistaken(source, "run")
    if source.is_dir():
        saved = load_run(source, trust=trust)
        problem, x = saved.problem, saved.x
    else:
        problem, x = _of_project(source, seed, jobs, trust)
    found = library_profile(problem, x, parameters=names, joint=joint, points=points, jobs=jobs)
    known = uncertainty(problem, found.x, jobs=jobs)
    drawn = known if isinstance(known, Failure) else bootstrap(problem, found.x, seed=seed, jobs=jobs)
    verdicts = identifiability(problem, found.x, known, found.profiles, jobs=jobs)
    several = len(problem.experiments) > 1 and not isinstance(known, Failure)
    record = found.to_json() | {
        "intervals": _intervals(found, known, drawn),
        "identifiability": {n: {"verdict": v.kind, "sentence": v.sentence} for n, v in verdicts.items()},
        "bootstrap": str(drawn) if isinstance(drawn, Failure) else drawn.to_json(),
        "spread": spread(problem, found.x, jobs=jobs).to_json() if several else None,
        "seed": seed,
    }
    return _Profiled(found, known, drawn, verdicts, record)


def _of_project(path: Path, seed: int, jobs: int, trust: bool) -> tuple[Problem, FloatArray]:
    from fracid.identification import identify
    from fracid.problem.project import load_project

    fit = identify(load_project(path, trust=trust), seed=seed, jobs=jobs)
    if not isfinite(fit.cost):
        raise DataError(f"{path}: {' '.join(fit.warnings[-1:])} There is nothing to profile.")
    return fit.problem, fit.x


# ------------------------------------------------------------------ from results to files and text


def _intervals(found: Profiles, known: Uncertainty | Failure, drawn: Bootstrap | Failure) -> dict[str, Any]:
    """Every unknown's intervals by every method that gave one."""
    from fracid.estimation.covariance import METHODS
    from fracid.files import json_number

    rows: dict[str, dict[str, Any]] = {n: {} for n in found.problem.names}
    for i, name in enumerate(rows):
        if not isinstance(known, Failure):
            rows[name] |= {method: known.interval(found.x, i, method) for method in ("sandwich", "white")}
            rows[name]["effective_samples"] = json_number(known.effective_samples[i])
        if not isinstance(drawn, Failure) and rows[name]["sandwich"] is not None:
            rows[name]["bootstrap"] = drawn.interval(i)
        if name in found.profiles:
            rows[name]["profile"] = found.profiles[name].interval95
    return {"methods": METHODS, "unknowns": rows}


def _write(found: _Profiled, folder: Path) -> Path:
    from fracid.files import write_text
    from fracid.plots import profiles, save
    from fracid.runs.folder import FIGURES

    text = json.dumps(found.record, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_text(folder / PROFILES, text)
    except OSError as error:
        raise InputError(f"The folder {folder} cannot be written: {error.strerror}. Give another: --out DIR.") from None
    return next(path for path in save(profiles(found.profiles), folder / FIGURES, "profiles") if path.suffix == ".png")


def _show(found: _Profiled, folder: Path, figure: Path, console: Console) -> None:
    from rich.markup import escape

    table = new_table("", "value", "95 % by profile", "sandwich", "bootstrap", "unit", "profile")
    intervals = found.record["intervals"]["unknowns"]
    for name, p in found.profiles.profiles.items():
        row = intervals[name]
        others = [_half(row.get(method)) for method in ("sandwich", "bootstrap")]
        shown = (name, f"{p.best:.6g}", _interval(p.interval95, p.best), *others, p.unit, p.verdict)
        table.add_row(*map(escape, shown))
    console.print(table)
    spread = found.record["spread"]
    few = () if isinstance(found.bootstrap, Failure) or not found.bootstrap.warning else (found.bootstrap.warning,)
    for note in (*found.profiles.notes, *few, *(spread["sentences"] if spread else ())):
        console.print(f"[yellow]![/yellow] {escape(note)}", soft_wrap=True)
    for name, verdict in found.verdicts.items():
        if verdict.sentence != "identifiable":
            console.print(f"[yellow]![/yellow] {escape(name)}: {escape(verdict.sentence)}", soft_wrap=True)
    console.print(f"result   {escape(str(folder / PROFILES))}", soft_wrap=True)
    console.print(f"figure   {escape(str(figure))}", soft_wrap=True)


def _half(ends: tuple[float, float] | None) -> str:
    return "none" if ends is None else f"± {(ends[1] - ends[0]) / 2:.2g}"


def _interval(ends: tuple[float | None, float | None], best: float) -> str:
    """Both ends, or the one that there is, in as many digits as tell them apart."""
    low, high = ends
    if low is None and high is None:
        return "none"
    width = max(abs(end - best) for end in (low, high) if end is not None)
    size = max(abs(end) for end in (low, high) if end is not None)
    digits = 2 + max(0, floor(log10(size)) - floor(log10(width))) if width > 0 and size > 0 else 6
    if low is None:
        return f"< {high:.{digits}g}"
    return f"> {low:.{digits}g}" if high is None else f"{low:.{digits}g} … {high:.{digits}g}"
