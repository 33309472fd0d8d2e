"""The README's moving picture, from a run: both angles measured and fitted, and the rig that swings with them.

    fracid simulate srv02-rotpen --friction --initial alpha=60deg --hold 1 --end 7 --step 4ms --noise 0.05deg \\
        --counts 4096 --to release.csv
    fracid init release.csv && fracid fit release.toml --out runs/release
    python docs/_site/moving_picture.py runs/release docs/images/release-moving.gif

The measured rig is drawn wide and pale, the fitted one thin and dark on it.  Real time at 12.5 frames a second: a GIF
holds whole hundredths of a second a frame.
"""

import sys

import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.figure import Figure

import fracid

FRAME = 0.08  # [s]
MEASURED, FITTED = {"color": "#9ecae1", "lw": 5.0}, {"color": "#08306b", "lw": 1.4}
ANGLES = (("theta", "θ", "arm from above"), ("alpha", "α", "pendulum"))


def picture(folder: str, target: str) -> None:
    """Draw the first recording of the run in a folder."""
    recording = next(iter(fracid.load_run(folder).recordings.values()))
    time = recording.time
    figure = Figure(figsize=(7.2, 3.2), dpi=80, layout="constrained")
    axes = figure.subplots(2, 2, width_ratios=(1, 3.2))
    curves, rods = [], []
    for row, (name, letter, view) in enumerate(ANGLES):
        rig, plot = axes[row]
        rig.set(xlim=(-1, 1), ylim=(-1.1, 0.15), aspect="equal", xticks=[], yticks=[])
        rig.set_title(view, fontsize=8)
        rig.set_frame_on(False)
        for values, look in ((recording.measured[name], MEASURED), (recording.fitted[name], FITTED)):
            degrees = np.degrees(values)
            plot.plot(time, degrees, alpha=0.0)  # the whole range, from the first frame on
            (curve,) = plot.plot([], [], **look)
            (rod,) = rig.plot([], [], marker="o", markevery=[0], markersize=4, solid_capstyle="round", **look)
            curves.append((curve, degrees))
            rods.append((rod, values))
        plot.set_ylabel(f"{letter} [°]")
        plot.spines[["top", "right"]].set_visible(False)
    axes[0, 1].set_xticklabels([])
    axes[1, 1].set_xlabel("time [s]")
    axes[0, 1].legend([curves[0][0], curves[1][0]], ["measured", "fitted"], frameon=False, ncols=2, loc="upper right")

    def draw(now: float) -> None:
        i = int(np.searchsorted(time, now, side="right"))
        for curve, degrees in curves:
            curve.set_data(time[:i], degrees[:i])
        for rod, values in rods:
            angle = values[max(i - 1, 0)]
            rod.set_data([0.0, np.sin(angle)], [0.0, -np.cos(angle)])

    frames = np.arange(time[0], time[-1] + FRAME, FRAME)
    FuncAnimation(figure, draw, frames=frames, blit=False).save(target, writer=PillowWriter(fps=1 / FRAME))


if __name__ == "__main__":
    picture(*sys.argv[1:])
