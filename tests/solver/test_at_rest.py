"""An order above 1 has two initial values: the one that is not given is said to be taken as 0."""

import warnings

import numpy as np
import pytest

from fracid.solver.arguments import AtRestWarning
from fracid.solver.batch import sensitivities
from fracid.solver.solve import solve_fde


def decay(t, x, u, p, out):
    out[0] = -x[0]


def test_one_initial_value_for_an_order_above_one_is_told_with_what_to_type():
    with pytest.warns(AtRestWarning, match=r"State 0 of order 1\.3 starts at rest.*initial=\[\[2, 0\]\]"):
        told = solve_fde(decay, 1.3, [2.0], step=0.01, end=1.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        said = solve_fde(decay, 1.3, [(2.0, 0.0)], step=0.01, end=1.0)
        solve_fde(decay, 1.0, [2.0], step=0.01, end=1.0)
        sensitivities(decay, 1.0, [2.0], step=0.1, end=1.0)  # of neighbours on both sides of 1
    np.testing.assert_array_equal(told.states, said.states)
