"""A reader moves an order or a friction, and the page simulates what fracid would."""

import json
import tomllib
from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest

import fracid
from browser import CHROMIUM, Browser
from folders import driven
from fracid.estimation.cost_plane import cost_plane
from fracid.report import report_page
from fracid.report.explore import explore, not_explored
from fracid.report.material import Material
from fracid.runs.folder import open_folder, write_result
from fracid.runs.saved import load_run
from fracid.solver.memory import short
from twins import RIG, write_release

pytestmark = [pytest.mark.broad, pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium here")]

PROJECT = """
[model.parameters]
b_alpha = { start = 3e-4, lower = 0.0, upper = 1e-2 }
coulomb_theta = 0.001
[model.orders]
lambda = { start = 0.9, lower = 0.7, upper = 1.2 }
mu = { start = 0.9, lower = 0.7, upper = 1.2 }
[[recording]]
name = "release"
file = "swing.csv"
theta = { column = "theta", unit = "rad" }
alpha = { column = "alpha", unit = "rad" }
[[recording]]
name = "driven"
file = "driven.csv"
theta = { column = "theta", unit = "rad" }
alpha = { column = "alpha", unit = "rad" }
voltage = { column = "voltage", unit = "V", between = "hold" }
[[recording]]
name = "let go late"
file = "late.csv"
theta = { column = "theta", unit = "rad" }
alpha = { column = "alpha", unit = "rad" }
release_time = 0.0237
[[recording]]
name = "let go early"
file = "early.csv"
theta = { column = "theta", unit = "rad" }
alpha = { column = "alpha", unit = "rad" }
release_time = { start = -0.004, lower = -0.02, upper = 0.02 }
[[recording]]
name = "held out"
file = "held_out.csv"
theta = { column = "theta", unit = "rad" }
alpha = { column = "alpha", unit = "rad" }
release_time = { start = 0.003, lower = -0.02, upper = 0.02 }
use = "validate"
[fit]
initial_state = "rest"
"""

RECORDINGS = ["release", "driven", "let go late", "let go early", "held out"]

CALM = {"prefers_reduced_motion": "reduce"}


@pytest.fixture(scope="module")
def material(tmp_path_factory):
    """A release and a driven run, whose voltage jumps, of a rig with two orders."""
    folder = tmp_path_factory.mktemp("explore")
    truth = {"orders": {"lambda": 0.8623, "mu": 0.9146}, "step": 1e-2, "end": 3.0, "noise": 1e-3}
    rig = RIG.with_parameters(coulomb_theta=1e-3)
    write_release(folder / "swing.csv", rig, alpha=0.35, **truth)
    write_release(folder / "driven.csv", rig, alpha=0.0, inputs=driven(300), **truth)
    write_release(folder / "late.csv", rig, alpha=0.3, **truth)
    write_release(folder / "early.csv", rig, alpha=0.25, **truth)
    write_release(folder / "held_out.csv", rig, alpha=0.2, **truth)
    (folder / "rig.toml").write_text(PROJECT, encoding="utf-8")
    project = fracid.load_project(folder / "rig.toml")
    open_folder(folder / "run", ["fit", str(folder / "rig.toml"), "--out", "<run>"])
    fit = fracid.identify(project)
    write_result(folder / "run", fit, project, {"search": 1.0})
    return Material.of(folder / "run", load_run(folder / "run"), project, cost_plane(fit.problem, fit.x, points=5))


@pytest.fixture(scope="module")
def file(material, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "report.html"
    path.write_text(report_page(material), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def browser():
    with Browser() as found:
        yield found


@pytest.fixture
def page(browser, file):
    """The page, with its Explore in view."""
    browser.open(file, **CALM)
    browser.run("document.getElementById('explore').scrollIntoView({behavior: 'instant'})")
    browser.until("explore !== null && explore.charts.length > 0")
    return browser


MOVE = """new Promise(done => {{
  const row = explore.rows.find(one => one.slider.name === {name});
  row.input.value = {value};
  row.input.dispatchEvent(new Event("input"));
  row.input.dispatchEvent(new Event("change"));
  requestAnimationFrame(() => requestAnimationFrame(() => done(row.slider.now)));
}})"""


def moved(page, name, value):
    """Move a slider; the value that it then has."""
    return page.run(MOVE.format(name=json.dumps(name), value=value))


def test_a_step_that_the_fit_halved_is_the_pages_too(material):
    run = load_run(material.folder)
    halved = replace(run, problem=replace(run.problem, substeps=2 * run.problem.substeps))
    assert {r["every"] for r in explore(Material.of(run.folder, halved, run.project))["recordings"]} == {
        2 * run.problem.substeps
    }


@pytest.mark.parametrize("recording", RECORDINGS)
def test_the_page_simulates_the_fit_and_any_other_point_as_the_library_does(page, material, recording):
    page.run(f"explore.open({RECORDINGS.index(recording)})")
    assert page.run("explore.agreement") < 1e-6
    problem, x = material.project.problem, material.fit.x.copy()
    for name, value in (("lambda", 1.02), ("mu", 0.97), ("b_alpha", 4e-4)):
        x[problem.names.index(name)] = moved(page, name, value)
    e = next(e for e in (*problem.experiments, *material.project.validation) if e.name == recording)
    if recording == "held out":
        problem = problem.with_shared(x, (e,))
        own = material.fit.recordings[recording].initial | material.fit.recordings[recording].parameters
        x = np.array([own[u.target].value for u in problem.unknowns])
    outputs = problem.fitted(x, e)
    for k, degrees in enumerate(np.rad2deg(outputs).T):
        found = np.array(page.run(f"Array.from(explore.curves[{k}])"))
        np.testing.assert_allclose(found, degrees, rtol=0, atol=1e-6 * abs(degrees).max())
    errors = np.rad2deg(e.measured - outputs)
    assert page.run("explore.rmse") == pytest.approx(np.sqrt(np.mean(errors**2, axis=0)), rel=1e-5)


CELL = """
[model]
name = "capacitor"
[model.parameters]
R = { start = 0.04, lower = 0.0, upper = 1.0 }
[model.orders]
q = { start = 0.9, lower = 0.7, upper = 1.1 }
[[recording]]
file = "cell.csv"
voltage = { column = "voltage" }
current = { column = "current", between = "hold" }
"""


def test_an_output_that_is_a_function_of_states_and_inputs_is_explored_too(browser, tmp_path):
    twin = fracid.Twin.of_library("capacitor").changed(end=40.0)
    recording = twin.record(twin.simulate())
    fracid.save_recording(recording, tmp_path / "cell.csv")
    (tmp_path / "cell.toml").write_text(CELL, encoding="utf-8")
    made = fracid.run(tmp_path / "cell.toml", out=tmp_path / "run", figures=False)
    material = Material.of(made.folder, load_run(made.folder), made.project)
    (tmp_path / "report.html").write_text(report_page(material), encoding="utf-8")
    browser.open(tmp_path / "report.html", **CALM)
    browser.run("document.getElementById('explore').scrollIntoView({behavior: 'instant'})")
    browser.until("explore !== null && explore.charts.length > 0")
    assert browser.run("explore.agreement") < 1e-6
    problem, x = material.project.problem, material.fit.x.copy()
    assert browser.run("explore.sliders.map(s => s.name)") == ["q", "R"]  # a constant is no friction, and was free
    browser.run("explore.sliders[0].now = 0.95")
    x[problem.names.index("q")] = 0.95
    found = browser.run("Array.from(explore.simulate().outputs[0])")
    np.testing.assert_allclose(found, problem.fitted(x, problem.experiments[0])[:, 0], rtol=0, atol=1e-9)


def test_arrow_keys_move_a_slider_and_the_curve_and_the_score_follow(page):
    before = page.run("[explore.sliders[1].now, document.getElementById('explore-scores').textContent]")
    page.run("explore.rows[1].input.focus()")
    for _ in range(9):
        page.key("ArrowRight")
    page.until(f"document.getElementById('explore-scores').textContent !== {json.dumps(before[1])}")
    assert page.run("explore.sliders[1].now") > before[0]
    assert "estimate" in page.run("explore.rows[1].input.getAttribute('aria-valuetext')")
    page.run("document.getElementById('explore-best').click()")
    page.until(f"document.getElementById('explore-scores').textContent === {json.dumps(before[1])}")


def test_integer_order_finds_the_frictions_again(page):
    moved(page, "lambda", 1.0)
    moved(page, "mu", 1.0)
    page.run("explore.sliders.forEach(s => { if (s.kind === 'orders') s.now = 1; })")
    orders_alone = page.run("(explore.simulate(), explore.rmse)")
    page.run("explore.integer()")
    assert page.run("explore.byKind('orders').map(s => s.now)") == [1, 1]
    page.until("document.getElementById('explore-said').textContent.includes('refitted to this')")
    again = page.run("explore.rmse")
    assert np.hypot(*again) < 0.9 * np.hypot(*orders_alone)
    assert page.run("explore.byKind('parameters').every(s => s.now >= 0)")


def test_the_values_are_toml_that_a_project_takes(page, material):
    moved(page, "mu", 0.95)
    values = tomllib.loads(page.run("document.getElementById('explore-toml').textContent"))["model"]
    assert values["orders"]["mu"] == pytest.approx(0.95, abs=1e-3)
    assert set(values["parameters"]) <= set(material.project.problem.model.parameter_names)
    assert "b_alpha" in values["parameters"]


def test_a_link_shows_what_its_sender_saw(page):
    moved(page, "mu", 0.95)
    moved(page, "b_alpha", 5e-4)
    page.until("location.hash.includes('b_alpha')")
    said = dict(page.run("[...new URLSearchParams(location.hash.slice(1))]"))
    assert {n: float(v) for n, v in said.items()} == pytest.approx({"mu": 0.95, "b_alpha": 5e-4}, rel=1e-2)
    seen = page.run("explore.rmse")
    page.run("setTimeout(() => location.reload(), 50)")
    page.until("typeof explore !== 'undefined' && explore?.charts?.length > 0 && !explore.moved")
    page.until("!explore.waiting")
    assert page.run("explore.rmse") == pytest.approx(seen, rel=1e-4)
    page.run("document.getElementById('explore-best').click()")
    page.until("location.hash === '#explore'")


def test_in_the_frame_of_another_page_the_curves_are_in_sight_and_nothing_else(browser, file):
    for width in (360, 736):
        browser.open(file, width=width, height=704, **CALM)
        browser.run("setTimeout(() => { location.search = '?embed'; }, 50)")
        browser.until("location.search === '?embed' && typeof explore !== 'undefined' && explore?.charts?.length > 0")
        browser.until("explore.charts.some(c => c.plot)")
        assert browser.run("document.querySelector('#explore-charts canvas').getBoundingClientRect().bottom") < 500
        assert (
            browser.run("document.querySelector('.bar').offsetHeight + document.querySelector('#verdict').offsetHeight")
            == 0
        )


def test_a_dot_on_the_cost_map_follows_and_a_click_on_the_map_moves_the_sliders(page):
    picture = "document.getElementById('plane').toDataURL()"
    page.run("document.getElementById('plane').scrollIntoView({behavior: 'instant'})")
    before = page.run(picture)
    low, high = page.run("[explore.plane.spec.first[0], explore.plane.spec.first.at(-1)]")
    moved(page, "lambda", low + 0.2 * (high - low))
    assert page.run(picture) != before
    a, b = page.run("[explore.plane.spec.first[9], explore.plane.spec.second[50]]")
    page.run(f"explore.plane.spec.pick({a}, {b})")
    assert page.run("explore.sliders.slice(0, 2).map(s => s.now)") == [a, b]


@pytest.mark.parametrize(("width", "scheme"), [(400, "dark"), (1440, "light")])
def test_the_section_fits_the_screen_and_a_checker_of_accessibility_finds_nothing(browser, file, width, scheme):
    browser.open(file, width=width, prefers_color_scheme=scheme, **CALM)
    browser.run("document.getElementById('explore').scrollIntoView({behavior: 'instant'})")
    browser.until("explore !== null && explore.charts.length > 0")
    assert browser.complaints == []
    assert browser.run("document.documentElement.scrollWidth") <= width
    stuck = browser.run("[...document.querySelectorAll('#explore *')].filter(e => getComputedStyle(e).position === "
                        "'sticky').map(e => e.clientHeight / innerHeight)")  # fmt: skip
    assert sum(stuck) < 0.15
    browser.run(files("axe_core_python").joinpath("axe.min.js").read_text(encoding="utf-8") + "; 0")
    found = browser.run("axe.run('#explore').then(r => r.violations.map(v => [v.id, v.nodes.map(n => n.html)]))")
    assert found == []


def test_what_cannot_be_explored_is_said_in_one_sentence(material):
    problem = material.project.problem
    late = replace(problem.experiments[0], past=np.zeros((9, 2)))
    for other, words in (
        (replace(problem, memory=short(20)), "memory short"),
        (replace(problem, method="bdf2"), "method bdf2"),
        (replace(problem, experiments=(late,), initial_state="measured"), "measured past"),
    ):
        changed = replace(material, project=replace(material.project, problem=other, validation=()))
        assert words in not_explored(changed)
    windows = replace(material, result=material.result | {"window": 0.5})
    assert "fitted in windows, each with a start of its own" in not_explored(windows)
