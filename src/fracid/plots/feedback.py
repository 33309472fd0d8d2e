"""A control loop: the open loop, its margins over the draws, and the motion of the worst of them."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.figure import Figure

from fracid.figures import Style
from fracid.plots.appearance import BLUE, GREEN, INK, ORANGE, VERMILLION, axis_unit, finish, label, new, plain, symbol
from fracid.schemas.feedback import ControlRecord

AROUND = 3.0
"""How far the plane of the open loop reaches."""


def control_loop(control: ControlRecord, *, style: str | Style = "screen") -> Figure:
    """Draw the open loop about −1, the margins of each draw, and outputs and input of the worst.

    Parameters
    ----------
    control : fracid.Control
        Of this session.
    style : str or Style
        ``screen``, ``journal`` or one's own; see :mod:`fracid.figures`.

    Returns
    -------
    matplotlib.figure.Figure
    """
    c, loop, controller = control.conditions, control.loop, control.design.controller
    figure = new(8.4, 6.4, style)
    (plane, scatter), (motion, drive) = figure.subplots(2, 2)
    omega = np.geomspace(1e-4, 1, 2000) * math.pi / c.period
    worst = np.array(list(control.worst.values()))
    for x, colour, name in ((worst, VERMILLION, "worst draw"), (loop.x, BLUE, "fit")):
        at = -np.sum(loop.plant(x).response(omega, c.period) * controller.response(omega), axis=1)
        plane.plot(at.real, at.imag, color=colour, label=name)
    turn = np.linspace(0, 2 * math.pi, 200)
    plane.plot(np.cos(turn), np.sin(turn), color="0.7", lw=0.7)
    plane.plot(-1, 0, "+", color=INK, ms=12)
    plane.set(xlim=(-AROUND, AROUND), ylim=(-AROUND, AROUND), aspect="equal")
    label(plane, "open loop", "real part", "imaginary part")
    finite = [t for t in control.trials if t.gain_margin is not None]
    for holds, colour, name in ((True, BLUE, "holds"), (False, VERMILLION, "falls")):
        if some := [t for t in finite if t.holds == holds]:
            scatter.plot([t.gain_margin for t in some], [t.phase_margin for t in some], "o", ms=3, color=colour,
                         label=name)  # fmt: skip
    label(scatter, f"margins of {len(control.trials)} draws", "gain margin [dB]", "phase margin [°]")
    time, y, u = loop.run(worst, controller, control.seed + control.worst_draw)
    for i, (n, colour) in enumerate(zip(c.outputs, (GREEN, ORANGE, INK, "0.6"), strict=False)):
        unit, factor = axis_unit(c.units[n])
        motion.plot(time, factor * y[:, i], color=colour, label=f"{symbol(n)} [{unit}]")
    label(motion, "motion of the worst draw", "time [s]", f"from {c.place}")
    drive.step(time, u, where="post", color=INK, lw=0.7)
    label(drive, "its input", "time [s]", f"{plain(c.input)} [{c.unit}]")
    held = f"{control.design.held} of {control.design.draws} draws hold"
    return finish(figure, f"{plain(control.model)}, {c.place}: {held}")
