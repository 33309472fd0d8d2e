"""What a simulation gives: the states over time, how it ended, and the states in between."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fracid.arrays import FloatArray, real_array
from fracid.cards import Card, CardDisplay, listed
from fracid.errors import InputError, brief
from fracid.findings import Finding, Words

SAYS = Words("solver/arguments.toml")


class Outcome(Enum):
    """How a run ended; the value is the sentence."""

    COMPLETED = "completed"
    DIVERGED = "diverged: a state left the range of the limit"
    NOT_FINITE = "the right-hand side is not finite (a division by zero, such as det M = 0, or an overflow)"
    UNSTABLE = "unstable: the step is too long for the method, which amplifies decaying modes"
    UNSETTLED = "unsettled: Newton's method does not solve the equation of a step"
    LEFT = "left its bounds: the last sample is the first one outside"


@dataclass(frozen=True, repr=False, eq=False)
class Trajectory(CardDisplay):
    """A simulated run, as far as it went."""

    time: FloatArray
    """Shape (n,) [s]: the grid, every so many of its points, or the times that were asked for."""
    states: FloatArray
    """Shape (n, n_states)."""
    outcome: Outcome
    """How it ended."""
    step: float
    """h [s], as it was used."""
    method: str
    """A key of :data:`METHODS`."""
    memory: str
    """``full``, ``short(L)`` or ``compressed(tolerance)``."""
    orders: FloatArray
    """Order of each state, shape (n_states,)."""
    origin: float = 0.0
    """Where the memory begins [s]: the first time, or the first sample of the history."""
    fault: Finding | None = None
    """Why it ended early, or what is wrong with its step, with the number that shows it
    (:mod:`fracid.solver.stiffness`)."""

    @property
    def completed(self) -> bool:
        """Whether the run reached its end."""
        return self.outcome is Outcome.COMPLETED

    def _card(self) -> Card:
        ended = self.outcome.value.split(":")[0]
        last = ", ".join(f"{x:.4g}" for x in self.states[-1]) if len(self.time) else "none"
        doubt = ", with a fault" if self.completed and self.fault is not None else ""
        return Card(f"Trajectory: {ended}{doubt}", (
            ("outcome", self.outcome.value),
            ("fault", "none" if self.fault is None else self.fault.sentence),
            ("time", f"{self.time[0]:g} to {self.time[-1]:g} s, {len(self.time):,} samples, step {self.step:g} s"),
            ("method", f"{self.method}, memory {self.memory}"),
            ("orders", listed(f"{q:g}" for q in self.orders)),
            ("last state", last),
        ))  # fmt: skip

    def at(self, times: ArrayLike) -> FloatArray:
        """Give the states at any times between the first and the last (dense output), shape (n_times, n_states).

        Through the four nearest samples goes a cubic; within the first eight, where a solution begins like t^q,
        the function of the same form with 1, t, t^q and t^(1+q).  With every sample stored its error is below that of
        the run, but for the first few steps of low orders, where x rises steeply between two samples.

        Raises
        ------
        InputError
            If a time is outside, or the run was read at times that are no grid.

        Examples
        --------
        >>> from fracid import solve_fde
        >>> def decay(t, x, u, p, out):
        ...     out[0] = -x[0]
        >>> run = solve_fde(decay, 0.8, [1.0], step=0.01, end=1.0)
        >>> bool(abs(run.at([0.2345]) - solve_fde(decay, 0.8, [1.0], step=0.0067, end=0.2345).states[-1]) < 1e-5)
        True
        """
        instants = np.atleast_1d(vector("times", times))
        first, last = self.time[0], self.time[-1]
        slack = 1e-9 * max(self.step, abs(last))
        for t in instants[(instants < first - slack) | (instants > last + slack)]:
            raise InputError(f"times: {t:g} is outside of the run, which goes from {first:g} to {last:g}.")
        gaps = np.diff(self.time)
        if gaps.size and np.ptp(gaps) > slack + 1e-6 * gaps.max():
            raise InputError(SAYS("no-grid"))
        return between(self, instants)


def between(run: Trajectory, times: FloatArray) -> FloatArray:
    """Interpolate a run on a grid through the nearest four samples (or all, if fewer)."""
    nodes = min(4, len(run.time))
    spacing = (run.time[-1] - run.time[0]) / max(len(run.time) - 1, 1) or 1.0
    before = ((times - run.time[0]) / spacing).astype(np.int64)
    first = np.clip(before - (nodes // 2 - 1), 0, len(run.time) - nodes)
    place = (times - run.time.take(first)) / spacing
    off = [place - j for j in range(nodes)]
    values = np.zeros((len(times), run.states.shape[1]))
    for k in range(nodes):  # Lagrange's polynomials
        weight = math.prod((off[j] / (k - j) for j in range(nodes) if j != k), start=np.ones_like(place))
        values += weight[:, None] * run.states.take(first + k, axis=0)
    for j in np.unique(first[first < 8]):  # where a solution begins like t^q: through 1, t, t^q, t^(1+q)
        here, near = first == j, run.time[j : j + nodes] - run.origin
        for i in np.flatnonzero((abs(run.orders - 1) > 0.05) & (run.orders > 1e-12)):
            powers = np.array([0, 1, run.orders[i], 1 + run.orders[i]])[:nodes]
            basis, at = (np.maximum(t / near[-1], 0)[:, None] ** powers for t in (near, times[here] - run.origin))
            values[here, i] = at @ np.linalg.solve(basis, run.states[j : j + nodes, i])
    return values


def refuse_masked(name: str, values: Any) -> None:
    """Refuse an array of which some values are masked: NumPy forgets masks without a word.

    Raises
    ------
    InputError

    Examples
    --------
    >>> refuse_masked("inputs", np.ma.masked_greater([1.0, 1e9], 10.0))
    Traceback (most recent call last):
    fracid.errors.InputError: inputs: 1 of 2 values are masked, and what is behind a mask is no number to count on. ...
    """
    if np.ma.is_masked(values):
        masked = np.ma.getmaskarray(values)
        raise InputError(SAYS("masked", name=name, count=int(masked.sum()), size=masked.size))


def vector(name: str, values: ArrayLike) -> FloatArray:
    """Turn a caller's numbers into an array, or say what is wrong with them."""
    refuse_masked(name, values)
    numbers = np.array(real_array(values, f"{name} = {{}}: expected numbers."), ndmin=1)
    if not np.all(np.isfinite(numbers)):
        raise InputError(f"{name} = {brief(values)}: every value must be a finite number.")
    return numbers
