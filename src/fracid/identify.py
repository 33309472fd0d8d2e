"""Find the free orders, constants and initial states of a problem: strategies, and their result, a Fit.

====================== ==========================================================================
optimiser              strategy
====================== ==========================================================================
multistart (default)   least squares from the start, on a horizon that grows to the whole record
                       (against local minima that are a whole swing off); then, with ``starts`` > 1,
                       from Sobol points too, and the best is kept
least-squares          the same with one start and no growing horizon
genetic                the paper's GA: 20 points, crossover 0.5, mutation 0.01, 25 generations
differential-evolution SciPy's
====================== ==========================================================================

Whatever found the minimum, :func:`identify` then

1. measures the uncertainty of every unknown (:mod:`fracid.uncertainty`),
2. finds each validation recording's own unknowns again (initial state, `per_recording`), all else fixed,
3. makes the *discretisation check*: the score at half the step and with the second-order method, and how
   far the orders move when they are refined there: a scheme that manufactures fractional orders shows,
4. goes on by least squares from the best of a search that is none, and says so where that finds better.

Ctrl-C keeps the best so far: in the search it skips the four, in one of them what is left of them.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fracid.errors import InputError
from fracid.optimise import (
    Evaluation,
    EvaluationLog,
    Outcome,
    Result,
    least_squares,
    minimise,
    nelder_mead,
    optimiser_from_name,
)
from fracid.problem import Experiment, Free, Problem, Unknown, refuse_twins
from fracid.uncertainty import Uncertainty, uncertainty

if TYPE_CHECKING:
    from fracid.project import Project

__all__ = ["Discretisation", "Estimate", "Fit", "RecordingFit", "identify"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Estimate:
    """A value with what is known of it."""

    value: float
    unit: str = ""
    free: bool = False
    standard_error: float | None = None
    """None for a fixed value, and where it cannot be known."""
    interval95: tuple[float, float] | None = None
    """From the sandwich of :mod:`fracid.uncertainty`; of this model, without model error."""
    at_bound: bool = False
    identifiable: str = "fixed"
    """The verdict in words."""


@dataclass(frozen=True)
class RecordingFit:
    """One recording beside its simulation."""

    name: str
    use: str
    """``fit`` or ``validate``."""
    time: FloatArray
    """On the recording's own clock [s], shape (n_samples,)."""
    measured: Mapping[str, FloatArray]
    """Output → [rad], shape (n_samples,)."""
    fitted: Mapping[str, FloatArray]
    """The same, simulated."""
    cost: float
    initial: Mapping[str, Estimate]
    """State → its value at the start."""
    parameters: Mapping[str, Estimate]
    """The parameters that this recording has for itself."""
    sha256: str = ""

    @property
    def rmse(self) -> dict[str, float]:
        """Root mean square of the residual, per output [rad]."""
        return {n: float(np.sqrt(np.mean((self.measured[n] - self.fitted[n]) ** 2))) for n in self.measured}

    @property
    def fit_percent(self) -> dict[str, float]:
        """100·(1 − ‖y − ŷ‖/‖y − ȳ‖), per output; −inf for a constant output that is missed."""
        return {n: _fit_percent(self.measured[n], self.fitted[n]) for n in self.measured}

    def residual(self, output: str) -> FloatArray:
        """Measured minus simulated [rad]."""
        return np.asarray(self.measured[output] - self.fitted[output])


@dataclass(frozen=True)
class Discretisation:
    """What the step and the scheme do to the result."""

    cost: float
    """With the method and step of the fit."""
    cost_half_step: float
    """The same unknowns at half the step."""
    cost_second_order: float
    """The same unknowns with pi2 at half the step."""
    orders: Mapping[str, float]
    """The orders refined with pi2 at half the step, all other unknowns with them; empty for a user's own cost."""
    shift: Mapping[str, float]
    """How far that moved them."""
    warning: str = ""
    """A sentence, where an order moved by more than its interval's half width, or the finer run fails."""


@dataclass(frozen=True)
class Fit:
    """The result of :func:`identify`."""

    problem: Problem
    x: FloatArray
    """The unknowns, shape (n_unknowns,)."""
    orders: Mapping[str, Estimate]
    parameters: Mapping[str, Estimate]
    recordings: Mapping[str, RecordingFit]
    cost: float
    outcome: str
    """How the search ended, in words."""
    evaluations: int
    discretisation: Discretisation | None
    uncertainty: Uncertainty | None
    seed: int
    optimiser: str
    warnings: tuple[str, ...] = ()
    timing: Mapping[str, float] = field(default_factory=dict)
    """Seconds spent, per stage."""

    def to_json(self) -> dict[str, Any]:
        """Everything but the samples, as plain JSON values; angles in radians.

        See :func:`fracid.runs.write_result` for the file.
        """
        p = self.problem
        return {
            "model": {"name": p.model.name, "zero": p.model.zero, "source": p.model.source},
            "method": p.method,
            "memory": p.memory.name,
            "step": p.experiments[0].step / p.substeps,
            "orders": {n: _estimate_json(e) for n, e in self.orders.items()},
            "parameters": {n: _estimate_json(e) for n, e in self.parameters.items()},
            "recordings": {n: _recording_json(r) for n, r in self.recordings.items()},
            "cost": {"name": p.cost_function.name, "value": _number(self.cost), "outputs": list(p.outputs)},
            "discretisation": None if self.discretisation is None else _discretisation_json(self.discretisation),
            "evaluations": self.evaluations,
            "optimiser": self.optimiser,
            "outcome": self.outcome,
            "interval_method": "sandwich with the prewhitened Newey-West long-run covariance"
            if self.uncertainty
            else None,
            "warnings": list(self.warnings),
            "seed": self.seed,
        }


def identify(
    problem: Problem | Project,
    *,
    optimiser: str | None = None,
    validation: tuple[Experiment, ...] = (),
    seed: int | None = None,
    jobs: int = 1,
    starts: int = 1,
    log: EvaluationLog | None = None,
    callback: Callable[[Evaluation, int], None] | None = None,
    options: Mapping[str, Any] | None = None,
) -> Fit:
    """Identify the unknowns of a problem.

    Parameters
    ----------
    problem : Problem or Project
        A project brings its own validation recordings, optimiser and seed.
    optimiser : str, optional
        See the module's table; the default is ``multistart``.
    validation : tuple of Experiment
        Recordings that are not fitted: their own unknowns are found again, the rest is fixed.
    seed : int, optional
        Of every random choice; 1 by default.
    jobs : int
        Threads; the result is the same for any number.
    starts : int
        Starts of ``multistart``.
    log : EvaluationLog, optional
        Gets each evaluation as it ends.
    callback : function (best evaluation so far, number of evaluations) -> None
        Called after each batch.
    options : mapping
        Passed on to the optimiser.

    Returns
    -------
    Fit
        Also where the search was interrupted (Ctrl-C): the best so far.

    Raises
    ------
    InputError
        For an unknown optimiser, or bounds that it cannot do with.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment, Free, Problem
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=2e-3, end=4.0)
    >>> swing = Experiment("twin", 2e-3, run.states[:, [0, 2]], np.zeros((1, 1)))
    >>> fit = identify(Problem(rig, (swing,), {"lambda": Free(1.0, 0.5, 1.2), "mu": Free(1.0, 0.5, 1.2)}))
    >>> round(fit.orders["lambda"].value, 4), round(fit.orders["mu"].value, 4)
    (0.9, 0.95)
    """
    if not isinstance(problem, Problem):
        project = problem
        problem, validation = project.problem, project.validation
        optimiser = optimiser or project.optimiser
        seed, starts = (project.seed if seed is None else seed), max(starts, project.starts)
    name, seed = optimiser or "multistart", 1 if seed is None else seed
    refuse_twins([*problem.experiments, *validation])
    clock, watch = _Clock(), _Watch(log, callback)
    result = _search(problem, name, np.random.default_rng(seed), jobs, starts, watch, dict(options or {}))
    clock.lap("search")
    found = _Findings(problem, result)
    if not np.isfinite(result.best.cost):
        found.known = "every run failed"
        found.warnings.append(f"No run reached its end: {result.best.reason}.")
    elif not result.interrupted:
        _examine(found, name, validation, jobs, clock)
    return _fit(found, name, seed, watch.count, clock.laps)


@dataclass
class _Findings:
    """What is known of a minimum so far; Ctrl-C may end the examination at any point."""

    problem: Problem
    result: Result
    known: Uncertainty | str = "the search was interrupted"
    validated: dict[str, RecordingFit] = field(default_factory=dict)
    check: Discretisation | None = None
    warnings: list[str] = field(default_factory=list)
    interrupted: bool = False


def _examine(found: _Findings, name: str, validation: tuple[Experiment, ...], jobs: int, clock: _Clock) -> None:
    """The four steps after the search."""
    problem, x = found.problem, found.result.best.point
    try:
        found.known = uncertainty(problem, x, jobs=jobs)
        clock.lap("uncertainty")
        for e in validation:
            found.validated[e.name], reason = _validate(problem, x, e, jobs)
            found.warnings += [f"No run of the validation recording reached its end: {reason}."] if reason else []
        clock.lap("validation")
        found.check = _discretisation(problem, x, found.known, jobs)
        found.warnings.append(found.check.warning)
        clock.lap("discretisation")
        if name not in ("multistart", "least-squares") and problem.cost_function.loss is not None:
            polished = _arrived(_refine(problem, x, jobs, _Watch(None, None))).best
            found.warnings.append(_stopped_short(problem, found.result.best, polished, found.known))
        clock.lap("polish")
    except KeyboardInterrupt:
        found.interrupted = True


def _arrived(result: Result) -> Result:
    """Pass an interruption on: half a refinement says nothing."""
    if result.interrupted:
        raise KeyboardInterrupt
    return result


def _fit(found: _Findings, name: str, seed: int, evaluations: int, timing: Mapping[str, float]) -> Fit:
    problem, best, known = found.problem, found.result.best, found.known
    estimates = _estimates(problem, best.point, known)
    outcome = Outcome.INTERRUPTED if found.interrupted else found.result.outcome
    fitted = {e.name: _recording(problem, best.point, known, e, "fit") for e in problem.experiments}
    return Fit(
        problem=problem, x=best.point, cost=best.cost, evaluations=evaluations, seed=seed, optimiser=name,
        outcome=f"{outcome.value}: {best.reason}" if best.reason else outcome.value,
        orders={n: estimates[n] for n in problem.orders},
        parameters={n: estimates[n] for n in problem.model.parameter_names if n in estimates},
        recordings=fitted | found.validated,
        discretisation=found.check, uncertainty=known if isinstance(known, Uncertainty) else None,
        timing=dict(timing),
        warnings=tuple(w for w in (*_warnings(problem, known), *_misfits(fitted), *found.warnings) if w),
    )  # fmt: skip


# --- search ----------------------------------------------------------------------------------------


class _Clock:
    """Seconds per stage."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, stage: str) -> None:
        now = time.perf_counter()
        self.laps[stage], self._last = now - self._last, now


@dataclass
class _Watch:
    """The log and the callback of a whole identification, over all its searches."""

    log: EvaluationLog | None
    callback: Callable[[Evaluation, int], None] | None
    count: int = 0


def _search(
    problem: Problem,
    name: str,
    rng: np.random.Generator,
    jobs: int,
    starts: int,
    watch: _Watch,
    options: dict[str, Any],
) -> Result:
    if not problem.names:
        raise InputError("Nothing is free: give at least one order or parameter a start, a lower and an upper bound.")
    if name != "multistart":
        return _minimise(problem, optimiser_from_name(name)(problem.space, rng, **options), jobs, watch)
    best = _growing(problem, problem.start, jobs, watch)
    if starts > 1 and not best.interrupted:
        space = replace(problem.space, start=best.best.point)
        many = optimiser_from_name("multistart")(space, rng, starts=starts, **options)
        best = min(best, _minimise(problem, many, jobs, watch), key=lambda result: result.best.cost)
    return best


def _growing(problem: Problem, x: FloatArray, jobs: int, watch: _Watch) -> Result:
    """Least squares on the first swing, then on ever more, up to the whole record."""
    for horizon in _horizons(problem):
        result = _refine(problem.until(horizon), x, jobs, watch, tolerance=1e-2, budget=12)
        if np.isfinite(result.best.cost):
            x = result.best.point
        if result.interrupted:
            return replace(result, best=problem.evaluate(x))
    return _refine(problem, x, jobs, watch, tolerance=1e-5)


def _refine(problem: Problem, x: FloatArray, jobs: int, watch: _Watch, **options: Any) -> Result:
    """Least squares from x."""
    space = problem.space
    space = replace(space, start=np.clip(x, space.lower, space.upper))
    return _minimise(problem, least_squares(space, np.random.default_rng(0), **options), jobs, watch)


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


def _minimise(problem: Problem, optimiser: Any, jobs: int, watch: _Watch) -> Result:
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


# --- what the minimum says -------------------------------------------------------------------------


def _recording(problem: Problem, x: FloatArray, known: Uncertainty | str, e: Experiment, use: str) -> RecordingFit:
    """One recording beside its simulation, which is NaN where the run fails."""
    simulated = problem.fitted(x, e)
    failed = isinstance(simulated, str)
    values = np.full(e.measured.shape, np.nan) if isinstance(simulated, str) else simulated
    cost = np.inf if failed else problem.cost_function.value(e.time, e.measured - values)
    estimates = _estimates(problem, x, known)
    initial = dict(zip(problem.model.states, problem.unpack(x, e)[2].tolist(), strict=True))
    return RecordingFit(
        e.name, use, e.start + e.time,
        dict(zip(problem.outputs, e.measured.T, strict=True)), dict(zip(problem.outputs, values.T, strict=True)), cost,
        {n: estimates.get(f"{n}(0) [{e.name}]", Estimate(value)) for n, value in initial.items()},
        {n: estimates[f"{n} [{e.name}]"] for n in problem.per_recording}, e.sha256,
    )  # fmt: skip


def _validate(problem: Problem, x: FloatArray, e: Experiment, jobs: int) -> tuple[RecordingFit, str]:
    """Find a recording's own unknowns, all that is shared fixed at x; in words why, where every run failed."""
    alone = problem.with_shared(x, (e,))
    quiet = _Watch(None, None)
    if not alone.names:
        best = alone.evaluate(alone.start)
    elif problem.cost_function.loss is None:
        best = _arrived(_minimise(alone, nelder_mead(alone.space, None), jobs, quiet)).best
    else:
        best = _arrived(_growing(alone, alone.start, jobs, quiet)).best
    known = uncertainty(alone, best.point, jobs=jobs)
    return _recording(alone, best.point, known, e, "validate"), best.reason


COARSE = 0.05
"""A cost that changes by more than this part at half the step says that the step is too coarse."""

SHIFT = 1e-4
"""Orders that move by less than this do not matter, however narrow their intervals."""


def _discretisation(problem: Problem, x: FloatArray, known: Uncertainty | str, jobs: int) -> Discretisation:
    half = replace(problem, substeps=2 * problem.substeps)
    second = replace(half, method="pi2")
    after = second.evaluate(x)
    costs = (problem.cost(x), half.cost(x), after.cost)
    if after.reason:
        return Discretisation(*costs, {}, {}, f"With pi2 at half the step the best run fails: {after.reason}.")
    if problem.cost_function.loss is None:  # least squares cannot refine it
        return Discretisation(*costs, {}, {})
    refined = _arrived(_refine(second, x, jobs, _Watch(None, None), tolerance=1e-6, budget=20)).best.point
    at = {problem.unknowns[i].target: i for i in problem.order_indices}
    shift = {n: float(refined[i] - x[i]) for n, i in at.items()}
    width = {n: max(SHIFT, _half_width(known, x, i)) for n, i in at.items()}
    warning = " ".join(
        f"{n} moves by {shift[n]:+.4f} when the equations are solved with pi2 at half the step: more than its "
        f"interval of ±{width[n]:.4f}, so it is in part an artefact of the step of {problem.method}."
        for n in at if abs(shift[n]) > width[n]
    )  # fmt: skip
    if problem.method == "pi2" and abs(costs[1] - costs[0]) > COARSE * costs[0]:
        warning = (
            f"The step is too coarse: at half of it the same values cost {costs[1]:.6g} instead of {costs[0]:.6g}. "
            f"Steep dry friction does this; type substeps = {2 * problem.substeps} in [fit]. {warning}"
        ).strip()
    return Discretisation(*costs, {n: float(refined[i]) for n, i in at.items()}, shift, warning)


def _stopped_short(problem: Problem, best: Evaluation, polished: Evaluation, known: Uncertainty | str) -> str:
    """Say so where polishing lowers the cost by a part in a thousand, or moves an order by half its interval."""
    at, before, after = problem.order_indices, best.point, polished.point
    moved = [abs(after[i] - before[i]) > max(1e-3, 0.5 * _half_width(known, before, i)) for i in at]
    if polished.cost > 0.999 * best.cost and not any(moved):
        return ""
    changes = ", ".join(f"{problem.unknowns[i].target} {before[i]:.4f} -> {after[i]:.4f}" for i in at)
    return (
        f"The search stopped short of its own minimum: least squares from its best point goes on to a cost of "
        f"{polished.cost:.6g} from {best.cost:.6g}{f' ({changes})' if changes else ''}."
    )


def _half_width(known: Uncertainty | str, x: FloatArray, i: int) -> float:
    interval = None if isinstance(known, str) else known.interval(x, i)
    return 0.0 if interval is None else (interval[1] - interval[0]) / 2


def _estimates(problem: Problem, x: FloatArray, known: Uncertainty | str) -> dict[str, Estimate]:
    """Every order and parameter by name, and every unknown by its own."""
    fixed = {n: Estimate(float(v)) for n, v in problem.orders.items() if not isinstance(v, Free)}
    for p in problem.model.parameters:
        given = problem.parameters.get(p.name, p.value)
        if not isinstance(given, Free):
            fixed[p.name] = Estimate(float(given), p.unit)
    return fixed | {u.name: _estimate(u, x, i, known) for i, u in enumerate(problem.unknowns)}


def _estimate(u: Unknown, x: FloatArray, i: int, known: Uncertainty | str) -> Estimate:
    value = float(x[i])
    if isinstance(known, str):
        return Estimate(value, u.unit, True, identifiable="unknown")
    interval, se = known.interval(x, i), float(known.standard_error[i])
    return Estimate(
        value, u.unit, True, se if np.isfinite(se) else None, interval, bool(known.at_bound[i]),
        _verdict(u, value, known, i, interval),
    )  # fmt: skip


def _verdict(u: Unknown, value: float, known: Uncertainty, i: int, interval: tuple[float, float] | None) -> str:
    """Say in words what the data know of an unknown."""
    if known.at_bound[i]:
        return "at its bound"
    for names in known.confounded:
        if u.name in names:
            return (
                f"only together with {', '.join(n for n in names if n != u.name)}" if len(names) > 1 else "not at all"
            )
    if interval is None:
        return "unknown"
    half = (interval[1] - interval[0]) / 2
    # an order matters by its distance from 1, a constant by its size; an initial state by neither
    wide = half > 0.1 if u.kind == "order" else u.kind == "parameter" and half > abs(value)
    return "its interval is too wide to use" if wide else "identifiable"


def _warnings(problem: Problem, known: Uncertainty | str) -> Iterator[str]:
    if problem.method == "gl-paper":
        yield (
            "gl-paper sums raw x (21)-(24), which is right only for a start at zero, and at order 1 it is forward "
            'Euler: its own growth biases the orders. Use method = "pi2" for a result.'
        )
    if "theta" in problem.model.outputs and problem.outputs == ("alpha",) and "lambda" in problem.names:
        yield "Only alpha is scored, and lambda can hardly be seen in it: score theta too."
    if isinstance(known, str):
        yield f"There are no intervals: {known}."
    else:
        for names in known.confounded:
            if len(names) == 1:
                yield f"The data do not see {names[0]} in this model: fix it, or free what it works through."
            else:
                yield f"The data cannot tell {' and '.join(names)} apart: fix one of them."
        for i in np.flatnonzero(known.at_bound):
            yield f"{problem.names[i]} lies at its bound: widen the bound, or the model lacks something."


POOR = 20.0
"""A fit of less than this [%] is called poor."""


def _misfits(recordings: Mapping[str, RecordingFit]) -> Iterator[str]:
    for r in recordings.values():
        for output, percent in r.fit_percent.items():
            if percent < POOR:
                worse = "no better than a constant" if percent <= 0 else "hardly better than a constant"
                yield f"{r.name}: the model is {worse} for {output}, fit {percent:.1f} %; no value of it means much."


def _fit_percent(measured: FloatArray, fitted: FloatArray) -> float:
    spread = float(np.linalg.norm(measured - measured.mean())) if np.ptp(measured) > 0 else 0.0  # else rounding
    error = float(np.linalg.norm(measured - fitted))
    return 100.0 * (1.0 - error / spread) if spread > 0 else (100.0 if error == 0 else -np.inf)


# --- as JSON ---------------------------------------------------------------------------------------


def _number(value: float | None) -> float | None:
    """JSON knows neither NaN nor infinity."""
    return float(value) if value is not None and np.isfinite(value) else None


def _estimate_json(e: Estimate) -> dict[str, Any]:
    return {
        "value": _number(e.value),
        "unit": e.unit,
        "standard_error": _number(e.standard_error),
        "interval95": None if e.interval95 is None else list(e.interval95),
        "free": e.free,
        "at_bound": e.at_bound,
        "identifiable": e.identifiable,
    }


def _recording_json(r: RecordingFit) -> dict[str, Any]:
    return {
        "use": r.use,
        "samples": len(r.time),
        "from": float(r.time[0]),
        "to": float(r.time[-1]),
        "cost": _number(r.cost),
        "rmse": {n: _number(v) for n, v in r.rmse.items()},
        "fit_percent": {n: _number(v) for n, v in r.fit_percent.items()},
        "initial_state": {n: _estimate_json(e) for n, e in r.initial.items()},
        "parameters": {n: _estimate_json(e) for n, e in r.parameters.items()},
        "data_sha256": r.sha256,
    }


def _discretisation_json(d: Discretisation) -> dict[str, Any]:
    return {
        "cost": _number(d.cost),
        "cost_half_step": _number(d.cost_half_step),
        "cost_second_order": _number(d.cost_second_order),
        "orders": dict(d.orders),
        "shift": dict(d.shift),
        "warning": d.warning,
    }
