"""The documentation as a site: ``make docs`` writes it to site/, which opens from files and asks nobody for anything.

Sphinx, since the docstrings are reStructuredText already, and their links are then checked with those of the pages; the
pages are plain Markdown (MyST), readable where they lie.  Formulas become MathML while the site is built, so that it
needs no script for them.  What is particular to this site is in ``_site/``: formulas, the references of commands and
modules, docstrings, links out of docs/, and a look at the finished pages for what would be fetched from elsewhere.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_site"))

import fracid

project = "fracid"
author = "the authors of fracid"
copyright = "the authors of fracid; MIT licence"
version = release = fracid.__version__

extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx_copybutton",
    "accessible",  # these eleven are in _site/
    "commands",
    "docstrings",
    "excerpts",
    "library",
    "live_report",
    "mathml",
    "modules",
    "numerals",
    "offline",
    "outside",
]
exclude_patterns = ["_site", "images"]
nitpicky = True  # a role in a docstring that leads nowhere is an error, as a dead link is
show_warning_types = True
smartquotes = (
    False  # -- is the beginning of an option, and ' a mark of seconds
)

# --- pages ---
myst_enable_extensions = ["dollarmath", "attrs_inline"]
myst_heading_anchors = 4
myst_dmath_double_inline = True
suppress_warnings = [
    "myst.header"
]  # pages begin with one title, but tables of measured figures may skip a level

# --- reference ---
autodoc_member_order = "bysource"
autodoc_typehints = "description"  # of fields; the parameters' own lines say their types, with shapes and units
autodoc_typehints_description_target = "documented"
autodoc_type_aliases = {
    "FloatArray": "ndarray",
    "Array": "ndarray",
    "ArrayLike": "array_like",
}
autodoc_preserve_defaults = True
autodoc_class_signature = "mixed"
numpydoc_show_class_members = False  # they follow by themselves
add_module_names = False
python_use_unqualified_type_names = True
toc_object_entries_show_parents = "hide"

# --- looks ---
html_theme = "furo"
html_title = "fracid"
html_static_path = ["_site/static"]
html_css_files = ["site.css"]
html_js_files = ["site.js"]
html_copy_source = False
html_show_search_summary = (
    True  # from _site/excerpts.py: no browser fetches a page from files
)
html_logo = html_favicon = "_site/static/logo.svg"
copybutton_prompt_text = r">>> |\.\.\. |\$ "  # what is typed, without the prompt and what was answered
copybutton_prompt_is_regexp = True
html_show_sphinx = False
pygments_style = "a11y-high-contrast-light"  # of accessible-pygments, which comes with the theme
pygments_dark_style = "a11y-high-contrast-dark"
