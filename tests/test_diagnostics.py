"""The cost over the plane of the orders."""

import numpy as np
import pytest

import fracid
from fracid.diagnostics import cost_plane
from fracid.errors import InputError
from fracid.problem import Experiment, Free, Problem

RIG = fracid.rotary_pendulum("srv02-rotpen")
FREE = {"lambda": Free(1.0, 0.5, 1.2), "mu": Free(1.0, 0.5, 1.2)}


def problem(orders=FREE, **options):
    run = fracid.simulate(RIG, orders=[0.9, 0.9, 0.95, 0.95], initial={"alpha": 0.4}, step=5e-3, end=1.0)
    swing = Experiment("swing", 5e-3, run.states[:, [0, 2]], np.zeros((1, 1)), initial={"theta": 0.0, "alpha": 0.4})
    return Problem(RIG, (swing,), orders, initial_state="held", **options)


def test_the_plane_has_the_cost_at_each_of_its_points_and_the_centre_is_one_of_them():
    p = problem()
    plane = cost_plane(p, np.array([0.9, 0.95]), points=7, reach=0.12)
    assert plane.names == ("lambda", "mu")
    i, j = np.unravel_index(np.argmin(plane.cost), plane.cost.shape)
    assert (plane.first[i], plane.second[j], plane.cost[i, j]) == (0.9, 0.95, 0.0)
    assert plane.cost[1, 5] == p.cost(np.array([plane.first[1], plane.second[5]]))
    assert (plane.first[0], plane.first[-1]) == (pytest.approx(0.78), pytest.approx(1.02))


@pytest.mark.parametrize("centre", [(0.5, 1.2), (1.2, 0.5), (1.19, 0.51)])
def test_the_plane_stays_within_the_bounds_and_grows_steadily(centre):
    plane = cost_plane(problem(), np.array(centre), points=9)
    for axis, middle in zip((plane.first, plane.second), centre, strict=True):
        assert len(axis) == 9
        assert middle in axis
        assert np.all(np.diff(axis) > 0)
        assert 0.5 <= axis[0] < axis[-1] <= 1.2


def test_other_unknowns_stay_where_they_are_and_jobs_change_nothing():
    p = problem(parameters={"C1": Free(4e-3, 1e-3, 1e-2)})
    x = np.array([0.9, 0.95, 5e-3])
    one, three = (cost_plane(p, x, points=3, jobs=jobs) for jobs in (1, 3))
    assert np.array_equal(one.cost, three.cost)
    assert one.cost[1, 1] == p.cost(x)


def test_where_a_run_fails_the_plane_is_infinite():
    plane = cost_plane(problem(parameters={"C3": 0.1}), np.array([0.9, 0.95]), points=3)
    assert np.all(np.isinf(plane.cost))


def test_a_plane_needs_two_free_orders():
    with pytest.raises(InputError, match="needs two free orders"):
        cost_plane(problem({"lambda": 0.9, "mu": FREE["mu"]}), np.array([0.95]))
