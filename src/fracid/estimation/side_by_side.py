"""Walks side by side: each asks for the errors at one point after another, and the points of a round go together.

A walk is a generator: it yields a point and is sent the errors there, or why there are none, as
:meth:`fracid.problem.Problem.errors` has them.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from typing import TypeVar

from fracid.arrays import FloatArray
from fracid.errors import Failure
from fracid.problem import Problem

_Found = TypeVar("_Found")

Walk = Generator[FloatArray, "list[FloatArray] | Failure", _Found]


def side_by_side(problem: Problem, walks: Sequence[Walk[_Found]], *, jobs: int = 1) -> list[_Found]:
    """What each walk comes to; runs go on threads.

    Examples
    --------
    >>> import fracid
    >>> import numpy as np
    >>> from fracid.problem import Experiment
    >>> still = Experiment("still", 0.1, np.zeros((9, 2)), np.zeros((1, 1)))
    >>> problem = Problem(fracid.rotary_pendulum("srv02-rotpen"), (still,), {"lambda": 0.9, "mu": 0.9})
    >>> def samples(x):
    ...     errors = yield x
    ...     return errors[0].shape
    >>> side_by_side(problem, [samples(problem.start)])
    [(9, 2)]
    """
    found: dict[int, _Found] = {}
    errors: dict[int, list[FloatArray] | Failure | None] = dict.fromkeys(range(len(walks)))
    while errors:
        asked = {}
        for k, here in errors.items():
            try:
                asked[k] = walks[k].send(here)  # type: ignore[arg-type]  # None begins it
            except StopIteration as end:
                found[k] = end.value
        errors = dict(zip(asked, problem.all_errors([*asked.values()], jobs=jobs), strict=True))
    return [found[k] for k in range(len(walks))]
