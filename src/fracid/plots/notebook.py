"""A figure that a notebook shows by itself: one without pyplot has no picture there before ``%matplotlib inline``."""

from __future__ import annotations

from io import BytesIO

from matplotlib.figure import Figure

RESOLUTION = 120
"""Of the picture [pixels per inch]."""


class ShownFigure(Figure):
    """A figure with a picture of itself for Jupyter.

    Examples
    --------
    >>> ShownFigure(figsize=(2, 1))._repr_png_()[1:4]
    b'PNG'
    """

    def _repr_png_(self) -> bytes:
        content = BytesIO()
        self.savefig(content, format="png", dpi=RESOLUTION)
        return content.getvalue()
