"""``fracid posterior RUN``: how probable the values of the free parameters are, and the evidence of the model."""

from __future__ import annotations

from pathlib import Path

from fracid.cli.app import How, command, typed


@command
def posterior(run: Path, how: How) -> None:
    """Draw the free parameters from their posterior.

    Shows what intervals cannot: correlations, bounds, curved valleys, and the evidence of the model.

    The likelihood is calibrated to the intervals of the fit; the priors are the bounds of the project and its normal
    priors.  Pareto's k tells whether the draws can be trusted.  Writes posterior.json, draws.npz and figures.  After an
    interruption the same command resumes.  Exit code 0 when done, trusted or not.
    """
    from fracid.workflows.posterior_draws import run_posterior

    finished = how.done(run_posterior, run)
    if finished.posterior.trusted:
        after = [(typed("profile", run, trust=how.trust), "check by profile likelihood (no prior)")]
    else:
        again = typed("posterior", run, "--method", "nested", trust=how.trust)
        after = [(again, "draws from the whole prior; minutes")] * (how.method == "laplace")
    how.tell(finished, *after, draws=finished.draws)
