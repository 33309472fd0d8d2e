r"""What counts as a good fit: costs of the residual e(t) = measured − simulated.

========== ===================================== ===================================================
cost       formula                               what to use when
========== ===================================== ===================================================
``rmse``   :math:`\sqrt{\frac1n\sum e^2}`        the default: constant-variance noise, in the data's unit
``ise``    :math:`\int e^2 dt`                   the same minimum for one recording; several add up by length
``huber``  quadratic below 1°, linear above      outliers: a bump against the table, a lost count
``iae``    :math:`\int |e|\,dt`                  heavy-tailed errors
``itse``   :math:`\int t\,e^2 dt`                the late part matters more
``itae``   :math:`\int t\,|e|\,dt`, (26)         the paper's.  91–99 % of its weight can fall after the motion
                                                 has died, where half a count of rest offset competes
========== ===================================== ===================================================

Several outputs are added up.  Integrals are trapezoidal.  A residual that is not finite costs infinity.

Least squares needs rows r with :math:`\sum r^2` as small as can be where the cost is: each cost here gives
them.  Those of |e| are smoothed within 10⁻⁵ rad of zero, :math:`r^2 = \sqrt{e^2 + δ^2} - δ`, which has a
gradient everywhere and the same minimum to rounding of any encoder.

A cost of your own is a function (time, residual) → float, in a file: ``cost = "my.py:function"``.
"""

from __future__ import annotations

import difflib
import importlib.util
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fracid.errors import InputError

__all__ = ["COSTS", "Cost", "cost_from_name"]

FloatArray = NDArray[np.float64]

HUBER = math.radians(1.0)
"""Where the Huber cost turns from quadratic to linear [rad]."""

SMOOTH = 1e-5
"""δ of the smoothed |e| in the rows for least squares [rad]: a hundredth of a 4096-count encoder's step."""


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
    function: Callable[[FloatArray, FloatArray], float]
    """(time [s], shape (n,); residual [rad], shape (n, n_outputs)) → cost."""
    squares: Callable[[FloatArray, FloatArray], FloatArray] | None = None
    """The same → rows for least squares, shape (n · n_outputs,); None where there are none."""
    mean: bool = False
    """Whether several recordings are joined by the root of the mean of squares, or else added up."""

    def value(self, time: FloatArray, residual: FloatArray) -> float:
        """Evaluate; infinite, never NaN, for a residual that is not finite.

        Raises
        ------
        InputError
            If a user's function fails or gives no number.
        """
        if not np.all(np.isfinite(residual)):
            return math.inf
        try:
            cost = float(self.function(time, residual))
        except Exception as error:
            raise InputError(
                f"The cost {self.name} fails: {type(error).__name__}: {error}. It gets time of shape (n,) and the "
                "residual of shape (n, n_outputs), and must return one number."
            ) from error
        return cost if not math.isnan(cost) else math.inf

    def join(self, costs: list[float], samples: list[int]) -> float:
        """Join the costs of several recordings into one."""
        if self.mean:
            return math.sqrt(sum(n * c * c for n, c in zip(samples, costs, strict=True)) / sum(samples))
        return sum(costs)


def _integral(time: FloatArray, integrand: FloatArray) -> float:
    return float(np.trapezoid(integrand.sum(axis=1), time))


def _widths(time: FloatArray) -> FloatArray:
    """Weight of each sample in the trapezoidal rule, shape (n, 1)."""
    dt = np.diff(time)
    return 0.5 * (np.append(dt, 0.0) + np.insert(dt, 0, 0.0))[:, None]


def _huber(e: FloatArray) -> FloatArray:
    size = np.abs(e)
    return np.where(size <= HUBER, e * e, HUBER * (2 * size - HUBER))


def _smooth_abs(e: FloatArray) -> FloatArray:
    return np.sqrt(e * e + SMOOTH * SMOOTH) - SMOOTH


def _rows(squares: FloatArray, sign: FloatArray) -> FloatArray:
    """Rows with these squares and the residual's sign."""
    return np.asarray(np.copysign(np.sqrt(squares), sign).ravel())


COSTS = {
    "rmse": Cost("rmse", lambda t, e: math.sqrt(np.mean(e * e)), lambda t, e: e.ravel(), mean=True),
    "ise": Cost("ise", lambda t, e: _integral(t, e * e), lambda t, e: _rows(_widths(t) * e * e, e)),
    "itse": Cost(
        "itse", lambda t, e: _integral(t, t[:, None] * e * e), lambda t, e: _rows(t[:, None] * _widths(t) * e * e, e)
    ),
    "iae": Cost(
        "iae", lambda t, e: _integral(t, np.abs(e)), lambda t, e: _rows(_widths(t) * _smooth_abs(e), e)
    ),
    "itae": Cost(
        "itae",
        lambda t, e: _integral(t, t[:, None] * np.abs(e)),
        lambda t, e: _rows(t[:, None] * _widths(t) * _smooth_abs(e), e),
    ),
    "huber": Cost("huber", lambda t, e: float(np.mean(_huber(e))), lambda t, e: _rows(_huber(e), e)),
}
"""By name; see the module's table."""


def cost_from_name(name: str) -> Cost:
    """Find a cost by its name, or load a user's own from ``file.py:function``.

    Raises
    ------
    InputError
        If there is no such cost, file or function.

    Examples
    --------
    >>> cost_from_name("itae").name
    'itae'
    """
    if name in COSTS:
        return COSTS[name]
    file, _, function = name.rpartition(":")
    if not file.endswith(".py"):
        close = difflib.get_close_matches(name, COSTS, 1)
        hint = f"did you mean {close[0]!r}? " if close else ""
        raise InputError(f'There is no cost {name!r}; {hint}the costs are {", ".join(COSTS)}, or "my.py:function".')
    spec = importlib.util.spec_from_file_location(Path(file).stem, file)
    if not Path(file).is_file() or spec is None or spec.loader is None:
        raise InputError(f"cost = {name!r}: there is no file {file}.")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise InputError(f"cost = {name!r}: {file} does not run: {type(error).__name__}: {error}.") from error
    own = getattr(module, function, None)
    if not callable(own):
        raise InputError(f"cost = {name!r}: {file} has no function {function!r}.")
    return Cost(function, own)
