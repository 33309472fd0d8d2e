"""What a fit leaves over of one output: noise, the encoder's rounding, or something that the model lacks."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fracid.arrays import FloatArray
from fracid.safety.schema import Infinite, Record
from fracid.signals.correlation import autocorrelation, box_pierce, correlation_time, longest_stretch
from fracid.signals.resolution import resolution

NEXT_TO_WHITE = 0.75
"""Where so large a part of the samples counts, correlation does not matter: it widens intervals by a seventh."""

ROUNDING = 2.0
"""Times what rounding a motion leaves: up to there it may be rounding alone, for a rest is wrong by up to 1.7 times."""


HALF, COUNTS = 50.0, 10.0
"""A model does not fit where it follows less of a motion than this [%], and is off by more than so many roundings, some
three steps of the encoder: a joint that hardly moves is followed by none."""

SHORT, TESTABLE = 8, 30
"""Samples, of which fewer show no correlation, and of which fewer cannot be tested for it."""

SIGNIFICANT = 0.05
"""A p-value below this is said to be no chance."""

NOTHING = 1e-5
"""Part of the motion below which it is arithmetic."""


@dataclass(frozen=True)
class LeftOver(Record):
    """The size and the correlation of a residual."""

    rms: Infinite
    """In the output's unit."""
    floor: float
    """What the encoder's rounding leaves of a motion, a step over √12; 0 where no step is seen."""
    part: float
    """Of its samples that counts: 1 where it is white."""
    known: bool = False
    """Whether it is in standard deviations that the recording has; its floor is then one of them."""
    fit: float = 100.0
    """Of the motion, 100·(1 − residual/motion) [%]."""
    coloured: bool = False
    """Whether it is correlated as noise is, alike wherever the motion goes (:mod:`fracid.signals.coloured`)."""
    inputs: str = ""
    """The recorded inputs whose noise makes it so, in words (:mod:`fracid.estimation.input_noise`); "" for none."""

    @property
    def noise(self) -> bool:
        """Whether nothing says that a model lacks something: it is explained, or correlated as noise is."""
        return self.explained or self.coloured

    @property
    def white(self) -> bool:
        """Whether neighbours know next to nothing of each other."""
        return self.part >= NEXT_TO_WHITE

    @property
    def explained(self) -> bool:
        """Whether it may be noise and rounding, or is within the standard deviations that the recording has."""
        return self.white or self.rms < (1.0 if self.known else ROUNDING) * self.floor

    @property
    def fits(self) -> bool:
        """True if the model follows the motion, or its residual is noise."""
        return self.explained or self.fit >= HALF or self.times < COUNTS

    @property
    def times(self) -> float:
        """How many times the rounding it is; infinite where no step is seen."""
        return self.rms / self.floor if self.floor > 0.0 else math.inf


def left_over(residual: FloatArray, measured: FloatArray, *, known: bool = False) -> LeftOver:
    """Size and correlation of the longest stretch of a residual without a gap.

    Parameters
    ----------
    residual, measured : array, shape (n_samples,)
        NaN where nothing was simulated; the encoder's step is read off the measured samples.
    known : bool
        Whether the residual is in known standard deviations of the samples.

    Examples
    --------
    A swing that is rounded, and the same with a swing left over:

    >>> t = np.arange(0, 20, 0.01)
    >>> y = np.exp(-t / 9) * np.cos(6 * t)
    >>> counts = np.round(y / 1e-3) * 1e-3
    >>> left_over(counts - y, counts).explained, left_over(counts - 1.02 * y, counts).explained
    (True, False)
    """
    e = residual[longest_stretch(np.isfinite(residual))]
    floor = 1.0 if known else (resolution(measured[np.isfinite(measured)]) or 0.0) / math.sqrt(12)
    rms = float(np.sqrt(np.mean(e**2))) if e.size else math.inf
    nothing = rms <= NOTHING * (1.0 if known else float(np.std(measured)))
    if nothing or (e.size >= TESTABLE and np.ptp(e) > 0.0 and box_pierce(e)[2] >= SIGNIFICANT):
        return LeftOver(rms, floor, 1.0, known)
    short = e.size < SHORT or np.ptp(e) == 0.0
    return LeftOver(rms, floor, 0.0 if short else 1.0 / correlation_time(autocorrelation(e)), known)
