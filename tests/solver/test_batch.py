"""Many runs on threads are the runs one by one; derivatives are those of theory."""

import numpy as np
import pytest

from fracid.errors import InputError
from fracid.solver.batch import sensitivities, solve_fde_batch
from fracid.solver.solve import solve_fde
from oracles.derivatives import complex_step, gl, mittag_leffler_slopes, pi2
from oracles.problems import T1


def decay(t, x, u, p, out):
    out[0] = -p[0] * x[0]


@pytest.mark.few(2)
@pytest.mark.parametrize("jobs", [1, 2, 5, None])
def test_a_batch_is_its_runs_one_by_one(jobs):
    runs = [{"orders": q, "parameters": [k]} for q in (0.4, 0.9, 1.0, 1.3) for k in (0.5, 2.0)]
    common = {"initial": [1.0], "step": 0.01, "end": 2.0}
    together = solve_fde_batch(decay, runs, jobs=jobs, **common)
    for run, found in zip(runs, together, strict=True):
        np.testing.assert_array_equal(found.states, solve_fde(decay, **run, **common).states)


def test_an_empty_batch_has_no_runs():
    assert solve_fde_batch(decay, [], step=0.1, end=1.0) == []


@pytest.mark.parametrize(
    ("runs", "options", "message"),
    [
        ([{"orders": 0.5}, {"orders": 2.5}], {}, r"Run 1: orders\[0\] = 2.5"),
        ([{"orders": 0.5, "colour": 3}], {}, "Run 0: .*colour"),
        ([{"orders": 0.5}], {"jobs": 0}, "jobs = 0; expected a whole number, 1 or more"),
    ],
)
def test_a_wrong_run_is_told_with_its_number(runs, options, message):
    with pytest.raises(InputError, match=message):
        solve_fde_batch(decay, runs, initial=[1.0], parameters=[1.0], step=0.1, end=1.0, **options)


@pytest.mark.parametrize("q", [0.4, 0.8, 1.0, 1.3])
def test_the_derivatives_of_a_relaxation_are_those_of_the_mittag_leffler_function(q):
    step, rate = 1 / 256, 1.5
    initial = [1.0] if q <= 1 else [(1.0, 0.0)]
    found = sensitivities(decay, q, initial, parameters=[rate], step=step, end=4.0)
    for t in (0.5, 1.0, 4.0):
        n = round(t / step)
        y, by_order, by_rate = map(float, mittag_leffler_slopes(q, rate, t))
        assert found.run.states[n, 0] == pytest.approx(y, abs=2e-5)
        assert found.orders[n, 0, 0] == pytest.approx(by_order, abs=1e-4)
        assert found.parameters[n, 0, 0] == pytest.approx(by_rate, abs=2e-5)
        assert found.initial[n, 0, 0] == pytest.approx(y, abs=2e-5)  # the equation is linear


@pytest.mark.few(1)
@pytest.mark.parametrize(("method", "recursion"), [("gl", gl), ("pi2-implicit", pi2)])
@pytest.mark.parametrize("orders", [(0.95, 0.95), (0.8, 1.1), (1.0, 1.0)])
def test_the_derivatives_of_a_pendulum_are_those_of_its_recursion_by_complex_step(method, recursion, orders):
    def pendulum(t, x, u, p, out):
        out[0] = x[1]
        out[1] = -p[0] * np.sin(x[0]) - p[1] * x[1]

    step, steps, p, x0 = 0.02, 150, np.array([9.81, 0.2]), np.array([0.17, 0.0])
    found = sensitivities(pendulum, orders, x0, parameters=p, step=step, end=step * steps, method=method,
                          corrected=False, memory="full", jobs=2)  # fmt: skip
    q = np.array(orders)
    for i in range(2):
        by = {
            "orders": complex_step(lambda v: recursion(pendulum, v, x0, p, step, steps), q, i),
            "parameters": complex_step(lambda v: recursion(pendulum, q, x0, v, step, steps), p, i),
            "initial": complex_step(lambda v: recursion(pendulum, q, v, p, step, steps), x0, i),
        }
        for kind, exact in by.items():
            slope = getattr(found, kind)[:, :, i]
            np.testing.assert_allclose(slope, exact, atol=2e-7 * np.abs(exact).max(), err_msg=f"{kind}[{i}]")


def test_a_run_without_parameters_has_none_to_differentiate_by():
    found = sensitivities(T1.rhs, T1.orders, T1.initial, step=0.1, end=1.0)
    assert found.parameters.shape == (11, 1, 0)


def test_derivatives_of_runs_that_end_early_or_continue_another_are_refused():
    def explodes(t, x, u, p, out):
        out[0] = x[0] ** 2

    with pytest.raises(InputError, match=r"one ends early: (diverged|unsettled).*end it before t ="):
        sensitivities(explodes, 0.9, [2.0], step=1e-3, end=5.0, limit=1e6)
    with pytest.raises(InputError, match="history: a run that continues another"):
        sensitivities(decay, 0.9, [2.0], parameters=[1.0], step=1e-3, end=5.0, history=[[1.0]])
