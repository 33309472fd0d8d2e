"""What would noise and encoder do to my result?  A small study of noise, with the library.

    python examples/noise_study.py      # prints what the intervals are worth, draws noise_study.png

Before an experiment: does a 4096-count encoder on this rig determine the orders, or does it take a better one, or a
release from a larger angle?  A truth is simulated, read by encoders with noise, and identified again and again; then
the estimates can be compared with the truth, and the intervals with the estimates.  `fracid noise runs/NAME` does the
same for the result of a fit, with more repetitions, on all cores.
"""

from pathlib import Path

import numpy as np

import fracid
from fracid import Experiment, Free, Problem

TRUTH = {"lambda": 0.9, "mu": 0.95}
NOISE = (0.05, 0.5)  # standard deviation [degrees]
COUNTS = (4096, 512)  # of an encoder, per turn
REPETITIONS = 12  # 50 or more for a study that is to be believed


def problem(release):
    """Three seconds at 250 Hz after a release; what was measured does not matter, the study puts its own in place."""
    rig = fracid.rotary_pendulum("srv02-rotpen", zero="hanging")
    nothing = np.zeros((751, 2))
    swing = Experiment("release", 4e-3, nothing, np.zeros((1, 1)), initial={"theta": 0.0, "alpha": np.radians(release)})
    orders = {name: Free(1.0, 0.5, 1.2) for name in TRUTH}
    return Problem(rig, (swing,), orders, initial_state="held", substeps=2)


def main():
    for release in (10, 40):
        study = fracid.noise_study(
            problem(release), np.array([*TRUTH.values()]), levels=np.radians(NOISE),
            resolutions=[2 * np.pi / counts for counts in COUNTS], seeds=REPETITIONS, seed=1, jobs=2,
        )  # fmt: skip
        print(f"released from {release}°")
        for cell in study.cells:
            found = "   ".join(
                f"{name} off by {s.bias:+.5f}, spread {s.spread:.5f}" for name, s in cell.unknowns.items()
            )
            print(f"  {cell.label:27} {found}")
        for sentence in study.sentences:
            print(f"  {sentence}")
    study.plot().savefig(Path(__file__).with_suffix(".png"), dpi=120)


if __name__ == "__main__":
    main()
