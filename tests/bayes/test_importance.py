"""Laplace's approximation corrected by importance sampling, on densities whose posterior and evidence are known."""

from types import SimpleNamespace

import numpy as np
import pytest

from fracid.bayes.laplace import PILOT, importance_sample
from fracid.bayes.target import BoxPrior, GaussianApproximation, approximation
from fracid.errors import InputError
from fracid.problem.unknowns import Prior
from fracid.tasks.journal import Journal
from fracid.tasks.tasks import Execution

COVARIANCE = np.array([[1.0, 0.9, 0.0], [0.9, 1.0, 0.0], [0.0, 0.0, 1e-8]])
"""Correlated, and of very different units."""


class OneByOne:
    def log_likelihoods(self, points):
        return [self.log_likelihood(x) for x in points]


class Normal(OneByOne):
    """A likelihood of known covariance."""

    def __init__(self, covariance=COVARIANCE):
        self.precision = np.linalg.inv(covariance)

    def log_likelihood(self, x):
        return -0.5 * float(x @ self.precision @ x)


class Banana(OneByOne):
    """Rosenbrock's valley in four dimensions: bent, and as thin as a hundredth of its length."""

    def log_likelihood(self, x):
        return -float(np.sum(200 * (x[1:] - x[:-1] ** 2) ** 2 + 0.5 * (1 - x[:-1]) ** 2))


class TwoPeaks(OneByOne):
    """Two normal densities about ±c in each parameter, the second three times as probable."""

    def __init__(self, c):
        self.c = c

    def log_likelihood(self, x):
        first, second = (-0.5 * float(np.sum((x - c) ** 2)) for c in (-self.c, self.c))
        return float(np.logaddexp(first, second + np.log(3.0)) - np.log(3.0))


def box(n, reach):
    return BoxPrior(np.full(n, -reach), np.full(n, reach), {})


def test_the_evidence_of_a_linear_gaussian_model_is_the_closed_form():
    width = np.array([40.0, 40.0, 4e-3])
    sample = importance_sample(Normal(), BoxPrior(-width / 2, width / 2, {}),
                               GaussianApproximation(np.zeros(3), COVARIANCE), draws=2000, seed=1)  # fmt: skip
    exact = 0.5 * np.linalg.slogdet(2 * np.pi * COVARIANCE)[1] - np.sum(np.log(width))
    assert sample.log_evidence == pytest.approx(exact, abs=0.05)
    assert sample.evidence_error < 0.05
    assert sample.trusted


def test_a_normal_prior_counts_in_posterior_and_evidence():
    prior = BoxPrior(np.array([-50.0]), np.array([50.0]), {0: Prior(2.0, 1.0)})
    sample = importance_sample(
        Normal(np.eye(1)), prior, GaussianApproximation(np.ones(1), np.full((1, 1), 0.5)), draws=2000, seed=1
    )
    assert np.exp(sample.log_weights) @ sample.points[:, 0] == pytest.approx(1.0, abs=0.05)
    exact = -0.25 * 2.0**2 - 0.5 * np.log(2)  # ∫ exp(−x²/2) N(x; 2, 1) dx
    assert sample.log_evidence == pytest.approx(exact, abs=0.05)


def test_beyond_a_bound_nothing_is_drawn_and_no_correlation_lost():
    prior = BoxPrior(np.array([0.0, -10.0, -1e-2]), np.array([10.0, 10.0, 1e-2]), {})
    asked = []

    class Watched(Normal):
        def log_likelihood(self, x):
            asked.append(x)
            return super().log_likelihood(x)

    sample = importance_sample(Watched(), prior, GaussianApproximation(np.zeros(3), COVARIANCE), draws=2000, seed=1)
    assert len(asked) == sample.draws == 2000
    assert min(x[0] for x in asked) >= 0
    exact = 0.5 * np.linalg.slogdet(2 * np.pi * COVARIANCE)[1] - np.log(2) - np.log(10 * 20 * 2e-2)
    assert sample.log_evidence == pytest.approx(exact, abs=0.05)
    assert sample.effective_draws > 1500


def test_with_one_parameter_at_its_bound_the_others_begin_on_the_ridge_and_not_beside_it():
    ridge = np.array([[1.0, -0.998], [-0.998, 1.0]])
    prior = BoxPrior(np.array([-50.0, 0.0]), np.array([50.0, 10.0]), {})
    likelihood = SimpleNamespace(precision=np.linalg.inv(ridge), centre=np.zeros(2), degrees=np.inf)
    shape = approximation(likelihood, prior, np.array([False, True]))
    assert shape.mean == pytest.approx([0.0, 0.0], abs=0.01)  # 5 sd of it beside: 0.3
    sample = importance_sample(Normal(ridge), prior, shape, draws=1000, seed=1)
    assert sample.trusted
    assert sample.log_evidence == pytest.approx(
        0.5 * np.linalg.slogdet(2 * np.pi * ridge)[1] - np.log(2 * 100 * 10), abs=0.1
    )


def test_a_mode_beyond_its_bounds_is_the_one_within_them():
    ridge, prior = np.array([[1.0, 0.9], [0.9, 1.0]]), BoxPrior(np.zeros(2), np.full(2, 100.0), {0: Prior(-3.0, 1.0)})
    likelihood = SimpleNamespace(precision=np.linalg.inv(ridge), centre=np.array([0.5, 2.0]), degrees=np.inf)
    shape = approximation(likelihood, prior, np.zeros(2, dtype=bool))
    assert shape.mean == pytest.approx([0.0, 2.0 - 0.9 * 0.5], abs=0.02)  # the second, given the first at 0


def test_the_density_of_a_proposal_is_one_in_all():
    proposal = GaussianApproximation(np.array([0.0, 0.5]), COVARIANCE[:2, :2])
    x = np.linspace(-40, 40, 500)
    grid = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2)
    density = np.exp(proposal.log_density(grid)).reshape(500, 500)
    assert np.trapezoid(np.trapezoid(density, x), x) == pytest.approx(1.0, abs=0.01)


@pytest.mark.few(1)
@pytest.mark.parametrize(("density", "shape"), [
    (Banana(), GaussianApproximation(np.ones(4), 0.02 * np.eye(4))),
    (TwoPeaks(1.5), GaussianApproximation(np.full(3, 1.5), np.eye(3))),  # 5 standard deviations apart
])  # fmt: skip
def test_khat_says_that_a_bent_posterior_or_one_of_two_peaks_is_not_laplaces(density, shape):
    sample = importance_sample(density, box(len(shape.mean), 10.0), shape, draws=4000, seed=1)
    assert not sample.trusted


def test_a_second_proposal_that_promises_nothing_costs_its_first_draws_alone():
    between = GaussianApproximation(np.ones(2), 0.01 * np.eye(2))
    sample = importance_sample(TwoPeaks(6.0), box(2, 20.0), between, draws=2000, seed=1)
    assert sample.simulations == 2000 + PILOT


@pytest.mark.parametrize("executor", ["threads", pytest.param("processes", marks=pytest.mark.broad)])
def test_draws_are_the_same_to_the_bit_for_any_number_of_workers(executor):
    samples = [
        importance_sample(Normal(), box(3, 20.0), GaussianApproximation(np.zeros(3), 2 * COVARIANCE), draws=600, seed=3,
                          execution=execution)
        for execution in (Execution("threads", 1), Execution(executor, 2))
    ]  # fmt: skip
    np.testing.assert_array_equal(samples[0].points, samples[1].points)
    np.testing.assert_array_equal(samples[0].log_weights, samples[1].log_weights)


def test_an_interrupted_sample_resumes_and_ends_the_same(tmp_path):
    shape = GaussianApproximation(np.zeros(3), COVARIANCE)

    def drawn(likelihood):
        with Journal(tmp_path / "journal.jsonl", {"kind": "test"}) as journal:
            return importance_sample(
                likelihood, box(3, 20.0), shape, draws=600, seed=3, execution=Execution(journal=journal)
            )

    class Interrupted(Normal):
        asked = 0

        def log_likelihood(self, x):
            self.asked += 1
            if self.asked > 300:
                raise ZeroDivisionError
            return super().log_likelihood(x)

    with pytest.raises(Exception, match="12 of 16 repetitions are done"):
        drawn(Interrupted())
    rest = Interrupted()
    again = drawn(rest)
    assert rest.asked == 300
    whole = importance_sample(Normal(), box(3, 20.0), shape, draws=600, seed=3)
    np.testing.assert_array_equal(again.log_weights, whole.log_weights)


def test_draws_that_all_fail_are_refused_in_a_sentence():
    class Nothing(OneByOne):
        def log_likelihood(self, x):
            return -np.inf

    with pytest.raises(InputError, match=r"Of \d+ draws about the minimum 0 lie .* --method nested"):
        importance_sample(Nothing(), box(1, 1.0), GaussianApproximation(np.zeros(1), np.eye(1)), draws=200, seed=1)
