"""Whatever a file's texts say: on a page, in a figure, on a terminal and in a table they are texts."""

import csv
import io
import json
import shutil
from html.parser import HTMLParser

import matplotlib as mpl
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

import fracid
from fracid.estimation.records import RecordingFit
from fracid.export.table import _csv
from fracid.plots import appearance
from fracid.problem import Experiment
from fracid.safety.text import csv_cell, json_text, printable
from program import run

EVIL = "\"'><img src=x onerror=alert(1)></script><script>alert(2)</script> [red]{{7*7}} $\\frac{ \\input{x} ${run} =1+1"
TERMINAL = "\x1b[2J\x1b]0;owned\x07\x9b31m\u202eevil\u2066\x7f"


# --- the page ----------------------------------------------------------------------------------------


class Elements(HTMLParser):
    """Elements with their attributes' names, and the texts of scripts."""

    def __init__(self, page):
        super().__init__()
        self.seen, self.scripts, self.policy = [], [], ""
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.seen.append((tag, tuple(name for name, _ in attrs)))
        given_ = dict(attrs)
        if tag == "script":
            self.scripts.append("")
        if given_.get("http-equiv") == "Content-Security-Policy":
            self.policy = given_["content"]

    def handle_data(self, data):
        if self.scripts and self.seen[-1][0] == "script":
            self.scripts[-1] += data


def with_texts(value, evil):
    """The same JSON value, every text that is no name in it another one."""
    if isinstance(value, dict):
        kept = ("use", "origin", "data_sha256", "preset", "outputs")
        return {k: v if k in kept else with_texts(v, evil) for k, v in value.items()}
    if isinstance(value, list):
        return [with_texts(v, evil) for v in value]
    return evil if isinstance(value, str) else value


@pytest.mark.few(1)
@pytest.mark.parametrize("evil", [EVIL, TERMINAL], ids=["page", "terminal"])
def test_no_text_of_a_run_becomes_an_element_of_its_page(sent, evil):
    clean = Elements(fracid.write_report(sent).read_text(encoding="utf-8"))
    result = json.loads((sent / "result.json").read_text())
    own = {name: result[name] for name in ("data_sha256", "claim", "outcome")}  # a digest, and one of so many words
    result = with_texts(result, evil) | {"warnings": [evil], "findings": []} | own
    (sent / "result.json").write_text(json.dumps(result))
    environment = {"platform": evil, "processor": evil, "command": ["fit", "rig.toml", evil], "versions": {evil: evil}}
    (sent / "environment.json").write_text(json.dumps(environment))
    page = fracid.write_report(sent).read_text(encoding="utf-8")
    found = Elements(page)
    assert {tag for tag, _ in found.seen} <= {tag for tag, _ in clean.seen} | {"li", "ul", "p", "code", "pre"}
    assert not any(name.startswith("on") for _, names in found.seen for name in names)
    assert found.policy == clean.policy
    assert "default-src 'none'" in found.policy
    assert found.scripts[1:] == clean.scripts[1:]  # the first holds the samples
    json.loads(found.scripts[0])
    assert len(found.scripts) == len(clean.scripts)
    assert evil not in page


# --- figures -----------------------------------------------------------------------------------------


@pytest.mark.broad
@given(st.text(alphabet="$\\{}^_%#&~ aé\n\t\u202e✗", max_size=20))
@example(r"$\frac{")
@example(r"\$")
@example("a\\")
@example(r"$$")
def test_what_a_recording_is_called_is_no_formula_in_a_figure(text):
    figure = Figure(figsize=(2, 2))
    FigureCanvasAgg(figure)
    for label in (
        appearance.plain(text),
        f"{appearance.plain(text)}: $\\alpha$ [{appearance.plain(text)}]",
        appearance.symbol(f"mu({text}"),
    ):
        figure.text(0.5, 0.5, label)
    figure.draw_without_rendering()  # a formula that is none would raise


def test_no_figure_is_set_by_latex_whatever_matplotlib_is_told():
    recording = RecordingFit("$\\input{x}", "fit", np.arange(9.0), {"alpha": np.sin(np.arange(9.0))},
                             {"alpha": np.zeros(9)}, 1.0, {}, {})  # fmt: skip
    with mpl.rc_context({"text.usetex": True}):
        figure = fracid.plots.fitted_over_time(recording)
        assert not any(text.get_usetex() for text in figure.findobj(Text) if text.get_text())


# --- a terminal --------------------------------------------------------------------------------------


@pytest.mark.broad
@given(st.recursive(st.none() | st.booleans() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
                    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner), max_leaves=8))  # fmt: skip
@example({TERMINAL: [TERMINAL, "λ", "\U000e0001"]})
def test_json_on_a_terminal_means_the_same_and_commands_nothing(value):
    text = json_text(value)
    assert json.loads(text) == value
    assert printable(text) == text


@pytest.mark.broad
def test_columns_and_folders_with_a_terminals_commands_are_shown_without(capsys, sent):
    np.savetxt("evil.csv", np.column_stack([np.arange(9.0), np.arange(9.0) % 2, np.arange(9.0) % 3]), delimiter=",",
               header=f"t,a,{TERMINAL.replace(chr(7), '')}", comments="", encoding="utf-8")  # fmt: skip
    shutil.move(sent, "run\x1b[31m")
    for words in (["check", "evil.csv"], ["check", "evil.csv", "--json"], ["report", "run\x1b[31m"],
                  ["export", "run\x1b[31m", "--to", "csv"], ["export", "run\x1b[31m", "--to", "csv", "--json"],
                  ["resume", "run\x1b[31m"], ["resume", "run\x1b[31m", "--json"]):  # fmt: skip
        _, out, err = run(capsys, *words)
        assert printable(out + err) == out + err, words


# --- tables ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["=1+1", 'a"b', "a,b", "@SUM(A1)", "a\nb"])
def test_a_tables_heading_is_one_cell_and_no_formula(name):
    recording = RecordingFit("swing", "fit", np.arange(2.0), {name: np.zeros(2)}, {name: np.zeros(2)}, 1.0, {}, {},
                             units={name: "V"})  # fmt: skip
    undriven = Experiment("swing", 1.0, np.zeros((2, 1)), np.zeros((1, 1)))
    text = _csv(recording, undriven, fracid.rotary_pendulum())
    rows = list(csv.reader(io.StringIO(text, newline="")))
    assert [len(row) for row in rows] == [4, 4, 4]
    assert rows[0][1] == csv_cell(f"{name} measured [V]")
