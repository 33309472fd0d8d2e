"""Figures: the door to :mod:`fracid.plots`, and how they are set, for the screen or for a journal's columns.

======================  ============================================  =============================================
style                   ``screen``                                    ``journal``
======================  ============================================  =============================================
width                   as wide as its panels need                    88 mm, one column; 180 mm, the page
text                    8 to 11 pt                                    8 pt; letters of a drawing 9 pt
lines, marks            as drawn                                      a fifth thinner, none below 0.5 pt; a third
                                                                      smaller
heading                 above the figure                              none: it belongs into the caption
panels                  without letters                               (a), (b), …
legend, panel titles    in full                                       brief; the rest is in the caption
pixels, if any          150 per inch                                  600 per inch
======================  ============================================  =============================================

``screen`` is the default; every figure takes ``style="journal"``.  The text has no serifs, the colours can be
distinguished by every eye and, with shapes and dashes, in grey.

A result has a method ``plot``, and the plots import the results that they draw.  So a result calls :func:`draw` with
the figure's name, and imports nothing from above itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any

from fracid.errors import entry_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Figure
else:
    Figure = Any  # matplotlib is slow to load: it is when something is drawn

PLOTS = "fracid.plots"
"""The package of the figures.  It stands above all that it draws, and is imported when something is drawn."""


@dataclass(frozen=True)
class Style:
    """How a figure is set.  For a journal of other columns: ``replace(STYLES["journal"], column=84, page=174)``."""

    column: float | None = None
    """Width of a figure of one column of panels [mm]; None is as wide as drawn."""
    page: float | None = None
    """Width of a broader one [mm]."""
    text: float = 1.0
    """Factor on the sizes of text."""
    least_text: float = 0.0
    """No text is smaller [pt]."""
    lines: float = 1.0
    """Factor on the widths of lines."""
    marks: float = 1.0
    """Factor on the sizes of marks."""
    least_line: float = 0.0
    """No line is thinner [pt]."""
    heading: bool = True
    """Whether the figure's heading stands above it; it is in the file's metadata in any case."""
    letters: bool = False
    """Whether panels are lettered."""
    brief: bool = False
    """Whether legends and titles of panels are short; the file's metadata has them in full, for the caption."""
    dpi: int = 150
    """Of a PNG, and of what is rasterised in an SVG or a PDF [1/inch]."""


STYLES = {
    "screen": Style(),
    "journal": Style(88, 180, text=0.85, least_text=8.0, lines=0.8, marks=0.65, least_line=0.5, heading=False,
                     letters=True, brief=True, dpi=600),
}  # fmt: skip
"""The styles by name."""


def style_named(style: str | Style) -> Style:
    """The style of that name.

    Raises
    ------
    InputError
        If there is none.

    Examples
    --------
    >>> style_named("journal").column
    88
    """
    return style if isinstance(style, Style) else entry_of("style", STYLES, style)


def draw(kind: str, *result: Any, **options: Any) -> Figure:
    """Draw a result: the one place below :mod:`fracid.plots` that names it, and by name.

    Parameters
    ----------
    kind : str
        The name of a function of :mod:`fracid.plots`.
    *result, **options
        What that function takes.

    Examples
    --------
    >>> import fracid
    >>> draw("rig_drawing", fracid.rotary_pendulum()).axes[0].get_aspect()
    1.0
    """
    figure: Figure = getattr(import_module(PLOTS), kind)(*result, **options)
    return figure
