"""What each model of the library has: constants with symbols and units, outputs, ladder and source, from itself.

They take the place of the lines ``<!-- all of NAME -->`` in models/NAME.md, each time the site is built.
"""

import re

PLACE = re.compile(r"<!-- all of ([a-z-]+) -->")


def all_of(name):
    """Return the table of a model's constants, and what else it says of itself, as Markdown."""
    import fracid
    from fracid.models.friction import RUNGS

    model = fracid.model(name)
    rungs = {p: kind.rung for p, kind in model.friction.items()}
    outputs = ", ".join(f"{output} [{model.output_unit(output)}]" for output in model.outputs)
    climbed = " → ".join(rung for rung in RUNGS if rung in rungs.values())
    rows = [_row(p, rungs.get(p.name, "")) for p in model.parameters]
    return "\n".join([
        f"**Outputs**: {outputs}. **Orders**: {', '.join(sorted(set(model.order_names)))}."
        + (f" **Ladder** of `fracid compare`: {climbed}." if climbed else ""),
        "",
        "| | constant | twin's value | unit | what it is | rung |",
        "|---|---|---:|---|---|---|",
        *rows,
        "",
        f"*Source*: {model.source}",
    ])  # fmt: skip


def _row(parameter, rung):
    base, index = parameter.symbol or ("", "")
    symbol = f"${base}_{{{index}}}$" if index else f"${base}$" if base else ""
    cells = (symbol, f"`{parameter.name}`", f"{parameter.value:g}", parameter.unit, parameter.description, rung)
    return "| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |"


def _read(app, _page, source):
    if PLACE.search(source[0]):
        app.env.note_reread()
        source[0] = PLACE.sub(lambda found: all_of(found[1]), source[0])


def setup(app):
    """Fill the page when it is read."""
    app.connect("source-read", _read)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
