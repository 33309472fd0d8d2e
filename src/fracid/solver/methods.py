"""The methods: a row of :data:`METHODS` for each stepping scheme.

=================  ======  ===================  ======================================================
method             order   history sum          loop of :mod:`fracid.solver.schemes`
=================  ======  ===================  ======================================================
``pi2``            2       of f, trapezoidal    ``step_pi2``: predictor, corrector sweeps, Newton
``pi2-implicit``   2       of f, trapezoidal    ``step_pi2`` without sweeps: Newton at every step
``pi3``            3       of f, third order    ``step_pi2`` with a parabola for predictor
``gl``             1       of x − x(0)          ``step_gl``
``gl-sequential``  1       of x − x(0)          ``step_gl_sequential``: each state uses those already new
``gl-paper``       1       of x                 ``step_gl`` on raw x, right only for x(0) = 0
=================  ======  ===================  ======================================================

A loop takes f, the :class:`~fracid.solver.run.Run` and the array to fill, and returns the last good index and how the
run ended.  A new method is a loop there and a row here; its convergence order is tested by its row.
"""

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
