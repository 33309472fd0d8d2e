"""Figures to files: whole or not at all, and the same bytes for the same figure.

The letters of an SVG are outlines: it looks the same where the font is not installed.  Those of a PDF are letters, with
their font embedded as TrueType (Type 42), as journals ask for: they can be searched, and changed in a drawing program.
"""

from __future__ import annotations

import io
import threading
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from fracid.errors import InputError, refuse_unknown, writing
from fracid.plots.appearance import spoken, style_of
from fracid.safety.door import own_text, write_files

SETTINGS: dict[str, Any] = tomllib.loads(own_text("plots/writing.toml"))
"""Of matplotlib, while a file is written: identifiers that are not random, fonts, no LaTeX, which would take names
of recordings for commands, and no layout but ours."""

OPTIONS: dict[str, dict[str, Any]] = {"png": {"pil_kwargs": {"compress_level": 1}}}
"""Of formats: the least compression writes a PNG in half the time, a tenth larger."""

NO_DATE: dict[str, dict[str, Any]] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}, "png": {}}
"""Formats with metadata, and what keeps the date out of them."""

_settling = threading.Lock()
"""They are all threads'."""


def save(figure: Figure, folder: str | Path, stem: str, formats: Sequence[str] = ("svg", "png")) -> tuple[Path, ...]:
    """Write a figure in each format, whole or not at all, and empty it.

    The same figure gives the same bytes: no file has a date, and identifiers are not random.  The heading is in the
    metadata, as the title.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        Is cleared, to give its memory back.
    folder : path
        Made if it is not there.
    stem : str
        File name without its ending.
    formats : sequence of str
        Of ``svg``, ``png``, ``pdf`` and whatever else matplotlib knows.

    Returns
    -------
    tuple of Path
        ``folder/stem.svg``, ...

    Raises
    ------
    InputError
        For an unknown format, a stem that is no file name, or a folder that cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from fracid.estimation.cost_plane import CostPlane
    >>> orders = np.linspace(0.8, 1.0, 2)
    >>> flat = CostPlane(("lambda", "mu"), orders, orders, np.ones((2, 2))).plot()
    >>> [path.name for path in save(flat, tempfile.mkdtemp(), "plane")]
    ['plane.svg', 'plane.png']
    """
    from matplotlib import rc_context

    refuse_unknown("format of figures", sorted(figure.canvas.get_supported_filetypes()), *formats)
    if not stem or Path(stem).name != stem:
        raise InputError(f"{stem!r} is no name for a file; expected one without a folder and an ending: 'figure2'.")
    with _settling, rc_context(SETTINGS):  # matplotlib takes these from its global settings alone
        _lay_out(figure)
        contents = {}
        for ending in sorted(formats, key=lambda ending: ending != "png"):
            contents[ending] = _rendered(figure, ending)
            if ending == "png":
                _hold_labels(figure)
    for axes in figure.axes:
        figure.delaxes(axes)  # clear() would make each anew first, a tenth of the whole time
    files = {f"{stem}.{ending}": contents[ending] for ending in formats}
    return write_files(Path(folder), files, writing(str(folder), "Give another folder."))


def _lay_out(figure: Figure) -> None:
    """Lay a figure out once for all formats; as long as it has its engine, each file takes a second, idle drawing.

    It is laid out with the PNG's pixels, which then need not be made ready again.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(figure)
    figure.set_dpi(style_of(figure).dpi)
    if (engine := figure.get_layout_engine()) is not None:
        engine.execute(figure)
        figure.set_layout_engine(None)


def _hold_labels(figure: Figure) -> None:
    """Leave labels and titles where they were drawn: to look for its place again, each would measure all ticks."""
    on_figure = figure.transFigure
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            place = axis.label.get_transform().transform(axis.label.get_position())
            x, y = on_figure.inverted().transform(place)
            axis.set_label_coords(x, y, transform=on_figure)
        axes.set_title("", loc="right", y=1.0)  # no figure has one there: all three stay where they are


def _rendered(figure: Figure, ending: str) -> bytes:
    title = {"Title": spoken(str(figure.get_label()))} if figure.get_label() else {}
    metadata = title | NO_DATE[ending] if ending in NO_DATE else None
    with io.BytesIO() as content:
        figure.savefig(content, format=ending, dpi=style_of(figure).dpi, metadata=metadata, **OPTIONS.get(ending, {}))
        return content.getvalue()
