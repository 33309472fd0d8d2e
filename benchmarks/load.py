"""Large recordings, many recordings, large populations: what time and how much memory they take.

    python benchmarks/load.py                # all sections; a quarter of an hour on an idle machine
    python benchmarks/load.py hour many      # some of them
    python benchmarks/load.py --write        # also puts the tables into docs/scale.md

Each line is measured in a process of its own, whose peak of resident memory is told by the operating system, and beside
it the size of the data itself.  A line whose peak exceeds its bound stops the script: the bounds stand in
:data:`STEPS`, in megabytes above an empty process that has fracid imported.
"""

from __future__ import annotations

import argparse
import json
import re
import resource
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

PAGE = Path(__file__).parent.parent / "docs" / "scale.md"

HOUR = 3_600_001
"""Samples of an hour at 1 kHz."""

LONG_DAY = 4_320_001
"""Samples of twelve hours at 100 Hz."""

LONG = 10_000_000
"""Samples of the recordings that are only read."""

MANY = 200
"""Recordings in one project."""

OWN = 500
"""Recordings in one project, each of which has a start of its own."""

POPULATION = 100_000
"""Members of a generation, or runs of a batch."""

SRV02 = """\
[model]
name = "rotary-pendulum"
rig  = "srv02-rotpen"
[model.parameters]
C1 = { start = 4.4e-3, lower = 1e-3, upper = 1e-2 }
b_alpha = { start = 3e-4, lower = 0.0, upper = 1e-2 }
[model.orders]
lambda = 1.0
mu = { start = 1.0, lower = 0.6, upper = 1.2 }
"""


def recording(name: str) -> str:
    """A recording's table in a project file."""
    return f'[[recording]]\nfile = "{name}"\ntheta = {{ column = "theta" }}\nalpha = {{ column = "alpha" }}\n'


# --- the data --------------------------------------------------------------------------------------------


def swings(samples: int, step: float, alpha: float = 0.6, seed: int = 1) -> dict[str, np.ndarray]:
    """A rig that a motor kicks every ten seconds, its angles read by encoders, with a little noise."""
    import fracid

    rig = fracid.rotary_pendulum("srv02-rotpen")
    t = step * np.arange(samples)
    volts = np.where((t % 10.0 < 0.2) & (t > 5), 3.0 * (-1.0) ** np.floor(t / 10.0), 0.0)
    run = fracid.simulate(rig, orders={"lambda": 1.0, "mu": 1.0}, initial={"alpha": alpha}, step=step, end=t[-1],
                          inputs=volts[:, None], between="hold")  # fmt: skip
    assert run.completed, run.fault
    count, rng = 2 * np.pi / 4096, np.random.default_rng(seed)
    angles = [count * np.rint((run.states[:, i] + 1e-3 * rng.standard_normal(samples)) / count) for i in (0, 2)]
    return {"time": t, "theta": angles[0], "alpha": angles[1], "voltage": volts}


def make_hour(folder: Path) -> None:
    """An hour at 1 kHz, with its voltage: 115 MB."""
    np.savez(folder / "hour.npz", **swings(HOUR, 1e-3))
    text = (
        SRV02 + recording("hour.npz") + 'voltage = { column = "voltage", unit = "V" }\n[fit]\ninitial_state = "held"\n'
    )
    text += 'optimiser = "least-squares"\n'  # from a start that some minutes of it gave: no growing horizon
    (folder / "hour.toml").write_text(text)


def make_draft(folder: Path) -> None:
    """An hour at 1 kHz with the project that ``init`` writes, untouched: 20 values are free."""
    import fracid
    from fracid.workflows.draft import write_draft

    true = {"cable_stiffness": 0.02, "coulomb_theta": 2e-3, "coulomb_alpha": 1e-4, "b_theta": 4e-3, "b_alpha": 4e-4,
            "C1": 4.1e-3, "J_theta": 1.1e-2}  # fmt: skip
    t, rng, count = 1e-3 * np.arange(HOUR), np.random.default_rng(1), 2 * np.pi / 4096
    volts = np.where((t % 10.0 < 0.2) & (t > 5), 3.0 * (-1.0) ** np.floor(t / 10.0), 0.0)
    rig = fracid.rotary_pendulum("srv02-rotpen")
    run = fracid.simulate(rig, orders={"lambda": 0.98, "mu": 0.97}, parameters=true, initial={"alpha": 0.6},
                          step=1e-3, end=t[-1], inputs=volts[:, None], between="hold")  # fmt: skip
    theta, alpha = (count * np.rint((run.states[:, i] + 1e-3 * rng.standard_normal(HOUR)) / count) for i in (0, 2))
    np.savez(folder / "draft.npz", time=t, theta=theta, alpha=alpha, voltage=volts)
    write_draft(folder / "draft.npz", folder / "draft.toml", None)


def make_tumbling(folder: Path) -> None:
    """An hour at 1 kHz whose pendulum goes over the top again and again, by Runge and Kutta's method at 25 µs."""
    import numba
    from windows import COUNT, NOISE, TRUTH, moved

    from fracid.workflows.draft import write_draft

    @numba.njit
    def recorded(gain: float) -> np.ndarray:
        np.random.seed(7)  # noqa: NPY002 (Numba's own)
        x, rows, push, volt = np.zeros(4), np.empty((HOUR, 3)), 0.0, 0.0
        for k in range(HOUR):
            for i in range(2):
                rows[k, i] = COUNT * np.round((x[2 * i] + NOISE * np.random.standard_normal()) / COUNT)  # noqa: NPY002
            push = 4.0 * np.random.standard_normal() if k % 100 == 0 else push  # noqa: NPY002
            volt = min(10.0, max(-10.0, push - 2.0 * rows[k, 0])) if k % 20 == 0 else volt
            rows[k, 2] = volt
            x = moved(x, gain * volt, 1.0, 1e-3)
        return rows

    theta, alpha, volts = recorded(TRUTH["torque_per_volt"]).T
    np.savez(folder / "tumbling.npz", time=1e-3 * np.arange(HOUR), theta=theta, alpha=alpha, voltage=volts)
    write_draft(folder / "tumbling.npz", folder / "tumbling.toml", None, rig="qube-servo2")


CELL = """\
from fracid import Model, Parameter


def rhs(t, x, u, p, out):
    out[0] = (u[0] - x[0] / p[2]) / p[1]


def voltage(t, x, u, p):
    return p[3] - p[0] * u[0] - x[0]


model = Model(
    name="cell", rhs=rhs, states=("v",), orders=("mu",), outputs={"voltage": voltage}, inputs=("current",),
    parameters=(
        Parameter("R0", "Ohm", 0.02, "in series"), Parameter("Q", "F s^(mu-1)", 800.0, "constant-phase element"),
        Parameter("R1", "Ohm", 0.1, "beside it"), Parameter("E", "V", 3.7, "at rest"),
    ),
    zero="", source="",
)
"""
"""A battery cell: a resistance, and a constant-phase element that leaks."""

DAY = """\
[model]
name = "cell.py:model"
[model.parameters]
R0 = { start = 0.02, lower = 1e-3, upper = 1.0 }
Q = { start = 800.0, lower = 10.0, upper = 1e5 }
R1 = { start = 0.1, lower = 1e-2, upper = 10.0 }
E = { start = 3.7, lower = 3.0, upper = 4.2 }
[model.orders]
mu = { start = 1.0, lower = 0.3, upper = 1.2 }
[[recording]]
file = "day.npz"
voltage = { column = "voltage", unit = "V" }
current = { column = "current", unit = "A" }
[fit]
initial_state = "held"
"""


def make_day(folder: Path) -> None:
    """Twelve hours of a cell at 100 Hz: ten minutes at 1 A, twenty at rest, again and again; 104 MB."""
    import fracid

    (folder / "cell.py").write_text(CELL)
    (folder / "day.toml").write_text(DAY)
    t = 1e-2 * np.arange(LONG_DAY)
    current = np.where((t % 1800.0 < 600.0) & (t > 60.0), 1.0, 0.0)
    np.savez(folder / "day.npz", time=t, voltage=np.linspace(3.7, 3.6, LONG_DAY), current=current)
    model = fracid.load_project(folder / "day.toml", trust=True).problem.model
    run = fracid.simulate(model, orders={"mu": 0.8}, parameters={"R0": 0.03, "Q": 500.0, "R1": 0.2}, initial={},
                          step=1e-2, end=t[-1], inputs=current[:, None])  # fmt: skip
    noise = 1e-3 * np.random.default_rng(1).standard_normal(LONG_DAY)
    np.savez(folder / "day.npz", time=t, voltage=3.7 - 0.03 * current - run.states[:, 0] + noise, current=current)


def make_many(folder: Path) -> None:
    """200 recordings of 5 s at 200 Hz."""
    for k in range(MANY):
        np.savez(folder / f"swing-{k:03}.npz", **swings(1001, 5e-3, 0.2 + 0.005 * k, seed=k))
    tables = "".join(recording(f"swing-{k:03}.npz") for k in range(MANY))
    (folder / "many.toml").write_text(f'{SRV02}{tables}[fit]\ninitial_state = "held"\n')


def make_own(folder: Path) -> None:
    """500 recordings of 10 s at 200 Hz, each with an initial state of its own: 2,003 unknowns."""
    for k in range(OWN):
        np.savez(folder / f"swing-{k:03}.npz", **swings(2000, 5e-3, 0.2 + 0.001 * k, seed=k))
    tables = "".join(recording(f"swing-{k:03}.npz") for k in range(OWN))
    (folder / "own.toml").write_text(f'{SRV02}{tables}[fit]\ninitial_state = "estimate"\n')


def make_long(folder: Path) -> None:
    """10⁷ samples of two angles as .npz, and the same as text."""
    t = 1e-3 * np.arange(LONG)
    alpha = 2 * np.pi / 4096 * np.rint(400 * np.cos(6 * t) * np.exp(-t / 3000))
    np.savez(folder / "long.npz", time=t, theta=0.3 * alpha, alpha=alpha)
    with (folder / "long.csv").open("w") as file:
        file.write("time,theta,alpha\n")
        for first in range(0, LONG, 100_000):
            rows = zip(range(first, first + 100_000), alpha[first : first + 100_000].tolist(), strict=True)
            file.writelines(f"{k / 1000:.3f},{0.3 * a:.6f},{a:.6f}\n" for k, a in rows)


# --- what is measured ------------------------------------------------------------------------------------


def nothing(folder: Path) -> str:  # noqa: ARG001
    """An empty process: fracid, NumPy, SciPy and Numba, the loops loaded."""
    swings(1001, 1e-3)
    return "–"


def check_file(name: str) -> Callable[[Path], str]:
    """``fracid check``."""

    def run(folder: Path) -> str:
        from fracid.recording import inspect_recording

        return inspect_recording(folder / name).report.verdict.split(",")[0]

    return run


def fit_project(name: str) -> Callable[[Path], str]:
    """``fracid fit`` without its figures; the folder stays for the report."""

    def run(folder: Path) -> str:
        import fracid
        from fracid.runs.folder import MEMO, FitOptions, inputs_of, open_run, write_result
        from fracid.tasks.simulation_cache import Memo

        project = fracid.load_project(folder / f"{name}.toml", trust=True)
        with open_run(folder / name, FitOptions(str(project.path)), inputs=inputs_of(project)) as run:
            with Memo(run.folder / MEMO) as memo:
                remembering = replace(project, problem=replace(project.problem, memo=memo))
                found = fracid.identify(remembering, jobs=2)
                write_result(run.folder, found, project, {})
                disk = sum(path.stat().st_size for path in run.folder.rglob("*") if path.is_file())
            run.finish()
        mu = found.orders["mu"]
        half = 1.96 * (mu.standard_error or np.nan)
        return f"{found.evaluations} evaluations, mu = {mu.value:.6f} ± {half:.0e}, {disk / 1e6:.0f} MB of disk"

    return run


def report_run(name: str) -> Callable[[Path], str]:
    """``fracid report``."""

    def run(folder: Path) -> str:
        from fracid.report import write_report

        return f"{write_report(folder / name).stat().st_size / 1e6:.2f} MB"

    return run


def population(optimiser: str) -> Callable[[Path], str]:
    """One generation of 10⁵ members, and the first: 2·10⁵ simulations of a second at 100 Hz."""

    def run(folder: Path) -> str:  # noqa: ARG001
        import fracid
        from fracid.problem import Experiment, Free, Problem

        data = swings(101, 1e-2)
        e = Experiment("twin", 1e-2, np.column_stack([data["theta"], data["alpha"]]), np.zeros((1, 1)))
        orders = {n: Free(1.0, 0.6, 1.2) for n in ("lambda", "mu")}
        problem = Problem(fracid.rotary_pendulum("srv02-rotpen"), (e,), orders, initial_state="held")
        # SciPy counts the members of differential evolution for each unknown
        size = POPULATION if optimiser == "genetic" else POPULATION // 2
        found = fracid.identify(problem, optimiser=optimiser, jobs=2, options={"generations": 1, "population": size})
        return f"{found.evaluations:,} evaluations"

    return run


def batch(folder: Path) -> str:  # noqa: ARG001
    """10⁵ runs of 100 steps, every tenth kept."""
    import fracid

    rig = fracid.rotary_pendulum("srv02-rotpen")
    variants = [{"orders": [1.0, 1.0, mu, mu]} for mu in np.linspace(0.8, 1.1, POPULATION)]
    runs = fracid.solve_fde_batch(rig.rhs, variants, initial=[0.0, 0.0, 0.3, 0.0], parameters=rig.parameter_vector(),
                                  step=1e-2, end=1.0, inputs=np.zeros((1, 1)), every=10, jobs=2)  # fmt: skip
    return f"{len(runs):,} runs, {sum(r.states.nbytes for r in runs) / 1e6:.0f} MB of states"


STEPS: dict[str, tuple[Callable[[Path], None] | None, list[tuple[str, Callable[[Path], str], float, float]]]] = {
    "hour": (make_hour, [
        ("check", check_file("hour.npz"), 115.2, 600),
        ("fit, 3 free", fit_project("hour"), 115.2, 2000),
        ("report", report_run("hour"), 115.2, 1000),
    ]),
    "draft": (make_draft, [("fit, 20 free", fit_project("draft"), 115.2, 2000)]),
    "tumbling": (make_tumbling, [("fit, 20 free", fit_project("tumbling"), 115.2, 2000)]),
    "day": (make_day, [("fit, 5 free", fit_project("day"), 103.7, 2000)]),
    "many": (make_many, [
        ("fit, 3 free", fit_project("many"), 6.4, 400),
        ("report", report_run("many"), 6.4, 500),
    ]),
    "own": (make_own, [("fit, 3 free and 4 of each recording", fit_project("own"), 32.0, 1300)]),
    "long": (make_long, [
        (".npz, check", check_file("long.npz"), 240.0, 1200),
        (".csv, check", check_file("long.csv"), 240.0, 2500),
    ]),
    "population": (None, [
        ("genetic algorithm", population("genetic"), 0.0, 1200),
        ("differential evolution", population("differential-evolution"), 0.0, 600),
        ("solve_fde_batch", batch, 35.0, 600),
    ]),
}  # fmt: skip
"""Section → what makes its files, and its lines: what, how, the data [MB], the bound of the peak above nothing [MB]."""


def child(folder: Path, section: str, line: int) -> None:
    """Do one line, and print its time, its peak and what it says as JSON."""
    warnings.simplefilter("ignore")
    work = nothing if section == "nothing" else STEPS[section][1][line][1]
    began = time.perf_counter()
    says = work(folder)
    spent, peak = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    print(json.dumps({"seconds": spent, "peak": peak, "says": says}))


def measured(folder: Path, section: str, line: int = 0) -> dict[str, float | str]:
    """One line in a process of its own."""
    command = [sys.executable, __file__, "--child", str(folder), section, str(line)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{section}, {line}: {done.stderr[-2000:]}")
    return dict(json.loads(done.stdout.splitlines()[-1]))


def main(sections: list[str]) -> str:
    """All lines of some sections, as Markdown."""
    base = float(measured(Path(), "nothing")["peak"])
    print(f"an empty process: {base:.0f} MB")
    rows = ["| | | time | peak memory, above an empty process | the data | |", "| --- | --- | --: | --: | --: | --- |"]
    for section in sections:
        make, lines = STEPS[section]
        with tempfile.TemporaryDirectory() as where:
            folder = Path(where)
            if make is not None:
                make(folder)
            for k, (what, _, size, bound) in enumerate(lines):
                found = measured(folder, section, k)
                above = float(found["peak"]) - base
                shown = f"{float(found['seconds']):.3g} s | {above:.0f} MB"
                rows.append(f"| {TITLES[section]} | {what} | {shown} | {size:.0f} MB | {found['says']} |")
                print(rows[-1], flush=True)
                assert above < bound, f"{section}, {what}: {above:.0f} MB above an empty process, {bound} are allowed"
    return "\n".join(rows)


TITLES = {
    "hour": "an hour at 1 kHz, 3.6·10⁶ samples",
    "draft": "an hour at 1 kHz, what `init` writes",
    "tumbling": "an hour at 1 kHz that tumbles, what `init` writes",
    "day": "twelve hours at 100 Hz, a battery cell",
    "many": "200 recordings, 1,001 samples each",
    "own": "500 recordings, 2,000 samples each",
    "long": "10⁷ samples of two angles",
    "population": "10⁵ at once",
}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sections", nargs="*", help=", ".join(STEPS))
    parser.add_argument("--write", action="store_true", help="put the table into docs/scale.md")
    parser.add_argument(
        "--child", nargs=3, metavar=("FOLDER", "SECTION", "LINE"), help="one line, for this script itself"
    )
    asked = parser.parse_args()
    if asked.child:
        child(Path(asked.child[0]), asked.child[1], int(asked.child[2]))
    else:
        shown = main(asked.sections or [*STEPS])
        if asked.write:
            text = PAGE.read_text(encoding="utf-8")
            marks = r"(<!-- load: begin -->\n\n).*?(\n\n<!-- load: end -->)"
            PAGE.write_text(re.sub(marks, lambda m: m[1] + shown + m[2], text, flags=re.DOTALL), encoding="utf-8")
