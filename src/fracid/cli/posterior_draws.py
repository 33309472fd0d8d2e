"""``fracid posterior RUN``: how probable the values of the free parameters are, and the evidence of the model."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fracid.cli.app import LONG, How, command, print_study, print_table, say, typed, warn
from fracid.errors import SMALLEST
from fracid.units import half_of, to_second_digit

if TYPE_CHECKING:
    from rich.console import Console

    from fracid.workflows.posterior_draws import FinishedPosterior


@command("executor", "scheduler", *LONG)
def posterior(
    run: Path,
    method: str = "laplace",
    draws: int = 2000,
    *,
    how: How,
) -> None:
    """Draw the free parameters from their posterior.

    Shows what intervals cannot: correlations, bounds, curved valleys, and the evidence of the model.

    The likelihood is calibrated to the intervals of the fit; the priors are the bounds of the project and its normal
    priors.  Pareto's k tells whether the draws can be trusted.  Writes posterior.json, draws.npz and figures.  After an
    interruption the same command resumes.  Exit code 0 when done, trusted or not.
    """
    from fracid.workflows.posterior_draws import run_posterior

    finished = how.done(run_posterior, run, method=method, draws=draws)
    if finished.posterior.trusted:
        after = [(typed("profile", run, trust=how.trust), "check by profile likelihood (no prior)")]
    else:
        again = typed("posterior", run, "--method", "nested", trust=how.trust)
        after = [(again, "draws from the whole prior; minutes")] * (method == "laplace")
    how.answer(finished.result, partial(_show, finished, after))


# ------------------------------------------------------------------ from results to text


def _show(finished: FinishedPosterior, after: list[tuple[str, str]], console: Console) -> None:
    from rich.markup import escape

    drawn, unknowns = finished.posterior, finished.result["unknowns"]
    rows = []
    for name, row in unknowns.items():
        half = max(half_of(row["interval95"]), SMALLEST)
        median, low, high = (to_second_digit(v, half) for v in (row["median"], *row["interval95"]))
        rows.append((name, median, f"{low} … {high}", row["unit"], _prior(row["prior"])))
    if not print_table(console, ("", "median", "95 % interval", "unit", "prior"), rows, fold=("",), spare=1):
        priors = (f"{n} {_prior(row['prior'])}" for n, row in unknowns.items() if row["prior"]["kind"] == "normal")
        say(console, escape(f"Priors: {'; '.join(('the bounds of the project', *priors))}."), "")
    mark = "" if drawn.trusted else "[yellow]![/yellow] "
    console.print(f"{mark}{escape(drawn.sentence)}", soft_wrap=True)
    if (evidence := finished.result["log_evidence"]) is not None:
        error = finished.result["evidence_error"]
        console.print(f"log evidence {evidence:.2f} ± {error:.2g} nats, relative to the greatest likelihood.")
    warn(console, *drawn.notes)
    print_study(console, finished, *after, draws=finished.draws)


def _prior(prior: dict[str, Any]) -> str:
    low, high = (("−∞", "∞")[i] if v is None else f"{v:.3g}" for i, v in enumerate((prior["lower"], prior["upper"])))
    if prior["kind"] == "normal":
        return f"{prior['mean']:.3g} ± {prior['sd']:.2g}, {low} … {high}"
    return f"{low} … {high}"
