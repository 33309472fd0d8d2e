"""The paper's Figure 1 for any rotary pendulum: the rig to scale, with the zeros and positive senses of both angles.

Seen from the right and above, without perspective: lines that are parallel stay so, and lengths along one direction
can be compared.  The camera stands where the arm points to the right and towards the reader.  A point at x is drawn at

.. math::  (x \\cdot r,\\; x \\cdot u) , \\qquad
    r = (-\\sin φ, \\cos φ, 0), \\quad u = (-\\sin ε \\cos φ, -\\sin ε \\sin φ, \\cos ε)

for a camera in the direction φ at the height ε.  Arm and pendulum are as long as :mod:`fracid.models.geometry` has
them; the base, all thicknesses and the angles shown are the draughtsman's.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fracid.arrays import FloatArray
from fracid.models.geometry import RigGeometry
from fracid.plots import appearance
from fracid.units import with_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from fracid.figures import Style
    from fracid.models import Model

THETA, ALPHA = math.radians(118.0), math.radians(32.0)
"""The angles shown: positive, so that each arrow leads from its zero to the part that it turns."""

CAMERA = THETA - math.radians(57.0), math.radians(24.0)
"""φ and ε: the arm's end lies 57° to the right of the camera's direction."""

LIGHT = np.array([-0.35, 0.75, 0.56])
"""Where the light comes from: right, up and towards the reader; of length 1."""

METAL, DARK, ROD = (0.97, 0.97, 0.98), (0.80, 0.82, 0.85), (0.96, 0.62, 0.38)
"""Colours of arm, base and pendulum in full light; in grey they differ too."""

WIDTH, HEIGHT, MARGIN, NOTES = 6.0, 5.4, 0.45, 0.85
"""Of the picture, at most; about the rig, for what is written there; for the lines below [inch]."""

GAP = 17.0
"""Between a part and its dimension line [pt]."""

UP = np.array([0.0, 0.0, 1.0])


def rig_drawing(model: Model, *, style: str | Style = "screen") -> Figure:
    """Draw the paper's Figure 1 of a rig: arm, pendulum and axes to scale, zero and positive sense of both angles.

    Parameters
    ----------
    model : Model
        From :func:`fracid.rotary_pendulum`, with any constants.
    style : str or Style
        ``screen``, ``journal`` or one's own: :mod:`fracid.figures`.

    Returns
    -------
    matplotlib.figure.Figure
        The arrows lead from each angle's zero in its positive sense.  The pendulum is the uniform rod that swings as
        fast, since its constants tell no more of it; a ring is at its centre of oscillation, which they do tell.

    Raises
    ------
    InputError
        If the model says nothing of its shape, or a constant that makes a length is zero.

    References
    ----------
    The lengths and senses: :mod:`fracid.models.geometry`.

    Examples
    --------
    >>> import fracid
    >>> figure = rig_drawing(fracid.rotary_pendulum("qube-servo2", zero="upright"))
    >>> [text.get_text() for text in figure.axes[0].texts][3:5]
    ['$\\\\theta$ = 0', '$\\\\alpha$ = 0, upright']
    """
    shape = model.geometry()
    drawing = _Drawing(shape)
    low, high = drawing.extent()
    width, height = high - low
    scale = min((WIDTH - 2 * MARGIN) / width, (HEIGHT - 2 * MARGIN) / height)  # [inch/m]
    paper = np.array([WIDTH, scale * height + 2 * MARGIN])
    figure = appearance.new(WIDTH, paper[1] + NOTES, style)
    axes = figure.subplots()
    _zeros(axes, drawing)
    _base(axes, drawing)
    _parts(axes, drawing)
    _angles(axes, drawing)
    _lengths(axes, drawing)
    (left, bottom), (right, top) = (low + high - paper / scale) / 2, (low + high + paper / scale) / 2
    axes.set(aspect="equal", xlim=(left, right), ylim=(bottom, top))
    axes.set_axis_off()
    note = _note(model, shape)
    length = appearance.text_width(note, appearance.text_size(appearance.style_of(figure), appearance.SMALL))
    columns = int(len(note) * 0.92 * 72 * figure.get_figwidth() / length)
    lines = textwrap.wrap(note, columns)
    if (shrunk := figure.get_figwidth() / WIDTH) != 1:  # the drawing keeps its shape, its note needs its lines
        figure.set_figheight(shrunk * float(paper[1]) + 0.17 * (len(lines) + 1))
    figure.supxlabel("\n".join(lines), x=0.02, ha="left", fontsize=appearance.SMALL)
    appearance.finish(figure, appearance.plain(model.source.split(". ")[0], 90), grid=False)
    return figure


@dataclass(frozen=True)
class _Drawing:
    """A rig, and how its points come onto the paper; all in metres."""

    shape: RigGeometry

    @property
    def size(self) -> float:
        """Of what has no length of its own: thicknesses, the base."""
        return math.sqrt(self.shape.arm * self.shape.pendulum)

    @property
    def thick(self) -> float:
        """Half the thickness of the arm."""
        return 0.026 * self.size

    @property
    def hub(self) -> float:
        """Radius of the motor."""
        return min(0.13 * self.size, 0.3 * self.shape.arm)

    @property
    def floor(self) -> float:
        """Height of the floor: a hanging pendulum swings clear of it."""
        return -1.12 * self.shape.pendulum if self.shape.zero == "hanging" else -max(0.75 * self.size, 3 * self.hub)

    @property
    def end(self) -> FloatArray:
        """The arm's end."""
        return self.shape.pose(THETA, ALPHA)[0]

    def on_paper(self, points: Any) -> FloatArray:
        """Points in space, shape (..., 3), as they are drawn, shape (..., 2)."""
        return np.asarray(np.asarray(points) @ np.transpose(_screen()[:2]))

    def zero_line(self) -> FloatArray:
        """The pendulum's direction at α = 0."""
        return self.shape.along(THETA, 0.0)

    def theta_arc(self, to: float, radius: float) -> FloatArray:
        """From θ = 0 in its positive sense, shape (n, 3)."""
        return np.array([radius * self.shape.directions(t)[0] for t in np.linspace(0, to, 60)])

    def alpha_arc(self, to: float, radius: float) -> FloatArray:
        """From α = 0 in its positive sense, shape (n, 3)."""
        return np.array([self.end + radius * self.shape.along(THETA, a) for a in np.linspace(0, to, 60)])

    def extent(self) -> tuple[FloatArray, FloatArray]:
        """The least and the greatest coordinates on paper of what has to be seen, shape (2,) each."""
        shape = self.shape
        x, y = shape.directions(0.0)
        foot = [self.floor * UP + s * 0.22 * self.size * e for s in (-1, 1) for e in (_screen()[0], _screen()[2])]
        anchors = [*foot, 1.1 * shape.arm * x, 0.95 * shape.arm * y, 0.4 * self.size * UP, shape.pose(THETA, ALPHA)[1],
                   self.end + 1.1 * shape.pendulum * self.zero_line()]  # fmt: skip
        points = self.on_paper(anchors)
        return points.min(axis=0), points.max(axis=0)


def _screen() -> FloatArray:
    """Right, up and towards the reader, shape (3, 3)."""
    φ, ε = CAMERA
    right = [-math.sin(φ), math.cos(φ), 0.0]
    up = [-math.sin(ε) * math.cos(φ), -math.sin(ε) * math.sin(φ), math.cos(ε)]
    return np.array([right, up, np.cross(right, up)])


# ------------------------------------------------------------------ axes and zeros


def _zeros(axes: Axes, d: _Drawing) -> None:
    """The axes, and the lines from which the angles are counted."""
    shape, origin = d.shape, np.zeros(3)
    x, y = shape.directions(0.0)
    thin: dict[str, Any] = {"color": appearance.INK, "lw": 0.9}
    _line(axes, d, d.theta_arc(1.15 * THETA, shape.arm), color="0.75", lw=0.7, zorder=0.5)
    for direction, length, name in ((x, 1.1 * shape.arm, "x"), (y, 0.95 * shape.arm, "y"), (UP, 0.4 * d.size, "z")):
        start = 0.05 * d.size * UP if name == "z" else origin
        _arrow(axes, d.on_paper([start, length * direction]), zorder=2.8 if name == "z" else 1.2, scale=9, **thin)
        _text(axes, d.on_paper(1.06 * length * direction), f"${name}$", _beyond(d.on_paper(direction)))
    _line(axes, d, [d.floor * UP, origin], ls=(0, (8, 3, 1.5, 3)), zorder=0.6, **thin)
    _text(axes, d.on_paper(0.78 * shape.arm * x), f"{appearance.symbol('theta')} = 0", (0, 10), color=appearance.BLUE)
    far = d.end + 1.06 * shape.pendulum * d.zero_line()
    _line(axes, d, [d.end, far], color=appearance.INK, lw=0.9, ls=(0, (4, 3)), zorder=5)
    off = f"{with_unit(abs(shape.offset))} off " if shape.offset else ""
    below = d.on_paper(far)[1] < d.on_paper(d.end)[1]
    caption = f"{appearance.symbol('alpha')} = 0, {off}{shape.zero}"
    _text(axes, d.on_paper(far), caption, (0, -9 if below else 9), color=appearance.VERMILLION)


def _angles(axes: Axes, d: _Drawing) -> None:
    """The two curved arrows: from zero, in the positive sense."""
    about_z, about_arm = 0.55 * d.shape.arm, 0.55 * d.shape.pendulum
    short = 2.2 * d.thick  # up to the part, not into it
    theta = d.theta_arc(THETA - short / about_z, about_z)
    alpha = d.alpha_arc(max(ALPHA - 0.55 * short / about_arm, 0.3 * ALPHA), about_arm)
    arcs = (
        ("theta", theta, np.zeros(3), appearance.BLUE, 2.2, 0.28),
        ("alpha", alpha, d.end, appearance.VERMILLION, 5.5, 0.5),
    )
    for name, arc, centre, colour, zorder, at in arcs:
        points = d.on_paper(arc)
        sector = np.vstack([d.on_paper(centre), points])
        axes.fill(*sector.T, color=colour, alpha=0.12, lw=0, zorder=zorder - 0.5)
        _arrow(axes, points, color=colour, lw=1.6, zorder=zorder, scale=13, gid=f"positive-{name}")
        middle = points[round(at * len(points))]
        away = _beyond(middle - d.on_paper(centre))
        _text(axes, middle, appearance.symbol(name), away, color=colour, fontsize=appearance.LARGE + 1)


def _lengths(axes: Axes, d: _Drawing) -> None:
    """Dimension lines: above the arm, and on that side of the pendulum where its zero is not."""
    tip = d.shape.pose(THETA, ALPHA)[1]
    rod, zero = d.on_paper(tip - d.end), d.on_paper(d.zero_line())
    free = 1.0 if rod[0] * zero[1] - rod[1] * zero[0] < 0 else -1.0
    for name, ends, side in (("$l_1$", (np.zeros(3), d.end), 1.0), ("$L$", (d.end, tip), free)):
        _dimension(axes, d.on_paper(ends), f"{name} = {_millimetres(math.dist(*ends))}", side)


def _millimetres(length: float) -> str:
    return f"{1e3 * length:.3g} mm" if length < 1 else f"{length:.3g} m"


def _dimension(axes: Axes, ends: FloatArray, text: str, side: float) -> None:
    """A line with a head at each end, beside two points on the left (1) or the right (-1) of the way between them."""
    from matplotlib.patches import FancyArrowPatch
    from matplotlib.transforms import ScaledTranslation

    along = ends[1] - ends[0]
    normal = side * np.array([-along[1], along[0]]) / math.hypot(*along)
    beside = axes.transData + ScaledTranslation(GAP * normal[0] / 72, GAP * normal[1] / 72, axes.figure.dpi_scale_trans)
    axes.add_patch(FancyArrowPatch(*map(tuple, ends), arrowstyle="<|-|>", mutation_scale=8, lw=0.8,
                                   color=appearance.INK, shrinkA=0, shrinkB=0, transform=beside, zorder=8))  # fmt: skip
    for end in ends:
        _text(axes, end, "", (GAP + 4) * normal, zorder=1.5,
              arrowprops={"arrowstyle": "-", "lw": 0.6, "color": "0.5", "shrinkA": 0, "shrinkB": 0})  # fmt: skip
    turn = (math.degrees(math.atan2(along[1], along[0])) + 90) % 180 - 90  # never upside down
    _text(axes, ends.mean(axis=0), text, (GAP + 9) * normal, rotation=turn, rotation_mode="anchor")


# ------------------------------------------------------------------ bodies


def _base(axes: Axes, d: _Drawing) -> None:
    """A foot, a column and the motor that turns the arm: none of it to scale."""
    floor, top = d.floor, -0.05 * d.size
    foot, motor = 0.22 * d.size, top - 1.6 * d.hub
    plate = floor + 0.03 * d.size
    _solid(axes, d, _cylinder(floor * UP, plate * UP, foot), DARK, 0.7)
    if motor > plate:
        _solid(axes, d, _cylinder(plate * UP, motor * UP, 0.45 * d.hub), DARK, 0.8)
    _solid(axes, d, _cylinder(max(motor, plate) * UP, top * UP, d.hub), DARK, 0.9)


def _parts(axes: Axes, d: _Drawing) -> None:
    """The arm with its hub, and the pendulum on its pivot."""
    shape, thick = d.shape, d.thick
    e_r, e_t = shape.directions(THETA)
    end, tip = shape.pose(THETA, ALPHA)
    rod = shape.along(THETA, ALPHA)
    _solid(axes, d, _cylinder(-0.05 * d.size * UP, 0.05 * d.size * UP, 0.5 * d.hub), METAL, 2.5)
    _solid(axes, d, _bar(0.4 * d.hub * e_r, end - thick * e_r, e_t, UP, thick), METAL, 3.0)
    _solid(axes, d, _cylinder(end - 1.8 * thick * e_r, end + 0.6 * thick * e_r, 1.3 * thick), DARK, 5.2)
    _solid(axes, d, _cylinder(end - 1.2 * thick * rod, tip, 0.7 * thick), ROD, 6.0)
    _solid(axes, d, _cylinder(end + 0.6 * thick * e_r, end + 1.1 * thick * e_r, 0.8 * thick), METAL, 6.2)
    centre = d.on_paper(end + shape.oscillation_centre * rod)
    axes.plot(*centre, marker="o", ms=5, mfc="white", mec=appearance.INK, mew=0.9, zorder=6.4, ls="")


def _cylinder(start: FloatArray, stop: FloatArray, radius: float, sides: int = 48) -> list[FloatArray]:
    """Faces of a cylinder, shape (n, 3) each: its two ends, then its sides."""
    axis = (stop - start) / np.linalg.norm(stop - start)
    first = np.cross(axis, UP if abs(axis[2]) < 0.9 else [1.0, 0.0, 0.0])
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    turn = np.linspace(0, 2 * math.pi, sides + 1)
    ring = radius * (np.outer(np.cos(turn), first) + np.outer(np.sin(turn), second))
    bottom, top = start + ring, stop + ring
    walls = [np.array([bottom[k], bottom[k + 1], top[k + 1], top[k]]) for k in range(sides)]
    return [bottom[:-1][::-1], top[:-1], *walls]


def _bar(start: FloatArray, stop: FloatArray, one: FloatArray, other: FloatArray, half: float) -> list[FloatArray]:
    """The six faces of a square bar whose sides look along two directions, shape (4, 3) each."""
    corners = [half * (i * one + j * other) for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    if np.cross(one, other) @ (stop - start) < 0:
        corners.reverse()
    bottom, top = np.array([start + c for c in corners]), np.array([stop + c for c in corners])
    walls = [np.array([bottom[k - 1], bottom[k], top[k], top[k - 1]]) for k in range(4)]
    return [bottom[::-1], top, *walls]


def _solid(axes: Axes, d: _Drawing, faces: Sequence[FloatArray], colour: tuple[float, ...], zorder: float) -> None:
    """Draw a convex body: the faces that look at the reader, lighter where they look at the light, and its outline."""
    from matplotlib.collections import PolyCollection
    from scipy.spatial import ConvexHull

    camera = _screen()
    normals = np.array([np.cross(face[1] - face[0], face[2] - face[1]) for face in faces])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    mask = normals @ camera[2] > 1e-9
    bright = 0.7 + 0.3 * np.clip(normals[mask] @ camera.T @ LIGHT, 0.0, 1.0)
    shades = np.clip(bright[:, None] * np.array(colour), 0, 1)
    polygons = [d.on_paper(face) for face, yes in zip(faces, mask, strict=True) if yes]
    axes.add_collection(PolyCollection(polygons, facecolors=shades, edgecolors=shades, linewidths=0.4, zorder=zorder))
    points = d.on_paper(np.vstack(faces))
    outline = points[ConvexHull(points).vertices]
    axes.fill(*outline.T, fill=False, ec="0.2", lw=0.7, zorder=zorder + 0.01, joinstyle="round")


# ------------------------------------------------------------------ lines and words


def _line(axes: Axes, d: _Drawing, points: Any, **style: Any) -> None:
    axes.plot(*d.on_paper(points).T, **style)


def _arrow(axes: Axes, points: FloatArray, *, scale: float, color: Any, **style: Any) -> None:
    """A line with a head at its end."""
    from matplotlib.patches import FancyArrowPatch
    from matplotlib.path import Path

    axes.add_patch(FancyArrowPatch(path=Path(points), arrowstyle="-|>", mutation_scale=scale, fc=color, ec=color,
                                   **style))  # fmt: skip


def _text(axes: Axes, at: FloatArray, text: str, shift: Sequence[float] | FloatArray, **style: Any) -> None:
    """Write at a point, shifted by so many points of type."""
    place: dict[str, Any] = {
        "ha": "center",
        "va": "center",
        "color": appearance.INK,
        "fontsize": appearance.MEDIUM,
        "zorder": 9,
    }
    across, up = map(float, shift)
    axes.annotate(text, (float(at[0]), float(at[1])), (across, up), textcoords="offset points", **place | style)


def _beyond(direction: FloatArray) -> FloatArray:
    """A shift of 9 pt in a direction on paper."""
    return np.asarray(9 * direction / max(math.hypot(*direction), 1e-12))


def _note(model: Model, shape: RigGeometry) -> str:
    """What is to scale, and what is not; which way the input drives."""
    sentences = [
        "Arm and pendulum to scale. The pendulum is drawn as the uniform rod that swings as fast; "
        f"○: its centre of oscillation, {_millimetres(shape.oscillation_centre)} from the pivot.",
        "Arrows: positive sense.",
    ]
    push = model.parameter(model.drive).value if model.drive else 0.0
    if push and model.inputs:
        sentences.append(f"A positive {appearance.plain(model.inputs[0])} drives θ "
                         f"{'positive' if push > 0 else 'negative'}.")  # fmt: skip
    return " ".join(sentences)
