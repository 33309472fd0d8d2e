"""The rotary inverted pendulum (RIP): equations (1)-(13) of the paper, corrected, with real friction.

An arm turns by θ in the horizontal plane; at its end a pendulum turns by α about the arm's axis.
With M(α) the mass matrix, the right-hand side solves

.. math::

    \\begin{bmatrix} M_{11} & M_{12} \\\\ M_{12} & M_{22} \\end{bmatrix}
    \\begin{bmatrix} D^{2\\lambda}\\theta \\\\ D^{2\\mu}\\alpha \\end{bmatrix}
    = \\begin{bmatrix} f_\\theta \\\\ f_\\alpha \\end{bmatrix}, \\qquad
    M_{11} = J_\\theta + C_6 \\sin^2 α, \\quad M_{12} = C_3 \\cos α, \\quad M_{22} = C_1,

.. math::

    f_\\theta &= τ_m - (b_θ + C_6 \\sin 2α\\, \\dot α)\\,\\dot θ + C_3 \\sin α\\, \\dot α^2 + τ_{Cθ}
                - d_θ \\dot θ|\\dot θ| - k\\,(θ - θ_0) \\\\
    f_\\alpha &= \\tfrac12 C_6 \\sin 2α\\, \\dot θ^2 - b_α \\dot α \\pm C_4 \\sin α + τ_{Cα} - d_α \\dot α|\\dot α|

with a dot for :math:`D^λ` (θ) and :math:`D^μ` (α), and ``J_theta`` = C5 + I2xx.  The states are
x = (θ, D^λ θ, α, D^μ α) as in (15).

Corrections of the printed equations
    (1) and (13) print the bracket inside det(M)(…); it is (…)/det(M).  (6) counts I2xx twice and has
    no arm inertia but J_r (:func:`fracid.models.rigs.lumped_constants`).  The friction τ_C, printed with
    a plus and never defined, is :math:`τ_C = -f \\tanh(v / v_s)`.

``zero``: what α = 0 means
    ``"upright"``: as printed, gravity is +C4 sin α.  ``"hanging"``: the angle a = π − α from hanging,
    gravity is −C4 sin a.  No other sign changes: sin α = sin a, cos α = −cos a, sin 2α = −sin 2a and
    α̇ = −ȧ, so in the first row the coupling C3 cos α α̈ = C3 cos a ä, the term C6 sin 2α α̇ = C6 sin 2a ȧ
    and C3 sin α α̇² keep their form, and the second row, times −1, keeps all but gravity's sign.
    (With a = α − π instead, C3 would change its sign, which is the same as counting θ backwards.
    If θ and α of a recording swing against the model, give one of them ``sign = -1``.)
    ``alpha_rest`` is the offset of the encoder's zero, so it is taken off α wherever α appears.

An axis that leans by ε = (ε_x, ε_y), ``tilt_x`` and ``tilt_y``, to first order
    Gravity has a part g ε in the arm's plane.  With e_r along the arm, e_t across it, and S = m₂ l₁ + m₁ l₁c
    (``arm_moment``) it gives the potential − g S ε·e_r − C4 sin α ε·e_t, so that the arm is turned by
    g S ε·e_t − C4 sin α ε·e_r, and the pendulum hangs at α = ε·e_t: where it rests depends on θ.

Dry friction takes its sign from the states D^λ θ and D^μ α
    A right-hand side sees the states, and these are the fractional rates.  The price: D^μ α turns later
    than the true rate, so that after each reversal, for a fraction (1 − μ)/2 of the time (4 % at μ = 0.91),
    dry friction feeds a little energy in; more often in the slow tail of a decay.  It is accepted because
    the integer rate is a derivative of order 1 − μ of that state, with a history sum of its own; because
    tanh makes the friction small just there, where the speed is small; and because at order 1 the two
    are the same.

At orders other than 1 the numbers keep their SI values, and a natural frequency ω moves to ω^{1/μ}: a
matter of units.  ``time_scale`` τ₀ is the remedy: the solver takes τ₀^{order−1} D^order, so that frequencies
of 1/τ₀ stay.  It does not appear in the right-hand side; 1 s is the paper's.

What can be told from data: the nine of C5 + I2xx, C6, C3, C1, C4, b_θ, b_α, τ_Cθ, τ_Cα, and from a free
response only their ratios.

>>> model = rotary_pendulum("srv02-rotpen", zero="hanging", b_alpha=2e-4)
>>> out = np.empty(4)
>>> model.rhs(0.0, np.array([0.0, 0.0, 0.1, 0.0]), np.zeros(1), model.parameter_vector(), out)
>>> out.round(3)                                  # released at 0.1 rad: alpha falls, the arm reacts
array([ 0.   ,  3.304,  0.   , -7.801])

References
----------
.. [CP2011] B. S. Cazzolato, Z. Prime, *On the dynamics of the Furuta pendulum*, J. Control Science and
   Engineering 2011, 528341: the derivation with full inertia tensors; hanging, same signs as here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from fracid.arrays import FloatArray, Pair, Signals, by_name
from fracid.errors import InputError, refuse_unknown
from fracid.models.base import SAYS, LinearTerms, Model, Parameter
from fracid.models.library import model_of_table, table_of
from fracid.models.rigs import GRAVITY, RIGS

TABLE = table_of("rotary-pendulum")


def rotary_pendulum(
    rig: str = "srv02-rotpen",
    zero: str = "hanging",
    actuation: Literal["voltage", "torque"] = "voltage",
    **overrides: float,
) -> Model:
    """Return the rotary pendulum model of a rig.

    Parameters
    ----------
    rig
        A name in :data:`fracid.models.RIGS`.
    zero
        "hanging" or "upright": where α = 0.  A pendulum that is released and settles hangs.
    actuation
        What the input u is: the "voltage" at the motor [V], or the "torque" on the arm [N m].
    **overrides
        Parameters that replace the rig's [SI].  The paper's ``C2``, ``C5`` and ``I2xx`` may be given
        together [kg m²] in the place of ``C6`` = C2 − I2xx and ``J_theta`` = C5 + I2xx.

    Returns
    -------
    Model
        States (θ, D^λ θ, α, D^μ α) in rad and rad/s^order, measured are θ and α, one input.

    Raises
    ------
    InputError
        For an unknown rig, zero, actuation or parameter, or an impossible value.

    Notes
    -----
    The paper's (1)-(13).  Drag, cable, offset and dry friction are zero in every rig; what was found on
    recordings stands in ``RIGS[rig].fitted_friction``, ready to be given as overrides.

    Examples
    --------
    >>> model = rotary_pendulum("qube-servo2", zero="upright")
    >>> model.zero, model.inputs, dict(model.outputs)
    ('upright', ('voltage',), {'theta': 0, 'alpha': 2})
    >>> paper = rotary_pendulum(C2=2.2e-3, C5=4e-3, I2xx=2e-5)
    >>> f"{paper.parameter('J_theta').value:.5f}"
    '0.00402'
    >>> from fracid.models import RIGS
    >>> real = rotary_pendulum("srv02-rotpen", **RIGS["srv02-rotpen"].fitted_friction)
    """
    refuse_unknown("rig", RIGS, rig)
    if zero not in GRAVITY:
        raise InputError(f"zero = {zero!r}: expected 'hanging' or 'upright', the posture where alpha = 0")
    if actuation not in ("voltage", "torque"):
        raise InputError(f"actuation = {actuation!r}: expected 'voltage' (input in V) or 'torque' (input in N m)")
    torque: dict[str, float] = {"torque_per_volt": 1.0} if actuation == "torque" else {}
    return replace(
        _of_the_file(zero), inputs=(actuation,), input_units={actuation: {"voltage": "V", "torque": "N m"}[actuation]},
        source=f"{RIGS[rig].title}. {RIGS[rig].source}",
    ).with_parameters(**{**RIGS[rig].parameters, **torque, **_lumped(overrides)})  # fmt: skip


def mass_matrix(alpha: ArrayLike, C1: float, C3: float, C6: float, J_theta: float) -> FloatArray:
    """Return M(α) of (8); the same for both zeros of α.

    Parameters
    ----------
    alpha
        Pendulum angle [rad], any shape.
    C1, C3, C6, J_theta
        Lumped constants [kg m²].

    Returns
    -------
    ndarray, shape (*alpha.shape, 2, 2)

    Examples
    --------
    >>> mass_matrix(0.0, C1=2.0, C3=1.0, C6=0.5, J_theta=3.0)
    array([[3., 1.],
           [1., 2.]])
    """
    alpha = np.asarray(alpha, dtype=np.float64)
    M11 = J_theta + C6 * np.sin(alpha) ** 2
    M12 = C3 * np.cos(alpha)
    return np.stack([np.stack([M11, M12], -1), np.stack([M12, np.full_like(M12, C1)], -1)], -2)


@cache
def _of_the_file(zero: str) -> Model:
    return replace(model_of_table("rotary-pendulum", TABLE, zero, __name__), linear_terms=LINEAR_TERMS)


def _lumped(overrides: Mapping[str, float]) -> dict[str, float]:
    """Turn the paper's C2, C5 and I2xx into C6 and J_theta."""
    values = dict(overrides)
    given = {name: values.pop(name) for name in ("C2", "C5", "I2xx") if name in values}
    if not (inertias := {name: Parameter(name, "kg m^2", value, "").value for name, value in given.items()}):
        return values
    if len(inertias) < 3:
        raise InputError(SAYS("inertias", names=" and ".join(inertias)))
    constants = {"C6": inertias["C2"] - inertias["I2xx"], "J_theta": inertias["C5"] + inertias["I2xx"]}
    for name, value in constants.items():
        if not math.isclose(values.get(name, value), value, rel_tol=1e-9):
            raise InputError(f"{name} = {values[name]!r}, but C2, C5 and I2xx make it {value:g}: leave {name} out")
    return {**values, **constants}


# --- for reports, figures and exports -----------------------------------------------------------------


def _columns(
    model: Model, theta: FloatArray, alpha: FloatArray, arm_rates: Pair, rates: Pair, drive: FloatArray | None
) -> tuple[Signals, Signals]:
    """What each constant is multiplied with in (9) and (10), the sum of which is 0."""
    p = by_name(model.parameter_names, model.parameter_vector())
    (x2, arm_acceleration), (x4, acceleration) = arm_rates, rates
    sin, cos = np.sin(alpha - p["alpha_rest"]), np.cos(alpha - p["alpha_rest"])
    sin2, slip = 2.0 * sin * cos, p["slip_speed"]
    arm = {
        "J_theta": arm_acceleration,
        "C6": sin**2 * arm_acceleration + sin2 * x4 * x2,
        "C3": cos * acceleration - sin * x4**2,
        "b_theta": x2,
        "coulomb_theta": np.tanh(x2 / slip),
        "drag_theta": x2 * np.abs(x2),
        "cable_stiffness": theta,
        "cable_offset": np.ones_like(theta),
        "torque_per_volt": np.zeros_like(alpha) if drive is None else -drive,
    }
    pendulum = {
        "C6": -0.5 * sin2 * x2**2,
        "C3": cos * arm_acceleration,
        "C1": acceleration,
        "C4": -GRAVITY[model.zero] * sin,
        "b_alpha": x4,
        "coulomb_alpha": np.tanh(x4 / slip),
        "drag_alpha": x4 * np.abs(x4),
    }
    return arm, pendulum


_TERMS: dict[str, Any] = {n: tuple(v) if isinstance(v, list) else v for n, v in TABLE["regression"].items()}

_GAUGE = next(n for n, row in TABLE["model"]["parameters"].items() if row.get("gauge"))

LINEAR_TERMS = LinearTerms(**_TERMS, gauge=_GAUGE, columns=_columns)

MODEL = {"rotary-pendulum": rotary_pendulum}
"""By the name that a project file gives it."""
