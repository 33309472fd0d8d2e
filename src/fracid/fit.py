"""Fit: everything that :func:`fracid.identify` returns, which describes its own JSON."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import AfterValidator, Field, PlainSerializer, WrapSerializer

from fracid.arrays import FloatArray
from fracid.bayes.inference import WithPosterior
from fracid.cards import Card, CardDisplay, estimate_text, listed
from fracid.estimation.agreement import Spread
from fracid.estimation.covariance import Uncertainty
from fracid.estimation.records import Estimate, Estimates, OrderEstimate, RecordingFit
from fracid.estimation.starts import Start
from fracid.findings import Finding
from fracid.optimise.base import Outcome
from fracid.problem import Problem
from fracid.safety.schema import UNREAD, Beside, Block, Infinite, Listed, Number, Record, as_json
from fracid.selection.claim import ClaimWord
from fracid.selection.doubts import claimed, doubts
from fracid.selection.integer_rival import Alternative
from fracid.selection.opened_bounds import OpenedBound
from fracid.units import letter, with_unit
from fracid.validation.discretisation import Discretisation
from fracid.validation.unknown_past import CutCheck

PARTIAL = "PARTIAL: the fit was interrupted. These are the best values so far, not its result."
"""The first warning of an interrupted fit: it stands on the page, on cards, in result.json."""


Scores = Mapping[str, tuple[str, Mapping[str, float | None], Mapping[str, str]]]
"""Recording → use, RMSE of each output [SI], and the units of outputs that are no angles."""


class ModelBlock(Block):
    """The model that was fitted."""

    name: str
    zero: str
    source: str


class CostBlock(Block):
    """What was made least."""

    name: str
    value: Infinite
    outputs: list[str]


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
    units: dict[str, str] = Field({})
    windows: dict[str, dict[str, float]] = Field({})


if TYPE_CHECKING:
    Orders = Mapping[str, Estimate]
    Constants = Mapping[str, Estimate]
    Recordings = Mapping[str, RecordingFit]
else:
    _read = AfterValidator(Estimates), WrapSerializer(lambda values, written: written(dict(values)))
    Orders, Constants = (Annotated[dict[str, kind], *_read] for kind in (OrderEstimate, Estimate))
    _written = PlainSerializer(lambda of_each: {n: as_json(RecordingBlock, r) for n, r in of_each.items()})
    Recordings = Annotated[dict[str, RecordingBlock], _written]


@dataclass(frozen=True, repr=False, kw_only=True)
class Fit(CardDisplay, WithPosterior, Record):
    """The result of :func:`identify`: what ``result.json`` says, and what it is of; docs/run-folder.md has each key."""

    problem: Beside[Problem] = UNREAD
    x: Beside[FloatArray] = UNREAD
    """The unknowns, shape (n_unknowns,)."""
    uncertainty: Beside[Uncertainty | None] = None
    timing: Beside[Mapping[str, float]] = field(default_factory=dict)
    """Seconds spent, per stage."""
    model: ModelBlock
    method: str
    memory: str
    step: float
    substeps: Annotated[int, Field(ge=1)] | None = None
    window: Annotated[float, Field(gt=0)] | None = None
    """Seconds of a window, where recordings were fitted in windows (:mod:`fracid.estimation.windows`)."""
    orders: Orders
    parameters: Constants
    """By name; as a data frame :meth:`table`, or ``pandas.DataFrame(fit.parameters)``."""
    recordings: Recordings
    minimised: Annotated[CostBlock, Field(alias="cost")]
    """Name and value of the cost, and the outputs that count."""
    discretisation: Discretisation | None = None
    evaluations: int
    optimiser: str
    outcome: Annotated[Outcome, Field(strict=False)]
    """How the search ended; its value in words."""
    claim: ClaimWord = "undecided"
    """``fractional``, ``integer`` or ``undecided`` (:mod:`fracid.selection.claim`)."""
    claim_reasons: Listed[str] = ()
    """Why, in sentences."""
    claim_codes: Listed[str] = ()
    """Those of its reasons, as ``no-fit``, ``memory``, ``unexplained``."""
    opened_bounds: Listed[OpenedBound] = ()
    """The bounds of the project that stopped the search, and were opened."""
    alternative: Alternative | None = None
    """The integer-order model that comes nearest, where one was tried."""
    starts: Listed[Start] = ()
    """What became of each start of ``multistart``; empty for other optimisers."""
    start_that_won: str | None = None
    spread: Spread | None = None
    """What each recording says alone, where there are several."""
    cut: CutCheck | None = None
    """How far the orders move with where the record begins, where that was asked for."""
    interval_methods: Mapping[str, str] = field(default_factory=dict)
    """How intervals were made, in words."""
    warnings: Listed[str]
    """Sentences, those of the findings among them."""
    warning_codes: Listed[str] = ()
    """Of each of them: that of a finding, ``verdict``, ``bounded``, ``cut``, ``spread``, or none."""
    findings: Listed[Finding] = ()
    """Faults of data, project or model that were seen, each with the number that shows it."""
    seed: int | None

    @property
    def cost(self) -> float:
        """Infinite where no run reached its end."""
        return self.minimised.value

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
            "free": letter(n), "value": _estimate("", e).removeprefix(" = "), "verdict": e.verdict,
        } for n, e in {**self.orders, **self.parameters}.items() if e.free))  # fmt: skip


def _estimate(name: str, e: Estimate) -> str:
    return estimate_text(name, e.value if e.bound is None else e.bound, e.interval95, e.unit, cut=e.cut)


def _score(use: str, rmse: Mapping[str, float | None], units: Mapping[str, str]) -> str:
    errors = (f"{letter(n)} " + ("none" if value is None else with_unit(value, units.get(n, "rad")))
              for n, value in rmse.items())  # fmt: skip
    return f"{'validation' if use == 'validate' else use}, RMSE of {listed(errors)}"
