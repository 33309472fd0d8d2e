"""Each part of a problem on its own: x to values, values to a run, errors to a cost."""

import math

import numpy as np
import pytest

import fracid
from fracid.errors import InputError
from fracid.problem import Experiment, Free, Prior, Problem, Tied

RIG = fracid.rotary_pendulum("srv02-rotpen")
STEP = 4e-3


def still(name, **options):
    return Experiment(name, STEP, np.tile([0.1, 0.3], (50, 1)), np.zeros((1, 1)), **options)


def problem(*experiments, **options):
    orders = {"lambda": Free(0.9, 0.5, 1.2), "mu": Tied("lambda")}
    constants = {"theta_rest": Free(0.0, -1.0, 1.0), "C1": Free(4e-3, 1e-3, 1e-2)}
    return Problem(RIG, experiments, orders, constants, ("theta_rest",), initial_state="rest", **options)


def test_every_unknown_comes_back_from_the_values_that_the_parametrisation_unpacks():
    parametrisation = problem(still("a"), still("b", release_time=Free(0.0, -0.02, 0.02)))
    x = np.linspace(parametrisation.space.lower, parametrisation.space.upper, 5)[1]
    back = dict.fromkeys(parametrisation.names)
    for e in parametrisation.experiments:
        values = parametrisation.unpack(x, e)
        named = {
            "order": dict(zip(RIG.orders, values.orders, strict=True)),
            "parameter": dict(zip(RIG.parameter_names, values.parameters, strict=True)),
            "initial": dict(zip(RIG.states, values.initial, strict=True)),
            "time": {"release_time": values.release},
        }
        back |= {u.name: named[u.kind][u.target] for u in parametrisation.unknowns if u.experiment in (None, e.name)}
        assert named["order"]["mu"] == named["order"]["lambda"]
    assert list(back.values()) == x.tolist()


def test_the_simulator_runs_what_simulate_does_to_the_bit():
    (e,) = (p := problem(still("a"), method="gl", substeps=2)).experiments
    orders, constants, initial, _ = p.unpack(p.start, e)
    run = fracid.simulate(
        RIG.with_parameters(**dict(zip(RIG.parameter_names, constants.tolist(), strict=True))),
        orders={"lambda": orders[0], "mu": orders[2]}, initial=dict(zip(RIG.states, initial.tolist(), strict=True)),
        step=STEP / 2, end=49 * STEP, method="gl", memory=p.memory,
    )  # fmt: skip
    assert np.array_equal(p.simulate(p.start, e).states, run.states)
    assert np.array_equal(p.fitted(p.start, e), run.states[::2, [0, 2]])


@pytest.mark.parametrize(("z", "cost"), [(0.0, 5.0), (2.0, 5.0 * np.sqrt(1 + 4 / 200))])
def test_the_criterion_is_the_root_mean_square_of_all_recordings_with_the_prior_on_top(z, cost):
    rest = Free(0.0, -1.0, 1.0, Prior(0.0, 0.1))
    p = Problem(RIG, (still("a"), still("b")), {"lambda": 0.9, "mu": 0.9}, {"theta_rest": rest}, initial_state="held")
    evaluation = p.criterion(np.array([0.1 * z]), [np.full((50, 2), 1.0), np.full((50, 2), 7.0)])
    assert evaluation.cost == pytest.approx(cost)
    assert np.sqrt(np.sum(evaluation.residuals**2) / 2) == pytest.approx(cost)


@pytest.mark.parametrize("step", [math.nan, math.inf, 0.0, -0.01, "0.01", None])
def test_a_step_that_no_clock_has_is_refused(step):
    with pytest.raises(InputError, match=r"a: step = .* is not possible; expected a number of seconds above 0"):
        Experiment("a", step, np.zeros((9, 1)), np.zeros((1, 1)))
