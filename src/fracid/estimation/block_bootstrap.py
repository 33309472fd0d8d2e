r"""What repeating the experiment would give: resampled residuals.

**Moving blocks** [K]_.  A record that might as well have been measured is the fitted one plus residuals drawn again:
blocks of l neighbouring residuals, all outputs together, laid end to end, less their mean at each place in a block, so
that their correlation in time outlives the shuffling.  l is five correlation times (Sokal's window, as in
:mod:`fracid.estimation.covariance`), so that a block's sum knows its scatter to some 10 %.  One Newton step with the
Jacobian of the minimum, :math:`\hat x + A^{-1} \sum_t w_t ρ'(e^*_t) J_t`, fits the model to each such record:
thousands of draws in a second.  A prior is a datum too: its mean is drawn again with its standard deviation.  The draws
see the noise.  How the model bends is seen by profiles (:mod:`fracid.estimation.cost_profile`), and what the noise of a
start does that is taken from the first samples by :func:`fracid.estimation.curvature.start_shift`.

The interval lies between the 2.5 % and 97.5 % quantiles of the draws.  It assumes that the residuals scatter alike all
along the record; the sandwich does not, and where the two differ by much, they do not.

References
----------
.. [K] H. Künsch, Ann. Statist. 17 (1989) 1217.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fracid.arrays import FloatArray
from fracid.cards import CardDisplay
from fracid.errors import Failure, InputError, at_least
from fracid.estimation.covariance import METHODS, at_bound, residual_bandwidth, sandwich
from fracid.estimation.derivatives import jacobian, loss_of, prior_curvature, scores_of, slopes_of
from fracid.estimation.likelihood_record import BootstrapBlock
from fracid.problem import Problem
from fracid.problem.checks import require_free
from fracid.safety.schema import as_json
from fracid.solver.trajectory import vector

FEW_BLOCKS = 20
"""Below so many blocks in all the scatter itself is badly known."""


@dataclass(frozen=True, repr=False)
class Bootstrap(CardDisplay):
    """Draws of the unknowns."""

    names: tuple[str, ...]
    x: FloatArray
    """The minimum, shape (n_unknowns,)."""
    draws: FloatArray
    """Shape (n_draws, n_unknowns)."""
    block: int
    """Length of a block [samples]."""
    warning: str = ""
    """Where there are too few blocks."""

    @property
    def standard_error(self) -> FloatArray:
        """Standard deviation of the draws, shape (n_unknowns,)."""
        return np.asarray(np.std(self.draws, axis=0, ddof=1))

    @property
    def bias(self) -> FloatArray:
        """Mean of the draws less the minimum, shape (n_unknowns,)."""
        return np.asarray(np.mean(self.draws, axis=0) - self.x)

    def interval(self, i: int) -> tuple[float, float]:
        """The 95 % interval of unknown i."""
        low, high = np.quantile(self.draws[:, i], [0.025, 0.975])
        return float(low), float(high)

    def to_json(self) -> dict[str, Any]:
        """Plain JSON values, without the draws."""
        se, bias = self.standard_error.tolist(), self.bias.tolist()
        return as_json(BootstrapBlock, vars(self) | {
            "method": f"{METHODS['bootstrap']}, one-step", "draws": len(self.draws),
            "unknowns": {n: {"standard_error": se[i], "bias": bias[i], "interval95": self.interval(i)}
                         for i, n in enumerate(self.names)},
        })  # fmt: skip


def bootstrap(
    problem: Problem, x: FloatArray, *, draws: int = 400, block: int | None = None, seed: int = 1, jobs: int = 1
) -> Bootstrap:
    """Draw the unknowns as often as if the experiment had been repeated.

    Parameters
    ----------
    problem : Problem
        With a cost of known loss.
    x : array, shape (n_unknowns,)
        Its minimum.
    draws : int
    block : int, optional
        Length of a block [samples]; five correlation times if left out.
    seed : int
        Each draw has its own stream, so that `jobs` changes nothing.
    jobs : int
        Threads.

    Returns
    -------
    Bootstrap

    Raises
    ------
    InputError
        For a user's own cost, nothing free, an output that is measured less often than others, a run that fails at x,
        or an impossible option.

    Examples
    --------
    >>> from fracid.problem import Experiment
    >>> import fracid
    >>> from fracid.problem import Free
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=5e-3, end=2.0)
    >>> noise = 1e-3 * np.random.default_rng(1).standard_normal((401, 2))
    >>> swing = Experiment("twin", 5e-3, run.states[:, [0, 2]] + noise, np.zeros((1, 1)), initial={"alpha": 0.3})
    >>> problem = Problem(rig, (swing,), {"lambda": Free(0.9, 0.5, 1.2), "mu": Free(0.95, 0.5, 1.2)},
    ...                   initial_state="held")
    >>> found = bootstrap(problem, fracid.identify(problem).x, draws=50)
    >>> low, high = found.interval(1)
    >>> low < 0.95 < high
    True
    """
    if problem.cost_function.loss is None:
        raise InputError(f"The cost {problem.cost_function.name} is a user's own, of unknown loss: no bootstrap of it.")
    require_free(problem.names)
    at_least("draws", draws, 2)
    if any(e.sparse for e in problem.experiments):
        raise InputError("An output is measured less often than others: no bootstrap of it; use the fit's intervals.")
    errors = problem.errors(x)
    if isinstance(errors, Failure):
        raise InputError(f"There is nothing to draw from: the run at the minimum fails: {errors}.")
    length = round(residual_bandwidth(errors)) + 1 if block is None else at_least("block", block, 1)
    length = min(length, min(map(len, errors)))
    x = vector("x", x)
    points, free = np.tile(x, (draws, 1)), np.flatnonzero(~at_bound(problem, x, jobs=at_least("jobs", jobs, 1)))
    if len(free):  # unknowns at their bounds stay
        J, shape = jacobian(problem, x, free, jobs=jobs), sandwich(problem, x, free, jobs=jobs)
        if isinstance(J, Failure) or isinstance(shape, Failure):
            raise InputError(f"There is no Newton step: {J if isinstance(J, Failure) else shape}.")
        median = loss_of(problem).centre == "median"  # on that the minimum rests
        prior, level = prior_curvature(problem, errors, free)
        for point, rng in zip(points, np.random.default_rng(seed).spawn(draws), strict=True):
            samples = [resampled(e, length, rng, median=median) for e in errors]
            pull = np.sqrt(2 * level * prior) * rng.standard_normal(len(free))
            pull += np.sum([s.sum(axis=0) for s in scores_of(slopes_of(problem, samples), J)], axis=0)
            point[free] -= shape.inverse @ pull
    blocks = sum(len(e) // length for e in errors)
    warning = (f"The residuals are autocorrelated over {length} samples, which leaves {blocks} blocks: the bootstrap's "
               "intervals are too narrow.") if blocks < FEW_BLOCKS else ""  # fmt: skip
    return Bootstrap(problem.names, x, points, length, warning=warning)


def resampled(errors: FloatArray, length: int, rng: np.random.Generator, *, median: bool = False) -> FloatArray:
    """Blocks of residuals at random, laid end to end, of mean 0 over all draws at every sample.

    For |e| the minimum rests on the `median`: then that of the record is 0.

    Parameters
    ----------
    errors : array, shape (n_samples, n_outputs)
    length : int
        Of a block, at most n_samples.

    Examples
    --------
    >>> resampled(np.arange(4.0)[:, None], 4, np.random.default_rng(0)).ravel()  # one block: nothing left
    array([0., 0., 0., 0.])
    """
    n = len(errors)
    starts = rng.integers(0, n - length + 1, -(-n // length))
    sample = errors[(starts[:, None] + np.arange(length)).ravel()[:n]]
    if median:
        return np.asarray(sample - np.median(errors, axis=0))
    total = np.vstack([np.zeros_like(errors[:1]), np.cumsum(errors, axis=0)])
    mean = (total[n - length + 1 :] - total[:length]) / (n - length + 1)  # over all starts, at each place of a block
    return np.asarray(sample - np.tile(mean, (len(starts), 1))[:n])
