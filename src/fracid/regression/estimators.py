"""Estimators of β in W β = 0, what cannot be told apart, and how far to trust the rest."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from fracid.arrays import FloatArray, Pair
from fracid.regression.rows import Blocks, Rows, System
from fracid.signals.correlation import bartlett_long_run

Estimator = Literal["ols", "huber", "tukey", "tls", "iv"]

Dependent = dict[int, dict[int, float]]
"""Column → the independent ones that it is a sum of, with their factors."""

COLLINEAR = 1e-2
"""Columns of unit length nearer than this to the span of others cannot be told from them."""


@dataclass(frozen=True)
class Gauge:
    """Which constants are free: β = fixed + (free constants in their places)."""

    free: tuple[int, ...]
    fixed: FloatArray
    """Known constants, 0 elsewhere, shape (n_terms,)."""

    @cached_property
    def B(self) -> FloatArray:
        """β = B (v, 1), shape (n_terms, n_free + 1)."""
        return np.column_stack([np.eye(len(self.fixed))[:, self.free], self.fixed])

    def beta(self, v: FloatArray) -> FloatArray:
        """All constants, shape (n_terms,)."""
        return np.asarray(self.B @ np.append(v, 1.0))


class Scaled(NamedTuple):
    """The equations with what their rows are divided by, and which of their constants are free."""

    system: System
    gauge: Gauge
    scales: FloatArray


def stack(blocks: Blocks, scales: FloatArray) -> FloatArray:
    """The rows of all equations, each in units of its own noise."""
    return np.concatenate([W / s for W, s in zip(blocks, scales, strict=True)])


def total_least_squares(of: Scaled) -> tuple[FloatArray, float]:
    """Minimise |W β|² / βᵀ C β; returns v and that ratio, 1 where noise is all that is left."""
    from scipy.linalg import eigh

    A = stack(of.system.W, of.scales) @ of.gauge.B
    C = of.gauge.B.T @ sum(c / s**2 for c, s in zip(of.system.covariance, of.scales, strict=True)) @ of.gauge.B
    unit = np.linalg.norm(A, axis=0)
    A, C = A / unit, C / np.outer(unit, unit)
    inverse, vectors = eigh(C, A.T @ A + 1e-14 * np.eye(len(C)))
    v = vectors[:, -1] / unit
    return v[:-1] / v[-1], 1.0 / float(inverse[-1])


def scaled_by_itself(system: System, gauge: Gauge, own: FloatArray) -> tuple[FloatArray, float, Scaled]:
    """Total least squares with the noise of its own estimate in each equation: v, the ratio, and so scaled."""
    v, ratio, near = gauge.fixed, math.inf, system.scales(own)
    of = Scaled(system, gauge, near)
    for _ in range(3):
        v, ratio = total_least_squares(of)
        of = of._replace(scales=system.scales(gauge.beta(v), near))
    return v, ratio, of


def _instrumental(A: FloatArray, y: FloatArray, Z: FloatArray, weights: FloatArray) -> FloatArray:
    """Solve Zᵀ w (A v − y) = 0."""
    units, zunits = (np.maximum(np.linalg.norm(columns, axis=0), 1e-300) for columns in (A, Z))
    instruments = (Z / zunits * weights[:, None]).T
    return np.asarray(np.linalg.lstsq(instruments @ (A / units), instruments @ y, rcond=None)[0] / units)


def _reweighted(
    A: FloatArray, y: FloatArray, Z: FloatArray, weigh: Callable[[FloatArray], FloatArray], weights: FloatArray,
    rounds: int = 50,
) -> Pair:  # fmt: skip
    """Solve Zᵀ w(r/s) r = 0 with r = y − A v, s its median size over that of normal noise, and w given; v and w."""
    last = np.full(A.shape[1], np.inf)
    for _ in range(rounds):
        v = _instrumental(A, y, Z, weights)
        r = y - A @ v
        scale = float(np.median(np.abs(r))) / 0.6744897501960817
        if scale == 0.0 or np.allclose(v, last, rtol=1e-9, atol=0.0):
            break
        last, weights = v, weigh(r / scale)
    return v, weights


def _huber(z: FloatArray) -> FloatArray:
    return np.minimum(1.0, 1.345 / np.maximum(np.abs(z), 1e-300))


def _tukey(z: FloatArray) -> FloatArray:
    return np.asarray(np.maximum(1.0 - (z / 4.685) ** 2, 0.0) ** 2)


def solve(estimator: str, of: Scaled, instruments: Blocks | None = None) -> Pair:
    """Free constants and the robust weights of the rows."""
    whole = stack(of.system.W, of.scales) @ of.gauge.B
    A, y = whole[:, :-1], -whole[:, -1]
    ones = np.ones(len(y))
    if estimator == "tls":
        return total_least_squares(of)[0], ones
    if estimator == "iv" and instruments is not None:
        return _reweighted(A, y, (stack(instruments, of.scales) @ of.gauge.B)[:, :-1], _huber, weights=ones, rounds=5)
    if estimator in ("huber", "tukey"):
        v, weights = _reweighted(A, y, A, _huber, weights=ones)  # Tukey's minimum is one of many: from Huber's
        return (v, weights) if estimator == "huber" else _reweighted(A, y, A, _tukey, weights=weights)
    return _instrumental(A, y, A, ones), ones  # least squares are their own instruments


# --- what cannot be told apart -------------------------------------------------------------------------


def base_parameters(system: System, free: Sequence[int], scales: FloatArray) -> tuple[list[int], Dependent]:
    """Base parameters by QR with column pivoting [Gautier].

    Returns the free terms whose columns are independent, and for each of the others the coefficients with which
    it is a combination of those.  A column whose distance from the span of the others is no more than what noise
    makes of it, is one.
    """
    from scipy.linalg import qr, solve_triangular

    A = stack(system.W, scales)[:, list(free)]
    C = sum(c / s**2 for c, s in zip(system.covariance, scales, strict=True))[np.ix_(free, free)]
    unit = np.linalg.norm(A, axis=0)
    columns = [i for i in range(len(free)) if unit[i] > 1e-12 * unit.max()]
    R, order = qr(A[:, columns] / unit[columns], mode="r", pivoting=True)
    pivots = [columns[i] for i in order]

    def depends(k: int) -> bool:
        """Whether the column of this pivot is one of those before, and noise."""
        x = np.append(-solve_triangular(R[:k, :k], R[:k, k]), 1.0) / unit[pivots[: k + 1]]
        noise = float(x @ C[np.ix_(pivots[: k + 1], pivots[: k + 1])] @ x)
        return bool(R[k, k] ** 2 <= max(COLLINEAR**2, noise))

    rank = next(filter(depends, range(1, len(pivots))), len(pivots))
    dependent: Dependent = {free[i]: {} for i in range(len(free)) if i not in columns}
    for k in range(rank, len(pivots)):
        x = solve_triangular(R[:rank, :rank], R[:rank, k]) * unit[pivots[k]] / unit[pivots[:rank]]
        weight = np.abs(x) * unit[pivots[:rank]] / unit[pivots[k]]
        dependent[free[pivots[k]]] = {free[pivots[i]]: float(x[i]) for i in range(rank) if weight[i] > 0.05}
    return sorted(free[i] for i in pivots[:rank]), dependent


# --- how well ----------------------------------------------------------------------------------------------


def bias_of(v: FloatArray, noisier: FloatArray) -> FloatArray:
    """What noise in the columns does to the estimate: SIMEX [Cook].

    With the noise added once more the estimate goes from v to v₁.  Attenuation v = v∞/(1 + κ), v₁ = v∞/(1 + 2κ)
    gives v∞ = v v₁/(2 v₁ − v), at most 3 v; where the noise pushes v up or turns its sign, the line's 2 v − v₁.
    """
    more = np.mean(noisier, axis=0)
    ratio = np.divide(more, v, out=np.ones_like(v), where=v != 0.0)
    shrunk = np.clip(ratio, 0.6, 1.0)
    extrapolated = np.where((ratio > 0.0) & (ratio < 1.0), v * shrunk / (2.0 * shrunk - 1.0), 2.0 * v - more)
    return np.asarray(v - extrapolated)


def overlap(rows: Rows) -> int:
    """Rows over which residuals are correlated: those that share samples through window and low-pass."""
    return math.ceil((rows.window + 2.0 / rows.cutoff) / (rows.step * max(1, len(rows.hann) // 4)))


def sandwich(of: Scaled, instruments: Blocks | None, v: FloatArray, weights: FloatArray, lags: int) -> FloatArray:
    """Covariance of v: (Zᵀw A)⁻¹ Ω (Aᵀw Z)⁻¹, Ω of the scores with Bartlett's weights over neighbouring rows."""
    whole = stack(of.system.W, of.scales) @ of.gauge.B
    A, residual = whole[:, :-1], whole @ np.append(v, 1.0)
    Z = A if instruments is None else (stack(instruments, of.scales) @ of.gauge.B)[:, :-1]
    units = np.linalg.norm(A, axis=0)
    A, Z = A / units, Z / np.linalg.norm(Z, axis=0)
    scores = Z * (weights * residual)[:, None]
    parts = np.split(scores, np.cumsum([len(W) for W in of.system.W])[:-1])
    omega = np.sum([bartlett_long_run(part, lags - 1) for part in parts], axis=0)
    inverse = np.linalg.pinv((Z * weights[:, None]).T @ A)
    return np.asarray(inverse @ omega @ inverse.T / np.outer(units, units))


def fit_percents(system: System, beta: FloatArray) -> dict[str, float]:
    """100 (1 − rms(residual)/rms(largest term)) of each equation that has rows."""
    percents = {}
    for name, W in zip(system.equations, system.W, strict=True):
        if len(W):
            largest = np.sqrt(np.mean((W * beta) ** 2, axis=0)).max()
            percents[name] = 100.0 * (1.0 - math.sqrt(float(np.mean((W @ beta) ** 2))) / max(float(largest), 1e-300))
    return percents
