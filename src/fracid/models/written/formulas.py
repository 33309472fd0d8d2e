"""Equations as text, read by a whitelist: numbers, names, ``+ - * / // % **``, comparisons, ``if else``, and math.

Nothing here is evaluated as Python.  A text becomes tokens, tokens a tree of :mod:`fracid.models.written.tree`, and of
the tree the function is made that is compiled: so a project file with equations needs no trust.  Length and depth are
bounded before anything is built.
"""

from __future__ import annotations

import difflib
import math
import re
import tomllib
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

from fracid.errors import InputError
from fracid.models.written.languages import Python
from fracid.models.written.reading import FUNCTIONS, SAYS, call, choice, operation, truth
from fracid.models.written.tree import COMPARISONS, Expression, Function, Meanings, Name, Number, Program
from fracid.safety.door import own_text
from fracid.safety.text import printable

INSTEAD = tomllib.loads(own_text("models/written/instead.toml"))
"""What is no part of an equation → what to type."""

LONGEST = 2000
"""Characters of an equation."""

DEEPEST = 60
"""Operations and brackets within each other."""

SHOWN = 100
"""Characters of an equation in a message, about the place that is wrong; of a name or a number at all."""

MOST_NAMES = 40
"""That are listed where none is close; of functions all."""

LATER = Name("")

KNOWN = (*FUNCTIONS, "abs", "min", "max", "sign")

ARGUMENTS = {"atan2": 2, "hypot": 2, "copysign": 2, "fmod": 2}

CONSTANTS = {"pi": math.pi}

WORDS = ("if", "else", "and", "or", "not")

TOKEN = re.compile(r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)(?![\w.])|(?P<name>[^\W\d]\w*)"
                   r"|(?P<sign>\*\*|//|<=|>=|==|!=|[-+*/%()<>,]))", re.ASCII)  # fmt: skip

BINDS = {"or": 1, "and": 2, **dict.fromkeys(COMPARISONS, 4), "+": 5, "-": 5, "*": 6, "/": 6, "//": 6, "%": 6}


class FormulaError(InputError):
    """An equation that cannot be read: the equation, and below it the place."""

    def __init__(self, text: str, column: int, why: str, where: str = "") -> None:
        """Show a piece of the text, a caret and the reason."""
        start = max(0, min(column - SHOWN // 2, len(text) - SHOWN))
        piece = "".join(c if c.isprintable() else "?" for c in text[start : start + SHOWN])
        super().__init__(printable(f"{where}\n    {piece}\n    {' ' * (column - start)}^ {why}"))


class _Token(NamedTuple):
    kind: str
    text: str
    column: int


def formula(text: str, names: Meanings, where: str = "", columns: dict[int, int] | None = None) -> Expression:
    """Read an expression.

    Parameters
    ----------
    text : str
    names : mapping
        What each name stands for; :data:`LATER` where that is defined further down.
    where : str
        Its place in a file, for messages.
    columns : dict, optional
        Takes id(operation) → the column of its sign, for messages.

    Raises
    ------
    FormulaError

    Examples
    --------
    >>> from fracid.models.written.tree import Name
    >>> formula("2*v", {"v": Name("v")})
    Operation(sign='*', operands=(Number(value=2.0), Name(name='v')))
    >>> formula("tahn(v)", {"v": Name("v")})
    Traceback (most recent call last):
    fracid.models.written.formulas.FormulaError: ...tahn(v)... ^ `tahn` is no function; did you mean `tanh`?
    """
    return _Parser(text, names, where, {} if columns is None else columns).whole()


class _Parser:
    """Precedence climbing over the tokens."""

    def __init__(self, text: str, names: Meanings, where: str, columns: dict[int, int]) -> None:
        self.text, self.names, self.where, self.columns, self.depth, self.at = text, names, where, columns, 0, 0
        if len(text) > LONGEST:
            raise self.wrong(0, SAYS("too-long", count=len(text), most=LONGEST))
        self.tokens = self._tokens()

    def wrong(self, column: int, why: str) -> FormulaError:
        return FormulaError(self.text, column, why, self.where)

    def _tokens(self) -> list[_Token]:
        found, place, end = [], 0, len(self.text.rstrip())
        while place < end:
            match = TOKEN.match(self.text, place)
            if match is None:
                place += len(self.text[place:]) - len(self.text[place:].lstrip())
                sign = self.text[place]
                hint = INSTEAD["number" if sign.isdecimal() else "other"]
                raise self.wrong(place, SAYS("no-sign", sign=sign, hint=INSTEAD["signs"].get(sign, hint)))
            kind = str(match.lastgroup)
            if len(text := match[kind]) > SHOWN:
                raise self.wrong(match.start(kind), f"This has {len(text)} characters; {SHOWN} are read.")
            found.append(_Token("word" if text in WORDS else kind, text, match.start(kind)))
            place = match.end()
        return [*found, _Token("end", "", end)]

    @property
    def now(self) -> _Token:
        return self.tokens[self.at]

    def take(self, text: str) -> bool:
        if self.now.kind in ("sign", "word", "end") and self.now.text == text:
            self.at += 1
            return True
        return False

    def need(self, text: str, why: str = "") -> None:
        if self.take(text):
            return
        if not why or self.now.kind in ("number", "name") or self.now.text in (",", "("):
            hint = INSTEAD["signs"].get(self.now.text, INSTEAD["more"])
            why = SAYS("too-many", text=self.now.text, hint=hint)
        raise self.wrong(self.now.column, why)

    def whole(self) -> Expression:
        result = self.choice()
        self.need("")
        return result

    def choice(self) -> Expression:
        self._deeper(1)
        result = self.binary(1)
        if self.take("if"):
            test = truth(self.binary(1))
            self.need("else", "`else` is missing: yes if test else no.")
            result = choice(test, result, self.choice())
        self._deeper(-1)
        return result

    def _deeper(self, more: int) -> None:
        self.depth += more
        if self.depth > DEEPEST:
            raise self.wrong(self.now.column, SAYS("too-deep", most=DEEPEST))

    def binary(self, least: int) -> Expression:
        result, rounds, compared = self.unary(), 0, None
        while self.now.kind in ("sign", "word") and BINDS.get(self.now.text, 0) >= least:
            token = self.now
            self.at += 1
            level, rounds = BINDS[token.text], rounds + 1
            self._deeper(1)  # what stands left of it lies within it
            right = self.binary(level + 1)
            if level == 4 and compared is not None:  # a < b < c
                result = operation("and", result, self._made(token, compared, right))
            elif level <= 2:
                result = operation(token.text, truth(result), truth(right))
            else:
                result = self._made(token, result, right)
            compared = right if level == 4 else None
        self.depth -= rounds
        return result

    def _made(self, token: _Token, *operands: Expression) -> Expression:
        return self._kept(token, operands, operation(token.text, *operands))

    def _kept(self, token: _Token, operands: Sequence[Expression], result: Expression) -> Expression:
        """With its place; numbers make a number, and a finite one."""
        constant = all(isinstance(e, Number) for e in operands)
        if constant and not (isinstance(result, Number) and math.isfinite(result.value)):
            raise self.wrong(token.column, SAYS("no-value"))
        self.columns[id(result)] = token.column
        return result

    def unary(self) -> Expression:
        token = self.now
        if self.take("-") or self.take("+") or self.take("not"):
            self._deeper(1)
            inner = self.binary(3) if token.text == "not" else self.unary()
            self._deeper(-1)
            return inner if token.text == "+" else (
                operation("not", truth(inner)) if token.text == "not" else operation("neg", inner))  # fmt: skip
        base = self.atom()
        token = self.now
        if self.take("**"):
            self._deeper(1)
            base = self._made(token, base, self.unary())
            self._deeper(-1)
        return base

    def atom(self) -> Expression:
        token = self.now
        self.at += 1
        if token.kind == "number":
            return self._kept(token, (), Number(float(token.text)))
        if token.kind == "sign" and token.text == "(":
            inner = self.choice()
            self.need(")", "A bracket is not closed here.")
            return inner
        if token.kind == "name":
            return self._called(token) if self.take("(") else self._named(token)
        raise self.wrong(token.column, SAYS("no-operand", hint=INSTEAD["names"].get(token.text, INSTEAD["value"])))

    def _named(self, token: _Token) -> Expression:
        if self.names.get(token.text) == LATER:
            raise self.wrong(token.column, SAYS("defined-later", name=token.text))
        if token.text in self.names:
            return self.names[token.text]
        if token.text in CONSTANTS:
            return Number(CONSTANTS[token.text])
        if token.text in KNOWN:
            raise self.wrong(token.column, f"`{token.text}` is a function: {token.text}(…).")
        raise self.wrong(token.column, SAYS("unknown", name=token.text, close=_close(token.text, self.names)))

    def _called(self, token: _Token) -> Expression:
        if token.text not in KNOWN:
            hint = "is a * missing after it?" if token.text in self.names else _close(token.text, KNOWN)
            raise self.wrong(token.column, f"`{token.text}` is no function; {hint}")
        arguments = [self.choice()]
        while self.take(","):
            arguments.append(self.choice())
        self.need(")", f"The bracket of {token.text} is not closed here.")
        several = token.text in ("min", "max")
        wanted = ARGUMENTS.get(token.text, 1)
        alone = len(arguments) != wanted and (token.text, len(arguments)) != ("log", 2)
        if len(arguments) < 2 if several else alone:
            takes = "two values or more" if several else wanted
            raise self.wrong(token.column, f"`{token.text}` takes {takes}, not {len(arguments)}.")
        return self._kept(token, arguments, call(token.text, arguments))


def _close(name: str, known: Collection[str]) -> str:
    same_letters = [k for k in known if sorted(k) == sorted(name)]
    close = same_letters or difflib.get_close_matches(name, known, 1)
    listed = f"the known ones are {', '.join([*known][:MOST_NAMES])}{' …' * (len(known) > MOST_NAMES)}."
    return str(INSTEAD["names"].get(name, f"did you mean `{close[0]}`?" if close else listed))


# --- what is compiled ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Formula:
    """A right-hand side or an output that is a tree: pickled, compared and hashed as one, and Numba compiles it.

    Examples
    --------
    >>> from fracid.models.written.tree import Entry, Operation, Return
    >>> twice = Operation("*", (Number(2.0), Entry("x", Number(0))))
    >>> Formula(Function("double", ("t", "x", "u", "p"), (Return(twice),)))(0.0, [3.0], [], [])
    6.0
    """

    tree: Program | Function
    module: str = ""
    """Of fracid's own equations: what is compiled of them is kept on disk, under the module's name; "" for a user's."""

    @cached_property
    def py_func(self) -> Any:
        """The function, in Numba's language."""
        writer = Python(self.tree if isinstance(self.tree, Program) else Program((), (), (self.tree,), ()))
        return writer.made("" if isinstance(self.tree, Program) else self.tree.name, self.module)

    @property
    def __name__(self) -> str:
        """What messages call it."""
        return "of the equations" if isinstance(self.tree, Program) else self.tree.name

    def __reduce__(self) -> tuple[Any, ...]:
        """The tree alone; each process makes its own function."""
        return Formula, (self.tree, self.module)

    def __call__(self, *arguments: Any) -> Any:
        """Run it."""
        return self.py_func(*arguments)
