"""Nothing from a file is run, opens a door in what is written, or is written elsewhere; the rules of SECURITY.md."""

import ast
import csv
import io
import json
import os
import re
import shutil
import subprocess
from contextlib import redirect_stdout
from importlib.metadata import distribution, requires
from itertools import chain
from pathlib import Path
from xml.etree import ElementTree

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from fracid.cli import main
from fracid.errors import InputError
from fracid.safety.text import LONGEST_STEM, csv_cell, file_stems, printable, refuse_unseen
from program import no_rivals, run
from sources import PACKAGE, nodes
from twins import angles, write

ROOT = Path(__file__).parents[2]

# --- what the package does not do --------------------------------------------------------------------

FORBIDDEN = {
    "eval", "exec", "compile", "__import__", "exec_module", "load_module", "run_path", "run_module",
    "pickle.load", "pickle.loads", "pickle.Unpickler", "cloudpickle.load", "cloudpickle.loads", "marshal.loads",
    "shelve.open", "joblib.load", "np.load", "yaml.load", "pd.read_pickle", "np.fromregex",
    "os.system", "os.popen", "subprocess.run", "subprocess.Popen", "subprocess.check_output", "subprocess.call",
    "urlopen", "urllib.request.urlopen", "requests.get", "socket.create_connection", "socket.socket",
}  # fmt: skip
"""Calls that run what they are given, or that ask somebody."""

ALLOWED = {
    (
        "safety/user_code.py",
        "exec_module",
    ): "the one place where a user's file is run, trusted: test_trust.py",
    (
        "solver/compilation.py",
        "pickle.loads",
    ): "compiled code that fracid kept, in a caller's folder, with its digest",
    ("models/written/languages.py", "compile"): "the text of such a tree, by the name that is kept of it",
    (
        "models/written/languages.py",
        "exec",
    ): "the text of a tree that a whitelist read: numbers, its own names and functions of mathematics",
    ("export/compilers.py", "subprocess.run"): "the C compiler of this system, over text that fracid wrote of a tree",
    ("safety/apart.py", "subprocess.run"): "Python itself, on a function of fracid's own: it reads what may end it",
    ("tasks/job.py", "pickle.loads"): "what this process's own pool, or the scheduler that the caller named, sends",
}
"""File and call → why it may stay."""


def name_of(node):
    """``np.load``, ``loader.exec_module``: as the table has it, the last name alone where that is in it."""
    name = ast.unparse(node)
    return name if name in FORBIDDEN else name.rsplit(".", 1)[-1] if name.endswith(("_module", ".run_path")) else name


def test_no_call_runs_what_it_is_given_but_those_with_a_reason():
    """Nor is one kept under another name, to be called later."""
    named = {(file, name_of(node)) for file, of_file in nodes().items() for node in of_file
             if isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Load)}  # fmt: skip
    assert {call for call in named if call[1] in FORBIDDEN} == set(ALLOWED)


def test_nothing_is_imported_that_runs_or_fetches_what_it_reads():
    imported = set()
    for node in chain.from_iterable(nodes().values()):
        if isinstance(node, ast.Import):
            imported |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            imported |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    assert not imported & {"marshal", "shelve", "dill", "joblib", "yaml", "runpy", "code", "imp", "urllib.request",
                           "http.client", "requests", "ftplib", "telnetlib", "xmlrpc.client"}  # fmt: skip


@pytest.mark.parametrize("script", sorted(PACKAGE.glob("report/*.js")), ids=lambda p: p.name)
def test_the_pages_scripts_make_no_code_of_texts_and_ask_nobody(script):
    text = script.read_text(encoding="utf-8")
    for word in (
        "eval(",
        "Function(",
        "document.write",
        "fetch(",
        "XMLHttpRequest",
        "WebSocket",
        "import(",
        "sendBeacon",
    ):
        assert not re.search(rf"(?<![\w.]){re.escape(word)}", text), word
    assert "innerHTML" not in text or "uPlot" in script.name  # uPlot writes none of ours with it
    assert "outerHTML" not in text
    assert "insertAdjacentHTML" not in text


def test_the_template_lets_nothing_through_unescaped():
    for template in PACKAGE.glob("report/*.j2"):
        assert "|safe" not in re.sub(r"\s", "", template.read_text(encoding="utf-8"))


# --- texts -------------------------------------------------------------------------------------------

UNSEEN = ["\x1b[2J", "\x1b]8;;http://evil\x07", "\x00", "\n", "\r", "\t", "\x7f", "\x9b31m", "\u202e", "\u2066",
          "\u200b", "\ufeff", "\u2028", "\u2029", "\u00ad"]  # fmt: skip


@pytest.mark.parametrize("unseen", UNSEEN, ids=ascii)
def test_what_cannot_be_seen_is_no_part_of_a_name_and_is_written_out_in_a_message(unseen):
    character = next(c for c in unseen if not c.isascii() or not c.isprintable())
    with pytest.raises(
        InputError, match=rf"holds U\+{ord(character):04X}, which cannot be seen; leave it out"
    ) as error:
        refuse_unseen("the name", f"swing{unseen}")
    assert character not in str(error.value)
    if character not in "\n\t":
        assert character not in printable(f"swing{unseen}")


@pytest.mark.parametrize("text", ["release 92°", "λ = 0.9, μ", "日本", "a\u00a0b", "<b>", "$x$", "line\nline"])
def test_what_can_be_seen_stays_as_it_is(text):
    assert printable(text) == text


@pytest.mark.parametrize(
    ("name", "message"), [("", "is empty"), ("   ", "is empty"), ("x" * 201, "has 201 characters")]
)
def test_a_name_is_something_and_not_too_long(name, message):
    with pytest.raises(InputError, match=message):
        refuse_unseen("the recording's name", name)


NAMES = ["run 1", "run/1", "Run-1", "run-1-2", "../../run 1", "..", "/etc/passwd", "C:\\boot.ini", "con", "LPT1",
         "nul.txt", "°", "日本", "x" * 200, "x" * 199, ".hidden", "-rf", "a\x00b", "~", "run 1 ", "$(id)",
         "`id`"]  # fmt: skip


def test_files_have_names_that_every_system_takes_and_tells_apart():
    stems = file_stems(NAMES)
    assert [*stems] == NAMES
    assert len({stem.lower() for stem in stems.values()}) == len(NAMES)
    for stem in stems.values():
        assert re.fullmatch(r"[0-9A-Za-z_][0-9A-Za-z_-]*", stem)
        assert len(stem) <= LONGEST_STEM + 4
        assert stem.lower() not in ("con", "nul", "lpt1")


@pytest.mark.parametrize(
    ("text", "cell"),
    [("=1+1", "'=1+1"), ("@SUM(A1)", "'@SUM(A1)"), ("+cmd|x", "'+cmd|x"), ("-cmd", "'-cmd"), ("-15°", "-15°"),
     ("+3", "+3"), ("a=b", "a=b"), ("", ""), ("-3.5e-4 rad", "-3.5e-4 rad"), ("-5µm", "-5µm"), ("-5 m/s²", "-5 m/s²"),
     ("-2+3+cmd|' /C calc'!D2", "'-2+3+cmd|' /C calc'!D2"), ("+1A1", "'+1A1"), ("-5 -cmd", "'-5 -cmd"), ("-", "'-"),
     ("\t=1", "'\t'=1"), ("\rx", "'\rx"), (" =1", "' =1"), ("\u200b=1", "'\u200b=1"), ("＝1", "'＝1"), ("﹦1", "'﹦1"),
     ("＋1", "'＋1"), ("＠SUM(A1)", "'＠SUM(A1)"), ("a;=1", "a;'=1"), ("a\t-cmd", "a\t'-cmd")],
    ids=ascii,
)  # fmt: skip
def test_a_spreadsheet_takes_no_name_for_a_formula(text, cell):
    assert csv_cell(text) == cell


# --- a project of hostile names, all the way ---------------------------------------------------------

HOSTILE = "--></script><img src=x onerror='alert(1)'> */ %} $\\frac{ [red]{{7*7}} ${run} %n [/nope]"
FILE = "s$w^{[red]<b>.csv"
FOLDER = "run */ %} [red]"
OUTSIDE = "../../outside"

PROJECT = """
[model.orders]
lambda = 0.9
mu = {{ start = 1.0, lower = 0.5, upper = 1.2 }}
[fit]
initial_state = "held"
{recordings}
"""

RECORDING = """
[[recording]]
name = {name}
file = {file}
theta = {{ column = "theta [x](y)", unit = "rad" }}
alpha = {{ column = 2, unit = "rad" }}
initial = {{ theta = 0.0, alpha = 0.35 }}
use = "{use}"
"""


def project_of(*names):
    """A project of one recording or two, of these names."""
    pairs = zip(names, ("fit", "validate"), strict=False)
    words = [RECORDING.format(name=json.dumps(name), file=json.dumps(FILE), use=use) for name, use in pairs]
    return PROJECT.format(recordings="".join(words))


@pytest.fixture(scope="module")
def hostile(tmp_path_factory):
    """A folder in a folder with the project, its recording, and its run."""
    outer = tmp_path_factory.mktemp("outer")
    (outer / "a" / "b").mkdir(parents=True)
    folder = outer / "a" / "b"
    y = angles(alpha=0.35, step=1e-2, end=2.0, noise=1e-3)
    write(folder / FILE, y, 1e-2, ("theta [x](y)", "\x1b[31malpha\u202e<b>"))
    (folder / "rig.toml").write_text(project_of(HOSTILE, OUTSIDE), encoding="utf-8")
    return outer


@pytest.fixture
def inside(hostile, monkeypatch):
    monkeypatch.chdir(hostile / "a" / "b")
    return hostile


COMMANDS = (
    ["fit", "rig.toml", "--out", FOLDER, "--jobs", "1"],
    ["resid", FOLDER, "--recording", HOSTILE, "--output", "alpha"],
    ["export", FOLDER, "--to", "matlab", "--to", "c", "--to", "csv"],
)


@pytest.fixture(scope="module")
def fitted(hostile):
    """What fit, resid and export print, and all files that were there before."""
    before = {path: path.read_bytes() for path in hostile.rglob("*") if path.is_file()}
    with pytest.MonkeyPatch.context() as patch, no_rivals():
        patch.chdir(hostile / "a" / "b")
        told = [called(words) for words in COMMANDS]
    return before, told


def called(words):
    """Standard output of a command that succeeds."""
    with io.StringIO() as out, redirect_stdout(out):
        with pytest.raises(SystemExit) as stop:
            main(words)
        assert not stop.value.code, words
        return out.getvalue()


@pytest.mark.broad
def test_all_that_is_written_lies_in_the_run_folder(hostile, fitted):
    before, _ = fitted
    now = {path for path in hostile.rglob("*") if path.is_file()}
    assert all(path.read_bytes() == content for path, content in before.items())
    written = now - set(before)
    assert len(written) > 20
    assert all(path.is_relative_to(hostile / "a" / "b" / FOLDER) for path in written)
    assert all(re.fullmatch(r"[\w.-]+", path.name) for path in written)


@pytest.mark.broad
def test_a_hostile_name_is_printed_as_it_is(fitted):
    for text in fitted[1]:
        assert "\x1b" not in text
        assert "\u202e" not in text
    assert "[red]{{7*7}}" in re.sub(r"\s+", "", fitted[1][0]).replace("onerror", "")
    assert FOLDER in fitted[1][0]


@pytest.mark.broad
def test_a_figure_is_a_picture_and_nothing_else(hostile, fitted):
    pictures = sorted((hostile / "a" / "b" / FOLDER).rglob("*.svg"))
    assert len(pictures) > 3
    for picture in pictures:
        elements = list(ElementTree.parse(picture).iter())
        assert not {e.tag.rsplit("}", 1)[-1] for e in elements} & {"script", "img", "foreignObject", "a"}
        assert not any(name.startswith("on") for e in elements for name in e.attrib)


@pytest.mark.broad
def test_programs_for_other_languages_are_not_written_to_by_names(hostile, fitted, tmp_path):
    folder = hostile / "a" / "b" / FOLDER / "export"
    for line in (folder / "model.m").read_text(encoding="utf-8").splitlines():
        if "onerror" in line or "[red]" in line:
            assert line.lstrip().startswith("%")
    if gcc := shutil.which("gcc"):
        words = [gcc, "-std=c99", "-Wall", "-Wextra", "-Wtrigraphs", "-Werror", "-c", "fracid_model.c"]
        words += ["-o", str(tmp_path / "model.o")]
        done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.broad
def test_tables_hold_what_they_should(hostile, fitted):
    tables = sorted((hostile / "a" / "b" / FOLDER / "export").glob("*.csv"))
    assert {path.stem for path in tables} == set(file_stems([HOSTILE, OUTSIDE]).values())
    for table in tables:
        rows = list(csv.reader(table.read_text(encoding="utf-8").splitlines()))
        assert {len(row) for row in rows} == {7}


def test_a_column_is_shown_without_what_commands_a_terminal(capsys, inside):
    code, out, err = run(capsys, "check", FILE)
    assert (code, err) == (0, "")
    assert "\x1b" not in out
    assert "\\x1b[31malpha\\u202e<b>" in out


@pytest.mark.few(1)
@pytest.mark.parametrize("unseen", UNSEEN, ids=ascii)
def test_a_project_of_names_that_cannot_be_seen_is_refused(capsys, inside, tmp_path, unseen):
    project = tmp_path / "rig.toml"
    project.write_text(project_of(f"swing{unseen}"), encoding="utf-8")
    shutil.copy(FILE, tmp_path)
    code, out, err = run(capsys, "fit", project, "--out", tmp_path / "run")
    assert (code, out, (tmp_path / "run").exists()) == (2, "", False)
    assert "cannot be seen; leave it out" in err
    assert printable(err) == err


def test_a_message_does_not_command_the_terminal_whatever_the_file_is_called(capsys):
    code, _, err = run(capsys, "fit", "\x1b[31mrig\u202e.toml")
    assert code == 2
    assert "\\x1b[31mrig\\u202e.toml" in err
    assert "\x1b" not in err


@pytest.mark.broad
@pytest.mark.parametrize(
    "words", [("simulate",), ("design", "--out"), ("posterior",), ("export",)], ids=lambda words: words[0]
)
def test_a_run_whose_name_is_bytes_and_no_text_is_as_good_as_any(capsys, plain, tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    run_folder = shutil.copytree(plain / "run", os.fsdecode(b"\xff"))
    code, _, err = run(capsys, words[0], run_folder, *words[1:], *(["sheet"] if words[1:] else []))
    assert (code, err.isascii()) == (0, True)


# --- dependencies ------------------------------------------------------------------------------------


def needed(name, extras=(), seen=None):
    """Distributions that one needs, of this interpreter, and theirs."""
    seen = set() if seen is None else seen
    for text in requires(name) or ():
        r = Requirement(text)
        if r.marker is None or any(r.marker.evaluate({"extra": extra}) for extra in ("", *extras)):
            key = canonicalize_name(r.name)
            if (key, *sorted(r.extras)) not in seen:
                seen.add((key, *sorted(r.extras)))
                needed(r.name, r.extras, seen)
    return {key for key, *_ in seen}


def test_every_package_that_is_installed_with_it_is_pinned():
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pins = dict(line.split("==") for line in lines if "==" in line)
    pins = {canonicalize_name(name): version for name, version in pins.items()}
    found = needed("fracid", ("dev",))
    assert {"numba", "numpy", "llvmlite"} <= found
    assert {name: distribution(name).version for name in found} == {name: pins.get(name) for name in found}


# --- a run folder from a stranger --------------------------------------------------------------------

LINKS = [".lock", ".memo", "evaluations.jsonl", "report.html", "figures", "figures/figure2.png", "starts"]
READERS = ["resid", "report", "export", "noise", "profile", "reproduce", "draw"]
WRITERS = {"fit": ["fit", "rig.toml", "--out", "run"], "compare": ["compare", "rig.toml", "--out", "run"],
           "resume": ["resume", "run"]}  # fmt: skip


@pytest.mark.few(2)
@pytest.mark.parametrize(
    ("words", "link"),
    [*(([command, "run"], "figures") for command in READERS), *((WRITERS["fit"], link) for link in LINKS),
     *((WRITERS[command], link) for command in ("compare", "resume") for link in (".lock", "figures"))],
    ids=str,
)  # fmt: skip
def test_a_link_in_a_run_folder_leads_nowhere(capsys, hostile, tmp_path, monkeypatch, words, link):
    monkeypatch.chdir(tmp_path)
    for name in (FILE, "rig.toml"):
        shutil.copy(hostile / "a" / "b" / name, tmp_path)
    mine = tmp_path / "mine"
    (mine / "inner").mkdir(parents=True)
    (mine / "inner" / "thesis.png").write_text("do not touch")
    target = mine / "inner" if link in ("figures", "starts") else mine / "inner" / "thesis.png"
    folder = tmp_path / "run"
    (folder / link).parent.mkdir(parents=True)
    shutil.copy("rig.toml", folder / "project.toml")
    options = {"project": str(tmp_path / "rig.toml")}
    state = {"options": options, "inputs": {}, "finished": False}
    for name, content in (("run.json", state), ("environment.json", {"command": []}), ("result.json", {})):
        (folder / name).write_text(json.dumps(content))
    if words[0] == "compare":
        (folder / "result.json").unlink()
    (folder / link).symlink_to(target)
    code, out, err = run(capsys, *words)
    assert (code, out) == (2, "")
    assert (mine / "inner" / "thesis.png").read_text() == "do not touch"
    assert [*(mine / "inner").iterdir()] == [mine / "inner" / "thesis.png"]
    assert f"run/{link} is a link, and what is written to a run folder stays in it" in err


@pytest.mark.few(2)
@pytest.mark.parametrize(
    ("command", "link"),
    [("fit", "runs"), ("fit", "runs/rig"), ("compare", "runs/rig-compare"), ("simulate", "runs/rig-simulated")],
)
def test_what_is_written_without_a_name_goes_through_no_link(capsys, sent, tmp_path, command, link):
    (tmp_path / "mine").mkdir()
    Path(link).parent.mkdir(exist_ok=True)
    Path(link).symlink_to(tmp_path / "mine")
    code, out, err = run(capsys, command, "rig.toml")
    assert (code, out, [*(tmp_path / "mine").iterdir()]) == (2, "", [])
    assert f"{link} is a link and leads elsewhere; name the folder to write to: --out runs/rig" in err
