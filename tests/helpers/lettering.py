"""What is wrong with the lettering of a figure: text beyond its sheet, on other text, on another panel."""

from itertools import combinations, pairwise

from matplotlib.axis import Axis
from matplotlib.text import Text

SLACK = 1.0
"""[pixels] at 100 per inch, by which boxes of letters may touch."""


APART = 3.0
"""[pixels] between the numbers of a horizontal axis, a space at least."""


def lettering(artist):
    """Every text of an artist that is seen, with the ticks that lie on their axis."""
    for child in artist.get_children():
        if not child.get_visible():
            continue
        if isinstance(child, Axis):
            yield from (text for text in (*_tick_labels(child), child.label, child.offsetText) if _seen(text))
        elif isinstance(child, Text):
            yield from [child] * _seen(child)
        else:
            yield from lettering(child)


def _tick_labels(axis):
    low, high = sorted(axis.get_view_interval())
    slack = 1e-9 * (high - low)
    for tick in axis.get_major_ticks():
        if low - slack <= tick.get_loc() <= high + slack:
            yield from (tick.label1, tick.label2)


def _seen(text):
    return text.get_visible() and bool(text.get_text().strip())


def faults_of_lettering(figure):
    """One line for each text that leaves the sheet, lies on another text or reaches into a panel not its own."""
    figure.draw_without_rendering()
    sheet = figure.bbox
    boxes = [(text, text.get_window_extent()) for text in lettering(figure)]
    panels = [(axes, axes.get_window_extent()) for axes in figure.axes]
    for text, box in boxes:
        if min(box.x0 - sheet.x0, sheet.x1 - box.x1, box.y0 - sheet.y0, sheet.y1 - box.y1) < -SLACK:
            yield f"{text.get_text()!r} leaves the sheet"
        for axes, frame in panels:
            if axes is not text.axes and _meet(box, frame):
                yield f"{text.get_text()!r} lies on the panel {axes.get_title() or axes.get_ylabel()!r}"
    upright = [(text, box) for text, box in boxes if text.get_rotation() % 90 == 0]  # a slanted text fills no box
    for (text, box), (other, its) in combinations(upright, 2):
        if _meet(box, its):
            yield f"{text.get_text()!r} lies on {other.get_text()!r}"

    numbers = [box for axes in figure.axes for box in _numbers(axes)]
    for axes, one, left, other, right in numbers:
        if right.x0 - left.x1 < APART:
            yield f"{one!r} runs into {other!r} below {axes.get_xlabel()!r}"


def _numbers(axes):
    """Neighbours below a panel, from left to right."""
    labels = [label for label in _tick_labels(axes.xaxis) if axes.xaxis.get_visible() and _seen(label)]
    rows = sorted((label.get_window_extent().x0, label.get_text(), label.get_window_extent()) for label in labels)
    for (_, one, left), (_, other, right) in pairwise(rows):
        if abs(left.y0 - right.y0) < SLACK:
            yield axes, one, left, other, right


def _meet(one, other):
    return min(min(one.x1, other.x1) - max(one.x0, other.x0), min(one.y1, other.y1) - max(one.y0, other.y0)) > SLACK
