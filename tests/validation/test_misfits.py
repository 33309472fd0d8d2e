"""A misfit is said by its size, a recording that is not predicted as loudly, and first what costs most."""

import numpy as np
import pytest

from fracid.estimation.records import RecordingFit
from fracid.findings import Finding
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
    [said] = misfits(beside(0.97), 1, friction=True)
    rms = np.std(0.03 * SWING)
    assert (said.code, said.where, said.limit) == ("misfit", "swing: alpha", 3.0)
    assert said.number == pytest.approx(rms / (STEP / np.sqrt(12)), rel=0.05)


@pytest.mark.parametrize("friction", [True, False])
def test_compare_is_named_only_where_the_model_has_friction_of_which_it_tries_more(friction):
    [said] = misfits(beside(0.97), 1, friction=friction)
    assert "fracid resid shows what" in said.sentence
    assert ("fracid compare" in said.sentence) == friction


@pytest.mark.parametrize("factor", [1.0, 0.999])
def test_rounding_is_no_misfit(factor):
    assert not list(misfits(beside(factor), 1, friction=True))


def test_a_fit_that_is_no_better_than_a_constant_is_said_once():
    assert [f.code for f in misfits(beside(-1.0), 1, friction=True)] == ["cannot-explain"]


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
