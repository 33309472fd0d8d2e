"""Functions that mean the same are compiled once; those that do not are not taken for one another."""

import math

import numba as nb
import numpy as np
import pytest

import fracid
from fracid.models import model_from_name
from fracid.solver.right_hand_side import compile_rhs
from fracid.solver.same_function import SameCode, once_for_equals

SOURCE = """
import math
from fracid import Model, Parameter

RATE = {rate}

def pull(x):
    return RATE * math.sin(x)

def rhs(t, x, u, p, out):
    out[0] = -p[0] * {body}

model = Model(name="own", rhs=rhs, states=("alpha",), orders=("mu",), outputs={{"alpha": 0}}, inputs=(),
              parameters=(Parameter("k", "1/s", 1.0, "rate"),), zero="", source="a test")
"""


def loaded(folder, rate=2.0, body="RATE * math.sin(x[0])", name="own.py"):
    (folder / name).write_text(SOURCE.format(rate=rate, body=body))
    return model_from_name(f"{name}:model", folder=folder)


def test_a_model_that_is_loaded_twice_is_compiled_once(tmp_path):
    first, second = loaded(tmp_path), loaded(tmp_path)
    assert first.rhs is not second.rhs
    assert compile_rhs(first.rhs) is compile_rhs(second.rhs)


@pytest.mark.few(3)
@pytest.mark.parametrize(
    "other",
    [
        {"rate": 3.0},
        {"rate": 2},
        {"rate": -2.0},
        {"body": "RATE * math.cos(x[0])"},
        {"body": "RATE * math.sin(x[0]) + 1.0"},
    ],
    ids=str,
)
def test_a_file_that_was_changed_is_compiled_anew(tmp_path, other):
    """A constant of the file is not in the function's code."""
    first, second = loaded(tmp_path), loaded(tmp_path, **other)
    assert compile_rhs(first.rhs) is not compile_rhs(second.rhs)


def test_a_changed_constant_changes_the_solution(tmp_path):
    ends = [
        fracid.simulate(loaded(tmp_path, rate), orders={"mu": 1.0}, initial={"alpha": 0.1}, step=1e-3, end=1.0).states[
            -1, 0
        ]
        for rate in (2.0, 3.0, 2.0)
    ]
    assert ends[0] == ends[2] != ends[1]
    assert ends == pytest.approx([2 * math.atan(math.tan(0.05) * math.exp(-r)) for r in (2, 3, 2)], rel=1e-5)


def closure(k):
    return lambda x: k * x


def calls(inner):
    return lambda x: inner(x) + 1


TABLE = np.arange(3.0)


class Thing:
    pass


PAIRS = {
    "the same": (closure(2.0), closure(2.0), True),
    "another constant closed over": (closure(2.0), closure(3.0), False),
    "another type": (closure(2.0), closure(2), False),
    "a negative zero": (closure(0.0), closure(-0.0), False),
    "true is not one": (closure(True), closure(1), False),
    "an array of equal values": (closure(TABLE), closure(TABLE.copy()), True),
    "an array of other values": (closure(TABLE), closure(TABLE + 1), False),
    "an array of another type": (closure(TABLE), closure(TABLE.astype(np.float32)), False),
    "functions that it calls": (calls(closure(1.0)), calls(closure(1.0)), True),
    "others that it calls": (calls(closure(1.0)), calls(closure(2.0)), False),
    "compiled ones": (calls(nb.njit(closure(1.0))), calls(nb.njit(closure(1.0))), True),
    "compiled in another way": (calls(nb.njit(closure(1.0))), calls(nb.njit(fastmath=True)(closure(1.0))), False),
    "objects nobody knows": (closure(Thing()), closure(Thing()), False),
    "lists, which change": (closure([1.0]), closure([1.0]), False),
    "another default": (lambda x, k=1: x * k, lambda x, k=2: x * k, False),
}


@pytest.mark.parametrize("what", PAIRS)
def test_functions_are_the_same_where_all_that_they_refer_to_is(what):
    one, other, same = PAIRS[what]
    assert (SameCode(one) == SameCode(other)) is same
    assert SameCode(one) == SameCode(one)
    assert hash(SameCode(one)) == hash(SameCode(one))


def test_a_function_that_calls_itself_has_a_meaning():
    def factorial(n):
        return 1 if n < 2 else n * factorial(n - 1)

    assert SameCode(factorial) == SameCode(factorial)


def test_it_is_asked_once_for_equals():
    asked = []
    look = once_for_equals(lambda f: asked.append(f) or f(2))
    assert [look(closure(5.0)) for _ in range(3)] == [10.0] * 3
    assert len(asked) == 1
