"""A finding: a fault that was seen, the number that shows it, and what to do.  A failure: why there is no result.

What fracid says beside a result is either a verdict on a value (:class:`fracid.Verdict`) or a finding: something is
wrong, or may be, with the data, the project or the model.  Each has a number, and the limit beyond which it
is said, so that a reader can judge it, and a program can sort by it.  ``docs/honesty.md`` lists the codes.

==================================  ====================================================================
made by                             looks at
==================================  ====================================================================
:mod:`fracid.recording.faults`      samples alone, for ``fracid check`` and whatever reads a recording
:mod:`fracid.validation.before_search`               a problem before the search, and its minimum after it
:class:`fracid.Trajectory`          a simulation that did not reach its end (``reason``, in words)
==================================  ====================================================================

A numerical failure, a run that diverges or a cost whose loss nobody knows, is no error but an outcome: what cannot give
its result gives a :class:`Failure` in its place, with a reason that a program can test and the sentence for people.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import Any

__all__ = ["Failure", "FailureReason", "Finding"]


@dataclass(frozen=True)
class Finding:
    """A fault with the number that shows it.

    Examples
    --------
    >>> found = Finding("aliased", "swing: alpha", 5.2, 8.0, "samples a swing", "Too few samples a swing.")
    >>> found.to_json()["number"], str(found)
    (5.2, 'swing: alpha: Too few samples a swing.')
    """

    code: str
    """A row of ``docs/honesty.md``: ``aliased``, ``wrong-zero``, …"""
    where: str
    """The recording, signal or unknown."""
    number: float
    """What shows it [unit]."""
    limit: float
    """Beyond which it is said [unit]."""
    unit: str
    """Of the two, in words."""
    sentence: str
    """What it means and what to do."""

    def __str__(self) -> str:
        """Where, and the sentence."""
        return f"{self.where}: {self.sentence}" if self.where else self.sentence

    def to_json(self) -> dict[str, Any]:
        """As plain JSON values; a number that is not finite becomes null."""
        number, limit = (v if math.isfinite(v) else None for v in (float(self.number), float(self.limit)))
        return {"code": self.code, "where": self.where, "number": number, "limit": limit, "unit": self.unit,
                "sentence": self.sentence}  # fmt: skip


class FailureReason(Enum):
    """Why there is no result; the value is the kind in words."""

    RUN = "a run ends before its last sample"
    INTERRUPTED = "the search was interrupted"
    NOTHING_FREE = "nothing is free"
    AT_BOUND = "every unknown lies at a bound"
    OWN_COST = "a user's own cost is of unknown loss"
    AT_REST = "the fit starts at rest"
    UNCHANGED = "nothing would change"
    NO_PAST = "there are no samples before the start"
    NO_PLATEAU = "there is no plateau before the start"
    NO_TURN = "there is no early turning point"
    DRIVEN = "a driven recording has no falling amplitude"
    FEW_SWINGS = "there are too few swings"
    REFUSED = "the problem is refused"


@dataclass(frozen=True)
class Failure:
    """In place of a result: why there is none.

    Examples
    --------
    >>> failure = Failure(FailureReason.RUN, "swing: diverged at t = 1.2 s")
    >>> failure.reason is FailureReason.RUN, f"no interval: {failure}"
    (True, 'no interval: swing: diverged at t = 1.2 s')
    """

    reason: FailureReason
    """The kind."""
    detail: str
    """The sentence, without a full stop."""

    def __str__(self) -> str:
        """Give the sentence."""
        return self.detail
