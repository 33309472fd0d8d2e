"""``model.m``: the identified model as one plain file for MATLAB and Octave; ``results.mat``: all that was found.

``model.m`` steps as fracid does, with the tables of :mod:`fracid.export.recursion` written out: the same scheme, the
same memory, the same corrections of the start.  Its right-hand side is the model's own, written from its source.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fracid._version import __version__
from fracid.arrays import by_name
from fracid.errors import InputError
from fracid.export.markup import program
from fracid.export.recursion import Case, Recursion
from fracid.export.table import curves_of
from fracid.export.whole import SAYS, words_of, written
from fracid.models.written.languages import Matlab
from fracid.runs.saved import SavedRun
from fracid.safety.door import own_text
from fracid.safety.text import printable


def matlab_model(tables: Recursion, case: Case, run_name: str) -> str:
    """Write ``model.m``.

    Parameters
    ----------
    tables : Recursion
    case : Case
        The recording that ``model()`` without arguments simulates.
    run_name : str
        For the head of the file.

    Returns
    -------
    str

    Raises
    ------
    InputError
        As :func:`fracid.export.whole.written` says.

    Examples
    --------
    >>> import fracid
    >>> swing = fracid.Experiment("twin", 2e-3, np.zeros((500, 2)), np.zeros((1, 1)))
    >>> problem = fracid.Problem(fracid.rotary_pendulum(), (swing,), {"lambda": 0.9, "mu": 0.95}, initial_state="held")
    >>> x = problem.start
    >>> text = matlab_model(Recursion.of(problem, x), Case.of(problem, x, swing), "runs/twin")
    >>> text.splitlines()[0]
    'function [t, x] = model(x0, u, n, h, p, after)'
    """
    family = tables.scheme.family
    template = f"model_{'gl' if family == 'gl' else 'pi'}.m.in"
    return program(
        own_text(f"export/{template}"), t=tables, case=case, run=run_name, gl=family == "gl", third=family == "pi3",
        rhs=written(tables.model, "matlab", words_of(template)), name=Matlab(tables.model.program).name,
        starts=[k.start[1:] for k in tables.kernels], places=lambda numbers: np.array(numbers) + 1,
        inputs=[side[:, : len(tables.model.inputs)] for side in case.driven],
    )  # fmt: skip


# --- results.mat -------------------------------------------------------------------------------------


def matlab_results(run: SavedRun, **more: Any) -> bytes:
    """``results.mat`` (version 5); `more` goes into it as it is.

    Parameters
    ----------
    run : SavedRun
    **more
        Further variables, such as the matrices of a linear model.

    Returns
    -------
    bytes

    Examples
    --------
    >>> matlab_results.__name__
    'matlab_results'
    """
    from scipy.io import savemat

    p, result = run.problem, run.result
    name_of = Matlab(p.model.program).name
    first = {n: (own, own.experiments[at][0]) for own in run.problems for n, (_, at) in own.recordings.items()}
    recordings = []
    for name, fit in run.recordings.items():
        own, e = first[name]
        case = Case.of(own, own.point(run.values), e)
        recordings.append({
            "name": name, **curves_of(fit), "rmse": dict(fit.rmse), "past_states": case.past,
            "inputs": case.driven.before, "inputs_after": case.driven.jumps, "step": case.step,
            "steps": float(case.steps), "start": case.start,
            "constants": by_name(map(name_of, p.model.parameter_names), case.parameters),
        })  # fmt: skip
    content = {
        "about": f"fracid {__version__}: {run.folder.name}; angles in rad, time in s",
        "model": {"name": p.model.name, "zero": p.model.zero, "source": p.model.source,
                  "states": list(p.model.states), "inputs": list(p.model.inputs), "outputs": list(p.outputs)},
        "orders": _estimates(result["orders"]), "parameters": _estimates(result["parameters"]),
        "cost": result["cost"], "recordings": _cell(recordings),
        "options": {"method": p.method, "memory": p.memory.name, "substeps": float(p.substeps),
                    "initial_state": p.initial_state, "weights": p.weights, "cost": p.cost_function.name,
                    "preset": result.get("preset")}, **more,
    }  # fmt: skip
    memory = BytesIO()
    savemat(memory, _plain(content), do_compression=True, oned_as="column", long_field_names=True)
    return memory.getvalue()


def _estimates(estimates: Mapping[str, Any]) -> dict[str, Any]:
    """By name: value, unit, interval and what is said of it."""
    fields = ("value", "unit", "free", "standard_error", "interval95", "identifiable")
    return {n: {f: e.get(f) for f in fields} for n, e in estimates.items()}


def _cell(values: list[Any]) -> NDArray[Any]:
    """A column of a cell array."""
    cell = np.empty(len(values), dtype=object)
    cell[:] = [_plain(value) for value in values]
    return cell


def _plain(value: Any) -> Any:
    """As savemat takes it: None becomes an empty matrix, a list of texts a cell array, truth a logical."""
    if isinstance(value, Mapping):
        if twins := [n for n, count in Counter(map(_field, value)).items() if count > 1]:
            raise InputError(SAYS("one-field", field=twins[0], names=[n for n in value if _field(n) == twins[0]]))
        return {_field(n): _plain(v) for n, v in value.items()} or np.zeros((0, 0))
    if value is None:
        return np.zeros((0, 0))
    if isinstance(value, str):
        return printable(value) or np.zeros((0, 0))
    if isinstance(value, list | tuple) and all(isinstance(v, str) for v in value):
        return _cell(list(value))
    return value


def _field(name: str) -> str:
    """A name that MATLAB takes for a field: letters, digits and underscores, a letter first, 63 at most."""
    text = "".join((c if c.isalnum() else "_") if c.isascii() else f"u{ord(c):x}" for c in name)[:63]
    return text if text[:1].isalpha() else f"x_{text}"[:63]
