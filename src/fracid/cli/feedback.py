"""``fracid control RUN``: a controller about a posture, and over which part of what is known it holds."""

from __future__ import annotations

from pathlib import Path

from fracid.cli.app import LONG, How, assigned, command, print_found, typed


@command(*LONG)
def control(
    run: Path,
    kind: str = "lqr",
    posture: str = "",
    at: list[str] | None = None,
    input_: str | None = None,
    limit: float | None = None,
    rate: float | None = None,
    delay: float | None = None,
    off: list[str] | None = None,
    within: list[str] | None = None,
    seconds: float = 10.0,
    draws: int = 200,
    posterior: bool = False,
    *,
    how: How,
) -> None:
    """Design a controller, and test it over what is uncertain.

    Regulators of several weights are simulated on the fractional model with friction, delay, encoder, noise, sampling
    and limits as identified, over draws of the free parameters.  Shows the design that holds on most draws, their
    share, and gain and phase margins with their 95 % bands.  Writes control.json and a figure.  Exit code 0 when done.
    """
    from fracid.workflows.feedback import run_control

    finished = how.done(
        run_control, run, draws=draws, posterior=posterior, kind=kind, posture=posture,
        at=assigned("--at", at, "angle=0.5"), input_=input_, limit=limit, rate=rate, delay=delay,
        off=assigned("--off", off, "alpha=0.2"), within=assigned("--within", within, "alpha=0.6"), seconds=seconds,
    )  # fmt: skip
    after = typed("export", run, "--to", "c", trust=how.trust), "the model as C"
    how.answer(finished.result, lambda at: print_found(at, finished, after, code=finished.folder / "controller.c"))
