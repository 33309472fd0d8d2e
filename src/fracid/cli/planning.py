"""``fracid design RUN|PROJECT|RIG``: which experiments next, and their expected intervals."""

from __future__ import annotations

from typing import Any

from fracid.cli.app import LONG, How, assigned, command, numbers, print_found, typed
from fracid.errors import InputError

SWING = (5.0, 150.0)
"""Angles from which a pendulum is released if none are given [°]."""


@command(*LONG)
def design(
    source: str,
    of: str | None = None,
    experiments: int = 3,
    release: str | None = None,
    seconds: str | None = None,
    rate: str | None = None,
    arm: str = "free",
    voltage: list[str] | None = None,
    voltage_step: float = 0.0,
    set_: list[str] | None = None,
    limit: list[str] | None = None,
    sensors: str | None = None,
    counts: float | None = None,
    criterion: str | None = None,
    against: str | None = None,
    order: list[str] | None = None,
    friction: bool = False,
    robust: int = 0,
    *,
    how: How,
) -> None:
    """Choose the next experiments, and predict their intervals.

    Computes the information of each candidate experiment with the noise of the run, adds it to that of the recordings
    so far, and finds the best set by exchange.  Excludes candidates that exceed a limit.  Writes project files to
    complete with the new recordings, voltages, expected curves with a band, plan.json and figures.  Exit code 0 when
    done.
    """
    orders, limits = assigned("--order", order, "mu=0.95"), assigned("--limit", limit, "theta=2.5")
    constants = assigned("--set", set_, "mass=0.2,0.5,1", lambda text, _: numbers("--set", text, "mass=0.2,0.5,1"))
    angles = (0.0,) if release is None else numbers("--release", release)
    durations, rates = numbers("--seconds", seconds or "20"), numbers("--rate", rate or "500")
    said = {"seconds": seconds, "rate": rate, "voltage": voltage or release}
    from fracid.experiments.space import DesignSpace
    from fracid.workflows.planning import run_design

    space = DesignSpace(
        release=angles, arm=_names(arm), seconds=durations, rate=rates, counts=counts, sensors=_names(sensors),
        voltage=tuple(_voltage(text) for text in voltage or ()) or None, voltage_step=voltage_step, limits=limits,
        constants=constants,
    )  # fmt: skip
    finished = how.done(
        run_design, source, space, experiments=experiments, criterion=criterion, of=_names(of), against=against,
        orders=orders or None, swing=SWING if release is None else (),
        unsaid=[name for name, value in said.items() if not value], friction=friction, robust=robust,
    )  # fmt: skip
    project = next((p for p in finished.figures if p.suffix == ".toml"), finished.folder)
    after = typed("fit", project, trust=how.trust), "when the recordings are there"
    how.answer(finished.result, lambda at: print_found(at, finished, after, sheet=finished.folder / "sheet.txt"))


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
        raise InputError(f"--voltage {text!r} is not possible; expected multisine,0.2,8,6 (from Hz, to Hz, peak), "
                         "chirp,0.3,4,6 or pulses,0.1,1,6 (shortest s, longest s, peak).")  # fmt: skip
    low, high, peak = values
    return kinds[kind](low, high, peak)
