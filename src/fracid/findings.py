"""A finding: a fault that was seen, the number that shows it, and what to do.

What fracid says beside a result is either a verdict on a value (:class:`fracid.Verdict`) or a finding: something is
wrong, or may be, with the data, the project or the model.  Each has a number, and the limit beyond which it
is said, so that a reader can judge it, and a program can sort by it.  ``docs/honesty.md`` lists the codes.

============================================  =====================================================================
made by                                       looks at
============================================  =====================================================================
:mod:`fracid.recording.faults`                samples alone, for ``fracid check`` and whatever reads a recording
:mod:`fracid.validation.before_search`        a problem before the search, and its minimum after it
:class:`fracid.Trajectory`                    a simulation that did not reach its end (``reason``, in words)
============================================  =====================================================================
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from fracid.safety.schema import Record, Unknown, as_json


@dataclass(frozen=True)
class Finding(Record):
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
    number: Unknown
    """What shows it [unit]."""
    limit: Unknown
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
        return as_json(Finding, self)
