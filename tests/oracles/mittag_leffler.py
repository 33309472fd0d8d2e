"""The Mittag-Leffler function, which solves D^q y = a y: y(t) = y(0) E_q(a t^q).

From ``pymittagleffler``, after R. Garrappa, SIAM J. Numer. Anal. 53 (2015), but near zero and of order 3.
"""

import numpy as np
from pymittagleffler import mittag_leffler as evaluate
from scipy.special import rgamma


def mittag_leffler(order: float, z, beta: float = 1.0):
    """E_{q,β}(z) = Σ z^k/Γ(qk + β), of z's shape; real for real z."""
    given = np.asarray(z)
    points = given.astype(complex).ravel()
    # Near zero the library's closed forms cancel (E_{1,2} = (e^z - 1)/z); 16 terms of the definition do not.
    near = np.abs(points) < 1 / 16
    values = np.empty_like(points)
    values[near] = np.polynomial.polynomial.polyval(points[near], rgamma(order * np.arange(16) + beta))
    if (order, beta) == (3.0, 1.0):
        # pymittagleffler 0.3 gives three times E_{3,1}; E_{q,b}(z) = 1/Γ(b) + z E_{q,q+b}(z) goes round it.
        values[~near] = 1 + points[~near] * evaluate(points[~near], 3.0, 4.0)
    else:
        values[~near] = evaluate(points[~near], order, beta)
    values = values.reshape(given.shape)
    return (values.real if np.isrealobj(given) else values)[()]
