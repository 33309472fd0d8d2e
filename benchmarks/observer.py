"""Is an observer as uncertain as it says, and what does it cost?  Beside filters with a truncated memory: a table.

200 pendulums of order 0.93 that an unknown torque drives, 20 s at 100 Hz, the angle with noise of 1 mrad; the filters
know constants, order and the intensity of the torque.  NEES is the squared error of the states over its covariance, at
the end of each twin, NIS the same of the innovations; a consistent filter has 2 and 1, with the bands of 95 % beside.
Filters of the kind that is published hold the order as a Grünwald-Letnikov sum over 50 or 100 samples.  A second table
has the errors of all where friction and order are not those that the filters begin with, which the first estimates, and
after a second without the sensor; friction also walks while a pendulum swings, and so does the order, which is that of
now for all of the past: x(t) = x(0) + 1/Γ(q(t)) ∫ (t - s)^(q(t) - 1) f(s) ds, simulated without modes.  NEES scatters
by 0.14 over 200 twins: `--drifting 2400` has it of 2400 others, whose order drifts.  `--faster 60` has it of 60 whose
torque changes up to 16 times a sample, at lower orders too: what a filter with fewer steps does not see within one.
"""

import argparse
import math
import time
from dataclasses import replace
from types import SimpleNamespace

import numba as nb
import numpy as np
from scipy.stats import chi2

import fracid
from fracid import observer

MU, STEP, N, NOISE, TORQUE = 0.93, 0.01, 2000, 1e-3, 2e-3
MODEL = fracid.model("pendulum")
INTENSITY = (TORQUE / MODEL.parameter("J").value) ** 2 * STEP
WALK = 1e-4
"""By which friction walks in a second [N m s/rad]."""
DRIFT = 2e-3
"""By which the order does."""
SPREAD = {"angle": 0.01, "rate": 0.05}


def problem(measured, inputs, initial, mu=MU, **constants):
    e = fracid.Experiment("twin", STEP, measured, inputs, initial=initial, between={"torque": "hold"})
    return fracid.Problem(MODEL.with_parameters(**constants), (e,), {"mu": mu}, initial_state="held")


def twin(seed, mu=MU, **constants):
    random = np.random.default_rng(seed)
    initial = {n: (n == "angle") + s * random.standard_normal() for n, s in SPREAD.items()}
    p = problem(np.zeros((N, 1)), TORQUE * random.standard_normal((N, 1)), initial, mu, **constants)
    states = p.simulate(p.start, p.experiments[0]).states
    return states, states[:, :1] + NOISE * random.standard_normal((N, 1))


def worn_rhs(t, x, u, p, out):  # noqa: ARG001
    out[0] = x[1]
    out[1] = (u[0] - p[1] * math.sin(x[0]) - u[1] * x[1]) / p[0]


WORN = fracid.Model("worn pendulum", worn_rhs, ("angle", "rate"), ("mu", "mu"), {"angle": 0}, ("torque", "friction"),
                    tuple(MODEL.parameter(n) for n in ("J", "gravity")), "", "a twin")  # fmt: skip
"""The pendulum, with its friction for an input."""


def worn_twin(seed):
    """One whose friction walks at random while it swings: states, what is measured, and the friction."""
    random = np.random.default_rng(20_000 + seed)
    walk = WALK * np.sqrt(STEP) * np.cumsum(random.standard_normal(N))
    friction = np.abs(MODEL.parameter("b_angle").value + 1e-4 * random.standard_normal() + walk)
    initial = {n: (n == "angle") + s * random.standard_normal() for n, s in SPREAD.items()}
    inputs = np.column_stack([TORQUE * random.standard_normal(N), friction])
    run = fracid.simulate(WORN, orders={"mu": MU}, initial=initial, step=STEP, end=STEP * (N - 1), inputs=inputs,
                          between="hold")  # fmt: skip
    return run.states, run.states[:, :1] + NOISE * random.standard_normal((N, 1)), friction


@nb.njit
def variable_order(order, h, torque, G, J, b, x0):
    """A pendulum whose order changes: product trapezoids for what is smooth, rectangles for the torque that is held."""
    n = len(order)
    x, f = np.empty((n, 2)), np.empty((n, 2))
    x[0] = x0
    f[0, 0], f[0, 1] = x0[1], (-G * np.sin(x0[0]) - b * x0[1]) / J
    for m in range(1, n):
        q = order[m]
        smooth, held = h**q / math.gamma(q + 2), h**q / math.gamma(q + 1)
        w = (m - 1) ** (q + 1) - (m - 1 - q) * m**q
        known = x0 + smooth * w * f[0]
        known[1] += held * (m**q - (m - 1) ** q) * torque[0] / J
        for j in range(1, m):
            k = m - j
            known += smooth * ((k + 1) ** (q + 1) + (k - 1) ** (q + 1) - 2 * k ** (q + 1)) * f[j]
            known[1] += held * (k**q - (k - 1) ** q) * torque[j] / J
        x[m], f[m] = x[m - 1], f[m - 1]
        for _ in range(8):
            x[m] = known + smooth * f[m]
            f[m, 0], f[m, 1] = x[m, 1], (-G * np.sin(x[m, 0]) - b * x[m, 1]) / J
    return x


def drifting_twin(seed, drift=DRIFT):
    """One whose order walks at random while it swings: states, what is measured, and the order."""
    random = np.random.default_rng(30_000 + seed)
    order = MU + 0.01 * random.standard_normal() + drift * np.sqrt(STEP) * np.cumsum(random.standard_normal(N))
    start = np.array([(n == "angle") + s * random.standard_normal() for n, s in SPREAD.items()])
    gravity, J, b = constants()
    states = variable_order(order, STEP, TORQUE * random.standard_normal(N), gravity, J, b, start)
    return states, states[:, :1] + NOISE * random.standard_normal((N, 1)), order


def of_fracid(**more):
    p = problem(twin(0)[1], np.zeros((1, 1)), {"angle": 1.0})
    made = observer(SimpleNamespace(problem=p, x=p.start), noise={"angle": NOISE}, drive=1.0,
                    initial=SPREAD | more.pop("initial", {}), **more)  # fmt: skip
    made.start.drive[:] = 0.0, INTENSITY
    made.reset()
    return made


@nb.njit
def truncated(y, L, mu, h, G, J, b, noise, intensity, spread, x0):
    """An extended Kalman filter on L samples of (angle, rate); returns the last state, its covariance and the NIS."""
    n, g = 2 * L, h**mu
    w = np.ones(L + 1)
    for k in range(1, L + 1):
        w[k] = w[k - 1] * (1 - (mu + 1) / k)
    xi, P, top, new = np.zeros(n), np.zeros((n, n)), np.zeros((2, n)), np.zeros((n, n))
    for k in range(L):
        P[2 * k, 2 * k], P[2 * k + 1, 2 * k + 1] = spread[0] ** 2, spread[1] ** 2  # the start counts in none of them
    P[2:], P[:, 2:] = 0.0, 0.0
    nis = 0.0
    for m in range(1, len(y)):
        angle, rate = x0[0] + xi[0], x0[1] + xi[1]
        f0, f1 = rate, (-G * np.sin(angle) - b * rate) / J
        J00, J01, J10, J11 = 0.0, 1.0, -G * np.cos(angle) / J, -b / J
        now = np.array([g * f0, g * f1])
        for k in range(L):
            now[0] -= w[k + 1] * xi[2 * k]
            now[1] -= w[k + 1] * xi[2 * k + 1]
        for c in range(n):
            top[0, c] = g * (J00 * P[0, c] + J01 * P[1, c])
            top[1, c] = g * (J10 * P[0, c] + J11 * P[1, c])
        for k in range(L):
            for c in range(n):
                top[0, c] -= w[k + 1] * P[2 * k, c]
                top[1, c] -= w[k + 1] * P[2 * k + 1, c]
        corner = np.zeros((2, 2))
        for r in range(2):
            corner[r, 0] = g * (J00 * top[r, 0] + J01 * top[r, 1])
            corner[r, 1] = g * (J10 * top[r, 0] + J11 * top[r, 1])
            for k in range(L):
                corner[r, 0] -= w[k + 1] * top[r, 2 * k]
                corner[r, 1] -= w[k + 1] * top[r, 2 * k + 1]
        new[2:, 2:] = P[:-2, :-2]
        new[:2, 2:], new[2:, :2], new[:2, :2] = top[:, :-2], top[:, :-2].T, corner
        new[1, 1] += g * g * intensity / h
        P[:] = new
        xi[2:] = xi[:-2].copy()
        xi[:2] = now
        if np.isnan(y[m]):
            continue
        spread_y, innovation = P[0, 0] + noise**2, y[m] - x0[0] - xi[0]
        gain = P[:, 0].copy()
        for r in range(n):
            xi[r] += gain[r] * innovation / spread_y
            for c in range(n):
                P[r, c] -= gain[r] * gain[c] / spread_y
        nis += innovation**2 / spread_y
    return x0 + xi[:2], P[:2, :2], nis / (len(y) - 1)


def constants():
    return tuple(MODEL.parameter(n).value for n in ("gravity", "J", "b_angle"))


def of_truncated(L):
    def run(y):
        return truncated(y[:, 0], L, MU, STEP, *constants(), NOISE, INTENSITY, np.array([*SPREAD.values()]),
                         np.array([1.0, 0.0]))  # fmt: skip

    return run


def consistency(count):
    made = of_fracid()

    def ours(y):
        made.reset()
        track = made.run(y)
        return np.array([track.states[n][-1] for n in MODEL.states]), made.covariance, np.mean(track.nis)

    low, high = chi2.ppf((0.025, 0.975), 2 * count) / count
    low1, high1 = chi2.ppf((0.025, 0.975), N * count) / (N * count)
    print(f"{count} twins; consistent: NEES {low:.2f} to {high:.2f}, NIS {low1:.4f} to {high1:.4f}\n")
    print("| memory | states | NEES | NIS | rms of the angle [mrad] | of the rate [rad/s^0.93] | µs a step |")
    print("|---|---|---|---|---|---|---|")
    for name, size, run in (("exponentials", len(made.start.xi), ours), ("50 samples", 100, of_truncated(50)),
                            ("100 samples", 200, of_truncated(100))):  # fmt: skip
        run(twin(0)[1])
        nees, nis, errors, seconds = [], [], [], []
        for seed in range(1, count + 1):
            states, y = twin(seed)
            begin = time.process_time()
            x, P, one = run(y)
            seconds.append(time.process_time() - begin)
            errors.append(x - states[-1])
            nees.append(nees_of(errors[-1], P))
            nis.append(one)
        rms = np.sqrt(np.mean(np.square(errors), axis=0))
        print(f"| {name} | {size} | {np.mean(nees):.2f} | {np.mean(nis):.4f} | {1e3 * rms[0]:.2f} | {rms[1]:.4f} "
              f"| {1e6 * np.median(seconds) / N:.1f} |", flush=True)  # fmt: skip


def follower():
    """A filter that follows an order that drifts."""
    return of_fracid(slow={"mu": DRIFT}, initial={"mu": 0.01})


def quarters(made, twin):
    """Errors of the states and of what walks, and their covariance, at the end of each quarter of a twin."""
    states, y, walked = twin
    truth, found = np.column_stack([states, walked]), []
    made.reset()
    for part in np.split(np.arange(N), 4):
        track = made.run(y[part])
        found.append((np.array([v[-1] for v in track.states.values()]) - truth[part[-1]], made.covariance))
    return found


def nees_of(error, P):
    """Of both states; 2 on average."""
    return error[:2] @ np.linalg.solve(P[:2, :2], error[:2])


def drifting(count, block=200):
    """NEES at the end of twins whose order drifts, in blocks, with other seeds than those of the tables."""
    made = follower()
    nees = np.array([nees_of(*quarters(made, drifting_twin(5000 + seed))[-1]) for seed in range(1, count + 1)])
    low, high = chi2.ppf((0.025, 0.975), 2 * count) / count
    print(f"{count} twins whose order drifts: NEES {nees.mean():.3f}, consistent: {low:.2f} to {high:.2f}")
    print(f"in blocks of {block}:", *(f"{np.mean(part):.2f}" for part in np.split(nees, range(block, count, block))))


def faster(count):
    """NEES at four times of twins whose torque changes within a sample, and of filters with finer steps."""
    for mu in (MU, 0.75, 0.6):
        for values, substeps in ((1, 1), (16, 1), (16, 4), (16, 16)):
            p = replace(problem(twin(0)[1], np.zeros((1, 1)), {"angle": 1.0}, mu), substeps=substeps)
            fit, nees = SimpleNamespace(problem=p, x=p.start), []
            made = observer(fit, noise={"angle": NOISE}, drive=1.0, initial=SPREAD)
            made.start.drive[:] = 0.0, INTENSITY
            for seed in range(1, count + 1):
                random = np.random.default_rng(40_000 + seed)
                initial = {n: (n == "angle") + s * random.standard_normal() for n, s in SPREAD.items()}
                torque = TORQUE * math.sqrt(values) * random.standard_normal((values * (N - 1) + 1, 1))
                run = fracid.simulate(MODEL, orders={"mu": mu}, initial=initial, step=STEP / values,
                                      end=STEP * (N - 1), inputs=torque, between="hold")  # fmt: skip
                states = run.states[::values]
                y = states[:, :1] + NOISE * random.standard_normal((N, 1))
                nees.append(np.mean([nees_of(*one) for one in quarters(made, (states, y, states[:, :0]))]))
            print(f"order {mu}, {values} torques and {substeps} steps a sample: NEES {np.mean(nees):.2f} "
                  f"± {np.std(nees) / math.sqrt(count):.2f}", flush=True)  # fmt: skip


def changes(count):
    """Friction and an order that are not those the filter begins with, a sensor that drops out for 1 s."""
    walks = {"friction that walks": [], "order that drifts": []}
    rows = {"friction": [], "order": [], **{n: [] for n in walks}, "dropped out": []}
    errors = {(what, n): [] for what in ("constants that are others", "dropped out") for n in ("exponentials", 50, 100)}
    made = of_fracid(slow={"b_angle": 1e-4, "mu": 1e-3}, initial={"b_angle": 2e-4, "mu": 0.03})
    modes = len(made.start.z)
    watch, wears = of_fracid(), of_fracid(slow={"b_angle": WALK}, initial={"b_angle": 1e-4})
    drifts = follower()
    for seed in range(1, count + 1):
        random = np.random.default_rng(10_000 + seed)
        states, y = twin(
            seed, mu=(mu := MU + 0.03 * random.standard_normal()), b_angle=(b := 4e-4 + 1e-4 * random.random())
        )
        made.reset()
        track = made.run(y)
        _note(errors, "constants that are others", track, states, y)
        for n, truth in (("friction", b), ("order", mu)):
            name = {"friction": "b_angle", "order": "mu"}[n]
            rows[n].append(((track.states[name][-1] - truth) / track.deviations[name][-1], track.deviations[name][-1]))
        for what, made_of, filtered in (("friction that walks", worn_twin, wears),
                                        ("order that drifts", drifting_twin, drifts)):  # fmt: skip
            found = quarters(filtered, made_of(seed))
            rows[what] += [(error[-1] / math.sqrt(P[-1, -1]), math.sqrt(P[-1, -1])) for error, P in found]
            walks[what].append(np.mean([nees_of(error, P) for error, P in found]))
        states, y = twin(seed)
        y[1000:1100] = np.nan
        watch.reset()
        track = watch.run(y)
        _note(errors, "dropped out", track, states, y, 1099)
        rows["dropped out"].append(((track.states["angle"][1099] - states[1099, 0]) / track.deviations["angle"][1099],
                                    track.deviations["angle"][1099]))  # fmt: skip
    print(f"\n{modes + 2} states, {count} twins: share of errors within 1.96 deviations, their rms, and the deviation")
    for name, found in rows.items():
        z, deviation = np.array(found).T
        print(f"{name:19s} {np.mean(np.abs(z) < 1.96):.3f}  {np.sqrt(np.mean(z**2)):.2f}  {np.mean(deviation):.3g}")
    for what, found in walks.items():
        scatter = np.std(found) / math.sqrt(len(found))
        print(f"{what}: NEES of both states, at four times, {np.mean(found):.2f} ± {scatter:.2f}")
    print("\n| what happens | memory | rms of the angle [mrad] | of the rate [rad/s^0.93] |\n|---|---|---|---|")
    for (what, memory), found in errors.items():
        rms = np.sqrt(np.mean(np.square(found), axis=0))
        print(f"| {what} | {memory} | {1e3 * rms[0]:.2f} | {rms[1]:.4f} |")


def _note(errors, what, track, states, y, at=-1):
    """The errors of all filters at a sample; those of a truncated memory keep the constants that they begin with."""
    errors[what, "exponentials"].append([track.states[n][at] - states[at, i] for i, n in enumerate(MODEL.states)])
    for samples in (50, 100):
        errors[what, samples].append(of_truncated(samples)(y[: at + 1] if at >= 0 else y)[0] - states[at])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--twins", type=int, default=200)
    parser.add_argument("--drifting", type=int, default=0, help="only so many twins whose order drifts")
    parser.add_argument("--faster", type=int, default=0, help="only so many whose torque changes within a sample")
    a = parser.parse_args()
    if a.drifting:
        drifting(a.drifting)
    elif a.faster:
        faster(a.faster)
    else:
        consistency(a.twins)
        changes(a.twins)
