"""Search: one ask/tell loop (:mod:`.base`), and one short file for each algorithm.

========================== ===================================================== ==================
optimiser                  what it is                                            for
========================== ===================================================== ==================
``least-squares``          bounded trust region on the residuals, from the start smooth costs
``multistart``             the same from Sobol points too                        several minima
``genetic``                the paper's GA                                        reproduction
``differential-evolution`` SciPy's                                               rough costs
========================== ===================================================== ==================
"""

from __future__ import annotations

from collections.abc import Callable

from fracid.errors import InputError
from fracid.optimise.base import Evaluation, EvaluationLog, Optimiser, Outcome, Result, Space, as_generator, minimise
from fracid.optimise.differential_evolution import differential_evolution
from fracid.optimise.genetic import genetic
from fracid.optimise.least_squares import least_squares
from fracid.optimise.multistart import multistart

__all__ = [
    "OPTIMISERS",
    "Evaluation",
    "EvaluationLog",
    "Optimiser",
    "Outcome",
    "Result",
    "Space",
    "as_generator",
    "differential_evolution",
    "genetic",
    "least_squares",
    "minimise",
    "multistart",
    "optimiser_from_name",
]

OPTIMISERS: dict[str, Callable[..., Optimiser]] = {
    "multistart": multistart,
    "least-squares": least_squares,
    "genetic": genetic,
    "differential-evolution": differential_evolution,
}


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
        raise InputError(f"There is no optimiser {name!r}; type one of {', '.join(OPTIMISERS)}.")
    return OPTIMISERS[name]
