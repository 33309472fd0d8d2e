"""Twins of rigs with each element of a joint, made by an independent integrator, are identified."""

import numpy as np
import pytest

import fracid
from fracid.estimation.covariance import uncertainty
from fracid.estimation.horizons import Watch, growing, refined
from fracid.problem import Experiment, Free, Problem
from scripts import module_of

COUNT = 2 * np.pi / 4096
STEP, END = 4e-3, 15.0
ORDERS = {"lambda": Free(1.0, 0.8, 1.2), "mu": Free(1.0, 0.8, 1.2)}


@pytest.fixture(scope="module")
def rigs():
    """benchmarks/independent_rigs.py, which imports nothing of fracid."""
    return module_of("benchmarks/independent_rigs.py", "independent_rigs")


BASE = {"b_theta": 0.02, "b_alpha": 2e-4, "coulomb_theta": 0.01, "coulomb_alpha": 2.5e-4, "cable": 0.0}
LUGRE = {"stiction_theta": 5e-3, "stiction_alpha": 1e-4, "presliding_theta": 5e-3, "presliding_alpha": 0.03}
ELEMENTS = {
    "drag": {"drag_theta": 2e-3, "drag_alpha": 2e-5},
    "cable": {"cable": 0.05},
    "Dahl": {"presliding_theta": 5e-3, "presliding_alpha": 0.03},
    "LuGre": LUGRE | {"bristle_damping_alpha": 3e-4, "stribeck_theta": 0.05, "stribeck_alpha": 0.6},
    "elastic arm": {"hub_inertia": 2.5e-3, "shaft_stiffness": 20.0, "shaft_damping": 5e-3},
    "tilted axis": {"lean_x": 0.05, "lean_y": 0.03},
    "springpot of the pendulum": {"springpot_alpha": 2e-3},
    "springpot of the arm": {"springpot_theta": 0.02},
}
NAMES = {
    "cable": "cable_stiffness", "bristle_damping_theta": "presliding_damping_theta",
    "bristle_damping_alpha": "presliding_damping_alpha", "shaft_stiffness": "arm_stiffness",
    "shaft_damping": "arm_damping", "lean_x": "tilt_x", "lean_y": "tilt_y", "stribeck_theta": "stribeck_speed_theta",
    "stribeck_alpha": "stribeck_speed_alpha",
}  # fmt: skip
"""What the independent rigs call otherwise."""


def simulated(rigs, constants):
    """All states from a release at 70°, every STEP."""
    bristles = "presliding_alpha" in constants
    rig = rigs.Rig(**BASE | constants, friction=rigs.BRISTLE if bristles else rigs.TANH)
    x0 = np.zeros(len(rigs.STATES))
    x0[2] = np.radians(70)
    if any("springpot" in name for name in constants):
        return rigs.fractional(rig, x0, step=1e-3, end=END)[:: round(STEP / 1e-3)]
    return rigs.ordinary(rig, x0, step=2e-5, end=END, kept=round(STEP / 2e-5))


def as_free(value, off=1.2):
    """From a fifth off the truth."""
    return Free(off * value, 0.05 * value, 20 * value)


@pytest.mark.broad
@pytest.mark.parametrize("element", ELEMENTS)
def test_every_constant_of_a_twin_lies_in_its_interval_and_the_orders_are_1(rigs, element):
    constants = ELEMENTS[element]
    states = simulated(rigs, constants)
    arm = 4 if "hub_inertia" in constants else 0  # there the encoder sees the hub
    rng = np.random.default_rng(1)
    y = states[:, [arm, 2]] + COUNT * rng.uniform(-0.5, 0.5, (len(states), 2))
    recording = Experiment(element, STEP, COUNT * np.round(y / COUNT), np.zeros((1, 1)),
                           initial={"theta": 0.0, "alpha": np.radians(70)})  # fmt: skip
    truth = {NAMES.get(n, n): v for n, v in (BASE | constants).items() if v > 0}
    off = 1.02 if arm else 1.2  # further off an elastic arm has other minima, of nearly the same cost
    free = {n: as_free(v, off) for n, v in truth.items()}
    for name in constants:
        if "springpot" in name:
            order = name.replace("springpot", "springpot_order")
            truth[order], free[order] = 0.5, Free(0.6, 0.1, 0.9)
    inertias = {n: as_free(fracid.rotary_pendulum().parameter(n).value, off) for n in ("C1", "C3", "C6", "J_theta")}
    problem = Problem(fracid.rotary_pendulum(), (recording,), ORDERS, free | inertias, initial_state="held",
                      substeps=4 if arm else 2)  # fmt: skip
    near = problem.start if arm else growing(problem, problem.start, Watch()).best.point
    found = refined(problem, near, Watch(), tolerance=1e-8).best

    rounding = COUNT * np.sqrt(1 / 12 + 1 / 12)
    assert max(problem.levels(found.point).values()) < 1.15 * rounding
    precision = uncertainty(problem, found.point)
    truth |= {n: fracid.rotary_pendulum().parameter(n).value for n in inertias} | {"lambda": 1.0, "mu": 1.0}
    for i, name in enumerate(problem.names):
        low, high = precision.interval(found.point, i)
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        assert abs(truth[name] - middle) < 1.6 * half, (name, truth[name], low, high)  # of a dozen at once
        if name in ORDERS:
            assert half < 0.03
