"""What every module says of itself on its first screen, every figure, and where the docstrings' links lead.

The sections take the place of the line ``<!-- modules -->`` in reference/modules.md, the functions of
:mod:`fracid.plots` that of ``<!-- figures -->`` in reference/figures.md.  A docstring may name what is not public:
``:func:`fracid.estimation.horizons.growing```; such a link leads to the section of its module.  One that names
nothing is an error.
"""

import importlib
import inspect
import pkgutil

from docutils import nodes

PAGE = "reference/modules"
MODULES, FIGURES = "<!-- modules -->", "<!-- figures -->"


def names():
    """Return every module of the package that is not private, in alphabetical order."""
    import fracid

    found = [module.name for module in pkgutil.walk_packages(fracid.__path__, "fracid.")]
    return sorted(name for name in found if not any(part.startswith("_") for part in name.split(".")))


def _section(name):
    return f"({_anchor(name)})=\n## {name}\n\n```{{eval-rst}}\n.. automodule:: {name}\n   :no-index:\n```"


def _anchor(module):
    return nodes.make_id(f"module-{module}")


def figures():
    """Return the names of all functions that draw or write figures."""
    import fracid.plots

    return [name for name, _ in inspect.getmembers(fracid.plots, inspect.isfunction)]


def _figure(name):
    return f"```{{eval-rst}}\n.. autofunction:: fracid.plots.{name}\n```"


def _read(app, _page, source):
    for place, parts, section in ((MODULES, names, _section), (FIGURES, figures, _figure)):
        if place in source[0]:
            app.env.note_reread()
            source[0] = source[0].replace(place, "\n\n".join(section(part) for part in parts()))


def home_of(target, module=None):
    """Return where a docstring's target lives: a public name's own, or its module's; None where there is no such thing.

    >>> home_of("fracid.tasks.tasks.run_tasks")
    'fracid.run_tasks'
    >>> home_of("fracid.estimation.horizons.growing")
    'fracid.estimation.horizons'
    """
    import fracid

    places = [target, *(f"{m}.{target}" for m in ([module] if module else []) + names() if m)]
    for place in places:
        parts = place.split(".")
        for cut in range(len(parts), 0, -1):
            home = ".".join(parts[:cut])
            if home not in names() and home != "fracid":
                continue
            thing, rest = importlib.import_module(home), parts[cut:]
            if not _leads(thing, rest):
                break
            if rest and rest[0] in fracid.__all__ and getattr(fracid, rest[0]) is getattr(thing, rest[0]):
                return ".".join(["fracid", *rest])
            return home
    return None


def _leads(thing, rest):
    for name in rest:
        if not hasattr(thing, name) and name not in getattr(thing, "__annotations__", {}):
            return False
        thing = getattr(thing, name, None)
    return True


def _missing(app, env, node, content):
    if "refwarn" not in node:  # no role of a docstring but a word in a signature: NDArray
        return content
    home = home_of(node["reftarget"], node.get("py:module")) if node.get("refdomain") == "py" else None
    if home is None:
        return None
    entry = None if node["reftype"] == "mod" else env.get_domain("py").objects.get(home)
    page, anchor = (entry.docname, entry.node_id) if entry else (PAGE, _anchor(home))
    uri = app.builder.get_relative_uri(node["refdoc"], page)
    return nodes.reference("", "", content, internal=True, refuri=f"{uri}#{anchor}")


def setup(app):
    """Fill the page when it is read, and resolve what Sphinx cannot."""
    app.connect("source-read", _read)
    app.connect("missing-reference", _missing)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
