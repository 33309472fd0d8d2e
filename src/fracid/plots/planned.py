"""A plan of experiments: the expected interval against angle of release and duration, and the expected curves."""

from __future__ import annotations

from collections.abc import Sequence
from operator import attrgetter
from typing import Any

import numpy as np
from matplotlib.artist import setp
from matplotlib.figure import Figure

from fracid.errors import InputError
from fracid.figures import Style
from fracid.models import Model
from fracid.plots.appearance import (
    BLUE,
    INK,
    ORANGE,
    SERIES,
    angle_label,
    axis_unit,
    finish,
    label,
    new,
    plain,
    symbol,
    title,
)
from fracid.quantiles import NORMAL_95

MOST = 4
"""Panels of values, at most."""


def design_landscape(plan: Any, *, style: str | Style = "screen") -> Figure:
    """Draw the half-width of each value's 95 % interval that one candidate alone would leave, over its release.

    Parameters
    ----------
    plan : Plan
        Of :func:`fracid.design`.
    style : str or Style
        ``screen``, ``journal`` or one's own; see :mod:`fracid.figures`.

    Returns
    -------
    matplotlib.figure.Figure
        A panel for each of the values to narrow, a line for each duration, of the best voltage, rate and arm; the
        chosen experiments are marked.  Where one release alone was possible, durations are on the axis.

    Examples
    --------
    >>> import fracid
    >>> space = fracid.DesignSpace(release=(10, 30, 60), seconds=(1, 2), rate=100)
    >>> plan = fracid.design(fracid.rotary_pendulum("qube-servo2"), space, of=("mu",), free=("mu", "b_alpha"))
    >>> [axes.get_xlabel() for axes in design_landscape(plan).axes]
    ['release [°]']
    """
    names = [*(plan.of or plan.expected)][:MOST]
    figure = new(max(6.4, 3.6 * len(names)), 3.6, style)
    panels = figure.subplots(1, len(names), squeeze=False)[0]
    candidates = [c for c, _ in plan.landscape]
    by_release = len({c.release for c in candidates}) > 1
    at = attrgetter("release" if by_release else "seconds")
    for axes, name in zip(panels, names, strict=True):
        unit, factor = axis_unit(plan.expected[name].unit)
        half = factor * NORMAL_95 * np.array([errors[name] for _, errors in plan.landscape])
        lines = sorted({c.seconds for c in candidates}) if by_release else [None]
        for k, seconds in enumerate(lines):
            own = [(at(c), h) for c, h in zip(candidates, half.tolist(), strict=True) if seconds in (None, c.seconds)]
            best = {x: min(h for other, h in own if other == x) for x in sorted({x for x, _ in own})}
            (colour, marker), which = SERIES[k % len(SERIES)], "one experiment" if seconds is None else f"{seconds:g} s"
            axes.plot([*best], [*best.values()], color=colour, marker=marker, ms=4, label=which)
        for c, h in zip(candidates, half.tolist(), strict=True):
            if c in plan.experiments:
                axes.plot([at(c)], [h], "*", color=INK, ms=12, label="chosen", zorder=4)
        axes.set_yscale("log")
        over = "release [°]" if by_release else "duration [s]"
        label(axes, "", over, f"CI half-width of {symbol(name)} [{unit}]", ticks=None)
    return finish(figure, "Expected interval after one more experiment")


def expected_curves(curves: Sequence[Any], model: Model, *, style: str | Style = "screen") -> Figure:
    """Draw what each experiment of a plan should show, with its 95 % band.

    Parameters
    ----------
    curves : sequence of Expected
        Of :func:`fracid.experiments.plan.expected_curves`.
    model : Model
        Says which outputs are angles, and where the pendulum's is zero.
    style : str or Style
        ``screen``, ``journal`` or one's own; see :mod:`fracid.figures`.

    Raises
    ------
    InputError
        If there is no curve.
    """
    if not curves:
        raise InputError("There is nothing to draw: no experiment of the plan could be simulated.")
    names = [*curves[0].outputs]
    figure = new(8.2, 1.0 + 1.9 * len(curves), style)
    grid = figure.subplots(len(curves), len(names), squeeze=False)
    for row, curve in zip(grid, curves, strict=True):
        for axes, name in zip(row, names, strict=True):
            unit, factor = axis_unit(model.output_unit(name))
            y, half = factor * curve.outputs[name], factor * curve.half[name]
            shown = np.unique(np.linspace(0, len(y) - 1, 4000).astype(int))
            axes.fill_between(curve.time[shown], (y - half)[shown], (y + half)[shown], color=ORANGE,
                              alpha=0.4, lw=0, label="95 % band")  # fmt: skip
            axes.plot(curve.time[shown], y[shown], color=BLUE, lw=1.0, label="expected")
            axes.set_ylabel(angle_label(name, unit, model.zero if name == model.pendulum else ""))
        title(row[0], plain(str(curve.candidate), 90), "left")
    setp(grid[-1], xlabel="time [s]")
    return finish(figure, "Expected curves")
