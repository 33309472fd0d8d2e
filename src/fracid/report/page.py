"""A run as one HTML file: what :mod:`fracid.report` is about, put together."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator, Mapping
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from fracid.errors import typed, writing
from fracid.estimation.cost_plane import CostPlane, risen
from fracid.fit import Fit
from fracid.problem.project import Project
from fracid.report.charts import RIGHT, Chart, still
from fracid.report.equations import equations
from fracid.report.explore import explore, explore_scripts, not_explored
from fracid.report.frame import rendered
from fracid.report.index import (
    REPORT,
    RUNS_BEGIN,
    RUNS_END,
    identity,
    of_recordings,
    refresh_index,
    runs_of,
    studies_in,
    write_index,
    write_study_page,
)
from fracid.report.material import Material
from fracid.report.samples import base64_floats
from fracid.report.scene import scene_data, scene_script, scene_still
from fracid.report.sentences import counted, described, half_width_of, joined, state_letter
from fracid.report.study import STUDIES, figures_of, in_script, ladder_of, studies_of
from fracid.report.surface import Surface, surface_still
from fracid.report.traces import fit_charts, recorded_charts, residual_charts, traces
from fracid.report.verdict import does_not_fit, moved_by_the_step, verdict, where
from fracid.report.whiskers import orders_drawn
from fracid.runs.evaluations import tried
from fracid.runs.saved import load_run
from fracid.safety.door import write_files
from fracid.selection.doubts import in_motion, unsaid
from fracid.units import letter, number
from fracid.validation.discretisation import COARSE_STEP
from fracid.validation.residual_analyses import Analyses
from fracid.validation.residual_sentences import words_of
from fracid.words import Sentences

SAYS = Sentences("report/page.toml")

OPEN = 6
"""Recordings, and residuals, that are shown without being asked for."""

TRIED = 1500
"""Points of the search that are drawn, about."""

WARNINGS = 20
"""That are shown without being asked for: all that a fit of a few recordings has."""

STILL_POINTS = 900
"""Of one line of a drawing, of few recordings."""

BESIDE = (COARSE_STEP, "verdict", "bounded", "cut", "spread")
"""Codes of warnings that stand where the page says more: at the checks, and in the rows of tables."""

WIDE = 0.5
"""Part of a constant's value: a wider half of an interval is said beside it."""

STILL_RECORDINGS = 6
"""Of more, each line gets fewer points: a page of two hundred stays light."""

SCRIPTS = ("theme.js", "data.js", "uPlot.iife.min.js", "charts.js", "planes.js", "scene.js", "page.js")
"""In this order, into one element each."""


def write_report(
    folder: str | Path, fit: Fit | None = None, project: Project | None = None, *, plane: CostPlane | None = None,
    jobs: int = 1, out: str | Path | None = None, trust: bool = False, residuals: Analyses | None = None,
) -> Path:  # fmt: skip
    """Write the page of a run or of a study, one HTML file that opens offline; of a folder of runs, an index of them.

    Parameters
    ----------
    folder : str or Path
        Of the run, with its result.json, or of a study (:mod:`fracid.report.study`).  ``profiles.json`` and
        ``compare.json`` are shown where they are there.
    fit, project : Fit and Project, optional
        As just identified, which saves reading them back.
    plane : CostPlane, optional
        From :func:`fracid.estimation.cost_plane.cost_plane`; evaluated if left out, where two orders are free.
    jobs : int
        Threads for that.
    out : str or Path, optional
        The file; ``report.html`` in the folder if left out.
    trust : bool
        Let the run's project run code of its own; see :func:`fracid.load_run`.
    residuals : mapping, optional
        Recording to output to its residual (:mod:`fracid.validation.residual_analyses`); tested if left out.

    Returns
    -------
    Path
        Of the file.

    Raises
    ------
    InputError
        If the folder is no run's, its recordings have changed, or the file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> write_report(tempfile.mkdtemp())
    Traceback (most recent call last):
    fracid.errors.InputError: ... is no run folder: it has no result.json that can be read. Give one that fracid fit
    wrote.
    """
    folder = Path(folder)
    if out is None and not (folder / "result.json").exists() and (runs_of(folder) or any(studies_in(folder))):
        return write_index(folder)
    studies = studies_of(folder) if out is None else []
    if studies and not (folder / "result.json").exists():
        return [write_study_page(folder, file) for file in studies][-1]
    path = folder / REPORT if out is None else Path(out)
    if fit is None or project is None:
        fit = run = load_run(folder, trust=trust)
        project = run.project
    text = report_page(Material.of(folder, fit, project, plane or plane_of(fit, jobs), tested=residuals))
    write_files(path.parent, {path.name: text}, writing(f"The report {path}", "Give another: --out FILE."))
    if out is None:
        refresh_index(folder.parent)
    return path


def plane_of(fit: Fit, jobs: int) -> CostPlane | None:
    """The cost over the orders; None where fewer than two are free, and of a model that does not fit."""
    from fracid.estimation.cost_plane import cost_plane

    if len(fit.problem.order_indices) < 2 or not isfinite(fit.cost) or does_not_fit(fit.claim_codes):
        return None
    return cost_plane(fit.problem, fit.x, orders=fit.orders, jobs=jobs)


def report_page(material: Material) -> str:
    """Fill the template.

    Parameters
    ----------
    material : Material

    Returns
    -------
    str
        HTML.
    """
    charts, surface, rig = dict(_charts(material)), _cost_surface(material), scene_data(material)
    unexplored = not_explored(material)
    own = [] if unexplored else explore_scripts(material)
    scripts = [*scene_script(material.model), *SCRIPTS, *map(Markup, own)]
    data = {
        "recordings": traces(material), "charts": {name: chart.packed() for name, chart in charts.items()}, "rig": rig,
        "plane": surface and vars(surface) | {
            "height": base64_floats(surface.height), "tried": np.round(surface.tried, 5), "search": surface.search,
        },
        "explore": None if unexplored else explore(material),
    }  # fmt: skip
    context = _context(material) | {"explore_reason": unexplored} | _stills(material, charts, surface)
    figures = [*figures_of(material.folder, STUDIES["profiles.json"])] if context["profiles"] else []
    return rendered("page.html.j2", scripts, images=bool(figures), **context, rig=rig, plane=surface,
                    profile_figures=figures, words_of=words_of, data=in_script(data))  # fmt: skip


# --- surfaces --------------------------------------------------------------------------------------


def _cost_surface(material: Material) -> Surface | None:
    """The rise of the cost over the orders above its least."""
    plane, orders = material.plane, material.result["orders"]
    if plane is None or not np.isfinite(plane.cost).any():
        return None
    fine, points = plane.refined(61), tried(material.folder, plane.names)
    height, scale, least = risen(fine.cost)
    best, ends, integers = ([orders[n].get(key) for n in plane.names] for key in ("value", "interval95", "integer"))
    names = [f"order {letter(n)}" for n in plane.names]
    return Surface(names, fine.first, fine.second, height, scale=scale, best=best, intervals=ends, integers=integers,
                   tried=points[:: max(1, -(-len(points) // TRIED))], keys=plane.names, least=least)  # fmt: skip


# --- charts ----------------------------------------------------------------------------------------


def _charts(material: Material) -> Iterator[tuple[str, Chart]]:
    """All that stand still, with their names: as recorded, and of the residuals."""
    for i, (name, r) in enumerate(material.fit.recordings.items()):
        yield from _numbered(f"whole-{i}", recorded_charts(material, material.as_recorded[name], r))
        for n, residual in material.residuals[name].items():
            yield from _numbered(f"residual-{i}-{n}", residual_charts(residual, material.unit(n)[1]))


def _numbered(name: str, charts: Iterator[Chart]) -> Iterator[tuple[str, Chart]]:
    return ((f"{name}-{k}", chart) for k, chart in enumerate(charts))


def _stills(material: Material, charts: Mapping[str, Chart], surface: Surface | None) -> dict[str, Any]:
    """Charts, fits, surfaces and the rig as SVG."""
    points = max(60, STILL_POINTS * STILL_RECORDINGS // max(STILL_RECORDINGS, len(material.fit.recordings)))
    stills = {n: still(c, 290 if n.startswith("residual-") else 760, points) for n, c in charts.items()}
    fits = {name: [*fit_charts(material, r)] for name, r in material.fit.recordings.items()}
    return {
        "charts": charts, "stills": stills, "rig_still": scene_still(material),
        "fit_stills": {name: [(c.title, still(c, 820, points, RIGHT if any(c.right for c in own) else 12.0))
                              for c in own] for name, own in fits.items()},
        "plane_still": surface_still(surface) if surface else "",
    }  # fmt: skip


# --- what the template says --------------------------------------------------------------------------


def _context(material: Material) -> dict[str, Any]:
    result, model, environment = material.result, material.model, material.beside("environment.json")
    rows, own = [*_parameters(material)], [*_per_recording(material)]
    driven = any(e.inputs.any() for e in (*material.problem.experiments, *material.project.validation))
    headline, *lines = verdict(material)
    who = identity(material.folder, result, environment)
    return {
        "material": material, "project": material.project, "result": result, "environment": environment,
        "run": who.name, "partial": who.partial, "runs_begin": RUNS_BEGIN, "runs_end": RUNS_END,
        "title": f"{'PARTIAL ' if who.partial else ''}{who.name}: {', '.join(who.facts)}",
        "meta": [model.name, of_recordings(list(result["recordings"])), *who.facts],
        "orders": orders_drawn(result["orders"]),
        "open_at_most": OPEN, "warnings_shown": WARNINGS,
        "headline": headline, "lines": lines,
        "warnings": [*getattr(material.fit, "notes", ()), *material.left_out,  # of a saved run, what differs from it
                     *(w for w in unsaid(result) if w.code not in BESIDE), *material.project.notes],
        "recordings": [_recording(material, name, f"whole-{k}") for k, name in enumerate(result["recordings"])],
        "equations": equations(model, result, driven), "latex": equations(model, result, driven, "LaTeX"),
        "no_rival": _no_rival(result),
        "rows": rows, "per_recording": own,
        "residuals": [(f"residual-{k}-{n}", a) for k, outputs in enumerate(material.residuals.values())
                      for n, a in outputs.items()],
        "ladder": _ladder(material.beside("compare.json"), result["data_sha256"]),
        "memory": _memory(result["memory"]),
        "command": shlex.join(["fracid", *environment["command"]]) if environment.get("command") else "",
        "profiles": material.beside("profiles.json"), "folder": _typed(material.folder, environment),
    }  # fmt: skip


def _no_rival(result: Mapping[str, Any]) -> str:
    """Why there is no integer-order rival."""
    if not (places := {where(e) for e in result["orders"].values() if e["free"]}):
        return SAYS("none-free")
    if places == {"without"}:
        return SAYS("no-integer-value")
    return SAYS("not-needed" if places <= {"inside", "without"} else "not-tried")


def _recording(material: Material, name: str, charts: str) -> dict[str, Any]:
    """What the page says of one recording."""
    recording = next(r for r in material.project.recordings if r.name == name)
    report = material.as_recorded[name].report
    verdict = re.sub(r"\d{4,}(?= samples)", lambda found: counted(int(found[0])), report.verdict)
    return {**material.result["recordings"][name], "name": name, "recording": recording, "report": report,
            "verdict": verdict, "begins": _begins(material, name), "charts": charts}  # fmt: skip


def _begins(material: Material, name: str) -> str:
    """That a fitted recording begins in motion, and what to type."""
    result = material.result
    if name not in in_motion(result):
        return ""
    release, start = material.as_recorded[name].report.release, result["recordings"][name]["from"]
    after = f", {number(start - release, '.2g')} s after its release" if release is not None and start > release else ""
    checked = result["cut"] is not None
    what = "Where the record begins, under Checks," if checked else typed("fit", material.project.path.name, "--cut")
    return SAYS("begins-in-motion", after=after, what=what)


def _parameters(material: Material) -> Iterator[dict[str, Any]]:
    """A row for each order and each constant that the recordings share."""
    model, result = material.model, material.result
    says = {p.name: p.description for p in model.parameters}
    says |= {n: f"order of the {_whose(model, n)}" for n in model.order_names}
    by_the_step = moved_by_the_step(result)
    for name, e in (*result["orders"].items(), *result["parameters"].items()):
        moved = by_the_step.get(name)
        step = "" if moved is None else f"half the step moves it by {number(moved, '.2g')}, more than its interval"
        yield {"name": name, "says": described(says.get(name, "")), **e, "moved": bool(step),
               "reason": "; ".join(filter(None, (step, e.get("reason")))) or _wide(e)}  # fmt: skip


def _wide(e: Mapping[str, Any]) -> str:
    """How wide the interval of an identifiable constant is, where that is more than half of its value."""
    half = half_width_of(e)
    if half is None or not e["value"] or e["identifiable"] != "identifiable" or "integer" in e or e["unit"] == "rad":
        return ""
    share = half / abs(e["value"])
    return f"its interval is ± {number(100 * share, '.2g')} % of its value" if share > WIDE else ""


def _whose(model: Any, order: str) -> str:
    outputs = [letter(n) for n, i in model.output_states.items() if model.orders[i] == order]
    return f"derivatives of {joined(outputs)}" if outputs else "states that have it"


def _per_recording(material: Material) -> Iterator[dict[str, Any]]:
    for recording, r in material.result["recordings"].items():
        for block, shown, suffix in (("parameters", letter, ""), ("initial_state", state_letter, " at the start")):
            for name, e in r[block].items():
                if e["free"]:
                    held_out = ", held out" * (r["use"] != "fit")
                    speed = ", its speed" * name.startswith("D^")
                    yield {"name": f"{shown(name)}{suffix}", "says": f"{recording}{held_out}{speed}", **e}


def _memory(text: str) -> str:
    """``compressed to 10⁻¹⁰`` for ``compressed(1e-10)``."""
    kind, _, tolerance = text.rstrip(")").partition("(")
    return f"{kind} to {number(float(tolerance))}" if kind == "compressed" and tolerance else text


def _ladder(compared: dict[str, Any], fitted: Mapping[str, str]) -> dict[str, Any] | None:
    """The table of ``fracid compare``, and which of its recordings are not those of the fit."""
    if "structures" not in compared:
        return None
    hashes = compared.get("data_sha256", {})
    return ladder_of(compared) | {"others": [n for n, sha256 in hashes.items() if fitted.get(n, sha256) != sha256]}


def _typed(folder: Path, environment: Mapping[str, Any]) -> str:
    """The run folder as the commands of this run would name it."""
    here, there = folder.resolve(), Path(environment.get("directory", ""))
    return shlex.quote(str(here.relative_to(there)) if here.is_relative_to(there) else here.name)
