r"""The ladder of structures: how much friction a model has, and whether its orders are free.

An order below 1 damps like a viscous friction of :math:`ζ = \tfrac{π}{2}(1 - μ)`, so a fractional model must be held
against integer-order ones with all the friction that a rig may have.  From one :class:`~fracid.Problem` come

==============================  ====================================  ==================================================
rung                            what is free beside the constants     parameters of the model by the names
==============================  ====================================  ==================================================
viscous                         :math:`b\,v`                          ``b_…``
viscous + Coulomb               :math:`f \tanh(v/v_s)` too            ``coulomb_…``
… + load                        :math:`f` grows with the load         ``load_…``
… + Stribeck                    and falls with the speed              ``stiction_…``, ``stribeck_speed_…`` of a joint
… + drag                        :math:`d\,v|v|` too                   ``drag_…``
… + cable                       :math:`k\,(θ - θ_0)` too              ``cable_…``, ``spring_…``, and the spring's rest
… + presliding                  :math:`σ_0 z` in tanh's place         ``presliding_…``: Dahl's model
… + LuGre                       :math:`g(v)`, :math:`σ_1 \dot z` too  ``stiction_…``, ``stribeck_speed_…``,
                                                                      ``presliding_damping_…``
… + play                        the gap of a gear                     ``play_…``
… + springpot                   :math:`c\,D^ν θ` too                  ``springpot_…``, ``springpot_order_…``
… + elastic arm                 a spring between hub and arm          ``arm_stiffness``, ``elastic_…`` of a joint
==============================  ====================================  ==================================================

A model whose parameters are friction of another kind (:mod:`fracid.models.friction`) has rungs of its own above these.
There is each rung with every order 1, and with orders free.  *Viscous, orders free* is the paper's structure.  Where a
model says that an order is another integer (``Model.integer_orders``) *orders 1* stands for that, and a note says so;
an order without integer value is free in every structure.

What a rung frees has the range that the problem gives it, else one up to half of gravity's torque; on the rungs below
it is 0.  All else that the problem leaves free stays so: inertias, rests (each recording its own), initial states.
Orders are free as the problem has them; where it fixes all, all are freed.  Ranges are widened to hold 0, and 1 for
orders, so that each rung holds the ones below it, and can never fit worse.

**The project's own structure**, with what it frees and fixes, is there too, with every order 1 and with orders free,
where no rung is the same: who has found a friction model compares from there.  Not where rungs are picked.  A model
that has no friction is there as it is alone.

A project may name models of integer order (``[[alternative]]``), which are structures beside all these.

What the fitted recordings do not see (the friction of a clamped arm, a motor's constant in a free release) is 0 if it
is friction, else it keeps its start; it is no parameter of the fit, and that is said.  A rung of which the recordings
see nothing, or that the model does not have, is left out.

All structures are solved by one method, of second order or better: a scheme of first order manufactures orders.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import Failure, InputError, entry_of, refuse_unknown
from fracid.estimation.climbing import embedded
from fracid.findings import Words
from fracid.models.friction import BY_NAME, LOAD, RUNGS
from fracid.problem import Experiment, Free, Problem, Tied
from fracid.problem.unknowns import Value
from fracid.selection.integer_rival import freed_friction, freed_rests, moving
from fracid.signals.noise import noise_floor
from fracid.solver.methods import METHODS

SAYS = Words("selection/ladder.toml")

PAPER = ("viscous", True)
"""The paper's structure: its friction, and that its orders are free."""

OWN = "as in the project"
"""What the friction of the project's own structure is called."""

BUILT_IN = ("viscous", "Coulomb", "drag", "cable", "presliding", "LuGre")
"""The rungs that are climbed where nobody says, and load and Stribeck where the model has them: each fit takes longer
than the one below."""

SERVO = ("viscous", "Coulomb", "load", "Stribeck", "presliding", "elastic arm")
"""Those of a project that frees friction over load: a weight is the spring, and its zero the rest."""

ORDER = Free(1.0, 0.5, 1.2)
"""The range of an order that the problem gives none."""

MOVE = 1e-2
"""An unknown is moved by this part of its range to see whether the recordings see it."""

SEEN, OF_NOISE = 1e-4, 1e-2
"""They do if that changes an output by this part of its scatter, or by this one of its noise: as much as the noise over
the whole range."""


@dataclass(frozen=True)
class Structure:
    """One model of the ladder."""

    friction: str
    """``viscous + Coulomb``."""
    fractional: bool
    """Whether orders are free."""
    problem: Problem
    """On the fitted recordings, without what they do not see."""
    whole: Problem
    """The same with it: a recording that is not fitted may see more."""
    below: tuple[str, ...]
    """Names of the structures that it holds, one rung down or with orders 1."""
    given: bool = False
    """Whether it is the project as it stands."""

    @property
    def name(self) -> str:
        """``viscous + Coulomb, orders free``."""
        return name_of(self.friction, self.fractional)

    def embed(self, values: Mapping[str, float]) -> FloatArray:
        """The unknowns at which it is, within its bounds, the structure that has these `values`, shape (n_unknowns,).

        Friction that they do not mention is off, orders are integer.

        Examples
        --------
        >>> import fracid
        >>> from fracid.problem import Experiment
        >>> still = Experiment("still", 0.1, np.zeros((9, 2)), np.zeros((1, 1)))
        >>> problem = Problem(fracid.rotary_pendulum("srv02-rotpen"), (still,), {"lambda": 1.0, "mu": 1.0})
        >>> paper = ladder(problem)["viscous, orders free"]
        >>> paper.embed({"b_theta": 2e-3, "b_alpha": 1e-4})[:4].tolist()  # both orders 1
        [1.0, 1.0, 0.002, 0.0001]
        """
        model, unknowns = self.problem.model, self.problem.unknowns
        orders = {u.name: model.solved_at(u.target, u.range.start) for u in unknowns if u.kind == "order"}
        off = {n: kind.off for n, kind in model.friction.items()}
        return embedded(self.problem, {**off, **orders, **values})

    def on(self, values: Mapping[str, float], recording: Experiment) -> Problem:
        """The problem of a recording that is not fitted: free are its initial state and what it has for itself."""
        known = {n: v for n, v in recording.initial.items() if n in self.whole.model.states}
        recording = replace(recording, initial=known)
        alone = self.whole.with_shared(self.whole.point(values), (recording,))
        return held(alone, unseen(alone, 0.0))


@dataclass(frozen=True)
class Ladder:
    """Structures from the poorest to the richest, each rung with orders 1 and with orders free."""

    structures: tuple[Structure, ...]
    notes: tuple[str, ...]
    """What was left out or changed, in sentences."""
    given: Problem
    """The project as it stands, solved as all structures are."""

    def __getitem__(self, name: str) -> Structure:
        """The structure of that name; an InputError names those that there are."""
        return entry_of("structure", {s.name: s for s in self.structures}, name)

    def solved_with(self, substeps: int) -> Ladder:
        """The same at other steps a sample; made anew there, what an unknown hardly does might leave it out, or not."""
        at = partial(replace, substeps=substeps)
        structures = tuple(replace(s, problem=at(s.problem), whole=at(s.whole)) for s in self.structures)
        return replace(self, structures=structures, given=at(self.given))


def name_of(friction: str, fractional: bool) -> str:
    """A structure's name."""
    return f"{friction}, orders {'free' if fractional else '1'}"


def ladder(
    problem: Problem,
    *,
    keep: Collection[str] = (),
    rungs: Collection[str] | None = None,
    others: Sequence[Experiment] = (),
    alternatives: Mapping[str, Problem] | None = None,
) -> Ladder:
    """Make the ladder of a problem.

    Parameters
    ----------
    problem : Problem
        With the recordings that are fitted.
    keep : collection of str
        Parameters of friction that stay as the problem has them, on all rungs.
    rungs : collection of str, optional
        Which rungs are climbed, a model's own always are; up to LuGre's but for a tilt's, with the project's own
        structure, if left out, and all with it if all are named.
    others : sequence of Experiment
        Recordings that are not fitted; a rung of which only they see something is there too.
    alternatives : mapping, optional
        Models of integer order for the same recordings, by name.

    Returns
    -------
    Ladder

    Raises
    ------
    InputError
        If no order is there to be compared, or `keep` or `rungs` name what there is not.

    Examples
    --------
    >>> import fracid
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 1.0, "mu": 1.0}, initial={"alpha": 0.5}, step=4e-3, end=3.0)
    >>> swing = Experiment("twin", 4e-3, run.states[:, [0, 2]], np.zeros((1, 1)))
    >>> problem = Problem(rig, (swing,), {"lambda": 1.0, "mu": Free(1.0, 0.5, 1.2)}, initial_state="held")
    >>> found = ladder(problem, rungs=["viscous", "Coulomb", "presliding"])
    >>> [s.friction for s in found.structures if s.fractional]
    ['viscous', 'viscous + Coulomb', 'viscous + Coulomb + presliding']
    >>> found["viscous + Coulomb, orders free"].problem.names
    ('mu', 'b_theta', 'b_alpha', 'coulomb_theta', 'coulomb_alpha')
    """
    refuse_unknown("parameter to keep", problem.model.parameter_names, *keep)
    refuse_unknown("rung", RUNGS, *(rungs or ()))
    problem, notes = _solved_well(problem)
    given = held(problem, unseen(problem, 0.0))
    beside = tuple(Structure(n, False, held(p, unseen(p, 0.0)), p, below=()) for n, p in (alternatives or {}).items())
    if not problem.model.friction:
        found = _as_it_is(problem, problem.model.name, ())
        _require_both((*found, *beside), problem)
        if not beside:
            notes.append(SAYS("no-friction", problem=problem))
        return Ladder(_marked((*found, *beside), given), tuple(notes), given)
    notes += _not_1(problem)
    own = {k.rung for k in problem.model.friction.values()}
    asked = {kind.rung for n, kind in problem.model.friction.items() if n in problem.names}
    usual = SERVO if LOAD.rung in asked else (*BUILT_IN, *(own & {*SERVO}))
    chosen = {*usual} if rungs is None else {*rungs}
    names, missing = _rungs(problem, keep, chosen | own - {*RUNGS})
    top = _free(problem, names, tuple(names))
    blind = unseen(top, SEEN)
    kinds, moves = problem.model.friction, moving(problem)  # an arm that is clamped shows no lean of its axis
    blind |= {n for rung in names.values() for n in rung if kinds[n].signed and kinds[n].joint not in moves}
    nowhere = blind - {n for e in others for n in _seen_in(e, top)}
    exclusions = {rung: n for rung, n in names.items() if set(n) <= nowhere}
    names = {rung: n for rung, n in names.items() if rung not in exclusions}
    if not names:
        raise InputError(SAYS("no-structures"))
    notes += missing if own & {*RUNGS} else []
    notes += [f"The rung + {r} is skipped: no recording depends on {' or '.join(n)}." for r, n in exclusions.items()]
    alone = sorted(blind - {n for rung in exclusions.values() for name in rung for n in (name, *kinds[name].rests)})
    notes += [f"The fitted recordings do not depend on {n}: {_instead(top, n)}." for n in alone]
    found = tuple(_structures(problem, names, blind))
    if rungs is None or chosen >= {*RUNGS}:
        found = _with_own(problem, found)
    return Ladder(_marked((*found, *beside), given), tuple(notes), given)


def _seen_in(e: Experiment, top: Problem) -> set[str]:
    """What a recording that is not fitted sees; nothing where the run fails."""
    alone = top.of(e)
    if isinstance(alone.errors(alone.start), Failure):
        return set()
    return {u.target for u in alone.unknowns} - unseen(alone, SEEN)


def _not_1(problem: Problem) -> list[str]:
    """Where the model's integer orders are not 1 what "orders 1" stands for; refused where it has none at all."""
    values = {n: problem.model.integer_order(n) for n in problem.orders}
    stay = [n for n, v in values.items() if v is None]
    if values and len(stay) == len(values):
        raise InputError(SAYS("no-integer", problem=problem, orders=" and ".join(stay)))
    other = [f"{n} = {v:g}" for n, v in values.items() if v not in (None, 1.0)]
    notes = [f"The model defines its integer orders: where a structure has orders 1, {', '.join(other)}."] * bool(other)
    return notes + [f"{n} has no integer value by its model: it is free in every structure." for n in stay]


def _solved_well(problem: Problem) -> tuple[Problem, list[str]]:
    """One method for all, and each recording's own rests."""
    rests = [u.target for u in problem.unknowns
             if u.target in problem.model.rests and u.target not in problem.per_recording]  # fmt: skip
    problem = replace(problem, per_recording=(*problem.per_recording, *dict.fromkeys(rests)))
    if METHODS[problem.method].convergence_order >= 2:
        return problem, []
    return replace(problem, method="pi2"), [SAYS("first-order", method=problem.method)]


Rungs = dict[str, tuple[str, ...]]
"""The parameters of each rung."""


def _rungs(problem: Problem, keep: Collection[str], on: Collection[str]) -> tuple[Rungs, list[str]]:
    """Rung → the parameters that it adds; and in words what the model does not have."""
    kinds = problem.model.friction
    names = [rung for rung in dict.fromkeys((*RUNGS, *(kind.rung for kind in kinds.values()))) if rung in on]
    every = {rung: [n for n, kind in kinds.items() if kind.rung == rung] for rung in names}
    rungs = {rung: tuple(n for n in names if n not in keep) for rung, names in every.items()}
    begin = {rung: [f"{n}…" for n, kind in BY_NAME.items() if kind.rung == rung] for rung in names}  # by their names
    absent = [f"{rung} ({' or '.join(begin[rung])})" for rung, names in every.items() if not names]
    missing = [f"The model {problem.model.name} has no parameter of the rungs {', '.join(absent)}."] if absent else []
    return {rung: names for rung, names in rungs.items() if names}, missing


def _structures(problem: Problem, rungs: Rungs, blind: set[str]) -> Iterable[Structure]:
    names = tuple(rungs)
    for k in range(len(names)):
        whole = _free(problem, rungs, names[: k + 1])
        friction, lower = " + ".join(names[: k + 1]), " + ".join(names[:k])
        for fractional in (False, True):
            this = whole if fractional else replace(whole, orders=_integers(whole))
            below = [name_of(lower, fractional)] * (k > 0) + [name_of(friction, False)] * fractional
            yield Structure(friction, fractional, held(this, blind | unseen(this, 0.0)), this, below=tuple(below))


def _as_it_is(problem: Problem, name: str, rungs: Sequence[Structure]) -> tuple[Structure, ...]:
    """What the project frees, with every order at its integer, where each has one, and with orders free.

    Each holds the richest rung of its kind whose unknowns it has.
    """
    found: list[Structure] = []
    has_integers = all(problem.model.integer_order(n) is not None for n in problem.orders)
    for fractional, orders in (*[(False, _integers(problem))] * has_integers, (True, _free_orders(problem))):
        whole = replace(problem, orders=orders)
        this = held(whole, unseen(whole, 0.0))
        if this.order_indices or not fractional:
            lower = [s.name for s in rungs if s.fractional is fractional and {*s.problem.names} <= {*this.names}]
            found.append(Structure(name, fractional, this, whole, below=(*lower[-1:], *(s.name for s in found))))
    return tuple(found)


def _with_own(problem: Problem, rungs: tuple[Structure, ...]) -> tuple[Structure, ...]:
    """The rungs and the project's own structure; the first rung of a kind that has its unknowns and more holds it."""
    own = tuple(s for s in _as_it_is(problem, OWN, rungs) if not any(_same(s.problem, r.problem) for r in rungs))
    above: dict[str, str] = {}
    for s in own:
        richer = (r for r in rungs if r.fractional is s.fractional and {*s.problem.names} < {*r.problem.names})
        above |= {r.name: s.name for r in islice(richer, 1)}
    return tuple(replace(r, below=(*r.below, above[r.name])) if r.name in above else r for r in rungs) + own


def _marked(structures: tuple[Structure, ...], given: Problem) -> tuple[Structure, ...]:
    """The same, the one that is the project as it is being marked."""
    return tuple(replace(s, given=_same(given, s.problem)) for s in structures)


def _same(one: Problem, other: Problem) -> bool:
    """Whether two problems are one model with the same unknowns; bounds may differ, and what does nothing."""
    if one.names != other.names:
        return False
    cost = one.cost(one.start)
    return math.isclose(other.cost(embedded(other, assignment(one, one.start))), cost, rel_tol=1e-9)


def assignment(problem: Problem, x: FloatArray) -> dict[str, float]:
    """Every order and parameter by name, those that are fixed too, and every unknown.

    Examples
    --------
    >>> import fracid
    >>> still = Experiment("still", 0.1, np.zeros((9, 2)), np.zeros((1, 1)))
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> problem = Problem(rig, (still,), {"lambda": 1.0, "mu": Free(1.0, 0.5, 1.2)}, {"C4": 0.2}, initial_state="held")
    >>> values = assignment(problem, np.array([0.9]))
    >>> values["lambda"], values["mu"], values["C4"], values["b_alpha"]
    (1.0, 0.9, 0.2, 0.0003)
    """
    own = {p.name: p.value for p in problem.model.parameters}
    return {**own, **problem.parameter_starts, **problem.order_starts, **problem.named(x)}


def _require_both(structures: tuple[Structure, ...], problem: Problem) -> None:
    """Refuse a model of which nothing can be compared."""
    model = problem.model
    if not any(s.fractional for s in structures):
        own = " and 1 - ".join(model.parameter_names[k] for _, k in model.complements)
        raise InputError(SAYS("of-parameters" if own else "no-order", model=model, parameters=own))
    if all(s.fractional for s in structures):
        raise InputError(SAYS("no-integer-model", model=model, orders=" and ".join(problem.orders)))


def _integers(problem: Problem) -> dict[str, Value]:
    """Every order at its integer value, those fixed elsewhere too; what has none stays."""
    return {n: problem.model.solved_at(n, v) for n, v in problem.orders.items()}


def _free(problem: Problem, rungs: Rungs, on: Sequence[str]) -> Problem:
    """The problem with the friction of some rungs free, of the others 0, and with its orders free."""
    kinds, free = problem.model.friction, [n for rung in on for n in rungs[rung]]
    off: dict[str, Value] = {n: kinds[n].off for names in rungs.values() for n in names if n not in free}
    base = {n: _holding(v, kinds[n].off) if n in free else v for n, v in problem.parameters.items()}
    rests = freed_rests(problem, free)
    parameters = _together(problem, {**base, **freed_friction(problem, free), **off}) | rests
    own = tuple(n for n in (*problem.per_recording, *rests) if isinstance(parameters[n], Free))
    return replace(problem, orders=_free_orders(problem), parameters=parameters, per_recording=own)


def _free_orders(problem: Problem) -> dict[str, Value]:
    """Orders free as the problem has them, in ranges that hold their integers; all of them where it fixes all."""
    orders = {n: _holding(v, problem.model.solved_at(n, None)) for n, v in problem.orders.items()}
    if any(isinstance(v, Free) for v in orders.values()):
        return orders
    return {n: v if isinstance(v, Tied) else _holding(ORDER, problem.model.solved_at(n, None))
            for n, v in orders.items()}  # fmt: skip


def _holding(value: Value, point: float | None) -> Value:
    """A range widened to hold a point, where there is one."""
    if not isinstance(value, Free) or point is None or value.lower <= point <= value.upper:
        return value
    return replace(value, lower=min(value.lower, point), upper=max(value.upper, point))


def _instead(problem: Problem, name: str) -> str:
    if name in problem.per_recording and name not in problem.model.friction:
        return "it is found where a recording sees it"
    kept = held(problem, {name})
    return f"it is {({**kept.order_starts, **kept.parameter_starts})[name]:.4g}"


def held(problem: Problem, names: Collection[str]) -> Problem:
    """The problem with some values fixed: orders at their integers, friction at 0, others where a search would start.

    Examples
    --------
    >>> import fracid
    >>> still = Experiment("still", 0.1, np.zeros((9, 2)), np.zeros((1, 1)))
    >>> free = {"lambda": Free(1.0, 0.5, 1.2), "mu": Free(1.0, 0.5, 1.2)}
    >>> held(Problem(fracid.rotary_pendulum(), (still,), free, initial_state="held"), {"mu"}).names
    ('lambda',)
    """
    orders = {n: problem.model.solved_at(n, v.start) if n in names and isinstance(v, Free) else v
              for n, v in problem.orders.items()}  # fmt: skip
    kinds = problem.model.friction
    parameters = {n: (kinds[n].off if n in kinds else v.start) if n in names and isinstance(v, Free) else v
                  for n, v in problem.parameters.items()}  # fmt: skip
    own = tuple(n for n in problem.per_recording if n not in names)
    return replace(problem, orders=orders, parameters=_together(problem, parameters), per_recording=own)


def _together(problem: Problem, parameters: Mapping[str, Value]) -> dict[str, Value]:
    """What acts only with another is off where that is: a damping of presliding without presliding."""
    values = {p.name: p.value for p in problem.model.parameters} | dict(parameters)
    alone = [p.name for p in problem.model.parameters if p.needs and all(values[n] == 0.0 for n in p.needs)]
    return {**parameters, **dict.fromkeys((n for n in alone if n in parameters), 0.0)}


def unseen(problem: Problem, threshold: float) -> set[str]:
    """Free orders and parameters whose move changes no output by more than `threshold` of its scatter, or the noise.

    Examples
    --------
    >>> import fracid
    >>> swing = Experiment("swing", 1e-2, np.column_stack([np.zeros(99), np.cos(np.arange(99) / 15)]), np.zeros((1, 1)))
    >>> free = {"b_alpha": Free(1e-4, 0.0, 1.0), "torque_per_volt": Free(-0.1, -1.0, 0.0)}
    >>> unseen(Problem(fracid.rotary_pendulum(), (swing,), {"lambda": 1.0, "mu": 1.0}, free), 0.0)  # no voltage
    {'torque_per_volt'}
    """
    low, high = problem.space.lower, problem.space.upper
    step = MOVE * np.where(np.isfinite(high - low), high - low, np.maximum(np.abs(problem.start), 1.0))
    step = np.where(problem.start + 2 * step > high, -step, step)
    x = np.where(problem.start == 0.0, step, problem.start)  # a spring of stiffness 0 has no rest to be seen
    here = problem.errors(x)
    if isinstance(here, Failure):
        return set()
    least = []
    for y in (e.measured for e in problem.experiments):
        scatter, noise = np.std(y, axis=0), OF_NOISE * np.array([noise_floor(column) for column in y.T])
        most = threshold * np.maximum(scatter, 1e-3 * np.max(scatter))  # an arm that stands still
        least.append(np.where(noise > 0, np.clip(noise, OF_NOISE * most, most), most))

    def is_seen(target: str) -> bool:
        there = problem.errors(x + step * np.array([u.target == target for u in problem.unknowns]))
        return isinstance(there, Failure) or any(
            np.any(np.sqrt(np.mean((a - b) ** 2, axis=0)) > c) for a, b, c in zip(here, there, least, strict=True)
        )

    targets = dict.fromkeys(u.target for u in problem.unknowns if u.kind in ("order", "parameter"))
    return {target for target in targets if not is_seen(target)}
