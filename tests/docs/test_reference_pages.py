"""The pages that list keys have each of them, as the schema and a real result have it, and none that is not there."""

import json
import re
import tomllib
from dataclasses import MISSING, fields
from pathlib import Path
from typing import get_args

import jsonschema
import numpy as np
import pytest

from fracid import Recording, Sensor, rotary_pendulum, save_recording, simulate
from fracid.cli.app import main
from fracid.estimation.parameter_verdicts import Kind
from fracid.estimation.records import in_words
from fracid.findings import Finding
from fracid.identification.result import CHANCE, IMITATION
from fracid.models import MODELS, RIGS, model_from_name
from fracid.optimise import OPTIMISERS, Outcome
from fracid.problem import Tied, project
from fracid.problem.costs import COSTS
from fracid.problem.project import PRESETS
from fracid.recording import UNITS, Channel
from fracid.recording.clock import SECONDS
from fracid.runs.folder import LATER
from fracid.runs.json_schemas import json_schema
from fracid.solver.inputs import BETWEEN
from fracid.solver.methods import METHODS
from program import leave_figures_out

DOCS = Path(__file__).parents[2] / "docs"
PROJECT_FILE = (DOCS / "project-file.md").read_text(encoding="utf-8")


def tables(text):
    """The rows of each table below each heading, {heading: [[cells], …]}, the tables' own headings left out."""
    found, heading = {}, ""
    for line in re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE).splitlines():
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
        ("[[alternative]]", (project._Alternative,)),
        ("[fit]", (project._Fit,)),
    ],
)
def test_the_page_of_the_project_file_has_every_key_with_its_default(heading, schemas):
    assert listed(heading) == {key: default for schema in schemas for key, default in defaults_of(schema).items()}


def test_the_tables_of_the_file_are_the_headings_of_the_page():
    assert set(project._File.model_fields) == {"model", "alternative", "recording", "fit"}
    assert {"[model]", "[model.parameters]", "[[alternative]]", "[[recording]]", "[fit]"} <= set(ROWS)


def test_the_page_of_the_project_file_has_every_field_of_a_signal():
    expected = {f.name: "—" if f.default is MISSING else written(f.default) for f in fields(Channel)}
    assert listed("A signal") == expected


def test_the_page_of_the_project_file_has_everything_that_a_channel_may_do():
    assert listed("What the channel does") == {f.name: written(f.default) for f in fields(Sensor)}


def test_the_page_of_the_project_file_has_every_way_between_samples():
    assert {row[0].strip('`"') for row in ROWS["Between the samples of an input"][1:]} == set(BETWEEN)


def test_the_page_of_the_project_file_has_every_parameter_of_the_pendulum():
    rows = {name.strip("`"): row[1:3] for row in ROWS["[model.parameters]"][1:] for name in row[0].split(", ")}
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
    assert said.model.orders["mu"] == Tied("lambda")


# --- reading the report ---------------------------------------------------------------------------------


READING = (DOCS / "reading-the-report.md").read_text(encoding="utf-8")


def test_every_verdict_is_told_how_to_read():
    told = {row[0] for row in tables(READING)["Verdicts"][1:]}
    assert told == {*map(in_words, get_args(Kind)), "fixed", IMITATION, CHANCE.format(1)}


@pytest.mark.parametrize("outcome", [o for o in Outcome if o not in (Outcome.STOPPED, Outcome.GENERATIONS_DONE)])
def test_every_end_of_a_search_is_told_how_to_read(outcome):
    assert f"*{outcome.value.split(':')[0]}*" in READING


# --- the run folder -----------------------------------------------------------------------------------


RUN_FOLDER = tables((DOCS / "run-folder.md").read_text(encoding="utf-8"))
PROJECT = """
[model]
name = "pendulum.py:model"
[model.orders]
mu = { start = 0.97, lower = 0.6, upper = 1.2 }
[model.parameters]
damping = { start = 0.2, lower = 0.0, upper = 2.0 }
[[recording]]
file = "high.csv"
alpha = "alpha [rad]"
from = 0.3
[[recording]]
file = "low.csv"
alpha = "alpha [rad]"
[[recording]]
name = "held out"
file = "low.csv"
to = 1.0
use = "validate"
alpha = "alpha [rad]"
[fit]
initial_state = "estimate"
starts = 2
"""
OWN_MODEL = """
import math
from fracid.models import Model, Parameter


def rhs(t, x, u, p, out):
    out[0] = x[1]
    out[1] = -40.0 * math.sin(x[0]) - p[0] * x[1] - p[1] * math.tanh(x[1] / 0.05)


model = Model(
    name="pendulum", rhs=rhs, states=("alpha", "rate"), orders=("mu", "mu"), outputs={"alpha": 0}, inputs=(),
    parameters=(Parameter("damping", "1/s", 0.3, "viscous friction"), Parameter("dry", "1/s^2", 0.1, "dry friction")),
    zero="hanging", source="a test",
)
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A run with all that result.json can hold: two recordings and one held out, two starts, the cut's check."""
    made = tmp_path_factory.mktemp("run")
    (made / "pendulum.py").write_text(OWN_MODEL, encoding="utf-8")
    model = model_from_name("pendulum.py:model", folder=made)
    noise = np.random.default_rng(1)
    for name, angle in (("high", 0.8), ("low", 0.4)):
        run = simulate(model, orders={"mu": 0.95}, initial={"alpha": angle}, step=1e-2, end=2.0)
        alpha = run.states[:, 0] + 1e-3 * noise.standard_normal(len(run.states))
        save_recording(Recording.of(name, run.time, {"alpha": alpha}), made / f"{name}.csv")
    (made / "rig.toml").write_text(PROJECT, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:  # without figures: they are the same whatever the model
        leave_figures_out(patch)
        with pytest.raises(SystemExit) as stop:
            main(["fit", str(made / "rig.toml"), "--out", str(made / "run"), "--trust", "--cut", "--json"])
    assert not stop.value.code
    return made / "run"


@pytest.fixture(scope="module")
def result(folder):
    return json.loads((folder / "result.json").read_text(encoding="utf-8"))


def keys_of(heading):
    return {row[0].strip("`") for row in RUN_FOLDER[heading] if len(row) == 2 and row[0] != "key"}


def test_the_page_of_the_run_folder_has_every_key_of_a_result(result):
    assert keys_of("result.json") == set(result)


@pytest.mark.parametrize(
    ("heading", "where"),
    [
        ("An estimate", lambda r: r["orders"]["mu"].keys() - {"integer"}),
        ("An estimate", lambda r: r["parameters"]["dry"]),
        ("An estimate", lambda r: r["recordings"]["high"]["initial_state"]["alpha"]),
        ("A recording", lambda r: r["recordings"]["high"]),
        ("A recording", lambda r: r["recordings"]["held out"]),
        ("Cost", lambda r: r["cost"]),
        ("Discretisation", lambda r: r["discretisation"]),
        ("Alternative", lambda r: r["alternative"]),
        ("A start", lambda r: r["starts"][1]),
        ("Spread", lambda r: r["spread"]),
        ("Cut", lambda r: r["cut"]),
    ],
)
def test_the_page_of_the_run_folder_has_every_key_of_what_a_result_holds(result, heading, where):
    assert keys_of(heading) == set(where(result))


def test_the_page_of_the_run_folder_has_every_key_of_a_finding():
    assert keys_of("A finding") == set(Finding("code", "where", 1.0, 2.0, "s", "A sentence.").to_json())


def test_the_page_of_the_run_folder_names_what_spread_and_cut_hold(result):
    page = (DOCS / "run-folder.md").read_text(encoding="utf-8")
    treatment = next(iter(result["cut"]["treatments"].values()))
    assert [key for key in (*treatment, *result["spread"]["unknowns"]["mu"]) if f"`{key}`" not in page] == []


def test_the_page_of_the_run_folder_names_every_file_of_a_run(folder):
    named = {row[0].strip("`/") for row in RUN_FOLDER["The run folder"] if row[0] != "file"}
    assert {path.name for path in folder.iterdir()} <= named
    assert set(LATER) - {"starts/journal.jsonl"} <= named


def test_a_result_is_of_its_json_schema_and_that_is_the_one_in_the_docs(result):
    schema = json.loads((DOCS / "result.schema.json").read_text(encoding="utf-8"))
    assert schema == json.loads(json_schema()), "type python -m fracid.runs.json_schemas > docs/result.schema.json"
    jsonschema.validate(result, schema)
    assert set(schema["properties"]) == set(result)
    with pytest.raises(jsonschema.ValidationError, match="'high' is not of type"):
        jsonschema.validate(result | {"step": "high"}, schema)


def test_a_result_has_no_number_that_json_has_not(folder):
    def refuse(word):
        raise AssertionError(word)

    json.loads((folder / "result.json").read_text(encoding="utf-8"), parse_constant=refuse)
