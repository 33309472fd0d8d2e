"""What each stage of a fit costs:  make bench;  python benchmarks/stages.py --write puts the table into docs/scale.md

Processor time of a second, warm fit, one thread, without figures: of the demo's twin, and of the free release of
examples/srv02-release.toml, whose recordings come from FRACID_RECORDINGS or ../shared/recordings; without them it is
left out.  Beside it: how often the right-hand side alone could have gone over all the recordings, twice a step,
as a run with ``pi2`` does, at the states of the fit.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import fracid
from fracid.problem import Problem
from fracid.problem.project import Project
from fracid.solver.right_hand_side import compile_rhs
from fracid.tasks.progress import Observer
from solver import EVALUATIONS, bare  # beside this file

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "docs" / "scale.md"
RECORDINGS = Path(os.environ.get("FRACID_RECORDINGS", ROOT.parent / "shared" / "recordings"))
SMALL = 0.005
"""Seconds of a stage that is no row."""


def projects(folder: Path) -> dict[str, Project]:
    """What is fitted."""
    found = {"the demo's twin": fracid.load_project(Path(fracid.__file__).parent / "twins" / "reference-twin.toml")}
    releases = [*(RECORDINGS / "srv02-rotpen").glob("release_*.mat")]
    if releases:
        for file in (*releases, ROOT / "examples" / "srv02-release.toml"):
            shutil.copy(file, folder)
        found["the release of an SRV02"] = fracid.load_project(folder / "srv02-release.toml")
    return found


def stages(project: Project) -> tuple[dict[str, float], fracid.Fit]:
    """Stage → its processor time [s], in their order."""
    spent: dict[str, float] = {}
    last = ("", time.process_time())

    def begins(stage: str) -> None:
        nonlocal last
        before, began = last
        last = stage, time.process_time()
        spent[before] = spent.get(before, 0.0) + last[1] - began

    fit = fracid.identify(project, jobs=1, observer=Observer(stage=begins))
    begins("")
    del spent[""]
    return spent, fit


def bare_run(problem: Problem, x: np.ndarray) -> float:
    """Seconds of the right-hand side alone, over all recordings."""
    rhs, seconds = compile_rhs(problem.model.rhs), 0.0
    for e in problem.experiments:
        states = np.ascontiguousarray(problem.simulate(x, e).states)
        u, p = problem.simulator.inputs(x, e).before[0], problem.unpack(x, e)[1]
        times = []
        for _ in range(9):
            began = time.process_time()
            bare(rhs, states, u, p, EVALUATIONS["pi2"])
            times.append(time.process_time() - began)
        seconds += float(np.median(times))
    return seconds


def table(name: str, project: Project) -> str:
    """The rows of one fit."""
    stages(project)
    spent, fit = stages(project)
    unit, whole = bare_run(fit.problem, fit.x), sum(spent.values())
    rows = [*[(s, v) for s, v in spent.items() if v > SMALL], ("all", whole)]
    lines = [f"| {name}: {len(fit.problem.names)} free parameters | seconds | part | bare runs |", "|---|--:|--:|--:|"]
    return "\n".join([*lines, *(f"| {s} | {v:.2f} | {100 * v / whole:.0f} % | {v / unit:,.0f} |" for s, v in rows)])


def put(page: Path, name: str, shown: str) -> None:
    """With --write, what is shown between the marks of this name in a page."""
    if "--write" in sys.argv:
        marks = rf"(<!-- {name}: begin -->\n\n).*?(\n\n<!-- {name}: end -->)"
        text = page.read_text(encoding="utf-8")
        page.write_text(re.sub(marks, lambda m: m[1] + shown + m[2], text, flags=re.DOTALL), encoding="utf-8")


def main() -> None:
    """Print the tables; with --write put them into the page, too."""
    with tempfile.TemporaryDirectory() as folder:
        shown = "\n\n".join(table(*item) for item in projects(Path(folder)).items())
    print(shown)
    put(PAGE, "stages", shown)


if __name__ == "__main__":
    main()
