"""The methods: a row for each stepping scheme, and all that fracid knows of it.

A new method is its loop in :mod:`fracid.solver.schemes` and its row in :data:`METHODS`: its name, its title for help
and completion, the memory that it sums with, its order and its limit, and what an exported model steps with all come
from here.  Only weights of another family need more (:mod:`fracid.solver.weights`, :mod:`fracid.solver.starting`).

A loop takes the address of f, the :class:`~fracid.solver.loop_arguments.Run` and the array to fill, and returns the
last good index and how the run ended.

The loops take a second to import, so a row fetches its own when it first runs.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from fracid.arrays import FloatArray
    from fracid.solver.loop_arguments import Run


@dataclass(frozen=True)
class Exported:
    """What the templates of :mod:`fracid.export` must know to step alike."""

    words: str
    """What it is, for the head of a file."""
    newton: bool = False
    """Newton's method at every step, in place of sweeps."""
    last_first: bool = False
    """The last state first, each with those already new."""


@dataclass(frozen=True)
class Method:
    """A stepping scheme."""

    family: str
    """Which kernel it sums with: ``gl``, ``pi``, ``pi3`` or ``bdf`` (:mod:`fracid.solver.memory`)."""
    convergence_order: int
    """The error falls as h to this, where f(t, x(t)) is smooth."""
    run: Callable[[int, Run, FloatArray], tuple[int, int]]
    """(where f is, the run, out) → (last good index, how it ended); fills out, a row for each sample that is stored."""
    title: str
    """What one takes it for, in a phrase."""
    follows: float = math.inf
    """The largest |J|h of :mod:`fracid.solver.stiffness` that it follows; infinite for what solves stiff systems."""
    at_a_jump: Literal["both", "after", "mean"] = "mean"
    """Of an input that jumps at a grid point it takes the values before and after it, that after it, or their mean."""
    sweeps: float = math.inf
    """The |J|h up to which its sweeps contract: a run that ends early beyond it owes that to them, perhaps."""
    started: bool = True
    """Whether :mod:`fracid.solver.starting` begins it."""
    raw: bool = False
    """Whether it sums x itself, which is right only for x(0) = 0."""
    exported: Exported | None = None
    """None for one that cannot be written in another language."""


def _step(loop: str, rhs: int, run: Run, *how: Any, family: str = "") -> tuple[int, int]:
    """By a loop of :mod:`fracid.solver.schemes`, with room for its history and its work; `family` begins it."""
    from fracid.solver import schemes
    from fracid.solver.starting import begun

    start = (begun(rhs, run, family),) if family else ()
    ended: tuple[int, int] = getattr(schemes, loop)(rhs, run, *start, *schemes.room_for(run), *how)
    return ended


METHODS = {
    "pi2": Method(
        "pi", 2, lambda rhs, run, out: _step("step_pi2", rhs, run, False, out, family="pi"),
        "everything, steep friction too; at order 1 a second-order ODE solver",
        at_a_jump="both", sweeps=1.0,
        exported=Exported("product trapezoidal rule, second order"),
    ),
    "pi2-implicit": Method(
        "pi", 2,
        lambda rhs, run, out: _step("step_pi2", rhs, run._replace(corrections=0), False, out, family="pi"),
        "stiff systems: Newton's method at every step", at_a_jump="both",
        exported=Exported("product trapezoidal rule, Newton's method at every step", newton=True),
    ),
    "bdf2": Method(
        "bdf", 2,  # what relaxes dies in this scheme by itself
        lambda rhs, run, out: _step("step_bdf2", rhs, run._replace(relaxing=run.relaxing[:0]), out, family="bdf"),
        "stiff systems at every order: what is fast dies, above order 1 too",
    ),
    "pi3": Method(
        "pi3", 3, lambda rhs, run, out: _step("step_pi2", rhs, run, True, out, family="pi3"),
        "smooth systems: often a thousandth of the error, in the same time",
        follows=2.0, exported=Exported("product rule of third order"),
    ),
    "gl": Method(
        "gl", 1, lambda rhs, run, out: _step("step_gl", rhs, run, False, False, out),
        "the paper's scheme as it should be, on x - x(0)",
        follows=1.0, at_a_jump="after", started=False, exported=Exported("Grünwald-Letnikov on x - x(0), explicit"),
    ),
    "gl-sequential": Method(
        "gl", 1, lambda rhs, run, out: _step("step_gl", rhs, run, False, True, out),
        "the same without the anti-damping of explicit Euler",
        follows=1.0, at_a_jump="after", started=False,
        exported=Exported("Grünwald-Letnikov on x - x(0), the last state first", last_first=True),
    ),
    "gl-paper": Method(
        "gl", 1, lambda rhs, run, out: _step("step_gl", rhs, run, True, False, out),
        "(21)-(24) as printed, to reproduce the paper: of order 1 if x(0) = 0, else wrong",
        follows=1.0, at_a_jump="after", started=False, raw=True,
        exported=Exported("Grünwald-Letnikov on raw x, as (21)-(24) of the paper print it"),
    ),
}  # fmt: skip
"""By name, as a project file has it."""
