"""How large the moving rig is drawn: its shape by :mod:`fracid.models.geometry`, with the pendulum as found.

The arm is that of the rig as given: a fit may put into C3 what is friction.  The pendulum is as found, where C1 is
identifiable: its swing is what a recording tells best (``Drawing.as_found``).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from fracid.errors import InputError

if TYPE_CHECKING:
    from fracid.models import Model

__all__ = ["rig_lengths"]


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
