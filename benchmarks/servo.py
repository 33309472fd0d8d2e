"""Draw the picture of docs/servo.md, and print how each friction predicts the gain that it was not fitted to.

    python benchmarks/servo.py            # some minutes; writes docs/images/servo.svg

``fracid fit examples/real/xl330/xl330.toml`` gives the constants of the richest with their intervals.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import fracid
from fracid.arrays import FloatArray
from fracid.errors import Failure
from fracid.estimation.horizons import Watch, refined
from fracid.plots.appearance import BLUE, MEASURED, VERMILLION
from fracid.plots.writing import save
from fracid.problem import Free, Problem

ROOT = Path(__file__).parent.parent
IMAGES = ROOT / "docs" / "images"
PROJECT = ROOT / "examples" / "real" / "xl330" / "xl330.toml"
LOAD = Free(0.1, 0.0, 1.0)
LADDER: dict[str, dict[str, float | Free]] = {
    "viscous": {"coulomb_angle": 0.0, "load_angle": 0.0, "load_directional_angle": 0.0},
    "+ Coulomb": {"coulomb_angle": Free(0.03, 0.0, 0.5)},
    "+ load": {"load_angle": LOAD},
    "+ its direction": {"load_directional_angle": Free(0.3, -1.0, 1.0)},
    "+ Stribeck": {"stiction_angle": Free(0.01, 0.0, 0.5), "stribeck_speed_angle": Free(0.1, 0.01, 2.0)},
}
"""Rung → what it changes of the one below."""
DRAWN = {"+ Coulomb": BLUE, "+ its direction": VERMILLION}
"""Predictions in the picture."""


def fitted_to(problem: Problem, names: list[str]) -> FloatArray:
    """The minimum of these recordings alone, shape (n_unknowns,)."""
    own = replace(problem, experiments=tuple(e for e in problem.experiments if e.name in names), memo=None)
    return refined(own, own.start, Watch(2)).best.point


def angles(problem: Problem, x: FloatArray) -> dict[str, FloatArray]:
    """Recording → the angle that a run gives [rad]."""
    found = {e.name: problem.fitted(x, e) for e in problem.experiments}
    for name, angle in found.items():
        if isinstance(angle, Failure):
            raise SystemExit(f"{name}: {angle}")
    return {name: angle[:, 0] for name, angle in found.items() if not isinstance(angle, Failure)}


def main() -> None:
    """Climb the ladder, on all twelve and on the two lower gains."""
    project, friction, drawn = fracid.load_project(PROJECT), dict[str, float | Free](), {}
    problem = replace(project.problem, experiments=(*project.problem.experiments, *project.validation))
    measured = {e.name: e.measured[:, 0] for e in problem.experiments}
    lower = [n for n in measured if not n.startswith("kp 400")]
    print(f"{'mean absolute error':30}{'constants':>10}{'all twelve':>12}{'kp 100, 200':>12}{'held out':>16}")
    for rung, change in LADDER.items():
        friction |= change
        p = replace(problem, parameters=problem.parameters | friction)
        every, held_out = (angles(p, fitted_to(p, names)) for names in ([*measured], lower))
        error = [{n: 1e3 * np.mean(np.abs(measured[n] - a[n])) for n in measured} for a in (every, held_out)]
        high = [v for n, v in error[1].items() if n not in lower]
        row = [np.mean([*error[0].values()]), np.mean([error[1][n] for n in lower]), np.mean(high)]
        print(f"{rung:30}{len(p.names):>10}{row[0]:>12.1f}{row[1]:>12.1f}{row[2]:>16.1f}", flush=True)
        if rung in DRAWN:
            drawn[rung] = held_out
    figure = Figure(figsize=(9.2, 3.2), layout="constrained")
    names = [n for n in measured if n not in lower and "square" not in n]
    for axes, e in zip(figure.subplots(1, 3), [e for e in problem.experiments if e.name in names], strict=True):
        axes.plot(e.time, np.degrees(e.measured[:, 0]), **(MEASURED | {"ls": "", "marker": ".", "ms": 2}))
        for rung, color in DRAWN.items():
            axes.plot(e.time, np.degrees(drawn[rung][e.name]), color=color, lw=1.2, label=f"viscous … {rung}")
        axes.set(xlabel="time [s]", title=e.name)
    figure.axes[0].set(ylabel="angle [°]")
    figure.axes[-1].legend(fontsize="small")
    save(figure, IMAGES, "servo", ("svg",))


if __name__ == "__main__":
    main()
