r"""What counts as a good fit of all recordings together: errors → one cost, and the rows of least squares.

Errors are measured minus simulated [rad].  Each recording has a cost (:mod:`fracid.problem.costs`); a recording's
`weight` w counts each of its samples as w samples.

**Levels.**  The level of an output is its residual's, never asked for: the rmse with ``weights = "noise"`` is the
geometric mean of the outputs' own, in which one that has fewer samples counts by these,

.. math::  G = \prod_o C_o^{1/m}, \qquad C_o^2 = \tfrac1N\sum_t e_{t,o}^2,

the likelihood of normal errors after each σ_o was maximised out, :math:`-2\log L = 2N\sum_o\log C_o` + const
[BD]_: an output counts by its noise, not by its amplitude or unit.  Its least-squares rows are
:math:`(G/C_o)\,e_{t,o}`, whose weights move with x: reweighting that needs no rounds.  The same holds of
any cost that is a sum, with Laplace's likelihood for iae and itae.  No output counts as better than its encoder,
q/√12.

**Priors.**  A :class:`Prior` is a normal density on an unknown.  With :math:`z = (x - mean)/sd` and n samples of all
outputs, :math:`-2\log` posterior :math:`= n\log C^2 + \sum z^2`, so the cost C becomes :math:`C\sqrt{1 + \sum z^2/n}`
(equal to first order in 1/n) and each prior is one row more, z at the level of the data's rows: where the fit is bad
the data weigh little, and the prior holds.  It counts samples as independent: where the residual is correlated
over k of them, the data weigh k times too much; give sd/√k.  Where :math:`z^2 > n`, that is where data and prior
contradict each other flatly, the prior gives way as Student's t does.  Costs of Laplace's kind have
:math:`C(1 + \sum z^2/2n)`.

References
----------
.. [BD] G. Box, N. Draper, Biometrika 52 (1965) 355: several outputs of unknown levels.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fracid.arrays import FloatArray, by_name
from fracid.optimise import Evaluation
from fracid.problem.costs import Cost
from fracid.problem.experiment import Experiment
from fracid.problem.unknowns import Prior, Weights

FINEST = 1e-9
"""No output's level is below this [rad]."""


@dataclass(frozen=True, eq=False)
class Criterion:
    """Errors of all recordings → cost and rows.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Problem
    >>> still = Experiment("still", 0.1, np.zeros((9, 2)), np.zeros((1, 1)))
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> problem = Problem(rig, (still,), {"lambda": 0.9, "mu": 0.9}, initial_state="held")
    >>> problem.criterion(problem.start, [np.full((9, 2), 0.1)]).cost
    0.1
    """

    experiments: tuple[Experiment, ...]
    """The recordings, in the order of the errors."""
    outputs: tuple[str, ...]
    priors: Mapping[int, Prior]
    """Unknown → its prior, of those that have one."""
    cost_function: Cost
    weights: Weights
    """``equal``: a radian of error counts the same in every output; ``noise``: against its output's own level."""

    def __call__(self, x: FloatArray, errors: list[FloatArray]) -> Evaluation:
        """Cost and rows of the errors at x."""
        cost = self.cost(x, errors)
        return Evaluation(x, cost, self._rows(x, errors) if math.isfinite(cost) else None)

    def cost(self, x: FloatArray, errors: list[FloatArray]) -> float:
        """The cost alone."""
        cost = self._joined(errors)
        if self.weights == "noise" and math.isfinite(cost):
            cost = self._levels(errors)[0] * (1 if self.cost_function.root else np.sum(self._parts))
        return cost * self._prior_factor(x)

    # --- recordings --------------------------------------------------------------------------------

    def _pairs(self, errors: list[FloatArray]) -> list[tuple[Experiment, FloatArray]]:
        return list(zip(self.experiments, errors, strict=True))

    def _joined(self, errors: list[FloatArray], at: slice = slice(None)) -> float:
        """The recordings' costs together, each by its weight; of all outputs, or those `at`."""
        cost = self.cost_function
        scored = [None if e.partly is None else e.partly[:, at] for e in self.experiments]
        costs = [cost.value(e.weighed_at, r, own) for (e, r), own in zip(self._pairs(errors), scored, strict=True)]
        return cost.join(costs, self._samples[:, at].mean(axis=1).tolist(), [e.weight for e in self.experiments])

    @cached_property
    def _samples(self) -> FloatArray:
        """How many count, each as its recording's weight, shape (n_recordings, n_outputs)."""
        return np.array([e.weight * np.count_nonzero(e.scored, axis=0) for e in self.experiments])

    def shares(self) -> list[float]:
        """What each recording's rows are multiplied with, so that their squares add up as its cost does."""
        samples = self._samples.mean(axis=1).tolist()
        if self.cost_function.per_sample:
            return [math.sqrt(n / sum(samples)) for n in samples]
        return [math.sqrt(e.weight) for e in self.experiments]

    # --- levels ------------------------------------------------------------------------------------

    def balance(self, errors: list[FloatArray]) -> FloatArray:
        """By what the squares of each output count, shape (n_outputs,): 1, but (G/C_o)² with ``weights = "noise"``."""
        if self.weights == "equal":
            return np.ones(len(self.outputs))
        mean, levels = self._levels(errors)
        relative = mean / levels
        return np.asarray(relative**2 if self.cost_function.root else relative)

    def sample_weights(self, errors: list[FloatArray]) -> list[FloatArray]:
        """By what the loss of each sample counts, of each recording, shape (n_samples, n_outputs)."""
        if self.weights == "equal":
            return self._equal_weights
        balance = self.balance(errors)
        return [weights * balance for weights in self._equal_weights]

    @cached_property
    def _equal_weights(self) -> list[FloatArray]:
        shares, each = zip(self.experiments, self.shares(), strict=True), np.ones(len(self.outputs))
        return [share**2 * (self.cost_function.weights(e.weighed_at, e.scored) * each) for e, share in shares]

    def levels(self, errors: list[FloatArray]) -> dict[str, float]:
        """The level of each output's residual, rms [rad]."""
        squares = sum(e.weight * np.sum(r**2, axis=0) for e, r in self._pairs(errors))
        return by_name(self.outputs, np.sqrt(squares / self._samples.sum(axis=0)))

    def _levels(self, errors: list[FloatArray]) -> tuple[float, FloatArray]:
        """G, and C_o of each output alone, at least that of its encoder's rounding, shape (n_outputs,).

        Of an output without a sample, as in the first part of a record, C_o is any number: it counts for nothing.
        """
        costs = [self._joined([r[:, [o]] for r in errors], slice(o, o + 1)) for o in range(len(self.outputs))]
        levels = np.asarray(np.hypot(costs, self._floor) if self.cost_function.root else costs + self._floor)
        return float(np.exp(np.average(np.log(levels), weights=self._parts))), levels

    @cached_property
    def _parts(self) -> FloatArray:
        """As how much the level of each output counts: by its samples, and of integrals 1; 0 where it has none."""
        samples = self._samples.sum(axis=0)
        return samples / np.mean(samples) if self.cost_function.per_sample else np.where(samples > 0.0, 1.0, 0.0)

    @cached_property
    def _floor(self) -> FloatArray:
        """C_o of a residual of q/√12, q the step of the output's encoder, shape (n_outputs,)."""
        steps = [max(e.quantum(name, e.in_deviations(e.measured)[:, o]) for e in self.experiments)
                 for o, name in enumerate(self.outputs)]  # fmt: skip
        rounding = np.maximum(np.array(steps) / math.sqrt(12.0), FINEST)
        floors = [self._joined([np.full((len(e.measured), 1), r) for e in self.experiments], slice(o, o + 1))
                  for o, r in enumerate(rounding)]  # fmt: skip
        return np.where(self._parts > 0.0, floors, rounding)

    # --- rows --------------------------------------------------------------------------------------

    def _rows(self, x: FloatArray, errors: list[FloatArray]) -> FloatArray | None:
        """Rows for least squares: the samples', with ``noise`` one for each output's floor, one for each prior."""
        recordings = [self.cost_function.rows(e.weighed_at, r, e.partly) for e, r in self._pairs(errors)]
        rows = [share * r for share, r in zip(self.shares(), recordings, strict=True) if r is not None]
        if not rows:
            return None
        if self.weights == "noise":
            balance = np.sqrt(self.balance(errors))
            rows = [(r.reshape(-1, len(balance)) * balance).ravel() for r in rows]
            balance *= np.sqrt(self._parts)
            rows.append(balance * (self._floor if self.cost_function.root else np.sqrt(self._floor)))
        if self.priors:
            total = sum(float(np.sum(r**2)) for r in rows)
            rows.append(math.sqrt(total / self.prior_samples) * self.prior_residuals(x))
        return np.concatenate(rows)

    # --- priors ------------------------------------------------------------------------------------

    def prior_residuals(self, x: FloatArray) -> FloatArray:
        """z = (x − mean)/sd of the unknowns that have a prior, shape (n_priors,)."""
        return np.array([(x[i] - prior.mean) / prior.sd for i, prior in self.priors.items()])

    @cached_property
    def prior_samples(self) -> float:
        """By what Σz² is divided: n for normal errors, 2n for Laplace's."""
        n: float = sum(e.weight * e.samples * e.measured.shape[1] for e in self.experiments)
        return n if self.cost_function.loss is None else self.cost_function.loss.likelihood_factor * n

    def _prior_factor(self, x: FloatArray) -> float:
        if not self.priors:
            return 1.0
        factor = 1 + float(np.sum(self.prior_residuals(x) ** 2)) / self.prior_samples
        return math.sqrt(factor) if self.cost_function.root else factor
