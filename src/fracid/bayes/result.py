"""A posterior: weighted draws of the free parameters of a problem, and how far to trust them."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from fracid.arrays import FloatArray
from fracid.bayes.evidence import log_fit
from fracid.bayes.laplace import WeightedDraws, weighted_covariance
from fracid.bayes.target import SAYS
from fracid.cards import Card, CardDisplay, estimate_text, listed
from fracid.errors import InputError, at_least, installed, refuse_unknown
from fracid.figures import Figure, Style, draw
from fracid.problem import Problem
from fracid.safety.door import own_text
from fracid.safety.schema import as_json
from fracid.schemas.draws import PosteriorBlock

METHODS: dict[str, str] = tomllib.loads(own_text("bayes/methods.toml"))
"""How a posterior is drawn, by name."""

FEW = 100.0
"""Fewer effective draws give no reliable interval."""


@dataclass(frozen=True, repr=False, kw_only=True)
class Posterior(CardDisplay, WeightedDraws):
    """The result of :func:`fracid.posterior`."""

    problem: Problem
    method: str
    """A key of :data:`METHODS`."""
    x: FloatArray
    """The minimum of the cost, where the likelihood is greatest, shape (n_unknowns,)."""
    cost: float
    """There."""
    effective_samples: float
    """How many independent samples the residuals of all recordings are worth."""
    degrees_of_freedom: float
    """Degrees of freedom of the likelihood's Student's t; large where the samples are many."""
    seed: int
    notes: tuple[str, ...] = ()
    """What should be known of it, in sentences."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the free parameters."""
        return self.problem.names

    @property
    def weights(self) -> FloatArray:
        """Weights of the draws, sum 1, shape (n_draws,)."""
        return np.exp(self.log_weights)

    @property
    def mean(self) -> FloatArray:
        """Shape (n_unknowns,)."""
        return np.asarray(self.weights @ self.points)

    @property
    def covariance(self) -> FloatArray:
        """Shape (n_unknowns, n_unknowns)."""
        return weighted_covariance(self.points, self.weights)

    @property
    def standard_deviation(self) -> FloatArray:
        """Shape (n_unknowns,)."""
        return np.sqrt(np.diag(self.covariance))

    def quantile(self, name: str, q: float) -> float:
        """The value below which a part q of the posterior of one parameter lies.

        Raises
        ------
        InputError
            If there is no such parameter.
        """
        refuse_unknown("free parameter", self.names, name)
        values = self.points[:, self.names.index(name)]
        order = np.argsort(values, kind="stable")
        weights = self.weights[order]
        return float(np.interp(q, np.cumsum(weights) - 0.5 * weights, values[order]))

    def interval(self, name: str) -> tuple[float, float]:
        """The central 95 % interval of one parameter."""
        return self.quantile(name, 0.025), self.quantile(name, 0.975)

    @property
    def trusted(self) -> bool:
        """Whether the draws can be believed, by k̂ or the evidence, and by how many of them count."""
        return super().trusted and self.effective_draws >= FEW

    @property
    def sentence(self) -> str:
        """Whether to trust it, why, and what to do if not."""
        if not super().trusted:
            return SAYS("khat" if self.draws else "missed", drawn=self)
        if self.effective_draws < FEW:
            return SAYS("few", drawn=self, least=FEW, more=4 * max(self.draws, 1000))
        return SAYS("trusted-by-khat" if self.draws else "trusted", drawn=self)

    def resampled(self, count: int = 1000, *, seed: int = 1) -> FloatArray:
        """Draws of equal weight, shape (count, n_unknowns), by systematic resampling.

        Parameters
        ----------
        count : int
        seed : int
            Of where it begins.
        """
        at_least("count", count, 1)
        rng = np.random.default_rng(seed)
        at = (np.arange(count) + rng.uniform()) / count
        chosen = np.searchsorted(np.cumsum(self.weights), at).clip(max=len(self.points) - 1)
        return np.asarray(self.points[rng.permutation(chosen)])

    def to_arviz(self, count: int = 1000) -> Any:
        """The draws as ArviZ's ``InferenceData``, in its present form a ``DataTree`` with the group ``posterior``.

        Parameters
        ----------
        count : int
            Draws of equal weight.

        Raises
        ------
        InputError
            If ArviZ is not installed.
        """
        with installed("ArviZ is not installed; type pip install 'fracid[posterior]'."):
            from arviz_base import from_dict
        sample = self.resampled(count)
        return from_dict({"posterior": {name: sample[None, :, i] for i, name in enumerate(self.names)}},
                         attrs={"posterior": {"method": self.method, "seed": self.seed}})  # fmt: skip

    def plot(self, *names: str, style: str | Style = "screen") -> Figure:
        """Each parameter's posterior, and each pair's; see :func:`fracid.plots.posterior_corner`.

        Parameters
        ----------
        *names : str
            Which; the orders and the first of the others if left out, eight at most.
        style : str or Style
            ``screen``, ``journal`` or one's own; see :mod:`fracid.figures`.
        """
        return draw("posterior_corner", self, *names, style=style)

    def plot_predictive(self, *, style: str | Style = "screen") -> Figure:
        """Simulations with draws of the posterior; see :func:`fracid.plots.posterior_predictive`.

        Parameters
        ----------
        style : str or Style
            As for :meth:`plot`.
        """
        return draw("posterior_predictive", self, style=style)

    def to_json(self) -> dict[str, Any]:
        """Plain JSON values, without the draws."""
        sd, mean = self.standard_deviation.tolist(), self.mean.tolist()
        return as_json(PosteriorBlock, vars(self) | {
            "method": METHODS[self.method], "draws": max(self.draws, len(self.points)),
            "effective_draws": self.effective_draws, "khat_limit": self.limit, "trusted": self.trusted,
            "sentence": self.sentence,
            "unknowns": {n: {
                "unit": u.unit, "fitted": float(self.x[i]), "mean": mean[i], "median": self.quantile(n, 0.5),
                "standard_deviation": sd[i], "interval95": self.interval(n), "prior": self._prior(i),
            } for i, (n, u) in enumerate(zip(self.names, self.problem.unknowns, strict=True))},
        })  # fmt: skip

    def _prior(self, i: int) -> Mapping[str, Any]:
        free = self.problem.unknowns[i].range
        normal = {} if free.prior is None else {"mean": free.prior.mean, "sd": free.prior.sd}
        return {"kind": "normal" if normal else "uniform", "lower": free.lower, "upper": free.upper, **normal}

    def _card(self) -> Card:
        texts = (estimate_text(n, self.quantile(n, 0.5), self.interval(n), u.unit)
                 for n, u in zip(self.names, self.problem.unknowns, strict=True))  # fmt: skip
        evidence = "none: a parameter has no bounds" if math.isnan(self.log_evidence) else SAYS("evidence", drawn=self)
        return Card(f"Posterior of {self.problem.model.name}, {len(self.names)} free parameters", (
            ("method", METHODS[self.method]),
            ("verdict", self.sentence),
            ("log evidence", evidence),
            ("parameters", listed(texts)),
            *(("note", note) for note in self.notes),
        ))  # fmt: skip


def log_odds(first: Posterior, second: Posterior) -> float:
    r"""The logarithm of the odds of two models of the same recordings, equally probable beforehand [nats].

    .. math::  \log\frac{p(M_1|y)}{p(M_2|y)} = \log\frac{Z_1}{Z_2} + \frac{c\,n_{eff}}{2} \log\frac{V_2}{V_1}

    with Z relative to the greatest likelihood, V the least cost, squared where it is a root, c = 2 for
    Laplace's errors and else 1, and
    :math:`n_{eff}` that of the better one's residuals, as in BIC (:mod:`fracid.selection.bic`).

    Raises
    ------
    InputError
        If the recordings or the costs differ, an evidence is missing, or draws cannot be trusted.
    """
    a, b = first.problem, second.problem
    if a.cost_function.name != b.cost_function.name or a.outputs != b.outputs or a.weights != b.weights:
        raise InputError("The two posteriors are of different costs or outputs: their evidence cannot be compared.")
    pairs = zip(a.experiments, b.experiments, strict=False)
    if len(a.experiments) != len(b.experiments) or not all(np.array_equal(e.measured, f.measured) for e, f in pairs):
        raise InputError("The two posteriors are of different recordings: their evidence cannot be compared.")
    if math.isnan(first.log_evidence) or math.isnan(second.log_evidence):
        raise InputError("There is no evidence where a free parameter has no bounds: give it a lower and an upper one.")
    for drawn in (first, second):
        if not drawn.trusted:
            raise InputError(f"There are no odds of {drawn.problem.model.name}. {drawn.sentence}")
    samples = (first if first.cost <= second.cost else second).effective_samples
    fit = log_fit(first.cost, samples, a.cost_function) - log_fit(second.cost, samples, a.cost_function)
    return first.log_evidence - second.log_evidence + fit
