"""Do many independent repetitions: on threads, on processes, or on a cluster, with the same result.

A study (noise levels, starts, resampled recordings, recordings left out) is a list of :class:`Task`, and a function
that does one.  :func:`run_tasks` does them all, keeps each result in a journal as it ends, and can be killed at
any moment.

=================== ====================================================================================
executor            where a repetition runs
=================== ====================================================================================
``threads``         in this process: no start-up, one interpreter; for work that is mostly compiled
``processes``       in `jobs` processes of this machine: for work that is mostly Python
``tcp://HOST:PORT`` on the workers of a Dask scheduler (``pip install 'fracid[cluster]'``), as many as there are
=================== ====================================================================================

**The same result.**  A task's key and arguments, its seed among them, say all that it depends on; results pass
through JSON text, whose numbers are exact, and come back in the order of the tasks; linear algebra runs on one thread,
since a sum split over several rounds otherwise.  So results are equal to the bit for every executor and
any number of jobs, between machines as far as their processors have the same instructions.

**What can die.**  A worker: its task is done again by another.  A task that kills its worker twice, the second
time alone in its process, is named, and the study ends.  The scheduler, or this process: what was done
is in the journal.  A function that raises ends the study too: what a repetition may meet (a run that diverges) it
must catch and return.  Ctrl-C starts nothing new and keeps what is under way here, and what has come back of a cluster.
"""

from __future__ import annotations

import json
import logging
import multiprocessing
import os
import pickle
import queue
import signal
import threading
import time
import traceback
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from itertools import islice
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any

from fracid.errors import InputError, Unfinished
from fracid.journal import Journal, Json, resumable
from fracid.optimise.base import at_least
from fracid.surroundings import ignore_settings

__all__ = ["EXECUTORS", "Progress", "Task", "deaf_to_ctrl_c", "executor_from_name", "follow_parent", "run_tasks"]

Work = Callable[..., Json]
"""Does one task: a function of a module, given the task's arguments."""


@dataclass(frozen=True)
class Task:
    """One repetition."""

    key: str
    """Unique in a study and stable: ``level 0.1 deg, 4096 counts, seed 17``."""
    arguments: tuple[Any, ...]
    """Of the function that does it; for processes and clusters they are pickled."""


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
    """The lowest ``cost`` among the results, where they have one."""

    @property
    def rate(self) -> float:
        """Repetitions a second, in this process."""
        return (self.done - self.earlier) / self.seconds if self.seconds > 0 else 0.0

    @property
    def left(self) -> float | None:
        """Seconds to the end at this rate; None before the first has ended, or where the end is not known."""
        return (self.total - self.done) / self.rate if self.total is not None and self.rate > 0 else None


def run_tasks(
    work: Work,
    tasks: Sequence[Task],
    *,
    executor: str = "threads",
    jobs: int = 1,
    journal: Journal | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> dict[str, Json]:
    """Do every task that the journal has not yet.

    Parameters
    ----------
    work : function of a task's arguments -> JSON value
        A function of a module.  It returns plain values: dict, list, str, float, None, no NaN.
    tasks : sequence of Task
    executor : str
        See the module's table.
    jobs : int
        Threads or processes; a cluster has its own.
    journal : Journal, optional
        Has what was done before, and gets each result as it ends.
    progress : function (Progress) -> None, optional
        Called at the beginning and after each.

    Returns
    -------
    dict
        Key → result, in the order of `tasks`.

    Raises
    ------
    InputError
        For two tasks of one key, an executor that there is not, or a function that is not a module's.
    Unfinished
        Where something ended the study early: a repetition that raised, a worker that died twice, a scheduler that is
        gone, a full disk, Ctrl-C.  The journal has what was done.

    Examples
    --------
    >>> import math
    >>> run_tasks(math.hypot, [Task("3, 4", (3.0, 4.0)), Task("5, 12", (5.0, 12.0))], jobs=2)
    {'3, 4': 5.0, '5, 12': 13.0}
    """
    run = executor_from_name(executor)
    _check(work, tasks, executor)
    at_least("jobs", jobs, 1)
    done = {t.key: journal.done[t.key] for t in tasks if journal is not None and t.key in journal.done}
    left = [t for t in tasks if t.key not in done]
    watch = _Watch(len(tasks), done, progress)
    if left:
        try:
            for task, ended in run(work, left, jobs):
                done[task.key] = json.loads(ended.text)
                if journal is not None:
                    journal.append(task.key, done[task.key], ended.seconds)
                watch.tell(done[task.key])
        except KeyboardInterrupt:
            raise Unfinished(f"Interrupted. {_kept(len(done), len(tasks), journal)}") from None
        except _Stopped as stopped:
            raise Unfinished(f"{stopped} {_kept(len(done), len(tasks), journal)}") from stopped.__cause__
    return {t.key: done[t.key] for t in tasks}


def _kept(done: int, total: int, journal: Journal | None) -> str:
    if journal is None:
        return f"{done} of {total} repetitions were done."
    return f"{done} of {total} repetitions are done and kept; fracid resume {resumable(journal.path)} goes on."


class _Watch:
    """Counts, and tells `progress`."""

    def __init__(self, total: int, done: dict[str, Json], progress: Callable[[Progress], None] | None) -> None:
        self._total, self._done, self._earlier, self._progress = total, done, len(done), progress
        self._began = time.perf_counter()
        self._best: float | None = None
        for value in done.values():
            self._look(value)
        self._tell()

    def tell(self, value: Json) -> None:
        self._look(value)
        self._tell()

    def _look(self, value: Json) -> None:
        cost = value.get("cost") if isinstance(value, dict) else None
        if isinstance(cost, float) and (self._best is None or cost < self._best):
            self._best = cost

    def _tell(self) -> None:
        if self._progress is not None:
            seconds = time.perf_counter() - self._began
            self._progress(Progress(len(self._done), self._total, self._earlier, seconds, self._best))


class _Stopped(Exception):
    """Why a study cannot go on, in a sentence."""


# --- what is refused ---------------------------------------------------------------------------------


def _check(work: Work, tasks: Sequence[Task], executor: str) -> None:
    seen: set[str] = set()
    for task in tasks:
        if task.key in seen:
            raise InputError(f"Two tasks have the key {task.key!r}; a key names one repetition.")
        seen.add(task.key)
    name = getattr(work, "__qualname__", "")
    if executor != "threads" and (not name or "<" in name or not hasattr(work, "__module__")):
        raise InputError(f"{work!r} cannot be sent to other processes: give a function of a module, or threads.")


def executor_from_name(name: str) -> Callable[[Work, Sequence[Task], int], Iterator[tuple[Task, _Ended]]]:
    """Find what runs tasks; a scheduler's address is not tried.

    Raises
    ------
    InputError
        If there is none of that name, and it is no address.

    Examples
    --------
    >>> callable(executor_from_name("threads"))
    True
    """
    if name in EXECUTORS:
        return EXECUTORS[name]
    if "://" in str(name):
        return lambda work, tasks, _: _on_cluster(work, tasks, name)
    raise InputError(
        f"There is no executor {name!r}; type one of {', '.join(EXECUTORS)}, or the address of a Dask scheduler, "
        "tcp://HOST:8786."
    )


# --- one repetition ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Ended:
    """What became of a repetition; plain values alone, so that it passes between any two processes."""

    text: str
    """The result, JSON; empty where it failed."""
    seconds: float
    failure: str = ""
    """What it raised, in a line."""
    where: str = ""
    """The traceback."""


def _do(work: Work, arguments: tuple[Any, ...]) -> _Ended:
    began = time.perf_counter()
    try:
        text = json.dumps(work(*arguments), ensure_ascii=False, allow_nan=False)
    except Exception as error:
        said = f"{type(error).__name__}: {error}"
        return _Ended("", time.perf_counter() - began, said, traceback.format_exc())
    return _Ended(text, time.perf_counter() - began)


@dataclass(frozen=True)
class _Job:
    """What a study's tasks have in common: sent to a worker once, and not with every task."""

    version: str
    work: Work
    common: dict[int, Any]
    """Position → the argument, one object in all tasks: a problem with its samples, mostly."""

    @classmethod
    def of(cls, work: Work, tasks: Sequence[Task]) -> _Job:
        from fracid import __version__

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
            raise InputError(
                f"This study cannot be sent to other processes: {error}. Type --executor threads."
            ) from None


def _do_elsewhere(own: dict[int, Any], job: _Job) -> _Ended:
    """In another process, whose fracid must be ours."""
    from fracid import __version__

    if job.version != __version__:
        return _Ended("", 0.0, f"the worker has fracid {__version__}, this is {job.version}: install the same")
    _settle()
    arguments = {**job.common, **own}
    return _do(job.work, tuple(arguments[i] for i in range(len(arguments))))


def _unpacked(packed: bytes) -> _Job:
    job: _Job = pickle.loads(packed)
    return job


@cache
def _settle() -> Any:
    return _one_blas_thread()


def _one_blas_thread() -> Any:
    """Hold linear algebra in this process to one thread from now on; gives the context that lets go of it again."""
    import scipy.linalg  # noqa: F401 (brings a library of its own, which must be there to be held)
    from threadpoolctl import threadpool_limits

    return threadpool_limits(1, "blas")


def _failure(task: Task, ended: _Ended | BaseException) -> _Stopped | None:
    """Why a repetition has no result; None where it has one."""
    if isinstance(ended, BaseException):
        return _Stopped(f"The repetition {task.key!r} cannot be sent or read back: {ended}.")
    if ended.text:
        return None
    failure = _Stopped(f"The repetition {task.key!r} failed: {ended.failure}.")
    failure.__cause__ = _Traceback(ended.where)
    return failure


class _Traceback(Exception):
    """The traceback of another thread or process, as text."""

    def __str__(self) -> str:
        return f"\n{self.args[0]}"


# --- threads and processes ---------------------------------------------------------------------------

Ends = Generator[tuple[Task, _Ended], None, list[Task]]
"""Yields each task as it ends; returns those that were under way when a worker died."""


def _in_flight(submit: Callable[[Task], Future[_Ended]], tasks: Iterator[Task], window: int) -> Ends:
    """Keep `window` tasks under way, so that a study of millions waits here and not in a queue."""
    waiting: dict[Future[_Ended], Task] = {}
    lost: list[Task] = []
    stopped: BaseException | None = None
    while True:
        try:
            while len(waiting) < window and not (lost or stopped) and (task := next(tasks, None)) is not None:
                _submit(submit, task, waiting, lost)
            if not waiting:
                break
            ended, _ = wait(waiting, return_when=FIRST_COMPLETED)
        except KeyboardInterrupt as interruption:
            if stopped:
                raise
            stopped, ended = interruption, set()
        for future in [future for future in waiting if future in ended]:  # in their order
            task = waiting.pop(future)
            if isinstance(future.exception(), BrokenExecutor):
                lost.append(task)
            elif failure := _failure(task, future.exception() or future.result()):
                stopped = stopped or failure
            else:
                yield task, future.result()
        if stopped:  # what is under way may end
            waiting = {future: task for future, task in waiting.items() if not future.cancel()}
    if stopped:
        raise stopped
    return lost


def _submit(
    submit: Callable[[Task], Future[_Ended]], task: Task, waiting: dict[Future[_Ended], Task], lost: list[Task]
) -> None:
    try:
        waiting[submit(task)] = task
    except BrokenExecutor:
        lost.append(task)


def _on_threads(work: Work, tasks: Sequence[Task], jobs: int) -> Iterator[tuple[Task, _Ended]]:
    with _one_blas_thread(), _closing(ThreadPoolExecutor(jobs, "fracid")) as pool:
        yield from _in_flight(lambda task: pool.submit(_do, work, task.arguments), iter(tasks), 2 * jobs)


def _on_processes(work: Work, tasks: Sequence[Task], jobs: int) -> Iterator[tuple[Task, _Ended]]:
    """A worker that dies takes its pool along; what was under way is then done one by one, to find who kills."""
    job, left = _Job.of(work, tasks), iter(tasks)
    packed = job.packed()
    while lost := (yield from _in_a_pool(job, packed, left, jobs, 2 * jobs)):
        if killers := (yield from _in_a_pool(job, packed, iter(lost), 1, 1)):
            raise _Stopped(
                f"The repetition {killers[0].key!r} was given up: a worker process died twice while it ran, the second "
                "time with nothing beside it (killed from outside, out of memory, or a crash in compiled code)."
            )


def _in_a_pool(job: _Job, packed: bytes, tasks: Iterator[Task], jobs: int, window: int) -> Ends:
    fresh = multiprocessing.get_context("spawn")  # a fork of a process with threads may hang
    with _closing(ProcessPoolExecutor(jobs, fresh, _prepare_worker, (packed,))) as pool:

        def start(task: Task) -> Future[_Ended]:
            with deaf_to_ctrl_c():  # the first ones start the processes
                return pool.submit(_do_here, job.own(task))

        return (yield from _in_flight(start, tasks, window))


_PACKED: list[bytes] = []
"""In a worker process: its job, unpacked by the first task, whose failure can be told."""


@cache
def _job_here() -> _Job:
    return _unpacked(_PACKED[0])


def _do_here(own: dict[int, Any]) -> _Ended:
    return _do_elsewhere(own, _job_here())


@contextmanager
def _closing(pool: Executor) -> Iterator[Executor]:
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def _prepare_worker(packed: bytes) -> None:
    ignore_settings(Path())
    _PACKED.append(packed)
    follow_parent()


@contextmanager
def deaf_to_ctrl_c() -> Iterator[None]:
    """Have processes that are started meanwhile not hear Ctrl-C, from their first moment on: it is their parent's."""
    mask = getattr(signal, "pthread_sigmask", None)
    if mask is None:  # Windows
        yield
        return
    resource_tracker.ensure_running()  # the first start of a process would start it, and so end the block
    before = mask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        mask(signal.SIG_SETMASK, before)


def follow_parent() -> None:
    """In a worker process: Ctrl-C is the parent's business; and when the parent is gone, go too."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


# --- a cluster -----------------------------------------------------------------------------------------

ANSWER = 10.0
"""A scheduler answers within this, or is not there [s]."""

IDLE = 2.0
"""Where nothing has come back for so long, it is time to look why [s]."""

WINDOW = 4
"""Tasks on the way, for each of a cluster's threads."""

PATIENCE = 60.0
"""A study waits so long for a worker, where there is none [s]."""


def _on_cluster(work: Work, tasks: Sequence[Task], address: str) -> Iterator[tuple[Task, _Ended]]:
    """Tasks as Dask's; a worker that is lost is Dask's business too, which does its tasks again elsewhere."""
    with _client(address) as client:
        try:
            yield from _from_cluster(client, _Job.of(work, tasks), iter(tasks), address)
        except (CancelledError, OSError):  # OSError: also every broken connection
            raise _Stopped(f"The Dask scheduler at {address} is gone.") from None


def _from_cluster(client: Any, job: _Job, tasks: Iterator[Task], address: str) -> Iterator[tuple[Task, _Ended]]:
    """Send and fetch many at once: a message for each would cost twice the time."""
    from cloudpickle import dumps  # sends what a script defines, too

    packed = client.submit(_unpacked, job.packed(dumps), pure=False)  # a task too: it comes back if its worker dies
    ends: queue.SimpleQueue[Any] = queue.SimpleQueue()
    waiting: dict[str, tuple[Any, Task]] = {}  # Dask does a task only as long as its future is kept
    window = WINDOW * max(16, sum(client.nthreads().values()))
    alone = _Alone(client, address)
    while True:
        batch = list(islice(tasks, window - len(waiting))) if len(waiting) <= window // 2 else []
        own = [job.own(task) for task in batch]
        try:
            futures = client.map(_do_elsewhere, own, job=packed, pure=False) if batch else []
        except (TypeError, AttributeError, pickle.PickleError) as error:
            raise _Stopped(f"The repetition {batch[0].key!r}, or one after it, cannot be sent: {error}.") from None
        for future, task in zip(futures, batch, strict=True):
            waiting[future.key] = future, task
            future.add_done_callback(ends.put)
        if not waiting:
            return
        ended = _drained(ends, alone.check)
        whole = [f for f in ended if f.status == "finished"]
        failures = [_given_up(waiting[f.key][1], f.exception()) for f in ended if f.status != "finished"]
        for future, result in zip(whole, client.gather(whole), strict=True):
            task = waiting.pop(future.key)[1]
            if failure := _failure(task, result):
                failures.append(failure)
            else:
                yield task, result
        if failures:
            raise failures[0]


def _drained(ends: queue.SimpleQueue[Any], idle: Callable[[], None]) -> list[Any]:
    """All that has ended, one at least; `idle` is asked while nothing ends."""
    while True:
        try:
            ended = [ends.get(timeout=IDLE)]
        except queue.Empty:
            idle()
        else:
            return [*ended, *(ends.get() for _ in range(ends.qsize()))]


def _given_up(task: Task, error: BaseException) -> _Stopped:
    from distributed.scheduler import KilledWorker

    died = "every worker that tried it died (out of memory, or a crash in compiled code)"
    return _Stopped(f"The repetition {task.key!r} was given up: {died if isinstance(error, KilledWorker) else error}.")


@contextmanager
def _client(address: str) -> Iterator[Any]:
    try:
        from distributed import Client
        from distributed.utils import silence_logging_cmgr
    except ImportError:
        raise InputError(
            f"{address} is a Dask scheduler, for which the package distributed is missing: type "
            "pip install 'fracid[cluster]'."
        ) from None
    try:
        client = Client(address, timeout=ANSWER, set_as_default=False)
    except Exception as error:  # OSError: nothing there; ValueError: no address; what else answers may say anything
        said = next(iter(str(error).splitlines()), type(error).__name__)
        raise InputError(
            f"No Dask scheduler answers at {address}: {said}. Start one with dask scheduler and workers with dask "
            "worker ADDRESS, or leave the cluster out: --executor processes."
        ) from None
    with silence_logging_cmgr(logging.CRITICAL):  # what went wrong we say ourselves
        try:
            yield client
        finally:
            client.close(timeout=1.0)


class _Alone:
    """Ends a study that waits for a scheduler that is gone, or too long for a first worker."""

    def __init__(self, client: Any, address: str) -> None:
        self._client, self._address, self._since = client, address, time.monotonic()

    def check(self) -> None:
        if self._client.status != "running":
            raise _Stopped(f"The Dask scheduler at {self._address} is gone.")
        if self._client.nthreads():
            self._since = time.monotonic()
        elif time.monotonic() - self._since > PATIENCE:
            raise _Stopped(
                f"The Dask scheduler at {self._address} has had no worker for {PATIENCE:.0f} s: start some with dask "
                f"worker {self._address}."
            )


EXECUTORS: dict[str, Callable[[Work, Sequence[Task], int], Iterator[tuple[Task, _Ended]]]] = {
    "threads": _on_threads,
    "processes": _on_processes,
}
"""By name; see the module's table."""
