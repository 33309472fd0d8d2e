"""How large the moving rig is drawn: its shape by :mod:`fracid.models.geometry`, with the pendulum as found.

The arm is that of the rig as given: a fit may put into C3 what is friction.  The pendulum is as found, where C1 is
identifiable: its swing is what a recording tells best.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from fracid.models.geometry import is_rotary_pendulum, rig_geometry

if TYPE_CHECKING:
    from fracid.models import Model

__all__ = ["rig_lengths"]


def rig_lengths(model: Model, found: Mapping[str, Any] | None = None) -> dict[str, Any] | None:
    """Arm and pendulum [m] and where the pendulum's angle is zero; None for a model that is no rotary pendulum.

    Parameters
    ----------
    model : Model
    found : mapping, optional
        The parameters of result.json.

    Examples
    --------
    >>> import fracid
    >>> found = rig_lengths(fracid.rotary_pendulum("srv02-rotpen"))
    >>> round(found["arm"], 3), round(found["pendulum"], 3), found["zero"]
    (0.216, 0.325, 'hanging')
    """
    if not is_rotary_pendulum(model):
        return None
    C1 = (found or {}).get("C1", {})
    if C1.get("identifiable") == "identifiable" and C1["value"] and C1["value"] > 0:
        model = model.with_parameters(C1=C1["value"])
    if not (model.parameter("C3").value > 0 and model.parameter("C4").value > 0):
        return None
    shape = rig_geometry(model)
    return {"arm": shape.arm, "pendulum": shape.pendulum, "zero": model.zero}
