"""Public benchmarks of nonlinear system identification:  python benchmarks/public.py [--train DIR] [--test DIR] [NAME]

For each NAME_train.csv of the folder (columns: time, input, output) the model of public_models.py is identified on
this record alone:

1. **structure**: from the simplest on, groups of constants are freed, one group after the other.  Each candidate is
   fitted to one part of the record and judged on another; a group stays that lowers the error there by 1 % or more;
2. **constants**: all of the record, with their 95 % intervals; then nothing is changed any more;
3. **test**: NAME_test*.csv is opened.  A test is simulated from its input; its initial state is fitted to its
   first samples (50 of the Silverbox, 4 of the tanks, 20 of EMPS), and the error is that of all others.  The level of
   the upper tank is that of training.  EMPS has an offset of its own in each record: it is the one with which the
   simulated motion repeats itself where the input does.

Where the folder has no test record, one is made: 2. is done without the last quarter of the training record (EMPS: the
last half, two periods), which then is the test.

Published results: Champneys, Beintema, Tóth, Schoukens, Rogers, IFAC-PapersOnLine 58-15 (2024) 474, arXiv:2405.10779.
The records are others' and no part of the project: without --train they are looked for in FRACID_BENCHMARKS, else in
../shared/benchmarks.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import math
import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import public_models
from scipy.optimize import least_squares

from fracid import Experiment, Free, Model, Problem
from fracid.arrays import FloatArray
from fracid.errors import Failure
from fracid.estimation.covariance import uncertainty
from fracid.estimation.horizons import Watch, growing, refined
from fracid.problem.unknowns import starting_value
from fracid.solver.inputs import BETWEEN, Between

ROOT = Path(__file__).parent.parent
RECORDS = Path(os.environ.get("FRACID_BENCHMARKS", ROOT.parent / "shared" / "benchmarks"))
BETTER = 0.99
"""A group of constants stays where the error on what was not fitted falls below this part."""
BEGINNING = 4
"""Times the first samples that may be used: what of a test's input is read to find its initial state."""
JOBS = 2
"""Threads."""
GROUP = Mapping[str, Free]
"""Constants that are freed together."""


@dataclass(frozen=True)
class Record:
    """A file: time, input, output."""

    name: str
    step: float
    """[s]"""
    u: FloatArray
    """Shape (n,)."""
    y: FloatArray
    """Shape (n,)."""

    @classmethod
    def of(cls, path: Path) -> Record:
        """Read a CSV file with one line of names."""
        t, u, y = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2, usecols=(0, 1, 2)).T
        step = (t[-1] - t[0]) / (len(t) - 1)
        if np.max(np.abs(np.diff(t) - step)) > 1e-2 * step:
            sys.exit(f"{path}: its samples are not evenly spaced; expected steps of {step:g} s.")
        return cls(path.stem, float(step), u, y)

    def part(self, first: int, end: int, name: str) -> Record:
        """Some of its samples."""
        return Record(name, self.step, self.u[first:end], self.y[first:end])


@dataclass(frozen=True)
class Benchmark:
    """One of the public records: its protocol, its model, what may be asked of it."""

    model: Model
    unit: str
    scale: float
    """From the record's unit to this one."""
    known: int
    """Samples of a test's output that may be used."""
    published: str
    base: GROUP
    """The simplest structure."""
    groups: Mapping[str, GROUP]
    """What may be added to it, in this order."""
    between: Between
    """What the input does between its samples."""
    substeps: int
    method: str
    initial: Callable[[Record], Mapping[str, float | Free]]
    """States at the start of a record."""
    hidden: tuple[str, ...] = ()
    """States that the first samples do not tell: as in training."""
    split: float = 0.5
    """Part of the training record that a structure is fitted to; it is judged on the rest."""
    blocks: int = 0
    """In place of that: a short record in so many blocks, each predicted by a fit to the others."""
    aside: float = 0.75
    """Part that is trained on where there is no test."""
    repeating: tuple[str, ...] = ()
    """Constants that are a record's own: with them its simulated motion repeats itself as its input does."""
    sizes: tuple[float, ...] = ()
    """Of these."""
    parts: Mapping[str, tuple[int, str]] = field(default_factory=dict)
    """What the name of a test record holds → its first samples that are scored beside it, and what these are called."""


def ranges(**values: tuple[float, float, float]) -> GROUP:
    """Name → start, lower, upper."""
    return {name: Free(*v) for name, v in values.items()}


BENCHMARKS = {
    "silverbox": Benchmark(
        public_models.silverbox, "mV", 1e3, 50,
        "multisine 0.301 (GP-NARX), 0.36 (SUBNET); arrow 0.26 (PNLSS), 1.4 (SUBNET); "
        "arrow without extrapolation 0.259 (GP-NARX), 0.32 (SUBNET)",
        ranges(gain=(2e5, 1e4, 1e6), damping=(50.0, 1.0, 500.0), k=(2e5, 1e4, 1e6)),
        {
            "cubic stiffness": ranges(k3=(0.0, -1e7, 1e7)),
            "asymmetry": ranges(k2=(0.0, -1e6, 1e6), push=(0.0, -1e4, 1e4)),
            "damping of the displacement": ranges(d2=(0.0, -1e4, 1e4)),
            "damper weak at low speed": ranges(weak=(0.0, -1e3, 1e3), slow=(20.0, 1.0, 300.0)),
            "late far out": ranges(late=(0.0, -1e-1, 1e-1)),
        },
        between="band-limited", substeps=8, method="pi3",
        initial=lambda r: {"y": Free(r.y[0], -1.0, 1.0), "y'": Free(0.0, -300.0, 300.0)},
        split=0.125, parts={"arrow": (32_000, "no_extrapolation")},
    ),
    "cascaded_tanks": Benchmark(
        public_models.cascaded_tanks, "V", 1.0, 4, "0.191 (grey box, Worden 2018), 0.306 (CT-SUBNET)",
        ranges(pump=(0.033, 1e-3, 0.3), k1=(0.035, 0.0, 0.3), ratio=(2.0, 0.1, 20.0), k3=(0.06, 1e-3, 0.6),
               part=(1.2, 0.0, 6.0)),
        {
            "linear outflow": ranges(c3=(0.0, -0.05, 0.05)),
            "linear outflow of the upper tank": ranges(c1=(0.0, -0.05, 0.05)),
            "threshold of the pump": ranges(u0=(0.0, -1.0, 1.0)),
        },
        between="hold", substeps=4, method="pi2",
        initial=lambda r: {"upper": Free(6.0, 0.0, 10.0), "lower": Free(r.y[0], r.y[0] - 0.5, r.y[0] + 0.5)},
        hidden=("upper",), blocks=4,
    ),
    "emps": Benchmark(
        public_models.emps, "mm", 1e3, 20, "2.64 (dynoNet), 4.61 (CT-SUBNET)",
        ranges(mass=(90.0, 10.0, 300.0), b=(180.0, 0.0, 1e3), coulomb=(22.0, 0.0, 100.0), offset=(0.0, -20.0, 20.0),
               drift=(0.0, -0.3, 0.3)),
        {"way back": ranges(b_back=(50.0, -300.0, 300.0))},
        between="line", substeps=2, method="pi2",
        initial=lambda r: {"position": Free(r.y[0], r.y[0] - 0.1, r.y[0] + 0.1), "speed": Free(0.0, -0.2, 0.2)},
        aside=0.5, repeating=("offset", "drift"), sizes=(1.0, 0.1),
    ),
}  # fmt: skip


# --- identification ------------------------------------------------------------------------------------------------


def experiment(of: Benchmark, record: Record, initial: Mapping[str, float | Free]) -> Experiment:
    """A record as the model takes it."""
    (output,), (u,) = of.model.outputs, of.model.inputs
    return Experiment(
        record.name, record.step, record.y[:, None], record.u[:, None], initial=initial, between={u: of.between},
        units={output: "m" if of.unit == "mm" else "V"},
    )  # fmt: skip


def posed(of: Benchmark, records: Record | Sequence[Record], free: GROUP, order: float | Free = 1.0) -> Problem:
    """The problem of a structure on a record, or on several."""
    several = (records,) if isinstance(records, Record) else records
    experiments = tuple(experiment(of, record, of.initial(record)) for record in several)
    return Problem(
        of.model, experiments, {"q": order}, free, initial_state="held", substeps=of.substeps, method=of.method
    )


@dataclass(frozen=True)
class Minimum:
    """A structure and its best constants."""

    problem: Problem
    x: FloatArray
    cost: float
    """RMS of what was fitted, in the record's unit."""

    @property
    def values(self) -> dict[str, float]:
        """By name."""
        return dict(zip(self.problem.names, self.x.tolist(), strict=True))

    @property
    def last(self) -> dict[str, float]:
        """The states that the run of the training record ends with."""
        (e,) = self.problem.experiments
        states = self.problem.simulate(self.x, e).states
        return dict(zip(self.problem.model.states, states[-1].tolist(), strict=True))


def minimum(problem: Problem, before: Minimum | None) -> Minimum:
    """From the start on a growing horizon; or from a simpler structure's best, and from there with the given start."""
    if before is None:
        best = growing(problem, problem.start, Watch(JOBS)).best
        return Minimum(problem, best.point, best.cost)
    here = before.values
    own = {p.name: p.value for p in problem.model.parameters}
    simpler = np.array([here.get(u.name, own.get(u.target, u.range.start)) for u in problem.unknowns])
    best = min((refined(problem, x, Watch(JOBS)).best for x in (simpler, problem.start)), key=lambda b: b.cost)
    return Minimum(problem, best.point, best.cost)


# --- a record that was not fitted ------------------------------------------------------------------------------------


def period(u: FloatArray) -> int | None:
    """After how many samples an input repeats itself best; None where it does not."""
    lags = np.arange(len(u) // 10, len(u) * 11 // 20)
    centred = u - u.mean()
    mismatch = np.array([np.mean((centred[k:] - centred[:-k]) ** 2) for k in lags]) / (2 * np.var(u))
    return None if mismatch.min() > 0.5 else int(lags[np.flatnonzero(mismatch <= mismatch.min() + 0.02)[0]])


def prediction(
    of: Benchmark, model: Minimum, record: Record, hidden: Mapping[str, float], *, own: bool = True
) -> FloatArray:
    """Simulate a record from its input and its first samples, with constants of its `own` or not, shape (n,)."""
    initial = {n: hidden.get(n, v) for n, v in of.initial(record).items()}
    first = experiment(of, record.part(0, BEGINNING * of.known, record.name), initial)
    first = replace(first, mask=((first.time[of.known] - first.step / 2, first.time[-1]),))
    problem = model.problem.with_shared(model.x, (first,))
    x = refined(problem, problem.start, Watch(JOBS)).best.point
    e = experiment(of, record, initial)
    problem = replace(problem, experiments=(e,))
    lag = period(record.u) if own and of.repeating else None
    if lag is not None:
        problem = repeated(of, problem, x, lag)
    y = problem.fitted(x, e)
    return np.full(len(record.y), np.nan) if isinstance(y, Failure) else y[:, 0]


def repeated(of: Benchmark, problem: Problem, x: FloatArray, lag: int) -> Problem:
    """The constants of the record's own with which its motion comes back after each period; its output is not asked."""
    (e,) = problem.experiments
    names = of.repeating

    def changed(values: FloatArray) -> Problem:
        return replace(problem, parameters={**problem.parameters, **dict(zip(names, values.tolist(), strict=True))})

    def drift(values: FloatArray) -> FloatArray:
        y = changed(values).fitted(x, e)
        return np.full(len(e.time) - lag, 1e3) if isinstance(y, Failure) else of.scale * (y[lag:, 0] - y[:-lag, 0])

    start = np.array([starting_value(problem.parameters[n]) for n in names])
    return changed(least_squares(drift, start, x_scale=of.sizes).x)


def error(of: Benchmark, model: Minimum, record: Record, hidden: Mapping[str, float], *, own: bool = True) -> float:
    """RMS of what the prediction of a record leaves, without the samples that it may use, in the benchmark's unit."""
    left = record.y - prediction(of, model, record, hidden, own=own)
    return of.scale * float(np.sqrt(np.mean(left[of.known :] ** 2)))


# --- from a training record to a frozen model -----------------------------------------------------------------------


def chosen(of: Benchmark, record: Record) -> tuple[Minimum, list[tuple[str, float]]]:
    """The structure that predicts best what it was not fitted to, and each candidate's error."""
    judged = by_blocks if of.blocks else by_the_rest
    free: GROUP = of.base
    best, lowest = judged(of, record, free, None)
    errors = [("simplest", lowest)]
    for name, group in of.groups.items():
        more, left = judged(of, record, {**free, **group}, best)
        errors.append((f"+ {name}", left))
        if left < BETTER * lowest:
            free, best, lowest = {**free, **group}, more, left
    return best, errors


def by_the_rest(of: Benchmark, record: Record, free: GROUP, before: Minimum | None) -> tuple[Minimum, float]:
    """A structure's minimum on the first part of a record, and its error on the rest."""
    cut = round(of.split * len(record.y))
    part, rest = record.part(0, cut, "part"), record.part(cut - 1, len(record.y), "rest")
    model = minimum(posed(of, part, free), before)
    return model, error(of, model, rest, {n: model.last[n] for n in of.hidden})


def by_blocks(of: Benchmark, record: Record, free: GROUP, before: Minimum | None) -> tuple[Minimum, float]:
    """A structure's minimum on a record, and its error on each block of it when fitted to the others."""
    cuts = np.linspace(0, len(record.y), of.blocks + 1).astype(int).tolist()
    blocks = [record.part(a, b, f"block {k}") for k, (a, b) in enumerate(itertools.pairwise(cuts), 1)]
    whole = minimum(posed(of, record, free), before)
    squares = []
    for block in blocks:
        others = posed(of, [other for other in blocks if other is not block], free)
        squares.append(error(of, minimum(others, whole), block, {}) ** 2)
    return whole, float(np.sqrt(np.mean(squares)))


def identified(of: Benchmark, record: Record, part: Minimum) -> Minimum:
    """All constants of a structure from the whole of a record, from those of a part of it."""
    problem = posed(of, record, {n: v for n, v in part.problem.parameters.items() if isinstance(v, Free)})
    best = refined(problem, part.x, Watch(JOBS)).best
    return Minimum(problem, best.point, best.cost)


# --- the command ---------------------------------------------------------------------------------------------------


def run(
    name: str, train: Path, test: Path | None, *, orders: bool = False, between: Between | None = None
) -> dict[str, Any]:
    """Identify one benchmark and print what came out; a test's name → its error, as JSON."""
    began, of = time.perf_counter(), BENCHMARKS[name]
    of = replace(of, between=between or of.between)
    whole = Record.of(train / f"{name}_train.csv")
    tests = [] if test is None else sorted(test.glob(f"{name}_test*.csv"))
    cut = len(whole.y) if tests else round(of.aside * len(whole.y))
    record = whole.part(0, cut, whole.name)
    print(f"{name}: {of.model.name}, {cut} samples of training")
    part, errors = chosen(of, record)
    for candidate, left in errors:
        print(f"  structure: {candidate:30} {left:8.4g} {of.unit} held out")
    model = identified(of, record, part)
    constants = with_intervals(model)
    for constant, entry in constants.items():
        ends = entry["interval95"]
        half = math.nan if ends is None else (ends[1] - ends[0]) / 2
        print(f"  {constant:32} {entry['value']:12.6g} ± {half:.2g} {entry['unit']}")
    seconds = time.perf_counter() - began
    print(f"  fitted to {of.scale * model.cost:.4g} {of.unit}; frozen after {seconds:.0f} s")
    if orders:
        print_orders(of, model)
    start = {n: model.problem.unpack(model.x, model.problem.experiments[0])[2][of.model.states.index(n)].item()
             for n in of.hidden}  # fmt: skip
    predicted = [part for path in tests for part in parts_of(of, Record.of(path))]
    if not tests:
        predicted, start = [whole.part(cut - 1, len(whole.y), f"{name}_aside")], {n: model.last[n] for n in of.hidden}
        print(f"  no {name}_test*.csv; the last {len(whole.y) - cut} samples of training, kept aside:")
    answer = {}
    for unseen in predicted:
        rms = print_error(of, model, unseen, start)
        answer[unseen.name] = {"rms": rms if math.isfinite(rms) else None, "unit": of.unit, "seconds": seconds,
                               "parameters": constants}  # fmt: skip
    print(f"  published: {of.published} {of.unit}")
    print(f"  {time.perf_counter() - began:.0f} s in all", flush=True)
    return answer


def parts_of(of: Benchmark, record: Record) -> list[Record]:
    """A test record, and what of it a protocol scores beside."""
    beside = [part for end, part in of.parts.items() if end in record.name]
    return [record, *(record.part(0, n, f"{record.name}_{suffix}") for n, suffix in beside if n < len(record.y))]


def with_intervals(model: Minimum) -> dict[str, dict[str, Any]]:
    """Each constant with its unit and 95 % interval."""
    known = uncertainty(model.problem, model.x, jobs=JOBS)
    intervals = [None if isinstance(known, Failure) else known.interval(model.x, i) for i in range(len(model.x))]
    return {
        name: {"value": value, "interval95": None if ends is None else [float(end) for end in ends],
               "unit": model.problem.unknowns[i].unit}
        for i, ((name, value), ends) in enumerate(zip(model.values.items(), intervals, strict=True))
    }  # fmt: skip


def print_error(of: Benchmark, model: Minimum, record: Record, hidden: Mapping[str, float]) -> float:
    """The error of a test, and what it is with all constants of the training record; returns the first."""
    rms = error(of, model, record, hidden)
    print(f"  {record.name:32} {rms:12.4g} {of.unit}")
    if of.repeating:
        as_trained = error(of, model, record, hidden, own=False)
        print(f"  {record.name + ', ' + ' and '.join(of.repeating) + ' of training':32} {as_trained:12.4g} {of.unit}")
    return rms


def print_orders(of: Benchmark, model: Minimum) -> None:
    """What the order of the equations is where it is free, and what that gains."""
    values = {n: model.values[n] for n in model.problem.parameters}
    free = {n: replace(v, start=values[n]) for n, v in model.problem.parameters.items() if isinstance(v, Free)}
    problem = replace(model.problem, orders={"q": Free(1.0, 0.8, 1.2)}, parameters=free)
    best = refined(problem, np.concatenate([[1.0], model.x]), Watch(JOBS)).best
    known = uncertainty(problem, best.point, jobs=JOBS)
    interval = None if isinstance(known, Failure) else known.interval(best.point, 0)
    half = math.nan if interval is None else (interval[1] - interval[0]) / 2
    print(f"  order free: {best.point[0]:.5f} ± {half:.2g}, fitted to {of.scale * best.cost:.4g} {of.unit}")


def main(arguments: Sequence[str]) -> None:
    """Parse, and go through the benchmarks."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"{', '.join(BENCHMARKS)}; all of them if left out")
    parser.add_argument("--train", type=Path, default=RECORDS, metavar="DIR", help="where NAME_train.csv are")
    parser.add_argument("--test", type=Path, metavar="DIR", help="where NAME_test*.csv are")
    parser.add_argument("--orders", action="store_true", help="also free the order of the equations")
    parser.add_argument("--json", action="store_true", help="errors and constants as JSON on standard output")
    parser.add_argument("--between", choices=BETWEEN, help="what the inputs do between their samples, instead")
    options = parser.parse_args(arguments)
    if unknown := [n for n in options.names if n not in BENCHMARKS]:
        parser.error(f"no benchmark {unknown[0]!r}; there are {', '.join(BENCHMARKS)}")
    names = [n for n in options.names or BENCHMARKS if (options.train / f"{n}_train.csv").is_file()]
    if not names:
        sys.exit(f"No NAME_train.csv in {options.train}; say where with --train DIR or FRACID_BENCHMARKS=DIR")
    answers: dict[str, Any] = {}
    with contextlib.redirect_stdout(sys.stderr) if options.json else contextlib.nullcontext():
        for name in names:
            answers |= run(name, options.train, options.test, orders=options.orders, between=options.between)
    if options.json:
        print(json.dumps(answers, indent=2))


if __name__ == "__main__":
    main(sys.argv[1:])
