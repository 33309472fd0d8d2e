"""The cut: what is taken for the past changes the orders where it must, and nowhere else."""

import json
from dataclasses import replace

import numpy as np
import pytest

import fracid
from fracid.estimation.covariance import uncertainty
from fracid.estimation.horizons import Watch, refined
from fracid.estimation.windows import piece
from fracid.problem import Free, Problem
from fracid.problem.costs import cost_from_name
from fracid.validation.unknown_past import AsFitted, CutCheck, Treatment, cut_check, whole_records
from twins import release

RIG = fracid.rotary_pendulum("srv02-rotpen", b_theta=1e-2, b_alpha=3e-4)
STEP, PLATEAU = 5e-3, 0.5
TRUE = {"lambda": 0.9, "mu": 0.95}
FREE = {"lambda": Free(0.9, 0.5, 1.2), "mu": Free(0.95, 0.5, 1.2)}


def twin(orders=TRUE, noise=1e-4, end=5.0, plateau=PLATEAU):
    """A release after a held plateau, from the record's first sample on."""
    return release("twin", RIG, orders=orders, alpha=np.radians(60), step=STEP, end=end, finer=4, plateau=plateau,
                   noise=noise, known=False)  # fmt: skip


def cut(whole, at, past=False):
    k = round(at / STEP)
    before = whole.measured[:k] if past else None
    return replace(whole, measured=whole.measured[k:], start=k * STEP, past=before)


def checked(problem, whole=None, **options):
    x = refined(problem, problem.start, Watch(), tolerance=1e-6).best.point
    return cut_check(problem, x, uncertainty(problem, x), whole=whole, **options)


# --- the orders -------------------------------------------------------------------------------------------


def test_a_forgotten_past_falsifies_an_order_and_both_ways_to_know_it_find_the_truth():
    whole = twin()
    found = checked(Problem(RIG, (cut(whole, PLATEAU + 1.3),), FREE), {"twin": whole})
    by, fit = {name.split(" by ")[0]: t for name, t in found.treatments.items()}, found.as_fitted
    assert set(by) == {"with the past", "from the plateau", "cut later"}
    assert abs(fit.orders["lambda"] - 0.9) > 0.01
    for name in ("with the past", "from the plateau"):
        for order, true in TRUE.items():
            assert abs(by[name].orders[order] - true) < 0.001, (name, order)
            assert by[name].shift[order] == by[name].orders[order] - fit.orders[order]
        assert by[name].cost < 0.1 * fit.cost
    warning = found.warnings[-1]
    assert warning.startswith("The motion before the start explains part of the residual: with it the rms falls to ")
    assert f"(λ {fit.orders['lambda']:.4g} → {by['with the past'].orders['lambda']:.4g}, μ " in warning
    assert warning.endswith('type from = "release" and initial_state = "rest".')


@pytest.mark.broad
def test_a_treatment_that_fits_worse_is_no_rival():
    whole = twin()
    found = checked(Problem(RIG, (cut(whole, PLATEAU + 1.3, past=True),), FREE))
    assert abs(found.treatments["without the past"].shift["lambda"]) > found.half_width["lambda"]
    assert "without the past" not in found.rivals
    assert found.warnings == ()
    assert found.verdict.startswith("No order moves by more than its interval")


@pytest.mark.few(1)
@pytest.mark.parametrize("start", ["from the plateau", "with its past"])
def test_orders_of_a_right_start_stay_within_their_intervals_wherever_the_record_is_cut(start):
    whole = twin(noise=1e-3)
    if start == "from the plateau":
        problem = Problem(RIG, (cut(whole, PLATEAU),), FREE, initial_state="rest")
    else:
        problem = Problem(RIG, (cut(whole, PLATEAU + 0.7, past=True),), FREE)
    found = checked(problem)
    later = [t for name, t in found.treatments.items() if name.startswith("cut later by")]
    assert len(later) == 1
    assert all(abs(s) < found.half_width[n] for n, s in later[0].shift.items())
    assert abs(later[0].orders["mu"] - 0.95) < 1e-3


@pytest.mark.broad
def test_integer_orders_have_no_memory_so_the_past_changes_nothing():
    whole = twin({"lambda": 1.0, "mu": 1.0}, noise=1e-3)
    near_one = {n: Free(1.0, 0.5, 1.2) for n in TRUE}
    found = checked(Problem(RIG, (cut(whole, PLATEAU + 0.7, past=True),), near_one))
    without = found.treatments["without the past"]
    assert all(abs(s) < found.half_width[n] for n, s in without.shift.items())


# --- which treatments -------------------------------------------------------------------------------------


@pytest.mark.few(1)
@pytest.mark.parametrize(("initial_state", "past", "earlier", "names"), [
    ("estimate", False, False, {"cut later"}),
    ("estimate", False, True, {"cut later", "with the past", "from the plateau"}),
    ("estimate", True, False, {"cut later", "without the past", "from the plateau"}),
    ("measured", True, False, {"cut later", "without the past", "from the plateau"}),
    ("measured", False, True, {"cut later", "with the past", "from the plateau"}),
    ("rest", False, True, {"cut later"}),
    ("held", False, False, {"cut later"}),
])  # fmt: skip
def test_a_treatment_is_left_out_where_it_is_done_already_or_cannot_be(initial_state, past, earlier, names):
    whole = twin(end=4.0, noise=1e-3)
    at = PLATEAU + (0.0 if initial_state in ("rest", "held") else 0.7)
    problem = Problem(RIG, (cut(whole, at, past),), {"lambda": 0.9, "mu": FREE["mu"]}, initial_state=initial_state)
    found = cut_check(problem, problem.start, None, whole={"twin": whole} if earlier else None, budget=1)
    assert {name.split(" by ")[0] for name in found.treatments} == names
    assert set(found.left_out) == {"with the past", "without the past", "from the plateau", "cut later"} - names
    assert all(found.left_out.values())


def test_a_recording_without_an_arm_has_no_past_and_the_check_says_so():
    whole = twin(end=4.0)
    whole = replace(whole, measured=whole.measured[:, [1]])
    problem = Problem(RIG, (cut(whole, PLATEAU + 0.7),), {"lambda": 0.9, "mu": FREE["mu"]}, outputs=("alpha",))
    found = cut_check(problem, problem.start, None, whole={"twin": whole}, budget=1)
    assert "a past needs all that moves among the outputs, which are alpha" in found.left_out["with the past"]


def test_a_motion_that_does_not_turn_early_is_not_cut_later():
    problem = Problem(RIG, (twin(end=0.3, plateau=0.0),), {"lambda": 0.9, "mu": FREE["mu"]}, initial_state="held")
    found = cut_check(problem, problem.start, None)
    assert found.treatments == {}
    assert "no turning point was found in the first 25% of the record" in found.verdict
    assert found.verdict.startswith("The cut was not checked: ")


def test_a_drive_and_what_the_encoder_calls_zero_go_with_the_cut():
    whole = twin(end=4.0, plateau=0.0)
    ramp = np.linspace(0, 1, len(whole.measured))[:, None]
    later = cut(replace(whole, inputs=ramp), 0.7)
    later = replace(later, inputs=ramp[140:], measured=later.measured + 0.01)  # zero = "rest", taken elsewhere
    from fracid.validation.unknown_past import _onwards

    past = _onwards(replace(whole, inputs=ramp), later, 10)
    assert np.array_equal(past.all_inputs, ramp)
    assert np.allclose(np.vstack([past.past, past.measured]), whole.measured + 0.01)
    assert past.start == pytest.approx(0.75)
    assert np.array_equal(piece(later, "later", 10, len(later.measured)).inputs, ramp[150:])


@pytest.mark.parametrize(("change", "words"), [
    ({"orders": TRUE, "parameters": {"b_alpha": Free(3e-4, 0.0, 1e-2)}}, "no order is free"),
    ({"model": RIG.with_parameters(C3=0.1)}, "the fit's own run fails: twin: "),  # det M = 0
    ({"cost_function": "own.py:spread"}, "a user's own, which least squares cannot refine"),
])  # fmt: skip
def test_what_cannot_be_checked_is_told_in_a_sentence(change, words, tmp_path):
    if "cost_function" in change:
        (tmp_path / "own.py").write_text("def spread(t, r):\n    return abs(r).max()\n", encoding="utf-8")
        change = {"cost_function": cost_from_name(str(tmp_path / change["cost_function"]))}
    problem = replace(Problem(RIG, (twin(end=2.0),), FREE), **change)
    assert words in str(cut_check(problem, problem.start, None))


# --- in words and as JSON -----------------------------------------------------------------------------------


AS_FITTED = AsFitted({"mu": 1.0}, 0.1, {"alpha": 0.1})
LATER_NAME = "cut later by 0.3 s"


def made(half, shift, level=0.1, later=None, **options):
    t = Treatment({"mu": 1.0 + shift}, 0.1, {"alpha": level}, {"mu": shift}, options.get("stopped", False))
    return CutCheck(AS_FITTED, {"mu": half}, {"with the past": t} | ({LATER_NAME: later} if later else {}), {})


LATER = Treatment({"mu": 1.08}, 0.1, {"alpha": 0.1}, {"mu": 0.08}, False)


@pytest.mark.parametrize(("found", "words"), [
    (made(0.006, 0.05), "μ moves by +0.05 with what is taken for the motion before it (1 as fitted, 1.05 with the "
                        "past), 8.3 times its interval of ± 0.006"),
    (made(0.006, 0.05, later=LATER), "μ moves by +0.08 with where the record is cut"),
    (made(0.006, -0.05), "the interval ignores model error. Take 0.95 … 1 for what is known of μ."),
    (made(0.006, 0.05, stopped=True), "1.05 with the past, and still moving when the refit was stopped"),
    (made(0.1, 0.05), "No order moves by more than its interval, wherever the record is cut; at most they move: μ by"),
    (made(None, 0.05), "No order moves by more than its interval"),
    (made(1e-9, 5e-5), "No order moves by more than its interval"),  # too little to matter
    (made(0.006, 0.05, level=0.2), "Nothing else that is taken for the motion before the start fits as well"),
    (made(0.1, 0.05, level=0.05), "with it the rms falls to 50 % (α) of what it was (μ 1 → 1.05). Give the "
                                  'fit its past: type history = "measured".'),
])  # fmt: skip
def test_the_verdict_is_a_sentence_to_act_on(found, words):
    assert words in found.verdict


def test_the_record_goes_through_json():
    record = json.loads(json.dumps(made(0.006, 0.05).to_json(), allow_nan=False))
    assert record["treatments"]["with the past"]["shift"] == {"mu": 0.05}
    assert record["range"] == {"mu": [1.0, 1.05]}
    assert len(record["warnings"]) == 1
    assert CutCheck.of_json(record) == made(0.006, 0.05)


def test_the_figure_shows_each_order_with_its_interval_and_each_treatment_by_its_name():
    from fracid.plots import cut_shifts

    worse = replace(LATER, levels={"alpha": 0.3})
    (axes,) = cut_shifts(made(0.006, 0.05, later=worse)).axes
    assert [label.get_text() for label in axes.get_yticklabels()] == [LATER_NAME, "with the past", "as fitted"]
    fit, rival, no_rival = sorted(axes.lines, key=lambda line: float(line.get_xdata()[0]))
    assert (fit.get_ydata()[0], rival.get_ydata()[0], no_rival.get_ydata()[0]) == (2, 1, 0)
    assert rival.get_markerfacecolor() != "white"
    assert no_rival.get_markerfacecolor() == "white"
    (band,) = axes.patches
    assert band.get_x() == pytest.approx(0.994)
    assert band.get_width() == pytest.approx(0.012)


def test_there_is_no_figure_of_nothing():
    from fracid.plots import cut_shifts

    with pytest.raises(fracid.InputError, match="There is no treatment to draw: The cut was not checked: "):
        cut_shifts(CutCheck(AS_FITTED, {"mu": None}, {}, {"cut later": "it is short"}))


# --- the whole record of a project ------------------------------------------------------------------------------


def test_the_samples_before_from_are_read_again_and_the_rest_is_as_the_project_has_it(tmp_path):
    whole = twin(end=3.0)
    np.savez(tmp_path / "swing.npz", time=STEP * np.arange(len(whole.measured)), theta=whole.measured[:, 0],
             alpha=whole.measured[:, 1])  # fmt: skip
    columns = 'file = "swing.npz"\ntheta = { column = "theta" }\nalpha = { column = "alpha" }\n'
    cuts = {"late": "from = 1.2\nto = 3.0", "from its start": "", "other": 'from = 1.0\nuse = "validate"'}
    texts = [f'[[recording]]\nname = "{name}"\n{columns}{said}\n' for name, said in cuts.items()]
    (tmp_path / "rig.toml").write_text("".join(texts), encoding="utf-8")
    project = fracid.load_project(tmp_path / "rig.toml")
    found = whole_records(project)
    assert set(found) == {"late"}
    (late, _) = project.problem.experiments
    assert found["late"].start == 0.0
    k = round(late.start / STEP)
    assert np.array_equal(found["late"].measured[k:], late.measured)
