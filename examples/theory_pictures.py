"""Draw the two pictures of docs/theory.md: ``python examples/theory_pictures.py`` (some seconds).

``theory-order-as-damping.png``  a swing of order 0.95, the swing of order 1 with the viscous friction that comes
                                 nearest to it, and what lies between them
``theory-raw-sums.png``          what sums of raw x make of a start that is not zero: a relaxation in ever smaller
                                 steps, and the release of a pendulum
"""

import warnings
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import least_squares

import fracid
from fracid.plots.appearance import BLUE, GREEN, ORANGE, VERMILLION
from fracid.solver.solve import PaperSchemeWarning

IMAGES = Path(__file__).parent.parent / "docs" / "images"


def oscillator(t, x, u, p, out):  # noqa: ARG001
    out[0] = x[1]
    out[1] = -(p[0] ** 2) * x[0] - 2 * p[1] * p[0] * x[1]


def relaxation(t, x, u, p, out):  # noqa: ARG001
    out[0] = -x[0]


def swing(order, frequency, damping):
    """A release from 1, 10 s in steps of 2 ms."""
    return fracid.solve_fde(oscillator, order, [1.0, 0.0], parameters=[frequency, damping], step=2e-3, end=10.0)


def order_as_damping():
    """Order 0.95 beside the best swing of order 1."""
    order = 0.95
    fractional = swing(order, 10**order, 0.0)  # 10 rad/s
    found = least_squares(
        lambda p: swing(1.0, *p).states[:, 0] - fractional.states[:, 0],
        [10.0, 0.1],
        x_scale=[10.0, 0.1],
        diff_step=1e-5,
    )
    damped = swing(1.0, *found.x)
    figure = Figure(figsize=(8, 4.2), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    above.plot(fractional.time, fractional.states[:, 0], color="0.6", lw=3, label=f"order {order}, no friction")
    above.plot(damped.time, damped.states[:, 0], color=BLUE, lw=1, label=f"order 1, damping ratio {found.x[1]:.3f}")
    above.set(ylabel="swing", xlim=(0, 6))
    above.legend(frameon=False)
    below.plot(damped.time, fractional.states[:, 0] - damped.states[:, 0], color=VERMILLION, lw=1)
    below.axhline(0, color="0.8", lw=0.8, zorder=0)
    below.set(xlabel="time [s]", ylabel="difference")
    return figure


def raw_sums():
    """A relaxation and a release, by gl-paper and by schemes that converge."""
    figure = Figure(figsize=(8, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    for step, colour in ((1e-2, ORANGE), (1e-3, VERMILLION), (1e-4, GREEN)):
        run = fracid.solve_fde(relaxation, 0.8, [1.0], step=step, end=3.0, method="gl-paper")
        left.plot(run.time, run.states[:, 0], color=colour, lw=1.2, label=f"raw sums, h = {1e3 * step:g} ms")
    run = fracid.solve_fde(relaxation, 0.8, [1.0], step=1e-3, end=3.0)
    left.plot(run.time, run.states[:, 0], color="black", lw=1.6, label="exact")
    left.set(title=r"$D^{0.8}x = -x$, $x(0) = 1$", xlabel="time [s]", ylabel="x", ylim=(0, 1.05), xlim=(0, 3))
    left.legend(frameon=False)
    rig, paper = fracid.rotary_pendulum("srv02-rotpen", zero="hanging"), {"lambda": 0.8623, "mu": 0.9146}
    for method, colour, label in (("gl-paper", VERMILLION, "raw sums"), ("pi2", "black", "second order")):
        run = fracid.simulate(rig, orders=paper, initial={"alpha": np.radians(10)}, step=1e-3, end=1.0, method=method)
        right.plot(run.time, np.degrees(run.states[:, 2]), color=colour, lw=1.4, label=f"{label}, h = 1 ms")
    right.set(title="SRV02, released from 10°", xlabel="time [s]", ylabel="α from hanging [°]", xlim=(0, 1))
    right.legend(frameon=False)
    return figure


def main():
    warnings.simplefilter("ignore", PaperSchemeWarning)  # that it is wrong is what the picture shows
    for name, draw in (("theory-order-as-damping.png", order_as_damping), ("theory-raw-sums.png", raw_sums)):
        draw().savefig(IMAGES / name, dpi=130)
        print(IMAGES / name)


if __name__ == "__main__":
    main()
