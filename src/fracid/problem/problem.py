"""An identification problem: a model, its recordings, what is free, and what counts as good.

::

    x → Parametrisation → Simulator → errors → Criterion → cost, residuals

=======================  ======================================================================================
part                     from → to
=======================  ======================================================================================
:mod:`.parametrisation`  x → orders, parameters, initial state and release of each recording; its bounds, ties
:mod:`.simulator`        those → trajectory and outputs, with the `method`, its `memory` and `substeps`
:mod:`.criterion`        errors → cost and rows, with the `cost_function`, `weights` and priors
=======================  ======================================================================================

A :class:`Problem` is a parametrisation with the other two, checks once that all fits together (:mod:`.checks`), and is
what estimation asks.
Residuals are measured minus simulated [rad].  A run that diverges has an infinite cost and its reason, never a NaN.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial
from itertools import chain, pairwise
from typing import Any, TypeVar

import numpy as np

from fracid.arrays import BoolArray, FloatArray, by_name
from fracid.arrowhead import Blocks
from fracid.cards import Card, CardDisplay, listed
from fracid.errors import Failure, InputError, brief
from fracid.models import Model
from fracid.optimise import Evaluation, Space
from fracid.problem.checks import check_criterion, check_parametrisation, check_simulator
from fracid.problem.costs import COSTS, Cost
from fracid.problem.criterion import Criterion
from fracid.problem.experiment import Experiment
from fracid.problem.parametrisation import EVERY, Parametrisation
from fracid.problem.sensors import with_sensors
from fracid.problem.simulator import Simulator
from fracid.problem.unknowns import Free, Tied, Values, Weights, Windows, starting_value
from fracid.safety.kinds import refuse_other_kinds
from fracid.solver.memory import Memory, compressed
from fracid.solver.solve import MOST, RUNS, go_together
from fracid.solver.trajectory import Trajectory
from fracid.tasks.job import in_threads
from fracid.tasks.simulation_cache import Memo, Recent
from fracid.units import letter

_Found = TypeVar("_Found")
Points = Sequence[FloatArray] | FloatArray

WORTH = 250_000
"""Steps of all recordings, times unknowns, from which on points go together: the loop for several runs takes three
seconds to compile, once on a machine, which two or three such fits win back."""

MANY = 100
"""Unknowns that belong to one recording each, from which on their structure is used."""


@dataclass(frozen=True, repr=False, kw_only=True)
class Problem(Parametrisation, CardDisplay):
    """What :func:`fracid.identify` solves.

    Examples
    --------
    >>> import fracid
    >>> import numpy as np
    >>> from fracid.problem import Free
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

    cost_function: Cost = COSTS["rmse"]
    method: str = "pi2"
    memory: Memory = compressed()  # noqa: RUF009 (frozen)
    weights: Weights = "equal"
    """``equal``: a radian of error counts the same in every output; ``noise``: against its output's own level."""
    windows: Windows = "auto"
    """Seconds of the windows in which recordings are fitted, each with a start of its own, or ``none``; ``auto``: where
    no simulation follows them to their end (:mod:`fracid.estimation.windows`)."""
    memo: Memo | Recent | None = field(default=None, repr=False, compare=False)
    """Has what was simulated before, and keeps what will be; of several recordings the latest, if left out: what one
    recording's own unknown changes is simulated, the rest read."""
    together: bool = field(default=False, repr=False, compare=False)
    """Whether points go together where they can (:mod:`fracid.solver.lanes`), of all problems made from this one too;
    they do where its runs are long."""

    def __post_init__(self) -> None:
        """Give the model what is free of it, its channels too, and check that the parts fit together."""
        refuse_other_kinds(self)
        values = {p.name: p.value for p in self.model.parameters} | dict(self.parameters)
        on = {n for n, v in values.items() if isinstance(v, Free | Tied) or v != 0.0}
        on |= {n for e in self.experiments for n, v in e.constants.items() if v != 0.0}
        model = self.model.equipped(on)
        outputs = tuple(model.outputs) if self.outputs is EVERY else self.outputs
        own = {n: model.output_unit(n) for n in outputs}
        each = tuple(e if {*own} <= {*e.units} else replace(e, units=own | {**e.units}) for e in self.experiments)
        sensors = [table for e in each for table in (e.sensors, e.actuators)]
        units = {**model.input_units} | {n: u for e in each for n, u in e.units.items()}
        model, parameters = with_sensors(model, self.parameters, sensors, units)
        memo = self.memo if self.memo is not None or len(each) == 1 else Recent()
        final = {"model": model, "outputs": outputs, "parameters": parameters, "experiments": each, "memo": memo}
        for name, value in final.items():
            object.__setattr__(self, name, value)
        check_parametrisation(self)
        check_simulator(self.simulator)
        check_criterion(self.criterion)
        long = self.simulator.all_steps * len(self.unknowns) >= WORTH
        object.__setattr__(self, "together", self.together or long)

    def _card(self) -> Card:
        return Card(f"Problem of {self.model.name}: {len(self.names)} free parameters", (
            ("recordings", listed(e.name for e in self.experiments)),
            ("free", listed(letter(name) for name in self.names)),
            ("cost", f"{self.cost_function.name} of {listed(letter(n) for n in self.outputs)}"),
            ("solver", f"{self.method}, memory {self.memory.name}, {self.substeps} steps a sample"),
        ))  # fmt: skip

    def __reduce__(self) -> tuple[Any, ...]:
        """For pickle: the fields; what was simulated before, and what is computed once, stay behind."""
        parts = {f.name: getattr(self, f.name) for f in fields(self)}
        return partial(Problem, **parts | {"memo": None}), ()

    # --- the other two parts -----------------------------------------------------------------------

    @cached_property
    def simulator(self) -> Simulator:
        """From the unknowns to trajectories, outputs and errors."""
        return Simulator(self, self.method, self.memory, self.memo)

    @cached_property
    def criterion(self) -> Criterion:
        """From errors to the cost and its rows."""
        return Criterion(self.experiments, self.outputs, self.priors, self.cost_function, weights=self.weights)

    # --- the cost of a point -----------------------------------------------------------------------

    def evaluate(self, x: FloatArray) -> Evaluation:
        """Cost, residuals and, where the cost is infinite, the reason."""
        return self.evaluate_all([x])[0]

    def evaluate_all(self, points: Sequence[FloatArray]) -> list[Evaluation]:
        """The same at several points, whose runs go together where they can."""
        for x in points:
            if np.shape(x) != (len(self.unknowns),):
                raise InputError(f"x = {brief(x)}: expected a value for each of {', '.join(self.names)}.")
        return [
            Evaluation(x, math.inf, None, str(errors)) if isinstance(errors, Failure) else self.criterion(x, errors)
            for x, errors in zip(points, self.simulator.all_errors(points), strict=True)
        ]

    @cached_property
    def abreast(self) -> int:
        """Points to ask for at once: 1 where no runs go together, or errors take too much room."""
        fits = RUNS * sum(e.measured.nbytes for e in self.experiments) <= MOST
        return RUNS if self.together and fits and go_together(self.model.rhs, self.method) else 1

    def cost(self, x: FloatArray) -> float:
        """𝓛(x) of (25), joined over the recordings; infinite where a run diverges."""
        return self.evaluate(x).cost

    def costs(self, points: Points, *, jobs: int = 1) -> list[float]:
        """The same at several points, on threads."""
        return self._on_threads(lambda few: [e.cost for e in self.evaluate_all(few)], points, jobs)

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

    def errors(self, x: FloatArray) -> list[FloatArray] | Failure:
        """Measured minus simulated of each recording [rad], shape (n_samples, n_outputs), or why there is none."""
        return self.simulator.all_errors([x])[0]

    def all_errors(self, points: Points, *, jobs: int = 1) -> list[list[FloatArray] | Failure]:
        """The same at several points, on threads."""
        return self._on_threads(self.simulator.all_errors, points, jobs)

    def _on_threads(self, work: Callable[[list[FloatArray]], list[_Found]], points: Points, jobs: int) -> list[_Found]:
        """What it gives for as many points at once as go together."""
        parts = [list(points[k : k + self.abreast]) for k in range(0, len(points), self.abreast)]
        return list(chain.from_iterable(in_threads(jobs, work, parts)))

    def levels(self, x: FloatArray) -> dict[str, float]:
        """The level of each output's residual, rms [rad]; infinite where a run fails."""
        errors = self.errors(x)
        return dict.fromkeys(self.outputs, math.inf) if isinstance(errors, Failure) else self.criterion.levels(errors)

    # --- what the parts say ------------------------------------------------------------------------

    def named(self, x: FloatArray) -> dict[str, float]:
        """Name of each unknown → its value."""
        return by_name(self.names, np.asarray(x))

    def point(self, values: Mapping[str, float]) -> FloatArray:
        """The other way: the unknowns of these values, what is not among them at its start, shape (n_unknowns,)."""
        return np.array([values.get(u.name, u.range.start) for u in self.unknowns], float)

    @property
    def free_orders(self) -> dict[str, int]:
        """Each free order with which of the unknowns it is."""
        return {self.unknowns[i].target: i for i in self.order_indices}

    @cached_property
    def space(self) -> Space:
        """The unknowns with their bounds, for an optimiser; their blocks, where no prior ties the rows together."""
        space = super().space
        whole = self.priors or self.cost_function.loss is None
        return space if whole else replace(space, blocks=self.blocks)

    @property
    def in_windows(self) -> bool:
        """Whether its experiments are windows of recordings."""
        return all(e.whole is not None for e in self.experiments)

    @property
    def recordings(self) -> dict[str, tuple[Experiment, slice]]:
        """Each recording by name, with its experiments: most have one, themselves; of others they are windows."""
        wholes = [e.recording for e in self.experiments]
        firsts = [i for i, e in enumerate(wholes) if i == 0 or e.name != wholes[i - 1].name]
        return {wholes[a].name: (wholes[a], slice(a, b)) for a, b in pairwise([*firsts, len(wholes)])}

    @cached_property
    def blocks(self) -> Blocks | None:
        """Which unknowns and rows belong to which recording; None where so few are a recording's own that all are one.

        With ``weights = "noise"`` a row for the level of each output follows.
        """
        numbers: dict[str | None, int] = {e.name: k for k, e in enumerate(self.experiments)}
        recording = np.array([numbers.get(u.experiment, -1) for u in self.unknowns], dtype=np.int64)
        if len(self.experiments) < 2 or (np.count_nonzero(recording >= 0) < MANY and not self.in_windows):
            return None
        rows = np.cumsum([0, *(len(e.measured) * len(self.outputs) for e in self.experiments)])
        return Blocks(recording, rows, 0 if self.weights == "equal" else len(self.outputs))

    @property
    def scored(self) -> list[BoolArray]:
        """Which samples of each recording count, shape (n_samples, n_outputs)."""
        return [e.scored for e in self.experiments]

    @cached_property
    def last_derivatives(self) -> dict[bytes, tuple[Any, Any]]:
        """The point at which derivatives of many recordings were asked for last, by which unknowns, and those."""
        return {}

    def simulate(self, x: FloatArray, e: Experiment) -> Trajectory:
        """Simulate one recording with the unknowns x, from its release on, on its grid divided by `substeps`."""
        return self.simulator.trajectories([x], e, [0])[0]

    def fitted(self, x: FloatArray, e: Experiment) -> FloatArray | Failure:
        """Simulated outputs [rad], shape (n_samples, n_outputs), or why there are none."""
        return self.simulator.all_outputs([x], e)[0]

    def followed(self, x: FloatArray, name: str) -> FloatArray | Failure:
        """Simulated outputs of a whole recording, shape (n_samples, n_outputs); NaN between windows that lie apart."""
        whole, at = self.recordings[name]
        outputs = np.full(whole.measured.shape, np.nan)
        for e in self.experiments[at]:
            simulated = self.fitted(x, e)
            if isinstance(simulated, Failure):
                return simulated
            first = round((e.start - whole.start) / whole.step)
            outputs[first : first + len(simulated)] = simulated
        return outputs

    # --- variants ----------------------------------------------------------------------------------

    @property
    def seconds(self) -> float:
        """How long its longest recording is [s]."""
        return max(float(e.time[-1]) for e in self.experiments)

    def until(self, horizon: float) -> Problem:
        """The same problem on the first `horizon` seconds of each recording."""
        return replace(self, experiments=tuple(e.until(horizon) for e in self.experiments))

    def with_shared(self, x: FloatArray, experiments: tuple[Experiment, ...]) -> Problem:
        """Fix all that is shared at its value in x, and leave to other recordings what is theirs.

        For validation: initial states and `per_recording` parameters are found again, nothing else.
        """
        shared = {u.target: v for u, v in zip(self.unknowns, x.tolist(), strict=True) if u.experiment is None}
        own_names = (*self.per_recording, *self.ties)
        orders, parameters = ({n: v if n in own_names else shared.get(n, starting_value(v)) for n, v in of.items()}
                              for of in (self.orders, self.parameters))  # fmt: skip
        return replace(self.of(*experiments), orders=orders, parameters=parameters)

    def of(self, *experiments: Experiment) -> Problem:
        """The same problem of other recordings, which begin in motion where those in windows do."""
        moving = [replace(e, release_time=0.0, initial={}) if self.in_windows else e for e in experiments]
        return replace(self, experiments=tuple(moving))


def alternative_of(problem: Problem, model: Model, orders: Values, parameters: Values) -> Problem:
    """Another model for the recordings of a problem, judged alike.

    Examples
    --------
    >>> import fracid
    >>> import numpy as np
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> still = Experiment("still", 0.1, np.zeros((9, 2)), np.zeros((1, 1)))
    >>> problem = Problem(rig, (still,), {"lambda": 0.9, "mu": 0.9}, substeps=2)
    >>> alternative_of(problem, rig, {"lambda": 1.0, "mu": 1.0}, {"b_theta": 0.0}).substeps
    2
    """
    initial = ({n: v for n, v in e.initial.items() if n in model.states} for e in problem.experiments)
    known = ({n: v for n, v in e.constants.items() if n in model.parameter_names} for e in problem.experiments)
    each = zip(problem.experiments, initial, known, strict=True)
    experiments = tuple(replace(e, initial=begun, constants=constants) for e, begun, constants in each)
    return replace(problem, model=model, orders=orders, parameters=parameters, per_recording=(),
                   experiments=experiments, memo=None)  # fmt: skip
