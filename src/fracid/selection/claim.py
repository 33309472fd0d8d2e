r"""What is claimed of a rig: ``fractional``, ``integer`` or ``undecided``, with reasons.

A tool for fractional orders is worth as much as its "no".  So **fractional** is said only where all of this holds:

1. the 95 % interval of an order excludes its integer by more than :data:`FLOOR`: the order q of a coordinate and its
   rate damps like a damping ratio of :math:`|ζ| = \tfrac{π}{2}|1 - q|`, and 0.02 a clock, a cable or a bearing may do;
   so it must where no other unknown is stopped by a bound, which may be all that keeps the order off its integer;
2. what is left over is noise or the encoder's rounding (:mod:`fracid.signals.left_over`): where a model lacks
   something, its orders stand in for that;
3. nothing of integer order does as well (:mod:`fracid.selection.integer_alternatives`), nor a finite memory in the
   place of the order (:mod:`fracid.selection.finite_memory`);
4. no other finding contradicts it, and recordings that were held out agree.

**Integer** is said where the intervals of the orders hold their integers, or where an integer-order model that itself
explains the recordings, at no limit of its own, does as well or better; **undecided** otherwise, with what would decide
it.  Of a model that does not follow half of a motion nothing is said: its orders mean nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from fracid.arrays import FloatArray
from fracid.errors import Failure
from fracid.estimation.covariance import Known
from fracid.findings import Note, Words
from fracid.models.friction import SPRINGPOT
from fracid.problem import Problem
from fracid.selection.bic import EVEN, STRONG
from fracid.selection.fractional_element import FractionalElement
from fracid.selection.integer_rival import OFF, Alternative, FiniteMemory, claimable, integers_of
from fracid.signals.left_over import LeftOver
from fracid.units import half_of, in_letters, letter, plain, with_half_width, with_interval

SAYS = Words("selection/claim.toml")

MANY = 100.0
"""From here on a difference of BIC is a whole number."""

FLOOR = 0.04 / math.pi
"""By how much an order must differ from an integer, its interval taken off: of a swing a damping ratio of 0.02."""

KNOWN = 0.1
"""An order whose interval is wider than this to each side is not known; half of it where residuals are no noise, for
there an interval is too narrow."""


NO_FIT = frozenset({"no-run", "no-fit"})
"""Codes of reasons where the model does not follow what was recorded: nothing is known of its orders then."""

LACKS = frozenset({"lacks", "unexplained", "all-unexplained"})
"""Codes of reasons where residuals are no noise."""

COUNTS = ("none", "one", "two", "three")


ClaimWord = Literal["fractional", "integer", "undecided"]


@dataclass(frozen=True)
class Claim:
    """One of three words, and sentences."""

    claim: ClaimWord
    reasons: tuple[str, ...]

    @property
    def codes(self) -> tuple[str, ...]:
        """Of the reasons: what programs look at."""
        return tuple(reason.code for reason in self.reasons if isinstance(reason, Note))


def no_run() -> Claim:
    """Where every run failed."""
    return _undecided(SAYS("no-run"))


@dataclass(frozen=True)
class OrderFound:
    """A free order at a minimum."""

    name: str
    value: float
    half: float
    """The side of its 95 % interval towards the integer that it may be; infinite where there is none."""
    integers: tuple[float, ...] = (1.0,)
    """Where it is none; empty where the model has no such value."""
    beyond_bounds: float = 0.0
    """Half the interval were no other unknown stopped by a bound, 0 where none is: a spring of none leaves its part to
    a springpot of an order next to 0, and its bound that order an interval that excludes 0."""
    shown: tuple[float, float] | None = None
    """Its interval, as tables have it; None: as long as that side on both."""
    cut: bool = False
    """Whether that ends at a bound of its own."""
    rungs: frozenset[str] = frozenset({SPRINGPOT.rung})
    """What compare can look for in its place."""
    swings: bool = True
    """Whether a coordinate and its rate have it, so that it acts like a damping ratio."""

    @property
    def known(self) -> float:
        """To within what it is known: the longer side of its interval, of which a bound may have cut the other."""
        low, high = self.shown or (self.value - self.half, self.value + self.half)
        return max(self.value - low, high - self.value)

    @property
    def nearest(self) -> float:
        """The integer that it is nearest to."""
        return min(self.integers, key=lambda i: abs(self.value - i))

    @property
    def distance(self) -> float:
        """How far it is from the nearest integer; 0 where it has no integer value."""
        return abs(self.value - self.nearest) if self.integers else 0.0

    @property
    def off(self) -> bool:
        """Whether its interval excludes the integers."""
        return self.distance > max(OFF, self.half)

    @property
    def least_distance(self) -> float:
        """How far the near end of its interval is from the integer."""
        return self.distance - max(self.half, self.beyond_bounds)

    def says(self, key: str) -> str:
        """A clause on its distance from the integer: of a swing the damping ratio that it stands for."""
        kind, scale = ("swing", math.pi / 2) if self.swings else ("other", 1.0)
        return SAYS(f"{key}-{kind}", distance=scale * self.distance, floor=scale * FLOOR)

    def __str__(self) -> str:
        """``μ = 0.9570 ± 0.0030``: as tables have it, unless that seems to tell otherwise than what decides."""
        shown = "" if self.shown is None else with_interval(self.value, *self.shown, cut=self.cut)
        if not shown or ("±" in shown and (self.distance > half_of(self.shown)) != (self.distance > self.half)):
            shown = with_half_width(self.value, self.half)
        return f"{letter(self.name)} = {shown}"


def of_model(problem: Problem, order: str) -> dict[str, Any]:
    """What the model says of an order: a coordinate and its rate have it, as of a swing, or they do not.

    Examples
    --------
    >>> import fracid, numpy as np
    >>> still = fracid.Experiment("still", 0.1, np.zeros((9, 2)), np.zeros((1, 1)))
    >>> problem = fracid.Problem(fracid.rotary_pendulum(), (still,), {"lambda": 1.0, "mu": 1.0})
    >>> [of_model(problem, order)["swings"] for order in ("mu", "springpot_order_alpha")]
    [True, False]
    """
    model, rungs = problem.model, {kind.rung for kind in problem.model.friction.values()}
    swings = any(model.orders[i] == order == model.orders[j] for i, j in model.rates.items())
    return {"integers": integers_of(problem, order), "rungs": frozenset(rungs), "swings": swings}


def orders_found(problem: Problem, x: FloatArray, precision: Known) -> tuple[OrderFound, ...]:
    """The free orders at a minimum, those of springpots among them, with their intervals."""
    found = []
    for i in claimable(problem):
        name, value = problem.unknowns[i].target, float(x[i])
        order = OrderFound(name, value, math.inf, **of_model(problem, name))
        if not isinstance(precision, Failure) and (interval := precision.interval(x, i)) is not None:
            below = bool(order.integers) and order.nearest < value
            half = value - interval[0] if below else interval[1] - value
            beyond, cut = precision.half_beyond_bounds(i), bool(problem.unknowns[i].range.ending(interval))
            order = replace(order, half=half, beyond_bounds=beyond, shown=interval, cut=cut)
        found.append(order)
    return tuple(found)


def claim_of(
    orders: Sequence[OrderFound], alternative: Alternative | None, left_over: Mapping[str, LeftOver],
    contradictions: Sequence[str] = (), support: Sequence[str] = (), element: FractionalElement | None = None,
    *, compared: bool = False, starts: int = 1,
) -> Claim:  # fmt: skip
    """What a fit's orders are evidence of.

    Parameters
    ----------
    orders : sequence of OrderFound
        Those that were free.
    alternative : Alternative or None
        The integer-order model that comes nearest.
    left_over : mapping
        Recording and output, in words → what is left over of it.
    contradictions : sequence of str
        Sentences, each of which forbids to call it fractional.
    support : sequence of str
        Sentences that are said beside a claim of fractional orders.
    element : FractionalElement, optional
        A springpot that explains what is left over: neither the orders nor their integers are the answer then.
    compared : bool
        Whether other structures were looked at already.
    starts : int
        Of the search; 0 of an optimiser's own, which more starts leave as it is.

    Examples
    --------
    >>> white = {"swing, alpha": LeftOver(1e-3, 0.0, 1.0)}
    >>> claim_of([OrderFound("mu", 0.999, 0.002)], None, white).claim
    'integer'
    >>> claim_of([OrderFound("mu", 0.95, 0.002)], None, white).reasons
    ('No integer-order model was compared with μ = 0.9500 ± 0.0020.',)
    """
    left = {where: e for where, e in left_over.items() if not e.noise}
    if not orders:
        return _undecided(SAYS("given"), *[SAYS("given-lacks", each=" and ".join(left))] * bool(left))
    again = SAYS("again") if starts == 1 and element is None and not compared else ""
    missed = {where: e for where, e in left_over.items() if not e.fits}
    if missed and (alternative is None or alternative.gain > -STRONG):  # else something of integer order is far better
        each = " and ".join(f"{where} (fit {round(e.fit)} %)" for where, e in missed.items())
        return _undecided(SAYS("no-fit", each=each), SAYS("decide-model", again=again))
    off = [order for order in orders if order.off]
    unexplained = _unexplained(left, again)
    as_noise = {where: e.inputs for where, e in left_over.items() if e.noise and not e.explained}
    whose = {inputs: " and ".join(w for w in as_noise if as_noise[w] == inputs) for inputs in as_noise.values()}
    coloured = [SAYS("shaken" if inputs else "coloured", each=each, inputs=inputs) for inputs, each in whose.items()]
    rungs = frozenset() if compared else orders[0].rungs
    decides = SAYS("decide-white", where=SAYS("compare") if rungs else "")
    if element is not None:
        lacks = SAYS("lacks", orders=" and ".join(map(str, orders)))
        return _undecided(lacks, *unexplained, str(element), element.remedy)
    such = "springpot" if any(order.swings for order in orders) else "fractional-element"
    excluded = SAYS("not-excluded", element=SAYS("compared-springpot" if SPRINGPOT.rung in rungs else such))
    open_question = (*unexplained, *[excluded] * bool(unexplained), *coloured)
    if alternative is not None and any(t.as_well for t in alternative.trials):
        determined = alternative.gain <= -STRONG or any(order.known <= KNOWN for order in orders)
        if alternative.settles and determined:
            return Claim("integer", (alternative.warning, *open_question))
        if alternative.settles:
            return _undecided(alternative.warning, _unknown(orders), *open_question, SAYS("decide-longer"))
        weak = EVEN < alternative.gain <= STRONG
        decides = SAYS("decide-longer") if weak and not unexplained else decides
        return _undecided(alternative.warning, SAYS("weak" if weak else "unsettled"), *open_question, decides)
    if not off:
        claim = _not_off(orders, KNOWN / 2 if unexplained else KNOWN)
        decides = decides if unexplained else SAYS("decide-longer")
        remedy = [decides] if claim.claim == "undecided" and any(order.integers for order in orders) else []
        return replace(claim, reasons=(*claim.reasons, *open_question, *remedy))
    clear = [order for order in off if order.least_distance > FLOOR]
    if not clear:
        return _too_little(off, open_question)
    orders_off = " and ".join(map(str, clear))
    if unexplained or (contradictions and compared):
        doubt, decides = ("stand-in", decides) if unexplained else ("not-confirmed", SAYS("decide-held-out"))
        return _undecided(SAYS(doubt, orders=orders_off), *unexplained, *contradictions, decides)
    if contradictions:
        speaks, without = ("a finding speaks", "it") if len(contradictions) == 1 else ("findings speak", "them")
        against = f"{orders_off}, but {speaks} against that."
        return _undecided(against, *contradictions, f"To decide: refit after fixing {without}.")
    if alternative is None:
        return _undecided(SAYS("not-compared", orders=orders_off))
    if alternative.cut:
        limit, decide = ("limit-compared", "decide-all-compared") if compared else ("limit", "decide-all")
        return _undecided(SAYS("cut", orders=orders_off, limit=SAYS(limit)), SAYS(decide))
    memories = alternative.memories
    if memories and (memories[-1].as_well or not math.isfinite(memories[-1].gain)):
        return _no_more_than(memories[-1], orders_off, coloured)
    effects = (SAYS("effect", order=order, size=order.says("size")) for order in clear)
    return Claim("fractional", (*effects, *_beaten(alternative), *_worth(memories), *coloured, *support))


def _undecided(*reasons: str) -> Claim:
    return Claim("undecided", reasons)


def _not_off(orders: Sequence[OrderFound], known: float) -> Claim:
    determined = [order for order in orders if order.known <= known and order.integers]
    without = [order for order in orders if not order.integers]
    others = [order for order in orders if order not in (*determined, *without)]
    unknown = [_unknown(others)] if others else []
    unknown += [SAYS("no-integer", order=order) for order in without]
    if not determined:
        return _undecided(*unknown)
    inside = [order for order in determined if order.distance <= order.half]
    next_to = [SAYS("next-to", order=order, least=OFF) for order in determined if order not in inside]
    which = " and ".join(dict.fromkeys(f"{order.nearest:g}" for order in inside))
    said = SAYS("inside", orders=" and ".join(map(str, inside)), which=which, s="s" * (len(inside) > 1))
    return Claim("integer", (*([said] if inside else []), *next_to, *unknown))


def _unknown(orders: Sequence[OrderFound]) -> str:
    names = " and ".join(letter(order.name) for order in orders)
    return f"{names} {'is' if len(orders) == 1 else 'are'} not identifiable."


def _too_little(off: Sequence[OrderFound], open_question: Sequence[str]) -> Claim:
    most, orders = max(off, key=lambda order: order.least_distance), " and ".join(map(str, off))
    if most.distance - most.half > FLOOR:  # but for a bound
        return _undecided(SAYS("bound", orders=orders, most=most), *open_question, SAYS("decide-decades"))
    said = SAYS("too-little", orders=orders, most=most, little=most.says("little"))
    return _undecided(said, *(open_question or [SAYS("no-recording")]))


def _unexplained(left_over: Mapping[str, LeftOver], again: str) -> list[str]:
    """One sentence on all residuals that are no noise; empty where there are none."""
    sizes = {where: _size(e) for where, e in left_over.items()}
    if len(sizes) < 2:
        return [SAYS("unexplained", where=where, size=size, again=again) for where, size in sizes.items()]
    each = " and ".join(f"{where} ({size})" for where, size in sizes.items())
    return [SAYS("all-unexplained", each=each, again=again)]


def _size(e: LeftOver) -> str:
    if e.known:
        return f"{plain(e.rms)} of the standard deviations that the recording has"
    return f"{plain(e.times)} times the recording's rounding" if math.isfinite(e.times) else "larger than noise"


def _no_more_than(memory: FiniteMemory, orders: str, coloured: Sequence[str]) -> Claim:
    """What is claimed of orders that a few relaxations do as well as."""
    count = f"{COUNTS[memory.relaxations]} relaxation{'s' * (memory.relaxations > 1)}"
    if not math.isfinite(memory.gain):
        return _undecided(SAYS("no-run-of-memory", orders=orders, count=count))
    costs, have = ("cost", "have") if memory.relaxations > 1 else ("costs", "has")
    bic = f"{abs(memory.gain):.3g} {'lower' if memory.gain <= 0 else 'higher'}"
    instead = SAYS("instead", count=count.capitalize(), costs=costs, cost=memory.cost, have=have, bic=bic)
    if memory.gain <= -STRONG and memory.settles:
        return Claim("integer", (SAYS("memory", orders=orders, count=count, instead=instead), *coloured))
    why = "" if memory.settles else f" {SAYS('unsettled')}"
    said = SAYS("memory-as-well", orders=orders, count=count, instead=instead, why=why)
    return _undecided(said, *coloured, SAYS("decide-decades"))


def _worth(memories: Sequence[FiniteMemory]) -> Iterator[str]:
    """How many relaxations an order is worth."""
    if memories:
        tried = ", ".join(COUNTS[m.relaxations] for m in memories)
        higher = ", ".join(_higher(m.gain) for m in memories)
        yield SAYS("worth", count=COUNTS[len(memories)], tried=tried, higher=higher)


def _in_short(structure: str) -> str:
    """What an alternative has, without the names of its parameters, which its elements say in words."""
    parts = structure.split("; ")
    return "; ".join([part for part in parts if not part.endswith(" free") or len(parts) < 3])


def _higher(gain: float) -> str:
    return f"{gain:,.0f}" if gain >= MANY else f"{gain:.3g}"


def _beaten(alternative: Alternative) -> tuple[str, ...]:
    tried = [t.name for t in alternative.trials if math.isfinite(t.cost)]
    untried = [t.name for t in alternative.trials if not math.isfinite(t.cost)]
    reason = SAYS("beaten", tried=", ".join(tried), nearest=_in_short(alternative.structure),
                  worse=_higher(alternative.gain))  # fmt: skip
    return tuple(map(in_letters, (reason, *([f"Not excluded: {', '.join(untried)}."] if untried else []))))
