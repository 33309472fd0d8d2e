"""Fit: everything that :func:`fracid.identify` returns; :class:`FitBlock` is its JSON."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from pydantic import Field

from fracid.arrays import FloatArray
from fracid.bayes.inference import WithPosterior
from fracid.cards import Card, CardDisplay, estimate_text, listed
from fracid.estimation.agreement import Spread
from fracid.estimation.covariance import METHODS, Uncertainty
from fracid.estimation.records import Estimate, OrderEstimate, RecordingFit
from fracid.estimation.starts import Start, won
from fracid.findings import Finding
from fracid.optimise.base import Outcome
from fracid.problem import Problem
from fracid.safety.schema import Block, Infinite, Listed, Number, Unknown, as_json
from fracid.selection.claim import ClaimWord
from fracid.selection.doubts import claimed, doubts
from fracid.selection.integer_rival import Alternative
from fracid.selection.opened_bounds import OpenedBound
from fracid.units import GREEK, with_unit
from fracid.validation.discretisation import Discretisation
from fracid.validation.unknown_past import CutCheck

PARTIAL = "PARTIAL: the fit was interrupted. These are the best values so far, not its result."
"""The first warning of an interrupted fit: it stands on the page, on cards, in result.json."""


Scores = Mapping[str, tuple[str, Mapping[str, float | None], Mapping[str, str]]]
"""Recording → use, RMSE of each output [SI], and the units of outputs that are no angles."""


@dataclass(frozen=True, repr=False)
class Fit(CardDisplay, WithPosterior):
    """The result of :func:`identify`."""

    problem: Problem
    x: FloatArray
    """The unknowns, shape (n_unknowns,)."""
    orders: Mapping[str, Estimate]
    parameters: Mapping[str, Estimate]
    """By name; as a data frame :meth:`table`, or ``pandas.DataFrame(fit.parameters)``."""
    recordings: Mapping[str, RecordingFit]
    cost: float
    outcome: Outcome
    """How the search ended; its value in words."""
    evaluations: int
    discretisation: Discretisation | None
    uncertainty: Uncertainty | None
    seed: int | None
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
    claim_codes: tuple[str, ...] = ()
    """Those of its reasons, as ``no-fit``, ``memory``, ``unexplained``."""
    opened_bounds: tuple[OpenedBound, ...] = ()
    """The bounds of the project that stopped the search, and were opened."""
    alternative: Alternative | None = None
    """The integer-order model that comes nearest, where one was tried."""
    spread: Spread | None = None
    """What each recording says alone, where there are several."""
    window: float | None = None
    """Seconds of a window, where recordings were fitted in windows (:mod:`fracid.estimation.windows`)."""
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
            "orders": {n: OrderEstimate(**vars(e), integer=p.model.integer_order(n)) for n, e in self.orders.items()},
            "cost": {"name": p.cost_function.name, "value": self.cost, "outputs": p.outputs},
            "starts": [vars(s) | {"point": p.named(s.point), "end": p.named(s.end)} for s in self.starts],
            "start_that_won": None if (best := won(self.starts)) is None else best.origin,
            "interval_methods": {n: METHODS[n] for n in ("sandwich", "white", "walk")} if self.uncertainty else {},
        })  # fmt: skip

    def _card(self) -> Card:
        scores = {n: (r.use, r.rmse, r.units) for n, r in self.recordings.items()}
        return self._card_of(f"Fit of {self.problem.model.name}", scores)

    def _card_of(self, title: str, scores: Scores) -> Card:
        """The card, of this session or of a folder."""
        title = f"{title}: {claimed(self.claim, doubts(self.to_json()))}"
        free = {n: e for n, e in self.parameters.items() if e.free}
        warnings, cost = self.warnings, f"{self.problem.cost_function.name} = {self.cost:.4g}"
        return Card(f"PARTIAL {title}" if PARTIAL in warnings else title, (
            *([("claim", " ".join(self.claim_reasons))] if self.claim_reasons else []),
            ("orders", listed(_estimate(n, e) + ("" if e.free else " (fixed)") for n, e in self.orders.items())),
            ("parameters", f"{listed(_estimate(n, e) for n, e in free.items())}{' free' * (not free)}, "
                           f"{len(self.parameters) - len(free)} fixed"),
            ("search", f"{cost}; {self.optimiser}, {self.evaluations} evaluations, {self.outcome}"),
            ("warnings", f"{len(warnings)}: {warnings[0]}" if warnings else "none"),
            *((n, _score(*score)) for n, score in scores.items()),
        ), estimates=tuple({
            "free": GREEK.get(n, n), "value": _estimate("", e).removeprefix(" = "), "verdict": e.verdict,
        } for n, e in {**self.orders, **self.parameters}.items() if e.free))  # fmt: skip


def _estimate(name: str, e: Estimate) -> str:
    return estimate_text(name, e.value if e.bound is None else e.bound, e.interval95, e.unit)


def _score(use: str, rmse: Mapping[str, float | None], units: Mapping[str, str]) -> str:
    errors = (f"{GREEK.get(n, n)} " + ("none" if value is None else with_unit(value, units.get(n, "rad")))
              for n, value in rmse.items())  # fmt: skip
    return f"{'validation' if use == 'validate' else use}, RMSE of {listed(errors)}"


# --- result.json: docs/run-folder.md says what each key means ------------------------------------------------

Origin = Annotated[str, Field(pattern=r"^(given|regression|Sobol [0-9]{1,9}|the simpler structure|windows)$")]


class RecordingBlock(Block):
    """A recording beside its simulation, without the samples."""

    use: Literal["fit", "validate"]
    samples: int
    begin: float = Field(alias="from")
    end: float = Field(alias="to")
    cost: Number
    rmse: dict[str, Number]
    fit_percent: dict[str, Number]
    initial: dict[str, Estimate] = Field(alias="initial_state")
    parameters: dict[str, Estimate]
    sha256: str = Field("", alias="data_sha256")
    windows: dict[str, dict[str, float]] = Field({})


class ModelBlock(Block):
    """The model that was fitted."""

    name: str
    zero: str
    source: str


class CostBlock(Block):
    """What was made least."""

    name: str
    value: Number
    outputs: list[str]


class StartBlock(Block):
    """A start of the search, and what became of it."""

    origin: Origin
    point: dict[str, Unknown] = Field(alias="start")
    first_cost: Infinite = Field(alias="cost_on_first_swing")
    end: dict[str, Unknown]
    cost: Number
    ended: str
    joined: Origin | None
    evaluations: int


class FitBlock(Block):
    """A fit without its samples."""

    model: ModelBlock
    method: str
    memory: str
    step: float
    substeps: int | None = Field(None, ge=1)
    window: float | None = Field(None, gt=0)
    orders: dict[str, OrderEstimate]
    parameters: dict[str, Estimate]
    recordings: dict[str, RecordingBlock]
    cost: CostBlock
    discretisation: Discretisation | None = None
    evaluations: int
    optimiser: str
    outcome: Annotated[Outcome, Field(strict=False)]
    claim: ClaimWord | None = None
    claim_reasons: Listed[str] = ()
    claim_codes: Listed[str] = ()
    opened_bounds: Listed[OpenedBound] = ()
    alternative: Alternative | None = None
    starts: list[StartBlock] = Field([])
    start_that_won: str | None = None
    spread: Spread | None = None
    cut: CutCheck | None = None
    interval_methods: dict[str, str] = Field({})
    warnings: Listed[str]
    findings: Listed[Finding] = ()
    seed: int | None


class ResultBlock(FitBlock):
    """Everything that a run of ``fracid fit`` found; angles in radians, times in seconds, all else in SI."""

    preset: str | None = None
    data_sha256: dict[str, str]
    versions: dict[str, str]
    timing: dict[str, float] = Field({})
