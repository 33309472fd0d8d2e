"""Misfit, by its size: what a fit leaves over, and recordings that it does not predict."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping

from fracid.estimation.records import RecordingFit
from fracid.findings import Finding, Words
from fracid.selection.doubts import POOR
from fracid.signals.left_over import LeftOver
from fracid.units import letter, plain, with_unit
from fracid.validation.residual_sentences import words_of

SAYS = Words("validation/misfits.toml")

MISFIT = 3.0
"""Times the rounding, from which on an autocorrelated residual is reported."""

WORSE = 3.0
"""Times what is left over of the recordings that were fitted, from which on one that was not is missed."""


def misfits(
    recordings: Mapping[str, RecordingFit], starts: int, residuals: Mapping[str, LeftOver] | None = None,
    hidden: Callable[[str], str] = lambda _: "",
) -> Iterator[Finding]:  # fmt: skip
    """What a fit leaves over of the recordings that it was made from, where it is no noise.

    Parameters
    ----------
    recordings : mapping
    starts : int
        Of the search.
    residuals : mapping, optional
        Recording and output, in words → what :func:`fracid.selection.residual_noise.leftovers` finds of it.
    hidden : function
        Of a recording: what to type for states that no output shows.
    """
    again = SAYS("again") if starts == 1 else ""
    for r in recordings.values():
        for output, percent in r.fit_percent.items():
            if percent < POOR:
                worse = "no" if percent <= 0 else "hardly"
                yield SAYS.finding("cannot-explain", r.name, percent, POOR, worse=worse, output=output, again=again,
                                   hidden=hidden(r.name))  # fmt: skip
                continue
            left = r.left_over(output)
            of = (residuals or {}).get(f"{r.name}, {letter(output)}", left)
            cause = SAYS("shaken" if of.inputs else "coloured" if of.coloured else "lacks", inputs=of.inputs) + again
            if left.known and not left.explained:
                yield SAYS.finding("misfit-of-known", f"{r.name}: {output}", left.rms, 1.0, cause=cause)
            elif not left.known and MISFIT < left.times < math.inf and not left.white:
                yield SAYS.finding("misfit", f"{r.name}: {output}", left.times, MISFIT, cause=cause,
                                   rms=with_unit(left.rms, r.unit(output), '.2g'), times=plain(left.times),
                                   of=words_of(r.unit(output)))  # fmt: skip


def missed(validated: Mapping[str, RecordingFit], fitted: Mapping[str, float]) -> Iterator[Finding]:
    """Recordings that were not fitted and are not predicted.

    Parameters
    ----------
    validated : mapping
    fitted : mapping
        Output → the largest rms of what is left over of those that were fitted.
    """
    for r in validated.values():
        for output, percent in r.fit_percent.items():
            times = r.rmse[output] / max(fitted.get(output, 0.0), 1e-300)
            left = r.left_over(output)
            if percent < POOR:
                yield SAYS.finding("missed", f"{r.name}: {output}", percent, POOR)
            elif times > WORSE and not left.explained:
                yield SAYS.finding("missed-by", f"{r.name}: {output}", times, WORSE, times=plain(times),
                                   rms=with_unit(r.rmse[output], r.unit(output), '.2g'))  # fmt: skip


def cost_of(finding: Finding) -> float:
    """How far a finding is beyond its limit: the order in which findings are told."""
    if not (finding.number > 0 and finding.limit > 0):
        return math.inf
    return max(finding.number / finding.limit, finding.limit / finding.number)
