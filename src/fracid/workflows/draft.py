"""A commented project file for a recording, written and proved to load: ``fracid init``.

Of a rig that a voltage drives the constants begin where a linear regression at orders 1 has them, if the first swings
are simulated better from there: motors, gears and back-EMF differ by more than a search from another rig's bridges.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fracid.errors import InputError, refuse_unknown, typed, writing
from fracid.estimation.horizons import horizons
from fracid.models.base import ZEROS
from fracid.models.library import MODEL
from fracid.problem import Free, Problem
from fracid.problem.draft import BEGUN, COUPLING, MOTOR, Draft, draft_project
from fracid.problem.model_draft import draft_of_model
from fracid.problem.project import Project, project_from_text
from fracid.problem.roles import ROTARY, likely_models, model_of_columns, named_columns
from fracid.recording import inspect_recording
from fracid.recording.readers.table import read_table
from fracid.regression import start_values
from fracid.safety.door import write_whole


def write_draft(
    file: Path, target: Path, columns: Mapping[str, Mapping[str, Any]] | None, *, model: str | None = None,
    zero: str | None = None, more: Sequence[Path] = (), **options: Any,
) -> Draft:  # fmt: skip
    """Write a project file for a recording.

    Parameters
    ----------
    file, target : Path
        The recording, and the project file.
    columns : mapping or None
        Signal → its column; None for a guess.
    model : str, optional
        Of the library; found from what the columns are called if left out.
    zero : str, optional
        Of a model of the library with a pendulum.
    more : sequence of Path
        Further recordings of a model of the library, with the same columns.
    options
        Of :func:`fracid.draft_project`: ``time``, ``variable``, ``rig``.

    Raises
    ------
    InputError
        As of :func:`fracid.draft_project`, if the file cannot be written, or if something stands against its fit.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> _ = (folder / "swing.csv").write_text("".join(f"{0.01 * k},{0.3 - 1e-3 * k}\\n" for k in range(99)))
    >>> "[[recording]]" in write_draft(folder / "swing.csv", folder / "rig.toml", {"alpha": {"column": 1}}).text
    True
    """
    name = model or chosen_model([file, *more], columns, **options)
    refuse_unknown("model", (ROTARY, *MODEL), name)
    refuse_unknown("--zero", ZEROS[:2], *filter(None, [zero]))
    if name == ROTARY and zero:
        raise InputError(f"--zero is none of a {ROTARY}, whose motion shows it: leave it out.")
    if name != ROTARY:
        if (rig := options.pop("rig", None)) is not None:
            raise InputError(f"--rig {rig} is a rotary pendulum's; leave it out, or type --model {ROTARY}.")
        draft = draft_of_model(name, file, columns, zero=zero, folder=target.parent, more=more, **options)
        _written(draft, target)
        return replace(draft, notes=(f"The model is {name}; another: --model NAME.", *draft.notes))
    if more:
        raise InputError(f"A draft of a {ROTARY} is of one recording: type {typed('init', file)}, and add a "
                         "[[recording]] for each other to what it writes.")  # fmt: skip
    draft = draft_project(file, columns, folder=target.parent, **options)
    project = _written(draft, target)
    if MOTOR not in project.problem.names or (starts := _regressed(project.problem)) is None:
        return draft
    begun = draft_project(file, columns, folder=target.parent, starts=starts, **options)
    other = project_from_text(begun.text, target)
    first = min(horizons(project.problem), default=math.inf)
    costs = [p.until(FIRST * first).cost(p.until(FIRST * first).start) for p in (project.problem, other.problem)]
    if not costs[1] < costs[0]:
        return draft
    _written(begun, target)
    but = f", {COUPLING} but for its sign: alpha or theta may count the other way" * (starts.get(COUPLING, 0.0) < 0.0)
    return replace(begun, notes=(*begun.notes, f"The constants begin where a linear regression has them{but}."))


def chosen_model(files: Sequence[Path], columns: Mapping[str, Any] | None, **options: Any) -> str:
    """Return the model that the columns of recordings are of: those that are named, or with all others.

    Raises
    ------
    InputError
        If none fits, or several do as well.
    """
    if options.get("rig") is not None:
        return ROTARY
    raws = [inspect_recording(f, time=options.get("time"), variable=options.get("variable")) for f in files]
    names = dict.fromkeys(columns or ())
    if not (names and likely_models([*names])):  # the others say more
        for file, raw in zip(files, raws, strict=True):
            named = named_columns(read_table(file, options.get("variable")), raw.signals, columns or {})
            names |= {c: None for c in raw.signals if c not in named}
    return model_of_columns(shlex.join(f.name for f in files), [*names])


FIRST = 4
"""Swings on which two starts are compared."""

MANY = 200_000
"""Samples that a regression is asked for."""


def _written(draft: Draft, target: Path) -> Project:
    """Write it where it runs as it is; else say what stands against it, and write nothing."""
    project = project_from_text(draft.text, target)
    with writing(str(target), "Give another: --out FILE."):
        write_whole(target, draft.text)
    return project


def _regressed(problem: Problem) -> dict[str, float] | None:
    """Constants of a driven rig by regression at orders 1: motors and back-EMF differ by more than a search bridges."""
    if sum(e.samples for e in problem.experiments) > MANY:
        return None
    wide = {n: _wide(n, v) for n, v in problem.parameters.items() if isinstance(v, Free)}
    at_one = replace(problem, orders=dict.fromkeys(problem.orders, 1.0), parameters={**problem.parameters, **wide})
    try:
        x, _ = start_values(at_one)
    except (InputError, np.linalg.LinAlgError):
        return None
    starts = {n: float(v) for n, v in zip(at_one.names, x.tolist(), strict=True) if n in BEGUN}
    return starts if starts.get(MOTOR) and np.all(np.isfinite([*starts.values()])) else None


def _wide(name: str, free: Free) -> Free:
    """A range that no motor is beyond; on either side for its direction, and for the coupling of angles that differ in
    theirs."""
    far = 100 * max(abs(free.lower), abs(free.upper))
    return replace(free, lower=-far if name in (MOTOR, COUPLING) else 1e-2 * free.lower, upper=far)
