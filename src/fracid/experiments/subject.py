"""What a design is about: a model with its values, the noise of its sensors, and what has been recorded already.

====================  =============================================================================================
from                  values, noise, and what is recorded
====================  =============================================================================================
a fit, a saved run    the values as fitted; the noise of the residuals; the information of its recordings
a project             the same, after a search
a model               its constants as they are, encoders of 4096 counts with a tenth of a count of noise; nothing
====================  =============================================================================================

The noise of an output is that of its encoder where rounding and white noise explain the residual, or a quarter of its
power at least: of one recording that rests, the unknown edge of a count leaves as much.  Else it is the
residual's own level, and since residuals of that kind are correlated, the information about each parameter is divided
by the ratio of its samples to its effective samples (:attr:`fracid.estimation.covariance.Uncertainty`).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from fracid.arrays import ByName, FloatArray
from fracid.errors import Failure, InputError, refuse_unknown
from fracid.estimation.covariance import Uncertainty, uncertainty
from fracid.estimation.derivatives import differences
from fracid.estimation.rounding import encoder_noise
from fracid.experiments.information import Information, Noise, of_samples
from fracid.experiments.space import SPEED, Candidate, DesignSpace
from fracid.findings import Words
from fracid.models import Model, Parameter
from fracid.models.rigs import CLAMPED
from fracid.problem import Experiment, Free, Problem, Tied
from fracid.problem.unknowns import Unknown, Value
from fracid.solver.inputs import Between
from fracid.units import GREEK

SAYS = Words("experiments/subject.toml")

COUNTS, QUIET = 4096, 0.1
"""Of an encoder of which nothing is known: counts a turn, and noise in counts."""

FINE = 1e-3
"""Step of a mechanical model of which no fit has chosen one [s]; of others a step is a sample."""

VAGUE = 100.0
"""Standard deviation, in typical sizes, of what nothing is known of: it keeps a curvature from being singular."""

V = TypeVar("V", bound=Value)

WIDE = 10.0
"""A constant of a model is free from this part of its value to so many times it."""


@dataclass(frozen=True)
class Subject:
    """What is to be determined, and what is known of it."""

    problem: Problem
    """Every free value starts where it is; its first recording, the longest as fitted, is the pattern of the next."""
    noise: Mapping[str, Noise]
    """Output → its noise."""
    excess: FloatArray
    """By what the variance of each shared value exceeds that of white noise, shape (n_shared,)."""
    step: float
    """Largest step of the solver [s]."""
    recorded: Information
    """About the shared values, of what has been recorded."""
    intervals: Mapping[str, tuple[float, float]]
    """95 % intervals as the run states them."""
    name: str
    """What the plan is for, in words."""
    table: Mapping[str, Any]
    """The project file's table ``model``, its list ``recording`` and its folder ``home``, as far as there is one."""
    space: DesignSpace
    """What can be done on it."""
    jobs: int = 1
    """Threads that work on it."""

    @cached_property
    def shared(self) -> tuple[Unknown, ...]:
        """The free values that all experiments share."""
        return tuple(u for u in self.problem.unknowns if u.experiment is None)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(u.name for u in self.shared)

    @cached_property
    def scale(self) -> FloatArray:
        """Typical size of each, shape (n_shared,)."""
        sizes = self.problem.named(self.problem.space.sizes(self.problem.start))
        return np.array([sizes[n] for n in self.names])

    @property
    def outputs(self) -> tuple[str, ...]:
        """What is recorded."""
        return tuple(self.space.sensors) or self.problem.outputs

    def unit(self, output: str) -> str:
        """That of an output as recorded, or else the model's."""
        return self.problem.experiments[0].units.get(output, self.problem.model.output_unit(output))

    def begins_as_recorded(self, c: Candidate) -> bool:
        """Whether it begins where the pattern did: what is not released, and is no pendulum, which hangs or stands."""
        return not (c.release or self.problem.model.pendulum)

    def initial(self, c: Candidate) -> dict[str, float | Free]:
        """What is said of states at the start, as of the pattern; of those not measured where that began elsewhere."""
        model, initial = self.problem.model, self.problem.experiments[0].initial
        shown = {i for n in self.outputs if (i := model.output_states.get(n)) is not None}
        shown |= {model.rates[i] for i in shown & model.rates.keys()}
        return {n: v for n, v in initial.items() if self.begins_as_recorded(c) or model.states.index(n) not in shown}

    @cached_property
    def worth(self) -> float:
        """What a squared residual counts beside that of white noise."""
        return 1 / float(np.exp(np.mean(np.log(self.excess))))

    def known(self, vague: float) -> Information:
        """What is known now, next to nothing of the rest: a standard deviation of so many typical sizes."""
        little = np.diag((vague * self.scale) ** -2.0)
        return self.recorded + Information(little, little)

    def places(self, names: Sequence[str]) -> tuple[int, ...]:
        """Where some of the shared values are.

        Raises
        ------
        InputError
            For a name that is no free value.
        """
        names = [next((n for n in self.names if name in (n, GREEK.get(n))), name) for name in names]
        for name in names:
            if name not in self.names:
                fixed = name in (*self.problem.orders, *self.problem.model.parameter_names)
                what = f"{name} is fixed, at a bound, or of one recording alone" if fixed else f"there is no {name!r}"
                raise InputError(f"{what}; the design can narrow {', '.join(self.names)}.")
        return tuple(self.names.index(n) for n in names)

    def at(self, values: Mapping[str, float]) -> Subject:
        """The same rig with other values of some of what is free and of orders, within bounds that hold them."""
        return replace(self, problem=_starting_at(self.problem, values))

    def noise_of(self, output: str) -> Noise:
        """The noise of an output; that of a sensor that is added is the largest of the others."""
        return self.noise.get(output) or max(self.noise.values(), key=lambda n: n.variance)

    # --- one experiment ------------------------------------------------------------------------------

    def _inputs(self, c: Candidate, time: FloatArray) -> tuple[FloatArray, dict[str, Between]]:
        """What is played is held between samples, or a line where its rate is an input too."""
        model, played = self.problem.model, driven(self.problem)
        if c.voltage is None:
            return np.zeros((1, max(1, len(model.inputs)))), {}
        signals = {played: self.space.applied(c.voltage, time)}
        slopes = np.diff(signals[played]) * c.rate
        rates = [rate for rate, of in model.input_rates.items() if of == played]
        signals |= dict.fromkeys(rates, np.append(slopes, slopes[-1:]))
        columns = [signals.get(n, np.full(len(time), model.input_defaults.get(n, 0.0))) for n in model.inputs]
        between: dict[str, Between] = dict.fromkeys(model.inputs, "hold")
        return np.column_stack(columns), between | ({played: "line"} if rates else {})

    def problem_of(self, c: Candidate) -> Problem:
        """The problem of the recording that a candidate would give, alone, every free value at its own.

        Its samples are not there yet: they stay where they begin.
        """
        p, space, pattern = self.problem, self.space, self.problem.experiments[0]
        first = np.array([self._first_value(n, c) for n in self.outputs])
        inputs, between = self._inputs(c, np.arange(c.samples) / c.rate)
        known = zip(self.outputs, first.tolist(), strict=True) if space.initial_state == "held" else ()
        indices = p.model.output_states
        initial = self.initial(c) | {p.model.states[indices[n]]: v for n, v in known if n in indices}
        moment = space.moment if c.release else 0.0
        e = Experiment(
            "planned", 1 / c.rate, np.tile(first, (c.samples, 1)), inputs, initial=initial,
            constants={**pattern.constants, **dict(c.constants)}, units=pattern.units, sensors=pattern.sensors,
            actuators=pattern.actuators, between=between, release_time=Free(0.0, -moment, moment) if moment else 0.0,
        )  # fmt: skip
        clamped = {"J_theta": CLAMPED} if c.arm == "clamped" else {}
        return replace(
            p, outputs=self.outputs, memo=None, experiments=(e,), parameters={**p.parameters, **clamped},
            substeps=max(1, math.ceil(1 / c.rate / self.step - 1e-9)), initial_state=space.initial_state,
        )  # fmt: skip

    def _first_value(self, output: str, c: Candidate) -> float:
        """Where an output begins: at rest, the released one that far from it; of no pendulum where the pattern did."""
        model, outputs, pattern = self.problem.model, self.problem.outputs, self.problem.experiments[0]
        if self.begins_as_recorded(c) and output in outputs:
            return float(pattern.measured[0, outputs.index(output)])
        upright = output == model.pendulum and model.zero == "upright"
        rest = self.problem.parameter_starts.get(model.rest_of(output), 0.0)
        return rest + (math.pi if upright else 0.0) + math.radians(c.release) * (output == self.released)

    @property
    def released(self) -> str:
        """The output that is released: the pendulum, or else the last that is a state."""
        model = self.problem.model
        return model.pendulum or next(reversed(model.output_states), "")

    def check(self) -> None:
        """Refuse what this rig cannot do.

        Raises
        ------
        InputError
        """
        model, space = self.problem.model, self.space
        refuse_unknown("sensor", model.outputs, *space.sensors)
        refuse_unknown("output in limits", self.outputs, *(name.removesuffix(SPEED) for name in space.limits))
        for name in space.constants:
            model.parameter(name)
            if isinstance(self.problem.parameters.get(name), Free | Tied):
                raise InputError(SAYS("not-set", name=name))
        if any(u is not None for u in space.voltages) and not model.inputs:
            raise InputError(f"voltage: nothing drives the model {model.name}; leave it out.")
        if any(u is not None for u in space.voltages) and model.drive:
            gain = self.problem.parameter_starts.get(model.drive, model.parameter(model.drive).value)
            if gain == 0.0:
                raise InputError(SAYS("no-drive", model=model))
        if any(c.arm == "clamped" for c in space.candidates) and "J_theta" not in model.parameter_names:
            raise InputError(f"arm = 'clamped' is of a rotary pendulum; the model {model.name} has no arm.")
        if any(space.angles) and not self.released:
            raise InputError(f"release: the model {model.name} has no output that is a state; leave it out.")


def longest(problem: Problem) -> int:
    """Which experiment is the longest recording of a problem, or the first window of it.

    Examples
    --------
    >>> import fracid
    >>> logs = [Experiment(f"{n}", 0.1, np.zeros((n, 1)), np.zeros((1, 1))) for n in (5, 9, 7)]
    >>> longest(Problem(fracid.model("pendulum"), tuple(logs), {"mu": 1.0}))
    1
    """
    _, windows = max(problem.recordings.values(), key=lambda recording: float(recording[0].time[-1]))
    return int(windows.start)


def driven(problem: Problem) -> str:
    """The input that drives the recordings, or the model's first; empty where it has none.

    Examples
    --------
    >>> import fracid
    >>> moves = np.outer(np.arange(3.0), [0, 0, 1, 0])
    >>> log = fracid.Experiment("log", 0.1, np.zeros((3, 1)), moves)
    >>> driven(fracid.Problem(fracid.model("joint"), (log,), {"mu": 1.0}))
    'goal'
    """
    for e in problem.experiments:
        for name, column in zip(problem.model.inputs, e.inputs.T, strict=False):
            if np.ptp(column) and name not in problem.model.input_rates:
                return name
    return next(iter(problem.model.inputs), "")


def subject_of_problem(
    problem: Problem, x: FloatArray, space: DesignSpace, *, precision: Uncertainty | Failure | None = None,
    name: str = "", table: Mapping[str, Any] | None = None, jobs: int = 1,
) -> Subject:  # fmt: skip
    """What a fit knows: its values, its noise, its recordings' information.

    Parameters
    ----------
    problem : Problem
    x : array, shape (n_unknowns,)
        Its minimum.
    space : DesignSpace
        Its `counts` and `noise` replace what the residuals show.
    precision : Uncertainty, optional
        Computed where it is not given.
    name : str
        What the plan is for.
    table : mapping, optional
        The project file's tables.
    jobs : int
        Threads.

    Raises
    ------
    InputError
        If the model's run fails there, nothing is free, or a recording has standard deviations of its own.
    """
    if any(e.deviation is not None for e in problem.experiments):
        raise InputError(SAYS("deviations"))
    precision = uncertainty(problem, x, jobs=jobs) if precision is None else precision
    J = differences(problem, x, np.arange(len(x)), jobs=jobs)
    if isinstance(precision, Failure) or isinstance(J, Failure):
        raise InputError(f"There is nothing to design with: {precision if isinstance(precision, Failure) else J}.")
    unknowns = problem.unknowns
    shared = np.array([u.experiment is None for u in unknowns]) & ~problem.absent(x)
    if not shared.any():
        raise InputError("No free value is shared by all recordings; free an order or a parameter in the project.")
    noise, encoder_alone = _noises(problem, J.errors, space)
    excess = np.ones(int(shared.sum())) if encoder_alone else _excess(precision)[shared]
    k = longest(problem)
    pattern, others = problem.experiments[k], problem.experiments[:k] + problem.experiments[k + 1 :]
    whose = None, pattern.name, pattern.recording.name
    values = {u.target: v for u, v in zip(unknowns, x.tolist(), strict=True) if u.experiment in whose}
    initial = {n: _moved(v, values.get(n)) for n, v in pattern.initial.items()}
    pattern = replace(pattern, measured=pattern.measured - J.errors[k], initial=initial)
    as_fitted = replace(problem, memo=None, experiments=(pattern, *others))
    held = {u.target for u, k in zip(unknowns, shared, strict=True) if u.experiment is None and not k}
    priors = np.diag([0.0 if u.prior is None else u.prior.sd**-2 for u, k in zip(unknowns, shared, strict=True) if k])
    recorded = Information(priors, priors)
    for e, error, j in zip(problem.experiments, J.errors, J.parts, strict=True):
        own = np.array([u.experiment == e.name for u in unknowns])
        fitted = e.measured - error
        recorded += of_samples(fitted, j[..., shared], j[..., own], [*noise.values()], weights=problem.weights,
                               excess=excess)  # fmt: skip
    intervals = {unknowns[k].name: interval for k in np.flatnonzero(shared).tolist()
                 if (interval := precision.interval(x, k)) is not None}  # fmt: skip
    return Subject(
        _starting_at(as_fitted, values, held), noise, excess, problem.experiments[0].step / problem.substeps,
        recorded=recorded, intervals=intervals, name=name or problem.model.name, table=table or {}, space=space,
        jobs=jobs,
    )  # fmt: skip


def subject_of_model(model: Model, space: DesignSpace, *, free: Sequence[str], orders: ByName | None) -> Subject:
    """What a rig's constants alone say, before any recording.

    Parameters
    ----------
    model : Model
    space : DesignSpace
    free : sequence of str
        The constants and orders that fits are to find; empty for all that friction, inertia and drive have, and every
        order.
    orders : mapping, optional
        Their values; an integer model's for those left out.

    Raises
    ------
    InputError
        For an unknown name, and where nothing is free.
    """
    values = {n: (orders or {}).get(n, float(model.integer_order(n) or 1.0)) for n in model.order_names}
    model.state_orders(values)
    names = tuple(free) or (*model.order_names, *_usually_free(model, driven=any(space.voltages)))
    parameters = [model.parameter(n) for n in names if n not in model.order_names]
    outputs = tuple(space.sensors) or tuple(model.outputs)
    still = Experiment("nothing yet", 0.1, np.zeros((10, len(outputs))), np.zeros((1, max(1, len(model.inputs)))))
    problem = Problem(
        model, (still,), {n: Free(q, min(0.5, q / 2), max(1.2, q)) if n in names else q for n, q in values.items()},
        {p.name: _around(p) for p in parameters}, outputs=outputs, initial_state="held",
    )  # fmt: skip
    counts = (COUNTS if model.angles else 0.0) if space.counts is None else space.counts
    step = 2 * math.pi / counts if counts else 0.0
    noise = QUIET * step if space.noise is None else space.noise
    if step == 0.0 and noise == 0.0:
        raise InputError(SAYS("no-noise" if space.counts is None else "perfect", model=model))
    count, finest = len(problem.names), FINE if model.angles else math.inf
    nothing = Information(np.zeros((count, count)), np.zeros((count, count)))
    return Subject(
        problem, dict.fromkeys(outputs, Noise(noise, step)), np.ones(count), finest, recorded=nothing, intervals={},
        name=model.name, table={}, space=space,
    )  # fmt: skip


def _usually_free(model: Model, driven: bool) -> tuple[str, ...]:
    """The constants of a rig that a project leaves free: not the one that a free response takes as known."""
    terms = model.linear_terms
    mechanics = {p.name for p in model.parameters} if terms is None else {*terms.lumped} - {terms.gauge}
    friction = {n for n, kind in model.friction.items() if kind.off == 0.0}
    secondary = {*model.friction} - friction  # such as a Stribeck speed, which acts beside its friction alone
    wanted = (mechanics | friction) - secondary - {*model.rests, model.drive} | ({model.drive} if driven else set())
    return tuple(p.name for p in model.parameters if p.name in wanted and p.value != 0.0)


def _around(p: Parameter) -> Free:
    ends = sorted((p.value / WIDE, p.value * WIDE)) if p.value else (-1e-3, 1e-3)
    return Free(p.value, max(ends[0], p.lower), min(ends[1], p.upper))


def _starting_at(problem: Problem, values: Mapping[str, float], held: Collection[str] = ()) -> Problem:
    """The same problem with other values, of free ones to start at or to keep; bounds that exclude one are moved."""
    orders, parameters = ({n: values[n] if n in held else _moved(v, values.get(n)) for n, v in of.items()}
                          for of in (problem.orders, problem.parameters))  # fmt: skip
    return replace(problem, memo=None, orders=orders, parameters=parameters)


def _moved(value: V, to: float | None) -> V | Free | float:
    if to is None or not isinstance(value, Free):
        return value if to is None else to
    return replace(value, start=to, lower=min(value.lower, to), upper=max(value.upper, to), prior=None)


# --- noise -------------------------------------------------------------------------------------------


def _noises(problem: Problem, errors: list[FloatArray], space: DesignSpace) -> tuple[dict[str, Noise], bool]:
    """Output → its noise, and whether encoders and white noise explain all residuals."""
    noises, alone = {}, True
    for o, name in enumerate(problem.outputs):
        found = [_noise(e, error[:, o], o) for e, error in zip(problem.experiments, errors, strict=True)]
        deviation, explained = math.sqrt(float(np.mean([n.deviation**2 for n in found]))), all(n.step for n in found)
        step, alone = max(n.step for n in found) if explained else 0.0, alone and explained
        if space.counts is not None and step:
            step = 2 * math.pi / space.counts if space.counts else 0.0
        noises[name] = Noise(deviation if space.noise is None else space.noise, step)
    return noises, alone


def _noise(e: Experiment, error: FloatArray, output: int) -> Noise:
    """The noise of one output of one recording; without a step where rounding and white noise do not explain it."""
    own = e.scored[:, output]
    found = encoder_noise(e.measured[:, output], error, own)
    if found is None:
        return Noise(math.sqrt(float(np.mean(error[own] ** 2))), 0.0)
    return Noise(found.noise * found.step, found.step)


def _excess(precision: Uncertainty) -> FloatArray:
    """By what each variance exceeds that of white noise; the typical one where a value has no interval."""
    samples = precision.samples / precision.effective_samples
    finite = samples[np.isfinite(samples) & (samples > 0)]
    typical = float(np.exp(np.mean(np.log(finite)))) if len(finite) else 1.0
    return np.asarray(np.maximum(np.where(np.isfinite(samples) & (samples > 0), samples, typical), 1.0))
