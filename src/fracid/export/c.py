"""``fracid_model.c`` and ``.h``: the identified model as a C99 function for real-time targets.

No allocation, no library but ``<math.h>``, all memory in one struct, and the same work at every step (but for Newton's
method, where dry friction asks for it): :mod:`fracid.solver.schemes` with the tables of :mod:`fracid.export.recursion`.

A controller knows its input only when the step ends, so the first steps, which fracid solves together, are solved with
the input of the moment for those to come.  With one such step (orders near 1), or an input that stays or jumps while
they last, that is no difference.

In single precision, for processors without a double unit, the same text has ``float`` and numbers rounded to it, and
iterations end where those digits do.  Of strangers' names nothing reaches the text but as a word or within a comment.
"""

from __future__ import annotations

import ctypes
import re
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fracid.arrays import FloatArray
from fracid.export.compilers import here, library_of
from fracid.export.markup import c_comment, program
from fracid.export.recursion import Case, Recursion
from fracid.export.whole import words_of, written, written_outputs
from fracid.models import Model, Parameter
from fracid.models.written.languages import C
from fracid.models.written.reading import FUNCTIONS
from fracid.safety.door import own_text, write_whole

DIGITS = {"1e-14": "3e-7", "1e-12": "1e-6", "1e-11": "1e-5", "1e-9": "1e-6", "1e-6": "5e-3", "1e-7": "3e-4"}
"""Where iterations end, and steps of differences, in double precision → in single."""

TOKEN = re.compile(rf"(?P<comment>/\*.*?\*/)|\b(?P<word>double|fabs|fmax|fmin|pow|tgamma|{'|'.join(FUNCTIONS)})\b"
                   r"|(?<![\w.])(?P<number>\d+\.\d*(?:e[+-]?\d+)?|\d+e[+-]?\d+)(?![\w.])", re.DOTALL)  # fmt: skip

UNMEASURED = "How far it is off the double-precision function was not measured: no C compiler was found."


def c_model(tables: Recursion, case: Case, run_name: str, *, single: bool = False, error: str = "") -> dict[str, str]:
    """Write the C function for one recording's step, constants and start.

    Parameters
    ----------
    tables : Recursion
    case : Case
        Whose step and constants the function has.
    run_name : str
        For the head of the file.
    single : bool
        In single precision.
    error : str
        How far that is off, for the head of the file.

    Returns
    -------
    dict
        File name → content.

    Raises
    ------
    InputError
        As :func:`fracid.export.whole.written` says.

    Examples
    --------
    >>> import fracid
    >>> swing = fracid.Experiment("twin", 2e-3, np.zeros((500, 2)), np.zeros((1, 1)))
    >>> problem = fracid.Problem(fracid.rotary_pendulum(), (swing,), {"lambda": 0.9, "mu": 0.95}, initial_state="held")
    >>> list(c_model(Recursion.of(problem, problem.start), Case.of(problem, problem.start, swing), "runs/twin"))
    ['fracid_model.h', 'fracid_model.c']
    """
    family = tables.scheme.family
    words = {"t": tables, "case": case, "run": run_name, "error": error, "gl": family == "gl",
             "third": family == "pi3", "constants": constants_of(tables.model, case.parameters)}  # fmt: skip
    source = f"model_{'gl' if family == 'gl' else 'pi'}.c.in"
    return {name: c_text(file, tables.model, single=single, **words)
            for name, file in (("fracid_model.h", "fracid_model.h.in"), ("fracid_model.c", source))}  # fmt: skip


def c_text(template: str, model: Model, *, single: bool, **words: Any) -> str:
    """A template of C with a model's equations and outputs in it.

    Examples
    --------
    >>> c_text.__name__
    'c_text'
    """
    text, taken = own_text(f"export/{template}"), words_of(template)
    text = re.sub(r"\b\d+e-\d+\b", lambda found: DIGITS.get(found[0], found[0]), text) if single else text
    rhs = "\n".join(f(model, "c", taken) for f in (written, written_outputs)) if "rhs" in taken else ""
    text = program(text, rhs=rhs, single=single, **words)
    return single_precision(text) if single else text


def single_precision(text: str) -> str:
    """C in which doubles are floats, numbers the nearest, and functions those of floats.

    Examples
    --------
    >>> single_precision("double y = 0.1 * sin(x[0]);  /* 0.1 */")
    'float y = 0.1f * sinf(x[0]);  /* 0.1 */'
    """

    def as_float(found: re.Match[str]) -> str:
        if found["number"]:
            return f"{np.float32(found[0])!s}f"
        return found[0] if found["comment"] else "float" if found[0] == "double" else f"{found[0]}f"

    return TOKEN.sub(as_float, text)


def error_of_single(tables: Recursion, case: Case) -> str:
    """How far the single-precision function is off the double-precision one along a recording, in a sentence.

    Examples
    --------
    >>> error_of_single.__name__
    'error_of_single'
    """
    runs, sides = [], [input_rows(u, case.steps + 1) for u in case.driven_after]
    for single in (False, True):
        run = along_recording(c_model(tables, case, "", single=single), "export/run.c.in", single=single)
        if run is None:
            return UNMEASURED
        out = np.full((case.steps + 1, len(tables.model.states)), np.nan)
        runs.append(run(case.past[-1], *sides, case.steps, out))
    exact, found = runs
    if not np.all(np.isfinite(found[np.isfinite(exact).all(axis=1)])):
        return f"It leaves its limits along the recording {case.name!r}, where the double-precision function does not."
    off = np.nanmax(np.abs(exact - found), axis=0)
    parts = ", ".join(f"{n} {v:.1g}" for n, v in zip(tables.model.states, off, strict=True))
    return f"Over the {case.steps:,} steps of {case.name!r} it is off the double-precision function by at most {parts}."


def input_rows(inputs: FloatArray, count: int) -> FloatArray:
    """Inputs as a program reads them: a row for each of `count` times; without inputs a column of zeros.

    Examples
    --------
    >>> input_rows(np.zeros((1, 0)), 2).tolist()
    [[0.0], [0.0]]
    """
    wide = inputs if inputs.shape[1] else np.zeros((1, 1))
    return np.broadcast_to(wide, (count, wide.shape[1]))


def along_recording(texts: Mapping[str, str], main: str, *, single: bool) -> Callable[..., FloatArray] | None:
    """The compiled ``run`` of a program, whose last array is returned as it fills it; None without a compiler.

    Examples
    --------
    >>> along_recording.__name__
    'along_recording'
    """
    text, kind = own_text(main), np.dtype("f4" if single else "f8")
    library = library_of({**texts, "run.c": text.replace("double", "float") if single else text}, "run.c", here())
    if isinstance(library, str):
        return None
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "library")
        write_whole(path, library)
        run = ctypes.CDLL(str(path)).run
    run.restype = None

    def call(*arguments: FloatArray | int) -> FloatArray:
        """With arrays in the numbers of the program."""
        given = [ctypes.c_long(a) if isinstance(a, int) else np.ascontiguousarray(a, kind) for a in arguments]
        run(*(a if isinstance(a, ctypes.c_long) else a.ctypes.data_as(ctypes.c_void_p) for a in given))
        return np.asarray(given[-1], np.float64)

    return call


def used_constants(model: Model, values: FloatArray) -> list[tuple[Parameter, float]]:
    """The parameters that the function has, in their order, with their values.

    Examples
    --------
    >>> used_constants.__name__
    'used_constants'
    """
    known = model.program.constants | model.outputs_program.constants
    return [(p, v) for p, v in zip(model.parameters, values.tolist(), strict=True) if p.name in known]


def constants_of(model: Model, values: FloatArray, kind: str = "static const") -> str:
    """The struct ``p`` with the constants of the model; empty where it has none.

    Examples
    --------
    >>> import fracid
    >>> model = fracid.model("pendulum")
    >>> constants_of(model, model.parameter_vector()).splitlines()[0]
    'static const struct { double gravity, J, b_angle, coulomb_angle, slip_speed, drag_angle, angle_rest; } p = {'
    """
    name, used = C(model.program).name, used_constants(model, values)
    lines = [f"    .{name(p.name)} = {value!r},  /* {c_comment(f'[{p.unit}] {p.description}')} */" for p, value in used]
    names = ", ".join(name(p.name) for p, _ in used)
    return "\n".join([f"{kind} struct {{ double {names}; }} p = {{", *lines, "};"] if used else [])
