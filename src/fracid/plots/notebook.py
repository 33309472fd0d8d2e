"""A figure that a notebook shows by itself: one without pyplot has no picture there before ``%matplotlib inline``."""

from __future__ import annotations

from io import BytesIO

from matplotlib.figure import Figure

from fracid.figures import STYLES, Style

RESOLUTION = 120
"""Of the picture [pixels per inch]."""


class ShownFigure(Figure):
    """A figure with a picture of itself for Jupyter.

    Examples
    --------
    >>> ShownFigure(figsize=(2, 1))._repr_png_()[1:4]
    b'PNG'
    """

    theme: Style = STYLES["screen"]
    """How it is set; with the figure, wherever it goes."""

    def _repr_png_(self) -> bytes:
        content = BytesIO()
        self.savefig(content, format="png", dpi=RESOLUTION)
        return content.getvalue()
