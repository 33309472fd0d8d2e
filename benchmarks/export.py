"""What the exported programs cost, and how far they are from fracid:  python benchmarks/export.py

The paper's release from 10°, orders 0.8623 and 0.9146, and the same driven: 20,000 steps of 1 ms.  Times are processor
times, for other programs do not count in these; Octave and gcc are used where they are installed.
"""

from __future__ import annotations

import itertools
import shutil
import subprocess
import tempfile
from functools import partial
from pathlib import Path

import numpy as np
from scipy.io import loadmat, savemat

import fracid
from fracid.export import HOURS
from fracid.export.c import c_model
from fracid.export.matlab import matlab_model
from fracid.export.recursion import Case, Recursion
from fracid.export.state_space import DECIBEL, DEGREES, Operator, follows, integer_model, positive_sum

STEPS, H = 20_000, 1e-3

MAIN = """
#include <stdio.h>
#include <time.h>
#include "fracid_model.h"
static fracid_state s;
static double u[STEPS + 1][FRACID_INPUTS], x[STEPS + 1][FRACID_STATES];
int main(void)
{
    double best = 1e9;
    if (fread(x[0], sizeof x[0], 1, stdin) != 1 || fread(u, sizeof u, 1, stdin) != 1) return 2;
    for (int run = 0; run < 30; run++) {
        clock_t begin = clock();
        fracid_init(&s, x[0], u[0]);
        for (int n = 1; n <= STEPS; n++) if (fracid_step(&s, u[n], x[n])) return 3;
        double took = (double)(clock() - begin) / CLOCKS_PER_SEC;
        if (took < best) best = took;
    }
    fprintf(stderr, "%.0f ns a step, state of %zu bytes", 1e9 * best / STEPS, sizeof s);
    fwrite(x, sizeof x, 1, stdout);
    return 0;
}
"""


def problem(driven: bool) -> fracid.Problem:
    """The paper's release, or a chirp from rest."""
    t = H * np.arange(STEPS + 1)
    u = 2 * np.cos(2 * np.pi * (0.5 + 0.1 * t) * t)[:, None] if driven else np.zeros((1, 1))
    swing = fracid.Experiment(
        "twin", H, np.zeros((STEPS + 1, 2)), u, initial={"alpha": 0.0 if driven else np.radians(10)}
    )
    rig = fracid.rotary_pendulum("srv02-rotpen", b_theta=1e-3, b_alpha=2e-4)
    return fracid.Problem(rig, (swing,), {"lambda": 0.8623, "mu": 0.9146}, initial_state="held")


def octave(folder: Path, tables: Recursion, case: Case) -> tuple[np.ndarray, str]:
    """States and processor seconds of model.m."""
    (folder / "model.m").write_text(matlab_model(tables, case, "benchmarks/export.py"), encoding="utf-8")
    savemat(folder / "in.mat", {"x0": case.past, "u": case.driven.mean, "n": float(case.steps), "h": case.step})
    script = (
        "load in.mat; c = cputime; [t, x] = model(x0, u, n, h); printf('%.1f', cputime - c); save('-v6', 'x.mat', 'x');"
    )
    done = subprocess.run(
        ["octave-cli", "-q", "--eval", script], cwd=folder, capture_output=True, text=True, check=True
    )
    return loadmat(folder / "x.mat")["x"], f"{done.stdout} s of the processor"


def in_c(folder: Path, tables: Recursion, case: Case, real: str = "double") -> tuple[np.ndarray, str]:
    """States, time and memory of the C function."""
    kind = {"double": "f8", "float": "f4"}[real]
    texts = c_model(tables, case, "benchmarks/export.py", single=real == "float")
    for name, text in {**texts, "main.c": MAIN.replace("static double", f"static {real}")}.items():
        (folder / name).write_text(text, encoding="utf-8")
    command = ["gcc", "-std=c99", "-O2", f"-DSTEPS={case.steps}", "fracid_model.c", "main.c", "-o", "model", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    u = np.broadcast_to(case.driven.mean, (case.steps + 1, 1)).astype(float)
    done = subprocess.run([folder / "model"], input=np.concatenate([case.past[-1], u.ravel()]).astype(kind).tobytes(),
                          capture_output=True, check=True)  # fmt: skip
    return np.frombuffer(done.stdout, kind).reshape(-1, 4), done.stderr.decode()


PROGRAMS = (
    ("model.m", octave, "octave-cli", None),
    ("fracid_model.c", in_c, "gcc", None),
    ("fracid_model.c in single precision", partial(in_c, real="float"), "gcc", None),
    ("fracid_model.c, memory of hours", in_c, "gcc", HOURS),
)
"""Name, what runs it, what must be installed, and for how many steps its memory is."""


BAND = (2 * np.pi / (STEPS * H), np.pi / H)

ORDERS = (0.1, 0.3, 0.5, 0.7, 0.8623, 0.9146, 0.95, 0.99, 1.05, 1.5)


def oustaloup(order: float) -> Operator:
    """His filter for s^(1 - order), over s: the smallest that keeps the same promise."""
    gamma = 1 - order
    for N, wider in itertools.product(range(1, 26), (10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0, 10_000.0)):
        (low, high), k = (BAND[0] / wider, BAND[1] * wider), np.arange(2 * N + 1)
        zeros, poles = (low * (high / low) ** ((k + (1 + s * gamma) / 2) / (2 * N + 1)) for s in (-1, 1))
        poles = np.append(0.0, poles)
        residues = [high**gamma * np.prod((zeros - p) / (np.delete(poles, m) - p)) for m, p in enumerate(poles)]
        found = Operator(order, poles, np.array(residues), BAND)
        if found.errors[0] <= DECIBEL and found.errors[1] <= DEGREES:
            break
    return found


def operators() -> None:
    """Poles, and the fastest [rad/s], of a positive sum and of Oustaloup's filter."""
    print(f"1/s^q right within {DECIBEL} dB and {DEGREES} degrees from {BAND[0]:.3g} to {BAND[1]:.4g} rad/s")
    for q in ORDERS:
        ours, his = positive_sum(q, BAND), oustaloup(q)
        print(f"  {q}: {len(ours.poles)} poles up to {ours.poles[-1]:.1e}; {len(his.poles)} up to {his.poles[-1]:.1e}")


def main() -> None:
    operators()
    for driven in (False, True):
        p = problem(driven)
        e = p.experiments[0]
        exact, case = p.simulate(p.start, e).states, Case.of(p, p.start, e)
        print("driven by a chirp from rest" if driven else "released from 10 degrees")
        for name, program, command, steps in PROGRAMS:
            if shutil.which(command):
                with tempfile.TemporaryDirectory() as folder:
                    found, cost = program(Path(folder), Recursion.of(p, p.start, steps), case)
                print(f"  {name}: off by {np.abs(found - exact).max():.1e} at most; {cost}")
        found = integer_model(p)
        off = ", ".join(f"{n} {np.degrees(v):.2g}°" for n, v in follows(found, case, exact).items())
        print(f"  integer order, {len(found.decay)} states: off by {off} rms")


if __name__ == "__main__":
    main()
