"""Search: one ask/tell loop (:mod:`.base`), and one short file for each algorithm.

========================== ========================================== ==========================================
optimiser                  what it is                                 when
========================== ========================================== ==========================================
``least-squares``          trust region on the residuals, from the    a built-in cost and a fair start; some 10
                           start                                      Jacobians
``multistart``             the same from Sobol points too             several minima, or no fair start
``differential-evolution`` whole generations over the bounds          a cost of your own, or cliffs of failing
                                                                      runs; some 400 evaluations an unknown
``cma``                    evolution with an adapted covariance       a cost of your own and many unknowns that pull on
                                                                      each other; from a start
``nelder-mead``            a simplex, from the start                  a cost of your own and a fair start
``genetic``                the paper's GA: 520 evaluations            to reproduce the paper
========================== ========================================== ==========================================
"""

from __future__ import annotations

import difflib
from collections.abc import Callable

from fracid.errors import InputError
from fracid.optimise.base import (
    Ask,
    Evaluation,
    EvaluationLog,
    Optimiser,
    Outcome,
    Result,
    Space,
    as_generator,
    minimise,
)
from fracid.optimise.cma import cma
from fracid.optimise.differential_evolution import differential_evolution
from fracid.optimise.genetic import genetic
from fracid.optimise.least_squares import least_squares
from fracid.optimise.lockstep import Path, lockstep, multistart, sobol_points
from fracid.optimise.nelder_mead import nelder_mead

__all__ = [
    "OPTIMISERS",
    "Ask",
    "Evaluation",
    "EvaluationLog",
    "Optimiser",
    "Outcome",
    "Path",
    "Result",
    "Space",
    "as_generator",
    "cma",
    "differential_evolution",
    "genetic",
    "least_squares",
    "lockstep",
    "minimise",
    "multistart",
    "nelder_mead",
    "optimiser_from_name",
    "sobol_points",
]

OPTIMISERS: dict[str, Callable[..., Optimiser]] = {
    "multistart": multistart,
    "least-squares": least_squares,
    "genetic": genetic,
    "differential-evolution": differential_evolution,
    "cma": cma,
    "nelder-mead": nelder_mead,
}
"""By name, as a project file has it; see the table above."""


def optimiser_from_name(name: str) -> Callable[..., Optimiser]:
    """Find an optimiser.

    Raises
    ------
    InputError
        If there is none of that name.

    Examples
    --------
    >>> optimiser_from_name("genetic").__name__
    'genetic'
    """
    if name not in OPTIMISERS:
        close = difflib.get_close_matches(name, OPTIMISERS, 1)
        hint = f"did you mean {close[0]!r}? " if close else ""
        raise InputError(f"There is no optimiser {name!r}; {hint}type one of {', '.join(OPTIMISERS)}.")
    return OPTIMISERS[name]
