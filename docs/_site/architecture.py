"""The picture of ARCHITECTURE.md, from the imports as they are: ``python docs/_site/architecture.py`` draws it again.

A box is a package, or a file that lies beside them; its area is its lines.  Boxes stand in the rows of
``tests/test_layers.py``, the ground below.  An arrow is an import, drawn where no longer way implies it; all run down.
"""

import importlib.util
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
PICTURE = ROOT / "docs" / "images" / "architecture.svg"

WIDTH, ROW, TALL, GAP = 1180, 92, 52, 14
"""Of the sheet, from row to row, of a box, and between boxes [px]."""

GROUND = 2
"""So many rows at the bottom are what everything uses: their arrows are left out."""


def _layers():
    spec = importlib.util.spec_from_file_location("layers", ROOT / "tests" / "test_layers.py")
    module = importlib.util.module_from_spec(spec)
    sys.path.append(str(ROOT / "tests" / "helpers"))
    spec.loader.exec_module(module)
    sys.path.pop()
    return module


def lines(package, name):
    """Lines of Python in a package or file."""
    path = package / name
    files = path.rglob("*.py") if path.is_dir() else [package / f"{name}.py"]
    return sum(len(file.read_text(encoding="utf-8").splitlines()) for file in files)


def arrows(layers):
    """Package → the packages that it imports and that no other of them leads to."""
    direct = {name: set() for name in layers.ROW}
    for module, others in layers.graph().items():
        if module not in ("", "__main__"):
            direct[layers.first(module)] |= {layers.first(o) for o in others if o} - {layers.first(module)}

    def reach(name):
        return direct[name] | {far for other in direct[name] for far in reach(other)}

    return {n: {o for o in others if not any(o in reach(p) for p in others - {o})} for n, others in direct.items()}


def titles():
    """Package or file → its line in the tree of ARCHITECTURE.md."""
    tree = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8").split("```")[1].split("\n")[2:]
    rows = (line.split(maxsplit=1) for line in tree if line.strip())
    return {name.rstrip("/").removesuffix(".py"): text for name, text in rows}


def drawn():
    """Return the picture as SVG."""
    layers, text_of = _layers(), titles()
    package = layers.PACKAGE
    rows = [sorted(row) for row in reversed(layers.LAYERS)]
    place, parts = {}, []
    for i, row in enumerate(rows):
        wide = min(400, (WIDTH - GAP * (len(row) + 1)) / len(row))
        left = (WIDTH - (wide + GAP) * len(row) + GAP) / 2
        for k, name in enumerate(row):
            place[name] = (left + k * (wide + GAP), 20 + i * ROW, wide)
    ground = set().union(*layers.LAYERS[:GROUND])
    for name, others in sorted(arrows(layers).items()):
        x, y, wide = place[name]
        for other in sorted(others - ground):
            u, v, broad = place[other]
            start, end, bend = x + wide / 2, u + broad / 2, max(30, (v - y - TALL) / 2)
            parts.append(
                f'<path class="arrow" d="M{start:.0f} {y + TALL} C{start:.0f} {y + TALL + bend:.0f} {end:.0f} '
                f'{v - bend:.0f} {end:.0f} {v - 3}" marker-end="url(#head)"/>'
            )
    for name, (x, y, wide) in sorted(place.items()):
        folder = (package / name).is_dir()
        kind = "folder" if folder else "file"
        label = f"{name}/" if folder else f"{name}.py"
        parts.append(
            f'<g class="{kind}"><rect x="{x:.0f}" y="{y}" width="{wide:.0f}" height="{TALL}" rx="4"/>'
            f'<text x="{x + 10:.0f}" y="{y + 21}" class="name">{label}</text>'
        )
        if wide > 240 or len(text_of[name]) < 30:
            parts.append(f'<text x="{x + 10:.0f}" y="{y + 40}" class="title">{text_of[name]}</text>')
        size = f"{lines(package, name) / 1000:.1f}k"
        parts.append(f'<text x="{x + wide - 10:.0f}" y="{y + 21}" class="size">{size}</text></g>')
    style = (
        "text{font-family:system-ui,sans-serif;fill:#1b2733} .name{font-size:15px;font-weight:600}"
        ".title{font-size:11.5px;fill:#44525f} .size{font-size:11.5px;fill:#5b6875;text-anchor:end}"
        ".folder rect{fill:#dce8f3;stroke:#5a7ea3} .file rect{fill:#f2f5f8;stroke:#8a9aab}"
        ".arrow{fill:none;stroke:#6d7f91;stroke-width:1.3} .sheet{fill:#ffffff}"
    )
    height = 20 + ROW * len(rows)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" role="img" '
        'aria-label="The packages of fracid in rows; every arrow, an import, runs down.">'
        f"<style>{style}</style>"
        '<defs><marker id="head" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
        '<path d="M0 0 L8 4 L0 8 z" fill="#6d7f91"/></marker></defs>'
        f'<rect class="sheet" width="{WIDTH}" height="{height}"/>{"".join(parts)}</svg>\n'
    )


if __name__ == "__main__":
    PICTURE.write_text(drawn(), encoding="utf-8")
