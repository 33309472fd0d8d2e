"""A cost of your own: what counts as a good fit, as a function in a file.

    python examples/own_cost.py                # makes own_cost.csv, fits it by three costs
    cd examples
    fracid fit own_cost.toml --trust           # the project says: cost = "own_cost.py:peak_weighted"

A cost takes the time from the start [s], shape (n,), and the residual, measured minus simulated, shape (n, n_outputs)
[rad], and returns one number, the less the better; infinity means "as bad as a run that failed".  fracid knows nothing
else of it, so a search without derivatives finds its minimum, and the interval of a likelihood is not to be had.

Here a controller must catch the pendulum at the tops of its first swings, so errors there count more.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

import fracid
from fracid import Experiment, Free, Problem
from fracid.problem.costs import COSTS, Cost

FADE = 0.3  # [s]


def peak_weighted(time, residual):
    """Root mean square, weighted by exp(-t/0.3 s), and a quarter of the greatest error."""
    weight = np.exp(-time / FADE)[:, None]
    rms = np.sqrt(np.mean(weight * residual**2) / np.mean(weight))
    return rms + 0.25 * np.abs(weight * residual).max()


# --- a recording of which the truth is known, with a flaw ----------------------------------------------------

TRUTH = {"lambda": 0.9, "mu": 0.95}
STEP, END = 4e-3, 6.0  # [s]
CSV = Path(__file__).with_suffix(".csv")
RIG = fracid.rotary_pendulum("srv02-rotpen", zero="hanging")


def record(rng):
    """Write a release from 40°; at 1.5 s somebody bumps the table, and the pendulum swings anew, by some 4°."""
    run = fracid.simulate(RIG, orders=TRUTH, initial={"alpha": np.radians(40)}, step=STEP / 8, end=END)
    time, angles = run.time[::8], run.states[::8, [0, 2]]
    since = np.maximum(time - 1.5, 0.0)[:, None]
    bump = np.radians([0.5, 4.0]) * np.exp(-since / 0.6) * np.sin(11 * since)
    noisy = angles + bump + np.radians(0.05) * rng.standard_normal(angles.shape)
    counts = np.rint(noisy / (2 * np.pi) * 4096)
    columns = np.column_stack([time, counts])
    header = "time [s],theta [counts],alpha [counts]"
    np.savetxt(CSV, columns, fmt=["%.3f", "%d", "%d"], delimiter=",", header=header, comments="")


def problem():
    """What is known, what is free, what counts; own_cost.toml says the same as a project file, with the last cost."""
    encoder = {"unit": "counts", "counts_per_turn": 4096}
    recording = fracid.load_recording(CSV, {name: {"column": name, **encoder} for name in ("theta", "alpha")})
    return Problem(
        RIG,
        (Experiment.of(recording, RIG, ["theta", "alpha"], {"theta": 0.0, "alpha": np.radians(40)}),),
        orders={"lambda": Free(1.0, 0.5, 1.2), "mu": Free(1.0, 0.5, 1.2)},
        initial_state="rest",
        cost_function=Cost("peak_weighted", function=peak_weighted),
    )


def main():
    record(np.random.default_rng(1))
    own = problem()
    print("cost            lambda    mu        truth 0.9, 0.95")
    for cost in (COSTS["rmse"], COSTS["itae"], own.cost_function):
        fit = fracid.identify(replace(own, cost_function=cost), optimiser="nelder-mead")
        print(f"{cost.name:14}  {fit.orders['lambda'].value:.5f}   {fit.orders['mu'].value:.5f}")


if __name__ == "__main__":
    main()
