r"""Where the search for a model's constants begins: its equations, held against the recording's own derivatives.

At orders q (a springpot's at its model's own) the equations of a model say of every sample

.. math::  D^q x_i = f_i(x, u, p), \qquad y = h(x, u, p).

With q = 1; where that leaves much, with a lower one too: at order 1 a swing of order 0.7 has a hundred times its mass.
States that are measured, and the rates of those, come from the recording, smoothed; those that nobody measures are
simulated between them.  The constants p are those of least squares, from where the library's rig has them in the size
of the recording's, which may be any; nothing is compiled, and a recording takes a second or two.  Optional terms, those
whose constant is 0 in the library, are kept where they explain part of the equations, the one that explains most first.
What noise does to the derivatives biases such values by some per cent, which a start forgives.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from operator import attrgetter

import numpy as np

from fracid.arrays import ByName, FloatArray, Signals
from fracid.models import Model
from fracid.models.joints import Complement
from fracid.models.written.equations import NONE, dimension
from fracid.solver.operators import gl_weights

SAMPLES = 160
"""At which the equations are compared."""

STEPS = 300
"""Of a simulation of what is not measured."""

ABOVE = 30.0
"""Times the floor of its spectrum: what of a signal stands so high is motion, and smoothing leaves it alone."""

NOISE, MOST = 0.1, 6.0
"""Where more of the derivatives is noise, all signals are smoothed more, by so much at most."""

REACH = 6.0
"""Widths of the Gaussian: cut at four, the second derivative of a constant of 5 rad at 500 Hz is 120 rad/s^2."""

TERM = 0.03
"""An optional term is kept, and a size, if without it the equations leave more by this part of what they leave."""

CLEAR = 3e-3
"""Of the scatter: less is left by how signals are smoothed, and no part of that says anything of a term."""

LITTLE = 0.3
"""Of the scatter: with more left to explain, a search with another term begins anew too."""

BEYOND = 1e9
"""A state beyond this has run away, whatever its unit."""

NEAR = 0.03
"""To be off the library's value, in the rig's size, by a factor of e counts as this part of what the equations leave:
what they do not tell, such as how heavy the pole of a cart is that hardly feels it, stays where rigs have it."""

DECADES = 8
"""By which a rig may be larger or smaller than the library's at a time."""

STEEP = 1e3
"""Times a cost: a size that has so much is not near a better one."""

MUCH = 0.1
"""Of the scatter, with which the equations are tried at the order"""

LOW = 0.8
"""too, in the middle of what rigs have."""

EVALUATIONS = 40
"""Of a least-squares search."""


@dataclass(frozen=True)
class FirstValues:
    """Constants of a model from a recording."""

    values: Mapping[str, float]
    """Of the parameters that the recording says something of [SI]."""
    reach: Mapping[str, float]
    """Parameter → the value at which its term alone would explain all [SI]; of all that have a term."""
    explained: float
    """Share of the equations' scatter that they explain, 1 at best."""


def first_values(
    model: Model, step: float, signals: Signals, free: Sequence[str], optional: Sequence[str] = (),
    starts: Mapping[str, float] | None = None,
) -> FirstValues:  # fmt: skip
    """Estimate a model's constants from one recording.

    Parameters
    ----------
    model : Model
    step : float
        Between samples [s].
    signals : mapping
        Outputs and inputs on that grid, without gaps [SI], shape (n_samples,) each.
    free, optional : sequence of str
        Parameters to estimate, and those to add where their terms count; what is in both is added last all the same.
    starts : mapping, optional
        State → its first value, of those that are not measured.

    Returns
    -------
    FirstValues

    Examples
    --------
    A mass on a spring of 50 N/m with a damper of 2 N s/m, sampled at 100 Hz:

    >>> import fracid
    >>> t = np.arange(0, 10, 0.01)
    >>> x = 0.1 * np.exp(-t) * np.cos(7 * t)
    >>> mass = fracid.model("oscillator", k3=0.0)
    >>> found = first_values(mass, 0.01, {"displacement": x, "force": 0 * t}, ["k", "b_displacement"])
    >>> {n: float(f"{v:.1g}") for n, v in found.values.items()}, found.explained > 0.99
    ({'k': 50.0, 'b_displacement': 2.0}, True)
    """

    def at(order: float) -> FirstValues:
        return _found(_Equations(model, step, signals, dict(starts or {}), order), free, optional)

    found = at(1.0)
    return found if found.explained > 1 - MUCH else max(found, at(LOW), key=attrgetter("explained"))


def _found(equations: _Equations, free: Sequence[str], optional: Sequence[str]) -> FirstValues:
    """The constants at the order of the equations."""
    library = {p.name: p.value for p in equations.model.parameters}
    alone = equations.reach(library, optional)
    sizes = [_in_size(equations, first, free) for first in (library, _in_size(equations, library, free, "alike"))]
    felt = [n for first in (library, *sizes) for n in equations.reach(first, free)]
    names = [n for n in free if n in felt and n not in optional]
    fits = [(first, *_fitted(equations, first, names)) for first in sizes[: 1 + (sizes[0] != sizes[1])]]
    base, values, cost = min(fits, key=lambda one: one[2])
    while left := [n for n in alone if n not in names]:
        firsts = [(n, base | values) for n in left]
        if equations.simulated and cost > LITTLE:  # it may fit best where nothing moves, and no slope leads back
            begun = [(n, _in_size(equations, library | {n: alone[n]}, [n])) for n in left]
            firsts += [(n, _in_size(equations, first, [*names, n], "parts")) for n, first in begun]
        trials = [(n, *_fitted(equations, first, [*names, n])) for n, first in firsts]
        n, more, less = min(trials, key=lambda one: one[2])
        if not _is_lower(less, cost):
            break
        names, values, cost = [*names, n], more, less
    felt += equations.reach(base | values, free)  # where an arm hangs, by now that its weight is known
    names += [n for n in free if n in felt and n not in names]
    values, cost = _fitted(equations, _in_size(equations, base | values, names), names)
    here = base | {n: v for n, v in values.items() if base[n]}  # of a term that is all but 0 no slope can be measured
    reach = equations.reach(base | values, [*free, *optional]) | equations.reach(here, names)
    return FirstValues(values, reach, max(0.0, 1.0 - cost))


def smoothing(measured: FloatArray, step: float) -> float:
    """Samples of the Gaussian that smooths signals, shape (n_samples, n), and leaves their motion alone."""
    return max(1.5, 0.03 / step / max(_highest(x, step) for x in measured.T))


def along(f: Callable[..., None], x: FloatArray, u: FloatArray, p: FloatArray) -> FloatArray:
    """A right-hand side, not compiled, at states and inputs, shape (n_samples, n_states)."""
    rates = np.zeros(x.shape)
    with np.errstate(all="ignore"):  # an equation beside the one that is looked at may divide by what is 0 here
        for out, state, inputs in zip(rates, x.tolist(), u.tolist(), strict=True):
            f(0.0, state, inputs, p, out)
    return rates


def _in_size(equations: _Equations, values: ByName, free: Sequence[str], by: str = "each") -> dict[str, float]:
    """Constants in the size of the recording's rig, by powers of ten: of all as a unit has it, of each, of all but one.

    In another unit of mass, length or time all ratios stay as the library's rig has them; an order counts as a half in
    the unit of a springpot, as 1 in that of a capacity.
    """
    rows = [equations.model.parameter(n) for n in free if values[n]]
    each = np.eye(len(rows))
    plain = [p.unit.replace("^nu", "^0.5").replace("^(q-1)", "^0") for p in rows]
    units = np.array([dimension(unit) or NONE for unit in plain]).T
    parts = [unit * part for unit in units for part in 1 - each]
    moves = {"alike": [*units], "each": [*units, *each], "parts": [*units, *each, *parts]}[by]
    directions = {tuple(move / move[np.argmax(np.abs(move))]): None for move in moves if move.any()}
    least, best, start = equations.cost(values), dict(values), dict[str, float]()
    while best is not start:
        start, steep = best, STEEP * least
        for direction, factor in product(directions, (10.0, 0.1)):
            for k in range(1, DECADES + 1):
                moved = zip(rows, direction, strict=True)
                size = start | {p.name: float(np.clip(start[p.name] * factor ** (k * d), p.lower, p.upper))
                                for p, d in moved}  # fmt: skip
                cost = equations.cost(size)
                if _is_lower(cost, least):
                    least, best = cost, size
                if cost > steep:
                    break
    return best


def _is_lower(cost: float, other: float) -> bool:
    """Whether it is worth a term, or another size."""
    return cost < other - TERM * max(other, CLEAR)


class _Equations:
    """The residuals of the equations at some samples of a recording."""

    def __init__(self, model: Model, step: float, signals: Signals, starts: ByName, order: float) -> None:
        from scipy.ndimage import gaussian_filter1d
        from scipy.signal import fftconvolve

        self.model = model
        named = {n: order for n in model.order_names} | dict.fromkeys(model.springpot_orders.values(), 0.5)
        self.orders = [0.5 if isinstance(o, Complement) else 1.0 for o in model.orders] if not named else (
            model.state_orders(named).tolist())  # fmt: skip
        measured = {n: i for n, i in model.output_states.items() if n in signals}
        shown = np.column_stack([signals[n] for n in measured or model.outputs if n in signals])
        width = smoothing(shown, step)
        while width < MOST * smoothing(shown, step) and _noise_in_slopes(shown, width, 2 if model.rates else 1) > NOISE:
            width *= 1.25

        def smooth(x: FloatArray, order: int = 0) -> FloatArray:
            return np.asarray(gaussian_filter1d(x, width, order=order, mode="nearest", truncate=REACH)) / step**order

        def slope(x: FloatArray, *states: int) -> FloatArray:
            """The derivatives of these states' orders, one after the other."""
            rate, r = smooth(x, len(states)), sum(1 - self.orders[i] for i in states)
            return rate if r == 0 else fftconvolve(rate, gl_weights(-r, len(x)))[: len(x)] * step**r

        n = len(next(iter(signals.values())))
        x, self.slopes = np.zeros((n, len(model.states))), dict[int, FloatArray]()
        for name, i in measured.items():
            x[:, i], rate = smooth(signals[name]), model.rates.get(i)
            if rate is None:
                self.slopes[i] = slope(signals[name], i)
            else:
                x[:, rate], self.slopes[rate] = slope(signals[name], i), slope(signals[name], i, rate)
        u = np.zeros((n, max(1, len(model.inputs))))
        raw = not measured  # outputs are compared as they were recorded
        for i, name in enumerate(model.inputs):
            if name in signals:
                u[:, i] = signals[name] if raw else smooth(signals[name])
            elif model.input_rates.get(name) in signals:
                u[:, i] = np.gradient(signals[model.input_rates[name]], step)
            else:
                u[:, i] = model.input_defaults.get(name, 0.0)
        edge = 0 if raw else min(int(np.ceil(4 * width)), n // 4)
        self.simulated = [i for i in range(len(model.states)) if i not in {*measured.values(), *self.slopes}]
        every = max(1, (n - 2 * edge) // (STEPS if self.simulated else SAMPLES))
        self.at = np.arange(edge, n - edge, every)
        self.step, self.x, self.u = every * step, x[self.at], u[self.at]
        self.flows = np.add.reduceat(u, self.at) / np.diff(self.at, append=n)[:, None]
        self.slopes = {i: s[self.at] for i, s in self.slopes.items()}
        self.outputs = {} if measured else {h: signals[name][self.at] for name, h in model.outputs.items()
                                            if name in signals and not isinstance(h, int)}  # fmt: skip
        self.start = {model.states.index(s): v for s, v in starts.items() if s in model.states}

    def residuals(self, values: ByName) -> FloatArray:
        """In parts of the scatter of what each equation is to explain."""
        rhs, p = self.model.rhs.py_func, self.model.parameter_vector(values)  # type: ignore[attr-defined]
        x = self._with_simulated(rhs, p) if self.simulated else self.x
        rows = []
        pick = slice(None, None, max(1, len(x) // SAMPLES))
        if self.slopes:
            f = along(rhs, x[pick], self.u[pick], p)
            rows = [(s[pick] - f[:, i]) / _size(s[pick]) for i, s in self.slopes.items()]
        for h, y in self.outputs.items():
            found = [h(0.0, state, u, p) for state, u in zip(x[pick].tolist(), self.u[pick].tolist(), strict=True)]  # type: ignore[operator]
            rows.append((y[pick] - np.array(found)) / _size(y[pick] - y.mean()))
        residuals: FloatArray = np.concatenate(rows) / np.sqrt(sum(map(len, rows)))
        return np.asarray(np.clip(np.nan_to_num(residuals, nan=BEYOND), -BEYOND, BEYOND))

    def cost(self, values: ByName) -> float:
        """What they leave of the scatter."""
        return float(np.sum(np.square(self.residuals(values))))

    def _with_simulated(self, rhs: Callable[..., None], p: FloatArray) -> FloatArray:
        """States that nobody measures, stepped by Grünwald and Letnikov between those that are."""
        x, n, out, own = self.x.copy(), len(self.x), np.zeros(len(self.model.states)), self.simulated
        first = np.array([self.start.get(i, 0.0) for i in own])
        gain = np.array([self.step ** self.orders[i] for i in own])
        weights = np.column_stack([gl_weights(self.orders[i], n + 1) for i in own])
        moved = np.zeros((n, len(own)))
        x[:, own] = first
        for k in range(1, n):
            rhs(0.0, x[k - 1].tolist(), self.flows[k - 1].tolist(), p, out)
            moved[k] = gain * out[own] - np.einsum("ki,ki->i", weights[1 : k + 1], moved[k - 1 :: -1])
            x[k, own] = first + moved[k]
            if not np.abs(moved[k]).max() < BEYOND:
                x[k:, own] = np.nan
                break
        return x

    def reach(self, base: ByName, names: Sequence[str]) -> dict[str, float]:
        """At which value each term alone would explain all; those without a term are left out."""
        here, found = self.residuals(base), {}
        for n in names:
            p = self.model.parameter(n)
            step = 1e-4 * abs(base[n]) if base[n] else 1e-6
            slope = np.sqrt(np.sum(np.square((self.residuals({**base, n: base[n] + step}) - here) / step)))
            if 1e-9 < slope * (abs(base[n]) or 1.0) < np.inf and p.lower < p.upper:
                found[n] = float(1.0 / slope)
        return found


def _size(x: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(x)))) or 1.0


def _highest(x: FloatArray, step: float) -> float:
    """The highest frequency at which a signal stands above the floor of its spectrum [Hz]."""
    power = np.abs(np.fft.rfft((x - x.mean()) * np.hanning(len(x)))) ** 2
    power = np.convolve(power, np.full(5, 0.2), mode="same")
    high = np.flatnonzero(power > ABOVE * np.median(power[len(power) // 2 :]))
    return float(max(high[-1] if high.size else 1, 1)) / (len(x) * step)


def _noise_in_slopes(measured: FloatArray, width: float, degree: int) -> float:
    """What white noise is of the first or second derivatives of signals, the most of all, after so much smoothing."""
    from scipy.ndimage import gaussian_filter1d

    slopes = gaussian_filter1d(measured, width, order=degree, axis=0, truncate=REACH)
    gain = 1 / (4 * np.sqrt(np.pi) * width**3) if degree == 1 else 3 / (8 * np.sqrt(np.pi) * width**5)
    power = np.abs(np.fft.rfft((measured - measured.mean(axis=0)) * np.hanning(len(measured))[:, None], axis=0)) ** 2
    floor = np.median(power[len(power) // 2 :], axis=0) / (0.375 * len(measured))
    return float(np.sqrt(np.max(gain * floor / np.maximum(np.var(slopes, axis=0), np.finfo(float).tiny))))


def _fitted(equations: _Equations, base: ByName, names: Sequence[str]) -> tuple[dict[str, float], float]:
    """The constants of least squares, and what is left of the scatter: logarithms of those that are positive."""
    from scipy.optimize import least_squares

    if not names:
        return {}, equations.cost(base)
    rows = [equations.model.parameter(n) for n in names]
    logs = np.array([p.lower >= 0.0 and p.value > 0.0 for p in rows])
    reach = equations.reach(base, names)
    scale = np.array([1.0 if log else reach.get(n, 1.0) for n, log in zip(names, logs, strict=True)])

    def moved(values: Sequence[float]) -> FloatArray:
        """What the search moves."""
        return np.asarray(np.where(logs, np.log(np.clip(values, 1e-12, 1e12)), np.array(values) / scale))

    lower, upper = moved([p.lower for p in rows]), moved([p.upper for p in rows])

    def values(z: FloatArray) -> dict[str, float]:
        x = np.where(logs, np.exp(np.where(logs, z, 0.0)), z * scale)
        return {**base, **{n: float(np.clip(v, p.lower, p.upper)) for n, v, p in zip(names, x, rows, strict=True)}}

    first = moved([base[n] for n in names])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        bounds = (lower, np.maximum(upper, lower + 1e-9))
        rows_at = lambda z: equations.residuals(values(z)) * np.hypot(1.0, NEAR * np.linalg.norm((z - first)[logs]))  # noqa: E731
        done = least_squares(rows_at, np.clip(first, lower, upper), bounds=bounds, x_scale="jac", max_nfev=EVALUATIONS)
    end = values(done.x)
    return {n: end[n] for n in names}, equations.cost(end)
