"""Simulation-based calibration of the posterior: are truths drawn from the prior anywhere in it with equal probability?

Truth from the prior, a twin of it with noise, a fit, a posterior: then the rank of the truth among the draws is uniform
[T].  Ten bins of the ranks are tested by χ² for each parameter; p > 0.01 is expected of each.  Model and step of
the twin are those of the fit, so that the posterior alone is on trial.

    python benchmarks/posterior.py                    # 500 twins; goes on where it was cut short
    python benchmarks/posterior.py --twins 50 --jobs 2
    python benchmarks/posterior.py --noise correlated
    python benchmarks/posterior.py --integer --twins 100   # which order does the evidence pick, where 1 is true?

[T] S. Talts, M. Betancourt, D. Simpson, A. Vehtari, A. Gelman, arXiv:1804.06788.
"""

import argparse
from dataclasses import replace
from math import isfinite
from pathlib import Path

import numpy as np
from scipy.stats import chisquare

import fracid
from fracid.problem import Experiment, Free, Problem
from fracid.tasks.job import one_blas_thread

RIG = fracid.rotary_pendulum("srv02-rotpen")
STEP, END, NOISE, ALPHA = 1e-2, 3.0, 2e-3, 0.6
PRIOR = {"mu": (0.85, 1.0), "b_alpha": (0.0, 1e-3), "b_theta": (1e-3, 6e-3), "coulomb_alpha": (0.0, 2e-4)}
DRAWS, RANKS, BINS = 600, 99, 10


def noise_of(rng, n, kind):
    """White, or as autocorrelated as AR(1) with ρ = 0.8, of the same standard deviation; shape (n, 2)."""
    white = NOISE * rng.standard_normal((n, 2))
    if kind == "white":
        return white
    for t in range(1, n):
        white[t] = 0.8 * white[t - 1] + 0.6 * white[t]
    return white


def twin(seed, kind, orders=PRIOR["mu"]):
    """The truth, from the prior, and the problem of its twin."""
    rng = np.random.default_rng(seed)
    truth = {n: float(rng.uniform(low, high)) for n, (low, high) in (PRIOR | {"mu": orders}).items()}
    parameters = {n: v for n, v in truth.items() if n != "mu"}
    run = fracid.simulate(RIG, orders={"lambda": 1.0, "mu": truth["mu"]}, parameters=parameters,
                          initial={"alpha": ALPHA}, step=STEP, end=END)  # fmt: skip
    measured = run.states[:, [0, 2]]
    measured = measured + noise_of(rng, len(measured), kind)
    free = {n: Free(0.5 * (low + high), low, high) for n, (low, high) in PRIOR.items()}
    swing = Experiment("twin", STEP, measured, np.zeros((1, 1)), initial={"theta": 0.0, "alpha": ALPHA})
    return truth, Problem(RIG, (swing,), {"lambda": 1.0, "mu": free.pop("mu")}, free, initial_state="held")


def repetition(seed, kind):
    """The rank of each truth among the draws of its posterior, k̂ and how many draws count."""
    truth, problem = twin(seed, kind)
    with one_blas_thread():
        drawn = fracid.posterior(problem, draws=DRAWS, seed=seed)
    sample = drawn.resampled(RANKS, seed=seed)
    ranks = {n: int(np.sum(sample[:, i] < truth[n])) for i, n in enumerate(problem.names)}
    return {"ranks": ranks, "khat": drawn.khat if isfinite(drawn.khat) else None, "trusted": drawn.trusted,
            "effective": drawn.effective_draws}  # fmt: skip


def integer(seed, kind):
    """The log odds of order 1 against a free one, of a twin of order 1; None of draws that cannot be trusted."""
    _, problem = twin(seed, kind, orders=(1.0, 1.0))
    free = replace(problem, orders={"lambda": 1.0, "mu": Free(1.0, 0.85, 1.15)})
    one = replace(problem, orders={"lambda": 1.0, "mu": 1.0})
    with one_blas_thread():
        drawn = [fracid.posterior(p, draws=DRAWS, seed=seed) for p in (one, free)]
    return fracid.log_odds(*drawn) if all(d.trusted for d in drawn) else None


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--twins", type=int, default=500)
    parser.add_argument("--noise", choices=["white", "correlated"], default="white")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("runs/posterior-calibration"))
    parser.add_argument("--integer", action="store_true", help="the odds of order 1 on twins of order 1")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    tasks = [fracid.Task(f"twin {seed}", (seed, options.noise)) for seed in range(options.twins)]
    study = {"prior": {n: list(b) for n, b in PRIOR.items()}, "noise": options.noise, "draws": DRAWS}
    if options.integer:
        with fracid.Journal(options.out / f"integer-{options.noise}.jsonl", study) as journal:
            values = fracid.run_tasks(integer, tasks, jobs=options.jobs, journal=journal).values()
        odds = [v for v in values if v is not None]
        favoured, least, most = int(np.sum(np.array(odds) > 0)), min(odds), max(odds)
        print(f"{options.noise} noise: the odds favour order 1 in {favoured} of {len(odds)} twins of order 1,")
        print(f"  by {least:.1f} to {most:.1f} nats")
        return
    with fracid.Journal(options.out / f"{options.noise}.jsonl", study) as journal:
        results = list(fracid.run_tasks(repetition, tasks, jobs=options.jobs, journal=journal).values())
    counted = [r for r in results if r["trusted"]]
    print(f"{options.noise} noise, {len(results)} twins, {len(counted)} of them with draws that can be trusted")
    for name in PRIOR:
        counts = np.histogram([r["ranks"][name] for r in counted], bins=BINS, range=(0, RANKS + 1))[0]
        print(f"  {name:14} χ² p = {chisquare(counts).pvalue:.3f}   {' '.join(map(str, counts))}")


if __name__ == "__main__":
    main()
