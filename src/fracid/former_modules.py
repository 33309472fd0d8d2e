"""The names that modules had before they moved into packages: each still imports, and warns where it went.

>>> import sys
>>> "fracid.costs" in FORMER
True
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from importlib import import_module
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

__all__ = ["FORMER", "FormerModules"]

FORMER = {
    "fracid.alternative": "selection.integer_rival",
    "fracid.amplitude": "selection.amplitude signals.swing",
    "fracid.batch": "solver.batch",
    "fracid.bootstrap": "estimation.block_bootstrap estimation.agreement",
    "fracid.compare": "selection.comparison",
    "fracid.compiling": "solver.compilation",
    "fracid.costs": "problem.costs",
    "fracid.criteria": "selection.bic signals.correlation",
    "fracid.cut": "validation.unknown_past",
    "fracid.diagnostics": "estimation.parameter_verdicts estimation.cost_plane",
    "fracid.draft": "problem.draft",
    "fracid.executor": "tasks.tasks tasks.cluster tasks.job tasks.local",
    "fracid.foreign": "safety.text",
    "fracid.fractional": "solver.operators",
    "fracid.history": "solver.history",
    "fracid.honesty": "validation.before_search validation.after_search",
    "fracid.identify": "identification estimation.records fit validation.discretisation",
    "fracid.journal": "tasks.journal tasks.folder_lock",
    "fracid.ladder": "selection.ladder",
    "fracid.memo": "tasks.simulation_cache",
    "fracid.memory": "solver.memory solver.certificate solver.exponentials solver.weights",
    "fracid.misread": "validation.sensor_faults",
    "fracid.mistaken": "safety.paths",
    "fracid.models.rotary_pendulum": "models.pendulum",
    "fracid.optimise.multistart": "optimise.lockstep",
    "fracid.own_code": "safety.user_code",
    "fracid.pictures": "estimation.fit_figures",
    "fracid.plots.look": "plots.appearance",
    "fracid.portable": "problem.portable",
    "fracid.profiles": "estimation.cost_profile estimation.profile_walk",
    "fracid.project": "problem.project",
    "fracid.projection": "estimation.curvature",
    "fracid.reduction": "solver.reduction",
    "fracid.reproduction": "runs.reproduction",
    "fracid.residuals": "validation.residuals validation.residual_records signals.correlation",
    "fracid.right_hand_side": "solver.right_hand_side",
    "fracid.same_code": "solver.same_function",
    "fracid.saved": "runs.saved",
    "fracid.search": "estimation.search estimation.horizons estimation.starts",
    "fracid.shape": "safety.schema safety.json_files schemas.result",
    "fracid.simulate": "solver.solve solver.arguments solver.methods",
    "fracid.starting": "solver.starting",
    "fracid.stepping": "solver.schemes",
    "fracid.stiffness": "solver.stiffness",
    "fracid.studies": "validation.monte_carlo twins.encoder",
    "fracid.style": "figures",
    "fracid.surroundings": "safety.environment",
    "fracid.trajectory": "solver.trajectory",
    "fracid.triangle": "qr",
    "fracid.twin_recording": "twins.twin recording.writing",
    "fracid.uncertainty": "estimation.covariance signals.correlation",
    "fracid.workflows.observer": "tasks.observer",
}
"""Former module → the modules of :mod:`fracid` that hold what was in it."""


class FormerModule(ModuleType):
    """Looks names up where they are now.  One that was called like a function is that function too."""

    def __getattr__(self, name: str) -> Any:
        homes = FORMER[self.__name__].split()
        for home in homes:
            module = import_module(f"fracid.{home}")
            if hasattr(module, name):
                return getattr(module, name)
        raise AttributeError(f"module {self.__name__!r} has moved to fracid.{homes[0]}, which has no {name!r}")

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        return getattr(self, self.__name__.rpartition(".")[2])(*arguments, **options)


class FormerModules:
    """Finds former modules, after all that is there was looked for."""

    @staticmethod
    def find_spec(name: str, path: Sequence[str] | None = None, target: ModuleType | None = None) -> ModuleSpec | None:  # noqa: ARG004
        """Of :data:`FORMER` alone."""
        return ModuleSpec(name, FormerModules) if name in FORMER else None  # type: ignore[arg-type]

    @staticmethod
    def create_module(spec: ModuleSpec) -> ModuleType:
        """One that looks names up elsewhere."""
        return FormerModule(spec.name, f"Moved to fracid.{FORMER[spec.name].split()[0]}.")

    @staticmethod
    def exec_module(module: ModuleType) -> None:
        """Warn, at the line that imports it."""
        homes = " and ".join(f"fracid.{home}" for home in FORMER[module.__name__].split())
        warnings.warn(f"{module.__name__} has moved to {homes}", DeprecationWarning, stacklevel=2)
