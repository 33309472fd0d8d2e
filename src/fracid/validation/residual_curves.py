"""What is drawn of a residual: its autocorrelation, its spectrum and its normal probability plot, each thinned."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fracid.arrays import FloatArray
from fracid.estimation.records import RecordingFit
from fracid.signals.correlation import autocorrelation, longest_stretch, power_spectrum
from fracid.validation.residual_records import ResidualAnalysis
from fracid.validation.residual_tests import normal_quantiles

LAGS, BINS, RANKS = 160, 120, 120
"""Points of each curve, at most."""

SHORTEST = 40
"""Lags that are shown at least; eight correlation times are, where that is longer."""


@dataclass(frozen=True)
class ResidualCurves:
    """Three curves of a residual."""

    lag: FloatArray
    """[s]"""
    correlation: FloatArray
    """At these lags."""
    white: float
    """95 % of the correlations of white noise lie between minus this and this."""
    frequency: FloatArray
    """[Hz]; empty for uneven samples."""
    power: FloatArray
    """[unit²/Hz], each the mean of a bin; the bins are even in the logarithm."""
    quantile: FloatArray
    """Of the standard normal distribution."""
    ordered: FloatArray
    """The residual about its mean, in its standard deviations, at these quantiles."""


def residual_curves(recording: RecordingFit, analysis: ResidualAnalysis) -> ResidualCurves | None:
    """The curves of one output's residual, on the longest stretch without a gap; None where nothing can be tested.

    Examples
    --------
    >>> from fracid.estimation.records import RecordingFit
    >>> from fracid.validation.residuals import residual_analysis
    >>> t, noise = np.arange(0, 20, 1e-2), np.random.default_rng(1).normal(size=2000)
    >>> twin = RecordingFit("twin", "fit", t, {"alpha": 0.01 * noise}, {"alpha": 0 * t}, 0.01, {}, {})
    >>> curves = residual_curves(twin, residual_analysis(twin, "alpha", {}))
    >>> bool(abs(curves.correlation[1]) < curves.white), curves.quantile.size, round(float(curves.ordered[-1]), 1)
    (True, 120, 3.7)
    """
    if not analysis.whiteness.thinning:
        return None
    whole = recording.residual(analysis.output)
    e = whole[longest_stretch(np.isfinite(whole))]
    ρ = autocorrelation(e)
    count = min(ρ.size, max(SHORTEST, int(8 * analysis.whiteness.correlation_time / analysis.step)))
    lags = np.unique(np.linspace(0, count - 1, min(count, LAGS)).astype(int))
    frequency, power = np.empty(0), np.empty(0)
    if analysis.spectrum.sentence:
        f, S = power_spectrum(e, analysis.step)
        frequency, power = log_bins(f[1:], S[1:])
    ranks = np.unique(np.linspace(0, e.size - 1, min(e.size, RANKS)).astype(int))
    return ResidualCurves(
        lags * analysis.step, ρ[lags], float(1.96 / np.sqrt(e.size)), frequency, power,
        normal_quantiles(e.size)[ranks],
        np.sort(e - e.mean())[ranks] / max(float(e.std()), 1e-300),
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
