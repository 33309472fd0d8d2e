r"""How well a model does where the noise is correlated: by the likelihood of what an autoregression leaves of it.

A sum of squares weighs each frequency alike, and coloured noise is strong at some and faint at others.  So two models
whose sums are next to each other may be far apart where the noise is faint, and constants that were fitted to the sum
are not those of the least likelihood.  With :math:`\varepsilon_t = e_t - \sum_k \varphi_k e_{t-k}`, the filter φ found
of each output's residual (:mod:`fracid.signals.coloured`), the unknowns are fitted to ε once more [1]_, and

.. math::  \mathrm{BIC} = \sum_o n_o \ln \tfrac{1}{n_o} \sum_t \varepsilon_{o,t}^2 + k \ln n .

Each model has a filter of its own: one that lacks something has its lack in the filter too, which helps it, and not the
model that it is held against.

The filter takes away the noise and leaves a solver's error where an input jumps, which least squares do not see: at a
step that is short enough for these, three relaxations may come 64 below the order that made the recording, and 84 above
it at a quarter of the step.  So steps are halved until that moves ε by no more than chance moves −2 log L.

References
----------
.. [1] D. Cochrane, G. Orcutt, J. American Statistical Association 44 (1949) 32.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import chain

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import Failure
from fracid.estimation.derivatives import jacobian
from fracid.problem import Problem
from fracid.problem.costs import COSTS
from fracid.signals.coloured import whitened, whitening_filter

ROUNDS = 2
"""Filters of a residual, and fits to what they leave."""

RUNS = 12
"""Of one fit, which begins at the least squares: it has not far to go."""

FAR = 1e6
"""Residuals of a run that fails."""

MOVED = 0.1
"""Σ (Δε/σ)² that a halved step may make: −2 log L moves by twice its root."""

FINEST = 64
"""Steps a sample, at most."""

Signals = list[FloatArray]
"""Of each recording, shape (n_samples, n_outputs)."""

Filters = list[list[FloatArray]]
"""Of each recording and output."""


def criterion(problem: Problem, x: FloatArray, parameters: int) -> float | None:
    """BIC, up to what all models of the same recordings have in common.

    None where it cannot be had: of costs that are no mean square, of records with gaps, and of recordings with so many
    unknowns of their own that these are searched apart.

    Parameters
    ----------
    problem : Problem
    x : array, shape (n_unknowns,)
        Its minimum.
    parameters : int
        k.

    Examples
    --------
    A body that cools, and a residual that fades over ten samples.  Of each sample counts what is new, ln 0.01²:

    >>> from scipy.signal import lfilter
    >>> from fracid.models import Model, Parameter
    >>> from fracid.problem import Experiment, Free
    >>> def body(t, x, u, p, out):
    ...     out[0] = (u[0] - p[0] * x[0]) / 2
    >>> model = Model("body", body, ("T",), (1.0,), {"T": 0}, ("power",), (Parameter("h", "W/K", 0.5, "loss"),), "", "")
    >>> noise = lfilter([1.0], [1.0, -0.9], np.random.default_rng(1).standard_normal(2000))
    >>> warm = 2 - 2 * np.exp(-0.25 * np.arange(2000) / 100) + 0.01 * noise
    >>> record = Experiment("warm", 0.01, warm[:, None], np.ones((1, 1)), initial={"T": 0.0})
    >>> problem = Problem(model, (record,), {}, {"h": Free(0.4, 0.0, 5.0)}, initial_state="held")
    >>> round(criterion(problem, problem.start, 1) / 2000, 1)
    -9.2
    """
    gaps = any(not np.all(e.scored) or e.deviation is not None for e in problem.experiments)
    apart = problem.blocks is not None or problem.priors
    errors = problem.errors(x)
    if gaps or apart or problem.cost_function != COSTS["rmse"] or isinstance(errors, Failure):
        return None
    for _ in range(ROUNDS):
        filters = [[whitening_filter(e)[0] for e in recording.T] for recording in errors]
        problem, errors = _stepped(problem, x, errors, filters)
        x = _fitted(problem, x, errors, filters)
        errors = problem.errors(x)
        assert not isinstance(errors, Failure)  # else least squares would not have come here
    outputs = [np.concatenate(ε) for ε in zip(*_innovations(errors, filters), strict=True)]
    samples = sum(ε.size for ε in outputs)
    return sum(ε.size * math.log(np.mean(ε**2)) for ε in outputs) + parameters * math.log(samples)


def _innovations(signals: Signals, filters: Filters) -> list[list[FloatArray]]:
    """ε of each recording and output, or its derivatives."""
    return [[whitened(s[:, o], φ) for o, φ in enumerate(own)] for s, own in zip(signals, filters, strict=True)]


def _stepped(problem: Problem, x: FloatArray, errors: Signals, filters: Filters) -> tuple[Problem, Signals]:
    """The problem in steps that ε does not see, and its errors."""
    while problem.substeps < FINEST:
        finer = replace(problem, substeps=2 * problem.substeps, memo=None)
        found = finer.errors(x)
        if isinstance(found, Failure) or _moved(errors, found, filters) < MOVED:
            break
        problem, errors = finer, found
    return problem, errors


def _moved(errors: Signals, found: Signals, filters: Filters) -> float:
    """Σ (Δε/σ)² between the errors of two steps."""
    moved = _innovations([b - a for a, b in zip(errors, found, strict=True)], filters)
    pairs = zip(chain.from_iterable(moved), chain.from_iterable(_innovations(found, filters)), strict=True)
    return sum(float(d @ d) / float(np.mean(ε**2)) for d, ε in pairs)


def _fitted(problem: Problem, x: FloatArray, errors: Signals, filters: Filters) -> FloatArray:
    """The unknowns at the least squares of ε, each output's by its own level."""
    from scipy.optimize import least_squares

    levels = [np.std(ε) for own in _innovations(errors, filters) for ε in own]

    def rows(signals: Signals) -> FloatArray:
        left = (ε for own in _innovations(signals, filters) for ε in own)
        return np.concatenate([ε / level for ε, level in zip(left, levels, strict=True)])

    def residual(x: FloatArray) -> FloatArray:
        found = problem.errors(x)
        return np.full(size, FAR) if isinstance(found, Failure) else rows(found)

    def derivatives(x: FloatArray) -> FloatArray:
        found = jacobian(problem, x, np.arange(len(x)))
        return np.zeros((size, len(x))) if isinstance(found, Failure) else rows(found)

    size, bounds = len(rows(errors)), (problem.space.lower, problem.space.upper)
    return np.asarray(least_squares(residual, x, derivatives, bounds, x_scale="jac", max_nfev=RUNS).x)
