"""``model.toml``: the identified model as equations of a project file, which need no trust."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping

from fracid._version import __version__
from fracid.models import Model
from fracid.models.joints import Complement
from fracid.models.written.equations import equations_of
from fracid.problem.toml_text import toml_key


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
        Where the model has loops, or states that relax with a step of their own.

    Examples
    --------
    >>> import fracid
    >>> rig = fracid.rotary_pendulum()
    >>> values = dict(zip(rig.parameter_names, rig.parameter_vector(), strict=True))
    >>> text = toml_model(rig, values, {"lambda": 0.9, "mu": 0.95}, "runs/rig")
    >>> 'theta = { equals = "theta_rate", order = "lambda" }' in text
    True
    """
    definitions, equations = equations_of(model)
    quoted = json.dumps
    states = list(equations)
    tables = {
        "definitions": [f"{n} = {quoted(text)}" for n, text in definitions.items()],
        "equations": [f"{n} = {{ equals = {quoted(text)}, order = {_order(q)} }}"
                      for (n, text), q in zip(equations.items(), model.orders, strict=True)],
        "outputs": [f"{toml_key(n)} = {quoted(states[i])}" for n, i in model.output_states.items()],
        "parameters": [f"{p.name} = {{ value = {float(parameters[p.name])!r}, unit = {quoted(p.unit)} }}"
                       for p in model.parameters],
        "orders": [f"{toml_key(n)} = {float(orders[n])!r}" for n in model.order_names],
    }  # fmt: skip
    inputs = ", ".join(f"{n} = {quoted(model.input_units.get(n, ''))}" for n in model.inputs)
    head = [f"# Written by fracid {__version__} from {' '.join(run_name.split())}.", "[model]",
            f"name = {quoted(re.sub(r'[^A-Za-z0-9]+', '-', model.name).strip('-') + '-equations')}",
            f"inputs = {{ {inputs} }}"]  # fmt: skip
    parts = ["\n".join([f"[model.{name}]", *lines]) for name, lines in tables.items() if lines]
    return "\n\n".join(["\n".join(head), *parts]) + "\n"


def _order(q: str | float | Complement) -> str:
    return json.dumps(str(q)) if isinstance(q, str | Complement) else repr(float(q))
