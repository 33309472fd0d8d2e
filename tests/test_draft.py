"""A project drafted from a recording runs as it is, and says what was guessed."""

import numpy as np
import pytest
from typer.testing import CliRunner

import fracid
from fracid.cli import app
from fracid.draft import draft_project, guess_columns
from fracid.errors import InputError
from fracid.recording import Recording

TIME = np.arange(0, 10, 0.005)
SWING = np.where(TIME < 1, 0.9, 0.9 * np.exp(-(TIME - 1)) * np.cos(6.73 * (TIME - 1)))
ARM = 0.15 * SWING


def counted(x, step):
    return np.round(x / step) * step


def columns(**signals):
    return guess_columns(Recording.of("log", TIME, signals))[0]


def written(folder, **signals):
    path = folder / "swing.csv"
    table = np.column_stack([TIME, *signals.values()])
    np.savetxt(path, table, delimiter=",", header=",".join(["time", *signals]), comments="", fmt="%.9g")
    return path


@pytest.mark.parametrize(
    ("names", "alpha", "theta"),
    [
        (("theta", "alpha"), "alpha", "theta"),
        (("alpha", "theta"), "alpha", "theta"),
        (("joint0/position", "joint1/position"), "joint1/position", "joint0/position"),
        (("arm_angle", "pend_angle"), "pend_angle", "arm_angle"),
        (("motor", "pole"), "pole", "motor"),
    ],
)
def test_columns_are_known_by_their_names(names, alpha, theta):
    found = columns(**dict.fromkeys(names, SWING) | {f"{names[1]}_velocity": SWING})
    assert (found["alpha"]["column"], found["theta"]["column"]) == (alpha, theta)
    assert "voltage" not in found


def test_without_names_the_pendulum_is_who_swings_most():
    found = columns(**{"column 1": ARM, "column 2": SWING})
    assert (found["alpha"]["column"], found["theta"]["column"]) == (2, 1)


@pytest.mark.parametrize(
    ("factor", "step", "expected"),
    [
        (1.0, 2 * np.pi / 4096, {"unit": "rad"}),
        (180 / np.pi, 360 / 2000, {"unit": "deg"}),
        (4096 / (2 * np.pi), 1.0, {"unit": "counts", "counts_per_turn": 4096}),
        (180 / np.pi, 1e-6, {"unit": "deg"}),
        (1.0, 1e-6, {"unit": "rad"}),
    ],
)
def test_the_unit_is_told_by_the_encoders_step_or_by_the_size(factor, step, expected):
    assert columns(alpha=counted(factor * SWING, step))["alpha"] == {"column": "alpha"} | expected


def test_a_recording_in_which_nothing_moves_is_refused():
    with pytest.raises(InputError, match=r"has no column that could be an angle and moves; name it: --column alpha="):
        columns(alpha=np.zeros(len(TIME)))


@pytest.mark.parametrize(
    ("signals", "free", "outputs"),
    [
        ({"theta": ARM, "alpha": SWING}, {"lambda", "mu", "C1", "C3", "C6", "J_theta", "b_theta", "coulomb_alpha"}, 2),
        ({"theta": 1e-4 * ARM, "alpha": SWING}, {"mu", "C1", "b_alpha", "coulomb_alpha"}, 1),
        ({"alpha": SWING}, {"mu", "C1", "b_alpha", "coulomb_alpha"}, 1),
        ({"theta": ARM, "alpha": SWING, "voltage": np.sign(ARM)}, {"torque_per_volt", "lambda", "mu"}, 2),
    ],
)
def test_what_is_free_is_what_the_recording_can_tell(tmp_path, signals, free, outputs):
    draft = draft_project(written(tmp_path, **signals), folder=tmp_path)
    (tmp_path / "rig.toml").write_text(draft.text, encoding="utf-8")
    problem = fracid.load_project(tmp_path / "rig.toml").problem
    assert free <= set(problem.names)
    assert len(problem.outputs) == outputs
    assert ("lambda" in problem.names) == (outputs == 2)
    assert "C4" not in problem.names


def test_small_swings_leave_the_terms_of_large_ones_alone(tmp_path):
    draft = draft_project(written(tmp_path, theta=0.1 * ARM, alpha=0.1 * SWING), folder=tmp_path)
    assert "# C6 stays" in draft.text
    assert "\n# drag_alpha" in draft.text


def test_the_inertia_of_a_pendulum_on_a_still_arm_begins_at_its_period(tmp_path):
    draft = draft_project(written(tmp_path, alpha=SWING), folder=tmp_path)
    (tmp_path / "rig.toml").write_text(draft.text, encoding="utf-8")
    problem = fracid.load_project(tmp_path / "rig.toml").problem
    C4 = problem.model.parameter("C4").value
    assert problem.start[problem.names.index("C1")] == pytest.approx(C4 / 6.73**2, rel=0.05)


@pytest.mark.parametrize(
    ("rest", "zero"), [(0.0, None), (np.pi, 3.141592654), (-2 * np.pi, -6.283185307), (1.0, "rest")]
)
def test_the_zero_is_where_the_pendulum_comes_to_rest(tmp_path, rest, zero):
    swing = np.where(TIME < 9, SWING * np.clip((8 - TIME) / 6, 0, 1), 0) + rest
    draft = draft_project(written(tmp_path, alpha=swing), folder=tmp_path)
    assert draft.columns["alpha"].get("zero") == zero


def test_an_arm_that_is_turns_away_is_brought_back(tmp_path):
    draft = draft_project(written(tmp_path, theta=ARM + 326.0, alpha=SWING), folder=tmp_path)
    assert draft.columns["theta"]["zero"] == pytest.approx(326.0, abs=0.01)
    assert any("theta ends at 326 rad" in note for note in draft.notes)


def test_init_writes_a_file_that_fits_as_it_is_and_overwrites_none(tmp_path):
    path, target = written(tmp_path, alpha=SWING), tmp_path / "rigs" / "rig.toml"
    target.parent.mkdir()
    run = CliRunner()
    done = run.invoke(app, ["init", str(path), "--yes", "--out", str(target)])
    assert done.exit_code == 0, done.output
    assert "fracid fit" in done.output
    assert 'file = "../swing.csv"' in target.read_text(encoding="utf-8")
    assert fracid.identify(fracid.load_project(target)).orders["mu"].free
    again = run.invoke(app, ["init", str(path), "--yes", "--out", str(target)])
    assert isinstance(again.exception, InputError)
    assert "is there already" in str(again.exception)


def test_an_unknown_rig_is_refused_before_anything_is_written(tmp_path):
    path = written(tmp_path, alpha=SWING)
    with pytest.raises(InputError, match="rig"):
        draft_project(path, rig="srv20", folder=tmp_path)
