"""The period of a swing: what does not belong to the swing does not change it."""

import math
from importlib.resources import files

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import fracid
from fracid.signals import swing as its_module
from fracid.signals.swing import (
    FEWEST,
    common_period,
    final_value,
    half_swings,
    quickening,
    release_time,
    releases,
    swing_count,
    swing_period,
    swing_start,
)

TIME = np.arange(4000) / 200  # 20 s at 200 Hz
PERIOD = 150.0  # samples


def swing(decay=0.1, phase=0.0):
    return np.exp(-decay * TIME) * np.cos(2 * np.pi * TIME * 200 / PERIOD + phase)


SPOILT = {
    "as it is": lambda y, rng: y,
    "from the other side": lambda y, rng: -y,
    "in degrees": lambda y, rng: np.degrees(y),
    "off zero": lambda y, rng: y + 30.0,
    "with noise of a twentieth": lambda y, rng: y + 0.05 * rng.standard_normal(y.size),
    "by an encoder of 100 counts": lambda y, rng: np.round(y * 100 / (2 * np.pi)) * 2 * np.pi / 100,
    "with a drift of a tenth": lambda y, rng: y + 0.1 * TIME / TIME[-1],
    "held for as long before": lambda y, rng: np.concatenate([np.full(y.size, y[0]), y]),
    "held three times as long before": lambda y, rng: np.concatenate([np.full(3 * y.size, y[0]), y]),
    "at rest for as long after": lambda y, rng: np.concatenate([y * np.linspace(1, 0, y.size), np.zeros(y.size)]),
}


@pytest.mark.few(15)
@pytest.mark.parametrize("spoil", SPOILT.values(), ids=SPOILT)
@pytest.mark.parametrize("decay", [0.0, 0.1, 0.3])
def test_the_period_is_that_of_the_swing(spoil, decay):
    signal = spoil(swing(decay), np.random.default_rng(1))
    assert swing_period(signal) == pytest.approx(PERIOD, rel=0.02)


def wandering(seed):
    """A swing of 110 samples that goes over the top now and then, and drifts."""
    rng, n = np.random.default_rng(seed), 60_000
    turns = np.cumsum((rng.random(n) < 1 / 3000) * rng.choice([-1, 1], n))
    smooth = np.convolve(2 * np.pi * turns, np.ones(80) / 80, mode="same")
    return 0.6 * np.cos(2 * np.pi * np.arange(n) / 110) + smooth + 4 * np.arange(n) / n + 2e-3 * rng.standard_normal(n)


@pytest.mark.few(1)
@pytest.mark.parametrize("seed", range(4))
def test_a_signal_that_tumbles_and_drifts_has_the_period_of_its_swings(seed):
    """About its median it crosses a few times in the whole record."""
    signal = wandering(seed)
    assert swing_period(signal) == pytest.approx(110, rel=0.03)
    assert swing_period(np.round(signal * 4096 / (2 * np.pi))) == pytest.approx(110, rel=0.03)


@pytest.mark.parametrize("phase", np.linspace(0, 2 * np.pi, 7))
def test_the_period_does_not_depend_on_where_the_record_begins(phase):
    assert swing_period(swing(0.1, phase)) == pytest.approx(PERIOD, rel=0.02)


def test_the_period_of_a_noisy_twin_is_the_swings_and_not_the_noises():
    """The spectrum of its speed has its peak at 420 Hz, where the noise is."""
    twin = fracid.load_project(str(files("fracid") / "twins" / "reference-twin.toml")).problem.experiments[0]
    assert common_period(twin.measured) * twin.step == pytest.approx(0.62, abs=0.02)


@pytest.mark.parametrize("still", [np.zeros(100), np.exp(-TIME), TIME, np.cos(TIME[:100])], ids=range(4))
def test_what_does_not_swing_has_no_period(still):
    assert swing_period(still) == math.inf
    assert half_swings(still).size < FEWEST


@pytest.mark.parametrize("samples", [4.3, 6.0, 9.7, 20.0])
def test_few_samples_a_swing_are_enough(samples):
    assert swing_period(np.cos(2 * np.pi * np.arange(200) / samples + 0.3)) == pytest.approx(samples, abs=0.5)


def test_of_several_signals_the_one_that_swings_most_often_has_the_period():
    assert common_period(np.column_stack([5 * np.exp(-TIME), swing()])) == pytest.approx(PERIOD, rel=0.02)
    assert common_period(np.zeros((100, 2))) == math.inf


@settings(max_examples=8, deadline=None)
@given(st.floats(20, 400), st.floats(0, 6), st.floats(-100, 100), st.floats(1e-3, 1e3))
def test_swings_are_counted_and_their_period_is_found_at_any_scale_and_offset(period, phase, offset, scale):
    signal = offset + scale * np.cos(2 * np.pi * np.arange(4000) / period + phase)
    assert swing_period(signal) == pytest.approx(period, rel=0.05)
    assert swing_count(signal) == pytest.approx(4000 / period, abs=1.5)
    assert swing_start(signal) <= 0.3 * period + 1


@pytest.mark.parametrize(
    ("friction", "quicker"),
    [
        ({"coulomb_alpha": 1e-4}, 0.0),
        ({"b_alpha": 2e-5}, 0.0),
        ({"coulomb_alpha": 1e-4, "presliding_alpha": 0.05}, 0.063),
    ],
    ids=["sliding", "viscous", "presliding"],
)
@pytest.mark.parametrize("off", [0.0, 0.1], ids=["from where it hangs", "off by 6°"])
def test_small_swings_are_quicker_only_where_a_joint_gives_before_it_slides(friction, quicker, off):
    rig = fracid.rotary_pendulum("stepper-freeswing", **{"b_alpha": 1e-5, **friction})
    swing = fracid.simulate(rig, orders={"lambda": 1, "mu": 1}, initial={"alpha": 0.3}, step=2e-3, end=25.0)
    count = 2 * np.pi / 4096
    alpha = count * np.round(swing.states[:, 2] / count) + off
    assert quickening(alpha, 8 * count) == pytest.approx(quicker, abs=5e-3)


@pytest.mark.parametrize("swings", [4.1, 4.6, 5.3, 7.8])
@pytest.mark.parametrize("phase", [0.0, 0.7, 2.0, 4.0])
def test_the_middle_of_few_swings_is_that_of_whole_ones(swings, phase):
    """A pendulum still swings by 80° at the end of a short recording, and hangs at 3°: half a swing more tells 14°."""
    turns = np.linspace(0, swings, 1000)
    angle = 80.0 * np.exp(-0.05 * turns) * np.cos(2 * np.pi * turns + phase) + 3.0
    counts = np.radians(np.round(angle / 0.7) * 0.7)
    assert np.degrees(final_value(counts)) == pytest.approx(3.0, abs=3.0)


def _released(degrees, rate, held):
    """A pendulum, held and let go [rad]."""
    step = 1 / rate
    angle, speed, path = math.radians(degrees), 0.0, []
    for k in range(round((held + 8) * 1000)):
        path.append(angle)
        if k >= 1000 * held:
            speed += 1e-3 * (-36 * math.sin(angle) - 0.15 * speed)
            angle += 1e-3 * speed
    alpha = np.array(path)[:: 1000 // rate]
    return step * np.arange(len(alpha)), alpha


@pytest.mark.few(8)
@pytest.mark.parametrize("rate", [50, 250, 1000])
@pytest.mark.parametrize(("degrees", "noise"), [(10, 0.1), (30, 0.8), (75, 0.8), (75, 2.0), (120, 2.0)])
def test_a_release_is_found_in_noise(degrees, noise, rate):
    for seed in range(4):
        rng = np.random.default_rng(seed)
        held = round(rng.uniform(0.6, 2.5), 1)
        t, alpha = _released(degrees, rate, held)
        release, reason = release_time(t, alpha + math.radians(noise) * rng.standard_normal(len(alpha)))
        assert release == pytest.approx(held, abs=0.12), reason


@pytest.mark.parametrize("rate", [50, 250, 1000])
@pytest.mark.parametrize("noise", [0.1, 0.8, 2.0])
def test_noise_makes_no_release_of_a_swing_that_nobody_held(noise, rate):
    t = np.arange(0, 10, 1 / rate)
    for seed in range(6):
        rng = np.random.default_rng(seed)
        size, phase = rng.uniform(10, 120), rng.uniform(0, 2 * np.pi)
        swing = size * np.cos(6 * t + phase)
        for degrees in (swing, swing * np.exp(-t / 4), swing + 200 * t, size * np.sin(phase + t * (2 + t)), 0 * t):
            x = np.radians(degrees + noise * rng.standard_normal(t.size))
            assert release_time(t, x)[0] is None


def test_the_noise_of_a_long_rest_is_no_swing(monkeypatch):
    found, crossing = [], its_module._crossing
    monkeypatch.setattr(its_module, "_crossing", lambda *where: found.append(where) or crossing(*where))
    t = 0.01 * np.arange(20_000)
    noise = 1e-3 * np.random.default_rng(1).standard_normal(t.size)
    quickening(0.3 * np.exp(-0.2 * t) * np.cos(6 * t) + noise, 0.0)
    assert len(found) < 200


@pytest.mark.parametrize("rate", [30, 200])
@pytest.mark.parametrize("second", [-0.9, 0.4, 0.9])
@pytest.mark.parametrize("swings", np.linspace(6, 7, 6))
def test_a_free_swing_ends_before_a_hand_lifts_it_at_any_phase_through_its_rest(swings, second, rate):
    t, s = np.arange(0, swings, 1 / rate), np.linspace(0, 1, int(1.5 * rate))
    free = 0.7 * np.exp(-0.1 * t) * np.cos(2 * np.pi * t)
    lift, held = free[-1] + (second - free[-1]) * s**2 * (3 - 2 * s), np.ones(rate)
    signal = np.concatenate([0.7 * held, free, lift, second * held, second / 0.7 * free])
    signal = signal + 2e-3 * np.random.default_rng(1).standard_normal(len(signal))
    (start, stop), (again, _) = releases(np.arange(len(signal)) / rate, signal)
    assert [start, again] == pytest.approx([1.0, swings + 3.5], abs=0.1)
    assert swings + 1 - 0.85 < stop <= swings + 1  # one and a half half-swings are lost at most
