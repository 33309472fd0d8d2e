"""The whole regression: what is looked for, the steps in their order, and the verdicts in words."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Literal, get_args

import numpy as np
from pydantic import Field

from fracid.arrays import ByName, FloatArray, by_name
from fracid.cards import Card, CardDisplay, brief, estimate_text, listed
from fracid.errors import InputError, refuse_unknown
from fracid.models import Model
from fracid.problem import Experiment, Free, Problem
from fracid.quantiles import normal_interval
from fracid.recording import Recording
from fracid.recording.channel import si_unit
from fracid.regression.credibility import SAYS, belief
from fracid.regression.estimators import (
    Dependent,
    Estimator,
    Gauge,
    Scaled,
    base_parameters,
    bias_of,
    fit_percents,
    overlap,
    sandwich,
    scaled_by_itself,
    solve,
    stack,
)
from fracid.regression.instruments import instruments_of, theta_rest_of
from fracid.regression.orders import search_orders
from fracid.regression.rows import (
    Data,
    Rows,
    Swing,
    System,
    own_values,
    swing_of,
    terms_of,
)
from fracid.safety.schema import UNREAD, Beside, Block, Listed, Number, OpenInterval, Record, Unknown, computed

CUTOFF = (6.0, 9.0)
"""Bounds of the low-pass' cut-off, in swing frequencies: below, products of the motion are lost."""

WINDOW = 0.13
"""Length of the columns' window, in swing periods."""

LOUDEST = 25.0
"""Largest factor by which the residual may raise the noise's variance for the bias."""

WIDE = 0.1
"""An interval of an order wider than this says nothing about it."""

SEARCHED = Free(1.0, 0.5, 1.2)
"""In which range an order is sought of which nothing is said."""

POOR = 85.0
"""An equation that fits by less [%] does not fit."""


Kind = Literal["identified", "known", "biased", "not excited", "only together", "in doubt"]
Worth = tuple[Kind, str]
"""What a constant is worth, and the same in words."""


@dataclass(frozen=True)
class Constant(Record):
    """One constant as the regression sees it."""

    value: float
    """In the parameter's SI unit; the known or the model's own value where it was not found."""
    unit: str
    standard_error: Number
    """From correlated residuals, or the spread over noisy repeats if that is more, and what searched orders add;
    None where it was not found."""
    bias: Number
    """What noise in the columns adds to the value, estimated by adding it once more [unit]; None as above."""
    kind: Kind
    """What it is worth."""
    verdict: str
    """The same in words: with which others it is known, in which direction it is biased, or what is in doubt."""

    @property
    def identified(self) -> bool:
        """Whether to use the value by itself."""
        return self.kind == "identified"

    @computed
    def interval95(self) -> tuple[float, float] | None:
        """About the value, without its bias; None where it was not found."""
        return normal_interval(self.value, self.standard_error)


class SearchedOrder(Block):
    """An order, and its interval where it was searched; null on a side where that has no end."""

    value: float
    interval95: OpenInterval | None

    def __str__(self) -> str:
        """With its interval, or that it was given, or is not seen."""
        low, high = self.interval95 or (None, None)
        if low is None or high is None:
            return f"{self.value:.4g} (given)"
        return f"{self.value:.4g} ({low:.3g} … {high:.3g})" if high - low < math.inf else f"{self.value:.4g} (not seen)"


@dataclass(frozen=True, repr=False, kw_only=True)
class Regression(CardDisplay, Record):
    """What :func:`regress` found."""

    searched: Annotated[Mapping[str, SearchedOrder], Field(alias="orders")]
    parameters: Mapping[str, Constant]
    combinations: Mapping[str, float]
    """What columns that cannot be told apart hold together: ``J_theta - 0.0253 cable_stiffness`` → its value."""
    estimator: str
    fit_percent: Mapping[str, float]
    """100 (1 − rms(residual)/rms(largest term)) of each equation; not of the trajectory."""
    noise_ratio: Unknown
    """Residual variance against that of noise in the columns (total least squares), 1 if noise were all; or NaN."""
    condition_number: Unknown
    """Condition number of the columns used, each of unit length."""
    samples: int
    """Rows used."""
    cutoff: float
    """Cutoff of the low-pass [Hz]."""
    cutoff_reason: str
    window: float
    """Window of the columns [s]."""
    noise: Mapping[str, float]
    """Measurement noise of each angle, rms [rad]: the spectrum's floor, at least that of the encoder's step."""
    amplitude: float
    """Half of what the pendulum moves through, in the recording where that is most [rad]."""
    belief: str = ""
    """What came of recordings like these when the truth was known, in words: :mod:`.credibility`."""
    warnings: Listed[str]
    residuals: Beside[Mapping[str, FloatArray]] = UNREAD
    """W β of the rows used, ``arm`` and ``pendulum`` [N m]."""
    weights: Beside[Mapping[str, FloatArray]] = UNREAD
    """Robust weights of these rows, 1 for a sample that fits."""

    @property
    def orders(self) -> dict[str, float]:
        """Each as it was given or found."""
        return {n: order.value for n, order in self.searched.items()}

    @property
    def intervals(self) -> dict[str, Any]:
        """The 95 % intervals of orders that were searched; infinite where the profile ends before."""
        return {n: order.interval95 for n, order in self.searched.items() if order.interval95 is not None}

    def _card(self) -> Card:
        constants = (estimate_text(n, c.value, c.interval95, c.unit) if c.interval95 else f"{n} = {c.value:.4g}"
                     for n, c in self.parameters.items())  # fmt: skip
        return Card(f"Regression by {self.estimator}", (
            ("constants", listed(constants)),
            ("orders", brief(self.orders)),
            ("residual", self.left_over),
            ("credibility", self.belief),
            ("warnings", listed(self.warnings)),
        ))  # fmt: skip

    @property
    def left_over(self) -> str:
        """The residual beside what noise in the columns explains, in words; "" where that noise is not known."""
        known = math.isfinite(self.noise_ratio)
        return f"residual variance {self.noise_ratio:.3g} times what noise explains" if known else ""

    def __str__(self) -> str:
        """Return a table of values, errors, bias and verdicts."""
        rows = [f"{self.estimator:16}{'value':>12}{'± 1 s.e.':>11}{'bias':>11}  verdict"]
        for name, c in self.parameters.items():
            error, bias = (f"{v:11.2g}" if v is not None else f"{'':11}" for v in (c.standard_error, c.bias))
            rows.append(f"{name:16}{c.value:12.5g}{error}{bias}  {c.verdict}")
        rows += [f"{heading:9} {text}" for heading, text in self.lines]
        return "\n".join([*rows, *filter(None, [self.belief]), *self.warnings])

    @property
    def lines(self) -> list[tuple[str, str]]:
        """What stands below the constants: which are only known together, the orders, how well it fits, the filter."""
        fit = ", ".join(f"{n}'s equation {percent:.1f} %" for n, percent in self.fit_percent.items())
        return [
            *(("together", f"{name} = {value:.4g}") for name, value in self.combinations.items()),
            ("orders", ", ".join(f"{n} = {order}" for n, order in self.searched.items())),
            ("fit", "; ".join(filter(None, (fit, self.left_over)))),
            ("low-pass", f"{self.cutoff:.3g} Hz: {self.cutoff_reason}"),
        ]


@dataclass(frozen=True, repr=False, kw_only=True)
class RegressionResult(Regression):
    """The file of one regression."""

    start: Mapping[str, float]
    """That it gives to the unknowns of a project."""
    notes: Listed[str]
    data_sha256: Mapping[str, str]


def regress(
    recordings: Recording | Sequence[Recording],
    model: Model,
    *,
    orders: Mapping[str, float | Free] | Literal["search"] = "search",
    known: Mapping[str, float] | None = None,
    terms: Sequence[str] | None = None,
    estimator: Estimator = "iv",
    cutoff: float | None = None,
) -> Regression:
    """Find the constants of a rotary pendulum by linear regression; the module's first screen says how.

    Parameters
    ----------
    recordings : Recording or sequence of Recording
        With signals ``alpha`` and, but for a clamped arm, ``theta`` [rad], from rest or with the plateau before
        the release in it; a motion is driven if the model's input, ``torque`` or ``voltage`` is among them.
    model : Model
        From :func:`fracid.rotary_pendulum`: says what α = 0 is, and holds what is not looked for.
    orders : mapping or "search"
        A number is fixed, a :class:`~fracid.Free` searched; "search" seeks both in 0.5 … 1.2.
    known : mapping, optional
        Constants that are known [SI].  A free response needs one; a driven one takes the model's
        torque_per_volt, if it is not 0 (1 for a torque in N m).
    terms : sequence of str, optional
        Names in ``TERMS`` to look for; None is the nine lumped ones.  cable_stiffness brings cable_offset along.
    estimator : {"iv", "tls", "huber", "tukey", "ols"}
    cutoff : float, optional
        Of the low-pass [Hz]; None takes it from the spectrum.

    Returns
    -------
    Regression

    Raises
    ------
    InputError
        For unknown names, an impossible value, a free response of which nothing is known, or a recording that is
        too short, stands still, or has no uniform grid.

    References
    ----------
    The abstract's method; [Gautier]_, [Janot]_, [Cook]_.

    Examples
    --------
    >>> import fracid
    >>> rig = fracid.rotary_pendulum("srv02-rotpen", b_theta=0.01)
    >>> orders = {"lambda": 0.95, "mu": 0.97}
    >>> run = fracid.simulate(rig, orders=orders, initial={"alpha": 1.5}, step=1e-3, end=5.0)
    >>> count = 2 * np.pi / 4096
    >>> swing = fracid.Recording.of("twin", run.time, {
    ...     "theta": count * np.round(run.states[:, 0] / count), "alpha": count * np.round(run.states[:, 2] / count)})
    >>> found = regress(swing, rig, orders=orders, known={"C4": rig.parameter("C4").value})
    >>> found.parameters["C1"].verdict, abs(found.parameters["C1"].value / rig.parameter("C1").value - 1) < 0.02
    ('identified', True)
    """
    lumped, several = terms_of(model).lumped, isinstance(recordings, Sequence)
    records = [recordings] if isinstance(recordings, Recording) else [*recordings] if several else []
    if not records or not all(isinstance(r, Recording) for r in records):
        raise InputError(SAYS("no-recordings", recordings=recordings))
    if isinstance(orders, str) and orders != "search":
        raise InputError(f'orders = {orders!r}: expected "search", or for example {{"lambda": 1.0, "mu": 1.0}}.')
    orders = dict.fromkeys(model.order_names, SEARCHED) if isinstance(orders, str) else orders
    asked = Asked(model, orders, tuple(lumped if terms is None else terms), known or {})
    return asked.of([swing_of(r, model) for r in records], estimator, cutoff)


@dataclass(frozen=True)
class Asked:
    """What is to be found."""

    model: Model
    orders: Mapping[str, float | Free]
    terms: tuple[str, ...]
    known: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @classmethod
    def by(cls, problem: Problem) -> Asked:
        """What a problem leaves free, each by itself; what it fixes is known."""
        free = {u.target for u in problem.unknowns if u.kind == "parameter"}
        ties = {n: root for n, root in problem.ties.items() if root in free or n in problem.orders}
        given = {n: problem.orders[ties.get(n, n)] for n in problem.orders}
        orders = {n: v if isinstance(v, Free) else problem.order_starts[n] for n, v in given.items()}
        terms = tuple(n for n in terms_of(problem.model).names if n in free | {*ties})
        note = (SAYS("ties", names=", ".join(sorted(ties))),) if ties else ()
        return cls(problem.model.with_parameters(**problem.parameter_starts), orders, terms, notes=note)

    def settled(self, swings: Sequence[Swing], owner: str) -> Asked:
        """With what these swings do not tell taken as it is.

        Orders, where one starts in motion: what its memory misses would pass for an order.  Where all is looked for,
        one constant: a common factor of all of them changes no motion.
        """
        linear, model, notes = terms_of(self.model), self.model, [*self.notes]
        orders, known = dict(self.orders), self.known
        moving = [s.name for s in swings if s.in_motion]
        if moving and (searched := {n: v.start for n, v in orders.items() if isinstance(v, Free)}):
            notes.append(SAYS("in-motion", moving=", ".join(moving), searched=" and ".join(searched)))
            orders |= searched
        driven = any(s.drive is not None for s in swings) and model.drive not in self.terms
        fixed = any(model.parameter(n).value for n in linear.lumped if n not in self.terms)
        if not (known or driven or fixed):
            gauge = model.parameter(linear.gauge)
            notes.append(SAYS("gauge", gauge=gauge, owner=owner))
            known = {gauge.name: gauge.value}
        return replace(self, orders=orders, known=known, notes=tuple(notes))

    def of(self, swings: Sequence[Swing], estimator: str, cutoff: float | None = None) -> Regression:
        """Find it in swings."""
        refuse_unknown("estimator", get_args(Estimator), estimator)
        model, orders = self.model, {self.model.order_called(n): v for n, v in self.orders.items()}
        if not any(s.arm for s in swings):
            orders |= {"lambda": 1.0}  # nothing sees it
        for side in ("lower", "upper"):
            model.state_orders({n: getattr(v, side) if isinstance(v, Free) else v for n, v in orders.items()})
        names, fixed_values = _terms(swings, self)
        hertz, reason = _cutoff(swings, cutoff)
        window = WINDOW / min(s.frequency for s in swings)
        rows = [Rows(s, model, names, hertz, window=window) for s in swings]
        if (count := sum(len(k) for r in rows for k in r.kept)) < 3 * len(names):
            raise InputError(SAYS("few-rows", count=count, of=", ".join(s.name for s in swings), constants=len(names)))
        fixed = np.array([fixed_values.get(n, 0.0) for n in names])
        gauge = Gauge(tuple(i for i, n in enumerate(names) if n not in fixed_values), fixed)
        data = Data.of(rows)
        at = {n: v.start if isinstance(v, Free) else float(v) for n, v in orders.items()}
        intervals: dict[str, tuple[float, float]] = {}
        spread = np.zeros(len(names))
        if any(isinstance(v, Free) for v in orders.values()):
            intervals, at, spread = search_orders(data, _independent(data.system(at), gauge, data.own)[0].gauge, orders)
        searched = {n: SearchedOrder(value=v, interval95=intervals.get(n)) for n, v in at.items()}
        how = {"cutoff": hertz, "cutoff_reason": reason, "window": window, "searched": searched}
        regression = _at(data, gauge, at, estimator, spread=spread, **how)
        return doubted(regression, bool(intervals) and any(s.in_motion for s in swings), estimator)


def _at(data: Data, gauge: Gauge, orders: ByName, estimator: str, spread: FloatArray, **how: Any) -> Regression:
    """Regress at given orders; `how` they and the filters were found is told with it."""
    warnings: list[str] = [SAYS("clamped", r=r) for r in data.rows if not r.swing.arm]
    if any(v != 1.0 for v in orders.values()):
        moving = (r for r in data.rows if r.swing.in_motion)
        warnings += [SAYS("starts-in-motion", r=r, speed=r.swing.initial[1][1]) for r in moving]
    of, dependent, ratio = _independent(data.system(orders), gauge, data.own)
    # What is left in the rows is all taken for noise, so that the bias is rather over- than understated.
    data = Data.of(data.rows, math.sqrt(min(max(ratio, 1.0), LOUDEST)))
    of = of._replace(system=data.system(orders))
    of = of._replace(scales=of.system.scales(of.gauge.beta(solve("tls", of)[0]), of.system.scales(data.own)))
    instruments = None
    if estimator == "iv":
        instruments, of = instruments_of(data, of, orders)
        if instruments is None:
            estimator = "huber"
            warnings.append(SAYS("no-instruments"))
    v, weights = solve(estimator, of, instruments)
    again = (of._replace(system=replace(of.system, W=W)) for W in of.system.noisy)  # the noise added once more
    noisier = np.array([solve(estimator, each, instruments)[0] for each in again])
    covariance = sandwich(of, instruments, v, weights, lags=overlap(data.rows[0]))
    # an encoder's rounding repeats with the motion, so that the residuals understate what it does
    variance = np.maximum(np.diag(covariance), np.var(noisier, axis=0, ddof=1)) + spread[list(of.gauge.free)] ** 2
    factor = np.sqrt(variance / np.maximum(np.diag(covariance), 1e-300))
    covariance = covariance * np.outer(factor, factor)
    noise = {n: max(float(r.swing.noise[i]) for r in data.rows) for i, n in enumerate(("theta", "alpha"))}
    amplitude = max(0.5 * float(np.ptp(r.swing.angles[:, 1])) for r in data.rows)
    units = {p.name: p.unit for p in data.model.parameters} | {"cable_offset": "N m"}
    own = {n: units[n] for n in data.names}
    constants = constants_of(own, of.gauge, v, bias_of(v, noisier), covariance=covariance, dependent=dependent)
    return estimated(
        of, v, weights, parameters=constants,
        combinations=_combinations(data.names, dependent, of.gauge.beta(v)), estimator=estimator, noise_ratio=ratio,
        noise=noise, amplitude=amplitude, belief=belief(amplitude, noise["alpha"], ratio), warnings=tuple(warnings),
        **how,
    )  # fmt: skip


def estimated(of: Scaled, v: FloatArray, weights: FloatArray, **others: Any) -> Regression:
    """The record of an estimate, with what it leaves in the rows."""
    system, gauge, scales = of
    A, beta = stack(system.W, scales)[:, gauge.free], gauge.beta(v)
    parts = np.split(weights, np.cumsum([len(W) for W in system.W])[:-1])
    return Regression(
        residuals={n: W @ beta for n, W in zip(system.equations, system.W, strict=True)},
        weights=dict(zip(system.equations, parts, strict=True)), fit_percent=fit_percents(system, beta),
        condition_number=float(np.linalg.cond(A / np.linalg.norm(A, axis=0))), samples=len(weights), **others,
    )  # fmt: skip


def _terms(swings: Sequence[Swing], asked: Asked) -> tuple[tuple[str, ...], dict[str, float]]:
    """Names of the columns, and those that are known: what is not looked for is as the model has it."""
    model, linear, fixed_values = asked.model, terms_of(asked.model), dict(asked.known)
    every = linear.names
    refuse_unknown("constant", every, *fixed_values, *asked.terms)
    for name, value in fixed_values.items():
        if not math.isfinite(value):
            raise InputError(f"known[{name!r}] = {value!r}: expected a finite number.")
    candidates = set(every if any(s.arm for s in swings) else linear.pendulum)
    looked = (set(asked.terms) - set(fixed_values)) & candidates
    if "cable_stiffness" in looked:
        looked.add("cable_offset")
    own = by_name(every, own_values(model, every)) | fixed_values
    if all(s.drive is None for s in swings):
        candidates.discard(model.drive)
        looked.discard(model.drive)
    elif own[model.drive] == 0.0:
        looked.add(model.drive)
    constants = {n: own[n] for n in every if n in candidates - looked and (own[n] != 0.0 or n in fixed_values)}
    if not looked:
        raise InputError("Every constant is known, so nothing is to be found: leave some out of known.")
    if not any(constants[n] for n in constants if n in (*linear.lumped, model.drive, *fixed_values)):
        example = linear.gauge if linear.gauge in looked else next(n for n in every if n in looked)
        raise InputError(SAYS("undriven", example=example, value=own[example], rig=model.source.split(".")[0]))
    return tuple(n for n in every if n in looked | set(constants)), constants


def _cutoff(swings: Sequence[Swing], cutoff: float | None) -> tuple[float, str]:
    """Cut-off of the low-pass [Hz] and why."""
    nyquist = 0.5 / max(s.step for s in swings)
    swing = max(s.frequency for s in swings)
    if cutoff is not None:
        if not 1.5 * swing < cutoff < 0.8 * nyquist:
            raise InputError(SAYS("cutoff", cutoff=cutoff, least=1.5 * swing, swing=swing, most=0.8 * nyquist,
                                  nyquist=nyquist))  # fmt: skip
        return float(cutoff), "as asked for"
    spectral = max(s.cutoff for s in swings)
    low, high = (factor * swing for factor in CUTOFF)
    high = math.inf if any(s.drive is not None for s in swings) else high  # a drive that jumps is no swing
    frequency = min(max(spectral, low), high, 0.8 * nyquist)
    where = f"the angles' spectrum comes down to ten times the noise at {spectral:.3g} Hz"
    if frequency == spectral:
        return frequency, where
    side = "at least" if frequency == low else "at most"
    return frequency, SAYS("clipped", where=where, side=side, factor=frequency / swing, swing=swing)


def _independent(system: System, gauge: Gauge, own: FloatArray) -> tuple[Scaled, Dependent, float]:
    """Take out what cannot be told apart (it keeps the model's value), and find the equations' scales."""
    basic, dependent = base_parameters(system, gauge.free, system.scales(own))
    if not basic:
        raise InputError("The motion shows none of the constants that are free: free another, or record more of it.")
    fixed = gauge.fixed.copy()
    fixed[list(dependent)] = own[list(dependent)]
    gauge = Gauge(tuple(basic), fixed)
    _, ratio, of = scaled_by_itself(system, gauge, own)
    return of, dependent, ratio


# --- in words ------------------------------------------------------------------------------------------------


def constants_of(
    units: Mapping[str, str], gauge: Gauge, v: FloatArray, bias: FloatArray, covariance: FloatArray,
    dependent: Dependent,
) -> dict[str, Constant]:  # fmt: skip
    """What each constant is worth; ``units`` has a name for each column."""
    names, beta = [*units], gauge.beta(v)
    errors = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    with np.errstate(all="ignore"):
        correlation = covariance / np.outer(errors, errors)
    constants = {}
    for i, name in enumerate(names):
        found: tuple[float | None, float | None] = None, None
        worth: Worth = "known", "known"
        if i in dependent:
            worth = _together([names[j] for j in dependent[i]])
        elif i in gauge.free:
            k = gauge.free.index(i)
            dependents = [names[j] for j, combination in dependent.items() if i in combination]
            close = [names[gauge.free[j]] for j in np.flatnonzero(np.abs(correlation[k]) > 0.97) if j != k]
            found = float(errors[k]), float(bias[k])
            worth = _verdict(float(beta[i]), *found, dependents, close)
        constants[name] = Constant(float(beta[i]), units[name], *found, *worth)
    return constants


def _together(partners: Sequence[str], why: str = "") -> Worth:
    if partners:
        return "only together", f"only together with {', '.join(partners)}{why}"
    return "not excited", f"not excited{why or ': its column is empty'}"


def _verdict(value: float, error: float, bias: float, dependents: Sequence[str], close: Sequence[str]) -> Worth:
    """Say in words what the data know of a constant."""
    if dependents:
        return _together(dependents)
    if abs(bias) > max(0.1 * abs(value), error):
        way = "lowers" if bias * value < 0.0 else "raises"
        percent = 100 * abs(bias / (value - bias)) if value != bias else math.inf
        part = f"about {percent:.0f} %" if percent < 100 and abs(bias) < abs(value) else "half or more"
        return "biased", f"biased: noise in the columns {way} it by {part}"
    if math.hypot(error, bias) > 0.2 * abs(value):
        return _together(close, f": its standard error is {100 * error / max(abs(value), 1e-300):.0f} % of it")
    return "identified", "identified"


def _combinations(names: Sequence[str], dependent: Dependent, beta: FloatArray) -> dict[str, float]:
    """Each basic constant with the dependent ones that it takes in, by its readable name."""
    combinations = {}
    for i in sorted({i for combination in dependent.values() for i in combination}):
        parts = [(c[i], j) for j, c in dependent.items() if i in c]
        name = names[i] + "".join(f" {'+' if c > 0 else '-'} {abs(c):.3g} {names[j]}" for c, j in parts)
        combinations[name] = float(beta[i] + sum(c * beta[j] for c, j in parts))
    return combinations


def doubted(regression: Regression, late: bool, estimator: str) -> Regression:
    """Take back the verdicts of constants whose orders are not seen, or whose equations do not fit.

    ``late`` is a search in a record that starts in motion: what is missing from the memory passes for an order.
    Where another estimator than the one asked for was taken, for there are no instruments, the estimate does not
    even reproduce the motion: its own bias says too little then.
    """
    wide = {n: i for n, i in regression.intervals.items() if i[1] - i[0] > WIDE}
    poor = {n: percent for n, percent in regression.fit_percent.items() if percent < POOR}
    messages: list[str] = [SAYS("non-identifiable", n=n, low=low, high=high) for n, (low, high) in wide.items()]
    messages += [f"The {n}'s equation fits by {p:.0f} % only: the model lacks something." for n, p in poor.items()]
    why = [f"moves with {' and '.join(wide)}, practically non-identifiable here"] if wide else []
    why += ["moves with the orders, which a start in motion falsifies"] if late else []
    why += [f"the {n}'s equation does not fit" for n in poor]
    why += ["its simulated response is not like the measured one"] if regression.estimator != estimator else []
    constants = {n: replace(c, kind="in doubt", verdict=why[0]) if why and c.identified else c
                 for n, c in regression.parameters.items()}  # fmt: skip
    return replace(regression, parameters=constants, warnings=(*regression.warnings, *messages))


# --- as the start of a fit -----------------------------------------------------------------------------------


def start_values(problem: Problem, *, estimator: Estimator = "iv") -> tuple[FloatArray, Regression]:
    """Return a start for :func:`fracid.identify` and the regression that it comes from.

    What the problem leaves free is looked for; what it fixes is known.  Where everything is free and nothing
    drives the recordings, C4 is taken from its start.  The orders are not searched, but left at their start, where
    a recording starts in motion.

    Parameters
    ----------
    problem : Problem
        Of a rotary pendulum, with α among its outputs.
    estimator : as in :func:`regress`

    Returns
    -------
    x : ndarray, shape (n_unknowns,)
        ``problem.start`` with the searched orders and those constants that the regression calls identified,
        within their bounds.  Initial states and what recordings have for themselves stay.
    Regression

    Raises
    ------
    InputError
        As :func:`regress`; if the model is another; if none of the free unknowns stands in the regression.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment, Free, Problem
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 1.0, "mu": 1.0}, initial={"alpha": 1.0}, step=1e-3, end=5.0)
    >>> swing = Experiment("twin", 1e-3, run.states[:, [0, 2]], np.zeros((1, 1)))
    >>> problem = Problem(rig, (swing,), {"lambda": 1.0, "mu": 1.0}, {"C1": Free(8e-3, 1e-3, 1e-1)})
    >>> x, found = start_values(problem)
    >>> bool(abs(x[0] / rig.parameter("C1").value - 1) < 0.01)
    True
    """
    asked = Asked.by(problem)
    if not asked.terms:
        raise InputError(SAYS("none-free", names=", ".join(terms_of(problem.model).names)))
    swings = [swing_of(_recording(e, problem), asked.model, e) for e in problem.experiments]
    regression = asked.settled(swings, "project").of(swings, estimator)
    return start_of(problem, regression), regression


def start_of(problem: Problem, regression: Regression) -> FloatArray:
    """The start of a problem with what a regression found put in, shape (n_unknowns,).

    Parameters
    ----------
    problem : Problem
    regression : Regression
        Of its recordings.  What it calls identified is taken, within the bounds, with the orders that it belongs to:
        those given, and those searched whose interval is narrow enough to say something.

    Examples
    --------
    See :func:`start_values`.
    """
    intervals = regression.intervals
    best = {n: c.value for n, c in regression.parameters.items() if c.identified}
    best |= {n: v for n, v in regression.orders.items() if n not in intervals or np.ptp(intervals[n]) < WIDE}
    if "cable_stiffness" in best:
        best |= theta_rest_of({n: c.value for n, c in regression.parameters.items()})
    shared = {n for n, u in zip(problem.names, problem.unknowns, strict=True) if u.experiment is None}
    return problem.space.clipped(problem.point({n: v for n, v in best.items() if n in shared}))


def _recording(e: Experiment, problem: Problem) -> Recording:
    """An experiment's angles and inputs by the problem's names."""
    model, inputs = problem.model, np.broadcast_to(e.inputs, (len(e.measured), e.inputs.shape[1]))
    angles = {n: y for n, y in zip(problem.outputs, e.measured.T, strict=True) if n in model.angles}
    driven = {n: u for n, u in zip(model.inputs, inputs.T, strict=True)}
    return Recording.of(e.name, e.start + e.time, angles | driven, {n: si_unit(model.input_unit(n)) for n in driven})
