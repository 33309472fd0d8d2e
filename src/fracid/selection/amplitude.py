r"""Is an order friction in disguise?  One of the equations stays as the swing dies; an imitation drifts.

In a swing of amplitude A against a stiffness k, a viscous friction b, a dry friction F and a drag d take in one period

.. math::  W = π b ω A^2, \qquad W = 4 F A, \qquad W = \tfrac83 d\, ω^2 A^3,

and a damping ratio ζ takes :math:`W = 2π ζ k A^2`.  Two states of order q next to 1 turn the root iω by
:math:`\tfrac{π}{2}(1 - q)` out of the imaginary axis.  So a model of viscous friction whose order is free finds, next
to a swing of amplitude A,

.. math::  \frac{π}{2}\,(1 - q) = ζ_b' + \frac{2F}{π k A} + \frac{4 d\,ω^2 A}{3π k},

where :math:`ζ_b'` is what the viscous friction of the model lacks: **dry friction makes the order fall as the swing
dies, as 1/A, a drag makes it rise; an order that is real stays.**

The test takes the viscous friction of a fit as it is, cuts each recording into windows of falling amplitude, and in
each fits the orders again, with the initial state, with the constants that are no friction (a frequency must not speak
for the damping), and with other friction that the model has, as near to its value as the fit knows it.  What came
before a window enters its memory (:mod:`fracid.problem.past`).  Recordings of different heights are compared as
wholes too.  With orders :math:`q_i`, standard errors :math:`s_i` and their weighted mean q,

.. math::  Q = \sum_i (q_i - q)^2 / s_i^2

is a χ² of n − 1 degrees where the order is one [C]_.  An order **drifts with amplitude** if Q has a probability below
1 %, if a line in 1/A or in A takes at least half of it, and if it changes by 0.002 or more.

Driven recordings have no amplitude that falls, and are left out.

References
----------
.. [C] W. Cochran, Biometrics 10 (1954) 101: the combination of estimates.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from typing import Annotated, Any

import numpy as np
from pydantic import Field, computed_field

from fracid.arrays import ByName, FloatArray, by_name
from fracid.cards import CardDisplay
from fracid.errors import Failure, InputError, at_least
from fracid.estimation.climbing import embedded, found_again
from fracid.estimation.covariance import uncertainty
from fracid.estimation.horizons import Watch, lowest_from, refined, uninterrupted
from fracid.estimation.windows import piece
from fracid.figures import Figure, Style, draw
from fracid.findings import Words
from fracid.optimise import Outcome
from fracid.problem import Experiment, Free, Prior, Problem, Tied
from fracid.problem.coarse import as_samples
from fracid.problem.unknowns import Value
from fracid.safety.schema import Infinite, Listed, Record, computed
from fracid.selection.ladder import ORDER
from fracid.signals.resolution import resolution
from fracid.signals.swing import envelope, swing_period
from fracid.units import shown_unit, with_unit

SAYS = Words("selection/amplitude.toml")

PROBABILITY = 0.01
"""Orders differ where chance would make them differ so much less often than this."""

EXPLAINED = 0.5
"""The part of their differences that amplitude must explain."""

CHANGE = 2e-3
"""An order that changes by less does not matter."""

SEARCH: Mapping[str, Any] = {"tolerance": 1e-5, "budget": 40}
"""Least squares of a window from the minimum of the whole."""

STUCK = 0.5
"""Where that leaves so much of the cost it may be stuck beside runs that fail: from the problem's start, too."""

FLOOR = 0.03
"""Below this part of the largest amplitude the swing has died."""

LEAST_SCORED = 0.5
"""A window of which a smaller part counts is left out."""

COUNTS = 20.0
"""Below so many steps of its encoder rounding bends an output as friction does, and it tells of no order."""

SWINGS = 2.0
"""A window has so many at least."""

TIGHT = 0.05
"""Standard deviation of the prior that holds a constant near its fitted value, relative to it: it decides only what
the window does not see."""

RELEASES = "releases"
"""The drift over whole recordings."""


@dataclass(frozen=True)
class Window(Record):
    """A stretch of a recording, and the orders found in it."""

    recording: str
    start: Annotated[float, Field(alias="from")]
    """On the recording's own clock [s]."""
    end: Annotated[float, Field(alias="to")]
    """[s]"""
    whole: bool
    """Whether it is the recording as it was fitted."""
    amplitude: ByName
    """Order → mean amplitude of an output whose state has it [its unit]."""
    orders: ByName
    standard_errors: Mapping[str, Infinite]
    """Infinite where the window does not tell."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Order → the unit of its amplitude; rad where it says nothing."""


@dataclass(frozen=True)
class Drift(Record):
    """How an order goes with amplitude."""

    order: str
    over: str
    """A recording, over its windows; or ``releases``."""
    amplitudes: Listed[float]
    """Falling [unit]."""
    values: Listed[float]
    """The order at each."""
    standard_errors: Listed[Infinite]
    probability: float
    """Of differences as great as these, if the order were one."""
    explained: float
    """The part of them that a line in 1/A or in A takes."""
    change: float
    """Along that line, from the largest amplitude to the smallest."""
    unit: str = "rad"
    """Of the amplitudes."""

    @computed
    def drifts(self) -> bool:
        """Whether it changes with amplitude by more than its intervals."""
        return self.differs and self.explained >= EXPLAINED and abs(self.change) >= CHANGE

    @property
    def differs(self) -> bool:
        """Whether it is not one number, whatever the reason."""
        return self.probability < PROBABILITY and max(self.values) - min(self.values) >= CHANGE

    @computed
    def sentence(self) -> str:
        """What it means."""
        where = "over the releases" if self.over == RELEASES else f"within {self.over}"
        largest, smallest = (_shown(self.amplitudes[i], self.unit) for i in (0, -1))
        ends = f"from {self.values[0]:.4g} at {largest} to {self.values[-1]:.4g} at {smallest}"
        if self.drifts:
            return SAYS("falls" if self.change < 0 else "rises", order=self.order, where=where, ends=ends)
        least, most = min(self.values), max(self.values)
        if self.differs:
            return SAYS("differs", order=self.order, where=where, least=least, most=most)
        return SAYS("steady", order=self.order, where=where, spread=most - least)


@dataclass(frozen=True, repr=False)
class AmplitudeTest(CardDisplay, Record):
    """The result of :func:`amplitude_test`."""

    windows: Listed[Window]
    drifts: Listed[Drift]
    notes: Listed[str] = ()
    """What could not be tested."""

    @computed_field(alias="friction_in_disguise")
    def disguised(self) -> bool:
        """Whether any order drifts."""
        return any(d.drifts for d in self.drifts)

    @computed
    def sentences(self) -> tuple[str, ...]:
        """What it means, in words."""
        return (*(d.sentence for d in self.drifts), *self.notes)

    def plot(self, *, style: str | Style = "screen") -> Figure:
        """Each order over amplitude; see :func:`fracid.plots.amplitudes`.

        Parameters
        ----------
        style : str or Style
            ``screen``, ``journal`` or one's own; see :mod:`fracid.figures`.

        Examples
        --------
        >>> drift = Drift("mu", "release", (0.5, 0.1), (0.99, 0.95), (1e-3, 2e-3), 1e-9, 1.0, -0.04)
        >>> AmplitudeTest((), (drift,)).plot().axes[0].get_ylabel()
        'order $\\\\mu$ [–]'
        """
        return draw("amplitudes", self, style=style)


def amplitude_test(
    problem: Problem, x: FloatArray, *, others: Sequence[Experiment] = (), windows: int = 5, jobs: int = 1
) -> AmplitudeTest:
    """Fit the orders in windows of falling amplitude, and over recordings, with the friction of a fit.

    Parameters
    ----------
    problem : Problem
        Any structure; where its orders are fixed they are freed.
    x : array, shape (n_unknowns,)
        Its fit.
    others : sequence of Experiment
        Held-out recordings.
    windows : int
        Of each recording at most; fewer where it has less than two swings for each.
    jobs : int
        Threads.

    Returns
    -------
    AmplitudeTest

    Raises
    ------
    InputError
        For fewer than two windows, or a cost of a user's own, which has no intervals.

    Examples
    --------
    >>> import fracid
    >>> rig = fracid.rotary_pendulum("stepper-freeswing", coulomb_alpha=5e-5)
    >>> run = fracid.simulate(rig, orders={"lambda": 1.0, "mu": 1.0}, initial={"alpha": 0.5}, step=1e-2, end=14.0)
    >>> noise = 1e-3 * np.random.default_rng(1).standard_normal((1401, 1))
    >>> swing = Experiment("swing", 1e-2, run.states[:, [2]] + noise, np.zeros((1, 1)), initial={"alpha": 0.5})
    >>> viscous = {"b_alpha": Free(1e-5, 0.0, 1e-3), "coulomb_alpha": 0.0, "C1": Free(1e-4, 1e-5, 1e-3)}
    >>> problem = Problem(rig, (swing,), {"lambda": 1.0, "mu": Free(1.0, 0.8, 1.2)}, viscous, outputs=("alpha",),
    ...                   initial_state="held")
    >>> fit = fracid.identify(problem)
    >>> test = amplitude_test(problem, fit.x, windows=3)
    >>> test.disguised, test.drifts[0].values[0] > test.drifts[0].values[-1]
    (True, True)
    """
    at_least("windows", windows, 2)
    if problem.cost_function.loss is None:
        raise InputError(SAYS("own-cost", problem=problem))
    problem = replace(problem, experiments=tuple(map(as_samples, problem.experiments)))
    others = [*map(as_samples, others)]
    alone = [replace(problem, experiments=(e,)) for e in others]
    fits = [(problem, x, e) for e in problem.experiments]
    fits += [(p, found_again(problem, x, p, Watch(jobs)), p.experiments[0]) for p in alone]
    errors = _standard_errors(problem, x, jobs)
    found = list[Window | str]()
    for fitted, at, e in fits:
        spans = _spans(e, windows)
        if isinstance(spans, str):
            found.append(spans)
            continue
        spans += [(0, len(e.measured))] * (len(fits) > 1)
        told = [span for span in spans if np.mean(np.any(e.scored[slice(*span)], axis=1)) >= LEAST_SCORED]
        found += [_window(fitted, at, e, span, fit_errors=errors, jobs=jobs) for span in told]
    window_fits = tuple(window for window in found if isinstance(window, Window))
    notes = tuple(why for why in found if isinstance(why, str))
    return AmplitudeTest(window_fits, tuple(_drifts(window_fits)), notes)


# --- windows -----------------------------------------------------------------------------------------------


def _standard_errors(problem: Problem, x: FloatArray, jobs: int) -> dict[str, float]:
    found = uncertainty(problem, x, jobs=jobs)
    return {} if isinstance(found, Failure) else problem.named(found.standard_error)


def _spans(e: Experiment, windows: int) -> list[tuple[int, int]] | str:
    """First and last + 1 sample of windows of equal length while the swing lives; or why there are none."""
    if e.driven:
        return f"{e.name} is driven: it has no amplitude that falls."
    swing = e.measured[:, np.argmax(np.std(e.measured, axis=0))]
    period = _whole_period(swing)
    size = envelope(swing, period)
    floor = max(FLOOR * float(size.max()), COUNTS * (resolution(swing) or 0.0))
    alive = int(np.flatnonzero(size > floor)[-1]) + 1 if size.max() > floor else 0
    count = min(windows, int(alive / (SWINGS * period)))
    if count < 2:
        return SAYS("few-swings", name=e.name, swings=SWINGS)
    return list(pairwise(np.linspace(0, alive, count + 1).round().astype(int).tolist()))


def _whole_period(swing: FloatArray) -> int:
    """The period [samples], the whole signal where it does not swing."""
    return max(2, round(min(swing_period(swing), swing.size)))


def _piece(problem: Problem, x: FloatArray, e: Experiment, span: tuple[int, int], errors: ByName) -> Problem:
    """The window's own problem: orders, initial state and constants free, viscous friction as fitted."""
    (first, last), (orders, parameters) = span, _window_values(problem, x, e, errors)
    part, state = piece(e, e.name, first, last), problem.initial_state
    if first > 0:
        before = e.measured[:first] if e.past is None else np.vstack([e.past, e.measured[:first]])
        part, state = replace(part, past=before, past_inputs=part.inputs[:1]), "estimate"
    else:
        part = replace(e, measured=part.measured, inputs=part.inputs, deviation=part.deviation,
                       release_time=problem.unpack(x, e).release)  # fmt: skip
    of = partial(replace, problem, orders=orders, parameters=parameters, per_recording=(), initial_state=state)
    with suppress(InputError):  # of a past that does not tell every state: the window's memory begins with it
        return of(experiments=(part,))
    return of(experiments=(replace(part, past=None, past_inputs=None),))


Values = dict[str, Value]
"""Name → what an order or a constant of a window is: a number, free or tied."""


def _window_values(problem: Problem, x: FloatArray, e: Experiment, errors: ByName) -> tuple[Values, Values]:
    """Orders free; constants near their values, friction as near as the fit knows it, viscous friction at its value."""
    order_values, values, *_ = problem.unpack(x, e)
    at = by_name(problem.model.orders, order_values)
    any_free = any(isinstance(v, Free) for v in problem.orders.values())
    orders: Values = {}
    for name, v in problem.orders.items():
        span = v if isinstance(v, Free) else ORDER
        fixed = isinstance(v, Tied) or (any_free and not isinstance(v, Free))
        orders[name] = (v if isinstance(v, Tied) else at[name]) if fixed else _around(at[name], span)
    parameters: Values = dict(zip(problem.model.parameter_names, values.tolist(), strict=True))
    kinds = problem.model.friction
    # held: it and the order are one to a single swing, and an error of it moves the order of all windows alike
    viscous = {name for name, kind in kinds.items() if kind.power == 1}
    for name, v in problem.parameters.items():
        if isinstance(v, Tied):
            parameters[name] = v
        elif isinstance(v, Free) and name not in viscous and name not in problem.per_recording:
            value = float(values[problem.model.parameter_names.index(name)])
            sd = TIGHT * max(abs(value), 1e-3 * min(v.upper - v.lower, 1.0))
            sd = errors.get(name, math.nan) if name in kinds else sd
            if sd > 0:
                parameters[name] = replace(_around(value, v), prior=Prior(value, sd))
    return orders, parameters


def _around(value: float, span: Free) -> Free:
    return Free(value, min(span.lower, value), max(span.upper, value), scale=span.scale)


def _window(
    problem: Problem, x: FloatArray, e: Experiment, span: tuple[int, int], fit_errors: ByName, jobs: int
) -> Window | str:
    """The fit of one window, or that its run fails."""
    piece, times = _piece(problem, x, e, span, errors=fit_errors), e.start + e.step * np.array([span[0], span[1] - 1])
    start = piece.point(problem.named(x) if span[0] == 0 else {})  # its initial state too
    found, whole = uninterrupted(refined(piece, start, Watch(jobs), **SEARCH)), span == (0, len(e.measured))
    best = found.best
    if not whole and (found.outcome is not Outcome.CONVERGED or best.cost > STUCK * piece.cost(start)):
        shared = {u.name: v for u, v in zip(problem.unknowns, problem.start, strict=True) if u.experiment is None}
        again = embedded(piece, piece.named(start) | shared)
        best = min(best, lowest_from(piece, again, Watch(jobs), **SEARCH), key=lambda end: end.cost)
    if not math.isfinite(best.cost):
        return f"{e.name}, {times[0]:.3g} … {times[1]:.3g} s: no order was found, the run fails."
    errors = _standard_errors(piece, best.point, jobs)
    orders = {n: float(best.point[i]) for n, i in piece.free_orders.items()}
    measured, told = piece.experiments[0].measured, {n: _told_by(piece, n) for n in orders}
    period = _whole_period(measured[:, np.argmax(np.std(measured, axis=0))])
    swings = {o: float(np.mean(envelope(y, period))) for o, y in zip(piece.outputs, measured.T, strict=True)}
    least = {o: COUNTS * (resolution(y) or 0.0) for o, y in zip(piece.outputs, e.measured.T, strict=True)}
    sizes = {n: max(swings[o] for o in own) for n, own in told.items()}
    stills = {n: max(least[o] for o in own) for n, own in told.items()}
    units = {n: e.units.get(own[0], "rad") for n, own in told.items()}
    known = {n: s for n, s in errors.items() if n in orders and s > 0 and sizes[n] > stills[n]}
    return Window(e.name, float(times[0]), float(times[1]), whole, amplitude=sizes, orders=orders,
                  standard_errors={n: known.get(n, math.inf) for n in orders}, units=units)  # fmt: skip


def _told_by(piece: Problem, order: str) -> list[str]:
    """The scored outputs whose states have an order, all where none has; of several units those of the first's."""
    states, orders, units = piece.model.output_states, piece.model.orders, piece.experiments[0].units
    own = [o for o in piece.outputs if o in states and orders[states[o]] == order] or [*piece.outputs]
    return [o for o in own if units.get(o, "rad") == units.get(own[0], "rad")]


# --- drifts --------------------------------------------------------------------------------------------------


def _drifts(windows: Sequence[Window]) -> Iterator[Drift]:
    names = dict.fromkeys(w.recording for w in windows)
    groups = {name: [w for w in windows if w.recording == name and not w.whole] for name in names}
    groups |= {RELEASES: [w for w in windows if w.whole]}
    for over, group in groups.items():
        for order in dict.fromkeys(n for w in group for n in w.orders):
            yield from _drift(order, over, group)


def _drift(order: str, over: str, group: Sequence[Window]) -> Iterator[Drift]:
    """How an order goes with amplitude over windows, of which two at least tell it."""
    informative = [w for w in group if math.isfinite(w.standard_errors.get(order, math.inf))]
    informative.sort(key=lambda w: -w.amplitude[order])
    if len(informative) > 1:
        A, q, s = np.array([(w.amplitude[order], w.orders[order], w.standard_errors[order]) for w in informative]).T
        probability, explained, change = trend(A, q, s)
        yield Drift(order, over, tuple(A.tolist()), tuple(q.tolist()), standard_errors=tuple(s.tolist()),
                    probability=probability, explained=explained, change=change,
                    unit=informative[0].units.get(order, "rad"))  # fmt: skip


def trend(A: FloatArray, q: FloatArray, s: FloatArray) -> tuple[float, float, float]:
    """Probability of Q, the part of Q that a line in 1/A or A takes, and the change along it from first to last.

    Examples
    --------
    >>> A = np.array([0.8, 0.4, 0.2, 0.1])
    >>> probability, explained, change = trend(A, 1 - 0.004 / A, np.full(4, 1e-3))
    >>> probability < 1e-6, round(explained, 3), round(change, 4)
    (True, 1.0, -0.035)
    """
    from scipy.stats import chi2

    def about(*columns: FloatArray) -> tuple[float, FloatArray]:
        rows = np.column_stack([np.ones_like(q), *columns]) / s[:, None]
        line = np.column_stack([np.ones_like(q), *columns]) @ np.linalg.lstsq(rows, q / s, rcond=None)[0]
        return float(np.sum(((q - line) / s) ** 2)), line

    Q, _ = about()
    rest, line = min((about(1 / A), about(A)), key=lambda fit: fit[0])
    return float(chi2.sf(Q, len(q) - 1)), 1 - rest / Q if Q > 1e-9 else 0.0, float(line[-1] - line[0])


def _shown(amplitude: float, unit: str) -> str:
    return with_unit(amplitude, unit, ".0f" if amplitude * shown_unit(unit)[1] >= 10 else ".2g")
