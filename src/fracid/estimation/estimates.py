"""A minimum as records: an estimate for each order, parameter and unknown, a fit for each recording.

What they say of a value is found before: its interval (:mod:`fracid.estimation.covariance`), its verdict
(:mod:`fracid.estimation.parameter_verdicts`).  Of a recording that was held out, :func:`validation_fit` finds what is
its own first.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import Failure
from fracid.estimation.covariance import Known, uncertainty
from fracid.estimation.horizons import Watch, from_start
from fracid.estimation.long_records import coarse_problem, corrected, is_coarse, on_every_sample, own_substeps
from fracid.estimation.parameter_verdicts import Verdict, identifiability
from fracid.estimation.records import Estimate, RecordingFit, fit_of
from fracid.estimation.windows import windowed
from fracid.problem import Experiment, Free, Problem, Unknown


def estimates_at(problem: Problem, x: FloatArray, known: Known, verdicts: Mapping[str, Verdict]) -> dict[str, Estimate]:
    """Every order and parameter by name, and every unknown by its own; what is tied as that which it follows."""
    units = {p.name: p.unit for p in problem.model.parameters}
    starts = problem.order_starts | {p.name: p.value for p in problem.model.parameters} | problem.parameter_starts
    values = {**problem.orders, **problem.parameters}
    fixed = {n: Estimate(float(v), units.get(n, "")) for n, v in starts.items()
             if not isinstance(values.get(problem.ties.get(n, n)), Free)}  # fmt: skip
    free = {u.name: _estimate(u, x, i, known, verdict=verdicts.get(u.name, Verdict(u.name, "unknown")))
            for i, u in enumerate(problem.unknowns)}  # fmt: skip
    return fixed | free | {name: free[to] for name, to in problem.aliases.items()}


def _estimate(u: Unknown, x: FloatArray, i: int, precision: Known, verdict: Verdict) -> Estimate:
    value = float(x[i])
    if isinstance(precision, Failure):
        return Estimate(value, u.unit, True, identifiable=verdict.kind)
    se, own = float(precision.standard_error[i]), bool(precision.at_bound[i])
    nearer = min(u.range.lower, u.range.upper, key=lambda end: abs(end - value)) if own else None
    interval, white = (precision.interval(x, i, method) for method in ("sandwich", "white"))
    return Estimate(value, u.unit, free=True, standard_error=se if np.isfinite(se) else None, interval95=interval,
                    at_bound=own, bound=nearer, identifiable=verdict.kind, reason=verdict.reason, white95=white,
                    cut=bool(u.range.ending(interval or ())), interval_method=precision.method(i))  # fmt: skip


def fits_at(problem: Problem, x: FloatArray, estimates: Mapping[str, Estimate], use: str) -> dict[str, RecordingFit]:
    """Each recording beside its simulation, which is NaN where the run fails."""
    return {n: _fit_at(problem, x, estimates, n, use=use) for n in problem.recordings}


def _fit_at(problem: Problem, x: FloatArray, estimates: Mapping[str, Estimate], name: str, use: str) -> RecordingFit:
    e = problem.experiments[problem.recordings[name][1]][0]
    begun = zip(problem.model.states, problem.unpack(x, e)[2].tolist(), strict=True)
    initial = {n: estimates.get(f"{n}(0) [{e.name}]", Estimate(value)) for n, value in begun}
    own = {n: estimates[f"{n} [{name}]"] for n in problem.own_parameters}
    if isinstance(e.release_time, Free):
        own["release_time"] = estimates[f"release_time [{e.name}]"]
    elif e.release_time:  # else it is the first sample
        own["release_time"] = Estimate(e.release_time, "s")
    return fit_of(problem, x, name, use, initial=initial, parameters=own)


def validation_fit(
    problem: Problem, x: FloatArray, e: Experiment, window: float | None, jobs: int
) -> tuple[RecordingFit, str]:
    """Find a recording's own unknowns, all that is shared fixed at x; in words why, where every run failed."""
    sampled = problem.with_shared(x, (e,))
    sampled = windowed(sampled, window) if window else sampled
    alone = sampled if window else coarse_problem(sampled)
    best = from_start(alone, Watch(jobs))
    if alone.names and is_coarse(alone):
        exact = corrected(alone, best.point, own_substeps(alone, problem.substeps), jobs)
        alone, best = (alone, best) if isinstance(exact, Failure) else exact
    precision = uncertainty(alone, best.point, jobs=jobs)
    estimates = estimates_at(alone, best.point, precision, identifiability(alone, best.point, precision, jobs=jobs))
    return _fit_at(on_every_sample(alone, sampled), best.point, estimates, e.name, use="validate"), best.reason
