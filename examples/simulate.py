"""Simulate the rotary pendulum, fractional and integer, and see what a scheme makes of it.

    python examples/simulate.py        # prints both tables, draws simulate.png

1. A release from 60°, once with the orders that the paper found and once with ordinary derivatives.  To first order an
   order μ below 1 damps like a viscous friction of the damping ratio ζ = π/2·(1 − μ).
2. The same fractional release by the schemes that fracid has, against one with a step twenty times finer.  The paper's
   own scheme sums raw states, which is right for a start at zero only, and loses degrees; `gl` is its correct form, of
   first order; `pi2`, the default, is of second order.  Theirs are docs/solver.md and docs/memory.md.
"""

import timeit
import warnings
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import fracid
from fracid.solver.solve import PaperSchemeWarning

RIG = fracid.rotary_pendulum("srv02-rotpen", zero="hanging")
PAPER = {"lambda": 0.8623, "mu": 0.9146}
INTEGER = {"lambda": 1.0, "mu": 1.0}
RELEASE = {"alpha": np.radians(60)}  # all other states start at 0
STEP, END = 1e-3, 10.0  # [s]
PNG = Path(__file__).with_suffix(".png")


def release(orders, *, step=STEP, **options):
    """A run has .time [s], shape (n,), .states, shape (n, 4), and .outcome."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PaperSchemeWarning)  # we know, and show it
        return fracid.simulate(RIG, orders=orders, initial=RELEASE, step=step, end=END, **options)


def alpha(run):
    """The pendulum's angle [degrees]."""
    return np.degrees(run.states[:, RIG.outputs["alpha"]])


def damping_ratio(run):
    """From the logarithmic decrement of the swings between 5° and 30°."""
    angle = alpha(run)
    top = np.flatnonzero((angle[1:-1] > angle[:-2]) & (angle[1:-1] >= angle[2:])) + 1
    top = top[(angle[top] > 5) & (angle[top] < 30)]
    decrement = -np.polyfit(np.arange(top.size), np.log(angle[top]), 1)[0]
    return decrement / np.hypot(2 * np.pi, decrement)


def fractional_or_integer():
    runs = {"fractional": release(PAPER), "integer": release(INTEGER)}
    print("release from 60°   λ       μ       after 10 s   damping ratio")
    for (name, run), orders in zip(runs.items(), (PAPER, INTEGER), strict=True):
        swing = f"±{np.ptp(alpha(run)[-1000:]) / 2:.2f}°"
        print(f"{name:17}  {orders['lambda']:<6}  {orders['mu']:<6}  {swing:11}  {damping_ratio(run):.3f}")
    print(f"π/2·(1 − μ) of the fractional one is {np.pi / 2 * (1 - PAPER['mu']):.3f}")
    return runs


def methods():
    """The error of each scheme over time [degrees]."""
    fine = alpha(release(PAPER, step=STEP / 20))[::20]
    errors = {}
    print("\nscheme       largest error   time")
    for name in ("gl-paper", "gl", "pi2"):
        run = release(PAPER, method=name)
        spent = min(timeit.repeat(lambda name=name: release(PAPER, method=name), number=1, repeat=5))
        errors[name] = np.abs(alpha(run) - fine)
        print(f"{name:11}  {errors[name].max():9.2g}°      {1e3 * spent:.1f} ms for {run.time.size - 1:,} steps")
    return errors


def draw(runs, errors):
    figure = Figure(figsize=(8, 6), layout="constrained")
    above, below = figure.subplots(2, sharex=True)
    for (name, run), style in zip(runs.items(), ("-", "--"), strict=True):
        above.plot(run.time, alpha(run), style, lw=1, label=name)
    above.set(ylabel="α [°], 0 = hanging", title="The rotary pendulum, released from 60°")
    for name, error in errors.items():
        below.semilogy(runs["fractional"].time[1:], np.maximum(error[1:], 1e-8), lw=1, label=name)
    below.set(xlabel="time [s]", ylabel="error of α [°]", title=f"What the scheme adds at h = {1e3 * STEP:g} ms")
    for axes in (above, below):
        axes.legend(loc="upper right")
        axes.grid(alpha=0.3)
    figure.savefig(PNG, dpi=120)


def main():
    draw(fractional_or_integer(), methods())
    print(f"\ndrawn: {PNG.name}")


if __name__ == "__main__":
    main()
