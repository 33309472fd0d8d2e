"""An append-only log of what a long study has done, so that nothing is lost when it is interrupted.

::

    {"journal": 1, "study": {"problem": "9f2c…", "levels": [0.0, 0.05], "seeds": 50}}     what is being done
    {"key": "level 0.05 deg, seed 17", "seconds": 0.83, "value": {"mu": 0.9146, …}}       one line a repetition
    …

**What survives what.**  A line is handed to the operating system as its repetition ends, so it outlives the
process, ``kill -9`` at any moment included; at most once a second, and at the end, it is also forced to the disk
(``fsync``), so a power cut costs a second's work.  A line that was cut off in writing is removed when the journal is
opened again, and that is said; its repetition is done again.  On a full disk the broken line is taken back at once.

**Who may write.**  One process: a lock on the folder refuses a second one.  The system lets go of it when
the process ends in whatever way, so there is no stale lock to remove.

**What may go on.**  The first line names the study: all that its results depend on.  Another study is
refused with what differs, for its repetitions would bear the same keys.
"""

from __future__ import annotations

import errno
import json
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, suppress
from io import RawIOBase
from pathlib import Path

from fracid.errors import InputError, Unfinished, typed, writing
from fracid.safety.door import appended, opened
from fracid.safety.json_files import LONGEST, object_of
from fracid.tasks import SAYS
from fracid.tasks.folder_lock import FolderLock, Json

FORMAT = 1

TOLD = 20
"""Damaged lines in a message, at most."""

SYNC = 1.0
"""At most this often is a line forced to the disk [s]."""


class Journal(AbstractContextManager["Journal"]):
    """The log of one study: what is done, and the file that it is appended to.

    Parameters
    ----------
    path : Path
        Made if it is missing; its folder must exist.
    study : mapping
        What all results depend on, as plain JSON values: hashes of problem and data, options, versions.
    fault : function (key, value) -> str, optional
        What is wrong with the result of a repetition, as a line has it; such a line is passed over as damaged.

    Raises
    ------
    InputError
        If the file belongs to another study or is none, if another process is at work in the folder, or if it cannot
        be written.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "journal.jsonl"
    >>> with Journal(path, {"seeds": 3}) as journal:
    ...     journal.append("seed 1", {"mu": 0.91})
    >>> with Journal(path, {"seeds": 3}) as journal:
    ...     journal.done
    {'seed 1': {'mu': 0.91}}
    """

    done: dict[str, Json]
    """Key → what its repetition gave."""
    notes: tuple[str, ...]
    """What was found damaged and repaired, a sentence each."""

    def __init__(
        self, path: str | Path, study: Mapping[str, Json], fault: Callable[[str, Json], str] = lambda _key, _value: ""
    ) -> None:
        """Open it, repair it, and read what is done."""
        self.path = Path(path)
        with ExitStack() as opened:
            opened.enter_context(FolderLock(self.path.parent))
            with writing(str(self.path), "Give another folder: --out DIR."):
                self._file = opened.enter_context(appended(self.path))
            self._read(dict(study), fault)
            self._synced = time.monotonic()
            if self._end == 0:
                self._write(json.dumps({"journal": FORMAT, "study": study}, ensure_ascii=False, allow_nan=False))
            self._opened = opened.pop_all()

    def __exit__(self, *_: object) -> None:
        """Force the last lines to the disk, close the file and let go of the folder."""
        with self._opened:
            if not self._file.closed:
                self._sync()

    def _read(self, study: dict[str, Json], fault: Callable[[str, Json], str]) -> None:
        """Lines of an earlier process: what is done, what was repaired, and where the good part ends [bytes]."""
        self.done, damaged, end = {}, list[int](), 0
        for number, (text, end) in enumerate(whole_lines(self.path), 1):  # noqa: B007  (the last one's)
            line = object_of(text)
            if number == 1:
                _check_study(self.path, line, json.loads(json.dumps(study)))
            elif line is None or not isinstance(line.get("key"), str) or fault(line["key"], line.get("value")):
                damaged += [number] * (len(damaged) <= TOLD)
            else:
                self.done.setdefault(line["key"], line.get("value"))
        notes = list[str]()
        if self.path.stat().st_size > end:
            self._file.truncate(end)
            notes += [SAYS("cut-off", path=self.path)] * (end > 0)
        if damaged:
            numbers = ", ".join(map(str, damaged[:TOLD])) + ", ..." * (len(damaged) > TOLD)
            notes.append(f"{self.path}: damaged lines ({numbers}) are passed over; their repetitions are done again.")
        self.notes, self._end = tuple(notes), end

    def append(self, key: str, value: Json, seconds: float = 0.0) -> None:
        """Keep the result of one repetition.

        Parameters
        ----------
        key : str
            Unique in the study.
        value : JSON value
            Without NaN.
        seconds : float
            What it took [s].

        Raises
        ------
        Unfinished
            If the disk will not take it; what was there before stays.
        """
        line = {"key": key, "seconds": round(seconds, 4), "value": value}
        self._write(json.dumps(line, ensure_ascii=False, allow_nan=False))
        self.done[key] = value

    def _write(self, line: str) -> None:
        self._end = append_whole(self._file, [line.encode() + b"\n"], self._end)
        if time.monotonic() - self._synced > SYNC:
            self._sync()

    def _sync(self) -> None:
        try:
            os.fsync(self._file.fileno())
        except OSError as error:
            raise _cut_short(self.path, error) from None
        self._synced = time.monotonic()


def whole_lines(path: Path) -> Iterator[tuple[bytes, int]]:
    """Read the lines of a log one by one, without a last one that was cut off in writing; each with its end [bytes].

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "log"
    >>> _ = path.write_bytes(b"one\\ntwo\\nthr")
    >>> list(whole_lines(path))
    [(b'one', 4), (b'two', 8)]
    """
    at, begun = 0, False
    if not path.exists():
        return
    with opened(path) as file:
        while piece := file.readline(LONGEST):  # a line that is longer is none of ours, and would fill the memory
            at += len(piece)
            if piece.endswith(b"\n"):
                yield (b"" if begun else piece[:-1]), at
            begun = not piece.endswith(b"\n")


def resuming(path: Path) -> str:
    """The command that resumes what has a log: of the log's own folder, or of the run whose many starts it keeps.

    Examples
    --------
    >>> import tempfile
    >>> run = Path(tempfile.mkdtemp())
    >>> (run / "run.json").touch()
    >>> resuming(run / "starts" / "journal.jsonl") == f"fracid resume {run}"
    True
    """
    own, above = path.parent, path.parent.parent
    alone = (own / "run.json").exists() or (own / "environment.json").exists()
    return typed("resume", above if not alone and (above / "run.json").exists() else own)


def append_whole(file: RawIOBase, content: Sequence[bytes | memoryview], end: int) -> int:
    """Append to a log, whole or not at all; gives its new end [bytes].

    Parameters
    ----------
    file : raw file
        Opened to append.
    content : sequence of bytes
    end : int
        Where it ends now.

    Raises
    ------
    Unfinished
        If the disk will not take it; the log then ends where it did.

    Examples
    --------
    >>> import tempfile
    >>> with open(Path(tempfile.mkdtemp()) / "log", "ab", buffering=0) as file:
    ...     append_whole(file, [b"one\\n"], 0)
    4
    """
    try:
        for part in content:
            remainder = memoryview(part)
            while remainder:
                remainder = remainder[file.write(remainder) :]
    except BaseException as error:  # Ctrl-C too leaves no half of a line
        with suppress(OSError):
            file.truncate(end)  # also a full disk can take back
        if isinstance(error, OSError):
            raise _cut_short(Path(str(getattr(file, "name", "the log"))), error) from None
        raise
    return end + sum(map(len, content))


def _cut_short(path: Path, error: OSError) -> Unfinished:
    why = "the disk is full" if error.errno in (errno.ENOSPC, errno.EDQUOT) else error.strerror
    return Unfinished(SAYS("not-written", path=path, why=why, typed=resuming(path)))


def _check_study(path: Path, header: dict[str, Json] | None, study: dict[str, Json]) -> None:
    """Refuse to go on with another study, and say what differs."""
    if header is None or header.get("journal") != FORMAT or not isinstance(header.get("study"), dict):
        raise InputError(f"{path} is no journal of this version of fracid; give another folder: --out DIR.")
    was = header["study"]
    if differ := [name for name in {**was, **study} if was.get(name) != study.get(name)]:
        changes = "; ".join(f"{n} was {_short(was.get(n))} and is {_short(study.get(n))}" for n in differ)
        raise InputError(SAYS("other-study", folder=path.parent, changes=changes, typed=resuming(path)))


def _short(value: Json) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 60 else f"{text[:57]}..."
