r"""Linear regression for any model of equations: the library's, a project's own, Python that reads as a tree.

The equation of a measured state, with what divides all of it brought to the other side, is linear in constants such as
masses, stiffnesses and friction:

.. math::  D(p)\, D^q x_i - N(x, u, p) = 0, \qquad y - h(x, u, p) = 0

and so is an output that is a function.  Which constants are is found from the tree's own values: differences of second
order vanish in those, alone and in pairs.  The others (a slip speed, a rest angle, a time constant) are held.  States
come from the recording, smoothed, with their derivatives of the given orders; for an output that is a function they are
simulated, where their equations have none of the constants.  All columns pass the same window; estimator, intervals and
verdicts are the pendulum's.  Noise in the columns biases: the regression is made again with a window half as long
again.  What that moves a constant by is its bias and part of its interval, and where it moves far, it is called
biased.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np

from fracid.arrays import FloatArray, within
from fracid.errors import InputError
from fracid.models import Model
from fracid.models.written.formulas import Formula
from fracid.models.written.tree import Assign, Entry, Number, Operation
from fracid.problem import Experiment, Problem
from fracid.problem.first_values import along, smoothing
from fracid.regression.credibility import SAYS
from fracid.regression.estimators import Gauge, Scaled, sandwich, solve
from fracid.regression.linear import Regression, SearchedOrder, constants_of, doubted, estimated
from fracid.regression.rows import System, about_samples, from_rest, gaps_of, lines_over, longest_line
from fracid.signals.resolution import noise_level

STEEPER = 1.5
"""The second window over the first."""

ROWS = 3000
"""Of an equation, at most."""

BLOCKS = 30
"""Into which the rows fall, and beyond whose length no residuals are correlated."""

HELD = 1e-7
"""A difference of second order below this part of one of the first is none."""

Residual = Callable[[FloatArray], FloatArray]
"""Constants → the equation's residual at each row, shape (n_rows,)."""

Equation = tuple[str, Residual]
"""One equation on one recording, by the name of its state or output."""


def _equation(model: Model, i: int) -> tuple[Any, Any]:
    """What a state's derivative is, and what divides all of that, as right-hand sides."""
    program = model.program
    (place,) = (k for k, s in enumerate(program.body) if isinstance(s, Assign) and s.target == Entry("out", Number(i)))
    value: Any = program.body[place].value  # type: ignore[union-attr]
    over, under = value.operands if isinstance(value, Operation) and value.sign == "/" else (value, Number(1.0))

    def made(e: Any) -> Any:
        body = (*program.body[:place], Assign(Entry("out", Number(i)), e), *program.body[place + 1 :])
        return Formula(replace(program, body=body)).py_func

    return made(over), made(under)


def _rows(problem: Problem, e: Experiment, sought: Sequence[str], window: float) -> Iterator[Equation]:
    """The equations that a recording has all signals of."""
    from scipy.ndimage import gaussian_filter1d

    model, n = problem.model, len(e.measured)
    orders = model.state_orders(problem.order_starts)
    known: dict[int, FloatArray] = {}
    rates: dict[int, FloatArray] = {}
    width = window * smoothing(e.measured, e.step)
    for k, name in enumerate(problem.outputs):
        if (i := model.output_states.get(name)) is not None:
            known[i] = gaussian_filter1d(e.measured[:, k], width, mode="nearest")
            rates[i] = from_rest(known[i], float(orders[i]), e.step)
            if (j := model.rates.get(i)) is not None:
                known[j], rates[j] = rates[i], from_rest(rates[i], float(orders[j]), e.step)
    edge, every = int(4 * width) + 1, max(1, n // ROWS)
    at = np.arange(edge, n - edge, every)
    longest = longest_line(e.most_moved, noise_level(e.most_moved), min(e.period, n) * e.step)
    gaps = [(a, b) for a, b in gaps_of(e) if b - a > longest]
    kept = ~within(e.start + e.time[at], gaps, 2 * edge * e.step)
    if not kept.any():
        raise InputError(SAYS("no-rows", e=e))
    inputs = np.broadcast_to(e.inputs, (n, e.inputs.shape[1])) if len(e.inputs) == 1 else e.inputs[:n]
    held = [e.between.get(name) == "hold" for name in model.inputs]
    u, nothing = np.where(held, about_samples(inputs), inputs)[at], np.zeros(n)

    def filtered(values: FloatArray) -> FloatArray:
        return np.asarray(gaussian_filter1d(values, max(width / every, 0.5), mode="nearest"))[kept]

    def rate(f: Any, i: int, p: FloatArray, more: Mapping[int, FloatArray] | None = None) -> FloatArray:
        columns = known | dict(more or {})
        x = np.column_stack([columns.get(k, nothing)[at] for k in range(len(model.states))])
        return along(f, x, u, p)[:, i]

    start = model.with_parameters(**problem.parameter_starts).parameter_vector()
    for i in (i for i in rates if model.rates.get(i) not in known):
        over, under = _equation(model, i)
        here = rate(over, i, start)
        moved = {k: rate(over, i, start, {k: nothing + 1.0}) for k in range(len(model.states)) if k not in known}
        if missing := [model.states[k] for k, there in moved.items() if not np.array_equal(there, here)]:
            raise InputError(SAYS("missing", state=model.states[i], missing=", ".join(missing)))

        def residual(p: FloatArray, i: int = i, over: Any = over, under: Any = under) -> FloatArray:
            return filtered(rate(under, i, p) * rates[i][at] - rate(over, i, p))

        yield model.states[i], residual
    functions = {n: h for n, h in model.outputs.items() if n in problem.outputs and not isinstance(h, int)}
    if functions and not known:
        run = problem.simulate(problem.start, e)
        if not run.completed or model.program.constants & {*sought}:
            names = ", ".join(sorted(model.program.constants & {*sought}))
            raise InputError(SAYS("unmeasured", names=names or "no solution here"))
        pairs = [*zip(run.states[:: problem.substeps][at].tolist(), u.tolist(), strict=True)]
        for name, h in functions.items():
            y, f = e.measured[at, problem.outputs.index(name)], getattr(h, "py_func", h)

            def shown(p: FloatArray, y: FloatArray = y, f: Any = f) -> FloatArray:
                return filtered(y - np.array([f(0.0, state, v, p) for state, v in pairs]))

            yield name, shown


def linear_in(residual: Residual, names: Sequence[str], at: FloatArray, places: Mapping[str, int]) -> list[str]:
    """Those of the constants in which a residual is linear, all together: second differences vanish.

    Examples
    --------
    >>> x = np.linspace(0, 1, 9)
    >>> force = lambda p: p[0] * (x - p[1]) + p[2] * np.tanh(x / p[3])
    >>> linear_in(force, ["k", "rest", "f", "v"], np.full(4, 0.5), {"k": 0, "rest": 1, "f": 2, "v": 3})
    ['k', 'f']
    """
    steps = np.diag(0.3 * np.abs(at) + 1e-2)
    moves = {n: (at + steps[places[n]]) - at for n in names}
    here = residual(at)
    once = {n: residual(at + d) for n, d in moves.items()}
    size = {n: float(np.max(abs(r - here))) for n, r in once.items()}
    kept = [n for n in names if np.max(abs(residual(at + 2 * moves[n]) - 2 * once[n] + here)) <= HELD * size[n]]
    for a, b in combinations([*kept], 2):
        if a in kept and b in kept:
            mixed = residual(at + moves[a] + moves[b]) - once[a] - once[b] + here
            if np.max(abs(mixed)) > HELD * max(size[a], size[b]):
                kept.remove(b)
    return kept


def regress_equations(problem: Problem) -> Regression:
    """Estimate the free constants of a problem in which its equations are linear; orders stay at their start.

    Raises
    ------
    InputError
        If there are none, if an equation has a state that nothing measures, or if the motion determines only ratios.
    """
    names = [u.target for u in problem.unknowns if u.kind == "parameter" and u.experiment is None]
    model = problem.model.with_parameters(**problem.parameter_starts)
    at = model.parameter_vector().astype(float)
    places = {n: k for k, n in enumerate(model.parameter_names)}
    unknown = [n for n in names if n in places]
    experiments = [replace(e, measured=lines_over(within(e.start + e.time, e.mask, 1e-6 * e.step), e.time, e.measured))
                   for e in problem.experiments]  # fmt: skip
    equations = [r for e in experiments for r in _rows(problem, e, unknown, 1.0)]
    for _, residual in equations:
        unknown = linear_in(residual, unknown, at, places)
    here, ones = [(residual, residual(at)) for _, residual in equations], np.eye(len(at))
    idle = [n for n in unknown if all(np.array_equal(r(at + ones[places[n]]), before) for r, before in here)]
    held = {"the equations are not linear in": [n for n in names if n not in unknown], "no equation depends on": idle}
    unknown = [n for n in unknown if n not in idle]
    if not unknown or not equations:
        raise InputError(SAYS("not-linear", model=model, names=", ".join(names) or "none is free"))
    longer = [r for e in experiments for r in _rows(problem, e, unknown, STEEPER)]
    of, again = (_scaled(some, [places[n] for n in unknown], at) for some in (equations, longer))
    if not any(np.max(np.abs(W[:, -1])) > 1e-9 * size for W, size in zip(of.system.W, of.scales, strict=True)):
        raise InputError(SAYS("no-known-constant", names=", ".join(unknown)))
    v, weights = solve("huber", of)
    bias = v - solve("huber", again)[0]
    covariance = sandwich(of, None, v, weights, lags=max(map(len, of.system.W)) // BLOCKS)
    units = {n: model.parameter(n).unit for n in unknown}
    constants = constants_of(units, of.gauge, v, bias, covariance=covariance, dependent={})
    errors = np.hypot(np.sqrt(np.diag(covariance)), bias).tolist()
    wider = {n: replace(c, standard_error=e) for (n, c), e in zip(constants.items(), errors, strict=True)}
    note = [f"{', '.join(which)}: {why} {'it' if len(which) == 1 else 'them'}; held at the project's start."
            for why, which in held.items() if which]  # fmt: skip
    if problem.orders:
        note.append(f"{', '.join(problem.orders)}: held at the start; fracid fit searches orders.")
    first = experiments[0]
    width = smoothing(first.measured, first.step) * first.step
    return doubted(estimated(
        of, v, weights, parameters=wider,
        searched={n: SearchedOrder(value=v, interval95=None) for n, v in problem.order_starts.items()},
        combinations={}, estimator="huber", noise_ratio=math.nan, noise={}, cutoff=0.13 / width,
        cutoff_reason="a Gaussian window from the spectrum", window=width,
        amplitude=float(np.ptp(first.measured[:, 0]) / 2), warnings=tuple(note),
    ), False, "huber")  # fmt: skip


def _scaled(equations: Sequence[Equation], index: Sequence[int], at: FloatArray) -> Scaled:
    """W β = 0, what is known in its last column, and the largest term of each equation at the start."""
    zero = at.copy()
    zero[index] = 0.0
    parts: dict[str, list[FloatArray]] = {}
    for name, residual in equations:
        known = residual(zero)
        columns = (residual(zero + one) - known for one in np.eye(len(at))[index])
        parts.setdefault(name, []).append(np.column_stack([*columns, known]))
    W = tuple(map(np.concatenate, parts.values()))
    terms = (np.sqrt(np.mean((rows * np.append(at[index], 1.0)) ** 2, axis=0)) for rows in W)
    gauge = Gauge(tuple(range(len(index))), np.eye(len(index) + 1)[-1])
    return Scaled(System(tuple(parts), W), gauge, np.array([t.max() for t in terms]))
