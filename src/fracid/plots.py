"""Figures.  Each function returns a matplotlib Figure and shows or saves nothing.

=======================  ============================================================
figure                   shows
=======================  ============================================================
:func:`recording_overview`  each signal over time, and close up about the release
=======================  ============================================================

Matplotlib is imported within the functions: it takes longer than everything else of
``fracid check``.  No function touches pyplot's global state.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from fracid.recording import Recording

__all__ = ["recording_overview"]

SHOWN_UNITS = {"rad": ("°", 180 / np.pi), "rad/s": ("°/s", 180 / np.pi)}
"""Unit of a signal: how it is shown, and the factor to it."""


def recording_overview(recording: Recording) -> Figure:
    """Draw a recording: each signal whole (left) and about its release, or its start (right).

    Parameters
    ----------
    recording : Recording

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
    from matplotlib.figure import Figure

    count = len(recording.signals)
    figure = Figure(figsize=(11, 1.2 + 2.0 * count), layout="constrained")
    grid = figure.subplots(count, 2, squeeze=False, sharex="col", width_ratios=(2, 1))
    near = _close_up(recording)
    inside = (recording.time >= near[0]) & (recording.time <= near[1])
    for (whole, close), name in zip(grid, recording.signals, strict=True):
        _draw(whole, recording, name, slice(None), {"lw": 0.8})
        _draw(close, recording, name, inside, {"lw": 0.6, "marker": ".", "ms": 2})
        whole.set_ylabel(f"{name} [{SHOWN_UNITS.get(recording.units[name], (recording.units[name], 1))[0]}]")
    for axes, title in zip(grid[0], ("whole recording", _close_title(recording)), strict=True):
        axes.set_title(title, fontsize="medium")
    for axes in grid[-1]:
        axes.set_xlabel("time [s]")
    grid[0][1].set_xlim(*near)
    handles, labels = grid[0][0].get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), fontsize="small", frameon=False)
    figure.suptitle(f"{recording.name}: {recording.report.verdict}", fontsize="medium", wrap=True)
    return figure


def _close_up(recording: Recording) -> tuple[float, float]:
    """Return the span shown close up: about the release, else a tenth of the recording from its start."""
    time, release = recording.time, recording.report.release
    if not time.size:
        return 0.0, 1.0
    if release is None:
        return float(time[0]), float(time[0] + max(0.1 * np.ptp(time), 1e-9))
    return max(float(time[0]), release - 0.5), min(float(time[-1]), release + 1.5)


def _close_title(recording: Recording) -> str:
    release = recording.report.release
    return "its start" if release is None else f"about the release at {release:.3f} s"


def _draw(axes: Axes, recording: Recording, name: str, part: Any, style: dict[str, Any]) -> None:
    _, factor = SHOWN_UNITS.get(recording.units[name], ("", 1.0))
    measured = next(s for s in recording.report.signals if s.name == name)
    axes.plot(recording.time[part], factor * recording.signals[name][part], color="C0", **style)
    for start, length in recording.report.clock.gaps:
        axes.axvspan(start, start + length, color="C3", alpha=0.3, lw=0.5, label="gap")
    for moment in measured.missing[:200]:  # a thousand lines are a block of colour, and slow
        axes.axvline(moment, color="C3", alpha=0.3, lw=0.5, label="missing")
    if recording.report.release is not None:
        axes.axvline(recording.report.release, color="C2", lw=1, label="release")
    if measured.at_rest:
        axes.axhline(factor * measured.rest, color="0.6", lw=0.8, ls="--", label="rest")
    axes.margins(x=0.01)
    axes.grid(alpha=0.25)
    _once(axes)


def _once(axes: Axes) -> None:
    """Keep one legend entry of a kind."""
    seen: set[str] = set()
    for artist in axes.get_children():
        label = str(artist.get_label())
        if label in seen:
            artist.set_label("_again")
        seen.add(label)
