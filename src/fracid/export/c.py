"""``fracid_model.c`` and ``.h``: the identified model as a C99 function for real-time targets.

No allocation, no library but ``<math.h>``, all memory in one struct, and the same work at every step (but for Newton's
method, where dry friction asks for it): :mod:`fracid.solver.schemes` with the tables of :mod:`fracid.export.recursion`.

A controller knows its input only when the step ends, so the first steps, which fracid solves together, are solved with
the input of the moment for those to come.  With one such step (orders near 1), or an input that stays while
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
from string import Template

import numpy as np
from numpy.typing import ArrayLike

from fracid._version import __version__
from fracid.arrays import FloatArray
from fracid.export.compilers import here, library_of
from fracid.export.recursion import Case, Recursion
from fracid.export.whole import words_of, written, written_outputs
from fracid.models import Model, Parameter
from fracid.models.written.languages import C
from fracid.problem.simulator import LIMIT
from fracid.safety.door import own_text, write_whole
from fracid.safety.text import one_line
from fracid.solver.schemes import OPEN, SLACK

DIGITS = {"1e-14": "3e-7", "1e-12": "1e-6", "1e-11": "1e-5", "1e-9": "1e-6", "1e-6": "5e-3", "1e-7": "3e-4"}
"""Where iterations end, and steps of differences, in double precision → in single."""

TOKEN = re.compile(r"(?P<comment>/\*.*?\*/)|\b(?P<word>double|fabs|fmax|fmin|pow|sin|sqrt|expm1)\b"
                   r"|(?<![\w.])(?P<number>\d+\.\d*(?:e[+-]?\d+)?|\d+e[+-]?\d+)(?![\w.])", re.DOTALL)  # fmt: skip

HERE = "@right-hand side@"

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
    scheme, exported, model = tables.scheme, tables.exported, tables.model
    third, gl = scheme.family == "pi3", scheme.family == "gl"
    source = "model_gl.c.in" if gl else "model_pi.c.in"
    state = own_text("export/state_gl.h.in" if gl else "export/state_pi.h.in")
    state += own_text("export/state_start.h.in") * (tables.together > 0 and not gl)
    sizes = [] if gl else [("TOGETHER", tables.together), ("CORRECTIONS", len(tables.fit))]
    words = {
        "version": __version__, "run": _comment(run_name), "method": tables.method, "scheme": exported.words,
        "memory": tables.memory, "longest": tables.steps, "hours": _duration(tables.steps * case.step),
        "x0": initialiser(case.past[-1]), "states": len(model.states), "inputs": max(1, len(model.inputs)),
        "derivatives": len(model.states) + len(model.relaxing),
        "state_names": _comment(", ".join(model.states)), "input_names": _comment(", ".join(model.inputs)),
        "outputs": len(model.shown), "output_names": _comment(", ".join(model.shown)),
        "order_values": tables.order_values,
        "step": repr(case.step), "lags": tables.lags, "modes": tables.modes, "limit": repr(LIMIT),
        "inputs_when": "u at the end of the step" + ", for the next" * gl,
        "sizes": _sizes(tables, 4 if single else 8), "more_state": state,
        "more_sizes": "".join(f"#define FRACID_{n} {size}\n" for n, size in sizes),
        "tables": _tables(tables, case, gl), "rhs": HERE, "work": _work(tables),
        "precision": f"In single precision. {_comment(error)}".strip() if single else "In double precision.",
        "predictor": "in a parabola" if third else "in a straight line",
        "extrapolated": "3 * s->f[i] - 3 * s->before[i] + s->earlier[i]" if third else "2 * s->f[i] - s->before[i]",
        "sweeps": 0 if exported.newton else 1, "always": int(third), "slack": repr(SLACK), "open": repr(OPEN),
        "start": "s->n == 0" + f" || (s->corrected && s->n < {tables.together})" * (tables.together > 1),
        "origin": "0" if scheme.raw else "x0[i]", "update": tables.update("c"),
    }  # fmt: skip

    language, write = ("c-single", _single) if single else ("c", _double)
    rhs = "\n".join(f(model, language, words_of(source)) for f in (written, written_outputs))
    return {name: write(own_text(f"export/{file}"), words).replace(HERE, rhs)
            for name, file in (("fracid_model.h", "fracid_model.h.in"), ("fracid_model.c", source))}  # fmt: skip


def error_of_single(tables: Recursion, case: Case) -> str:
    """How far the single-precision function is off the double-precision one along a recording, in a sentence.

    Examples
    --------
    >>> error_of_single.__name__
    'error_of_single'
    """
    runs = []
    width = max(1, case.inputs.shape[1])
    u = np.broadcast_to(case.inputs, (max(len(case.inputs), case.steps + 1), width))[-case.steps - 1 :]
    for single in (False, True):
        run = along_recording(c_model(tables, case, "", single=single), "export/run.c.in", single=single)
        if run is None:
            return UNMEASURED
        out = np.full((case.steps + 1, len(tables.model.states)), np.nan)
        runs.append(run(case.past[-1], u, case.steps, out))
    exact, found = runs
    if not np.all(np.isfinite(found[np.isfinite(exact).all(axis=1)])):
        return f"It leaves its limits along the recording {case.name!r}, where the double-precision function does not."
    off = np.nanmax(np.abs(exact - found), axis=0)
    parts = ", ".join(f"{n} {v:.1g}" for n, v in zip(tables.model.states, off, strict=True))
    return f"Over the {case.steps:,} steps of {case.name!r} it is off the double-precision function by at most {parts}."


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


def _work(tables: Recursion) -> str:
    """Of a step, as it usually is and at worst."""
    S, T, exported = len(tables.orders), tables.together, tables.exported
    memory = S * (tables.lags + 2 * tables.modes + 1)
    usual = f"Work of a step: {memory} multiplications for the memory"
    if tables.scheme.family == "gl":
        return f"{usual} and {S if exported.last_first else 1} right-hand side(s), always."
    start = f"; {50 * T + 2 * S} in each of the first {T}" if T else ""
    often = (
        "Newton's method"
        if exported.newton
        else f"{2 + bool(tables.model.relaxing)} right-hand sides (first 64: 4 more)"
    )
    return (f"{usual} and {often}; where Newton's method is needed at most {12 * (S + 2) + S + 3} right-hand sides and "
            f"13 factorisations of {S} x {S}{start}.")  # fmt: skip


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
    lines = [f"    .{name(p.name)} = {value!r},  /* {_comment(f'[{p.unit}] {p.description}')} */" for p, value in used]
    names = ", ".join(name(p.name) for p, _ in used)
    return "\n".join([f"{kind} struct {{ double {names}; }} p = {{", *lines, "};"] if used else [])


def _double(template: str, words: Mapping[str, object]) -> str:
    return Template(template).substitute(words)


def _single(template: str, words: Mapping[str, object]) -> str:
    """Of doubles floats, of numbers the nearest, of functions those of floats."""

    def token(found: re.Match[str]) -> str:
        if found["number"]:
            return f"{np.float32(found[0])!s}f"
        return found[0] if found["comment"] else "float" if found[0] == "double" else f"{found[0]}f"

    template = re.sub(r"\b\d+e-\d+\b", lambda found: DIGITS.get(found[0], found[0]), template)
    return TOKEN.sub(token, _double(template, words))


def _tables(tables: Recursion, case: Case, gl: bool) -> str:
    """The constants of the model, then those of memory and start."""
    kernels, together = tables.kernels, tables.together
    gain = case.step**tables.orders * tables.time_scale ** (1 - tables.orders)

    values: dict[str, ArrayLike] = tables.rows | {
        "gain": gain, "row": tables.row, "modes": [len(k.decay) for k in kernels],
        "start": [k.start for k in kernels], "forgets": tables.forgets,
        "newest": gain * tables.newest, "ramp": [k.ramp for k in kernels],
        "start_shift": [k.start_shift for k in kernels], "share": tables.share,
        "starting": tables.starting, "errors": tables.errors,
    }  # fmt: skip
    text = own_text("export/tables.c.in")
    text += "" if gl else own_text("export/tables_pi.c.in")
    text += own_text("export/tables_start.c.in") if together else ""
    filled = Template(text).substitute(
        {n: initialiser(v) for n, v in values.items()}, R=len(kernels), L=tables.lags, L1=tables.lags + 1,
        M=tables.modes, E=len(tables.fit), s=together, s1=together + 1,
    )  # fmt: skip
    head = [constants_of(tables.model, case.parameters), *([f"#define KNOTS {len(tables.knots)}"] if together else [])]
    return "\n".join([*head, filled])


def _sizes(tables: Recursion, size: int) -> str:
    """Memory, in words, with so many bytes a number."""
    rows, corrections = len(tables.kernels), len(tables.fit)
    numbers = rows * (2 * tables.lags + 3 * tables.modes + corrections * len(tables.knots)) + len(tables.knots)
    stack = (tables.together * len(tables.orders)) ** 2
    together = f"; the first {tables.together} steps want {size * stack} bytes of stack beside" if stack > 64 else ""
    return f"Tables: about {size * numbers / 1000:.1f} kB of constants; state: sizeof(fracid_state){together}."


def initialiser(values: ArrayLike) -> str:
    """Numbers as C takes them, to the last bit, five a line.

    Examples
    --------
    >>> initialiser([0.1, 2.0])
    '{0.1, 2.0}'
    """
    array = np.asarray(values)
    if array.ndim > 1:
        return "{" + ",\n    ".join(initialiser(part) for part in array) + "}"
    words = [repr(v) for v in array.tolist()]
    return "{" + ",\n    ".join(", ".join(words[i : i + 5]) for i in range(0, len(words), 5)) + "}"


def _duration(seconds: float) -> str:
    """In the unit that people would use.

    Examples
    --------
    >>> _duration(20.0), _duration(1e4)
    ('20 s', '2.8 h')
    """
    for unit, size in (("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * size:
            return f"{seconds / size:.2g} {unit}"
    return f"{seconds:.3g} s"


def _comment(text: str) -> str:
    """On one line, and nothing in it that ends a comment."""
    return one_line(text).replace("*/", "* /").replace("/*", "/ *").replace("\\", "/")
