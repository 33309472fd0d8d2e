"""The residual of every output of every recording, tested, and what is drawn of it.

Slow beside all else that a page shows, for what the tests import: a fit leaves it to another process.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fracid.estimation.records import RecordingFit
from fracid.validation.residual_records import ResidualAnalysis
from fracid.validation.residuals import residual_analysis

ANALYSED = 600_000
"""Samples of a residual that are tested, ten minutes at 1 kHz: more tell no more, and take memory and minutes."""


Analyses = Mapping[str, Mapping[str, ResidualAnalysis]]
"""Recording → output → what its residual says."""


def analysed(recordings: Mapping[str, RecordingFit], resolutions: Mapping[str, Mapping[str, Any]]) -> Analyses:
    """Recording → output → its residual; of a very long one, the first :data:`ANALYSED` samples."""
    return {name: {n: residual_analysis(first_part(r), n, resolutions[name]) for n in r.measured}
            for name, r in recordings.items()}  # fmt: skip


def first_part(r: RecordingFit, samples: int = ANALYSED) -> RecordingFit:
    """The first so many samples of a recording and its simulation, without a copy."""
    return r if r.time.size <= samples else r.at(slice(samples))
