"""A recording dropped into a page is read as fracid reads it, fitted as fracid fits it, and handed on as a project."""

import json
import re
import subprocess
import tomllib

import numpy as np
import pytest

import fracid
from browser import CHROMIUM, Browser
from fracid.cli.app import main
from fracid.problem.model_draft import draft_of_model
from fracid.recording.channel import TABLES
from fracid.recording.readers.table import read_table
from fracid.report.open import _spec, open_page_text, write_open_page
from fracid.safety.door import own_text
from fracid.safety.json_files import plain
from languages import NODE
from program import run

WAITING = "element('project').hidden && !/No simulation|holds no|is no text/.test(element('fit-said').textContent)"

in_chromium = pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium here")
in_node = pytest.mark.skipif(NODE is None, reason="there is no Node here")


@pytest.fixture(scope="module")
def browser():
    with Browser() as one:
        yield one


@pytest.fixture(scope="module")
def blank(tmp_path_factory):
    return write_open_page(None, tmp_path_factory.mktemp("open") / "blank.html")


def release(file, mu=0.95, held=0.7):
    """7 s at 250 Hz, held for a while; degrees, with 0.05° of noise."""
    rig = fracid.rotary_pendulum("srv02-rotpen", b_alpha=5e-4, coulomb_theta=4e-3)
    run = fracid.simulate(rig, orders={"lambda": 1.0, "mu": mu}, initial={"alpha": 1.0}, step=1e-3, end=7.0)
    angles = np.degrees(run.states[::4, [0, 2]])
    angles = np.vstack([np.repeat(angles[:1], round(held / 4e-3), axis=0), angles])
    angles = angles + 0.05 * np.random.default_rng(5).standard_normal(angles.shape)
    table = np.column_stack([4e-3 * np.arange(len(angles)), angles])
    np.savetxt(file, table, "%.6f", ",", header="time [s],theta [deg],alpha [deg]", comments="")


def fitted(browser):
    """The text of the project, once the page has it."""
    browser.until(f"!({WAITING})", 90)
    return browser.run("element('toml').textContent")


def put(browser, name, text):
    """Drop a file."""
    browser.run(f"""{{
        const held = new DataTransfer();
        held.items.add(new File([{json.dumps(text)}], {json.dumps(name)}));
        dispatchEvent(new DragEvent("drop", {{ dataTransfer: held, cancelable: true, bubbles: true }}));
    }}""")
    browser.until(f"element('file-said').textContent.startsWith({json.dumps(name)})")


# --- the page


@pytest.mark.broad
@in_chromium
def test_a_dropped_release_is_fitted_in_the_page_and_its_project_goes_on_in_fracid(
    browser, blank, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    release(tmp_path / "release.csv")
    browser.open(blank)
    put(browser, "release.csv", (tmp_path / "release.csv").read_text())
    text = fitted(browser)
    assert browser.run("document.querySelector('.claim').textContent").startswith("Preview: no interval, no claim.")
    assert browser.complaints == []
    assert [url for url in browser.requests if not url.startswith("file:")] == []
    (tmp_path / "release.toml").write_text(text, encoding="utf-8")
    project = fracid.load_project(tmp_path / "release.toml")
    mu, swing = project.problem.orders["mu"], project.problem.experiments[0]
    assert mu.start == pytest.approx(0.95, abs=0.01)
    assert (swing.name, swing.samples) == ("release", pytest.approx(1751, abs=2))  # from the release on
    errors = [np.degrees(np.sqrt(np.mean(e**2))) for e in project.problem.errors(project.problem.start)[0].T]
    assert max(errors) < 0.5  # where the release and the rests still are as drafted


@pytest.mark.broad
@in_chromium
def test_what_is_corrected_in_the_row_of_a_column_is_fitted_anew_and_stands_in_the_link(browser, blank, tmp_path):
    release(tmp_path / "release.csv")
    text = re.sub(r"theta \[deg\],alpha \[deg\]", "sensor1,sensor2", (tmp_path / "release.csv").read_text())
    browser.open(blank)
    put(browser, "nameless.csv", text)
    assert 'alpha = { column = "sensor2"' in fitted(browser)
    browser.run("""{
        const row = [...document.querySelectorAll("#columns tbody tr")].find(tr => tr.textContent.startsWith("alpha"));
        const unit = row.querySelectorAll("select")[1];
        unit.value = "rad";
        unit.dispatchEvent(new Event("change"));
    }""")
    assert browser.run("element('found').hidden && element('project').hidden")  # what was found was of other units
    browser.run("element('fit').click()")
    browser.until("element('stop').hidden", 90)
    link = json.loads(browser.run("JSON.stringify(Object.fromEntries(page.link()))"))
    assert json.loads(link["signals"])["alpha"]["unit"] == "rad"


@pytest.mark.broad
@in_chromium
@pytest.mark.parametrize("name", ["oscillator", "pendulum", "relaxation", "tanks", "capacitor"])
def test_a_twin_of_a_library_model_is_taken_for_that_model_and_followed(name, browser, blank, tmp_path):
    table, noise = tmp_path / f"{name}.csv", "0.05deg" if name == "pendulum" else "0.001"
    with pytest.raises(SystemExit) as ended:
        main(["simulate", name, "--end", "8", "--step", "20ms", "--noise", noise, "--to", str(table)])
    assert ended.value.code == 0
    browser.open(blank)
    put(browser, table.name, table.read_text())
    fitted(browser)
    assert browser.run("element('model').value") == name
    assert "does not follow" not in browser.run("element('found-said').textContent")


@pytest.mark.broad
@in_chromium
def test_the_example_is_found_and_a_file_that_is_none_is_refused_in_a_sentence(browser, blank):
    browser.open(blank)
    browser.run("element('example').click()")
    text = fitted(browser)
    found = {n: float(v) for n, v in re.findall(r"^(lambda|mu) = \{ start = ([\d.]+)", text, re.M)}
    assert found == {"lambda": pytest.approx(0.95, abs=2e-3), "mu": pytest.approx(0.97, abs=2e-3)}
    put(browser, "poem.txt", "the woods are lovely\\ndark and deep")
    said = browser.run("element('file-said').textContent")
    assert said.startswith("poem.txt holds no row of numbers")
    assert browser.run("element('guess').hidden && element('explore').hidden")


def test_the_page_holds_a_table_of_any_format_and_lets_nothing_out(tmp_path):
    values = np.column_stack([np.arange(60) * 0.01, np.cos(np.arange(60) / 9)])
    np.save(tmp_path / "swing.npy", values)
    page = write_open_page(tmp_path / "swing.npy", tmp_path / "page.html").read_text(encoding="utf-8")
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page)[1]
    assert "default-src &#39;none&#39;" in policy
    assert "connect-src" not in policy  # what is not named is as default-src says
    assert '"rows": 60' in page or '"rows":60' in page
    assert "http" not in re.sub(r"http://www\.w3\.org/\S*", "", own_text("report/open.js"))


def test_a_name_of_a_file_or_a_column_stays_text(tmp_path):
    hostile = tmp_path / "a<script>x.csv"
    hostile.write_text("time,</script><script>hit()\n" + "".join(f"{k},{k}\n" for k in range(30)), encoding="utf-8")
    page = write_open_page(hostile, tmp_path / "page.html").read_text(encoding="utf-8")
    assert page.count("<script") == open_page_text().count("<script")


# --- the reader, beside fracid's own

DIALECTS = {
    "commas": "time,alpha\n0.0,1.5\n0.1,1.25\n0.2,-1e-3\n",
    "semicolons with decimal commas": "t;alpha [deg]\n0,0;1,5\n0,1;1,25\n0,2;-0,001\n",
    "tabs": "# rig 4\ntime\talpha\n0\t1\n1\t2\n2\t3\n",
    "bars": "time|alpha [deg]\n0,0|1,5\n0,1|1,25\n0,2|-0,001\n",
    "blanks": "  0.0   1.0\n  0.5   2.0\n  1.0   3.0\n",
    "units in a line of their own": "time,alpha\n[s],[deg]\n0,1\n1,2\n2,3\n",
    "quotes": '"time, s","alpha"\n"0,0","1,5"\n"0,1","2,5"\n"0,2","3,5"\n',
    "gaps": "time,alpha\n0,1\n1,\n2,nan\n3,4\n",
    "a byte order mark": "\ufefftime,alpha\n0,1\n1,2\n2,3\n",
}


def read_in_node(texts):
    """What the page's reader makes of texts."""
    script = (
        own_text("report/reading.js")
        + f"""
        const said = {json.dumps(texts)}.map(text => Reading.parse(Reading.decode(new TextEncoder().encode(text))));
        const plain = one => (one.error ? one : {{ ...one, columns: one.columns.map(c => [...c]) }});
        console.log(JSON.stringify(said.map(plain)));
    """
    )
    done = subprocess.run([NODE, "-"], input=script, capture_output=True, text=True, check=True, timeout=100)
    return json.loads(done.stdout)


@in_node
def test_the_page_reads_a_text_as_fracid_does(tmp_path):
    for (dialect, text), ours in zip(DIALECTS.items(), read_in_node(list(DIALECTS.values())), strict=True):
        (tmp_path / "table.csv").write_text(text, encoding="utf-8")
        theirs = read_table(tmp_path / "table.csv")
        assert "error" not in ours, (dialect, ours)
        columns = np.array(ours["columns"], dtype=float).T
        assert np.array_equal(columns, theirs.values, equal_nan=True), dialect
        assert ours["units"] == list(theirs.units) or dialect == "quotes", dialect


@in_node
def test_no_text_makes_the_reader_throw_or_wait(tmp_path):
    script = (
        own_text("report/reading.js")
        + """
        let seed = 7;
        const next = n => (seed = seed * 48271 % 2147483647) % n;
        const parts = ["0", "1.5", "1,5", "-", ",", ";", "\\t", " ", "\\n", "\\r\\n", '"', "#", "%", "nan", "time",
                       "[deg]", "e9", "1e999", "\\ufeff", "\\u202e", "<script>", "__proto__", "\\0",
                       "2026-01-01 00:00:00", "\\ud800"];
        const began = Date.now();
        for (let k = 0; k < 20000; k++) {
          const text = Array.from({ length: 1 + next(60) }, () => parts[next(parts.length)]).join("");
          const table = Reading.parse(Reading.decode(new TextEncoder().encode(text)));
          const sound = typeof table.error === "string" || table.columns.every(c => c.length === table.rows);
          if (!sound) throw Error(text);
        }
        console.log(Date.now() - began);
    """
    )
    done = subprocess.run([NODE, "-"], input=script, capture_output=True, text=True, check=True, timeout=100)
    assert int(done.stdout) < 60_000


PULSES, SINE = np.sign(np.sin(0.9 * np.arange(400) * 0.02)), np.sin(0.9 * np.arange(400) * 0.02)
INPUTS = {"pulses of a force": ("oscillator", {"displacement": SINE, "force [N]": PULSES}),
          "a force that goes smoothly": ("oscillator", {"displacement": PULSES, "force [N]": SINE}),
          "a pump's volts": ("tanks", {"upper": SINE, "lower": SINE, "pump [V]": SINE}),
          "a force that stays": ("oscillator", {"displacement": SINE, "force [N]": 0 * SINE}),
          "a length whose rate the model takes": ("relaxation", {"force": SINE, "stretch [m]": PULSES})}  # fmt: skip


def page_and_draft(name, file):
    """The project of a recording as the page begins it, and as a draft does."""
    units = {"signal": TABLES["signal"], "time": TABLES["time"]}
    script = "".join(own_text(f"report/{part}.js") for part in ("fitting", "reading", "drafting")) + f"""
        const spec = {json.dumps(plain(_spec(name, fracid.model(name))))}, units = {json.dumps(units)};
        const read = Reading.parse(Reading.decode(new TextEncoder().encode({json.dumps(file.read_text())})));
        const table = {{ ...read, name: "log.csv" }};
        const setup = Drafting.guess(table, {{ {name!r}: spec }}, units, {name!r});
    """ + """
        const of = s => ({ ...s, factor: Drafting.factorOf(s, units) });
        const signals = Object.fromEntries(Object.entries(setup.signals).map(([n, s]) => [n, of(s)]));
        const recording = Preview.recordingOf(table, spec, { ...setup, signals, time: { ...setup.time, factor: 1 } });
        const sought = p => p.free === "always" || (p.free === "driven" && recording.driven);
        const parameters = Object.fromEntries(spec.parameters.map(p => [p.name, p.value]));
        const begun = { parameters, free: new Set(spec.parameters.filter(sought).map(p => p.name)), fixedOrders: {} };
        const unknowns = Preview.unknownsOf(spec, recording, begun);
        const values = Preview.valuesOf(spec, unknowns, unknowns.map(u => u.start), begun);
        console.log(Drafting.project(table, spec, setup, { ...begun, values, rmse: "", units, unknowns }));
    """  # fmt: skip
    done = subprocess.run([NODE, "-"], input=script, capture_output=True, text=True, check=True, timeout=100)
    return [tomllib.loads(text) for text in (done.stdout, draft_of_model(name, file).text)]


@in_node
@pytest.mark.parametrize("case", INPUTS)
def test_the_page_says_what_inputs_do_between_their_samples_as_a_draft_does(tmp_path, case):
    name, signals = INPUTS[case]
    file = tmp_path / "log.csv"
    np.savetxt(file, np.column_stack([0.02 * np.arange(400), *signals.values()]), "%.6g", ",", comments="",
               header=",".join(["time [s]", *signals]))  # fmt: skip
    rows = [project["recording"][0] for project in page_and_draft(name, file)]
    inputs = fracid.model(name).inputs
    said = [{n: row[n]["between"] for n in inputs if "between" in row.get(n, {})} for row in rows]
    assert said[0] == said[1]


def free_of(project):
    return {n for n, v in project["model"]["parameters"].items() if isinstance(v, dict)}


@in_node
def test_the_page_frees_and_begins_a_cell_and_takes_crowded_samples_as_a_draft_does(tmp_path):
    t = np.arange(0.0, 600.0)
    current = np.where((t > 60) & (t < 300), 2.0, 0.0)
    volts = 3.2 + np.cumsum(current) / 1500 + 0.05 * current
    np.savetxt(tmp_path / "cell.csv", np.column_stack([t, current, volts]), "%.6g", ",", comments="",
               header="time [s],current [A],voltage [V]")  # fmt: skip
    page, draft = page_and_draft("capacitor", tmp_path / "cell.csv")
    assert "R_1" not in free_of(page) >= free_of(draft)
    assert page["recording"][0]["initial"] == {
        "v": {"start": 3.2, "lower": pytest.approx(-0.97, abs=1), "upper": pytest.approx(7.4, abs=1)}
    }
    assert page["recording"][0]["initial"].keys() == draft["recording"][0]["initial"].keys()
    t = np.concatenate([np.arange(0, 4, 0.05), np.geomspace(4, 2000, 100)])
    np.savetxt(tmp_path / "strip.csv", np.column_stack([t, np.minimum(t, 2), np.minimum(t, 2) / (1 + t)]), "%.6g", ",",
               comments="", header="t [s],stretch [mm],force [N]")  # fmt: skip
    page, draft = page_and_draft("relaxation", tmp_path / "strip.csv")
    assert free_of(page) == {"k", "c"}
    assert page["recording"][0]["resample"] == draft["recording"][0]["resample"] == "uneven"


def test_what_to_type_next_is_what_a_check_of_the_file_says(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    rows = "".join(f"{k},{k % 2},{20 + k / 9}\n" for k in range(60))
    (tmp_path / "heat.csv").write_text("time,heater,plate\n" + rows)
    said = [run(capsys, *command)[1].partition("next ")[2] for command in (("open", "heat.csv"), ("check", "heat.csv"))]
    assert said[0].startswith("    fracid init heat.csv --model NAME --column NAME=COLUMN")
    assert said[0].strip() in said[1]


@in_node
def test_a_table_of_no_model_is_not_guessed_to_be_a_pendulums():
    specs, units = (
        {"rotary-pendulum": _spec("rotary-pendulum", fracid.model("rotary-pendulum"))},
        {"time": TABLES["time"]},
    )
    script = "".join(own_text(f"report/{part}.js") for part in ("fitting", "reading", "drafting")) + f"""
        const specs = {json.dumps(plain(specs))}, table = Reading.parse("time,heater,plate\\n0,0,20\\n1,1,21\\n2,1,22");
        console.log(Drafting.guess(table, specs, {json.dumps(units)}));
    """  # fmt: skip
    done = subprocess.run([NODE, "-"], input=script, capture_output=True, text=True, check=True, timeout=100)
    assert done.stdout.strip() == "null"


@pytest.mark.broad
@in_node
def test_whatever_files_and_columns_are_called_the_project_is_toml_of_one_recording():
    specs = {name: _spec(name, fracid.model(name)) for name in ("rotary-pendulum", "oscillator")}
    units = {"signal": TABLES["signal"], "time": TABLES["time"]}
    script = "".join(own_text(f"report/{name}.js") for name in ("fitting", "reading", "drafting")) + f"""
        const SPECS = {json.dumps(plain(specs))}, UNITS = {json.dumps(units)};
    """ + r"""
        let seed = 7;
        const next = n => (seed = seed * 48271 % 2147483647) % n;
        const parts = ["a", "alpha", "theta", "time", " ", '"', "'", "\\", "\n", "\r", "\u2028", "\u202e", "]", "#",
                       "=", "[[recording]]", "\u007f", "\0", "\ud800", "\udc00", "<script>", "__proto__", "{", "}",
                       ".", "é"];
        const word = () => Array.from({ length: 1 + next(12) }, () => parts[next(parts.length)]).join("");
        const column = c => Float64Array.from({ length: 30 }, (_, n) => (c ? Math.cos(n / 3 + c) : 0.01 * n));
        const texts = Array.from({ length: 1000 }, (_, k) => {
          const names = ["time", word(), word()], units = ["s", "deg", word()], columns = [0, 1, 2].map(column);
          const table = { name: word(), rows: 30, names, units, columns, said: "" };
          const setup = Drafting.guess(table, SPECS, UNITS, ["rotary-pendulum", "oscillator"][k % 2]);
          const spec = SPECS[setup.model];
          const orders = Object.fromEntries(spec.orders.map(q => [q.name, q.start]));
          const parameters = Object.fromEntries(spec.parameters.map(p => [p.name, p.value]));
          const values = { orders, parameters };
          const free = new Set(spec.parameters.filter(p => p.free === "always").map(p => p.name));
          return Drafting.project(table, spec, setup, { values, free, fixedOrders: {}, rmse: word(), units: UNITS });
        });
        console.log(JSON.stringify(texts));
    """  # fmt: skip
    done = subprocess.run([NODE, "-"], input=script, capture_output=True, text=True, check=True, timeout=100)
    for text in json.loads(done.stdout):
        project = tomllib.loads(text)
        assert set(project) == {"model", "recording", "fit"}
        assert len(project["recording"]) == 1
