"""A task, the job that a worker gets of it, and how it ended.

========================  ================================================================================
:class:`Task`             one repetition: its key, and the arguments of the work
:class:`Job`              the work and the arguments that all tasks share: sent to each worker once
:func:`perform`           does the work in this process, :func:`perform_elsewhere` in another
:class:`Ended`            JSON text, or the traceback as text: passes between any two processes
:class:`Stopped`          why a study cannot continue
========================  ================================================================================

Linear algebra runs on one thread (:func:`one_blas_thread`): a sum split over threads rounds differently, and results
would depend on the machine's number of cores.
"""

from __future__ import annotations

import json
import pickle
import threading
import time
import traceback
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from fracid.errors import InputError
from fracid.safety.door import text_of
from fracid.tasks import SAYS
from fracid.tasks.folder_lock import Json

FEW = 3
"""Repetitions whose time says how long the others take; the first ones wait for processes and compilation."""

_In = TypeVar("_In")
_Out = TypeVar("_Out")

Work = Callable[..., Json]
"""Does one task: a function of a module, given the task's arguments."""


@dataclass(frozen=True)
class Task:
    """One repetition."""

    key: str
    """Unique in a study and stable: ``level 0.1 deg, 4096 counts, seed 17``."""
    arguments: tuple[Any, ...]
    """Arguments of the function that does it; for processes and clusters they are pickled."""


@dataclass(frozen=True)
class Progress:
    """How far a study is."""

    done: int
    total: int | None
    """None where nobody knows, as of a search that stops when it has converged."""
    earlier: int
    """Of `done`, those that were in the journal before."""
    seconds: float
    """Since this process began [s]."""
    best: float | None = None
    """The lowest cost so far, where all costs are of the same data and model."""
    unit: str = ""
    """Of `best`, where it has one."""
    note: str = ""
    """What is being done, where that changes."""
    even: bool = True
    """Whether each takes about as long as the others."""
    about: bool = False
    """Whether `total` is an estimate."""

    @property
    def rate(self) -> float:
        """Repetitions a second, in this process."""
        return (self.done - self.earlier) / self.seconds if self.seconds > 0 else 0.0

    @property
    def left(self) -> float | None:
        """Seconds to the end at this rate; None before the first few have ended, and where nobody can know it."""
        known = self.even and not self.about and self.done - self.earlier >= FEW
        return (self.total - self.done) / self.rate if known and self.total is not None and self.rate > 0 else None


class Stopped(Exception):
    """Why a study cannot go on, in a sentence."""


# --- one repetition ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Ended:
    """What became of a repetition; plain values alone, so that it passes between any two processes."""

    text: str
    """The result, JSON; empty where it failed."""
    seconds: float
    failure: str = ""
    """What it raised, in a line."""
    where: str = ""
    """The traceback."""


def perform(work: Work, arguments: tuple[Any, ...]) -> Ended:
    """Do the work, here; what it raises is the text of the end."""
    start_time = time.perf_counter()
    try:
        text = json.dumps(work(*arguments), ensure_ascii=False, allow_nan=False)
    except Exception as error:
        message = f"{type(error).__name__}: {error}"
        return Ended("", time.perf_counter() - start_time, message, traceback.format_exc())
    return Ended(text, time.perf_counter() - start_time)


@dataclass(frozen=True)
class Job:
    """What a study's tasks have in common: sent to a worker once, and not with every task."""

    version: str
    work: Work
    common: dict[int, Any]
    """Position → the argument, one object in all tasks: a problem with its samples, mostly."""

    @classmethod
    def of(cls, work: Work, tasks: Sequence[Task]) -> Job:
        """Pack work and tasks; what all tasks share is sent once."""
        from fracid._version import __version__

        first, *others = tasks
        common = {i: value for i, value in enumerate(first.arguments)
                  if others and all(len(t.arguments) > i and t.arguments[i] is value for t in others)}  # fmt: skip
        return cls(__version__, work, common)

    def own(self, task: Task) -> dict[int, Any]:
        """The arguments that are a task's own."""
        return {i: value for i, value in enumerate(task.arguments) if i not in self.common}

    def packed(self, dumps: Callable[[Any], bytes] = pickle.dumps) -> bytes:
        """For the way."""
        try:
            return dumps(self)
        except (TypeError, AttributeError, pickle.PickleError) as error:
            raise InputError(SAYS("not-sent", error=error)) from None


def perform_elsewhere(own: dict[int, Any], job: Job) -> Ended:
    """In another process, whose fracid must be ours."""
    from fracid._version import __version__

    if job.version != __version__:
        return Ended("", 0.0, f"the worker has fracid {__version__}, this is {job.version}: install the same")
    _settle()
    arguments = {**job.common, **own}
    return perform(job.work, tuple(arguments[i] for i in range(len(arguments))))


unpacked: Callable[[bytes], Job] = pickle.loads
"""The job that was packed."""


class Counter:
    """Tells how many are done, as they end on any thread.

    Examples
    --------
    >>> count = Counter(lambda p: print(p.done, "of", p.total), 2)
    >>> count(2)
    2 of 2
    """

    def __init__(self, progress: Callable[[Progress], None] | None, total: int, *, about: bool = False) -> None:
        """Of about or exactly so many."""
        self._progress, self._done, self._total, self._about = progress, 0, total, about
        self._began, self._lock = time.perf_counter(), threading.Lock()

    def expect(self, more: int) -> None:
        """So many more than was thought, or fewer."""
        with self._lock:
            self._total += more

    def __call__(self, more: int = 1) -> None:
        """So many more are done."""
        with self._lock:
            self._done += more
            if self._progress is not None:
                total, seconds = max(self._total, self._done), time.perf_counter() - self._began
                self._progress(Progress(self._done, total, 0, seconds, about=self._about))


def in_threads(jobs: int, work: Callable[[_In], _Out], items: Iterable[_In]) -> list[_Out]:
    """All results in their order; Ctrl-C waits for what runs and leaves out the rest.

    Examples
    --------
    >>> in_threads(2, abs, [-1, 2])
    [1, 2]
    """
    with closing(ThreadPoolExecutor(jobs)) as pool:
        return list(pool.map(work, items))


@contextmanager
def closing(pool: Executor) -> Iterator[Executor]:
    """A pool that ends with the block: what runs may end, and what has not begun is left out."""
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def one_blas_thread() -> Any:
    """Hold linear algebra in this process to one thread from now on; gives the context that lets go of it again."""
    import scipy.linalg  # noqa: F401 (brings a library of its own, which must be there to be held)
    from threadpoolctl import threadpool_limits

    return threadpool_limits(1, "blas")


_settle = cache(one_blas_thread)


def failure_of(task: Task, outcome: Ended | BaseException) -> Stopped | None:
    """Why a repetition has no result; None where it has one."""
    if isinstance(outcome, BaseException):
        return Stopped(f"The repetition {task.key!r} cannot be sent or read back: {outcome}.")
    if outcome.text:
        return None
    failure = Stopped(f"The repetition {task.key!r} failed: {outcome.failure.removesuffix('.')}.")
    failure.__cause__ = _Traceback(outcome.where)
    return failure


class _Traceback(Exception):
    """The traceback of another thread or process, as text."""

    def __str__(self) -> str:
        return f"\n{self.args[0]}"


# --- threads and processes ---------------------------------------------------------------------------

Ends = Generator[tuple[Task, Ended], None, list[Task]]
"""Yields each task as it ends; returns those that were under way when a worker died."""


def free_memory() -> int | None:
    """Bytes that this process may still take, of the machine and of its container; None where nobody says.

    Examples
    --------
    >>> free = free_memory()
    >>> free is None or free > 0
    True
    """
    bounds = []
    with suppress(OSError, ValueError, IndexError):
        rows = dict(line.split(":") for line in text_of(Path("/proc/meminfo")).splitlines())
        bounds.append(1024 * int(rows["MemAvailable"].split()[0]))
    with suppress(OSError, ValueError):  # "max", where there is no limit
        group = Path("/sys/fs/cgroup")
        bounds.append(int(text_of(group / "memory.max")) - int(text_of(group / "memory.current")))
    return min(bounds) if bounds else None
