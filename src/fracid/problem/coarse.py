r"""Coarser recordings: the mean of every few samples, and of what is simulated for the same moments.

A record of an hour at 1 kHz says of a swing of half a second what it says at 60 Hz, as long as nothing of its noise is
lost: so a sample of the coarser recording is the mean of those within half its step H on either side (the trapezoidal
rule over k + 1 of them; the first stays as it is), and so is what is simulated.  Means are linear: the errors of the
coarser recording are the means of the errors, those of the true values have none in the mean, and their white noise is
as much smaller as there are fewer of them.  What is lost of the information is what a derivative
:math:`\partial y/\partial x` varies within a step: with n steps a period :math:`(2π/n)^2/12` of it, 0.14 % for 48.

Inputs keep the rate of the source: a run goes through them with `substeps` steps a coarse sample, and where these are
fewer than the source's, a held input counts by its mean over each step, so that no impulse is lost.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fracid.arrays import FloatArray
from fracid.problem.experiment import Experiment


def possible(e: Experiment) -> bool:
    """Whether a recording can be made coarser: even samples of all outputs that count alike, without a past."""
    return e.times is None and e.past is None and e.deviation is None and e.source is None and not any(e.blanks)


def coarser(e: Experiment, every: int, inputs: Sequence[str]) -> Experiment:
    """Means of `every` samples, a power of two.

    Parameters
    ----------
    e : Experiment
    every : int
        Samples.
    inputs : sequence of str
        The names of its inputs.

    Examples
    --------
    >>> line = Experiment("line", 0.1, np.arange(20.0)[:, None], np.zeros((1, 1)))
    >>> coarse = coarser(line, 4, ["voltage"])
    >>> coarse.step, coarse.measured[:, 0].tolist()
    (0.4, [0.0, 4.0, 8.0, 12.0, 16.0])
    """
    rows = (len(e.measured) - 1 - every // 2) // every + 1
    source = e.part(0, (rows - 1) * every + every // 2 + 1)
    return replace(e, step=every * e.step, measured=means(source.measured, every), source=source, means=every,
                   inputs=_inputs(e, every, inputs)[:rows],
                   mask=tuple((a - every * e.step / 2, b + every * e.step / 2) for a, b in e.mask))  # fmt: skip


def as_samples(e: Experiment) -> Experiment:
    """Means taken for samples: of 64 in a period the amplitude is 0.04 % less, the phase the same.

    Examples
    --------
    >>> line = Experiment("line", 0.1, np.arange(20.0)[:, None], np.zeros((1, 1)))
    >>> coarser(line, 4, ["voltage"]).means, as_samples(coarser(line, 4, ["voltage"])).means
    (4, 1)
    """
    return e if e.source is None else replace(e, means=1, source=None)


def stepped(e: Experiment, steps: int, inputs: Sequence[str]) -> Experiment:
    """The source of a coarser recording with so many samples a coarse one, or as it is where it has no more.

    Examples
    --------
    >>> line = Experiment("line", 0.1, np.arange(20.0)[:, None], np.zeros((1, 1)))
    >>> stepped(coarser(line, 4, ["voltage"]), 2, ["voltage"]).measured[:, 0].tolist()
    [0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0, 14.0, 16.0, 18.0]
    """
    source, every = e.sampled, max(1, e.means // steps)
    source = replace(source, name=e.name, initial=e.initial, release_time=e.release_time, constants=e.constants,
                     sensors=e.sensors, actuators=e.actuators, between=e.between)  # fmt: skip
    if every == 1:
        return source
    return replace(source, step=every * source.step, measured=source.measured[::every],
                   inputs=_inputs(source, every, inputs), source=source)  # fmt: skip


def means(values: FloatArray, steps: int) -> FloatArray:
    """Means over half a coarse step on either side, of values with so many steps in one; the first as it is.

    Parameters
    ----------
    values : array, shape ((n - 1) steps + steps / 2 + 1, n_outputs)
    steps : int
        A power of two; of one step there is nothing to take the mean of.

    Examples
    --------
    >>> means(np.array([[0.0], [1.0], [4.0], [9.0]]), 2).tolist()
    [[0.0], [4.5]]
    """
    if steps == 1:
        return values
    half, n = steps // 2, math.ceil((len(values) - steps // 2) / steps)
    inner = values[half : half + (n - 1) * steps].reshape(n - 1, steps, -1).sum(axis=1)
    ends = values[half : half + (n - 1) * steps + 1 : steps]
    return np.vstack([values[:1], (inner + 0.5 * np.diff(ends, axis=0)) / steps])


def _inputs(e: Experiment, every: int, names: Sequence[str]) -> FloatArray:
    """The inputs at every so many samples: of those that are held the mean up to the next; or one row for all."""
    whole = len(e.inputs) - len(e.inputs) % every
    picked = e.inputs[::every].copy()
    for i, name in enumerate(names):
        if e.between.get(name, "line") == "hold":
            picked[: whole // every, i] = e.inputs[:whole, i].reshape(-1, every).mean(axis=1)
            picked[whole // every :, i] = e.inputs[whole:, i].mean() if whole < len(e.inputs) else picked[-1, i]
    return picked
