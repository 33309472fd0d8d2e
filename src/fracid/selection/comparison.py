r"""A fair trial of the fractional model: the ladder of structures, fitted alike and judged on recordings not fitted.

Every structure of :mod:`fracid.selection.ladder` is

1. **fitted** to the same recordings by the same search: least squares on a growing horizon from the problem's start
   (and more starts, if asked), from the optima of the structures that it holds, so that a richer one is never worse
   for a bad search, and from the fit of the project as it stands;
2. **scored in sample** by the root mean square error and the fit of each output, ITAE, and Schwarz's criterion with the
   samples that correlated residuals are worth (:mod:`fracid.selection.bic`);
3. **scored on recordings not fitted**: those with ``use = "validate"``, or each in turn (*leave one out*).  There the
   initial state, and what each recording has for itself, such as its rests, are found again; all else is fixed.

**The verdict** is that of :mod:`fracid.selection.comparison_verdict`.

**The evidence**, where it is asked for, stands beside (:mod:`fracid.bayes.evidence`): each structure's likelihood,
averaged over its bounds and priors, as log odds against the most probable one.  No rule above or below reads it.

**The claim** asks for more, for held-out recordings lack the same physics: what is left over of the winner is noise or
rounding, its orders exclude the integers, nothing of integer order does as well, and its orders do not drift with
amplitude (:mod:`fracid.selection.claim`).

The fits are tasks of :func:`fracid.tasks.tasks.run_tasks`, in waves, for a structure waits for those that it holds.
Its numbers are the same to the bit for any executor and any number of jobs, after a resumption too.
"""

from __future__ import annotations

import hashlib
import math
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from graphlib import TopologicalSorter
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fracid.arrays import ByName, FloatArray
from fracid.bayes.evidence import laplace_evidence, log_fit, require_evidence
from fracid.errors import Failure, InputError
from fracid.estimation.climbing import by_windows, embedded, entries, found_again, late_rungs, starting_at, without
from fracid.estimation.covariance import uncertainty
from fracid.estimation.horizons import Watch, from_start, lowest_from
from fracid.estimation.input_noise import with_input_noise
from fracid.estimation.long_records import is_coarse, to_compare
from fracid.estimation.records import RecordingFit
from fracid.estimation.search import search
from fracid.estimation.windows import PARTS, chosen_window, windowed
from fracid.findings import with_code
from fracid.models.friction import SPRINGPOT
from fracid.optimise import OPTIMISERS, Entry, Evaluation
from fracid.problem import Experiment, Problem
from fracid.problem.costs import COSTS
from fracid.problem.problem import alternative_of
from fracid.problem.project import Project, load_project
from fracid.safety.json_files import json_number
from fracid.safety.schema import as_json, record_of
from fracid.selection.amplitude import AmplitudeTest, amplitude_test
from fracid.selection.bic import schwarz
from fracid.selection.claim import OrderFound, claim_of, no_run, of_model
from fracid.selection.comparison_records import (
    Comparison,
    EvidenceBlock,
    FittedBlock,
    GivenBlock,
    OrderOfRow,
    Row,
    Score,
    best_of,
    drawn,
)
from fracid.selection.comparison_verdict import ORDERS_HELP, integer_does_as_well, not_helped, verdict_of
from fracid.selection.integer_alternatives import LEAST, TIMES, integer_alternatives
from fracid.selection.integer_rival import Alternative
from fracid.selection.ladder import PAPER, Ladder, Structure, assignment, ladder, name_of
from fracid.selection.opened_bounds import SAYS, OpenedBound, open_bounds, opened_bounds, reopened
from fracid.selection.residual_noise import leftovers
from fracid.selection.step import HIGHER, quiet_substeps
from fracid.signals.correlation import effective_samples
from fracid.tasks.display import counted
from fracid.tasks.job import Progress, Task
from fracid.tasks.journal import Journal
from fracid.tasks.tasks import Execution, Part
from fracid.units import half_of

SAME = 1e-3
"""A cost that is higher by less than this part is as low."""

GIVEN = "the project as it stands"
"""From whose fit every structure may start."""

MORE = 10.0
"""Times the work that a fit gives to models of integer order, for who compares wants all of them; yet it ends."""

_cost = attrgetter("cost")

WARM = 15
"""Steps of least squares from the optimum of a structure below, before it is known to be the best start."""

FAR = 60
"""The same from where friction comes in, whose shape may be off by ten there."""


@counted("fits")
def compare(
    problem: Problem | Project,
    *,
    validation: Sequence[Experiment] = (),
    leave_one_out: bool = False,
    keep: Collection[str] = (),
    rungs: Collection[str] | None = None,
    amplitude: bool = False,
    evidence: bool = False,
    seed: int | None = None,
    starts: int | None = None,
    executor: str = "threads",
    jobs: int = 1,
    journal: Journal | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> Comparison:
    """Fit every structure of the ladder, and judge each on held-out recordings.

    Parameters
    ----------
    problem : Problem or Project
        A project brings its own validation recordings, seed and starts.
    validation : sequence of Experiment
        Held-out recordings.
    leave_one_out : bool
        Whether each recording, fitted or not, is held out once while all others are fitted.
    keep : collection of str
        Parameters of friction that stay as the problem has them.
    rungs : collection of str, optional
        Which rungs of the ladder are climbed (:data:`fracid.models.friction.RUNGS`); those up to LuGre's but
        for a tilt's, and the project's own structure, if left out.
    amplitude : bool
        Whether the orders of the paper's structure and of the best fractional one are tested for a drift with
        amplitude (:mod:`fracid.selection.amplitude`).
    evidence : bool
        Whether each structure gets its posterior odds (:mod:`fracid.bayes.evidence`); no verdict or claim heeds them.
    seed, starts : int, optional
        Of each search; 1, or as the project says.
    executor, jobs, journal, progress
        As in :func:`fracid.tasks.tasks.run_tasks`.  Processes and clusters load the project's file themselves.

    Returns
    -------
    Comparison

    Raises
    ------
    InputError
        If there is nothing to compare, one recording is too few, a problem in memory is to be sent to processes, or
        there is no evidence: the cost is a user's own, or a free parameter has no bounds.
    Unfinished
        As :func:`fracid.tasks.tasks.run_tasks` does.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Free
    >>> rig = fracid.rotary_pendulum("stepper-freeswing", coulomb_alpha=1e-4)
    >>> def swing(angle):
    ...     run = fracid.simulate(rig, orders={"lambda": 1.0, "mu": 1.0}, initial={"alpha": angle}, step=1e-2, end=5.0)
    ...     return Experiment(f"{angle} rad", 1e-2, run.states[:, [2]], np.zeros((1, 1)), initial={"alpha": angle})
    >>> problem = Problem(rig, (swing(0.5),), {"lambda": 1.0, "mu": Free(1.0, 0.8, 1.2)}, outputs=("alpha",),
    ...                   initial_state="held")
    >>> compare(problem, validation=[swing(0.2)]).verdict.split(":")[0]
    'Orders make no difference, an integer-order model predicts as well'
    """
    _fold_of.cache_clear()
    given = _Given.of(problem, validation)
    if executor != "threads" and not given.file:
        raise InputError(SAYS("in-memory", executor=executor))
    base = given.problem
    if isinstance(problem, Project):
        seed, starts = problem.seed if seed is None else seed, problem.starts if starts is None else starts
    seed, starts = 1 if seed is None else seed, starts or 1
    folds = _folds(base, given.validation, leave_one_out)
    optimiser = problem.optimiser if isinstance(problem, Project) else "multistart"
    whole = _Place(given, tuple(sorted(keep)), None if rungs is None else tuple(rungs), leave_one_out)
    study = _Study(whole, folds, optimiser, seed, starts=starts, execution=Execution(executor, jobs, journal, progress))
    if evidence:
        for s in study.ladder(WHOLE).structures:
            require_evidence(s.problem)
    study.fit()
    longest = max(base.experiments, key=lambda e: e.time[-1])
    long = (SAYS("long-recordings", e=longest, length=longest.time[-1]),) if is_coarse(base) else ()
    notes = (*long, *(b.sentence for b in study.whole.opened))
    fixed_step = not is_coarse(base) and (not isinstance(problem, Project) or problem.fixed_step)
    if not fixed_step and (substeps := study.substeps()) > base.substeps:
        study.fit(substeps)
        notes = (*notes, SAYS("refined", substeps=substeps, base=base))
    rows, samples = study.rows()
    if evidence:
        rows, without = study.with_odds(rows, samples)
        notes += without
    units = {n: unit for e in base.experiments for n, unit in e.units.items()}
    problems = {s.name: s.problem for s in study.ladder(WHOLE).structures}
    comparison = Comparison(rows, "", (*notes, *study.ladder(WHOLE).notes), base.outputs, effective_samples=samples,
                            leave_one_out=leave_one_out, cost_name=base.cost_function.name, seed=seed, starts=starts,
                            units=units, problems=problems)  # fmt: skip
    if amplitude:
        names = [row.name for row in rows if row.paper] + [comparison.best(fractional=True).name]
        comparison = replace(comparison, amplitude=study.amplitude(comparison, names))
    integers = {n: base.model.integer_order(n) for n in base.orders}
    return _claimed(study, replace(comparison, verdict=verdict_of(comparison, integers)), base)


# --- which recordings are fitted, and which are held out ---------------------------------------------

WHOLE = ""
"""The fold that fits all the recordings that are to be fitted."""


def _folds(problem: Problem, others: Sequence[Experiment], leave_one_out: bool) -> dict[str, tuple[str, ...]]:
    """Fold → the names of the recordings that it holds out."""
    if not leave_one_out:
        return {WHOLE: tuple(e.name for e in others)}
    names = [e.name for e in (*problem.experiments, *others)]
    if len(names) < 2:
        raise InputError("To leave one recording out takes two at least: add another [[recording]].")
    return {WHOLE: ()} | {name: (name,) for name in names}


@dataclass(frozen=True, eq=False)
class _Given:
    """What is compared; other processes load its project's file themselves, for compiled code does not travel."""

    problem: Problem
    validation: tuple[Experiment, ...]
    alternatives: Mapping[str, Problem] = field(default_factory=dict)
    """Models of integer order beside the ladder."""
    file: tuple[str, str | None, str, bool] | None = None
    """The project's path, preset and SHA-256, and whether its own code is trusted; None where there is none."""

    @classmethod
    def of(cls, source: Problem | Project, validation: Sequence[Experiment]) -> _Given:
        if isinstance(source, Problem):
            return cls(*to_compare(source, validation))
        digest = hashlib.sha256(source.text.encode()).hexdigest()
        file = str(Path(source.path).resolve()), source.preset, digest, bool(source.own_code)
        return cls(*to_compare(source.problem, (*source.validation, *validation)), source.alternatives, file)

    def __reduce__(self) -> tuple[Any, ...]:
        return _of_file, self.file or ()


@lru_cache(maxsize=1)
def _of_file(path: str, preset: str | None, sha256: str, trust: bool) -> _Given:
    given = _Given.of(load_project(path, preset=preset, trust=trust), ())
    if given.file is None or given.file[2] != sha256:
        raise InputError(f"{path} has changed since the comparison began; begin it again.")
    return given


class _Fold(NamedTuple):
    """What is fitted and what is held out, with the ladder of it."""

    held_out: tuple[Experiment, ...]
    ladder: Ladder
    window: float | None
    """Seconds of the windows in which recordings are fitted, where no simulation follows them."""


@dataclass(frozen=True)
class _Place:
    """Which recordings a task fits, and which it does not see; and how all structures are fitted."""

    given: _Given
    keep: tuple[str, ...]
    """Parameters that are as the project has them."""
    rungs: tuple[str, ...] | None
    leave_one_out: bool
    held_out: tuple[str, ...] = ()
    substeps: int | None = None
    """Steps a sample; None for the problem's."""
    opened: tuple[OpenedBound, ...] = ()
    """The bounds that the fit of the project opened: they are open for every structure."""

    def minimum(self, name: str, values: ByName) -> tuple[Problem, FloatArray]:
        """A structure's problem, and its minimum."""
        problem = _fold_of(self).ladder[name].problem
        return problem, np.array([values[n] for n in problem.names])


@lru_cache(maxsize=128)
def _fold_of(place: _Place) -> _Fold:
    """A process makes it once."""
    given = place.given
    problem = reopened(given.problem, place.opened)
    every = (*problem.experiments, *given.validation)
    fitted = tuple(e for e in (every if place.leave_one_out else problem.experiments) if e.name not in place.held_out)
    others = tuple(e for e in every if e.name in place.held_out)
    window = chosen_window(problem)
    window = window and window / PARTS  # where any start leads to the minimum
    fitted_problem = replace(problem, experiments=fitted)
    fitted_problem = windowed(fitted_problem, window) if window else fitted_problem
    beside = {n: alternative_of(fitted_problem, p.model, p.orders, p.parameters) for n, p in given.alternatives.items()}
    every_structure = ladder(fitted_problem, keep=place.keep, rungs=place.rungs, others=others, alternatives=beside)
    return _Fold(others, every_structure.solved_with(place.substeps or problem.substeps), window)


# --- one structure -------------------------------------------------------------------------------------


def _fit_project(
    place: _Place, optimiser: str, seed: int, starts: int, jobs: int, before: dict[str, float] | None
) -> dict[str, Any]:
    """Where every structure may start: the project as it stands, searched as a fit of it is, and its bounds opened.

    `before` has its minimum at a coarser step; a fit at this one would not know that, and may come to another.
    """
    given, watch, opened = _fold_of(place).ladder.given, Watch(jobs), tuple[OpenedBound, ...]()
    if given.names:
        entry = OPTIMISERS[optimiser]
        entry = _optimiser(given) if entry.keeps_its_own or given.cost_function.loss is None else entry
        ends = [search(given, entry, np.random.default_rng(seed), starts=starts, watch=watch)[0].best]
        if before is not None:
            ends.append(_descended(given, embedded(given, before), watch))
        within = min(ends, key=_cost)
        wider, best = open_bounds(given, within, jobs=jobs)
        opened, given = opened_bounds(given, within.cost, wider, best), wider
    else:
        best = given.evaluate(given.start)
    values = assignment(given, best.point) if math.isfinite(best.cost) else {}
    return as_json(GivenBlock, {"values": values, "opened": opened, "work": watch.work})


def _optimiser(problem: Problem) -> Entry:
    return OPTIMISERS["differential-evolution" if problem.cost_function.loss is None else "multistart"]


def _fit_structure(
    place: _Place, name: str, below: dict[str, dict[str, float]], seed: int, starts: int, jobs: int,
    before: tuple[dict[str, float], str, int] | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Fit one structure and score it: a task, whose result is plain JSON.

    `below` has where it may start, each with all values: the minima of the structures that it holds, and the fit of the
    project.  `before` has its minimum at a coarser step, how that was found, and that step's number a sample.
    """
    structure, others, watch = _fold_of(place).ladder[name], _fold_of(place).held_out, Watch(jobs)
    problem = structure.problem
    best, outcome = (
        _fitted(structure, below, seed, starts, watch=watch) if before is None
        else _refitted(structure, below, *before, seed, starts, watch)
    )  # fmt: skip
    values, errors = problem.named(best.point), problem.errors(best.point)
    followed = {n: (e, problem.followed(best.point, n)) for n, (e, _) in problem.recordings.items()}
    predicted = {e.name: (problem, e, errors) if isinstance(errors, Failure)
                 else _predicted(structure, values, e, _fold_of(place).window, jobs=jobs) for e in others}  # fmt: skip
    every = followed | {name: (e, y) for name, (_, e, y) in predicted.items()}
    curves = {n: _curves(problem, e, y, len(every)) for n, (e, y) in every.items() if not isinstance(y, Failure)}
    intervals, beyond, at_bound = dict[str, tuple[float, float]](), dict[str, float](), tuple[str, ...]()
    precision = uncertainty(problem, best.point, jobs=jobs)
    precision = with_input_noise(problem, best.point, precision, jobs=jobs)
    if not isinstance(precision, Failure):
        searched = {problem.names[i]: i for i in problem.order_indices}
        intervals = {n: ends for n, i in searched.items() if (ends := precision.interval(best.point, i)) is not None}
        beyond = {n: precision.half_beyond_bounds(searched[n]) for n in intervals}
        at_bound = tuple(problem.names[i] for i in np.flatnonzero(precision.at_bound))
    at = {n: float(v) for n, v in (problem.order_starts | values).items()}
    roots = {n: problem.ties.get(n, n) for n in problem.orders}
    row = Row(
        structure.friction, structure.fractional, structure.name, structure.name == name_of(*PAPER), cost=best.cost,
        parameters=len(values), bic=math.inf,
        orders={n: OrderOfRow(at[q], intervals.get(q), beyond.get(q, 0.0)) for n, q in roots.items()}, values=values,
        at_bound=at_bound, in_sample={n: _score(problem, *found) for n, found in followed.items()},
        held_out={name: _score(*prediction) for name, prediction in predicted.items()},
        outcome=str(errors) if isinstance(errors, Failure) else outcome, left_over=leftovers(problem, best.point),
    )  # fmt: skip
    return as_json(FittedBlock, {
        "row": row,
        "squares": None if best.residuals is None else float(np.sum(best.residuals**2)),
        "samples": 2.0 if isinstance(errors, Failure) else effective_samples(errors, problem.scored),
        "curves": curves,
        "work": watch.work,
    })  # fmt: skip


Below = Mapping[str, ByName]
"""The minima of simpler structures, by their names."""


def _fitted(structure: Structure, below: Below, seed: int, starts: int, watch: Watch) -> tuple[Evaluation, str]:
    """The lowest that the search comes to, from the structures below and from its own start, or by windows.

    All go a few steps, and the lowest on: rich friction creeps to its minimum.
    """
    problem = structure.problem
    if not problem.names:
        return problem.evaluate(problem.start), "nothing is free"
    begun = [_lower(problem, structure.embed(values), f"from the optimum of {origin}", watch, budget=WARM)
             for origin, values in below.items()]  # fmt: skip
    if structure.given and GIVEN in below:  # its own search is that
        pass
    elif late_rungs(problem) and problem.cost_function.loss is not None and set(below) - {GIVEN}:
        begun += _climbed(structure, below, watch)
    else:
        result, _ = search(problem, _optimiser(problem), np.random.default_rng(seed), starts=starts, watch=watch)
        lowest = min((end.cost for end, _ in begun), default=math.inf)
        if result.best.cost <= lowest and problem.cost_function.loss is not None:
            return result.best, f"from its own start, {result.outcome.value}"
        begun = [(result.best, f"from its own start, {result.outcome.value}"), *begun]
    best, how = min(begun, key=lambda end: _cost(end[0]))
    return min(best, _descended(problem, best.point, watch), key=_cost), how


def _lower(problem: Problem, x: FloatArray, how: str, watch: Watch, **options: Any) -> tuple[Evaluation, str]:
    """What least squares comes to, or x where that is no lower."""
    return min(problem.evaluate(x), _descended(problem, x, watch, **options), key=_cost), how


def _refitted(
    structure: Structure, below: Below, values: ByName, how: str, coarse: int, seed: int, starts: int, watch: Watch
) -> tuple[Evaluation, str]:
    """The minimum at a finer step that the one at `coarse` steps leads to, where no structure that it holds is lower.

    Else, where the finer step has shifted the phase, say, the structure is fitted as if it had not been.
    """
    problem, own = structure.problem, structure.embed(values)
    if not problem.names:
        return problem.evaluate(own), how
    nested = [problem.evaluate(structure.embed(simpler)) for simpler in below.values()]
    before = replace(problem, substeps=coarse).cost(own)
    near, _ = _lower(problem, own, how, watch)
    lowest = min([near, *nested], key=_cost)
    if near.cost <= (1 + HIGHER) * before and near.cost <= (1 + SAME) * lowest.cost:
        return lowest, how
    return min((near, how), _fitted(structure, below, seed, starts, watch=watch), key=lambda end: _cost(end[0]))


def _climbed(structure: Structure, below: Below, watch: Watch) -> Iterator[tuple[Evaluation, str]]:
    """What a structure with rich friction comes to by windows, as a fit does; or from what it has beside that.

    And from the lowest of the structures below, with what comes in at each of its entries.
    """
    problem, late, last = structure.problem, late_rungs(structure.problem), structure.friction.rpartition(" + ")[2]
    if last not in late:
        # A drag or a cable came in last: it may matter more than all that came before.
        simple = without(problem, [n for rung in late.values() for n in rung])
        x = structure.embed(assignment(simple, from_start(simple, watch).point))
        yield _lower(problem, x, "from the simpler structure", watch, budget=WARM)
    elif not structure.fractional:
        yield by_windows(problem, watch, budget=WARM).best, "by windows"
        lowest = min((structure.embed(values) for values in below.values()), key=problem.cost)
        for entry in entries(problem, late[last]):
            x = embedded(problem, problem.named(lowest) | entry)
            for begin in (x, found_again(problem, x, problem, watch)):
                yield _lower(problem, begin, f"from the structures below, with {last}", watch, budget=FAR)


def _descended(problem: Problem, x: FloatArray, watch: Watch, **options: Any) -> Evaluation:
    return lowest_from(problem, x, watch, **({"tolerance": 1e-5} | options))


def _predicted(
    structure: Structure, values: ByName, e: Experiment, window: float | None, jobs: int
) -> tuple[Problem, Experiment, FloatArray | Failure]:
    """The simulation of a recording that was not fitted, its own unknowns found again."""
    alone = structure.on(values, e)
    alone = windowed(alone, window) if window else alone
    return alone, alone.recordings[e.name][0], alone.followed(from_start(alone, Watch(jobs)).point, e.name)


def _curves(problem: Problem, e: Experiment, simulated: FloatArray, recordings: int) -> dict[str, list[float | None]]:
    some = drawn(e.time.size, recordings)
    return {
        n: [json_number(float(f"{v:.5g}")) for v in y]
        for n, y in zip(problem.outputs, simulated[some].T.tolist(), strict=True)
    }


def _score(problem: Problem, e: Experiment, simulated: FloatArray | Failure) -> Score:
    if isinstance(simulated, Failure):
        none = dict.fromkeys(problem.outputs, math.inf)
        return Score(none, dict.fromkeys(problem.outputs, -math.inf), none, str(simulated))
    measured = dict(zip(problem.outputs, e.measured.T, strict=True))
    error = np.where(np.isnan(simulated), 0.0, e.measured - simulated)
    fitted = dict(zip(problem.outputs, (e.measured - error).T, strict=True))
    fit = RecordingFit(e.name, "", e.time, measured, fitted=fitted, cost=0.0, initial={}, parameters={}, units=e.units,
                       scored=dict(zip(problem.outputs, e.scored.T, strict=True)))  # fmt: skip
    by, own = COSTS["itae"], e.scored
    itae = {n: by.value(e.weighed_at, error[:, [o]], own[:, [o]]) for o, n in enumerate(problem.outputs)}
    return Score(fit.rmse, fit.fit_percent, itae)


# --- all of them -----------------------------------------------------------------------------------------


Work = Callable[..., Any]
"""What is done at a :class:`_Place`."""

Tasks = Mapping[Any, Task]
"""For what, how often."""


@dataclass
class _Study:
    """The fits of all folds, in waves."""

    whole: _Place
    """Of the fold that holds nothing out but what is to be."""
    folds: Mapping[str, tuple[str, ...]]
    optimiser: str
    """The project's."""
    seed: int
    starts: int
    execution: Execution
    total: int = 0
    """Fits, done and to do."""
    done: int = 0
    earlier: int = 0
    """Of the fits that are done, those that were in the journal before."""
    work: int = 0
    """Of the fits that are done, as their watches count it, whether they were in the journal or not."""
    given: Mapping[str, dict[str, float]] = field(default_factory=dict)
    """Fold → all values of the project as it stands, fitted; nothing where no run of it ends."""
    fits: dict[tuple[str, str], FittedBlock] = field(default_factory=dict)
    """(Fold, structure) → its fit."""
    began: float = field(default_factory=time.perf_counter)

    def place(self, fold: str = WHOLE) -> _Place:
        return replace(self.whole, held_out=self.folds[fold])

    def ladder(self, fold: str) -> Ladder:
        return _fold_of(self.place(fold)).ladder

    def fit(self, substeps: int | None = None) -> None:
        """Fit all structures, in waves; at a finer step, those that have a minimum once more, each from it."""
        coarse, self.whole = self.ladder(WHOLE).given.substeps, replace(self.whole, substeps=substeps)
        before = {at: (dict(fit.row.values), fit.row.outcome, coarse) for at, fit in self.fits.items() if fit.ended}
        finer = f"{substeps} steps a sample" if substeps else ""
        note = f"again, with {finer}" if finer else ""
        self.total += len(self.folds) + (len(before) or sum(len(self.ladder(f).structures) for f in self.folds))
        self._fit_project(note)
        for wave in self._waves():
            asked = [(fold, s) for fold, s in wave if (fold, s.name) in before or (fold, s.name) not in self.fits]
            self.fits |= self._run_fits(FittedBlock, _fit_structure, {
                (fold, s.name): Task(" | ".join(filter(None, (s.name, fold and f"without {fold}", finer))), (
                    *self._arguments(fold, s, len(wave)), before.get((fold, s.name)),
                )) for fold, s in asked
            }, note)  # fmt: skip

    def substeps(self) -> int:
        """The steps a sample at which the best rows of either kind are quiet."""
        kinds = [[row for row in self.rows()[0] if row.fractional == kind and math.isfinite(row.cost)]
                 for kind in (False, True)]  # fmt: skip
        best = [best_of(kind) for kind in kinds if kind]
        results = self._follow("step", "is the step fine enough?", _choose_step, best, max(1, self.execution.jobs // 2))
        return max((int(found["substeps"]) for found in results.values()), default=1)

    def _fit_project(self, again: str) -> None:
        """Fit the project as it stands, in each fold, and open the bounds that stop it for every structure."""
        jobs = max(1, self.execution.jobs // len(self.folds))
        found = self._run_fits(GivenBlock, _fit_project, {
            fold: Task(" | ".join(filter(None, (GIVEN, fold, again))), (
                self.place(fold), self.optimiser, self.seed, self.starts, jobs, self.given.get(fold) or None,
            )) for fold in self.folds
        }, again)  # fmt: skip
        self.given = {fold: block.values for fold, block in found.items()}
        self.whole = replace(self.whole, opened=(*self.whole.opened, *found[WHOLE].opened))

    def _waves(self) -> Iterator[list[tuple[str, Structure]]]:
        """Structures whose lower ones are done: rung k with orders 1 in wave k, with orders free in wave k + 1."""
        every = {(fold, s.name): s for fold in self.folds for s in self.ladder(fold).structures}
        waiting = TopologicalSorter({(fold, n): [(fold, lower) for lower in s.below] for (fold, n), s in every.items()})
        waiting.prepare()
        while wave := waiting.get_ready():
            yield [(fold, every[fold, n]) for fold, n in sorted(wave, key=[*every].index)]
            waiting.done(*wave)

    def _arguments(self, fold: str, s: Structure, beside: int) -> tuple[Any, ...]:
        place = self.place(fold)
        ended = {n: self.fits[fold, n].row for n in s.below if self.fits[fold, n].ended}
        below = {n: assignment(*place.minimum(n, row.values)) for n, row in ended.items()}
        below |= {GIVEN: self.given[fold]} if self.given[fold] else {}
        return place, s.name, below, self.seed, self.starts, max(1, self.execution.jobs // beside)

    def rows(self) -> tuple[tuple[Row, ...], float]:
        """The table's rows, and the samples that the residuals of the best in sample are worth."""
        hierarchy = self.ladder(WHOLE)
        whole = {s.name: self.fits[WHOLE, s.name] for s in hierarchy.structures}
        samples = min(whole.values(), key=lambda fit: fit.row.cost).samples
        criteria = {n: math.inf if fit.squares is None
                    else schwarz(fit.squares, fit.row.parameters, samples, hierarchy.given.cost_function)
                    for n, fit in whole.items()}  # fmt: skip
        lowest = min(criteria.values())
        rows = []
        for name, fit in whole.items():
            own = {fold: self.fits[fold, name] for fold in self.folds if (fold, name) in self.fits}
            held_out = {n: score for other in own.values() for n, score in other.row.held_out.items()}
            beyond = {n: y for fold, other in own.items() for n, y in other.curves.items() if n in self.folds[fold]}
            bic = criteria[name] - lowest if math.isfinite(lowest) else math.inf
            rows.append(replace(fit.row, bic=bic, held_out=held_out, curves={**fit.curves, **beyond}))
        return tuple(rows), samples

    def _run_fits(self, kind: type[FittedBlock | GivenBlock], work: Work, tasks: Tasks, note: str) -> dict[Any, Any]:
        """What each task finds, as a block of that kind."""
        found = {name: record_of(kind, result) for name, result in self._run(work, tasks, note).items()}
        self.done += len(tasks)
        self.work += sum(block.work for block in found.values())
        return found

    def _follow(self, what: str, note: str, work: Work, rows: Iterable[Row], *more: Any) -> dict[str, Any]:
        """What follows from the fits of some structures to all recordings; those stay what is counted."""
        tasks = {row.name: Task(f"{what} | {row.name}", (self.place(), row.name, dict(row.values), *more))
                 for row in rows}  # fmt: skip
        return self._run(work, tasks, note, beside=True)

    def _run(self, work: Work, tasks: Tasks, note: str, *, beside: bool = False) -> dict[Any, Any]:
        part, before, tell = Part("fits", self.done, self.total, beside), self.earlier, self.execution.progress

        def over_all(p: Progress) -> None:
            self.earlier = before + (0 if beside else p.earlier)
            seconds = time.perf_counter() - self.began
            if tell is not None:
                tell(Progress(part.done(p.done), self.total, self.earlier, seconds, note=note, even=False))

        results = replace(self.execution, progress=over_all, part=part).run(work, [*tasks.values()])
        return {name: results[task.key] for name, task in tasks.items()}

    def with_odds(self, rows: Sequence[Row], samples: float) -> tuple[tuple[Row, ...], tuple[str, ...]]:
        """The rows with their posterior odds, and why some have none."""
        fits, cost = (row for row in rows if math.isfinite(row.cost)), self.ladder(WHOLE).given.cost_function
        found = self._follow("evidence", "evidence", _log_evidence, fits, self.execution.jobs)
        without = tuple(f"{n} has no evidence: {its['reason']}" for n, its in found.items() if its["reason"])
        logs = {n: its["log_evidence"] + log_fit(its["cost"], samples, cost)
                for n, its in found.items() if not its["reason"]}  # fmt: skip
        most = max(logs.values(), default=math.nan)
        return tuple(replace(row, log_odds=logs.get(row.name, math.nan) - most) for row in rows), without

    def alternative(self, comparison: Comparison, row: Row) -> Alternative | None:
        """What of integer order comes nearest to a fractional structure."""
        own = self.whole.given.alternatives
        others = {r.name: dict(r.values) for r in comparison.rows if r.friction in own and math.isfinite(r.cost)}
        how = {"starts": self.starts, "seed": self.seed}
        watch = Watch(self.execution.jobs, most=MORE * max(TIMES * self.work, LEAST))
        (found,) = self._follow("alternatives", "integer-order alternatives", _try_alternatives, [row],
                                _half_widths(row), others, watch, how).values()  # fmt: skip
        return None if found["alternative"] is None else record_of(Alternative, found["alternative"])

    def amplitude(self, comparison: Comparison, structures: Sequence[str]) -> dict[str, AmplitudeTest]:
        """The amplitude test of some structures."""
        names = dict.fromkeys(n for n in structures if math.isfinite(comparison[n].cost))
        jobs = max(1, self.execution.jobs // max(1, len(names)))
        rows, note = (comparison[name] for name in names), "do the orders drift with amplitude?"
        results = self._follow("amplitude", note, _test_amplitude, rows, jobs)
        return {name: record_of(AmplitudeTest, found) for name, found in results.items()}


def _half_widths(row: Row) -> dict[str, float]:
    """Half the 95 % interval of each order that has one."""
    return {n: half_of(o.interval95) for n, o in row.orders.items() if o.interval95 is not None}


def _choose_step(place: _Place, name: str, values: ByName, jobs: int) -> dict[str, Any]:
    problem, x = place.minimum(name, values)
    shown = problem.cost_function.loss is not None and problem.names
    return {"substeps": quiet_substeps(problem, x, jobs=jobs) if shown else problem.substeps}


def _test_amplitude(place: _Place, name: str, values: ByName, jobs: int) -> dict[str, Any]:
    return amplitude_test(*place.minimum(name, values), others=_fold_of(place).held_out, jobs=jobs).to_json()


def _log_evidence(place: _Place, name: str, values: ByName, jobs: int) -> dict[str, Any]:
    """A structure's evidence and least cost, or the reason why there is none."""
    try:
        found = laplace_evidence(*place.minimum(name, values), jobs=jobs)
    except InputError as error:
        return as_json(EvidenceBlock, {"log_evidence": None, "cost": None, "reason": str(error)})
    return as_json(EvidenceBlock, {"log_evidence": found.log_evidence, "cost": found.cost, "reason": ""})


def _try_alternatives(
    place: _Place, name: str, values: ByName, half: ByName, others: Below, watch: Watch, how: dict[str, Any]
) -> dict[str, Any]:
    """Look for them with so much work at most, which is counted in steps, as beside a fit."""
    problem, x = place.minimum(name, values)
    every = _fold_of(place).ladder.structures
    beside = {s.friction: starting_at(s.problem, others[s.name]) for s in every if s.name in others}
    nearest = integer_alternatives(problem, problem.evaluate(x), half, own=beside, watch=watch, **how)
    return {"alternative": None if nearest is None else as_json(Alternative, nearest)}


def _claimed(study: _Study, comparison: Comparison, base: Problem) -> Comparison:
    """The comparison with its claim, what that needs being looked for only where all else speaks for orders."""
    fractional = comparison.best(fractional=True)
    if found := _springpots(comparison.best(fractional=False), base):
        why = f"The best structure with orders 1 has a springpot, {' and '.join(found)}, which is fractional itself."
        how = "To decide: fit that structure with fracid fit, and look at the interval of its order."
        return replace(comparison, claim="undecided", claim_reasons=(why, how))
    widths = _half_widths(fractional)
    orders = [OrderFound(n, o.value, widths.get(n, math.inf), beyond_bounds=o.beyond_bounds, **of_model(base, n))
              for n, o in fractional.orders.items() if n not in base.ties]  # fmt: skip
    if not (fractional.fits or comparison.best(fractional=False).fits):
        none = claim_of(orders, None, fractional.left_over) if math.isfinite(fractional.cost) else no_run()
        return replace(comparison, claim=none.claim, claim_reasons=none.reasons)
    if integer_does_as_well(comparison):
        return replace(comparison, claim="integer", claim_reasons=(comparison.verdict,))
    doubts = [*not_helped(comparison)]
    first = claim_of(orders, None, fractional.left_over, doubts, compared=True)
    if first.claim == "undecided" and not doubts and all(e.explained for e in fractional.left_over.values()):
        nearest = study.alternative(comparison, fractional)
        comparison = replace(comparison, alternative=nearest)
        first = claim_of(orders, nearest, fractional.left_over, compared=True)
        if first.claim == "fractional":
            if fractional.name not in comparison.amplitude:
                tests = study.amplitude(comparison, [fractional.name])
                comparison = replace(comparison, amplitude={**comparison.amplitude, **tests})
            drifts = [d.sentence for d in comparison.amplitude[fractional.name].drifts if d.drifts]
            first = claim_of(orders, nearest, fractional.left_over, drifts, support=[comparison.verdict], compared=True)
    verdict = comparison.verdict
    if first.claim != "fractional" and any(with_code([verdict], code) for code in ORDERS_HELP):
        verdict = SAYS("no-evidence", verdict=verdict)
    return replace(comparison, verdict=verdict, claim=first.claim, claim_reasons=first.reasons)


def _springpots(row: Row, problem: Problem) -> list[str]:
    """The orders of the springpots that a structure has come to."""
    kinds = problem.model.friction
    return [f"{n} = {v:.3g}" for n, v in row.values.items() if n in kinds and kinds[n].rung == SPRINGPOT.rung
            and kinds[n].off > 0.0 and row.values.get(n.replace("_order", ""), 0.0) > 0.0]  # fmt: skip
