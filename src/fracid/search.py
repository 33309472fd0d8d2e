"""The search for the minimum of a problem: one start on a growing horizon, or many, scored short first.

A pendulum's cost over a whole record is full of minima, each a swing off the next: the phase after thirty swings
says nothing to who has the first one wrong.  So every start is fitted to the first swing, from there to half as
much again, and so on to the whole record.  Dry friction makes minima of another kind, flat corners where a friction
or a drag has run into a bound or a sign; they show only late, and only another start leaves them.  With ``starts``
above 1:

1. **Starts** are the given one; that of the linear regression (:func:`fracid.regression.start_values`), where it
   applies; and scrambled Sobol points, drawn eight times as many as asked for.  Initial states stay as measured.
2. All are **scored on the first swing**; of the Sobol points the best go on.
3. The **horizon grows** for all together.  A start whose residuals have become those of a better one is left, and
   so is one that costs many times as much as the best; the given start is not, so many starts never end above one.
4. Those left are **polished** on the whole record.

Step 3 pays: on a release of a real SRV02 with 18 unknowns, 16 starts take 10 times as long as one, and six of them
come to the one minimum; with none left for its cost all 16 come to it, in three times the time.

What became of each start is kept (:class:`Start`), for the figure of all final costs, the *waterfall* [1]_: equal
final costs from different starts are what speaks for a global minimum.

References
----------
.. [1] A. Raue et al., *Lessons learned from quantitative dynamical modeling in systems biology*, PLoS ONE 8 (2013).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fracid.errors import InputError
from fracid.executor import Task, run_tasks
from fracid.journal import Journal
from fracid.optimise import (
    Evaluation,
    EvaluationLog,
    Optimiser,
    Outcome,
    Path,
    Result,
    least_squares,
    lockstep,
    minimise,
    optimiser_from_name,
    sobol_points,
)
from fracid.optimise.base import at_least
from fracid.portable import Portable, portable_memory
from fracid.problem import Experiment, Problem

__all__ = ["Start", "Watch", "final_cost", "growing", "minimised", "refined", "search", "won"]

FloatArray = NDArray[np.float64]

CANDIDATES = 8
"""Sobol points that are scored on the first swing, for each that goes on."""

SAME_COST = 1.01
"""Costs up to this factor above the lowest are the same step of the waterfall."""

HOPELESS = 5.0
"""A start that costs this many times the best of its horizon is left."""

POLISHED = ("differential-evolution", "cma", "nelder-mead")
"""Optimisers whose best point least squares goes on from.  The paper's genetic algorithm keeps its own, and the
examination of a fit says what it missed."""

PATIENCE = 2
"""Horizons before a start may be called hopeless."""


@dataclass(frozen=True)
class Start:
    """One start of the search, and what became of it."""

    origin: str
    """``given``, ``regression`` or ``Sobol 3``."""
    point: FloatArray
    """Where it started, shape (n_unknowns,)."""
    first_cost: float
    """There, on the first swing; infinite where the run fails."""
    end: FloatArray
    """Where it ended or was left, shape (n_unknowns,)."""
    cost: float | None
    """There, on the whole record; None where it was left before."""
    ended: str
    """How, in words."""
    evaluations: int
    joined: str | None = None
    """The origin of the start whose minimum it fell into."""


@dataclass
class Watch:
    """The log and the callback of a whole identification, over all its searches."""

    log: EvaluationLog | None = None
    callback: Callable[[Evaluation, int], None] | None = None
    count: int = 0


def search(
    problem: Problem, name: str, rng: np.random.Generator, *, jobs: int = 1, starts: int = 1,
    watch: Watch | None = None, options: dict[str, Any] | None = None, executor: str = "threads",
    journal: Journal | None = None,
) -> tuple[Result, tuple[Start, ...]]:  # fmt: skip
    """Minimise the cost of a problem by the optimiser of that name.

    With an `executor` other than threads, the starts of ``multistart`` are tasks of :func:`fracid.executor.run_tasks`,
    which know nothing of each other: none is left for another's sake, and each goes to its end.

    Returns
    -------
    Result
        On the whole record.
    tuple of Start
        Of ``multistart``, in the order in which they were made; empty for the others.

    Raises
    ------
    InputError
        If nothing is free, or as the optimiser does.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment, Free, Problem
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=4e-3, end=3.0)
    >>> swing = Experiment("twin", 4e-3, run.states[:, [0, 2]], np.zeros((1, 1)))
    >>> problem = Problem(rig, (swing,), {"lambda": Free(0.6, 0.5, 1.2), "mu": Free(1.15, 0.5, 1.2)},
    ...                   initial_state="held")
    >>> result, made = search(problem, "multistart", np.random.default_rng(1), starts=3)
    >>> result.best.point.round(4), [s.origin for s in made][0], len(made)
    (array([0.9 , 0.95]), 'given', 3)
    """
    if not problem.names:
        raise InputError("Nothing is free: give at least one order or parameter a start, a lower and an upper bound.")
    watch, options = watch or Watch(), options or {}
    if name != "multistart":
        found = minimised(problem, optimiser_from_name(name)(problem.space, rng, **options), jobs, watch)
        return (_polished(problem, found, jobs, watch) if name in POLISHED else found), ()
    points = [("given", problem.start)]
    if at_least("starts", starts, 1) > 1:
        points += _regression_start(problem)
        points += _sobol_starts(problem, starts - len(points), rng, jobs, watch, **options)
    if executor != "threads" and starts > 1:
        return _scattered(problem, points[:starts], executor, jobs, watch, journal)
    return _grown(problem, points[:starts], jobs, watch)


def growing(problem: Problem, x: FloatArray, jobs: int, watch: Watch, also: Sequence[FloatArray] = ()) -> Result:
    """Least squares from x, and from others, on the first swing, then on ever more, up to the whole record."""
    return _grown(problem, [("given", x), *(("other", other) for other in also)], jobs, watch)[0]


def refined(problem: Problem, x: FloatArray, jobs: int, watch: Watch, **options: Any) -> Result:
    """Least squares from x."""
    return minimised(problem, _descent(problem, x, **options), jobs, watch)


def minimised(problem: Problem, optimiser: Optimiser, jobs: int, watch: Watch) -> Result:
    """Run an optimiser on a problem, watched."""
    before = watch.count

    def callback(best: Evaluation, evaluations: int) -> None:
        if watch.callback is not None:
            watch.callback(best, before + evaluations)

    result = minimise(
        problem.evaluate, optimiser, jobs=jobs,
        log=None if watch.log is None else partial(watch.log.append, problem.names), callback=callback,
    )  # fmt: skip
    watch.count += result.evaluations
    return result


def _polished(problem: Problem, found: Result, jobs: int, watch: Watch) -> Result:
    """Go on by least squares from where a search without derivatives came to, where the cost has residuals."""
    if found.interrupted or problem.cost_function.loss is None or not np.isfinite(found.best.cost):
        return found
    after = refined(problem, found.best.point, jobs, watch)
    best = min(found.best, after.best, key=lambda e: e.cost)
    ended = after if after.interrupted else found
    return replace(ended, best=best, evaluations=found.evaluations + after.evaluations)


def won(starts: Sequence[Start]) -> Start | None:
    """The start that ended lowest."""
    ended = [s for s in starts if s.cost is not None]
    return min(ended, key=lambda s: s.cost if s.cost is not None else np.inf, default=None)


def final_cost(start: Start, starts: Sequence[Start]) -> float | None:
    """A start's final cost, or that of the one whose minimum it fell into; None where it was left for its cost."""
    by_origin = {s.origin: s for s in starts}
    while start.cost is None and start.joined is not None:
        start = by_origin[start.joined]
    return start.cost if start.cost is not None and np.isfinite(start.cost) else None


# --- where to start ----------------------------------------------------------------------------------


def _regression_start(problem: Problem) -> list[tuple[str, FloatArray]]:
    """The regression's start, where the model is a rotary pendulum and the regression finds anything."""
    from fracid.regression import start_values  # here: its packages take a second to import

    if problem.ties:  # it knows none
        return []
    try:
        x, _ = start_values(problem)
    except (InputError, np.linalg.LinAlgError):  # another model, no α, too short, nothing that it looks for
        return []
    return [] if np.array_equal(x, problem.start) or not np.all(np.isfinite(x)) else [("regression", x)]


def _sobol_starts(
    problem: Problem, count: int, rng: np.random.Generator, jobs: int, watch: Watch, candidates: int = CANDIDATES
) -> list[tuple[str, FloatArray]]:
    """Sobol points that come nearest on the first swing; initial states stay as measured."""
    if count < 1:
        return []
    measured = np.array([u.kind in ("initial", "time") for u in problem.unknowns])
    points = np.where(measured, problem.start, sobol_points(problem.space, count * candidates, rng))
    scored: list[Evaluation] = []

    def score() -> Optimiser:
        scored.extend((yield points))
        return Outcome.GENERATIONS_DONE

    minimised(problem.until(next(_horizons(problem))), score(), jobs, watch)
    order = sorted(range(len(scored)), key=lambda i: scored[i].cost)  # an interrupted one has scored nothing
    return [(f"Sobol {i + 1}", points[i]) for i in order[:count]]


# --- each start for itself, wherever there is a processor -----------------------------------------------


def _scattered(
    problem: Problem, points: list[tuple[str, FloatArray]], executor: str, jobs: int, watch: Watch,
    journal: Journal | None,
) -> tuple[Result, tuple[Start, ...]]:  # fmt: skip
    """One task a start; the problem that travels has its memory by name, and so has the one that judges."""
    problem = replace(problem, memory=portable_memory(problem.memory.name))
    tasks = [Task(origin, (Portable(problem), origin, x)) for origin, x in points]
    ended = [*run_tasks(_one_start, tasks, executor=executor, jobs=jobs, journal=journal).values()]
    starts = tuple(
        Start(origin, x, _infinite(e["first_cost"]), np.array(e["end"]), _infinite(e["cost"]), e["ended"],
              e["evaluations"])
        for (origin, x), e in zip(points, ended, strict=True)
    )  # fmt: skip
    watch.count += sum(s.evaluations for s in starts)
    best = min(ended, key=lambda e: _infinite(e["cost"]))
    return Result(problem.evaluate(np.array(best["end"])), Outcome(best["outcome"]), watch.count), starts


def _one_start(portable: Portable, origin: str, x: FloatArray) -> dict[str, Any]:
    """A start to its end, as plain JSON values."""
    found, (start,) = _grown(portable.problem, [(origin, x)], 1, Watch())
    first, last = (c if c is not None and np.isfinite(c) else None for c in (start.first_cost, start.cost))
    return {"first_cost": first, "end": start.end.tolist(), "cost": last, "ended": start.ended,
            "outcome": found.outcome.value, "evaluations": start.evaluations}  # fmt: skip


def _infinite(cost: float | None) -> float:
    """A cost from JSON, which knows no infinity."""
    return np.inf if cost is None else cost


# --- from the first swing to the whole record ----------------------------------------------------------


@dataclass
class _Way:
    """A start on its way."""

    origin: str
    start: FloatArray
    x: FloatArray
    first_cost: float = np.inf
    cost: float | None = None
    ended: str = "left when the search was interrupted"
    evaluations: int = 0
    joined: str | None = None

    def record(self) -> Start:
        return Start(self.origin, self.start, self.first_cost, self.x, self.cost, self.ended, self.evaluations,
                     self.joined)  # fmt: skip


def _grown(
    problem: Problem, points: list[tuple[str, FloatArray]], jobs: int, watch: Watch
) -> tuple[Result, tuple[Start, ...]]:
    ways = [_Way(origin, x, x) for origin, x in points]
    live, whole, began = list(ways), max(e.time[-1] for e in problem.experiments), watch.count
    for number, horizon in enumerate([*_horizons(problem), whole]):
        last = horizon == whole
        at = problem if last else problem.until(horizon)
        options = {"tolerance": 1e-5} if last else {"tolerance": 1e-2, "budget": 12}
        paths = [Path() for _ in live]
        descents = [_descent(at, w.x, **options) for w in live]
        result = minimised(at, lockstep(descents, paths), jobs, watch)
        for way, path in zip(live, paths, strict=True):
            _advance(way, path, live, number == 0, last, f"{horizon:.3g} s")
        if result.interrupted and not last:
            nearest = live[int(np.argmin([np.inf if p.best is None else p.best.cost for p in paths]))]
            result = replace(result, best=problem.evaluate(nearest.x))
        if result.interrupted or last:
            break
        live = _promising(live, paths, number, f"{horizon:.3g} s")
    return replace(result, evaluations=watch.count - began), tuple(w.record() for w in ways)


def _advance(way: _Way, path: Path, live: list[_Way], first: bool, last: bool, until: str) -> None:
    """Take over what a search has come to on one horizon."""
    way.evaluations += path.evaluations
    if path.best is None:
        return
    way.first_cost = path.first_cost if first else way.first_cost
    way.x = path.best.point if np.isfinite(path.best.cost) else way.x
    if path.joined is not None:
        way.joined = live[path.joined].origin
        way.ended = f"left at {until}: the fit has become that of the start {way.joined}"
    elif last:
        way.cost = path.best.cost
        way.ended = Outcome.INTERRUPTED.value if path.outcome is None else path.outcome.value


def _promising(live: list[_Way], paths: list[Path], number: int, until: str) -> list[_Way]:
    """Those that go on to the next horizon: the first, and who has neither joined another nor fallen far behind."""
    costs = [p.best.cost if p.best is not None else np.inf for p in paths]
    limit = np.inf if number < PATIENCE else HOPELESS * min(costs)
    kept = []
    for i, (way, cost) in enumerate(zip(live, costs, strict=True)):
        if i > 0 and way.joined is None and not cost < max(limit, 1e-300):
            far = "its run fails" if not np.isfinite(cost) else f"its cost is {cost / min(costs):.2g} times the best"
            way.ended = f"left at {until}: {far}"
        elif way.joined is None:
            kept.append(way)
    return kept


def _descent(problem: Problem, x: FloatArray, **options: Any) -> Optimiser:
    space = problem.space
    return least_squares(replace(space, start=np.clip(x, space.lower, space.upper)), None, **options)


def _horizons(problem: Problem) -> Iterator[float]:
    """Seconds: one swing of the slowest recording, then each half as long again, below the whole record.

    Doubling is too coarse: a swing's worth of phase error at the new end makes a minimum of its own.
    """
    whole = max(e.time[-1] for e in problem.experiments)
    horizon = max(_period(e) for e in problem.experiments)
    while horizon < 0.75 * whole:
        yield horizon
        horizon *= 1.5


def _period(e: Experiment) -> float:
    """The period at the peak of the spectrum of the output that varies most [s].

    A peak below three periods a record is drift, not swinging: then a sixteenth of the record.
    """
    swings = e.measured[:, np.argmax(np.std(e.measured, axis=0))]
    spectrum = np.abs(np.fft.rfft(swings - np.mean(swings)))
    peak = int(np.argmax(spectrum))
    return float(e.time[-1]) / (peak if peak >= 3 else 16)
