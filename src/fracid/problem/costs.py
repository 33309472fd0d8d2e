r"""What counts as a good fit: costs of the residual e(t) = measured − simulated.

========== ===================================== ===================================================
cost       formula                               what to use when
========== ===================================== ===================================================
``rmse``   :math:`\sqrt{\frac1n\sum e^2}`        the default: constant-variance noise, in the data's unit
``ise``    :math:`\int e^2 dt`                   the same minimum for one recording; several add up by length
``huber``  :math:`\frac1n\sum ρ(e)`,             outliers: a bump against the table, a lost count
           e² below 1°, linear above; in another unit
           below 0.01745 of it
``iae``    :math:`\int |e|\,dt`                  heavy-tailed errors
``itse``   :math:`\int t\,e^2 dt`                the late part matters more
``itae``   :math:`\int t\,|e|\,dt`, (26)         the paper's.  91–99 % of its weight can fall after the motion
                                                 has died, where half a count of rest offset competes
========== ===================================== ===================================================

Each is :math:`\sum_t w_t\, ρ(e_t)` over samples and outputs, a weight :math:`w` (trapezoidal for the
integrals) and a loss ρ; the table :data:`COSTS` says which.  A residual that is not finite costs infinity.

For least squares each gives rows r with :math:`\sum r^2` least where the cost is.  Those of |e| are smoothed
within 10⁻⁵ rad of zero, :math:`r^2 = \sqrt{e^2 + δ^2} - δ`: a gradient everywhere, and the same minimum to
far below an encoder's step.

A warning for encoders: the least :math:`\sum |e|` lies at the *median*, and the median of a rounded signal is
a whole count however the noise dithers it, while its mean is not.  On the paper's twin (10°, 4096 counts) this
alone moves λ by −0.02 under ITAE; least squares is free of it (``benchmarks/evidence.py``).

A cost of your own is a function (time, residual) → float, in a file: ``cost = "my.py:function"``.  Infinity
means "as bad as a run that failed".  It has no rows: search by ``differential-evolution`` or ``nelder-mead``.

References
----------
(26) is the paper's; ρ of ``huber``: P. Huber, Ann. Math. Statist. 35 (1964) 73; the integrals: D. Graham,
R. Lathrop, AIEE Trans. 72 (1953) 273.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from operator import mul
from pathlib import Path
from typing import Any, Literal

import numpy as np

from fracid.arrays import BoolArray, FloatArray
from fracid.errors import InputError, refuse_unknown
from fracid.findings import Words
from fracid.safety.user_code import attribute_of, is_own
from fracid.signals.resolution import resolution

SAYS = Words("problem/checks.toml")

OF_A_FILE = "fracid_user_cost_"
"""So the modules of costs begin whose code is a file of one's own."""

Scored = BoolArray | None
"""Which samples count, shape (n_samples, n_outputs); None for all."""

HUBER = math.radians(1.0)
"""Where the Huber loss turns from quadratic to linear [rad]."""

SMOOTH = 1e-5
"""δ of the smoothed |e| in the rows for least squares [rad]: 1/150 of a 4096-count encoder's step."""


@dataclass(frozen=True)
class Loss:
    """ρ(e) with what estimation needs of it."""

    rho: Callable[[FloatArray], FloatArray]
    """ρ of each residual, of the same shape."""
    psi: Callable[[FloatArray], FloatArray]
    """ρ′."""
    curvature: Callable[[FloatArray, FloatArray], float]
    """The mean of ρ″ over the residuals of a signal, and that signal, in one unit; for |e| twice the density at 0."""
    smooth: Callable[[FloatArray], FloatArray]
    """ρ, or what stands for it in the rows for least squares."""
    centre: Literal["mean", "median"] = "mean"
    """What of the residuals is 0 where their ρ is least."""
    likelihood_factor: int = 1
    """−2 ln(likelihood) is this times n ln(mean ρ) and a constant: 1 for normal errors, 2 for Laplace's."""


def _smooth_abs(e: FloatArray) -> FloatArray:
    """√(e² + δ²) − δ, without its cancellation near zero."""
    return np.asarray(e * (e / (np.hypot(e, SMOOTH) + SMOOTH)))


def _twice_the_density_at_zero(e: FloatArray, signal: FloatArray) -> float:
    """From the half that is nearest to 0; within half a step of the signal's at least.

    Of normal residuals that is 0.93 of it: nearer to 0 there is too much, for a minimum of |e| makes some of them 0.
    """
    width = max(float(np.median(np.abs(e))), (resolution(signal) or 0.0) / 2, 1e-12)
    return float(np.mean(np.abs(e) <= width)) / width


def _huber(e: FloatArray) -> FloatArray:
    """e² up to HUBER, and from there on its tangent."""
    size = np.abs(e)
    small = np.minimum(size, HUBER)
    return np.asarray(small * (2 * size - small))


SQUARE = Loss(np.square, lambda e: 2 * e, lambda *_: 2.0, np.square)

ABSOLUTE = Loss(np.abs, np.sign, _twice_the_density_at_zero, _smooth_abs, centre="median", likelihood_factor=2)

HUBERS = Loss(_huber, lambda e: 2 * np.clip(e, -HUBER, HUBER),
              lambda e, _: 2 * max(float(np.mean(np.abs(e) <= HUBER)), 1 / len(e)), _huber)  # fmt: skip


def _widths(time: FloatArray) -> FloatArray:
    """The trapezoidal rule's weight of each sample."""
    dt = np.diff(time)
    return np.asarray(0.5 * (np.append(dt, 0.0) + np.insert(dt, 0, 0.0)))


def _equal(time: FloatArray) -> FloatArray:
    return np.full(len(time), 1 / len(time))


@dataclass(frozen=True)
class Cost:
    """A cost of the residual of one recording.

    Examples
    --------
    >>> time = np.array([0.0, 1.0, 2.0])
    >>> COSTS["itae"].value(time, np.full((3, 1), 0.5))  # ∫ t·½ dt from 0 to 2
    1.0
    """

    name: str
    """As in the project file; of a user's own, the function's."""
    weight: Callable[[FloatArray], FloatArray] = _equal
    """time [s], shape (n,) → w, shape (n,)."""
    loss: Loss | None = None
    """ρ; None for a user's own."""
    unit: str = ""
    """As figures write it; "" where it is not known."""
    root: bool = False
    """Whether the square root is taken in the end."""
    function: Callable[[FloatArray, FloatArray], float] | None = None
    """A user's own, in place of weight and loss: (time, residual of shape (n, n_outputs)) → cost."""

    def __reduce__(self) -> tuple[Any, ...]:
        """For pickle: its name, or the fields; no code of a file of one's own, which other processes do not have."""
        if COSTS.get(self.name) is self:
            return cost_from_name, (self.name,)
        if str(getattr(self.function, "__module__", "")).startswith(OF_A_FILE):
            raise InputError(SAYS("cost-of-a-file", cost=self))
        return Cost, tuple(getattr(self, f.name) for f in fields(self))

    def value(self, time: FloatArray, residual: FloatArray, scored: Scored = None) -> float:
        """Evaluate; infinite, never NaN, for a residual that is not finite.

        Parameters
        ----------
        time : array, shape (n_samples,)
            From the start of the recording [s].
        residual : array, shape (n_samples, n_outputs)
            Measured minus simulated [rad].
        scored : array of bool, shape (n_samples, n_outputs), optional
            Which samples count; all if left out.

        Raises
        ------
        InputError
            If a user's function fails or gives no number.
        """
        if not np.all(np.isfinite(residual)):
            return math.inf
        if self.loss is None:
            at = slice(None) if scored is None else np.any(scored, axis=1)
            return self._own_value(time[at], residual[at])
        with np.errstate(over="ignore", invalid="ignore"):  # 1e200 squared, and that at t = 0
            # no dot product: it would wake the threads of BLAS beside those of the optimiser
            total = float(np.sum(self.weights(time, scored) * self.loss.rho(residual)))
        if not math.isfinite(total):
            return math.inf
        return math.sqrt(total / residual.shape[1]) if self.root else total

    def _own_value(self, time: FloatArray, residual: FloatArray) -> float:
        assert self.function is not None
        try:
            cost = float(self.function(time, residual))
        except Exception as error:
            raise InputError(SAYS("cost-fails", name=self.name, kind=type(error).__name__, error=error)) from error
        if math.isnan(cost) or cost == -math.inf:
            raise InputError(f"The cost {self.name} gave {cost} for a finite residual; return a number, or inf.")
        return cost

    def weights(self, time: FloatArray, scored: Scored = None) -> FloatArray:
        """w of each sample, 0 of those that do not count, shape (n_samples, n_outputs), or (n_samples, 1)."""
        if scored is None:
            return self.weight(time)[:, None]
        if self.per_sample:
            return np.asarray(scored * (scored.shape[1] / max(1, np.count_nonzero(scored))))
        return np.asarray(scored * self.weight(time)[:, None])

    def rows(self, time: FloatArray, residual: FloatArray, scored: Scored = None) -> FloatArray | None:
        """Rows for least squares, shape (n_samples · n_outputs,), None for a user's own cost."""
        if self.loss is None:
            return None
        if self.loss is SQUARE:
            return np.asarray((np.sqrt(self.weights(time, scored)) * residual).ravel())
        squares = self.weights(time, scored) * self.loss.smooth(residual)
        return np.asarray(np.copysign(np.sqrt(squares), residual).ravel())

    @property
    def per_sample(self) -> bool:
        """Whether it is a mean, in which each sample counts alike; else an integral, or a user's own."""
        return self.loss is not None and self.weight is _equal

    @property
    def kinked(self) -> bool:
        """Whether it is a chain of kinks, one where each residual is 0: its slopes say nothing of where it is least."""
        return self.loss is ABSOLUTE

    @property
    def without_kink(self) -> Cost:
        """Huber's in the place of one of |e|, whose kink stops least squares; any other itself.

        Examples
        --------
        >>> COSTS["rmse"].without_kink.name, COSTS["itae"].without_kink.name
        ('rmse', 'huber')
        """
        return COSTS["huber"] if self.kinked else self

    def join(self, costs: list[float], samples: Sequence[float], weights: Sequence[float] | None = None) -> float:
        """Join the costs of several recordings: the mean of all samples, or its root; of integrals the weighted sum.

        Examples
        --------
        >>> COSTS["rmse"].join([1.0, 7.0], samples=[100, 100]), COSTS["itae"].join([1.0, 7.0], samples=[100, 100])
        (5.0, 8.0)
        """
        if not self.per_sample:
            return float(sum(costs if weights is None else map(mul, costs, weights)))
        mean = sum(n * c * c if self.root else n * c for n, c in zip(samples, costs, strict=True)) / (sum(samples) or 1)
        return math.sqrt(mean) if self.root else float(mean)


COSTS = {
    "rmse": Cost("rmse", _equal, SQUARE, "rad", root=True),
    "ise": Cost("ise", _widths, SQUARE, "rad² s"),
    "itse": Cost("itse", lambda time: time * _widths(time), SQUARE, "rad² s²"),
    "iae": Cost("iae", _widths, ABSOLUTE, "rad s"),
    "itae": Cost("itae", lambda time: time * _widths(time), ABSOLUTE, "rad s²"),
    "huber": Cost("huber", _equal, HUBERS, "rad²"),
}
"""By name; see the module's table.  A new one is a row here, with a loss of its own where none of these is its."""


def cost_from_name(name: str) -> Cost:
    """Find a cost by its name, or load a user's own from ``file.py:function``.

    Raises
    ------
    InputError
        If there is no such cost, file or function, or the file does not run.

    Examples
    --------
    >>> cost_from_name("itae").name
    'itae'
    """
    if not is_own(name):
        refuse_unknown("cost", (*COSTS, "my.py:function"), name)
        return COSTS[name]
    own = attribute_of("cost", name, Path(), OF_A_FILE)
    if not callable(own):
        raise InputError(f"cost {name!r} is {own!r}; expected a function of time and residual.")
    return Cost(name.rpartition(":")[2], function=own)
