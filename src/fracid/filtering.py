"""An observer of an identified model: its states, and chosen constants and orders, from a few sensors, step by step.

An extended Kalman filter on the modes of the memory (:mod:`fracid.solver.kalman`).  What the model does not explain
drives it as white noise, one value a step, whose intensity makes the recordings of the fit most likely.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import minimize_scalar

from fracid.arrays import FloatArray, by_name
from fracid.errors import InputError, refuse_unknown
from fracid.findings import Words
from fracid.fit import Fit
from fracid.models import Model
from fracid.models.joints import Complement
from fracid.models.written.formulas import Formula
from fracid.models.written.reading import read_outputs
from fracid.problem import Problem
from fracid.signals.noise import noise_floor, white_noise
from fracid.solver.kalman import FAR, HIGHEST, LOWEST, Filter, bent, run_filter, weights
from fracid.solver.right_hand_side import compile_rhs
from fracid.solver.solve import time_scale

SAYS = Words("filtering.toml")

SPACING = 1.0
"""Δ, between the logarithms of the rates: the memory is right within 10⁻⁴."""

SLOWEST, FASTEST = 0.1, 3.0
"""The lowest rate over one in the length of the recording, the highest over one in a step."""

TUNED_ON = 3000
"""Samples of a recording on which the unknown drive is found."""

UNSEEN = 0.98
"""Where the sensors leave so much of a standard deviation, they do not see it."""

TOGETHER = 0.1
"""Of a direction that is not seen, what a constant must have of it to be named."""


@dataclass(frozen=True)
class Track:
    """What an observer made of samples; a row a sample."""

    time: FloatArray
    """[s], shape (n,)."""
    states: Mapping[str, FloatArray]
    """State, and slow constant or order → its estimate."""
    deviations: Mapping[str, FloatArray]
    """The same → standard deviation."""
    innovations: FloatArray
    """Measured minus predicted, of each sensor; NaN where nothing was measured, shape (n, n_sensors)."""
    nis: FloatArray
    """Normalised innovation squared: of a consistent filter as large as :attr:`count` on average, shape (n,)."""
    count: FloatArray
    """Sensors that were read, shape (n,)."""
    minus_log_likelihood: float
    """Of the innovations, without a constant."""


@dataclass(eq=False)
class StateObserver:
    """An extended Kalman filter; :func:`observer` makes one of a fit."""

    model: Model
    sensors: tuple[str, ...]
    noise: Mapping[str, float]
    """Sensor → standard deviation of its noise."""
    slow: tuple[str, ...]
    """Constants and orders that are estimated."""
    start: Filter
    """Before the first sample."""
    substeps: int
    held: bool
    """Whether inputs keep their value over a step; else they go in lines."""
    now: Filter = field(init=False)
    steps: int = field(init=False, default=0)
    """Samples so far."""

    def __post_init__(self) -> None:
        """Begin."""
        m, outputs = self.model, tuple(self.model.outputs[n] for n in self.sensors)
        program = read_outputs(outputs, m.parameter_names, len(m.states), len(m.inputs))
        self._functions = compile_rhs(m.rhs), compile_rhs(Formula(program))
        self.reset()

    def reset(self) -> None:
        """Go back to before the first sample."""
        self.now, self.steps = Filter._make(part.copy() for part in self.start), 0

    @property
    def covariance(self) -> FloatArray:
        """Of the states now, then of the slow ones, shape (n_states + n_slow, n_states + n_slow)."""
        F, states = self.now, len(self.model.states)
        modes, c, dc = len(F.z), np.zeros(len(F.z)), np.zeros(len(F.z))
        C = np.zeros((states + len(self.slow), len(F.xi)))
        C[states:, modes:] = np.eye(len(self.slow))
        doubt = np.zeros(len(C))
        for i in range(states):
            block = slice(F.begin[i], F.begin[i + 1])
            weights.py_func(F.orders[i], F.rates, len(c[block]), c, dc=dc, first=block.start)
            C[i, block] = c[block]
            if F.of[i] >= 0:
                C[i, modes + F.of[i]] = dc[block] @ F.xi[block]
                sides = np.zeros((3, len(c)))
                for side, far in zip(sides, (FAR, -FAR), strict=False):
                    weights.py_func(F.orders[i] + far, F.rates, len(c[block]), side, dc=sides[2], first=block.start)
                doubt[i] = bent.py_func(F, i, c, dc, *sides[:2])[1]
        return np.asarray(C @ F.P @ C.T + np.diag(doubt))

    def step(self, measured: Sequence[float], inputs: Sequence[float] = ()) -> Track:
        """Take one sample of the sensors, NaN for one that is missing, and the inputs at the sample.

        An input that is computed from this estimate is written into ``now.u`` afterwards.
        """
        return self.run(np.atleast_2d(np.asarray(measured, dtype=np.float64)), np.atleast_2d(inputs))

    def run(self, measured: FloatArray, inputs: FloatArray | None = None) -> Track:
        """Go on through samples.

        Parameters
        ----------
        measured : ndarray, shape (n, n_sensors)
        inputs : ndarray, shape (n, n_inputs), optional
            Those at the samples; held ones keep their value until the next.

        Returns
        -------
        Track
        """
        states, k, every = len(self.model.states), len(self.slow), self.substeps
        y = np.asarray(measured, dtype=np.float64).reshape(-1, len(self.sensors))
        given = inputs is not None and np.size(inputs)
        u = np.asarray(inputs) if given else np.zeros((1, max(1, len(self.model.inputs))))
        between = every if self.steps else 1  # steps before the first of these samples
        rows = np.full((every * (len(y) - 1) + between, y.shape[1]), np.nan)
        rows[between - 1 :: every] = y
        if len(u) > 1 or every > 1:
            known = np.vstack([self.now.u, np.broadcast_to(u, (len(y), u.shape[1]))])
            at = 1 + (np.arange(len(rows)) - between + 1) / every
            at = np.floor(at) if self.held else at
            u = np.column_stack([np.interp(at, np.arange(len(known)), column) for column in known.T])
        width = 2 * (states + k)
        out = np.zeros((len(rows), width + len(self.sensors) + 3))
        variance = np.array([self.noise[n] ** 2 for n in self.sensors])
        first = (self.steps - 1) * every + 1 if self.steps else 0
        run_filter(*self._functions, self.now, first, rows, np.ascontiguousarray(u, dtype=np.float64), variance,
                   self.held, out)  # fmt: skip
        out = out[between - 1 :: every]
        time = (self.steps + np.arange(len(y))) * self.start.h[0] * every
        self.steps += len(y)
        names = (*self.model.states, *self.slow)
        return Track(
            time, dict(zip(names, out[:, : states + k].T, strict=True)),
            dict(zip(names, out[:, states + k : width].T, strict=True)), out[:, width:-3], nis=out[:, -3],
            count=out[:, -1], minus_log_likelihood=float(np.sum(out[:, -3] + out[:, -2])),
        )  # fmt: skip


def observer(
    fit: Fit,
    sensors: Sequence[str] = (),
    noise: Mapping[str, float] | None = None,
    *,
    slow: Mapping[str, float] | None = None,
    initial: Mapping[str, float] | None = None,
    drive: float | None = None,
) -> StateObserver:
    """Make an observer of a fit.

    Parameters
    ----------
    fit : Fit or SavedRun
    sensors : sequence of str
        Outputs that are measured; those that were fitted if empty.
    noise : mapping, optional
        Sensor → standard deviation of its noise; that of the recording if left out.
    slow : mapping, optional
        Constant or order that is estimated too → how far it walks in a second, as a standard deviation; 0 for one that
        is constant and unknown.
    initial : mapping, optional
        State, slow constant or order → standard deviation of its value at the start; if left out three times the noise
        of a sensor, a tenth of the range of another state and of the value of a constant.
    drive : float, optional
        What drives the model beside its inputs, as part of its own derivatives in one second; what makes the first
        recording most likely if left out.

    Returns
    -------
    StateObserver

    Raises
    ------
    InputError
        For what cannot be observed with these sensors, and for models and channels that the filter does not know.

    Examples
    --------
    >>> import fracid
    >>> from types import SimpleNamespace
    >>> model = fracid.model("pendulum")
    >>> t = 0.01 * np.arange(500)
    >>> run = fracid.simulate(model, orders={"mu": 0.95}, initial={"angle": 1.0}, step=0.01, end=4.99)
    >>> y = run.states[:, :1] + 1e-3 * np.random.default_rng(1).standard_normal((500, 1))
    >>> e = fracid.Experiment("twin", 0.01, y, np.zeros((1, 1)), initial={"angle": 1.0})
    >>> problem = fracid.Problem(model, (e,), {"mu": 0.95}, initial_state="held")
    >>> watch = observer(SimpleNamespace(problem=problem, x=problem.start))
    >>> track = watch.run(y)
    >>> bool(np.std(track.states["rate"] - run.states[:, 1]) < 0.02 * np.std(run.states[:, 1]))
    True
    """
    problem, x = fit.problem, fit.x
    model, e = problem.model, problem.experiments[0]
    names, slow = tuple(sensors) or problem.outputs, dict(slow or {})
    refuse_unknown("sensor", model.outputs, *names)
    refuse_unknown("slow constant or order", (*model.parameter_names, *model.order_names), *slow)
    if wrong := [n for n, drift in slow.items() if not drift >= 0.0]:
        raise InputError(f"slow: {wrong[0]} drifts by {slow[wrong[0]]:g} in 1 s; expected 0 or more, e.g. 1e-6.")
    if derived := [n for n in names if n in model.derived]:
        raise InputError(SAYS("derivative", name=derived[0]))
    if time_scale(model, problem.unpack(x, e)[1]) != 1.0:
        raise InputError("An observer takes frequencies in rad/s: fit with time_scale = 1.")
    if model.relaxing:
        raise InputError(SAYS("relaxing", names=", ".join(model.relaxing)))
    if channels := {c for c in (*e.sensors, *e.actuators)}:
        raise InputError(SAYS("channels", names=", ".join(sorted(channels))))
    recorded = {n: e.measured[:, problem.outputs.index(n)] for n in names if n in problem.outputs}
    # where it is finer than its digits, of all samples
    noise = {n: noise_floor(y) or white_noise(y) for n, y in recorded.items()} | dict(noise or {})
    for n in names:
        if not noise.get(n, 0.0) > 0.0:
            raise InputError(f"The noise of {n} is not known: give it, noise={{{n!r}: standard deviation}}.")
    run = problem.simulate(x, e)
    made = _Made(problem, x, names, noise, slow=slow, initial=dict(initial or {}), simulated=run.states)
    made.look_for_what_is_unseen()
    return made.observer(made.most_likely_drive() if drive is None else drive)


def first_samples(problem: Problem, sensors: Sequence[str], most: int) -> tuple[FloatArray, FloatArray]:
    """Of the first recording as an observer takes them: sensors, NaN for one that was not recorded, and inputs.

    Examples
    --------
    >>> import fracid
    >>> e = fracid.Experiment("twin", 0.01, np.zeros((9, 1)), np.arange(9.0)[:, None])
    >>> problem = fracid.Problem(fracid.model("pendulum"), (e,), {"mu": 1.0}, initial_state="held")
    >>> first_samples(problem, ("angle",), 3)[1].ravel().tolist()
    [0.0, 1.0, 2.0]
    """
    e = problem.experiments[0]
    y = np.full((min(most, len(e.measured)), len(sensors)), np.nan)
    for m, n in enumerate(sensors):
        if n in problem.outputs:
            y[:, m] = e.measured[: len(y), problem.outputs.index(n)]
    return y, e.inputs[: len(y)]


@dataclass
class _Made:
    """What an observer is made of."""

    problem: Problem
    x: FloatArray
    sensors: tuple[str, ...]
    noise: Mapping[str, float]
    slow: Mapping[str, float]
    initial: Mapping[str, float]
    simulated: FloatArray
    """States along the first recording."""

    def observer(self, drive: float) -> StateObserver:
        """With so much unknown drive."""
        problem, model, e = self.problem, self.problem.model, self.problem.experiments[0]
        orders, p, start = (v.copy() for v in problem.unpack(self.x, e)[:3])
        h = e.step / problem.substeps
        names = [str(q.parameter) if isinstance(q, Complement) else q for q in model.orders]
        lowest = SLOWEST / max(e.steps * e.step, 100 * h)
        count = math.ceil(math.log(FASTEST / h / lowest) / SPACING) + 1
        rates = lowest * np.exp(SPACING * np.arange(count))
        ph, lasting = rates * h, [1.0, h / 2, h / 2]
        kept, whole = np.exp(-ph), -np.expm1(-ph) / rates
        end = (h - whole) / ph  # of a line that rises to 1
        decaying = np.column_stack([kept, whole - end, end])
        # the start, what does not decay, what decays, what decays at once
        fractional = np.vstack([[1.0, 0.0, 0.0], lasting, decaying, [0.0, 0.0, 1.0]])
        integer = [q == 1.0 and name not in self.slow for q, name in zip(orders, names, strict=True)]
        blocks = [np.array([lasting]) if one else fractional for one in integer]
        begin, (z, a, b) = np.cumsum([0, *map(len, blocks)]), np.vstack(blocks).T.copy()
        modes, k = len(z), len(self.slow)
        slow, xi, P = np.zeros((k, 5)), np.zeros(modes + k), np.zeros((modes + k, modes + k))
        for s, (n, walk) in enumerate(self.slow.items()):
            if n in model.parameter_names:
                index = model.parameter_names.index(n)
                q = model.parameters[index]
                slow[s], value = (0.0, index, q.lower, q.upper, walk**2 * h), p[index]
            else:
                slow[s], value = (1.0, 0.0, LOWEST, HIGHEST, walk**2 * h), orders[names.index(n)]
            xi[modes + s], P[modes + s, modes + s] = value, self.initial.get(n, 0.1 * abs(value)) ** 2
        sizes = np.ptp(self.simulated, axis=0)
        for i, state in enumerate(model.states):
            sensor = next((n for n in self.sensors if model.output_states.get(n) == i), None)
            deviation = self.initial.get(state, 3 * self.noise[sensor] if sensor else 0.1 * sizes[i])
            xi[begin[i]], P[begin[i], begin[i]] = start[i], deviation**2
        of = [list(self.slow).index(n) if n in self.slow and n in model.order_names else -1 for n in names]
        drives = drive**2 * self._sizes() ** 2
        first = Filter(
            z, a, b, begin, rates=np.array([lowest, SPACING, float(count)]), orders=orders, p=p, slow=slow,
            of=np.array(of), drive=drives, xi=xi, P=P, u=np.zeros(max(1, len(model.inputs))), h=np.array([h]),
        )  # fmt: skip
        held = bool(e.between) and all(e.between.get(n) == "hold" for n in model.inputs)
        return StateObserver(model, self.sensors, self.noise, tuple(self.slow), start=first, substeps=problem.substeps,
                             held=held)  # fmt: skip

    def _sizes(self) -> FloatArray:
        """How large f is along the recording, of the states that forces act on; of those whose rate is a state 0."""
        model, e = self.problem.model, self.problem.experiments[0]
        p = self.problem.unpack(self.x, e)[1]
        u = e.all_inputs
        at = np.linspace(0, len(self.simulated) - 1, 200).astype(int)
        inputs = u[np.minimum(at // self.problem.substeps, len(u) - 1)]
        rows = [model.derivatives(x, v, p)[: len(x)] for x, v in zip(self.simulated[at], inputs, strict=True)]
        size = np.sqrt(np.mean(np.square(rows), axis=0))
        size[list(model.rates)] = 0.0
        return np.asarray(size)

    def most_likely_drive(self) -> float:
        """Of the first recording."""
        y, u = first_samples(self.problem, self.sensors, TUNED_ON)

        def surprise(log_drive: float) -> float:
            value = self.observer(math.exp(log_drive)).run(y, u).minus_log_likelihood
            return value if math.isfinite(value) else 1e300

        found = minimize_scalar(surprise, bounds=(-14.0, 3.0), method="bounded", options={"xatol": 0.1})
        return math.exp(float(found.x))

    def look_for_what_is_unseen(self) -> None:
        """Refuse a state or a slow constant that the sensors leave as uncertain as it was."""
        y, u = first_samples(self.problem, self.sensors, TUNED_ON)
        wide = by_name(self.problem.model.states, 0.05 * np.ptp(self.simulated, axis=0))
        doubts = {n: v for n, v in self.initial.items() if n in self.slow}
        made = replace(self, slow=dict.fromkeys(self.slow, 0.0), initial=wide | doubts)
        still = made.observer(0.0)
        start = dict(zip((*wide, *self.slow), np.sqrt(np.diag(still.covariance)), strict=True))
        for n in self.slow:
            if start[n] == 0.0:
                raise InputError(SAYS("no-tenth", name=n))
        # the model's own samples: a filter that moves its constants believes that it sees what it does not
        deaf = replace(made, noise={n: 1e9 * v for n, v in self.noise.items()}).observer(0.0)
        seen = still.run(-deaf.run(0 * y, u).innovations, u).deviations
        for n, doubt in start.items():
            if doubt > 0.0 and seen[n].min() > UNSEEN * doubt:
                raise InputError(SAYS("unseen", name=n, sensors=" and ".join(self.sensors)))
        if self.slow:  # each may be seen and yet only their ratio: a direction that stays as uncertain as it was
            doubt = np.array([start[n] for n in self.slow])
            values, directions = np.linalg.eigh(still.covariance[-len(doubt) :, -len(doubt) :] / np.outer(doubt, doubt))
            if values[-1] > UNSEEN**2:
                names = [n for n, d in zip(self.slow, directions[:, -1], strict=True) if abs(d) > TOGETHER]
                raise InputError(SAYS("together", names=" and ".join(names), sensors=" and ".join(self.sensors)))
