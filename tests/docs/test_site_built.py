"""The site as a reader has it: built strictly, opened from files in a browser, narrow and wide, light and dark."""

import subprocess
import sys
from importlib.resources import files
from pathlib import Path

import pytest

from browser import CHROMIUM, Browser

pytestmark = pytest.mark.slow

DOCS = Path(__file__).parents[2] / "docs"
LOOKED_AT = ("index", "tutorial", "theory", "project-file", "reference/cli", "reference/identification")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The site, built as make docs builds it."""
    pytest.importorskip("sphinx", reason="make docs installs it")
    made = tmp_path_factory.mktemp("site")
    strictly = ("--quiet", "--fresh-env", "--fail-on-warning", "--keep-going", "--nitpicky", "-b", "html")
    done = subprocess.run([sys.executable, "-m", "sphinx", *strictly, DOCS, made], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return made


@pytest.fixture(scope="module")
def browser():
    if CHROMIUM is None:
        pytest.skip("no Chromium on this machine")
    with Browser() as opened:
        yield opened


def test_every_page_is_as_wide_as_a_telephone_and_asks_nobody_for_anything(site, browser):
    pages = sorted(site.rglob("*.html"))
    assert len(pages) > len(list(DOCS.rglob("*.md")))
    for page in pages:
        browser.open(page, width=400)
        assert browser.run("document.documentElement.scrollWidth") <= 400, page
        assert [asked for asked in browser.requests if not asked.startswith(("file:", "data:"))] == [], page
        assert browser.complaints == [], page


def test_the_page_of_a_fit_at_the_front_simulates_the_true_orders(site, browser):
    assert 'src="example-report.html?embed"' in (site / "index.html").read_text(encoding="utf-8")
    browser.open(site / "example-report.html")
    browser.run("document.getElementById('explore').scrollIntoView({behavior: 'instant'})")
    browser.until("explore !== null && explore.charts.length > 0")
    orders = browser.run("explore.byKind('orders').map(slider => slider.value)")
    assert orders == pytest.approx([0.93, 0.96], abs=3e-3)


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("page", LOOKED_AT)
def test_a_page_passes_the_check_of_accessibility(site, browser, page, scheme):
    browser.open(site / f"{page}.html", width=1200, prefers_color_scheme=scheme)
    browser.run(files("axe_core_python").joinpath("axe.min.js").read_text(encoding="utf-8") + "; 0")
    rules = "{runOnly: ['wcag2a', 'wcag2aa'], iframes: false}"  # a file's frame is another origin; it has its own test
    found = f"axe.run({rules}).then(r => [r.passes.length, r.violations.map(v => [v.id, v.nodes.map(n => n.html)])])"
    passes, violations = browser.run(found)
    assert violations == []
    assert passes > 10


def test_the_search_works_from_files(site, browser):
    browser.open(site / "search.html")
    browser.run("location.search = '?q=identify'")
    browser.until("document.querySelector('p.search-summary')?.textContent.includes('found')")
    browser.until("[...document.querySelectorAll('ul.search a')].some(a => a.href.includes('#fracid.identify'))")
    assert browser.complaints == []


def test_formulas_are_drawn_and_not_spelt(site):
    page = (site / "theory.html").read_text(encoding="utf-8")
    assert page.count("<math") > 50
    assert "$$" not in page
