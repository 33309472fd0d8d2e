"""``model.toml``: the identified model as equations of a project file, which need no trust."""

from __future__ import annotations

import re
from collections.abc import Mapping

from fracid._version import __version__
from fracid.models import Model
from fracid.models.written.equations import equations_of
from fracid.problem.toml_text import toml_document


def toml_model(model: Model, parameters: Mapping[str, float], orders: Mapping[str, float], run_name: str) -> str:
    """Write the tables of a model; recordings and what is free are yours to add.

    Parameters
    ----------
    model : Model
    parameters, orders : mapping
        Their values, by name.
    run_name : str
        For the head of the file.

    Raises
    ------
    InputError
        Where the model has loops.

    Examples
    --------
    >>> import fracid
    >>> rig = fracid.rotary_pendulum()
    >>> values = dict(zip(rig.parameter_names, rig.parameter_vector(), strict=True))
    >>> text = toml_model(rig, values, {"lambda": 0.9, "mu": 0.95}, "runs/rig")
    >>> 'theta = { equals = "theta_rate", order = "lambda" }' in text
    True
    """
    tables = {n: table for n, table in equations_of(model).items() if table}
    name = re.sub(r"[^A-Za-z0-9]+", "-", model.name).strip("-")
    constants = {p.name: {"value": float(parameters[p.name]), "unit": p.unit} for p in model.parameters}
    said = {"name": f"{name}-equations", **tables, "parameters": constants,
            "orders": {n: float(orders[n]) for n in model.order_names}}  # fmt: skip
    return f"# Written by fracid {__version__} from {' '.join(run_name.split())}.\n{toml_document({'model': said})}"
