r"""What makes a set of experiments good, lower is better; C is the covariance of the shared parameters.

====  ==========================================================================================================
D     log det C: the volume of the confidence ellipsoid of all of them
A     the sum of their relative variances
Ds    log det of the block of C that belongs to the named ones, all others estimated beside them
T     −log of the squared distance, in standard deviations, to the best integer-order alternative
====  ==========================================================================================================

Each takes sums over experiments, of shape (n_sets, …), and gives (n_sets,).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import InputError
from fracid.experiments.information import BLIND, Information

CRITERIA = ("D", "A", "Ds", "T")

Objective = Callable[[tuple[FloatArray, ...]], FloatArray]
"""Sums over experiments → what is minimised."""

LEAST = 1e-300
"""In place of a determinant or a distance of 0."""


def objective_named(name: str, scale: FloatArray, of: Sequence[int]) -> Objective:
    """The criterion D, A or Ds of sums (A, S).

    Parameters
    ----------
    name : str
    scale : array, shape (n_shared,)
        Typical sizes.
    of : sequence of int
        The parameters that Ds is about.

    Raises
    ------
    InputError
        For Ds of nothing.

    Examples
    --------
    >>> two = np.array([np.diag([4.0, 1.0])])
    >>> [objective_named(n, np.ones(2), (0,))((two, two)).round(3).item() for n in ("D", "A", "Ds")]
    [-1.386, 1.25, -1.386]
    """
    if name == "Ds" and not len(of):
        raise InputError('criterion = \'Ds\' is about named values: of = ("lambda", "mu"), or --for lambda,mu.')
    which = [*of] if name == "Ds" else [*range(len(scale))]

    def value(sums: tuple[FloatArray, ...]) -> FloatArray:
        covariance = Information(*sums).covariance(scale) / np.outer(scale, scale)
        block = covariance[..., which, :][..., which]
        if name == "A":
            return np.asarray(np.trace(block, axis1=-2, axis2=-1))
        return np.asarray(np.linalg.slogdet(block)[1])

    return value


def distance(sums: tuple[FloatArray, ...], alternatives: Sequence[Sequence[int]], scale: FloatArray) -> FloatArray:
    """Least squared distance to each linearised alternative, in standard deviations, shape (..., n_alternatives).

    Parameters
    ----------
    sums : tuple of array
        :math:`r'Wr`, :math:`J'Wr` and :math:`J'WJ`, shapes (...), (..., n) and (..., n, n).
    alternatives : sequence of sequence of int
        Which of the n parameters each of them may move.
    scale : array, shape (n,)
        Typical sizes.

    Examples
    --------
    >>> distance((np.array(5.0), np.array([2.0, 1.0]), np.eye(2)), [(0,), (0, 1)], np.ones(2)).tolist()
    [1.0, 0.0]
    """
    square, slope, curvature = sums
    slope, curvature = slope * scale, curvature * np.outer(scale, scale)
    values = []
    for columns in alternatives:
        at = [*columns]
        inverse = np.linalg.pinv(curvature[..., at, :][..., at], rcond=BLIND, hermitian=True)
        b = slope[..., at]
        values.append(square - np.einsum("...i,...ij,...j", b, inverse, b))
    return np.asarray(np.maximum(np.stack(values, axis=-1), 0.0))
