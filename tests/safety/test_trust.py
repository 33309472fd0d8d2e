"""Code of a project's own runs when it is named by the caller or trusted, never because a file says so."""

import json
import os
import pickle
import shlex
import sys
from importlib.util import cache_from_source
from pathlib import Path
from py_compile import PycInvalidationMode
from py_compile import compile as compile_to
from shutil import copytree

import numpy as np
import pytest

import fracid
from fracid.cli import main
from fracid.safety.user_code import run_file
from fracid.selection.comparison import _Given
from fracid.workflows.resumption import safe_words
from program import leave_figures_out, run

pytestmark = pytest.mark.usefixtures("without_rivals")

RIG = """
from pathlib import Path
from fracid import Model, Parameter
Path(__file__).with_name("ran").touch()
def rhs(t, x, u, p, out):
    out[0] = x[1]
    out[1] = -p[0] * x[0]
model = Model("spring", rhs, ("alpha", "rate"), ("mu", "mu"), {"alpha": 0}, (),
              (Parameter("k", "1/s^2", 36.0, "stiffness"),), "", "a test")
"""

COST = """
from pathlib import Path
Path(__file__).with_name("ran").touch()
def worst(time, residual):
    return float(abs(residual).max())
"""

PROJECT = """
[model.orders]
{orders}
[[recording]]
file = "swing.npz"
alpha = {{ column = "alpha" }}
[fit]
{fit}
"""
MODEL = '[model]\nname = "my_rig.py:model"\n' + PROJECT.format(
    orders="mu = { start = 1.0, lower = 0.9, upper = 1.1 }", fit=""
)
OF_COST = PROJECT.format(orders="lambda = 1.0\nmu = 1.0", fit='cost = "my_cost.py:worst"')

ENVIRONMENT = {"versions": {}, "platform": "", "directory": "/"}


def strangers(folder):
    """Write what a stranger sends: two projects, and the code that they name."""
    time = np.arange(0, 2, 0.01)
    noise = 1e-3 * np.random.default_rng(1).standard_normal(200)
    np.savez(folder / "swing.npz", time=time, alpha=0.1 * np.cos(6 * time) + noise)
    for name, text in (("my_rig.py", RIG), ("my_cost.py", COST), ("rig.toml", MODEL), ("cost.toml", OF_COST)):
        (folder / name).write_text(text)
    return folder


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return strangers(tmp_path)


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """A stranger's project with its run."""
    folder = strangers(tmp_path_factory.mktemp("fitted"))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        leave_figures_out(patch)
        words = ["fit", "rig.toml", "--out", "run", "--trust"]
        patch.setattr(sys, "argv", ["fracid", *words])
        with pytest.raises(SystemExit) as stop:
            main(words)
    assert not stop.value.code
    return folder


def refused(capsys, *words):
    """The message of a refusal."""
    Path("ran").unlink(missing_ok=True)  # of another test
    code, out, err = run(capsys, *words)
    assert (code, out) == (2, "")
    assert not Path("ran").exists()
    assert "Traceback" not in err
    return err.splitlines()[-1]


@pytest.mark.few(3)
@pytest.mark.parametrize("command", ["fit", "compare", "noise", "profile", "regress", "simulate"])
@pytest.mark.parametrize(("project", "code"), [("rig.toml", "my_rig.py"), ("cost.toml", "my_cost.py")])
def test_a_project_runs_no_code_of_its_own_unless_it_is_trusted(capsys, folder, command, project, code):
    message = refused(capsys, command, project, "--out", "a folder")
    assert message.startswith(f"error: {project} refers to Python code of its own: {code}. ")
    assert message.endswith(f"Type: fracid {command} {project} --out 'a folder' --trust")
    assert not Path("a folder").exists()


@pytest.mark.few(2)
@pytest.mark.parametrize("command", ["resid", "profile", "noise", "report", "export", "simulate"])
def test_a_run_runs_no_code_of_its_projects_either(capsys, fitted, monkeypatch, command):
    monkeypatch.chdir(fitted)
    message = refused(capsys, command, "run")
    assert "refers to Python code of its own: " in message
    assert message.endswith(f"Type: fracid {command} run --trust")


@pytest.mark.broad
def test_trusted_it_runs_and_the_run_says_with_which_code(capsys, fitted, monkeypatch):
    monkeypatch.chdir(fitted)
    code, out, err = run(capsys, "resid", "run", "--out", "resid", "--trust", "--json")
    assert code == 0
    assert {json.loads(line)["event"] for line in err.splitlines()} == {"stage"}
    assert [*json.loads(out)["recordings"]] == ["swing"]
    assert "the code my_rig.py" in json.loads(Path("run/run.json").read_text())["inputs"]


def test_from_python_the_caller_says_so(folder):
    for project, code in (("rig.toml", "my_rig.py"), ("cost.toml", "my_cost.py")):
        with pytest.raises(fracid.NotTrusted, match=rf"refers to Python code of its own: {code}.*trust=True in Python"):
            fracid.load_project(project)
        assert not Path("ran").exists()
        assert fracid.load_project(project, trust=True).own_code == (Path(code),)
        Path("ran").unlink()


def test_another_process_trusts_what_this_one_was_told_to_and_nothing_else(folder):
    sent = pickle.dumps(_Given.of(fracid.load_project("rig.toml", trust=True), ()))
    assert pickle.loads(sent).problem.model.name == "spring"
    Path("rig.toml").write_text(PROJECT.format(orders="lambda = 1.0\nmu = 1.0", fit=""))
    sent = pickle.dumps(_Given.of(fracid.load_project("rig.toml"), ()))
    Path("rig.toml").write_text(MODEL)
    Path("ran").unlink()
    with pytest.raises(fracid.NotTrusted):
        pickle.loads(sent)
    assert not Path("ran").exists()


def test_what_is_built_in_needs_no_trust(folder):
    Path("plain.toml").write_text(PROJECT.format(orders="lambda = 1.0\nmu = 1.0", fit=""))
    assert fracid.load_project("plain.toml").own_code == ()
    paper = fracid.load_project("cost.toml", preset="paper")  # whose cost is its own
    assert (paper.own_code, Path("ran").exists()) == ((), False)


def test_a_name_on_the_command_line_is_run(capsys, folder):
    Path("plain.toml").write_text(PROJECT.format(orders="lambda = 1.0\nmu = 1.0", fit=""))
    Path("loud.py").write_text("raise RuntimeError('here I am')")
    code, _, err = run(capsys, "noise", "plain.toml", "--cost", "loud.py:f")
    assert (code, "here I am" in err or "Nothing is free" in err) == (2, True)
    assert fracid.models.model_from_name("my_rig.py:model").name == "spring"


def test_the_file_that_was_named_is_run_and_no_other_that_the_folder_leads_to(capsys, fitted, tmp_path, monkeypatch):
    copytree(fitted, tmp_path / "sent", ignore=lambda *_: ["ran"])
    monkeypatch.chdir(tmp_path / "sent")
    for name in ("first", "second"):  # the caller is shown the first; its recording is not there, so it cannot be it
        Path(name).mkdir()
        Path(name, "rig.toml").write_bytes(Path("rig.toml").read_bytes())
        Path(name, "my_rig.py").write_text(RIG)
    Path("swing.npz").rename("second/swing.npz")
    Path("rig.toml").unlink()
    Path("my_rig.py").unlink()
    words = {"command": ["fit", "first/rig.toml", "second/rig.toml"], "directory": "."}
    Path("run/environment.json").write_text(json.dumps(ENVIRONMENT | words))
    state = json.loads(Path("run/run.json").read_text())
    Path("run/run.json").write_text(json.dumps(state | {"options": {}}))
    assert "Python code of its own: first/my_rig.py" in refused(capsys, "resid", "run")
    code, _, err = run(capsys, "resid", "run", "--trust")
    assert (code, "swing.npz" in err) == (2, True)
    assert [path.parent.name for path in Path().rglob("ran")] == ["first"]


@pytest.mark.parametrize("mode", list(PycInvalidationMode))
def test_what_is_run_is_the_text_and_not_what_lies_compiled_beside_it(tmp_path, mode):
    file = tmp_path / "mine.py"
    file.write_text("answer = 'what was sent'")
    compile_to(str(file), cache_from_source(str(file)), invalidation_mode=mode, doraise=True)
    before = file.stat()
    file.write_text("answer = 'what was read'")
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))  # as old as the compiled code says, and as long
    assert run_file(file, "mine_of_the_test").answer == "what was read"
    assert len(list((tmp_path / "__pycache__").iterdir())) == 1


def test_nothing_is_left_beside_a_file_that_was_run(folder):
    fracid.load_project("rig.toml", trust=True)
    assert not Path("__pycache__").exists()


# --- going on ----------------------------------------------------------------------------------------


@pytest.fixture
def unfinished(fitted, tmp_path, monkeypatch):
    """The run as if it had been killed before its end, on the same project."""
    copytree(fitted, tmp_path / "sent", ignore=lambda *_: ["ran"])
    monkeypatch.chdir(tmp_path / "sent")
    state = json.loads(Path("run/run.json").read_text())
    state |= {"finished": False, "options": state["options"] | {"project": str(Path("rig.toml").resolve())}}
    Path("run/run.json").write_text(json.dumps(state))
    Path("run/result.json").unlink()
    return tmp_path / "sent"


@pytest.mark.broad
def test_a_run_is_gone_on_with_only_if_its_code_is_trusted_again(capsys, unfinished, monkeypatch):
    leave_figures_out(monkeypatch)
    assert refused(capsys, "resume", "run").endswith("Type: fracid resume run --trust")
    code, _, _ = run(capsys, "resume", "run", "--trust")
    assert (code, Path("run/result.json").exists()) == (0, True)


def test_trusted_or_not_changed_code_is_not_gone_on_with(capsys, unfinished):
    with Path("my_rig.py").open("a") as file:
        file.write("# changed\n")
    code, _, err = run(capsys, "resume", "run", "--trust")
    assert code == 2
    assert "run cannot be resumed: the code my_rig.py has changed since" in err


@pytest.mark.parametrize(
    ("typed", "message"),
    [
        ("compare rig.toml --trust", "refers to Python code of its own"),
        (
            "noise plain.toml --cost my_cost.py:worst",
            "refers to Python code: fracid noise plain.toml --cost",
        ),
        ("noise plain.toml --cost=my_cost.py:worst --trust", "refers to Python code: fracid noise"),
        ("compare plain.toml --scheduler tcp://there:8786", "--scheduler tcp://there:8786"),
        ("compare plain.toml --scheduler=tcp://there:8786", "type its address yourself"),
        ("compare plain.toml --executor tcp://there:8786", "type its address yourself"),
        ("init swing.npz --out ../outside.toml --yes", "no study that can be typed again"),
        ("--help", "no study that can be typed again"),
        ("", "no study that can be typed again"),
    ],
)
def test_a_study_is_gone_on_with_but_what_only_the_caller_may_say_is_not_taken_from_its_folder(
    capsys, folder, typed, message
):
    Path("plain.toml").write_text(PROJECT.format(orders="lambda = 1.0\nmu = 1.0", fit=""))
    Path("run").mkdir()
    Path("run/journal.jsonl").touch()
    words = {"command": shlex.split(typed), "directory": str(folder)}
    Path("run/environment.json").write_text(json.dumps(ENVIRONMENT | words))
    before = sorted(folder.rglob("*"))
    assert message in refused(capsys, "resume", "run")
    assert sorted(folder.rglob("*")) == before


@pytest.mark.parametrize("typed", ["--scheduler tcp://there:8786", "--scheduler=tcp://there:8786",
                                   "--executor tcp://there:8786", "--executor=tcp://there:8786"])  # fmt: skip
def test_an_address_from_a_folder_is_not_used_whatever_else_is_typed(typed):
    words = ["compare", "rig.toml", *typed.split(), "--jobs", "2"]
    assert safe_words(Path("run"), words, "processes", False) == ["compare", "rig.toml", "--jobs", "2"]


def test_a_run_json_of_other_options_is_a_sentence(capsys, unfinished):
    state = json.loads(Path("run/run.json").read_text())
    for change in ({"options": {}}, {"options": state["options"] | {"trust": True}}):
        Path("run/run.json").write_text(json.dumps(state | change))
        code, _, err = run(capsys, "resume", "run")
        assert (code, Path("ran").exists()) == (2, False)
        assert "run.json is damaged: options has no project" in err or "--trust" in err


def test_a_fit_on_a_scheduler_wants_its_address_from_the_caller(capsys, unfinished):
    state = json.loads(Path("run/run.json").read_text())
    state["options"] |= {"executor": "tcp://there:8786", "starts": 2}
    Path("run/run.json").write_text(json.dumps(state))
    assert "fracid resume run --scheduler tcp://there:8786" in refused(capsys, "resume", "run", "--trust")
