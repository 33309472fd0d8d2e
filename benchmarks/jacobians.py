"""A Jacobian of a real release, its runs one by one and eight in a loop:  make bench

At the minima of examples/srv02-release.toml and examples/srv02-presliding.toml, whose recordings come from
FRACID_RECORDINGS or ../shared/recordings; without them there is nothing to time.  Processor time of one thread, the
least of a dozen, both ways in turn.  It asserts that both give the same derivatives, to 1e-6 of the largest of each
unknown: runs that agree to 1e-12 are divided by steps of 1e-6.  With --write the table goes into docs/solver.md.
"""

from __future__ import annotations

import shutil
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from unittest import mock

import numpy as np
from stages import RECORDINGS, ROOT, put  # beside this file

import fracid
from fracid.estimation.derivatives import jacobian
from fracid.problem import Problem
from fracid.problem import problem as of_problem

PAGE = ROOT / "docs" / "solver.md"
MODELS = {"release": "friction of sliding", "presliding": "presliding in both joints"}
"""Example → what its row is called."""
TIMES = 12


def one_by_one(problem: Problem) -> Problem:
    """The same, however long its runs are."""
    with mock.patch.object(of_problem, "WORTH", np.inf):
        return replace(problem, together=False)


def seconds(problem: Problem, x: np.ndarray) -> tuple[float, np.ndarray]:
    """Processor time of a Jacobian by all unknowns, and the Jacobian."""
    began = time.process_time()
    (J,) = jacobian(problem, x, np.arange(len(x)))
    return time.process_time() - began, np.asarray(J)


def row(name: str, project: Path) -> str:
    """Of one example, at the minimum of its fit."""
    fit = fracid.identify(fracid.load_project(project), jobs=1)
    ways, x = (one_by_one(fit.problem), fit.problem), fit.x
    assert [way.abreast > 1 for way in ways] == [False, True]
    least, found = [np.inf, np.inf], [np.empty(0), np.empty(0)]
    for _ in range(TIMES):
        for k, way in enumerate(ways):
            taken, found[k] = seconds(way, x)
            least[k] = min(least[k], taken)
    size = np.abs(found[0]).max(axis=(0, 1))
    worst = float(np.max(np.abs(found[1] - found[0]).max(axis=(0, 1)) / np.where(size > 0, size, 1.0)))
    assert worst < 1e-6, worst
    print(f"{name}: {least[1] / least[0]:.2f} of the time, the largest difference {worst:.0e}")
    runs = f"{len(x)} free parameters, {MODELS[name]}, {2 * len(x) + 1} runs"
    return f"| {runs} | {1e3 * least[0]:.0f} ms | {1e3 * least[1]:.0f} ms |"


def main() -> None:
    """Print the table; with --write put it into the page, too."""
    releases = [*(RECORDINGS / "srv02-rotpen").glob("release_*.mat")]
    if not releases:
        print(f"No recordings of an SRV02 in {RECORDINGS}: there is no Jacobian to time.")
        return
    with tempfile.TemporaryDirectory() as folder:
        for file in releases:
            shutil.copy(file, folder)
        projects = {n: shutil.copy(ROOT / "examples" / f"srv02-{n}.toml", folder) for n in MODELS}
        rows = [row(n, Path(project)) for n, project in projects.items()]
    shown = "\n".join(["| a Jacobian by central differences | one by one | together |", "| --- | --: | --: |", *rows])
    print(shown)
    put(PAGE, "jacobians", shown)


if __name__ == "__main__":
    main()
