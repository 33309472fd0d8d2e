"""A fit chooses its step where the project leaves it the choice; its run folder has the step that it took."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import fracid
from fracid.errors import Failure, FailureReason, InputError
from fracid.estimation.covariance import half_width, uncertainty
from fracid.estimation.minimum import Minimum
from fracid.identification.examination import Examination
from fracid.optimise import Outcome
from fracid.runs.saved import load_run
from fracid.validation.discretisation import Discretisation, _costs_differ, _helps
from program import fit_in
from twins import write_release

pytestmark = pytest.mark.usefixtures("without_rivals")

STEEP = """
[model.parameters]
slip_speed = 5e-3
coulomb_theta = { start = 0.04, lower = 0.0, upper = 0.1 }
[model.orders]
lambda = 1.0
mu = 1.0
[[recording]]
file = "steep.csv"
theta = { column = "theta", unit = "rad" }
alpha = { column = "alpha", unit = "rad" }
initial = { theta = 0.0, alpha = 0.4 }
[fit]
initial_state = "held"
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A release with steep dry friction, of which one step a sample is too coarse."""
    folder = tmp_path_factory.mktemp("steep")
    friction = {"coulomb_theta": 0.05, "slip_speed": 5e-3}
    write_release(folder / "steep.csv", orders=[1.0] * 4, alpha=0.4, step=0.01, end=3.0, finer=40, noise=4e-4,
                  parameters=friction)  # fmt: skip
    return folder


@pytest.fixture(scope="module")
def chosen(folder):
    """Its fit at a step that the project does not say."""
    kept = []
    fit_in(folder, STEEP, lambda fit: kept.append(fit) or ())
    return folder / "run", kept[0]


@pytest.mark.broad
def test_a_fit_halves_its_step_until_the_check_is_quiet_and_says_what_it_took(chosen):
    run, fit = chosen
    assert fit.problem.substeps > 1
    assert not fit.discretisation.warning
    assert not any(f.code == "step" for f in fit.findings)
    said = f"The step was halved to {fit.problem.substeps} a sample; at 1 a sample half the step changes the cost from "
    assert fit.discretisation.refinement.startswith(said)
    assert fit.parameters["coulomb_theta"].value == pytest.approx(0.05, rel=2e-3)
    result = json.loads((run / "result.json").read_text(encoding="utf-8"))
    assert (result["substeps"], result["step"]) == (fit.problem.substeps, 0.01 / fit.problem.substeps)


def test_a_fit_that_opens_a_bound_is_written_at_the_step_that_it_takes_then(folder):
    (folder / "narrow.toml").write_text(STEEP.replace("upper = 0.1", "upper = 0.045"), encoding="utf-8")
    fit = fracid.identify(fracid.load_project(folder / "narrow.toml"))
    assert [b.name for b in fit.opened_bounds] == ["coulomb_theta"]
    assert fit.substeps == fit.problem.substeps > 1
    assert fit.recordings["steep"].cost == pytest.approx(fit.cost, rel=1e-6)


def test_a_run_is_read_back_at_the_step_that_its_fit_chose(chosen):
    run, fit = chosen
    saved = load_run(run)
    assert saved.problem.substeps == fit.problem.substeps
    assert saved.recordings["steep"].rmse == fit.recordings["steep"].rmse
    assert saved.notes == ()


def test_a_project_that_says_its_substeps_keeps_them_and_is_told(folder, chosen):
    (folder / "fixed.toml").write_text(STEEP + "substeps = 1\n", encoding="utf-8")
    fit = fracid.identify(fracid.load_project(folder / "fixed.toml"))
    assert fit.problem.substeps == 1
    assert "Type substeps = 2 in [fit]" in fit.discretisation.warning
    assert fit.discretisation.refinement == ""
    # and no result of another step is taken for one of this project
    run, _ = chosen
    free = (run / "project.toml").read_text(encoding="utf-8")
    (run / "project.toml").write_text(STEEP + "substeps = 1\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"its substeps are \d+, and the project fixes 1"):
        load_run(run)
    (run / "project.toml").write_text(free, encoding="utf-8")


@pytest.mark.broad
def test_a_quiet_step_is_left_alone_to_the_last_bit(tmp_path):
    write_release(tmp_path / "quiet.csv", orders={"lambda": 1.0, "mu": 0.95}, alpha=0.3, step=5e-3, end=2.0, noise=1e-3)
    text = STEEP.replace("steep.csv", "quiet.csv").replace("slip_speed = 5e-3\n", "").replace("mu = 1.0", "mu = 0.97")
    fits = []
    for name, step in (("free", ""), ("fixed", "substeps = 1\n")):
        (tmp_path / f"{name}.toml").write_text(text.replace("alpha = 0.4", "alpha = 0.3") + step, encoding="utf-8")
        fits.append(fracid.identify(fracid.load_project(tmp_path / f"{name}.toml")))
    free, fixed = fits
    assert free.problem.substeps == 1
    assert np.array_equal(free.x, fixed.x)
    assert free.discretisation == fixed.discretisation


@pytest.mark.parametrize(("slip_speed", "taken"), [(0.1, 1), (5e-3, 4), (5e-4, 8)])
def test_rivals_are_held_against_the_fit_at_the_longest_step_that_costs_the_same(tmp_path, slip_speed, taken):
    constants = {"coulomb_theta": 0.05, "slip_speed": slip_speed}
    write_release(tmp_path / "steep.csv", orders=[1.0] * 4, alpha=0.4, step=2e-3, end=1.0, finer=40, noise=4e-4,
                  parameters=constants)  # fmt: skip
    (tmp_path / "project.toml").write_text(STEEP.replace("5e-3", f"{slip_speed}"), encoding="utf-8")
    searched = fracid.load_project(tmp_path / "project.toml").problem
    fine = replace(searched, substeps=8)
    setting = SimpleNamespace(problem=searched, window=None, alternatives={}, jobs=1)
    at = Minimum(fine, fine.evaluate([0.05]), 8, Failure(FailureReason.INTERRUPTED, ""))
    where, beside = Examination(setting, at, Outcome.CONVERGED, None)._cheaper(fine)
    assert where.substeps == taken
    assert beside.cost == pytest.approx(at.best.cost, rel=5e-3)


@pytest.mark.parametrize("orders", [{}, {"mu": 0.9}])
def test_half_a_step_helps_where_values_move_by_less_whether_an_order_is_free_or_not(orders):
    coarse, finer, alike = (Discretisation(1.0, 1.0, 1.0, orders, orders, largest) for largest in (0.4, 0.1, 0.39))
    assert _helps("pi2", coarse, finer)
    assert not _helps("pi2", coarse, alike)


def test_what_the_step_moves_is_held_against_the_interval_that_is_printed(folder):
    (folder / "project.toml").write_text(STEEP, encoding="utf-8")
    problem = fracid.load_project(folder / "project.toml").problem
    x = problem.start
    known = uncertainty(problem, x)
    half = half_width(known, x, 0)
    check = Discretisation(1.0, 2.0, 2.0, {}, {}, moves={"coulomb_theta": 3 * half})
    assert "coulomb_theta by +" in check.judged(problem, x, known, 1).warning
    walked = replace(known, ends=x[:, None] + 10 * (known.ends - x[:, None]))
    assert "coulomb_theta" not in check.judged(problem, x, walked, 1).warning


@pytest.mark.parametrize(("method", "complains"), [("pi2", True), ("bdf2", True), ("pi3", True), ("gl", False)])
def test_a_cost_that_half_a_step_changes_is_told_of_every_scheme_of_second_order(method, complains):
    assert _costs_differ(method, Discretisation(1.0, 0.6, 0.6, {}, {})) == complains
