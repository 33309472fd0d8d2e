"""A process beside compiles the start of a run, where the machine has none; whatever happens to it costs time alone."""

import concurrent.futures
import os
import subprocess
import sys
import time

import pytest

from fracid.solver import starting
from fracid.workflows.compilation import compiling_beside


@pytest.fixture
def nothing_kept(monkeypatch):
    """As on a new machine: the start is not on disk."""
    monkeypatch.setattr(starting.start_together, "can_be_kept", lambda: True)


@pytest.fixture
def no_process(monkeypatch):
    monkeypatch.setattr(concurrent.futures, "ProcessPoolExecutor", lambda *_: pytest.fail("a process was started"))


def die():
    os._exit(1)


@pytest.mark.broad
def test_a_process_beside_that_dies_ends_the_waiting_for_it(nothing_kept, monkeypatch):
    monkeypatch.setattr("fracid.workflows.compilation._compile", die)
    with compiling_beside("pi2", 2):
        began = time.monotonic()
        starting.start_together.beside()
        assert time.monotonic() - began < 20
    assert starting.start_together.beside is None


@pytest.mark.usefixtures("nothing_kept")
@pytest.mark.parametrize("where", ["queues.SimpleQueue", "process.BaseProcess.start"])
def test_where_no_process_can_be_started_this_one_compiles(monkeypatch, where):
    monkeypatch.setattr(f"multiprocessing.{where}", lambda *_, **__: os.open("/nowhere", os.O_RDONLY))
    with compiling_beside("pi2", 2):
        assert starting.start_together.beside is None


@pytest.mark.usefixtures("no_process", "nothing_kept")
@pytest.mark.parametrize(("method", "jobs"), [("pi2", 1), ("gl", 2)])
def test_one_job_and_a_method_without_a_start_begin_no_process(method, jobs):
    with compiling_beside(method, jobs):
        assert starting.start_together.beside is None


@pytest.mark.usefixtures("no_process")
def test_what_is_on_disk_is_compiled_by_nobody():
    starting.start_together.compiled()
    with compiling_beside("pi2", 2):
        assert starting.start_together.beside is None


COLD = """
from fracid.solver.starting import start_together
from fracid.workflows.compilation import compiling_beside
if __name__ == "__main__":
    with compiling_beside("pi2", 2):
        start_together.beside()
    print(sum(start_together.compiled().stats.cache_hits.values()))
"""


@pytest.mark.slow
def test_what_the_process_beside_compiled_is_taken_from_disk(tmp_path):
    (tmp_path / "cold.py").write_text(COLD)
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    ended = subprocess.run([sys.executable, tmp_path / "cold.py"], env=environment, capture_output=True, text=True)
    assert (ended.stdout, ended.stderr) == ("1\n", "")
