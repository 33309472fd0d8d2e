"""Words are for people: no decision hangs on them, so that a sentence can be changed or translated."""

import ast
from pathlib import Path

import pytest

SOURCES = Path(__file__).resolve().parents[1] / "src" / "fracid"

WORDS_OF_OTHERS = {
    "cli/app.py": "the words of Python's own errors",
    "export/fmu.py": "C, and its templates",
    "runs/environment.py": "/proc/cpuinfo",
    "solver/right_hand_side.py": "the words of Python's own errors",
    "runs/reproduction.py": "keys of run.json",
    "workflows/comparison.py": "keys of a journal",
    "workflows/reproduction.py": "keys of run.json",
    "export/simulators.py": "names of orders",
}

CODES = {"no threshold", "practically not", "with the past", "from the plateau", "N m"}
"""Verdicts, treatments and units, which are words with a space."""

METHODS = {"startswith", "endswith", "removeprefix", "removesuffix", "index", "find"}


def is_sentence(node):
    return isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value.strip() and (
        node.value not in CODES)  # fmt: skip


def comparisons(source):
    """Lines of code that ask what a text says in words."""
    for node in ast.walk(ast.parse(source)):
        match node:
            case ast.Compare(left=left, ops=ops, comparators=others):
                asked = any(isinstance(op, ast.Eq | ast.NotEq | ast.In | ast.NotIn) for op in ops)
                parts = [e for o in (left, *others) for e in (o.elts if isinstance(o, ast.Tuple | ast.Set) else [o])]
                if asked and any(map(is_sentence, parts)):
                    yield node.lineno
            case ast.Call(func=ast.Attribute(attr=name), args=arguments) if name in METHODS:
                if any(is_sentence(e) for a in arguments for e in (a.elts if isinstance(a, ast.Tuple) else [a])):
                    yield node.lineno


@pytest.mark.parametrize("source", ['a == "it is so"', '"times its" in a', 'a.endswith("be believed.")',
                                    'a not in ("is text", "is blank")'])  # fmt: skip
def test_a_comparison_with_words_is_seen(source):
    assert [*comparisons(source)] == [1]


def test_no_decision_compares_a_sentence():
    files = {path.relative_to(SOURCES).as_posix(): path for path in SOURCES.rglob("*.py")}
    assert files.keys() >= WORDS_OF_OTHERS.keys()
    found = {f"{name}:{line}" for name, path in files.items() if name not in WORDS_OF_OTHERS
             for line in comparisons(path.read_text(encoding="utf-8"))}  # fmt: skip
    assert found == set()
