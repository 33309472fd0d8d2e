r"""What came before a start in motion: the memory that a recording brings along.

**A start in motion** has a past, and its memory belongs into the equations: :math:`D^q x` sums over all that was.
An experiment with a `past`, the samples before its start, gives it in three steps:

1. the release in the past, with which the memory begins: of a plateau on which a hand holds the rig the equations know
   nothing, nor does it leave a memory (:func:`release_in_past`);
2. of an output whose rate is not recorded, past and recording together, low-passed with zero phase at :data:`CUTOFF`
   swings (:func:`smooth_past`): its derivative is needed.  All others stay as recorded, since the memory averages
   their noise, and a filter would bend what begins like t^q;
3. the states: each scored output of order q is the state x of the past and :math:`x_j = τ_0^{q-1} D^q x` its rate's,
   with the orders of the moment (:meth:`Past.states`).

The start itself is as `initial_state` says, ``estimate`` or ``measured``; the latter takes :math:`x_j` from the past.
Without a past the memory begins at the start, as if the rig had stood still in that posture and was struck.  Twins
with orders 0.9, 0.95, 4096 counts and 10⁻³ rad of noise, cut 1.3 s after the release, 6.7 s fitted, found λ − 0.9,
μ − 0.95 (``python benchmarks/evidence.py swing`` prints them again; :mod:`fracid.validation.unknown_past` does the like
for any fit):

============================ =============== =============== =============== ===============
twin                         ``estimate``    with its past   ``measured``    from plateau
============================ =============== =============== =============== ===============
60°, viscous friction        +.044, +.0006   +.000, −.0000   −.006, +.0001   +.000, −.0000
60°, dry friction too        −.004, −.0005   −.000, +.0000   +.001, +.0000   +.001, +.0000
20°, dry friction too        −.065, −.0005   +.005, −.0000   +.009, +.0001   +.003, −.0000
60°, dry, 10⁻² rad of noise  +.007, −.0005   +.016, +.0001   −.026, −.0003   +.005, +.0000
============================ =============== =============== =============== ===============

``measured`` takes the noise of the start for truth, and its intervals promise many times too much; where the noise is
as strong as in the last row the past mends μ alone.  Best is a start cut at the plateau.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from fracid.arrays import FloatArray
from fracid.models import Model
from fracid.problem.experiment import Experiment
from fracid.signals.swing import common_period, release_time
from fracid.solver.operators import derivative
from fracid.solver.solve import time_scale

CUTOFF = 10.0
"""Of the low-pass of a past, in frequencies of the output's swing."""


@dataclass(frozen=True, eq=False)
class Past:
    """The past of one experiment as states on the grid of a run."""

    experiment: Experiment
    model: Model
    measured: list[int]
    """The states of the scored outputs, in the order of the columns of the past."""
    rates: Mapping[int, int]
    """For each of them, i, the state j with D^q x_i = x_j, where that is none of them."""
    substeps: int
    """Steps per sample."""

    @cached_property
    def release(self) -> int:
        """The sample of the past with which the memory begins."""
        return release_in_past(self.experiment)

    def states(self, orders: FloatArray, parameters: FloatArray) -> FloatArray:
        """The states from the release to the start, `substeps` a sample, shape (n, n_states)."""
        signals, rise = self._columns
        past, unit = np.zeros((len(signals[0]), len(orders))), time_scale(self.model, parameters)
        for k, i in enumerate(self.measured):
            past[:, i] = signals[k]
            if i in self.rates:
                past[:, self.rates[i]] = unit ** (orders[i] - 1) * rise(k, float(orders[i]))
        for name, other in self.model.follows.items():
            past[:, self.model.states.index(name)] = past[:, self.model.states.index(other)]
        return past

    @cached_property
    def _columns(self) -> tuple[list[FloatArray], Callable[[int, float], FloatArray]]:
        """The outputs, and D^q of one of them, on the grid of a run."""
        outputs, release = smooth_past(self.experiment, [k for k, i in enumerate(self.measured) if i in self.rates])
        place = np.arange((len(outputs) - 1 - release) * self.substeps + 1) / self.substeps

        def on_the_grid(values: FloatArray) -> FloatArray:
            if self.substeps == 1:
                return values[release:]
            from scipy.interpolate import CubicSpline

            return np.asarray(CubicSpline(range(len(values)), values)(release + place))

        @lru_cache(maxsize=12)  # the orders stay while a search tries the constants
        def rise(k: int, order: float) -> FloatArray:
            values = derivative(outputs[:, k] - outputs[0, k], order, self.experiment.step, kind="rl")
            return on_the_grid(np.concatenate([[0.0], values[1:]]))  # at rest before

        return [on_the_grid(y) for y in outputs.T], rise


def release_in_past(e: Experiment) -> int:
    """The sample of the past at which the motion begins, after a plateau where there is one.

    A free fall's rise is t², so its root is a line, and meets zero at the release: the speed alone is slow to tell.
    """
    assert e.past is not None
    if e.whole is not None:  # of a window: in motion all along
        return 0
    signals = np.vstack([e.past, e.measured])
    x: FloatArray = np.asarray(signals[:, np.argmax(np.ptp(e.past, axis=0))], dtype=np.float64)
    t: FloatArray = np.arange(len(x), dtype=np.float64) * e.step
    rough, _ = release_time(t, x)
    if rough is None:
        return 0
    near = round(rough / e.step)
    before = x[max(0, near - round(0.5 / e.step)) : max(1, near - round(0.02 / e.step))]
    rise = np.abs(x - np.mean(before))
    floor = max(4 * float(np.std(before)), 2e-3 * float(np.ptp(x)))
    quiet = np.flatnonzero(rise[: near + round(0.2 / e.step)] < floor)
    falling = np.arange(quiet[-1] + 1, len(x))
    falling = falling[: max(3, int(np.argmax(rise[falling] > 10 * floor)))]
    slope, offset = np.polyfit(falling, np.sqrt(rise[falling]), 1)
    return int(np.clip(round(-offset / slope), 0, len(e.past) - 1)) if slope > 0 else near


def smooth_past(e: Experiment, columns: list[int]) -> tuple[FloatArray, int]:
    """The past and the start, shape (n, n_outputs), these columns low-passed, and the row of the release.

    The samples after the start take part, so that no border of the filter is near it.  Of a plateau what the filter
    reaches is kept.
    """
    assert e.past is not None
    whole, n, release = np.vstack([e.past, e.measured]), len(e.past), release_in_past(e)
    period = common_period(whole) if e.whole is None else e.whole.period
    cutoff = CUTOFF / (e.step * min(period, len(whole) / 3))
    reach = math.ceil(2 / (cutoff * e.step))
    if columns and cutoff < 0.4 / e.step:
        from scipy.signal import butter, sosfiltfilt

        low_pass = butter(4, cutoff, fs=1 / e.step, output="sos")
        whole[:, columns] = sosfiltfilt(low_pass, whole[:, columns], axis=0, padlen=min(len(whole) - 1, reach))
    first = max(0, release - reach)
    return np.asarray(whole[first : n + 1]), release - first
