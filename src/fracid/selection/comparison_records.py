"""What a comparison finds: a :class:`Row` a structure, and the :class:`Comparison`; as JSON, CSV and card.

compare.json is the comparison's own description; what the lines of its journal have stands at the end.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Annotated, Any

import numpy as np
from pydantic import Field, computed_field

from fracid.cards import Card, CardDisplay, listed, tabulated
from fracid.errors import entry_of
from fracid.figures import Figure, Style, draw
from fracid.safety.json_files import from_json, json_number, short_text
from fracid.safety.schema import (
    AS_NULL,
    Beside,
    Block,
    Infinite,
    Interval,
    Listed,
    Number,
    Numbers,
    Record,
    Unknown,
    also_called,
    computed,
    fault_of,
    lacking,
    null_as,
)
from fracid.selection.amplitude import AmplitudeTest
from fracid.selection.claim import ClaimWord
from fracid.selection.doubts import LACKING, claimed
from fracid.selection.integer_rival import Alternative
from fracid.selection.opened_bounds import OpenedBound
from fracid.signals.left_over import LeftOver
from fracid.units import with_unit

Missed = Annotated[float, null_as(partial(from_json, otherwise=-math.inf)), AS_NULL]
"""A fit in per cent: null of a constant output that is missed."""


MOST = 3
"""Held-out recordings with a column each; of more the mean is shown."""

CURVE = 900
"""Samples of a curve that is kept, at most."""

Curves = Mapping[str, Mapping[str, Listed[Number]]]
"""Recording → output → what a structure simulates, at the samples of :func:`drawn` [its unit]."""


@dataclass(frozen=True)
class Score(Record):
    """How near a structure comes to one recording."""

    rmse: Mapping[str, Infinite]
    """Per output [its unit]; infinite where the run fails."""
    fit_percent: Mapping[str, Missed]
    """100·(1 − ‖y − ŷ‖/‖y − ȳ‖), per output."""
    itae: Mapping[str, Infinite]
    """∫ t|e| dt, per output [its unit times s²]."""
    failed: str = ""
    """Why the run fails."""

    @property
    def error(self) -> float:
        """The geometric mean of the outputs' RMSE: a number to be held against another structure's."""
        return float(np.exp(np.mean(np.log(np.maximum([*self.rmse.values()], 1e-300)))))


@dataclass(frozen=True)
class OrderOfRow(Record):
    """An order of a structure."""

    value: float
    interval95: Interval | None
    """None for a fixed one, or where there is none."""
    beyond_bounds: float = 0.0
    """Half of it were nothing else stopped by a bound; 0 where nothing is."""


@dataclass(frozen=True)
class Row(Record):
    """One structure, fitted and scored."""

    friction: str
    """``viscous + Coulomb``."""
    fractional: bool
    name: str
    """``viscous + Coulomb, orders free``."""
    paper: bool
    """Whether this is the paper's structure."""
    cost: Infinite
    """The problem's own, on the fitted recordings; infinite where every run fails."""
    parameters: int
    """How many are free, initial states included; what the fitted recordings do not see is not."""
    bic: Annotated[Infinite, Field(alias="bic_above_best")]
    """Schwarz's criterion, less that of the best row."""
    orders: Mapping[str, OrderOfRow]
    values: Mapping[str, float]
    """Every unknown by its name [SI]."""
    at_bound: Listed[str]
    """Unknowns that lie at a bound."""
    in_sample: Mapping[str, Score]
    """Fitted recording → score."""
    held_out: Mapping[str, Score]
    """Recording that was not fitted → score."""
    outcome: str
    """How the search ended, and from where it came."""
    left_over: Mapping[str, LeftOver] = field(default_factory=dict)
    """Fitted recording and output, in words → what is left over of it."""
    curves: Beside[Curves] = field(default_factory=dict, compare=False, repr=False)
    """Its simulation of every recording that it is scored on; in curves.json."""
    log_odds: Unknown = math.nan
    """Logarithm of its odds against the most probable structure, 0 at most, all equally probable beforehand [nats]; NaN
    where that was not asked for or cannot be told."""

    free_parameters = also_called("parameters", int)

    @property
    def fits(self) -> bool:
        """Whether it follows what it was fitted to; a run that fails does not."""
        return math.isfinite(self.cost) and all(e.fits for e in self.left_over.values())

    @computed_field(alias="held_out_error")  # type: ignore[prop-decorator]
    @property
    def error(self) -> Unknown:
        """The geometric mean of the held-out errors; infinite where a run fails; NaN without any."""
        errors = [s.error for s in self.held_out.values()]
        return float(np.exp(np.mean(np.log(errors)))) if errors else math.nan


@dataclass(frozen=True, repr=False)
class Comparison(CardDisplay, Record):
    """The result of :func:`compare`."""

    rows: Annotated[tuple[Row, ...], Field(strict=False, alias="structures")]
    """From the poorest structure to the richest, each with orders 1 and with orders free."""
    verdict: str
    """A sentence or two to act on."""
    notes: Listed[str]
    """What was left out or changed."""
    outputs: Listed[str]
    effective_samples: Unknown
    """What the correlated residuals are worth in BIC."""
    leave_one_out: bool
    cost_name: Annotated[str, Field(alias="cost")]
    seed: int
    starts: int
    amplitude: Mapping[str, AmplitudeTest] = field(default_factory=dict)
    """Structure → whether its orders drift with amplitude, where that was asked for or the claim needs it."""
    claim: ClaimWord = "undecided"
    """``fractional``, ``integer`` or ``undecided`` (:mod:`fracid.selection.claim`)."""
    claim_reasons: Listed[str] = ()
    """Why, in sentences."""
    alternative: Alternative | None = None
    """What of integer order comes nearest to the best fractional structure, where the claim needs it."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Output → its unit; rad where it says nothing."""
    problems: Beside[Mapping[str, Any]] = field(default_factory=dict, compare=False)
    """Structure → its problem, as it was fitted: with its bounds, and at its step."""

    def __getitem__(self, name: str) -> Row:
        """The row of that structure; an InputError names those that there are."""
        return entry_of("structure", {row.name: row for row in self.rows}, name)

    @computed
    def held_out(self) -> tuple[str, ...]:
        """Names of the held-out recordings."""
        return tuple(self.rows[0].held_out)

    @property
    def columns(self) -> list[tuple[str, tuple[str, ...]]]:
        """What a table or a figure of it has side by side: which scores, and of which recordings the mean."""
        held_out = [self.held_out] if len(self.held_out) > MOST else [(name,) for name in self.held_out]
        return [("in_sample", tuple(self.rows[0].in_sample)), *(("held_out", names) for names in held_out)]

    def best(self, *, fractional: bool) -> Row:
        """The best row with orders free, or with orders 1: on held-out recordings, by BIC where there are none."""
        return best_of([row for row in self.rows if row.fractional == fractional])

    @computed_field(alias="best")
    def names_of_best(self) -> dict[str, str]:
        """The name of the best row of either kind."""
        return {"integer": self.best(fractional=False).name, "fractional": self.best(fractional=True).name}

    def incoherence(self) -> str:
        """Structures that are scored on other recordings or outputs are no comparison."""
        if not self.rows:
            return "it has no structure"
        first = self.rows[0]
        for row in self.rows:
            for scores, others in ((row.in_sample, first.in_sample), (row.held_out, first.held_out)):
                if set(scores) != set(others):
                    return f"the recordings of {short_text(row.name)} are others"
                kinds = (kind for s in scores.values() for kind in (s.rmse, s.fit_percent, s.itae))
                if any(set(kind) != set(self.outputs) for kind in kinds):
                    return f"the outputs of {short_text(row.name)} are others"
        kinds_of_rows = {row.fractional for row in self.rows}
        return "" if kinds_of_rows == {False, True} else "its best structures are not among them"

    @property
    def doubts(self) -> dict[str, str]:
        """What speaks against the claim, as :func:`fracid.selection.doubts.doubts` of a fit."""
        left = self.best(fractional=self.claim == "fractional").left_over
        where = " and ".join(name for name, e in left.items() if not e.noise and self.claim != "undecided")
        return {"Fit": f"{LACKING}: the residual of {where} is correlated"} if where else {}

    def _card(self) -> Card:
        return Card(f"Comparison of {len(self.rows)} structures: {claimed(self.claim, self.doubts)}", (
            ("verdict", self.verdict),
            ("fractional", _row_text(self.best(fractional=True), self.units)),
            ("integer", _row_text(self.best(fractional=False), self.units)),
            ("held out", listed(self.held_out)),
            ("notes", f"{len(self.notes)}: {self.notes[0]}" if self.notes else "none"),
        ), tuple((row.name, _row_text(row, self.units)) for row in self.rows))  # fmt: skip

    def plot(self, *, style: str | Style = "screen") -> Figure:
        """RMSE in sample and held out of each rung; see :func:`fracid.plots.ladder`.

        Parameters
        ----------
        style : str or Style
            ``screen``, ``journal`` or one's own; see :mod:`fracid.figures`.
        """
        return draw("ladder", self, style=style)

    def lines(self) -> list[dict[str, Any]]:
        """One line for each structure, recording and output, as of ``compare.csv``.

        The RMSE of an angle is ``rmse_deg``, that of any other output ``rmse``, in its ``unit``.
        """
        return [line for row in self.rows for line in _lines(row, self.outputs, self.units)]

    def table(self) -> Any:
        """The :meth:`lines` as a pandas ``DataFrame``, where pandas is installed."""
        return tabulated(self.lines())


def _row_text(row: Row, units: Mapping[str, str]) -> str:
    error = f"held out {held_out_errors(row, units)}" if row.held_out else f"cost {row.cost:.4g}"
    if not math.isfinite(row.bic):
        return f"{row.name}: {error}"
    return f"{row.name}: {error}, ΔBIC {row.bic:.4g}".replace("-", "−")


def best_of(rows: Sequence[Row]) -> Row:
    """The best of rows of one kind."""
    return min(rows, key=lambda row: (row.error if row.held_out else 0.0, row.bic))


def held_out_errors(row: Row, units: Mapping[str, str]) -> str:
    """Its mean held-out RMSE, per output."""
    if not math.isfinite(row.error):
        return "a run fails"
    return ", ".join(f"{n} {with_unit(v, units.get(n, 'rad'), '.2g')}" for n, v in mean_rmse(row.held_out).items())


def drawn(samples: int, recordings: int) -> slice:
    """The samples of a recording that its curves are drawn with: fewer where there are many recordings.

    Examples
    --------
    >>> drawn(20_001, 2), drawn(20_001, 60)
    (slice(None, None, 23), slice(None, None, 223))
    """
    return slice(None, None, -(-samples // max(60, 6 * CURVE // max(6, recordings))))


def mean_rmse(scores: Mapping[str, Score]) -> dict[str, float]:
    """The mean RMSE over recordings, per output [its unit].

    Examples
    --------
    >>> mean_rmse({"one": Score({"alpha": 0.0}, {}, {}), "two": Score({"alpha": 0.5}, {}, {})})
    {'alpha': 0.25}
    """
    outputs = next(iter(scores.values())).rmse if scores else {}
    return {n: float(np.mean([s.rmse[n] for s in scores.values()])) for n in outputs}


# --- as CSV ------------------------------------------------------------------------------------------------


def _in_unit(rmse: float, itae: float, unit: str) -> dict[str, Any]:
    """Columns for angles, which readers of the file know, and columns with their unit for all else."""
    if unit == "rad":
        return {"rmse_deg": json_number(math.degrees(rmse)), "itae_rad_s2": json_number(itae)}
    return {"rmse": json_number(rmse), "itae": json_number(itae), "unit": unit}


def _lines(row: Row, outputs: Sequence[str], units: Mapping[str, str]) -> Iterator[dict[str, Any]]:
    for use, scores in (("fit", row.in_sample), ("held out", row.held_out)):
        for recording, s in scores.items():
            for output in outputs:
                yield {
                    "friction": row.friction, "orders": "free" if row.fractional else "1", "recording": recording,
                    "use": use, "output": output,
                    **_in_unit(s.rmse[output], s.itae[output], units.get(output, "rad")),
                    "fit_percent": json_number(s.fit_percent[output]),
                    "parameters": row.parameters, "bic_above_best": json_number(row.bic),
                    "log_odds": json_number(row.log_odds), "failed": s.failed,
                    **{f"order_{n}": order.value for n, order in row.orders.items()},
                }  # fmt: skip


# --- the lines of its journal -------------------------------------------------------------------------------


class EvidenceBlock(Block):
    """The evidence of a structure, as the journal of a comparison has it."""

    log_evidence: Number
    cost: Number
    reason: str


class GivenBlock(Block):
    """The fit of the project as it stands, as the journal of a comparison has it: where every structure may start."""

    values: dict[str, float]
    opened: list[OpenedBound] = Field([])
    work: int = Field(0)


class RecordedBlock(Block):
    """What was measured, at the samples of the curves."""

    time: Numbers
    measured: dict[str, list[Number]]


@dataclass(frozen=True)
class CurvesBlock(Record):
    """The content of curves.json."""

    recordings: dict[str, RecordedBlock]
    structures: dict[str, Curves]

    def incoherence(self) -> str:
        """Curves of other recordings, or of other samples."""
        for name, found in self.structures.items():
            for recording, curves in found.items():
                beside = self.recordings.get(recording)
                signals = () if beside is None else (*curves.values(), *beside.measured.values())
                if beside is None or any(len(y) != len(beside.time) for y in signals):
                    return f"the curves of {short_text(name)} are others"
        return ""


class FittedBlock(Block):
    """The fit of a structure, as the journal of a comparison has it: its row, before it is held against the others."""

    row: Row
    squares: Number
    samples: float
    curves: Curves = Field({})
    work: int = Field(0)

    @property
    def ended(self) -> bool:
        """Whether a run of it ends."""
        return math.isfinite(self.row.cost)


def fault_of_fitted(content: Any, outputs: Iterable[str]) -> str:
    """Where the fit of a structure is not one with these outputs, in words."""
    if fault := fault_of(content, FittedBlock):
        return fault
    scores = {
        f"{use}.{name}.{kind}": score[kind]
        for use in ("in_sample", "held_out")
        for name, score in content["row"][use].items()
        for kind in ("rmse", "fit_percent", "itae")
    }
    return lacking(scores, outputs)
