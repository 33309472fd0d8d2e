"""What users read speaks the field's own words: none of the phrases below, which readers stumbled over.

Looked through are the pages, the messages and help texts in the source, the report's template and the public
docstrings.  Names in code (`` `rival=True` ``) and the changelog, which quotes the past, are not.
"""

import ast
import inspect
import json
import re
import tomllib
from functools import cache
from pathlib import Path

import pytest

import fracid

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "src" / "fracid"
ALONE = (ROOT / "README.md", ROOT / "SECURITY.md", ROOT / "benchmarks" / "README.md")
PAGES = sorted(str(page.relative_to(ROOT)) for page in (*ALONE, *(ROOT / "docs").rglob("*.md")))
INSTEAD = {
    r"left over|leaves? over": "residual, unexplained",
    r"\b(?:can|cannot)(?: practically)?(?: not)? be told": "identifiable, not identifiable, distinguishable",
    r"hardly sees?\b|hardly seen": "practically non-identifiable; carries almost no information",
    r"\bnot fitted\b": "held out",
    r"\b(?:hold|holds|holding) the truths?\b": "coverage; contain the true value",
    r"\bhangs? together": "autocorrelated",
    r"half intervals?\b": "CI half-width",
    r"\bturn(?:ed|s)? (?:it |them |most of them )?round\b": "sign reversed; resolve",
    r"\b(?:go|goes|gone|going|went) on with\b": "resume, continue",
    r"\bcut short\b": "interrupted",
    r"\bmend(?:s|ed)?\b": "fix, correct",
    r"\bbe it\b": "for instance",
    r"\bended so\b": "did not converge",
    r"\bof all randomness": "random seed",
    r"\bdata (?:do not )?object\b": "the cost reaches the 95 % limit",
    r"\bknows? (?:itself|of each other)": "correlation time; share information",
    r"\basks? nobody": "loads nothing from the network",
    r"\brivals?\b": "alternative model, integer-order alternative",
    r"\bas far as these\b": "its interval includes zero; within the resolution of",
    r"\bdoes not know of\b": "ignores",
    r"\b(?:do not|does not|cannot) tell\b": "determine, separate; is not identifiable",
    r"\bRead that first\b": "review it first",
    r"\b(?:is|are|was|were) told\b": "is reported; is identified by",
    r"\bwhat the data can tell\b": "identifiable; the band of the recording",
    r"\bwhat should die\b": "decaying modes",
    r"\bc(?:a|o)me out (?:within|up to|too)\b": "is within",
    r"\btakes it that\b": "assumes",
    r"\bwould do\.": "acts like",
    r"\bbe told of\b": "fracid reports them",
    r"\bas far as .{1,20} tell\b": "no autocorrelation in; not distinguishable with these recordings",
    r"\bnot told\b": "not identifiable",
    r"(?<!to )\bknows? (?:nothing )?of\b": "accounts for, allows for, ignores",
    r"\btells? (?:nothing|nearly|ten|more|little)\b": "determines; carries (no) information",
    r"\bheld against\b": "compared with",
    r"\b(?:data|it|page|fit|interval)s? knows?\b": "identifiable; accounts for",
    r"\bnobody (?:recorded|was asked)\b": "unrecorded, unknown",
    r"\bthan all that\b": "than its bounds",
    r"\bshows? with the power\b": "its effect scales with amplitude^p",
    r"\bWhat would decide it:": "To decide:",
    r"\bleaves? noise alone\b": "whose residual is white noise",
    r"\b(?:is|are) few: hold out\b": "is not enough; hold out more",
    r"\bthe same from another side\b": "check by",
    r"\bone experiment more\b": "one more experiment",
    r"\bcame to the lowest\b": "reached the lowest",
    r"\btells it of\b": "describes",
    r"\bThe same of\b": "the same holds for",
    r"\bmake a bias\b": "cause the bias",
    r"\bfrom further out\b": "from a larger angle",
}
"""Phrase → what to write in its place."""
PATTERN = re.compile("|".join(f"(?:{phrase})" for phrase in INSTEAD), re.IGNORECASE)


def phrases(text):
    """Those of the list that a text has, with the words around and what to write."""
    flat = re.sub(r"\s+", " ", text)
    for m in PATTERN.finditer(flat):
        better = next(b for phrase, b in INSTEAD.items() if re.fullmatch(phrase, m.group(), re.IGNORECASE))
        yield f"…{flat[max(0, m.start() - 40) : m.end() + 40]}… write: {better}"


@cache
def messages(path):
    """The strings of a module that may be printed: docstrings only of commands, whose help they are; no keys."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    statements = (n.value for n in ast.walk(tree) if isinstance(n, ast.Expr))
    docstrings = {id(value) for value in statements if isinstance(value, ast.Constant)} - {
        id(f.body[0].value)
        for f in ast.walk(tree)
        if isinstance(f, ast.FunctionDef) and f.decorator_list and path.parent.name == "cli"
        if isinstance(f.body[0], ast.Expr)
    }
    strings = (n for n in ast.walk(tree) if isinstance(n, ast.Constant) and isinstance(n.value, str))
    return [n.value for n in strings if " " in n.value.strip() and id(n) not in docstrings]


def public_docstrings():
    for name in fracid.__all__:
        thing = getattr(fracid, name)
        yield name, inspect.getdoc(thing)
        for member, value in vars(thing).items() if inspect.isclass(thing) else ():
            if not member.startswith("_") and (callable(value) or isinstance(value, property)):
                yield f"{name}.{member}", value.__doc__


@pytest.mark.parametrize("page", PAGES)
def test_a_page_has_no_phrase_of_the_list(page):
    prose = re.sub(r"`[^`\n]+`", "`code`", (ROOT / page).read_text(encoding="utf-8"))
    assert [*phrases(prose)] == []


@pytest.mark.parametrize("notebook", sorted(ROOT.glob("examples/*.ipynb")), ids=lambda path: path.name)
def test_a_notebook_has_no_phrase_of_the_list(notebook):
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    prose = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown"]
    assert [p for text in prose for p in phrases(re.sub(r"`[^`\n]+`", "`code`", text))] == []


TABLES = [*SOURCE.rglob("*.toml"), *(ROOT / "examples").rglob("*.toml"), *(ROOT / "examples").rglob("*.py")]


@pytest.mark.parametrize("words", sorted(TABLES), ids=lambda path: path.stem)
def test_the_words_of_results_and_the_examples_have_no_phrase_of_the_list(words):
    assert [*phrases(words.read_text(encoding="utf-8").replace("\\\n", ""))] == []


@pytest.mark.broad
def test_messages_and_help_have_no_phrase_of_the_list():
    found = [f"{m.relative_to(ROOT)}: {p}" for m in SOURCE.rglob("*.py") for text in messages(m) for p in phrases(text)]
    assert found == []


@pytest.mark.broad
def test_what_the_benchmarks_print_has_no_phrase_of_the_list():
    texts = ((m.name, re.sub(r"`[^`]+`", "`code`", text)) for m in ROOT.glob("benchmarks/*.py") for text in messages(m))
    assert [f"{name}: {p}" for name, text in texts for p in phrases(text)] == []


@pytest.mark.parametrize("template", sorted((SOURCE / "report").glob("*.html.j2")), ids=lambda path: path.name)
def test_a_page_of_results_has_no_phrase_of_the_list(template):
    assert [*phrases(template.read_text(encoding="utf-8"))] == []


def test_docstrings_and_comments_of_the_source_have_none_of_the_worst_phrases():
    worst = re.compile(
        r"hangs? together|holds? the truths?\b|turned round|gone on with|\bcut short|asks nobody|\bbe it\b"
    )
    found = [f"{m.relative_to(ROOT)}: {w}" for m in SOURCE.rglob("*.py") for w in worst.findall(m.read_text("utf-8"))]
    assert found == []


def test_public_docstrings_have_no_phrase_of_the_list():
    prose = ((name, re.sub(r"^\w+ : .*$", "", text or "", flags=re.MULTILINE)) for name, text in public_docstrings())
    assert [f"{name}: {p}" for name, text in prose for p in phrases(text)] == []


def test_a_public_docstring_begins_with_what_it_is_not_with_of():
    assert [name for name, text in public_docstrings() if (text or "").startswith("Of ")] == []


def test_a_help_text_begins_with_what_it_does_not_with_of():
    commands = tomllib.loads((SOURCE / "cli" / "commands.toml").read_text(encoding="utf-8"))
    helps = [words["help"] for options in commands.values() for words in options.values() if "help" in words]
    assert len(helps) > 100
    assert [text for text in helps if text.startswith("Of ")] == []


@pytest.mark.parametrize(
    "text", ["What is left\nover", "the intervals hold the truth", "It cannot be told from a spring."]
)
def test_a_phrase_is_found_over_the_end_of_a_line_too(text):
    assert len([*phrases(text)]) == 1
