"""``fracid models``: the library, a line for each model, or all of one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from fracid.cli.app import command, echo_json, new_console, say_next, typed
from fracid.cli.app import table as new_table
from fracid.units import GREEK

if TYPE_CHECKING:
    from rich.console import Console

    from fracid.models import Model


@command
def models(
    name: str | None = None,
    json_: bool = False,
) -> None:
    """List the models of the library, with their inputs and outputs.

    Each stands by its name in a project file, fracid init, fracid simulate and fracid.model.
    """
    from fracid.models import MODELS, model

    found = {n: model(n) for n in (MODELS if name is None else [name])}
    if json_:
        echo_json({n: _record(m) for n, m in found.items()})
        return
    _show(new_console(), found, name)
    chosen = name or "cart-pole"
    say_next(new_console(), (typed("simulate", "--model", chosen), "makes a recording of it"),
             (typed("init", "FILE", "--model", chosen), "writes a project for a recording of such a rig"))  # fmt: skip


def _show(console: Console, found: dict[str, Model], name: str | None) -> None:
    if name is None:
        rows = new_table("model", about := "what it is: inputs → outputs", fold=(about,))
        for n, m in found.items():
            sides = (", ".join(GREEK.get(s, s) for s in names) for names in (m.inputs, m.outputs))
            rows.add_row(n, f"{m.about}\n{' → '.join(sides)}")
    else:
        console.print(str(found[name]), markup=False, soft_wrap=True)
        rows = new_table("parameter", "value", "unit", "what it is", fold=("what it is",))
        for p in found[name].parameters:
            rows.add_row(p.name, f"{p.value:g}", p.unit, p.description)
    console.print(rows)


def _record(m: Model) -> dict[str, Any]:
    return {
        "about": m.about, "inputs": {i: m.input_units.get(i, "1") for i in m.inputs},
        "outputs": {o: m.output_unit(o) for o in m.outputs}, "orders": m.order_names, "source": m.source,
        "parameters": {p.name: {"value": p.value, "unit": p.unit, "about": p.description} for p in m.parameters},
    }  # fmt: skip
