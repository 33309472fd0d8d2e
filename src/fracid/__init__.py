"""fracid identifies fractional-order and integer-order models of nonlinear systems from recordings.

>>> import fracid
>>> rig = fracid.rotary_pendulum("srv02-rotpen", zero="hanging")
>>> run = fracid.simulate(rig, orders={"lambda": 0.86, "mu": 0.91}, initial={"alpha": 0.17}, step=1e-3, end=20.0)
>>> run.outcome.value
'completed'

From a shell: ``fracid check FILE`` looks at a recording, ``fracid fit PROJECT`` identifies.
Names are imported when they are first used, so that ``import fracid`` costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from fracid._version import __version__

if TYPE_CHECKING:
    from fracid.bayes.inference import posterior
    from fracid.bayes.result import Posterior, log_odds
    from fracid.errors import DataError, FracidError, InputError, NotTrusted, Unfinished
    from fracid.estimation.agreement import Spread, spread
    from fracid.estimation.block_bootstrap import Bootstrap, bootstrap
    from fracid.estimation.cost_profile import Profile, Profiles, profile
    from fracid.estimation.parameter_verdicts import Verdict, identifiability
    from fracid.experiments.choice import design
    from fracid.experiments.excitation import Chirp, Multisine, Pulses
    from fracid.experiments.plan import Plan
    from fracid.experiments.space import DesignSpace
    from fracid.export import export_run
    from fracid.export.state_space import integer_model
    from fracid.fit import Fit
    from fracid.identification import identify
    from fracid.models import Model, Parameter, model, rotary_pendulum
    from fracid.problem import Experiment, Free, Problem, Sensor
    from fracid.problem.draft import draft_project
    from fracid.problem.project import Project, load_project
    from fracid.recording import Recording, load_recording
    from fracid.recording.writing import save_recording
    from fracid.regression import Regression, regress
    from fracid.report import write_report
    from fracid.runs.reproduction import Reproduction, reproduce
    from fracid.runs.saved import SavedRun, load_run
    from fracid.selection.amplitude import AmplitudeTest, amplitude_test
    from fracid.selection.comparison import Comparison, compare
    from fracid.solver.batch import Sensitivities, sensitivities, solve_fde_batch
    from fracid.solver.operators import derivative
    from fracid.solver.reduction import System, linear_multi_term, linear_system, multi_term
    from fracid.solver.solve import simulate, solve_fde
    from fracid.solver.trajectory import Outcome, Trajectory
    from fracid.tasks.job import Task
    from fracid.tasks.journal import Journal
    from fracid.tasks.observer import Observer
    from fracid.tasks.tasks import run_tasks
    from fracid.twins.twin import Twin
    from fracid.validation.monte_carlo import NoiseStudy, noise_study
    from fracid.validation.residual_records import ResidualAnalysis
    from fracid.validation.residuals import residual_analysis
    from fracid.validation.unknown_past import CutCheck, cut_check
    from fracid.workflows.comparison import FinishedComparison, run_comparison
    from fracid.workflows.fit import FinishedRun, run
    from fracid.workflows.monte_carlo import FinishedNoiseStudy, run_noise_study
    from fracid.workflows.posterior_draws import FinishedPosterior, run_posterior
    from fracid.workflows.profiles import FinishedProfiles, run_profiles
    from fracid.workflows.residuals import FinishedResiduals, run_residuals
    from fracid.workflows.resumption import resume_run

_NAMES = {
    "bayes.inference": "posterior",
    "bayes.result": "Posterior log_odds",
    "errors": "DataError FracidError InputError NotTrusted Unfinished",
    "estimation.agreement": "Spread spread",
    "estimation.block_bootstrap": "Bootstrap bootstrap",
    "estimation.cost_profile": "Profile Profiles profile",
    "estimation.parameter_verdicts": "Verdict identifiability",
    "experiments.choice": "design",
    "experiments.excitation": "Chirp Multisine Pulses",
    "experiments.plan": "Plan",
    "experiments.space": "DesignSpace",
    "export": "export_run",
    "export.state_space": "integer_model",
    "fit": "Fit",
    "identification": "identify",
    "models": "Model Parameter model rotary_pendulum",
    "problem": "Experiment Free Problem Sensor",
    "problem.draft": "draft_project",
    "problem.project": "Project load_project",
    "recording": "Recording load_recording",
    "recording.writing": "save_recording",
    "regression": "Regression regress",
    "report": "write_report",
    "runs.reproduction": "Reproduction reproduce",
    "runs.saved": "SavedRun load_run",
    "selection.amplitude": "AmplitudeTest amplitude_test",
    "selection.comparison": "Comparison compare",
    "solver.batch": "Sensitivities sensitivities solve_fde_batch",
    "solver.operators": "derivative",
    "solver.reduction": "System linear_multi_term linear_system multi_term",
    "solver.solve": "simulate solve_fde",
    "solver.trajectory": "Outcome Trajectory",
    "tasks.job": "Task",
    "tasks.journal": "Journal",
    "tasks.observer": "Observer",
    "tasks.tasks": "run_tasks",
    "twins.twin": "Twin",
    "validation.monte_carlo": "NoiseStudy noise_study",
    "validation.residual_records": "ResidualAnalysis",
    "validation.residuals": "residual_analysis",
    "validation.unknown_past": "CutCheck cut_check",
    "workflows.comparison": "FinishedComparison run_comparison",
    "workflows.fit": "FinishedRun run",
    "workflows.monte_carlo": "FinishedNoiseStudy run_noise_study",
    "workflows.posterior_draws": "FinishedPosterior run_posterior",
    "workflows.profiles": "FinishedProfiles run_profiles",
    "workflows.residuals": "FinishedResiduals run_residuals",
    "workflows.resumption": "resume_run",
}
"""Module → the public names that live in it."""

_HOME = {name: module for module, names in _NAMES.items() for name in names.split()}

__all__ = ["AmplitudeTest", "Bootstrap", "Chirp", "Comparison", "CutCheck", "DataError", "DesignSpace", "Experiment",
           "FinishedComparison", "FinishedNoiseStudy", "FinishedPosterior", "FinishedProfiles", "FinishedResiduals",
           "FinishedRun", "Fit", "FracidError", "Free", "InputError", "Journal", "Model", "Multisine", "NoiseStudy",
           "NotTrusted", "Observer", "Outcome", "Parameter", "Plan", "Posterior", "Problem", "Profile", "Profiles",
           "Project", "Pulses", "Recording", "Regression", "Reproduction", "ResidualAnalysis", "SavedRun",
           "Sensitivities", "Sensor", "Spread", "System", "Task", "Trajectory", "Twin", "Unfinished", "Verdict",
           "__version__", "amplitude_test", "bootstrap", "compare", "cut_check", "derivative", "design",
           "draft_project", "export_run", "identifiability", "identify", "integer_model", "linear_multi_term",
           "linear_system", "load_project", "load_recording", "load_run", "log_odds", "model", "multi_term",
           "noise_study", "posterior", "profile", "regress", "reproduce", "residual_analysis", "resume_run",
           "rotary_pendulum", "run", "run_comparison", "run_noise_study", "run_posterior", "run_profiles",
           "run_residuals", "run_tasks", "save_recording", "sensitivities", "simulate", "solve_fde", "solve_fde_batch",
           "spread", "write_report"]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'fracid' has no attribute {name!r}; it has {', '.join(sorted(_HOME))}")
    return getattr(import_module(f"fracid.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
