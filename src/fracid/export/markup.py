"""Files from templates: XML, escaped and well-formed, and programs, with numbers to the last bit."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from functools import cache
from typing import Any
from xml.etree import ElementTree

import numpy as np
from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup
from numpy.typing import ArrayLike

from fracid._version import __version__
from fracid.safety.door import own_text
from fracid.safety.text import one_line
from fracid.solver.schemes import OPEN, SLACK
from fracid.units import with_time_unit


def xml(template: str, **words: Any) -> str:
    """Fill in a template of Jinja.

    Parameters
    ----------
    template : str
        A file beside this one.
    **words
        What it mentions: numbers are written in full, tuples of them with twelve digits and spaces between.

    Examples
    --------
    >>> print(xml("build.xml.in", model=type("Model", (), {"identifier": "rig"})).splitlines()[1])
      <BuildConfiguration modelIdentifier="rig">
    """
    jinja = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, finalize=_written)
    # a comment has no two hyphens, and nothing in it is escaped
    jinja.filters |= {"one_line": one_line, "comment": lambda text: Markup(re.sub("-(?=-)", "- ", one_line(text)))}
    text = jinja.from_string(own_text(f"export/{template}")).render(words)
    reader = ElementTree.XMLParser(target=ElementTree.TreeBuilder(insert_comments=True))
    root = ElementTree.fromstring(text, reader)
    for element in root.iter():  # the template's own line breaks would keep an empty element open
        element.text = element.text if element.text and element.text.strip() else None
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _written(value: Any) -> Any:
    if isinstance(value, tuple):
        return " ".join(f"{float(v):.12g}" for v in value)
    return repr(value) if isinstance(value, float) else value


def initialiser(values: ArrayLike) -> str:
    """Numbers as C takes them, to the last bit, five a line.

    Examples
    --------
    >>> initialiser([0.1, 2.0])
    '{0.1, 2.0}'
    """
    array = np.asarray(values)
    if array.ndim == 0:
        return "INFINITY" if np.isinf(array) else repr(array.item())
    if array.ndim > 1:
        return "{" + ",\n    ".join(initialiser(part) for part in array) + "}"
    return "{" + _lines(array.tolist(), 5, "") + "}"


def literal(values: ArrayLike) -> str:
    """A matrix as MATLAB reads it, to the last bit, six numbers a line.

    Examples
    --------
    >>> literal([0.1, 2.0])
    '[0.1, 2.0]'
    """
    matrix = np.atleast_2d(np.asarray(values))
    if matrix.size == 0:
        return "zeros({}, {})".format(*matrix.shape)
    return "[" + "; ...\n    ".join(_lines(row, 6, " ...") for row in matrix.tolist()) + "]"


def _lines(values: list[Any], each: int, ending: str) -> str:
    """Numbers with commas between, so many a line."""
    words = [repr(v) for v in values]
    return f",{ending}\n    ".join(", ".join(words[i : i + each]) for i in range(0, len(words), each))


def c_comment(text: str) -> str:
    """On one line, and nothing in it that ends a comment.

    Examples
    --------
    >>> c_comment("a */ b")
    'a * / b'
    """
    return one_line(text).replace("*/", "* /").replace("/*", "/ *").replace("\\", "/")


def _named(names: Iterable[str], units: Mapping[str, str]) -> str:
    """Names with their units."""
    return ", ".join(f"{n} [{units.get(n) or 1}]" for n in names)


@cache
def _programs() -> Environment:
    """``${…}`` is a value, in C and MATLAB as it says: ``${x | c}``; lines of ``{% … %}`` choose and repeat."""
    jinja = Environment(variable_start_string="${", variable_end_string="}", undefined=StrictUndefined,
                        trim_blocks=True, keep_trailing_newline=True, loader=FunctionLoader(own_text))  # fmt: skip
    jinja.filters |= {"c": initialiser, "m": literal, "json": json.dumps, "comment": c_comment, "one_line": one_line,
                      "duration": with_time_unit}  # fmt: skip
    jinja.globals |= {"named": _named, "version": __version__, "slack": SLACK, "open": OPEN}
    return jinja


def program(template: str, **words: Any) -> str:
    """Fill in a template of a program, given as its text.

    Examples
    --------
    >>> program("double a[] = ${a | c};", a=[0.1, 2.0])
    'double a[] = {0.1, 2.0};'
    """
    return _programs().from_string(template).render(words)
