"""The swing in a sampled signal: its period and envelope, its release, its rest at the end."""

from __future__ import annotations

import math

import numpy as np

from fracid.arrays import FloatArray
from fracid.signals.resolution import resolution

__all__ = ["count_swings", "envelope", "release_time", "swing_frequency", "tail"]


def envelope(swing: FloatArray, period: int) -> FloatArray:
    """Half the range over a period about each sample [rad], shape (n,).

    Examples
    --------
    >>> t = np.arange(2000) / 100
    >>> size = envelope(3.0 + 0.5 * np.cos(2 * np.pi * t), 100)
    >>> round(float(size.min()), 3), round(float(size.max()), 3)
    (0.5, 0.5)
    """
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    width = period + 1 if period % 2 == 0 else period
    return np.asarray(0.5 * (maximum_filter1d(swing, width) - minimum_filter1d(swing, width)))


def count_swings(y: FloatArray) -> tuple[float, float, int]:
    """How often a signal swings by over a tenth of its largest swing, its period, and where it begins [samples]."""
    rest, _, at_rest = tail(y)
    away = y - (rest if at_rest else float(np.median(y)))
    side = np.sign(away) * (np.abs(away) > 0.1 * np.max(np.abs(away)))
    there = np.flatnonzero(side)
    turns = there[1:][np.diff(side[there]) != 0]
    moved = np.flatnonzero(np.abs(y - y[0]) > 0.05 * np.ptp(y))
    period = 2.0 * float(np.median(np.diff(turns))) if turns.size > 1 else math.inf
    return turns.size / 2, period, int(moved[0]) if moved.size else 0


def swing_frequency(signals: FloatArray, step: float) -> float:
    """Where the spectrum of the fastest signal's speed has its peak [Hz]; three periods a record at least.

    The speed knows nothing of a plateau, whose long offset would be the slowest swing of all.
    """
    speed = np.diff(signals[:, np.argmax(np.std(signals, axis=0))])
    spectrum = np.abs(np.fft.rfft(speed - np.mean(speed)))
    return max(3, int(np.argmax(spectrum))) / (len(speed) * step)


HELD = 0.6
"""A plateau at least this long against the way to full speed was held."""


def tail(signal: FloatArray) -> tuple[float, float, bool]:
    """Return mean and peak-to-peak of the last 5 % of the samples, and whether they are at rest.

    At rest is a motion below 1 % of the whole range, or within three steps of the lattice.
    """
    x = signal[np.isfinite(signal)]
    if not x.size:
        return math.nan, math.nan, False
    end = x[-max(2, x.size // 20) :]
    motion = float(np.ptp(end))
    return (
        float(np.mean(end)),
        motion,
        motion <= max(0.01 * float(np.ptp(x)), 3 * (resolution(x) or 0.0) * (1 + 1e-9)),
    )


def release_time(time: FloatArray, signal: FloatArray) -> tuple[float | None, str]:
    """Find the last sample of the held plateau before the fastest motion.

    Parameters
    ----------
    time, signal : ndarray, shape (n_samples,)
        Increasing time [s] and the pendulum's angle.

    Returns
    -------
    release : float or None
        [s]
    reason : str
        How long it was held, or why there is no release.

    Examples
    --------
    >>> t = np.linspace(0, 4, 401)
    >>> release_time(t, np.sin(6 * t))
    (None, 'the pendulum is not held still before its fastest motion')
    """
    seen = np.isfinite(signal)
    t, x = time[seen], signal[seen]
    if x.size < 10 or np.ptp(x) == 0:
        return None, "nothing moves"
    speed = _speed(t, x)
    fastest = int(np.argmax(speed >= 0.95 * speed.max()))  # the first, should many be alike
    slow = np.flatnonzero(speed[:fastest] < 0.05 * speed[fastest])
    mid_swing = "the pendulum is not held still before its fastest motion"
    if not slow.size:
        return None, mid_swing
    last = int(slow[-1])
    travel, quarter = abs(x[fastest] - x[last]), t[fastest] - t[last]
    away = np.flatnonzero(np.abs(x[:last] - x[last]) > 0.05 * travel)
    held = float(t[last] - t[away[-1] + 1 if away.size else 0])
    if held < HELD * quarter:
        return None, mid_swing
    return float(t[last]), f"held for {held:.2f} s before"


def _speed(t: FloatArray, x: FloatArray) -> FloatArray:
    """Return |dx/dt| by central differences, zero at the ends."""
    # over 20 ms: one encoder step within one sample is no motion
    w = max(1, round(min(0.01 / float(np.median(np.diff(t))), x.size)))
    w = min(w, (x.size - 1) // 2)
    speed = np.zeros_like(x)
    speed[w:-w] = np.abs((x[2 * w :] - x[: -2 * w]) / (t[2 * w :] - t[: -2 * w]))
    return speed
