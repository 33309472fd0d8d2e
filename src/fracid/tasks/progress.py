"""What long work says before it ends: notices, the stage that it is in, how far it is, and its result."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Any

from fracid.tasks.job import Progress

Tell = Callable[[Progress], None]


def _unheard(*_: Any) -> None:
    """Nobody listens."""


def _unseen(_what: str) -> AbstractContextManager[Tell | None]:
    return nullcontext()


@dataclass(frozen=True)
class Observer:
    """Callbacks for the notices, the progress and the result of a workflow; by default they do nothing.

    In a notebook the workflows and :func:`fracid.identify` show their stages below the cell if no observer is given.

    Examples
    --------
    >>> Observer(notice=print).notice("The last line of the log was cut off in writing.")
    The last line of the log was cut off in writing.

    A bar of ``tqdm``:

    >>> from contextlib import contextmanager
    >>> @contextmanager
    ... def bar(what):
    ...     with tqdm(desc=what) as bar:
    ...         yield lambda progress: bar.update(progress.done - bar.n)
    >>> observer = Observer(progress=bar)
    """

    notice: Callable[[str], None] = _unheard
    """Gets each sentence that should be read now: a fault of the data, a fit that is resumed."""
    progress: Callable[[str], AbstractContextManager[Tell | None]] = _unseen
    """Gets what is counted, ``evaluations``, ``fits`` or ``repetitions``; gives a context that lasts as long as the
    counting, and in it the function that gets each progress, with ``done``, ``total``, ``seconds`` and ``best``."""
    stage: Callable[[str], None] = _unheard
    """Gets the name of each stage as it begins: ``search``, ``intervals``, ``figures``; the one before has ended."""
    interrupted: Callable[[], None] = _unheard
    """Called when Ctrl-C has ended the stage."""
    result: Callable[[Any], None] = _unheard
    """Gets the finished run as soon as its result is written, before its figures and its page."""
    recordings: Callable[[Mapping[str, Any]], None] | None = None
    """Gets each recording beside its simulation, as in :attr:`fracid.Fit.recordings`, as soon as a minimum is known,
    and again where a lower one is found or more recordings are simulated.  Without it none is simulated for that."""

    def notices(self, sentences: Iterable[object]) -> None:
        """Give each to `notice`."""
        for sentence in sentences:
            self.notice(str(sentence))


SILENT = Observer()
"""Hears nothing."""
