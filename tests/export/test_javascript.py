"""The solver that stands in a page simulates what fracid simulates: with any order, any friction, any input."""

import json

import numpy as np
import pytest

import fracid
from browser import CHROMIUM, Browser
from fracid.errors import InputError
from fracid.export.javascript import javascript_model, no_javascript
from fracid.export.whole import written
from fracid.solver.memory import full, short

pytestmark = [pytest.mark.broad, pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium here")]


def problem_of(orders=(0.8623, 0.9146), method="pi2", *, steps=2000, step=2e-3, initial=None, between=None, memory=None,
               zero="hanging", inputs=None, **constants):  # fmt: skip
    rig = fracid.rotary_pendulum("srv02-rotpen", zero=zero)
    swing = fracid.Experiment(
        "twin", step, np.tile([0.0, 0.17], (steps + 1, 1)), np.zeros((1, 1)) if inputs is None else inputs(steps),
        initial=initial or {}, between={} if between is None else {rig.inputs[0]: between},
    )  # fmt: skip
    q = dict(zip(("lambda", "mu"), orders, strict=True))
    more = {} if memory is None else {"memory": memory}
    return fracid.Problem(rig, (swing,), q, parameters=constants, initial_state="held", method=method, **more)


def swept(steps):
    return np.sin(np.linspace(0, 6, steps + 1) ** 2)[:, None]


VARIANTS = {
    "the demo: 20 s at 1 kHz": problem_of(steps=20_000, step=1e-3),
    "integer orders": problem_of((1.0, 1.0)),
    "Coulomb friction and drag": problem_of((1.0, 0.95), coulomb_theta=2e-3, coulomb_alpha=5e-4, drag_alpha=1e-4),
    "steep dry friction": problem_of((0.95, 0.9), coulomb_theta=3e-2, slip_speed=1e-3),
    "several corrections of the start": problem_of((0.3, 0.45), b_alpha=1e-2),
    "orders above 1": problem_of((1.1, 1.3), b_alpha=1e-2, b_theta=1e-2),
    "upright": problem_of(zero="upright", initial={"alpha": 2.9}),
    "full memory": problem_of(memory=full(), steps=500),
    "a time scale": problem_of(time_scale=0.2),
    "presliding joints": problem_of(coulomb_alpha=1e-3, presliding_alpha=0.05, presliding_damping_alpha=1e-3,
                                    coulomb_theta=4e-3, presliding_theta=5e-3),
    "a springpot and an elastic arm with play": problem_of(springpot_alpha=1e-3, springpot_order_alpha=0.4,
                                                           play_theta=0.01, arm_stiffness=20.0),
    "driven, on a leaning axis": problem_of(inputs=swept, torque_per_volt=0.05, tilt_x=0.01),
    "driven by a voltage that is held": problem_of(inputs=swept, torque_per_volt=0.05, between="hold"),
    "the same of low orders": problem_of((0.3, 0.45), inputs=swept, torque_per_volt=0.05, between="hold", b_alpha=1e-2),
    "pi2-implicit": problem_of(method="pi2-implicit"),
    "gl": problem_of(method="gl"),
    "gl-sequential": problem_of((0.9, 1.0), method="gl-sequential"),
    "gl-paper": problem_of(method="gl-paper", initial={"alpha": 0.2}),
}  # fmt: skip


@pytest.fixture(scope="module")
def browser():
    with Browser() as page:
        yield page


def simulated(browser, problem, how="simulate()"):
    """States of the exported model, every tenth sample and the last."""
    text = javascript_model(problem, problem.start, problem.experiments[0], "runs/twin").replace("\nexport ", "\n")
    call = f"(() => {{ const run = {how}; return [run.completed, run.states.map(x => Array.from(x))]; }})()"
    completed, states = browser.run(f"(() => {{ {text}; return {call}; }})()")
    assert completed
    return np.array(states)


@pytest.mark.parametrize("which", VARIANTS)
def test_the_browsers_solver_is_the_librarys(browser, which):
    problem = VARIANTS[which]
    ours = problem.simulate(problem.start, problem.experiments[0])
    assert ours.completed
    np.testing.assert_allclose(simulated(browser, problem), ours.states, rtol=1e-6, atol=1e-6)


def test_other_orders_and_constants_are_those_of_another_run_of_the_library(browser):
    values = {"orders": {"lambda": 1.0, "mu": 0.7}, "parameters": {"b_alpha": 1e-3}}
    ours = fracid.simulate(
        fracid.rotary_pendulum("srv02-rotpen"), **values, initial={"alpha": 0.17}, step=2e-3, end=4.0
    )
    found = simulated(browser, problem_of(), f"simulate({json.dumps(values)})")
    np.testing.assert_allclose(found, ours.states, rtol=1e-6, atol=1e-6)


def test_what_cannot_be_translated_is_refused_in_one_sentence():
    for problem, words in ((problem_of(method="pi3"), "pi3"), (problem_of(memory=short(50)), "short")):
        assert words in no_javascript(problem)
        with pytest.raises(InputError, match=words):
            javascript_model(problem, problem.start, problem.experiments[0], "runs/twin")


def test_nothing_of_c_is_left_in_the_right_hand_side():
    text = written(fracid.rotary_pendulum(), "javascript")
    assert not any(word in text for word in ("double", "static", "void", "fabs", "fmax", "[]"))
