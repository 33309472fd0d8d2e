r"""What the rounding of an encoder without dither does to an estimate.

An encoder's step q turns a trajectory f into a reading that is wrong by
:math:`r = q\,(\mathrm{round}(u) - u)`, with the phase :math:`u = (f - e)/q` and the edge e of a count, which nobody
knows to a part of it.  Where f crosses many counts from sample to sample, or noise of half a count or more stirs it,
neighbours know nothing of each other, and r is white noise of variance q²/12.  Where f is slow r is a sawtooth of f;
where it rests r is one number: a rest of 5,000 samples is one fact.  No residual shows how large that number might
have been.

But it can be said.  Over edges that lie anywhere, with Gaussian noise of σ steps on the signal,

.. math::  \mathrm E[r \mid u] = \sum_k b_k\,g^{k^2}\sin 2πku, \quad b_k = \frac{q\,(-1)^k}{πk}, \quad
           g = \mathrm e^{-2π^2σ^2} ,

so the scores' sum :math:`\sum_t r_t J_t` is, but for white noise, a function of the one unknown edge

.. math::  G(e) = \sum_k b_k\,g^{k^2}\,
           \mathrm{Im}\Big(\mathrm e^{-2πike/q} \sum_t J_t\,\mathrm e^{2πikf_t/q}\Big) ,

with f the fitted trajectory: :attr:`Edges.tables` has it on a grid of edges, one for each encoder, for recordings of
one encoder have its edges in common.  What is left of the residual's variance is white.  The estimate's error is the
sum of such functions and a normal variable: where one rest decides it is next to uniform, and its 95 % lie within
1.7 standard deviations instead of 1.96.  :func:`half_widths` has the distribution, by its characteristic
function [GP]_.

σ is found from neighbours, whose edge and whose slow errors of the fit cancel (:func:`noise_in_steps`):

.. math::  \mathrm E(r_{t+1} - r_t)^2 = 2\,\big(\tfrac{q^2}{12} + q^2σ^2 - c(d_t)\big), \quad
           c(d) = \sum_k \tfrac12 b_k^2\,g^{2k^2}\cos 2πkd, \quad d_t = (f_{t+1} - f_t)/q .

References
----------
.. [GP] J. Gil-Pelaez, Biometrika 38 (1951) 481: a distribution from its characteristic function.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fracid.arrays import FloatArray
from fracid.problem import Problem
from fracid.signals.resolution import resolution

HARMONICS = 40
"""Of the sawtooth, at most."""

SCALES = (0.85, 1.0, 1.15)
"""The tables are of the fitted trajectory and the noise that was found: on twins they scatter by up to a sixth."""

LEAST = 1e-5
"""Of the sawtooth's variance: a harmonic of less ends them."""

PHASES = 128
"""Edges at which its effect is known."""

SLOW = 0.3
"""Steps a sample: faster, neighbours show no noise."""

TRAVEL = 2.0
"""Steps that a signal must go slowly for its noise to be known."""

DITHERED = 0.45
"""Steps of noise, from which on rounding is white."""

EXPLAINED = 1.25
"""Times the variance of noise and rounding: what moves and leaves no more is explained by them."""

NEARLY = 4.0
"""The same: what leaves more lacks something, beside which rounding does not matter."""


class Edges(NamedTuple):
    """What undithered encoders do to the scores."""

    tables: tuple[FloatArray, ...]
    """The scores' sum, less its mean, for each edge of an encoder, shapes (n_phases, n_free)."""
    white: FloatArray
    """Covariance of the scores' sum that rounding and noise leave beside it, shape (n_free, n_free)."""
    alone: tuple[FloatArray, ...]
    """1 for an output of which noise and rounding explain all, else 0, of each recording, shapes (n_outputs,)."""

    @property
    def covariance(self) -> FloatArray:
        """Of the scores' sum over all edges, shape (n_free, n_free)."""
        return np.asarray(sum((t.T @ t / len(t) for t in self.tables), np.zeros_like(self.white)))


Psi = Callable[[FloatArray], FloatArray]
"""ψ of a loss."""


def edges(problem: Problem, errors: list[FloatArray], J: list[FloatArray], psi: Psi) -> Edges | None:
    """What undithered encoders do to the scores at a minimum; None where there is none.

    Parameters
    ----------
    problem : Problem
    errors : list of array, shape (n_samples, n_outputs)
        Measured minus simulated.
    J : list of array, shape (n_samples, n_outputs, n_free)
        Their derivatives.
    psi
        ρ′ of the cost.
    """
    tables: dict[tuple[int, float], FloatArray] = {}
    white, alone = np.zeros((J[0].shape[-1],) * 2), []
    for e, r, j, w in zip(problem.experiments, errors, J, problem.criterion.sample_weights(errors), strict=True):
        alone.append(np.zeros(r.shape[1]))
        for o, (y, error, own) in enumerate(zip(e.measured.T, r.T, e.scored.T, strict=True)):
            found = encoder_noise(y, error, own)
            if found is None or found.noise >= DITHERED:
                continue
            score = w[:, o, None] * j[:, o]
            from_a_line = y - error - y[0]
            table, known = _table(from_a_line, score, found.step, found.noise, psi=psi)
            tables[o, found.step] = tables.get((o, found.step), 0.0) + table
            if found.times <= EXPLAINED:
                alone[-1][o] = 1.0
                white += max(float(found.moving @ psi(error) ** 2) - known, 0.0) * score.T @ score
    return Edges(tuple(t - t.mean(axis=0) for t in tables.values()), white, tuple(alone)) if tables else None


class EncoderNoise(NamedTuple):
    """What a residual shows of its encoder."""

    step: float
    """q"""
    noise: float
    """σ beside its rounding [q]."""
    moving: FloatArray
    """Weights of the samples that move by a part of a count, sum 1, shape (n_samples,)."""
    times: float
    """The power of the residual over that of noise and rounding, where it moves."""


def encoder_noise(measured: FloatArray, residual: FloatArray, scored: NDArray[np.bool_]) -> EncoderNoise | None:
    """The noise beside an encoder's rounding; None where there is no encoder, or the two are far from explaining all.

    Parameters
    ----------
    measured, residual, scored : array, shape (n_samples,)

    Examples
    --------
    >>> t, rng = np.arange(0, 20, 0.004), np.random.default_rng(1)
    >>> f, all_ = 30 * np.exp(-t / 4) * np.cos(6 * t), np.ones(t.size, bool)
    >>> y = np.round(f + 0.1 * rng.standard_normal(t.size))
    >>> encoder_noise(y, y - f, all_).noise < 0.15, encoder_noise(y, y - f + 2 * np.sin(t), all_)
    (True, None)
    """
    step, fitted = resolution(measured[scored]), measured - residual
    noise = math.inf if step is None else noise_in_steps(residual[scored], fitted[scored], step)
    if step is None or not math.isfinite(noise):
        return None
    moving = np.where(scored, np.minimum(np.abs(np.gradient(fitted)) / step, 1.0), 0.0)
    moving /= moving.sum()
    times = float(moving @ residual**2) / (step**2 * (1 / 12 + noise**2))
    return EncoderNoise(step, noise, moving, times) if times <= NEARLY else None


def scores_covariance(fitted: FloatArray, score: FloatArray, step: float, noise: float) -> FloatArray:
    """Covariance of Σ r_t score_t of one encoder: r its noise and rounding, over all edges, shape (n_free, n_free).

    Parameters
    ----------
    fitted : array, shape (n_samples,)
        The trajectory that the encoder reads.
    score : array, shape (n_samples, n_free)
    step : float
        q; 0 for no rounding.
    noise : float
        σ, in the unit of `fitted`.

    Examples
    --------
    A joint at rest: all its samples are one reading.

    >>> rest, ones = np.zeros(500), np.ones((500, 1))
    >>> once, each = (scores_covariance(rest, ones, 1.0, noise).item() for noise in (0.0, 1.0))
    >>> round(12 * once / 500**2, 1), round(each / 500, 2)  # one reading of variance 1/12; 500 of variance 1 + 1/12
    (1.0, 1.08)
    """
    variance = step**2 / 12 + noise**2
    if step == 0 or noise >= DITHERED * step:
        return np.asarray(variance * score.T @ score)
    table, periodic = _table(fitted, score, step, noise / step, psi=np.asarray)
    return np.asarray(table.T @ table / len(table) + max(variance - periodic, 0.0) * score.T @ score)


def noise_in_steps(residual: FloatArray, fitted: FloatArray, step: float) -> float:
    """The noise σ of an encoder's signal, in its steps: 0.6 at most, infinite where too little of it is slow.

    Parameters
    ----------
    residual, fitted : array, shape (n_samples,)
    step : float
        q

    Examples
    --------
    A swing that dies, read with a tenth of a step of noise:

    >>> t, rng = np.arange(0, 20, 0.004), np.random.default_rng(1)
    >>> f = 30 * np.exp(-t / 4) * np.cos(6 * t)
    >>> y = np.round(f + 0.1 * rng.standard_normal(t.size))
    >>> abs(noise_in_steps(y - f, f, 1.0) - 0.1) < 0.05
    True
    """
    d, squares = np.abs(np.diff(fitted)) / step, (np.diff(residual) / step) ** 2
    slow = d < SLOW
    travel = d * slow
    if travel.sum() < TRAVEL:
        return math.inf
    noises, bins = np.linspace(0.0, 0.6, 61), 60
    weights = np.bincount((d[slow] / SLOW * bins).astype(int), d[slow], bins)
    centres = (np.arange(bins) + 0.5) * SLOW / bins
    expected = [weights @ (2 * (1 / 12 + s**2 - _alike(centres, s))) for s in noises.tolist()]
    return float(np.interp(travel @ squares, expected, noises))


def _alike(d: FloatArray, noise: float) -> FloatArray:
    """c(d)/q²: how the rounding of two samples goes together."""
    k = np.arange(1, HARMONICS + 1)
    squares = np.exp(-4 * (np.pi * k * noise) ** 2) / (2 * (np.pi * k) ** 2)
    return np.asarray(np.cos(2 * np.pi * np.outer(d, k)) @ squares)


def _table(fitted: FloatArray, score: FloatArray, step: float, noise: float, psi: Psi) -> tuple[FloatArray, float]:
    """G on a grid of edges, shape (n_phases, n_free), and the variance of E[ψ | u]."""
    u = (np.arange(4 * PHASES) + 0.5) / (4 * PHASES) - 0.5
    tooth = psi(step * -u)  # round(u) is 0
    grid, turn = np.exp(-2j * np.pi * np.arange(PHASES) / PHASES), np.exp(1j * (2 * np.pi * fitted / step))
    table, variance, power = np.zeros((PHASES, score.shape[1])), 0.0, np.ones_like(turn)
    for k in range(1, HARMONICS + 1):
        power = power * turn
        b = 2 * float(np.mean(tooth * np.sin(2 * np.pi * k * u))) * math.exp(-2 * (math.pi * k * noise) ** 2)
        if variance and b**2 < LEAST * variance:
            break
        variance += b**2 / 2
        sums = power.real @ score + 1j * (power.imag @ score)  # a real matrix stays so
        table += b * np.imag(np.outer(grid**k, sums))
    return table, variance


def half_widths(tables: tuple[FloatArray, ...], variance: FloatArray) -> FloatArray:
    """Half the width that holds 95 % of an error, of each unknown, in standard deviations, shape (n_free,).

    Parameters
    ----------
    tables : tuple of array, shape (n_phases, n_free)
        Parts that depend on an edge each, of mean 0.
    variance : array, shape (n_free,)
        Of the rest, which is normal.

    Examples
    --------
    A normal error, and one that is uniform, its size known to a sixth:

    >>> uniform = (np.arange(256)[:, None] - 127.5) / 256
    >>> [half_widths((part,), np.array([v])).round(2).item() for part, v in ((0 * uniform, 1.0), (uniform, 1e-6))]
    [1.96, 1.72]
    """
    deviation = np.sqrt(variance + sum(np.mean(t**2, axis=0) for t in tables))
    ω = (np.arange(400) + 0.5) * 0.1
    h = np.linspace(1.0, 2.5, 151)
    kernel = 0.1 * 2 / np.pi * np.sin(np.outer(h, ω)) / ω
    out = np.full(len(deviation), np.interp(0.95, kernel @ np.exp(-0.5 * ω**2), h))  # a normal error's
    for i, s in enumerate(deviation.tolist()):
        if not 0.0 < s**2 < math.inf:  # what nothing is known of, or nothing is left to know
            continue
        φ = np.exp(-0.5 * ω**2 * variance[i] / s**2).astype(complex)
        for t in tables:
            φ *= np.mean([np.exp(1j * np.outer(scale * ω, t[:, i] / s)).mean(axis=1) for scale in SCALES], axis=0)
        out[i] = np.interp(0.95, kernel @ φ.real, h)
    return out
