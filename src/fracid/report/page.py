"""A run as one HTML file: what :mod:`fracid.report` is about, put together."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Iterator, Mapping
from math import degrees, isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from fracid.errors import unwritable
from fracid.files import json_number, write_text
from fracid.report.equations import equations, named
from fracid.report.material import Material
from fracid.report.rig import rig_lengths
from fracid.report.sentences import digits, half_width, joined, letter, number, unit
from fracid.report.traces import traces
from fracid.report.verdict import verdict
from fracid.safety.text import printable

if TYPE_CHECKING:
    from fracid.estimation.cost_plane import CostPlane
    from fracid.fit import Fit
    from fracid.problem.project import Project
    from fracid.validation.residual_records import ResidualAnalysis

__all__ = ["REPORT", "report_page", "write_report"]

REPORT = "report.html"

OPEN = 6
"""Recordings, and residuals, that are shown without being asked for."""

STYLES = ("uPlot.min.css", "page.css")

SCRIPTS = ("uPlot.iife.min.js", "charts.js", "planes.js", "rig.js", "page.js")
"""In this order, into one element each."""


def write_report(
    folder: str | Path,
    fit: Fit | None = None,
    project: Project | None = None,
    *,
    plane: CostPlane | None = None,
    jobs: int = 1,
    out: str | Path | None = None,
    trust: bool = False,
) -> Path:
    """Write the report of a run: one HTML file that opens offline.

    Parameters
    ----------
    folder : str or Path
        Of the run, with its result.json.  ``profiles.json`` and ``compare.json`` are shown where they are there.
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
    path = folder / REPORT if out is None else Path(out)
    text = report_page(_material(folder, fit, project, plane, jobs, trust))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, text)
    except OSError as error:
        raise unwritable(f"The report {path}", error, "Give another: --out FILE.") from None
    return path


def _material(
    folder: Path, fit: Fit | None, project: Project | None, plane: CostPlane | None, jobs: int, trust: bool
) -> Material:
    from fracid.runs.saved import load_run

    if fit is not None and project is not None:
        problem, x, cost = fit.problem, fit.x, fit.cost
        plane = plane or _plane(problem, x, cost, jobs)
        return Material.of_fit(folder, fit, project, plane)
    run = load_run(folder, trust=trust)
    cost = run.result["cost"]["value"]
    return Material.of_run(run, plane or _plane(run.problem, run.x, np.inf if cost is None else cost, jobs))


def _plane(problem: Any, x: Any, cost: float, jobs: int) -> CostPlane | None:
    from fracid.estimation.cost_plane import cost_plane

    return cost_plane(problem, x, jobs=jobs) if len(problem.order_indices) >= 2 and isfinite(cost) else None


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
    from jinja2 import Environment, PackageLoader, StrictUndefined

    jinja = Environment(
        loader=PackageLoader("fracid.report", "."), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True, finalize=_seen,
    )  # fmt: skip
    jinja.filters |= {"number": number, "digits": digits, "half": half_width, "unit": unit, "letter": letter,
                      "joined": joined}  # fmt: skip
    styles, scripts = ([Markup(_own(name)) for name in names] for names in (STYLES, SCRIPTS))
    template = jinja.get_template("page.html.j2")
    return template.render(
        **_context(material), styles=styles, scripts=scripts, policy=_policy(styles, scripts), data=_data(material)
    )


def _seen(value: Any) -> Any:
    """A text of a run's without what cannot be seen: it could turn the direction of what stands beside it."""
    return printable(value) if isinstance(value, str) and not isinstance(value, Markup) else value


def _own(name: str) -> str:
    """A file beside this one, as it stands between a tag and its end."""
    return "\n" + (Path(__file__).parent / name).read_text(encoding="utf-8").strip() + "\n"


def _policy(styles: list[Markup], scripts: list[Markup]) -> str:
    """Content-Security-Policy: these styles and scripts, by their hashes, and nothing from anywhere."""

    def hashes(texts: list[Markup]) -> str:
        return " ".join(f"'sha256-{base64.b64encode(hashlib.sha256(t.encode()).digest()).decode()}'" for t in texts)

    allowed = f"style-src {hashes(styles)}; script-src {hashes(scripts)}"
    return f"default-src 'none'; {allowed}; base-uri 'none'; form-action 'none'"


# --- data for the scripts --------------------------------------------------------------------------


def _data(material: Material) -> Markup:
    """JSON that cannot leave its element: ``<`` is written as an escape, and NaN as null."""
    content = {
        "recordings": traces(material),
        "rig": _rig(material),
        "plane": _plane_data(material),
        "profiles": _profiles(material),
    }
    text = json.dumps(_plain(content), ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return Markup(text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029"))


def _plain(value: Any) -> Any:
    """The same for JSON: no NaN, no NumPy."""
    if isinstance(value, Mapping):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(v) for v in value]
    if isinstance(value, float | np.floating):
        return json_number(float(value))
    return value


def _rig(material: Material) -> dict[str, Any] | None:
    lengths = rig_lengths(material.project.problem.model, material.result["parameters"])
    model = material.project.problem.model
    if lengths is None or model.pendulum not in material.project.problem.outputs:
        return None
    rest, own = {}, model.angles[model.pendulum].rest
    shared = material.result["parameters"].get(own, {}).get("value") or 0.0
    for name, r in material.result["recordings"].items():
        rest[name] = degrees(r["parameters"].get(own, {}).get("value") or shared)
    return lengths | {"alphaRest": rest}


def _plane_data(material: Material) -> dict[str, Any] | None:
    plane = material.plane
    if plane is None or not np.isfinite(plane.cost).any():
        return None
    orders = material.result["orders"]
    best = [orders[n]["value"] for n in plane.names]
    return {
        "names": [letter(n) for n in plane.names],
        "first": plane.first,
        "second": plane.second,
        "cost": plane.cost,
        "best": best,
        "intervals": [orders[n]["interval95"] for n in plane.names],
        "tried": np.round(_thinned(material.tried), 5),
        "name": material.result["cost"]["name"],
    }


def _thinned(points: Any, most: int = 1500) -> Any:
    return points[:: max(1, -(-len(points) // most))]


def _profiles(material: Material) -> dict[str, Any] | None:
    """The profiles of ``fracid profile``, where it wrote them."""
    content = material.beside("profiles.json")
    if content is None or not content.get("profiles"):
        return None
    joint = content.get("joint")
    return {
        "threshold": content.get("threshold"),
        "profiles": [
            {"name": letter(n), "unit": unit(p["unit"]), "values": p["values"], "rise": p["rise"], "best": p["value"],
             "interval95": p["interval95"], "wald95": p["wald95"]}
            for n, p in content["profiles"].items()
        ],
        "joint": joint and joint | {"names": [letter(n) for n in joint["names"]]},
    }  # fmt: skip


# --- what the template says --------------------------------------------------------------------------


def _context(material: Material) -> dict[str, Any]:
    result, project = material.result, material.project
    lines, off = verdict(material), _off(material)
    return {
        "title": f"{project.problem.model.name}: {_names(list(result['recordings']))}",
        "open_at_most": OPEN,
        "lines": lines,
        "warnings": [*material.notes, *material.left_out, *result["warnings"], *project.notes],
        "result": result,
        "outputs": project.problem.outputs,
        "recordings": [_recording(material, name) for name in result["recordings"]],
        "equations": equations(project.problem.model, result, _driven(material)),
        "no_rival": _no_rival(result),
        "own_model": project.problem.model.written is None,
        "time_scale": result["parameters"].get("time_scale", {}).get("value", 1.0),
        "free": [row for row in _parameters(material) if row["free"]],
        "fixed": [row for row in _parameters(material) if not row["free"] and row["name"] not in off],
        "off": [row for row in _parameters(material) if row["name"] in off],
        "per_recording": list(_per_recording(material)),
        "residuals": [_residual(material, a) for outputs in material.analyses.values() for a in outputs.values()],
        "shown": material.shown,
        "rig": _rig(material),
        "plane": _plane_data(material),
        "profiles": material.beside("profiles.json"),
        "ladder": _ladder(material.beside("compare.json"), result["data_sha256"]),
        "environment": material.beside("environment.json") or {},
        "project_text": project.text,
        "project_file": project.path.name,
        "command": _command(material.beside("environment.json") or {}),
    }  # fmt: skip


def _names(recordings: list[str]) -> str:
    return joined(recordings) if len(recordings) <= 3 else f"{len(recordings)} recordings"


def _no_rival(result: Mapping[str, Any]) -> str:
    """Why there is no integer-order rival."""
    free = [e for e in result["orders"].values() if e["free"]]
    if not free:
        return "None was tried: no order was free."
    integer = [e.get("integer", 1.0) for e in free]
    if all(v is None for v in integer):
        return "None was tried: the model gives its free orders no integer value (integer_orders)."
    if all(e["interval95"] and e["interval95"][0] <= v <= e["interval95"][1]
           for e, v in zip(free, integer, strict=True) if v is not None):  # fmt: skip
        value = number(integer[0]) if len(set(integer)) == 1 else "its integer value"
        return f"None was needed: {value} lies in the interval of every order."
    return "None was tried."


def _driven(material: Material) -> bool:
    return any(e.inputs.any() for e in (*material.project.problem.experiments, *material.project.validation))


def _recording(material: Material, name: str) -> dict[str, Any]:
    """What the page says of one recording."""
    recording = next(r for r in material.project.recordings if r.name == name)
    whole, result = material.as_recorded[name], material.result["recordings"][name]
    return {
        "name": name,
        "file": recording.path.name,
        "sha256": recording.sha256,
        "verdict": whole.report.verdict,
        "notes": whole.report.notes,
        "release": whole.report.release,
        "scores": [
            {"output": n, "letter": letter(n), "rmse": result["rmse"][n], "fit": result["fit_percent"][n],
             "shown": "–" if result["rmse"][n] is None else material.shown(n, result["rmse"][n], ".3g")}
            for n in material.project.problem.outputs
        ],
        **{k: result[k] for k in ("use", "from", "to", "samples", "cost")},
    }  # fmt: skip


def _parameters(material: Material) -> Iterator[dict[str, Any]]:
    """A row for each order and each constant that the recordings share."""
    model, result = material.project.problem.model, material.result
    says = {p.name: p.description for p in model.parameters}
    says |= {n: f"order of the {_whose(model, n)}" for n in model.order_names}
    rows = [*result["orders"].items(), *result["parameters"].items()]
    for name, e in rows:
        yield {"name": name, "says": says.get(name, ""), **e}


def _off(material: Material) -> list[str]:
    """Constants that were given and stand in no equation, of elements that are off."""
    model, constants = material.project.problem.model, material.result["parameters"]
    there = named(model, material.result, _driven(material))
    acts = {"time_scale"} if constants.get("time_scale", {}).get("value", 1.0) != 1.0 else set()
    return [n for n, e in constants.items() if n in model.parameter_names and not e["free"] and n not in there | acts]


def _whose(model: Any, order: str) -> str:
    outputs = [letter(n) for n, i in model.output_states.items() if model.orders[i] == order]
    return f"derivatives of {joined(outputs)}" if outputs else "states that have it"


def _per_recording(material: Material) -> Iterator[dict[str, Any]]:
    for recording, r in material.result["recordings"].items():
        for block, suffix in (("parameters", ""), ("initial_state", " at the start")):
            for name, e in r[block].items():
                if e["free"]:
                    shown = _state(name) if block == "initial_state" else letter(name)
                    yield {"name": f"{shown}{suffix}", "says": recording, **e}


def _state(name: str) -> str:
    """``D^lambda theta`` as D^λ θ, ``z_theta`` as z_θ."""
    return " ".join("_".join(f"D^{letter(w[2:])}" if w.startswith("D^") else letter(w) for w in word.split("_"))
                    for word in name.split())  # fmt: skip


def _residual(material: Material, a: ResidualAnalysis) -> dict[str, Any]:
    beginning = "the first " if a.samples + a.missing < material.recordings[a.recording].time.size else ""
    figures = {
        "rms": material.shown(a.output, a.level.rms, ".3g") if isfinite(a.level.rms) else "–",
        "in encoder steps": number(a.level.steps, ".2g"),
        "correlated over": f"{number(a.whiteness.correlation_time, '.2g')} s",
        "samples that count": f"{number(a.whiteness.effective_samples, '.0f')} of {beginning}{a.samples}",
        "correlation with the normal (PPCC)": number(a.normality.ppcc, ".3f"),
        "late to early": number(a.variance.late_to_early.ratio, ".2g"),
        "far to near": number(a.variance.far_to_near.ratio, ".2g"),
        "fast to slow": number(a.variance.fast_to_slow.ratio, ".2g"),
    }
    return {"recording": a.recording, "output": a.output, "letter": letter(a.output), "use": a.use,
            "sentences": a.sentences, "figures": figures, "tested": bool(a.whiteness.thinning)}  # fmt: skip


def _ladder(compared: dict[str, Any] | None, fitted: Mapping[str, str]) -> dict[str, Any] | None:
    """The table of ``fracid compare``: a row a structure, its errors by recording."""
    if compared is None or "structures" not in compared:
        return None
    first = compared["structures"][0]
    kinds = [("in_sample", "fitted"), ("held_out", "held out")]
    columns = [(kind, label, recording) for kind, label in kinds for recording in first[kind]]
    best = set(compared["best"].values())
    rows = [
        {
            **s,
            "best": s["name"] in best,
            "errors": [s[kind].get(recording) for kind, _, recording in columns],
        }
        for s in compared["structures"]
    ]
    hashes = compared.get("data_sha256", {})
    others = [name for name, sha256 in hashes.items() if fitted.get(name, sha256) != sha256]
    return {**compared, "columns": columns, "rows": rows, "others": others}


def _command(environment: Mapping[str, Any]) -> str:
    import shlex

    words = environment.get("command")
    return shlex.join(["fracid", *map(str, words)]) if isinstance(words, list) and words else ""
