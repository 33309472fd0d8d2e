"""A project drafted from a recording runs as it is, and says what was guessed."""

import re

import numpy as np
import pytest
from typer.testing import CliRunner

import fracid
from fracid.cli import app
from fracid.errors import InputError
from fracid.problem.draft import draft_project, guess_columns, guess_file
from fracid.recording import Recording, inspect_recording
from fracid.workflows.draft import write_draft

TIME = np.arange(0, 10, 0.01)
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


def test_an_output_that_is_measured_now_and_then_is_drafted_too(tmp_path):
    rarely = np.where(np.arange(TIME.size) % 5 == 0, SWING, np.nan)
    draft = draft_project(written(tmp_path, theta=ARM, alpha=rarely, voltage=np.sin(TIME)))
    assert draft.text.startswith("# good: 1000 samples")
    assert "alpha is missing at 800 of 1,000 times: it is interpolated there, and not scored." in draft.notes


@pytest.mark.few(1)
@pytest.mark.parametrize(("factor", "step"), [(1.0, 1e-6), (180 / np.pi, 360 / 4096), (4096 / (2 * np.pi), 1.0)])
@pytest.mark.parametrize("options", [None, {"alpha": {"column": "alpha"}, "theta": {"column": "theta"}}])
def test_check_and_init_agree_on_units(tmp_path, factor, step, options):
    path = written(tmp_path, theta=counted(factor * ARM, step), alpha=counted(factor * SWING, step), u=np.sin(TIME))
    checked = inspect_recording(path, options, guess_units=True)
    draft = draft_project(path, options, folder=tmp_path)
    drafted = inspect_recording(path, {n: c | {"zero": 0.0} for n, c in draft.columns.items()})
    for name in ("theta", "alpha"):
        assert np.array_equal(checked.signals[name], drafted.signals[name])
        assert np.ptp(checked.signals[name]) == pytest.approx(np.ptp(ARM if name == "theta" else SWING), rel=0.02) or (
            draft.columns[name]["unit"] == "counts"
        )
    assert options or checked.units["u"] == drafted.units["voltage"] == "V"


def test_a_recording_in_which_nothing_moves_is_refused():
    with pytest.raises(InputError, match=r"has no column that could be an angle and moves; name it: --column alpha="):
        columns(alpha=np.zeros(len(TIME)))


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("signals", "free", "outputs"),
    [
        ({"theta": ARM, "alpha": SWING}, {"lambda", "mu", "C1", "C3", "C6", "J_theta", "b_theta", "coulomb_alpha"}, 2),
        ({"theta": 0.2 * ARM, "alpha": SWING}, {"lambda", "mu", "C1", "C3", "C6", "J_theta", "b_theta"}, 2),
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
    assert (problem.model.parameter("C3").value == 0) == (outputs == 1)  # an arm that is held has no coupling
    assert "C4" not in problem.names


@pytest.mark.broad
def test_small_swings_leave_the_terms_of_large_ones_alone(tmp_path):
    draft = draft_project(written(tmp_path, theta=0.1 * ARM, alpha=0.1 * SWING), folder=tmp_path)
    assert "# C6 stays" in draft.text
    assert "\n# drag_alpha" in draft.text


@pytest.mark.broad
def test_the_inertia_of_a_pendulum_on_a_still_arm_begins_at_its_period(tmp_path):
    draft = draft_project(written(tmp_path, alpha=SWING), folder=tmp_path)
    (tmp_path / "rig.toml").write_text(draft.text, encoding="utf-8")
    problem = fracid.load_project(tmp_path / "rig.toml").problem
    C4 = problem.model.parameter("C4").value
    assert problem.start[problem.names.index("C1")] == pytest.approx(C4 / 6.73**2, rel=0.05)


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("rest", "zero"), [(0.0, None), (np.pi, 3.141592654), (-2 * np.pi, -6.283185307), (1.0, "rest")]
)
def test_the_zero_is_where_the_pendulum_comes_to_rest(tmp_path, rest, zero):
    swing = np.where(TIME < 9, SWING * np.clip((8 - TIME) / 6, 0, 1), 0) + rest
    draft = draft_project(written(tmp_path, alpha=swing), folder=tmp_path)
    assert draft.columns["alpha"].get("zero") == zero


def wrapped(x):
    return (x + np.pi) % (2 * np.pi) - np.pi


@pytest.mark.few(1)
@pytest.mark.parametrize("decay", [0.1, 0.6])
def test_an_angle_from_upright_that_is_wrapped_is_unwrapped_and_hangs_at_zero(tmp_path, decay):
    swing = np.where(TIME < 1, 0.9, 0.9 * np.exp(-decay * (TIME - 1)) * np.cos(6.73 * (TIME - 1)))
    path = written(tmp_path, theta=wrapped(8 * swing), alpha=wrapped(swing + np.pi))
    draft = draft_project(path, folder=tmp_path)
    (tmp_path / "rig.toml").write_text(draft.text, encoding="utf-8")
    project = fracid.load_project(tmp_path / "rig.toml")
    signals, begins = project.recordings[0].signals, int(np.searchsorted(TIME, project.recordings[0].time[0]))
    assert signals["alpha"] == pytest.approx(swing[begins:], abs=1e-6)
    assert np.ptp(signals["theta"]) == pytest.approx(8 * np.ptp(swing[begins:]), abs=1e-4)
    assert sum("unwrap undoes that" in note for note in draft.notes) == 2


@pytest.mark.broad
def test_what_swings_about_upright_s_zero_to_the_end_hangs_there(tmp_path):
    draft = draft_project(written(tmp_path, alpha=decay(0.0) + np.pi), folder=tmp_path)
    assert draft.columns["alpha"]["zero"] == pytest.approx(np.pi)
    assert "alpha swings to the end about 180°: the encoder's zero is upright." in draft.notes


def test_what_a_motor_balances_about_180_degrees_has_its_zero_where_it_hangs(tmp_path):
    model, step = fracid.rotary_pendulum("srv02-rotpen"), 2e-3
    C1, C3, C4, C6 = (model.parameter(n).value for n in ("C1", "C3", "C4", "C6"))
    t = step * np.arange(6001)
    alpha = np.pi + 0.05 * (np.sin(2 * t) + np.sin(5 * t))
    force = C1 * 0.05 * (4 * np.sin(2 * t) + 25 * np.sin(5 * t)) - C4 * np.sin(alpha)
    theta = np.zeros((len(t), 2))
    for k in range(len(t) - 1):  # what of the arm keeps it there, by the equation of the pendulum
        pull = (force[k] + 0.5 * C6 * np.sin(2 * alpha[k]) * theta[k, 1] ** 2) / (C3 * np.cos(alpha[k]))
        theta[k + 1] = theta[k] + step * np.array([theta[k, 1] + 0.5 * step * pull, pull])
    arm = theta[:, 0] - np.polyval(np.polyfit(t, theta[:, 0], 1), t)
    file = tmp_path / "balanced.csv"
    columns = np.column_stack([t, arm, alpha, np.sin(2 * t)])
    np.savetxt(file, columns, delimiter=",", header="time,theta_rad,alpha_rad,voltage_V", comments="")
    draft = draft_project(file, folder=tmp_path)
    assert "zero" not in draft.columns["alpha"]
    assert 'zero = "hanging"' in draft.text
    assert not any("wrong way" in note or "upright" in note for note in draft.notes)


@pytest.mark.broad
def test_an_arm_that_is_turns_away_is_brought_back(tmp_path):
    draft = draft_project(written(tmp_path, theta=ARM + 326.0, alpha=SWING), folder=tmp_path)
    assert draft.columns["theta"]["zero"] == pytest.approx(326.0, abs=0.01)
    assert any("theta ends at 326 rad" in note for note in draft.notes)


@pytest.mark.broad
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


# --- inputs -------------------------------------------------------------------------------------------------


@pytest.mark.broad
def test_a_column_of_a_few_values_that_stay_is_the_input_and_the_arm_says_its_sign(tmp_path):
    push = np.where((TIME > 1) & (TIME < 1.2), 10.0, 0.0)
    for sign in (1, -1):
        arm = sign * 0.5 * np.clip(TIME - 1, 0, 0.4)
        draft = draft_project(written(tmp_path, theta=arm, pend=SWING, c=push), folder=tmp_path)
        assert draft.columns["voltage"] == {"column": "c", "unit": "V"}
        line = next(line for line in draft.text.splitlines() if line.startswith("torque_per_volt"))
        assert f"the arm goes {'with' if sign > 0 else 'against'} the voltage" in line
        assert np.sign(float(line.split("start = ")[1].split(",")[0])) == sign


@pytest.mark.broad
def test_an_arm_is_watched_until_the_voltage_turns_and_not_when_it_has_turned_back(tmp_path):
    push = np.interp(TIME, [1.0, 1.05, 1.051, 1.15, 1.151, 5.0], [1.0, 1.0, -10.0, -10.0, 8.0, 8.0]) * (TIME >= 1)
    arm = np.interp(TIME, [1.0, 1.05, 1.15, 1.25], [0.0, 0.004, -0.15, -0.2])
    draft = draft_project(written(tmp_path, theta=arm, pend=SWING, c=push), folder=tmp_path)
    assert "the arm goes against the voltage" not in draft.text


@pytest.mark.broad
def test_a_command_that_is_logged_when_it_changes_is_held(tmp_path):
    path = tmp_path / "log.csv"
    rows = [f"{t:.3f},{a:.6f},{b:.6f},{'' if k % 40 else f'{np.sin(t):.4f}'}"
            for k, (t, a, b) in enumerate(zip(TIME, SWING, ARM, strict=True))]  # fmt: skip
    path.write_text("stamp,pend,motor,effort_control/data\n" + "\n".join(rows) + "\n", encoding="utf-8")
    draft = draft_project(path, folder=tmp_path)
    assert draft.columns["voltage"] == {"column": "effort_control/data", "unit": "V", "fill": "hold"}
    assert any("a command that is logged when it changes" in note for note in draft.notes)


@pytest.mark.parametrize(("every", "fields"), [(1, {}), (4, {"fill": "hold"}), (40, {"fill": "hold"})])
def test_the_unit_of_a_voltage_is_the_headers(tmp_path, every, fields):
    path = tmp_path / "log.csv"
    rows = [f"{t:.3f},{a:.6f},{'' if k % every else f'{1e3 * np.sin(t):.0f}'}"
            for k, (t, a) in enumerate(zip(TIME, SWING, strict=True))]  # fmt: skip
    path.write_text("t [s],pend [rad],voltage [mV]\n" + "\n".join(rows) + "\n", encoding="utf-8")
    columns, notes = guess_file(path)
    assert {n: v for n, v in columns["voltage"].items() if n != "column"} == fields
    assert any("voltage [mV]', whose unit the header says" in note for note in notes)


# --- where it begins ------------------------------------------------------------------------------------------


def begins(tmp_path, alpha):
    """The line of the draft that says where it begins."""
    text = draft_project(written(tmp_path, alpha=alpha), folder=tmp_path).text
    return next(line for line in text.splitlines() if line.startswith(("from", "# from")))


def test_a_release_begins_at_the_release(tmp_path):
    assert begins(tmp_path, SWING).startswith('from = "release"')


def several(*heights):
    """A pendulum that a hand lifts within 1 s to each of these heights [rad], holds there for 1 s, and lets swing."""
    t, s = np.arange(0, 7, 0.01), np.linspace(0, 1, 100)
    swing = np.exp(-t / 1.5) * np.cos(6.73 * t)
    return np.concatenate([part * height for height in heights for part in (s * s * (3 - 2 * s), np.ones(100), swing)])


@pytest.mark.parametrize(("model", "column"), [("rotary-pendulum", "alpha"), ("pendulum", "angle")])
@pytest.mark.parametrize(("heights", "drafted"), [((0.9, 0.5, 0.3), 0), ((0.3, 0.9, 0.5), 1), ((0.3, 0.5, 0.9), 2)])
def test_of_several_releases_the_fastest_is_drafted_and_the_others_are_said(tmp_path, heights, drafted, model, column):
    alpha, spans = several(*heights), [(1.99, 8.77), (10.99, 17.77), (19.99, 26.99)]
    np.savez(tmp_path / "swing.npz", time=np.arange(len(alpha)) / 100, alpha=alpha)
    draft = write_draft(tmp_path / "swing.npz", tmp_path / "rig.toml", {column: {"column": "alpha"}}, model=model)
    [said] = [note for note in draft.notes if "is let go 3 times" in note]
    start, stop = spans.pop(drafted)
    found = [float(x) for x in re.findall(r"(?:from|to) =? ?([\d.]+)", said)]
    assert found == pytest.approx([start, stop, *spans[0], *spans[1]], abs=0.1)
    time = fracid.load_project(tmp_path / "rig.toml").problem.experiments[0].time
    assert time[-1] == pytest.approx(stop - start, abs=0.1)


def decay(start, first=1.5):
    """A swing that decays evenly from a turn on; before it something else."""
    return first * np.exp(-0.15 * (TIME - start)) * np.cos(6.0 * (TIME - start))


@pytest.mark.broad
def test_a_swing_by_hand_begins_where_it_turns_and_the_hand_is_off(tmp_path):
    start = 1.3
    by_hand = np.where(start > TIME, -2.3 * np.cos(2.9 * (TIME - start) + np.pi), decay(start))
    line = begins(tmp_path, by_hand)
    turn = float(line.split()[2])
    later = (turn - start) / (np.pi / 6.0)
    assert later == pytest.approx(round(later), abs=0.1)  # at a turn of the free swing
    assert 0 <= round(later) <= 2
    assert "it turns there, and swings freely from then on" in line


@pytest.mark.broad
def test_a_fall_from_upright_begins_at_a_turn_below_the_top(tmp_path):
    start = 1.5  # held upright, then a fall through hanging to a turn on the other side
    fall = np.where(TIME < 1, np.pi, np.pi * np.cos(np.pi * np.clip(TIME - 1, 0, 0.5)))
    falls = np.where(start > TIME, fall, -2.4 * np.exp(-0.15 * (TIME - start)) * np.sin(6.0 * (TIME - start)))
    line = begins(tmp_path, falls)
    assert line.startswith("from = ")
    assert start < float(line.split()[2]) < start + 1.0
    assert "below the top: how it left that, a hair decides" in line


@pytest.mark.parametrize(
    ("arm", "broken", "past"), [(True, False, True), (False, False, False), (True, True, False)], ids=lambda v: ""
)
def test_a_start_at_a_turn_has_the_samples_before_it_as_its_past(tmp_path, arm, broken, past):
    start = 1.5
    fall = np.where(TIME < 1, np.pi, np.pi * np.cos(np.pi * np.clip(TIME - 1, 0, 0.5)))
    alpha = np.where(start > TIME, fall, -2.4 * np.exp(-0.15 * (TIME - start)) * np.sin(6.0 * (TIME - start)))
    time = np.where(TIME > 0.3, TIME + 0.5 * broken, TIME)
    path, table = tmp_path / "fall.csv", np.column_stack([time, alpha, 0.2 * alpha])[:, : 2 + arm]
    np.savetxt(path, table, delimiter=",", header="t,alpha,theta"[: 13 if arm else 7], comments="", fmt="%.9g")
    (tmp_path / "rig.toml").write_text(draft_project(path, folder=tmp_path).text, encoding="utf-8")
    e = fracid.load_project(tmp_path / "rig.toml").problem.experiments[0]
    assert e.start > start
    assert (e.past is not None) == past


def test_a_simulation_that_begins_at_rest_begins_with_its_first_sample(tmp_path):
    assert begins(tmp_path, decay(0.0)).startswith("# from = 1.0")


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("clock", "first", "last"),
    {
        "set forward": (np.where(TIME > 4, TIME + 0.4, TIME), 4.4, 10.4),
        "set back": (np.where(TIME > 4, TIME - 0.4, TIME), 4.0, 9.6),
        "set late": (np.where(TIME > 9, TIME + 0.4, TIME), 0.0, 9.0),
        "samples lost": (np.where((TIME < 4) | (TIME > 4.5), TIME, np.nan), 4.5, 10.0),
    }.values(),
    ids=lambda v: "",
)
def test_what_a_clock_or_a_logger_spoils_is_left_out_of_the_window(tmp_path, clock, first, last):
    path, swing = tmp_path / "log.csv", 0.9 * np.exp(-0.2 * TIME) * np.cos(6.73 * TIME)
    table = np.column_stack([clock, swing])[np.isfinite(clock)]
    np.savetxt(path, table, delimiter=",", header="t,alpha", comments="", fmt="%.9g")
    (tmp_path / "rig.toml").write_text(draft_project(path, folder=tmp_path).text, encoding="utf-8")
    window = fracid.load_project(tmp_path / "rig.toml").recordings[0]
    assert first - 1e-6 <= window.time[0] < first + 1.0
    assert window.time[-1] == pytest.approx(last, abs=0.02)
    assert window.report.clock.uniform
    assert window.report.findings == ()


@pytest.mark.few(1)
@pytest.mark.parametrize(
    "alpha",
    {
        "noise": np.random.default_rng(1).standard_normal(TIME.size),
        "steps of half a turn": np.pi * np.sign(np.sin(5 * TIME)),
        "samples missing here and there": np.where(np.arange(TIME.size) % 7, np.sin(5 * TIME), np.nan),
        "one sample that differs": 1.0 * (np.arange(TIME.size) == 700),
        "a spin": 9 * TIME**2,
    }.values(),
    ids=lambda v: "",
)
def test_an_odd_recording_is_drafted_without_a_warning_of_numpys(tmp_path, alpha):
    assert "[[recording]]" in draft_project(written(tmp_path, alpha=alpha), folder=tmp_path).text


# --- constants and clock ----------------------------------------------------------------------------------------


@pytest.mark.few(1)
@pytest.mark.parametrize(("omega", "as_the_rig"), [(6.9, True), (8.5, True), (13.0, False), (3.0, False)])
def test_a_pendulum_that_swings_otherwise_than_the_rigs_has_its_inertias_scaled(tmp_path, omega, as_the_rig):
    swing = np.where(TIME < 1, 0.3, 0.3 * np.exp(-0.3 * (TIME - 1)) * np.cos(omega * (TIME - 1)))
    draft = draft_project(written(tmp_path, theta=0.2 * swing, alpha=swing), folder=tmp_path)
    (tmp_path / "rig.toml").write_text(draft.text, encoding="utf-8")
    problem = fracid.load_project(tmp_path / "rig.toml").problem
    start = dict(zip(problem.names, problem.start, strict=True))
    own = {n: problem.model.parameter(n).value for n in ("C1", "C3", "J_theta")}
    rig = fracid.rotary_pendulum("srv02-rotpen")
    ratios = {n: start[n] / rig.parameter(n).value for n in own}
    assert np.ptp(list(ratios.values())) < 1e-3 * ratios["C1"]
    assert (abs(ratios["C1"] - 1) < 1e-3) == as_the_rig
    if not as_the_rig:  # between a free arm and one that its friction holds
        C1, C3, C4, J = (start.get(n, rig.parameter(n).value) for n in ("C1", "C3", "C4", "J_theta"))
        assert np.sqrt(C4 / C1) * 0.97 < omega < np.sqrt(C4 / (C1 - C3**2 / J)) * 1.03


@pytest.mark.broad
def test_a_long_rest_that_is_recorded_after_the_swings_does_not_hide_their_period(tmp_path):
    time = 0.005 * np.arange(40_000)
    noise = 2e-3 * np.random.default_rng(1).standard_normal((2, time.size))
    swing = 0.3 * np.exp(-time) * np.cos(8.5 * time)
    np.savez(tmp_path / "swing.npz", time=time, theta=0.2 * swing + noise[0], alpha=swing + noise[1])
    draft = draft_project(tmp_path / "swing.npz", rig="srv02-rotpen", folder=tmp_path)
    (tmp_path / "rig.toml").write_text(draft.text, encoding="utf-8")
    problem = fracid.load_project(tmp_path / "rig.toml").problem
    start = dict(zip(problem.names, problem.start, strict=True))
    assert start["C1"] == pytest.approx(fracid.rotary_pendulum("srv02-rotpen").parameter("C1").value, rel=1e-3)


def test_a_header_with_the_sampling_rate_is_the_clock_of_a_single_column(tmp_path):
    path = tmp_path / "swing.txt"
    numbers = "\n".join(f"{np.degrees(a):.2f}" for a in 10 * decay(0.0))
    path.write_text(f"start_deg, sample_rate, duration_sec\n90, 100, 10\n{numbers}\n", encoding="utf-8")
    recording = fracid.load_recording(path, {"alpha": 0})
    assert recording.step == pytest.approx(0.01)
    assert "The rate is 100 Hz, as the header says." in recording.report.reading
    draft = draft_project(path, folder=tmp_path)
    assert draft.columns["alpha"]["column"] == 0
    assert draft.columns["alpha"]["unit"] == "deg"


@pytest.mark.few(1)
@pytest.mark.parametrize("delta", [0.0, 0.05])
def test_presliding_is_proposed_where_small_swings_are_quicker(tmp_path, delta):
    rig = fracid.rotary_pendulum("stepper-freeswing", b_alpha=1e-5, coulomb_alpha=1e-4, presliding_alpha=delta)
    run = fracid.simulate(rig, orders={"lambda": 1, "mu": 1}, initial={"alpha": 0.3}, step=5e-3, end=25.0)
    alpha = counted(run.states[:, 2], 2 * np.pi / 4096)
    np.savetxt(
        tmp_path / "clamped.csv", np.column_stack([run.time, alpha]), delimiter=",", header="time,alpha", comments=""
    )
    text = draft_project(tmp_path / "clamped.csv").text
    assert ("\npresliding_alpha = {" in text) == (delta > 0)
    assert ("# presliding_alpha" in text) == (delta == 0)


@pytest.mark.broad
@pytest.mark.parametrize(("step", "proposed"), [(1e-3, ["# resample = 0.02"]), (1e-2, [])])
def test_a_recording_with_many_more_samples_than_its_swings_need_is_proposed_a_rate(tmp_path, step, proposed):
    t = step * np.arange(round(130 / step))
    np.savez(tmp_path / "long.npz", time=t, alpha=0.3 * np.exp(-t / 40) * np.cos(6 * t))
    text = draft_project(tmp_path / "long.npz", folder=tmp_path).text
    assert [line.split("#")[1].strip() for line in text.splitlines() if "resample" in line] == [
        line.removeprefix("# ") for line in proposed
    ]
    assert "long.npz" in text


def test_a_pendulum_that_never_moves_is_no_other_column(tmp_path):
    t = np.arange(0, 8, 0.01)
    still = {"time": t, "theta": 0.2 * np.cos(6 * t) * np.exp(-t / 3), "alpha": np.full(t.size, 0.1)}
    np.savez(tmp_path / "log.npz", **still)
    with pytest.raises(InputError, match=r"log\.npz: alpha: it stays at 0\.1 throughout: is its encoder connected"):
        draft_project(tmp_path / "log.npz", folder=tmp_path)
    with pytest.raises(InputError, match=r"no signal moves: .* are its sensors connected"):
        draft_project(tmp_path / "log.npz", {"alpha": {"column": "alpha", "unit": "rad"}}, folder=tmp_path)


@pytest.mark.broad
def test_a_clock_in_another_unit_is_refused_until_somebody_says_it(tmp_path):
    t = np.arange(0, 8, 0.01)
    np.savez(tmp_path / "log.npz", time=1e3 * t, alpha=0.3 * np.exp(-t / 3) * np.cos(6 * t))
    with pytest.raises(InputError, match=r"Type fracid init .*log.npz --time time,unit=ms; or --time time,unit=s, if"):
        draft_project(tmp_path / "log.npz", folder=tmp_path)
    np.savez(tmp_path / "frames.npz", time=np.arange(800.0), alpha=0.3 * np.exp(-t / 3) * np.cos(20 * t))
    with pytest.raises(InputError, match=r"count samples, .* Type fracid init .*frames.npz --rate HZ; or --time time,"):
        draft_project(tmp_path / "frames.npz", folder=tmp_path)
    drafted = draft_project(tmp_path / "log.npz", folder=tmp_path, time={"column": "time", "unit": "ms"})
    assert 'unit = "ms"' in drafted.text
    believed = draft_project(tmp_path / "log.npz", folder=tmp_path, time={"column": "time", "unit": "s"})
    assert any(note.startswith("May be wrong: alpha: a swing takes") for note in believed.notes)


@pytest.mark.broad
def test_single_samples_that_are_missing_are_bridged_and_not_scored(tmp_path):
    t = np.arange(0, 8, 0.01)
    alpha = 0.3 * np.exp(-np.maximum(t - 1, 0) / 3) * np.cos(6 * np.maximum(t - 1, 0))
    alpha[[50, 300, 301]] = np.nan  # of the plateau, which is not fitted, and of the swing
    np.savez(tmp_path / "log.npz", time=t, alpha=alpha)
    draft = draft_project(tmp_path / "log.npz", folder=tmp_path)
    assert "alpha is missing at 3 of 800 times: it is interpolated there, and not scored." in draft.notes
    (tmp_path / "rig.toml").write_text(draft.text)
    [swing] = fracid.load_project(tmp_path / "rig.toml").problem.experiments
    assert swing.start == pytest.approx(1.0, abs=0.02)
    assert swing.start + swing.time[~swing.scored[:, 0]] == pytest.approx([3.0, 3.01])


def test_a_draft_says_that_it_takes_the_arm_to_be_held(tmp_path):
    t = np.arange(0, 8, 0.01)
    np.savez(tmp_path / "log.npz", time=t, alpha=0.3 * np.exp(-t / 3) * np.cos(6 * t))
    [note] = [n for n in draft_project(tmp_path / "log.npz", folder=tmp_path).notes if "arm" in n]
    assert note.endswith("If it moves, name its column: --column theta=COLUMN.")
