"""One right-hand side, every language: what is written computes what is solved, to the last bit."""

import linecache
import math
import random
import textwrap
from typing import ClassVar

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from fracid.export.c import single_precision
from fracid.models import Model, Parameter, rotary_pendulum
from fracid.models.pendulum import TABLE
from fracid.models.written.languages import C, JavaScript, Matlab, Python
from fracid.models.written.reading import FUNCTIONS, Untranslatable
from fracid.models.written.tree import Assign, Call, Choice, Entry, Name, Number, Operation, Program
from languages import GCC, NODE, OCTAVE, in_c, in_node, in_octave
from own_models import own_models

ELEMENTS = {name: e["only"][0] for name, e in TABLE["model"]["equations"].items() if "only" in e}
"""State of an element → the parameter that switches it on."""


def pendulum(zero, *states):
    return rotary_pendulum(zero=zero).equipped([ELEMENTS[n] for n in states])


PENDULUMS = {
    f"{zero} with {' '.join(own) or 'the four'}": pendulum(zero, *own)
    for zero in ("hanging", "upright")
    for own in ((), ("z_theta",), ("z_theta", "z_alpha"), ("y_theta", "y_alpha"), ("arm",),
                ("z_alpha", "y_theta", "arm"), tuple(ELEMENTS))
}  # fmt: skip
MODELS = PENDULUMS | own_models()


def points_of(model, count=12):
    """States, inputs and constants, all moved, of sizes from where a joint sticks to where it slides."""
    rng, n = np.random.default_rng(3), len(model.states)
    for k in range(count):
        scale = 10.0 ** rng.uniform(-3, 1)
        p = model.parameter_vector()
        p = np.where(
            p == 0.0, rng.uniform(0, 1e-3, len(p)) * rng.integers(0, 2, len(p)), p * rng.uniform(0.9, 1.1, len(p))
        )
        x, u = scale * rng.standard_normal(n), scale * rng.standard_normal(max(1, len(model.inputs)))
        if "length" in model.inputs:
            u = np.array([1.0 + 0.15 * rng.random(), rng.standard_normal()])
        yield x, u, p, n + len(model.relaxing)


def solved(model, x, u, p, size):
    """By the model's own function; where a joint does not relax its rate is 0."""
    out = np.zeros(len(x) * (1 + bool(model.relaxing)))
    model.rhs(0.0, x, u, p, out)
    return np.array([*out[: len(x)], *(out[len(x) + i] for i in model.relaxing_states)])


CASES = {name: [*points_of(model)] for name, model in MODELS.items()}
EXPECTED = {name: [solved(MODELS[name], *point) for point in points] for name, points in CASES.items()}


def texts(language):
    return [language(m.program).text() for m in MODELS.values()], [m.parameter_names for m in MODELS.values()]


def test_the_tree_is_the_right_hand_side():
    for name, model in MODELS.items():
        read = Python(model.program).made()
        for (x, u, p, _), expected in zip(CASES[name], EXPECTED[name], strict=True):
            out = np.zeros(len(x) * (1 + bool(model.relaxing)))
            read(0.0, x, u, p, out)
            found = [*out[: len(x)], *(out[len(x) + i] for i in model.relaxing_states)]
            np.testing.assert_array_equal(found, expected, err_msg=name)
            assert model.program.constants <= {*model.parameter_names}


@pytest.mark.skipif(GCC is None, reason="gcc is not installed")
def test_in_c_every_model_is_the_same_to_the_last_bit(tmp_path):
    for f, name in zip(in_c(tmp_path, *texts(C)), MODELS, strict=True):
        for point, expected in zip(CASES[name], EXPECTED[name], strict=True):
            np.testing.assert_array_equal(f(*point), expected, err_msg=name)


@pytest.mark.skipif(GCC is None, reason="gcc is not installed")
def test_in_single_precision_it_is_the_same_but_for_its_rounding(tmp_path):
    model = MODELS["duffing"]
    [f] = in_c(tmp_path, [single_precision(C(model.program).text())], [model.parameter_names], "float")
    for point, expected in zip(CASES["duffing"], EXPECTED["duffing"], strict=True):
        np.testing.assert_allclose(f(*point), expected, rtol=1e-5, atol=1e-5 * np.abs(expected).max())


@pytest.mark.skipif(NODE is None, reason="Node is not installed")
def test_in_javascript_every_model_is_the_same_to_a_few_roundings(tmp_path):
    found = in_node(tmp_path, *texts(JavaScript), [*CASES.values()])
    for name, values in zip(MODELS, found, strict=True):
        for f, expected in zip(values, EXPECTED[name], strict=True):
            np.testing.assert_allclose(f, expected, rtol=1e-12, atol=1e-14 * np.abs(expected).max(), err_msg=name)


@pytest.mark.broad
@pytest.mark.skipif(OCTAVE is None, reason="Octave is not installed")
def test_in_octave_every_model_is_the_same_to_a_few_roundings(tmp_path):
    found = in_octave(tmp_path, *texts(Matlab), [*CASES.values()])
    for name, values in zip(MODELS, found, strict=True):
        for f, expected in zip(values, EXPECTED[name], strict=True):
            np.testing.assert_allclose(f, expected, rtol=1e-12, atol=1e-14 * np.abs(expected).max(), err_msg=name)


# --- trees at random ---------------------------------------------------------------------------------------------

ONE = ("sin", "cos", "tan", "atan", "sinh", "cosh", "tanh", "asinh", "exp", "expm1", "log1p", "sqrt", "cbrt", "abs",
       "sign", "erf", "log", "asin", "acosh")  # fmt: skip
"""Without floor and ceil, whose whole numbers in Python have no −0."""
TWO = ("atan2", "min", "max", "copysign", "fmod")
LEAVES = (Entry("x", Number(0)), Entry("x", Number(1)), Entry("u", Number(0)), Entry("p", Number(0), "a"),
          Entry("p", Number(1), "for"), Name("w"))  # fmt: skip


def tree(rng, depth):
    """Of the whitelist."""
    kind = rng.choice(("one", "two", "sign", "sign", "neg", "choice", "truth")) if depth else "leaf"
    inner = [tree(rng, depth - 1 if rng.random() < 0.8 else 0) for _ in range(2)] if depth else []
    match kind:
        case "one":
            return Call(rng.choice(ONE), (inner[0],))
        case "two":
            return Call(rng.choice(TWO), tuple(inner))
        case "sign":
            return Operation(rng.choice(("+", "-", "*", "/", "**", "%", "//")), tuple(inner))
        case "neg":
            return Operation("neg", (inner[0],))
        case "choice":
            return Choice(truth_of(rng, depth - 1), *inner)
        case "truth":
            return Operation("*", (truth_of(rng, depth - 1), inner[0]))
    return rng.choice(LEAVES) if rng.random() < 0.7 else Number(round(rng.uniform(-3, 3), 2))


def truth_of(rng, depth):
    sides = [tree(rng, max(0, depth - 1)) for _ in range(4)]
    one, other = (Operation(rng.choice(("<", "<=", ">", ">=", "==", "!=")), tuple(sides[k : k + 2])) for k in (0, 2))
    return rng.choice((one, Operation("not", (one,)), Operation(rng.choice(("and", "or")), (one, other))))


def program_of(w, f):
    out = (Assign(Entry("out", Number(0)), f), Assign(Entry("out", Number(1)), Name("w")))
    return Program(("a", "b"), (), (), (Assign(Name("w"), Number(0.5)), Assign(Name("w"), w), *out))


PLACES = [(np.array(x), np.array([u]), np.array(p), 2) for x, u, p in (
    ([0.3, -1.7], 0.9, [2.5, -0.4]), ([-2.0, 0.0], -1.3, [0.7, 3.0]), ([1.1, 1.1], 0.0, [1.0, 0.25]))]  # fmt: skip


class Real(Python):
    """Python without complex numbers, as Numba and the other languages have it."""

    functions: ClassVar = {n: f"math.{n}" for n in FUNCTIONS}

    def power(self, base, exponent):
        return f"math.pow({self.expression(base)}, {self.expression(exponent)})", 9


def in_python(function, x, u, p, size):
    """None where Python has no real number for it."""
    out = [0.0] * size
    try:
        function(0.0, x.tolist(), u.tolist(), p.tolist(), out)
    except (ArithmeticError, ValueError, TypeError):
        return None
    return np.array(out, dtype=float) if np.all(np.abs(out) < 1e12) else None


@pytest.mark.broad
@pytest.mark.skipif(GCC is None or NODE is None, reason="gcc or Node is not installed")
@settings(
    max_examples=2, deadline=None, derandomize=True, phases=[Phase.generate], suppress_health_check=[*HealthCheck]
)
@given(seed=st.integers(0, 2**32))
def test_trees_at_random_are_the_same_in_c_javascript_and_octave(tmp_path_factory, seed):
    folder, rng = tmp_path_factory.mktemp("trees"), random.Random(seed)
    programs = [program_of(tree(rng, 4), tree(rng, 4)) for _ in range(100)]
    expected = [[in_python(Real(p).made(), *place) for place in PLACES] for p in programs]
    assert sum(e is not None for of_one in expected for e in of_one) > 100
    names = [("a", "for_")] * len(programs)
    functions = in_c(folder, [C(p).text() for p in programs], names)
    for function, program, of_one in zip(functions, programs, expected, strict=True):
        for place, f in zip(PLACES, of_one, strict=True):
            if f is not None:
                np.testing.assert_array_equal(function(*place), f, err_msg=C(program).text())
    for language, second, run in ((JavaScript, "for", in_node), (Matlab, "for_", in_octave if OCTAVE else None)):
        written = [k for k, p in enumerate(programs) if run and not set(language.never).intersection(p.calls)]
        firm = {k: _firm(programs[k], expected[k]) for k in written}
        there = [k for k in written if firm[k]]
        assert len(there) > 50 or run is None
        texts, places = [language(programs[k]).text() for k in there], [[PLACES[i] for i in firm[k]] for k in there]
        found = run(folder, texts, [("a", second)] * len(there), places) if run else []
        for k, text, values in zip(there, texts, found, strict=True):
            f = np.array([expected[k][i] for i in firm[k]])
            np.testing.assert_allclose(np.reshape(values, f.shape), f, rtol=1e-9, atol=1e-9, err_msg=text)


def _firm(program, expected):
    """The places with a real number that no rounding decides, by a comparison or a whole number."""
    function, rng = Real(program).made(), np.random.default_rng(0)

    def moved(place):
        return in_python(function, *(v * (1 + 1e-13 * rng.standard_normal(v.shape)) for v in place[:3]), place[3])

    def stays(place, f):
        others = [moved(place) for _ in range(4)]
        return all(g is not None and np.allclose(g, f, rtol=1e-10, atol=1e-10) for g in others)

    return [i for i, f in enumerate(expected) if f is not None and stays(PLACES[i], f)]


# --- Python, read ------------------------------------------------------------------------------------------------


def model_of(source, states=2, parameters=("a", "b", "c"), inputs=1, **there):
    """A model whose right-hand side is written in a text, which stands for a file."""
    text = textwrap.dedent(source)
    file = f"/models/{abs(hash(text))}.py"
    linecache.cache[file] = (len(text), None, text.splitlines(True), file)
    space = {"math": math, "np": np, **there}
    exec(compile(text, file, "exec"), space)
    names = tuple(f"x{i}" for i in range(states))
    return Model(
        "read", space["rhs"], names, (1.0,) * states, {"x0": 0}, tuple(f"u{i}" for i in range(inputs)),
        tuple(Parameter(n, "1", 0.1 * k + 0.3, "") for k, n in enumerate(parameters)), "", "",
    )  # fmt: skip


READ = {
    "a swap": """
        def rhs(t, x, u, p, out):
            a, b = x[0], x[1]
            a, b = b, a - b
            out[0], out[1] = a, b
        """,
    "loops, of which a short one is written out": """
        def rhs(t, x, u, p, out):
            total = 0.0
            for k in range(3):
                total += p[k] * x[k % 2] ** k
            n = 0
            while total > 1.0 and n < 60:
                total = 0.5 * total
                n += 1
            for i in range(200):
                if total < 1e-3 * i:
                    break
                total -= 1e-4 * i
            out[0], out[1] = total, n
        """,
    "a helper that writes, and one that gives two": """
        def both(a, b):
            if a > b:
                return a, b
            return b, a

        def fill(out, i, v):
            out[i] = v
            return 2.0 * out[i]

        def rhs(t, x, u, p, out):
            most, least = both(x[0], x[1])
            twice = fill(out, 0, most - least)
            out[1] = twice + least if u[0] > 0 else fill(out, 0, 3.0)
        """,
    "closures, constants and a branch that is known": """
        def made(k, table, soft):
            def helper(v, w=2.0):
                return v * k + w

            def rhs(t, x, u, p, out):
                s = math.tanh(x[0]) if soft else np.sign(x[0])
                out[0] = helper(s) + table[1] * math.pi
                out[1] = helper(w=x[1], v=len(x)) - max(x[0], x[1], 0.1) + min(p[0], math.log(8.0, 2.0))
            return rhs
        rhs = made(0.3, (1.0, 2.5), True)
        """,
    "names of other languages, and an early return": """
        def double(x):
            return 2.0 * x

        def rhs(t, y, int, end, out):
            sin = math.sin(y[0])
            if sin < 0.0:
                out[0] = double(sin)
                out[1] = 0.0
                return
            out[0] = sin
            out[1] = double(int[0]) or end[0]
        """,
    "a piece of an array": """
        def norm(v):
            return math.sqrt(v[0] * v[0] + v[-1] * v[-1])

        def rhs(t, x, u, p, out):
            out[0] = norm(p[1:3]) + norm(x)
            out[1] = (x[0] > 0.1) / (u[0] > -9.0) + (-2.0) ** 2 - -x[1]
        """,
}


@pytest.fixture(scope="module")
def read_models():
    return {name: model_of(source) for name, source in READ.items()}


def test_what_python_may_say_is_read_and_written(read_models, tmp_path):
    points = [[*points_of(m, 20)] for m in read_models.values()]
    expected = [[solved(m, *point) for point in of_one] for m, of_one in zip(read_models.values(), points, strict=True)]
    names = [m.parameter_names for m in read_models.values()]
    for m, of_one, there in zip(read_models.values(), points, expected, strict=True):
        for (x, u, p, size), f in zip(of_one, there, strict=True):
            out = np.zeros(size)
            Python(m.program).made()(0.0, x, u, p, out)
            np.testing.assert_array_equal(out, f)
    if GCC:
        functions = in_c(tmp_path, [C(m.program).text() for m in read_models.values()], names)
        for function, of_one, there in zip(functions, points, expected, strict=True):
            for point, f in zip(of_one, there, strict=True):
                np.testing.assert_array_equal(function(*point), f)
    if NODE:
        found = in_node(tmp_path, [JavaScript(m.program).text() for m in read_models.values()], names, points)
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-14)


@pytest.mark.broad
@pytest.mark.skipif(OCTAVE is None, reason="Octave is not installed")
def test_what_python_may_say_is_read_and_written_in_octave(read_models, tmp_path):
    points = [[*points_of(m, 20)] for m in read_models.values()]
    expected = [[solved(m, *point) for point in of_one] for m, of_one in zip(read_models.values(), points, strict=True)]
    names = [[n if n != "end" else "end_" for n in m.parameter_names] for m in read_models.values()]
    found = in_octave(tmp_path, [Matlab(m.program).text() for m in read_models.values()], names, points)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-14)


REFUSED = {
    "out[0] = t * x[0]": ("line 2", "`t`", "record the signal that depends on it as an input"),
    "out[0] = np.dot(x, x)": ("line 2", r"`np.dot\(x, x\)`", "Numbers, math, if, for"),
    "y = [v for v in x]": ("line 2", r"`\[v for v in x\]`", "are translated"),
    "out[0] = x[int(p[0])] * 0 + p[int(u[0])]": ("line 2", "`p", "Write the index as a number"),
    "out[0] = x[7]": ("line 2", r"`x\[7\]`", "There are 2 entries"),
    "x[0] = 1.0": ("line 2", r"`x\[0\]`", "writes into out alone"),
    "out[0] = later": ("line 2", "`later`", "has no value here that is known"),
    "out[0] = rhs(t, x, u, p, out)": ("line 2", "`rhs", "calls itself; write a loop"),
    "with open('f') as f: pass": ("line 2", "`with open", "are translated"),
}


@pytest.mark.parametrize("line", REFUSED)
def test_what_cannot_be_translated_is_said_with_its_line_and_what_to_write(line):
    with pytest.raises(Untranslatable) as told:
        _ = model_of(f"def rhs(t, x, u, p, out):\n    {line}\n    out[1] = 0.0\n").program
    for words in REFUSED[line]:
        told.match(words)


def test_a_function_without_a_source_is_told_so():
    there = {}
    exec("def rhs(t, x, u, p, out):\n    out[0] = 0.0", there)
    with pytest.raises(Untranslatable, match="The source of rhs cannot be read; put it into a file"):
        _ = Model("lost", there["rhs"], ("x",), (1.0,), {"x": 0}, (), (), "", "").program
