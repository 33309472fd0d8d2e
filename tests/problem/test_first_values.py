"""Constants are found in the size of the recording's rig, however far that is from the library's."""

import math

import numpy as np
import pytest

import fracid
from fracid.problem.first_values import first_values
from fracid.problem.model_draft import draft_of_model

T = np.arange(0, 20, 0.01)


def wave(degree=0):
    """Four sines, or their derivative."""
    return sum(
        w * f**degree * np.sin(f * T + degree * np.pi / 2)
        for f, w in ((2.0, 0.3), (5.0, 0.1), (9.0, 0.03), (13.0, 0.02))
    )


def oscillator():
    x, v, a = map(wave, range(3))
    return {"displacement": x, "force": 2.0 * a + 1.5 * v + 60.0 * x + 900.0 * x**3}


def joint():
    x, v, a = map(wave, range(3))
    return {"angle": x, "torque": 8e-3 * a + 0.03 * v}


def two_mass():
    load, rates = wave(), [*map(wave, range(1, 5))]
    shaft = [3e-3 * rates[n + 1] + 2e-3 * rates[n] for n in range(3)]
    rate, acceleration = (rates[n] + shaft[n + 1] / 2.0 for n in range(2))
    return {"motor": load + shaft[0] / 2.0, "load": load, "torque": 6e-4 * acceleration + 4e-3 * rate + shaft[0]}


def tanks():
    upper, lower = 4.0 + 3 * wave(), 3.0 - 2 * wave()
    return {"upper": upper, "lower": lower, "pump": 5 * (3 * wave(1) + 0.6 * np.sqrt(upper))}


def relaxation():
    half = 2 / math.sqrt(math.pi) * (np.sqrt(T) - np.sqrt(np.maximum(T - 1, 0.0)))
    return {"stretch": np.minimum(T, 1.0), "force": 150.0 * np.minimum(T, 1.0) + 80.0 * half}


def capacitor(leak=0.0):
    """Of 20 F with 0.1 Ohm."""
    current, v = 1.0 * (T > 1) * (T < 6) - 0.5 * (T > 9) * (T < 14), np.full(T.size, 0.3)
    for k in range(1, T.size):
        v[k] = v[k - 1] + 0.01 / 20.0 * (current[k - 1] - leak * v[k - 1])
    return {"voltage": v + 0.1 * current, "current": current}


@pytest.mark.parametrize("size", [1e-5, 1e-3, 1e3, 1e5])
@pytest.mark.parametrize(("name", "signals", "drive", "free", "powers"), [
    ("oscillator", oscillator, "force", ["m", "k", "k3", "b_displacement"], [1, 1, 1, 1]),
    ("joint", joint, "torque", ["J", "b_angle"], [1, 1]),
    ("two-mass", two_mass, "torque", ["J_motor", "J_load", "k", "d", "b_motor", "b_load"], [1, 1, 1, 1, 1, 1]),
    ("tanks", tanks, "pump", ["k_pump", "k_upper", "k_lower"], [-1, 0, 0]),
    ("relaxation", relaxation, "force", ["k", "c"], [1, 1]),
    ("capacitor", capacitor, "current", ["C0", "R"], [1, -1]),
])  # fmt: skip
def test_the_same_rig_in_another_size_has_the_same_constants_in_that_size(name, signals, drive, free, powers, size):
    one = signals()
    other = {**one, drive: size * one[drive]}
    here, there = (first_values(fracid.model(name), 0.01, s, free, starts={"v": 0.3}) for s in (one, other))
    for n, power in zip(free, powers, strict=True):
        none = 1e-3 * there.reach[n]  # beside which a dashpot that is not there may be anything
        assert there.values[n] == pytest.approx(here.values[n] * size**power, rel=0.1, abs=none), n
    assert there.explained == pytest.approx(here.explained, abs=0.01)


@pytest.mark.parametrize(("name", "signals", "free", "absent"), [
    ("oscillator", oscillator, ["m", "k", "k3", "b_displacement"], ["coulomb_displacement"]),
    ("two-mass", two_mass, ["J_motor", "J_load", "k", "d", "b_motor", "b_load"], ["coulomb_motor", "coulomb_load"]),
])  # fmt: skip
def test_no_term_is_added_for_that_the_rig_is_off_the_librarys_size(name, signals, free, absent):
    assert {*first_values(fracid.model(name), 0.01, signals(), free, absent).values} == {*free}


def test_a_drive_that_has_made_turns_is_as_one_about_0():
    free, here, turns = ["J_motor", "J_load", "k", "d", "b_motor", "b_load"], two_mass(), 40.0
    there = here | {n: here[n] + turns for n in ("motor", "load")}
    one, other = (first_values(fracid.model("two-mass"), 0.01, s, free).values for s in (here, there))
    assert other == {n: pytest.approx(v, rel=1e-3, abs=1e-5) for n, v in one.items()}


@pytest.mark.broad
def test_a_capacitor_that_discharges_itself_is_found_though_without_a_leak_an_endless_one_fits_best():
    signals = capacitor(leak=3.0)
    signals["current"] = 1e-4 * signals["current"]
    found = first_values(fracid.model("capacitor"), 0.01, signals, ["C0", "R"], ["C1", "leak"], {"v": 0.3})
    for n, true in {"C0": 2e-3, "R": 1e3, "leak": 3e-4}.items():
        assert 0.5 < found.values[n] / true < 2.0, n


def test_no_constant_is_fixed_for_that_the_librarys_is_far_too_large():
    signals = capacitor()
    signals["current"] = 1e-9 * signals["current"]
    assert "C0" in first_values(fracid.model("capacitor"), 0.01, signals, ["C0", "R"], starts={"v": 0.3}).values


def test_strong_memory_is_no_mass_of_another_size():
    """An oscillator of order 0.7, whose acceleration is far from the second derivative."""
    x, half, whole = (wave(degree) for degree in (0, 0.7, 1.4))
    signals = {"displacement": x, "force": 2.0 * whole + 1.5 * half + 60.0 * x + 900.0 * x**3}
    found = first_values(fracid.model("oscillator"), 0.01, signals, ["m", "k", "k3", "b_displacement"])
    assert found.explained > 0.9
    for n, true in {"m": 2.0, "k": 60.0, "k3": 900.0}.items():
        assert 0.4 < found.values[n] / true < 2.5, n


@pytest.mark.broad
def test_a_stiff_strip_is_drafted_and_fitted_as_what_it_is(tmp_path, without_rivals):
    t, order = np.arange(0, 60, 0.1), 0.3
    ramps = [(0.0, 0.5, 0.04), (20.0, 22.0, 5e-3), (40.0, 41.0, -0.01)]

    def moved(power):
        return sum(rate * (np.maximum(t - a, 0) ** power - np.maximum(t - b, 0) ** power) for a, b, rate in ramps)

    stretch, pull = moved(1.0), moved(1 - order) / math.gamma(2 - order)
    force = 1.2e5 * stretch + 0.8e5 * pull
    force += 2e-3 * np.ptp(force) * np.random.default_rng(1).standard_normal(t.size)
    np.savez(tmp_path / "strip.npz", time=t, stretch=stretch, force=force)
    (tmp_path / "strip.toml").write_text(draft_of_model("relaxation", tmp_path / "strip.npz", folder=tmp_path).text)
    fit = fracid.identify(fracid.load_project(tmp_path / "strip.toml"))
    printed = {**fit.parameters, **fit.orders}
    for n, true in {"k": 1.2e5, "c": 0.8e5, "nu": order}.items():
        low, high = printed[n].interval95
        assert abs(true - printed[n].value) < 0.65 * (high - low), n
    assert fit.opened_bounds == ()
