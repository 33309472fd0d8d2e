r"""Is what an identification says of its own errors true?  Identify a known truth again and again, and count.

A *repetition* takes a problem and values x of its unknowns for the truth, simulates every recording with them (``pi2``,
:data:`FINER` times finer than the problem, so that the steps of the fit are on trial as well), reads it as an encoder
does, and identifies the problem again, from its own start:

.. math::  y_t = q\,\mathrm{round}\Big(\frac{f_t(x) + σ\,ε_t - e}{q}\Big) + e, \qquad
           ε_t \sim N(0, 1), \quad e \sim U(0, q) ,

with the noise's *level* σ, the encoder's *resolution* q, and the edge e of a count, of each output its own: where the
marks lie nobody chooses.  Where the outputs have several units, both may be multiples of the RMS of each output's
residual at the truth.  A *cell* is one level with one resolution; over its repetitions, for each unknown,

=============  ============================================================================================
bias           mean of the estimates less the truth; known to spread/√n
spread         their standard deviation: what the standard error ought to be
claimed        root mean square of the standard errors that were claimed
coverage       in how many of the 95 % intervals the truth lies, with the exact binomial interval of that
               share [CP]_: of 50 intervals that keep their word 45 to 50 contain the true value, mostly;
               2 of 4 do not keep it: by chance so few contain it in 1.4 % of studies
failed         repetitions without a minimum: the run at the best point found fails
stopped short  repetitions whose search ended at a higher cost than that of the truth itself: there is
               a lower minimum, which it missed
=============  ============================================================================================

What makes intervals promise too much, then, shows as bias or as a claim below the spread; :attr:`NoiseStudy.sentences`
says which.  A fit whose own scheme is of first order is biased by its steps, one by ``itae`` by the rounding (see
:mod:`fracid.problem.costs`).  One on a held start that nobody named is spread by the noise of the first sample, of
which no interval knows: :attr:`Plan.findings` says so before the study, with the number.

Every repetition has random numbers of its own, by seed, level, resolution and number, whatever else the study holds
and whoever runs it (:mod:`fracid.tasks.tasks`).

References
----------
.. [CP] C. Clopper, E. Pearson, Biometrika 26 (1934) 404: exact limits of a binomial share.
"""

from __future__ import annotations

import math
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from fracid.arrays import FloatArray
from fracid.cards import CardDisplay, listed, tabulated
from fracid.errors import Failure, InputError, at_least
from fracid.estimation.covariance import Known, half_width, uncertainty
from fracid.estimation.search import search
from fracid.figures import Figure, Style, draw
from fracid.findings import Finding, Note, Words, with_code
from fracid.optimise import Evaluation, optimiser_from_name
from fracid.problem import Experiment, Problem
from fracid.problem.checks import require_free
from fracid.problem.costs import COSTS, cost_from_name
from fracid.safety.schema import UNREAD, Beside, Listed, Record, as_json
from fracid.selection.bic import STRONG
from fracid.selection.integer_rival import gain_over, integer_rival, is_off
from fracid.solver.methods import METHODS
from fracid.solver.trajectory import vector
from fracid.tasks.display import counted
from fracid.tasks.job import Progress, Task
from fracid.tasks.journal import Journal
from fracid.tasks.tasks import HERE, Execution
from fracid.twins.encoder import encoder, simulated
from fracid.validation.after_search import noisy_start, with_start
from fracid.validation.study_records import (
    TIMES,
    Cell,
    FailedBlock,
    RepetitionBlock,
    Statistics,
    binomial95,
    label_of,
)

SAYS = Words("validation/monte_carlo.toml")

BELIEVED = (0.90, 0.99)
"""Intervals of 95 % whose coverage lies within can be believed."""

ENOUGH = 20
"""Of fewer intervals nothing is said in their favour; against them even four can speak."""

BIASED = 0.5
"""A bias above this part of the spread is what spoils a coverage."""


@dataclass(frozen=True, repr=False, kw_only=True)
class NoiseStudy(CardDisplay, Record):
    """The result of :func:`noise_study`."""

    model: str = ""
    truth: Mapping[str, float]
    """The values that every repetition was to find."""
    method: str = ""
    cost_name: Annotated[str, Field(alias="cost")]
    """Name of the cost that was minimised."""
    outputs: Listed[str] = ()
    optimiser: str
    seeds: int
    """Repetitions a cell."""
    seed: int | None = None
    cells: Listed[Cell]
    """By resolution within level."""
    sentences: Listed[str] = ()
    """What it comes to, in plain words: how the search did, and for each unknown what its intervals are worth."""
    findings: Listed[Finding] = ()
    """What was known before it began to spoil the intervals."""
    sizes: Mapping[str, float] | None = None
    """Output → what levels and resolutions are multiples of; None where they are as they stand."""
    repetitions: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Each repetition's own result, by the key of its task."""
    problem: Beside[Problem] = UNREAD
    """That was simulated and fitted; None of what was read."""

    def incoherence(self) -> str:
        """Cells of other unknowns, and counts that cannot be."""
        if not self.cells:
            return "it has no cell"
        if any(set(cell.unknowns) != set(self.truth) for cell in self.cells):
            return "the unknowns of its cells are others"
        counts = (u for cell in self.cells for u in cell.unknowns.values())
        possible = all(0 <= u.held <= u.intervals <= u.estimates for u in counts)
        return "" if possible else "its counts are not possible"

    def table(self) -> Any:
        """The :meth:`lines` as a pandas ``DataFrame``, where pandas is installed."""
        return tabulated(self.lines())

    def lines(self) -> list[dict[str, Any]]:
        """One flat row for each unknown in each cell, for a CSV file."""
        cell_columns = ("level", "resolution", "counts_per_turn", "repetitions", "failed", "stopped_short")
        rows = []
        for cell in self.cells:
            own = {name: value for name, value in cell.to_json().items() if name in cell_columns}
            for name, s in cell.unknowns.items():
                values = s.to_json()
                low, high = values.pop("coverage95") or (None, None)
                rows.append(own | {"unknown": name} | values | {"coverage95_low": low, "coverage95_high": high})
        return rows

    def plot(self, *, style: str | Style = "screen") -> Figure:
        """Bias and spread against the level, coverage beside; see :func:`fracid.plots.noise_levels`.

        Parameters
        ----------
        style : str or Style
            ``screen``, ``journal`` or one's own; see :mod:`fracid.figures`.
        """
        return draw("noise_levels", self, style=style)

    def concluded(self) -> NoiseStudy:
        """The same with its sentences."""
        sentences = (*map(str, self.findings), *self._of_the_search(), *self._of_the_intervals())
        if with_code(sentences, "biased"):
            sentences = (*sentences, f"What may cause the bias: {'; '.join(self._causes())}.")
        return replace(self, sentences=sentences)

    def _causes(self) -> Iterator[str]:
        """What makes a bias, and what to do about it."""
        if any(cell.stopped_short for cell in self.cells):
            yield "a search that stops short (take another optimiser)"
        if METHODS[self.problem.method].convergence_order < 2:
            yield f'the scheme {self.problem.method}, of first order (type method = "pi2" in [fit])'
        else:
            yield f"the step (type substeps = {2 * self.problem.substeps} in [fit])"
        loss = self.problem.cost_function.loss
        if loss is not None and loss.centre == "median":
            yield f'the cost {self.problem.cost_function.name}, which rounding biases (type cost = "rmse")'
        if self.problem.initial_state in ("held", "measured"):
            yield 'a first sample that is taken for the start (type initial_state = "rest")'

    def _of_the_search(self) -> Iterator[str]:
        for cell in self.cells:
            for reason, times in cell.failures.items():
                yield f"{cell.label}: {times} of {cell.repetitions} repetitions found nothing: {reason}."
        short, whole = sum(c.stopped_short for c in self.cells), sum(c.repetitions - c.failed for c in self.cells)
        if short:
            yield SAYS("stopped-short", optimiser=self.optimiser, short=short, whole=whole)

    def _of_the_intervals(self) -> Iterator[str]:
        """What is wrong, a sentence each; then the others, in one sentence where they are many."""
        judged = {name: self._judged(name) for name in self.truth}
        for kinds in (("narrow-at", "narrow", "biased"), ("none",), ("wide",), ("few",), ("believed",)):
            group = {name: note for name, note in judged.items() if note.code in kinds}
            if {*kinds} & TOGETHER and len(group) > ALONE:
                yield self._folded([*group], *kinds)
            else:
                yield from group.values()

    def _told(self, name: str) -> list[tuple[Cell, Statistics]]:
        """The cells with noise that gave intervals of an unknown."""
        return [(c, s) for c in self.cells if (c.level or c.resolution) and (s := c.unknowns[name]).intervals]

    def _judged(self, name: str) -> Note:
        """What an unknown's intervals are worth; ``biased`` where they are too narrow for their estimates are off."""
        hits, intervals = _counts(self._told(name))
        narrow = [(c, s) for c, s in self._told(name) if _promises_too_much(s.held, s.intervals)]
        kinds = {
            "none": not intervals,
            "narrow-at": bool(narrow),
            "narrow": bool(intervals) and _promises_too_much(hits, intervals),
            "wide": hits > BELIEVED[1] * intervals and binomial95(hits, intervals)[0] > 0.95,
            "few": intervals < ENOUGH,
        }
        kind = next((kind for kind, is_so in kinds.items() if is_so), "believed")
        said = SAYS(kind, name=name, hits=hits, intervals=intervals, percent=100 * hits / max(intervals, 1),
                    where="; at ".join(_why(c, s) for c, s in narrow), chance=_by_chance(hits, intervals),
                    enough=ENOUGH)  # fmt: skip
        return Note(said, "biased" if any(_is_off(s) for _, s in narrow) else kind, name)

    def _folded(self, names: Sequence[str], kind: str) -> Note:
        hits, intervals = np.array([_counts(self._told(name)) for name in names]).T
        named = f"{len(names)} parameters" if len(names) > NAMED else listed(names)
        share = _range(f"{percent:.0f}" for percent in sorted(100 * hits / intervals))
        return Note(SAYS(f"all-{kind}", names=named, share=share, each=_range(map(str, sorted(intervals))),
                         enough=ENOUGH), kind)  # fmt: skip


TOGETHER, ALONE = {"few", "believed"}, 3
"""Kinds of which more than so many are told in one sentence."""

NAMED = 6
"""Of more than so many in one sentence their number stands for their names, which the table has."""


def _counts(rows: Sequence[tuple[Cell, Statistics]]) -> tuple[int, int]:
    """How many intervals contain the true value, and how many there are."""
    return sum(s.held for _, s in rows), sum(s.intervals for _, s in rows)


def _range(texts: Iterable[str]) -> str:
    least, *_, most = [*texts]
    return least if least == most else f"{least} to {most}"


@counted("repetitions")
def noise_study(
    problem: Problem,
    x: FloatArray,
    *,
    levels: Sequence[float],
    resolutions: Sequence[float] = (0.0,),
    seeds: int = 50,
    seed: int = 1,
    optimiser: str = "multistart",
    starts: int = 1,
    cost: str | None = None,
    options: Mapping[str, Any] | None = None,
    relative: bool = False,
    rival: bool = False,
    executor: str = "threads",
    jobs: int = 1,
    journal: Journal | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> NoiseStudy:
    """Identify a known truth again and again, at every level of noise with every resolution.

    Parameters
    ----------
    problem : Problem
        What is free, the recordings' lengths, inputs and starts; what they measured is replaced by the truth.
    x : array, shape (n_unknowns,)
        The truth.
    levels : sequence of float
        Standard deviations of the noise, in the outputs' unit [rad]; 0 for none.
    resolutions : sequence of float
        Steps of the encoder [rad], 2π/counts; 0 for none.
    relative : bool
        Whether both are multiples of the RMS of each output's residual at the truth, as outputs of several units need.
    seeds : int
        Repetitions in each cell.
    seed : int
        Of them all.
    optimiser, starts, options
        As for :func:`fracid.identify`.
    cost : str, optional
        In place of the problem's.
    rival : bool
        Whether each repetition also asks if its orders would be called fractional: off its integer value, and better
        than the integer-order alternative.  That takes up to twice as long.
    executor, jobs, journal, progress
        As for :func:`fracid.tasks.tasks.run_tasks`; each repetition runs on one thread.  The result is the same for
        any.

    Returns
    -------
    NoiseStudy

    Raises
    ------
    InputError
        For levels, resolutions or values that cannot be, a truth whose run fails, a recording that starts with a
        measured past, or a model or cost of one's own on other processes.
    Unfinished
        As :func:`fracid.tasks.tasks.run_tasks`.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment, Free
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> swing = Experiment("release", 4e-3, np.zeros((751, 2)), np.zeros((1, 1)), initial={"theta": 0.0, "alpha": 0.5})
    >>> problem = Problem(rig, (swing,), {"lambda": Free(1.0, 0.5, 1.2), "mu": Free(1.0, 0.5, 1.2)},
    ...                   initial_state="held", substeps=2)
    >>> found = noise_study(problem, np.array([0.9, 0.95]), levels=[2e-3], resolutions=[2 * np.pi / 4096], seeds=8)
    >>> mu = found.cells[0].unknowns["mu"]
    >>> abs(mu.bias) < 1e-4, mu.held >= 6
    (True, True)
    """
    plan = planned(
        problem, x, levels=levels, resolutions=resolutions, seeds=seeds, seed=seed, optimiser=optimiser, starts=starts,
        cost=cost, options=options, relative=relative, rival=rival,
    )  # fmt: skip
    return plan.run(Execution(executor, jobs, journal, progress))


@dataclass(frozen=True)
class Plan:
    """A study before it is done: its tasks, for a run of one's own over several studies at once."""

    problem: Problem
    truth: FloatArray
    """Shape (n_unknowns,)."""
    cells: tuple[tuple[float, float], ...]
    """Level and resolution of each [unit]."""
    unit: str
    """That of the scored outputs, or :data:`TIMES`."""
    seeds: int
    seed: int
    how: Mapping[str, Any]
    """optimiser, starts, options, rival, sizes."""

    @property
    def own(self) -> str:
        """The model or cost that comes from a user's file, which no other process has; empty where there is none."""
        cost, module = self.problem.cost_function, getattr(self.problem.model.rhs, "__module__", None) or ""
        if COSTS.get(cost.name) is not cost:
            return cost.name
        return "" if _importable(module.split(".")[0]) else self.problem.model.name

    @property
    def tasks(self) -> list[Task]:
        """One for each repetition, of the function :func:`repetition`."""
        twin = simulated(self.problem, self.truth)
        return [Task(key, (twin, self.truth.tolist(), *cell, (self.seed, k), self.how)) for cell, k, key in self._keys]

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """What spoils the intervals for sure: a start that is taken from noisy samples, at the highest level.

        Asked of a recording whose first samples happen to be exact, so that no interval is wide by their chance.
        """
        level, resolution = max(self.cells)
        if not level + resolution:
            return ()
        exact, rng = simulated(self.problem, self.truth), np.random.default_rng(self.seed)
        read = []
        for e in exact.experiments:
            n, y = len(e.slope_weights), _read(e, level, resolution, rng, sizes=self.how["sizes"])
            read.append(replace(e, measured=np.vstack([e.measured[:n], y[n:]])))
        noisy = replace(exact, experiments=tuple(read))
        known = with_start(noisy, self.truth, uncertainty(noisy, self.truth))
        return noisy_start(noisy, self.truth, known, included=False)

    @property
    def _keys(self) -> list[tuple[tuple[float, float], int, str]]:
        numbers = range(1, self.seeds + 1)
        return [(cell, k, f"{label_of(*cell, self.unit)}, repetition {k}") for cell in self.cells for k in numbers]

    def run(self, execution: Execution = HERE) -> NoiseStudy:
        """Do it; errors as of :func:`noise_study`."""
        if execution.executor != "threads" and self.own:
            raise InputError(SAYS("own-code", plan=self))
        return self.study(execution.run(repetition, self.tasks))

    def study(self, results: Mapping[str, Any]) -> NoiseStudy:
        """Gather what the repetitions found, by the keys of the tasks."""
        each = {cell: [results[key] for own, _, key in self._keys if own == cell] for cell in self.cells}
        sizes = dict(zip(self.problem.outputs, self.how["sizes"], strict=True)) if self.how["sizes"] else None
        cells = tuple(self._cell(*cell, each[cell]) for cell in self.cells)
        p = self.problem
        return NoiseStudy(
            problem=p, model=p.model.name, truth=p.named(self.truth), method=p.method, outputs=p.outputs,
            cost_name=p.cost_function.name, optimiser=self.how["optimiser"], seeds=self.seeds, seed=self.seed,
            cells=cells, findings=self.findings, sizes=sizes,
            repetitions={key: results[key] for _, _, key in self._keys},
        ).concluded()  # fmt: skip

    def _cell(self, level: float, resolution: float, each: list[dict[str, Any]]) -> Cell:
        good = [r for r in each if not r["failure"]]
        decisions = [r["fractional"] for r in good if r["fractional"] is not None]
        return Cell(
            level, resolution, len(each), dict(Counter(r["failure"] for r in each if r["failure"])),
            stopped_short=sum(r["cost_of_truth"] is not None and r["cost"] > r["cost_of_truth"] for r in good),
            evaluations=float(np.mean([r["evaluations"] for r in each])),
            fractional=sum(decisions) if decisions else None, unit=self.unit,
            unknowns={u.name: _statistics(u.name, u.unit, float(true), good)
                      for u, true in zip(self.problem.unknowns, self.truth, strict=True)},
        )  # fmt: skip


def planned(
    problem: Problem, x: FloatArray, *, levels: Sequence[float], resolutions: Sequence[float] = (0.0,), seeds: int = 50,
    seed: int = 1, optimiser: str = "multistart", starts: int = 1, cost: str | None = None,
    options: Mapping[str, Any] | None = None, relative: bool = False, rival: bool = False,
) -> Plan:  # fmt: skip
    """Plan a noise study without doing it; parameters and errors as of :func:`noise_study`.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment, Free
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> swing = Experiment("release", 4e-3, np.zeros((251, 2)), np.zeros((1, 1)), initial={"alpha": 0.5})
    >>> problem = Problem(rig, (swing,), {"lambda": 1.0, "mu": Free(1.0, 0.5, 1.2)}, initial_state="held")
    >>> plan = planned(problem, np.array([0.95]), levels=[0.0, 1e-3], resolutions=[2 * np.pi / 4096], seeds=2)
    >>> [task.key for task in plan.tasks][-1]
    '0.0572958° of noise, 4096 counts, repetition 2'
    """
    problem = problem if cost is None else replace(problem, cost_function=cost_from_name(cost))
    unit = TIMES if relative else unit_of(problem)
    cells, true = _cells(levels, resolutions, unit), _checked_truth(problem, x)
    at_least("seeds", seeds, 1)
    optimiser_from_name(optimiser)  # refuses an unknown one
    how = {"optimiser": optimiser, "starts": starts, "options": dict(options or {}), "rival": rival,
           "sizes": _sizes(problem, true) if relative else None}  # fmt: skip
    return Plan(problem, true, cells, unit, seeds, seed=seed, how=how)


# --- one repetition ----------------------------------------------------------------------------------


def repetition(
    twin: Problem, truth: list[float], level: float, resolution: float, seed: tuple[int, int], how: Mapping[str, Any]
) -> dict[str, Any]:
    """Read the truth with noise, identify it, and tell what was found: the work of one task.

    Parameters
    ----------
    twin
        The problem, its recordings those of the truth.
    truth : list of float
        The values to be found.
    level, resolution : float
        [rad]
    seed : (int, int)
        The study's, and the number of the repetition.
    how : mapping
        optimiser, starts, options, rival, sizes.

    Returns
    -------
    dict
        JSON values: ``values``, ``standard_errors`` and ``intervals`` by name, ``cost`` and ``cost_of_truth``,
        ``evaluations``, ``failure`` in words, empty where there is none, and ``fractional``.

    Examples
    --------
    See :func:`noise_study`, whose tasks call it.
    """
    own = np.random.SeedSequence(seed[0], spawn_key=(round(1e12 * level), round(1e12 * resolution), seed[1]))
    noise, luck = (np.random.default_rng(s) for s in own.spawn(2))
    read = tuple(replace(e, measured=_read(e, level, resolution, noise, sizes=how["sizes"])) for e in twin.experiments)
    problem, true = replace(twin, experiments=read), np.array(truth)
    optimiser = optimiser_from_name(how["optimiser"])
    result, _ = search(problem, optimiser, luck, starts=how["starts"], options=dict(how["options"]))
    best, at_truth = result.best, problem.cost(true)
    begun = {"evaluations": result.evaluations, "cost_of_truth": at_truth}
    if not math.isfinite(best.cost):
        return as_json(FailedBlock, begun | {"failure": best.reason or "no run reached its end", "cost": None})
    precision = uncertainty(problem, best.point)
    errors: dict[str, Any] = dict.fromkeys(problem.names)
    intervals = dict(errors)
    if not isinstance(precision, Failure):
        reach = zip(problem.names, precision.ends, problem.space.lower, problem.space.upper, strict=True)
        known = {n: i for i, (n, (low, high), a, b) in enumerate(reach) if low > a or high < b}  # within its bounds
        errors |= {n: float(precision.standard_error[i]) for n, i in known.items()}
        intervals |= {n: precision.interval(best.point, i) for n, i in known.items()}
    return as_json(RepetitionBlock, begun | {
        "failure": "",
        "cost": best.cost,
        "values": problem.named(best.point),
        "standard_errors": errors,
        "intervals": intervals,
        "fractional": _called_fractional(problem, best, precision) if how["rival"] else None,
    })  # fmt: skip


def _read(
    e: Experiment, level: float, resolution: float, rng: np.random.Generator, sizes: Sequence[float] | None
) -> FloatArray:
    """The outputs as noisy encoders read them; of level and resolution in multiples of `sizes`, if those are given."""
    size = np.array(sizes or 1.0)
    return size * encoder(e.measured / size, level, resolution, rng)


def _called_fractional(problem: Problem, best: Evaluation, precision: Known) -> bool | None:
    """Whether a report would: an order off its integer value by more than its interval, and the rival beaten.

    None where no free order has an integer value.
    """
    free = problem.free_orders
    if free and all(problem.model.integer_order(n) is None for n in free):
        return None
    half = {n: half_width(precision, best.point, i) for n, i in free.items()}
    if not any(is_off(problem, n, float(best.point[i]), half[n]) for n, i in free.items()):
        return False
    other = integer_rival(problem, best, half)
    return other is None or gain_over(other, problem, best)[1] > STRONG


# --- from repetitions to cells -----------------------------------------------------------------------


def unit_of(problem: Problem) -> str:
    """The unit of the noise: that of the scored outputs, rad where they have several."""
    units = {e.units.get(o, "rad") for e in problem.experiments for o in problem.outputs}
    return units.pop() if len(units) == 1 else "rad"


def _statistics(name: str, unit: str, truth: float, good: list[dict[str, Any]]) -> Statistics:
    values = np.array([r["values"][name] for r in good])
    errors = np.array([r["standard_errors"][name] for r in good if r["standard_errors"][name] is not None])
    intervals = [r["intervals"][name] for r in good if r["intervals"][name] is not None]
    return Statistics(
        unit, truth, len(values),
        float(np.mean(values) - truth) if len(values) else None,
        spread=float(np.std(values, ddof=1)) if len(values) > 1 else None,
        claimed=float(np.sqrt(np.mean(errors**2))) if len(errors) else None,
        intervals=len(intervals), held=sum(low <= truth <= high for low, high in intervals),
    )  # fmt: skip


def _promises_too_much(hits: int, intervals: int) -> bool:
    """Coverage below what can be believed, and not by chance."""
    return hits / intervals < BELIEVED[0] and binomial95(hits, intervals)[1] < 0.95


def _by_chance(hits: int, intervals: int) -> str:
    """How often true 95 % intervals do as badly.

    Examples
    --------
    >>> _by_chance(2, 4)
    'by chance this happens in 1.4 % of studies'
    """
    from scipy.special import bdtr

    percent = 100 * float(bdtr(hits, intervals, 0.95))
    return f"by chance this happens in {f'{percent:.2g}' if percent >= 0.01 else 'less than 0.01'} % of studies"


def _is_off(s: Statistics) -> bool:
    return s.bias is not None and bool(s.spread) and abs(s.bias) > BIASED * (s.spread or 0.0)


def _why(cell: Cell, s: Statistics) -> str:
    """What spoils the coverage of an unknown."""
    text = f"{cell.label} ({s.held} of {s.intervals}, {_by_chance(s.held, s.intervals)}"
    if s.bias and s.spread and _is_off(s):
        return f"{text}: the estimate is off by {s.bias:+.2g}, {abs(s.bias) / s.spread:.1f} times its spread)"
    if s.claimed and s.spread and s.spread > 1.15 * s.claimed:
        return f"{text}: the spread is {s.spread / s.claimed:.1f} times the standard error)"
    if cell.stopped_short > 0.1 * cell.repetitions:
        return f"{text}: the search stopped short in {cell.stopped_short})"
    return f"{text})"


# --- what cannot be ----------------------------------------------------------------------------------


def _cells(levels: Sequence[float], resolutions: Sequence[float], unit: str) -> tuple[tuple[float, float], ...]:
    of = "" if unit in (TIMES, "1") else f" {unit}"
    most = math.pi if unit == "rad" else math.inf
    expected = "a number from 0 to π, in radians" if unit == "rad" else "a number from 0 on"
    for what, values in (("level", levels), ("resolution", resolutions)):
        if not len(values):
            raise InputError(f"There is no {what}; give at least one{of and f' [{unit}]'}, 0 for none.")
        for value in values:
            if not (math.isfinite(value) and 0 <= value < most):
                raise InputError(f"{what} {value!r}{of}: expected {expected}.")
        if len({f"{value:.12f}" for value in values}) < len(values):
            raise InputError(f"The {what}s {', '.join(f'{v:g}' for v in values)}{of} name one twice; give each once.")
    return tuple((float(level), float(q)) for level in levels for q in resolutions)


def _sizes(problem: Problem, truth: FloatArray) -> list[float]:
    for output, size in (sizes := problem.levels(truth)).items():
        if not size:
            raise InputError(SAYS("zero-residual", output=output))
    return [*sizes.values()]


def _checked_truth(problem: Problem, x: FloatArray) -> FloatArray:
    require_free(problem.names)
    truth = vector("x", x)
    if truth.shape != (len(problem.names),) or not np.all(np.isfinite(truth)):
        raise InputError(SAYS("truth-shape", truth=truth, count=len(problem.names), names=", ".join(problem.names)))
    for u, value in zip(problem.unknowns, truth.tolist(), strict=True):
        if u.kind != "initial" and not u.range.lower <= value <= u.range.upper:  # an initial state's moves with it
            raise InputError(SAYS("truth-outside", u=u, value=value))
    return truth


def _importable(name: str) -> bool:
    """Whether a fresh interpreter finds a module of that name: not one that was run from a file."""
    return name == "fracid" or (bool(name) and any(f.find_spec(name, None) for f in sys.meta_path))
