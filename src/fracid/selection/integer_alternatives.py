r"""What else could it be?  Everything of integer order that a rig may have, and that orders may stand in for.

An order below 1 damps and bends the phase; so does nearly all that a model may lack.  Where a fit finds orders off
their integers, the same recordings are fitted with every order integer and, one after the other, with

====================  ============================================  ====================================================
what                  how the problem is changed                    where it could matter
====================  ============================================  ====================================================
friction              viscous and dry friction free                 where it is fixed and seen
drag                  ``drag_…`` free                               where the model has it and it is fixed
a cable               its stiffness free, and its rest              the same
a delay               ``delay`` of one channel free                 with two channels, or an input that varies
a low-pass            ``lowpass`` of one channel free               always
a scale               ``gain`` of one channel free                  with two channels, or an input that varies
a tilted axis         ``tilt_…`` free                               where the arm moves
what inputs do        held, or lines, between samples               where an input varies
changing friction     each third of a record has its own            where the record has no past
play                  ``play_…`` free                               where the model has it, and its joint moves
presliding            ``presliding_…`` free                         the same
Stribeck's friction   LuGre's model: ``stiction_…`` … free too      the same
an elastic arm        ``arm_stiffness`` … free                      the same
====================  ============================================  ====================================================

each from the best of those before it, the cheap ones first; where a record has a past, which tells the states of the
model as it is alone, none that changes a channel or adds states.  What lowers Schwarz's criterion stays for those that
follow, as a rig may have several of them; the first that does as well as the orders, at no limit of its own, ends it.
Those that add states to the model take many times as long: they are tried where nothing else contradicts the orders,
and last of all, what every model has, a finite memory (:mod:`fracid.selection.finite_memory`).

Before them come the models of integer order that a project names (``[[alternative]]``): who writes a model knows what
it is held against, as a springpot is against Maxwell elements.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from fracid.arrays import ByName
from fracid.estimation.climbing import embedded, entries
from fracid.estimation.horizons import Watch, lowest_from, uninterrupted
from fracid.estimation.search import search
from fracid.estimation.windows import in_parts, shared_values
from fracid.optimise import OPTIMISERS, Evaluation
from fracid.problem import Free, Problem
from fracid.problem.sensors import Quantity, Sensor
from fracid.safety.door import own_text
from fracid.selection.bic import EVEN, STRONG, does_as_well
from fracid.selection.finite_memory import finite_memories
from fracid.selection.integer_rival import (
    Alternative,
    Rival,
    Trial,
    beside_fit,
    freed_friction,
    freed_rests,
    gain_over,
    integer_rival,
    judged,
    moving,
)
from fracid.solver.inputs import Between

WAYS: Mapping[Between, str] = {"hold": "held", "line": "in lines"}
"""What an input does, in words."""

PARTS = 3
"""Of a recording, each with its own friction where that changes with time."""

ROUGH: Mapping[str, Any] = {"tolerance": 1e-3, "budget": 12}
"""Least squares from each entry of an element."""

FINE = {"tolerance": 1e-4, "budget": 12}
"""From the best of them."""

FAR, NEARER = 2.0, 0.9
"""Times the cost of the fractional fit, and of the integer-order model before: who is above both is left."""

TIMES, LEAST = 2.0, 3e8
"""The work that all this may take beside a fit: so many times that of its search, but for the least, some seconds."""


@dataclass(frozen=True)
class Element:
    """One thing that a rig may have."""

    name: str
    """``a delay of alpha``."""
    problem: Problem
    """The integer-order problem with it free."""
    off: dict[str, float]
    """What it frees, and where that does nothing."""
    slow: bool = False
    """Whether it adds states to the model, or unknowns by the dozen."""
    whole: Problem | None = None
    """The problem that was cut into parts; None where none was."""
    possible: bool = True
    """Whether it can be fitted: a past tells nothing of further states, nor of a channel that is late."""


Change = Callable[[Problem], Iterator[Element]]


# --- the table -------------------------------------------------------------------------------------------


def _rung(problem: Problem, name: str, rungs: Sequence[str], *, slow: bool = False) -> Iterator[Element]:
    """Elements of the joints that move."""
    joints = ("", *moving(problem))
    kinds = {n: k for n, k in problem.model.friction.items() if k.rung in rungs and k.joint in joints}
    ranges = freed_friction(problem, kinds)
    if not any(kinds[n].rung == rungs[-1] for n in ranges):
        return
    rests = freed_rests(problem, ranges)
    if slow and _has_past(problem):
        yield Element(name, problem, {}, possible=False)
        return
    off = {n: kinds[n].off for n in ranges} | {n: rest.start for n, rest in rests.items()}
    yield Element(name, replace(problem, parameters={**problem.parameters, **ranges, **rests}), off, slow)


def _channel(problem: Problem, quantity: Quantity, name: str, **value: Any) -> Iterator[Element]:
    """A quantity of one channel; of the first output only beside an input that varies, for the start is free."""
    together = not any(e.driven for e in problem.experiments) and quantity != "lowpass"
    for output in problem.outputs[together:]:
        tables = [e.sensors.get(output, Sensor()) for e in problem.experiments]
        off = getattr(Sensor(), quantity)
        if any(getattr(s, quantity) != off for s in tables):
            continue
        if _has_past(problem):
            yield Element(name.format(output), problem, {}, possible=False)
            continue
        experiments = tuple(
            replace(e, sensors={**e.sensors, output: replace(s, **{quantity: Free(**value)})})
            for e, s in zip(problem.experiments, tables, strict=True)
        )
        changed = replace(problem, experiments=experiments, memo=None)
        yield Element(name.format(output), changed, {f"{quantity}_{output}": off})


def other_inputs(problem: Problem) -> Iterator[tuple[str, Between, Problem]]:
    """Each input that varies, what else it may do between samples, and the problem with that."""
    if problem.model.input_rates or any(e.times is not None for e in problem.experiments):
        return  # a line's slope is the rate
    for i, name in enumerate(problem.model.inputs):
        varies = any(np.ptp(e.inputs[:, i]) > 0 for e in problem.experiments)
        now = {e.between.get(name, "line") for e in problem.experiments}
        for between in (way for way in WAYS if varies and now != {way}):
            experiments = tuple(replace(e, between={**e.between, name: between}) for e in problem.experiments)
            yield name, between, replace(problem, experiments=experiments, memo=None)


def _inputs(problem: Problem) -> Iterator[Element]:
    for name, between, changed in other_inputs(problem):
        yield Element(f'{name} {WAYS[between]} between samples (between = "{between}")', changed, {})


def _changing(problem: Problem) -> Iterator[Element]:
    """Friction of its own in each part of the record; where orders are integer a part needs no past."""
    kinds = problem.model.friction
    names = [n for n, v in problem.parameters.items() if n in kinds and kinds[n].damps_like_an_order
             and isinstance(v, Free) and n not in problem.per_recording]  # fmt: skip
    if names and not _has_past(problem) and len(problem.recordings) == len(problem.experiments):
        yield Element("friction that changes with time", in_parts(problem, PARTS, names), {}, slow=True, whole=problem)


def _has_past(problem: Problem) -> bool:
    return any(e.past is not None for e in problem.experiments)


_KINDS: dict[str, Any] = {"channel": _channel, "rung": _rung, "inputs": _inputs, "changing": _changing}

_ROWS = tomllib.loads(own_text("selection/integer_alternatives.toml"))["elements"]

ELEMENTS: tuple[Change, ...] = tuple(partial(_KINDS[row.pop("kind")], **row) for row in _ROWS)
"""What is tried after friction, in this order."""


# --- the trials ------------------------------------------------------------------------------------------


def integer_alternatives(
    problem: Problem, best: Evaluation, widths: ByName, *, slow: bool = True,
    own: Mapping[str, Problem] | None = None, starts: int = 1, seed: int = 1, watch: Watch | None = None,
) -> Alternative | None:  # fmt: skip
    """Fit what of integer order could explain the recordings as well as the orders of a fit do, until one does.

    Parameters
    ----------
    problem : Problem
    best : Evaluation
        Its minimum.
    widths : mapping
        Half the 95 % interval of each free order.
    slow : bool
        Whether what adds states to the model is tried too.
    own : mapping, optional
        Models of integer order that are tried too, by name, on the same recordings.
    starts, seed : int
        Of their search.
    watch : Watch, optional
        Counts the work, and ends it.

    Returns
    -------
    Alternative or None
        The one that comes nearest, with all trials; None where every order is integer within its interval, or no run
        of an integer-order model ends.

    Examples
    --------
    Dry friction, and a model without:

    >>> import fracid
    >>> from fracid.problem import Experiment
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 1.0, "mu": 1.0}, parameters={"coulomb_alpha": 2e-3},
    ...                       initial={"alpha": 0.5}, step=4e-3, end=4.0)
    >>> swing = Experiment("twin", 4e-3, run.states[:, [0, 2]], np.zeros((1, 1)))
    >>> problem = Problem(rig, (swing,), {"lambda": 1.0, "mu": Free(0.97, 0.5, 1.2)}, initial_state="held")
    >>> nearest = integer_alternatives(problem, problem.evaluate(problem.start), {"mu": 0.001})
    >>> [(trial.name, trial.as_well) for trial in nearest.trials]
    [('friction', True)]
    """
    watch = watch or Watch()
    here = integer_rival(problem, best, widths, watch=watch)
    if here is None:
        return None
    samples, trial = _tried("friction" if here.own else "the same model", here, problem, best)
    others = [*_of_the_project(own or {}, here, problem, best, starts=starts, seed=seed, watch=watch)]
    trials = [trial, *(t for _, _, t in others)]
    settled, base = any(t.as_good for t in trials), here
    for change in ELEMENTS:
        for element in () if settled else change(base.problem):
            if not element.possible or (element.slow and not slow) or watch.spent:
                trials.append(Trial(element.name, math.inf, math.inf))
                continue
            beside = _on_the_same_samples(problem, best, element)
            there = None if beside is None else fitted_with(element, base, beside.cost, watch=watch)
            if there is None or beside is None:
                continue
            n, found = _tried(element.name, there, problem, beside)
            trials.append(found)
            better = found.as_good or (element.whole is None and found.gain < trial.gain - STRONG)
            if better or (found.as_well and found.gain < trial.gain):
                here, samples, trial = there, n, found
            if better and element.whole is None:  # not on a record in parts
                base = there
            if found.as_good and not there.limited:
                settled = True
                break
    for there, n, found in others:
        if (found.as_good, -found.gain) > (settled and not any(t.as_good for _, _, t in others), -trial.gain):
            here, samples, trial = there, n, found
    as_well = any(t.as_well for t in trials)
    last = as_well or not slow or watch.spent
    memories = () if last else finite_memories(problem, best, [*here.off], watch=watch)
    orders = (*here.off, *(n for n, to in problem.ties.items() if to in here.off))
    nearest = Alternative(
        here.structure, orders, here.evaluation.cost, here.parameters, gain=trial.gain, effective_samples=samples,
        trials=tuple(trials), values=here.nested_in(problem), settles=trial.as_good and here.settles, memories=memories,
        cut=watch.spent, judged=judged(here, trial.gain) if as_well else None,
    )  # fmt: skip
    return beside_fit(nearest, here.off, problem, best.cost, best.cost)


def _of_the_project(
    own: Mapping[str, Problem], here: Rival, problem: Problem, best: Evaluation, starts: int, seed: int, watch: Watch
) -> Iterator[tuple[Rival, float, Trial]]:
    """The models that a project names at their minima; not one whose runs fail.

    One that is larger than the fractional model must earn its further unknowns by Schwarz's criterion, however low its
    cost: enough relaxations imitate a springpot over any record, as enough terms do any function, and what tells them
    apart is how many it takes.
    """
    for name, alternative in own.items():
        rng = np.random.default_rng(seed)
        end = uninterrupted(search(alternative, OPTIMISERS["multistart"], rng, starts=starts, watch=watch)[0]).best
        if end.residuals is not None:
            rival = Rival(alternative, end, name, here.off, nested=False)
            yield rival, *_tried(name, rival, problem, best)


def _tried(name: str, rival: Rival, problem: Problem, best: Evaluation) -> tuple[float, Trial]:
    """The samples that residuals are worth, and whether a model of integer order does as well as a fractional fit."""
    samples, gain = gain_over(rival, problem, best)
    cost, more = rival.evaluation.cost, len(rival.problem.names) - len(problem.names)
    another = not rival.nested or len(rival.problem.experiments) > len(problem.experiments)  # or in parts
    larger = another and more > 0
    as_good, as_well = (does_as_well(gain, cost, best.cost, larger=larger, most=most) for most in (EVEN, STRONG))
    return samples, Trial(name, cost, gain, as_well=as_well, as_good=as_good)


def fitted_with(element: Element, here: Rival, goal: float, *, watch: Watch | None = None) -> Rival | None:
    """Least squares from the best integer-order model so far, with the element at each of its entries, or left off.

    Parameters
    ----------
    element : Element
    here : Rival
        That model at its minimum.
    goal : float
        A cost; what is far from it, and hardly nearer than before, is left there.
    watch : Watch, optional
        Counts the work, and ends it.

    Returns
    -------
    Rival or None
        None where its run fails.
    """
    problem, watch = element.problem, watch or Watch()
    kinds = [n for n in element.off if n in problem.model.friction] if element.slow else []
    values = {**shared_values(here.problem, here.evaluation.point), **here.values}
    starts = [embedded(problem, values | entry) for entry in entries(problem, kinds)]
    ends = [lowest_from(problem, x, watch, **ROUGH) for x in starts]
    if element.off:  # it holds that model
        ends.append(problem.evaluate(embedded(problem, values | element.off)))
    end = min(ends, key=lambda e: e.cost)
    if end.cost < FAR * goal or end.cost < NEARER * here.evaluation.cost:
        end = lowest_from(problem, end.point, watch, **FINE)
    if end.residuals is None:
        return None
    return Rival(problem, end, here.integers, here.off, own=(*here.own, *element.off),
                 elements=(*here.elements, element.name))  # fmt: skip


def _on_the_same_samples(problem: Problem, best: Evaluation, element: Element) -> Evaluation | None:
    """The fractional fit where the element is scored: a delay leaves out the first samples."""
    pairs = [*zip(problem.experiments, (element.whole or element.problem).experiments, strict=True)]
    if all(e.samples == other.samples for e, other in pairs):
        return best
    its_own = tuple(replace(e, sensors=other.sensors) for e, other in pairs)
    same = replace(problem, experiments=its_own, memo=None)  # what its inputs do between samples stays
    off = {f"lowpass_{output}": 0.0 for output in problem.outputs}
    evaluation = same.evaluate(embedded(same, off | problem.named(best.point)))
    return replace(evaluation, point=best.point) if evaluation.residuals is not None else None
