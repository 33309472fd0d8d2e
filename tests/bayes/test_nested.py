"""Nested sampling where Laplace's approximation fails, and without its packages."""

import sys

import numpy as np
import pytest

from fracid.bayes import nested
from fracid.bayes.nested import nested_sample
from fracid.bayes.target import BoxPrior
from fracid.errors import InputError
from fracid.tasks.tasks import Execution
from test_importance import Banana, Normal, TwoPeaks, box


@pytest.fixture
def fast(monkeypatch):
    """Few live points and one network: enough for densities of two or three parameters."""
    pytest.importorskip("nautilus")
    monkeypatch.setattr(nested, "LIVE", 300)
    monkeypatch.setattr(nested, "NETWORKS", 1)


def mean_of(sample, values):
    return float(np.exp(sample.log_weights) @ values)


@pytest.mark.broad
def test_two_peaks_out_of_reach_of_each_other_are_both_found_with_their_evidence(fast):
    sample = nested_sample(TwoPeaks(4.0), box(3, 10.0), draws=2000, seed=1)
    exact = np.log(4 / 3) + 1.5 * np.log(2 * np.pi) - 3 * np.log(20)
    assert sample.log_evidence == pytest.approx(exact, abs=0.05)
    assert mean_of(sample, sample.points[:, 0] > 0) == pytest.approx(0.75, abs=0.03)


@pytest.mark.broad
def test_a_bent_valley_is_followed_to_both_ends(fast):
    prior = BoxPrior(np.array([-5.0, -1.0]), np.array([5.0, 30.0]), {})
    sample = nested_sample(Banana(), prior, draws=2000, seed=1)
    # x₁ is N(1, 1), x₂ | x₁ is N(x₁², 1/400)
    assert mean_of(sample, sample.points[:, 0]) == pytest.approx(1.0, abs=0.1)
    assert sample.log_evidence == pytest.approx(np.log(2 * np.pi / 20 / 310), abs=0.1)


@pytest.mark.broad
def test_nested_draws_are_the_same_to_the_bit_for_any_number_of_threads(fast):
    samples = [
        nested_sample(Normal(np.eye(2)), box(2, 5.0), draws=300, seed=1, execution=Execution(jobs=jobs))
        for jobs in (1, 2)
    ]
    np.testing.assert_array_equal(samples[0].points, samples[1].points)
    np.testing.assert_array_equal(samples[0].log_weights, samples[1].log_weights)


def test_a_missing_package_is_named_with_what_to_type(monkeypatch):
    monkeypatch.setitem(sys.modules, "nautilus", None)
    with pytest.raises(InputError, match=r"needs nautilus, .* type pip install 'fracid\[posterior\]'"):
        nested_sample(Normal(), box(3, 5.0), draws=100, seed=1)


def test_nested_sampling_on_processes_is_refused():
    with pytest.raises(InputError, match="runs on threads, not on processes"):
        nested_sample(Normal(), box(3, 5.0), draws=100, seed=1, execution=Execution("processes"))
