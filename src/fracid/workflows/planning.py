"""The next experiments, of a run, a project or a rig, with their sheet: ``fracid design``, to be called from Python."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fracid.experiments.choice import design
from fracid.experiments.excitation import Multisine
from fracid.experiments.plan import Plan
from fracid.experiments.space import DesignSpace
from fracid.experiments.subject import driven, longest
from fracid.models import RIGS, Model, rotary_pendulum
from fracid.problem import Problem
from fracid.problem.project import Project
from fracid.report.index import write_study_page
from fracid.runs.saved import SavedRun
from fracid.tasks.display import unless_given
from fracid.tasks.job import one_blas_thread
from fracid.tasks.progress import Observer
from fracid.workflows.study import Finished, folder_of, run_or_project

MOST_SAMPLES = 20_000
"""Of a planned experiment whose rate nobody gave."""


@dataclass(frozen=True, repr=False)
class FinishedDesign(Finished):
    """A plan with its folder; its figures are all its files, which its result names too."""

    FILE, FOUND = "plan.json", "plan"

    plan: Plan


def run_design(
    source: str | Path,
    space: DesignSpace,
    *,
    swing: Sequence[float] = (),
    unsaid: Collection[str] = (),
    friction: bool = False,
    trust: bool = False,
    out: str | Path | None = None,
    observer: Observer | None = None,
    **asked: Any,
) -> FinishedDesign:
    """Choose the next experiments and write their sheet: what ``fracid design`` does.

    Parameters
    ----------
    source : str or Path
        A run folder, a project file, which is searched first, or a rig's name.
    space : DesignSpace
    swing : sequence of float
        Angles from which a pendulum is released, in place of those of `space` [°]; other models are not.
    unsaid : collection of str
        Of ``seconds``, ``rate`` and ``voltage`` those that are as in the longest recording, unless a pendulum swings: a
        multisine about that input's mean, or nearer to the middle of its range, within that range.
    friction : bool
        Of a rig alone: with the friction that was found on real recordings of it.
    trust, observer
        As of :func:`fracid.run`.
    out : str or Path, optional
        The folder; ``design`` in that of the run, ``runs/rig-design`` of ``rig.toml`` if left out.
    **asked
        What else :func:`fracid.design` takes: experiments, criterion, ``of``, against, orders, robust, seed, jobs.

    Raises
    ------
    InputError
        For what cannot be designed, and for a folder that cannot be written.
    NotTrusted
        If the project names code of its own, and `trust` is not given.

    Examples
    --------
    >>> run_design("nowhere/rig.toml", DesignSpace(release=90))
    Traceback (most recent call last):
    fracid.errors.InputError: There is no nowhere/rig.toml. ...
    """
    with one_blas_thread():
        known = _loaded(source, friction, trust)
        model = known if isinstance(known, Model) else known.problem.model
        if model.pendulum:
            space = replace(space, release=swing or space.release)
        elif not isinstance(known, Model):
            space = _as_recorded(space, known.problem, unsaid)
        plan = design(known, space, observer=unless_given(observer), **asked)
    folder = folder_of(out, Path(source), "design")
    files = (*plan.write(folder), write_study_page(folder, FinishedDesign.FILE))
    return FinishedDesign(folder, files, plan.to_json() | {"files": [str(path) for path in files]}, plan)


def _as_recorded(space: DesignSpace, problem: Problem, unsaid: Collection[str]) -> DesignSpace:
    """What is `unsaid` of the space as in the longest recording."""
    e, name = problem.experiments[longest(problem)].recording, driven(problem)
    seconds = float(e.time[-1])
    rate = min(1 / e.step, MOST_SAMPLES / seconds)
    known: dict[str, Any] = {"seconds": seconds, "rate": rate}
    u = e.inputs[:, problem.model.inputs.index(name)] if name else np.zeros(1)
    low, high = float(np.min(u)), float(np.max(u))
    if "voltage" in unsaid and (span := high - low):
        middle = float(np.clip(np.mean(u), low + span / 4, high - span / 4))
        around = round(middle, 1 - math.floor(math.log10(span)))
        space = replace(space, around=around)
        known["voltage"] = Multisine(2 / seconds, rate / 10, min(high - around, around - low))
    return replace(space, **{n: v for n, v in known.items() if n in unsaid})


def _loaded(source: str | Path, friction: bool, trust: bool) -> SavedRun | Project | Model:
    """A run, a project, or a rig."""
    if str(source) in RIGS and not Path(source).exists():
        return rotary_pendulum(str(source)).with_parameters(**(RIGS[str(source)].fitted_friction if friction else {}))
    return run_or_project(Path(source), trust)
