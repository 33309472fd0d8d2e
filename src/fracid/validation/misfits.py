"""Misfit, by its size: what a fit leaves over, and recordings that it does not predict."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from fracid.estimation.records import RecordingFit
from fracid.findings import Finding
from fracid.signals.left_over import left_over
from fracid.units import plain, with_unit

POOR = 20.0
"""A fit of less than this [%] is called poor."""

MISFIT = 3.0
"""Times the encoder's rounding, from which on what is left over and hangs together is said."""

WORSE = 3.0
"""Times what is left over of the recordings that were fitted, from which on one that was not is missed."""


def misfits(recordings: Mapping[str, RecordingFit], starts: int) -> Iterator[Finding]:
    """What a fit leaves over of the recordings that it was made from, where it is no noise.

    Parameters
    ----------
    recordings : mapping
    starts : int
        Of the search.
    """
    again = "; another start may do better, type --multi-start 16" if starts == 1 else ""
    for r in recordings.values():
        for output, percent in r.fit_percent.items():
            if percent < POOR:
                worse = "no better than a constant" if percent <= 0 else "hardly better than a constant"
                means = f"fit {percent:.1f} %; no value of it means much{again}."
                yield Finding("cannot-explain", r.name, percent, POOR, "% fit",
                              f"the model is {worse} for {output}, {means}")  # fmt: skip
                continue
            left = left_over(r.standardised(output), r.measured[output], known=output in r.deviations)
            if left.known:
                if not left.explained:
                    yield Finding("misfit", f"{r.name}: {output}", left.rms, 1.0, "standard deviations",
                        f"the residual is {left.rms:.2g} of the standard deviations that the recording has, and "
                        "autocorrelated: the model lacks something. fracid resid shows what.")  # fmt: skip
            elif MISFIT < left.times < math.inf and not left.white:
                yield Finding("misfit", f"{r.name}: {output}", left.times, MISFIT, "times the encoder's rounding",
                    f"the residual is {with_unit(left.rms, r.unit(output), '.2g')}, {plain(left.times)} times "
                    "the encoder's rounding, and autocorrelated: the model lacks something. "
                    "fracid resid shows what, fracid compare looks for it.")  # fmt: skip


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
            left = left_over(r.standardised(output), r.measured[output], known=output in r.deviations)
            if percent < POOR:
                yield Finding("missed", f"{r.name}: {output}", percent, POOR, "% fit",
                    f"it was held out, and the model does not predict it: fit {percent:.1f} %. Is it of the same "
                    "rig, with the same zeros and signs?")  # fmt: skip
            elif times > WORSE and not left.explained:
                yield Finding("missed", f"{r.name}: {output}", times, WORSE, "times the residual of the fitted",
                    f"it was held out, and the model misses it by {with_unit(r.rmse[output], r.unit(output), '.2g')}"
                    f", {plain(times)} times the residual of the fitted recordings: it does not hold beyond "
                    "that.")  # fmt: skip


def cost_of(finding: Finding) -> float:
    """How far a finding is beyond its limit: the order in which findings are told."""
    if not (finding.number > 0 and finding.limit > 0):
        return math.inf
    return max(finding.number / finding.limit, finding.limit / finding.number)
