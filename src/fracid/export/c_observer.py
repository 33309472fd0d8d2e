"""``observer.c``: the observer of :mod:`fracid.filtering` as a C99 function, with values to test it by."""

from __future__ import annotations

import math

import numpy as np

from fracid._version import __version__
from fracid.arrays import FloatArray
from fracid.errors import InputError
from fracid.export.c import (
    HERE,
    UNMEASURED,
    _comment,
    _double,
    _single,
    along_recording,
    constants_of,
    initialiser,
    used_constants,
)
from fracid.export.whole import words_of, written, written_outputs
from fracid.filtering import StateObserver
from fracid.models.written.languages import C
from fracid.safety.door import own_text
from fracid.solver.kalman import FAR

SAMPLES = 50
"""Of the test."""

TOLERANCE = {False: 1e-6, True: 1e-2}
"""Of the test, in double and in single precision; slopes by differences amplify the rounding."""


def c_observer(
    watch: StateObserver, measured: FloatArray, inputs: FloatArray, run: str, *, single: bool = False
) -> str:
    """Write an observer; its test goes through the first samples of a recording.

    Parameters
    ----------
    watch : StateObserver
    measured, inputs : ndarray
        As :meth:`StateObserver.run` takes them.
    run : str
        For the head of the file.
    single : bool
        In single precision.

    Raises
    ------
    InputError
        As :func:`fracid.export.whole.written` says, and for a slow constant that is not in the equations.

    Examples
    --------
    >>> c_observer.__name__
    'c_observer'
    """
    model, F, name = watch.model, watch.start, C(watch.model.program).name
    states, K, U = len(model.states), len(watch.slow), max(1, len(model.inputs))
    used = {p.name for p, _ in used_constants(model, F.p)}
    if missing := [n for n in watch.slow if n not in used and n not in model.order_names]:
        raise InputError(f"{missing[0]} is in none of the equations that are written: leave it out of slow.")
    y = measured[:SAMPLES]
    u, values = np.broadcast_to(inputs, (len(measured), U))[: len(y)], _values(watch, y, inputs[: len(y)])
    lowest, spacing, count = F.rates.tolist()
    constants = [f"&p.{name(n)}" if n in used else "0" for n in watch.slow]
    kind = "static" if any(n in used for n in watch.slow) else "static const"
    N, real = len(F.xi), 4 if single else 8
    words = {
        "version": __version__, "run": _comment(run), "model": _comment(model.name),
        "precision": "in floats" if single else "in doubles",
        "values": _comment(", ".join([*model.states, *watch.slow])), "sensors": _comment(", ".join(watch.sensors)),
        "inputs": _comment(", ".join(model.inputs)) or "none", "period": repr(float(F.h[0]) * watch.substeps),
        "inputs_when": "as they were since the last sample" if watch.held else "those at the sample",
        "size": f"some {real * 2 * N * (N + 2 * states) / 1000:.0f} k", "constants": constants_of(model, F.p, kind),
        "rhs": HERE, "states": states, "modes": len(F.z), "slow": K, "count": len(watch.sensors),
        "outputs": len(model.shown), "width": U, "substeps": watch.substeps, "held": int(watch.held),
        "rates": int(count), "spacing": repr(spacing), "before_lowest": repr(lowest * math.exp(-spacing)),
        "pi": repr(math.pi), "far": repr(FAR), "rate": initialiser(lowest * np.exp(spacing * np.arange(count + 1))),
        "begin": initialiser(F.begin), "z": initialiser(F.z), "a": initialiser(F.a),
        "b": initialiser(F.b), "x_start": initialiser(F.xi),
        "P_start": initialiser(np.diag(F.P)), "order_start": initialiser(F.orders),
        "drive": initialiser(F.drive / F.h[0]), "of": initialiser(F.of),
        "sensor": initialiser([list(model.shown).index(n) for n in watch.sensors]),
        "variance": initialiser([watch.noise[n] ** 2 for n in watch.sensors]),
        "constant": "{" + ", ".join([*constants, "0"]) + "}",
        "samples": len(y), "test_y": initialiser(y).replace("nan", "NAN"), "test_u": initialiser(u),
        "test_values": initialiser(values), "tolerance": repr(TOLERANCE[single]),
    }  # fmt: skip
    for n, column in (("lower", 2), ("upper", 3), ("walk", 4)):
        words[n] = initialiser(np.append(np.clip(F.slow[:, column], -1e30, 1e30), 0.0))
    language, write = ("c-single", _single) if single else ("c", _double)
    rhs = "\n".join(f(model, language, words_of("observer.c.in")) for f in (written, written_outputs))
    rhs = rhs.replace("void fracid_output(", "static void fracid_output(")  # the model's own may lie beside
    return write(own_text("export/observer.c.in"), words).replace(HERE, rhs)


def _values(watch: StateObserver, measured: FloatArray, inputs: FloatArray) -> FloatArray:
    """Estimates, then standard deviations, a row a sample."""
    watch.reset()
    track = watch.run(measured, inputs)
    watch.reset()
    return np.column_stack([*track.states.values(), *track.deviations.values()])


def error_of_observer(
    text: str, watch: StateObserver, measured: FloatArray, inputs: FloatArray, *, single: bool
) -> str:
    """How far the C function is off :class:`StateObserver` along a recording, in a sentence.

    Examples
    --------
    >>> error_of_observer.__name__
    'error_of_observer'
    """
    run = along_recording({"observer.c": text}, "export/observer_run.c.in", single=single)
    if run is None:
        return UNMEASURED
    exact, u = _values(watch, measured, inputs), np.broadcast_to(inputs, (len(measured), max(1, inputs.shape[1])))
    found, names = run(measured, u, len(measured), np.zeros_like(exact)), (*watch.model.states, *watch.slow)
    off, deviations = np.abs(found - exact).max(axis=0), exact.mean(axis=0)[len(names) :]
    parts = ", ".join(f"{n} {v:.1g} (of {d:.1g})" for n, v, d in zip(names, off, deviations, strict=False))
    return (f"Over {len(measured):,} samples observer.c is off Python's by at most (of its mean standard deviation) "
            f"{parts}.")  # fmt: skip
