"""SIGTERM and SIGHUP: a sentence, and the end at once, as of ``kill -9``; but not in the middle of starting a process.

What is done is on the disk by then, and what is written is whole or not there, so there is nothing to tidy up, and
nothing that could be waited for.  A process that is just being started has yet to be told what it is for; were its
parent to end meanwhile, it would end in a traceback.

A closed pipe, as of ``fracid fit rig.toml | head``, ends nothing: what is printed from then on is dropped, the files of
the run are written to their end, and the exit code is 1.
"""

from __future__ import annotations

import io
import os
import signal
import stat
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any

__all__ = ["ended_in_a_sentence", "quiet_when_closed", "undisturbed"]

NAMES = ("SIGTERM", "SIGHUP")
"""Of the signals, as far as the system has them."""

_STARTING: list[int] = []
"""The threads that are starting a process."""

_LATE: list[int] = []
"""The signals that came meanwhile."""


@contextmanager
def ended_in_a_sentence() -> Iterator[None]:
    """Have these signals end the process in a sentence; where somebody else takes or ignores one, it stays theirs."""
    taken = []
    if threading.current_thread() is threading.main_thread():
        taken = [number for name in NAMES if (number := getattr(signal, name, None)) is not None
                 and signal.getsignal(number) is signal.SIG_DFL]  # fmt: skip
    for number in taken:
        signal.signal(number, _heard)
    try:
        yield
    finally:
        for number in taken:
            signal.signal(number, signal.SIG_DFL)


class _Pipe(io.FileIO):
    """A pipe that drops what nobody reads any more."""

    closed_by_reader = False

    def write(self, data: Any) -> int:
        try:
            return super().write(data)
        except BrokenPipeError:
            self.closed_by_reader = True
            return len(data)


@contextmanager
def quiet_when_closed() -> Iterator[None]:
    """Let work go on to its end when the reader of its output is gone; the exit code is then 1 in place of 0."""
    pipes, before = list[_Pipe](), (sys.stdout, sys.stderr)
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if isinstance(stream, io.TextIOWrapper) and _is_pipe(stream):
            stream.flush()
            pipes.append(pipe := _Pipe(stream.fileno(), "w", closefd=False))
            text = io.TextIOWrapper(
                io.BufferedWriter(pipe), stream.encoding, stream.errors, line_buffering=stream.line_buffering,
                write_through=stream.write_through,
            )  # fmt: skip
            setattr(sys, name, text)
    try:
        yield
    except SystemExit as end:
        _flush()
        if end.code in (0, None) and any(pipe.closed_by_reader for pipe in pipes):
            raise SystemExit(1) from None
        raise
    finally:
        _flush()
        sys.stdout, sys.stderr = before


def _is_pipe(stream: io.TextIOWrapper) -> bool:
    try:
        mode = os.fstat(stream.fileno()).st_mode
    except (OSError, ValueError):
        return False
    return stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode)


def _flush() -> None:
    sys.stdout.flush()
    sys.stderr.flush()


@contextmanager
def undisturbed() -> Iterator[None]:
    """Have them wait for what stands here."""
    _STARTING.append(threading.get_ident())
    try:
        yield
    finally:
        _STARTING.pop()
        if _LATE and not _STARTING:
            _end(_LATE[0])


def _heard(number: int, frame: FrameType | None) -> None:  # noqa: ARG001  (Python's signature)
    if _STARTING:
        _LATE.append(number)
    else:
        _end(number)


def _end(number: int) -> None:
    """Say so, and die of the signal, so that whoever sent it sees that."""
    with suppress(OSError, ValueError):  # the terminal may be gone
        os.write(
            sys.stderr.fileno(),
            f"\nerror: {signal.Signals(number).name} ended this. What was done is kept: type the same again, or "
            "fracid resume FOLDER, and it goes on.\n".encode(),
        )
    signal.signal(number, signal.SIG_DFL)
    os.kill(os.getpid(), number)
