r"""What a recording is worth: its clock, its signals, where it is released.

Clock
    The step h is the median of the differences of time.  *Jitter* is the standard
    deviation of those differences without gaps, and the largest of \|Δt − h\|/h.  A *gap* is a
    difference above 1.5 h: at least one sample is missing.  The grid is *uniform* when
    every difference lies within 1 % of h.

Resolution
    An encoder's values lie on a lattice of spacing q.  The smallest spacings of the values
    seen are averaged (a logger's rounding scatters them: 4096 counts a turn printed to 0.01°
    are 0.08° and 0.09° apart), and q is believed if the other spacings are its multiples.
    A signal computed in floating point has no such q.

Noise
    Root mean square of third differences over √20, which a motion slow against the
    sampling leaves alone and white noise of variance σ² turns into σ [1].

Release
    From the moment of greatest speed go back to the last moment where the speed was below
    5 % of it.  If before that the signal stayed within 5 % of the way travelled in between,
    for at least 0.6 of the time travelled, somebody held it (a mere turning point of a swing
    stays so for 0.2 of it, of a hand-driven swing 0.4, by measurement), and the release is
    there.  The band lets the hand shake and drift.

[1] J. von Neumann et al., Ann. Math. Statist. 12 (1941) 153: the mean square successive difference.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import chain
from typing import Any

import numpy as np

from fracid.arrays import ROUNDED, FloatArray, Signals, within
from fracid.findings import Finding, Note, Words, with_code
from fracid.recording.dropout import dropouts, without_dropouts
from fracid.recording.faults import signal_faults
from fracid.recording.measures import GAP, PENDULUM, UNIFORM, Clock, SignalReport, measure_clock, measure_signal
from fracid.safety.json_files import plain
from fracid.safety.text import shortened
from fracid.signals.swing import half_swings, release_time
from fracid.units import with_time_unit

SAYS = Words("recording/report.toml")

LONG_GAP = 0.05
"""A gap of more than this part of the duration makes a recording unfit."""

LISTED = 1000
"""Times of each kind that are written out."""

BLANK = 0.05
"""Missing samples, of all, that are bridged: together they are no longer than a gap that is."""

COMMANDS = ("V", "N m")
"""Units of what drives a rig: nothing says what it was where it is missing."""

DRIVES = (*COMMANDS, "N", "A", "Pa")
"""Units of what may set a rig in motion, where no model says which signals are its inputs."""

SWING = ("rad", "m")
"""Units of what may swing: a level, a voltage or a temperature does not."""

OF_MOTION = ("jump", "spikes", "repeated")
"""Codes of what no motion does, and a command may: it jumps, and is held."""

SHORTLY = {"still": "stands still", "short-window": "too short"}
"""Findings whose code says little, in the verdict's line."""

FEW_SWINGS = 3
"""Fewer after a release tell neither its period nor its damping."""

SPENT, CALM = 3, 0.1
"""Times as long as it swings; from then on it has swung out if it moves by no more than this part of its range."""

WITH = 0.25
"""An input that changes until so long after the pendulum begins to move has moved it [s]."""

TOO_FEW, FEW = 20, 50
"""Fewer samples make a recording unfit, and no better than usable."""


@dataclass(frozen=True)
class Report:
    """All that was measured of a recording, and a verdict."""

    clock: Clock
    signals: tuple[SignalReport, ...]
    release: float | None
    """When the held pendulum is let go [s]."""
    release_reason: str
    """How that was found, or why not."""
    reading: tuple[str, ...] = ()
    """What was guessed, dropped or changed on reading, in sentences."""
    resampled: str | None = None
    """How the samples were brought onto a uniform grid, None if they are the file's own."""
    findings: tuple[Finding, ...] = ()
    """What may be wrong with unit, range and sampling of the signals (:mod:`fracid.recording.faults`)."""
    uneven: bool = False
    """Whether its samples are meant to lie unevenly: gaps and jitter are then no faults."""
    outputs: tuple[str, ...] = ()
    """Signals that may miss any samples but all, as a model's outputs may."""

    @property
    def faults(self) -> tuple[str, ...]:
        """Why the recording cannot be used as it is, with what to do."""
        c, outputs = self.clock, self.outputs
        missing = (_missing_fault(s, c) for s in self.signals if s.missing and not bridgeable(s, c, outputs))
        return tuple([*_clock_faults(c, self.uneven), *missing])

    @property
    def unusable(self) -> tuple[str, ...]:
        """Why no model can be identified from it, though it may be read and drawn."""
        c, moving = self.clock, any(s.range > 0 or s.missing for s in self.signals)
        still = tuple(str(f) for f in self.findings if f.code == "still")
        if 1 < c.samples < TOO_FEW:
            return (f"{c.samples} samples are too few to identify a model from: record {FEW} or more.", *still)
        if not moving and c.samples >= TOO_FEW:
            return ("no signal moves: is this the right file, and are its sensors connected?", *still)
        return still

    @property
    def warnings(self) -> tuple[str, ...]:
        """What stands against it without making it useless."""
        blanks = (_blanks(s, self.clock) for s in self.signals if s.missing and bridgeable(s, self.clock, self.outputs))
        return (*_clock_warnings(self.clock, self.uneven), *blanks, *map(str, self.findings))

    @property
    def level(self) -> str:
        """``good``, ``usable`` or ``unfit``."""
        return "unfit" if self.faults or self.unusable else "usable" if self.warnings or self.resampled else "good"

    @property
    def notes(self) -> tuple[str, ...]:
        """Everything worth saying, in sentences, the gravest first."""
        return (
            *dict.fromkeys((*self.faults, *self.unusable, *self.warnings)),
            *((self.resampled,) if self.resampled else ()),
            *chain.from_iterable(map(_signal_notes, self.signals)),
            *self.reading,
        )

    @property
    def verdict(self) -> str:
        """The recording in one line."""
        c = self.clock
        if self.level == "unfit":
            first, *others = *self.faults, *self.unusable
            more = f" (and {len(others)} more)" if others else ""
            return f"unfit: {first.split('. ')[0].rstrip('.')}{more}"
        how = "set in motion by its input" if with_code([self.release_reason], "by-input") else "released"
        unfound = "no release found" * any(s.unit == "rad" for s in self.signals)
        released = f"{how} at {self.release:.3f} s" if self.release is not None else unfound
        end = "ends at rest" if all(s.at_rest for s in self.signals) else "ends in motion"
        jitter = f"jitter {100 * c.worst_jitter:.2g} %" if c.worst_jitter > UNIFORM and not self.uneven else ""
        gaps = f"{len(c.gaps)} gap{'s' * (len(c.gaps) > 1)}" if c.gaps and not self.uneven else ""
        few = "few samples" if c.samples < FEW else ""
        found = (f"{f.where} {SHORTLY.get(f.code, f.code.replace('-', ' '))}".strip() for f in self.findings)
        missing = sum(len(s.missing) for s in self.signals)
        blanks = f"{missing} missing value{'s' * (missing > 1)}" if missing else ""
        against = ["resampled"] if self.resampled else filter(None, (few, jitter, gaps, blanks, *dict.fromkeys(found)))
        at = "of uneven steps" if self.uneven else f"at {c.rate:.5g} Hz"
        length = f"{c.samples} samples, {c.duration:.2f} s {at}"
        return f"{self.level}: {', '.join(filter(None, (length, released, end)))}; {', '.join(against)}".rstrip("; ")

    def of_model(self, inputs: Collection[str]) -> Report:
        """Leave out what is no fault of a model's inputs: they do not move as what has inertia, and nobody lets go.

        Nor what is none of its outputs, which may be measured now and then.

        Examples
        --------
        >>> t = np.arange(2000) / 100
        >>> goal = np.sin(np.floor(t))
        >>> report = measure(t, {"goal": goal, "angle": np.sin(3 * t)}, {"goal": "rad", "angle": "rad"})
        >>> [f.code for f in report.findings if f.where == "goal"], report.of_model(["goal"]).findings
        (['repeated'], ())
        """
        spared = {(code, n) for code in OF_MOTION for n in inputs}
        if any(s.range > 0 and s.name in inputs for s in self.signals):
            spared.add(("short-window", ""))
        outputs = tuple(s.name for s in self.signals if s.name not in inputs and s.unit not in COMMANDS)
        findings = tuple(f for f in self.findings if (f.code, f.where) not in spared)
        return replace(self, findings=findings, outputs=outputs)

    def rows(self) -> list[tuple[str, str]]:
        """Return (what, value) pairs for a table.

        Examples
        --------
        >>> t = np.arange(100) / 10
        >>> measure(t, {"alpha": np.cos(t)}, {"alpha": "rad"}).rows()[0]
        ('samples', '100')
        """
        c, gaps = self.clock, () if self.uneven else self.clock.gaps
        jitter = f"{c.jitter * 1e6:.3g} µs standard deviation, at most {100 * c.worst_jitter:.2g} % of a step"
        begins = f"{self.release:.3f} s" if self.release is not None else "none"
        what = "motion" if with_code([self.release_reason], "by-input") else "release"
        rows = [
            ("samples", str(c.samples)),
            ("duration", f"{c.duration:.6g} s"),
            ("rate", f"{c.rate:.6g} Hz (step {with_time_unit(c.step)})" if c.step > 0 else "unknown"),
            ("jitter", SAYS("uneven") if self.uneven else jitter if c.worst_jitter > 1e-6 else "none"),
            ("gaps", f"{len(gaps)}, {sum(g for _, g in gaps):.4g} s in all" if gaps else "none"),
            (what, f"{begins}: {self.release_reason}"),
        ]
        return rows if self.release is not None or any(s.unit == "rad" for s in self.signals) else rows[:-1]

    def signal_rows(self, factors: Mapping[str, float] = {}) -> list[dict[str, str]]:
        """Return one row of texts for each signal; angles in degrees, those in doubt as numbers, with their `factors`.

        Examples
        --------
        >>> t = np.arange(100) / 10
        >>> measure(t, {"alpha": np.cos(t)}, {"alpha": "rad"}).signal_rows()[0]["range"]
        '-57.3 … 57.3°'
        """
        return [_signal_row(_as_numbers(s, factors[s.name]) if s.name in factors else s) for s in self.signals]

    def to_dict(self) -> dict[str, Any]:
        """Return the report as plain values for JSON; a value that is not a number becomes None.

        Of times that are listed (gaps, missing samples, stamps that repeat or go back) the first 1000 are in it, and
        how many there are.

        Examples
        --------
        >>> measure(np.arange(99.0), {"a": np.arange(99.0)}, {"a": "1"}).to_dict()["level"]
        'good'
        """
        derived = {"level": self.level, "verdict": self.verdict, "notes": list(self.notes)}
        c, listed = self.clock, ("gaps", "duplicated", "backward")
        clock = {"rate": c.rate, "uniform": c.uniform} | {f"{name}_count": len(getattr(c, name)) for name in listed}
        short = replace(
            self, clock=replace(c, **{name: getattr(c, name)[:LISTED] for name in listed}),
            signals=tuple(replace(s, missing=s.missing[:LISTED]) for s in self.signals),
        )  # fmt: skip
        signals = {s.name: {"range": s.range, "missing_count": len(s.missing)} for s in self.signals}
        own = asdict(short)
        own |= {"clock": own["clock"] | clock, "signals": {s["name"]: s | signals[s["name"]] for s in own["signals"]}}
        return dict(plain(derived | own))


def measure(
    time: FloatArray, signals: Signals, units: Mapping[str, str], reading: tuple[str, ...] = (),
    resampled: str | None = None, bridged: Mapping[str, Sequence[tuple[float, float]]] | None = None, *,
    uneven: bool = False,
) -> Report:  # fmt: skip
    """Measure a recording.

    Parameters
    ----------
    time : ndarray, shape (n_samples,)
        [s], as the file has it: it may jitter, repeat and go back.
    signals, units : mappings
        Name to samples, shape (n_samples,), and name to unit.
    reading, resampled
        What was done before, carried into the report.
    bridged
        Signal → from when to when it was not measured [s]: what is there is no sample, and has no faults.
    uneven
        Whether samples are meant to lie unevenly, as those that crowd are: what is told by their steps is not asked.

    Returns
    -------
    Report

    Examples
    --------
    >>> t = np.linspace(0, 10, 1001)
    >>> swing = np.where(t < 4, 0.5, 0.5 * np.cos(6 * (t - 4)))
    >>> measure(t, {"alpha": swing}, {"alpha": "rad"}).verdict
    'good: 1001 samples, 10.00 s at 100 Hz, released at 4.000 s, ends in motion'
    """
    clock = measure_clock(time)
    disorder = bool(clock.duplicated or clock.backward)
    uneven = (uneven or clock.crowded) and not clock.uniform
    sound = signals if uneven or disorder else without_dropouts(signals, dropouts(time, signals, units))
    ordered = not disorder and clock.samples > 1
    release, reason = release_time(time, swinging(sound, units)) if ordered else (None, "time does not increase")
    driven = release is not None and _driven(time, signals, units, release)
    if driven:  # nobody let go
        reason = Note(f"{reason}, then an input moves it", "by-input")
    measured = tuple(measure_signal(n, units[n], time, x, sound=sound[n]) for n, x in signals.items())
    findings = () if uneven or disorder else signal_faults(time, _samples(time, signals, bridged or {}), measured)
    findings += tuple(_short(time, swinging(sound, units), None if driven else release, measured))
    return Report(clock, measured, release, reason, reading=reading, resampled=resampled, findings=findings,
                  uneven=uneven)  # fmt: skip


def _driven(time: FloatArray, signals: Signals, units: Mapping[str, str], release: float) -> bool:
    """Whether what may drive it changes before it moves, or with it."""
    before = time <= release + WITH
    return any(np.nanmax(x[before]) > np.nanmin(x[before]) for n, x in signals.items()
               if units[n] in DRIVES and np.isfinite(x[before]).any())  # fmt: skip


def _short(
    time: FloatArray, swing: FloatArray, release: float | None, signals: Collection[SignalReport]
) -> Iterable[Finding]:
    """A release that is hardly in the record."""
    if release is None or any(s.at_rest for s in signals) or not any(s.unit in SWING for s in signals):
        return
    after = (time >= release) & np.isfinite(swing)
    moving, seconds = swing[after], float(time[after][-1]) - release
    turns = half_swings(moving)
    calm = moving[SPENT * int(np.max(turns, initial=0)) :]
    swung_out = (SPENT + 1) * calm.size > moving.size and np.ptp(calm) < CALM * np.ptp(moving)
    if turns.size < 2 * FEW_SWINGS and not swung_out:
        yield SAYS.finding("short-window", "", turns.size / 2, FEW_SWINGS, seconds=seconds)


def _samples(time: FloatArray, signals: Signals, bridged: Mapping[str, Sequence[tuple[float, float]]]) -> Signals:
    """Signals without what bridges a gap: NaN there."""
    slack = -ROUNDED * float(np.ptp(time)) / max(1, time.size - 1)  # its ends were measured
    spans = {n: bridged[n] for n in signals if bridged.get(n)}
    return {**signals, **{n: np.where(within(time, at, slack), np.nan, signals[n]) for n, at in spans.items()}}


def swinging(signals: Signals, units: Mapping[str, str]) -> FloatArray:
    """Return the pendulum: `PENDULUM` if there is one, else the angle (else the signal) that moves most."""
    if PENDULUM in signals:
        return signals[PENDULUM]
    angles = [x for n, x in signals.items() if units[n] == "rad"] or list(signals.values())
    return max(angles, key=lambda x: float(np.ptp(x[np.isfinite(x)])) if np.isfinite(x).any() else 0.0)


# ----------------------------------------------------------------------- the sentences


def _disorder(c: Clock) -> Iterable[str]:
    if repeat := len(c.duplicated):
        those = "s repeat those" if repeat > 1 else " repeats the one"
        yield f"{repeat:,} stamp{those} before, the first at {min(c.duplicated):.6g} s"
    if back := len(c.backward):
        row, at, before = c.backward[0]
        first = f"the first in row {row}: {at:.6g} s after {before:.6g} s"
        yield f"{back:,} stamp{'s go' if back > 1 else ' goes'} back, {first}"


def _clock_faults(c: Clock, uneven: bool) -> Iterable[str]:
    if c.samples < 2:
        yield f"{c.samples} sample{'s' * (c.samples != 1)}; a recording needs at least two."
    if disorder := "; ".join(_disorder(c)):
        yield SAYS("disorder", disorder=disorder, part="split the file there" if c.backward else "cut the part out")
    longest = max((g for _, g in c.gaps), default=0.0)
    if not disorder and not uneven and longest > LONG_GAP * c.duration:
        at = next(t for t, g in c.gaps if g == longest)
        yield SAYS("gap", longest=longest, at=at, percent=100 * longest / c.duration)


def _clock_warnings(c: Clock, uneven: bool) -> Iterable[str]:
    if TOO_FEW <= c.samples < FEW:
        yield f"{c.samples} samples are few to identify a model from"
    if uneven:
        return
    if c.gaps:
        longest = sorted(c.gaps, key=lambda x: -x[1])[:3]
        gaps = ", ".join(f"{with_time_unit(g, '.3g')} after {t:.4g} s" for t, g in longest)
        more = f" and {len(c.gaps) - 3} shorter" if len(c.gaps) > 3 else ""
        yield f"samples are missing in {len(c.gaps)} gap{'s' * (len(c.gaps) > 1)} ({gaps}{more})"
    if c.worst_jitter > UNIFORM:
        yield SAYS("jitters", percent=100 * c.worst_jitter)


def _missing_fault(s: SignalReport, c: Clock) -> str:
    count, first, last = len(s.missing), f"{s.missing[0]:.6g} s", f"{s.missing[-1]:.6g} s"
    number = f"1 sample at {first}" if count == 1 else f"{count} samples from {first[:-2]} to {last}"
    return SAYS("at-end" if count < c.samples else "empty", signal=shortened(s.name), number=number)


def _blanks(s: SignalReport, c: Clock) -> str:
    count, ends = len(s.missing), np.flatnonzero(np.diff(s.missing) > GAP * c.step)
    row = np.max(np.diff([-1, *ends, len(s.missing) - 1]))
    number = f"1 sample at {s.missing[0]:.6g} s" if count == 1 else f"{count} samples, at most {row} in a row"
    return SAYS("missing" if bridgeable(s, c) else "sparse", signal=shortened(s.name), number=number,
                percent=100 * count / c.samples, it="it" if count == 1 else "them")  # fmt: skip


def bridgeable(s: SignalReport, clock: Clock, outputs: Collection[str] = ()) -> bool:
    """Whether the samples that a signal misses are few, or it is an output and has some: a fit does without them.

    Examples
    --------
    >>> t = np.arange(100.0)
    >>> r = measure(t, {"alpha": np.where(t % 20 > 0, np.nan, np.cos(t))}, {"alpha": "rad"})
    >>> bridgeable(r.signals[0], r.clock), bridgeable(r.signals[0], r.clock, ["alpha"])
    (False, True)
    """
    ordered = not (clock.duplicated or clock.backward) and clock.step > 0
    few = ordered and len(s.missing) <= BLANK * clock.samples and s.unit not in COMMANDS
    return few or (s.name in outputs and len(s.missing) < clock.samples)


def _signal_notes(s: SignalReport) -> Iterable[str]:
    if s.range == 0:
        yield f"{shortened(s.name)} is constant: is its sensor connected?"
    if s.unit == "rad" and s.resolution and 1.5 < s.range / s.resolution < 50:  # a switch has one
        yield f"{shortened(s.name)} moves through only {s.range / s.resolution:.0f} counts of its encoder."


def _as_numbers(s: SignalReport, factor: float) -> SignalReport:
    """A signal whose unit is in doubt, in the numbers of its file."""
    scaled = {n: factor * getattr(s, n) for n in ("minimum", "maximum", "noise", "rest")}
    resolution = None if s.resolution is None else factor * s.resolution
    return replace(s, unit="1", resolution=resolution, counts_per_turn=None, rest_offset=None, **scaled)


def _signal_row(s: SignalReport) -> dict[str, str]:
    show = _degrees if s.unit.startswith("rad") else "{:.4g}".format
    end = {"rad": "°", "rad/s": "°/s", "1": ""}.get(s.unit, f" {s.unit}")
    half_turn = s.rest_offset is not None and abs(s.rest_offset) < 0.5 < abs(s.rest)
    turns = round(s.rest / math.pi) if half_turn else 0
    whole = {1: "π", -1: "−π"}.get(turns, f"{turns}π")
    offset = f" ({show(s.rest_offset or 0.0)}{end} off {whole})" if half_turn else ""
    lattice = f"{s.counts_per_turn}/turn" if s.counts_per_turn else f"{show(s.resolution or 0.0)}{end}"
    return {
        "signal": shortened(s.name),
        "range": f"{show(s.minimum)} … {show(s.maximum)}{end}",
        "resolution": lattice if s.resolution else "none seen",
        "noise": f"{show(s.noise)}{end}",
        "rest": f"{show(s.rest)}{end}{offset}" if s.at_rest else "moving",
    }


def _degrees(value: float) -> str:
    degrees = math.degrees(value)
    return f"{degrees:.1f}" if abs(degrees) >= 100 else f"{degrees:.3g}" if abs(degrees) > 1e-9 else "0"
