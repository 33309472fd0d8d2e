"""The process beside a fit: what it has not begun, this one does; and it draws without the solver."""

import os
import signal
import sys
import time

import pytest

import fracid
from fracid.estimation.cost_plane import CostPlane
from fracid.estimation.records import RecordingFit
from fracid.validation.residual_analyses import analysed
from fracid.workflows.drawer import drawer
from fracid.workflows.figures import _draw_recording


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
def test_the_process_beside_imports_no_solver_to_draw():
    material = fracid.rotary_pendulum(), CostPlane, RecordingFit, analysed, _draw_recording
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


def test_what_leads_the_process_beside_has_ended_before_the_program_may():
    with drawer(2) as beside:
        manager = beside.pool._executor_manager_thread
        assert manager.is_alive()
    assert not manager.is_alive(), "an exit meanwhile would print a traceback: Bad file descriptor"
