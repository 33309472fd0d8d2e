"""Formulas as MathML, made while the site is built: browsers draw it themselves, with no script."""

from latex2mathml.converter import convert


def to_mathml(latex, display):
    """Return the MathML of a formula."""
    return convert(latex.strip(), display="block" if display else "inline")


def _inline(writer, node):
    writer.body.append(to_mathml(node.astext(), display=False))
    raise _done()


def _block(writer, node):
    writer.body.append(f'<div class="math">{to_mathml(node.astext(), display=True)}</div>')
    raise _done()


def _done():
    from docutils.nodes import SkipNode

    return SkipNode()


def setup(app):
    """Draw formulas by these two."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    app.config.html_math_renderer = "mathml"
    return {"parallel_read_safe": True, "parallel_write_safe": True}
