"""The ladder of structures: errors in and out of sample, orders 1 against orders free; and orders over amplitude."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fracid.errors import InputError
from fracid.figures import Style
from fracid.plots.appearance import (
    BLUE,
    SERIES,
    SMALL,
    VERMILLION,
    axis_unit,
    finish,
    label,
    new,
    plain,
    plain_log,
    symbol,
    title,
)
from fracid.units import shown_unit

if TYPE_CHECKING:
    from fracid.selection.amplitude import AmplitudeTest, Drift
    from fracid.selection.comparison_records import Comparison, Score

KINDS: dict[bool, dict[str, Any]] = {
    False: {"color": BLUE, "marker": "o", "label": "orders 1"},
    True: {"color": VERMILLION, "marker": "s", "ls": (0, (5, 2)), "label": "orders free"},
}
"""Of rows, by whether their orders are free."""

PAPER: dict[str, Any] = {"ls": "", "marker": "o", "ms": 13, "mfc": "none", "mec": "black", "mew": 1.0}
"""The ring about the paper's structure."""


def ladder(comparison: Comparison, *, style: str | Style = "screen") -> Figure:
    """Draw the RMSE of each rung in sample and held out, with orders 1 and with orders free.

    Parameters
    ----------
    comparison : fracid.Comparison
    style : str or Style
        ``screen``, ``journal`` or one's own; see :mod:`fracid.figures`.

    Returns
    -------
    matplotlib.figure.Figure
        A row for each output, a column for the fitted recordings and for each that was held out (for their mean, where
        there are more than three).  Where the two lines part, orders matter; where they meet as friction is added,
        orders stood in for it.  A run that fails has no point, and is named.

    Examples
    --------
    >>> from fracid.selection.comparison_records import Comparison, Row, Score
    >>> score = {"release": Score({"alpha": 0.01}, {"alpha": 95.0}, {"alpha": 0.1})}
    >>> rows = tuple(Row("viscous", free, "", free, 1.0, 3, 0.0, {}, {}, (), score, {}, "") for free in (False, True))
    >>> figure = ladder(Comparison(rows, "", (), ("alpha",), 9.0, False, "rmse", 1, 1))
    >>> [axes.get_title() for axes in figure.axes]
    ['fitted: release']
    """
    columns = comparison.columns
    figure = new(max(5.0, 1.0 + 3.3 * len(columns)), 1.3 + 2.5 * len(comparison.outputs), style)
    grid = figure.subplots(len(comparison.outputs), len(columns), squeeze=False, sharex=True)
    for output, panels in zip(comparison.outputs, grid, strict=True):
        for axes, (use, recordings) in zip(panels, columns, strict=True):
            _rungs(axes, comparison, output, recordings, use=use)
            which = plain(recordings[0], 28) if len(recordings) == 1 else f"mean of {len(recordings)}"
            heading = f"{'held out' if use == 'held_out' else 'fitted'}: {which}"
            title(axes, heading if output == comparison.outputs[0] else "")
        unit, _ = axis_unit(comparison.units.get(output, "rad"))
        panels[0].set_ylabel(f"RMSE of {symbol(output)} [{unit}]")
    return finish(figure, "RMSE by structure")


def _rungs(axes: Axes, comparison: Comparison, output: str, recordings: Sequence[str], use: str) -> None:
    frictions = list(dict.fromkeys(row.friction for row in comparison.rows))
    for fractional, style in KINDS.items():
        rows = [row for row in comparison.rows if row.fractional == fractional]
        at = np.array([frictions.index(row.friction) for row in rows])
        errors = np.array([[_shown(getattr(row, use).get(n), output, comparison) for row in rows] for n in recordings])
        if len(recordings) > 1:
            axes.plot(at, errors.T, color=style["color"], lw=0.6, alpha=0.4)
        mean = errors.mean(axis=0)
        axes.plot(at, mean, **style, ms=6, lw=1.6, zorder=3)
        for x in at[~np.isfinite(mean)]:
            axes.annotate("fails", (x, 0.94 if fractional else 0.86), xycoords=("data", "axes fraction"), ha="center",
                          color=style["color"], fontsize=SMALL)  # fmt: skip
        for row, x, y in zip(rows, at, mean, strict=True):
            if row.paper:
                axes.plot(x, y, **PAPER, label="the paper's structure")
    plain_log(axes, room=1.3)  # for a run that fails
    short = [f"+ {f.rpartition(' + ')[2]}" if " + " in f else f for f in frictions]
    axes.set_xticks(range(len(frictions)), [plain(name, 28) for name in short])
    axes.tick_params(axis="x", rotation=90)  # side by side, six names are wider than a column
    axes.set_xlim(-0.4, len(frictions) - 0.6)


def _shown(score: Score | None, output: str, comparison: Comparison) -> float:
    """NaN, which is drawn as missing, where the run fails."""
    value = math.inf if score is None else score.rmse[output]
    _, factor = shown_unit(comparison.units.get(output, "rad"))
    return factor * value if math.isfinite(value) and value > 0 else math.nan


def amplitudes(test: AmplitudeTest, *, style: str | Style = "screen") -> Figure:
    """Draw each order over the amplitude of the swing: level where it is real, drifting where it imitates friction.

    Parameters
    ----------
    test : fracid.AmplitudeTest
    style : str or Style
        ``screen``, ``journal`` or one's own; see :mod:`fracid.figures`.

    Returns
    -------
    matplotlib.figure.Figure
        A panel for each order, a line for the windows of each recording, diamonds for whole recordings; bars are 95 %
        intervals.

    Raises
    ------
    InputError
        If nothing was found in any window.

    Examples
    --------
    >>> from fracid.selection.amplitude import AmplitudeTest, Drift
    >>> drift = Drift("mu", "release", (0.5, 0.1), (0.99, 0.95), (1e-3, 2e-3), 1e-9, 1.0, -0.04)
    >>> [axes.get_title() for axes in amplitudes(AmplitudeTest((), (drift,))).axes]
    ['drifts: friction in disguise']
    """
    if not test.drifts:
        raise InputError(f"There is nothing to draw: no order was found in two windows. {' '.join(test.notes)}".strip())
    orders = list(dict.fromkeys(d.order for d in test.drifts))
    figure = new(max(5.0, 4.2 * len(orders)), 3.9, style)
    for axes, order in zip(figure.subplots(1, len(orders), squeeze=False)[0], orders, strict=True):
        _order(axes, order, [d for d in test.drifts if d.order == order])
    return finish(figure, "the order in windows of falling amplitude")


def _order(axes: Axes, order: str, drifts: Sequence[Drift]) -> None:
    unit, factor = axis_unit(drifts[0].unit)
    for k, d in enumerate(drifts):
        whole = d.over == "releases"
        style: dict[str, Any] = {"marker": "D", "ls": "", "mfc": "white"} if whole else {"marker": "o", "lw": 1.2}
        axes.errorbar(factor * np.array(d.amplitudes), d.values, 1.96 * np.array(d.standard_errors), capsize=2.5, ms=5,
                      color="black" if whole else SERIES[k % len(SERIES)][0], zorder=3,
                      label="whole recordings" if whole else plain(d.over, 28), **style)  # fmt: skip
    plain_log(axes, "x")
    axes.ticklabel_format(axis="y", useOffset=False)
    verdict = "drifts: friction in disguise" if any(d.drifts for d in drifts) else (
        "differs, but not with amplitude" if any(d.differs for d in drifts) else "does not drift")  # fmt: skip
    label(axes, verdict, f"mean amplitude of the swing [{unit}]", f"order {symbol(order)} [–]", ticks=None)
