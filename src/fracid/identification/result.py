"""What an examination found, as a :class:`fracid.Fit`: estimates, findings, warnings, and what is claimed.

Where the model does not fit, a value has neither interval nor verdict: they would be of another model.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial

from fracid.arrays import FloatArray
from fracid.cards import brief, listed
from fracid.errors import Failure, FailureReason
from fracid.estimation.covariance import OF_FITS, Known, Uncertainty
from fracid.estimation.drift import drift_of
from fracid.estimation.estimates import estimates_at, fits_at
from fracid.estimation.long_records import on_every_sample
from fracid.estimation.parameter_verdicts import Verdict
from fracid.estimation.records import Estimate, Estimates, OrderEstimate, RecordingFit
from fracid.estimation.starts import won
from fracid.estimation.windows import closes_a_loop, prediction_of
from fracid.findings import Finding, Note, with_code
from fracid.fit import PARTIAL, CostBlock, Fit, ModelBlock
from fracid.identification.examination import SAYS, Examination
from fracid.optimise import Outcome
from fracid.problem import Problem
from fracid.selection.opened_bounds import OpenedBound, opened_bounds, reopened
from fracid.solver.methods import METHODS
from fracid.units import letter, with_half_width
from fracid.validation.after_search import hidden_starts
from fracid.validation.discretisation import COARSE_STEP
from fracid.validation.misfits import cost_of, misfits
from fracid.validation.unknown_past import CutCheck

IMITATION = "may stand in for friction that the model lacks"
"""The verdict on orders whose integer-order rival, with more friction free, is as good."""

CHANCE = "not distinguishable from {:g} with these recordings"
"""The verdict on orders at whose integer value the same model is as good."""


def as_fit(found: Examination, evaluations: int, timing: Mapping[str, float]) -> Fit:
    """The result of an examination, also of one that was interrupted."""
    setting, at, fits = found.setting, found.at, all(e.fits for e in found.residuals.values())
    searched, opened = at.problem, tuple[OpenedBound, ...]()
    if found.within is not None:
        opened = opened_bounds(*found.within, searched, at.best)
        searched = replace(searched, parameters=reopened(found.within[0], opened).parameters)
    problem = on_every_sample(searched, found.sampled)
    model, cost, check = problem.model, found.cost, found.check
    if check is not None and math.isfinite(at.best.cost):
        check = check.on_all_samples(at.problem, at.best.cost, cost)
    estimates = _estimates(found, problem, fits)
    fitted = fits_at(problem, at.x, estimates, use="fit")
    validated = found.validated if fits else {n: _alone(r) for n, r in found.validated.items()}
    findings = _findings(found, problem, fitted)
    precision = at.uncertainty if fits else Failure(FailureReason.NO_FIT, "the model does not fit")
    messages = (PARTIAL * (found.outcome is Outcome.INTERRUPTED),
                *(f.note for f in findings if f.code != COARSE_STEP), *(b.sentence for b in opened),
                *_warnings(problem, precision, found.verdicts), *found.warnings,
                *_followed(problem, at.x, setting.window))  # fmt: skip
    first = sorted(filter(None, messages), key=lambda w: getattr(w, "code", "") != "stopped")  # it explains the others
    warnings, winner = tuple(first), won(setting.attempts)
    return Fit(
        problem=problem, x=at.x, evaluations=evaluations, seed=setting.seed, optimiser=setting.optimiser.name,
        outcome=found.outcome, method=problem.method, memory=problem.memory.name,
        step=problem.experiments[0].step / problem.substeps, substeps=problem.substeps,
        model=ModelBlock(name=model.name, zero=model.zero, source=model.source),
        minimised=CostBlock(name=problem.cost_function.name, value=cost, outputs=list(problem.outputs)),
        orders=Estimates({
            n: OrderEstimate(**vars(estimates[n]), integer=model.integer_order(n)) for n in problem.orders
        }),
        parameters=Estimates({n: estimates[n] for n in model.parameter_names if n in estimates}),
        recordings=fitted | validated, opened_bounds=opened,
        starts=setting.attempts, start_that_won=None if winner is None else winner.origin,
        alternative=found.alternative, spread=found.spread, window=setting.window,
        cut=found.cut if isinstance(found.cut, CutCheck) else None,
        discretisation=check, uncertainty=precision if isinstance(precision, Uncertainty) else None,
        interval_methods=OF_FITS if isinstance(precision, Uncertainty) else {},
        timing=timing,
        warnings=warnings, warning_codes=tuple(getattr(w, "code", "") for w in warnings), findings=tuple(findings),
        claim=found.claim.claim, claim_reasons=found.claim.reasons, claim_codes=found.claim.codes,
    )  # fmt: skip


def _estimates(found: Examination, problem: Problem, fits: bool) -> dict[str, Estimate]:
    estimates, nearest = estimates_at(problem, found.at.x, found.at.uncertainty, found.verdicts), found.alternative
    estimates = estimates if fits else _values_alone(estimates)
    if nearest is not None and nearest.warning and found.claim.claim == "integer":
        for n in nearest.orders:
            verdict = IMITATION if nearest.parameters else CHANCE.format(problem.model.integer_order(n))
            estimates[n] = replace(estimates[n], identifiable=verdict, reason="")
    return estimates


def _values_alone(estimates: Mapping[str, Estimate]) -> dict[str, Estimate]:
    """Of a model that does not fit the values, and the bounds that they lie at."""
    return {n: Estimate(e.value, e.unit, True, at_bound=e.at_bound, bound=e.bound, reason=brief(e.bound) * e.at_bound,
                        identifiable="at its bound" if e.at_bound else "unknown") if e.free else e
            for n, e in estimates.items()}  # fmt: skip


def _alone(r: RecordingFit) -> RecordingFit:
    return replace(r, initial=_values_alone(r.initial), parameters=_values_alone(r.parameters))


def _findings(found: Examination, problem: Problem, fitted: Mapping[str, RecordingFit]) -> list[Finding]:
    """Those before the search, then the later ones; of each causes lead."""
    later = [*found.findings]
    if found.outcome is not Outcome.INTERRUPTED:
        hidden = partial(hidden_starts, problem, found.at.x)
        later += [*misfits(fitted, found.setting.multi_starts, found.residuals, hidden), *found.missed()]
    return [f for group in (found.setting.findings, later) for f in sorted(group, key=cost_of, reverse=True)]


def _followed(problem: Problem, x: FloatArray, window: float | None) -> Iterator[str]:
    """For how long the model predicts recordings that were fitted in windows."""
    if window is not None:
        seconds, count = prediction_of(problem, x, window).seconds, len(problem.experiments)
        how_long = f"for longer than {seconds:.2g} s" if math.isfinite(seconds) else "to its end without a new start"
        apart = any(e.mask != problem.experiments[at][0].mask for e, at in problem.recordings.values())
        yield SAYS("windows", recordings=listed(problem.recordings), how_long=how_long, count=count, window=window,
                   apart=SAYS("apart") if apart else "")  # fmt: skip
        if loops := [n for n, (e, _) in problem.recordings.items() if closes_a_loop(e)]:
            yield SAYS("closed-loop", recordings=listed(loops))
        if (drift := drift_of(problem, x)) is not None:
            yield SAYS("drift", name=drift.name, rate=with_half_width(100 * drift.rate, 100 * drift.half))


UNTOLD = ("identifiable", "forgotten", "unknown")
"""Verdicts that are no warning."""


def _warnings(problem: Problem, precision: Known, verdicts: Mapping[str, Verdict]) -> Iterator[str]:
    if METHODS[problem.method].raw:
        yield SAYS("raw-sums", problem=problem)
    for order, output in problem.model.seen_in.items():
        if order in problem.names and output not in problem.outputs:
            scored = " and ".join(letter(n) for n in problem.outputs)
            yield SAYS("unscored", scored=scored, order=letter(order), output=letter(output))
    if isinstance(precision, Failure):
        yield f"There are no intervals: {precision}."
        return
    together = [names for names in precision.confounded if len(names) > 1]
    for names in together:
        yield f"The data cannot separate {' and '.join(letter(n) for n in names)}: fix one of them."
    alike: dict[tuple[str, str], list[str]] = {}
    for v in verdicts.values():
        bounded = "".join(note.code for note in with_code([v.reason], "bounded"))
        if (bounded or v.kind not in UNTOLD) and not any(v.name in names for names in together):
            alike.setdefault((v.says, bounded or "verdict" * bool(v.reason)), []).append(letter(v.name))
    for (says, code), unknowns in alike.items():
        if len(unknowns) == 1:
            yield Note(f"{unknowns[0]} {says}.", code)
        else:
            yield f"{', '.join(unknowns[:-1])} and {unknowns[-1]} {_of_several(says)}."


def _of_several(said: str) -> str:
    """``lie at their bound: 0; they are zero …`` for ``lies at its bound: 0; it is zero …``.

    Examples
    --------
    >>> _of_several("lies at its bound: 0; it is zero within the resolution of the data: remove it")
    'lie at their bound: 0; they are zero within the resolution of the data: remove them'
    """
    plural = {r"^is": "are", r"^lies": "lie", r"\bit is\b": "they are", r"\bits\b": "their",
              r"\b(fix|remove|beyond|score) it\b": r"\1 them"}  # fmt: skip
    for one, several in plural.items():
        said = re.sub(one, several, said)
    return said
