"""One loop for every optimiser: ask for points, evaluate them on threads, log them, tell.

An optimiser is a **generator**: it yields points and is sent their evaluations.

How to write one (a file of its own beside this one, and a row in ``OPTIMISERS``):

1. ``def name(space, rng, **options)``: a generator function; `rng` is its only source of randomness.
2. ``evaluations = yield points`` with points of shape (k, n), in physical units, within the bounds.
   It gets a list of k :class:`Evaluation` back, in order.  All points of one batch may run in parallel.
3. A failed run has an infinite cost and a reason, and no residuals: expect it anywhere.
4. Return an :class:`Outcome` when done.  The loop keeps the best; an optimiser need not.
5. What is no generator but calls a function (SciPy's) goes through :func:`as_generator`.
"""

from __future__ import annotations

import json
import queue
import threading
import time
from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from types import TracebackType
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from fracid.errors import InputError

__all__ = ["Evaluation", "EvaluationLog", "Optimiser", "Outcome", "Result", "Space", "as_generator", "minimise"]

FloatArray = NDArray[np.float64]


class Outcome(Enum):
    """How a search ended; the value is the sentence."""

    CONVERGED = "converged: steps and gain are below the tolerance"
    GENERATIONS_DONE = "all generations done"
    BUDGET_SPENT = "the budget of evaluations is spent"
    INTERRUPTED = "interrupted: the best so far is kept"
    ALL_FAILED = "every run failed"


@dataclass(frozen=True)
class Space:
    """The unknowns: names, bounds and where to start."""

    names: tuple[str, ...]
    lower: FloatArray
    """Shape (n,); −inf where there is no bound."""
    upper: FloatArray
    start: FloatArray

    def __post_init__(self) -> None:
        """Refuse bounds that do not hold the start."""
        for name, low, x, high in zip(self.names, self.lower, self.start, self.upper, strict=True):
            if not low <= x <= high:
                raise InputError(f"{name}: the start {x:g} is not within its bounds {low:g} … {high:g}.")

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
        return np.clip(self.lower + points * width, self.lower, self.upper)


@dataclass(frozen=True)
class Evaluation:
    """The cost at one point."""

    point: FloatArray
    cost: float
    """Infinite where the run failed."""
    residuals: FloatArray | None = None
    """Rows for least squares; None where the run failed or the cost has none."""
    reason: str = ""
    """Why the cost is infinite."""


Optimiser = Generator[FloatArray, list[Evaluation], Outcome]


@dataclass(frozen=True)
class Result:
    """What a search found."""

    best: Evaluation
    outcome: Outcome
    evaluations: int

    @property
    def interrupted(self) -> bool:
        """Whether Ctrl-C ended it."""
        return self.outcome is Outcome.INTERRUPTED


class EvaluationLog:
    """An append-only file of evaluations, one JSON line each, flushed after every batch."""

    def __init__(self, path: str | Path) -> None:
        self._count, self._began = 0, time.perf_counter()
        self._file: IO[str] = Path(path).open("a", encoding="utf-8")  # noqa: SIM115 (closed by __exit__)

    def __enter__(self) -> EvaluationLog:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._file.close()

    def append(self, names: tuple[str, ...], batch: list[Evaluation]) -> None:
        """Write a batch."""
        seconds = round(time.perf_counter() - self._began, 4)
        for e in batch:
            self._count += 1
            line = {"n": self._count, "point": dict(zip(names, e.point.tolist(), strict=True)),
                    "cost": e.cost if np.isfinite(e.cost) else None, "reason": e.reason, "seconds": seconds}  # fmt: skip
            self._file.write(json.dumps(line, ensure_ascii=False) + "\n")
        self._file.flush()


def minimise(
    evaluate: Callable[[FloatArray], Evaluation],
    optimiser: Optimiser,
    *,
    jobs: int = 1,
    log: Callable[[list[Evaluation]], None] | None = None,
    callback: Callable[[Evaluation, int], None] | None = None,
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

    Returns
    -------
    Result
        The best, also after Ctrl-C.

    Examples
    --------
    >>> from fracid.optimise import Space, least_squares
    >>> space = Space(("a",), np.array([0.0]), np.array([9.0]), np.array([1.0]))
    >>> found = minimise(lambda x: Evaluation(x, float((x[0] - 3) ** 2), x - 3), least_squares(space, None))
    >>> round(float(found.best.point[0]), 6), found.outcome.name
    (3.0, 'CONVERGED')
    """
    best: Evaluation | None = None
    count = 0
    batch: list[Evaluation] = []
    with ThreadPoolExecutor(jobs) as pool:
        try:
            points = next(optimiser)
            while True:
                batch = list(pool.map(evaluate, np.atleast_2d(points)))
                count += len(batch)
                for e in batch:
                    best = e if best is None or e.cost < best.cost else best
                if log is not None:
                    log(batch)
                if callback is not None and best is not None:
                    callback(best, count)
                points = optimiser.send(batch)
        except StopIteration as end:
            outcome = end.value
        except KeyboardInterrupt:
            pool.shutdown(cancel_futures=True)
            outcome = Outcome.INTERRUPTED
        finally:
            optimiser.close()
    if best is None:
        raise KeyboardInterrupt
    if not np.isfinite(best.cost):
        best, outcome = batch[-1], Outcome.ALL_FAILED
    return Result(best, outcome, count)


def as_generator(run: Callable[[Callable[[FloatArray], list[Evaluation]]], Outcome]) -> Optimiser:
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
    asked: queue.SimpleQueue[Any] = queue.SimpleQueue()
    told: queue.SimpleQueue[list[Evaluation] | None] = queue.SimpleQueue()

    def evaluate(points: FloatArray) -> list[Evaluation]:
        asked.put(np.atleast_2d(np.asarray(points, dtype=np.float64)))
        evaluations = told.get()
        if evaluations is None:
            raise _Closed
        return evaluations

    def work() -> None:
        try:
            asked.put(run(evaluate))
        except _Closed:
            pass
        except BaseException as error:  # handed to whoever asks next
            asked.put(error)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    try:
        while True:
            item = asked.get()
            if isinstance(item, BaseException):
                raise item
            if isinstance(item, Outcome):
                return item
            told.put((yield item))
    finally:
        told.put(None)
        thread.join()


class _Closed(Exception):
    """The generator was closed: unwinds the function in its thread."""
