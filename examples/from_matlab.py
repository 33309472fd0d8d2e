"""From MATLAB or Simulink, and back.

    python examples/from_matlab.py      # writes rig_run.mat as Simulink does, and runs the commands below

A Simulink model with a To Workspace block in the format "Structure With Time" leaves a struct with .time and
.signals(k).values; save('rig_run.mat', 'out') makes a file of it that fracid reads as it is.  From there it is

    fracid check rig_run.mat            # is it worth anything?  What are its columns?
    fracid init  rig_run.mat --out drafted.toml       # a project file that runs as it is: look at every line
    fracid fit   from_matlab.toml       # the drafted one, with what is known of this rig put in
    fracid export runs/from_matlab --to matlab        # results.mat, and model.m, which needs no toolbox

The recording has what such files have: the pendulum's angle in degrees, counted from upright, so that it hangs at 180°;
and a second in which the pendulum is held before it is let go.
"""

import subprocess
import sys
from pathlib import Path

import numpy as np
from scipy.io import loadmat, savemat

import fracid

HERE = Path(__file__).parent
TRUTH = {"lambda": 0.9, "mu": 0.95}
STEP, HELD, END = 2e-3, 1.2, 8.0  # [s]


def simulink(rng):
    """Write what Simulink would: a struct "out" with time and signals, angles in degrees, the pendulum from upright."""
    rig = fracid.rotary_pendulum("srv02-rotpen", zero="hanging")
    run = fracid.simulate(rig, orders=TRUTH, initial={"alpha": np.radians(-50)}, step=STEP / 8, end=END - HELD)
    held = np.repeat(run.states[:1], round(HELD / STEP), axis=0)
    theta, alpha = np.vstack([held, run.states[::8]])[:, [0, 2]].T
    counts = 2 * np.pi / 4096
    noisy = [x + np.radians(0.05) * rng.standard_normal(x.size) for x in (theta, alpha + np.pi)]
    degrees = [np.degrees(counts * np.rint(x / counts))[:, None] for x in noisy]
    signals = np.zeros(2, dtype=[("values", "O"), ("dimensions", "O"), ("label", "O")])
    for k, (label, values) in enumerate(zip(("theta", "alpha"), degrees, strict=True)):
        signals[k] = (values, 1.0, label)
    time = STEP * np.arange(theta.size)[:, None]
    savemat(HERE / "rig_run.mat", {"out": {"time": time, "signals": signals, "blockName": "rig/To Workspace"}})


def run(*command):
    """Type it in a shell."""
    print(f"\n$ fracid {' '.join(command)}", flush=True)
    subprocess.run([sys.executable, "-m", "fracid", *command], cwd=HERE, check=True)


def main():
    simulink(np.random.default_rng(2))
    run("check", "rig_run.mat")
    run("init", "rig_run.mat", "--out", "drafted.toml", "--yes", "--force")
    run("fit", "from_matlab.toml")
    run("export", "runs/from_matlab", "--to", "matlab")

    print("\nWhat MATLAB reads: d = load('runs/from_matlab/export/results.mat')")
    d = loadmat(HERE / "runs" / "from_matlab" / "export" / "results.mat", simplify_cells=True)
    for name, true in TRUTH.items():
        order = d["orders"][name]
        low, high = order["interval95"]
        print(f"d.orders.{name:6} {order['value']:.5f}   95 %: {low:.5f} to {high:.5f}   truth {true:g}")


if __name__ == "__main__":
    main()
