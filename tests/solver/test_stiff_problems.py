"""Stiff problems of the literature: at order 1 against SciPy's Radau; at other orders two schemes against each other.

A run that does not reach the right end says so: none is completed at a wrong root.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fracid import Outcome, solve_fde


def falls(t, x, u, p, out):
    """A body in air, from rest to 0.3132 m/s within a step; the equation of a step has a second, negative root."""
    out[0] = 9.81 - 100 * x[0] * x[0]


def robertson(t, x, u, p, out):
    out[0] = -0.04 * x[0] + 1e4 * x[1] * x[2]
    out[2] = 3e7 * x[1] ** 2
    out[1] = -out[0] - out[2]


def van_der_pol(t, x, u, p, out):
    out[0], out[1] = x[1], 1e3 * (1 - x[0] ** 2) * x[1] - x[0]


def oregonator(t, x, u, p, out):
    out[0] = 77.27 * (x[1] + x[0] * (1 - 8.375e-6 * x[0] - x[1]))
    out[1] = (x[2] - (1 + x[0]) * x[1]) / 77.27
    out[2] = 0.161 * (x[0] - x[2])


def hires(t, x, u, p, out):
    out[0] = -1.71 * x[0] + 0.43 * x[1] + 8.32 * x[2] + 0.0007
    out[1] = 1.71 * x[0] - 8.75 * x[1]
    out[2] = -10.03 * x[2] + 0.43 * x[3] + 0.035 * x[4]
    out[3] = 8.32 * x[1] + 1.71 * x[2] - 1.12 * x[3]
    out[4] = -1.745 * x[4] + 0.43 * x[5] + 0.43 * x[6]
    out[5] = -280 * x[5] * x[7] + 0.69 * x[3] + 1.71 * x[4] - 0.43 * x[5] + 0.69 * x[6]
    out[6] = 280 * x[5] * x[7] - 1.81 * x[6]
    out[7] = -out[6]


PROBLEMS = {  # right-hand side, start, end [s], step [s] and the error that bdf2 may have at it, of the whole
    "a body that falls": (falls, [0.0], 5.0, 0.1, 1e-6),
    "Robertson": (robertson, [1.0, 0.0, 0.0], 40.0, 0.01, 1e-6),
    "van der Pol, μ 1000, before its jump": (van_der_pol, [2.0, 0.0], 500.0, 0.05, 1e-6),
    "Oregonator": (oregonator, [1.0, 2.0, 3.0], 360.0, 5e-3, 2e-3),
    "HIRES": (hires, [1.0, *[0.0] * 6, 0.0057], 321.6, 0.01, 1e-4),
}


@pytest.mark.few(1)
@pytest.mark.parametrize("problem", PROBLEMS)
def test_bdf2_ends_where_radau_does(problem):
    rhs, start, end, step, error = PROBLEMS[problem]

    def slope(t, x):
        out = np.zeros(len(x))
        rhs(t, x, None, None, out)
        return out

    want = solve_ivp(slope, (0, end), start, method="Radau", rtol=1e-9, atol=1e-12).y[:, -1]
    run = solve_fde(rhs, 1.0, start, step=step, end=end, method="bdf2")
    assert run.completed
    assert run.states[-1] == pytest.approx(want, rel=error, abs=1e-9)


@pytest.mark.few(2)
@pytest.mark.parametrize("order", [0.9, 1.1])
@pytest.mark.parametrize("problem", PROBLEMS)
def test_at_other_orders_two_schemes_meet_or_one_says_that_it_does_not_settle(problem, order):
    rhs, start, end, step, _ = PROBLEMS[problem]
    end = round(end / 10, 2)
    fine = solve_fde(rhs, order, start, step=step / 8, end=end, method="bdf2")
    assert fine.completed
    for method, parts in (("bdf2", 2), ("pi2-implicit", 8), ("pi2", 8)):  # the trapezoidal rule rings at longer ones
        run = solve_fde(rhs, order, start, step=step / parts, end=end, method=method)
        if method == "bdf2" or (run.completed and run.fault is None):
            assert run.states[-1] == pytest.approx(fine.states[-1], rel=5e-3, abs=1e-9)


@pytest.mark.parametrize("order", [1.0, 0.9, 0.7])
@pytest.mark.parametrize(("drag", "weight", "step"), [(100.0, 9.81, 0.1), (10.0, 100.0, 0.3), (30.0, 9.81, 0.3)])
@pytest.mark.parametrize("method", ["bdf2", "pi2-implicit"])
def test_newtons_method_stays_with_the_root_that_the_last_step_had(method, drag, weight, step, order):
    def drops(t, x, u, p, out):
        out[0] = p[1] - p[0] * x[0] * x[0]

    run = solve_fde(drops, order, [0.0], step=step, end=30 * step, parameters=[drag, weight], method=method)
    assert run.completed
    assert run.states.min() >= 0
    assert run.states[-1, 0] == pytest.approx(np.sqrt(weight / drag), rel=0.02)


@pytest.mark.parametrize("method", ["pi2", "pi3"])
def test_a_step_that_sweeps_lead_astray_ends_the_run_and_names_what_to_type(method):
    run = solve_fde(falls, 1.0, [0.0], step=0.1, end=5.0, method=method)
    assert run.outcome is Outcome.UNSETTLED
    assert run.time[-1] < 0.5
    assert run.fault.code in ("unsettled", "stiff")
    assert "a step of" in run.fault.sentence


def test_no_scheme_steps_over_a_pole():
    """x' = x², x(0) = 1 is 1/(1 − t): beyond 1 another branch begins, at −∞."""

    def explodes(t, x, u, p, out):
        out[0] = x[0] ** 2

    for method in ("pi2", "pi2-implicit", "pi3", "bdf2"):
        run = solve_fde(explodes, 1.0, [1.0], step=0.01, end=2.0, method=method)
        assert run.outcome is Outcome.UNSETTLED
        assert run.time[-1] == pytest.approx(1.0, abs=0.05)
