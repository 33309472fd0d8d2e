"""Measures of a recording: of its clock (step, jitter, gaps) and of each signal (resolution, noise, rest).

======================  ================================================================================
:func:`measure_clock`   the median step h; a gap is a difference of more than 1.5 h; jitter is the
                        scatter of all other differences
:func:`measure_signal`  the resolution q, the spacing of the lattice on which the values lie; 2π/q as a
                        number of encoder counts; noise by third differences; the mean of the last 5 %
                        of the samples, and whether they are at rest
======================  ================================================================================

They state numbers and judge nothing: :mod:`fracid.recording.faults` turns them into findings.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fracid.arrays import FloatArray
from fracid.signals.noise import white_noise
from fracid.signals.resolution import Lattice, encoder_lattice
from fracid.signals.swing import tail

FAMILIAR_COUNTS = tuple(
    sorted({2**k for k in range(8, 25)} | {4 * n for n in (250, 360, 500, 600, 1000, 1250, 2000, 2500, 5000)})
)
"""Encoder counts per turn that are sold."""

PENDULUM = "alpha"
"""The signal that is a pendulum's angle, where no model is there to say which."""

WHOLE = 1e-7
"""Relative: a number of counts this near to a whole one is it, if its own doubt is no larger."""

UNIFORM = 0.01
"""Largest relative departure from the step on a uniform grid."""

GAP = 1.5
"""A difference of time above this many steps is a gap."""

CROWDED = 3.0
"""Samples of one quarter of a recording that lie so much closer than those of another are meant to."""


@dataclass(frozen=True)
class Clock:
    """How regular the time stamps are."""

    samples: int
    duration: float
    """[s]"""
    step: float
    """Median difference of the time stamps [s]; NaN without two that increase."""
    jitter: float
    """Standard deviation of the differences, gaps left out [s]."""
    worst_jitter: float
    """Largest departure of a difference from the step, relative, gaps left out."""
    gaps: tuple[tuple[float, float], ...]
    """(time of the last sample before it, its length), both [s]."""
    duplicated: tuple[float, ...]
    """Stamps that repeat the one before [s]."""
    backward: tuple[tuple[int, float, float], ...]
    """(row, counted from 1, its stamp, the one before) of stamps that lie before the one before [s]."""
    crowded: bool = False
    """Whether samples crowd in a quarter of the recording, as those of a relaxation do."""

    @property
    def rate(self) -> float:
        """Samples a second [Hz]."""
        return 1 / self.step

    @property
    def uniform(self) -> bool:
        """Whether every difference lies within 1 % of the step."""
        return not (self.gaps or self.duplicated or self.backward) and self.worst_jitter <= UNIFORM


@dataclass(frozen=True)
class SignalReport:
    """What one signal is worth; every value in the signal's unit."""

    name: str
    unit: str
    minimum: float
    maximum: float
    missing: tuple[float, ...]
    """Times of the samples that are NaN or infinite [s]."""
    resolution: float | None = None
    """Spacing of the lattice on which the values lie; None where there is none, or one that noise buries."""
    counts_per_turn: int | None = None
    """2π/resolution, to the nearest number that encoders have (within 2 %), or a whole number; else None."""
    noise: float = math.nan
    """Standard deviation of what is not motion, quantisation included."""
    rest: float = math.nan
    """Mean of the tail: the last 5 % of the samples."""
    at_rest: bool = False
    """Whether the tail is still."""
    rest_offset: float | None = None
    """Rest value less the nearest multiple of π; None unless an angle at rest."""

    @property
    def range(self) -> float:
        """Largest less smallest value."""
        return self.maximum - self.minimum


def is_pendulum(name: str) -> bool:
    """Whether a signal is called the pendulum's angle, as a header may have it with its unit.

    Examples
    --------
    >>> is_pendulum("alpha"), is_pendulum("alpha [deg]"), is_pendulum("alpha_dot")
    (True, True, False)
    """
    return name.partition(" ")[0] == PENDULUM


def measure_clock(time: FloatArray) -> Clock:
    """Measure step, jitter, gaps and order of time stamps, shape (n_samples,) [s].

    Examples
    --------
    >>> measure_clock(np.array([0.0, 0.1, 0.2, 0.5, 0.6])).gaps
    ((0.2, 0.3),)
    """
    dt = np.diff(time)
    step = float(np.median(dt[dt > 0])) if np.any(dt > 0) else math.nan
    gap = dt > GAP * step
    even = dt[(dt > 0) & ~gap]
    quarters = [float(np.median(part)) for part in np.array_split(dt, 4) if part.size]
    return Clock(
        samples=time.size, duration=float(time[-1] - time[0]) if time.size else 0.0, step=step,
        jitter=float(np.std(even)) if even.size else math.nan,
        worst_jitter=float(np.max(np.abs(even / step - 1))) if even.size else math.nan,
        gaps=tuple((float(t), round(float(d), 9)) for t, d in zip(time[:-1][gap], dt[gap], strict=True)),
        duplicated=tuple(map(float, time[1:][dt == 0])),
        backward=tuple((k + 2, float(time[k + 1]), float(time[k])) for k in np.flatnonzero(dt < 0).tolist()),
        crowded=max(quarters, default=0.0) > CROWDED * min(quarters, default=0.0),
    )  # fmt: skip


def measure_signal(name: str, unit: str, time: FloatArray, signal: FloatArray, sound: FloatArray) -> SignalReport:
    """Measure one signal, shape (n_samples,), or what is sound of it: what drops out is in the file, and not missing.

    Examples
    --------
    >>> t = np.arange(1000) / 100
    >>> counts = np.round(300 * np.cos(t)) * 2 * np.pi / 4096
    >>> measure_signal("alpha", "rad", t, counts, counts).counts_per_turn
    4096
    """
    missing = tuple(map(float, time[~np.isfinite(signal)]))
    x = sound[np.isfinite(sound)]
    if x.size < 2:
        return SignalReport(name, unit, math.nan, math.nan, missing)
    q = encoder_lattice(x)
    rest, _, at_rest = tail(x)
    return SignalReport(
        name, unit, minimum=float(x.min()), maximum=float(x.max()), missing=missing, resolution=q and q.step,
        counts_per_turn=_counts_per_turn(q) if q and unit == "rad" else None, noise=_noise(time, sound),
        rest=rest, at_rest=at_rest,
        rest_offset=rest - math.pi * round(rest / math.pi) if at_rest and unit == "rad" else None,
    )  # fmt: skip


def _noise(time: FloatArray, signal: FloatArray) -> float:
    """:func:`white_noise` of the stretches without gaps and blanks: over a gap a motion leaves a third difference."""
    dt = np.diff(time)
    even = dt <= (GAP * np.median(dt[dt > 0]) if np.any(dt > 0) else -math.inf)
    rough = np.diff(signal, 3)[even[:-2] & even[1:-1] & even[2:]] if signal.size > 3 else signal[:0]
    rough = rough[np.isfinite(rough)]
    if 2 * rough.size < signal.size:  # uneven throughout: no stretch says more than the whole
        return white_noise(signal[np.isfinite(signal)])
    return float(np.sqrt(np.mean(rough**2) / 20))


def _counts_per_turn(q: Lattice) -> int | None:
    counts = 2 * math.pi / q.step
    nearest = min(FAMILIAR_COUNTS, key=lambda n: abs(math.log(n / counts)))
    if abs(nearest / counts - 1) < 0.02:
        return nearest
    doubt = max(3 * q.error / q.step, WHOLE) * counts
    return round(counts) if abs(counts - round(counts)) < doubt < 0.1 else None
