r"""The triangle that stands for millions of rows: R of a QR factorisation, block by block.

All that a step of least squares takes from the residuals r and their derivatives J, tall as a recording is long, are
:math:`J'J`, :math:`J'r` and :math:`r'r`.  The factor R of :math:`[r\ J] = QR` has as many rows as columns and the
same three products, to the accuracy of r and J themselves; :math:`J'J`, once formed, has lost half of the digits
[GV]_.  Q is never needed, and R of a tall matrix is R of the triangles of its parts, one below the other, so the work
needs no more memory than one part [DGHL]_.

References
----------
.. [DGHL] J. Demmel, L. Grigori, M. Hoemmen, J. Langou, SIAM J. Sci. Comput. 34 (2012) A206: tall and skinny QR.
.. [GV] G. Golub, C. Van Loan, Matrix Computations (2013), 5.3: least squares by QR.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from fracid.arrays import FloatArray

BLOCK = 2**12
"""Rows of a part: of twenty columns as many as a processor's cache holds, which is two and a half times as fast."""


def triangle(parts: Iterable[FloatArray]) -> FloatArray:
    """R of all rows together, its diagonal not negative, shape (n_columns, n_columns).

    Parameters
    ----------
    parts : iterable of array, shape (n_rows, n_columns)
        One at least, of any number of rows; each may be large, and is worked through by :data:`BLOCK`.

    Examples
    --------
    >>> rows = np.random.default_rng(1).standard_normal((100_000, 3))
    >>> R = triangle(np.split(rows, 7 * [50_000]))
    >>> R.shape, np.allclose(R.T @ R, rows.T @ rows)
    ((3, 3), True)
    """
    R: FloatArray | None = None
    for part in parts:
        for first in range(0, len(part), BLOCK):
            block = part[first : first + BLOCK]
            R = np.asarray(np.linalg.qr(block if R is None else np.vstack([R, block]), mode="r"))
    assert R is not None
    square = np.zeros((R.shape[1], R.shape[1]))  # fewer rows than columns: zeros below
    square[: len(R)] = R
    return np.asarray(np.where(np.diag(square) < 0, -1.0, 1.0)[:, None] * square)
