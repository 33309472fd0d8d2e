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
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from fracid.errors import InputError, Unfinished, at_least
from fracid.tasks import SAYS
from fracid.tasks.cluster import on_cluster
from fracid.tasks.folder_lock import Json
from fracid.tasks.job import Ended, Progress, Stopped, Task, Work
from fracid.tasks.journal import Journal, resuming
from fracid.tasks.local import on_processes, on_threads


@dataclass(frozen=True)
class Part:
    """What tasks are counted as, and of what longer count they are a part: for the message of an interruption.

    Examples
    --------
    >>> Part("fits", before=6, total=12).done(2)
    8
    """

    what: str = "repetitions"
    before: int = 0
    """Done before these tasks."""
    total: int | None = None
    """Of all parts; None where these tasks are all."""
    beside: bool = False
    """Whether these tasks are not counted: they use what was done."""

    def done(self, count: int) -> int:
        """How many are done when `count` of these tasks are."""
        return self.before + (0 if self.beside else count)


@dataclass(frozen=True)
class Execution:
    """How a study's repetitions run.

    Examples
    --------
    >>> import math
    >>> Execution(jobs=2).run(math.hypot, [Task("3, 4", (3.0, 4.0))])
    {'3, 4': 5.0}
    """

    executor: str = "threads"
    """Where: see the module's table."""
    jobs: int = 1
    """Threads or processes; a cluster has its own."""
    journal: Journal | None = None
    """Results of before, and the place of new ones."""
    progress: Callable[[Progress], None] | None = None
    """Called at the beginning and after each repetition."""
    part: Part = Part()
    """What the tasks are counted as."""

    def run(self, work: Work, tasks: Sequence[Task]) -> dict[str, Json]:
        """Do every task that the journal has not yet; as :func:`run_tasks`."""
        run, journal = executor_from_name(self.executor), self.journal
        _check(work, tasks, self.executor)
        at_least("jobs", self.jobs, 1)
        results = {t.key: journal.done[t.key] for t in tasks if journal is not None and t.key in journal.done}
        backlog = [t for t in tasks if t.key not in results]
        earlier, began = len(results), time.perf_counter()

        def tell() -> None:
            if self.progress is not None:
                self.progress(Progress(len(results), len(tasks), earlier, time.perf_counter() - began))

        tell()
        if backlog:
            try:
                for task, outcome in run(work, backlog, self.jobs):
                    results[task.key] = json.loads(outcome.text)
                    if journal is not None:
                        journal.append(task.key, results[task.key], outcome.seconds)
                    tell()
            except (KeyboardInterrupt, Stopped) as end:
                why = end if isinstance(end, Stopped) else "Interrupted."
                raise Unfinished(f"{why} {_kept(self.part, len(results), len(tasks), journal)}") from end.__cause__
        return {t.key: results[t.key] for t in tasks}


HERE = Execution()
"""One thread, without a journal."""


def run_tasks(work: Work, tasks: Sequence[Task], **how: Any) -> dict[str, Json]:
    """Do every task that the journal has not yet.

    Parameters
    ----------
    work : function of a task's arguments -> JSON value
        A function of a module.  It returns plain values: dict, list, str, float, None, no NaN.
    tasks : sequence of Task
    executor : str
        See the module's table; ``threads`` if left out.
    jobs : int
        Threads or processes, one if left out; a cluster has its own.
    journal : Journal, optional
        Has what was done before, and gets each result as it ends.
    progress : function (Progress) -> None, optional
        Called at the beginning and after each.
    part : Part, optional
        What the tasks are counted as.

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
    return Execution(**how).run(work, tasks)


def _kept(part: Part, count: int, tasks: int, journal: Journal | None) -> str:
    counted = f"{part.done(count):,} of {part.total or tasks:,} {part.what}"
    if journal is None:
        return f"{counted} were done."
    return f"{counted} are done and kept. To continue, type {resuming(journal.path)}."


# --- what is refused ---------------------------------------------------------------------------------


def _check(work: Work, tasks: Sequence[Task], executor: str) -> None:
    for key, count in Counter(task.key for task in tasks).items():
        if count > 1:
            raise InputError(f"Two tasks have the key {key!r}; a key names one repetition.")
    name = getattr(work, "__qualname__", "")
    if executor != "threads" and (not name or "<" in name or not hasattr(work, "__module__")):
        raise InputError(f"{work!r} cannot be sent to other processes: give a function of a module, or threads.")


Place = Callable[[Work, Sequence[Task], int], Iterator[tuple[Task, Ended]]]
"""Where repetitions are done: of the work, the tasks and the number of jobs it gives each as it ends."""


def executor_from_name(name: str) -> Place:
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
        return lambda work, tasks, _: on_cluster(work, tasks, name)
    raise InputError(SAYS("no-executor", name=name, executors=", ".join(EXECUTORS)))


EXECUTORS: dict[str, Place] = {"threads": on_threads, "processes": on_processes}
"""By name; see the module's table."""
