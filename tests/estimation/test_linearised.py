"""What a run teaches about derivatives: exactly the way there, and nothing across it."""

import numpy as np
import pytest

import fracid
from fracid.estimation.linearised import linearised
from fracid.estimation.minimum import GAIN, onward
from fracid.estimation.side_by_side import side_by_side
from fracid.estimation.tangent import tangent
from fracid.problem import Experiment, Free, Problem

RIG = fracid.rotary_pendulum("srv02-rotpen")
SWING = fracid.simulate(RIG, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=4e-3, end=2.0)
NOISE = 1e-3 * np.random.default_rng(1).standard_normal((501, 2))
FAR = np.array([-0.01, 1e-4])
"""Some ten standard errors."""
TRUE = np.array([0.95, RIG.parameter("b_alpha").value])


@pytest.fixture(scope="module")
def problem():
    swing = Experiment("twin", 4e-3, SWING.states[:, [0, 2]] + NOISE, np.zeros((1, 1)))
    free = {"mu": Free(0.95, 0.5, 1.2)}
    return Problem(RIG, (swing,), {"lambda": 0.9, **free}, {"b_alpha": Free(TRUE[1], 0.0, 1e-2)}, initial_state="held")


def at(here, x):
    return side_by_side(here.near.problem, [here.at(x)])[0]


def test_its_rows_are_those_of_the_tangent_in_other_coordinates(problem):
    near = tangent(problem, TRUE)
    here = linearised(near)
    rows = near.rows
    both = np.column_stack([here.J, here.F])
    np.testing.assert_allclose(both.T @ both, rows.T @ rows, rtol=1e-9)


def test_a_run_makes_the_derivatives_agree_with_the_way_there_and_leaves_the_others(problem):
    here = linearised(tangent(problem, TRUE))
    way = np.array([0.03, 0.0])
    there = at(here, TRUE + way)
    was = np.append(here.F, 0.0)
    assert there.J @ way == pytest.approx(there.F - was, abs=1e-12)
    assert there.J[:, 1] == pytest.approx(np.append(here.J[:, 1], 0.0), abs=1e-15)
    assert np.abs(here.J @ way - (there.F - was)[:-1]).max() > 1e-6  # the tangent alone did not


def test_from_far_off_a_run_a_step_leads_to_the_minimum_of_fresh_derivatives(problem):
    near = tangent(problem, TRUE)
    begun = at(linearised(near), TRUE + FAR), linearised(near)
    end, best = side_by_side(problem, [onward(here, GAIN * near.unit) for here in begun])
    assert len(end.axes) < 9
    assert end.value - best.value < 2 * GAIN * near.unit
    slope = tangent(problem, end.x).y @ tangent(problem, end.x).R
    assert np.all(np.abs(slope) < 0.1 * near.norms * np.sqrt(near.unit))


def test_where_a_run_fails_there_is_no_point(problem, monkeypatch):
    here = linearised(tangent(problem, TRUE))
    why = fracid.errors.Failure(fracid.errors.FailureReason.RUN, "why")
    monkeypatch.setattr(Problem, "all_errors", lambda _, points, **__: [why for _ in points])
    assert at(here, TRUE + FAR) is None
