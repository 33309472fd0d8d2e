"""The records of a residual analysis: whiteness, spectrum, normality, variance, level; and residuals.json."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from fracid.arrays import FloatArray
from fracid.cards import Card, CardDisplay
from fracid.safety.schema import UNREAD, Beside, Block, Number, Record, Unknown
from fracid.signals.left_over import ROUNDING, SIGNIFICANT

ENOUGH = 20
"""Independent samples below which a p-value is not given."""

UNEQUAL = 1.5
"""Ratio of two spreads that is worth naming."""

NAN = math.nan

QUESTIONS = ("whiteness", "spectrum", "normality", "variance", "level")
"""In the order in which their answers should be read."""


@dataclass(frozen=True)
class Answer(Record):
    """What a test says of a residual."""

    sentence: str
    """What it means and what to do."""


@dataclass(frozen=True)
class Whiteness(Answer):
    """Whether the residual is correlated in time, and how much of it counts."""

    white: bool = False
    """No correlation is seen, or too little to matter."""
    lags: int = 0
    """Of the portmanteau test."""
    statistic: Unknown = NAN
    """Its Q."""
    p_value: Unknown = NAN
    """On all samples; of whiteness itself, so it needs no thinning."""
    lag_one: Unknown = NAN
    """Correlation of neighbours."""
    correlation_time: Unknown = NAN
    """T [s]."""
    effective_samples: Unknown = NAN
    """As many independent ones would know as much."""
    thinning: int = 0
    """k: the tests below have every k-th sample."""
    thinned_samples: int = 0
    thinned_p_value: Unknown = NAN
    """Of that test on the thinned residual: a small one says that it is not thin enough."""


@dataclass(frozen=True)
class Line(Record):
    """A frequency that stands out."""

    frequency: Unknown
    """[Hz]"""
    share: Unknown
    """Of the power, within a tenth of the frequency, less what white noise has there."""
    harmonic: int | None
    """Which multiple of the swing's frequency it is, 1 to 5; None if it is none."""


@dataclass(frozen=True)
class Spectrum(Answer):
    """At which frequencies the residual has its power."""

    swing: Number = None
    """Where the fitted motion has its peak [Hz]; None if it does not swing."""
    slow_share: Unknown = NAN
    """Of the power, slower than :attr:`slow_below`."""
    slow_below: Unknown = NAN
    """A third of the swing, or three periods a record [Hz]."""
    peak: Unknown = NAN
    """The strongest frequency above that [Hz]."""
    peak_share: Unknown = NAN
    """Its share of the power."""
    line: Line | None = None
    """The strongest frequency, if it stands out."""
    swing_share: Beside[float] = NAN
    """Of the power, in the band of the swing, beyond what white noise has there."""


@dataclass(frozen=True)
class Normality(Answer):
    """Whether the residual is distributed normally."""

    ppcc: Unknown = NAN
    """Of all samples: 1 for normal."""
    skewness: Unknown = NAN
    excess_kurtosis: Unknown = NAN
    """0 for normal; −1.2 for rounding, −1.5 for a sine, 3 for Laplace's."""
    anderson_darling: Unknown = NAN
    """A² of the thinned residual."""
    p_value: Unknown = NAN
    """Of A²; NaN where too few samples are independent."""


@dataclass(frozen=True)
class Contrast(Record):
    """The residual's spread where something is large, beside that where it is small."""

    ratio: Unknown = NAN
    """rms about the mean in the upper third, divided by that in the lower."""
    p_value: Unknown = NAN
    """On the thinned residual; where it is too short, of F with as many degrees of freedom as samples count."""

    @property
    def uneven(self) -> bool:
        """Whether it is large enough to be named."""
        return max(self.ratio, 1 / self.ratio) > UNEQUAL

    @property
    def sure(self) -> bool:
        """Whether it is, and is no chance."""
        return self.uneven and self.p_value < SIGNIFICANT


@dataclass(frozen=True)
class Variance(Answer):
    """Whether the residual scatters alike throughout."""

    late_to_early: Contrast = Contrast()
    """Last third of the record to its first; Mann and Whitney's test of the sizes."""
    far_to_near: Contrast = Contrast()
    """By the distance of the fitted value from its mean; Breusch-Pagan."""
    fast_to_slow: Contrast = Contrast()
    """By the size of the fitted speed; Breusch-Pagan."""

    @property
    def contrasts(self) -> tuple[Contrast, Contrast, Contrast]:
        """The three, in that order."""
        return self.late_to_early, self.far_to_near, self.fast_to_slow


@dataclass(frozen=True)
class Level(Answer):
    """How large the residual is, beside the encoder."""

    mean: Unknown = NAN
    """[rad]"""
    rms: Unknown = NAN
    """[rad]"""
    encoder_step: Number = None
    """[rad]; None if there is none, or none is seen."""
    steps: Unknown = NAN
    """rms in steps of the encoder."""
    floor: Unknown = NAN
    """What rounding alone leaves, step/√12 [rad]."""

    @property
    def rounding(self) -> bool:
        """Whether it may be the encoder's rounding alone, as :attr:`fracid.signals.left_over.LeftOver.explained`."""
        return self.rms < ROUNDING * self.floor


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


@dataclass(frozen=True, repr=False)
class ResidualAnalysis(CardDisplay, Record):
    """What :func:`residual_analysis` found."""

    recording: str
    """Its name."""
    output: str
    use: str
    """``fit`` or ``validate``."""
    samples: int
    """Looked at: the longest stretch without a gap."""
    missing: int
    """Samples that were not: without a simulated value, or beyond a gap of such."""
    step: Unknown
    """Between samples [s]."""
    whiteness: Whiteness
    spectrum: Spectrum
    normality: Normality
    variance: Variance
    level: Level
    unit: str = "rad"
    """Unit of the residual."""
    curves: Beside[ResidualCurves | None] = field(default=UNREAD, compare=False)
    """What is drawn of it; None where it cannot be tested, and of what was read."""

    @property
    def tested(self) -> str:
        """Which part of the recording is tested, in words."""
        return f"tested: the longest stretch without a gap, {self.samples:,} of {self.samples + self.missing:,} samples"

    @property
    def sentences(self) -> dict[str, str]:
        """Each question's line of plain words, in the order in which they should be read."""
        return {name: text for name in QUESTIONS if (text := getattr(self, name).sentence)}

    def _card(self) -> Card:
        return Card(f"Residual of {self.recording}, {self.output} ({self.use})", tuple(self.sentences.items()))


class ResidualsBlock(Block):
    """residuals.json: the analyses of a run, recording → output → analysis."""

    notes: list[str]
    recordings: dict[str, dict[str, ResidualAnalysis]]
