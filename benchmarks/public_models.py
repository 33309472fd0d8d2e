"""The models of benchmarks/public.py, as a user writes them: a right-hand side, names, values to start from.

Each has more constants than its simplest structure needs.  One that is 0 does nothing; public.py frees them group by
group, and keeps a group where a part of the training record that was not fitted is predicted better.
"""

from __future__ import annotations

import math

from fracid import Model, Parameter
from fracid.arrays import FloatArray
from fracid.models.joints import sliding

# --- Silverbox: an electronic Duffing oscillator -----------------------------------------------------------------


def oscillator(t: float, x: FloatArray, u: FloatArray, p: FloatArray, out: FloatArray) -> None:  # noqa: ARG001
    """A hardening spring, not quite symmetric, and a damper that is weaker when it moves slowly."""
    gain, damping, k, k3, k2, push, weak, slow, d2 = p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8]
    y, v = x[0], x[1]
    damper = (damping + d2 * y * y) * v - sliding(v, weak, 0.0, 1.0, slow)
    out[0] = v
    out[1] = gain * u[0] + push - damper - y * (k + y * (k2 + y * k3))


def measured_displacement(t: float, x: FloatArray, u: FloatArray, p: FloatArray) -> float:  # noqa: ARG001
    """The displacement; the farther out, the later."""
    return x[0] - p[9] * x[0] * x[0] * x[1]


silverbox = Model(
    name="Duffing's oscillator",
    rhs=oscillator, states=("y", "y'"), orders=("q", "q"), outputs={"y": measured_displacement}, inputs=("u",),
    parameters=(
        Parameter("gain", "1/s^2", 2e5, "of the input", lower=0.0),
        Parameter("damping", "1/s", 50.0, "viscous, over mass", lower=0.0),
        Parameter("k", "1/s^2", 2e5, "stiffness over mass", lower=0.0),
        Parameter("k3", "1/(V s)^2", 0.0, "hardening over mass"),
        Parameter("k2", "1/(V s^2)", 0.0, "asymmetric stiffness over mass"),
        Parameter("push", "V/s^2", 0.0, "constant force over mass"),
        Parameter("weak", "V/s^2", 0.0, "by what the damper's force falls short"),
        Parameter("slow", "V/s", 20.0, "above this speed", lower=0.1),
        Parameter("d2", "1/(V^2 s)", 0.0, "damping that grows with the displacement"),
        Parameter("late", "s/V^2", 0.0, "by how much the displacement is seen late, over its square"),
    ),
    zero="", source="Wigren, Schoukens, Three free data sets for development and benchmarking (2013)",
)  # fmt: skip

# --- cascaded tanks ------------------------------------------------------------------------------------------------

FULL = 10.0
"""Where a tank overflows [V]; it says in which unit the level of the upper one is counted."""
WEIR = 2.0
"""How fast what is above flows off [1/s]: between two samples."""


def flow(level: float, root: float, linear: float) -> float:
    """Out of a hole at the bottom: Torricelli's law, and what a hose makes of it."""
    return root * math.sqrt(max(level, 0.0)) + linear * level


def levels(t: float, x: FloatArray, u: FloatArray, p: FloatArray, out: FloatArray) -> None:  # noqa: ARG001
    """The pump fills the upper tank, that the lower; what is beyond the rim of the upper goes partly into the lower."""
    pump, k1, ratio, k3, part, c3, u0, c1 = p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7]
    upper, lower = x[0], x[1]
    over = WEIR * max(upper - FULL, 0.0)
    out[0] = pump * max(u[0] - u0, 0.0) - flow(upper, k1, c1) - over
    out[1] = ratio * flow(upper, k1, c1) + part * over - flow(lower, k3, c3) - WEIR * max(lower - FULL, 0.0)


def lower_level(t: float, x: FloatArray, u: FloatArray, p: FloatArray) -> float:  # noqa: ARG001
    """What the sensor sees of the lower tank: nothing above its rim."""
    return min(x[1], FULL)


cascaded_tanks = Model(
    name="two tanks that overflow",
    rhs=levels, states=("upper", "lower"), orders=("q", "q"), outputs={"y": lower_level}, inputs=("u",),
    parameters=(
        Parameter("pump", "1/s", 0.033, "inflow of the upper tank over the voltage", lower=0.0),
        Parameter("k1", "V^0.5/s", 0.035, "outflow of the upper tank", lower=0.0),
        Parameter("ratio", "1", 2.0, "what a level of the upper tank is in the lower one", lower=0.0),
        Parameter("k3", "V^0.5/s", 0.06, "outflow of the lower tank", lower=0.0),
        Parameter("part", "1", 1.2, "of the overflow that the lower tank gets, in its own levels", lower=0.0),
        Parameter("c3", "1/s", 0.0, "linear part of the lower tank's outflow"),
        Parameter("u0", "V", 0.0, "voltage at which the pump begins"),
        Parameter("c1", "1/s", 0.0, "linear part of the upper tank's outflow"),
    ),
    zero="", source="Schoukens, Mattsson, Wigren, Noël, Cascaded tanks benchmark (2016)",
)  # fmt: skip

# --- EMPS: a table on a screw, with dry friction ---------------------------------------------------------------------

CREEP = 1e-3
"""Below it the table sticks, smoothly [m/s]."""


def table(t: float, x: FloatArray, u: FloatArray, p: FloatArray, out: FloatArray) -> None:
    """Mass, viscous and sliding friction, a viscous friction of its own for the way back, an offset that drifts."""
    mass, b, coulomb, offset, back, drift = p[0], p[1], p[2], p[3], p[4], p[5]
    v = x[1]
    friction = b * v + back * min(v, 0.0) + sliding(v, coulomb, 0.0, 1.0, CREEP)
    out[0], out[1] = v, (u[0] - friction - offset - drift * t) / mass


emps = Model(
    name="a table with dry friction",
    rhs=table, states=("position", "speed"), orders=("q", "q"), outputs={"position": 0}, inputs=("force",),
    parameters=(
        Parameter("mass", "kg", 90.0, "of table and drive", lower=1.0),
        Parameter("b", "N s/m", 180.0, "viscous friction", lower=0.0),
        Parameter("coulomb", "N", 22.0, "sliding friction", lower=0.0),
        Parameter("offset", "N", 0.0, "of the force, at the start"),
        Parameter("b_back", "N s/m", 0.0, "viscous friction that the way back has more"),
        Parameter("drift", "N/s", 0.0, "of the offset"),
    ),
    zero="", source="Janot, Gautier, Brunot, Data set and reference models of EMPS (2019)",
)  # fmt: skip
