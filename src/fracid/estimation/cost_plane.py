"""The cost over a plane of two orders, all other parameters fixed, drawn as a map.

A long narrow valley shows two orders that compensate each other; a minimum at the edge shows a bound.  The plane is a
cut, not a profile: other parameters are not re-estimated, so its valleys are narrower than the intervals.

Each order has its own reach, eight standard errors where it has one, and the points of its axis lie closer together
near the minimum.  :meth:`CostPlane.refined` draws a smooth surface through them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import InputError
from fracid.estimation.records import Estimate
from fracid.figures import draw
from fracid.units import number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from fracid.problem import Problem

ERRORS = 8.0
"""Standard errors that the plane reaches to either side."""

FEWEST, TENFOLD = 3.0, 10.0
"""And at least, where the cost rises by this factor before."""

WIDE = 0.15
"""Its reach in an order without a standard error."""

GATHERED = 1.6
"""The points of an axis lie at this power of equal parts of it."""

WALLS = 100.0
"""The square of a cost that has risen by this multiple is no longer the valley's."""

STEEP = 1e3
"""A cost that rises by this factor over the plane is not refined: a smooth surface through it would ring."""

# --- how far a cost lies above its least -------------------------------------------------------------

DECADES = 1e-4
"""A rise that is this part of the greatest looks like none."""

BOTTOMLESS = 1e4
"""A least cost that is this much below the median is an exact twin's: its multiples mean nothing."""

RISES = (
    *((percent / 100, f"+{number(percent)} %") for percent in (1e-6, 1e-5, 1e-4, 1e-3, 0.01, 0.1, 1.0, 10.0)),
    *((times - 1.0, f"×{times}") for times in (2, 5, 10, 20, 50, 100, 1000)),
)
"""Of a cost above its least, as a share of it."""


@dataclass(frozen=True)
class Scale:
    """From which height to which the colours go, and the heights that have a line and a word."""

    low: float
    high: float
    levels: tuple[tuple[float, str], ...]
    title: str = ""
    """What the words say."""


def risen(cost: FloatArray) -> tuple[FloatArray, Scale, float]:
    """How far a cost lies above its least, four decades of that, and the least.

    As a share of the least; where that has no meaning, of the cost of an exact twin, it is the cost itself, or that
    above its least, and the least is called 0.  Runs that nearly diverge take the colours from nobody.

    Examples
    --------
    >>> height, scale, least = risen(1 + np.geomspace(1e-3, 30, 50))
    >>> [label for _, label in scale.levels], least
    (['+0.1 %', '+1 %', '+10 %', '×2'], 1.001)
    """
    finite = cost[np.isfinite(cost)]
    least = float(finite.min())
    relative = least > 0 and np.median(finite) < BOTTOMLESS * least
    height = cost / least - 1 if relative else cost - min(least, 0.0)
    above = np.sort(height[np.isfinite(height) & (height > 0)])
    high = float(min(above[-1], 10 * above[above.size // 2])) if above.size else 1.0
    low = max(high * DECADES, float(above[0]) / 2 if above.size else 0.0)
    tenths = tuple((high * 10.0**-k, number(high * 10.0**-k, ".2g")) for k in (3, 2, 1))
    levels = tuple(level for level in (RISES if relative else tenths) if low < level[0] < high)
    title = "cost relative to the lowest" if relative else "cost" if least >= 0 else "cost above the lowest"
    return height, Scale(low, high, levels, title), least if relative else 0.0


# --- the plane of the orders -------------------------------------------------------------------------


@dataclass(frozen=True)
class CostPlane:
    """The cost over two orders, all other unknowns fixed."""

    names: tuple[str, str]
    """The two orders."""
    first: FloatArray
    """Values of the first, shape (n,)."""
    second: FloatArray
    """Values of the second, shape (m,)."""
    cost: FloatArray
    """Shape (n, m); infinite where the run diverges."""

    def refined(self, points: int = 121) -> CostPlane:
        """A smooth surface through the plane on an even grid; itself where a run failed, or it is too steep for that.

        The square of the cost is what is smooth at the minimum; far from it the splines take its logarithm, or a
        cliff there, where a pendulum swings over the top, would ring in the valley: minima that are not there.

        Examples
        --------
        >>> orders = np.linspace(0.8, 1.0, 9)
        >>> bowl = CostPlane(("lambda", "mu"), orders, orders, np.sqrt(1 + (orders[:, None] - 0.9) ** 2 + orders**2))
        >>> fine = bowl.refined(41)
        >>> fine.cost.shape, bool(abs(fine.cost[3, 7] - np.sqrt(1 + 0.085**2 + 0.835**2)) < 1e-8)
        ((41, 41), True)
        """
        z = self.cost
        if min(z.shape) < 4 or not np.isfinite(z).all() or not 0 < z.min() <= z.max() < STEEP * z.min():
            return self
        from scipy.interpolate import RectBivariateSpline

        first, second = (np.linspace(axis[0], axis[-1], points) for axis in (self.first, self.second))
        rise = np.log1p(((z / z.min()) ** 2 - 1) / WALLS)
        square = 1 + WALLS * np.expm1(RectBivariateSpline(self.first, self.second, rise)(first, second))
        return replace(self, first=first, second=second, cost=z.min() * np.sqrt(np.maximum(square, 1.0)))

    def plot(self, **options: Any) -> Figure:
        """The cost over the two orders; see :func:`fracid.plots.cost_plane`.

        Parameters
        ----------
        **options
            What follows here.
        best : (float, float), optional
            What was found.
        evaluations : array, shape (k, 2), optional
            Where the search has been.
        cost_name : str
            For the colour bar.
        style : str or Style
            ``screen``, ``journal`` or one's own; see :mod:`fracid.figures`.

        Examples
        --------
        >>> orders = np.linspace(0.8, 1.0, 5)
        >>> plane = CostPlane(("lambda", "mu"), orders, orders, 1.0 + (orders[:, None] - orders) ** 2)
        >>> plane.plot(best=(0.9, 0.9), cost_name="rmse").axes[1].get_ylabel()
        'RMSE relative to its least [–]'
        """
        return draw("cost_plane", self.refined(), **options)


def _reach(problem: Problem, x: FloatArray, i: int, e: Estimate | None) -> float:
    """How far a plane reaches in one order."""
    if e is None or not e.standard_error:
        return WIDE
    errors, steep, space = ERRORS, TENFOLD * problem.cost(x), problem.space
    to_both_sides = np.outer((-e.standard_error, e.standard_error), np.eye(len(x))[i])
    while errors > FEWEST and min(problem.costs(space.clipped(x + errors * to_both_sides))) > steep:
        errors = max(FEWEST, 0.7 * errors)
    return errors * e.standard_error


def cost_plane(
    problem: Problem, x: FloatArray, *, orders: Mapping[str, Estimate] | None = None, points: int = 15, jobs: int = 1
) -> CostPlane:
    """Evaluate the cost around x over the problem's first two free orders, within their bounds.

    It reaches eight standard errors of each, or 0.15 where there is none.  Down to three, where the cost rises tenfold
    to both sides before: where other values make up for an order its interval is wide, and the cut narrow.

    Of a long record it is that of its first swings (:func:`fracid.estimation.long_records.part_of`).

    Parameters
    ----------
    problem : Problem
        With at least two free orders.
    x : array, shape (n_unknowns,)
        Where the other unknowns stay.
    orders : mapping, optional
        The estimates of the orders, by name.
    points : int
        Along each order.

    Raises
    ------
    InputError
        If fewer than two orders are free.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment, Free, Problem
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=2e-3, end=2.0)
    >>> swing = Experiment("twin", 2e-3, run.states[:, [0, 2]], np.zeros((1, 1)))
    >>> problem = Problem(rig, (swing,), {"lambda": Free(0.9, 0.5, 1.2), "mu": Free(0.95, 0.5, 1.2)},
    ...                   initial_state="held")
    >>> plane = cost_plane(problem, problem.start, points=5)
    >>> plane.names, plane.cost.shape, bool(plane.cost[2, 2] == plane.cost.min())
    (('lambda', 'mu'), (5, 5), True)
    """
    from fracid.estimation.long_records import (  # a process that draws needs no solver
        as_fitted,
        on_all_samples,
        part_of,
    )

    at = list(problem.order_indices[:2])
    if len(at) < 2:
        raise InputError("The plane of the orders needs two free orders.")
    near = part_of(as_fitted(problem, x))  # what has nearly its shape there, and is cheap
    far = [_reach(near, x, i, (orders or {}).get(problem.unknowns[i].target)) for i in at]
    ranges = [problem.unknowns[i].range for i in at]
    axes = [axis_about(x[i], max(r.lower, x[i] - d), min(r.upper, x[i] + d), points, gathered=GATHERED)
            for r, i, d in zip(ranges, at, far, strict=True)]  # fmt: skip
    grid = np.tile(x, (len(axes[0]), len(axes[1]), 1))
    grid[..., at] = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    costs = np.array(near.costs(grid.reshape(-1, len(x)), jobs=jobs)).reshape(grid.shape[:2])
    if near is not problem:
        costs = on_all_samples(problem, costs, near.cost(x), problem.cost(x))
    first, second = (problem.unknowns[i].target for i in at)
    return CostPlane((first, second), axes[0], axes[1], costs)


def axis_about(centre: float, low: float, high: float, points: int, gathered: float = 1.0) -> FloatArray:
    """Values from low to high, one of them the centre; even on each side of it, or gathered towards it by a power.

    Examples
    --------
    >>> axis_about(1.0, 0.0, 3.0, 4), axis_about(1.0, 1.0, 3.0, 3, gathered=2.0)
    (array([0., 1., 2., 3.]), array([1. , 1.5, 3. ]))
    """
    below = round((points - 1) * (centre - low) / (high - low))
    left, right = np.linspace(1, 0, below + 1)[:-1], np.linspace(0, 1, points - below)
    return np.concatenate([centre + (low - centre) * left**gathered, centre + (high - centre) * right**gathered])
