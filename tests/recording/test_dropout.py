"""Encoders that drop out: an angle that stays at exactly one value while the rig goes on."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

import fracid
from fracid.problem.draft import draft_project
from fracid.recording import Recording
from fracid.recording.dropout import dropouts

SERVO = Path(__file__).parents[2] / "examples/real/xl330"
STEP = 2 * np.pi / 4096
TIME = np.arange(2500) / 250
SWING = np.where(TIME < 1, 1.0, np.exp(-0.2 * (TIME - 1)) * np.cos(6 * (TIME - 1)))
ARM = np.where(TIME < 1, 0.0, 0.2 * np.exp(-0.2 * (TIME - 1)) * np.sin(6 * (TIME - 1)))


def measured(motion, noise=9e-4, step=STEP):
    """As an encoder has it [rad]."""
    scatter = noise * np.random.default_rng(int(1e6 * abs(motion[-1]))).standard_normal(motion.size)
    return np.round((motion + scatter) / step) * step


def recording(alpha, theta=None):
    return Recording.of("twin", TIME, {"theta": measured(ARM) if theta is None else theta, "alpha": alpha})


def codes(alpha, theta=None):
    return [f.code for f in recording(alpha, theta).report.findings]


def test_an_angle_that_freezes_while_the_arm_moves_has_dropped_out_and_its_value_is_no_rest():
    alpha = measured(SWING)
    alpha[899] = alpha[900] + STEP
    alpha[900:] = alpha[900]
    report = recording(alpha).report
    finding = report.findings[0]
    assert finding.code == "dropout"
    assert str(finding).startswith("alpha: it stays at exactly ")
    assert " from 3.6 s on, where its noise was 0.05" in str(finding)
    assert "before and theta still moves: did its encoder drop out? " in str(finding)
    assert "type to = 3.6 in its [[recording]]." in str(finding)
    assert not report.signals[1].at_rest
    assert report.level == "usable"


@pytest.mark.parametrize(("begin", "typed"), [(1060, "mask = [[4.24, 4.636]]"), (300, "mask = [[1.2, 1.596]]")])
def test_a_jump_to_zero_and_back_is_a_dropout_and_no_release(begin, typed):
    alpha = measured(SWING)
    alpha[begin : begin + 100] = 0.0
    report = recording(alpha).report
    assert [f.code for f in report.findings] == ["dropout"]
    assert f"and jumps there and back: did its encoder drop out? Leave that part out: type {typed}" in str(
        report.findings[0]
    )
    assert report.release == pytest.approx(1.0, abs=0.02)


def test_all_stretches_of_a_clipped_sensor_are_found_and_left_out_at_once_and_its_tops_are_cut_off():
    slow = 1e-3 * np.random.default_rng(4).standard_normal(TIME.size) - np.cos(2 * TIME)
    clipped = recording(np.minimum(slow, 0.6))
    found = {f.code: str(f) for f in clipped.report.findings}
    mask = tomllib.loads(re.search(r"mask = \[\[.*?\]\]", found["dropout"])[0])["mask"]
    np.testing.assert_allclose(mask, [[k * np.pi + 1.107, k * np.pi + 2.034] for k in range(3)], atol=0.02)
    assert "its tops are cut off at 34.38°, 3 times" in found["saturated"]
    assert not {f.code for f in clipped.masked(mask).report.findings} & {*found, "jump", "clock-jump"}


def test_a_file_that_begins_with_zeros_is_cut_at_its_front():
    alpha = measured(SWING)
    alpha[:400] = 0.0
    assert "type from = 1.6 in its [[recording]]" in str(recording(alpha).report.findings[0])


@pytest.mark.parametrize("step", [2 * np.pi / 512, STEP, 2 * np.pi / 20000])
@pytest.mark.parametrize("noise", [0.0, 2e-4, 9e-4])
def test_a_coarse_encoder_that_comes_to_rest_has_not_dropped_out(step, noise):
    sticks = np.where(TIME < 6.0, SWING, SWING[1500])  # as dry friction holds it
    assert dropouts(TIME, {"alpha": measured(sticks, noise, step), "theta": measured(ARM, noise, step)},
                    {"alpha": "rad", "theta": "rad"}) == ()  # fmt: skip


def test_a_rig_that_shakes_only_while_it_moves_has_not_dropped_out():
    shaking = np.exp(-0.8 * TIME)
    alpha = shaking * (SWING + 9e-3 * np.random.default_rng(2).standard_normal(TIME.size))
    alpha[1800:] = alpha[1800]
    assert "dropout" not in codes(np.round(alpha / STEP) * STEP)


def test_init_leaves_a_dropout_out(tmp_path):
    alpha = measured(SWING)
    alpha[1500:] = alpha[1500]
    np.savez(tmp_path / "log.npz", time=TIME, theta=measured(ARM), alpha=alpha)
    draft = draft_project(tmp_path / "log.npz", folder=tmp_path)
    assert "\nto = 6.0" in draft.text or "\nto = 6 " in draft.text
    assert "zero" not in draft.columns["alpha"]
    assert "From 0 to 6 s alpha does not drop out: that part is fitted." in draft.notes


@pytest.mark.parametrize("digits", [17, 5])
def test_a_servo_that_sticks_in_a_resampled_log_drops_nothing_out(digits):
    """Between its encoder's counts a log that was resampled has lines: what scatters there is no noise."""
    recorded = np.sort(np.random.default_rng(1).uniform(0, 8, 1200))
    moves = np.clip(np.sin(2 * recorded), -0.8, 0.8) + 0.05 * np.sin(0.7 * recorded)
    stuck = np.where(recorded < 5, moves, moves[recorded < 5][-1])
    counts = np.round(stuck * 4096 / (2 * np.pi)) * 2 * np.pi / 4096
    t = np.arange(0, 8, 0.005)
    angle = np.round(np.interp(t, recorded, counts), digits)
    found = Recording.of("servo", t, {"angle": angle, "goal": np.sin(2 * t)}).report
    assert [s.counts_per_turn for s in found.signals if s.name == "angle"] == [4096]
    assert not {f.code for f in found.findings} & {"dropout", "saturated"}


@pytest.mark.parametrize("log", sorted(SERVO.glob("*.csv")), ids=lambda log: log.stem)
def test_no_log_of_the_servo_drops_out_or_has_its_tops_cut_off(log):
    found = fracid.load_recording(log).report
    assert not {f.code for f in found.findings} & {"dropout", "saturated"}
    assert [s.counts_per_turn for s in found.signals if s.name == "position"] == [4096]
