"""Do the intervals of unedited drafts hold?  Fresh recordings through init and fit as a newcomer types them.

    python benchmarks/drafts.py                                          # 12 of each family: hours on two cores
    python benchmarks/drafts.py --families "slip 0.02" springpot --fits 8 --seed0 500 --jobs 2
    python benchmarks/drafts.py --json > drafts.json                     # every printed value beside its truth

A recording is made without fracid: by Runge-Kutta or product integration of ``independent_rigs.py``, of a mass on a
springpot by its inverse Laplace transform.  It is written as a rig writes it; ``fracid init --yes`` drafts the project,
and ``fracid fit`` takes that untouched, with default settings (the functions that both commands call, in process).
All that a draft frees scales with the gravity that it assumes, and so does the truth that it is held against.

Counted is every value that ``fit`` prints with an interval.  "as 0" are those at a bound of 0 whose truth is not 0 and
in no interval; "at bound" the same of other bounds; "given" those whose interval holds only if another value is right.
What a draft frees although the rig has no such thing and no value of it is the truth, as presliding, is only named.

Recordings and drafts stay in the folder that is named at the end, to be fitted by hand: ``fracid fit NAME-SEED.toml``.
The journal there resumes the same command; a change of fracid's code begins another folder.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from claims import code, last, shown
from independent_rigs import Rig, fractional, ordinary
from library_rigs import KINDS, Recorded, recorded

import fracid
from fracid.tasks.job import Task
from fracid.tasks.journal import Journal
from fracid.tasks.tasks import run_tasks
from fracid.workflows.draft import write_draft

FOLDER = Path(__file__).parent.parent / "runs" / "drafts"

GRID = 2e-4
"""Between the states of a simulation that are kept [s]; all samples and releases lie on it."""


@dataclass(frozen=True)
class Family:
    """What the recordings of a family have in common; the rest is drawn by seed."""

    orders: tuple[float, float] = (1.0, 1.0)
    slip: float = 0.02
    """Slip speed of dry friction [rad/s]; fracid's is 0.02."""
    arm: bool = False
    """Whether the arm moves, and is recorded."""
    noise: float = 0.0
    """Of both angles [encoder steps]; 0: 0.05°."""
    seconds: tuple[float, float] = (10.0, 20.0)
    release: tuple[float, float] = (10.0, 90.0)
    """[°]"""
    rates: tuple[int, ...] = (50, 100, 500)
    """Samples a second, in turn."""
    dry_arm: float = 0.01
    """Dry friction of the arm [N m]."""


FAMILIES = {
    **{f"slip {slip:g}": Family(slip=slip) for slip in (0.02, 0.01, 0.005, 0.002)},
    "mu 0.95": Family(orders=(1.0, 0.95)),
    "rotary": Family(arm=True, rates=(100, 250)),
    "rotary 0.9/0.95": Family(orders=(0.9, 0.95), arm=True, rates=(100, 250)),
    "undithered": Family(arm=True, noise=0.1, seconds=(18.0, 18.0), release=(10.0, 45.0), rates=(250,), dry_arm=2e-3),
    "undithered 0.9/0.95": Family(orders=(0.9, 0.95), arm=True, noise=0.1, seconds=(18.0, 18.0), release=(10.0, 45.0),
                                  rates=(250,), dry_arm=2e-3),
    "springpot": Family(rates=(50, 100)),
    **{f"library {name}": Family(rates=(50, 100, 200)) for name in KINDS},
}  # fmt: skip


# --- recordings with their truth ---------------------------------------------------------------------------------


def pendulum(family: Family, rate: int, rng: np.random.Generator, file: Path) -> dict[str, float]:
    """Write a release of a pendulum; its truth by the names of a draft."""
    rig = Rig(b_alpha=_log_uniform(rng, 4.45e-5, 3e-4), coulomb_alpha=_log_uniform(rng, 1e-4, 5e-4),
              coulomb_theta=family.dry_arm, slip_speed=family.slip)  # fmt: skip
    if not family.arm:  # held: its own inertia, and nothing that couples to it
        rig = rig._replace(C1=0.0048371, C3=0.0)
    seconds, degrees = rng.uniform(*family.seconds), rng.uniform(*family.release)
    held = family.arm or family.orders != (1.0, 1.0) or rng.uniform() < 0.5
    begin = GRID * round(rng.uniform(0.6, 1.4) / GRID) if held else 0.0
    initial = np.zeros(11)
    initial[[2, 8]] = math.radians(degrees)
    if family.orders == (1.0, 1.0):
        step = 1e-4 if family.slip >= 0.02 else 2e-5
        x = ordinary(rig, initial, step=step, end=seconds, kept=round(GRID / step))
    else:
        x = fractional(rig, initial, orders=family.orders, step=GRID, end=seconds)
    sample = np.arange(round((begin + seconds) * rate))
    at = np.maximum(sample * round(1 / rate / GRID) - round(begin / GRID), 0)
    counts = float(rng.choice([2400.0, 4096.0])) if family.noise == 0.0 else 4096.0
    count = 2 * math.pi / counts
    level = family.noise or math.radians(0.05) / count
    rest = rng.uniform(-0.5, 0.5, 2) * count  # an encoder's zero is where it was switched on
    angles = [count * np.round((x[at, s] + r) / count + level * rng.standard_normal(at.size))
              for s, r in zip((0, 2), rest, strict=True)]  # fmt: skip
    columns = {"time": sample / rate, **({"theta": angles[0]} if family.arm else {}), "alpha": angles[1]}
    write_csv(file, columns)
    names = ("C1", "C3", "C4", "C6", "J_theta", "b_theta", "b_alpha", "coulomb_theta", "coulomb_alpha", "slip_speed",
             "drag_theta", "drag_alpha", "torque_per_volt")  # fmt: skip
    return {n: getattr(rig, n) for n in names} | {
        "cable_stiffness": rig.cable, "lambda": family.orders[0], "mu": family.orders[1], "theta_rest": rest[0],
        "alpha_rest": rest[1], "release": begin, "degrees": degrees, "counts": counts, "held": float(held)}  # fmt: skip


MASS = """
from fracid import Model, Parameter
from fracid.models.joints import Complement, springpot


def rhs(t, x, u, p, out):
    force = springpot(x, out, 2, x[1], p[2])
    out[0], out[1] = x[1], (u[0] - p[1] * x[0] - force) / p[0]


model = Model(name="mass on a springpot", rhs=rhs, states=("y", "v", "z"), orders=(1.0, 1.0, Complement("nu")),
              parameters=(Parameter("m", "kg", 1.0, "mass", lower=1e-9), Parameter("k", "N/m", 1.0, "spring"),
                          Parameter("c", "N s^nu/m", 1.0, "springpot", lower=0.0)),
              outputs={"y": 0}, inputs=("F",), input_units={"F": "N"}, zero="", source="benchmarks/drafts.py")
"""

MASS_PROJECT = """
[model]
name = "mass.py:model"
[model.parameters]
m = {{ start = {m:.4g}, lower = 0.001, upper = 100.0 }}
k = {{ start = {k:.4g}, lower = 0.0, upper = 1000.0 }}
c = {{ start = {c:.4g}, lower = 0.0, upper = 1000.0 }}
[model.orders]
nu = {{ start = 0.5, lower = 0.05, upper = 0.95 }}
[[recording]]
file = "{file}"
y = {{ column = "y", unit = "m" }}
F = {{ column = "F", unit = "N" }}
[fit]
initial_state = "held"
"""


def mass(rate: int, rng: np.random.Generator, file: Path) -> dict[str, float]:
    """Write the answer of a mass on a springpot to a force of 1 N, and its project, which no draft knows."""
    m, nu = rng.uniform(0.5, 2.0), rng.uniform(0.3, 0.8)
    omega, damping = 2 * math.pi * rng.uniform(0.5, 2.0), rng.uniform(0.03, 0.3)
    k, c = m * omega**2, 2 * damping * m * omega ** (2 - nu)
    time_ = np.arange(round(rng.uniform(8, 15) * rate)) / rate
    y = step_response(m, c, k, nu, time_)
    write_csv(file, {"time": time_, "F": np.ones(time_.size), "y": y + 0.01 / k * rng.standard_normal(time_.size)})
    truth = {"m": m, "k": k, "c": c, "nu": nu}
    (file.parent / "mass.py").write_text(MASS, encoding="utf-8")
    off = {n: truth[n] * rng.uniform(0.7, 1.4) for n in ("m", "k", "c")}
    file.with_suffix(".toml").write_text(MASS_PROJECT.format(file=file.name, **off), encoding="utf-8")
    return truth


def step_response(m: float, c: float, k: float, nu: float, time_: np.ndarray) -> np.ndarray:
    """Inverse Laplace transform of 1/(s D(s)), D = m s² + c s^ν + k: pole at 0, the pair of poles, the cut s < 0.

    >>> t = np.linspace(0.0, 9.0, 4)
    >>> dashpot = (1 - np.exp(-t) * (np.cos(2 * t) + np.sin(2 * t) / 2)) / 5
    >>> bool(np.allclose(step_response(1.0, 2.0, 5.0, 1 - 1e-9, t), dashpot))
    True
    """
    p = 1j * math.sqrt(k / m) - 1e-3
    for _ in range(100):  # Newton's method
        p -= (m * p * p + c * p**nu + k) / (2 * m * p + nu * c * p ** (nu - 1))
    pair = 2 * (np.exp(p * time_) / (p * (2 * m * p + nu * c * p ** (nu - 1)))).real
    u = np.arange(-60.0 / nu if nu > 0.1 else -90.0, 25.0, 0.02)  # the cut, s = −exp(u); 1e-26 at its ends
    r = np.exp(u)
    density = -(1 / (-(m * r * r + c * r**nu * np.exp(1j * math.pi * nu) + k))).imag / math.pi
    cut = np.array([np.sum(np.exp(-r * t) * density) * 0.02 for t in time_])
    return 1 / k + pair + cut


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(math.log(low), math.log(high))))


def write_csv(file: Path, columns: dict[str, np.ndarray]) -> None:
    np.savetxt(file, np.column_stack([*columns.values()]), delimiter=",", header=",".join(columns), comments="",
               fmt="%.9g", encoding="utf-8")  # fmt: skip


# --- through fracid ----------------------------------------------------------------------------------------------


def answer(name: str, seed: int, folder: str) -> dict[str, Any]:
    """Record, draft and fit; all that is printed beside its truth."""
    family, began = FAMILIES[name], time.process_time()
    rng = np.random.default_rng([seed, *name.encode()])
    rate = family.rates[seed % len(family.rates)]
    file = Path(folder) / f"{name.replace(' ', '-').replace('/', '-')}-{seed}.csv"
    own, library = name == "springpot", recorded_in(name, rate, rng, file)
    made = mass(rate, rng, file) if own else library.truth if library else pendulum(family, rate, rng, file)
    truth = {"lambda": 1.0, "mu": 1.0, "q": 1.0} | {n: float(v) for n, v in made.items()}
    out: dict[str, Any] = {"family": name, "seed": seed, "rate": rate, "truth": truth, "file": file.stem}
    try:
        if not own:
            write_draft(file, file.with_suffix(".toml"), None, model=library and library.model)
        project = fracid.load_project(file.with_suffix(".toml"), trust=own)
        fit = fracid.identify(project).to_json()
    except Exception as error:  # a fit that fails is counted, and the next one made
        return out | {"failed": f"{type(error).__name__}: {last(str(error))}", "seconds": time.process_time() - began}
    (recording,) = fit["recordings"].values()
    gauge, scaled = library.gauge if library else ("C4", SCALED)
    if gauge and not own:
        truth |= as_drafted(truth, gauge, scaled, fit["parameters"][gauge]["value"])
    if "release" in truth:
        truth["release_time"] = truth["release"] - recording["from"]
    printed = {**fit["orders"], **fit["parameters"], **recording["parameters"]}
    values = {n: valued(e, truth[n]) for n, e in printed.items() if e["free"] and n in truth}
    unknown = [n for n, e in printed.items() if e["free"] and n not in truth]
    return out | {"values": values, "unknown": unknown, "claim": fit["claim"], "substeps": fit["substeps"],
                  "seconds": time.process_time() - began}  # fmt: skip


SCALED = ("C1", "C3", "C4", "C6", "J_theta", "b_theta", "b_alpha", "coulomb_theta", "coulomb_alpha", "drag_theta",
          "drag_alpha", "torque_per_volt", "cable_stiffness")  # fmt: skip


def as_drafted(truth: dict[str, float], gauge: str, scaled: Iterable[str], value: float) -> dict[str, float]:
    """The truth for the gravity of the draft."""
    return {n: value / truth[gauge] * truth[n] for n in scaled if n in truth}


def recorded_in(name: str, rate: int, rng: np.random.Generator, file: Path) -> Recorded | None:
    """A recording of a model of the library, written; None for another family."""
    if not name.startswith("library "):
        return None
    made = recorded(name.removeprefix("library "), rate, rng)
    write_csv(file, made.columns)
    return made


def valued(e: dict[str, Any], truth: float) -> dict[str, Any]:
    """What is printed of one value; its miss in half-widths, negative where the value is below the truth."""
    value, interval = e["value"] if e["bound"] is None else e["bound"], e["interval95"]
    out = {"value": value, "truth": truth, "interval95": interval, "bound": e["bound"],
           "given": "given that" in e["reason"], "identifiable": e["identifiable"]}  # fmt: skip
    if interval is None:
        return out
    half = interval[1] - value if truth > value else value - interval[0]
    half = half if half > 0 else (interval[1] - interval[0]) / 2  # a one-sided one
    return out | {"holds": interval[0] <= truth <= interval[1], "miss": (value - truth) / half}


# --- tables ------------------------------------------------------------------------------------------------------


def wrongly_bound(v: dict[str, Any]) -> bool:
    """Whether it is printed as its bound, which is not the truth, and no interval has it."""
    return v["bound"] is not None and v["truth"] != v["bound"] and not v.get("holds", False)


def whole(a: dict[str, Any]) -> bool:
    """Whether every printed interval of a fit holds, and nothing is wrongly printed as its bound."""
    return all(v.get("holds", True) and not wrongly_bound(v) for v in a["values"].values())


def share(values: list[dict[str, Any]]) -> str:
    with_one = [v for v in values if v["interval95"] is not None]
    held = sum(v["holds"] for v in with_one)
    return f"{held}/{len(with_one)} {100 * held / len(with_one):.0f} %" if with_one else "–"


def tables(answers: Iterable[dict[str, Any]]) -> str:
    """A line a family and rate, then a line a family and value."""
    groups: dict[tuple[str, int], list[dict[str, Any]]] = {}
    for a in answers:
        groups.setdefault((a["family"], a["rate"]), []).append(a)
    head = ["family", "rate", "fits", "failed", "all hold", "intervals hold", "worst miss", "of", "given", "as 0",
            "at bound", "none", "s a fit"]  # fmt: skip
    lines = [head, *(fits_line(*key, mine) for key, mine in groups.items())]
    lines.append(fits_line("all", 0, [a for mine in groups.values() for a in mine]))
    by_value: dict[str, dict[str, list[dict[str, Any]]]] = {}
    for (family, _), mine in groups.items():
        for a in mine:
            for name, v in a.get("values", {}).items():
                by_value.setdefault(name, {}).setdefault(family, []).append(v)
    families = list(dict.fromkeys(family for family, _ in groups))
    coverage = [["value", *families]]
    coverage += [[name, *(share(found.get(f, [])) for f in families)] for name, found in by_value.items()]
    return f"{aligned(lines)}\n\nIntervals that contain the true value:\n{aligned(coverage)}"


def fits_line(family: str, rate: int, mine: list[dict[str, Any]]) -> list[str]:
    done = [a for a in mine if "values" in a]
    values = [(f"{n}, seed {a['seed']}", v) for a in done for n, v in a["values"].items()]
    worst = max((v for v in values if "miss" in v[1]), key=lambda v: abs(v[1]["miss"]), default=("", {"miss": 0.0}))
    wrong = [v for _, v in values if wrongly_bound(v)]
    zero = sum(v["bound"] == 0 for v in wrong)
    none = sum(v["interval95"] is None and v["bound"] is None for _, v in values)
    counts = (len(mine), len(mine) - len(done), sum(map(whole, done)))
    return [family, f"{rate} Hz" if rate else "", *map(str, counts),
            share([v for _, v in values]), f"{worst[1]['miss']:+.1f}", worst[0],
            str(sum(v["given"] and v["interval95"] is not None for _, v in values)), str(zero), str(len(wrong) - zero),
            str(none), f"{np.mean([a['seconds'] for a in mine]):.0f}"]  # fmt: skip


def aligned(rows: list[list[str]]) -> str:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    rows = [rows[0], ["-" * w for w in widths], *rows[1:]]
    return "\n".join(
        "| " + " | ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)) + " |" for row in rows
    )


def misses(answers: Iterable[dict[str, Any]]) -> str:
    """Each value that is wrong, worst first."""
    wrong = [(a, n, v) for a in answers for n, v in a.get("values", {}).items()
             if wrongly_bound(v) or not v.get("holds", True)]  # fmt: skip
    wrong.sort(key=lambda w: -abs(w[2].get("miss", math.inf)))
    lines = []
    for a, n, v in wrong:
        what = f"{v['miss']:+.1f} half-widths off" if "miss" in v else "no interval"
        given = ", given that" if v["given"] else ""
        bound = ", as its bound" if v["bound"] is not None else ""
        more = f"; the draft frees {', '.join(a['unknown'])}" if a["unknown"] else ""
        lines.append(f"{a['file']}, {a['rate']} Hz: {n} = {v['value']:.6g}, truth {v['truth']:.6g}: "
                     f"{what}{given}{bound}{more}")  # fmt: skip
    lines += [f"{a['file']}: {a['failed']}" for a in answers if "failed" in a]
    return "\n".join(lines)


# --- the run -----------------------------------------------------------------------------------------------------


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--families", nargs="*", default=list(FAMILIES), choices=FAMILIES, metavar="NAME",
                        help=", ".join(FAMILIES))  # fmt: skip
    parser.add_argument("--fits", type=int, default=12, help="of each family")
    parser.add_argument("--seed0", type=int, default=1, help="the first seed")
    parser.add_argument("--jobs", type=int, default=2, help="processes, of one thread each")
    parser.add_argument("--out", type=Path, default=FOLDER, help="folder for recordings, drafts and journal")
    parser.add_argument("--json", action="store_true", help="all answers as JSON on standard output")
    asked = parser.parse_args()
    study = {"code": code(), "drafts": hashlib.sha256(Path(__file__).read_bytes()).hexdigest()}
    folder = asked.out.resolve() / hashlib.sha256(json.dumps(study).encode()).hexdigest()[:12]
    folder.mkdir(parents=True, exist_ok=True)
    seeds = range(asked.seed0, asked.seed0 + asked.fits)
    tasks = [Task(f"{name} {seed}", (name, seed, str(folder))) for seed in seeds for name in asked.families]
    with Journal(folder / "journal.jsonl", study) as journal:
        answers = [*run_tasks(answer, tasks, executor="processes", jobs=asked.jobs, journal=journal,
                              progress=shown).values()]  # fmt: skip
    answers.sort(key=lambda a: (list(FAMILIES).index(a["family"]), a["rate"], a["seed"]))
    print(f"{tables(answers)}\n\n{misses(answers)}\n\n{folder}", file=sys.stderr if asked.json else sys.stdout)
    if asked.json:
        print(json.dumps(answers, indent=1))


if __name__ == "__main__":
    main()
