"""Stages and counts of long work, shown: on a terminal, in a notebook, or as one JSON object a line.

On a terminal the stage that runs is a line at its foot; one that has ended stays above, with what it came to::

    ✓ search · 556 evaluations · 0.056° · 1.8 s
    ⠋ 120 of 300 repetitions · 48 s · 1 min 12 s left

The time left is there only where the number of what is counted is known, each takes about as long, and the first few
are done.  A stage of less than :data:`SHORT` seconds
that counts nothing leaves no line.  Terminals get it on standard error, which leaves standard output to the result.

An event is one of::

    {"event": "stage", "name": "search", "seconds": 1.1}
    {"event": "progress", "what": "repetitions", "done": 12, "total": 300, "earlier": 0,
     "seconds": 3.2, "rate": 3.75, "left": 76.8, "best": null}

with ``earlier`` of `done` from before a resumption, ``rate`` a second, ``left`` seconds, and ``best`` the lowest cost
so far; null for what is not known.  Progress comes once a second at most, and once at the end.
"""

from __future__ import annotations

import json
import logging
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from functools import wraps
from html import escape
from types import FrameType
from typing import Any, ParamSpec, TextIO, TypeVar

from fracid.safety.text import printable
from fracid.tasks.job import Progress
from fracid.tasks.progress import SILENT, Observer, Tell
from fracid.units import with_unit

P = ParamSpec("P")
T = TypeVar("T")

EVERY = 1.0
"""Between two events [s]."""

BRIEF, SHORT = 0.4, 1.0
"""Up to which a stage is not shown while it runs, and leaves no line behind it [s]."""

SLOWEST = 0.25
"""Between two updates of a notebook's output [s]."""

COMPILING = "compiling, once on this machine"

COMPILATION = logging.getLogger("fracid.compilation")
"""Hears when something has to be compiled."""


@dataclass
class _Stage:
    """What is going on, and since when."""

    name: str
    began: float
    what: str = ""
    """What is counted."""
    progress: Progress | None = None
    heard: float = 0.0
    """When the progress came."""
    note: str = ""

    def text(self, *, ended: bool = False) -> str:
        """The stage in a line, without its mark."""
        seconds = time.monotonic() - self.began
        counts = [*self._counts(ended)]
        name = "" if counts and self.what == self.name else self.name
        parts = [name, *counts, "" if ended else self.note, duration(seconds, fine=ended)]
        return " · ".join(p for p in (*parts, "" if ended else self._left()) if p)

    def _left(self) -> str:
        if self.progress is None or (left := self.progress.left) is None:
            return ""
        left -= time.monotonic() - self.heard
        return f"{duration(left)} left" if left >= 1 else ""

    def _counts(self, ended: bool) -> Iterator[str]:
        if (p := self.progress) is None:
            return
        of = "" if p.total is None or (p.about and ended) else f" of {'about ' * p.about}{p.total:,}"
        yield f"{p.done:,}{of} {self.what.removesuffix('s') if of == '' and p.done == 1 else self.what}"
        yield "" if ended else p.note
        if p.best is not None:
            yield with_unit(p.best, p.unit) if p.unit else f"lowest cost {p.best:.4g}"

    def line(self, mark: str) -> str:
        """What it came to; empty where that is worth no line, or not to be said."""
        worth = mark and (self.progress is not None or time.monotonic() - self.began > SHORT)
        return self.text(ended=True) + " · interrupted" * (mark == "✗") if worth else ""


def duration(seconds: float, *, fine: bool = False) -> str:
    """Seconds as people read them.

    Examples
    --------
    >>> duration(3.21), duration(3.21, fine=True), duration(200), duration(7320)
    ('3 s', '3.2 s', '3 min 20 s', '2 h 2 min')
    """
    if seconds < 60:
        return f"{seconds:.1f} s" if fine and seconds < 10 else f"{seconds:.0f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"


class _Display:
    """Turns what an :class:`Observer` hears into stages on a surface."""

    def __init__(self, surface: _Terminal | _Notebook | _Events, result: Callable[[Any], None] | None = None) -> None:
        self._surface, self._stage, self._result = surface, _Stage("", 0.0), result
        self._mark = "✓"
        self.observer = Observer(surface.notice, self.progress, self.stage, self.interrupted, result=self.result)
        """What a workflow speaks to."""

    def stage(self, name: str) -> None:
        """The stage before has ended, this one begins; none, for an empty name; one that goes on stays."""
        if name and name == self._stage.name:
            return
        self.close(self._mark)
        if name:
            self._stage = _Stage(name, time.monotonic())
            self._surface.begin(self._stage)
            COMPILATION.addFilter(self.compiling)

    def close(self, mark: str) -> None:
        """The stage has ended."""
        stage, self._stage, self._mark = self._stage, _Stage("", 0.0), "✓"
        if stage.name:
            COMPILATION.removeFilter(self.compiling)
            self._surface.end(stage, mark)

    @contextmanager
    def progress(self, what: str) -> Iterator[Tell | None]:
        """Count, in the stage there is or in one of its own."""
        alone = not self._stage.name
        if alone:
            self.stage(what)
        stage = self._stage
        stage.what = what

        def tell(p: Progress) -> None:
            stage.progress, stage.heard = p, time.monotonic()
            self._surface.update(stage)

        yield tell
        if alone and self._stage is stage:
            self.stage("")

    def interrupted(self) -> None:
        """The stage ends with a cross."""
        self._mark = "✗"

    def result(self, run: Any) -> None:
        """The result is there: it may be printed now."""
        self.stage("")
        if self._result is not None:
            self._result(run)

    def compiling(self, record: logging.LogRecord) -> bool:  # noqa: ARG002
        """What runs is compiled first; whoever else listens hears of it too."""
        self._stage.note = COMPILING
        self._surface.update(self._stage)
        return True


# ------------------------------------------------------------------ surfaces


class _Terminal:
    """One line that changes, and above it what has ended."""

    def __init__(self, stream: TextIO) -> None:
        from rich.console import Console

        self._console = Console(file=stream, highlight=False)

    def begin(self, stage: _Stage) -> None:
        from rich.live import Live
        from rich.spinner import Spinner
        from rich.table import Column, Table
        from rich.text import Text

        spinner = Spinner("dots")

        def line() -> Table:
            grid = Table.grid(Column(no_wrap=True), Column(no_wrap=True, overflow="ellipsis"), padding=(0, 1))
            grid.add_row(spinner, Text(printable(stage.text())))
            return grid

        self._live = Live(get_renderable=line, console=self._console, transient=True, refresh_per_second=5,
                          redirect_stdout=False, redirect_stderr=False)  # fmt: skip
        self._later = threading.Timer(BRIEF, self._live.start)
        self._later.daemon = True
        self._later.start()

    def update(self, stage: _Stage) -> None:
        """The line is drawn anew five times a second."""

    def end(self, stage: _Stage, mark: str) -> None:
        from rich.text import Text

        self._later.cancel()
        self._later.join()
        self._live.stop()
        if line := stage.line(mark):
            text = Text.assemble((mark, "green" if mark == "✓" else "yellow"), " ", printable(line))
            self._console.print(text, soft_wrap=True)

    def notice(self, sentence: str) -> None:
        from rich.text import Text

        self._console.print(Text(printable(sentence)), soft_wrap=not self._console.is_terminal)


class _Notebook:
    """All stages in one output below the cell."""

    def __init__(self) -> None:
        from IPython.display import display

        self._lines: list[str] = []
        self._last = 0.0
        self._output: Any = display(self._bundle(""), raw=True, display_id=True)  # type: ignore[no-untyped-call]

    def begin(self, stage: _Stage) -> None:
        self._show(f"… {stage.name}")

    def update(self, stage: _Stage) -> None:
        if time.monotonic() - self._last > SLOWEST:
            self._show(f"… {stage.text()}")

    def end(self, stage: _Stage, mark: str) -> None:
        if line := stage.line(mark):
            self._lines.append(f"{mark} {line}")
        self._show("")

    def notice(self, sentence: str) -> None:
        self._lines.append(sentence)
        self._show("")

    def _show(self, line: str) -> None:
        self._last = time.monotonic()
        self._output.update(self._bundle(line), raw=True)

    def _bundle(self, line: str) -> dict[str, str]:
        text = printable("\n".join([*self._lines, line]).strip("\n"))
        return {"text/plain": text, "text/html": f'<pre style="white-space:pre-wrap">{escape(text)}</pre>'}


class _Events:
    """For programs: a JSON object a line."""

    def __init__(self, stream: TextIO) -> None:
        self._stream, self._began = stream, time.monotonic()
        self._last, self._unwritten = -EVERY, False

    def begin(self, stage: _Stage) -> None:
        self._write({"event": "stage", "name": stage.name, "seconds": round(time.monotonic() - self._began, 3)})

    def update(self, stage: _Stage) -> None:
        self._unwritten = True
        if time.monotonic() - self._last >= EVERY:
            self._last = time.monotonic()
            self._counted(stage)

    def end(self, stage: _Stage, mark: str) -> None:  # noqa: ARG002 (as every surface)
        if self._unwritten:
            self._counted(stage)
        self._last = -EVERY

    def notice(self, sentence: str) -> None:
        self._stream.write(printable(f"{sentence}\n"))

    def _counted(self, stage: _Stage) -> None:
        p, self._unwritten = stage.progress, False
        if p is not None:
            numbers = {n: getattr(p, n) for n in ("done", "total", "earlier", "seconds", "rate", "left")}
            rounded = {k: round(v, 3) if isinstance(v, float) else v for k, v in numbers.items()}
            self._write({"event": "progress", "what": stage.what, **rounded, "best": p.best})

    def _write(self, event: dict[str, Any]) -> None:
        self._stream.write(json.dumps(event) + "\n")
        self._stream.flush()


# ------------------------------------------------------------------ who looks on


@contextmanager
def shown(
    stage: str = "", *, events: bool = False, stream: TextIO | None = None, result: Callable[[Any], None] | None = None
) -> Iterator[Observer]:
    """Show stages and progress while the block runs, where somebody looks on.

    Parameters
    ----------
    stage : str
        That begins with the block.
    events : bool
        For programs: JSON lines, terminal or not.
    stream : file, optional
        Standard error if left out.
    result : function, optional
        Gets the finished run as soon as its result is written.

    Examples
    --------
    >>> with shown(events=True, stream=sys.stdout) as observer, observer.progress("repetitions") as tell:
    ...     tell(Progress(done=7, total=9, earlier=1, seconds=6.0))
    {"event": "stage", "name": "repetitions", "seconds": 0.0}
    {"event": "progress", "what": "repetitions", "done": 7, "total": 9, "earlier": 1,
     "seconds": 6.0, "rate": 1.0, "left": 2.0, "best": null}
    """
    stream = sys.stderr if stream is None else stream
    with _answering(stream):
        if not events and not stream.isatty():
            yield Observer(notice=_Events(stream).notice, result=result or SILENT.result)
            return
        display = _Display(_Events(stream) if events else _Terminal(stream), result)
        display.stage(stage)
        try:
            yield display.observer
        except BaseException:
            display.close("")
            raise
        display.stage("")


@contextmanager
def _answering(stream: TextIO) -> Iterator[None]:
    """Have Ctrl-C answered at once on a terminal: what is under way ends first, which may take seconds."""
    before = signal.getsignal(signal.SIGINT)
    on_main = threading.current_thread() is threading.main_thread()
    if not (stream.isatty() and on_main and before is signal.default_int_handler):
        yield
        return

    def answer(number: int, frame: FrameType | None) -> None:
        stream.write("\nstopping after what is under way; what is done is kept …\n")
        stream.flush()
        signal.default_int_handler(number, frame)

    signal.signal(signal.SIGINT, answer)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def in_notebook() -> bool:
    """Whether this is a notebook's kernel.

    Examples
    --------
    >>> in_notebook()
    False
    """
    ipython = sys.modules.get("IPython")
    return getattr(ipython.get_ipython() if ipython is not None else None, "kernel", None) is not None


def unless_given(observer: Observer | None) -> Observer:
    """The observer that was given; else, in a notebook, one that shows the stages below the cell; else nobody.

    Examples
    --------
    >>> unless_given(None) is SILENT
    True
    """
    if observer is not None:
        return observer
    return _Display(_Notebook()).observer if in_notebook() else SILENT


def counted(what: str) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Have a function that takes `progress` show it below the cell of a notebook where none is given.

    Parameters
    ----------
    what : str
        What is counted: ``repetitions``.

    Examples
    --------
    >>> @counted("steps")
    ... def work(progress=None):
    ...     return progress
    >>> work() is None
    True
    """

    def shown_of(function: Callable[P, T]) -> Callable[P, T]:
        @wraps(function)
        def telling(*args: P.args, **kwargs: P.kwargs) -> T:
            given = kwargs.get("progress")
            with unless_given(None).progress(what) if given is None else nullcontext(given) as kwargs["progress"]:
                return function(*args, **kwargs)

        return telling

    return shown_of
