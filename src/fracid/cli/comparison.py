"""``fracid compare PROJECT``: every structure on the same recordings, judged on others: do orders help?"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from fracid.cli.app import (
    How,
    command,
    print_claim,
    print_study,
    print_table,
    say,
    typed,
    warn,
)
from fracid.errors import DataError
from fracid.units import half_of, shown_unit, with_half_width, with_unit
from fracid.words import Sentences

if TYPE_CHECKING:
    from rich.console import Console

    from fracid.selection.comparison_records import Comparison, Row, Score
    from fracid.workflows.comparison import FinishedComparison

SAYS = Sentences("cli/says.toml")

MOST = 3
"""Held-out recordings with a table each; of more the mean is shown."""


@command
def compare(project: Path, how: How) -> None:
    """Compare friction structures, with orders 1 and with orders free.

    Fits friction models of growing complexity, from viscous to drag, cable and presliding, and the project's own
    structure, in the same way to the recordings with use = "fit"; a model without friction as it is, beside
    the alternatives that the project names.  Judges each by its prediction of those with use = "validate", where only
    the initial state and the parameters of that recording alone are refitted.  Writes compare.json, compare.csv and
    figures.  After an interruption the same command resumes.  Exit code 0 when done, 3 if no run of any structure
    reaches the end of the recordings.
    """
    from fracid.workflows.comparison import run_comparison

    finished = how.done(run_comparison, project, keep=how.keep or (), rungs=how.rungs or ())
    after = typed("fit", finished.best, trust=how.trust), "the best structure: residuals, intervals, report"
    how.answer(finished.result, partial(_show, finished, [after] * (finished.best is not None)))
    if not any(isfinite(row.cost) for row in finished.comparison.rows):
        raise typer.Exit(DataError.exit_code)


# ------------------------------------------------------------------ from results to text


def _show(finished: FinishedComparison, after: list[tuple[str, str]], console: Console) -> None:
    from rich.markup import escape

    comparison = finished.comparison

    print_claim(console, comparison.claim, comparison.claim_reasons, comparison.doubts)
    fitted = [*comparison.rows[0].in_sample]
    console.print(f"[bold]fitted[/bold]: {escape(', '.join(fitted))}", soft_wrap=True)
    _print_structures(console, comparison)
    held_out = [*comparison.held_out]
    groups = {f"the mean of {len(held_out)}": held_out} if len(held_out) > MOST else {n: [n] for n in held_out}
    for title, names in groups.items():
        console.print(f"[bold]held out[/bold]: {escape(title)}", soft_wrap=True)
        _print_scores(console, comparison, names, "held_out")
    warn(console, *comparison.notes, mark="  • ")
    for name, test in comparison.amplitude.items():
        console.print(f"[bold]amplitude[/bold]: {escape(name)}", soft_wrap=True)
        warn(console, *test.sentences, mark="  ")
    if comparison.verdict not in comparison.claim_reasons:  # those stand above the tables
        say(console, f"[bold]{escape(comparison.verdict)}[/bold]")
    print_study(console, finished, *after, table=finished.table, best=finished.best)


def _print_structures(console: Console, comparison: Comparison) -> None:
    """In sample: the orders, how many parameters, what they are worth, and how near the fit comes; below, if narrow."""
    orders, scores = [*comparison.rows[0].orders], _columns(comparison)
    odds = ["log odds"] * any(isfinite(row.log_odds) for row in comparison.rows)
    rows = []
    for row in comparison.rows:
        values = [
            with_half_width(o.value, half_of(o.interval95)) if row.fractional else "" for o in row.orders.values()
        ]
        cells = [*_structure(row), *values, str(row.parameters), f"{row.bic:+.4g}" if isfinite(row.bic) else "–"]
        cells += [f"{row.log_odds:+.1f}" if isfinite(row.log_odds) else "–"] * len(odds)
        near = _scores(comparison, [*row.in_sample.values()])
        rows.append([*cells, *near, *[""] * (len(scores) - len(near))])
    headings = ["", "orders", *orders, "free", "BIC", *odds, *scores]
    if not print_table(console, headings, rows, fold=(), spare=len(scores)):
        _print_scores(console, comparison, [*comparison.rows[0].in_sample], "in_sample")
    unit = _one_unit(comparison)
    itae = "" if unit is None else f"ITAE in {f'{shown_unit(unit)[0]} s²'.strip()}; "
    said = SAYS("scores", kind="angles" if unit == "rad" else "outputs", itae=itae, odds=SAYS("odds") if odds else "",
                samples=comparison.effective_samples)  # fmt: skip
    say(console, f"[dim]{said}[/dim]", "  ")


def _print_scores(console: Console, comparison: Comparison, names: Sequence[str], where: str) -> None:
    scores = ([getattr(row, where)[n] for n in names if n in getattr(row, where)] for row in comparison.rows)
    print_table(console, ["", "orders", *_columns(comparison)], (
        [*_structure(row), *_scores(comparison, own)] for row, own in zip(comparison.rows, scores, strict=True)
    ))  # fmt: skip


def _structure(row: Row) -> tuple[str, str]:
    """What its rung adds, and its orders."""
    terms = row.friction.split(" + ")
    return ("+ " if len(terms) > 1 else "") + terms[-1], ("free ←" if row.paper else "free") if row.fractional else "1"


def _scores(comparison: Comparison, scores: Sequence[Score]) -> list[str]:
    """RMSE and fit of each output, and the ITAE of all where they have one unit: the mean over recordings."""
    if not scores or any(s.failed for s in scores):
        return ["fails"]
    mean = {
        kind: {n: sum(getattr(s, kind)[n] for s in scores) / len(scores) for n in comparison.outputs}
        for kind in ("rmse", "fit_percent", "itae")
    }
    near = [f"{with_unit(mean['rmse'][n], comparison.units.get(n, 'rad'))} {_percent(mean['fit_percent'][n])}"
            for n in comparison.outputs]  # fmt: skip
    unit = _one_unit(comparison)
    return near if unit is None else [*near, f"{shown_unit(unit)[1] * sum(mean['itae'].values()):.4g}"]


def _columns(comparison: Comparison) -> list[str]:
    return [*comparison.outputs, *["ITAE"] * (_one_unit(comparison) is not None)]


def _one_unit(comparison: Comparison) -> str | None:
    """That of all outputs; None where they differ, and no sum of theirs means anything."""
    units = {comparison.units.get(n, "rad") for n in comparison.outputs}
    return units.pop() if len(units) == 1 else None


def _percent(fit: float) -> str:
    return f"{fit:.1f} %" if isfinite(fit) else ""
