"""A Plan: the experiments to do next, and the intervals to expect of them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import Field, computed_field

from fracid.arrays import FloatArray
from fracid.cards import Card, CardDisplay, estimate_text, listed, rounded
from fracid.errors import InputError
from fracid.experiments.sheet import write_sheet
from fracid.experiments.space import Candidate, DesignSpace
from fracid.experiments.subject import Subject
from fracid.figures import Style, draw
from fracid.fit import Fit
from fracid.quantiles import NORMAL_95
from fracid.safety.schema import Block, Number, Record, as_json
from fracid.units import GREEK

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_ROWS = 3
"""Of experiments on a card's text."""


@dataclass(frozen=True)
class Value(Record):
    """A free value, with what is known of it now and what is to be expected.

    Examples
    --------
    >>> [round(end, 4) for end in Value(0.9, "", 0.01, None).interval95]
    [0.8804, 0.9196]
    """

    value: float
    unit: str
    standard_error: Number
    """To be expected after the plan; None where the plan does not show it."""
    standard_error_now: Number
    """Of what has been recorded, predicted in the same way; None where that does not show it."""

    @computed_field  # type: ignore[prop-decorator]
    @property
    def interval95(self) -> tuple[float, float] | None:
        """To be expected after the plan."""
        if self.standard_error is None:
            return None
        half = NORMAL_95 * self.standard_error
        return self.value - half, self.value + half


class PlanBlock(Block):
    """plan.json: the experiments to do next, and what to expect of them."""

    subject: str = Field(alias="for")
    criterion: str
    of: list[str]
    experiments: list[dict[str, Any]]
    expected: dict[str, Value]
    gain: dict[str, Number]
    candidates: int
    excluded: int
    distances: dict[str, float] | None
    alone: dict[str, float] | None


@dataclass(frozen=True, repr=False)
class Plan(CardDisplay):
    """What :func:`fracid.design` gives."""

    subject: Subject
    space: DesignSpace
    criterion: str
    """``D``, ``A``, ``Ds`` or ``T`` (:mod:`fracid.experiments.criteria`)."""
    of: tuple[str, ...]
    """The values to narrow; empty for all."""
    experiments: tuple[Candidate, ...]
    """Repetitions stand there as often as they are to be done."""
    expected: Mapping[str, Value]
    """Name of each free value → what is to be expected."""
    candidates: int
    """Candidates that are possible."""
    excluded: int
    """Candidates that exceed a limit, or whose simulation fails."""
    landscape: tuple[tuple[Candidate, Mapping[str, float]], ...]
    """Each candidate with the standard errors that it alone would leave."""
    covariance: FloatArray
    """Covariance of the free values after the plan, shape (n, n)."""
    distances: Mapping[str, float] | None = None
    """Integer-order alternative → its distance in standard deviations, of a plan against them."""
    alone: Mapping[str, float] | None = None
    """Order → the distance of the nearest of them from a rig on which it alone is off."""

    def gain_over(self, run: Fit | None = None) -> dict[str, float]:
        """By what factor the interval of each value becomes narrower.

        Parameters
        ----------
        run : Fit or SavedRun, optional
            Compares with its intervals; without, with those that the recordings so far predict.

        Returns
        -------
        dict
            Infinite where there is no interval now; values that the plan does not show are left out.

        Raises
        ------
        InputError
            If the run shares no free value with the plan.
        """
        now = {n: v.standard_error_now for n, v in self.expected.items()}
        if run is not None:
            now = {n: None if e.interval95 is None else (e.interval95[1] - e.interval95[0]) / 2 / NORMAL_95
                   for n, e in {**run.orders, **run.parameters}.items() if n in self.expected}  # fmt: skip
            if not now:
                raise InputError(f"The run and the plan share no free value; the plan has {', '.join(self.expected)}.")
        return {n: math.inf if (before := now[n]) is None else before / v.standard_error
                for n, v in self.expected.items() if n in now and v.standard_error is not None}  # fmt: skip

    def to_json(self) -> dict[str, Any]:
        """Everything but the landscape, as plain values."""
        return as_json(PlanBlock, vars(self) | {
            "for": self.subject.name,
            "experiments": [c.to_json() | {"text": str(c)} for c in self.experiments],
            "gain": {n: g if math.isfinite(g) else None for n, g in self.gain_over().items()},
        })  # fmt: skip

    def plot(self, *, style: str | Style = "screen") -> Figure:
        """Draw the expected interval against angle of release and duration."""
        return draw("design_landscape", self, style=style)

    def write(self, folder: str | Path) -> tuple[Path, ...]:
        """Write the sheet for the laboratory: project files, voltages, expected curves, the figure, plan.json.

        Parameters
        ----------
        folder : str or Path
            Made if it is not there.

        Returns
        -------
        tuple of Path

        Raises
        ------
        InputError
            If the folder cannot be written.
        """
        return write_sheet(self, Path(folder))

    def summary(self) -> str:
        """The card, and the intervals to expect of all free values, in lines."""
        lines = [repr(self), "", "Values with the 95 % intervals to expect"]
        for n, v in self.expected.items():
            half = None if v.standard_error is None else NORMAL_95 * v.standard_error
            ends = rounded(v.value, half) + " (not shown by this plan)" * (half is None)
            lines.append(f"  {n:<20} {ends} {v.unit}".rstrip())
        return "\n".join(lines)

    @property
    def repetitions(self) -> dict[Candidate, int]:
        """Each experiment with how often it is done."""
        return {c: self.experiments.count(c) for c in dict.fromkeys(self.experiments)}

    def _card(self) -> Card:
        named = self.of or tuple(self.expected)
        rows = [(f"{count} ×", str(c)) for c, count in self.repetitions.items()]
        shown = rows if len(rows) <= MOST_ROWS else [*rows[: MOST_ROWS - 1], ("…", "more experiments")]
        texts = {n: estimate_text(n, v.value, v.interval95, v.unit) + ("" if v.interval95 else " (not shown)")
                 for n, v in self.expected.items()}  # fmt: skip
        excluded = f", {self.excluded} more excluded" if self.excluded else ""
        tail = [("expected", listed(texts[n] for n in named)), *self._comparisons(named),
                ("candidates", f"{self.candidates}{excluded}; criterion {self.criterion}")]  # fmt: skip
        details = [*(rows[MOST_ROWS - 1 :] if len(rows) > MOST_ROWS else []),
                   *((n, text) for n, text in texts.items() if n not in named)]  # fmt: skip
        count = len(self.experiments)
        title = f"Plan of {count} experiment{'s' * (count > 1)} for {self.subject.name}"
        return Card(title, (*shown, *tail), tuple(details))

    def _comparisons(self, named: tuple[str, ...]) -> Iterator[tuple[str, str]]:
        """With what is known now, and with the integer-order alternatives."""
        gains = self.gain_over()
        if any(math.isfinite(g) for g in gains.values()):
            yield "than now", listed(f"{GREEK.get(n, n)} {_times(gains[n])}" for n in named if n in gains)
        if self.distances:
            nearest = min(self.distances, key=self.distances.__getitem__)
            away = f"stays {self.distances[nearest]:.3g} standard deviations away"
            alone = [f"{GREEK.get(n, n)} {d:.3g}" for n, d in (self.alone or {}).items()]
            off = f"; where one order alone is fractional, {listed(alone)}" if len(alone) > 1 else ""
            yield "alternative", f"the nearest, with {nearest}, {away}{off}"


def _times(factor: float) -> str:
    return f"{factor:.2g} times narrower" if math.isfinite(factor) else "had no interval"
