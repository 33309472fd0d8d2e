"""Real rotary pendulums: their constants, and the paper's (2)-(7) that make them from geometry.

A rig holds the constants of mechanics and motor, with the source of each number in words.  Dry friction,
cable and drag are not in a rig's ``parameters``: what fits to real recordings found is kept apart in
``fitted_friction``, to be used as overrides or as the start of a fit.

==================  ==========================================================  =========
name                what                                                        l_1 [m]
==================  ==========================================================  =========
srv02-rotpen        Quanser SRV02 with ROTPEN, 12-inch pendulum                 0.216
qube-servo2         Quanser QUBE-Servo 2 with its pendulum                      0.085
cazzolato-prime     the published reference set, University of Adelaide         0.278
odrive-furuta       self-built, direct drive by a gimbal motor on an ODrive     0.094
stepper-freeswing   3-D printed, stepper motor; the arm stands still            0.137
==================  ==========================================================  =========
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from fracid.errors import InputError
from fracid.safety.door import own_text

GRAVITY = {"upright": 1.0, "hanging": -1.0}
"""The sign of gravity's torque at a small positive angle, by what the angle zero is."""

STANDARD_GRAVITY = 9.81
"""[m/s²], as in the rigs' constants."""

CLAMPED = 1e3
"""Inertia of an arm that is clamped, or was not recorded [kg m²]."""


@dataclass(frozen=True)
class Rig:
    """Constants of one rig, in SI units, and where they come from."""

    title: str
    """Maker and product, or whose it is."""
    parameters: Mapping[str, float]
    """Parameters of :func:`fracid.models.rotary_pendulum` that this rig sets [SI]; the others stay zero."""
    source: str
    """Where each number comes from, and which are guesses."""
    fitted_friction: Mapping[str, float] = field(default_factory=dict)
    """Friction found on real recordings at order 1, rounded: overrides, or the start of a fit [SI]."""


@dataclass(frozen=True, kw_only=True)
class Geometry:
    """Of a rotary pendulum, in SI units.

    The pendulum's inertia tensor is that at its centre of mass: x along the pendulum, away from the pivot, z along the
    arm, outwards.

    Raises
    ------
    InputError
        If a mass, length or inertia is negative or not finite.
    """

    pendulum_mass: float
    """m₂ [kg]."""
    pendulum_com: float
    """l₂c, from the pivot to the pendulum's centre of mass [m]."""
    arm_length: float
    """l₁, from the arm's axis to the pendulum [m]."""
    arm_inertia: float
    """The arm's own about its axis, with all that turns with it: hub, gears, rotor seen through the gear [kg m²]."""
    I2yy: float
    """[kg m²]"""
    I2zz: float
    """[kg m²]"""
    I2xx: float = 0.0
    """[kg m²]"""
    I2xz: float = 0.0
    """The tensor's element, minus the integral of x z dm [kg m²]."""
    gravity: float = STANDARD_GRAVITY
    """g [m/s²]."""

    def __post_init__(self) -> None:
        """Refuse what no rig has."""
        for name, value in asdict(self).items():
            if not math.isfinite(value) or (name not in ("pendulum_com", "I2xz", "gravity") and value < 0.0):
                raise InputError(f"{name} = {value!r}: expected a finite number in SI units, masses and inertias >= 0")


def lumped_constants(rig: Geometry) -> dict[str, float]:
    """Return the lumped constants (2)-(7) of a rotary pendulum.

    Returns
    -------
    dict
        C1 to C6, I2xx and J_theta = C5 + I2xx.  The model takes C1, C3, C4, C6, J_theta.

    Notes
    -----
    The paper's (6) reads C5 = J_r + m₁ l₁c² + I2xx + m₂ l₁².  But M11 = C5 + I2xx cos²α + C2 sin²α (8)
    counts I2xx already, and the arm is more than its rotor and a point mass.  So
    C5 = ``arm_inertia`` + m₂ l₁² here.

    Examples
    --------
    >>> rig = Geometry(pendulum_mass=0.127, pendulum_com=0.156, arm_length=0.216, arm_inertia=4.08e-3, I2yy=1.2e-3,
    ...                I2zz=1.2e-3)
    >>> constants = lumped_constants(rig)
    >>> {name: round(value, 6) for name, value in constants.items() if name in ("C1", "C3", "J_theta")}
    {'C1': 0.004291, 'C3': 0.004279, 'J_theta': 0.010005}
    """
    m2, l2, l1 = rig.pendulum_mass, rig.pendulum_com, rig.arm_length
    C1 = rig.I2zz + m2 * l2**2  # (2)
    C2 = rig.I2yy + m2 * l2**2  # (3)
    C3 = m2 * l1 * l2 - rig.I2xz  # (4)
    C4 = m2 * rig.gravity * l2  # (5)
    C5 = rig.arm_inertia + m2 * l1**2  # (6), corrected: see the notes
    C6 = C2 - rig.I2xx  # (7)
    return dict(C1=C1, C2=C2, C3=C3, C4=C4, C5=C5, C6=C6, I2xx=rig.I2xx, J_theta=C5 + rig.I2xx)


def _rig(table: Mapping[str, Any]) -> Rig:
    geometry = Geometry(**table["geometry"])
    lumped = {name: value for name, value in lumped_constants(geometry).items() if name not in ("C2", "C5", "I2xx")}
    moment = geometry.pendulum_mass * geometry.arm_length + table.get("arm_moment", 0.0)
    constants = {**lumped, "arm_moment": moment, **table["parameters"]}
    return Rig(table["title"], constants, table["source"], table.get("fitted_friction", {}))


RIGS = {name: _rig(table) for name, table in tomllib.loads(own_text("models/rigs.toml")).items()}
"""The named rigs, each a table of ``rigs.toml``."""
