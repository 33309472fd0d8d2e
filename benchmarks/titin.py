"""Draw the picture of docs/titin.md, and print how each model predicts the ramp that it was not fitted to.

    python benchmarks/titin.py            # a minute; writes docs/images/titin.svg

``fracid compare examples/real/titin/titin.toml --leave-one-out --trust`` gives the same in the unit of the force, with
the order's interval and the claim; here the errors stand in the standard deviations of the samples too.
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
from fracid.problem import Experiment, Problem

ROOT = Path(__file__).parent.parent
IMAGES = ROOT / "docs" / "images"
PROJECT = ROOT / "examples" / "real" / "titin" / "titin.toml"
DRAWN = {"springpot": VERMILLION, "two Maxwell elements": BLUE}
"""Predictions in the picture."""


def predicted(problem: Problem, left_out: Experiment) -> FloatArray:
    """The force over a ramp by a model that is fitted to the others, shape (n_samples,)."""
    others = replace(problem, experiments=tuple(e for e in problem.experiments if e.name != left_out.name), memo=None)
    best = refined(others, others.start, Watch()).best.point
    force = problem.fitted(best, left_out)
    if isinstance(force, Failure):
        raise SystemExit(str(force))
    return force[:, 0]


def drawing(ramps: tuple[Experiment, ...], forces: dict[tuple[str, str], FloatArray]) -> Figure:
    """Each ramp over the time since it began, beside what two models that had not seen it predict."""
    figure = Figure(figsize=(9.2, 3.2), layout="constrained")
    for axes, e in zip(figure.subplots(1, len(ramps), sharey=True), ramps, strict=True):
        assert e.deviation is not None
        t, F, sd = e.time[1:], e.measured[1:, 0], e.deviation[1:, 0]
        axes.fill_between(t, F - sd, F + sd, color="0.88", label="± standard deviation")
        axes.plot(t, F, **(MEASURED | {"ls": "", "marker": ".", "ms": 4}))
        for name, color in DRAWN.items():
            axes.plot(t, forces[name, e.name][1:], color=color, lw=1.5, label=name)
        axes.set(xscale="log", xlabel="time since the ramp began [s]", title=f"predicted: the ramp of {e.name}")
    figure.axes[0].set(ylabel="force", ylim=(-0.5, 20))
    figure.axes[-1].legend(fontsize="small", loc="upper left")
    return figure


def main() -> None:
    """Leave out each ramp in turn."""
    project = fracid.load_project(PROJECT, trust=True)
    ramps, models = project.problem.experiments, {"springpot": project.problem, **project.alternatives}
    forces = {(name, e.name): predicted(p, e) for name, p in models.items() for e in ramps}
    print(f"{'left out':34}" + "".join(f"{e.name:>16}" for e in ramps) + f"{'mean':>16}")
    for name in models:
        errors = [e.measured[:, 0] - forces[name, e.name] for e in ramps]
        deviations = [r / e.deviation[:, 0] for e, r in zip(ramps, errors, strict=True) if e.deviation is not None]
        rms = [(np.sqrt(np.mean(a**2)), np.sqrt(np.mean(b**2))) for a, b in zip(errors, deviations, strict=True)]
        rms.append(tuple(np.mean(rms, axis=0)))
        print(f"{name:34}" + "".join(f"{f'{a:.3f} ({b:.2f} SD)':>16}" for a, b in rms))
    save(drawing(ramps, forces), IMAGES, "titin", ("svg",))


if __name__ == "__main__":
    main()
