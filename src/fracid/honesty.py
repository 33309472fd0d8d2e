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
``stiff``           \|J\|h along the measured motion, for explicit schemes (:mod:`fracid.stiffness`)
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
                    (``held``, ``measured``), in half intervals (:func:`fracid.projection.start_shift`)
``late`` and so on  a signal that is late, scaled, off its zero, that drifts or has play: its size by one
                    Gauss-Newton step, and how far that would move an order, in half intervals (:mod:`fracid.misread`)
``stopped-short``   how far a Newton step from the search's end goes to lower cost, in half intervals
                    (:func:`fracid.projection.newton_step`); said above a half, or where that is lower by 1 %
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

from fracid.costs import COSTS
from fracid.findings import Finding
from fracid.memory import compressed
from fracid.misread import misread
from fracid.optimise import least_squares, minimise
from fracid.problem import Experiment, Free, Problem
from fracid.projection import LOOSER, Curvature, curvature, newton_step, start_shift
from fracid.recording import Report
from fracid.recording.faults import signal_faults
from fracid.recording.report import measure_signal, resolution, tail
from fracid.right_hand_side import compile_rhs
from fracid.simulate import time_scale
from fracid.stiffness import FOLLOWS, STEPS_A_PERIOD, fault_of, linearised, modes, steps_a_period
from fracid.uncertainty import NORMAL_95, Uncertainty, jacobian
from fracid.units import with_unit

__all__ = ["after", "before", "failed", "noisy_start"]

FloatArray = NDArray[np.float64]

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
"""Half intervals that a minimum may be away: from there on an interval of 95 % holds it in 84 %."""

FALLS = 1.0
"""Of the cost, by which a step may lower it [%]: far from a minimum intervals are wide, and hide how far."""

NEXT_TO_NOTHING = 1e-4
"""Of its size, by which an unknown may be off, however narrow its interval."""

SHIFT = 1e-4
"""Orders that move by less do not matter, however narrow their intervals."""


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
    found = [f for e in every for f in _of_the_samples(problem, e, (reports or {}).get(e.name))]
    in_its_unit = not any(f.code in ("degrees-as-radians", "radians-as-degrees") for f in found)
    if in_its_unit:  # else all that follows from it would be said too
        found += [f for e in problem.experiments for f in _wrong_zero(problem, e)]
    found += _worst(f for e in problem.experiments for f in _steps(problem, e))
    if in_its_unit and not any(f.code == "wrong-zero" for f in found):
        found += _wrong_sign(problem, jobs)
    return tuple(found)


def after(problem: Problem, x: FloatArray, known: Uncertainty | str, *, jobs: int = 1) -> tuple[Finding, ...]:
    """Look at a minimum.

    Parameters
    ----------
    problem : Problem
    x : array, shape (n_unknowns,)
        Its minimum.
    known : Uncertainty or str
        What :func:`fracid.uncertainty.uncertainty` gave there.
    jobs : int
        Threads.

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
    >>> [f.code for f in after(problem, problem.start, "not asked")]         # order 1 does not explain it
    ['cannot-explain', 'cannot-explain']
    """
    found = [*_loose_memory(problem, x, known, jobs), *_short_window(problem, known)]
    parabola = _parabola(problem, x, known, jobs)
    found += noisy_start(problem, x, known, jobs=jobs, parabola=parabola)
    found += _stopped_short(problem, x, known, parabola)
    found += misread(problem, x, known, jobs=jobs)
    return (*found, *(f for e in problem.experiments for f in _cannot_explain(problem, x, e)))


def failed(problem: Problem, x: FloatArray) -> tuple[Finding, ...]:
    """Say why the run of a recording does not reach its end at x: a blow-up with its time, or a step too long.

    Parameters
    ----------
    problem : Problem
    x : array, shape (n_unknowns,)

    Returns
    -------
    tuple of Finding
        Of the recordings whose run fails.
    """
    found = []
    for e in problem.experiments:
        run = problem.simulate(x, e)
        if not run.completed:
            orders, values, _ = problem.unpack(x, e)
            gain = run.step**orders * time_scale(problem.model, values) ** (1 - orders)
            u = e.inputs if problem.substeps == 1 else e.inputs[:1]
            fault = fault_of(run, compile_rhs(problem.model.rhs), gain, u, values)
            found += [] if fault is None else [replace(fault, where=e.name)]
    return tuple(found)


# --- the samples -------------------------------------------------------------------------------------


def _of_the_samples(problem: Problem, e: Experiment, report: Report | None) -> list[Finding]:
    if report is None:
        signals = dict(zip(problem.outputs, e.measured.T, strict=True))
        if len(e.inputs) > 1:
            signals |= dict(zip(problem.model.inputs, e.inputs.T, strict=True))
        units = {n: e.units.get(n, "rad" if n in problem.outputs else "V") for n in signals}
        found = signal_faults(e.time, signals, [measure_signal(n, units[n], e.time, y) for n, y in signals.items()])
    else:
        found = report.findings
    return [replace(f, where=f"{e.name}: {f.where}") for f in found]


def _swings(y: FloatArray) -> tuple[float, float, int]:
    """How often a signal swings by over a tenth of its largest swing, its period, and where it begins [samples]."""
    rest, _, at_rest = tail(y)
    away = y - (rest if at_rest else float(np.median(y)))
    side = np.sign(away) * (np.abs(away) > 0.1 * np.max(np.abs(away)))
    there = np.flatnonzero(side)
    turns = there[1:][np.diff(side[there]) != 0]
    moved = np.flatnonzero(np.abs(y - y[0]) > 0.05 * np.ptp(y))
    period = 2.0 * float(np.median(np.diff(turns))) if turns.size > 1 else math.inf
    return turns.size / 2, period, int(moved[0]) if moved.size else 0


def _largest(e: Experiment) -> FloatArray:
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
    found = _modes(problem, (0.0, x, np.zeros(len(problem.model.inputs))), values, np.ones(len(x)))
    growth = max((m.real for m in found if abs(m.imag) <= 1e-6 * abs(m)), default=0.0)
    _, period, _ = _swings(_largest(e))
    falls = growth * min(period, len(e.measured)) * e.step > 1
    if "alpha" in posture and any(p.name == "alpha_rest" for p in problem.model.parameters):
        yield from _off_hanging(problem, e, posture["alpha"], falls)
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
    count, _, _ = _swings(late)
    return middle if count >= SWINGS and float(np.max(np.abs(late - middle))) < math.pi / 2 else None


def _off_hanging(problem: Problem, e: Experiment, rest: float, falls: bool) -> Iterator[Finding]:
    zero, own = problem.model.zero, problem.parameters.get("alpha_rest")
    offset, reach = problem.model.parameter("alpha_rest").value, 0.0
    if isinstance(own, Free):
        offset, reach = own.start, max(own.upper - own.start, own.start - own.lower)
    off = math.remainder(rest - offset - (math.pi if zero == "upright" else 0.0), 2 * math.pi)
    stays, away = f"it stays at {math.degrees(rest):.1f}°", abs(math.degrees(off))
    if falls and abs(off) > math.pi / 2:
        other = "hanging" if zero == "upright" else "upright"
        yield Finding("wrong-zero", f"{e.name}: alpha", away, 90.0, "degrees from hanging",
            f'{stays}, where this model, zero = "{zero}", has the pendulum upright, and falls over. Its zero may be '
            f"wrong: add 3.14159 to the zero in alpha's table, or type zero = \"{other}\" in [model].")  # fmt: skip
    elif abs(off) > OFFSET + reach:
        yield Finding("wrong-zero", f"{e.name}: alpha", away, math.degrees(OFFSET + reach), "degrees from hanging",
            f'{stays}, {away:.1f}° from where this model hangs. Its zero may be wrong: type zero = "rest" in '
            "alpha's table, or give alpha_rest a wider range.")  # fmt: skip


# --- steps -------------------------------------------------------------------------------------------


def _steps(problem: Problem, e: Experiment) -> Iterator[Finding]:
    orders, values, _ = problem.unpack(problem.start, e)
    h = e.step / problem.substeps
    gain = h**orders * time_scale(problem.model, values) ** (1 - orders)
    found = [_modes(problem, at, values, gain) for at in _measured_states(problem, e)]
    largest = max((float(np.max(np.abs(m))) for m in found if m.size), default=0.0)
    steps = float(np.median([steps_a_period(m) for m in found]))
    follows = FOLLOWS.get(problem.method, math.inf)
    if largest > follows:
        more = problem.substeps * math.ceil((2 * largest / follows) ** (1 / float(np.max(orders))))
        yield Finding("stiff", e.name, largest, follows, "|J|h",
            f"the step is too long for {problem.method}: |J|h is {largest:.3g} at the start's values, and an explicit "
            f'scheme follows up to about {follows:g}. Type method = "pi2" in [fit], or substeps = {more}.')  # fmt: skip
    elif steps < STEPS_A_PERIOD:
        more = problem.substeps * math.ceil(2 * STEPS_A_PERIOD / steps)
        yield Finding("coarse-steps", e.name, steps, STEPS_A_PERIOD, "steps a period",
            f"the fastest oscillation has {steps:.2g} steps a period, where {STEPS_A_PERIOD:.0f} are too few already. "
            f"Type substeps = {more} in [fit].")  # fmt: skip


def _modes(
    problem: Problem, at: tuple[float, FloatArray, FloatArray], values: FloatArray, gain: FloatArray
) -> NDArray[np.complex128]:
    """μ at a time, a state and an input."""
    t, x, u = at
    with np.errstate(all="ignore"):
        return modes(linearised(compile_rhs(problem.model.rhs), t, x, u, values), gain)


def _measured_states(problem: Problem, e: Experiment) -> Iterator[tuple[float, FloatArray, FloatArray]]:
    """Times, states and inputs at some samples: the rates are slopes of the samples, other states are zero."""
    w = max(1, round(0.01 / e.step))
    for k in np.linspace(w, len(e.measured) - 1 - w, ASKED, dtype=int).tolist():
        x = np.zeros(len(problem.model.states))
        for o, y in zip(problem.outputs, e.measured.T, strict=True):
            i = problem.model.outputs[o]
            x[i] = y[k]
            if i in problem.rates:
                x[problem.rates[i]] = (y[k + w] - y[k - w]) / (2 * w * e.step)
        yield float(e.time[k]), x, e.inputs[min(k, len(e.inputs) - 1)]


def _worst(found: Iterator[Finding]) -> list[Finding]:
    """One of each code: the worst."""
    worst: dict[str, Finding] = {}
    for f in found:
        before = worst.get(f.code)
        ratio = f.number / f.limit if f.code == "stiff" else f.limit / f.number
        if before is None or ratio > (before.number / f.limit if f.code == "stiff" else f.limit / before.number):
            worst[f.code] = f
    return list(worst.values())


# --- signs -------------------------------------------------------------------------------------------


def _wrong_sign(problem: Problem, jobs: int) -> Iterator[Finding]:
    """Each recording by itself, for each has signs of its own; one finding for those with the same angle turned."""
    found: dict[tuple[str, ...], list[tuple[str, float, float]]] = {}
    for e in _most_moved(problem):
        either, given, best = _turned_round(replace(problem, experiments=(e,)), jobs)
        if either:
            found.setdefault(either, []).append((e.name, given, best))
    for either, recordings in found.items():
        _, given, best = max(recordings, key=lambda r: r[1] / r[2])
        names = ", ".join(name for name, _, _ in recordings)
        yield Finding("wrong-sign", f"{names}: {either[0]}", 100 * given, 100 * BAD, "% of the motion left over",
            f"two swings, fitted, leave {100 * given:.0f} % of the motion over, and {100 * best:.0f} % with the sign "
            f"of {' or '.join(either)} turned round: it may be wrong. Type sign = -1 in its table.")  # fmt: skip


def _most_moved(problem: Problem) -> list[Experiment]:
    """Not more than so many recordings, in their order: those in which the angle that moves less moves most."""

    def least(e: Experiment) -> float:
        return float(np.min(np.ptp(e.measured, axis=0)))

    kept = sorted(problem.experiments, key=least, reverse=True)[:SIGNS]
    return [e for e in problem.experiments if any(e is other for other in kept)]


def _turned_round(problem: Problem, jobs: int) -> tuple[tuple[str, ...], float, float]:
    """Angles of which either, turned round, fits two swings of the one recording; what is left as given, and so.

    None where they fit as they are, or turned round no better.
    """
    early = _two_swings(problem)
    angles = [] if early is None else _signed(early)
    if early is None or not angles or (given := _left_over(early, jobs)) < BAD:
        return (), 0.0, 0.0
    turned = {o: _left_over(_turned(early, o), jobs) for o in angles}
    best = min(turned.values())
    if not best < min(BAD, BETTER * given):
        return (), given, best
    same = len(angles) == 2 and not np.any(early.experiments[0].inputs)  # undriven, one turned is the other turned
    return tuple(o for o in angles if same or turned[o] < 1.5 * best), given, best


def _two_swings(problem: Problem) -> Problem | None:
    """Of the recording, every so many samples, by its rmse; None if nothing swings."""
    e = problem.experiments[0]
    period, begins = min((_swings(y)[1:] for y in e.measured.T if np.ptp(y) > 0), default=(math.inf, 0))
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
    own = {problem.model.states[j] for j in (i, problem.rates.get(i, i))}
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
    if isinstance(fitted, str):
        return math.inf
    spread = np.std(e.measured, axis=0)
    moves = spread > 1e-2 * spread.max()
    parts = np.sqrt(np.mean((e.measured - fitted) ** 2, axis=0))[moves] / spread[moves]
    return float(np.sqrt(np.mean(parts**2)))


# --- the minimum -----------------------------------------------------------------------------------------


def _loose_memory(problem: Problem, x: FloatArray, known: Uncertainty | str, jobs: int) -> Iterator[Finding]:
    """Simulate with a better memory, and project the difference on the unknowns."""
    if _tolerance(problem) <= CERTIFIED or not problem.names:
        return
    tight = replace(problem, memory=compressed(TIGHTER * CERTIFIED), memo=None)
    now, then = problem.errors(x), tight.errors(x)
    if isinstance(now, str) or isinstance(then, str):
        return
    change = np.concatenate([(a - b).ravel() for a, b in zip(now, then, strict=True)])
    errors = np.concatenate([y.ravel() for y in now])
    if float(np.linalg.norm(change)) < SHIFT * float(np.linalg.norm(errors)):
        return  # moves no unknown by more than a fraction of its standard error
    everything = np.arange(len(x))
    J = jacobian(problem, x, everything, jobs=jobs)
    if isinstance(J, str):
        return
    rows = np.concatenate([j.reshape(-1, len(x)) for j in J])
    scale = np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
    shift = np.linalg.lstsq(rows / scale, change, rcond=1e-10)[0] / scale
    for i, u in enumerate(problem.unknowns):
        se = math.nan if isinstance(known, str) else float(known.standard_error[i])
        half = NORMAL_95 * se
        if u.kind == "order":
            half = max(SHIFT, half if math.isfinite(half) else 0.0)
        if math.isfinite(half) and abs(shift[i]) > half:
            yield Finding("loose-memory", u.name, abs(float(shift[i])) / half, 1.0, "half intervals",
                f"a better memory moves it by {-shift[i]:+.2g}, {abs(shift[i]) / half:.2g} times half its interval: "
                f"{problem.memory.name} is too loose. Leave memory and tolerance out of [fit].")  # fmt: skip


def _tolerance(problem: Problem) -> float:
    """Of the memory's weights, relative; all of them for one that forgets."""
    kind, _, rest = problem.memory.name.partition("(")
    if kind == "compressed":  # compressed(1e-10) or compressed(1e-10, lags=16)
        return float(rest.split(",")[0].rstrip(")"))
    return 0.0 if kind == "full" else 1.0


def _short_window(problem: Problem, known: Uncertainty | str) -> Iterator[Finding]:
    """Orders that are not known well, where the records have few swings."""
    if isinstance(known, str):
        return
    longest = max(problem.experiments, key=lambda e: _swings(_largest(e))[0])
    y = _largest(longest)
    swings, period, begins = _swings(y)
    late = float(np.std(y[-(len(y) // 4 + 1) :]))
    moving = late > max(STILL_MOVING * float(np.std(y[begins:])), 3 * _noise(y))
    if swings >= FEW_SWINGS or not moving:  # what came to rest tells no more
        return
    seconds = (len(y) - begins) * longest.step
    for i in problem.order_indices:
        half, reach = NORMAL_95 * float(known.standard_error[i]), problem.unknowns[i].range
        if not WANTED < half <= reach.upper - reach.lower:  # known well enough, or not seen at all
            continue
        enough = max(seconds * (half / WANTED) ** (2 / 3), min(FEW_SWINGS * period, 2 * len(y)) * longest.step)
        yield Finding("short-window", problem.names[i], swings, FEW_SWINGS, "swings",
            f"it is known to ± {half:.2g}, from {swings:.3g} swings in {seconds:.3g} s: the record may be too short "
            f"for an order. Some {enough:.2g} s would tell it to ± {WANTED:g}, or fix it.")  # fmt: skip


def _parabola(problem: Problem, x: FloatArray, known: Uncertainty | str, jobs: int) -> Curvature | str:
    """The cost next to its minimum over the unknowns that no bound holds, or why there is none."""
    if isinstance(known, str):
        return known
    free = np.flatnonzero(~known.at_bound)
    return curvature(problem, x, free, jobs=jobs) if len(free) else "nothing is free"


def noisy_start(
    problem: Problem, x: FloatArray, known: Uncertainty | str, *, jobs: int = 1, parabola: Curvature | str | None = None
) -> tuple[Finding, ...]:
    """Say so where the noise of the samples that the start is taken from moves an unknown by more than its interval.

    Parameters
    ----------
    problem : Problem
    x : array, shape (n_unknowns,)
        Its minimum, or next to it.
    known : Uncertainty or str
        What :func:`fracid.uncertainty.uncertainty` gave there.
    jobs : int
        Threads.
    parabola : Curvature or str, optional
        There, of the unknowns that no bound holds; found if left out.

    Returns
    -------
    tuple of Finding
        One for the unknown that is moved most, orders first; or none.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment, Free, Problem
    >>> from fracid.uncertainty import uncertainty
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=4e-3, end=6.0)
    >>> y = run.states[:, [0, 2]] + 1e-3 * np.random.default_rng(1).standard_normal((1501, 2))
    >>> swing = Experiment("twin", 4e-3, y, np.zeros((1, 1)))
    >>> problem = Problem(rig, (swing,), {"lambda": 0.9, "mu": Free(0.95, 0.5, 1.2)}, initial_state="held")
    >>> [found] = noisy_start(problem, problem.start, uncertainty(problem, problem.start))
    >>> found.code, found.where, found.number > 1
    ('noisy-start', 'mu', True)
    """
    if isinstance(known, str) or problem.initial_state not in LOOSER:
        return ()
    found = _parabola(problem, x, known, jobs) if parabola is None else parabola
    noise = _noise_at_the_start(problem, x)
    shift = None if isinstance(found, str) or not noise else start_shift(problem, x, found, noise, jobs=jobs)
    if shift is None:
        return ()
    with np.errstate(invalid="ignore", divide="ignore"):
        times = np.nan_to_num(shift / known.standard_error, nan=0.0, posinf=0.0)
    beyond = np.flatnonzero(times > 1)
    if not len(beyond):
        return ()
    first = [i for i in beyond if problem.unknowns[i].kind == "order"] or [*beyond]
    i = max(first, key=lambda k: times[k])
    sd = max(float(np.max(s)) for s in noise.values())
    unit = problem.experiments[0].units.get(problem.outputs[0], "rad")
    return (Finding("noisy-start", problem.names[i], float(times[i]), 1.0, "half intervals",
        f"the start is taken from the first sample, whose noise of {with_unit(sd, unit, '.2g')} may move it by "
        f"± {NORMAL_95 * shift[i]:.2g}, {times[i]:.2g} times half its interval, which does not know of that. Type "
        f'initial_state = "{LOOSER[problem.initial_state]}" in [fit], or the start that you know: initial = {{ … }} '
        "in the recording's table."),)  # fmt: skip


def _stopped_short(
    problem: Problem, x: FloatArray, known: Uncertainty | str, found: Curvature | str
) -> Iterator[Finding]:
    """Whether the cost falls on along a Newton step: further than half of half an interval, or by a hundredth."""
    if isinstance(found, str) or isinstance(known, str):
        return
    step, cost = newton_step(problem, x, found)
    size = [max(abs(v), 1e-2 * min(u.range.upper - u.range.lower, 1.0))
            for u, v in zip(problem.unknowns, x.tolist(), strict=True)]  # fmt: skip
    least, half = NEXT_TO_NOTHING * np.array(size), NORMAL_95 * known.standard_error
    intervals = np.abs(step) / np.where(np.isfinite(half), np.maximum(half, least), math.inf)
    here, i = problem.cost(x), int(np.argmax(intervals))
    lower = 100 * (1 - cost / here) if here > 0 else 0.0
    by_cost = lower > FALLS and bool(np.any(np.abs(step) > least))
    if intervals[i] > SHORT or by_cost:
        i = i if intervals[i] > SHORT else int(np.argmax(np.abs(step) / least))
        measure = (
            (float(intervals[i]), SHORT, "half intervals") if intervals[i] > SHORT else (lower, FALLS, "% of the cost")
        )
        yield Finding("stopped-short", problem.names[i], *measure,
            f"the search stopped short of its minimum: a step of {step[i]:+.2g}, {intervals[i]:.2g} times half its "
            f"interval, and of the others with it, lowers the cost to {cost:.6g} from {here:.6g}. Start the free "
            "values where this fit ended, or type --multi-start 16.")  # fmt: skip


def _noise_at_the_start(problem: Problem, x: FloatArray) -> dict[str, FloatArray]:
    """Recording → noise of its samples, no more than what the fit leaves over [rad]; empty where a run fails."""
    errors = problem.errors(x)
    if isinstance(errors, str):
        return {}
    return {
        e.name: np.array(
            [min(_noise(y), float(np.sqrt(np.mean(r**2)))) for y, r in zip(e.measured.T, d.T, strict=True)]
        )
        for e, d in zip(problem.experiments, errors, strict=True)
    }


def _cannot_explain(problem: Problem, x: FloatArray, e: Experiment) -> Iterator[Finding]:
    fitted = problem.fitted(x, e)
    if isinstance(fitted, str):
        return
    for o, y, z in zip(problem.outputs, e.measured.T, fitted.T, strict=True):
        rms, spread, noise = float(np.sqrt(np.mean((y - z) ** 2))), float(np.std(y)), _noise(y)
        part, times = rms / max(spread, 1e-300), rms / noise
        if LEFT_OVER < part < NO_BETTER and part * times > BETWEEN:
            yield Finding("cannot-explain", f"{e.name}: {o}", times, BETWEEN / part, "times the noise",
                f"what is left over is {with_unit(rms, e.units.get(o, 'rad'))}, {100 * part:.2g} % of the motion and "
                f"{times:.2g} times the noise: this model may not be able to explain it. Look at "
                "fracid resid, free a friction, or ask fracid compare; another start: --multi-start 16.")  # fmt: skip


def _noise(y: FloatArray) -> float:
    """Of the samples: by third differences, and no less than the encoder's rounding [rad]."""
    q = resolution(y) or 0.0
    white = float(np.sqrt(np.mean(np.diff(y, 3) ** 2) / 20)) if y.size > 3 else 0.0
    return max(white, q / math.sqrt(12.0), 1e-9)
