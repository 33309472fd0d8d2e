r"""How far the best integer-order model stays from each candidate, in standard deviations of the noise.

With :math:`r = y - y_1`, what an integer-order model misses of the simulated experiment, and J the derivatives of its
outputs, the least :math:`\sum_e (r_e - J_e p)'W_e(r_e - J_e p)` over one p for all experiments is

.. math::  T = c - b'A^{-1}b, \qquad c = \sum_e r_e'W_er_e, \quad b = \sum_e J_e'W_er_e, \quad A = \sum_e J_e'W_eJ_e ,

initial states eliminated from each.  It is linear about the integer-order model that fits a first set of experiments
best, by least squares, and again about the one that fits the chosen set.  A free and a clamped arm have such a model
each, :math:`p_e`, since what fits one may be far from the other; r is then :math:`y - y_1(p_e) + J_e(p_e - p_0)`, of
one origin.

The alternatives that choose are those of the claim that cost no further state: viscous and dry friction free, and
beside them one at a time what :data:`fracid.selection.integer_alternatives.ELEMENTS` has, a delay, a low-pass, a scale,
drag, a cable, a tilted axis.  T is that of the nearest, of the planned experiments alone: what is recorded does not
count, since its residual may be what the plan is to explain.

Of several orders nobody knows beforehand which are fractional.  A plan for a rig on which all are may rest on one of
them, and a rig on which another is is then called integer: a clamped arm shows nothing of λ.  So each order is set off
its integer alone, the others at theirs, and :math:`\sum_i\log(1 + T_i)` is made greatest: by how much each is off then
makes little difference to the choice, and one that no candidate shows has no say.

Those that add states (play, presliding, Stribeck's friction, an elastic arm) have no derivative where they are off.
They are fitted to the chosen set, by least squares as the claim does, and their distances stand beside
(:func:`with_states`); of sets with both arms, each arm's element is its own, so that the distance is no more than that
of one element.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain

import numpy as np

from fracid.arrays import FloatArray, by_name
from fracid.errors import Failure, InputError
from fracid.estimation.climbing import starting_at
from fracid.estimation.derivatives import differences, jacobian
from fracid.estimation.horizons import Watch, from_start, lowest_from
from fracid.experiments.criteria import distance
from fracid.experiments.exchange import Criterion, exchange, of_each
from fracid.experiments.space import ARMS, Candidate, by_motion
from fracid.experiments.subject import SAYS, Subject
from fracid.optimise import Evaluation
from fracid.problem import Problem
from fracid.selection.integer_alternatives import ELEMENTS, Element, fitted_with
from fracid.selection.integer_rival import Rival, freed_friction, integer_values, moving
from fracid.tasks.job import in_threads

FRICTION = "friction"
"""The alternative with every order integer and friction free."""

SHORTLIST = 60
"""Candidates that are looked at again: about the alternative that fits the chosen set, or with other values."""

CLOSE = 1e-6
"""An order that is nearer to an integer is one."""

AT_BOUND = 1e-3
"""Part of its range within which a parameter is held by a bound: no alternative may go beyond."""

VAGUE = 1e-8
"""Curvature of what no experiment shows, in typical sizes."""


@dataclass(frozen=True)
class Alternatives:
    """What the models of all arms may move, from one origin, and sums of T for each candidate."""

    origin: Mapping[str, float]
    """Value of each parameter that all alternatives may move."""
    columns: Mapping[str, tuple[int, ...]]
    """Alternative → which of what is free it may move."""
    moved: tuple[str, ...]
    """All that is free, in order."""
    scale: FloatArray
    """Typical size of each, shape (n,)."""
    allowed: tuple[int, ...] = ()
    """Which of the candidates the parts are of."""
    parts: tuple[FloatArray, ...] = ()
    """c, b and A of each candidate, shapes (n_candidates,), (n_candidates, n) and (n_candidates, n, n)."""

    @classmethod
    def of(cls, rivals: Sequence[_Rival]) -> Alternatives:
        """Before any candidate."""
        origin = {n: v for rival in reversed(rivals) for n, v in rival.values.items()}
        elements = dict.fromkeys(element for rival in rivals for element in rival.extra)
        extra = {e: dict.fromkeys(n for rival in rivals for n in rival.extra.get(e, ())) for e in elements}
        moved = tuple(dict.fromkeys((*origin, *(n for more in extra.values() for n in more))))
        sizes = {n: size for rival in reversed(rivals) for n, size in rival.sizes.items()}
        own = tuple(range(len(origin)))
        columns = {FRICTION: own} | {e: (*own, *map(moved.index, names)) for e, names in extra.items()}
        return cls(origin, columns, moved, np.array([sizes[n] for n in moved]))

    @property
    def base(self) -> tuple[FloatArray, ...]:
        """The sums without any candidate, shapes (), (n,) and (n, n)."""
        return np.zeros(()), np.zeros(len(self.moved)), VAGUE * np.diag(self.scale**-2.0)

    def objective(self, sums: tuple[FloatArray, ...]) -> FloatArray:
        """−log(1 + T) of the nearest alternative."""
        return np.asarray(-np.log1p(np.maximum(distance(sums, [*self.columns.values()], self.scale).min(axis=-1), 0.0)))

    def distances(self, chosen: Sequence[int]) -> Mapping[str, float]:
        """Alternative → its distance from a set of experiments, in standard deviations."""
        at = [self.allowed.index(i) for i in chosen if i in self.allowed]
        sums = tuple(b + p[at].sum(axis=0) for p, b in zip(self.parts, self.base, strict=True))
        return by_name(self.columns, np.sqrt(distance(sums, [*self.columns.values()], self.scale)))


@dataclass(frozen=True)
class OrdersAlone:
    """The alternatives of rigs on each of which one order alone is off its integer."""

    of: Mapping[str, Alternatives]
    """Order → the alternatives where it is the one."""

    @cached_property
    def allowed(self) -> tuple[int, ...]:
        """Candidates that every one of them has."""
        return tuple(sorted(set.intersection(*(set(table.allowed) for table in self.of.values()))))

    @cached_property
    def criteria(self) -> tuple[Criterion, ...]:
        """−log(1 + T) of each order, whose mean is minimised."""
        at = {order: [table.allowed.index(i) for i in self.allowed] for order, table in self.of.items()}
        return tuple(Criterion(table.objective, tuple(part[at[order]] for part in table.parts), table.base)
                     for order, table in self.of.items())  # fmt: skip

    def chosen(self, count: int) -> tuple[int, ...]:
        """The set that tells all orders best.

        Raises
        ------
        InputError
            If no candidate has the alternatives of all orders.
        """
        if not self.allowed:
            raise InputError(SAYS("no-candidate"))
        return tuple(self.allowed[i] for i in exchange(self.criteria, count))

    def short(self, most: int) -> list[int]:
        """The candidates that tell most by themselves."""
        return [self.allowed[int(i)] for i in np.argsort(of_each(self.criteria, ()))[:most]]

    def nearest(self, chosen: Sequence[int]) -> dict[str, float]:
        """Order → the distance of the alternative nearest to a set, in standard deviations."""
        return {order: min(table.distances(chosen).values()) for order, table in self.of.items()}


def orders_alone(subject: Subject, candidates: Sequence[Candidate], count: int, *, of: Sequence[str]) -> OrdersAlone:
    """Linearise the integer-order alternatives of each candidate, twice: about a first fit, and about the chosen set's.

    Parameters
    ----------
    subject : Subject
        Of a fractional model.
    candidates : sequence of Candidate
    count : int
        How many experiments are chosen.
    of : sequence of str
        The orders to tell; all that are off their integers if left out.

    Raises
    ------
    InputError
        If every order is an integer already, or no run of the integer-order model ends.

    Examples
    --------
    >>> import fracid
    >>> from fracid.experiments.choice import subject_of
    >>> space = fracid.DesignSpace(release=(10, 45, 90), seconds=4, rate=100)
    >>> subject = subject_of(fracid.rotary_pendulum("qube-servo2"), space, orders={"mu": 0.95})
    >>> table = orders_alone(subject, space.candidates, 1, of=()).of["mu"]
    >>> next(iter(table.columns)), table.parts[0].shape
    ('friction', (3,))
    """
    rigs = _one_order_off(subject, of)
    few = [c for own in _by_arm(candidates).values() for c in _few(own)]
    rivals = {n: rivals_of(rig, few) for n, rig in rigs.items()}
    every = range(len(candidates))
    first = OrdersAlone({n: alternatives_of(rig, candidates, every, rivals[n]) for n, rig in rigs.items()})
    chosen = first.chosen(count)
    short, some = sorted({*chosen, *first.short(SHORTLIST)}), [candidates[i] for i in chosen]
    rivals = {n: rivals_of(rig, some, rivals[n]) for n, rig in rigs.items()}
    return OrdersAlone({n: alternatives_of(rig, candidates, short, rivals[n]) for n, rig in rigs.items()})


def _one_order_off(subject: Subject, of: Sequence[str]) -> dict[str, Subject]:
    """Order → the rig on which it alone is off its integer."""
    orders, integers = subject.problem.order_starts, integer_values(subject.problem)
    off = [n for n, v in integers.items()
           if n in orders and not (isinstance(v, float | int) and abs(v - orders[n]) < CLOSE)]  # fmt: skip
    if not off:
        raise InputError(SAYS("all-integer"))
    integer = {n: float(v) for n, v in integers.items() if n in off and isinstance(v, float | int)}
    told = [n for n in off if n in of] or off
    return {n: subject.at({m: v for m, v in integer.items() if m != n}) for n in told}


def rivals_of(
    subject: Subject, experiments: Sequence[Candidate], known: Mapping[str, _Rival] | None = None
) -> dict[str, _Rival]:
    """Arm → the integer-order model that fits its experiments best; of an arm without any the one that is known."""
    fitted = {arm: _rival(subject, some) for arm, some in _by_arm([*dict.fromkeys(experiments)]).items()}
    rivals = {arm: rival for arm, rival in {**(known or {}), **fitted}.items() if rival is not None}
    if not rivals:
        raise InputError("No run of the model reaches the end of a candidate.")
    return {arm: rivals[arm] for arm in ARMS if arm in rivals}


def with_states(subject: Subject, experiments: Sequence[Candidate], rivals: Mapping[str, _Rival]) -> dict[str, float]:
    """How far each alternative that adds states stays from a set of experiments, fitted to it.

    Parameters
    ----------
    subject : Subject
        Of a fractional model.
    experiments : sequence of Candidate
        Those that are chosen, repetitions too.
    rivals : mapping
        Arm → the integer-order model that fits them best (:func:`rivals_of`).

    Returns
    -------
    dict
        Alternative → distance in standard deviations of the noise.

    Examples
    --------
    >>> import fracid
    >>> from fracid.experiments.choice import subject_of
    >>> space = fracid.DesignSpace(release=30, seconds=2, rate=100)
    >>> subject = subject_of(fracid.rotary_pendulum("stepper-freeswing"), space, orders={"mu": 0.95})
    >>> list(with_states(subject, space.candidates, rivals_of(subject, space.candidates)))
    ['presliding', "Stribeck's friction"]
    """
    friction, squares = 0.0, dict[str, float]()
    for arm, rival in rivals.items():
        times = Counter(c for c in experiments if c.arm == arm)
        counts = [*times.values()][: len(rival.problem.experiments)]
        own = Rival(rival.problem, rival.best, "every order 1", {})
        without = _square(subject, own, counts)
        for element in _elements(rival.problem, slow=True):
            there = fitted_with(element, own, 0.0, watch=Watch(subject.jobs))
            left = without if there is None else min(without, _square(subject, there, counts))
            squares[element.name] = squares.get(element.name, 0.0) + left - without
        friction += without
    return {name: math.sqrt(max(0.0, friction + less)) for name, less in squares.items()}


def _square(subject: Subject, rival: Rival, counts: Sequence[int]) -> float:
    """What an integer-order model misses of some experiments, each so many times, in variances of the noise."""
    errors = rival.problem.errors(rival.evaluation.point)
    if isinstance(errors, Failure):
        return math.inf
    variances = np.array([subject.noise_of(n).variance for n in rival.problem.outputs])
    return subject.worth * sum(k * float(np.sum(e**2 / variances)) for k, e in zip(counts, errors, strict=True))


def _by_arm(candidates: Sequence[Candidate]) -> dict[str, list[Candidate]]:
    """Arm → its candidates, the free one first."""
    arms = {arm: [c for c in candidates if c.arm == arm] for arm in ARMS}
    return {arm: own for arm, own in arms.items() if own}


def _few(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Two that differ most in their release, as a first set."""
    nearest_first = sorted(candidates, key=lambda c: (c.voltage is not None, abs(c.release)))
    same = [c for c in nearest_first if c.voltage == nearest_first[0].voltage]
    return [*dict.fromkeys((same[0], same[-1]))]


def alternatives_of(
    subject: Subject, candidates: Sequence[Candidate], which: Sequence[int], rivals: Mapping[str, _Rival]
) -> Alternatives:
    """The integer-order alternatives of some candidates, about the models that fit them best."""
    none = Alternatives.of([*rivals.values()])

    def sums(group: list[int]) -> list[tuple[FloatArray, ...]]:
        at = [which[i] for i in group]
        longest = max((candidates[i] for i in at), key=lambda c: c.seconds)
        problem = _simulated(subject, longest, "planned")
        rival = rivals.get(longest.arm)
        if problem is None or rival is None:
            return []
        return _sums(subject, rival, none, problem, samples=[candidates[i].samples for i in at])

    groups = by_motion([candidates[i] for i in which])
    rows = {which[i]: row for group, found in zip(groups, in_threads(subject.jobs, sums, groups), strict=True)
            for i, row in zip(group, found, strict=False)}  # fmt: skip
    if not rows:
        raise InputError("No run of the integer-order model reaches the end of a candidate.")
    allowed = tuple(sorted(rows))
    parts = tuple(np.array(part) for part in zip(*(rows[i] for i in allowed), strict=True))
    return replace(none, allowed=allowed, parts=parts)


@dataclass(frozen=True)
class _Rival:
    """The integer-order model that fits some experiments of one arm best, and what it may have beside."""

    problem: Problem
    """Of those experiments, starting at the best."""
    best: Evaluation
    values: Mapping[str, float]
    """Of what is free and inside its bounds, the best."""
    sizes: Mapping[str, float]
    """Of those and of what the elements free, how large they typically are."""
    extra: Mapping[str, tuple[str, ...]]
    """Element → what it frees."""


def _rival(subject: Subject, experiments: Sequence[Candidate]) -> _Rival | None:
    """Fit the integer-order model, friction free, to what the fractional one does; None where no run of that ends."""
    simulated = [_simulated(subject, c, f"planned {k}") for k, c in enumerate(experiments)]
    if not (problems := [p for p in simulated if p is not None]):
        return None
    data = tuple(p.experiments[0] for p in problems)
    joint = replace(problems[0], experiments=data, substeps=max(p.substeps for p in problems))
    joints, kinds = ("", *moving(joint)), joint.model.friction
    friction = {n: v for n, v in freed_friction(joint).items() if kinds[n].joint in joints}
    joint = replace(joint, orders=integer_values(joint), parameters={**joint.parameters, **friction})
    grown = from_start(joint, Watch(subject.jobs)).point  # on the whole at once it may end a swing ahead
    ends = [lowest_from(joint, x, Watch(subject.jobs), tolerance=1e-8) for x in (joint.start, grown)]
    best = min(ends, key=lambda e: e.cost)
    joint = starting_at(joint, joint.named(best.point))
    elements = {e.name: e.problem for e in _elements(joint)}
    extra = {name: tuple(n for n in p.names if n not in joint.names) for name, p in elements.items()}
    width = joint.space.upper - joint.space.lower
    inside = np.minimum(best.point - joint.space.lower, joint.space.upper - best.point) > AT_BOUND * width
    values = {u.name: float(v) for u, v, free in zip(joint.unknowns, best.point, inside, strict=True)
              if u.experiment is None and free}  # fmt: skip
    sizes = {n: size for p in (joint, *elements.values()) for n, size in p.named(p.space.sizes(p.start)).items()}
    return _Rival(joint, best, values, sizes, extra=extra)


def _elements(problem: Problem, *, slow: bool = False) -> Iterator[Element]:
    """What costs no further state, one at a time; or what does."""
    for e in chain.from_iterable(change(problem) for change in ELEMENTS):
        if e.possible and e.slow == slow and e.whole is None and (slow or e.off):
            yield e


def _simulated(subject: Subject, c: Candidate, name: str) -> Problem | None:
    """A candidate's problem with the fractional model's outputs for what is measured; None where its run fails."""
    p = subject.problem_of(c)
    outputs = p.fitted(p.start, p.experiments[0])
    if isinstance(outputs, Failure):
        return None
    return replace(p, experiments=(replace(p.experiments[0], name=name, measured=outputs),))


def _sums(
    subject: Subject, rival: _Rival, table: Alternatives, problem: Problem, samples: Sequence[int]
) -> list[tuple[FloatArray, ...]]:
    """c, b and A of the beginnings of one experiment; none where the integer-order model fails."""
    here = replace(problem, orders=rival.problem.orders, parameters=rival.problem.parameters, memo=None)
    J = differences(here, here.start, np.arange(len(here.names)))
    if isinstance(J, Failure):
        return []
    columns = {u.name: J.parts[0][..., i] for i, u in enumerate(here.unknowns)}
    own = [n for n, u in zip(here.names, here.unknowns, strict=True) if u.experiment is not None]
    for element in _elements(here):
        names = [n for n in rival.extra.get(element.name, ()) if n in element.problem.names]
        at = np.array([element.problem.names.index(n) for n in names], dtype=np.intp)
        more = jacobian(element.problem, element.problem.start, at)
        if not isinstance(more, Failure):
            columns |= {n: more[0][..., k] for k, n in enumerate(names)}
    still = np.zeros(J.errors[0].shape)
    root = np.array([1 / math.sqrt(subject.noise_of(n).variance) for n in problem.outputs])
    rows = np.stack([-columns.get(n, still) for n in (*table.moved, *own)], axis=-1) * root[:, None]
    n, off = len(table.moved), np.array([rival.values.get(n, v) - v for n, v in table.origin.items()])
    missed = J.errors[0] * root + rows[..., : len(off)] @ off
    sums: list[tuple[FloatArray, ...]] = []
    for count in samples:
        flat, r = rows[:count].reshape(-1, rows.shape[-1]), missed[:count].ravel()
        q, _ = np.linalg.qr(flat[:, n:] / np.maximum(np.linalg.norm(flat[:, n:], axis=0), 1e-300))
        shared, r = flat[:, :n] - q @ (q.T @ flat[:, :n]), r - q @ (q.T @ r)
        weighed, r_weighed = subject.worth * shared.T, subject.worth * r
        sums.append((np.asarray(r_weighed @ r), weighed @ r, weighed @ shared))
    return sums
