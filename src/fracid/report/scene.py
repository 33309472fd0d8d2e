"""The scene of a model on the page: what ``scene.js`` moves, and a still for paper and where no script runs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from markupsafe import Markup

from fracid.models import Model
from fracid.models.scene import OPEN
from fracid.models.written.languages import JavaScript
from fracid.report.material import Material


def scene_data(material: Material) -> dict[str, Any] | None:
    """Bodies, the outputs that move them and the constants of each recording; None where no such output was fitted."""
    problem, result = material.project.problem, material.result
    scene = problem.model.scene
    if scene is None or not {*scene.moved_by} & {*problem.outputs}:
        return None
    known = {p.name: p.value for p in problem.model.parameters} | _values(result["parameters"])
    return {
        "dimension": scene.dimension,
        "bodies": [vars(body) for body in scene.bodies],
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


def scene_still(material: Material, size: tuple[int, int] = (400, 300)) -> Markup:
    """The scene as simulated at the first sample, as SVG; nothing without one."""
    model, data, r = material.project.problem.model, scene_data(material), next(iter(material.recordings.values()))
    if model.scene is None or data is None:
        return Markup("")
    constants = data["constants"][r.name]
    values = {n: float(np.nan_to_num(r.fitted[n][0])) for n in r.fitted}
    bodies = model.scene.drawn(values, [constants[p.name] for p in model.parameters])
    places = np.vstack([line for _, line in bodies])
    if not np.isfinite(places).all():
        return Markup("")
    low, high = places.min(axis=0), places.max(axis=0)
    scale = 0.9 * np.min(np.array(size) / np.maximum(high - low, 1e-12))
    drawn = []
    for body, line in bodies:
        places = np.array(size) / 2 + scale * (line - (low + high) / 2) * (1, -1)
        kind = "way" if body.shape in OPEN else "body moves" if body.moves else "body"
        drawn.append(f'<polyline class="{kind}" points="{" ".join(f"{x:.1f},{y:.1f}" for x, y in places)}"/>')
    opened = f'<svg class="still" viewBox="0 0 {size[0]} {size[1]}" role="img" aria-label="As simulated at the start">'
    return Markup(f"{opened}{''.join(drawn)}</svg>")  # numbers alone
