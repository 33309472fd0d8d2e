"""The residual of every output of every recording, tested, and what is drawn of it.

Slow beside all else that a page shows, for what the tests import: a fit leaves it to another process.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
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
    if r.time.size <= samples:
        return r
    lines = [{n: y[:samples] for n, y in of.items()} for of in (r.measured, r.fitted, r.deviations)]
    scored = None if r.scored is None else r.scored[:samples]
    return replace(r, time=r.time[:samples], measured=lines[0], fitted=lines[1], deviations=lines[2], scored=scored)
