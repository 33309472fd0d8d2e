"""Least squares on a horizon that grows from the first swing to the whole record.

Until the first swing is matched, the phase after thirty swings carries no information; so a search begins with a
short part of the record, and lengthens it as long as the fit holds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from typing import Any

import numpy as np

from fracid.arrays import FloatArray
from fracid.estimation.starts import Begun, Start
from fracid.optimise import (
    Evaluation,
    EvaluationLog,
    Optimiser,
    Outcome,
    Path,
    Result,
    Told,
    least_squares,
    lockstep,
    minimise,
    nelder_mead,
)
from fracid.problem import Experiment, Problem
from fracid.problem.unknowns import ends_of


def uninterrupted(result: Result) -> Result:
    """Pass an interruption on: half a refinement says nothing."""
    if result.interrupted:
        raise KeyboardInterrupt
    return result


HOPELESS = 5.0
"""A start that costs this many times the best of its horizon is left."""

GROWTH = 1.5
"""Of a horizon.  Doubling is too coarse: a swing's worth of phase error at the new end makes a minimum of its own."""

LEAP = 4.0
"""Of a horizon where the frequency is known: the model is given, and only starts and rests are sought."""

MANY = 200
"""Swings that tell a frequency so well that of long records a horizon may leap."""

FAR = 2.0
"""A cost of whole windows that is so many times that of their first thirds is of starts that are off."""

LENGTHENS = 1.3
"""So much longer does the part of a window become."""

OF_WINDOWS: Mapping[str, Any] = {"tolerance": 1e-6, "budget": 30}
"""Least squares of windows: smaller gains are those of kinks, which friction makes and starts amplify."""

SMOOTH = "the whole record, by Huber's cost"
"""Before one of |e|."""

STILL = 0.5
"""Of the first horizon: a standstill that leaves less motion on it shifts all horizons."""

PATIENCE = 2
"""Horizons before a start may be called hopeless."""


@dataclass
class Watch:
    """The threads, the log and the callback of a whole identification, over all its searches."""

    jobs: int = 1
    log: EvaluationLog | None = None
    callback: Told | None = None
    count: int = 0
    best: Evaluation | None = None
    """The lowest on the whole record."""
    work: int = 0
    """Of all runs, in steps times states: the same on every machine, as no clock is."""
    most: float = np.inf
    """The work at which a search ends where it is."""

    @property
    def spent(self) -> bool:
        """Whether nothing is left of it."""
        return self.work > self.most

    def lowest(self, best: Evaluation, part: str) -> Evaluation:
        """What the callback gets: costs of a part of the record are lower, and would make the best so far rise."""
        if not part and (self.best is None or best.cost < self.best.cost):
            self.best = best
        return self.best or replace(best, cost=np.inf, residuals=None, reason=part)


def growing(problem: Problem, x: FloatArray, watch: Watch, also: Sequence[FloatArray] = ()) -> Result:
    """Least squares from x, and from others, on the first swing, then on ever more, up to the whole record."""
    return grown_horizon(problem, [("given", x), *(("other", other) for other in also)], watch)[0]


def from_start(problem: Problem, watch: Watch) -> Evaluation:
    """The minimum that the start of a problem leads to, or the start where nothing is free."""
    if not problem.names:
        return problem.evaluate(problem.start)
    search = refined if problem.cost_function.loss is None else growing
    return uninterrupted(search(problem, problem.start, watch)).best


def refined(problem: Problem, x: FloatArray, watch: Watch, **options: Any) -> Result:
    """Least squares from x; of windows at whose ends x is far off, first on ever more of each."""
    x = problem.space.clipped(x)
    if problem.in_windows:
        options = {**OF_WINDOWS, **options}
    for seconds in _of_windows(problem, x):
        begins = problem.until(seconds)
        part = f"the first {seconds:.3g} s of each window"
        result = minimised(begins, descent(begins, x, tolerance=1e-2, budget=12), watch, part)
        if result.interrupted:
            return replace(result, best=problem.evaluate(result.best.point))
        x = result.best.point
    return minimised(problem, descent(problem, x, **options), watch)


def lowest_from(problem: Problem, x: FloatArray, watch: Watch, **options: Any) -> Evaluation:
    """Where :func:`refined` ends; an interruption is passed on."""
    return uninterrupted(refined(problem, x, watch, **options)).best


def minimised(problem: Problem, optimiser: Optimiser, watch: Watch, part: str = "") -> Result:
    """Run an optimiser on a problem, watched; `part` says of which part of the record, where it is not the whole."""
    before, begun, each = watch.count, watch.work, problem.simulator.work

    def callback(best: Evaluation, evaluations: int) -> None:
        watch.work = begun + evaluations * each
        if watch.callback is not None:
            watch.callback(watch.lowest(best, part), before + evaluations)

    log = None if watch.log is None else partial(watch.log.append, problem.names)
    result = minimise(problem.evaluate, optimiser, jobs=watch.jobs, log=log, callback=callback,
                      stop=lambda: watch.spent, together=(problem.abreast, problem.evaluate_all))  # fmt: skip
    watch.count += result.evaluations
    return result


# --- from the first swing to the whole record ----------------------------------------------------------


@dataclass(eq=False, kw_only=True)
class _Way(Path):
    """A start on its way."""

    begun: FloatArray
    """Shape (n_unknowns,)."""
    at: FloatArray
    """Where it is by now, shape (n_unknowns,)."""
    on_first: float | None = None
    """The cost of where it began on the first horizon; None before."""
    cost: float | None = None
    """On the whole record."""
    ended: str = "left when the search was interrupted"

    def start(self, problem: Problem) -> Start:
        """What has become of it."""
        first, joined = np.inf if self.on_first is None else self.on_first, self.joined.name if self.joined else None
        begun, end = problem.named(self.begun), problem.named(self.at)
        return Start(self.name, begun, first, end, cost=self.cost, ended=self.ended, joined=joined,
                     evaluations=self.evaluations)  # fmt: skip


Searched = tuple[Result, tuple[Start, ...]]
"""How a search ended, and each of its starts."""


def grown_horizon(problem: Problem, points: list[Begun], watch: Watch, spare: Sequence[Begun] = ()) -> Searched:
    """Fit from several points on horizons that grow, and keep those that promise most at each.

    A start whose run fails on a longer horizon goes on from where it began, or, unless it is the first, from the next
    of the `spare` points.
    """
    live = ways = [_Way(name=origin, begun=x, at=x) for origin, x in points]
    baseline, others = watch.count, iter(spare)
    parts = [*_parts(problem)]
    for number, (part, at) in enumerate(parts):
        result = _on_part(at, live, part, watch)
        for way in live:
            if not result.interrupted and not way.lowest < np.inf:
                end = _anew(way, others if way is not live[0] else iter(()), parts[: number + 1], watch=watch)
                if end is not None:
                    best = min(result.best, end.best, key=lambda e: e.cost)
                    failed = result.outcome is Outcome.ALL_FAILED
                    result = replace(end if end.interrupted or failed else result, best=best)
        if result.interrupted and part:
            result = replace(result, best=problem.evaluate(min(live, key=lambda way: way.lowest).at))
        if result.interrupted or not part:
            break
        live = _promising(live, number, part)
    return replace(result, evaluations=watch.count - baseline), tuple(way.start(problem) for way in ways)


def _parts(problem: Problem) -> Iterator[tuple[str, Problem]]:
    """What leads to a problem, in words: its first seconds, ever more of them, and without words itself.

    A cost of |e| is Huber's until then.
    """
    smooth = replace(problem, cost_function=problem.cost_function.without_kink)
    for horizon in horizons(problem):
        yield f"the first {horizon:.3g} of {problem.seconds:.3g} s", smooth.until(horizon)
    if smooth.cost_function is not problem.cost_function:
        yield SMOOTH, smooth
    yield "", problem


def _on_part(at: Problem, live: list[_Way], part: str, watch: Watch) -> Result:
    """Fit all that are on their way to a part."""
    options: dict[str, Any] = {"tolerance": 1e-5} if part in (SMOOTH, "") else {"tolerance": 1e-2, "budget": 12}
    for way in live:
        way.best = way.outcome = None
    descents = [descent(at, way.at, **options) for way in live]
    result = minimised(at, lockstep(descents, live), watch, part)
    for way in live:
        if way.best is None:
            continue
        way.on_first = way.first_cost if way.on_first is None else way.on_first
        way.at = way.best.point if np.isfinite(way.best.cost) else way.at
        if way.joined is not None:
            way.ended = f"left after {part}: the fit has become that of the start {way.joined.name}"
        elif not part:
            way.cost, way.ended = way.best.cost, (way.outcome or Outcome.INTERRUPTED).value
    return result


def _anew(way: _Way, others: Iterator[Begun], parts: Sequence[tuple[str, Problem]], watch: Watch) -> Result | None:
    """Begin a start whose run fails anew: where it began, on the last of the parts that led here; else elsewhere.

    From other points it goes through all parts.  None where every run fails.
    """
    begun = [] if np.array_equal(way.at, way.begun) else [(way.name, way.begun, way.on_first, parts[-1:])]
    for name, x, on_first, left in chain(begun, ((*other, None, parts) for other in others)):
        way.name, way.begun, way.at, way.on_first, way.came_down = name, x, x, on_first, False
        for part, at in left:
            result = _on_part(at, [way], part, watch)
            if result.interrupted or not way.lowest < np.inf:
                break
        if result.interrupted or way.lowest < np.inf:
            return result
    return None


def _promising(live: list[_Way], number: int, until: str) -> list[_Way]:
    """Those that go on to the next horizon: the first, and who has neither joined another nor fallen far behind."""
    least = min(way.lowest for way in live)
    limit = np.inf if number < PATIENCE else max(HOPELESS * least, 1e-300)
    left = [way for way in live[1:] if way.joined is None and not way.lowest < limit]
    for way in left:
        far = f"its cost is {way.lowest / least:.2g} times the best" if np.isfinite(way.lowest) else "its run fails"
        way.ended = f"left after {until}: {far}"
    return [way for way in live if way.joined is None and way not in left]


def descent(problem: Problem, x: FloatArray, fixed: Sequence[int] = (), **options: Any) -> Optimiser:
    """Least squares from x, what is `fixed` held there; of a user's own cost Nelder and Mead's method."""
    start = problem.space.clipped(x)
    space = replace(problem.space, start=start, held=problem.absent(start) | np.isin(np.arange(len(x)), fixed))
    return nelder_mead(space, None) if problem.cost_function.loss is None else least_squares(space, None, **options)


def horizons(problem: Problem) -> Iterator[float]:
    """Seconds: one swing of the slowest recording, then each longer by a factor, below the whole record.

    A standstill before the motion, on which every model agrees, comes on top.
    Where samples are uneven, as those of a relaxation are, nothing swings, and there are none.
    """
    if all(e.times is not None for e in problem.experiments):
        return
    known = all(u.kind in ("initial", "time") or u.target in problem.model.rests for u in problem.unknowns)
    horizon = first = max(_first_horizon(e) for e in problem.experiments)
    still = max(e.standstill for e in problem.experiments)
    still = still if still > STILL * first else 0.0
    while still + horizon < 0.75 * problem.seconds:
        yield still + horizon
        many = horizon >= MANY * first and any(e.means > 1 for e in problem.experiments)
        horizon *= LEAP if many or known else GROWTH


def _of_windows(problem: Problem, x: FloatArray) -> Iterator[float]:
    """Seconds of windows, from a third of them on, where x is far off at their ends: what a start is off by grows."""
    seconds = problem.seconds / 3
    if problem.in_windows and not problem.cost(x) < FAR * problem.until(seconds).cost(x):
        while seconds < problem.seconds:
            yield seconds
            seconds *= LENGTHENS


def _first_horizon(e: Experiment) -> float:
    """One swing [s], of which a whole number fills the record; a sixteenth of a record of less than three swings.

    As long as is needed, too, for every release and every delay to lie in its first half."""
    swings = round(e.swings)
    late = max(e.longest_delay, *map(abs, ends_of(e.release_time)))
    return max(float(e.time[-1]) / (swings if swings >= 3 else 16), (2 * late + e.step) * (late > 0))
