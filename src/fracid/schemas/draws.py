"""posterior.json: how probable the values of the free parameters are, and the evidence of the model."""

from __future__ import annotations

from dataclasses import dataclass

from fracid.safety.schema import Block, Interval, Number, Record, also_called


class PriorBlock(Block):
    """What was known of a parameter beforehand."""

    kind: str
    lower: Number
    upper: Number
    mean: Number = None
    sd: Number = None


class DrawnBlock(Block):
    """The posterior of one parameter."""

    unit: str
    fitted: float
    mean: float
    median: float
    standard_deviation: float
    interval95: Interval
    prior: PriorBlock


@dataclass(frozen=True)
class PosteriorBlock(Record):
    """Draws of the free parameters, without the draws."""

    method: str
    draws: int
    effective_draws: float
    simulations: int
    khat: Number
    khat_limit: Number
    trusted: bool
    log_evidence: Number
    evidence_error: Number
    effective_samples: float
    degrees_of_freedom: float
    seed: int
    sentence: str
    notes: list[str]
    unknowns: dict[str, DrawnBlock]
    free_parameters = also_called("unknowns", dict[str, DrawnBlock])

    def incoherence(self) -> str:
        """Counts that cannot be."""
        return "" if 0 < self.effective_draws <= 1.001 * self.draws else "its counts are not possible"
