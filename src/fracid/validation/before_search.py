r"""What may be wrong with a problem, said before the search; and with its minimum, said after it.

A wrong zero or sign does not make a search fail: it makes it find something, slowly, that means nothing.  So before it,
in a fraction of a second, :func:`before` asks

==================  ==============================================================================================
code                asked how; the number
==================  ==============================================================================================
(of the samples)    unit, range and sampling of each signal (:mod:`fracid.recording.faults`)
``wrong-zero``      is the posture in which the recording comes to rest one in which the model stays?  At rest the
                    equations are linear, :math:`D^q δ = J δ`; a positive eigenvalue of J says that it falls over.
                    How far from hanging [degrees], limit 90; also an offset of more than 11°
``stiff``           \|J\|h along the measured motion, for explicit schemes (:mod:`fracid.solver.stiffness`)
``coarse-steps``    steps for each period of the fastest oscillation, there
``wrong-sign``      two swings of each recording, fitted as the project says and with the sign of one angle turned
                    round: the part of the motion that is left over.  Said where it was above 35 %, and falls to less
                    than half; of many recordings the eight that move most are asked
==================  ==============================================================================================

and of the minimum :func:`after` asks

==================  ==============================================================================================
``loose-memory``    how far the unknowns would go with a memory a thousand times as accurate, in half intervals:
                    :math:`δx = (J^T J)^{-1} J^T δy`, δy the change of the simulated outputs
``short-window``    an order that is seen, but not to 0.1, in a record that ends in motion after fewer than ten swings:
                    how many, and how long it takes; an interval shrinks like :math:`T^{-3/2}`
``noisy-start``     how far the noise of the first samples moves an unknown, where the start is taken from them
                    (``held``, ``measured``), in half intervals (:func:`fracid.estimation.curvature.start_shift`)
``late`` and so on  a signal that is late, scaled, off its zero, that drifts or has play: its size by one
                    Gauss-Newton step, and how far that would move an order, in half intervals
``stopped-short``   how far a Newton step from the search's end goes to lower cost, in half intervals
                    (:func:`fracid.estimation.curvature.newton_step`); said above a half, or where that is lower by 1 %
``cannot-explain``  rms of what is left over, in units of the noise that is measured on the samples (third differences,
                    and no less than the encoder's q/√12): where more than a tenth of the motion is left, and that is
                    twice the geometric mean of noise and motion
==================  ==============================================================================================

Nothing is repaired in silence: a finding says what to type.  Another fault explains a recording as well as the one
that is named, now and then, so each says "may".
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fracid.arrays import FloatArray
from fracid.errors import Failure
from fracid.findings import Finding
from fracid.optimise import least_squares, minimise
from fracid.problem import Experiment, Free, Problem
from fracid.problem.costs import COSTS
from fracid.recording import Report
from fracid.recording.faults import signal_faults
from fracid.recording.measures import measure_signal
from fracid.signals.swing import swing_count, swing_period, swing_start, tail
from fracid.solver.methods import METHODS
from fracid.solver.right_hand_side import compile_rhs
from fracid.solver.solve import time_scale
from fracid.solver.stiffness import STEPS_A_PERIOD, linearised, modes, steps_a_period, too_long

__all__ = ["before", "largest_output"]

ASKED = 9
"""Samples at which J is asked for."""

OFFSET = math.radians(11.0)
"""A pendulum that rests further from hanging does not hang, or its zero is wrong."""

DRIVEN = 0.01
"""Of the largest input: beyond it the rig is driven."""

SWINGS = 2
"""That are fitted to compare signs."""

SAMPLES = 60
"""Of each of them that are fitted."""

SIGNS = 8
"""Recordings whose signs are asked for."""

BAD = 0.35
"""Part of the motion that two fitted swings leave over, beyond which other signs are tried."""

BETTER = 0.5
"""A sign that leaves less than this part of what the given one does is named."""


def before(
    problem: Problem, reports: Mapping[str, Report] | None = None, *, validation: tuple[Experiment, ...] = (),
    jobs: int = 1,
) -> tuple[Finding, ...]:  # fmt: skip
    """Look for what makes a search find nothing that means anything.

    Parameters
    ----------
    problem : Problem
    reports : mapping, optional
        Each recording's name to what was measured of it; measured on its samples if left out.
    validation : tuple of Experiment
        Recordings that are not fitted.
    jobs : int
        Threads.

    Returns
    -------
    tuple of Finding
        Empty where nothing was found.

    Examples
    --------
    A release, its zero where the pendulum is upright, taken for hanging:

    >>> import fracid
    >>> from fracid.problem import Experiment, Free, Problem
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 1.0, "mu": 1.0}, initial={"alpha": 0.3}, step=4e-3, end=20.0)
    >>> swing = Experiment("twin", 4e-3, run.states[:, [0, 2]] + [0.0, np.pi], np.zeros((1, 1)))
    >>> found = before(Problem(rig, (swing,), {"lambda": 1.0, "mu": Free(1.0, 0.5, 1.2)}))
    >>> [(f.code, round(f.number)) for f in found]
    [('wrong-zero', 180)]
    """
    every = (*problem.experiments, *validation)
    findings = [f for e in every for f in _of_the_samples(problem, e, (reports or {}).get(e.name))]
    in_its_unit = not any(f.code in ("degrees-as-radians", "radians-as-degrees") for f in findings)
    if in_its_unit:  # else all that follows from it would be said too
        findings += [f for e in problem.experiments for f in _wrong_zero(problem, e)]
    findings += _worst(f for e in problem.experiments for f in _steps(problem, e))
    if in_its_unit and not any(f.code == "wrong-zero" for f in findings):
        findings += _wrong_sign(problem, jobs)
    return tuple(findings)


# --- the samples -------------------------------------------------------------------------------------


def _of_the_samples(problem: Problem, e: Experiment, report: Report | None) -> list[Finding]:
    if report is None:
        signals = dict(zip(problem.outputs, e.measured.T, strict=True))
        if len(e.inputs) > 1:
            signals |= dict(zip(problem.model.inputs, e.inputs.T, strict=True))
        units = {n: e.units.get(n, "rad" if n in problem.outputs else "V") for n in signals}
        findings = signal_faults(e.time, signals, [measure_signal(n, units[n], e.time, y) for n, y in signals.items()])
    else:
        findings = report.findings
    return [replace(f, where=f"{e.name}: {f.where}") for f in findings]


def largest_output(e: Experiment) -> FloatArray:
    """The output that moves most."""
    return np.asarray(e.measured[:, int(np.argmax(np.ptp(e.measured, axis=0)))])


# --- zero --------------------------------------------------------------------------------------------


def _wrong_zero(problem: Problem, e: Experiment) -> Iterator[Finding]:
    """Where the recording stays, does the model?"""
    late = e.inputs[len(e.inputs) // 2 :]
    if np.any(np.abs(late) > DRIVEN * max(float(np.max(np.abs(e.inputs), initial=0.0)), 1e-300)):
        return  # held there by its motor, perhaps
    stays = {o: _where_it_stays(y) for o, y in zip(problem.outputs, e.measured.T, strict=True)}
    posture = {o: value for o, value in stays.items() if value is not None}
    if not posture:
        return
    _, values, _ = problem.unpack(problem.start, e)
    x = np.zeros(len(problem.model.states))
    for o, value in posture.items():
        x[problem.model.outputs[o]] = value
    J = _linearised(problem, (0.0, x, np.zeros(len(problem.model.inputs))), values)
    eigenvalues = modes(J, np.ones(len(x)))
    growth = max((m.real for m in eigenvalues if abs(m.imag) <= 1e-6 * abs(m)), default=0.0)
    falls = growth * min(swing_period(largest_output(e)), len(e.measured)) * e.step > 1
    pendulum = problem.model.pendulum
    if pendulum in posture and problem.model.angles[pendulum].rest:
        yield from _off_hanging(problem, e, posture[pendulum], falls)
    elif falls:
        yield Finding("wrong-zero", e.name, growth, 0.0, "1/s",
            f"it stays where this model does not: it would leave that posture e-fold in {1 / growth:.2g} s. A zero, or "
                      "the sign of a constant, may be wrong.")  # fmt: skip


def _where_it_stays(y: FloatArray) -> float | None:
    """The rest of a signal that comes to rest, the middle of one that swings about it to the end, else None."""
    rest, _, at_rest = tail(y)
    if at_rest:
        return rest
    late = y[len(y) // 2 :]
    middle = float(np.median(late))
    return middle if swing_count(late) >= SWINGS and float(np.max(np.abs(late - middle))) < math.pi / 2 else None


def _off_hanging(problem: Problem, e: Experiment, rest: float, falls: bool) -> Iterator[Finding]:
    zero, pendulum = problem.model.zero, problem.model.pendulum
    name = problem.model.angles[pendulum].rest
    own, offset, reach = problem.parameters.get(name), problem.model.parameter(name).value, 0.0
    if isinstance(own, Free):
        offset, reach = own.start, max(own.upper - own.start, own.start - own.lower)
    off = math.remainder(rest - offset - (math.pi if zero == "upright" else 0.0), 2 * math.pi)
    stays, away = f"it stays at {math.degrees(rest):.1f}°", abs(math.degrees(off))
    if falls and abs(off) > math.pi / 2:
        other = "hanging" if zero == "upright" else "upright"
        yield Finding("wrong-zero", f"{e.name}: {pendulum}", away, 90.0, "degrees from hanging",
            f'{stays}, where this model, zero = "{zero}", has the pendulum upright, and falls over. Its zero may '
                      f"be wrong: add 3.14159 to the zero in {pendulum}'s table, or type zero = \"{other}\" in "
                      "[model].")  # fmt: skip
    elif abs(off) > OFFSET + reach:
        yield Finding("wrong-zero", f"{e.name}: {pendulum}", away, math.degrees(OFFSET + reach), "degrees from hanging",
                      f'{stays}, {away:.1f}° from where this model hangs. Its zero may be wrong: type zero = "rest" in '
                      f"{pendulum}'s table, or give {name} a wider range.")  # fmt: skip


# --- steps -------------------------------------------------------------------------------------------


def _steps(problem: Problem, e: Experiment) -> Iterator[Finding]:
    orders, values, _ = problem.unpack(problem.start, e)
    h = e.step / problem.substeps
    gain = h**orders * time_scale(problem.model, values) ** (1 - orders)
    linear = [_linearised(problem, at, values) for at in _measured_states(problem, e)]
    steps = float(np.median([steps_a_period(modes(J, gain)) for J in linear]))
    if beyond := too_long(problem.method, orders, linear, gain, len(e.measured) * problem.substeps):
        more = problem.substeps * math.ceil(beyond.parts)
        scheme, other = ("an explicit scheme", "pi2") if METHODS[problem.method].follows < math.inf else ("it", "bdf2")
        yield Finding("stiff", e.name, beyond.size, beyond.limit, "|J|h",
            f"the step is too long for {problem.method}: |J|h is {beyond.size:.3g} at the start's values, and {scheme} "
            f'follows up to about {beyond.limit:.3g}. Type method = "{other}" in [fit], or substeps = '
                      f"{more}.")  # fmt: skip
    elif steps < STEPS_A_PERIOD:
        more = problem.substeps * math.ceil(2 * STEPS_A_PERIOD / steps)
        yield Finding("coarse-steps", e.name, steps, STEPS_A_PERIOD, "steps a period",
            f"the fastest oscillation has {steps:.2g} steps a period, where {STEPS_A_PERIOD:.0f} are too few already. "
                      f"Type substeps = {more} in [fit].")  # fmt: skip


def _linearised(problem: Problem, at: tuple[float, FloatArray, FloatArray], values: FloatArray) -> NDArray[np.float64]:
    """J at a time, a state and an input."""
    t, x, u = at
    with np.errstate(all="ignore"):
        return linearised(compile_rhs(problem.model.rhs), t, x, u, values)


def _measured_states(problem: Problem, e: Experiment) -> Iterator[tuple[float, FloatArray, FloatArray]]:
    """Times, states and inputs at some samples: the rates are slopes of the samples, other states are zero."""
    w = max(1, round(0.01 / e.step))
    for k in np.linspace(w, len(e.measured) - 1 - w, ASKED, dtype=int).tolist():
        x = np.zeros(len(problem.model.states))
        for o, y in zip(problem.outputs, e.measured.T, strict=True):
            i = problem.model.outputs[o]
            x[i] = y[k]
            if i in problem.model.rates:
                x[problem.model.rates[i]] = (y[k + w] - y[k - w]) / (2 * w * e.step)
        yield float(e.time[k]), x, e.inputs[min(k, len(e.inputs) - 1)]


def _worst(findings: Iterator[Finding]) -> list[Finding]:
    """One of each code: the worst."""
    worst: dict[str, Finding] = {}
    for f in findings:
        before = worst.get(f.code)
        ratio = f.number / f.limit if f.code == "stiff" else f.limit / f.number
        if before is None or ratio > (before.number / f.limit if f.code == "stiff" else f.limit / before.number):
            worst[f.code] = f
    return list(worst.values())


# --- signs -------------------------------------------------------------------------------------------


def _wrong_sign(problem: Problem, jobs: int) -> Iterator[Finding]:
    """Each recording by itself, for each has signs of its own; one finding for those with the same angle turned."""
    groups: dict[tuple[str, ...], list[tuple[str, float, float]]] = {}
    for e in _most_moved(problem):
        either, residual, best = _turned_round(replace(problem, experiments=(e,)), jobs)
        if either:
            groups.setdefault(either, []).append((e.name, residual, best))
    for either, recordings in groups.items():
        _, residual, best = max(recordings, key=lambda r: r[1] / r[2])
        names = ", ".join(name for name, _, _ in recordings)
        yield Finding("wrong-sign", f"{names}: {either[0]}", 100 * residual, 100 * BAD, "% of the motion left over",
            f"two swings, fitted, leave {100 * residual:.0f} % of the motion over, and {100 * best:.0f} % with the "
                      f"sign "
            f"of {' or '.join(either)} turned round: it may be wrong. Type sign = -1 in its table.")  # fmt: skip


def _most_moved(problem: Problem) -> list[Experiment]:
    """Not more than so many recordings, in their order: those in which the angle that moves less moves most."""

    def least(e: Experiment) -> float:
        return float(np.min(np.ptp(e.measured, axis=0)))

    selection = sorted(problem.experiments, key=least, reverse=True)[:SIGNS]
    return [e for e in problem.experiments if any(e is other for other in selection)]


def _turned_round(problem: Problem, jobs: int) -> tuple[tuple[str, ...], float, float]:
    """Angles of which either, turned round, fits two swings of the one recording; what is left as given, and so.

    None where they fit as they are, or turned round no better.
    """
    early = _two_swings(problem)
    angles = [] if early is None else _signed(early)
    if early is None or not angles or (residual := _left_over(early, jobs)) < BAD:
        return (), 0.0, 0.0
    reversals = {o: _left_over(_turned(early, o), jobs) for o in angles}
    best = min(reversals.values())
    if not best < min(BAD, BETTER * residual):
        return (), residual, best
    same = len(angles) == 2 and not np.any(early.experiments[0].inputs)  # undriven, one turned is the other turned
    return tuple(o for o in angles if same or reversals[o] < 1.5 * best), residual, best


def _two_swings(problem: Problem) -> Problem | None:
    """Of the recording, every so many samples, by its rmse; None if nothing swings."""
    e = problem.experiments[0]
    moving = [y for y in e.measured.T if np.ptp(y) > 0]
    period, begins = min(((swing_period(y), swing_start(y)) for y in moving), default=(math.inf, 0))
    if not math.isfinite(period) or e.past is not None:
        return None
    every = max(1, round(period / SAMPLES))
    n = min(len(e.measured), begins + round((SWINGS + 0.25) * period))
    inputs = e.inputs if len(e.inputs) == 1 else np.ascontiguousarray(e.inputs[:n:every])
    short = replace(e, step=every * e.step, measured=np.ascontiguousarray(e.measured[:n:every]), inputs=inputs)
    return replace(problem, experiments=(short,), cost_function=COSTS["rmse"], weights="equal", memo=None,
                   substeps=max(1, round(SAMPLES * every / period)), method="pi2")  # fmt: skip


def _signed(problem: Problem) -> list[str]:
    """The angles whose sign matters: turned round all together, the equations are the same."""
    e = problem.experiments[0]
    travel = np.ptp(e.measured, axis=0)
    moves = [o for o, far in zip(problem.outputs, travel, strict=True) if far > 1e-2 * travel.max()]
    return moves if len(moves) > 1 or np.any(e.inputs) else []


def _turned(problem: Problem, output: str) -> Problem:
    """The same with the sign of one output, and of what is known of its start, turned round."""
    e, i = problem.experiments[0], problem.model.outputs[output]
    own = {problem.model.states[j] for j in (i, problem.model.rates.get(i, i))}
    sign = np.where(np.array(problem.outputs) == output, -1.0, 1.0)
    initial = {n: -v if n in own else v for n, v in e.initial.items()}
    return replace(problem, experiments=(replace(e, measured=e.measured * sign, initial=initial),))


def _left_over(problem: Problem, jobs: int) -> float:
    """The part of the motion that a short search leaves over; the start's where that is little already."""
    x = problem.start
    if problem.names and not _part(problem, x) < BAD:
        result = minimise(problem.evaluate, least_squares(problem.space, None, tolerance=1e-2, budget=6), jobs=jobs)
        if result.interrupted:
            raise KeyboardInterrupt
        x = result.best.point
    return _part(problem, x)


def _part(problem: Problem, x: FloatArray) -> float:
    """The part of the motion that x leaves over, rms over the outputs that move; infinite if its run fails."""
    e = problem.experiments[0]
    fitted = problem.fitted(x, e)
    if isinstance(fitted, Failure):
        return math.inf
    spread = np.std(e.measured, axis=0)
    moves = spread > 1e-2 * spread.max()
    parts = np.sqrt(np.mean((e.measured - fitted) ** 2, axis=0))[moves] / spread[moves]
    return float(np.sqrt(np.mean(parts**2)))
