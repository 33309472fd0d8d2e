"""The page's charts, each described once: as SVG that stands on paper and without a script, and as data for uPlot.

The SVG takes its colours from the classes of ``page.css``, so it follows the theme; its text is text.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil, floor, log10
from typing import Any

import numpy as np
from markupsafe import Markup

from fracid.arrays import FloatArray, extremes
from fracid.report.drawing import drawn, tick
from fracid.report.samples import base64_floats

LEFT, RIGHT, TOP, BOTTOM = 58.0, 66.0, 6.0, 40.0
"""Room around the plot for ticks and labels [px]."""

KEYS = 16.0
"""Of several lines, what each is: a row above the plot [px]."""

ENCODER_STEPS = (1, 3, 10, 30, 100, 300, 1000)
"""Where the right axis of a residual has its ticks, to both sides."""

RESIDUAL_HEIGHT = 80.0
"""Of a residual's plot, about [px]."""


@dataclass(frozen=True)
class Series:
    """One line of a chart."""

    label: str
    y: FloatArray
    """Shape (n,); not finite where there is a gap."""
    kind: str
    """How it is drawn: a class of ``page.css``, a row of ``KINDS`` in ``charts.js``."""


@dataclass(frozen=True)
class Band:
    """A strip across the plot."""

    axis: str
    """``x`` or ``y``: the one whose values bound it."""
    low: float
    high: float
    kind: str = "band"


@dataclass(frozen=True)
class Mark:
    """A line across the plot, with a word."""

    axis: str
    at: float
    text: str = ""
    kind: str = "mark"
    before: bool = False
    """The word stands to the left of the line, where there is room, so that two do not overlap; else a row lower."""


@dataclass(frozen=True)
class Chart:
    """What is drawn over what."""

    title: str
    x: FloatArray
    """Shape (n,), rising."""
    xlabel: str
    ylabel: str
    series: tuple[Series, ...]
    xname: str
    """Short, for the legend."""
    bands: tuple[Band, ...] = ()
    marks: tuple[Mark, ...] = ()
    height: int = 190
    """[px]"""
    logx: bool = False
    logy: bool = False
    yrange: tuple[float, float] | None = None
    right: tuple[tuple[float, str], ...] = ()
    """Ticks of an axis to the right: where, and what stands there."""
    rightlabel: str = ""

    def packed(self) -> dict[str, Any]:
        """As ``charts.js`` takes it."""
        lines = [vars(s) | {"y": base64_floats(s.y)} for s in self.series]
        return vars(self) | {"x": base64_floats(self.x), "series": lines}


# --- axes ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Axis:
    """Values to places [px]."""

    low: float
    high: float
    start: float
    end: float
    log: bool = False

    def at(self, values: Any) -> FloatArray:
        """Places of values."""
        with np.errstate(divide="ignore", invalid="ignore"):
            v, low, high = ((np.log10(u) if self.log else np.asarray(u, dtype=float))
                            for u in (values, self.low, self.high))  # fmt: skip
        return np.asarray(self.start + (v - low) / (high - low) * (self.end - self.start))

    def within(self, value: float) -> float:
        """The place of a value, or the end that it is beyond."""
        return float(self.at(min(max(value, self.low), self.high)))

    def inside(self, value: float) -> bool:
        """Whether a value is on the axis."""
        return self.low <= value <= self.high

    def ticks(self, space: float) -> list[float]:
        """Round values, at least so far apart [px]."""
        if self.log:
            powers = range(ceil(log10(self.low) - 1e-9), floor(log10(self.high) + 1e-9) + 1)
            apart = ceil(space * max(1, len(powers)) / abs(self.end - self.start))
            return [10.0**k for k in powers if k % apart == 0]
        step = round_step((self.high - self.low) * space / abs(self.end - self.start))
        return [k * step for k in range(ceil(self.low / step - 1e-9), floor(self.high / step + 1e-9) + 1)]


def round_step(least: float) -> float:
    """1, 2 or 5 times a power of ten, not below.

    Examples
    --------
    >>> round_step(0.03)
    0.05
    """
    power = 10.0 ** floor(log10(least))
    return float(next(m * power for m in (1, 2, 5, 10) if m * power >= least * (1 - 1e-9)))


def _bounds(values: list[FloatArray], log: bool, pad: float) -> tuple[float, float]:
    """The ends of what is finite, with some air."""
    joined = np.concatenate(values)
    joined = joined[np.isfinite(joined) & ((joined > 0) | (not log))]
    if not joined.size:
        return (1.0, 10.0) if log else (0.0, 1.0)
    low, high = float(joined.min()), float(joined.max())
    if log:
        return (low / 1.2, high * 1.2) if low == high or pad else (low, high)
    air = pad * (high - low) or (0.0 if high > low else abs(high) or 1.0)
    return low - air, high + air


def fitting(label: str, room: float) -> str:
    """What an axis is called where there is so much room [px]: its unit alone where it has a long name.

    Examples
    --------
    >>> fitting("α [°]", 60.0), fitting("displacement_of_holder [m]", 60.0), fitting("displacement_of_holder", 60.0)
    ('α [°]', '[m]', '')
    """
    return label if 6.5 * len(label) <= room else label[label.rfind("[") :] if "[" in label else ""


def encoder_ticks(limit: float, step: float | None) -> tuple[tuple[float, str], ...]:
    """Ticks of a residual's right axis, in encoder steps: ±1 and ±3 always, words where there is room for them.

    Parameters
    ----------
    limit : float
        The axis goes from −limit to limit.
    step : float, optional
        Of the encoder, in the axis's unit; without one there is no tick.

    Returns
    -------
    tuple of (place, text)
        An empty text where two words would touch.

    Examples
    --------
    >>> encoder_ticks(0.4, 0.1)
    ((-0.3, '−3'), (-0.1, '−1'), (0.1, '+1'), (0.3, '+3'))
    >>> [text for _, text in encoder_ticks(2.0, 0.1)]
    ['−10', '−3', '', '', '+3', '+10']
    """
    if step is None:
        return ()
    per_step = RESIDUAL_HEIGHT / (2 * limit / step)
    last, up = -6.0, []
    for n in (n for n in ENCODER_STEPS if n * step <= limit):
        legible = n * per_step - last >= 12.0
        last = n * per_step if legible else last
        up.append((round(n * step, 12), f"+{n}" if legible else ""))
    return (*((-at, text.replace("+", "−")) for at, text in reversed(up)), *up)


# --- the drawing ---------------------------------------------------------------------------------


def still(chart: Chart, width: int = 720, points: int = 900, room: float = 12.0) -> Markup:
    """A chart as SVG.

    Parameters
    ----------
    chart : Chart
    width : int
        [px]; it scales.
    points : int
        At most so many of a line.
    room : float
        To the right of the plot [px] at least, where it has no axis there: those below each other end at one place.

    Returns
    -------
    Markup
        An element ``<svg>``, its words escaped.

    Examples
    --------
    >>> t = np.linspace(0, 1, 5)
    >>> text = still(Chart("<swing>", t, "time [s]", "α [°]", (Series("measured", np.sin(t), "measured"),), "time"))
    >>> text.startswith('<svg class="still"'), "<swing>" in text, "&lt;swing&gt;" in text
    (True, False, True)
    """
    bottom = chart.height - (BOTTOM if chart.xlabel else 20.0)
    x = Axis(*_bounds([chart.x], chart.logx, 0.0), LEFT, width - room, chart.logx)
    halves = [3.5 * len(tick(v, x.log)) + 1.0 for v in x.ticks(70)[-1:]]  # of the last label
    right = RIGHT if chart.right else max(room, *halves)
    x = replace(x, end=width - right)
    ends = chart.yrange or _bounds([s.y for s in chart.series], chart.logy, 0.05)
    y = Axis(*ends, bottom, TOP + KEYS * (len(chart.series) > 1), chart.logy)
    lines = Markup("".join(_path(chart.x, s, x, y, points=points) for s in chart.series))
    return drawn("chart.svg.j2", chart=chart, x=x, y=y, width=width, right=right, left=LEFT, top=TOP, lines=lines,
                 ylabel=fitting(chart.ylabel, chart.height))  # fmt: skip


def _path(at: FloatArray, series: Series, x: Axis, y: Axis, points: int) -> str:
    """A line in tenths of a pixel, each point from the one before."""
    finite = np.isfinite(series.y) & ((series.y > 0) | (not y.log)) & ((at > 0) | (not x.log))
    if not finite.any():
        return ""
    keep = extremes([np.where(finite, series.y, np.nan)], points)
    places = np.stack([x.at(at[keep]), y.at(np.clip(np.where(finite, series.y, y.low), y.low, y.high)[keep])], axis=1)
    if series.kind == "points":  # a line without length and with round ends is a dot
        d = "".join(f"M{a} {b}h0" for a, b in np.rint(10 * places).astype(int).tolist())
    else:
        runs = np.split(np.arange(keep.size), np.flatnonzero(np.diff(finite[keep])) + 1)
        d = "".join(steps(places[run]) for run in runs if finite[keep[run[0]]])
    return f'<path class="{series.kind}" transform="scale(.1)" d="{d}"/>'


def steps(places: FloatArray, close: str = "") -> str:
    """The way through places, shape (n, 2), in tenths of a pixel, each from the one before.

    Examples
    --------
    >>> steps(np.array([[1.0, 2.0], [1.5, 1.0]]))
    'M10 20l5-10'
    """
    first, *rest = np.diff(np.rint(10 * places).astype(int), axis=0, prepend=0).tolist()
    return (f"M{first[0]} {first[1]}l" + " ".join(f"{a} {b}" for a, b in rest)).replace(" -", "-") + close
