"""What an input does between its samples: held values, straight lines, multisines; early, late and filtered."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import gamma

from fracid import InputError, solve_fde
from fracid.solver.inputs import BETWEEN, between_samples, low_passed_steps
from fracid.solver.methods import METHODS

T, N = 0.05, 60
HELD = 10 * np.random.default_rng(1).standard_normal(N + 1)


def swing(t, x, u, p, out):
    out[0] = x[1]
    out[1] = -36 * np.sin(x[0]) - 0.4 * x[1] + u[0] * np.cos(x[0])


def exact(u):
    """The swing from sample to sample by an independent integrator, a value of u to each."""
    x = np.array([0.3, 0.0])
    states = [x]
    for value in u[:-1]:
        x = solve_ivp(lambda t, x, v: [x[1], -36 * np.sin(x[0]) - 0.4 * x[1] + v * np.cos(x[0])], (0, T), x, "DOP853",
                      args=(value,), rtol=1e-11, atol=1e-12).y[:, -1]  # fmt: skip
        states.append(x)
    return np.array(states)


SWING = exact(HELD)


def error(method, finer):
    """Of a swing whose input jumps at every sample."""
    u = np.repeat(HELD, finer)[: N * finer + 1]
    run = solve_fde(swing, 1.0, [0.3, 0.0], step=T / finer, end=N * T, inputs=u, between="hold", method=method)
    return abs(run.states[::finer] - SWING).max()


@pytest.mark.parametrize(("method", "order"), [("pi2", 2), ("pi2-implicit", 2), ("gl", 1), ("gl-sequential", 1)])
def test_a_held_input_keeps_the_convergence_order(method, order):
    errors = [error(method, finer) for finer in (32, 64)]
    assert abs(np.log2(errors[0] / errors[1]) - order) < 0.15


def test_every_method_takes_a_held_input():
    assert {name for name, method in METHODS.items() if method.at_a_jump == "mean"} == {"pi3", "bdf2"}
    assert error("pi3", 16) < 0.1


def steps(t, x, u, p, out):
    out[0] = u[0]


@pytest.mark.parametrize("order", [0.5, 0.8, 0.95, 1.0, 1.3])
def test_a_held_input_is_integrated_at_every_order(order):
    """D^q x = u: each jump adds (t − t_k)^q/Γ(q + 1)."""
    u, h = np.random.default_rng(2).standard_normal(201), 0.01
    t = h * np.arange(201)
    jumps = np.diff(u, prepend=0.0)
    expected = sum(j * np.maximum(t - at, 0) ** order for j, at in zip(jumps, t, strict=True)) / gamma(order + 1)
    initial = [[0.0, 0.0]] if order > 1 else [0.0]
    run = solve_fde(steps, order, initial, step=h, end=2.0, inputs=u, between="hold", memory="full")
    lines = solve_fde(steps, order, initial, step=h, end=2.0, inputs=u, memory="full")
    bound = 1e-12 + 0.18 * abs(1 - order) * h**order  # a jump moves some h^q in a step
    assert abs(run.states[:, 0] - expected).max() < bound
    assert abs(lines.states[:, 0] - expected).max() > 10 * bound


def test_without_jumps_nothing_changes_by_a_bit():
    u = np.full(101, 2.0)
    runs = [solve_fde(swing, 0.9, [0.3, 0.0], step=0.01, end=1.0, inputs=u, between=b).states for b in ("line", "hold")]
    assert np.array_equal(*runs)


def test_a_line_is_what_it_was():
    line = between_samples(HELD, "line", 0.0, 0.5, 2 * N + 1)
    assert line.jumps is None
    assert np.array_equal(line.before, np.interp(np.arange(2 * N + 1) / 2, np.arange(N + 1), HELD))


@pytest.mark.parametrize("late", [0.0, 0.3, 0.77, -0.41, 2.5])
@pytest.mark.parametrize("spacing", [1.0, 0.5])
def test_over_each_step_a_held_input_has_its_integral_and_its_first_moment(late, spacing):
    count = round(20 / spacing) + 1
    driven = between_samples(HELD[:21], "hold", -late, spacing, count)
    left, right = driven.after[:-1], driven.before[1:]
    s = (np.arange(20_000) + 0.5) / 20_000
    for n in range(count - 1):
        u = HELD[np.clip(np.floor(-late + spacing * (n + s)), 0, 20).astype(int)]
        assert np.mean(u) == pytest.approx((left[n] + right[n]) / 2, abs=2e-3)
        assert np.mean(u * (s - 0.5)) == pytest.approx((right[n] - left[n]) / 12, abs=2e-3)


def test_a_multisine_is_followed_between_its_samples():
    def sines(t):
        return sum(np.sin(2 * np.pi * f * t + f) for f in (0.013, 0.11, 0.31))  # of a rate of 1

    t = np.arange(400.0)
    for late, spacing in ((0.0, 1.0), (0.37, 0.5)):
        count = round(399 / spacing) + 1
        errors = {}
        for between in BETWEEN:
            driven = between_samples(sines(t), between, -late, spacing, count)
            middle = (driven.after[:-1] + driven.before[1:]) / 2
            places = -late + spacing * np.arange(count)
            primitive = sum(-np.cos(2 * np.pi * f * places + f) / (2 * np.pi * f) for f in (0.013, 0.11, 0.31))
            inner = slice(round(40 / spacing), round(360 / spacing))  # these repeat themselves after 1000 samples
            errors[between] = abs(middle - np.diff(primitive) / spacing)[inner].max()
        assert errors["band-limited"] < 2e-4
        assert errors["line"] > 100 * errors["band-limited"]
        ends = between_samples(sines(t), "band-limited", 0.0, 1.0, 400)
        assert abs(ends.after - sines(t)).max() < 0.7  # turned about its ends, it does not ring


def test_a_multisine_of_several_periods_is_exact_up_to_its_ends():
    t = np.arange(400.0)
    sines = sum(np.sin(2 * np.pi * f * t + f) for f in (0.02, 0.11, 0.31))  # a period of 100 samples
    driven = between_samples(sines, "band-limited", 0.0, 1.0, 400)
    primitive = sum(-np.cos(2 * np.pi * f * t + f) / (2 * np.pi * f) for f in (0.02, 0.11, 0.31))
    assert abs((driven.after[:-1] + driven.before[1:]) / 2 - np.diff(primitive)).max() < 2e-4


def test_a_filtered_input_is_what_an_integrator_makes_of_it():
    u, T1, h = np.array([0.0, 1.0, 1.0, -2.0, 0.5, 0.5]), 0.13, 0.1
    driven = low_passed_steps(between_samples(u, "hold", 0.0, 1.0, 6), h, T1)
    z, area = 0.0, []
    for value in u[:-1]:
        run = solve_ivp(lambda t, y, v: [(v - y[0]) / T1, y[0], y[1]], (0, h), (z, 0.0, 0.0), args=(value,), rtol=1e-11,
                        atol=1e-13)  # fmt: skip
        z, mean, twice = run.y[0, -1], run.y[1, -1] / h, run.y[2, -1] / h**2
        area.append((mean, 0.5 * mean - twice))  # ∫∫ = ½ m_0 − m_1 over a step
    left, right = driven.after[:-1], driven.before[1:]
    assert (left + right) / 2 == pytest.approx([a for a, _ in area], abs=1e-9)
    assert (right - left) / 12 == pytest.approx([b for _, b in area], abs=1e-9)


def test_an_unknown_way_between_samples_is_refused():
    with pytest.raises(InputError, match=r"unknown value of between 'held'.*did you mean hold"):
        solve_fde(swing, 1.0, [0.3, 0.0], step=0.1, end=1.0, inputs=np.zeros(11), between="held")
