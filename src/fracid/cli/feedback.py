"""``fracid control RUN``: a controller about a posture, and over which part of what is known it holds."""

from __future__ import annotations

from pathlib import Path

from fracid.cli.app import How, assigned, command, typed


@command
def control(run: Path, how: How) -> None:
    """Design a controller, and test it over what is uncertain.

    Regulators of several weights are simulated on the fractional model with friction, delay, encoder, noise, sampling
    and limits as identified, over draws of the free parameters.  Shows the design that holds on most draws, their
    share, and gain and phase margins with their 95 % bands.  Writes control.json and a figure.  Exit code 0 when done.
    """
    from fracid.feedback.study import conditions_of
    from fracid.workflows.feedback import run_control

    at, off = assigned("--at", how.at, "angle=0.5"), assigned("--off", how.off, "alpha=0.2")
    loop = how.taken(conditions_of, at=at, off=off, within=assigned("--within", how.within, "alpha=0.6"))
    finished = how.done(run_control, run, kind=how.kind, **loop)
    after = typed("export", run, "--to", "c", trust=how.trust), "the model as C"
    how.tell(finished, after, code=finished.folder / "controller.c")
