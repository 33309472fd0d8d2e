"""A model from equations, as a project file has them, and equations from a model.

Units are checked as far as they are given: what has none, and a number, may be anything.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import zip_longest
from typing import Any

from fracid.errors import InputError, refuse_unknown
from fracid.models.base import Model, Parameter, symbol_of
from fracid.models.joints import Complement
from fracid.models.scene import scene_of
from fracid.models.written.formulas import CONSTANTS, KNOWN, LATER, WORDS, Formula, FormulaError, formula
from fracid.models.written.languages import Python
from fracid.models.written.reading import SAYS, Untranslatable, choice, new_name, operation, without_unused
from fracid.models.written.tree import (
    COMPARISONS,
    Assign,
    Call,
    Choice,
    Entry,
    Expression,
    Function,
    If,
    Meanings,
    Name,
    Number,
    Operation,
    Program,
    Return,
    Statement,
    mentioned,
)
from fracid.safety.door import own_text

ARRAYS = ("t", "x", "u", "p", "f", "out")
"""What a right-hand side has by these names in some language, so that none of its variables has."""


@dataclass(frozen=True)
class Equation:
    """What a state's derivative, or an output, equals."""

    equals: str
    order: float | str = 1.0
    """Of the derivative: a number, a name, or ``1 - nu`` of a springpot."""
    unit: str = ""
    """Of the state or the output."""
    symbol: str = ""
    """How the state is printed, ``"ω_φ"``; "" where its name says it."""
    only: Sequence[str] = ()
    """The parameters without one of which, not zero, there is no such state; none of one that is always there."""
    forgets: str = ""
    """The rate with which the state forgets, of one that :attr:`fracid.models.Model.relaxing` names [1/s]."""
    follows: str = ""
    """The state with whose value it begins."""
    size: str = ""
    """The parameter that is that state's size or time: δ of a presliding element, τ of a Maxwell element."""
    name: str = ""
    """What the model calls the state; "" where that is what equations call it."""
    note: str = ""
    """A remark for programs that have the equation, on one line."""


@dataclass(frozen=True)
class Equations:
    """What a file says of a model: makes it, and makes it again with the states that its elements need.

    Examples
    --------
    >>> axis = Equations({"position": Equation("speed"), "speed": Equation("force/m", "mu")}, inputs={"force": "N"})
    >>> model = axis.model("axis", [Parameter("m", "kg", 2.0, "")])
    >>> model.orders, model.rates, model.program.constants
    ((1.0, 'mu'), {0: 1}, frozenset({'m'}))
    """

    equations: Mapping[str, Equation]
    """State → the equation of its derivative."""
    outputs: Mapping[str, Equation] = field(default_factory=dict)
    """All states where there is none."""
    inputs: Mapping[str, str] = field(default_factory=dict)
    """Input → its unit."""
    definitions: Mapping[str, Equation] = field(default_factory=dict)
    """Name → an expression that later ones may use."""
    numbers: Mapping[str, float] = field(default_factory=dict)
    """Name → a number that it stands for in the equations, and that is no parameter."""
    scene: Mapping[str, Any] = field(default_factory=dict)
    """Body → how it is drawn: :mod:`fracid.models.scene`."""
    module: str = ""
    """Of fracid's own, for :class:`fracid.models.written.formulas.Formula`."""
    _grown: dict[Any, Model] = field(default_factory=dict, init=False, repr=False, compare=False)
    """What was made of a model before: elements go on and off all through a fit."""

    def model(self, name: str, parameters: Iterable[Parameter]) -> Model:
        """Make it.

        Raises
        ------
        InputError
            With the equation and the place in it.
        """
        constants = tuple(parameters)
        return self.made(name, constants, frozenset(p.name for p in constants if p.value != 0.0))

    def __call__(self, model: Model, on: frozenset[str]) -> Model:
        """As :attr:`fracid.models.Model.grown` asks."""
        if model.states == tuple(e.name or n for n, e in self._there(on).items()):
            return model
        key = frozenset(n for e in self.equations.values() for n in e.only) & on, model.parameters
        other = self._grown.get(key) or self._grown.setdefault(key, self.made(model.name, model.parameters, on))
        fields = ("rhs", "states", "orders", "outputs", "relaxing", "follows")
        return replace(model, **{n: getattr(other, n) for n in fields})

    def _there(self, on: frozenset[str]) -> dict[str, Equation]:
        return {n: e for n, e in self.equations.items() if not e.only or not on.isdisjoint(e.only)}

    def made(self, name: str, parameters: tuple[Parameter, ...], on: frozenset[str]) -> Model:
        """The model with the states that the parameters `on` need; others are 0 wherever they stand, and so is that."""
        _check_names({
            "[model.equations]": self.equations, "[model.inputs]": self.inputs,
            "[model.definitions]": self.definitions, "[model.parameters]": [p.name for p in parameters],
        })  # fmt: skip
        called = [e.name or n for n, e in self.equations.items()]
        for n, e in self.equations.items():
            needed = (*e.only, e.size) if e.forgets else e.only
            refuse_unknown(f"parameter in [model.equations] {n}", [p.name for p in parameters], *needed)
            refuse_unknown(f"state in [model.equations] {n}", called, *filter(None, (e.follows,)))
        there = self._there(on)
        off = {n for e in self.equations.values() for n in e.only} - {n for e in there.values() for n in e.only}
        names: dict[str, Expression] = dict.fromkeys(self.definitions, LATER)
        names |= {n: Number(v) for n, v in self.numbers.items()} | dict.fromkeys(self.equations, Number(0.0))
        names |= {n: Entry("x", Number(i)) for i, n in enumerate(there)}
        names |= {n: Entry("u", Number(i)) for i, n in enumerate(self.inputs)}
        names |= {p.name: Number(0.0) if p.name in off else Entry("p", Number(k), p.name)
                  for k, p in enumerate(parameters)}  # fmt: skip
        own = {p.name: p.unit for p in parameters} | {n: e.unit for n, e in there.items()}
        for n, unit in own.items():
            factor, si = in_si(unit)
            if abs(factor - 1.0) > 1e-9 and all(part in UNITS for part, *_ in _parts(si)):
                raise InputError(SAYS("not-si", name=n, unit=unit, factor=factor, si=si))
        units = _Units(names, {**self.inputs} | own)
        for e in self.outputs.values():
            if e.unit and e.equals.strip() in there:
                units.given(e.equals.strip(), e.unit)
        relaxing = [n for n, e in there.items() if e.forgets]
        states = tuple(there)
        variables = {n: new_name(n, {*ARRAYS, *self.definitions}) if n in ARRAYS else n for n in self.definitions}
        rows: list[tuple[Name | Entry, str, str, str]] = [
            *((Name(variables[n]), f"[model.definitions] {n}", e.equals, e.note) for n, e in self.definitions.items()),
            *((Entry("out", Number(i)), f"[model.equations] {n}", e.equals, e.note)
              for i, (n, e) in enumerate(there.items())),
            *((Entry("out", Number(len(states) + states.index(n))), f"[model.equations] {n}: forgets",
               there[n].forgets, "") for n in relaxing),
        ]  # fmt: skip
        body: list[Assign] = []
        for n, (target, where, text, note) in zip_longest(variables, rows):
            value = formula(text, names, where, units.columns)
            body.append(Assign(target, value, note))
            if n is not None:
                names[n] = value if isinstance(value, Number | Name | Entry) else target
        rates = body[len(self.definitions) : len(self.definitions) + len(states)]
        units.orders |= {Entry("x", Number(i)): e.order for i, e in enumerate(there.values())}
        units.spread(dict(zip(states, (s.value for s in rates), strict=True)))
        for s, (_, where, text, _) in zip(body, rows, strict=True):
            units.check(s, text, where)
        program = Program(states, tuple(map(states.index, relaxing)), (), without_unused(tuple(body)))
        return Model(
            name=name, rhs=Formula(program, self.module),
            states=tuple(e.name or n for n, e in there.items()),
            orders=tuple(order_of(n, e.order) for n, e in there.items()),
            outputs={n: _output(n, e, names, units, body=body) for n, e in self.outputs.items()}
            or {n: i for i, n in enumerate(states)},
            inputs=tuple(self.inputs), parameters=parameters, zero="", source="equations",
            input_units={n: unit for n, unit in self.inputs.items() if unit},
            output_units={n: e.unit for n, e in self.outputs.items() if e.unit},
            angles=tuple(n for n, e in self.outputs.items() if e.unit == "rad"),
            symbols={e.name or n: symbol_of(e.symbol) for n, e in self.equations.items() if e.symbol},
            follows={e.name or n: e.follows for n, e in there.items() if e.follows},
            relaxing={n: there[n].size for n in relaxing},
            scene=scene_of(self.scene, self.outputs or there, [p.name for p in parameters], self.numbers),
            grown=self if any(e.only for e in self.equations.values()) else None,
        )  # fmt: skip


def equations_in(table: Mapping[str, Any]) -> dict[str, Equation]:
    """Those of a table: each is a text, or a table of its own."""
    return {n: Equation(e) if isinstance(e, str) else Equation(**dict(e)) for n, e in table.items()}


def _check_names(kinds: Mapping[str, Iterable[str]]) -> None:
    seen: dict[str, str] = {}
    for kind, names in kinds.items():
        for n in names:
            if not (n.isascii() and n.isidentifier()) or n in (*KNOWN, *CONSTANTS, *WORDS):
                raise InputError(SAYS("no-name", kind=kind, name=n))
            if n in seen:
                raise InputError(f"{n} stands in {seen[n]} and in {kind}; give each its own name.")
            seen[n] = kind


def order_of(name: str, order: float | str) -> float | str | Complement:
    """The order of a state as a file has it.

    Examples
    --------
    >>> order_of("y", "1 - nu")
    Complement(parameter='nu')
    """
    if isinstance(order, str) and (match := re.fullmatch(r"\s*1\s*-\s*([^\W\d]\w*)\s*", order)):
        return Complement(match[1])
    if isinstance(order, str) and not order.isidentifier():
        raise InputError(f'[model.equations] {name}: order = {order!r}; expected a number, a name or "1 - nu".')
    return order


def _output(name: str, e: Equation, names: Meanings, units: _Units, body: Sequence[Assign]) -> int | Formula:
    """A state's index, or a function."""
    where = f"[model.outputs] {name}"
    value = formula(e.equals, names, where, units.columns)
    match value:
        case Entry("x", Number(i)):
            return int(i)
    units.check(Assign(Name(name), value), e.equals, where, dimension(e.unit))
    definitions = [s for s in body if isinstance(s.target, Name)]
    return Formula(Function(name, ("t", "x", "u", "p"), without_unused((*definitions, Return(value)))))


# --- units ---------------------------------------------------------------------------------------------

Dimension = tuple[float, ...]
"""Powers of kg, m, s, A, K and mol; an angle has none."""

_TABLE = tomllib.loads(own_text("models/written/units.toml"))

UNITS: dict[str, Dimension] = {n: tuple(powers) for n, powers in _TABLE["si"].items()}

_PLAIN: dict[str, tuple[float, str]] = _TABLE["others"] | {n: (1.0, n) for n in UNITS}

OTHERS = {f"{prefix}{n}": (size * factor, of) for prefix, size in _TABLE["prefixes"].items()
          for n, (factor, of) in _PLAIN.items() if n.isalpha()} | _PLAIN  # fmt: skip
"""Unit → the factor to SI, and the unit there."""

NONE = UNITS["1"]
SECOND = UNITS["s"]


def dimension(unit: str) -> Dimension | None:
    """Powers of kg, m, s, A, K and mol; None where they are not known.

    Examples
    --------
    >>> dimension("N s/m") == dimension("kg/s"), dimension("F s^(q-1)")
    (True, None)
    """
    factor, text = in_si(unit)
    total = NONE if text and factor == 1.0 else None
    for name, power, _ in _parts(text):
        total = _times(total, UNITS[name], power) if total and name in UNITS else None
    return None if total is None or math.isnan(sum(total)) else total


def in_si(unit: str) -> tuple[float, str]:
    """The factor to SI, NaN where a prefix has a power that is no number, and the unit there.

    Examples
    --------
    >>> in_si("mN/m"), in_si("s^-q")
    ((0.001, 'N/m'), (1.0, 's^-q'))
    """
    factor, text = 1.0, ""
    for name, power, written in _parts(unit):
        size, of = OTHERS.get(name, (1.0, name))
        factor *= size**power
        for n, own, _ in _parts(of):
            text += f"{' ' if (written[0] == '/') == (own < 0) else '/'}{n}{written[1:]}"
    return factor, f"1{text}" if text[:1] == "/" else text.strip()


def _parts(unit: str) -> Iterator[tuple[str, float, str]]:
    """The units of a product, each with its power, NaN where that is no number, and with that as it is written."""
    for part in re.sub(r"\s*([/*·])\s*", r" \1", unit).split():
        name, raised, text = part.lstrip("/*·").partition("^")
        power = float(text or 1) if re.fullmatch(r"-?\d+(\.\d+)?|", text) else math.nan
        yield name, -power if part[0] == "/" else power, f"{part[0]}{raised}{text}"


def unknown_units(units: Mapping[str, str]) -> Iterator[str]:
    """Say which units have a part that is not known, so that equations with them are not checked.

    Examples
    --------
    >>> [*unknown_units({"k": "lb/s", "c": "N s^q/m"})]
    ["The unit of k has 'lb', ... not checked for units; expected SI, as in N m s/rad."]
    """
    for name, unit in units.items():
        for part in (n for n, *_ in _parts(in_si(unit)[1]) if n not in UNITS and not {*n} & {*"()"}):
            yield SAYS("unknown-unit", name=name, part=part)


def _times(a: Dimension, b: Dimension, power: float = 1.0) -> Dimension:
    return tuple(x + power * y for x, y in zip(a, b, strict=True))


def _shown(d: Dimension) -> str:
    names = ("kg", "m", "s", "A", "K", "mol")
    return " ".join(f"{n}^{p:g}" if p != 1 else n for n, p in zip(names, d, strict=True) if p) or "a plain number"


class _Units:
    """What is known of units, and whether equations agree with it."""

    def __init__(self, names: Meanings, units: Mapping[str, str]) -> None:
        self.columns: dict[int, int] = {}
        self.orders: dict[Expression, float | str] = {}
        self.known: dict[Expression, Dimension | None] = {names[n]: dimension(unit) for n, unit in units.items()}
        self.names, self.text, self.where = names, "", ""

    def given(self, name: str, unit: str) -> None:
        """Of a state, by its output."""
        self.known[self.names[name]] = self.known.get(self.names[name]) or dimension(unit)

    def spread(self, rates: Meanings) -> None:
        """Where a state is the derivative of another, the unit of one says the other's."""
        pairs = [(self.names[n], e) for n, e in rates.items() if isinstance(e, Entry) and e.array == "x"
                 and (isinstance(order := self.orders[self.names[n]], str) or order == 1)]  # fmt: skip
        for _ in pairs:
            for state, rate in pairs:
                if (unit := self.known.get(state)) and not self.known.get(rate):
                    self.known[rate] = _times(unit, SECOND, -1)
                elif (unit := self.known.get(rate)) and not self.known.get(state):
                    self.known[state] = _times(unit, SECOND)

    def check(self, s: Assign, text: str, where: str, expected: Dimension | None = None) -> None:
        """One equation: its parts among each other, and with what it is to be."""
        self.text, self.where, order, per_second = text, where, None, expected
        unit = self.of(s.value)
        if isinstance(s.target, Name):
            self.known[s.target] = unit
        elif state := self.known.get(entry := Entry("x", s.target.index)):
            order, per_second = self.orders[entry], _times(state, SECOND, -1)  # which the paper has at any order
            expected = per_second if isinstance(order, str) else _times(state, SECOND, -order)
        if unit and expected and unit not in (expected, per_second):
            by_time = all(a == b for a, b, second in zip(unit, expected, SECOND, strict=True) if not second)
            free = f" {SAYS('free-order', order=order)}" * (by_time and isinstance(order, str))
            inside = "in " * (unit != NONE)
            raise FormulaError(text, 0, f"This is {inside}{_shown(unit)}; expected {_shown(expected)}.{free}", where)

    def of(self, e: Expression) -> Dimension | None:
        """Its unit; None where that is not known."""
        match e:
            case Name() | Entry():
                return self.known.get(e)
            case Choice(test, yes, no):
                self.of(test)
                return self._same(e, "chooses between", yes, no)
            case Operation("*" | "/" | "//" as sign, (a, b)):
                over, under = self.of(a), self.of(b)
                return _times(over, under, 1 if sign == "*" else -1) if over and under else None
            case Operation("**", (a, Number(power))):
                base = self.of(a)
                return _times(NONE, base, power) if base else None
            case Operation("**", (a, n)):
                if (unit := self.of(n)) not in (None, NONE):
                    self._wrong(e, f"An exponent is a plain number, not {_shown(unit)}.")
                return NONE if self.of(a) == NONE else None
            case Operation(sign, operands):
                unit = self._same(e, {"+": "adds", "-": "subtracts", "%": "divides"}.get(sign, "compares"), *operands)
                return NONE if sign in (*COMPARISONS, "and", "or", "not") else unit
            case Call("min" | "max" | "abs" | "floor" | "ceil" | "trunc" | "fmod" | "hypot" | "atan2" as f, arguments):
                unit = self._same(e, f"takes for {f}", *arguments)
                return NONE if f == "atan2" else unit
            case Call("sqrt" | "cbrt" as f, (a,)):
                return self.of(Operation("**", (a, Number(1 / 2 if f == "sqrt" else 1 / 3))))
            case Call("sign" | "copysign" as f, (a, *_)):
                unit = self.of(a)
                return NONE if f == "sign" else unit
            case Call(f, arguments):
                for a in arguments:
                    if (unit := self.of(a)) and unit != NONE:
                        self._wrong(e, f"`{f}` takes a plain number or an angle, not {_shown(unit)}.")
                return NONE
        return None

    def _same(self, e: Expression, does: str, *operands: Expression) -> Dimension | None:
        units = [unit for a in operands if (unit := self.of(a))]
        if units and units[0] != units[-1]:
            self._wrong(e, f"It {does} {_shown(units[0])} and {_shown(units[-1])}.")
        return units[0] if units else None

    def _wrong(self, e: Expression, why: str) -> None:
        raise FormulaError(self.text, self.columns.get(id(e), 0), why, self.where)


# --- a model as equations ------------------------------------------------------------------------------


class _Text(Python):
    """Expressions as a project file has them."""

    def __init__(self, program: Program, names: Mapping[Entry, str]) -> None:
        super().__init__(program)
        self.names = names

    def entry(self, e: Entry) -> str:
        """By its name."""
        return self.names[Entry(e.array, e.index)]

    def name(self, name: str) -> str:
        """As it is."""
        return name

    def _called(self, f: str) -> str:
        return f


def equations_of(model: Model) -> dict[str, dict[str, Any]]:
    """A model as the tables of a project file, but for its constants and orders, by names that equations may have.

    Raises
    ------
    InputError
        Where it has loops.

    Examples
    --------
    >>> import fracid
    >>> tables = equations_of(fracid.rotary_pendulum())
    >>> tables["definitions"]["M12"], tables["equations"]["theta"]
    ('C3 * cosine', {'equals': 'theta_rate', 'order': 'lambda'})
    """
    flat, n = Flat(model), len(model.states)
    rates, seen = flat.entries(model.program), flat.entries(model.outputs_program)
    write = flat.writer(flat.states)
    called = dict(zip(model.states, flat.states, strict=True))
    orders = (str(q) if isinstance(q, Complement) else q for q in model.orders)
    equations = {s: {"equals": write(r), "order": q} for s, r, q in zip(flat.states, rates, orders, strict=False)}
    for (state, size), forgets in zip(model.relaxing.items(), rates[n:], strict=True):
        equations[called[state]] |= {"forgets": write(forgets), "size": size}
    for state, leader in model.follows.items():
        equations[called[state]]["follows"] = called[leader]
    units = {name: model.output_unit(name) for name in model.shown}
    return {
        "inputs": {name: model.input_units.get(name, "") for name in model.inputs},
        "input_rates": dict(model.input_rates), "input_defaults": dict(model.input_defaults),
        "definitions": {name: write(value) for name, value in flat.definitions.items()},
        "equations": equations,
        "outputs": {name: {"equals": write(value)} | ({} if units[name] == "1" else {"unit": units[name]})
                    for name, value in zip(units, seen, strict=True)},
        "scene": {} if model.scene is None else model.scene.rows(flat.writer(model.scene.outputs)),
    }  # fmt: skip


class Flat:
    """Statements as definitions: what a branch assigns becomes a choice, what a function gives stands in its place."""

    def __init__(self, model: Model) -> None:
        """Read its right-hand side."""
        self.model, self.program = model, model.program
        self.functions = {f.name: f for f in self.program.functions}
        self.values: dict[str, Expression] = {}
        self.definitions: dict[str, Expression] = {}
        self.taken = {*model.parameter_names, *model.inputs, *KNOWN, *CONSTANTS, *WORDS}
        self.states = tuple(self._new(n) for n in self._named())

    def entries(self, program: Program) -> list[Expression]:
        """What a program of the model leaves in ``out``; the definitions are those that something of it reads."""
        self.functions |= {f.name: f for f in program.functions}
        before, here = {*self.definitions}, self._run(program.body, {})
        out = [here[name] for name in sorted((n for n in here if n.startswith("out ")), key=lambda n: int(n[4:]))]
        while unused := {*self.definitions} - before - {*mentioned((*self.definitions.values(), *out))}:
            self.definitions = {k: v for k, v in self.definitions.items() if k not in unused}
        return out

    def writer(self, states: Iterable[str]) -> Callable[[Expression], str]:
        """What writes an expression, with these names for the states."""
        arrays = {"x": states, "u": self.model.inputs, "p": self.model.parameter_names}
        names = {Entry(array, Number(i)): n for array, own in arrays.items() for i, n in enumerate(own)}
        return _Text(self.program, names).expression

    def _new(self, name: str) -> str:
        plain = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_") or "v"
        plain = plain if plain[0].isalpha() else f"v{plain}"
        self.taken.add(found := new_name(plain, self.taken))
        return found

    def _named(self) -> list[str]:
        """A state is called as its output is, or as the variable that it is given to."""
        names = {i: n for n, i in self.model.output_states.items()}
        for s in self.program.body:
            match s:
                case Assign(Name(n), Entry("x", Number(i))):
                    names.setdefault(int(i), n)
        return [names.get(i, n) for i, n in enumerate(self.program.states)]

    def _run(self, body: Sequence[Statement], here: dict[str, Expression]) -> dict[str, Expression]:
        """What each variable and entry of out is afterwards."""
        for s in body:
            match s:
                case Assign(Name(n), value):
                    here = here | {n: self._defined(n, self._within(value, here))}
                case Assign(Entry("out", Number(i)), value):
                    here = here | {f"out {i}": self._within(value, here)}
                case If(test, yes, no):
                    when = self._within(test, here)
                    if isinstance(when, Number):
                        here = self._run(yes if when.value else no, here)
                        continue
                    a, b = self._run(yes, here), self._run(no, here)
                    for n in {**a, **b}:
                        if a.get(n) != b.get(n):
                            either = Choice(when, a.get(n, Number(0.0)), b.get(n, Number(0.0)))
                            here = here | {n: either if n.startswith("out ") else self._defined(n, either)}
                case _:
                    raise Untranslatable("A loop cannot be written as an equation.")
        return here

    def _defined(self, name: str, value: Expression) -> Expression:
        """A name for it, but for what is short."""
        if isinstance(value, Number | Entry | Name):
            return value
        if self.definitions.get(name) == value:
            return Name(name)
        own = self._new(name)
        self.definitions[own] = value
        return Name(own)

    def _within(self, e: Expression, here: Meanings) -> Expression:
        """With what each name stands for."""
        match e:
            case Name(n):
                return here.get(n, Number(0.0))
            case Entry("out", Number(i)):
                return here[f"out {i}"]
            case Call(f, arguments) if f in self.functions:
                function = self.functions[f]
                given = dict(zip(function.arguments, (self._within(a, here) for a in arguments), strict=True))
                return self._given(function.body, given)
            case Call(f, arguments):
                return Call(f, tuple(self._within(a, here) for a in arguments))
            case Operation(sign, operands):
                return operation(sign, *(self._within(a, here) for a in operands))
            case Choice(test, yes, no):
                return choice(*(self._within(part, here) for part in (test, yes, no)))
        return e

    def _given(self, body: Sequence[Statement], here: dict[str, Expression]) -> Expression:
        """What a function returns."""
        for k, s in enumerate(body):
            match s:
                case Return(value) if value is not None:
                    return self._within(value, here)
                case Assign(Name(n), value):
                    here = here | {n: self._within(value, here)}
                case If(test, yes, no):
                    when, rest = self._within(test, here), [*body[k + 1 :]]
                    if isinstance(when, Number):
                        return self._given([*(yes if when.value else no), *rest], here)
                    return Choice(when, self._given([*yes, *rest], here), self._given([*no, *rest], here))
                case _:
                    break
        raise Untranslatable("A loop cannot be written as an equation.")
