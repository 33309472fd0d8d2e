"""The scene of a model on the page: what ``scene.js`` moves, and a still for paper and where no script runs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from markupsafe import Markup

from fracid.arrays import FloatArray
from fracid.models import Model
from fracid.models.scene import OPEN, Body, Scene
from fracid.models.written.languages import JavaScript
from fracid.report.drawing import drawn
from fracid.report.material import Material

FRAMES = 200
"""Of a motion."""

SIZE = 400, 300
"""Of a picture."""


def scene_data(material: Material) -> dict[str, Any] | None:
    """Bodies, the outputs that move them and the constants of each recording; None where no such output was fitted."""
    problem, result = material.problem, material.result
    scene = problem.model.scene
    if scene is None or not {*scene.moved_by} & {*problem.outputs}:
        return None
    known = {p.name: p.value for p in problem.model.parameters} | _values(result["parameters"])
    return {
        "dimension": scene.dimension,
        "bodies": scene.bodies,
        "outputs": [{"name": n, "factor": material.unit(n)[1]} for n in scene.outputs],
        "constants": {name: known | _values(r["parameters"]) for name, r in result["recordings"].items()},
    }


def _values(parameters: Mapping[str, Any]) -> dict[str, float]:
    return {n: e["value"] for n, e in parameters.items() if e["value"] is not None}


def scene_script(model: Model) -> list[Markup]:
    """``scenePose``, from the constants to the function that fills the ends; none where there is no scene."""
    if model.scene is None:
        return []
    text = JavaScript(model.scene.program).text()
    return [Markup(text.replace("const model", "const scenePose", 1))]  # of a tree: numbers, and names as JavaScript's


def scene_still(material: Material) -> Markup:
    """The scene as simulated at the first sample, as SVG; nothing without one."""
    model, data, r = material.model, scene_data(material), next(iter(material.fit.recordings.values()))
    if model.scene is None or data is None:
        return Markup("")
    constants = data["constants"][r.name]
    values = {n: float(np.nan_to_num(r.fitted[n][0])) for n in r.fitted}
    frame = dict(model.scene.drawn(values, [constants[p.name] for p in model.parameters]))
    return _svg([frame]) if all(np.isfinite(line).all() for line in frame.values()) else Markup("")


def scene_moving(scene: Scene, parameters: FloatArray, motion: Mapping[str, FloatArray], seconds: float) -> str:
    """The scene along a motion, again and again, as SVG that moves where it is a picture too.

    Parameters
    ----------
    scene : Scene
    parameters : ndarray, shape (n_parameters,)
    motion : mapping
        Output → its values, evenly over the time, shape (n,).
    seconds : float

    Examples
    --------
    >>> import fracid
    >>> model = fracid.model("pendulum")
    >>> swing = scene_moving(model.scene, model.parameter_vector(), {"angle": np.linspace(0.0, 1.0, 5)}, 2.0)
    >>> swing.count("<animate"), 'dur="2s"' in swing
    (2, True)
    """
    last = len(next(iter(motion.values()))) - 1
    frames = [dict(scene.drawn({n: float(v[k]) for n, v in motion.items()}, parameters.tolist()))
              for k in np.linspace(0, last, min(last + 1, FRAMES)).astype(int)]  # fmt: skip
    return str(_svg(frames, seconds))


def _svg(frames: list[dict[Body, FloatArray]], seconds: float = 0.0) -> Markup:
    """Bodies with their outlines in a picture that all frames fill; one frame has the colours of the page."""
    places = np.vstack([line for frame in frames for line in frame.values()])
    low, high = places.min(axis=0), places.max(axis=0)
    scale = 0.9 * np.min(np.array(SIZE) / np.maximum(high - low, 1e-12))

    def on_page(line: FloatArray) -> str:
        at = np.array(SIZE) / 2 + scale * (line - (low + high) / 2) * (1, -1)
        return " ".join(f"{x:.1f},{y:.1f}" for x, y in at)

    lines = [(body, [on_page(frame[body]) for frame in frames]) for body in frames[0]]
    return drawn("scene.svg.j2", size=SIZE, lines=lines, seconds=seconds, open=OPEN)
