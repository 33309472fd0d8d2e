"""Make the two twins that fracid ships: simulated recordings of the paper's experiment.

    python examples/make_twins.py            # writes src/fracid/twins/*.csv

A release of the pendulum from α₀ = 10°, hanging, 20 s at 1000 Hz, both angles read by encoders of 4096
counts a turn with Gaussian noise of 0.15° before rounding; SRV02 constants, λ = 0.8623,
μ = 0.9146.  The seed is 20240914.

``paper-twin.csv``      stepped with gl-paper, h = 1 ms: what the paper's own scheme makes of its model
``reference-twin.csv``  a solution ten times finer, pi2 at h = 0.1 ms: what the equations say
"""

import warnings
from pathlib import Path

import numpy as np

import fracid
from fracid.solver.solve import PaperSchemeWarning

SEED = 20240914
ORDERS = {"lambda": 0.8623, "mu": 0.9146}
RELEASE = np.radians(10.0)
COUNTS_PER_TURN = 4096
NOISE = 0.15  # degrees
STEP, END = 1e-3, 20.0
FOLDER = Path(__file__).parent.parent / "src" / "fracid" / "twins"

HEADER = """\
# SIMULATED, not measured: {what}
# rotary inverted pendulum, rig srv02-rotpen, zero = hanging, lambda = 0.8623, mu = 0.9146,
# released at rest from alpha = 10 deg; 4096 counts a turn, Gaussian noise of 0.15 deg, seed {seed}
# made by examples/make_twins.py
time [s],theta [counts],alpha [counts]
"""


def angles(method, refinement):
    """θ and α on the recording's grid [rad], shape (20001, 2)."""
    rig = fracid.rotary_pendulum("srv02-rotpen", zero="hanging")
    run = fracid.simulate(
        rig, orders=ORDERS, initial={"alpha": RELEASE}, step=STEP / refinement, end=END, method=method
    )
    return run.states[::refinement, [0, 2]]


def encoder(signal, rng):
    """Whole counts, as an encoder with noise reads them."""
    noisy = signal + np.radians(NOISE) * rng.standard_normal(signal.shape)
    return np.rint(noisy / (2 * np.pi) * COUNTS_PER_TURN).astype(int)


def twins():
    """File name → its text."""
    rng = np.random.default_rng(SEED)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PaperSchemeWarning)  # that it is wrong is the point of this twin
        paper = encoder(angles("gl-paper", 1), rng)
    reference = encoder(angles("pi2", 10), rng)
    return {
        "paper-twin.csv": as_text(paper, "stepped with gl-paper at h = 1 ms"),
        "reference-twin.csv": as_text(reference, "a reference solution, pi2 at h = 0.1 ms"),
    }


def as_text(counts, what):
    rows = (f"{STEP * k:.3f},{theta},{alpha}\n" for k, (theta, alpha) in enumerate(counts))
    return HEADER.format(what=what, seed=SEED) + "".join(rows)


if __name__ == "__main__":
    for name, text in twins().items():
        (FOLDER / name).write_text(text, encoding="utf-8")
        print(FOLDER / name)
