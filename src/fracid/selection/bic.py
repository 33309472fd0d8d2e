r"""How two models of the same recordings are compared: Schwarz's criterion, with the samples that residuals are worth.

.. math::  \mathrm{BIC} = -2\log L + k \ln n_{eff} = c\,n_{eff} \ln \sum r^2 + k \ln n_{eff} + \text{const}

with the rows r of the cost and k parameters: c = 1 for normal errors, whose level was maximised out, and 2 for those of
Laplace (iae, itae), whose rows' squares add up to :math:`\sum |e|` [1]_.  Samples count for what they are worth: where
the residuals are correlated over a time τ, n of them count as n/τ
(:func:`fracid.signals.correlation.effective_samples`).  Both models must be given the same
:math:`n_{eff}`, that of the better one's residuals.  A difference above 10 is strong evidence [2]_.

References
----------
.. [1] G. Schwarz, Annals of Statistics 6 (1978) 461.
.. [2] R. Kass, A. Raftery, J. American Statistical Association 90 (1995) 773.
"""

from __future__ import annotations

import math

from fracid.problem.costs import Cost

STRONG = 10.0
"""A difference above this is strong evidence [2]_."""

EVEN = 2.0
"""A difference below this is not worth more than a bare mention [2]_."""


SAME = 5e-3
"""A cost that is higher by this part is as good: so much do solvers, clocks and encoders differ."""


def does_as_well(gain: float, cost: float, other: float, *, larger: bool, most: float = EVEN) -> bool:
    """Whether a model of integer order explains the recordings as well as a fractional one.

    Parameters
    ----------
    gain : float
        Its criterion less that of the fractional model.
    cost, other : float
        Its cost, and that of the fractional model.
    larger : bool
        Whether it has more parameters: enough relaxations imitate an order over any record, at any cost.
    most : float
        A difference of the criterion that it may have.

    Examples
    --------
    >>> [does_as_well(30.0, 1.001, 1.0, larger=larger) for larger in (False, True)]
    [True, False]
    >>> import numpy as np
    >>> does_as_well(30.0, np.float64(1.1), 1.0, larger=False)
    False
    """
    return bool(gain <= most or (not larger and cost <= (1 + SAME) * other))  # a cost may be of NumPy's


def schwarz(squares: float, parameters: int, samples: float, cost: Cost) -> float:
    """BIC, up to what all models of the same recordings have in common.

    Parameters
    ----------
    squares : float
        Sum of the squares of the cost's rows at the minimum.
    parameters : int
        k.
    samples : float
        n_eff, the same for all models that are compared.
    cost : Cost
        Tells the likelihood of the errors.

    Examples
    --------
    >>> from fracid.problem.costs import COSTS
    >>> worse, better = schwarz(1.1, 3, 1000.0, COSTS["rmse"]), schwarz(1.0, 4, 1000.0, COSTS["rmse"])
    >>> round(worse - better)
    88
    """
    factor = 1 if cost.loss is None else cost.loss.likelihood_factor
    return factor * samples * math.log(max(squares, 1e-300)) + parameters * math.log(samples)
