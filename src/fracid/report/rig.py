r"""How large the moving rig is drawn: lengths from the constants of the model.

Of :math:`C_3 = m l_1 l_c` and :math:`C_4 = m g l_c` the arm is

.. math::  l_1 = g\,C_3 / C_4 ,

whatever the pendulum is made of.  The pendulum is drawn as the thin uniform rod that swings as fast,
:math:`C_1 = m L^2/3` and :math:`C_4 = m g L/2`, so

.. math::  L = \tfrac32\, g\,C_1 / C_4 .

The arm is that of the rig as given: a fit may put into C3 what is friction.  The pendulum is as found, where C1 is
identifiable: its swing is what a recording tells best.  A free response knows the constants up to a factor, which
cancels here.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from fracid.report.equations import is_rotary_pendulum

if TYPE_CHECKING:
    from fracid.models import Model

__all__ = ["rig_lengths"]

GRAVITY = 9.81
"""[m/s²]"""


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
    C1, C3, C4 = (model.parameter(n).value for n in ("C1", "C3", "C4"))
    C1_found = (found or {}).get("C1", {})
    if C1_found.get("identifiable") == "identifiable" and C1_found["value"]:
        C1 = C1_found["value"]
    if not (C1 > 0 and C3 > 0 and C4 > 0):
        return None
    return {"arm": GRAVITY * C3 / C4, "pendulum": 1.5 * GRAVITY * C1 / C4, "zero": model.zero}
