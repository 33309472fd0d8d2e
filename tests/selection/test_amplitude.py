"""Does an order drift as the swing dies?  Against the energy that each friction takes, and on twins of both kinds."""

import json
import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import fracid
from fracid import InputError
from fracid.estimation.horizons import Watch, refined
from fracid.estimation.search import search
from fracid.optimise import OPTIMISERS
from fracid.problem import Experiment, Free, Problem
from fracid.problem.costs import Cost
from fracid.selection.amplitude import AmplitudeTest, Drift, amplitude_test, trend
from fracid.signals.swing import envelope
from twins import release

RIG = fracid.rotary_pendulum("stepper-freeswing")  # one degree of freedom
C1, STIFFNESS = RIG.parameter("C1").value, RIG.parameter("C4").value
VISCOUS = 1e-5


def swing(angle=0.4, mu=1.0, *, dry=0.0, drag=0.0, noise=3e-4, seed=1, end=10.0, name=None):
    """A free swing of that order and friction, with white noise [rad]."""
    return release(name or f"{angle} rad", RIG, orders={"lambda": 1.0, "mu": mu}, alpha=angle, step=1e-2, end=end,
                   parameters={"b_alpha": VISCOUS, "coulomb_alpha": dry, "drag_alpha": drag}, outputs=("alpha",),
                   noise=noise, seed=seed)  # fmt: skip


def model(*swings, dry=None, order=1.0, **options):
    """A problem whose start is the truth but for what it lacks: `dry` friction, if given, is in it."""
    free = {"b_alpha": Free(VISCOUS, -1.0, 1.0), "C1": Free(C1, 0.5 * C1, 2 * C1)}
    free |= {} if dry is None else {"coulomb_alpha": Free(dry, 0.0, 1e-2)}
    orders = {"lambda": 1.0, "mu": Free(order, 0.5, 1.2)}
    return Problem(RIG, swings, **{"orders": orders, "parameters": free, "outputs": ("alpha",),
                                   "initial_state": "held"} | options)  # fmt: skip


# --- theory -------------------------------------------------------------------------------------------------


@pytest.mark.few(1)
@pytest.mark.parametrize("dry", [5e-6, 1e-5, 2e-5])
def test_dry_friction_takes_as_much_from_the_order_as_its_energy_says(dry):
    problem = model(swing(dry=dry, noise=1e-4, end=12.0))
    (drift,) = amplitude_test(problem, problem.start).drifts
    A = np.array(drift.amplitudes)
    assert len(A) == 5
    assert 1 - np.array(drift.values) == pytest.approx(4 * dry / (np.pi**2 * STIFFNESS * A), rel=0.06)


@pytest.mark.broad
@pytest.mark.parametrize("drag", [3e-6, 1e-5])
def test_drag_takes_as_much_from_the_order_as_its_energy_says(drag):
    problem = model(swing(drag=drag, noise=1e-4, end=20.0))
    (drift,) = amplitude_test(problem, problem.start).drifts
    A = np.array(drift.amplitudes)
    theory = (2 / np.pi) * 4 * drag * (STIFFNESS / C1) * A / (3 * np.pi * STIFFNESS)
    assert 1 - np.array(drift.values[1:]) == pytest.approx(theory[1:], rel=0.06)  # within the first it falls too fast


# --- twins --------------------------------------------------------------------------------------------------


@cache
def fitted(dry=0.0, drag=0.0, mu=1.0, in_model=False):
    problem = model(swing(0.7, mu, dry=dry, drag=drag, end=8.0), dry=(dry or 1e-6) if in_model else None)
    x = search(problem, OPTIMISERS["multistart"], np.random.default_rng(1))[0].best.point
    return amplitude_test(problem, x)


DISGUISED = {
    "dry friction that is not in the model": (fitted, {"dry": 6e-5}, "falls with the amplitude"),
    "dry friction beside a real order": (fitted, {"dry": 3e-5, "mu": 0.97}, "falls with the amplitude"),
    "drag that is not in the model": (fitted, {"drag": 2e-5}, "rises as the swing dies"),
}
HONEST = {
    "integer order, dry friction in the model": {"dry": 6e-5, "in_model": True},
    "a real order": {"mu": 0.96},
    "a real order, dry friction in the model": {"dry": 2e-5, "mu": 0.97, "in_model": True},
    "an idle dry friction in the model": {"in_model": True, "mu": 0.97},
}


@pytest.mark.few(1)
@pytest.mark.parametrize("case", DISGUISED)
def test_an_order_that_imitates_friction_drifts_and_is_flagged(case):
    make, truth, words = DISGUISED[case]
    test = make(**truth)
    assert test.disguised
    (drift,) = test.drifts
    assert words in drift.sentence
    assert "friction in disguise" in drift.sentence
    assert drift.order == "mu"
    assert list(drift.amplitudes) == sorted(drift.amplitudes, reverse=True)


@pytest.mark.few(1)
@pytest.mark.parametrize("case", HONEST)
def test_an_order_that_is_real_does_not_drift(case):
    test = fitted(**HONEST[case])
    assert not test.disguised
    assert "mu does not drift with amplitude within 0.7 rad" in test.sentences[0]
    true = HONEST[case].get("mu", 1.0)
    assert test.drifts[0].values[0] == pytest.approx(true, abs=1e-3)


def test_a_window_whose_search_is_stuck_is_searched_from_the_start_of_the_problem_too(monkeypatch):
    problem, pieces = model(swing(0.7, dry=1e-4, end=8.0), order=0.97), []
    x = refined(problem, problem.start, Watch()).best.point

    def stuck_at_first(piece, start, *more, **options):
        found = refined(piece, start, *more, **options)
        first = not any(piece is one for one in pieces)
        pieces.append(piece)
        return replace(found, best=piece.evaluate(start)) if first else found

    expected = [w.orders["mu"] for w in amplitude_test(problem, x).windows]
    monkeypatch.setattr("fracid.selection.amplitude.refined", stuck_at_first)
    windows = amplitude_test(problem, x).windows
    assert len(windows) > 3
    assert [w.orders["mu"] for w in windows] == pytest.approx(expected, abs=2e-4)


@pytest.mark.broad
def test_the_flag_is_seldom_false():
    flagged = 0
    for seed in range(6):
        problem = model(swing(0.5, 0.97, noise=3e-3, seed=seed, end=6.0), order=0.97)
        flagged += amplitude_test(problem, problem.start).disguised
    assert flagged <= 1  # a probability of 1 % each


@pytest.mark.broad
def test_releases_from_different_heights_are_compared_as_wholes():
    high, low = swing(0.6, dry=1e-5, name="high"), swing(0.15, dry=1e-5, name="low")
    problem = model(high)
    test = amplitude_test(problem, problem.start, others=[low])
    (over,) = [d for d in test.drifts if d.over == "releases"]
    assert over.drifts
    assert "falls with the amplitude over the releases" in over.sentence
    assert {w.recording for w in test.windows if w.whole} == {"high", "low"}
    assert {d.over for d in test.drifts} == {"high", "low", "releases"}


@pytest.mark.broad
def test_fixed_orders_are_freed_and_those_of_an_honest_integer_model_stay_at_1():
    problem = model(swing(dry=2e-5), dry=2e-5, orders={"lambda": 1.0, "mu": 1.0})
    test = amplitude_test(problem, problem.start)
    mu = [d for d in test.drifts if d.order == "mu"]
    assert mu[0].values == pytest.approx([1.0] * len(mu[0].values), abs=2e-3)
    assert not test.disguised


@pytest.mark.broad
def test_both_orders_of_a_whole_rig_and_an_arm_that_sticks_tells_nothing():
    rig = fracid.rotary_pendulum("srv02-rotpen", coulomb_theta=3e-2)
    run = fracid.simulate(rig, orders={"lambda": 0.95, "mu": 0.97}, initial={"alpha": 0.5}, step=1e-2, end=9.0)
    count = 2 * np.pi / 4096
    release = Experiment("release", 1e-2, count * np.round(run.states[:, [0, 2]] / count), np.zeros((1, 1)),
                         initial={"theta": 0.0, "alpha": 0.5})  # fmt: skip
    problem = Problem(rig, (release,), {"lambda": Free(0.95, 0.5, 1.2), "mu": Free(0.97, 0.5, 1.2)},
                      initial_state="held")  # fmt: skip
    test = amplitude_test(problem, problem.start)
    still = [w for w in test.windows if w.amplitude["lambda"] < 20 * count]
    assert still
    assert all(w.standard_errors["lambda"] == math.inf for w in still)
    assert all(math.isfinite(w.standard_errors["mu"]) for w in test.windows)
    assert not test.disguised


# --- what cannot be tested ------------------------------------------------------------------------------------


def test_a_driven_recording_and_one_of_too_few_swings_are_left_out_and_said():
    driven = replace(swing(name="pulse"), inputs=np.sin(np.arange(1001) / 50)[:, None])
    short = swing(end=0.8, name="short")
    problem = model(driven, short)
    test = amplitude_test(problem, problem.start)
    assert test.windows == test.drifts == ()
    assert test.notes == (
        "pulse is driven: it has no amplitude that falls.",
        "short has too few swings for windows of falling amplitude: two of 2 swings at least.",
    )
    with pytest.raises(InputError, match=r"no order was found in two windows\. pulse is driven"):
        test.plot()


def test_a_window_whose_run_fails_is_said():
    problem = model(replace(swing(), step=1.0))
    test = amplitude_test(problem, problem.start)
    assert any("no order was found, the run fails" in note for note in test.notes)


@pytest.mark.parametrize(
    ("options", "windows", "says"),
    [
        ({}, 1, r"windows = 1; expected a whole number, 2 or more"),
        (
            {"cost_function": Cost("mine", function=lambda t, r: 1.0)},
            5,
            r"a user's own, .* take a built-in one",
        ),
    ],
)
def test_mistakes_are_answered_in_words(options, windows, says):
    problem = model(swing(end=1.0), **options)
    with pytest.raises(InputError, match=says):
        amplitude_test(problem, problem.start, windows=windows)


# --- its parts ------------------------------------------------------------------------------------------------


def test_a_trend_is_judged_by_chi_square_and_by_what_amplitude_explains():
    A, s = np.array([0.8, 0.4, 0.2, 0.1]), np.full(4, 1e-3)
    same = trend(A, np.full(4, 0.9), s)
    assert same == (1.0, 0.0, pytest.approx(0.0, abs=1e-12))
    for q in (0.9 - 1e-3 / A, 0.9 + 1e-2 * A):
        probability, explained, change = trend(A, q, s)
        assert probability < 1e-3
        assert explained == pytest.approx(1.0)
        assert change == pytest.approx(q[-1] - q[0])
    assert trend(A, np.array([0.90, 0.95, 0.90, 0.95]), s)[1] < 0.5


@pytest.mark.parametrize(
    ("values", "errors", "explained", "change", "says"),
    [
        ((0.99, 0.95), 1e-9, 1.0, -0.04, "mu falls with the amplitude within run, from 0.99 at 29° to 0.95 at 5.7°"),
        ((0.95, 0.99), 1e-9, 1.0, 0.04, "mu rises as the swing dies within run, from 0.95 at 29° to 0.99 at 5.7°"),
        ((0.99, 0.95), 1e-9, 0.2, -0.04, "does not go with the amplitude: the model lacks something else"),
        ((0.99, 0.95), 0.3, 1.0, -0.04, "mu does not drift with amplitude within run: 0.04 of change, within its int"),
        ((0.99, 0.9895), 1e-9, 1.0, -5e-4, "mu does not drift with amplitude"),  # sure, but it does not matter
    ],
)
def test_the_sentence_says_what_an_engineer_can_act_on(values, errors, explained, change, says):
    assert says in Drift("mu", "run", (0.5, 0.1), values, (1e-3, 1e-3), errors, explained, change).sentence


def test_the_envelope_is_half_the_range_whatever_the_rest():
    t = np.arange(3000) / 100
    size = envelope(2.0 + 0.3 * np.exp(-t / 20) * np.cos(2 * np.pi * t), 100)
    assert size[100:-100] == pytest.approx(0.3 * np.exp(-t[100:-100] / 20), rel=0.06)


def test_it_goes_through_json_unchanged_and_can_be_drawn():
    test = fitted(dry=6e-5)
    assert AmplitudeTest.of_json(json.loads(json.dumps(test.to_json(), allow_nan=False))) == test
    (axes,) = test.plot().axes
    assert axes.get_title() == "drifts: friction in disguise"
    assert axes.get_xscale() == "log"
