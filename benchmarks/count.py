"""Lines of code of `src/fracid` and of `tests`: without blank lines, comments, docstrings and imports.  `make count`"""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def code_lines(source: str) -> int:
    """How many lines of a module are code.

    Examples
    --------
    >>> code_lines("import math\\n\\n# the unit circle\\nTURN = 2 * math.pi\\n\\"\\"\\"Of an angle [rad].\\"\\"\\"\\n")
    1
    """
    passed_over = set(_told_or_imported(ast.parse(source)))
    lines = enumerate(source.splitlines(), 1)
    return sum(n not in passed_over and not line.lstrip().startswith("#") for n, line in lines if line.strip())


def _told_or_imported(tree: ast.Module) -> Iterator[int]:
    """The lines of docstrings, those under a field too, and of imports."""
    for node in ast.walk(tree):
        match node:
            case ast.Import() | ast.ImportFrom() | ast.Expr(value=ast.Constant(value=str())):
                yield from range(node.lineno, (node.end_lineno or node.lineno) + 1)


def main(folders: list[str]) -> None:
    for folder in folders or ["src/fracid", "tests"]:
        files = sorted((ROOT / folder).rglob("*.py"))
        total = sum(code_lines(file.read_text(encoding="utf-8")) for file in files)
        print(f"{folder}: {total:,} lines of code in {len(files)} files")


if __name__ == "__main__":
    main(sys.argv[1:])
