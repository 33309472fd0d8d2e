"""From each command to the next: what is typed by mistake is told with what to type, and success says how to go on."""

import json
import re
import shlex
import shutil
import subprocess
import sys
import webbrowser

import numpy as np
import pytest

from fracid.cli.app import open_page
from fracid.recording import load_recording
from fracid.recording.writing import save_recording
from fracid.safety.paths import kind_of
from fracid.tasks.journal import resuming
from program import run


@pytest.fixture(scope="module")
def made(plain, tmp_path_factory):
    """A folder with recordings, a project, its run, and a study's folder."""
    folder = shutil.copytree(plain, tmp_path_factory.mktemp("next") / "plain")
    save_recording(load_recording(folder / "swing.csv"), folder / "swing.mat")
    (folder / "runs").mkdir()
    shutil.move(folder / "run", folder / "runs" / "rig")
    (folder / "study").mkdir()
    (folder / "study" / "compare.json").write_text("{}")
    (folder / "empty").mkdir()
    (folder / "log.docx").write_text("no recording")
    return folder


@pytest.fixture
def folder(made, monkeypatch):
    """The same, as the place where one types."""
    monkeypatch.chdir(made)
    return made


# --- mistakes -----------------------------------------------------------------------------------------------

MISTAKES = {
    # a path of the wrong kind
    "fit swing.mat": "swing.mat is a recording, not a project. Write a project of it: fracid init swing.mat.",
    "fit runs/rig": "runs/rig is the folder of a run, not a project. Look at it: fracid resid runs/rig; or fit again: "
                    "fracid fit rig.toml.",
    "fit study": "study is the folder of a study, not a project. Give the project file: fracid compare PROJECT.",
    "compare swing.csv": "swing.csv is a recording, not a project. Write a project of it: fracid init swing.csv.",
    "check rig.toml": "rig.toml is a project, not a recording. Fit it: fracid fit rig.toml.",
    "check runs/rig": "runs/rig is the folder of a run, not a recording. Look at it: fracid resid runs/rig.",
    "init rig.toml --out new.toml": "rig.toml is a project, not a recording. Fit it: fracid fit rig.toml.",
    "resid rig.toml": "rig.toml is a project, not the folder of a run. Fit it first: fracid fit rig.toml; its run may "
                      "be runs/rig.",
    "export swing.csv": "swing.csv is a recording, not the folder of a run. Begin with: fracid check swing.csv.",
    "report study": "study/compare.json is damaged: it has no structures. Write it again: fracid compare.",
    "resume rig.toml": "rig.toml is a project, not the folder of a run. Fit it first: fracid fit rig.toml",
    "noise swing.csv": "swing.csv is a recording, not the folder of a run. Begin with: fracid check swing.csv.",
    "regress runs/rig": "runs/rig is the folder of a run, not a recording. Look at it: fracid resid runs/rig.",
    "simulate swing.csv": "swing.csv is a recording: fracid check swing.csv looks at it",
    # a path that is not there
    "fit rgi.toml": "There is no rgi.toml. Did you mean rig.toml?",
    "fit zebra.toml": "There is no zebra.toml. There is rig.toml.",
    "fit nowhere/rig.toml": "There is no nowhere/rig.toml. There is no folder nowhere either; paths begin at",
    "check swng.csv": "no file swng.csv: did you mean swing.csv?",
    "resid runs/rog": "There is no runs/rog. Did you mean runs/rig?",
    "resid zebra": "There is no zebra. There is runs/rig.",
    "profile runs/rog": "There is no runs/rog. Did you mean runs/rig?",
    "noise runs/rog": "There is no runs/rog. Did you mean runs/rig?",
    "resume runs/rog": "There is no runs/rog. Did you mean runs/rig?",
    "simulate runs/rog": "There is no runs/rog. Did you mean runs/rig?",
    # a folder or a file of nobody
    "resid empty": "empty is no run folder: it has no result.json that can be read. Give one that fracid fit wrote.",
    "resume empty": "Type the command itself again.",
    "resume runs/rig --out other": "leave --out out. For another, begin anew: fracid fit PROJECT --out DIR --seed N.",
    "resume runs/rig --seed 2": "leave --seed out. For another, begin anew: fracid fit PROJECT",
    "check log.docx": "log.docx: unknown ending '.docx'; fracid reads .csv",
    # misspelt words
    "simulate qube-servo": "did you mean qube-servo2",
    "fit rig.toml --optimiser genetics": "did you mean genetic",
    "fit rig.toml --preset papr": "did you mean paper",
    "profile runs/rig --parameter nu": "mu",
    "resid runs/rig --recording swong": "did you mean swing",
    "resid runs/rig --output alfa": "did you mean alpha",
    "export runs/rig --to matlap": "did you mean matlab",
    "check swing.csv --column alpha=alfa": "Did you mean",
    "init swing.csv --rig srv02 --out new.toml": "did you mean srv02-rotpen",
    "init swing.csv --out rig.toml": "give another name, --out FILE, or write over it: --force.",
    "noise runs/rig --cost itea": "did you mean",
    "fit rig.toml --multi-start 3 --executor procesess": "There is no executor 'procesess'; type one of threads, proc",
    "compare rig.toml --out study --keep coulomb_thata": "did you mean coulomb_theta",
    "compare rig.toml --out study --executor many": "There is no executor 'many'",
    "noise runs/rig --out runs/rig": "runs/rig holds a fit; give fracid noise a folder of its own: --out DIR.",
    "fit rig.toml --executor processes": "say how many: --multi-start N.",
}  # fmt: skip
"""What is typed → what the sentence must hold."""


@pytest.mark.few(2)
@pytest.mark.parametrize("words", MISTAKES)
def test_a_mistake_is_told_with_what_to_type(capsys, folder, words):
    code, out, err = run(capsys, *words.split())
    assert (code, out) == (2, "")
    assert MISTAKES[words] in err
    assert err.startswith("error: ")
    assert err.count("\n") == 1


def test_no_mistake_clears_what_an_earlier_run_has_left(folder):
    """The mistakes above have all been made, in the folders of a run and of a study."""
    assert (folder / "runs" / "rig" / "result.json").exists()
    assert (folder / "runs" / "rig" / "project.toml").exists()
    assert (folder / "study" / "compare.json").exists()


@pytest.mark.parametrize(
    ("words", "hint"), [("fti rig.toml", "fit"), ("fit rig.toml --optimizer cma", "--optimiser"), ("chek", "check")]
)
def test_a_misspelt_command_or_option_is_told_with_the_one_meant(capsys, folder, words, hint):
    code, out, err = run(capsys, *words.split())
    assert (code, out) == (2, "")
    text = " ".join(re.sub(r"[│╭╮╰╯─]", " ", err).split())
    assert re.search(rf"(?i)did you mean '?{hint}|possible options: .*{hint}", text), text
    assert "--help" in text


@pytest.mark.parametrize(
    ("name", "kind"),
    [("rig.toml", "project"), ("swing.mat", "recording"), ("runs/rig", "run"), ("study", "study"), ("empty", None),
     ("log.docx", None), ("nothing", None)],
)  # fmt: skip
def test_what_a_path_is_can_be_told(folder, name, kind):
    assert kind_of(folder / name) == kind


def test_a_run_without_a_result_is_to_be_resumed(capsys, folder):
    (folder / "cut").mkdir(exist_ok=True)
    begun = json.loads((folder / "runs" / "rig" / "run.json").read_text()) | {"finished": False}
    (folder / "cut" / "run.json").write_text(json.dumps(begun))
    code, _, err = run(capsys, "resid", "cut")
    assert code == 2
    assert "The fit in cut is not finished; type fracid resume cut." in err


def test_what_is_cut_short_names_the_folder_that_can_be_resumed(tmp_path):
    for folder, file in (("run", "run.json"), ("run/noise", "environment.json"), ("study", "environment.json")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / file).touch()
    expected = {"run/starts": "run", "run/noise": "run/noise", "study": "study", "my rig": "my rig"}
    for own, resumed in expected.items():
        assert shlex.split(resuming(tmp_path / own / "journal.jsonl"))[2:] == [str(tmp_path / resumed)]


# --- success --------------------------------------------------------------------------------------------------


def nexts(out):
    """The commands that a command's last lines propose."""
    lines = out.rstrip().split("\n")
    first = max(k for k, line in enumerate(lines) if line.startswith("next"))
    return [line[9:].split("  ")[0] for line in lines[first:]]


def test_check_init_fit_and_on_are_led_to_by_what_is_printed(capsys, folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(folder / "swing.mat", tmp_path / "my swing.mat")
    _, out, _ = run(capsys, "check", "my swing.mat", "--column", "alpha=alpha,unit=rad", "--column", "theta=theta")
    assert nexts(out) == [
        "fracid check 'my swing.mat' --column alpha=alpha,unit=rad --column theta=theta,unit=rad",
        "fracid init 'my swing.mat' --column alpha=alpha,unit=rad --column theta=theta",
    ]
    _, out, _ = run(capsys, "check", "my swing.mat", "--json")
    assert "next" not in json.loads(out)
    code, out, _ = run(capsys, "init", "my swing.mat", "--column", "alpha=alpha,unit=rad", "--column", "theta=theta")
    assert code == 0
    assert nexts(out) == ["fracid fit 'my swing.toml'"]
    assert (tmp_path / "my swing.toml").exists()


@pytest.mark.broad
def test_a_fit_and_what_is_done_with_it_lead_on(capsys, folder):
    from fracid.cli.app import new_console
    from fracid.cli.fit import _show_rest
    from fracid.runs.saved import load_run
    from fracid.workflows.fit import FinishedRun

    saved = load_run("runs/rig")
    _show_rest(FinishedRun(saved.project, saved, saved.folder, (), {}, False, 0.0), new_console())
    assert nexts(capsys.readouterr().out) == [
        "fracid report runs/rig --open", "fracid resid runs/rig", "fracid compare rig.toml"
    ]  # fmt: skip
    found = {
        "resid runs/rig": "fracid compare rig.toml",
        "report runs/rig --out page.html": "fracid report runs/rig --open",
        "export runs/rig --to matlab": "cd runs/rig/export && octave --eval '[t, x] = model(); plot(t, x)'",
        "export runs/rig --to csv": None,
    }
    for words, command in found.items():
        code, out, err = run(capsys, *words.split())
        assert code == 0, err
        assert nexts(out)[0] == command if command else "next" not in out


def test_an_unfit_recording_leads_nowhere(capsys, tmp_path):
    (tmp_path / "holes.csv").write_text("t,alpha\n0,1\n1,\n2,3\n3,5\n")
    code, out, _ = run(capsys, "check", tmp_path / "holes.csv")
    assert code == 3
    assert "next" not in out


# --- the browser --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("asked", "terminal", "display", "ci", "opened"),
    [(None, True, True, False, True), (None, False, True, False, False), (None, True, False, False, False),
     (None, True, True, True, False), (True, False, True, True, True), (True, True, False, False, False),
     (False, True, True, False, False)],
)  # fmt: skip
def test_a_page_is_opened_where_somebody_looks_or_asks(monkeypatch, tmp_path, asked, terminal, display, ci, opened):
    taken = []
    monkeypatch.setattr(webbrowser, "open", lambda page: taken.append(page) or True)
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(sys.stdout, "isatty", lambda: terminal, raising=False)
    for name, there in (("DISPLAY", display), ("WAYLAND_DISPLAY", False), ("CI", ci)):
        monkeypatch.setenv(name, ":0") if there else monkeypatch.delenv(name, raising=False)
    assert open_page(tmp_path / "report.html", asked) == opened
    assert taken == ([(tmp_path / "report.html").as_uri()] if opened else [])


def test_the_report_says_where_it_is_if_no_browser_takes_it(capsys, folder, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    code, out, err = run(capsys, "report", "runs/rig", "--open", "--out", "page.html")
    assert code == 0
    assert out == "report   page.html\n"
    assert f"Open {(folder / 'page.html').as_uri()}." in err


@pytest.mark.broad
def test_python_m_fracid_says_the_same(folder):
    command = [sys.executable, "-m", "fracid", "fit", "swing.csv"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder)
    assert done.returncode == 2
    assert done.stderr == f"error: {MISTAKES['fit swing.mat'].replace('mat', 'csv')}\n"


def test_numbers_stay_themselves_in_what_is_to_be_typed_again():
    from fracid.workflows.records import words_of

    assert [*words_of({"rate": 1000.0, "column": ["alpha=0", "theta=1"], "time": None})] == [
        "--rate", "1000", "--column", "alpha=0", "--column", "theta=1"
    ]  # fmt: skip
    assert np.isclose(float([*words_of({"rate": 333.25})][1]), 333.25)
