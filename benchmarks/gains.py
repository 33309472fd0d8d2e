"""Does a design rank real recordings as they turn out?  Those of an SRV02, each added to each other one.

    python benchmarks/gains.py               # two minutes
    python benchmarks/gains.py --bounded     # viscous frictions cannot be negative

Three recordings of one rig are fitted alone, with the model of ``examples/srv02-release.toml`` without drag: a release
from 92°, one from 16°, and a pulse of 10 V.  From values and noise of each fit the machinery of :func:`fracid.design`
predicts how the intervals narrow if one of the others is added, of which it knows what one knows beforehand: angle or
voltage, duration and rate.  Then both are fitted together.  A *gain* is the interval before over the interval after;
that of λ and μ together is the geometric mean over the axes of their joint region, as the criterion Ds has it.

Intervals are widened for few effective samples (docs/uncertainty.md), which a plan does not predict: the last number is
the realised gain without.  The recordings come from FRACID_RECORDINGS or ../shared/recordings.
"""

import argparse
import itertools
import math
import os
import re
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import fracid
from fracid.errors import Failure
from fracid.estimation.covariance import Uncertainty, uncertainty
from fracid.estimation.search import search
from fracid.experiments.choice import VAGUE, informations
from fracid.experiments.information import Information
from fracid.experiments.space import Candidate, DesignSpace
from fracid.experiments.subject import subject_of_problem
from fracid.optimise import optimiser_from_name
from fracid.quantiles import NORMAL_95
from fracid.tasks.job import one_blas_thread

ROOT = Path(__file__).parent.parent
RECORDINGS = Path(os.environ.get("FRACID_RECORDINGS", ROOT.parent / "shared" / "recordings"))

RELEASE = 'from = "release"\nto = {to}\nrelease_time = {{ start = 0.0, lower = -0.05, upper = 0.05 }}\n'
PULSE = 'to = {to}\nvoltage = {{ column = 3, unit = "V" }}\n'

KINDS = {
    "92°": ("release_92deg", RELEASE.format(to=44.85), 92.0),
    "16°": ("release_16deg", RELEASE.format(to=42.0), 16.0),
    "10 V": ("pulse_10V", PULSE.format(to=35.0), 0.0),
}
"""Recording → its file, its lines of the project, and the angle that it is released from [°]."""

NAMES = ("lambda", "mu", "b_theta", "b_alpha", "coulomb_theta", "coulomb_alpha")

BOTH = "λ, μ"

BLOCKS = {n: (n,) for n in NAMES} | {BOTH: ("lambda", "mu")}
"""What a gain is of."""

MODEL = """
[model]
name = "rotary-pendulum"
rig  = "srv02-rotpen"
zero = "hanging"

[model.parameters]
C1      = { start = 4.27e-3, lower = 1e-3, upper = 1e-2 }
C3      = { start = 4.27e-3, lower = 1e-3, upper = 2e-2 }
C6      = { start = 4.27e-3, lower = 1e-3, upper = 2e-2 }
J_theta = { start = 1.0e-2,  lower = 1e-3, upper = 1e-1 }
b_theta         = { start = 2.4e-3, lower = -1.0,  upper = 1.0 }
b_alpha         = { start = 2.0e-4, lower = -1e-2, upper = 1e-2 }
coulomb_theta   = { start = 1.0e-2, lower = 0.0,   upper = 0.1 }
coulomb_alpha   = { start = 1.0e-4, lower = 0.0,   upper = 1e-2 }
cable_stiffness = { start = 1.0e-2, lower = 0.0,   upper = 1.0 }
torque_per_volt = { start = -0.128, lower = -1.0,  upper = 0.0 }
theta_rest      = { start = 0.0,    lower = -3.0,  upper = 3.0 }

[model.orders]
lambda = { start = 1.0, lower = 0.6, upper = 1.2 }
mu     = { start = 1.0, lower = 0.6, upper = 1.2 }

[fit]
per_recording = ["theta_rest"]
initial_state = "rest"
"""

SPACE = DesignSpace(release=(16, 92, 120), rate=500)
"""How a fit begins: at rest, at an angle and a moment that it finds."""


@dataclass(frozen=True, eq=False)
class Played:
    """A voltage as it was recorded."""

    volts: np.ndarray
    rate: float

    def signal(self, time):
        return self.volts[np.minimum(np.round(time * self.rate).astype(int), len(self.volts) - 1)]


@dataclass(frozen=True)
class Result:
    """A fit of some recordings."""

    problem: fracid.Problem
    x: np.ndarray
    precision: Uncertainty

    def width(self, names, widened=True):
        """The geometric mean of the axes of the joint region of some values; NaN where one has no interval."""
        at = [self.problem.names.index(n) for n in names]
        more = self.precision.widening[at]
        return axis(self.precision.covariance[np.ix_(at, at)] / (1 if widened else np.outer(more, more)))

    def __str__(self):
        """Residuals, and what lies at a bound."""
        errors = np.concatenate(self.problem.errors(self.x))
        theta, alpha = np.degrees(np.sqrt(np.mean(errors**2, axis=0)))
        bound = [n for n, b in zip(self.problem.names, self.precision.at_bound, strict=True) if b]
        kept = ", ".join(f"{n} {self.x[i]:.4g} ± {NORMAL_95 * self.precision.standard_error[i]:.2g}"
                         for n in NAMES for i in [self.problem.names.index(n)])  # fmt: skip
        return f"residual {theta:.2f}°, {alpha:.2f}°; {kept}" + (f"; at a bound: {', '.join(bound)}" if bound else "")


def axis(covariance):
    log = np.linalg.slogdet(covariance)[1] if np.all(np.isfinite(covariance)) else math.nan
    return math.exp(0.5 * log / len(covariance))


def fitted(kinds, folder, bounded):
    """The recordings of some kinds together."""
    text = re.sub(r"(?m)^(b_\w+ .*lower =) \S+,", r"\1 0.0,", MODEL) if bounded else MODEL
    for kind in kinds:
        stem, lines, _ = KINDS[kind]
        text += (
            f'\n[[recording]]\nname = "{kind}"\nfile = "{next(RECORDINGS.rglob(stem + ".mat")).as_posix()}"\n'
            'time = { column = 0 }\ntheta = { column = 1, unit = "rad" }\n'
            f'alpha = {{ column = 2, unit = "rad", zero = {math.pi} }}\n{lines}'
        )
    path = Path(folder) / "project.toml"
    path.write_text(text, encoding="utf-8")
    problem = fracid.load_project(path).problem
    result, _ = search(problem, optimiser_from_name("multistart"), np.random.default_rng(1), starts=1)
    precision = uncertainty(problem, result.best.point)
    assert not isinstance(precision, Failure), precision
    return Result(problem, result.best.point, precision)


def candidate(kind, problem):
    """What is known of a recording before it is made."""
    (e,) = problem.experiments
    voltage = Played(e.inputs[:, 0], 1 / e.step) if len(e.inputs) > 1 else None
    return Candidate(KINDS[kind][2], (e.samples - 1) * e.step, 1 / e.step, voltage=voltage)


def predicted(base, c):
    """Block → the gain of a candidate; or why it cannot be simulated."""
    subject = subject_of_problem(base.problem, base.x, SPACE, precision=base.precision)
    (added,) = informations(subject, [c])
    if isinstance(added, str):
        return added
    vague = np.diag((VAGUE * subject.scale) ** -2.0)
    now = Information(subject.recorded.curvature + vague, subject.recorded.scatter + vague)
    before, after = (i.covariance(subject.scale) for i in (now, now + added))
    gains = {}
    for block, names in BLOCKS.items():
        if all(n in subject.names for n in names):
            at = np.ix_(*[[subject.names.index(n) for n in names]] * 2)
            gains[block] = axis(before[at]) / axis(after[at])
    return gains


def main(bounded):
    if not any(RECORDINGS.rglob("release_92deg.mat")):
        print(f"No release_92deg.mat in {RECORDINGS}; say where with FRACID_RECORDINGS=FOLDER")
        return
    with tempfile.TemporaryDirectory() as folder, one_blas_thread():
        fits = {frozenset(k): fitted(k, folder, bounded)
                for count in (1, 2) for k in itertools.combinations(KINDS, count)}  # fmt: skip
    for kinds, fit in fits.items():
        print(f"{' + '.join(k for k in KINDS if k in kinds)}: {fit}")
    print("\nGain: predicted, realised (realised without the widening for few samples)")
    for base in KINDS:
        alone, gains = fits[frozenset([base])], {}
        for other in (k for k in KINDS if k != base):
            forecast = predicted(alone, candidate(other, fits[frozenset([other])].problem))
            if isinstance(forecast, str):
                print(f"{base} + {other}: not predicted, {forecast}")
                continue
            both = fits[frozenset([base, other])]
            for block, gain in forecast.items():
                real, bare = (alone.width(BLOCKS[block], w) / both.width(BLOCKS[block], w) for w in (True, False))
                gains.setdefault(block, []).append((gain, real))
                print(f"{base} + {other}: {block:13} {gain:5.2f}, {real:5.2f} ({bare:.2f})")
        ranks = {b: (p[0] > p[1]) == (r[0] > r[1]) for b, pairs in gains.items() if len(pairs) == 2
                 for p, r in [zip(*pairs, strict=True)] if np.all(np.isfinite(r))}  # fmt: skip
        print(f"from {base}: ranked as realised {[b for b, same in ranks.items() if same]}, "
              f"otherwise {[b for b, same in ranks.items() if not same]}\n")  # fmt: skip


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bounded", action="store_true", help="viscous frictions cannot be negative")
    main(parser.parse_args().bounded)
