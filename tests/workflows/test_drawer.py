"""The process beside a fit: what it has not begun, this one does; and it draws without the solver."""

import errno
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

import fracid
from fracid.estimation.cost_plane import CostPlane
from fracid.estimation.records import RecordingFit
from fracid.validation.residual_analyses import analysed
from fracid.workflows.drawer import Drawer, drawer
from fracid.workflows.figures import Drawing, of_recordings, saved

pytestmark = pytest.mark.usefixtures("without_rivals")


def its_process(_, seconds=0.0):
    time.sleep(seconds)
    return os.getpid()


def modules_with(*_material):
    return [name for name in ("numba", "fracid.solver.solve", "fracid.problem.problem") if name in sys.modules]


@pytest.mark.broad
def test_what_the_process_beside_has_not_begun_is_done_here():
    with drawer(2) as beside:
        answers = [beside.asked(its_process, n, 0.3) for n in range(6)]
        processes = [answer() for answer in reversed(answers)]
    here = os.getpid()
    assert processes[0] == here, "the last is not begun by the time it is asked for"
    assert processes[-1] != here, "the first is"
    assert len(set(processes)) == 2


@pytest.mark.broad
def test_who_is_patient_waits_for_the_process_beside_with_what_it_has_not_begun():
    with drawer(2) as beside:
        answers = [beside.asked(its_process, n, 0.2) for n in range(3)]
        assert [answer.waits for answer in answers[1:]] == [True, True]
        processes = {answer(patient=True) for answer in reversed(answers)}
    assert len(processes) == 1
    assert os.getpid() not in processes
    assert not any(answer.waits for answer in answers)
    assert Drawer(None).asked(its_process, None)(patient=True) == os.getpid()


@pytest.mark.broad
def test_the_process_beside_imports_no_solver_to_draw():
    material = fracid.rotary_pendulum(), CostPlane, RecordingFit, analysed, saved, of_recordings
    with drawer(2) as beside:
        assert beside.pool.submit(modules_with, *material).result() == []


@pytest.mark.broad
def test_what_a_killed_process_leaves_undone_is_done_here():
    with drawer(2) as beside:
        process = beside.asked(its_process, None)
        answers = [beside.asked(its_process, n, 0.5) for n in range(4)]
        os.kill(next(iter(beside.pool._processes)), signal.SIGKILL)
        assert {answer() for answer in reversed(answers)} == {os.getpid()}
        assert beside.asked(its_process, None)() == process() == os.getpid()


def broken_pipe(*_, **__):
    raise BrokenPipeError(errno.EPIPE, "Broken pipe")


@pytest.mark.parametrize("where", ["queues.SimpleQueue", "process.BaseProcess.start"])
def test_where_no_process_can_be_started_all_is_done_here(monkeypatch, where):
    monkeypatch.setattr(f"multiprocessing.{where}", broken_pipe)
    with drawer(2) as beside:
        assert beside.asked(its_process, None)() == os.getpid()


def test_what_leads_the_process_beside_has_ended_before_the_program_may():
    with drawer(2) as beside:
        manager = beside.pool._executor_manager_thread
        assert manager.is_alive()
    assert not manager.is_alive(), "an exit meanwhile would print a traceback: Bad file descriptor"


class Pool:
    """Does at once what it is given."""

    def __init__(self):
        self.given = []

    def submit(self, work, *what):
        self.given.append((work.__name__, what))
        future = Future()
        future.set_result(work(*what))
        return future


def test_what_waits_is_taken_back():
    busy, end = threading.Event(), threading.Event()
    with ThreadPoolExecutor(1) as giver:
        giver.submit(lambda: busy.set() or end.wait())
        busy.wait()
        beside = Drawer(Pool(), giver)
        waiting = [beside.asked(str, n) for n in range(3)]
        waiting[0].drop()
        assert waiting[1]() == "1"
        end.set()
    assert beside.pool.given == [("str", (2,))]


@pytest.mark.broad
def test_a_recording_is_drawn_while_a_minimum_is_examined_and_again_only_where_a_lower_one_is_found(tmp_path):
    time = np.arange(0, 1, 0.01)
    swing = np.cos(6 * time)
    recordings = {n: RecordingFit(n, "fit", time, {"alpha": swing}, {"alpha": 0.9 * swing}, 0.1, {}, {}) for n in "ab"}
    project = type("Loaded", (), {"resolutions": {n: {} for n in recordings}})
    drawing = Drawing(project, tmp_path, 1, None, Drawer(Pool()))

    def given():
        drawing.drawer.giver.submit(int).result()  # after all that was asked for before
        return [name for name, _ in drawing.drawer.pool.given]

    drawing.begin(recordings)
    first = [*["analysed"] * 2, *["saved"] * 4]  # the page waits for what is tested
    assert given() == first
    figures = {p.name for p in (tmp_path / "figures").glob("*.svg")}
    assert figures == {f"figure{k}.svg" for k in ("2-a", "3-a-alpha", "2-b", "3-b-alpha")}
    examined = {n: replace(r, parameters={"b": None}) for n, r in recordings.items()}
    assert drawing._of_recordings(examined)[0].residuals()["a"]["alpha"].samples == 100
    assert given() == first
    drawing._of_recordings(examined | {"a": replace(recordings["a"], fitted={"alpha": swing}, cost=0.0)})
    assert given() == [*first, "analysed", "saved", "saved"]


SCRIPT = """
from fracid.workflows.drawer import drawer
print("begins")
with drawer(2) as beside:
    print(beside.asked(len, "alpha")())
"""


@pytest.mark.broad
def test_a_script_without_a_guard_begins_once(tmp_path):
    (tmp_path / "script.py").write_text(SCRIPT)
    done = subprocess.run([sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == ("begins\n5\n", "")
