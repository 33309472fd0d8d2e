"""The rotary pendulum's equations as people read them, in MathML.

:mod:`fracid.models.pendulum` has the equations, and a right-hand side for each set of states beyond the four; here is
what is written of each: elements without a state of their own always, the others where their state is there.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from fracid.models.base import Model
from fracid.models.geometry import STANDARD_GRAVITY

__all__ = ["equations"]

JOINTS = {"theta": ("θ", 1), "alpha": ("α", 3)}
"""Joint → its letter, and the state that is its rate."""


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
