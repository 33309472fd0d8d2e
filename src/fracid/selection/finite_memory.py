r"""Is an order worth its memory?  The rival that every model has: the same one with a finite memory.

A state of order q obeys :math:`x = x_0 + \int_0^t k(t-s)\,f(s)\,ds` with :math:`k = t^{q-1}/\Gamma(q)`, which fades
like a power of time, over all times at once.  A second lump behind a weak coupling, a ladder of resistors and
capacitors, a wall that heat creeps into fade too, over a few times,

.. math::  k(t) = a_0 + \sum_{j=1}^n a_j e^{-t/\tau_j},

and over a record of two decades one of them looks much like a power.  So before orders are called fractional the kernel
of each that is off its integer is cut down to one, then two, then three such relaxations, all else equal, and the
recordings are fitted again.  Nothing has to be known of the physics: the solver holds an order as exponentials, and
takes these in their place (:func:`fracid.solver.weights.relaxing_kernel`), so that the model runs as it is.  That is as
if beside x' each relaxation were a state,

.. math::  x' = \Big(\sum_{j=0}^n a_j\Big) f - \sum_j a_j z_j/\tau_j, \qquad z_j' = f - z_j/\tau_j, \quad z_j(0) = 0,

which is why what each holds at the start, unknown after a past, has the place of a state.  States that share an order
share its relaxations.  One of the amplitudes says only in which unit the model's other constants are given, s^(q-1)
against 1, and another may be a spring that the model has: as parameters count the directions in which the constants,
but for one amplitude, move the recordings.

An order is worth as many relaxations as it takes to come within 14 of its BIC.  Enough of them imitate any kernel, so
what is claimed is that it is worth more than two, and that three, for all their constants, are no better.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.optimize import nnls

from fracid.arrays import ByName, FloatArray, by_name
from fracid.errors import Failure
from fracid.estimation.climbing import embedded
from fracid.estimation.derivatives import jacobian
from fracid.estimation.horizons import Watch, lowest_from, refined, uninterrupted
from fracid.estimation.long_records import thinned
from fracid.models import Model, Parameter
from fracid.models.base import FadingState
from fracid.models.joints import Complement
from fracid.optimise import Evaluation, Outcome
from fracid.problem import Experiment, Free, Problem
from fracid.selection.integer_rival import FEW, WORTH, FiniteMemory, Rival, gain_over
from fracid.selection.residual_noise import leftovers
from fracid.signals.coloured import directions

MOST = FEW + 1
"""Relaxations that an order must not be beaten by."""

SHORTEST, LONGEST = 1 / 3, 10.0
"""Time constants, in steps of a sample and in record lengths."""

REACH = 1e3
"""Amplitudes go up to so many times the kernel's own."""

FAINT = 1e-2
"""The least amplitude of a start, in parts of the kernel's own: none is held at zero."""

ROUGH = {"tolerance": 1e-3, "budget": 15}
"""Least squares from each start."""

FINE = {"tolerance": 1e-5, "budget": 40}
"""From the best of them."""

FAIR = {"tolerance": 1e-4, "budget": 15}
"""From the best of them on coarser recordings, from where it goes on."""

SOME = {"tolerance": 1e-5, "budget": 8}
"""On every sample, from what coarser recordings found, so often as"""

ROUNDS = 6
"""says, unless at the pace of one round those that are left do not make it as good as the orders."""

PLACES = (0.5, 0.8)
"""From where the last time constant begins, in the logarithm between a step and the record; others lie below it."""

SAME_DIRECTION = 1e-5
"""Directions of the Jacobian below this part of its largest singular value are none."""

FAR = 2.0
"""Times the fractional fit's cost on coarser recordings: who is above is not fitted to every sample."""

AT_END = 1e-2
"""Next to a limit: ln τ."""

Groups = Mapping[str, Sequence[int]]
"""Name of an order → the states whose derivatives are of it."""


def finite_memories(
    problem: Problem, best: Evaluation, off: Sequence[str], *, watch: Watch | None = None
) -> tuple[FiniteMemory, ...]:
    """Fit one, two, three relaxations in the place of orders, until they do as well.

    Parameters
    ----------
    problem : Problem
    best : Evaluation
        Its minimum.
    off : sequence of str
        The free orders that are off their integers, those of springpots among them.
    watch : Watch, optional
        Counts the work, and ends it.

    Examples
    --------
    A body that cools, with a weak second lump behind it, is no fractional body:

    >>> from scipy.integrate import solve_ivp
    >>> def body(t, x, u, p, out):
    ...     out[0] = (u[0] - p[1] * x[0]) / p[0]
    >>> model = Model("body", body, ("T",), ("q",), {"T": 0}, ("power",),
    ...               (Parameter("C", "J/K", 2.0, "capacity"), Parameter("h", "W/K", 0.5, "loss")), "", "an example")
    >>> t = np.arange(200) / 10
    >>> lumps = solve_ivp(lambda t, x: [(1 - 0.5 * x[0] - 0.3 * (x[0] - x[1])) / 2, 0.3 * (x[0] - x[1])],
    ...                   (0, 20), [0, 0], t_eval=t, rtol=1e-9, atol=1e-12)
    >>> warm = lumps.y[0] + 0.01 * np.random.default_rng(1).standard_normal(t.size)
    >>> record = Experiment("warm", 0.1, warm[:, None], np.ones((1, 1)), initial={"T": 0.0})
    >>> problem = Problem(model, (record,), {"q": Free(0.9, 0.3, 1.5)},
    ...                   {"C": Free(2.0, 0.1, 50.0), "h": Free(0.5, 0.0, 5.0)}, initial_state="held")
    >>> best = refined(problem, problem.start, Watch()).best
    >>> [(m.relaxations, m.as_well) for m in finite_memories(problem, best, ["q"])]
    [(1, True)]
    """
    watch = watch or Watch()
    groups, about = _groups(problem, off), thinned(problem, best.point)
    far, own = FAR * about.cost(best.point), _parameters(problem, best.point, set(), watch.jobs)
    memories: list[FiniteMemory] = []
    values = problem.named(best.point)
    fewer: dict[str, float] = {}
    for count in range(1, MOST + 1):
        rival = _relaxing(problem, best, groups, count)
        nearly = rival if about is problem else _relaxing(about, best, groups, count)
        starts = [values | _begun(about, best, groups, count, place=place) for place in PLACES]
        also = [starts[-1] | fewer | _faint(groups, nearly, count)] if fewer else []
        end = _lowest(nearly, starts, also, watch, last=FINE if nearly is rival else FAIR)
        fewer = nearly.named(end.point)
        more = _parameters(nearly, end.point, {f"share1_{name}" for name in groups}, watch.jobs) - own
        if nearly is not rival:
            far_off, end = end.cost > far, rival.evaluate(embedded(rival, fewer))
            gain = _gain(rival, end, problem, best, more=more)
            for left in () if far_off else range(ROUNDS, 0, -1):
                found, before = uninterrupted(refined(rival, end.point, watch, **SOME)), gain
                end = found.best
                gain = _gain(rival, end, problem, best, more=more)
                if found.outcome is Outcome.CONVERGED or gain - WORTH > left * (before - gain):
                    break
        memories.append(_judged(rival, end, count, _gain(rival, end, problem, best, more=more)))
        if memories[-1].as_well or watch.spent:
            break
    return tuple(memories)


def _lowest(
    rival: Problem, starts: Sequence[ByName], also: Sequence[ByName], watch: Watch, last: Mapping[str, Any]
) -> Evaluation:
    """From the starts, and from others where those end above: so no fit of more ends above one of fewer."""

    def rough(start: ByName) -> Evaluation:
        return lowest_from(rival, embedded(rival, start), watch, **ROUGH)

    end = min(map(rough, starts), key=lambda e: e.cost)
    higher = [x for x in also if not end.cost < rival.cost(embedded(rival, x))]
    end = min((end, *map(rough, higher)), key=lambda e: e.cost)
    return end if end.residuals is None else lowest_from(rival, end.point, watch, **last)


def _gain(rival: Problem, end: Evaluation, problem: Problem, best: Evaluation, more: int) -> float:
    """Of the fractional fit over one with so many parameters more; infinite where that has no run."""
    return math.inf if end.residuals is None else gain_over(Rival(rival, end, "", {}), problem, best, more)[1]


def _judged(rival: Problem, end: Evaluation, count: int, gain: float) -> FiniteMemory:
    """Beside the fractional fit; one that has no run ends nothing, and of one that is far from it nothing is asked."""
    at = by_name(rival.unknowns, end.point)
    limited = any(not u.range.lower + AT_END < v < u.range.upper - AT_END for u, v in at.items()
                  if u.target.startswith("ln_tau"))  # fmt: skip
    settles = gain <= WORTH and not limited and all(left.noise for left in leftovers(rival, end.point).values())
    return FiniteMemory(count, end.cost, gain, settles)


def _parameters(problem: Problem, x: FloatArray, scales: set[str], jobs: int) -> int:
    """As how many parameters unknowns count: of what all recordings share, what another stands in for is none."""
    columns = [i for i, u in enumerate(problem.unknowns) if u.experiment is None and u.target not in scales]
    own = sum(u.experiment is not None for u in problem.unknowns)
    J = jacobian(problem, x, np.array(columns), jobs=jobs)
    if isinstance(J, Failure):
        return own + len(columns)
    rows = np.concatenate([np.nan_to_num(j.reshape(-1, len(columns))) for j in J])
    return own + len(directions(rows, SAME_DIRECTION).T)


# --- the model ------------------------------------------------------------------------------------------


def with_relaxations(model: Model, groups: Groups, count: int) -> Model:
    """A model with relaxations in the place of orders.

    Parameters
    ----------
    model : Model
    groups : mapping
        Order → its states.
    count : int
        Relaxations of each.
    """
    where = [(i, name) for name, states in groups.items() for i in states]
    replaced = {i for i, _ in where}
    names = [q.parameter if isinstance(q, Complement) else q for q in model.orders]
    gone = {q for i, q in enumerate(names) if i in replaced}
    states = tuple(f"{model.states[i]} relaxing {j}" for i, _ in where for j in range(1, count + 1))
    parameters: list[Parameter] = []
    for name in groups:
        parameters.append(Parameter(f"share0_{name}", "1", 1.0, "what of the rate stays"))
        for j in range(1, count + 1):
            parameters.append(Parameter(f"share{j}_{name}", "1", 0.0, f"what relaxation {j} forgets"))
            parameters.append(Parameter(f"ln_tau{j}_{name}", "1", 0.0, "ln of its time constant in s"))
    place, n = {p.name: k for k, p in enumerate((*model.parameters, *parameters))}, len(model.states)
    memories = tuple(FadingState(
        i, shares=tuple(place[f"share{j}_{name}"] for j in range(count + 1)),
        times=tuple(place[f"ln_tau{j}_{name}"] for j in range(1, count + 1)),
        held=tuple(range(n + count * k, n + count * (k + 1))),
    ) for k, (i, name) in enumerate(where))  # fmt: skip
    return replace(
        model, memories=memories, grown=None,
        states=(*model.states, *states), parameters=(*model.parameters, *parameters),
        orders=(*(1.0 if i in replaced else q for i, q in enumerate(model.orders)), *(1.0 for _ in states)),
        integer_orders={q: v for q, v in model.integer_orders.items() if q not in gone},
        seen_in={q: v for q, v in model.seen_in.items() if q not in gone},
    )  # fmt: skip


def _relaxing(problem: Problem, best: Evaluation, groups: Groups, count: int) -> Problem:
    """The problem of that model; what has been before a record is unknown, where a past was recorded."""
    model = with_relaxations(problem.model, groups, count)
    step, end = _band(problem)
    begun = _begun(problem, best, groups, count, place=PLACES[-1])
    limits = math.log(SHORTEST * step), math.log(LONGEST * end)
    ranges = {n: Free(v, *limits, scale=1.0) if n.startswith("ln_tau") else _within_reach(v) for n, v in begun.items()}
    of_springpots = {problem.model.parameter_names[nu] for _, nu in problem.model.complements}
    fixed = {n: problem.parameter_starts[n] for n in groups if n in of_springpots}
    return replace(
        problem, model=model, method="pi2", memo=None, parameters={**problem.parameters, **fixed, **ranges},
        orders={n: v for n, v in problem.orders.items() if n in model.order_names},
        per_recording=tuple(n for n in problem.per_recording if n not in fixed),
        experiments=tuple(_without_past(e, model, len(problem.model.states)) for e in problem.experiments),
    )  # fmt: skip


def _within_reach(share: float) -> Free:
    """An amplitude of the kernel's sign, or none."""
    far = REACH * share / FAINT
    return Free(share, min(0.0, far), max(0.0, far), scale=abs(share))


def _without_past(e: Experiment, model: Model, base: int) -> Experiment:
    """What relaxations hold at the start is nothing, as the memory begins there; unknown after a past."""
    size = float(np.max(np.ptp(e.measured, axis=0)))
    held: float | Free = 0.0 if e.past is None else Free(0.0, -REACH * size, REACH * size, scale=size)
    return replace(e, past=None, past_inputs=None, initial={**e.initial, **dict.fromkeys(model.states[base:], held)})


# --- where it begins ------------------------------------------------------------------------------------


def _groups(problem: Problem, off: Sequence[str]) -> dict[str, list[int]]:
    """Order → the states that have it, or one that is tied to it."""
    names = [q.parameter if isinstance(q, Complement) else q for q in problem.model.orders]
    return {name: [i for i, q in enumerate(names) if problem.ties.get(str(q), q) == name] for name in off}


def _band(problem: Problem) -> tuple[float, float]:
    """The shortest step and the longest record [s]."""
    return min(e.step for e in problem.experiments), problem.seconds


def _begun(problem: Problem, best: Evaluation, groups: Groups, count: int, place: float) -> dict[str, float]:
    """Relaxations that come near the orders' kernels, with time constants spread over the record's band."""
    orders, (step, end) = problem.unpack(best.point, problem.experiments[0])[0], _band(problem)
    tau = step * (end / step) ** (place * np.arange(1, count + 1) / count)
    t = np.geomspace(step, end, 60)
    begun: dict[str, float] = {}
    for name, states in groups.items():
        q = float(orders[states[0]])
        kernel = t ** (q - 1) / math.gamma(q)
        sign = np.array([1.0, *(-1.0 if q > 1 else 1.0 for _ in tau)])
        columns = sign * np.exp(-t[:, None] * np.array([0.0, *(1 / tau)])) / kernel[:, None]
        share = np.maximum(nnls(columns, np.ones(len(t)))[0], FAINT * np.mean(kernel)) * sign
        begun |= {f"share{j}_{name}": float(a) for j, a in enumerate(share)}
        begun |= {f"ln_tau{j}_{name}": math.log(v) for j, v in enumerate(tau, 1)}
    return begun


def _faint(groups: Groups, rival: Problem, count: int) -> dict[str, float]:
    """One relaxation more, that does next to nothing yet: so no fit of more ends above one of fewer."""
    last = {f"share{count}_{name}" for name in groups}
    return {u.target: FAINT * u.range.start for u in rival.unknowns if u.target in last}
