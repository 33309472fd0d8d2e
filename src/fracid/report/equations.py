r"""The model's equations as MathML, which browsers draw by themselves: with symbols, and with the numbers found.

A model says how its own are written (:class:`fracid.models.base.Written`); of the rotary pendulum they are

.. math::

    D^λ θ = ω_θ, \qquad D^μ α = ω_α, \qquad
    \begin{aligned}
    (J_θ + C_6 \sin^2 α)\,D^λ ω_θ + C_3 \cos α\,D^μ ω_α &= f_θ \\
    C_3 \cos α\,D^λ ω_θ + C_1\,D^μ ω_α &= f_α
    \end{aligned}

with the terms that the fit has: a constant that is fixed at zero takes its term away.  Of a model whose right-hand side
is a program alone, each state with its order.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from markupsafe import Markup, escape

from fracid.report.sentences import digits, letter, number

if TYPE_CHECKING:
    from fracid.models import Model
from fracid.models.joints import Complement

__all__ = ["Writer", "equations", "named"]


def equations(model: Model, result: Mapping[str, Any], driven: bool) -> dict[str, Markup]:
    """The equations by heading, each an element ``<math>``.

    Parameters
    ----------
    model : Model
    result : mapping
        The content of result.json.
    driven : bool
        Whether a recording has an input: without one its term is left out.

    Returns
    -------
    dict
        ``With symbols`` and ``With the fitted values``; of a model that is not ours ``Its states``.

    Examples
    --------
    >>> import fracid
    >>> rig = fracid.rotary_pendulum(b_alpha=2e-4)
    >>> result = {"orders": {n: {"value": 0.9, "free": True} for n in ("lambda", "mu")},
    ...           "parameters": {p.name: {"value": p.value, "free": False} for p in rig.parameters},
    ...           "recordings": {}}
    >>> found = equations(rig, result, driven=False)
    >>> list(found), "0.0002" in found["With the fitted values"]
    (['With symbols', 'With the fitted values'], True)
    """
    if model.written is None:
        return {"Its states": _block(_states(model, result["orders"]))}
    symbols_and_numbers = (_writer(model, result, numbers=numbers) for numbers in (False, True))
    lines = (model.written.equations(write, model, result["orders"], driven) for write in symbols_and_numbers)
    return dict(zip(("With symbols", "With the fitted values"), map(_block, lines), strict=True))


def named(model: Model, result: Mapping[str, Any], driven: bool) -> frozenset[str]:
    """The constants that stand in the equations; of a model that is not ours all of them.

    Examples
    --------
    >>> import fracid
    >>> rig = fracid.rotary_pendulum(b_alpha=2e-4)
    >>> result = {"orders": {n: {"value": 0.9, "free": True} for n in ("lambda", "mu")},
    ...           "parameters": {p.name: {"value": p.value, "free": False} for p in rig.parameters},
    ...           "recordings": {}}
    >>> sorted(named(rig, result, driven=False))
    ['C1', 'C3', 'C4', 'C6', 'J_theta', 'b_alpha', 'b_theta']
    """
    if model.written is None:
        return frozenset(model.parameter_names)
    write = _writer(model, result, numbers=False)
    for _ in model.written.equations(write, model, result["orders"], driven):
        pass
    return frozenset(write.named)


def _writer(model: Model, result: Mapping[str, Any], *, numbers: bool) -> Writer:
    constants = {**result["parameters"], **_of_each_recording(result)}
    return Writer(constants, {p.name: p.symbol or (p.name, "") for p in model.parameters}, numbers)


def _of_each_recording(result: Mapping[str, Any]) -> dict[str, Any]:
    """What each recording has for itself stands as its symbol."""
    names = {n for r in result["recordings"].values() for n in r["parameters"]}
    return {n: {"value": None, "free": True} for n in names}


# --- what a model writes with -----------------------------------------------------------------------


Term = tuple[Markup, Markup]
"""Its sign, and what follows it."""

OPPOSITE = {"+": "−", "−": "+"}

IN_A_ROW = 3
"""Terms of a sum."""

SHORT = 400
"""Characters of MathML: a left side that leaves room for the right one."""


def _states(model: Model, orders: Mapping[str, Any]) -> Iterator[tuple[Markup, ...]]:
    """Each state of a model that is not ours, with its order."""
    arguments = _row(_i("t"), _o(","), _i("x"), _o(","), _i("u"), _o(","), _i("p"))
    for i, (state, order) in enumerate(zip(model.states, model.orders, strict=True), 1):
        f = _row(Markup("<msub>{}{}</msub>").format(_i("f"), _n(str(i))), _bracket(arguments))
        yield _D(_order(order, orders), _text(state)), f


def _order(order: str | float | Complement, orders: Mapping[str, Any]) -> Markup:
    """The order of a state; of a springpot's 1 − ν, which is a name where ν is a parameter."""
    if not isinstance(order, Complement):
        return _number(digits(orders[order] if isinstance(order, str) else {"value": order}))
    if order.parameter not in orders:
        return _text(str(order))
    nu = orders[order.parameter]
    return _number(digits({**nu, "value": 1.0 - nu["value"]}))


# --- MathML --------------------------------------------------------------------------------------


def _block(lines: Iterable[tuple[Any, ...]]) -> Markup:
    """One below the other; a long right side begins a row of its own, which a narrow screen has room for."""
    row = Markup('<mtr><mtd class="{}">{}</mtd></mtr>')
    rows = []
    for lhs, first, *more in lines:
        equals = _row(_o("="), first)
        short = not more and "mfrac" not in first and len(lhs) < SHORT
        rows += [row.format("eq", _row(lhs, equals))] if short else [row.format("eq", lhs), row.format("rhs", equals)]
        rows += [row.format("rhs", rest) for rest in more]
    return Markup('<math display="block"><mtable>{}</mtable></math>').format(Markup("").join(rows))


def _row(*parts: Markup) -> Markup:
    return Markup("<mrow>{}</mrow>").format(Markup("").join(parts))


def _i(name: str) -> Markup:
    return Markup("<mi>{}</mi>").format(name)


def _n(text: str) -> Markup:
    return Markup("<mn>{}</mn>").format(text)


def _o(sign: str) -> Markup:
    return Markup("<mo>{}</mo>").format(escape(sign))


def _sub(letter: str, index: str) -> Markup:
    return Markup("<msub>{}<mi>{}</mi></msub>").format(_i(letter), index) if index else _i(letter)


def _power(base: Markup, exponent: Markup) -> Markup:
    return Markup("<msup>{}{}</msup>").format(base, exponent)


def _squared(base: Markup) -> Markup:
    return _power(base, _n("2"))


def _number(text: str, *, brackets: bool = False) -> Markup:
    """A number, its power of ten raised; then a thin space, for factors follow it."""
    mantissa, times, raised = text.partition("×10")
    plain = raised.translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "−0123456789"))
    n = _row(_n(mantissa), _o("×"), _power(_n("10"), _n(plain))) if times else _n(mantissa)
    return _row(_bracket(n) if brackets else n, Markup('<mspace width="0.17em"></mspace>'))


def _bracket(inner: Markup) -> Markup:
    return _row(_o("("), inner, _o(")"))


def _size(inner: Markup) -> Markup:
    return _row(_o("|"), inner, _o("|"))


def _ratio(over: Markup, under: Markup) -> Markup:
    return _row(Markup("<mfrac>{}{}</mfrac>").format(over, under), Markup('<mspace width="0.17em"></mspace>'))


def _half() -> Markup:
    return _ratio(_n("1"), _n("2"))


def _text(words: str) -> Markup:
    return Markup("<mtext>{}</mtext>").format(words)


def _f(name: str, argument: Markup) -> Markup:
    return _row(_i(name), Markup('<mspace width="0.17em"></mspace>'), argument,
                Markup('<mspace width="0.17em"></mspace>'))  # fmt: skip


def _tanh(rate: Markup, slip: Markup) -> Markup:
    return _row(_i("tanh"), _bracket(_row(rate, _o("/"), slip)))


def _D(order: Markup, what: Markup) -> Markup:
    return _row(_power(_i("D"), order), what)


def _sum(terms: list[Term]) -> Iterator[Markup]:
    """As many in a row as a screen has room for; the first has no plus."""
    for k in range(0, len(terms), IN_A_ROW):
        row = [part for term in terms[k : k + IN_A_ROW] for part in term]
        yield _row(*(row[1:] if k == 0 and row[0] == _o("+") else row))
    if not terms:
        yield _n("0")


def _factor(e: Mapping[str, Any]) -> str:
    """Its digits; one that its interval leaves none keeps the first, or the term would say nothing."""
    text = digits(e)
    return text if text.strip("−0.") or not e["value"] else number(e["value"], ".1g")


@dataclass(frozen=True)
class Writer:
    """What a model writes its equations with: constants, as symbols or as numbers, and the marks of mathematics."""

    constants: Mapping[str, Any]
    """Of result.json, by name."""
    symbols: Mapping[str, tuple[str, str]]
    """Letter and index of each."""
    numbers: bool
    named: set[str] = field(default_factory=set)
    """Those that were written as symbols."""

    def there(self, name: str) -> bool:
        """Whether it is in the equations: left free, or not zero."""
        e = self.constants.get(name, {"value": 0.0, "free": False})
        return bool(e["free"] or e["value"])

    def __call__(self, name: str) -> Markup:
        """The constant as a factor."""
        e = self.constants.get(name)
        if self.numbers and e and e["value"] is not None:
            return _number(_factor(e), brackets=e["value"] < 0)
        self.named.add(name)
        return _sub(*self.symbols[name])

    def order(self, name: str, estimate: Mapping[str, Any]) -> Markup:
        """An order as an exponent."""
        return _number(digits(estimate)) if self.numbers else _i(letter(name))

    def term(self, sign: str, name: str, *factors: Markup, half: bool = False) -> list[Term]:
        """A constant times something, with its sign: a negative number turns it.  None where it is not there."""
        if not self.there(name):
            return []
        value = self.constants[name]["value"]
        negative = self.numbers and value is not None and value < 0
        negation = {n: -v for n in ("value", "bound") if (v := self.constants[name].get(n)) is not None}
        e = {**self.constants[name], **negation} if negative else None
        size = _number(_factor(e)) if e else self(name)
        written = self.numbers and value is not None
        first = [_half(), *([_o("·")] if written else [])] if half else []  # ½ 0.005 would read as one number
        return [(_o(OPPOSITE[sign] if negative else sign), _row(*first, size, *factors))]

    bracket = staticmethod(_bracket)
    D = staticmethod(_D)
    f = staticmethod(_f)
    i = staticmethod(_i)
    n = staticmethod(_n)
    o = staticmethod(_o)
    power = staticmethod(_power)
    ratio = staticmethod(_ratio)
    row = staticmethod(_row)
    size = staticmethod(_size)
    squared = staticmethod(_squared)
    sub = staticmethod(_sub)
    sum = staticmethod(_sum)
    tanh = staticmethod(_tanh)
    text = staticmethod(_text)
