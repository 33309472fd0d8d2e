"""``fracid_model.mjs``: the identified model as one JavaScript module, for browsers and Node; the page's solver.

``recursion.js`` is fracid's solver in JavaScript, memory and start included, so that orders may be changed while it
runs.  The right-hand side is the model's own, written from its source.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Any

from fracid.arrays import FloatArray, by_name
from fracid.errors import InputError
from fracid.export.markup import program as filled
from fracid.export.recursion import TIGHT, Case
from fracid.export.whole import written, written_outputs
from fracid.models import Model
from fracid.models.joints import Complement
from fracid.problem import Experiment, Problem
from fracid.safety.door import own_text
from fracid.solver.methods import METHODS, Method

FAMILIES = ("pi", "gl")
"""Whose weights and start ``recursion.js`` makes."""


def solver() -> str:
    """The solver, a script that defines ``Fracid``."""
    return own_text("export/recursion.js")


def program(problem: Problem) -> dict[str, Any]:
    """What ``Fracid.simulate`` must know of a problem beside its right-hand side and its values."""
    tolerance = problem.memory.tolerance
    return program_of(problem.model, problem.method, None if tolerance is None else tolerance or TIGHT)


def program_of(model: Model, method: str, tolerance: float | None) -> dict[str, Any]:
    """The same of a model."""
    return {
        "states": list(model.states),
        "orders": [{"complement": q.parameter} if isinstance(q, Complement) else q for q in model.orders],
        "relaxing": list(model.relaxing_states),
        "width": max(1, len(model.inputs)),
        **_scheme(METHODS[method]),
        "tolerance": tolerance,
    }


def _scheme(method: Method) -> dict[str, Any]:
    """How ``recursion.js`` steps with a method; nothing where it cannot."""
    if method.exported is None or method.family not in FAMILIES:
        return {}
    return {"family": method.family, "newton": method.exported.newton, "raw": method.raw,
            "lastFirst": method.exported.last_first}  # fmt: skip


def no_javascript(problem: Problem) -> str:
    """Why a problem cannot be simulated in JavaScript; empty if it can.

    Examples
    --------
    >>> import numpy as np, fracid
    >>> swing = fracid.Experiment("twin", 2e-3, np.zeros((500, 2)), np.zeros((1, 1)))
    >>> problem = fracid.Problem(fracid.rotary_pendulum(), (swing,), {"lambda": 0.9, "mu": 0.95}, initial_state="held")
    >>> no_javascript(problem)
    ''
    """
    try:
        written(problem.model, "javascript")
    except InputError as error:
        return str(error)
    if not _scheme(METHODS[problem.method]):
        known = ", ".join(n for n, method in METHODS.items() if _scheme(method))
        return f"The method {problem.method} is not written in JavaScript; {known} are."
    if problem.memory.tolerance is None:
        return f"The memory {problem.memory.name} is not written in JavaScript; compressed and full are."
    return ""


def javascript_model(problem: Problem, x: FloatArray, e: Experiment, run_name: str) -> str:
    """Write ``fracid_model.mjs`` for one recording's step, constants and start.

    Parameters
    ----------
    problem : Problem
    x : ndarray, shape (n_unknowns,)
    e : Experiment
    run_name : str
        For the head of the file.

    Returns
    -------
    str

    Raises
    ------
    InputError
        Where :func:`no_javascript` says why not.

    Examples
    --------
    >>> import numpy as np, fracid
    >>> swing = fracid.Experiment("twin", 2e-3, np.zeros((500, 2)), np.zeros((1, 1)))
    >>> problem = fracid.Problem(fracid.rotary_pendulum(), (swing,), {"lambda": 0.9, "mu": 0.95}, initial_state="held")
    >>> javascript_model(problem, problem.start, swing, "runs/twin").splitlines()[-1]
    '}'
    """
    if reason := no_javascript(problem):
        raise InputError(reason)
    model, case = problem.model, Case.of(problem, x, e)
    orders, (seen, names) = model.named_orders(problem.unpack(x, e)[0]), outputs_of(model)
    jumps = case.driven_after.jumps
    recording = {
        "step": case.step, "steps": case.steps, "every": 1, "limit": case.limit, "initial": case.past[-1].tolist(),
        "parameters": by_name(model.parameter_names, case.parameters),
        "inputs": case.driven_after.before.ravel().tolist(), "jumps": None if jumps is None else jumps.ravel().tolist(),
    }  # fmt: skip
    return filled(
        own_text("export/fracid_model.mjs.in"), model=model, case=case, run=run_name, solver=solver(),
        rhs=written(model, "javascript"), seen=seen, names=names, program=program(problem), recording=recording,
        order_values=orders, orders=", ".join(f"{n} = {v!r}" for n, v in orders.items()),
    )  # fmt: skip


def outputs_of(model: Model) -> tuple[str, list[str]]:
    """The outputs as JavaScript, and their names; none of a model with one that cannot be written.

    Examples
    --------
    >>> import fracid
    >>> outputs_of(fracid.model("capacitor"))[1]
    ['voltage']
    """
    with suppress(InputError):
        return written_outputs(model, "javascript"), [*model.shown]
    return "const modelOutputs = () => () => {};", []
