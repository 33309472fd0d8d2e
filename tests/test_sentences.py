"""Words are for people: no decision hangs on them, so that a sentence can be changed or translated."""

import ast

import pytest

from sources import nodes

WORDS_OF_OTHERS = {
    "cli/app.py": "the words of Python's own errors",
    "export/fmu.py": "C, and its templates",
    "runs/environment.py": "/proc/cpuinfo",
    "solver/right_hand_side.py": "the words of Python's own errors",
    "workflows/comparison.py": "keys of a journal",
    "export/simulators.py": "names of orders",
    "report/index.py": "HTML of a page",
}

CODES = {"no threshold", "flat", "one-sided", "practically not", "with the past", "from the plateau", "N m"}
"""Verdicts, treatments and units, which are words with a space."""

METHODS = {"startswith", "endswith", "removeprefix", "removesuffix", "index", "find"}


SAID = {"verdict", "sentence"}
"""Attributes that hold words, if one word alone."""


def is_sentence(node):
    return isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value.strip() and (
        node.value not in CODES)  # fmt: skip


def elements(node):
    return node.elts if isinstance(node, ast.Tuple | ast.Set | ast.List) else [node]


def names_of_sentences(nodes_):
    """Names that stand for sentences: of a tuple of them, and of one of it in a loop."""
    names = set()
    pairs = [*((n.value, n.targets) for n in nodes_ if isinstance(n, ast.Assign)),
             *((n.iter, [n.target]) for n in nodes_ if isinstance(n, ast.For | ast.comprehension))]  # fmt: skip
    for value, targets in pairs:
        if any(map(is_sentence, elements(value))) or (isinstance(value, ast.Name) and value.id in names):
            names |= {t.id for t in targets if isinstance(t, ast.Name)}
    return names


def is_said(node):
    return isinstance(node, ast.Attribute) and node.attr in SAID


def is_word(node):
    return isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value not in CODES | {""}


def comparisons(nodes_):
    """Lines of code that ask what a text says in words."""
    named = names_of_sentences(nodes_)
    for node in nodes_:
        match node:
            case ast.Compare(left=left, ops=ops, comparators=others):
                asked = any(isinstance(op, ast.Eq | ast.NotEq | ast.In | ast.NotIn) for op in ops)
                parts = [e for o in (left, *others) for e in elements(o)]
                if asked and (any(map(is_sentence, parts)) or (any(map(is_said, parts)) and any(map(is_word, parts)))):
                    yield node.lineno
            case ast.Call(func=ast.Attribute(attr=name), args=arguments) if name in METHODS:
                parts = [e for a in arguments for e in elements(a)]
                if any(is_sentence(e) or (isinstance(e, ast.Name) and e.id in named) for e in parts):
                    yield node.lineno


@pytest.mark.parametrize("source", ['a == "it is so"', '"times its" in a', 'a.endswith("be believed.")',
                                    'a not in ("is text", "is blank")', 'c.verdict == "identified"',
                                    'kinds = "known", "not excited"; [k for k in kinds if text.startswith(k)]',
                                    'any(text.startswith(k) for k in ("known", "not excited"))'])  # fmt: skip
def test_a_comparison_with_words_is_seen(source):
    assert [*comparisons([*ast.walk(ast.parse(source))])] == [1]


def test_no_decision_compares_a_sentence():
    assert nodes().keys() >= WORDS_OF_OTHERS.keys()
    found = {f"{name}:{line}" for name, of_file in nodes().items() if name not in WORDS_OF_OTHERS
             for line in comparisons(of_file)}  # fmt: skip
    assert found == set()
