"""A row for each edge of an encoder: steps of one count, at uneven times, which are better data than samples are.

Between two edges the count says where the angle is to one count; *at* an edge it lies halfway between two counts, as
exactly as the stamp is.  Curves through the edges, after Akima, are read on a uniform grid, and never leave the count.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fracid.arrays import FloatArray, Signals

FEWEST = 100
"""Rows."""

ALMOST_ALL = 0.95
"""Share of the rows that are edges, and of the edges that are steps of one count."""

ONWARD = 0.5
"""Share of an encoder's edges that go on as the one before: a signal that flickers has fewer."""

UNEVEN = 0.2
"""Scatter of the times between rows, in their mean: what is sampled has less."""


def counts_at_edges(time: FloatArray, signals: Signals) -> dict[str, float]:
    """Signal → its count, of encoders of which each row is an edge; empty where rows are samples.

    Examples
    --------
    >>> angle = np.cos(6 * np.arange(0, 5, 1e-4))
    >>> rows = np.flatnonzero(np.diff(np.round(100 * angle))) + 1
    >>> counts_at_edges(1e-4 * rows, {"alpha": np.round(100 * angle)[rows]})
    {'alpha': 1.0}
    >>> counts_at_edges(np.arange(1000.0), {"alpha": np.round(100 * np.cos(np.arange(1000.0)))})
    {}
    """
    apart = np.diff(time)
    if len(time) < FEWEST or apart.min() < 0 or np.std(apart) <= UNEVEN * np.mean(apart):
        return {}
    counts, moved = {}, np.zeros(len(apart), dtype=bool)
    for name, x in signals.items():
        moves = np.diff(x)
        sizes = abs(moves[moves != 0])
        if not np.isfinite(x).all() or len(sizes) < FEWEST // 2:
            continue
        count, signs = float(np.median(sizes)), np.sign(moves[moves != 0])
        if np.mean(abs(sizes - count) < 0.01 * count) > ALMOST_ALL and np.mean(signs[1:] == signs[:-1]) > ONWARD:
            counts[name] = count
            moved |= moves != 0
    return counts if np.mean(moved) > ALMOST_ALL else {}


def between_edges(time: FloatArray, signals: Signals, counts: Mapping[str, float]) -> tuple[FloatArray, Signals]:
    """A grid of as many samples as there are rows, and the signals on it; those without edges go in lines."""
    from scipy.interpolate import Akima1DInterpolator

    step = float(f"{(time[-1] - time[0]) / (len(time) - 1):.2g}")
    grid = time[0] + step * np.arange(int((time[-1] - time[0]) / step * (1 + 1e-12)) + 1)
    read = {n: np.interp(grid, time, x) for n, x in signals.items()}
    for n, count in counts.items():
        x = signals[n]
        edges = np.flatnonzero(np.diff(x)) + 1
        at = np.concatenate([time[:1], time[edges], time[-1:] + step])
        values = np.concatenate([x[:1], (x[edges - 1] + x[edges]) / 2, x[-1:]])
        at, first = np.unique(at, return_index=True)
        held = x[np.searchsorted(time, grid + 1e-6 * step, side="right") - 1]
        read[n] = np.clip(Akima1DInterpolator(at, values[first])(grid), held - count / 2, held + count / 2)
    return grid, read
