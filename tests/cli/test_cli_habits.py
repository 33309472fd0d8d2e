"""Habits of a good program: completion, colours, widths, versions, an order in the help, and a start without delay."""

import io
import itertools
import json
import os
import pty
import re
import subprocess
import sys
from pathlib import Path

import pytest

import fracid.cli
from fracid.cli import app, completion
from fracid.cli.app import WORDS, print_table
from fracid.cli.completion import from_run, one_of
from program import run

COMMANDS = [command.callback.__name__ for command in app.registered_commands]
COLOUR = re.compile(r"\x1b\[(?:\d+;)*(?:3[0-7]|4[0-7]|9[0-7]|10[0-7]|38;[\d;]+|48;[\d;]+)(?:;\d+)*m")
ESCAPE = re.compile(r"\x1b\[")


# --- completion -------------------------------------------------------------------------------------------


def completed(capsys, monkeypatch, words, shell="bash"):
    """What a shell is offered for the last of some words."""
    with monkeypatch.context() as patch:
        patch.setenv("_FRACID_COMPLETE", f"complete_{shell}")
        typed = words.split(" ")
        patch.setenv("COMP_WORDS", words.strip())
        patch.setenv("COMP_CWORD", str(len(typed) - 1))
        patch.setenv("_TYPER_COMPLETE_ARGS", words)
        patch.setenv("_TYPER_COMPLETE_FISH_ACTION", "get-args")
        return run(capsys)[1]


@pytest.mark.broad
@pytest.mark.parametrize(
    ("words", "offered"),
    [
        ("fracid re", {name for name in COMMANDS if name.startswith("re")}),
        ("fracid fit rig.toml --opt", {"--optimiser"}),
        ("fracid fit rig.toml --optimiser ge", {"genetic"}),
        ("fracid simulate qu", {"qube-servo2"}),
        ("fracid simulate qube-servo2 --method pi2", {"pi2", "pi2-implicit"}),
        ("fracid init swing.mat --rig s", {"srv02-rotpen", "stepper-freeswing"}),
        ("fracid noise runs/rig --cost it", {"itae", "itse"}),
        ("fracid export runs/rig --to s", {"state-space"}),
        ("fracid regress rig.toml --estimator t", {"tls", "tukey"}),
        ("fracid check rel", set()),  # a file: the shell's own
    ],
)
@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_shell_completes_commands_options_and_values(capsys, monkeypatch, words, offered, shell):
    said = completed(capsys, monkeypatch, words, shell)
    if shell == "bash":
        assert set(said.split()) == offered
    elif shell == "zsh":
        assert set(re.findall(r'"([^"]+)"(?::"[^"]*")?', said)) >= offered
        assert bool(offered) or said.strip() == "_files"
    else:
        assert {line.split("\t")[0] for line in said.splitlines() if line} >= offered


def test_the_names_of_a_run_are_completed_from_its_result(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    content = {
        "orders": {"lambda": {"free": False}, "mu": {"free": True}},
        "parameters": {"C1": {"free": True}, "mass": {"free": False}},
        "recordings": {"swing": {}, "other": {}},
    }
    (tmp_path / "result.json").write_text(json.dumps(content))
    assert completed(capsys, monkeypatch, "fracid profile . --parameter ").split() == ["mu", "C1"]
    assert completed(capsys, monkeypatch, "fracid resid . --recording s").split() == ["swing"]
    (tmp_path / "result.json").write_text("{")
    assert completed(capsys, monkeypatch, "fracid profile . --parameter ").split() == []


@pytest.mark.few(1)
@pytest.mark.parametrize("table", completion.TABLES)
def test_names_are_completed_without_the_solver(table):
    code = (
        f"import sys; from fracid.cli.completion import keys; assert keys({table!r}); sys.exit('numba' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_recording_is_known_by_the_suffixes_that_can_be_read():
    from fracid.recording.readers.table import READERS
    from fracid.safety.paths import RECORDINGS

    assert set(RECORDINGS) == set(READERS)


def test_the_help_of_a_command_has_the_names_of_the_tables(capsys):
    out = " ".join(run(capsys, "noise", "--help")[1].replace("│", " ").split())
    assert ", ".join(completion.keys("costs")) in out


@pytest.mark.few(1)
@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_completion_of_each_shell_can_be_shown(shell):
    command = [sys.executable, "-c", "from fracid.cli import main; main()", "--show-completion"]
    environment = os.environ | {"_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}
    done = subprocess.run([*command, shell], capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    assert f"_FRACID_COMPLETE=complete_{shell}" in done.stdout


def test_a_word_that_cannot_be_completed_is_left_alone():
    assert one_of("a", "b")("c") == []
    assert callable(from_run("orders"))


# --- the help -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "command", [name for name in COMMANDS if name not in ("open", "models", "draw", "resume", "reproduce")]
)
def test_every_command_that_makes_something_takes_folder_seed_threads_and_json(command):
    assert {"out", "seed", "jobs", "json_"} <= {*WORDS[command]["options"]}


def test_a_draft_and_a_page_are_told_to_programs(capsys, swing, tmp_path):
    code, out, _ = run(capsys, "init", swing, "--yes", "--json", "--out", tmp_path / "p.toml")
    said = json.loads(out)
    assert (code, said["project"], said["model"]) == (0, str(tmp_path / "p.toml"), "rotary-pendulum")
    assert said["notes"]


def test_every_command_has_a_place_in_the_help_in_the_order_of_use(capsys):
    placed = [name for name in WORDS if name != "every"]
    assert set(COMMANDS) <= set(placed)
    assert [name for name in placed if name in COMMANDS] == COMMANDS
    _, out, _ = run(capsys, "--help")
    places = [out.index(f"─ {panel} ─") for panel in dict.fromkeys(WORDS[name]["panel"] for name in placed)]
    assert places == sorted(places)
    assert "fracid demo" in out


def test_each_command_is_one_line_of_the_help_at_80_columns(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    out = run(capsys, "--help")[1]
    for name in COMMANDS:
        (line,) = re.findall(rf"^│ {name} .*│$", out, re.MULTILINE)
        assert line.rstrip(" │").endswith((".", "?"))


@pytest.mark.parametrize("command", COMMANDS)
def test_the_help_of_every_command_has_an_example_that_is_of_it(capsys, command):
    code, out, err = run(capsys, command, "--help")
    assert (code, err) == (0, "")
    assert "<bool>" not in out
    assert "Example" in out
    assert f"fracid {command}" in out.split("Example", 1)[1]


@pytest.mark.few(9)
@pytest.mark.parametrize("width", [80, 100])
@pytest.mark.parametrize("command", COMMANDS)
def test_an_example_ends_where_it_says_so_and_can_be_pasted(capsys, monkeypatch, command, width):
    monkeypatch.setenv("COLUMNS", str(width))
    lines = run(capsys, command, "--help")[1].split("Example", 1)[1].splitlines()[1:]
    for before, line in itertools.pairwise(line.rstrip() for line in lines):
        goes_on = before.endswith("\\")
        assert line.startswith("   " if goes_on else (" fracid ", " # ")) or not (line or goes_on)


def test_the_help_needs_no_module_that_takes_time():
    code = (
        "import sys\nfrom fracid.cli import main\ntry: main(['--help'])\nexcept SystemExit: pass\n"
        "heavy = {'numpy', 'scipy', 'numba', 'matplotlib', 'pydantic', 'pandas'} & set(sys.modules)\n"
        "print(*heavy, file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr.split() == []


# --- colours ------------------------------------------------------------------------------------------------


class Terminal:
    """A pseudo-terminal in the place of standard output, and what was written to it."""

    def __enter__(self):
        self.ours, theirs = pty.openpty()
        self.file = os.fdopen(theirs, "w", encoding="utf-8")
        return self

    def __exit__(self, *_):
        self.file.close()
        os.close(self.ours)

    def text(self):
        self.file.flush()
        os.set_blocking(self.ours, False)
        parts = []
        try:
            while part := os.read(self.ours, 65536):
                parts.append(part)
        except OSError:  # nothing more
            pass
        return b"".join(parts).decode()


def shown(monkeypatch, words, terminal=True, width=100, **environment):
    """What a command shows on a terminal, or through a pipe."""
    from fracid.cli.app import main

    for name in ("NO_COLOR", "FORCE_COLOR", "PY_COLORS", "GITHUB_ACTIONS", "COLORTERM"):
        monkeypatch.delenv(name, raising=False)
    for name, value in {"TERM": "xterm-256color", "COLUMNS": str(width), **environment}.items():
        monkeypatch.setenv(name, value)
    if not terminal:
        command = [sys.executable, "-m", "fracid", *words]
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
        return done.stdout
    with Terminal() as there, monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", there.file)
        with pytest.raises(SystemExit):
            main(words)
        return there.text()


@pytest.fixture(scope="module")
def swing(tmp_path_factory):
    """A recording to look at."""
    from fracid.cli.app import main

    file = tmp_path_factory.mktemp("colours") / "swing.csv"
    with pytest.raises(SystemExit):
        main(["simulate", "qube-servo2", "--end", "3", "--hold", "0.5", "--step", "5ms", "--to", str(file)])
    return file


@pytest.mark.few(2)
@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_the_help_is_coloured_on_a_terminal_alone_never_with_no_color_and_never_wider(capsys, monkeypatch, command):
    words = [w for w in (command, "--help") if w]
    for width, coloured in ((60, True), (100, False)):
        text = shown(monkeypatch, words, width=width, **({} if coloured else {"NO_COLOR": "1"}))
        assert bool(COLOUR.search(text)) == coloured
        lines = re.sub(r"\x1b\[[\d;?]*[a-zA-Z]", "", text).replace("\r", "").split("\n")
        assert max(map(len, lines)) <= width
        assert not any(line.rstrip(" │").endswith("…") for line in lines)  # nothing is cut off
    assert not ESCAPE.search(run(capsys, *words)[1])  # captured: no terminal


def main_outputs(swing):
    return [["check", str(swing)], ["simulate", "qube-servo2", "--end", "1", "--to", str(swing.with_name("x.npz")),
            "--force"], ["init", str(swing), "--yes", "--force", "--out", str(swing.with_suffix(".toml"))]]  # fmt: skip


@pytest.mark.few(1)
@pytest.mark.parametrize("which", range(3))
def test_what_a_command_prints_is_coloured_on_a_terminal_alone_and_never_with_no_color(monkeypatch, swing, which):
    words = main_outputs(swing)[which]
    coloured = shown(monkeypatch, words)
    assert bool(COLOUR.search(coloured)) == (which < 2)  # init prints sentences alone
    assert not COLOUR.search(shown(monkeypatch, words, NO_COLOR="1"))
    assert not COLOUR.search(shown(monkeypatch, words, NO_COLOR="1", FORCE_COLOR="1"))
    assert not ESCAPE.search(shown(monkeypatch, words, TERM="dumb"))


@pytest.mark.broad
def test_through_a_pipe_there_is_no_colour_unless_it_is_forced(monkeypatch, swing):
    words = ["check", str(swing)]
    assert not ESCAPE.search(shown(monkeypatch, words, terminal=False))
    assert COLOUR.search(shown(monkeypatch, words, terminal=False, FORCE_COLOR="1"))
    plain = shown(monkeypatch, [*words, "--json"], terminal=False, FORCE_COLOR="1")
    assert json.loads(plain)["level"] == "good"


def test_every_command_prints_through_the_one_console_that_keeps_to_this():
    """Then what holds for three commands above holds for all."""
    folder = Path(completion.__file__).parent
    for file in folder.glob("*.py"):
        if file.name not in ("app.py", "progress.py"):
            text = file.read_text(encoding="utf-8")
            assert not re.search(r"\bConsole\(|\bprint\(|\\x1b|\\033", text.replace("console.print(", "")), file.name


@pytest.mark.parametrize("width", [60, 100])
def test_a_table_of_a_check_fits_the_terminal(monkeypatch, swing, width):
    text = re.sub(r"\x1b\[[\d;?]*[a-zA-Z]", "", shown(monkeypatch, ["check", str(swing)], width=width))
    table = [line for line in text.replace("\r", "").split("\n") if line.startswith(("signal", "theta", "alpha"))]
    assert len(table) == 3
    assert max(map(len, table)) <= width


# --- versions -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("terminal", [True, False])
def test_a_table_is_broken_between_words_on_a_narrow_terminal_and_nowhere_in_a_pipe(terminal):
    from rich.console import Console

    shown, verdict = io.StringIO(), "practically non-identifiable"
    console = Console(file=shown, force_terminal=terminal, width=60, color_system=None)
    print_table(
        console, ("name", "95 % interval", "unit", ""), [("theta_rest", "-1 … 1", "rad", verdict)], ("name", "")
    )
    assert (verdict in shown.getvalue()) != terminal
    assert {*verdict.split()} < {*shown.getvalue().split()}


def test_the_version_is_told_with_those_that_results_depend_on_where_json_is_asked_for(capsys):
    import fracid

    code, out, _ = run(capsys, "--version")
    assert (code, out) == (0, f"fracid {fracid.__version__}\n")
    for words in (["--version", "--json"], ["--json", "--version"]):
        code, out, _ = run(capsys, *words)
        assert code == 0
        assert set(json.loads(out)) >= {"fracid", "python", "numpy", "scipy", "numba"}


def test_long_names_are_not_broken_on_a_narrow_terminal(monkeypatch, tmp_path):
    name = "states_of_joint_1/position_of_its_encoder"
    rows = "\n".join(f"{k / 100},{0.5 ** (k / 50) * (-1) ** (k // 20):.4f}" for k in range(400))
    (tmp_path / "log.csv").write_text(f"time,{name}\n{rows}\n")
    text = re.sub(r"\x1b\[[\d;?]*[a-zA-Z]", "", shown(monkeypatch, ["check", str(tmp_path / "log.csv")], width=60))
    line = next(line for line in text.replace("\r", "").split("\n") if line.startswith(name))
    assert line.startswith(f"{name}: range -")
    assert len(line) <= 60


@pytest.mark.parametrize("path", sorted(Path(fracid.cli.__file__).parent.glob("*.py")), ids=lambda p: p.stem)
def test_a_remark_behind_an_example_of_the_help_is_a_comment_of_the_shell(path):
    assert "[dim](" not in path.read_text(encoding="utf-8")
