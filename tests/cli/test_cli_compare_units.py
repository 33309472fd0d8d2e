"""``fracid compare`` of a rig whose outputs have different units: a cart with a pendulum, in metres and radians."""

import csv
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import fracid
from fracid.cli.app import main
from fracid.cli.comparison import _errors, _ladder
from fracid.selection.amplitude import Drift, Window
from fracid.selection.comparison_records import Comparison, Row, Score
from fracid.workflows.records import csv_text
from fracid.workflows.redrawing import redraw

MODEL = """
import math

from fracid.models.base import Model, Parameter
from fracid.models.friction import COULOMB, VISCOUS
from fracid.models.joints import sliding


def rhs(t, x, u, p, out):
    M, ml, J, g, b_cart, b_alpha, coulomb_cart = p[0], p[1], p[2], p[3], p[4], p[5], p[6]
    sin, cos = math.sin(x[2]), math.cos(x[2])
    force = u[0] - b_cart * x[1] - sliding(x[1], coulomb_cart, 0.0, 1.0, 0.01) + ml * sin * x[3] * x[3]
    torque = -ml * g * sin - b_alpha * x[3]
    det = M * J - ml * ml * cos * cos
    out[0], out[2] = x[1], x[3]
    out[1] = (J * force - ml * cos * torque) / det
    out[3] = (M * torque - ml * cos * force) / det


def cart_pole(zero="hanging", **values):
    return Model(
        name="cart-pole", rhs=rhs, states=("s", "D^lambda s", "alpha", "D^mu alpha"),
        orders=("lambda", "lambda", "mu", "mu"), outputs={"s": 0, "alpha": 2}, inputs=("force",),
        parameters=(
            Parameter("M", "kg", 0.8, "mass of cart and pendulum", lower=1e-9),
            Parameter("ml", "kg m", 0.07, "mass of the pendulum times its centre's distance", lower=1e-9),
            Parameter("J", "kg m^2", 0.03, "inertia about the pivot", lower=1e-9),
            Parameter("g", "m/s^2", 9.81, "gravity"),
            Parameter("b_cart", "N s/m", 5.0, "viscous friction of the rail", friction=VISCOUS.at("s")),
            Parameter("b_alpha", "N m s/rad", 2e-3, "viscous friction of the pivot", friction=VISCOUS.at("alpha")),
            Parameter("coulomb_cart", "N", 0.0, "dry friction of the rail", friction=COULOMB.at("s")),
        ),
        zero=zero, source="a test", angles=("alpha",), pendulum="alpha", input_units={"force": "N"},
    ).with_parameters(**values)
"""

PROJECT = """
[model]
name = "my_cart.py:cart_pole"
[model.parameters]
M = { start = 0.7, lower = 0.1, upper = 5 }
J = { start = 0.04, lower = 0.01, upper = 0.1 }
b_cart = { start = 2, lower = 0, upper = 20 }
b_alpha = { start = 1e-3, lower = 0, upper = 0.1 }
[model.orders]
lambda = 1.0
mu = { start = 1.0, lower = 0.6, upper = 1.2 }
[fit]
substeps = 1
weights = "noise"
"""
RECORDING = """
[[recording]]
name = "{name}"
file = "{name}.csv"
alpha = {{ column = "alpha [deg]" }}
s = {{ column = "s [m]" }}
use = "{use}"
"""
TRUTH = {"M": 0.8, "J": 0.03, "b_cart": 5.0, "b_alpha": 2e-3, "coulomb_cart": 0.1}
NOISE = {"s": 2e-5, "alpha": 5e-4}
"""[m], [rad]"""


def released(angle, seed):
    """A release by SciPy's solver, from Lagrange's equations as a linear system: s [m] and α [rad] every 10 ms."""
    M, J, b_cart, b_alpha, dry, ml, g = *TRUTH.values(), 0.07, 9.81

    def motion(_, state):
        _, v, a, w = state
        mass = np.array([[M, ml * math.cos(a)], [ml * math.cos(a), J]])
        pull = [ml * math.sin(a) * w**2 - b_cart * v - dry * math.tanh(v / 0.01), -ml * g * math.sin(a) - b_alpha * w]
        there, turned = np.linalg.solve(mass, pull)
        return [v, there, w, turned]

    time = np.arange(801) / 100
    y = solve_ivp(motion, (0, 8), [0, 0, angle, 0], "DOP853", time, rtol=1e-10, atol=1e-12).y[[0, 2]].T
    return time, y + np.random.default_rng(seed).standard_normal(y.shape) * [*NOISE.values()]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The comparison of a release, another held out, with its files."""
    folder = tmp_path_factory.mktemp("cart")
    (folder / "my_cart.py").write_text(MODEL, encoding="utf-8")
    text = PROJECT
    for seed, (name, angle, use) in enumerate((("high", 1.0, "fit"), ("low", 0.7, "validate"))):
        time, y = released(angle, seed)
        columns = np.column_stack([time, y[:, 0], np.degrees(y[:, 1])])
        np.savetxt(folder / f"{name}.csv", columns, header="time [s],s [m],alpha [deg]", comments="", delimiter=",")
        text += RECORDING.format(name=name, use=use)
    (folder / "cart.toml").write_text(text, encoding="utf-8")
    with pytest.raises(SystemExit) as stop:
        main(["compare", str(folder / "cart.toml"), "--trust", "--out", str(folder / "run"), "--amplitude"])
    assert not stop.value.code
    return folder


@pytest.mark.broad
def test_a_cart_with_a_pendulum_is_compared_and_what_was_simulated_comes_back(made):
    record = json.loads((made / "run" / "compare.json").read_text(encoding="utf-8"))
    assert record["units"] == {"s": "m", "alpha": "rad"}
    rows = {s["name"]: s for s in record["structures"]}
    assert [*rows] == [f"{friction}, orders {orders}" for friction in ("viscous", "viscous + Coulomb")
                       for orders in ("1", "free")]  # fmt: skip
    best = rows["viscous + Coulomb, orders 1"]
    for name, value in TRUTH.items():
        assert best["values"][name] == pytest.approx(value, rel=0.03), name
    for output, sd in NOISE.items():
        assert best["held_out"]["low"]["rmse"][output] == pytest.approx(sd, rel=0.15)
    assert record["claim"] == "integer"


@pytest.mark.broad
def test_its_table_has_angles_in_degrees_and_positions_in_metres(made):
    with (made / "run" / "compare.csv").open(encoding="utf-8") as file:
        lines = list(csv.DictReader(file))
    assert len(lines) == 4 * 2 * 2
    for line in lines:
        metres = line["output"] == "s"
        assert (line["unit"], bool(line["rmse"]), bool(line["itae"])) == (
            ("m", True, True) if metres else ("", False, False)
        )
        assert (bool(line["rmse_deg"]), bool(line["itae_rad_s2"])) == (not metres, not metres)


@pytest.mark.broad
def test_its_figures_and_its_amplitudes_are_in_the_units_of_their_outputs(made):
    record = json.loads((made / "run" / "compare.json").read_text(encoding="utf-8"))
    labels = [axes.get_ylabel() for axes in Comparison.of_json(record).plot().axes]
    assert [label.split("[")[-1] for label in labels if label] == ["m]", "°]"]
    assert redraw(made / "run", out=made / "again")
    (test, *_) = record["amplitude"].values()
    assert {w["units"]["mu"] for w in test["windows"]} == {"rad"}


# --- any units ------------------------------------------------------------------------------------------------


def compared(units):
    """Two rows of made-up numbers for outputs in these units."""
    of = dict.fromkeys(units, 0.5)
    scores = {"one": Score(of, dict.fromkeys(units, 90.0), dict.fromkeys(units, 0.25))}
    rows = tuple(
        Row("viscous", free, f"viscous, orders {'free' if free else '1'}", free, 1.0, 3, 0.0, {}, {}, (), scores,
            scores, "") for free in (False, True)
    )  # fmt: skip
    return Comparison(rows, "", (), tuple(units), 9.0, False, "rmse", 1, 1, units=units)


def test_the_arrow_is_explained_where_a_row_has_it():
    with_paper = compared({"a": "rad"})
    assert next(iter(_ladder(with_paper))).endswith("; ← the paper's")
    without = replace(with_paper, rows=tuple(replace(row, paper=False) for row in with_paper.rows))
    assert "paper" not in str(_ladder(without))


UNITS = [{"a": "rad"}, {"f": "N"}, {"s": "m", "alpha": "rad"}, {"alpha": "rad", "v": "V"},
         {"f": "N", "v": "V", "r": "1"}, {"w": "rad/s", "a": "rad"}]  # fmt: skip


@pytest.mark.few(2)
@pytest.mark.parametrize("units", UNITS, ids=lambda units: ", ".join(units.values()))
def test_table_terminal_card_figure_and_json_take_outputs_of_any_units(units):
    found = compared(units)
    first, *lines = csv.reader(csv_text(found.lines()).splitlines())
    assert {len(line) for line in lines} == {len(first)}
    table = list(csv.DictReader(csv_text(found.lines()).splitlines()))
    for line in table:
        own = units[line["output"]]
        assert line["rmse_deg" if own == "rad" else "rmse"] == repr(math.degrees(0.5) if own == "rad" else 0.5)
    cells = _errors(found, [*found.rows[0].in_sample.values()])
    assert [*cells] == [*units]
    assert "28.6° 90.0 %" in cells.values() if "rad" in units.values() else "0.5 N 90.0 %" in cells.values()
    shown = [f"{name} {'29°' if unit == 'rad' else '29°/s' if unit == 'rad/s' else f'0.5 {unit}'.removesuffix(' 1')}"
             for name, unit in units.items()]  # fmt: skip
    assert f"held out {', '.join(shown)}" in str(found)
    assert len(found.plot().axes) == 2 * len(units)
    again = Comparison.of_json(json.loads(json.dumps(found.to_json() | {"data_sha256": {}})))
    assert again.lines() == found.lines()


def test_an_order_drifts_with_the_amplitude_of_its_output_in_the_output_s_unit():
    drift = Drift("lambda", "one", (0.02, 0.004), (0.99, 0.95), (1e-3, 1e-3), 1e-9, 1.0, -0.04, "m")
    assert "from 0.99 at 0.02 m to 0.95 at 0.004 m" in drift.sentence
    window = Window("one", 0.0, 1.0, False, {"lambda": 0.02}, {"lambda": 0.99}, {"lambda": 1e-3}, {"lambda": "m"})
    figure = fracid.AmplitudeTest((window,), (drift,)).plot()
    assert figure.axes[0].get_xlabel() == "mean amplitude of the swing [m]"
    assert max(figure.axes[0].lines[0].get_xdata()) == 0.02
