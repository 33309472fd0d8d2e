"""The site holds together before it is built: every page is in its menu, every public name in its reference, once.

What only the built site shows, dead links for one, ``make docs`` refuses.
"""

import importlib
import inspect
import re
import sys
from collections import Counter
from pathlib import Path
from urllib.parse import urlparse

import pytest

import fracid

DOCS = Path(__file__).parents[2] / "docs"
PAGES = sorted(str(path.relative_to(DOCS).with_suffix("")) for path in DOCS.rglob("*.md"))
AUTODOC = re.compile(r"^\.\. auto(?:class|function|exception|data):: fracid\.(\w+)$", re.MULTILINE)


def text_of(page):
    return (DOCS / f"{page}.md").read_text(encoding="utf-8")


def in_menus():
    """Every page that a toctree names, relative to docs/."""
    for page in PAGES:
        for body in re.findall(r"```\{toctree\}\n(.*?)```", text_of(page), re.DOTALL):
            entries = [line for line in body.splitlines() if line and not line.startswith(":")]
            yield from (str((Path(page).parent / entry).as_posix()) for entry in entries)


@pytest.fixture
def part(monkeypatch):
    """Imports a part of the site's builder."""
    monkeypatch.setattr(sys, "path", [str(DOCS / "_site"), *sys.path])
    return importlib.import_module


def test_every_page_is_in_the_menu_once():
    assert sorted(in_menus()) == [page for page in PAGES if page != "index"]


def test_every_public_name_is_in_the_reference_once():
    shown = Counter(name for page in PAGES if page.startswith("reference/") for name in AUTODOC.findall(text_of(page)))
    missing = set(fracid.__all__) - {"__version__"} - set(shown)
    assert not missing, f"add to a page of docs/reference/: {sorted(missing)}"
    assert set(shown) <= set(fracid.__all__)
    assert set(shown.values()) == {1}


def test_every_model_of_the_library_has_a_page_with_its_picture_its_equations_and_all_that_it_has(part):
    pages = {page.split("/")[1]: text_of(page) for page in PAGES if page.startswith("models/")}
    assert sorted(pages) == sorted(fracid.models.MODELS)
    for name, page in pages.items():
        assert re.search(r"!\[[^]]+\]\(\.\./images/", page)
        assert page.count("$$") >= 2
        assert f"<!-- all of {name} -->" in page
        said = part("library").all_of(name)
        model = fracid.model(name)
        assert model.source in said
        assert all(f"| `{p.name}` | {p.value:g} | {p.unit} |" in said for p in model.parameters)


def public(base):
    """What a class itself gives to the classes below it."""
    return [name for name in vars(base) if not name.startswith("_")]


def test_what_a_public_class_inherits_is_in_the_reference_too():
    words = "\n".join(text_of(page) for page in PAGES if page.startswith("reference/"))
    classes = {name: getattr(fracid, name) for name in fracid.__all__ if inspect.isclass(getattr(fracid, name))}
    heirs = [
        name
        for name, found in classes.items()
        if any(base.__module__.startswith("fracid.") and public(base) for base in found.__mro__[1:])
        and not issubclass(found, Exception)
    ]
    assert heirs
    assert [n for n in heirs if f"fracid.{n}\n   :members:\n   :inherited-members:\n" not in words] == []


@pytest.mark.parametrize("page", PAGES)
def test_links_out_of_the_site_are_whole_and_encrypted(page):
    words = re.sub(r"```.*?```|`[^`]*`", "", text_of(page), flags=re.DOTALL)
    addresses = [urlparse(address.rstrip(".,;)")) for address in re.findall(r"https?://[^\s<>\"')\]]+", words)]
    assert [a.geturl() for a in addresses if a.scheme != "https" or "." not in a.netloc] == []


def test_the_reference_of_the_commands_has_them_all_with_every_option(part):
    from typer.main import get_command

    from fracid.cli import app

    page = part("commands").reference()
    for name, command in get_command(app).commands.items():
        section = page.split(f"## fracid {name}\n")[1].split("\n## fracid ")[0]
        for parameter in (p for p in command.params if not getattr(p, "hidden", False)):  # those are refused
            assert parameter.opts[-1] in section or (parameter.metavar or "?") in section, (name, parameter.name)
    assert "[bold]" not in page
    assert "[/" not in page


def test_an_example_of_the_help_becomes_a_command_with_its_remark(part):
    assert part("commands")._example(r"fracid fit rig.toml  [dim]# writes \[runs/rig][/dim]") == (
        "$ fracid fit rig.toml  # writes [runs/rig]"
    )


@pytest.mark.parametrize(
    ("page", "found"),
    [
        ('<script src="https://cdn.example/a.js"></script>', ["https://cdn.example/a.js"]),
        ('<link href="//fonts.example/css" rel="stylesheet">', ["//fonts.example/css"]),
        ('<img src="http://example.org/a.png">', ["http://example.org/a.png"]),
        ("<style>@import url('https://example.org/a.css');</style>", ["https://example.org/a.css"]),
        ('<p style="background: url(//example.org/a.png)">', ["//example.org/a.png"]),
        ('<a href="https://example.org/">a link that one may follow</a> url(https://in.words)', []),
        ('<script src="_static/a.js"></script><img src="data:image/png;base64,AA//">', []),
    ],
)
def test_what_a_page_would_fetch_from_elsewhere_is_found(part, page, found):
    assert part("offline").Fetched(page).found == found


def test_the_whole_site_is_looked_through_for_what_it_would_fetch(part, tmp_path):
    (tmp_path / "_static").mkdir()
    (tmp_path / "_static" / "a.css").write_text("b { src: url(https://example.org/a.woff2) }")
    (tmp_path / "index.html").write_text('<link href="_static/a.css">')
    assert list(part("offline").fetched_from_elsewhere(tmp_path).values()) == [["https://example.org/a.woff2"]]


@pytest.mark.parametrize(
    ("target", "home"),
    [
        ("fracid.tasks.tasks.run_tasks", "fracid.run_tasks"),
        ("fracid.estimation.horizons.growing", "fracid.estimation.horizons"),
        ("fracid.no_such_thing", None),
    ],
)
def test_a_link_in_a_docstring_finds_its_public_name_or_its_module(part, target, home):
    pytest.importorskip("docutils")
    assert part("modules").home_of(target) == home


def test_labels_of_references_stay_within_their_docstring(part):
    lines = ["The sum of |e| [F]_, :math:`|e|`.", "", ".. math::  |e| + |f|", "", "Then |g|.", ".. [F] J. Filliben,"]
    assert part("docstrings").put_right(lines) == [
        r"The sum of \|e\| [F], :math:`|e|`.",
        "",
        ".. math::  |e| + |f|",
        "",
        r"Then \|g\|.",
        "*  [F] J. Filliben,",
    ]


def test_a_citation_in_a_table_keeps_its_width(part):
    table = ["=====  =====", "A [F]_  b", "=====  ====="]
    assert [len(line) for line in part("docstrings").put_right(table)] == [len(line) for line in table]


def test_formulas_become_mathml_that_needs_no_script(part):
    pytest.importorskip("math_core")
    formula = part("mathml").to_mathml(r"D^{q_i} x_i = \tfrac{1}{2}", display=True)
    assert formula.startswith("<math")
    assert "<msup>" in formula
    assert "<script" not in formula


@pytest.mark.parametrize("formula", [r"a &= b \\ c &= d", r"a = b \tag{*}", r"\begin{bmatrix} a \\ b \end{bmatrix}"])
def test_formulas_of_several_lines_and_with_labels_are_read(part, formula):
    pytest.importorskip("math_core")
    assert "<mtable" in part("mathml").to_mathml(formula, display=True)
