"""A tree written as C, JavaScript, MATLAB and Python: programs that compute the same, to the last bit.

What a language lacks of Python's functions is Python here, :mod:`fracid.models.written.portable`, and translated with
the rest.  ``p.C1`` is a constant in each, so that no name of a model can be one of the language's or of a template's.
"""

from __future__ import annotations

import keyword
import math
import re
import sys
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from hashlib import sha256
from typing import Any, ClassVar

import numpy as np

from fracid.models.written import portable
from fracid.models.written.reading import FUNCTIONS, SAYS, Untranslatable, read_functions
from fracid.models.written.tree import (
    COMPARISONS,
    Assign,
    Call,
    Choice,
    Entry,
    Expression,
    Function,
    If,
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

LANGUAGES = tomllib.loads(own_text("models/written/languages.toml"))
"""Language → what it has otherwise than C; of ``Writer`` what C has."""

LEVELS = {"or": 1, "and": 1, "not": 7, **dict.fromkeys(COMPARISONS, 3), "+": 5, "-": 5, "*": 6, "/": 6, "neg": 7}
"""How tightly each binds; what binds less than its place asks for stands in brackets."""

ATOM = 9


def _what(e: object) -> str:
    """The function or operation that an expression is."""
    return e.function if isinstance(e, Call) else e.sign if isinstance(e, Operation) else type(e).__name__


class Writer:
    """One language, as C has it where nothing else is said."""

    signs: ClassVar[dict[str, str]] = LANGUAGES["Writer"]["signs"]
    functions: ClassVar[dict[str, str]] = {}
    """Function → its name in the language, where that is another."""
    lacks: ClassVar[dict[str, str]] = LANGUAGES["Writer"]["lacks"]
    """Function or operation → what stands for it, where the language has none of the same meaning."""
    never: ClassVar[Sequence[str]] = ()
    """Functions that the language has not and that are not portable."""
    words: ClassVar[str] = ""
    """That a variable cannot be called."""
    indent: ClassVar[str] = "    "
    cast: ClassVar[str] = ""
    """Before an integer that is used as a number."""
    first: ClassVar[int] = 0
    """Index of an array's first entry."""
    longest: ClassVar[int | None] = None
    """As many letters of a name count."""
    shorter: ClassVar[bool] = True
    """Whether it has ``+=``."""
    complex: ClassVar[Sequence[str]] = ()
    """What may be complex here, where others say that there is no value."""
    says: ClassVar[dict[str, str]] = LANGUAGES["Writer"]["says"]
    """How numbers, statements and functions are written."""

    def __init_subclass__(cls) -> None:
        """What the table of languages says of one."""
        for name, value in LANGUAGES.get(cls.__name__, {}).items():
            setattr(cls, name, {**cls.says, **value} if name == "says" else value)

    def __init__(
        self, program: Program, taken: Sequence[str] = (), title: str = "", called: str = "static void right_hand_side"
    ) -> None:
        """Take a program; its functions are not called like `taken`, the names of what is written around it."""
        self.program, self.title, self.called, self.origins = program, title, called, dict[str, str]()
        self.counters = {s.variable.name for s in parts((program.body, program.functions))
                         if isinstance(s, Loop) and s.variable}  # fmt: skip
        self.reserved = {*portable.__all__, *FUNCTIONS, *self.words.split()}
        self.taken = self.reserved.union(taken)

    def text(self, beside: Writer | None = None) -> str:
        """The functions that are called, but for those that stand `beside` already, then the right-hand side."""
        if unknown := {*self.never}.intersection(self.program.calls):
            raise Untranslatable(f"{type(self).__name__} has no {min(unknown)}, which the right-hand side calls.")
        there = (*beside.program.functions, *beside._borrowed()) if beside else ()
        if clash := {f.name for f in there} & {f.name for f in self.program.functions if f not in there}:
            raise Untranslatable(SAYS("clash", name=min(clash)))
        own = [self._function(f, self._called(f.name)) for f in self.program.functions if f not in there]
        borrowed = [self._function(f, f.name) for f in self._borrowed() if f not in there]
        return self.say("whole", "\n".join([*borrowed, *own, self.main()]))

    def _borrowed(self) -> tuple[Function, ...]:
        """The portable functions that are called, also by each other."""
        found: tuple[Function, ...] = ()
        while True:
            used = {_what(e) for e in parts((self.program.body, self.program.functions, found))}
            needed = read_functions(*(getattr(portable, f) for n, f in self.lacks.items() if n in used))
            if needed == found:
                return found
            found = needed

    # --- expressions

    def say(self, what: str, *parts: object, **named: object) -> str:
        """A template with its parts."""
        return self.says[what].format(*parts, **named)

    def number(self, v: float) -> str:
        """To the last bit."""
        return repr(v) if math.isfinite(v) else self.says["nan" if v != v else "inf" if v > 0 else "-inf"]

    def entry(self, e: Entry) -> str:
        """Of an array, or a constant by its name."""
        if e.array == "p":
            return f"p.{self.name(e.name)}"
        if not isinstance(e.index, Number):
            return self.say("at", e.array, self.say("index", self.expression(e.index)))
        k = int(e.index.value)
        array, place = ("f", self.program.slot(k)) if e.array == "out" else (e.array, k)
        return self.say("at", array, place + self.first)

    def name(self, name: str) -> str:
        """As the language takes it."""
        plain = re.sub(r"^_+|^\d|\W", lambda m: "".join(f"u{ord(c):x}" for c in m[0]), name, flags=re.ASCII)
        plain = f"{plain}_" if plain.rstrip("_") in self.reserved else plain[: self.longest]
        if (other := self.origins.setdefault(plain, name)) != name:
            raise Untranslatable(SAYS("one-name", other=other, name=name, plain=plain, language=type(self)))
        return plain

    def expression(self, e: Expression, level: int = 0) -> str:
        """In brackets where it binds less tightly than asked for."""
        text, own = self._expression(e)
        return text if own >= level else f"({text})"

    def _expression(self, e: Expression) -> tuple[str, int]:
        match e:
            case Number(bool() as v):
                return self.signs.get(repr(v), str(int(v))), ATOM
            case Number(v):
                return self.number(v), ATOM if math.copysign(1.0, v) > 0 else LEVELS["neg"]
            case Name(n):
                return (f"{self.cast}{self.name(n)}", 8) if n in self.counters and self.cast else (self.name(n), ATOM)
            case Entry():
                return self.entry(e), ATOM
            case Call(f, arguments):
                return self.call(f, arguments), ATOM
            case Choice(test, yes, no) if "Choice" in self.lacks:
                return self.call("Choice", (test, yes, no)), ATOM
            case Choice(test, yes, no):
                return self.choice(test, yes, no), 0
            case Operation(sign, operands) if sign in self.lacks:
                return self.call(sign, operands), ATOM
            case Operation("**", operands):
                return self.power(*operands)
            case Operation(sign, operands):
                return self.operation(sign, *operands)

    def operation(self, sign: str, *operands: Expression) -> tuple[str, int]:
        """With one operand or two."""
        word, level = self.signs.get(sign, sign), LEVELS.get(sign, 6)
        if len(operands) == 1:
            return f"{word}{self.expression(operands[0], 8)}", level
        a, b = operands
        if sign in ("and", "or", *COMPARISONS):
            return " ".join((self.expression(a, level + 2), word, self.expression(b, level + 2))), level
        return f"{self.quantity(a, level)} {word} {self.expression(b, level + 1)}", level

    def quantity(self, e: Expression, level: int) -> str:
        """Left of a sign; C divides truth values as integers."""
        return self.expression(e, level)

    def power(self, base: Expression, exponent: Expression) -> tuple[str, int]:
        """A function in most languages."""
        return self.call("pow", (base, exponent)), ATOM

    def choice(self, test: Expression, yes: Expression, no: Expression) -> str:
        """One of two."""
        return f"{self.expression(test, 3)} ? {self.expression(yes, 1)} : {self.expression(no, 1)}"

    def call(self, f: str, arguments: Sequence[Expression]) -> str:
        """Of a function of the language, of a portable one, or of the program's."""
        return f"{self._called(f)}({', '.join(map(self.expression, arguments))})"

    def _called(self, f: str) -> str:
        if f in self.lacks:
            return self.lacks[f]
        if f in {g.name for g in self.program.functions}:
            plain = self.name(f)
            return f"{plain}_" if plain in self.taken else plain
        return self.functions.get(f, f)

    # --- statements

    def block(self, body: Sequence[Statement], pending: set[str], depth: int, loops: bool = False) -> Iterator[str]:
        """Lines; `pending` are the variables to be declared here or further in."""
        pending, names, given = set(pending), [self._names(s) for s in body], [set(assigned_names(s)) for s in body]
        for k, s in enumerate(body):
            here, later = pending & names[k], set().union(*names[k + 1 :])
            inner = {n for n in here - later if not loops and isinstance(s, If) and self._in_one_branch(s, n)}
            first = isinstance(s, Assign) and isinstance(s.target, Name) and s.target.name in here
            before = sorted(here - inner - ({s.target.name} if first else set()))  # type: ignore[union-attr]
            pad = self.indent * depth
            end = [pad + self.says["end"]] if self.says["end"] else []
            yield from (pad + line for line in self.declared(before))
            pending -= here
            match s:
                case Assign(target, value, note):
                    again = isinstance(target, Name) and target.name in later & set().union(*given[k + 1 :])
                    word = self.say("variable" if loops or again else "once") if first else ""
                    yield pad + self._remark(word + self.say("statement", self.assigned(target, value)), note)
                case If(test, yes, no, note):
                    yield pad + self._remark(self.say("if", self.expression(test)), note)
                    yield from self.block(yes, inner, depth + 1, loops)
                    while len(no) == 1 and isinstance(no[0], If) and not inner:
                        yield pad + self._remark(self.say("else if", self.expression(no[0].test)), no[0].note)
                        yield from self.block(no[0].body, inner, depth + 1, loops)
                        no = no[0].orelse
                    if no:
                        yield pad + self.says["else"]
                        yield from self.block(no, inner, depth + 1, loops)
                    yield from end
                case Loop(inside, test, variable):
                    yield pad + (self.counted(s, variable) if variable else self.say("while", self.expression(test)))
                    yield from self.block(inside, set(), depth + 1, True)
                    yield from end
                case Return(value):
                    yield from (pad + line for line in self.returned(value, k == len(body) - 1 and depth == 1))
                case _:
                    yield pad + self.say("statement", s.word)

    def assigned(self, target: Name | Entry, value: Expression) -> str:
        """``a = b``, or ``a += b`` where that says it."""
        match value:
            case Operation("+" | "-" | "*" | "/" as sign, (first, more)) if first == target and self.shorter:
                return f"{self.expression(target)} {sign}= {self.expression(more)}"
        return f"{self.expression(target)} = {self.expression(value)}"

    def _remark(self, line: str, note: str) -> str:
        return f"{line}  {self.say('remark', note.replace('*/', '* /').replace('/*', '/ *'))}" if note else line

    @staticmethod
    def _names(node: object) -> set[str]:
        loops = {s.variable.name for s in parts(node) if isinstance(s, Loop) and s.variable}
        return set(mentioned(node)) - loops

    def _in_one_branch(self, s: If, name: str) -> bool:
        return name not in self._names(s.test) and (name in self._names(s.body)) != (name in self._names(s.orelse))

    def declared(self, names: Sequence[str]) -> list[str]:
        """Variables that are assigned further in, where they have to be declared."""
        zeros = ", ".join(f"{self.name(n)} = {self.number(0.0)}" for n in names)
        return [self.say("statement", self.say("variable") + zeros)] if names and self.says["variable"] else []

    def counted(self, s: Loop, variable: Name) -> str:
        """A loop with a number that counts."""
        return self.say("for", k=self.name(variable.name), start=self.expression(s.start), step=s.step,
                        stop=self.expression(s.stop), limit=self.expression(s.stop, 6), less="<" if s.step > 0 else ">",
                        before="-" if s.step > 0 else "+")  # fmt: skip

    def returned(self, value: Expression | None, last: bool) -> list[str]:  # noqa: ARG002
        """From a function."""
        return [self.say("statement", f"return {self.expression(value)}" if value else "return")]

    # --- functions

    def _lines(self, body: Sequence[Statement], own: set[str]) -> str:
        return "".join(f"{line}\n" for line in self.block(body, own, 1))

    def _about(self, text: str) -> str:
        return self.say("about", self.say("remark", text)) if text else ""

    def _function(self, f: Function, name: str) -> str:
        head = self.say("head", name, ", ".join(self.say("argument", self.name(a)) for a in f.arguments))
        lines = self._lines(f.body, self._names(f.body) - set(f.arguments))
        return self.say("function", about=self._about(f.about), head=head, lines=lines)

    def main(self) -> str:
        """The right-hand side itself."""
        body, n = self.program.body, len(self.program.states)
        used = {e.array for e in parts(body) if isinstance(e, Entry)}
        return self.say("main", about=self._about(self.title), called=self.called, n=n, behind=n + 1,
                        all=n + len(self.program.relaxing), lines=self._lines(body, self._names(body)),
                        unused="".join(self.say("unused", a) for a in ("x", "u") if a not in used))  # fmt: skip


class C(Writer):
    """C99 with ``math.h``: ``right_hand_side(x, u, f)``, its constants in a struct ``p``."""

    def number(self, v: float) -> str:
        """An integer would divide as one."""
        return super().number(float(v))

    def quantity(self, e: Expression, level: int) -> str:
        """A truth value as a number."""
        return f"{self.cast}({self.expression(e)})" if is_truth(e) else super().quantity(e, level)


class JavaScript(Writer):
    """A function from the constants ``p`` to ``right_hand_side(x, u, f)``."""

    functions: ClassVar[dict[str, str]] = {n: f"Math.{n}" for n in (*FUNCTIONS, "abs", "pow")}

    def entry(self, e: Entry) -> str:
        """Any name may follow a point."""
        return f"p.{e.name}" if e.array == "p" else super().entry(e)

    def call(self, f: str, arguments: Sequence[Expression]) -> str:
        """A remainder is an operation."""
        if f == "fmod":
            return f"({self.expression(arguments[0], 6)} % {self.expression(arguments[1], 7)})"
        return super().call(f, arguments)


class Matlab(Writer):
    """MATLAB and Octave: ``[f, rates] = rhs(x, u, p)``."""

    def text(self, beside: Writer | None = None) -> str:
        """With the function that takes complex numbers away, where one may be."""
        text, there = super().text(beside), beside.text() if beside else ""
        return self.says["real"] + text if "real_or_nan(" in text and "real_or_nan(" not in there else text

    def power(self, base: Expression, exponent: Expression) -> tuple[str, int]:
        """An operation, which is done from left to right."""
        power = f"{self.expression(base, ATOM)} ^ {self.expression(exponent, ATOM)}"
        whole = isinstance(exponent, Number) and float(exponent.value).is_integer()
        return (power, 8) if whole else (f"real_or_nan({power})", ATOM)

    def call(self, f: str, arguments: Sequence[Expression]) -> str:
        """The cube root has a name for all roots."""
        if f == "cbrt":
            return super().call("nthroot", (*arguments, Number(3)))
        return f"real_or_nan({super().call(f, arguments)})" if f in self.complex else super().call(f, arguments)

    def returned(self, value: Expression | None, last: bool) -> list[str]:
        """The value has a name."""
        return [*([f"value = {self.expression(value)};"] if value else []), *([] if last else ["return"])]


class Python(Writer):
    """Python in Numba's language: ``rhs(t, x, u, p, out)``, with the constants at their places in p."""

    functions: ClassVar[dict[str, str]] = {n: f"{'np' if n in ('cbrt', 'fmod') else 'math'}.{n}" for n in FUNCTIONS}
    """Numba has two of NumPy's alone."""
    words: ClassVar[str] = " ".join((*keyword.kwlist, "abs min max math np range rhs"))
    once: Mapping[Entry, str] = {}
    """What a right-hand side reads more than once has a name in it: that is less to compile."""

    def entry(self, e: Entry) -> str:
        """By its place."""
        return self.once.get(e) or f"{e.array}[{self.expression(e.index)}]"

    def operation(self, sign: str, *operands: Expression) -> tuple[str, int]:
        """``not`` binds less tightly than elsewhere."""
        return (f"(not {self.expression(operands[0])})", ATOM) if sign == "not" else super().operation(sign, *operands)

    def power(self, base: Expression, exponent: Expression) -> tuple[str, int]:
        """An operation."""
        return f"{self.expression(base, ATOM)} ** {self.expression(exponent, ATOM)}", 8

    def choice(self, test: Expression, yes: Expression, no: Expression) -> str:
        """One of two."""
        return f"{self.expression(yes, 1)} if {self.expression(test, 1)} else {self.expression(no, 1)}"

    def main(self) -> str:
        """The right-hand side itself; with which rate a state forgets it writes where there is room."""
        n, body = len(self.program.states), self.program.body
        read = Counter(e for e in parts(body) if isinstance(e, Entry) and e.array in "xp")
        often = [e for e, count in read.items() if count > 1 and isinstance(e.index, Number)]
        once = {e: f"_{e.array}{self.expression(e.index)}" for e in often}
        first = [f"{self.indent}{name} = {self.entry(e)}" for e, name in once.items()]
        self.once = once
        lines = [*self.block(body, self._names(body), 1)]
        flat = all(isinstance(s, Assign) for s in body)
        places = tuple(f"    out[{n + i}] =" for i in self.program.relaxing) if flat else ()
        rates = [line for line in lines if line.startswith(places)]
        room = [f"    if len(out) > {n}:", *(self.indent + line for line in rates)] if rates else []
        return "\n".join(["def rhs(t, x, u, p, out):", *first, *(line for line in lines if line not in rates), *room,
                          *([] if lines else ["    pass"]), ""])  # fmt: skip

    def made(self, name: str = "", module: str = "") -> Callable[..., Any]:
        """The right-hand side, or the function of that name, to be called.

        One of a module of fracid's is called by its text: what is compiled of it is kept under that name.
        """
        text, there = self.text(), dict[str, Any](math=math, np=np, **({"__name__": module} if module else {}))
        file = sys.modules[module].__file__ if module else "<equations>"
        exec(compile(text, str(file), "exec"), there)  # of a tree: numbers, its names and functions of mathematics
        function: Callable[..., Any] = there[own := self._called(name) if name else "rhs"]
        if module:
            function.__name__ = function.__qualname__ = f"{own}_{sha256(text.encode()).hexdigest()[:16]}"
        return function
