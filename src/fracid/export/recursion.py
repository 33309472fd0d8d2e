r"""A scheme, its memory and its start as plain numbers: what ``model.m`` and the C function step with.

A run of :mod:`fracid.solver.schemes` needs nothing but tables, all in units of the step, so that they hold for any
step:

======================  =========================================================================================
table                   for what
======================  =========================================================================================
``weights``, ``start``  the last L samples: :math:`\sum_{k=1}^{L} w_k v_{n-k}`; the first sample has weights of its own
``decay``, …            all older ones: :math:`\sum_m a_m Y_m`, :math:`Y_m ← z_m Y_m + v_{n-L-1}`
``fit``, ``errors``     :math:`C(n) = \sum_e c_e E_e(n)`, :math:`c = F\,(f_1 - f_0, …, f_s - f_0)` (`starting`)
``starting``            the first s steps together: :math:`x_n = x_0 + h^q \sum_{k=0}^{s} M_{nk} f_k`
======================  =========================================================================================

The last two are Lubich's corrections for the orders of the model (:mod:`fracid.solver.starting`), all of whose states
are taken to move.  Of ``pi3`` what corrects :math:`δ^2 f_0` is two rows more of `fit` and `errors`.  A memory of
exponentials is exported as it is; a full one as exponentials within 10⁻¹², for nothing else runs for ever in fixed
memory.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from fracid.arrays import FloatArray, by_name
from fracid.errors import InputError
from fracid.export.whole import SAYS
from fracid.models import Model
from fracid.problem import Experiment, Problem
from fracid.solver.inputs import Driven
from fracid.solver.memory import compressed
from fracid.solver.methods import METHODS, Exported, Method
from fracid.solver.solve import time_scale
from fracid.solver.starting import PI3, Corrections, corrections, exponents
from fracid.solver.weights import Kernel

TIGHT = 1e-12
"""Tolerance of the exponentials in whose place a full memory stood."""

SHORTEST = 10_000
"""Steps that an exported memory holds at least: below 65 :mod:`fracid.solver.memory` would keep all."""


@dataclass(frozen=True)
class Case:
    """One recording as a run: all that the model does not hold."""

    name: str
    past: FloatArray
    """Known states up to the start, the last row is that at the start, shape (n_past + 1, n_states)."""
    driven: Driven
    """u before and after each grid point from the first known state on, (n_past + steps + 1, n_inputs), or one row for
    all."""
    parameters: FloatArray
    """p, shape (n_parameters,)."""
    step: float
    """h [s]."""
    steps: int
    start: float
    """Time of the start, from the recording's first sample [s]."""
    limit: float
    """The state beyond which the run has diverged."""

    @property
    def driven_after(self) -> Driven:
        """From the start on; the one row of those that never change."""
        first = len(self.past) - 1 if len(self.driven.before) > 1 else 0
        return Driven(*(side[first:] for side in self.driven))

    @classmethod
    def of(cls, problem: Problem, x: FloatArray, e: Experiment) -> Case:
        """As :meth:`Problem.simulate` takes it."""
        simulator, values = problem.simulator, problem.unpack(x, e)
        history, driven = simulator.history(x, e), simulator.inputs(x, e)
        past = values.initial[None] if history is None else np.vstack([history, values.initial])
        step, steps = e.step / problem.substeps, simulator.steps(e)
        return cls(e.name, past, driven, values.parameters, step=step, steps=steps, start=values.release,
                   limit=simulator.limit)  # fmt: skip


@dataclass(frozen=True)
class Recursion:
    """The tables; rows stand for the distinct orders, in the order of first appearance."""

    model: Model
    method: str
    orders: FloatArray
    """Of each state, shape (n_states,)."""
    time_scale: float
    """τ₀ [s]: the weight of a step is h^q τ₀^(1−q)."""
    memory: str
    """Name of the memory that is exported."""
    steps: int
    """Up to so many steps the memory is as good as it says."""
    row: tuple[int, ...]
    """Of each state, its row."""
    kernels: tuple[Kernel, ...]
    """Of each row, all with the same number L of exact lags."""
    start: Corrections
    """Of the rows; `fit`, shape (n_corrections, s), is without f_0."""

    @property
    def scheme(self) -> Method:
        """What is known of the method."""
        return METHODS[self.method]

    @property
    def exported(self) -> Exported:
        """How another language steps alike.

        Raises
        ------
        InputError
            If there is no template for the method.
        """
        if self.scheme.exported is None:
            exportable = ", ".join(name for name, method in METHODS.items() if method.exported)
            raise InputError(f"The method {self.method} is written in no other language; fit with one of {exportable}.")
        return self.scheme.exported

    @property
    def order_values(self) -> str:
        """Each order that has a name once, in words: ``lambda = 0.9, 1 - springpot_order_theta = 0.4``."""
        orders = by_name(self.model.orders, self.orders)
        return ", ".join(f"{name} = {q!r}" for name, q in orders.items() if not isinstance(name, float))

    @property
    def newest(self) -> FloatArray:
        """w_0 of each state; 0 of those that relax, whose step is another, shape (n_states,)."""
        weights = np.array([self.kernels[r].weights[0] for r in self.row])
        weights[list(self.model.relaxing_states)] = 0.0
        return weights

    @property
    def share(self) -> FloatArray:
        """What a jump of the inputs weighs in the step after it: :mod:`fracid.solver.schemes`, shape (n_states,)."""
        return np.asarray(self.orders - (2 ** (self.orders + 1) - 2) / 3)

    @property
    def forgets(self) -> tuple[int, ...]:
        """Of each state that relaxes, where behind the derivatives its rate stands; 0 of the others."""
        n, relaxing = len(self.row), self.model.relaxing_states
        return tuple(n + relaxing.index(i) if i in relaxing else 0 for i in range(n))

    @property
    def modes(self) -> int:
        """Exponentials of the row that has most."""
        return max(1, *(len(k.decay) for k in self.kernels))

    @property
    def rows(self) -> dict[str, ArrayLike]:
        """What programs have of the memory and of the start, by name; a row for each distinct order."""
        wide = {n: [np.pad(getattr(k, n), (0, self.modes - len(k.decay))) for k in self.kernels]
                for n in ("decay", "amplitude", "start_ratio")}  # fmt: skip
        return {**wide, "weights": [k.weights[1:] for k in self.kernels]}

    @property
    def together(self) -> int:
        """s, the steps that are solved together at the start."""
        return int(self.start.fit.shape[1])

    @classmethod
    def of(cls, problem: Problem, x: FloatArray, steps: int | None = None) -> Recursion:
        """Make the tables for the values x of a problem's unknowns.

        Parameters
        ----------
        problem : Problem
        x : ndarray, shape (n_unknowns,)
        steps : int, optional
            Longest run that the memory must hold; the longest recording's if left out, 10,000 at least.

        Raises
        ------
        InputError
            If recordings have an order each: a program has one memory.

        Examples
        --------
        >>> import fracid
        >>> swing = fracid.Experiment("twin", 2e-3, np.zeros((500, 2)), np.zeros((1, 1)))
        >>> rig = fracid.rotary_pendulum("srv02-rotpen")
        >>> tables = Recursion.of(fracid.Problem(rig, (swing,), {"lambda": 0.9, "mu": 0.95}), np.zeros(4))
        >>> tables.row, tables.kernels[0].lags, tables.together
        ((0, 0, 1, 1), 8, 1)
        """
        own, first = problem.own_parameters, problem.experiments[0]
        for order in (problem.model.parameter_names[k] for _, k in problem.model.complements):
            if order in own and len(problem.experiments) > 1:
                raise InputError(SAYS("own-order", order=order))
        cases = [Case.of(problem, x, e) for e in problem.experiments]
        orders, parameters, *_ = problem.unpack(x, first)
        longest = max(steps or max(c.steps + len(c.past) for c in cases), SHORTEST)
        memory = compressed(TIGHT) if problem.memory.name == "full" else problem.memory
        distinct = list(dict.fromkeys(orders.tolist()))
        family = METHODS[problem.method].family
        kernels = _of_same_lags([memory.kernel(family, q, longest) for q in distinct])
        return cls(
            problem.model, problem.method, orders, time_scale(problem.model, parameters), memory=memory.name,
            steps=longest, row=tuple(distinct.index(q) for q in orders.tolist()), kernels=tuple(kernels),
            start=_start(family, orders, distinct, longest),
        )  # fmt: skip


# --- memory ------------------------------------------------------------------------------------------


def _of_same_lags(kernels: list[Kernel]) -> Iterator[Kernel]:
    """Let each take as many lags for exact as the one that has most; its exponentials give those it lacks."""
    L = max(k.lags for k in kernels)
    for k in kernels:
        more = np.arange(L - k.lags)
        z = np.exp(np.outer(more, np.log1p(k.decay)))
        weights = z @ k.amplitude + k.ramp * more
        start = z @ (k.amplitude * k.start_ratio) + k.ramp * (more / 2 - k.start_shift)
        amplitude = k.amplitude * np.exp(len(more) * np.log1p(k.decay))
        amplitude[:1] += k.ramp * len(more)  # the constant's
        yield replace(
            k, weights=np.concatenate([k.weights, weights]), start=np.concatenate([k.start, start]), amplitude=amplitude
        )


# --- start -------------------------------------------------------------------------------------------


def _start(family: str, orders: FloatArray, distinct: list[float], steps: int) -> Corrections:
    sigma = () if family == "gl" else exponents(tuple(orders.tolist()), (), family == PI3)
    if not sigma and family != PI3:
        rows = len(distinct)
        return Corrections(np.zeros((0, 0)), np.zeros((rows, 1, 1)), np.array([0, 1, 2]), np.zeros((rows, 0, 3)))
    found = corrections(family, tuple(distinct), sigma, steps + 8)
    return found._replace(fit=found.fit[:, 1:])
