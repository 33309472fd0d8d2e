"""What to look at beside the best value: what the data can tell of each unknown, and the cost over the orders.

:func:`identifiability` says of each unknown, in words, one of

==================  ==========================================================================================
verdict             means
==================  ==========================================================================================
identifiable        its interval is narrow enough to use: an order to 0.1, an angle to 3°, a constant to its own size,
                    the start of a state to its travel
only in a ratio     the data see it through a product or quotient with another, which is named: a free response
                    knows C1/C4, not C1; so in a null direction of the scaled sensitivities, or nearly so
practically not     the sensitivities see it, and not enough: its profile is flat or one-sided, or the interval is
                    too wide; with the reason where there is one: the part of the rig whose order it is hardly moves
                    (a clamped arm), or it shows only in large swings (an inertia term of sin²α at small angles)
not at all          nothing that was measured depends on it
at its bound        the search would have gone on, had it been allowed to
==================  ==========================================================================================

How a sensitivity grows with the swing is found by halving all angles: a term that is linear in the motion falls
by 2, one of its third power by 8.

:func:`cost_plane`: the valley of the cost in (λ, μ) shows what a table of intervals cannot: whether the orders can be
told apart, and whether the minimum is a point or a gorge.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from fracid.errors import InputError
from fracid.problem import Problem
from fracid.profiles import Profile
from fracid.uncertainty import NORMAL_95, Uncertainty, jacobian, uncertainty
from fracid.units import with_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from fracid.style import Style

__all__ = ["CostPlane", "Verdict", "cost_plane", "identifiability"]

FloatArray = NDArray[np.float64]


Kind = Literal["identifiable", "only in a ratio", "practically not", "not at all", "at its bound", "unknown"]

WIDE_ORDER = 0.1
"""Half an interval of an order that is too wide to use: it matters by its distance from 1."""

WIDE_ANGLE = 0.05
"""The same for an angle of rest [rad], which may well be 0."""

STILL = 1e-2
"""A coordinate that moves by less than this part of the one that moves most hardly moves."""

NONLINEAR = 1.5
"""Sensitivities that grow with the swing to more than this power belong to a term of large swings."""

TIGHT = 0.2
"""A ratio whose interval is below this part of its parts' is what the data know."""


KNOWN = 0.5
"""Half the interval of a ratio that is worth naming, relative."""


@dataclass(frozen=True)
class Verdict:
    """What the data can tell of one unknown."""

    name: str
    kind: Kind
    reason: str = ""
    """Why, or with what; in words."""
    partners: tuple[str, ...] = ()
    """The unknowns that it can only be known together with."""

    @property
    def sentence(self) -> str:
        """The verdict and its reason."""
        return f"{self.kind}: {self.reason}" if self.reason else self.kind


def identifiability(
    problem: Problem,
    x: FloatArray,
    known: Uncertainty | str | None = None,
    profiles: Mapping[str, Profile] | None = None,
    *,
    jobs: int = 1,
) -> dict[str, Verdict]:
    """Say of each unknown what the data can tell of it.

    Parameters
    ----------
    problem : Problem
    x : array, shape (n_unknowns,)
        Its minimum.
    known : Uncertainty or str, optional
        What :func:`fracid.uncertainty.uncertainty` gave there; asked for if left out.
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
    {'mu': 'identifiable', 'slip_speed': 'not at all: nothing that was measured depends on it'}
    """
    known = uncertainty(problem, x, jobs=jobs) if known is None else known
    if isinstance(known, str):
        return {n: Verdict(n, "unknown", known) for n in problem.names}
    look = _Look(problem, x, known, profiles or {}, jobs)
    return {n: next(found for rule in RULES for found in rule(look, i)) for i, n in enumerate(problem.names)}


class _Look:
    """What the rules look at; the costly parts once, and only where a rule asks."""

    def __init__(
        self, problem: Problem, x: FloatArray, known: Uncertainty, profiles: Mapping[str, Profile], jobs: int
    ) -> None:
        self.problem, self.x, self.known, self.profiles, self.jobs = problem, x, known, profiles, jobs
        self.names = problem.names
        self._powers: FloatArray | None = None
        self._travels: dict[str, float] = {}

    def half(self, i: int) -> float:
        """Half the sandwich's interval."""
        return NORMAL_95 * float(self.known.standard_error[i])

    def too_wide(self, i: int, half: float | None = None) -> bool:
        u, half = self.problem.unknowns[i], self.half(i) if half is None else half
        if u.kind == "parameter":
            return half > (WIDE_ANGLE if u.unit == "rad" else abs(float(self.x[i])))
        if u.kind == "initial":
            return half > max(self.travels()[u.target], WIDE_ANGLE)
        return u.kind == "order" and half > WIDE_ORDER

    def bound(self, i: int) -> float:
        """The nearer one."""
        reach = self.problem.unknowns[i].range
        return min(reach.lower, reach.upper, key=lambda end: abs(end - float(self.x[i])))

    def travels(self) -> dict[str, float]:
        """How far each state moves, the most over the recordings [rad, rad/s^order]."""
        if not self._travels:
            runs = [self.problem.simulate(self.x, e).states for e in self.problem.experiments]
            states = enumerate(self.problem.model.states)
            self._travels = {n: max(float(np.ptp(run[:, i])) for run in runs) for i, n in states}
        return self._travels

    def swings(self) -> dict[str, float]:
        """The same of the model's outputs."""
        travels = [*self.travels().values()]
        return {n: travels[i] for n, i in self.problem.model.outputs.items()}

    def size(self, output: str) -> str:
        """How far an output moves, in words."""
        return with_unit(self.swings()[output], self.problem.experiments[0].units.get(output, "rad"))

    def moved_by(self, order: str) -> tuple[str, ...]:
        """The outputs whose states have this order."""
        model = self.problem.model
        return tuple(n for n, i in model.outputs.items() if model.orders[i] == order)

    def power(self, i: int) -> float:
        """With which power of the swing an unknown's sensitivity grows; NaN where angles cannot be halved."""
        if self._powers is None:
            self._powers = _powers(self.problem, self.x, self.jobs)
        return float(self._powers[i])


def _powers(problem: Problem, x: FloatArray, jobs: int) -> FloatArray:
    """log₂ of how much each column of J falls when all angles are halved, shape (n_unknowns,)."""
    if problem.model.zero == "upright":  # rest is at π: half of it is nowhere
        return np.full(len(x), np.nan)
    smaller = replace(problem, experiments=tuple(
        replace(e, measured=0.5 * e.measured, inputs=0.5 * e.inputs,
                initial={n: 0.5 * v for n, v in e.initial.items()}) for e in problem.experiments
    ))  # fmt: skip
    angles = np.array([u.kind == "initial" or u.unit == "rad" for u in problem.unknowns])
    everything = np.arange(len(x))
    J, J_half = jacobian(problem, x, everything, jobs=jobs), jacobian(smaller, np.where(angles, 0.5 * x, x), everything)
    if isinstance(J, str) or isinstance(J_half, str):
        return np.full(len(x), np.nan)
    norms = [np.linalg.norm(np.concatenate([j.reshape(-1, len(x)) for j in found]), axis=0) for found in (J, J_half)]
    return np.asarray(np.log2(np.maximum(norms[0], 1e-300) / np.maximum(norms[1], 1e-300)))


# --- the rules, in order; each gives a verdict or nothing --------------------------------------------


def _by_its_profile(look: _Look, i: int) -> Iterator[Verdict]:
    name, found = look.names[i], look.profiles.get(look.names[i])
    if found is None or found.verdict == "no threshold":
        return
    low, high = found.interval95
    if found.two_sided is not None:
        narrow = not look.too_wide(i, (found.two_sided[1] - found.two_sided[0]) / 2)
        if narrow and look.known.at_bound[i]:  # the walk found it off the bound
            yield from _identifiable(look, i)
        elif look.known.at_bound[i]:
            yield Verdict(name, "practically not", f"the data say {low:.4g} … {high:.4g}{_because(look, i)}")
        return
    side = f"above {low:.4g}" if low is not None else f"below {high:.4g}" if high is not None else ""
    if found.verdict == "flat":
        said = f"its profile is flat from {found.values[0]:.4g} to {found.values[-1]:.4g}"
        yield Verdict(name, "practically not", f"{said}{_because(look, i)}")
    elif found.verdict == "one-sided":
        yield Verdict(name, "practically not", f"its profile is one-sided, the data say {side}{_because(look, i)}")
    else:
        yield Verdict(name, "at its bound", f"{look.bound(i):.4g}; the data say {side}")


def _at_a_bound(look: _Look, i: int) -> Iterator[Verdict]:
    if not look.known.at_bound[i]:
        return
    still = _because(look, i) if look.problem.unknowns[i].kind == "order" else ""
    if still:  # nothing holds it: the bound is where the search happened to stop
        yield Verdict(look.names[i], "practically not", still.removeprefix("; "))
    else:
        yield Verdict(look.names[i], "at its bound", f"{look.bound(i):.4g}; widen it, or the model lacks something")


def _unseen(look: _Look, i: int) -> Iterator[Verdict]:
    directions = look.known.unseen[look.known.unseen[:, i] != 0]
    if not len(directions):
        return
    name, direction = look.names[i], directions[0]
    others = [int(k) for k in np.flatnonzero(direction) if k != i]
    if not others:
        reason = _because(look, i).removeprefix("; ") or "nothing that was measured depends on it"
        yield Verdict(name, "not at all", reason)
        return
    partners = tuple(look.names[k] for k in others)
    if len(directions) > 1 or not all(_has_a_size(look, k) for k in (i, others[0])):
        yield Verdict(name, "only in a ratio", f"seen only together with {', '.join(partners)}", partners)
        return
    known = _combination(name, partners[0], direction[i] / direction[others[0]])
    also = f", and so with {', '.join(partners[1:])}" if len(partners) > 1 else ""
    reason = f"with {partners[0]}: the data know {known}{also}; fix one of them"
    yield Verdict(name, "only in a ratio", reason, partners)


def _has_a_size(look: _Look, i: int) -> bool:
    """Whether a relative change of it means something: a constant that is not next to zero."""
    u = look.problem.unknowns[i]
    return u.kind == "parameter" and abs(look.x[i]) > 1e-2 * min(u.range.upper - u.range.lower, 1.0)


def _combination(name: str, partner: str, power: float) -> str:
    """What stays the same along a direction in which `name` grows as `partner` to a power."""
    size = abs(power)
    part = partner if abs(size - 1) < 0.02 else f"{partner}^{size:.2g}"
    return f"{name}/{part}" if power > 0 else f"{name}·{part}"


def _too_wide(look: _Look, i: int) -> Iterator[Verdict]:
    if not look.too_wide(i):
        return
    name = look.names[i]
    reach = look.problem.unknowns[i].range
    said = f"its interval is {look.x[i]:.3g} ± {look.half(i):.2g}"
    if look.half(i) > reach.upper - reach.lower:
        said = f"its interval is wider than all that it may be, {reach.lower:.3g} … {reach.upper:.3g}"
    because = _because(look, i)
    ratio = None if because else _near_ratio(look, i)
    if ratio is None:
        yield Verdict(name, "practically not", said + because)
    else:
        partner, known, percent = ratio
        yield Verdict(name, "only in a ratio", f"with {partner}, nearly: {known} is known to {percent:.2g} %, "
                      f"while {said}", (partner,))  # fmt: skip


def _near_ratio(look: _Look, i: int) -> tuple[str, str, float] | None:
    """The partner with which a ratio or product is known far better, what it is, and to how many percent."""
    C, x, best = look.known.covariance, look.x, None
    for k in range(len(x)):
        if k == i or not (_has_a_size(look, k) and _has_a_size(look, i) and math.isfinite(C[k, k])):
            continue
        own, other, both = C[i, i] / x[i] ** 2, C[k, k] / x[k] ** 2, C[i, k] / (x[i] * x[k])
        variance = max(own + other - 2 * abs(both), 1e-6 * own)  # rounding, where both are all but the same
        if variance < TIGHT**2 * own and (best is None or variance < best[0]):
            best = (variance, look.names[k], _combination(look.names[i], look.names[k], math.copysign(1.0, both)))
    if best is None or NORMAL_95 * math.sqrt(best[0]) > KNOWN:
        return None
    return best[1], best[2], 100 * NORMAL_95 * math.sqrt(best[0])


def _because(look: _Look, i: int) -> str:
    """A reason in the motion, where there is one: what hardly moves, or does not move far enough."""
    u, swings = look.problem.unknowns[i], look.swings()
    most = max(swings, key=lambda n: swings[n])
    if u.kind == "order":
        own = look.moved_by(u.target)
        if own and max(swings[n] for n in own) < STILL * swings[most]:
            return (
                f"; {' and '.join(own)} hardly moves ({look.size(max(own, key=swings.__getitem__))} beside "
                f"{look.size(most)} of {most}), and an order shows in motion alone: fix it"
            )
        if own and not set(own) & set(look.problem.outputs):
            return f"; {' and '.join(own)} is not scored: score it too, or fix {u.name}"
    if u.kind == "parameter" and look.power(i) > NONLINEAR:
        return (
            f"; it shows with the power {look.power(i):.1f} of the swing, and {most} swings by "
            f"{look.size(most)} in all: release it from further out, or fix it"
        )
    return ""


def _identifiable(look: _Look, i: int) -> Iterator[Verdict]:
    u = look.problem.unknowns[i]
    own = look.moved_by(u.target) if u.kind == "order" else ()
    unscored = own and not set(own) & set(look.problem.outputs)
    note = f"through {', '.join(look.problem.outputs)} alone; score {' or '.join(own)} too" if unscored else ""
    yield Verdict(look.names[i], "identifiable", note)


RULES: tuple[Callable[[_Look, int], Iterator[Verdict]], ...] = (
    _by_its_profile, _at_a_bound, _unseen, _too_wide, _identifiable,
)  # fmt: skip
"""The first that gives a verdict has the word."""


# --- the plane of the orders -------------------------------------------------------------------------


@dataclass(frozen=True)
class CostPlane:
    """The cost over two orders, all other unknowns fixed."""

    names: tuple[str, str]
    """The two orders."""
    first: FloatArray
    """Values of the first, shape (n,)."""
    second: FloatArray
    """Values of the second, shape (m,)."""
    cost: FloatArray
    """Shape (n, m); infinite where the run diverges."""

    def plot(
        self, *, best: tuple[float, float] | None = None, evaluations: FloatArray | None = None,
        cost_name: str = "cost", style: str | Style = "screen",
    ) -> Figure:  # fmt: skip
        """The cost over the two orders; see :func:`fracid.plots.cost_plane`.

        Parameters
        ----------
        best : (float, float), optional
            What was found.
        evaluations : array, shape (k, 2), optional
            Where the search has been.
        cost_name : str
            For the colour bar.
        style : str or Style
            ``screen``, ``journal`` or one's own; see :mod:`fracid.style`.

        Examples
        --------
        >>> orders = np.linspace(0.8, 1.0, 5)
        >>> plane = CostPlane(("lambda", "mu"), orders, orders, 1.0 + (orders[:, None] - orders) ** 2)
        >>> plane.plot(best=(0.9, 0.9), cost_name="rmse").axes[1].get_ylabel()
        'RMSE [rad]'
        """
        from fracid.plots import cost_plane

        return cost_plane(self.first, self.second, self.cost, best=best, evaluations=evaluations,
                          cost_name=cost_name, names=self.names, style=style)  # fmt: skip


def cost_plane(problem: Problem, x: FloatArray, *, reach: float = 0.15, points: int = 21, jobs: int = 1) -> CostPlane:
    """Evaluate the cost around x over the problem's first two free orders, within their bounds.

    Parameters
    ----------
    problem : Problem
        With at least two free orders.
    x : array, shape (n_unknowns,)
        Where the other unknowns stay.
    reach : float
        How far from x to go in each order.
    points : int
        Along each order.

    Raises
    ------
    InputError
        If fewer than two orders are free.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment, Free, Problem
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=2e-3, end=2.0)
    >>> swing = Experiment("twin", 2e-3, run.states[:, [0, 2]], np.zeros((1, 1)))
    >>> problem = Problem(rig, (swing,), {"lambda": Free(0.9, 0.5, 1.2), "mu": Free(0.95, 0.5, 1.2)},
    ...                   initial_state="measured")
    >>> plane = cost_plane(problem, problem.start, points=5)
    >>> plane.names, plane.cost.shape, bool(plane.cost[2, 2] == plane.cost.min())
    (('lambda', 'mu'), (5, 5), True)
    """
    at = list(problem.order_indices[:2])
    if len(at) < 2:
        raise InputError("The plane of the orders needs two free orders.")
    axes = [_axis(problem.unknowns[i].range.lower, problem.unknowns[i].range.upper, x[i], reach, points) for i in at]
    grid = [(a, b) for a in axes[0] for b in axes[1]]

    def cost(pair: tuple[float, float]) -> float:
        y = x.copy()
        y[at] = pair
        return problem.cost(y)

    with ThreadPoolExecutor(jobs) as pool:
        costs = np.array(list(pool.map(cost, grid))).reshape(len(axes[0]), len(axes[1]))
    first, second = (problem.unknowns[i].target for i in at)
    return CostPlane((first, second), axes[0], axes[1], costs)


def _axis(lower: float, upper: float, centre: float, reach: float, points: int) -> FloatArray:
    """Points that hold the centre itself, within the bounds."""
    low, high = max(lower, centre - reach), min(upper, centre + reach)
    below = round((points - 1) * (centre - low) / (high - low))
    return np.concatenate([np.linspace(low, centre, below + 1)[:-1], np.linspace(centre, high, points - below)])
