"""Walks side by side come to what each comes to alone."""

from dataclasses import replace

import numpy as np
import pytest

import fracid
from fracid.errors import Failure
from fracid.estimation.side_by_side import side_by_side
from fracid.problem import Experiment, Free, Problem

RIG = fracid.rotary_pendulum("srv02-rotpen", zero="hanging")


@pytest.fixture(scope="module")
def problem():
    swing = Experiment("swing", 5e-3, np.zeros((401, 2)), np.zeros((1, 1)), initial={"alpha": 0.5})
    free = {"C6": Free(4e-3, 1e-3, 1e4), "b_alpha": Free(1e-4, 0.0, 1.0)}
    return Problem(RIG, (swing,), {"lambda": 0.9, "mu": Free(0.95, 0.5, 1.2)}, free, initial_state="held")


def sizes(x, steps):
    """How large the errors are after so many steps of a percent, and where a run fails before."""
    found = []
    for k in range(steps):
        errors = yield x * (1 + 0.01 * k)
        found.append(str(errors) if isinstance(errors, Failure) else float(np.sum(errors[0] ** 2)))
    return found


@pytest.mark.parametrize("jobs", [1, 3])
@pytest.mark.parametrize("together", [False, True])
def test_walks_of_any_length_come_to_what_each_comes_to_alone(problem, jobs, together):
    p = replace(problem, together=together)
    x = p.start
    runs_away = x * np.where(np.array(p.names) == "b_alpha", -1e6, 1.0)
    lengths = {0: x, 1: x, 4: 1.02 * x, 2: runs_away, 3: 0.99 * x}
    alone = [side_by_side(p, [sizes(begin, steps)])[0] for steps, begin in lengths.items()]
    beside = side_by_side(p, [sizes(begin, steps) for steps, begin in lengths.items()], jobs=jobs)
    assert [len(found) for found in beside] == [0, 1, 4, 2, 3]
    for one, other in zip(alone, beside, strict=True):
        assert all(b == pytest.approx(a, rel=1e-9) if isinstance(a, float) else b == a
                   for a, b in zip(one, other, strict=True))  # fmt: skip
    assert any(isinstance(found, str) for found in beside[3])
    assert side_by_side(p, [], jobs=jobs) == []
