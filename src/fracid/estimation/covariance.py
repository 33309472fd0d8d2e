r"""How sure an estimate is: the covariance of the unknowns of a problem, and which of them cannot be told.

At the minimum of :math:`\sum_t w_t\,ρ(e_t(x))` over samples t, with :math:`J_t = \partial e_t/\partial x` and
scores :math:`s_t = w_t\,ρ'(e_t)\,J_t`,

.. math::  \mathrm{cov}\,\hat x = A^{-1} S A^{-1}, \quad A = \sum \overline{ρ''}\,w_t J_t J_t', \quad
           S = \Gamma_0 + \sum_{k=1}^{B}\Big(1 - \frac{k}{B+1}\Big)(\Gamma_k + \Gamma_k'), \;
           \Gamma_k = \sum_t s_t s_{t+k}' ,

with :math:`\overline{ρ''}` the mean over each output of a recording: for the square it is 2, for \|e\| twice the
residual's density at zero (:mod:`fracid.problem.costs`), and recordings differ in noise.

This is the M-estimator's sandwich [H]_ with the long-run covariance of Newey and West [NW]_: it holds for
residuals that are correlated in time, as 20,000 samples of a 1 kHz recording are, where
:math:`\sigma^2 (J'J)^{-1}` would promise intervals many times too narrow.  The bandwidth B is five correlation
times of the scores, found from them by Sokal's window [S]_; the scores are whitened by their lag-one correlation
before, and S is coloured again after (:mod:`fracid.estimation.block_covariance`).  Outputs that are measured less often
than others have an S and a bandwidth of their own, over their own samples, and the parts of S are added: what the
residuals of the two have in common is not in it.

**Few samples.**  Of some unknowns but a few samples tell: of an initial angle the first swing, of whatever is slow a
handful of correlation times.  Their S is too small, since the fit has bent towards their errors, and it is itself
uncertain.  With :math:`v_i` the i-th column of :math:`A^{-1}`, :math:`M_t = R_t'R_t` the share of sample t in A, the
influence :math:`q_t = v_i' M_t v_i` and :math:`K_{ts} = 1 - |t - s|/(B + 1)` within the bandwidth, else 0,

.. math::  f_i = \frac{\sum_{ts} K_{ts}\, v_i' M_t A^{-1} M_s v_i}{\sum_t q_t}, \qquad
           ν_i = \frac{(\sum_t q_t)^2}{\sum_{ts} K_{ts}^2\, q_t q_s} :

the fit takes the part f of the variance out of the residuals [BM]_, and what is left is known as a variance of ν
degrees of freedom is [Sa]_.  So standard errors are widened by :math:`t_{0.975}(ν)/1.96/\sqrt{1 - f}` [IK]_: 1.96 of
them to each side contain the true value in 95 %.  For white noise f is 0.02 to 0.2 and ν 10 to 200.

How often a 95 % interval of λ and of μ contains the true value, on twins of 4 s at 500 Hz, 150 seeds
(``benchmarks/evidence.py`` prints it again; ``make coverage`` for all rigs, docs/uncertainty.md):

====================================== ============== ==========================
noise                                  this           :math:`\sigma^2 (J'J)^{-1}`
====================================== ============== ==========================
white                                  94 %, 95 %     94 %, 95 %
AR(1), ρ = 0.9                         98 %, 95 %     28 %, 38 %
AR(1), ρ = 0.98, and as much white     91 %, 95 %     19 %, 31 %
====================================== ============== ==========================

Where errors are slow beside the record and few unknowns are free, as in the last row, it still promises a little
too much; with many it is up to twice as wide as it need be.  A bandwidth of the whitened scores comes closer for
AR(1), and contains the true value in but 83 to 93 % for the last row, so it is that of the scores themselves.

It does not know of model error: an interval says where the best value *of this model* lies.

Both are found, by name in :data:`METHODS`.  Their ratio says how many of the n samples count: as many independent
ones as :math:`n_{eff,i} = n\,\mathrm{var}_{white}(\hat x_i)/\mathrm{var}(\hat x_i)`, before it is widened, would tell
:math:`x_i` as well.
"White" is :math:`A^{-1} S_0 A^{-1}` with :math:`S_0 = \sum \overline{ρ'^2}\, w_t^2 J_t J_t'`, the mean that of each
output of a recording: for the square, and one variance of all, :math:`\sigma^2 (J'J)^{-1}`.

Directions that J does not see (singular values of the column-scaled J below 10⁻⁶ of the largest) are reported by the
names that take part in them; they are looked for with every column in, those of unknowns at a bound too.

**Bounds.**  An interval ends where the parabola of the cost, all other unknowns at the best that their bounds allow,
has risen by :math:`1.96^2 κ_i/2` with :math:`κ_i = [A^{-1}SA^{-1}]_{ii}/[A^{-1}]_{ii}`
(:mod:`fracid.estimation.bounded`): 1.96 standard errors where no bound is on the way.  An unknown at a bound has an
interval that begins there, and those of the others hold with it free.  Where a bound of another unknown stops it on the
way, and the true value lies next to that bound, as friction that is not there does, the error across the valley counts
too, on the one side that the bound does not mend: the rise is then an even mixture of :math:`χ^2_1` and
:math:`χ^2_2` [SL]_, of which 95 % lie below 5.14 in place of 1.96².

An encoder without dither leaves errors that are no noise: where it rests all are one.  What they do is known from the
trajectory (:mod:`fracid.estimation.rounding`), and takes the place of S for outputs of which noise and rounding explain
all; of others that leave up to twice as much it is added.

References
----------
.. [BM] R. Bell, D. McCaffrey, Survey Methodology 28 (2002) 169: what the fit takes out of the residuals.
.. [H] P. Huber, Proc. 5th Berkeley Symposium 1 (1967) 221.
.. [IK] G. Imbens, M. Kolesár, Review of Economics and Statistics 98 (2016) 701: widened standard errors.
.. [NW] W. Newey, K. West, Econometrica 55 (1987) 703: the sandwich.
.. [SL] S. Self, K.-Y. Liang, J. Amer. Statist. Assoc. 82 (1987) 605: likelihood ratios at a bound.
.. [S] A. Sokal, in Functional Integration: Basics and Applications, NATO ASI B 361 (1997) 131: the bandwidth.
.. [Sa] F. Satterthwaite, Biometrics Bulletin 2 (1946) 110: degrees of freedom of a sum of squares.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fracid.arrays import BoolArray, FloatArray, spacing
from fracid.errors import Failure, FailureReason
from fracid.estimation.block_covariance import (
    block_long_run,
    block_sandwiched,
    normal_equations,
    scores_in,
    widening,
    window_sums,
)
from fracid.estimation.block_jacobian import BlockJacobian
from fracid.estimation.bounded import lowest, reach
from fracid.estimation.derivatives import by_blocks, loss_of, slopes_of
from fracid.estimation.rounding import edges, half_widths
from fracid.estimation.tangent import Tangent, tangent
from fracid.optimise import Space
from fracid.problem import Problem
from fracid.quantiles import NORMAL_95
from fracid.safety.door import own_text
from fracid.signals.correlation import bartlett_long_run, sokal_bandwidth

LEAST_SHIFT = 1e-4
"""An order that moves by less does not matter, however narrow its interval."""

METHODS: dict[str, str] = tomllib.loads(own_text("estimation/covariance.toml"))
"""What an interval's method is called, and what it is."""

OF_FITS = {name: METHODS[name] for name in ("sandwich", "white", "walk")}
"""Those of a fit's intervals."""

PART = 1e-2
"""Who has less than this of the largest share in an unseen direction, of the changes relative to their sizes and of
what these do to the samples, takes no part in it."""

BESIDE_A_BOUND = 5.14
"""In place of 1.96²: 95 % of an even mixture of χ² of one and of two degrees of freedom."""


Stops = Mapping[tuple[int, int], Mapping[int, float]]
"""The bounds that end intervals, by whose they are, of an unknown's interval to one side."""


@dataclass(frozen=True)
class Uncertainty:
    """Standard errors of the unknowns, and what the data say nothing about."""

    standard_error: FloatArray
    """1.96 of them to each side hold 95 %, were there no bounds; NaN where it cannot be known, shape (n_unknowns,)."""
    at_bound: BoolArray
    """Shape (n_unknowns,)."""
    confounded: tuple[tuple[str, ...], ...]
    """Names that can only be known together, one tuple for each direction that the data do not see."""
    white: FloatArray
    """Standard errors by σ²(J'J)⁻¹, as if the residuals were white, shape (n_unknowns,); NaN where the others are."""
    covariance: FloatArray
    """Of the sandwich, shape (n_unknowns, n_unknowns); NaN in the rows of what has no standard error."""
    unseen: FloatArray
    """Relative changes of the unknowns that the data do not see, shape (len(confounded), n_unknowns); the
    greatest in a row is 1."""
    samples: float
    """Of all recordings, of an output on average."""
    widening: FloatArray
    """By what the standard errors were widened for few samples, shape (n_unknowns,)."""
    ends: FloatArray
    """Of the 95 % intervals, shape (n_unknowns, 2); NaN where there is none."""
    rise: FloatArray
    """By how much V rises to both ends, shape (n_unknowns, 2); NaN where that is not known."""
    start: FloatArray
    """What the noise of a start that is taken from samples adds, one standard deviation, shape (n_unknowns,)."""
    walked: BoolArray
    """Which intervals end where the cost itself reaches the limit, not its parabola, shape (n_unknowns,)."""
    stops: Stops = field(default_factory=dict)
    """The bounds on the way to an interval's end."""
    unwalked: int = 0
    """Ends that were left while they were looked for, as the work was spent."""
    elsewhere: FloatArray | None = None
    """Another minimum that is as good, where it is apart from this one, else NaN, shape (n_unknowns,)."""

    def interval(self, x: FloatArray, i: int, method: str = "sandwich") -> tuple[float, float] | None:
        """The 95 % interval of unknown i by ``sandwich`` or ``white``, None where there is none."""
        ends = self.ends[i] if method == "sandwich" else x[i] + NORMAL_95 * self.white[i] * np.array((-1.0, 1.0))
        low, high = ends.tolist()
        return (low, high) if math.isfinite(low) and math.isfinite(high) else None

    def half_beyond_bounds(self, i: int) -> float:
        """Half the interval of unknown i were no other one stopped by a bound; 0 where none is, NaN where unknown."""
        others = np.delete(self.at_bound, i)
        return math.sqrt(BESIDE_A_BOUND) * float(self.standard_error[i]) if others.any() else 0.0

    def method(self, i: int) -> str | None:
        """How the interval of unknown i was made: a key of :data:`METHODS`; None where there is none."""
        if not np.all(np.isfinite(self.ends[i])):
            return None
        return "walk" if self.walked[i] else "sandwich"

    def wider(self, space: Space, x: FloatArray, shift: FloatArray) -> Uncertainty:
        """Wider by what moves each unknown by a standard deviation of its own, shape (n_unknowns,)."""
        sd = np.where(self.walked, np.max(np.abs(self.ends - x[:, None]), axis=1) / NORMAL_95, self.standard_error)
        with np.errstate(divide="ignore", invalid="ignore"):
            wider = np.nan_to_num(np.hypot(1.0, shift / sd), nan=1.0, posinf=1.0)
        ends = x[:, None] + wider[:, None] * (self.ends - x[:, None])
        return replace(
            self, standard_error=self.standard_error * wider, covariance=self.covariance * np.outer(wider, wider),
            ends=np.clip(ends, space.lower[:, None], space.upper[:, None]), rise=self.rise * wider[:, None] ** 2,
        )  # fmt: skip

    @property
    def effective_samples(self) -> FloatArray:
        """How many independent samples would tell each unknown as well, shape (n_unknowns,)."""
        return np.asarray(self.samples * (self.white * self.widening / self.standard_error) ** 2)


Known = Uncertainty | Failure
"""How well the unknowns of a minimum are known, or why there is no telling."""


class Sandwich(NamedTuple):
    """The curvature of the cost and the scatter of its minimum, over some of the unknowns."""

    free: NDArray[np.intp]
    """Which, shape (n_free,)."""
    inverse: FloatArray
    """A⁻¹ of the cost's rows, the inverse of its curvature, shape (n_free, n_free); pseudo-inverse where J is blind."""
    covariance: FloatArray
    """A⁻¹SA⁻¹, widened for few samples, shape (n_free, n_free)."""
    white: FloatArray
    """A⁻¹S₀A⁻¹, shape (n_free, n_free)."""
    directions: FloatArray
    """Changes of the unknowns, in their own units, that J does not see, shape (n_unseen, n_free)."""
    effects: FloatArray
    """What a unit of each unknown does to the samples, √A_ii, shape (n_free,)."""
    widening: FloatArray
    """By what the standard errors were widened for few samples, shape (n_free,)."""


def uncertainty(problem: Problem, x: FloatArray, *, jobs: int = 1, near: Tangent | None = None) -> Known:
    """Find the covariance at the minimum x, or say why there is none.

    Parameters
    ----------
    problem : Problem
    x : array, shape (n_unknowns,)
        Its minimum; elsewhere the result means nothing.
    jobs : int
        Threads.
    near : Tangent, optional
        Errors and derivatives there; found if left out.

    Returns
    -------
    Uncertainty or Failure
        The failure says why there is none: nothing is free, a user's own cost, a run that fails.

    Examples
    --------
    >>> import fracid, numpy as np
    >>> from fracid.problem import Experiment, Free, Problem
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=2e-3, end=4.0)
    >>> noise = 1e-3 * np.random.default_rng(1).standard_normal((2001, 2))
    >>> swing = Experiment("twin", 2e-3, run.states[:, [0, 2]] + noise, np.zeros((1, 1)), initial={"alpha": 0.3})
    >>> problem = Problem(rig, (swing,), {"lambda": Free(0.9, 0.5, 1.2), "mu": Free(0.95, 0.5, 1.2)},
    ...                   initial_state="held")
    >>> found = uncertainty(problem, problem.start)  # here the start is the minimum
    >>> bool(np.all((found.standard_error > 1e-6) & (found.standard_error < 1e-3))), found.confounded
    (True, ())
    """
    if not problem.names:
        return Failure(FailureReason.NOTHING_FREE, "nothing is free")
    if problem.cost_function.loss is None:
        return Failure(FailureReason.OWN_COST, f"{problem.cost_function.name} is a user's own cost, of unknown loss")
    if problem.blocks is not None:
        found = sandwich(problem, x, np.arange(len(x)), jobs=jobs)
        if isinstance(found, Failure):
            return found
        touching = (x <= problem.space.lower) | (x >= problem.space.upper)
        ends = x[:, None] + NORMAL_95 * np.outer(np.sqrt(np.diag(found.covariance)), (-1.0, 1.0))
        return _spread_out(problem, x, found, touching, ends=ends, rise=np.full_like(ends, np.nan), stops={})
    here = tangent(problem, x, jobs=jobs) if near is None else near
    if isinstance(here, Failure):
        return here
    free = np.flatnonzero(~(problem.absent(x) & here.touching))  # an element that is not there has nothing to tell
    if not len(free):
        return Failure(FailureReason.AT_BOUND, "all free parameters are of elements that are not there")
    estimator = _sandwich(problem, here.by(free), free)
    return _spread_out(problem, x, estimator, here.touching, *_ends(here, estimator))


def _spread_out(
    problem: Problem, x: FloatArray, found: Sandwich, held: BoolArray, ends: FloatArray, rise: FloatArray, stops: Stops
) -> Uncertainty:
    """The sandwich of the free unknowns in places of all, without what the data cannot separate."""
    free, space = found.free, problem.space
    directions = _sparse(found.directions / space.sizes(x)[free], found.effects * space.sizes(x)[free])
    at = np.flatnonzero(~np.any(directions != 0, axis=0))
    seen, n = free[at], len(x)
    (error, white), (limits, rises), covariance = (np.full(s, np.nan) for s in ((2, n), (2, n, 2), (n, n)))
    wider, null_space = np.ones(n), np.zeros((len(directions), n))
    error[seen] = np.sqrt(np.maximum(np.diag(found.covariance), 0.0))[at]  # rounding, where nothing is left over
    white[seen] = np.sqrt(np.maximum(np.diag(found.white), 0.0))[at]
    covariance[np.ix_(seen, seen)] = found.covariance[np.ix_(at, at)]
    wider[free], null_space[:, free] = found.widening, directions
    limits[seen], rises[free] = np.clip(ends[at], space.lower[seen, None], space.upper[seen, None]), rise
    confounded = tuple(tuple(problem.names[i] for i in np.flatnonzero(row)) for row in null_space)
    samples = sum(e.samples for e in problem.experiments)
    return Uncertainty(error, held, confounded, white, covariance=covariance, unseen=null_space, samples=samples,
                       widening=wider, ends=limits, rise=rises, start=np.zeros(n),
                       walked=np.zeros(n, dtype=bool), stops=stops)  # fmt: skip


def _ends(here: Tangent, estimator: Sandwich) -> tuple[FloatArray, FloatArray, Stops]:
    """Of the 95 % intervals of the free unknowns, by how much V rises to them, shapes (n_free, 2), and what stops."""
    free, space = estimator.free, here.problem.space
    R, low, high = here.R[:, free], (space.lower - here.x)[free], (space.upper - here.x)[free]
    delta = lowest(R, here.y, low, high)  # next to nothing at a minimum
    y = here.y + R @ delta
    if here.problem.cost_function.kinked:
        delta = np.zeros_like(delta)
    low, high = low - delta, high - delta
    inverse, covariance = np.diag(estimator.inverse), np.diag(estimator.covariance)
    kappa = np.divide(covariance, inverse, out=np.zeros_like(inverse), where=inverse > 0)
    stops: dict[tuple[int, int], Mapping[int, float]] = {}
    ends, rise = np.empty((len(free), 2)), np.outer(0.5 * NORMAL_95**2 * kappa, (1.0, 1.0))
    for k, i in enumerate(free):
        for side, sign in enumerate((-1, 1)):
            far, at = reach(R, y, low, high, i=k, side=sign, rise=rise[k, side])
            if np.any(np.delete(at, k)):
                rise[k, side] *= BESIDE_A_BOUND / NORMAL_95**2
                far, at = reach(R, y, low, high, i=k, side=sign, rise=rise[k, side])
            bounds = np.where(at < 0, space.lower[free], space.upper[free])
            stops[int(i), side] = {int(free[j]): float(bounds[j]) for j in np.flatnonzero(at)}
            end = here.x[i] + delta[k] + sign * far
            ends[k, side] = max(end, here.x[i]) if side else min(end, here.x[i])
    return ends, rise, stops


def at_bound(problem: Problem, x: FloatArray, *, jobs: int = 1) -> BoolArray:
    """Which unknowns lie at a bound, shape (n_unknowns,): closer than what the data could tell apart.

    Examples
    --------
    >>> import fracid, numpy as np
    >>> from fracid.problem import Experiment, Free, Problem
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 1.0, "mu": 1.0}, initial={"alpha": 0.3}, step=1e-2, end=4.0)
    >>> noise = 1e-3 * np.random.default_rng(1).standard_normal((401, 2))
    >>> swing = Experiment("twin", 1e-2, run.states[:, [0, 2]] + noise, np.zeros((1, 1)), initial={"alpha": 0.3})
    >>> wide = Free(start=rig.parameter("b_alpha").value, lower=0.0, upper=10.0)
    >>> dry = Free(start=0.0, lower=0.0, upper=10.0)
    >>> problem = Problem(rig, (swing,), {"lambda": 1.0, "mu": 1.0}, {"b_alpha": wide, "coulomb_alpha": dry},
    ...                   initial_state="held")
    >>> {n: bool(held) for n, held in zip(problem.names, at_bound(problem, problem.start))}
    {'b_alpha': False, 'coulomb_alpha': True}
    """
    flat = problem.blocks is None and problem.cost_function.loss is not None
    here = tangent(problem, x, jobs=jobs) if flat else None
    return here.touching if isinstance(here, Tangent) else (x <= problem.space.lower) | (x >= problem.space.upper)


def sandwich(problem: Problem, x: FloatArray, free: NDArray[np.intp], *, jobs: int = 1) -> Sandwich | Failure:
    """A⁻¹, A⁻¹SA⁻¹ and A⁻¹S₀A⁻¹ of the unknowns `free`, all others held; or why there are none.

    Parameters
    ----------
    problem : Problem
        With a cost of known loss.
    x : array, shape (n_unknowns,)
    free : array of int, shape (n_free,)
        In ascending order.
    jobs : int
        Threads.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment, Free
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=2e-3, end=2.0)
    >>> noise = 1e-3 * np.random.default_rng(1).standard_normal((1001, 2))
    >>> swing = Experiment("twin", 2e-3, run.states[:, [0, 2]] + noise, np.zeros((1, 1)), initial={"alpha": 0.3})
    >>> problem = Problem(rig, (swing,), {"lambda": Free(0.9, 0.5, 1.2), "mu": Free(0.95, 0.5, 1.2)},
    ...                   initial_state="held")
    >>> sandwich(problem, problem.start, np.array([1])).covariance.shape
    (1, 1)
    """
    here = tangent(problem, x, jobs=jobs) if problem.blocks is None else by_blocks(problem, x, free, jobs=jobs)
    if isinstance(here, Failure):
        return here
    return _sandwich(problem, here.by(free) if isinstance(here, Tangent) else here, free)


def _sandwich(problem: Problem, J: BlockJacobian, free: NDArray[np.intp]) -> Sandwich:
    blocks, near, slopes = J.blocks, normal_equations(problem, J, free), slopes_of(problem, J.errors)
    bread, norm, scale = near.bread, near.norm, np.outer(near.norm, near.norm)
    rounding = edges(problem, J.errors, J.parts, loss_of(problem).psi) if problem.blocks is None else None
    long_runs, sequences = list[list[FloatArray]](), list[tuple[BoolArray, float]]()
    apart = np.max([[spacing(own) for own in e.scored.T] for e in problem.experiments], axis=0)
    for step in np.unique(apart).tolist():  # what outputs leave is correlated from one of their samples to the next
        outputs = apart == step
        scores = scores_in(norm, J, [outputs * slope for slope in slopes])
        if rounding is not None:  # an output that noise and rounding explain is left out of the scores
            alone = [outputs * own * slope for own, slope in zip(rounding.alone, slopes, strict=True)]
            scores = [s - part for s, part in zip(scores, scores_in(norm, J, alone), strict=True)]
        long_run, bandwidth = block_long_run(blocks, [np.add.reduceat(s, np.arange(0, len(s), step)) for s in scores])
        long_runs.append(long_run)
        sequences.append((outputs, step * bandwidth))
    samples = [r.reshape(len(e), -1, r.shape[1]) for r, e in zip(near.rows, J.errors, strict=True)]
    wider = widening(blocks, samples, bread, sequences)
    known, inverse = 2 * near.level * near.prior, bread.inverse
    del near, scores, samples  # as large as all recordings, and squares of all unknowns follow
    covariance = block_sandwiched(blocks, inverse, (np.sum(S, axis=0) for S in zip(*long_runs, strict=True)), known)
    white = block_sandwiched(blocks, inverse, _white(problem, J, norm), known)
    if problem.blocks is not None and len(problem.recordings) < len(problem.experiments):
        # an error that lasts longer than a window, as the rounding of an angle that hardly moves, is seen in none
        sums, C = window_sums(blocks, scores_in(norm, J, slopes), bread), inverse[np.ix_(blocks.shared, blocks.shared)]
        from_window_to_window = np.diag(C @ bartlett_long_run(sums, len(sums) ** (1 / 3)) @ C)
        here = np.diag(covariance)[blocks.shared] * wider[blocks.shared] ** 2
        ratio = np.divide(from_window_to_window, here, out=np.ones_like(here), where=here > 0)
        wider[blocks.shared] *= np.sqrt(np.maximum(1.0, ratio))
    covariance *= np.outer(wider, wider)
    if rounding is not None:  # of which the trajectory tells, not few samples
        covariance += inverse @ (rounding.white / scale) @ inverse
        narrower = half_widths(tuple(t / norm @ inverse for t in rounding.tables), np.diag(covariance)) / NORMAL_95
        covariance += inverse @ (rounding.covariance / scale) @ inverse
        covariance, wider = np.outer(narrower, narrower) * covariance, wider * narrower
    for square in (inverse, covariance, white):
        square /= scale
    return Sandwich(free, inverse, covariance, white, directions=bread.unseen / norm, effects=norm, widening=wider)


def _white(problem: Problem, J: BlockJacobian, norm: FloatArray) -> Iterator[FloatArray]:
    """S₀ of each recording's columns: were the residuals of each output of a recording white, of one variance."""
    psi, weights = loss_of(problem).psi, problem.criterion.sample_weights(J.errors)
    for k, (of, w, e, j) in enumerate(zip(problem.experiments, weights, J.errors, J.parts, strict=True)):
        level = np.sum(psi(e) ** 2, axis=0) / np.maximum(np.count_nonzero(of.scored, axis=0), 1)
        rows = (w * np.sqrt(level))[..., None] * j / norm[J.blocks.columns(k)]
        yield np.einsum("toi,toj->ij", rows, rows, optimize=True)


def _sparse(directions: FloatArray, effects: FloatArray) -> FloatArray:
    """Unseen directions, of relative changes, with the fewest entries that are not 0, shape (n_unseen, n_free).

    Beside 0 a relative change means little: what it does to the samples, `effects` times as much, counts too.
    A basis of the unseen directions is arbitrary; row reduction gives the one that names the fewest together.
    """
    from scipy.linalg import qr  # slow to load

    rows = directions / np.max(np.abs(directions), axis=1, keepdims=True, initial=1e-300)
    largest_first = np.argsort(-np.max(np.abs(rows), axis=0, initial=0.0), kind="stable")
    pivots = qr(rows, mode="r", pivoting=True)[1][: len(rows)]
    rows = np.linalg.solve(rows[:, largest_first[np.isin(largest_first, pivots)]], rows)
    rows, moved = (r / np.max(np.abs(r), axis=1, keepdims=True, initial=1e-300) for r in (rows, rows * effects))
    return np.asarray(np.where(np.maximum(np.abs(rows), np.abs(moved)) > PART, rows, 0.0))


def residual_bandwidth(errors: list[FloatArray]) -> float:
    """Five correlation times of the residuals, all recordings and outputs together, at most n/4 of the shortest.

    Parameters
    ----------
    errors : list of array, shape (n_samples, n_outputs)
        Each output counts by its own scatter, so that the quieter one is heard too.

    Examples
    --------
    >>> residual_bandwidth([np.random.default_rng(0).standard_normal((5000, 2))]) < 10
    True
    """
    scatter = np.std(np.concatenate(errors), axis=0)
    pieces = [(e - e.mean(axis=0)) / np.where(scatter > 0, scatter, 1.0) for e in errors]
    return float(min(max(map(sokal_bandwidth, pieces)), min(map(len, errors)) // 4))


def half_width(precision: Known, x: FloatArray, i: int) -> float:
    """The longer side of the 95 % interval of free parameter i; 0 where there is none."""
    interval = None if isinstance(precision, Failure) else precision.interval(x, i)
    return 0.0 if interval is None else max(interval[1] - float(x[i]), float(x[i]) - interval[0])
