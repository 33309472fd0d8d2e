"""A model's scene on paper: its bodies as they stand, dashed where every output is 0, and an arrow for each output."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from itertools import cycle

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fracid.arrays import FloatArray
from fracid.errors import InputError
from fracid.figures import Style
from fracid.models import Model
from fracid.models.scene import OPEN, Scene, on_paper
from fracid.plots.appearance import (
    BLUE,
    INK,
    LARGE,
    SMALL,
    VERMILLION,
    finish,
    new,
    plain,
    spoken,
    style_of,
    symbol,
    text_size,
    text_width,
)

WIDTH, HEIGHT = 6.0, 5.2
"""Of the figure, without what is written below [inch]."""

TURN, SHARE = 0.6, 0.2
"""What is shown of an output: an angle [rad]; of another so much that it moves something by this share of the scene."""

FIXED, MOVED = (0.80, 0.82, 0.85), (0.96, 0.62, 0.38)
"""Colours of what stands still and what moves; in grey they differ too."""


def rig_drawing(model: Model, *, style: str | Style = "screen") -> Figure:
    """Draw a model's scene, with the zero and the positive sense of each output.

    Parameters
    ----------
    model : Model
        One with a scene, with any constants.
    style : str or Style
        ``screen``, ``journal`` or one's own: :mod:`fracid.figures`.

    Returns
    -------
    matplotlib.figure.Figure
        Each arrow leads from an output's zero in its positive sense.

    Raises
    ------
    InputError
        If the model has no scene, or a constant makes a length of it infinite.

    Examples
    --------
    >>> import fracid
    >>> figure = rig_drawing(fracid.rotary_pendulum("qube-servo2", zero="upright"))
    >>> [text.get_text() for text in figure.axes[0].texts]
    ['$\\\\theta$', '$\\\\alpha$']
    """
    scene, constants = model.scene, [p.value for p in model.parameters]
    if scene is None:
        raise InputError(f"The model {model.name!r} is not drawn: it has no scene. Write one as [model.scene].")
    if not np.isfinite(scene.at({}, constants)).all():
        raise InputError(f"The model {model.name!r} is not drawn: with its constants a body of its scene is infinite.")
    shown = dict(_shown(model, scene, constants))
    figure = new(WIDTH, HEIGHT + 0.4, style)
    axes = figure.subplots()
    for body, line in scene.drawn({}, constants):
        if body.moves:
            axes.plot(*line.T, color="0.55", lw=0.8, ls=(0, (4, 3)), zorder=1)
    for body, line in scene.drawn(shown, constants):
        if body.shape in OPEN:
            axes.plot(*line.T, color="0.2", lw=1.2, zorder=2)
        else:
            axes.fill(*line.T, fc=MOVED if body.moves else FIXED, ec="0.2", lw=1.0, zorder=2, joinstyle="round")
    for name, colour in zip(scene.moved_by, cycle((BLUE, VERMILLION, INK))):
        _arrow(axes, name, _way(scene, name, shown, constants), colour)
    axes.set(aspect="equal")
    axes.margins(0.08)
    axes.set_axis_off()
    _note(figure, model)
    heading = model.source.split(". ")[0] if model.paper else model.about or model.name  # a rig is known by its maker
    return finish(figure, plain(heading, 90), grid=False)


def _shown(model: Model, scene: Scene, constants: Sequence[float]) -> Iterator[tuple[str, float]]:
    """Each output that moves something, and its value."""
    places, _ = on_paper(scene.at({}, constants))
    size = np.ptp(places.reshape(-1, 2), axis=0).max()
    for name in scene.moved_by:
        moved = np.abs(on_paper(scene.at({name: 1e-3}, constants))[0] - places).max() / 1e-3
        yield name, TURN if model.output_unit(name) == "rad" else SHARE * size / max(moved, 1e-12)


def _way(scene: Scene, name: str, shown: Mapping[str, float], constants: Sequence[float]) -> FloatArray:
    """Where a point of the first body that an output moves goes as that output grows from 0, shape (n, 2)."""
    ends = np.array([on_paper(scene.at({**shown, name: s * shown[name]}, constants))[0] for s in np.linspace(0, 1, 60)])
    body = ends[:, int(np.argmax(np.ptp(ends, axis=0).max(axis=(1, 2)) > 0))]
    return np.asarray(0.3 * body[:, 0] + 0.7 * body[:, 1])


def _arrow(axes: Axes, name: str, way: FloatArray, colour: str) -> None:
    from matplotlib.patches import FancyArrowPatch
    from matplotlib.path import Path

    axes.add_patch(FancyArrowPatch(path=Path(way), arrowstyle="-|>", mutation_scale=14, lw=1.8, fc="none", ec=colour,
                                   zorder=4, gid=f"positive-{name}"))  # fmt: skip
    along = way[-1] - way[0]
    aside = 11 * np.array([along[1], -along[0]]) / max(float(np.hypot(*along)), 1e-12)  # [pt]
    axes.annotate(symbol(name), tuple(way[len(way) // 2]), tuple(aside), textcoords="offset points",
                  ha="center" if abs(aside[0]) < 4 else "left" if aside[0] > 0 else "right", va="center",
                  color=colour, fontsize=LARGE + 1, zorder=5,
                  bbox={"fc": "white", "alpha": 0.7, "lw": 0, "pad": 0.5})  # fmt: skip


def _note(figure: Figure, model: Model) -> None:
    """Below: what zero is, and which way the input drives."""
    zero = f" ({spoken(symbol(model.pendulum))} = 0: {model.zero})" if model.zero else ""
    push = model.parameter(model.drive).value if model.drive else 0.0
    way = "positive" if push > 0 else "negative"
    drives = [f" A positive {plain(n)} drives θ {way}." for n in model.inputs[:1] if push]
    note = f"Dashed: every output 0{zero}. Arrows: positive sense.{''.join(drives)}"
    length = text_width(note, text_size(style_of(figure), SMALL))
    columns = int(len(note) * 0.92 * 72 * figure.get_figwidth() / length)
    figure.supxlabel(textwrap.fill(note, columns), x=0.02, ha="left", fontsize=SMALL)
