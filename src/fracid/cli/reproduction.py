"""``fracid reproduce RUN``: the run again, and its result held against the first: the same, to the last bit?"""

from __future__ import annotations

import io
import json
import os
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import chdir, contextmanager, redirect_stdout
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fracid.cli.app import CORES, Jobs, Json, Out, Trust, app, echo_json, new_console
from fracid.cli.app import table as new_table
from fracid.cli.resume import ADDRESS, safe_words, said_command
from fracid.errors import InputError
from fracid.safety.environment import ignore_settings

if TYPE_CHECKING:
    from rich.console import Console

    from fracid.runs.reproduction import Difference, Reproduction

__all__ = ["reproduce"]

STUDIES = ("compare.json", "noise.json")
"""What a study leaves, of which its command is typed again."""

SHOWN = 12
"""Differences in the table."""

REPRODUCE_EXAMPLE = (
    "[bold]Examples[/bold]",
    "fracid reproduce runs/rig",
    "fracid reproduce runs/rig-noise --jobs 8  [dim](a study: its command is typed again)[/dim]",
    "fracid reproduce runs/rig --out runs/again  [dim](keeps the new result)[/dim]",
    "fracid reproduce runs/rig --json | jq .differences",
)


@app.command(epilog="\n\n".join(REPRODUCE_EXAMPLE))
def reproduce(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="The folder of a run, of fit, compare or noise.")],
    trust: Trust = False,
    out: Out = None,
    jobs: Jobs = CORES,
    json_: Json = False,
) -> None:
    """Do a run again with its own project, recordings, seed and options, and compare the results value by value.

    The same versions on the same machine give the same result to the last bit; other versions or another machine the
    same to 1e-9.  Says what differs, what was found first.  Nothing is written into the run's folder.  Exit code 0 if
    it came out the same, 1 if not.
    """
    from fracid.runs.folder import refuse_used
    from fracid.safety.paths import refuse_mistaken
    from fracid.tasks.folder_lock import refuse_links

    if not run.is_dir():
        refuse_mistaken(run, "run")
    refuse_links(run)
    if out is not None:
        refuse_used(out)  # before the time is spent
    began = time.perf_counter()
    study = next((name for name in STUDIES if (run / name).exists()), None)
    if study is None or (run / "result.json").exists():
        found = _fitted(run, trust, jobs, json_)
        _keep(found.result, out)
    else:
        found = _studied(run, study, trust, out, jobs)
    if json_:
        echo_json(found.to_json())
    else:
        _show(found, run, time.perf_counter() - began, new_console())
    if not found.reproduced:
        raise typer.Exit(1)


def _fitted(run: Path, trust: bool, jobs: int, json_: bool) -> Reproduction:
    from fracid.cli.progress import progress_shown
    from fracid.runs.reproduction import reproduce as library_reproduce
    from fracid.tasks.job import Progress

    began = time.perf_counter()
    with progress_shown("evaluations", events=json_) as tell:

        def callback(_best: Any, evaluations: int) -> None:
            if tell is not None:
                tell(Progress(evaluations, None, 0, time.perf_counter() - began, None))

        return library_reproduce(run, trust=trust, jobs=jobs, callback=callback)


def _keep(result: Mapping[str, Any], out: Path | None) -> None:
    from fracid.files import write_text
    from fracid.runs.folder import open_folder

    if out is not None:
        text = json.dumps(result, indent=2, ensure_ascii=False, allow_nan=False)
        write_text(open_folder(out) / "result.json", text + "\n")


# ------------------------------------------------------------------ studies


def _studied(run: Path, name: str, trust: bool, out: Path | None, jobs: int) -> Reproduction:
    """Type a study's command again, into another folder."""
    from fracid.runs.reproduction import compared

    words, where = said_command(run)
    elsewhere = any(ADDRESS in word for word in words)  # on processes here in its place, which changes no result
    again = [*safe_words(run, words, "processes", trust), *(["--executor", "processes"] * elsewhere)]
    with TemporaryDirectory() as place:
        folder = Path(place) / "run" if out is None else out.resolve()
        more = ["--out", str(folder), "--jobs", str(jobs), *(["--trust"] if trust else [])]
        with _as_typed([*again, *more], where), redirect_stdout(io.StringIO()):
            app(args=[*again, *more], prog_name="fracid", standalone_mode=False)
        return compared(_read(run / name), _read(folder / name), _changed(run, folder))


@contextmanager
def _as_typed(words: list[str], where: Path) -> Iterator[None]:
    """In the folder where it was typed, if that is still there."""
    before = sys.argv[1:]
    sys.argv[1:] = words
    ignore_settings(where)
    try:
        with chdir(where if where.is_dir() else os.curdir):
            yield
    finally:
        sys.argv[1:] = before


def _changed(run: Path, again: Path) -> dict[str, tuple[str, str]]:
    """What is not as it was, by both journals' first lines and both environments; data must be the same."""
    from fracid.runs.folder import JOURNAL

    before, after = (_header(folder / JOURNAL) for folder in (run, again))
    found = {
        what: (str(before[what]), str(after[what])) for what in after if before.get(what, after[what]) != after[what]
    }
    for what in found:
        if not what.startswith(("the version", "the code", "versions")):
            raise InputError(f"{run} cannot be done again: {what} has changed since. Put it back.")
    machines = [_read(folder / "environment.json") for folder in (run, again)]
    return found | {
        f"the {what}": (str(machines[0][what]), str(machines[1][what]))
        for what in ("platform", "processor")
        if what in machines[0] and machines[0][what] != machines[1][what]
    }


def _header(journal: Path) -> dict[str, Any]:
    from fracid.safety.schema import lines_of
    from fracid.schemas.run import StudyLine

    try:
        return dict(next(lines_of(journal, StudyLine))["study"])
    except StopIteration:
        raise InputError(f"{journal.parent} has no journal that can be read: it cannot be done again.") from None


def _read(path: Path) -> dict[str, Any]:
    from fracid.safety.schema import Block, read_as

    try:
        return dict(read_as(path, Block, "the command itself"))
    except OSError:
        raise InputError(f"{path} cannot be read: there is nothing to compare.") from None


# ------------------------------------------------------------------ as text


def _show(found: Reproduction, run: Path, seconds: float, console: Console) -> None:
    from rich.markup import escape

    console.print(f"{escape(str(run))} was done again in {seconds:.1f} s.", soft_wrap=True)
    if found.differences:
        table = new_table("differs", "before", "now", "by", fold=("differs", "before", "now"))
        for d in found.differences[:SHOWN]:
            table.add_row(*map(escape, _row(d)))
        console.print(table)
        if len(found.differences) > SHOWN:
            console.print(f"  and {len(found.differences) - SHOWN} more, which --json lists")
    mark = "" if found.reproduced else "[yellow]![/yellow] "
    console.print(f"{mark}[bold]{escape(found.verdict)}[/bold]", soft_wrap=True)


def _row(d: Difference) -> tuple[str, str, str, str]:
    return d.where, _short(d.before), _short(d.after), f"{d.size:.1g}" if d.size < float("inf") else ""


def _short(value: Any) -> str:
    text = repr(value) if isinstance(value, float) else str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
