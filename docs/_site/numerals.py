"""Numbers as people write them: 1.2×10⁻⁵ for 1.2e-05, a minus sign for a hyphen.  Code is left as it is."""

import re

SUPERSCRIPT = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
POWER = re.compile(r"(?<![\w.])([-−]?)(\d+(?:\.\d+)?)e([+-]?)0*(\d+)(?![\w.]*\w)")
MINUS = re.compile(r"(?<![\w.)\]’'\"/–-])-(?=\d)")


def written(text):
    """A text with its numbers so written.

    >>> written("it is 7.3e-06 or -0.25, from 1-3 on 2026-01-02, in 1e+05 steps")
    'it is 7.3×10⁻⁶ or −0.25, from 1-3 on 2026-01-02, in 10⁵ steps'
    """
    return MINUS.sub("−", POWER.sub(_power, text))


def _power(match):
    minus, digits, sign, exponent = match.groups()
    power = "10" + ("-" * (sign == "-") + exponent).translate(SUPERSCRIPT)
    return ("−" if minus else "") + (power if digits == "1" else f"{digits}×{power}")


def _rewrite(_, doctree):
    from docutils import nodes
    from sphinx.addnodes import desc_signature

    code = (
        nodes.literal,
        nodes.literal_block,
        nodes.doctest_block,
        nodes.math,
        nodes.math_block,
        nodes.raw,
        desc_signature,
    )
    for text in list(doctree.findall(nodes.Text)):
        parent = text.parent
        while parent is not None and not isinstance(parent, code):
            parent = parent.parent
        if parent is None and (better := written(text.astext())) != text.astext():
            text.parent.replace(text, nodes.Text(better))


def setup(app):
    """Rewrite each page once it is read."""
    app.connect("doctree-read", _rewrite)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
