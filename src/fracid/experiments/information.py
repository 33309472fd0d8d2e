r"""The information of one experiment about the parameters that all experiments share.

Least squares with weights W has the curvature :math:`A = J'WJ`, and its minimum scatters by the scores' covariance
:math:`S = \mathrm{cov}(J'We)`:

.. math::  \mathrm{cov}\,\hat x = \Big(\sum_e A_e\Big)^{-1} \Big(\sum_e S_e\Big) \Big(\sum_e A_e\Big)^{-1} ,

both sums over independent experiments e.  What an experiment has for itself (its initial state, the rest angles of
``per_recording``) is eliminated: with columns p of the shared and o of its own,

.. math::  \tilde J = J_p - J_o\,(J_o'WJ_o)^{-1} J_o'WJ_p , \qquad A_e = \tilde J'W\tilde J, \quad
           S_e = \mathrm{cov}(\tilde J'We) .

S is of the encoder's noise and rounding (:func:`fracid.estimation.rounding.scores_covariance`): a rest tail of any
length is one reading.  For white errors of the weights' own variance S is A.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fracid.arrays import FloatArray
from fracid.estimation.rounding import scores_covariance
from fracid.problem.unknowns import Weights

BLIND = 1e-12
"""Of the largest singular value of a curvature scaled to 1: less is not seen."""


@dataclass(frozen=True)
class Noise:
    """What one sensor adds."""

    deviation: float
    """Standard deviation of the white noise before rounding [rad]."""
    step: float
    """Of the encoder [rad]; 0 for no rounding."""

    @property
    def variance(self) -> float:
        """Of a reading of a moving joint [rad²]."""
        return self.deviation**2 + self.step**2 / 12


@dataclass(frozen=True)
class Information:
    """Curvature and scatter about the shared parameters, both of shape (..., n, n)."""

    curvature: FloatArray
    """A"""
    scatter: FloatArray
    """S"""

    def __add__(self, other: Information) -> Information:
        """Of independent experiments."""
        return Information(self.curvature + other.curvature, self.scatter + other.scatter)

    def covariance(self, scale: FloatArray) -> FloatArray:
        """A⁻¹SA⁻¹, computed in units of `scale`, shape (..., n, n)."""
        size = np.outer(scale, scale)
        inverse = np.linalg.inv(self.curvature * size)
        return np.asarray(inverse @ (self.scatter * size) @ np.swapaxes(inverse, -1, -2) * size)


def of_samples(
    outputs: FloatArray, shared: FloatArray, own: FloatArray, noise: Sequence[Noise], weights: Weights,
    excess: FloatArray,
) -> Information:  # fmt: skip
    """The information of the samples of one experiment.

    Parameters
    ----------
    outputs : array, shape (n_samples, n_outputs)
        Simulated.
    shared : array, shape (n_samples, n_outputs, n_shared)
        Their derivatives by the shared parameters.
    own : array, shape (n_samples, n_outputs, n_own)
        Their derivatives by what the experiment has for itself.
    noise : sequence of Noise
        Of each output.
    weights : "equal" or "noise"
        How outputs count in the fit.
    excess : array, shape (n_shared,)
        By what each variance exceeds that of white noise.

    Examples
    --------
    A line through 100 samples, its offset its own:

    >>> t = np.linspace(-1.0, 1.0, 100)
    >>> line = of_samples(t[:, None], t[:, None, None], np.ones((100, 1, 1)), [Noise(0.1, 0.0)], "equal", np.ones(1))
    >>> bool(np.isclose(line.covariance(np.ones(1))[0, 0], 0.1**2 / np.sum(t**2)))
    True
    """
    variance = np.array([n.variance for n in noise])
    weight = 1 / variance if weights == "noise" else np.full(len(noise), 1 / np.mean(variance))
    weighted = weight[:, None]
    projected = shared
    if own.shape[-1]:
        flat = (own * np.sqrt(weighted)).reshape(-1, own.shape[-1])
        size = np.maximum(np.linalg.norm(flat, axis=0), 1e-300)
        cross = (flat / size).T @ (shared * np.sqrt(weighted)).reshape(len(flat), -1)
        inverse = np.linalg.pinv((flat / size).T @ (flat / size), rcond=BLIND, hermitian=True)
        projected = shared - own @ (inverse @ cross / size[:, None])
    flat = (projected * np.sqrt(weighted)).reshape(-1, shared.shape[-1])
    A = flat.T @ flat / np.sqrt(np.outer(excess, excess))
    if np.any(excess != 1.0):
        return Information(A, A)
    S = sum((scores_covariance(outputs[:, o], weight[o] * projected[:, o], n.step, n.deviation)
             for o, n in enumerate(noise)), np.zeros_like(A))  # fmt: skip
    return Information(A, np.asarray(S))
