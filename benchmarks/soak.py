"""A thousand fits in one process: does it grow in memory, in open files or in threads?

    python benchmarks/soak.py                # 1,000 fits; some ten minutes on an idle machine
    python benchmarks/soak.py --fits 60      # what the tests run
    python benchmarks/soak.py --write        # also puts its table into docs/scale.md

The fits are small, and of all kinds, one after the other (:data:`KINDS`): built-in and own models and costs from files
that are read anew each time, all costs and memories, optimisers, fits that fail, reports.  Every so many fits, after a
collection of garbage, it notes memory, open files and threads.  After the warm-up, in which everything is compiled
and the caches fill, a line through the memory must rise by less than :data:`GROWTH` for a thousand fits, and nothing
else may rise at all.  Two fits of one kind give the same result to the bit, so nothing of a fit is left to the next.
"""

from __future__ import annotations

import argparse
import gc
import json
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import psutil

import fracid
from fracid.report import write_report
from fracid.runs.folder import FitOptions, inputs_of, open_run, write_result

GROWTH = 16.0
"""Megabytes for a thousand fits that are no growth: allocators keep pages, and give some back."""

WARM = 0.3
"""Part of the fits that is warm-up."""

PAGE = Path(__file__).parent.parent / "docs" / "scale.md"

OWN = """
import math
from fracid import Model, Parameter

GRAVITY = 39.0

def rhs(t, x, u, p, out):
    out[0] = x[1]
    out[1] = -GRAVITY * math.sin(x[0]) - p[0] * x[1]

model = Model(name="own", rhs=rhs, states=("alpha", "D^mu alpha"), orders=("mu", "mu"), outputs={"alpha": 0},
              inputs=(), parameters=(Parameter("b", "1/s", 0.3, "damping", 0.0),), zero="hanging", source="a soak")
"""

COST = """
import numpy as np

def mean_absolute(time, residual):
    return float(np.mean(np.abs(residual)))
"""

HEAD = '[model]\nname = "rotary-pendulum"\nrig = "srv02-rotpen"\n'
FREE = "[model.parameters]\nC1 = { start = 4.2e-3, lower = 1e-3, upper = 1e-2 }\n[model.orders]\nlambda = 1.0\n"
RECORDING = '[[recording]]\nfile = "swing.npz"\ntheta = { column = "theta" }\nalpha = { column = "alpha" }\n'


def project(head: str = HEAD + FREE, recording: str = RECORDING, **fit: object) -> str:
    """The text of a project file."""
    said = {"initial_state": "held", **fit}
    return f"{head}{recording}[fit]\n" + "".join(f"{key} = {json.dumps(value)}\n" for key, value in said.items())


KINDS: dict[str, str] = {
    "a rig": project(),
    "full memory": project(memory="full"),
    "short memory": project(memory="short(50)"),
    "a loose memory": project(tolerance=1e-6),
    "own model": project('[model]\nname = "own.py:model"\n', RECORDING.replace('theta = { column = "theta" }\n', "")),
    "own cost": project(cost="own_cost.py:mean_absolute", optimiser="nelder-mead"),
    "itae": project(cost="itae"),
    "huber": project(cost="huber", weights="noise"),
    "gl": project(method="gl"),
    "genetic": project(optimiser="genetic"),
    "evolution": project(optimiser="differential-evolution"),
    "four starts": project(starts=4),
    "its start is free": project(initial_state="estimate"),
    "every run fails": project(HEAD + FREE.replace("[model.orders]", "C3 = 0.1\n[model.orders]")),
    "a wrong zero": project(recording=RECORDING.replace('"alpha" }', '"alpha", zero = 3.14159 }')),
    "refused": project(memory="none"),
}
"""What is fitted in turn; the project file of each."""


def twin(folder: Path) -> None:
    """The recording that all of them fit: 2 s of a release, with a little noise."""
    rig = fracid.rotary_pendulum("srv02-rotpen")
    run = fracid.simulate(rig, orders={"lambda": 1.0, "mu": 0.95}, initial={"alpha": 0.4}, step=0.01, end=2.0)
    noise = 1e-3 * np.random.default_rng(1).standard_normal((len(run.time), 2))
    np.savez(
        folder / "swing.npz", time=run.time, theta=run.states[:, 0] + noise[:, 0], alpha=run.states[:, 2] + noise[:, 1]
    )
    (folder / "own.py").write_text(OWN)
    (folder / "own_cost.py").write_text(COST)


def fit(folder: Path, kind: str, number: int) -> float | None:
    """One fit with its run folder, every tenth with its report; the cost, None where it was refused."""
    path = folder / "rig.toml"
    path.write_text(KINDS[kind])
    try:
        loaded = fracid.load_project(path, trust=True)
    except fracid.InputError:
        return None
    options = {"generations": 3, "population": 8} if kind in ("genetic", "evolution") else {}
    with open_run(folder / "run", FitOptions(str(path)), inputs=inputs_of(loaded)) as run:
        found = fracid.identify(loaded, jobs=2, options=options)
        write_result(run.folder, found, loaded, {})
        if number % 10 == 0 and np.isfinite(found.cost):
            write_report(run.folder, found, loaded)
        run.finish()
    return found.cost


def soak(fits: int, tell: Callable[[str], None] = print) -> list[tuple[float, ...]]:
    """Fit, and note (fits, resident memory [MB], open files, threads) twenty times.

    Raises
    ------
    AssertionError
        If something grows, or a result depends on what was fitted before.
    """
    process, rows, costs = psutil.Process(), [], dict[str, float | None]()
    every, began = max(1, fits // 20), time.perf_counter()
    with tempfile.TemporaryDirectory() as where:
        folder = Path(where)
        twin(folder)
        for number in range(1, fits + 1):
            kind = [*KINDS][number % len(KINDS)]
            cost = fit(folder, kind, number)
            assert costs.setdefault(kind, cost) == cost, f"{kind}: {cost} after {number} fits, {costs[kind]} before"
            if number % every == 0:
                gc.collect()
                memory = process.memory_info().rss / 1e6
                rows.append((number, memory, process.num_fds(), process.num_threads()))
                tell(f"{number:6d} fits  {time.perf_counter() - began:7.1f} s  {memory:7.1f} MB  "
                     f"{rows[-1][2]:3d} files  {rows[-1][3]:3d} threads")  # fmt: skip
    hold(rows)
    return rows


def slope(rows: list[tuple[float, ...]]) -> float:
    """Megabytes for a thousand fits, after the warm-up; by Theil and Sen, which a jump does not bend."""
    warm = [r for r in rows if r[0] > WARM * rows[-1][0]]
    slopes = [(b[1] - a[1]) / (b[0] - a[0]) for i, a in enumerate(warm) for b in warm[i + 1 :]]
    return 1000 * float(np.median(slopes))


def hold(rows: list[tuple[float, ...]]) -> None:
    """Nothing grows after the warm-up; of memory a short run can only say that it is no leak per fit."""
    warm = [r for r in rows if r[0] > WARM * rows[-1][0]]
    limit = GROWTH * max(1.0, 1000 / rows[-1][0])
    assert slope(rows) < limit, f"memory grows by {slope(rows):.1f} MB in a thousand fits; {limit:.0f} are allowed"
    for column, what in ((2, "open files"), (3, "threads")):
        assert warm[-1][column] <= warm[0][column], f"{what} grow: {[r[column] for r in warm]}"


def table(rows: list[tuple[float, ...]]) -> str:
    """Five of the rows, as Markdown."""
    kept = [rows[round(k)] for k in np.linspace(0, len(rows) - 1, 5)]
    body = [f"| {n:,.0f} | {memory:.0f} MB | {files:.0f} | {threads:.0f} |" for n, memory, files, threads in kept]
    return "\n".join(["| fits | resident memory | open files | threads |", "| --: | --: | --: | --: |", *body])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--fits", type=int, default=1000)
    parser.add_argument("--write", action="store_true", help="put the table into docs/scale.md")
    asked = parser.parse_args()
    warnings.simplefilter("ignore")
    found = soak(asked.fits)
    print(f"\n{table(found)}\n\n{slope(found):+.1f} MB in a thousand fits, after the first {WARM * asked.fits:.0f}")
    if asked.write:
        import re

        page = PAGE.read_text(encoding="utf-8")
        marks = r"(<!-- soak: begin -->\n\n).*?(\n\n<!-- soak: end -->)"
        PAGE.write_text(re.sub(marks, lambda m: m[1] + table(found) + m[2], page, flags=re.DOTALL), encoding="utf-8")
