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

The inputs are run in child processes that hold to these limits (:func:`fuzz`, of run folders and trees too); one that
dies is replaced, and the input that killed it is told.  Counts and failures are kept in ``runs/fuzz/READER.json``,
beside a digest of the readers' source: when that changes counting begins anew, and the old counts are kept as a total.
"""

from __future__ import annotations

import argparse
import faulthandler
import hashlib
import json
import math
import os
import resource
import signal
import sys
import tempfile
import time
import traceback
import unicodedata
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TextIO
from unittest import mock

sys.path.insert(0, str(Path(__file__).parent))
from corpus import SEEDS, swings
from fuzz_inputs import PACKAGED, READERS, input_of
from logs import answer_here

__all__ = [
    "Ended", "Limits", "counts", "fault_of_message", "fuzz", "fuzz_reader", "judge", "kept", "options", "read",
    "say_and_exit", "where",
]  # fmt: skip

ROOT = Path(__file__).parents[2]
SHARED = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
"""A folder in memory, where there is one."""
SECONDS = 5.0
"""Of processor time, for one input."""
MEMORY = 1 << 30
"""Beyond the idle process's [bytes]; asking for four times as much, without touching it, is refused by the system."""
HANGS = 600
"""Seconds without an end after which a process that takes no processor time hangs."""
STEPS = 25
"""Evaluations after which a search has taken its first steps."""
WHOLE_FITS = 40
"""One input in so many is fitted to the end."""
LONGER = 24.0
"""So many times as long such a one may take."""
BATCH = 300.0
"""Seconds after which counts are kept."""
LONGEST = 700
"""Of a message [characters]."""

Judge = Callable[[int], str]
"""Runs the input of that number and says how it ended; what went wrong stands after an exclamation mark."""
Ended = tuple[Counter[str], dict[int, str]]
"""How often inputs ended each way, and what went wrong in which."""


# --- one input of a reader ------------------------------------------------------------------------------


def judge(reader: str, folder: Path, number: int) -> str:
    """Read one input; return ``taken``, the name of fracid's error, or what went wrong after an exclamation mark."""
    from fracid.errors import FracidError

    file = laid_out(reader, folder, number)
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        try:
            read(reader, number, file)
        except FracidError as error:
            outcome = fault_of_message(str(error)) or type(error).__name__
        except (Exception, RecursionError) as error:
            outcome = f"! {type(error).__name__}: {error} {where(error)}"
        else:
            outcome = "taken"
    return f"! warning: {heard[0].message}" if heard and reader not in PACKAGED else outcome


def laid_out(reader: str, folder: Path, number: int) -> Path:
    """The file of an input, beside the recording that projects name."""
    ending, raw = input_of(reader, number)
    (folder / "swing.csv").write_bytes(swings() if reader == "search" else input_of("text", 0)[1])
    file = folder / f"input{ending}"
    file.write_bytes(raw)
    return file


def read(reader: str, number: int, file: Path) -> None:
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


def fault_of_message(message: str) -> str | None:
    """Return what is wrong with a message, None if it is one printable line that a person can read."""
    if any(unicodedata.category(c) in ("Cc", "Cf", "Zl", "Zp", "Cs") for c in message):
        return f"! message is not one printable line: {message[:200]!r}"
    if len(message) > LONGEST:
        return f"! message of {len(message)} characters: {message[:100]}"
    if "more memory than there is" in message:
        return f"! too much memory: {message[:100]}"
    return None


def where(error: BaseException) -> str:
    """The last lines of fracid's that an exception went through."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = [f"{Path(f.filename).name}:{f.lineno}" for f in frames if "fracid" in f.filename]
    return "at " + " ".join(ours[-3:])


# --- many inputs, in processes that may die -------------------------------------------------------------


@dataclass(frozen=True)
class Limits:
    """What an input may do."""

    seconds: Callable[[int], float]
    """Number → processor time [s]."""
    space: int | None = None
    """Address space beyond the idle process's [bytes]; None for any."""
    apart: bool = False
    """Each in a process of its own, and not one after the other until one dies."""
    stopped: str = ""
    """What the death of the process is called, where it is no failure."""


def fuzz(numbers: range, judge: Judge, limits: Limits, seconds: float = math.inf) -> Ended:
    """Run inputs until they or the time [s] are used up; return how they ended."""
    ended, failures = Counter[str](), dict[int, str]()
    number, end = numbers.start, time.monotonic() + seconds
    while number < numbers.stop and time.monotonic() < end:
        some = range(number, number + 1 if limits.apart else numbers.stop)
        with closing(_outcomes(some, judge, limits)) as outcomes:
            for outcome in outcomes:
                ended["failed" if outcome.startswith("!") else outcome] += 1
                if outcome.startswith("!"):
                    failures[number] = outcome[2:400]
                number += 1
                if time.monotonic() > end:
                    break
    return ended, failures


def _outcomes(numbers: range, judge: Judge, limits: Limits) -> Iterator[str]:
    """How inputs end, one after the other in a process of its own: to that of which it dies, if it does."""
    end, pipe = os.pipe()
    if (pid := os.fork()) == 0:
        code = 1
        try:
            with os.fdopen(pipe, "w") as said:
                _child(numbers, judge, limits, said)
            code = 0
        finally:
            os._exit(code)
    os.close(pipe)
    number = numbers.start
    try:
        with os.fdopen(end) as lines:
            for line in lines:
                yield json.loads(line)
                number += 1
    except GeneratorExit:
        os.kill(pid, signal.SIGKILL)
        raise
    finally:
        _, status = os.waitpid(pid, 0)
    if status:
        code = os.waitstatus_to_exitcode(status)
        death = f"died by {signal.Signals(-code).name}" if code < 0 else f"exit {code}"
        late = f"more than {limits.seconds(number):g} s of processor time"
        yield limits.stopped or f"! {late if code == -signal.SIGPROF else death}"


def _child(numbers: range, judge: Judge, limits: Limits, said: TextIO) -> None:
    """Run inputs within limits, and tell of each; one that takes too much memory is the last, for its peak stays."""
    if limits.space is not None:
        mapped = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (mapped + limits.space,) * 2)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    faulthandler.disable()  # who waits for it tells of its death
    signal.signal(signal.SIGPROF, signal.SIG_DFL)
    idle = _peak()
    for number in numbers:
        signal.alarm(HANGS)
        signal.setitimer(signal.ITIMER_PROF, limits.seconds(number))
        outcome = judge(number)
        signal.setitimer(signal.ITIMER_PROF, 0)
        if (used := _peak() - idle) > MEMORY:
            outcome = f"! used {used / 2**30:.2f} GiB"
        said.write(json.dumps(outcome) + "\n")
        said.flush()
        if used > MEMORY:
            return


def _peak() -> int:
    """The most memory that this process has had [bytes]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def options(about: str, inputs: int = 1_000_000, seconds: float = math.inf) -> argparse.Namespace:
    """What was typed of a command that runs inputs by their numbers."""
    parser = argparse.ArgumentParser(description=f"{about}; see the top of the file.")
    parser.add_argument("--inputs", type=int, default=inputs)
    parser.add_argument("--from", type=int, default=0, dest="first")
    parser.add_argument("--seconds", type=float, default=seconds)
    parser.add_argument("--again", type=int, metavar="NUMBER", help="one input once more")
    parser.add_argument("--good", type=Path, help="good runs, made there if there are none")
    asked = parser.parse_args()
    first, count = (asked.first, asked.inputs) if asked.again is None else (asked.again, 1)
    asked.numbers = range(first, first + count)
    return asked


def say_and_exit(ended: Counter[str], failures: dict[int, str]) -> None:
    """Print how the inputs ended; exit code 1 where anything went wrong."""
    print(f"{ended.total()} inputs: {', '.join(f'{k}: {n}' for k, n in sorted(ended.items()))}")
    for number, what in failures.items():
        print(f"{number}: {what}")
    sys.exit(1 if failures else 0)


# --- readers, and the counts that are kept of them ------------------------------------------------------


def fuzz_reader(reader: str, numbers: range, seconds: float, keep: Path | None = None) -> Ended:
    """Run inputs of a reader until they or the time [s] are used up; those that fail are kept in a folder."""
    with tempfile.TemporaryDirectory(dir=SHARED) as scratch:
        one = partial(judge, reader, Path(scratch))
        for number in range(2 if reader == "search" else len(SEEDS[reader]())):
            one(number)  # a good one, to import and compile
        packaged = reader in PACKAGED
        limits = Limits(partial(_limit, reader), MEMORY if packaged else 4 * MEMORY, stopped="stopped" * packaged)
        ended, failures = fuzz(numbers, one if packaged else partial(_silent, one), limits, seconds)
    for number in failures if keep else ():
        ending, raw = input_of(reader, number)
        keep.mkdir(parents=True, exist_ok=True)
        (keep / f"{reader}-{number}{ending}").write_bytes(raw)
    return ended, failures


def _silent(judge: Judge, number: int) -> str:
    """The same, but that a word on standard output or error is a failure."""
    said = os.memfd_create("said")
    before = {stream: os.dup(stream) for stream in (1, 2)}
    for stream in before:
        os.dup2(said, stream)
    try:
        outcome = judge(number)
    finally:
        for stream, file in ((1, sys.stdout), (2, sys.stderr)):
            file.flush()
            os.dup2(before[stream], stream)
            os.close(before[stream])
        words = os.pread(said, 200, 0)
        os.close(said)
    return f"! wrote: {words.decode('utf-8', 'replace')}" if words else outcome


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


def kept(reader: str, out: Path) -> dict[str, Any]:
    """What was run so far of a reader as it is now, and how much of earlier source."""
    file = out / f"{reader}.json"
    found = json.loads(file.read_text()) if file.exists() else {"next": 0, "before": 0}
    if found.get("source") != _digest(reader):
        found |= {"before": found["before"] + sum(found.get("outcomes", {}).values())}
        found |= {"source": _digest(reader), "outcomes": {}, "failures": {}, "seconds": 0.0}
    return found


def _go_on(reader: str, inputs: int, seconds: float, out: Path) -> None:
    """Run more inputs of a reader, until so many of the present source are done, and keep the counts."""
    found, end = kept(reader, out), time.monotonic() + seconds
    for number in [*found["failures"]]:  # what has been mended since, outside of the reader, no longer counts
        ended, failures = fuzz_reader(reader, range(int(number), int(number) + 1), 60)
        if not failures:
            del found["failures"][number]
            found["outcomes"] = dict(Counter(found["outcomes"]) - Counter(failed=1) + ended)
    _keep(reader, found, out)
    while (left := inputs - sum(found["outcomes"].values())) > 0 and (since := time.monotonic()) < end:
        some = range(found["next"], found["next"] + left)
        ended, failures = fuzz_reader(reader, some, min(end - since, BATCH), out / "failures")
        now = kept(reader, out)
        if now["source"] == found["source"]:  # else it changed under way: a child may have imported either
            now["outcomes"] = dict(Counter(now["outcomes"]) + ended)
            now["failures"] |= {str(number): what for number, what in failures.items()}
            now["seconds"] += time.monotonic() - since
        found = now | {"next": some.start + ended.total()}
        _keep(reader, found, out)


def _keep(reader: str, found: dict[str, Any], out: Path) -> None:
    out.mkdir(parents=True, exist_ok=True)
    (out / f"{reader}.tmp").write_text(json.dumps(found, indent=1))
    (out / f"{reader}.tmp").replace(out / f"{reader}.json")


def _print_table(out: Path, readers: list[str]) -> int:
    """Print what was run; return the number of failures."""
    print(
        f"{'reader':9} {'inputs':>9} {'taken':>9} {'refused':>9} {'failed':>7} {'inputs/s':>9} {'of older source':>16}"
    )
    failed = 0
    for reader in readers:
        found = kept(reader, out)
        n, taken, bad = counts(found)
        rate = n / found["seconds"] if found["seconds"] else 0.0
        print(f"{reader:9} {n:9} {taken:9} {n - taken - bad:9} {bad:7} {rate:9.0f} {found['before']:13}")
        failed += bad
        for number, what in [*found["failures"].items()][:10]:
            print(f"    {number}: {what[:160]}")
    return failed


def counts(found: dict[str, Any]) -> tuple[int, int, int]:
    """How many were run, taken, and went wrong."""
    outcomes = found["outcomes"]
    return sum(outcomes.values()), outcomes.get("taken", 0), outcomes.get("failed", 0)


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
        ending, raw = input_of(reader, number)
        print(f"{reader} {number}: {len(raw)} bytes, {ending}\n{raw[:400]!r}")
        print(judge(reader, Path(scratch), number))
        read(reader, number, laid_out(reader, Path(scratch), number))


if __name__ == "__main__":
    main()
