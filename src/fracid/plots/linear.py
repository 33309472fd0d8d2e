"""A linear model about a posture: Bode's two plots and the step response of each output.

The fractional model is drawn broad and pale, the integer-order one that stands for it dark and thin over it, and the
band of the recording is shaded.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from fracid.figures import Style
from fracid.plots.appearance import BLUE, FITTED, ORANGE, axis_unit, finish, label, new, note, plain, symbol

FRACTIONAL: dict[str, Any] = {"color": "0.68", "lw": 2.8, "solid_capstyle": "round"}

INTEGER: dict[str, Any] = {**FITTED, "color": BLUE, "lw": 1.0}

GROWN, DIED = 3.0, 6.0
"""Time constants of an unstable pole, and of a swing that dies away, that a step response shows."""


def linear_response(system: Any, posture: str, *, style: str | Style = "screen") -> Figure:
    """Draw magnitude, phase and step response from the first input to each output, about a posture.

    Parameters
    ----------
    system : IntegerModel
        From :func:`fracid.export.state_space.integer_model`.
    posture : str
        A key of its `linear`: ``hanging`` or ``upright``.
    style : str or Style
        ``screen``, ``journal`` or one's own; see :mod:`fracid.figures`.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    KeyError
        If there is no such posture.
    ValueError
        If nothing drives the model.

    Examples
    --------
    >>> import numpy as np, fracid
    >>> from fracid.export.state_space import integer_model
    >>> swing = fracid.Experiment("twin", 2e-3, np.zeros((5000, 2)), np.zeros((1, 1)))
    >>> problem = fracid.Problem(fracid.rotary_pendulum(b_alpha=2e-4), (swing,), {"lambda": 0.9, "mu": 1.0})
    >>> len(linear_response(integer_model(problem), "hanging").axes)
    6
    """
    linear = system.linear[posture]
    if not linear.inputs:
        raise ValueError("Nothing drives the model: it has no response.")
    outputs = linear.outputs
    figure = new(4.2 * len(outputs), 8.2, style)
    panels = figure.subplots(3, len(outputs), squeeze=False)
    low, high = system.operators[0].band
    omega = np.geomspace(low / 2, high, 500)
    responses = ((linear.exact_response(omega), FRACTIONAL, "fractional"),
                 (linear.response(omega), INTEGER, "integer-order"))  # fmt: skip
    time, integer, exact = system.step_response(linear, _duration(system, posture))
    unit = system.model.input_unit(linear.inputs[0])
    unit = "unit" if unit == "1" else unit
    for column, output in enumerate(outputs):
        magnitude, phase, step = panels[:, column]
        for response, line, name in responses:
            h = response[:, column, 0]
            magnitude.semilogx(omega, 20 * np.log10(np.maximum(np.abs(h), 1e-12)), **line, label=name)
            phase.semilogx(omega, np.degrees(np.unwrap(np.angle(h))), **line)
        own = system.units.get(output, system.model.output_unit(output))
        display_unit, factor = axis_unit(own)
        step.plot(time, factor * exact[:, column], **FRACTIONAL)
        step.plot(time, factor * integer[:, column], **INTEGER)
        for axes in (magnitude, phase):
            axes.axvspan(low, high, color=ORANGE, alpha=0.12, lw=0, zorder=0.5, label="band of the recording")
        letter = symbol(output)
        about = f" from {posture}" if output == system.model.pendulum else ""
        label(step, f"step of 1 {unit}", "time [s]", f"{letter}{about} [{display_unit}]")
        across, frequency = f"{plain(linear.inputs[0])} to {letter}", "frequency [rad/s]"
        label(magnitude, across, frequency, f"magnitude [dB re 1 {own}/{unit}]", ticks=None)
        label(phase, "", frequency, "phase [°]", ticks=None)
        if not np.isfinite(exact[:, column]).all():
            note(step, "the fractional model fails here")
    return finish(figure, f"{plain(system.model.name)}, linear about {posture}")


def _duration(system: Any, posture: str) -> Any:
    """Until an unstable pole has grown, or a swing has died; else half of the longest recording [s]."""
    modes = system.linear[posture].modes
    if growing := [m.pole.real for m in modes if m.pole.real > 0]:
        return GROWN / max(growing)
    if swings := [m for m in modes if m.pole.imag > 0]:
        return min(DIED / max(1e-3 * swings[0].frequency, -swings[0].pole.real), 40 * np.pi / swings[0].frequency)
    return np.pi / system.operators[0].band[0]
