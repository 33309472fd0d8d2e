"""What a comparison says of the orders, in words.

A structure's error on a recording is the geometric mean of its outputs' RMSE, and over recordings the
geometric mean again: what counts are ratios, and no output or recording rules by its size.  The best structure with
orders free is held against the best with orders 1, as many of one kind as of the other:

=========================================================  ============================================================
held out                                                   verdict
=========================================================  ============================================================
lower by 2 % or more, on most recordings                   orders help on n of N held-out recordings, by p %
no lower, but orders help viscous friction alone, and      Coulomb friction explains the data better than free
viscous + Coulomb with orders 1 predicts better than that  orders
within 2 %                                                 orders make no difference: the integer-order model predicts
                                                           as well; or where it explains the fitted recordings less
                                                           well, held-out recordings do not decide
higher                                                     orders fit better and predict worse
=========================================================  ============================================================

Without held-out recordings Schwarz's criterion has to do, and the verdict says so: what a model gains in sample, it may
lose elsewhere.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from fracid.findings import Note
from fracid.selection.bic import STRONG, does_as_well
from fracid.selection.comparison_records import Comparison, Row, held_out_errors
from fracid.selection.opened_bounds import SAYS
from fracid.units import half_of, letter, with_half_width

ORDERS_HELP = ("orders-help", "orders-help-some")
"""Codes of verdicts that speak for orders."""

MARGIN = 0.02
"""Errors that differ by less than this part are the same."""


def verdict_of(comparison: Comparison, integers: Mapping[str, float | None] | None = None) -> str:
    """In words; `integers` are the orders' integer values, 1 for those left out."""
    integer, fractional = comparison.best(fractional=False), comparison.best(fractional=True)
    if not comparison.held_out:
        return _verdict_in_sample(integer, fractional)
    if not math.isfinite(min(integer.error, fractional.error)):
        return "No structure predicts every held-out recording: their runs fail."
    ones = _ones(fractional, integers or {})
    verdict = _verdict_held_out(comparison, integer, fractional)
    return Note(" ".join(filter(None, (verdict, ones, _paper_beside(comparison, integer, fractional)))), verdict.code)


def _verdict_held_out(comparison: Comparison, integer: Row, fractional: Row) -> Note:
    ratio, N = ratio_of(fractional, integer), len(comparison.held_out)
    helped = sum(fractional.held_out[n].error < integer.held_out[n].error for n in comparison.held_out)
    both = (f"{row.name} ({held_out_errors(row, comparison.units)})" for row in (fractional, integer))
    few = SAYS(f"few-{N}") if N in (1, 2) else ""
    if ratio < 1 - MARGIN and helped > N / 2:
        code = "orders-help"
    elif ratio > 1 - MARGIN and (errors := _replaced(comparison)):
        return SAYS("replaced", ordered=errors[0], dried=errors[1], change=_change(ratio), few=few)
    elif abs(ratio - 1) <= MARGIN:
        code = "same" if integer_does_as_well(comparison) else "same-held-out"
    else:
        code = "orders-help-some" if ratio < 1 else "worse" if math.isfinite(ratio) else "no-prediction"
    return SAYS(code, helped=helped, N=N, percent=100 * abs(ratio - 1), against=" against ".join(both), few=few,
                gain=integer.bic - fractional.bic)  # fmt: skip


def _replaced(comparison: Comparison) -> tuple[str, ...]:
    """Where orders help beside viscous friction alone, but dry friction helps more: the errors of both."""
    rows = {row.name: row for row in comparison.rows}
    names = ("viscous, orders 1", "viscous, orders free", "viscous + Coulomb, orders 1")
    if not all(name in rows for name in names):
        return ()
    plain, paper, dry = (rows[name] for name in names)
    replaced = ratio_of(paper, plain) < 1 - MARGIN and ratio_of(dry, paper) < 1 - MARGIN
    return tuple(held_out_errors(row, comparison.units) for row in (paper, dry)) if replaced else ()


def _change(ratio: float) -> str:
    if abs(ratio - 1) <= MARGIN:
        return "change nothing"
    return f"make the prediction worse by {100 * (ratio - 1):.2g} %" if math.isfinite(ratio) else "do not predict"


def _ones(row: Row, integers: Mapping[str, float | None]) -> str:
    """Where every interval of its free orders holds 1, or what else the model says is integer."""
    found = {n: (o.value, o.interval95) for n, o in row.orders.items() if o.interval95 is not None}
    values = [integers.get(n, 1.0) for n in found]
    coverage = [v is not None and low <= v <= high for v, (_, (low, high)) in zip(values, found.values(), strict=True)]
    if not found or not all(coverage):
        return ""
    orders = ", ".join(f"{letter(n)} {with_half_width(v, half_of(ends))}" for n, (v, ends) in found.items())
    what = f"{values[0]:g}" if len({*values}) == 1 else "integer"
    return f"There the orders are {what} within their intervals ({orders})."


def _paper_beside(comparison: Comparison, integer: Row, fractional: Row) -> str:
    """How the paper's structure does, where it is not the best."""
    best = integer if ratio_of(fractional, integer) > 1 - MARGIN else fractional
    paper = [row for row in comparison.rows if row.paper and row is not best]
    if not paper or not ratio_of(best, paper[0]) < 1 - MARGIN:
        return ""
    if not math.isfinite(paper[0].error):
        return "The paper's structure (viscous friction, free orders) does not predict every one: a run fails."
    times = 1 / ratio_of(best, paper[0])
    more = f"{times:.2g} times the error" if times >= 1.5 else f"{100 * (times - 1):.2g} % more error"
    return f"The paper's structure (viscous friction, free orders) has {more} of {best.name}."


def _verdict_in_sample(integer: Row, fractional: Row) -> str:
    gain = integer.bic - fractional.bic
    if not math.isfinite(gain):
        return SAYS("no-criterion")
    conclusion = SAYS("explain-more", gain=gain) if gain > STRONG else SAYS("explain-nothing", loss=-gain)
    return SAYS("in-sample", conclusion=conclusion, fractional=fractional, integer=integer)


def ratio_of(one: Row, other: Row) -> float:
    """By what factor one's held-out error is another's."""
    if not math.isfinite(one.error):
        return math.inf
    return 0.0 if not math.isfinite(other.error) else one.error / other.error


def integer_does_as_well(comparison: Comparison) -> bool:
    """Whether one structure of integer order explains the fitted recordings and predicts the others as well as orders.

    Where there is no criterion, such as for a cost of one's own, held-out recordings decide alone.
    """
    fractional = comparison.best(fractional=True)

    def as_well(row: Row) -> bool:
        gain, larger = row.bic - fractional.bic, row.parameters > fractional.parameters
        explains = does_as_well(gain, row.cost, fractional.cost, larger=larger)
        if not comparison.held_out:
            return explains and math.isfinite(gain)
        predicts = math.isfinite(row.error) and ratio_of(fractional, row) >= 1 - MARGIN
        return predicts and (explains or math.isnan(gain))

    return any(as_well(row) for row in comparison.rows if not row.fractional)


def not_helped(comparison: Comparison) -> Iterator[str]:
    """What held-out recordings say against the orders, which help on average."""
    if not comparison.held_out:
        yield 'No recording was held out (use = "validate").'
        return
    integer, fractional = comparison.best(fractional=False), comparison.best(fractional=True)
    helped = sum(fractional.held_out[n].error < integer.held_out[n].error for n in comparison.held_out)
    same = abs(ratio_of(fractional, integer) - 1) <= MARGIN
    if (helped <= len(comparison.held_out) / 2 and not same) or not math.isfinite(fractional.error):
        yield f"Orders help on {helped} of {len(comparison.held_out)} held-out recordings only."
