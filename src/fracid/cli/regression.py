"""``fracid regress PROJECT|RECORDING``: constants straight from recordings, by linear regression."""

from __future__ import annotations

from functools import partial
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from fracid.cli.app import How, assigned, command, print_table, say_next, typed, warn
from fracid.cli.check import columns_from_texts, start_from_text, time_from_text
from fracid.errors import DataError, InputError
from fracid.tasks.display import shown
from fracid.units import half_of, interval_beside, to_second_digit

if TYPE_CHECKING:
    from rich.console import Console

    from fracid.regression import Regression
    from fracid.workflows.regression import FinishedRegression


@command
def regress(source: Path, how: How) -> None:
    """Estimate a model's constants by robust linear regression.

    The equations are linear in most constants for given orders; the rotary pendulum's orders are searched.  What is
    not linear is named and held.  The estimates are starting values for a fit.  Uses all recordings of a project that
    have use = "fit" together.  Writes regression.json if --out is given.  Exit code 0 if a constant is identified, 3
    if none is.
    """
    of_recording = ("column", "time", "rate", "variable", "rig", "zero")
    if source.suffix == ".toml" and (options_used := [n for n in of_recording if vars(how)[n] is not None]):
        raise InputError(f"--{options_used[0]} is for a recording; the project file says it of each of its own.")
    with shown("regression"):
        from fracid.workflows.regression import run_regression  # here: it takes a second to import

        finished = run_regression(
            source, columns=columns_from_texts(how.column), time=time_from_text(how.time, how.rate),
            variable=how.variable, rig=how.rig, zero=how.zero,
            **how.taken(run_regression, known=assigned("--known", how.known, "C4=0.1944"), terms=how.terms or (),
                        orders=assigned("--order", how.order, "mu=1.0"), start=start_from_text(how.start)),
        )  # fmt: skip
    if source.suffix == ".toml":
        after = typed("fit", source, trust=how.trust), "by simulation, from this start"
    else:
        after = typed("init", source), "a project of it, to be fitted by simulation"
    how.answer(finished.result, partial(_show, finished, how.out, after))
    if not any(c.identified for f in finished.regressions.values() for c in f.parameters.values()):
        raise typer.Exit(DataError.exit_code)


def _show(results: FinishedRegression, out: Path | None, after: tuple[str, str], console: Console) -> None:
    from rich.markup import escape

    for name, f in results.regressions.items():
        console.print(f"[bold]{escape(name)}[/bold]: {f.estimator}, {f.samples} rows", soft_wrap=True)
        _print_constants(console, f)
        changes = [f"{n} = {new:.4g} (from {old:.4g})" for n, (old, new) in results.starts(f).items()]
        start = ", ".join(changes) or "the project's own: nothing that it frees was identified"
        for heading, text in [*f.lines, *([] if results.problem is None else [("start", start)])]:
            console.print(f"  {heading:9} {escape(text)}", soft_wrap=True)
        warn(console, *filter(None, (f.belief, *f.warnings)))
    for note in results.notes:
        console.print(f"  • {escape(note)}", soft_wrap=True)
    if out is not None:
        console.print(f"result   {escape(str(out / 'regression.json'))}", soft_wrap=True)
    say_next(console, after)


def _print_constants(console: Console, f: Regression) -> None:
    rows = []
    for name, c in f.parameters.items():
        half = half_of(c.interval95)
        value, interval = f"{c.value:.4g}", ""
        if c.interval95 is not None and 0 < half < inf:
            value, interval = to_second_digit(c.value, half), interval_beside(c.value, *c.interval95)
        rows.append((name, value, interval, "" if c.bias is None else f"{c.bias:+.1g}", c.unit, c.kind))
    print_table(console, ("", "value", "95 % interval", "bias", "unit", ""), rows, fold=())
    doubted = [(n, c.verdict) for n, c in f.parameters.items() if c.kind not in ("identified", "known")]
    for verdict in dict.fromkeys(verdict for _, verdict in doubted):
        warn(console, f"{', '.join(n for n, text in doubted if text == verdict)}: {verdict}")
