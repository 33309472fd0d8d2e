"""Pareto smoothing against ArviZ's, and its verdict on proposals whose tails are known."""

import numpy as np
import pytest
from scipy.special import logsumexp

from fracid.bayes.pareto import khat_limit, smoothed

X = np.random.default_rng(0).standard_normal(2000)


def log_ratios(scale):
    """Of a normal target 1/scale times as wide as its proposal, a standard normal."""
    return X**2 / 2 - (scale * X) ** 2 / 2


@pytest.mark.parametrize(("scale", "khat"), [(1.2, -1.630058987474551), (0.9, 0.33725961580099384),
                                             (0.5, 0.8394823846919443), (0.3, 0.9804647377172224)])  # fmt: skip
def test_khat_is_that_of_arviz(scale, khat):
    assert smoothed(log_ratios(scale))[1] == pytest.approx(khat, abs=1e-9)  # arviz_stats 0.8.0, array_stats.psislw


@pytest.mark.few(1)
@pytest.mark.parametrize("scale", [0.3, 0.9])
def test_smoothed_weights_are_those_of_arviz(scale):
    stats = pytest.importorskip("arviz_stats.base").array_stats
    theirs, _ = stats.psislw(-log_ratios(scale))
    ours, _ = smoothed(log_ratios(scale))
    np.testing.assert_allclose(ours - logsumexp(ours), theirs - logsumexp(theirs), atol=1e-9)


def test_equal_ratios_need_no_smoothing():
    weights, khat = smoothed(np.zeros(500))
    assert not weights.any()
    assert khat < khat_limit(500)


def test_of_too_few_ratios_nothing_is_promised():
    assert smoothed(log_ratios(0.5)[:20])[1] == np.inf


def test_a_few_draws_must_have_lighter_tails():
    assert khat_limit(100) == pytest.approx(0.5)
    assert khat_limit(10**6) == 0.7
