"""Equations of a project file: read by a whitelist, never run as Python, checked with their units, compiled as any."""

import math
import pickle
import random
import re
import time
from contextlib import suppress

import numpy as np
import pytest

import fracid
from fracid.export.equations import toml_model
from fracid.export.whole import written, written_outputs
from fracid.models import Parameter
from fracid.models.written.equations import ARRAYS, OTHERS, Equation, Equations
from fracid.models.written.formulas import ARGUMENTS, DEEPEST, KNOWN, LONGEST, FormulaError, formula
from fracid.models.written.tree import Entry, Number
from fracid.problem.project import project_from_text
from fracid.recording.channel import UNITS as RECORDED
from fracid.solver.right_hand_side import compile_rhs
from own_models import own_models

AXIS = {"position": Equation("speed"),
        "speed": Equation("(force - b*speed - f*tanh(speed/1e-3) - offset)/m", "mu")}  # fmt: skip
UNITS = {"m": "kg", "b": "N s/m", "f": "N", "offset": "N"}


def axis(outputs=None, **changed):
    constants = [Parameter(n, unit, 2.0, "") for n, unit in UNITS.items()]
    outputs = {"position": Equation("position", unit="m")} if outputs is None else outputs
    return Equations(AXIS | changed, outputs, {"force": "N"}).model("linear-axis", constants)


NAMES = {n: Entry("x", Number(i)) for i, n in enumerate(("a", "b", "c"))}


def value(text, a=0.3, b=-1.7, c=2.5):
    model = Equations({"y": Equation(text)}, inputs=dict.fromkeys(NAMES, "")).model("one", [])
    out = np.zeros(1)
    model.rhs(0.0, np.zeros(1), np.array([a, b, c]), np.zeros(0), out)
    return out[0]


@pytest.mark.parametrize("text", [
    "a + b*c - -a/2", "-a**2", "2**-a**2", "a if b < 0 else c if a > 1 else 3", "min(a, b, c) + max(a, 1e-3)",
    "(a < b) * c + (b <= a < c)", "not a > b and c > 0 or b > 0", "tanh(a/.5) + atan2(b, c) + hypot(a, b)",
    "abs(b)**0.5*pi", "log(c, 2.0) + exp(-a) - +a", "1.5e-3 * a", "(((a)))", "c - a - b", "c / a / b",
    "cbrt(b) + fmod(b, c) + fmod(c, a)", "-a % b * c // a", "b // a - c % b",
])  # fmt: skip
def test_an_equation_means_what_it_means_in_python(text):
    there = {"a": 0.3, "b": -1.7, "c": 2.5, **vars(math)}
    assert value(text) == eval(text, there)


def test_a_derivative_that_is_another_states_value_by_chance_is_no_rate():
    """(20 − 0.1)/2/50 + 0.1/2/50 is 0.2, which is what a second state is where both are taken as 0.1 and 0.2."""
    rates = {"plate": Equation("(-(plate - 20)/2 - (plate - block)/2)/50"), "block": Equation("(plate - block)/20")}
    assert Equations(rates, {}, {}).model("rig", []).rates == {}
    assert Equations({"x": Equation("v"), "v": Equation("-x")}, {}, {}).model("mass", []).rates == {0: 1}


@pytest.mark.parametrize("name", [n for n in KNOWN if n not in ("acosh", "atanh")])
def test_every_function_that_equations_may_have_is_compiled(name):
    text = f"{name}(a, c)" if name in (*ARGUMENTS, "min", "max") else f"{name}(a)"
    rhs = Equations({"y": Equation(text)}, inputs=dict.fromkeys(NAMES, "")).model("one", []).rhs
    out = np.zeros(1)
    compile_rhs(rhs)(0.0, np.zeros(1), np.array([0.3, -1.7, 2.5]), np.zeros(0), out)
    assert out[0] == pytest.approx(value(text), rel=1e-12)


def test_sign_is_a_function():
    assert [value("sign(a)", a=v) for v in (-2.0, 0.0, 3.0)] == [-1.0, 0.0, 1.0]


@pytest.mark.parametrize(("text", "column", "why"), [
    ("a + tahn(b)", 4, "`tahn` is no function; did you mean `tanh`?"),
    ("a + bb", 4, "`bb` is no state, input or parameter; did you mean `b`?"),
    ("a^2", 1, "a power is \\*\\*"),
    ("2a", 0, "is a \\* missing after the number"),
    ("a(b)", 0, "is a \\* missing after it"),
    ("(a + b", 6, "A bracket is not closed here"),
    ("a +", 3, "A value is missing here"),
    ("a b", 2, "is one too many here"),
    ("sin", 0, "is a function: sin"),
    ("atan2(a)", 0, "`atan2` takes 2, not 1"),
    ("a if b", 6, "`else` is missing"),
    ("__import__('os')", 11, "means nothing here"),
    ("a.real", 1, "means nothing here"),
    ("a[0]", 1, "only \\( \\) are brackets"),
    ("λ", 0, "means nothing here; names have letters a to z"),
    ("(a b)", 3, "`b` is one too many here; is a sign missing before it"),
    ("(1,5*a)", 2, "`,` is one too many here; is it a decimal point"),
    ("a²", 1, "a square is \\*\\*2"),
    ("a*1_000", 2, "a number is as 1000"),
    ("a*1j", 2, "is a \\* missing after the number\\?$"),
    ("a − b", 2, "`−` means nothing here; type -"),
    ("a && b", 2, "type and"),
    ("a>b ? a : b", 4, "a choice is `a if test else b`"),
    ("if(a>b, a, b)", 0, "a choice is `a if test else b`"),
    ("ln(a)", 0, "`ln` is no function; type log"),
    ("zeta(a)", 0, "`zeta` is no function; .* sqrt, .* sign\\.$"),
    ("sin(t)", 4, "`t` is no state, input or parameter; equations have no time: record it, as an input"),
    ("a*1e999", 2, "This is no finite number"),
    ("a + (-1)**0.5", 8, "This is no finite number"),
    ("a + 1/0", 5, "This is no finite number"),
    ("sqrt(-2)*a", 0, "This is no finite number"),
    ("", 0, "A value is missing here"),
])  # fmt: skip
def test_what_is_no_equation_is_said_under_the_place(text, column, why):
    with pytest.raises(FormulaError, match=why) as told:
        formula(text, NAMES)
    _, shown, caret = str(told.value).split("\n")
    assert shown == f"    {text}"
    assert caret.index("^") - 4 == column


HOSTILE = ["(" * 5000, "a+" * 900 + "a", "-" * 1900 + "a", "not " * 400 + "a", "a**" * 600 + "a",
           "a if a else " * 150 + "a",
           "9" * 1900, "1e" + "9" * 1000, "9**9**9**9**9", "a" * 2000, "max(" * 400 + "a", "\x00", "a\n;import os",
           "().__class__.__bases__", "lambda: a", "a := b", "a, b", "{a}", "f'{a}'", "é" * 1900,
           "a<" * 900 + "b"]  # fmt: skip


@pytest.mark.parametrize("text", HOSTILE, ids=range(len(HOSTILE)))
def test_hostile_text_ends_soon_in_a_sentence(text, monkeypatch):
    run = []
    with monkeypatch.context() as patch:
        for name in ("eval", "exec", "compile"):
            patch.setattr(f"builtins.{name}", lambda *_, name=name, **__: run.append(name))
        took = []
        for _ in range(3):  # the least of which a busy machine lengthens least
            began = time.thread_time()
            with suppress(FormulaError):
                formula(text, NAMES)
            took.append(time.thread_time() - began)
    assert not run
    assert min(took) < 0.05


ALPHABET = (*"abc+-*/()<>=!., 0123456789e_'[λ", "\\", "\n", "**", "tanh(", "min(", " if ", " else ", " and ", " not ")


def test_random_text_ends_soon_in_a_tree_or_a_sentence():
    rng, slowest = random.Random(7), 0.0
    for _ in range(3000):
        text = "".join(rng.choice(ALPHABET) for _ in range(rng.randrange(1, 120)))
        began = time.process_time()
        with suppress(FormulaError):
            formula(text, NAMES)
        slowest = max(slowest, time.process_time() - began)
    assert slowest < 0.05


@pytest.mark.parametrize("definitions", [{"a": "2*b", "b": "x"}, {"a": "b + 1", "b": "a + 1"}, {"a": "a + 1"}])
def test_a_definition_that_is_used_before_it_stands_is_told_so(definitions):
    written = {n: Equation(text) for n, text in definitions.items()}
    with pytest.raises(FormulaError, match=r"`[ab]` is defined further down, or by itself"):
        Equations({"x": Equation("-a*x")}, definitions=written).model("one", [])


@pytest.mark.parametrize("name", ["x", "u", "p", "t", "f", "out", "math", "np", "rhs", "lambda", "class", "int", "_x0"])
def test_a_definition_or_an_output_may_have_any_name(name):
    rates = {"speed": Equation(f"-{name} - speed**2"), "level": Equation("speed")}
    outputs = {name: Equation(f"{name} + speed + speed")}
    model = Equations(rates, outputs, {"force": ""}, {name: Equation("min(speed, level)")}).model("one", [])
    place = np.array([3.0, 2.0]), np.zeros(1), np.zeros(0)
    np.testing.assert_array_equal(model.derivatives(*place), [-11.0, 3.0])
    assert model.outputs[name](0.0, *place) == 8.0
    for language in ("c", "javascript"):
        assert not re.search(rf"const (double )?({'|'.join(ARRAYS)}) =", written(model, language))


@pytest.mark.parametrize(("one", "other"), [("q", "_q"), ("lambda", "lambda_"), ("_x0", "x0")])
def test_two_names_stay_two_in_every_language(one, other):
    definitions = {one: Equation("speed*10"), other: Equation("level*1000")}
    rates = {"speed": Equation(f"{one} + {other} + speed**2"), "level": Equation("0")}
    model = Equations(rates, definitions=definitions).model("one", [])
    assert model.derivatives(np.array([3.0, 2.0]), np.zeros(0), np.zeros(0))[0] == 2039.0
    for language in ("c", "javascript", "matlab"):
        assert len(set(re.findall(r"(\w+) = x.[012]. \*", written(model, language)))) == 2


def test_a_letter_that_equations_do_not_have_is_refused_where_it_is_named():
    with pytest.raises(fracid.InputError, match="'μ' cannot be a name in equations; expected letters a to z"):
        Equations({"x": Equation("-x")}).model("one", [Parameter("μ", "", 1.0, "")])


def test_what_is_too_long_or_too_deep_is_refused():
    with pytest.raises(FormulaError, match=f"{LONGEST:,} are read"):
        formula("a" * (LONGEST + 1), NAMES)
    with pytest.raises(FormulaError, match=f"More than {DEEPEST} operations"):
        formula("+".join("a" * (DEEPEST + 2)), NAMES)


@pytest.mark.parametrize(("equation", "why"), [
    ("(force - b*speed)/m + position", "It adds m s^-2 and m"),
    ("(force - b*speed - m)/m", "It subtracts kg m s^-2 and kg"),
    ("sin(force)/m", "`sin` takes a plain number or an angle, not kg m s^-2"),
    ("force", "This is in kg m s^-2; expected m s^-2"),
    ("force/m if force < m else 0", "It compares kg m s^-2 and kg"),
])  # fmt: skip
def test_units_that_do_not_agree_are_said_under_the_place(equation, why):
    with pytest.raises(FormulaError, match=r"^\[model.equations\] speed\n") as told:
        axis(speed=Equation(equation))
    told.match(why.replace("^", r"\^"))


def test_where_an_order_is_free_the_unit_says_what_to_type():
    def tank(rate, *parameters):
        return Equations({"x": Equation(rate, "q", "1")}, {}, {"u": "1"}).model("tank", parameters)

    with pytest.raises(
        FormulaError, match=r"This is a plain number; expected s\^-1. Its order q may be other than 1"
    ) as told:
        tank("u - x")
    told.match('divide it by a time in s, or multiply it by a parameter with unit = "s\\^-q"')
    with pytest.raises(FormulaError, match=r"This is in kg; expected s\^-1\.$"):
        tank("(u - x)*m", Parameter("m", "kg", 1.0, ""))
    assert tank("(u - x)/T", Parameter("T", "s", 1.0, "")).states == ("x",)
    assert tank("k*(u - x)", Parameter("k", "s^-q", 1.0, "")).states == ("x",)


@pytest.mark.parametrize("unit", ["s^-0.5", "1/s^0.5", "1/s"])
def test_a_derivative_of_fixed_order_has_the_unit_of_that_order_or_the_papers(unit):
    heat = Equations({"x": Equation("-a*x", 0.5, "K")})
    assert heat.model("heat", [Parameter("a", unit, 1.0, "")]).orders == (0.5,)
    with pytest.raises(FormulaError, match=r"This is in s\^-2 K; expected s\^-0.5 K\.$"):
        heat.model("heat", [Parameter("a", "1/s^2", 1.0, "")])


def test_a_power_whose_exponent_is_a_name_may_have_any_unit_and_the_exponent_has_none():
    spring = Equations({"x": Equation("k*x**n", unit="m")})
    k, exponents = Parameter("k", "m^-0.5/s", 1.0, ""), [Parameter("n", unit, 1.5, "") for unit in ("1", "", "m")]
    assert [spring.model("spring", [k, n]).states for n in exponents[:2]] == [("x",), ("x",)]
    with pytest.raises(FormulaError, match=r"\n       \^ An exponent is a plain number, not m\."):
        spring.model("spring", [k, exponents[2]])


@pytest.mark.parametrize(("unit", "factor", "si"), [
    ("mN/m", "0.001", "N/m"), ("g", "0.001", "kg"), ("kN/m", "1000", "N/m"), ("N/mm", "1000", "N/m"),
    ("deg", "0.0174533", "rad"), ("uF", "1e-06", "F"), ("h", "3600", "s"), ("mNm/rpm", "0.0095493", "N m/rad s"),
    ("kN s^q/m", "1000", "N s^q/m"),
])  # fmt: skip
def test_a_value_whose_unit_is_not_si_is_told_what_to_type(unit, factor, si):
    line = Equations({"x": Equation("-k*x")})
    with pytest.raises(fracid.InputError, match=f"multiply those of k by {factor} and type unit = ") as told:
        line.model("line", [Parameter("k", unit, 1.0, "")])
    assert f'unit = "{si}"' in str(told.value)
    for same in (si, "mN/mm", "s^-q", "lb/s", "mg/ml"):
        assert line.model("line", [Parameter("k", same, 1.0, "")]).parameters[0].unit == same


@pytest.mark.parametrize("unit", ["ohm", "Ω", "Ohm"])
def test_other_spellings_of_a_unit_are_checked_as_it_is(unit):
    with pytest.raises(FormulaError, match="It adds"):
        Equations({"x": Equation("R + C")}).model("rc", [Parameter("R", unit, 1.0, ""), Parameter("C", "F", 1.0, "")])


def test_units_of_models_and_of_recordings_have_the_same_factors():
    shared = {n: RECORDED[n] for n in RECORDED if n in OTHERS and n not in ("g", "mg")}  # of acceleration there
    assert shared.keys() >= {"deg", "rpm", "bar", "mN", "kPa"}
    for n, (factor, of) in shared.items():
        assert (pytest.approx(factor), of) == tuple(OTHERS[n])


def test_what_has_no_unit_may_have_any():
    constants = [Parameter(n, "", 2.0, "") for n in UNITS]
    assert Equations(AXIS, inputs={"force": ""}).model("axis", constants).outputs == {"position": 0, "speed": 1}


def test_a_model_of_equations_is_the_same_model_in_another_process():
    model = axis({"power": Equation("force*speed", unit="W")})
    other = pickle.loads(pickle.dumps(model))
    assert other.rhs == model.rhs
    assert hash(other.rhs) == hash(model.rhs)
    x, u, out = np.array([0.1, 0.2]), np.array([3.0]), np.zeros(2)
    other.rhs(0.0, x, u, other.parameter_vector(), out)
    np.testing.assert_array_equal(out, [0.2, (3.0 - 2 * 0.2 - 2 * math.tanh(0.2 / 1e-3) - 2.0) / 2])
    assert other.outputs["power"](0.0, x, u, other.parameter_vector()) == 3.0 * 0.2


@pytest.mark.parametrize("root", ["sqrt(position)", "log(position)", "exp(100*position)", "gamma(position)"])
def test_an_output_has_no_definition_that_it_does_not_read(root):
    twice = {"twice": Equation("2*speed"), "position": Equation("position")}
    rates = {"position": Equation("speed"), "speed": Equation("-root")}
    model = Equations(rates, twice, definitions={"root": Equation(root)}).model("root", [])
    assert model.outputs["twice"](0.0, [-10.0, 3.0], [], []) == 6.0
    assert "f[0] = 2.0 * x[1];" in written_outputs(model, "c")


WRITABLE = {"two bodies, springpot": fracid.rotary_pendulum(play_theta=0.01, springpot_alpha=1e-3, tilt_x=0.01),
            "presliding": fracid.rotary_pendulum(coulomb_theta=0.01, presliding_theta=0.01, presliding_alpha=0.01),
            "slow branches": fracid.model("capacitor", C_1=3.0, C_2=1.0), **own_models()}  # fmt: skip


@pytest.mark.few(11)
@pytest.mark.parametrize("name", WRITABLE)
def test_a_model_written_out_as_equations_and_read_again_is_the_same(name, tmp_path):
    model, rng = WRITABLE[name], np.random.default_rng(2)
    p, n = model.parameter_vector(), len(model.states)
    values = dict(zip(model.parameter_names, p, strict=True))
    text = toml_model(model, values, dict.fromkeys(model.order_names, 0.9), "run")
    units = {h: model.output_unit(h) for h in model.shown} | dict(model.input_units)
    signals = [f'{h} = {{ column = "{h}", unit = "{u}" }}' for h, u in units.items()]
    rest = np.outer(np.arange(0.0, 1.0, 0.05), np.eye(1 + len(units))[0])
    np.savetxt(tmp_path / "rig.csv", rest, delimiter=",", header=",".join(["time", *units]), comments="")
    text += "\n".join(["[fit]", 'initial_state = "held"', "[[recording]]", 'file = "rig.csv"', *signals, ""])
    again = project_from_text(text, tmp_path / "model.toml").problem.model
    assert (again.orders, again.angles) == (model.orders, model.angles)
    assert (again.input_rates, again.input_defaults) == (model.input_rates, model.input_defaults)
    assert [*again.relaxing.values()] == [*model.relaxing.values()]
    assert [again.states.index(s) for s in again.follows] == [model.states.index(s) for s in model.follows]
    for _ in range(10):
        x, u = rng.standard_normal(n), rng.standard_normal(max(1, len(model.inputs)))
        one, other = np.zeros(2 * n), np.zeros(2 * n)
        model.rhs(0.0, x, u, p, one)
        again.rhs(0.0, x, u, p, other)
        np.testing.assert_allclose(other, one, rtol=1e-11)
        for h in model.shown:
            seen = [x[f] if isinstance(f, int) else f(0.0, x, u, p) for f in (m.outputs[h] for m in (model, again))]
            np.testing.assert_allclose(*seen, rtol=1e-11)
    assert (again.scene is None) == (model.scene is None)
    if model.scene:
        values = dict.fromkeys(model.outputs, 0.3)
        assert again.scene.bodies == model.scene.bodies
        np.testing.assert_allclose(again.scene.at(values, p), model.scene.at(values, p), rtol=1e-11)


PROJECT = """
[model]
name = "linear-axis"
inputs = { force = "N" }
[model.equations]
position = "speed"
speed = { equals = "(force - b*speed)/m", order = "mu" }
[model.outputs]
position = { equals = "position", unit = "m" }
[model.parameters]
m = { start = 95.0, lower = 1.0, upper = 1e3, unit = "kg" }
b = { value = 3.0, unit = "N s/m" }
[model.orders]
mu = { start = 1.0, lower = 0.6, upper = 1.2 }
[[recording]]
file = "axis.csv"
force = { column = "force", unit = "N" }
position = { column = "position", unit = "m" }
"""


@pytest.fixture
def project(tmp_path):
    t = np.arange(0, 2, 0.01)
    columns = np.column_stack([t, np.sin(t), 0.01 * np.sin(t) ** 2])
    np.savetxt(tmp_path / "axis.csv", columns, delimiter=",", header="time,force,position", comments="")
    return lambda text: project_from_text(text, tmp_path / "axis.toml").problem


def test_a_fixed_value_needs_no_unit(project):
    fixed = project(PROJECT.replace("{ value = 3.0, unit", "{ value = 3.0 } # unit")).model.parameter("b")
    assert (fixed.value, fixed.unit) == (3.0, "")


def test_a_unit_that_nobody_knows_is_noted(tmp_path, project):
    project(PROJECT)
    noted = project_from_text(PROJECT.replace('"N s/m"', '"lb s"'), tmp_path / "axis.toml").notes
    assert "The unit of b has 'lb', which is unknown: equations with b are not checked" in " ".join(noted)


def test_a_project_of_equations_needs_no_trust(project):
    problem = project(PROJECT)
    assert (problem.model.name, problem.outputs, problem.model.inputs) == ("linear-axis", ("position",), ("force",))
    assert set(problem.names) >= {"mu", "m"}
    assert "b" not in problem.names
    assert {p.name: p.unit for p in problem.model.parameters} == {"m": "kg", "b": "N s/m"}


@pytest.mark.usefixtures("project")
@pytest.mark.parametrize(("row", "says"), [
    ('force = { column = "force", unit = "N" }', ""),
    ('force = { constant = 0, unit = "N" }', ""),
    ("", 'no column of it is force, which is taken as 0. Type force = { column = … } in its table, or force = { const'),
])  # fmt: skip
def test_an_input_of_the_projects_equations_that_no_column_has_is_told(tmp_path, row, says):
    text = PROJECT.replace('force = { column = "force", unit = "N" }', row)
    notes = " ".join(project_from_text(text, tmp_path / "axis.toml").notes)
    assert says in notes
    assert ("taken as 0" in notes) == bool(says)


def test_an_input_that_no_column_has_is_at_its_default_where_the_model_has_one(tmp_path, project):
    more = 'inputs = { force = "N", enable = "1" }\ninput_defaults = { enable = 1.0 }'
    text = PROJECT.replace('inputs = { force = "N" }', more).replace("(force -", "(enable*force -")
    np.testing.assert_array_equal(project(text).experiments[0].inputs[:, 1], 1.0)
    assert "no column of it" not in " ".join(project_from_text(text, tmp_path / "axis.toml").notes)
    with pytest.raises(fracid.InputError, match="unknown input in input_defaults of linear-axis 'on'"):
        project(text.replace("{ enable = 1.0 }", "{ on = 1.0 }"))


@pytest.mark.usefixtures("project")
@pytest.mark.parametrize(("block", "initial", "noted"), [
    ("1 - block", "", True),
    ("1 - block", "initial = { block = 0.0 }", False),
    ("-block", "", False),  # it rests at 0
    ("1", "", False),  # it rests nowhere
])  # fmt: skip
def test_a_hidden_state_that_does_not_rest_at_0_is_noted_with_what_to_type(tmp_path, block, initial, noted):
    text = PROJECT.replace("[model.outputs]", f'block = "{block}"\n[model.outputs]') + initial
    notes = " ".join(project_from_text(text, tmp_path / "axis.toml").notes)
    assert ("axis: no output shows block, whose start is taken as 0" in notes) == noted
    assert ('initial = { "block" = { start = 1, lower = 0, upper = 2 } }' in notes) == noted


@pytest.mark.parametrize(("begins", "noted"), [("", False), ("from = 0.8", True)])
@pytest.mark.parametrize("noise", [0.0, 1e-5])
def test_hysteresis_that_starts_at_rest_starts_at_0_and_in_motion_nobody_knows_where(tmp_path, begins, noted, noise):
    t = np.arange(0, 2, 0.01)
    position = 0.01 * np.sin(t) ** 2 + noise * np.random.default_rng(3).standard_normal(t.size)
    columns = np.column_stack([t, np.sin(t), position])
    np.savetxt(tmp_path / "axis.csv", columns, delimiter=",", header="time,force,position", comments="")
    held = 'block = { equals = "speed - 500*abs(speed)*block", unit = "m" }'
    text = PROJECT.replace("b*speed)/m", "b*speed - 50*block)/m").replace("[model.outputs]", f"{held}\n[model.outputs]")
    notes = " ".join(project_from_text(text + begins, tmp_path / "axis.toml").notes)
    assert ("axis: no output shows block, whose start is taken as 0" in notes) == noted


@pytest.mark.parametrize(("old", "new", "why"), [
    ("(force - b*speed)/m", "(force - b*sped)/m", "`sped` is no state, input or parameter; did you mean `speed`"),
    ('name = "linear-axis"', 'name = "rotary-pendulum"', "give the equations a name of their own"),
    ('name = "linear-axis"', 'name = "linear-axis"\nrig = "srv02-rotpen"', "rig means nothing for a model of eq"),
    ('position = "speed"', 'b = "speed"', "b stands in .* give each its own name"),
    ('position = "speed"', 'sin = "speed"', "'sin' cannot be a name in equations"),
    ('"mu" }', '"1 - nu mu" }', "expected a number, a name or"),
    ('"mu" }', '"mu", only = ["d"] }', "unknown parameter in .model.equations. speed 'd'"),
    ('"mu" }', '"mu", follows = "speedy" }', "'speedy': did you mean speed"),
    ('"mu" }', '"mu", forgets = "b/m" }', "unknown parameter in .model.equations. speed ''"),
    ('speed = { equals', 'speed = { equal', "equal is unknown; did you mean 'equals'"),
    ('position", unit', 'position", units', "units is unknown; did you mean 'unit'"),
    ('value = 3.0, unit', 'value = 3.0, units', "a fixed value is . value = ..., unit"),
    ('force = "N"', 'weight = "N"', "weight is a key of ..recording.. and cannot be an input or an output too"),
    ('position = { equals', 'time = { equals', "time is a key of ..recording.. and cannot be an input or an output"),
])  # fmt: skip
def test_what_is_wrong_in_the_file_is_said_with_its_place(project, old, new, why):
    with pytest.raises(fracid.InputError, match=r"axis.toml: (?s:.*)" + why):
        project(PROJECT.replace(old, new))


def test_an_output_in_a_unit_that_recordings_are_converted_from_is_refused(tmp_path):
    t = np.arange(0.0, 4.0, 0.01)
    np.savetxt(tmp_path / "swing.csv", np.c_[t, np.cos(9 * t)], delimiter=",", header="time,y", comments="")
    text = """
[model]
name = "spring"
[model.equations]
y = "v"
v = "-k*y"
[model.outputs]
y = { equals = "y", unit = "UNIT" }
[model.parameters]
k = { start = 80.0, lower = 1.0, upper = 200.0 }
[[recording]]
file = "swing.csv"
y = { column = "y", unit = "mm" }
"""
    with pytest.raises(fracid.InputError, match=r'has y in mm, and what is recorded becomes m: .*unit = "m" in SI'):
        project_from_text(text.replace("UNIT", "mm"), tmp_path / "spring.toml")
    assert project_from_text(text.replace("UNIT", "m"), tmp_path / "spring.toml").problem.names[0] == "k"
