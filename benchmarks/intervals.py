"""How often does a 95 % interval contain the true value?  Twins of every rig, identified again: ``make coverage``.

    python benchmarks/intervals.py                 # prints the tables; goes on from what runs/coverage has
    python benchmarks/intervals.py --write         # also puts them into docs/uncertainty.md
    python benchmarks/intervals.py --seeds 20 --only srv02
    python benchmarks/intervals.py --methods --write   # the four kinds of interval beside each other: four minutes

(Not called coverage.py: Numba would import it in the place of the package of that name.)

    python benchmarks/intervals.py --only undithered --write   # the encoders without dither alone

A case is a rig, its orders and a release angle.  The truth has viscous and dry friction on both joints, is solved four
times finer than the fit, and is read with 0.1 degrees of noise by encoders of 4096 counts whose marks lie anywhere.
Free are the orders, all four frictions and both initial angles; the search starts at orders of 0.97, half the true
friction and the first sample, so never at the truth.  A clamped arm (stepper-freeswing) tells nothing of theta.

200 repetitions a case, because a share of 100 is a coarse thing: of intervals that keep their word to the letter 90 to
99 of 100 contain the true value with a probability of 96.6 %, so of fifty such counts one or two leave that range; of
200 repetitions 90 to 99 % do so with 99.7 %.

Beside them are encoders without dither: a tenth of a count of noise, 18 s, of which the rig rests through the most, or
6 s; and the same 18 s with 0.1 degrees of noise.  There the intervals alone are on trial: least squares from the truth.

The step of the fit is halved until what it does to any unknown is below a fifth of a standard error; the column
"steps" has how many a sample that takes.
"""

import argparse
import math
import os
import re
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

import fracid
from fracid.estimation.block_bootstrap import bootstrap
from fracid.estimation.cost_profile import profile
from fracid.estimation.covariance import uncertainty
from fracid.estimation.derivatives import jacobian
from fracid.estimation.search import search
from fracid.models import RIGS
from fracid.optimise import OPTIMISERS
from fracid.problem import Experiment, Free, Problem
from fracid.tasks.job import Progress, Task
from fracid.tasks.journal import Journal
from fracid.tasks.tasks import run_tasks
from fracid.twins.encoder import simulated
from fracid.validation.monte_carlo import NoiseStudy, Plan, planned, repetition
from fracid.validation.study_records import binomial95

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "docs" / "uncertainty.md"
FOLDER = ROOT / "runs" / "coverage"

DRY = {
    "srv02-rotpen": (2e-3, 2.5e-4),
    "qube-servo2": (1.5e-4, 5e-5),
    "cazzolato-prime": (1e-3, 3e-4),
    "odrive-furuta": (1e-4, 6e-5),
    "stepper-freeswing": (0.0, 1.8e-4),
}
"""Dry friction of arm and pendulum [N m]: as fitted to real recordings, or else like it beside gravity's torque; the
arm's so small that a release from 10 degrees still moves it."""

CLAMPED = ("stepper-freeswing",)
ORDERS = ((0.9, 0.95), (1.0, 1.0))
ANGLES = (10, 45, 90)
STEP, END = 4e-3, 6.0
LEVEL, COUNT = math.radians(0.1), 2 * math.pi / 4096
QUIET = 0.1 * COUNT
"""Noise that dithers nothing [rad]."""
REST = 18.0
"""A record that ends in a rest [s]."""
RESTING = (
    ("srv02-rotpen", 10), ("srv02-rotpen", 45), ("qube-servo2", 10), ("stepper-freeswing", 10),
)  # fmt: skip
"""Rigs and releases that come to rest within it."""

FINE_ENOUGH = 0.2
"""Of a standard error: what the step of the fit may do to an unknown."""

RANGE = (0.90, 0.99)


@dataclass(frozen=True)
class Case:
    rig: str
    orders: tuple[float, float]
    angle: float
    level: float = LEVEL
    """Of the noise [rad]."""
    end: float = END
    """[s]"""

    @property
    def own(self) -> bool:
        """Whether it is of the first table: dithered, and without a rest."""
        return self.level == LEVEL and self.end == END

    @property
    def name(self) -> str:
        text = f"{self.rig}, {self.orders[0]:g}/{self.orders[1]:g}, {self.angle:g} deg"
        more = f", {'undithered' if self.level < LEVEL else 'dithered beside undithered'}, {self.end:g} s"
        return text if self.own else text + more

    def problem(self) -> tuple[Problem, np.ndarray]:
        """What is to be identified, and the truth."""
        clamped = self.rig in CLAMPED
        model = fracid.rotary_pendulum(self.rig).with_parameters(
            coulomb_theta=DRY[self.rig][0], coulomb_alpha=DRY[self.rig][1]
        )
        value = {p.name: p.value for p in model.parameters}
        joints = ("alpha",) if clamped else ("theta", "alpha")
        reach = 0.1 * value["C4"]
        part = 0.5 if self.own else 1.0
        free = {f"b_{j}": Free(part * value[f"b_{j}"], -reach, reach) for j in joints}
        free |= {f"coulomb_{j}": Free(part * value[f"coulomb_{j}"], 0.0, reach) for j in joints}
        starts = (0.97, 0.97) if self.own else self.orders
        order, mu = (Free(start, 0.5, 1.2) for start in starts)
        empty = np.zeros((round(self.end / STEP) + 1, len(joints)))
        empty[:, -1] = np.radians(self.angle)
        problem = Problem(
            model, (Experiment("twin", STEP, empty, np.zeros((1, 1))),),
            {"lambda": 1.0 if clamped else order, "mu": mu}, free, outputs=joints, initial_state="rest",
        )  # fmt: skip
        truth = dict(zip(("lambda", "mu"), self.orders, strict=True)) | value
        truth |= {"theta(0) [twin]": 0.0, "alpha(0) [twin]": np.radians(self.angle)}
        return problem, np.array([truth[n] for n in problem.names])


def with_fine_steps(problem: Problem, truth: np.ndarray, level: float = LEVEL) -> Problem:
    """Halve the step until what it does to any unknown is below a fifth of a standard error."""
    sigma = math.hypot(level, COUNT / math.sqrt(12))
    for substeps in (1, 2, 4, 8, 16, 32):
        finer = replace(problem, substeps=substeps)
        twin = simulated(finer, truth)
        J = jacobian(twin, truth, np.arange(len(truth)))[0].reshape(-1, len(truth))
        size = np.linalg.norm(J, axis=0)
        Q, R = np.linalg.qr(J / size)
        shift = np.linalg.solve(R, Q.T @ twin.errors(truth)[0].ravel())
        error = sigma * np.linalg.norm(np.linalg.inv(R), axis=1)
        if np.max(np.abs(shift) / error) < FINE_ENOUGH:
            return finer
    raise RuntimeError("no step is fine enough")


def plans(seeds: int, only: str) -> dict[Case, Plan]:
    cases = [Case(rig, orders, angle) for rig in RIGS for orders in ORDERS for angle in ANGLES]
    cases += [Case(rig, orders, angle, QUIET, REST) for rig, angle in RESTING for orders in ORDERS]
    cases += [Case("srv02-rotpen", orders, 10, level, end) for level, end in ((QUIET, END), (LEVEL, REST))
              for orders in ORDERS]  # fmt: skip
    found = {}
    for number, case in enumerate(cases, 1):
        if only in case.name:
            problem, truth = case.problem()
            fine = with_fine_steps(problem, truth, case.level)
            found[case] = planned(
                fine,
                truth,
                levels=[case.level],
                resolutions=[COUNT],
                seeds=seeds,
                seed=number,
                rival=True,
                optimiser="multistart" if case.own else "least-squares",
            )
    return found


# --- tables ------------------------------------------------------------------------------------------

COLUMNS = {"lambda": "λ", "mu": "μ", "b_theta": "b_θ", "b_alpha": "b_α", "coulomb_theta": "f_θ",
           "coulomb_alpha": "f_α", "theta(0) [twin]": "θ(0)", "alpha(0) [twin]": "α(0)"}  # fmt: skip


def percent(held: int, intervals: int) -> str:
    share = held / intervals
    text = f"{100 * share:.1f}"
    return text if RANGE[0] <= share <= RANGE[1] else f"**{text}**"


def coverage_table(studies: dict[Case, NoiseStudy]) -> str:
    """Per cent of the intervals that contain the true value."""
    head = ["rig", "λ/μ", "release", "steps", *COLUMNS.values(), "called fractional", "failed"]
    rows = []
    for case, study in studies.items():
        (cell,) = study.cells
        shares = [percent(s.held, s.intervals) if (s := cell.unknowns.get(n)) and s.intervals else "–" for n in COLUMNS]
        rows.append([case.rig, f"{case.orders[0]:g}/{case.orders[1]:g}", f"{case.angle}°", str(study.problem.substeps),
                     *shares, f"{cell.fractional} of {cell.repetitions}", str(cell.failed)])  # fmt: skip
    return markdown(head, rows)


def undithered_table(studies: dict[Case, NoiseStudy]) -> str:
    """The same of encoders without dither, and of records that end in a rest."""
    lines = coverage_table(studies).splitlines()
    noise = ["noise | record", "--- | ---", *(f"{case.level / COUNT:.2g} counts | {case.end:g} s" for case in studies)]
    first = [line.split(" | ", 3) for line in lines]
    return "\n".join(" | ".join([*cells[:3], more, cells[3]]) for cells, more in zip(first, noise, strict=True))


def spread_table(studies: dict[Case, NoiseStudy]) -> str:
    """Of the orders: bias and claimed error in spreads."""
    head = [
        "rig",
        "λ/μ",
        "release",
        *(f"{what} {n}" for n in ("λ", "μ") for what in ("spread of", "bias/spread,", "claimed/spread,")),
    ]
    rows = []
    for case, study in studies.items():
        row = [case.rig, f"{case.orders[0]:g}/{case.orders[1]:g}", f"{case.angle}°"]
        for name in ("lambda", "mu"):
            s = study.cells[0].unknowns.get(name)
            row += (
                ["–"] * 3
                if s is None
                else [f"{s.spread:.2g}", f"{s.bias / s.spread:+.2f}", f"{s.claimed / s.spread:.2f}"]
            )
        rows.append(row)
    return markdown(head, rows)


def markdown(head: list[str], rows: list[list[str]], texts: int = 3) -> str:
    lines = [head, ["---"] * texts + ["---:"] * (len(head) - texts), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def summary(studies: dict[Case, NoiseStudy]) -> str:
    """All cells together, and how far the worst of so many may be off by chance."""
    from scipy.stats import binom

    lines, seeds = [], next(iter(studies.values())).seeds
    groups = {
        "the orders": ("lambda", "mu"),
        "friction": ("b_", "coulomb_"),
        "initial angles": ("theta(0)", "alpha(0)"),
    }
    for what, names in groups.items():
        cells = [(s.held, s.intervals, case, s.name.split(" ")[0]) for case, study in studies.items()
                 for s in study.cells[0].unknowns.values() if s.name.startswith(names) and s.intervals]  # fmt: skip
        held, intervals = sum(c[0] for c in cells), sum(c[1] for c in cells)
        outside = [c for c in cells if not RANGE[0] <= c[0] / c[1] <= RANGE[1]]
        expected = sum(binom.cdf(math.ceil(RANGE[0] * n) - 1, n, 0.95) + binom.sf(math.floor(RANGE[1] * n), n, 0.95)
                       for _, n, *_ in cells)  # fmt: skip
        worst = min(cells, key=lambda c: binom.cdf(c[0], c[1], 0.95))
        chance = 1 - (1 - binom.cdf(worst[0], worst[1], 0.95)) ** len(cells)
        low, high = binomial95(held, intervals)
        lines.append(
            f"- **{what}**: {held} of {intervals} intervals contain the true value, {100 * held / intervals:.1f} % "
            f"({100 * low:.1f} to {100 * high:.1f} %). Outside 90 to 99 % are {len(outside)} of {len(cells)} counts; "
            f"{expected:.1f} would be by chance, were all exact. The lowest is {worst[0]} of {worst[1]} ({worst[3]} of "
            f"{worst[2].name}); the lowest of {len(cells)} exact ones is that low or lower in {100 * chance:.0f} % of "
            "such studies."
        )
    first = [held_first(study, name) for study in studies.values() for name in ("lambda", "mu")
             if name in study.problem.names]  # fmt: skip
    lines.append(f"- of the first {min(100, seeds)} repetitions of each case alone, {min(first)} to {max(first)} "
                 "hold an order.")  # fmt: skip
    for orders in ORDERS:
        cells = [study.cells[0] for case, study in studies.items() if case.orders == orders]
        called, of = sum(c.fractional or 0 for c in cells), sum(c.repetitions - c.failed for c in cells)
        lines.append(
            f"- truth of orders {orders[0]:g}/{orders[1]:g} is called fractional in {called} of {of} repetitions."
        )
    return "\n".join(lines)


def held_first(study: NoiseStudy, name: str, count: int = 100) -> int:
    """In how many of the first repetitions an order's interval contains the true value."""
    truth = study.cells[0].unknowns[name].truth
    intervals = [r["intervals"][name] for r in list(study.repetitions.values())[:count]]
    return sum(low <= truth <= high for low, high in filter(None, intervals))


def write(name: str, text: str) -> None:
    page = PAGE.read_text(encoding="utf-8")
    place = re.compile(rf"(<!-- {name}: begin -->\n).*?(<!-- {name}: end -->)", re.DOTALL)
    if not place.search(page):
        raise SystemExit(f"{PAGE} has no place for {name}")
    PAGE.write_text(place.sub(lambda found: f"{found[1]}\n{text}\n\n{found[2]}", page), encoding="utf-8")


# --- the four kinds of interval ------------------------------------------------------------------------

COLOURS = {"white": (0.0, 0.0), "AR(1), ρ = 0.9": (0.9, 0.0), "AR(1), ρ = 0.98, and as much white": (0.98, 1.0)}
"""Noise → its correlation from sample to sample, and how much white noise is added."""

METHODS = ("sandwich", "not widened", "white", "profile", "bootstrap")


def by_each_method(colour: str, seed: int) -> dict[str, dict[str, float]]:
    """Whether each kind of interval contains the true value, for one twin of 4 s at 250 Hz with 3 mrad of noise.

    And by how much the sandwich's was widened for few samples.
    """
    rig = fracid.rotary_pendulum("srv02-rotpen")
    order, empty = Free(1.0, 0.5, 1.2), np.full((1001, 2), [0.0, 0.3])
    problem = Problem(rig, (Experiment("twin", 4e-3, empty, np.zeros((1, 1))),), {"lambda": order, "mu": order},
                      initial_state="rest", substeps=2)  # fmt: skip
    truth = np.array([0.9, 0.95, 0.0, 0.3])
    twin, rng = simulated(problem, truth), np.random.default_rng(seed)
    (e,), (rho, white) = twin.experiments, COLOURS[colour]
    slow = lfilter([1], [1, -rho], rng.standard_normal((len(empty) + 500, 2)), axis=0)[500:]
    noise = 3e-3 * (math.sqrt(1 - rho**2) * slow + white * rng.standard_normal(empty.shape))
    problem = replace(twin, experiments=(replace(e, measured=e.measured + noise),))
    x = search(problem, OPTIMISERS["multistart"], rng)[0].best.point
    known, drawn = uncertainty(problem, x), bootstrap(problem, x, draws=400, seed=seed)
    profiles = profile(problem, x, parameters=list(problem.names), points=6).profiles
    held = {}
    for i, name in enumerate(problem.names):
        found = {m: known.interval(x, i, m) for m in ("sandwich", "white")}
        found |= {"bootstrap": drawn.interval(i), "profile": profiles[name].interval95}
        low, high = found["sandwich"]
        plain = (high - low) / 2 / known.widening[i]
        found["not widened"] = (x[i] - plain, x[i] + plain)
        held[name] = {m: float(low <= truth[i] <= high) for m, (low, high) in found.items()}
        held[name]["widening"] = float(known.widening[i])
    return held


def method_table(seeds: int, jobs: int) -> str:
    tasks = [Task(f"{colour}, {seed}", (colour, seed)) for colour in COLOURS for seed in range(seeds)]
    found = run_tasks(by_each_method, tasks, executor="processes", jobs=jobs, progress=shown)
    rows = []
    for colour in COLOURS:
        mine = [held for key, held in found.items() if key.rpartition(", ")[0] == colour]
        for name in ("lambda", "mu", "alpha(0) [twin]"):
            shares = [f"{100 * np.mean([held[name][m] for held in mine]):.0f} %" for m in METHODS]
            wider = np.mean([held[name]["widening"] for held in mine]) - 1
            rows.append([colour, COLUMNS[name], f"{100 * wider:.0f} %", *shares])
    return markdown(["noise", "of", "widened by", *METHODS], rows, texts=2)


# --- the run -----------------------------------------------------------------------------------------


def told(tables: dict[str, str], to_page: bool) -> None:
    for name, text in tables.items():
        print(f"\n{text}")
        if to_page:
            write(name, text)


def shown(p: Progress) -> None:
    if p.done % 50 == 0 or p.done == p.total:
        left = f", {p.left / 60:.0f} min left" if p.left else ""
        print(f"{p.done} of {p.total}, {p.rate:.1f} a second{left}", file=sys.stderr, flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=200, help="repetitions a case")
    parser.add_argument("--only", default="", help="cases whose name holds this text")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    parser.add_argument("--methods", action="store_true", help="the four kinds of interval beside each other instead")
    parser.add_argument("--write", action="store_true", help="put the tables into docs/uncertainty.md")
    asked = parser.parse_args()
    began = time.perf_counter()
    if asked.methods:
        told({"methods": method_table(asked.seeds, asked.jobs)}, asked.write)
        return
    planned_cases = plans(asked.seeds, asked.only)
    own = [[Task(f"{case.name}: {t.key}", t.arguments) for t in plan.tasks] for case, plan in planned_cases.items()]
    tasks = [task for round_ in zip(*own, strict=True) for task in round_]  # one of each case, then the next of each
    FOLDER.mkdir(parents=True, exist_ok=True)
    study = {"fracid": fracid.__version__, "level": LEVEL, "resolution": COUNT, "end": END, "only": asked.only,
             "steps": [plan.problem.substeps for plan in planned_cases.values()]}  # fmt: skip
    with Journal(FOLDER / "journal.jsonl", study) as journal:
        found = run_tasks(repetition, tasks, executor="processes", jobs=asked.jobs, journal=journal, progress=shown)
    studies = {
        case: plan.study({t.key: found[f"{case.name}: {t.key}"] for t in plan.tasks})
        for case, plan in planned_cases.items()
    }
    first, others = ({c: s for c, s in studies.items() if c.own is own} for own in (True, False))
    tables = {"coverage": coverage_table, "spread": spread_table, "summary": summary} if first else {}
    told({name: table(first) for name, table in tables.items()}, asked.write)
    told({"undithered": undithered_table(others)} if others else {}, asked.write)
    print(f"\n{len(tasks)} repetitions, {(time.perf_counter() - began) / 60:.1f} min", file=sys.stderr)


if __name__ == "__main__":
    main()
