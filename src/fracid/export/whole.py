"""A model's right-hand side in another language, held against the one that is solved.

What is written comes from the source of the right-hand side.  Before it leaves, the same tree is evaluated beside the
right-hand side itself, with every constant moved: a file that was changed after it was loaded, or a constant that would
be missing, would make a program that simulates another model.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import InputError
from fracid.findings import Words
from fracid.models import Model
from fracid.models.base import computed
from fracid.models.written.languages import C, JavaScript, Matlab, Python, Writer
from fracid.safety.door import own_text
from fracid.safety.text import one_line

SAYS = Words("export/whole.toml")

LANGUAGES: dict[str, type[Writer]] = {"c": C, "matlab": Matlab, "javascript": JavaScript}

SIZES = (1e-3, 1e-2, 0.1, 1.0, 10.0)
"""Of the states and inputs at which a right-hand side is looked at, each with :data:`POINTS` of them: joints that slide
and joints that hardly move, voltages within a dead zone and beyond a limit."""

POINTS = 10

MOVED = 0.01
"""Part of its value by which a constant is moved; what is 0 becomes as much."""

ROUNDING = 1e-9
"""Part by which the same equations may differ; a constant that is moved changes more, or nothing that counts."""


def written(model: Model, language: str, taken: Sequence[str] = ()) -> str:
    """The right-hand side of a model in ``c``, ``matlab`` or ``javascript``.

    Parameters
    ----------
    model : Model
    language : str
    taken : sequence of str
        Words of the text around it, which none of its functions may be called.

    Raises
    ------
    InputError
        If it cannot be written, or would not be the right-hand side that is solved.

    Examples
    --------
    >>> import fracid
    >>> "p.drag_alpha * fabs(x[3])" in written(fracid.rotary_pendulum(), "c")
    True
    """
    lacking = _lacking(model)
    if lacking is not None:
        what = f"lacks {' and '.join(lacking)}, which it runs with" if lacking else "reads otherwise than it runs"
        raise InputError(SAYS("other-rhs", model=model, what=what))
    zero = f"; {model.pendulum} = 0 is {model.zero}" if model.pendulum and model.zero else ""
    name = one_line(model.name).replace("*/", "* /")
    return LANGUAGES[language](model.program, taken, f"Right-hand side of the model {name}{zero}.").text()


def written_outputs(model: Model, language: str, taken: Sequence[str] = ()) -> str:
    """The outputs of a model as a function, for a text with its equations.

    It is ``fracid_output`` in ``c``, ``modelOutputs`` in ``javascript``.

    Raises
    ------
    InputError
        If one cannot be written, or would not be the output that is fitted.

    Examples
    --------
    >>> import fracid
    >>> "f[0] = x[0] + p.R * flows;" in written_outputs(fracid.model("capacitor"), "c")
    True
    """
    tree, read = model.outputs_program, Python(model.outputs_program).made()

    def solved(t: float, x: FloatArray, u: FloatArray, p: FloatArray, out: FloatArray) -> None:
        out[:] = [x[h] if isinstance(h, int) else h(t, x, u, p) for h in model.shown.values()]

    for place in _places(model):
        if not _same(*(computed(f, *place, count=len(model.shown)) for f in (read, solved))):
            raise InputError(SAYS("other-outputs", model=model))
    writer, taken = LANGUAGES[language], (*taken, "fracid_output")
    if language == "javascript":
        return writer(tree).text().replace("const model", "const modelOutputs", 1)
    return writer(tree, taken, "", "void fracid_output").text(writer(model.program, taken))


def words_of(template: str) -> tuple[str, ...]:
    """All words of a template of this package."""
    return tuple(set(re.findall(r"\w+", own_text(f"export/{template}"))))


def _lacking(model: Model) -> list[str] | None:
    """None where tree and right-hand side compute the same; else the constants that the tree lacks."""
    n, p = len(model.states), model.parameter_vector()
    kept = [*range(n), *(n + i for i in model.relaxing_states)]
    read = replace(model, rhs=Python(model.program).made())
    for x, u, moved in _places(model):
        solved = model.derivatives(x, u, moved)[kept]
        if _same(solved, read.derivatives(x, u, moved)[kept]):
            continue
        lacking = []
        for k, q in enumerate(model.parameters):
            without = model.derivatives(x, u, np.where(np.arange(len(p)) == k, p[k], moved))[kept]
            if q.name not in model.program.constants and not _same(solved, without):
                lacking.append(f"{q.name} = {p[k]:.6g}{'' if q.unit in ('', '1', '-') else f' {q.unit}'}")
        return lacking
    return None


def _places(model: Model) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
    """x, u and p at which a tree is held against its source: small and large, every constant moved."""
    p, random = model.parameter_vector(), np.random.default_rng(1)
    for scale in np.repeat(SIZES, POINTS):
        x, u = (scale * random.standard_normal(n) for n in (len(model.states), max(1, len(model.inputs))))
        yield x, u, np.where(p == 0.0, MOVED, p) * (1.0 + MOVED * random.random(len(p)))


_same = partial(np.allclose, rtol=ROUNDING, atol=1e-15, equal_nan=True)  # or what is left of ones
"""But for roundings, in which NumPy's functions are not those of ``math``."""
