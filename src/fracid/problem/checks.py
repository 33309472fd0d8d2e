"""What does not fit together is refused, part by part, before anything runs."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterable, Mapping

import numpy as np

from fracid.errors import SMALLEST, InputError, at_least, refuse_beyond, refuse_unknown, unknown_name
from fracid.problem.costs import COSTS, SAYS
from fracid.problem.criterion import Criterion
from fracid.problem.experiment import Experiment
from fracid.problem.parametrisation import Parametrisation
from fracid.problem.sensors import QUANTITIES
from fracid.problem.simulator import Simulator
from fracid.problem.unknowns import Free, Tied, ends_of, root_of, starting_value
from fracid.signals.noise import noise_floor
from fracid.solver.methods import METHODS
from fracid.solver.right_hand_side import probe

ELSEWHERE, CHANCE, PROBE = 0.05, 4.0, 1e-6
"""An output that is off at the start by more than this part of its range, and than so many times its noise, begins
elsewhere; and the step of a derivative."""

ROWS = 50
"""Samples of a record that show the range of what is not measured."""

MOST_STEPS = 10**8
"""Of a run: gigabytes, and a minute."""


def check_parametrisation(p: Parametrisation) -> None:
    """Names, ties and bounds of the unknowns, and each recording's own data."""
    _check_ties(p)
    p.model.parameter_vector(p.parameter_starts)
    p.model.state_orders(p.order_starts)
    _check_bounds(p)
    _check_outputs(p)
    _check_experiments(p)


def check_simulator(simulator: Simulator) -> None:
    """A method that there is, a whole number of substeps, and a right-hand side that fits its arguments."""
    p = simulator.parametrisation
    refuse_unknown("method", METHODS, simulator.method)
    at_least("substeps", p.substeps, 1)
    run, held = p.unpack(p.start, e := p.experiments[0]), [i for m in p.model.memories for i in m.held]
    probe(p.model.rhs, np.delete(run.initial, held), e.inputs[0], run.parameters, relaxing=bool(p.model.relaxing))
    for e in p.experiments:
        if simulator.steps(e) > MOST_STEPS:
            raise InputError(SAYS("many-steps", e=e, p=p, steps=simulator.steps(e), MOST_STEPS=MOST_STEPS))


def check_criterion(criterion: Criterion) -> None:
    """Levels and priors need the errors' likelihood, which a user's own cost does not tell."""
    what = "a prior" if criterion.priors else 'weights = "noise"' if criterion.weights == "noise" else ""
    if what and criterion.cost_function.loss is None:
        raise InputError(SAYS("own-cost", what=what, criterion=criterion, costs=", ".join(COSTS)))


def refuse_twins(names: Iterable[str]) -> None:
    """Refuse recordings of one name: results go by it.

    Raises
    ------
    InputError
        Naming the one that comes most often.

    Examples
    --------
    >>> refuse_twins([])
    """
    for name, count in Counter(names).most_common(1):
        if count > 1:
            raise InputError(f"{count:,} recordings are named {name!r}; give each its own name.")


def require_free(names: Collection[str]) -> None:
    """Refuse to search where no unknown is left.

    Raises
    ------
    InputError
    """
    if not names:
        raise InputError("Nothing is free: give at least one order or parameter a start, a lower and an upper bound.")


def _twice(names: Iterable[str]) -> str:
    """The first name that comes twice; "" for none."""
    return next((name for name, count in Counter(names).items() if count > 1), "")


def _check_ties(p: Parametrisation) -> None:
    """A tie goes to a known name of the same kind and unit, and in no circle."""
    names = {"order": p.model.order_names, "parameter": p.model.parameter_names}
    for what, values in (("order", p.orders), ("parameter", p.parameters)):
        for name, value in values.items():
            if isinstance(value, Tied) and not value.to.isidentifier():
                raise InputError(SAYS("not-a-value", name=name, value=value, what=what))
            if isinstance(value, Tied) and value.to not in names[what]:
                raise unknown_name(f"{what} that {name} is tied to", value.to, names[what])
            root = root_of(what, name, values)
            if what == "parameter":
                units = [p.model.parameter(n).unit for n in (name, root)]
                if units[0] != units[1]:
                    raise InputError(SAYS("other-unit", name=name, root=root, units=units))


def _check_bounds(p: Parametrisation) -> None:
    """Orders stay within (0, 2), parameters where the model means something, also those tied to a free one."""
    for name, value in p.orders.items():
        if not isinstance(value, Tied):
            low, high = ends_of(value)
            if not 0 < low <= high < 2:
                raise InputError(f"{name} = {low:g} … {high:g}: an order must lie strictly between 0 and 2.")
            if high > 1 and name in p.model.springpot_orders.values():
                raise InputError(SAYS("springpot-order", name=name, low=low, high=high))
    for name in p.parameters:
        constant, free = p.model.parameter(name), p.parameters.get(p.ties.get(name, name))
        whose = f"{p.ties[name]}'s" if name in p.ties else "its"
        if isinstance(free, Free) and not constant.lower <= free.lower < free.upper <= constant.upper:
            raise InputError(SAYS("beyond-constant", name=name, free=free, constant=constant, whose=whose))
    if name := _twice(p.per_recording):
        raise InputError(f"per_recording names {name!r} twice; name it once.")
    for name in p.per_recording:
        if name in p.ties:
            raise InputError(f"per_recording names {name!r}, which is tied: name {p.ties[name]!r} instead.")
        if not isinstance(p.parameters.get(name), Free):
            raise InputError(SAYS("per-recording-not-free", name=name))


def _check_outputs(p: Parametrisation) -> None:
    if not p.outputs:
        raise InputError(f"outputs is empty: score at least one of {', '.join(p.model.outputs)}.")
    refuse_unknown("output", p.model.outputs, *p.outputs)
    if name := _twice(p.outputs):
        raise InputError(f'outputs names {name!r} twice; to weigh outputs by their noise type weights = "noise".')


def _check_experiments(p: Parametrisation) -> None:
    """At least one, each with its own name, a column an output, and enough samples."""
    if not p.experiments:
        raise InputError("A problem needs at least one recording.")
    refuse_twins(e.name for e in p.experiments)
    for e in p.experiments:
        if e.measured.ndim != 2 or e.measured.shape[1] != len(p.outputs) or len(e.measured) < 3:
            raise InputError(SAYS("measured-shape", e=e, count=len(p.outputs), outputs=", ".join(p.outputs)))
        count, before = len(p.model.inputs), 0 if e.past is None else len(e.past)
        for what, u, rows in (("inputs", e.inputs, e.steps + 1), ("past_inputs", e.past_inputs, before)):
            if count and u is not None and (u.ndim != 2 or u.shape[1] != count or 1 != len(u) < rows):
                raise InputError(SAYS("inputs-shape", e=e, what=what, u=u, rows=rows, inputs=", ".join(p.model.inputs)))
        refuse_unknown(f"state in initial of {e.name}", p.model.states, *e.initial)
        _check_sensors(p, e)
        _check_past(p, e)
        _check_release(p, e)
        if not (math.isfinite(e.weight) and e.weight > 0):
            raise InputError(SAYS("weight", e=e))
        refuse_beyond(f"{e.name}: weight", e.weight, SMALLEST)
        for name, value in e.initial.items():
            refuse_beyond(f"{e.name}: initial {name}", starting_value(value))
        if not np.all(np.isfinite(e.measured)) or not np.all(np.isfinite(e.inputs)):
            raise InputError(f"{e.name}: a sample is not a finite number; leave such samples out or fill them.")
        _check_hidden_start(p, e)


def _check_sensors(p: Parametrisation, e: Experiment) -> None:
    """Sensors of outputs that are scored, no delay beyond the record, samples that count."""
    for what, sensors, channels in (("output", e.sensors, p.outputs), ("input", e.actuators, p.model.inputs)):
        for name, sensor in sensors.items():
            refuse_unknown(f"{what} of {e.name} with a delay, gain, bias or lowpass", channels, name)
            for delay in sensor.range("delay"):
                if abs(delay) >= e.time[-1]:
                    raise InputError(SAYS("late-delay", e=e, name=name, delay=delay, end=e.time[-1]))
    refuse_unknown(f"input of {e.name} with between", p.model.inputs, *e.between)
    if (count := np.count_nonzero(np.any(e.scored, axis=1))) < 3:
        raise InputError(SAYS("few-scored", e=e, count=count, samples=len(e.measured)))
    free = {name for s in (e.sensors, e.actuators) for c, sensor in s.items() for name in sensor.free(c)}
    for name in p.per_recording:
        quantity, _, channel = name.partition("_")
        if quantity in QUANTITIES and name not in free and channel in (*p.outputs, *p.model.inputs):
            raise InputError(SAYS("channel-not-free", name=name, quantity=quantity, channel=channel, e=e))


def _check_hidden_start(p: Parametrisation, e: Experiment) -> None:
    """States that functions of them alone show start at 0: not where an output begins elsewhere, and nothing helps."""
    functions = {k: h for k, n in enumerate(p.outputs) if not isinstance(h := p.model.outputs[n], int)
                 and n not in e.sensors and n not in p.model.derived}  # fmt: skip
    if p.initial_state != "estimate" or e.initial or e.past is not None or not functions:
        return
    start, states = p.unpack(p.start, e), p.model.states
    free = [i for i, n in enumerate(p.model.parameter_names) if isinstance(p.parameters.get(n), Free)]
    nudges = PROBE * np.eye(len(start.parameters))[free] * (PROBE + abs(start.parameters))
    seen = [*(i for n, i in p.model.output_states.items() if n in p.outputs), *p.rates.values()]
    for k, h in functions.items():
        at_start = h(0.0, start.initial, e.inputs[0], start.parameters)
        off, size = e.measured[0, k] - at_start, np.ptp(e.measured[:, k])
        helped = any(h(0.0, start.initial, e.inputs[0], start.parameters + d) != at_start for d in nudges)
        nudged = start.initial + PROBE * np.eye(len(states))
        slopes = (np.array([h(0.0, x, e.inputs[0], start.parameters) for x in nudged]) - at_start) / PROBE
        slopes[seen] = 0.0
        if helped or not slopes.any() or abs(off) <= max(ELSEWHERE * size, CHANCE * noise_floor(e.measured[:, k])):
            continue
        fastest = np.max(np.abs(np.diff(e.measured[:, k]))) / e.step
        nearest = off * slopes / (slopes @ slopes)
        ranges = {i: (nearest[i], size / abs(slopes[i])) for i in np.flatnonzero(slopes).tolist()}
        rates = {j: i for i, j in p.model.rates.items() if i in ranges and j not in ranges}
        ranges |= {j: (0.0, fastest / abs(slopes[i])) for j, i in rates.items()}
        typed = typed_starts({states[i]: around for i, around in ranges.items()})
        raise InputError(SAYS("begins-elsewhere", e=e, name=p.outputs[k], begins=e.measured[0, k], at_start=at_start,
                              states=' and '.join(states[i] for i in ranges), typed=typed))  # fmt: skip


def hidden_starts(p: Parametrisation, e: Experiment) -> dict[str, tuple[float, float]]:
    """States that begin at 0 because nothing says otherwise, and would not stay there: where they rest, and a reach.

    Of states that relax: an integral of others begins at 0 by its meaning, so does a springpot's, and a speed at rest.
    They rest where all of them do beside the outputs as measured, to first order; that is away from 0 in its range.
    Hysteresis relaxes in motion alone, and a slope at the start that may be noise is no motion.
    """
    model, start = p.model, p.unpack(p.start, e)
    x = np.array([start.initial] * len(rows := np.linspace(0, len(e.measured) - 1, ROWS).astype(int)))
    for name, y, slope in zip(p.outputs, e.measured.T, e.first_values()[1], strict=True):
        i, noise = model.output_states.get(name), float(np.linalg.norm(e.slope_weights)) * noise_floor(y)
        if i is not None and name not in e.sensors:
            x[:, i] = y[rows]
        if i in p.rates and abs(slope) <= max(ELSEWHERE * np.ptp(np.diff(y)) / e.step, CHANCE * noise):
            x[:, p.rates[i]] = 0.0
    u = e.inputs[np.linspace(0, len(e.inputs) - 1, ROWS).astype(int)]
    at_start = model.derivatives(x[0], u[0], start.parameters)
    slopes = [model.derivatives(x[0] + d, u[0], start.parameters) - at_start for d in PROBE * np.eye(len(x[0]))]
    hidden = [i for i in p.unstated(p.start, e) if slopes[i][i] < 0.0 and i not in model.rates.values()]
    if not hidden or e.past is not None:
        return {}
    J = np.array([slopes[i][hidden] / PROBE for i in hidden]).T
    driven = np.array([model.derivatives(*at, start.parameters)[hidden] for at in zip(x, u, strict=True)])
    levels = -np.linalg.lstsq(J, np.nan_to_num(driven).T)[0]
    ranges = zip(hidden, levels[:, 0].tolist(), np.ptp(levels, axis=1).tolist(), strict=True)
    return {model.states[i]: (at, max(size, abs(at))) for i, at, size in ranges if abs(at) > ELSEWHERE * size}


def typed_starts(around: Mapping[str, tuple[float, float]]) -> str:
    """What ``initial`` has for states that begin within some reach of a value.

    Examples
    --------
    >>> typed_starts({"w": (0.0, 3.0)})
    '{ "w" = { start = 0, lower = -3, upper = 3 } }'
    """
    each = [f'"{n}" = {{ start = {at:.3g}, lower = {at - reach:.3g}, upper = {at + reach:.3g} }}'
            for n, (at, reach) in around.items()]  # fmt: skip
    return f"{{ {', '.join(each)} }}"


def _check_past(p: Parametrisation, e: Experiment) -> None:
    """A past is a motion from rest on, of which every state is known."""
    if e.past is None:
        return
    if e.past.ndim != 2 or e.past.shape[1] != len(p.outputs) or not len(e.past):
        raise InputError(SAYS("past-shape", e=e, count=len(p.outputs), outputs=", ".join(p.outputs)))
    if not np.all(np.isfinite(e.past)) or (e.past_inputs is not None and not np.all(np.isfinite(e.past_inputs))):
        raise InputError(f"{e.name}: a sample of its past is not a finite number; leave such samples out or fill them.")
    if e.sensors or e.sparse:
        raise InputError(SAYS("history-beside-sensor", e=e))
    for name in p.outputs:
        if name not in p.model.output_states:
            raise InputError(SAYS("history-of-function", e=e, name=name))
    if unknown := [n for n in p.model.states if n not in p.told]:
        raise InputError(SAYS("past-undetermined", e=e, names=", ".join(unknown), outputs=", ".join(p.outputs)))
    if p.initial_state not in ("estimate", "measured"):
        raise InputError(SAYS("past-starts-in-motion", e=e, p=p))


def _check_release(p: Parametrisation, e: Experiment) -> None:
    """A release lies within the recording, and what moves already cannot be released."""
    if e.release_time == 0.0:
        return
    ends = ends_of(e.release_time)
    if not -e.time[-1] / 2 <= ends[0] <= ends[1] <= e.time[-1] / 2:
        raise InputError(SAYS("late-release", e=e, ends=' … '.join(f'{v:g}' for v in dict.fromkeys(ends)),
                              end=e.time[-1]))  # fmt: skip
    rates = [p.model.states[j] for j in p.model.rates.values()]
    if p.initial_state not in ("rest", "held") and any(e.initial.get(n) != 0.0 for n in rates):
        raise InputError(SAYS("release-in-motion", e=e, p=p, still=", ".join(f'"{n}" = 0.0' for n in rates)))
