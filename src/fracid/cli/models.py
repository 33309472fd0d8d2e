"""``fracid models``: the library, a line for each model, or all of one."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from typing import TYPE_CHECKING, Any

from fracid.cli.app import How, command, print_table, say_next, typed
from fracid.units import letter

if TYPE_CHECKING:
    from rich.console import Console

    from fracid.models import Model


@command
def models(name: str | None = None, *, how: How) -> None:
    """List the models of the library, with their inputs and outputs.

    Each stands by its name in a project file, fracid init, fracid simulate and fracid.model.
    """
    from fracid.models import MODELS, model

    found = {n: model(n) for n in (MODELS if name is None else [name])}
    how.answer({n: _record(m) for n, m in found.items()}, partial(_show, found, name))


def _show(found: dict[str, Model], name: str | None, console: Console) -> None:
    if name is None:
        rows = [(n, f"{m.about}\n{_names(m.inputs)} → {_names(m.outputs)}") for n, m in found.items()]
        print_table(console, ("model", about := "what it is: inputs → outputs"), rows, fold=(about,))
    else:
        console.print(str(found[name]), markup=False, soft_wrap=True)
        constants = ((p.name, f"{p.value:g}", p.unit, p.description) for p in found[name].parameters)
        print_table(console, ("parameter", "value", "unit", "what it is"), constants, fold=("what it is",))
    chosen = name or "cart-pole"
    say_next(console, (typed("simulate", "--model", chosen), "makes a recording of it"),
             (typed("init", "FILE", "--model", chosen), "writes a project for a recording of such a rig"))  # fmt: skip


def _names(signals: Iterable[str]) -> str:
    return ", ".join(letter(s) for s in signals)


def _record(m: Model) -> dict[str, Any]:
    return {
        "about": m.about, "inputs": {i: m.input_unit(i) for i in m.inputs},
        "outputs": {o: m.output_unit(o) for o in m.outputs}, "orders": m.order_names, "source": m.source,
        "parameters": {p.name: {"value": p.value, "unit": p.unit, "about": p.description} for p in m.parameters},
    }  # fmt: skip
