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
from collections.abc import Mapping
from dataclasses import dataclass, field

from fracid.errors import InputError


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
    gravity: float = 9.81,
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


def _srv02() -> Rig:
    gears = 0.5 * (0.005 * 0.00635**2 + 2 * 0.030 * 0.019**2 + 0.083 * 0.032**2)  # discs of 24, 2 x 72, 120 teeth
    motor = 3.90e-7 + 7.06e-8  # rotor and tachometer
    drive = gears + 0.90 * 70**2 * motor  # 2.08e-3, seen from the arm
    return Rig(
        title="Quanser SRV02 (high gear) with ROTPEN, 12-inch pendulum",
        parameters={
            **_thin(mass=0.127, com=0.156, arm_length=0.216, arm_inertia=2.0e-3 + drive, inertia=1.2e-3),
            "b_theta": 2.4e-3,
            "b_alpha": 3e-4,
            "torque_per_volt": -0.90 * 0.69 * 70 * 7.68e-3 / 2.6,
        },
        source=(
            "Maker's numbers: m 0.127 kg, l_c 0.156 m, arm 0.216 m, J of the pendulum 1.2e-3 at its"
            " centre of mass and of the arm 2.0e-3 kg m^2, b_theta 2.4e-3 (Quanser ROTPEN); rotor"
            " 3.90e-7, tachometer 7.06e-8 kg m^2, masses and radii of the gears, K_g 70, R_m 2.6 ohm,"
            " k_t = k_m = 7.68e-3, eta_g 0.90, eta_m 0.69 (SRV02 user manual, tables 3.1 and 3.2). The"
            " arm's own share of arm_moment is not known. The"
            " drive adds J_gears + eta_g K_g^2 J_motor = 2.08e-3 kg m^2 to the arm; the manual's table"
            " has the J_eq of its two gears exchanged. torque_per_volt = -eta_g eta_m K_g k_t / R_m: a"
            " positive voltage drives theta negative. A motor on a voltage amplifier also brakes, by"
            " back-EMF: eta_g eta_m K_g^2 k_t k_m / R_m = 0.069 N m s/rad, not in b_theta: add it to"
            " b_theta when the amplifier is on. b_alpha is a guess: the maker's 2.4e-3 is 4 to 15 times"
            " too large against real decays. A free decay of one such rig from 92 degrees, fitted at"
            " order 1 with the inertias free, gave C1 4.44e-3, C3 4.9e-3, J_theta 1.44e-2 kg m^2 for the"
            " same C4, and the values in fitted_friction (b_theta holds whatever braking the motor did;"
            " b_alpha came out between -2e-4 and 3e-5 beside dry friction: zero)."
        ),
        fitted_friction={
            "b_theta": 0.13,
            "b_alpha": 0.0,
            "coulomb_theta": 0.042,
            "coulomb_alpha": 2.5e-4,
            "cable_stiffness": 0.043,
        },
    )


def _qube_servo2() -> Rig:
    mass, length = 0.024, 0.129
    arm = 0.095 * 0.085**2 / 3 + 4.0e-6 + 0.6e-6  # rod about its end, rotor, hub
    return Rig(
        title="Quanser QUBE-Servo 2 with its pendulum",
        parameters={
            **_thin(mass, length / 2, 0.085, arm_inertia=arm, inertia=mass * length**2 / 12, arm_moment=0.095 * 0.0425),
            "b_theta": 2.7e-4,
            "b_alpha": 5e-5,
            "torque_per_volt": 0.042 / 8.4,
        },
        source=(
            "Maker's numbers, as in Quanser's course files: arm 0.095 kg, 0.085 m, pendulum 0.024 kg,"
            " 0.129 m, both taken as uniform rods (the arm about its end); R_m 8.4 ohm, k_t = k_m ="
            " 0.042, rotor 4.0e-6, hub 0.6e-6 kg m^2. Friction is tuned, not measured: course files give"
            " b_theta 1.5e-3 and b_alpha 5e-4 ('tuned heuristically') and later 2.7e-4 and 5e-5, taken"
            " here. Back-EMF, k_t k_m / R_m = 2.1e-4 N m s/rad, is not in b_theta. The sign of"
            " torque_per_volt is a guess."
        ),
    )


def _cazzolato_prime() -> Rig:
    return Rig(
        title="Cazzolato and Prime's Furuta pendulum",
        parameters={
            **_thin(0.075, 0.148, 0.278, 2.48e-2 + 0.300 * 0.150**2, inertia=3.86e-3, arm_moment=0.300 * 0.150),
            "b_theta": 1.0e-4,
            "b_alpha": 2.8e-4,
        },
        source=(
            "B. S. Cazzolato, Z. Prime, On the dynamics of the Furuta pendulum, J. Control Science and"
            " Engineering 2011, 528341: L1 0.278, l1 0.150, l2 0.148 m, m1 0.300, m2 0.075 kg, J1"
            " 2.48e-2, J2 3.86e-3 kg m^2 at the centres of mass, b1 1.0e-4, b2 2.8e-4. Taken as printed,"
            " although J2 is more than a 0.3 m rod of that mass can have. The motor is left out,"
            " torque_per_volt is zero: take actuation = 'torque'."
        ),
    )


def _odrive_furuta() -> Rig:
    arm = 5.962e-4 + 0.040466 * 0.05415**2
    return Rig(
        title="macstepien's furuta_pendulum: self-built, gimbal motor on an ODrive",
        parameters={
            **_thin(0.009801, 0.096608, 0.093525, arm, inertia=1.479e-5, arm_moment=0.040466 * 0.05415),
            "b_theta": 1e-4,
            "b_alpha": 1e-5,
            "torque_per_volt": 0.103375 / 16.0,
        },
        source=(
            "github.com/macstepien/furuta_pendulum: m1 0.040466, m2 0.009801 kg, l1 0.05415, l2"
            " 0.096608, L1 0.093525 m, J1 5.962e-4, J2 1.479e-5 kg m^2 at the centres of mass, K_t"
            " 0.103375 N m/A, R 16 ohm (C4 / C1 agrees with its free swings to 0.3 %). b_alpha and"
            " fitted_friction from those swings; b_theta is a guess, for there the arm stands still."
            " Back-EMF is not in b_theta; if k_e = K_t it is 6.7e-4 N m s/rad."
        ),
        fitted_friction={"b_alpha": 1e-5, "coulomb_alpha": 6e-5},
    )


def _stepper_freeswing() -> Rig:
    mass, length = 0.01225 + 0.00693 / 2, 0.137  # rod and half a hinge; coupler, rod and offset
    constants = _thin(mass, length / 2, arm_length=length, arm_inertia=1e3, inertia=mass * length**2 / 12)
    return Rig(
        title="jensen-benard's rotary-inverted-pendulum: 3-D printed, stepper motor, arm clamped",
        parameters={**constants, "C4": 120.0 * constants["C1"], "b_theta": 0.0, "b_alpha": 2.5e-5},
        source=(
            "github.com/jensen-benard/rotary-inverted-pendulum: rod 0.01225 kg, hinge 0.00693 kg (half"
            " of it counted), 0.137 m, as a uniform rod: a guess, for its author had to add mass to"
            " match. C4 = 120 C1 is measured: (10.95 rad/s)^2, the swings of three recordings (the rod"
            " alone would give 107). b_alpha and fitted_friction from the same. The clamped arm is a"
            " very large J_theta, 1000 kg m^2, not a measurement; theta stands still and lambda cannot"
            " be identified. The stepper is no voltage-driven motor: torque_per_volt is zero."
        ),
        fitted_friction={"b_alpha": 2.5e-5, "coulomb_alpha": 1.8e-4},
    )


RIGS: dict[str, Rig] = {
    "srv02-rotpen": _srv02(),
    "qube-servo2": _qube_servo2(),
    "cazzolato-prime": _cazzolato_prime(),
    "odrive-furuta": _odrive_furuta(),
    "stepper-freeswing": _stepper_freeswing(),
}
"""The named rigs."""
