"""What modules say: sentences by code, their words in a TOML file beside the module, and notes that keep their code."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from fracid.safety.door import own_text


@dataclass(frozen=True)
class Sentences:
    """What one module says, by code: the words are in a TOML file beside it, the numbers are filled in here.

    Parameters
    ----------
    file : str
        Within the package, ``cli/says.toml``: code → sentence.

    Examples
    --------
    >>> Sentences("cli/says.toml")("few-counts", counts=2.0)
    '--counts 2 is not possible; expected counts a turn, e.g. 4096, or 0 for no rounding.'
    """

    file: str

    @cached_property
    def table(self) -> dict[str, Any]:
        """The content of the file, read when it is first said."""
        return tomllib.loads(own_text(self.file))

    def __call__(self, code: str, /, **values: object) -> Note:
        """A sentence with these values."""
        return Note(str(self.table[code]).format(**values), code)


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
