r"""What the noise of recorded inputs adds to intervals.

A simulation takes its inputs as exact.  The noise of one that a sensor has recorded, a torque or a current, shakes the
simulated rig, and that is a slow motion: of what it does a fit takes up the most, and what it leaves hides beneath the
noise of the outputs, so the residuals tell little of it (of a lightly damped rig the true values lay 8 half-widths
away, of a residual that nobody would call coloured).

:func:`with_input_noise` shakes the inputs anew, by as much as their differences say (:func:`input_noise`).  The errors
change by Δ, the minimum by :math:`-A^{-1}J'Δ`, and the mean square of that over some draws is what the noise adds to
the variance of independent residuals; where the intervals are as wide already, as the residual shows it, they stay.
An exact input that changes as fast as noise, a random command, shakes nothing.  So its noise is no more than the
spectrum of the residual allows: white noise σ² and a part s of what is left of Δ beside the parameters, of spectrum P,
with the largest s up to 1 of which Whittle's likelihood, :math:`-\sum \log(σ^2 + sP) + R/(σ^2 + sP)` of the residual's
spectrum R, is within 1.92 of the best.  A residual that :math:`1/\sqrt{1 + sP/σ^2}` makes white, with s = 1, is
correlated by that noise, and not by what the model lacks.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import compress

import numpy as np

from fracid.arrays import FloatArray, joined
from fracid.errors import SMALLEST, Failure
from fracid.estimation.covariance import Known
from fracid.estimation.long_records import is_coarse
from fracid.estimation.tangent import Tangent, tangent
from fracid.problem import Experiment, Problem

DRAWS = 64
"""From which a standard deviation is known to a tenth, and a spectrum to an eighth."""

DIFFERENCES = range(2, 6)
"""White noise is the same in differences of every order; of a motion those shrink."""

NEGLIGIBLE = 3e-5
"""Of an input's range: commands of a slow curve scatter by a tenth of that."""

PARTS = (0.0, *np.geomspace(1e-6, 1.0, 61).tolist())
"""Of the noise that differences show."""


def input_noise(samples: FloatArray) -> float:
    """The noise of most samples of an input, by the order of differences that shows the least; 0 of one held or few.

    Examples
    --------
    >>> t = np.arange(1000) / 50
    >>> round(input_noise(np.sin(6 * t) + 0.01 * np.random.default_rng(1).standard_normal(1000)), 3)
    0.01
    >>> input_noise(np.floor(t))
    0.0
    """
    if len(samples) <= max(DIFFERENCES):
        return 0.0
    steps = (np.median(np.abs(np.diff(samples, k))) / math.sqrt(math.comb(2 * k, k)) for k in DIFFERENCES)
    level = float(min(steps)) / 0.6745
    return level if level > NEGLIGIBLE * np.ptp(samples) else 0.0


def noisy_inputs(problem: Problem) -> tuple[str, ...]:
    """Those whose samples scatter in some recording.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment, Problem
    >>> push = np.random.default_rng(1).standard_normal((99, 1))
    >>> driven = Experiment("driven", 0.01, np.zeros((99, 1)), push)
    >>> noisy_inputs(Problem(fracid.model("oscillator"), (driven,), {"mu": 1.0}))
    ('force',)
    """
    scatter = np.any([_levels(problem, e) for e in problem.experiments], axis=0)
    return tuple(n for n, noisy in zip(problem.model.inputs, scatter, strict=True) if noisy)


def with_input_noise(
    problem: Problem, x: FloatArray, known: Known, *, near: Tangent | None = None, jobs: int = 1
) -> Known:
    """The intervals with what the noise of inputs adds to them.

    Parameters
    ----------
    problem : Problem
    x : array, shape (n_unknowns,)
        Its minimum.
    known : Uncertainty or Failure
        There, of inputs that are exact.
    near : Tangent, optional
        There; asked for if left out.
    jobs : int
        Threads.

    Examples
    --------
    A mass on a spring that is pushed for 20 s, and how much wider the interval of its order is for the noise of a load
    cell, 3 % of the force:

    >>> import fracid
    >>> from fracid.estimation.covariance import uncertainty
    >>> from fracid.estimation.minimum import settled
    >>> from fracid.problem import Experiment, Free, Problem
    >>> t, rng = np.arange(1000) / 50, np.random.default_rng(1)
    >>> push = np.sin(2 * t + 0.2 * t**2)[:, None]
    >>> rig = fracid.model("oscillator", m=1.0, k=40.0, b_displacement=0.4)
    >>> run = fracid.simulate(rig, orders={"mu": 1.0}, initial={}, inputs=push, step=0.02, end=t[-1])
    >>> moved = run.states[:, :1] + 1e-3 * rng.standard_normal((1000, 1))
    >>> def wider(noise):
    ...     cell = push + noise * rng.standard_normal((1000, 1))
    ...     problem = Problem(rig, (Experiment("pushed", 0.02, moved, cell),), {"mu": Free(1.0, 0.5, 1.2)})
    ...     here = settled(problem, problem.start)
    ...     known = uncertainty(problem, here.x, near=here)
    ...     found = with_input_noise(problem, here.x, known, near=here)
    ...     return round(float((found.standard_error / known.standard_error)[0]), 1)
    >>> wider(0.0), wider(0.03)
    (1.0, 6.0)
    """
    if isinstance(known, Failure) or (found := shaken(problem, x, near=near, jobs=jobs)) is None:
        return known
    missing = np.maximum(0.0, known.white**2 + found[0] - known.standard_error**2)
    return known.wider(problem.space, x, np.sqrt(missing))


def shaken(
    problem: Problem, x: FloatArray, *, near: Tangent | None = None, jobs: int = 1
) -> tuple[FloatArray, list[FloatArray]] | None:
    """The variance that the noise of inputs adds to each unknown, and the residuals without the spectrum of its own.

    Returns
    -------
    tuple of array, shape (n_unknowns,), and a list of arrays, shape (n_samples, n_outputs)
        None of these where less is allowed than differences show: an exact command that looks like noise excuses no
        residual.  None at all where no input is noisy, a run fails, or it cannot be asked.
    """
    cannot = is_coarse(problem) or problem.blocks is not None or problem.cost_function.loss is None
    here = None if cannot or not noisy_inputs(problem) else near or tangent(problem, x, jobs=jobs)
    if here is None or isinstance(here, Failure):
        return None
    rows, shifts, left = here.rows[:, :-1], [], []
    for rng in np.random.default_rng(1).spawn(DRAWS):
        noisy = [replace(e, inputs=e.inputs + _levels(problem, e) * rng.standard_normal(e.inputs.shape))
                 for e in problem.experiments]  # fmt: skip
        errors = replace(problem, experiments=tuple(noisy), memo=None).errors(x)
        if isinstance(errors, Failure):
            return None
        shifts.append(np.linalg.lstsq(rows, here.pulls(here.errors, x) - here.pulls(errors, x))[0])
        left.append([_power(e - was + J @ shifts[-1])
                     for e, was, J in zip(errors, here.errors, here.derivatives, strict=True)])  # fmt: skip
    white = [np.median(_power(e), axis=0) / math.log(2.0) + SMALLEST for e in here.errors]
    spectra = [np.mean(draws, axis=0) / w for *draws, w in zip(*left, white, strict=True)]
    part = _part(joined(spectra), joined(_power(e) / w for e, w in zip(here.errors, white, strict=True)))
    whitened = [np.fft.irfft(np.fft.rfft(e, axis=0) / np.sqrt(1 + part * P), len(e), axis=0)
                for e, P in zip(here.errors, spectra, strict=True) if part == PARTS[-1]]  # fmt: skip
    return part * np.mean(np.square(shifts), axis=0), whitened


def _levels(problem: Problem, e: Experiment) -> FloatArray:
    """Of each input; 0 of the rates that are made of others, whose noise is theirs."""
    names = problem.model.inputs
    return np.array([0.0 if n in problem.model.input_rates else input_noise(u)
                     for n, u in zip(names, e.inputs.T, strict=True)])  # fmt: skip


def _power(errors: FloatArray) -> FloatArray:
    return np.asarray(np.abs(np.fft.rfft(errors, axis=0)) ** 2)


def _part(shaken: FloatArray, residual: FloatArray) -> float:
    """The largest s, up to 1, that the residual's spectrum allows, where white noise has 1."""
    costs = [float(np.sum(np.log(1 + s * shaken) + residual / (1 + s * shaken))) for s in PARTS]
    return float(max(compress(PARTS, np.array(costs) < min(costs) + 1.92)))
