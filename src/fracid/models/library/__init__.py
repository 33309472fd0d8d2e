"""The library: a model is one file of equations in this folder, as a project file has them.

Above stand ``about``, ``source``, one line for lists and where the equations come from, ``needs``, the columns without
which a recording is of something else, ``moves``, those of them that are found by how they move where another column is
left, ``geared``, an output and one that may be behind a gear of it, and ``[columns]``, how those of recordings are
called (:mod:`fracid.problem.roles`); ``[beside]``, constants that a log says beside its samples, and ``[with.SIGNAL]``,
what a draft of a recording with that signal is like (:mod:`fracid.problem.model_draft`).  For the page that opens a
recording, ``[without]`` is what is fixed where an output is missing, ``span`` the factor within which constants are
sought, and ``rigs = true`` says that the rigs of ``rigs.toml`` are of this model.  ``[twin]`` below is what ``fracid
simulate --model`` simulates, with inputs as functions of t.  ``[model]`` is a project's; what it has beside is

==================  ===========================================================================================
``angle``           the output that is 0 where the pendulum hangs, or with ``zero = "upright"`` where it stands; in
                    equations ``hanging`` is 1 or −1 then
``input_rates``     input → the input of which it is the rate
``input_defaults``  input → its value where others are recorded and it is not
``integer_orders``  order → its value in the integer-order model, where that is not 1
of a parameter      ``about``, ``symbol`` (``"J_θ"``), ``needs``, ``known = true`` for what is measured beforehand,
                    ``gauge = true`` for what must be, where nothing of its unit drives the model, ``scales`` for
                    the input that a gain makes into that unit, ``rung`` of the ladder,
                    ``corner = true`` for what linear models are without, ``between``, bounds that do not follow from
                    a value, and ``free``, ``"always"``, ``"driven"`` or ``"undriven"``, where the rest of the row
                    does not say it
``symbols`` …       input or definition → how it is printed, and ``drive``, ``seen_in``, ``paper`` of a model
of an equation      ``symbol``, ``only``, ``follows``, ``forgets``, ``size``, ``name``, ``note``:
                    :class:`fracid.models.written.equations.Equation`
==================  ===========================================================================================
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import InputError
from fracid.models.base import ZEROS, Model, Parameter, symbol_of
from fracid.models.written.equations import Equations, equations_in
from fracid.models.written.formulas import Formula, formula
from fracid.models.written.tree import Function, Name, Return
from fracid.safety.door import own_text

FIELDS = ("input_rates", "input_defaults", "integer_orders", "drive", "seen_in", "paper")
"""Of :class:`Model`, as a file has them."""


@cache
def table_of(name: str) -> Mapping[str, Any]:
    """The file of a model, as TOML has it; the rotary pendulum's stands beside its module, in ``models``.

    Examples
    --------
    >>> table_of("pendulum")["model"]["inputs"]
    {'torque': 'N m'}
    """
    folder = "models/library" if name in MODEL else "models"
    return tomllib.loads(own_text(f"{folder}/{name}.toml"))


def from_library(name: str, *, zero: str | None = None, **parameters: float) -> Model:
    """Make a model of the library.

    Parameters
    ----------
    name : str
    zero : str, optional
        Of one with a pendulum: ``hanging``, or ``upright``.
    **parameters
        That replace the file's own [SI].

    Raises
    ------
    InputError
        For an unknown parameter, an impossible value, or a zero that means nothing.

    Examples
    --------
    >>> from_library("pendulum", zero="upright", b_angle=0.01).zero
    'upright'
    """
    return model_of_table(name, table_of(name), zero, __name__).with_parameters(**parameters)


def model_of_table(name: str, table: Mapping[str, Any], zero: str | None = None, module: str = "") -> Model:
    """Make a model of what its file says.

    Parameters
    ----------
    name : str
    table : mapping
        As the module's first screen has it.
    zero, module
        As of :func:`from_library` and :class:`fracid.models.written.equations.Equations`.
    """
    spec, angle = table["model"], table["model"].get("angle", "")
    if zero is not None and (not angle or zero not in ZEROS[:2]):
        expected = "'hanging' or 'upright'" if angle else "none: the model has no pendulum"
        raise InputError(f"zero = {zero!r} is not possible for {name}; expected {expected}.")
    zero = (zero or "hanging") if angle else ""
    written = Equations(
        equations_in(spec["equations"]), equations_in(spec["outputs"]), spec["inputs"],
        equations_in(spec.get("definitions", {})),
        numbers={"hanging": 1.0 if zero == "hanging" else -1.0} if angle else {}, scene=spec.get("scene", {}),
        module=module,
    )  # fmt: skip
    model = written.model(name, (Parameter.of(n, row) for n, row in spec["parameters"].items()))
    return replace(
        model, zero=zero, pendulum=angle, about=table["about"], source=table["source"],
        symbols={**model.symbols, **{n: symbol_of(text) for n, text in spec.get("symbols", {}).items()}},
        **{n: spec[n] for n in FIELDS if n in spec},
    )  # fmt: skip


def inputs_of(name: str, time: FloatArray) -> dict[str, FloatArray]:
    """The inputs of a model's twin, shape (n,) each.

    Examples
    --------
    >>> import numpy as np
    >>> {n: u.round(3).tolist() for n, u in inputs_of("relaxation", np.array([0.0, 0.5, 1.0, 1.5])).items()}
    {'stretch': [0.0, 0.01, 0.02, 0.02]}
    """
    texts = table_of(name)["twin"].get("inputs", {})
    trees = {n: Function(n, ("t",), (Return(formula(text, {"t": Name("t")})),)) for n, text in texts.items()}
    return {n: np.array([*map(Formula(tree).py_func, time.tolist())], np.float64) for n, tree in trees.items()}


MODEL = {file.stem: partial(from_library, file.stem) for file in sorted(Path(__file__).parent.glob("*.toml"))}
"""By the name that a project file gives it."""
