"""A command parses, makes one call of the library, and prints; the work and the folders are of fracid.workflows."""

import ast
import inspect
from pathlib import Path

import pytest

import fracid
from fracid.cli import app
from fracid.cli.app import WORDS

PACKAGE = Path(fracid.__file__).parent
COMMANDS = sorted((PACKAGE / "cli").glob("*.py"))
WORKFLOWS = sorted((PACKAGE / "workflows").glob("*.py"))

WORK = ("estimation.search", "files", "identification", "plots", "problem.project", "runs.folder", "tasks.journal")
"""What identifies, draws and writes."""

LONGEST = {"demo": 25}
"""Statements of a command that makes more than one call: three fits, and the story around them."""


def imported(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def commands(tree):
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and any(ast.unparse(d) == "command" for d in node.decorator_list):
            yield node


@pytest.mark.parametrize("path", COMMANDS, ids=lambda path: path.stem)
def test_a_command_neither_identifies_nor_draws_nor_writes_but_calls_who_does(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    assert [n for n in imported(tree) if n.startswith(tuple(f"fracid.{name}" for name in WORK))] == []
    for command in commands(tree):
        statements = sum(isinstance(node, ast.stmt) for part in command.body[1:] for node in ast.walk(part))
        assert statements <= LONGEST.get(command.name, 16), f"{command.name} does more than parse, call and print"


def test_every_command_is_looked_at():
    found = {c.name for path in COMMANDS for c in commands(ast.parse(path.read_text(encoding="utf-8")))}
    assert found == set(WORDS) - {"every"}


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_a_workflow_prints_nothing(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    assert {name.split(".")[0] for name in imported(tree)}.isdisjoint({"rich", "sys", "typer"})
    called = {node.func.id for node in ast.walk(tree) if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)}
    assert "print" not in called


def test_the_words_of_an_option_are_those_of_a_parameter():
    takes = {c.callback.__name__: set(inspect.signature(c.callback).parameters) for c in app.registered_commands}
    every = set(WORDS["every"])
    assert {name: set(WORDS[name]) - {"panel", "examples", "options"} - takes[name] for name in takes} == {
        name: set() for name in takes
    }
    assert set(WORDS) == {*takes, "every"}
    assert every <= set().union(*takes.values())
