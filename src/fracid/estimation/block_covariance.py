r"""The parts of the sandwich (:mod:`.covariance`) for many recordings, recording by recording.

The inverse of an arrowhead is a matrix of small blocks and one of the rank of the shared unknowns,
:math:`A^{-1} = D + FCF'` [M]_: D has the inverse of each recording's own part, C is the covariance of the shared ones,
F says how far each recording's own follow them.  So nothing is as tall as the recordings and as wide as the unknowns.

An unknown of one recording moves the others through the shared ones alone: its influence there is :math:`Pv`, v the
shared part of its column of :math:`A^{-1}`, P = JF.  The sums over all recordings that say how far few samples
widen its interval are forms of the second and the fourth degree in v, which are made once.

References
----------
.. [M] J. Meyer et al., in Triggs et al., Bundle adjustment – a modern synthesis, LNCS 1883 (2000): the same structure
   in photographs, each with a camera of its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fracid.arrays import FloatArray
from fracid.arrowhead import Arrowhead, Blocks
from fracid.signals.correlation import (
    bartlett_long_run,
    neighbour_correlation,
    neighbour_sums,
    products_by_lag,
    sokal_lag,
    whitened,
)


@dataclass(frozen=True, eq=False)
class Bread:
    """A⁻¹ = D + FCF′."""

    inverse: FloatArray
    """A⁻¹, shape (n_unknowns, n_unknowns)."""
    follow: FloatArray
    """F, shape (n_unknowns, n_shared)."""
    unseen: FloatArray
    """Directions that J does not see, shape (n_unseen, n_unknowns)."""
    condition: float
    """Of J, to a percent."""


def summed(blocks: Blocks, parts: Sequence[FloatArray]) -> FloatArray:
    """Vectors of each recording's columns, added up, shape (n_unknowns,)."""
    total = np.zeros(len(blocks.recording))
    for k, part in enumerate(parts):
        total[blocks.columns(k)] += part
    return total


def scaled_bread(
    blocks: Blocks, rows: Sequence[FloatArray], prior: FloatArray, least: float
) -> tuple[Bread, FloatArray]:
    """:func:`block_bread` of rows that are divided, in place, by the norms of A's columns; and these norms.

    Parameters
    ----------
    rows : sequence of array, shape (n_rows, n_columns)
        Of each recording.
    prior : array, shape (n_unknowns,)
        What is added to A's diagonal.
    least : float
        Singular values below this part of the largest count as zero.
    """
    norm = np.sqrt(summed(blocks, [np.einsum("ri,ri->i", r, r) for r in rows]) + prior)
    norm[norm == 0] = 1.0
    for k, r in enumerate(rows):
        r /= norm[blocks.columns(k)]
    return block_bread(blocks, rows, np.sqrt(prior) / norm, least), norm


def block_bread(blocks: Blocks, rows: Sequence[FloatArray], prior: FloatArray, least: float) -> Bread:
    """A⁻¹ of rows, and of priors, as many roots of what is added to A's diagonal; column-scaled.

    Parameters
    ----------
    rows : sequence of array, shape (n_rows, n_columns)
        Of each recording.
    prior : array, shape (n_unknowns,)
    least : float
        Singular values below this part of the largest count as zero.

    Examples
    --------
    >>> blocks = Blocks(np.array([-1, 0, 1]), np.array([0, 2, 4]))
    >>> rows = [np.array([[1.0, 0.0], [1.0, 1.0]]), np.array([[1.0, 0.0], [1.0, 2.0]])]
    >>> J = np.array([[0, 1, 0], [1, 1, 0], [0, 0, 1], [2, 0, 1.0]])
    >>> found = block_bread(blocks, rows, np.zeros(3), 1e-6)
    >>> bool(np.allclose(found.inverse, np.linalg.inv(J.T @ J))), found.unseen.shape
    (True, (0, 3))
    """
    n, s = len(blocks.recording), len(blocks.shared)

    def with_priors() -> Iterator[FloatArray]:
        for k, r in enumerate(rows):
            known = np.diag(prior[blocks.columns(k)])
            known = known if k == 0 else known[: r.shape[1] - s]  # those of the shared ones once
            part = np.concatenate([r, known[np.any(known, axis=1)]])
            yield np.column_stack([part, np.zeros(len(part))])

    R = Arrowhead.of(blocks, with_priors())
    largest = math.sqrt(_greatest(R.normal, n))
    F, rest, unseen, alone = np.zeros((n, s)), [R.rest[:, :-1]], [], []
    F[blocks.shared] = np.eye(s)
    for k in range(len(rows)):
        own = blocks.columns(k)[: rows[k].shape[1] - s]
        Y, Z = R.own[k][:, : len(own)], R.shared[k]
        if not len(own):
            continue
        U, σ, V = np.linalg.svd(Y, full_matrices=False)
        seen = σ > least * largest
        inverse = (V[seen].T / σ[seen]) @ U[:, seen].T
        alone.append((own, inverse @ inverse.T))
        F[own] = -inverse @ Z
        rest.append(Z - U[:, seen] @ (U[:, seen].T @ Z))
        blind = np.zeros((np.count_nonzero(~seen), n))
        blind[:, own] = V[~seen]
        unseen += list(blind)
    _, σ, V = np.linalg.svd(np.concatenate(rest))
    directions = (F @ V.T).T
    long = np.linalg.norm(directions, axis=1)
    seen = σ > least * largest * long
    C = (V[seen].T / σ[seen] ** 2) @ V[seen]
    unseen += list(directions[~seen] / long[~seen, None])
    inverse = F @ C @ F.T
    for own, D in alone:
        inverse[np.ix_(own, own)] += D
    smallest = 0.0 if unseen else 1 / math.sqrt(max(_greatest(lambda v: inverse @ v, n), 1e-300))
    condition = largest / max(smallest, np.finfo(float).eps * largest, 1e-300)
    return Bread(inverse, F, np.array(unseen).reshape(-1, n), condition)


def _greatest(product: Callable[[FloatArray], FloatArray], n: int) -> float:
    """The greatest eigenvalue of a symmetric matrix, not below 0."""
    if n == 1:
        return float(product(np.ones(1))[0])
    from scipy.sparse.linalg import LinearOperator, eigsh

    operator = LinearOperator((n, n), matvec=product, dtype=np.float64)
    return max(0.0, float(eigsh(operator, k=1, v0=np.ones(n), tol=1e-2, return_eigenvectors=False)[0]))


# --- the long-run covariance -----------------------------------------------------------------------------


def _bandwidth(blocks: Blocks, scores: Sequence[FloatArray]) -> float:
    """B of :func:`fracid.signals.correlation.sokal_bandwidth`, of all recordings one after the other.

    Parameters
    ----------
    scores : sequence of array, shape (n_samples, n_columns)
        Of each recording.
    """
    s = len(blocks.shared)
    lags = sum(map(len, scores)) // 4 + 1
    covariance = np.zeros(lags)
    for column in np.concatenate([part[:, part.shape[1] - s :] for part in scores]).T:
        covariance += products_by_lag(column)[:lags]
    for part in scores:
        for column in part[:, : part.shape[1] - s].T:
            own = products_by_lag(column)[:lags]
            covariance[: len(own)] += own
    return sokal_lag(covariance)


def block_long_run(blocks: Blocks, scores: Sequence[FloatArray], limit: float) -> tuple[list[FloatArray], float]:
    """S of each recording's columns, whitened before and coloured after by one correlation, and the bandwidth.

    Parameters
    ----------
    scores : sequence of array, shape (n_samples, n_columns)
    limit : float
        Of the correlation that is taken out.
    """
    rho, bandwidth = neighbour_correlation(scores, limit), _bandwidth(blocks, scores)
    return [bartlett_long_run(whitened(part, rho), bandwidth) / (1 - rho) ** 2 for part in scores], bandwidth


def block_sandwiched(blocks: Blocks, inverse: FloatArray, S: Sequence[FloatArray], prior: FloatArray) -> FloatArray:
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


def clustered(blocks: Blocks, inverse: FloatArray, sums: FloatArray) -> FloatArray:
    """The shared unknowns' variances, as windows of one recording differ from each other, shape (n_shared,).

    An error that lasts longer than a window, such as the rounding of an angle that hardly moves, is seen in no window.
    """
    C = inverse[np.ix_(blocks.shared, blocks.shared)]
    return np.asarray(np.diag(C @ bartlett_long_run(sums, len(sums) ** (1 / 3)) @ C))


# --- few samples -----------------------------------------------------------------------------------------


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


def block_widening(blocks: Blocks, rows: Sequence[FloatArray], bread: Bread, bandwidth: float) -> FloatArray:
    """Σq, Σ K² q q and the leverage of :func:`fracid.estimation.covariance.widening`, shape (3, n_unknowns).

    Parameters
    ----------
    rows : sequence of array, shape (n_samples, n_outputs, n_columns)
        R of each recording, A = Σ R'R.
    """
    from scipy.fft import next_fast_len, rfft

    s, m, shared = len(blocks.shared), int(bandwidth) + 1, blocks.shared
    first, second = np.triu_indices(s)
    twice = np.where(first == second, 1.0, 2.0)
    V = bread.inverse[shared]  # v of each unknown, shape (n_shared, n_unknowns)
    products = twice[:, None] * V[first] * V[second]  # so that q = Qz
    total, K = np.zeros((3, len(blocks.recording))), 1 - np.arange(m) / m
    whole, scatter, leverage = total
    sums, fourth, window = np.zeros(len(first)), np.zeros((len(first), len(first))), np.zeros((s, s))
    for k, r in enumerate(rows):
        at = blocks.columns(k)
        own, (n, outputs, w) = at[: len(at) - s], r.shape
        G = bread.inverse[np.ix_(at, at)]
        values, vectors = np.linalg.eigh(G)
        flat = r.reshape(-1, w)
        along = (flat @ (vectors * np.sqrt(np.maximum(values, 0.0)))).reshape(n, outputs, w)
        P = (flat @ bread.follow[at]).reshape(n, outputs, s)
        Q = np.einsum("toi,toi->ti", P[..., first], P[..., second])
        length = next_fast_len(n + min(m, n), real=True)
        lags = np.zeros(length)
        share = K[:n] ** 2
        lags[: len(share)] = share
        lags[length - len(share) + 1 :] = share[:0:-1]
        spectrum = rfft(Q, length, axis=0)
        weight = rfft(lags).real * np.where((np.arange(len(spectrum)) % (length / 2)) == 0, 1.0, 2.0) / length
        pairs = ((spectrum.conj() * weight[:, None]).T @ spectrum).real
        moved = neighbour_sums(np.einsum("toi,toj->tij", P, along).reshape(n, -1), m).reshape(-1, s, w)
        reach = np.einsum("tij,tlj->il", moved, moved, optimize=True) / m
        sums, fourth, window = sums + Q.sum(axis=0), fourth + pairs, window + reach
        # a recording's own unknowns: in it as they are, in all others by way of the shared ones
        z, v = products[:, own], V[:, own]
        whole[own] -= Q.sum(axis=0) @ z
        scatter[own] -= np.einsum("ai,ab,bi->i", z, pairs, z, optimize=True)
        leverage[own] -= np.einsum("ai,ab,bi->i", v, reach, v, optimize=True)
        for i, influence in zip(own, (flat @ G[:, : len(own)]).T, strict=True):
            total[:, i] += told_by_one(influence.reshape(n, outputs), along, K)
    whole += sums @ products
    scatter += np.einsum("ai,ab,bi->i", products, fourth, products, optimize=True)
    leverage += np.einsum("ai,ab,bi->i", V, window, V, optimize=True)
    return total
