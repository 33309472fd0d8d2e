"""A model's equation, once: its right-hand side as a tree, and the tree in other languages.

========================================  ===========================================================================
:mod:`fracid.models.written.reading`      Python → tree: a right-hand side of ours, or a user's
:mod:`fracid.models.written.tree`         the tree: a few kinds of expressions and statements
:mod:`fracid.models.written.languages`    tree → C in double and single precision, MATLAB, JavaScript, Python
:mod:`fracid.models.written.portable`     what those languages lack
:mod:`fracid.models.written.formulas`     a text → tree, by a whitelist
:mod:`fracid.models.written.equations`    equations of a project file → model, and back
:mod:`fracid.models.written.mathematics`  tree → MathML and LaTeX, as people write equations
========================================  ===========================================================================
"""
