"""The cost over a plane of two orders, all other parameters fixed, drawn as a map.

A long narrow valley shows two orders that compensate each other; a minimum at the edge shows a bound.  The plane is a
cut, not a profile: other parameters are not re-estimated, so its valleys are narrower than the intervals.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import InputError
from fracid.figures import Style, draw
from fracid.problem import Problem

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["CostPlane", "cost_plane"]


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

    def plot(
        self, *, best: tuple[float, float] | None = None, evaluations: FloatArray | None = None,
        cost_name: str = "cost", style: str | Style = "screen",
    ) -> Figure:  # fmt: skip
        """The cost over the two orders; see :func:`fracid.plots.cost_plane`.

        Parameters
        ----------
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
        'RMSE [rad]'
        """
        return draw(
            "cost_plane", self.first, self.second, self.cost, best=best, evaluations=evaluations, cost_name=cost_name,
            names=self.names, style=style,
        )  # fmt: skip


def cost_plane(problem: Problem, x: FloatArray, *, reach: float = 0.15, points: int = 21, jobs: int = 1) -> CostPlane:
    """Evaluate the cost around x over the problem's first two free orders, within their bounds.

    Parameters
    ----------
    problem : Problem
        With at least two free orders.
    x : array, shape (n_unknowns,)
        Where the other unknowns stay.
    reach : float
        How far from x to go in each order.
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
    ...                   initial_state="measured")
    >>> plane = cost_plane(problem, problem.start, points=5)
    >>> plane.names, plane.cost.shape, bool(plane.cost[2, 2] == plane.cost.min())
    (('lambda', 'mu'), (5, 5), True)
    """
    at = list(problem.order_indices[:2])
    if len(at) < 2:
        raise InputError("The plane of the orders needs two free orders.")
    axes = [_axis(problem.unknowns[i].range.lower, problem.unknowns[i].range.upper, x[i], reach, points) for i in at]
    grid = [(a, b) for a in axes[0] for b in axes[1]]

    def cost(pair: tuple[float, float]) -> float:
        y = x.copy()
        y[at] = pair
        return problem.cost(y)

    with ThreadPoolExecutor(jobs) as pool:
        costs = np.array(list(pool.map(cost, grid))).reshape(len(axes[0]), len(axes[1]))
    first, second = (problem.unknowns[i].target for i in at)
    return CostPlane((first, second), axes[0], axes[1], costs)


def _axis(lower: float, upper: float, centre: float, reach: float, points: int) -> FloatArray:
    """Points that hold the centre itself, within the bounds."""
    low, high = max(lower, centre - reach), min(upper, centre + reach)
    below = round((points - 1) * (centre - low) / (high - low))
    return np.concatenate([np.linspace(low, centre, below + 1)[:-1], np.linspace(centre, high, points - below)])
