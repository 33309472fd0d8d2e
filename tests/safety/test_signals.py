"""SIGTERM and SIGHUP end a run in a sentence, at any stage, and what was done is gone on with."""

import json
import os
import signal
import subprocess
import sys

import numpy as np
import pytest

from fracid.tasks import ending
from program import RELEASE
from twins import write_release

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="SIGHUP")

PROJECT = """
[model]
name = "rotary-pendulum"
rig = "srv02-rotpen"
[model.orders]
lambda = { start = 1.0, lower = 0.6, upper = 1.2 }
mu = { start = 1.0, lower = 0.6, upper = 1.2 }
[[recording]]
file = "swing.npz"
theta = { column = "theta" }
alpha = { column = "alpha" }
[fit]
initial_state = "rest"
"""

ENDED = """
import os, signal, sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
import fracid.identification as stages, fracid.workflows.figures as figures
from fracid.cli import main
stage, name, submit = sys.argv[1], sys.argv[2], ProcessPoolExecutor.submit
def here(where):
    if where == stage:
        os.kill(os.getpid(), getattr(signal, name))
given, draw = stages.unless_given, figures.Drawing.__call__
def hears(observer):
    watching = given(observer)
    def begins(name):
        here(name)
        watching.stage(name)
    return replace(watching, stage=begins)
def draws(*what):
    here("figures")
    return draw(*what)
def submits(pool, *what):
    future = submit(pool, *what)
    here("start of a process")
    return future
stages.unless_given, figures.Drawing.__call__, ProcessPoolExecutor.submit = hears, draws, submits
if __name__ == "__main__":
    main(["fit", "rig.toml", "--out", "run", "--jobs", "2"])
"""


@pytest.fixture(autouse=True)
def _not_ignored():
    """As in a terminal, also where these tests run under nohup, whose SIG_IGN every child inherits."""
    before = {number: signal.signal(number, signal.SIG_DFL) for number in map(signal.Signals.__getitem__, ending.NAMES)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def heard(monkeypatch):
    """The signals that would have ended this process."""
    numbers = []
    monkeypatch.setattr(ending, "_end", numbers.append)
    monkeypatch.setattr(ending, "_LATE", [])
    return numbers


@pytest.mark.parametrize("name", ending.NAMES)
def test_a_signal_ends_at_once_and_waits_for_a_process_that_is_being_started(heard, name):
    number = getattr(signal, name)
    with ending.ended_in_a_sentence():
        os.kill(os.getpid(), number)
        assert heard == [number]
        with ending.undisturbed():
            os.kill(os.getpid(), number)
            assert heard == [number]
        assert heard == [number, number]
    assert signal.getsignal(number) is signal.SIG_DFL


def test_a_signal_that_is_ignored_stays_ignored(heard):
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
    try:
        with ending.ended_in_a_sentence():
            os.kill(os.getpid(), signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)
    assert heard == []


@pytest.mark.broad
@pytest.mark.parametrize(
    ("name", "stage"),
    [("SIGTERM", "start of a process"), ("SIGTERM", "search"), ("SIGHUP", "intervals"), ("SIGHUP", "figures")],
)
def test_a_fit_ended_at_any_stage_says_so_in_a_sentence_and_goes_on(name, stage, tmp_path):
    write_release(tmp_path / "swing.npz", orders={"lambda": 1.0, "mu": 1.0}, alpha=0.3, step=0.01, end=2.0, noise=1e-3)
    (tmp_path / "rig.toml").write_text(PROJECT)
    (tmp_path / "ended.py").write_text(ENDED)
    ended = subprocess.run(
        [sys.executable, "ended.py", stage, name], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert ended.returncode == -getattr(signal, name)
    resumed, run = "What was done is kept. To resume, type the same again, or fracid resume", tmp_path / "run"
    begun = f". {resumed} {run}." if stage != "start of a process" else " before anything was written"
    assert f"error: {name} ended this{begun}" in ended.stderr
    assert run.exists() == (resumed in ended.stderr)
    assert "Traceback" not in ended.stderr
    assert "leaked" not in ended.stderr
    command = [sys.executable, "-m", "fracid", "fit", "rig.toml", "--out", "run"]  # the same, whatever is there by then
    again = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (again.returncode, "Traceback" in again.stderr) == (0, False)
    assert json.loads((tmp_path / "run" / "result.json").read_text())["outcome"].startswith("converged")


OUTPUTS = {
    "full": ("{fracid} > /dev/full", {}, 1),
    "full, as JSON": ("{fracid} --json > /dev/full", {}, 1),
    "closed": ("{fracid} >&-", {}, 0),
    "closed, errors too": ("{fracid} >&- 2>&-", {}, 0),
    "a pipe whose reader is gone": ("set -o pipefail; {fracid} | true", {}, 1),
    "without Greek": ("{fracid}", {"PYTHONIOENCODING": "ascii"}, 0),
    "of the C locale": ("{fracid} --json", {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}, 0),
}


@pytest.mark.few(1)
@pytest.mark.parametrize("kind", OUTPUTS)
def test_output_that_cannot_be_written_ends_no_work_and_is_no_fault_of_fracid(kind, tmp_path):
    words, environment, code = OUTPUTS[kind]
    (tmp_path / "swing.csv").write_text("t,alpha [°]\n" + "".join(f"{k / 100},{(k // 9) % 2}\n" for k in range(99)))
    words = words.format(fracid=f"{sys.executable} -m fracid check swing.csv")
    ended = subprocess.run(["bash", "-c", words], cwd=tmp_path, env=os.environ | environment, capture_output=True,
                           text=True, check=False)  # fmt: skip
    assert (ended.returncode, "Traceback" in ended.stderr, "fault" in ended.stderr) == (code, False, False)
    assert ("No space left on device" in ended.stderr) == ("full" in kind)
    assert json.loads(ended.stdout)["name"] == "swing" if "locale" in kind else True
    assert ("alpha [\\u00b0]" in ended.stdout) == (kind == "without Greek")


@pytest.mark.broad
def test_a_fit_whose_output_finds_no_room_is_written_to_its_end(tmp_path):
    time = np.arange(0, 2, 0.02)
    noise = 1e-3 * np.random.default_rng(1).standard_normal(time.size)
    np.savetxt(tmp_path / "swing.csv", np.column_stack([time, 0 * time, 0.35 * np.cos(8 * time) + noise]),
               delimiter=",", header="time,theta,alpha", comments="")  # fmt: skip
    (tmp_path / "rig.toml").write_text(RELEASE)
    words = f"{sys.executable} -m fracid fit rig.toml --out run > /dev/full"
    ended = subprocess.run(["bash", "-c", words], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (ended.returncode, "Traceback" in ended.stderr) == (1, False)
    assert json.loads((tmp_path / "run" / "run.json").read_text())["finished"]
    assert (tmp_path / "run" / "report.html").exists()


def prints_and_ends(done):
    with ending.quiet_when_closed():
        sys.stdout.write("the result\n")
        sys.stdout.flush()
        done.append("the report")
        sys.exit(0)


def test_work_goes_on_to_its_end_when_the_reader_of_its_output_is_gone(monkeypatch):
    reader, writer = os.pipe()
    os.close(reader)
    done = []
    with os.fdopen(writer, "w") as nobody:
        monkeypatch.setattr(sys, "stdout", nobody)
        with pytest.raises(SystemExit, match="1"):
            prints_and_ends(done)
        assert sys.stdout is nobody
    assert done == ["the report"]
