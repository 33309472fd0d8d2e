"""States that relax: second order where the step resolves them, the sliding limit where it does not."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fracid.models.joints import presliding
from fracid.solver.solve import solve_fde


def bristle(t, x, u, p, out):
    """D z = cos t − a (1 + sin²t) z."""
    rate = p[0] * (1 + math.sin(t) ** 2)
    out[0] = math.cos(t) - rate * x[0]
    if len(out) > 1:
        out[1] = rate


def block(t, x, u, p, out):
    """A unit mass on presliding friction with Stribeck's, pulled by p[5] + p[6]·sin t and a spring."""
    friction = presliding(x, out, 2, x[1], p[0], p[1], p[2], p[3]) + p[4] * out[2]
    out[0] = x[1]
    out[1] = p[5] + p[6] * math.sin(t) - p[7] * x[0] - friction


def run(step, a=3.0, end=3.0, **options):
    return solve_fde(bristle, 1.0, [0.5], step=step, end=end, parameters=[a], relaxing=(0,), **options).states[:, 0]


@pytest.mark.few(2)
@pytest.mark.parametrize("a", [0.0, 1.0, 10.0])
def test_a_relaxing_state_converges_by_second_order(a):
    exact = solve_ivp(lambda t, z: np.cos(t) - a * (1 + np.sin(t) ** 2) * z, (0, 3), [0.5], rtol=1e-12, atol=1e-13)
    errors = [abs(run(h, a)[-1] - exact.y[0, -1]) for h in (0.02, 0.01)]
    assert 3.2 < errors[0] / errors[1] < 4.6


@pytest.mark.parametrize("a", [1e3, 1e6, 1e12])
def test_what_relaxes_within_a_step_follows_its_source(a):
    z, t = run(0.01, a), np.arange(301) * 0.01
    expected = np.cos(t) / (a * (1 + np.sin(t) ** 2))
    np.testing.assert_allclose(z[30:], expected[30:], atol=0.01 * expected.max())


def test_a_rate_of_zero_is_the_trapezoidal_rule():
    t = np.arange(301) * 0.01
    rule = 0.5 + np.concatenate([[0], np.cumsum(0.005 * (np.cos(t[1:]) + np.cos(t[:-1])))])
    np.testing.assert_allclose(run(0.01, 0.0), rule, atol=1e-13)


def test_it_moves_from_the_first_step_on_where_the_first_steps_are_solved_together():
    """Beside a state of order 1/2, for whose start that is done."""

    def rhs(t, x, u, p, out):
        out[0], out[1] = 1.0 - x[0], 1.0
        if len(out) > 2:
            out[2], out[3] = 0.0, 0.0

    x = solve_fde(rhs, [0.5, 1.0], np.zeros(2), step=0.01, end=1.0, relaxing=(1,)).states
    np.testing.assert_allclose(x[:, 1], np.arange(101) * 0.01, atol=1e-12)


def vessel(t, x, u, p, out):
    """Mixed with what flows in, at u[1]."""
    out[0] = u[0] * (u[1] - x[0])
    if len(out) > 1:
        out[1] = u[0]


@pytest.mark.parametrize("method", ["pi2", "pi2-implicit"])
def test_a_rate_that_jumps_with_its_input_is_that_after_the_jump(method):
    flow, inflow = np.tile(np.repeat([0.1, 1.0, 0.02, 0.5], 10), 2), np.repeat([300.0, 330.0, 290.0, 340.0], 20)
    exact = [310.0]
    for a, T in zip(flow, inflow, strict=True):
        exact.append(T + (exact[-1] - T) * math.exp(-0.5 * a))
    inputs = np.column_stack([np.append(u, u[-1]) for u in (flow, inflow)])
    found = solve_fde(vessel, 1.0, [310.0], step=0.5, end=40.0, inputs=inputs, between="hold", relaxing=(0,),
                      method=method)  # fmt: skip
    np.testing.assert_allclose(found.states[:, 0], exact, atol=0.3)


@pytest.mark.few(2)
@pytest.mark.parametrize("method", ["pi2", "pi2-implicit", "pi3"])
@pytest.mark.parametrize(("s", "sigma1"), [(0.0, 0.0), (0.5, 0.0), (0.5, 1.0)], ids=["Dahl", "Stribeck", "LuGre"])
def test_presliding_friction_agrees_with_an_implicit_integrator_of_scipys(method, s, sigma1):
    p = np.array([1.0, s, 0.2, 1e-2, sigma1, 0.0, 3.0, 2.0])
    out = np.zeros(3)

    def f(t, x):
        block(t, x, (), p, out)
        return out.copy()

    t = np.linspace(0, 3, 301)
    exact = solve_ivp(f, (0, 3), np.zeros(3), method="Radau", t_eval=t, rtol=1e-6, atol=1e-9, max_step=0.01)
    found = solve_fde(block, 1.0, np.zeros(3), step=1e-3, end=3.0, parameters=p, relaxing=(2,), method=method, every=10)
    np.testing.assert_allclose(found.states[:, 0], exact.y[0], atol=2e-3 * np.ptp(exact.y[0]))


def test_however_small_the_distance_is_a_coarse_step_finds_the_sliding_motion():
    """δ → 0 is Coulomb's friction: a block thrown at 2 m/s against 1 N stops after 2 s and 2 m, and stays."""
    for delta in (1e-3, 1e-5, 1e-6):
        p = np.array([1.0, 0.0, 0.2, delta, 0.1, 0.0, 0.0, 0.0])
        x = solve_fde(block, 1.0, [0.0, 2.0, delta], step=0.01, end=4.0, parameters=p, relaxing=(2,)).states
        assert x[-1, 0] == pytest.approx(2.0, abs=2e-3)


def test_a_joint_under_less_than_its_breakaway_torque_stands_still_for_an_hour():
    p = np.array([1.0, 0.2, 0.1, 1e-3, 5.0, 0.5, 0.0, 0.0])  # pulled by 0.5 N of the 1.2 that it takes
    x = solve_fde(block, 1.0, np.zeros(3), step=0.01, end=3600.0, parameters=p, relaxing=(2,), every=100).states
    assert np.ptp(x[60:, 0]) < 1e-9
    assert 0 < x[-1, 0] < 2e-3
