r"""An identification problem: a model, its recordings, what is free, and what counts as good.

::

    Problem = Model + Experiment, … + what is free + Cost   →   residuals(x), cost(x)

Each order and parameter is a number (fixed), :class:`Free` within bounds, or :class:`Tied` to another.  The
unknowns x, in this order, are

1. the free orders, λ and μ of (25), and the free parameters, which all recordings share,
2. for each recording the parameters named in `per_recording`, which it has for itself,
3. for each recording its initial state, unless that is taken as measured, and
4. its release time, where that is free: until then the initial state is held, then the motion begins.

``initial_state`` is one of

=============  ====================================================================================
``estimate``   the scored outputs and their rates are free: the start may be in motion
``rest``       the scored outputs are free, their rates are 0: a held plateau
``measured``   nothing is free: outputs as measured, rates from the slope of the first samples
``held``       nothing is free: outputs as measured, rates 0: the paper's release
=============  ====================================================================================

A release time τ lies between samples as well: the run starts at τ, on its own grid, and is read at the samples
by :meth:`Trajectory.at`, which follows τ smoothly; inputs keep the recording's clock.  It needs ``rest`` or
``held``, for a motion that is under way can begin anywhere.

States of which nothing is measured start at 0, and one named in an experiment's ``initial`` at its value there.
The rate of a state i is the state j of which the model says :math:`D^q x_i = x_j`.

**Levels.**  The level of an output is its residual's, never asked for: the rmse with ``weights = "noise"`` is the
geometric mean of the outputs' own,

.. math::  G = \prod_o C_o^{1/m}, \qquad C_o^2 = \tfrac1N\sum_t e_{t,o}^2,

the likelihood of normal errors after each σ_o was maximised out, :math:`-2\log L = 2N\sum_o\log C_o` + const
[BD]_: an output counts by its noise, not by its amplitude or unit.  Its least-squares rows are
:math:`(G/C_o)\,e_{t,o}`, whose weights move with x: reweighting that needs no rounds.  The same holds of
any cost that is a sum, with Laplace's likelihood for iae and itae.  No output counts as better than its encoder,
q/√12.

A :class:`Prior` is a normal density on an unknown.  With :math:`z = (x - mean)/sd` and n samples of all outputs,
:math:`-2\log` posterior :math:`= n\log C^2 + \sum z^2`, so the cost C becomes :math:`C\sqrt{1 + \sum z^2/n}` (equal to
first order in 1/n) and each prior is one row more, z at the level of the data's rows: where the fit is bad
the data weigh little, and the prior holds.  It counts samples as independent: where the residual is correlated
over k of them, the data weigh k times too much; give sd/√k.  Where :math:`z^2 > n`, that is where data and prior
contradict each other flatly, the prior gives way as Student's t does.  Costs of Laplace's kind have
:math:`C(1 + \sum z^2/2n)`.

A recording's `weight` w counts each of its samples as w samples.

**A start in motion** has a past, and its memory belongs into the equations: :math:`D^q x` sums over all that was.
An experiment with a `past`, the samples before its start, gives it: past and recording together are low-passed (zero
phase, at :data:`CUTOFF` swings); each scored output of order q is the state x of the past and
:math:`x_j = τ_0^{q-1} D^q x` its rate's, with the orders of the moment.  The memory begins with the release in the
past: of a plateau on which a hand holds the rig the equations know nothing, nor does it leave a memory.  The start
itself is as `initial_state` says, ``estimate`` or ``measured``; the latter takes :math:`x_j` from the past.  Without a
past the memory begins at the start, as if the rig had stood still in that posture and was struck.  Twins with orders
0.9, 0.95, 4096 counts and 10⁻³ rad of noise, cut 1.3 s after the release, 6.7 s fitted, found λ − 0.9, μ − 0.95
(``python benchmarks/evidence.py swing`` prints them again; :mod:`fracid.validation.unknown_past` does the like for any
fit):

============================ =============== =============== =============== ===============
twin                         ``estimate``    with its past   ``measured``    from plateau
============================ =============== =============== =============== ===============
60°, viscous friction        +.044, +.0006   +.000, −.0000   −.006, +.0001   +.000, −.0000
60°, dry friction too        −.004, −.0005   −.000, +.0000   +.001, +.0000   +.001, +.0000
20°, dry friction too        −.065, −.0005   +.005, −.0000   +.009, +.0001   +.003, −.0000
60°, dry, 10⁻² rad of noise  +.007, −.0005   +.016, +.0001   −.026, −.0003   +.005, +.0000
============================ =============== =============== =============== ===============

``measured`` takes the noise of the start for truth, and its intervals promise many times too much; where the noise is
as strong as in the last row the past mends μ alone.  Best is a start cut at the plateau.

A trajectory is stepped on the recording's own grid, or `substeps` times finer.  Residuals are measured
minus simulated [rad].  A run that diverges has an infinite cost and its reason, never a NaN.

References
----------
.. [BD] G. Box, N. Draper, Biometrika 52 (1965) 355: several outputs of unknown levels.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from hashlib import blake2b
from typing import Any, get_args

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import InputError, unknown_name
from fracid.models import Model
from fracid.optimise import Evaluation, Space
from fracid.problem.checks import check_choice, refuse_twins
from fracid.problem.costs import COSTS, Cost
from fracid.problem.experiment import Experiment
from fracid.problem.unknowns import Free, InitialState, Prior, Tied, Unknown, Value, Weights, root_of, start_of
from fracid.signals.resolution import resolution
from fracid.solver.arguments import Equation, InitialCondition, Options
from fracid.solver.memory import Memory, compressed
from fracid.solver.methods import METHODS
from fracid.solver.operators import derivative
from fracid.solver.right_hand_side import compile_rhs
from fracid.solver.solve import integrate, time_scale
from fracid.solver.trajectory import Trajectory
from fracid.tasks.simulation_cache import Memo

__all__ = ["Problem"]

EVERY = ("every output",)
"""In place of the outputs that are scored: all that the model has."""

LIMIT = 1e4
"""A state beyond this [rad, rad/s] ends a run as diverged; what is no angle, beyond so many times what was measured."""

TURNS = 100.0
"""No angle goes beyond this [rad]: what does is in another unit, whatever is said of it."""

FINEST = 1e-9
"""No output's level is below this [rad]."""


@dataclass(frozen=True)
class Problem:
    """What :func:`fracid.identify` solves.

    Examples
    --------
    >>> import fracid
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.2}, step=2e-3, end=4.0)
    >>> swing = Experiment("twin", 2e-3, run.states[:, [0, 2]], np.zeros((1, 1)))
    >>> problem = Problem(rig, (swing,), {"lambda": Free(1.0, 0.5, 1.2), "mu": Free(1.0, 0.5, 1.2)},
    ...                   initial_state="held")
    >>> problem.names
    ('lambda', 'mu')
    >>> problem.cost(np.array([0.9, 0.95])) < 1e-9 < problem.cost(np.array([1.0, 1.0]))
    True
    """

    model: Model
    experiments: tuple[Experiment, ...]
    orders: Mapping[str, Value]
    """One per order's name: a number is fixed."""
    parameters: Mapping[str, Value] = field(default_factory=dict)
    """Those that differ from the model's own values: a number is fixed."""
    per_recording: tuple[str, ...] = ()
    """Names of free parameters that each recording has for itself."""
    cost_function: Cost = COSTS["rmse"]
    outputs: tuple[str, ...] = EVERY
    initial_state: InitialState = "estimate"
    method: str = "pi2"
    memory: Memory = compressed()  # noqa: RUF009 (frozen)
    substeps: int = 1
    """Steps per sample of the recording."""
    weights: Weights = "equal"
    """``equal``: a radian of error counts the same in every output; ``noise``: against its output's own level."""
    memo: Memo | None = field(default=None, repr=False, compare=False)
    """Has what was simulated before, and keeps what will be."""

    def __post_init__(self) -> None:
        """Check names, bounds and options."""
        if self.outputs is EVERY:
            object.__setattr__(self, "outputs", tuple(self.model.outputs))
        _check_ties(self)
        self.model.parameter_vector(self.parameter_starts)
        self.model.state_orders(self.order_starts)
        _check_bounds(self)
        _check_outputs(self)
        _check_experiments(self)
        check_choice("initial_state", self.initial_state, get_args(InitialState))
        check_choice("method", self.method, METHODS)
        check_choice("weights", self.weights, get_args(Weights))
        _check_likelihood(self)
        if not isinstance(self.substeps, int) or self.substeps < 1:
            raise InputError(f"substeps = {self.substeps!r}; expected a whole number, 1 or more.")

    # --- values and ties ---------------------------------------------------------------------------

    @cached_property
    def order_starts(self) -> dict[str, float]:
        """Every order where the search starts, fixed and tied ones too."""
        roots = {n: root_of("order", n, self.orders) for n in self.orders}
        return {n: start_of(self.orders[root]) for n, root in roots.items() if root in self.orders}

    @cached_property
    def parameter_starts(self) -> dict[str, float]:
        """Each of `parameters` where the search starts, fixed and tied ones too [SI]."""
        own = {p.name: p.value for p in self.model.parameters}
        return {
            n: start_of((own | {**self.parameters})[root_of("parameter", n, self.parameters)]) for n in self.parameters
        }

    @cached_property
    def ties(self) -> dict[str, str]:
        """Each tied order and parameter with the one that it follows in the end, which is tied to none."""
        return {
            n: root_of(what, n, values)
            for what, values in (("order", self.orders), ("parameter", self.parameters))
            for n, v in values.items() if isinstance(v, Tied)
        }  # fmt: skip

    @cached_property
    def own_parameters(self) -> tuple[str, ...]:
        """The parameters that each recording has for itself: those of `per_recording`, and what is tied to them."""
        return (*self.per_recording, *(n for n, root in self.ties.items() if root in self.per_recording))

    @cached_property
    def aliases(self) -> dict[str, str]:
        """By what name a result calls a tied value, and the unknown that it is: ``{"mu": "lambda"}``."""
        return {
            n if u.experiment is None else f"{n} [{u.experiment}]": u.name
            for n, root in self.ties.items() for u in self.unknowns
            if u.target == root and u.kind == ("order" if n in self.orders else "parameter")
        }  # fmt: skip

    # --- the unknowns ------------------------------------------------------------------------------

    @cached_property
    def unknowns(self) -> tuple[Unknown, ...]:
        """The entries of x, in order."""
        units = {p.name: p.unit for p in self.model.parameters}
        shared = [Unknown(n, "", "order", n, None, v) for n, v in self.orders.items() if isinstance(v, Free)]
        own = []
        for name, value in self.parameters.items():
            if isinstance(value, Free) and name not in self.per_recording:
                shared.append(Unknown(name, units[name], "parameter", name, None, value))
        for e in self.experiments:
            for name in self.per_recording:
                value = self.parameters[name]
                assert isinstance(value, Free)
                own.append(Unknown(f"{name} [{e.name}]", units[name], "parameter", name, e.name, value))
            own += self._initial_unknowns(e)
            if isinstance(e.release_time, Free):
                own.append(Unknown(f"release_time [{e.name}]", "s", "time", "release_time", e.name, e.release_time))
        return (*shared, *own)

    def _initial_unknowns(self, e: Experiment) -> list[Unknown]:
        if self.initial_state in ("measured", "held"):
            return []
        guess = self._initial_guess(e).tolist()
        units = {self.model.outputs[n]: e.units.get(n, "rad") for n in self.outputs}
        sizes = dict(zip(units, self._sizes(e).tolist(), strict=True))
        reach = {i: (0.2 * sizes[i], unit) for i, unit in units.items()}
        if self.initial_state == "estimate":
            reach |= {j: (3.0 * sizes[i] + abs(guess[j]), f"{units[i]}/s") for i, j in self._rates.items()}
        found = []
        for i, (width, unit) in sorted(reach.items()):
            state = self.model.states[i]
            if state not in e.initial:
                around = Free(guess[i], guess[i] - width, guess[i] + width)
                found.append(Unknown(f"{state}(0) [{e.name}]", unit, "initial", state, e.name, around))
        return found

    def _sizes(self, e: Experiment) -> FloatArray:
        """The greatest value of each output where that is no angle, else 1; shape (n_outputs,).

        Ranges and limits that are made for angles count in it: a pressure of 10⁵ Pa has not run away.
        """
        greatest = np.max(np.abs(e.measured), axis=0, initial=0.0)
        angle = np.array([e.units.get(n, "rad") == "rad" for n in self.outputs]) & (greatest <= TURNS)
        return np.where(angle, 1.0, np.maximum(greatest, 1.0))

    @cached_property
    def _limits(self) -> dict[str, float]:
        """Recording → the state beyond which a run has diverged."""
        return {e.name: LIMIT * float(np.max(self._sizes(e), initial=1.0)) for e in self.experiments}

    @cached_property
    def _rates(self) -> dict[int, int]:
        """For each scored output's state i the state j with D^q x_i = x_j, found by asking the right-hand side."""
        n = len(self.model.states)
        x, out = np.linspace(0.1, 0.2, n), np.full(n, np.nan)  # no value twice
        try:
            with np.errstate(all="ignore"):
                rhs = getattr(self.model.rhs, "py_func", self.model.rhs)
                rhs(0.0, x, np.zeros(len(self.model.inputs)), self.model.parameter_vector(), out)
        except ArithmeticError:
            return {}
        except Exception as error:
            raise InputError(
                f"The right-hand side of {self.model.name} fails: {type(error).__name__}: {error}. x and out have {n} "
                f"entries, u has {len(self.model.inputs)}, p has {len(self.model.parameters)}."
            ) from error
        return {self.model.outputs[o]: j for o in self.outputs for j in range(n) if out[self.model.outputs[o]] == x[j]}

    def _initial_guess(self, e: Experiment) -> FloatArray:
        """The state at the start as measured: outputs, and the slopes for their rates."""
        x0 = np.zeros(len(self.model.states))
        values, slopes = e.first_values()
        for name, value, slope in zip(self.outputs, values, slopes, strict=True):
            i = self.model.outputs[name]
            x0[i] = value
            if self.initial_state in ("estimate", "measured") and i in self._rates:
                x0[self._rates[i]] = slope
        if e.past is not None:
            orders, values = (
                self.model.state_orders(self.order_starts),
                self.model.parameter_vector(self.parameter_starts),
            )
            x0 = self._past_states(e, orders, values)[-1].copy()
        for name, value in e.initial.items():
            x0[self.model.states.index(name)] = value
        return x0

    def _past_states(self, e: Experiment, orders: FloatArray, values: FloatArray) -> FloatArray:
        """The states from the release in the past to the start, `substeps` a sample, shape (n, n_states)."""
        return self._past_of(e.name, tuple(orders.tolist()), time_scale(self.model, values))

    @cached_property
    def _past_of(self) -> Callable[[str, tuple[float, ...], float], FloatArray]:
        pasts = {e.name: e.smooth_past(self.substeps) for e in self.experiments if e.past is not None}
        steps = {e.name: e.step / self.substeps for e in self.experiments}

        @lru_cache(maxsize=32)  # the orders stay while a search tries the constants
        def states(name: str, orders: tuple[float, ...], unit: float) -> FloatArray:
            angles, release = pasts[name]
            past = np.zeros((len(angles), len(orders)))
            for o, signal in zip(self.outputs, angles.T, strict=True):
                i = self.model.outputs[o]
                past[:, i] = signal
                rise = derivative(signal - signal[0], orders[i], steps[name], kind="rl")  # at rest before
                past[1:, self._rates[i]] = unit ** (orders[i] - 1) * rise[1:]
            return past[release:]

        return states

    @property
    def rates(self) -> Mapping[int, int]:
        """For each scored output's state i the state j with D^q x_i = x_j."""
        return self._rates

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns."""
        return tuple(u.name for u in self.unknowns)

    @property
    def order_indices(self) -> tuple[int, ...]:
        """Which of the unknowns are orders."""
        return tuple(i for i, u in enumerate(self.unknowns) if u.kind == "order")

    @property
    def start(self) -> FloatArray:
        """Where the search starts, shape (n_unknowns,)."""
        return np.array([u.range.start for u in self.unknowns])

    @property
    def space(self) -> Space:
        """The unknowns with their bounds, for an optimiser."""
        lower, upper = (np.array([getattr(u.range, side) for u in self.unknowns]) for side in ("lower", "upper"))
        scale = np.array([math.nan if u.range.scale is None else u.range.scale for u in self.unknowns])
        return Space(self.names, lower, upper, self.start, None if np.all(np.isnan(scale)) else scale)

    # --- from x to trajectories --------------------------------------------------------------------

    def unpack(self, x: FloatArray, e: Experiment) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Orders per state, parameters and initial state of one recording, for the unknowns x."""
        orders, values, initial, _ = self._unpack(x, e)
        return orders, values, initial

    def release(self, x: FloatArray, e: Experiment) -> float:
        """When the motion of one recording begins [s]."""
        return float(self._unpack(x, e)[3][0])

    def _unpack(self, x: FloatArray, e: Experiment) -> list[FloatArray]:
        vectors = [v.copy() for v in self._fixed[e.name]]
        for value, unknown, (vector, where) in zip(x, self.unknowns, self._places, strict=True):
            if unknown.experiment in (None, e.name):
                vectors[vector][where] = value
        if e.past is not None and self.initial_state == "measured":
            rates = [j for j in self._rates.values() if self.model.states[j] not in e.initial]
            vectors[2][rates] = self._past_states(e, vectors[0], vectors[1])[-1, rates]
        return vectors

    @cached_property
    def _fixed(self) -> dict[str, tuple[FloatArray, ...]]:
        """For each recording what :meth:`_unpack` starts from: every value at its own start."""
        orders = self.model.state_orders(self.order_starts)
        values = self.model.parameter_vector(self.parameter_starts)
        return {
            e.name: (orders, values, self._initial_guess(e), np.array([start_of(e.release_time)]))
            for e in self.experiments
        }

    @cached_property
    def _places(self) -> tuple[tuple[int, list[int]], ...]:
        """Where each unknown goes: which of the vectors of :meth:`_unpack`, and its entries there."""
        kinds: dict[str, tuple[Any, ...]] = {
            "order": self.model.orders, "parameter": self.model.parameter_names, "initial": self.model.states,
            "time": ("release_time",),
        }  # fmt: skip
        return tuple(
            ([*kinds].index(u.kind), [i for i, n in enumerate(kinds[u.kind]) if self.ties.get(n, n) == u.target])
            for u in self.unknowns
        )

    @cached_property
    def _inputs(self) -> dict[str, FloatArray]:
        """Each recording's inputs on the grid of its steps, linear between samples."""

        def refined(u: FloatArray) -> FloatArray:
            if self.substeps == 1 or len(u) == 1:
                return np.ascontiguousarray(u)
            at = np.arange((len(u) - 1) * self.substeps + 1) / self.substeps
            return np.column_stack([np.interp(at, np.arange(len(u)), column) for column in u.T])

        return {e.name: refined(e.all_inputs)[self._from(e) :] for e in self.experiments}

    def _from(self, e: Experiment) -> int:
        """The step of the past with which the memory begins."""
        return 0 if e.past is None or len(e.all_inputs) == 1 else e.release_in_past() * self.substeps

    def simulate(self, x: FloatArray, e: Experiment) -> Trajectory:
        """Simulate one recording with the unknowns x, from its release on, on its grid divided by `substeps`."""
        orders, values, initial, (release,) = self._unpack(x, e)
        step = e.step / self.substeps
        steps = (len(e.measured) - 1) * self.substeps + self._more_steps(e)
        inputs = self._inputs_from(release, steps, e)
        past = None if e.past is None else self._past_states(e, orders, values)[:-1]
        return integrate(
            Equation(compile_rhs(self.model.rhs), orders, inputs, values, time_scale(self.model, values)),
            InitialCondition(initial, time=float(release), history=past),
            step,
            steps,
            Options(self.method, self.memory, limit=self._limits[e.name]),
        )

    def history(self, x: FloatArray, e: Experiment) -> FloatArray | None:
        """The states before the start of one recording, as :func:`fracid.simulate` takes them; None without a past."""
        return None if e.past is None else self._past_states(e, *self._unpack(x, e)[:2])[:-1]

    def _more_steps(self, e: Experiment) -> int:
        """Steps beyond the samples: a run from any release reaches the last, and all have the same memory."""
        earliest = e.release_time.lower if isinstance(e.release_time, Free) else e.release_time
        return math.ceil(max(0.0, -earliest) * self.substeps / e.step)

    def _inputs_from(self, release: float, steps: int, e: Experiment) -> FloatArray:
        """The inputs on the grid of a run from `release`; before the first and after the last sample they stay."""
        u = self._inputs[e.name]
        if len(u) == 1 or e.release_time == 0.0:
            return u
        at = release * self.substeps / e.step + np.arange(steps + 1)
        return np.column_stack([np.interp(at, np.arange(len(u)), column) for column in u.T])

    def fitted(self, x: FloatArray, e: Experiment) -> FloatArray | str:
        """Simulated outputs [rad], shape (n_samples, n_outputs), or why there are none."""
        if self.memo is None:
            return self._fitted(x, e)
        return self.memo.get(self._key(x, e), lambda: self._fitted(x, e))

    def _fitted(self, x: FloatArray, e: Experiment) -> FloatArray | str:
        run = self.simulate(x, e)
        if not run.completed:
            return f"{e.name}: {run.outcome.value} at t = {run.time[-1]:.4g} s"
        columns = [self.model.outputs[n] for n in self.outputs]
        if e.release_time == 0.0:
            return run.states[:: self.substeps, columns]
        moving = e.time >= run.time[0]
        held = np.repeat(run.states[:1, columns], np.count_nonzero(~moving), axis=0)
        return np.vstack([held, run.at(e.time[moving])[:, columns]])

    def _key(self, x: FloatArray, e: Experiment) -> bytes:
        """A hash of all that the simulation of one recording depends on."""
        found = self._stays[e.name].copy()
        found.update(repr((len(e.measured), e.step, e.release_time)).encode())
        for vector in self._unpack(x, e):
            found.update(np.ascontiguousarray(vector).data)
        return bytes(found.digest())

    @cached_property
    def _stays(self) -> dict[str, Any]:
        """For each recording the hash of what no unknown changes."""
        model, rhs = self.model, getattr(self.model.rhs, "py_func", self.model.rhs)
        how = (model.name, model.zero, model.source, rhs.__module__, rhs.__qualname__, rhs.__code__.co_code,
               self.outputs, self.method, self.memory.name, self.substeps, self.initial_state)  # fmt: skip
        found = {}
        for e in self.experiments:
            arrays = [self._inputs[e.name], *([] if e.past is None else [e.past, e.measured])]
            found[e.name] = blake2b(repr((how, [a.shape for a in arrays])).encode(), digest_size=16)
            for array in arrays:
                found[e.name].update(np.ascontiguousarray(array).data)
        return found

    # --- what counts -------------------------------------------------------------------------------

    def residuals(self, x: FloatArray) -> FloatArray:
        """Rows whose squares the least-squares engine adds up; see :class:`fracid.problem.costs.Cost`.

        Raises
        ------
        InputError
            If the run fails, or the cost is a user's own.
        """
        evaluation = self.evaluate(x)
        if evaluation.residuals is None:
            reason = evaluation.reason or "it is a user's own"
            raise InputError(f"The cost {self.cost_function.name!r} has no residuals here: {reason}.")
        return evaluation.residuals

    def cost(self, x: FloatArray) -> float:
        """𝓛(x) of (25), joined over the recordings; infinite where a run diverges."""
        return self.evaluate(x).cost

    def errors(self, x: FloatArray) -> list[FloatArray] | str:
        """Measured minus simulated of each recording [rad], shape (n_samples, n_outputs), or why there is none."""
        found = []
        for e in self.experiments:
            fitted = self.fitted(x, e)
            if isinstance(fitted, str):
                return fitted
            found.append(e.measured - fitted)
        return found

    def evaluate(self, x: FloatArray) -> Evaluation:
        """Cost, residuals and, where the cost is infinite, the reason."""
        errors = self.errors(x)
        if isinstance(errors, str):
            return Evaluation(x, np.inf, None, errors)
        levels = self._costs_by_output(errors)
        cost = self._joined([self.cost_function.value(e.time, r) for e, r in self._pairs(errors)])
        if levels is not None and math.isfinite(cost):
            cost = float(np.exp(np.mean(np.log(levels)))) * (1 if self.cost_function.root else len(levels))
        rows = self._rows(x, errors, levels) if math.isfinite(cost) else None
        return Evaluation(x, cost * self._prior_factor(x), rows)

    def _pairs(self, errors: list[FloatArray]) -> list[tuple[Experiment, FloatArray]]:
        return list(zip(self.experiments, errors, strict=True))

    def _joined(self, costs: list[float]) -> float:
        """Join the recordings' costs, each by its weight."""
        weights = [e.weight for e in self.experiments]
        counts: list[Any] = [w * len(e.measured) for w, e in zip(weights, self.experiments, strict=True)]
        root = self.cost_function.root
        return self.cost_function.join([c if root else w * c for w, c in zip(weights, costs, strict=True)], counts)

    def shares(self) -> list[float]:
        """What each recording's rows are multiplied with, so that their squares add up as its cost does."""
        samples = [e.weight * len(e.measured) for e in self.experiments]
        if self.cost_function.root:
            return [math.sqrt(n / sum(samples)) for n in samples]
        return [math.sqrt(e.weight) for e in self.experiments]

    # --- levels and priors -------------------------------------------------------------------------

    def balance(self, errors: list[FloatArray]) -> FloatArray:
        """By what the squares of each output count, shape (n_outputs,): 1, but (G/C_o)² with ``weights = "noise"``.

        Multiply a loss's weights with it, wherever they are not taken from :attr:`Evaluation.residuals`.
        """
        levels = self._costs_by_output(errors)
        if levels is None:
            return np.ones(len(self.outputs))
        relative = np.exp(np.mean(np.log(levels))) / levels
        return np.asarray(relative**2 if self.cost_function.root else relative)

    def levels(self, x: FloatArray) -> dict[str, float]:
        """The level of each output's residual, rms [rad]; infinite where a run fails."""
        errors = self.errors(x)
        if isinstance(errors, str):
            return dict.fromkeys(self.outputs, math.inf)
        squares = sum(s**2 * np.mean(e**2, axis=0) for s, e in zip(self.shares(), errors, strict=True))
        whole = sum(s**2 for s in self.shares())
        return dict(zip(self.outputs, np.sqrt(squares / whole).tolist(), strict=True))

    def _costs_by_output(self, errors: list[FloatArray]) -> FloatArray | None:
        """C_o of each output alone, at least that of its encoder's rounding; None where all count the same."""
        if self.weights == "equal":
            return None
        costs = [
            self._joined([self.cost_function.value(e.time, r[:, [o]]) for e, r in self._pairs(errors)])
            for o in range(len(self.outputs))
        ]
        return np.asarray(np.hypot(costs, self._floor) if self.cost_function.root else costs + self._floor)

    @cached_property
    def _floor(self) -> FloatArray:
        """C_o of a residual of q/√12, q the step of the output's encoder, shape (n_outputs,)."""
        steps = [max(resolution(e.measured[:, o]) or 0.0 for e in self.experiments) for o in range(len(self.outputs))]
        rounding = np.maximum(np.array(steps) / math.sqrt(12.0), FINEST)
        return np.array([
            self._joined([self.cost_function.value(e.time, np.full((len(e.measured), 1), r)) for e in self.experiments])
            for r in rounding
        ])  # fmt: skip

    def _rows(self, x: FloatArray, errors: list[FloatArray], levels: FloatArray | None) -> FloatArray | None:
        """Rows for least squares: the samples', with ``noise`` one for each output's floor, one for each prior."""
        found = [self.cost_function.rows(e.time, r) for e, r in self._pairs(errors)]
        rows = [share * r for share, r in zip(self.shares(), found, strict=True) if r is not None]
        if not rows:
            return None
        if levels is not None:
            balance = np.sqrt(self.balance(errors))
            rows = [(r.reshape(-1, len(balance)) * balance).ravel() for r in rows]
            rows.append(balance * (self._floor if self.cost_function.root else np.sqrt(self._floor)))
        if self._priors:
            total = sum(float(np.sum(r**2)) for r in rows)
            rows.append(math.sqrt(total / self.prior_samples) * self.prior_residuals(x))
        return np.concatenate(rows)

    @cached_property
    def _priors(self) -> dict[int, Prior]:
        """Unknown → its prior."""
        return {i: u.range.prior for i, u in enumerate(self.unknowns) if u.range.prior is not None}

    def prior_residuals(self, x: FloatArray) -> FloatArray:
        """z = (x − mean)/sd of the unknowns that have a prior, shape (n_priors,)."""
        return np.array([(x[i] - prior.mean) / prior.sd for i, prior in self._priors.items()])

    @cached_property
    def prior_samples(self) -> float:
        """By what Σz² is divided: n for normal errors, as often as the likelihood of the loss says."""
        n = sum(e.weight * e.measured.size for e in self.experiments)
        return n if self.cost_function.loss is None else self.cost_function.loss.likelihood_factor * n

    def _prior_factor(self, x: FloatArray) -> float:
        if not self._priors:
            return 1.0
        factor = 1 + float(np.sum(self.prior_residuals(x) ** 2)) / self.prior_samples
        return math.sqrt(factor) if self.cost_function.root else factor

    # --- variants ----------------------------------------------------------------------------------

    def until(self, horizon: float) -> Problem:
        """The same problem on the first `horizon` seconds of each recording."""
        return replace(self, experiments=tuple(e.until(horizon) for e in self.experiments))

    def with_shared(self, x: FloatArray, experiments: tuple[Experiment, ...]) -> Problem:
        """Fix all that is shared at its value in x, and leave to other recordings what is theirs.

        For validation: initial states and `per_recording` parameters are found again, nothing else.
        """
        shared = {u.target: v for u, v in zip(self.unknowns, x.tolist(), strict=True) if u.experiment is None}
        kept = (*self.per_recording, *self.ties)
        orders = {n: v if n in kept else shared.get(n, start_of(v)) for n, v in self.orders.items()}
        parameters = {n: v if n in kept else shared.get(n, start_of(v)) for n, v in self.parameters.items()}
        return replace(self, orders=orders, parameters=parameters, experiments=experiments)


def _check_ties(problem: Problem) -> None:
    """A tie goes to a known name of the same kind and unit, and in no circle."""
    known = {"order": problem.model.order_names, "parameter": problem.model.parameter_names}
    for what, values in (("order", problem.orders), ("parameter", problem.parameters)):
        for name, value in values.items():
            if isinstance(value, Tied) and value.to not in known[what]:
                raise unknown_name(f"{what} that {name} is tied to", value.to, known[what])
            root = root_of(what, name, values)
            if what == "parameter":
                units = [problem.model.parameter(n).unit for n in (name, root)]
                if units[0] != units[1]:
                    raise InputError(
                        f"{name} [{units[0]}] cannot be tied to {root} [{units[1]}]: tie what has the same unit."
                    )


def _check_bounds(problem: Problem) -> None:
    """Orders stay within (0, 2), parameters where the model means something, also those tied to a free one."""
    for name, value in problem.orders.items():
        if not isinstance(value, Tied):
            low, high = (value.lower, value.upper) if isinstance(value, Free) else (value, value)
            if not 0 < low <= high < 2:
                raise InputError(f"{name} = {low:g} … {high:g}: an order must lie strictly between 0 and 2.")
    for name in problem.parameters:
        p, free = problem.model.parameter(name), problem.parameters.get(problem.ties.get(name, name))
        whose = f"{problem.ties[name]}'s" if name in problem.ties else "its"
        if isinstance(free, Free) and not p.lower <= free.lower < free.upper <= p.upper:
            raise InputError(
                f"{name} is free in {free.lower:g} … {free.upper:g} {p.unit}, but means something only in "
                f"{p.lower:g} … {p.upper:g}: bring {whose} lower and upper into that."
            )
    for name in problem.per_recording:
        if name in problem.ties:
            raise InputError(f"per_recording names {name!r}, which is tied: name {problem.ties[name]!r} instead.")
        if not isinstance(problem.parameters.get(name), Free):
            raise InputError(
                f"per_recording names {name!r}, which is not free; "
                f"type {name} = {{ start = ..., lower = ..., upper = ... }} among the parameters."
            )


def _check_likelihood(problem: Problem) -> None:
    """Levels and priors are weighed by the errors' likelihood, which a user's own cost does not tell."""
    ranges = [*problem.orders.values(), *problem.parameters.values(), *(e.release_time for e in problem.experiments)]
    prior = any(isinstance(v, Free) and v.prior is not None for v in ranges)
    what = "a prior" if prior else 'weights = "noise"' if problem.weights == "noise" else ""
    if what and problem.cost_function.loss is None:
        raise InputError(
            f"{what} has no place beside the cost {problem.cost_function.name!r}, a user's own, of unknown likelihood: "
            f"take one of {', '.join(COSTS)}, or leave it out."
        )


def _check_outputs(problem: Problem) -> None:
    if not problem.outputs:
        raise InputError(f"outputs is empty: score at least one of {', '.join(problem.model.outputs)}.")
    for name in problem.outputs:
        check_choice("output", name, problem.model.outputs)


def _check_past(problem: Problem, e: Experiment) -> None:
    """A past is a motion from rest on, of which every state is known."""
    if e.past is None:
        return
    if e.past.ndim != 2 or e.past.shape[1] != len(problem.outputs) or not len(e.past):
        raise InputError(
            f"{e.name}: past has the shape {e.past.shape}; expected (n_past, {len(problem.outputs)}), the outputs "
            f"{', '.join(problem.outputs)} before the first sample."
        )
    if not np.all(np.isfinite(e.past)) or (e.past_inputs is not None and not np.all(np.isfinite(e.past_inputs))):
        raise InputError(f"{e.name}: a sample of its past is not a finite number; leave such samples out or fill them.")
    known = {problem.model.outputs[o] for o in problem.outputs}
    unknown = set(range(len(problem.model.states))) - known - {j for i, j in problem._rates.items() if i in known}
    if unknown:
        names = ", ".join(problem.model.states[i] for i in sorted(unknown))
        raise InputError(
            f"{e.name}: its past does not tell {names}; a past needs every angle among the outputs, which are "
            f"{', '.join(problem.outputs)}."
        )
    if problem.initial_state not in ("estimate", "measured"):
        raise InputError(
            f"{e.name} has a past, so it starts in motion, but initial_state is {problem.initial_state!r}, a start at "
            'rest; type initial_state = "estimate" (or "measured"), or leave the past out.'
        )


def _check_release(problem: Problem, e: Experiment) -> None:
    """A release lies within the recording, and what moves already cannot be released."""
    if e.release_time == 0.0:
        return
    free = isinstance(e.release_time, Free)
    ends = (e.release_time.lower, e.release_time.upper) if isinstance(e.release_time, Free) else (e.release_time,) * 2
    if not -e.time[-1] / 2 <= ends[0] <= ends[1] <= e.time[-1] / 2:
        raise InputError(
            f"{e.name}: release_time = {' … '.join(f'{v:g}' for v in dict.fromkeys(ends))} s; expected within half of "
            f"the recording's {e.time[-1]:g} s, counted from its first sample."
        )
    if problem.initial_state not in ("rest", "held"):
        raise InputError(
            f"{e.name}: a release_time{' that is free' if free else ''} needs a start at rest, but initial_state is "
            f'{problem.initial_state!r}, a start in motion; type initial_state = "rest" (or "held").'
        )


def _check_experiments(problem: Problem) -> None:
    """At least one, each with its own name, a column an output, and enough samples."""
    if not problem.experiments:
        raise InputError("A problem needs at least one recording.")
    refuse_twins(problem.experiments)
    for e in problem.experiments:
        if e.measured.ndim != 2 or e.measured.shape[1] != len(problem.outputs) or len(e.measured) < 3:
            raise InputError(
                f"{e.name}: measured has the shape {e.measured.shape}; expected at least 3 samples of "
                f"{len(problem.outputs)} outputs: {', '.join(problem.outputs)}."
            )
        _check_past(problem, e)
        _check_release(problem, e)
        if not (math.isfinite(e.weight) and e.weight > 0):
            raise InputError(
                f"{e.name}: weight = {e.weight:g}; expected a number above 0.  A recording that must not count is "
                'left out, or validates: use = "validate".'
            )
        if not np.all(np.isfinite(e.measured)) or not np.all(np.isfinite(e.inputs)):
            raise InputError(f"{e.name}: a sample is not a finite number; leave such samples out or fill them.")
