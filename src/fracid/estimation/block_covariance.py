r"""The parts of the sandwich (:mod:`.covariance`), recording by recording; unknowns that all share are one block.

The inverse of an arrowhead is a matrix of small blocks and one of the rank of the shared unknowns,
:math:`A^{-1} = D + FCF'` [M]_: D has the inverse of each recording's own part, C is the covariance of the shared ones,
F says how far each recording's own follow them.  So nothing is as tall as the recordings and as wide as the unknowns.

An unknown of one recording moves the others through the shared ones alone: its influence there is :math:`Pv`, v the
shared part of its column of :math:`A^{-1}`, P = JF.  The sums over all recordings that say how far few samples
widen its interval are forms of the second and the fourth degree in v, which are made once.

References
----------
.. [AM] D. Andrews, J. Monahan, Econometrica 60 (1992) 953: whitening, and its limit of 0.97.
.. [M] J. Meyer et al., in Triggs et al., Bundle adjustment – a modern synthesis, LNCS 1883 (2000): the same structure
   in photographs, each with a camera of its own.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fracid.arrays import BoolArray, FloatArray
from fracid.arrowhead import Arrowhead, Blocks
from fracid.estimation.block_jacobian import BlockJacobian
from fracid.estimation.derivatives import prior_curvature, rows_of, scores_of
from fracid.estimation.tangent import UNSEEN
from fracid.problem import Problem
from fracid.quantiles import NORMAL_95
from fracid.signals.correlation import (
    bartlett_long_run,
    neighbour_correlation,
    neighbour_sums,
    products_by_lag,
    sokal_lag,
    whitened,
)

TAKEN = 0.75
"""More than this part of a variance the fit is never thought to have taken out of the residuals."""

WHITENED = 0.97
"""Limit of the correlation that is taken out before S is estimated [AM]_."""


Sequences = Sequence[tuple[BoolArray, float]]
"""Outputs whose scores are one sequence, shape (n_outputs,), and its bandwidth [samples]: each output is in one."""


class Bread(NamedTuple):
    """A⁻¹ = D + FCF′."""

    inverse: FloatArray
    """A⁻¹, shape (n_unknowns, n_unknowns)."""
    follow: FloatArray
    """F, shape (n_unknowns, n_shared)."""
    unseen: FloatArray
    """Directions that J does not see, shape (n_unseen, n_unknowns)."""


class Equations(NamedTuple):
    """The normal equations of least squares at a point, in units in which the diagonal of A is 1."""

    norm: FloatArray
    """√A_ii, by which all else was divided, shape (n_unknowns,)."""
    rows: list[FloatArray]
    """R of each recording, shape (n_rows, n_columns)."""
    prior: FloatArray
    """What priors add to the diagonal of A, shape (n_unknowns,)."""
    level: float
    """Of :func:`fracid.estimation.derivatives.prior_curvature`."""
    bread: Bread


def summed(blocks: Blocks, parts: Sequence[FloatArray]) -> FloatArray:
    """Vectors of each recording's columns, added up, shape (n_unknowns,)."""
    total = np.zeros(len(blocks.recording))
    for k, part in enumerate(parts):
        total[blocks.columns(k)] += part
    return total


def normal_equations(problem: Problem, J: BlockJacobian, free: NDArray[np.intp]) -> Equations:
    """Those of the unknowns `free`, by which J derives."""
    rows = [*rows_of(problem, J.errors, J.parts)]
    prior, level = prior_curvature(problem, J.errors, free)
    norm = np.sqrt(summed(J.blocks, [np.einsum("ri,ri->i", r, r) for r in rows]) + prior)
    norm[norm == 0] = 1.0
    for k, tall in enumerate(rows):  # in place: each is as long as its recording
        tall /= norm[J.blocks.columns(k)]
    prior = prior / norm**2
    return Equations(norm, rows, prior, level=level, bread=bread_of(J.blocks, rows, np.sqrt(prior)))


def scores_in(norm: FloatArray, J: BlockJacobian, slopes: Sequence[FloatArray]) -> list[FloatArray]:
    """Scores of each recording in the units of the normal equations, shape (n_samples, n_columns)."""
    return [s / norm[J.blocks.columns(k)] for k, s in enumerate(scores_of(slopes, J.parts))]


def bread_of(blocks: Blocks, rows: Sequence[FloatArray], prior: FloatArray) -> Bread:
    """A⁻¹ of rows, and of priors, as many roots of what is added to A's diagonal; column-scaled.

    Parameters
    ----------
    rows : sequence of array, shape (n_rows, n_columns)
        Of each recording.
    prior : array, shape (n_unknowns,)

    Examples
    --------
    >>> blocks = Blocks(np.array([-1, 0, 1]), np.array([0, 2, 4]))
    >>> rows = [np.array([[1.0, 0.0], [1.0, 1.0]]), np.array([[1.0, 0.0], [1.0, 2.0]])]
    >>> J = np.array([[0, 1, 0], [1, 1, 0], [0, 0, 1], [2, 0, 1.0]])
    >>> found = bread_of(blocks, rows, np.zeros(3))
    >>> bool(np.allclose(found.inverse, np.linalg.inv(J.T @ J))), found.unseen.shape
    (True, (0, 3))
    """
    n, s = len(blocks.recording), len(blocks.shared)

    def with_priors() -> Iterator[FloatArray]:
        for k, r in enumerate(rows):
            known = np.diag(prior[blocks.columns(k)])
            known = known if k == 0 else known[: r.shape[1] - s]  # those of the shared ones once
            yield np.pad(np.concatenate([r, known[np.any(known, axis=1)]]), ((0, 0), (0, 1)))

    R = Arrowhead.of(blocks, with_priors())
    factors = [np.linalg.svd(Y[:, : np.count_nonzero(own >= 0)], full_matrices=False)
               for own, Y in zip(blocks.own, R.own, strict=True)]  # fmt: skip
    largest = max(σ.max(initial=1e-300) for σ in (np.linalg.svd(R.rest[:, :-1])[1], *(σ for _, σ, _ in factors)))
    F, rest, unseen, alone = np.zeros((n, s)), [R.rest[:, :-1]], [], []
    F[blocks.shared] = np.eye(s)
    for own, Z, (U, σ, V) in zip(blocks.own, R.shared, factors, strict=True):
        own, seen = own[own >= 0], σ > UNSEEN * largest
        inverse = (V[seen].T / σ[seen]) @ U[:, seen].T
        alone.append((own, inverse @ inverse.T))
        F[own] = -inverse @ Z
        rest.append(Z - U[:, seen] @ (U[:, seen].T @ Z))
        blind = np.zeros((np.count_nonzero(~seen), n))
        blind[:, own] = V[~seen]
        unseen += list(blind)
    _, σ, V = np.linalg.svd(np.concatenate(rest), full_matrices=False)
    directions = (F @ V.T).T
    long = np.linalg.norm(directions, axis=1)
    seen = σ > UNSEEN * largest * long
    C = (V[seen].T / σ[seen] ** 2) @ V[seen]
    unseen += list(directions[~seen] / long[~seen, None])
    inverse = F @ C @ F.T
    for own, D in alone:
        inverse[np.ix_(own, own)] += D
    return Bread(inverse, F, np.array(unseen).reshape(-1, n))


# --- the long-run covariance -----------------------------------------------------------------------------


def block_long_run(blocks: Blocks, scores: Sequence[FloatArray]) -> tuple[list[FloatArray], float]:
    """S of each recording's columns, whitened before and coloured after [AM]_, and the bandwidth.

    By one correlation for all columns: by one for each, what nearly parallel columns of J have in common would not
    cancel, and in a valley that is all.  The bandwidth is :func:`fracid.signals.correlation.sokal_bandwidth` of all
    recordings one after the other.

    Parameters
    ----------
    scores : sequence of array, shape (n_samples, n_columns)
        Of each recording.
    """
    s, lags = len(blocks.shared), sum(map(len, scores)) // 4 + 1
    covariance = np.zeros(lags)
    shared = np.concatenate([part[:, part.shape[1] - s :] for part in scores]).T
    own = (column for part in scores for column in part[:, : part.shape[1] - s].T)
    for column in chain(shared, own):
        products = products_by_lag(column)[:lags]
        covariance[: len(products)] += products
    rho, bandwidth = neighbour_correlation(scores, WHITENED), sokal_lag(covariance)
    return [bartlett_long_run(whitened(part, rho), bandwidth) / (1 - rho) ** 2 for part in scores], bandwidth


def block_sandwiched(blocks: Blocks, inverse: FloatArray, S: Iterable[FloatArray], prior: FloatArray) -> FloatArray:
    """A⁻¹SA⁻¹, S of each recording's columns and what priors add to its diagonal, shape (n_unknowns, n_unknowns)."""
    filled = prior[:, None] * inverse
    for k, part in enumerate(S):
        at = blocks.columns(k)
        filled[at] += part @ inverse[at]
    return np.asarray(inverse @ filled)


# --- windows of one recording ------------------------------------------------------------------------------


def window_sums(blocks: Blocks, scores: Sequence[FloatArray], bread: Bread) -> FloatArray:
    """What each window says of the shared unknowns, its own start found again: Σ P'e, shape (n_windows, n_shared)."""
    return np.array([part.sum(axis=0) @ bread.follow[blocks.columns(k)] for k, part in enumerate(scores)])


# --- few samples -----------------------------------------------------------------------------------------


def widening(blocks: Blocks, rows: Sequence[FloatArray], bread: Bread, sequences: Sequences) -> FloatArray:
    """By what standard errors from few samples must be widened, t(ν)/1.96/√(1 − f), shape (n_unknowns,).

    Parameters
    ----------
    rows : sequence of array, shape (n_samples, n_outputs, n_columns)
        R of each recording, A = Σ R'R.
    sequences : sequence of tuple
        Of the outputs.

    Examples
    --------
    A mean of 10 samples, of 1000, and of 1000 with a correlation time of 100:

    >>> def of_mean(n, B):
    ...     bread = Bread(np.array([[1 / n]]), np.eye(1), np.empty((0, 1)))
    ...     blocks, alone = Blocks(np.array([-1]), np.array([0, n])), np.ones(1, bool)
    ...     return widening(blocks, [np.ones((n, 1, 1))], bread, [(alone, B)]).round(3).item()
    >>> of_mean(10, 0), of_mean(1000, 0), of_mean(1000, 99)
    (1.198, 1.002, 1.142)
    """
    from scipy.special import stdtrit  # Student's t; scipy.stats takes a second to import

    total, along = np.zeros((3, len(blocks.recording))), []
    shares = [(outputs, 1 - np.arange(int(B) + 1) / (int(B) + 1)) for outputs, B in sequences]
    for k, r in enumerate(rows):
        at = blocks.columns(k)
        G = bread.inverse[np.ix_(at, at)]
        values, vectors = np.linalg.eigh(G)
        along.append(r @ (vectors * np.sqrt(np.maximum(values, 0.0))))  # coordinates in which A⁻¹ is 1
        for i, v in zip(at, G, strict=True):  # one after the other: each is as long as the recording
            total[:, i] += sum(told_by_one(outputs * (r @ v), along[k], K) for outputs, K in shares)
    if blocks.own.size:
        total += sum(_told_by_others(blocks, rows, along, bread, outputs=outputs, share=K) for outputs, K in shares)
    whole, scatter, leverage = total
    remainder = 1 - np.minimum(leverage / np.maximum(whole, 1e-300), TAKEN)
    degrees = np.maximum(whole**2 / np.maximum(scatter, 1e-300), 1.0)
    return np.asarray(stdtrit(degrees, 0.975) / NORMAL_95 / np.sqrt(remainder))


def told_by_one(influence: FloatArray, along: FloatArray, share: FloatArray) -> FloatArray:
    """Σq, Σ K² q q and the leverage of one unknown in one recording, shape (3,).

    Parameters
    ----------
    influence : array, shape (n_samples, n_outputs)
        M_t v_i, of which q is the square.
    along : array, shape (n_samples, n_outputs, n_unknowns)
        The rows in coordinates in which A⁻¹ is 1.
    share : array
        K at each lag of the bandwidth.
    """
    m, q = len(share), np.einsum("to,to->t", influence, influence)
    pairs = products_by_lag(q)[:m]
    scatter = 2 * share[: len(pairs)] ** 2 @ pairs - pairs[0]
    moved = neighbour_sums(np.einsum("to,toj->tj", influence, along), m)
    return np.array([q.sum(), scatter, np.sum(moved**2) / m])


def _told_by_others(
    blocks: Blocks, rows: Sequence[FloatArray], along: Sequence[FloatArray], bread: Bread,
    outputs: BoolArray, share: FloatArray,
) -> FloatArray:  # fmt: skip
    """The same of each recording's own unknowns in all others, by way of the shared ones, shape (3, n_unknowns).

    Parameters
    ----------
    along : sequence of array
        Of each recording, as in :func:`told_by_one`.
    """
    from scipy.fft import next_fast_len, rfft

    s, m, total = len(blocks.shared), len(share), np.zeros((3, len(blocks.recording)))
    first, second = np.triu_indices(s)
    twice = np.where(first == second, 1.0, 2.0)
    V = bread.inverse[blocks.shared]  # v of each unknown, shape (n_shared, n_unknowns)
    products = twice[:, None] * V[first] * V[second]  # so that q = Qz

    def forms(z: FloatArray, v: FloatArray, of: tuple[FloatArray, FloatArray, FloatArray]) -> list[FloatArray]:
        sums, pairs, reach = of
        return [sums @ z, *(np.einsum("ai,ab,bi->i", w, M, w, optimize=True) for w, M in ((z, pairs), (v, reach)))]

    every = np.zeros(len(first)), np.zeros((len(first), len(first))), np.zeros((s, s))
    for k, (r, coordinates) in enumerate(zip(rows, along, strict=True)):
        at, (n, _, w) = blocks.columns(k), r.shape
        P = outputs[:, None] * (r @ bread.follow[at])
        Q = np.einsum("toi,toi->ti", P[..., first], P[..., second])
        length = next_fast_len(n + min(m, n), real=True)
        lags = np.zeros(length)
        lags[: min(m, n)] = share[:n] ** 2
        lags[length - min(m, n) + 1 :] = share[:n][:0:-1] ** 2
        spectrum = rfft(Q, length, axis=0)
        weight = rfft(lags).real * np.where((np.arange(len(spectrum)) % (length / 2)) == 0, 1.0, 2.0) / length
        pairs = ((spectrum.conj() * weight[:, None]).T @ spectrum).real
        moved = neighbour_sums(np.einsum("toi,toj->tij", P, coordinates).reshape(n, -1), m).reshape(-1, s, w)
        own = Q.sum(axis=0), pairs, np.einsum("tij,tlj->il", moved, moved, optimize=True) / m
        for whole, part in zip(every, own, strict=True):
            whole += part
        mine = at[: len(at) - s]
        total[:, mine] -= forms(products[:, mine], V[:, mine], own)
    of_all = blocks.own[blocks.own >= 0]
    total[:, of_all] += forms(products[:, of_all], V[:, of_all], every)
    return total
