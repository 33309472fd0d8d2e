"""A recording: each signal whole, and close up about its release."""

from __future__ import annotations

import numpy as np
from matplotlib.artist import setp
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from fracid.figures import Style
from fracid.plots.appearance import (
    FITTED,
    GREEN,
    VERMILLION,
    angle_label,
    axis_unit,
    finish,
    line,
    new,
    plain,
    symbol,
    title,
)
from fracid.recording import Recording
from fracid.recording.measures import PENDULUM


def recording_overview(recording: Recording, *, zero: str = "", style: str | Style = "screen") -> Figure:
    """Draw a recording: each signal whole (left) and about its release, or its start (right).

    Parameters
    ----------
    recording : Recording
    zero : str
        Where the pendulum's angle is zero, where that is known: "hanging" or "upright".
    style : str or Style
        ``screen``, ``journal`` or one's own; see :mod:`fracid.figures`.

    Returns
    -------
    matplotlib.figure.Figure
        Angles in degrees; gaps and missing samples shaded, the release and the rest value as lines.

    Examples
    --------
    >>> from fracid.recording import Recording
    >>> t = np.linspace(0, 10, 501)
    >>> twin = Recording.of("twin", t, {"theta": 0 * t, "alpha": np.cos(6 * t)})
    >>> len(recording_overview(twin).axes)
    4
    """
    count = len(recording.signals)
    figure = new(11, 1.2 + 2.0 * count, style)
    grid = figure.subplots(count, 2, squeeze=False, sharex="col", width_ratios=(2, 1))
    near = _about_release(recording)
    inside = (recording.time >= near[0]) & (recording.time <= near[1])
    for (whole, close), name in zip(grid, recording.signals, strict=True):
        unit = axis_unit(recording.units[name])[0]
        _signal(whole, recording, name, np.full(inside.shape, True))
        _signal(close, recording, name, inside)
        label = angle_label(name, unit, zero if name == PENDULUM else "")
        if not zero and recording.units[name] == "rad":
            label = f"{symbol(name)} as recorded [{unit}]"
        whole.set_ylabel(label)
    release = recording.report.release
    title(grid[0][0], "whole recording")
    title(grid[0][1], "its start" if release is None else f"about the release at {release:.3f} s")
    setp(grid[-1], xlabel="time [s]")
    grid[0][1].set_xlim(*near)
    return finish(figure, f"{plain(recording.name)}: {plain(recording.report.verdict, 200)}")


def _about_release(recording: Recording) -> tuple[float, float]:
    """Return the span shown close up: about the release, else a tenth of the recording from its start."""
    time, release = recording.time, recording.report.release
    if not time.size:
        return 0.0, 1.0
    if release is None:
        return float(time[0]), float(time[0] + max(0.1 * np.ptp(time), 1e-9))
    return max(float(time[0]), release - 0.5), min(float(time[-1]), release + 1.5)


def _signal(axes: Axes, recording: Recording, name: str, part: NDArray[np.bool_]) -> None:
    _, factor = axis_unit(recording.units[name])
    report = next(s for s in recording.report.signals if s.name == name)
    line(axes, recording.time[part], factor * recording.signals[name][part], **FITTED)
    for start, length in recording.report.clock.gaps:
        axes.axvspan(start, start + length, color=VERMILLION, alpha=0.3, lw=0.5, label="gap")
    for moment in report.missing[:200]:  # a thousand lines are a block of colour, and slow
        axes.axvline(moment, color=VERMILLION, alpha=0.3, lw=0.5, label="missing")
    if recording.report.release is not None:
        axes.axvline(recording.report.release, color=GREEN, lw=1.2, label="release")
    if report.at_rest:
        axes.axhline(factor * report.rest, color="0.6", lw=0.8, ls="--", label="rest")
