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
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from fracid.arrays import FloatArray
from fracid.errors import InputError, refuse_unknown
from fracid.findings import Words
from fracid.models.base import LinearTerms, Model, Parameter, RightHandSide, symbol_of
from fracid.models.joints import CONTACT, gap, presliding, saturated, sliding, springpot
from fracid.models.rigs import GRAVITY, RIGS, STANDARD_GRAVITY
from fracid.models.scene import Scene, scene_of
from fracid.models.written.equations import order_of
from fracid.safety.door import own_text

SAYS = Words("models/base.toml")

TABLE = tomllib.loads(own_text("models/rotary-pendulum.toml"))

PARAMETERS = tuple(Parameter.of(name, row) for name, row in TABLE["parameters"].items())

STATES = {name: tuple(row["only"]) for name, row in TABLE["states"].items() if name.isidentifier()}
"""States beyond the four that right-hand sides are made for, and the parameters that need them."""

PAPER = "Identification of Fractional-Order System Dynamics for a Rotary Inverted Pendulum"


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
    return Model(
        name="rotary-pendulum",
        rhs=_right_hand_side(zero, ()),
        states=("theta", "D^lambda theta", "alpha", "D^mu alpha"),
        orders=("lambda", "lambda", "mu", "mu"),
        outputs={"theta": 0, "alpha": 2},
        inputs=(actuation,),
        parameters=PARAMETERS,
        zero=zero,
        source=f"{RIGS[rig].title}. {RIGS[rig].source}",
        angles=("theta", "alpha"),
        pendulum="alpha",
        input_units={actuation: {"voltage": "V", "torque": "N m"}[actuation]},
        drive="torque_per_volt",
        about="an arm that a motor turns in a plane, with a pendulum at its end: Furuta's",
        seen_in={"lambda": "theta"},
        symbols={n: symbol_of(text) for n, text in TABLE["symbols"].items()},
        paper=PAPER,
        scene=_scene(zero),
        postures=_postures,
        smooth=_smooth,
        linear_terms=LINEAR_TERMS,
        grown=_grown,
    ).with_parameters(**{**RIGS[rig].parameters, **torque, **_lumped(overrides)})


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
def _right_hand_side(zero: str, own: tuple[str, ...]) -> RightHandSide:
    """Return f of (15), with the states of `own` behind the four; gravity's sign and who is there are constants."""
    gravity = GRAVITY[zero]
    z_theta, z_alpha, y_theta, y_alpha, arm = (4 + own.index(n) if n in own else 0 for n in STATES)
    arm_speed = arm + 1  # a constant: an index that the function computes would have every access checked

    def rhs(t: float, x: FloatArray, u: FloatArray, p: FloatArray, out: FloatArray) -> None:  # noqa: ARG001
        C1, C3, C4, C6, J_theta = p[0], p[1], p[2], p[3], p[4]
        b_theta, b_alpha, coulomb_theta, coulomb_alpha, slip_speed = p[5], p[6], p[7], p[8], p[9]
        drag_theta, drag_alpha, cable_stiffness, theta_rest = p[10], p[11], p[12], p[13]
        alpha_rest, torque_per_volt = p[14], p[15]
        stiction_theta, stribeck_speed_theta, presliding_theta, damping_theta = p[17], p[18], p[19], p[20]
        stiction_alpha, stribeck_speed_alpha, presliding_alpha, damping_alpha = p[23], p[24], p[25], p[26]
        back_emf, dead_zone, saturation = p[33], p[34], p[35]
        tilt_x, tilt_y, arm_moment = p[36], p[37], p[38]

        theta, theta_rate, alpha, alpha_rate = x[0], x[1], x[2] - alpha_rest, x[3]
        sin, cos = math.sin(alpha), math.cos(alpha)
        sin2 = 2.0 * sin * cos

        # what the joints resist with beside viscous friction and drag
        if z_theta and presliding_theta > 0.0:
            joint_theta = presliding(
                x, out, z_theta, theta_rate, coulomb_theta, stiction_theta, stribeck_speed_theta, presliding_theta
            ) + damping_theta * out[z_theta]  # fmt: skip
        else:
            joint_theta = sliding(theta_rate, coulomb_theta, stiction_theta, stribeck_speed_theta, slip_speed)
            if z_theta:
                out[z_theta] = 0.0
        if z_alpha and presliding_alpha > 0.0:
            joint_alpha = presliding(
                x, out, z_alpha, alpha_rate, coulomb_alpha, stiction_alpha, stribeck_speed_alpha, presliding_alpha
            ) + damping_alpha * out[z_alpha]  # fmt: skip
        else:
            joint_alpha = sliding(alpha_rate, coulomb_alpha, stiction_alpha, stribeck_speed_alpha, slip_speed)
            if z_alpha:
                out[z_alpha] = 0.0
        if y_theta:
            joint_theta += springpot(x, out, y_theta, theta_rate, p[21])
        if y_alpha:
            joint_alpha += springpot(x, out, y_alpha, alpha_rate, p[27])

        M11, M12 = J_theta + C6 * sin * sin, C3 * cos  # (8)
        driven = saturated(gap(u[0], dead_zone), saturation)
        f_theta = torque_per_volt * driven - cable_stiffness * (theta - theta_rest)
        b_hub, arm_rate = b_theta + back_emf + drag_theta * abs(theta_rate), theta_rate
        play, stiffness, damping, inertia = p[29], p[30], p[31], p[32]
        if arm and (play > 0.0 or stiffness > 0.0):  # two bodies: the hub first, then what the arm gets from it
            inertia = inertia if inertia > 0.0 else 0.2 * J_theta
            stiffness = stiffness if stiffness > 0.0 else CONTACT * inertia
            turn, arm_rate = gap(theta - x[arm], play), x[arm_speed]
            shaft = stiffness * turn + (damping * (theta_rate - arm_rate) if turn != 0.0 or play == 0.0 else 0.0)
            out[1] = (f_theta - b_hub * theta_rate - joint_theta - shaft) / inertia
            M11, f_theta, b_hub, joint_theta = M11 - inertia, shaft, 0.0, 0.0
        f_theta -= (b_hub + C6 * sin2 * alpha_rate) * arm_rate  # (9)
        f_theta += C3 * sin * alpha_rate * alpha_rate
        f_theta -= joint_theta
        f_alpha = gravity * C4 * sin + 0.5 * C6 * sin2 * arm_rate * arm_rate  # (10)
        f_alpha -= (b_alpha + drag_alpha * abs(alpha_rate)) * alpha_rate
        f_alpha -= joint_alpha
        if tilt_x != 0.0 or tilt_y != 0.0:  # gravity turns the arm too, and the pendulum hangs across it
            ahead, aside = math.cos(x[arm]), math.sin(x[arm])
            along, across = tilt_x * ahead + tilt_y * aside, tilt_y * ahead - tilt_x * aside
            weight = math.copysign(C4, C3)
            f_theta += STANDARD_GRAVITY * arm_moment * across - weight * sin * along
            f_alpha += weight * cos * across

        det = max(M11 * C1 - M12 * M12, 0.0)  # below 0 no masses make such an M: singular, like det M = 0
        out[0], out[2] = theta_rate, alpha_rate
        out[arm_speed] = (C1 * f_theta - M12 * f_alpha) / det  # (1), the bracket over det(M)
        out[3] = (M11 * f_alpha - M12 * f_theta) / det
        if arm:
            out[arm] = arm_rate
            if play == 0.0 and stiffness == 0.0:  # one body after all
                out[1] = out[arm_speed]

    # Named so that it can be pickled (see __getattr__) and its compiled code has its own file in Numba's cache.
    rhs.__qualname__ = rhs.__name__ = "_with_".join((zero, *own))
    return rhs


def __getattr__(name: str) -> RightHandSide:
    """``hanging``, ``upright``, ``hanging_with_z_theta_with_z_alpha``: the right-hand sides, made when asked for."""
    zero, *own = name.split("_with_")
    if zero not in GRAVITY or tuple(own) != tuple(n for n in STATES if n in own):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return _right_hand_side(zero, tuple(own))


def _grown(model: Model, on: frozenset[str]) -> Model:
    """The model with the states that these parameters need."""
    rows = {n: row for n, row in TABLE["states"].items() if not on.isdisjoint(row["only"])}
    rhs = _right_hand_side(model.zero, tuple(n for n in rows if n in STATES))
    if rhs is model.rhs:
        return model
    return replace(
        model, rhs=rhs, states=(*model.states[:4], *rows),
        orders=(*model.orders[:4], *(order_of(n, row.get("order", 1.0)) for n, row in rows.items())),
        relaxing={n: row["size"] for n, row in rows.items() if "size" in row},
        follows={n: row["follows"] for n, row in rows.items() if "follows" in row},
    )  # fmt: skip


def _lumped(overrides: Mapping[str, float]) -> dict[str, float]:
    """Turn the paper's C2, C5 and I2xx into C6 and J_theta."""
    values = dict(overrides)
    inertias = {name: _number(name, values.pop(name)) for name in ("C2", "C5", "I2xx") if name in values}
    if not inertias:
        return values
    if len(inertias) < 3:
        raise InputError(SAYS("inertias", names=" and ".join(inertias)))
    constants = {"C6": inertias["C2"] - inertias["I2xx"], "J_theta": inertias["C5"] + inertias["I2xx"]}
    for name, value in constants.items():
        if not math.isclose(values.get(name, value), value, rel_tol=1e-9):
            raise InputError(f"{name} = {values[name]!r}, but C2, C5 and I2xx make it {value:g}: leave {name} out")
    return {**values, **constants}


def _number(name: str, value: float) -> float:
    return Parameter(name, "kg m^2", value, "").value


# --- for reports, figures and exports -----------------------------------------------------------------


@cache
def _scene(zero: str) -> Scene | None:
    return scene_of(TABLE["scene"], ("theta", "alpha"), [p.name for p in PARAMETERS], {"up": GRAVITY[zero]})


def _postures(model: Model, p: Mapping[str, float]) -> dict[str, FloatArray]:
    theta = p["theta_rest"] if p["cable_stiffness"] != 0 else 0.0
    other = {"hanging": "upright", "upright": "hanging"}[model.zero]
    angles = {model.zero: 0.0, other: math.pi}
    rest = {n: {"theta": theta, "alpha": p["alpha_rest"] + angles[n], "arm": theta} for n in ("hanging", "upright")}
    return {n: np.array([values.get(state, 0.0) for state in model.states]) for n, values in rest.items()}


def _smooth(model: Model, p: Mapping[str, float]) -> dict[str, float]:
    """Joints that slide, but for those whose presliding makes a spring of dry friction; gear and motor in contact.

    The base is level, so that both postures are at rest.
    """
    slides = [joint for joint in ("theta", "alpha") if not ("z_" + joint in model.states and p["presliding_" + joint])]
    dry = (f"{name}_{joint}" for joint in slides for name in ("coulomb", "stiction"))
    return {**p, **dict.fromkeys(["play_theta", "dead_zone", "tilt_x", "tilt_y", *dry], 0.0)}


def _columns(
    model: Model,
    theta: FloatArray,
    alpha: FloatArray,
    arm_rates: tuple[FloatArray, FloatArray],
    rates: tuple[FloatArray, FloatArray],
    drive: FloatArray | None,
) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """What each constant is multiplied with in (9) and (10), the sum of which is 0."""
    p = dict(zip(model.parameter_names, model.parameter_vector().tolist(), strict=True))
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

LINEAR_TERMS = LinearTerms(**_TERMS, columns=_columns)

MODEL = {"rotary-pendulum": rotary_pendulum}
"""By the name that a project file gives it."""
