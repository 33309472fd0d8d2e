"""What the page needs to simulate the model anew while its reader moves an order or a friction.

The solver is :mod:`fracid.export.javascript`'s.  The page holds it against the fitted curve before it shows anything,
so what a model has that the solver lacks is said in one sentence in the section's place.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import islice
from math import inf, isfinite
from typing import Any

import numpy as np

from fracid.arrays import FloatArray, by_name
from fracid.errors import InputError
from fracid.export.javascript import no_javascript, program, solver
from fracid.export.whole import written, written_outputs
from fracid.problem import Experiment, Free, Problem
from fracid.problem.costs import COSTS
from fracid.report.material import Material
from fracid.report.samples import base64_floats
from fracid.report.traces import budget
from fracid.safety.door import own_text
from fracid.units import half_of, letter, typeset_unit
from fracid.words import Sentences

SAYS = Sentences("report/explore.toml")

MOST = 6
"""Recordings to choose from."""

SQUARES = ("rmse", "ise")
"""Costs whose least is that of the squares, which the page's refit sums."""

WIDE = 0.15
"""How far an order's slider goes beyond the estimate and its integer value at least."""


def not_explored(material: Material) -> str:
    """Why the model cannot be simulated on the page; empty if it can."""
    problem = material.problem
    if material.result.get("window") is not None:
        return "The recordings were fitted in windows, each with a start of its own; the page simulates from one."
    if reason := no_javascript(problem):
        return reason
    try:
        _functions(problem)
    except InputError as error:
        return str(error)
    if not isfinite(material.result["cost"]["value"] or inf):
        return "No run of the model reached the end of a recording."
    some = any(True for _ in _explorable(material))
    return "" if some else next(reason for e in problem.experiments if (reason := _beyond(e)))


def _functions(problem: Problem) -> list[str]:
    """The outputs that are no states, in JavaScript; nothing where all are."""
    functions = [n for n in problem.outputs if n not in problem.model.output_states]
    if derived := [n for n in functions if n in problem.model.derived]:
        raise InputError(f"{derived[0]} is a derivative of an output, which the page's solver lacks.")
    if functions and any(e.release_time != 0.0 for e in problem.experiments):
        raise InputError(SAYS("function", name=functions[0]))
    return [written_outputs(problem.model, "javascript")] if functions else []


def _beyond(e: Experiment) -> str:
    """What a recording has that the page's solver lacks; empty for nothing."""
    has = {"past": e.past is not None, "sensors": bool(e.sensors), "uneven": e.times is not None}
    return next((SAYS(what, name=e.name) for what, there in has.items() if there), "")


def _explorable(material: Material) -> Iterator[tuple[Problem, FloatArray, Experiment]]:
    """The recordings that the page can simulate, fitted ones first, each with the problem and the unknowns it has."""
    problem = material.problem
    for e in problem.experiments:
        if not _beyond(e):
            yield problem, material.fit.x, e
    for e in material.project.validation:
        found = material.fit.recordings.get(e.name)
        if not _beyond(e) and found is not None and isfinite(found.cost):
            alone, own = problem.with_shared(material.fit.x, (e,)), {**found.initial, **found.parameters}
            x = [own[u.target].value if u.target in own else u.range.start for u in alone.unknowns]
            yield alone, np.array(x), e


def explore_scripts(material: Material) -> list[str]:
    """The solver, the model and the section's script."""
    problem, own = material.problem, [own_text(f"report/{name}") for name in ("fitting.js", "explore.js")]
    return [solver(), written(problem.model, "javascript"), *_functions(problem), *own]


def explore(material: Material) -> dict[str, Any]:
    """The data of the section, for JSON."""
    problem, cost = material.problem, material.problem.cost_function.name
    return {
        "program": program(problem),
        "orders": {n: e["value"] for n, e in material.result["orders"].items()},
        "outputs": [_output(material, n) for n in problem.outputs],
        "levels": problem.weights != "equal",
        "cost": "" if cost in SQUARES else cost.upper() if cost in COSTS else cost,
        "sliders": [*_orders(material), *_constants(material)],
        "recordings": [_recording(material, *one) for one in islice(_explorable(material), MOST)],
    }


# --- sliders -----------------------------------------------------------------------------------------


def _orders(material: Material) -> Iterator[dict[str, Any]]:
    """A slider for each order that is not tied to another."""
    problem = material.problem
    for name, e in material.result["orders"].items():
        if name not in problem.ties and e["value"] is not None:
            integer = e["integer"]
            ends = [e["value"], *(e["interval95"] or ()), *([] if integer is None else [integer])]
            reach = max(0.02, min(ends) - WIDE), min(1.98, max(ends) + WIDE)
            yield _slider(problem, name, e, reach) | {"kind": "orders", "integer": integer}


def _constants(material: Material) -> Iterator[dict[str, Any]]:
    """A slider for each friction that is there, or might be, and for each other value that was free."""
    problem, values, friction = material.problem, material.result["parameters"], material.model.friction
    for name in dict.fromkeys((*friction, *problem.parameters)):
        e, start = values.get(name), problem.parameters.get(name)
        if e is None or e["value"] is None or name in {*problem.own_parameters, *problem.ties}:
            continue
        bounds = {}
        if isinstance(start, Free):  # between them it is found again
            bounds = {"lower": min(start.lower, e["value"]), "upper": max(start.upper, e["value"])}
        low, high = _of_friction(material, name, e, start) if name in friction else _of_constant(e, **bounds)
        if isfinite(high - low) and low < high:
            yield _slider(problem, name, e, (low, high)) | {"kind": "parameters", "integer": None} | bounds


def _of_constant(e: Mapping[str, Any], lower: float = 0.0, upper: float = 0.0) -> tuple[float, float]:
    """Some of its intervals or half of itself about a value, within its bounds; nothing where it has none."""
    around = max(3 * half_of(e["interval95"]), abs(e["value"]) / 2)
    return (max(lower, e["value"] - around), min(upper, e["value"] + around)) if lower < upper else (0.0, 0.0)


def _of_friction(material: Material, name: str, e: Mapping[str, Any], start: object) -> tuple[float, float]:
    kind = material.model.friction[name]
    high = max(3 * abs(e["value"]), 1.3 * max(map(abs, e["interval95"] or (0.0,))))
    if e.get("at_bound") and isinstance(start, Free):
        high = max(high, 3 * abs(start.start))
    if high == 0.0 and kind.dry and kind.joint:
        high = _might_be(material, kind.joint)
    if e["value"] == kind.off and not kind.dry and not e["free"]:
        return 0.0, 0.0
    return (-high if e["value"] < 0.0 or kind.signed else 0.0), high


def _might_be(material: Material, joint: str) -> float:
    """The viscous torque at the joint's highest speed: what dry friction could stand in for [N m]."""
    model, values = material.model, material.result["parameters"]
    viscous = sum(
        abs(values[n]["value"] or 0.0)
        for n, kind in model.friction.items() if kind.power == 1 and kind.joint == joint and n in values
    )  # fmt: skip
    speeds = [np.nanmax(np.abs(np.diff(r.fitted[joint]) / np.diff(r.time)), initial=0.0)
              for r in material.fit.recordings.values() if joint in r.fitted]  # fmt: skip
    return float(viscous * max(speeds, default=0.0))


def _slider(problem: Problem, name: str, e: Mapping[str, Any], reach: tuple[float, float]) -> dict[str, Any]:
    says = {p.name: p.description.partition(":")[0] for p in problem.model.parameters}
    return {
        "name": name, "letter": letter(name), "unit": typeset_unit(e["unit"]), "says": says.get(name, "order"),
        "value": e["value"], "interval": e["interval95"], "free": e["free"], "low": reach[0], "high": reach[1],
        "targets": [name, *(n for n, root in problem.ties.items() if root == name)],
    }  # fmt: skip


# --- recordings ----------------------------------------------------------------------------------------


def _output(material: Material, name: str) -> dict[str, Any]:
    shown, factor = material.unit(name)
    model = material.model
    return {"name": name, "letter": letter(name), "unit": shown, "factor": factor,
            "state": model.output_states.get(name), "place": [*model.shown].index(name)}  # fmt: skip


def _recording(material: Material, problem: Problem, x: FloatArray, e: Experiment) -> dict[str, Any]:
    """One recording as ``Fracid.simulate`` takes it, and what it is held against."""
    values, driven = problem.unpack(x, e), problem.simulator.inputs(x, e)
    samples = min(len(e.measured), budget(len(material.fit.recordings)))
    rows = problem.simulator.steps(e) - (len(e.measured) - samples) * problem.substeps + 1
    return {
        "name": e.name, "use": material.fit.recordings[e.name].use, "own": _lines(material, e, samples),
        "step": e.step / problem.substeps, "steps": rows - 1, "every": problem.substeps,
        "samples": samples, "whole": len(e.measured), "release": None if e.release_time == 0.0 else values.release,
        "limit": problem.simulator.limit, "initial": values.initial,
        "deflections": list(_deflections(problem, x, e)), "unknowns": list(_unknowns(problem, x, e)),
        "parameters": by_name(problem.model.parameter_names, values.parameters),
        "inputs": base64_floats(driven.before if len(driven.before) == 1 else driven.before[:rows], "<f8"),
        "jumps": None if driven.jumps is None else base64_floats(driven.jumps[:rows], "<f8"),
    }  # fmt: skip


def _lines(material: Material, e: Experiment, samples: int) -> dict[str, dict[str, str]]:
    """The measured and the fitted samples; nothing where the page draws all of them."""
    if samples == len(e.measured) and np.all(e.scored):
        return {}
    r, outputs = material.fit.recordings[e.name], material.problem.outputs
    scored = zip(outputs, e.scored.T, strict=True)
    shown = {n: material.unit(n)[1] for n in outputs}
    return {
        "measured": {n: base64_floats(np.where(own, shown[n] * r.measured[n], np.nan)[:samples]) for n, own in scored},
        "fitted": {n: base64_floats(shown[n] * r.fitted[n][:samples]) for n in outputs},
    }


def _unknowns(problem: Problem, x: FloatArray, e: Experiment) -> Iterator[dict[str, Any]]:
    """What was free beside the orders, and is found again where these are held at their integer values."""
    for u, value in zip(problem.unknowns, x.tolist(), strict=True):
        if u.kind not in ("parameter", "initial") or u.experiment not in (None, e.name):
            continue
        lower, upper = u.range.lower, u.range.upper
        width = upper - lower if isfinite(upper - lower) else abs(value) or 1.0
        at = problem.model.states.index(u.target) if u.kind == "initial" else None
        yield {
            "name": u.target, "state": at, "value": value, "lower": lower, "upper": upper,
            "width": min(width, 10 * abs(value)) or width,
            "targets": [n for n in problem.model.parameter_names if at is None and problem.ties.get(n, n) == u.target],
        }  # fmt: skip


def _deflections(problem: Problem, x: FloatArray, e: Experiment) -> Iterator[dict[str, Any]]:
    """Of each presliding joint its state, its δ, and which share of it is given at the start; None where it slides."""
    model, values = problem.model, problem.unpack(x, e)
    for state, delta in model.relaxing.items():
        if state not in e.initial and problem.initial_state == "estimate":
            i = model.states.index(state)
            free = any(u.kind == "initial" and u.target == state and u.experiment == e.name for u in problem.unknowns)
            size = values.parameters[model.parameter_names.index(delta)]
            slides = not free and values.initial[i] != 0.0
            yield {"state": i, "delta": delta, "share": None if slides else values.initial[i] / size if size else 0.0}
