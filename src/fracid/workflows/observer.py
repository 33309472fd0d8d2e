"""What a workflow says while it works: notices, and how far it is."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass

from fracid.tasks.job import Progress

__all__ = ["SILENT", "Observer"]

Tell = Callable[[Progress], None]


def _unheard(_notice: str) -> None:
    pass


def _unseen(_what: str) -> AbstractContextManager[Tell | None]:
    return nullcontext()


@dataclass(frozen=True)
class Observer:
    """Who hears what a workflow has to say before it ends; nobody, where nothing is given.

    Examples
    --------
    >>> Observer(notice=print).notice("The last line of the log was cut off in writing.")
    The last line of the log was cut off in writing.

    A bar of ``tqdm`` in a notebook:

    >>> from contextlib import contextmanager
    >>> @contextmanager
    ... def bar(what):
    ...     with tqdm(desc=what) as bar:
    ...         yield lambda progress: bar.update(progress.done - bar.n)
    >>> observer = Observer(progress=bar)
    """

    notice: Callable[[str], None] = _unheard
    """Gets each sentence that should be read now: a fault of the data, a fit that is gone on with."""
    progress: Callable[[str], AbstractContextManager[Tell | None]] = _unseen
    """Gets what is counted, ``evaluations``, ``fits`` or ``repetitions``; gives a context that lasts as long as the
    counting, and in it the function that gets each progress, with ``done``, ``total``, ``seconds`` and ``best``."""


SILENT = Observer()
"""Hears nothing."""
