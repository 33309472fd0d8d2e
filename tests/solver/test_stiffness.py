"""Why a run ended, and whether its step is short enough: each fault is made on purpose, and said with its number."""

import math

import mpmath
import numpy as np
import pytest

import fracid
from fracid.solver.methods import METHODS
from fracid.solver.stiffness import modes, too_long
from oracles.mittag_leffler import mittag_leffler

RIG = fracid.rotary_pendulum("srv02-rotpen")


def decay(t, x, u, p, out):
    out[0] = -p[0] * (x[0] - 1.0)


def growth(t, x, u, p, out):
    out[0] = p[0] * x[0]


def explosion(t, x, u, p, out):
    out[0] = p[0] * x[0] ** 2


def swing(t, x, u, p, out):
    out[0] = x[1]
    out[1] = -p[0] * x[0] - p[1] * x[1]


def divided(t, x, u, p, out):
    out[0] = -1.0 / max(x[0], 0.0)


def run(rhs, orders=1.0, initial=(1.0,), parameters=(1.0,), step=1e-2, end=10.0, **options):
    return fracid.solve_fde(rhs, orders, initial, parameters=parameters, step=step, end=end, **options)


@pytest.mark.few(3)
@pytest.mark.parametrize("method", ["gl", "gl-sequential", "pi3"])
@pytest.mark.parametrize("q", [0.7, 1.0])
def test_an_explicit_scheme_that_cannot_follow_says_its_stiffness(method, q):
    found = run(decay, q, [0.0], [1e5], method=method).fault
    assert found.code == "stiff"
    assert found.number == pytest.approx(1e5 * 1e-2**q, rel=1e-3)  # |J|h
    assert found.number > found.limit
    assert 'method = "pi2"' in found.sentence


@pytest.mark.parametrize("method", ["gl", "gl-sequential", "pi3"])
def test_with_the_step_that_it_asks_for_it_follows(method):
    found = run(decay, 0.9, [0.0], [1e3], method=method).fault
    shorter = float(found.sentence.split("a step of ")[1].split(" s")[0])
    again = run(decay, 0.9, [0.0], [1e3], method=method, step=shorter, end=10 * shorter)
    assert again.completed
    assert again.fault is None


@pytest.mark.parametrize("method", ["pi2", "pi2-implicit"])
def test_a_scheme_that_follows_stiff_systems_is_not_blamed(method):
    assert run(decay, 0.8, [0.0], [1e5], method=method).fault is None


@pytest.mark.parametrize("method", ["pi2", "pi2-implicit", "bdf2"])
@pytest.mark.parametrize(("rate", "rings"), [(30.0, False), (1e3, False), (1e5, True), (1e6, True)])
def test_a_fast_decay_that_the_trapezoidal_rule_carries_on_is_reported(method, rate, rings):
    ended = run(decay, 1.0, [0.0], [rate], method=method, end=5.0)
    wrong = np.abs(ended.states[20:, 0] - 1.0).max() > 0.01
    assert wrong == (rings and method != "bdf2")
    assert (ended.fault is not None) == wrong
    if wrong:
        assert ended.fault.code == "ringing"
        shorter = float(ended.fault.sentence.split("a step of ")[1].split(" s")[0])
        again = run(decay, 1.0, [0.0], [rate], method=method, step=shorter, end=500 * shorter)
        assert again.fault is None
        assert abs(again.states[-1, 0] - 1.0) < 1e-6


def limit_of_pi2(q):
    """h^q a at which x_n of D^q x = −a x begins to change its sign for ever, with mpmath's ζ."""
    return float(mpmath.gamma(q + 2) / (4 * (2 ** (q + 2) - 1) * mpmath.zeta(-q - 1)))


@pytest.mark.few(10)
@pytest.mark.parametrize("method", ["pi2", "pi2-implicit"])
@pytest.mark.parametrize("q", [1.01, 1.05, 1.2, 1.5, 1.8, 1.95])
@pytest.mark.parametrize("part", [0.5, 0.9, 0.97, 1.03, 1.1, 2.0, 10.0, 1e3])
def test_above_order_one_the_verdict_on_a_step_is_what_the_run_does(method, q, part):
    stiff = part * limit_of_pi2(q)
    ended = run(decay, q, [0.0], [stiff / 1e-2**q], end=40.0, method=method)
    last, middle = (float(np.abs(ended.states[k] - 1.0).max()) for k in (-1, len(ended.time) // 2))
    if part < 1:
        assert ended.completed
        assert ended.fault is None or ended.fault.code in ("coarse-steps", "ringing")
        assert last < 0.2
    else:
        assert last > 2 * min(middle, 1e50)
        assert ended.fault.code == "stiff"
        assert ended.fault.number == pytest.approx(stiff, rel=1e-3)
        assert ended.fault.limit == pytest.approx(limit_of_pi2(q), rel=0.06)
        assert 'method = "bdf2"' in ended.fault.sentence
        assert not ended.completed or last < 1e8


@pytest.mark.parametrize("q", [1.05, 1.5])
def test_above_order_one_the_step_and_the_method_that_are_asked_for_help(q):
    stiff = {"rhs": decay, "orders": q, "initial": [0.0], "parameters": [3e4]}
    found = run(**stiff).fault
    shorter = float(found.sentence.split("a step of ")[1].split(" s")[0])
    for better in (run(**stiff, step=shorter, end=5000 * shorter), run(**stiff, method="bdf2")):
        assert better.completed
        assert better.fault is None or better.fault.code in ("coarse-steps", "ringing")
        assert abs(better.states[-1, 0] - 1.0) < 1e-3


def logistic(t, x, u, p, out):
    out[0] = p[0] * x[0] * (1 - x[0])


@pytest.mark.parametrize("q", [1.0, 0.9])
def test_a_state_that_the_solution_leaves_within_a_step_is_told(q):
    coarse = run(logistic, q, [1e-2], [50.0], method="bdf2", step=0.1, end=5.0)
    assert coarse.fault.code == "coarse-steps"
    assert coarse.fault.number == pytest.approx(50 * 0.1**q, rel=1e-3)
    shorter = float(coarse.fault.sentence.split("a step of ")[1].split(" s")[0])
    fine = run(logistic, q, [1e-2], [50.0], method="bdf2", step=shorter, end=1.0)
    assert fine.fault is None
    assert fine.states[-1, 0] == pytest.approx(1.0, abs=1e-2)


@pytest.mark.parametrize("q", [1.0, 0.9])
def test_a_jump_between_the_samples_that_are_looked_at_is_looked_at(q):
    def diode(t, x, u, p, out):
        out[0] = -100.0 * (math.exp(x[0]) - 1.0) + math.sin(t)

    ended = run(diode, q, [-3.0], [], method="gl", step=0.1, end=5.0)
    assert ended.states[-1, 0] < -1e3  # beyond the bottom of an exponential
    assert ended.fault.code == "stiff"


@pytest.mark.parametrize("mu", [0.9, 1.05])
@pytest.mark.parametrize("b_alpha", [0.2, 0.5, 10.0])
def test_a_run_whose_sweeps_ran_away_is_no_blow_up_of_the_solution(mu, b_alpha):
    rig = {"orders": {"lambda": 1.0, "mu": mu}, "initial": {"alpha": 0.17}, "step": 1e-2, "end": 2.0}
    model = fracid.rotary_pendulum("qube-servo2", b_alpha=b_alpha)
    ended = fracid.simulate(model, **rig)
    assert not ended.completed
    assert ended.fault.code == "stiff"
    assert 'method = "bdf2"' in ended.fault.sentence
    solved = fracid.simulate(model, **rig, method="bdf2")
    assert solved.completed
    assert solved.fault is None


def test_a_step_that_no_number_of_parts_makes_short_enough_says_infinite():
    assert too_long("gl", np.array([1e-9]), [np.array([[-3e4]])], np.ones(1), 100).parts == np.inf


@pytest.mark.few(4)
@pytest.mark.parametrize("size", [1e10, 1e160, 1e300])
@pytest.mark.parametrize("order", [1e-50, 0.02, 1.0])
def test_rates_and_determinants_beyond_all_numbers_are_looked_at_as_far_as_there_are_numbers(size, order):
    linear = size * np.array([[0.0, 1.0], [-1.0, 0.0]])
    told = too_long("pi2", np.array([1.4, order]), [linear], np.ones(2), 100)
    assert told is None or told.parts > 1


def test_a_matrix_beyond_all_numbers_has_no_modes():
    assert modes(np.array([[1e308, -np.inf], [np.inf, 1e308]]), np.full(2, 1e10)).size == 0


def test_a_run_that_its_step_made_grow_is_not_called_completed():
    ended = run(decay, 1.05, [0.0], [3e4], end=5.0)
    assert np.abs(ended.states).max() > 1e10
    assert ended.outcome.name == "UNSTABLE"
    assert not ended.completed


@pytest.mark.parametrize("method", ["pi2", "pi2-implicit", "bdf2"])
def test_a_solution_that_grows_above_order_one_is_not_blamed_on_the_step(method):
    ended = run(growth, 1.3, [1.0], [3.0], end=200.0, method=method)
    assert ended.fault.code == "runs-away"


@pytest.mark.parametrize("rate", [1e2, 1e5])
def test_the_limit_holds_for_a_system_of_mixed_orders(rate):
    """x' = v, D^1.2 v = −9 x − rate v: what is stiff is of order 1.2."""
    ended = run(swing, (1.0, 1.2), [1.0, 0.0], [9.0, rate])
    unstable = rate * 1e-2**1.2 > limit_of_pi2(1.2)
    assert (ended.fault is not None and ended.fault.code == "stiff") == unstable
    assert (not ended.completed) == unstable
    assert run(swing, (1.0, 1.2), [1.0, 0.0], [9.0, rate], method="bdf2").fault is None


@pytest.mark.few(15)
@pytest.mark.parametrize("method", ["gl", "gl-sequential"])
@pytest.mark.parametrize("q", [0.001, 0.01, 0.05, 0.09, 0.15])
@pytest.mark.parametrize("size", [0.5, 0.9, 0.97])
def test_an_explicit_scheme_of_low_order_says_how_many_samples_it_loses(method, q, size):
    ended = run(decay, q, [0.0], [size / 1e-2**q], method=method)
    exact = 1 - mittag_leffler(q, -size / 1e-2**q * ended.time**q)
    wrong = np.flatnonzero(np.abs(ended.states[:, 0] - exact) > 0.01)[-1]
    if q < 0.1:
        assert ended.fault.code == "low-order"
        assert ended.fault.number == pytest.approx(wrong, rel=0.15, abs=1.5)
        assert 'method = "pi2"' in ended.fault.sentence
    else:
        assert ended.fault is None
    assert run(decay, q, [0.0], [size / 1e-2**q]).fault is None


@pytest.mark.parametrize("method", ["pi2", "gl", "pi3"])
@pytest.mark.parametrize(("rhs", "rate"), [(explosion, 1.0), (growth, 3.0)])
def test_a_blow_up_in_finite_time_is_told_from_exponential_growth(method, rhs, rate):
    ended = run(rhs, 0.9, [1.0], [rate], end=200.0, method=method)
    assert not ended.completed
    code = "runs-away" if rhs is growth else "blow-up" if method == "gl" else "unsettled"
    assert ended.fault.code == code
    assert ("if that ends at the same time" if code == "unsettled" else "short enough") in ended.fault.sentence


def test_the_time_of_a_blow_up_is_that_of_the_equations():
    """x' = x², x(0) = 1 is 1/(1 − t)."""
    ends = [run(explosion, step=h).fault.number for h in (1e-2, 1e-3, 1e-4)]
    assert np.all(np.diff(np.abs(np.array(ends) - 1.0)) < 0)
    assert ends[-1] == pytest.approx(1.0, abs=1e-3)


def test_the_time_in_which_a_solution_doubles_is_that_of_the_equations():
    found = run(growth, parameters=[3.0], end=200.0).fault
    assert found.number == pytest.approx(np.log(2) / 3, rel=0.15)


@pytest.mark.parametrize(("orders", "alpha"), [((0.7, 1.4), 0.17), ((0.6, 1.5), 0.17), ((0.6, 1.5), 1.6)])
def test_a_rig_at_orders_that_no_rig_has_blows_up_and_says_when(orders, alpha):
    def at(step):
        return fracid.simulate(
            RIG, orders=dict(zip(("lambda", "mu"), orders, strict=True)), initial={"alpha": alpha}, step=step, end=20.0
        ).fault

    coarse, fine = at(2e-3), at(1e-3)
    assert coarse.code == fine.code == "unsettled"
    assert coarse.number == pytest.approx(fine.number, rel=0.01)  # not the step's doing


@pytest.mark.parametrize("steps", [6.0, 12.0, 19.0, 21.0, 100.0])
def test_the_steps_for_each_period_are_counted(steps):
    step = 2 * np.pi / 3 / steps
    found = run(swing, 1.0, [1.0, 0.0], [9.0, 0.1], step=step, end=200 * step).fault
    if steps > 20:
        assert found is None
    else:
        assert found.code == "coarse-steps"
        assert found.number == pytest.approx(steps, rel=0.01)


def test_a_division_by_zero_is_told_with_its_time():
    found = run(divided, initial=[1.0], step=1e-3, end=2.0).fault
    assert found.code == "unsettled"
    assert found.number == pytest.approx(0.5, abs=0.01)  # x² = 1 − 2t: no step leads to where it ends


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.filterwarnings("ignore:gl-paper")
def test_a_good_run_has_no_fault(method):
    good = fracid.simulate(
        RIG, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.2}, step=1e-3, end=2.0, method=method
    )
    assert good.fault is None


def test_leaving_ones_own_bounds_is_no_fault():
    left = run(growth, bounds=[(-10.0, 10.0)])
    assert left.outcome.name == "LEFT"
    assert left.fault is None
