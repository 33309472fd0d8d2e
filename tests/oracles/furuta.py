"""The rotary pendulum from first principles: Lagrange's equations of two rigid bodies, by SymPy.

Nothing here knows the paper's mass matrix: kinetic and potential energy come from frames, points and
inertia tensors, and SymPy's ``LagrangesMethod`` makes the equations of motion of them.
"""

from functools import cache

import numpy as np
import sympy as sp
from sympy.physics.mechanics import (
    LagrangesMethod,
    Lagrangian,
    Point,
    ReferenceFrame,
    RigidBody,
    dynamicsymbols,
    inertia,
    inertia_of_point_mass,
)

GEOMETRY = ("m1", "l1c", "J1", "l1", "m2", "l2c", "Ixx", "Iyy", "Izz", "Ixz", "g", "ex", "ey")
"""Arm: mass, centre of mass, inertia there, length; pendulum: mass, centre of mass, tensor there; gravity, and which
parts of it lie in the arm's plane."""


@cache
def _equations(zero):
    """Return M and f of M q'' = f as functions of (geometry, q, q')."""
    q = theta, alpha = dynamicsymbols("theta alpha")
    rates = dynamicsymbols("theta alpha", 1)
    m1, l1c, J1, l1, m2, l2c, Ixx, Iyy, Izz, Ixz, g, ex, ey = constants = sp.symbols(" ".join(GEOMETRY))
    ground = ReferenceFrame("N")  # N.z points up
    arm_frame = ground.orientnew("A", "Axis", [theta, ground.z])  # A.x points along the arm, outwards
    # The pendulum tips from upright (+z) towards +theta (A.y): a negative turn about A.x.
    from_upright = alpha if zero == "upright" else sp.pi - alpha
    link_frame = arm_frame.orientnew("B", "Axis", [-from_upright, arm_frame.x])  # B.z points along the pendulum

    origin = Point("O")
    origin.set_vel(ground, 0)
    arm_com = origin.locatenew("G1", l1c * arm_frame.x)
    arm_com.v2pt_theory(origin, ground, arm_frame)
    pivot = origin.locatenew("P", l1 * arm_frame.x)
    pivot.v2pt_theory(origin, ground, arm_frame)
    link_com = pivot.locatenew("G2", l2c * link_frame.z)
    link_com.v2pt_theory(pivot, ground, link_frame)

    arm = RigidBody("arm", arm_com, arm_frame, m1, (inertia(arm_frame, 0, 0, J1), arm_com))
    # The paper's x is along the pendulum (B.z) and its z along the arm (B.x), so I2zz turns about B.x.
    tensor = inertia(link_frame, Izz, Iyy, Ixx, 0, 0, Ixz)
    link = RigidBody("link", link_com, link_frame, m2, (tensor, link_com))
    up = ground.z - ex * ground.x - ey * ground.y
    arm.potential_energy = m1 * g * arm_com.pos_from(origin).dot(up)
    link.potential_energy = m2 * g * link_com.pos_from(origin).dot(up)

    method = LagrangesMethod(Lagrangian(ground, arm, link), q)
    method.form_lagranges_equations()
    arguments = (constants, q, rates)
    return sp.lambdify(arguments, method.mass_matrix), sp.lambdify(arguments, method.forcing)


def accelerations(geometry, angles, rates, torques, zero):
    """Return θ'' and α'' under given torques on the two joints, from Lagrange's equations."""
    M, f = (function([geometry[name] for name in GEOMETRY], angles, rates) for function in _equations(zero))
    return np.linalg.solve(np.asarray(M, float), np.ravel(np.asarray(f, float)) + torques)


def tensor_element_xz_of_a_point_mass():
    """Return the xz element of the inertia tensor of a mass m at (x, 0, z)."""
    frame = ReferenceFrame("F")
    m, x, z = sp.symbols("m x z")
    dyadic = inertia_of_point_mass(m, x * frame.x + z * frame.z, frame)
    return frame.x.dot(dyadic).dot(frame.z)
