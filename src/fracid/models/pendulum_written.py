"""The rotary pendulum's right-hand side as people and other languages read it: MathML, C and MATLAB.

:mod:`fracid.models.pendulum` has the equations, and a right-hand side for each set of states beyond the four; here is
what is written of each: elements without a state of their own always, the others where their state is there.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from string import Template
from typing import Any

from fracid.models.base import Model
from fracid.models.geometry import GRAVITY, STANDARD_GRAVITY
from fracid.models.joints import CONTACT

__all__ = ["code", "equations"]

JOINTS = {"theta": ("θ", 1), "alpha": ("α", 3)}
"""Joint → its letter, and the state that is its rate."""


# --- MathML ------------------------------------------------------------------------------------------


def equations(c: Any, model: Model, orders: Mapping[str, Any], driven: bool) -> Iterator[tuple[Any, ...]]:
    """Left side of each equation and the rows of its right side, by a :class:`fracid.report.equations.Writer`."""
    λ, μ = (c.order(n, orders[n]) for n in ("lambda", "mu"))
    θ, α, ω_θ, ω_α = c.i("θ"), c.i("α"), c.sub("ω", "θ"), c.sub("ω", "α")
    a = c.bracket(c.row(α, c.o("−"), c("alpha_rest"))) if c.there("alpha_rest") else α
    from_rest = c.bracket(c.row(θ, c.o("−"), c("theta_rest"))) if c.there("theta_rest") else θ
    sin, cos, sin2 = c.f("sin", a), c.f("cos", a), c.f("sin", c.row(c.n("2"), a))
    inertia, M12 = c.row(c("C6"), c.power(c.i("sin"), c.n("2")), a), c.row(c("C3"), cos)
    two_bodies = "arm" in model.states
    ω_a = c.sub("ω", "a") if two_bodies else ω_θ

    motor = [
        *(c.term("+", "torque_per_volt", _voltage(c)) if driven else []),
        *c.term("−", "b_theta", ω_θ),
        *c.term("−", "back_emf", ω_θ),
        *_friction(c, model, "theta", ω_θ),
        *c.term("−", "drag_theta", ω_θ, c.size(ω_θ)),
        *c.term("−", "cable_stiffness", from_rest),
    ]
    tilt_θ, tilt_α = _tilt(c, model, c.sub("θ", "a") if two_bodies else θ, sin, cos)
    arm = [*c.term("−", "C6", sin2, ω_α, ω_a), *c.term("+", "C3", sin, c.squared(ω_α)), *tilt_θ]
    f_α = [
        *c.term("+" if model.zero == "upright" else "−", "C4", sin),
        *c.term("+", "C6", sin2, c.squared(ω_a), half=True),
        *c.term("−", "b_alpha", ω_α),
        *_friction(c, model, "alpha", ω_α),
        *c.term("−", "drag_alpha", ω_α, c.size(ω_α)),
        *tilt_α,
    ]
    yield c.D(λ, θ), ω_θ
    yield c.D(μ, α), ω_α
    if driven and (c.there("dead_zone") or c.there("saturation")):
        yield _voltage(c), _converted(c)
    if two_bodies:
        θ_a, J_h, τ_a = c.sub("θ", "a"), _hub(c), c.sub("τ", "a")
        yield c.D(λ, θ_a), ω_a
        yield τ_a, *c.sum(list(_shaft(c, J_h, θ, θ_a, ω_θ, ω_a)))
        yield c.row(J_h, c.D(λ, ω_θ)), *c.sum([*motor, (c.o("−"), τ_a)])
        arm, J = [(c.o("+"), τ_a), *arm], c.row(c("J_theta"), c.o("−"), J_h)
    else:
        arm, J = [*motor, *arm], c("J_theta")
    M11 = c.bracket(c.row(J, c.o("+"), inertia))
    yield c.row(M11, c.D(λ, ω_a), c.o("+"), M12, c.D(μ, ω_α)), *c.sum(arm)
    yield c.row(M12, c.D(λ, ω_a), c.o("+"), c("C1"), c.D(μ, ω_α)), *c.sum(f_α)
    for joint, rate in (("theta", ω_θ), ("alpha", ω_α)):
        yield from _own_states(c, model, joint, rate)


def _tilt(c: Any, model: Model, θ: Any, sin: Any, cos: Any) -> tuple[list[tuple[Any, Any]], list[tuple[Any, Any]]]:
    """What an axis that leans adds: g S ε·e_t − C4 sin α ε·e_r on the arm, C4 cos α ε·e_t on the pendulum."""
    there = [n for n in ("tilt_x", "tilt_y") if c.there(n)]
    if not there:
        return [], []
    e_r = {"tilt_x": (c.o("+"), c.f("cos", θ)), "tilt_y": (c.o("+"), c.f("sin", θ))}
    e_t = {"tilt_x": (c.o("−"), c.f("sin", θ)), "tilt_y": (c.o("+"), c.f("cos", θ))}
    along, across = (c.bracket(c.row(*c.sum([(e[n][0], c.row(c(n), e[n][1])) for n in there]))) for e in (e_r, e_t))
    plus, minus = ("+", "−") if model.parameter("C3").value >= 0 else ("−", "+")
    weight = c.term("+", "arm_moment", c.n(f"{STANDARD_GRAVITY:g}"), across)
    return [*weight, *c.term(minus, "C4", sin, along)], c.term(plus, "C4", cos, across)


def _own_states(c: Any, model: Model, joint: str, ω: Any) -> Iterator[tuple[Any, ...]]:
    """D z = ω − |ω| z g(0)/(δ g(ω)) of presliding; D^(1−ν) y = ω of a springpot."""
    letter, _ = JOINTS[joint]
    if f"z_{joint}" in model.states:
        z, δ = c.sub("z", letter), c(f"presliding_{joint}")
        part = c.ratio(c.n("1"), δ)
        if c.there(f"stiction_{joint}"):
            part = c.ratio(_breakaway(c, joint), c.row(δ, _stribeck(c, joint, ω)))
        yield c.D(c.n("1"), z), c.row(ω, c.o("−"), part, c.size(ω), z)
    if f"y_{joint}" in model.states:
        order = c.row(c.n("1"), c.o("−"), c(f"springpot_order_{joint}"))
        yield c.D(order, c.sub("y", letter)), ω


def _friction(c: Any, model: Model, joint: str, ω: Any) -> Iterator[tuple[Any, Any]]:
    """Of sliding or presliding, and of a springpot."""
    letter, _ = JOINTS[joint]
    there = c.there(f"coulomb_{joint}") or c.there(f"stiction_{joint}")
    if f"z_{joint}" in model.states:
        z = c.sub("z", letter)
        if there:
            yield c.o("−"), c.row(c.ratio(_breakaway(c, joint), c(f"presliding_{joint}")), z)
        yield from c.term("−", f"presliding_damping_{joint}", c.D(c.n("1"), z))
    elif c.there(f"stiction_{joint}"):
        yield c.o("−"), c.row(_stribeck(c, joint, ω), c.tanh(ω, c("slip_speed")))
    elif c.there(f"coulomb_{joint}"):
        yield from c.term("−", f"coulomb_{joint}", c.tanh(ω, c("slip_speed")))
    if f"y_{joint}" in model.states:
        yield from c.term("−", f"springpot_{joint}", c.sub("y", letter))


def _breakaway(c: Any, joint: str) -> Any:
    """f + s, without what is not there."""
    parts = [c(n) for n in (f"coulomb_{joint}", f"stiction_{joint}") if c.there(n)]
    return parts[0] if len(parts) == 1 else c.bracket(c.row(parts[0], c.o("+"), parts[1]))


def _stribeck(c: Any, joint: str, ω: Any) -> Any:
    """g(ω) = f + s exp(−(ω/v_st)²)."""
    of_rest = c.squared(c.bracket(c.row(ω, c.o("/"), c(f"stribeck_speed_{joint}"))))
    part = c.row(c(f"stiction_{joint}"), c.power(c.i("e"), c.row(c.o("−"), of_rest)))
    return c.bracket(c.row(c(f"coulomb_{joint}"), c.o("+"), part)) if c.there(f"coulomb_{joint}") else part


def _voltage(c: Any) -> Any:
    return c.sub("u", "m") if c.there("dead_zone") or c.there("saturation") else c.i("u")


def _converted(c: Any) -> Any:
    """What the motor gets of the voltage."""
    u = c.row(c.i("u"), c.o("−"), _within(c, "dead_zone", c.i("u"))) if c.there("dead_zone") else c.i("u")
    return _within(c, "saturation", u) if c.there("saturation") else u


def _within(c: Any, name: str, what: Any) -> Any:
    """min(max(x, −c), c)."""
    low = c.row(c.i("max"), c.bracket(c.row(what, c.o(","), c.o("−"), c(name))))
    return c.row(c.i("min"), c.bracket(c.row(low, c.o(","), c(name))))


def _hub(c: Any) -> Any:
    return c("hub_inertia") if c.there("hub_inertia") else c.row(c.ratio(c.n("1"), c.n("5")), c("J_theta"))


def _shaft(c: Any, J_h: Any, θ: Any, θ_a: Any, ω_θ: Any, ω_a: Any) -> Iterator[tuple[Any, Any]]:
    """The torque on the arm: of a spring, beyond the play, and of a dashpot while it is stretched."""
    turn = c.row(θ, c.o("−"), θ_a)
    if c.there("play_theta"):
        turn = c.row(turn, c.o("−"), _within(c, "play_theta", turn))
    own = c.row(c.squared(c.bracket(c.row(c.n("120"), c.i("π"), c.text("/s")))), J_h)
    yield c.o("+"), c.row(c("arm_stiffness") if c.there("arm_stiffness") else own, c.bracket(turn))
    when = [c.text("\N{NO-BREAK SPACE}in contact")] if c.there("play_theta") else []
    yield from c.term("+", "arm_damping", c.bracket(c.row(ω_θ, c.o("−"), ω_a)), *when)


# --- C and MATLAB --------------------------------------------------------------------------------------


def code(zero: str, own: Sequence[str]) -> dict[str, str]:
    """Language → the function, as the templates of :mod:`fracid.export` call it.

    The functions give the derivatives, and of each state that relaxes the rate with which it forgets: in C behind
    them, in MATLAB as a second value.

    Parameters
    ----------
    zero
        "hanging" or "upright".
    own
        States beyond the four.

    Examples
    --------
    >>> "presliding(" in code("hanging", ["z_alpha"])["c"], "presliding(" in code("hanging", [])["c"]
    (True, False)
    """
    return {"c": _c(zero, own), "matlab": _matlab(zero, own)}


C_ELEMENTS = """\
/* What is beyond +-half, of a gear's play or a motor's dead zone. */
static double gap(double q, double half)
{
    return q > half ? q - half : q < -half ? q + half : 0;
}

/* What is within +-most, 0 for no limit. */
static double saturated(double q, double most)
{
    return most != 0 ? fmin(fmax(q, -most), most) : q;
}

/* Dry friction: Coulomb's f and Stribeck's s, which goes with the speed. */
static double stribeck(double v, double f, double s, double v_st)
{
    return s != 0 ? f + s * exp(-(v / v_st) * (v / v_st)) : f;
}

static double sliding(double v, double f, double s, double v_st)
{
    return f != 0 || s != 0 ? stribeck(v, f, s, v_st) * tanh(v / slip_speed) : 0;
}
"""

C_PRESLIDING = """
/* The joint gives by delta before it slides: z' = v - rate z; out holds z', and the rate with which z forgets. */
static double presliding(double z, double v, double f, double s, double v_st, double delta, double sigma1,
                         double out[], int derivative, int rate)
{
    const double rest = f + s, part = rest > 0 ? fmax(stribeck(v, f, s, v_st) / rest, 1e-9) : 1;
    out[rate] = delta > 0 ? fabs(v) / (delta * part) : 0;
    out[derivative] = delta > 0 ? v - out[rate] * z : 0;
    return delta > 0 ? rest / delta * z + sigma1 * out[derivative] : sliding(v, f, s, v_st);
}
"""

C_JOINT = {
    "": """\
    const double joint_$joint =
        sliding($rate, coulomb_$joint, stiction_$joint, stribeck_speed_$joint)$springpot;
""",
    "z": """\
    const double joint_$joint =
        presliding(x[$z], $rate, coulomb_$joint, stiction_$joint, stribeck_speed_$joint, presliding_$joint,
                   presliding_damping_$joint, f, $z, $forgets)$springpot;
""",
}

C_ARM = """\
    const double J_hub = hub_inertia > 0 ? hub_inertia : 0.2 * J_theta, arm_rate = x[$arm_rate];  /* two bodies */
    const double stiffness = arm_stiffness > 0 ? arm_stiffness : $contact * J_hub;   /* else of 60 Hz */
    const double turn = gap(x[0] - x[$arm], play_theta);
    const double shaft =
        stiffness * turn + (turn != 0 || play_theta == 0 ? arm_damping * (theta_rate - arm_rate) : 0);
    f[1] = (f_theta - shaft) / J_hub;
    f[$arm] = arm_rate;
    f_theta = shaft;
"""

C_CODE = """\
$elements
/* Right-hand side of the rotary pendulum, alpha = 0 is $zero. */
static void right_hand_side(const double x[], const double u[], double f[])
{
    const double theta_rate = x[1], alpha = x[2] - alpha_rest, alpha_rate = x[3];
    const double s = sin(alpha), c = cos(alpha), s2 = 2 * s * c;
$joints\
    double f_theta = torque_per_volt * saturated(gap(u[0], dead_zone), saturation)
        - cable_stiffness * (x[0] - theta_rest) - joint_theta
        - (b_theta + back_emf + drag_theta * fabs(theta_rate)) * theta_rate;
$arm\
    f_theta += C3 * s * alpha_rate * alpha_rate - C6 * s2 * alpha_rate * $of_arm;        /* (9) */
    double f_alpha = $gravity C4 * s + 0.5 * C6 * s2 * $of_arm * $of_arm - joint_alpha
        - (b_alpha + drag_alpha * fabs(alpha_rate)) * alpha_rate;                     /* (10) */
    if (tilt_x != 0 || tilt_y != 0) {                                                /* the axis leans */
        const double ahead = cos(x[$angle]), aside = sin(x[$angle]), weight = copysign(C4, C3);
        const double along = tilt_x * ahead + tilt_y * aside, across = tilt_y * ahead - tilt_x * aside;
        f_theta += $g * arm_moment * across - weight * s * along;
        f_alpha += weight * c * across;
    }
    const double M11 = J_theta$less + C6 * s * s, M12 = C3 * c;                     /* (8) */
    const double det = fmax(M11 * C1 - M12 * M12, 0);
    f[0] = theta_rate;
    f[$turned] = (C1 * f_theta - M12 * f_alpha) / det;                               /* (1) */
    f[2] = alpha_rate;
    f[3] = (M11 * f_alpha - M12 * f_theta) / det;
$rates\
}
"""


def _c(zero: str, own: Sequence[str]) -> str:
    at = {state: 4 + k for k, state in enumerate(own)}
    relaxing = [n for n in own if n.startswith("z_")]
    forgets = {n: 4 + len(own) + ("arm" in own) + k for k, n in enumerate(relaxing)}
    joints = ""
    for joint in JOINTS:
        z, y = f"z_{joint}", f"y_{joint}"
        joints += Template(C_JOINT["z" if z in at else ""]).substitute(
            joint=joint, rate=f"{joint}_rate", z=at.get(z, 0), forgets=forgets.get(z, 0),
            springpot=f" + springpot_{joint} * x[{at[y]}]" if y in at else "",
        )  # fmt: skip
    arm = at.get("arm", 0)
    return Template(C_CODE).substitute(
        zero=zero, gravity="+-"[GRAVITY[zero] < 0], g=repr(STANDARD_GRAVITY), angle=arm,
        elements=C_ELEMENTS + C_PRESLIDING * bool(relaxing), joints=joints,
        arm=Template(C_ARM).substitute(arm=arm, arm_rate=arm + 1, contact=repr(CONTACT)) if arm else "",
        of_arm="arm_rate" if arm else "theta_rate", less=" - J_hub" if arm else "", turned=arm + 1,
        rates="".join(f"    f[{at[f'y_{joint}']}] = {joint}_rate;\n" for joint in JOINTS if f"y_{joint}" in at),
    )  # fmt: skip


MATLAB_PRESLIDING = """
function [torque, derivative, rate] = presliding(z, v, f, s, v_st, delta, sigma1, slip_speed)
% The joint gives by delta before it slides: z' = v - rate z, where rate is how fast z forgets.
  torque = sliding(v, f, s, v_st, slip_speed);  derivative = 0;  rate = 0;
  if delta > 0
    part = 1;
    if f + s > 0, part = max((f + s * exp(-(v / v_st) ^ 2)) / (f + s), 1e-9); end
    rate = abs(v) / (delta * part);
    derivative = v - rate * z;
    torque = (f + s) / delta * z + sigma1 * derivative;
  end
end
"""

MATLAB_JOINT = {
    "": """\
  joint_$joint = sliding($joint_rate, p.coulomb_$joint, p.stiction_$joint, p.stribeck_speed_$joint, p.slip_speed);
""",
    "z": """\
  [joint_$joint, dz_$joint, a_$joint] = presliding(x($z), $joint_rate, p.coulomb_$joint, p.stiction_$joint, ...
    p.stribeck_speed_$joint, p.presliding_$joint, p.presliding_damping_$joint, p.slip_speed);
""",
}

MATLAB_ARM = """\
  J_hub = p.hub_inertia;  if J_hub == 0, J_hub = 0.2 * p.J_theta; end  % two bodies
  stiffness = p.arm_stiffness;  if stiffness == 0, stiffness = $contact * J_hub; end  % of 60 Hz
  turn = gap(x(1) - x($arm), p.play_theta);  arm_rate = x($arm_rate);
  shaft = stiffness * turn + (turn ~= 0 || p.play_theta == 0) * p.arm_damping * (theta_rate - arm_rate);
  hub = (f_theta - shaft) / J_hub;
  f_theta = shaft;
"""

MATLAB_CODE = """\
function [f, rates] = rhs(x, u, p)
% Right-hand side of the rotary pendulum, alpha = 0 is $zero: D^lambda theta = x(2), D^mu alpha = x(4).
  theta_rate = x(2);  alpha = x(3) - p.alpha_rest;  alpha_rate = x(4);
  s = sin(alpha);  c = cos(alpha);  s2 = 2 * s * c;
$joints\
  f_theta = p.torque_per_volt * saturated(gap(u(1), p.dead_zone), p.saturation) ...
    - p.cable_stiffness * (x(1) - p.theta_rest) - joint_theta ...
    - (p.b_theta + p.back_emf + p.drag_theta * abs(theta_rate)) * theta_rate;
$arm\
  f_theta = f_theta + p.C3 * s * alpha_rate ^ 2 - p.C6 * s2 * alpha_rate * $of_arm;                 % (9)
  f_alpha = $gravity p.C4 * s + 0.5 * p.C6 * s2 * $of_arm ^ 2 - joint_alpha ...
    - (p.b_alpha + p.drag_alpha * abs(alpha_rate)) * alpha_rate;                                          % (10)
  if p.tilt_x ~= 0 || p.tilt_y ~= 0                                                       % the axis leans
    along = p.tilt_x * cos(x($angle)) + p.tilt_y * sin(x($angle));
    across = p.tilt_y * cos(x($angle)) - p.tilt_x * sin(x($angle));
    weight = p.C4;  if p.C3 < 0, weight = -p.C4; end
    f_theta = f_theta + $g * p.arm_moment * across - weight * s * along;
    f_alpha = f_alpha + weight * c * across;
  end
  M11 = p.J_theta$less + p.C6 * s ^ 2;  M12 = p.C3 * c;                                            % (8)
  d = max(M11 * p.C1 - M12 ^ 2, 0);  % det(M)
  turned = (p.C1 * f_theta - M12 * f_alpha) / d;                                                          % (1)
  f = [theta_rate; $hub; alpha_rate; (M11 * f_alpha - M12 * f_theta) / d];$own
  rates = $rates;  % with which presliding forgets
end

function torque = sliding(v, f, s, v_st, slip_speed)
% Dry friction: Coulomb's f and Stribeck's s, which goes with the speed.
  torque = (f + s * exp(-(v / v_st) ^ 2)) * tanh(v / slip_speed);
end

function q = gap(q, half)
% What is beyond +-half, of a gear's play or a motor's dead zone.
  q = q - max(min(q, half), -half);
end

function q = saturated(q, most)
% What is within +-most, 0 for no limit.
  if most ~= 0, q = max(min(q, most), -most); end
end
"""


def _matlab(zero: str, own: Sequence[str]) -> str:
    at = {state: 5 + k for k, state in enumerate(own)}
    relaxing = [n.removeprefix("z_") for n in own if n.startswith("z_")]
    joints = ""
    for joint in JOINTS:
        z, y = f"z_{joint}", f"y_{joint}"
        lines = Template(MATLAB_JOINT["z" if z in at else ""])
        joints += lines.substitute(joint=joint, joint_rate=f"{joint}_rate", z=at.get(z, 0))
        joints += f"  joint_{joint} = joint_{joint} + p.springpot_{joint} * x({at[y]});\n" if y in at else ""
    derivatives = {f"z_{j}": f"dz_{j}" for j in JOINTS} | {f"y_{j}": f"{j}_rate" for j in JOINTS}
    arm = at.get("arm", 0)
    return Template(MATLAB_CODE).substitute(
        zero=zero, gravity="+-"[GRAVITY[zero] < 0], g=repr(STANDARD_GRAVITY), angle=arm or 1, joints=joints,
        arm=Template(MATLAB_ARM).substitute(arm=arm, arm_rate=arm + 1, contact=repr(CONTACT)) if arm else "",
        of_arm="arm_rate" if arm else "theta_rate", less=" - J_hub" if arm else "", hub="hub" if arm else "turned",
        own="".join(f"\n  f = [f; {'; '.join(derivatives.get(n, 'arm_rate; turned') for n in own)}];" * bool(own)),
        rates=f"[{'; '.join(f'a_{j}' for j in relaxing)}]" if relaxing else "zeros(0, 1)",
    ) + MATLAB_PRESLIDING * bool(relaxing)  # fmt: skip
