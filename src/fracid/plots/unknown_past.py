"""How far the orders move with the cut: the fit with its interval, and every other treatment of the past beside it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fracid.errors import InputError
from fracid.figures import Style
from fracid.plots.appearance import BLUE, VERMILLION, finish, label, new, symbol

if TYPE_CHECKING:
    from fracid.validation.unknown_past import CutCheck


def cut_shifts(check: CutCheck, *, style: str | Style = "screen") -> Figure:
    """Draw each order as fitted, with its 95 % interval, and as found with something else taken for the past.

    Parameters
    ----------
    check : fracid.validation.unknown_past.CutCheck
        A treatment that fits worse than the fit, and so is no rival, is drawn hollow.
    style : str or Style
        ``screen``, ``journal`` or one's own; see :mod:`fracid.figures`.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        If no treatment applied.

    Examples
    --------
    >>> from fracid.validation.unknown_past import AsFitted, CutCheck, Treatment
    >>> past = Treatment({"mu": 1.05}, 0.1, {"alpha": 0.1}, {"mu": 0.05}, False)
    >>> fit = AsFitted({"mu": 1.0}, 0.1, {"alpha": 0.1})
    >>> figure = cut_shifts(CutCheck(fit, {"mu": 0.01}, {"with the past": past}, {}))
    >>> [label.get_text() for label in figure.axes[0].get_yticklabels()]
    ['with the past', 'as fitted']
    """
    if not check.treatments:
        raise InputError(f"There is no treatment to draw: {check.verdict}")
    names, rows = list(check.as_fitted.orders), [*reversed(check.treatments)]
    figure = new(1.6 + 3.4 * len(names), 1.5 + 0.45 * (len(rows) + 1), style)
    for axes, name in zip(np.atleast_1d(figure.subplots(1, len(names), sharey=True)), names, strict=True):
        _order(axes, check, name)
        axes.set_yticks(range(len(rows) + 1), [*rows, "as fitted"])
        axes.set_ylim(-0.6, len(rows) + 0.6)
        label(axes, "", f"order {symbol(name)} [–]", "")
    return finish(figure, "orders, by what is taken for the motion before the start")


def _order(axes: Axes, check: CutCheck, name: str) -> None:
    value, half, top = check.as_fitted.orders[name], check.half_width[name], len(check.treatments)
    if half is not None:
        axes.axvspan(value - half, value + half, color=BLUE, alpha=0.15, lw=0, label="95 % interval of the fit")
    axes.plot([value], [top], ls="", marker="o", ms=8, color=BLUE, clip_on=False)
    for row, (treatment, t) in enumerate(reversed(check.treatments.items())):
        rival = treatment in check.rivals
        axes.plot([t.orders[name]], [row], ls="", marker="D", ms=7, mec=VERMILLION, mew=1.4,
                  mfc=VERMILLION if rival else "white", clip_on=False,
                  label="fits as well" if rival else "fits worse")  # fmt: skip
