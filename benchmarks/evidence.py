"""The statistical claims of the docstrings, measured again: ``python benchmarks/evidence.py`` (about a minute).

1. How often a 95 % interval of λ and of μ holds the truth (fracid.uncertainty).
2. The paper's genetic algorithm against random points (fracid.optimise.genetic).
3. What the rounding of an encoder does to ITAE (fracid.costs).
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

import fracid
from fracid.costs import COSTS
from fracid.optimise import Evaluation, Space, genetic, least_squares, minimise
from fracid.problem import Experiment, Free, Problem
from fracid.uncertainty import NORMAL_95, jacobian, uncertainty


def coverage(seeds=150):
    """Twins of 4 s at 500 Hz, 3 mrad of noise, both angles scored."""
    true = np.array([0.9, 0.95])
    rig = fracid.rotary_pendulum("srv02-rotpen")
    run = fracid.simulate(rig, orders=[0.9, 0.9, 0.95, 0.95], initial={"alpha": 0.3}, step=2e-3, end=4.0)
    exact = run.states[:, [0, 2]]
    orders = {"lambda": Free(0.9, 0.5, 1.2), "mu": Free(0.95, 0.5, 1.2)}

    def coloured(rho, rng):
        white = rng.standard_normal((len(exact) + 500, 2))
        return 3e-3 * np.sqrt(1 - rho**2) * lfilter([1], [1, -rho], white, axis=0)[500:]

    noises = {
        "white": lambda rng: coloured(0.0, rng),
        "AR(1), 0.9": lambda rng: coloured(0.9, rng),
        "AR(1), 0.98, and as much white": lambda rng: coloured(0.98, rng) + coloured(0.0, rng),
    }
    print(f"\n95 % intervals that hold the truth, lambda and mu, {seeds} seeds")
    for name, noise in noises.items():
        ours, plain = np.zeros(2), np.zeros(2)
        for seed in range(seeds):
            swing = Experiment("swing", 2e-3, exact + noise(np.random.default_rng(seed)), np.zeros((1, 1)),
                               initial={"theta": 0.0, "alpha": 0.3})  # fmt: skip
            problem = Problem(rig, (swing,), orders, initial_state="held")
            x = minimise(problem.evaluate, least_squares(problem.space, None)).best.point
            e, J = problem.errors(x)[0].ravel(), jacobian(problem, x, np.arange(2))[0].reshape(-1, 2)
            ours += np.abs(x - true) < NORMAL_95 * uncertainty(problem, x).standard_error
            plain += np.abs(x - true) < NORMAL_95 * np.sqrt(np.var(e) * np.diag(np.linalg.inv(J.T @ J)))
        (a, b), (c, d) = np.rint(100 * ours / seeds).astype(int), np.rint(100 * plain / seeds).astype(int)
        print(f"  {name:32} fracid {a:3} %, {b:3} %    sigma^2 (J'J)^-1 {c:3} %, {d:3} %")


def genetic_against_random(seeds=50):
    """Valleys like that of (26) over two orders in [0.5, 1.2]²."""
    aim = np.array([0.8623, 0.9146])
    space = Space(("lambda", "mu"), np.full(2, 0.5), np.full(2, 1.2), np.full(2, 1.0))

    def valley(ratio):
        def cost(x):
            a, b = x - aim
            return Evaluation(x, ratio * abs(0.2 * a + b) + abs(a - 0.2 * b))

        return cost

    print(f"\nDistance to the minimum, median and worst tenth of {seeds} seeds, 520 evaluations each")
    for ratio in (7, 20):
        evaluate = valley(ratio)

        def by_ga(seed, evaluate=evaluate):
            return minimise(evaluate, genetic(space, np.random.default_rng(seed))).best.point

        def by_chance(seed, evaluate=evaluate):
            points = space.from_unit(np.random.default_rng(seed).random((520, 2)))
            return min((evaluate(x) for x in points), key=lambda e: e.cost).point

        for name, search in (("genetic", by_ga), ("random points", by_chance)):
            off = [np.linalg.norm(search(seed) - aim) for seed in range(seeds)]
            print(f"  valley 1 : {ratio:<4} {name:15} {np.median(off):.3f}  {np.quantile(off, 0.9):.3f}")


def rounding_bias(seeds=10):
    """The paper's twin, gl-paper, α alone, noise of half a count: mean error of λ with and without rounding."""
    problem = fracid.load_project(Path(fracid.__file__).parent / "twins" / "paper-twin.toml", preset="paper").problem
    exact, count = problem.fitted(np.array([0.8623, 0.9146]), problem.experiments[0]), 2 * np.pi / 4096
    print(f"\nMean error of lambda on the paper's twin, noise of half a count, {seeds} seeds")
    for cost in ("itae", "rmse"):
        for name, read in (("rounded to counts", lambda y: count * np.rint(y / count)), ("not rounded", lambda y: y)):
            off = []
            for seed in range(seeds):
                noise = 0.5 * count * np.random.default_rng(seed).standard_normal(exact.shape)
                swing = replace(problem.experiments[0], measured=read(exact + noise))
                twin = replace(problem, experiments=(swing,), cost_function=COSTS[cost])
                space = replace(twin.space, start=np.array([0.8623, 0.9146]))
                off.append(minimise(twin.evaluate, least_squares(space, None), jobs=2).best.point[0] - 0.8623)
            print(f"  {cost}, {name:18} {np.mean(off):+.4f} (deviation {np.std(off):.4f})")


if __name__ == "__main__":
    genetic_against_random()
    rounding_bias()
    coverage()
