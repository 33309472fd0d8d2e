"""The page of a study says what its record says, with hostile names as text and nothing to fetch."""

import json
import math
import re
from importlib.resources import files
from pathlib import Path

import pytest

import fracid
from browser import CHROMIUM, Browser
from fracid.cli.app import main, new_console, print_values
from fracid.errors import InputError
from fracid.experiments.plan import Plan, Value
from fracid.report.study import LARGEST_FIGURE, STUDIES, write_study
from fracid.safety.schema import as_json, record_of
from fracid.schemas.feedback import Conditions, Controller, ControlRecord, Design, Trial
from fracid.selection.comparison_records import Comparison, OrderOfRow, Row, Score
from fracid.selection.integer_rival import Alternative, FiniteMemory
from fracid.validation.study_records import Cell, Statistics

HOSTILE = "<script>window.hit = 1</script>"


def comparison(name=HOSTILE):
    scores = {"in": Score({"alpha": 0.02}, {"alpha": 91.0}, {"alpha": 2.0})}
    held_out = {name: Score({"alpha": 0.04}, {"alpha": 81.0}, {"alpha": 2.0})}
    rows = tuple(
        Row("viscous", free, f"viscous, orders {'free' if free else 1}", free, 1.0, 3, 2.0, orders, {}, (), scores,
            held_out, "converged") for free, orders in ((False, {}), (True, {"mu": OrderOfRow(0.9, (0.8, 1.0))}))
    )  # fmt: skip
    memories = (FiniteMemory(1, 2.0, 50.0), FiniteMemory(2, 1.0, 3.0))
    nearest = Alternative("viscous", ("mu",), 2.0, {}, 5.0, 100.0, memories=memories)
    return Comparison(rows, "Orders help.", (f"a note on {name}",), ("alpha",), 50.0, False, "rmse", 1, 1, {},
                      "undecided", ("Three relaxations do as well.",), nearest)  # fmt: skip


def curves(name=HOSTILE):
    time = [0.1 * k for k in range(50)]
    wave = [math.cos(t) for t in time]
    return {
        "recordings": {name: {"time": time, "measured": {"alpha": wave}}},
        "structures": {f"viscous, orders {how}": {name: {"alpha": [f * v for v in wave]}}
                       for how, f in (("1", 0.5), ("free", 0.9))},
    }  # fmt: skip


def noise():
    mu = Statistics("", 0.9, 40, 0.001, 0.002, 0.002, 40, 38)
    cell = Cell(0.01, 0.0, 40, {}, 0, 100.0, None, {"mu": mu})
    return {"model": HOSTILE, "truth": {"mu": 0.9}, "cost": "rmse", "optimiser": "multistart", "seeds": 40, "seed": 1,
            "cells": [cell.to_json()], "sentences": ["mu: 38 of 40 intervals contain the true value."]}  # fmt: skip


def posterior():
    prior = {"kind": "uniform", "lower": 0.5, "upper": None}
    unknown = {"unit": "", "fitted": 0.9, "mean": 0.9, "median": 0.9123, "standard_deviation": 0.01,
               "interval95": [0.88, 0.94], "prior": prior}  # fmt: skip
    return {"method": "Laplace", "draws": 100, "effective_draws": 90.0, "simulations": 100, "khat": 0.1,
            "khat_limit": 0.7, "trusted": True, "log_evidence": -3.0, "evidence_error": 0.1, "effective_samples": 50.0,
            "degrees_of_freedom": 49.0, "seed": 1, "sentence": "The draws can be trusted.", "notes": [],
            "unknowns": {HOSTILE: unknown}}  # fmt: skip


def plan():
    values = {"mu": Value(0.9123, "", 0.001, 0.01), HOSTILE: Value(1.0, "N m", None, None),
              "C1": Value(2.8, "F", 2.5, None, widest=2.8)}  # fmt: skip
    return as_json(Plan, {"for": HOSTILE, "criterion": "D", "of": ["mu"], "experiments": [{"text": "release"}],
                               "expected": values, "gain": {"mu": 10.0}, "candidates": 3, "excluded": 0,
                               "distances": None, "alone": None})  # fmt: skip


def profiles():
    one = {"value": 0.9123, "unit": "", "interval95": [0.88, None], "wald95": None, "verdict": "one-sided",
           "sentence": "one-sided: above the bound", "ends": ["a", "b"], "values": [0.9123], "rise": [0.0],
           "cost": [1.0]}  # fmt: skip
    return {"cost": {"name": "rmse", "value": 1.0}, "minimum": {"mu": 0.9}, "threshold": 3.84, "notes": [HOSTILE],
            "profiles": {"mu": one}}  # fmt: skip


def control():
    one, zero = [[1.0]], [[0.0]]
    lqr = Controller("LQR", {"theta": 1.0}, 0.01, zero, zero, zero, one, zero)
    design = Design(lqr, 40, 40, None, 61.23, 0.5)
    trial = Trial(True, 10.0, {HOSTILE: 0.1}, 0.5, 0.2, 0.0, None, 60.0, 0.5)
    loop = Conditions("upright", {}, "voltage", "V", 0.0, -10.0, 10.0, 0.0, 0.01, 4, ("alpha",), {}, {}, {}, {}, {}, {})
    return as_json(ControlRecord, ControlRecord(HOSTILE, loop, design, (design,), (trial,), {HOSTILE: 0.9}, 0, 1,
                                                (0.91, 1.0), (HOSTILE,)))  # fmt: skip


RECORDS = {"control.json": control,
           "compare.json": lambda: comparison().to_json(), "noise.json": noise, "posterior.json": posterior,
           "plan.json": plan, "profiles.json": profiles}  # fmt: skip

SAYS = {
    "control.json": ("LQR holds upright in 40 of 40 draws", "61.2"),
    "compare.json": ("Undecided whether it is fractional.", "Three relaxations do as well.", "2 relaxations each"),
    "noise.json": ("μ: 38 of 40 intervals contain the true value.", "38 of 40"),
    "posterior.json": ("The draws can be trusted.", "0.912", "nats"),
    "plan.json": (
        "1 experiment for",
        "1 × release.",
        "Expected 95 % interval of μ ± 0.0020, 10 times",
        "10 times narrower than ±",
        "not shown by this plan",
        "practically non-identifiable",
    ),
    "profiles.json": ("Without a closed 95 % interval: μ.", "it lies above 0.88"),
}


def written(folder, file):
    (folder / file).write_text(json.dumps(RECORDS[file]()), encoding="utf-8")
    return write_study(folder, file)


def test_the_controllers_of_a_table_have_the_same_columns_whatever_their_weights_are():
    record = control()
    pid = record["design"] | {"controller": record["design"]["controller"] | {"weights": {"Kp": 2.0, "mu": 0.5}}}
    (rows,) = STUDIES["control.json"].found(record | {"tried": [record["design"], pid]}).tables.values()
    assert len({tuple(row) for row in rows}) == 1


@pytest.mark.parametrize(("names", "answer"), [
    (["q"], "The 95 % interval of q is closed."), (["lambda", "mu"], "The 95 % intervals of λ and μ are closed."),
])  # fmt: skip
def test_profiles_answer_for_the_values_that_were_profiled(names, answer):
    ends = [0.88, 0.94]
    one = profiles()["profiles"]["mu"] | {"interval95": ends, "wald95": ends, "verdict": "two-sided"}
    assert STUDIES["profiles.json"].found(profiles() | {"profiles": dict.fromkeys(names, one)}).answer == answer


def test_the_terminal_says_of_a_plan_what_its_page_says_of_each_value(capsys):
    (rows,) = STUDIES["plan.json"].found(plan()).values.values()
    print_values(new_console(), rows)
    lines = capsys.readouterr().out.splitlines()[1:]
    assert ["not shown" in line for line in lines] == [False, True, False]
    assert ["practically non-identifiable" in line for line in lines] == [False, False, True]


def test_every_study_that_has_a_page_is_tried_here():
    assert set(RECORDS) == set(STUDIES)


@pytest.mark.parametrize("file", RECORDS)
def test_a_page_says_what_the_record_says_and_a_hostile_name_is_text(tmp_path, file):
    page = written(tmp_path, file)
    text = page.read_text(encoding="utf-8")
    assert page.name == file.replace(".json", ".html")
    assert HOSTILE not in text
    shown = re.sub(r"<[^>]*>", "", text).replace("\N{NO-BREAK SPACE}", " ")
    assert [said for said in SAYS[file] if said not in shown] == []
    assert "default-src &#39;none&#39;" in text
    assert not re.findall(r"""(?:src|href)=["'](?!#|data:image/)""", text)


def test_the_command_of_a_profile_in_the_folder_of_its_fit_has_what_was_profiled(tmp_path, monkeypatch):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "result.json").write_text("{}", encoding="utf-8")
    (tmp_path / "run" / "environment.json").write_text('{"command": ["fit", "rig.toml"]}', encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    page = written(Path("run"), "profiles.json").read_text(encoding="utf-8")
    assert ">fracid profile run --parameter mu</pre>" in page


def test_figures_are_images_that_the_page_holds_and_a_large_drawing_gives_way_to_its_pixels(tmp_path):
    (tmp_path / "figures").mkdir()
    (tmp_path / "figures" / "noise.svg").write_text("<svg/>")
    assert 'src="data:image/svg+xml;base64,' in written(tmp_path, "noise.json").read_text(encoding="utf-8")
    (tmp_path / "figures" / "noise.svg").write_bytes(b" " * (LARGEST_FIGURE + 1))
    (tmp_path / "figures" / "noise.png").write_bytes(b"pixels")
    assert 'src="data:image/png;base64,' in written(tmp_path, "noise.json").read_text(encoding="utf-8")


def test_damaged_records_and_missing_ones_are_refused_in_a_sentence(tmp_path):
    with pytest.raises(InputError, match=r"holds no plan\.json\. Write it: fracid design"):
        write_study(tmp_path, "plan.json")
    (tmp_path / "plan.json").write_text('{"for": 3}')
    with pytest.raises(InputError, match="is damaged"):
        write_study(tmp_path, "plan.json")


def test_the_report_of_a_folder_of_a_study_is_its_page(tmp_path, capsys):
    written(tmp_path, "noise.json").unlink()
    with pytest.raises(SystemExit) as stop:
        main(["report", str(tmp_path)])
    assert not stop.value.code
    assert str(tmp_path / "noise.html") in capsys.readouterr().out.replace("\n", "")
    assert (tmp_path / "noise.html").exists()


def ticks(page):
    """Name of a row of a page → where the tick of its interval stands [px]."""
    rows = re.findall(
        r'<span class="point[^>]*></span>([^<]*)</span>.*?class="zero" d="M([\d.]+)', page.read_text(), re.DOTALL
    )
    return {name: float(x) for name, x in rows}


def test_the_tick_of_an_order_is_at_its_integer_which_is_the_runs_own_where_there_is_one(tmp_path, monkeypatch):
    assert ticks(written(tmp_path, "profiles.json"))["μ"] > 90  # 1, right of 0.9123
    (tmp_path / "result.json").touch()
    monkeypatch.setattr(fracid.report.study, "read_if_whole", lambda *_: {"orders": {"mu": {"integer": 0.0}}})
    assert ticks(written(tmp_path, "profiles.json"))["μ"] < 90


def test_on_paper_are_no_controls_and_no_column_is_cut(browser, tmp_path):
    (tmp_path / "curves.json").write_text(json.dumps(curves()), encoding="utf-8")
    browser.open(written(tmp_path, "compare.json"), width=720)
    browser.media("print")
    assert (
        browser.run("[...document.querySelectorAll('input, select, canvas')].filter(e => e.offsetParent).length") == 0
    )
    assert browser.run("[...document.querySelectorAll('td, th')].every(e => e.getBoundingClientRect().right <= 720)")


def test_a_comparison_without_curves_or_with_those_of_other_samples_has_its_table_alone(tmp_path):
    assert 'name="structure"' not in written(tmp_path, "compare.json").read_text(encoding="utf-8")
    content = curves()
    content["recordings"][HOSTILE]["time"].append(9.0)
    (tmp_path / "curves.json").write_text(json.dumps(content), encoding="utf-8")
    assert 'name="structure"' not in written(tmp_path, "compare.json").read_text(encoding="utf-8")


def test_a_comparison_keeps_its_curves_out_of_its_record():
    row = comparison().rows[0]
    kept = fracid.selection.comparison_records.Comparison.of_json(comparison().to_json())
    assert "curves" not in as_json(Row, row)
    assert record_of(Row, as_json(Row, row)) == kept.rows[0]


@pytest.fixture
def browser():
    if CHROMIUM is None:
        pytest.skip("there is no Chromium here")
    with Browser() as found:
        yield found


def test_a_structure_is_chosen_in_its_row_and_its_curves_are_drawn_and_a_checker_finds_nothing(browser, tmp_path):
    (tmp_path / "curves.json").write_text(json.dumps(curves()), encoding="utf-8")
    page = written(tmp_path, "compare.json")
    for scheme in ("light", "dark"):
        browser.open(page, prefers_color_scheme=scheme)
        assert browser.complaints == []
        assert browser.requests == [page.as_uri()]
        drawn = "Chart.all.map(c => c.spec.series.map(s => s.label))"
        assert browser.run(drawn) == [["measured", "viscous, orders 1", "viscous, orders free"]]
        browser.run("document.querySelectorAll('#structures tbody tr')[1].click()")
        assert browser.run(drawn) == [["measured", "viscous, orders free", "viscous, orders 1"]]
        assert browser.run("document.getElementById('recording').selectedOptions[0].text") == f"{HOSTILE} (held out)"
        browser.run(files("axe_core_python").joinpath("axe.min.js").read_text(encoding="utf-8") + "; 0")
        assert browser.run("axe.run().then(r => r.violations.map(v => [v.id, v.nodes.map(n => n.html)]))") == []
        assert browser.run("window.hit") is None


def test_a_study_in_a_run_names_the_run_as_it_is_reached_from_here(tmp_path, monkeypatch):
    (tmp_path / "runs" / "rig" / "design").mkdir(parents=True)
    (tmp_path / "runs" / "rig" / "result.json").write_text("{}", encoding="utf-8")
    written(tmp_path / "runs" / "rig" / "design", "plan.json")
    monkeypatch.chdir(tmp_path)
    page = write_study("runs/rig/design", "plan.json")
    assert "fracid design runs/rig<" in page.read_text(encoding="utf-8")
