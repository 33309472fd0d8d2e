"""A problem that can go to another process: what is code in it goes by name.

A :class:`~fracid.problem.Problem` holds functions that pickle cannot send: how its memory is built, how its cost
weighs.  Both have names, and what a name stands for is the same wherever fracid is installed.  A cost or a model
of one's own is a file on one machine, and cannot go.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

from fracid.errors import InputError
from fracid.findings import Words
from fracid.problem.costs import COSTS
from fracid.problem.problem import Problem
from fracid.solver.memory import Memory, compressed, memory_from_name

SAYS = Words("problem/checks.toml")


@dataclass(frozen=True)
class Portable:
    """A problem that pickle can send; its caches and its memo stay behind.

    Its memory is the one of its name, which has six digits of the tolerance: the same numbers here and there.

    Examples
    --------
    >>> import pickle
    >>> import fracid, numpy as np
    >>> from fracid.problem import Experiment
    >>> still = Experiment("still", 0.1, np.zeros((9, 2)), np.zeros((1, 1)))
    >>> problem = Problem(fracid.rotary_pendulum("srv02-rotpen"), (still,), {"lambda": 1.0, "mu": 1.0})
    >>> pickle.loads(pickle.dumps(Portable(problem))).problem.method
    'pi2'
    """

    problem: Problem

    def __post_init__(self) -> None:
        """Take the memory of the name here too."""
        memory = _memory_from_name(self.problem.memory.name)
        object.__setattr__(self, "problem", replace(self.problem, memory=memory))

    def __reduce__(self) -> tuple[Any, ...]:
        """By name, what is code; an InputError where the name would be another's."""
        cost = self.problem.cost_function
        if COSTS.get(cost.name) != cost:
            raise InputError(SAYS("cost-of-a-file", cost=cost))
        parts = {f.name: getattr(self.problem, f.name) for f in fields(Problem) if f.name != "memo"}
        return _carried, (parts | {n: parts[n].name for n in ("cost_function", "memory")},)


def _carried(parts: Mapping[str, Any]) -> Portable:
    objects = {"cost_function": COSTS[parts["cost_function"]], "memory": _memory_from_name(parts["memory"])}
    return Portable(Problem(**{**parts, **objects}))


def _memory_from_name(name: str) -> Memory:
    """The memory of a name, ``compressed(1e-10, lags=16)`` too."""
    if match := re.fullmatch(r"compressed\(([^,]+)(?:, lags=(\d+))?\)", name):
        tolerance, lags = match.groups()
        return compressed(float(tolerance), **({"lags": int(lags)} if lags else {}))
    return memory_from_name(name)
