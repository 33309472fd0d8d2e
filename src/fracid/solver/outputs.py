"""An output that is no state: y = h(t, x, u, p), evaluated along a run, compiled.

def force(t, x, u, p):         # time, states, inputs, parameters; as a right-hand side takes them
    return p[0] * x[0] + p[1] * x[1]
"""

from __future__ import annotations

from typing import Any

import numba as nb
import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import InputError
from fracid.models.base import Output
from fracid.solver.right_hand_side import SAYS, name_of, teach_helpers
from fracid.solver.same_function import once_for_equals


def output_along(h: Output, times: FloatArray, states: FloatArray, inputs: FloatArray, p: FloatArray) -> FloatArray:
    """h at each time of a run, shape (n,).

    Parameters
    ----------
    h : function (t, x, u, p) -> float
        Plain Python in Numba's language.
    times : array, shape (n,)
        [s]
    states : array, shape (n, n_states)
    inputs : array, shape (n, n_inputs), or one row for all
    p : array, shape (n_parameters,)

    Raises
    ------
    InputError
        If Numba does not compile it, or it fails.

    Examples
    --------
    >>> def spring(t, x, u, p):
    ...     return p[0] * x[0]
    >>> output_along(spring, np.arange(2.0), np.array([[1.0], [2.0]]), np.zeros((1, 0)), np.array([3.0]))
    array([3., 6.])
    """
    try:
        return np.asarray(_compiled(h)(times, np.ascontiguousarray(states), np.ascontiguousarray(inputs), p))
    except InputError:
        raise
    except Exception as error:
        reason = next((line for line in str(error).splitlines() if line.strip()), type(error).__name__)
        raise InputError(SAYS("output-fails", h=name_of(h), error=error, why=reason, x=states, u=inputs, p=p)) from None


@once_for_equals
def _compiled(h: Any) -> Any:
    function = getattr(h, "py_func", h)
    teach_helpers(function)
    one = nb.njit(nogil=True, error_model="numpy", boundscheck=True)(function)

    @nb.njit(nogil=True, error_model="numpy", boundscheck=True)  # type: ignore[untyped-decorator]
    def along(times: FloatArray, states: FloatArray, inputs: FloatArray, p: FloatArray) -> FloatArray:
        y = np.empty(len(times))
        for n in range(len(times)):
            y[n] = one(times[n], states[n], inputs[min(n, len(inputs) - 1)], p)
        return y

    return along
