"""Fuzzing of run folders: a stranger's, or a dying disc's, into every command and function that takes one.

::

    python tests/safety/fuzz_runs.py                       for ten minutes
    python tests/safety/fuzz_runs.py --inputs 300          the first three hundred
    python tests/safety/fuzz_runs.py --again 1234          one input once more

Three good folders, of a fit with all that it may have, of a comparison and of a study of noise, are made once.  Input
number n is one of them with one to three faults, and one command; both follow from n alone.  It must end with exit code
0, 1 (``reproduce``), 2 or 3 and, where it is refused, with one line that can be printed; without a warning, within 30 s
of processor time and 1 GiB of memory; and no file may be other, or new, but in the folder and in the one that ``--out``
names.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import random
import shutil
import sys
import tempfile
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from fracid.plots import writing
from fracid.safety.text import printable
from fuzz import Ended, Limits, fault_of_message, options, say_and_exit, where
from fuzz import fuzz as run_all
from fuzz_inputs import any_bytes, times

__all__ = ["judge", "made", "spoilt"]

SECONDS = 30.0
"""Of processor time, for one input: a command on a good folder takes one to seven, a whole comparison 20."""

PROJECT = """
[model.orders]
lambda = {{ start = 0.9, lower = 0.5, upper = 1.2 }}
mu = {{ start = 1.0, lower = 0.5, upper = 1.2 }}
[fit]
initial_state = "held"
{recordings}
"""

RECORDING = """
[[recording]]
name = "{name}"
file = "{name}.csv"
theta = {{ column = "theta", unit = "rad" }}
alpha = {{ column = "alpha", unit = "rad" }}
initial = {{ theta = 0.0, alpha = {alpha} }}
use = "{use}"
"""

STUDY = ("--seeds", "1", "--levels", "0.1", "--counts", "0", "--executor", "threads", "--jobs", "1")

COMMANDS: dict[str, tuple[tuple[str, ...], ...]] = {
    "run": (
        ("report", "--jobs", "1"), ("draw", "--jobs", "1"), ("draw", "--style", "screen", "--format", "svg"),
        ("resid",), ("export",), ("export", "--to", "state-space"), ("resume", "--jobs", "1"),
        ("resume", "--json", "--jobs", "1"), ("reproduce", "--jobs", "1"), ("simulate",), ("noise", *STUDY),
        ("python",), ("profile", "--parameter", "mu", "--points", "4", "--jobs", "1"),
        ("compare", "rig.toml", "--rung", "viscous", "--jobs", "1", "--out"),
        ("fit", "rig.toml", "--jobs", "1", "--out"),
    ),
    "compared": (("draw",), ("resume",), ("reproduce",), ("report",),
                 ("compare", "rig.toml", "--rung", "viscous", "--jobs", "1", "--out")),
    "noisy": (("draw",), ("resume",), ("reproduce",), ("noise", "run", *STUDY, "--out")),
}  # fmt: skip
"""Folder → what is typed of it; its name stands second, or after a last ``--out``."""

TEXTS = (
    "", " ", "\x1b[2J\x1b]8;;http://evil\x07", "\u202e", "[red]x[/nope]", "$\\frac{", "$", "\\$x$",
    "<script>alert(1)</script>", "../../outside", "/etc/passwd", "a\x00b", "'); system('id", '*/ #include "x"', "=1+1",
    "nan", "x" * 300, "λ" * 5000, "x" * 10_000_000, "__class__", "my.py:model", "{{7*7}}", "%s%n",
)  # fmt: skip

VALUES = (
    None, True, False, 0, -1, 1, 2, 10**9, 10**18, 10**30, 0.5, -0.5, 1e-300, 1e30, 1e99, 1e300, 5e-324,
    [], {}, [[]], [1], [1, 2, 3], {"a": 1}, [None], [None, None], [1e99, -1e99],
)  # fmt: skip

RAW = (
    "NaN", "Infinity", "-Infinity", "1e999", "9" * 5000, "[" * 100_000, '{"a":' * 5000, "[" * 40 + "]" * 40, "{", '"',
    "\x00", "",
)  # fmt: skip
"""What no JSON writer would write."""


# --- good folders ---------------------------------------------------------------------------------------


def made(home: Path) -> Path:
    """The good folders, with their project and recordings, made in a folder if they are not there; a minute."""
    import fracid

    if (home / "noisy" / "noise.json").exists():
        return home
    home.mkdir(parents=True, exist_ok=True)
    rig, random_numbers = fracid.rotary_pendulum("srv02-rotpen"), np.random.default_rng(1)
    words = []
    for name, alpha, use in (("one", 0.35, "fit"), ("two", 0.2, "fit"), ("three", 0.3, "validate")):
        found = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": alpha}, step=1e-2, end=1.0)
        noisy = found.states[:, [0, 2]] + 1e-3 * random_numbers.standard_normal((found.time.size, 2))
        np.savetxt(home / f"{name}.csv", np.column_stack([found.time, noisy]), delimiter=",",
                   header="time,theta,alpha", comments="")  # fmt: skip
        words.append(RECORDING.format(name=name, alpha=alpha, use=use))
    (home / "rig.toml").write_text(PROJECT.format(recordings="".join(words)))
    with contextlib.chdir(home):
        for typed in (
            "fit rig.toml --out run --multi-start 2 --cut --jobs 1", "profile run --points 4 --joint lambda,mu",
            "compare rig.toml --out compared --amplitude --jobs 1",
            "noise run --seeds 1 --levels 0.1 --counts 0 --executor threads --out noisy",
        ):  # fmt: skip
            code, _, said = _called(typed.split())
            assert code == 0, said
    shutil.copy(home / "compared" / "compare.json", home / "run")
    return home


def _called(words: list[str]) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of a command in this process."""
    from fracid.cli.app import main

    out, err, before = io.StringIO(), io.StringIO(), sys.argv
    try:
        sys.argv = ["fracid", *words]
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            main(words)
    except SystemExit as stop:
        code = stop.code if isinstance(stop.code, int) else 0 if stop.code is None else 2
    finally:
        sys.argv = before
    return code, out.getvalue(), err.getvalue()


# --- faults ---------------------------------------------------------------------------------------------


def spoilt(number: int, good: Path, folder: Path) -> tuple[Path, list[str]]:
    """Make input n: a spoilt copy of the good folders, what was done to it, and the command."""
    choose = random.Random(number)
    shutil.copytree(good, folder, symlinks=True)
    which = choose.choices(list(COMMANDS), (6, 2, 1))[0]
    words = list(choose.choice(COMMANDS[which]))
    if which == "run" and choose.random() < 0.3 and words[0] != "reproduce":
        _unfinish(folder / "run")
    done = [_spoil(folder / which, choose) for _ in range(choose.choice((1, 1, 1, 2, 3)))]
    typed = [*words, which] if words[-1] == "--out" else [words[0], which, *words[1:]]
    return folder, [" ".join(typed), *done]


def _unfinish(run: Path) -> None:
    """As if it had been killed before its end."""
    state = json.loads((run / "run.json").read_text()) | {"finished": False}
    state["options"]["project"] = str(run.parent / "rig.toml")
    (run / "run.json").write_text(json.dumps(state))
    (run / "result.json").unlink()


def _spoil(run: Path, choose: random.Random) -> str:
    files = sorted(p for p in run.iterdir() if p.suffix in (".json", ".jsonl", ".toml") and _is_small(p))
    if not files:
        return "nothing left"
    path = choose.choice(files)
    kind = choose.choices((_value, _key, _bytes, _raw, _place), (10, 3, 3, 2, 2))[0]
    return f"{path.name}: {kind(path, choose)}"


def _is_small(path: Path) -> bool:
    """A file, and none of gigabytes without a byte."""
    return path.is_file() and path.stat().st_size < 1 << 30


def _value(path: Path, choose: random.Random) -> str:
    """Another value somewhere in a JSON file, or in a line of a log."""

    def change(said: Any) -> str:
        places = list(_places(said))
        if not places:
            return "nothing in it"
        owner, key = choose.choice(places)
        owner[key] = choose.choice((*VALUES, *TEXTS))
        return f"{key} = {str(owner[key])[:30]!r}"

    return _changed(path, choose, change)


def _key(path: Path, choose: random.Random) -> str:
    """A key left out, or another one for it."""

    def change(said: Any) -> str:
        places = [(owner, key) for owner, key in _places(said) if isinstance(owner, dict)]
        if not places:
            return "no keys"
        owner, key = choose.choice(places)
        value, new = owner.pop(key), choose.choice((None, *TEXTS))
        if new is not None:
            owner[new] = value
        return f"{key} is now {str(new)[:30]!r}"

    return _changed(path, choose, change)


def _changed(path: Path, choose: random.Random, change: Callable[[Any], str]) -> str:
    """Change what a JSON file says, or a line of a log; bytes of any other file."""
    if path.suffix == ".toml":
        return _bytes(path, choose)
    try:
        lines = path.read_text().splitlines() if path.suffix == ".jsonl" else [path.read_text()]
        at = choose.randrange(len(lines))
        said = json.loads(lines[at])
    except (ValueError, RecursionError):
        return "spoilt already"
    what = change(said)
    lines[at] = json.dumps(said)
    path.write_text("\n".join(lines) + "\n")
    return what


def _places(said: Any) -> Any:
    """All places in a JSON value: owner and key."""
    pairs = said.items() if isinstance(said, dict) else enumerate(said) if isinstance(said, list) else ()
    for key, value in pairs:
        yield said, key
        yield from _places(value)


def _bytes(path: Path, choose: random.Random) -> str:
    """As a disc or a line damages them, or the end of another file of the run."""
    raw, others = (
        path.read_bytes(),
        [p.read_bytes() for p in sorted(path.parent.glob("*.json")) if p != path and _is_small(p)],
    )
    for _ in times(choose):
        raw = any_bytes(raw, choose, [*others, b"{}"])
    path.write_bytes(raw)
    return "bytes"


def _raw(path: Path, choose: random.Random) -> str:
    new = choose.choice(RAW)
    text = path.read_text(errors="replace")
    at = choose.randrange(len(text) + 1)
    path.write_text(choose.choice((new, text[:at] + new + text[at:])), encoding="utf-8", errors="replace")
    return f"raw {new[:20]!r}"


def _place(path: Path, choose: random.Random) -> str:
    """Something else in its place."""
    kind = choose.choice(("nothing", "folder", "link", "pipe", "binary", "no right", "long"))
    if kind == "binary":
        path.write_bytes(choose.randbytes(1000))
    elif kind == "long":
        with path.open("ab") as file:
            file.truncate(3 << 30)  # takes no room
    elif kind == "no right":
        path.chmod(0)
    else:
        path.unlink()
    if kind == "folder":
        path.mkdir()
    elif kind == "link":
        path.symlink_to("/etc/passwd")
    elif kind == "pipe":
        os.mkfifo(path)
    return kind


# --- the judgement --------------------------------------------------------------------------------------


def judge(good: Path, scratch: Path, number: int) -> str:
    """Run one input; return how it ended, or what went wrong after an exclamation mark."""
    if number % 10:
        writing._rendered = _drawn
    shutil.rmtree(scratch / "in", ignore_errors=True)  # of the one before
    folder, (typed, *_) = spoilt(number, good, scratch / "in")
    words = typed.split()
    mine = folder / (words[1] if words[-2] != "--out" else words[-1])
    before = _listed(scratch, mine)
    codes = (0, 1, 2, 3) if words[0] == "reproduce" else (0, 2, 3)
    fault = fault_of(words, folder, codes, lambda: _python(mine) if words[0] == "python" else _called(words))
    if not fault.startswith("!") and (now := _listed(scratch, mine)) != before:
        fault = f"! wrote {sorted(set(now.items()) ^ set(before.items()))[:3]}"
    return f"! {typed}: {fault[2:]}" if fault.startswith("!") else fault


def fault_of(words: list[str], folder: Path, codes: tuple[int, ...], call: Callable[[], tuple[int, str, str]]) -> str:
    """How a command ends in a folder, or what is wrong with its code and its words after an exclamation mark."""
    with warnings.catch_warnings(record=True) as heard, contextlib.chdir(folder):
        warnings.simplefilter("always")
        try:
            code, out, err = call()
        except Exception as error:
            return f"! {type(error).__name__}: {str(error)[:200]} {where(error)}"
    told = err.strip().splitlines()
    if heard:
        return f"! warning: {heard[0].message} {heard[0].filename}:{heard[0].lineno}"
    if code not in codes:
        return f"! exit code {code}: {err[-300:]}"
    if code == 2 and (
        fault := fault_of_message(told[-1].replace(printable(words[1]), "FOLDER")) if told else "! not a word"
    ):
        return fault
    if any(c in out + err for c in "\x1b\x07\u202e\x00"):
        return "! prints what commands a terminal"
    return f"{words[0]} {code}"


def _drawn(figure: Any, _ending: str) -> bytes:
    """In place of a picture in nine of ten inputs: all of it is laid out, but no pixel is set."""
    figure.draw_without_rendering()
    return b""


def _python(folder: Path) -> tuple[int, str, str]:
    """What a program of one's own does with a run that it loads."""
    import fracid

    try:
        run = fracid.load_run(folder)
        _ = run.x, run.parameters, run.starts, run.cut, run.notes, [r.rmse for r in run.recordings.values()]
    except fracid.FracidError as error:
        return error.exit_code, "", str(error)
    return 0, "", ""


def _listed(scratch: Path, mine: Path) -> dict[str, tuple[int, int]]:
    """All files but those in the folder itself: sizes and dates."""
    found = {}
    for place, folders, names in os.walk(scratch):
        if Path(place) == mine or mine in Path(place).parents:
            folders.clear()
            continue
        for name in names:
            about = os.lstat(os.path.join(place, name))
            found[os.path.relpath(os.path.join(place, name), scratch)] = about.st_size, about.st_mtime_ns
    runs = os.path.join("in", "runs") + os.sep  # where simulate and noise write by themselves
    return {name: about for name, about in found.items() if not name.startswith(runs)}


def fuzz(good: Path, numbers: range, seconds: float) -> Ended:
    """Run inputs until they or the time are used up; return how they ended."""
    judge_imports(good)
    with tempfile.TemporaryDirectory() as name:
        return run_all(numbers, partial(judge, good, Path(name)), Limits(lambda _: SECONDS, apart=True), seconds)


def judge_imports(good: Path) -> None:
    """Import, and compile, what the inputs need, once for all the processes."""
    import fracid.plots
    import fracid.report.page  # noqa: F401

    with tempfile.TemporaryDirectory() as scratch:
        home = shutil.copytree(good, Path(scratch) / "in")
        with contextlib.chdir(home):
            for words in (["report", "run", "--jobs", "1"], ["draw", "run", "--jobs", "1"], ["resid", "run"]):
                assert _called(words)[0] == 0


def main() -> None:
    """Run the command."""
    asked = options("Fuzz run folders", seconds=600.0)
    with tempfile.TemporaryDirectory() as place:
        say_and_exit(*fuzz(made(asked.good or Path(place) / "good"), asked.numbers, asked.seconds))


if __name__ == "__main__":
    main()
