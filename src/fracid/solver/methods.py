"""The methods: a row for each stepping scheme."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from fracid.arrays import FloatArray
from fracid.solver.run import Run
from fracid.solver.schemes import step_gl, step_gl_sequential, step_pi2

__all__ = ["METHODS", "Method"]


@dataclass(frozen=True)
class Method:
    """A stepping scheme."""

    family: str
    """Which kernel it sums with: ``gl``, ``pi`` or ``pi3`` (:mod:`fracid.solver.memory`)."""
    convergence_order: int
    """The error falls as h to this, where f(t, x(t)) is smooth."""
    run: Callable[[Any, Run, FloatArray], tuple[int, int]]
    """(f, the run, out) → (last good index, how it ended); fills out, a row for each sample that is stored."""


METHODS = {
    "pi2": Method("pi", 2, lambda rhs, run, out: step_pi2(rhs, run, False, out)),
    "pi2-implicit": Method("pi", 2, lambda rhs, run, out: step_pi2(rhs, run._replace(corrections=0), False, out)),
    "pi3": Method("pi3", 3, lambda rhs, run, out: step_pi2(rhs, run, True, out)),
    "gl": Method("gl", 1, lambda rhs, run, out: step_gl(rhs, run, False, out)),
    "gl-sequential": Method("gl", 1, step_gl_sequential),
    "gl-paper": Method("gl", 1, lambda rhs, run, out: step_gl(rhs, run, True, out)),
}
