"""The residual of every output of every recording, tested."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from fracid.validation.residuals import residual_analysis

if TYPE_CHECKING:
    from fracid.estimation.records import RecordingFit
    from fracid.validation.residual_records import ResidualAnalysis

__all__ = ["Analyses", "analysed", "first_part"]

Analyses = Mapping[str, Mapping[str, "ResidualAnalysis"]]
"""Recording → output → what its residual says."""

ANALYSED = 600_000
"""Samples of a residual that are tested, ten minutes at 1 kHz: more tell no more, and take memory and minutes."""


def analysed(recordings: Mapping[str, RecordingFit], resolutions: Mapping[str, Mapping[str, Any]]) -> Analyses:
    """Recording → output → what its residual says; of a very long one, the first :data:`ANALYSED` samples."""
    return {
        name: {n: residual_analysis(first_part(r), n, resolutions[name]) for n in r.measured}
        for name, r in recordings.items()
    }


def first_part(r: RecordingFit, samples: int = ANALYSED) -> RecordingFit:
    """The first so many samples of a recording and its simulation, without a copy."""
    if r.time.size <= samples:
        return r
    measured, fitted = ({n: y[:samples] for n, y in lines.items()} for lines in (r.measured, r.fitted))
    return replace(r, time=r.time[:samples], measured=measured, fitted=fitted)
