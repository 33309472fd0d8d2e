r"""How far something small pulls the unknowns of a minimum: projected on them by the Jacobian.

Near the minimum of :math:`\sum_t w_t\,ρ(e_t(x))` the rows :math:`R_t = \sqrt{w_t ρ''}\,\partial e_t/\partial x` give
its curvature :math:`A = R'R` (priors add theirs), and what changes the errors by :math:`δe` moves the minimum by

.. math::  δx = -A^{-1} R'\,\sqrt{wρ''}\,δe .

**A start that is taken from a sample** has its noise.  With ``initial_state = "held"`` the run starts where the first
sample says, :math:`x_0 = y_0 + ε`, and all that it simulates is off by :math:`(\partial y/\partial x_0)\,ε`.  That is
no noise of samples but one error over the whole record, so no interval knows of it.  With :math:`R_0` the rows of
:math:`x_0`, and S the covariance of its noise,

.. math::  \mathrm{cov}\,δx = G\,S\,G', \qquad G = A^{-1} R' R_0 .

For white noise the interval shrinks as :math:`1/\sqrt n` with n samples, and δx does not.  ``measured`` takes the speed
from the samples as well: the slope of a parabola through the first of them, :math:`v'y`, whose noise goes with that of
:math:`y_0`: :math:`S = σ^2 \begin{pmatrix} 1 & v_0 \\ v_0 & v'v \end{pmatrix}`.

**A search that stops in a valley** has come to where its steps gain next to nothing, and that may be far from where the
valley is lowest.  With the gradient g of the cost, central differences in place of the search's forward ones, the
minimum of the parabola is a Newton step away,

.. math::  p = -A^{-1} g ,

zero at a minimum whatever A is.  How long it is in CI half-widths is the Newton decrement, unknown by unknown [BV]_.
The parabola need not hold that far, so the cost is asked: of :math:`x + fp` with f = 1, ½, ¼, ⅛ the lowest counts.

References
----------
.. [BV] S. Boyd, L. Vandenberghe, Convex Optimization (2004), 9.5.1: the Newton decrement.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fracid.arrays import FloatArray
from fracid.errors import Failure, FailureReason
from fracid.estimation.block_covariance import normal_equations, scores_in, summed
from fracid.estimation.derivatives import by_blocks, jacobian, row_weights, slopes_of
from fracid.problem import Problem
from fracid.problem.unknowns import InitialState

LOOSER: dict[str, InitialState] = {"held": "rest", "measured": "estimate"}
"""What takes the start from samples, and what finds it instead."""

FRACTIONS = (1.0, 0.5, 0.25, 0.125)
"""Of the Newton step, of which the cost is asked."""

LOWER = 1e-9
"""A cost that is lower by less than this part is lower by rounding."""


class Curvature(NamedTuple):
    """The cost next to its minimum: a parabola over the unknowns that no bound holds."""

    free: NDArray[np.intp]
    """Which, shape (n_free,)."""
    inverse: FloatArray
    """A⁻¹, the pseudo-inverse where J is blind, shape (n_free, n_free)."""
    gradient: FloatArray
    """g, of the priors too, shape (n_free,)."""


def curvature(problem: Problem, x: FloatArray, free: NDArray[np.intp], *, jobs: int = 1) -> Curvature | Failure:
    """Find A⁻¹ and g of the unknowns `free`, or say that there are none or why a run fails.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment, Free, Problem
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=4e-3, end=3.0)
    >>> swing = Experiment("twin", 4e-3, run.states[:, [0, 2]], np.zeros((1, 1)))
    >>> problem = Problem(rig, (swing,), {"lambda": 0.9, "mu": Free(0.951, 0.5, 1.2)}, initial_state="held")
    >>> found = curvature(problem, problem.start, np.array([0]))
    >>> (0.951 - found.inverse @ found.gradient).round(4)               # back to 0.95
    array([0.95])
    """
    if not len(free):
        return Failure(FailureReason.NOTHING_FREE, "nothing is free")
    J = by_blocks(problem, x, free, jobs=jobs)
    if isinstance(J, Failure):
        return J
    near, criterion = normal_equations(problem, J, free), problem.criterion
    off = np.array([x[i] - criterion.priors[i].mean if i in criterion.priors else 0.0 for i in free.tolist()])
    loosened = 1 + float(np.sum(criterion.prior_residuals(x) ** 2)) / criterion.prior_samples
    scores = scores_in(near.norm, J, slopes_of(problem, J.errors))
    pull = summed(J.blocks, [s.sum(axis=0) for s in scores]) + near.prior * near.norm * off / loosened
    return Curvature(free, near.bread.inverse / np.outer(near.norm, near.norm), near.norm * pull)


def newton_step(problem: Problem, x: FloatArray, parabola: Curvature) -> tuple[FloatArray, float]:
    """Find how far the minimum is, by a Newton step of which the cost is asked.

    Parameters
    ----------
    problem : Problem
    x : array, shape (n_unknowns,)
        Where a search ended.
    parabola : Curvature
        There.

    Returns
    -------
    step : array, shape (n_unknowns,)
        To the lowest of the points that were asked, within the bounds; 0 where none is lower.
    cost : float
        There.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment, Free, Problem
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=4e-3, end=3.0)
    >>> swing = Experiment("twin", 4e-3, run.states[:, [0, 2]], np.zeros((1, 1)))
    >>> problem = Problem(rig, (swing,), {"lambda": 0.9, "mu": Free(0.951, 0.5, 1.2)}, initial_state="held")
    >>> step, cost = newton_step(problem, problem.start, curvature(problem, problem.start, np.array([0])))
    >>> step.round(4), cost < 0.1 * problem.cost(problem.start)
    (array([-0.001]), True)
    """
    whole = np.zeros(len(x))
    whole[parabola.free] = -parabola.inverse @ parabola.gradient
    here = problem.cost(x)
    ends = [problem.space.clipped(x + f * whole) for f in FRACTIONS]
    cost, end = min(((problem.cost(y), y) for y in ends), key=lambda pair: pair[0])
    return (end - x, cost) if cost < (1 - LOWER) * here else (np.zeros(len(x)), here)


def start_shift(
    problem: Problem, x: FloatArray, parabola: Curvature, noise: dict[str, FloatArray], *, jobs: int = 1
) -> FloatArray | None:
    """Find how far the noise of the samples that the start is taken from moves the unknowns.

    Parameters
    ----------
    problem : Problem
        Whose initial state is one of :data:`LOOSER`.
    x : array, shape (n_unknowns,)
        Its minimum.
    parabola : Curvature
        There.
    noise : dict
        Recording → standard deviation of its outputs' noise [rad], shape (n_outputs,).
    jobs : int
        Threads.

    Returns
    -------
    array, shape (n_unknowns,), or None
        One standard deviation, 0 where a bound holds; None where every start is found, named or has a past.

    Examples
    --------
    A pendulum that was released at 0.3 rad, or was it 0.301?

    >>> import fracid
    >>> from fracid.problem import Experiment, Free, Problem
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=4e-3, end=3.0)
    >>> def shift(**options):
    ...     swing = Experiment("twin", 4e-3, run.states[:, [0, 2]], np.zeros((1, 1)), **options)
    ...     problem = Problem(rig, (swing,), {"lambda": 0.9, "mu": Free(0.95, 0.5, 1.2)}, initial_state="held")
    ...     found = curvature(problem, problem.start, np.array([0]))
    ...     return start_shift(problem, problem.start, found, {"twin": np.array([0.0, 1e-3])})
    >>> bool(3e-5 < shift()[0] < 3e-3), shift(initial={"theta": 0.0, "alpha": 0.3})
    (True, None)
    """
    errors = problem.errors(x)
    if isinstance(errors, Failure):
        return None
    values, variances = problem.named(x), list[FloatArray]()
    for e, weight in zip(problem.experiments, row_weights(problem, errors), strict=True):
        # its start moves no other
        alone = replace(problem, initial_state=LOOSER[problem.initial_state], experiments=(e,))
        started = [i for i, u in enumerate(alone.unknowns) if u.kind == "initial" and u.target not in e.initial]
        if e.past is not None or not started:
            continue
        point = alone.point(values)  # the same run, the same errors
        names = [problem.names[i] for i in parabola.free]
        own = {k: alone.names.index(name) for k, name in enumerate(names) if name in alone.names}
        J = jacobian(alone, point, np.array([*own.values(), *started]), jobs=jobs)
        if isinstance(J, Failure):
            return None
        rows = (weight[..., None] * J[0]).reshape(-1, len(own) + len(started))
        G = parabola.inverse[:, list(own)] @ rows[:, : len(own)].T @ rows[:, len(own) :]
        variances.append(np.einsum("ij,jk,ik->i", G, _covariance(alone, started, noise[e.name]), G))
    if not variances:
        return None
    shift = np.zeros(len(x))
    shift[parabola.free] = np.sqrt(sum(variances))
    return shift


def _covariance(problem: Problem, initial_indices: list[int], noise: FloatArray) -> FloatArray:
    """S of the one recording's starts that are taken from samples, shape (n_started, n_started).

    Each is f'y of its signal's first samples, f shape (n_outputs, n_slope).
    """
    model, weights = problem.model, problem.experiments[0].slope_weights
    states = {o: model.states[i] for o, i in model.output_states.items()}
    outputs = {states[o]: k for k, o in enumerate(problem.outputs) if o in states}
    rates = {model.states[j]: outputs[model.states[i]] for i, j in problem.rates.items()}
    F = np.zeros((len(initial_indices), len(problem.outputs), len(weights)))
    for f, target in zip(F, (problem.unknowns[i].target for i in initial_indices), strict=True):
        k = (outputs | rates)[target]
        f[k] = noise[k] * (weights if target in rates else np.eye(1, len(weights))[0])
    return np.asarray(np.einsum("iok,jok->ij", F, F))
