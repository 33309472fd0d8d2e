"""What is drawn of a residual: its autocorrelation, its spectrum and its normal probability plot, each thinned."""

from __future__ import annotations

import numpy as np

from fracid.arrays import FloatArray
from fracid.signals.correlation import power_spectrum
from fracid.validation.residual_records import ResidualCurves
from fracid.validation.residual_tests import normal_quantiles

LAGS, BINS, RANKS = 160, 120, 120
"""Points of each curve, at most."""

SHORTEST = 40
"""Lags that are shown at least; eight correlation times are, where that is longer."""


def residual_curves(e: FloatArray, ρ: FloatArray, step: float, time: float, *, even: bool) -> ResidualCurves:
    """The curves of a residual with this autocorrelation and correlation time [s].

    Examples
    --------
    >>> from fracid.signals.correlation import autocorrelation
    >>> e = np.random.default_rng(1).normal(size=2000)
    >>> curves = residual_curves(e, autocorrelation(e), 1e-2, 1e-2, even=True)
    >>> bool(abs(curves.correlation[1]) < curves.white), curves.quantile.size, round(float(curves.ordered[-1]), 1)
    (True, 120, 3.7)
    """
    count = min(ρ.size, max(SHORTEST, int(8 * time / step)))
    lags = np.unique(np.linspace(0, count - 1, min(count, LAGS)).astype(int))
    frequency, power = np.empty(0), np.empty(0)
    if even:
        f, S = power_spectrum(e, step)
        frequency, power = log_bins(f[1:], S[1:])
    ranks = np.unique(np.linspace(0, e.size - 1, min(e.size, RANKS)).astype(int))
    return ResidualCurves(
        lags * step, ρ[lags], float(1.96 / np.sqrt(e.size)), frequency, power=power,
        quantile=normal_quantiles(e.size)[ranks], ordered=np.sort(e - e.mean())[ranks] / max(float(e.std()), 1e-300),
    )  # fmt: skip


def log_bins(f: FloatArray, S: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A spectrum averaged over bins of equal width in log f, the few lowest frequencies as they are.

    Examples
    --------
    >>> f, S = log_bins(np.arange(1.0, 1001.0), np.ones(1000))
    >>> f.size < 120, float(S.max())
    (True, 1.0)
    """
    edges = np.geomspace(f[0], f[-1] * (1 + 1e-9), BINS + 1)
    at = np.clip(np.searchsorted(edges, f, side="right") - 1, 0, BINS - 1)
    count = np.bincount(at, minlength=BINS)
    there = count > 0
    frequency, power = (np.bincount(at, weights=w, minlength=BINS)[there] / count[there] for w in (f, S))
    return frequency, power
