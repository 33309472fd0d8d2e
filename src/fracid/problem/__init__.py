"""An identification problem: a model, its recordings, what is free, and what counts as good.

=======================  ==================================================================================
file                     holds
=======================  ==================================================================================
:mod:`.problem`          Problem: the cost of a point of the search space
:mod:`.parametrisation`  from x to orders, parameters, initial state and release of each recording
:mod:`.simulator`        from those to trajectories and outputs
:mod:`.criterion`        from errors to the cost and its rows
:mod:`.unknowns`         what is free, fixed, tied; priors
:mod:`.experiment`       a recording as a problem uses it
:mod:`.sensors`          channels that are late, scaled, offset or filtered
:mod:`.past`             the memory that a start in motion brings along
:mod:`.costs`            the costs: a new one is a row there
:mod:`.checks`           what does not fit together is refused
:mod:`.project`          the project file
:mod:`.presets`          what a preset puts into it
:mod:`.paper`            what the paper's fixes, and in what a project still differs from the paper
:mod:`.draft`            a commented project file, drafted from a recording
=======================  ==================================================================================

Who only asks for the names of the costs must not wait for the solver, so the names below are fetched when asked for.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fracid.problem.experiment import Experiment
    from fracid.problem.problem import Problem
    from fracid.problem.sensors import Sensor
    from fracid.problem.unknowns import Free, Prior, Tied, Unknown

__all__ = ["Experiment", "Free", "Prior", "Problem", "Sensor", "Tied", "Unknown"]

_HOME = {"Experiment": "experiment", "Problem": "problem", "Sensor": "sensors"} | dict.fromkeys(
    ("Free", "Prior", "Tied", "Unknown"), "unknowns"
)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"fracid.problem.{_HOME[name]}"), name)
