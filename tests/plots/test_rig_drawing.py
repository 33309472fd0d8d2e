"""The drawing of a rig follows its model: lengths, zeros and positive senses are those of the equations."""

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
from fracid.plots import rig_drawing
from fracid.plots.rig import ALPHA, THETA, _Drawing
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


def rod(model, theta, alpha, h=1e-6):
    """Points of the drawn rod as a body of its own mass, and how they move with θ and with α."""
    shape, C = model.geometry(), constants(model)
    mass = 2 * C["C4"] / (9.81 * shape.pendulum)
    nodes, weights = np.polynomial.legendre.leggauss(5)  # exact for what is quadratic along the rod

    def points(theta, alpha):
        end, tip = shape.pose(theta, alpha)
        return end + (0.5 + 0.5 * nodes)[:, None] * (tip - end)

    with_theta = (points(theta + h, alpha) - points(theta - h, alpha)) / (2 * h)
    with_alpha = (points(theta, alpha + h) - points(theta, alpha - h)) / (2 * h)
    return points(theta, alpha), mass * weights / 2, with_theta, with_alpha


def on_paper(model, points):
    return _Drawing(model.geometry()).on_paper(points)


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
@pytest.mark.parametrize("pose", POSES)
def test_the_drawn_rod_has_the_kinetic_energy_of_the_models_mass_matrix(name, pose):
    model = model_of(name)
    C = constants(model)
    _, mass, with_theta, with_alpha = rod(model, *pose)
    M = mass_matrix(pose[1] - model.parameter("alpha_rest").value, C["C1"], C["C3"], C["C6"], C["J_theta"])
    mixed, own = (mass @ (v * with_alpha).sum(axis=1) for v in (with_theta, with_alpha))
    np.testing.assert_allclose([mixed, own], [M[0, 1], M[1, 1]], rtol=1e-6, atol=1e-6 * C["C1"])


@pytest.mark.few(20)
@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("pose", POSES)
def test_the_drawn_rod_is_as_high_as_the_models_energy_has_it(name, pose):
    model = model_of(name)

    def height(theta, alpha):
        points, mass, *_ = rod(model, theta, alpha)
        return 9.81 * mass @ points[:, 2]

    states = np.array([[theta, 0.0, alpha, 0.0] for theta, alpha in (pose, (0.0, 0.0))])
    np.testing.assert_allclose(height(*pose) - height(0.0, 0.0), -np.diff(energy(model, states))[0], atol=1e-9)


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
    assert fracid.rotary_pendulum(rig).geometry().arm == pytest.approx(arm, rel=1e-9)


def test_a_uniform_rod_is_drawn_as_long_as_it_is():
    assert fracid.rotary_pendulum("qube-servo2").geometry().pendulum == pytest.approx(0.129, rel=1e-9)


@given(st.floats(1e-3, 1e3))
def test_a_factor_that_a_free_response_cannot_tell_changes_no_length(factor):
    model = fracid.rotary_pendulum("srv02-rotpen")
    scaled = model.with_parameters(**{n: factor * v for n, v in constants(model).items()})
    one, other = model.geometry(), scaled.geometry()
    assert (other.arm, other.pendulum) == pytest.approx((one.arm, one.pendulum))


@pytest.mark.parametrize(
    ("constant", "said"), [("C3", "C3 = 0: the arm's length is made of it"), ("C4", "C4 = 0: lengths are made of it")]
)
def test_a_length_that_no_constant_makes_is_said(constant, said):
    with pytest.raises(InputError, match=said):
        rig_drawing(fracid.rotary_pendulum(**{constant: 0.0}))


def test_a_model_of_ones_own_has_no_shape():
    own = Model("balance", lambda *_: None, ("x",), ("q",), {"x": 0}, (), (Parameter("k", "1/s", 1.0, ""),), "", "")
    with pytest.raises(InputError, match="'balance' is no rotary pendulum"):
        own.plot()


# --- the picture -------------------------------------------------------------------------------------


def test_the_rig_is_seen_from_above_and_not_mirrored():
    x, y, z = on_paper(model_of("srv02-rotpen, hanging"), np.eye(3))
    assert x[0] * y[1] - x[1] * y[0] > 0  # from x to y is counter-clockwise
    assert z[0] == pytest.approx(0)
    assert z[1] > 0


@pytest.mark.few(3)
@pytest.mark.parametrize("name", MODELS)
def test_the_arrow_of_theta_leads_from_x_counter_clockwise_to_the_arm(name):
    model = model_of(name)
    path = arrow(drawn(name), "theta")
    x, y, _ = on_paper(model, np.eye(3))
    start, turned = path[0], np.cross(np.c_[path, np.zeros(len(path))][:-1], np.c_[path, np.zeros(len(path))][1:])[:, 2]
    assert start[0] * x[1] - start[1] * x[0] == pytest.approx(0)
    assert start @ x > 0
    assert (turned > 0).all()
    arm = math.cos(THETA) * x + math.sin(THETA) * y
    assert path[-1] @ arm / np.hypot(*path[-1]) / np.hypot(*arm) > 0.98


@pytest.mark.parametrize("name", MODELS)
def test_the_arrow_of_alpha_leads_from_its_zero_where_the_coupling_has_it_grow(name):
    model = model_of(name)
    path = arrow(drawn(name), "alpha")
    C, offset = constants(model), model.parameter("alpha_rest").value
    e_r = np.array([math.cos(THETA), math.sin(THETA), 0.0])
    ahead = np.array([-e_r[1], e_r[0], 0.0])  # where the arm's end moves as θ grows
    down = 1.0 if model.zero == "upright" else -1.0
    sense = math.copysign(1.0, mass_matrix(0.0, C["C1"], C["C3"], C["C6"], C["J_theta"])[0, 1])
    pivot = 9.81 * abs(C["C3"]) / C["C4"] * e_r
    radius = np.hypot(*(path[0] - on_paper(model, pivot)))
    for point, alpha in ((path[0], 0.0), (path[len(path) // 2], None), (path[-1], None)):
        reach = point - on_paper(model, pivot)
        angles = [alpha] if alpha is not None else np.linspace(1e-3, ALPHA, 200)
        lines = [sense * math.sin(a - offset) * ahead + [0, 0, down * math.cos(a - offset)] for a in angles]
        towards = on_paper(model, lines)
        crossed = np.abs(towards[:, 0] * reach[1] - towards[:, 1] * reach[0]).min() / radius
        assert crossed < 2e-3
        assert (towards @ reach > 0).all()


@pytest.mark.parametrize("name", MODELS)
def test_zeros_and_lengths_are_written_in(name):
    model = model_of(name)
    said, shape = words(drawn(name)), model.geometry()
    assert r"$\theta$ = 0" in said
    off = "17.2° off " if model.parameter("alpha_rest").value else ""
    assert rf"$\alpha$ = 0, {off}{model.zero}" in said
    assert f"$l_1$ = {1e3 * shape.arm:.3g} mm" in said
    assert f"$L$ = {1e3 * shape.pendulum:.3g} mm" in said
    assert f"{1e3 * 2 / 3 * shape.pendulum:.3g} mm" in said.replace("\n", " ")
    assert "uniform rod" in said.replace("\n", " ")


@pytest.mark.parametrize(
    ("rig", "said"),
    [("srv02-rotpen", "A positive voltage drives θ negative"), ("qube-servo2", "drives θ positive"),
     ("stepper-freeswing", "")],
)  # fmt: skip
def test_the_drawing_says_which_way_the_motor_drives(rig, said):
    text = words(rig_drawing(fracid.rotary_pendulum(rig))).replace("\n", " ")
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
    upright = {t: b for t, b in boxes.items() if " mm" not in t or "rod" in t}  # of a slanted text the box is too large
    for text, box in upright.items():
        others = [other for other, b in upright.items() if other != text and box.overlaps(b)]
        assert not others, (text, others)
