"""``fracid compare PROJECT``: every structure on the same recordings, judged on others: do orders help?"""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from fracid.cli.app import How, command, typed
from fracid.errors import DataError
from fracid.units import half_of, number, with_half_width, with_unit

if TYPE_CHECKING:
    from fracid.selection.comparison_records import Comparison, Row, Score


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
    how.tell(finished, *[after] * (finished.best is not None), tables=_ladder(finished.comparison),
             table=finished.table, best=finished.best)  # fmt: skip
    if not any(isfinite(row.cost) for row in finished.comparison.rows):
        raise typer.Exit(DataError.exit_code)


# ------------------------------------------------------------------ from results to text


def _ladder(c: Comparison) -> dict[str, list[dict[str, str]]]:
    """Caption → a row for each structure: what it is worth, and how near it comes; of many held out ones the mean."""

    def caption(use: str, names: Sequence[str]) -> str:
        if use == "in_sample":
            return f"fitted: {', '.join(names)}"
        return f"held out: {names[0] if len(names) == 1 else f'the mean of {len(names)}'}"

    arrow = "; ← the paper's" * any(row.paper for row in c.rows)
    worth = f"structures: BIC above the lowest, of {c.effective_samples:.0f} effective samples{arrow}"
    return {worth: [_worth(c, row) for row in c.rows]} | {
        f"{caption(use, names)}: RMSE and fit": [
            _structure(row) | _errors(c, [s for n, s in getattr(row, use).items() if n in names]) for row in c.rows
        ] for use, names in c.columns
    }  # fmt: skip


def _structure(row: Row) -> dict[str, str]:
    """What its rung adds, and its orders."""
    terms = row.friction.split(" + ")
    orders = ("free ←" if row.paper else "free") if row.fractional else "1"
    return {"": ("+ " if len(terms) > 1 else "") + terms[-1], "orders": orders}


def _worth(c: Comparison, row: Row) -> dict[str, str]:
    own = {n: with_half_width(o.value, half_of(o.interval95)) * row.fractional for n, o in row.orders.items()}
    orders = {n: own.get(n, "") for other in c.rows for n in other.orders}  # an alternative has its own, or none
    odds = {"log odds": number(row.log_odds, "+.1f")} if any(isfinite(r.log_odds) for r in c.rows) else {}
    return _structure(row) | orders | {"free values": f"{row.parameters}", "BIC": number(row.bic, "+.4g")} | odds


def _errors(c: Comparison, scores: Sequence[Score]) -> dict[str, str]:
    """RMSE and fit of each output: the mean over recordings."""
    if not scores or any(s.failed for s in scores):
        return dict.fromkeys(c.outputs, "fails")

    def mean(kind: str, output: str) -> float:
        return float(sum(getattr(s, kind)[output] for s in scores) / len(scores))

    return {n: with_unit(mean("rmse", n), c.units.get(n, "rad")) + f" {fit:.1f} %" * isfinite(fit)
            for n in c.outputs for fit in [mean("fit_percent", n)]}  # fmt: skip
