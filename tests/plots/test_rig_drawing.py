"""The drawing of a model follows its equations: lengths, zeros and positive senses are theirs."""

import math
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.text import Text

import fracid
from fracid.errors import InputError
from fracid.models import RIGS, Model, Parameter, mass_matrix
from fracid.models.library import MODEL
from fracid.models.scene import on_paper
from fracid.models.written.equations import Equation, Equations
from fracid.plots import rig_drawing
from helpers.energy import energy

POSES = [(0.0, 0.0), (0.4, 0.3), (-1.2, 1.9), (2.5, -0.7), (0.3, math.pi)]
MODELS = {
    **{f"{rig}, {zero}": (rig, zero, {}) for rig in RIGS for zero in ("hanging", "upright")},
    "α counted the other way": ("srv02-rotpen", "hanging", {"C3": -4e-3}),
    "an encoder off its zero": ("qube-servo2", "upright", {"alpha_rest": -0.3}),
}


def model_of(name):
    rig, zero, overrides = MODELS[name]
    return fracid.rotary_pendulum(rig, zero=zero, **overrides)


def constants(model):
    return {name: model.parameter(name).value for name in ("C1", "C3", "C4", "C6", "J_theta")}


def length(model):
    """Of the pendulum, in which the scene is drawn [m]."""
    return 1.5 * 9.81 * model.parameter("C1").value / model.parameter("C4").value


def pose(model, theta, alpha):
    """The ends of arm and pendulum [m]."""
    arm, pendulum = model.scene.at({"theta": theta, "alpha": alpha}, model.parameter_vector().tolist())[2:]
    assert np.array_equal(arm[1], pendulum[0])
    assert np.array_equal(arm[0], np.zeros(3))
    return length(model) * pendulum


def rod(model, theta, alpha, h=1e-6):
    """Points of the drawn rod as a body of its own mass, and how they move with θ and with α."""
    mass = 2 * constants(model)["C4"] / (9.81 * length(model))
    nodes, weights = np.polynomial.legendre.leggauss(5)  # exact for what is quadratic along the rod

    def points(theta, alpha):
        end, tip = pose(model, theta, alpha)
        return end + (0.5 + 0.5 * nodes)[:, None] * (tip - end)

    with_theta = (points(theta + h, alpha) - points(theta - h, alpha)) / (2 * h)
    with_alpha = (points(theta, alpha + h) - points(theta, alpha - h)) / (2 * h)
    return points(theta, alpha), mass * weights / 2, with_theta, with_alpha


@cache
def drawn(name, style="screen"):
    return rig_drawing(model_of(name), style=style)


def arrow(figure, name):
    """The curved arrow of an angle, as drawn, shape (n, 2)."""
    (patch,) = (p for p in figure.axes[0].patches if p.get_gid() == f"positive-{name}")
    return patch.get_path().vertices if patch._path_original is None else patch._path_original.vertices


def words(figure):
    return "\n".join(text.get_text() for text in figure.findobj(Text))


# --- the shape ---------------------------------------------------------------------------------------


@pytest.mark.few(20)
@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("at", POSES)
def test_the_drawn_rod_has_the_kinetic_energy_of_the_models_mass_matrix(name, at):
    model = model_of(name)
    C = constants(model)
    _, mass, with_theta, with_alpha = rod(model, *at)
    M = mass_matrix(at[1] - model.parameter("alpha_rest").value, C["C1"], C["C3"], C["C6"], C["J_theta"])
    mixed, own = (mass @ (v * with_alpha).sum(axis=1) for v in (with_theta, with_alpha))
    np.testing.assert_allclose([mixed, own], [M[0, 1], M[1, 1]], rtol=1e-6, atol=1e-6 * C["C1"])


@pytest.mark.few(20)
@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("at", POSES)
def test_the_drawn_rod_is_as_high_as_the_models_energy_has_it(name, at):
    model = model_of(name)

    def height(theta, alpha):
        points, mass, *_ = rod(model, theta, alpha)
        return 9.81 * mass @ points[:, 2]

    states = np.array([[theta, 0.0, alpha, 0.0] for theta, alpha in (at, (0.0, 0.0))])
    np.testing.assert_allclose(height(*at) - height(0.0, 0.0), -np.diff(energy(model, states))[0], atol=1e-9)


@pytest.mark.parametrize("name", MODELS)
def test_released_from_rest_the_drawn_rod_and_arm_keep_their_angular_momentum(name):
    model = model_of(name)
    C, alpha = constants(model), 0.4
    still = {n: 0.0 for n in model.parameter_names if n.startswith(("b_", "coulomb", "drag", "cable"))}
    out = np.empty(4)
    model.rhs(0.0, np.array([0.0, 0.0, alpha, 0.0]), np.zeros(1), model.parameter_vector(still), out)
    points, mass, _, with_alpha = rod(model, 0.0, alpha)
    of_the_swing = mass @ np.cross(points, with_alpha)[:, 2]  # about z, for a unit of α's speed
    of_all = C["J_theta"] + C["C6"] * math.sin(alpha - model.parameter("alpha_rest").value) ** 2
    assert of_all * out[1] == pytest.approx(-of_the_swing * out[3], rel=1e-6)


@pytest.mark.parametrize(
    ("rig", "arm"),
    [("srv02-rotpen", 0.216), ("qube-servo2", 0.085), ("cazzolato-prime", 0.278), ("odrive-furuta", 0.093525)],
)
def test_the_arm_is_as_long_as_its_maker_says(rig, arm):
    assert np.linalg.norm(pose(fracid.rotary_pendulum(rig), 0.3, 0.2)[0]) == pytest.approx(arm, rel=1e-9)


def test_a_uniform_rod_is_drawn_as_long_as_it_is():
    end, tip = pose(fracid.rotary_pendulum("qube-servo2"), 0.3, 0.2)
    assert np.linalg.norm(tip - end) == pytest.approx(0.129, rel=1e-9)


@given(st.floats(1e-3, 1e3))
def test_a_factor_that_a_free_response_cannot_tell_changes_no_length(factor):
    model = fracid.rotary_pendulum("srv02-rotpen")
    scaled = model.with_parameters(**{n: factor * v for n, v in constants(model).items()})
    np.testing.assert_allclose(pose(scaled, 0.3, 0.2), pose(model, 0.3, 0.2))


def test_a_length_that_no_constant_makes_is_said():
    with pytest.raises(InputError, match=r"'cart-pole' is not drawn: with its constants a body .* is infinite"):
        rig_drawing(fracid.model("cart-pole", ml=0.0))


def test_a_model_of_ones_own_has_no_scene():
    own = Model("balance", lambda *_: None, ("x",), ("q",), {"x": 0}, (), (Parameter("k", "1/s", 1.0, ""),), "", "")
    with pytest.raises(InputError, match=r"'balance' is not drawn: it has no scene. Write one as \[model.scene\]"):
        own.plot()


# --- the picture -------------------------------------------------------------------------------------


def test_the_rig_is_seen_from_above_and_not_mirrored():
    x, y, z = on_paper(np.eye(3))[0]
    assert x[0] * y[1] - x[1] * y[0] > 0  # from x to y is counter-clockwise
    assert z[0] == pytest.approx(0)
    assert z[1] > 0


@pytest.mark.few(4)
@pytest.mark.parametrize("name", [*MODELS, *(n for n in MODEL if fracid.model(n).scene is not None)])
def test_each_arrow_leads_from_where_the_output_is_zero_to_where_it_is_positive(name):
    model = model_of(name) if name in MODELS else fracid.model(name)
    figure, constants = rig_drawing(model), model.parameter_vector().tolist()
    assert {p.get_gid() for p in figure.axes[0].patches} >= {f"positive-{n}" for n in model.scene.moved_by}
    for output in model.scene.moved_by:
        path = arrow(figure, output)
        ends = [on_paper(model.scene.at({output: v}, constants))[0] for v in (0.0, 1e-3)]
        moved = ends[1] - ends[0]
        first = int(np.argmax(np.abs(moved).max(axis=(1, 2)) > 0))
        towards = 0.3 * moved[first, 0] + 0.7 * moved[first, 1]
        if output == model.scene.moved_by[0]:  # what comes before it moves the others with it
            assert (path[1] - path[0]) @ towards > 0.99 * np.hypot(*(path[1] - path[0])) * np.hypot(*towards)
        assert np.hypot(*(path[-1] - path[0])) > 0


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("rig", "zero", "said"),
    [("srv02-rotpen", "hanging", "A positive voltage drives θ negative"),
     ("qube-servo2", "upright", "drives θ positive"), ("stepper-freeswing", "hanging", "")],
)  # fmt: skip
def test_the_drawing_says_where_zero_is_and_which_way_the_motor_drives(rig, zero, said):
    text = words(rig_drawing(fracid.rotary_pendulum(rig, zero=zero))).replace("\n", " ")
    assert f"(α = 0: {zero})" in text
    assert said in text
    assert ("drives" in text) == bool(said)


@pytest.mark.few(1)
@pytest.mark.parametrize("style", ["screen", "journal"])
@pytest.mark.parametrize("name", [*[*MODELS][1::2], "srv02-rotpen, hanging", "cazzolato-prime, hanging"])
def test_nothing_written_leaves_the_picture_or_lies_on_other_words(name, style):
    figure = drawn(name, style)
    figure.draw_without_rendering()
    sheet = figure.bbox
    boxes = {t.get_text(): t.get_window_extent() for t in figure.findobj(Text) if t.get_text() and t.get_visible()}
    for text, box in boxes.items():
        assert sheet.x0 <= box.x0 <= box.x1 <= sheet.x1, text
        assert sheet.y0 <= box.y0 <= box.y1 <= sheet.y1, text
    for text, box in boxes.items():
        others = [other for other, b in boxes.items() if other != text and box.overlaps(b)]
        assert not others, (text, others)


def test_a_model_that_nothing_drives_is_drawn():
    mass = {"mass": {"shape": "box", "from": ["x", 0], "to": ["x + 1", 0]}}
    spring = Equations({"x": Equation("v"), "v": Equation("-x")}, {"x": Equation("x")}, scene=mass)
    assert "positive sense." in spring.model("spring", ()).plot().get_supxlabel()
