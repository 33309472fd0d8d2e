r"""Was a signal misread?  What a fit leaves over tells a delay, a scale, a zero, a drift or play, with its size.

A search answers for a signal that comes late as well: with other orders, for an order bends the phase as a delay does.
One sample of delay in one of two angles moves an order by up to ten times its interval, and the fit looks good.
But what is left over has the fault's own form.  With e the residuals, :math:`J = ∂e/∂x` at the minimum and
:math:`z = ∂e/∂δ` of a fault of size δ, which is one unknown more, Gauss-Newton's step for all of them is

.. math::  \hat δ = -\frac{z_\perp'e}{z_\perp'z_\perp}, \qquad Δx = -(J'J)^{-1}J'z\,\hat δ, \qquad
           z_\perp = z - J(J'J)^{-1}J'z :

what of z the unknowns could not do themselves (an *added variable* [CW]_; the test of it is Rao's score test).  Here

============ ===================================== ==================================================================
code         z, of one output y                    seen as
============ ===================================== ==================================================================
``late``     :math:`\dot y`                        read δ seconds after the others: a filter, a logger polling in turn
(an input)   :math:`-∂y/∂δ`, by simulation         the same of what drives
``scaled``   :math:`-y`                            a wrong gain, wrong counts per turn
``off-zero`` −1                                    the zero that is δ off
(an input)   :math:`-∂y/∂δ`, by simulation         the offset of a current sensor, of a load cell
``drifts``   :math:`-t/T`                          a zero that is δ off at the end
``play``     :math:`\tfrac12 \mathrm{sgn}\,\dot y` a hub, a gear or a belt with play δ
============ ===================================== ==================================================================

The one that explains most, or nearly, is said, if it is :data:`SURE` of its standard errors away from 0 (half as many
where it explains more than :data:`MUCH`), and either moves an order by more than half its interval, or takes more than
:data:`MOST` of the squares that are left over.  Its standard error knows of correlation in what is then left (Newey and
West's, as in :mod:`fracid.estimation.covariance`), so that a model's own error is not taken for a fault: on recordings
of three real rigs, fitted well, no step moves an order by half its interval, and none takes more than 34 %.  What
changes a signal by less than half a step of its encoder is left alone, and a value that an encoder keeps counts as one
sample: where a pendulum rests its rounding is as constant as a zero that is off.

A linear step it is.  One that takes an order out of its range is none, and not said: where the data hardly tell an
order, a gain of 40 % is as good.  A delay of a quarter of a swing is beyond it, and
:func:`fracid.validation.after_search.after` says then that the model cannot explain the recording.

References
----------
.. [CW] R. Cook, S. Weisberg, Residuals and Influence in Regression, 1982, section 2.3.2: added variable plots.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from fracid.arrays import FloatArray, joined, run_lengths
from fracid.errors import Failure
from fracid.estimation.covariance import LEAST_SHIFT, Known
from fracid.estimation.derivatives import row_weights
from fracid.estimation.tangent import Tangent, tangent
from fracid.findings import Finding, Words
from fracid.problem import Experiment, Free, Problem, Sensor
from fracid.quantiles import NORMAL_95
from fracid.signals.correlation import bartlett_long_run, sokal_bandwidth
from fracid.signals.swing import swing_period, tail
from fracid.units import letter, with_unit

SAYS = Words("validation/sensor_faults.toml")

SURE = 8.0
"""Standard errors: twins without a fault reach 5."""

MUCH = 0.3
"""Part of the squares that are left over; of twins without a fault a hundredth."""

MOVES = 1.0
"""CI half-widths by which an order may move."""

MOST = 0.6
"""Part of the squares that are left over which one fault may explain; real rigs reach 0.34."""

OWN = 1e-3
"""A form of which the unknowns leave less than this part over is their own."""

ALIKE = 0.8
"""Of what the best explains: who explains less is not named in its place."""

EARLY = 0.95
"""One signal is as late as the other is early, where the start is free: what is late is named; and of an output and an
input whose zeros do the same to a thousandth, the output."""

NUMBERS = 4e6
"""Entries of J that are looked at; of longer recordings the beginning."""

FEWEST = 2000
"""Samples of each recording, or all it has: of so many recordings that less is left nothing is said."""

NUDGE = 1e-3
"""Of an input's range, by which its zero is moved."""

NOTHING = 1e-6
"""What is left over [rad], below which it is arithmetic."""


class Misreading(NamedTuple):
    """One fault, its size, and what it would do."""

    code: str
    signal: str
    size: float
    """δ̂: [s] for ``late``, a part of the signal for ``scaled``, else in the signal's unit."""
    sure: float
    """|δ̂| in its standard errors."""
    share: float
    """Part of the squares that are left over which it explains."""
    moves: str
    """The order that it moves most, "" for none."""
    shift: float
    """By how much."""
    half_intervals: float
    """The same, in half its interval."""
    steps: float
    """The most that it changes of its signal, in half steps of the encoder; infinite where no steps are seen."""


def misread(problem: Problem, every: Iterable[Misreading]) -> Iterator[Finding]:
    """Say the fault that explains most of what is left over at a minimum, if it matters.

    Parameters
    ----------
    problem : Problem
    every : iterable of Misreading
        What :func:`misreadings` gave there.

    Examples
    --------
    α is read 8 ms after θ:

    >>> import fracid
    >>> from fracid.problem import Experiment, Free, Problem
    >>> from fracid.estimation.covariance import uncertainty
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 0.95, "mu": 0.97}, initial={"alpha": 0.5}, step=4e-3, end=4.0)
    >>> read = np.column_stack([run.states[2:, 0], run.states[:-2, 2]])
    >>> read += 5e-4 * np.random.default_rng(1).standard_normal(read.shape)
    >>> swing = Experiment("twin", 4e-3, read, np.zeros((1, 1)))
    >>> problem = Problem(rig, (swing,), {"lambda": Free(0.95, 0.5, 1.2), "mu": Free(0.97, 0.5, 1.2)})
    >>> fit = fracid.identify(problem, optimiser="least-squares")
    >>> every = misreadings(problem, fit.x, fit.uncertainty)
    >>> [(f.code, "freed, that would move λ by" in f.sentence) for f in misread(problem, every)]
    [('late', True)]
    """
    candidates = [m for m in every if m.steps > 1 and m.sure > (SURE if m.share < MUCH else SURE / 2)]
    most = max((m.share for m in candidates), default=0.0)
    matter = [m for m in candidates if m.share > ALIKE * most and (_moves(m) or m.share > MOST)]
    if matter:
        best = max(matter, key=lambda m: round(EARLY * m.share if m.code == "late" and m.size < 0 else m.share, 3))
        explains = ("explains", best.signal, 100 * best.share, 100 * MOST)
        why = ("moves", best.signal, best.half_intervals, MOVES) if _moves(best) else explains
        yield SAYS.finding(*why, says=_size(problem, best), best=best, fix=_fix(problem, best),
                           moves=letter(best.moves))  # fmt: skip


def _moves(m: Misreading) -> bool:
    return m.half_intervals > MOVES and abs(m.shift) > LEAST_SHIFT


def misreadings(
    problem: Problem, x: FloatArray, uncertainty: Known, *, jobs: int = 1, near: Tangent | None = None
) -> Iterator[Misreading]:
    """Each fault of each signal, with its size by one Gauss-Newton step; empty where there are no intervals.

    By derivatives that hold over the width of the intervals: beside a steep friction others are a matter of rounding.

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
    """
    if isinstance(uncertainty, Failure) or not np.any(np.isfinite(uncertainty.standard_error)):
        return
    length = int(NUMBERS / (len(x) * len(problem.outputs) * len(problem.experiments)))
    if length < min(FEWEST, max(len(e.measured) for e in problem.experiments)):
        return
    if length < max(len(e.measured) for e in problem.experiments):
        problem, near = replace(problem.until(length * max(e.step for e in problem.experiments)), memo=None), None
    free = np.flatnonzero(np.isfinite(uncertainty.standard_error))
    forms, here = _forms(problem, x), near or tangent(problem, x, jobs=jobs)
    if isinstance(here, Failure) or forms is None or math.sqrt(np.mean(joined(here.errors) ** 2)) < NOTHING:
        return
    roots = zip(row_weights(problem, here.errors), problem.experiments, strict=True)
    weight = joined(root / np.sqrt(run_lengths(e.measured)) for root, e in roots)
    e, J = weight * joined(here.errors), [j[..., free].reshape(-1, len(free)) for j in here.derivatives]
    Q, R = np.linalg.qr(weight[:, None] * np.concatenate(J))
    if not np.all(np.abs(np.diag(R)) > 1e-9 * np.abs(R).max()):
        return  # unknowns that cannot be told apart: nothing of more can be told
    half = NORMAL_95 * uncertainty.standard_error[free]
    lattice = {o: max(e.quantum(o, e.measured[:, k]) for e in problem.experiments) or 1e-300
               for k, o in enumerate(problem.outputs)}  # fmt: skip
    orders = [k for k, i in enumerate(free) if i in problem.order_indices]
    quarter = min(e.step * swing_period(y) for e in problem.experiments for y in e.measured.T) / 4
    for (code, signal), form in forms:
        z = weight * joined(form)
        own = z - Q @ (Q.T @ z)
        power = float(own @ own)
        if power <= OWN**2 * float(z @ z):
            continue
        size = -float(own @ e) / power
        residual = e + size * own
        change = -np.linalg.solve(R, Q.T @ (size * z))
        ends = x[free[orders]] + change[orders]
        # Further than an order can be no linear step goes.
        far = np.any((ends < problem.space.lower[free[orders]]) | (ends > problem.space.upper[free[orders]]))
        if far or (code == "late" and abs(size) > quarter):
            continue
        k = max(orders, key=lambda k: abs(change[k]) / half[k], default=None)
        yield Misreading(
            code, signal, size, abs(size) * power / _scatter(residual * own, len(problem.outputs)),
            share=1 - float(residual @ residual) / float(e @ e),
            moves="" if k is None else problem.unknowns[free[k]].target, shift=0.0 if k is None else float(change[k]),
            half_intervals=0.0 if k is None else float(abs(change[k]) / half[k]),
            steps=2 * abs(size) * max(float(np.max(np.abs(f))) for f in form) / lattice.get(signal, 1e-300),
        )  # fmt: skip


def _scatter(products: FloatArray, outputs: int) -> float:
    """The standard deviation of their sum, as it would be over other noise of the same correlation time."""
    scores = products.reshape(-1, outputs).sum(axis=1)[:, None]
    return max(1e-300, math.sqrt(float(bartlett_long_run(scores, sokal_bandwidth(scores))[0, 0])))


# --- the forms ------------------------------------------------------------------------------------------


def _rate(e: Experiment, y: FloatArray) -> FloatArray:
    return np.asarray(np.gradient(y, e.step if e.times is None else e.times))


def _direction(e: Experiment, y: FloatArray) -> FloatArray:
    rate = _rate(e, y)
    return np.asarray(0.5 * np.sign(rate) * (np.abs(rate) > 1e-3 * np.abs(rate).max()))


FORMS: dict[str, Callable[[Experiment, FloatArray], FloatArray]] = {
    "late": _rate,
    "scaled": lambda e, y: np.asarray(-y),  # noqa: ARG005
    "off-zero": lambda e, y: np.full(len(y), -1.0),  # noqa: ARG005
    "drifts": lambda e, y: -e.time / e.time[-1],  # noqa: ARG005
    "play": _direction,
}
"""Code → z of an output, of the simulated samples."""


Form = tuple[tuple[str, str], list[FloatArray]]
"""((code, signal), z of each recording, shape (n_samples, n_outputs))."""


def _forms(problem: Problem, x: FloatArray) -> list[Form] | None:
    """Those of each signal; None where a run fails."""
    fitted = [problem.fitted(x, e) for e in problem.experiments]
    if any(isinstance(y, Failure) for y in fitted):
        return None
    of_one = np.eye(len(problem.outputs))
    forms = [
        ((code, output), [np.outer(form(e, np.asarray(y)[:, k]), of_one[k])
                          for e, y in zip(problem.experiments, fitted, strict=True)])
        for k, output in enumerate(problem.outputs) for code, form in FORMS.items()
    ]  # fmt: skip
    return [*forms, *_forms_of_inputs(problem, x)]


def _forms_of_inputs(problem: Problem, x: FloatArray) -> Iterator[Form]:
    """All inputs that vary a sample later, and each a little lower, by the actuator that makes them so."""
    model, moved = problem.model, np.max([np.ptp(e.inputs, axis=0) for e in problem.experiments], axis=0).tolist()
    varied = {n: NUDGE * far for n, far in zip(model.inputs, moved, strict=True) if far > 0.0}
    faults = [("late", "delay", [*varied], 0.0)] * bool(varied)
    faults += [("off-zero", "bias", [n], size) for n, size in varied.items() if n not in model.input_rates]
    was = problem.errors(x)
    for code, quantity, names, size in faults:
        changed = tuple(_actuated(e, names, quantity, -size or e.step) for e in problem.experiments)
        errors = replace(problem, experiments=changed, memo=None).errors(x)
        if not isinstance(errors, Failure) and not isinstance(was, Failure):
            each = zip(problem.experiments, errors, was, strict=True)
            yield (code, names[0]), [(y - z) / (size or e.step) for e, y, z in each]


def _actuated(e: Experiment, names: Iterable[str], quantity: str, by: float) -> Experiment:
    """The inputs moved; by a quantity that is free its unknown does so."""
    actuators = {n: (s := e.actuators.get(n, Sensor()), getattr(s, quantity)) for n in names}
    moved = {n: replace(s, **{quantity: at + by}) for n, (s, at) in actuators.items() if not isinstance(at, Free)}
    return replace(e, actuators={**e.actuators, **moved})


# --- the sentences --------------------------------------------------------------------------------------


def _size(problem: Problem, m: Misreading) -> str:
    size, code = abs(m.size), "late-input" if m.code == "late" and m.signal in problem.model.inputs else m.code
    less, more = {"late": ("early", "late"), "late-input": ("earlier", "later")}.get(code, ("small", "large"))
    far = with_unit(size, {**problem.experiments[0].units, **problem.model.input_units}.get(m.signal, "rad"))
    return SAYS(code, ms=1e3 * size, percent=100 * size, far=far, which=more if m.size > 0 else less)


def _fix(problem: Problem, m: Misreading) -> str:
    model, far = problem.model, 3 * abs(m.size)
    rests = m.signal == model.pendulum and all(
        tail(e.measured[:, problem.outputs.index(m.signal)])[2] for e in problem.experiments
    )
    zero = 'Type zero = "rest"' if rests else "Look at zero"
    rest = f"free {own}" if (own := model.rest_of(m.signal)) else SAYS("bias", least=-far, most=far)
    return SAYS(f"fix-{m.code}", least=-far, most=far, zero=zero, rest=rest)
