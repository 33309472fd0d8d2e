"""The costs against closed forms and an independent quadrature; their rows against the costs; users' own."""

import math
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.optimize import least_squares, linprog

from fracid.errors import InputError
from fracid.problem.costs import COSTS, HUBER, SMOOTH, Cost, cost_from_name

every = pytest.mark.parametrize("name", COSTS)
ABSOLUTE = ("iae", "itae")
TIME = np.linspace(0.0, 4.0, 401)
residuals = st.lists(st.floats(-10, 10), min_size=2, max_size=30)


def column(values):
    return np.asarray(values, dtype=float).reshape(-1, 1)


def grid(n):
    return np.linspace(0.0, 3.0, n)


def wave(t):
    return 0.3 * np.exp(-0.4 * t) * np.cos(3.0 * t)


# --- values ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("rmse", 0.5),
        ("ise", 4 * 0.25),
        ("iae", 4 * 0.5),
        ("itse", 8 * 0.25),
        ("itae", 8 * 0.5),
        ("huber", HUBER * (2 * 0.5 - HUBER)),
    ],
)
def test_a_constant_residual_of_half_a_radian_over_four_seconds_costs(name, value):
    assert COSTS[name].value(TIME, np.full((401, 1), 0.5)) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "integrand"),
    [
        ("ise", lambda t: wave(t) ** 2),
        ("iae", lambda t: abs(wave(t))),
        ("itse", lambda t: t * wave(t) ** 2),
        ("itae", lambda t: t * abs(wave(t))),
    ],
)
def test_the_integrals_are_those_of_an_adaptive_quadrature(name, integrand):
    kinks = [(k + 0.5) * math.pi / 3.0 for k in range(4)]
    assert COSTS[name].value(TIME, column(wave(TIME))) == pytest.approx(
        quad(integrand, 0.0, 4.0, points=kinks)[0], rel=1e-3
    )


def test_an_uneven_time_axis_weighs_by_its_intervals():
    time = np.array([0.0, 1.0, 4.0])
    assert COSTS["iae"].value(time, column([2.0, 2.0, 4.0])) == 2.0 + 9.0
    assert COSTS["itae"].value(time, column([2.0, 2.0, 4.0])) == 1.0 + 0.5 * 3 * (2 + 16)


def test_huber_is_the_square_below_one_degree_and_its_tangent_above():
    def cost(e):
        return COSTS["huber"].value(grid(2), column([e, e]))

    assert pytest.approx(math.radians(1.0)) == HUBER
    assert cost(0.5 * HUBER) == pytest.approx((0.5 * HUBER) ** 2)
    assert cost(HUBER) == pytest.approx(HUBER**2)
    slope = (cost(3 * HUBER) - cost(2 * HUBER)) / HUBER
    assert slope == pytest.approx(2 * HUBER)


@every
@given(values=residuals)
def test_a_cost_is_zero_or_more_blind_to_the_sign_and_grows_with_the_residual(name, values):
    cost, e = COSTS[name], column(values)
    value = cost.value(grid(len(e)), e)
    assert value >= 0.0
    assert cost.value(grid(len(e)), -e) == value
    assert cost.value(grid(len(e)), 1.5 * e) >= value
    assert cost.value(grid(len(e)), 0 * e) == 0.0


@every
def test_two_outputs_add_up_and_the_mean_square_is_over_both(name):
    one, two = wave(TIME), 0.2 * np.sin(TIME)
    alone = [COSTS[name].value(TIME, column(e)) for e in (one, two)]
    both = COSTS[name].value(TIME, np.column_stack([one, two]))
    assert both == pytest.approx(math.sqrt(np.mean(np.square(alone))) if name == "rmse" else sum(alone), rel=1e-12)


@every
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_residual_that_is_not_finite_costs_infinity(name, bad):
    assert COSTS[name].value(grid(3), column([0.0, bad, 0.0])) == math.inf


@every
def test_a_huge_residual_costs_a_lot_but_is_never_nan(name):
    value = COSTS[name].value(grid(3), column([1e200] * 3))
    assert value > 1e190
    rows = COSTS[name].rows(grid(3), column([1e200] * 3))
    assert not np.any(np.isnan(rows))


# --- several recordings ----------------------------------------------------------------------------


def test_the_rmse_of_two_recordings_is_that_of_all_their_samples():
    first, second = column(wave(TIME)), column(wave(TIME[:101]) + 0.1)
    apart = [COSTS["rmse"].value(TIME[: len(e)], e) for e in (first, second)]
    together = math.sqrt(np.mean(np.concatenate([first, second]) ** 2))
    assert COSTS["rmse"].join(apart, [401, 101]) == pytest.approx(together, rel=1e-12)


def test_the_huber_cost_of_two_parts_is_that_of_all_their_samples():
    e = column(wave(TIME))
    parts = [COSTS["huber"].value(TIME[at], e[at]) for at in (slice(100), slice(100, None))]
    assert COSTS["huber"].join(parts, [100, len(e) - 100]) == pytest.approx(COSTS["huber"].value(TIME, e), rel=1e-12)


@pytest.mark.parametrize("name", [n for n in COSTS if not COSTS[n].per_sample])
def test_integrals_of_two_recordings_add_up(name):
    assert COSTS[name].join([1.0, 2.5], [10, 999]) == 3.5


@every
def test_one_failed_recording_fails_the_whole(name):
    assert COSTS[name].join([1.0, math.inf], [10, 10]) == math.inf


# --- rows for least squares ------------------------------------------------------------------------


@every
@given(values=residuals)
def test_the_squares_of_the_rows_add_up_to_the_cost(name, values):
    cost, e = COSTS[name], column(values)
    time = grid(len(e))
    rows, value = cost.rows(time, e), cost.value(time, e)
    assert rows.shape == (len(e),)
    total = math.sqrt(rows @ rows) if name == "rmse" else rows @ rows
    slack = SMOOTH * COSTS[name].value(time, np.ones_like(e)) if name in ABSOLUTE else 1e-12 * value
    assert value - slack - 1e-12 * value <= total <= value + 1e-12 * value + 1e-300


@every
def test_a_row_has_the_sign_of_its_residual_and_grows_with_it(name):
    e = column(np.concatenate([-np.logspace(0, -14, 40), [0.0], np.logspace(-14, 0, 40)]))
    rows = COSTS[name].rows(np.full(81, 2.0) + np.linspace(0, 1, 81), e) / np.sqrt(
        np.r_[0.5, np.ones(79), 0.5] if name not in ("rmse", "huber") else np.ones(81)
    )
    np.testing.assert_array_equal(np.sign(rows), np.sign(e.ravel()))
    if name not in ("itse", "itae"):  # those also grow with time
        assert np.all(np.diff(rows) > 0)


@every
def test_rows_of_two_outputs_are_as_many_as_samples_times_outputs(name):
    assert COSTS[name].rows(TIME, np.ones((401, 2))).shape == (802,)


@pytest.mark.parametrize("name", ABSOLUTE)
def test_least_squares_on_the_rows_finds_the_minimum_that_a_linear_program_finds(name):
    rng = np.random.default_rng(3)
    time = np.linspace(0.0, 2.0, 60)
    measured = 0.3 + 0.2 * time + 0.05 * rng.standard_t(2, 60)
    basis = np.column_stack([np.ones(60), time])
    weight = np.r_[0.5, np.ones(58), 0.5] * (time if name == "itae" else 1.0)
    exact = linprog(  # min Σ w·u subject to −u ≤ measured − basis·x ≤ u
        np.concatenate([[0.0, 0.0], weight]),
        A_ub=np.block([[basis, -np.eye(60)], [-basis, -np.eye(60)]]),
        b_ub=np.concatenate([measured, -measured]),
        bounds=[(None, None)] * 2 + [(0, None)] * 60,
    ).x[:2]

    def rows(x):
        return COSTS[name].rows(time, column(measured - basis @ x))

    found = least_squares(rows, [0.0, 0.0], x_scale=0.1, max_nfev=300).x
    np.testing.assert_allclose(found, exact, atol=1e-3)
    cost = [COSTS[name].value(time, column(measured - basis @ x)) for x in (found, exact)]
    assert cost[0] == pytest.approx(cost[1], rel=1e-4)


@every
def test_the_derivative_and_the_curvature_of_a_loss_are_those_of_its_values(name):
    loss = COSTS[name].loss
    e, h = np.array([-0.3, -0.004, 0.002, 0.1]), 1e-7
    np.testing.assert_allclose(loss.psi(e), (loss.rho(e + h) - loss.rho(e - h)) / (2 * h), rtol=1e-6, atol=1e-8)
    noise = np.random.default_rng(1).normal(0.0, 0.02, 400_000)
    h = 2e-3  # Σρ″ from the mean of ρ, shifted: for |e| the one way to see it
    curved = np.mean(loss.rho(noise + h) - 2 * loss.rho(noise) + loss.rho(noise - h)) / h**2
    assert loss.curvature(noise, noise) == pytest.approx(curved, rel=0.08 if loss.centre == "median" else 0.02)


# --- by name ---------------------------------------------------------------------------------------

OWN = "import numpy as np\n\nLIMIT = 3\n\ndef peak(time, residual):\n    return np.max(np.abs(residual))\n"


def test_every_cost_is_found_by_its_own_name():
    assert {name: cost_from_name(name) for name in COSTS} == COSTS
    assert all(cost.name == name for name, cost in COSTS.items())


def test_code_of_a_file_does_not_travel(tmp_path):
    (tmp_path / "my.py").write_text("def peak(t, r):\n    return abs(r).max()\n", encoding="utf-8")
    with pytest.raises(InputError, match="which other processes do not have: type --executor threads"):
        pickle.dumps(cost_from_name(f"{tmp_path / 'my.py'}:peak"))


def test_a_users_function_is_a_cost_like_any_other_but_has_no_rows(tmp_path):
    (tmp_path / "my.py").write_text(OWN)
    cost = cost_from_name(f"{tmp_path / 'my.py'}:peak")
    assert cost.name == "peak"
    assert cost.value(grid(3), column([0.0, -0.7, 0.1])) == 0.7
    assert cost.value(grid(3), column([0.0, np.nan, 0.1])) == math.inf
    assert cost.rows(grid(3), column([0.0, -0.7, 0.1])) is None
    assert cost.join([1.0, 2.0], [5, 5]) == 3.0


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("itea", r"unknown cost 'itea': did you mean it.e.*The known ones are rmse, .*my.py:function"),
        ("RMSE", "unknown cost 'RMSE'.*rmse"),
        ("", "unknown cost ''; the known ones are rmse"),
        ("my.py", "unknown cost 'my.py'"),
        ("nowhere.py:peak", "there is no file nowhere.py"),
    ],
)
def test_a_name_that_is_none_is_told(name, message):
    with pytest.raises(InputError, match=message):
        cost_from_name(name)


@pytest.mark.parametrize(
    ("text", "function", "message"),
    [
        (OWN, "peek", "unknown name in .*my.py 'peek': did you mean peak"),
        (OWN, "LIMIT", "is 3; expected a function of time and residual"),
        ("", "peak", "unknown name in .*my.py 'peak'"),
        ("def peak(:\n", "peak", r"my.py, line 1, does not run: SyntaxError"),
        (
            "import no_such_module\n",
            "peak",
            "my.py, line 1, does not run: ModuleNotFoundError: .*'no_such_module'",
        ),
    ],
)
def test_a_file_without_the_function_is_told(tmp_path, text, function, message):
    (tmp_path / "my.py").write_text(text)
    with pytest.raises(InputError, match=message):
        cost_from_name(f"{tmp_path / 'my.py'}:{function}")


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (
            lambda time: 1.0,
            r"mine fails: TypeError: .*takes 1 positional argument but 2 were given. It gets time",
        ),
        (lambda time, residual: None, "mine fails: TypeError: .* must return one number"),
        (lambda time, residual: residual, "mine fails: TypeError: .* must return one number"),
        (lambda time, residual: 1 / 0, "mine fails: ZeroDivisionError: division by zero"),
        (lambda time, residual: math.nan, "mine gave nan for a finite residual; return a number, or inf"),
        (lambda time, residual: -math.inf, "mine gave -inf for a finite residual"),
    ],
)
def test_a_users_function_that_gives_no_number_is_told(function, message):
    with pytest.raises(InputError, match=message):
        Cost("mine", function=function).value(grid(3), column([1.0, 2.0, 3.0]))


def test_a_users_function_may_refuse_by_infinity():
    assert Cost("mine", function=lambda time, residual: math.inf).value(grid(2), column([0.0, 0.0])) == math.inf
