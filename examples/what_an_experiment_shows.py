"""What each experiment tells of a rotary pendulum, and what spoils it: the tables of docs/recording.md.

    python examples/what_an_experiment_shows.py             # all three, less than a minute
    python examples/what_an_experiment_shows.py --write     # and put them into docs/recording.md

The rig is an SRV02 with viscous and dry friction on both joints and orders 0.95, 0.97; change :data:`TRUTH` to plan
experiments on yours.

``experiments``  The least standard error that any method can reach (Cramér and Rao): with J the derivatives of all
                 samples by all unknowns at the truth and σ the noise of a sample, the roots of the diagonal of
                 σ² (J'J)⁻¹.  Nothing is fitted, so a new experiment costs a tenth of a second.
``picture``      Errors of the same kind over the angle of the release.
``encoders``     Twins with rounding alone, identified: what counts and rate do.
``spoiled``      Twins of one release, treated as recordings often are, identified: how far the result moves.
"""

import argparse
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.signal import butter, chirp, sosfilt, sosfiltfilt

import fracid
from fracid import Experiment, Free, Problem, optimise
from fracid.estimation.derivatives import jacobian
from fracid.plots.appearance import BLUE, VERMILLION

PAGE = Path(__file__).parent.parent / "docs" / "recording.md"
IMAGES = PAGE.parent / "images"

TRUTH = fracid.rotary_pendulum(
    "srv02-rotpen", actuation="torque", b_theta=1e-2, b_alpha=3e-4, coulomb_theta=4e-3, coulomb_alpha=2.5e-4
)
ORDERS = {"lambda": 0.95, "mu": 0.97}
CONSTANTS = ("C1", "C3", "C6", "J_theta", "b_theta", "b_alpha", "coulomb_theta", "coulomb_alpha")
STEP, FINE = 2e-3, 5e-4
"""Of the recordings, and of the simulation [s]."""
COUNT = 2 * np.pi / 4096
NOISE = np.hypot(np.radians(0.05), COUNT / np.sqrt(12))
"""Of a sample [rad]: 0.05° and the rounding of 4096 counts."""


def simulated(degrees, end=10.0, torque=None, rig=TRUTH, step=STEP):
    """Both angles of a release at rest, with a torque on the arm or without [rad], shape (n_samples, 2)."""
    finer, n = round(step / FINE), round(end / step)
    steps = np.arange(n * finer + 1) / finer
    u = np.zeros((1, 1)) if torque is None else np.interp(steps, np.arange(n + 1), torque)[:, None]
    start = {"alpha": np.radians(degrees)}
    run = fracid.simulate(rig, orders=ORDERS, initial=start, step=FINE, end=end, inputs=u)
    return run.states[::finer, [0, 2]]


def experiment(degrees, end=10.0, torque=None, rig=TRUTH, **options):
    """Without noise, which :func:`least_errors` does not need."""
    inputs = np.zeros((1, 1)) if torque is None else torque[:, None]
    return Experiment(f"from {degrees}", STEP, simulated(degrees, end, torque, rig), inputs, **options)


def problem_of(*recordings, free=CONSTANTS, rig=TRUTH, start="rest", outputs=("theta", "alpha")):
    """Free are both orders, the constants `free`, from half to twice their values, and the angle of rest."""
    values = {n: rig.parameter(n).value for n in free}
    parameters = {n: Free(v, v / 2, 2 * v) for n, v in values.items()} | {"alpha_rest": Free(0.0, -0.1, 0.1)}
    orders = {n: Free(q, 0.5, 1.2) for n, q in ORDERS.items()}
    return Problem(rig, recordings, orders, parameters, outputs=outputs, initial_state=start, substeps=2)


def least_errors(problem):
    """Standard errors by name, from σ² (J'J)⁻¹ at the start of the problem, which is the truth."""
    parts = jacobian(problem, problem.start, np.arange(len(problem.names)))
    J = np.concatenate([part.reshape(-1, part.shape[-1]) for part in parts])
    size = np.linalg.norm(J, axis=0)
    _, singular, V = np.linalg.svd(J / size, full_matrices=False)
    errors = NOISE * np.linalg.norm(V.T / singular, axis=1) / size  # huge where the data are blind
    return dict(zip(problem.names, errors, strict=True))


def pulse(end=10.0, size=0.3, length=0.2):
    """A torque [N m] on the arm for `length` s, after half a second."""
    t = STEP * np.arange(round(end / STEP) + 1)
    return np.where((t >= 0.5) & (t < 0.5 + length), size, 0.0)


def sweep(end=10.0, size=0.15):
    """A torque [N m] that sweeps from 0.3 to 4 Hz."""
    t = STEP * np.arange(round(end / STEP) + 1)
    return size * chirp(t, 0.3, end, 4.0)


def experiments():
    """The first table: what each experiment tells at best."""
    sticky = TRUTH.with_parameters(coulomb_theta=0.042, b_theta=0.13)
    with_C4 = (*CONSTANTS, "C4")
    alpha = replace(experiment(60), measured=experiment(60).measured[:, 1:])
    cases = {
        **{f"release from {a}°": problem_of(experiment(a)) for a in (10, 30, 60, 90, 150)},
        "10°, an arm that sticks": problem_of(experiment(10, rig=sticky), rig=sticky),
        "60°, an arm that sticks": problem_of(experiment(60, rig=sticky), rig=sticky),
        "60°, α alone": problem_of(alpha, outputs=("alpha",)),
        "60°, 3 s": problem_of(experiment(60, 3.0)),
        "60°, 30 s": problem_of(experiment(60, 30.0)),
        "60°, release time free": problem_of(experiment(60, release_time=Free(0.0, -0.02, 0.02))),
        "60°, start in motion": problem_of(experiment(60), start="estimate"),
        "30° and 90°": problem_of(experiment(30), experiment(90)),
        "60°, $C_4$ free": problem_of(experiment(60), free=with_C4),
        "pulse, $C_4$ free": problem_of(experiment(0, torque=pulse()), free=with_C4),
        "sweep, $C_4$ free": problem_of(experiment(0, torque=sweep()), free=with_C4),
        "60° and sweep, $C_4$ free": problem_of(experiment(60), experiment(0, torque=sweep()), free=with_C4),
    }
    rows = []
    for name, problem in cases.items():
        error, size = least_errors(problem), problem.parameter_starts
        orders = [digits(1e4 * error[n]) if error[n] < 0.1 else "–" for n in ORDERS]
        constants = [percent(error[n] / size[n]) if n in error else "known" for n in with_C4]
        rows.append([name, *orders, *constants, digits(1e3 * np.degrees(error["alpha_rest"]))])
    letters = ("C_1", "C_3", "C_6", r"J_\theta", r"b_\theta", r"b_\alpha", r"f_\theta", r"f_\alpha", "C_4")
    heads = ["λ", "μ", *(f"${letter}$" for letter in letters), "rest of α"]
    return table(["experiment", *heads], rows)


SHORT = ("C1", "b_theta", "b_alpha", "coulomb_theta", "coulomb_alpha")
"""What is free beside the orders where twins are fitted."""


def identified(recording, step, **options):
    """Errors of λ, μ, C1 and the residual's rms, of a fit from the truth."""
    values = {n: TRUTH.parameter(n).value for n in SHORT}
    free = {n: Free(v, 0.1 * v, 5 * v) for n, v in values.items()}
    orders = {n: Free(q, 0.5, 1.3) for n, q in ORDERS.items()}
    substeps = max(1, round(step / 1e-3))
    options = {"outputs": ("theta", "alpha"), "initial_state": "rest"} | options
    problem = Problem(TRUTH, (recording,), orders, free, substeps=substeps, **options)
    best = optimise.minimise(problem.evaluate, optimise.least_squares(problem.space, None)).best
    x = dict(zip(problem.names, best.point, strict=True))
    return x["lambda"] - ORDERS["lambda"], x["mu"] - ORDERS["mu"], x["C1"] / values["C1"] - 1, np.degrees(best.cost)


def encoders(seeds=4):
    """The second table: rms errors of λ and μ of a release from 30°, rounded to counts and no other noise."""
    rng = np.random.default_rng(1)
    exact = {rate: simulated(30, 6.0, step=1 / rate) for rate in (50, 200, 1000)}
    rows = []
    for counts in (500, 1024, 4096, 20000):
        count, cells = 2 * np.pi / counts, []
        for rate, angles in exact.items():
            off = []
            for _ in range(seeds):
                zero = count * rng.random(2)  # where the encoder's steps lie
                read = count * np.rint((angles + zero) / count) - zero
                off.append(identified(Experiment("twin", 1 / rate, read, np.zeros((1, 1))), 1 / rate)[:2])
            cells += [f"{v:.1g}" for v in np.sqrt(np.mean(np.square(off), axis=0))]
        rows.append([f"{counts:,}", f"{360 / counts:.2g}°", *cells])
    return table(["counts", "a step", *(f"{n}, {rate} Hz" for rate in exact for n in "λμ")], rows)


def spoiled():
    """The third table: one release from 60°, after half a second on the plateau, and what is often done to it."""
    rng = np.random.default_rng(1)
    swing = simulated(60, 6.0)
    held = np.vstack([np.tile(swing[0], (250, 1)), swing])
    read = COUNT * np.rint((held + np.radians(0.05) * rng.standard_normal(held.shape)) / COUNT)
    slow = butter(2, 10.0, fs=1 / STEP, output="sos")
    late, t = 250 + 100, STEP * np.arange(len(read))
    jitter = np.sort(t + 2e-3 * rng.standard_normal(len(t)))
    skew = np.column_stack([read[:, 0], np.interp(t - 4e-3, t, read[:, 1])])
    cases = {
        "as it is, from the plateau": (read[250:], {}),
        "low-pass of 10 Hz, causal": (sosfilt(slow, read - read[0], axis=0)[250:] + read[0], {}),
        "low-pass of 10 Hz, both ways": (sosfiltfilt(slow, read, axis=0)[250:], {}),
        "cut 0.2 s after the release": (read[late:], {"initial_state": "estimate"}),
        "the same, with its past": (read[late:], {"initial_state": "estimate", "past": read[:late]}),
        "release taken 20 ms too early": (read[240:], {}),
        "the same, release time free": (read[240:], {"release_time": Free(0.0, -0.05, 0.05)}),
        "time stamps off by 2 ms rms": (np.column_stack([np.interp(jitter, t, x) for x in read.T])[250:], {}),
        "α logged 4 ms after θ": (skew[250:], {}),
        "clock 1 % fast": (read[250:], {"step": STEP * 1.01}),
        "zero of α off by 1°": (read[250:] + np.radians([0, 1.0]), {}),
        "4000 counts taken for 4096": (read[250:] * 4096 / 4000, {}),
    }
    rows = []
    for name, (angles, options) in cases.items():
        recording = {n: v for n, v in options.items() if n in ("release_time", "past")}
        step = options.get("step", STEP)
        start = {n: v for n, v in options.items() if n == "initial_state"}
        found = identified(Experiment("twin", step, angles, np.zeros((1, 1)), **recording), step, **start)
        rows.append([name, f"{found[0]:+.4f}", f"{found[1]:+.4f}", f"{100 * found[2]:+.2f} %", f"{found[3]:.2f}°"])
    return table(["recording", "λ off by", "μ off by", "$C_1$ off by", "rms of the residual"], rows)


def draw():
    """Of what the first table's errors are for every angle: λ, μ and two constants, with both encoders and with one."""
    angles = np.array([5, 10, 15, 20, 30, 45, 60, 90, 120, 150])
    found = {}
    for outputs in (("theta", "alpha"), ("alpha",)):
        for angle in angles:
            release = experiment(angle)
            release = replace(release, measured=release.measured[:, 2 - len(outputs) :])
            problem = problem_of(release, outputs=outputs)
            error = least_errors(problem)
            for name in ("lambda", "mu", "C6", "J_theta"):
                scale = problem.parameter_starts.get(name, 1.0)
                found.setdefault((name, len(outputs)), []).append(error[name] / scale)
    figure = Figure(figsize=(8, 3.6), layout="constrained")
    orders, constants = figure.subplots(1, 2, sharex=True)
    curves = (("lambda", "λ", orders, BLUE), ("mu", "μ", orders, VERMILLION),
              ("J_theta", r"$J_\theta$", constants, BLUE), ("C6", "$C_6$", constants, VERMILLION))  # fmt: skip
    for name, letter, axes, colour in curves:
        factor = 100 if axes is constants else 1
        for outputs, style, what in ((2, "-", "θ and α"), (1, "--", "α alone")):
            error = factor * np.array(found[name, outputs])
            axes.loglog(angles, error, style, color=colour, marker=".", label=f"{letter}, {what}")
    for axes, what in ((orders, "least standard error of an order"), (constants, "of a constant [%]")):
        axes.set(xlabel="released from [°]", ylabel=what, xticks=[5, 10, 20, 50, 100, 150], xlim=(4.5, 170))
        axes.set_xticklabels(["5", "10", "20", "50", "100", "150"])
        axes.minorticks_off()
        axes.grid(color="0.92")
        axes.legend(frameon=False, fontsize=8)
    path = IMAGES / "recording-angles.png"
    figure.savefig(path, dpi=130)
    return f"{path}\n"


def percent(relative):
    """A dash where the value is not known to half of its size."""
    return digits(100 * relative) if relative < 0.5 else "–"


def digits(value):
    """Two of them, never as a power of ten."""
    return f"{value:.{max(0, 1 - math.floor(math.log10(value)))}f}"


def table(heads, rows):
    lines = [heads, ["---", *["---:"] * (len(heads) - 1)], *rows]
    return "\n".join("| " + " | ".join(row) + " |" for row in lines) + "\n"


PARTS = {"experiments": experiments, "picture": draw, "encoders": encoders, "spoiled": spoiled}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "part", nargs="*", choices=[[], *PARTS], metavar="PART", help=f"{', '.join(PARTS)}; all of them without"
    )
    parser.add_argument("--write", action="store_true", help="put the tables into docs/recording.md")
    asked = parser.parse_args()
    for part in asked.part or PARTS:
        made = PARTS[part]()
        print(f"\n{part}\n\n{made}", flush=True)
        if asked.write:
            begin, end = f"<!-- {part}: begin -->", f"<!-- {part}: end -->"
            before, _, rest = PAGE.read_text(encoding="utf-8").partition(begin)
            if rest:  # the picture has no place of its own
                PAGE.write_text(f"{before}{begin}\n\n{made}\n{end}{rest.partition(end)[2]}", encoding="utf-8")
