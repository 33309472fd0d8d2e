"""What of integer order explains recordings as well as orders do: each is found by name where it is the truth."""

import math
from dataclasses import replace

import numpy as np
import pytest

import fracid
from fracid.estimation.horizons import Watch, refined
from fracid.estimation.windows import in_parts
from fracid.problem import Experiment, Free, Problem
from fracid.problem.sensors import Sensor
from fracid.selection.bic import STRONG
from fracid.selection.integer_alternatives import (
    ELEMENTS,
    _inputs,
    _on_the_same_samples,
    _tried,
    fitted_with,
    integer_alternatives,
)
from fracid.selection.integer_rival import Rival, claimable, integer_rival
from twins import release

RIG = fracid.rotary_pendulum("srv02-rotpen")
BOTH = {"lambda": Free(1.0, 0.5, 1.2), "mu": Free(1.0, 0.5, 1.2)}
FRICTION = {"b_theta": 2e-3, "b_alpha": 2e-4, "coulomb_theta": 1e-3, "coulomb_alpha": 2e-4}
SURE = {"lambda": 1e-4, "mu": 1e-4}


def swing(orders=(1.0, 1.0), more=None, *, end=4.0):
    """A release with all of that friction and noise of half an encoder's step."""
    return release(orders=dict(zip(BOTH, orders, strict=True)), parameters=FRICTION | (more or {}), alpha=0.5,
                   step=4e-3, end=end, noise=8e-4, seed=1)  # fmt: skip


def fitted(twin, more=None, **options):
    """The problem with all friction free, and its minimum."""
    free = {n: Free(v, 0.0, 100 * v) for n, v in FRICTION.items()} | (more or {})
    problem = Problem(RIG, (twin,), **{"orders": BOTH, "parameters": free, "initial_state": "held"} | options)
    return problem, refined(problem, problem.start, Watch()).best


def late(twin, samples):
    """α is read some samples after θ."""
    theta, alpha = twin.measured.T
    return replace(twin, measured=np.column_stack([theta[samples:], alpha[:-samples]]))


@pytest.mark.broad
@pytest.mark.few(1)
def test_a_signal_that_comes_late_is_found_in_place_of_the_orders():
    problem, best = fitted(late(swing(), 2), initial_state="estimate")
    nearest = integer_alternatives(problem, best, SURE, slow=False)
    assert nearest.trials[0].name == "the same model"
    assert not nearest.trials[0].as_well
    assert (nearest.trials[-1].name, nearest.trials[-1].as_well) == ("a delay of alpha", True)
    assert nearest.parameters["delay_alpha"] == pytest.approx(8e-3, rel=0.1)
    assert "The integer-order model with a delay of alpha (delay_alpha = 0.0" in nearest.warning


@pytest.mark.broad
def test_no_element_makes_a_model_worse_than_it_was_without():
    problem, best = fitted(swing((0.9, 0.95)))
    here = integer_rival(problem, best, SURE)
    elements = [e for change in ELEMENTS for e in change(here.problem) if e.off]
    assert len(elements) > 8
    worse = {e.name: fitted_with(e, here, 0.0).evaluation.cost / here.evaluation.cost for e in elements}
    assert {name: ratio for name, ratio in worse.items() if ratio > 1 + 1e-3} == {}


@pytest.mark.broad
def test_orders_that_are_there_are_done_without_by_nothing_and_what_was_not_tried_is_named():
    problem, best = fitted(swing((0.9, 0.95)))
    nearest = integer_alternatives(problem, best, SURE, slow=False)
    tried = {t.name: t for t in nearest.trials if math.isfinite(t.cost)}
    assert {"the same model", "a delay of alpha", "a low-pass of theta", "a scale of alpha", "drag"} <= set(tried)
    assert not any(t.as_well or t.gain < 10 for t in tried.values())
    slow = {"friction that changes with time", "play", "presliding", "Stribeck's friction", "an elastic arm"}
    assert {t.name for t in nearest.trials} - set(tried) == slow
    assert nearest.warning == ""
    assert nearest.gain == min(t.gain for t in tried.values())


def test_nothing_is_tried_of_a_channel_that_is_free_already_or_of_a_joint_that_stands_still():
    twin = replace(swing(end=2.0), sensors={"alpha": Sensor(delay=Free(0.0, -5e-3, 5e-3))})
    still = replace(twin, measured=twin.measured * [1e-4, 1.0])
    problem, _ = fitted(still)
    off = problem.evaluate(problem.start - 0.05 * (np.arange(problem.start.size) < 2))
    names = [t.name for t in integer_alternatives(problem, off, SURE, slow=False).trials]
    assert "a delay of alpha" not in names
    assert "play" not in names


def test_the_rival_of_a_springpot_has_none():
    more = {"springpot_alpha": Free(1e-3, 0.0, 0.1), "springpot_order_alpha": Free(0.5, 0.01, 0.99)}
    problem, _ = fitted(swing(end=1.0), more, orders={"lambda": 1.0, "mu": 1.0})
    assert [problem.names[i] for i in claimable(problem)] == ["springpot_order_alpha"]
    rival = integer_rival(problem, problem.evaluate(problem.start), {"springpot_order_alpha": 0.05})
    assert rival.off == {"springpot_order_alpha": 0.5}
    assert not any("springpot" in name for name in rival.problem.names)
    assert rival.nested_in(problem)["springpot_alpha"] == 0.0
    unsure = integer_rival(problem, problem.evaluate(problem.start), {"springpot_order_alpha": 0.6})
    assert unsure is None


def test_what_inputs_do_between_samples_is_tried_where_they_vary():
    time = np.arange(0, 3, 0.02)
    u = np.sign(np.sin(5 * time))[:, None]
    model = RIG.with_parameters(**FRICTION)
    run = fracid.simulate(model, orders={"lambda": 1.0, "mu": 1.0}, initial={}, step=0.02, end=float(time[-1]),
                          inputs=u[:, 0], between="hold")  # fmt: skip
    driven = Experiment("driven", 0.02, run.states[:, [0, 2]], u, between={"voltage": "line"})
    problem, best = fitted(driven)
    trials = integer_alternatives(problem, best, SURE, slow=False).trials
    assert trials[-1].as_well
    names = [t.name for t in trials]
    assert 'voltage held between samples (between = "hold")' in names or names[-1].startswith("a delay")


def test_inputs_that_are_held_at_different_values_drive_nothing():
    """Only beside an input that varies is a delay of the first output tried too, and of inputs that they come late."""
    model = fracid.model("joint")
    held = np.tile(np.arange(1.0, 1.0 + len(model.inputs)), (400, 1))
    e = Experiment("held", 0.01, np.sin(np.arange(400) / 9)[:, None], held)
    assert not e.driven
    assert replace(e, inputs=held + np.linspace(0, 1, 400)[:, None]).driven
    problem = Problem(model, (e,), {"mu": 1.0})
    assert not any("delay" in element.name for change in ELEMENTS for element in change(problem))


def test_a_rival_that_comes_late_and_holds_its_inputs_leaves_the_orders_their_lines():
    time = np.arange(0, 3, 0.02)
    u = np.sin(5 * time)[:, None]
    run = fracid.simulate(RIG.with_parameters(**FRICTION), orders={"lambda": 0.9, "mu": 1.0}, initial={}, step=0.02,
                          end=float(time[-1]), inputs=u[:, 0], between="line")  # fmt: skip
    driven = Experiment("driven", 0.02, run.states[:, [0, 2]], u, between={"voltage": "line"})
    orders = {"lambda": Free(0.9, 0.5, 1.2), "mu": 1.0}
    problem = Problem(RIG.with_parameters(**FRICTION), (driven,), orders, initial_state="held")
    best = problem.evaluate(problem.start)
    late = next(ELEMENTS[0](problem))
    for element in (late, *_inputs(late.problem)):
        assert _on_the_same_samples(problem, best, element).cost == pytest.approx(best.cost, abs=1e-9)


@pytest.mark.broad
def test_friction_that_changes_from_part_to_part_is_followed_by_orders_1_to_the_noise():
    start, pieces = {"alpha": 0.5}, []
    for times in (0.5, 1.0, 3.0):
        friction = FRICTION | {"b_alpha": times * FRICTION["b_alpha"], "coulomb_alpha": times * 4e-4}
        run = fracid.simulate(RIG.with_parameters(**friction), orders={"lambda": 1.0, "mu": 1.0}, initial=start,
                              step=4e-3, end=1.6)  # fmt: skip
        pieces.append(run.states[:-1])
        start = dict(zip(RIG.states, run.states[-1].tolist(), strict=True))
    y = np.vstack(pieces)[:, [0, 2]]
    y = y + 8e-4 * np.random.default_rng(1).standard_normal(y.shape)
    ones = {"lambda": 1.0, "mu": 1.0}
    problem, best = fitted(Experiment("tiring", 4e-3, y, np.zeros((1, 1)), initial={"alpha": 0.5}), orders=ones)
    parts = in_parts(problem, 3, list(FRICTION))
    assert best.cost > 3e-3
    assert refined(parts, parts.start, Watch()).best.cost == pytest.approx(8e-4, rel=0.1)


@pytest.mark.broad
def test_friction_of_each_part_pays_for_its_unknowns_where_it_costs_as_little():
    problem, best = fitted(swing())
    ones = replace(problem, orders=dict.fromkeys(BOTH, 1.0))
    parts = in_parts(ones, 3, list(FRICTION))
    end = refined(parts, parts.start, Watch()).best
    assert end.cost < best.cost
    _, trial = _tried("friction that changes", Rival(parts, end, "every order 1", {}), problem, best)
    assert trial.gain > STRONG
    assert not trial.as_well


@pytest.mark.broad
def test_a_joint_is_tried_with_friction_over_its_load_and_with_stiction():
    t = 0.01 * np.arange(200)
    torque = np.column_stack([0.2 * np.sin(3 * t), *np.zeros((3, 200))])
    e = Experiment("swing", 0.01, np.sin(3 * t)[:, None], torque)
    problem = Problem(fracid.model("joint"), (e,), {"mu": 1.0}, {"coulomb_angle": Free(0.01, 0.0, 1.0)})
    tried = {element.name: element.problem for change in ELEMENTS for element in change(problem)}
    assert isinstance(tried["Stribeck's friction"].parameters["stiction_angle"], Free)
    assert isinstance(tried["friction over load"].parameters["load_angle"], Free)
