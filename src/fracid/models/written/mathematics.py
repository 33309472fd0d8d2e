r"""A model's equations as people write them, from the tree of its right-hand side: MathML and LaTeX.

A tree says how to compute; what is read is simpler.  Terms of constants that are zero go, and so do branches that only
constants decide; a variable that is used once, or is short, stands where it is used; ``2 sin a cos a`` is sin 2a; what
divides all of a derivative stands before it, so that m D v = F and not D v = F/m.  Two derivatives that are solved for
by Cramer's rule stand as the equations that were solved:

.. math::

    \dot x_i = \frac{X a - Y b}{\det},\; \dot x_j = \frac{Z b - W a}{\det}, \quad \det = X Z - Y W
    \qquad⇒\qquad  Z \dot x_i + Y \dot x_j = a,\; W \dot x_i + X \dot x_j = b .

Left out is what only keeps a program from dividing by zero: ``max(v, 1e-9)`` under a fraction is v.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce
from itertools import combinations, groupby, pairwise
from typing import ClassVar

from markupsafe import Markup

from fracid.models.base import Model
from fracid.models.joints import Complement
from fracid.models.written.equations import Flat
from fracid.models.written.reading import call, known, read_output
from fracid.models.written.tree import (
    COMPARISONS,
    Call,
    Choice,
    Entry,
    Expression,
    Meanings,
    Name,
    Number,
    Operation,
    mentioned,
    parts,
)
from fracid.safety.door import own_text
from fracid.units import GREEK, letter

GUARD = 1e-9
"""The least that something is divided by: not written."""

SHORT = 3
"""Numbers, constants and states in a variable that is written wherever it is used."""

LONG_NAME = 16
"""Letters."""

IN_A_ROW = 10
"""Numbers, constants and states."""

ZERO, ONE = Number(0.0), Number(1.0)


@dataclass(frozen=True)
class Equality:
    """A line: an output, a variable or derivatives, and what they equal."""

    left: Expression
    right: Expression


def equalities(model: Model, constants: Mapping[str, float | None], driven: bool = True) -> list[Equality]:
    """The equations to be written: what a state is the derivative of, variables, derivatives, outputs.

    Parameters
    ----------
    model : Model
    constants : mapping
        Of each parameter that is in the equations its value, or None; the others are zero.
    driven : bool
        Whether it has an input: else its terms go too.

    Raises
    ------
    InputError
        Where the right-hand side cannot be read, or has loops.

    Examples
    --------
    >>> import fracid
    >>> lines = equalities(fracid.rotary_pendulum(), {"C1": 1.0, "J_theta": 1.0, "C4": 0.1})
    >>> print(LaTeX(fracid.rotary_pendulum()).line(lines[-1]))
    C_{1}\\,D^{\\mu }\\,\\omega _{\\alpha } = -C_{4}\\,\\sin \\,\\alpha
    """
    return _Read(model, constants, driven).lines()


# --- what a tree says ----------------------------------------------------------------------------------


def terms(e: Expression) -> list[tuple[int, Expression]]:
    """The terms of a sum, each with its sign."""
    match e:
        case Operation("+" | "-" as sign, (a, b)):
            return [*terms(a), *((s if sign == "+" else -s, t) for s, t in terms(b))]
        case Operation("neg", (a,)):
            return [(-s, t) for s, t in terms(a)]
        case Number(v) if v < 0:
            return [(-1, Number(-v))]
    return [(1, e)]


def factors(e: Expression) -> list[Expression]:
    """The factors of a product."""
    match e:
        case Operation("*", (a, b)):
            return [*factors(a), *factors(b)]
        case Operation("**", (a, Number(n))) if n in (2, 3):
            return factors(a) * int(n)
    return [e]


def product(es: Sequence[Expression]) -> Expression:
    """Of factors."""
    several = [e for e in es if e != ONE] or [ONE]
    return reduce(lambda a, b: Operation("*", (a, b)), several)


class _Read(Flat):
    """Statements as definitions, simpler where the constants are known to be zero."""

    def __init__(self, model: Model, constants: Mapping[str, float | None], driven: bool) -> None:
        super().__init__(model)
        self.constants, self.driven = constants, driven
        self.inline: dict[str, Expression] = {}
        """What stands in a variable's place; of one that has a line of its own the name that its author gave it."""
        self.called: dict[str, str] = {}
        self.known: dict[Expression, Expression] = {}
        """What has a name, however often it is written."""

    def lines(self) -> list[Equality]:
        here = self._run(self.program.body, {})
        out = [Entry("out", Number(i)) for i in range(len(self.states))]
        rates = [here.get(f"out {i}", ZERO) for i in range(len(out))]
        for i, e in enumerate(rates):
            if isinstance(e, Name) and e.name in self.definitions:  # a derivative's name is the derivative
                rates[i], self.inline[e.name] = self.definitions.pop(e.name), out[i]
        known = [i for i, e in enumerate(rates) if isinstance(e, Entry) and e.array == "x"]
        solved = dict(self._solved(rates))
        found = [line for i, e in enumerate(rates) if i not in known for line in solved.get(i, [self._over(out[i], e)])]
        found += [Equality(Name(n), self._output(h)) for n, h in self.model.outputs.items() if not isinstance(h, int)]
        self.known.clear()
        left = self._placed(found)
        variables = [Equality(self._within(Name(n), {}), self._within(self.definitions[n], {})) for n in left]
        own = [Equality(self._within(e.left, {}), self._within(e.right, {})) for e in found]
        return [*(Equality(out[i], rates[i]) for i in known), *variables, *own]

    def _solved(self, rates: Sequence[Expression]) -> Iterator[tuple[int, list[Equality]]]:
        """Pairs by Cramer's rule, both at the first of them."""
        for i, j in combinations(range(len(rates)), 2):
            match rates[i], rates[j]:
                case Operation("/", (over_i, under)), Operation("/", (over_j, other)) if under == other:
                    if rows := _cramer(over_i, over_j, self._meant(under)):
                        lefts = [tuple(Operation("*", (m, Entry("out", Number(n)))) for m, n in ((Z, i), (Y, j)))
                                 for Z, Y, _ in rows]  # fmt: skip
                        yield i, [Equality(Operation("+", left), a) for left, (*_, a) in zip(lefts, rows, strict=True)]
                        yield j, []

    def _meant(self, e: Expression) -> Expression:
        """A denominator: what its name stands for, without a guard."""
        while isinstance(e, Name) and e.name in self.definitions:
            e = self.definitions[e.name]
        match e:
            case Call("max", (a, Number(0)) | (Number(0), a)):
                return a
        return e

    def _over(self, out: Expression, e: Expression) -> Equality:
        """What divides all stands on the left."""
        match e:
            case Operation("/", (a, b)) if not isinstance(b, Number):
                e = self._simple(Operation("/", (a, self._meant(b))))
                over, under = e.operands if isinstance(e, Operation) and e.sign == "/" else (e, ONE)
                return Equality(product([under, out]), over)
            case Operation("neg", (a,)):
                line = self._over(out, a)
                return Equality(line.left, Operation("neg", (line.right,)))
        return Equality(out, e)

    def _output(self, h: object) -> Expression:
        model = self.model
        functions, function = read_output(h, model.parameter_names, len(model.states), len(model.inputs))
        self.functions |= {f.name: f for f in functions}
        return self._given(function.body, {})

    def _placed(self, found: Sequence[Equality]) -> list[str]:
        """Variables that keep their line, in order; the others are written where they are used."""
        used = [n for e in found for n in mentioned((e.left, e.right)) if n in self.definitions]
        for n in reversed(self.definitions):
            if n in used:
                used += mentioned(self.definitions[n])
        choices = [e for e in self.definitions.values() if isinstance(e, Choice)]
        within = mentioned((*(e.yes for e in choices), *(e.no for e in choices)))
        for n in [n for n in self.definitions if n in used]:
            meant = self._within(self.definitions[n], {})
            if (n in within or not _long(meant)) and (used.count(n) == 1 or _size(meant) <= SHORT):
                self.inline[n] = meant
        left = [n for n in self.definitions if n in used and n not in self.inline]
        names = [self.called[n] for n in left]
        self.inline |= {n: Name(self.called[n]) for n in left if names.count(self.called[n]) == 1}
        return left

    # --- simpler

    def _defined(self, name: str, value: Expression) -> Expression:
        own = super()._defined(name, value)
        if isinstance(own, Name):
            self.called.setdefault(own.name, name)
            self.known.setdefault(value, own)
        return own

    def _within(self, e: Expression, here: Meanings) -> Expression:
        match e:
            case Name(n) if n not in here:
                return self.inline.get(n, e)
            case Entry("p", _, name) if name not in self.constants:
                return ZERO
            case Entry("u") if not self.driven:
                return ZERO
            case Entry("out"):
                return e
        found = self._simple(super()._within(e, here))
        return self.known.get(found, found)

    def _value(self, e: Expression) -> float | None:
        """Of constants alone; one that is to be found counts as 1."""
        match e:
            case Number(v):
                return v
            case Entry("p", _, name):
                return float(self.constants[name] or 1.0)
            case Operation(what, operands) | Call(what, operands) if None not in (vs := [*map(self._value, operands)]):
                return getattr(known(what, [Number(v) for v in vs if v is not None]), "value", None)
        return None

    def _simple(self, e: Expression) -> Expression:
        """One step of algebra, its operands being simple."""
        match e:
            case Operation(sign) if sign in COMPARISONS and (value := self._value(e)) is not None:
                return Number(bool(value))
            case Operation("+" | "-", (a, Number(0))) | Operation("+", (Number(0), a)):
                return a
            case Operation("*" | "/" | "**", (a, Number(1))) | Operation("*", (Number(1), a)):
                return a
            case Operation("*", (a, Number(-1)) | (Number(-1), a)) | Operation("-", (Number(0), a)):
                return self._simple(Operation("neg", (a,)))
            case Operation("*" | "/", (Number(0), _)) | Operation("*", (_, Number(0))):
                return ZERO
            case Operation("neg", (Operation("neg", (a,)),)):
                return a
            case Operation("*" | "/" as sign, (Operation("neg", (a,)), b) | (a, Operation("neg", (b,)))):
                return self._simple(Operation("neg", (self._simple(Operation(sign, (a, b))),)))
            case Operation("*", (Operation("*", (Number(2), Call("sin", (a,)))), Call("cos", (b,)))) if a == b:
                return Call("sin", (self._simple(Operation("*", (Number(2.0), a))),))
            case Operation("or", (a, Number(v))):
                return Number(True) if v else a
            case Operation("and", (_, Number(False))):
                return Number(False)
            case Operation("/", (a, b)) if ratios := [
                f for f in factors(b) if isinstance(f, Operation) and f.sign == "/"
            ]:
                c, d = ratios[0].operands
                over, under = factors(d) + factors(a), [c, *_without(factors(b), ratios[0])]
                return self._simple(Operation("/", (product(over), product(under))))
            case Operation("/", (Operation("/", (a, b)), c)):
                return self._simple(Operation("/", (a, self._simple(Operation("*", (b, c))))))
            case Operation("/", (a, b)) if shared := [f for f in factors(a) if f in factors(b)]:
                over, under = (_without(factors(part), shared[0]) for part in (a, b))
                return self._simple(Operation("/", (product(over), product(under))))
            case Call(name, arguments) if all(isinstance(part, Number) for part in arguments):
                return call(name, arguments)
            case Call("max", (a, Number(least)) | (Number(least), a)) if 0.0 < least <= GUARD:
                return a
            case Call("min", (Call("max", _), Number(0))):
                return ZERO  # what is within ±0
            case Call("copysign", (a, b)) if (of := self._value(b)) is not None:
                size = self._simple(Call("abs", (a,)))
                return size if math.copysign(1.0, of) > 0 else Operation("neg", (size,))
            case Call("abs", (Entry("p", _, name) as a,)) if self.model.parameter(name).lower >= 0:
                return a
        return e


def _cramer(over_i: Expression, over_j: Expression, under: Expression) -> list[tuple[Expression, ...]]:
    """Both rows (entry of i, entry of j, right side) of the matrix that was inverted; none where none was."""
    signed = [{s: factors(t) for s, t in terms(e)} for e in (over_i, over_j, under)]
    if any(len(terms(e)) != 2 or {*s} != {1, -1} for e, s in zip((over_i, over_j, under), signed, strict=True)):
        return []
    i, j, det = signed
    for a in [f for f in i[1] if f in j[-1]]:
        for b in [f for f in i[-1] if f in j[1]]:
            X, Y, Z, W = (_without(fs, f) for fs, f in ((i[1], a), (i[-1], b), (j[1], b), (j[-1], a)))
            if _same(X + Z, det[1]) and _same(Y + W, det[-1]):
                return [(product(Z), product(Y), a), (product(W), product(X), b)]
    return []


def _without(es: list[Expression], e: Expression) -> list[Expression]:
    k = es.index(e)
    return es[:k] + es[k + 1 :]


def _same(a: list[Expression], b: list[Expression]) -> bool:
    return sorted(map(repr, a)) == sorted(map(repr, b))


def _long(e: Expression) -> bool:
    """What has a line of its own: a choice, a limit."""
    return any(isinstance(part, Choice) or (isinstance(part, Call) and part.function in ("min", "max"))
               for part in parts(e))  # fmt: skip


def _size(e: Expression) -> int:
    """Numbers but 2, constants, states and variables in it; a constant with a long name counts as several."""
    match e:
        case Entry() if len(e.name) > LONG_NAME:
            return len(e.name) // 8
        case Number(2):
            return 0
        case Operation(_, inner) | Call(_, inner):
            return sum(map(_size, inner))
        case Choice(test, yes, no):
            return _size(test) + _size(yes) + _size(no)
    return 1


# --- how it is written ---------------------------------------------------------------------------------


def symbol(name: str) -> tuple[str, str]:
    """Letter and index of a name.

    Examples
    --------
    >>> symbol("b_theta"), symbol("C1"), symbol("D^mu alpha"), symbol("speed")
    (('b', 'θ'), ('C', '1'), ('ω', 'α'), ('speed', ''))
    """
    if name.startswith("D^"):
        of = name.split()[-1]
        return ("ω" if of in GREEK else "v"), "".join(symbol(of))
    if name.endswith("'"):
        of, index = symbol(name[:-1])
        return f"{of}′", index
    first, _, rest = name.partition("_")
    if not rest and (numbered := re.fullmatch(r"([^\W\d]+?)(\d+)", name)):
        first, rest = numbered[1], numbered[2]
    return letter(first), ",".join(letter(w) for w in rest.split("_"))


class Mathematics:
    """One language; its marks are templates."""

    marks: ClassVar[Mapping[str, str]]
    template: ClassVar[type[str]] = str
    trigonometric: ClassVar[tuple[str, ...]] = ("sin", "cos", "tan", "sinh", "cosh", "tanh")

    def __init__(
        self, model: Model, constant: Callable[[str], str | None] = lambda _: None,
        order: Callable[[str], str | None] = lambda _: None,
    ) -> None:  # fmt: skip
        """Take what a constant and an order is written as; None for their symbols."""
        self.model, self.constant, self.order = model, constant, order
        self.letters = {p.name: p.symbol for p in model.parameters if p.symbol} | dict(model.symbols)

    def mark(self, name: str, *parts: str) -> str:
        """A template with its parts."""
        return self.template(self.marks[name]).format(*parts)

    def joined(self, *parts: str) -> str:
        """One after the other."""
        return parts[0] if len(parts) == 1 else self.mark("row", self.template("").join(parts))

    def line(self, e: Equality) -> str:
        """In one row."""
        return self.template(" = ").join([self.expression(e.left), self.expression(e.right)])

    def block(self, lines: Sequence[Equality]) -> str:
        """One below the other; a long right side in rows of its own, which a narrow screen has room for."""
        rows = []
        for e in lines:
            left, equals = self.expression(e.left), self.mark("o", "=")
            first, *more = self.rows(e.right)
            short = _size(e.left) <= 2 or (not more and _size(e.left) + _size(e.right) <= IN_A_ROW)
            rows += [self.mark("eq", self.joined(left, equals, first))] if short else [
                self.mark("eq", left), self.mark("rhs", self.joined(equals, first))]  # fmt: skip
            rows += [self.mark("rhs", rest) for rest in more]
        return self.mark("block", self.template(self.marks["between"]).join(rows))

    def rows(self, e: Expression) -> list[str]:
        """A sum, as much of it in a row as a screen has room for."""
        rows: list[list[str]] = []
        room = 0
        for sign, t in terms(e):
            room -= _size(t)
            if room < 0:
                rows.append([])
                room = IN_A_ROW - _size(t)
            negative, text = self._term(sign, t)
            rows[-1] += [*self._sign(negative, first=len(rows) == 1 and not rows[0]), text]
        return [self.joined(*row) for row in rows]

    def _sign(self, negative: bool, first: bool) -> list[str]:
        return [self.mark("o", "−" if negative else "+")] if negative or not first else []

    def _term(self, sign: int, e: Expression) -> tuple[bool, str]:
        """Whether it is subtracted, and what: a negative number turns its sign."""
        numbers = [f.value for f in factors(e) if isinstance(f, Number)]
        rest = sorted((f for f in factors(e) if not isinstance(f, Number)), key=_is_variable)
        negative = (sign < 0) ^ (math.prod(numbers) < 0)
        texts = [(self.number(abs(v), ratio=bool(rest)), True) for v in numbers if abs(v) != 1 or not rest]
        for f, same in groupby(rest):
            count, text = len([*same]), self.constant(f.name) if isinstance(f, Entry) and f.array == "p" else None
            negative ^= bool(text and text.startswith("−") and count % 2)
            texts.append((self._power(f, text.lstrip("−") if text else None, count), bool(text)))
        row = [texts[0][0]]
        for (_, number), (text, another) in pairwise(texts):
            row += [self.mark("o", "·") if number and another else self.mark("space"), text]
        return negative, self.joined(*row)

    def _power(self, e: Expression, text: str | None, count: int) -> str:
        base = self._figures(text) if text else self.expression(e, 2 if count > 1 else 1)
        if count == 1:
            return base
        if isinstance(e, Call) and e.function in self.trigonometric:
            return self._called(e, str(count))
        return self.mark("power", base, self.mark("n", str(count)))

    def expression(self, e: Expression, level: int = 0) -> str:
        """In brackets where it is a factor (1) or a base (2) and may not stand so."""
        match e:
            case Number(v):
                text = self.joined(*self._sign(v < 0, first=True), self.number(abs(v)))
                return self._bracketed(text, level and v < 0)
            case Name(n):
                return self.symbol(n)
            case Entry("p", _, n):
                digits = self.constant(n)
                return self._bracketed(self._figures(digits), level and digits[0] == "−") if digits else self.symbol(n)
            case Entry("out", Number(i)):
                return self.derivative(int(i))
            case Entry(array, Number(i)):
                return self.symbol((self.model.states if array == "x" else self.model.inputs)[int(i)])
            case Choice():
                return self._cases(e)
            case Call():
                return self._called(e)
            case Operation("/", (a, b)) if level < 2:
                return self.mark("frac", self.expression(a), self.expression(b))
            case Operation("**", (a, b)):
                return self._bracketed(self.mark("power", self.expression(a, 2), self.expression(b)), level > 1)
            case Operation(sign, (a, b)) if sign in (*COMPARISONS, "and", "or"):
                word = {"<=": "≤", ">=": "≥", "==": "=", "!=": "≠"}.get(sign, sign)
                mark = self.mark("text", f" {sign} ") if sign in ("and", "or") else self.mark("o", word)
                return self.joined(self.expression(a, sign == "and"), mark, self.expression(b, sign == "and"))
            case Operation("not", (a,)):
                return self.joined(self.mark("text", "not "), self.expression(a, 1))
            case Operation(sign, (a, b)) if sign in ("%", "//"):
                mark = self.mark("text", {"%": " mod ", "//": " div "}[sign])
                return self._bracketed(self.joined(self.expression(a, 1), mark, self.expression(b, 1)), level > 0)
            case Operation("/") if level > 1:
                return self._bracketed(self._inline(e), needed=True)
        written = [self._term(*t) for t in terms(e)]
        row = [part for k, (negative, t) in enumerate(written) for part in (*self._sign(negative, first=k == 0), t)]
        return self._bracketed(self.joined(*row), level > 1 or (level == 1 and (len(written) > 1 or written[0][0])))

    def _bracketed(self, text: str, needed: object) -> str:
        return self.mark("bracket", text) if needed else text

    def _called(self, e: Call, power: str = "") -> str:
        match e:
            case Call("abs", (a,)):
                return self.joined(self.mark("o", "|"), self.expression(a), self.mark("o", "|"))
            case Call("sqrt", (a,)):
                return self.mark("sqrt", self.expression(a))
            case Call("exp", (a,)):
                return self.mark("power", self.mark("i", "e"), self._inline(a))
        name = self.mark("f", e.function)
        name = self.mark("power", name, self.mark("n", power)) if power else name
        if e.function in self.trigonometric and len(e.arguments) == 1 and _plain(e.arguments[0]):
            return self.joined(name, self.mark("space"), self.expression(e.arguments[0]))
        row = [self._inline(e.arguments[0])]
        for a in e.arguments[1:]:
            row += [self.mark("o", ","), self._inline(a)]
        return self.joined(name, self._bracketed(self.joined(*row), needed=True))

    def _inline(self, e: Expression) -> str:
        """Where a fraction would be tall."""
        match e:
            case Operation("/", (a, b)) if _plain(a) and _plain(b):
                return self.joined(self.expression(a), self.mark("o", "/"), self.expression(b, 2))
            case Operation("neg", (a,)):
                return self.joined(self.mark("o", "−"), self._inline(a))
        return self.expression(e)

    def _cases(self, e: Choice) -> str:
        rows: list[str] = []
        rest: Expression = e
        while isinstance(rest, Choice):
            word = self.mark("text", "if\N{NO-BREAK SPACE}")
            rows.append(self.mark("case", self.expression(rest.yes), word, self.expression(rest.test)))
            rest = rest.no
        rows.append(self.mark("case", self.expression(rest), self.mark("text", "otherwise"), ""))
        return self.mark("cases", self.template(self.marks["between cases"]).join(rows))

    def symbol(self, name: str, dot: bool = False) -> str:
        """Of a state, a parameter, an input or a variable."""
        own, index = self.letters.get(name) or symbol(name)
        base = self.mark("dot", self.mark("i", own)) if dot else self.mark("i", own)
        return self.mark("sub", base, self.mark("i", index)) if index else base

    def derivative(self, i: int) -> str:
        """Of a state: with its order, or a dot."""
        state, order = self.model.states[i], self.model.orders[i]
        if order == 1.0:
            return self.symbol(state, dot=True)
        if isinstance(order, Complement):
            own, text = order.parameter, self.constant(order.parameter)
            own = self._figures(text) if text else self.symbol(own)
            written = self.joined(self.mark("n", "1"), self.mark("o", "−"), own)
        else:
            text = self.order(order) if isinstance(order, str) else f"{order:.6g}"
            written = self._figures(text) if text else self.mark("i", letter(str(order)))
        return self.joined(self.mark("power", self.mark("i", "D"), written), self.mark("space"), self.symbol(state))

    def number(self, v: float, *, ratio: bool = False) -> str:
        """One that the equations have: so many times π, and as a factor a half."""
        for power in (1, 2):
            times = v ** (1 / power) / math.pi
            if 1 <= times < math.inf and abs(times - round(times)) < 1e-12 * times:
                pi = self.joined(*[self.mark("n", f"{round(times)}")] * (round(times) > 1), self.mark("i", "π"))
                return pi if power == 1 else self.mark("power", self._bracketed(pi, needed=True), self.mark("n", "2"))
        part = Fraction(v).limit_denominator(9) if math.isfinite(v) else Fraction(0)
        if ratio and part.denominator > 1 and float(part) == v:
            return self.mark("frac", self.mark("n", str(part.numerator)), self.mark("n", str(part.denominator)))
        mantissa, _, exponent = f"{v:.10g}".partition("e")
        return self._figures(f"{mantissa}×10^{int(exponent)}" if exponent else mantissa)

    def _figures(self, text: str) -> str:
        """A number as it is written, its power of ten raised."""
        plain = text.translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "−0123456789")).replace("-", "−")
        mantissa, times, _ = text.replace("-", "−").partition("×10")
        if not times:
            return self.mark("n", mantissa)
        power = self.mark("power", self.mark("n", "10"), self.mark("n", plain[len(mantissa) + 3 :].lstrip("^")))
        return self.joined(self.mark("n", mantissa), self.mark("o", "×"), power)


def _is_variable(e: Expression) -> bool:
    """What stands behind numbers and constants."""
    return not (isinstance(e, Entry) and e.array == "p")


def _plain(e: Expression) -> bool:
    """A symbol, or a number times one."""
    match e:
        case Operation("*", (Number(), a)):
            return _plain(a)
    return isinstance(e, Entry | Name | Number)


MARKS = tomllib.loads(own_text("models/written/marks.toml"))
"""Language → what is written for each part of an equation."""


class MathML(Mathematics):
    """What browsers draw by themselves."""

    template: ClassVar[type[str]] = Markup
    marks: ClassVar[Mapping[str, str]] = MARKS["MathML"]


class LaTeX(Mathematics):
    """What papers are written in, with amsmath."""

    signs: ClassVar[Mapping[str, str]] = MARKS["LaTeX signs"] | {letter: f"\\{name} " for name, letter in GREEK.items()}

    marks: ClassVar[Mapping[str, str]] = MARKS["LaTeX"]

    def mark(self, name: str, *parts: str) -> str:
        """Letters by their names, words upright, functions as LaTeX knows them."""
        if name == "f" and parts[0] in self.trigonometric:
            return f"\\{parts[0]} "
        if name in ("i", "n", "o"):
            signs = "".join(self.signs.get(c, c) for c in parts[0])
            return rf"\mathrm{{{signs}}}" if name == "i" and len(parts[0].strip("′")) > 1 else signs
        if name == "bracket" and r"\frac" in parts[0]:
            return rf"\left({parts[0]}\right)"
        return super().mark(name, *parts)
