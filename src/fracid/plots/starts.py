"""Where each start of a search ended, sorted: is the lowest minimum found again?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from fracid.errors import InputError
from fracid.estimation.starts import Start
from fracid.figures import Style
from fracid.plots.appearance import SERIES, cost_label, finish, label, new, plain_log

KINDS = ("given", "regression", "Sobol", "the simpler structure", "windows")
"""Of starts, each with a colour and a shape."""


def waterfall(starts: Sequence[Start], *, cost_name: str = "cost", style: str | Style = "screen") -> Figure:
    """Draw the final cost of each start of a search, sorted: a broad lowest step is a minimum found again and again.

    Parameters
    ----------
    starts : sequence of fracid.estimation.starts.Start
        A start that was left in another's minimum is drawn hollow, at that one's cost; one that was left for its
        cost, or whose runs failed, has no place and is counted only.
    cost_name : str
        For the axis.
    style : str or Style
        ``screen``, ``journal`` or one's own; see :mod:`fracid.figures`.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        If there is no start.

    Examples
    --------
    >>> from fracid.estimation.starts import Start
    >>> at = np.zeros(1)
    >>> figure = waterfall([Start("given", at, 1.0, at, 0.1, "converged", None, 9),
    ...                     Start("Sobol 1", at, 2.0, at, None, "left", "given", 5)])
    >>> figure.axes[0].get_xlabel()
    'start, sorted by its final cost'
    """
    if not starts:
        raise InputError("There is no start to draw; expected those of a multistart search, Fit.starts.")
    from matplotlib.ticker import MaxNLocator

    from fracid.estimation.starts import SAME_COST, final_cost

    costs = [(final_cost(s, starts), s) for s in starts]
    ranking = sorted(((cost, s) for cost, s in costs if cost is not None), key=lambda pair: float(f"{pair[0]:.4g}"))
    figure = new(7, 4.6, style)
    axes = figure.subplots()
    for kind, (colour, marker) in zip(KINDS, SERIES, strict=True):
        for joined, fill, more in ((False, colour, ""), (True, "white", ", left in another's minimum")):
            mine = [(i + 1, cost) for i, (cost, s) in enumerate(ranking)
                    if s.origin.rstrip(" 0123456789") == kind and (s.joined is not None) == joined]  # fmt: skip
            if mine:
                axes.plot(*np.transpose(mine), ls="", marker=marker, ms=7, mec=colour, mew=1.4, mfc=fill,
                          label=kind + more, zorder=3)  # fmt: skip
    axes.step(range(1, len(ranking) + 1), [cost for cost, _ in ranking], where="mid", color="0.7", lw=1, zorder=1)
    if ranking and ranking[0][0] > 0:
        plain_log(axes, room=1.3)
    best = sum(cost <= SAME_COST * ranking[0][0] for cost, _ in ranking) if ranking else 0
    left = f"; {len(starts) - len(ranking)} left for their cost" if len(ranking) < len(starts) else ""
    name, unit = cost_label(cost_name)
    heading = f"{best} of {len(starts)} starts at the lowest cost{left}"
    label(axes, heading, "start, sorted by its final cost", f"final {name} {unit}".rstrip())
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlim(0.5, len(starts) + 0.5)
    return finish(figure, "where the starts ended")
