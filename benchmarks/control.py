"""Does the share of draws on which a controller holds, or swings up, predict on how many rigs it does?  A table.

Each twin is a recording of the same pendulum (1.5 s at 100 Hz, driven, 10 mrad of noise); from its fit `fracid.control`
designs a regulator and promises a share of draws, then the regulator is tried once on the pendulum itself.  The mean of
the promises is held against the share of the twins that stays up; limit and start are such that many fall.  `--kind
swing` begins hanging instead, with limits and times that are short for many.
"""

import argparse
from types import SimpleNamespace

import numpy as np
from scipy.optimize import least_squares

import fracid
from fracid.feedback.study import DRAWS, ClosedLoop

MODEL = fracid.model("pendulum", coulomb_angle=1e-3)
MU, STEP, N, NOISE = 0.96, 0.01, 150, 0.01
FREE = {"gravity": (0.05, 0.5), "J": (1e-3, 1e-2), "b_angle": (0.0, 5e-3)}
TORQUE = 0.05 * np.sin(0.02 * np.arange(N) * (1 + np.arange(N) / N))[:, None]


def problem(measured):
    start = {n: fracid.Free(MODEL.parameter(n).value, *ends) for n, ends in FREE.items()}
    e = fracid.Experiment("twin", STEP, measured, TORQUE, initial={"angle": 0.5})
    return fracid.Problem(MODEL, (e,), {"mu": fracid.Free(MU, 0.5, 1.2)}, start, initial_state="held")


TRUTH = problem(np.zeros((N, 1)))
STATES = TRUTH.simulate(TRUTH.start, TRUTH.experiments[0]).states[:, :1]


def fitted(seed):
    p = problem(STATES + NOISE * np.random.default_rng(seed).standard_normal(STATES.shape))
    ends = p.space.lower, p.space.upper
    return SimpleNamespace(problem=p, x=least_squares(p.residuals, p.start, bounds=ends, x_scale=np.abs(p.start)).x)


CASES = {
    "lqr": ((0.042, 4.0, {"angle": 0.1}), (0.0147, 4.0, {"angle": 0.1})),
    "swing": ((0.037, 5.0, None), (0.04, 4.0, None)),
}
"""Limit, seconds and where it begins."""


def promised_and_kept(seed, draws, kind, limit, seconds, off):
    fit = fitted(seed)
    try:
        found = fracid.control(fit, kind=kind, limit=limit, off=off, draws=draws, seconds=seconds, seed=seed)
    except fracid.InputError:  # none holds in any draw: nothing is promised, and nothing tried
        return 0.0, False
    truth = ClosedLoop(fit.problem, fit.problem.start, found.conditions)
    return found.share, truth.trial(TRUTH.start, found.design.controller, 10_000 + seed)["holds"]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--twins", type=int, default=200)
    parser.add_argument("--draws", type=int, default=DRAWS)
    parser.add_argument("--kind", choices=tuple(CASES), default="lqr")
    arguments = parser.parse_args()
    print("| kind | limit [N m] | time [s] | twins | promised | stay up |\n|---|---|---|---|---|---|")
    for limit, seconds, off in CASES[arguments.kind]:
        seeds = range(1, arguments.twins + 1)
        rows = [promised_and_kept(seed, arguments.draws, arguments.kind, limit, seconds, off) for seed in seeds]
        promised, kept = (f"{100 * share:.1f} %" for share in np.mean(rows, axis=0))
        print(f"| {arguments.kind} | {limit} | {seconds} | {len(rows)} | {promised} | {kept} |", flush=True)
