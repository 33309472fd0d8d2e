"""A model's drawing is a scene: bodies whose ends are functions of the outputs."""

import numpy as np
import pytest

import fracid
from fracid.errors import InputError
from fracid.models.scene import SHAPES, Body, outline, scene_of

BODY = {"shape": "rod", "from": [0, 0], "to": ["sin(angle)", "-cos(angle)"]}


@pytest.mark.parametrize("zero", ["hanging", "upright"])
def test_the_rod_of_a_cart_pole_ends_where_its_uniform_rod_does(zero):
    model = fracid.model("cart-pole", zero=zero, ml=0.05, J=0.02, angle_rest=0.1)
    (start, end) = model.scene.at({"position": 0.3, "angle": 0.5}, [p.value for p in model.parameters])[-1]
    length = 1.5 * 0.02 / 0.05  # m L²/3 over m L/2
    down = -1 if zero == "hanging" else 1
    np.testing.assert_allclose(start, [0.3, 0.0])
    np.testing.assert_allclose(end, [0.3 + length * np.sin(0.4), down * length * np.cos(0.4)])


def test_every_scene_of_the_library_is_moved_by_outputs_and_has_no_body_without_a_size():
    scenes = {name: fracid.model(name).scene for name in fracid.models.library.MODEL}
    assert sum(scene is not None for scene in scenes.values()) >= 6
    for name, scene in scenes.items():
        if scene is not None:
            constants = [p.value for p in fracid.model(name).parameters]
            here, there = (scene.at(dict.fromkeys(scene.outputs, v), constants) for v in (0.1, 0.3))
            assert [not np.array_equal(a, b) for a, b in zip(here, there, strict=True)] == [
                body.moves for body in scene.bodies
            ]
            assert np.all(np.linalg.norm(there[:, 1] - there[:, 0], axis=1) > 0)


@pytest.mark.parametrize("shape", SHAPES)
def test_an_outline_turns_with_its_body(shape):
    body, turn = Body("it", shape, 0.4, True), np.array([[0.6, 0.8], [-0.8, 0.6]])
    ends = np.array([[1.0, 2.0], [3.0, 2.5]])
    np.testing.assert_allclose(outline(body, ends @ turn), outline(body, ends) @ turn, atol=1e-12)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"shape": "cone"}, "shape = 'cone'; expected one of box, rod, disc, spring, vessel"),
        ({"from": [0]}, r'from = \[0\]; expected a point, as in from = \["position", 0\]'),
        ({"to": ["sin(angel)", 0]}, "angel.*did you mean"),
        ({"to": ["__import__('os')", 0]}, "means nothing here"),
        ({"width": 0}, "width = 0; expected a number above 0"),
        ({"width": "wide"}, "width = 'wide'; expected a number above 0"),
    ],
)
def test_what_is_wrong_with_a_body_is_said_with_its_name(change, says):
    with pytest.raises(InputError, match=r"(?s)\[model.scene\] rod.*" + says):
        scene_of({"rod": BODY | change}, ["angle"], (), {})
