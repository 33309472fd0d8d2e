r"""What docstrings may do that reStructuredText does not like, put right in one place while the site is built.

References keep their labels within their docstring alone, though many of them share a page: ``.. [1] Someone`` becomes
an entry of a list, ``[1]_`` plain text.  Bars are absolute values, and no substitutions: ``|e|`` stays ``|e|``.
"""

import inspect
import re

ENTRY = re.compile(r"^(\s*)\.\. \[(\w+)\] ")
CITED = re.compile(r"\[(\w+)\]_")
BARS = re.compile(r"(?<![\\`|])\|(?=\S)([^|`]*?[^\s|`\\])\|(?![|`])")
LITERAL = re.compile(r"(:\w+:`[^`]+`|``[^`]+``|`[^`]+`)")
RULE = re.compile(r"^\s*=+(\s+=+)+\s*$")
FORMULA = (".. math::", ".. code")


def put_right(lines):
    r"""Return the lines of a docstring as reStructuredText that may stand beside other docstrings.

    >>> put_right(["The sum of |e| [F]_.", "", ".. [F] J. Filliben,", "   1975."])
    ['The sum of \\|e\\| [F].', '', '*  [F] J. Filliben,', '   1975.']
    """
    return list(_put_right(lines))


def _put_right(lines):
    formula, in_table = None, False  # the indentation of a formula's block, in which nothing is touched
    for line in lines:
        indentation = len(line) - len(line.lstrip())
        if formula is not None and line.strip() and indentation <= formula:
            formula = None
        if line.lstrip().startswith(FORMULA):
            formula = indentation
        in_table = RULE.match(line) is not None or (in_table and line.strip() != "")
        yield line if formula is not None or line.lstrip().startswith(">>>") else _words(line, "[\\1]" + " " * in_table)


def _words(line, cited):
    """Literals and formulas stay; a citation in a table keeps its width."""
    pieces = LITERAL.split(ENTRY.sub(r"\1*  [\2] ", line))
    return "".join(piece if at % 2 else BARS.sub(r"\|\1\|", CITED.sub(cited, piece)) for at, piece in enumerate(pieces))


def without_sections(lines):
    """Return the lines with each underlined heading as a rubric: many modules share a page, and each has references.

    >>> without_sections(["References", "----------", "Someone."])
    ['.. rubric:: References', '', 'Someone.']
    """
    made = list(lines)
    for at in range(len(made) - 1):
        if made[at].strip() and re.fullmatch(r"-{4,}", made[at + 1]) and len(made[at + 1]) == len(made[at]):
            made[at], made[at + 1] = f".. rubric:: {made[at]}", ""
    return made


def signature_of(record):
    """Return a class's signature; a default that is an object rather than a value is told by dots."""
    signature = inspect.signature(record)
    shown = [p.replace(annotation=p.empty, default=_default(p.default)) for p in signature.parameters.values()]
    return str(signature.replace(parameters=shown, return_annotation=signature.empty))


def _default(value):
    return _Dots() if value is not inspect.Parameter.empty and "<" in repr(value) else value


class _Dots:
    def __repr__(self):
        return "…"


def _signature(_app, what, _name, thing, _options, signature, returned):
    return (signature_of(thing), returned) if what == "class" and signature and "<" in signature else None


def without_objects(doctree):
    """Take the defaults of fields that are objects out of their lines: ``= Cost(name='rmse', weight=<function …>)``."""
    from sphinx.addnodes import desc_annotation

    for shown in [*doctree.findall(desc_annotation)]:
        if shown.astext().startswith(" = ") and "<" in shown.astext():
            shown.parent.remove(shown)


def _read(_app, doctree):
    without_objects(doctree)


def _process(_app, what, _name, _object, _options, lines):
    lines[:] = put_right(without_sections(lines) if what == "module" else lines)


def setup(app):
    """Look at every signature, and at every docstring before numpydoc makes its sections."""
    app.connect("autodoc-process-signature", _signature)
    app.connect("doctree-read", _read)
    app.connect("autodoc-process-docstring", _process, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
