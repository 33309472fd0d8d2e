"""The pages that list keys have each of them, with its default, and none that is not there."""

import re
import tomllib
from dataclasses import MISSING, fields
from pathlib import Path

import pytest

from fracid import project, rotary_pendulum
from fracid.costs import COSTS
from fracid.models import MODELS, RIGS
from fracid.optimise import OPTIMISERS
from fracid.project import PRESETS
from fracid.recording import Channel
from fracid.recording.channel import UNITS
from fracid.recording.record import SECONDS
from fracid.simulate import METHODS

DOCS = Path(__file__).parent.parent / "docs"
PROJECT_FILE = (DOCS / "project-file.md").read_text(encoding="utf-8")


def tables(text):
    """The rows of each table below each heading, {heading: [[cells], …]}, the tables' own headings left out."""
    found, heading = {}, ""
    for line in text.splitlines():
        if line.startswith("#"):
            heading = line.lstrip("# ").replace("`", "")
        elif line.startswith("|") and not line.startswith("|--"):
            cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
            found.setdefault(heading, []).append(cells)
    return found


ROWS = tables(PROJECT_FILE)


def listed(heading):
    """{key: default} of the tables below a heading; those whose second cell is a kind."""
    rows = [row for row in ROWS[heading] if len(row) == 4 and row[0] != "key"]
    return {row[0].strip("`"): row[2] for row in rows}


def written(default):
    """A default as the page writes it."""
    if default is None:
        return "none"
    if default in ({}, []) or isinstance(default, project._Table):
        return "empty"
    if isinstance(default, bool):
        return f"`{str(default).lower()}`"
    return f'`"{default}"`' if isinstance(default, str) else f"`{default!r}`"


def defaults_of(schema):
    """{key: default as written} of a table of the file."""
    return {
        (field.alias or name): "—" if field.is_required() else written(field.default)
        for name, field in schema.model_fields.items()
    }


@pytest.mark.parametrize(
    ("heading", "schemas"),
    [
        ("Values", (project._Range, project._Prior)),
        ("[model]", (project._Model,)),
        ("[[recording]]", (project._Recording,)),
        ("[fit]", (project._Fit,)),
    ],
)
def test_the_page_of_the_project_file_has_every_key_with_its_default(heading, schemas):
    assert listed(heading) == {key: default for schema in schemas for key, default in defaults_of(schema).items()}


def test_the_tables_of_the_file_are_the_headings_of_the_page():
    assert set(project._File.model_fields) == {"model", "recording", "fit"}
    assert {"[model]", "[model.parameters]", "[[recording]]", "[fit]"} <= set(ROWS)


def test_the_page_of_the_project_file_has_every_field_of_a_signal():
    expected = {f.name: "—" if f.default is MISSING else written(f.default) for f in fields(Channel)}
    assert listed("A signal") == expected


def test_the_page_of_the_project_file_has_every_parameter_of_the_pendulum():
    rows = {row[0].strip("`"): row[1:3] for row in ROWS["[model.parameters]"][1:]}
    parameters = rotary_pendulum("srv02-rotpen").parameters
    assert rows == {p.name: [p.unit, f"{p.value:.6g}"] for p in parameters}


def meaning(heading, key):
    return next(row[-1] for row in ROWS[heading] if row[0] == f"`{key}`")


@pytest.mark.parametrize(
    ("heading", "key", "choices"),
    [
        ("[model]", "rig", RIGS),
        ("[fit]", "cost", COSTS),
        ("[fit]", "method", METHODS),
        ("[fit]", "optimiser", OPTIMISERS),
        ("[fit]", "preset", PRESETS["paper"]),
        ("A signal", "unit", UNITS),
        ("The clock", "unit", SECONDS),
    ],
)
def test_what_a_key_may_say_is_all_on_the_page(heading, key, choices):
    assert [choice for choice in choices if f"`{choice}`" not in meaning(heading, key)] == []


def test_the_models_defaults_are_those_that_the_page_says():
    model = MODELS["rotary-pendulum"]()
    assert model.zero == "hanging"
    assert model.inputs == ("voltage",)
    assert model.order_names == ("lambda", "mu")
    assert "`srv02-rotpen` if left out" in meaning("[model]", "rig")
    assert model.parameters == rotary_pendulum("srv02-rotpen").parameters
    assert (project.ORDER_RANGE.start, project.ORDER_RANGE.lower, project.ORDER_RANGE.upper) == (1.0, 0.5, 1.2)
    assert "from 1.0 in 0.5 … 1.2" in PROJECT_FILE


def test_the_example_of_the_page_is_a_project_file():
    example = re.search(r"```toml\n(.*?)```", PROJECT_FILE, re.DOTALL)[1]
    said = project._File.model_validate(tomllib.loads(example))
    assert said.model.orders["mu"] == "lambda"
