r"""How much do the orders move with where the record begins, and with what is taken for the motion before it?

A fractional derivative sums over all that was, so a record that starts in motion has its past in the equations.  A
fit has to take something for that past, and nothing in its residuals says whether it was the right thing.  So the
fit is made again with something else in its place, from the minimum found, by least squares over all unknowns:

===================== ===================================================================================
treatment             what is taken for the motion before the start
===================== ===================================================================================
with the past         the samples before the start enter the memory (``history = "measured"``)
without the past      nothing: the rig is struck in the posture of the start (no ``history``)
from the plateau      there is none: the record begins with the release, found in the samples before the
                      start, free to some 50 ms, of a rig at rest (``from = "release"``)
cut later             as the fit has it, but the record begins at its next turning point; what was
                      known of the past goes on, and a start at rest becomes a past
===================== ===================================================================================

Each is left out where it is what the fit has done already, or where there is nothing to do it with.  One that fits
as well as the fit did, to a tenth of the residual's rms, is a rival: nothing tells which of the two is right.  Where a
rival moves an order by more than the half width of its 95 % interval, the interval is too narrow: it knows of noise,
not of what the model lacks.  And where the past makes the residual smaller, it belongs in.

On a real SRV02 (release from 92°, cut 0.19 s after it, 18 unknowns) the fit says μ = 1.008 ± 0.035; with the past μ is
1.053, from the plateau 1.045.  All three fit to 0.20 … 0.22°: a long flat valley runs from the one to the others, and
what is taken for the first 0.2 s decides about the place in it.  The valley is curved, so a refit takes as long as a
search, and :func:`cut_check` is asked for (``fracid fit --cut``), not part of every fit.
``python benchmarks/evidence.py cut`` prints these figures.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from fracid.arrays import FloatArray
from fracid.cards import CardDisplay
from fracid.errors import Failure, FailureReason, InputError
from fracid.estimation.covariance import LEAST_SHIFT, Known, Uncertainty
from fracid.estimation.horizons import Watch, refined, uninterrupted
from fracid.estimation.windows import piece
from fracid.figures import Figure, Style, draw
from fracid.findings import Words
from fracid.optimise import Outcome
from fracid.problem import Experiment, Free, Problem
from fracid.problem.past import release_in_past
from fracid.problem.project import Project
from fracid.problem.unknowns import ends_of
from fracid.recording import Recording, load_recording
from fracid.safety.schema import Number, Record, computed
from fracid.units import half_of, letter, signed

SAYS = Words("validation/unknown_past.toml")

TURNS = 0.1
"""A turning point is a peak that stands out by this part of the signal's range."""

EARLY = 0.25
"""A later cut leaves out at most this part of the record."""

HELD = 0.2
"""A plateau shorter than this [s] is none."""

RIVAL = 1.1
"""A treatment whose residual's rms is more than this many times the fit's explains less, and is no rival."""

BETTER = 0.95
"""A past that brings the residual's rms below this part of what it was belongs in."""

RELEASED = 0.05
"""How far the release may lie from where it was found [s]."""


@dataclass(frozen=True)
class AsFitted(Record):
    """What the treatments are held against."""

    orders: Mapping[str, float]
    """Free orders → value."""
    cost: float
    levels: Annotated[Mapping[str, float], Field(alias="rmse")]
    """Output → rms of its residual [rad]."""


@dataclass(frozen=True)
class Treatment(AsFitted):
    """The same with something else taken for the motion before the start, of the samples that this treatment scores."""

    shift: Mapping[str, float]
    """How far each order lies from the fit's."""
    stopped: Annotated[bool, Field(alias="still_moving")]
    """Whether the budget ended the refit: the orders were still moving."""


@dataclass(frozen=True, repr=False)
class CutCheck(CardDisplay, Record):
    """What :func:`cut_check` found."""

    as_fitted: AsFitted
    half_width: Mapping[str, Number]
    """Order → half-width of its 95 % interval; None where there is none."""
    treatments: dict[str, Treatment]
    """By the names of the module's table; ``cut later by 0.34 s``."""
    left_out: Mapping[str, str]
    """Treatment → why it does not apply, in words."""

    @computed
    def rivals(self) -> tuple[str, ...]:
        """Treatments that fit as well."""
        return tuple(name for name, t in self.treatments.items() if self._ratio(t) < RIVAL)

    @computed
    def range(self) -> dict[str, tuple[float, float]]:
        """Order → its least and its greatest value over the fit and its alternatives."""
        rows = [self.as_fitted.orders, *(self.treatments[name].orders for name in self.rivals)]
        values = {n: [r[n] for r in rows] for n in self.as_fitted.orders}
        return {n: (min(v), max(v)) for n, v in values.items()}

    @computed
    def warnings(self) -> tuple[str, ...]:
        """A sentence for each order that moves by more than its interval, and one for a past that belongs in."""
        return tuple(w for w in (*map(self._moves, self.as_fitted.orders), self._better()) if w)

    @property
    def verdict(self) -> str:
        """In words: what the warnings say, or that there is nothing to be warned of."""
        if not self.treatments:
            return "The cut was not checked: " + "; ".join(f"{n}: {why}" for n, why in self.left_out.items()) + "."
        if self.warnings:
            return " ".join(self.warnings)
        if not self.rivals:
            return "Nothing else that is taken for the motion before the start fits as well."
        most = {n: self._farthest(n)[1].shift[n] for n in self.as_fitted.orders}
        shifts = ", ".join(f"{letter(n)} by {signed(shift)}" for n, shift in most.items())
        return f"No order moves by more than its interval, wherever the record is cut; at most they move: {shifts}."

    def _ratio(self, t: Treatment) -> float:
        """Its residual's rms over that of the fit, a geometric mean over the outputs: each counts by its own size."""
        logs = [math.log(max(t.levels[n], 1e-300) / max(level, 1e-300)) for n, level in self.as_fitted.levels.items()]
        return math.exp(sum(logs) / len(logs))

    def _farthest(self, order: str) -> tuple[str, Treatment]:
        return max(((n, self.treatments[n]) for n in self.rivals), key=lambda rival: abs(rival[1].shift[order]))

    def _moves(self, name: str) -> str:
        half = self.half_width[name]
        if not self.rivals or half is None:
            return ""  # without an interval the order is not known anyway, and the fit says why
        (treatment, far), (low, high) = self._farthest(name), self.range[name]
        by, fitted = far.shift[name], self.as_fitted.orders[name]
        if abs(by) <= max(LEAST_SHIFT, half):
            return ""
        cause = "where the record is cut" if treatment.startswith("cut") else "what is taken for the motion before it"
        stopped = ", and still moving when the refit was stopped" if far.stopped else ""
        return SAYS("moves", order=letter(name), by=signed(by), cause=cause, fitted=fitted,
                    there=far.orders[name], way=f"{treatment}{stopped}", times=abs(by) / half, half=half, low=low,
                    high=high)  # fmt: skip

    def _better(self) -> str:
        t, fit = self.treatments.get("with the past"), self.as_fitted
        if t is None or self._ratio(t) > BETTER:
            return ""
        parts = (f"{100 * t.levels[n] / (v or 1.0):.0f} % ({letter(n)})" for n, v in fit.levels.items())
        orders = ", ".join(f"{letter(n)} {fit.orders[n]:.4g} → {v:.4g}" for n, v in t.orders.items())
        plateau = "from the plateau" in self.treatments
        what = 'from = "release" and initial_state = "rest"' if plateau else 'history = "measured"'
        return SAYS("better", parts=", ".join(parts), orders=orders, what=what)

    def plot(self, *, style: str | Style = "screen") -> Figure:
        """Each order as fitted, and with something else taken for the past; see :func:`fracid.plots.cut_shifts`.

        Parameters
        ----------
        style : str or Style
            ``screen``, ``journal`` or one's own; see :mod:`fracid.figures`.

        Examples
        --------
        >>> past = Treatment({"mu": 1.05}, 0.1, {"alpha": 0.1}, {"mu": 0.05}, False)
        >>> fit = AsFitted({"mu": 1.0}, 0.1, {"alpha": 0.1})
        >>> check = CutCheck(fit, {"mu": 0.01}, {"with the past": past}, {})
        >>> check.plot().axes[0].get_xlabel()
        'order $\\\\mu$ [–]'
        """
        return draw("cut_shifts", self, style=style)


def cut_check(
    problem: Problem,
    x: FloatArray,
    known: Known | None,
    *,
    whole: Mapping[str, Experiment] | None = None,
    jobs: int = 1,
    budget: int = 60,
) -> CutCheck | Failure:
    """Fit again with something else taken for the motion before the start, and see how far the orders move.

    Parameters
    ----------
    problem : Problem
    x : ndarray, shape (n_unknowns,)
        Its minimum.
    known : Uncertainty, Failure or None
        Of x, from :func:`fracid.estimation.covariance.uncertainty`; all but the first stand for "no interval".
    whole : mapping, optional
        Recording → itself with all samples before its start (:func:`whole_records`).  A past that the problem has
        already is known without.
    jobs : int
        Threads.
    budget : int
        Trial steps of each refit.

    Returns
    -------
    CutCheck or Failure
        The failure says why there is none: no order is free, a user's own cost, a run that fails.

    References
    ----------
    The first screens of this module and of :mod:`fracid.problem.past`.

    Examples
    --------
    >>> import fracid
    >>> from fracid.estimation.covariance import uncertainty
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.5}, step=5e-3, end=5.0)
    >>> swing = Experiment("twin", 5e-3, run.states[:, [0, 2]], np.zeros((1, 1)))
    >>> problem = Problem(rig, (swing.until(4.0),), {"lambda": 0.9, "mu": Free(0.95, 0.5, 1.2)}, initial_state="held")
    >>> found = cut_check(problem, problem.start, uncertainty(problem, problem.start))
    >>> {name: abs(t.shift["mu"]) < 2e-3 for name, t in found.treatments.items()}
    {'cut later by 0.33 s': True}
    """
    if not problem.order_indices:
        return Failure(FailureReason.NOTHING_FREE, "no order is free")
    if problem.cost_function.loss is None:
        return Failure(FailureReason.OWN_COST, SAYS("own-cost", problem=problem))
    if isinstance(failure := problem.errors(x), Failure):
        return Failure(FailureReason.RUN, f"the fit's own run fails: {failure}")
    records = {e.name: _whole(e, (whole or {}).get(e.name)) for e in problem.experiments}
    treatments, left_out = dict[str, Treatment](), dict[str, str]()
    for name, treatment in TREATMENTS.items():
        try:
            treatments |= _refit(name, problem, x, treatment(problem, records), jobs, budget=budget)
        except InputError as error:  # also of a problem that cannot be: a past, where not every angle was recorded
            left_out[name] = str(error)
    half = {n: half_of(known.interval(x, i)) or None if isinstance(known, Uncertainty) else None
            for n, i in problem.free_orders.items()}  # fmt: skip
    return CutCheck(AsFitted(_orders(problem, x), problem.cost(x), problem.levels(x)), half, treatments, left_out)


def whole_records(project: Project) -> dict[str, Experiment]:
    """The recordings that a project fits, from their files' first samples on: what came before ``from`` is in them.

    Parameters
    ----------
    project : Project

    Returns
    -------
    dict
        Recording → the whole; those that begin with their file's first sample are left out.

    Examples
    --------
    >>> import tempfile, fracid
    >>> from pathlib import Path
    >>> folder = Path(tempfile.mkdtemp())
    >>> time = np.arange(0, 4, 0.01)
    >>> np.savez(folder / "swing.npz", time=time, alpha=0.1 * np.cos(6 * time))
    >>> text = '[[recording]]\\nfile = "swing.npz"\\nfrom = 1.0\\nalpha = { column = "alpha" }'
    >>> _ = (folder / "rig.toml").write_text(text)
    >>> whole = whole_records(fracid.load_project(folder / "rig.toml"))["swing"]
    >>> whole.start, len(whole.measured)
    (0.0, 400)
    """
    model, outputs = project.problem.model, project.problem.outputs
    begins = {e.name: e.start for e in project.problem.experiments}
    return {
        r.name: Experiment.of(r, model, outputs) for r in whole_recordings(project)
        if r.name in begins and r.step is not None and r.time[0] < begins[r.name]
    }  # fmt: skip


def whole_recordings(project: Project) -> list[Recording]:
    """A project's recordings as its file has them, but each from its own first sample on.

    Examples
    --------
    See :func:`whole_records`.
    """
    signals = (*project.problem.model.outputs, *project.problem.model.inputs)
    return [
        recording if "from" not in table else load_recording(
            recording.path, {n: table[n] for n in signals if n in table}, time=table.get("time"), stop=table.get("to"),
            name=recording.name, resample=table.get("resample", "needed"), variable=table.get("variable"),
        )
        for table, recording in zip(tomllib.loads(project.text)["recording"], project.recordings, strict=True)
    ]  # fmt: skip


# --- the treatments ----------------------------------------------------------------------------------------


Records = Mapping[str, Experiment]
"""Recording → all that is known of it, from its first sample on, beginning with the past."""


def _with_past(problem: Problem, records: Records) -> Problem:
    if problem.initial_state not in ("estimate", "measured"):
        raise InputError("the fit starts at rest")
    if all(e.past is not None for e in problem.experiments):
        raise InputError("as fitted")
    changed = {e.name: _onwards(records[e.name], e, 0) for e in problem.experiments
               if e.past is None and records[e.name].start < e.start}  # fmt: skip
    return _changed(problem, changed, "estimate", "there are no samples before the start")


def _without_past(problem: Problem, _records: Records) -> Problem:
    changed = {e.name: replace(e, past=None, past_inputs=None) for e in problem.experiments if e.past is not None}
    return _changed(problem, changed, "estimate", "the fit has none")


def _from_plateau(problem: Problem, records: Records) -> Problem:
    if problem.initial_state not in ("estimate", "measured"):
        raise InputError("the fit starts at rest")
    changed = []
    for e in problem.experiments:
        if records[e.name].start == e.start:
            raise InputError(f"there are no samples before the start of {e.name}")
        release = release_in_past(_onwards(records[e.name], e, 0))
        if release * e.step < HELD:
            raise InputError(f"no plateau was found before the start of {e.name}")
        begun = _from(records[e.name], release)
        changed.append(replace(begun, weight=e.weight, release_time=Free(0.0, -RELEASED, RELEASED)))
    return replace(problem, experiments=tuple(changed), initial_state="rest")


def _cut_later(problem: Problem, records: Records) -> Problem:
    at_rest, changed = problem.initial_state in ("rest", "held"), {}
    for e in problem.experiments:
        k = _turning_point(e)
        if k is not None:
            knows = e.past is not None or at_rest
            changed[e.name] = _onwards(records[e.name], e, k) if knows else _from(e, k)
    none = f"no turning point was found in the first {EARLY:.0%} of the record"
    return _changed(problem, changed, "estimate" if at_rest else problem.initial_state, none)


TREATMENTS: Mapping[str, Callable[[Problem, Records], Problem]] = {
    "with the past": _with_past,
    "without the past": _without_past,
    "from the plateau": _from_plateau,
    "cut later": _cut_later,
}
"""Name → the problem that it makes of another, or InputError, why it makes none."""


def _changed(problem: Problem, changed: Records, initial_state: Any, otherwise: str) -> Problem:
    """The problem with some of its recordings changed; where none is, an error that says why."""
    if not changed:
        raise InputError(otherwise)
    experiments = tuple(changed.get(e.name, e) for e in problem.experiments)
    return replace(problem, experiments=experiments, initial_state=initial_state)


def _turning_point(e: Experiment) -> int | None:
    """The first sample after the release at which the output that moves most turns back; None if that is late."""
    from scipy.signal import find_peaks

    x = e.most_moved
    first = max(0, math.ceil(ends_of(e.release_time)[1] / e.step))
    peaks = [find_peaks(sign * x[first:], prominence=TURNS * np.ptp(x))[0] for sign in (1, -1)]
    turns = first + np.sort(np.concatenate(peaks))
    return int(turns[0]) if len(turns) and turns[0] < EARLY * len(x) else None


# --- pieces of records -----------------------------------------------------------------------------------------


def _whole(e: Experiment, record: Experiment | None) -> Experiment:
    """A recording with all samples before its start: as given, or from its past; itself where nothing is known."""
    if record is not None or e.past is None:
        return record or e
    sd = None if e.deviation is None else np.vstack([np.broadcast_to(e.deviation[0], e.past.shape), e.deviation])
    return replace(
        e, measured=np.vstack([e.past, e.measured]), inputs=e.all_inputs, start=e.start - len(e.past) * e.step,
        deviation=sd, past=None, past_inputs=None, initial={}, release_time=0.0,
    )  # fmt: skip


def _from(e: Experiment, k: int) -> Experiment:
    """From its sample k on; what was known of its start is known no more."""
    return piece(e, e.name, k, len(e.measured))


def _onwards(whole: Experiment, e: Experiment, k: int) -> Experiment:
    """A recording from its sample k on, all samples before as its past."""
    at = round((e.start - whole.start) / e.step)
    past = whole.measured[:at] + (e.measured[0] - whole.measured[at])  # zero = "rest" may differ between the two
    inputs = whole.inputs[: at + k] if len(whole.inputs) > 1 else whole.inputs
    return replace(
        _from(e, k), past=np.vstack([past, e.measured[:k]]), past_inputs=inputs, weight=e.weight,
        initial=e.initial if k == 0 else {},
    )  # fmt: skip


# --- the refit -------------------------------------------------------------------------------------------------


def _refit(name: str, problem: Problem, x: FloatArray, other: Problem, jobs: int, budget: int) -> dict[str, Treatment]:
    """The treatment by its full name."""
    begun = _carried(problem, x, other)
    result = uninterrupted(refined(other, begun, Watch(jobs), tolerance=1e-5, budget=budget))
    best = result.best
    if not math.isfinite(best.cost):
        raise InputError(f"no run reached its end: {best.reason}")
    later = max(o.start - e.start for e, o in zip(problem.experiments, other.experiments, strict=True))
    orders, before = _orders(other, best.point), _orders(problem, x)
    label = f"{name} by {later:.2g} s" if later > 0 else name
    shift, stopped = {n: orders[n] - before[n] for n in orders}, result.outcome is Outcome.BUDGET_SPENT
    return {label: Treatment(orders, best.cost, other.levels(best.point), shift, stopped=stopped)}


def _orders(problem: Problem, x: FloatArray) -> dict[str, float]:
    return {n: float(x[i]) for n, i in problem.free_orders.items()}


def _carried(problem: Problem, x: FloatArray, other: Problem) -> FloatArray:
    """The minimum x in another problem's unknowns; the state of a start at another time from the fit's own run."""
    values = problem.named(x)
    for e, later in zip(problem.experiments, other.experiments, strict=True):
        at = later.start - e.start
        if at < 0:  # the start as measured
            values = {n: v for n, v in values.items() if not n.endswith(f"(0) [{e.name}]")}
        elif at > 0:
            state = problem.simulate(x, e).at([at])[0]
            values |= {f"{n}(0) [{e.name}]": float(v) for n, v in zip(problem.model.states, state, strict=True)}
    return other.point(values)
