"""A right-hand side as a small tree of expressions and statements, from which every language is written.

All values are numbers; ``x``, ``u``, ``p`` and ``out`` are the arrays of a right-hand side, whatever its author called
them, and names are those of its own variables.  A tree compares and hashes by its content.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import chain

COMPARISONS = ("<", "<=", ">", ">=", "==", "!=")


@dataclass(frozen=True)
class Number:
    """A number that is known; a truth value too."""

    value: float


@dataclass(frozen=True)
class Name:
    """A variable."""

    name: str


@dataclass(frozen=True)
class Entry:
    """``x[2]``; of p by name where it is one of the model's constants."""

    array: str
    index: Expression
    name: str = ""


@dataclass(frozen=True)
class Call:
    """A function of mathematics by its name in Python, or one of the program's own."""

    function: str
    arguments: tuple[Expression, ...]


@dataclass(frozen=True)
class Operation:
    """``+ - * / ** % //``, comparisons, ``and or not`` with one or two operands."""

    sign: str
    operands: tuple[Expression, ...]


@dataclass(frozen=True)
class Choice:
    """``yes if test else no``."""

    test: Expression
    yes: Expression
    no: Expression


Expression = Number | Name | Entry | Call | Operation | Choice

Meanings = Mapping[str, Expression]
"""Name → what it stands for."""


@dataclass(frozen=True)
class Assign:
    """``target = value``, and what its author remarks at the end of the line."""

    target: Name | Entry
    value: Expression
    note: str = ""


@dataclass(frozen=True)
class If:
    """Statements for either case."""

    test: Expression
    body: tuple[Statement, ...]
    orelse: tuple[Statement, ...] = ()
    note: str = ""


@dataclass(frozen=True)
class Loop:
    """While `test` holds; with a `variable` from `start` up to, or down to, `stop` in its place."""

    body: tuple[Statement, ...]
    test: Expression = Number(True)
    variable: Name | None = None
    start: Expression = Number(0)
    stop: Expression = Number(0)
    step: int = 1


@dataclass(frozen=True)
class Leave:
    """``break`` or ``continue``."""

    word: str


@dataclass(frozen=True)
class Return:
    """With a value, of a function that gives one."""

    value: Expression | None = None


Statement = Assign | If | Loop | Leave | Return


@dataclass(frozen=True)
class Function:
    """One that gives a number for numbers."""

    name: str
    arguments: tuple[str, ...]
    body: tuple[Statement, ...]
    about: str = ""
    """First line of its docstring."""


@dataclass(frozen=True)
class Program:
    """A right-hand side: the functions that it calls, each after those that it calls itself, and its own body."""

    states: tuple[str, ...]
    relaxing: tuple[int, ...]
    """States whose rate of forgetting stands in ``out`` behind the derivatives: that of state i at n + i."""
    functions: tuple[Function, ...]
    body: tuple[Statement, ...]

    @cached_property
    def constants(self) -> frozenset[str]:
        """The parameters that it uses.

        Examples
        --------
        >>> import fracid
        >>> fracid.rotary_pendulum().program.constants >= {"C1", "b_alpha"}
        True
        """
        return frozenset(e.name for e in parts(self.body) if isinstance(e, Entry) and e.array == "p")

    @cached_property
    def calls(self) -> tuple[str, ...]:
        """Names of all functions that are called, each once."""
        every = chain(parts(self.body), *(parts(f.body) for f in self.functions))
        return tuple(dict.fromkeys(e.function for e in every if isinstance(e, Call)))

    def slot(self, index: int) -> int:
        """Where an entry of ``out`` stands if rates are kept of the states that relax alone."""
        n = len(self.states)
        return index if index < n else n + self.relaxing.index(index - n)


def parts(node: object) -> Iterator[object]:
    """The node, or each of a tuple, and all within.

    Examples
    --------
    >>> sum(isinstance(e, Name) for e in parts(Operation("+", (Name("a"), Name("b")))))
    2
    """
    left = [node]
    while left:
        node = left.pop()
        if isinstance(node, tuple):
            left.extend(reversed(node))
        elif hasattr(node, "__dataclass_fields__"):
            yield node
            left.extend(reversed(vars(node).values()))


def mentioned(node: object) -> list[str]:
    """Names of the variables in it, as often as they stand there.

    Examples
    --------
    >>> mentioned((Assign(Name("a"), Name("b")), Return(Name("a"))))
    ['a', 'b', 'a']
    """
    return [e.name for e in parts(node) if isinstance(e, Name)]


def assigned_names(node: object) -> list[str]:
    """Names of the variables that it gives a value, as often as it does.

    Examples
    --------
    >>> assigned_names((Assign(Name("a"), Name("b")), Return(Name("a"))))
    ['a']
    """
    return [s.target.name for s in parts(node) if isinstance(s, Assign) and isinstance(s.target, Name)]


def is_truth(e: Expression) -> bool:
    """Whether it is a comparison or the like, not a number.

    Examples
    --------
    >>> is_truth(Operation("<", (Name("a"), Number(0.0)))), is_truth(Name("a"))
    (True, False)
    """
    if isinstance(e, Operation):
        return e.sign in (*COMPARISONS, "and", "or", "not")
    return isinstance(e, Number) and isinstance(e.value, bool)
