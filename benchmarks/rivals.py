"""Whose 95 % intervals hold, and who claims what is not so?  fracid, SciPy, MuJoCo on the same files: ``make rivals``.

    python benchmarks/rivals.py                        # four recordings of each truth; goes on where it was cut short
    python benchmarks/rivals.py --draws 10 --jobs 2 --write      # and puts the table into docs/honesty.md
    python benchmarks/rivals.py --truths "right" "coloured noise"

A truth is a pendulum whose pivot is held and which is let go at the first sample, by ``independent_rigs.py``, which
shares no code with any of the three: 10 s at 250 Hz, 4096 counts, 0.05° of noise.  Each of them gets the same file:

=======  ===============================================================================================================
fracid   ``init`` and ``fit`` as a newcomer types them: the untouched draft, default settings
SciPy    ``least_squares`` on fracid's simulation, two steps a sample, from that draft's start within its bounds;
         intervals by σ²(JᵀJ)⁻¹; an order is called fractional where its interval excludes 1
MuJoCo   ``mujoco.sysid``: ``optimize`` and ``calculate_intervals`` with their defaults, of a hinge with ``armature``,
         ``damping`` and ``frictionloss``, Runge-Kutta, steps of 2 ms; the first angle and the encoder's zero are free
         by its hooks.  It has no orders, so it cannot claim any.  Without dry friction its motion is that of the truth
         to 1e-8 rad; its dry friction is a soft constraint, which leaves 2e-3 rad of a release like these
=======  ===============================================================================================================

Constants are the pendulum's inertia, viscous and dry friction, gravity being given.  Where the truth has more than the
model, an interval that misses them claims what is not so; whether a doubt is said beside it is counted too.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import re
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from claims import code, shown
from drafts import as_drafted, valued, write_csv, wrongly_bound
from independent_rigs import KINDS, Rig, Sensor, Twin, _motion, _read
from mujoco import sysid
from scipy.optimize import least_squares
from scipy.signal import lfilter

import fracid
from fracid.problem import Experiment, Free, Problem
from fracid.tasks.job import Task
from fracid.tasks.journal import Journal
from fracid.tasks.tasks import run_tasks
from fracid.workflows.draft import write_draft

ROOT = Path(__file__).parent.parent
PAGE, FOLDER = ROOT / "docs" / "honesty.md", ROOT / "runs" / "rivals"

RATE, SECONDS = 250, 10.0
CONSTANTS = ("C1", "b_alpha", "coulomb_alpha")

TRUTHS: dict[str, tuple[tuple[str, float], ...]] = {
    "right": (("none", 1.0),),
    "friction that the model lacks": (("stribeck", 1.0), ("eccentric", 0.5), ("fading", -1.5), ("drag", 20.0)),
    "a sensor that the model lacks": (("alpha-lowpass", 20.0), ("gain", 2.0), ("jitter", 2.0)),
    "coloured noise": (("coloured", 0.95),),
    "order 0.95": (("order", 0.95),),
}
"""Truth → the kinds of ``independent_rigs.py`` and their severities; ``coloured`` and ``order`` are from here."""


# --- the recordings -----------------------------------------------------------------------------------------------


def recorded(kind: str, severity: float, seed: int, file: Path) -> dict[str, float]:
    """Write a release; its truth by the names of a draft."""
    rng = np.random.default_rng([seed, *kind.encode()])
    friction = np.exp(rng.uniform(np.log([1e-4, 1e-4]), np.log([4e-4, 4e-4])))
    rig = Rig(C1=0.0048371 * math.exp(0.05 * rng.standard_normal()), C3=0.0, b_alpha=float(friction[0]),
              coulomb_alpha=float(friction[1]))  # fmt: skip
    noise = math.radians(0.05) * 4096 / (2 * math.pi)
    orders = (1.0, severity if kind == "order" else 1.0)
    twin = Twin(rig, Sensor(noise=0.0 if kind == "coloured" else noise, dither=True), orders, seed=seed)
    twin = KINDS[kind].make(twin, severity) if kind in KINDS else twin
    release = math.radians(rng.uniform(25.0, 60.0))
    time = np.arange(round(SECONDS * RATE)) / RATE
    motion, step = _motion(twin, release, time[-1], None, 1 / RATE)
    if kind == "coloured":  # as much in all, one sample like the next
        colour = lfilter([math.sqrt(1 - severity**2)], [1.0, -severity], rng.standard_normal(time.size + 999))[999:]
        motion = motion.copy()
        every = round(1 / RATE / step)
        motion[: every * time.size, [2, 8]] += math.radians(0.05) * np.repeat(colour, every)[: len(motion), None]
        motion[:, 3] = np.gradient(motion[:, 2], step)  # what is read between samples
    alpha = _read(twin, motion, step, time, rng)[1]
    write_csv(file, {"time": time, "alpha": alpha})
    return {n: float(getattr(rig, n)) for n in ("C1", "C4", "b_alpha", "coulomb_alpha")} | {"mu": orders[1]}


# --- the three -----------------------------------------------------------------------------------------------------

Found = dict[str, Any]
"""Name → value and interval95, as in a result.json."""


def by_fracid(project: Any) -> tuple[Found, str, bool]:
    """Values, the claim, and whether a doubt is said."""
    fit = fracid.identify(project).to_json()
    return {**fit["orders"], **fit["parameters"]}, fit["claim"], bool(fit["warnings"])


def by_scipy(problem: Problem) -> Found:
    """The order and the constants by least squares, from the draft's start, with the intervals of a textbook."""
    free = {
        n: Free(0.0, -0.05, 0.05) if n == "alpha_rest" else problem.parameters[n] for n in (*CONSTANTS, "alpha_rest")
    }
    release = Experiment("release", 1 / RATE, problem.experiments[0].measured, np.zeros((1, 1)))
    model = fracid.rotary_pendulum("srv02-rotpen").with_parameters(C3=0.0, C4=_value(problem, "C4"))
    finer = Problem(model, (release,), problem.orders, free, outputs=("alpha",), initial_state="rest", substeps=2)
    bounds = np.array([finer.space.lower, finer.space.upper])

    def residual(x: np.ndarray) -> np.ndarray:
        r = np.concatenate([np.ravel(e) for e in finer.errors(x)])
        return np.where(np.isfinite(r), r, 1e3)

    found = least_squares(residual, finer.start, bounds=bounds, x_scale="jac")
    n, p = found.jac.shape
    half = 1.96 * np.sqrt(np.diag(np.linalg.pinv(found.jac.T @ found.jac)) * 2 * found.cost / (n - p))
    return {name: _entry(x, h) for name, x, h in zip(finer.names, found.x.tolist(), half.tolist(), strict=True)}


def _value(problem: Problem, name: str) -> float:
    value = problem.parameters.get(name, problem.model.parameter(name).value)
    return float(value)


def _entry(value: float, half: float) -> dict[str, Any]:
    return {"value": value, "interval95": (value - half, value + half) if math.isfinite(half) else None, "bound": None,
            "reason": "", "identifiable": "", "free": True}  # fmt: skip


ARM, MASS = 0.05, Rig().C4 / 9.81 / 0.05
HINGE = f"""
<mujoco>
  <option timestep="0.002" integrator="RK4" gravity="0 0 -9.81"><flag contact="disable"/></option>
  <worldbody><body name="pendulum">
    <joint name="alpha" type="hinge" axis="0 1 0"/>
    <inertial pos="0 0 {-ARM}" mass="{MASS}" diaginertia="1e-6 1e-6 1e-6"/>
  </body></worldbody>
  <actuator><motor name="none" joint="alpha"/></actuator>
  <sensor><jointpos name="alpha" joint="alpha"/></sensor>
</mujoco>"""

SCALE = {"C1": 0.005, "b_alpha": 3e-4, "coulomb_alpha": 3e-4, "alpha(0)": 1.0, "alpha_rest": 0.01}
"""The unknowns that MuJoCo gets are these to be multiplied, so that its step of differences suits all."""


def by_mujoco(file: Path) -> Found:
    """A hinge through MuJoCo's own system identification."""
    time, alpha = np.loadtxt(file, delimiter=",", skiprows=1).T
    spec = mujoco.MjSpec.from_string(HINGE)
    model = spec.compile()
    own = MASS * ARM**2 + 1e-6

    def armature(s: mujoco.MjSpec, p: sysid.Parameter) -> None:
        s.joint("alpha").armature = SCALE["C1"] * p.value[0] - own

    def damping(s: mujoco.MjSpec, p: sysid.Parameter) -> None:
        s.joint("alpha").damping = [SCALE["b_alpha"] * p.value[0], 0.0, 0.0]  # linear, then of higher powers

    def frictionloss(s: mujoco.MjSpec, p: sysid.Parameter) -> None:
        s.joint("alpha").frictionloss = SCALE["coulomb_alpha"] * p.value[0]

    params = sysid.ParameterDict()
    rows = (("C1", 1.0, 0.5, 5.0, armature), ("b_alpha", 1.0, 0.0, 50.0, damping),
            ("coulomb_alpha", 1.0, 0.0, 50.0, frictionloss), ("alpha(0)", alpha[0], -2.0, 2.0, None),
            ("alpha_rest", 0.0, -10.0, 10.0, None))  # fmt: skip
    for name, start, low, high, modifier in rows:
        params.add(sysid.Parameter(name, float(start), low, high, modifier=modifier))

    def from_angle(*, param_dicts: Any, **more: Any) -> Any:
        starts = [sysid.create_initial_state(m, p["alpha(0)"].value)
                  for m, p in zip(more["models"], param_dicts, strict=True)]  # fmt: skip
        return sysid.sysid_rollout(**more | {"initial_states": starts})

    def from_zero(p: Any, predicted: Any, measured: Any, *_: Any, state: Any, **__: Any) -> Any:
        """The states' angles: what a sensor says after a step is from before it."""
        later = sysid.TimeSeries(measured.times[1:], measured.data[1:], measured.signal_mapping)
        angle = np.interp(later.times, state[:, 0], state[:, 1])[:, None] + SCALE["alpha_rest"] * p["alpha_rest"].value
        return angle - later.data, sysid.TimeSeries(later.times, angle, predicted.signal_mapping), later

    sequences = sysid.ModelSequences(
        "release", spec, "release", sysid.create_initial_state(model, alpha[:1]),
        sysid.TimeSeries(time, np.zeros((time.size, 1))),
        sysid.TimeSeries.from_names(time, alpha[:, None], model, ["alpha"]),
    )  # fmt: skip
    residual = sysid.build_residual_fn(models_sequences=[sequences], custom_rollout=from_angle,
                                       modify_residual=from_zero, n_threads=1)  # fmt: skip
    with redirect_stdout(StringIO()):  # it prints each step
        found, result = sysid.optimize(params, residual, verbose=False)
    left = residual(result.x, found)[0]
    _, half = sysid.calculate_intervals(left, result.jac)
    return {
        n: _entry(SCALE[n] * x, SCALE[n] * h) for n, x, h in zip(SCALE, result.x.tolist(), half.tolist(), strict=True)
    }


# --- one file to all three -----------------------------------------------------------------------------------------


def answer(kind: str, severity: float, seed: int, folder: str) -> dict[str, Any]:
    """What each of the three finds in one file, beside its truth."""
    file = Path(folder) / f"{kind}-{severity:g}-{seed}.csv"
    truth = recorded(kind, severity, seed, file)
    write_draft(file, file.with_suffix(".toml"), None)
    project = fracid.load_project(file.with_suffix(".toml"))
    own, claim, doubt = by_fracid(project)
    truth |= {n: v for n, v in as_drafted(truth, own["C4"]["value"]).items() if n in truth}
    return {"kind": kind, "seed": seed, "claim": claim, "doubt": doubt,
            "fracid": beside(own, truth), "scipy": beside(by_scipy(project.problem), truth),
            "mujoco": beside(by_mujoco(file), truth)}  # fmt: skip


def beside(found: Found, truth: dict[str, float]) -> dict[str, Any]:
    """The constants and the order, each beside its truth."""
    return {n: valued(found[n], truth[n]) for n in (*CONSTANTS, "mu") if n in found}


# --- the table -------------------------------------------------------------------------------------------------------


def fractional(v: dict[str, Any]) -> bool:
    """What a user of intervals alone concludes: the order is not 1."""
    return v["interval95"] is not None and not v["interval95"][0] <= 1.0 <= v["interval95"][1]


def held(answers: list[dict[str, Any]], tool: str, names: tuple[str, ...]) -> str:
    """Of the intervals, and of what is printed as its bound: that has none, and is wrong where it is not the truth."""
    said = [v for a in answers for n, v in a[tool].items() if n in names]
    with_one = [v for v in said if v["interval95"] is not None or v["bound"] is not None]
    count = sum(v.get("holds", not wrongly_bound(v)) for v in with_one)
    return f"{100 * count / len(with_one):.0f} % of {len(with_one)}" if with_one else "–"


def row(truth: str, mine: list[dict[str, Any]]) -> list[str]:
    of = len(mine)
    called = {"fracid": sum(a["claim"] == "fractional" for a in mine),
              "scipy": sum(fractional(a["scipy"]["mu"]) for a in mine)}  # fmt: skip
    wrong = truth != "order 0.95"
    cells = [f"**{n}** of {of}" if wrong and n else f"{n} of {of}" for n in called.values()]
    return [truth, *(held(mine, tool, CONSTANTS) for tool in ("fracid", "scipy", "mujoco")),
            *(held(mine, tool, ("mu",)) for tool in ("fracid", "scipy")), *cells,
            f"{sum(a['doubt'] for a in mine)} of {of}"]  # fmt: skip


def table(answers: list[dict[str, Any]]) -> str:
    """Coverage and false claims beside each other, in Markdown."""
    head = ["truth", "constants held: fracid", "SciPy", "MuJoCo", "order held: fracid", "SciPy",
            "called fractional: fracid", "SciPy", "a doubt is said: fracid"]  # fmt: skip
    rows = [head, ["---", *["---:"] * (len(head) - 1)]]
    for truth, kinds in TRUTHS.items():
        mine = [a for a in answers if a["kind"] in dict(kinds)]
        rows += [row(truth, mine)] if mine else []
    return "\n".join(f"| {' | '.join(cells)} |" for cells in rows)


ABOVE = """**Beside others.** `make rivals` gives the same files to fracid, to SciPy's `least_squares` with intervals by
σ²(JᵀJ)⁻¹, and to `mujoco.sysid`: pendulums with a held pivot, recorded by code of their own, 10 s at 250 Hz. Of each is
counted how many 95 % intervals of inertia and friction, and of the order, contain the true value, and how often an
order is called fractional; what is bold is false. MuJoCo has no orders, and its dry friction is a soft constraint."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--truths", nargs="*", default=list(TRUTHS), choices=TRUTHS, metavar="TRUTH",
                        help=", ".join(TRUTHS))  # fmt: skip
    parser.add_argument("--draws", type=int, default=4, help="recordings of each kind; thrice that of one alone")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--out", type=Path, default=FOLDER, help="folder for recordings, drafts and journal")
    parser.add_argument("--write", action="store_true", help="put the table into docs/honesty.md")
    asked = parser.parse_args()
    own = [Path(__file__), Path(__file__).with_name("drafts.py")]
    study = {"code": code(), "rivals": hashlib.sha256(b"".join(p.read_bytes() for p in own)).hexdigest()}
    folder = asked.out.resolve() / hashlib.sha256(json.dumps(study).encode()).hexdigest()[:12]
    folder.mkdir(parents=True, exist_ok=True)
    kinds = {name: kinds for name, kinds in TRUTHS.items() if name in asked.truths}
    tasks = [Task(f"{kind} {severity:g} {seed}", (kind, severity, seed, str(folder))) for one in kinds.values()
             for kind, severity in one for seed in range(1, asked.draws * (3 if len(one) == 1 else 1) + 1)]  # fmt: skip
    with Journal(folder / "journal.jsonl", study) as journal:
        answers = [*run_tasks(answer, tasks, executor="processes", jobs=asked.jobs, journal=journal,
                              progress=shown).values()]  # fmt: skip
    text = table(answers)
    print(f"{text}\n\n{folder}")
    if asked.write:
        page = PAGE.read_text(encoding="utf-8")
        place = re.compile(r"(<!-- beside others: begin -->\n).*?(<!-- beside others: end -->)", re.DOTALL)
        PAGE.write_text(place.sub(lambda at: f"{at[1]}\n{ABOVE}\n\n{text}\n\n{at[2]}", page), encoding="utf-8")


if __name__ == "__main__":
    main()
