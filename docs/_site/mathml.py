"""Formulas as MathML, made while the site is built: browsers draw it themselves, with no script."""

from math_core import LatexError, LatexToMathML

CONVERTER = LatexToMathML(fancy_error=False)


def to_mathml(latex, display):
    """Return the MathML of a formula.

    Raises
    ------
    LatexError
        If it cannot be read.
    """
    latex = latex.strip()
    if display and r"\tag" in latex:
        latex = rf"\begin{{equation}}{latex}\end{{equation}}"
    elif display and r"\begin" not in latex and ("&" in latex or r"\\" in latex):  # as Sphinx has it: lines, aligned
        latex = rf"\begin{{aligned}}{latex}\end{{aligned}}"
    return CONVERTER.convert_with_local_state(latex, displaystyle=display)


def _told(node, display):
    from sphinx.util.logging import getLogger

    try:
        return to_mathml(node.astext(), display)
    except LatexError as error:
        getLogger(__name__).warning("formula %s: %s", node.astext(), error, location=node)
        return ""


def _inline(writer, node):
    from docutils.nodes import SkipNode

    writer.body.append(_told(node, display=False))
    raise SkipNode


def _block(writer, node):
    from docutils.nodes import SkipNode

    writer.body.append(f'<div class="math">{_told(node, display=True)}</div>')
    raise SkipNode


def setup(app):
    """Draw formulas by these two."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    app.config.html_math_renderer = "mathml"
    return {"parallel_read_safe": True, "parallel_write_safe": True}
