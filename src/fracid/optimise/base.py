"""One loop for every optimiser: ask for points, evaluate them on threads, log them, tell.

An optimiser is a **generator**: it yields points and is sent their evaluations.

How to write one (a file of its own beside this one, and nothing else):

1. ``def name(space, rng, **options)``: a generator function; `rng` is its only source of randomness.
2. ``evaluations = yield points`` with points of shape (k, n), in physical units, within the bounds.
   It gets a list of k :class:`Evaluation` back, in order.  All points of one batch may run in parallel.
3. A failed run has an infinite cost (never NaN), a reason, and no residuals: expect it anywhere.
4. Return an :class:`Outcome` when done.  The loop keeps the best; an optimiser need not.
5. What is no generator but calls a function (SciPy's) goes through :func:`as_generator`.
6. Check counts among the options with :func:`at_least`: a generator's own errors come only when it runs.
7. Below it ``OPTIMISER = Entry("its-name", name, …)``: the package collects these.
8. Import what is heavy (SciPy's searches, a package) within the function: all files are read for their names.
"""

from __future__ import annotations

import json
import math
import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fracid.arrays import FloatArray, by_name
from fracid.arrowhead import Blocks
from fracid.errors import InputError, at_least, is_number, writing
from fracid.safety.door import appended
from fracid.safety.json_files import REACH, json_number, object_of
from fracid.tasks.job import closing
from fracid.tasks.journal import append_whole, whole_lines

GREATEST = 1e150
"""Of a cost, whose rows are squared."""

DIFFERENCE = 1e-6
"""Step of the differences, relative to the size of the unknown: √(relative rounding of a trajectory)."""


class Outcome(StrEnum):
    """How a search ended; the value is the sentence."""

    CONVERGED = "converged: steps and gain are below the tolerance"
    GENERATIONS_DONE = "all generations done"
    BUDGET_SPENT = "the budget of evaluations is spent"
    INTERRUPTED = "interrupted: the best so far is kept"
    STOPPED = "stopped as asked: the best so far is kept"
    ALL_FAILED = "every run failed"


@dataclass(frozen=True)
class Space:
    """The unknowns: names, bounds that hold where to start, as :class:`fracid.Free` sees to, in physical units.

    Examples
    --------
    >>> space = Space(("lambda", "mu"), np.array([0.5, 0.5]), np.array([1.2, 1.2]), np.array([1.0, 1.0]))
    >>> space.from_unit(np.array([[0.0, 0.5]]))
    array([[0.5 , 0.85]])
    """

    names: tuple[str, ...]
    lower: FloatArray
    """Shape (n,); −inf where there is no bound."""
    upper: FloatArray
    """Shape (n,); inf where there is no bound."""
    start: FloatArray
    """Shape (n,)."""
    scale: FloatArray | None = None
    """Typical sizes, shape (n,), NaN where the start and the bounds are to tell; None for all."""
    blocks: Blocks | None = None
    """Which unknowns and rows belong to which recording, where that is worth using."""
    held: NDArray[np.bool_] | None = None
    """Unknowns that a local search leaves at their start, shape (n,); None for none."""

    @cached_property
    def moving(self) -> NDArray[np.bool_]:
        """Which unknowns a local search moves, shape (n,)."""
        return np.ones(len(self.names), dtype=bool) if self.held is None else ~self.held

    @cached_property
    def typical(self) -> FloatArray:
        """The size of each unknown: its scale; else its start, a hundredth of its range at least and all at most."""
        width = self.upper - self.lower
        floor = np.where(np.isfinite(width), 1e-2 * width, 1e-3)
        defaults = np.minimum(np.maximum(np.abs(self.start), floor), width)
        return defaults if self.scale is None else np.where(np.isnan(self.scale), defaults, self.scale)

    def steps(self, x: FloatArray) -> FloatArray:
        """Steps of the differences at x, towards the inside of the bounds."""
        h = np.minimum(DIFFERENCE * np.maximum(self.typical, np.abs(x)), 0.25 * (self.upper - self.lower))
        return np.where(x + h > self.upper, -h, h)

    def sizes(self, x: FloatArray) -> FloatArray:
        """The size of each unknown next to x: its value, or a hundredth of its range, of its start or 1 at most."""
        most = np.maximum(np.abs(self.start), 1.0)
        return np.maximum(np.abs(x), 1e-2 * np.minimum(self.upper - self.lower, most))

    def clipped(self, points: FloatArray) -> FloatArray:
        """The nearest points within the bounds, shape (…, n)."""
        return np.clip(points, self.lower, self.upper)

    def from_unit(self, points: FloatArray) -> FloatArray:
        """Map points of the unit cube, shape (…, n), onto the bounds.

        Raises
        ------
        InputError
            If a bound is infinite: a global search must know where to look.
        """
        width = self.upper - self.lower
        for name in np.array(self.names)[~np.isfinite(width)]:
            raise InputError(f"{name} has an infinite bound; a global search needs a lower and an upper one.")
        return self.clipped(self.lower + points * width)


@dataclass(frozen=True)
class Evaluation:
    """The cost at one point."""

    point: FloatArray
    """Shape (n,), in physical units."""
    cost: float
    """Infinite where the run failed."""
    residuals: FloatArray | None = None
    """Rows for least squares; None where the run failed or the cost has none."""
    reason: str = ""
    """Why the cost is infinite."""

    @cached_property
    def value(self) -> float:
        """V, the sum of the squared rows, which least squares minimises; the cost where there are none."""
        if self.residuals is None or not math.isfinite(self.cost):
            return self.cost
        return float(self.residuals @ self.residuals)


Optimiser = Generator[FloatArray, list[Evaluation], Outcome]
"""Yields points of shape (k, n), is sent their k evaluations, returns how it ended."""


@dataclass(frozen=True)
class Entry:
    """What is known of an optimiser: all that the rest of fracid asks."""

    name: str
    """As a project file has it."""
    function: Callable[..., Optimiser] | None
    """(space, rng, **options) → the search; None for what :mod:`fracid.estimation.search` makes of other searches."""
    needs_rows: bool = False
    """Whether it wants a cost that gives rows for least squares."""
    polish: bool = False
    """Whether least squares goes on from its best point."""
    evaluations: int | None = None
    """How many it makes with its own options, where that is known before."""

    @property
    def keeps_its_own(self) -> bool:
        """Whether its best point is the end although least squares could go on: a fit says what it missed."""
        return not (self.needs_rows or self.polish)


Told = Callable[[Evaluation, int], None]
"""Called with the best so far, and with how many evaluations it took."""

Ask = Callable[[FloatArray], list[Evaluation]]
"""The same seen from a function that calls: points of shape (k, n) → their k evaluations."""


@dataclass(frozen=True)
class Result:
    """What a search found."""

    best: Evaluation
    """The first of those with the lowest cost; where every run failed, the last."""
    outcome: Outcome
    evaluations: int
    """How many runs."""

    @property
    def interrupted(self) -> bool:
        """Whether Ctrl-C ended it."""
        return self.outcome is Outcome.INTERRUPTED


class EvaluationLog(AbstractContextManager["EvaluationLog"]):
    """An append-only file of evaluations, one JSON line each, written after every batch.

    A line has ``n`` (from 1, going on where an older log ends), ``point`` by name, ``cost`` (null where the run
    failed) with the ``reason``, and ``seconds`` since the log was opened.

    Parameters
    ----------
    path : str or Path
    again : bool
        Whether the search that the file is from is done again from its start, after it was killed: what the file
        has is not written a second time.

    Raises
    ------
    InputError
        If the file cannot be written.
    Unfinished
        By `append`, if the disk will not take more.

    Examples
    --------
    >>> import tempfile
    >>> with EvaluationLog(Path(tempfile.mkdtemp()) / "evaluations.jsonl") as log:
    ...     log.append(("mu",), [Evaluation(np.array([0.9]), 0.1)])
    """

    torn: bool = False
    """Whether a last line that was cut off in writing was removed."""

    def __init__(self, path: str | Path, *, again: bool = False) -> None:
        """Open the file, at its end if it is there; a line that was cut off in writing is removed."""
        self._path, self._count = Path(path), 0
        with writing(f"The log {path}", "Is its folder there?"):
            lines = deque(enumerate(whole_lines(self._path), 1), maxlen=1)
            before, (last, end) = lines[0] if lines else (0, (b"", 0))
            self._file, self._end = appended(self._path), end
            self.torn = self._path.stat().st_size > end
            self._file.truncate(end)
        self._before = before if again else 0
        self._count = 0 if again else before
        self._began = time.perf_counter() - (_seconds(last) if again else 0.0)

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        self._file.close()

    def append(self, names: tuple[str, ...], batch: list[Evaluation]) -> None:
        """Write a batch."""
        seconds = round(time.perf_counter() - self._began, 4)
        lines = []
        for e in batch:
            self._count += 1
            point, cost = by_name(names, e.point), json_number(e.cost)
            line = {"n": self._count, "point": point, "cost": cost, "reason": e.reason, "seconds": seconds}
            if self._count > self._before:
                lines.append(json.dumps(line, ensure_ascii=False) + "\n")
        self._end = append_whole(self._file, ["".join(lines).encode()], self._end)


def _seconds(line: bytes) -> float:
    """Where the clock of an older log stood, by its last line."""
    seconds: Any = (object_of(line) or {}).get("seconds")
    return float(seconds) if is_number(seconds) and abs(seconds) < REACH else 0.0


def minimise(
    evaluate: Callable[[FloatArray], Evaluation],
    optimiser: Optimiser,
    *,
    jobs: int = 1,
    log: Callable[[list[Evaluation]], None] | None = None,
    callback: Told | None = None,
    stop: Callable[[], bool] | None = None,
    together: tuple[int, Callable[[Sequence[FloatArray]], list[Evaluation]]] | None = None,
) -> Result:
    """Run an optimiser to its end.

    Parameters
    ----------
    evaluate : function (point) -> Evaluation
        Called from `jobs` threads at once; the result does not depend on how many.
    optimiser : generator
        From :data:`fracid.optimise.OPTIMISERS`.
    log : function, optional
        Gets each batch as it ends.
    callback : function (best so far, evaluations so far) -> None, optional
        Called after each batch.
    stop : function () -> bool, optional
        Asked after each batch; the search ends where it says True.
    together : int and function (points) -> evaluations, optional
        In the place of `evaluate` for up to so many points of a batch at once.

    Returns
    -------
    Result
        The best, also after Ctrl-C.

    Raises
    ------
    InputError
        If `jobs` is below 1, or whatever `evaluate` and the optimiser raise.
    KeyboardInterrupt
        If Ctrl-C came before a single run had ended.

    Examples
    --------
    >>> from fracid.optimise import Space, least_squares
    >>> space = Space(("a",), np.array([0.0]), np.array([9.0]), np.array([1.0]))
    >>> found = minimise(lambda x: Evaluation(x, float((x[0] - 3) ** 2), x - 3), least_squares(space, None))
    >>> round(float(found.best.point[0]), 6), found.outcome.name
    (3.0, 'CONVERGED')
    """
    best: Evaluation | None = None
    outcome: Outcome | None = None
    count, batch = 0, list[Evaluation]()
    at_once, evaluate_all = together or (1, lambda points: [evaluate(x) for x in points])
    with closing(ThreadPoolExecutor(at_least("jobs", jobs, 1))) as pool:
        try:
            points = next(optimiser)
            while outcome is None:
                batch = []
                try:
                    asked = list(np.atleast_2d(points))
                    parts = [asked[k : k + at_once] for k in range(0, len(asked), at_once)]
                    alone = min(jobs, len(parts)) == 1
                    for evaluations in map(evaluate_all, parts) if alone else pool.map(evaluate_all, parts):
                        batch += [_sound(e) for e in evaluations]
                finally:  # what an interrupted batch has done counts too
                    count += len(batch)
                    best = min([*([best] if best else []), *batch], key=lambda e: e.cost, default=None)
                    if log is not None:
                        log(batch)
                if callback is not None and best is not None:
                    callback(best, count)
                outcome = Outcome.STOPPED if stop is not None and stop() else None
                points = optimiser.send(batch) if outcome is None else points
        except StopIteration as end:
            outcome = end.value
        except KeyboardInterrupt:
            outcome = Outcome.INTERRUPTED
        finally:
            optimiser.close()
    return _result(best, outcome, count, batch)


def _sound(e: Evaluation) -> Evaluation:
    """Make every cost that is no number, or whose square is none, infinite, with a reason and without residuals."""
    if abs(e.cost) <= GREATEST:
        return e
    return replace(e, cost=math.inf, residuals=None, reason=e.reason or f"the cost is {e.cost:.3g}")


def _result(best: Evaluation | None, outcome: Outcome | None, count: int, batch: list[Evaluation]) -> Result:
    if best is None and outcome is Outcome.INTERRUPTED:
        raise KeyboardInterrupt
    if best is None or outcome is None:
        raise InputError("The optimiser ended without a point or an outcome; see the rules in fracid.optimise.base.")
    if best.cost == math.inf:
        return Result(batch[-1] if batch else best, Outcome.ALL_FAILED, count)
    return Result(best, outcome, count)


def as_generator(run: Callable[[Ask], Outcome]) -> Optimiser:
    """Turn a function that calls `evaluate(points)` into a generator that yields the points.

    The function runs in a thread of its own and waits there for its evaluations; it ends with the generator.

    Examples
    --------
    >>> def run(evaluate):
    ...     first = evaluate(np.zeros((1, 1)))
    ...     return Outcome.CONVERGED
    >>> generator = as_generator(run)
    >>> next(generator)
    array([[0.]])
    >>> generator.close()
    """
    queries: queue.SimpleQueue[Any] = queue.SimpleQueue()
    replies: queue.SimpleQueue[list[Evaluation] | None] = queue.SimpleQueue()

    def evaluate(points: FloatArray) -> list[Evaluation]:
        queries.put(np.atleast_2d(np.asarray(points, dtype=np.float64)))
        evaluations = replies.get()
        if evaluations is None:
            raise _Closed
        return evaluations

    def work() -> None:
        try:
            with np.errstate(over="ignore", invalid="ignore", divide="ignore"):  # a step to nowhere is refused
                queries.put(run(evaluate))
        except _Closed:
            pass
        except BaseException as error:  # handed to whoever asks next
            queries.put(error)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    try:
        while True:
            item = queries.get()
            if isinstance(item, BaseException):
                raise item
            if isinstance(item, Outcome):
                return item
            replies.put((yield item))
    finally:
        replies.put(None)
        thread.join()


class _Closed(BaseException):
    """The generator was closed: unwinds the function in its thread, past any `except Exception`."""
