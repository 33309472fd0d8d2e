"""``fracid simulate``: a recording of known truth from a rig, a project or a run; and what it refuses."""

import json
import os

import numpy as np
import pytest

import fracid
from fracid.cli.simulation import quantity
from fracid.problem import Experiment, Free, Problem
from fracid.twins.twin import Twin
from fracid.workflows.simulation import driven, twin_of
from program import run


def read(file):
    """The columns of a file, by name."""
    recording = fracid.load_recording(file, {n: n for n in ("theta", "alpha")})
    return recording.time, recording.signals["theta"], recording.signals["alpha"]


# --- what it gives ----------------------------------------------------------------------------------------


def test_a_rig_is_let_go_from_10_degrees_and_leaves_recording_truth_and_figure(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, err = run(capsys, "simulate", "qube-servo2", "--order", "mu=0.9", "--end", 2, "--step", "5ms")
    assert (code, err) == (0, "")
    assert "qube-servo2: rotary-pendulum, hanging; lambda 1, mu 0.9; pi2" in out
    assert "401 samples to 2 s: completed" in out
    assert "next     fracid check runs/qube-servo2-simulated/qube-servo2.csv  " in out
    made = tmp_path / "runs" / "qube-servo2-simulated"
    assert {p.suffix for p in made.iterdir()} == {".csv", ".json", ".png", ".svg"}
    truth = json.loads((made / "qube-servo2.json").read_text())
    assert truth["orders"] == {"lambda": 1.0, "mu": 0.9}
    assert truth["initial"]["alpha"] == pytest.approx(np.radians(10))
    _, theta, alpha = read(made / "qube-servo2.csv")
    direct = fracid.simulate(fracid.rotary_pendulum("qube-servo2"), orders=truth["orders"], initial=truth["initial"],
                             step=5e-3, end=2.0)  # fmt: skip
    assert np.array_equal(np.column_stack([theta, alpha]), direct.states[:, [0, 2]])


@pytest.mark.few(1)
@pytest.mark.parametrize("ending", ["csv", "mat", "npz"])
def test_every_format_is_read_again_to_the_last_digit_and_says_that_nothing_was_measured(capsys, tmp_path, ending):
    file = tmp_path / f"twin.{ending}"
    code, out, _ = run(capsys, "simulate", "srv02-rotpen", "--end", 1, "--noise", "0.05deg", "--to", file, "--json")
    assert code == 0
    assert json.loads(out)["files"] == [str(file)]
    assert [p.name for p in tmp_path.iterdir()] == [file.name]
    run(capsys, "simulate", "srv02-rotpen", "--end", 1, "--noise", "0.05deg", "--to", tmp_path / "other.npz")
    for one, other in zip(read(file), read(tmp_path / "other.npz"), strict=True):
        assert np.array_equal(one, other)
    if ending == "csv":
        assert file.read_text().startswith("# SIMULATED, not measured: rotary-pendulum of srv02-rotpen, zero = hanging")


def test_a_model_whose_orders_have_no_names_says_that_they_are_fixed(capsys, tmp_path):
    np.savetxt(tmp_path / "decay.csv", np.c_[0:1:0.01, 1:0:100j], delimiter=",", header="t,x", comments="")
    (tmp_path / "decay.toml").write_text("""
        model = { name = "decay", equations = { x = "-a*x" }, parameters = { a = 2.0 } }
        recording = [{ file = "decay.csv", x = { column = "x", unit = "1" } }]
        """)
    code, out, err = run(capsys, "simulate", tmp_path / "decay.toml", "--to", tmp_path / "twin.csv")
    assert (code, err) == (0, "")
    assert "decay; fixed orders; pi2" in out
    assert "fixed orders; at the start" in (tmp_path / "twin.csv").read_text()


def test_a_full_disk_is_nobodys_mistake(capsys, tmp_path):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("fracid.safety.door.write_whole", lambda *_: os.write(os.open("/dev/full", os.O_WRONLY), b"0"))
        code, _, err = run(capsys, "simulate", "srv02-rotpen", "--end", 1, "--to", tmp_path / "twin.csv")
    assert (code, "the disk is full. Make room" in err) == (1, True)


@pytest.mark.parametrize("ending", ["csv", "npz"])
def test_an_exercise_holds_none_of_its_true_values(capsys, tmp_path, ending):
    file, truth = tmp_path / f"task.{ending}", tmp_path / "kept" / "truth.json"
    words = ("simulate", "srv02-rotpen", "--order", "mu=0.8125", "--end", 1, "--to", file, "--truth", truth, "--json")
    code, out, _ = run(capsys, *words)
    assert code == 0
    assert json.loads(out)["files"] == [str(file), str(truth)]
    assert json.loads(truth.read_text())["orders"]["mu"] == 0.8125
    text = file.read_text().split("time")[0] if ending == "csv" else str(np.load(file)["note"])
    assert [line.lstrip("# ").split()[0] for line in text.splitlines()] == ["SIMULATED,", "made"]
    code, _, err = run(capsys, *words, "--force", "--truth", file)
    assert code == 2
    assert "expected a file that ends in .json" in err
    code, _, err = run(capsys, *words, "--to", tmp_path / f"other.{ending}")
    assert code == 2
    assert "truth.json is there already" in err


@pytest.mark.broad
def test_a_twin_is_ready_for_check_init_and_fit(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run(capsys, "simulate", "srv02-rotpen", "--initial", "alpha=40deg", "--hold", "1", "--noise", "0.05deg", "--end",
        "9s", "--step", "2ms", "--counts", 4096, "--to", "twin.csv", "--set", "b_alpha=4e-3")  # fmt: skip
    code, out, _ = run(capsys, "check", "twin.csv", "--json")
    report = json.loads(out)
    assert (code, report["level"]) == (0, "good")
    assert report["release"] == pytest.approx(1.0, abs=0.05)
    counts = [2 * np.pi / report["signals"][n]["resolution"] for n in report["signals"]]
    assert counts == pytest.approx([4096, 4096], rel=1e-3)
    code, out, _ = run(capsys, "init", "twin.csv", "--yes")
    assert code == 0
    assert fracid.load_project("twin.toml").problem.outputs == ("theta", "alpha")


@pytest.mark.broad
def test_noise_has_the_size_that_was_asked_for_and_a_seed_of_its_own(capsys, tmp_path):
    def recorded(name, *options):
        file = tmp_path / f"{name}.npz"
        assert run(capsys, "simulate", "srv02-rotpen", "--end", 5, "--to", file, *options)[0] == 0
        return read(file)

    _, theta, alpha = recorded("clean")
    _, noisy_theta, noisy_alpha = recorded(
        "noisy", "--noise", "0.5deg", "--noise", "theta=1mrad".replace("1m", "0.001")
    )
    assert np.std(noisy_alpha - alpha) == pytest.approx(np.radians(0.5), rel=0.05)
    assert np.std(noisy_theta - theta) == pytest.approx(1e-3, rel=0.05)
    assert not np.array_equal(recorded("other", "--noise", "0.5deg", "--seed", 2)[2], noisy_alpha)
    assert np.array_equal(recorded("again", "--noise", "0.5deg")[2], noisy_alpha)


# --- from a project and a run -------------------------------------------------------------------------------


def test_a_run_is_simulated_as_it_was_fitted_inputs_and_all(capsys, two_recordings, tmp_path):
    for name in ("release 20°", "driven"):
        words = ("simulate", two_recordings / "run", "--recording", name, "--to", tmp_path / f"{name}.npz", "--states")
        code, _, err = run(capsys, *words)
        assert (code, err) == (0, "")
        fitted = fracid.load_run(two_recordings / "run").recordings[name].fitted
        time, theta, alpha = read(tmp_path / f"{name}.npz")
        assert np.array_equal(theta, fitted["theta"])
        assert np.array_equal(alpha, fitted["alpha"])
    with np.load(tmp_path / "driven.npz") as file:
        driven = dict(file)
    assert np.allclose(driven["voltage"], 2 * np.sin(6 * time[0] + 6 * driven["time"]), atol=1e-12)
    assert {"D^lambda theta", "D^mu alpha"} <= set(driven)


def test_a_project_is_simulated_with_its_starting_values_and_options_change_them(capsys, two_recordings, tmp_path):
    for options in ([], ["--order", "mu=0.8", "--set", "b_alpha=1e-3", "--initial", "alpha=5deg", "--method", "gl"]):
        file = tmp_path / f"{len(options)}.npz"
        code, out, _ = run(capsys, "simulate", two_recordings / "rig.toml", "--to", file, "--json", *options)
        assert code == 0
        record = json.loads(out)
        assert record["orders"] == {"lambda": 0.8623, "mu": 0.8 if options else 0.9}
        if options:
            assert record["parameters"]["b_alpha"] == {"value": 1e-3, "unit": "N m s/rad"}
            assert record["method"] == "gl"
            assert read(file)[2][0] == pytest.approx(np.radians(5))


@pytest.mark.parametrize(
    ("unit", "column", "shown"), [("W", ', unit = "W"', "W"), ("W", ', unit = "kW"', "W"), ("cells", "", "1")]
)
def test_a_model_of_ones_own_is_simulated_in_its_own_units(capsys, tmp_path, unit, column, shown):
    t = np.arange(40.0)
    np.savetxt(
        tmp_path / "heat.csv", np.column_stack([t, t > 5, 290 + t]), delimiter=",", header="t,u,temp", comments=""
    )
    (tmp_path / "heat.toml").write_text(f"""
[model]
name = "heater"
inputs = {{ power = "{unit}" }}
[model.equations]
temp = "-a*temp + k*power"
[model.outputs]
temp = {{ equals = "temp", unit = "K" }}
[model.parameters]
a = {{ start = 0.01, lower = 1e-4, upper = 1.0 }}
k = 0.02
[[recording]]
file = "heat.csv"
power = {{ column = "u"{column}, between = "hold" }}
temp = {{ column = "temp", unit = "K" }}
""")
    code, _, err = run(capsys, "simulate", tmp_path / "heat.toml", "--to", tmp_path / "twin.csv")
    assert code == 0, err
    assert f"temp [K],power [{shown}]" in (tmp_path / "twin.csv").read_text(encoding="utf-8")


@pytest.mark.parametrize("release_time", [0.0, 0.0123, -0.004])
@pytest.mark.parametrize("substeps", [1, 3])
def test_a_twin_of_a_problem_is_what_the_problem_simulates(release_time, substeps):
    measured, u = np.zeros((101, 2)), np.sin(np.arange(101.0))[:, None]
    e = Experiment("swing", 0.01, measured, u, 2.0, "", {"alpha": 0.3}, release_time=release_time)
    problem = Problem(fracid.rotary_pendulum(), (e,), {"lambda": 0.9, "mu": Free(0.9, 0.5, 1.2)}, {},
                      initial_state="rest", substeps=substeps)  # fmt: skip
    twin = Twin.of_problem(problem, problem.start, e)
    made = twin.record(twin.simulate())
    fitted, ours = problem.fitted(problem.start, e), np.column_stack([made.signals["theta"], made.signals["alpha"]])
    last = -1 if release_time else None  # between two steps: there the problem has no neighbour beyond
    assert np.allclose(ours[:last], fitted[:last], rtol=0, atol=1e-9)
    assert np.allclose(made.time, 2.0 + e.time)


def test_a_state_that_is_an_output_has_its_unit():
    twin = Twin.of_library("two-mass")
    units = twin.record(twin.simulate(), states=True).units
    assert (units["state motor"], units["state load"], units["motor_rate"]) == ("rad", "rad", "1")


def test_a_start_in_motion_keeps_its_measured_past_and_refuses_another_grid():
    whole = Twin.of_model(fracid.rotary_pendulum(), initial={"alpha": 0.4}, step=0.01, end=4.0, hold=0.5)
    before, after = whole.record(whole.simulate(), noise={"alpha": 1e-4, "theta": 1e-4}, seed=3).split(1.2)
    e = Experiment.of(after, whole.model, ["theta", "alpha"], before=before)
    problem = Problem(whole.model, (e,), {"lambda": 1.0, "mu": Free(0.98, 0.5, 1.2)}, {})
    twin = Twin.of_problem(problem, problem.start, e)
    assert np.array_equal(twin.simulate().states[:, [0, 2]], problem.fitted(problem.start, e))
    with pytest.raises(fracid.InputError, match="starts in motion, with its measured past on its own grid"):
        twin.changed(step=0.02)


@pytest.mark.parametrize("between", ["line", "hold", "band-limited"])
def test_a_finer_step_reads_an_input_between_its_samples_as_it_was_said_to_go_there(between):
    time = 0.1 * np.arange(13)
    twin = Twin.of_model(fracid.rotary_pendulum(), initial={}, step=0.1, end=1.2, substeps=8,
                         between={"voltage": between}, inputs={"voltage": (time, np.sin(2.5 * time))})  # fmt: skip
    finer = twin.changed(step=0.025, substeps=2)
    assert np.allclose(finer.simulate().states[::4], twin.simulate().states, rtol=0, atol=1e-4)


def test_a_held_input_has_its_mean_in_each_longer_step_and_its_value_in_each_shorter_one():
    time, u = 0.1 * np.arange(7), np.array([0.0, 0.0, 6.0, 0.0, 3.0, 3.0, 0.0])
    twin = Twin.of_model(fracid.rotary_pendulum(), initial={}, step=0.1, end=0.6, inputs={"voltage": (time, u)})
    for step, means in ((0.3, [2.0, 2.0, 0.0]), (0.05, np.repeat(u, 2)[:-1])):
        other = twin.changed(step=step)
        assert np.allclose(other.record(other.simulate()).signals["voltage"], means)


@pytest.mark.parametrize(("step", "substeps"), [(0.04, 1), (0.04, 32), (0.015, 1)])
@pytest.mark.parametrize("between", ["line", "hold"])
def test_a_run_follows_an_input_that_has_more_samples_than_its_recording(between, step, substeps):
    time = 0.01 * np.arange(121)
    u = 3 * np.sign(np.random.default_rng(1).standard_normal(121))
    fine = Twin.of_model(fracid.rotary_pendulum(), initial={}, step=0.005, end=1.2, substeps=4,
                         between={"voltage": between}, inputs={"voltage": (time, u)})  # fmt: skip
    coarse = fine.changed(step=step, substeps=substeps)
    exact = fine.simulate().states[:: round(step / 0.005)]
    assert abs(coarse.simulate().states - exact).max() < 1e-2 * np.ptp(exact)


def test_an_input_from_a_file_does_between_its_samples_what_the_project_says(two_recordings, tmp_path):
    (tmp_path / "push.csv").write_text("time,voltage [V]\n" + "".join(f"{0.5 * k},{k % 2}\n" for k in range(20)))
    twin = twin_of(str(two_recordings / "rig.toml"), recording=None, zero=None, friction=False, released=False,
                   trust=False)  # fmt: skip
    said = driven(twin.changed(between={"voltage": "line"}), tmp_path / "push.csv", {}, to_its_end=True)
    assert said.between == {"voltage": "line"}


def test_a_file_drives_a_rig_to_its_end(capsys, tmp_path):
    times = np.arange(0, 1.5, 0.01)
    np.savetxt(tmp_path / "push.csv", np.column_stack([times, 5 * (times > 0.5), np.sin(times)]), delimiter=",",
               header="time,u,other", comments="")  # fmt: skip
    file = tmp_path / "driven.npz"
    code, _, err = run(capsys, "simulate", "srv02-rotpen", "--input", tmp_path / "push.csv", "--to", file)
    assert code == 2
    assert "has several columns besides its time: u, other. Say which of them is voltage: --input" in err
    code, out, _ = run(
        capsys, "simulate", "srv02-rotpen", "--input", f"{tmp_path / 'push.csv'},column=u", "--to", file, "--json"
    )
    assert code == 0
    assert json.loads(out)["driven"] is True
    time, theta, _ = read(file)
    assert time[-1] == pytest.approx(1.49)
    assert np.all(theta[time <= 0.5] == 0)
    assert abs(theta[-1]) > 0.1
    assert np.load(file)["voltage"][-1] == 5


def test_what_an_input_does_beyond_its_samples_is_said(capsys, tmp_path):
    (tmp_path / "push.csv").write_text("time [s],u [V]\n" + "".join(f"{0.01 * k},{k % 3}\n" for k in range(51)))
    words = "simulate", "srv02-rotpen", "--input", tmp_path / "push.csv", "--to", tmp_path / "twin.csv", "--force"
    code, _, err = run(capsys, *words, "--end", "0.5", "--step", "10ms")
    assert (code, err) == (0, "")
    _, _, err = run(capsys, *words, "--end", "0.6")
    said = " ".join(err.split())
    assert "The samples of voltage end 0.5 s after the start; from there on it keeps its last value, 2 V." in said


def test_a_voltage_from_a_file_is_held_whatever_its_input_is_called(tmp_path):
    (tmp_path / "pump.csv").write_text("time,pump\n" + "".join(f"{0.5 * k},{k % 2}\n" for k in range(20)))
    tanks = twin_of("tanks", recording=None, zero=None, friction=False, released=False, trust=False)
    assert driven(tanks, tmp_path / "pump.csv", {}, to_its_end=True).between == {"pump": "hold"}


def test_of_several_columns_the_one_that_is_called_as_the_input_drives_it(tmp_path):
    (tmp_path / "cell.csv").write_text("time_s,current_A,voltage_V\n" + "".join(f"{k},{k % 2},3\n" for k in range(20)))
    cell = twin_of("capacitor", recording=None, zero=None, friction=False, released=False, trust=False)
    assert driven(cell, tmp_path / "cell.csv", {}, to_its_end=True).inputs["current"][1].max() == 1.0


@pytest.mark.parametrize("channel", [{}, {"column": "pump [mV]"}])
def test_the_unit_of_an_input_is_that_of_its_header(tmp_path, channel):
    (tmp_path / "pump.csv").write_text("time [s],pump [mV]\n" + "".join(f"{0.5 * k},{k % 2}\n" for k in range(20)))
    tanks = twin_of("tanks", recording=None, zero=None, friction=False, released=False, trust=False)
    (_, u), *_ = driven(tanks, tmp_path / "pump.csv", channel, to_its_end=True).inputs.values()
    assert u[:2].tolist() == [0.0, 1e-3]


def test_an_input_in_the_unit_of_something_else_is_refused(tmp_path):
    (tmp_path / "pump.csv").write_text("time,pump [deg]\n" + "".join(f"{0.5 * k},{k % 2}\n" for k in range(20)))
    tanks = twin_of("tanks", recording=None, zero=None, friction=False, released=False, trust=False)
    with pytest.raises(fracid.InputError, match="pump is a quantity in V of this model, and its unit is rad"):
        driven(tanks, tmp_path / "pump.csv", {}, to_its_end=True)


def test_a_model_in_a_file_of_ones_own_is_simulated_when_it_is_named(capsys, tmp_path):
    (tmp_path / "decay.py").write_text(
        "from fracid import Model, Parameter\n"
        "def rhs(t, x, u, p, out):\n    out[0] = -p[0] * x[0]\n"
        'model = Model("decay", rhs, ("y",), ("q",), {"y": 0}, (), (Parameter("k", "1/s", 1.0, "rate"),), "", "")\n'
    )
    file = tmp_path / "decay.npz"
    code, out, err = run(capsys, "simulate", f"{tmp_path / 'decay.py'}:model", "--initial", "y=1", "--order", "q=0.8",
                         "--end", 1, "--step", "1e-3", "--to", file)  # fmt: skip
    assert code == 0, err
    assert "decay; q 0.8" in out
    assert np.load(file)["y"][-1] == pytest.approx(0.386948578, abs=1e-6)  # E_0.8(-1)


# --- what it refuses ------------------------------------------------------------------------------------------


@pytest.mark.few(4)
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["srv02"], "unknown rig or model 'srv02': did you mean srv02-rotpen"),
        (["swing.csv"], "swing.csv is a recording: fracid check swing.csv looks at it, fracid init swing.csv"),
        (["none.toml"], "none.toml"),
        (["srv02-rotpen", "--initial", "alpha=10"], "has no unit: deg or rad? Type for example --initial alpha=10deg"),
        (["srv02-rotpen", "--initial", "alpha"], "expected NAME=VALUE: --initial alpha=10deg"),
        (["srv02-rotpen", "--initial", "alpha=10grad"], "expected a number with its unit"),
        (["srv02-rotpen", "--initial", "alfa=10deg"], "did you mean alpha"),
        (["srv02-rotpen", "--order", "mu=2.5"], "order mu = 2.5: expected a number between 0 and 2"),
        (["srv02-rotpen", "--order", "nu=1"], "order 'nu'; the known ones are lambda, mu"),
        (["srv02-rotpen", "--set", "b_alfa=1"], "did you mean b_alpha"),
        (["srv02-rotpen", "--noise", "0.05"], "has no unit: deg or rad? Type for example --noise 0.05deg"),
        (["srv02-rotpen", "--noise", "beta=1deg"], "unknown output of rotary-pendulum 'beta'"),
        (["srv02-rotpen", "--counts", "2"], "expected counts a turn, e.g. 4096"),
        (["srv02-rotpen", "--method", "rk4"], "There is no method 'rk4'; type one of"),
        (["srv02-rotpen", "--step", "0"], "step = 0.0: expected a number above 0"),
        (["srv02-rotpen", "--step", "1e-12"], "samples are not possible; expected at most"),
        (["srv02-rotpen", "--to", "twin.xls"], "expected a file that ends in .csv, .mat, .npz"),
        (["srv02-rotpen", "--recording", "swing"], "--recording is for a project or a run"),
        (["rig.toml", "--recording", "drivn"], "did you mean driven"),
        (["rig.toml", "--zero", "upright"], "--zero is for a rig"),
        (["srv02-rotpen", "--to", "swing.csv"], "swing.csv is there already; give another name, or write over it"),
    ],
)
def test_a_callers_mistake_is_a_sentence_that_says_what_to_type(
    capsys, two_recordings, monkeypatch, arguments, message
):
    monkeypatch.chdir(two_recordings)
    code, out, err = run(capsys, "simulate", *arguments, "--end", "0.1")
    assert (code, out) == (2, "")
    assert message in err


def test_a_simulation_that_runs_away_exits_3_and_writes_nothing(capsys, tmp_path):
    code, out, err = run(capsys, "simulate", "srv02-rotpen", "--set", "b_alpha=-0.1", "--to", tmp_path / "twin.csv")
    assert (code, out) == (3, "")
    assert "did not reach its end: at t = " in err
    assert "unsettled" in err
    assert not any(tmp_path.iterdir())


@pytest.mark.broad
def test_a_step_that_is_too_long_above_order_one_is_refused_with_the_method_that_helps(capsys, tmp_path):
    stiff = ("simulate", "qube-servo2", "--order", "mu=1.05", "--set", "b_alpha=1", "--end", 10, "--step", "10ms")
    code, out, err = run(capsys, *stiff, "--to", tmp_path / "twin.csv")
    assert (code, out) == (3, "")
    assert "Type --method bdf2, or a step of" in err
    assert not any(tmp_path.iterdir())
    code, out, err = run(capsys, *stiff, "--to", tmp_path / "twin.csv", "--method", "bdf2")
    assert (code, err) == (0, "")
    assert "bdf2, memory" in out


def test_a_step_that_spoils_a_completed_simulation_is_said(capsys, tmp_path):
    code, _, err = run(capsys, "simulate", "qube-servo2", "--end", 2, "--step", "40ms", "--to", tmp_path / "twin.csv")
    assert code == 0
    assert "20 are too few" in " ".join(err.split())


def test_the_papers_scheme_is_warned_of(capsys, tmp_path):
    code, _, err = run(
        capsys, "simulate", "srv02-rotpen", "--method", "gl-paper", "--end", 1, "--to", tmp_path / "twin.csv"
    )
    assert code == 0
    assert "gl-paper sums raw x (21)-(24)" in err


@pytest.mark.parametrize(
    ("text", "value"), [("10deg", np.pi / 18), ("-2 °/s", -np.pi / 90), ("0.5turn", np.pi), ("2ms", 2e-3), (".5", 0.5)]
)
def test_a_quantity_is_read_with_its_unit(text, value):
    assert quantity(text, "--x") == pytest.approx(value)


def test_a_step_that_is_too_long_is_answered_with_an_option_of_the_command_line(capsys, tmp_path):
    words = ["simulate", "srv02-rotpen", "--friction", "--initial", "alpha=60deg", "--step", 4, "--end", 20]
    code, _, err = run(capsys, *words, "--to", tmp_path / "twin.csv")
    assert code == 3
    assert "Type --method bdf2, or a step of" in err
