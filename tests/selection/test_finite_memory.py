"""The finite memory that every order is held against, and what is claimed then."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from fracid import Experiment, Free, Model, Parameter, Problem, identify, simulate
from fracid.estimation.horizons import Watch, refined
from fracid.selection.claim import OrderFound, claim_of
from fracid.selection.finite_memory import finite_memories, with_relaxations
from fracid.selection.integer_rival import Alternative, FiniteMemory, Trial
from fracid.selection.residual_noise import leftovers
from fracid.signals.left_over import LeftOver
from scripts import module_of

STEP, COUNT = 0.1, 400
WHITE = {"twin, T": LeftOver(1e-3, 0.0, 1.0)}
LACKS = {"twin, T": LeftOver(1e-3, 0.0, 0.1)}
COLOURED = {"twin, T": LeftOver(1e-3, 0.0, 0.1, coloured=True)}
OFF = [OrderFound("q", 0.8, 0.01)]


def body(t, x, u, p, out):
    out[0] = (u[0] - p[1] * x[0]) / p[0]


MODEL = Model("body", body, ("T",), ("q",), {"T": 0}, ("power",),
              (Parameter("C", "J/K", 1.0, "capacity"), Parameter("h", "W/K", 0.2, "loss")), "", "a test")  # fmt: skip


def two_lumps(coupling, capacity):
    """A body of capacity 1 and loss 0.2 with another behind it, heated from 2 s on, exactly."""
    A = np.array([[-0.2 - coupling, coupling], [coupling / capacity, -coupling / capacity]])
    step, T = expm(STEP * A), np.zeros((COUNT, 2))
    gain = np.linalg.solve(A, (step - np.eye(2)) @ np.array([1.0, 0.0]))
    for n in range(COUNT - 1):
        T[n + 1] = step @ T[n] + (gain if n >= 20 else 0.0)
    return T[:, 0]


HEAT = (np.arange(COUNT) >= 20).astype(float)


def problem_of(T, between="hold", heat=HEAT):
    twin = Experiment("twin", STEP, T[:, None], heat[:, None], initial={"T": 0.0}, between={"power": between})
    return Problem(MODEL, (twin,), {"q": Free(0.9, 0.3, 1.4)},
                   {"C": Free(1.0, 0.05, 20.0), "h": Free(0.2, 0.0, 5.0)}, initial_state="held")  # fmt: skip


def fractional_body(q, heat=HEAT):
    """T of the body with a capacity of order q, in finer steps than a fit takes."""
    fine = np.interp(np.arange(8 * (COUNT - 1) + 1) / 8, np.arange(COUNT), heat)[:, None]
    run = simulate(MODEL, orders={"q": q}, parameters={}, initial={}, step=STEP / 8, end=STEP * (COUNT - 1),
                   inputs=fine)  # fmt: skip
    return run.states[::8, 0]


def noise(seed, ρ=0.0):
    rng, e = np.random.default_rng(seed), np.zeros(COUNT + 100)
    for n, white in enumerate(rng.standard_normal(e.size)):
        e[n] = ρ * e[n - 1] + np.sqrt(1 - ρ**2) * white
    return e[100:]


def test_a_model_with_one_relaxation_is_a_body_with_a_second_lump():
    coupling, capacity = 0.3, 0.5
    fade = coupling * (1 + 1 / capacity)  # of what flows between the two
    rest = capacity / (1 + capacity)
    T = two_lumps(coupling, capacity)
    (twin,) = problem_of(T).experiments
    values = {"share0_q": 1 - rest, "share1_q": rest, "ln_tau1_q": -np.log(fade)}
    relaxed = Problem(with_relaxations(MODEL, {"q": [0]}, 1), (twin,), {}, values, initial_state="held", substeps=10)
    assert np.max(np.abs(relaxed.fitted(relaxed.start, twin)[:, 0] - T)) < 0.01


def test_a_body_with_a_weak_second_lump_is_not_called_fractional():
    T = two_lumps(0.3, 0.5)
    fit = identify(problem_of(T + 0.06 * np.std(T) * noise(1)))
    assert fit.orders["q"].interval95[1] < 0.98
    assert fit.claim != "fractional"
    memories = fit.alternative.memories
    assert [m.relaxations for m in memories] == [1]
    assert memories[0].gain < 10
    assert "worth no more than one relaxation" in fit.claim_reasons[0]


def spring(t, x, u, p, out):
    out[0] = x[1]
    out[1] = -p[0] * np.sin(x[0]) - p[1] * x[1]


@pytest.mark.broad
def test_what_coarser_recordings_lead_to_is_what_every_sample_leads_to_but_for_who_is_far_off(monkeypatch):
    constants = Parameter("k", "1/s^2", 40.0, "spring"), Parameter("b", "1/s", 0.3, "loss")
    model = Model("spring", spring, ("phi", "rate"), ("q", "q"), {"phi": 0}, (), constants, "", "a test")
    run = simulate(model, orders={"q": 0.95}, initial={"phi": 0.6}, step=5e-3, end=10.0)
    seen = run.states[:, :1] + 1e-3 * np.random.default_rng(1).standard_normal((len(run.states), 1))
    swing = Experiment("swing", 5e-3, seen, np.zeros((1, 0)), initial={"phi": 0.6, "rate": 0.0})
    problem = Problem(model, (swing,), {"q": Free(0.95, 0.5, 1.2)}, {"k": Free(40.0, 5.0, 200.0)}, initial_state="held")
    best = refined(problem, problem.start, Watch()).best
    quick = finite_memories(problem, best, ["q"])
    monkeypatch.setattr("fracid.selection.finite_memory.thinned", lambda problem, _: problem)
    slow = finite_memories(problem, best, ["q"])
    assert [m.relaxations for m in quick] == [m.relaxations for m in slow] == [1, 2, 3]
    assert [m.as_well for m in quick] == [m.as_well for m in slow]
    gains = [(m.gain, n.gain) for m, n in zip(quick, slow, strict=True)]
    assert all(m > n - 5.0 for m, n in gains)
    assert gains[-1][0] == pytest.approx(gains[-1][1], abs=5.0)  # who is not far off


@pytest.mark.broad
@pytest.mark.few(1)
@pytest.mark.parametrize(("ρ", "size"), [(0.0, 0.01), (0.95, 0.02)])
def test_an_order_is_worth_more_than_two_relaxations_in_white_and_in_coloured_noise(ρ, size):
    T = fractional_body(0.6)
    fit = identify(problem_of(T + size * np.std(T) * noise(1, ρ), "line"), fixed_step=False)
    assert fit.claim == "fractional"
    assert any("as many as three relaxations" in reason for reason in fit.claim_reasons)
    assert [m.relaxations for m in fit.alternative.memories] == [1, 2, 3]
    assert any("correlated noise, or a model that lacks something" in r for r in fit.claim_reasons) == (ρ > 0)


@pytest.mark.broad
def test_the_noise_of_the_start_does_not_speak_against_an_order_whose_interval_includes_it():
    T = fractional_body(0.6)
    problem = problem_of(T + 0.01 * np.std(T) * noise(1), "line")
    (twin,) = problem.experiments
    fit = identify(replace(problem, experiments=(replace(twin, initial={}),)), fixed_step=False)
    assert fit.warning_codes == ("noisy-start",)
    assert fit.findings == ()
    assert fit.claim == "fractional", fit.claim_reasons


@pytest.mark.broad
@pytest.mark.parametrize("seed", [0, 1])
def test_relaxations_are_no_better_in_coloured_noise_by_what_a_step_misses_where_an_input_jumps(seed):
    pulses = np.arange(COUNT) // 80 % 2.0
    T = fractional_body(0.5, pulses)
    fit = identify(problem_of(T + 0.02 * np.std(T) * noise(seed, 0.95), "line", pulses), fixed_step=False)
    assert fit.claim == "fractional"
    assert min(m.gain for m in fit.alternative.memories) > 20


@pytest.mark.broad
def test_a_springpot_in_the_place_of_a_spring_and_two_maxwell_elements_is_not_called_fractional():
    twins = module_of("benchmarks/own_models.py")
    twin = twins.answer("maxwell", 2, 0.03, "30 ms", 1)
    assert twin["order"] < 0.05
    assert twin["claim"] == "undecided"
    assert "another parameter stays at its bound" in twin["reasons"][0]


def test_what_a_step_misses_behind_the_jumps_of_an_input_is_no_lack_of_the_model():
    pulses = np.arange(COUNT) // 80 % 2.0
    T = fractional_body(0.5, pulses)
    problem = problem_of(T + 0.02 * np.std(T) * noise(0, 0.95), "line", pulses)
    (left,) = leftovers(problem, np.array([0.5, 1.0, 0.2])).values()
    assert left.coloured


def alternative(*memories, **changes):
    worse = Alternative("every order 1", ("q",), 2e-3, {}, 50.0, 300.0, trials=(Trial("the same model", 2e-3, 50.0),))
    return replace(worse, memories=memories, **changes)


@pytest.mark.parametrize(
    ("gain", "settles", "claim"),
    [(30.0, True, "fractional"), (9.0, True, "undecided"), (-5.0, True, "undecided"), (-15.0, True, "integer"),
     (-15.0, False, "undecided"), (np.inf, True, "undecided")],
)  # fmt: skip
def test_what_one_relaxation_does_decides_the_claim(gain, settles, claim):
    found = claim_of(OFF, alternative(FiniteMemory(1, 1e-3, gain, settles)), WHITE)
    assert found.claim == claim


def test_three_relaxations_need_only_be_no_better():
    assert not FiniteMemory(3, 1e-3, 1.0).as_well
    assert FiniteMemory(3, 1e-3, -1.0).as_well
    assert FiniteMemory(2, 1e-3, 1.0).as_well


def test_a_rival_that_explains_nothing_itself_settles_nothing():
    as_well = (Trial("a delay of T", 1e-3, 1.0, as_well=True),)
    settled = alternative(warning="A delay does as well.", trials=as_well)
    assert claim_of(OFF, settled, WHITE).claim == "integer"
    unsettled = claim_of(OFF, replace(settled, settles=False), LACKS)
    assert unsettled.claim == "undecided"
    assert any("settles nothing" in reason for reason in unsettled.reasons)


def test_coloured_noise_forbids_no_claim_and_is_said():
    assert claim_of(OFF, alternative(), LACKS).claim == "undecided"
    found = claim_of(OFF, alternative(), COLOURED)
    assert found.claim == "fractional"
    assert "correlated noise, or a model that lacks something" in found.reasons[-1]
