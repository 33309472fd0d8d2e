"""Is the result the same to the last bit?  By threads, processes, a killed run, kept compiled code, a processor.

    python benchmarks/reproducible.py            # prints the tables of docs/reproducible.md, three minutes when idle
    python benchmarks/reproducible.py --write    # also puts them there
    python benchmarks/reproducible.py fit        # the rows of one kind

Every row is a process of its own, ``fracid …`` as one types it, and its result is held against the first row's, value
by value.  Rows that must be the same to the last bit are asserted.  Another processor is imitated: Numba compiles for
the plainest of this kind, and NumPy and OpenBLAS are told to leave newer instructions alone; so sums round differently.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import fracid
from fracid.runs.reproduction import compared

PAGE = Path(__file__).parent.parent / "docs" / "reproducible.md"

PROJECT = """
[model]
rig = "srv02-rotpen"
[model.parameters]
b_alpha = { start = 2e-4, lower = 0.0, upper = 1e-2 }
[model.orders]
lambda = { start = 1.0, lower = 0.6, upper = 1.2 }
mu = { start = 1.0, lower = 0.6, upper = 1.2 }
[[recording]]
file = "one.csv"
theta = { column = "theta" , unit = "rad" }
alpha = { column = "alpha" , unit = "rad" }
[[recording]]
file = "two.csv"
theta = { column = "theta" , unit = "rad" }
alpha = { column = "alpha" , unit = "rad" }
use = "validate"
"""

OLD = {
    "NUMBA_CPU_NAME": "generic",
    "NUMBA_CPU_FEATURES": "",
    "NPY_DISABLE_CPU_FEATURES": "AVX2 FMA3 AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL AVX512_SPR",
    "OPENBLAS_CORETYPE": "Prescott",
}
"""A processor without AVX and fused multiplication."""


@dataclass(frozen=True)
class Row:
    """One way to run it."""

    what: str
    words: tuple[str, ...] = ()
    """Options beside those of the first row."""
    environment: dict[str, str] = field(default_factory=dict)
    prepare: Callable[[Path], object] = Path.exists
    """What is done to the folder of compiled code before."""
    bits: bool = True
    """Whether it must be the same to the last bit."""
    killed: bool = False
    """Whether it is killed on its way, and resumed."""
    beside: bool = False
    """Whether a second process does the same at the same time."""


def broken(cache: Path) -> None:
    """Spoil every file of compiled code, each elsewhere."""
    for place, path in enumerate(sorted(cache.rglob("*.nbc"))):
        content = path.read_bytes()
        path.write_bytes(content[: 997 * place] + b"broken" * 99 + content[997 * place + 594 :])


def unusable(cache: Path) -> None:
    """Put a file where the folder would be."""
    cache.parent.mkdir(parents=True, exist_ok=True)
    cache.touch()


JOBS = tuple(Row(f"--jobs {n}", ("--jobs", str(n))) for n in (1, 2, 8))
BOTH = Row("compiled code: none, two processes make it at once", (), {"NUMBA_CACHE_DIR": "{new}/both"}, beside=True)
COLD = Row("compiled code: none, made on the way", environment={"NUMBA_CACHE_DIR": "{new}/cold"})
SPOILT = Row("compiled code: every file broken", environment={"NUMBA_CACHE_DIR": "{new}/cold"}, prepare=broken)

KINDS: dict[str, tuple[tuple[str, ...], str, tuple[Row, ...]]] = {
    "fit": (
        ("fit", "rig.toml"), "result.json",
        (
            *JOBS,
            Row("killed on its way, then fracid resume", killed=True),
            Row("linear algebra on 8 threads", environment={"OPENBLAS_NUM_THREADS": "8", "OMP_NUM_THREADS": "8"}),
            Row("texts hashed otherwise", environment={"PYTHONHASHSEED": "7"}),
            COLD, SPOILT, BOTH,
            Row("compiled code: its folder cannot be written", (), {"NUMBA_CACHE_DIR": "{new}/file"}, unusable),
            Row("another processor, imitated", environment=OLD, bits=False),
        ),
    ),
    "starts": (
        ("fit", "rig.toml", "--multi-start", "3", "--executor", "processes"), "result.json",
        (*JOBS, Row("another processor, imitated", environment=OLD, bits=False)),
    ),
    "noise": (
        ("noise", "rig.toml", "--levels", "0.1", "--counts", "4096", "--seeds", "4"), "noise.json",
        (
            *(Row(f"processes, {row.what}", ("--executor", "processes", *row.words)) for row in JOBS),
            *(Row(f"threads, {row.what}", ("--executor", "threads", *row.words)) for row in JOBS),
            Row("another processor, imitated", environment=OLD, bits=False),
        ),
    ),
}  # fmt: skip
"""Kind → command, its result, ways to run it."""


def recordings(folder: Path) -> None:
    """Two swings of 4 s at 200 Hz, of known orders, with noise."""
    rig = fracid.rotary_pendulum("srv02-rotpen")
    for name, start, seed in (("one", 0.6, 1), ("two", 0.3, 2)):
        run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": start}, step=5e-3, end=4.0)
        noise = 1e-3 * np.random.default_rng(seed).standard_normal((801, 2))
        table = np.column_stack([run.time, run.states[:, [0, 2]] + noise])
        np.savetxt(folder / f"{name}.csv", table, delimiter=",", header="time,theta,alpha", comments="")
    (folder / "rig.toml").write_text(PROJECT, encoding="utf-8")


def done(row: Row, command: tuple[str, ...], place: Path, out: Path) -> float:
    """Run a row in its process; gives its seconds."""
    own = {name: value.format(new=place) for name, value in row.environment.items()}
    environment = {**os.environ, **own}
    row.prepare(Path(own.get("NUMBA_CACHE_DIR", place / "none")))
    words = [sys.executable, "-m", "fracid", *command, "--out", str(out), *row.words]
    began = time.perf_counter()
    if row.killed:
        killed(words, environment, place, out)
        words = [sys.executable, "-m", "fracid", "resume", str(out)]
    typed = [[str(folder) if word == str(out) else word for word in words] for folder in outs(row, out)]
    started = [
        subprocess.Popen(each, cwd=place, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        for each in typed
    ]
    for process in started:
        _, said = process.communicate()
        if process.returncode:
            sys.exit(f"{row.what}: {said}")
    return time.perf_counter() - began


def outs(row: Row, out: Path) -> tuple[Path, ...]:
    """Where its processes write."""
    return (out, out.with_name(f"{out.name}-beside")) if row.beside else (out,)


def killed(words: list[str], environment: dict[str, str], place: Path, out: Path) -> None:
    """Begin it and kill it when some of it is simulated."""
    process = subprocess.Popen(words, cwd=place, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    memo = out / ".memo"
    while process.poll() is None and not (memo.exists() and memo.stat().st_size > 50_000):
        time.sleep(0.005)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not (out / "result.json").exists(), "it was done before it could be killed"


def measured(kind: str, place: Path) -> Iterator[tuple[Row, float, Any]]:
    """Each row with its seconds and how it compares with the first."""
    command, name, rows = KINDS[kind]
    first: dict[str, Any] = {}
    for number, row in enumerate(rows):
        out = place / f"{kind}-{number}"
        seconds = done(row, command, place, out)
        for folder in outs(row, out):
            result = json.loads((folder / name).read_text(encoding="utf-8"))
            first = first or result
            found = compared(first, result, {} if row.bits else {"the processor": ("this", "an older")})
            assert found.identical or not row.bits, f"{kind}, {row.what}: {found.verdict} {found.differences[:5]}"
        yield row, seconds, found


def table(kind: str, place: Path) -> str:
    """The rows of one kind, as the page has them."""
    command, name, _ = KINDS[kind]
    lines = [f"`fracid {' '.join(command)}`, `{name}`:", "", "| how it is run | against the first row |", "|---|---|"]
    for row, seconds, found in measured(kind, place):
        lines.append(f"| {row.what} | {said(found)} |")
        sys.stderr.write(f"{kind}: {row.what}: {said(found)}, {seconds:.1f} s\n")
    return "\n".join([*lines, ""])


def said(found: Any) -> str:
    """In a few words."""
    if found.identical:
        return f"the same, all {found.values} values to the last bit"
    return f"{len(found.differences)} of {found.values} values differ, {found.how_far}"


def main(words: list[str]) -> None:
    """Print the tables, and write them into the page if asked to."""
    kinds = [word for word in words if word in KINDS] or list(KINDS)
    with tempfile.TemporaryDirectory() as name:
        recordings(Path(name))
        text = "\n".join(table(kind, Path(name)) for kind in kinds)
    print(text)
    if "--write" in words:
        begin, end = "<!-- benchmarks/reproducible.py -->", "<!-- end -->"
        page = PAGE.read_text(encoding="utf-8")
        before, after = page.split(begin)[0], page.split(end)[1]
        PAGE.write_text(f"{before}{begin}\n{text}{end}{after}", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
