"""Repetitions on the workers of a Dask scheduler.

The shared part of the job is a task of the cluster itself, so that Dask rebuilds it where a worker dies; tasks are
sent and results fetched in batches, a few for each of the cluster's threads.  A lost worker's tasks are Dask's to
repeat; a lost scheduler, or none of its workers for a minute, ends the study, whose journal has what was done.
"""

from __future__ import annotations

import logging
import pickle
import queue
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError, wait
from contextlib import contextmanager
from itertools import islice
from typing import Any

from fracid.errors import InputError, installed
from fracid.tasks import SAYS
from fracid.tasks.job import Ended, Job, Stopped, Task, Work, failure_of, perform_elsewhere, unpacked

# --- a cluster -----------------------------------------------------------------------------------------

ANSWER = 10.0
"""A scheduler answers within this, or is not there [s]."""

IDLE = 2.0
"""Where nothing has come back for so long, it is time to look why [s]."""

FAILED = ("error", "cancelled")
"""States of a future that no waiting changes; one that is lost, Dask computes again."""

WINDOW = 4
"""Tasks on the way, for each of a cluster's threads."""

PATIENCE = 60.0
"""A study waits so long for a worker, where there is none [s]."""


def on_cluster(work: Work, tasks: Sequence[Task], address: str) -> Iterator[tuple[Task, Ended]]:
    """Tasks as Dask's; a worker that is lost is Dask's business too, which does its tasks again elsewhere."""
    with _client(address) as client:
        try:
            yield from _from_cluster(client, Job.of(work, tasks), iter(tasks), address)
        except (CancelledError, OSError):  # OSError: also every broken connection
            raise Stopped(f"The Dask scheduler at {address} is gone.") from None


def _from_cluster(client: Any, job: Job, tasks: Iterator[Task], address: str) -> Iterator[tuple[Task, Ended]]:
    """Send and fetch many at once: a message for each would cost twice the time."""
    from cloudpickle import dumps  # sends what a script defines, too

    packed = client.submit(unpacked, job.packed(dumps), pure=False)  # a task too: it comes back if its worker dies
    ends = _Ends(client, address)
    waiting: dict[str, tuple[Any, Task]] = {}  # Dask does a task only as long as its future is kept
    window = WINDOW * max(16, sum(client.nthreads().values()))
    while True:
        batch = list(islice(tasks, window - len(waiting))) if len(waiting) <= window // 2 else []
        own = [job.own(task) for task in batch]
        try:
            futures = client.map(perform_elsewhere, own, job=packed, pure=False) if batch else []
        except (TypeError, AttributeError, pickle.PickleError) as error:
            raise Stopped(f"The repetition {batch[0].key!r}, or one after it, cannot be sent: {error}.") from None
        for future, task in zip(futures, batch, strict=True):
            waiting[future.key] = future, task
            future.add_done_callback(ends.put)
        if not waiting:
            return
        completions = ends.wait()
        failed = [f for f in completions if f.status in FAILED]
        failures = [_given_up(waiting[f.key][1], f.exception()) for f in failed]
        whole = [f for f in completions if f not in failed]
        for future, result in zip(whole, ends.results(whole), strict=True):
            task = waiting.pop(future.key)[1]
            if failure := failure_of(task, result):
                failures.append(failure)
            else:
                yield task, result
        if failures:
            raise failures[0]


class _Ends:
    """Futures that have ended, as Dask's thread puts them; a result that is lost with its worker has not ended yet.

    While nothing ends, the scheduler may be gone, or the first worker be waited for too long.
    """

    def __init__(self, client: Any, address: str) -> None:
        self._client, self._address, self._since = client, address, time.monotonic()
        self._queue: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._heard: list[Any] = []
        self.put = self._queue.put

    def wait(self) -> list[Any]:
        """All that has ended, one at least."""
        while True:
            try:
                self._heard.append(self._queue.get(timeout=IDLE))
            except queue.Empty:
                self._look()
            self._heard += [self._queue.get() for _ in range(self._queue.qsize())]
            if ended := [f for f in self._heard if f.status in (*FAILED, "finished")]:
                self._heard = [f for f in self._heard if f not in ended]
                return ended

    def results(self, futures: list[Any]) -> list[Any]:
        """Their results; where a worker is lost before it has given its own, Dask waits for it, or for another's."""
        from asyncio import run_coroutine_threadsafe  # here: 40 ms, which no other command needs

        gathered = self._client.gather(futures, asynchronous=True)
        fetched = run_coroutine_threadsafe(gathered, self._client.loop.asyncio_loop)
        try:
            while not wait([fetched], IDLE).done:
                self._look()
            return list(fetched.result())
        finally:
            fetched.cancel()

    def _look(self) -> None:
        """End the study where there is nothing to wait for."""
        if self._client.status != "running":
            raise Stopped(f"The Dask scheduler at {self._address} is gone.")
        if self._client.nthreads():
            self._since = time.monotonic()
        elif time.monotonic() - self._since > PATIENCE:
            raise Stopped(SAYS("no-worker", address=self._address, patience=PATIENCE))


def _given_up(task: Task, error: BaseException) -> Stopped:
    from distributed.scheduler import KilledWorker

    died = "every worker that tried it died (out of memory, or a crash in compiled code)"
    return Stopped(f"The repetition {task.key!r} was given up: {died if isinstance(error, KilledWorker) else error}.")


@contextmanager
def _client(address: str) -> Iterator[Any]:
    with installed(SAYS("no-dask", address=address)):
        from distributed import Client
        from distributed.utils import silence_logging_cmgr
    try:
        client = Client(address, timeout=ANSWER, set_as_default=False)
    except Exception as error:  # OSError: nothing there; ValueError: no address; what else answers may say anything
        reason = next(iter(str(error).splitlines()), type(error).__name__)
        raise InputError(SAYS("no-answer", address=address, reason=reason)) from None
    with silence_logging_cmgr(logging.CRITICAL):  # what went wrong we say ourselves
        try:
            yield client
        finally:
            client.close(timeout=1.0)
