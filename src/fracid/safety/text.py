"""Text that came from a file: made fit for a terminal, for one line, and for the name of another file.

A project and a recording come from anywhere, and what they call their recordings and columns is printed, drawn, put
into a page, into programs, and into names of files.

=========================  ===========================================================================================
where it goes              what makes it fit
=========================  ===========================================================================================
a terminal, a message      :func:`printable`: what cannot be seen, a terminal's commands among it, is written out
JSON on a terminal         :func:`json_text`: the same, by JSON's own escapes
a result, a page, a plot   :func:`refuse_unseen`, at the entrance: no recording's name holds such a thing
a file's name              :func:`file_stems`: letters, digits and dashes, not too long, and no two alike
HTML, JSON in HTML         Jinja's autoescape and an escaped ``<``: :mod:`fracid.report`
a figure's letters         ``$`` is no formula's: :mod:`fracid.plots.appearance`
a spreadsheet              :func:`csv_cell`: is no formula
a comment in MATLAB or C   :func:`one_line`, without its end: :mod:`fracid.export`
=========================  ===========================================================================================

What cannot be seen are Unicode's categories Cc (controls, the terminal's ESC among them), Cf (formats, the turning of
the direction of reading among them), Zl and Zp (ends of lines and paragraphs) and Cs (halves of characters).
"""

from __future__ import annotations

import json
import re
import unicodedata
from collections import defaultdict
from collections.abc import Iterable, Iterator
from itertools import count, dropwhile
from typing import Any

from fracid.errors import InputError

UNSEEN = ("Cc", "Cf", "Zl", "Zp", "Cs")
"""Categories of Unicode."""

LONGEST_NAME = 200
"""Characters of a name, of a recording or a column."""

LONGEST_STEM = 60
"""Characters of a file's name without what stands before and behind: every file system takes 255 bytes of it all."""

FORMULA = ("=", "+", "-", "@")
"""What a spreadsheet's formulas begin with."""

SIGNED = re.compile(
    r"[+-]([0-9]+\.?[0-9]*|\.[0-9]+)(e[+-]?[0-9]+)?( ?[^\W\d_]{1,12}| ?[°%]| [^\W\d_]{1,9}/[^\W\d_]{1,9}²?)?", re.I
)
"""One number, and perhaps its unit."""

RESERVED = {"con", "prn", "aux", "nul", *(f"{port}{n}" for port in ("com", "lpt") for n in range(10))}
"""What Windows takes for a device."""


def printable(text: str) -> str:
    r"""Write out what cannot be seen, but for the ends of lines and tabs; the rest stays.

    Examples
    --------
    >>> print(printable("release \x1b[31m92°\u202e"))
    release \x1b[31m92°\u202e
    """
    if text.isascii() and text.isprintable():  # nearly always
        return text
    return "".join(c if c in "\n\t" or not _unseen(c) else c.encode("unicode_escape").decode() for c in text)


def json_text(value: Any) -> str:
    r"""JSON for a terminal: what cannot be seen in its texts is written as JSON's own escapes, which mean the same.

    Examples
    --------
    >>> print(json_text({"name": "λ\u202e\x9b"}))
    {
      "name": "λ\u202e\u009b"
    }
    """
    text = json.dumps(value, indent=2, ensure_ascii=False)
    if text.isascii() and "\x7f" not in text:
        return text
    return "".join(json.dumps(c)[1:-1] if c != "\n" and _unseen(c) else c for c in text)


def refuse_unseen(what: str, text: str) -> str:
    r"""Give the text back if it is a name that can be read, on one line.

    Raises
    ------
    InputError
        If something in it cannot be seen, or nothing can; or if it is too long.

    Examples
    --------
    >>> refuse_unseen("the recording's name", "release 92°")
    'release 92°'
    >>> refuse_unseen("the recording's name", "release\n92°")
    Traceback (most recent call last):
    fracid.errors.InputError: the recording's name 'release\n92°' holds U+000A, which cannot be seen; leave it out.
    """
    if character := next((c for c in text if _unseen(c)), None):
        held = f"{ascii_short(text)} holds U+{ord(character):04X}"
        raise InputError(f"{what} {held}, which cannot be seen; leave it out.")
    if not text.strip():
        raise InputError(f"{what} is empty; expected something to call it by.")
    if len(text) > LONGEST_NAME:
        raise InputError(f"{what} has {len(text)} characters, {ascii_short(text)}; expected {LONGEST_NAME} at most.")
    return text


def ascii_short(text: str) -> str:
    """In quotes, with what cannot be seen written out, and not longer than a message bears.

    Examples
    --------
    >>> print(ascii_short("x" * 99))
    'xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx...'
    """
    return repr(shortened(text))


def one_line(text: str) -> str:
    """What any format can hold, on one line.

    Examples
    --------
    >>> one_line("a\\nb")
    'a b'
    """
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())


def cut(text: str, length: int) -> str:
    """A text of so many characters at most, cut between words where there are any.

    Examples
    --------
    >>> cut("release from 90°, arm clamped", 25), cut("abcdefgh", 5), cut("short", 5)
    ('release from 90°, arm…', 'abcd…', 'short')
    """
    if len(text) <= length:
        return text
    head = text[: length - 1]
    return f"{head.rsplit(' ', 1)[0] if ' ' in head[length // 2 :] else head}…"


def shortened(text: str) -> str:
    """Not longer than a message bears.

    Examples
    --------
    >>> shortened("alpha"), len(shortened("x" * 999))
    ('alpha', 43)
    """
    return text if len(text) <= 60 else f"{text[:40]}..."


def file_stems(names: Iterable[str]) -> dict[str, str]:
    """A file name for each, without ending, of letters, digits, underscores and dashes; no two alike on any system.

    Examples
    --------
    >>> file_stems(["release 92°", "Release-92", "../..", "aux"])
    {'release 92°': 'release-92', 'Release-92': 'Release-92-2', '../..': 'recording', 'aux': 'aux-'}
    """
    stems: dict[str, str] = {}
    keys: set[str] = set()
    numbers: defaultdict[str, Iterator[int]] = defaultdict(lambda: count(2))
    for name in dict.fromkeys(names):
        whole = re.sub(r"[^0-9A-Za-z_]+", "-", name).strip("-")[:LONGEST_STEM] or "recording"
        first = stem = f"{whole}-" if whole.lower() in RESERVED else whole
        while stem.lower() in keys:
            stem = f"{first}-{next(numbers[first.lower()])}"
        keys.add(stem.lower())
        stems[name] = stem
    return stems


def csv_cell(text: str) -> str:
    """Keep a spreadsheet from taking a text for a formula: with an apostrophe before; a number with its unit stays.

    A part behind a semicolon or a tab counts too: where numbers have decimal commas, it is a cell of its own.

    Examples
    --------
    >>> csv_cell("=1+1"), csv_cell("-15°"), csv_cell("-2+3"), csv_cell("a;=1+1")
    ("'=1+1", '-15°', "'-2+3", "a;'=1+1")
    """
    cell = "".join(f"'{part}" if _is_formula(part) else part for part in re.split(r"([;,\t\r\n])", text))
    return f"'{cell}" if cell[:1] in "\t\r\n" and cell else cell


def _is_formula(text: str) -> bool:
    """Whether its first letter that is seen is a formula's, in any of its widths, and it is no signed number."""
    seen = "".join(dropwhile(lambda c: c.isspace() or _unseen(c), text))
    return unicodedata.normalize("NFKC", seen[:1]).startswith(FORMULA) and not SIGNED.fullmatch(text)


def _unseen(character: str) -> bool:
    return unicodedata.category(character) in UNSEEN
