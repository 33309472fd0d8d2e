"""Nested sampling: posteriors that are bent, cut or of several peaks, and the evidence, by nautilus [L]_.

It draws from the whole prior, not from a neighbourhood of the minimum, its regions drawn by neural networks.  The
package is optional (``pip install 'fracid[posterior]'``) and imported here alone.  It asks for log likelihoods batch by
batch; each batch is simulated on threads and goes into the journal, and as everything else follows from the seed, a
resumed run replays the journal and ends the same, to the bit, for any number of threads.

References
----------
.. [L] J. Lange, MNRAS 525 (2023) 3181.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import Any

import numpy as np

from fracid.arrays import FloatArray
from fracid.bayes.laplace import WeightedDraws, simulated
from fracid.bayes.target import SAYS, BoxPrior, Likelihood
from fracid.errors import InputError, at_least, installed
from fracid.tasks.job import Progress, one_blas_thread
from fracid.tasks.tasks import HERE, Execution

LIVE = 500
"""Live points of nautilus."""

NETWORKS = 4
"""Of nautilus, for each region."""

BATCH = 100
"""Points that nautilus asks for at once, whatever the number of threads."""

SHARE = 25
"""Of them in one task."""

NOTHING = -1e100
"""The log likelihood of a run that fails: nautilus wants a number."""

REMAINDER = 0.01
"""Part of the evidence in the live points at which exploring ends."""


def nested_sample(
    likelihood: Likelihood, prior: BoxPrior, *, draws: int, seed: int, execution: Execution = HERE
) -> WeightedDraws:
    """Draw from the whole prior by nested sampling.

    Parameters
    ----------
    likelihood : Likelihood
    prior : BoxPrior
        Proper.
    draws : int
        Effective draws at least.
    seed : int
    execution : Execution, optional
        Threads; its journal keeps each batch.

    Raises
    ------
    InputError
        If the package is not installed, or other executors than threads are asked for.
    """
    at_least("draws", draws, 1)
    if execution.executor != "threads":
        raise InputError(f"Nested sampling runs on threads, not on {execution.executor}: leave --executor out.")
    with installed(SAYS("no-nautilus")):
        from nautilus import Sampler
    n, name, quiet = len(prior.lower), f"nested, {draws} draws, seed {seed}", replace(execution, progress=None)
    asked, began, tell = list[int](), time.perf_counter(), execution.progress

    def from_unit(u: FloatArray) -> FloatArray:  # nautilus wants two dimensions: a single parameter has an idle one
        return np.concatenate([prior.from_unit(u[..., :n]), u[..., n:]], axis=-1)

    def log_likelihoods(x: FloatArray) -> FloatArray:
        asked.append(len(x))
        values = simulated(likelihood, x[:, :n], f"{name}, batch {len(asked)}", SHARE, quiet)
        if tell is not None:
            tell(Progress(sum(asked), None, 0, time.perf_counter() - began))
        return np.maximum(values, NOTHING)

    sampler: Any = Sampler(from_unit, log_likelihoods, n_dim=max(n, 2), n_live=LIVE, n_batch=BATCH,
                           n_networks=NETWORKS, vectorized=True, pass_dict=False, seed=seed)  # fmt: skip
    with one_blas_thread():  # sums split over threads round differently
        sampler.run(f_live=REMAINDER, n_eff=draws, verbose=False)
        points, log_weights, _ = sampler.posterior()
    log_weights = log_weights - np.logaddexp.reduce(log_weights)
    some = log_weights > math.log(np.finfo(float).tiny)  # without runs that fail, and draws whose weight is nothing
    kept = log_weights[some]
    return WeightedDraws(points[some, :n], kept - np.logaddexp.reduce(kept), float(sampler.log_z),
                         1 / math.sqrt(float(sampler.n_eff)), simulations=sum(asked))  # fmt: skip
