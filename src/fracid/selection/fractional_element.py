r"""Does a springpot explain what is left over?  A score test, and a fit where the test says so.

Orders of the derivatives do not imitate a springpot: on a rig with one at the pendulum, λ and μ stay near 1 and the
residual at several times the encoder's rounding.  To fit one in every joint of every rig would cost more than the fit
itself.  So its first effect is asked for: the derivative s of the residual e with respect to the springpot's strength
c at c = 0, what the unknowns can do in its place taken off (s⊥, orthogonal to the Jacobian).  To first order it
explains the share

.. math:: R^2 = \frac{(s_\perp \cdot e)^2}{|s_\perp|^2 |e|^2}, \qquad c = -\frac{s_\perp \cdot e}{|s_\perp|^2}

of the squares (Rao's score test; Cox and Hinkley, Theoretical Statistics, 1974, section 9.3), a few simulations a
joint.  Where that is more than :data:`SHARE`, with c > 0, the model is fitted with it; it is named where noise alone
is left then.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fracid.arrays import FloatArray, joined
from fracid.errors import Failure
from fracid.estimation.climbing import embedded
from fracid.estimation.derivatives import by_all
from fracid.estimation.horizons import Watch, lowest_from
from fracid.findings import Words
from fracid.models.friction import SPRINGPOT
from fracid.optimise import Evaluation
from fracid.problem import Free, Problem
from fracid.selection.bic import STRONG
from fracid.selection.integer_rival import Rival, freed_friction, gain_over, integer_values, moving, springpots
from fracid.selection.residual_noise import leftovers
from fracid.signals.coloured import directions

SAYS = Words("selection/fractional_element.toml")

SHARE = 0.3
"""Of the residual's squares that a springpot must explain, to first order, to be fitted."""

ORDERS = (0.2, 0.5, 0.8)
"""At which its effect is asked for."""

SMALL, LARGE = 1e-3, 0.3
"""The effect of the strength at which it is asked for, in parts of the residual: a derivative, yet no rounding."""

WEAK, TRACE = 1e-5, 1e-12
"""Of the largest strength: where it begins to ask, and what the other joints have meanwhile."""

SAME_DIRECTION = 1e-8
"""Directions of the Jacobian below this part of its largest singular value are none."""


class Score(NamedTuple):
    """What a springpot would explain, to first order."""

    name: str
    """``springpot_alpha``."""
    order: float
    strength: float
    """[N m s^ν/rad] or the parameter's own unit."""
    share: float
    """R² of the residual's squares; 0 where the strength would be negative."""


@dataclass(frozen=True)
class FractionalElement:
    """A springpot that explains what integer orders leave over."""

    name: str
    strength: float
    order: float
    cost: float
    before: float
    """The cost without it."""
    gain: float
    """Of BIC."""

    def __str__(self) -> str:
        """What it explains, in a sentence."""
        return SAYS("explains", element=self, gain=-self.gain)

    @property
    def remedy(self) -> str:
        """What to type."""
        return SAYS("remedy", element=self, upper=10 * self.strength, order=_order_of(self.name))


def scores(problem: Problem, x: FloatArray, *, jobs: int = 1) -> Iterator[Score]:
    """What a springpot in each joint that moves would explain of the residual at a minimum.

    Parameters
    ----------
    problem : Problem
        Without springpots.
    x : numpy.ndarray, shape (n_unknowns,)
        Its minimum.
    jobs : int
        Threads.
    """
    J = by_all(problem, x, jobs=jobs)
    if isinstance(J, Failure):
        return
    e = joined(J.errors)
    rows = np.concatenate([j.reshape(-1, len(x)) for j in J.parts])[np.isfinite(e)]
    e, scored = e[np.isfinite(e)], np.isfinite(e)
    Q = directions(rows, SAME_DIRECTION)
    for name in _names(problem):
        for order in ORDERS:
            s = _effect(problem, x, name, order, e=e, scored=scored)
            if s is None:
                continue
            s = s - Q @ (Q.T @ s)
            strength = -float(s @ e) / float(s @ s)
            share = float(s @ e) ** 2 / float(s @ s) / float(e @ e)
            yield Score(name, order, strength, share if strength > 0 else 0.0)


def fractional_element(
    problem: Problem, best: Evaluation, *, goal: float | None = None, jobs: int = 1
) -> FractionalElement | None:
    """The springpot that explains the residual of a fit better than its orders do, if there is one.

    Parameters
    ----------
    problem : Problem
    best : Evaluation
        Its minimum.
    goal : float, optional
        A cost that it must lie below too: of the best integer-order alternative.
    jobs : int
        Threads.

    Returns
    -------
    FractionalElement or None
        None where the model has none to give, has one already, or a record has a past.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, parameters={"springpot_alpha": 2e-4, "springpot_order_alpha": 0.4},
    ...                       orders={"lambda": 1.0, "mu": 1.0}, initial={"alpha": 0.5}, step=4e-3, end=4.0)
    >>> swing = Experiment("twin", 4e-3, run.states[:, [0, 2]], np.zeros((1, 1)))
    >>> problem = Problem(rig, (swing,), {"lambda": 1.0, "mu": Free(1.0, 0.5, 1.2)},
    ...                   {"b_alpha": Free(3e-4, 0.0, 0.1)}, initial_state="held")
    >>> best = lowest_from(problem, problem.start, Watch())
    >>> element = fractional_element(problem, best)
    >>> element.name, round(element.strength, 5), round(element.order, 2)
    ('springpot_alpha', 0.0002, 0.4)
    """
    if springpots(problem) or best.residuals is None or any(e.past is not None for e in problem.experiments):
        return None
    score = max(scores(problem, best.point, jobs=jobs), key=lambda s: s.share, default=None)
    if score is None or score.share < SHARE:
        return None
    order = _order_of(score.name)
    own = freed_friction(problem, [score.name])[score.name]
    free = {score.name: replace(own, start=score.strength, upper=max(own.upper, 10 * score.strength)),
            order: Free(score.order, 0.05, 0.95)}  # fmt: skip
    with_it = replace(problem, parameters={**problem.parameters, **free}, orders=integer_values(problem))
    end = lowest_from(with_it, embedded(with_it, problem.named(best.point)), Watch(jobs))
    if end.residuals is None:
        return None
    _, gain = gain_over(Rival(with_it, end, "", {}), problem, best)
    at = with_it.named(end.point)
    before = min(best.cost, best.cost if goal is None else goal)
    explained = all(left.explained for left in leftovers(with_it, end.point).values())
    if gain > -STRONG or end.cost**2 > (1 - SHARE) * before**2 or not explained:
        return None
    return FractionalElement(score.name, at[score.name], at[order], end.cost, before=before, gain=gain)


def _names(problem: Problem) -> list[str]:
    """The strengths of springpots that the problem fixes at none, of joints that move."""
    joints, all_names = ("", *moving(problem)), problem.model.parameter_names
    return [n for n, k in problem.model.friction.items() if k.rung == SPRINGPOT.rung and k.off == 0.0
            and k.joint in joints and _order_of(n) in all_names]  # fmt: skip


def _order_of(name: str) -> str:
    return name.replace("springpot_", "springpot_order_")


def _effect(
    problem: Problem, x: FloatArray, name: str, order: float, e: FloatArray, scored: NDArray[np.bool_]
) -> FloatArray | None:
    """∂e/∂c at a small c; None where no strength gives one.

    Between two strengths, neither of them 0: without the state of a springpot the same model is solved by another
    method, whose error differs by more than what a weak springpot does.  All joints have one, if of next to nothing,
    so that one right-hand side is compiled for all of them.
    """
    reach = {n: free.upper for n, free in freed_friction(problem, _names(problem)).items()}
    present = {n: TRACE * upper for n, upper in reach.items()}

    def errors(strength: float) -> FloatArray | None:
        own = {**present, name: strength, _order_of(name): order}
        there = replace(problem, parameters={**problem.parameters, **own})
        result = there.errors(embedded(there, problem.named(x)))
        return None if isinstance(result, Failure) else joined(result)[scored]

    strength = WEAK * reach[name]
    for _ in range(8):
        weak, strong = errors(0.1 * strength), errors(strength)
        change = None if weak is None or strong is None else strong - weak
        size = np.inf if change is None else float(np.linalg.norm(change) / np.linalg.norm(e))
        if change is not None and SMALL < size < LARGE:
            return np.asarray(change / (0.9 * strength))
        strength *= 0.1 if size >= LARGE else 10.0
    return None
