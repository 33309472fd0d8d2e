"""fracid init decides of which model a recording is, or says that it cannot; what it writes runs, and begins near."""

import re

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import fracid
from fracid.models.library import table_of
from fracid.problem.model_draft import draft_of_model
from fracid.problem.roles import likely_models, model_of_columns, roles_of
from fracid.workflows.draft import chosen_model, write_draft
from program import run


@pytest.mark.parametrize(("columns", "model", "roles"), [
    (["q", "qd", "tau"], "joint", {"angle": "q", "torque": "tau"}),
    (["q/rad", "tau/mNm"], "joint", {"angle": "q/rad", "torque": "tau/mNm"}),
    (["joint0/position", "joint0/velocity", "joint0/effort"], "joint",
     {"angle": "joint0/position", "torque": "joint0/effort"}),
    (["force", "position"], "oscillator", {"displacement": "position", "force": "force"}),
    (["x", "x_dot", "theta", "theta_dot", "u"], "cart-pole", {"position": "x", "angle": "theta", "force": "u"}),
    (["pole_angle", "cart_pos", "force"], "cart-pole",
     {"position": "cart_pos", "angle": "pole_angle", "force": "force"}),
    (["current", "voltage"], "capacitor", {"voltage": "voltage", "current": "current"}),
    (["h1", "h2", "u"], "tanks", {"upper": "h1", "lower": "h2", "pump": "u"}),
    (["length", "force"], "relaxation", {"force": "force", "stretch": "length"}),
    (["theta_m", "theta_l", "tau"], "two-mass", {"motor": "theta_m", "load": "theta_l", "torque": "tau"}),
    (["theta", "alpha", "voltage"], "rotary-pendulum", {"alpha": "alpha", "theta": "theta", "voltage": "voltage"}),
])  # fmt: skip
def test_a_table_is_of_the_model_that_has_a_place_for_its_columns(columns, model, roles):
    assert model_of_columns("log.csv", columns) == model
    assert likely_models(columns)[model] == roles_of(model, columns) == roles


def test_columns_without_telling_names_are_found_by_how_they_move():
    assert model_of_columns("log.csv", ["column 1", "column 2"]) == "rotary-pendulum"


@pytest.mark.parametrize(("columns", "message"), [
    (["rain", "wind"], "No model of the library has the columns rain, wind of log.csv"),
    (["u", "y"], "may be of oscillator or tanks; say which: fracid init log.csv --model oscillator"),
])  # fmt: skip
def test_what_cannot_be_decided_is_said_with_what_to_type(columns, message):
    with pytest.raises(fracid.InputError, match=message):
        model_of_columns("log.csv", columns)


def test_what_to_type_for_several_recordings_names_them_all(tmp_path):
    files = [tmp_path / name for name in ("a.csv", "b.csv")]
    for file in files:
        np.savetxt(file, np.c_[np.arange(50) / 10, np.eye(50, 2)], delimiter=",", header="time,u,y", comments="")
    with pytest.raises(fracid.InputError, match=r"fracid init a\.csv b\.csv --model tanks"):
        chosen_model(files, None)


def mass(folder, header="displacement [m],force [N]"):
    """A kilogram on 50 N/m with 2 N s/m, driven by a chirp."""
    t = np.arange(0, 20, 0.01)
    force = 2.0 * np.sin(t + 0.2 * t * t)
    state, rows = np.zeros(2), []
    for f in force:
        rows.append(state[0])
        for _ in range(10):
            state = state + 1e-3 * np.array([state[1], f - 50.0 * state[0] - 2.0 * state[1]])
    np.savetxt(folder / "mass.csv", np.c_[t, rows, force], delimiter=",", header=f"time [s],{header}", comments="")
    return folder / "mass.csv"


def test_recordings_whose_files_are_called_alike_have_their_folders_in_their_names(tmp_path):
    for name in ("monday", "tuesday"):
        (tmp_path / name).mkdir()
    files = [mass(tmp_path / name) for name in ("monday", "tuesday")]
    write_draft(files[0], tmp_path / "rig.toml", None, more=files[1:])
    experiments = fracid.load_project(tmp_path / "rig.toml").problem.experiments
    assert [e.name for e in experiments] == ["monday mass", "tuesday mass"]


@pytest.mark.parametrize("order", [1, -1])
def test_a_guessed_unit_is_that_of_the_recordings_whose_header_says_none(tmp_path, order):
    units = {"bare": ("angle,torque", 180 / np.pi, 1.0), "said": ("angle [rad],torque [mN m]", 1.0, 1e3)}
    t = np.arange(0, 20, 0.01)
    for name, (header, angle, torque) in units.items():
        samples = np.c_[t, angle * 0.9 * np.sin(6 * t), torque * 0.1 * np.sin(2 * t)]
        np.savetxt(tmp_path / f"{name}.csv", samples, delimiter=",", header=f"t,{header}", comments="")
    first, second = [tmp_path / f"{name}.csv" for name in units][::order]
    named = {"angle": {"column": "angle"}, "torque": {"column": "torque"}}
    for columns in (None, named) if order == 1 else (named,):
        draft = draft_of_model("pendulum", first, columns, folder=tmp_path, more=[second])
        assert draft.text.count('unit = "N m"') == 1
        assert draft.text.count('unit = "deg"') == 1  # that a column is named says nothing of its unit
    assert not any("May be wrong" in note for note in draft.notes)


def test_a_goal_that_is_held_and_jumps_is_no_sensor_that_answers_slowly(tmp_path, capsys):
    t, rng = np.arange(0, 20, 0.01), np.random.default_rng(1)
    goal = np.repeat(rng.uniform(-1.0, 1.0, 25), 80)
    samples = np.c_[t, goal, np.sin(3 * t), np.sin(3 * t)]
    for names in ("goal [rad],angle [rad]", "motor [rad],load [rad]"):
        np.savetxt(tmp_path / "log.csv", samples[:, :3], delimiter=",", header=f"t,{names}", comments="")
        slowly = "answer more slowly" in run(capsys, "check", str(tmp_path / "log.csv"))[1]
        assert slowly == names.startswith("motor")
        draft = draft_of_model("joint" if not slowly else "two-mass", tmp_path / "log.csv", folder=tmp_path)
        assert any("answer more slowly" in note for note in draft.notes) == slowly
        assert ("repeated" in draft.text) == slowly


LATTICE = np.round(80 * np.sin(np.arange(0, 20, 0.02)))


@pytest.mark.parametrize("named", [None, {"angle": {"column": "present_position"}, "goal": {"column": "goal"}}])
@pytest.mark.parametrize(("angle", "goal", "unit"), [
    (LATTICE * 360 / 4096, np.sin(np.arange(0, 20, 0.02)), "deg"),  # less than two turns of radians
    (2048 + LATTICE, 2048 + 20 * np.sign(np.sin(np.arange(0, 20, 0.02))), "counts"),
    (LATTICE * 2 * np.pi / 4096, np.sin(np.arange(0, 20, 0.02)), "rad"),
])  # fmt: skip
def test_the_goal_of_a_servo_is_in_the_unit_of_its_angle(tmp_path, angle, goal, unit, named):
    samples = np.c_[np.arange(0, 20, 0.02), goal, angle]
    np.savetxt(tmp_path / "servo.csv", samples, delimiter=",", header="t,goal,present_position", comments="")
    draft = draft_of_model("joint", tmp_path / "servo.csv", named, folder=tmp_path)
    assert (draft.columns["goal"]["unit"], draft.columns["angle"]["unit"]) == (unit, unit)
    assert "goal is taken from 'goal', as angle is." in draft.notes


def test_the_clock_of_each_recording_of_a_pendulum_is_looked_at(tmp_path):
    t = np.arange(0, 20, 0.01)
    for name, clock in (("one", t), ("other", 1e3 * t)):
        np.savetxt(tmp_path / f"{name}.csv", np.c_[clock, np.sin(6 * t)], delimiter=",", header="t,angle", comments="")
    with pytest.raises(
        fracid.InputError, match=r"other\.csv: angle: a swing takes .* Type fracid init .* --time t,unit=ms"
    ):
        draft_of_model("pendulum", tmp_path / "one.csv", folder=tmp_path, more=[tmp_path / "other.csv"])


def test_a_draft_begins_near_and_loads(tmp_path):
    draft = draft_of_model("oscillator", mass(tmp_path), folder=tmp_path)
    (tmp_path / "mass.toml").write_text(draft.text, encoding="utf-8")
    problem = fracid.load_project(tmp_path / "mass.toml").problem
    assert problem.outputs == ("displacement",)
    for name, true in (("m", 1.0), ("k", 50.0), ("b_displacement", 2.0)):
        free = problem.parameters[name]
        assert free.start == pytest.approx(true, rel=0.1)
        assert free.lower < true < free.upper
    assert "slip_speed" not in problem.names


@pytest.mark.parametrize("header", ["angle [counts]", "angle"])
def test_that_an_encoder_has_4096_counts_is_a_doubt_with_what_to_type_for_others(tmp_path, header):
    t = np.arange(0, 8, 0.01)
    table = np.column_stack([t, np.round(900 * np.exp(-0.1 * t) * np.cos(6 * t))])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header=f"t [s],{header}", comments="", fmt="%.6g")
    notes = draft_of_model("pendulum", tmp_path / "log.csv", folder=tmp_path).notes
    (doubt,) = (n for n in notes if n.startswith("May be wrong") and "4096" in n)
    assert doubt.endswith(f'--column angle="{header}",unit=counts,counts_per_turn=COUNTS.')
    assert not any("not what its header says" in n for n in notes)


def test_a_unit_of_a_header_that_is_not_known_is_told(tmp_path):
    draft = draft_of_model("oscillator", mass(tmp_path, "displacement [m],force [lbf]"), folder=tmp_path)
    assert draft.columns["force"] == {"column": "force [lbf]", "unit": "N"}
    assert any("which is not what its header says" in note and "scale=FACTOR" in note for note in draft.notes)


@pytest.mark.parametrize("header", ["displacement / mm", "displacement/mm", "displacement in mm", "displacement_mm"])
def test_a_unit_behind_a_line_or_in_is_the_header_s(tmp_path, header):
    draft = draft_of_model("oscillator", mass(tmp_path, f"{header},force [N]"), folder=tmp_path)
    assert draft.columns["displacement"] == {"column": header}


@pytest.mark.parametrize("column", ["displacement", 1, "displacement [mm]"])
def test_the_unit_of_a_header_holds_however_its_column_is_named(tmp_path, column):
    log = mass(tmp_path, "displacement [mm],force")
    given = {"displacement": {"column": column}, "force": {"column": "force"}}
    draft = draft_of_model("oscillator", log, given, folder=tmp_path)
    assert draft.columns == {"displacement": {"column": column}, "force": {"column": "force", "unit": "N"}}


def strip(folder, header):
    """A strip that is pulled and held."""
    t = np.arange(0, 60, 0.1)
    pulled = 0.02 * np.minimum(t, 1.0)
    samples = np.c_[t, 100.0 * pulled + np.minimum(t, 1.0) * (1.0 + t) ** -0.3, pulled]
    np.savetxt(folder / "strip.csv", samples, delimiter=",", header=f"time [s],{header}", comments="")
    return folder / "strip.csv"


def test_what_a_draft_says_to_type_of_one_column_works_as_it_stands(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    strip(tmp_path, "stress [MPa],strain [%]")
    err = run(capsys, "init", "strip.csv", "--yes")[2]
    typed = re.search(r"--column (\S+ \S+),scale=FACTOR", err)[1].replace('"', "")
    assert run(capsys, "init", "strip.csv", "--yes", "--column", f"{typed},scale=1e-3")[0] == 0
    assert typed == "force=stress [MPa],unit=N"
    assert 'stretch = { column = "strain [%]"' in (tmp_path / "strip.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize("named", [None, {"force": {"column": "force"}, "stretch": {"column": "strain"}}])
def test_a_named_column_whose_unit_is_not_known_is_told_as_a_guessed_one(tmp_path, named):
    draft = draft_of_model("relaxation", strip(tmp_path, "force [N],strain [%]"), named, folder=tmp_path)
    assert any("in m, the model's unit, which is not what its header says" in note for note in draft.notes)
    with pytest.raises(fracid.InputError, match=r"is in Pa, as the header says, and force in N"):
        draft_of_model("relaxation", strip(tmp_path, "force [MPa],strain [m]"), named, folder=tmp_path)


def test_a_column_is_found_by_what_it_is_called_without_what_all_names_begin_with(tmp_path):
    draft = draft_of_model("relaxation", strip(tmp_path, "/rig/force,/rig/stretch"), folder=tmp_path)
    assert draft.columns["force"] == {"column": "force", "unit": "N"}


def test_a_column_of_another_dimension_is_refused(tmp_path):
    with pytest.raises(fracid.InputError, match=r"'force \[MPa\]' is in Pa, as the header says, and force in N"):
        draft_of_model("oscillator", mass(tmp_path, "displacement [m],force [MPa]"), folder=tmp_path)


def test_init_writes_the_project_of_the_model_that_it_found_and_says_which(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mass(tmp_path)
    code, out, _ = run(capsys, "init", "mass.csv", "--yes")
    assert (code, "The model is oscillator" in out) == (0, True)
    assert 'name = "oscillator"' in (tmp_path / "mass.toml").read_text(encoding="utf-8")


def test_check_proposes_the_command_that_works(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mass(tmp_path)
    assert "fracid init mass.csv  writes a project of the model oscillator" in run(capsys, "check", "mass.csv")[1]
    mass(tmp_path, "y,u")
    assert "fracid init mass.csv --model tanks  if it is of the model tanks" in run(capsys, "check", "mass.csv")[1]
    mass(tmp_path, "rain [m],wind [N]")
    assert "--model NAME --column NAME=COLUMN" in run(capsys, "check", "mass.csv")[1]


def test_a_current_that_no_column_has_for_it_does_not_change_is_named_as_a_constant(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    t = np.arange(0, 40, 0.1)
    np.savetxt("cell.csv", np.c_[t, 3.0 - 3.0 * 0.02 - 3.0 * t / 50.0], delimiter=",", header="time,value", comments="")
    unsaid = run(capsys, "init", "cell.csv", "--model", "capacitor", "--column", "voltage=value")[1]
    assert '--column current=constant=VALUE,unit="A"' in unsaid
    assert '# current = { constant = 0, unit = "A" }' in (tmp_path / "cell.toml").read_text(encoding="utf-8")
    columns = ("--column", "voltage=value", "--column", "current=constant=-3000,unit=mA")
    run(capsys, "init", "cell.csv", "--model", "capacitor", *columns, "--force")
    problem = fracid.load_project(tmp_path / "cell.toml").problem
    assert np.all(problem.experiments[0].inputs == -3.0)
    assert problem.parameters["C0"].start == pytest.approx(50.0, rel=0.1)


def test_init_writes_nothing_where_no_model_fits(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mass(tmp_path, "rain [m],wind [N]")
    code, _, err = run(capsys, "init", "mass.csv", "--yes")
    assert (code, (tmp_path / "mass.toml").exists()) == (2, False)
    assert "fracid init mass.csv --model NAME --column NAME=COLUMN" in err
    code, _, err = run(capsys, "init", "mass.csv", "--model", "capacitor")
    assert (code, "no column that is called like current, which capacitor needs" in err) == (2, True)


def test_what_nearly_every_rig_has_is_free_though_the_equations_do_not_ask_for_it(tmp_path):
    t, noise = np.arange(0, 10, 0.01), np.random.default_rng(1).standard_normal(1000)
    angle, rate, acceleration = (w * (0.5 * 2**k * np.sin(2 * t + d) + 0.3 * 5**k * np.sin(5 * t + d))
                                 for k, d, w in ((0, 0.0, 1), (1, np.pi / 2, 1), (2, 0.0, -1)))  # fmt: skip
    torque = 5e-3 * acceleration + 0.02 * rate - 0.02 * np.sin(angle)  # it stands upright
    table = np.column_stack([t, torque, angle + 2e-3 * noise])
    np.savetxt(tmp_path / "axis.csv", table, delimiter=",", header="time [s],torque [N m],angle [rad]", comments="")
    draft = draft_of_model("joint", tmp_path / "axis.csv", folder=tmp_path)
    (tmp_path / "axis.toml").write_text(draft.text, encoding="utf-8")
    free = fracid.load_project(tmp_path / "axis.toml").problem.names
    assert {"J", "b_angle", "gravity", "coulomb_angle"} < {*free}
    assert "spring_angle" not in free


def test_gravity_that_a_spring_may_stand_for_has_room_above_what_explains_all_motion(tmp_path):
    """Driven about its own frequency, at which inertia and gravity cancel."""
    t, noise = np.arange(0, 10, 0.01), 2e-3 * np.random.default_rng(1).standard_normal(1000)
    angle, rate, acceleration = (w * 0.2 * (5.5**k * np.sin(5.5 * t + d) + 6.5**k * np.sin(6.5 * t + d))
                                 for k, d, w in ((0, 0.0, 1), (1, np.pi / 2, 1), (2, 0.0, -1)))  # fmt: skip
    torque = 8e-3 * acceleration + 0.02 * rate + 0.288 * np.sin(angle)
    _, problem = drafted(tmp_path, "joint", "t [s],torque [N m],angle [rad]", t, torque, angle + noise)
    assert problem.parameters["gravity"].upper > 3 * 0.288


@pytest.mark.parametrize("driven", [False, True])
def test_the_drag_of_the_air_is_free_in_the_draft_of_a_joint_that_nothing_drives(tmp_path, driven):
    t = np.arange(0, 8, 0.01)
    swing = np.exp(-0.1 * t) * np.cos(6 * t) + 1e-3 * np.random.default_rng(1).standard_normal(len(t))
    header, *torque = ("t [s],angle [rad],torque [N m]", np.sin(t)) if driven else ("t [s],angle [rad]",)
    _, problem = drafted(tmp_path, "joint", header, t, swing, *torque)
    assert ("drag_angle" in problem.names) == (not driven)


def test_leak_offset_and_growing_capacity_are_free_in_a_draft_for_equations_at_some_samples_say_too_little(tmp_path):
    t = np.arange(0, 20, 0.1)
    current = 1.0 * (t > 1) * (t < 6)
    voltage = 0.5 + 0.1 * np.cumsum(current) / 15.0 + 0.05 * current
    voltage += 2e-3 * np.random.default_rng(1).standard_normal(t.size)
    _, problem = drafted(tmp_path, "capacitor", "time [s],current [A],voltage [V]", t, current, voltage)
    assert {"C0", "R", "C1", "leak", "q", "current_rest [log]"} <= {*problem.names}


def test_a_cell_that_is_charged_within_a_minute_of_an_hour_is_drafted_near_its_capacity_and_leak(tmp_path):
    """Its current was taken as lines between samples that lie a minute apart, and its capacity fell below 0."""
    rests = [b + np.cumsum(np.minimum(1.15 ** np.arange(60), 120.0)) for b in (10.42, 41.65)]
    t = np.concatenate([[0.0, 5.0, 10.42], rests[0][rests[0] < 41.6], [41.65], rests[1][rests[1] < 3600]])
    current = 0.8 * ((t >= 10.42) & (t < 41.65))
    charge, rest = 0.8 * np.clip(t - 10.42, 0.0, 41.65 - 10.42), np.maximum(t - 41.65, 0.0)
    voltage = charge / 12.0 * np.exp(-rest / 3000) + 0.1 * current
    voltage += 2e-3 * np.random.default_rng(1).standard_normal(t.size)
    _, problem = drafted(tmp_path, "capacitor", "time [s],current [A],voltage [V]", t, current, voltage)
    for n, true in {"C0": 12.0, "leak": 4e-3}.items():
        assert problem.parameters[n].start == pytest.approx(true, rel=0.3), n


def drafted(folder, model, header, *columns):
    """The draft of a table, and its project."""
    np.savetxt(folder / "log.csv", np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.9g")
    text = draft_of_model(model, folder / "log.csv", folder=folder).text
    (folder / "log.toml").write_text(text, encoding="utf-8")
    return text, fracid.load_project(folder / "log.toml").problem


def test_a_draft_begins_where_a_hand_lets_go(tmp_path):
    t = np.arange(0, 8, 0.01)
    swing = np.where(t < 0.5, 1.0, np.exp(-0.1 * (t - 0.5)) * np.cos(6 * (t - 0.5)))
    text, problem = drafted(tmp_path, "pendulum", "t,angle [rad]", t, np.round(swing, 3))
    assert 'from = "release"' in text
    assert problem.experiments[0].start == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("model", ["pendulum", "cart-pole"])
def test_the_zero_of_an_angle_is_free_in_each_recording(tmp_path, model):
    t = np.arange(0, 8, 0.01)
    swing = np.exp(-0.1 * t) * np.cos(6 * t)
    text, problem = drafted(tmp_path, model, "t,position [m],angle [rad]", t, 0.1 * swing, np.round(swing + 0.02, 3))
    assert 'per_recording = ["angle_rest"]' in text
    assert "# angle_rest is each recording's own" in text
    assert {"angle_rest [log]", "drag_angle"} <= {*problem.names}  # the air's, too


@pytest.mark.parametrize(("zero", "middle", "rests"), [
    (0.6, 0.6, "hanging"), (-1.3, -1.3, "hanging"), (2.0, 2.0 - np.pi, "upright"), (-6.5, 2 * np.pi - 6.5, "hanging"),
])  # fmt: skip
def test_a_swing_is_drafted_about_where_it_swings_wherever_the_zero_of_its_angle_lies(tmp_path, zero, middle, rests):
    t = np.arange(0, 8, 0.01)
    text, problem = drafted(tmp_path, "pendulum", "t,angle [rad]", t, zero + np.exp(-0.1 * t) * np.cos(6 * t))
    assert problem.parameters["angle_rest"].start == pytest.approx(middle, abs=0.1)
    assert f'zero = "{rests}"' in text
    assert "angle_rest [log]" in problem.names


@pytest.mark.parametrize("zero", [0.0, 0.3, 1.57, 9.0])
def test_an_arm_that_a_motor_lifts_is_drafted_near_wherever_the_zero_of_its_encoder_lies(tmp_path, zero):
    t, truth = np.arange(0, 10, 0.005), {"J": 2e-3, "gravity": 0.05, "b_angle": 5e-3, "coulomb_angle": 4e-3}
    torque = 0.02 * np.sin(2 * t + 0.25 * t**2)
    arm = fracid.model("joint").with_parameters(**truth)
    still = fracid.Experiment("arm", 0.005, np.zeros((t.size, 1)), torque[:, None] * [1, 0, 0, 0])
    problem = fracid.Problem(arm, (still,), {"mu": 1.0}, initial_state="held")
    noise = 3e-4 * np.random.default_rng(1).standard_normal(t.size)
    angle = zero + problem.simulate(problem.start, still).states[:, 0] + noise
    table = ["joint", "t,torque [N m],angle [rad]", t, torque, np.round(angle * 4096 / (2 * np.pi)) * 2 * np.pi / 4096]
    _, problem = drafted(tmp_path, *table)
    starts = {n: problem.parameters[n].start for n in ("J", "gravity", "angle_rest")}
    assert starts == {"J": pytest.approx(2e-3, rel=0.3), "gravity": pytest.approx(0.05, rel=0.4),
                      "angle_rest": pytest.approx(zero - 2 * np.pi * (zero > 5), abs=0.2)}  # fmt: skip


@pytest.mark.parametrize("zero", [0.0, 0.02, -0.3])
def test_the_zero_of_a_displacement_is_free_from_where_it_moves_about(tmp_path, zero):
    t = np.arange(0, 8, 0.01)
    _, problem = drafted(tmp_path, "oscillator", "t,displacement [m]", t, zero + 0.1 * np.exp(-0.1 * t) * np.cos(6 * t))
    rest = problem.parameters["displacement_rest"]
    assert rest.start == pytest.approx(zero, abs=0.005)
    assert rest.lower < zero - 0.02 < zero + 0.02 < rest.upper
    assert problem.parameters["k"].start == pytest.approx(36.0, rel=0.1)


def test_the_offset_of_a_load_cell_is_free_where_the_recording_has_one(tmp_path):
    t = np.arange(0, 60, 0.1)
    stretch = 0.02 * np.clip(t - 1, 0, 1)
    force = 5.0 + 300 * stretch + 4 * np.clip(t - 1, 0, 1) * (1 + np.clip(t - 2, 0, None)) ** -0.3
    _, problem = drafted(tmp_path, "relaxation", "t,stretch [m],force [N]", t, stretch, force)
    assert problem.parameters["force_rest"].start == pytest.approx(5.0, rel=0.2)


def test_a_zero_that_is_taken_at_rest_stays(tmp_path):
    t = np.arange(0, 40, 0.01)
    swing = np.round(np.exp(-0.5 * t) * np.cos(6 * t) + 0.02, 3)
    np.savez(tmp_path / "swing.npz", time=t, angle=swing)
    draft = draft_of_model("pendulum", tmp_path / "swing.npz", {"angle": {"column": "angle", "unit": "rad",
                           "zero": "rest"}}, folder=tmp_path)  # fmt: skip
    assert "per_recording" not in draft.text


def test_a_mass_that_a_hand_lets_go_needs_no_force_and_begins_with_its_spring(tmp_path):
    t = np.arange(0, 8, 0.01)
    swing = np.where(t < 2, 0.1, 0.1 * np.exp(-0.1 * (t - 2)) * np.cos(6 * (t - 2)))
    text, problem = drafted(tmp_path, "oscillator", "t,displacement [m]", t, np.round(swing, 5))
    assert 'from = "release"' in text
    assert problem.parameters["k"].start == pytest.approx(36.0, rel=0.1)


@pytest.mark.parametrize("first", ["free", "driven"])
def test_each_recording_is_drafted_by_what_it_shows(tmp_path, first):
    t = np.arange(0, 8, 0.01)
    swing = np.where(t < 1, 1.0, np.exp(-0.1 * (t - 1)) * np.cos(6 * (t - 1)))
    tables = {"free": (t, 0.01 * swing, swing, 0 * t), "driven": (t, np.sin(t), 0.1 * np.sin(t), np.sin(t + 1))}
    for name, table in tables.items():
        np.savetxt(tmp_path / f"{name}.csv", np.column_stack(table), delimiter=",", fmt="%.4f", comments="",
                   header="t,position [m],angle [rad],force [N]")  # fmt: skip
    files = sorted(tmp_path.glob("*.csv"), key=lambda file: file.stem != first)
    draft = draft_of_model("cart-pole", files[0], folder=tmp_path, more=files[1:])
    (tmp_path / "both.toml").write_text(draft.text, encoding="utf-8")
    found = {e.name: e for e in fracid.load_project(tmp_path / "both.toml").problem.experiments}
    assert found["free"].start == pytest.approx(1.0, abs=0.05)
    assert (found["driven"].start, np.ptp(found["driven"].inputs)) == (0.0, pytest.approx(2.0, rel=0.01))


@pytest.mark.parametrize(("torque", "between"), [
    (lambda t: np.where(np.sin(t) > 0, 0.3, -0.2), "hold"),
    (lambda t: 0.3 * np.sign(np.sin(40 * t)), "hold"),
    (lambda t: 0.3 * np.sign(np.sin(t)) + 0.1 * np.sin(t * t), "hold"),
    (lambda t: np.round(np.sin(t), 1), "line"),
    (lambda t: np.sin(0.3 + 8 * t * t) * (t > 0.5), "line"),
    (lambda t: np.maximum(np.sin(60 * t) - 0.9, 0) * (np.sin(t) > 0.9), "line"),
    (lambda t: np.random.default_rng(1).standard_normal(len(t)), "line"),
])  # fmt: skip
def test_an_input_that_jumps_is_held_between_samples_and_the_draft_says_so(tmp_path, torque, between):
    t = np.arange(0, 8, 0.01)
    text, problem = drafted(tmp_path, "joint", "t,angle [rad],tau [N m]", t, 0.3 * np.sin(3 * t), torque(t))
    other = "line" if between == "hold" else "hold"
    assert re.search(rf'between = "{between}" }}   # .*"{other}" if', text)
    assert problem.experiments[0].between == {"torque": between}


@pytest.mark.parametrize("sensor", [{"gain": 0.5}, {"gain": {"start": 0.5, "lower": 0.1, "upper": 1.0}}, {"bias": 0.3}])
def test_constants_begin_where_the_gain_and_the_zero_of_a_sensor_put_them(tmp_path, sensor):
    """One of the two alone ended in a KeyError, and an amplifier was taken the other way round."""
    t = np.arange(0, 8, 0.01)
    x, force = 0.1 * np.sin(5 * t), 11.0 * 0.1 * np.sin(5 * t) + 2.0 * 0.5 * np.cos(5 * t)  # 36 N/m, 1 kg, 2 N s/m
    gain = 0.5 if "gain" in sensor else 1.0
    np.savez(
        tmp_path / "mass.npz",
        time=t,
        x=gain * x + sensor.get("bias", 0.0),
        force=(force - sensor.get("bias", 0.0)) / gain,
    )
    columns = {"displacement": {"column": "x"}, "force": {"column": "force", "unit": "N"}}
    draft = draft_of_model(
        "oscillator", tmp_path / "mass.npz", {n: c | sensor for n, c in columns.items()}, folder=tmp_path
    )
    (tmp_path / "mass.toml").write_text(draft.text, encoding="utf-8")
    assert fracid.load_project(tmp_path / "mass.toml").problem.parameters["b_displacement"].start == pytest.approx(
        2.0, rel=0.1
    )


@pytest.mark.parametrize("other", ["motor current [A]", "temperature [degC]"])
def test_a_column_that_may_be_the_drive_of_a_rig_that_has_none_is_a_doubt_with_what_to_type(tmp_path, other):
    t = np.arange(0, 8, 0.01)
    table = np.column_stack([t, 0.3 * np.sin(3 * t), 0.3 * np.sin(3 * t - 0.1), np.sin(3 * t + 1)])
    header = f"t [s],motor [rad],load [rad],{other}"
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header=header, comments="", fmt="%.6g")
    doubts = [n for n in draft_of_model("two-mass", tmp_path / "log.csv", folder=tmp_path).notes if "scale=FACTOR" in n]
    typed = '--column torque="motor current [A]",unit="N m",scale=FACTOR, N m for each A'
    assert [typed in n and n.startswith("May be wrong") for n in doubts] == [True] * ("current" in other)


@pytest.mark.parametrize("gear", [1.0, 3.0])
def test_a_load_behind_a_gear_has_its_ratio_as_a_gain(tmp_path, gear):
    t = np.arange(0, 4, 0.008)
    torque = 0.02 * np.sin(2 * t + 4 * t**2)

    def rates(at, x):
        shaft = 0.1 * (x[0] - x[2]) + 2e-4 * (x[1] - x[3])
        return [x[1], (np.interp(at, t, torque) - shaft) / 8e-5, x[3], (shaft - 1e-4 * x[3]) / 2e-4]

    motor, _, load, _ = solve_ivp(rates, (0, t[-1]), [0.0] * 4, t_eval=t, rtol=1e-7, max_step=0.01).y
    text, problem = drafted(tmp_path, "two-mass", "t,motor [rad],load [rad],tau [N m]", t, motor, gear * load, torque)
    assert ("gain_load" in problem.names) == (gear != 1.0)
    assert ("gain = {" in text) == (gear != 1.0)
    starts = dict(zip(problem.names, problem.start, strict=True))
    assert starts.get("gain_load", 1.0) == pytest.approx(gear, rel=1e-3)
    assert starts["k"] == pytest.approx(0.1, rel=0.1)


def test_the_start_of_what_nothing_measures_is_free(tmp_path):
    t = np.arange(0, 800, 4.0)
    level, pump = 3 - np.cos(t / 60), 2 + np.sin(t / 60)
    text, problem = drafted(tmp_path, "tanks", "t,level [V],pump [V]", t, level, pump)
    assert "initial = { upper = { start = 2," in text
    assert "upper(0) [log]" in problem.names
    draft = draft_of_model("cart-pole", tmp_path / "log.csv", {"position": {"column": 1, "unit": "m"}}, folder=tmp_path)
    assert "# angle begins at 0: nothing measures it" in draft.text


def test_a_draft_takes_as_known_what_a_voltage_cannot_tell(tmp_path):
    t = np.arange(0, 8, 0.01)
    angle, torque = 0.3 * np.sin(3 * t) + 1e-3 * np.sin(99 * t), np.sin(3 * t)
    text, by_volts = drafted(tmp_path, "joint", "t,angle [rad],u [V]", t, angle, torque)
    assert "all else scales with it" in text
    assert ("J" in by_volts.names, "torque_per_volt" in by_volts.names) == (False, True)
    text, by_torque = drafted(tmp_path, "joint", "t,angle [rad],tau [N m]", t, angle, torque)
    assert ("J" in by_torque.names, "torque_per_volt" in by_torque.names) == (True, False)


@pytest.mark.parametrize(("jitter", "uneven"), [(0.0, False), (0.05, True)])
def test_samples_whose_stamps_jitter_stay_where_they_are_and_so_do_the_corners_of_an_input(tmp_path, jitter, uneven):
    t = np.arange(0, 8, 0.01)
    t[1:] += 0.01 * jitter * np.random.default_rng(1).uniform(-1, 1, len(t) - 1)
    text, problem = drafted(tmp_path, "joint", "t,angle [rad],tau [N m]", t, 0.3 * np.sin(3 * t), np.sin(20 * t))
    (e,) = problem.experiments
    assert ('resample = "uneven"' in text, e.times is not None) == (uneven, uneven)
    if uneven:  # straight lines between the grid's points miss the corners by little
        grid = np.interp(t, np.arange(len(e.inputs)) * e.step, e.inputs[:, 0])
        assert np.max(np.abs(grid - np.sin(20 * t))) < 5e-3


@pytest.mark.parametrize(("options", "says"), [
    (("--model", "pendulm"), "unknown model 'pendulm': did you mean pendulum"),
    (("--model", "pendulum", "--zero", "foo"), "unknown --zero 'foo'"),
    (("--model", "rotary-pendulum", "--zero", "upright"), "--zero is none of a rotary-pendulum"),
])  # fmt: skip
def test_init_refuses_what_it_cannot_follow(tmp_path, capsys, options, says):
    code, _, err = run(capsys, "init", mass(tmp_path), "--out", tmp_path / "x.toml", *options)
    assert (code, says in err) == (2, True)


@pytest.mark.broad
@pytest.mark.parametrize("name", ["cart-pole", "joint", "tanks", "capacitor", "relaxation", "two-mass"])
def test_the_draft_of_a_twin_begins_within_its_bounds_of_the_truth(name, tmp_path):
    twin = fracid.Twin.of_library(name)
    made = twin.record(twin.simulate())
    fracid.save_recording(made, tmp_path / "twin.csv")
    (tmp_path / "twin.toml").write_text(draft_of_model(name, tmp_path / "twin.csv", folder=tmp_path).text)
    problem = fracid.load_project(tmp_path / "twin.toml").problem
    truth = {p.name: p.value for p in fracid.model(name).parameters} | dict(
        table_of(name)["twin"].get("parameters", {})
    )
    for n, free in problem.parameters.items():
        if hasattr(free, "lower") and truth[n]:
            assert free.lower <= truth[n] <= free.upper, n


def test_a_relaxation_is_drafted_in_its_headers_unit_and_its_samples_stay_where_they_are(tmp_path):
    t = np.concatenate([np.arange(0, 60, 0.1), np.arange(60, 600, 1.0), [660.0]])
    stretch = 20.0 * np.minimum(t, 1.0)
    force = 0.05 * stretch + np.minimum(t, 1.0) * (1.0 + t) ** -0.3
    table = np.column_stack([t, stretch, force])
    np.savetxt(tmp_path / "strip.csv", table, delimiter=",", header="t,stretch_mm,force_N", comments="")
    columns = {"stretch": {"column": "stretch_mm"}, "force": {"column": "force_N"}}
    for given in (columns, None):
        draft = draft_of_model("relaxation", tmp_path / "strip.csv", given, folder=tmp_path)
        (tmp_path / "strip.toml").write_text(draft.text, encoding="utf-8")
        problem = fracid.load_project(tmp_path / "strip.toml").problem
        assert problem.experiments[0].times is not None
        assert draft.text.startswith("# good: ")
        assert np.ptp(problem.experiments[0].inputs[:, 0]) == pytest.approx(0.02)
        assert {"nu", "k", "c"} <= {*problem.names}


@pytest.mark.broad
def test_an_element_that_may_not_be_there_is_drafted_from_0_and_found_to_be_0(tmp_path, without_rivals):
    t = np.arange(0, 30, 0.05)
    stretch = np.clip(t - 1, 0, 0.5)
    force = 2.0 * stretch + 2e-3 * np.random.default_rng(1).standard_normal(len(t))
    np.savez(tmp_path / "spring.npz", t=t, stretch=stretch, force=force)
    (tmp_path / "rig.toml").write_text(draft_of_model("relaxation", tmp_path / "spring.npz", folder=tmp_path).text)
    fit = fracid.identify(fracid.load_project(tmp_path / "rig.toml"))
    assert fit.parameters["c"].interval95[0] == 0.0
    assert fit.parameters["k"].interval95[0] < 2.0 < fit.parameters["k"].interval95[1]
    assert any("c lies at its bound: 0; it is zero within the resolution of the data" in w for w in fit.warnings)
