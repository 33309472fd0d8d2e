"""The first run on a machine: what has to be compiled is compiled by two processes at the same time.

Numba compiles behind one lock, so threads would wait for each other.  A process beside this one compiles the start of
the method (:mod:`fracid.solver.starting`) and keeps it on disk, while this one compiles the loop and the exponentials
of the memory, and then takes it from there.  It is started only where that is not on disk yet, and can be put there;
where it dies, this one compiles.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, CancelledError
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from fracid.safety.environment import ignore_settings
from fracid.solver.methods import METHODS
from fracid.tasks.local import deaf_to_ctrl_c, follow_parent, fresh_processes, without_main
from fracid.workflows.drawer import ended_with_this

if TYPE_CHECKING:
    from concurrent.futures import Future

    from fracid.solver.compilation import Kernel


@contextmanager
def compiling_beside(method: str, jobs: int) -> Iterator[None]:
    """Have a process beside this one compile the start of a method, if it is not on disk and `jobs` is 2 or more."""
    if jobs < 2 or not METHODS[method].started or not (kernel := _start()).can_be_kept():
        yield
        return
    pool = None
    try:
        with suppress(BrokenExecutor, OSError):  # where none can be started, this one compiles
            pool = fresh_processes(1, _prepare)
            with deaf_to_ctrl_c(), without_main():
                future = pool.submit(_compile)
            kernel.beside = lambda: _ended(future, METHODS[method].family)
        with ended_with_this(pool):
            yield
    finally:
        kernel.beside = None
        if pool is not None:
            pool.shutdown(cancel_futures=True)


def _start() -> Kernel:
    from fracid.solver.starting import start_together  # not above: it takes a second to import

    return start_together


def _ended(future: Future[None], family: str) -> None:
    """Wait for it, and compile meanwhile what a fit needs next; how it ended, the disk tells."""
    if not future.done():
        from fracid.solver.exponentials import compile_exponentials

        compile_exponentials(family)
    with suppress(CancelledError):
        future.exception()


def _prepare() -> None:
    follow_parent()
    ignore_settings(Path())


def _compile() -> None:
    _start().compiled()
