"""What an estimation returns: an :class:`Estimate` for each value, a :class:`RecordingFit` for each recording.

An estimate has its 95 % interval by the sandwich of :mod:`fracid.estimation.covariance`, which allows for correlated
residuals, and beside it the interval as if they were white: the ratio of the two is what the correlation costs.
A recording's fit has measured and simulated outputs on the recording's own clock, and the values that belong to this
recording alone, such as its initial angle.  Both are records of numbers; nothing here computes them.
"""

from __future__ import annotations

import math
from collections import UserDict
from collections.abc import Mapping
from dataclasses import dataclass, field, make_dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fracid.arrays import BoolArray, FloatArray, by_name, spacing
from fracid.cards import Card, CardDisplay, brief, estimate_text
from fracid.errors import Failure
from fracid.figures import Style, draw
from fracid.recording.measures import PENDULUM
from fracid.safety.schema import Ends, Number, Record, Unknown
from fracid.signals.left_over import LeftOver, left_over
from fracid.signals.resolution import resolution

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from fracid.problem import Problem

VERDICTS = {"practically not": "practically non-identifiable", "not at all": "not identifiable"}
"""Verdicts whose name in files says less than tables have room for."""


def in_words(identifiable: str) -> str:
    """A verdict of ``result.json``, as tables say it.

    Examples
    --------
    >>> in_words("practically not"), in_words("at its bound")
    ('practically non-identifiable', 'at its bound')
    """
    return VERDICTS.get(identifiable, identifiable)


@dataclass(frozen=True, repr=False)
class Estimate(CardDisplay, Record):
    """A value with what is known of it."""

    value: Unknown
    unit: str = ""
    free: bool = False
    standard_error: Number = None
    """None for a fixed value, and where it cannot be known."""
    interval95: Ends | None = None
    """By the sandwich of :mod:`fracid.estimation.covariance`; of this model, without model error."""
    cut: bool = False
    """Whether the interval ends at a bound: the data alone may let it reach further."""
    at_bound: bool = False
    bound: Number = None
    """The bound that it lies at, which is what the value means: a search stops a little before it.  None: at none."""
    identifiable: str = "fixed"
    """The verdict in words: the kinds of :class:`fracid.Verdict`, or what the integer-order rival makes of an order."""
    reason: str = ""
    """Why, and what to do."""
    white95: Ends | None = None
    """As if the residuals were white: how much the sandwich adds shows what their correlation costs."""
    interval_method: str | None = None
    """How the interval was made: a key of :data:`fracid.estimation.covariance.METHODS`; None where there is none."""

    @property
    def verdict(self) -> str:
        """The verdict, as tables say it."""
        return in_words(self.identifiable)

    def row(self) -> dict[str, Any]:
        """Its line in a table."""
        low, high = self.interval95 or (None, None)
        half = None if low is None or high is None else (high - low) / 2
        return {"value": self.value, "half_width": half, "low": low, "high": high, "unit": self.unit,
                "verdict": self.verdict, "free": self.free}  # fmt: skip

    def _card(self) -> Card:
        title = estimate_text("Estimate", self.value, self.interval95, self.unit, cut=self.cut).replace(" = ", " ")
        rows = (("verdict", self.verdict), ("why", self.reason), ("at its bound", brief(self.bound)))
        return Card(title, tuple((what, text) for what, text in rows if text not in ("", "none")))


@dataclass(frozen=True, repr=False)
class OrderEstimate(Estimate):
    """An order, and what it is in the integer-order model."""

    integer: Number = 1.0
    """None where the model gives it no integer value."""


class Estimates(UserDict[str, Estimate]):
    """Estimates by name, of which ``pandas.DataFrame`` makes a row each, the name in its first column.

    Examples
    --------
    >>> estimates = Estimates({"mu": Estimate(0.9, free=True)})
    >>> estimates["mu"].value, np.asarray(estimates)[0].name
    (0.9, 'mu')
    """

    def rows(self) -> list[dict[str, Any]]:
        """Each with its name, as a line of a table."""
        return [{"name": name, **estimate.row()} for name, estimate in self.items()]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[np.object_]:
        """Records, which is what pandas makes rows of; of a dictionary it makes columns."""
        rows = self.rows()
        array = np.empty(len(rows), object)
        array[:] = [make_dataclass("Row", row)(**row) for row in rows]
        return array


@dataclass(frozen=True)
class RecordingFit:
    """One recording beside its simulation."""

    name: str
    use: str
    """``fit`` or ``validate``."""
    time: FloatArray
    """On the recording's own clock [s], shape (n_samples,)."""
    measured: Mapping[str, FloatArray]
    """Output → [rad], shape (n_samples,)."""
    fitted: Mapping[str, FloatArray]
    """The same, simulated."""
    cost: float
    initial: Mapping[str, Estimate]
    """State → its value at the start."""
    parameters: Mapping[str, Estimate]
    """The parameters that this recording has for itself."""
    sha256: str = ""
    units: Mapping[str, str] = field(default_factory=dict)
    """Output → its unit; rad where it says nothing."""
    zero: str = ""
    """Where the model has the zero of the pendulum's angle; "" where that has no meaning."""
    pendulum: str = PENDULUM
    """The output that is the pendulum's angle."""
    scored: Mapping[str, BoolArray] = field(default_factory=dict)
    """Output → which samples count, shape (n_samples,); all where it says nothing."""
    deviations: Mapping[str, FloatArray] = field(default_factory=dict)
    """Output → the standard deviation of its samples, in its unit, shape (n_samples,); empty where none is known."""
    uneven: bool = False
    """Whether its samples are meant to lie unevenly."""
    windows: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Window → state → its value at the window's start, where the recording was fitted in windows; else empty."""
    quanta: Mapping[str, float] = field(default_factory=dict)
    """Output → the step of its encoder, 0 for none, where its samples show none: they are read off lines."""

    def zero_of(self, output: str) -> str:
        """Where an output is zero, ``hanging`` or ``upright``; "" where that is not the model's to say.

        Examples
        --------
        >>> angles = {"arm": np.zeros(3), "rod": np.zeros(3)}
        >>> fit = RecordingFit("a", "fit", np.arange(3.0), angles, angles, 0.0, {}, {}, zero="hanging", pendulum="rod")
        >>> fit.zero_of("rod"), fit.zero_of("arm")
        ('hanging', '')
        """
        return self.zero if output == self.pendulum else ""

    @property
    def samples(self) -> int:
        """How many were used, of the output that has most."""
        return max(int(np.count_nonzero(self._own(n))) for n in self.measured)

    @property
    def begin(self) -> float:
        """The first time [s]."""
        return float(self.time[0])

    @property
    def end(self) -> float:
        """The last time [s]."""
        return float(self.time[-1])

    def unit(self, output: str) -> str:
        """The unit of an output, rad for an angle."""
        return self.units.get(output, "rad")

    @property
    def resolutions(self) -> dict[str, float | None]:
        """Output → the step of its encoder [rad], as its samples show it; None where they show none."""
        return {n: self.quanta[n] or None if n in self.quanta else resolution(y) for n, y in self.measured.items()}

    @property
    def rmse(self) -> dict[str, float]:
        """Root mean square of the residual, per output [rad]."""
        return {n: float(np.sqrt(np.mean((y - self.fitted[n])[self._own(n)] ** 2))) for n, y in self.measured.items()}

    @property
    def fit_percent(self) -> dict[str, float]:
        """100·(1 − ‖y − ŷ‖/‖y − ȳ‖), per output; −inf for a constant output that is missed."""
        return {n: fit_percent(y[self._own(n)], self.fitted[n][self._own(n)]) for n, y in self.measured.items()}

    def residual(self, output: str) -> FloatArray:
        """Measured minus simulated [rad]; NaN where a sample is not scored."""
        return np.where(self._own(output), self.measured[output] - self.fitted[output], np.nan)

    def standardised(self, output: str) -> FloatArray:
        """The residual in the standard deviations of the samples, where these are known; else as :meth:`residual`."""
        return self.residual(output) / self.deviations.get(output, 1.0)

    def _own(self, output: str) -> BoolArray:
        return self.scored.get(output, np.ones(len(self.time), bool))

    def at(self, rows: slice | BoolArray, *outputs: str) -> RecordingFit:
        """Some of its samples, of all outputs or of some."""
        lines, names = ("measured", "fitted", "deviations", "scored"), outputs or self.measured
        some: dict[str, Any] = {k: {n: y[rows] for n, y in getattr(self, k).items() if n in names} for k in lines}
        return replace(self, time=self.time[rows], **some)

    def of(self, output: str) -> RecordingFit:
        """The samples that an output has which is measured now and then, and it alone; of any other all."""
        own = self._own(output)
        return self if spacing(own) == 1 else replace(self.at(own, output), uneven=True)

    def left_over(self, output: str) -> LeftOver:
        """What is left over of an output, of the samples that it has: its size and correlation."""
        own = self.of(output)
        left = left_over(own.standardised(output), own.measured[output], known=output in self.deviations)
        return replace(left, floor=self.quanta[output] / math.sqrt(12)) if output in self.quanta else left

    def plot(self, *, style: str | Style = "screen") -> Figure:
        """Measured and fitted over time, the residual below; see :func:`fracid.plots.fitted_over_time`.

        Parameters
        ----------
        style : str or Style
            ``screen``, ``journal`` or one's own; see :mod:`fracid.figures`.

        Examples
        --------
        >>> t = np.arange(0, 20, 1e-2)
        >>> swing = {"alpha": np.exp(-0.2 * t) * np.cos(7 * t)}
        >>> release = RecordingFit("release", "fit", t, swing, swing, 0.0, {}, {}, zero="hanging")
        >>> release.plot().axes[0].get_ylabel()
        '$\\\\alpha$, 0 = hanging [°]'
        """
        return draw("fitted_over_time", self, resolution=self.resolutions, style=style)

    def plot_residuals(
        self, output: str | None = None, *, tests: bool = False, style: str | Style = "screen"
    ) -> Figure:
        """What the fit leaves over; see :func:`fracid.plots.residual_plots`.

        Parameters
        ----------
        output : str, optional
            The pendulum's angle if left out, or the first output of a model that has none.
        tests : bool
            Also what :func:`fracid.residual_analysis` looks at; see :func:`fracid.plots.residual_diagnostics`.
        style : str or Style
            As for :meth:`plot`.

        Raises
        ------
        InputError
            If there is no such output.
        """
        name = output or (self.pendulum if self.pendulum in self.measured else next(iter(self.measured)))
        kind = "residual_diagnostics" if tests else "residual_plots"
        return draw(kind, self, name, resolution=self.resolutions, style=style)


def fit_of(
    problem: Problem, x: FloatArray, name: str, use: str, initial: Mapping[str, Estimate],
    parameters: Mapping[str, Estimate],
) -> RecordingFit:  # fmt: skip
    """One recording beside its simulation at x, which is NaN where the run fails."""
    simulated, model, (e, at) = problem.followed(x, name), problem.model, problem.recordings[name]
    if isinstance(simulated, Failure):
        fitted, cost = np.full(e.measured.shape, np.nan), np.inf
    else:
        fitted, error = simulated, e.in_deviations(e.measured - simulated)
        alone = replace(problem.criterion, experiments=(e,), priors={})
        cost = alone.cost(x, [np.where(np.isnan(error), 0.0, error)])
    deviations = () if e.deviation is None else zip(problem.outputs, e.deviation.T, strict=True)
    windows = {} if e is problem.experiments[at][0] else {
        w.name: by_name(model.states, problem.unpack(x, w)[2]) for w in problem.experiments[at]
    }  # fmt: skip
    return RecordingFit(
        name, use, e.start + e.time, dict(zip(problem.outputs, e.measured.T, strict=True)),
        fitted=dict(zip(problem.outputs, fitted.T, strict=True)), cost=cost, initial=initial, parameters=parameters,
        sha256=e.sha256, units=e.units, zero=model.zero, pendulum=model.pendulum, deviations=dict(deviations),
        scored=dict(zip(problem.outputs, e.scored.T, strict=True)), uneven=e.times is not None, windows=windows,
        quanta=e.quanta,
    )  # fmt: skip


def fit_percent(measured: FloatArray, fitted: FloatArray) -> float:
    """100·(1 − ‖y − ŷ‖/‖y − ȳ‖); −inf for a constant output that is missed.

    Examples
    --------
    >>> fit_percent(np.array([0.0, 1.0]), np.array([0.5, 0.5])), fit_percent(np.ones(2), np.ones(2))
    (0.0, 100.0)
    """
    spread = float(np.linalg.norm(measured - measured.mean())) if np.ptp(measured) > 0 else 0.0  # else rounding
    error = float(np.linalg.norm(measured - fitted))
    return 100.0 * (1.0 - error / spread) if spread > 0 else (100.0 if error == 0 else -np.inf)
