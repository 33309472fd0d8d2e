"""A process beside a fit, which draws: matplotlib holds the interpreter's lock, so threads would wait for each other.

It is started first of all.  While this process imports what a fit needs, it imports what drawing needs; while this one
searches, it draws the rig; while this one examines a minimum, simulates the plane of the orders and writes the page, it
tests the residuals and draws the recordings.  What it has not begun when this one is done with that, this one draws,
from the last.  Where it dies, or where there is none, this process does its work.
"""

from __future__ import annotations

import gc
import os
import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from fracid.safety.environment import ignore_settings

if TYPE_CHECKING:
    from concurrent.futures import ProcessPoolExecutor

T = TypeVar("T")


@dataclass(frozen=True)
class Drawer:
    """Who draws: the process beside this one, or this one.

    The process is given one piece at a time; the others wait here, where they can be taken back.  (Before Python 3.12
    a pool that dies with a cancelled piece forgets the others.)

    Examples
    --------
    >>> length = Drawer(None).asked(len, "alpha")
    >>> length()
    5
    """

    pool: ProcessPoolExecutor | None
    """Of one process; None where this one does all."""
    _waiting: deque[Asked[Any]] = field(default_factory=deque)
    _given: list[Future[Any]] = field(default_factory=list)
    """The unfinished one."""
    _lock: threading.RLock = field(default_factory=threading.RLock)

    def asked(self, work: Callable[..., T], *what: Any, first: bool = False) -> Asked[T]:
        """Have something done; what is given back waits for its result.

        What is asked for `first` goes before all that waits.
        """
        piece = Asked(self, work, what)
        with self._lock:
            (self._waiting.appendleft if first else self._waiting.append)(piece)
        self._give()
        return piece

    def taken_back(self, piece: Asked[Any]) -> bool:
        """Whether a piece waited still, and now does no more."""
        with self._lock:
            here = piece in self._waiting
            if here:
                self._waiting.remove(piece)
        return here

    def _give(self) -> None:
        """The process its next piece, as long as it lives."""
        with self._lock:
            while self.pool is not None and self._waiting and not self._given:
                try:
                    future = self.pool.submit(self._waiting[0].work, *self._waiting[0].what)
                except (OSError, RuntimeError):
                    return
                self._waiting.popleft().future = future
                self._given.append(future)
                future.add_done_callback(self._done)

    def _done(self, future: Future[Any]) -> None:
        if future.cancelled() or isinstance(future.exception(), BrokenExecutor):
            return  # nor ask a pool that is ending for its lock
        with self._lock:
            self._given.remove(future)
        self._give()


@dataclass(eq=False)
class Asked(Generic[T]):
    """Something to do, and its future where the process has it."""

    drawer: Drawer
    work: Callable[..., T]
    what: tuple[Any, ...]
    future: Future[T] | None = None

    def __call__(self) -> T:
        """Its result: here and now where nobody has begun, else waited for."""
        if not self.drawer.taken_back(self) and self.future is not None:
            with suppress(BrokenExecutor):
                return self.future.result()
        return self.work(*self.what)

    def drop(self) -> None:
        """Have nobody begin it; what is begun is waited for."""
        if not self.drawer.taken_back(self) and self.future is not None:
            with suppress(BrokenExecutor):
                self.future.result()


@contextmanager
def drawer(jobs: int) -> Iterator[Drawer]:
    """Start the process, with two jobs or more; it ends when the block does, and with what ends that early.

    Examples
    --------
    >>> with drawer(1) as alone:
    ...     alone.asked(len, "alpha")()
    5
    """
    if jobs < 2:
        yield Drawer(None)
        return
    from fracid.tasks.local import (
        UNSTARTED,
        deaf_to_ctrl_c,
        fresh_processes,
        without_main,
    )  # not above: help would wait

    pool = None
    try:
        with suppress(*UNSTARTED):  # where none can be started, this one draws
            pool = fresh_processes(1, _prepare)
            with deaf_to_ctrl_c(), without_main():
                pool.submit(int)  # starts it
        yield Drawer(pool)
    finally:
        _terminate(pool)  # left to itself it takes apart all that it has imported, and an exit waits for that
        if pool is not None:  # waits: an exit that comes meanwhile writes to a pipe that is just closed
            pool.shutdown(cancel_futures=True)


@contextmanager
def ended_with_this(beside: ProcessPoolExecutor | None) -> Iterator[None]:
    """What ends the work here, Ctrl-C or a full disk, ends the process beside it: nobody waits for its figures."""
    try:
        yield
    except BaseException:
        _terminate(beside)
        raise


def _terminate(pool: ProcessPoolExecutor | None) -> None:
    for process in list((getattr(pool, "_processes", None) or {}).values()):
        process.terminate()


@contextmanager
def importing() -> Iterator[None]:
    """Import without looking for garbage, which modules are not: a sixth of the time.

    What a process has after its first such block is never looked through again.

    Examples
    --------
    >>> with importing():
    ...     import decimal
    """
    gc.disable()
    try:
        yield
    finally:
        if not gc.get_freeze_count():
            gc.freeze()
        gc.enable()


def _prepare() -> None:
    """Import what drawing needs, as long as there is somebody to draw for."""
    from fracid.tasks.local import follow_parent

    follow_parent()
    with suppress(AttributeError, OSError):  # the search first
        os.nice(10)
    ignore_settings(Path())
    with importing():
        import matplotlib.backends.backend_agg
        import matplotlib.backends.backend_svg
        import matplotlib.figure  # noqa: F401
        import scipy.stats  # noqa: F401

        import fracid.plots
        import fracid.validation.residual_analyses  # noqa: F401
