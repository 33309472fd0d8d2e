"""A recording: one clock and its signals, with what was measured of them."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from fracid.arrays import ROUNDED, FloatArray, Signals, on_grid, real_array, stretches
from fracid.cards import Card, CardDisplay
from fracid.errors import DataError, InputError, brief
from fracid.figures import Figure, Style, draw
from fracid.findings import Note
from fracid.recording.channel import SAYS, UNITS, si_unit
from fracid.recording.edges import between_edges, counts_at_edges
from fracid.recording.measures import SignalReport
from fracid.recording.report import Report, measure
from fracid.units import letter, with_time_unit, with_unit

MOST_RESAMPLED = 50
"""Samples of a finer grid for each of the recording's."""


@dataclass(frozen=True, repr=False)
class Recording(CardDisplay):
    """Measured signals over one clock."""

    name: str
    path: Path
    sha256: str
    """Hash of the file."""
    time: FloatArray
    """Shape (n_samples,) [s]; the file's own, from the first sample where the file gives dates."""
    signals: Signals
    """Name to samples, shape (n_samples,) [rad for angles]."""
    units: Mapping[str, str]
    """Name to rad, rad/s, V, N m or 1."""
    report: Report
    held: frozenset[str] = field(default=frozenset())
    """Signals that keep their value between samples (commands), so are never interpolated linearly."""
    bridged: tuple[tuple[float, float], ...] = ()
    """From when to when :meth:`resample` bridged a gap [s]: no sample of it was measured."""
    blanks: Mapping[str, tuple[tuple[float, float], ...]] = field(default_factory=dict)
    """Signal → from when to when it was not measured, while others were [s]."""
    assumed: frozenset[str] = frozenset()
    """Signals of which neither the caller nor the file says a unit."""

    @property
    def uneven(self) -> bool:
        """Whether its samples are meant to lie unevenly: they crowd, or ``resample="uneven"`` says so."""
        return self.report.uneven

    @property
    def step(self) -> float | None:
        """Step of the uniform grid [s], None where the samples lie on none: :meth:`resample` first."""
        clock = self.report.clock
        return clock.duration / (clock.samples - 1) if clock.samples > 1 and clock.uniform else None

    def _card(self) -> Card:
        report, clock = self.report, self.report.clock
        every = "" if self.step is None else f", one every {with_time_unit(self.step)}"
        release = report.release_reason if report.release is None else f"{report.release:.3f} s"
        findings = f"{len(report.warnings)}: {report.warnings[0]}" if report.warnings else "none"
        return Card(f"Recording {self.name}: {report.level}", (
            ("samples", f"{clock.samples:,} over {clock.duration:.4g} s{every}"),
            ("release", release),
            ("findings", findings),
            *((letter(s.name), _extent(s)) for s in report.signals),
        ), (("file", self.path.name or "none"), ("verdict", report.verdict), ("SHA-256", self.sha256)))  # fmt: skip

    def plot(self, *, zero: str = "", style: str | Style = "screen") -> Figure:
        """Each signal whole, and close up about the release; see :func:`fracid.plots.recording_overview`.

        Parameters
        ----------
        zero : str
            Where the pendulum's angle is zero, where that is known: "hanging" or "upright".
        style : str or Style
            ``screen``, ``journal`` or one's own; see :mod:`fracid.figures`.

        Examples
        --------
        >>> twin = Recording.of("twin", np.arange(5.0), {"alpha": np.arange(5.0)})
        >>> twin.plot(zero="hanging").axes[0].get_ylabel()
        '$\\\\alpha$, 0 = hanging [°]'
        """
        return draw("recording_overview", self, zero=zero, style=style)

    def trim(self, start: float | str | None = None, stop: float | None = None) -> Recording:
        """Return the part from `start` to `stop` [s], both included; time keeps its zero.

        Parameters
        ----------
        start : float, "release" or None
            None is the first sample.
        stop : float, optional
            None is the last sample.

        Raises
        ------
        InputError
            Fewer than two samples lie there.
        DataError
            `start` is "release" and none was found.

        Examples
        --------
        >>> twin = Recording.of("twin", np.arange(5.0), {"alpha": np.arange(5.0)})
        >>> twin.trim(1.0, 3.0).time
        array([1., 2., 3.])
        """
        low = self._start(start)
        high = np.inf if stop is None else _seconds("to", stop)
        slack = 1e-6 * (self.report.clock.step if self.report.clock.samples > 1 else 0.0)
        inside = (self.time >= low - slack) & (self.time <= high + slack)
        if inside.sum() < 2:
            span = f"{self.time[0]:.6g} to {self.time[-1]:.6g} s" if self.time.size else "no time at all"
            raise InputError(SAYS("few-samples", name=self.name, low=low, high=high, count=inside.sum(), span=span))
        return self._with(self.time[inside], {n: x[inside] for n, x in self.signals.items()})

    def _start(self, start: float | str | None) -> float:
        if start is None:
            return -np.inf
        if not isinstance(start, str):
            return _seconds("from", start)
        if start != "release":
            raise InputError(f'from = {start!r} is not possible; expected a time [s] or "release".')
        if self.report.release is None:
            raise DataError(f"{self.name}: no release found ({self.report.release_reason}). Give from as a time [s].")
        return self.report.release

    def resample(self, step: float | None = None) -> Recording:
        """Return the recording on a uniform grid: commands held, all else interpolated linearly.

        Parameters
        ----------
        step : float, optional
            [s]; None takes the recording's own, rounded to three digits.

        Returns
        -------
        Recording
            Its report says how, and names each gap that was bridged.

        Raises
        ------
        InputError
            `step` is not positive or leaves fewer than two samples.
        DataError
            Time does not increase, or samples are missing.

        Examples
        --------
        >>> twin = Recording.of("twin", np.array([0, 0.11, 0.19, 0.3]), {"alpha": np.arange(4.0)})
        >>> twin.resample(0.1).time
        array([0. , 0.1, 0.2, 0.3])
        """
        demand_fitness(self)
        clock = self.report.clock
        h = float(f"{clock.step:.3g}") if step is None else float(step)
        if not 0 < h <= clock.duration:
            raise InputError(f"step = {step!r} s is not possible; expected above 0 and at most {clock.duration:.6g} s.")
        if clock.duration / h > MOST_RESAMPLED * max(clock.samples, 10_000):
            raise InputError(SAYS("long-step", name=self.name, h=h, samples=clock.duration / h, clock=clock))
        grid = self.time[0] + h * np.arange(int(clock.duration / h * (1 + 1e-12)) + 1)
        signals = {n: on_grid(self.time, x, grid, h, held=n in self.held) for n, x in self.signals.items()}
        longest = sorted(clock.gaps, key=lambda gap: -gap[1])[:5]
        gaps = "".join(SAYS("gap-bridged", gap=with_time_unit(g, ".3g"), after=t) for t, g in longest)
        more = f" So were {len(clock.gaps) - 5} more gaps." if len(clock.gaps) > 5 else ""
        hold_note = f" ({', '.join(sorted(self.held))}: last value held)" if self.held else ""
        how = f"Resampled to a step of {with_time_unit(h)} by linear interpolation{hold_note}.{gaps}{more}"
        slack = ROUNDED * h  # the ends of a gap were measured
        gap_insides = [(t + slack, t + g - slack) for t, g in clock.gaps]
        bridged = tuple((a, b) for a, b in gap_insides if np.any((grid > a) & (grid < b)))
        new = replace(self, bridged=(*self.bridged, *bridged))._with(grid, signals, resampled=how)
        # a line between two encoder steps lies on no lattice: what was measured before still holds
        reports = tuple(
            replace(s, resolution=r.resolution, counts_per_turn=r.counts_per_turn, noise=r.noise)
            for s, r in zip(new.report.signals, self.report.signals, strict=True)
        )
        return replace(new, report=replace(new.report, signals=reports))

    def between_edges(self) -> Recording:
        """Return the recording on a uniform grid if its rows are edges of encoders, else as it is.

        Examples
        --------
        >>> angle = np.round(100 * np.cos(6 * np.arange(0, 5, 1e-4)))
        >>> rows = np.flatnonzero(np.diff(angle)) + 1
        >>> sampled = Recording.of("twin", 1e-4 * rows, {"alpha": angle[rows]}).between_edges()
        >>> error = sampled.signals["alpha"] - 100 * np.cos(6 * sampled.time)
        >>> sampled.report.clock.uniform, bool(abs(error).max() < 0.5)
        (True, True)
        """
        if not (counts := counts_at_edges(self.time, self.signals)):
            return self
        time, signals = between_edges(self.time, self.signals, counts)
        note = SAYS("edges", count=len(self.time), counts=" or ".join(counts), ms=1e3 * (time[1] - time[0]))
        new = self._with(time, signals, note)
        known = {n: count for n, count in counts.items() if n in self.assumed}  # its unit is guessed from it
        reports = tuple(replace(s, resolution=known.get(s.name, s.resolution)) for s in new.report.signals)
        return replace(new, report=replace(new.report, signals=reports))

    def bridge_blanks(self, outputs: Collection[str] = ()) -> Recording:
        """Return the recording with its few missing samples interpolated, of which none is scored.

        At its ends they are left out.  The value is rounded to the encoder's step.  A recording that misses more
        (:func:`fracid.recording.report.bridgeable`) is returned as it is.  Of `outputs` any number may be missing, as
        of one that is assayed every minute: the others are scored there.

        Examples
        --------
        >>> alpha = np.where(np.arange(50) == 7, np.nan, np.arange(50.0))
        >>> bridged = Recording.of("twin", np.arange(50.0), {"alpha": alpha}).bridge_blanks()
        >>> float(bridged.signals["alpha"][7]), bridged.blanks
        (7.0, {'alpha': ((6.5, 7.5),)})
        """
        missing = {n: blank for n, x in self.signals.items() if (blank := ~np.isfinite(x)).any()}
        many, none = {n for n in outputs if n in missing and not missing[n].all()}, np.zeros(len(self.time), bool)
        lost = np.any([none, *(blank for n, blank in missing.items() if n not in many)], axis=0)
        lost |= bool(many) & np.all([missing.get(n, none) for n in outputs if n in self.signals], axis=0)
        if replace(self.report, outputs=tuple(many)).faults or not missing or lost.all():
            return self
        first, last = np.flatnonzero(~lost)[[0, -1]]
        part = slice(first, last + 1)
        time, half = self.time[part], 0.5 * self.report.clock.step
        edges = np.concatenate([time[:1] - half, 0.5 * (time[:-1] + time[1:]), time[-1:] + half])
        blanks = {n: tuple(map(tuple, edges[stretches(blank[part])].tolist())) for n, blank in missing.items()}
        steps = {s.name: s.resolution for s in self.report.signals}
        signals = {n: _filled(time, x[part], steps[n]) for n, x in self.signals.items()}
        notes = (SAYS("blank", name=n, count=np.sum(blank), times=blank.size) for n, blank in missing.items())
        return replace(self, blanks=blanks)._with(time, signals, *(Note(note, "interpolated") for note in notes))

    def masked(self, mask: Iterable[Sequence[float]]) -> Recording:
        """Return the recording with the findings of what is not masked, from when to when [s].

        Examples
        --------
        >>> alpha = np.where(np.arange(50) == 7, 90.0, np.sin(np.arange(50.0) / 9))
        >>> spike = Recording.of("twin", np.arange(50.0), {"alpha": alpha})
        >>> len(spike.report.findings), len(spike.masked([[7.0, 7.0]]).report.findings)
        (1, 0)
        """
        half = 0.5 * self.report.clock.step
        parts = tuple((part[0] - half, part[-1] + half) for part in mask if part)
        if not parts:
            return self
        outside = replace(self, bridged=(*self.bridged, *parts))._with(self.time, self.signals)
        return replace(self, report=replace(self.report, findings=outside.report.findings))

    def split(self, at: float) -> tuple[Recording, Recording]:
        """Return the parts before and from `at` [s].

        Raises
        ------
        InputError
            A part would hold fewer than two samples.

        Examples
        --------
        >>> twin = Recording.of("twin", np.arange(5.0), {"alpha": np.arange(5.0)})
        >>> [len(part.time) for part in twin.split(2.0)]
        [2, 3]
        """
        return self.trim(None, float(np.nextafter(at, -np.inf)) - 2e-6 * self.report.clock.step), self.trim(at)

    def _with(self, time: FloatArray, signals: Signals, *notes: Note, resampled: str | None = None) -> Recording:
        """Measured again; a release that was found stays, for the plateau that tells it may be cut off."""
        old, resampled = self.report, resampled or self.report.resampled
        report = measure(
            time, signals, self.units, (*old.reading, *notes), resampled=resampled,
            bridged={n: (*self.bridged, *self.blanks.get(n, ())) for n in signals},
            uneven=self.uneven and resampled is None,
        )  # fmt: skip
        of_the_file = tuple(f for f in old.findings if f.where == "time" or f.code == "other-unit")
        report = replace(report, findings=(*of_the_file, *report.findings))
        slack = 1e-6 * np.ptp(time) / max(1, len(time) - 1)
        if report.release is None and old.release is not None and time[0] - slack <= old.release <= time[-1]:
            report = replace(report, release=old.release, release_reason=old.release_reason)
        return replace(self, time=read_only(time), signals={n: read_only(x) for n, x in signals.items()}, report=report)

    @classmethod
    def of(cls, name: str, time: FloatArray, signals: Signals, units: Mapping[str, str] | None = None) -> Recording:
        """Return a recording of arrays that come from no file.

        Parameters
        ----------
        name : str
        time : ndarray, shape (n_samples,)
            [s]
        signals : mapping
            Name to samples, shape (n_samples,).
        units : mapping, optional
            Name to unit; where it says nothing that of an array's own ``attrs["units"]``, as xarray has it, or rad.

        Raises
        ------
        InputError
            A signal is not as long as time.

        Examples
        --------
        >>> Recording.of("twin", np.arange(5.0), {"alpha": np.zeros(5)}).step
        1.0
        """
        time = _array(f"{name}: time", time)
        if not hasattr(signals, "items"):
            raise InputError(SAYS("nameless", name=name, kind=type(signals).__name__))
        if not (arrays := {n: _array(f"{name}: {n}", x) for n, x in signals.items()}):
            raise InputError(f"{name}: no signal; expected e.g. {{'alpha': samples}}.")
        if not np.all(np.isfinite(time)):
            raise InputError(f"{name}: {np.count_nonzero(~np.isfinite(time))} time stamps are not finite.")
        own = {n: given["units"] for n, x in signals.items() if "units" in (given := getattr(x, "attrs", {}))}
        units = own | dict(units or {})
        for n, unit in units.items():
            if n not in arrays or unit != si_unit(unit):
                raise InputError(SAYS("other-unit", name=name, unit=unit, n=n, arrays=', '.join(arrays),
                                      units=', '.join(dict.fromkeys(of for _, of in UNITS.values()))))  # fmt: skip
        for n, x in arrays.items():
            if x.shape != time.shape or time.ndim != 1:
                raise InputError(SAYS("other-shape", name=name, n=n, shape=x.shape, time=time))
        signal_units = {n: units.get(n, "rad") for n in arrays}
        digest = hashlib.sha256(b"".join(map(np.ndarray.tobytes, (time, *arrays.values())))).hexdigest()
        report = measure(time, arrays, signal_units)
        return cls(
            name, Path(), digest, read_only(time), signals={n: read_only(x) for n, x in arrays.items()},
            units=signal_units, report=report, assumed=frozenset(arrays.keys() - units.keys()),
        )  # fmt: skip


def _filled(time: FloatArray, x: FloatArray, step: float | None) -> FloatArray:
    """A signal with its blanks interpolated, on its encoder's lattice."""
    blank = ~np.isfinite(x)
    whole: FloatArray = np.interp(time, time[~blank], x[~blank])
    if step and blank.any():
        before = x[~blank][np.searchsorted(time[~blank], time[blank]) - 1]
        whole[blank] = before + step * np.round((whole[blank] - before) / step)
    return whole


def _extent(s: SignalReport) -> str:
    ends = " to ".join(with_unit(x, s.unit) for x in (s.minimum, s.maximum)).replace("-", "−")
    return f"{ends}, step of the encoder {with_unit(s.resolution, s.unit)}" if s.resolution else ends


def demand_fitness(recording: Recording) -> None:
    """Raise the first faults of an unfit recording."""
    if recording.report.faults:
        first, others = recording.report.faults[:2], len(recording.report.faults) - 2
        more = f" And {others} more fault{'s' * (others > 1)}: fracid check lists them." if others > 0 else ""
        raise DataError(f"{recording.name}: {' '.join(first)}{more}")


def _seconds(name: str, value: Any) -> float:
    if not isinstance(value, Real):
        raise InputError(f"{name} = {brief(value)} is not possible; expected a time [s].")
    return float(value)


def _array(name: str, samples: Any) -> FloatArray:
    """Turn samples that a caller has into numbers, or say what is wrong; what is masked is missing."""
    values = real_array(samples, f"{name} is no array of real numbers: of time seconds, of angles radians.")
    return np.where(np.ma.getmaskarray(samples), np.nan, values) if np.ma.is_masked(samples) else values


def read_only(array: FloatArray) -> FloatArray:
    """A copy that cannot be written into."""
    array = np.array(array, dtype=float)
    array.setflags(write=False)
    return array
