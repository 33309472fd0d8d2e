"""The search over the orders: variable projection, and how far the data see them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from fracid.arrays import FloatArray, by_name
from fracid.problem import Free
from fracid.problem.unknowns import starting_value
from fracid.regression.estimators import Gauge, overlap, scaled_by_itself
from fracid.regression.rows import Data

PROFILE = (-0.12, -0.06, -0.03, 0.03, 0.06, 0.12)
"""How far from the best order its profile goes."""

CHI_SQUARE_95 = 3.84


def search_orders(
    data: Data, gauge: Gauge, orders: Mapping[str, float | Free]
) -> tuple[dict[str, tuple[float, float]], dict[str, float], FloatArray]:
    """Variable projection: minimise over the orders what total least squares leaves, in units of the noise.

    Gives the intervals of those that are free, all orders, and by how much the constants move with them.
    """
    from scipy.optimize import minimize

    free = {n: v for n, v in orders.items() if isinstance(v, Free)}

    def at(q: ArrayLike) -> dict[str, float]:
        values = by_name(free, np.atleast_1d(q))
        return {n: values.get(n, starting_value(v)) for n, v in orders.items()}

    def ratio(q: ArrayLike) -> float:
        return math.log(scaled_by_itself(data.system(at(q), draws=1), gauge, data.own)[1])

    bounds = [(f.lower, f.upper) for f in free.values()]
    axes = [np.unique([*np.linspace(f.lower, f.upper, 6), f.start]) for f in free.values()]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, len(free))
    simplex = {"xatol": 1e-3, "fatol": 1e-4, "maxfev": 25}
    starts = sorted(grid, key=ratio)[:3]  # the valley is narrow, and the corners have minima of their own
    rough = [minimize(ratio, q, method="Nelder-Mead", bounds=bounds, options=simplex) for q in starts]
    best = min(rough, key=lambda r: r.fun).x
    result = minimize(ratio, best, method="Nelder-Mead", bounds=bounds, options=simplex | {"maxfev": 80})
    paths = {n: _profile(ratio, result.x, math.exp(result.fun), bounds, i=i) for i, n in enumerate(free)}
    independent = sum(len(t) for t in data.times) / overlap(data.rows[0])
    intervals = {n: _interval(path[:, i], np.exp(path[:, -1]), math.exp(result.fun), independent)
                 for i, (n, path) in enumerate(paths.items())}  # fmt: skip
    return intervals, at(result.x), _spread(data, gauge, at, paths, interval=intervals)


def _profile(
    ratio: Callable[[ArrayLike], float], best: FloatArray, least: float, bounds: Sequence[tuple[float, float]], i: int
) -> FloatArray:
    """Points along one order, the other found again at each: rows of (orders …, log ratio), the best among them."""
    from scipy.optimize import minimize_scalar

    low, high = bounds[i]
    rows = [[*best, math.log(least)]]
    for q in (best[i] + d for d in PROFILE if low <= best[i] + d <= high):
        if len(best) == 1:
            rows.append([q, ratio([q])])
            continue
        j = 1 - i
        near = (max(best[j] - 0.05, bounds[j][0]), min(best[j] + 0.05, bounds[j][1]))
        other = minimize_scalar(lambda p, q=q: ratio([q, p] if i == 0 else [p, q]), bounds=near, method="bounded",
                                options={"maxiter": 6})  # fmt: skip
        rows.append([*((q, other.x) if i == 0 else (other.x, q)), other.fun])
    return np.array(sorted(rows, key=lambda row: row[i]))


def _interval(along: FloatArray, values: FloatArray, least: float, independent: float) -> tuple[float, float]:
    """Where the ratio stays below its least times 1 + 3.84/n, n independent rows; infinite where the profile ends."""
    level, k = math.sqrt(least * CHI_SQUARE_95 / max(independent, 1.0)), int(np.argmin(values))
    # the ratio is a parabola near its least: linear in the root of its rise
    rise = np.sqrt(np.maximum(values - least, 0.0))
    low, high = (
        np.interp(level, np.maximum.accumulate(rise[side]), abs(along[side] - along[k]), right=math.inf)
        for side in (slice(k, None, -1), slice(k, None))
    )
    return float(along[k] - low), float(along[k] + high)


def _spread(
    data: Data, gauge: Gauge, at: Callable[[ArrayLike], dict[str, float]], paths: Mapping[str, FloatArray],
    interval: Mapping[str, tuple[float, float]],
) -> FloatArray:  # fmt: skip
    """By how much the constants move with an order by one standard deviation along its profile, shape (n_terms,)."""
    moves = []
    for i, (n, path) in enumerate(paths.items()):
        ends = (data.system(at(row[:-1]), draws=1) for row in (path[0], path[-1]))
        first, last = (scaled_by_itself(system, gauge, data.own)[0] for system in ends)
        half = 0.5 * (interval[n][1] - interval[n][0])
        width = float(path[-1, i] - path[0, i])
        slope = (last - first) / width if width > 0.0 else np.zeros_like(first)
        moves.append(np.abs(slope) * min(half, width) / 1.96)
    spread = np.zeros(len(gauge.fixed))
    spread[list(gauge.free)] = np.max(moves, axis=0)
    return spread
