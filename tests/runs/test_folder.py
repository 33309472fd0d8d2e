"""The run folder: whole or not at all, and only where it may be."""

import json
import os
import re
import stat
from pathlib import Path

import numpy as np
import pytest

import fracid
import fracid.cli
from fracid.errors import InputError, Unfinished
from fracid.problem.project import load_project
from fracid.runs.environment import versions
from fracid.runs.evaluations import EVALUATIONS
from fracid.runs.folder import (
    FIGURE,
    FIGURES,
    JOURNAL,
    RUN,
    FitOptions,
    inputs_of,
    open_folder,
    open_run,
    run_state,
)
from fracid.safety.door import write_whole

pytestmark = pytest.mark.usefixtures("without_rivals")


def test_a_new_folder_is_made_with_its_environment(tmp_path):
    folder = open_folder(tmp_path / "a" / "b")
    environment = json.loads((folder / "environment.json").read_text())
    assert environment["versions"] == versions()
    assert set(environment) == {"versions", "platform", "processor", "command", "directory", "started", "code"}


def test_an_earlier_run_is_cleared_of_its_own_files_alone(tmp_path):
    folder = open_folder(tmp_path / "run")
    (folder / FIGURES).mkdir()
    own = [
        folder / EVALUATIONS,
        folder / "result.json",
        folder / FIGURES / "cut.svg",
        folder / FIGURES / "figure2-old.png",
    ]
    foreign = [folder / "notes.txt", folder / FIGURES / "notes.txt", folder / FIGURES / "old.png"]
    for path in (*own, *foreign):
        path.write_text("x")
    open_folder(folder)
    assert not any(path.exists() for path in own)
    assert all(path.exists() for path in foreign)


def test_a_folder_with_foreign_files_is_refused_and_left_as_it_was(tmp_path):
    (tmp_path / "thesis.tex").write_text("x")
    with pytest.raises(InputError, match=r"holds files that are not a run's; give an empty or a new folder: --out DIR"):
        open_folder(tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize("below", [(), ("deeper",)])
def test_a_file_in_the_place_of_the_folder_is_told(tmp_path, below):
    (tmp_path / "file").write_text("x")
    with pytest.raises(InputError, match="is no folder, or lies below a file; give another: --out DIR"):
        open_folder(Path(tmp_path / "file", *below))


@pytest.mark.usefixtures("heeding_modes")
def test_a_folder_that_cannot_be_written_is_told(tmp_path):
    tmp_path.chmod(stat.S_IRUSR | stat.S_IXUSR)
    with pytest.raises(InputError, match=r"cannot be written: Permission denied. Give another: --out DIR"):
        open_folder(tmp_path / "run")


def test_a_disk_that_takes_nothing_is_told(tmp_path, monkeypatch):
    def full(path, text):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("fracid.runs.folder.write_whole", full)
    with pytest.raises(Unfinished, match=r"cannot be written: the disk is full\. Make room"):
        open_folder(tmp_path / "run")


def test_a_file_is_written_whole_or_not_at_all(tmp_path, monkeypatch):
    path = tmp_path / "result.json"
    write_whole(path, "first")

    def fails(*_):
        raise OSError(5, "Input/output error")

    monkeypatch.setattr("os.fsync", fails)
    with pytest.raises(OSError, match="Input/output"):
        write_whole(path, "second")
    assert path.read_text() == "first"
    assert [p.name for p in tmp_path.iterdir()] == ["result.json"]


def test_others_may_read_a_file_as_far_as_the_umask_allows(tmp_path):
    before = os.umask(0o022)
    try:
        write_whole(tmp_path / "a", "λ")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "a").stat().st_mode) == 0o644
    assert (tmp_path / "a").read_bytes() == "λ".encode()


# --- begun, killed, gone on with ---------------------------------------------------------------------

OPTIONS = FitOptions("rig.toml", seed=3)
INPUTS = {"the recording 'a'": "12"}


def under_way(folder, options=OPTIONS, inputs=None, **more):
    """Begin a run and leave it unfinished."""
    with open_run(folder, options, inputs=inputs or INPUTS, **more) as run:
        (folder / EVALUATIONS).touch()
        (folder / JOURNAL).touch()
    return run


def test_a_run_is_unfinished_until_it_says_otherwise(tmp_path):
    under_way(tmp_path)
    assert not run_state(tmp_path).finished
    with open_run(tmp_path, OPTIONS, inputs=INPUTS, resume=True) as run:
        assert run.resumed
        assert (tmp_path / EVALUATIONS).exists()
        run.finish()
    assert run_state(tmp_path).finished


def test_a_run_begun_anew_has_nothing_of_an_older_one_but_a_studys_journal(tmp_path):
    under_way(tmp_path)
    with open_run(tmp_path, OPTIONS) as run:
        assert not run.resumed
        assert {path.name for path in tmp_path.iterdir()} == {".lock", "environment.json", RUN, JOURNAL}


def test_what_was_killed_as_it_began_is_nothing_to_go_on_with(tmp_path, monkeypatch):
    under_way(tmp_path)

    def killed(*_):
        raise SystemExit

    monkeypatch.setattr("fracid.runs.folder.write_files", killed)
    with pytest.raises(SystemExit):
        under_way(tmp_path)
    with pytest.raises(InputError, match=r"was left before anything was done\. Type the command itself again"):
        run_state(tmp_path)


@pytest.mark.parametrize(
    ("options", "inputs", "what"),
    [
        (OPTIONS, {"the recording 'a'": "13"}, r"the recording 'a' has changed since"),
        (OPTIONS, {**INPUTS, "the model file b": "1"}, r"the model file b has changed since"),
        (FitOptions("rig.toml", seed=4), INPUTS, r"holds another run, with \{'project': 'rig.toml', .*'seed': 3"),
    ],
)
def test_what_has_changed_is_not_gone_on_with(tmp_path, options, inputs, what):
    under_way(tmp_path)
    with pytest.raises(InputError, match=what):
        under_way(tmp_path, options, inputs, resume=True)


def test_what_a_killed_process_had_half_written_is_cleared(tmp_path):
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / ".environment.json.77-88").write_text("{")
    with open_run(folder, OPTIONS) as run:
        assert not (folder / ".environment.json.77-88").exists()
        (folder / ".result.json.77-88").write_text("{")
        run.finish()
    assert {path.name for path in folder.iterdir()} == {".lock", "environment.json", "run.json"}


@pytest.mark.broad
def test_a_folder_at_work_is_another_processs(tmp_path):
    import subprocess
    import sys

    code = "import sys, fracid.runs.folder as r; r.FolderLock(r.Path(sys.argv[1]))"
    with open_run(tmp_path / "run", FitOptions("rig.toml")):
        second = subprocess.run(
            [sys.executable, "-c", code, tmp_path / "run"], capture_output=True, text=True, check=False
        )
    assert "Another process is at work in" in second.stderr


@pytest.mark.parametrize("content", ["{", "[]", '{"options": {}}', '{"options": {"seed": "3"}, "inputs": {}}'])
def test_what_is_no_run_is_told(tmp_path, content):
    with pytest.raises(InputError, match=r"has no run.json that can be read: .*Type the command itself again"):
        run_state(tmp_path)
    (tmp_path / "run.json").write_text(content)
    with pytest.raises(InputError, match=r"run.json is damaged: .* Write it again: the command itself"):
        run_state(tmp_path)


def test_all_that_a_run_reads_is_named_its_own_model_and_cost_too(tmp_path):
    (tmp_path / "own.py").write_text(
        "from fracid.models import Model, Parameter\n"
        "def fall(t, x, u, p, out):\n    out[0] = x[1]\n    out[1] = -p[0] * x[0]\n"
        "model = Model(name='oscillator', rhs=fall, states=('alpha', 'D^mu alpha'), orders=('mu', 'mu'),\n"
        "              parameters=(Parameter('stiffness', '1/s^2', 40.0, 'a guess'),), inputs=(),\n"
        "              outputs={'alpha': 0}, zero='hanging', source='here')\n"
        "def cost(t, e):\n    return float((e * e).sum())\n"
    )
    time = np.arange(0, 2, 0.01)
    np.savez(tmp_path / "swing.npz", time=time, alpha=0.1 * np.cos(6 * time))
    (tmp_path / "rig.toml").write_text(
        '[model]\nname = "own.py:model"\n[model.orders]\nmu = { start = 1.0, lower = 0.9, upper = 1.1 }\n'
        '[[recording]]\nfile = "swing.npz"\nalpha = { column = "alpha" }\n[fit]\ncost = "own.py:cost"\n'
    )
    before = inputs_of(load_project(tmp_path / "rig.toml", trust=True))
    assert {"the project file rig.toml", "the recording 'swing'", "the version of numpy"} <= set(before)
    with (tmp_path / "own.py").open("a") as file:
        file.write("# changed\n")
    after = inputs_of(load_project(tmp_path / "rig.toml", trust=True))
    assert {what for what in before if before[what] != after[what]} == {"the code own.py"}


def test_a_picture_that_somebody_put_beside_the_runs_own_stays(tmp_path):
    with open_run(tmp_path / "run", FitOptions("rig.toml")) as run:
        run.finish()
    figures = tmp_path / "run" / "figures"
    (figures / "journal").mkdir(parents=True)
    theirs = ("thesis.png", "figure.pdf", "cut.txt", "journal/my-noise.png")
    own = ("figure2-swing.png", "figure3-swing-alpha.svg", "journal/cut.pdf", "residuals-a-b.png", "noise.png")
    for name in (*theirs, *own):
        (figures / name).touch()
    with open_run(tmp_path / "run", FitOptions("rig.toml")):
        there = {path.relative_to(figures).as_posix() for path in figures.rglob("*") if path.is_file()}
    assert there == set(theirs)


def test_all_figures_that_are_drawn_are_known_by_their_names():
    drawn = re.compile(r'(?:yield f?|FIGURES, f?)"([a-z0-9-]+)')
    package = Path(fracid.__file__).parent
    texts = [path.read_text(encoding="utf-8") for part in ("cli", "workflows") for path in package.glob(f"{part}/*.py")]
    stems = {stem for text in texts for stem in drawn.findall(text)}
    assert len(stems) > 9
    assert all(FIGURE.fullmatch(f"{stem}x.png" if stem.endswith("-") else f"{stem}.png") for stem in stems)
