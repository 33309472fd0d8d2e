"""The statistical claims of the docstrings, measured again: ``python benchmarks/evidence.py [SECTION …]``.

============== ========================================================================= ==========
section        what it measures, and where that stands                                   takes
============== ========================================================================= ==========
``genetic``    the paper's genetic algorithm against random points                       1 s
               (:mod:`fracid.optimise.genetic`)
``rounding``   what the rounding of an encoder does to ITAE (:mod:`fracid.problem.costs`)        10 s
``coverage``   how often a 95 % interval of λ and of μ holds the truth                   1 min
               (:mod:`fracid.estimation.covariance`)
``swing``      orders from a start in mid-swing, by how its past is treated              1 min
               (:mod:`fracid.problem.past`)
``cut``        how far the orders of a real SRV02 move with the cut; its recordings     1 min
               from FRACID_RECORDINGS or ../shared/recordings (:mod:`fracid.validation.unknown_past`)
``start``      how often an interval contains the true value where the start is taken from a    15 s
               noisy sample, by how far that moves the order (docs/honesty.md)
``regression`` errors of the linear regression, by the release and the orders            2 min
               (:mod:`fracid.regression`)
============== ========================================================================= ==========

Without a section: the first three.
"""

import argparse
import os
import re
import tempfile
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

import fracid
from fracid.estimation.covariance import uncertainty
from fracid.estimation.curvature import curvature, start_shift
from fracid.estimation.derivatives import jacobian
from fracid.models import RIGS
from fracid.optimise import Evaluation, Space, genetic, least_squares, minimise
from fracid.problem import Experiment, Free, Problem
from fracid.problem.costs import COSTS
from fracid.quantiles import NORMAL_95
from fracid.recording import Recording
from fracid.regression import LUMPED
from fracid.validation.after_search import with_start
from fracid.validation.unknown_past import cut_check, whole_records


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
    print(f"\n95 % intervals that contain the true value, lambda and mu, {seeds} seeds")
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


COUNT = 2 * np.pi / 4096


def mid_swing(cut=1.3, plateau=0.5, end=8.0, step=2e-3):
    """Twins of orders 0.9, 0.95 with 4096 counts: a start 1.3 s after the release, by what is known of its past."""
    friction = RIGS["srv02-rotpen"].fitted_friction
    true = {"lambda": 0.9, "mu": 0.95}
    cases = (("viscous", {}, 60, 1e-3), ("dry too", friction, 60, 1e-3), ("dry too", friction, 20, 1e-3),
             ("dry too", friction, 60, 1e-2))  # fmt: skip
    print(f"\nError of lambda and mu of a start {cut} s after the release; (standard error that the fit promises)")
    for name, parameters, degrees, noise in cases:
        rig = fracid.rotary_pendulum("srv02-rotpen", **parameters)
        run = fracid.simulate(rig, orders=true, initial={"alpha": np.radians(degrees)}, step=step / 4, end=end)
        swing = np.vstack([np.tile(run.states[0, [0, 2]], (round(plateau / step), 1)), run.states[::4, [0, 2]]])
        read = COUNT * np.rint((swing + noise * np.random.default_rng(1).standard_normal(swing.shape)) / COUNT)
        twin = Recording.of("twin", step * np.arange(len(read)), dict(zip(("theta", "alpha"), read.T, strict=True)))
        before, after = twin.split(plateau + cut)
        starts = {
            "estimate": (after, None, "estimate"),
            "with its past": (after, before, "estimate"),
            "measured": (after, before, "measured"),
            "from plateau": (twin.trim(plateau), None, "rest"),
        }
        for start, (recording, past, initial_state) in starts.items():
            swing = Experiment.of(recording, rig, ("theta", "alpha"), before=past)
            orders = {"lambda": Free(1.0, 0.5, 1.2), "mu": Free(1.0, 0.5, 1.2)}
            found = fracid.identify(Problem(rig, (swing,), orders, initial_state=initial_state), jobs=2).orders
            off = ", ".join(f"{n} {found[n].value - true[n]:+.4f} ({found[n].standard_error:.4f})" for n in true)
            print(f"  {degrees} deg, {name:8} noise {noise:g} rad  {start:14} {off}", flush=True)


def noisy_start(seeds=120):
    """Releases from 17° whose start is taken from a sample with 1e-3 rad of noise, or is named."""
    rig = fracid.rotary_pendulum("srv02-rotpen")
    true, alpha = np.array([0.9, 0.95]), 0.3
    run = fracid.simulate(rig, orders=[0.9, 0.9, 0.95, 0.95], initial={"alpha": alpha}, step=8e-3, end=6.0)
    orders = {"lambda": Free(0.9, 0.5, 1.2), "mu": Free(0.95, 0.5, 1.2)}
    limits = (0.0, 1.0, 1.5, 3.0, np.inf)
    print(f"\nCoverage of the 95 % intervals, by the CI half-widths that the start's noise moves it; {seeds} seeds")
    for named in ({}, {"theta": 0.0}, {"theta": 0.0, "alpha": alpha}):
        moved, held, wider = [], [], []
        for seed in range(seeds):
            y = run.states[:, [0, 2]] + 1e-3 * np.random.default_rng(seed).standard_normal((len(run.time), 2))
            swing = Experiment("release", 8e-3, y, np.zeros((1, 1)), initial=named)
            problem = Problem(rig, (swing,), orders, initial_state="held")
            x = minimise(problem.evaluate, least_squares(problem.space, None)).best.point
            known = uncertainty(problem, x)
            noise = {"release": np.full(2, 1e-3)}
            shift = start_shift(problem, x, curvature(problem, x, np.arange(2)), noise)
            moved += [*(np.zeros(2) if shift is None else shift / known.standard_error)]
            held += [*(abs(x - true) < NORMAL_95 * known.standard_error)]
            wider += [*(abs(x - true) < NORMAL_95 * with_start(problem, x, known).standard_error)]
        moved, held = np.array(moved), np.array(held)
        inside = {(a, b): held[(moved >= a) & (moved < b)] for a, b in pairwise(limits)}
        words = ", ".join(
            f"{a:g} to {b:g}: {100 * np.mean(h):.0f} % of {len(h)}" for (a, b), h in inside.items() if len(h)
        )
        print(f"  named: {', '.join(named) or 'nothing':12} {100 * np.mean(held):.0f} %; {words}", flush=True)
        print(f"    {100 * np.mean(wider):.0f} % by the intervals of a fit, the start included", flush=True)


def cut():
    """The release of examples/srv02-release.toml, fitted alone."""
    root = Path(__file__).parents[1]
    folder = Path(os.environ.get("FRACID_RECORDINGS", root.parent / "shared" / "recordings"))
    if not next(folder.rglob("release_92deg.mat"), None):
        print(f"\nThe cut: no release_92deg.mat in {folder}; say where with FRACID_RECORDINGS=FOLDER")
        return
    text = (root / "examples" / "srv02-release.toml").read_text(encoding="utf-8")
    text = re.sub(r'^(file *= )"(.+)"', lambda m: f'{m[1]}"{next(folder.rglob(m[2])).as_posix()}"', text, flags=re.M)
    with tempfile.TemporaryDirectory() as place:
        (Path(place) / "release.toml").write_text(text, encoding="utf-8")
        project = fracid.load_project(Path(place) / "release.toml")
        fit = fracid.identify(replace(project, validation=()), jobs=2)
        found = cut_check(fit.problem, fit.x, fit.uncertainty, whole=whole_records(project), jobs=2)
    print("\nThe release of a real SRV02 from 92 deg, by what is taken for the motion before its start")
    orders = ", ".join(f"{n} {v:.4f} ± {found.half_width[n]:.4f}" for n, v in found.as_fitted.orders.items())
    print(f"  {'as fitted':20} {orders}; {np.degrees(found.as_fitted.cost):.3f} deg")
    for name, t in found.treatments.items():
        print(f"  {name:20} " + ", ".join(f"{n} {v:.4f}" for n, v in t.orders.items())
              + f"; {np.degrees(t.cost):.3f} deg")  # fmt: skip
    print(f"  {found.verdict}")


def regression(seeds=6):
    """SRV02 releases of 6 s at 1 kHz, 4096 counts whose zero lies anywhere within one, C4 known."""
    rig = fracid.rotary_pendulum("srv02-rotpen", b_theta=1e-2, b_alpha=3e-4, coulomb_theta=4e-3, coulomb_alpha=2.5e-4)
    true = {n: rig.parameter(n).value for n in LUMPED}
    known = {"C4": true["C4"]}

    def release(degrees, orders, seed):
        run = fracid.simulate(rig, orders=orders, initial={"alpha": np.radians(degrees)}, step=2e-4, end=6.0)
        zero = np.random.default_rng(seed).uniform(0, COUNT, 2)
        angles = COUNT * np.round((run.states[::5][:, [0, 2]] + zero) / COUNT)
        return Recording.of("twin", 1e-3 * np.arange(len(angles)), {"theta": angles[:, 0], "alpha": angles[:, 1]})

    print(
        f"\nRegression: largest errors [%] over {seeds} zeros of the encoder; J_theta of least squares (its own bias)"
    )
    print(
        f"  {'orders':>15} {'release':>7}  J_theta,C3,C1     C6  b_,coulomb_theta  b_alpha  coulomb_alpha   ols J_theta"
    )
    cases = [
        (dict(zip(("lambda", "mu"), q, strict=True)), degrees)
        for q in ((1.0, 1.0), (0.95, 0.97), (0.8623, 0.9146)) for degrees in (10, 30, 60, 90)
    ]  # fmt: skip
    for orders, degrees in cases:
        errors, shrunk, biases = [], [], []
        for seed in range(1, seeds + 1):
            swing = release(degrees, orders, seed)
            by_iv, by_ols = (
                fracid.regress(swing, rig, orders=orders, known=known, estimator=estimator).parameters
                for estimator in ("iv", "ols")
            )
            errors.append([100 * abs(by_iv[n].value / true[n] - 1) for n in LUMPED])
            shrunk.append(100 * (by_ols["J_theta"].value / true["J_theta"] - 1))
            biases.append(100 * by_ols["J_theta"].bias / true["J_theta"])
        worst = dict(zip(LUMPED, np.max(errors, axis=0), strict=True))
        inertias, arm = (max(worst[n] for n in names)
                         for names in (("J_theta", "C3", "C1"), ("b_theta", "coulomb_theta")))  # fmt: skip
        print(f"  {orders['lambda']:7}, {orders['mu']:6} {degrees:6}°  {inertias:13.1f} {worst['C6']:6.1f} {arm:17.1f} "
              f"{worst['b_alpha']:8.1f} {worst['coulomb_alpha']:14.1f} {np.mean(shrunk):9.1f} ({np.mean(biases):.1f})",
              flush=True)  # fmt: skip
    print("\nOrders searched, three zeros of the encoder: largest error, half the interval; J_theta, C3, C1 then")
    for orders, degrees in cases:
        found = [fracid.regress(release(degrees, orders, seed), rig, known=known) for seed in (1, 2, 3)]
        off = {n: max(abs(f.orders[n] - orders[n]) for f in found) for n in orders}
        half = {n: max(np.ptp(f.intervals[n]) / 2 for f in found) for n in orders}
        inertias = max(abs(f.parameters[n].value / true[n] - 1) for f in found for n in ("J_theta", "C3", "C1"))
        words = ", ".join(f"{n} {off[n]:.4f} (± {half[n]:.3f})" for n in orders)
        print(f"  {orders['lambda']:7}, {orders['mu']:6} {degrees:6}°  {words}; {100 * inertias:.1f} %", flush=True)


SECTIONS = {"genetic": genetic_against_random, "rounding": rounding_bias, "coverage": coverage, "swing": mid_swing,
            "start": noisy_start, "cut": cut, "regression": regression}  # fmt: skip

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Measures claims of the docstrings again.")
    parser.add_argument(
        "sections", nargs="*", metavar="SECTION", help=", ".join(SECTIONS) + "; the first three if none"
    )
    asked = parser.parse_args().sections or list(SECTIONS)[:3]
    if unknown := [name for name in asked if name not in SECTIONS]:
        parser.error(f"there is no section {unknown[0]!r}; there are {', '.join(SECTIONS)}")
    for name in asked:
        SECTIONS[name]()
