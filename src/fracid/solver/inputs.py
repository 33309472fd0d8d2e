r"""What an input does between its samples, on the grid of a run.

==================  ==============================================================================================
``line``            straight lines from sample to sample
``hold``            keeps its value until the next sample, as a converter does: it jumps at the samples
``band-limited``    the one function through the samples without anything above half their rate: a multisine
==================  ==============================================================================================

A run takes an input as a straight line over each of its steps, of its own: from `after` a grid point to `before` the
next.  Where the two values at a grid point differ, it jumps there, and ``pi2`` evaluates f on both sides.  Over a step
in which the input is no line (a jump between grid points since the input is delayed, a curve) it is the line nearest
to it,

.. math::  \int_0^1 (l + (r - l)\,s)\,ds = \int_0^1 u\,ds, \qquad
           \int_0^1 (s - ½)\,(l + (r - l)\,s)\,ds = \int_0^1 (s - ½)\,u\,ds ,

so that what is integrated over it keeps the second order, and moves smoothly with a delay.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Literal, NamedTuple, get_args

import numpy as np

from fracid.arrays import FloatArray, on_grid

Between = Literal["line", "hold", "band-limited"]

BETWEEN: tuple[Between, ...] = get_args(Between)

FINER, REACH = 8, 32
"""Points to a sample at which a band-limited input is reconstructed, and how many samples to each side count."""


REPEATS = 1e-4
"""An input that differs by less than this part of itself a period later repeats itself."""


class Driven(NamedTuple):
    """An input on the grid of a run, each of shape (n + 1,), or with a column an input."""

    before: FloatArray
    """Just before each grid point; at the first what it is after it."""
    after: FloatArray
    """Just after it."""

    @property
    def jumps(self) -> FloatArray | None:
        """Those after each grid point; None where there is no jump."""
        return None if self.before is self.after or np.array_equal(self.before, self.after) else self.after


def between_samples(u: FloatArray, between: Between, first: float, spacing: float, count: int) -> Driven:
    """An input on a grid of `count` points; before its first and after its last sample it stays.

    Parameters
    ----------
    u : array, shape (n_samples,)
    between : "line", "hold" or "band-limited"
    first, spacing : float
        Of the grid, in samples; at most one sample apart.
    count : int

    Examples
    --------
    >>> held = between_samples(np.array([1.0, 2.0, 5.0]), "hold", 0.0, 0.5, 5)
    >>> held.before.tolist(), held.after.tolist()
    ([1.0, 1.0, 1.0, 2.0, 2.0], [1.0, 1.0, 2.0, 2.0, 5.0])
    """
    places: FloatArray = first + spacing * np.arange(count, dtype=np.float64)
    if between == "line":
        values = np.interp(places, np.arange(len(u)), u)
        return Driven(values, values)
    whole = np.rint(places)
    places = np.where(abs(places - whole) < 1e-15 * (count + abs(first)), whole, places)
    left, right = _held(u, places, spacing) if between == "hold" else _curved(u, places, spacing)
    return Driven(np.append(left[:1], right), np.append(left, _at(u, np.floor(places[-1:]))))


def at_other_samples(time: FloatArray, u: FloatArray, between: Between, grid: FloatArray, step: float) -> FloatArray:
    """An input as samples on a grid of another step would have it: of one that is held its mean over each step.

    Parameters
    ----------
    time, u : array, shape (n_samples,)
    between : "line", "hold" or "band-limited"
        What it does between its samples; a band-limited one has even samples.
    grid : array, shape (n_grid,)
    step : float
        Of the grid.

    Examples
    --------
    >>> u, time, finer = np.array([1.0, 3.0, 3.0]), np.array([0.0, 2.0, 4.0]), np.arange(4.0)
    >>> [at_other_samples(time, u, between, finer, 1.0).tolist() for between in ("line", "hold")]
    [[1.0, 2.0, 3.0, 3.0], [1.0, 1.0, 3.0, 3.0]]
    """
    places = np.interp(grid, time, np.arange(float(len(u)))).round(9)
    if between == "band-limited" and np.any(places % 1):  # the curve is off its own samples by 4e-5
        return _along(u, places)
    return on_grid(time, u, grid, step, held=between == "hold")


def _along(u: FloatArray, places: FloatArray) -> FloatArray:
    """A band-limited input at some places [samples]; its ends beyond them."""
    curve = _reconstructed(np.ascontiguousarray(u, dtype=np.float64).tobytes())
    return curve(np.clip(places, 0.0, len(u) - 1.0))


def _at(u: FloatArray, samples: FloatArray) -> FloatArray:
    """Some samples, the first and the last for those beyond."""
    return np.asarray(u[np.clip(samples, 0, len(u) - 1).astype(int)])


def _held(u: FloatArray, places: FloatArray, spacing: float) -> tuple[FloatArray, FloatArray]:
    """The line nearest to a held input over each step, which jumps once at most."""
    last = np.ceil(places[1:]) - 1
    old, new = _at(u, np.floor(places[:-1])), _at(u, last)
    s = np.clip((last - places[:-1]) / spacing, 0.0, 1.0)  # where it jumps
    mean, tilt = old + (new - old) * (1 - s), 3 * (new - old) * s * (1 - s)
    return mean - tilt, mean + tilt


def _curved(u: FloatArray, places: FloatArray, spacing: float) -> tuple[FloatArray, FloatArray]:
    """The line nearest to a band-limited input over each step, by Gauss's rule of four points."""
    nodes, weights = np.polynomial.legendre.leggauss(4)
    middles = places[:-1] + spacing / 2
    values = [_along(u, middles + spacing / 2 * s) for s in nodes]
    mean = sum(w / 2 * v for w, v in zip(weights, values, strict=True))
    tilt = sum(1.5 * s * w * v for s, w, v in zip(nodes, weights, values, strict=True))
    return np.asarray(mean - tilt), np.asarray(mean + tilt)


@lru_cache(maxsize=8)  # a search for its delay asks at every point
def _reconstructed(samples: bytes) -> Callable[[FloatArray], FloatArray]:
    """The band-limited function through the samples: a windowed sinc to a finer grid, and a spline there."""
    from scipy.interpolate import CubicSpline
    from scipy.signal import firwin, upfirdn

    u = np.frombuffer(samples)
    reach = min(REACH, len(u) - 1)
    padded = _continued(u, reach)
    taps = FINER * firwin(2 * FINER * reach + 1, 1 / FINER, window=("kaiser", 8.0))
    fine = upfirdn(taps, padded, up=FINER)[2 * FINER * reach :][: FINER * (len(u) - 1) + 1]
    spline: Callable[[FloatArray], FloatArray] = CubicSpline(np.arange(len(fine)) / FINER, fine)
    return spline


def _continued(u: FloatArray, reach: int) -> FloatArray:
    """An input with what comes before and after it: its period where it repeats itself, as a multisine does.

    Else it is turned about its ends, so that value and slope go on; within a few samples of them it is less exact.
    """
    same = REPEATS * np.linalg.norm(u[:reach])
    for period in reach + np.flatnonzero(abs(u[reach : len(u) - reach] - u[0]) <= same) if same > 0 else ():
        if np.linalg.norm(u[period : period + reach] - u[:reach]) <= same:
            if np.linalg.norm(u[period:] - u[:-period]) <= REPEATS * np.linalg.norm(u):
                return np.concatenate([u[period - reach : period], u, u[len(u) - period :][:reach]])
            break
    return np.pad(u, reach, mode="reflect", reflect_type="odd")


# --- a low-pass of first order ---------------------------------------------------------------------


def low_passed(y: FloatArray, step: float, lowpass: float) -> FloatArray:
    """Filter lines between evenly spaced samples by T ż = y − z, exactly, from rest at the first.

    Examples
    --------
    A ramp is followed T late, once the beginning is over:

    >>> t = np.arange(0, 5, 0.01)
    >>> float((t - low_passed(t, 0.01, 0.1))[-1].round(12))
    0.1
    """
    return y if lowpass == 0.0 else _filtered(y[:-1], y[1:], step, lowpass)


def low_passed_steps(driven: Driven, step: float, lowpass: float) -> Driven:
    """Filter an input, and give the line nearest to the result over each step.

    With z(t) at the grid points the integrals of z follow from T ż = u − z, those of u being known.

    Examples
    --------
    >>> held = between_samples(np.array([0.0, 1.0, 1.0, 1.0]), "hold", 0.0, 1.0, 4)
    >>> low_passed_steps(held, 1.0, 0.5).before.round(3).tolist()
    [0.0, 0.0, 0.974, 0.996]
    """
    if lowpass == 0.0:
        return driven
    left, right, T = driven.after[:-1], driven.before[1:], lowpass / step
    z = _filtered(left, right, step, lowpass)
    mean = (left + right) / 2 - T * np.diff(z)
    tilt = (right - left) / 2 - 6 * T * ((z[1:] + z[:-1]) / 2 - mean)
    left, right = mean - tilt, mean + tilt
    return Driven(np.append(left[:1], right), np.append(left, right[-1:]))


def _filtered(left: FloatArray, right: FloatArray, step: float, lowpass: float) -> FloatArray:
    """z at the grid points where the input goes from `left` to `right` over each step, from rest at the first."""
    from scipy.linalg import solve_banded  # not lfilter: scipy.signal takes half a second to import

    r = step / lowpass
    rise = -math.expm1(-r)  # 1 − e^(−r)
    new = 1 - rise / r
    enters = np.append(left[0], (rise - new) * left + new * right)
    rows = [np.ones(len(enters)), np.full(len(enters), rise - 1)]  # z_k − e^(−r) z_(k−1)
    return np.asarray(solve_banded((1, 0), rows, enters, check_finite=False))
