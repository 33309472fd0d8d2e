"""``fracid fit`` and ``fracid demo``: tables, JSON, figures, exit codes, and never a traceback."""

import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import BrokenExecutor, Future
from contextlib import contextmanager

import numpy as np
import pytest

from fracid.cli import fit as cli_fit
from fracid.estimation import horizons
from fracid.tasks.progress import Observer
from program import leave_figures_out, run
from twins import write_release

FAST = "[model.orders]\nlambda = 0.9\n"
RECORDING = """
[[recording]]
name = "release 20°"
file = "swing.csv"
theta = { column = "theta", unit = "rad" }
alpha = { column = "alpha", unit = "rad" }
initial = { theta = 0.0, alpha = 0.35 }
"""
FIT = '[fit]\ninitial_state = "held"\nsubsteps = 1\n'  # the step that the twin is made with


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a twin of 2 s and a project file."""
    folder = tmp_path_factory.mktemp("fit")
    write_release(folder / "swing.csv", alpha=0.35, step=5e-3, end=2.0, noise=1e-3)
    (folder / "rig.toml").write_text(RECORDING + FIT, encoding="utf-8")
    return folder


@pytest.fixture
def project(folder, without_rivals):
    """A function that writes a project file beside the twin."""

    def write(text):
        (folder / "other.toml").write_text(text, encoding="utf-8")
        return folder / "other.toml"

    return write


@pytest.fixture
def undrawn(monkeypatch, without_rivals):
    """Leave out the figures, and the models of integer order, which take longer than all the rest."""
    leave_figures_out(monkeypatch)


def program(*arguments, **options):
    """Start the program as a process of its own."""
    command = [sys.executable, "-m", "fracid", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=120, **options)


# --- what it gives ----------------------------------------------------------------------------------------


def test_a_fit_shows_its_table_and_leaves_a_whole_run_folder_with_its_figures(capsys, folder, tmp_path):
    code, out, err = run(capsys, "fit", folder / "rig.toml", "--out", tmp_path / "run")
    assert (code, err) == (0, "")
    assert "rotary-pendulum, hanging; pi2, memory compressed(1e-10), step 5 ms; multistart" in out
    assert "converged" in out
    assert "release 20°" in out
    assert "discretisation: with pi2 at half the step" in out
    assert out.startswith("claim: fractional. λ = ")
    result = json.loads((tmp_path / "run" / "result.json").read_text())
    assert result["orders"]["mu"]["value"] == pytest.approx(0.95, abs=1e-3)
    names = {p.name for p in (tmp_path / "run").iterdir()}
    written = {
        "result.json",
        "report.html",
        "project.toml",
        "run.json",
        "environment.json",
        "evaluations.jsonl",
        "figures",
    }
    assert names == {*written, ".lock"}
    assert (tmp_path / "run" / "project.toml").read_text() == (folder / "rig.toml").read_text()
    log = (tmp_path / "run" / "evaluations.jsonl").read_text().splitlines()
    assert len(log) == result["evaluations"]

    stems = ["figure1-rig", "figure2-release-20", "figure3-release-20-theta", "figure3-release-20-alpha"]
    stems += ["cost-over-orders"]
    for stem in stems:
        assert (tmp_path / "run" / "figures" / f"{stem}.png").read_bytes().startswith(b"\x89PNG")
        assert "<svg" in (tmp_path / "run" / "figures" / f"{stem}.svg").read_text()
        assert stem in " ".join(out.split())
    assert len(list((tmp_path / "run" / "figures").iterdir())) == 2 * len(stems)


@pytest.mark.usefixtures("undrawn")
@pytest.mark.broad
def test_json_is_all_that_stands_on_standard_output_and_events_on_standard_error(capsys, project, tmp_path):
    code, out, err = run(capsys, "fit", project(FAST + RECORDING + FIT), "--out", tmp_path, "--json")
    events = [json.loads(line) for line in err.splitlines()]
    assert code == 0
    assert {event["event"] for event in events} == {"stage", "progress"}
    assert [e for e in events if e["event"] == "progress"][-1]["done"] == json.loads(out)["evaluations"]
    assert json.loads(out) == json.loads((tmp_path / "result.json").read_text())
    content = json.loads(out)
    assert set(content["versions"]) >= {"fracid", "numpy", "scipy", "numba", "python"}
    assert len(content["data_sha256"]["release 20°"]) == 64
    assert {"load", "search", "uncertainty", "discretisation", "figures", "total"} <= set(content["timing"])


@pytest.mark.broad
@pytest.mark.usefixtures("undrawn")
def test_result_json_is_the_same_for_any_jobs_but_for_its_timing(capsys, project, tmp_path):
    text, found = FAST + RECORDING + FIT, []
    for jobs in (1, 3):
        run(capsys, "fit", project(text), "--out", tmp_path / str(jobs), "--jobs", jobs)
        content = json.loads((tmp_path / str(jobs) / "result.json").read_text())
        content.pop("timing")
        found.append(json.dumps(content))
    assert found[0] == found[1]


@pytest.mark.broad
@pytest.mark.usefixtures("undrawn")
def test_the_paper_preset_ends_with_an_answer_and_its_warnings(capsys, folder, tmp_path):
    code, out, _ = run(capsys, "fit", folder / "rig.toml", "--preset", "paper", "--out", tmp_path)
    assert code == 0
    assert "gl-paper" in out
    assert "genetic, 520 evaluations" in out
    assert "! gl-paper sums raw x (21)-(24)" in out
    assert "! Only α is scored, and it carries almost no information about λ: score θ too." in out
    assert json.loads((tmp_path / "result.json").read_text())["preset"] == "paper"


@pytest.mark.broad
@pytest.mark.usefixtures("undrawn")
def test_options_replace_what_the_file_says(capsys, project, tmp_path):
    path = project(FAST + RECORDING + FIT + 'seed = 3\noptimiser = "genetic"\n')
    _, out, _ = run(capsys, "fit", path, "--optimiser", "least-squares", "--seed", 9, "--out", tmp_path, "--json")
    content = json.loads(out)
    assert (content["optimiser"], content["seed"]) == ("least-squares", 9)


@pytest.mark.broad
def test_many_starts_have_their_line_their_figure_and_their_place_in_the_result(capsys, project, tmp_path):
    _, out, _ = run(capsys, "fit", project(FAST + RECORDING + FIT), "--multi-start", 3, "--out", tmp_path)
    ended = [s["cost"] for s in json.loads((tmp_path / "result.json").read_text())["starts"] if s["cost"] is not None]
    assert f"starts: {sum(c < 1.01 * min(ended) for c in ended)} of 3 starts reached the lowest cost" in " ".join(
        out.split()
    )
    assert (tmp_path / "figures" / "waterfall.png").read_bytes().startswith(b"\x89PNG")
    result = json.loads((tmp_path / "result.json").read_text())
    assert len(result["starts"]) == 3
    assert result["start_that_won"] in {s["origin"] for s in result["starts"]}


@pytest.mark.broad
@pytest.mark.usefixtures("undrawn")
def test_many_starts_run_on_processes_and_an_executor_without_them_is_refused(capsys, project, undrawn, tmp_path):
    path = project(FAST + RECORDING + FIT)
    code, out, err = run(
        capsys, "fit", path, "--out", tmp_path / "run", "--multi-start", "3", "--executor", "processes"
    )
    assert code == 0, err
    assert len((tmp_path / "run" / "starts" / "journal.jsonl").read_text().splitlines()) == 4  # a head and three
    assert "starts: " in out
    code, _, err = run(capsys, "fit", path, "--out", tmp_path / "other", "--executor", "processes")
    assert code == 2
    assert "are for many starts; say how many: --multi-start N" in err


@pytest.mark.broad
def test_multi_start_replaces_the_files_starts_and_optimiser(capsys, project, tmp_path):
    path = project(FAST + RECORDING + FIT + 'starts = 4\noptimiser = "genetic"\n')
    _, out, _ = run(capsys, "fit", path, "--multi-start", 2, "--out", tmp_path, "--json")
    content = json.loads(out)
    assert (content["optimiser"], len(content["starts"])) == ("multistart", 2)


@pytest.mark.broad
def test_a_record_that_begins_in_motion_is_cut_elsewhere_where_that_is_asked_for(capsys, project, tmp_path):
    moving = RECORDING.replace("initial =", "from = 0.2\n# initial =") + '[fit]\ninitial_state = "estimate"\n'
    path = project("[model.orders]\nlambda = 0.9\nmu = { start = 0.9, lower = 0.5, upper = 1.2 }\n" + moving)
    code, out, _ = run(capsys, "fit", path, "--out", tmp_path / "run")
    assert code == 0
    assert "cut: a record begins in motion; --cut shows" in out
    assert json.loads((tmp_path / "run" / "result.json").read_text())["cut"] is None
    code, out, _ = run(capsys, "fit", path, "--out", tmp_path / "run", "--cut")
    assert code == 0
    assert "--cut shows" not in out
    found = json.loads((tmp_path / "run" / "result.json").read_text())["cut"]
    assert "with the past" in found["treatments"]  # the samples before `from` are in the file
    assert (tmp_path / "run" / "figures" / "cut.svg").exists()


@pytest.mark.broad
def test_a_validation_recording_is_drawn_and_listed(capsys, project, tmp_path):
    second = RECORDING.replace("release 20°", "held out") + 'use = "validate"\n'
    _, out, _ = run(capsys, "fit", project(FAST + RECORDING + second + FIT), "--out", tmp_path)
    assert "validate" in out
    assert (tmp_path / "figures" / "figure2-held-out.png").exists()


@pytest.mark.usefixtures("undrawn")
@pytest.mark.broad
def test_the_default_folder_is_runs_and_the_name(capsys, project, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    run(capsys, "fit", project(FAST + RECORDING + FIT), "--json")
    assert (tmp_path / "runs" / "other" / "result.json").exists()


@pytest.mark.parametrize("command", ["fit", "demo"])
def test_help_has_an_example(capsys, command):
    code, out, _ = run(capsys, command, "--help")
    assert code == 0
    assert "Example" in out
    assert f"fracid {command} " in out.split("Example")[1]
    for option in ("--out", "--seed", "--jobs", "--json"):
        assert option in out


# --- what cannot be: exit code 2 or 3, a sentence, no traceback -----------------------------------------


@pytest.mark.few(2)
@pytest.mark.parametrize(
    ("text", "code", "message"),
    [
        ("[model.orders]\nmu = 0.0\n" + RECORDING, 2, "order mu = 0.0: expected a number between 0 and 2"),
        ("[model.orders]\nmu = 2.5\n" + RECORDING, 2, "order mu = 2.5: expected a number between 0 and 2"),
        (RECORDING.replace("swing.csv", "nan.csv"), 3, "alpha has no sample: choose another column"),
        (RECORDING.replace('"alpha"', '"beta"'), 2, "has no column 'beta'"),
        (RECORDING.replace("swing.csv", "empty.csv"), 3, "empty.csv is empty"),
        (RECORDING.replace("swing.csv", "text.csv"), 3, "'hello' is not a number"),
        (RECORDING.replace("swing.csv", "no.csv"), 2, "no file"),
        (RECORDING + "[fit\n", 2, "is not TOML"),
        ("[model.orders]\nlambda = 1.0\nmu = 1.0\n" + RECORDING + FIT, 2, "Nothing is free"),
        (FAST + RECORDING + FIT + 'cost = "cost.py:broken"\n', 2, "The cost broken fails: ZeroDivisionError"),
        (FAST + RECORDING + FIT + 'cost = "cost.py:fine"\n', 2, "This cost has no residuals for least squares"),
    ],
)
def test_what_cannot_be_is_a_sentence_and_an_exit_code(capsys, folder, project, tmp_path, text, code, message):
    lines = (folder / "swing.csv").read_text().splitlines()
    blank = [f"{line.rpartition(',')[0]},nan" for line in lines[1:]]
    (folder / "nan.csv").write_text("\n".join([*lines[:1], *blank]))
    (folder / "text.csv").write_text("\n".join([*lines[:8], "hello,0,0", *lines[9:]]))
    (folder / "empty.csv").write_text("")
    (folder / "cost.py").write_text("def broken(t, e):\n    return 1 / 0\ndef fine(t, e):\n    return (e * e).sum()\n")
    found, out, err = run(capsys, "fit", project(text), "--out", tmp_path / "run", "--json", "--trust")
    assert (found, out) == (code, "")
    assert err.splitlines()[-1].startswith("unfit recording: " if code == 3 else "error: ")
    assert message in err
    assert "Traceback" not in err


@pytest.mark.broad
@pytest.mark.parametrize("constants", ["C3 = 0.1", "b_alpha = -0.5"])
def test_a_model_whose_every_run_fails_ends_with_3_and_its_reason(capsys, project, tmp_path, constants):
    path = project(f"[model.parameters]\n{constants}\n" + FAST + RECORDING + FIT)
    code, out, err = run(capsys, "fit", path, "--out", tmp_path)
    assert (code, err) == (3, "")
    assert "every run failed;" in out
    assert "No run reached its end: release 20°: " in out
    assert "det M = 0" in out or "unsettled" in out
    assert json.loads((tmp_path / "result.json").read_text())["cost"]["value"] is None
    assert out.startswith("claim: undecided. The model does not fit: no run of it reached the end of a recording.")
    assert "nan" not in out
    assert "The model does not fit, so nothing is known of its orders" in (tmp_path / "report.html").read_text()


@pytest.mark.broad
def test_a_value_at_its_bound_is_shown_as_that_bound_with_an_interval_that_begins_there(capsys, project, tmp_path):
    text = "[model.orders]\nlambda = 0.9\nmu = 0.95\n"
    text += "[model.parameters]\ndrag_alpha = { start = 1e-4, lower = 0.0, upper = 0.1 }\n"  # there is none
    text += "b_alpha = { start = 1e-4, lower = 0.0, upper = 0.1 }\n"
    code, out, _ = run(capsys, "fit", project(text + RECORDING + FIT), "--out", tmp_path / "run")
    assert code == 0
    (row,) = [line.split() for line in out.splitlines() if line.startswith("drag_alpha ")]
    said = json.loads((tmp_path / "run" / "result.json").read_text())["parameters"]
    assert said["drag_alpha"]["bound"] == 0.0
    assert said["b_alpha"]["bound"] is None
    assert (row[1], float(row[2]), row[3]) == ("0", 0.0, "…")  # its interval begins there
    assert float(row[4]) > 0
    page = (tmp_path / "run" / "report.html").read_text()
    assert f'<data value="{said["drag_alpha"]["value"]}">0</data></td>' in page
    assert f">{row[2]} … {row[4]}</data>" in page


OWN = """
from fracid.models import Model, Parameter

def rhs(t, x, u, p, out):
    out[0] = -p[0] * x[0]

model = Model(name="decay", rhs=rhs, states=("y",), orders=("q",), outputs={"y": 0}, inputs=(),
              parameters=(Parameter("rate", "1/s", 1.0, "of decay"),), zero="", source="a test",
              integer_orders={"q": None})
"""


@pytest.mark.broad
def test_a_model_whose_order_has_no_integer_value_has_no_rival_and_the_fit_says_so(capsys, tmp_path):
    t = np.arange(0, 4, 0.02)
    np.savetxt(tmp_path / "y.csv", np.column_stack([t, np.exp(-t)]), delimiter=",", header="t,y", comments="")
    (tmp_path / "own.py").write_text(OWN)
    (tmp_path / "own.toml").write_text("""
[model]
name = "own.py:model"
[model.orders]
q = { start = 0.9, lower = 0.5, upper = 1.2 }
[model.parameters]
rate = { start = 0.8, lower = 0.1, upper = 3.0 }
[[recording]]
file = "y.csv"
time = { column = "t", unit = "s" }
y = { column = "y", unit = "1" }
""")
    code, out, _ = run(capsys, "fit", tmp_path / "own.toml", "--out", tmp_path / "run", "--trust")
    assert code == 0
    assert "integer order: no alternative model was tried: the model gives q no integer value" in out
    said = json.loads((tmp_path / "run" / "result.json").read_text())
    assert (said["alternative"], said["orders"]["q"]["integer"]) == (None, None)
    page = (tmp_path / "run" / "report.html").read_text()
    assert "None was tried: the model gives its free orders no integer value (integer_orders)." in page
    assert "The model gives q no integer value, so it has no integer-order alternative." in page


def test_a_folder_with_foreign_files_is_refused(capsys, folder, tmp_path):
    (tmp_path / "thesis.tex").write_text("x")
    code, _, err = run(capsys, "fit", folder / "rig.toml", "--out", tmp_path)
    assert code == 2
    assert "holds files that are not a run's; give an empty or a new folder: --out DIR" in err


@pytest.mark.few(2)
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("no.toml",), "There is no no.toml. There "),
        (("rig.toml", "--preset", "papr"), "unknown preset 'papr': did you mean paper"),
        (("rig.toml", "--optimiser", "genetik"), "unknown optimiser 'genetik'"),
        (("rig.toml", "--jobs", "0"), "--jobs"),
        (("rig.toml", "--multi-start", "0"), "--multi-start"),
        (
            ("rig.toml", "--multi-start", "4", "--optimiser", "cma"),
            "--multi-start is for the optimiser multistart, not",
        ),
        (("rig.toml", "--seed", "x"), "--seed"),
        ((), "PROJECT"),
    ],
)
def test_a_wrong_option_is_told(capsys, folder, monkeypatch, arguments, message):
    monkeypatch.chdir(folder)
    code, out, err = run(capsys, "fit", *arguments)
    assert (code, out) == (2, "")
    assert message in err


@pytest.mark.broad
def test_an_interrupted_search_ends_with_1_and_keeps_its_best(capsys, project, tmp_path, monkeypatch):
    module, calls = horizons, []

    def minimise(*args, **options):
        def callback(best, n):
            calls.append(n)
            if len(calls) > 3:
                raise KeyboardInterrupt

        return real(*args, **options | {"callback": callback})

    real = module.minimise
    monkeypatch.setattr(module, "minimise", minimise)
    code, out, _ = run(capsys, "fit", project(RECORDING + FIT), "--out", tmp_path)
    assert code == 1
    assert out.startswith("PARTIAL: the fit was interrupted.")
    assert "interrupted: the best so far is kept" in out
    assert "There are no intervals: the search was interrupted." in out
    result = json.loads((tmp_path / "result.json").read_text())
    assert result["cost"]["value"] > 0
    assert (tmp_path / "figures" / "figure2-release-20.png").exists()


@pytest.mark.few(1)
@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("where", ["fracid.workflows.fit.load_project", "fracid.identification.search"])
def test_ctrl_c_before_the_search_leaves_no_folder_and_says_so(capsys, project, tmp_path, monkeypatch, where):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(where, interrupted)
    code, out, err = run(capsys, "fit", project(FAST + RECORDING + FIT), "--out", tmp_path / "run")
    assert (code, out, err) == (1, "", "Interrupted before the search: nothing was written.\n")
    assert not (tmp_path / "run").exists()


@pytest.mark.broad
def test_the_result_is_told_before_the_figures_are_drawn(capsys, project, tmp_path, monkeypatch):
    shown = []

    def draw(_fit):
        shown.append(capsys.readouterr().out)
        return ()

    leave_figures_out(monkeypatch, draw)
    code, *_ = run(capsys, "fit", project(FAST + RECORDING + FIT), "--out", tmp_path / "run")
    assert code == 0
    assert f"result   {tmp_path / 'run' / 'result.json'}" in shown[0]


@pytest.mark.parametrize(("tables", "stages"), [(True, True), (True, False), (False, True)])
def test_a_terminal_that_showed_a_fault_before_the_search_does_not_repeat_it(monkeypatch, tables, stages):
    heard, shows = [], []

    @contextmanager
    def shown(stage, *, events, result):
        shows.append(result)
        yield Observer(notice=heard.append)

    monkeypatch.setattr(cli_fit, "shown", shown)
    monkeypatch.setattr(sys.stdout, "isatty", lambda: tables, raising=False)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: stages, raising=False)
    with cli_fit.watched("recordings", json_=False) as observer:
        observer.notice("A sign may be wrong.")
    assert heard == ["A sign may be wrong."]
    assert shows[0].keywords["told"] == (heard if tables and stages else [])


def test_notes_that_differ_in_output_and_numbers_are_one():
    notes = ["low: theta: the residual is 0.22°, 8.5 steps.", "no fault", "low: alpha: the residual is 0.21°, 7 steps."]
    folded = cli_fit._folded(notes, ("theta", "alpha"), ("low",))
    assert folded == ["low: theta: the residual is 0.22°, 8.5 steps. The same holds for alpha.", "no fault"]


def test_notes_that_differ_in_the_recording_or_in_numbers_alone_are_several():
    names = ("1: multisine, peak 2", "2: multisine, peak 2", "alpha 3")
    notes = [*(f"{name}: alpha: the residual is 0.2°." for name in names), "alpha 3: alpha: the residual is 0.4°."]
    assert cli_fit._folded(notes, ("theta", "alpha"), names) == notes


# --- as a process -----------------------------------------------------------------------------------------


@pytest.mark.broad
def test_the_program_says_what_is_wrong_without_a_traceback(folder):
    done = program("fit", folder / "swing.csv")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("error: ")
    assert "swing.csv is a recording, not a project. Write a project of it: fracid init" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.broad
@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
def test_ctrl_c_ends_the_program_with_1_and_its_result(folder, tmp_path):
    path = tmp_path / "long.toml"  # a search that would take a minute
    text = RECORDING.replace("swing.csv", str(folder / "swing.csv")) + FIT
    assert "substeps = 1\n" in text
    slow = text.replace("substeps = 1\n", 'substeps = 100\noptimiser = "differential-evolution"\n')
    path.write_text(slow, encoding="utf-8")
    command = [sys.executable, "-m", "fracid", "fit", str(path), "--out", str(tmp_path / "run"), "--jobs", "1"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        log, began = tmp_path / "run" / "evaluations.jsonl", time.monotonic()
        while not (log.exists() and log.stat().st_size) and time.monotonic() < began + 180:
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=180)
    assert process.returncode == 1
    assert "interrupted: the best so far is kept" in out
    assert "Traceback" not in err
    assert json.loads((tmp_path / "run" / "result.json").read_text())["outcome"].startswith("interrupted")


@pytest.mark.broad
def test_a_fit_without_a_genetic_algorithm_does_not_import_one(folder, tmp_path):
    code = (
        "import sys\nfrom fracid.cli import main\n"
        f"try: main(['fit', {str(folder / 'rig.toml')!r}, '--out', {str(tmp_path / 'run')!r}, '--json'])\n"
        "except SystemExit as end: print(end.code, *({'pymoo', 'h5py', 'sympy'} & set(sys.modules)), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=120)
    assert done.stderr.splitlines()[-1] == "0"


@pytest.mark.broad
def test_the_demo_runs_its_three_parts_and_says_that_nothing_was_measured(capsys, tmp_path, monkeypatch):
    from fracid.cli import demo

    monkeypatch.setattr(demo, "STORY", demo.STORY[:1])  # the paper's recipe takes its 520 evaluations
    code, out, err = run(capsys, "demo", "--out", tmp_path, "--json")
    assert code == 0
    assert "simulated" in err
    assert "lambda: true value 0.8623" in err
    assert "OUTSIDE" not in err
    content = json.loads(out)
    assert list(content) == ["reference"]
    for name, true in demo.TRUE_ORDERS.items():
        low, high = content["reference"]["orders"][name]["interval95"]
        assert low <= true <= high
    assert (tmp_path / "reference" / "figures" / "cost-over-orders.svg").exists()
    assert '<a href="reference/report.html">' in (tmp_path / "index.html").read_text(encoding="utf-8")
    assert (tmp_path / "index.html").as_uri() in err


@pytest.mark.broad
@pytest.mark.parametrize("jobs", [1, 2])
def test_what_a_process_beside_draws_is_what_is_drawn_here(capsys, project, tmp_path, jobs):
    path = project(FAST + RECORDING + FIT)
    code, _, err = run(capsys, "fit", path, "--out", tmp_path / "run", "--jobs", jobs)
    assert code == 0, err
    drawn = {p.name for p in (tmp_path / "run" / "figures").iterdir()}
    stems = ("figure1-rig", "figure2-release-20", "figure3-release-20-theta", "figure3-release-20-alpha")
    assert drawn == {f"{stem}.{kind}" for stem in stems for kind in ("svg", "png")}


class DeadProcess:
    """A pool whose process dies at a task, or has died before it."""

    def __init__(self, before):
        self.before = before

    def submit(self, work, *_):
        if self.before and work is not int:
            raise BrokenExecutor
        ended = Future()
        ended.set_exception(BrokenExecutor())
        return ended

    def shutdown(self, **_):
        pass


@pytest.mark.broad
@pytest.mark.parametrize("before", [False, True])
def test_where_the_process_beside_dies_this_one_draws(capsys, project, tmp_path, monkeypatch, before):
    monkeypatch.setattr("fracid.tasks.local.fresh_processes", lambda *_: DeadProcess(before))
    code, _, err = run(capsys, "fit", project(FAST + RECORDING + FIT), "--out", tmp_path / "run", "--jobs", 2)
    assert code == 0, err
    assert (tmp_path / "run" / "figures" / "figure2-release-20.svg").exists()
