"""The page that opens a recording: it reads a file, guesses what it is, fits a model and writes the project.

Everything happens in the browser: the solver is :mod:`fracid.export.javascript`'s, each model of the library is written
to JavaScript, and the page's policy lets no request leave it.  What it finds is a preview, without interval and claim.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from fracid.errors import InputError, typed, writing
from fracid.export.javascript import program_of, solver
from fracid.models import MODELS, RIGS, Model, model
from fracid.models.library import table_of
from fracid.models.written.languages import JavaScript
from fracid.problem.model_draft import SPAN, states_with_unit
from fracid.problem.roles import ROTARY
from fracid.recording.channel import TABLES
from fracid.recording.readers.table import Table, read_table
from fracid.report.frame import rendered
from fracid.report.samples import base64_floats
from fracid.report.study import in_script
from fracid.safety.door import write_files
from fracid.units import letter, shown_unit

SCRIPTS = ("theme.js", "data.js", "uPlot.iife.min.js", "charts.js", "scene.js", "fitting.js", "reading.js",
           "drafting.js", "explore.js")  # fmt: skip

TOLERANCE = 1e-6
"""Of the memory of a preview."""

MOST = 500_000
"""Numbers of a table that a page holds: 5 MB of it."""


def write_open_page(file: str | Path | None = None, out: str | Path | None = None, variable: str | None = None) -> Path:
    """Write the page, with a recording in it or without one.

    Parameters
    ----------
    file : path, optional
        A recording of any format that fracid reads.
    out : path, optional
        ``runs/open/FILE.html`` if left out.
    variable : str, optional
        Which array of a .mat, .npz or HDF5 file.

    Raises
    ------
    InputError, DataError
        If the recording cannot be read, or the page cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> _ = (folder / "swing.csv").write_text("".join(f"{0.01 * k},{0.3 - 1e-3 * k}\\n" for k in range(99)))
    >>> write_open_page(folder / "swing.csv", folder / "swing.html").name
    'swing.html'
    """
    table = None if file is None else table_for_page(read_table(file, variable), Path(file).name, variable)
    path = Path(out) if out is not None else Path("runs", "open", f"{Path(file or 'recording').stem}.html")
    text = open_page_text(table)
    write_files(path.parent, {path.name: text}, writing(f"The page {path}", "Give another: --out FILE."))
    return path


def open_page_text(table: Mapping[str, Any] | None = None) -> str:
    """The page as HTML.

    Examples
    --------
    >>> "Preview: no interval, no claim" in open_page_text()
    True
    """
    found = {name: model(name) for name in (ROTARY, *(n for n in MODELS if n != ROTARY))}
    scripts = [Markup(solver()), *SCRIPTS, Markup("\n".join(_written(found))), "open.js"]
    data = {"models": {name: _spec(name, m) for name, m in found.items()}, "units": TABLES, "table": table}
    return rendered("open.html.j2", scripts, styles=("open.css",), title="Open a recording", data=in_script(data),
                    explore_reason="", preview=True)  # fmt: skip


def table_for_page(table: Table, name: str, variable: str | None = None) -> dict[str, Any]:
    """The table as the page takes it; of many rows every so many."""
    every = max(1, -(-table.values.size // MOST))
    values = table.values[::every]
    if len(values) < 2:
        raise InputError(f"{name}: {table.values.shape[1]} columns, too many for a page. Type {typed('init', name)}.")
    return {
        "name": name, "names": list(table.names), "units": list(table.units), "rows": len(values), "variable": variable,
        "columns": [base64_floats(column, "<f8") for column in values.T],
        "said": f"every {every} rows of {len(table.values)}" if every > 1 else "",
    }  # fmt: skip


def _written(models: Mapping[str, Model]) -> Iterator[str]:
    """Right-hand sides, outputs that are functions of the state, and scenes: each a function of the constants."""
    yield "const MODELS = {}, OUTPUTS = {}, SCENES = {};"
    for name, m in models.items():
        programs = {"MODELS": m.program}
        if any(not isinstance(h, int) for h in m.shown.values()):
            programs["OUTPUTS"] = m.outputs_program
        if m.scene is not None:
            programs["SCENES"] = m.scene.program
        for where, program in programs.items():
            yield JavaScript(program).text().replace("const model", f'{where}["{name}"]', 1)


def _spec(name: str, m: Model) -> dict[str, Any]:
    """What the page must know of a model."""
    table = table_of(name)
    scene, outputs = m.scene, {i: n for n, i in m.output_states.items()}
    units = {} if "without" in table else states_with_unit(table["model"])
    measured = {*m.output_states.values()}
    sought = measured | {m.rates[i] for i in measured & m.rates.keys()}  # what a fit estimates of the start
    return {
        "about": m.about,
        "zero": m.zero,
        "program": program_of(m, "pi2", TOLERANCE),
        "orders": [_order(m, q) for q in m.order_names],
        "inputs": [{"name": n, "unit": m.input_unit(n),
                    "value": m.input_defaults.get(n, 0.0), "rateOf": m.input_rates.get(n)} for n in m.inputs],
        "outputs": [_output(m, n, k) for k, n in enumerate(m.shown)],
        "initial": [{"state": i, "output": outputs.get(i), "unit": units.get(s)}
                    for i, s in enumerate(m.states) if i in sought or s in units],
        "parameters": list(_parameters(table, m)),
        "columns": table["columns"],
        "needs": table["needs"],
        "swings": m.pendulum or "",
        "without": table.get("without"),
        "rigs": [{"name": n, "title": rig.title, "parameters": rig.parameters} for n, rig in RIGS.items()]
        if "rigs" in table else None,
        "scene": scene and {"dimension": scene.dimension, "bodies": scene.bodies,
                            "outputs": list(scene.outputs), "movedBy": list(scene.moved_by)},
    }  # fmt: skip


def _order(m: Model, name: str) -> dict[str, Any]:
    low, start, high = (0.02, 0.5, 1.0) if name in m.springpot_orders.values() else (0.6, 1.0, 1.2)
    return {"name": name, "letter": letter(name), "low": low, "start": start, "high": high,
            "integer": m.integer_orders.get(name, 1.0)}  # fmt: skip


def _output(m: Model, name: str, place: int) -> dict[str, Any]:
    shown, factor = shown_unit(m.output_unit(name))
    return {"name": name, "letter": letter(name), "unit": m.output_unit(name), "shown": shown, "factor": factor,
            "state": m.output_states.get(name), "place": place}  # fmt: skip


def _parameters(table: Mapping[str, Any], m: Model) -> Iterator[dict[str, Any]]:
    """Each with where it is free: always, where the rig is driven or is not, or never."""
    for p in m.parameters:
        row, kind = table["model"]["parameters"][p.name], m.friction.get(p.name)
        if "free" in row:
            free = row["free"]
        elif row.get("known") or row.get("needs") or p.name.startswith(("springpot_order", "stribeck_speed")):
            free = "never"
        elif p.value == (0.0 if kind is None else kind.off):
            free = "always" if kind is not None and kind.dry and p.name.startswith("coulomb") else "never"
        else:
            free = "driven" if row.get("gauge") else "always"
        yield {
            "name": p.name, "unit": p.unit, "value": p.value, "about": p.description, "free": free,
            **{n: v for n, v in (("lower", p.lower), ("upper", p.upper)) if np.isfinite(v)},
            **dict(zip(("lowest", "highest"), row.get("between", ()), strict=False)),
            # About how large a constant is that the library has as 0.
            "size": abs(p.value) or (0.05 if p.name.endswith("_rest") else 1e-3),
            "span": table.get("span", SPAN), "rest": p.name in m.rests,
            "friction": kind is not None and not kind.signed, "signed": p.name == m.drive,
            "gauge": row.get("gauge", False),
        }  # fmt: skip
