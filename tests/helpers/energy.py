"""The mechanical energy of a rotary pendulum."""

import math

import numpy as np

from fracid.models import mass_matrix
from fracid.models.rigs import GRAVITY, STANDARD_GRAVITY


def energy(model, states, overrides=None):
    """Give kinetic and potential energy [J] at order 1, zero at rest and hanging, of masses, gravity and the cable.

    >>> import fracid
    >>> energy(fracid.rotary_pendulum("srv02-rotpen", zero="upright"), np.zeros(4)).round(4)  # 2 C4 above hanging
    np.float64(0.3887)
    """
    p = dict(zip(model.parameter_names, model.parameter_vector(overrides), strict=True))
    theta, theta_rate, alpha, alpha_rate = np.moveaxis(np.asarray(states, dtype=np.float64), -1, 0)
    alpha = alpha - p["alpha_rest"]
    M = mass_matrix(alpha, p["C1"], p["C3"], p["C6"], p["J_theta"])
    rates = np.stack([theta_rate, alpha_rate], -1)
    kinetic = 0.5 * np.einsum("...i,...ij,...j", rates, M, rates)
    height = p["C4"] * (1.0 + GRAVITY[model.zero] * np.cos(alpha))
    ahead, aside = np.cos(theta), np.sin(theta)
    height -= STANDARD_GRAVITY * p["arm_moment"] * (p["tilt_x"] * ahead + p["tilt_y"] * aside)
    height -= math.copysign(p["C4"], p["C3"]) * np.sin(alpha) * (p["tilt_y"] * ahead - p["tilt_x"] * aside)
    return kinetic + height + 0.5 * p["cable_stiffness"] * (theta - p["theta_rest"]) ** 2
