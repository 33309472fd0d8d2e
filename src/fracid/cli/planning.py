"""``fracid design RUN|PROJECT|RIG``: which experiments next, and their expected intervals."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fracid.cli.app import SAYS, How, assigned, command, numbers, typed
from fracid.errors import InputError

SWING = (5.0, 150.0)
"""Angles from which a pendulum is released if none are given [°]."""


@command
def design(source: str, how: How) -> None:
    """Choose the next experiments, and predict their intervals.

    Computes the information of each candidate experiment with the noise of the run, adds it to that of the recordings
    so far, and finds the best set by exchange.  Excludes candidates that exceed a limit.  Writes project files to
    complete with the new recordings, voltages, expected curves with a band, plan.json and figures.  Exit code 0 when
    done.
    """
    orders, limits = assigned("--order", how.order, "mu=0.95"), assigned("--limit", how.limit, "theta=2.5")
    constants = assigned("--set", how.set_, "mass=0.2,0.5,1", lambda text, _: numbers("--set", text, "mass=0.2,0.5,1"))
    angles = (0.0,) if how.release is None else numbers("--release", how.release)
    durations, rates = numbers("--seconds", how.seconds or "20"), numbers("--rate", how.rate or "500")
    said = {"seconds": how.seconds, "rate": how.rate, "voltage": how.voltage or how.release}
    from fracid.experiments import choice
    from fracid.experiments.space import DesignSpace
    from fracid.workflows.planning import run_design

    space = DesignSpace(
        release=angles, arm=_names(how.arm), seconds=durations, rate=rates, counts=how.counts,
        sensors=_names(how.sensors), voltage=tuple(map(_voltage, how.voltage or ())) or None,
        voltage_step=how.voltage_step, limits=limits, constants=constants,
    )  # fmt: skip
    finished = how.done(
        run_design, source, space, swing=SWING if how.release is None else (),
        unsaid=[name for name, value in said.items() if not value],
        **how.taken(choice.design, of=_names(how.of), orders=orders or None),
    )  # fmt: skip
    project = next((p for p in finished.figures if p.suffix == ".toml"), finished.folder)
    after = typed("fit", project, "--out", f"runs/{Path(source).stem}-next", trust=how.trust), "with the new recordings"
    how.tell(finished, after, sheet=finished.folder / "sheet.txt")


# ------------------------------------------------------------------ from text to a space


def _names(text: str | None) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",") if name.strip()) if text else ()


def _voltage(text: str) -> Any:
    """``multisine,0.2,8,6``."""
    from fracid.experiments.excitation import Chirp, Multisine, Pulses

    kinds = {"multisine": Multisine, "chirp": Chirp, "pulses": Pulses}
    kind, _, rest = text.partition(",")
    values = numbers("--voltage", rest) if rest else ()
    if kind not in kinds or len(values) != 3:
        raise InputError(SAYS("voltage", text=text))
    return kinds[kind](*values)
