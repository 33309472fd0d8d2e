"""A misfit is said by its size, a recording that is not predicted as loudly, and first what costs most."""

from dataclasses import replace

import numpy as np
import pytest

import fracid
from fracid.errors import Failure, FailureReason
from fracid.estimation.records import RecordingFit
from fracid.findings import Finding
from fracid.models.written.equations import Equation, Equations
from fracid.signals.left_over import LeftOver
from fracid.validation.after_search import after
from fracid.validation.misfits import cost_of, misfits, missed

pytestmark = pytest.mark.usefixtures("without_rivals")

STEP = 2 * np.pi / 4096
TIME = np.arange(0, 10, 0.01)
SWING = 0.5 * np.exp(-TIME / 5) * np.cos(6 * TIME)


def beside(factor, name="swing"):
    """A swing in counts beside a simulation that is so many times as large."""
    counts = STEP * np.round(SWING / STEP)
    return {name: RecordingFit(name, "fit", TIME, {"alpha": counts}, {"alpha": factor * SWING}, 0.0, {}, {})}


def test_what_hangs_together_and_is_above_three_times_the_rounding_is_said_with_its_size():
    [said] = misfits(beside(0.97), 1)
    rms = np.std(0.03 * SWING)
    assert (said.code, said.where, said.limit) == ("misfit", "swing: alpha", 3.0)
    assert said.number == pytest.approx(rms / (STEP / np.sqrt(12)), rel=0.05)


def test_another_start_is_advised_of_a_misfit_where_one_was_searched():
    one, many = ([f.sentence for f in misfits(beside(0.97), starts)] for starts in (1, 16))
    assert "lacks something; another start may do better, type --multi-start 16. fracid resid" in one[0]
    assert "--multi-start" not in many[0]


def test_a_misfit_of_an_output_that_is_measured_now_and_then_is_said_with_its_size():
    [(name, r)] = beside(0.97).items()
    fitted = np.where(TIME == 0.0, r.measured["alpha"], r.fitted["alpha"])  # its first sample alone has no residual
    own = replace(r, fitted={"alpha": fitted}, scored={"alpha": np.arange(TIME.size) % 20 == 0})
    [said] = misfits({name: own}, 1)
    assert said.number == pytest.approx(np.std(0.03 * SWING) / (STEP / np.sqrt(12)), rel=0.1)


@pytest.mark.parametrize("factor", [1.0, 0.999])
def test_rounding_is_no_misfit(factor):
    assert not list(misfits(beside(factor), 1))


def test_a_fit_that_is_no_better_than_a_constant_is_said_once():
    assert [f.code for f in misfits(beside(-1.0), 1)] == ["cannot-explain"]


def test_a_recording_of_another_rig_is_missed_and_one_that_is_predicted_is_not():
    level = {"alpha": STEP / np.sqrt(12)}
    assert [(f.code, f.unit) for f in missed(beside(-1.0), level)] == [("missed", "% fit")]
    [worse] = missed(beside(0.95), level)
    assert (worse.code, worse.limit) == ("missed", 3.0)
    assert "does not hold beyond that" in worse.sentence
    assert not list(missed(beside(1.0), level))


def test_findings_are_told_by_how_far_they_are_beyond_their_limits():
    far, near, below = (Finding("x", "", n, 3.0, "", "") for n in (30.0, 3.3, 1.0))
    assert sorted([near, far, below], key=cost_of, reverse=True) == [far, below, near]


def test_rounding_is_an_encoders_of_an_angle_alone_and_noise_is_a_cause_where_it_is_coloured():
    force = {n: replace(r, units={"alpha": "N"}) for n, r in beside(0.97).items()}
    left = LeftOver(0.03, 1e-3, 0.02, coloured=True)
    [angle], [other], [noise] = misfits(beside(0.97), 1), misfits(force, 1), misfits(force, 1, {"swing, α": left})
    [shaken] = misfits(force, 16, {"swing, α": replace(left, inputs="torque")})
    assert "times the encoder's rounding" in angle.sentence
    assert (other.unit, "encoder" in other.sentence) == ("times the recording's rounding", False)
    assert "autocorrelated: the model lacks something" in other.sentence
    assert "autocorrelated: correlated noise, or a model that lacks something" in noise.sentence
    assert "autocorrelated: the noise of torque explains that. fracid" in shaken.sentence


def test_what_is_masked_is_nothing_that_a_model_must_explain():
    decay = Equations({"v": Equation("-k*v")}, {"v": Equation("v")}, {})
    model = decay.model("decay", [fracid.Parameter("k", "1/s", 0.3, "", lower=0.0)])
    none = Failure(FailureReason.INTERRUPTED, "the search was interrupted")
    noise = 1e-3 * np.random.default_rng(1).standard_normal(TIME.size)
    frozen = np.where((TIME > 3) & (TIME < 4), 1.0, np.exp(-0.3 * TIME) + noise)[:, None]
    e = fracid.Experiment("alone", 0.01, frozen, np.zeros((1, 0)), units={"v": "1"}, mask=((3.0, 4.0),))
    found = [after(fracid.Problem(model, (one,), {}, {"k": fracid.Free(0.3, 0.1, 1.0)}), np.array([0.3, 1.0]), none)
             for one in (e, replace(e, mask=()))]  # fmt: skip
    assert [[f.code for f in fs] for fs in found] == [[], ["cannot-explain"]]


def test_a_fit_that_explains_little_says_what_to_type_for_a_state_that_no_output_shows():
    pair = Equations({"v": Equation("w - v"), "w": Equation("-k*w")}, {"v": Equation("v")}, {})
    model = pair.model("pair", [fracid.Parameter("k", "1/s", 0.3, "", lower=0.0)])
    swing = np.exp(-0.3 * TIME) - np.exp(-TIME)
    e = fracid.Experiment("alone", 0.01, swing[:, None], np.zeros((1, 0)), units={"v": "1"})
    fit = fracid.identify(fracid.Problem(model, (e,), {}, {"k": fracid.Free(0.3, 0.1, 1.0)}))
    [found] = [f for f in fit.findings if f.code == "cannot-explain"]
    assert 'No output shows w, whose start is taken as 0: type initial = { "w" = { start = 0, ' in str(found)
    free = replace(e, initial={"w": fracid.Free(0.0, -3.0, 3.0)})
    fit = fracid.identify(fracid.Problem(model, (free,), {}, {"k": fracid.Free(0.3, 0.1, 1.0)}))
    assert fit.parameters["k"].value == pytest.approx(0.3, rel=1e-3)
