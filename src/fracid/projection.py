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
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fracid.problem import InitialState, Problem
from fracid.uncertainty import Sandwich, jacobian, rows_and_scores

__all__ = ["LOOSER", "start_shift"]

FloatArray = NDArray[np.float64]

LOOSER: dict[str, InitialState] = {"held": "rest", "measured": "estimate"}
"""What takes the start from samples, and what finds it instead."""


def start_shift(
    problem: Problem, x: FloatArray, found: Sandwich, noise: dict[str, FloatArray], *, jobs: int = 1
) -> FloatArray | None:
    """Find how far the noise of the samples that the start is taken from moves the unknowns.

    Parameters
    ----------
    problem : Problem
    x : array, shape (n_unknowns,)
        Its minimum.
    found : Sandwich
        Its curvature there, over the unknowns that no bound holds.
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
    >>> from fracid.uncertainty import sandwich
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=4e-3, end=3.0)
    >>> def shift(**options):
    ...     swing = Experiment("twin", 4e-3, run.states[:, [0, 2]], np.zeros((1, 1)), **options)
    ...     problem = Problem(rig, (swing,), {"lambda": 0.9, "mu": Free(0.95, 0.5, 1.2)}, initial_state="held")
    ...     found = sandwich(problem, problem.start, np.array([0]))
    ...     return start_shift(problem, problem.start, found, {"twin": np.array([0.0, 1e-3])})
    >>> bool(3e-5 < shift()[0] < 3e-3), shift(initial={"theta": 0.0, "alpha": 0.3})
    (True, None)
    """
    if problem.initial_state not in LOOSER:
        return None
    looser = replace(problem, initial_state=LOOSER[problem.initial_state])
    has_past = {e.name for e in problem.experiments if e.past is not None}
    started = [i for i, u in enumerate(looser.unknowns) if u.kind == "initial" and u.experiment not in has_past]
    if not started:
        return None
    values = dict(zip(problem.names, x.tolist(), strict=True))
    point = np.array([values.get(u.name, u.range.start) for u in looser.unknowns])  # the same run, so the same errors
    own = [looser.names.index(problem.names[i]) for i in found.free]
    errors, J = looser.errors(point), jacobian(looser, point, np.array([*own, *started]), jobs=jobs)
    if isinstance(errors, str) or isinstance(J, str):
        return None
    rows, _ = rows_and_scores(looser, errors, J)
    G = found.inverse @ rows[:, : len(own)].T @ rows[:, len(own) :]
    shift = np.zeros(len(x))
    shift[found.free] = np.sqrt(np.einsum("ij,jk,ik->i", G, _covariance(looser, started, noise), G))
    return shift


def _covariance(problem: Problem, started: list[int], noise: dict[str, FloatArray]) -> FloatArray:
    """S of the starts that are taken from samples, shape (n_started, n_started): each is f'y of its signal's first."""
    model, experiments = problem.model, {e.name: e for e in problem.experiments}
    outputs = {model.states[model.outputs[o]]: k for k, o in enumerate(problem.outputs)}
    rates = {model.states[j]: outputs[model.states[i]] for i, j in problem.rates.items()}
    sources, functionals = [], []
    for u in (problem.unknowns[i] for i in started):
        assert u.experiment is not None
        e, k = experiments[u.experiment], (outputs | rates)[u.target]
        v = e.slope_weights if u.target in rates else np.eye(1, len(e.slope_weights))[0]
        sources.append((e.name, k))
        functionals.append(noise[e.name][k] * v)
    return np.array([[float(f @ g) if a == b else 0.0 for b, g in zip(sources, functionals, strict=True)]
                     for a, f in zip(sources, functionals, strict=True)])  # fmt: skip
