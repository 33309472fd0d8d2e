"""What a repetition costs beside its own work: empty tasks on every executor, the journal, the memo, a real one.

    python benchmarks/executor.py            # prints the tables of docs/scale.md, half a minute on an idle machine
    python benchmarks/executor.py --write    # also puts them there

Processor time is counted beside the clock's: it says the same on a busy machine, and it is what a cluster charges for.
It asserts that all executors give the same result.
"""

from __future__ import annotations

import json
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from fracid.tasks.job import Task
from fracid.tasks.journal import Journal
from fracid.tasks.simulation_cache import Memo
from fracid.tasks.tasks import run_tasks

PAGE = Path(__file__).parent.parent / "docs" / "scale.md"

EMPTY = 4000
"""Tasks that do nothing."""

LINES = 20_000
"""Of the journal."""

RESULT = {
    "values": {f"unknown {i}": 1 / (3 + i) for i in range(6)},
    "intervals": {f"unknown {i}": [1 / (7 + i), 1 / (5 + i)] for i in range(6)},
    "cost": 0.0123456789, "evaluations": 120, "failure": "",
}  # fmt: skip
"""About what a repetition of a noise study gives."""


def nothing(seed: int) -> dict[str, Any]:
    """Give a result without work."""
    return RESULT | {"seed": seed}


# --- measuring -----------------------------------------------------------------------------------------


class Spent:
    """The clock's time and the processor's, of this process and of those that it waited for [s]."""

    def __init__(self) -> None:
        """Begin."""
        self._from = self._now()

    @staticmethod
    def _now() -> np.ndarray:
        own, others = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
        return np.array([time.perf_counter(), *(u.ru_utime + u.ru_stime for u in (own, others))])

    def each(self, count: int) -> tuple[float, float, float]:
        """Per task: clock, this process, the others."""
        return tuple(((self._now() - self._from) / count).tolist())


def table(headings: list[str], rows: list[list[str]]) -> str:
    """A Markdown table."""
    return "\n".join(f"| {' | '.join(row)} |" for row in [headings, ["---"] * len(headings), *rows])


def short(seconds: float) -> str:
    """Seconds as people say them."""
    for unit, size in (("s", 1.0), ("ms", 1e-3)):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds / 1e-6:.3g} µs"


@contextmanager
def cluster(workers: int) -> Iterator[tuple[str, list[int]]]:
    """A scheduler and workers, processes of their own on loopback; gives the address and their numbers."""
    folder = Path(tempfile.mkdtemp())
    where, started = folder / "scheduler.json", []

    def start(*command: str) -> None:
        environment = os.environ | {"PYTHONPATH": str(Path(__file__).parent)}
        started.append(subprocess.Popen([sys.executable, "-m", f"distributed.cli.dask_{command[0]}", *command[1:]],
                                        env=environment, stderr=subprocess.DEVNULL, cwd=folder))  # fmt: skip

    start("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(where))
    for _ in range(workers):
        start("worker", "--scheduler-file", str(where), "--nthreads", "1", "--no-nanny", "--no-dashboard")
    while not where.exists() or not where.stat().st_size:
        time.sleep(0.05)
    address = json.loads(where.read_text())["address"]
    run_tasks(nothing, [Task(f"{i}", (i,)) for i in range(8)], executor=address)  # all are up
    try:
        yield address, [process.pid for process in started]
    finally:
        for process in reversed(started):
            process.terminate()
            process.wait()


# --- the tables ----------------------------------------------------------------------------------------


def executors() -> str:
    """Empty tasks a second."""
    tasks = [Task(f"seed {i}", (i,)) for i in range(EMPTY)]
    rows, results = [], []

    def measure(name: str, executor: str, jobs: int, of_them: Callable[[], list[float]] = list) -> None:
        before, spent = of_them(), Spent()
        results.append(run_tasks(nothing, tasks, executor=executor, jobs=jobs))
        clock, own, others = spent.each(EMPTY)
        there = [(after - b) / EMPTY for after, b in zip(of_them(), before, strict=True)] or [0.0, others]
        times = [short(seconds) if seconds else "–" for seconds in (own, there[0], sum(there[1:]))]
        rows.append([name, f"{1 / clock:,.0f}", short(clock), *times])

    measure("threads, 1", "threads", 1)
    measure("threads, 2", "threads", 2)
    measure("processes, 2", "processes", 2)
    with cluster(2) as (address, numbers):
        measure("cluster, 2 workers", address, 1, lambda: [sum(psutil.Process(n).cpu_times()[:2]) for n in numbers])
    assert all(result == results[0] for result in results)
    headings = ["executor", "tasks a second", "clock, each", "processor: here", "scheduler", "workers, together"]
    return table(headings, rows)


def journal() -> str:
    """Lines a second, written and read."""
    path = Path(tempfile.mkdtemp()) / "journal.jsonl"
    with Journal(path, {"seeds": LINES}) as opened:
        spent = Spent()
        for i in range(LINES):
            opened.append(f"seed {i}", RESULT)
        clock, own, _ = spent.each(LINES)
    size = path.stat().st_size / LINES
    spent = Spent()
    with Journal(path, {"seeds": LINES}) as opened:
        assert len(opened.done) == LINES
    read, read_own, _ = spent.each(LINES)
    rows = [["append, kept when the process dies", f"{1 / clock:,.0f}", short(clock), short(own), f"{size:.0f}"],
            ["read again, on resuming", f"{1 / read:,.0f}", short(read), short(read_own), f"{size:.0f}"]]  # fmt: skip
    return table(["journal", "lines a second", "clock, each", "processor, each", "bytes a line"], rows)


def memo() -> str:
    """What a fit pays for being able to be killed."""
    import fracid
    from fracid.problem import Experiment, Free, Problem

    rig = fracid.rotary_pendulum("srv02-rotpen")
    run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=2e-3, end=35.0)
    swing = Experiment("twin", 2e-3, run.states[:, [0, 2]], np.zeros((1, 1)))
    problem = Problem(rig, (swing,), {"lambda": Free(1.0, 0.5, 1.2), "mu": Free(1.0, 0.5, 1.2)})
    problem.cost(problem.start)
    rng, count = np.random.default_rng(1), 200
    points = problem.start + 1e-3 * rng.standard_normal((count, len(problem.start)))
    spent = Spent()
    outputs = [problem.fitted(x, swing) for x in points]
    simulated = spent.each(count)
    with Memo(Path(tempfile.mkdtemp()) / "memo") as kept:
        spent = Spent()
        for i, found in enumerate(outputs):
            kept.keep(i.to_bytes(16), found)
        written = spent.each(count)
        spent = Spent()
        for i in range(count):
            assert kept.find(i.to_bytes(16)) is not None
        read = spent.each(count)
    size = outputs[0].nbytes
    rows = [[name, short(clock), short(own), f"{100 * own / simulated[1]:.1f} %"] for name, (clock, own, _) in
            (("simulated", simulated), ("kept", written), ("read again", read))]  # fmt: skip
    return table([f"17,501 samples of 2 outputs, {size / 1e3:.0f} kB", "clock", "processor", "of a simulation"], rows)


def refuse() -> str:
    """There is nothing to compute."""
    raise AssertionError


def real() -> str:
    """Repetitions of a noise study on the demo's twin: 20 s at 1 kHz, two orders free."""
    import fracid
    from fracid.estimation.search import search
    from fracid.optimise import OPTIMISERS
    from fracid.problem.project import load_project
    from fracid.validation.monte_carlo import noise_study

    project = load_project(Path(fracid.__file__).parent / "twins" / "reference-twin.toml")
    problem = project.problem
    found, _ = search(problem, OPTIMISERS["multistart"], np.random.default_rng(1))
    rows = []
    for name, optimiser, count in (("least squares", "multistart", 6), ("the paper's genetic algorithm", "genetic", 2)):
        spent = Spent()
        noise_study(problem, found.best.point, levels=[1e-3], resolutions=[2 * np.pi / 4096], seeds=count,
                    optimiser=optimiser)  # fmt: skip
        clock, own, _ = spent.each(count)
        rows.append([name, short(clock), short(own)])
    return table(["repetition: simulate, add noise, identify, intervals", "clock", "processor"], rows)


TABLES: dict[str, Callable[[], str]] = {"executors": executors, "journal": journal, "memo": memo, "real": real}
"""Name on the page → what measures it."""


def write(name: str, text: str) -> None:
    """Put a table into its place on the page."""
    page, place = PAGE.read_text(), re.compile(rf"(<!-- {name}: begin -->\n).*?(<!-- {name}: end -->)", re.DOTALL)
    assert place.search(page), f"{PAGE.name} has no place for {name}"
    PAGE.write_text(place.sub(lambda found: f"{found[1]}\n{text}\n\n{found[2]}", page))


if __name__ == "__main__":
    print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f}\n")
    for name, measure in TABLES.items():
        text = measure()
        print(f"{text}\n", flush=True)
        if "--write" in sys.argv:
            write(name, text)
