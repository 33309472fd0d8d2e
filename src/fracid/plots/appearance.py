"""What all figures share: colours, sizes, axes, units, zeros, the band of an encoder's step.

A figure is drawn once, in sizes for the screen.  :func:`new` makes it as wide as its style wants it
(:mod:`fracid.figures`), and :func:`finish` brings its text and lines to that style.  Nothing is taken from or put into
matplotlib's global settings, which are the caller's, and which threads share.

References
----------
.. [Okabe2008] Color Universal Design, https://jfly.uni-koeln.de/color/
"""

from __future__ import annotations

import math
import textwrap
import tomllib
from collections.abc import Iterator, Mapping
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fracid.arrays import FloatArray, Quanta, extremes
from fracid.estimation.records import RecordingFit
from fracid.figures import STYLES, Style, style_named
from fracid.models import Model
from fracid.plots.notebook import ShownFigure
from fracid.problem.costs import COSTS
from fracid.safety.door import own_text
from fracid.safety.text import cut
from fracid.units import GREEK, shown_unit, typeset_unit, with_unit
from fracid.validation.residual_sentences import words_of

BLUE, ORANGE, VERMILLION, GREEN = "#0072B2", "#E69F00", "#D55E00", "#009E73"

INK = "0.25"

SERIES = ((BLUE, "o"), (VERMILLION, "s"), (GREEN, "D"), (ORANGE, "^"), (INK, "v"))
"""Of what is told apart: colour and shape."""

MEASURED: dict[str, Any] = {"color": "0.68", "lw": 2.6, "solid_capstyle": "round"}

FITTED: dict[str, Any] = {"color": BLUE, "lw": 0.9}

RESIDUAL: dict[str, Any] = {"color": "0.4", "lw": 0.6}

SMALL, MEDIUM, LARGE = 8, 9.5, 11
"""Sizes of text [pt]: ticks and legends, labels and titles, the figure's title."""

BINS = 900
"""Bins of a line; each shows two samples."""

CLOUD = 1500
"""Points from which on a scatter is rasterised."""

MARKS: dict[str, dict[str, Any]] = {
    "best": {"marker": "*", "ms": 15, "mfc": VERMILLION, "mec": "black", "mew": 0.8, "zorder": 5, "clip_on": False},
    "tried": {"marker": "o", "ms": 2.5, "mfc": "white", "mec": "black", "mew": 0.4, "zorder": 3},
}
"""Told apart by shape as well as by colour."""

SYMBOLS = {name: rf"$\{name}$" for name in GREEK}

BRIEF = tomllib.loads(own_text("plots/legends.toml"))
"""Phrases of legends, and what stands for them in a brief style; nothing for what its axis names."""

NARROW = 8.0
"""What is drawn no wider than this [inch] fits a journal's column."""

TALLEST = 230 / 25.4
"""Of a figure on a journal's page [inch]."""


def new(width: float, height: float, style: str | Style = "screen") -> Figure:
    """An empty figure of that size [inch], or of its style's width and about the same shape."""
    theme = style_named(style)
    millimetres = theme.column if width <= NARROW else theme.page
    if millimetres is not None:
        shrunk = millimetres / 25.4 / width
        width, height = shrunk * width, min(shrunk**0.6 * height, TALLEST)  # text does not shrink as much as panels
    figure = ShownFigure(figsize=(width, height), layout="constrained", facecolor="white")
    figure.theme = theme
    return figure


def style_of(figure: Figure) -> Style:
    """The style that a figure was made with; the screen's for one that is not ours."""
    return figure.theme if isinstance(figure, ShownFigure) else STYLES["screen"]


def finish(figure: Figure, heading: str, *, grid: bool = True, caption: str = "") -> Figure:
    """Give all panels one look, the figure its heading and one legend for all, and everything its style; gives it back.

    `caption` is what a brief style leaves out of the figure: it follows the heading in the file's metadata.
    """
    style = style_of(figure)
    legend: dict[str, Any] = {}
    panels = [axes for axes in figure.axes if axes.get_label() != "<colorbar>"]
    for axes in panels:
        _dress(axes, grid)
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            legend.setdefault(label, handle)
    if legend:
        entries = {_brief(label) if style.brief else label: handle for label, handle in legend.items()}
        _legend(figure, {label: handle for label, handle in entries.items() if label})
    if style.heading:
        figure.suptitle(heading, fontsize=LARGE, wrap=True)
    # The title in its file's metadata.
    figure.set_label(f"{heading}. {caption}" if caption and style.brief else heading)
    if style.letters:
        _letter(panels)
    _wrap(figure, panels)
    figure.align_labels(panels)
    _no_latex(figure)
    _bring_to(style, figure)
    return figure


def _legend(figure: Figure, entries: Mapping[str, Any]) -> None:
    """One legend below all panels: in one row where it fits, else in as few as its longest entry allows."""
    style = style_of(figure)
    size, row = text_size(style, SMALL), 72 * figure.get_figwidth() - 2 * SMALL
    spacing = {"handlelength": 1.5, "handletextpad": 0.5, "columnspacing": 1.2} if style.brief else {}
    beside = size * (3.2 if style.brief else 4.8)  # the handle and the gaps of an entry [pt]
    widths = [beside + text_width(label, size) for label in entries]
    columns = len(entries) if sum(widths) < row else max(1, int(row / max(widths)))
    figure.legend(entries.values(), entries, loc="outside lower center", ncols=columns, fontsize=SMALL, frameon=False,
                  **spacing)  # fmt: skip


def _brief(label: str) -> str:
    """An entry of a legend in the words of :data:`BRIEF`."""
    for phrase, short in BRIEF.items():
        label = label.replace(phrase, short)
    return label


@lru_cache(1000)
def text_width(text: str, size: float) -> float:
    """How long a line of text is [pt], formulas included, to the control points of its letters."""
    from matplotlib.path import Path
    from matplotlib.textpath import TextPath

    if not text.strip():
        return 0.0
    outline = TextPath((0, 0), text, size=size)
    return float(np.ptp(outline.vertices[outline.codes != Path.CLOSEPOLY, 0]))


def _wrap(figure: Figure, panels: list[Axes]) -> None:
    """Break the titles of panels that are longer than their columns, and the labels of axes."""
    style, across, up = style_of(figure), 72 * figure.get_figwidth(), 72 * figure.get_figheight()
    for axes in panels:
        where = axes.get_position()
        if axes.get_subplotspec() is not None:
            sides: tuple[tuple[Literal["left", "center"], float], ...] = (("left", 1.0), ("center", 1.1))
            for loc, more in sides:
                room = more * across * where.width
                title(axes, _lines(axes.get_title(loc=loc), text_size(style, MEDIUM), room), loc)
        for axis, room in ((axes.xaxis, across * where.width), (axes.yaxis, up * where.height)):
            size = text_size(style, float(axis.label.get_fontsize()))
            axis.set_label_text(_lines(axis.get_label_text(), size, 1.15 * room))


def _lines(text: str, size: float, room: float) -> str:
    """A text in lines about as long as each other: broken between words, and at the underscores of a name."""
    lines = 1 if "\n" in text else math.ceil(text_width(text, size) / room)
    if lines < 2:
        return text
    if "$" in text:
        return textwrap.fill(text, len(text) // lines + 6)
    return textwrap.fill(text.replace("_", "_ "), len(text) // lines + 6).replace("_ ", "_")


def _no_latex(figure: Figure) -> None:
    """Whatever the user's matplotlibrc says: names of recordings must not become commands."""
    import matplotlib as mpl
    from matplotlib.text import Text

    if mpl.rcParams["text.usetex"]:  # else no text has it, and looking at each makes every tick
        for text in figure.findobj(Text):
            text.set_usetex(False)


def _letter(panels: list[Axes]) -> None:
    """Put (a), (b), … before the headings of panels, where there is more than one."""
    headed = [axes for axes in panels if axes.get_title() or axes.get_title(loc="left")]
    for letter, axes in zip("abcdefghijklmnopqrstuvwxyz", headed if len(headed) > 1 else (), strict=False):
        loc: Literal["left", "center"] = "left" if axes.get_title(loc="left") else "center"
        axes.set_title(f"({letter}) {axes.get_title(loc=loc)}", fontsize=MEDIUM, loc=loc)


def _bring_to(style: Style, figure: Figure) -> None:
    """Scale all text, lines and marks of a figure that was drawn in the sizes of the screen."""
    if style.text == style.lines == style.marks == 1.0 and not style.least_text and not style.least_line:
        return
    from matplotlib.collections import Collection
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch
    from matplotlib.text import Text

    size, width = text_size(style, SMALL), _thin(style, 0.8)
    for axes in figure.axes:  # ticks are made when they are drawn, and would not know
        axes.tick_params(labelsize=size, width=width, size=2.5)
    for part in _parts(figure):
        if isinstance(part, Text):
            part.set_fontsize(text_size(style, float(part.get_fontsize())))
        elif isinstance(part, Collection):
            part.set_linewidth([_thin(style, width) for width in np.atleast_1d(part.get_linewidth())])
        elif isinstance(part, Line2D | Patch):
            part.set_linewidth(_thin(style, part.get_linewidth()))
        if isinstance(part, Line2D):
            part.set_markersize(style.marks * part.get_markersize())
            part.set_markeredgewidth(_thin(style, part.get_markeredgewidth()))


def text_size(style: Style, size: float) -> float:
    """A text's size in a style [pt]."""
    return max(style.text * size, style.least_text)


def _thin(style: Style, width: float) -> float:
    """A line's width in a style; none stays none."""
    return max(style.lines * width, style.least_line) if width > 0 else 0.0


def _parts(artist: Artist) -> Iterator[Artist]:
    """All that a figure is made of, but for the ticks of its axes."""
    from matplotlib.axis import Axis, Tick

    for child in artist.get_children():
        if not isinstance(child, Tick):
            yield child
            yield from (child.label, child.offsetText) if isinstance(child, Axis) else _parts(child)


def _dress(axes: Axes, grid: bool) -> None:
    axes.spines[["top", "right"]].set_visible(not grid)
    axes.tick_params(labelsize=SMALL)
    for label in (axes.xaxis.label, axes.yaxis.label):
        label.set_fontsize(MEDIUM)
    if grid:
        axes.grid(alpha=0.25, lw=0.6)
        axes.set_axisbelow(True)
        if axes.get_autoscalex_on():
            axes.margins(x=0.02)


def title(axes: Axes, text: str, loc: Literal["left", "center"] = "center") -> None:
    """Write above a panel."""
    axes.set_title(text, fontsize=MEDIUM, loc=loc)


def label(axes: Axes, heading: str, x: str, y: str, ticks: int | None = 6) -> None:
    """Title a panel and its two axes; of an x axis that is logarithmic the ticks stay, None."""
    title(axes, heading)
    if ticks is not None:
        axes.locator_params(axis="x", nbins=ticks)
    axes.set(xlabel=x, ylabel=y)


def line(axes: Axes, time: FloatArray, y: FloatArray, **style: Any) -> None:
    """Draw samples as a line; few as dots too."""
    dots: dict[str, Any] = {"marker": "o", "ms": 3} if y.size <= 100 else {}
    indices = extremes([y], 2 * BINS)
    axes.plot(time[indices], y[indices], **dots, **style)


def encoder_band(axes: Axes, step: float | None, unit: str = "rad", *, upright: bool = False) -> None:
    """Shade where an error by rounding alone would lie; its edges lie over the residual, which would hide them."""
    if step:
        half = shown_unit(unit)[1] * step / 2
        span, line = (axes.axvspan, axes.axvline) if upright else (axes.axhspan, axes.axhline)
        label = f"± ½ {words_of(unit)['step']} of {with_unit(step, unit)}"
        span(-half, half, color=ORANGE, alpha=0.3, lw=0, zorder=0.5, label=label)
        for edge in (-half, half):
            line(edge, color=ORANGE, lw=0.8, zorder=3)


def axis_unit(unit: str) -> tuple[str, float]:
    """How an axis shows a unit, "–" for a pure number, and the factor to it.

    Examples
    --------
    >>> axis_unit("kg m^2"), axis_unit("1")
    (('kg m²', 1.0), ('–', 1.0))
    """
    display_unit, factor = shown_unit(unit)
    return plain(typeset_unit(display_unit)) or "–", factor


def encoder_step(resolution: Quanta, name: str) -> float | None:
    """The step of a signal's encoder, None where it has none or none is known."""
    step = (resolution or {}).get(name)
    return step if step is not None and 0 < step < np.inf else None


def note(axes: Axes, text: str, height: float = 0.5) -> None:
    """Write across a panel."""
    axes.text(0.5, height, text, transform=axes.transAxes, ha="center", va="center", fontsize=MEDIUM,
              bbox={"fc": "white", "ec": "0.7", "boxstyle": "round"})  # fmt: skip


def plain_log(axes: Axes, which: Literal["x", "y"] = "y", room: float = 1.0) -> None:
    """A logarithmic axis with plain numbers, the more the less it spans, and some room at both ends."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.set(**{f"{which}scale": "log"})
    axis = axes.xaxis if which == "x" else axes.yaxis
    low, high = axis.get_view_interval()
    axis.set_view_interval(low / room, high * room, ignore=True)
    span = room**2 * high / low
    axis.set_major_locator(LogLocator(subs=(1, 1.5, 2, 3, 5, 7) if span < 12 else (1, 2, 5) if span < 100 else (1,)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.3g}"))
    axis.set_minor_formatter(NullFormatter())


def extent(x: FloatArray) -> tuple[float, float]:
    """Least and greatest of the finite values; two zeros where there are none."""
    values = x[np.isfinite(x)]
    return (float(values.min()), float(values.max())) if values.size else (0.0, 0.0)


def angle_label(name: str, display_unit: str, zero: str) -> str:
    """What stands at the axis of a signal: its letter, where it is zero if that is a posture of the rig, and its unit.

    Examples
    --------
    >>> angle_label("alpha", "°", "hanging"), angle_label("theta", "°", "")
    ('$\\\\alpha$, 0 = hanging [°]', '$\\\\theta$ [°]')
    """
    where = f", 0 = {plain(zero)}" if zero else ""
    return f"{symbol(name)}{where} [{display_unit}]"


def unknown_label(name: str, unit: str, model: Model) -> tuple[str, float]:
    """What stands at the axis of an unknown, and the factor to its unit there."""
    display_unit, factor = axis_unit(unit)
    order = "order " if name in model.order_names and not name.startswith("order") else ""
    of_zero = model.pendulum and name.startswith(f"{model.pendulum}(0)")
    where = f", 0 = {plain(model.zero)}" if of_zero and model.zero else ""
    return f"{order}{symbol(name)}{where} [{display_unit}]", factor


def spoken(text: str) -> str:
    r"""A text without the marks of formulas, for a file's metadata.

    Examples
    --------
    >>> spoken(r"a\$b, residual of $\alpha$")
    'a$b, residual of α'
    """
    for name, letter in GREEK.items():
        text = text.replace(SYMBOLS[name], letter)
    return text.replace(r"\$", "$")


def number(value: float, digits: int) -> str:
    """A number with a true minus."""
    return f"{value:.{digits}f}".replace("-", "−")


def symbol(name: str) -> str:
    """The letter of a signal or an order; of a start value, ``alpha(0) [release]``, with what follows it."""
    head, bracket, rest = name.partition("(")
    if bracket and head in SYMBOLS:
        return SYMBOLS[head] + plain(bracket + rest)
    return SYMBOLS.get(name, plain(name))


def plain(text: str, length: int = 60) -> str:
    """Return a user's words as matplotlib can show them: on one line, no formulas, only glyphs of the font."""
    from matplotlib.font_manager import findfont, get_font

    glyphs = get_font(findfont("DejaVu Sans")).get_charmap()
    line = "".join(c if ord(c) in glyphs else "□" for c in " ".join(str(text).split()))
    return cut(line, length).replace("$", r"\$")


def cost_label(name: str) -> tuple[str, str]:
    """Name and unit of a cost, as shown; no unit for one that is not ours."""
    return (name.upper(), f"[{COSTS[name].unit}]") if name in COSTS else (plain(name), "")


def goodness(recording: RecordingFit, name: str, step: float | None) -> str:
    """Fit and RMSE in words, or why there are none."""
    if missing := np.count_nonzero(~np.isfinite(recording.fitted[name])):
        return f"no fit; the simulation has no value at {missing} of {recording.time.size} samples"
    rmse, percent = recording.rmse[name], recording.fit_percent[name]
    fit = f"fit {number(percent, 1)} %" if percent > -1e4 else "fit below −10 000 %"
    fit = fit if np.ptp(recording.measured[name]) else "fit undefined (constant signal)"
    counts = rmse / step if step else np.inf
    unit = recording.unit(name)
    in_steps = f" ({counts:.{1 if counts < 10 else 0}f} {words_of(unit)['steps']})" if counts < 1e3 else ""
    return f"{fit}, RMSE {with_unit(rmse, unit)}{in_steps}"
