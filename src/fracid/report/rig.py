"""How large the moving rig is drawn: its shape by :mod:`fracid.models.geometry`, with the pendulum as found.

The arm is that of the rig as given: a fit may put into C3 what is friction.  The pendulum is as found, where C1 is
identifiable: its swing is what a recording tells best (``Drawing.as_found``).
"""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, hypot, pi, sin, sqrt
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from fracid.arrays import FloatArray
from fracid.errors import InputError

if TYPE_CHECKING:
    from fracid.models import Model


def rig_lengths(model: Model, parameters: Mapping[str, Any] | None = None) -> dict[str, Any] | None:
    """Arm and pendulum [m] and where the pendulum's angle is zero; None for a model that is not drawn.

    Parameters
    ----------
    model : Model
    parameters : mapping, optional
        The parameters of result.json.

    Examples
    --------
    >>> import fracid
    >>> found = rig_lengths(fracid.rotary_pendulum("srv02-rotpen"))
    >>> round(found["arm"], 3), round(found["pendulum"], 3), found["zero"]
    (0.216, 0.325, 'hanging')
    """
    if model.drawing is None:
        return None
    for name in model.drawing.as_found:
        constant = (parameters or {}).get(name, {})
        if constant.get("identifiable") == "identifiable" and constant["value"] and constant["value"] > 0:
            model = model.with_parameters(**{name: constant["value"]})
    try:
        shape = model.geometry()
    except InputError:  # a constant that makes a length is zero
        return None
    if shape.sense < 0:
        return None
    return {"arm": shape.arm, "pendulum": shape.pendulum, "zero": model.zero}


# --- the still, for paper and where no script runs ---------------------------------------------------

AZIMUTH, ELEVATION, DISTANCE = -0.9, 0.42, 4.0
"""Where ``rig.js`` begins to look from [rad, rad, radii of what is seen]."""


def rig_still(lengths: Mapping[str, Any], θ: FloatArray, α: FloatArray, size: tuple[int, int] = (400, 300)) -> Markup:
    """The rig as simulated at the first sample, with the way of its tip, as SVG.

    Parameters
    ----------
    lengths : mapping
        From :func:`rig_lengths`.
    θ, α : array, shape (n,)
        [rad], of the part that is drawn.
    size : (int, int)
        Width and height [px].

    Examples
    --------
    >>> t = np.linspace(0, 3, 50)
    >>> drawn = rig_still({"arm": 0.2, "pendulum": 0.3, "zero": "hanging"}, 0 * t, 0.5 * np.cos(6 * t))
    >>> drawn.count('class="rod"'), 'class="way"' in drawn
    (1, True)
    """
    arm, rod = lengths["arm"], lengths["pendulum"]
    column = 1.08 * rod
    up = (1.0 if lengths["zero"] == "upright" else -1.0) * rod * np.cos(α)
    side = rod * np.sin(α)
    ends = np.stack([arm * np.cos(θ), arm * np.sin(θ), 0 * θ])
    tips = ends + np.stack([-side * np.sin(θ), side * np.cos(θ), up])
    top = max(float(tips[2].max()), 0.12 * rod)
    middle, radius = (top - column) / 2, 1.06 * hypot(arm, (top + column) / 2)

    def seen(points: Any) -> str:
        """World [m], shape (3,) or (3, n), as a row of places [px]."""
        x, y, z = np.reshape(points, (3, -1))
        right, back = cos(AZIMUTH) * x - sin(AZIMUTH) * y, sin(AZIMUTH) * x + cos(AZIMUTH) * y
        z = z - middle
        height, depth = cos(ELEVATION) * z + sin(ELEVATION) * back, cos(ELEVATION) * back - sin(ELEVATION) * z
        far = DISTANCE * radius
        scale = min(size) * 0.47 * sqrt(far**2 - radius**2) / radius / (far + depth)
        places = zip(size[0] / 2 + scale * right, size[1] / 2 - scale * height, strict=True)
        return " ".join(f"{px:.1f},{py:.1f}" for px, py in places)

    def ring(r: float, z: float) -> str:
        turn = np.linspace(0, 2 * pi, 61)
        return seen(np.stack([r * np.cos(turn), r * np.sin(turn), z + 0 * turn]))

    foot, end, tip = np.array([0, 0, -column]), ends[:, 0], tips[:, 0]
    column_line, arm_line, rod_line = (np.stack(pair, 1) for pair in ((foot, 0 * foot), (0 * foot, end), (end, tip)))
    lines = [("floor", ring(0.5 * arm, -column)), ("floor", ring(arm, 0.0)), ("metal", seen(column_line)),
             ("metal", seen(arm_line)), ("way", seen(tips)), ("rod", seen(rod_line))]  # fmt: skip
    drawn = "".join(f'<polyline class="{kind}" points="{places}"/>' for kind, places in lines)
    name = "The rig as simulated at the start, with the way of the pendulum's tip"
    opened = f'<svg class="still" viewBox="0 0 {size[0]} {size[1]}" role="img" aria-label="{name}">'
    return Markup(f"{opened}{drawn}</svg>")  # numbers alone
