"""``index.html`` over all runs and studies of a folder, a table to sort and filter, and links between the runs' pages.

An index is made by ``fracid report RUNS`` and by the demo, and nobody's folder gets one unasked; where there is one,
each new report beside it renews it.  Pages are linked by what stands between two comments, the one part of a page that
is written again.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from math import exp, log
from operator import itemgetter
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from markupsafe import Markup

from fracid.arrays import FloatArray
from fracid.errors import InputError, writing
from fracid.optimise.base import Outcome
from fracid.problem.costs import COSTS
from fracid.report.charts import Chart, Series, still
from fracid.report.drawing import filled
from fracid.report.frame import rendered
from fracid.report.samples import floats_of
from fracid.report.sentences import in_unit, joined
from fracid.report.study import read_study, studies_of, write_study
from fracid.report.whiskers import order_axis, orders_drawn
from fracid.runs.saved import SavedRun
from fracid.safety.door import opened, text_if_any, text_of, write_whole
from fracid.safety.json_files import json_of
from fracid.safety.schema import read_if_whole
from fracid.safety.text import printable
from fracid.schemas.run_record import EnvironmentBlock
from fracid.selection.doubts import doubts
from fracid.units import letter, number, shown_unit

INDEX, REPORT = "index.html", "report.html"

GENERATOR = '<meta name="generator" content="fracid index">'
"""By which an index of fracid's is known: no other is written over."""

RUNS_BEGIN, RUNS_END = Markup("<!-- other runs -->"), Markup("<!-- end of other runs -->")
"""Between them a page has its links to other runs."""

HEAD = 200_000
"""Characters of a page in which they are looked for."""

SAMPLES = '<script type="application/json" id="samples">'
"""Before a page's numbers."""

SWINGS_WIDTH = 420
"""Of the drawing of a run's first swings [px]."""

PRESETS = {"paper": "the paper's recipe"}

MONTHS = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")
"""In English, whatever the machine speaks."""


@dataclass(frozen=True)
class Identity:
    """By what a reader tells one run from another."""

    name: str
    """Of its folder."""
    facts: tuple[str, ...]
    """Recipe, date, duration, seed."""
    partial: str
    """Why the result is not finished, in a sentence; empty where it is."""


def identity(folder: Path, result: Mapping[str, Any], environment: Mapping[str, Any]) -> Identity:
    """Name, recipe, date, duration and seed of a run.

    Examples
    --------
    >>> result = {"optimiser": "genetic", "method": "gl-paper", "cost": {"name": "itae"}, "preset": "paper", "seed": 1,
    ...           "recordings": {"swing": {"from": 0.0, "to": 20.0, "use": "fit"}}, "outcome": "all generations done"}
    >>> identity(Path("runs/first"), result, {"started": "2026-11-22T13:16:05+00:00"}).facts
    ("the paper's recipe (genetic, gl-paper, ITAE)", '22 Nov 2026 13:16', '20 s', 'seed 1')
    """
    cost = result["cost"]["name"]
    how = ", ".join((result["optimiser"], result["method"], cost.upper() if cost in COSTS else cost))
    preset = result.get("preset")
    recipe = f"{PRESETS.get(preset, preset)} ({how})" if preset else how
    lengths = [f"{number(r['to'] - r['from'], '.3g')} s" for r in result["recordings"].values()]
    facts = (recipe, _date(environment.get("started", "")), of_recordings(lengths), f"seed {result['seed']}")
    outcome = result["outcome"]
    cut = outcome in (Outcome.INTERRUPTED, Outcome.STOPPED)
    partial = f"the search was {outcome}; fracid resume continues it." if cut else ""
    return Identity(folder.resolve().name, tuple(filter(None, facts)), partial)


def of_recordings(words: list[str]) -> str:
    """A word of each recording; of many how many there are."""
    return joined(words) if len(words) <= 3 else f"{len(words)} recordings"


def _date(started: str) -> str:
    with suppress(ValueError):  # a run of an earlier version, or a file that was edited
        at = datetime.fromisoformat(started)
        return f"{at.day} {MONTHS[at.month - 1]} {at:%Y %H:%M}"
    return ""


_begun = itemgetter("started", "name")

# --- the runs of a folder ------------------------------------------------------------------------


def runs_of(folder: Path) -> list[dict[str, Any]]:
    """The cards of the runs in a folder's folders, in the order in which they were begun; damaged ones are left out."""
    runs = []
    for path in sorted(folder.glob("*/result.json")):
        # What is written into a link would lie elsewhere.
        if path.parent.is_symlink() or not (result := read_if_whole(path, SavedRun)):
            continue
        environment = read_if_whole(path.parent / "environment.json", EnvironmentBlock)
        who, started = identity(path.parent, result, environment), environment.get("started", "")
        runs.append({**vars(who), "kind": "fit", "page": path.parent / REPORT, "started": started, "result": result})
    return sorted(runs, key=_begun)


def studies_in(folder: Path) -> Iterator[dict[str, Any]]:
    """The cards of the studies in a folder's folders, and in those of its runs; damaged ones are left out."""
    for place in sorted(p for pattern in ("*/", "*/*/") for p in folder.glob(pattern)):
        if place.is_symlink() or place.parent.is_symlink():
            continue
        for file in studies_of(place):
            with suppress(OSError, InputError):
                study, found, started = read_study(place, file)
                yield {
                    **vars(found), "kind": study.command, "heading": study.heading, "started": started,
                    "name": place.relative_to(folder).as_posix(), "date": _date(started), "error": None,
                    "href": _address((place / file).with_suffix(".html"), folder), "partial": "", "swings": "",
                }  # fmt: skip


def refresh_index(folder: Path) -> None:
    """Write the index again where there is one; a folder that cannot be written stays as it is."""
    if _is_ours(folder / INDEX):
        with suppress(InputError):  # the run's own page is written, and that was asked for
            write_index(folder)


def write_study_page(folder: Path, file: str) -> Path:
    """Write the page of a study (:mod:`fracid.report.study`), and renew the indices above it."""
    page = write_study(folder, file)
    for above in folder.resolve().parents[:2]:
        refresh_index(above)
    return page


def _is_ours(index: Path) -> bool:
    """Whether fracid wrote it; False too of one that is not there or cannot be read."""
    with suppress(OSError), opened(index) as file:
        return GENERATOR.encode() in file.read(HEAD)
    return False


def write_index(folder: str | Path) -> Path:
    """Write ``index.html`` over all runs of a folder, and link their pages with each other.

    Parameters
    ----------
    folder : str or Path
        With the runs' folders in it, as ``runs``.

    Returns
    -------
    Path
        Of the file.

    Raises
    ------
    InputError
        If there is no run in it, or the file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> write_index(tempfile.mkdtemp())
    Traceback (most recent call last):
    fracid.errors.InputError: ... holds no folder of a run. Give a run's folder, or one with runs in it.
    """
    folder = Path(folder)
    runs, studies = runs_of(folder), list(studies_in(folder))
    if not (runs or studies):
        raise InputError(f"{folder} holds no folder of a run. Give a run's folder, or one with runs in it.")
    path = folder / INDEX
    if os.path.lexists(path) and not _is_ours(path):
        raise InputError(f"{path} is not an index that fracid wrote; move it away first.")
    with writing(f"The index {path}", "Give another folder."):
        write_whole(path, _index_page(folder, runs, studies))
        for k, run in enumerate(runs):
            _link(run["page"], runs[k - 1] if k else None, runs[k + 1] if k + 1 < len(runs) else None)
    return path


def _link(page: Path, before: Mapping[str, Any] | None, after: Mapping[str, Any] | None) -> None:
    """Put the links to its neighbours into a page; an old page, one that is elsewhere, or none, stays as it is."""
    text = "" if page.is_symlink() else text_if_any(page) or ""
    begin, end = text.find(RUNS_BEGIN, 0, HEAD), text.find(RUNS_END, 0, HEAD)
    if begin < 0 or end < begin:
        return
    around = {where: run and (run["name"], _address(run["page"], page.parents[1]))
              for where, run in (("before", before), ("after", after))}  # fmt: skip
    linked = text[: begin + len(RUNS_BEGIN)] + filled("neighbours.html.j2", index=INDEX, **around) + text[end:]
    if linked != text:
        write_whole(page, linked)


def _address(page: Path, folder: Path) -> str:
    """Of a page from the index, where it is there; a folder's name may be bytes that are no text."""
    return quote(os.fsencode(page.relative_to(folder).as_posix())) if page.exists() else ""


# --- the page ------------------------------------------------------------------------------------


def _index_page(folder: Path, runs: list[dict[str, Any]], studies: list[dict[str, Any]]) -> str:
    axis = order_axis([e for run in runs for e in run["result"]["orders"].values()])
    cards = [
        {
            **run, "date": _date(run["started"]), "claim": claim, "model": result["model"]["name"],
            "orders": orders_drawn(result["orders"], axis), "href": _address(run["page"], folder),
            "against": list(against.values()), "good": claim != "undecided" and not against and not run["partial"],
            **_errors(result["recordings"]), "swings": _swings(run["page"]),
        }
        for run in runs for result in [run["result"]] for against, claim in [(doubts(result), result["claim"])]
    ]  # fmt: skip
    cards = sorted(cards + studies, key=_begun)
    kinds = (runs, ("run", "runs")), (studies, ("study", "studies"))
    counts = [f"{len(own)} {words[len(own) > 1]}" for own, words in kinds if own]
    title = f"{' and '.join(counts)} in {folder.resolve().name}"
    return rendered("index.html.j2", ("theme.js", "index.js"), title=title, runs=cards, generator=Markup(GENERATOR))


def _errors(recordings: Mapping[str, Any]) -> dict[str, Any]:
    """The mean RMSE of each output on held-out recordings, or on fitted ones, and their geometric mean to sort by."""
    held_out = [r["rmse"] for r in recordings.values() if r["use"] != "fit"]
    every = held_out or [r["rmse"] for r in recordings.values()]
    if not every or any(v is None for rmse in every for v in rmse.values()):
        return {"rmse": "failed", "error": None}
    means = {n: sum(rmse[n] for rmse in every) / len(every) for n in every[0]}
    units = {n: unit for r in recordings.values() for n, unit in r["units"].items()}
    shown = {n: shown_unit(units.get(n, "rad" if n in ("theta", "alpha") else "")) for n in means}
    said = ", ".join(f"{letter(n)} {in_unit(v, shown[n])}" for n, v in means.items())
    error = exp(sum(log(max(shown[n][1] * v, 1e-300)) for n, v in means.items()) / len(means))
    return {"rmse": said + " held out" * bool(held_out), "error": error}


def _swings(page: Path) -> Markup:
    """The first swings of a page's first recording, measured and simulated; nothing of a page that cannot be read."""
    with suppress(OSError, ValueError, LookupError, TypeError, ArithmeticError):
        text = text_of(page)
        begin = text.index(SAMPLES) + len(SAMPLES)
        recording = json_of(text[begin : text.index("</script>", begin)])["recordings"][0]
        output = recording["outputs"][-1]
        t, measured, simulated = map(floats_of, (recording["t"], output["measured"], output["fitted"]))
        if not 1 < t.size == measured.size == simulated.size:
            return Markup("")
        end = _end_of_swings(simulated)
        symbol, unit = (printable(output[name]) for name in ("letter", "unit"))
        lines = Series("measured", measured[:end], "measured"), Series("simulated", simulated[:end], "fitted")
        name = f"{printable(recording['name'])}, first swings"
        label = f"{symbol} [{unit}]" if unit else symbol
        return still(Chart(name, t[:end], "time [s]", label, series=lines, xname="time"), SWINGS_WIDTH)
    return Markup("")


def _end_of_swings(y: FloatArray) -> int:
    """How many samples the first six swings have, by sign changes, as in ``page.js``; without any, a tenth of all."""
    crossings = np.flatnonzero(np.diff(y > y.mean()))
    return int(crossings[:12][-1]) + 2 if crossings.size else -(-y.size // 10)
