"""The index shows all runs of a folder side by side, links their pages, and writes over nothing that is not its own."""

import json
import math
import os
import re
import shutil
from importlib.resources import files
from pathlib import Path

import pytest

from browser import CHROMIUM, Browser
from fracid.cli.app import main
from fracid.errors import InputError
from fracid.report import write_report
from fracid.report.index import (
    GENERATOR,
    INDEX,
    RUNS_BEGIN,
    RUNS_END,
    identity,
    refresh_index,
    runs_of,
    write_index,
    write_study_page,
)
from fracid.schemas.run_record import EnvironmentBlock

RESULT = {"optimiser": "genetic", "method": "gl-paper", "cost": {"name": "itae"}, "seed": 3, "outcome": "converged",
          "recordings": {"swing": {"from": 1.0, "to": 21.5, "use": "fit"}}}  # fmt: skip

NAMES = ("first", "second <b>", "third")


@pytest.fixture
def runs(plain, tmp_path):
    """Three runs in a folder, begun one after the other, with pages that are nothing but their places for links."""
    for k, name in enumerate(NAMES):
        shutil.copytree(plain / "run", tmp_path / name)
        path = tmp_path / name / "environment.json"
        environment = json.loads(path.read_text(encoding="utf-8")) | {"started": f"2026-11-2{9 - k}T08:00:00+00:00"}
        path.write_text(json.dumps(environment), encoding="utf-8")
        (tmp_path / name / "report.html").write_text(f"<p>{RUNS_BEGIN}{RUNS_END}</p>", encoding="utf-8")
    return tmp_path


def links(folder: Path, name: str) -> list[str]:
    return re.findall(r'href="(.*?)"', (folder / name / "report.html").read_text(encoding="utf-8"))


def put(kind: str, path: Path) -> None:
    """Something else in place of a file."""
    path.unlink(missing_ok=True)
    if kind == "a pipe":
        os.mkfifo(path)
    elif kind == "a link":
        path.symlink_to(path.with_name("thesis"))
    elif kind == "a folder":
        path.mkdir()
    else:
        with path.open("wb") as file:
            file.truncate(6 << 30)


@pytest.mark.few(6)
@pytest.mark.parametrize("kind", ["a pipe", "a link", "a folder", "six gigabytes"])
@pytest.mark.parametrize("name", ["index.html", "first/report.html", "first/result.json", "first/environment.json"])
def test_whatever_stands_in_place_of_a_file_of_a_strangers_runs_hangs_nothing_and_leads_nowhere(runs, kind, name):
    (runs / name).with_name("thesis").write_text("mine")
    put(kind, runs / name)
    if name == "index.html":
        with pytest.raises(InputError, match="is not an index that fracid wrote; move it away first"):
            write_index(runs)
        refresh_index(runs)
    else:
        write_index(runs)
    assert (runs / name).with_name("thesis").read_text() == "mine"


def test_errors_stand_in_the_units_of_their_outputs_and_rank_whatever_these_are(runs):
    """That of an older run, which does not say them, in those of the paper's angles."""
    for name, units in zip(
        NAMES, ({"theta": "rad", "alpha": "rad"}, {"theta": "m", "alpha": "rad"}, None), strict=True
    ):
        path = runs / name / "result.json"
        result = json.loads(path.read_text(encoding="utf-8"))
        for r in result["recordings"].values():
            r["rmse"] = {"theta": 0.002, "alpha": 0.01}
            r["units"] = units
            if units is None:
                del r["units"]
        path.write_text(json.dumps(result), encoding="utf-8")
    cards = write_index(runs).read_text(encoding="utf-8").split("<tr data-card")[1:]
    seen = {next(n for n in ("first", "second", "third") if f'data-name="{n}' in card): card for card in cards}
    assert "θ 0.11°, α 0.57°" in seen["first"]
    assert "θ 0.002\xa0m, α 0.57°" in seen["second"]
    assert "θ 0.11°, α 0.57°" in seen["third"]
    errors = {name: float(re.search('data-error="(.*?)"', card)[1]) for name, card in seen.items()}
    assert errors["first"] == errors["third"] == pytest.approx(math.degrees((0.002 * 0.01) ** 0.5))
    assert errors["second"] == pytest.approx((0.002 * math.degrees(0.01)) ** 0.5)


def test_a_run_whose_name_is_no_text_is_linked_by_its_bytes(runs):
    (runs / NAMES[0]).rename(runs / os.fsdecode(b"x\xff"))
    assert 'href="x%FF/report.html"' in write_index(runs).read_text(encoding="utf-8")
    assert "../x%FF/report.html" in links(runs, NAMES[1])


def test_a_run_that_is_a_link_to_elsewhere_is_not_written_through(runs, tmp_path_factory):
    elsewhere = tmp_path_factory.mktemp("elsewhere") / "run"
    (runs / NAMES[0]).rename(elsewhere)
    (runs / NAMES[0]).symlink_to(elsewhere)
    before = (elsewhere / "report.html").read_bytes()
    assert [run["name"] for run in runs_of(runs)] == sorted(NAMES[1:], key=NAMES.index, reverse=True)
    write_index(runs)
    assert (elsewhere / "report.html").read_bytes() == before


def test_a_run_is_told_from_others_by_recipe_date_duration_and_seed():
    facts = identity(Path("runs/a"), RESULT | {"preset": "paper"}, {"started": "2026-11-22T13:16:05+00:00"}).facts
    assert facts == ("the paper's recipe (genetic, gl-paper, ITAE)", "22 Nov 2026 13:16", "20.5 s", "seed 3")
    assert identity(Path("runs/a"), RESULT, {"started": "yesterday"}).facts == (
        "genetic, gl-paper, ITAE",
        "20.5 s",
        "seed 3",
    )


@pytest.mark.parametrize(
    "outcome", ["interrupted: the best so far is kept", "stopped as asked: the best so far is kept"]
)
def test_a_partial_result_is_marked(outcome):
    assert "fracid resume" in identity(Path("a"), RESULT | {"outcome": outcome}, {}).partial
    assert identity(Path("a"), RESULT, {}).partial == ""


def test_runs_stand_in_the_order_in_which_they_were_begun_and_damaged_ones_are_left_out(runs):
    assert [run["name"] for run in runs_of(runs)] == list(reversed(NAMES))
    (runs / "third" / "result.json").write_text("{", encoding="utf-8")
    (runs / "first" / "environment.json").write_text("{", encoding="utf-8")
    assert {run["name"] for run in runs_of(runs)} == {"first", "second <b>"}


def test_the_pages_of_a_folder_are_linked_with_their_neighbours_and_with_the_index(runs):
    text = write_index(runs).read_text(encoding="utf-8")
    assert [text.index(f">{name}</a>") for name in ("third", "second &lt;b&gt;", "first")] == sorted(
        text.index(f">{name}</a>") for name in ("third", "second &lt;b&gt;", "first")
    )
    assert "<b>" not in text
    assert links(runs, "third") == ["../index.html", "../second%20%3Cb%3E/report.html"]
    assert links(runs, "second <b>") == ["../third/report.html", "../index.html", "../first/report.html"]
    assert links(runs, "first") == ["../second%20%3Cb%3E/report.html", "../index.html"]


def test_an_index_is_made_where_it_is_asked_for_and_renewed_where_it_is(runs):
    refresh_index(runs)
    assert not (runs / INDEX).exists()
    write_index(runs)
    shutil.rmtree(runs / "second <b>")
    refresh_index(runs)
    assert "2 runs" in (runs / INDEX).read_text(encoding="utf-8")
    assert links(runs, "third") == ["../index.html", "../first/report.html"]


def test_a_page_of_somebody_else_is_not_written_over(runs):
    (runs / INDEX).write_text("<h1>My pages</h1>", encoding="utf-8")
    refresh_index(runs)
    with pytest.raises(InputError, match="not an index that fracid wrote"):
        write_index(runs)
    assert (runs / INDEX).read_text(encoding="utf-8") == "<h1>My pages</h1>"


def test_a_page_that_is_a_link_to_elsewhere_is_left_as_it_is(runs):
    page, elsewhere = runs / "first" / "report.html", runs / "mine.html"
    page.rename(elsewhere)
    page.symlink_to(elsewhere)
    before = elsewhere.read_text(encoding="utf-8")
    write_index(runs)
    assert page.is_symlink()
    assert elsewhere.read_text(encoding="utf-8") == before


def test_a_folder_without_runs_is_refused_in_one_sentence(tmp_path):
    with pytest.raises(InputError, match="holds no folder of a run"):
        write_index(tmp_path)


def test_the_command_takes_a_folder_of_runs(runs, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["report", str(runs)])
    assert ended.value.code == 0
    assert INDEX in capsys.readouterr().out
    assert GENERATOR in (runs / INDEX).read_text(encoding="utf-8")
    with pytest.raises(InputError, match=r"result\.json"):
        write_report(runs, out=runs / "one.html")


def test_when_a_run_began_is_written_into_its_folder_and_an_old_folder_does_without(plain):
    environment = json.loads((plain / "run" / "environment.json").read_text(encoding="utf-8"))
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00", environment["started"])
    assert EnvironmentBlock(**environment | {"started": ""}).started == ""


@pytest.mark.broad
@pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium here")
@pytest.mark.parametrize("width", [400, 1440])
def test_the_index_opens_without_a_complaint_and_fits_the_screen(runs, width):
    with Browser() as browser:
        browser.open(write_index(runs), width=width)
        assert browser.complaints == []
        assert browser.run("document.documentElement.scrollWidth") <= width
        assert browser.run("document.querySelectorAll('.card .whiskers').length") == 3
        browser.run(files("axe_core_python").joinpath("axe.min.js").read_text(encoding="utf-8") + "; 0")
        found = browser.run("axe.run().then(r => r.violations.map(v => [v.id, v.nodes.map(n => n.html)]))")
        assert found == []


@pytest.mark.broad
@pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium here")
def test_a_theme_chosen_in_the_index_holds_on_the_pages_it_leads_to_and_the_swings_follow_it(runs):
    page = write_report(runs / "first")
    with Browser() as browser:
        browser.open(write_index(runs), prefers_color_scheme="light")
        assert browser.run("document.querySelectorAll('.card .still').length") == 1  # of the one page with samples
        measured = "getComputedStyle(document.querySelector('.card .measured')).stroke"
        light = browser.run(measured)
        browser.run("theme.value = 'dark'; theme.dispatchEvent(new Event('change'))")
        assert browser.run(measured) != light
        browser.open(page, prefers_color_scheme="light")
        assert browser.run("[theme.value, getComputedStyle(document.documentElement).colorScheme]") == ["dark", "dark"]


@pytest.fixture
def studied(runs):
    """A plan in a run's folder, beside the runs, and a damaged one."""
    plan = {"for": "the <b>rig</b>", "criterion": "D", "of": [], "experiments": [{"text": "release"}], "expected": {},
            "gain": {}, "candidates": 3, "excluded": 0, "distances": None, "alone": None}  # fmt: skip
    for folder, content in ((runs / "first" / "design", json.dumps(plan)), (runs / "damaged", "{")):
        folder.mkdir()
        (folder / "plan.json").write_text(content, encoding="utf-8")
    return runs


def test_studies_stand_in_the_index_and_a_new_one_renews_it(studied):
    text = write_index(studied).read_text(encoding="utf-8")
    assert "3 runs and 1 studies" not in text
    assert "3 runs and 1 study" in text
    assert "1 experiment for the &lt;b&gt;rig&lt;/b&gt;: 1 × release." in text
    assert 'href="first/design/plan.html"' not in text
    write_study_page(studied / "first" / "design", "plan.json")
    assert 'href="first/design/plan.html"' in (studied / INDEX).read_text(encoding="utf-8")


def test_only_the_page_of_a_fit_is_followed_by_an_export(studied, capsys):
    for folder, exported in ((studied / "first", True), (studied / "first" / "design", False)):
        with pytest.raises(SystemExit):
            main(["report", str(folder)])
        assert ("fracid export" in capsys.readouterr().out) == exported


@pytest.mark.broad
@pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium here")
def test_rows_are_sorted_filtered_and_two_of_them_put_side_by_side(studied):
    with Browser() as browser:
        browser.open(write_index(studied))
        names = "[...document.querySelectorAll('#runs tbody tr:not([hidden])')].map(r => r.dataset.name)"
        cards = "document.querySelectorAll('.card:not([hidden])').length"
        browser.run("document.querySelector('thead button[value=name]').click()")
        assert browser.run(names) == ["first", "first/design", "second <b>", "third"]
        browser.run("document.querySelector('thead button[value=name]').click()")
        assert browser.run(names) == ["third", "second <b>", "first/design", "first"]
        put = ("(n, v) => { const f = document.querySelector(`#filters [name=${n}]`); f.value = v;"
               " f.dispatchEvent(new Event('input')); }")  # fmt: skip
        browser.run(f"({put})('kind', 'design')")
        assert browser.run(names) == ["first/design"]
        assert browser.run(cards) == 1
        browser.run(f"({put})('kind', ''); ({put})('since', '2026-11-28')")
        assert "third" not in browser.run(names)
        browser.run(f"({put})('since', ''); ({put})('error', '1e-9')")
        assert browser.run(names) == []
        browser.run(f"({put})('error', '')")
        browser.run("for (const b of [...document.querySelectorAll('#runs tbody input')].slice(0, 2)) b.click()")
        assert browser.run(cards) == 2
        assert (
            browser.run("new Set([...document.querySelectorAll('.card:not([hidden])')].map(c => c.offsetTop)).size")
            == 1
        )


@pytest.mark.parametrize("samples", [
    "", "{", "[]", '{"recordings": [{"t": "AAAA", "outputs": [{}]}]}',
    '{"recordings": [{"t": "", "outputs": [{"measured": "", "fitted": ""}]}]}',
])  # fmt: skip
def test_a_page_whose_samples_are_damaged_has_no_swings_in_the_index(runs, samples):
    (runs / "first" / "report.html").write_text(
        f'<script type="application/json" id="samples">{samples}</script>', encoding="utf-8"
    )
    assert "<figure>" not in write_index(runs).read_text(encoding="utf-8")


@pytest.mark.parametrize(("changes", "look"), [
    ({"claim": "integer"}, False),
    ({"claim": "integer", "warnings": ["C6 is not identifiable."]}, False),
    ({"claim": "fractional", "findings": [{"code": "misfit", "where": "a: alpha", "sentence": ""}]}, True),
    ({"claim": "undecided"}, True),
])  # fmt: skip
def test_a_claim_has_the_colour_of_the_page_in_the_index_too(runs, changes, look, monkeypatch):
    of_folder = runs_of(runs)
    changed = [run | {"result": run["result"] | {"warnings": [], "findings": []} | changes} for run in of_folder]
    monkeypatch.setattr("fracid.report.index.runs_of", lambda _: changed)
    text = write_index(runs).read_text(encoding="utf-8")
    assert text.count('<span class="point look">') == look * len(changed)
    assert ("but the model lacks something" in text) == ("findings" in changes)


@pytest.mark.broad
@pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium here")
def test_the_menu_of_a_page_with_neighbours_is_seen_whole_or_has_a_row_and_marks_what_is_read(runs):
    for name in NAMES:
        write_report(runs / name)
    write_index(runs)
    page = runs / runs_of(runs)[1]["name"] / "report.html"
    with Browser() as browser:
        for width in (1920, 1600, 1500, 1440, 1280, 1024, 768, 400):
            browser.open(page, width=width)
            seen, wants = browser.run("[menu.clientWidth, menu.scrollWidth]")
            assert seen >= min(wants, 0.9 * width), width
            assert browser.run("document.documentElement.scrollWidth") <= width
        for section in ("reproduce", "checks", "model", "reproduce", "verdict"):
            browser.run(f"menu.querySelector('[href=\"#{section}\"]').click()")
            browser.until(f"[...menu.querySelectorAll('[aria-current]')].map(a => a.hash).join() === '#{section}'")
            within, link = browser.run(
                "['#contents', '[aria-current]'].map(q => document.querySelector(q).getBoundingClientRect().toJSON())"
            )
            assert within["left"] <= link["left"] <= link["right"] <= within["right"] + 1
        browser.open(page, width=1440)
        browser.run("scrollTo(0, document.documentElement.scrollHeight)")
        browser.until("document.querySelector('[aria-current]').hash === '#reproduce'")
