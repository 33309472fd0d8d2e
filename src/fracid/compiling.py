"""How fracid compiles its loops: with Numba, for one signature each, at the first call, and kept on disk.

Numba compiles a function with a given signature when it is defined.  That is half a minute for all the schemes and
memories, of which a run needs a third; so they are compiled when they are called.  A given signature is needed all
the same: a right-hand side has to come in as a function pointer, or each would have the loops compiled for itself.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, wraps
from pathlib import Path
from typing import Any

import numba as nb
from numba import types

__all__ = ["RHS", "RHS_SIGNATURE", "helper", "when_called"]

helper = nb.njit(nogil=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)
"""For what only compiled functions call: without the wrappers for Python it takes a fifth less time to compile."""

RHS_SIGNATURE = types.void(types.float64, *[types.float64[::1]] * 4)
"""rhs(t, x, u, p, out): the one signature of every right-hand side."""

RHS = types.FunctionType(RHS_SIGNATURE)
"""A pointer to one."""


def when_called(signature: Any) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Compile a function for this signature when it is first called; without the interpreter's lock when it runs.

    Examples
    --------
    >>> from numba import float64
    >>> @when_called(float64(float64))
    ... def double(x):
    ...     return 2 * x
    >>> double(4)
    8.0
    """

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        @cache
        def compiled() -> Callable[..., Any]:
            kept = Path(function.__code__.co_filename).exists()  # on disk: what has a file to be kept beside
            found: Callable[..., Any] = nb.njit(signature, cache=kept, nogil=True, error_model="numpy")(function)
            return found

        @wraps(function)
        def run(*arguments: Any) -> Any:
            return compiled()(*arguments)

        return run

    return decorate
