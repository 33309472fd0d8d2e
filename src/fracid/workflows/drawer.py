"""A process beside a fit, which draws: matplotlib holds the interpreter's lock, so threads would wait for each other.

It is started first of all.  While this process imports what a fit needs, it imports what drawing needs; while this one
examines a minimum, simulates the plane of the orders and writes the page, it tests the residuals and draws the
recordings.  Of what it has not begun when this one is done with that, this one draws from the last, too, where it is
more than a few.  Where it dies, or where there is none, this process does its work.
"""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Generic, TypeVar

from fracid.safety.environment import ignore_settings

T = TypeVar("T")


@dataclass(frozen=True)
class Drawer:
    """Who draws: the process beside this one, or this one.

    A thread gives the process one piece after the other; those that wait for it can be taken back.

    Examples
    --------
    >>> length = Drawer(None).asked(len, "alpha")
    >>> length()
    5
    """

    pool: ProcessPoolExecutor | None
    """Of one process; None where this one does all."""
    giver: ThreadPoolExecutor = field(default_factory=partial(ThreadPoolExecutor, 1))

    def asked(self, work: Callable[..., T], *what: Any) -> Asked[T]:
        """Have something done; what is given back waits for its result."""
        return Asked(work, what, None if self.pool is None else self.giver.submit(_beside, self.pool, work, *what))


def _beside(pool: ProcessPoolExecutor, work: Callable[..., T], *what: Any) -> T:
    try:
        future = pool.submit(work, *what)
    except (OSError, RuntimeError) as error:  # it has died, or ends
        raise BrokenExecutor from error
    return future.result()


@dataclass(frozen=True)
class Asked(Generic[T]):
    """Something to do, and its future where the process may have it."""

    work: Callable[..., T]
    what: tuple[Any, ...]
    future: Future[T] | None

    @property
    def waits(self) -> bool:
        """Whether the process has it to do, and has not begun."""
        return self.future is not None and not (self.future.running() or self.future.done())

    def __call__(self, *, patient: bool = False) -> T:
        """Its result: waited for where the process has begun, or by who is patient; else here and now."""
        if self.future is not None and (patient or not self.future.cancel()):
            with suppress(BrokenExecutor):
                return self.future.result()
        return self.work(*self.what)

    def drop(self) -> None:
        """Have nobody begin it; what is begun is waited for."""
        if self.future is not None and not self.future.cancel():
            wait([self.future])


@contextmanager
def drawer(jobs: int) -> Iterator[Drawer]:
    """Start the process, with two jobs or more; it ends when the block does, and with what ends that early.

    Examples
    --------
    >>> with drawer(1) as alone:
    ...     alone.asked(len, "alpha")()
    5
    """
    from fracid.tasks.local import (
        UNSTARTED,
        deaf_to_ctrl_c,
        fresh_processes,
        without_main,
    )  # not above: help would wait

    pool = None
    with ThreadPoolExecutor(1) as giver:
        try:
            with suppress(*UNSTARTED):  # where none can be started, this one draws
                if jobs > 1:
                    pool = fresh_processes(1, _prepare)
                    with deaf_to_ctrl_c(), without_main():
                        pool.submit(int)  # starts it
            yield Drawer(pool, giver)
        finally:
            for process in list((getattr(pool, "_processes", None) or {}).values()):
                process.terminate()  # left to itself it takes apart all that it imported, and an exit waits for that
            if pool is not None:  # waits: an exit that comes meanwhile writes to a pipe that is just closed
                pool.shutdown(cancel_futures=True)


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

        import fracid.plots
        import fracid.validation.residual_analyses  # noqa: F401
