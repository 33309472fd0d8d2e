r"""Multi-term equations and linear systems, in the form that the solver takes: one order a state.

.. math::  D^{a_m} y = g\big(t,\; D^{a_0} y, \dots, D^{a_{m-1}} y,\; u,\; p\big), \qquad
           0 \le a_0 < a_1 < \dots < a_m, \qquad y(0), y'(0), \dots \text{ given},

all Caputo, any real orders, is what Bagley and Torvik's plate, Basset's sphere or a PI^λD^μ loop obey.
:func:`multi_term` and, for constant coefficients, :func:`linear_multi_term` make it a system of orders between
0 and 2 for :func:`fracid.solve_fde`; :func:`linear_system` does D^q x = A x + B u.

**When derivatives compose.**  :math:`D^{\varepsilon} D^{a} y = D^{a+\varepsilon} y` holds for smooth y only if

1. a is a whole number (then it is the definition), or
2. a and a + ε lie in one unit interval [l − 1, l]  ([Diethelm], Lemma 3.13),

and not otherwise: :math:`D^{0.7} D^{0.8}\,t = t^{-1/2}/\Gamma(1/2)`, but :math:`D^{1.5}\,t = 0`.  A chain of
derivatives that steps over a whole number forgets y'(0) there.  So the states are the derivatives that g reads, y
itself, and what whole numbers the two rules need; the whole ones start at y(0), y'(0), …, the fractional ones at 0
(their y^(l) is integrated over nothing), and the system has the solution of the equation ([Diethelm], Chapter 8;
for any real orders [Cong]).

**Two forms.**  A state may be the integral of any higher derivative that the rules allow:

=========  ==============================  =========================  ==========================================
``form``   each state is integrated from   y'' + c D^1.5 y + y = …    error of the bare trapezoidal product rule
=========  ==============================  =========================  ==========================================
chain      the next one above it           D^1.5 y = z, D^.5 z = g    h^1.5 or so: z ~ t^.5 is integrated; steady
                                                                      for small c, and falls as c grows
star       the highest derivative, or the  Dy = y', Dy' = g,          h^2 where g(t) is smooth along the solution;
           nearest whole one               D^.5 z = g                 else h^1.5 or so, and grows with c
=========  ==============================  =========================  ==========================================

Both are right, and a state costs the same in each; ``star`` may need one more.  ``chain`` is the default: strong
fractional damping makes y'' collapse within the first step, and what ``star`` integrates wrongly there stays.
Take ``star`` where fractional terms are weak or the solution is smooth.  For c = 0.1, 1, 100, free from y(0) = 1,
h = 1/80 to t = 10: chain 3e-4, 8e-5, 3e-6; star 5e-5, 2e-4, 1e-3.  For y = 1 + t + t²: chain 5e-4, star 4e-12.
``examples/bagley_torvik.py`` prints such a table.  A name more in `orders` costs one state, and makes that
derivative readable in :attr:`System.column`.

References
----------
.. [Diethelm] K. Diethelm, *The Analysis of Fractional Differential Equations*, 2010: Lemma 3.13 and
   Chapter 8.
.. [Cong] N. D. Cong, *Semigroup property of fractional differential operators and its applications*,
   arXiv:2107.08914: which derivatives compose, and what may be reduced.
.. [Edwards] J. Edwards, N. Ford, A. Simpson, *The numerical solution of linear multi-term fractional
   differential equations: systems of equations*, J. Comput. Appl. Math. 148 (2002): the same reduction.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fracid.arrays import FloatArray
from fracid.errors import InputError
from fracid.solver.right_hand_side import RightHandSide
from fracid.solver.solve import solve_fde
from fracid.solver.trajectory import SAYS, Trajectory, vector

SAME = 1e-9
"""Orders nearer to each other, or to a whole number, are the same: 0.1 + 0.2 is 0.3."""

HIGHEST = -1
"""As a state's driver: g, the highest derivative, which is no state itself."""


@dataclass(frozen=True)
class System:
    """A system for the solver: ``solve_fde(s.rhs, s.orders, s.initial, parameters=s.parameters, …)``."""

    rhs: RightHandSide
    """Plain Python in Numba's language; the same function wherever only numbers differ, so that it compiles once."""
    orders: FloatArray
    """One per state, in (0, 2), shape (n_states,)."""
    initial: FloatArray
    """x(0), shape (n_states,), or with the first derivatives where an order exceeds 1, shape (n_states, 2)."""
    parameters: FloatArray
    """What `rhs` gets as ``p``, shape (n_parameters,)."""
    column: Mapping[float, int] = field(default_factory=lambda: MappingProxyType({}))
    """Where D^a y stands among the states: ``run.states[:, s.column[1.5]]``; empty for a :func:`linear_system`."""

    def solve(self, *, step: float, end: float, **options: Any) -> Trajectory:
        """Run :func:`fracid.solve_fde` on it.

        Parameters
        ----------
        step, end : float
            h and the last time [s].
        **options
            As of :func:`fracid.solve_fde`: ``inputs``, ``method``, ``memory``, …

        Raises
        ------
        InputError
            As :func:`fracid.solve_fde`.

        Examples
        --------
        >>> decay = linear_system([[-1.0]], orders=0.8, initial=[1.0])
        >>> round(float(decay.solve(step=1e-3, end=1.0).states[-1, 0]), 5)
        0.38695
        """
        arguments: dict[str, Any] = {"parameters": self.parameters} | options
        return solve_fde(self.rhs, self.orders, self.initial, step=step, end=end, **arguments)


def multi_term(
    g: Callable[[float, FloatArray, FloatArray, FloatArray], float],
    orders: Sequence[float],
    initial: ArrayLike,
    *,
    parameters: ArrayLike = (),
    form: str = "chain",
) -> System:
    r"""Make D^{a_m} y = g(t, d, u, p) a system, with d the derivatives below the highest.

    Parameters
    ----------
    g : function (t, d, u, p) -> float
        Plain Python in Numba's language; ``d[k]`` is D^{a_k} y, shape (m,).  Define it once, not in a loop: each
        new function is compiled anew, which takes some tenths of a second.
    orders : sequence of float, shape (m + 1,)
        a_0, …, a_m, increasing; 0 is y itself, the last is solved for.
    initial : array_like, shape (ceil(a_m),)
        y(0), y'(0), …
    parameters : array_like, shape (n_parameters,)
        Given to `g` as ``p``.
    form : {"chain", "star"}
        The module's first screen says which when.

    Returns
    -------
    System

    Raises
    ------
    InputError
        If the orders are not increasing numbers from 0 up, there are more or fewer initial values than
        ceil(a_m), the form is unknown, or `g` does not take (t, d, u, p).

    References
    ----------
    [Diethelm] and [Cong] in the module's docstring.

    Examples
    --------
    y'' + D^1.5 y + y³ = (1 + t)³, y(0) = y'(0) = 1, has the solution 1 + t:

    >>> def hardening(t, d, u, p):
    ...     return (1 + t) ** 3 - d[1] - p[0] * d[0] ** 3
    >>> s = multi_term(hardening, (0, 1.5, 2), initial=[1.0, 1.0], parameters=[1.0])
    >>> s.orders, dict(s.column)
    (array([1.5, 0.5]), {0.0: 0, 1.5: 1})
    >>> run = s.solve(step=0.01, end=2.0)
    >>> run.states[-1].round(6) + 0.0
    array([3., 0.])
    """
    a = _increasing(orders)
    drivers, place = _drivers(a, form)
    rhs = _driven(_taking(g, "g", "(t, d, u, p)", 4), tuple(place[order] for order in a[:-1]),
                  tuple(place.get(driver, HIGHEST) for driver in drivers.values()))  # fmt: skip
    return _system(rhs, drivers, initial, vector("parameters", parameters))


def linear_multi_term(
    coefficients: Mapping[float, float],
    forcing: Callable[[float, FloatArray, FloatArray], float] | str | None = None,
    *,
    initial: ArrayLike,
    parameters: ArrayLike = (),
    form: str = "chain",
) -> System:
    r"""Make :math:`\sum_k c_k D^{a_k} y = f(t)` a system.

    All coefficients go through the parameters: equations of any coefficients and orders are one compiled
    function, and another for each forcing function.

    Parameters
    ----------
    coefficients : mapping of float to float
        Order a_k → c_k, such as ``{2: 1.0, 1.5: 0.3, 0: 4.0}``.  The highest must not be 0; with 0 elsewhere the
        equation is as without that term, but the derivative becomes a state.
    forcing : None, "input" or function (t, u, p) -> float
        f: nothing, the input given to the solver as ``inputs``, or plain Python in Numba's language.
    initial : array_like, shape (ceil(a_m),)
        y(0), y'(0), …
    parameters : array_like, shape (n_parameters,)
        Given to a forcing function as ``p``.
    form : {"chain", "star"}
        The module's first screen says which when.

    Returns
    -------
    System
        Its parameters are the matrix of the system by rows, what the forcing adds to each state, and `parameters`.

    Raises
    ------
    InputError
        If the coefficients are not finite, an order is negative or given twice, the highest coefficient is 0,
        the forcing is none of these, or as :func:`multi_term`.

    Examples
    --------
    Bagley and Torvik's plate, y'' + D^1.5 y + y = 1 + t, y(0) = y'(0) = 1, has the solution 1 + t:

    >>> def load(t, u, p):
    ...     return 1 + t
    >>> plate = linear_multi_term({2: 1.0, 1.5: 1.0, 0: 1.0}, load, initial=[1.0, 1.0])
    >>> run = plate.solve(step=0.01, end=2.0)
    >>> print(f"{run.states[-1, plate.column[0]]:.9f}")
    3.000000000
    """
    a, c = _terms(coefficients)
    drivers, place = _drivers(a, form)
    highest = np.zeros(len(drivers) + 1)  # D^{a_m} y = highest · (x, f)
    for order, coefficient in zip(a[:-1], c[:-1], strict=True):
        highest[place[order]] = -coefficient / c[-1]
    highest[-1] = 1 / c[-1]
    one = np.eye(len(drivers) + 1)
    rows = np.array([one[place[driver]] if driver in place else highest for driver in drivers.values()])
    A, b = rows[:, :-1], rows[:, -1]
    rhs, load = _forcing(forcing)
    values = vector("parameters", parameters)
    return _system(rhs, drivers, initial, np.concatenate([A.ravel(), *([b, values] if load else [])]))


def linear_system(A: ArrayLike, B: ArrayLike | None = None, *, orders: ArrayLike, initial: ArrayLike) -> System:
    """Make D^q x = A x + B u a system; A and B go through the parameters, so that all are one compiled function.

    Parameters
    ----------
    A : array_like, shape (n_states, n_states)
    B : array_like, shape (n_states, n_inputs), optional
        The inputs u are then given to the solver as ``inputs``.
    orders : float or array_like, shape (n_states,)
    initial : array_like, shape (n_states,) or (n_states, 2)
        Both as in :func:`fracid.solve_fde`, which checks them.

    Returns
    -------
    System
        Its parameters are A by rows, then B by rows.

    Raises
    ------
    InputError
        If A is not square, B has another number of rows, or an entry is not a finite number.

    Examples
    --------
    >>> oscillator = linear_system([[0, 1], [-4, -0.1]], [0, 1], orders=0.9, initial=[0.1, 0.0])
    >>> run = oscillator.solve(step=0.01, end=20.0, inputs=np.zeros(2001))
    >>> run.states.shape
    (2001, 2)
    """
    a = vector("A", A)
    if a.ndim != 2 or a.shape[0] != a.shape[1]:
        raise InputError(f"A has the shape {a.shape}; expected a square matrix, a row and a column for each state.")
    b = np.zeros((len(a), 0)) if B is None else vector("B", B)
    if b.ndim > 2 or len(b) != len(a):
        raise InputError(f"B has the shape {b.shape}; expected ({len(a)}, n_inputs), a row for each state of A.")
    matrices = np.concatenate([a.ravel(), b.ravel()])
    return System(_linear, vector("orders", orders), vector("initial", initial), matrices)


# --- which state is integrated from which ----------------------------------------------------------------


def _driver(form: str, a: float, a_m: float, orders: set[float]) -> float:
    """The nearest derivative above a that is named, or the highest, where it composes; else the next whole one."""
    above = min({b for b in orders if b > a} | {a_m}) if form == "chain" else a_m
    if a.is_integer():
        return above if above - a < 2 else a + 1
    return min(above, float(math.ceil(a)))


def _drivers(a: tuple[float, ...], form: str) -> tuple[dict[float, float], dict[float, int]]:
    """The derivatives that are states, increasing, each with the one it is integrated from, and where it stands."""
    if form not in ("chain", "star"):
        raise InputError(f"There is no form {form!r}; type 'chain' or 'star'.")
    a_m, orders = a[-1], {0.0, *a[:-1]}
    driver: dict[float, float] = {}
    worklist = set(orders)
    while worklist:
        order = worklist.pop()
        driver[order] = _driver(form, order, a_m, orders)
        worklist |= {driver[order]} - {*driver, a_m}
    return dict(sorted(driver.items())), {node: i for i, node in enumerate(sorted(driver))}


def _system(rhs: RightHandSide, drivers: dict[float, float], initial: ArrayLike, parameters: FloatArray) -> System:
    """Orders are the gaps from each state to its driver; whole derivatives start at their given values."""
    y0 = _initial(initial, max(drivers.values()))
    orders = np.array([driver - node for node, driver in drivers.items()])
    start = np.zeros((len(drivers), 2))
    for i, node in enumerate(drivers):
        if node.is_integer():
            start[i, 0] = y0[int(node)]
            start[i, 1] = y0[int(node) + 1] if orders[i] > 1 else 0.0
    return System(rhs, orders, start, parameters, column=MappingProxyType({node: i for i, node in enumerate(drivers)}))


# --- right-hand sides --------------------------------------------------------------------------------------


def _linear(t: float, x: FloatArray, u: FloatArray, p: FloatArray, out: FloatArray) -> None:  # noqa: ARG001
    """D^q x = A x + B u; p holds A, then B, by rows."""
    n = len(x)
    inputs = len(p) // n - n
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += p[i * n + j] * x[j]
        for k in range(inputs):
            total += p[n * n + i * inputs + k] * u[k]
        out[i] = total


@lru_cache(maxsize=128)
def _forced(force: Any) -> RightHandSide:
    """D^q x = A x + b f(t, u, p'); p holds A by rows, b and p'."""

    def rhs(t: float, x: FloatArray, u: FloatArray, p: FloatArray, out: FloatArray) -> None:
        n = len(x)
        f = 0.0 + force(t, u, p[n * n + n :])
        for i in range(n):
            total = p[n * n + i] * f
            for j in range(n):
                total += p[i * n + j] * x[j]
            out[i] = total

    return _named_after(force, rhs)


@lru_cache(maxsize=128)
def _driven(g: Any, columns: tuple[int, ...], drivers: tuple[int, ...]) -> RightHandSide:
    """Each state is integrated from its driver; `columns` are the states that g reads."""
    count = len(columns)
    columns = columns or (0,)  # Numba cannot index an empty tuple

    def rhs(t: float, x: FloatArray, u: FloatArray, p: FloatArray, out: FloatArray) -> None:
        for k in range(count):  # out has room for d, and a new array would cost more than g
            out[k] = x[columns[k]]
        highest = 0.0 + g(t, out[:count], u, p)  # where g returns nothing, the solver's first look says so
        for i in range(len(drivers)):
            out[i] = highest if drivers[i] < 0 else x[drivers[i]]

    return _named_after(g, rhs)


def _named_after(function: Any, rhs: Any) -> RightHandSide:
    """Errors name the caller's function, and the caller's function is not taken for one to be cached on disk."""
    rhs.__name__ = rhs.__qualname__ = getattr(function, "__name__", "function")
    rhs.__module__ = "reduced"
    result: RightHandSide = rhs
    return result


def _forcing(forcing: Any) -> tuple[RightHandSide, bool]:
    """The right-hand side, and whether its parameters hold what the forcing adds to each state."""
    if forcing is None:
        return _linear, False
    if isinstance(forcing, str) and forcing == "input":
        return _linear, True
    if not callable(forcing):
        raise InputError(SAYS("forcing", forcing=forcing))
    return _forced(_taking(forcing, "forcing", "(t, u, p)", 3)), True


def _taking(function: Any, what: str, takes: str, count: int) -> Any:
    """A caller's function, if it takes what it is given."""
    function = getattr(function, "py_func", function)
    if not callable(function):
        raise InputError(f"{what} = {function!r}; expected a function {takes} that returns a number.")
    try:
        signature = inspect.signature(function)
        signature.bind(*[None] * count)
    except (TypeError, ValueError):
        name = getattr(function, "__name__", repr(function))
        raise InputError(f"{what}, the function {name}, takes {signature}; it must take {takes}.") from None
    return function


# --- arguments ---------------------------------------------------------------------------------------------


def _increasing(orders: Any) -> tuple[float, ...]:
    """The orders, rounded to a whole number where they are one but for rounding."""
    values = vector("orders", orders)
    if values.ndim != 1 or len(values) == 0:
        raise InputError(SAYS("orders", orders=orders))
    a = tuple(float(round(v)) if abs(v - round(v)) < SAME else float(v) for v in values)
    for low, high in pairwise(sorted(a)):
        if high - low < SAME:
            raise InputError(f"orders = {orders!r}: {low:g} is there twice; name each derivative once.")
    if min(a) < 0:
        raise InputError(f"orders = {orders!r}: {min(a):g} is negative; expected 0 (y itself) or more.")
    if a != tuple(sorted(a)):
        suggestion = ", ".join(f"{v:g}" for v in sorted(a))
        raise InputError(SAYS("increasing", orders=orders, suggestion=suggestion))
    if a[-1] == 0:
        raise InputError(SAYS("highest-0", orders=orders))
    return a


def _terms(coefficients: Any) -> tuple[tuple[float, ...], FloatArray]:
    """Orders, increasing, and their coefficients."""
    if not isinstance(coefficients, Mapping) or not coefficients:
        raise InputError(SAYS("coefficients", coefficients=coefficients))
    keys = vector("the orders in coefficients", list(coefficients))
    values = vector("coefficients", list(coefficients.values()))
    by_order = np.argsort(keys)
    a, c = _increasing(keys[by_order].tolist()), values[by_order]
    if c[-1] == 0:
        raise InputError(SAYS("coefficient-0", value=a[-1]))
    return a, c


def _initial(initial: ArrayLike, a_m: float) -> FloatArray:
    y0, count = vector("initial", initial), math.ceil(a_m)
    if y0.shape != (count,):
        names = ", ".join(["y(0)", "y'(0)", "y''(0)", *(f"y^({k})(0)" for k in range(3, count))][:count])
        raise InputError(SAYS("initial-derivatives", y0=y0, a_m=a_m, count=count, s="s" * (count > 1), names=names))
    return y0
