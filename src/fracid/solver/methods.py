"""The methods: a row for each stepping scheme."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from fracid.solver.schemes import step_gl, step_gl_sequential, step_pi2

__all__ = ["METHODS", "Method"]


@dataclass(frozen=True)
class Method:
    """A stepping scheme."""

    family: str
    """Which kernel it sums with: ``gl``, ``pi`` or ``pi3`` (:mod:`fracid.solver.memory`)."""
    convergence_order: int
    """The error falls as h to this, where f(t, x(t)) is smooth."""
    run: Callable[..., tuple[int, int]]
    """(the loops' common arguments, corrections, corrected, out) → (last good index, how it ended)."""


METHODS = {
    "pi2": Method("pi", 2, lambda *run: step_pi2(*run[:-3], False, *run[-3:])),
    "pi2-implicit": Method("pi", 2, lambda *run: step_pi2(*run[:-3], False, 0, *run[-2:])),
    "pi3": Method("pi3", 3, lambda *run: step_pi2(*run[:-3], True, *run[-3:])),
    "gl": Method("gl", 1, lambda *run: step_gl(*run[:-3], False, run[-1])),
    "gl-sequential": Method("gl", 1, lambda *run: step_gl_sequential(*run[:-3], run[-1])),
    "gl-paper": Method("gl", 1, lambda *run: step_gl(*run[:-3], True, run[-1])),
}
