"""fracid's own files as syntax trees, for tests of what they import, call and list.  Read when first asked for."""

import ast
from functools import cache
from pathlib import Path

import fracid

PACKAGE = Path(fracid.__file__).parent


@cache
def nodes():
    """Path within the package → all nodes of that file."""
    return {
        path.relative_to(PACKAGE).as_posix(): list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
        for path in sorted(PACKAGE.rglob("*.py"))
    }
