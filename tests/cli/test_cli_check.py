"""``fracid check``: table, verdict, JSON, figure, exit codes."""

import json
import subprocess
import sys

import numpy as np
import pytest

from program import run

T = np.arange(600) / 100
SWING = np.where(T < 1, 40, 40 * np.cos(5 * (T - 1)) * np.exp(-2 * (T - 1)))


@pytest.fixture
def swing(tmp_path):
    file = tmp_path / "swing.csv"
    file.write_text("t,alpha [deg]\n" + "".join(f"{t:.2f},{a:.3f}\n" for t, a in zip(T, SWING, strict=True)))
    return file


def test_a_good_recording_gets_a_table_a_sketch_and_a_verdict(capsys, swing):
    code, out, err = run(capsys, "check", swing)
    assert (code, err) == (0, "")
    assert "100 Hz (step 10 ms)" in out
    assert "… 40°" in out
    assert "alpha [deg] is in deg, as the header says." in out
    assert "good: 600 samples, 5.99 s at 100 Hz, released at 0.99" in out
    assert any(0x2800 < ord(c) < 0x2900 for c in out)


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("columns", "command"),
    [((), "--column alpha=0,unit=rad"), (("--column", "alpha=0,unit=deg"), "--column alpha=0,unit=rad")],
    ids=["no unit is given", "it hardly swings in degrees"],
)
def test_an_angle_in_doubt_is_shown_as_in_the_file_with_the_command_that_names_its_unit(
    capsys, tmp_path, columns, command
):
    np.savetxt(tmp_path / "swing.csv", 0.3 * np.cos(0.05 * np.arange(600)) * np.exp(-np.arange(600) / 300))
    code, out, _ = run(capsys, "check", tmp_path / "swing.csv", "--rate", 100, *columns)
    assert code == 0
    assert "°" not in next(line for line in out.splitlines() if "… 0.3" in line)
    assert f"fracid check {tmp_path / 'swing.csv'} {command} --rate 100" in out


def test_frames_as_time_lead_to_the_rate_and_with_it_are_no_signal(capsys, tmp_path):
    file, k = tmp_path / "video.csv", np.arange(330)
    angle = np.where(k < 30, 40, 40 * np.cos(7 * (k - 30) / 30) * np.exp(-(k - 30) / 300))
    np.savetxt(file, np.column_stack([k, angle]), "%.3f", ",", header="frame,angle [deg]", comments="")
    code, out, _ = run(capsys, "check", file)
    assert code == 0
    assert "does its time count samples" in out
    assert f"fracid check {file} --rate HZ" in out
    assert "unit=ms" not in out
    code, out, _ = run(capsys, "check", file, "--rate", 30)
    assert code == 0
    assert "signals are 'angle [deg]'" in out
    assert "good: 330 samples, 10.97 s at 30 Hz, released at 0.967 s" in out


def test_a_unit_that_nobody_knows_is_shown_as_in_the_file(capsys, tmp_path):
    np.savetxt(tmp_path / "video.csv", np.column_stack([T, 640 + 10 * SWING, 200 + SWING**2]), "%.3f", ",",
               header="t,x [px],y [px]", comments="")  # fmt: skip
    code, out, _ = run(capsys, "check", tmp_path / "video.csv")
    assert code == 0
    assert "… 1040 " in next(line for line in out.splitlines() if line.startswith("x [px]"))
    assert "x [px]: what the header says of it, 'px', is no unit here: taken as a number." in out


def test_the_columns_of_a_joint_are_checked_as_init_takes_them(capsys, tmp_path):
    file, t = tmp_path / "joint.csv", np.arange(0, 8, 4e-3)
    table = np.column_stack([t, 5 * np.sin(t), 5 * np.cos(t), 0.6 * np.sin(2 * t)])
    np.savetxt(file, table, "%.5f", ",", header="t,q,qd,tau", comments="")
    code, out, _ = run(capsys, "check", str(file))
    assert code == 0
    assert "angle is taken from 'q', in radians, as nothing says otherwise." in out
    assert "torque  -0.6 … 0.6 N m" in out
    assert [word for word in ("pendulum", "alpha", "theta", "qd") if word in out] == []
    next_ = out.replace("\n", " ").split("next")[1]
    assert "writes a project of the model joint" in " ".join(next_.split())


def test_json_is_all_that_stands_on_standard_output(capsys, swing):
    code, out, err = run(
        capsys, "check", swing, "--column", "alpha=1,unit=deg,sign=-1,zero=rest", "--time", 0, "--json"
    )
    content = json.loads(out)
    assert (code, err) == (0, "")
    assert content["level"] == "good"
    assert content["step"] == pytest.approx(0.01)
    assert content["signals"]["alpha"]["minimum"] == pytest.approx(-np.radians(40), rel=1e-3)
    assert len(content["sha256"]) == 64


def test_the_figure_is_written_where_out_says(capsys, swing, tmp_path):
    code, out, _ = run(capsys, "check", swing, "--out", tmp_path / "new" / "folder")
    assert code == 0
    figure = tmp_path / "new" / "folder" / "swing.png"
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert "swing.png" in out


def test_from_and_to_cut_a_part_out(capsys, swing):
    _, out, _ = run(capsys, "check", swing, "--from", "release", "--to", 3, "--json")
    assert json.loads(out)["clock"]["duration"] == pytest.approx(2, abs=0.05)


def test_a_signal_that_is_measured_now_and_then_may_be_an_output(capsys, tmp_path):
    time = np.arange(200)
    rows = [f"{t},{np.sin(t / 9):.4f},{np.cos(t / 9) if t % 20 == 0 else ''}" for t in time]
    (tmp_path / "assays.csv").write_text("\n".join(["t,T [K],c [1]", *rows]))
    code, out, _ = run(capsys, "check", tmp_path / "assays.csv")
    assert "c [1] misses 190 samples, at most 19 in a row (95 %): as an output it is scored where it has samples" in out
    assert (code, "usable: 200 samples" in out) == (0, True)


def test_an_unfit_recording_is_shown_and_exits_3(capsys, tmp_path):
    file = tmp_path / "holes.csv"
    file.write_text("t,alpha\n0,1\n1,\n2,3\n3,5\n")
    code, out, _ = run(capsys, "check", file)
    assert code == 3
    assert "unfit: 4 samples are too few to identify a model from: record 50 or more\n" in out
    code, out, _ = run(capsys, "check", file, "--json", "--out", tmp_path)
    assert code == 3
    assert json.loads(out)["level"] == "unfit"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--column", "alpha"], "--column 'alpha' is not possible; expected NAME=COLUMN"),
        (["--column", "alpha=9"], "has no column 9"),
        (["--column", "alpha=1,unit=grad"], "unit = 'grad' is not possible"),
        (["--column", "alpha=1,colour=red"], "unknown field of alpha 'colour'"),
        (["--rate", "100", "--time", "0"], "give --time or --rate, not both"),
        (["--rate", "-1"], "rate = -1.0 is not possible"),
        (["--from", "later"], "--from 'later' is not possible"),
        (["--from", "90"], "holds 0 samples"),
        (["--variable", "x"], "leave out the variable 'x'"),
        (["--rate", "fast"], "--rate"),
        (["--nonsense"], "nonsense"),
    ],
)
def test_a_callers_mistake_is_a_sentence_and_exits_2(capsys, swing, arguments, message):
    code, out, err = run(capsys, "check", swing, *arguments)
    assert (code, out) == (2, "")
    assert message in err
    assert "Traceback" not in err


@pytest.mark.parametrize(
    ("name", "content", "code", "message"),
    [
        ("none.csv", None, 2, "no file"),
        ("log.xyz", "1 2\n", 2, "unknown ending '.xyz'"),
        ("empty.csv", "", 3, "is empty"),
        ("text.csv", "t,a\n0,1\n1,stuck\n2,2\n", 3, "line 3, column 1 (a): 'stuck' is not a number"),
        ("broken.mat", "no mat file", 3, "broken.mat is damaged"),
        ("clockless.txt", "3\n1\n2\n", 2, "Give the rate"),
    ],
)
def test_a_file_that_cannot_be_read_is_a_sentence(capsys, tmp_path, name, content, code, message):
    if content is not None:
        (tmp_path / name).write_text(content)
    got, out, err = run(capsys, "check", tmp_path / name)
    assert (got, out) == (code, "")
    assert message in err
    assert "Traceback" not in err


def test_help_shows_a_worked_example(capsys):
    code, out, _ = run(capsys, "check", "--help")
    assert code == 0
    assert "fracid check release.mat" in out


@pytest.mark.broad
def test_check_needs_no_heavy_module(swing):
    """Matplotlib, Numba, pymoo and pandas would each break the half second."""
    code = f"""
import sys
from fracid.cli.app import main
try: main(["check", {str(swing)!r}])
except SystemExit: pass
sys.exit(",".join({{"matplotlib", "numba", "pymoo", "pandas", "scipy"}} & set(sys.modules)) or 0)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_python_m_fracid_is_the_program():
    done = subprocess.run([sys.executable, "-m", "fracid", "--version"], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("fracid ")
