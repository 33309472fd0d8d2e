"""Repetitions on this machine: on threads or on processes.

At most 2 × `jobs` tasks are submitted at once, so that a study of millions waits in this process and not in a queue.
Processes are spawned, not forked: a fork of a process with threads may hang.  A worker that dies takes its pool along;
the tasks under way then run one by one, alone, and the one that kills its worker again is named.  Ctrl-C reaches the
parent only, and workers end when their parent is gone.

Where no process can be started (a limit of the system, no shared memory) threads do the work: the result is the same,
and a sentence says so.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from contextlib import AbstractContextManager, contextmanager
from functools import cache
from multiprocessing import resource_tracker
from pathlib import Path
from types import ModuleType
from typing import Any

from fracid.safety.environment import ignore_settings, instead
from fracid.tasks import SAYS
from fracid.tasks.ending import undisturbed
from fracid.tasks.job import (
    Ended,
    Ends,
    Job,
    Stopped,
    Task,
    Work,
    closing,
    failure_of,
    one_blas_thread,
    perform,
    perform_elsewhere,
    unpacked,
)

LOG = logging.getLogger("fracid.tasks")
"""Where nobody listens, Python prints its warnings on standard error."""

UNSTARTED = (OSError, ImportError, RuntimeError)
"""What starting a process raises where the system has none, or no semaphore, to give."""

SILENT = "ignore:resource_tracker:UserWarning"
"""To Python's tracker of semaphores, which warns of each that it removes, as it should after a kill."""


def _in_flight(submit: Callable[[Task], Future[Ended]], tasks: Iterator[Task], window: int) -> Ends:
    """Keep `window` tasks under way, so that a study of millions waits here and not in a queue."""
    waiting: dict[Future[Ended], Task] = {}
    orphans: list[Task] = []
    stopped: BaseException | None = None
    while True:
        try:
            while len(waiting) < window and not (orphans or stopped) and (task := next(tasks, None)) is not None:
                try:
                    waiting[submit(task)] = task
                except BrokenExecutor:
                    orphans.append(task)
            if not waiting:
                break
            completions, _ = wait(waiting, return_when=FIRST_COMPLETED)
        except KeyboardInterrupt as interruption:
            if stopped:
                raise
            stopped, completions = interruption, set()
        for future in [future for future in waiting if future in completions]:  # in their order
            task = waiting.pop(future)
            if isinstance(future.exception(), BrokenExecutor):
                orphans.append(task)
            elif failure := failure_of(task, future.exception() or future.result()):
                stopped = stopped or failure
            else:
                yield task, future.result()
        if stopped:  # what is under way may end
            waiting = {future: task for future, task in waiting.items() if not future.cancel()}
    if stopped:
        raise stopped
    return orphans


def on_threads(work: Work, tasks: Sequence[Task], jobs: int) -> Iterator[tuple[Task, Ended]]:
    """Do the tasks on threads, in any order."""
    with one_blas_thread(), closing(ThreadPoolExecutor(jobs, "fracid")) as pool:
        yield from _in_flight(lambda task: pool.submit(perform, work, task.arguments), iter(tasks), 2 * jobs)


def on_processes(work: Work, tasks: Sequence[Task], jobs: int) -> Iterator[tuple[Task, Ended]]:
    """Do the tasks on processes, in any order; on threads, those that are left where none can be started."""
    done = set()
    try:
        for task, outcome in _on_processes(work, tasks, jobs):
            done.add(task.key)
            yield task, outcome
    except UNSTARTED as error:
        LOG.warning(f"No process can be started here ({error}): threads do the work, with the same result.")
        yield from on_threads(work, [task for task in tasks if task.key not in done], jobs)


def _on_processes(work: Work, tasks: Sequence[Task], jobs: int) -> Iterator[tuple[Task, Ended]]:
    """A worker that dies takes its pool along; what was under way is then done one by one, to find who kills."""
    job, backlog = Job.of(work, tasks), iter(tasks)
    packed = job.packed()
    while orphans := (yield from _in_a_pool(job, packed, backlog, jobs, window=2 * jobs)):
        if killers := (yield from _in_a_pool(job, packed, iter(orphans), 1, window=1)):
            raise Stopped(SAYS("given-up", key=killers[0].key))


def _in_a_pool(job: Job, packed: bytes, tasks: Iterator[Task], jobs: int, window: int) -> Ends:
    with closing(fresh_processes(jobs, _prepare_worker, packed)) as pool:

        def start(task: Task) -> Future[Ended]:
            with deaf_to_ctrl_c():  # the first ones start the processes
                return pool.submit(_do_here, job.own(task))

        return (yield from _in_flight(start, tasks, window))


_PACKED: list[bytes] = []
"""In a worker process: its job, unpacked by the first task, whose failure can be told."""


_job_here = cache(unpacked)


def _do_here(own: dict[int, Any]) -> Ended:
    return perform_elsewhere(own, _job_here(_PACKED[0]))


def _prepare_worker(packed: bytes) -> None:
    follow_parent()
    ignore_settings(Path())
    _PACKED.append(packed)


@contextmanager
def deaf_to_ctrl_c() -> Iterator[None]:
    """Have processes that are started meanwhile not hear Ctrl-C, from their first moment on: it is their parent's."""
    if (mask := getattr(signal, "pthread_sigmask", None)) is None:  # Windows
        yield
        return
    resource_tracker.ensure_running()  # the first start of a process would start it, and so end the block
    before = mask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        with undisturbed():
            yield
    finally:
        mask(signal.SIG_SETMASK, before)


def without_main() -> AbstractContextManager[None]:
    """Have processes that are started meanwhile not run this one's script, which they do to find what it defines.

    One without ``if __name__ == "__main__"`` would begin anew in each of them.
    """
    return instead(sys.modules, "__main__", ModuleType("__main__"))


def fresh_processes(jobs: int, prepare: Callable[..., None], *given: Any) -> ProcessPoolExecutor:
    """A pool of spawned processes, each of which begins with `prepare(*given)`: a fork of one with threads may hang.

    What removes its semaphores where this process is killed does so in silence.
    """
    if sys.platform != "win32":
        sys.warnoptions.append(SILENT)
        try:
            resource_tracker.ensure_running()
        finally:
            sys.warnoptions.remove(SILENT)
    return ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), prepare, given)


def follow_parent() -> None:
    """In a worker process: Ctrl-C is the parent's business; and when the parent is gone, go too."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None and not parent.is_alive():
        os._exit(1)  # at once: the next thing that is asked of the parent would raise

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
