r"""The shape of a rotary pendulum: what its lumped constants say of lengths, and where its parts are at θ and α.

Of :math:`C_3 = m l_1 l_c` (4) and :math:`C_4 = m g l_c` (5) the arm is

.. math::  l_1 = g\,|C_3| / C_4 ,

whatever the pendulum is made of.  Of the pendulum only :math:`C_1/C_4` shows in its swing: the distance from its pivot
to its centre of oscillation, :math:`\ell = g\,C_1/C_4`.  It is drawn as the thin uniform rod that swings as fast,
:math:`C_1 = m L^2/3` and :math:`C_4 = m g L/2`, so

.. math::  L = \tfrac32\,\ell = \tfrac32\, g\,C_1 / C_4 .

Its mass cannot be told, nor the arm's shape.  A factor common to all constants, which a free response cannot tell
either, cancels.

**Positive senses.**  z is up, θ turns the arm about z, counter-clockwise seen from above; :math:`e_r` points along the
arm and :math:`e_t = z \times e_r` where its end moves as θ grows.  The tip is at

.. math::  l_1 e_r + L\,(s \sin α\, e_t \pm \cos α\, z) , \qquad s = \operatorname{sign} C_3 ,

with + where α = 0 is upright and − where it hangs, since the kinetic energy of a rod in these places has
:math:`C_3 \cos α\,\dot θ \dot α` for its mixed term, as (8) has: with a positive C3, the pendulum's lower end first
moves ahead of the arm where α grows from hanging, and its upper end where α grows from upright.

>>> import fracid
>>> shape = fracid.rotary_pendulum("srv02-rotpen").geometry()
>>> round(shape.arm, 3), round(shape.pendulum, 3), round(shape.oscillation_centre, 3)
(0.216, 0.325, 0.217)
>>> end, tip = shape.pose(0.0, 0.1)  # the arm along x: the tip is ahead of it, along y
>>> end.round(3), tip.round(3)
(array([0.216, 0.   , 0.   ]), array([ 0.216,  0.032, -0.323]))
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fracid.arrays import FloatArray

GRAVITY = {"upright": 1.0, "hanging": -1.0}
"""The sign of gravity's torque at a small positive angle, by what the angle zero is."""

STANDARD_GRAVITY = 9.81
"""[m/s²], as in the rigs' constants."""


@dataclass(frozen=True)
class RigGeometry:
    """A rotary pendulum as it is drawn: an arm, and a thin uniform rod at its end."""

    arm: float
    """l₁, from the axis to the pendulum's plane [m]."""
    pendulum: float
    """L, of the uniform rod that swings as fast [m]."""
    zero: str
    """Where α = 0: "hanging" or "upright"."""
    sense: float
    """The sign of C3: 1, or −1 for a model that counts α or θ the other way round."""
    offset: float = 0.0
    """alpha_rest: the true angle is α minus this [rad]."""

    @property
    def oscillation_centre(self) -> float:
        """ℓ = g C1/C4, from the pivot: of any pendulum, whatever its shape [m]."""
        return self.pendulum * 2 / 3

    def directions(self, theta: float) -> tuple[FloatArray, FloatArray]:
        """Along the arm, and where its end moves as θ grows; shape (3,) each."""
        cos, sin = math.cos(theta), math.sin(theta)
        return np.array([cos, sin, 0.0]), np.array([-sin, cos, 0.0])

    def along(self, theta: float, alpha: float) -> FloatArray:
        """The pendulum's direction, away from its pivot, shape (3,); α as measured [rad]."""
        _, e_t = self.directions(theta)
        true = alpha - self.offset
        up = np.array([0.0, 0.0, GRAVITY[self.zero] * math.cos(true)])
        return np.asarray(self.sense * math.sin(true) * e_t + up)

    def pose(self, theta: float, alpha: float) -> tuple[FloatArray, FloatArray]:
        """The arm's end and the pendulum's tip [m], shape (3,) each, from where the arm meets its axis; z is up.

        Parameters
        ----------
        theta, alpha : float
            As the model counts them [rad].
        """
        end = self.arm * self.directions(theta)[0]
        return end, end + self.pendulum * self.along(theta, alpha)
