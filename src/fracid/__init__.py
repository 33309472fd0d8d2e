"""fracid identifies fractional-order and integer-order models of nonlinear systems from recordings.

>>> import fracid
>>> rig = fracid.rotary_pendulum("srv02-rotpen", zero="hanging")
>>> run = fracid.simulate(rig, orders={"lambda": 0.86, "mu": 0.91}, initial={"alpha": 0.17}, step=1e-3, end=20.0)
>>> run.outcome.value
'completed'

From a shell: ``fracid check FILE`` looks at a recording, ``fracid fit PROJECT`` identifies.
Names are imported when they are first used, so that ``import fracid`` costs nothing.
"""

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fracid.amplitude import AmplitudeTest, amplitude_test
    from fracid.batch import Sensitivities, sensitivities, solve_fde_batch
    from fracid.bootstrap import Bootstrap, Spread, bootstrap, spread
    from fracid.compare import Comparison, compare
    from fracid.cut import CutCheck, cut_check
    from fracid.diagnostics import Verdict, identifiability
    from fracid.draft import draft_project
    from fracid.errors import DataError, FracidError, InputError, NotTrusted, Unfinished
    from fracid.executor import Task, run_tasks
    from fracid.export import export_run
    from fracid.export.state_space import integer_model
    from fracid.fractional import derivative
    from fracid.identify import Fit, identify
    from fracid.journal import Journal
    from fracid.models import Model, Parameter, rotary_pendulum
    from fracid.problem import Experiment, Free, Problem
    from fracid.profiles import Profile, Profiles, profile
    from fracid.project import Project, load_project
    from fracid.recording import Recording, load_recording
    from fracid.reduction import System, linear_multi_term, linear_system, multi_term
    from fracid.regression import Regression, regress
    from fracid.report import write_report
    from fracid.reproduction import Reproduction, reproduce
    from fracid.residuals import ResidualAnalysis, residual_analysis
    from fracid.saved import SavedRun, load_run
    from fracid.simulate import simulate, solve_fde
    from fracid.studies import NoiseStudy, noise_study
    from fracid.trajectory import Outcome, Trajectory
    from fracid.twin_recording import Twin, save_recording

__version__ = "0.1.0"

_HOME = {
    "AmplitudeTest": "amplitude",
    "Bootstrap": "bootstrap",
    "Comparison": "compare",
    "CutCheck": "cut",
    "DataError": "errors",
    "Experiment": "problem",
    "Fit": "identify",
    "FracidError": "errors",
    "Free": "problem",
    "InputError": "errors",
    "Journal": "journal",
    "Model": "models",
    "NoiseStudy": "studies",
    "NotTrusted": "errors",
    "Outcome": "trajectory",
    "Parameter": "models",
    "Problem": "problem",
    "Profile": "profiles",
    "Profiles": "profiles",
    "Project": "project",
    "Recording": "recording",
    "Regression": "regression",
    "Reproduction": "reproduction",
    "ResidualAnalysis": "residuals",
    "SavedRun": "saved",
    "Sensitivities": "batch",
    "Spread": "bootstrap",
    "System": "reduction",
    "Task": "executor",
    "Trajectory": "trajectory",
    "Twin": "twin_recording",
    "Unfinished": "errors",
    "Verdict": "diagnostics",
    "amplitude_test": "amplitude",
    "bootstrap": "bootstrap",
    "compare": "compare",
    "cut_check": "cut",
    "derivative": "fractional",
    "draft_project": "draft",
    "export_run": "export",
    "identifiability": "diagnostics",
    "identify": "identify",
    "integer_model": "export.state_space",
    "linear_multi_term": "reduction",
    "linear_system": "reduction",
    "load_project": "project",
    "load_recording": "recording",
    "load_run": "saved",
    "multi_term": "reduction",
    "noise_study": "studies",
    "profile": "profiles",
    "regress": "regression",
    "reproduce": "reproduction",
    "residual_analysis": "residuals",
    "rotary_pendulum": "models",
    "run_tasks": "executor",
    "save_recording": "twin_recording",
    "sensitivities": "batch",
    "simulate": "simulate",
    "solve_fde": "simulate",
    "solve_fde_batch": "batch",
    "spread": "bootstrap",
    "write_report": "report",
}
"""Which module each public name lives in."""

__all__ = ["AmplitudeTest", "Bootstrap", "Comparison", "CutCheck", "DataError", "Experiment", "Fit",
           "FracidError", "Free", "InputError", "Journal", "Model", "NoiseStudy", "NotTrusted", "Outcome",
           "Parameter", "Problem", "Profile", "Profiles", "Project", "Recording", "Regression",
           "Reproduction", "ResidualAnalysis", "SavedRun", "Sensitivities", "Spread", "System", "Task",
           "Trajectory", "Twin", "Unfinished", "Verdict", "__version__", "amplitude_test", "bootstrap",
           "compare", "cut_check", "derivative", "draft_project", "export_run", "identifiability",
           "identify", "integer_model", "linear_multi_term", "linear_system", "load_project", "load_recording",
           "load_run", "multi_term", "noise_study", "profile", "regress", "reproduce", "residual_analysis",
           "rotary_pendulum", "run_tasks", "save_recording", "sensitivities", "simulate", "solve_fde",
           "solve_fde_batch", "spread", "write_report"]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'fracid' has no attribute {name!r}; it has {', '.join(_HOME)}")
    return getattr(import_module(f"fracid.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)


class _Package(ModuleType):
    """Importing the modules ``simulate`` and ``identify`` must not hide the functions of these names."""

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in _HOME and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
