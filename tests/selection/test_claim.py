"""What is claimed: fractional only where nothing of integer order, no finding and no residual speaks against it."""

import math
from dataclasses import replace

import numpy as np
import pytest

import fracid
from fracid.safety.schema import as_json, record_of
from fracid.selection.claim import FLOOR, OrderFound, claim_of, of_model
from fracid.selection.integer_rival import Alternative, Trial
from fracid.signals.left_over import LeftOver, left_over

STEP = 2 * math.pi / 4096
NOISE = {"swing, alpha": LeftOver(1e-3, 0.0, 1.0)}
MISFIT = {"swing, alpha": LeftOver(4e-3, STEP / math.sqrt(12), 0.01)}
CLEAR = [OrderFound("mu", 0.95, 0.003)]


def nearest(*, as_well=False, untried=()):
    trials = (Trial("friction", 0.4, 300.0), Trial("a delay of alpha", 0.2, 5.0 if as_well else 80.0, as_well))
    trials += tuple(Trial(name, math.inf, math.inf) for name in untried)
    return Alternative("every order 1", ("mu",), 0.2, {}, 80.0, 900.0, "A delay does as well." * as_well, trials)


def test_orders_that_nothing_of_integer_order_does_without_are_called_fractional_with_their_damping():
    claim = claim_of(CLEAR, nearest(untried=["play"]), NOISE)
    assert claim.claim == "fractional"
    assert "damping ratio of 0.079" in claim.reasons[0]
    assert "Tried: friction, a delay of α" in claim.reasons[1]
    assert claim.reasons[-1] == "Not excluded: play."


def test_an_alternative_that_does_as_well_makes_the_claim_integer_whatever_is_left_over():
    claim = claim_of(CLEAR, nearest(as_well=True), MISFIT)
    assert claim.claim == "integer"
    assert claim.reasons[-1].startswith("Not excluded: a fractional element")
    assert claim_of(CLEAR, nearest(as_well=True), NOISE).reasons == ("A delay does as well.",)


def test_an_order_that_is_hardly_known_is_undecided_where_an_alternative_does_as_well_and_not_far_better():
    hardly = [OrderFound("q", 0.78, 0.2)]
    claim = claim_of(hardly, replace(nearest(as_well=True), gain=-3.2), NOISE)
    assert claim.claim == "undecided"
    assert claim.reasons[1:] == ("q is not identifiable.", "To decide: longer recordings, or larger motions.")
    assert claim_of(hardly, replace(nearest(as_well=True), gain=-120.0), NOISE).claim == "integer"


def test_an_alternative_that_does_nearly_as_well_decides_nothing():
    claim = claim_of(CLEAR, replace(nearest(as_well=True), gain=7.4, settles=False), NOISE)
    assert claim.claim == "undecided"
    assert claim.reasons[1:] == (
        "A BIC that is higher by 2 to 10 speaks for the orders, but not strongly.",
        "To decide: longer recordings, or larger motions.",
    )


def test_compare_is_named_only_where_the_model_has_what_it_would_look_for():
    for rungs, named in (((), [False, False]), (("branch",), [True, False]), (("springpot",), [True, True])):
        orders = [OrderFound("q", q, 0.01, rungs=frozenset(rungs)) for q in (0.9, 1.0)]
        said = [" ".join(claim_of([order], None, MISFIT).reasons) for order in orders]
        assert ["fracid compare" in reasons for reasons in said] == named


def test_zero_is_an_integer_of_every_order():
    e = fracid.Experiment("still", 0.1, np.zeros((9, 1)), np.zeros((1, 1)))
    problem = fracid.Problem(fracid.model("pendulum"), (e,), {"mu": fracid.Free(0.5, 1e-6, 1.0)})
    order = OrderFound("mu", 1e-6, 0.001, **of_model(problem, "mu"))
    assert claim_of([order], None, NOISE).claim == "integer"


@pytest.mark.parametrize(
    ("orders", "claim"),
    [
        ([OrderFound("mu", 0.999, 0.002)], "integer"),  # 1 is in the interval
        ([OrderFound("mu", 0.9970, 0.0001)], "undecided"),  # off 1, by next to no damping
        ([OrderFound("mu", 0.9995, 0.0001)], "integer"),  # off 1, by less than solvers are
        ([OrderFound("mu", 0.9, 0.3)], "undecided"),  # not known
        ([OrderFound("q", 1.0, 0.0, shown=(0.3, 1.0))], "undecided"),  # nor where a bound cuts the side of 1
        ([OrderFound("q", 1.0, 0.0, shown=(0.95, 1.0))], "integer"),
        ([OrderFound("lambda", 1.0, math.inf), OrderFound("mu", 1.0, 0.01)], "integer"),  # one is not seen
        ([OrderFound("q", 0.5, 0.01, ())], "undecided"),  # an order that has no integer value
        ([], "undecided"),
    ],
)
def test_orders_within_their_intervals_are_integer_and_what_is_not_known_is_undecided(orders, claim):
    assert claim_of(orders, None, NOISE).claim == claim


def test_an_order_without_integer_value_is_not_said_to_be_untold():
    [reason] = claim_of([OrderFound("q", 0.5, 0.01, ())], None, NOISE).reasons
    assert "The model gives q = 0.500 ± 0.010 no integer value" in reason


def test_where_the_model_lacks_something_its_orders_are_no_evidence():
    claim = claim_of(CLEAR, nearest(), MISFIT)
    assert claim.claim == "undecided"
    assert "9 times the recording's rounding, and correlated" in " ".join(claim.reasons)
    assert claim.reasons[-1].startswith("To decide")


def test_a_finding_that_contradicts_forbids_the_word_fractional():
    claim = claim_of(CLEAR, nearest(), NOISE, ["alpha may be 5 ms late."])
    assert claim.claim == "undecided"
    assert "lacks" not in " ".join(claim.reasons)  # it leaves noise: another model would not decide it
    assert claim.reasons[-1] == "To decide: refit after fixing it."


def test_the_floor_is_taken_from_the_near_end_of_the_interval():
    far, near = OrderFound("mu", 0.98, 0.001), OrderFound("mu", 0.98, 0.010)
    assert far.least_distance == pytest.approx(0.019)
    assert far.least_distance > FLOOR > near.least_distance
    assert math.pi / 2 * FLOOR == pytest.approx(0.02)
    assert [claim_of([o], nearest(), NOISE).claim for o in (far, near)] == ["fractional", "undecided"]


def test_only_the_order_of_a_swing_is_said_to_act_like_a_damping_ratio():
    """Of a material or a cell the distance from the integer is said, and nothing that a rig alone has."""
    for swings, ratio in ((True, True), (False, False)):
        orders = [OrderFound("q", q, 0.002, rungs=frozenset(), swings=swings) for q in (0.7, 0.99)]
        fractional, little = (claim_of([order], nearest(), NOISE) for order in orders)
        settled = claim_of(orders, nearest(as_well=True), MISFIT)
        assert (fractional.claim, little.claim) == ("fractional", "undecided")
        assert (fractional.codes[0], little.codes[0]) == ("effect", "too-little")
        said = " ".join((*fractional.reasons, *little.reasons, *settled.reasons))
        assert [w in said for w in ("damping ratio", "a cable or a bearing", "springpot")] == [ratio] * 3
        assert ("q = 0.7000 ± 0.0020 differs from 1 by 0.3." in said) is not ratio


def test_a_claim_shows_the_half_width_of_the_tables_unless_that_seems_to_tell_otherwise():
    assert str(OrderFound("mu", 0.9294, 0.0026, shown=(0.9264, 0.9320))) == "μ = 0.9294 ± 0.0028"
    assert str(OrderFound("mu", 0.9973, 0.0026, shown=(0.9943, 0.9999))) == "μ = 0.9973 ± 0.0026"
    assert str(OrderFound("q", 0.5, 0.0026, (), shown=(0.4970, 0.5026))) == "q = 0.5000 ± 0.0028"
    assert str(OrderFound("mu", 0.994, 0.022, shown=(0.986, 1.016))) == "μ = 0.994, 0.986 … 1.016"


def test_a_springpots_order_is_none_at_both_ends():
    orders = [OrderFound("springpot_order_alpha", v, 0.05, (0.0, 1.0)) for v in (0.5, 0.02, 0.97)]
    assert [o.off for o in orders] == [True, False, False]


def test_rounding_of_a_swing_and_of_a_rest_is_explained_and_a_swing_left_over_is_not():
    t = np.arange(0, 20, 0.002)
    y = 0.5 * np.exp(-t) * np.cos(6 * t)  # half the record is rest
    counts = STEP * np.round((y + 0.4 * STEP) / STEP)
    assert left_over(counts - y - 0.4 * STEP, counts).explained
    assert not left_over(counts - 0.97 * y, counts).explained
    assert left_over(1e-3 * np.random.default_rng(1).standard_normal(4000), y[:4000]).white
    assert left_over(np.zeros(t.size), y).explained  # nothing left at all


@pytest.mark.parametrize("orders", [[OrderFound("mu", 1.0, 0.001)], CLEAR])
@pytest.mark.parametrize("alternative", [None, nearest(as_well=True)])
def test_a_model_that_does_not_follow_the_motion_claims_nothing(orders, alternative):
    claim = claim_of(orders, alternative, {"swing, alpha": LeftOver(2.3, STEP, 0.001, fit=-1014.0)})
    assert claim.claim == "undecided"
    assert claim.codes == ("no-fit", "decide-model")
    assert claim.reasons[0].startswith("The model does not fit swing, alpha (fit -1014 %)")
    assert claim.reasons[1].endswith("units and clock; another start may do better, type --multi-start 16.")


def test_more_starts_are_not_advised_where_they_would_replace_the_optimiser():
    claim = claim_of(CLEAR, None, {"swing, alpha": LeftOver(2.3, STEP, 0.001, fit=0.0)}, starts=0)
    assert claim.reasons[1].endswith("Look at their columns, zeros, signs, units and clock.")


def test_an_order_that_only_the_bound_of_another_parameter_keeps_off_its_integer_is_undecided():
    springpot = OrderFound("nu", 0.035, 0.001, (0.0, 1.0))
    held = [replace(springpot, beyond_bounds=0.027), replace(springpot, beyond_bounds=0.002)]
    claims = [claim_of([order], nearest(), NOISE) for order in held]
    assert [claim.claim for claim in claims] == ["undecided", "fractional"]
    assert claims[0].codes == ("bound", "decide-decades")


def test_an_integer_order_model_that_is_far_better_is_believed_beside_a_fit_that_is_none():
    far_better = replace(nearest(as_well=True), gain=-300.0)
    assert claim_of(CLEAR, far_better, {"swing, alpha": LeftOver(2.3, STEP, 0.001, fit=10.0)}).claim == "integer"


@pytest.mark.parametrize("left", [
    LeftOver(1e-2, 0.0, 1.0, fit=3.0),  # noise
    LeftOver(5 * STEP / math.sqrt(12), STEP / math.sqrt(12), 0.01, fit=-40.0),  # an arm that moves by a count
    LeftOver(40 * STEP, STEP / math.sqrt(12), 0.01, fit=80.0),
])  # fmt: skip
def test_noise_a_joint_that_hardly_moves_and_a_model_that_lacks_something_are_fits_all_the_same(left):
    assert left.fits


def test_several_residuals_that_are_no_noise_are_one_sentence():
    both = MISFIT | {"swing, theta": LeftOver(8e-3, STEP / math.sqrt(12), 0.01)}
    [sentence] = [r for r in claim_of([OrderFound("mu", 1.0, 0.01)], None, both).reasons if "lacks" in r]
    assert sentence == (
        "The residuals of swing, alpha (9 times the recording's rounding) and swing, theta (18 times the recording's "
        "rounding) are correlated: the model lacks something; another start may do better, type --multi-start 16."
    )


def test_another_start_is_advised_of_a_residual_only_where_one_was_searched_and_nothing_else_explains_it():
    one, many = (claim_of(CLEAR, nearest(), MISFIT, ["It is late."], starts=n).reasons for n in (1, 16))
    compared = claim_of(CLEAR, nearest(), MISFIT, ["It is late."], compared=True).reasons
    advised = [[k for k, said in enumerate(reasons) if "--multi-start" in said] for reasons in (one, many, compared)]
    assert advised == [[1], [], []]
    assert one[2] == "It is late."


def test_what_a_fit_leaves_over_is_read_back_as_it_was():
    coloured = LeftOver(4e-3, STEP / math.sqrt(12), 0.01, coloured=True)
    assert record_of(LeftOver, as_json(LeftOver, coloured)) == coloured
    assert coloured.noise
    old = {n: v for n, v in as_json(LeftOver, coloured).items() if n != "coloured"}
    assert not record_of(LeftOver, old).coloured


def test_a_comparison_asks_for_held_out_recordings_where_the_residual_is_white_noise_already():
    none = 'No recording was held out (use = "validate").'
    white, misfit = (claim_of(CLEAR, nearest(), e, [none], compared=True).reasons for e in (NOISE, MISFIT))
    assert white[0].endswith("but that is not confirmed.")  # nothing is left over for them to stand in for
    assert white[-1].startswith("To decide: recordings that are held out")
    assert misfit[0].endswith("but orders may stand in for what the model lacks.")
    assert misfit[-1] == "To decide: a model whose residual is white noise."


def test_advice_that_needs_recordings_held_out_says_how_to_hold_them_out():
    none = 'No recording was held out (use = "validate").'
    fit = claim_of(CLEAR, replace(nearest(), cut=True), NOISE)
    compared = claim_of(CLEAR, nearest(), NOISE, [none], compared=True)
    assert (fit.claim, compared.claim) == ("undecided", "undecided")
    for advice in (fit.reasons[-1], compared.reasons[-1]):
        assert "fracid compare" in advice
        assert 'use = "validate" in their [[recording]]' in advice
        assert "--leave-one-out" in advice


def test_where_no_order_is_free_a_correlated_residual_is_a_reason_to_doubt_the_intervals():
    noise, more = LeftOver(1e-3, 0.0, 1.0), LeftOver(1e-3, 0.0, 0.01)
    assert claim_of([], None, {"cell, voltage": noise}).reasons == ("No order was free, so none is found.",)
    said = claim_of([], None, {"cell, voltage": more, "cell, temperature": noise})
    assert (said.claim, said.codes) == ("undecided", ("given", "given-lacks"))
    assert "The residual of cell, voltage is correlated: the model lacks something." in said.reasons[1]
