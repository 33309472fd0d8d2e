r"""The samples that the page draws: few enough to be light, enough to look the same.

A line of a million samples is drawn by the least and the greatest of each of some hundred bins: on a screen it is the
same line.  All signals of a recording share their times, so that a cursor and the moving rig can read them together:
the union of every signal's extremes.  Numbers are embedded as little-endian float32 in base64, some 5·10⁻⁸ of their
size apart, a thousandth of any encoder's step; times count from the first sample.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping
from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fracid.arrays import FloatArray
from fracid.report.material import first_part
from fracid.report.sentences import letter

if TYPE_CHECKING:
    from fracid.estimation.records import RecordingFit
    from fracid.recording import Recording
    from fracid.report.material import Material
    from fracid.validation.residual_records import ResidualAnalysis

__all__ = ["base64_floats", "extremes", "traces"]

POINTS = 20_000
"""Of one recording: 35 s at 500 Hz whole."""

ALL_POINTS = 60_000
"""Of all recordings together."""

FEWEST = 400
"""Of one, however many there are."""


def base64_floats(values: FloatArray) -> str:
    """Numbers as base64 of little-endian float32.

    Examples
    --------
    >>> base64_floats(np.array([0.0, 1.0]))
    'AAAAAAAAgD8='
    """
    return base64.b64encode(np.asarray(values, dtype="<f4").tobytes()).decode()


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
        parts += [at + np.where(mask, padded, inf).argmin(axis=1), at + np.where(mask, padded, -inf).argmax(axis=1)]
    indices = np.unique(np.concatenate(parts))
    return indices[indices < n]


def budget(recordings: int) -> int:
    """How many points one of so many recordings may have."""
    return int(min(POINTS, max(FEWEST, ALL_POINTS // max(1, recordings))))


def traces(material: Material) -> list[dict[str, Any]]:
    """What the page's script draws of each recording: measured, fitted and, of the whole file, as recorded."""
    points = budget(len(material.recordings))
    return [
        {
            "name": name,
            "use": r.use,
            **_fitted(material, r, points),
            "whole": _recorded(material, material.as_recorded[name], r, points),
            "residuals": {n: _residual(a, r, material.unit(n)[1]) for n, a in material.analyses[name].items()},
        }
        for name, r in material.recordings.items()
    ]


def _fitted(material: Material, r: RecordingFit, points: int) -> dict[str, Any]:
    lines = [np.asarray(y, dtype=float) for n in r.measured for y in (r.measured[n], r.fitted[n])]
    at = extremes(lines, points)
    return {
        "samples": r.time.size,
        "shown": at.size,
        "start": float(r.time[0]),
        "t": base64_floats((r.time - r.time[0])[at]),
        "outputs": [_output(material, r, n, at) for n in r.measured],
    }


def _output(material: Material, r: RecordingFit, name: str, at: NDArray[np.intp]) -> dict[str, Any]:
    unit, factor = material.unit(name)
    step = material.project.resolutions[r.name].get(name)
    return {
        "name": name,
        "letter": letter(name),
        "unit": unit,
        "perRad": factor,
        "step": None if step is None else factor * step,
        "measured": base64_floats(factor * r.measured[name][at]),
        "fitted": base64_floats(factor * r.fitted[name][at]),
    }


def _recorded(material: Material, whole: Recording, r: RecordingFit, points: int) -> dict[str, Any]:
    names = list(whole.signals)
    at = extremes([np.asarray(y, dtype=float) for y in whole.signals.values()], points // 2)
    units = {n: material.unit(n) for n in names}
    return {
        "t": base64_floats((whole.time - whole.time[0])[at]),
        "start": float(whole.time[0]),
        "window": [float(r.time[0]), float(r.time[-1])],
        "release": whole.report.release,
        "signals": [
            {"name": n, "letter": letter(n), "unit": unit, "y": base64_floats(factor * whole.signals[n][at])}
            for n, (unit, factor) in units.items()
        ],
    }


# --- residuals -----------------------------------------------------------------------------------


def _residual(a: ResidualAnalysis, r: RecordingFit, factor: float) -> dict[str, Mapping[str, Any]] | None:
    """Autocorrelation, spectrum and normal probability plot of one residual; None where there is too little."""
    from scipy.stats import norm

    from fracid.signals.correlation import autocorrelation, longest_stretch, power_spectrum

    whole = first_part(r).residual(a.output)
    e = whole[longest_stretch(np.isfinite(whole))]
    if not a.whiteness.thinning:  # it could not be tested
        return None
    ρ = autocorrelation(e)
    count = min(ρ.size, max(40, int(8 * a.whiteness.correlation_time / a.step)))
    lags = np.unique(np.linspace(0, count - 1, min(count, 160)).astype(int))
    ranks = np.unique(np.linspace(0, e.size - 1, min(e.size, 120)).astype(int))
    quantiles = norm.ppf((ranks + 0.625) / (e.size + 0.25))
    ordered = np.sort(e - e.mean())[ranks] / max(float(e.std()), 1e-300)
    traces: dict[str, Mapping[str, Any]] = {
        "acf": {"x": base64_floats(lags * a.step), "y": base64_floats(ρ[lags]), "band": 1.96 / np.sqrt(e.size)},
        "normal": {"x": base64_floats(quantiles), "y": base64_floats(ordered)},
    }
    if a.spectrum.sentence:  # uneven samples have none
        f, S = power_spectrum(e, a.step)
        spectrum = _log_bins(f[1:], S[1:])
        traces["spectrum"] = {
            "x": base64_floats(spectrum[0]), "y": base64_floats(factor**2 * spectrum[1]), "swing": a.spectrum.swing
        }  # fmt: skip
    return traces


def _log_bins(f: FloatArray, S: FloatArray, bins: int = 120) -> tuple[FloatArray, FloatArray]:
    """A spectrum averaged over bins of equal width in log f, the few lowest frequencies as they are."""
    edges = np.geomspace(f[0], f[-1] * (1 + 1e-9), bins + 1)
    at = np.clip(np.searchsorted(edges, f, side="right") - 1, 0, bins - 1)
    count = np.bincount(at, minlength=bins)
    there = count > 0
    mean = [np.bincount(at, weights=w, minlength=bins)[there] / count[there] for w in (f, S)]
    return mean[0], mean[1]
