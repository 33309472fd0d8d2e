"""``observer.c``: the observer of :mod:`fracid.filtering` as a C99 function, with values to test it by."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import InputError
from fracid.export.c import UNMEASURED, along_recording, c_text, constants_of, input_rows, used_constants
from fracid.filtering import StateObserver
from fracid.models.written.languages import C
from fracid.solver.kalman import FAR

SAMPLES = 50
"""Of the test."""

TOLERANCE = {False: 1e-6, True: 1e-2}
"""Of the test, in double and in single precision; slopes by differences amplify the rounding."""


def c_observer(
    watch: StateObserver, measured: FloatArray, inputs: FloatArray, run: str, *, single: bool = False,
    columns: Sequence[str] = (),
) -> str:  # fmt: skip
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
    columns : sequence of str
        How those of a recording are taken, for the head.

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
    used = {p.name for p, _ in used_constants(model, F.p)}
    if missing := [n for n in watch.slow if n not in used and n not in model.order_names]:
        raise InputError(f"{missing[0]} is in none of the equations that are written: leave it out of slow.")
    y = measured[:SAMPLES]
    lowest, spacing, count = F.rates.tolist()
    kind = "static" if any(n in used for n in watch.slow) else "static const"
    slow = [f"&p.{name(n)}" if n in used else "0" for n in watch.slow]
    text = c_text(
        "observer.c.in", model, single=single, w=watch, F=F, run=run, values=[*model.states, *watch.slow],
        constants=constants_of(model, F.p, kind), constant=[*slow, "0"], spacing=spacing, pi=math.pi, far=FAR,
        before_lowest=lowest * math.exp(-spacing), rate=lowest * np.exp(spacing * np.arange(count + 1)),
        columns=columns, units={n: model.output_unit(n) for n in watch.sensors}, u=input_rows(inputs[: len(y)], len(y)),
        sensor=[list(model.shown).index(n) for n in watch.sensors], tolerance=TOLERANCE[single],
        variance=[watch.noise[n] ** 2 for n in watch.sensors],
        test_y=y, test_values=_values(watch, y, inputs[: len(y)]),
        bounds=np.vstack([np.clip(F.slow[:, 2:5], -1e30, 1e30), np.zeros(3)]).T,
    )  # fmt: skip
    return text.replace("void fracid_output(", "static void fracid_output(")  # the model's own may lie beside


def _values(watch: StateObserver, measured: FloatArray, inputs: FloatArray) -> FloatArray:
    """Estimates, then standard deviations, a row a sample."""
    track = replace(watch).run(measured, inputs)
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
    exact, u = _values(watch, measured, inputs), input_rows(inputs, len(measured))
    found, names = run(measured, u, len(measured), np.zeros_like(exact)), (*watch.model.states, *watch.slow)
    off, deviations = np.abs(found - exact).max(axis=0), exact.mean(axis=0)[len(names) :]
    parts = ", ".join(f"{n} {v:.1g} (of {d:.1g})" for n, v, d in zip(names, off, deviations, strict=False))
    return (f"Over {len(measured):,} samples observer.c is off Python's by at most (of its mean standard deviation) "
            f"{parts}.")  # fmt: skip
