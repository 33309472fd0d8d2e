"""How far long work is: for people a line at the foot of the terminal, for programs one JSON object a line.

Both go to standard error, which leaves standard output to the result.  Where that is no terminal, and no ``--json`` was
typed, nothing is said.  An event is ::

    {"event": "progress", "what": "repetitions", "done": 12, "total": 300, "earlier": 0,
     "seconds": 3.2, "rate": 3.75, "left": 76.8, "best": null}

with ``earlier`` of `done` from before a resumption, ``rate`` a second, ``left`` seconds, and ``best`` the lowest cost
so far; null for what is not known.  There is one a second at most, and one at the end.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from functools import partial
from typing import TextIO

from fracid.safety.text import printable
from fracid.tasks.job import Progress
from fracid.workflows.observer import Observer

__all__ = ["on_terminal", "progress_shown"]

EVERY = 1.0
"""Between two events [s]."""

Tell = Callable[[Progress], None]


def on_terminal(*, events: bool) -> Observer:
    """Give what writes notices and progress to standard error; `events` as of :func:`progress_shown`."""
    return Observer(_write_line, partial(progress_shown, events=events))


def _write_line(notice: str) -> None:
    sys.stderr.write(printable(f"{notice}\n"))


@contextmanager
def progress_shown(what: str, *, events: bool, stream: TextIO | None = None) -> Iterator[Tell | None]:
    """Show progress while the block runs.

    Parameters
    ----------
    what : str
        What is counted: ``repetitions``.
    events : bool
        For programs: JSON lines, terminal or not.
    stream : file, optional
        Standard error if left out.

    Yields
    ------
    function (Progress) -> None, or None
        To be called as often as one likes; None where nothing is to be shown.

    Examples
    --------
    >>> with progress_shown("repetitions", events=True, stream=sys.stdout) as tell:
    ...     tell(Progress(done=3, total=4, earlier=1, seconds=2.0))
    {"event": "progress", "what": "repetitions", "done": 3, "total": 4, "earlier": 1,
     "seconds": 2.0, "rate": 1.0, "left": 1.0, "best": null}
    """
    stream = stream or sys.stderr
    if events:
        yield from _events(what, stream)
    elif stream.isatty():
        yield from _bar(what, stream)
    else:
        yield None


def _events(what: str, stream: TextIO) -> Iterator[Tell]:
    event_time, last = -EVERY, None

    def write(p: Progress) -> None:
        event = {"event": "progress", "what": what, **asdict(p), "rate": p.rate, "left": p.left}
        best = event.pop("best")
        rounded = {k: round(v, 3) if isinstance(v, float) else v for k, v in event.items()} | {"best": best}
        stream.write(json.dumps(rounded) + "\n")
        stream.flush()

    def tell(p: Progress) -> None:
        nonlocal event_time, last
        last = p
        if time.monotonic() - event_time >= EVERY:
            event_time, last = time.monotonic(), None
            write(p)

    try:
        yield tell
    finally:
        if last is not None:
            write(last)


def _bar(what: str, stream: TextIO) -> Iterator[Tell]:
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[rate]}"),
               TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn())  # fmt: skip
    with Bar(*columns, console=Console(file=stream), transient=True) as bar:
        task = bar.add_task(what, total=None, rate="")

        def tell(p: Progress) -> None:
            best = "" if p.best is None else f", best so far {p.best:.6g}"
            bar.update(task, completed=p.done, total=p.total, description=what + best, rate=f"{p.rate:.3g} a second")

        yield tell
