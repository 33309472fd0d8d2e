r"""What is claimed of a rig: ``fractional``, ``integer`` or ``undecided``, with reasons.

A tool for fractional orders is worth as much as its "no".  So **fractional** is said only where all of this holds:

1. the 95 % interval of an order excludes its integer by more than :data:`FLOOR` of damping: an order q damps a swing
   like a damping ratio of :math:`|ζ| = \tfrac{π}{2}|1 - q|`, and less than that a clock, a cable or a bearing may do;
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
from typing import Literal

from fracid.arrays import FloatArray
from fracid.errors import Failure
from fracid.estimation.covariance import Uncertainty
from fracid.problem import Problem
from fracid.selection.bic import STRONG
from fracid.selection.fractional_element import FractionalElement
from fracid.selection.integer_rival import OFF, Alternative, FiniteMemory, claimable, integers_of
from fracid.signals.left_over import LeftOver
from fracid.units import GREEK, half_width, in_letters, plain, to_second_digit

MANY = 100.0
"""From here on a difference of BIC is a whole number."""

FLOOR = 0.02
"""The damping ratio by which an order must differ from an integer, its interval taken off: 0.013 in an order."""

KNOWN = 0.1
"""An order whose interval is wider than this to each side is not known."""


NO_FIT = "The model does not fit"
"""How the reason begins where it does not follow what was recorded: nothing is known of its orders then."""

LACKS = "the model lacks something"
"""Said of residuals that are no noise."""

COMPARE = "; fracid compare looks for one"

LONGER = "To decide: longer recordings, or larger swings."
"""Said where the model leaves nothing but noise, and the orders are not known."""

NO_RECORDING = "No recording of this kind would decide it."
"""Said of orders that are off their integers by less than a bearing may do, beside noise."""

UNSETTLED = "It is at a limit of its own, or leaves more than noise itself, which settles nothing."
"""Said of an integer-order model that does as well as the orders where neither explains the recordings."""

DECADES = "To decide: recordings that show more decades of time, sampled faster or longer, or less noise."
"""Said of orders that a few relaxations imitate."""

COUNTS = ("none", "one", "two", "three")

NOT_EXCLUDED = "Not excluded: a fractional element, such as a springpot; fracid compare --rung all looks for it."
"""Said of integer orders beside a misfit."""


ClaimWord = Literal["fractional", "integer", "undecided"]


@dataclass(frozen=True)
class Claim:
    """One of three words, and sentences."""

    claim: ClaimWord
    reasons: tuple[str, ...]


NO_RUN = Claim("undecided", (f"{NO_FIT}: no run of it reached the end of a recording.",))
"""Where every run failed."""


@dataclass(frozen=True)
class OrderFound:
    """A free order at a minimum."""

    name: str
    value: float
    half: float
    """Half its 95 % interval; infinite where there is none."""
    integers: tuple[float, ...] = (1.0,)
    """Where it is none; empty where the model has no such value."""

    @property
    def nearest(self) -> float:
        """The integer that it is nearest to."""
        return min(self.integers, key=lambda i: abs(self.value - i))

    @property
    def off(self) -> bool:
        """Whether its interval excludes the integers."""
        return bool(self.integers) and abs(self.value - self.nearest) > max(OFF, self.half)

    @property
    def least_damping(self) -> float:
        """The damping ratio that the near end of its interval stands for; 0 where it has no integer value."""
        return damping(abs(self.value - self.nearest) - self.half) if self.integers else 0.0

    def __str__(self) -> str:
        """``μ = 0.9570 ± 0.0030``."""
        name, known = GREEK.get(self.name, self.name), 0 < self.half < math.inf
        value = f"{to_second_digit(self.value, self.half)} ± {half_width(self.half)}" if known else f"{self.value:.4f}"
        return f"{name} = {value}"


def damping(off: float) -> float:
    r"""The damping ratio that an order stands for: :math:`\tfrac{π}{2}|1 - q|`.

    Examples
    --------
    >>> round(damping(0.05), 3)
    0.079
    """
    return math.pi / 2 * off


def orders_found(problem: Problem, x: FloatArray, precision: Uncertainty | Failure) -> tuple[OrderFound, ...]:
    """The free orders at a minimum, those of springpots among them, with their intervals."""
    found = []
    for i in claimable(problem):
        interval = None if isinstance(precision, Failure) else precision.interval(x, i)
        name, value = problem.unknowns[i].target, float(x[i])
        order = OrderFound(name, value, math.inf, integers_of(problem, name))
        if interval is not None:  # its side towards the integer that it may be
            below = bool(order.integers) and order.nearest < value
            order = replace(order, half=value - interval[0] if below else interval[1] - value)
        found.append(order)
    return tuple(found)


def claim_of(
    orders: Sequence[OrderFound],
    alternative: Alternative | None,
    left_over: Mapping[str, LeftOver],
    contradictions: Sequence[str] = (),
    support: Sequence[str] = (),
    element: FractionalElement | None = None,
    *,
    compared: bool = False,
) -> Claim:
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

    Examples
    --------
    >>> white = {"swing, alpha": LeftOver(1e-3, 0.0, 1.0)}
    >>> claim_of([OrderFound("mu", 0.999, 0.002)], None, white).claim
    'integer'
    >>> claim_of([OrderFound("mu", 0.95, 0.002)], None, white).reasons
    ('No integer-order model was compared with μ = 0.9500 ± 0.0020.',)
    """
    if not orders:
        return Claim("undecided", ("No order was free: they were given, not found.",))
    missed = {where: e for where, e in left_over.items() if not e.fits}
    if missed and (alternative is None or alternative.gain > -STRONG):  # else something of integer order is far better
        return Claim("undecided", (_no_fit(missed), "To decide: a model that follows the recordings. "
                                   "Look at their columns, zeros, signs, units and clock, or type --multi-start "
                                   "16."))  # fmt: skip
    off = [order for order in orders if order.off]
    unexplained = _unexplained({where: e for where, e in left_over.items() if not e.noise})
    coloured = _coloured({where: e for where, e in left_over.items() if e.noise and not e.explained})
    if element is not None:
        found = " and ".join(map(str, orders))
        return Claim("undecided", (f"{found}, but {LACKS}.", *unexplained, str(element),
                                   element.remedy))  # fmt: skip
    open_question = (*unexplained, *([NOT_EXCLUDED] if unexplained else []), *coloured)
    if alternative is not None and any(t.as_well for t in alternative.trials):
        if alternative.settles:
            return Claim("integer", (alternative.warning, *open_question))
        decides = f"To decide: a model whose residual is white noise{'' if compared else COMPARE}."
        return Claim("undecided", (alternative.warning, UNSETTLED, *open_question, decides))
    if not off:
        claim, decides = _not_off(orders), LONGER
        if unexplained:
            decides = f"To decide: a model whose residual is white noise{'' if compared else COMPARE}."
        remedy = [decides] if claim.claim == "undecided" and any(order.integers for order in orders) else []
        return replace(claim, reasons=(*claim.reasons, *open_question, *remedy))
    clear = [order for order in off if order.least_damping > FLOOR]
    if not clear:
        return Claim("undecided", (_too_little(off), *(open_question or [NO_RECORDING])))
    orders_off = " and ".join(map(str, clear))
    if unexplained or (contradictions and compared):
        looks = "" if compared else COMPARE
        return Claim("undecided", (f"{orders_off}, but orders may stand in for what the model lacks.", *unexplained,
                                   *contradictions,
                                   f"To decide: a model whose residual is white noise{looks}."))  # fmt: skip
    if contradictions:
        speaks, without = ("a finding speaks", "it") if len(contradictions) == 1 else ("findings speak", "them")
        return Claim("undecided", (f"{orders_off}, but {speaks} against that.", *contradictions,
                                   f"To decide: refit after fixing {without}."))  # fmt: skip
    if alternative is None:
        return Claim("undecided", (f"No integer-order model was compared with {orders_off}.",))
    memories = alternative.memories
    if memories and (memories[-1].as_well or not math.isfinite(memories[-1].gain)):
        return _no_more_than(memories[-1], orders_off, coloured)
    return Claim("fractional", (*(_effect(order) for order in clear), *_beaten(alternative), *_worth(memories),
                                *coloured, *support))  # fmt: skip


def _not_off(orders: Sequence[OrderFound]) -> Claim:
    determined = [order for order in orders if order.half <= KNOWN and order.integers]
    without = [order for order in orders if not order.integers]
    others = [order for order in orders if order not in (*determined, *without)]
    names = " and ".join(GREEK.get(order.name, order.name) for order in others)
    unknown = [f"{names} {'is' if len(others) == 1 else 'are'} not identifiable."] if others else []
    unknown += [f"The model gives {order} no integer value (integer_orders), so no integer-order model is compared "
                "with it." for order in without]  # fmt: skip
    if not determined:
        return Claim("undecided", tuple(unknown))
    inside = [order for order in determined if abs(order.value - order.nearest) <= order.half]
    beside = [order for order in determined if order not in inside]
    next_to = [f"{order} differs from {order.nearest:g} by less than {OFF:g}: too little to call it fractional."
               for order in beside]  # fmt: skip
    return Claim("integer", (*_inside(inside), *next_to, *unknown))


def _inside(orders: Sequence[OrderFound]) -> Iterator[str]:
    if orders:
        which = " and ".join(dict.fromkeys(f"{order.nearest:g}" for order in orders))
        several = "s" * (len(orders) > 1)
        yield f"{' and '.join(map(str, orders))}: {which} lies within the interval{several}."


def _too_little(off: Sequence[OrderFound]) -> str:
    most = max(off, key=lambda order: order.least_damping)
    return (
        f"{' and '.join(map(str, off))}: off {most.nearest:g}, but the difference acts like a damping ratio of at most "
        f"{damping(abs(most.value - most.nearest)):.2g}, and less than {FLOOR:g} beyond the interval "
        "may be a clock, a cable or a bearing."
    )


def _no_fit(missed: Mapping[str, LeftOver]) -> str:
    each = " and ".join(f"{where} (fit {round(e.fit)} %)" for where, e in missed.items())
    return f"{NO_FIT} {each}: nothing is known of its orders."


def _unexplained(left_over: Mapping[str, LeftOver]) -> list[str]:
    """One sentence on all residuals that are no noise; empty where there are none."""
    sizes = {where: _size(e) for where, e in left_over.items()}
    if not sizes:
        return []
    if len(sizes) == 1:
        [(where, size)] = sizes.items()
        what = f"The residual of {where} is {size}, and correlated"
    else:
        each = " and ".join(f"{where} ({size})" for where, size in sizes.items())
        what = f"The residuals of {each} are correlated"
    return [f"{what}: {LACKS}."]


def _coloured(left_over: Mapping[str, LeftOver]) -> list[str]:
    """One sentence on all residuals that are correlated as noise is."""
    each = " and ".join(left_over)
    return [f"The residual of {each} is correlated as the noise of a filter, a camera or a bus is, alike wherever the "
            "motion goes: correlated noise, or a model that lacks something. The intervals allow for "
            "it."] if left_over else []  # fmt: skip


def _size(e: LeftOver) -> str:
    if e.known:
        return f"{plain(e.rms)} of the standard deviations that the recording has"
    return f"{plain(e.times)} times the encoder's rounding" if math.isfinite(e.times) else "larger than noise"


def _effect(order: OrderFound) -> str:
    return (
        f"{order} differs from {order.nearest:g}; the difference acts like a damping ratio of "
        f"{damping(abs(order.value - order.nearest)):.2g}."
    )


def _no_more_than(memory: FiniteMemory, orders: str, coloured: Sequence[str]) -> Claim:
    """What is claimed of orders that a few relaxations do as well as."""
    count = f"{COUNTS[memory.relaxations]} relaxation{'s' * (memory.relaxations > 1)}"
    if not math.isfinite(memory.gain):
        return Claim("undecided", (f"{orders}, but no run of the model with {count} in the place of an order ended, "
                                   "with which that must be compared.",))  # fmt: skip
    instead = f"{count} in the place of an order, all else equal, cost{'s' * (memory.relaxations == 1)}"
    bic = f"{memory.cost:.6g} and {'have' if memory.relaxations > 1 else 'has'} a BIC that is {abs(memory.gain):.3g}"
    if memory.gain <= -STRONG and memory.settles:
        return Claim("integer", (f"{orders}: no evidence of fractional dynamics, for the order is worth no more than "
                                 f"{count}. {instead.capitalize()} {bic} lower.", *coloured))  # fmt: skip
    why = "" if memory.settles else f" {UNSETTLED}"
    return Claim("undecided", (f"{orders}, but the order is worth no more than {count}. {instead.capitalize()} {bic} "
                               f"{'lower' if memory.gain <= 0 else 'higher'}.{why}", *coloured, DECADES))  # fmt: skip


def _worth(memories: Sequence[FiniteMemory]) -> Iterator[str]:
    """How many relaxations an order is worth."""
    if memories:
        tried = ", ".join(COUNTS[m.relaxations] for m in memories)
        higher = ", ".join(_higher(m.gain) for m in memories)
        yield (f"The order is worth as many as {COUNTS[len(memories)]} relaxations: with {tried} in its place the BIC "
               f"is {higher} higher.")  # fmt: skip


def _in_short(structure: str) -> str:
    """What an alternative has, without the names of its parameters, which its elements say in words."""
    parts = structure.split("; ")
    return "; ".join([part for part in parts if not part.endswith(" free") or len(parts) < 3])


def _higher(gain: float) -> str:
    return f"{gain:,.0f}" if gain >= MANY else f"{gain:.3g}"


def _beaten(alternative: Alternative) -> tuple[str, ...]:
    tried = [t.name for t in alternative.trials if t.tried]
    untried = [t.name for t in alternative.trials if not t.tried]
    worse = _higher(alternative.gain)
    reasons = [f"No integer-order model fits as well. Tried: {', '.join(tried)}. The nearest "
               f"({_in_short(alternative.structure)}) has a BIC that is {worse} higher."]  # fmt: skip
    return tuple(map(in_letters, (*reasons, *([f"Not excluded: {', '.join(untried)}."] if untried else []))))
