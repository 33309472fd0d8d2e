"""A springpot that the model lacks is found from its first effect; friction of integer order is not taken for one."""

from dataclasses import replace

import numpy as np
import pytest

import fracid
from fracid.estimation.horizons import Watch, refined
from fracid.problem import Experiment, Free, Problem
from fracid.selection.claim import OrderFound, claim_of
from fracid.selection.fractional_element import SHARE, FractionalElement, fractional_element, scores
from fracid.signals.left_over import LeftOver

RIG = fracid.rotary_pendulum("srv02-rotpen")


def minimum(**truth):
    """A swing with 1e-4 rad of noise, fitted with viscous friction and the pendulum's order."""
    run = fracid.simulate(RIG, parameters=truth, orders={"lambda": 1.0, "mu": 1.0}, initial={"alpha": 0.5},
                          step=4e-3, end=6.0)  # fmt: skip
    y = run.states[:, [0, 2]] + 1e-4 * np.random.default_rng(1).standard_normal((len(run.time), 2))
    free = {"b_theta": Free(0.1, 0.0, 1.0), "b_alpha": Free(3e-4, 0.0, 0.1), "C4": Free(0.19, 0.1, 0.3)}
    swing = Experiment("twin", 4e-3, y, np.zeros((1, 1)))
    problem = Problem(RIG, (swing,), {"lambda": 1.0, "mu": Free(1.0, 0.5, 1.2)}, free, initial_state="estimate")
    return problem, refined(problem, problem.start, Watch()).best


@pytest.mark.broad
@pytest.mark.parametrize(
    ("name", "strength"), [("springpot_alpha", 2e-3), ("springpot_alpha", 2e-4), ("springpot_theta", 2e-2)]
)
def test_a_springpot_that_the_model_lacks_is_found_in_its_joint(name, strength):
    problem, best = minimum(**{name: strength, name.replace("springpot", "springpot_order"): 0.4})
    first = max(scores(problem, best.point), key=lambda s: s.share)
    assert first.name == name
    assert 0.3 < first.strength / strength < 3  # to first order
    element = fractional_element(problem, best)
    assert element.strength == pytest.approx(strength, rel=0.15)
    assert element.order == pytest.approx(0.4, abs=0.06)
    assert element.cost < 1.1e-4 < best.cost


@pytest.mark.broad
@pytest.mark.parametrize("truth", [{}, {"coulomb_alpha": 5e-4}, {"drag_alpha": 2e-4}])
def test_friction_of_integer_order_is_not_taken_for_a_springpot(truth):
    problem, best = minimum(**truth)
    assert fractional_element(problem, best) is None


@pytest.mark.broad
def test_a_springpot_must_beat_the_integer_order_alternative_too():
    problem, best = minimum(springpot_alpha=2e-4, springpot_order_alpha=0.4)
    cost = fractional_element(problem, best).cost
    assert fractional_element(problem, best, goal=cost / (1 - SHARE / 4)) is None


@pytest.mark.broad
def test_nothing_is_looked_for_where_the_model_has_a_springpot_already():
    problem, best = minimum()
    with_one = replace(problem, parameters={**problem.parameters, "springpot_alpha": Free(1e-4, 0.0, 1.0)})
    assert fractional_element(with_one, best) is None


def test_a_springpot_that_explains_the_residual_leaves_the_claim_undecided_and_says_what_to_type():
    element = FractionalElement("springpot_alpha", 2e-3, 0.34, 5e-4, 1.4e-3, -270.0)
    misfit = {"swing, alpha": LeftOver(4e-3, 2 * np.pi / 4096 / np.sqrt(12), 0.01)}
    claim = claim_of([OrderFound("mu", 1.001, 0.002)], None, misfit, element=element)
    assert claim.claim == "undecided"
    assert any("springpot_alpha = 0.002 of order 0.34" in reason for reason in claim.reasons)
    assert "springpot_order_alpha = { start = 0.34" in claim.reasons[-1]


@pytest.mark.broad
def test_a_rival_that_explains_two_springpots_no_better_is_no_evidence_against_fractional_orders():
    truth = {"springpot_theta": 1e-2, "springpot_alpha": 2e-3, "coulomb_theta": 1e-2, "coulomb_alpha": 3e-4}
    run = fracid.simulate(RIG, parameters=truth, orders={"lambda": 1.0, "mu": 1.0}, initial={"alpha": 1.3}, step=8e-3,
                          end=8.0)  # fmt: skip
    y = run.states[:, [0, 2]] + 5e-4 * np.random.default_rng(1).standard_normal((len(run.time), 2))
    inertias = {n: Free(5e-3, 1e-3, 0.03) for n in ("C1", "C3", "C6", "J_theta")}
    viscous = {"b_theta": Free(0.1, 0.0, 1.0), "b_alpha": Free(3e-4, 0.0, 0.1)}
    dry = {"coulomb_theta": Free(0.01, 0.0, 0.1), "coulomb_alpha": Free(1e-4, 0.0, 0.01)}
    orders = {"lambda": Free(1.0, 0.5, 1.2), "mu": Free(1.0, 0.5, 1.2)}
    swing = Experiment("twin", 8e-3, y, np.zeros((1, 1)))
    fit = fracid.identify(Problem(RIG, (swing,), orders, viscous | inertias | dry, initial_state="estimate"))
    assert fit.claim == "undecided"  # though its orders' wide intervals hold 1
    assert fit.alternative is None or any(trial.as_well for trial in fit.alternative.trials)
    assert not any("no evidence of fractional dynamics" in said for said in fit.warnings)
    assert not any("stand in for friction" in found.identifiable for found in fit.orders.values())
