r"""Bounded nonlinear least squares: SciPy's trust-region reflective method [1]_.

The engine for everything smooth.  The Jacobian is taken by differences, forward but at an upper bound,
whose points are asked for as one batch, so that they run on all threads.  A trial step whose run fails has
infinite rows: the method quarters its trust region and tries again.  An unknown whose difference fails
stays where it is for that step.  Beside a cliff of failing runs it may therefore stop short of the minimum: where runs
failed it begins again where it ended, with a wide region, until that gains nothing.

The method is given the triangle R of :math:`[r\ J] = QR` in place of residuals and Jacobian (:mod:`fracid.qr`):
the same steps, without its copies of what is as tall as the recordings.

Rows are taken in units of the first residuals' norm, rounded to a power of two so that no digit changes: the method
takes sixth powers of them, which of 10⁵² or 10⁻⁵² are no numbers.

Where many recordings have unknowns of their own, the search is that of :mod:`.blockwise`.

The method sees :math:`y = x - x_{start} + size`, which is x where the start is its size: its first region is as
wide as y is long, and in x a search from zero (a friction constant at its bound) would take steps of 10⁻¹⁰ and
call that converged.  All of y is so many times as large that no size is below 1, by a power of two, which rounds
nothing: SciPy moves a start that is within 10⁻¹⁰ of a bound, where all picofarads are.

References
----------
.. [1] M. Branch, T. Coleman, Y. Li, SIAM J. Sci. Comput. 21 (1999) 1.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from fracid.arrays import FloatArray
from fracid.errors import SMALLEST, InputError, at_least
from fracid.optimise.base import Ask, Entry, Evaluation, Optimiser, Outcome, Space, as_generator
from fracid.optimise.blockwise import blockwise
from fracid.qr import BLOCK, triangle

NO_ROWS = """This cost has no residuals for least squares: type optimiser = 'differential-evolution' or 'nelder-mead', \
or one of the built-in costs."""

GAINS = 1e-3
"""Part of the cost that beginning again must gain, to begin once more."""

LEAST = -100
"""Of a unit for the rows, the power of two."""


def least_squares(space: Space, _rng: object, *, tolerance: float = 1e-8, budget: int = 100) -> Optimiser:
    """Minimise Σ r² from the start of the space; what that says is held stays there.

    Parameters
    ----------
    tolerance : float
        Of the gain relative to Σ r², and of the step relative to |y|.
    budget : int
        Trial steps at most (Jacobians not counted).

    Raises
    ------
    InputError
        When it runs, if the cost has no residuals.

    Examples
    --------
    >>> from fracid.optimise import minimise
    >>> space = Space(("a", "b"), np.array([0.0, 0.0]), np.array([9.0, 2.0]), np.array([1.0, 1.0]))
    >>> def evaluate(x):
    ...     r = x - [3.0, 4.0]
    ...     return Evaluation(x, float(r @ r), r)
    >>> minimise(evaluate, least_squares(space, None)).best.point.round(5)
    array([3., 2.])
    """
    at_least("budget", budget, 1)
    from scipy.optimize import least_squares as scipy_least_squares

    if space.blocks is not None:
        return blockwise(space, tolerance=tolerance, budget=budget)
    moving = np.flatnonzero(space.moving)  # a column of zeros would cost the method its Gauss-Newton steps
    size, start, low, high = (v[moving] for v in (space.typical, space.start, space.lower, space.upper))
    large = 2.0 ** max(0, math.ceil(-math.log2(np.min(size, initial=1.0))))
    bounds = large * (size + (low - start)), large * (size + (high - start))  # hold the start, rounded too

    def run(evaluate: Ask) -> Outcome:
        x_good, good = space.start, np.empty(0)  # the last run that ended, and its rows
        unit, fails = 0.0, None  # whether a run failed since it began; None before the first

        def physical(y: FloatArray) -> FloatArray:
            x = space.start.copy()
            x[moving] = np.clip(start + (y / large - size), low, high)
            return x

        def first_column(y: FloatArray) -> FloatArray:
            rows = residuals(physical(y))
            return np.append(np.inf if rows is None else np.linalg.norm(rows), np.zeros(len(size)))

        def residuals(x: FloatArray) -> FloatArray | None:
            nonlocal x_good, good, unit, fails
            e = evaluate(x)[0]
            if e.residuals is None and not good.size:
                if e.cost < np.inf:
                    raise InputError(NO_ROWS)
                raise _Ended(Outcome.ALL_FAILED)
            if e.residuals is None:
                if fails is None:  # where it begins again: SciPy moves a start off its bounds
                    raise _Ended(Outcome.CONVERGED)
                fails = True
                return None
            fails = bool(fails)
            unit = unit or _power_of_two(float(np.linalg.norm(e.residuals)))
            x_good, good = e.point, e.residuals / unit
            return good

        def other_columns(y: FloatArray) -> FloatArray:
            x = physical(y)
            if not np.array_equal(x_good, x):
                residuals(x)
            moved = evaluate((x + np.diag(space.steps(x)))[moving])
            R = triangle(_rows(good, x, moved, moving, unit=unit))
            if not np.any(np.abs(R[0, 0] * R[0, 1:]) > SMALLEST):  # J'r: nothing moves the rows, or they are zero
                raise _Ended(Outcome.CONVERGED)  # SciPy would divide by zero
            return np.asarray(R[:, 1:] / large)

        if not len(moving):
            return Outcome.CONVERGED if evaluate(space.start)[0].cost < np.inf else Outcome.ALL_FAILED
        y, cost, left = large * size, math.inf, budget
        try:
            while True:
                result = scipy_least_squares(
                    first_column, y, other_columns, bounds=bounds, x_scale=large * size,
                    ftol=tolerance, xtol=tolerance, gtol=None, max_nfev=left,
                )  # fmt: skip
                left -= result.nfev
                if not fails or left <= 0 or result.cost > (1 - GAINS) * cost:
                    break
                y, cost, fails = result.x, result.cost, None
        except _Ended as end:
            return Outcome(end.args[0])
        return Outcome.BUDGET_SPENT if result.status == 0 else Outcome.CONVERGED

    return as_generator(run)


def _power_of_two(size: float) -> float:
    """Not above the size, and less than a factor 2 below it; a start that fits to 10⁻³⁰ is no unit for what follows."""
    return math.ldexp(1.0, max(math.frexp(size)[1] - 1, LEAST)) if size > 0 else 1.0


def _rows(
    base: FloatArray, x: FloatArray, batch: list[Evaluation], moving: NDArray[np.intp], unit: float
) -> Iterator[FloatArray]:
    """Parts of [r J] at x, in a unit as `base` is, J by differences; 0 where one fails."""
    for first in range(0, len(base), BLOCK):
        at = slice(first, first + BLOCK)
        r = base[at]
        J = np.zeros((len(r), len(moving)))
        for column, i, e in zip(J.T, moving, batch, strict=True):
            if e.residuals is not None:
                column[:] = (e.residuals[at] / unit - r) / (e.point - x)[i]
        yield np.column_stack([r, J])


class _Ended(Exception):
    """With the outcome that it is given, for SciPy cannot go on.

    There is nothing to start from, no unknown changes the rows, there is nothing left of them, or it cannot begin again
    where it ended.
    """


OPTIMISER = Entry("least-squares", least_squares, needs_rows=True)
