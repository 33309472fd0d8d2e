"""A run done again, from what its folder says, and its result held against the first one.

::

    run folder  ──  project.toml, recordings (by their hashes), run.json: options, seed  ──  identify  ──  result
         │                                                                                                   │
         └── result.json  ──────────────────────────  value by value  ──────────────────────────────────────┘

The same inputs, seed and versions on the same kind of machine give the same numbers to the last bit, for any number of
threads: every sum has a fixed order, linear algebra has one thread, and all randomness has the seed's.  Other versions
and other processors round differently in the last place, and a search that takes its way by differences of costs ends
that much elsewhere.  So there *what was found* (values of unknowns, their cost, root mean squares) is held to
:data:`ELSEWHERE` of its size or, of an unknown that the data hardly tell, to :data:`OF_INTERVAL` of half its interval:
derivatives by differences are known to 10⁻⁸, and so is, in units of its interval, where least squares ends.  Derived
numbers, a p-value or a difference of two nearly equal costs, may differ by more, and are told.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from fracid.cards import CardDisplay
from fracid.errors import InputError, typed
from fracid.runs.environment import code, machine
from fracid.runs.folder import CODE, MEMO, SAYS, VERSION, inputs_of, result_of, run_state
from fracid.runs.saved import SavedRun, load_run
from fracid.safety.schema import Beside, Infinite, Listed, Record, computed, read_if_whole
from fracid.schemas.run_record import EnvironmentBlock, FitOptions
from fracid.tasks.job import one_blas_thread
from fracid.tasks.simulation_cache import Memo
from fracid.units import half_of

ELSEWHERE = 1e-9
"""How far what was found may be off with other versions or on another machine, of its size."""

OF_INTERVAL = 1e-6
"""And an unknown, of half its interval: where zero lies within, its size says nothing."""

MACHINE = {"platform": "the platform", "processor": "the processor", "code": f"{CODE}of fracid"}
"""Of environment.json, in words."""

PASSING = ("timing", "versions")
"""Blocks of a result that say how it was made: not compared."""

FOUND = (("orders", "parameters", "cost", "recordings", "structures", "truth"), ("value", "cost", "rmse", "truth"))
"""Blocks, and names in them, under which a result says what was found."""


@dataclass(frozen=True)
class Difference(Record):
    """One place where two results are not the same."""

    where: str
    """``orders.mu.value``, as jq takes it."""
    before: Any
    after: Any
    size: Infinite
    """|after − before| over the larger of both; infinite for what is no number in both."""
    of_interval: Infinite
    """Of an unknown: the same over half its interval; infinite without one."""
    found: bool
    """Whether it is something that was found, and not derived from it."""

    @property
    def excused(self) -> bool:
        """Whether it may be so with other versions or on another machine."""
        return not self.found or self.size <= ELSEWHERE or self.of_interval <= OF_INTERVAL


@dataclass(frozen=True, repr=False)
class Reproduction(CardDisplay, Record):
    """What :func:`reproduce` gives."""

    result: Beside[Mapping[str, Any]]
    """The new one."""
    values: int
    """How many were compared."""
    differences: Listed[Difference]
    """The largest first, what was found before what was derived."""
    changed: Mapping[str, tuple[str, str]]
    """What is not as it was, versions, machine, own code → before and now."""

    @computed
    def identical(self) -> bool:
        """Whether no value differs in its last bit."""
        return not self.differences

    @computed
    def reproduced(self) -> bool:
        """Whether it came out as it should: the same to the bit, or with other versions or elsewhere nearly so."""
        return self.identical or (bool(self.changed) and all(d.excused for d in self.differences))

    @computed
    def verdict(self) -> str:
        """In words."""
        but = f" {_listed(self.changed)}: not as before." if self.changed else ""
        if self.identical:
            return f"Identical: all {self.values} values are the same to the last bit.{but}"
        count = f"{len(self.differences)} of {self.values} values differ, {self.how_far}"
        if self.reproduced:
            return f"Reproduced: {count}.{but}"
        if self.changed:
            return f"Not reproduced: {count}; {ELSEWHERE:g} is allowed.{but}"
        return SAYS("not-reproduced", count=count)

    @property
    def how_far(self) -> str:
        """By how much what was found differs, in words."""
        estimates = [d for d in self.differences if d.found]
        by_size = max((d.size for d in estimates if d.of_interval > OF_INTERVAL or d.size <= ELSEWHERE), default=0.0)
        by_interval = max((d.of_interval for d in estimates if d.size > ELSEWHERE and d.excused), default=0.0)
        far = [f"{by_size:.1g} of its size"] * (by_size > 0)
        far += [f"{by_interval:.1g} of half its interval"] * (by_interval > 0)
        return f"what was found by {' or '.join(far)} at most" if far else "none of those that were found"


def reproduce(folder: str | Path, *, trust: bool = False, jobs: int = 1, **options: Any) -> Reproduction:
    """Do a fit again and hold its result against the one in its folder.

    Parameters
    ----------
    folder : str or Path
        Of a run of ``fracid fit`` that is finished.  Nothing is written there.
    trust : bool
        Let its project run code of its own; see :func:`fracid.load_run`.
    jobs : int
        Threads; no value depends on it.
    **options
        Passed on to :func:`fracid.identify`, such as ``callback``.

    Returns
    -------
    Reproduction

    Raises
    ------
    InputError
        If it is no finished fit, or if its recordings are not where they were, or are others.
    NotTrusted
        If its project names code of its own, and `trust` is not given.

    Examples
    --------
    >>> import tempfile
    >>> reproduce(tempfile.mkdtemp())
    Traceback (most recent call last):
    fracid.errors.InputError: ... is no run folder: it has no result.json that can be read. Give one that fracid fit
    wrote.
    """
    from fracid.identification import identify

    run = load_run(folder, trust=trust)
    state = run_state(run.folder)
    if not state.finished:
        raise InputError(f"The fit in {run.folder} is not finished; type {typed('resume', run.folder)}.")
    there = read_if_whole(run.folder / "environment.json", EnvironmentBlock) | {"code": state.code}
    changed = not_as_before(run.folder, state.inputs, inputs_of(run.project), there, here=machine() | {"code": code()})
    with one_blas_thread(), TemporaryDirectory() as place, Memo(Path(place) / MEMO) as memo:  # as on the command line
        fit = identify(run.project, jobs=jobs, memo=memo, **_how(state.options, run), **options)
    return compared(run.result, result_of(fit, run.project, {}), changed)


def _how(said: FitOptions, run: SavedRun) -> dict[str, Any]:
    """The options of the run, as identify takes them; a scheduler's starts are those of processes."""
    optimiser = "multistart" if said.starts else said.optimiser or run.project.optimiser
    executor = "processes" if "://" in str(said.executor) else said.executor or "threads"
    return {"optimiser": optimiser, "seed": said.seed, "starts": said.starts, "cut": said.cut, "executor": executor}


def not_as_before(
    run: Path, before: Mapping[str, Any], after: Mapping[str, Any], there: Mapping[str, Any], here: Mapping[str, Any]
) -> dict[str, tuple[str, str]]:
    """Versions, own code and machine that are not as they were; data must be the same.

    Parameters
    ----------
    run : Path
    before, after : mapping
        What a result depends on, in words → its hash or version.
    there, here : mapping
        Both machines, and fracid's own code.

    Raises
    ------
    InputError
        If data are others, or their project.

    Examples
    --------
    >>> machine = {"processor": "x86_64"}
    >>> not_as_before(Path("run"), {"the version of numpy": "1.0"}, {"the version of numpy": "2.0"}, machine, machine)
    {'the version of numpy': ('1.0', '2.0')}
    """
    changes = _differing(before, after)
    for what in changes:
        if not what.startswith((CODE, VERSION)):
            raise InputError(f"{run} cannot be done again: {what} has changed since. Put it back.")
    machine = _differing(there, here)
    return changes | {words: machine[what] for what, words in MACHINE.items() if what in machine}


def _differing(before: Mapping[str, Any], after: Mapping[str, Any]) -> dict[str, tuple[str, str]]:
    return {n: (str(before[n]), str(now)) for n, now in after.items() if before.get(n, now) != now}


def _listed(changed: Mapping[str, tuple[str, str]]) -> str:
    """``The version of numpy (2.1.0, now 2.2.0), …``; of a hash its change alone."""
    text = ", ".join(w if w.startswith(CODE) else f"{w} ({before}, now {now})" for w, (before, now) in changed.items())
    return text[:1].upper() + text[1:]


# --- value by value ----------------------------------------------------------------------------------


def compared(
    before: Mapping[str, Any], after: Mapping[str, Any], changed: Mapping[str, tuple[str, str]] | None = None
) -> Reproduction:
    """Hold one result, as plain JSON values, against another.

    Examples
    --------
    >>> one = {"orders": {"mu": {"value": 0.9, "interval95": [0.8, 1.0]}}, "timing": {"total": 3.1}}
    >>> other = {"orders": {"mu": {"value": 0.90001, "interval95": [0.8, 1.0]}}, "timing": {"total": 2.9}}
    >>> compared(one, one).verdict
    'Identical: all 3 values are the same to the last bit.'
    >>> [(d.where, float(round(d.size, 6))) for d in compared(one, other).differences]
    [('orders.mu.value', 1.1e-05)]
    """
    pairs = list(_pairs((), {**before}, json.loads(json.dumps({**after})), _claimed(before)))
    differences = sorted(filter(None, pairs), key=lambda d: (not d.found, d.excused, -d.size, d.where))
    return Reproduction(after, len(pairs), tuple(differences), dict(changed or {}))


def _pairs(
    path: tuple[str, ...], before: Any, after: Any, claimed: Mapping[tuple[str, ...], float], width: float = 0.0
) -> Iterator[Difference | None]:
    """One for each value: None where it is the same."""
    before, after = ({} if v is _MISSING and isinstance(o, dict) else v for v, o in ((before, after), (after, before)))
    if isinstance(before, dict) and isinstance(after, dict):
        ends = before.get("interval95")
        width = half_of(ends) if isinstance(ends, list) and len(ends) == 2 and None not in ends else 0.0
        for name in {**before, **after}:
            if path or name not in PASSING:
                yield from _pairs((*path, name), before.get(name, _MISSING), after.get(name, _MISSING), claimed, width)
    elif isinstance(before, list) and isinstance(after, list) and len(before) == len(after):
        for place, pair in enumerate(zip(before, after, strict=True)):
            yield from _pairs((*path, str(place)), *pair, claimed)
    elif type(before) is type(after) and before == after:
        yield None
    else:
        blocks, names = FOUND
        is_estimate = path[0] in blocks and any(name in names for name in path[-2:])
        half = width if path[-1] == "value" else claimed.get(path, 0.0)
        was, now = ("missing" if v is _MISSING else v for v in (before, after))
        yield Difference(".".join(path), was, now, *_sizes(before, after, half), is_estimate)


def _claimed(study: Mapping[str, Any]) -> dict[tuple[str, ...], float]:
    """Half the interval that a noise study's fits claim of each value of its truth, which has none of its own."""
    unknowns = (study.get("cells") or [{}])[0].get("unknowns", {})
    return {("truth", n): 2.0 * (u.get("claimed") or 0.0) for n, u in unknowns.items()}


_MISSING = object()
"""In place of a value that only one of the results has."""


def _sizes(before: Any, after: Any, half: float) -> tuple[float, float]:
    """The difference over the larger of both, and over half the interval."""
    if not all(isinstance(v, int | float) and not isinstance(v, bool) for v in (before, after)):
        return inf, inf
    off = float(abs(after - before))
    return off / max(abs(before), abs(after)) if off else 0.0, off / half if half > 0 else inf
