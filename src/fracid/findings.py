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

from fracid.safety.schema import Record, Unknown
from fracid.words import Note as Note
from fracid.words import Sentences
from fracid.words import with_code as with_code


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

    @property
    def note(self) -> Note:
        """Where, and the sentence, with its code."""
        return Note(str(self), self.code, self.where)

    def __str__(self) -> str:
        """Where, and the sentence."""
        return f"{self.where}: {self.sentence}" if self.where else self.sentence


class Words(Sentences):
    """Sentences of which some are findings.

    Parameters
    ----------
    file : str
        Within the package, ``recording/faults.toml``: code → sentence, and code → table of a finding, with the unit of
        its number and what it ``says``; of two findings with one ``code`` the tables have names of their own.

    Examples
    --------
    >>> says = Words("recording/faults.toml")
    >>> str(says.finding("still", "alpha", 0.0, 0.0, unit="rad", value="0°"))
    'alpha: it stays at 0° throughout: is its encoder connected? A model of the pendulum needs it to swing.'
    """

    def finding(self, name: str, where: str, number: float, limit: float, /, **values: object) -> Finding:
        """A finding whose words have these values, and its own: ``where``, ``number`` and ``limit``."""
        values |= {"where": where, "number": number, "limit": limit}
        entry = {key: text.format(**values) for key, text in ({"code": name} | self.table[name]).items()}
        return Finding(entry["code"], where, number, limit, unit=entry["unit"], sentence=entry["says"])
