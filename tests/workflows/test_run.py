"""From Python the folders are those of the commands; what is written of a call makes sense in a shell."""

import errno
import json
import os
import shutil
import time
from contextlib import nullcontext
from datetime import datetime
from itertools import cycle
from types import SimpleNamespace

import numpy as np
import pytest

import fracid
import program
import twins
from fracid.errors import InputError
from fracid.workflows import figures
from fracid.workflows.fit import _short_of_room
from program import RELEASE

pytestmark = pytest.mark.usefixtures("without_rivals")


@pytest.fixture(scope="module")
def swing(tmp_path_factory):
    """A short swing with a project file beside it."""
    folder = tmp_path_factory.mktemp("swing")
    rig = fracid.rotary_pendulum()
    run = fracid.simulate(rig, orders={"lambda": 1.0, "mu": 0.95}, initial={"alpha": 0.35}, step=0.01, end=2.0)
    angles = run.states[:, [0, 2]] + 1e-3 * np.random.default_rng(1).standard_normal((201, 2))
    twins.write(folder / "swing.csv", angles, 0.01)
    (folder / "rig.toml").write_text(RELEASE, encoding="utf-8")
    return folder


@pytest.fixture
def here(swing, tmp_path, monkeypatch):
    """A copy of it, where one stands."""
    shutil.copytree(swing, tmp_path / "swing")
    monkeypatch.chdir(tmp_path / "swing")
    return tmp_path / "swing"


def read(path):
    return json.loads(path.read_text(encoding="utf-8"))


def result(folder):
    """All but what it took."""
    return {name: value for name, value in read(folder / "result.json").items() if name != "timing"}


def files(folder):
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*")}


@pytest.mark.broad
def test_a_run_from_python_is_the_folder_of_the_command(here, capsys):
    finished = fracid.run("rig.toml", out="python", seed=3)
    assert capsys.readouterr() == ("", "")
    assert program.run(capsys, "fit", "rig.toml", "--out", "typed", "--seed", 3)[0] == 0
    assert files(here / "python") == files(here / "typed")
    assert result(here / "python") == result(here / "typed")
    assert finished.result == read(here / "python" / "result.json")
    states = [read(here / name / "run.json") for name in ("python", "typed")]
    assert states[0] == states[1]
    for name in ("figures/figure2-swing.svg", "evaluations.jsonl"):
        lines = [(here / folder / name).read_text().splitlines() for folder in ("python", "typed")]
        assert len(lines[0]) == len(lines[1])


@pytest.mark.broad
def test_the_environment_of_a_call_names_the_command_that_does_the_same(here):
    fracid.run(fracid.load_project("rig.toml"), out="run", starts=2, cut=True, figures=False)
    environment = read(here / "run" / "environment.json")
    assert environment["command"] == ["fit", "rig.toml", "--out", "run", "--cut", "--multi-start", "2"]
    assert environment["directory"] == str(here)


def after(count):
    """An observer who presses Ctrl-C after so many."""

    def tell(progress):
        if progress.done >= count:
            raise KeyboardInterrupt

    return fracid.Observer(progress=lambda what: nullcontext(tell))


@pytest.mark.broad
def test_a_fit_that_python_began_ends_the_same_by_another_call_and_by_resume_run(here):
    whole = fracid.run("rig.toml", out="whole", figures=False)
    for again in (lambda: fracid.run("rig.toml", out="run", figures=False), lambda: fracid.resume_run("run")):
        cut = fracid.run("rig.toml", out="run", figures=False, observer=after(2))
        assert (cut.interrupted, whole.interrupted, whole.resumed) == (True, False, False)
        ended = again()
        assert ended.resumed
        assert ended.fit.x.tolist() == whole.fit.x.tolist()
        shutil.rmtree("run")


YEARS = 365.25 * 86400.0


def set_the_clock(patch):
    """Set the system's clock back or forward by years whenever somebody looks; what only goes on stays as it is."""
    real, jumps = time.time, cycle([-40.0, 40.0, -1.0, 0.0, 1.0])

    def now():
        return real() + YEARS * next(jumps)

    class Set(datetime):
        @classmethod
        def now(cls, tz=None):
            return cls.fromtimestamp(now(), tz)

    patch.setattr(time, "time", now)
    patch.setattr(time, "time_ns", lambda: int(1e9 * now()))
    patch.setattr("fracid.runs.folder.datetime", Set)


@pytest.mark.broad
def test_a_fit_during_which_the_clock_is_set_is_the_same_and_so_is_one_that_is_gone_on_with(here, monkeypatch):
    fracid.run("rig.toml", out="whole", figures=False)
    set_the_clock(monkeypatch)
    began = time.perf_counter()
    fracid.run("rig.toml", out="run", figures=False, observer=after(2))
    for n, path in enumerate(sorted((here / "run").rglob("*"))):
        os.utime(path, (n % 3 * 40 * YEARS,) * 2)
    assert fracid.resume_run("run").resumed
    took = read(here / "run" / "result.json")["timing"]
    assert result(here / "run") == result(here / "whole")
    assert all(0.0 <= seconds <= time.perf_counter() - began for seconds in took.values()), took


@pytest.mark.broad
def test_a_study_that_python_began_is_gone_on_with_from_a_shell(here, capsys):
    options = dict(levels=[1e-3], resolutions=[0.0], seeds=3, executor="threads", out="study")
    with pytest.raises(fracid.Unfinished):
        fracid.run_noise_study("rig.toml", **options, observer=after(1))
    code, out, err = program.run(capsys, "resume", "study", "--json")
    assert code == 0, err
    again = json.loads(out)
    assert len((here / "study" / "journal.jsonl").read_text().splitlines()) == 4  # none was done twice
    whole = fracid.run_noise_study("rig.toml", **options | {"out": "whole"})
    assert read(whole.path) == again


def test_a_loaded_project_has_the_preset_that_it_was_loaded_with(here):
    project = fracid.load_project("rig.toml")
    with pytest.raises(InputError, match=r"loaded with preset = None, not 'paper'\. Type fracid\.load_project"):
        fracid.run(project, preset="paper")
    assert not (here / "runs").exists()


@pytest.mark.broad
def test_a_disk_that_is_full_when_figures_are_drawn_keeps_the_result_and_they_are_drawn_later(here, monkeypatch):
    whole = fracid.run("rig.toml", out="whole")
    room = iter([figures.saved])

    def fills_up(*words, **options):
        if (drawn := next(room, None)) is None:
            raise OSError(errno.ENOSPC, "No space left on device")
        return drawn(*words, **options)

    with monkeypatch.context() as small:
        small.setattr(figures, "saved", fills_up)
        cut = fracid.run("rig.toml", out="small")
    assert "No space left on device" in cut.undrawn
    assert result(here / "small") == result(here / "whole")
    again = fracid.run("rig.toml", out="small")
    assert (again.resumed, again.undrawn) == (True, "")
    assert len(again.figures) == len(whole.figures)
    assert files(here / "small") == files(here / "whole")


@pytest.mark.parametrize(
    ("short", "sentence"),
    [
        ({"disk_usage": lambda _: SimpleNamespace(free=7_000_000)},
         "has 7 MB left, and a result with its figures may take 50 MB"),
        ({"free_memory": lambda: 1000}, "GB of memory, and 0.0 GB are free: end other programs"),
        ({}, ""),
    ],
)  # fmt: skip
def test_a_fit_says_before_its_search_where_disk_or_memory_may_not_suffice(here, monkeypatch, short, sentence):
    for name, value in short.items():
        monkeypatch.setattr(f"fracid.workflows.fit.{name}", value)
    notes = [*_short_of_room(fracid.load_project("rig.toml"), here)]
    assert len(notes) == len(short)
    assert all(sentence in note for note in notes)
