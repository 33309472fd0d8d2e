"""Fuzzing of folders of folders: anything at all, under the names that fracid looks for, given to every command.

::

    python tests/safety/fuzz_folders.py --inputs 10000            the first ten thousand
    python tests/safety/fuzz_folders.py --good FOLDER             with the files of good runs among them, made there
    python tests/safety/fuzz_folders.py --again 1234              one input once more

Input number n is a tree, one command and where it points to, all of which follow from n alone.  In the tree are files
of any content, empty ones, some of gigabytes without a byte on the disk, folders within each other, links to files and
folders within and without, to themselves and to nothing, pipes, sockets and devices.  The command must end with exit
code 0, 1, 2 or 3 within 10 s of processor time and 1 GiB, with a line that can be printed where it refuses; and no file
outside of the tree may be another one or new.
"""

from __future__ import annotations

import contextlib
import os
import random
import shutil
import socket
import sys
import tempfile
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from fracid.plots import writing
from fuzz import SHARED, Ended, Limits, options, say_and_exit
from fuzz import fuzz as run_all
from fuzz_runs import RAW, TEXTS, _called, _drawn, _spoil, fault_of, judge_imports, made

__all__ = ["fuzz", "judge", "planted"]

SECONDS = 10.0
"""Of processor time, for one input."""

NAMES = (
    "result.json", "run.json", "environment.json", "project.toml", "rig.toml", "report.html", "index.html", "figures",
    "compare.json", "noise.json", "posterior", "posterior.json", "profiles.json", "journal.jsonl", "evaluations.jsonl",
    "starts", "runs", "run", ".lock", ".memo", "swing.csv", "swing.mat", "swing.npz", "swing.h5", "swing.parquet", "a",
    "\udcff", "-rf", "x" * 255, "a\nb", "\x1b[2J", "my.py",
)  # fmt: skip

COMMANDS = (
    ("report",), ("report",), ("resid",), ("draw",), ("export",), ("resume",), ("reproduce",), ("simulate",),
    ("noise",), ("profile",), ("posterior",), ("fit", "--jobs", "1"), ("compare", "--jobs", "1"), ("check",), ("init",),
    ("regress",), ("design",),
)  # fmt: skip

PROJECT = '[[recording]]\nfile = "{}"\nalpha = {{ column = 1 }}\n'


def planted(number: int, scratch: Path, good: Path | None = None) -> list[str]:
    """Make the tree of input n under ``in``, and what lies beside it; gives the command."""
    choose = random.Random(number)
    root = scratch / "in"
    root.mkdir()
    places = [root]
    for _ in range(choose.choice((1, 3, 8, 20, 40))):
        place = choose.choice(places) / choose.choice(NAMES)
        if os.path.lexists(place):  # a pipe, which nobody reads, or a link to elsewhere
            continue
        with contextlib.suppress(OSError):  # the path is too long
            if choose.random() < 0.35:
                place.mkdir()
                places.append(place)
            else:
                KINDS[choose.choice((*KINDS, "text", "good", "good"))](place, choose, scratch, good)
    if choose.random() < 0.05:
        deep = choose.choice(places)
        with contextlib.suppress(OSError):
            for _ in range(choose.choice((50, 400))):
                deep = deep / "d"
                deep.mkdir()
    there = [root, *places, *(path for place in places for path in sorted(place.iterdir()))]
    words = [*choose.choice(COMMANDS)]
    out = ["--out", str(choose.choice(there))] if choose.random() < 0.3 else []
    return [words[0], str(choose.choice(there)), *words[1:], *out]


def _text(path: Path, choose: random.Random, _scratch: Path, _good: Path | None) -> None:
    said = choose.choice((*TEXTS, *RAW, "{}", "[]", "0", PROJECT.format("swing.csv"), PROJECT.format("/dev/zero"),
                          "t,alpha\n" + "0.1,0.2\n" * 50, "{}\n" * 100_000))  # fmt: skip
    path.write_text(said, encoding="utf-8", errors="surrogateescape")


def _copy(path: Path, choose: random.Random, _scratch: Path, good: Path | None) -> None:
    """A file of a good run, spoilt or not; a text where there are none."""
    if good is None:
        return _text(path, choose, _scratch, good)
    path.write_bytes(choose.choice([p for p in sorted(good.rglob("*.*")) if p.is_file()]).read_bytes())
    if choose.random() < 0.5 and path.suffix in (".json", ".jsonl", ".toml"):
        _spoil(path.parent, choose)
    return None


def _run(path: Path, choose: random.Random, _scratch: Path, good: Path | None) -> None:
    """A good run, with something else in place of one of its files; a folder where there is none."""
    path.mkdir()
    for file in sorted((good / "run").iterdir()) if good is not None else ():
        if file.is_file() and choose.random() < 0.95:
            (path / file.name).write_bytes(file.read_bytes())


def _link(path: Path, choose: random.Random, scratch: Path, _good: Path | None) -> None:
    path.symlink_to(choose.choice((path, path.parent, scratch, scratch / "thesis", "nowhere", "/dev/zero", "/dev/full",
                                   scratch / "thesis", "/", scratch / "outside")))  # fmt: skip


def _large(path: Path, choose: random.Random, _scratch: Path, _good: Path | None) -> None:
    with path.open("wb") as file:
        file.truncate(choose.choice((70_000_000, 6 << 30)))


def _socket(path: Path, *_: object) -> None:
    with contextlib.chdir(path.parent), socket.socket(socket.AF_UNIX) as listening:
        listening.bind(path.name)


def _crowd(path: Path, *_: object) -> None:
    path.mkdir()
    for k in range(2000):
        (path / f"{k}.json").touch()


KINDS = {
    "text": _text, "good": _copy, "run": _run, "link": _link, "pipe": lambda path, *_: os.mkfifo(path),
    "socket": _socket, "large": _large, "crowd": _crowd,
    "bytes": lambda path, choose, *_: path.write_bytes(choose.randbytes(3000)),
}  # fmt: skip


def judge(scratch: Path, good: Path | None, number: int) -> str:
    """Run one input; return how it ended, or what went wrong after an exclamation mark."""
    shutil.rmtree(scratch / "in", ignore_errors=True)  # of the one before
    words = planted(number, scratch, good)
    writing._rendered = _drawn  # a good run's figures are laid out, but not set in pixels: that is no stranger's work
    before = _outside(scratch)
    fault = fault_of(words, scratch / "in", (0, 1, 2, 3), partial(_called, words))
    if not fault.startswith("!") and (now := _outside(scratch)) != before:
        fault = f"! wrote outside: {sorted(set(now.items()) ^ set(before.items()))[:3]}"
    return f"! {words}: {fault[2:]}" if fault.startswith("!") else fault


def _outside(scratch: Path) -> dict[str, tuple[int, int]]:
    """All that lies beside the tree: sizes and dates."""
    paths = [path for path in scratch.rglob("*") if scratch / "in" not in (path, *path.parents)]
    return {str(path): (path.lstat().st_size, path.lstat().st_mtime_ns) for path in paths if not path.is_dir()}


def fuzz(numbers: range, seconds: float, good: Path | None = None) -> Ended:
    """Run inputs until they or the time are used up; return how they ended."""
    _import_all(good)
    with tempfile.TemporaryDirectory(dir=SHARED) as name:
        scratch = Path(name)
        (scratch / "thesis").write_text("mine")
        (scratch / "outside").mkdir()
        (scratch / "outside" / "report.html").write_text("mine, too")
        return run_all(numbers, partial(judge, scratch, good), Limits(lambda _: SECONDS, apart=True), seconds)


def _import_all(good: Path | None) -> None:
    """What the commands import and compile, once for all the processes."""
    if good is not None:
        judge_imports(good)
    with tempfile.TemporaryDirectory() as empty:
        for words in COMMANDS:
            _called([words[0], empty, *words[1:]])


def main() -> None:
    """Run the command."""
    asked = options("Fuzz folders of folders", inputs=10_000, seconds=3600.0)
    say_and_exit(*fuzz(asked.numbers, asked.seconds, asked.good and made(asked.good)))


if __name__ == "__main__":
    main()
