r"""The history sum of a fractional system: kept whole, truncated, or compressed.

Every scheme of :mod:`fracid.solver.schemes` needs, at each step n and for each state, one sum over the
whole past,

.. math::  H_n = \sum_{k=1}^{n} w_k\, v_{n-k},

with the weights of one of three kernels, all in units of the step:

=======  ==========================================================================================
``gl``   the Grünwald–Letnikov weights (18)–(19) of the derivative, :math:`v = x - x(0)`
``pi``   the product-trapezoidal weights of the integral, :math:`v = f(t, x)`:
         :math:`b_k = \big((k+1)^{q+1} - 2k^{q+1} + (k-1)^{q+1}\big)/\Gamma(q+2)`, and
         :math:`a_n = \big((n-1)^{q+1} - (n-1-q)\,n^q\big)/\Gamma(q+2)` for the sample at the start
``pi3``  the same for :math:`f - δ^2 f/12` and an end correction (:mod:`fracid.solver.starting`):
         :math:`w_k = b_k - (b_{k+1} - 2 b_k + b_{k-1})/12` from k = 3 on; built from ``pi``, within 4/3 of its
         bound
=======  ==========================================================================================

A :class:`~fracid.solver.weights.Kernel` keeps the first L weights exactly and the rest as a sum of decaying
exponentials, :math:`w_k \approx \sum_m c_m z_m^k` for :math:`k > L`.  The three memories are three fillings of it:

=================  ===================  ==============  =======================================
memory             exact weights        exponentials    error
=================  ===================  ==============  =======================================
``full``           all                  none            rounding
``short(L)``       L                    none or one     see :func:`short`; it can be large
``compressed``     8                    10–65           each weight within ``tolerance``, relative
=================  ===================  ==============  =======================================

so one compiled loop serves all, and a step costs O(L + modes) instead of O(n).

**What the compression costs.**  :mod:`fracid.solver.exponentials` chooses the exponentials by a quadrature whose three
errors share the tolerance; ``benchmarks/certificate.py`` bounds each from the kernel as built, and compares it with the
exact weights.  ``docs/memory.md`` has the derivation and the tables.

References
----------
.. [Diethelm] K. Diethelm, N. Ford, A. Freed, *Detailed error analysis for a fractional Adams
   method*, Numer. Algorithms 36 (2004): the product-trapezoidal weights.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from fracid.errors import InputError
from fracid.solver.exponentials import EXACT_LAGS, WHOLE, compressed_kernel
from fracid.solver.trajectory import SAYS
from fracid.solver.weights import Kernel, exact_kernel

WRITTEN = re.compile(r"full|short\((\d+)\)|compressed(?:\((\d+(?:\.\d+)?(?:e-?\d+)?)(?:, lags=(\d+))?\))?")
"""The names of memories, as they are printed and typed."""


@dataclass(frozen=True)
class Memory:
    """How the past is kept; made by :func:`full`, :func:`short` or :func:`compressed`."""

    name: str
    """``full``, ``short(L)`` or ``compressed(tolerance)``."""
    kernel: Callable[..., Kernel]
    """(family, order, steps) → the kernel of a state in a run of so many steps, the largest lag asked for."""
    tolerance: float | None = None
    """Of each weight, relative, 0 where all are exact; None where those of long ago are left out."""


def full() -> Memory:
    """Keep every sample: exact, and O(n²) in time.

    Examples
    --------
    >>> full().kernel("gl", 0.5, steps=3).weights
    array([ 1.    , -0.5   , -0.125 , -0.0625])
    """
    return Memory("full", exact_kernel, 0.0)


def short(length: int) -> Memory:
    """Keep the last `length` lags only (Podlubny's short-memory principle).

    For ``gl`` older samples are dropped; with |x − x(0)| ≤ M the derivative is then wrong by at most
    :math:`M (Lh)^{-q}/|\\Gamma(1-q)|`.  For ``pi`` dropping the past of an *integral* would forget where
    the state came from, so all older samples weigh as much as lag L does.  At order 1 both are exact.

    Raises
    ------
    InputError
        If `length` is not a whole number of at least 1.

    Examples
    --------
    >>> short(2).kernel("gl", 0.5, steps=100).weights
    array([ 1.   , -0.5  , -0.125])
    """
    if not (isinstance(length, int | np.integer) and length >= 1):
        raise InputError(SAYS("short", length=length))
    return Memory(f"short({length})", partial(_short_kernel, length=int(length)))


def _short_kernel(family: str, order: float, steps: int, length: int) -> Kernel:
    exact = exact_kernel(family, order, min(length, steps))
    if family == "gl" or steps <= length:
        return exact
    return Kernel(exact.weights, exact.start, np.zeros(1), exact.weights[-1:], start_ratio=np.full(1, 0.5))


def compressed(tolerance: float = 1e-10, *, lags: int = EXACT_LAGS) -> Memory:
    """Keep the last few lags and a few dozen decaying exponentials: O(n), and as good as full.

    Every weight is within `tolerance` of the exact one, relative to it, for every order strictly
    between 0 and 2 and up to 10⁷ steps; so H_n is within tolerance · Σ|w_k v_{n−k}|.
    ``benchmarks/certificate.py`` shows it, and what rounding adds: for ``pi`` well above order 1, where a long
    kernel's constant dwarfs its first weights, up to 10⁻⁹ of those at order 1.9 and 10⁷ steps.

    Parameters
    ----------
    tolerance : float, between 1e-13 and 1e-2
    lags : int, between 8 and 64
        Lags kept exactly.  More of them need fewer exponentials; 8 make the fastest runs.

    Raises
    ------
    InputError
        If `tolerance` is not between 1e-13 (rounding) and 1e-2, or `lags` not between 8 and 64.

    Examples
    --------
    >>> kernel = compressed(1e-10).kernel("pi", 0.9, steps=20_000)
    >>> kernel.lags, kernel.modes
    (8, 27)
    >>> compressed(1e-10, lags=16).kernel("pi", 0.9, steps=20_000).modes
    25
    """
    if not 1e-13 <= tolerance <= 1e-2:
        raise InputError(SAYS("tolerance", tolerance=tolerance))
    if not (isinstance(lags, int | np.integer) and EXACT_LAGS <= lags <= WHOLE):
        raise InputError(SAYS("lags", lags=lags, EXACT_LAGS=EXACT_LAGS, WHOLE=WHOLE))
    name = f"compressed({tolerance:g})" if lags == EXACT_LAGS else f"compressed({tolerance:g}, lags={lags})"
    return Memory(name, partial(compressed_kernel, tolerance=float(tolerance), lags=int(lags)), float(tolerance))


def memory_from_name(name: str | Memory, tolerance: float = 1e-10) -> Memory:
    """Turn ``"full"``, ``"short(2000)"`` or ``"compressed"`` into a :class:`Memory`; ``"compressed(1e-8)"`` too.

    Raises
    ------
    InputError
        If the name is none of these.

    Examples
    --------
    >>> memory_from_name("short(500)").name
    'short(500)'
    """
    if isinstance(name, Memory):
        return name
    if (written := WRITTEN.fullmatch(str(name))) is None:
        raise InputError(SAYS("unknown", name=name))
    length, own, lags = written.groups()
    if length:
        return short(int(length))
    return full() if name == "full" else compressed(float(own or tolerance), lags=int(lags or EXACT_LAGS))
