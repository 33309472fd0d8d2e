"""Voltages that a design may apply: each stays within its peak and keeps its value from sample to sample.

A signal does not depend on the duration, so a shorter experiment is the beginning of a longer one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import InputError, at_least
from fracid.findings import Words

SAYS = Words("experiments/space.toml")

PARTS_OF_PEAK = (1.0, 0.5, 0.25)
"""Amplitudes that a design tries, as parts of the peak."""


@dataclass(frozen=True)
class _Band:
    """Frequencies from one to another."""

    low: float
    """Lowest frequency [Hz]."""
    high: float
    """Highest frequency [Hz]."""
    peak: float
    """Largest magnitude, in the unit of the input [V]."""

    def __post_init__(self) -> None:
        """Refuse what is no signal."""
        if not (0 < self.low <= self.high < np.inf and 0 < self.peak < np.inf):
            raise InputError(SAYS("band", e=self))

    def variants(self, levels: int) -> tuple[Self, ...]:  # noqa: ARG002 (as every signal)
        """Concrete signals that a design compares: the whole band and its two halves, each with some amplitudes."""
        middle = float(np.sqrt(self.low * self.high))
        bands = [(self.low, self.high)]
        bands += [] if middle in bands[0] else [(self.low, middle), (middle, self.high)]
        return tuple(replace(self, low=a, high=b, peak=part * self.peak) for a, b in bands for part in PARTS_OF_PEAK)


@dataclass(frozen=True)
class Multisine(_Band):
    """A sum of sines, spaced evenly in the logarithm of the frequency, with Schroeder's phases.

    With one line it is a sine, whose frequency between `low` and `high` the design chooses.

    Raises
    ------
    InputError
        If the band, the peak or the number of lines is not possible.

    Examples
    --------
    >>> u = Multisine(0.2, 8.0, peak=6.0).signal(np.arange(0, 20, 0.002))
    >>> bool(5.0 < np.max(np.abs(u)) <= 6.0)
    True
    >>> [round(v.low, 2) for v in Multisine(1.0, 4.0, peak=1.0, lines=1).variants(3) if v.peak == 1.0]
    [1.0, 2.0, 4.0]
    """

    lines: int = 12
    """How many sines."""

    def __post_init__(self) -> None:
        """Refuse what is no signal."""
        super().__post_init__()
        at_least("lines", self.lines, 1, 1000)

    def variants(self, levels: int) -> tuple[Self, ...]:
        """Concrete signals that a design compares: bands and amplitudes, or of one line its frequencies."""
        if self.lines > 1:
            return super().variants(levels)
        frequencies = np.geomspace(self.low, self.high, levels if self.high > self.low else 1).tolist()
        return tuple(replace(self, low=f, high=f, peak=part * self.peak) for f in frequencies for part in PARTS_OF_PEAK)

    def signal(self, time: FloatArray) -> FloatArray:
        """u at some times [s], shape (n_samples,)."""
        k = np.arange(self.lines)
        frequency = np.geomspace(self.low, self.high, self.lines) if self.lines > 1 else np.array([self.low])
        phase = -np.pi * k * (k - 1) / self.lines
        # the crest is that of a long record, so that the signal is the same for every duration
        crest_time = np.arange(0.0, 20.0 / self.low, 0.05 / self.high)
        crest = max(float(np.max(np.abs(_sines(crest_time, frequency, phase)))), 1e-300)
        return np.clip(self.peak / crest * _sines(time, frequency, phase), -self.peak, self.peak)

    def __str__(self) -> str:
        """``multisine 0.2–8 Hz, peak 6``."""
        if self.low == self.high:
            return f"sine {self.low:.4g} Hz, peak {self.peak:.3g}"
        return f"multisine {self.low:.3g}–{self.high:.3g} Hz, {self.lines} lines, peak {self.peak:.3g}"


@dataclass(frozen=True)
class Chirp(_Band):
    """A sine whose frequency rises from `low` to `high`, evenly in its logarithm, again and again.

    Raises
    ------
    InputError
        If the band, the peak or the sweep is not possible.

    Examples
    --------
    >>> u = Chirp(0.3, 4.0, peak=2.0, sweep=5.0).signal(np.array([0.0, 5.0]))
    >>> u.round(6).tolist()
    [0.0, 0.0]
    """

    sweep: float = 10.0
    """Duration of one rise [s]."""

    def __post_init__(self) -> None:
        """Refuse what is no signal."""
        super().__post_init__()
        if not (self.sweep > 0 and self.high > self.low):
            raise InputError(SAYS("chirp", low=self.low, high=self.high, sweep=self.sweep))

    def signal(self, time: FloatArray) -> FloatArray:
        """u at some times [s], shape (n_samples,)."""
        rise = np.log(self.high / self.low)
        turns = self.low * self.sweep / rise * np.expm1(rise * (time % self.sweep) / self.sweep)
        return np.asarray(self.peak * np.sin(2 * np.pi * turns))

    def __str__(self) -> str:
        """``chirp 0.3–4 Hz in 10 s, peak 2``."""
        return f"chirp {self.low:.3g}–{self.high:.3g} Hz in {self.sweep:.3g} s, peak {self.peak:.3g}"


@dataclass(frozen=True)
class Pulses:
    """Rectangular pulses of alternating sign, each followed by a rest of three times its width.

    Raises
    ------
    InputError
        If the widths or the peak are not possible.

    Examples
    --------
    >>> Pulses(0.5, 0.5, peak=3.0).signal(np.array([0.0, 1.0, 2.0, 3.0, 4.0])).tolist()
    [3.0, 0.0, -3.0, 0.0, 3.0]
    """

    shortest: float
    """Narrowest pulse [s]."""
    longest: float
    """Widest pulse [s]."""
    peak: float
    """Largest magnitude, in the unit of the input [V]."""

    def __post_init__(self) -> None:
        """Refuse what is no signal."""
        if not (0 < self.shortest <= self.longest < np.inf and 0 < self.peak < np.inf):
            raise InputError(SAYS("pulses", shortest=self.shortest, longest=self.longest, peak=self.peak))

    def variants(self, levels: int) -> tuple[Pulses, ...]:
        """Concrete signals that a design compares: widths and amplitudes."""
        count = min(levels, 4) if self.longest > self.shortest else 1
        widths = np.geomspace(self.shortest, self.longest, count).tolist()
        return tuple(Pulses(w, w, part * self.peak) for w in widths for part in PARTS_OF_PEAK)

    def signal(self, time: FloatArray) -> FloatArray:
        """u at some times [s], shape (n_samples,)."""
        place = np.mod(time / self.shortest + 1e-9, 8.0)
        return self.peak * ((place < 1.0).astype(np.float64) - ((place >= 4.0) & (place < 5.0)))

    def __str__(self) -> str:
        """``pulses of 0.5 s, peak 3``."""
        return f"pulses of {self.shortest:.3g} s, peak {self.peak:.3g}"


Excitation = Multisine | Chirp | Pulses


def _sines(time: FloatArray, frequency: FloatArray, phase: FloatArray) -> FloatArray:
    lines = zip(frequency.tolist(), phase.tolist(), strict=True)
    return np.asarray(sum(np.sin(2 * np.pi * f * time + φ) for f, φ in lines))
