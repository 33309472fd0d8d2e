"""The words of results: each is said somewhere, and the numbers that a sentence names are those that it gets."""

import ast
import tomllib
from collections import defaultdict
from string import Formatter

import pytest

from sources import PACKAGE, nodes

OWN = {"where", "number", "limit"}
"""What the words of a finding have besides what is given."""


def named(text):
    """The values that a template takes, those within its formats too."""
    for _, field, form, _ in Formatter().parse(text):
        if field is not None:
            yield field.split(".")[0].split("[")[0]
            yield from named(form)


def is_said(node):
    """Whether it is SAYS, or a method of it."""
    return "SAYS" in (getattr(node, "id", ""), getattr(getattr(node, "value", None), "id", ""))


def constants(node):
    """The texts that an expression may be; none where it is put together."""
    match node:
        case ast.Constant(value=str(text)):
            return [text]
        case ast.IfExp(body=one, orelse=other):
            return [*constants(one), *constants(other)]
    return []


def file_of(tree):
    """The file of words of a module, its own or that of the module whose SAYS it imports; None without any."""
    for node in tree:
        match node:
            case ast.Assign(targets=[target], value=ast.Call(args=[ast.Constant(value=file)])) if is_said(target):
                return file
            case ast.ImportFrom(module=str(module)) if any(alias.name == "SAYS" for alias in node.names):
                place = module.removeprefix("fracid.").replace(".", "/")
                return file_of(nodes()[f"{place}.py" if f"{place}.py" in nodes() else f"{place}/__init__.py"])
    return None


def said():
    """File of words → name → what each call gives it; and the files of which a name is put together."""
    calls, open_ = defaultdict(lambda: defaultdict(list)), set()
    for tree in nodes().values():
        file = file_of(tree)
        for node in tree if file else ():
            match node:
                case ast.Call(func=ast.Name() | ast.Attribute() as what, args=[name, *_]) if is_said(what):
                    open_ |= set() if constants(name) else {file}
                    for text in (names := constants(name)):
                        calls[file][text].append(({k.arg for k in node.keywords}, len(names) == 1))
    return calls, open_


@pytest.fixture(scope="module")
def words():
    """What is called and open, and each file's sentences."""
    calls, open_ = said()
    return calls, open_, {file: tomllib.loads((PACKAGE / file).read_text(encoding="utf-8")) for file in calls}


def test_a_sentence_gets_the_values_that_it_names_and_no_others(words):
    calls, _, files = words
    for file, name, given, alone in ((f, n, *call) for f, names in calls.items() for n in names for call in names[n]):
        entry = files[file][name]
        texts = entry.values() if isinstance(entry, dict) else [entry]
        fields = {field for text in texts for field in named(text)}
        # of two sentences one may need less than the other
        assert (name, fields - OWN - given, given - fields if alone else set()) == (name, set(), set()), file


def test_every_sentence_is_said(words):
    calls, open_, files = words
    assert {file: unsaid for file in {*calls} - open_ if (unsaid := {*files[file]} - {*calls[file]})} == {}
