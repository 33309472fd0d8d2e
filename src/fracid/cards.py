"""Cards: how a result shows itself, in at most eight lines of text, and as a small table in a notebook.

A class that is a :class:`CardDisplay` names the rows of its card; ``repr``, ``print`` and the notebook take them.  The
table needs no script, takes the colours of the page, light or dark, and escapes every text: names come from files,
which come from strangers.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from enum import Enum
from html import escape
from pathlib import Path, PurePath
from typing import Any, cast

from fracid.safety.text import cut, printable
from fracid.units import letter, shown_unit, typeset_unit, with_half_width, with_interval

LINES, LENGTH = 8, 120
"""Of a card as text: so many lines at most, of so many characters."""

FEW = 12
"""Items of a list that are named one by one."""

ROWS, CELL = 60, 600
"""Of a card as a table: so many rows at most, of so many characters a cell."""

TABLE = "border-collapse:collapse;color:inherit;background:transparent;font-size:90%"
CAPTION = "caption-side:top;text-align:left;font-weight:bold;color:inherit;padding:4px 8px"
LINE = "border-bottom:1px solid rgba(128,128,128,0.35);text-align:left;vertical-align:top;padding:3px 8px"
"""Inline styles: the colours are the page's own, the lines a grey that is seen on white and on black."""


@dataclass(frozen=True)
class Card:
    """A title and rows of two texts.

    Examples
    --------
    >>> card = Card("Recording release", (("samples", "2,001"), ("released", "at 1.2 s")))
    >>> print(card.text())
    Recording release
      samples   2,001
      released  at 1.2 s
    >>> "<td" in card.html()
    True
    """

    title: str
    rows: tuple[tuple[str, str], ...]
    """What and its value; the first seven at most are in the text."""
    details: tuple[tuple[str, str], ...] = ()
    """Rows that only the table has."""
    estimates: tuple[Mapping[str, str], ...] = ()
    """A table of its own in the notebook: rows, heading → text."""

    def text(self) -> str:
        """At most eight lines."""
        rows = [(_one_line(what), _one_line(value)) for what, value in self.rows]
        room = LINES - 1
        if len(rows) > room:
            rows = [*rows[: room - 1], ("…", f"{len(rows) - room + 1} more rows")]
        width = min(max((len(what) for what, _ in rows), default=0), LENGTH // 3)
        lines = [f"  {cut(what, width):<{width}}  {value}" for what, value in rows]
        return "\n".join(cut(line, LENGTH) for line in (_one_line(self.title), *lines))

    def of_folder(self, folder: Path) -> Card:
        """The same card with the folder that it was written to."""
        return replace(self, rows=(("folder", str(folder)), *self.rows))

    def html(self) -> str:
        """A table without a script or a class, every text escaped; one more for estimates."""
        rows = [*self.rows, *self.details]
        if len(rows) > ROWS:
            rows = [*rows[:ROWS], ("…", f"{len(rows) - ROWS} more rows")]
        table = _table([[("th", what), ("td", value)] for what, value in rows], self.title)
        if not self.estimates:
            return table
        lines = [("th", self.estimates[0]), *(("td", row.values()) for row in self.estimates[:ROWS])]
        return table + _table([[(tag, text) for text in texts] for tag, texts in lines])


def _table(rows: list[list[tuple[str, str]]], title: str = "") -> str:
    cells = ("".join(f'<{tag} style="{LINE}">{_safe(text)}</{tag}>' for tag, text in row) for row in rows)
    caption = f'<caption style="{CAPTION}">{_safe(title)}</caption>' if title else ""
    return f'<table style="{TABLE}">{caption}' + "".join(f"<tr>{row}</tr>" for row in cells) + "</table>"


class CardDisplay:
    """Shows its card: as text to ``repr`` and ``print``, as a table to a notebook.

    A class with ``@dataclass(repr=False)`` whose card names no rows has its fields there, each in a few words.
    """

    def _card(self) -> Card:
        """What is on the card."""
        shown = (f for f in fields(cast(Any, self)) if f.repr)
        return Card(type(self).__name__, tuple((f.name, brief(getattr(self, f.name))) for f in shown))

    def __repr__(self) -> str:
        """At most eight lines."""
        return self._card().text()

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        return self._card().html()


def tabulated(rows: Sequence[Mapping[str, Any]], index: str | None = None) -> Any:
    """Rows as a pandas ``DataFrame`` where pandas is installed; else the rows themselves, a list of dictionaries.

    Parameters
    ----------
    rows : sequence of mappings
    index : str, optional
        The column that becomes the frame's index.

    Examples
    --------
    >>> float(tabulated([{"name": "mu", "value": 0.9}], "name").loc["mu", "value"])
    0.9
    """
    try:
        from pandas import DataFrame
    except ImportError:
        return list(rows)
    frame = DataFrame(rows)
    return frame if index is None or not len(frame) else frame.set_index(index)


def rounded(value: float, half: float | None) -> str:
    """A value to the second digit of its interval's half-width, with that half-width; to four digits without one.

    Examples
    --------
    >>> rounded(0.914578, 0.00016), rounded(-0.0012345, None), rounded(2.0, 30.0)
    ('0.91458 ± 0.00016', '−0.001234', '2 ± 30')
    >>> rounded(-0.00013361, 9.1e-07)
    '(−1.3361 ± 0.0091)e-04'
    """
    if not math.isfinite(value):
        return "none"
    return _true_minus(f"{value:.4g}" if half is None or not 0 < half < math.inf else with_half_width(value, half))


def _true_minus(text: str) -> str:
    """A minus before each number; the one of an exponent stays, as terminals have it."""
    return re.sub(r"(?<!e)-", "−", text)


def estimate_text(name: str, value: float, interval: Sequence[float] | None, unit: str, *, cut: bool = False) -> str:
    """A value with its name, its interval's half-width, or its ends where a bound cuts it, and its unit.

    Examples
    --------
    >>> estimate_text("mu", 0.914578, (0.914418, 0.914738), "")
    'μ = 0.91458 ± 0.00016'
    >>> estimate_text("offset", 0.1, None, "rad")
    'offset = 5.73 °'
    """
    display_unit, factor = shown_unit(unit)
    if interval is None:
        text = rounded(factor * value, None)
    else:
        text = _true_minus(with_interval(*(factor * v for v in (value, *interval)), cut=cut))
    return f"{letter(name)} = {text} {typeset_unit(display_unit)}".rstrip()


def brief(value: object) -> str:
    """A value in a few words: of an array its shape, of a mapping its names, of a result the title of its card.

    Examples
    --------
    >>> import numpy as np
    >>> brief(np.zeros((20_001, 4))), brief({"lambda": 0.93}), brief(None), brief(4001), brief(0.12345678)
    ('array of 20,001 × 4', 'λ = 0.93', 'none', '4,001', '0.1235')
    """
    if value is None or isinstance(value, bool):
        return {None: "none", True: "yes", False: "no"}[value]
    if isinstance(value, int):
        return f"{value:,}"
    if isinstance(value, float):
        return rounded(value, None)
    if isinstance(value, CardDisplay):
        return value._card().title
    if isinstance(value, Enum):
        return str(value.value)
    if (shape := getattr(value, "shape", None)) is not None:
        return f"array of {' × '.join(f'{n:,}' for n in shape)}" if shape else f"{value:.4g}"
    if isinstance(value, Mapping):
        plain = (int, float, str)
        items = (f"{letter(str(n))} = {brief(v)}" if isinstance(v, plain) else str(n) for n, v in value.items())
        return listed(items)
    if isinstance(value, tuple | list):
        short = len(value) <= FEW and all(isinstance(item, str | int | float) for item in value)
        return listed(map(brief, value)) if short else f"{len(value):,} in all"
    return str(value) if isinstance(value, str | PurePath) else type(value).__name__


def listed(items: Iterable[str]) -> str:
    """Items with commas, ``none`` without any.

    Examples
    --------
    >>> listed(["a", "b"]), listed([])
    ('a, b', 'none')
    """
    return ", ".join(items) or "none"


def _one_line(text: str) -> str:
    return printable(" ".join(str(text).split()))


def _safe(text: str) -> str:
    return escape(cut(_one_line(text), CELL))
