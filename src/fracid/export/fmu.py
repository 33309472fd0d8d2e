"""``MODEL.fmu``: the identified model as a unit of co-simulation, for Simulink, Modelica and others.

An archive of C sources (the function of :mod:`fracid.export.c` behind the interface of FMI 2.0 or 3.0), a description
in XML, and a shared library for each platform that a compiler here makes one for.  Nearly every tool reads 2.0, which
also takes slopes of inputs; newer tools read 3.0.  The archive's bytes depend on the model and the compiler alone.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterator, Sequence
from hashlib import sha256
from io import BytesIO
from typing import Literal, NamedTuple
from uuid import UUID

from fracid._version import __version__
from fracid.export.c import c_model
from fracid.export.compilers import PLATFORMS, here, library_of
from fracid.export.identified import Identified, Quantity
from fracid.export.markup import program, xml
from fracid.models.written.equations import dimension
from fracid.safety.door import own_text
from fracid.safety.text import one_line

Version = Literal["2", "3"]


DECLARATION = '<?xml version="1.0" encoding="UTF-8"?>\n'

LOCAL = "FRACID_LOCAL struct parameters"
"""In place of constants: each thread's own, into which the parameters of the instance that steps are put."""

YEAR = (1980, 1, 1, 0, 0, 0)
"""Of every file in the archive: the earliest that it can hold."""


class Variable(NamedTuple):
    """A variable of the description."""

    reference: int
    """Its place among the numbers of a run, ``Variables`` in the C source."""
    quantity: Quantity
    name: str
    causality: str
    variability: str
    initial: str = ""


def variables(model: Identified) -> Iterator[Variable]:
    """Time, inputs, outputs, states, parameters and orders, in the order of their value references.

    Examples
    --------
    >>> variables.__name__
    'variables'
    """
    kinds = (
        ("time", (Quantity("time", "s", 0.0),), "independent", "continuous", ""),
        ("input", model.inputs, "input", "continuous", ""),
        ("output", model.outputs, "output", "continuous", "calculated"),
        ("state", model.states, "local", "continuous", "exact"),
        ("parameter", model.parameters, "parameter", "fixed", "exact"),
        ("order", model.orders, "local", "constant", "exact"),
    )
    taken: set[str] = set()
    begin = 0
    for kind, quantities, *how in kinds:
        for reference, q in enumerate(quantities, begin):
            plain = kind not in ("state", "order") and q.name not in taken
            name = one_line(q.name if plain else f"{kind}.{q.name}")
            taken.add(name)
            yield Variable(reference, q, name, *how)
        begin += max(1, len(quantities))  # C has no arrays of nothing


def sources(model: Identified, version: Version) -> dict[str, str]:
    """The C files: name → content.

    Examples
    --------
    >>> sources.__name__
    'sources'
    """
    texts = c_model(model.tables, model.case, model.run)
    constants = texts["fracid_model.c"]
    if model.parameters:
        constants = constants.replace("static const struct {", f"{LOCAL} {{", 1)
    else:  # a struct of nothing is no C
        first = "#include <string.h>\n"
        constants = constants.replace(first, f"{first}\n{LOCAL} {{ double none; }} p;\n", 1)
    parts = {"fracid_model.c": constants, "fracid_model.h": texts["fracid_model.h"]}
    head, body = own_text("export/fmu.c.in"), own_text(f"export/fmi{version}.c.in")
    digest = sha256("".join([*parts.values(), program(head, model=model, token=""), body]).encode()).digest()
    return parts | {"fmu.c": program(head, model=model, token=f'"{{{UUID(bytes=digest[:16])}}}"') + body}


def description(model: Identified, version: Version, token: str) -> str:
    """``modelDescription.xml``.

    Examples
    --------
    >>> description.__name__
    'description'
    """
    every = [*variables(model)]
    units = {unit: _powers(unit) for unit in sorted({v.quantity.unit for v in every} - {""})}
    about = f"{model.problem.model.name}, identified by fracid {__version__} from {model.run}"
    return DECLARATION + xml("description.xml.in", version=version, two=version == "2", token=token, model=model,
                             about=about, fracid=__version__, units=units, variables=every)  # fmt: skip


def _powers(unit: str) -> dict[str, float] | None:
    """Of a unit in those of the SI; None where one is not whole: the description has its name alone."""
    if "rad" in unit:
        return {"rad": 1.0} if unit == "rad" else None
    powers = dict(zip(("kg", "m", "s", "A", "K", "mol"), dimension(unit) or (), strict=False))
    return None if any(power % 1 for power in powers.values()) else powers or None


def fmu(model: Identified, version: Version = "2", platforms: Sequence[str] = ()) -> tuple[bytes, list[str]]:
    """Make the archive.

    Parameters
    ----------
    model : Identified
    version : str
        Of the interface: ``2`` or ``3``.
    platforms : sequence of str
        Of :data:`fracid.export.compilers.PLATFORMS`; this one if empty.

    Returns
    -------
    bytes, list of str
        The archive, and why a library is missing.

    Raises
    ------
    InputError
        For sources that do not compile.

    Examples
    --------
    >>> list(PLATFORMS)
    ['x86_64-linux', 'aarch64-linux', 'x86_64-windows', 'x86_64-darwin', 'aarch64-darwin']
    """
    texts = sources(model, version)
    token = texts["fmu.c"].partition('#define TOKEN "')[2].partition('"')[0]
    files: dict[str, str | bytes] = {f"sources/{name}": text for name, text in texts.items()}
    files["modelDescription.xml"] = description(model, version, token)
    if version == "3":
        files["sources/buildDescription.xml"] = DECLARATION + xml("build.xml.in", model=model)
    notes = []
    for name in platforms or [here()]:
        if isinstance(library := library_of(texts, "fmu.c", name), str):
            notes.append(library)
        else:
            folder = PLATFORMS[name].folder if version == "2" else name
            files[f"binaries/{folder}/{model.identifier}{PLATFORMS[name].suffix}"] = library
    archive = BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as out:
        for name in sorted(files):
            out.writestr(zipfile.ZipInfo(name, YEAR), files[name], zipfile.ZIP_DEFLATED)
    return archive.getvalue(), notes
