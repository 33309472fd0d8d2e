r"""A record in pieces: a few swings each, with an initial state of its own.

Over a whole record the phase after thirty swings decides the cost, and friction that is a little wrong early cannot be
told from friction that is very wrong late: of rich friction each wrong shape has a minimum of its own.  Over three
swings the phase cannot run away.  In pieces, each of which starts anew, the cost has few minima, and what all pieces
share is nearly that of the whole record (*multiple shooting* [1]_).  The pieces are where a search of rich friction
begins; where it ends is the whole record.

**A rig that stands upright, or tumbles.**  There the whole record has no minimum to be found: what a start is off by
grows as :math:`e^{Λt}`, and after some Λ⁻¹ no simulation follows the rig, be its constants ever so right.  How long one
does is measured (:func:`prediction`): runs from some places of a record, and beside each those from a start that is a
little off.  What grows tenfold, and tenfold again as soon, is no phase that runs away, which takes ten times as long.
Where the noise of a start so grows to the motion's own size before the record ends, the record is fitted in windows
(:func:`windowed`): one after the other, all samples in one of them, each with an initial state of its own and, where an
order is no integer, with the samples before it as its past.  The constants are one for all, so that the answer improves
with the length of the record.  The search begins on thirds of the windows, in each of which a start grows by
:data:`GROWTH` only, and ends on the windows: where a controller holds the rig, its input knows the noise, a start that
is fitted to few samples follows that noise, and constants are off by the share of the starts in the samples (dry
friction of a balanced twin by 15 % on thirds, by 2 % on windows).

References
----------
.. [1] H. G. Bock, *Recent advances in parameter identification techniques for O.D.E.*, in Numerical Treatment of
   Inverse Problems in Differential and Integral Equations, Birkhäuser (1983).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from statistics import median_low
from typing import NamedTuple

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import InputError, brief
from fracid.findings import Words
from fracid.problem import Experiment, Problem
from fracid.signals.resolution import noise_level, resolution

SAYS = Words("estimation/windows.toml")

SWINGS = 3
"""Of a window."""

WINDOWS = 12
"""Of all recordings together; of a long one they lie apart."""

GROWTH = 10.0
"""What a start is off by may grow so much within a part of a window."""

PARTS = 3
"""Of a window, on which its search begins."""

STEPS = 100
"""Of the solver in a part of a window, at least: a controller's noise drives a joint over the bend of its dry friction
within a sample; coarser steps smear that, and find for the slip speed what the rate changes by in a step."""

LOST = 1e3
"""A growth that no fit of a start makes up for."""

PLACES = 6
"""Of a recording, from which a simulation is followed."""

CLOSE = 24
"""Places from which it is followed to see where a start grows fastest: a rig that tumbles is most sensitive for some
tenths of a second, as it passes the top."""

OFF = 1e-6
"""By what part of its size a start is off, to see how that grows."""

SAMPLES = 12
"""A window has so many, at least."""

MOST = 500
"""Windows of all recordings: of a longer record they lie apart, and what lies between them is not scored."""

LONG = 50_000
"""Samples of all windows, likewise; but of :data:`FEWEST` windows in any case."""

FEWEST = 4
"""Windows that say from each other how much more they scatter than their samples tell."""

PAST = 2
"""Windows before a window that are its past, where an order is no integer."""

LAGS = 4
"""Samples of the past from which an input is predicted, to see whether it follows from the outputs."""

FOLLOWS = 0.3
"""Part of what an input's own past leaves of it that the outputs explain, where a controller makes it."""

LEAST = 0.25
"""Of a window's samples so many count: beside masks, bridged gaps and delays little may be left."""


def in_windows(problem: Problem) -> Problem:
    """The same problem on windows of its recordings, which share all but their initial states.

    Orders stay where the search starts: a window's past is not its own, and an order would stand in for it.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Free
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 1, "mu": 1}, initial={"alpha": 0.3}, step=4e-3, end=20.0)
    >>> swing = Experiment("twin", 4e-3, run.states[:, [0, 2]], np.zeros((1, 1)))
    >>> pieces = in_windows(Problem(rig, (swing,), {"lambda": Free(1.0, 0.5, 1.2), "mu": 1.0}))
    >>> len(pieces.experiments), pieces.orders, len(pieces.experiments[0].time) * 4e-3 < 4.0
    (9, {'lambda': 1.0, 'mu': 1.0}, True)
    """
    count = max(1, WINDOWS // len(problem.experiments))
    windows = tuple(w for e in problem.experiments for w in _windows(e, count))
    return replace(problem, experiments=windows, orders=problem.order_starts, initial_state="estimate", memo=None)


class Prediction(NamedTuple):
    """For how long a simulation follows the recordings of a problem, from a start that is known to their noise."""

    seconds: float
    """Until the noise of the start has grown to the motion's own size; infinite where a recording ends before."""
    window: float
    """Until it has grown by :data:`GROWTH`, where it grows fastest [s]."""


def prediction(problem: Problem, x: FloatArray) -> Prediction:
    """For how long the model at x predicts, as runs from some places of each recording say it.

    Places after each other multiply what a start is off by; those where it does not grow tenfold twice do not count.

    Examples
    --------
    What a start is off by does not grow where a pendulum hangs; where it is balanced a quarter of a second does it:

    >>> import fracid
    >>> t = np.arange(0, 20, 0.01)
    >>> wobble, push = 0.03 * np.column_stack([np.sin(2 * t), np.sin(3 * t)]), np.sin(t)[:, None]
    >>> for zero in ("hanging", "upright"):
    ...     rig = fracid.rotary_pendulum("qube-servo2", zero=zero)
    ...     problem = Problem(rig, (Experiment("seen", 0.01, wobble, push),), {"lambda": 1.0, "mu": 1.0})
    ...     print(prediction(problem, problem.start).window)
    inf
    0.24
    """
    seconds, windows = [], []
    for e in problem.experiments:
        grown = _growths(problem, x, e, PLACES)
        steady = [g for g in grown if g.squared < math.inf]
        window, later = (median_low(g[k] for g in steady or grown) if grown else math.inf for k in (0, 1))
        limit = max(LOST, min((g.limit for g in grown), default=math.inf))
        lost = sum(math.log(g.most) for g in steady) > math.log(limit)
        seconds.append(window + (later - window) * math.log(limit / GROWTH) / math.log(GROWTH) if lost else math.inf)
        grown += _growths(problem, x, e, CLOSE) if lost else []
        windows.append(min((g.window for g in grown), default=math.inf))
    return Prediction(min(seconds), min(windows))


class _Growth(NamedTuple):
    """How what the start of a recording is off by grows."""

    window: float
    """When it has grown by :data:`GROWTH` [s]."""
    squared: float
    """When by its square [s]."""
    limit: float
    """The growth at which the start's noise is a third of the motion."""
    most: float
    """The growth by the recording's end, at most."""


def _growths(problem: Problem, x: FloatArray, e: Experiment, places: int) -> list[_Growth]:
    """The growth from so many places of a recording, each to the next one.

    In parts of the size of its motion, and of that of its rate: of all of it, since an arm may stick while it swings.
    """
    spans, reach = _equal_spans(0, len(e.measured), places), _reach(e)
    swings = np.array_split(e.measured, max(1, round(e.swings / SWINGS)))  # not how far it has turned in an hour
    size = np.sqrt(np.mean([np.var(y, axis=0) for y in swings], axis=0))
    rate = np.std((e.measured[reach:] - e.measured[:-reach]) / (reach * e.step), axis=0)
    pieces = (p for p in (piece(e, e.name, a, b) for a, b in spans) if p.samples > SAMPLES)
    parts = (replace(problem.with_shared(x, (p,)), initial_state="estimate", memo=None) for p in pieces)
    own = {u.name: v for u, v in zip(problem.unknowns, x.tolist(), strict=True) if u.kind != "initial"}
    return [_growth(part, part.point(own), size, rate) for part in parts]


def _growth(problem: Problem, x: FloatArray, size: FloatArray, rate: FloatArray) -> _Growth:
    """The growth of the one recording, in parts of `size` and `rate`, of outputs that are states."""
    e, states = problem.experiments[0], problem.model.output_states
    seen = [k for k, n in enumerate(problem.outputs) if n in states]
    columns, measured = [states[problem.outputs[k]] for k in seen], e.measured[:, seen]
    size, rate = np.maximum(size[seen], 1e-300), rate[seen]
    noise = np.array([max(noise_level(y), (resolution(y) or 0.0) / math.sqrt(12.0)) for y in measured.T])
    offsets = {problem.model.states[i]: s for i, s in zip(columns, size, strict=True)}
    offsets |= {problem.model.states[j]: rate[columns.index(i)] for i, j in problem.rates.items()}
    moved = [k for k, u in enumerate(problem.unknowns) if u.kind == "initial" and u.target in offsets]
    others = [x + OFF * offsets[problem.unknowns[k].target] * np.eye(len(x))[k] for k in moved]
    run, *apart = problem.simulator.trajectories([x, *others], e, range(1 + len(moved))).values()
    n = min(len(r.time) for r in (run, *apart))
    grown = [np.abs(r.states[:n, columns] - run.states[:n, columns]) / (OFF * size) for r in (run, *apart)]
    growth: FloatArray = np.max(grown, axis=(0, 2), initial=0.0)
    if not run.completed:
        growth[-1:] = math.inf
    reached = (growth >= by for by in (GROWTH, GROWTH**2))
    first, later = (float(run.time[np.argmax(g)]) if np.any(g) else math.inf for g in reached)
    limit = float(np.min(size / (3 * np.maximum(noise, 1e-300)), initial=math.inf))
    return _Growth(first, later, limit, float(np.max(growth)))


def windowed(problem: Problem, seconds: float, parts: int = 1) -> Problem:
    """The same problem on windows of its recordings, which share all but their initial states; or on parts of those.

    Examples
    --------
    >>> import fracid
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> swing = Experiment("twin", 4e-3, np.cos(np.arange(900) / 9)[:, None] * [1, 1], np.zeros((1, 1)))
    >>> pieces = windowed(Problem(rig, (swing,), {"lambda": 1.0, "mu": 1.0}), 0.6)
    >>> [e.name for e in pieces.experiments][:2], sum(e.samples for e in pieces.experiments), [*pieces.recordings]
    (['twin, window 1', 'twin, window 2'], 900.0, ['twin'])
    """
    orders = problem.orders.values()
    remembers, of = any(not isinstance(v, float | int) or v != round(v) for v in orders), len(problem.experiments)
    windows = (w for e in problem.experiments for w in _in_turn(e, seconds, of, parts, remembers=remembers))
    return replace(problem, experiments=tuple(windows), initial_state="estimate", windows="none", memo=None)


def beginning(problem: Problem, seconds: float, fixed_step: bool = False) -> Problem:
    """Where the search of a problem in windows begins: on parts of them, where any start leads to the minimum.

    Their orders stay as they begin, so that no part needs a past.  Their step is fine enough, unless it is fixed.
    """
    substeps = problem.substeps if fixed_step else max(problem.substeps, _substeps(problem, seconds))
    return windowed(replace(problem, orders=problem.order_starts, substeps=substeps), seconds, PARTS)


def _substeps(problem: Problem, seconds: float) -> int:
    """Steps a sample with which a search in windows of so many seconds begins."""
    steps = max(STEPS * PARTS / _length(e, seconds) for e in problem.experiments)
    return int(2 ** max(0, math.ceil(math.log2(steps))))


def lengthened(parts: Problem, x: FloatArray, whole: Problem) -> FloatArray:
    """The point of a problem in windows that the minimum of one in parts of them leads to.

    What ends at a bound in parts begins where the search did: parts tell little of how sharp a dry friction is, and
    from a sharp one no derivative leads back.
    """
    begun, begins = ({e.name: f"{e.recording.name} {e.start:.9g}" for e in p.experiments} for p in (parts, whole))
    found = {
        (u.target, begun.get(u.experiment or "", u.experiment)): v
        for u, v in zip(parts.unknowns, x.tolist(), strict=True)
        if u.kind == "initial" or u.range.lower < v < u.range.upper
    }
    return np.array([
        found.get((u.target, begins.get(u.experiment or "", u.experiment)), u.range.start) for u in whole.unknowns
    ])  # fmt: skip


def chosen_window(problem: Problem, x: FloatArray | None = None) -> float | None:
    """Seconds of the windows that a problem asks for, or its prediction at x, its start if left out; None for none.

    Raises
    ------
    InputError
        If the seconds are no number, or what a window would begin with is not measured.
    """
    if problem.windows == "auto":
        if not can_be_windowed(problem):
            return None
        found = prediction(problem, problem.start if x is None else x)
        window, least = PARTS * found.window, SAMPLES * max(e.step for e in problem.experiments)
        return window if window >= least and math.isfinite(found.seconds) else None
    if problem.windows == "none":
        return None
    seconds, least = problem.windows, 2 * max(e.step for e in problem.experiments)
    if isinstance(seconds, bool | str) or not least <= seconds < math.inf:
        raise InputError(SAYS("seconds", seconds=brief(seconds), least=least))
    if not can_be_windowed(problem):
        raise InputError(SAYS("unread-states"))
    return float(seconds)


def prediction_of(problem: Problem, x: FloatArray, window: float) -> Prediction:
    """The :func:`prediction` of the whole recordings of a problem in windows of so many seconds, at its minimum."""
    wholes = tuple(replace(e, mask=problem.experiments[at][0].mask) for e, at in problem.recordings.values())
    whole = replace(problem, experiments=wholes, substeps=_substeps(problem, window), memo=None)
    return prediction(whole, whole.point(problem.named(x)))


def can_be_windowed(problem: Problem) -> bool:
    """Whether its recordings can be fitted in windows: whether what a window begins with is measured."""
    plain = all(e.times is None and e.source is None and e.past is None and not (e.initial or e.sparse)
                for e in problem.experiments)  # fmt: skip
    return problem.cost_function.loss is not None and problem.told >= {*problem.model.states} and plain


def closes_a_loop(e: Experiment) -> bool:
    """Whether an input follows from the outputs: they say more of it than its own past does, which made them.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> y, u = rng.standard_normal((2, 400, 1))
    >>> [closes_a_loop(Experiment("held", 0.1, y, v)) for v in (u, u - 2 * y)]
    [False, True]
    """
    measured, inputs = e.measured[:LONG], e.inputs[:LONG]
    if len(inputs) <= 2 * LAGS * (1 + measured.shape[1]):
        return False
    here = slice(LAGS, len(inputs))

    def before(signals: FloatArray, first: int) -> FloatArray:
        return np.column_stack([signals[LAGS - k : len(signals) - k] for k in range(first, LAGS)])

    outputs = before(measured, 0)
    for u in inputs.T:
        own = np.column_stack([np.ones(len(outputs)), before(u[:, None], 1)])
        known = own, np.column_stack([own, outputs])
        alone, beside = (float(np.var(u[here] - A @ np.linalg.lstsq(A, u[here])[0])) for A in known)
        if alone > 1e-6 * np.var(u) and beside < (1 - FOLLOWS) * alone:
            return True
    return False


def _equal_spans(first: int, end: int, count: int) -> list[tuple[int, int]]:
    """First and last + 1 sample of so many parts of a stretch."""
    return list(pairwise(np.linspace(first, end, count + 1).astype(int).tolist()))


def _length(e: Experiment, seconds: float) -> int:
    """Samples of a window of so many seconds, whose parts hold some samples and every delay."""
    return max(SAMPLES * PARTS, round(seconds / e.step), math.ceil(2 * PARTS * e.longest_delay / e.step))


def _in_turn(e: Experiment, seconds: float, of: int, parts: int, remembers: bool) -> Iterator[Experiment]:
    """Windows of one `of` so many recordings, of all of its samples where these are not too many; or their parts."""
    samples = len(e.measured)
    length = _length(e, seconds)
    pairs, whole = _equal_spans(0, samples, max(1, samples // length)), piece(e, e.name, 0, samples)
    most = max(math.ceil(FEWEST / of), min(MOST, LONG // length) // of)
    if len(pairs) > most:
        kept = set(np.linspace(0, len(pairs) - 1, most).astype(int).tolist())
        left = [pair for k, pair in enumerate(pairs) if k not in kept]
        between = [(e.start + a * e.step, e.start + (b - 1) * e.step) for a, b in left]
        pairs, whole = [pair for k, pair in enumerate(pairs) if k in kept], replace(whole, mask=(*e.mask, *between))
    pairs = [part for a, b in pairs for part in _equal_spans(a, b, parts)]
    for k, (a, b) in enumerate(pairs, start=1):
        window = replace(piece(e, f"{e.name}, window {k}", a, b), whole=whole, begun=_begun(e, a))
        if remembers and a >= SAMPLES:
            before = piece(e, e.name, max(0, a - PAST * length), a)
            window = replace(window, past=before.measured, past_inputs=before.inputs)
        yield window


def _begun(e: Experiment, first: int) -> tuple[FloatArray, FloatArray]:
    """Outputs and slopes at a sample, from a cubic through those on both sides of it."""
    reach = _reach(e)
    at = np.arange(max(0, first - reach), min(len(e.measured), first + reach + 1))
    cubic = np.polynomial.polynomial.polyfit((at - first) * e.step, e.measured[at], 3)
    return cubic[0], cubic[1]


def _reach(e: Experiment) -> int:
    """Samples over which a slope is taken."""
    return min(max(5, round(min(0.04 / e.step, len(e.measured) / 10))), len(e.measured) - 1)


def in_parts(problem: Problem, parts: int, own: Sequence[str]) -> Problem:
    """The same problem on parts of its recordings, one after the other, each with its own values of some parameters.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Free
    >>> swing = Experiment("twin", 4e-3, np.cos(np.arange(900) / 9)[:, None] * [1, 1], np.zeros((1, 1)))
    >>> orders = {"lambda": 1.0, "mu": 1.0}
    >>> problem = Problem(fracid.rotary_pendulum(), (swing,), orders, {"b_alpha": Free(1e-4, 0.0, 1.0)})
    >>> [u.name for u in in_parts(problem, 2, ["b_alpha"]).unknowns if u.target == "b_alpha"]
    ['b_alpha [twin, part 1]', 'b_alpha [twin, part 2]']
    """
    pieces = (piece(e, f"{e.name}, part {k}", a, b) for e in problem.experiments
              for k, (a, b) in enumerate(_equal_spans(0, len(e.measured), parts), start=1))  # fmt: skip
    names = tuple(dict.fromkeys((*problem.per_recording, *own)))
    scored = tuple(p for p in pieces if p.samples)
    return replace(problem, experiments=scored, per_recording=names, initial_state="estimate", memo=None)


def _windows(e: Experiment, most: int) -> list[Experiment]:
    """Windows of a recording, evenly spread; the recording itself where it is no longer than one, or none counts.

    Every delay lies in the first half of a window."""
    samples, late = len(e.measured), e.longest_delay
    length = round(SWINGS * samples / max(e.swings, SWINGS))
    length = min(samples, max(length, math.ceil(2 * late / e.step) + 2 if late > 0 else 0))
    count = min(most, samples // length)
    firsts = np.linspace(0, samples - length, count).astype(int) if count > 1 else [0]
    windows = [piece(e, f"{e.name}, window {k + 1}", a, a + length) for k, a in enumerate(map(int, firsts))]
    return [w for w in windows if w.samples >= LEAST * length] or [piece(e, e.name, 0, samples)]


def piece(e: Experiment, name: str, first: int, end: int) -> Experiment:
    """Some samples of a recording, which begin in motion."""
    return replace(e.part(first, end), name=name, past=None, past_inputs=None, release_time=0.0, initial={})


def shared_values(problem: Problem, x: FloatArray) -> Mapping[str, float]:
    """What a point says of orders and parameters, by name: of those that each window has for itself, the median.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Free
    >>> still = Experiment("still", 0.1, np.zeros((9, 2)), np.zeros((1, 1)))
    >>> problem = Problem(fracid.rotary_pendulum("srv02-rotpen"), (still,), {"lambda": Free(0.9, 0.5, 1.2), "mu": 1.0})
    >>> shared_values(problem, problem.start)
    {'lambda': 0.9}
    """
    values: dict[str, list[float]] = {}
    for unknown, value in zip(problem.unknowns, x.tolist(), strict=True):
        if unknown.kind in ("order", "parameter"):
            values.setdefault(unknown.target, []).append(value)
    return {name: float(np.median(several)) for name, several in values.items()}
