"""A model of a few equations moves on the page as the pendulum does."""

import numpy as np
import pytest

import fracid
from browser import CHROMIUM, Browser
from fracid.report import report_page
from fracid.report.material import Material
from fracid.runs.folder import open_folder, write_result
from fracid.runs.saved import load_run

pytestmark = [pytest.mark.broad, pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium here")]

PROJECT = """
[model]
name = "mass on a spring"
[model.equations]
place = { equals = "speed", unit = "m" }
speed = { equals = "-k*(place - place_rest) - c*speed", order = "mu" }
[model.scene]
wall   = { shape = "box", from = [-1, -0.3], to = [-1, 0.3], width = 0.1 }
spring = { shape = "spring", from = [-1, 0], to = ["place - place_rest", 0], width = 0.2 }
mass   = { shape = "box", from = ["place - place_rest", 0], to = ["place - place_rest + 0.4", 0], width = 0.4 }
[model.parameters]
k = { start = 8.0, lower = 1.0, upper = 20.0 }
c = 0.3
place_rest = 0.05
[model.orders]
mu = { start = 1.0, lower = 0.8, upper = 1.2 }
[[recording]]
file = "mass.csv"
place = { column = "place", unit = "mm" }
[fit]
initial_state = "estimate"
"""


@pytest.fixture(scope="module")
def material(tmp_path_factory):
    folder = tmp_path_factory.mktemp("mass")
    t = np.arange(0, 6, 0.01)
    y = 1e3 * (0.05 + 0.3 * np.exp(-0.15 * t) * np.cos(np.sqrt(8 - 0.15**2) * t)).round(4)
    np.savetxt(folder / "mass.csv", np.column_stack([t, y]), delimiter=",", header="time,place", comments="")
    (folder / "rig.toml").write_text(PROJECT, encoding="utf-8")
    project = fracid.load_project(folder / "rig.toml")
    open_folder(folder / "run", ["fit", "rig.toml"])
    fit = fracid.identify(project)
    write_result(folder / "run", fit, project, {"search": 1.0})
    return Material.of(folder / "run", load_run(folder / "run"), project)


def test_the_page_moves_the_bodies_as_the_library_places_them(material, tmp_path):
    (tmp_path / "report.html").write_text(report_page(material), encoding="utf-8")
    model = material.project.problem.model
    (r,) = material.fit.recordings.values()
    with Browser() as browser:
        browser.open(tmp_path / "report.html", prefers_reduced_motion="reduce")
        browser.run("player.play(false)")
        for time in (0.0, 0.5):
            browser.run(f"player.seek({time})")
            on_page = browser.run("player.rig.at(player.pose('fitted', player.now)).map(b => [b.from, b.to])")
            k = int(np.argmin(np.abs(r.time - r.time[0] - time)))
            constants = {p.name: p.value for p in model.parameters} | {n: e.value for n, e in r.parameters.items()}
            ours = model.scene.at({"place": r.fitted["place"][k]}, [constants[p.name] for p in model.parameters])
            np.testing.assert_allclose(on_page, ours, atol=1e-6)
        drawn = "[...player.rig.ctx.getImageData(0, 0, player.rig.canvas.width, player.rig.canvas.height).data]"
        assert len(set(browser.run(f"{drawn}.filter((_, k) => k % 4 < 3)"))) > 3  # more than one colour
        assert browser.complaints == []


def test_the_still_has_each_body_once(material):
    page = report_page(material)
    still = page[page.index('aria-label="As simulated at the start"') :].split("</svg>")[0]
    assert still.count("<polyline") == 3
    assert still.count('class="body moves"') == 1
