"""Fit: everything that :func:`fracid.identify` returns, and how it is written as JSON."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fracid.arrays import FloatArray
from fracid.estimation.agreement import Spread
from fracid.estimation.covariance import METHODS, Uncertainty
from fracid.estimation.fit_figures import FitPictures
from fracid.estimation.records import Estimate, RecordingFit
from fracid.estimation.starts import Start, won
from fracid.findings import Finding
from fracid.problem import Problem
from fracid.selection.integer_rival import Alternative
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
    alternative: Alternative | None = None
    """The integer-order rival, where one was tried."""
    spread: Spread | None = None
    """What each recording says alone, where there are several."""
    cut: CutCheck | None = None
    """How far the orders move with where the record begins, where that was asked for."""

    def to_json(self) -> dict[str, Any]:
        """Everything but the samples, as plain JSON values; angles in radians.

        See :func:`fracid.runs.folder.write_result` for the file.
        """
        p = self.problem
        return {
            "model": {"name": p.model.name, "zero": p.model.zero, "source": p.model.source},
            "method": p.method,
            "memory": p.memory.name,
            "step": p.experiments[0].step / p.substeps,
            "orders": {n: {**_estimate_json(e), "integer": p.model.integer_order(n)} for n, e in self.orders.items()},
            "parameters": {n: _estimate_json(e) for n, e in self.parameters.items()},
            "recordings": {n: _recording_json(r) for n, r in self.recordings.items()},
            "cost": {"name": p.cost_function.name, "value": _number(self.cost), "outputs": list(p.outputs)},
            "discretisation": None if self.discretisation is None else _discretisation_json(self.discretisation),
            "evaluations": self.evaluations,
            "optimiser": self.optimiser,
            "outcome": self.outcome,
            "alternative": None if self.alternative is None else _alternative_json(self.alternative),
            "starts": [_start_json(s, self.problem.names) for s in self.starts],
            "start_that_won": None if (best := won(self.starts)) is None else best.origin,
            "spread": None if self.spread is None else self.spread.to_json(),
            "cut": None if self.cut is None else self.cut.to_json(),
            "interval_methods": {n: METHODS[n] for n in ("sandwich", "white")} if self.uncertainty else {},
            "warnings": list(self.warnings),
            "findings": [f.to_json() for f in self.findings],
            "seed": self.seed,
        }


# --- as JSON ---------------------------------------------------------------------------------------


def _number(value: float | None) -> float | None:
    """JSON knows neither NaN nor infinity."""
    return float(value) if value is not None and np.isfinite(value) else None


def _estimate_json(e: Estimate) -> dict[str, Any]:
    return {
        "value": _number(e.value),
        "unit": e.unit,
        "standard_error": _number(e.standard_error),
        "interval95": None if e.interval95 is None else list(e.interval95),
        "interval_method": None if e.interval95 is None else "sandwich",
        "white95": None if e.white95 is None else list(e.white95),
        "free": e.free,
        "at_bound": e.at_bound,
        "bound": _number(e.bound),
        "identifiable": e.identifiable,
        "reason": e.reason,
    }


def _recording_json(r: RecordingFit) -> dict[str, Any]:
    return {
        "use": r.use,
        "samples": len(r.time),
        "from": float(r.time[0]),
        "to": float(r.time[-1]),
        "cost": _number(r.cost),
        "rmse": {n: _number(v) for n, v in r.rmse.items()},
        "fit_percent": {n: _number(v) for n, v in r.fit_percent.items()},
        "initial_state": {n: _estimate_json(e) for n, e in r.initial.items()},
        "parameters": {n: _estimate_json(e) for n, e in r.parameters.items()},
        "data_sha256": r.sha256,
    }


def _alternative_json(a: Alternative) -> dict[str, Any]:
    return {
        "structure": a.structure,
        "cost": _number(a.cost),
        "parameters": dict(a.parameters),
        "bic_gain_of_the_fractional_model": _number(a.gain),
        "effective_samples": _number(a.effective_samples),
        "warning": a.warning,
    }


def _start_json(s: Start, names: tuple[str, ...]) -> dict[str, Any]:
    return {
        "origin": s.origin,
        "start": dict(zip(names, s.point.tolist(), strict=True)),
        "cost_on_first_swing": _number(s.first_cost),
        "end": dict(zip(names, s.end.tolist(), strict=True)),
        "cost": _number(s.cost),
        "ended": s.ended,
        "joined": s.joined,
        "evaluations": s.evaluations,
    }


def _discretisation_json(d: Discretisation) -> dict[str, Any]:
    return {
        "cost": _number(d.cost),
        "cost_half_step": _number(d.cost_half_step),
        "cost_second_order": _number(d.cost_second_order),
        "orders": dict(d.orders),
        "shift": dict(d.shift),
        "warning": d.warning,
    }
