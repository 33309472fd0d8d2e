"""Fit: everything that :func:`fracid.identify` returns; :class:`fracid.schemas.result.FitBlock` is its JSON."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from fracid.arrays import FloatArray
from fracid.estimation.agreement import Spread
from fracid.estimation.covariance import METHODS, Uncertainty
from fracid.estimation.fit_figures import FitPictures
from fracid.estimation.records import Estimate, RecordingFit
from fracid.estimation.starts import Start, won
from fracid.findings import Finding
from fracid.problem import Problem
from fracid.safety.schema import as_json
from fracid.schemas.result import EstimateBlock, FitBlock
from fracid.selection.integer_rival import Alternative
from fracid.selection.opened_bounds import OpenedBound
from fracid.validation.discretisation import Discretisation
from fracid.validation.unknown_past import CutCheck

__all__ = ["Fit"]


@dataclass(frozen=True)
class Fit(FitPictures):
    """The result of :func:`identify`."""

    problem: Problem
    x: FloatArray
    """The unknowns, shape (n_unknowns,)."""
    orders: Mapping[str, Estimate]
    parameters: Mapping[str, Estimate]
    recordings: Mapping[str, RecordingFit]
    cost: float
    outcome: str
    """How the search ended, in words."""
    evaluations: int
    discretisation: Discretisation | None
    uncertainty: Uncertainty | None
    seed: int
    optimiser: str
    warnings: tuple[str, ...] = ()
    """Sentences, those of the findings among them."""
    findings: tuple[Finding, ...] = ()
    """Faults of data, project or model that were seen, each with the number that shows it."""
    timing: Mapping[str, float] = field(default_factory=dict)
    """Seconds spent, per stage."""
    starts: tuple[Start, ...] = ()
    """What became of each start of ``multistart``; empty for other optimisers."""
    claim: str = "undecided"
    """``fractional``, ``integer`` or ``undecided`` (:mod:`fracid.selection.claim`)."""
    claim_reasons: tuple[str, ...] = ()
    """Why, in sentences."""
    opened_bounds: tuple[OpenedBound, ...] = ()
    """The bounds of the project that stopped the search, and were opened."""
    alternative: Alternative | None = None
    """The integer-order model that comes nearest, where one was tried."""
    spread: Spread | None = None
    """What each recording says alone, where there are several."""
    cut: CutCheck | None = None
    """How far the orders move with where the record begins, where that was asked for."""

    def to_json(self) -> dict[str, Any]:
        """Everything but the samples, as plain JSON values; angles in radians.

        See :func:`fracid.runs.folder.write_result` for the file.
        """
        p = self.problem
        return as_json(FitBlock, vars(self) | {
            "model": p.model,
            "method": p.method,
            "memory": p.memory.name,
            "step": p.experiments[0].step / p.substeps,
            "substeps": p.substeps,
            "orders": {n: as_json(EstimateBlock, e) | {"integer": p.model.integer_order(n)}
                       for n, e in self.orders.items()},
            "cost": {"name": p.cost_function.name, "value": self.cost, "outputs": p.outputs},
            "opened_bounds": [vars(b) for b in self.opened_bounds],
            "starts": [vars(s) | {"point": self._named(s.point), "end": self._named(s.end)} for s in self.starts],
            "start_that_won": None if (best := won(self.starts)) is None else best.origin,
            "spread": None if self.spread is None else self.spread.to_json(),
            "cut": None if self.cut is None else self.cut.to_json(),
            "interval_methods": {n: METHODS[n] for n in ("sandwich", "white")} if self.uncertainty else {},
        })  # fmt: skip

    def _named(self, x: FloatArray) -> dict[str, float]:
        """Name of each unknown → its value."""
        return dict(zip(self.problem.names, x.tolist(), strict=True))
