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

import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from typing import Any

from fracid.safety.door import own_text
from fracid.safety.schema import Record, Unknown


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


@dataclass(frozen=True)
class Words:
    """What one module says, by code: the words are in a TOML file beside it, the numbers are filled in here.

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

    file: str

    @property
    def table(self) -> dict[str, Any]:
        """The content of the file, read once for all who say it."""
        return _content(self.file)

    def __call__(self, code: str, /, **values: object) -> Note:
        """A sentence with these values."""
        return Note(str(self.table[code]).format(**values), code)

    def finding(self, name: str, where: str, number: float, limit: float, /, **values: object) -> Finding:
        """A finding whose words have these values, and its own: ``where``, ``number`` and ``limit``."""
        values |= {"where": where, "number": number, "limit": limit}
        entry = {key: text.format(**values) for key, text in ({"code": name} | self.table[name]).items()}
        return Finding(entry["code"], where, number, limit, entry["unit"], entry["says"])


@cache
def _content(file: str) -> dict[str, Any]:
    return tomllib.loads(own_text(file))


class Note(str):
    """A sentence that a program knows by its code, whatever its words.

    Examples
    --------
    >>> note = Note("alpha has no unit: taken as rad.", "unit-assumed", "alpha")
    >>> note, note.code, note.where
    ('alpha has no unit: taken as rad.', 'unit-assumed', 'alpha')
    """

    code: str
    where: str
    """What it is about."""

    def __new__(cls, sentence: str, code: str, where: str = "") -> Note:
        """A sentence with its code."""
        note = super().__new__(cls, sentence)
        note.code, note.where = code, where
        return note

    def __getnewargs__(self) -> tuple[str, str, str]:  # type: ignore[override]
        """What pickle makes it again from."""
        return str(self), self.code, self.where


def with_code(notes: Iterable[str], code: str) -> tuple[Note, ...]:
    """Those notes that have a code.

    Examples
    --------
    >>> with_code(["a sentence", Note("another", "blank")], "blank")
    ('another',)
    """
    return tuple(note for note in notes if isinstance(note, Note) and note.code == code)
