"""The architecture holds: packages import downwards only, no file is in a circle, names are nouns of their own."""

import ast
import subprocess
import sys
from functools import cache
from inspect import getmembers, isfunction
from itertools import chain, pairwise

import pytest

import fracid
from sources import PACKAGE, nodes

LAYERS = (
    {"_version", "errors", "units"},
    {"arrays"},
    {"figures", "qr", "quantiles"},
    {"arrowhead"},
    {"safety"},
    {"cards", "schemas", "words"},
    {"findings", "signals", "tasks"},
    {"models", "optimise", "recording"},
    {"solver"},
    {"problem"},
    {"regression", "twins"},
    {"estimation"},
    {"bayes"},
    {"selection"},
    {"validation"},
    {"fit"},
    {"identification"},
    {"filtering", "plots", "runs"},
    {"experiments", "export"},
    {"feedback"},
    {"report"},
    {"workflows"},
    {"cli"},
)
"""From the ground up: a file imports from its own package and from rows above its package's.  ARCHITECTURE.md draws it.

Every import counts: those for type checkers, those within functions, those of ``plot``.
"""

ROW = {name: row for row, names in enumerate(LAYERS) for name in names}

MODULES = {
    ".".join(path.relative_to(PACKAGE).with_suffix("").parts).removesuffix("__init__").rstrip("."): path
    for path in sorted(PACKAGE.rglob("*.py"))
}
"""Dotted name within fracid → file; "" is fracid itself."""


def imports(nodes):
    """Names of fracid's own modules that a file with these nodes imports, anywhere in it."""
    for node in nodes:
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "fracid":
            base = node.module.removeprefix("fracid").lstrip(".")
            for alias in node.names:
                inner = f"{base}.{alias.name}".lstrip(".")
                yield inner if inner in MODULES else base
        elif isinstance(node, ast.Import):
            yield from (a.name.removeprefix("fracid.") for a in node.names if a.name.startswith("fracid."))


BELOW = [name for name in MODULES if name not in ("", "__main__")]


@cache
def graph():
    """Module → the modules that it imports."""
    return {
        name: set(imports(nodes()[path.relative_to(PACKAGE).as_posix()])) - {name} for name, path in MODULES.items()
    }


def first(name):
    return name.split(".")[0]


def test_every_package_has_its_row():
    assert {first(name) for name in BELOW} == set(ROW)


def misplaced(graph):
    """What a module imports that stands neither in its own package nor in a row above; fracid itself is everyone's."""
    return [(name, other) for name in BELOW for other in sorted(graph[name])
            if not other or not (first(other) == first(name) or ROW[first(other)] < ROW[first(name)])]  # fmt: skip


def test_a_module_imports_only_from_its_own_package_and_from_rows_above():
    wrong = {"solver.solve": {"fit", ""}, "fit": {"solver.solve"}, "solver.history": {"solver.solve"}}
    assert misplaced({name: wrong.get(name, set()) for name in BELOW}) == [
        ("solver.solve", ""),
        ("solver.solve", "fit"),
    ]
    assert misplaced(graph()) == []


def circles(graph):
    """Sets of two or more files that import each other in a circle, by Tarjan's algorithm."""
    index, low, stack, found = {}, {}, [], []

    def visit(node):
        index[node] = low[node] = len(index)
        stack.append(node)
        for other in graph.get(node, ()):
            if other not in index:
                visit(other)
            low[node] = min(low[node], low[other] if other in stack else low[node])
        if low[node] == index[node]:
            circle = stack[stack.index(node) :]
            del stack[stack.index(node) :]
            if len(circle) > 1:
                found.append(sorted(circle))

    for node in graph:
        if node not in index:
            visit(node)
    return found


def test_no_two_files_import_each_other_in_a_circle():
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}}) == [["a", "b", "c"]]
    assert circles(graph()) == []


def test_no_module_is_called_like_a_public_function():
    functions = {name for name in fracid.__all__ if not name[0].isupper()}
    assert {name.rpartition(".")[2] for name in BELOW} & functions == set()


def test_few_files_lie_flat_in_the_package():
    assert len(list(PACKAGE.glob("*.py"))) <= 16


def test_the_array_type_is_defined_once():
    defined = [n for n, path in MODULES.items() if "= NDArray[np.float64]\n" in path.read_text(encoding="utf-8")]
    assert defined == ["arrays"]


@pytest.mark.parametrize("heavy", ["numba", "matplotlib", "pymoo", "statsmodels", "h5py", "pandas"])
def test_the_ground_layers_import_nothing_heavy(heavy):
    ground = ", ".join(f"fracid.{name}" for name in sorted(set().union(*LAYERS[:4])))
    code = f"import sys, {ground}; sys.exit({heavy!r} in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_the_public_names_are_sorted_and_all_there():
    assert list(fracid.__all__) == sorted(fracid.__all__)
    assert all(a != b for a, b in pairwise(fracid.__all__))
    for name in fracid.__all__:
        assert getattr(fracid, name) is not None


def test_every_figure_that_a_result_draws_is_there():
    from fracid import plots

    named = set()
    for node in chain.from_iterable(nodes().values()):
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "draw" and node.args:
            named |= {c.value for c in ast.walk(node.args[0]) if isinstance(c, ast.Constant)}
    assert "rig_drawing" in named
    assert named - {None} <= set(dict(getmembers(plots, isfunction))) - {"save"}


def test_a_misspelt_public_name_is_told_with_those_there_are():
    with pytest.raises(AttributeError, match=r"no attribute 'solve_ode'; it has .*solve_fde"):
        _ = fracid.solve_ode
