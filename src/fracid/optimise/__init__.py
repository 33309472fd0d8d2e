"""Search: one ask/tell loop (:mod:`.base`), and one short file for each algorithm.

Each file says with its ``OPTIMISER`` by what name a project takes it; all are collected in :data:`OPTIMISERS`.
"""

from __future__ import annotations

import pkgutil
from importlib import import_module

from fracid.errors import entry_of
from fracid.optimise.base import Ask as Ask
from fracid.optimise.base import Entry as Entry
from fracid.optimise.base import Evaluation as Evaluation
from fracid.optimise.base import EvaluationLog as EvaluationLog
from fracid.optimise.base import Optimiser as Optimiser
from fracid.optimise.base import Outcome as Outcome
from fracid.optimise.base import Result as Result
from fracid.optimise.base import Space as Space
from fracid.optimise.base import Told as Told
from fracid.optimise.base import as_generator as as_generator
from fracid.optimise.base import minimise as minimise
from fracid.optimise.cma import cma as cma
from fracid.optimise.differential_evolution import differential_evolution as differential_evolution
from fracid.optimise.genetic import genetic as genetic
from fracid.optimise.least_squares import least_squares as least_squares
from fracid.optimise.lockstep import MOST_STARTS as MOST_STARTS
from fracid.optimise.lockstep import Path as Path
from fracid.optimise.lockstep import lockstep as lockstep
from fracid.optimise.lockstep import sobol_points as sobol_points
from fracid.optimise.nelder_mead import nelder_mead as nelder_mead


def _collected() -> dict[str, Entry]:
    """What the files of this folder offer."""
    files = [import_module(f"{__name__}.{file.name}") for file in pkgutil.iter_modules(__path__)]
    return {file.OPTIMISER.name: file.OPTIMISER for file in files if hasattr(file, "OPTIMISER")}


OPTIMISERS = _collected()
"""By name, as a project file has it."""


def optimiser_from_name(name: str) -> Entry:
    """Find an optimiser.

    Raises
    ------
    InputError
        If there is none of that name.

    Examples
    --------
    >>> optimiser_from_name("genetic").evaluations
    520
    """
    return entry_of("optimiser", OPTIMISERS, name)
