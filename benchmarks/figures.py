"""Draw each figure of docs/figures.md, models.md and examples.md into docs/images:  python benchmarks/figures.py [NAME]

Two minutes; of simulated recordings, so that everyone can draw them again: the reference twin that fracid ships, a
pendulum that swings alone with dry friction, and a release whose first second is missing.  The pictures are for a page,
in 128 colours; ``fracid draw`` and ``fracid.plots.save`` write those for a paper.
"""

from __future__ import annotations

import io
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

import fracid
from fracid import plots
from fracid.export.state_space import integer_model
from fracid.models.library import MODEL
from fracid.units import shown_unit

ROOT = Path(__file__).parent.parent
IMAGES = ROOT / "docs" / "images"
TWIN = Path(fracid.__file__).parent / "twins" / "reference-twin.toml"
EXAMPLES = ("duffing", "flexible-link", "simulate", "supercapacitor")
WIDTH = 900
"""Of a picture [pixels]."""


@cache
def twin() -> fracid.Fit:
    """The reference twin, fitted from six starts."""
    return fracid.identify(fracid.load_project(TWIN), starts=6, jobs=2)


def swing(angle: float, seed: int) -> fracid.Experiment:
    """A pendulum alone, let go at rest, with dry friction, noise and an encoder of 4096 counts a turn."""
    rig = fracid.rotary_pendulum("stepper-freeswing", coulomb_alpha=1.5e-4)
    run = fracid.simulate(rig, orders={"lambda": 1.0, "mu": 1.0}, initial={"alpha": angle}, step=5e-3, end=8.0)
    noisy = run.states[:, 2] + 1e-3 * np.random.default_rng(seed).standard_normal(len(run.time))
    count = 2 * np.pi / 4096
    return fracid.Experiment(f"from {np.degrees(angle):.0f}°", 5e-3, count * np.round(noisy[:, None] / count),
                             np.zeros((1, 1)), initial={"alpha": angle})  # fmt: skip


@cache
def compared() -> fracid.Comparison:
    """The ladder for a pendulum that has dry friction and order 1."""
    rig = fracid.rotary_pendulum("stepper-freeswing")
    orders = {"lambda": 1.0, "mu": fracid.Free(1.0, 0.6, 1.4)}
    problem = fracid.Problem(rig, (swing(0.9, 1),), orders, {"C1": fracid.Free(9.8e-5, 5e-5, 2e-4)},
                             outputs=("alpha",), initial_state="held")  # fmt: skip
    return fracid.compare(problem, validation=(swing(0.4, 2),), amplitude=True, jobs=2)


@cache
def begun_late() -> fracid.Fit:
    """A release whose first second was not recorded, and how far the orders move with where the record begins."""
    rig, orders = fracid.rotary_pendulum("srv02-rotpen", b_alpha=3e-4), {"lambda": 0.95, "mu": 0.92}
    run = fracid.simulate(rig, orders=orders, initial={"alpha": 0.6}, step=2e-3, end=9.0)
    noise = 2e-3 * np.random.default_rng(3).standard_normal((4501, 2))
    late = fracid.Experiment("begun late", 2e-3, (run.states[:, [0, 2]] + noise)[500:], np.zeros((1, 1)))
    free = fracid.Free(1.0, 0.5, 1.2)
    return fracid.identify(fracid.Problem(rig, (late,), {"lambda": free, "mu": free}), cut=True, jobs=2)


@cache
def studied() -> fracid.NoiseStudy:
    """Three levels of noise, with and without an encoder."""
    rig = fracid.rotary_pendulum("srv02-rotpen", b_alpha=2e-4)
    release = fracid.Experiment(
        "release", 4e-3, np.zeros((1501, 2)), np.zeros((1, 1)), initial={"theta": 0.0, "alpha": 0.5}
    )
    free = fracid.Free(1.0, 0.5, 1.2)
    problem = fracid.Problem(rig, (release,), {"lambda": free, "mu": free}, initial_state="held")
    return fracid.noise_study(problem, np.array([0.9, 0.95]), levels=[1e-3, 3e-3, 1e-2], seeds=20, jobs=2,
                              resolutions=[0.0, 2 * np.pi / 1024])  # fmt: skip


@cache
def drawn() -> fracid.Posterior:
    """The posterior of a pendulum with dry friction and no drag: the drag lies at its bound."""
    free = {"b_alpha": (1e-5, 0.0, 1e-3), "coulomb_alpha": (1e-4, 0.0, 1e-3), "drag_alpha": (1e-6, 0.0, 1e-4)}
    problem = fracid.Problem(
        fracid.rotary_pendulum("stepper-freeswing"), (swing(0.9, 1),),
        {"lambda": 1.0, "mu": fracid.Free(1.0, 0.9, 1.1)}, {n: fracid.Free(*v) for n, v in free.items()},
        outputs=("alpha",), initial_state="held",
    )  # fmt: skip
    return fracid.posterior(problem, draws=8000, jobs=2)


def of_library(name: str) -> tuple[Figure, ...]:
    """A model's scene, where it has one, and its twin's recording."""
    twin = fracid.Twin.of_library(name)
    recording = twin.record(twin.simulate())
    shown = [n for n in (*twin.model.inputs, *twin.model.outputs) if n in recording.signals]
    curves = Figure(figsize=(7.0, 4.4) if twin.model.scene else (10.0, 3.6), layout="constrained")
    for axes, n in zip(curves.subplots(len(shown), sharex=True, squeeze=False)[:, 0], shown, strict=True):
        unit, factor = shown_unit(recording.units[n])
        axes.plot(
            recording.time, factor * recording.signals[n], color="#777777" if n in twin.model.inputs else "#0072b2"
        )
        axes.set_ylabel(f"{n} [{unit}]")
        axes.grid(alpha=0.3)
    axes.set_xlabel("time [s]")
    return (twin.model.plot(), curves) if twin.model.scene else (curves,)


def of_example(name: str) -> Image.Image:
    """What a file of examples/ draws, in a folder of its own: it writes its recording beside itself."""
    with TemporaryDirectory() as folder:
        script = Path(shutil.copy(ROOT / "examples" / f"{name.replace('-', '_')}.py", folder))
        subprocess.run([sys.executable, str(script)], check=True, stdout=subprocess.DEVNULL)
        return Image.open(script.with_suffix(".png")).convert("RGB")


FIGURES: Mapping[str, Callable[[], Figure | Image.Image | tuple[Figure, ...]]] = {
    "rig-hanging": lambda: fracid.rotary_pendulum("srv02-rotpen").plot(),
    "rig-upright": lambda: fracid.rotary_pendulum("qube-servo2", zero="upright").plot(),
    "recording": lambda: fracid.load_project(TWIN).recordings[0].plot(zero="hanging"),
    "fitted": lambda: twin().plot(),
    "fitted-journal": lambda: twin().plot(style="journal"),
    "residuals": lambda: twin().plot_residuals(),
    "residual-tests": lambda: twin().plot_residuals(tests=True),
    "cost": lambda: twin().plot_cost(jobs=2),
    "profiles": lambda: fracid.profile(twin(), joint=("lambda", "mu"), jobs=2).plot(),
    "starts": lambda: twin().plot_starts(),
    "cut": lambda: begun_late().cut.plot(),
    "ladder": lambda: compared().plot(),
    "amplitude": lambda: next(iter(compared().amplitude.values())).plot(),
    "noise": lambda: studied().plot(),
    "posterior": lambda: drawn().plot(),
    "posterior-predictive": lambda: drawn().plot_predictive(),
    "linear": lambda: plots.linear_response(integer_model(twin().problem), "hanging"),
    **{f"model-{name}": partial(of_library, name) for name in MODEL},
    **{f"example-{name}": partial(of_example, name) for name in EXAMPLES},
}
"""By the name of the picture, ``figure-NAME.png``; of an example ``example-NAME.png``."""


def path_of(name: str) -> Path:
    """Where a picture lies."""
    return IMAGES / f"{'' if name.startswith('example-') else 'figure-'}{name}.png"


def pixels(figure: Figure | Image.Image) -> Image.Image:
    """Twice as large as on a page; a picture as it is."""
    if isinstance(figure, Image.Image):
        return figure
    with io.BytesIO() as drawn:
        figure.savefig(drawn, format="png", dpi=2 * WIDTH / figure.get_figwidth())
        return Image.open(drawn).convert("RGB")


def write(figures: Figure | Image.Image | tuple[Figure, ...], path: Path) -> None:
    """Side by side, in few colours and no wider than a page: some tens of kilobytes."""
    parts = [pixels(f) for f in (figures if isinstance(figures, tuple) else (figures,))]
    height = min(p.height for p in parts)
    parts = [p.resize((round(p.width * height / p.height), height)) for p in parts]
    picture, left = Image.new("RGB", (sum(p.width for p in parts), height), "white"), 0
    for p in parts:
        picture.paste(p, (left, 0))
        left += p.width
    size = (WIDTH, round(WIDTH * picture.height / picture.width))
    picture.resize(size, Image.Resampling.LANCZOS).quantize(128, Image.Quantize.FASTOCTREE).save(path, optimize=True)


def main(wanted: list[str]) -> None:
    """Draw some, or all."""
    for name in wanted or FIGURES:
        path = path_of(name)
        write(FIGURES[name](), path)
        print(f"{path.relative_to(ROOT)}  {path.stat().st_size / 1024:.0f} kB")


if __name__ == "__main__":
    main(sys.argv[1:])
