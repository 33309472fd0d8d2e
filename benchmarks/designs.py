"""Is what a plan predicts what comes out?  Twins of five plans, identified: realised scatter over predicted.

    python benchmarks/designs.py                        # 5 plans x 200 twins: hours on 2 cores
    python benchmarks/designs.py --plans habit --twins 50

For each plan the experiments that :func:`fracid.design` chooses are simulated at the truth, four times finer than the
fit, read by encoders whose counts lie anywhere, and identified by least squares, initial angles for each recording.  A
ratio of 1 is a prediction that is right; of n twins it scatters by 1/√(2n), and 10 % is asked for.
"""

import argparse
import json
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import numpy as np

import fracid
from fracid.optimise import least_squares, minimise
from fracid.tasks.job import one_blas_thread
from fracid.twins.encoder import encoder, simulated

ORDERS = {"lambda": 0.95, "mu": 0.97}

FRICTION = {"b_theta": 1e-2, "b_alpha": 3e-4, "coulomb_theta": 4e-3, "coulomb_alpha": 2.5e-4}

NAMES = ("lambda", "mu", "b_theta", "b_alpha", "coulomb_alpha")
"""Both orders and three frictions."""

FREE = ("lambda", "mu", "J_theta", *FRICTION)

SRV02 = fracid.rotary_pendulum("srv02-rotpen", **FRICTION)
QUBE = fracid.rotary_pendulum("qube-servo2", coulomb_theta=1e-3, coulomb_alpha=1e-4)

PLANS = {
    "habit": (SRV02, fracid.DesignSpace(release=90, seconds=20, rate=200, moment=0), 1),
    "short": (SRV02, fracid.DesignSpace(release=(10, 120), seconds=(4, 8), rate=200, moment=0, levels=8), 2),
    "noisy": (SRV02, fracid.DesignSpace(release=(10, 60), seconds=10, rate=200, moment=0, noise=1.5e-3, levels=6), 3),
    "driven": (QUBE, fracid.DesignSpace(release=(0.0, 45.0, 90.0), seconds=8, rate=200, moment=0,
                                        voltage=fracid.Multisine(0.3, 5.0, peak=3.0), limits={"theta": 2.5}), 2),
    "coarse": (QUBE, fracid.DesignSpace(release=(20, 100), seconds=(5, 10), rate=200, moment=0, counts=2048,
                                        levels=6), 2),
}  # fmt: skip


def planned(name):
    model, space, count = PLANS[name]
    return fracid.design(model, space, experiments=count, of=("lambda", "mu"), free=FREE, orders=ORDERS)


def joint(plan):
    """The plan's experiments as one problem, with what the model does at the truth for what is measured."""
    problems = [plan.subject.problem_of(c) for c in plan.experiments]
    own = tuple(replace(p.experiments[0], name=f"{k}") for k, p in enumerate(problems))
    problem = replace(problems[0], experiments=own)
    return simulated(problem, problem.start)


def estimate(problem, noise, seed):
    """The shared values that one twin gives; None where the search fails."""
    rng = np.random.default_rng(seed)
    twins = tuple(
        replace(e, measured=np.column_stack([
            encoder(e.measured[:, [o]], noise[n].deviation, noise[n].step, rng)[:, 0]
            for o, n in enumerate(problem.outputs)
        ])) for e in problem.experiments
    )  # fmt: skip
    twin = replace(problem, experiments=twins)
    best = minimise(twin.evaluate, least_squares(twin.space, None)).best
    found = dict(zip(twin.names, best.point.tolist(), strict=True))
    return [found[n] for n in NAMES] if np.isfinite(best.cost) else None


def ratios(name, twins, jobs):
    plan = planned(name)
    problem, noise = joint(plan), dict(plan.subject.noise)
    with ProcessPoolExecutor(jobs) as pool:
        rows = [*pool.map(estimate, [problem] * twins, [noise] * twins, range(twins))]
    values = np.array([row for row in rows if row is not None])
    predicted = np.array([plan.expected[n].standard_error for n in NAMES])
    truth = np.array([plan.expected[n].value for n in NAMES])
    return {
        "experiments": [str(c) for c in plan.experiments], "twins": len(values),
        "realised over predicted": dict(zip(NAMES, (values.std(axis=0, ddof=1) / predicted).round(3).tolist(),
                                            strict=True)),
        "bias over predicted": dict(zip(NAMES, ((values.mean(axis=0) - truth) / predicted).round(3).tolist(),
                                        strict=True)),
    }  # fmt: skip


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--plans", nargs="*", default=[*PLANS], choices=[*PLANS])
    parser.add_argument("--twins", type=int, default=200)
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_args()
    with one_blas_thread():
        for plan_name in asked.plans:
            print(json.dumps({plan_name: ratios(plan_name, asked.twins, asked.jobs)}, indent=2), flush=True)
