"""A right-hand side of a user's own that cannot be is refused in a sentence: no crash, no chance, no hidden state."""

import random
from functools import partial

import numba
import numpy as np
import pytest
from numpy.random import normal

import fracid
from fracid.errors import InputError
from fracid.solver.right_hand_side import compile_rhs

NUMBER = 0
FAR = 50_000_000
GENERATOR = np.random.default_rng(1)
RANDOM = np.random


def with_default(t, x, u, p, out, k=2.0):
    out[0] = -k * x[0]


def with_name_only(t, x, u, p, out, *, k=2.0):
    out[0] = -k * x[0]


def of_anything(*given):
    given[4][0] = -given[1][0]


async def waiting(t, x, u, p, out):
    out[0] = -x[0]


def yielding(t, x, u, p, out):
    out[0] = -x[0]
    yield


def counting(t, x, u, p, out):
    global NUMBER
    NUMBER += 1
    out[0] = -x[0]


def keeping():
    calls = 0

    def rhs(t, x, u, p, out):
        nonlocal calls
        calls += 1
        out[0] = -x[0]

    return rhs


def flat(t, x, u, p, out):
    out[0] = -x[0]
    if t > 0.5:
        out.flat[FAR] = 1.0


def strided(t, x, u, p, out):
    out[0] = np.lib.stride_tricks.as_strided(x, (9,), (8,))[8]


def noisy(t, x, u, p, out):
    out[0] = -x[0] + np.random.normal()  # noqa: NPY002


def noisy_by_name(t, x, u, p, out):
    out[0] = -x[0] + normal()  # noqa: NPY002


def noisy_by_module(t, x, u, p, out):
    def drawn():
        return RANDOM.rand()

    out[0] = -x[0] + drawn()


def drawn():
    return random.random()


def noisy_by_helper(t, x, u, p, out):
    out[0] = -x[0] + drawn()


def noisy_by_generator(t, x, u, p, out):
    out[0] = -x[0] + GENERATOR.normal()


class Rig:
    def rhs(self, t, x, u, p, out):
        out[0] = -x[0]

    __call__ = rhs


UNFIT = {
    with_default: "takes (t, x, u, p, out, k=2.0); it must take (t, x, u, p, out)",
    with_name_only: "takes (t, x, u, p, out, *, k=2.0); it must take",
    of_anything: "takes (*given); it must take",
    waiting: "waits or yields; it must be a plain def, without async and yield",
    yielding: "waits or yields",
    counting: "changes NUMBER, which lies outside of it",
    keeping(): "changes calls, which lies outside of it",
    flat: "uses flat, whose accesses cannot be checked; index the array itself: out[i]",
    strided: "uses as_strided, whose accesses cannot be checked",
    noisy: "draws random numbers (random), so that no two runs were the same",
    noisy_by_name: "draws random numbers (normal)",
    noisy_by_module: "draws random numbers (RANDOM)",
    noisy_by_helper: "draws random numbers (random)",
    noisy_by_generator: "draws random numbers (GENERATOR)",
    Rig(): "must be a function, def rhs(t, x, u, p, out); got",
    Rig().rhs: "must be a function",
    partial(with_default, k=1.0): "must be a function",
}


@pytest.mark.parametrize("rhs", UNFIT, ids=lambda rhs: getattr(rhs, "__qualname__", type(rhs).__name__))
def test_what_can_be_no_equation_of_motion_is_refused_by_what_it_does(rhs):
    with pytest.raises(InputError) as refused:
        compile_rhs(rhs)
    assert UNFIT[rhs] in str(refused.value)


# --- accesses out of bounds, where only the run can tell ------------------------------------------------


def inner(t, x, u, p, out):
    def write(a, i):
        a[i] = 1.0

    out[0] = -x[0]
    if t > 0.5:
        write(out, FAR)


def anonymous(t, x, u, p, out):
    far = lambda a: a[FAR]  # noqa: E731
    out[0] = far(x) if t > 0.5 else -x[0]


def part(t, x, u, p, out):
    out[0] = -x[0]
    if t > 0.5:
        out[0] = x[:1][FAR]


@numba.njit
def compiled(a):
    return a[FAR]


def by_compiled_helper(t, x, u, p, out):
    out[0] = compiled(x) if t > 0.5 else -x[0]


@pytest.mark.few(2)
@pytest.mark.parametrize("rhs", [inner, anonymous, part, by_compiled_helper])
def test_an_index_out_of_bounds_is_a_sentence_wherever_it_stands(rhs):
    with pytest.raises(InputError, match=rf"{rhs.__name__} fails on the way: IndexError: .*is out of bounds"):
        fracid.solve_fde(rhs, orders=0.9, initial=[1.0], step=0.01, end=1.0)


# --- what is not its own --------------------------------------------------------------------------------


def writes(t, x, u, p, out):
    out[0] = -x[0]
    if t > 0.5:
        x[0] = 5.0


def writes_a_part(t, x, u, p, out):
    part = x[:1]
    out[0] = -x[0]
    if t > 0.5:
        part[:] = 5.0


def writes_in_place(t, x, u, p, out):
    x *= 1.0
    out[0] = -x[0]


@pytest.mark.few(2)
@pytest.mark.parametrize("rhs", [writes, writes_a_part, writes_in_place])
def test_what_writes_into_the_states_is_refused_wherever_it_is_compiled(rhs):
    with pytest.raises(InputError, match="changes x, u or p, which are not its own"):
        compile_rhs(rhs)


def reads(t, x, u, p, out):
    both = x.copy()
    both[0] *= 2.0
    matrix = np.outer(x, x) + np.eye(2)
    out[:] = np.linalg.solve(matrix, both) + matrix @ x - np.where(x > 0, x, -x)
    for i, value in enumerate(x):
        out[i] -= value


@pytest.mark.broad
def test_what_reads_them_in_any_way_is_taken():
    x, out, expected = np.array([0.5, -2.0]), np.zeros(2), np.zeros(2)
    compile_rhs(reads)(0.0, x, np.zeros(0), np.zeros(0), out)
    reads(0.0, x, np.zeros(0), np.zeros(0), expected)
    assert out == pytest.approx(expected, rel=1e-12)
