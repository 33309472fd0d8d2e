"""The equations that people read are those that are solved, of every model; and an element that is added is in them."""

import math
import re
import tomllib

import numpy as np
import pytest

import fracid
from fracid.export.whole import written
from fracid.models import Model, Parameter, pendulum
from fracid.models.written.languages import Python
from fracid.models.written.mathematics import LaTeX, MathML, equalities
from fracid.models.written.reading import Untranslatable
from fracid.models.written.tree import Entry, Name, Program, parts
from fracid.report.equations import equations
from fracid.safety.door import own_text
from languages import GCC, in_c
from own_models import own_models

RIGS = {
    "hanging": fracid.rotary_pendulum(coulomb_alpha=2e-4, tilt_x=0.01, saturation=1.0, dead_zone=0.2),
    "upright, C3 < 0": fracid.rotary_pendulum(zero="upright", C3=-3e-3, alpha_rest=0.1, tilt_y=0.02),
    "arm clamped": fracid.rotary_pendulum("stepper-freeswing", C3=0.0),
    "LuGre": fracid.rotary_pendulum(presliding_theta=4e-3, stiction_theta=0.1, coulomb_theta=0.2, slip_speed=0.1),
    "Dahl, a springpot": fracid.rotary_pendulum(presliding_alpha=4e-3, coulomb_alpha=0.2, springpot_theta=0.1),
    "play": fracid.rotary_pendulum(play_theta=0.3, arm_damping=0.1, tilt_x=0.1),
    "an elastic arm": fracid.rotary_pendulum(arm_stiffness=30.0, arm_damping=0.1, drag_theta=0.1),
}


def constants_of(lines):
    return {e.name for line in lines for e in parts((line.left, line.right)) if isinstance(e, Entry) and e.name}


def by_the_lines(model, lines, x, u, p, out):
    """Left and right sides, of outputs and variables as they are defined."""
    python = Python(Program(model.states, (), (), ()))
    at = {"x": x, "u": u, "p": p, "out": out, "math": math}
    for line in lines:
        right = eval(python.expression(line.right), at)
        if isinstance(line.left, Name) and line.left.name not in model.outputs:
            at[python.name(line.left.name)] = right
        elif isinstance(line.left, Name):
            yield model.outputs[line.left.name](0.0, x, u, p), right
        else:
            yield eval(python.expression(line.left), at), right


@pytest.mark.few(5)
@pytest.mark.parametrize("name", [*RIGS, *own_models()])
def test_what_is_printed_is_what_is_solved(name):
    model, rng = (RIGS | own_models())[name], np.random.default_rng(4)
    p, n = model.parameter_vector(), len(model.states)
    lines = equalities(model, {q.name: v for q, v in zip(model.parameters, p, strict=True) if v})
    found = [e.index.value for e in map(lambda line: line.left, lines) if isinstance(e, Entry)]
    assert len(found) == len({*found})
    for _ in range(5):
        x, u, out = rng.uniform(0.1, 0.9, n), rng.uniform(0.96, 1.2, max(1, len(model.inputs))), np.zeros(2 * n)
        model.rhs(0.0, x, u, p, out)
        sides = [*by_the_lines(model, lines, x, u, p, out[:n])]
        assert len(sides) == n + len(model.outputs) - len(model.output_states)
        np.testing.assert_allclose(*np.transpose(sides), rtol=1e-9, atol=1e-12)


def test_a_mass_matrix_that_is_inverted_is_printed_as_it_was_before():
    cart = own_models()["cart-pole"]
    lines = equalities(cart, {q.name: q.value for q in cart.parameters if q.name != "angle_rest"})
    left = [LaTeX(cart).expression(line.left).replace("\\,", "") for line in lines]
    assert left[2:] == [r"MD^{\lambda }v+S\cos \phi D^{\mu }\omega ",
                        r"S\cos \phi D^{\lambda }v+JD^{\mu }\omega "]  # fmt: skip


def mill(t, x, u, p, out):
    out[0] = x[1]
    brake = 0.0
    if x[1] > p[1]:
        brake = p[0] * x[1] ** 2 if u[0] > 0.0 else p[2]
    out[1] = (math.sqrt(abs(u[0])) * math.exp(-x[0] / 0.25) - brake - 0.5 * math.atan2(x[0], x[1])) / p[3]


MILL = Model("mill", mill, ("phi", "speed"), (1.0, "mu"), {"phi": 0}, ("wind",),
             (Parameter("c_d", "1", 2.0, ""), Parameter("limit", "1", 0.5, ""), Parameter("rub_wall", "1", 0.3, ""),
              Parameter("J", "1", 4.0, "", symbol=("I", ""))), "", "an example")  # fmt: skip


def test_a_branch_that_the_motion_decides_is_a_case_in_mathml_and_latex():
    lines = equalities(MILL, {q.name: q.value for q in MILL.parameters})
    text = LaTeX(MILL).block(lines)
    assert r"\mathrm{brake}=\begin{cases} \begin{cases} c_{d}\,\mathrm{speed}^{2} & \text{if" in text
    assert r"I\,D^{\mu }\,\mathrm{speed}=\sqrt{|\mathrm{wind}|}\,e^{-\phi /0.25}" in text
    assert r"\frac{1}{2}\,\operatorname{atan2}(\phi ,\mathrm{speed})" in text
    assert constants_of(lines) == {"c_d", "limit", "rub_wall", "J"}
    found = MathML(MILL).block(lines)
    assert found.count("otherwise") == text.count("otherwise") == 2
    assert "<msqrt>" in found


def test_a_loop_has_no_equation_and_names_are_text():
    def rhs(t, x, u, p, out):
        out[0], k = x[0], 0.0
        while k < u[0]:
            k += 1.0
            out[0] = out[0] - k

    model = Model("m", rhs, ("a<b>",), (1.0,), {"a<b>": 0}, ("u",), (), "", "an example")
    with pytest.raises(Untranslatable, match="A loop cannot be written"):
        equalities(model, {})
    assert "&lt;b&gt;" in MathML(model).symbol("a<b>")
    found = equations(model, {"orders": {}, "parameters": {}, "recordings": {}}, driven=True, language="LaTeX")
    assert re.search(r"=.*f1.*\(.*a<b>.*,.*u.*\)", found["Its states"])


# --- an element that is added ----------------------------------------------------------------------------------------

SEAL = """[model.parameters]
seal_alpha = { start = 0.0, lower = 0.0, unit = "N m s^0.5", symbol = "q_α", about = "lip of a seal" }
"""
TORQUE = ' - joint_alpha - seal_alpha*copysign(sqrt(abs(alpha_rate)), alpha_rate)"'


def test_a_friction_element_with_its_row_and_its_torque_is_in_the_equations_and_in_every_language(
    tmp_path, monkeypatch, request
):
    text = own_text("models/rotary-pendulum.toml")
    for before, after in (("[model.parameters]\n", SEAL), (' - joint_alpha"', TORQUE)):
        assert text.count(before) == 1
        text = text.replace(before, after)
    monkeypatch.setattr(pendulum, "TABLE", tomllib.loads(text))
    pendulum._of_the_file.cache_clear()
    request.addfinalizer(pendulum._of_the_file.cache_clear)
    model = pendulum.rotary_pendulum(seal_alpha=3e-3)
    lines = equalities(model, {q.name: q.value for q in model.parameters if q.value})
    assert r"-q_{\alpha }\,\operatorname{copysign}(\sqrt{|\omega _{\alpha }|},\omega _{\alpha })" in LaTeX(model).block(
        lines
    )
    assert "seal_alpha" not in constants_of(equalities(pendulum.rotary_pendulum(), {"C1": 1.0, "J_theta": 1.0}))
    for language in ("c", "matlab", "javascript"):
        assert re.search(r"p\.seal_alpha \* \w+\(", written(model, language)), language
    if GCC is None:
        pytest.skip("no C compiler")
    (f,) = in_c(tmp_path, [written(model, "c")], [model.parameter_names])
    x, out = np.array([0.1, 0.2, 0.3, 0.4]), np.zeros(4)
    model.rhs(0.0, x, np.ones(1), model.parameter_vector(), out)
    np.testing.assert_array_equal(f(x, np.ones(1), model.parameter_vector(), 4), out)
