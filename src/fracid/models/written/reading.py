"""Python read into a tree: a right-hand side, the functions that it calls, and all that they close over.

What is known when a model is made is evaluated: constants, sizes of arrays, branches on them, short loops.  A function
of numbers stays one; one that takes an array, such as :func:`fracid.models.joints.presliding`, is put where it is
called, for so no language has to pass arrays.  Python's own syntax tree is all that is looked at: nothing is run.
"""

from __future__ import annotations

import ast
import inspect
import math
import operator
import textwrap
import tokenize
import tomllib
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial, reduce
from io import StringIO
from itertools import chain, count
from pkgutil import resolve_name
from types import FunctionType
from typing import Any

import numpy as np

from fracid.errors import InputError
from fracid.findings import Words
from fracid.models.written.tree import (
    Assign,
    Call,
    Choice,
    Entry,
    Expression,
    Function,
    If,
    Leave,
    Loop,
    Name,
    Number,
    Operation,
    Program,
    Return,
    Statement,
    assigned_names,
    is_truth,
    mentioned,
    parts,
)
from fracid.safety.door import own_text

SAYS = Words("models/written/refusals.toml")

_TABLE = tomllib.loads(own_text("models/written/reading.toml"))

FUNCTIONS: tuple[str, ...] = tuple(_TABLE["functions"])
"""Of ``math``, by their names there; ``abs``, ``min``, ``max`` and ``sign`` are known too."""

_CALLED: dict[Any, str] = {resolve_name(place): n for n, places in _TABLE["called"].items() for place in places}
"""Python's function → its name in a tree."""

_SIGNS: dict[type, str] = {getattr(ast, node): sign for sign, (node, _) in _TABLE["signs"].items()}

_VALUES: dict[str, Callable[..., Any]] = {
    **{sign: getattr(operator, name) for sign, (_, name) in _TABLE["signs"].items()},
    **{n: getattr(math, n) for n in FUNCTIONS}, "sign": lambda v: math.copysign(1.0, v) if v else 0.0,
    "neg": operator.neg, "not": operator.not_, "and": lambda a, b: a and b, "or": lambda a, b: a or b,
    "abs": abs, "min": min, "max": max,
}  # fmt: skip
"""Of operations and functions, by their names in a tree."""

UNROLLED = 100
"""Rounds of a loop whose number is known that are written out; more stay a loop."""

ADVICE = "Numbers, math, if, for, while, x[0] and functions of these are translated."


class Untranslatable(InputError):
    """Part of a right-hand side that cannot be written in other languages."""


@dataclass(frozen=True)
class View:
    """An array of a right-hand side, or a piece of one."""

    array: str
    start: int
    count: int


class _Time:
    """The first argument of a right-hand side."""


@lru_cache(maxsize=256)
def read(
    rhs: Any, parameters: tuple[str, ...], states: tuple[str, ...], relaxing: tuple[int, ...], inputs: int
) -> Program:
    """Read a right-hand side.

    Parameters
    ----------
    rhs : function
        ``rhs(t, x, u, p, out)``.
    parameters, states : tuple of str
        Names of p and x.
    relaxing : tuple of int
        States whose rates are asked for, behind the derivatives in ``out``.
    inputs : int

    Raises
    ------
    Untranslatable
        With file, line, and what to write instead.

    Examples
    --------
    >>> import fracid
    >>> read(lambda t, x, u, p, out: None, (), (), (), 0)
    Traceback (most recent call last):
    fracid.models.written.reading.Untranslatable: ... is no function with a name; write it with def.
    """
    n, unit = len(states), _Unit(parameters)
    statements, _ = unit.body(rhs, n, inputs, View("out", 0, n + n * bool(relaxing)))
    body = without_unused(tuple(statements))
    off = tuple(Assign(Entry("out", Number(n + i)), Number(0.0)) for i in relaxing if not _always(body, n + i))
    kept = {n + i for i in relaxing} | {*range(n)}
    asked = tuple(_without(body, lambda s: isinstance(s.target, Entry) and s.target.index.value not in kept))  # type: ignore[union-attr]
    return Program(states, relaxing, unit.read, off + asked)


def read_output(h: Any, parameters: tuple[str, ...], states: int, inputs: int) -> tuple[tuple[Function, ...], Function]:
    """An output ``h(t, x, u, p)``, and before it the functions that it calls.

    Examples
    --------
    >>> def height(t, x, u, p):
    ...     return p[0] * math.sin(x[0])
    >>> read_output(height, ("l",), 1, 0)[1].body[0].value.sign
    '*'
    """
    unit = _Unit(parameters)
    statements, value = unit.body(h, states, inputs)
    return unit.read, Function(h.__name__, ("t", "x", "u", "p"), (*statements, Return(value)))


def read_outputs(outputs: Sequence[Any], parameters: tuple[str, ...], states: int, inputs: int) -> Program:
    """Outputs as a program of their own: each is an entry of ``out``; a number among them is that of a state.

    Examples
    --------
    >>> read_outputs([0, lambda t, x, u, p: x[0]], (), 1, 0)
    Traceback (most recent call last):
    fracid.models.written.reading.Untranslatable: ... is no function with a name; write it with def.
    """
    unit, body = _Unit(parameters), list[Statement]()
    for i, h in enumerate(outputs):
        statements, value = ([], Entry("x", Number(h))) if isinstance(h, int) else unit.body(h, states, inputs)
        body += [*statements, Assign(Entry("out", Number(i)), value)]
    return Program(tuple(f"output {i}" for i in range(len(outputs))), (), unit.read, without_unused(tuple(body)))


def read_functions(*functions: Any) -> tuple[Function, ...]:
    """Functions of numbers, each after those that it calls.

    Examples
    --------
    >>> from fracid.models.joints import sliding
    >>> [f.name for f in read_functions(sliding)]
    ['stribeck', 'sliding']
    """
    unit = _Unit(())
    for f in functions:
        unit.function(f)
    return unit.read


def _always(body: Sequence[Statement], index: int) -> bool:
    """Whether an entry of ``out`` is written whatever branch is taken."""
    return any(
        (isinstance(s, Assign) and s.target == Entry("out", Number(index)))
        or (isinstance(s, If) and _always(s.body, index) and _always(s.orelse, index))
        for s in body
    )


def without_unused(body: tuple[Statement, ...]) -> tuple[Statement, ...]:
    """Without variables that nobody reads."""
    while True:
        names = mentioned(body)
        targets = assigned_names(body)
        if not (unused := {n for n in targets if names.count(n) == targets.count(n)}):
            return body
        body = tuple(_without(body, lambda s, unused=unused: isinstance(s.target, Name) and s.target.name in unused))  # type: ignore[misc]


def _without(body: tuple[Statement, ...], gone: Callable[[Assign], bool]) -> Iterator[Statement]:
    for s in body:
        if isinstance(s, If):
            s = replace(s, body=tuple(_without(s.body, gone)), orelse=tuple(_without(s.orelse, gone)))
            if not s.body:
                s = If(operation("not", s.test), s.orelse, (), s.note)
            if not s.body:
                continue
        elif isinstance(s, Loop):
            s = replace(s, body=tuple(_without(s.body, gone)))
        elif isinstance(s, Assign) and gone(s):
            continue
        yield s


# --- expressions ---------------------------------------------------------------------------------------


def function_of(function: Any) -> Any:
    """Of what Numba compiled the Python function."""
    return getattr(function, "py_func", function)


def operation(sign: str, *operands: Expression) -> Expression:
    """An operation, or its value where that is known.

    Examples
    --------
    >>> operation("*", Number(2.0), Number(3.0))
    Number(value=6.0)
    """
    if sign in ("and", "or") and isinstance(operands[0], Number):
        return operands[1] if bool(operands[0].value) == (sign == "and") else operands[0]
    if sign in ("and", "or") and isinstance(operands[1], Number) and bool(operands[1].value) == (sign == "and"):
        return operands[0]
    return known(sign, operands) or Operation(sign, operands)


def known(what: str, operands: Sequence[Expression]) -> Number | None:
    """The value of an operation or a function of numbers, where it has one.

    Examples
    --------
    >>> known("sqrt", [Number(4.0)]), known("/", [Number(1.0), Number(0.0)])
    (Number(value=2.0), None)
    """
    values = [e.value for e in operands if isinstance(e, Number)]
    if what in _VALUES and len(values) == len(operands):
        with suppress(ArithmeticError, ValueError):
            value = _VALUES[what](*values)
            return Number(value) if isinstance(value, int | float) else None
    return None


def truth(e: Expression) -> Expression:
    """As a test: a number is true where it is not 0."""
    if isinstance(e, Number):
        return Number(bool(e.value))
    return e if is_truth(e) else operation("!=", e, Number(0.0))


def choice(test: Expression, yes: Expression, no: Expression) -> Expression:
    """One of two, or the one that it is."""
    if isinstance(test, Number):
        return yes if test.value else no
    return Choice(test, yes, no)


def call(name: str, arguments: Sequence[Expression]) -> Expression:
    """A function of mathematics."""
    first, *more = arguments
    if name == "**":
        return operation("**", *arguments)
    if name in ("min", "max") and len(arguments) > 2:
        return call(name, [call(name, arguments[:-1]), arguments[-1]])
    if name == "log" and more:
        return operation("/", call(name, [first]), call(name, more))
    return known(name, arguments) or Call(name, tuple(arguments))


# --- functions -----------------------------------------------------------------------------------------


@dataclass
class _Unit:
    """A program while it is read."""

    parameters: tuple[str, ...]
    functions: dict[Any, Function | None] = field(default_factory=dict)
    passing: set[str] = field(default_factory=set)
    """Variables that hold what a call gave, the last statement before it is used."""

    @property
    def read(self) -> tuple[Function, ...]:
        """The functions that are called, each after those that it calls."""
        return tuple(f for f in self.functions.values() if f is not None)

    def body(self, f: Any, states: int, inputs: int, *out: View) -> tuple[list[Statement], Any]:
        """The statements of a right-hand side, or of an output where there is no `out`, and what that returns."""
        match getattr(f, "tree", None):
            case Function(body=(*statements, Return(value))):
                return statements, value
        f = function_of(f)
        scope = _Scope(self, {"x", "u", "p", "t", *(("f", "out") if out else ())}, [], stack=(f,))
        arrays = View("x", 0, states), View("u", 0, inputs), View("p", 0, len(self.parameters)), *out
        scope.here = dict(zip([a.arg for a in scope.node.args.args], (_Time(), *arrays), strict=True))
        value = scope.finish(scope.node.body)
        if not out and not isinstance(value, Expression):
            raise scope.wrong(scope.node, "An output is a number.")
        return scope.statements, value

    def function(self, f: Any, stack: tuple[Any, ...] = ()) -> str:
        """The name of a function of numbers, which is read where it is new; none where it calls itself."""
        if f not in self.functions:
            taken = {g.name for g in self.functions.values() if g is not None} | {*_VALUES}
            self.functions[f] = None  # while it is being read
            scope = _Scope(self, set(), [], stack=(*stack, f))
            names = [a.arg for a in scope.node.args.args]
            scope.names = {name: scope.fresh(name) for name in names}
            scope.all_of(scope.node.body, within=False)
            about = (f.__doc__ or "").strip().partition("\n")[0]
            del self.functions[f]
            self.functions[f] = Function(new_name(f.__name__, taken), tuple(scope.names[n] for n in names),
                                         without_unused(tuple(scope.statements)), about)  # fmt: skip
        found = self.functions[f]
        return found.name if found else ""


def new_name(name: str, taken: Collection[str]) -> str:
    """The name, or with a number behind it where it is taken.

    Examples
    --------
    >>> new_name("x", {"x", "x_2"})
    'x_3'
    """
    return next(n for n in chain([name], (f"{name}_{k}" for k in count(2))) if n not in taken)


class _Scope:
    """A function's body while it is read: what its names stand for, and the statements so far."""

    def __init__(self, unit: _Unit, taken: set[str], statements: list[Statement], stack: tuple[Any, ...]) -> None:
        self.unit, self.taken, self.statements, self.stack = unit, taken, statements, stack
        self.here: dict[str, Any] = {}
        """What a name stands for now, where that is known: a number, a constant of the model, an array."""
        self.names: dict[str, str] = {}
        """Own variable → its name in the tree."""
        self.file, self.first, self.node, self.notes = _source(stack[-1])
        self.within_loop = False
        reach = inspect.getclosurevars(stack[-1])
        self.known = {**reach.builtins, **reach.globals, **reach.nonlocals}

    def wrong(self, at: ast.AST, why: str) -> Untranslatable:
        line = self.first + getattr(at, "lineno", 1) - 1
        text = ast.unparse(at).partition("\n")[0]
        return Untranslatable(f"{self.file}, line {line}: fracid does not translate `{text[:80]}`. {why}")

    def fresh(self, name: str) -> str:
        name = new_name(name, self.taken)
        self.taken.add(name)
        return name

    # --- values

    def value(self, e: ast.expr | None) -> Any:
        """An expression of the tree; or an array, a tuple, a function, where it stands for one."""
        match e:
            case None:
                return None
            case ast.Constant(bool() | int() | float() as v):
                return Number(v)
            case ast.Name(n):
                return self._named(n, e)
            case ast.Attribute(of, n):
                if not hasattr(thing := self.value(of), n) or isinstance(thing, Expression | View):
                    raise self.wrong(e, ADVICE)
                return _as_number(getattr(thing, n))
            case ast.Tuple(elements) | ast.List(elements):
                return self._one_after_the_other(elements, self.value)
            case ast.Subscript(of, index):
                return self._entry(self.value(of), index, e)
            case ast.BinOp(a, op, b) if type(op) in _SIGNS:
                return operation(_SIGNS[type(op)], *self._one_after_the_other([a, b]))
            case ast.UnaryOp(ast.USub(), a):
                return operation("neg", self.expression(a))
            case ast.UnaryOp(ast.UAdd(), a):
                return self.expression(a)
            case ast.UnaryOp(ast.Not(), a):
                return operation("not", truth(self.expression(a)))
            case ast.BoolOp(op, values):
                return self._logic(op, values)
            case ast.Compare(a, signs, more) if all(type(s) in _SIGNS for s in signs):
                sides = self._one_after_the_other([a, *more])
                pairs = (operation(_SIGNS[type(s)], *sides[k : k + 2]) for k, s in enumerate(signs))
                return reduce(partial(operation, "and"), pairs)
            case ast.IfExp(test, yes, no):
                return self._either(truth(self.expression(test)), lambda: self.value(yes), lambda: self.value(no))
            case ast.Call(f, arguments, keywords):
                return self._call(self.value(f), arguments, keywords, e)
        raise self.wrong(e, ADVICE)

    def expression(self, e: ast.expr | None) -> Expression:
        """A number."""
        value = self.value(e)
        if isinstance(value, Expression):
            return value
        at = e or self.node
        if isinstance(value, _Time):
            raise self.wrong(at, "A program has no time of its own: record the signal that depends on it as an input.")
        raise self.wrong(at, f"It is used as a number and is none. {ADVICE}")

    def _one_after_the_other(
        self, es: Sequence[ast.expr], how: Callable[[ast.expr], Any] | None = None
    ) -> tuple[Any, ...]:
        """Values of several; a call that writes into out may not come between a reading of it and its use."""
        values: list[Any] = []
        for e in es:
            before = len(self.statements)
            values.append((how or self.expression)(e))
            if len(self.statements) > before and any(_reads_out(v) for v in values[:-1]):
                raise self.wrong(e, SAYS("neighbour"))
        return tuple(values)

    def _named(self, name: str, at: ast.AST) -> Any:
        if name in self.here:
            return self.here[name]
        if name in self.names:
            return Name(self.names[name])
        if name in self.known:
            return _as_number(self.known[name])
        raise self.wrong(at, f"{name} has no value here that is known; give it one before, in each branch.")

    def _entry(self, of: Any, index: ast.expr, at: ast.expr) -> Any:
        if isinstance(index, ast.Slice):
            ends = [self.value(end) for end in (index.lower, index.upper)]
            if not isinstance(of, View) or index.step or not all(isinstance(end, Number | None) for end in ends):
                raise self.wrong(at, "Write indices as numbers.")
            low, high, _ = slice(*(end and end.value for end in ends)).indices(of.count)
            return View(of.array, of.start + low, max(0, high - low))
        k = self.expression(index)
        if isinstance(k, Number) and isinstance(k.value, int):
            if isinstance(of, View):
                if not -of.count <= k.value < of.count:
                    raise self.wrong(at, f"There are {of.count} entries.")
                place = of.start + k.value % of.count
                return Entry(of.array, Number(place), self.unit.parameters[place] if of.array == "p" else "")
            if isinstance(of, tuple | list | np.ndarray):
                return _as_number(of[k.value])
        elif isinstance(of, View) and of.array in ("x", "u") and of.start == 0:
            return Entry(of.array, k)
        raise self.wrong(at, "Write the index as a number, or loop over range(…) of a known length.")

    def _logic(self, op: ast.boolop, values: list[ast.expr]) -> Expression:
        sign = "and" if isinstance(op, ast.And) else "or"
        result = self.expression(values[0])
        for v in values[1:]:
            test = truth(result)
            if isinstance(test, Number) and bool(test.value) == (sign == "or"):
                return result
            before = len(self.statements)
            e = self.expression(v)
            if len(self.statements) > before:
                raise self.wrong(v, "It writes into out and may not be reached: write it under an if of its own.")
            if is_truth(result) and is_truth(e):
                result = operation(sign, result, e)
            else:
                result = choice(test, e, result) if sign == "and" else choice(test, result, e)
        return result

    def _either(self, test: Expression, yes: Callable[[], Any], no: Callable[[], Any], note: str = "") -> Any:
        """What one of two gives; where they write, under an if with a remark."""
        if isinstance(test, Number):
            return yes() if test.value else no()
        before = dict(self.here)
        with self._apart() as body:
            a = yes()
        after, self.here = self.here, before
        with self._apart() as orelse:
            b = no()
        self.here = {n: v for n, v in self.here.items() if n in after and repr(after[n]) == repr(v)}
        if isinstance(a, Expression) and isinstance(b, Expression) and not body and not orelse:
            return choice(test, a, b)
        names: Any = None
        if isinstance(a, tuple) and isinstance(b, tuple) and len(a) == len(b):
            names = tuple(Name(self.fresh("result")) for _ in a)
            body += map(Assign, names, a)
            orelse += map(Assign, names, b)
        elif isinstance(a, Expression) and isinstance(b, Expression):
            names = Name(self.fresh("result"))
            body.append(Assign(names, a))
            orelse.append(Assign(names, b))
        if body or orelse:
            self.statements.append(If(test, tuple(body), tuple(orelse), note))
        return names

    @contextmanager
    def _apart(self) -> Iterator[list[Statement]]:
        """Statements go into a list of their own."""
        outer, self.statements = self.statements, []
        yield self.statements
        self.statements = outer

    # --- calls

    def _call(self, f: Any, arguments: list[ast.expr], keywords: list[ast.keyword], at: ast.Call) -> Any:
        f = function_of(f)
        if any(isinstance(a, ast.Starred) for a in arguments) or any(k.arg is None for k in keywords):
            raise self.wrong(at, "Write each argument out.")
        if f is len and len(arguments) == 1:
            of = self.value(arguments[0])
            return Number(of.count if isinstance(of, View) else len(of))
        name = _CALLED.get(f) if callable(f) else None
        if name is not None or f in (float, math.radians, math.degrees):
            if keywords or not arguments:
                raise self.wrong(at, ADVICE)
            found = self._one_after_the_other(arguments)
            if f is float:
                return Number(float(found[0].value)) if isinstance(found[0], Number) else found[0]
            if name is None:
                return operation("*", found[0], Number(math.pi / 180 if f is math.radians else 180 / math.pi))
            return call(name, found)
        if not isinstance(f, FunctionType):
            raise self.wrong(at, ADVICE)
        positional = self._one_after_the_other(arguments, self.value)
        named = {k.arg or "": self.value(k.value) for k in keywords}
        try:
            bound = inspect.signature(f).bind(*positional, **named)
        except TypeError as error:
            raise self.wrong(at, f"{f.__name__}: {error}.") from None
        bound.apply_defaults()
        values = {n: _as_number(v) for n, v in bound.arguments.items()}
        if f in self.stack:
            raise self.wrong(at, f"{f.__name__} calls itself; write a loop.")
        if all(isinstance(v, Expression) for v in values.values()) and not _gives_several(f):
            return Call(self.unit.function(f, self.stack), tuple(values.values()))
        return self._put_here(f, values)

    def _put_here(self, f: Any, values: dict[str, Any]) -> Any:
        """A function that takes an array, or gives several numbers: its statements, in this place."""
        inner = _Scope(self.unit, self.taken, self.statements, stack=(*self.stack, f))
        for n, v in values.items():
            if isinstance(v, Call | Operation | Choice) or _reads_out(v):
                inner.names[n] = self.fresh(n)
                self.statements.append(Assign(Name(inner.names[n]), v))
            else:
                inner.here[n] = v
        result = inner.finish(inner.node.body)
        if _reads_out(result):
            name = Name(self.fresh(f.__name__))
            self.unit.passing.add(name.name)
            self.statements.append(Assign(name, result))
            return name
        return result

    # --- statements

    def finish(self, body: Sequence[ast.stmt]) -> Any:
        """The rest of a function, and what it returns: a return within an if takes what follows into both branches."""
        for k, s in enumerate(body):
            if isinstance(s, ast.Return):
                return self.value(s.value)
            if isinstance(s, ast.If) and _returns(s):
                yes, no = ([*part, *body[k + 1 :]] for part in (s.body, s.orelse))
                return self._either(truth(self.expression(s.test)), partial(self.finish, yes), partial(self.finish, no))
            self.statement(s, within=True)
        return None

    def statement(self, s: ast.stmt, within: bool) -> None:
        """One statement; a return is one of a function that stays a function."""
        note = self.notes.get(s.end_lineno or 0, "")
        match s:
            case ast.Expr(ast.Constant()) | ast.Pass():
                pass
            case ast.Expr(v):
                self.value(v)
            case ast.Return(v) if not within:
                self.statements.append(Return(self.expression(v)))
            case ast.Assign(targets, v):
                value = self.value(v)
                last = self.statements[-1] if self.statements and len(targets) == 1 else None
                if isinstance(last, Assign) and last.target == value and last.target.name in self.unit.passing:
                    value = self.statements.pop() and last.value  # what a call gave needs no name between
                for target in targets:
                    self._assign(target, value, note)
            case ast.AnnAssign(target, _, v) if v is not None:
                self._assign(target, self.value(v), note)
            case ast.AugAssign(target, op, v) if type(op) in _SIGNS:
                now = ast.copy_location(ast.parse(ast.unparse(target), mode="eval").body, target)
                self._assign(target, operation(_SIGNS[type(op)], *self._one_after_the_other([now, v])), note)
            case ast.If(test, body, orelse):
                yes, no = (partial(self.all_of, part, within) for part in (body, orelse))
                self._either(truth(self.expression(test)), yes, no, self.notes.get(s.lineno, ""))
            case ast.For(ast.Name(n), _, body, []) if not (within and _returns(s)):
                self._for(n, s, body, within)
            case ast.While(test, body, []) if not (within and _returns(s)):
                self._loop(s, body, within, lambda: {"test": truth(self.expression(test))})
            case ast.Break() | ast.Continue() if self.within_loop:
                self.statements.append(Leave(type(s).__name__.lower()))
            case _:
                raise self.wrong(s, ADVICE)

    def all_of(self, body: list[ast.stmt], within: bool) -> None:
        """Statements, one after the other."""
        for s in body:
            self.statement(s, within)

    def _for(self, name: str, s: ast.For, body: list[ast.stmt], within: bool) -> None:
        rounds = self._rounds(s)
        leaves = any(isinstance(inner, ast.Break | ast.Continue | ast.Return) for inner in ast.walk(s))
        if isinstance(rounds, Sequence) and len(rounds) <= UNROLLED and not leaves:
            for k in rounds:
                self._assign(ast.Name(name), _as_number(k), "")
                self.all_of(body, within)
            return
        if not isinstance(rounds, range | slice):
            raise self.wrong(s.iter, "Loop over range(…).")
        if any(name in _stored(inner) for inner in body):
            raise self.wrong(s, f"{name} is changed within its loop; take another name, or while.")
        self.names[name] = self.fresh(name)
        variable = Name(self.names[name])
        self._loop(s, body, within, lambda: {"variable": variable, "start": _as_number(rounds.start),
                                             "stop": _as_number(rounds.stop), "step": rounds.step})  # fmt: skip
        self.names.pop(name)

    def _rounds(self, s: ast.For) -> Any:
        """What a loop goes through: a range or another sequence that is known, or a slice of expressions."""
        match s.iter:
            case ast.Call(ast.Name("range"), arguments, []) if 1 <= len(arguments) <= 3:
                given = self._one_after_the_other(arguments)
                start, stop, step = (Number(0), *given, Number(1)) if len(given) == 1 else (*given, Number(1))[:3]
                if not (isinstance(step, Number) and step.value):
                    raise self.wrong(s.iter, "Write the step as a number.")
                if isinstance(start, Number) and isinstance(stop, Number):
                    return range(int(start.value), int(stop.value), int(step.value))
                return slice(start, stop, int(step.value))
            case _:
                found = self.value(s.iter)
                return found.tolist() if isinstance(found, np.ndarray) else found

    def _loop(self, s: ast.stmt, body: list[ast.stmt], within: bool, how: Callable[[], dict[str, Any]]) -> None:
        """A loop that stays one: nothing that it changes is known within."""
        for name in _stored(s):
            if isinstance(self.here.get(name), Expression):
                del self.here[name]
        before, outer, self.within_loop = dict(self.here), self.within_loop, True
        so_far = len(self.statements)
        head = how()
        if len(self.statements) > so_far:
            raise self.wrong(s, "Its test writes into out; write it in the loop.")
        with self._apart() as inner:
            self.all_of(body, within)
        self.within_loop, self.here = outer, {n: v for n, v in before.items() if repr(self.here.get(n)) == repr(v)}
        self.statements.append(Loop(tuple(inner), **head))

    def _assign(self, target: ast.expr, value: Any, note: str) -> None:
        match target:
            case ast.Name(n) if isinstance(value, Expression):
                self.names.setdefault(n, self.fresh(n) if n not in self.names else "")
                self.here.pop(n, None)
                if isinstance(value, Number) or (isinstance(value, Entry) and value.array == "p"):
                    self.here[n] = value
                self.statements.append(Assign(Name(self.names[n]), value, note))
            case ast.Name(n):
                self.here[n] = value
            case ast.Subscript(of, index):
                entry = self._entry(self.value(of), index, target)
                if not isinstance(entry, Entry) or entry.array != "out":
                    raise self.wrong(target, "A right-hand side writes into out alone; give it a name of its own.")
                if not isinstance(value, Expression):
                    raise self.wrong(target, "Write numbers into out.")
                self.statements.append(Assign(entry, value, note))
            case ast.Tuple(targets) | ast.List(targets) if isinstance(value, tuple) and len(value) == len(targets):
                self._assign_several(targets, value, note)
            case _:
                raise self.wrong(target, "Give each number a name of its own.")

    def _assign_several(self, targets: list[ast.expr], values: tuple[Any, ...], note: str) -> None:
        """Left to right, as Python does, after all values are known."""
        stored = {self.names.get(t.id) for t in targets if isinstance(t, ast.Name)}
        kept = []
        for k, v in enumerate(values):
            if k and isinstance(v, Expression) and (not stored.isdisjoint(mentioned(v)) or _reads_out(v)):
                name = Name(self.fresh("was"))
                self.statements.append(Assign(name, v))
                v = name
            kept.append(v)
        for k, (t, v) in enumerate(zip(targets, kept, strict=True)):
            self._assign(t, v, note if k == len(kept) - 1 else "")


def _reads_out(value: Any) -> bool:
    return any(isinstance(e, Entry) and e.array == "out" for e in parts(value))


def _stored(s: ast.AST) -> set[str]:
    """Names that it gives a value."""
    return {n.id for n in ast.walk(s) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}


def _returns(s: ast.AST) -> bool:
    return any(isinstance(inner, ast.Return) for inner in ast.walk(s))


def _gives_several(f: Any) -> bool:
    """Whether a function returns a tuple."""
    return any(isinstance(s, ast.Return) and isinstance(s.value, ast.Tuple) for s in ast.walk(_source(f)[2]))


def _as_number(value: Any) -> Any:
    """A number of Python or NumPy as one of the tree; anything else as it is."""
    if isinstance(value, np.generic):
        value = value.item()
    return Number(value) if isinstance(value, int | float) else value


@lru_cache(maxsize=256)
def _source(function: Any) -> tuple[str, int, ast.FunctionDef, dict[int, str]]:
    """File, first line, syntax tree and the remarks at the ends of lines."""
    name = getattr(function, "__name__", repr(function))
    try:
        file = inspect.getsourcefile(function) or "?"
        lines, first = inspect.getsourcelines(function)
        text = textwrap.dedent("".join(lines))
        node = ast.parse(text).body[0]
    except (OSError, TypeError, SyntaxError, IndexError):
        raise Untranslatable(SAYS("no-source", name=name)) from None
    if not isinstance(node, ast.FunctionDef):
        raise Untranslatable(f"{file}, line {first}: {name} is no function with a name; write it with def.")
    tokens = tokenize.generate_tokens(StringIO(text).readline)
    comments = [t for t in tokens if t.type == tokenize.COMMENT and t.line.strip()[0] != "#"]
    notes = {t.start[0]: t.string.strip("# ") for t in comments}
    return file, first, node, {k: v for k, v in notes.items() if not v.startswith(("noqa", "fmt:", "type:", "pragma"))}
