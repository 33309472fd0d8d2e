"""Simulated recordings: a trajectory, seen by an encoder with noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import Failure, InputError
from fracid.findings import Words
from fracid.problem import Problem

SAYS = Words("twins/twin.toml")

FINER = 4
"""Steps of the truth for each of the problem's."""


def simulated(problem: Problem, x: FloatArray, finer: int = FINER) -> Problem:
    """The same problem with recordings of the values x in place of what was measured.

    Parameters
    ----------
    problem : Problem
    x : array, shape (n_unknowns,)
    finer : int
        Steps of the simulation, by ``pi2``, for each of the problem's.

    Raises
    ------
    InputError
        If a run fails, or a recording starts with a measured past.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment, Free
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> swing = Experiment("release", 4e-3, np.zeros((251, 2)), np.zeros((1, 1)), initial={"alpha": 0.5})
    >>> problem = Problem(rig, (swing,), {"lambda": 1.0, "mu": Free(1.0, 0.5, 1.2)}, initial_state="rest")
    >>> truth = np.array([0.9, 0.1])  # mu and theta(0)
    >>> twin = simulated(problem, truth)
    >>> twin.experiments[0].measured[0].round(3), bool(twin.cost(truth) < 1e-3)
    (array([0.1, 0.5]), True)
    """
    exact = replace(problem, method="pi2", substeps=finer * problem.substeps)
    twins = []
    for e in problem.experiments:
        if e.past is not None:
            raise InputError(SAYS("measured-past" if e.whole is None else "past-of-window", e=e))
        run = exact.fitted(x, e)
        if isinstance(run, Failure):
            raise InputError(f"The truth cannot be simulated: {run}. Give values whose run reaches the end.")
        twins.append(replace(e, measured=run))
    return replace(problem, experiments=tuple(twins))


def encoder(signal: FloatArray, level: float, resolution: float, rng: np.random.Generator) -> FloatArray:
    """What a noisy encoder reads of a signal: see the module's formula.

    Parameters
    ----------
    signal : array, shape (n_samples, n_outputs)
        [rad]
    level : float
        Standard deviation of the noise [rad].
    resolution : float
        A step of the encoder [rad]; 0 for none.

    Examples
    --------
    >>> y = encoder(np.full((3, 1), 0.25), 0.0, 0.1, np.random.default_rng(1))
    >>> bool(y[0, 0] == y[1, 0] == y[2, 0]), bool(abs(y[0, 0] - 0.25) <= 0.05)
    (True, True)
    """
    edge = resolution * rng.random(signal.shape[1])
    noisy = signal + level * rng.standard_normal(signal.shape)
    return np.asarray(resolution * np.round((noisy - edge) / resolution) + edge if resolution else noisy)
