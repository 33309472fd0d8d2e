r"""What a joint resists with: friction, springs, gears and motors, element by element.

A joint's torque is a sum of elements, and so is a line of a right-hand side.  With q its angle and v its rate:

==================  =====================================================================================  ===========
element             torque against the motion                                                              own state
==================  =====================================================================================  ===========
viscous             :math:`b\,v`
drag                :math:`d\,v|v|`
:func:`sliding`     :math:`g(v)\tanh(v/v_s)`, :math:`g = f + s\,e^{-(v/v_{st})^2}`: Stribeck's curve, the
                    rest takes s more than sliding; Coulomb's friction where s = 0
:func:`presliding`  :math:`σ_0 z + σ_1 \dot z` in the place of sliding: the joint gives by δ before it     z, order 1
                    breaks away, :math:`\dot z = v - |v|\,z\,σ_0/g(v)`, :math:`σ_0 = (f + s)/δ`;
                    Dahl's model where s = 0, LuGre's otherwise
:func:`springpot`   :math:`c\,D^ν q`, between a spring (ν = 0) and a dashpot (ν = 1):                      y, order
                    :math:`D^{1-ν} y = v`, torque :math:`c\,y`                                             1 − ν
:func:`maxwell`     :math:`c\,(q - y)`, a spring in series with a dashpot,                                 y, order 1
                    :math:`\dot y = (q - y)/τ`
spring              :math:`k\,(q - q_0)`
:func:`gap`         of a gear: what of an angle or a voltage is beyond its play
:func:`saturated`   what an amplifier gives of a voltage
==================  =====================================================================================  ===========

They are functions in Numba's language, for the right-hand side of any model; a state of their own is written into
``out`` by the element itself.  Of a motor with all of them, ten lines:

>>> from fracid.models.joints import Complement, presliding, springpot
>>> def rhs(t, x, u, p, out):
...     J, b, f, s, v_st, delta, c = p[0], p[1], p[2], p[3], p[4], p[5], p[6]
...     v = x[1]
...     friction = b * v + presliding(x, out, 2, v, f, s, v_st, delta) + springpot(x, out, 3, v, c)
...     out[0], out[1] = v, (u[0] - friction) / J
>>> orders = (1.0, 1.0, 1.0, Complement("nu"))       # of the angle, its rate, z and y; nu is a parameter

``relaxing = ("z",)`` in the model says which state is a presliding element's: the solver then steps it without loss
where the joint slides, however small δ is (:mod:`fracid.solver.schemes`).

References
----------
.. [Dahl] P. R. Dahl, *A solid friction model*, Aerospace Corporation TOR-0158(3107-18)-1 (1968).
.. [LuGre] C. Canudas de Wit, H. Olsson, K. J. Åström, P. Lischinsky, *A new model for control of systems with
   friction*, IEEE Trans. Automatic Control 40 (1995).
.. [Armstrong] B. Armstrong-Hélouvry, P. Dupont, C. Canudas de Wit, *A survey of models, analysis tools and compensation
   methods for the control of machines with friction*, Automatica 30 (1994).
.. [ScottBlair] G. W. Scott Blair, *The role of psychophysics in rheology*, J. Colloid Science 2 (1947): the springpot.
.. [Mainardi] F. Mainardi, *Fractional calculus and waves in linear viscoelasticity* (2010).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from fracid.arrays import FloatArray

SLIPPERY = 1e-9
"""Part of the breakaway torque below which sliding friction counts as this: what it divides by is not zero."""


@dataclass(frozen=True)
class Complement:
    """The order of a springpot's state: 1 − ν, with ν a parameter of the model, or an order."""

    parameter: str
    """Its name; an order's where the model has no such parameter."""

    def __str__(self) -> str:
        """As a formula."""
        return f"1 - {self.parameter}"


def stribeck(v: float, f: float, s: float, v_st: float) -> float:
    """g(v) = f + s·exp(−(v/v_st)²), the torque of sliding [N m].

    Examples
    --------
    >>> stribeck(0.0, 2.0, 1.0, 0.1), stribeck(9.0, 2.0, 1.0, 0.1)
    (3.0, 2.0)
    """
    if s == 0.0:
        return f
    r = v / v_st
    return f + s * math.exp(-r * r)


def sliding(v: float, f: float, s: float, v_st: float, v_s: float) -> float:
    """Sliding friction, smooth at rest: g(v)·tanh(v/v_s) [N m].

    Examples
    --------
    >>> sliding(9.0, 2.0, 1.0, 0.1, 0.02)
    2.0
    """
    if f == 0.0 and s == 0.0:
        return 0.0
    return stribeck(v, f, s, v_st) * math.tanh(v / v_s)


def presliding(
    x: FloatArray, out: FloatArray, i: int, v: float, f: float, s: float, v_st: float, delta: float
) -> float:
    """Friction that gives by δ before it slides: σ₀ z [N m], with z the state i.

    Writes ż into ``out[i]``, and |v|·σ₀/g(v), the rate with which z forgets, behind the derivatives if there is room.
    Where the presliding motion is damped, by σ₁ [N m s/rad], add ``sigma1 * out[i]``.

    Parameters
    ----------
    x, out
        States and their derivatives, shape (n,), or (2 n,) of `out` where the solver asks for rates.
    i
        Which state z is.
    v
        Rate of the joint [rad/s].
    f, s, v_st
        Sliding friction, what rest takes above it [N m], the speed at which that goes [rad/s].
    delta
        δ, what the joint gives before it breaks away [rad].

    Returns
    -------
    float
        Torque against the motion.

    Examples
    --------
    After 1 mrad of the 4 it may give; and after long sliding:

    >>> import numpy as np
    >>> out = np.zeros(1)
    >>> presliding(np.array([1e-3]), out, 0, 0.0, 2.0, 0.0, 0.1, 4e-3)
    0.5
    >>> presliding(np.array([4e-3]), out, 0, 9.0, 2.0, 0.0, 0.1, 4e-3), float(out[0])
    (2.0, 0.0)
    """
    breakaway, z = f + s, x[i]
    part = max(stribeck(v, f, s, v_st) / breakaway, SLIPPERY) if breakaway > 0.0 else 1.0
    rate = abs(v) / (delta * part)
    out[i] = v - rate * z
    if len(out) > len(x):
        out[len(x) + i] = rate
    return float(breakaway / delta * z)


def springpot(x: FloatArray, out: FloatArray, i: int, v: float, c: float) -> float:
    """Torque c·D^ν q [N m] of a viscoelastic joint, with D^(1−ν) y = v for the state i.

    Examples
    --------
    >>> import numpy as np
    >>> out = np.zeros(1)
    >>> springpot(np.array([0.5]), out, 0, 3.0, 2.0), float(out[0])
    (1.0, 3.0)
    """
    out[i] = v
    return float(c * x[i])


def maxwell(x: FloatArray, out: FloatArray, i: int, q: float, c: float, tau: float) -> float:
    """Torque c·(q − y) [N m] of a spring in series with a dashpot, ẏ = (q − y)/τ for the state i, the dashpot's angle.

    It asks for the angle alone, no rate.  ``relaxing = {"y": "tau"}`` in the model has the solver step it without loss,
    however short τ is.

    Examples
    --------
    >>> import numpy as np
    >>> out = np.zeros(1)
    >>> maxwell(np.array([0.5]), out, 0, 3.0, 2.0, 0.25), float(out[0])
    (5.0, 10.0)
    """
    out[i] = (q - x[i]) / tau
    if len(out) > len(x):
        out[len(x) + i] = 1.0 / tau
    return float(c * (q - x[i]))


def gap(q: float, half: float) -> float:
    """What of q is beyond ±half: the play of a gear [rad], the dead zone of a motor [V].

    Examples
    --------
    >>> gap(0.3, 0.5), gap(0.75, 0.5), gap(-0.75, 0.5)
    (0.0, 0.25, -0.25)
    """
    return q - min(max(q, -half), half)


def saturated(u: float, most: float) -> float:
    """What of u is within ±most; 0 for no limit.

    Examples
    --------
    >>> saturated(12.0, 10.0), saturated(12.0, 0.0)
    (10.0, 12.0)
    """
    if most == 0.0:
        return u
    return min(max(u, -most), most)


ELEMENTS = (stribeck, sliding, presliding, springpot, maxwell, gap, saturated)
"""What the solver compiles with a right-hand side that calls it."""
