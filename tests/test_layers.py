"""The layers hold: a module imports only from rows above its own."""

import ast
import sys
from itertools import pairwise
from pathlib import Path

import pytest

import fracid

PACKAGE = Path(fracid.__file__).parent

LAYERS = (
    {"errors", "units"},
    {"shape"},
    {"findings", "foreign", "journal", "memo", "mistaken", "own_code", "pictures", "style", "surroundings", "triangle"},
    {"fractional", "recording", "costs", "models", "optimise"},
    {"compiling", "executor", "same_code"},
    {"memory"},
    {"history", "starting"},
    {"stepping", "trajectory"},
    {"right_hand_side", "stiffness"},
    {"simulate"},
    {"batch", "problem", "reduction"},
    {"draft", "portable", "project"},
    {"uncertainty", "regression"},
    {"criteria", "profiles"},
    {"bootstrap", "diagnostics", "residuals"},
    {"search"},
    {"misread", "projection"},
    {"alternative", "cut", "honesty"},
    {"ladder"},
    {"identify"},
    {"runs", "saved"},
    {"plots", "reproduction"},
    {"amplitude", "export", "studies"},
    {"compare", "twin_recording"},
    {"report"},
    {"cli"},
)
"""From the ground up.  A package counts as one module; `fracid` itself and `__main__` stand outside."""

ROW = {name: row for row, names in enumerate(LAYERS) for name in names}


def home(path):
    """The layer's name that a file belongs to: ``recording/table.py`` → ``recording``."""
    first = path.relative_to(PACKAGE).parts[0]
    return first.removesuffix(".py")


def imports(path):
    """Names of fracid's own modules that a file imports, those for type checkers only left out."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            node.body = []
        if isinstance(node, ast.FunctionDef) and node.name.startswith("plot"):
            node.body = []  # drawing itself is a convenience: what stands above is imported when it is called
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "fracid":
            parts = node.module.split(".")
            yield from [parts[1]] if len(parts) > 1 else [alias.name for alias in node.names]
        elif isinstance(node, ast.Import):
            yield from (a.name.split(".")[1] for a in node.names if a.name.startswith("fracid."))


FILES = [p for p in sorted(PACKAGE.rglob("*.py")) if home(p) not in ("__init__", "__main__")]


def test_every_module_has_its_place():
    assert {home(path) for path in FILES} == set(ROW)


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_a_module_imports_only_from_rows_above(path):
    own = home(path)
    for name in imports(path):
        if name in ROW and name != own:
            assert ROW[name] < ROW[own], f"{own} (row {ROW[own]}) imports {name} (row {ROW[name]})"


@pytest.mark.parametrize("heavy", ["numba", "matplotlib", "pymoo", "statsmodels", "h5py", "pandas"])
def test_the_ground_layers_import_nothing_heavy(heavy):
    import subprocess

    ground = ", ".join(f"fracid.{name}" for name in sorted(set().union(*LAYERS[:3])))
    code = f"import sys, {ground}; sys.exit({heavy!r} in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_the_public_names_are_sorted_and_all_there():
    assert list(fracid.__all__) == sorted(fracid.__all__)
    assert all(a != b for a, b in pairwise(fracid.__all__))
    for name in fracid.__all__:
        assert getattr(fracid, name) is not None


def test_importing_a_module_does_not_hide_the_function_of_its_name():
    import fracid.identify
    import fracid.simulate

    assert callable(fracid.simulate)
    assert callable(fracid.identify)


def test_a_misspelt_public_name_is_told_with_those_there_are():
    with pytest.raises(AttributeError, match=r"no attribute 'solve_ode'; it has .*solve_fde"):
        _ = fracid.solve_ode
