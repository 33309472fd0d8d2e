"""The posterior of a fit: what :func:`fracid.posterior` does."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from fracid.arrays import FloatArray
from fracid.bayes.laplace import importance_sample, log_mass_about
from fracid.bayes.nested import nested_sample
from fracid.bayes.result import METHODS, Posterior
from fracid.bayes.target import SAYS, RecordedLikelihood, approximation, calibrated, joint_prior
from fracid.errors import InputError, at_least, refuse_unknown
from fracid.estimation.covariance import at_bound
from fracid.estimation.fit_figures import FitPictures
from fracid.estimation.long_records import as_fitted
from fracid.problem import Problem
from fracid.problem.project import Project
from fracid.solver.trajectory import vector
from fracid.tasks.display import counted
from fracid.tasks.job import Progress
from fracid.tasks.journal import Journal
from fracid.tasks.tasks import Execution

DRAWS = 2000
"""Of an importance sample, if no number is given."""

SAME = 0.05
"""A fit whose log likelihood is less by no more than this is the minimum."""

APART = 3.0
"""Another minimum that is further, in standard deviations, than this is one of its own."""

NEAR = 10.0
"""A minimum whose log likelihood is less by more than this plays no part in a posterior."""


@counted("simulations")
def posterior(
    problem: Problem | Project | FitPictures,
    x: FloatArray | None = None,
    *,
    method: str = "laplace",
    draws: int = DRAWS,
    seed: int = 1,
    jobs: int = 1,
    executor: str = "threads",
    journal: Journal | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> Posterior:
    """Draw the free parameters from their posterior, and compute the evidence of the model.

    The likelihood is as informative as the sandwich says, and the priors are those of the project: its bounds, and
    ``prior`` where it has one.

    Parameters
    ----------
    problem : Problem, Project, Fit or SavedRun
    x : array, shape (n_unknowns,), optional
        The minimum of its cost; a fit's own, or the problem's start, if left out.
    method : {"laplace", "nested"}
        Laplace's approximation corrected by importance sampling: seconds, and k̂ says whether to trust it.  Nested
        sampling: minutes, for bent posteriors and those of several peaks; it needs ``pip install 'fracid[posterior]'``.
    draws : int
        Simulations of the importance sample, or effective draws of nested sampling.
    seed : int
        Random seed.
    jobs : int
        Threads or processes; the result is the same for any number.
    executor, journal, progress
        As for :func:`fracid.run_tasks`; nested sampling runs on threads.

    Returns
    -------
    Posterior

    Raises
    ------
    InputError
        If nothing is free, the cost is a user's own, a run fails at the minimum, or an option is not possible.
    Unfinished
        As :func:`fracid.run_tasks`.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment, Free
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=5e-3, end=2.0)
    >>> noise = 1e-3 * np.random.default_rng(1).standard_normal((401, 2))
    >>> swing = Experiment("twin", 5e-3, run.states[:, [0, 2]] + noise, np.zeros((1, 1)), initial={"alpha": 0.3})
    >>> problem = Problem(rig, (swing,), {"lambda": Free(0.9, 0.5, 1.2), "mu": Free(0.95, 0.5, 1.2)},
    ...                   initial_state="held")
    >>> drawn = posterior(problem, draws=400)
    >>> low, high = drawn.interval("mu")
    >>> drawn.trusted, low < 0.95 < high, drawn.log_evidence < 0
    (True, True, True)
    """
    starts = getattr(problem, "starts", ())
    if not isinstance(problem, Problem):
        x = getattr(problem, "x", None) if x is None else x
        problem = problem.problem
    refuse_unknown("method", METHODS, method)
    at_least("jobs", jobs, 1)
    likelihood, notes = calibrated(problem, problem.start if x is None else vector("x", x), jobs=jobs)
    if x is not None and not problem.priors:  # with priors its point is not the data's minimum
        rise = -likelihood.log_likelihoods(vector("x", x)[None])[0]
        notes += (SAYS("not-at-minimum", rise=rise),) if rise > SAME else ()
    notes += _other_minima(problem, likelihood, [s.end for s in starts] if isinstance(starts, tuple) else [])
    prior, how = joint_prior(problem), {"draws": draws, "seed": seed}
    execution, unbounded = Execution(executor, jobs, journal, progress), [problem.names[i] for i in prior.unbounded]
    if unbounded and method == "nested":
        raise InputError(SAYS("no-bounds", unbounded=" and ".join(unbounded)))
    bounded = at_bound(as_fitted(problem, likelihood.centre), likelihood.centre, jobs=jobs)
    shape = approximation(likelihood, prior, bounded)
    if method == "nested":
        sample = nested_sample(likelihood, prior, **how, execution=execution)
        sample = replace(sample, log_mass=log_mass_about(likelihood, prior, shape, seed=seed, execution=execution))
    else:
        names = " and ".join(problem.names[i] for i in np.flatnonzero(bounded))
        notes += (f"At a bound, and drawn from there inwards: {names}.",) * bool(names)
        sample = importance_sample(likelihood, prior, shape, **how, execution=execution)
        sample = replace(sample, log_evidence=math.nan) if unbounded else sample
    return Posterior(
        **vars(sample), problem=problem, method=method, x=likelihood.centre, cost=likelihood.cost, seed=seed,
        effective_samples=likelihood.samples, degrees_of_freedom=likelihood.degrees, notes=notes,
    )  # fmt: skip


def _other_minima(problem: Problem, likelihood: RecordedLikelihood, ends: list[Mapping[str, float]]) -> tuple[str, ...]:
    """That the search has seen another minimum of a similar cost: draws about one of two do not show it."""
    for end in (np.array([values.get(n, math.nan) for n in problem.names]) for values in ends):
        delta = end - likelihood.centre
        distance = math.sqrt(float(delta @ likelihood.precision @ delta) / len(delta))
        nats = -likelihood.log_likelihoods(end[None])[0] if distance > APART else math.inf
        if nats < NEAR:
            return (SAYS("another-minimum", distance=distance, nats=nats),)
    return ()


class WithPosterior(FitPictures):
    """What a fit can draw its parameters by, besides its pictures."""

    def posterior(self, *, method: str = "laplace", draws: int = DRAWS, seed: int = 1, jobs: int = 1) -> Posterior:
        """Draw the free parameters from their posterior; see :func:`fracid.posterior`.

        Parameters
        ----------
        method, draws, seed, jobs
            As of :func:`fracid.posterior`.
        """
        return posterior(self, method=method, draws=draws, seed=seed, jobs=jobs)
