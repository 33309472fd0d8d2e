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

_HOME = {
    "AmplitudeTest": "selection.amplitude",
    "Bootstrap": "estimation.block_bootstrap",
    "Chirp": "experiments.excitation",
    "Comparison": "selection.comparison",
    "CutCheck": "validation.unknown_past",
    "DataError": "errors",
    "DesignSpace": "experiments.space",
    "Experiment": "problem",
    "FinishedComparison": "workflows.comparison",
    "FinishedNoiseStudy": "workflows.monte_carlo",
    "FinishedPosterior": "workflows.posterior_draws",
    "FinishedProfiles": "workflows.profiles",
    "FinishedResiduals": "workflows.residuals",
    "FinishedRun": "workflows.fit",
    "Fit": "fit",
    "FracidError": "errors",
    "Free": "problem",
    "InputError": "errors",
    "Journal": "tasks.journal",
    "Model": "models",
    "Multisine": "experiments.excitation",
    "NoiseStudy": "validation.monte_carlo",
    "NotTrusted": "errors",
    "Observer": "tasks.observer",
    "Outcome": "solver.trajectory",
    "Parameter": "models",
    "Plan": "experiments.plan",
    "Posterior": "bayes.result",
    "Problem": "problem",
    "Profile": "estimation.cost_profile",
    "Profiles": "estimation.cost_profile",
    "Project": "problem.project",
    "Pulses": "experiments.excitation",
    "Recording": "recording",
    "Regression": "regression",
    "Reproduction": "runs.reproduction",
    "ResidualAnalysis": "validation.residual_records",
    "SavedRun": "runs.saved",
    "Sensitivities": "solver.batch",
    "Sensor": "problem",
    "Spread": "estimation.agreement",
    "System": "solver.reduction",
    "Task": "tasks.job",
    "Trajectory": "solver.trajectory",
    "Twin": "twins.twin",
    "Unfinished": "errors",
    "Verdict": "estimation.parameter_verdicts",
    "amplitude_test": "selection.amplitude",
    "bootstrap": "estimation.block_bootstrap",
    "compare": "selection.comparison",
    "cut_check": "validation.unknown_past",
    "derivative": "solver.operators",
    "design": "experiments.choice",
    "draft_project": "problem.draft",
    "export_run": "export",
    "identifiability": "estimation.parameter_verdicts",
    "identify": "identification",
    "integer_model": "export.state_space",
    "linear_multi_term": "solver.reduction",
    "linear_system": "solver.reduction",
    "load_project": "problem.project",
    "load_recording": "recording",
    "load_run": "runs.saved",
    "log_odds": "bayes.result",
    "model": "models",
    "multi_term": "solver.reduction",
    "noise_study": "validation.monte_carlo",
    "posterior": "bayes.inference",
    "profile": "estimation.cost_profile",
    "regress": "regression",
    "reproduce": "runs.reproduction",
    "residual_analysis": "validation.residuals",
    "resume_run": "workflows.resumption",
    "rotary_pendulum": "models",
    "run": "workflows.fit",
    "run_comparison": "workflows.comparison",
    "run_noise_study": "workflows.monte_carlo",
    "run_posterior": "workflows.posterior_draws",
    "run_profiles": "workflows.profiles",
    "run_residuals": "workflows.residuals",
    "run_tasks": "tasks.tasks",
    "save_recording": "recording.writing",
    "sensitivities": "solver.batch",
    "simulate": "solver.solve",
    "solve_fde": "solver.solve",
    "solve_fde_batch": "solver.batch",
    "spread": "estimation.agreement",
    "write_report": "report",
}
"""Which module each public name lives in."""

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
        raise AttributeError(f"module 'fracid' has no attribute {name!r}; it has {', '.join(_HOME)}")
    return getattr(import_module(f"fracid.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
