r"""Are the orders real, or friction that the model lacks?  The integer-order rival of a fractional fit.

An order below 1 damps like a viscous friction of :math:`\zeta \approx \tfrac{\pi}{2}(1 - \mu)`, so whoever fixes the
friction at a nominal value, or leaves dry friction out, finds fractional orders in the recording of an integer-order
rig.  No interval shows it: the orders *are* the best of that model.  Another model has to be tried.

So where a fit finds an order off 1, the same recordings are fitted again with every order 1 and with viscous and dry
friction free on each joint, solved with ``pi2``, by the same search; and where all friction is free already, with
every order 1 and nothing else, for of a hundred intervals of 95 % five miss 1 where it is true.  The two are compared
by Schwarz's criterion, with the samples that correlated residuals are worth (:mod:`fracid.selection.bic`):

.. math::  \text{gain} = \mathrm{BIC}_{integer} - \mathrm{BIC}_{fractional} .

A gain above 10 is strong evidence for the fractional model against this one rival; below, the orders are no
evidence of fractional dynamics, and the fit says so.

**What is integer.**  A model says what its orders are without fractional calculus (``Model.integer_orders``), 1 where
it says nothing.  With r = 1 − q, of a damper :math:`z = D^q x` written as :math:`D^r z = x'`, the dashpot is r = 0 and
r = 1 a spring, no fair rival.  An order of which no integer value makes sense stays as free as it was, and where that
is so of all there is no rival.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from pydantic import Field

from fracid.arrays import ByName, FloatArray, joined, run_lengths
from fracid.errors import Failure
from fracid.estimation.climbing import embedded, without
from fracid.estimation.horizons import Watch, growing, uninterrupted
from fracid.estimation.long_records import on_all_samples
from fracid.estimation.parameter_verdicts import STILL
from fracid.estimation.windows import shared_values
from fracid.models.base import NEAR_0
from fracid.models.friction import SPRINGPOT
from fracid.optimise import Evaluation
from fracid.problem import Free, Problem
from fracid.problem.unknowns import Value
from fracid.safety.schema import Beside, Infinite, Listed, Record, Unknown
from fracid.selection import coloured_noise
from fracid.selection.bic import EVEN, STRONG, schwarz
from fracid.selection.residual_noise import leftovers
from fracid.signals.correlation import effective_samples
from fracid.units import letter

UNSEEN = 1e-2
"""A friction that changes the residuals by less than this part is not seen."""

FEW = 2
"""Relaxations that an order must beat by :data:`WORTH`."""

WORTH = 14.0
"""Of BIC.  Of 252 twins of integer order one is called fractional at 12, at 13.0, and none at 14; of 79 orders that are
determined 74 at 12, 71 at 14, 64 at 18.  The others are worth less: one or two relaxations do as well."""

AT_END = 1e-3
"""Part of a range, within which of an end a value is at its limit."""

OFF = 1e-3
"""Orders nearer to their integer value than this are integer."""


GAIN = Field(alias="bic_gain_of_the_fractional_model")


@dataclass(frozen=True)
class Trial(Record):
    """One thing of integer order that was tried in place of the orders."""

    name: str
    """``friction``, ``a delay of alpha``."""
    cost: Infinite
    """Infinite where it was not tried, for something else contradicts the orders already."""
    gain: Annotated[Infinite, GAIN]
    """BIC of it minus that of the fractional fit."""
    as_well: bool = False
    """Whether it explains the recordings nearly as well as the orders do: nothing strong speaks for these."""
    as_good: Beside[bool] = field(default=False, compare=False)
    """Whether nothing speaks for the orders."""


@dataclass(frozen=True)
class FiniteMemory(Record):
    """What a few relaxations do in the place of the orders (:mod:`fracid.selection.finite_memory`)."""

    relaxations: int
    """Of each order."""
    cost: Infinite
    """Infinite where no run of it ends."""
    gain: Annotated[Infinite, GAIN]
    """BIC of it minus that of the fractional fit."""
    settles: bool = True
    """Whether no time constant is at its limit, and nothing but noise is left; asked only of who comes near."""

    @property
    def as_well(self) -> bool:
        """Whether the orders are not strongly better; of many relaxations, which imitate any order, not better."""
        return self.gain <= (WORTH if self.relaxations <= FEW else 0.0)


@dataclass(frozen=True)
class Alternative(Record):
    """The integer-order model that comes nearest, beside the fractional one that was asked for."""

    structure: str
    """In words."""
    orders: Listed[str]
    """The orders that were found off their integer values, and those tied to them."""
    cost: Infinite
    """Its cost, beside :attr:`fracid.fit.Fit.cost`."""
    parameters: Mapping[str, Unknown]
    """The friction that it finds beside what was free already, and what else it has [SI]; empty where all was free."""
    gain: Annotated[Infinite, GAIN]
    """BIC of this one minus that of the fractional fit; above 10 the fractional one has it."""
    effective_samples: Unknown
    """What the correlated residuals are worth."""
    warning: str = ""
    """A sentence, where the fractional model does not win."""
    trials: Listed[Trial] = ()
    """All that was tried."""
    values: Beside[ByName] = field(default_factory=dict, compare=False)
    """Its unknowns, and the orders at their integers: from where a fit that costs more goes on."""
    settles: bool = True
    """Whether it is as good, at no limit of its own, and leaves nothing but noise."""
    memories: Listed[FiniteMemory] = ()
    """One relaxation, two, three in the place of the orders, up to the first that does as well; empty where something
    else does, or contradicts the orders."""
    cut: bool = False
    """Whether it was not all tried, for that takes too long beside the search."""
    judged: Beside[tuple[str, str] | None] = field(default=None, compare=False)
    """Where the fractional model does not win, what explains the recordings, and what follows: of :attr:`warning`."""


def beside_fit(nearest: Alternative, orders: ByName, problem: Problem, here: float, there: float) -> Alternative:
    """Its costs and its sentence beside the orders of a fit that costs `there`, and on what it was compared `here`.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment
    >>> still = Experiment("still", 0.1, np.zeros((9, 2)), np.zeros((1, 1)))
    >>> problem = Problem(fracid.rotary_pendulum(), (still,), {"lambda": 1.0, "mu": 1.0})
    >>> nearest = Alternative("every order 1", ("mu",), 2.0, {}, 5.0, 100.0, judged=("With every order 1", ""))
    >>> beside_fit(nearest, {"mu": 0.95}, problem, 4.0, 2.0).warning
    'μ = 0.95: ... With every order 1 explains ... nearly as well: it costs 1, this one 2, and has a BIC ...'
    """

    def of_fit(cost: float) -> float:
        return float(on_all_samples(problem, np.array(cost), here, there))

    warning, other = "", of_fit(nearest.cost)
    if nearest.judged is not None:
        what, follows = nearest.judged
        values = " and ".join(f"{letter(n)} = {orders[n]:.4g}" for n in nearest.orders if n in orders)
        explains = _beside(other, there, nearest.gain)
        strong = "strong " * (nearest.gain > EVEN)
        warning = f"{values}: no {strong}evidence of fractional dynamics. {what} {explains}.{follows}"
    trials = tuple(replace(t, cost=of_fit(t.cost)) for t in nearest.trials)
    memories = tuple(replace(m, cost=of_fit(m.cost)) for m in nearest.memories)
    return replace(nearest, cost=other, warning=warning, trials=trials, memories=memories)


@dataclass(frozen=True)
class Rival:
    """An integer-order problem and its minimum."""

    problem: Problem
    evaluation: Evaluation
    integers: str
    """``every order 1``."""
    off: ByName
    """The orders that were found off their integer values."""
    own: tuple[str, ...] = ()
    """What it frees beside what the fractional problem does."""
    elements: tuple[str, ...] = ()
    """What it has beside friction, in words."""
    nested: bool = True
    """Whether it is the fractional model where its orders are integer; not one that the project names."""

    @property
    def limited(self) -> bool:
        """Whether something that it has beside the model is at a limit, other than off."""
        at = zip(self.problem.unknowns, self.evaluation.point.tolist(), strict=True)
        return any(abs(v - end) <= AT_END * (u.range.upper - u.range.lower) for u, v in at if u.target in self.own
                   for end in (u.range.lower, u.range.upper) if end != 0.0)  # fmt: skip

    @property
    def settles(self) -> bool:
        """Whether it explains the recordings: it is at no limit, and leaves nothing but noise."""
        return not self.limited and all(e.noise for e in leftovers(self.problem, self.evaluation.point).values())

    @property
    def structure(self) -> str:
        """``every order 1; b_theta, b_alpha free; a delay of alpha``."""
        free = [f"{', '.join(self.own)} free"] * bool(self.own)
        return "; ".join((self.integers, *free, *self.elements))

    @property
    def values(self) -> dict[str, float]:
        """Its unknowns by name [SI]."""
        return self.problem.named(self.evaluation.point)

    def nested_in(self, problem: Problem) -> dict[str, float]:
        """Where a problem is this model: its unknowns, the orders at their integers, springpots off; else nothing."""
        if not self.nested:
            return {}
        orders = {n: v for n, v in integer_values(problem).items() if isinstance(v, float | int)}
        off = {n: problem.model.friction[n].off for n in springpots(problem)}
        ends = {n: self.problem.parameter_starts[n] for n in complements(problem) if n not in off}
        return {**self.values, **orders, **off, **ends}

    @property
    def parameters(self) -> dict[str, float]:
        """Those of what it frees; where each recording has its own, their median."""
        return {n: v for n, v in shared_values(self.problem, self.evaluation.point).items() if n in self.own}


def integer_rival(problem: Problem, best: Evaluation, widths: ByName, *, watch: Watch | None = None) -> Rival | None:
    """Fit the problem with integer orders and its friction free.

    Parameters
    ----------
    problem : Problem
    best : Evaluation
        Its minimum.
    widths : mapping
        Half the 95 % interval of each free order.
    watch : Watch, optional
        Of the searches that this is one of.

    Returns
    -------
    Rival or None
        None where every order is integer within its interval, or no run of the rival ends.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 1.0, "mu": 1.0}, parameters={"coulomb_alpha": 2e-3},
    ...                       initial={"alpha": 0.5}, step=4e-3, end=4.0)
    >>> swing = Experiment("twin", 4e-3, run.states[:, [0, 2]], np.zeros((1, 1)))
    >>> problem = Problem(rig, (swing,), {"lambda": 1.0, "mu": Free(0.97, 0.5, 1.2)}, initial_state="held")
    >>> best = problem.evaluate(problem.start)
    >>> rival = integer_rival(problem, best, {"mu": 0.001})
    >>> round(rival.parameters["coulomb_alpha"], 5), gain_over(rival, problem, best)[1] < 0
    (0.002, True)
    """
    off = {n: v for n, v in claimable_values(problem, best.point).items() if is_off(problem, n, v, widths.get(n, 0.0))}
    if not off or best.residuals is None:
        return None
    whole = without(problem, springpots(problem))
    ranges = _seen(whole, best, freed_friction(whole)) if whole.names == problem.names else freed_friction(whole)
    rivals = []
    for end in (0.0, 1.0 - NEAR_0) if complements(whole) else (0.0,):  # a spring or a dashpot, if they are springpots
        fixed = dict.fromkeys(complements(whole), end)
        rival = replace(whole, parameters={**whole.parameters, **ranges, **fixed}, method="pi2",
                        orders=integer_values(whole),
                        per_recording=tuple(n for n in whole.per_recording if n not in fixed))  # fmt: skip
        as_found = embedded(rival, problem.named(best.point))
        integer = uninterrupted(growing(rival, rival.start, watch or Watch(), also=(as_found,))).best
        in_words = "; ".join([f"{n} = {end:.0f}" for n in fixed] or [_in_words(problem)])
        rivals.append(Rival(rival, integer, in_words, off, own=tuple(ranges)))
    nearest = min(rivals, key=lambda r: r.evaluation.cost)
    return None if nearest.evaluation.residuals is None else nearest


def complements(problem: Problem) -> tuple[str, ...]:
    """The free parameters ν of orders 1 − ν."""
    names = (problem.model.parameter_names[k] for _, k in problem.model.complements)
    return tuple(n for n in names if isinstance(problem.parameters.get(n), Free))


def springpots(problem: Problem) -> tuple[str, ...]:
    """The free parameters of springpots: fractional elements beside the orders.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment
    >>> still = Experiment("still", 0.1, np.zeros((9, 2)), np.zeros((1, 1)))
    >>> springpots(Problem(fracid.rotary_pendulum(), (still,), {"lambda": 1.0, "mu": 1.0},
    ...                    {"springpot_alpha": Free(1e-3, 0.0, 1.0)}))
    ('springpot_alpha',)
    """
    kinds = problem.model.friction
    return tuple(n for n, v in problem.parameters.items()
                 if isinstance(v, Free) and n in kinds and kinds[n].rung == SPRINGPOT.rung)  # fmt: skip


def claimable(problem: Problem) -> tuple[int, ...]:
    """Which unknowns may be called fractional: the orders, and those of springpots.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment
    >>> still = Experiment("still", 0.1, np.zeros((9, 2)), np.zeros((1, 1)))
    >>> claimable(Problem(fracid.rotary_pendulum(), (still,), {"lambda": 1.0, "mu": Free(1.0, 0.5, 1.2)}))
    (0,)
    """
    kinds = problem.model.friction
    own = {*complements(problem), *(n for n in springpots(problem) if kinds[n].off > 0.0)}
    return tuple(i for i, u in enumerate(problem.unknowns) if i in problem.order_indices or u.target in own)


def claimable_values(problem: Problem, x: FloatArray) -> dict[str, float]:
    """Their values at x.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment
    >>> still = Experiment("still", 0.1, np.zeros((9, 2)), np.zeros((1, 1)))
    >>> problem = Problem(fracid.rotary_pendulum(), (still,), {"lambda": 0.9, "mu": Free(1.0, 0.5, 1.2)})
    >>> claimable_values(problem, problem.start)
    {'mu': 1.0}
    """
    return {problem.unknowns[i].target: float(x[i]) for i in claimable(problem)}


def is_off(problem: Problem, order: str, value: float, half: float) -> bool:
    """Whether an order is off its integer value by more than half its interval; not where it has none.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment
    >>> still = Experiment("still", 0.1, np.zeros((9, 2)), np.zeros((1, 1)))
    >>> problem = Problem(fracid.rotary_pendulum(), (still,), {"lambda": 1.0, "mu": 1.0})
    >>> is_off(problem, "mu", 0.97, 0.01), is_off(problem, "mu", 0.97, 0.05)
    (True, False)
    """
    integers = integers_of(problem, order)
    return bool(integers) and all(abs(value - integer) > max(OFF, half) for integer in integers)


def integers_of(problem: Problem, order: str) -> tuple[float, ...]:
    """Where an order is none: at 0 and at what the model says, of a springpot 1; empty where it has none.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment
    >>> still = Experiment("still", 0.1, np.zeros((9, 2)), np.zeros((1, 1)))
    >>> problem = Problem(fracid.rotary_pendulum(), (still,), {"lambda": 1.0, "mu": 1.0})
    >>> integers_of(problem, "mu"), integers_of(problem, "springpot_order_alpha")
    ((0.0, 1.0), (0.0, 1.0))
    """
    if order not in problem.orders or order in problem.model.springpot_orders.values():
        return (0.0, 1.0)
    integer = problem.model.integer_order(order)
    return () if integer is None else (0.0, integer)


def integer_values(problem: Problem) -> dict[str, Value]:
    """Each order as the integer-order model has it: what is free at its integer value; what has none as it was.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment
    >>> still = Experiment("still", 0.1, np.zeros((9, 2)), np.zeros((1, 1)))
    >>> integer_values(Problem(fracid.rotary_pendulum(), (still,), {"lambda": 0.9, "mu": Free(0.95, 0.5, 1.2)}))
    {'lambda': 0.9, 'mu': 1.0}
    """
    return {n: problem.model.solved_at(n, v) if isinstance(problem.orders.get(problem.ties.get(n, n)), Free) else v
            for n, v in problem.orders.items()}  # fmt: skip


def _in_words(problem: Problem) -> str:
    """``every order 1``, or what each is, and which stay free."""
    searched = [n for n, v in problem.orders.items() if isinstance(problem.orders.get(problem.ties.get(n, n), v), Free)]
    values = {n: problem.model.integer_order(n) for n in searched}
    if all(v == 1 for v in values.values()):
        return "every order 1"
    fixed = ", ".join(f"{n} = {v:g}" for n, v in values.items() if v is not None)
    stay = [n for n, v in values.items() if v is None]
    return f"{fixed} ({' and '.join(stay)} free, for its model gives it no integer value)" if stay else fixed


def freed_friction(problem: Problem, names: Collection[str] | None = None) -> dict[str, Free]:
    """Constants of friction that the problem fixes, freed: up to half of gravity's torque, or what is alike it.

    Parameters
    ----------
    problem : Problem
    names : collection of str, optional
        Which; None for those that an order below 1 may stand in for.  Dry friction begins a little off 0.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment
    >>> swing = Experiment("still", 0.1, np.zeros((9, 2)), np.zeros((1, 1)))
    >>> problem = Problem(fracid.rotary_pendulum("srv02-rotpen"), (swing,), {"lambda": 1.0, "mu": 1.0})
    >>> [*freed_friction(problem)]
    ['b_theta', 'b_alpha', 'coulomb_theta', 'coulomb_alpha']
    """
    own = {p.name: problem.parameters.get(p.name, p.value) for p in problem.model.parameters}
    starts = {p.name: p.value for p in problem.model.parameters} | problem.parameter_starts
    reach = 0.5 * max((abs(starts[p.name]) for p in problem.model.parameters if p.unit == "N m"), default=0.0) or 1.0
    ranges = {}
    for name, kind in problem.model.friction.items():
        value, is_free = own[name], kind.damps_like_an_order if names is None else name in names
        if not is_free or not isinstance(value, float | int):
            continue
        scale = starts.get(kind.part_of, reach)
        start = max(value * (value != kind.off), kind.begins * scale) if kind.begins else float(value)
        most = max((reach, 2 * start, *(10 * entry for entry in kind.entries), *_alike(problem, name)))
        most = kind.most * starts.get(kind.part_of, 1.0) if math.isfinite(kind.most) else most
        bounds = problem.model.parameter(name)
        least = -most if kind.signed else bounds.lower if kind.off > 0.0 else min(kind.off, start)
        ranges[name] = Free(start, max(least, bounds.lower), min(max(most, start), bounds.upper))
    return ranges


def _alike(problem: Problem, name: str) -> Iterator[float]:
    """The sizes of constants and inputs in a constant's unit; of a springpot those of springs and dashpots."""
    unit, values = problem.model.parameter(name).unit, problem.parameter_starts
    units = {unit.replace(" s^nu", time) for time in ("", " s")} - {"", "1", "-"}
    yield from (abs(values.get(p.name, p.value)) for p in problem.model.parameters if p.unit in units)
    inputs = [i for i, n in enumerate(problem.model.inputs) if problem.model.input_units.get(n) in units]
    yield from (float(np.max(np.abs(e.inputs[:, inputs]))) for e in problem.experiments if inputs)


def freed_rests(problem: Problem, names: Collection[str]) -> dict[str, Free]:
    """The rests of springs among these constants of friction, where the problem does not mention them."""
    own = {rest for n in names for rest in problem.model.friction[n].rests} - {*problem.parameters}
    return {p.name: Free(p.value, p.value - 1.0, p.value + 1.0) for p in problem.model.parameters if p.name in own}


def moving(problem: Problem) -> list[str]:
    """The outputs that move: by a hundredth of what moves most."""
    size = np.max([np.ptp(e.measured, axis=0) for e in problem.experiments], axis=0)
    return [n for n, s in zip(problem.outputs, size, strict=True) if s > STILL * np.max(size)]


def _seen(problem: Problem, best: Evaluation, ranges: Mapping[str, Free]) -> dict[str, Free]:
    """Those that change the residuals when a hundredth of their reach is added: not the arm's if it is clamped."""
    errors = problem.errors(best.point)
    if isinstance(errors, Failure):
        return {}
    here, observable = joined(errors), {}
    for name, value in ranges.items():
        more = replace(problem, parameters={**problem.parameters, name: value.start + 0.01 * value.upper})
        errors = more.errors(best.point)
        if isinstance(errors, Failure) or np.linalg.norm(joined(errors) - here) > UNSEEN * np.linalg.norm(here):
            observable[name] = value
    return observable


def gain_over(rival: Rival, problem: Problem, fractional: Evaluation, more: int | None = None) -> tuple[float, float]:
    """The samples that the better one's residuals are worth, and the difference of Schwarz's criterion.

    The rival has so many parameters `more`; as many as it has more unknowns if nothing is said.  Where what the
    fractional fit leaves is coloured noise, both are judged by what is left once it is white
    (:mod:`fracid.selection.coloured_noise`).
    """
    integer, more = rival.evaluation, len(rival.problem.names) - len(problem.names) if more is None else more
    (here, samples), (there, others) = _told(problem, fractional.point), _told(rival.problem, integer.point)
    n = samples if here <= there else others
    k, left = len(problem.names), leftovers(problem, fractional.point).values()
    if all(e.noise for e in left) and any(e.coloured for e in left):
        new = coloured_noise.criterion(problem, fractional.point, k)
        others_new = coloured_noise.criterion(rival.problem, integer.point, k + more)
        if new is not None and others_new is not None:
            return n, others_new - new
    cost = problem.cost_function
    return n, schwarz(there, k + more, n, cost) - schwarz(here, k, n, cost)


def _told(problem: Problem, x: FloatArray) -> tuple[float, float]:
    """The squares of what a model leaves, and the samples that it is worth: a value that an encoder keeps is one.

    Else a model that creeps within half a step of an encoder at rest is better than the one that made the recording.
    """
    kept, errors = [np.sqrt(run_lengths(e.measured)) for e in problem.experiments], problem.errors(x)
    once = tuple(replace(e, deviation=d if e.deviation is None else d * e.deviation)
                 for e, d in zip(problem.experiments, kept, strict=True))  # fmt: skip
    residuals = replace(problem, experiments=once, memo=None).evaluate(x).residuals
    assert residuals is not None
    assert not isinstance(errors, Failure)
    worth = effective_samples(errors, problem.scored)
    return float(residuals @ residuals), min(worth, float(np.sum(joined(kept) ** -2.0)))


def judged(rival: Rival, gain: float) -> tuple[str, str] | None:
    """What of integer order explains the recordings as well, and what to make of the orders; None where it does not."""
    if gain > STRONG and rival.nested and not rival.elements:
        return None
    parameters = rival.parameters
    if not rival.nested:
        return f"A model of integer order, {rival.integers},", ""
    if not parameters and not rival.elements:
        return f"With {rival.integers} the same model", ""
    what = " and ".join(rival.elements) if rival.elements else "friction free"
    with_what = f" ({', '.join(f'{n} = {v:.3g}' for n, v in parameters.items())})" if parameters else ""
    lacking = "what the model lacks" if rival.elements else "friction that the model lacks or fixes"
    free = f"; free {', '.join(parameters)}" if parameters else ""
    stand = "may stand" if gain > EVEN else "stand"
    return f"The integer-order model with {what}{with_what}", f" The orders {stand} in for {lacking}{free}."


def _beside(other: float, cost: float, gain: float) -> str:
    """How an integer-order model explains the recordings beside one that costs `cost`.

    Examples
    --------
    >>> _beside(0.0697, 0.0695, -4.68)
    'explains the recordings as well: it costs 0.0697, this one 0.0695, and has a BIC that is 4.68 lower'
    """
    how = "better" if other < cost and gain <= 0 else "as well" if gain <= 0 else "nearly as well"
    bic = f"{abs(gain):.3g} {'lower' if gain <= 0 else 'higher'}"
    return f"explains the recordings {how}: it costs {other:.6g}, this one {cost:.6g}, and has a BIC that is {bic}"
