"""Does a plan against integer orders settle more claims than the habit, in the same recording time?

    python benchmarks/telling.py                    # 40 twins, an encoder of 256 counts: 20 minutes on a core
    python benchmarks/telling.py --counts 512 --jobs 2

Each twin is an SRV02 with λ, μ or both off 1 by 0.015 to 0.05, its frictions half to twice the usual, read by encoders
whose counts lie anywhere, four times finer than the fit simulates it.  The habit is one release from 90° for 20 s; the
plans, made once of the rig's constants with λ = μ = 0.95, are four experiments of 5 s or two of 10 s.  Every twin has
an order that is no integer: what ``fracid fit`` does not call fractional is not settled.
"""

import argparse
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial

import numpy as np
from designs import FRICTION, SRV02, joint

import fracid
from fracid.tasks.job import one_blas_thread
from fracid.twins.encoder import encoder, simulated

FREE = ("lambda", "mu", "C1", "C3", "J_theta", *FRICTION)

OFF = (0.015, 0.05)

RELEASES = {"release": (10, 150), "levels": 8, "arm": ("free", "clamped")}

SETS = {"one release from 90°, 20 s": ({"release": 90, "seconds": 20}, 1),
        "a plan, four of 5 s": ({"seconds": 5, **RELEASES}, 4),
        "a plan, two of 10 s": ({"seconds": 10, **RELEASES}, 2)}  # fmt: skip


def planned(counts):
    """Each set's problem at the planned values, and the noise of its sensors."""
    plans = {}
    for name, (decisions, count) in SETS.items():
        space = fracid.DesignSpace(rate=200, moment=0, counts=counts, **decisions)
        plan = fracid.design(SRV02, space, experiments=count, against="integer", free=FREE,
                             orders={"lambda": 0.95, "mu": 0.95})  # fmt: skip
        alone = ", ".join(f"{order} {distance:.0f}" for order, distance in plan.alone.items())
        print(f"{name}: {'; '.join(map(str, plan.experiments))} (alone off, in standard deviations: {alone})")
        plans[name] = joint(plan), dict(plan.subject.noise)
    return plans


def truth(seed):
    rng = np.random.default_rng(seed)
    off, which = rng.uniform(*OFF, 2), ("lambda", "mu", "both")[seed % 3]
    orders = {"lambda": 1 - off[0] * (which != "mu"), "mu": 1 - off[1] * (which != "lambda")}
    return orders | {name: v * 2 ** rng.uniform(-1, 1) for name, v in FRICTION.items()}


def claims(plans, seed):
    """Of one twin, what each set makes of it."""
    values, made = truth(seed), {}
    for name, (problem, noise) in plans.items():
        x = np.array([values.get(n, v) for n, v in zip(problem.names, problem.start.tolist(), strict=True)])
        rng, exact = np.random.default_rng(1000 + seed), simulated(problem, x)
        read = tuple(
            replace(e, measured=np.column_stack([encoder(y[:, None], noise[o].deviation, noise[o].step, rng)[:, 0]
                                                 for o, y in zip(exact.outputs, e.measured.T, strict=True)]))
            for e in exact.experiments
        )  # fmt: skip
        with one_blas_thread():
            made[name] = fracid.identify(replace(exact, experiments=read)).claim
    return made


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--twins", type=int, default=40)
    parser.add_argument("--counts", type=int, default=256)
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    plans = planned(options.counts)
    tally = {name: Counter() for name in SETS}
    with ProcessPoolExecutor(options.jobs) as pool:
        for seed, made in enumerate(pool.map(partial(claims, plans), range(options.twins))):
            for name, claim in made.items():
                tally[name][claim] += 1
            print(seed, ", ".join(made.values()), flush=True)
    for name, counts in tally.items():
        print(f"{name}: {', '.join(f'{claim} {n}' for claim, n in counts.most_common())}")


if __name__ == "__main__":
    main()
