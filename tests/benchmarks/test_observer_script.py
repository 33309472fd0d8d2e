"""The twins of the observer's table are what their docstrings say, and the filter is as sure as it says."""

import numpy as np
import pytest

from scripts import module_of


@pytest.fixture(scope="module")
def table():
    """benchmarks/observer.py, which is no package."""
    return module_of("benchmarks/observer.py")


@pytest.mark.broad
def test_an_order_that_stands_is_fracids_pendulum(table):
    torque = table.TORQUE * np.random.default_rng(1).standard_normal((table.N, 1))
    problem = table.problem(np.zeros((table.N, 1)), torque, {"angle": 1.0})
    ours = problem.simulate(problem.start, problem.experiments[0]).states
    gravity, J, b = table.constants()
    order = np.full(table.N, table.MU)
    found = table.variable_order(order, table.STEP, torque[:, 0], gravity, J, b, np.array([1.0, 0.0]))
    assert np.all(np.abs(found - ours).max(axis=0) < 1e-3 * np.ptp(ours, axis=0))


@pytest.mark.broad
def test_the_filter_follows_an_order_that_drifts_and_knows_how_well(table):
    made, errors, off = table.of_fracid(slow={"mu": table.DRIFT}, initial={"mu": 0.01}), [], []
    for seed in range(1, 9):
        _, y, order = table.drifting_twin(seed)
        made.reset()
        track = made.run(y)
        at = np.arange(table.N // 4 - 1, table.N, table.N // 4)
        errors.extend((track.states["mu"][at] - order[at]) / track.deviations["mu"][at])
        off.append([np.mean((estimate - order) ** 2) for estimate in (track.states["mu"], table.MU)])
    assert 0.7 < np.sqrt(np.mean(np.square(errors))) < 1.35
    followed, stood = np.sqrt(np.mean(off, axis=0))
    assert followed < 0.8 * stood
