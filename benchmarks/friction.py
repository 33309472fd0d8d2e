"""Draw the pictures of docs/friction.md:  python benchmarks/friction.py [elements] [srv02]

``elements``  the torque of every element over a slow reversal and over the speed, by the functions of
              :mod:`fracid.models.joints` themselves: some seconds
``srv02``     what two models leave of a real release, and its last reversals: the fit of examples/srv02-release.toml
              with orders 1, and that of examples/srv02-presliding.toml.  Some minutes; the recording is read from the
              folder in FRACID_RECORDINGS, else from ../shared/recordings, and nothing is drawn where it is not there
"""

from __future__ import annotations

import itertools
import os
import re
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import fracid
from fracid.arrays import FloatArray
from fracid.estimation.records import RecordingFit
from fracid.models.base import RightHandSide
from fracid.models.joints import gap, presliding, saturated, sliding, springpot, stribeck
from fracid.plots.appearance import BLUE, FITTED, GREEN, MEASURED, SMALL, VERMILLION, line
from fracid.plots.writing import save

ROOT = Path(__file__).parent.parent
IMAGES = ROOT / "docs" / "images"
RECORDINGS = Path(os.environ.get("FRACID_RECORDINGS", ROOT.parent / "shared" / "recordings"))
ARM = {"f": 0.031, "s": 0.055, "v_st": 0.038, "delta": 7.3e-3, "b": 0.11}
"""Of a real SRV02's arm [SI], about."""
SLIP = 0.02
"""The default slip_speed [rad/s]."""
COUNT = 360 / 4096
"""The encoder's step [°]."""
HALF = 400
"""Samples of a half-swing."""
SWINGS = (1, -1, 1, -1, 1, -1, 1, -1, 1)
"""Where a motion turns, time and again [°]."""
LOOP = slice(HALF, 3 * HALF + 1)
"""One of its swings."""
WIDE, HIGH = 7.6, 2.6
"""Of a figure [inch]: a page's width."""


# --- elements ---------------------------------------------------------------------------------------------------


def reversal(period: float, turns: Sequence[float]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Time [s], angle and rate [rad, rad/s] of a motion from 0 that turns at these angles [°], of half-cosines."""
    ends = np.radians([0.0, *turns])
    part = (1 - np.cos(np.linspace(0.0, np.pi, HALF + 1)[:-1])) / 2
    angle = np.concatenate([a + (b - a) * part for a, b in itertools.pairwise(ends)])
    time = np.arange(angle.size) * period / 2 / HALF
    return time, angle, np.gradient(angle, time)


def bristle(t: float, x: FloatArray, u: FloatArray, p: FloatArray, out: FloatArray) -> None:  # noqa: ARG001
    """The right-hand side of a presliding joint whose rate is the input."""
    presliding(x, out, 0, u[0], p[0], p[1], p[2], p[3])


def fading(t: float, x: FloatArray, u: FloatArray, p: FloatArray, out: FloatArray) -> None:  # noqa: ARG001
    """The right-hand side of a springpot whose rate is the input."""
    springpot(x, out, 0, u[0], p[0])


def driven(rhs: RightHandSide, order: float, rate: FloatArray, step: float, parameters: list[float]) -> FloatArray:
    """The state of an element whose rate is prescribed."""
    run = fracid.solve_fde(
        rhs, order, [0.0], step=step, end=step * (rate.size - 1), inputs=rate, parameters=parameters,
        relaxing=(0,) if rhs is bristle else (),
    )  # fmt: skip
    return run.states[:, 0]


def giving_torque(turns: Sequence[float], s: float) -> tuple[FloatArray, FloatArray]:
    """Angle [rad] and torque [N m] of presliding friction like the arm's, moved slowly."""
    time, angle, rate = reversal(20.0, turns)
    p = [ARM["f"], s, ARM["v_st"], ARM["delta"]]
    z, out = driven(bristle, 1.0, rate, time[1], p), np.zeros(1)
    return angle, np.array([presliding(z[[k]], out, 0, rate[k], *p) for k in range(z.size)])


def panels() -> tuple[Figure, Axes, Axes]:
    """Torque over angle, and over speed."""
    figure = Figure(figsize=(WIDE, HIGH), layout="constrained", facecolor="white")
    left, right = figure.subplots(1, 2)
    left.set(xlabel="angle [°]", ylabel="torque [mN m]", title="slow reversal")
    right.set(xlabel="speed [rad/s]", ylabel="torque [mN m]", title="steady speed")
    return figure, left, right


def dress(*axes: Axes, legend: str = "best") -> None:
    """One look for all."""
    for panel in axes:
        panel.spines[["top", "right"]].set_visible(False)
        panel.grid(color="0.9", lw=0.6)
        panel.set_axisbelow(True)
        panel.tick_params(labelsize=SMALL)
        if panel.get_xscale() == "linear":
            panel.locator_params(axis="x", nbins=7)
        panel.title.set_fontsize(SMALL + 1.5)
        panel.xaxis.label.set_fontsize(SMALL + 1)
        panel.yaxis.label.set_fontsize(SMALL + 1)
        if panel.get_legend_handles_labels()[0]:
            panel.legend(frameon=False, fontsize=SMALL, loc=legend, handlelength=1.6)


def viscous() -> Figure:
    """Viscous friction and drag."""
    figure, left, right = panels()
    _, angle, rate = reversal(2.0, SWINGS)
    speed = np.linspace(-8, 8, 401)
    for colour, label, torque in (
        (BLUE, "viscous, b = 0.11 N m s/rad", lambda v: ARM["b"] * v),
        (VERMILLION, "drag, d = 0.03 N m s²/rad²", lambda v: 0.03 * v * np.abs(v)),
    ):
        left.plot(np.degrees(angle[LOOP]), 1e3 * torque(rate[LOOP]), color=colour, label=label)
        right.plot(speed, 1e3 * torque(speed), color=colour)
    left.set_title("reversal, ±1° in 2 s")
    left.set_ylim(-6.5, 10.5)
    dress(left, right, legend="upper left")
    return figure


def coulomb() -> Figure:
    """Sliding friction, smooth at rest, with and without Stribeck's curve."""
    figure, left, right = panels()
    speed = np.linspace(-0.25, 0.25, 1001)
    for colour, label, s in ((BLUE, "Coulomb", 0.0), (VERMILLION, "Stribeck", ARM["s"])):
        for period, dashes, said in ((10.0, (3, 2), "10 s"), (1.0, (), "1 s")):
            _, angle, rate = reversal(period, SWINGS)
            torque = [sliding(v, ARM["f"], s, ARM["v_st"], SLIP) for v in rate[LOOP]]
            left.plot(np.degrees(angle[LOOP]), 1e3 * np.array(torque), color=colour, dashes=dashes or (None, None),
                      label=f"{label}, ±1° in {said}")  # fmt: skip
        right.plot(speed, [1e3 * sliding(v, ARM["f"], s, ARM["v_st"], SLIP) for v in speed], color=colour)
    left.set_title("reversal")
    left.set_ylim(-65, 150)
    dress(left, right, legend="upper center")
    left.get_legend().set(ncols=2)
    return figure


def giving() -> Figure:
    """Presliding: Dahl's model and LuGre's."""
    figure, left, right = panels()
    speed = np.linspace(-0.25, 0.25, 1001)
    path = (1.5, -1.5, 1.5, -1.5, 0.0, -0.4, 0.0, -0.4, 0.0)
    for colour, label, s in ((BLUE, "Dahl (s = 0)", 0.0), (VERMILLION, "LuGre", ARM["s"])):
        angle, torque = giving_torque(path, s)
        left.plot(np.degrees(angle), 1e3 * torque, color=colour, label=label)
        curve = np.sign(speed) * [stribeck(v, ARM["f"], s, ARM["v_st"]) for v in speed]
        right.plot(speed, 1e3 * curve, color=colour)
    left.set_ylim(-95, 135)
    dress(left, right, legend="upper left")
    left.get_legend().set(ncols=2)
    return figure


def between() -> Figure:
    """A springpot of three orders."""
    figure, left, right = panels()
    time, angle, rate = reversal(10.0, SWINGS)
    ω = np.geomspace(0.1, 100, 50)
    for colour, ν in ((BLUE, 0.1), (GREEN, 0.5), (VERMILLION, 0.9)):
        torque = driven(fading, 1 - ν, rate, time[1], [1.0])
        left.plot(np.degrees(angle[-2 * HALF :]), 1e3 * torque[-2 * HALF :], color=colour, label=f"ν = {ν}")
        right.loglog(ω, 1e3 * np.radians(1.0) * ω**ν, color=colour)
    left.set_title("reversal, ±1° in 10 s, c = 1 N m s$^ν$/rad")
    right.set(title="swings of ±1°", xlabel="frequency [rad/s]", ylabel="largest torque [mN m]")
    left.set_ylim(-19, 30)
    dress(left, right, legend="upper center")
    left.get_legend().set(ncols=3)
    return figure


def springs() -> Figure:
    """What does not depend on the speed: cable, play and elastic arm; and the motor's corners."""
    figure, left, right = panels()
    angle = np.radians(np.linspace(-3, 3, 601))
    for colour, label, torque in (
        (GREEN, "cable, k = 0.05 N m/rad", 0.05 * angle),
        (VERMILLION, "play of ±1°, k$_a$ = 2 N m/rad", [2.0 * gap(q, np.radians(1.0)) for q in angle]),
        (BLUE, "elastic arm, k$_a$ = 2 N m/rad", 2.0 * angle),
    ):
        left.plot(np.degrees(angle), 1e3 * np.asarray(torque), color=colour, label=label)
    left.set(title="springs, at any speed", xlabel="angle, or twist [°]", ylim=(-115, 190))
    volts = np.linspace(-12, 12, 601)
    right.plot(volts, volts, color="0.7", lw=1, label="without")
    right.plot(volts, [saturated(gap(u, 0.8), 8.0) for u in volts], color=BLUE,
               label="dead zone 0.8 V,\nsaturation 8 V")  # fmt: skip
    right.set(title="the motor", xlabel="voltage [V]", ylabel="voltage that acts [V]")
    dress(left, right, legend="upper left")
    return figure


ELEMENTS: Mapping[str, Callable[[], Figure]] = {
    "viscous": viscous, "sliding": coulomb, "presliding": giving, "springpot": between, "springs": springs,
}  # fmt: skip


# --- the SRV02 ---------------------------------------------------------------------------------------------------

MODELS = {
    "tanh": ("srv02-release.toml", "tanh, drag and cable spring"),
    "presliding": ("srv02-presliding.toml", "presliding in both joints"),
}
"""Picture → its example, and what the model's friction is."""
ANGLES = {"theta": "arm θ", "alpha": "pendulum α"}
LAST = {"theta": (20.0, 36.0), "alpha": (38.0, 44.85)}
"""Where the angles turn for the last times [s]."""


def release(example: str) -> RecordingFit:
    """The release from 92° as an example's project fits it, with orders 1 and nothing held out."""
    text = (ROOT / "examples" / example).read_text(encoding="utf-8")
    held_out = text.index("[[recording]]", text.index("[[recording]]") + 1)
    text = text[:held_out] + text[text.index("[fit]") :]
    text = re.sub(r"^(lambda|mu) .*", r"\1 = 1.0", text, flags=re.MULTILINE)
    file = next(RECORDINGS.rglob("release_92deg.mat"))
    text = re.sub(r"^file .*", f'file = "{file.as_posix()}"', text, flags=re.MULTILINE)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / example
        path.write_text(text, encoding="utf-8")
        fit = fracid.identify(fracid.load_project(path), jobs=2)
    (recording,) = fit.recordings.values()
    return recording


def residual(recording: RecordingFit, friction: str) -> Figure:
    """What is left of both angles, in steps of the encoder."""
    figure = Figure(figsize=(WIDE, 1.6 * HIGH), layout="constrained", facecolor="white")
    for axes, (name, title) in zip(figure.subplots(2, 1, sharex=True), ANGLES.items(), strict=True):
        rest = np.degrees(recording.measured[name] - recording.fitted[name]) / COUNT
        axes.axhspan(-0.5, 0.5, color="0.85", lw=0)
        line(axes, recording.time, rest, color=BLUE, lw=0.7)
        axes.set(ylabel="residual [steps]", ylim=(-13, 13),
                 title=f"{title}, {friction}: RMSE {np.degrees(recording.rmse[name]):.3f}°")  # fmt: skip
    axes.set(xlabel="time [s]", xlim=(recording.begin, recording.end))
    dress(*figure.axes)
    return figure


def last_swings(recording: RecordingFit, friction: str) -> Figure:
    """The last reversals of both angles, measured and fitted."""
    figure = Figure(figsize=(WIDE, 1.7 * HIGH), layout="constrained", facecolor="white")
    for axes, (name, title) in zip(figure.subplots(2, 1), ANGLES.items(), strict=True):
        shown = (recording.time >= LAST[name][0]) & (recording.time <= LAST[name][1])
        measured, fitted = (np.degrees(signal[name][shown]) for signal in (recording.measured, recording.fitted))
        axes.plot(recording.time[shown], measured, **MEASURED, label="measured")
        axes.plot(recording.time[shown], fitted, **FITTED, label="fitted")
        low, high = measured.min(), measured.max()
        axes.set(ylabel="angle [°]", title=f"{title}, {friction}", xlim=LAST[name], ylim=(low - 0.35, high + 0.35))
    axes.set(xlabel="time [s]")
    dress(*figure.axes, legend="upper right")
    for axes in figure.axes:
        axes.get_legend().set(ncols=2)
    return figure


def main(wanted: list[str]) -> None:
    """Draw the elements, the rig's four pictures, or both."""
    figures = {name: draw() for name, draw in ELEMENTS.items() if "elements" in wanted}
    if "srv02" in wanted and not any(RECORDINGS.rglob("release_92deg.mat")):
        print(f"The SRV02: no release_92deg.mat in {RECORDINGS}; say where with FRACID_RECORDINGS=FOLDER")
    elif "srv02" in wanted:
        for name, (example, friction) in MODELS.items():
            recording = release(example)
            figures[f"srv02-{name}"] = residual(recording, friction)
            figures[f"srv02-{name}-end"] = last_swings(recording, friction)
    for name, figure in figures.items():
        (path,) = save(figure, IMAGES, f"friction-{name}", ("svg",))
        print(f"{path.name}  {path.stat().st_size / 1024:.0f} kB")


if __name__ == "__main__":
    main(sys.argv[1:] or ["elements", "srv02"])
