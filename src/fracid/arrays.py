"""The array types of fracid: 64-bit floats, and indices.  Shapes and units stand in the docstrings."""

import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from numbers import Real
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from fracid.errors import InputError, brief

FloatArray = NDArray[np.float64]

IntArray = NDArray[np.int64]
"""For indices."""

BoolArray = NDArray[np.bool_]
"""Which of them."""

Signals = Mapping[str, FloatArray]
"""Name → samples, shape (n_samples,)."""

Pair = tuple[FloatArray, FloatArray]
"""Two that belong together, such as something of an arm and of its pendulum."""

Name = TypeVar("Name")

Quanta = Mapping[str, float | None] | None
"""Output → the step that its encoder rounds to, None for none; None where nobody says."""

ByName = Mapping[str, float]
"""Numbers by the names of what they are of: orders, parameters, unknowns."""

ROUNDED = 1e-3
"""Steps of a grid by which a stamp that is meant to lie on it may be off, as one of an epoch is."""


def real_array(values: Any, fault: str, *, copy: bool = False) -> FloatArray:
    """Real numbers of whatever package as floats that lie row by row, as compiled functions take them; or a copy.

    Raises
    ------
    InputError
        With the fault, in which {} is what was given, if they are none: texts, dates, complex numbers, and quantities
        with a unit of their own, which would be lost.

    Examples
    --------
    >>> real_array([1, 2], "expected numbers")
    array([1., 2.])
    """
    with suppress(TypeError, ValueError):
        kinds = type(values), type(getattr(values, "data", None))  # xarray keeps pint's within
        if not any(hasattr(kind, "to") and (hasattr(kind, "units") or hasattr(kind, "unit")) for kind in kinds):
            array = np.asarray(values)
            if array.dtype.kind in "fiub" or (array.dtype == object and all(isinstance(v, Real) for v in array.flat)):
                return np.require(array.copy() if copy else array, np.float64, ["C", "W"])
    raise InputError(fault.replace("{}", brief(values)))


def by_name(names: Iterable[Name], values: FloatArray) -> dict[Name, float]:
    """Each name, or what else has a value, with its own of these.

    Examples
    --------
    >>> by_name(("lambda", "mu"), np.array([0.9, 1.0]))
    {'lambda': 0.9, 'mu': 1.0}
    """
    return dict(zip(names, values.tolist(), strict=True))


def joined(parts: Iterable[FloatArray]) -> FloatArray:
    """All values of several arrays, one after the other, shape (n,).

    Examples
    --------
    >>> joined([np.zeros((1, 2)), np.ones(1)])
    array([0., 0., 1.])
    """
    return np.concatenate([part.ravel() for part in parts])


def stretches(mask: NDArray[np.bool_]) -> IntArray:
    """Start and stop of each stretch of True, in order, shape (n_stretches, 2).

    Examples
    --------
    >>> stretches(np.array([True, False, True, True])).tolist()
    [[0, 1], [2, 4]]
    """
    return np.flatnonzero(np.diff(mask, prepend=False, append=False)).reshape(-1, 2)


def within(time: NDArray[np.floating], spans: Sequence[tuple[float, float]], slack: float = 0.0) -> BoolArray:
    """Which of increasing times lie in any of some spans, both ends included, and `slack` beyond them.

    Examples
    --------
    >>> within(np.arange(6.0), [(1.0, 2.5), (5.0, 9.0)]).tolist()
    [False, True, True, False, False, True]
    """
    first, last = np.reshape(spans, (-1, 2)).T
    entered = np.searchsorted(np.sort(first) - slack, time, "right")
    return np.asarray(entered > np.searchsorted(np.sort(last) + slack, time, "left"))


def spacing(mask: NDArray[np.bool_]) -> int:
    """From one True to the next, as most lie apart: 1 where these are in stretches.

    Examples
    --------
    >>> spacing(np.arange(100) % 20 == 0), spacing(np.arange(100) > 50)
    (20, 1)
    """
    apart = np.diff(np.flatnonzero(mask))
    return int(np.quantile(apart, 0.9, method="lower")) if apart.size else 1


def run_lengths(columns: FloatArray) -> FloatArray:
    """For how many samples in a row each column keeps the value that it has, shape (n_samples, n_columns).

    Examples
    --------
    >>> run_lengths(np.array([[0.0], [2.0], [2.0], [0.0]]))[:, 0].tolist()
    [1.0, 2.0, 2.0, 1.0]
    """
    run = np.cumsum(np.diff(columns, axis=0, prepend=np.nan) != 0, axis=0) - 1
    return np.column_stack([np.bincount(k)[k] for k in run.T]).astype(float)


def on_grid(time: FloatArray, x: FloatArray, grid: FloatArray, step: float, *, held: bool) -> FloatArray:
    """What is sampled at other times, at the points of a grid: lines between samples, and its ends beyond them.

    Of what is held from sample to sample it is the mean over the step from each point on: where it jumps within a step,
    the mean acts over the step as the jump at its time does, neither late nor early.

    Parameters
    ----------
    time, x : array, shape (n_samples,)
    grid : array, shape (n_grid,)
    step : float
        Of the grid.
    held : bool

    Examples
    --------
    >>> on_grid(np.array([0.0, 2.4, 4.0]), np.array([1.0, 2.0, 0.0]), np.arange(5.0), 1.0, held=True).round(12).tolist()
    [1.0, 1.0, 1.6, 2.0, 0.0]
    """
    if not held:
        return np.interp(grid, time, x)
    at, count = (time - grid[0]) / step, len(grid)
    at = np.where(np.abs(at - np.rint(at)) < ROUNDED, np.rint(at), at)
    cuts = np.union1d(np.arange(count + 1), at[(at > 0) & (at < count)])
    last, first = np.searchsorted(at, cuts[:-1], side="right") - 1, np.searchsorted(cuts, np.arange(count))
    values = x[np.maximum(last, 0)]
    more = values - np.repeat(values[first], np.diff(first, append=len(values)))
    return np.asarray(values[first] + np.add.reduceat(more * np.diff(cuts), first))


def extremes(signals: list[FloatArray], points: int) -> NDArray[np.intp]:
    """Indices of at most that many samples (and two) that draw the same lines.

    Parameters
    ----------
    signals : list of arrays, each of shape (n,)
        On one time base; what is not finite is passed over.
    points : int

    Returns
    -------
    array of int, shape (m,)
        Rising; all of them where there are few.

    Examples
    --------
    >>> t = np.arange(100.0)
    >>> extremes([np.sin(t / 100), np.where(t == 37, 9.0, 0.0)], 12).tolist()
    [0, 33, 34, 37, 67, 68, 99]
    """
    n = signals[0].size
    if n <= points:
        return np.arange(n)
    size = -(-n * 2 * len(signals) // points)
    parts = [np.array([0, n - 1])]
    for y in signals:
        padded = np.append(y, np.full(-n % size, np.nan)).reshape(-1, size)
        mask = np.isfinite(padded)
        at = size * np.arange(len(padded))
        parts += [at + np.where(mask, sign * padded, math.inf).argmin(axis=1) for sign in (1, -1)]
    indices = np.unique(np.concatenate(parts))
    return indices[indices < n]


def zeros_together(shapes: Sequence[tuple[int, ...]]) -> list[FloatArray]:
    """Arrays of zeros in one piece of memory, which the system takes back whole; of hundreds it would keep the holes.

    Examples
    --------
    >>> [part.tolist() for part in zeros_together([(1, 2), (1,)])]
    [[[0.0, 0.0]], [0.0]]
    """
    sizes = [math.prod(shape) for shape in shapes]
    parts = np.split(np.zeros(sum(sizes)), np.cumsum(sizes)[:-1])
    return [part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)]
