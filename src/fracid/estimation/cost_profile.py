r"""Profile likelihood: how far one unknown can go while all the others follow, before the data exclude it.

With the cost as a sum :math:`V(x) = \sum_t w_t\,ρ(e_t(x))`, as in :mod:`fracid.estimation.covariance`, the profile of
unknown i is :math:`V_i(v) = \min_{x:\,x_i = v} V(x)`, and its *rise*

.. math::  W_i(v) = \frac{2}{κ_i}\,\big(V_i(v) - V(\hat x)\big), \qquad
           κ_i = \frac{[A^{-1} S A^{-1}]_{ii}}{[A^{-1}]_{ii}} .

κ puts the threshold where the data put it: by Kent [K]_ twice the rise is :math:`κ_i χ^2_1` in the long run, whatever
the cost and however the residuals are correlated in time, since S is their long-run covariance.  So the 95 % interval
is where W < 3.84.  For white Gaussian residuals κ is σ² in the cost's unit and W the likelihood ratio's statistic; for
residuals that are correlated κ is larger by n/n_eff.  The same holds for ``iae``, ``itae`` and ``huber``, whose V is
no likelihood's.  A user's own cost has no S: its profile is drawn until the cost has doubled, without an interval.

Where the cost is a parabola, :math:`W = (v - \hat x_i)^2 / \mathrm{var}\,\hat x_i`: the profile's interval is the
sandwich's.  What it shows beyond that are the four ways in which data fail to fix a value:

==============  ==================================================================================
verdict         means
==============  ==================================================================================
two-sided       the rise crosses the threshold on both sides
one-sided       on one side alone: the data bound the value from below only, or from above only
flat            on neither side: as far as was looked, the data do not object to any value
hits a bound    the best value lies at a bound of the search; the interval has one side
==============  ==================================================================================

The walk goes from the minimum to both sides.  Each point starts from its neighbour, moved on along the line through
the last two (the first along that of A), and its step aims at equal rises of √W, which is linear where the cost is a
parabola [BW]_; a step that rises too far, or whose runs fail, is taken again shorter.  It ends past the threshold, at
the bound, or where its budget is spent.  If a point lies lower than the minimum, that was none: all starts again from
there, and the result says so.

Two unknowns together: W over a grid with the threshold of :math:`χ^2_2`, 5.99, each point scaled by the sandwich in
its own direction δ, :math:`1/κ = (δ'C_S^{-1}δ)/(δ'C_A^{-1}δ)` with the blocks of the two in place of the diagonal
entries [CB]_.

References
----------
.. [K] J. Kent, Biometrika 69 (1982) 19: the likelihood ratio of a likelihood that is not the data's.
.. [BW] D. Bates, D. Watts, Nonlinear Regression Analysis and Its Applications, Wiley 1988, section 6.1.
.. [CB] R. Chandler, S. Bate, Biometrika 94 (2007) 167, section 3: the vertical adjustment.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field

from fracid.arrays import FloatArray
from fracid.cards import Card, CardDisplay, listed
from fracid.errors import InputError, at_least, brief, unknown_name
from fracid.estimation.cost_plane import axis_about
from fracid.estimation.covariance import METHODS
from fracid.estimation.fit_figures import FitPictures
from fracid.estimation.profile_walk import LOWER, Branch, End, Surface, crossing, refit, walk
from fracid.figures import Figure, Style, draw
from fracid.findings import Words
from fracid.problem import Problem
from fracid.problem.checks import require_free
from fracid.problem.project import Project
from fracid.quantiles import CHI2_95, NORMAL_95
from fracid.safety.json_files import short_text
from fracid.safety.schema import (
    UNREAD,
    Array,
    Beside,
    Block,
    InfiniteArray,
    InfiniteMatrix,
    Interval,
    Listed,
    Number,
    OpenInterval,
    Pair,
    Record,
    Unknown,
)
from fracid.solver.trajectory import vector
from fracid.tasks.display import counted
from fracid.tasks.job import Counter, Progress, in_threads
from fracid.units import letter, with_unit

SAYS = Words("estimation/cost_profile.toml")

Two = Annotated[tuple[str, ...], Pair]


@dataclass(frozen=True, repr=False, kw_only=True)
class Profile(CardDisplay, Record):
    """The profile of one unknown."""

    name: Beside[str] = ""
    best: Annotated[float, Field(alias="value")]
    """The value at the minimum."""
    unit: str
    interval95: OpenInterval
    """Where W = 3.84, None on a side where that is not reached."""
    method: str = METHODS["profile"]
    wald95: Interval | None
    """The sandwich's interval; None where it knows none."""
    wald_method: str = METHODS["sandwich"]
    verdict: str
    """See the module's table; "no threshold" for a user's own cost."""
    sentence: str
    """The verdict with the reason on each side that has no end."""
    ends: Two
    """Why the walk ended, below and above."""
    values: Array
    """In ascending order, the best among them, shape (n_points,)."""
    rise: InfiniteArray
    """W at each, shape (n_points,)."""
    cost: InfiniteArray
    """The problem's cost at each, shape (n_points,)."""
    points: Beside[FloatArray] = UNREAD
    """All unknowns at each, shape (n_points, n_unknowns); None of what was read."""

    @property
    def two_sided(self) -> tuple[float, float] | None:
        """The interval, where it has two sides."""
        low, high = self.interval95
        return None if low is None or high is None else (low, high)

    def _card(self) -> Card:
        points = f"{self.values.size} from {self._shown(self.values[0])} to {self._shown(self.values[-1])}"
        return Card(f"Profile of {letter(self.name)}: {self.sentence}", (
            ("minimum", self._shown(self.best)),
            ("95 % interval", self._interval(self.interval95)),
            ("sandwich", "none" if self.wald95 is None else self._interval(self.wald95)),
            ("points", points),
        ))  # fmt: skip

    @property
    def summary(self) -> str:
        """The minimum, the interval and the verdict, in one line."""
        return f"{self._shown(self.best)}, 95 % interval {self._interval(self.interval95)}, {self.sentence}"

    def _shown(self, value: float | None) -> str:
        return "open" if value is None else with_unit(value, self.unit or "1", ".6g").replace("-", "−")

    def _interval(self, ends: Sequence[float | None]) -> str:
        return " to ".join(map(self._shown, ends))


@dataclass(frozen=True, kw_only=True)
class JointProfile(Record):
    """The profile of two unknowns together."""

    names: Two
    units: Two
    best: Interval
    first: Array
    """Values of the first, shape (n,)."""
    second: Array
    """Values of the second, shape (m,)."""
    threshold: float = CHI2_95[2]
    rise: InfiniteMatrix
    """W, shape (n, m); infinite where the runs fail.  The 95 % region is where it is below the threshold."""
    correlation: Unknown
    """Of the two by the sandwich."""


class CostAtBest(Block):
    """The cost that the profiles rise from."""

    name: str
    value: float


def _named(profiles: dict[str, Profile]) -> dict[str, Profile]:
    return {name: replace(p, name=name) for name, p in profiles.items()}


@dataclass(frozen=True, repr=False, kw_only=True)
class Profiles(CardDisplay, Record):
    """What :func:`profile` found."""

    at_best: Annotated[CostAtBest, Field(alias="cost")]
    minimum: Mapping[str, float]
    """That the profiles start from."""
    threshold: Number
    """Of a single one; None for a user's own cost."""
    profiles: Annotated[dict[str, Profile], AfterValidator(_named)]
    joint: JointProfile | None = None
    notes: Listed[str] = ()
    """That the minimum given was none; that there is no threshold."""
    problem: Beside[Problem] = UNREAD

    @property
    def x(self) -> FloatArray:
        """The minimum, shape (n_unknowns,)."""
        return np.array([self.minimum[n] for n in self.problem.names])

    @property
    def cost(self) -> float:
        """At the minimum."""
        return self.at_best.value

    def incoherence(self) -> str:
        """Lists that do not belong together."""
        for name, p in self.profiles.items():
            if not 0 < len(p.values) == len(p.rise) == len(p.cost):
                return f"the profile of {short_text(name)} has lists of different lengths"
        joint = self.joint
        if joint and [len(joint.second)] * len(joint.first) != [len(row) for row in joint.rise]:
            return "its joint profile has lists of different lengths"
        return ""

    def _card(self) -> Card:
        joint = "" if self.joint is None else f" and {' with '.join(letter(n) for n in self.joint.names)}"
        return Card(f"Profiles of {listed(letter(n) for n in self.profiles)}{joint}", (
            *((letter(n), p.summary) for n, p in self.profiles.items()),
            *(("note", note) for note in self.notes),
        ))  # fmt: skip

    def plot(self, *, style: str | Style = "screen") -> Figure:
        """The rise of the cost over each unknown, and its threshold; see :func:`fracid.plots.profiles`.

        Parameters
        ----------
        style : str or Style
            ``screen``, ``journal`` or one's own; see :mod:`fracid.figures`.
        """
        return draw("profiles", self, style=style)


@counted("points")
def profile(
    problem: Problem | Project | FitPictures,
    x: FloatArray | None = None,
    *,
    parameters: Sequence[str] | None = None,
    joint: tuple[str, str] | None = None,
    points: int = 12,
    jobs: int = 1,
    progress: Callable[[Progress], None] | None = None,
) -> Profiles:
    """Profile unknowns of a problem about its minimum.

    Parameters
    ----------
    problem : Problem, Project or Fit
    x : array, shape (n_unknowns,), optional
        The minimum, which is refined first; a Fit's own, or the problem's start, if left out.
    parameters : sequence of str, optional
        Names of unknowns: the free orders if left out, or all that the recordings share where no order is free.
    joint : two names, optional
        To be profiled together too, on a grid of `points` by `points`, nine by nine at most.
    points : int
        Between the two ends of an interval, about.
    jobs : int
        Threads; the result is the same for any number.
    progress : function (Progress) -> None, optional
        Called after each point, with about how many there will be.

    Returns
    -------
    Profiles

    Raises
    ------
    InputError
        If a name is no unknown's, nothing is free, or no run from the start reaches its end.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment, Free
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=5e-3, end=2.0)
    >>> noise = 1e-3 * np.random.default_rng(1).standard_normal((401, 2))
    >>> swing = Experiment("twin", 5e-3, run.states[:, [0, 2]] + noise, np.zeros((1, 1)), initial={"alpha": 0.3})
    >>> problem = Problem(rig, (swing,), {"lambda": Free(0.9, 0.5, 1.2), "mu": Free(0.95, 0.5, 1.2)},
    ...                   initial_state="held")
    >>> mu = profile(problem, parameters=["mu"]).profiles["mu"]
    >>> mu.verdict, mu.interval95[0] < 0.95 < mu.interval95[1]
    ('two-sided', True)
    """
    if not isinstance(problem, Problem):
        x = getattr(problem, "x", None) if x is None else x
        problem = problem.problem
    if x is not None and any(isinstance(value, str) for value in x):
        raise InputError(f"x = {brief(x)} are names; x is the minimum. Type parameters={[*map(str, x)]!r}.")
    at = _indices(problem, parameters)
    pair = None if joint is None else _pair(problem, joint)
    at_least("points", points, 4)
    at_least("jobs", jobs, 1)
    x, notes = problem.start if x is None else vector("x", x), list[str]()
    count = Counter(progress, 0 if joint is None else min(points, GRID) ** 2, about=True)
    for _ in range(3):
        surface = _minimum(problem, x, at, jobs)
        walks, x, lower = _walks(surface, at, points, count)
        if lower > -LOWER:
            break
        notes.append(f"A point of the profile has a lower cost than the minimum, W = {lower:.2g}; all starts from it.")
    pairs = zip(at, walks[::2], walks[1::2], strict=True)
    profiles = {problem.names[i]: _join(surface, i, below, above) for i, below, above in pairs}
    if not surface.calibrated:
        notes.append(f"The cost {problem.cost_function.name} is a user's own, of unknown loss: there is no threshold.")
    grid = None if pair is None else _joint(surface, pair, profiles, points, count=count)
    return Profiles(
        problem=problem, minimum=problem.named(surface.top.point), profiles=profiles, joint=grid, notes=tuple(notes),
        at_best=CostAtBest(name=problem.cost_function.name, value=surface.top.cost),
        threshold=CHI2_95[1] if surface.calibrated else None,
    )  # fmt: skip


def _minimum(problem: Problem, x: FloatArray, at: Sequence[int], jobs: int) -> Surface:
    """V about the minimum next to x: about x itself where that is as good, lest flat directions drift."""
    there, top = problem.evaluate(problem.space.clipped(x)), refit(problem, x)
    if not math.isfinite(top.cost):
        raise InputError(f"There is nothing to profile: no run from the start reached its end: {top.reason}.")
    surface = Surface(problem, top, jobs)
    good = there.value <= top.value or max(surface.rise(there, i) for i in at) < LOWER
    return Surface(problem, there, jobs) if good else surface


def _walks(surface: Surface, at: Sequence[int], points: int, count: Counter) -> tuple[list[Branch], FloatArray, float]:
    """Both sides of each unknown, and of all their points the lowest, with its rise."""
    tasks = [(i, side) for i in at for side in (-1, 1)]
    usual = points // 2
    count.expect(usual * len(tasks))

    def walked_one(task: tuple[int, int]) -> Branch:
        branch = walk(surface, *task, points, count)
        count.expect(len(branch.path) - usual)
        return branch

    walks = in_threads(surface.jobs, walked_one, tasks)
    pairs = zip(tasks, walks, strict=True)
    candidates = [(e.point, surface.rise(e, i)) for (i, _), walked in pairs for e in walked.path]
    return walks, *min(candidates, key=lambda pair: pair[1], default=(surface.top.point, 0.0))


def _indices(problem: Problem, names: Sequence[str] | None) -> list[int]:
    require_free(problem.names)
    if names is None:
        shared = [i for i, u in enumerate(problem.unknowns) if u.experiment is None]
        return list(problem.order_indices) or shared or list(range(len(problem.names)))
    return [_index(problem, name) for name in dict.fromkeys(names)]


def _index(problem: Problem, name: str) -> int:
    if name in problem.names:
        return problem.names.index(name)
    if name in problem.orders or name in problem.model.parameter_names:
        raise InputError(SAYS("not-free", name=name, free=", ".join(problem.names)))
    raise unknown_name("name", name, problem.names)


def _pair(problem: Problem, names: Sequence[str]) -> tuple[int, int]:
    if len(names) != 2 or names[0] == names[1]:
        raise InputError(f"joint = {', '.join(names)!r}; expected two different names, such as mu and b_alpha.")
    return _index(problem, names[0]), _index(problem, names[1])


def _join(surface: Surface, i: int, below: Branch, above: Branch) -> Profile:
    """Both sides and the minimum between them."""
    parameter, path = surface.problem.unknowns[i], (*below.path[::-1], surface.top, *above.path)
    values = np.array([e.point[i] for e in path])
    rise = np.array([surface.rise(e, i) for e in path])
    best, k = float(surface.top.point[i]), len(below.path)
    ends = (crossing(values[k::-1], rise[k::-1]), crossing(values[k:], rise[k:]))
    if not surface.calibrated:
        ends = (None, None)
    se = surface.standard_error(i)
    sides = {"below": below.end, "above": above.end}
    crossed = sum(end is End.CROSSED for end in sides.values())
    one = "hits a bound" if i in surface.at_bound else "one-sided"
    verdict = ("flat", one, "two-sided")[crossed] if surface.calibrated else "no threshold"
    open_ = ", ".join(f"{side} {end.value}" for side, end in sides.items() if end is not End.CROSSED)
    known = math.isfinite(se) and i not in surface.at_bound
    return Profile(
        name=parameter.name, unit=parameter.unit, best=best, values=values, rise=rise,
        cost=np.array([e.cost for e in path]), points=np.array([e.point for e in path]),
        ends=(below.end, above.end), interval95=ends,
        wald95=(best - NORMAL_95 * se, best + NORMAL_95 * se) if known else None,
        verdict=verdict, sentence=f"{verdict}: {open_}" if open_ else verdict,
    )  # fmt: skip


# --- two together --------------------------------------------------------------------------------------

GRID = 9
"""Points along each side of a joint profile at most: each of the grid's is a refit."""

REACH = 3.2
"""Standard errors to each side of a joint profile; its 95 % region reaches 2.45."""


def _joint(
    surface: Surface, pair: tuple[int, int], profiles: dict[str, Profile], points: int, count: Counter
) -> JointProfile:
    """W over a grid; each point starts from where the parabola would have it."""
    if not surface.calibrated:
        raise InputError(f"The cost {surface.problem.cost_function.name} is a user's own: no joint profile of it.")
    axes = [_axis(surface, i, profiles.get(surface.problem.names[i]), min(points, GRID)) for i in pair]
    shape, slope, top = surface.sandwich(*pair), surface.slope(pair), surface.top.point
    at, tolerance = np.searchsorted(shape.free, pair), surface.tolerance(*pair)
    bread, filled = (np.linalg.pinv(c[np.ix_(at, at)]) for c in (shape.inverse, shape.covariance))

    def rise(point: FloatArray) -> float:
        delta = point - top[list(pair)]
        count()
        if not np.any(delta):
            return 0.0
        ahead = top + slope @ delta
        ahead[list(pair)] = point
        value = refit(surface.problem, ahead, pair, tolerance=tolerance).value - surface.top.value
        return 2 * value * float(delta @ filled @ delta) / max(float(delta @ bread @ delta), 1e-300)

    grid = [np.array([a, b]) for a in axes[0] for b in axes[1]]
    rises = np.array(in_threads(surface.jobs, rise, grid)).reshape(len(axes[0]), len(axes[1]))
    c = shape.covariance[np.ix_(at, at)]
    correlation = c[0, 1] / math.sqrt(c[0, 0] * c[1, 1]) if c[0, 0] > 0 and c[1, 1] > 0 else math.nan
    names, units = zip(*((u.name, u.unit) for u in (surface.problem.unknowns[i] for i in pair)), strict=True)
    best = (float(top[pair[0]]), float(top[pair[1]]))
    return JointProfile(names=names, units=units, best=best, first=axes[0], second=axes[1], rise=rises,
                        correlation=float(correlation))  # fmt: skip


def _axis(surface: Surface, i: int, curve: Profile | None, points: int) -> FloatArray:
    """Values about the best, which is one of them, as far as the profile's interval says, within the bounds."""
    best, low, high = float(surface.top.point[i]), float(surface.space.lower[i]), float(surface.space.upper[i])
    se = surface.standard_error(i)
    reach = REACH * se if math.isfinite(se) else 0.25 * (high - low if math.isfinite(high - low) else abs(best) + 1)
    ends = (None, None) if curve is None else curve.interval95
    below, above = (reach if end is None else max(0.3 * reach, REACH / NORMAL_95 * abs(end - best)) for end in ends)
    return axis_about(best, max(low, best - below), min(high, best + above), points)
