"""Bias and spread of each unknown against the level of noise, and how often its interval contains the true value."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from matplotlib.artist import setp
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fracid.errors import InputError
from fracid.figures import Style
from fracid.plots.appearance import GREEN, INK, SERIES, SMALL, axis_unit, cost_label, finish, new, plain, symbol, title
from fracid.units import shown_unit
from fracid.validation.study_records import Cell, Statistics

if TYPE_CHECKING:
    from fracid.validation.monte_carlo import NoiseStudy

MOST = 8
"""Unknowns that are drawn."""

ROOM = 0.5
"""Of the way from level to level, which the resolutions share."""

BELIEVED = (90.0, 99.0)
"""Where a coverage keeps its word [%]."""


def noise_levels(study: NoiseStudy, *, style: str | Style = "screen") -> Figure:
    """Draw bias and spread of each unknown against the level of noise, with the coverage of its intervals beside.

    Parameters
    ----------
    study : fracid.NoiseStudy
        Of more than 8 unknowns the first are drawn, the orders among them.
    style : str or Style
        ``screen``, ``journal`` or one's own; see :mod:`fracid.figures`.

    Returns
    -------
    matplotlib.figure.Figure
        A row for each unknown.  Left the bias, with the spread of the estimates as a bar and the claimed standard error
        as a pale one beside it: a claim that is shorter than the spread promises too much.  Right the share of the 95 %
        intervals that contain the true value, with its binomial interval.

    Raises
    ------
    InputError
        If no repetition found a value.

    Examples
    --------
    >>> import numpy as np
    >>> import fracid
    >>> from fracid.problem import Experiment, Free, Problem
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> swing = Experiment("release", 1e-2, np.zeros((201, 2)), np.zeros((1, 1)), initial={"alpha": 0.5})
    >>> problem = Problem(rig, (swing,), {"lambda": 0.9, "mu": Free(1.0, 0.5, 1.2)}, initial_state="held")
    >>> study = fracid.noise_study(problem, np.array([0.95]), levels=[1e-3, 2e-3], seeds=3)
    >>> [axes.get_ylabel() for axes in noise_levels(study).axes]
    ['bias of $\\\\mu$ [–]', 'coverage [%]']
    """
    names = [n for n in study.truth if any(c.unknowns[n].estimates for c in study.cells)]
    if not names:
        raise InputError("There is nothing to draw: no repetition found a value.")
    rows = names[:MOST]
    figure = new(8.2, 1.1 + 2.1 * len(rows), style)
    panels = figure.subplots(len(rows), 2, squeeze=False, sharex=True, width_ratios=(3, 2))
    for name, (left, right) in zip(rows, panels, strict=True):
        _unknown(left, right, study, name)
    setp(panels[-1], xlabel=f"noise, standard deviation [{axis_unit(study.cells[0].unit)[0]}]")
    more = f" (the first {len(rows)} of {len(names)} free parameters)" if len(names) > len(rows) else ""
    cost = cost_label(study.cost_name)[0]
    return finish(figure, f"{study.seeds} repetitions a cell, {study.optimiser}, {cost}{more}")


def _unknown(left: Axes, right: Axes, study: NoiseStudy, name: str) -> None:
    levels = list(dict.fromkeys(cell.level for cell in study.cells))
    resolutions = list(dict.fromkeys(cell.resolution for cell in study.cells))
    display_unit, factor = axis_unit(study.cells[0].unknowns[name].unit)
    for cell in study.cells:
        which = resolutions.index(cell.resolution)
        at = levels.index(cell.level) + ROOM * ((which + 0.5) / len(resolutions) - 0.5)
        _draw(left, right, cell, cell.unknowns[name], x=at, which=which, factor=factor)
    left.axhline(0.0, color=INK, lw=0.8, zorder=1)
    right.axhspan(*BELIEVED, color=GREEN, alpha=0.15, lw=0, label="90 to 99 %")
    right.axhline(95.0, color=INK, lw=0.8, zorder=1)
    right.set_ylim(min(78.0, right.get_ylim()[0]), 101.0)
    scale = shown_unit(study.cells[0].unit)[1]
    for axes in (left, right):
        axes.set_xlim(-0.5, len(levels) - 0.5)
        axes.set_xticks(range(len(levels)), [f"{scale * level:.4g}" for level in levels])
    left.ticklabel_format(axis="y", scilimits=(-3, 4), useMathText=True)
    left.yaxis.get_offset_text().set_fontsize(SMALL)
    unknown, _, recording = name.partition(" [")
    if recording:
        title(left, plain(f"[{recording}", 40), "left")
    left.set_ylabel(f"bias of {symbol(unknown)} [{display_unit}]")
    right.set_ylabel("coverage [%]")


def _draw(left: Axes, right: Axes, cell: Cell, s: Statistics, x: float, which: int, factor: float) -> None:
    colour, marker = SERIES[which % len(SERIES)]
    label = f"{cell.counts:.6g} counts" if cell.counts else "no rounding"
    style: dict[str, Any] = {"color": colour, "marker": marker, "ms": 4.5, "capsize": 3, "lw": 1.4, "zorder": 3}
    if s.bias is not None:
        spread = factor * (s.spread or 0.0)
        left.errorbar(x, factor * s.bias, yerr=spread, label=f"{label}: bias ± spread", **style)
    if s.bias is not None and s.claimed is not None:
        left.errorbar(x + 0.07, factor * s.bias, yerr=factor * s.claimed, color=colour, alpha=0.35, lw=4.5,
                      label=f"{label}: ± claimed standard error", zorder=2)  # fmt: skip
    if s.coverage is not None and s.coverage95 is not None:
        low, high = s.coverage95
        right.errorbar(x, 100 * s.coverage, yerr=[[100 * (s.coverage - low)], [100 * (high - s.coverage)]], **style)
