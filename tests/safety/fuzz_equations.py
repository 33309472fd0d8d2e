"""Fuzzing of the equations that a project file may have: hostile texts in, a tree of mathematics or a sentence out.

::

    python tests/safety/fuzz_equations.py                       a million, some minutes
    python tests/safety/fuzz_equations.py --inputs 3000         the first three thousand
    python tests/safety/fuzz_equations.py --again 1234          one once more

Text number n follows from n alone: a good equation with some of its parts exchanged, a heap of parts, brackets and
operations within each other, names without an end, letters of other alphabets, numbers of any size, and Python that
would do harm if anybody ran it.  Each is read as an equation of a model with units, and as an output of it.  It must
end as a tree whose Python, which is what is compiled, holds nothing but numbers, arithmetic, ``x[…]``, ``u[…]``,
``p[…]`` and functions of ``math``; or in one printable sentence for each line.  While it is read nothing else may be
compiled or executed, and nothing opened, imported or connected to, which Python itself tells
(:func:`sys.addaudithook`); and it may take no more than 50 ms of processor time.
"""

from __future__ import annotations

import ast
import gc
import random
import sys
import time
import warnings
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from fracid.errors import InputError
from fracid.models.base import Parameter
from fracid.models.written.equations import Equation, Equations
from fracid.models.written.formulas import Formula
from fracid.models.written.languages import Python
from fracid.models.written.tree import Program
from fuzz import Ended, fault_of_message, options, say_and_exit

__all__ = ["equation", "fuzz", "judged"]

SECONDS = 0.05
"""Of processor time, for one text."""

GOOD = (
    "force/m - c*speed/m", "-(k*position + c*speed)/m", "speed", "k*sin(position)", "c*tanh(speed/0.01)",
    "1.5e-3*position**3 if position > 0 else 0.0", "min(1, max(-1, position))", "sqrt(abs(position))*sign(speed)",
    "force if 0 < position < 1 and not speed == 0 or force > 2 else -force", "atan2(speed, position) + pi", "log(m, 2)",
    "exp(-c)*cos(2*pi*k)", "hypot(position, speed)", "copysign(c, speed)", "2**-position", "1/(1 + speed**2)",
)  # fmt: skip

PARTS = (
    "position", "speed", "force", "m", "c", "k", "t", "pi", "x", "out", "p", "u", "math", "self", "inf", "nan", "True",
    "0", "1", "0.5", "1e308", "1e-320", "9" * 400, "1e999", "0x1f", "1_000", "1j", ".5", "5.", "1e", "00", "1.2.3",
    "+", "-", "*", "/", "**", "//", "%", "@", "<", "<=", "==", "!=", ">", ">=", "=", ":=", "->", "<>", "~", "&", "|",
    "^", "<<", "(", ")", "[", "]", "{", "}", ",", ".", ";", ":", "?", "!", "\\", "'", '"', "`", "#", "$", "\n", "\r",
    "\t", "\x00", "\x1b[2J", "\u202e", "\u200b", "\ufeff", "\udcff", "λ", "²", "٣", "½", "ⅷ", "𝟙", "ﬁ", "ｅｘｐ", "İ",
    "if", "else", "and", "or", "not", "is", "in", "lambda", "for", "await", "yield", "import", "exec", "eval", "print",
    "sin", "cos", "abs(", "min(", "max(", "sign(", "log(", "atan2(", "fmod(", "floor(", "gamma(", "erf(", "pow(", "()",
)  # fmt: skip

PYTHON = (
    "__import__('os').system('touch /tmp/fracid-was-here')", "exec('1')", "eval('1')", "open('/etc/passwd').read()",
    "().__class__.__bases__[0].__subclasses__()", "(lambda: 0)()", "[x for x in ()]", "math.sin(1)", "p.__class__",
    "f'{position}'", "position if (k := 3) else 0", "globals()", "breakpoint()", "x[10**9]", "sin.__globals__",
    "getattr(m, 'n')", "position; import os", "position\nimport os", "1 if exit() else 0", "9**9**9**9**9", "*position",
    "b'a'", "...", "print(1)", "compile('1', '', 'eval')", "position @ speed", "await speed", "{**m}", "not",
)  # fmt: skip

WRAPS = ("(", "-", "+", "not ", "sin(", "1 + (", "2**", "position*(", "1 if ", "max(1, ", "1 < ", "1 - ", "- (")


def equation(number: int) -> str:
    """Text n."""
    choose = random.Random(number)
    return choose.choices((_exchanged, _heap, _deep, _long, _python, _anything), (8, 4, 2, 2, 2, 1))[0](choose)


def _exchanged(choose: random.Random) -> str:
    """A good one, with pieces left out, doubled, taken from another or put in."""
    text = choose.choice(GOOD)
    for _ in range(choose.choice((0, 1, 1, 1, 2, 3, 8))):
        a, b = sorted((choose.randrange(len(text) + 1), choose.randrange(len(text) + 1)))
        b = min(b, a + 8)
        other = choose.choice(GOOD)
        at = choose.randrange(len(other))
        new = choose.choice(("", text[a:b] * 2, other[at : at + 8], choose.choice(PARTS), choose.choice(WRAPS)))
        text = text[:a] + new + text[b:]
    return text


def _heap(choose: random.Random) -> str:
    between = choose.choice(("", " ", " "))
    return between.join(choose.choices(PARTS, k=choose.choice((1, 2, 3, 5, 9, 20))))


def _deep(choose: random.Random) -> str:
    """Within each other, closed or not."""
    wraps = choose.choices(WRAPS, k=choose.choice((1, 1, 1, 2)))
    times = choose.choice((5, 19, 20, 29, 30, 58, 59, 60, 61, 200, 700))
    head = "".join(wraps) * times
    return head + choose.choice(("position", "1", "")) + ")" * (head.count("(") - choose.choice((0, 0, 0, 1, -1)))


def _long(choose: random.Random) -> str:
    """Up to what is read, and beyond: one name, one number, one sum."""
    part = choose.choice(("a", "9", " ", "x_", "λ", "+1", "*m", "/m", "**2", "-c", " if", ",1", "<1", " and 1", "0."))
    times = choose.choice((30, 300, 1999, 2000, 100_000)) // len(part)
    return choose.choice(("", "position", "max(1", "1", "1.")) + part * times + choose.choice(("", ")", " else 0"))


def _python(choose: random.Random) -> str:
    text = choose.choice(PYTHON)
    return choose.choice((text, f"position + {text}", f"sin({text})", f"({text})*k", f"1 if {text} else 0"))


def _anything(choose: random.Random) -> str:
    some = "".join(chr(choose.choice((choose.randrange(128), choose.randrange(0x3000), choose.randrange(0x110000))))
                   for _ in range(choose.choice((1, 4, 30))))  # fmt: skip
    return choose.choice(("", "position + ", "sin(")) + some


# --- the judgement --------------------------------------------------------------------------------------

_heard: list[tuple[str, object]] | None = None
"""What Python said it did while a text was read, and with what; None while nobody listens."""

DEEDS = ("exec", "compile", "open", "import", "os.", "subprocess.", "socket.", "ctypes.", "marshal.", "pickle.")


def _listen(event: str, arguments: tuple[object, ...]) -> None:
    if _heard is not None and event.startswith(DEEDS):
        _heard.append((event, arguments[0] if arguments else None))


def judged(text: str) -> str:
    """Read a text; return what came of it, or what went wrong after an exclamation mark."""
    global _heard
    _heard, begun = [], time.thread_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            model = _model(text)
            written = [Python(tree).text() for tree in _trees(model)]
    except InputError as error:
        outcome, written = _said(str(error)), []
    except (Exception, RecursionError) as error:
        return f"! {type(error).__name__}: {error}"
    else:
        outcome = "taken"
    finally:
        took, did, _heard = time.thread_time() - begun, _heard, None
    compiled = [source.decode() for event, source in did if event == "compile" and isinstance(source, bytes)]
    written += compiled  # a tree's Python: the model asks an output for its arguments
    if [event for event, _ in did] != ["compile", "exec"] * len(compiled):
        return f"! it did {[f'{event} {what!r:.80}' for event, what in did[:3]]}"
    if took > SECONDS:
        return f"! took {1e3 * took:.0f} ms"
    return next((f"! compiles {fault}" for code in written if (fault := _more_than_mathematics(code))), outcome)


def _model(text: str):
    """A mass on a spring, one of whose equations it is."""
    parameters = [Parameter("m", "kg", 2.0, ""), Parameter("c", "N s/m", 1.0, ""), Parameter("k", "N/m", 1.0, "")]
    axis = {"position": Equation("speed", 1.0, "m"), "speed": Equation(text, "mu", "m/s")}
    return Equations(axis, {"seen": Equation(text)}, {"force": "N"}).model("axis", parameters)


def _trees(model):
    """All that would be compiled."""
    outputs = [o.tree for o in model.outputs.values() if isinstance(o, Formula)]
    return [model.program, *(Program((), (), (tree,), ()) for tree in outputs)]


def _said(message: str) -> str:
    lines = message.split("\n")
    faults = [fault for line in lines if (fault := fault_of_message(line))]
    return next(iter(faults), "refused" if len(lines) <= 3 else f"! {lines}")


ALLOWED = (ast.Module, ast.FunctionDef, ast.arguments, ast.arg, ast.Assign, ast.Return, ast.Expr, ast.Constant,
           ast.Name, ast.Load, ast.Store, ast.Subscript, ast.BinOp, ast.UnaryOp, ast.BoolOp, ast.Compare, ast.IfExp,
           ast.Call, ast.Attribute, ast.operator, ast.unaryop, ast.boolop, ast.cmpop, ast.Pass)  # fmt: skip
NAMES = {"rhs", "t", "x", "u", "p", "out", "math", "abs", "min", "max"}


def _more_than_mathematics(code: str) -> str:
    """What a program holds that no equation needs; nothing where it holds none."""
    nodes = [*ast.walk(ast.parse(code))]
    own = (
        NAMES
        | {n.name for n in nodes if isinstance(n, ast.FunctionDef)}
        | {n.arg for n in nodes if isinstance(n, ast.arg)}
        | {n.id for n in nodes if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
    )
    for node in nodes:
        if not isinstance(node, ALLOWED):
            return type(node).__name__
        if isinstance(node, ast.Name) and node.id not in own:
            return node.id
        if isinstance(node, ast.Attribute) and not (isinstance(node.value, ast.Name) and node.value.id == "math"):
            return ast.unparse(node)
        if isinstance(node, ast.Constant) and not isinstance(node.value, bool | int | float):
            return repr(node.value)[:40]
    return ""


def fuzz(numbers: range) -> Ended:
    """Read texts; return how they ended."""
    for text in ("\x00", "2*sign(speed)", "log(not m, 2)", "spespeed"):  # what is read or imported at the first use
        judged(text)
    gc.disable()  # when garbage is looked for is Python's affair, and is no text's time
    ended, failures = Counter[str](), dict[int, str]()
    try:
        for number in numbers:
            outcome = judged(equation(number))
            ended["failed" if outcome.startswith("!") else outcome] += 1
            if outcome.startswith("!"):
                failures[number] = f"{equation(number)!r:.200} {outcome[2:]}"
            if number % 5000 == 0:
                gc.collect()
    finally:
        gc.enable()
    return ended, failures


sys.addaudithook(_listen)


if __name__ == "__main__":
    say_and_exit(*fuzz(options("Fuzz the equations of project files").numbers))
