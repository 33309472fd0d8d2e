# ruff: noqa: T201  (a command: it prints)
"""Fuzzing of every reader, of the project file and of what follows it: hostile files in, a result or a sentence out.

::

    python tests/safety/fuzz.py                        all readers for ten minutes each, goes on where it stopped
    python tests/safety/fuzz.py mat text --inputs 1000000
    python tests/safety/fuzz.py --fresh --seconds 16   the same inputs each time, two minutes in all: make fuzz-ci
    python tests/safety/fuzz.py --table                what was run so far
    python tests/safety/fuzz.py --again mat 1234       one input once more, with its traceback

Each input (:mod:`fuzz_inputs` makes it from its number) is written to a file, in memory where there is such a folder,
and read.  It must end as a recording without gaps in its logic, or as a :class:`fracid.errors.FracidError` whose
message is one printable line.  Anything else is a failure:

* another exception, a warning, a word on standard output or error;
* more than 5 s of processor time, two minutes for a whole fit, or more than 1 GiB of memory beyond what the idle
  process has;
* the death of the process.

``search`` goes on from a project: the checks before a search, and its first steps, as ``fracid fit`` takes them; every
:data:`WHOLE_FITS`-th goes on to the end of :func:`fracid.identify`, as a file of JSON.

Formats that a package reads in a process of its own are read in the child, under the same limit of memory and a shorter
one of time: where fracid says that reading ended the process, or took too much, the child is ``stopped``, as it should.

The inputs are run in child processes that hold to these limits; one that dies is replaced, and the input that killed
it is told.  Counts and failures are kept in ``runs/fuzz/READER.json``, beside a digest of the readers' source:
when that changes counting begins anew, and the old counts are kept as a total.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import mmap
import os
import resource
import signal
import struct
import sys
import tempfile
import time
import traceback
import unicodedata
import warnings
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest import mock

sys.path.insert(0, str(Path(__file__).parent))
from fuzz_inputs import PACKAGED, READERS, answer_here, input_of, swings

__all__ = ["Tally", "fuzz", "judge", "say_and_exit", "tried"]

ROOT = Path(__file__).parents[2]
SECONDS = 5.0
"""Of processor time, for one input."""
MEMORY = 1 << 30
"""Beyond the idle process's [bytes]; asking for four times as much, without touching it, is refused by the system."""
STEPS = 25
"""Evaluations after which a search has taken its first steps."""
WHOLE_FITS = 40
"""One input in so many is fitted to the end."""
LONGER = 24.0
"""So many times as long such a one may take."""
BATCH = 300.0
"""Seconds after which counts are kept; a child needs some to import all that it reads with."""
LONGEST = 700
"""Of a message [characters]."""


# --- one input ------------------------------------------------------------------------------------------


def judge(reader: str, number: int, folder: Path) -> str:
    """Read one input; return ``taken``, the name of fracid's error, or what went wrong after an exclamation mark."""
    from fracid.errors import FracidError

    ending, raw = input_of(reader, number)
    file = folder / f"input{ending}"
    file.write_bytes(raw)
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        try:
            _read(reader, number, file)
        except FracidError as error:
            outcome = _fault_of(str(error)) or type(error).__name__
        except (Exception, RecursionError) as error:
            outcome = f"! {type(error).__name__}: {error} {_where(error)}"
        else:
            outcome = "taken"
    return f"! warning: {heard[0].message}" if heard and reader not in PACKAGED else outcome


def _read(reader: str, number: int, file: Path) -> None:
    """Read the file in one of the ways that a caller may."""
    from fracid.problem.project import project_from_text
    from fracid.recording import load_recording
    from fracid.recording.readers import packages as readers

    if reader in ("project", "search"):
        # what load_project does, but that all bytes are a text
        project = project_from_text(file.read_bytes().decode("utf-8", "replace"), file)
        if reader == "search":
            _search(project, whole=_is_whole(number))
        return
    ways: list[dict[str, Any]] = [
        {},
        {"resample": "needed"},
        {"columns": {"alpha": {"column": 1, "unit": "deg"}}, "time": 0},
        {"columns": {"alpha": "alpha"}, "time": {"rate": 100}},
    ]
    with mock.patch.object(readers, "answer_apart", answer_here):
        recording = load_recording(file, **ways[number // 3 % len(ways)])
    _assert_whole(recording)
    json.dumps(recording.report.to_dict(), allow_nan=False)
    assert recording.report.verdict.isprintable()


def _is_whole(number: int) -> bool:
    """Whether a search goes on to the end of a fit."""
    return number % WHOLE_FITS == WHOLE_FITS - 1


def _limit(reader: str, number: int) -> float:
    """Of processor time [s]."""
    return SECONDS * (LONGER if reader == "search" and _is_whole(number) else 1.0)


class _Enough(Exception):
    """A search has taken its first steps."""


def _search(project: Any, *, whole: bool) -> None:
    """What ``fracid fit`` does with a project, up to the first steps of its search; or all of it."""
    import numpy as np

    from fracid.estimation.horizons import Watch
    from fracid.estimation.search import search
    from fracid.identification import identify
    from fracid.optimise import optimiser_from_name
    from fracid.validation.before_search import before

    def stop(best: Any, evaluations: int) -> None:
        assert not np.isnan(best.cost)
        if evaluations >= STEPS:
            raise _Enough

    starts = min(project.starts, 3)
    if whole and project.optimiser in ("multistart", "least-squares"):
        fit = identify(project, starts=starts)
        json.dumps(fit.to_json(), allow_nan=False)
        return
    findings = before(project.problem, {r.name: r.report for r in project.recordings}, validation=project.validation)
    assert all(str(f).isprintable() for f in findings)
    with suppress(_Enough):
        optimiser = optimiser_from_name(project.optimiser)
        search(project.problem, optimiser, np.random.default_rng(1), starts=starts, watch=Watch(callback=stop))


def _assert_whole(recording: Any) -> None:
    import numpy as np

    assert recording.time.size >= 2
    assert np.isfinite(recording.time).all()
    assert (np.diff(recording.time) > 0).all()
    for signal_ in recording.signals.values():
        assert signal_.shape == recording.time.shape
        assert np.isfinite(signal_).all()


def _fault_of(message: str) -> str | None:
    """Return what is wrong with a message, None if it is one printable line that a person can read."""
    if any(unicodedata.category(c) in ("Cc", "Cf", "Zl", "Zp", "Cs") for c in message):
        return f"! message is not one printable line: {message[:200]!r}"
    if len(message) > LONGEST:
        return f"! message of {len(message)} characters: {message[:100]}"
    if "more memory than there is" in message:
        return f"! too much memory: {message[:100]}"
    return None


def _where(error: BaseException) -> str:
    frames = traceback.extract_tb(error.__traceback__)
    ours = [f"{Path(f.filename).name}:{f.lineno}" for f in frames if "fracid" in f.filename]
    return "at " + " ".join(ours[-3:])


def tried(
    numbers: range, judge: Callable[[int], str], seconds: float = math.inf
) -> tuple[Counter[str], dict[int, str]]:
    """How inputs end, until they or the time are used up: how often each way, and what went wrong in which."""
    ended, failures, end = Counter[str](), dict[int, str](), time.monotonic() + seconds
    for number in numbers:
        if time.monotonic() > end:
            break
        outcome = judge(number)
        ended["failed" if outcome.startswith("!") else outcome] += 1
        if outcome.startswith("!"):
            failures[number] = outcome[2:]
    return ended, failures


def say_and_exit(ended: Counter[str], failures: dict[int, str]) -> None:
    """Print how the inputs ended; exit code 1 where anything went wrong."""
    print(f"{sum(ended.values())} inputs: {', '.join(f'{k}: {n}' for k, n in sorted(ended.items()))}")
    for number, what in failures.items():
        print(f"{number}: {what}")
    sys.exit(1 if failures else 0)


# --- a child process that reads one after the other -----------------------------------------------------


def _child(reader: str, numbers: range, at: mmap.mmap, results: int, folder: Path) -> None:
    """Read the inputs, each announced in `at` before, and write counts to the pipe every now and then."""
    quiet = os.memfd_create("output")
    if os.environ.get("PYTEST_CURRENT_TEST") is None:
        os.dup2(quiet, 1)
        os.dup2(quiet, 2)
    for seed in range(12):
        judge(reader, seed, folder)  # imports, compiles
    mapped = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    most = mapped + (MEMORY if reader in PACKAGED else 4 * MEMORY)
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    idle = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    signal.signal(signal.SIGPROF, signal.SIG_DFL)
    tally, said, written = Tally(), 0, time.monotonic()
    with os.fdopen(results, "w") as pipe:
        for number in numbers:
            at[:8] = struct.pack("<q", number)
            signal.setitimer(signal.ITIMER_PROF, _limit(reader, number))
            outcome = judge(reader, number, folder)
            signal.setitimer(signal.ITIMER_PROF, 0)
            if (size := os.lseek(quiet, 0, os.SEEK_CUR)) > said and reader not in PACKAGED:
                outcome, said = f"! wrote: {os.pread(quiet, 200, said).decode('utf-8', 'replace')}", size
            used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 - idle
            if used > MEMORY:
                outcome = f"! used {used / 2**30:.2f} GiB"
            tally.add(number, outcome)
            if time.monotonic() - written > 1 or number == numbers[-1] or used > MEMORY:
                pipe.write(json.dumps(tally.__dict__ | {"next": number + 1}) + "\n")
                pipe.flush()
                tally, written = Tally(), time.monotonic()
            if used > MEMORY:
                return  # the peak of a process does not fall: the next child begins anew


@dataclass
class Tally:
    """What came of the inputs."""

    outcomes: dict[str, int] = field(default_factory=dict)
    failures: dict[str, str] = field(default_factory=dict)
    """Number to what went wrong; at most 500 are kept, all are counted."""

    def add(self, number: int, outcome: str) -> None:
        """Count one."""
        failed = outcome.startswith("!")
        kind = "failed" if failed else outcome
        self.outcomes[kind] = self.outcomes.get(kind, 0) + 1
        if failed and len(self.failures) < 500:
            self.failures[str(number)] = outcome[2:400]

    def join(self, outcomes: dict[str, int], failures: dict[str, str]) -> None:
        """Add another."""
        self.outcomes = dict(Counter(self.outcomes) + Counter(outcomes))
        self.failures = dict([*self.failures.items(), *failures.items()][:500])

    @property
    def inputs(self) -> int:
        """How many."""
        return sum(self.outcomes.values())


def fuzz(reader: str, numbers: range, seconds: float, keep: Path | None = None) -> tuple[Tally, int]:
    """Run inputs until they or the time are used up; return what came of them, and the first that was not run.

    Parameters
    ----------
    reader : str
        A key of ``READERS``.
    numbers : range
        Which inputs.
    seconds : float
        At most, of wall-clock time.
    keep : Path, optional
        Folder for inputs that fail.
    """
    tally, start, end = Tally(), numbers.start, time.monotonic() + seconds
    at = mmap.mmap(-1, 8)
    memory = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    with tempfile.TemporaryDirectory(dir=memory) as scratch:
        folder = Path(scratch)
        _lay_out(reader, folder)
        while start < numbers.stop and time.monotonic() < end:
            start = _one_child(reader, range(start, numbers.stop), end, at, folder, tally)
        for number in tally.failures if keep else ():
            ending, raw = input_of(reader, int(number))
            keep.mkdir(parents=True, exist_ok=True)
            (keep / f"{reader}-{number}{ending}").write_bytes(raw)
    return tally, start


def _lay_out(reader: str, folder: Path) -> None:
    """The recording that projects name."""
    (folder / "swing.csv").write_bytes(swings() if reader == "search" else READERS["text"][1]()[0])


def _one_child(reader: str, numbers: range, end: float, at: mmap.mmap, folder: Path, tally: Tally) -> int:
    """Run inputs in one child until it dies, is done or its time is up; return the next number."""
    at[:8] = struct.pack("<q", numbers.start)
    results, pipe = os.pipe()
    pid = os.fork()
    if pid == 0:
        code = 1
        try:
            os.close(results)
            _child(reader, numbers, at, pipe, folder)
            code = 0
        finally:
            os._exit(code)
    os.close(pipe)
    reached, killed = numbers.start, False
    with os.fdopen(results) as lines:
        for line in lines:
            said = json.loads(line)
            tally.join(said["outcomes"], said["failures"])
            reached = said["next"]
            if time.monotonic() > end and reached < numbers.stop:
                os.kill(pid, signal.SIGKILL)
                killed = True
                break
    _, status = os.waitpid(pid, 0)
    if status == 0 or killed:
        return reached
    number = struct.unpack("<q", at[:8])[0]
    died = signal.Signals(os.WTERMSIG(status)).name if os.WIFSIGNALED(status) else f"exit {os.WEXITSTATUS(status)}"
    # those between the last report and the death are run again by the next child, but for the last
    tally.add(
        number,
        "stopped"
        if reader in PACKAGED
        else f"! more than {_limit(reader, number):g} s of processor time"
        if died == "SIGPROF"
        else f"! died by {died}",
    )
    return _again_without(reader, range(reached, number), folder, tally, at, end, number)


def _again_without(
    reader: str, numbers: range, folder: Path, tally: Tally, at: mmap.mmap, end: float, last: int
) -> int:
    """Run what a dead child had not reported, and pass over the input that killed it."""
    start = numbers.start
    while start < numbers.stop:
        start = _one_child(reader, range(start, numbers.stop), end + 60, at, folder, tally)
    return last + 1


# --- the counts that are kept ---------------------------------------------------------------------------


SOURCES = {
    "text": ("text", "table"),
    "mat": ("matlab", "content", "arrays", "table"),
    "npy": ("numpy_files", "content", "arrays", "table"),
    "npz": ("numpy_files", "content", "arrays", "table"),
    "hdf5": ("hdf5", "content", "arrays", "table"),
    "parquet": ("parquet", "content", "arrays", "table"),
    **dict.fromkeys(PACKAGED, ("packages", "records", "content", "arrays", "table")),
    "json": ("records", "content", "arrays", "table"),
    "project": ("../../problem/project",),
    "search": ("../../problem/project", "../../problem/unknowns", "../../estimation/search"),
}
"""The modules that read; what comes after them, from channel to report, runs too, and changes without a new count."""


def _digest(reader: str) -> str:
    """Of the source that reads."""
    files = [ROOT / "src" / "fracid" / "recording" / "readers" / f"{name}.py" for name in SOURCES[reader]]
    return hashlib.sha256(b"".join(f.read_bytes() for f in files)).hexdigest()[:12]


def _kept(reader: str, out: Path) -> dict[str, Any]:
    file = out / f"{reader}.json"
    kept = json.loads(file.read_text()) if file.exists() else {"next": 0, "before": 0}
    if kept.get("source") != _digest(reader):
        kept |= {"before": kept["before"] + sum(kept.get("outcomes", {}).values())}
        kept |= {"source": _digest(reader), "outcomes": {}, "failures": {}, "seconds": 0.0}
    return kept


def _go_on(reader: str, inputs: int, seconds: float, out: Path) -> None:
    """Run more inputs of a reader, until so many of the present source are done, and keep the counts."""
    kept = _kept(reader, out)
    begun = time.monotonic()
    for number in list(kept["failures"]):  # what has been mended since, outside of the reader, no longer counts
        tally, _ = fuzz(reader, range(int(number), int(number) + 1), 60)
        if not tally.failures and tally.inputs:
            del kept["failures"][number]
            total = Counter(kept["outcomes"]) - Counter(failed=1) + Counter(tally.outcomes)
            kept["outcomes"] = dict(total)
    _keep(reader, kept, out)
    left = inputs - sum(kept["outcomes"].values())
    while left > 0 and (time_left := begun + seconds - time.monotonic()) > 0:
        since, source = time.monotonic(), kept["source"]
        tally, after = fuzz(reader, range(kept["next"], kept["next"] + left), min(time_left, BATCH), out / "failures")
        if _digest(reader) != source:  # changed under way: a child may have imported either
            kept = _kept(reader, out) | {"next": after}
            continue
        total = Tally(kept["outcomes"], kept["failures"])
        total.join(tally.outcomes, tally.failures)
        kept |= {"next": after, "outcomes": total.outcomes, "failures": total.failures}
        kept["seconds"] += time.monotonic() - since
        _keep(reader, kept, out)
        left = inputs - total.inputs


def _keep(reader: str, kept: dict[str, Any], out: Path) -> None:
    out.mkdir(parents=True, exist_ok=True)
    (out / f"{reader}.tmp").write_text(json.dumps(kept, indent=1))
    (out / f"{reader}.tmp").replace(out / f"{reader}.json")


def _print_table(out: Path, readers: list[str]) -> int:
    """Print what was run; return the number of failures."""
    print(
        f"{'reader':9} {'inputs':>9} {'taken':>9} {'refused':>9} {'failed':>7} {'inputs/s':>9} {'of older source':>16}"
    )
    failed = 0
    for reader in readers:
        kept = _kept(reader, out)
        outcomes = kept["outcomes"]
        n, taken, bad = sum(outcomes.values()), outcomes.get("taken", 0), outcomes.get("failed", 0)
        rate = n / kept["seconds"] if kept["seconds"] else 0.0
        print(f"{reader:9} {n:9} {taken:9} {n - taken - bad:9} {bad:7} {rate:9.0f} {kept['before']:13}")
        failed += bad
        for number, what in [*kept["failures"].items()][:10]:
            print(f"    {number}: {what[:160]}")
    return failed


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description="Fuzz the readers; see the top of the file.")
    parser.add_argument("readers", nargs="*", metavar="READER", help=f"of {' '.join(READERS)}; none for all")
    parser.add_argument("--inputs", type=int, default=1_000_000, help="of each reader, in all that was run so far")
    parser.add_argument("--seconds", type=float, default=600, help="at most, for each reader")
    parser.add_argument("--out", type=Path, default=ROOT / "runs" / "fuzz")
    parser.add_argument("--fresh", action="store_true", help="begin with the first input, and keep no counts")
    parser.add_argument("--table", action="store_true", help="print what was run so far")
    parser.add_argument("--again", nargs=2, metavar=("READER", "NUMBER"), help="run one input in this process")
    asked = parser.parse_args()
    if asked.again:
        _run_again(asked.again[0], int(asked.again[1]))
        return
    readers = asked.readers or list(READERS)
    if not set(readers) <= set(READERS):
        parser.error(f"readers are {' '.join(READERS)}")
    with tempfile.TemporaryDirectory() as fresh:
        out = Path(fresh) if asked.fresh else asked.out
        for reader in () if asked.table else readers:
            _go_on(reader, asked.inputs, asked.seconds, out)
        failed = _print_table(out, readers)
    sys.exit(1 if failed else 0)


def _run_again(reader: str, number: int) -> None:
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        _lay_out(reader, folder)
        ending, raw = input_of(reader, number)
        (folder / f"input{ending}").write_bytes(raw)
        print(f"{reader} {number}: {len(raw)} bytes, {ending}\n{raw[:400]!r}")
        print(judge(reader, number, folder))
        (folder / f"input{ending}").write_bytes(raw)
        _read(reader, number, folder / f"input{ending}")


if __name__ == "__main__":
    main()
