"""The model's equations on the page, with symbols and with the numbers found: MathML, which browsers draw, and LaTeX.

:mod:`fracid.models.written.mathematics` makes them of the right-hand side, ours or a user's.  Of one that has loops
there is each state with its order.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from functools import partial
from typing import Any

from fracid.errors import InputError
from fracid.models import Model
from fracid.models.written.mathematics import Equality, LaTeX, Mathematics, MathML, equalities
from fracid.models.written.tree import Call, Entry, Number
from fracid.report.sentences import digits
from fracid.units import number

LANGUAGES: dict[str, type[Mathematics]] = {"MathML": MathML, "LaTeX": LaTeX}


def equations(model: Model, result: Mapping[str, Any], driven: bool, language: str = "MathML") -> dict[str, str]:
    """The equations by heading, each an element ``<math>``, or LaTeX.

    Parameters
    ----------
    model : Model
    result : mapping
        The content of result.json.
    driven : bool
        Whether a recording has an input: without one its term is left out.
    language : str
        ``MathML`` or ``LaTeX``.

    Returns
    -------
    dict
        ``With symbols`` and ``With the fitted values``; of a right-hand side that has loops ``Its states``.

    Examples
    --------
    >>> import fracid
    >>> rig = fracid.rotary_pendulum(b_alpha=2e-4)
    >>> result = {"orders": {n: {"value": 0.9, "free": True} for n in ("lambda", "mu")},
    ...           "parameters": {p.name: {"value": p.value, "free": False} for p in rig.parameters},
    ...           "recordings": {}}
    >>> found = equations(rig, result, driven=False)
    >>> list(found), "0.0002" in found["With the fitted values"]
    (['With symbols', 'With the fitted values'], True)
    """
    constants, write, lines = _constants(result), LANGUAGES[language], list[Equality]()
    with suppress(InputError):
        lines = equalities(model, {n: e["value"] for n, e in constants.items() if e["free"] or e["value"]}, driven)
    if not lines:
        named = {"x": model.states, "u": model.inputs if driven else ()}
        given = tuple(Entry(array, Number(i)) for array, names in named.items() for i in range(len(names)))
        states = [Equality(Entry("out", Number(i)), Call(f"f{i + 1}", given)) for i in range(len(model.states))]
        return {"Its states": write(model, order=partial(_written, result["orders"])).block(states)}
    found = write(model, partial(_written, constants), partial(_written, result["orders"]))
    return {"With symbols": write(model).block(lines), "With the fitted values": found.block(lines)}


def _constants(result: Mapping[str, Any]) -> dict[str, Any]:
    """By name; what each recording has for itself stands as its symbol."""
    own = {n for r in result["recordings"].values() for n in r["parameters"]}
    return {**result["parameters"], **{n: {"value": None, "free": True} for n in own}}


def _written(estimates: Mapping[str, Any], name: str) -> str | None:
    """Its digits; one that its interval leaves none keeps the first, or the term would say nothing."""
    if (e := estimates.get(name)) is None or e["value"] is None:
        return None
    found = digits(e)
    return found if found.strip("−0.") or not e["value"] else number(e["value"], ".1g")
