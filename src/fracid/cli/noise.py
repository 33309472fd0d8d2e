"""``fracid noise RUN|PROJECT``: identify the fitted model's own recordings again: what are its intervals worth?"""

from __future__ import annotations

from functools import partial
from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING

from fracid.cli.app import LONG, How, command, numbers, print_study, say, typed
from fracid.cli.app import table as new_table
from fracid.errors import InputError
from fracid.units import with_unit

if TYPE_CHECKING:
    from rich.console import Console

    from fracid.validation.study_records import Statistics
    from fracid.workflows.monte_carlo import FinishedNoiseStudy

HEADINGS = ("", "truth", "bias", "spread", "claimed", "coverage")


@command("executor", "scheduler", *LONG)
def noise(
    source: Path,
    levels: str | None = None,
    counts: str | None = None,
    seeds: int = 50,
    cost: str | None = None,
    optimiser: str | None = None,
    *,
    how: How,
) -> None:
    """Refit simulated noisy data many times: bias, spread, coverage.

    Takes the fitted values as the true ones.  Each repetition simulates every recording with them (with a quarter of
    the fit's step), adds noise, quantises as the encoder does, and repeats the fit from the project's start.  Shows
    bias, spread and the coverage of the 95 % intervals for each free parameter.  Writes noise.json, noise.csv and a
    figure.  After an interruption the same command resumes.  Exit code 0 when done, 3 if no run of the model reaches
    the end of the recording.
    """
    sizes = None if levels is None else numbers("--levels", levels, "0.05,0.1,0.2", least=0.0)
    turns = None if counts is None else numbers("--counts", counts, "4096,20000", least=0.0)
    if few := [c for c in turns or () if 0 < c < 3]:
        raise InputError(
            f"--counts {few[0]:g} is not possible; expected counts a turn, e.g. 4096, or 0 for no rounding."
        )
    from fracid.workflows.monte_carlo import run_noise_study

    finished = how.done(run_noise_study, source, levels=sizes, resolutions=turns, angles=True, seeds=seeds, cost=cost,
                        optimiser=optimiser)  # fmt: skip
    verb, what = ("profile", "profile likelihood") if source.is_dir() else ("fit", "the fit")
    after = typed(verb, source, trust=how.trust), f"{what} of the measured data"
    how.answer(finished.result, partial(_show, finished, after))


# ------------------------------------------------------------------ from results to text


def _show(finished: FinishedNoiseStudy, after: tuple[str, str], console: Console) -> None:
    from rich.markup import escape

    from fracid.findings import with_code

    study = finished.study
    units = {o: e.units.get(o, "rad") for e in study.problem.experiments for o in study.problem.outputs}
    residuals = ", ".join(f"{with_unit(size, units[o])} of {o}" for o, size in (study.sizes or {}).items())
    noise = f"noise in multiples of the residual's RMS, {residuals}" if residuals else "angles in degrees"
    say(
        console,
        f"{study.seeds} repetitions a cell; {study.optimiser}, {study.problem.cost_function.name}, "
        f"{study.problem.method}; {noise}. Coverage is the share of 95 % intervals that contain the true value.",
    )
    for cell in study.cells:
        console.print(f"[bold]{escape(cell.label)}[/bold]")
        table = new_table(*HEADINGS, fold=("",))
        table.columns[0].min_width = max(len(word) for name in cell.unknowns for word in name.split())
        for name, s in cell.unknowns.items():
            table.add_row(*map(escape, _row(name, s)))
        console.print(table)
    for sentence in study.sentences():
        mark = "" if with_code([sentence], "believed") else "[yellow]![/yellow] "
        say(console, escape(sentence), mark)
    print_study(console, finished, after, table=finished.table)


def _row(name: str, s: Statistics) -> tuple[str, ...]:
    """An unknown's line: truth, bias, spread, claimed, coverage."""
    factor = degrees(1.0) if s.unit in ("rad", "rad/s") else 1.0

    def cell(value: float | None, form: str) -> str:
        return "–" if value is None else f"{factor * value:{form}}"

    coverage = "–"
    if s.coverage95 is not None and s.coverage is not None:
        low, high = s.coverage95
        coverage = f"{100 * s.coverage:.0f} % ({100 * low:.0f}–{100 * high:.0f})"
    return (name, cell(s.truth, ".4g"), cell(s.bias, "+.1e"), cell(s.spread, ".1e"), cell(s.claimed, ".1e"), coverage)
