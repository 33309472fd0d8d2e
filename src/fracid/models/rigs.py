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
from dataclasses import dataclass, field
from typing import Any

from fracid.errors import InputError
from fracid.safety.door import own_text

GRAVITY = {"upright": 1.0, "hanging": -1.0}
"""The sign of gravity's torque at a small positive angle, by what the angle zero is."""

STANDARD_GRAVITY = 9.81
"""[m/s²], as in the rigs' constants."""


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


def lumped_constants(
    *,
    pendulum_mass: float,
    pendulum_com: float,
    arm_length: float,
    arm_inertia: float,
    I2yy: float,
    I2zz: float,
    I2xx: float = 0.0,
    I2xz: float = 0.0,
    gravity: float = STANDARD_GRAVITY,
) -> dict[str, float]:
    """Return the lumped constants (2)-(7) of a rotary pendulum from its geometry.

    Parameters
    ----------
    pendulum_mass
        m₂ [kg].
    pendulum_com
        l₂c, from the pivot to the pendulum's centre of mass [m].
    arm_length
        l₁, from the arm's axis to the pendulum [m].
    arm_inertia
        The arm's own inertia about its axis, with all that turns with it: hub, gears, rotor
        seen through the gear [kg m²].
    I2xx, I2yy, I2zz, I2xz
        The pendulum's inertia tensor at its centre of mass [kg m²]: x along the pendulum, away from the
        pivot, z along the arm, outwards.  ``I2xz`` is the tensor's element, minus the integral of x z dm.
    gravity
        g [m/s²].

    Returns
    -------
    dict
        C1 to C6, I2xx and J_theta = C5 + I2xx.  The model takes C1, C3, C4, C6, J_theta.

    Raises
    ------
    InputError
        If a mass, length or inertia is negative or not finite.

    Notes
    -----
    The paper's (6) reads C5 = J_r + m₁ l₁c² + I2xx + m₂ l₁².  But M11 = C5 + I2xx cos²α + C2 sin²α (8)
    counts I2xx already, and the arm is more than its rotor and a point mass.  So
    C5 = ``arm_inertia`` + m₂ l₁² here.

    Examples
    --------
    >>> constants = lumped_constants(pendulum_mass=0.127, pendulum_com=0.156, arm_length=0.216,
    ...                              arm_inertia=4.08e-3, I2yy=1.2e-3, I2zz=1.2e-3)
    >>> {name: round(value, 6) for name, value in constants.items() if name in ("C1", "C3", "J_theta")}
    {'C1': 0.004291, 'C3': 0.004279, 'J_theta': 0.010005}
    """
    not_negative = dict(
        pendulum_mass=pendulum_mass, arm_length=arm_length, arm_inertia=arm_inertia, I2xx=I2xx, I2yy=I2yy, I2zz=I2zz
    )
    for name, value in {**not_negative, "pendulum_com": pendulum_com, "I2xz": I2xz, "gravity": gravity}.items():
        if not math.isfinite(value) or (name in not_negative and value < 0.0):
            raise InputError(f"{name} = {value!r}: expected a finite number in SI units, masses and inertias >= 0")
    C1 = I2zz + pendulum_mass * pendulum_com**2  # (2)
    C2 = I2yy + pendulum_mass * pendulum_com**2  # (3)
    C3 = pendulum_mass * arm_length * pendulum_com - I2xz  # (4)
    C4 = pendulum_mass * gravity * pendulum_com  # (5)
    C5 = arm_inertia + pendulum_mass * arm_length**2  # (6), corrected: see the notes
    C6 = C2 - I2xx  # (7)
    return dict(C1=C1, C2=C2, C3=C3, C4=C4, C5=C5, C6=C6, I2xx=I2xx, J_theta=C5 + I2xx)


def _thin(
    mass: float, com: float, arm_length: float, arm_inertia: float, inertia: float, arm_moment: float = 0.0
) -> dict[str, float]:
    """Return the model's constants for a thin pendulum: I2yy = I2zz = inertia, I2xx = 0; `arm_moment` of the arm."""
    constants = lumped_constants(
        pendulum_mass=mass, pendulum_com=com, arm_length=arm_length, arm_inertia=arm_inertia, I2yy=inertia, I2zz=inertia
    )
    lumped = {name: constants[name] for name in ("C1", "C3", "C4", "C6", "J_theta")}
    return {**lumped, "arm_moment": mass * arm_length + arm_moment}


def _rig(table: Mapping[str, Any]) -> Rig:
    constants = _thin(**table["thin"]) | table["parameters"]
    return Rig(table["title"], constants, table["source"], table.get("fitted_friction", {}))


RIGS = {name: _rig(table) for name, table in tomllib.loads(own_text("models/rigs.toml")).items()}
"""The named rigs, each a table of ``rigs.toml``."""
