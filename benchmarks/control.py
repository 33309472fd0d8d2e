"""Does the share of draws on which a controller holds, or swings up, predict on how many rigs it does?  A table.

Each twin is a recording of a pendulum of its own (1.5 s at 100 Hz, driven, 10 mrad of noise); from its fit
`fracid.control` designs a regulator and promises a share of draws, then the regulator is tried once on the pendulum
itself.  Limit and start are such that many fall.  `--kind swing` begins hanging instead, with limits and times that are
short for many.

Draws lie about a fit as truths do about it, so promise p and outcome k (0 or 1) have the same mean where truths are
spread evenly over more than a fit knows: they are, over `BOX`.  About one and the same truth they need not: a motor
that is 1 % stronger than that pendulum asks for always holds it, and is promised for most draws only.  What is printed
is the mean of k - p with its standard error, over all twins and over those with p between 20 and 80 %.  `--one-truth`
has the same truth for all.
"""

import argparse
import math
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from types import SimpleNamespace

import numpy as np
from scipy.optimize import least_squares

import fracid
from fracid.feedback.study import ClosedLoop
from fracid.tasks.job import one_blas_thread

MODEL = fracid.model("pendulum", coulomb_angle=1e-3)
MU, STEP, N, NOISE = 0.96, 0.01, 150, 0.01
FREE = {"gravity": (0.05, 0.5), "J": (1e-3, 1e-2), "b_angle": (0.0, 5e-3)}
BOX = {"mu": (0.94, 0.98), "gravity": (0.143, 0.151), "J": (2.8e-3, 3.2e-3), "b_angle": (0.0, 8e-4)}
"""Of the truths: to each side three standard errors of a fit or more, but for friction, which none knows."""
TORQUE = 0.05 * np.sin(0.02 * np.arange(N) * (1 + np.arange(N) / N))[:, None]


def problem(measured):
    start = {n: fracid.Free(MODEL.parameter(n).value, *ends) for n, ends in FREE.items()}
    e = fracid.Experiment("twin", STEP, measured, TORQUE, initial={"angle": 0.5})
    return fracid.Problem(MODEL, (e,), {"mu": fracid.Free(MU, 0.5, 1.2)}, start, initial_state="held")


def fitted(truth, random):
    """A recording of a pendulum with these unknowns, and its fit."""
    still = problem(np.zeros((N, 1)))
    angle = still.simulate(truth, still.experiments[0]).states[:, :1]
    p = problem(angle + NOISE * random.standard_normal((N, 1)))
    ends = p.space.lower, p.space.upper
    return SimpleNamespace(problem=p, x=least_squares(p.residuals, p.start, bounds=ends, x_scale=np.abs(p.start)).x)


CASES = {
    "lqr": ((0.0147, 4.0, {"angle": 0.1}), (0.042, 4.0, {"angle": 0.1})),
    "swing": ((0.037, 5.0, None), (0.04, 4.0, None)),
}
"""Limit, seconds and where it begins."""


def promised_and_kept(seed, *, draws, kind, limit, seconds, off, one_truth=False):
    """The share of draws, and whether the pendulum itself stays up."""
    random = np.random.default_rng(seed)
    names = problem(np.zeros((N, 1))).names
    truth = np.array([random.uniform(*BOX[n]) for n in names])
    if one_truth:
        truth = problem(np.zeros((N, 1))).start
    fit = fitted(truth, random)
    with one_blas_thread():
        try:
            found = fracid.control(fit, kind=kind, limit=limit, off=off, draws=draws, seconds=seconds, seed=seed)
        except fracid.InputError:  # none holds in any draw: nothing is promised, and nothing tried
            return 0.0, False
        trial = ClosedLoop(fit.problem, fit.x, found.conditions).trial(truth, found.design.controller, 10_000 + seed)
    return found.share, trial["holds"]


def told(rows):
    """Promise, what came of it, and their difference with its standard error [%]."""
    if len(rows) < 2:
        return "| | |"
    p, k = rows.T
    off = 100 * (k - p)
    return (
        f"{100 * p.mean():.1f} | {100 * k.mean():.1f} | {off.mean():+.1f} ± {off.std(ddof=1) / math.sqrt(len(off)):.1f}"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--twins", type=int, default=800)
    parser.add_argument("--draws", type=int, default=50)
    parser.add_argument("--kind", choices=tuple(CASES), default="lqr")
    parser.add_argument("--one-truth", action="store_true")
    parser.add_argument("--row", type=int, help="one row alone: 0 or 1")
    parser.add_argument("--first", type=int, default=1, help="the first seed")
    parser.add_argument("--jobs", type=int, default=1)
    a = parser.parse_args()
    rest = "promised [%] | stay up [%] | difference [%] | of these promised 20 to 80 % | stay up [%] | difference [%] |"
    print(f"| kind | limit [N m] | time [s] | twins | {rest}\n{'|---' * 10}|")
    with ProcessPoolExecutor(a.jobs, mp_context=get_context("spawn")) as pool:
        for limit, seconds, off in CASES[a.kind] if a.row is None else (CASES[a.kind][a.row],):
            case = {"kind": a.kind, "limit": limit, "seconds": seconds, "off": off, "one_truth": a.one_truth}
            one = partial(promised_and_kept, draws=a.draws, **case)
            rows = np.array([*pool.map(one, range(a.first, a.first + a.twins))], dtype=float)
            unsure = rows[(rows[:, 0] > 0.2) & (rows[:, 0] < 0.8)]
            print(f"| {a.kind} | {limit} | {seconds} | {len(rows)} | {told(rows)} | {told(unsure)} |", flush=True)
