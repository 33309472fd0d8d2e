"""What to look at beside the best value: is each unknown identifiable, and the cost over the orders.

:func:`identifiability` says of each unknown, in words, one of

==================  ==========================================================================================
verdict             means
==================  ==========================================================================================
identifiable        its interval is narrow enough to use: an order to 0.1, an angle to 3°, a constant to its own size,
                    the start of a state to its travel; with the bound that ends it where the data do not
only in a ratio     the data see it through a product or quotient with another, which is named: a free response
                    knows C1/C4, not C1; so in a null direction of the scaled sensitivities, or nearly so; or its
                    interval is as wide as such a scale, as that of a leak next to 0 beside R and C
practically not     the sensitivities see it, and not enough: its profile is flat or one-sided, or the interval is
                    too wide; with the reason where there is one: the part of the rig whose order it is hardly moves
                    (a clamped arm), or it shows only in large swings (an inertia term of sin²α at small angles);
                    or the interval ends where a bound does, its own or another's, beyond which values mean as much
not at all          nothing that was measured depends on it
at its bound        the search would have gone on, had it been allowed to
forgotten           where a presliding joint began, which nothing shows once it slides, and which nobody misses
==================  ==========================================================================================

A presliding joint has reasons of its own: a motion may be all within what it gives, or next to none of it; and so has a
springpot, whose order at 0 is a spring's and at 1 a dashpot's.

How a sensitivity grows with the swing is found by halving all angles: a term that is linear in the motion falls
by 2, one of its third power by 8.

:func:`cost_plane`: the valley of the cost in (λ, μ) shows what a table of intervals cannot: whether the orders can be
told apart, and whether the minimum is a point or a gorge.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from fracid.arrays import FloatArray
from fracid.cards import rounded
from fracid.errors import Failure, InputError
from fracid.estimation.block_covariance import summed
from fracid.estimation.cost_profile import Profile
from fracid.estimation.covariance import Known, Uncertainty, half_width, sandwich, uncertainty
from fracid.estimation.derivatives import by_blocks
from fracid.estimation.records import in_words
from fracid.findings import Words
from fracid.models.friction import LUGRE
from fracid.problem import Experiment, Problem, Unknown
from fracid.problem.limits import limits
from fracid.problem.unknowns import scaled
from fracid.quantiles import NORMAL_95
from fracid.units import half_of, letter, with_interval, with_unit

SAYS = Words("estimation/parameter_verdicts.toml")

Kind = Literal[
    "identifiable", "only in a ratio", "practically not", "not at all", "at its bound", "forgotten", "unknown"
]

WIDE_ORDER = 0.1
"""Half an interval of an order that is too wide to use: it matters by its distance from 1."""

WIDE_PART = 0.5
"""The same for what a presliding joint has given at the start, of all that it gives."""

WIDE_REST = 0.05
"""The same for where something rests, which may well be 0: an angle [rad]; else in parts of how far it moves."""

STILL = 1e-2
"""A coordinate that moves by less than this part of the one that moves most stands still."""

NONLINEAR, LARGEST_POWER = 1.5, 4.0
"""Sensitivities that grow with the swing to more than the one power belong to a term of large swings, and to more than
the other to none: half the motion was another one."""

TIGHT = 0.2
"""A ratio whose interval is below this part of its parts' is identifiable."""

SLIDES, STICKS = 0.05, 0.8
"""Parts of a joint's motion that presliding takes up: below the one it hardly shows, above the other nothing else."""

FAR, GOES_ALONG = 0.1, 0.3
"""A relative change that the data do not see, and the power of it with which an interval widens, that is arbitrary."""

CUT = 0.5
"""An interval that is shorter than this part of what it were without bounds is cut by them; by its own alone it is
known where that were shorter than this part of what is too wide."""

LITTLE = 0.05
"""Room beyond a bound that is less than this part of what is too wide is none."""

KNOWN = 0.5
"""Half the interval of a ratio that is worth naming, relative."""


@dataclass(frozen=True)
class Verdict:
    """Whether one unknown is identifiable."""

    name: str
    kind: Kind
    reason: str = ""
    """Why, or with what; in words."""

    @property
    def sentence(self) -> str:
        """The verdict, as tables say it, and its reason."""
        return ": ".join(filter(None, (in_words(self.kind), self.reason)))

    @property
    def says(self) -> str:
        """A sentence without its subject, the name: ``lies at its bound: 0; it is zero …``."""
        return f"{SAYS(self.kind)}: {self.reason}" if self.reason else SAYS(self.kind)


def identifiability(
    problem: Problem,
    x: FloatArray,
    known: Known | None = None,
    profiles: Mapping[str, Profile] | None = None,
    *,
    jobs: int = 1,
) -> dict[str, Verdict]:
    """Say of each unknown whether it is identifiable.

    Parameters
    ----------
    problem : Problem
    x : array, shape (n_unknowns,)
        Its minimum.
    known : Uncertainty or Failure, optional
        What :func:`fracid.estimation.covariance.uncertainty` gave there; asked for if left out.
    profiles : mapping from names to Profile, optional
        From :func:`fracid.profile`; where there is one its word goes before the sandwich's.
    jobs : int
        Threads.

    Returns
    -------
    dict
        Name of each unknown → its verdict.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment, Free
    >>> rig = fracid.rotary_pendulum("srv02-rotpen", coulomb_theta=0.0)
    >>> run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=5e-3, end=2.0)
    >>> noise = 1e-3 * np.random.default_rng(1).standard_normal((401, 2))
    >>> swing = Experiment("twin", 5e-3, run.states[:, [0, 2]] + noise, np.zeros((1, 1)), initial={"alpha": 0.3})
    >>> problem = Problem(rig, (swing,), {"lambda": 0.9, "mu": Free(0.95, 0.5, 1.2)},
    ...                   {"slip_speed": Free(0.02, 0.01, 0.1)}, initial_state="held")
    >>> {name: verdict.sentence for name, verdict in identifiability(problem, problem.start).items()}
    {'mu': 'identifiable', 'slip_speed': 'not identifiable: nothing that was measured depends on it'}
    """
    known = uncertainty(problem, x, jobs=jobs) if known is None else known
    if isinstance(known, Failure):
        return {n: Verdict(n, "unknown", str(known)) for n in problem.names}
    view = _View(problem, x, known, profiles or {})
    return {n: next(verdict for rule in RULES for verdict in rule(view, i)) for i, n in enumerate(problem.names)}


class _View:
    """What the rules look at; the costly parts once, and only where a rule asks."""

    def __init__(self, problem: Problem, x: FloatArray, known: Uncertainty, profiles: Mapping[str, Profile]) -> None:
        self.problem, self.x, self.known, self.profiles = problem, x, known, profiles
        self.names = problem.names

    def half(self, i: int) -> float:
        """The longer side of the interval, were its own bound not to cut it; infinite where there is none."""
        own, tangent = half_width(self.known, self.x, i), NORMAL_95 * float(np.nan_to_num(self.known.standard_error[i]))
        reach, (low, high) = self.problem.unknowns[i].range, self.known.ends[i]
        return (own if reach.lower < low and high < reach.upper else max(own, tangent)) or math.inf

    def shown(self, i: int) -> str:
        """Its interval in words: the value with its half-width, or both ends."""
        ends, x, cut = self.known.interval(self.x, i), float(self.x[i]), bool(self.ending(i))
        shown = rounded(x, self.half(i)) if ends is None else with_interval(x, *ends, cut=cut).split(", ")[-1]
        return re.sub(r"(?<!e)-", "−", shown)

    def ending(self, i: int) -> list[float]:
        """Its bounds, as the project has them, at which its interval ends, and beyond which values mean as much."""
        u, written = self.problem.unknowns[i], [v for e in self.problem.experiments for v in e.initial.values()]
        ends = u.range.ending(self.known.ends[i]) if u.kind != "initial" or u.range in written else []
        return [bound for bound in ends if _means_something_beyond(self, i, bound)]

    def widest(self, i: int) -> float:
        """Half an interval that is just narrow enough to use."""
        u = self.problem.unknowns[i]
        if u.kind == "initial" and not u.complete:
            return max(self.travels[u.target], WIDE_REST)
        return widest(self.problem, u, float(self.x[i]))

    def too_wide(self, i: int, half: float | None = None) -> bool:
        return (self.half(i) if half is None else half) > self.widest(i)

    def bound(self, i: int) -> float:
        """The nearer one."""
        reach = self.problem.unknowns[i].range
        return min(reach.lower, reach.upper, key=lambda end: abs(end - float(self.x[i])))

    @cached_property
    def scales(self) -> list[tuple[FloatArray, FloatArray]]:
        """Directions that the data do not see, and with which power of a move along them each standard error goes."""
        shared = [direction for direction in self.known.unseen if np.count_nonzero(direction) > 1]
        with np.errstate(divide="ignore", invalid="ignore"):
            return [(d, np.log(self._variances(FAR * d) / self._variances(-FAR * d)) / (4 * FAR)) for d in shared]

    def _variances(self, relative: FloatArray) -> FloatArray:
        """Those of the curvature after a relative change that keeps products; NaN where the run fails."""
        sizes, sign = self.problem.space.sizes(self.x), np.where(self.x < 0, -1.0, 1.0)
        there = self.x + sign * sizes * np.expm1(sign * relative)
        found = sandwich(self.problem, self.problem.space.clipped(there), np.arange(len(there)))
        return np.full(len(there), np.nan) if isinstance(found, Failure) else np.diag(found.inverse)

    @cached_property
    def travels(self) -> dict[str, float]:
        """How far each state moves, the most over the recordings [rad, rad/s^order]."""
        return {n: max(float(np.ptp(run[:, i])) for run in self.runs) for i, n in enumerate(self.problem.model.states)}

    @cached_property
    def runs(self) -> list[FloatArray]:
        """The states of each recording."""
        return [self.problem.simulate(self.x, e).states for e in self.problem.experiments]

    def presliding(self, state: str) -> tuple[str, float]:
        """The joint of such a state, and which part of all of its motion the state takes up; NaN where none is told."""
        model = self.problem.model
        kind = model.friction.get(model.relaxing[state])
        joint = kind.joint if kind else ""
        if joint not in model.output_states:
            return joint, math.nan
        at = model.states.index(state), model.output_states[joint]
        z, q = (sum(float(np.abs(np.diff(run[:, i])).sum()) for run in self.runs) for i in at)
        return joint, z / q if q > 0 else math.nan

    @cached_property
    def swings(self) -> dict[str, float]:
        """The same of the model's outputs that are states, and how far the others were measured to."""
        travels, problem = [*self.travels.values()], self.problem
        measured = {n: max(float(np.ptp(e.measured[:, k])) for e in problem.experiments)
                    for k, n in enumerate(problem.outputs)}  # fmt: skip
        return measured | {n: travels[i] for n, i in problem.model.output_states.items()}

    def size(self, output: str) -> str:
        """How far an output moves, in words."""
        return with_unit(self.swings[output], self.problem.experiments[0].units.get(output, "rad"))

    def moved_by(self, order: str) -> tuple[str, ...]:
        """The outputs whose states have this order."""
        model = self.problem.model
        return tuple(n for n, i in model.output_states.items() if model.orders[i] == order)

    @cached_property
    def powers(self) -> FloatArray:
        """With which power of the swing each unknown's effect grows; NaN where angles cannot be halved."""
        grows = np.full(len(self.x), np.nan)
        with np.errstate(divide="ignore", invalid="ignore"):
            for smaller in _halved_angles(self.problem, self.x):
                grows = np.log2(_effects(self.problem, self.x) / _effects(*smaller))
        return grows


def widest(problem: Problem, u: Unknown, value: float) -> float:
    """Half an interval that is just narrow enough to use, of what is no value at the start.

    Examples
    --------
    >>> import fracid
    >>> still = Experiment("still", 0.1, np.zeros((9, 1)), np.zeros((1, 1)))
    >>> problem = Problem(fracid.model("pendulum"), (still,), {"mu": fracid.Free(0.9, 0.5, 1.2)})
    >>> widest(problem, problem.unknowns[0], 0.9)
    0.1
    """
    if u.kind == "parameter":
        return WIDE_REST * _motions(problem).get(u.target, 1.0) if _is_rest(problem, u) else abs(value)
    if u.complete:
        return WIDE_PART
    return WIDE_ORDER if u.kind == "order" else math.inf


def _is_rest(problem: Problem, u: Unknown) -> bool:
    """Whether a parameter is where something rests; what a joint gives or the play of a gear is a size [rad]."""
    is_place = u.unit == "rad" or u.target in _motions(problem)
    return u.kind == "parameter" and u.target not in problem.model.friction and is_place


def _motions(problem: Problem) -> dict[str, float]:
    """Parameter that says where a signal rests → how far that moves; those of angles, which count as a radian, not."""
    model, every = problem.model, problem.experiments
    moves = {n: max(np.ptp(e.measured[:, k]) for e in every) for k, n in enumerate(problem.outputs)}
    moves |= {n: max(np.ptp(e.inputs[:, k]) for e in every) for k, n in enumerate(model.inputs)}
    return {r: float(far) for n, far in moves.items() if (r := model.rest_of(n)) and model.parameter(r).unit != "rad"}


def _effects(problem: Problem, x: FloatArray) -> FloatArray:
    """How much a unit of each unknown moves all samples; NaN where their runs fail."""
    J = by_blocks(problem, x, np.arange(len(x)))
    if isinstance(J, Failure):
        return np.full(len(x), np.nan)
    return np.sqrt(summed(J.blocks, [np.sum(j**2, axis=(0, 1)) for j in J.parts]))


def _halved_angles(problem: Problem, x: FloatArray) -> Iterator[tuple[Problem, FloatArray]]:
    if problem.in_windows or problem.model.zero == "upright":  # a window remembers more; rest is at π: half is nowhere
        return
    try:
        smaller = replace(problem, experiments=tuple(map(_halved, problem.experiments)))
    except InputError:  # an output that is more than its states, such as a voltage at rest, is not halved with them
        return
    if smaller.names != problem.names:  # half the motion begins otherwise: a joint that slid does not
        return
    angles = np.array([_is_rest(problem, u) or (u.kind == "initial" and not u.complete) for u in problem.unknowns])
    yield smaller, np.where(angles, 0.5 * x, x)


def _halved(e: Experiment) -> Experiment:
    past, past_inputs = (None if y is None else 0.5 * y for y in (e.past, e.past_inputs))
    return replace(e, measured=0.5 * e.measured, inputs=0.5 * e.inputs, past=past, past_inputs=past_inputs,
                   initial={n: scaled(v, 0.5) for n, v in e.initial.items()},
                   source=None if e.source is None else _halved(e.source))  # fmt: skip


# --- the rules, in order; each gives a verdict or nothing --------------------------------------------


def _by_its_profile(view: _View, i: int) -> Iterator[Verdict]:
    name, profile = view.names[i], view.profiles.get(view.names[i])
    if profile is None or profile.verdict == "no threshold":
        return
    low, high = profile.interval95
    if profile.two_sided is not None:
        narrow = not view.too_wide(i, half_of(profile.two_sided))
        if narrow and view.known.at_bound[i]:  # the walk found it off the bound
            yield from _identifiable(view, i)
        elif view.known.at_bound[i]:
            yield Verdict(name, "practically not", f"its interval is {low:.4g} … {high:.4g}{_because(view, i)}")
        return
    side = f"above {low:.4g}" if low is not None else f"below {high:.4g}" if high is not None else ""
    if profile.verdict == "flat":
        text = f"its profile is flat from {profile.values[0]:.4g} to {profile.values[-1]:.4g}"
        yield Verdict(name, "practically not", f"{text}{_because(view, i)}")
    elif profile.verdict == "one-sided":
        yield Verdict(name, "practically not", f"its profile is one-sided: it lies {side}{_because(view, i)}")
    else:
        yield Verdict(name, "at its bound", f"{view.bound(i):.4g}; its interval is all {side}")


def _at_a_bound(view: _View, i: int) -> Iterator[Verdict]:
    if not view.known.at_bound[i] or np.any(view.known.unseen[:, i]) or (view.too_wide(i) and _near_ratio(view, i)):
        return
    order = view.problem.unknowns[i].kind == "order"
    still = _because(view, i) if order else _of_presliding(view, i) or _idle(view, i)
    if len(view.problem.unknowns[i].range.ending(view.known.ends[i])) > 1:
        still = f"{_bounds(view, i)}{_because(view, i)}"
    if still:  # nothing holds it: the bound is where the search happened to stop
        yield Verdict(view.names[i], "practically not", still.removeprefix("; "))
    else:
        yield Verdict(view.names[i], "at its bound", f"{view.bound(i):.4g}; {_beyond(view, i)}")


def _beyond(view: _View, i: int) -> str:
    """What is beyond a bound that holds an unknown."""
    bound = view.bound(i)
    if _means_something_beyond(view, i, bound):
        return "widen the bound or extend the model"
    if bound == 0.0:
        return "it is zero within the resolution of the data: remove it, or extend the model"
    if view.problem.unknowns[i].kind == "order" and not view.problem.unknowns[i].range.hard:
        return SAYS("order-end", end=bound)
    return "beyond it means nothing, so the model lacks something"


def _means_something_beyond(view: _View, i: int, bound: float) -> bool:
    """Whether there are values beyond a bound that mean as much, more than a little beside those before it."""
    u, problem = view.problem.unknowns[i], view.problem
    own = u.target in (problem.orders if u.kind == "order" else problem.parameters)
    limit = limits(problem, u.target)[bound == u.range.upper] if own else math.inf
    little = max(LITTLE * view.widest(i), CUT * abs(bound - float(view.x[i])))
    return not (u.range.hard or u.complete) and abs(limit - bound) > little


def _of_a_joint_that_gives(view: _View, i: int) -> Iterator[Verdict]:
    """Where it began: a part of what it gives, known if at all while it sticks."""
    u = view.problem.unknowns[i]
    if u.complete and (view.known.at_bound[i] or view.too_wide(i)):
        delta = view.problem.model.relaxing[u.target]
        yield Verdict(u.name, "forgotten", f"once the joint has moved by {delta}")


def _of_a_springpot(view: _View, i: int) -> Iterator[Verdict]:
    """Its order, where that is another element's."""
    u, x = view.problem.unknowns[i], float(view.x[i])
    model = view.problem.model
    if u.kind != "parameter" or u.target not in {model.parameter_names[k] for _, k in model.complements}:
        return
    half, own = view.half(i), view.known.at_bound[i]
    low, high = (x < 0.1, x > 0.9) if own else (x - half <= 0, x + half >= 1)  # no interval reaches beyond a bound
    if other := " or a ".join(["spring"] * low + ["dashpot"] * high):
        which = f"is at its bound, {x:.2g}" if own else f"has the interval {x:.2g} ± {half:.2g}"
        order = f"its order, of a spring 0 and of a dashpot 1, {which}"
        yield Verdict(u.name, "practically not", f"the springpot is indistinguishable from a {other}: {order}")


def _unseen(view: _View, i: int) -> Iterator[Verdict]:
    directions = view.known.unseen[view.known.unseen[:, i] != 0]
    if not len(directions):
        return
    name, direction = view.names[i], directions[0]
    others = [int(k) for k in np.flatnonzero(direction) if k != i]
    if not others or _of_presliding(view, i):
        reason = _because(view, i).removeprefix("; ") or "nothing that was measured depends on it"
        yield Verdict(name, "not at all", reason)
        return
    partners = tuple(view.names[k] for k in others)
    if len(directions) > 1 or not all(_has_a_size(view, k) for k in (i, others[0])):
        yield Verdict(name, "only in a ratio", f"seen only together with {', '.join(partners)}")
        return
    combination = _combination(name, partners[0], direction[i] / direction[others[0]])
    also = f", and so with {', '.join(partners[1:])}" if len(partners) > 1 else ""
    reason = f"with {partners[0]}: only {combination} is identifiable{also}; fix one of them"
    yield Verdict(name, "only in a ratio", reason)


def _has_a_size(view: _View, i: int) -> bool:
    """Whether a relative change of it means something: a constant that is not next to zero."""
    u = view.problem.unknowns[i]
    return u.kind == "parameter" and abs(view.x[i]) > 1e-2 * min(u.range.upper - u.range.lower, 1.0)


def _combination(name: str, partner: str, power: float) -> str:
    """What stays the same along a direction in which `name` grows as `partner` to a power."""
    size = abs(power)
    part = partner if abs(size - 1) < 0.02 else f"{partner}^{size:.2g}"
    return f"{name}/{part}" if power > 0 else f"{name}·{part}"


def _elsewhere(view: _View, i: int) -> Iterator[Verdict]:
    """Where another minimum, which is as good, has other values."""
    there, unknowns = view.known.elsewhere, view.problem.unknowns
    if there is None or not math.isfinite(there[i]):
        return
    values = {k: f"{view.names[k]} = {with_unit(v, unknowns[k].unit)}" for k, v in enumerate(there) if math.isfinite(v)}
    beside = ", ".join(text for k, text in values.items() if k != i)
    why = SAYS("elsewhere" if beside else "twice", own=values[i], beside=beside)
    yield Verdict(view.names[i], "practically not", why)


def _too_wide(view: _View, i: int) -> Iterator[Verdict]:
    if not view.too_wide(i):
        return
    name = view.names[i]
    reach = view.problem.unknowns[i].range
    low, high = view.known.interval(view.x, i) or view.x[i] + view.half(i) * np.array((-1.0, 1.0))
    includes = view.problem.unknowns[i].kind == "parameter" and low <= 0 <= high
    why = "which includes 0" if includes else f"wider than ± {view.widest(i):.2g}"
    text = f"its interval is {view.shown(i)}, {why}{', and ends at its bound' if view.ending(i) else ''}"
    if view.half(i) > reach.upper - reach.lower:
        text = _bounds(view, i)
    because = _because(view, i)
    ratio = None if because else _near_ratio(view, i)
    if ratio is None:
        yield Verdict(name, "practically not", text + because)
    else:
        yield Verdict(name, "only in a ratio", SAYS("near-ratio", ratio=ratio, text=text))


def _bounds(view: _View, i: int) -> str:
    reach = view.problem.unknowns[i].range
    bounds = re.sub(r"(?<!e)-", "−", f"{reach.lower:.3g} … {reach.upper:.3g}")
    return f"its interval is wider than its bounds, {bounds}"


def _idle(view: _View, i: int) -> str:
    """That a parameter does nothing where another is 0, as the rest of a spring: so it may be, by its interval."""
    problem, x, others = view.problem, view.x, dict[int, float]()
    moved = math.copysign(problem.space.typical[i], problem.space.steps(x)[i]) * np.eye(len(x))[i]
    for k, other in enumerate(problem.unknowns):
        low, high = view.known.interval(x, k) or (x[k], x[k])
        if i != k and problem.unknowns[i].kind == other.kind == "parameter" and low <= 0 <= high:
            others[k] = max(low, high, key=abs) or problem.space.typical[k]  # at 0 already: what it does beyond

    def idle(at: Mapping[int, float]) -> list[int]:
        there = [np.where(np.arange(len(x)) == k, value, x) for k, value in at.items()]
        costs = problem.costs([problem.space.clipped(x) for one in there for x in (one, one + moved)])
        return [k for k, here, beside in zip(at, costs[::2], costs[1::2], strict=True) if here == beside]

    off = idle(dict.fromkeys(others, 0.0))
    acts = set(off) - {*idle({k: others[k] for k in off})}
    return next((SAYS("idle", other=problem.unknowns[k].name) for k in off if k in acts), "")


def _near_ratio(view: _View, i: int) -> dict[str, Any] | None:
    """The partner with which a ratio or product is known far better, what it is, and to how many percent."""
    C, x, best = view.known.covariance, view.x, None
    for k in range(len(x)):
        if k == i or not (_has_a_size(view, k) and _has_a_size(view, i) and math.isfinite(C[k, k])):
            continue
        own, other, both = C[i, i] / x[i] ** 2, C[k, k] / x[k] ** 2, C[i, k] / (x[i] * x[k])
        variance = max(own + other - 2 * abs(both), 1e-6 * own)  # rounding, where both are all but the same
        if variance < TIGHT**2 * own and (best is None or variance < best[0]):
            best = (variance, view.names[k], _combination(view.names[i], view.names[k], math.copysign(1.0, both)))
    if best is None or NORMAL_95 * math.sqrt(best[0]) > KNOWN:
        return None
    return {"partner": best[1], "combination": best[2], "percent": 100 * NORMAL_95 * math.sqrt(best[0])}


def _because(view: _View, i: int) -> str:
    """A reason in the motion, where there is one: what hardly moves, or does not move far enough."""
    if sentence := _of_presliding(view, i) or _idle(view, i):
        return sentence
    u, swings = view.problem.unknowns[i], view.swings
    most = max(swings, key=lambda n: swings[n])
    if u.kind == "order":
        own = view.moved_by(u.target)
        moved = " and ".join(letter(n) for n in own)
        if own and max(swings[n] for n in own) < STILL * swings[most]:
            size = view.size(max(own, key=swings.__getitem__))
            return SAYS("still", moved=moved, size=size, most=view.size(most), of=letter(most))
        if own and not set(own) & set(view.problem.outputs):
            return f"; {moved} is not scored: score it too, or fix {letter(u.name)}"
    if u.kind == "parameter" and NONLINEAR < view.powers[i] <= LARGEST_POWER:
        return SAYS("nonlinear", power=view.powers[i], of=letter(most), size=view.size(most))
    return ""


def _of_presliding(view: _View, i: int) -> str:
    """What of a joint's friction a motion cannot tell that is all presliding, or next to none of it."""
    u, model = view.problem.unknowns[i], view.problem.model
    kind = model.friction.get(u.target) if u.kind == "parameter" else None
    if kind is None:
        return ""
    for state, delta in model.relaxing.items():
        joint, part = view.presliding(state)
        own = u.target == delta or delta in model.parameter(u.target).needs
        strength = kind.dry or (kind.rung in (LUGRE.rung, "Stribeck") and not own)
        if kind.joint == joint and own and part < SLIDES:
            return SAYS("slides", joint=letter(joint), percent=100 * part, name=u.name)
        if kind.joint == joint and part > STICKS and (u.target == delta or strength):
            return SAYS("sticks", joint=letter(joint), percent=100 * min(part, 1.0), delta=delta, name=u.name)
    return ""


def _of_no_scale(view: _View, i: int) -> Iterator[Verdict]:
    """Whose interval is as wide as the scale of others, which the data do not see."""
    for direction, powers in view.scales:
        if math.isfinite(view.known.standard_error[i]) and abs(powers[i]) > GOES_ALONG:
            partners = " and ".join(letter(view.names[k]) for k in np.flatnonzero(direction))
            yield Verdict(view.names[i], "only in a ratio", SAYS("no-scale", text=view.shown(i), partners=partners))


def _cut(view: _View, i: int) -> Iterator[Verdict]:
    """Whose interval is less than half as long as the data leave it, for a bound beyond which values mean as much."""
    for side, end in enumerate(view.known.ends[i]):
        if abs(end - view.x[i]) > CUT * NORMAL_95 * view.known.standard_error[i]:
            continue
        for k, bound in view.known.stops.get((i, side), {}).items():
            harmless = _idle(view, k) if k != i else not view.too_wide(i, view.half(i) / CUT)
            if not harmless and _means_something_beyond(view, k, bound):
                why = SAYS("cut" if k == i else "cut-by", other=letter(view.names[k]), bound=bound)
                yield Verdict(view.names[i], "practically not", why)


def _identifiable(view: _View, i: int) -> Iterator[Verdict]:
    u = view.problem.unknowns[i]
    own = view.moved_by(u.target) if u.kind == "order" else ()
    unscored = own and not set(own) & set(view.problem.outputs)
    note = f"through {', '.join(view.problem.outputs)} alone; score {' or '.join(own)} too" if unscored else ""
    bounds = " and ".join(f"{bound:.4g}" for bound in view.ending(i))
    yield Verdict(view.names[i], "identifiable", SAYS("bounded", bounds=bounds) if bounds else note)


RULES: tuple[Callable[[_View, int], Iterator[Verdict]], ...] = (
    _of_a_joint_that_gives, _of_a_springpot, _by_its_profile, _of_no_scale, _at_a_bound, _unseen, _elsewhere, _too_wide,
    _cut, _identifiable,
)  # fmt: skip
"""The first that gives a verdict has the word."""
