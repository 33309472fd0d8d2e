"""SIGTERM and SIGHUP: a sentence, and the end at once, as of ``kill -9``; but not in the middle of starting a process.

What is done is on the disk by then, and what is written is whole or not there, so there is nothing to tidy up, and
nothing that could be waited for.  A process that is just being started has yet to be told what it is for; were its
parent to end meanwhile, it would end in a traceback.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType

__all__ = ["ended_in_a_sentence", "undisturbed"]

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
