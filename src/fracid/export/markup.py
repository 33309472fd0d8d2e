"""Files of XML from templates: numbers to the last bit, all text escaped, and what comes out is well-formed."""

from __future__ import annotations

import re
from typing import Any
from xml.etree import ElementTree

from markupsafe import Markup

from fracid.safety.door import own_text
from fracid.safety.text import one_line


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
    from jinja2 import Environment, StrictUndefined

    jinja = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, finalize=_written)
    jinja.filters |= {"one_line": one_line, "comment": _comment}
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


def _comment(text: str) -> Markup:
    """What a comment of XML can hold, in which nothing is escaped."""
    return Markup(re.sub("-(?=-)", "- ", one_line(text)))
