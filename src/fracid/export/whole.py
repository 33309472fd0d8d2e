"""Whether a model's code in another language says all that its right-hand side does.

A friction that was added to a right-hand side and forgotten in its code would be found by a fit and silently missing in
the program.  So of each constant that is not zero the code must have the name, or the right-hand side no use for it.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from fracid.arrays import FloatArray
from fracid.models import Model

__all__ = ["not_written"]

LANGUAGES = {"c": ("C", r"(?s)/\*.*?\*/|//[^\n]*"), "matlab": ("MATLAB", r"%[^\n]*")}
"""What each is called, and its comments: a name there is no use of it."""

SIZES = (1e-3, 1e-2, 0.1, 1.0, 10.0)
"""Of the states and inputs at which a right-hand side is looked at, each with :data:`POINTS` of them: joints that slide
and joints that hardly move, voltages within a dead zone and beyond a limit."""

POINTS = 10

CHANGE = 1.001
"""Times its value is a constant moved, and it is taken away, to see whether the right-hand side feels it."""


def not_written(model: Model, parameters: FloatArray, language: str) -> str:
    """Why there is no program of a model with these constants in ``c`` or ``matlab``; empty if there is one.

    Parameters
    ----------
    model : Model
    parameters : ndarray, shape (n_parameters,)
    language : str
        A key of :attr:`fracid.models.Written.code`; JavaScript is made of C.

    Examples
    --------
    >>> import fracid
    >>> from dataclasses import replace
    >>> rig = fracid.rotary_pendulum(drag_alpha=1e-5)
    >>> not_written(rig, rig.parameter_vector(), "c")
    ''
    >>> without = rig.written.code["c"].replace("drag_alpha", "0")
    >>> older = replace(rig, written=replace(rig.written, code={"c": without}))
    >>> not_written(older, older.parameter_vector(), "c")[:77]
    "The C code of the model 'rotary-pendulum' lacks drag_alpha = 1e-05 N m s^2/ra"
    """
    if model.written is None or language not in model.written.code:
        return f"The model {model.name!r} is a Python program of yours, which fracid does not translate."
    called, comments = LANGUAGES[language]
    code = re.sub(comments, "", model.written.code[language])
    lacking = [
        f"{p.name} = {parameters[k]:.6g}{'' if p.unit in ('', '1', '-') else f' {p.unit}'}"
        for k, p in enumerate(model.parameters)
        if parameters[k] != 0.0 and not re.search(rf"\b{p.name}\b", code) and _felt(model, parameters, k)
    ]
    if not lacking:
        return ""
    return (
        f"The {called} code of the model {model.name!r} lacks {' and '.join(lacking)}, which its right-hand side has: "
        f'it would simulate another model. Write that into the code, Written(..., code={{"{language}": ...}}).'
    )


def _felt(model: Model, parameters: FloatArray, k: int) -> bool:
    """Whether the right-hand side changes with a constant at any of a few states and inputs."""
    random, n = np.random.default_rng(1), len(model.states)
    others = [np.where(np.arange(len(parameters)) == k, value, parameters) for value in (0.0, CHANGE * parameters[k])]
    for size in np.repeat(SIZES, POINTS):
        x, u = size * random.standard_normal(n), size * random.standard_normal(max(1, len(model.inputs)))
        here = _derivatives(model, x, u, parameters)
        if not all(np.array_equal(here, _derivatives(model, x, u, p), equal_nan=True) for p in others):
            return True
    return False


def _derivatives(model: Model, x: FloatArray, u: FloatArray, p: FloatArray) -> FloatArray:
    """What the right-hand side writes, rates of relaxing states included; NaN where it cannot be computed."""
    rhs: Any = getattr(model.rhs, "py_func", model.rhs)
    out = np.zeros(len(x) * (1 + bool(model.relaxing)))
    try:
        with np.errstate(all="ignore"):
            rhs(0.0, x, u, p, out)
    except (ArithmeticError, ValueError):
        return np.full_like(out, np.nan)
    return out
