"""An identified model as machines take it: names, units, values, intervals, inputs, outputs, and its tables."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from fracid.arrays import FloatArray, by_name
from fracid.estimation.records import Estimate
from fracid.export.c import used_constants
from fracid.export.recursion import Case, Recursion
from fracid.problem import Problem
from fracid.problem.toml_text import toml_value
from fracid.runs.saved import SavedRun
from fracid.safety.text import one_line, printable


@dataclass(frozen=True)
class Quantity:
    """Something that has a value: an input, an output, a state, a constant or an order."""

    name: str
    unit: str
    value: float
    """At the start [unit]."""
    about: str = ""
    interval: tuple[float, float] | None = None
    """Of 95 %; None for what was not free."""

    @property
    def description(self) -> str:
        """What it is, with its interval.

        Examples
        --------
        >>> Quantity("mu", "-", 0.9, "order", (0.89, 0.91)).description
        'order, 95 % interval [0.89, 0.91]'
        """
        known = "" if self.interval is None else "95 % interval [{:.6g}, {:.6g}]".format(*self.interval)
        return ", ".join(one_line(text) for text in (self.about, known) if text)


def source_of(run: SavedRun) -> str:
    """Where an exported model comes from, for the head of its file: the run, and whose constants it has of several."""
    first = run.problem.experiments[0].recording.name
    own = f", with the constants of the recording {first!r}" if run.problem.per_recording else ""
    return printable(f"{run.folder.name}{own}")


def columns_of(run: SavedRun) -> list[str]:
    """How the columns of the first recording that is fitted are taken, as its project file has it."""
    tables = zip(run.project.recordings, tomllib.loads(run.project.text)["recording"], strict=True)
    first = next(table for r, table in tables if r.name == run.problem.experiments[0].recording.name)
    return [f"{n} = {toml_value(first[n])}" for n in (*run.problem.outputs, *run.problem.model.inputs) if n in first]


@dataclass(frozen=True)
class Identified:
    """What every writer of machines reads; the constants, step and start are those of the first recording.

    Examples
    --------
    >>> import fracid
    >>> swing = fracid.Experiment("twin", 2e-3, np.zeros((500, 2)), np.zeros((1, 1)))
    >>> problem = fracid.Problem(fracid.rotary_pendulum(), (swing,), {"lambda": 0.9, "mu": 0.95})
    >>> model = Identified("a twin", problem, problem.start)
    >>> model.identifier, [q.name for q in model.outputs]
    ('rotary_pendulum', ['theta', 'alpha'])
    """

    run: str
    """Where it was identified."""
    problem: Problem
    x: FloatArray
    """The values of its unknowns, shape (n_unknowns,)."""
    estimates: Mapping[str, Estimate] = field(default_factory=dict)
    """Constant or order → what the fit knows of it."""
    steps: int | None = None
    """Longest run that the memory holds; None for the recording's."""

    @classmethod
    def of_run(cls, run: SavedRun, steps: int | None = None) -> Identified:
        """As a fit left it."""
        own = run.recordings[run.problem.experiments[0].recording.name].parameters
        return cls(source_of(run), run.problem, run.x, {**run.parameters, **run.orders, **own}, steps=steps)

    @cached_property
    def case(self) -> Case:
        """The first recording."""
        return Case.of(self.problem, self.x, self.problem.experiments[0])

    @cached_property
    def tables(self) -> Recursion:
        """What programs step with."""
        return Recursion.of(self.problem, self.x, self.steps)

    @property
    def identifier(self) -> str:
        """The model's name as a word of C."""
        word = re.sub(r"\W+", "_", self.problem.model.name, flags=re.ASCII).strip("_")
        return word if re.match(r"[A-Za-z]", word) else f"model_{word}".rstrip("_")

    def _quantity(self, name: str, unit: str, value: float, about: str = "") -> Quantity:
        known = self.estimates.get(name)
        return Quantity(name, unit, float(value), about, interval=known.interval95 if known else None)

    @cached_property
    def constants(self) -> dict[str, Quantity]:
        """All constants of the model, by name."""
        values = zip(self.problem.model.parameters, self.case.parameters, strict=True)
        return {p.name: self._quantity(p.name, p.unit, v, p.description) for p, v in values}

    @cached_property
    def parameters(self) -> tuple[Quantity, ...]:
        """Those that the equations have."""
        return tuple(self.constants[p.name] for p, _ in used_constants(self.problem.model, self.case.parameters))

    @cached_property
    def orders(self) -> tuple[Quantity, ...]:
        """Each order that has a name, once; they are in the tables."""
        named = by_name(self.problem.model.orders, self.tables.orders)
        about = "order of the derivative, which the tables of the memory are made for"
        return tuple(self._quantity(str(n), "1", q, about) for n, q in named.items() if not isinstance(n, float))

    @cached_property
    def inputs(self) -> tuple[Quantity, ...]:
        """With their values at the start."""
        model, u = self.problem.model, self.case.driven_after.after[0]
        rates = {n: f"rate of {of}" for n, of in model.input_rates.items()}
        return tuple(Quantity(n, model.input_units.get(n, ""), float(v), rates.get(n, ""))
                     for n, v in zip(model.inputs, u, strict=False))  # fmt: skip

    @cached_property
    def states(self) -> tuple[Quantity, ...]:
        """With their values at the start."""
        model, start = self.problem.model, self.case.past[-1]
        units = {model.states[i]: model.output_unit(n) for n, i in model.output_states.items()}
        return tuple(Quantity(n, units.get(n, ""), float(v), f"state of order {q:.6g}")
                     for n, v, q in zip(model.states, start, self.tables.orders, strict=True))  # fmt: skip

    @cached_property
    def outputs(self) -> tuple[Quantity, ...]:
        """With their values at the start."""
        model, x, u = self.problem.model, self.case.past[-1], np.array([q.value for q in self.inputs])
        return tuple(
            Quantity(n, model.output_unit(n), float(x[h] if isinstance(h, int) else h(0.0, x, u, self.case.parameters)))
            for n, h in model.shown.items()
        )
