"""SIGTERM and SIGHUP: a sentence, and the end at once, as of ``kill -9``; but not in the middle of starting a process.

What is done is on the disk by then, and what is written is whole or not there, so there is nothing to tidy up, and
nothing that could be waited for.  A process that is just being started has yet to be told what it is for; were its
parent to end meanwhile, it would end in a traceback.

Output that cannot be written ends nothing: what is printed is dropped, the files of the run are written to their end,
and the exit code is 1.  So it is with a closed pipe, ``fracid fit rig.toml | head``, and with a full disk, which is
said.  Where standard output is closed from the start nobody wants it, and the code is that of the work.  What its
encoding lacks is written out as JSON does it, ``\\u03bc``.
"""

from __future__ import annotations

import codecs
import io
import json
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from types import FrameType
from typing import Any

from fracid.errors import typed
from fracid.safety.door import nowhere
from fracid.tasks import SAYS
from fracid.tasks.folder_lock import held_folders

NAMES = ("SIGTERM", "SIGHUP")
"""Of the signals, as far as the system has them."""

_STARTING: list[int] = []
"""The threads that are starting a process."""

_LATE: list[int] = []
"""The signals that came meanwhile."""


@contextmanager
def ended_in_a_sentence() -> Iterator[None]:
    """Have these signals end the process in a sentence; where somebody else takes or ignores one, it stays theirs."""
    on_main = threading.current_thread() is threading.main_thread()
    taken = [number for name in NAMES if on_main and (number := getattr(signal, name, None)) is not None
             and signal.getsignal(number) is signal.SIG_DFL]  # fmt: skip
    for number in taken:
        signal.signal(number, _heard)
    try:
        yield
    finally:
        for number in taken:
            signal.signal(number, signal.SIG_DFL)


class _Output(io.FileIO):
    """A pipe or a file that drops what it cannot take."""

    fault: OSError | None = None

    def write(self, data: Any) -> int:
        try:
            return super().write(data)
        except OSError as error:
            self.fault = error
            return len(data)


def _written_out(error: UnicodeError) -> tuple[str, int]:
    """What an encoding lacks, as JSON has it."""
    assert isinstance(error, UnicodeEncodeError)
    return json.dumps(error.object[error.start : error.end])[1:-1], error.end


codecs.register_error("fracid", _written_out)


@contextmanager
def quiet_when_closed() -> Iterator[None]:
    """Let work go on to its end when its output cannot be written; the exit code is then 1 in place of 0."""
    outputs, before, left = list[_Output](), (sys.stdout, sys.stderr), ExitStack()
    for name in ("stdout", "stderr"):
        if (stream := getattr(sys, name)) is None:
            setattr(sys, name, left.enter_context(nowhere()))
        elif isinstance(stream, io.TextIOWrapper) and (number := _number(stream)) is not None:
            stream.flush()
            outputs.append(output := _Output(number, "w", closefd=False))
            errors = "fracid" if stream.errors in ("strict", "surrogateescape") else stream.errors
            text = io.TextIOWrapper(
                io.BufferedWriter(output), stream.encoding, errors, line_buffering=stream.line_buffering,
                write_through=stream.write_through,
            )  # fmt: skip
            setattr(sys, name, text)
    try:
        yield
    except SystemExit as end:
        _flush()
        faults = [output.fault for output in outputs if output.fault is not None]
        for fault in faults:
            if not isinstance(fault, BrokenPipeError):
                sys.stderr.write(f"error: the output cannot be written: {fault.strerror}.\n")
        if end.code in (0, None) and faults:
            raise SystemExit(1) from None
        raise
    finally:
        _flush()
        sys.stdout, sys.stderr = before
        left.close()


def _number(stream: io.TextIOWrapper) -> int | None:
    """Of the file that a stream writes to; None where there is none, and of a console of Windows."""
    with suppress(OSError, ValueError):
        return None if sys.platform == "win32" and stream.isatty() else stream.fileno()
    return None


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
    folder = next(iter(held_folders()), None)
    what = "ended-without-a-folder" if folder is None else "ended"
    said = SAYS(what, signal=signal.Signals(number).name, typed=typed("resume", folder))
    with suppress(OSError, ValueError):  # the terminal may be gone
        os.write(sys.stderr.fileno(), f"\nerror: {said}\n".encode())
    signal.signal(number, signal.SIG_DFL)
    os.kill(os.getpid(), number)
