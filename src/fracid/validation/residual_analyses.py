"""The residual of every output of every recording, tested, and what is drawn of it.

Slow beside all else that a page shows, for what the tests import: a fit leaves it to another process.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from fracid.estimation.records import RecordingFit
from fracid.validation.residual_curves import ResidualCurves, residual_curves
from fracid.validation.residual_records import ResidualAnalysis
from fracid.validation.residuals import residual_analysis

ANALYSED = 600_000
"""Samples of a residual that are tested, ten minutes at 1 kHz: more tell no more, and take memory and minutes."""


Analyses = Mapping[str, Mapping[str, "ResidualAnalysis"]]
"""Recording → output → what its residual says."""


@dataclass(frozen=True)
class Residual:
    """One output's residual, as a page shows it."""

    analysis: ResidualAnalysis
    """What it says."""
    curves: ResidualCurves | None
    """What is drawn of it; None where it cannot be tested."""


Residuals = Mapping[str, Mapping[str, Residual]]
"""Recording → output → its residual."""


def analysed(recordings: Mapping[str, RecordingFit], resolutions: Mapping[str, Mapping[str, Any]]) -> Residuals:
    """Recording → output → its residual; of a very long one, the first :data:`ANALYSED` samples."""
    return {name: {n: _analysed(first_part(r), n, resolutions[name]) for n in r.measured}
            for name, r in recordings.items()}  # fmt: skip


def _analysed(recording: RecordingFit, output: str, resolution: Mapping[str, Any]) -> Residual:
    analysis = residual_analysis(recording, output, resolution)
    return Residual(analysis, residual_curves(recording, analysis))


def first_part(r: RecordingFit, samples: int = ANALYSED) -> RecordingFit:
    """The first so many samples of a recording and its simulation, without a copy."""
    if r.time.size <= samples:
        return r
    measured, fitted = ({n: y[:samples] for n, y in lines.items()} for lines in (r.measured, r.fitted))
    return replace(r, time=r.time[:samples], measured=measured, fitted=fitted)
