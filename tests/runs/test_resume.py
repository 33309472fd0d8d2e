"""A run killed at any moment and resumed repeats nothing and ends as if it had not been killed."""

import itertools
import json
import shutil
import signal
import subprocess
import sys
import time
from contextlib import nullcontext

import numpy as np
import pytest

import fracid
from fracid.cli.app import main
from fracid.errors import InputError, Unfinished
from fracid.runs.folder import EVALUATIONS, JOURNAL, MEMO, RUN, Run, run_state
from fracid.tasks.simulation_cache import Memo
from memos import Counting
from program import leave_figures_out, no_rivals

pytestmark = pytest.mark.usefixtures("without_rivals")

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

DRIVER = """
import os, signal, sys
from contextlib import nullcontext
from pathlib import Path
import fracid.workflows.fit as workflow
import fracid.tasks.simulation_cache as memo
workflow.drawing = lambda *a: nullcontext(lambda found: ())
calls, last = 0, int(sys.argv[3])
whole = memo.append_whole
def killed_in_writing(file, content, end):
    global calls
    calls += 1
    if calls == last:  # in the middle of a record
        file.write(b"".join(content)[: int(sys.argv[4])])
        os.kill(os.getpid(), signal.SIGKILL)
    return whole(file, content, end)
memo.append_whole = killed_in_writing
workflow.run(sys.argv[1], out=sys.argv[2], jobs=2)
"""


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """A short swing and a project file beside it."""
    folder = tmp_path_factory.mktemp("project")
    rig = fracid.rotary_pendulum("srv02-rotpen")
    run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=0.01, end=3.0)
    noise = 1e-3 * np.random.default_rng(1).standard_normal((301, 2))
    theta, alpha = (run.states[:, [0, 2]] + noise).T
    np.savez(folder / "swing.npz", time=0.01 * np.arange(301), theta=theta, alpha=alpha)
    (folder / "rig.toml").write_text(PROJECT)
    return folder / "rig.toml"


@pytest.fixture(autouse=True)
def no_figures(monkeypatch):
    leave_figures_out(monkeypatch)


@pytest.fixture(autouse=True)
def memos(monkeypatch):
    """Every memo of the test, and none of them emptied because a file of the package was touched meanwhile."""
    opened = []

    class Kept(Counting):
        def __init__(self, path):
            super().__init__(path)
            opened.append(self)

    monkeypatch.setattr("fracid.workflows.fit.Memo", Kept)
    monkeypatch.setattr("fracid.tasks.simulation_cache._stamp", lambda: b"the same program")
    return opened


def fitted(project, folder, **options):
    return fracid.run(project, out=folder, **options)


def result(folder):
    """All but the timing, and the log without its clock."""
    content = json.loads((folder / "result.json").read_text())
    content.pop("timing")
    lines = map(json.loads, (folder / EVALUATIONS).read_text().splitlines())
    return content, [(line["n"], line["point"], line["cost"]) for line in lines]


@pytest.fixture(scope="module")
def whole(project, tmp_path_factory):
    """An uninterrupted run's result, and what its memo and its log were at the end."""
    folder, patch = tmp_path_factory.mktemp("whole") / "run", pytest.MonkeyPatch()
    kept, finish = {}, Run.finish

    def copy(run):
        kept.update({name: (run.folder / name).read_bytes() for name in (MEMO, EVALUATIONS)})
        finish(run)

    leave_figures_out(patch)
    patch.setattr("fracid.tasks.simulation_cache._stamp", lambda: b"the same program")
    patch.setattr("fracid.runs.folder.Run.finish", copy)
    with no_rivals():
        fitted(project, folder)
    patch.undo()
    return result(folder), kept, folder


# --- fits --------------------------------------------------------------------------------------------


def test_a_finished_run_leaves_no_memo_and_says_that_there_is_nothing_to_do(whole, capsys):
    _, kept, folder = whole
    assert kept[MEMO]
    assert not (folder / MEMO).exists()
    with pytest.raises(SystemExit) as end:
        main(["resume", str(folder)])
    assert end.value.code == 0
    assert "is finished; its result is" in capsys.readouterr().out


@pytest.mark.broad
def test_a_clock_that_jumps_about_changes_nothing(project, whole, tmp_path, monkeypatch):
    jumps = itertools.cycle([-86_400.0, 3_600.0, -1e9, 86_400.0])
    real = time.time
    monkeypatch.setattr("time.time", lambda: real() + next(jumps))
    folder = tmp_path / "run"
    fitted_until(2, project, folder)
    fitted(project, folder, resume=True)
    assert result(folder) == whole[0]
    assert json.loads((folder / "result.json").read_text())["timing"]["total"] > 0


@pytest.mark.few(1)
@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(k, marks=pytest.mark.broad) for k in range(2, 8))])
def test_a_fit_cut_off_anywhere_ends_the_same_and_simulates_nothing_twice(project, whole, memos, tmp_path, seed):
    rng, (uncut, files, _) = np.random.default_rng(seed), whole
    folder = tmp_path / "run"
    fitted_until(1, project, folder)
    for name, content in files.items():  # each as far as it may have come
        (folder / name).write_bytes(content[: rng.integers(16, len(content))])
    with Memo(folder / MEMO) as memo:
        known = len(memo._places)
    fitted(project, folder, resume=True)
    assert result(folder) == uncut
    assert known + memos[-1].computed == simulations(files[MEMO], tmp_path)


def simulations(content, folder):
    (folder / "memo").write_bytes(content)
    with Memo(folder / "memo") as memo:
        return len(memo._places)


def fitted_until(evaluations, project, folder):
    """Ctrl-C after so many."""

    def tell(progress):
        if progress.done >= evaluations:
            raise KeyboardInterrupt

    return fitted(project, folder, observer=fracid.Observer(progress=lambda _: nullcontext(tell)))


@pytest.mark.broad
@pytest.mark.parametrize("evaluations", [1, 20])
def test_a_fit_ended_by_ctrl_c_can_be_gone_on_with(project, whole, tmp_path, evaluations):
    ran = fitted_until(evaluations, project, tmp_path / "run")
    assert ran.interrupted
    assert not run_state(tmp_path / "run").finished
    fitted(project, tmp_path / "run", resume=True, jobs=2)
    assert result(tmp_path / "run") == whole[0]
    assert run_state(tmp_path / "run").finished


@pytest.mark.broad
@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL")
def test_a_fit_killed_in_the_middle_of_a_record_ends_the_same(project, whole, tmp_path, monkeypatch):
    rng = np.random.default_rng(5)
    folders = [tmp_path / f"run{i}" for i in range(2)]
    started = []
    for folder in folders:
        words = [project, folder, rng.integers(3, 120), rng.integers(1, 4000)]
        started.append(subprocess.Popen([sys.executable, "-c", DRIVER, *map(str, words)]))
    assert [process.wait() for process in started] == [-signal.SIGKILL] * 2
    monkeypatch.undo()
    leave_figures_out(monkeypatch)
    for folder in folders:
        fitted(project, folder, resume=True)
        assert result(folder) == whole[0]


@pytest.mark.broad
def test_a_log_that_was_cut_off_and_a_memo_of_another_program_are_told(project, whole, tmp_path, monkeypatch):
    fitted_until(20, project, tmp_path / "run")
    log = tmp_path / "run" / EVALUATIONS
    log.write_bytes(log.read_bytes()[:-7])
    said = []
    fitted(project, tmp_path / "run", resume=True, jobs=2, observer=fracid.Observer(said.append))
    assert len(said) == 1
    assert "was cut off in writing; it is written again" in said[0]
    assert result(tmp_path / "run") == whole[0]
    fitted_until(20, project, tmp_path / "run")
    monkeypatch.setattr("fracid.tasks.simulation_cache._stamp", lambda: b"another program!")
    fitted(project, tmp_path / "run", resume=True, observer=fracid.Observer(said.append))
    assert "cannot be used: the program has changed, or the machine was restarted" in said[-1]
    assert result(tmp_path / "run") == whole[0]


@pytest.mark.broad
@pytest.mark.parametrize("where", ["runs/rig", "rig"])
def test_a_project_and_its_run_that_were_moved_together_are_gone_on_with(project, whole, tmp_path, where):
    old, new = tmp_path / "old", tmp_path / "new"
    shutil.copytree(project.parent, old)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Memo, "keep", _cut_after(40))
        with pytest.raises(Unfinished):
            fracid.run(old / "rig.toml", out=old / where)
    old.rename(new)
    (new / "other").mkdir()
    (new / "other" / "rig.toml").write_text("# another of that name")
    finished = fracid.resume_run(new / where)
    assert finished.resumed
    assert finished.project.path == new / "rig.toml"
    assert run_state(new / where).finished


def _cut_after(calls):
    """A memo whose disk is full after so many simulations."""
    keep = Memo.keep

    def limited(self, *arguments):
        nonlocal calls
        calls -= 1
        if calls < 0:
            raise Unfinished("the disk is full")
        return keep(self, *arguments)

    return limited


@pytest.mark.broad
def test_a_changed_recording_is_not_gone_on_with(project, tmp_path):
    fitted_until(5, project, tmp_path / "run")
    swing = project.parent / "swing.npz"
    before = swing.read_bytes()
    with np.load(swing) as arrays:
        np.savez(swing, **{**arrays, "alpha": arrays["alpha"] + 1e-9})
    try:
        with pytest.raises(InputError, match=r"the recording 'swing' has changed since\. Put it back, or begin again"):
            fitted(project, tmp_path / "run", resume=True)
    finally:
        swing.write_bytes(before)


@pytest.mark.parametrize(
    ("make", "words", "message"),
    [
        (lambda f: None, [], "has no run.json that can be read: it is no run folder"),
        (lambda f: (f / RUN).write_text('{"options": {}'), [], "run.json is damaged: it cannot be read as JSON"),
        (lambda f: state(f), ["--executor", "processes"], "leave --executor and --scheduler out"),
        (lambda f: (f / JOURNAL).touch(), [], "has no record of its command: type that again, with --out"),
    ],
)
def test_what_cannot_be_gone_on_with_is_a_sentence(tmp_path, capsys, make, words, message):
    make(tmp_path)
    with pytest.raises(SystemExit) as end:
        main(["resume", str(tmp_path), *words])
    assert end.value.code == 2
    assert message in capsys.readouterr().err


def state(folder):
    (folder / RUN).write_text(json.dumps({"options": {"project": "rig.toml"}, "inputs": {}, "finished": False}))


# --- studies -----------------------------------------------------------------------------------------


@pytest.mark.broad
def test_a_studys_command_is_typed_again_where_it_was_typed(project, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "study"
    folder.mkdir()
    (folder / JOURNAL).touch()
    words = ["noise", project.name, "--levels", "0.05", "--counts", "4096", "--seeds", "2", "--out", "elsewhere"]
    (folder / "environment.json").write_text(json.dumps({"command": words, "directory": str(project.parent)}))
    with pytest.raises(SystemExit) as end:
        main(["resume", str(folder), "--json"])
    assert end.value.code == 0
    assert json.loads(capsys.readouterr().out)["seeds"] == 2
    assert (folder / "noise.json").exists()
    assert not (project.parent / "elsewhere").exists()


def test_a_studys_exit_code_is_that_of_its_command(tmp_path, capsys):
    (tmp_path / JOURNAL).touch()
    said = {"command": ["noise", "missing.toml"], "directory": str(tmp_path)}
    (tmp_path / "environment.json").write_text(json.dumps(said))
    with pytest.raises(SystemExit) as end:
        main(["resume", str(tmp_path)])
    assert end.value.code == 2
    assert "missing.toml" in capsys.readouterr().err


# --- the program itself ------------------------------------------------------------------------------


@pytest.mark.slow(minutes=5)
def test_killed_at_twenty_random_moments_and_resumed_each_time_the_results_are_identical(project, tmp_path):
    rng = np.random.default_rng(20)
    words = [str(project), "--multi-start", "3"]

    def fracid_program(*words):
        return subprocess.Popen([sys.executable, "-m", "fracid", *words], stdout=subprocess.DEVNULL)

    for folder in ("warm", "whole"):  # the first may compile, which would put the kills after the ends
        began = time.monotonic()
        assert fracid_program("fit", *words, "--out", str(tmp_path / folder)).wait() == 0
        duration = time.monotonic() - began
    kills = runs = 0
    while kills < 20 and runs < 60:
        runs += 1
        folder = tmp_path / f"run{runs}"
        process = fracid_program("fit", *words, "--out", str(folder))
        while True:
            time.sleep(rng.uniform(0.1, 0.9) * duration)
            kills += process.poll() is None
            process.kill()
            process.wait()
            if not (folder / RUN).exists():  # before it began
                process = fracid_program("fit", *words, "--out", str(folder))
            elif not run_state(folder).finished:
                process = fracid_program("resume", str(folder))
                if rng.random() < 0.5:
                    assert process.wait() == 0
                    break
            else:
                break
        assert result(folder) == result(tmp_path / "whole")
        assert {p.name for p in (folder / "figures").iterdir()} == {
            p.name for p in (tmp_path / "whole" / "figures").iterdir()
        }
    assert kills >= 20


@pytest.mark.slow
def test_a_study_killed_again_and_again_ends_the_same_and_does_no_repetition_twice(project, tmp_path):
    rng = np.random.default_rng(4)
    words = ["noise", str(project), "--levels", "0.05,0.2", "--counts", "4096", "--seeds", "40"]

    def program(*words):
        return subprocess.Popen([sys.executable, "-m", "fracid", *words], stdout=subprocess.DEVNULL)

    assert program(*words, "--executor", "threads", "--out", str(tmp_path / "whole")).wait() == 0
    folder, kills = tmp_path / "run", 0
    process = program(*words, "--executor", "processes", "--out", str(folder))
    while process.poll() is None:
        before = done(folder)
        while process.poll() is None and done(folder) < before + rng.integers(5, 25):
            time.sleep(0.02)
        if process.poll() is None:
            kills += 1
            process.kill()
            process.wait()
            process = program("resume", str(folder), "--executor", str(rng.choice(["threads", "processes"])))
    assert process.returncode == 0
    assert kills >= 3
    assert (folder / "noise.json").read_bytes() == (tmp_path / "whole" / "noise.json").read_bytes()
    keys = [json.loads(line)["key"] for line in (folder / JOURNAL).read_text().splitlines()[1:]]
    assert len(keys) == len(set(keys)) == 80


def done(folder):
    """Whole lines of the journal."""
    return (folder / JOURNAL).read_bytes().count(b"\n") if (folder / JOURNAL).exists() else 0
