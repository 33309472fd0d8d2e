"""The methods: a row for each stepping scheme, and all that fracid knows of it.

A new method is its loop in :mod:`fracid.solver.schemes` and its row in ``methods.toml``: its name, the memory that it
sums with, its order and its limit, and what an exported model steps with all come from here.  Only weights of another
family need more (:mod:`fracid.solver.weights`, :mod:`fracid.solver.starting`).

A loop takes the address of f, the :class:`~fracid.solver.loop_arguments.Run` and the array to fill, and returns the
last good index and how the run ended.

The loops take a second to import, so a row fetches its own when it first runs.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from fracid.safety.door import own_text

if TYPE_CHECKING:
    from fracid.arrays import FloatArray
    from fracid.solver.loop_arguments import Run


class Exported(NamedTuple):
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
    follows: float = math.inf
    """The largest |J|h of :mod:`fracid.solver.stiffness` that it follows; infinite for what solves stiff systems."""
    at_a_jump: Literal["both", "after", "mean"] = "mean"
    """Of an input that jumps at a grid point it takes the values before and after it, that after it, or their mean."""
    sweeps: float = math.inf
    """The |J|h up to which its sweeps contract: a run that ends early beyond it owes that to them, perhaps."""
    raw: bool = False
    """Whether it sums x itself, which is right only for x(0) = 0."""
    exported: Exported | None = None
    """None for one that cannot be written in another language."""


def _step(row: Mapping[str, Any], rhs: int, run: Run, out: FloatArray) -> tuple[int, int]:
    """By a loop of :mod:`fracid.solver.schemes`, with a start, and room for its history and its work."""
    from fracid.solver import schemes
    from fracid.solver.starting import begun

    run = run._replace(**row.get("changed", {}))
    if row["family"] == "bdf":  # what relaxes dies in this scheme by itself
        run = run._replace(relaxing=run.relaxing[:0])
    start = [] if row["family"] == "gl" else begun(rhs, [run], row["family"])
    ended: tuple[int, int] = getattr(schemes, row["loop"])(rhs, run, *start, *schemes.room_for(run), *row["how"], out)
    return ended


def _method(row: Mapping[str, Any]) -> Method:
    own = {n: v for n, v in row.items() if n in Method.__dataclass_fields__}
    exported = Exported(**row["exported"]) if "exported" in row else None
    return Method(**{**own, "run": partial(_step, row), "exported": exported})


METHODS = {name: _method(row) for name, row in tomllib.loads(own_text("solver/methods.toml")).items()}
"""By name, as a project file has it."""
