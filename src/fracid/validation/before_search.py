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
``tilted-axis``     how far the pendulum's rest moved while the arm turned, from before the input to the record's end:
                    an axis that leans by ε moves it by up to 2 ε [degrees, limit 0.3]
``stiff``           \|J\|h along the measured motion, for explicit schemes (:mod:`fracid.solver.stiffness`), where the
                    project fixes the step
``coarse-steps``    steps for each period of the fastest oscillation, there, where the project fixes the step
``wrong-sign``      two swings of each recording, fitted as the project says and with the sign of one angle turned
                    round: the part of the motion that is left over.  Said where it was above 35 %, and falls to less
                    than half; of many recordings the eight that move most are asked
                    (:mod:`fracid.validation.reversed_signs`)
==================  ==============================================================================================

and of the minimum :func:`after` asks

==================  ==============================================================================================
``loose-memory``    how far the unknowns would go with a memory a thousand times as accurate, in CI half-widths:
                    :math:`δx = (J^T J)^{-1} J^T δy`, δy the change of the simulated outputs
``short-window``    an order that is seen, but not to 0.1, in a record that ends in motion after fewer than ten swings:
                    how many, and how long it takes; an interval shrinks like :math:`T^{-3/2}`
``noisy-start``     how far the noise of the first samples moves an unknown, where the start is taken from them
                    (``held``, ``measured``), in CI half-widths (:func:`fracid.estimation.curvature.start_shift`)
``late`` and so on  a signal that is late, scaled, off its zero, that drifts or has play: its size by one
                    Gauss-Newton step, and how far that would move an order, in CI half-widths
``stopped-short``   how far a Newton step from the search's end goes to lower cost, in CI half-widths
                    (:func:`fracid.estimation.curvature.newton_step`); said above a half, or where that is lower by 1 %
``cannot-explain``  rms of what is left over, in units of the noise that is measured on the samples (third differences,
                    and no less than the encoder's q/√12): where more than a tenth of the motion is left, and that is
                    twice the geometric mean of noise and motion
==================  ==============================================================================================

A check reads the numbers of recordings and model, and yields findings.

Nothing is repaired in silence: a finding says what to type.  Another fault explains a recording as well as the one
that is named, now and then, so each says "may".
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from fracid.arrays import FloatArray
from fracid.findings import Finding
from fracid.problem import Experiment, Free, Problem
from fracid.problem.checks import MOST_STEPS
from fracid.recording import Report
from fracid.recording.measures import is_pendulum
from fracid.recording.report import measure
from fracid.signals.resolution import resolution
from fracid.signals.swing import final_value, swing_period, tail
from fracid.solver.methods import METHODS
from fracid.solver.right_hand_side import compile_rhs
from fracid.solver.solve import time_scale
from fracid.solver.stiffness import STEPS_A_PERIOD, linearised, modes, step_gain, steps_a_period, too_long
from fracid.validation.misfits import cost_of
from fracid.validation.reversed_signs import SAYS, wrong_sign

ASKED = 9
"""Samples at which J is asked for."""

OFFSET = math.radians(11.0)
"""A pendulum that rests further from hanging does not hang, or its zero is wrong."""

MOVED_REST, TURNED = math.radians(0.3), math.radians(5.0)
"""A pendulum that hangs elsewhere after its arm has turned hangs on an axis that leans."""

FEW = 5
"""Samples that are no rest."""

DRIVEN = 0.01
"""Of the largest input: beyond it the rig is driven."""


def before(
    problem: Problem, reports: Mapping[str, Report] | None = None, *, validation: tuple[Experiment, ...] = (),
    fixed_step: bool = True, jobs: int = 1,
) -> tuple[Finding, ...]:  # fmt: skip
    """Look for what makes a search find nothing that means anything.

    Parameters
    ----------
    problem : Problem
    reports : mapping, optional
        Each recording's name to what was measured of it; measured on its samples if left out.
    validation : tuple of Experiment
        Held-out recordings.
    fixed_step : bool
        Whether the step stays as it is; else the fit chooses one, and its check judges that.
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
    recordings, reports = (*problem.experiments, *validation), reports or {}
    samples = [f for e in recordings for f in _sample_findings(problem, e, reports.get(e.name))]
    findings = [f for f in samples if f.code != "counted-backwards"]  # the model itself tells a wrong sign
    in_its_unit = not any(f.code in ("degrees-as-radians", "radians-as-degrees") for f in findings)
    if in_its_unit:  # else all that follows from it would be said too
        findings += [f for e in problem.experiments for f in _wrong_zero(problem, e)]
        findings += [f for e in recordings for f in _tilted_axis(problem, e)]
    steps = [f for e in problem.experiments if fixed_step for f in _long_steps(problem, e)]
    findings += {f.code: f for f in sorted(steps, key=cost_of)}.values()  # of each code the worst
    if in_its_unit and not any(f.code == "wrong-zero" for f in findings):
        findings += wrong_sign(problem, jobs)
    return tuple(findings)


def _sample_findings(problem: Problem, e: Experiment, report: Report | None) -> list[Finding]:
    """What was seen in a recording when it was read, or is seen in its samples."""
    if report is None:
        signals = dict(zip(problem.outputs, e.measured.T, strict=True))
        if len(e.inputs) == len(e.measured):
            signals |= dict(zip(problem.model.inputs, e.inputs.T, strict=True))
        own = {n: "rad" if is_pendulum(n) else problem.model.unit_of(n) for n in signals}
        units = {n: e.units.get(n, unit) if unit == "rad" else unit for n, unit in own.items()}
        report = measure(e.time, signals, units)
    return [replace(f, where=": ".join(filter(None, (e.name, f.where))))
            for f in report.of_model(problem.model.inputs).findings
            if problem.model.rates or f.code != "short-window"]  # fmt: skip


# --- what the model does along a recording, and where it stays ---------------------------------------------


def _growth(problem: Problem, e: Experiment, posture: Mapping[str, float]) -> float:
    """How fast the start's model leaves a posture [1/s]."""
    model, values = problem.model, problem.unpack(problem.start, e)[1]
    still, no_inputs = np.zeros(len(model.states)), np.zeros(len(model.inputs))
    for o, value in posture.items():
        if o in model.output_states:
            still[model.output_states[o]] = value
    with np.errstate(all="ignore"):
        departures = modes(linearised(compile_rhs(model.rhs), 0.0, still, no_inputs, p=values), np.ones(len(still)))
    return max((m.real for m in departures if abs(m.imag) <= 1e-6 * abs(m)), default=0.0)


def _driven(e: Experiment) -> bool:
    """Whether its inputs, in the second half, may hold it where it stays."""
    late = e.inputs[len(e.inputs) // 2 :]
    return bool(np.any(np.abs(late) > DRIVEN * max(float(np.max(np.abs(e.inputs), initial=0.0)), 1e-300)))


def _measured_states(problem: Problem, e: Experiment) -> Iterator[tuple[float, FloatArray, FloatArray]]:
    """Times, states and inputs at some samples: the rates are slopes of the samples, other states are zero."""
    w = min(max(1, round(0.01 / e.step)), (len(e.measured) - 1) // 2)
    for k in np.linspace(w, len(e.measured) - 1 - w, ASKED, dtype=int).tolist():
        x = np.zeros(len(problem.model.states))
        for o, y in zip(problem.outputs, e.measured.T, strict=True):
            i = problem.model.output_states.get(o)
            if i is None:
                continue
            x[i] = y[k]
            if i in problem.model.rates:
                x[problem.model.rates[i]] = (y[k + w] - y[k - w]) / (2 * w * e.step)
        yield float(e.time[k]), x, e.inputs[min(round(e.time[k] / e.step), len(e.inputs) - 1)]


# --- the checks ------------------------------------------------------------------------------------------


def _wrong_zero(problem: Problem, e: Experiment) -> Iterator[Finding]:
    """Where the recording stays, does the model?"""
    ends = {} if _driven(e) else {o: final_value(y) for o, y in zip(problem.outputs, e.measured.T, strict=True)}
    posture = {o: value for o, value in ends.items() if value is not None}
    growth, swing = _growth(problem, e, posture), min(swing_period(e.most_moved), len(e.measured)) * e.step
    falls = growth * swing > 1  # the model, put there, has left within a swing
    pendulum = problem.model.pendulum
    if problem.model.rest_of(pendulum) and pendulum in posture:
        yield from _off_hanging(problem, f"{e.name}: {pendulum}", posture[pendulum], falls)
    elif posture and falls:
        yield SAYS.finding("falls", e.name, growth, 0.0, seconds=1 / growth)


def _off_hanging(problem: Problem, where: str, angle: float, falls: bool) -> Iterator[Finding]:
    """How far is an angle from where the model says that its pendulum hangs, or may be found to?"""
    model = problem.model
    rest = model.rest_of(model.pendulum)
    own, at = problem.parameters.get(rest), problem.parameter_starts.get(rest, model.parameter(rest).value)
    reach = max(own.upper - own.start, own.start - own.lower) if isinstance(own, Free) else 0.0
    off = math.remainder(angle - at - (math.pi if model.zero == "upright" else 0.0), 2 * math.pi)
    stays, away = f"it stays at {math.degrees(angle):.1f}°", abs(math.degrees(off))
    if falls and abs(off) > math.pi / 2:
        other = "hanging" if model.zero == "upright" else "upright"
        yield SAYS.finding("upside-down", where, away, 90.0, stays=stays, model=model, other=other)
    elif abs(off) > OFFSET + reach:
        yield SAYS.finding("off-zero", where, away, math.degrees(OFFSET + reach), stays=stays, model=model, rest=rest)


def _tilted_axis(problem: Problem, e: Experiment) -> Iterator[Finding]:
    """Where the arm has turned, does the pendulum hang as before?"""
    tilts = {n: k.joint for n, k in problem.model.friction.items() if k.rung == "tilt"}
    level = all(problem.parameters.get(n, problem.model.parameter(n).value) == 0.0 for n in tilts)
    joint, pendulum = next(iter(tilts.values()), ""), problem.model.pendulum
    if not problem.model.rest_of(pendulum) or not level or not {joint, pendulum} <= set(problem.outputs):
        return
    both = [e.measured[:, problem.outputs.index(n)] for n in (joint, pendulum)]
    rests = [(_before_the_input(e, y), rest if at_rest else None) for y in both for rest, _, at_rest in (tail(y),)]
    turned, moved = (math.nan if a is None or b is None else math.degrees(b - a) for a, b in rests)
    if abs(turned) > math.degrees(TURNED) and abs(moved) > math.degrees(MOVED_REST):
        yield SAYS.finding("tilted-axis", f"{e.name}: {pendulum}", abs(moved), math.degrees(MOVED_REST),
                           moved=moved, joint=joint, turned=turned, tilts=' and '.join(tilts))  # fmt: skip


def _before_the_input(e: Experiment, y: FloatArray) -> float | None:
    """Where a signal is at rest before the first input begins; None where it is not, or nothing is known of inputs."""
    changes = np.flatnonzero(np.any(np.diff(e.inputs, axis=0) != 0, axis=1))
    still = y[: changes[0] + 1] if len(changes) else y[:0]
    at_rest = len(still) >= FEW and np.ptp(still) <= 3 * (resolution(y) or 0.0) * (1 + 1e-9)
    return float(np.mean(still)) if at_rest else None


def _long_steps(problem: Problem, e: Experiment) -> Iterator[Finding]:
    """How far the step is beyond what the method follows along the motion, by the start's model."""
    method, substeps, (orders, values, *_) = problem.method, problem.substeps, problem.unpack(problem.start, e)
    gain, rhs = step_gain(e.step / substeps, orders, time_scale(problem.model, values)), compile_rhs(problem.model.rhs)
    with np.errstate(all="ignore"):
        linear = [linearised(rhs, t, x, u, p=values) for t, x, u in _measured_states(problem, e)]
    if beyond := too_long(method, orders, linear, gain, steps=len(e.measured) * substeps):
        scheme, other = ("an explicit scheme", "pi2") if METHODS[method].follows < math.inf else ("it", "bdf2")
        more = f", or substeps = {substeps * math.ceil(beyond.parts)}" if beyond.parts < MOST_STEPS else ""
        yield SAYS.finding("stiff", e.name, beyond.size, beyond.limit, method=method, scheme=scheme, other=other,
                           more=more)  # fmt: skip
    elif (steps := float(np.median([steps_a_period(modes(J, gain)) for J in linear]))) < STEPS_A_PERIOD:
        yield SAYS.finding("coarse-steps", e.name, steps, STEPS_A_PERIOD,
                           finer=substeps * math.ceil(2 * STEPS_A_PERIOD / steps))  # fmt: skip
