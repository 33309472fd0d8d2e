"""residuals.json: what each residual says, test by test; angles in radians."""

from __future__ import annotations

from fracid.safety.schema import Block, Number


class WhitenessBlock(Block):
    """Whether the residual is correlated in time."""

    sentence: str
    white: bool
    lags: int
    statistic: Number
    p_value: Number
    lag_one: Number
    correlation_time: Number
    effective_samples: Number
    thinning: int
    thinned_samples: int
    thinned_p_value: Number


class LineBlock(Block):
    """A frequency that stands out."""

    frequency: Number
    share: Number
    harmonic: int | None


class SpectrumBlock(Block):
    """At which frequencies the residual has its power."""

    sentence: str
    swing: Number
    slow_share: Number
    slow_below: Number
    peak: Number
    peak_share: Number
    line: LineBlock | None


class NormalityBlock(Block):
    """Whether the residual is distributed normally."""

    sentence: str
    ppcc: Number
    skewness: Number
    excess_kurtosis: Number
    anderson_darling: Number
    p_value: Number


class ContrastBlock(Block):
    """The spread where something is large, beside that where it is small."""

    ratio: Number
    p_value: Number


class VarianceBlock(Block):
    """Whether the residual scatters alike throughout."""

    sentence: str
    late_to_early: ContrastBlock
    far_to_near: ContrastBlock
    fast_to_slow: ContrastBlock


class LevelBlock(Block):
    """How large the residual is, beside the encoder."""

    sentence: str
    mean: Number
    rms: Number
    encoder_step: Number
    steps: Number
    floor: Number


class AnalysisBlock(Block):
    """The residual of one output in one recording."""

    recording: str
    output: str
    use: str
    samples: int
    missing: int
    step: Number
    whiteness: WhitenessBlock
    spectrum: SpectrumBlock
    normality: NormalityBlock
    variance: VarianceBlock
    level: LevelBlock
    unit: str


class ResidualsBlock(Block):
    """Recording → output → its residual."""

    notes: list[str]
    recordings: dict[str, dict[str, AnalysisBlock]]
