"""The report is one page that says what result.json says, escapes what came from files, asks nobody, and moves."""

import base64
import hashlib
import html
import json
import math
import re
import shutil
import tomllib
from dataclasses import replace
from html.parser import HTMLParser
from importlib.resources import files
from itertools import pairwise
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest

import fracid
from browser import CHROMIUM, Browser
from fracid.arrays import extremes
from fracid.cli.app import main
from fracid.cli.fit import _discretisation
from fracid.errors import InputError
from fracid.estimation.cost_plane import cost_plane
from fracid.estimation.records import in_words
from fracid.optimise import Outcome
from fracid.report import plane_of, report_page, write_report
from fracid.report.charts import Chart, Series, still
from fracid.report.equations import equations
from fracid.report.material import Material
from fracid.report.page import _wide
from fracid.report.traces import ALL_POINTS, FEWEST, POINTS, budget
from fracid.report.verdict import verdict
from fracid.report.whiskers import orders_drawn
from fracid.runs.folder import open_folder, write_result
from fracid.runs.saved import load_run
from fracid.selection.comparison_records import Comparison, OrderOfRow, Row, Score
from fracid.validation.discretisation import Discretisation
from fracid.validation.residual_analyses import first_part
from fracid.validation.residual_records import Level
from twins import RIG, write_release

HOSTILE = "</script><img src=x onerror=\"window.hit=1\"> & 'swing'"

PROJECT = f"""
[model.parameters]
b_alpha = {{ start = 3e-4, lower = 0.0, upper = 1e-2 }}
coulomb_theta = 0.001
[[recording]]
name = {json.dumps(HOSTILE)}
file = "one.csv"
theta = {{ column = "theta", unit = "rad" }}
alpha = {{ column = "alpha", unit = "rad" }}
from = 0.5
[[recording]]
name = "held out"
file = "two.csv"
theta = {{ column = "theta", unit = "rad" }}
alpha = {{ column = "alpha", unit = "rad" }}
use = "validate"
"""

SECTIONS = ("verdict", "explore", "findings", "values", "fitted", "residuals", "cost", "ladder", "model", "data",
            "checks", "reproduce")  # fmt: skip
"""In the order of the page."""


END = 4.0
"""Of both recordings [s]."""


def write_twin(file, alpha, seed):
    write_release(file, RIG.with_parameters(coulomb_theta=1e-3), alpha=alpha, step=1e-2, end=END, noise=2e-3, seed=seed)


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """A run with all that a report can show: its folder, the fit, the project."""
    folder = tmp_path_factory.mktemp("report")
    write_twin(folder / "one.csv", 0.5, 1)
    write_twin(folder / "two.csv", 0.3, 2)
    (folder / "rig.toml").write_text(PROJECT, encoding="utf-8")
    project = fracid.load_project(folder / "rig.toml")
    open_folder(folder / "run", ["fit", str(folder / "rig.toml"), "--out", "<run>"])
    fit = fracid.identify(project, jobs=2)
    write_result(folder / "run", fit, project, {"search": 1.0})
    profiles = fracid.profile(fit, parameters=["mu"], points=5, jobs=2)
    (folder / "run" / "profiles.json").write_text(json.dumps(profiles.to_json()), encoding="utf-8")
    (folder / "run" / "compare.json").write_text(json.dumps(comparison().to_json()), encoding="utf-8")
    return folder / "run", fit, project


def comparison():
    """Two rungs, one of which fails on a recording."""
    good = Score({"theta": 0.01, "alpha": 0.02}, {"theta": 90.0, "alpha": 91.0}, {"theta": 1.0, "alpha": 2.0})
    bad = Score(dict.fromkeys(good.rmse, math.inf), dict.fromkeys(good.rmse, -math.inf), good.itae, "it left")
    rungs = [
        ("viscous, orders 1", False, bad, {}),
        ("viscous, orders free", True, good, {"mu": OrderOfRow(0.9, (0.8, 1.0))}),
    ]
    rows = tuple(
        Row("viscous", free, name, free, 1.0, 3, 2.0, orders, {}, (), {HOSTILE: good}, {"held out": score}, "converged")
        for name, free, score, orders in rungs
    )
    return Comparison(rows, "Orders <b>help</b>.", ("a note",), ("theta", "alpha"), 50.0, False, "rmse", 1, 1)


@pytest.fixture(scope="module")
def material(fitted):
    folder, fit, _ = fitted
    run = load_run(folder)
    return Material.of(folder, run, run.project, cost_plane(fit.problem, fit.x, points=5))


@pytest.fixture(scope="module")
def page(material):
    return report_page(material)


class Parsed(HTMLParser):
    """Elements in a row, the text that is seen, and whether every element is closed."""

    VOID = frozenset({"meta", "input", "link", "img", "br", "hr"})

    def __init__(self, text):
        super().__init__(convert_charrefs=True)
        self.elements, self.open, self.text, self.scripts = [], [], [], []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open, f"</{tag}> closes nothing"
        assert self.open.pop() == tag

    def handle_data(self, data):
        (self.scripts if self.open and self.open[-1] in ("script", "style") else self.text).append(data)

    def all(self, tag):
        return [attributes for name, attributes in self.elements if name == tag]


@pytest.fixture(scope="module")
def parsed(page):
    return Parsed(page)


def samples(page):
    return json.loads(re.search(r'<script type="application/json" id="samples">(.*?)</script>', page, re.DOTALL)[1])


def decoded(text):
    return np.frombuffer(base64.b64decode(text), dtype="<f4")


# --- the page as text ------------------------------------------------------------------------------


def test_no_sentence_of_the_page_has_a_power_of_ten_as_a_terminal_writes_it(page):
    """What is typed has it: commands, the project file and ``name = 1e-3``."""
    read = re.sub(r"<(script|style|pre|code)\b.*?</\1>", "", page, flags=re.DOTALL)
    words = html.unescape(re.sub(r"<[^>]+>", " ", read))
    assert "×10⁻" in words
    assert re.findall(r"(?<![\w.])(?<!= )\d+(?:\.\d+)?e[-+]?\d+(?!\w)", words) == []


def test_every_element_is_closed_and_every_id_is_there_once(parsed):
    assert parsed.open == []
    ids = [a["id"] for _, a in parsed.elements if "id" in a]
    assert len(ids) == len(set(ids))


def test_no_two_regions_have_one_name(page, parsed):
    regions = [a["aria-label"] for _, a in parsed.elements if a.get("role") == "region"]
    regions += re.findall(r'<h2 id="h-\w+">(.*?)</h2>', page)  # sections are regions too
    assert len(regions) > len(SECTIONS)
    assert len(regions) == len(set(regions))


def test_the_sections_are_all_there_in_their_order_and_linked(parsed):
    assert [a["id"] for a in parsed.all("section")] == list(SECTIONS)
    assert [a["href"] for a in parsed.all("a")][: len(SECTIONS)] == [f"#{name}" for name in SECTIONS]


def test_nothing_on_the_page_can_be_fetched(parsed):
    for tag, attributes in parsed.elements:
        for name in ("src", "srcset", "action", "poster", "data", "xlink:href", "style"):
            assert name not in attributes, f"<{tag} {name}>"
        assert attributes.get("href", "#").startswith("#")
    assert not re.search(r"url\(|@import", "".join(parsed.scripts))
    assert policy_of(parsed).startswith("default-src 'none';")


def policy_of(parsed):
    return next(a["content"] for a in parsed.all("meta") if a.get("http-equiv") == "Content-Security-Policy")


def test_the_policy_allows_the_pages_own_scripts_and_styles_by_their_hashes_and_no_others(page, parsed):
    policy = policy_of(parsed)
    assert "unsafe" not in policy
    allowed = set(re.findall(r"'sha256-(.+?)'", policy))
    there = re.findall(r"<(?:script|style[^>]*)>(.*?)</(?:script|style)>", page, re.DOTALL)
    assert allowed == {base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in there}


def test_the_figure_of_the_profiles_is_an_image_that_the_page_holds(material, tmp_path):
    shutil.copytree(material.folder, tmp_path / "run")
    (tmp_path / "run" / "figures").mkdir(exist_ok=True)
    (tmp_path / "run" / "figures" / "profiles.svg").write_text("<svg/>", encoding="utf-8")
    (image,) = (there := Parsed(report_page(replace(material, folder=tmp_path / "run")))).all("img")
    assert image["src"] == f"data:image/svg+xml;base64,{base64.b64encode(b'<svg/>').decode()}"
    assert "; img-src data:;" in policy_of(there)


def test_a_hostile_name_is_text_wherever_it_stands(page, parsed):
    assert "<img" not in page
    assert parsed.all("img") == []
    assert len(parsed.all("script")) == 13
    assert "".join(parsed.text).count(HOSTILE) >= 6
    assert [r["name"] for r in samples(page)["recordings"]] == [HOSTILE, "held out"]


def test_the_ladders_words_are_text_too(parsed):
    assert "Orders <b>help</b>." in "".join(parsed.text)
    assert parsed.all("b") == []


def test_every_value_of_the_result_stands_on_the_page_in_full(page, fitted):
    result = json.loads((fitted[0] / "result.json").read_text(encoding="utf-8"))
    values = set(re.findall(r'<data value="([^"]*)"', page))
    blocks = [result["orders"], result["parameters"]]
    for r in result["recordings"].values():
        blocks += [r["initial_state"], r["parameters"]]
        assert {str(v) for kind in ("rmse", "fit_percent") for v in r[kind].values()} <= values
    estimates = [e for k, block in enumerate(blocks) for e in block.values() if k < 2 or e["free"]]
    assert {str(e["value"]) for e in estimates} <= values
    assert {f"{e['interval95'][0]} {e['interval95'][1]}" for e in estimates if e["interval95"]} <= values


def test_warnings_verdicts_reasons_and_hashes_are_said(parsed, fitted):
    result = json.loads((fitted[0] / "result.json").read_text(encoding="utf-8"))
    text = " ".join("".join(parsed.text).split())
    reasons = [e["reason"] for block in ("orders", "parameters") for e in result[block].values() if e.get("reason")]
    said = [next((r for r in reasons if r in w), w) for w in result["warnings"]]  # a row's reason stands in that row
    said = [*said, *reasons, *(in_words(e["identifiable"]) for e in result["parameters"].values())]
    said += [*result["data_sha256"].values(), *result["versions"].values(), "fracid fit", "'<run>'", "coulomb_theta"]
    said += [s for outputs in Material.of(*fitted).residuals.values() for a in outputs.values()
             for s in a.sentences.values()]  # fmt: skip
    for sentence in said:
        assert " ".join(sentence.split()) in text


def test_the_embedded_samples_are_the_recordings(page, fitted):
    for said, r in zip(samples(page)["recordings"], fitted[1].recordings.values(), strict=True):
        np.testing.assert_allclose(decoded(said["t"]), r.time - r.time[0], atol=1e-6)
        assert said["start"] == r.time[0]
        for output in said["outputs"]:
            for which in ("measured", "fitted"):
                angle = np.degrees(getattr(r, which)[output["name"]])
                np.testing.assert_allclose(decoded(output[which]), angle, rtol=1e-6, atol=1e-6)


def test_a_recording_is_shown_whole_with_the_part_that_was_used(page):
    whole = samples(page)["charts"]["whole-0-0"]
    assert decoded(whole["x"])[[0, -1]] == pytest.approx([0.0, END])
    assert [whole["bands"][0][end] for end in ("low", "high")] == pytest.approx([0.5, END])


def test_a_fit_in_hand_and_its_folder_read_back_give_the_same_page(fitted, material):
    folder, fit, project = fitted
    assert report_page(Material.of(folder, fit, project, material.plane)) == report_page(material)


def test_a_page_says_what_it_lacks_without_profiles_ladder_and_search(material, tmp_path):
    result = json.loads(json.dumps(material.result))
    for r in result["recordings"].values():
        r["rmse"] = dict.fromkeys(r["rmse"])
        r["fit_percent"] = dict.fromkeys(r["fit_percent"])
    result |= {"discretisation": None, "alternative": None, "cost": result["cost"] | {"value": None}}
    nan = {n: replace(r, fitted={o: np.full_like(y, np.nan) for o, y in r.fitted.items()})
           for n, r in material.fit.recordings.items()}  # fmt: skip
    text = report_page(
        replace(material, folder=tmp_path, result=result, fit=replace(material.fit, recordings=nan), plane=None)
    )
    sections = [a["id"] for a in Parsed(text).all("section")]
    assert sections == [name for name in SECTIONS if name not in ("cost", "ladder")]
    assert "No run of the model reached the end" in text


def test_a_partial_result_is_marked_in_the_title_and_first_on_the_page_and_is_never_green(material):
    text = report_page(replace(material, result={**material.result, "outcome": "interrupted: the best so far is kept"}))
    assert re.search(r"<title>PARTIAL .*: .*seed \d+ – fracid</title>", text)
    assert text.index('<p class="partial">PARTIAL') < text.index("<h1>")
    assert 'class="claim look"' in text
    assert "PARTIAL" not in report_page(material)


def test_of_many_recordings_the_later_ones_are_folded(material, monkeypatch):
    monkeypatch.setattr("fracid.report.page.OPEN", 1)
    folded = Parsed(report_page(material))
    assert len(folded.all("article")) == 2  # one recording, one residual
    assert len([a for a in folded.all("details") if a.get("class") == "more"]) == 1 + 3
    assert "".join(folded.text).count(HOSTILE) >= 6
    assert folded.open == []


# --- its parts -------------------------------------------------------------------------------------


def estimate(value, half=None, free=True, kind="identifiable"):
    ends = None if half is None else [value - half, value + half]
    return {"value": value, "interval95": ends, "standard_error": half and half / 2, "free": free, "identifiable": kind,
            "integer": 1.0}  # fmt: skip


def said(**changes):
    """A result of a good fit, with changes."""
    recording = {"use": "fit", "rmse": {"alpha": 0.01}, "fit_percent": {"alpha": 95.0}, "parameters": {},
                 "initial_state": {}}  # fmt: skip
    result = {
        "orders": {"mu": estimate(1.01, 0.02)},
        "parameters": {"C1": estimate(0.004, 0.001)},
        "recordings": {"a": recording, "b": recording | {"use": "validate"}},
        "cost": {"value": 0.01},
        "claim": "fractional",
        "claim_reasons": [],
        "claim_codes": [],
        "alternative": None,
        "findings": [],
        "spread": None,
        "cut": None,
        "outcome": Outcome.CONVERGED,
        "discretisation": {"warning": "", "shift": {"mu": 1e-4}},
    } | changes
    used = lambda use: {n: r for n, r in result["recordings"].items() if r["use"] == use}  # noqa: E731
    shown = lambda n, v: f"{math.degrees(v):.2g}°"  # noqa: E731
    return SimpleNamespace(result=result, used=used, shown=shown, residuals={}, beside=lambda _: {})


RIVAL = {"structure": "every order 1", "cost": 0.04, "bic_gain_of_the_fractional_model": 500.0, "warning": ""}
FIT_ONLY = {"a": said().result["recordings"]["a"]}
POOR = {"a": FIT_ONLY["a"] | {"fit_percent": {"alpha": 3.0}}}

OWN = {"a": FIT_ONLY["a"], "b": said().result["recordings"]["b"] | {
    "parameters": {"theta_rest": estimate(0.1, 0.01)},
    "initial_state": {"D^mu alpha": estimate(0.1, 9.0, kind="practically not")}}}  # fmt: skip

FORGOTTEN = {"a": FIT_ONLY["a"] | {"initial_state": {"z_alpha": estimate(0.3, 1.0, kind="forgotten")}}}

LINES = {
    "a good fit": ("Fit", {}, True, "follows the recording to 0.57° (α) rms, a fit of 95 %"),
    "a poor fit": ("Fit", {"recordings": POOR}, False, "hardly better than a constant"),
    "a model that is off by half the motion": (
        "Fit", {"claim_codes": ["no-fit"]}, False, "does not follow the recording: it is off by 0.57° (α) rms",
    ),
    "orders next to 1": ("Orders", {}, True, "1 lies in the interval of μ: there is no evidence of fractional"),
    "orders off 1 that a rival cannot do without": (
        "Orders", {"orders": {"mu": estimate(0.9, 0.01)}, "alternative": RIVAL}, True,
        "The data favour fractional orders: with every order 1, the cost is 4 times as large",
    ),
    "orders that a rival does without": (
        "Orders", {"orders": {"mu": estimate(0.9, 0.01)}, "alternative": RIVAL | {"warning": "It is friction."}}, False,
        "They stand in for something of integer order, see above.",
    ),
    "orders off 1 without a rival": ("Orders", {"orders": {"mu": estimate(0.9, 0.01)}}, False, "no integer-order"),
    "an order next to its integer value, which is 0": (
        "Orders", {"orders": {"r": estimate(0.02, 0.02) | {"integer": 0.0}}}, True, "0 lies in the interval of r",
    ),
    "an order of which no integer makes sense": (
        "Orders", {"orders": {"r": estimate(0.4, 0.01) | {"integer": None}}}, True,
        "The model gives r no integer value, so it has no integer-order alternative.",
    ),
    "an order off 0": ("Orders", {"orders": {"r": estimate(0.9, 0.01) | {"integer": 0}}}, False, "r is off 0; no"),
    "orders without an interval": ("Orders", {"orders": {"mu": estimate(0.9)}}, False, "μ is not identifiable"),
    "an order that is not seen beside one that is": (
        "Orders", {"orders": {"lambda": estimate(1.2, 9.0, kind="practically not"), "mu": estimate(1.0, 0.01)}}, False,
        "λ is not identifiable. 1 lies in the interval of μ: there is no evidence of",
    ),
    "given orders": ("Orders", {"orders": {"mu": estimate(1.0, free=False)}}, True, "They were given, not found"),
    "no orders": ("Orders", {"orders": {}}, True, "The model has none."),
    "no orders to claim": ("Claim", {"orders": {}, "claim": "undecided"}, False, "whether the rig is fractional."),
    "a prediction": ("Prediction", {}, True, "It predicts b, which was held out, to 0.57°"),
    "no prediction": ("Prediction", {"recordings": FIT_ONLY}, False, "no recording was held out"),
    "all values known": ("Values", {}, True, "2 of 2 free values are identifiable"),
    "values of a model that does not fit, one at its bound": (
        "Values", {"orders": {"mu": estimate(0.9, kind="unknown")},
                   "parameters": {"C1": estimate(0, kind="at its bound")}}, False, "Of the 2 free values there are no",
    ),
    "values unknown": (
        "Values", {"parameters": {"C1": estimate(0.004, 1.0, kind="practically not")}}, False,
        "1 of 2 free values is identifiable; C1 is not",
    ),
    "where a joint began, which nobody misses": (
        "Values", {"recordings": FORGOTTEN}, True, "2 of 2 free values are identifiable.",
    ),
    "values that a held-out recording has for itself are counted apart": (
        "Values", {"recordings": OWN}, True, "2 of 2 free values are identifiable. 1 of 2 values that held-out "
        "recordings have for themselves is identifiable; D^μ\N{NO-BREAK SPACE}α at the start is not.",
    ),
    "values that nobody misses are in the tables and in no count": (
        "Values", {"recordings": FORGOTTEN}, True, "Not counted: 1 initial value of presliding joints.",
    ),
    "an integer in the interval, which the claim's reasons say": (
        "Orders", {"claim_reasons": ["1 lies within the intervals."]}, True, "μ = 1.010 ± 0.020.",
    ),
    "a search that ended": ("Checks", {}, True, "The search converged. Solved at half the step, no order moves"),
    "a search cut short": ("Checks", {"outcome": "interrupted"}, False, "The search did not converge: interrupted"),
    "a step too coarse": (
        "Checks", {"discretisation": {"warning": "Too coarse.", "shift": {"mu": 1.0}}}, False, "Too coarse.",
    ),
    "a step that moves an order further than its interval": (
        "Values", {"discretisation": {"warning": "μ moves.", "shift": {"mu": 0.03}}}, False, "but the step moves μ by",
    ),
    "a step that the claim speaks of": (
        "Checks", {"discretisation": {"warning": "μ moves.", "shift": {"mu": -0.03}}, "claim_codes": ["step"]},
        False, "Half the step moves μ by −0.03: the claim and the check of the step say more.",
    ),
    "no check": ("Checks", {"discretisation": None}, False, "What the step does was not checked"),
}  # fmt: skip


@pytest.mark.parametrize("case", LINES)
def test_the_verdict_has_six_lines_and_each_says_what_the_result_means(case):
    about, changes, good, words = LINES[case]
    lines = {line.about: line for line in verdict(said(**changes))}
    assert list(lines) == ["Claim", "Fit", "Orders", "Prediction", "Values", "Checks"]
    assert words in lines[about].sentence
    assert lines[about].good is good


CLAIMED = {"claim": "fractional", "claim_reasons": [], "orders": {"mu": estimate(0.9, 0.01)}, "alternative": RIVAL}


def residual(use, *, white, rms=1.0):
    whiteness = SimpleNamespace(thinning=2, white=white, correlation_time=1.0)
    return SimpleNamespace(use=use, output="alpha", recording="b", whiteness=whiteness,
                           level=Level("", rms=rms, floor=0.1))  # fmt: skip


@pytest.mark.parametrize(("white", "rms", "good"), [(True, 1.0, True), (False, 1.0, False), (False, 0.1, True)])
def test_a_prediction_is_in_order_only_where_its_residual_is_noise_or_rounding(white, rms, good):
    run = said()
    run.residuals = {"b": {"alpha": residual("validate", white=white, rms=rms)}}
    line = next(line for line in verdict(run) if line.about == "Prediction")
    assert line.good is good
    assert ("The residual of α is correlated: it is not noise alone." in line.sentence) is not good


def test_the_checks_name_the_residual_that_is_more_than_rounding_not_the_one_that_is_correlated_longest():
    run, rest = said(), residual("fit", white=False, rms=0.1)
    rest.output, rest.whiteness.correlation_time = "theta", 9.0
    run.residuals = {"a": {"alpha": residual("fit", white=False), "theta": rest}}
    line = next(line for line in verdict(run) if line.about == "Checks")
    assert line.sentence.endswith("The residual of α is correlated over 1 s: it is not noise alone.")
    run.residuals = {"a": {"theta": rest}}
    assert verdict(run)[-1].sentence.endswith("The residuals are noise and rounding.")


def test_an_integer_order_alternative_is_a_reason_and_a_misfit_speaks_against_the_claim():
    orders = {"lambda": estimate(1.2), "mu": estimate(1.18, 0.12)}
    changes = {"claim": "integer", "claim_reasons": [], "orders": orders, "alternative": RIVAL | {"warning": "It is."}}
    run = said(**changes, findings=[{"code": "misfit", "where": "a: alpha", "sentence": ""}])
    run.beside = lambda _: {}
    assert verdict(run)[0].sentence.replace("\N{NO-BREAK SPACE}", " ") == (
        "There is no evidence of fractional dynamics: a model of integer order fits as well as λ = 1.2 (no interval) "
        "and μ = 1.18 ± 0.12, but the model lacks something (see Fit)."
    )


def test_a_gain_over_the_integer_orders_that_decides_nothing_is_not_called_evidence():
    run = said(orders={"mu": estimate(0.9, 0.01)}, alternative=RIVAL, claim="undecided")
    orders = next(line for line in verdict(run) if line.about == "Orders")
    assert not orders.good
    assert orders.sentence == (
        "μ = 0.900 ± 0.010. With every order 1, the cost is 4 times as large (ΔBIC = 500); the claim gives the "
        "reason why that is not decisive."
    )


@pytest.mark.broad
def test_a_recording_that_begins_in_motion_says_so_beside_its_data_and_the_claim_leads_there(material):
    before = material.result["recordings"]
    name = next(n for n, r in before.items() if r["use"] == "fit")
    start = {"D^mu alpha": estimate(1.0, 0.1) | {"unit": "rad/s", "reason": ""}}

    def page(begin):
        recordings = before | {name: before[name] | {"initial_state": begin}}
        return report_page(replace(material, result=material.result | {"recordings": recordings, "claim": "integer"}))

    moving, still = page(start), page({})
    assert 'begins in motion (<a href="#data">see Data</a>)' in moving
    assert "It begins in motion" in moving
    assert "--cut shows how far the orders move with that." in moving
    assert "begins in motion" not in still


def test_an_interval_as_wide_as_its_constant_is_said_beside_it():
    wide = estimate(6e-7, 5e-7) | {"unit": "N m"}
    del wide["integer"]  # which an order alone has
    assert _wide(wide) == "its interval is ± 83 % of its value"
    assert _wide(wide | {"unit": "rad"}) == ""
    assert _wide(estimate(0.004, 0.001) | {"unit": "kg m^2"}) == ""


def test_the_table_of_the_step_shows_how_far_the_orders_move(page):
    text = " ".join(Parsed(page).text)
    assert "With the same values, half the step gives a cost of" in text
    assert "shift" in text


def test_a_step_at_half_of_which_no_run_ends_is_said_so_beside_no_shift(material):
    check = material.result["discretisation"] | {"cost_half_step": None, "cost_second_order": None, "orders": {}}
    text = report_page(replace(material, result=material.result | {"discretisation": check | {"shift": {}}}))
    table = text[text.index("Sensitivity to step size") : text.index("Integer-order alternative")]
    assert table.count("no run") == 2
    assert "shift" not in table
    assert _discretisation(Discretisation(1.0, np.inf, np.inf, {}, {})) == "with pi2 at half the step the run fails"


AGAINST = {
    "nothing": ({}, None, []),
    "a prediction that nobody tested": ({"recordings": FIT_ONLY}, None, []),
    "a prediction that failed": (
        {"findings": [{"code": "missed", "where": "b"}]}, None, ["Prediction"],
    ),
    "a poor fit": ({"recordings": POOR}, None, ["Fit"]),
    "a search that did not end": ({"outcome": "interrupted"}, None, ["Checks"]),
    "a value that is not identifiable": ({"parameters": {"C1": estimate(1.0, kind="practically not")}}, None, []),
    "a comparison that claims otherwise": ({}, {"claim": "integer"}, ["Ladder"]),
    "recordings that do not agree": ({"spread": {"sentences": ["mu differs."]}}, None, ["Each recording alone"]),
    "orders that move with the start": ({"cut": {"warnings": ["mu moves."]}}, None, ["Where the record begins"]),
}  # fmt: skip


@pytest.mark.parametrize("case", AGAINST)
def test_the_claim_is_in_order_only_where_nothing_on_the_page_contradicts_it(case):
    changes, compared, against = AGAINST[case]
    run = said(**CLAIMED | changes)
    run.beside = lambda _: compared or {}
    claim = verdict(run)[0]
    assert claim.about == "Claim"
    assert claim.good == (not against)
    assert all(name in claim.sentence for name in against)
    assert claim.sentence.count(".") == len(re.findall(r"\d\.\d", claim.sentence)) + 1  # one sentence


@pytest.mark.parametrize("sheet", ["page.css", "dark.css"])
def test_every_line_stands_out_from_the_paper(sheet):
    """WCAG's 3 to 1 for what is no text."""
    colours = dict(re.findall(r"--([\w-]+): (#\w{6})", files("fracid.report").joinpath(sheet).read_text("utf-8")))
    for name in ("measured", "fitted", "residual", "edge", "mark", "third", "ghost", "bob", "link"):
        assert contrast(colours[name], colours["paper"]) >= 3, name


def contrast(one, other):
    def light(colour):
        linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4
                  for c in (int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5))]  # fmt: skip
        return np.dot((0.2126, 0.7152, 0.0722), linear)

    low, high = sorted((light(one), light(other)))
    return (high + 0.05) / (low + 0.05)


ORDERS = {
    "given": (estimate(1.0, free=False), "1 (given)"),
    "without an interval": (estimate(0.9), "0.9 (no interval)"),
    "with one": (estimate(0.9145782, 0.00016), "0.91458 ± 0.00016"),
    "hardly seen": (estimate(1.2, 9.0), "1.2 ± 9.0"),
    "of a run that failed": (estimate(None), "– (no interval)"),
    "out of all proportion": (estimate(1e300, 1e299), "±"),
}


@pytest.mark.parametrize("case", ORDERS)
def test_an_order_is_drawn_whatever_is_known_of_it(case):
    order, words = ORDERS[case]
    drawn = orders_drawn({"mu": order, "lambda": estimate(1.0, 0.01)})
    assert words in drawn
    assert "nan" not in drawn
    ElementTree.fromstring(drawn)


def test_the_equations_leave_out_what_is_zero_and_keep_what_is_free(fitted):
    folder, fit, project = fitted
    result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    symbols = equations(project.problem.model, result, driven=False)["With symbols"]
    assert all(f"<mi>{index}</mi>" in symbols for index in ("Cθ", "θ", "α"))  # dry friction of the arm
    assert not any(f"<mi>{index}</mi>" in symbols for index in ("Cα", "u"))
    assert "<mi>d</mi>" not in symbols  # drag
    numbers = equations(project.problem.model, result, driven=False)["With the fitted values"]
    assert f"{fit.orders['mu'].value:.3f}" in numbers


class Reader:
    """MathML as Python: neighbours are factors, sin, cos and tanh take what follows them."""

    SIGNS = ("+", "-", "*", "/", "=", ",", "!=")

    def __init__(self, text):
        self.lines = ["".join(self.row(self.flat(row[0]))) for row in ElementTree.fromstring(text)[0]]

    def flat(self, part):
        """What stands in a row, and not within brackets."""
        within = part.tag in ("mtd", "mrow") and [child.text for child in part[:1]] not in (["("], ["|"], ["{"])
        return [leaf for child in part for leaf in self.flat(child)] if within else [part]

    def row(self, parts):
        words, parts = [], [p for p in parts if p.tag != "mspace"]
        while parts:
            word = self.word(parts)
            if words and words[-1] not in self.SIGNS and word not in self.SIGNS:
                words.append("*")
            words.append(word)
        return words

    def word(self, parts):
        part = parts.pop(0)
        text = (part.text or "").strip()
        if part.tag == "mo":
            return {"−": "-", "·": "*", "≠": "!="}.get(text, text)
        if part.tag == "mn":
            return text.replace("−", "-")
        if part.tag == "mi":
            return f"{text}({self.word(parts)})" if text in ("sin", "cos", "tanh", "max", "min") else text
        if part.tag == "msub":
            return "".join(self.word([child]) for child in part)
        if part.tag == "mover":
            return f"D_{part[0].text}"
        if part.tag == "mfrac":
            over, under = (self.word([child]) for child in part)
            return f"({over}/{under})"
        if part.tag == "msup":
            base, exponent = part
            if base.text == "D":
                return f"D_{self.word(parts)}"
            if base.text in ("sin", "cos"):
                return f"{base.text}({self.word(parts)})**2"
            return f"({self.word([base])})**({self.word([exponent])})"
        inner = [child for child in part if child.tag != "mspace"]
        if inner and inner[0].text == "|":
            return f"abs({self.word([inner[1]])})"
        if inner and inner[0].text == "{":
            (yes, when), (no, _) = inner[1]
            return (
                f"({''.join(self.row([*yes]))} if {''.join(self.row([*when[0]][1:]))} else {''.join(self.row([*no]))})"
            )
        inner = inner[1:-1] if inner and inner[0].text == "(" else inner
        return f"({''.join(self.row(inner)).strip()})"


ELEMENTS = {
    "without a state of their own": [],
    "Dahl": ["presliding_theta"],
    "LuGre in both joints": ["presliding_theta", "presliding_alpha"],
    "springpots": ["springpot_theta", "springpot_alpha"],
    "an elastic arm with play": ["play_theta"],
    "all": ["presliding_theta", "presliding_alpha", "springpot_theta", "springpot_alpha", "arm_stiffness"],
}


@pytest.mark.few(4)
@pytest.mark.parametrize("zero", ["hanging", "upright"])
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("elements", ELEMENTS)
def test_the_equations_as_printed_are_those_that_are_solved(zero, sign, elements):
    """Read back from the page, each holds for the model's right-hand side."""
    rng = np.random.default_rng(5)
    model = fracid.rotary_pendulum(zero=zero).equipped(ELEMENTS[elements])
    friction = ("b_theta", "b_alpha", "drag_theta", "drag_alpha", "theta_rest", "alpha_rest", "torque_per_volt")
    values = {p.name: p.value or 0.01 * rng.uniform(1, 9) for p in model.parameters}
    values |= {n: sign * round(0.01 * rng.uniform(1, 9), 4) for n in friction}
    values |= {"J_theta": 0.1, "saturation": 0.5}
    values |= dict.fromkeys(("stiction_theta", "arm_stiffness", "hub_inertia"), 0.0) if elements == "Dahl" else {}
    values |= dict.fromkeys(("arm_stiffness", "hub_inertia"), 0.0) if "play" in elements else {}
    values = {n: float(f"{v:.5g}") for n, v in values.items()}  # as printed
    constants = {n: {"value": v, "free": False} for n, v in values.items()}
    constants["drag_alpha"] |= {"value": 1.001 * values["drag_alpha"], "bound": values["drag_alpha"]}  # what it means
    result = {"orders": dict.fromkeys(("lambda", "mu"), estimate(0.9)), "parameters": constants, "recordings": {}}
    printed = []
    for line in Reader(equations(model, result, driven=True)["With the fitted values"]).lines:
        if line[0] in "=+-":  # goes on in a row of its own
            printed[-1] += line
        else:
            printed.append(line)
    greek = {"theta": "θ", "D^lambda theta": "ωθ", "alpha": "α", "D^mu alpha": "ωα", "arm": "θa", "D^lambda arm": "ωa"}
    names = [greek.get(n, n.replace("_theta", "θ").replace("_alpha", "α")) for n in model.states]
    solved = {"um", "φ", "τa", "εt"} & {equation.split("=")[0] for equation in printed}
    assert len(printed) == len(names) + len(solved)
    for x in rng.uniform(-1, 1, (5, len(names))):
        u, out = rng.uniform(-1, 1, 1), np.empty(len(names))
        model.rhs(0.0, x, u, model.parameter_vector(values), out)
        at = {**dict(zip(names, x, strict=True)), **{f"D_{n}": v for n, v in zip(names, out, strict=True)}, "u": u[0],
              "sin": math.sin, "cos": math.cos, "tanh": math.tanh, "abs": abs, "max": max, "min": min, "e": math.e,
              "π": math.pi}  # fmt: skip
        for left, _, right in (equation.partition("=") for equation in printed):
            if left in solved:
                at[left] = eval(right, at)
            assert eval(left, at) == pytest.approx(eval(right, at), rel=1e-9, abs=1e-12)


def test_gravity_has_the_sign_of_the_zero():
    signs = {}
    for zero in ("hanging", "upright"):
        model = fracid.rotary_pendulum(zero=zero)
        constants = {p.name: estimate(p.value, free=False) for p in model.parameters}
        result = {"orders": dict.fromkeys(("lambda", "mu"), estimate(1.0)), "parameters": constants, "recordings": {}}
        text = re.sub(r"<[^>]+>", "", equations(model, result, driven=False)["With symbols"])
        signs[zero] = "=−C4sinα" in text.replace(" ", "")
    assert signs == {"hanging": True, "upright": False}


@pytest.mark.parametrize("n", [5, 799, 20_001, 100_000])
def test_thinning_keeps_ends_and_extremes_and_holds_its_budget(n):
    rng = np.random.default_rng(n)
    signals = [rng.normal(size=n), np.where(np.arange(n) == n // 3, 50.0, rng.normal(size=n))]
    signals[0][n // 2] = np.nan
    at = extremes(signals, 800)
    assert at.size <= 802 + 2 * len(signals)
    assert (at[0], at[-1]) == (0, n - 1)
    assert (np.diff(at) > 0).all()
    for y in signals:
        assert (np.nanmin(y[at]), np.nanmax(y[at])) == (np.nanmin(y), np.nanmax(y))


@pytest.mark.parametrize("end", [2000.0, 86400.0])
def test_the_last_label_below_a_still_is_whole(end):
    t = np.linspace(0.0, end, 9)
    drawing = still(Chart("force", t, "time [s]", "[N]", (Series("measured", np.sin(t), "measured"),), "time"), 400)
    labels = re.findall(r'<text[^>]* x="([\d.]+)"[^>]*>([\d.]+)</text>', drawing)
    assert max(float(x) + 3.4 * len(text) for x, text in labels) <= 400


@pytest.mark.parametrize("recordings", [1, 5, 20, 200])
def test_the_budget_of_a_page_bounds_its_size_however_many_recordings(recordings):
    points = budget(recordings)
    assert FEWEST <= points <= POINTS
    assert recordings * points <= max(ALL_POINTS, recordings * FEWEST)


# --- the command -----------------------------------------------------------------------------------


def test_the_command_writes_the_file_and_says_where(fitted, tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["report", str(fitted[0]), "--out", str(tmp_path / "deep" / "rig.html")])
    assert ended.value.code == 0
    assert "rig.html" in capsys.readouterr().out
    assert Parsed((tmp_path / "deep" / "rig.html").read_text(encoding="utf-8")).open == []


@pytest.mark.broad
def test_a_folder_without_a_run_and_a_place_that_cannot_be_written_are_sentences(fitted, tmp_path, material):
    with pytest.raises(InputError, match=r"result\.json"):
        write_report(tmp_path)
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(InputError, match=r"report .* cannot be written: .* --out FILE"):
        write_report(fitted[0], plane=material.plane, out=tmp_path / "file" / "report.html")


def test_a_project_whose_recording_has_changed_is_refused(fitted, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(fitted[0].parent, copy)
    write_twin(copy / "one.csv", 0.4, 9)
    (copy / "run" / "environment.json").unlink()
    shutil.copy(copy / "rig.toml", copy / "run" / "project.toml")
    for name in ("one.csv", "two.csv"):
        shutil.copy(copy / name, copy / "run" / name)
    with pytest.raises(InputError, match="is not the one that"):
        write_report(copy / "run")


# --- in a browser ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def browser():
    if CHROMIUM is None:
        pytest.skip("there is no Chromium here")
    with Browser() as found:
        yield found


@pytest.fixture(scope="module")
def file(page, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "report.html"
    path.write_text(page, encoding="utf-8")
    return path


CALM = {"prefers_reduced_motion": "reduce"}
PICTURE = "document.getElementById('rig').toDataURL()"
CLOCK = "document.getElementById('clock').textContent"


def test_the_page_opens_without_a_complaint_or_a_request_and_draws_every_curve(browser, file):
    browser.open(file)
    browser.run("Chart.rebuild(true)")
    assert browser.complaints == []
    assert browser.requests == [file.as_uri()]
    hosts = browser.run("Chart.all.filter(chart => !chart.host.closest('#explore')).length")
    assert hosts == 2 + 4 + 4 * 3  # recordings, outputs and residuals, tests
    drawn = "document.querySelectorAll('.uplot canvas:not(.live)').length"  # at once: Explore adds more when near
    assert browser.run(f"Chart.rebuild(true), {drawn} === Chart.all.length")
    assert browser.run("window.hit") is None


@pytest.mark.parametrize("width", [400, 768, 1000, 1600])
def test_no_value_and_no_score_is_cut_off_at_the_side(browser, file, width):
    browser.open(file, width=width, **CALM)
    browser.run("for (const d of document.querySelectorAll('details')) d.open = true")
    cut = "[...document.querySelectorAll('.wide')].filter(e => e.querySelector('.estimates, .fits')" \
          " && e.scrollWidth > e.clientWidth).map(e => e.ariaLabel)"  # fmt: skip
    assert browser.run(cut) == []


def test_the_last_label_below_a_chart_is_whole(browser, file):
    browser.open(file, width=400, **CALM)
    browser.run("Chart.rebuild(true)")
    beside = "u.width - (u.bbox.left + u.bbox.width) / uPlot.pxRatio"
    short = f"Chart.all.filter(({{ plot: u, spec }}) => !spec.right?.length && {beside} < half(u) - 1).length"
    assert browser.run(short) == 0


def test_the_indices_of_an_equation_stand_below_their_letters(browser, file):
    browser.open(file, width=1440, **CALM)
    below = """[...document.querySelectorAll('msub')].map(sub => [...sub.children]
      .map(e => e.getBoundingClientRect().bottom)).map(([letter, index]) => index - letter)"""
    assert min(browser.run(below)) > 1


@pytest.mark.parametrize("width", [400, 1600])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_nothing_is_wider_than_the_screen_and_all_text_can_be_read(browser, file, width, scheme):
    browser.open(file, width=width, prefers_color_scheme=scheme, **CALM)
    browser.run("Chart.rebuild(true); for (const d of document.querySelectorAll('details')) d.open = true")
    assert browser.run("document.documentElement.scrollWidth") <= width
    assert browser.run(CONTRAST) == []


CONTRAST = r"""(() => {
  const parse = colour => { const n = colour.match(/[\d.]+/g).map(Number); return [n.slice(0, 3), n[3] ?? 1]; };
  const linear = v => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
  const weights = [0.2126, 0.7152, 0.0722];
  const light = rgb => rgb.reduce((sum, v, k) => sum + weights[k] * linear(v / 255), 0);
  const behind = e => {
    for (; e; e = e.parentElement) {
      const [rgb, opaque] = parse(getComputedStyle(e).backgroundColor);
      if (opaque > 0.99) return rgb;
    }
    return [255, 255, 255];
  };
  const bad = [], walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walk.nextNode()) {
    const e = walk.currentNode.parentElement, style = getComputedStyle(e), text = walk.currentNode.data.trim();
    if (!text || ["SCRIPT", "STYLE", "NOSCRIPT"].includes(e.tagName) || !e.getClientRects().length) continue;
    const [high, low] = [light(parse(style.color)[0]), light(behind(e))].sort((x, y) => y - x);
    const ratio = (high + 0.05) / (low + 0.05);
    if (ratio < 4.5) bad.push(`${e.tagName} ${text.slice(0, 30)}: ${ratio.toFixed(2)}`);
    if (parseFloat(style.fontSize) < 11 && !e.closest("math")) bad.push(`${e.tagName} ${style.fontSize}`);
  }
  return bad;
})()"""
"""Texts with less than WCAG's 4.5 to 1, or too small."""


def test_everything_to_be_used_has_a_name_and_headings_do_not_jump(browser, file):
    browser.open(file, **CALM)
    browser.run("Chart.rebuild(true)")
    assert browser.run(NAMELESS) == []
    levels = browser.run("[...document.querySelectorAll('h1,h2,h3,h4')].map(h => +h.tagName[1])")
    assert levels[0] == 1
    assert all(b <= a + 1 for a, b in pairwise(levels))
    assert browser.run("document.documentElement.lang") == "en"


NAMELESS = """(() => {
  const used = 'button, select, input, summary, a, [tabindex], [role=img], [role=region]';
  const named = e => e.getAttribute('aria-label') || document.getElementById(e.getAttribute('aria-labelledby'))
    || e.labels && e.labels[0] && e.labels[0].textContent.trim()
    || ['BUTTON', 'A', 'SUMMARY'].includes(e.tagName) && e.textContent.trim();
  return [...document.querySelectorAll(used)].filter(e => !named(e)).map(e => e.outerHTML.slice(0, 120));
})()"""
"""What can be used or looked at, without a name that can be read out."""


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_checker_of_accessibility_finds_nothing_to_object_to(browser, file, scheme):
    browser.open(file, prefers_color_scheme=scheme, **CALM)
    browser.run("Chart.rebuild(true); for (const d of document.querySelectorAll('details')) d.open = true")
    browser.run(files("axe_core_python").joinpath("axe.min.js").read_text(encoding="utf-8") + "; 0")
    found = browser.run(
        "axe.run().then(r => [r.passes.length, r.violations.map(v => [v.id, v.nodes.map(n => n.html)])])"
    )
    looked_at, objections = found
    assert objections == []
    assert looked_at > 15


def test_the_rig_plays_the_first_swings_by_itself_when_it_is_seen_and_stands_when_paused(browser, file):
    browser.open(file)
    browser.until("player.playing")
    assert browser.run("player.loop[1] < player.trace.end && player.window[1] === player.trace.end")
    before = browser.run(PICTURE)
    browser.until(f"{PICTURE} !== {json.dumps(before)}")
    browser.run("document.getElementById('play').click()")
    still = browser.run(PICTURE)
    browser.run("new Promise(done => setTimeout(done, 150))")
    assert browser.run(PICTURE) == still


def test_a_reader_who_wants_no_motion_gets_none_until_asked_for(browser, file):
    browser.open(file, **CALM)
    browser.run("document.getElementById('rig').scrollIntoView({behavior: 'instant', block: 'center'})")
    browser.run("new Promise(done => setTimeout(done, 300))")
    assert not browser.run("player.playing")
    assert browser.run(CLOCK) == "0.00 s"


def test_slow_motion_takes_as_many_times_as_long(browser, file):
    browser.open(file, **CALM)
    told = """(speed => {
      document.getElementById('speed').value = speed;
      player.seek(1);
      Object.assign(player, { playing: true, last: 0 }).frame(50);
      player.playing = false;
      return player.now - 1;
    })"""
    assert browser.run(f"{told}('1')") == pytest.approx(0.05)
    assert browser.run(f"{told}('0.1')") == pytest.approx(0.005)


def test_the_keyboard_plays_pauses_and_steps(browser, file):
    browser.open(file, **CALM)
    browser.run("document.getElementById('rigs').focus()")
    browser.key(" ", "Space", " ")
    assert browser.run("player.playing")
    browser.key(" ", "Space", " ")
    assert not browser.run("player.playing")
    browser.key("Home")
    assert browser.run("player.now") == 0
    browser.key("ArrowRight")
    assert browser.run("player.now") == pytest.approx(0.05)
    browser.key("ArrowLeft")
    assert browser.run("player.now") == pytest.approx(0)
    browser.key("End")
    assert browser.run("player.now") == pytest.approx(END - 0.5)
    browser.run("document.getElementById('play').focus()")
    browser.key(" ", "Space", " ")
    assert browser.run("player.playing")  # the button's own, once


def test_slider_cursor_and_rig_are_at_one_time(browser, file):
    browser.open(file, height=1600, **CALM)
    browser.run("Chart.rebuild(true); player.charts[0].host.scrollIntoView({behavior: 'instant', block: 'center'})")
    before = browser.run(PICTURE)
    box = "player.charts[0].plot.over.getBoundingClientRect()"
    x, y, width = browser.run(f"(r => [r.left, r.top + 40, r.width])({box})")
    browser.mouse("mouseMoved", x + width / 2, y)
    browser.until("player.now > 1")
    now = browser.run("player.now")
    assert browser.run("Number(document.getElementById('time').value)") == pytest.approx(now, abs=0.011)
    other = browser.run("(p => p.cursor.left / p.over.clientWidth)(player.charts[2].plot)")
    assert other == pytest.approx(0.5, abs=0.02)
    assert browser.run(PICTURE) != before
    browser.run("(s => { s.value = 1; s.dispatchEvent(new Event('input')); })(document.getElementById('time'))")
    assert browser.run("player.now") == pytest.approx(1)
    shown = browser.run("player.charts[0].values.textContent").replace("−", "-")
    expected = browser.run("player.trace.output('theta').measured[player.trace.t.findIndex(t => t > 0.995)]")
    measured = re.search(r"measured (\S+°),", shown)[1]
    assert float(measured.rstrip("°")) == pytest.approx(expected, abs=0.0051)
    below = browser.run("document.getElementById('rig-said').textContent").replace("−", "-")
    assert f"measured\N{NO-BREAK SPACE}{measured})" in below


def test_zooming_one_curve_zooms_all_of_its_recording(browser, file):
    browser.open(file, **CALM)
    browser.run("Chart.rebuild(true)")
    browser.run("player.charts[0].plot.setScale('x', {min: 1, max: 2})")
    browser.until("player.charts.every(c => c.plot.scales.x.min === 1 && c.plot.scales.x.max === 2)")
    browser.run("document.querySelector('[data-zoom=all]').click()")
    browser.until("player.charts.every(c => c.plot.scales.x.min === 0)")


def test_another_recording_is_chosen_by_name(browser, file):
    browser.open(file, **CALM)
    browser.run("(s => { s.value = '1'; s.dispatchEvent(new Event('change')); })(document.getElementById('recording'))")
    assert browser.run("document.getElementById('shown').textContent") == "held out"
    assert browser.run("player.trace.end") == pytest.approx(END)


def test_the_drawn_rig_stands_where_the_measured_angles_say(browser, file, material):
    browser.open(file, **CALM)
    model, result = material.project.problem.model, material.result
    found = {n: e["value"] for n, e in result["parameters"].items() if n in model.parameter_names}
    constants = model.with_parameters(**found).parameter_vector().tolist()
    for θ, α in [(0, 0), (0.5, 0), (0, 1.6), (-0.9, 2.4)]:
        drawn = browser.run(f"player.rig.at([{θ}, {α}]).map(b => [b.from, b.to])")
        np.testing.assert_allclose(drawn, model.scene.at({"theta": θ, "alpha": α}, constants), atol=1e-9)
    measured = browser.run("player.pose('measured', 0)")
    assert np.degrees(measured) == pytest.approx(browser.run("player.trace.outputs.map(o => o.measured[0])"))


SEEN = """[...document.querySelectorAll('svg.still')].filter(e => e.getClientRects().length).length"""
"""How many drawings are to be seen."""


def test_paper_gets_every_chart_as_a_drawing_and_every_note_in_light_colours(browser, file, page):
    browser.open(file, prefers_color_scheme="dark", **CALM)
    drawings = page.count('<svg class="still')
    assert drawings == 2 + 4 * 2 + 4 * 3 + 1 + 1  # recorded, fit and residual, tests, the surface, the rig
    assert browser.run(SEEN) == 0  # charts in their place
    browser.run("dispatchEvent(new Event('beforeprint'))")
    assert browser.run("document.querySelectorAll('details:not([open])').length") == 0
    browser.media("print", prefers_color_scheme="dark")
    assert browser.run(SEEN) == drawings
    assert browser.run("document.querySelectorAll('.uplot')[0]?.getClientRects().length || 0") == 0
    assert browser.run("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    browser.media("")
    browser.run("dispatchEvent(new Event('afterprint'))")
    assert browser.run("document.querySelectorAll('details[open]').length") == 0
    assert browser.pdf().startswith(b"%PDF")
    assert browser.complaints == []


def test_the_map_on_paper_has_the_lines_of_the_one_on_the_screen(browser, file):
    browser.open(file, **CALM)
    levels = browser.run("Plane.all[0].spec.levels.map(([_, label]) => label)")
    words = browser.run("[...document.querySelectorAll('#plane + svg text')].map(text => text.textContent)")
    drawn = {word for word in words if word[0] in "+×"}
    assert drawn
    assert drawn <= set(levels)
    assert "cost relative to the lowest" in words


def test_a_page_without_a_script_shows_every_drawing(browser, page, tmp_path):
    text = re.sub(r"<script>.*?</script>", "", page, flags=re.DOTALL)
    text = text.replace("<details", "<details open")
    (tmp_path / "quiet.html").write_text(text, encoding="utf-8")
    browser.open(tmp_path / "quiet.html", width=1440)
    assert browser.run(SEEN) == page.count('<svg class="still')
    assert browser.run("document.documentElement.scrollWidth") <= 1440
    assert browser.run("document.getElementById('play').getClientRects().length") == 0  # it would do nothing
    assert "Explore" not in browser.run("document.body.innerText")
    links = browser.run("[...document.querySelectorAll('#contents a')].filter(a => a.offsetWidth).map(a => a.hash)")
    assert browser.run(f"{links}.every(hash => document.querySelector(hash).offsetHeight)")
    browser.open(tmp_path / "quiet.html", width=400)
    letters = "[...document.querySelectorAll('.still')].map(s => 12 * s.clientWidth / s.viewBox.baseVal.width)"
    assert min(browser.run(letters)) >= 9
    assert browser.run("document.documentElement.scrollWidth") <= 400


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_claim_orders_rig_fit_and_residual_of_both_angles_are_on_the_first_screen(browser, file, scheme):
    browser.open(file, width=1440, height=900, prefers_color_scheme=scheme, **CALM)
    browser.until("player.charts.every(c => c.plot)")
    bottom = "Math.max(...[...document.querySelectorAll('{}')].map(e => e.getBoundingClientRect().bottom))"
    for what in (".claim", ".whiskers", "#rig", "#traces .u-over", "#traces .u-axis"):
        assert 0 < browser.run(bottom.format(what)) <= 900, what
    assert browser.run("player.charts.length") == 4


def test_the_theme_switch_is_stronger_than_the_system_but_not_than_paper(browser, file):
    browser.open(file, prefers_color_scheme="light", **CALM)
    background = "getComputedStyle(document.body).backgroundColor"
    light = browser.run(background)
    choose = "(s => {{ s.value = '{}'; s.dispatchEvent(new Event('change')); }})(document.getElementById('theme'))"
    browser.run(choose.format("dark"))
    dark = browser.run(background)
    assert dark != light
    browser.media("print")
    assert browser.run(background) == light
    browser.media("", prefers_color_scheme="dark")
    browser.run(choose.format("light"))
    assert browser.run(background) == light
    browser.run(choose.format("system"))
    assert browser.run(background) == dark


def test_ten_times_the_difference_moves_the_ghost_ten_times_as_far_and_the_solid_rig_not_at_all(browser, file):
    browser.open(file, **CALM)
    once = browser.run("player.poses(1)")
    browser.run("document.getElementById('tenfold').click()")
    tenfold = browser.run("player.poses(1)")
    assert tenfold["simulated"] == once["simulated"]
    for solid, near, far in zip(once["simulated"], once["ghost"], tenfold["ghost"], strict=True):
        assert near != solid
        assert far - solid == pytest.approx(10 * (near - solid))


@pytest.fixture(scope="module")
def with_encoders(material, tmp_path_factory):
    """The page of the same run, had both angles been measured with 1024 counts a turn."""
    resolutions = {name: dict.fromkeys(("theta", "alpha"), 2 * math.pi / 1024) for name in material.fit.recordings}
    path = tmp_path_factory.mktemp("encoders") / "report.html"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(type(material.project), "resolutions", property(lambda _: resolutions))
        path.write_text(report_page(material), encoding="utf-8")
    return path


def test_a_residual_has_ticks_at_one_and_three_encoder_steps_and_the_band_over_the_line(browser, with_encoders):
    browser.open(with_encoders, **CALM)
    browser.until("player.charts.every(c => c.plot)")
    step, ticks, bands = browser.run("(c => [player.trace.outputs[0].step, c.spec.right.map(r => r[0]), c.spec.bands])"
                                     "(player.charts[1])")  # fmt: skip
    assert step == pytest.approx(360 / 1024)
    assert {-1, 1} <= {round(at / step, 6) for at in ticks} <= {-10, -3, -1, 1, 3, 10}
    assert [(b["low"], b["high"]) for b in bands] == [(-step / 2, step / 2)]  # as in the figures
    # On a line as wide as the plot the band still shows: orange, so more red than blue.
    red, _, blue, _ = browser.run("""(async c => {
      c.spec.series[0].y = c.spec.x.map((_, i) => (i % 2 ? 1 : -1) * c.spec.bands[0].high);
      c.build();
      await new Promise(done => setTimeout(done, 50));
      const u = c.plot, at = (v, axis) => Math.round(u.valToPos(v, axis, true));
      return [...u.ctx.getImageData(at(2, 'x'), at(0.5 * c.spec.bands[0].high, 'y'), 1, 1).data];
    })(player.charts[1])""")
    assert red > blue + 20


def test_the_cost_under_the_cursor_is_that_of_the_plane(browser, file, material):
    browser.open(file, **CALM)
    fine = material.plane.refined(61)
    i, j = fine.first.size // 2, 1
    a, b, rise = fine.first[i], fine.second[j], fine.cost / fine.cost.min() - 1
    assert browser.run(f"Plane.all[0].height({a}, {b})") == pytest.approx(rise[i, j], rel=1e-5)
    between = browser.run(f"Plane.all[0].height({(a + fine.first[i + 1]) / 2}, {b})")
    assert between == pytest.approx((rise[i, j] + rise[i + 1, j]) / 2, rel=1e-5)
    browser.run("document.getElementById('plane').focus()")
    browser.key("ArrowRight")
    assert "the lowest" in browser.run("document.getElementById('plane-said').textContent")


def test_a_script_that_got_in_would_not_run(browser, file, page, tmp_path):
    spoilt = tmp_path / "spoilt.html"
    inside = "<script>window.hit = 1</script><img src=x onerror='window.hit = 2'>"
    spoilt.write_text(page.replace("<main>", f"<main>{inside}"), encoding="utf-8")
    browser.open(spoilt, **CALM)
    assert browser.run("window.hit") is None
    assert browser.run("player.now") == 0  # the page's own does


# --- long recordings -----------------------------------------------------------------------------------


@pytest.mark.broad
def test_of_a_very_long_recording_the_beginning_is_tested_without_a_copy_and_the_page_says_so(material, monkeypatch):
    name, r = next(iter(material.fit.recordings.items()))
    output, few = next(iter(r.measured)), r.time.size // 2
    part = first_part(r, few)
    assert part.measured[output].base is not None  # a view
    assert np.shares_memory(part.measured[output], r.measured[output])
    assert first_part(r) is r
    masked = first_part(replace(r, scored={output: r.time >= 0.1}, deviations={output: np.ones(r.time.size)}), few)
    assert np.count_nonzero(np.isnan(masked.standardised(output))) == np.count_nonzero(r.time < 0.1)
    assert "of the first" not in report_page(material)
    monkeypatch.setattr("fracid.validation.residual_analyses.first_part", lambda r: first_part(r, few))
    long = replace(material)  # nothing looked at yet
    assert long.residuals[name][output].samples <= few
    assert f"of the first {long.residuals[name][output].samples}" in report_page(long)


def test_a_recording_that_was_used_whole_is_not_read_again(material):
    for recording in material.project.recordings:
        said = next(s for s in tomllib.loads(material.project.text)["recording"] if recording.path.name == s["file"])
        again = material.as_recorded[recording.name] is not recording
        assert again == bool({"from", "to"} & said.keys() or recording.report.resampled)


@pytest.mark.parametrize(("codes", "drawn"), [(("effect",), True), (("no-fit", "decide-model"), False)])
def test_the_cost_over_the_orders_is_simulated_where_the_model_fits(monkeypatch, codes, drawn):
    monkeypatch.setattr("fracid.estimation.cost_plane.cost_plane", lambda *_, **__: "a plane")
    fit = SimpleNamespace(problem=SimpleNamespace(order_indices=(0, 1)), x=None, orders={}, cost=1.0,
                          claim_codes=codes)  # fmt: skip
    assert (plane_of(fit, 1) is not None) == drawn
