"""The search for the minimum of a problem: one start on a growing horizon, or many, scored short first.

A pendulum's cost over a whole record is full of minima, each a swing off the next: the phase after thirty swings
says nothing to who has the first one wrong.  So every start is fitted to the first swing, from there to half as
much again, and so on to the whole record.  Dry friction makes minima of another kind, flat corners where a friction
or a drag has run into a bound or a sign; they show only late, and only another start leaves them.  With ``starts``
above 1:

1. **Starts** are the given one; that of the linear regression (:func:`fracid.regression.start_values`), where it
   applies; and scrambled Sobol points, drawn eight times as many as asked for.  Initial states stay as measured.
2. All are **scored on the first swing**; of the Sobol points the best go on.  A standstill before it says nothing of
   any, so the first horizon is a swing after it.  A start whose run fails, there or later, is moved to the next best.
3. The **horizon grows** for all together.  A start that has come down to the residuals of a better one is left, and
   so is one that costs many times as much as the best; the given start is not, so many starts never end above one.
4. Those left are **polished** on the whole record.

Rich friction, presliding and what follows it, has minima that no such start leaves: a search that has it free climbs to
it beside the starts (:mod:`fracid.estimation.climbing`).

Step 3 pays: on a release of a real SRV02 with 18 unknowns, 16 starts take 10 times as long as one, and six of them
come to the one minimum; with none left for its cost all 16 come to it, in three times the time.

What became of each start is kept (:class:`Start`), for the figure of all final costs, the *waterfall* [1]_: equal
final costs from different starts are what speaks for a global minimum.

References
----------
.. [1] A. Raue et al., *Lessons learned from quantitative dynamical modeling in systems biology*, PLoS ONE 8 (2013).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import DataError, InputError, at_least
from fracid.estimation.climbing import climbed
from fracid.estimation.horizons import Searched, Watch, grown_horizon, horizons, minimised, refined, uninterrupted
from fracid.estimation.starts import Begun, EndBlock, Start
from fracid.optimise import (
    MOST_STARTS,
    Entry,
    Evaluation,
    Optimiser,
    Outcome,
    Result,
    optimiser_from_name,
    sobol_points,
)
from fracid.optimise.least_squares import NO_ROWS
from fracid.problem import Problem
from fracid.problem.checks import require_free
from fracid.problem.project import Project
from fracid.safety.json_files import from_json
from fracid.safety.schema import as_json, record_of
from fracid.tasks.job import Task
from fracid.tasks.journal import Journal
from fracid.tasks.tasks import run_tasks

CANDIDATES = 8
"""Sobol points that are scored on the first swing, for each that goes on."""

DRAWS = 4
"""Times that so many are drawn, where the runs of most fail; starts, where all runs from the one asked for do."""

STRANGE = 1e50
"""What was measured does not reach as far; the regression takes fourth powers of it."""


def search(
    problem: Problem, optimiser: Entry, rng: np.random.Generator, *, starts: int = 1, watch: Watch | None = None,
    options: dict[str, Any] | None = None, executor: str = "threads", journal: Journal | None = None,
) -> Searched:  # fmt: skip
    """Minimise the cost of a problem by an optimiser, an entry of :data:`fracid.optimise.OPTIMISERS`.

    With an `executor` other than threads, the starts of ``multistart`` are tasks of
    :func:`fracid.tasks.tasks.run_tasks`, which know nothing of each other: none is left for another's sake, and each
    goes to its end.

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
    >>> from fracid.optimise import OPTIMISERS
    >>> from fracid.problem import Experiment, Free, Problem
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=4e-3, end=3.0)
    >>> swing = Experiment("twin", 4e-3, run.states[:, [0, 2]], np.zeros((1, 1)))
    >>> problem = Problem(rig, (swing,), {"lambda": Free(0.6, 0.5, 1.2), "mu": Free(1.15, 0.5, 1.2)},
    ...                   initial_state="held")
    >>> result, made = search(problem, OPTIMISERS["multistart"], np.random.default_rng(1), starts=3)
    >>> result.best.point.round(4), [s.origin for s in made][0], len(made)
    (array([0.9 , 0.95]), 'given', 3)
    """
    require_free(problem.names)
    watch, options = watch or Watch(), options or {}
    if optimiser.function is not None:
        result = minimised(problem, optimiser.function(problem.space, rng, **options), watch)
        return (_polished(problem, result, watch) if optimiser.polish else result), ()
    points = [("given", problem.start)]
    if at_least("starts", starts, 1, MOST_STARTS) > 1:
        points += _regression_start(problem)
        points += _sobol_starts(problem, starts - len(points), rng, watch, **options)
    points, spare = points[:starts], points[starts:] if starts > 1 else []
    if executor != "threads" and starts > 1:
        return _scattered(problem, points, executor, watch, journal=journal)
    if problem.cost_function.loss is None:
        problem.evaluate(problem.start)  # one that fails says so
        raise InputError(NO_ROWS)
    result, made = grown_horizon(problem, points, watch, spare)
    if starts == 1 and not (result.interrupted or result.best.cost < np.inf):
        return search(problem, optimiser, rng, starts=DRAWS, watch=watch, options=options)
    return (result, made) if result.interrupted else _climbing(problem, result, made, watch)


def searched(project: Project, purpose: str, jobs: int) -> FloatArray:
    """Give the point that a project's own search comes to.

    Raises
    ------
    DataError
        If no run reached its end, so that there is no model for a `purpose`.
    """
    optimiser, rng = optimiser_from_name(project.optimiser), np.random.default_rng(project.seed)
    best = uninterrupted(search(project.problem, optimiser, rng, starts=project.starts, watch=Watch(jobs))[0]).best
    if not np.isfinite(best.cost):
        raise DataError(f"{project.path}: no run reached its end: {best.reason}. There is no model to {purpose}.")
    return best.point


def _climbing(problem: Problem, result: Result, made: tuple[Start, ...], watch: Watch) -> Searched:
    """The lower of what the starts came to and what a climb to rich friction comes to, where there is any."""
    before = watch.count
    try:
        ends = climbed(problem, watch)
    except KeyboardInterrupt:
        return replace(result, outcome=Outcome.INTERRUPTED, evaluations=result.evaluations + watch.count - before), made
    starts = [
        Start(origin, problem.named(problem.start), np.inf, problem.named(r.best.point), cost=r.best.cost, joined=None,
              ended=r.outcome.value, evaluations=r.evaluations)
        for origin, r in ends
    ]  # fmt: skip
    lowest = min((result, *(end for _, end in ends)), key=lambda r: r.best.cost)
    return replace(lowest, evaluations=result.evaluations + watch.count - before), (*made, *starts)


def _polished(problem: Problem, result: Result, watch: Watch) -> Result:
    """Go on by least squares from where a search without derivatives came to, where the cost has residuals."""
    if result.interrupted or problem.cost_function.loss is None or not np.isfinite(result.best.cost):
        return result
    after = refined(problem, result.best.point, watch)
    best = min(result.best, after.best, key=lambda e: e.cost)
    final = after if after.interrupted else result
    return replace(final, best=best, evaluations=result.evaluations + after.evaluations)


# --- where to start ----------------------------------------------------------------------------------


def _regression_start(problem: Problem) -> list[Begun]:
    """The regression's start, where the model is a rotary pendulum and the regression finds anything."""
    from fracid.regression import start_values  # here: its packages take a second to import

    if problem.ties or any(np.max(np.abs(e.measured)) > STRANGE for e in problem.experiments):  # it knows none
        return []
    try:
        x, _ = start_values(problem)
    except (InputError, np.linalg.LinAlgError):  # another model, no α, too short, nothing that it looks for
        return []
    return [] if np.array_equal(x, problem.start) or not np.all(np.isfinite(x)) else [("regression", x)]


def _sobol_starts(
    problem: Problem, count: int, rng: np.random.Generator, watch: Watch, candidates: int = CANDIDATES
) -> list[Begun]:
    """Sobol points, `count` at least, those that come nearest on the first swing first; initial states as measured.

    Where the runs of too many fail, more are drawn.
    """
    if count < 1:
        return []
    measured = np.array([u.kind in ("initial", "time") for u in problem.unknowns])
    points, evaluations = np.empty((0, len(problem.names))), list[Evaluation]()
    part = problem.until(next(horizons(problem), problem.seconds))

    def score(more: FloatArray) -> Optimiser:
        evaluations.extend((yield more))
        return Outcome.GENERATIONS_DONE

    for _ in range(DRAWS):
        more = np.where(measured, problem.start, sobol_points(problem.space, count * candidates, rng))
        points = np.concatenate([points, more])
        if minimised(part, score(more), watch, "starts on the first swing").interrupted:
            break  # what is interrupted has scored nothing
        if np.count_nonzero([np.isfinite(e.cost) for e in evaluations]) >= count:
            break
    order = sorted(range(len(evaluations)), key=lambda i: evaluations[i].cost)
    order = order[:count] + [i for i in order[count:] if np.isfinite(evaluations[i].cost)]
    return [(f"Sobol {i + 1}", points[i]) for i in order]


# --- each start for itself, wherever there is a processor -----------------------------------------------


def _scattered(problem: Problem, points: list[Begun], executor: str, watch: Watch, journal: Journal | None) -> Searched:
    """One task a start."""
    tasks = [Task(origin, (problem, origin, x)) for origin, x in points]
    results = run_tasks(_one_start, tasks, executor=executor, jobs=watch.jobs, journal=journal).values()
    ends = [record_of(EndBlock, content) for content in results]
    starts = tuple(replace(e.start, cost=from_json(e.start.cost, np.inf)) for e in ends)
    watch.count += sum(s.evaluations for s in starts)
    watch.work += sum(s.evaluations for s in starts) * problem.simulator.work
    k = int(np.argmin(np.array([s.cost for s in starts], dtype=float)))
    best = problem.evaluate(np.array([starts[k].end[n] for n in problem.names]))
    return Result(best, ends[k].outcome, watch.count), starts


def _one_start(problem: Problem, origin: str, x: FloatArray) -> dict[str, Any]:
    """A start to its end, as plain JSON values."""
    result, (start,) = grown_horizon(problem, [(origin, x)], Watch())
    return as_json(EndBlock, {"start": start, "outcome": result.outcome})
