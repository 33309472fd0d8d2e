"""Print the tables of docs/relaxation.md: how materials that were held for long are predicted from a part of it.

    python benchmarks/materials.py                    # the creep of spruce, half a minute
    python benchmarks/materials.py DIR                # and VHB 4910, where DIR has its relax_2d0.csv to relax_5d0.csv

Each model is fitted to what a project fits, and judged on what it holds out: later times of the same recordings.  For
VHB 4910 it is also fitted to all stretches but one, and judged on all of that one.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

import fracid
from fracid.errors import Failure
from fracid.estimation.horizons import Watch, refined
from fracid.problem import Experiment, Problem
from fracid.problem.project import Project, project_from_text

REAL = Path(__file__).parent.parent / "examples" / "real"


def rms(problem: Problem, x: fracid.arrays.FloatArray, e: Experiment) -> float:
    """Of what is scored of the first output of a recording."""
    fitted = replace(problem, experiments=(e,), memo=None).fitted(x, e)
    return np.inf if isinstance(fitted, Failure) else float(np.sqrt(np.mean((e.measured - fitted)[e.scored, 0] ** 2)))


def best(problem: Problem) -> fracid.arrays.FloatArray:
    """The minimum."""
    return refined(problem, problem.start, Watch()).best.point


def row(name: str, problem: Problem, x: fracid.arrays.FloatArray, judged: tuple[Experiment, ...]) -> str:
    """Constants, the error of what was fitted, and of each that was not."""
    fitted = [rms(problem, x, e) for e in problem.experiments]
    errors = [rms(problem, x, e) for e in judged]
    numbers = [np.mean(fitted), *errors, *([np.mean(errors)] if len(errors) > 1 else [])]
    return f"| {name} | {len(problem.names)} | " + " | ".join(f"{1e3 * r:.0f}" for r in numbers) + " |"


def models(project: Project) -> dict[str, Problem]:
    """The project's own, and what its orders are held against."""
    return {"springpot": project.problem, **project.alternatives}


def vhb(folder: Path) -> Iterator[str]:
    """The first 180 s after each ramp, judged to 1800 s; and each stretch left out."""
    text = (REAL / "vhb4910" / "vhb4910.toml").read_text(encoding="utf-8")
    project = project_from_text(text, folder / "vhb4910.toml")
    yield "judged from 180 to 1800 s [mN]"
    for name, problem in models(project).items():
        yield row(name, problem, best(problem), project.validation)
    yield "each stretch left out, its first 180 s [mN]"
    for name, problem in models(project).items():
        folds = [(replace(problem, experiments=tuple(o for o in problem.experiments if o is not e), memo=None), e)
                 for e in problem.experiments]  # fmt: skip
        errors = [rms(fold, best(fold), e) for fold, e in folds]
        yield f"| {name} | " + " | ".join(f"{1e3 * r:.0f}" for r in (*errors, np.mean(errors))) + " |"


def spruce() -> Iterator[str]:
    """Each specimen: a quarter of its time under load, judged on the rest, in thousandths of its first compliance."""
    path = REAL / "spruce-creep" / "spruce.toml"
    text = path.read_text(encoding="utf-8")
    for file in sorted(path.parent.glob("creep_*.csv")):
        hours, compliance, _ = np.loadtxt(file, delimiter=",", skiprows=1).T
        on = int(np.argmax(np.diff(compliance))) + 1
        start, quarter = 3600 * hours[on] - 1, 3600 * (hours[on] + (hours[-1] - hours[on]) / 4)
        own = text.replace("creep_1-mLR2-10-21.csv", file.name).replace("1e4", repr(float(1 / compliance[on])))
        own = own.replace("121.0", repr(float(start))).replace("1.314e5", repr(float(quarter)))
        project = project_from_text(own, path)
        fit = fracid.identify(project)
        low, high = fit.orders["nu"].interval95 or (np.nan, np.nan)
        errors = [rms(p, best(p), project.validation[0]) for p in models(project).values()]
        yield (f"| {file.stem.removeprefix('creep_1-m')} | {len(project.problem.experiments[0].measured)} | "
               f"{fit.orders['nu'].value:.2f} ({low:.2f} … {high:.2f}) | {fit.claim} | "
               + " | ".join(f"{1e3 * r:.0f}" for r in errors) + " |")  # fmt: skip


if __name__ == "__main__":
    for line in (line for table in ((vhb(Path(a)) for a in sys.argv[1:]), (spruce(),)) for t in table for line in t):
        print(line, flush=True)
