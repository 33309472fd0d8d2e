"""``fracid resid RUN``: tests of the residuals, and what they show about the model."""

from __future__ import annotations

from functools import partial
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

from fracid.cli.app import How, command, print_study, print_table, say, typed, warn
from fracid.errors import DataError
from fracid.units import with_unit

if TYPE_CHECKING:
    from rich.console import Console

    from fracid.validation.residual_records import ResidualAnalysis
    from fracid.workflows.residuals import FinishedResiduals


@command
def resid(run: Path, how: How) -> None:
    """Test the residuals of a fit: white noise, or structure missing?

    Simulates each recording with the fitted values, validation recordings too.  Tests whether the residual is white
    (and at which frequencies it is not), normal and of constant variance, and compares its size with the encoder's
    step.  Writes residuals.json and a page of figures for each.  Exit code 0 when done, 3 if no run of the model
    reaches the end of a recording.
    """
    from fracid.workflows.residuals import run_residuals

    finished = how.done(run_residuals, run)
    how.answer(finished.result, partial(_show, finished))
    if not any(isfinite(a.level.rms) for a in finished.all):
        names = " or ".join(finished.analyses)
        raise DataError(f"No run of the model reached the end of {names}: there is no residual.")


# ------------------------------------------------------------------ as text


def _show(analysis: FinishedResiduals, console: Console) -> None:
    from rich.markup import escape

    from fracid.fit import PARTIAL
    from fracid.optimise.base import Outcome

    headings = ("recording", "output", "rms", "steps", "correlated", "count", "PPCC")
    print_table(console, headings, map(_sizes, analysis.all), fold=("recording",))
    partial = [PARTIAL] if analysis.run.outcome is Outcome.INTERRUPTED else []
    warn(console, *partial, *analysis.run.notes)
    for a in analysis.all:
        aside = "; ".join(["held out"] * (a.use == "validate") + [a.tested] * bool(a.missing))
        heading = f"\n[bold]{escape(a.recording)}, {escape(a.output)}[/bold]{f' ({aside})' if aside else ''}"
        console.print(heading, soft_wrap=True)
        for effect, sentence in a.sentences.items():
            say(console, escape(sentence), f"  [dim]{effect:10}[/dim]  ")
    console.print()

    project, trust = analysis.run.project, bool(analysis.run.project.own_code)
    step = typed("profile", analysis.run.folder, trust=trust), "which values do the data exclude?"
    if project.problem.model.friction:
        step = typed("compare", project.path, trust=trust), "would another model leave smaller residuals?"
    print_study(console, analysis, step)


def _sizes(a: ResidualAnalysis) -> tuple[str, ...]:
    """Of an effect each, in a row of the table."""
    steps, w = a.level.steps, a.whiteness
    return (
        a.recording, a.output, with_unit(a.level.rms, a.unit) if isfinite(a.level.rms) else "–",
        _number(steps, ".2f" if steps < 10 else ",.0f"), _number(w.correlation_time, ".2g", " s"),
        f"{_number(w.effective_samples, ',.0f')} of {a.samples:,}", _number(a.normality.ppcc, ".3f"),
    )  # fmt: skip


def _number(value: float, digits: str, unit: str = "") -> str:
    return f"{value:{digits}}{unit}" if isfinite(value) else "–"
