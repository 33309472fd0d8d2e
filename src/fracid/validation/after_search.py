"""Checks after the search: is the result an artefact of memory, window, start or search?

Each compares the shift that a fault could cause with the interval of the parameter that it would move:

* a memory looser than it could be: the simulation with a tighter one, the difference projected on the parameters;
* few swings beside an order that is not known well;
* a start that is taken from noisy samples: its noise projected on the parameters;
* a search that stopped short: a Newton step on the parabola of the cost lowers it further;
* misread sensors (:mod:`fracid.validation.sensor_faults`), and inputs that do something else between samples;
* a residual that is large beside noise and motion: the structure may be inadequate.

:func:`after` returns the findings; :func:`failed` explains a run that does not reach its end.  The step has a check of
its own (:mod:`fracid.validation.discretisation`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from fracid.arrays import FloatArray, joined
from fracid.errors import Failure
from fracid.estimation.covariance import LEAST_SHIFT, Known, Uncertainty, half_width
from fracid.estimation.curvature import LOOSER, curvature, newton_step, start_shift
from fracid.estimation.derivatives import by_blocks
from fracid.estimation.horizons import Watch, lowest_from
from fracid.estimation.long_records import corrected, is_coarse, own_substeps
from fracid.estimation.tangent import Tangent
from fracid.findings import Finding, Note, Words
from fracid.optimise import Evaluation
from fracid.problem import Experiment, Problem
from fracid.problem.checks import typed_starts
from fracid.quantiles import NORMAL_95
from fracid.recording.guess import jumps
from fracid.selection.bic import STRONG
from fracid.selection.integer_alternatives import ROUGH, other_inputs
from fracid.selection.integer_rival import Rival, gain_over
from fracid.selection.residual_noise import leftovers
from fracid.selection.step import QUIET
from fracid.signals.resolution import noise_level
from fracid.signals.swing import swing_count, swing_period, swing_start
from fracid.solver.memory import compressed
from fracid.solver.right_hand_side import compile_rhs
from fracid.solver.solve import time_scale
from fracid.solver.stiffness import fault_of, step_gain
from fracid.units import plain, with_unit
from fracid.validation.sensor_faults import misread, misreadings

SAYS = Words("validation/after_search.toml")

FEW_SWINGS = 10
"""Beside an order that is not known, fewer are called too few."""

WANTED = 0.1
"""Half an interval of an order that is of use."""

LEFT_OVER = 0.1
"""Part of the motion that a model may leave unexplained."""

NO_BETTER = 0.8
"""From which on a model is hardly better than a constant, which a fit says in other words."""

BETWEEN = 4.0
"""What is left over is large where its square is so many times noise × motion; good fits of real rigs reach 1.4."""

STILL_MOVING = 0.2
"""A record whose last quarter has this part of the whole's motion does not end at rest."""

CERTIFIED = 1e-9
"""A memory whose weights are that accurate moves no angle by a thousandth of an encoder's step (docs/solver.md)."""

TIGHTER = 1e-2
"""Of that: the memory beside which a looser one is seen."""

SHORT = 0.5
"""CI half-widths that a minimum may be away: from there on an interval of 95 % holds it in 84 %."""

FALLS = 1.0
"""Of the cost, by which a step may lower it [%]: far from a minimum intervals are wide, and hide how far."""

NEXT_TO_NOTHING = 1e-4
"""Of its size, by which an unknown may be off, however narrow its interval."""


def after(
    problem: Problem, x: FloatArray, uncertainty: Known, *, jobs: int = 1, near: Tangent | None = None
) -> tuple[Finding, ...]:
    """Look at a minimum.

    Parameters
    ----------
    problem : Problem
    x : array, shape (n_unknowns,)
        Its minimum.
    uncertainty : Uncertainty or Failure
        What :func:`fracid.estimation.covariance.uncertainty` gave there.
    jobs : int
        Threads.
    near : Tangent, optional
        Errors and derivatives there; found if left out.

    Returns
    -------
    tuple of Finding

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment, Free, Problem
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 1.0, "mu": 0.99}, initial={"alpha": 0.3}, step=4e-3, end=4.0)
    >>> swing = Experiment("twin", 4e-3, run.states[:, [0, 2]], np.zeros((1, 1)))
    >>> problem = Problem(rig, (swing,), {"lambda": 1.0, "mu": Free(1.0, 0.5, 1.2)}, initial_state="measured")
    >>> from fracid.errors import Failure, FailureReason
    >>> none = Failure(FailureReason.INTERRUPTED, "the search was interrupted")
    >>> [f.code for f in after(problem, problem.start, none)]         # order 1 does not explain it
    ['cannot-explain', 'cannot-explain']
    """
    findings = [*_loose_memory(problem, x, uncertainty, jobs)]
    if not isinstance(uncertainty, Failure):
        findings += _short_window(problem, uncertainty)
        findings += _stopped_short(problem, x, uncertainty, jobs)
        findings += misread(problem, misreadings(problem, x, uncertainty, jobs=jobs, near=near))
    return (*findings, *(f for e, _ in problem.recordings.values() for f in _cannot_explain(problem, x, e)))


def failed(problem: Problem, x: FloatArray) -> Iterator[Finding]:
    """Say why the run of a recording does not reach its end at x: a blow-up with its time, or a step too long.

    Parameters
    ----------
    problem : Problem
    x : array, shape (n_unknowns,)

    Yields
    ------
    Finding
        Of the recordings whose run fails.
    """
    for e in problem.experiments:
        run = problem.simulate(x, e)
        if not run.completed:
            orders, values, *_ = problem.unpack(x, e)
            gain = step_gain(run.step, orders, time_scale(problem.model, values))
            u = e.inputs if problem.substeps == 1 else e.inputs[:1]
            fault = fault_of(run, compile_rhs(problem.model.rhs), gain, u, parameters=values)
            if fault is not None:
                yield replace(fault, where=e.name)


# --- the minimum -----------------------------------------------------------------------------------------


def _loose_memory(problem: Problem, x: FloatArray, uncertainty: Known, jobs: int) -> Iterator[Finding]:
    """Simulate with a better memory, and project the difference on the unknowns."""
    tolerance = problem.memory.tolerance
    if (tolerance is not None and tolerance <= CERTIFIED) or not problem.names:
        return
    tight = replace(problem, memory=compressed(TIGHTER * CERTIFIED), memo=None)
    now, then = problem.errors(x), tight.errors(x)
    if isinstance(now, Failure) or isinstance(then, Failure):
        return
    change = joined(a - b for a, b in zip(now, then, strict=True))
    if float(np.linalg.norm(change)) < LEAST_SHIFT * float(np.linalg.norm(joined(now))):
        return  # moves no unknown by more than a fraction of its standard error
    J = by_blocks(problem, x, np.arange(len(x)), jobs=jobs)
    if isinstance(J, Failure):
        return
    shift = J.solved(change)  # by how much the unknowns would have to move for that
    for i, u in enumerate(problem.unknowns):
        se = math.nan if isinstance(uncertainty, Failure) else float(uncertainty.standard_error[i])
        half = NORMAL_95 * se
        if u.kind == "order":
            half = max(LEAST_SHIFT, half if math.isfinite(half) else 0.0)
        if math.isfinite(half) and abs(shift[i]) > half:
            yield SAYS.finding("loose-memory", u.name, abs(float(shift[i])) / half, 1.0, shift=-shift[i],
                               times=abs(shift[i]) / half, problem=problem)  # fmt: skip


def _short_window(problem: Problem, uncertainty: Uncertainty) -> Iterator[Finding]:
    """Orders that are not known well, where the records have few swings."""
    longest = max((e for e, _ in problem.recordings.values()), key=lambda e: swing_count(e.most_moved))
    y = longest.most_moved
    swings, period, begins = swing_count(y), swing_period(y), swing_start(y)
    late = float(np.std(y[-(len(y) // 4 + 1) :]))
    moving = late > max(STILL_MOVING * float(np.std(y[begins:])), 3 * noise_level(y))
    if swings >= FEW_SWINGS or not moving:  # what came to rest tells no more
        return
    seconds = (len(y) - begins) * longest.step
    for i in problem.order_indices:
        half, reach = NORMAL_95 * float(uncertainty.standard_error[i]), problem.unknowns[i].range
        if not 1.2 * WANTED < half <= reach.upper - reach.lower:  # known well enough or nearly, or not seen at all
            continue
        enough = max(seconds * (half / WANTED) ** (2 / 3), min(FEW_SWINGS * period, 2 * len(y)) * longest.step)
        yield SAYS.finding("short-window", problem.names[i], swings, FEW_SWINGS, half=half, seconds=seconds,
                           enough=enough, WANTED=WANTED)  # fmt: skip


def noisy_start(problem: Problem, x: FloatArray, known: Known, *, included: bool = True) -> tuple[Finding, ...]:
    """Say so where the noise of the samples that the start is taken from moves an unknown by more than its interval.

    Parameters
    ----------
    problem : Problem
    x : array, shape (n_unknowns,)
        Its minimum, or next to it.
    known : Uncertainty or Failure
        What :func:`with_start` gave there.
    included : bool
        Whether the intervals that are told are those.

    Returns
    -------
    tuple of Finding
        One for the unknown that is moved most, orders first; or none.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment, Free, Problem
    >>> from fracid.estimation.covariance import uncertainty
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=4e-3, end=6.0)
    >>> y = run.states[:, [0, 2]] + 1e-3 * np.random.default_rng(1).standard_normal((1501, 2))
    >>> swing = Experiment("twin", 4e-3, y, np.zeros((1, 1)))
    >>> problem = Problem(rig, (swing,), {"lambda": 0.9, "mu": Free(0.95, 0.5, 1.2)}, initial_state="held")
    >>> known = with_start(problem, problem.start, uncertainty(problem, problem.start))
    >>> [found] = noisy_start(problem, problem.start, known)
    >>> found.code, found.where, found.number > 1
    ('noisy-start', 'mu', True)
    """
    if isinstance(known, Failure):
        return ()
    alone = np.sqrt(np.maximum(known.standard_error**2 - known.start**2, 0.0))
    with np.errstate(invalid="ignore", divide="ignore"):
        times = np.nan_to_num(known.start / alone, nan=0.0, posinf=0.0)
    beyond = np.flatnonzero(times > 1)
    if not len(beyond):
        return ()
    first = [i for i in beyond if problem.unknowns[i].kind == "order"] or [*beyond]
    i = max(first, key=lambda k: times[k])
    sd = max(float(np.max(s)) for s in _noise_at_the_start(problem, x).values())
    interval = "without it; the interval includes it" if included else "which ignores it"
    unit = problem.experiments[0].units.get(problem.outputs[0], "rad")
    return (SAYS.finding("noisy-start", problem.names[i], float(times[i]), 1.0, noise=with_unit(sd, unit, '.2g'),
                         shift=NORMAL_95 * known.start[i], included=interval,
                         looser=LOOSER[problem.initial_state]),)  # fmt: skip


def with_start(problem: Problem, x: FloatArray, known: Known, *, jobs: int = 1) -> Known:
    """The intervals with what the noise of the samples that the start is taken from adds to them.

    Parameters
    ----------
    problem : Problem
    x : array, shape (n_unknowns,)
        Its minimum.
    known : Uncertainty or Failure
        There, of the residuals alone.
    jobs : int
        Threads.
    """
    if isinstance(known, Failure) or problem.initial_state not in LOOSER:
        return known
    parabola = curvature(problem, x, np.flatnonzero(~known.at_bound), jobs=jobs)
    noise = _noise_at_the_start(problem, x)
    if isinstance(parabola, Failure) or not noise:
        return known
    shift = start_shift(problem, x, parabola, noise, jobs=jobs)
    return known if shift is None else replace(known.wider(problem.space, x, shift), start=shift)


def between_samples(
    problem: Problem, x: FloatArray, known: Known, *, jobs: int = 1
) -> tuple[Known, tuple[Finding, ...], tuple[Note, ...]]:
    """The intervals with what inputs that jump may do between their samples, and findings and notes of that.

    Parameters
    ----------
    problem : Problem
    x : array, shape (n_unknowns,)
        Its minimum.
    known : Uncertainty or Failure
        There, of inputs as they are taken.
    jobs : int
        Threads.
    """
    best, found, notes = problem.evaluate(x), list[Finding](), list[Note]()
    for name, between, other in other_inputs(problem):
        if isinstance(known, Failure) or best.residuals is None:
            break
        unsure = _jumps(problem, name)
        other, there = _minimum_of(other, x, jobs, **({} if unsure else ROUGH))
        gain = 0.0 if there.residuals is None else gain_over(Rival(other, there, "", {}), problem, best)[1]
        moves = np.abs(there.point - x) / np.array([half_width(known, x, i) or math.inf for i in range(len(x))])
        most = int(np.argmax(moves))
        if gain < -STRONG and all(left.noise for left in leftovers(other, there.point).values()):
            found.append(SAYS.finding("between", name, -gain, STRONG, between=between, best=best, there=there))
        elif there.residuals is not None and abs(gain) <= STRONG and moves[most] > QUIET and unsure:
            of = problem.unknowns[most]
            value = f"{there.point[most]:.4g} {of.unit}".rstrip()
            notes.append(Note(SAYS("either", name=name, between=between, of=of, value=value), "either", name))
        else:
            continue
        known = known.wider(problem.space, x, np.where(moves > QUIET, there.point - x, 0.0))
    return known, tuple(found), tuple(notes)


def _minimum_of(other: Problem, x: FloatArray, jobs: int, **options: Any) -> tuple[Problem, Evaluation]:
    """Of another problem of the same unknowns, with the residuals of its own steps; none where a run fails."""
    there = lowest_from(other, x, Watch(jobs), **options)
    exact = corrected(other, there.point, own_substeps(other), jobs) if is_coarse(other) else (other, there)
    return (other, replace(there, residuals=None)) if isinstance(exact, Failure) else exact


def _jumps(problem: Problem, name: str) -> bool:
    i = problem.model.inputs.index(name)
    return any(jumps(e.sampled.time, e.sampled.inputs[:, i]) for e in problem.experiments if len(e.inputs) > 1)


def _stopped_short(problem: Problem, x: FloatArray, uncertainty: Uncertainty, jobs: int) -> Iterator[Finding]:
    """Whether the cost falls on along a Newton step: further than half of half an interval, or by a hundredth."""
    parabola = curvature(problem, x, np.flatnonzero(~uncertainty.at_bound), jobs=jobs)
    if isinstance(parabola, Failure):
        return
    step, cost = newton_step(problem, x, parabola)
    least, half = NEXT_TO_NOTHING * problem.space.sizes(x), NORMAL_95 * uncertainty.standard_error
    intervals = np.abs(step) / np.where(np.isfinite(half), np.maximum(half, least), math.inf)
    here = problem.cost(x)
    lower, beyond = 100 * (1 - cost / here) if here > 0 else 0.0, bool(np.any(intervals > SHORT))
    if beyond or (lower > FALLS and np.any(np.abs(step) > least)):
        i = int(np.argmax(intervals if beyond else np.abs(step) / least))
        name, number, limit = ("stopped-short", intervals[i], SHORT) if beyond else ("by-cost", lower, FALLS)
        yield SAYS.finding(name, problem.names[i], float(number), limit, step=step[i], times=intervals[i], cost=cost,
                           here=here)  # fmt: skip


def _noise_at_the_start(problem: Problem, x: FloatArray) -> dict[str, FloatArray]:
    """Recording → noise of its samples, no more than what the fit leaves over [rad]; empty where a run fails."""
    errors = problem.errors(x)
    if isinstance(errors, Failure):
        return {}
    return {e.name: np.array([min(noise_level(y[own]), float(np.sqrt(np.mean(r[own] ** 2))))
                              for y, r, own in zip(e.measured.T, d.T, e.scored.T, strict=True)])
            for e, d in zip(problem.experiments, errors, strict=True)}  # fmt: skip


def _cannot_explain(problem: Problem, x: FloatArray, e: Experiment) -> Iterator[Finding]:
    fitted = problem.followed(x, e.name)
    if isinstance(fitted, Failure):
        return
    there = np.isfinite(fitted) & e.scored
    for k, o in enumerate(problem.outputs):
        y, z = e.measured[there[:, k], k], fitted[there[:, k], k]
        rms, spread, noise = float(np.sqrt(np.mean((y - z) ** 2))), float(np.std(y)), noise_level(y)
        part, times = rms / max(spread, 1e-300), rms / noise
        if LEFT_OVER < part < NO_BETTER and part * times > BETWEEN:
            yield SAYS.finding("cannot-explain", f"{e.name}: {o}", times, BETWEEN / part,
                               rms=with_unit(rms, e.units.get(o, 'rad')), percent=100 * part,
                               plain_times=plain(times), hidden=hidden_starts(problem, x, e.name))  # fmt: skip


def hidden_starts(problem: Problem, x: FloatArray, recording: str) -> str:
    """What to type where states begin at 0 because no output shows them; nothing where there are none."""
    e, _ = problem.recordings[recording]
    told = problem.in_windows or problem.initial_state != "estimate" or e.past is not None
    if told or not (hidden := problem.unstated(x, e)):
        return ""
    states = problem.model.states
    moved = np.nan_to_num(np.ptp(problem.simulate(x, e).states, axis=0))
    around = {states[i]: (0.0, 2.0 * float(moved[i]) if i < len(moved) and moved[i] > 0 else 1.0) for i in hidden}
    return f" {SAYS('hidden-starts', states=' and '.join(around), typed=typed_starts(around))}"
