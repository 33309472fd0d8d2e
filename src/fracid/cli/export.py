"""``fracid export RUN``: the result for MATLAB, C, JavaScript, spreadsheets and control design."""

from __future__ import annotations

import shlex
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from fracid.cli.app import How, assigned, command, say_next, warn
from fracid.tasks.display import shown

if TYPE_CHECKING:
    from rich.console import Console

    from fracid.export import Export


@command
def export(run: Path, how: How) -> None:
    """Write the identified model and its curves for other programs.

    matlab: results.mat, and model.m, which simulates the model in MATLAB and Octave without a toolbox.

    c: fracid_model.c and .h, one function a step in C99, without allocation, for real-time targets; with --precision
    single in floats.

    fmu: MODEL.fmu, a unit of co-simulation for Simulink, Modelica and others, by the interface FMI 2.0 or 3.0.

    mjcf, urdf: a rig of the library with integer orders as rigid bodies, for MuJoCo and for what reads URDF; what these
    lack is printed with the code of the reason.

    bam: joint.json, a servo's motor and friction as BAM, mjlab and Isaac Lab load them, with orders 1.

    observer: observer.c, an extended Kalman filter that estimates the states from the sensors, step by step.

    javascript: fracid_model.mjs, a module for browsers and Node that simulates the model with any orders and constants.

    toml: model.toml, the model as equations of a project file.

    csv: a table for each recording.

    json: the result with its curves.

    state-space: the model of integer order, operators as sums of lags: matrices, poles, and its linear models about
    hanging and upright.
    """
    from fracid.export import Options, export_run
    from fracid.runs.saved import load_run

    with shown("files"):
        slow = assigned("--slow", how.slow, "b_alpha=1e-6")
        options = how.taken(Options, platforms=how.platforms or (), slow=slow)
        bundle = export_run(load_run(run, trust=how.trust), how.out or run / "export", how.to or (), **options)
    how.answer({"files": [str(path) for path in bundle.files], "notes": list(bundle.notes)}, partial(_show, bundle))


def _show(bundle: Export, console: Console) -> None:
    from rich.markup import escape

    warn(console, *bundle.notes, mark="")
    for path in bundle.files:
        console.print(f"written  {escape(str(path))}", soft_wrap=True)
    if model := next((path for path in bundle.files if path.name == "model.m"), None):
        octave = f"cd {shlex.quote(str(model.parent))} && octave --eval '[t, x] = model(); plot(t, x)'"
        say_next(console, (octave, "or in MATLAB: [t, x] = model();"))
