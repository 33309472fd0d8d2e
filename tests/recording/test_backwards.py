"""A sensor that counts backwards: the arm seems to throw its pendulum the wrong way."""

import numpy as np
import pytest

import fracid
from fracid.recording import Recording

STEP = 0.01


@pytest.fixture(scope="module")
def swung():
    """θ and α of an arm that is pushed to and fro, with noise, shape (n_samples,)."""
    push = 3 * np.sign(np.sin(np.arange(1001) / 70))[:, None]
    run = fracid.simulate(fracid.rotary_pendulum("qube-servo2"), orders={"lambda": 1, "mu": 1}, initial={"alpha": 0.2},
                          step=STEP, end=10.0, inputs=push)  # fmt: skip
    noise = 1e-3 * np.random.default_rng(3).standard_normal((2, len(run.time)))
    return run.states[:, 0] + noise[0], run.states[:, 2] + noise[1]


def codes(theta, alpha):
    t = STEP * np.arange(len(theta))
    return [f.code for f in Recording.of("rig", t, {"theta": theta, "alpha": alpha}).report.findings]


@pytest.mark.parametrize("turned", ["theta", "alpha"])
def test_an_angle_that_is_counted_the_other_way_is_said(swung, turned):
    theta, alpha = swung
    assert "counted-backwards" not in codes(theta, alpha)
    theta, alpha = (-theta, alpha) if turned == "theta" else (theta, -alpha)
    assert "counted-backwards" in codes(theta, alpha)


def test_both_angles_counted_the_other_way_are_the_same_rig_seen_from_below(swung):
    assert "counted-backwards" not in codes(-swung[0], -swung[1])


def test_a_pendulum_whose_arm_hardly_moves_does_not_say_which_way_it_is_counted(swung):
    alpha = swung[1]
    assert "counted-backwards" not in codes(1e-3 * np.random.default_rng(4).standard_normal(len(alpha)), alpha)


def test_an_encoder_that_reads_0_throughout_stands_still_and_does_not_count_backwards(swung):
    found = codes(swung[0], np.zeros(len(swung[1])))
    assert "still" in found
    assert "counted-backwards" not in found


@pytest.mark.broad
def test_init_says_it_and_the_sign_that_it_names_mends_it(swung, tmp_path):
    table = np.column_stack([STEP * np.arange(len(swung[0])), *swung])
    table[:, 2] *= -1
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header="t [s],theta [rad],alpha [rad]", comments="")
    draft = fracid.draft_project(tmp_path / "log.csv", folder=tmp_path)
    assert any("--column alpha=COLUMN,sign=-1" in note for note in draft.notes)
    columns = {"theta": {"column": 1, "unit": "rad"}, "alpha": {"column": 2, "unit": "rad", "sign": -1}}
    mended = fracid.draft_project(tmp_path / "log.csv", columns, folder=tmp_path)
    assert not any("throws the pendulum" in note for note in mended.notes)
