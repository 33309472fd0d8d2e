"""From a recording to W: the columns of the equations, filtered, without borders and standstill."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fracid.arrays import BoolArray, FloatArray, Pair, by_name, within
from fracid.errors import InputError
from fracid.findings import Words
from fracid.models import Model
from fracid.models.base import LinearTerms
from fracid.models.pendulum import LINEAR_TERMS
from fracid.problem import Experiment
from fracid.recording import Recording
from fracid.signals.resolution import noise_level
from fracid.solver.operators import derivative

SAYS = Words("regression/rows.toml")

Blocks = tuple[FloatArray, ...]
"""Something for the rows of each equation."""

TERMS = LINEAR_TERMS.names
"""Columns of the regressor of the rotary pendulum.  ``cable_offset`` is −cable_stiffness·theta_rest [N m]."""

LUMPED = LINEAR_TERMS.lumped
"""What is looked for unless said otherwise: the nine of :mod:`fracid.models.pendulum`."""

QUIET = 20.0
"""An angle that moves by less than this many noise levels in a swing is left out."""

STICKS = 1.0
"""Below this many slip speeds a joint may stick, and its friction is anything: left out."""

DRAWS = 4
"""Pairs of noisy repeats for the noise's covariance in W and for the bias."""

LOUD = 30.0
"""So many times its mean power no single frequency of a white noise comes by, but once in e^30."""

BENDS = 3.0
"""Noise levels by which a swing may leave the line over a gap: a longer gap has no rows."""

OVERSAMPLED = 20.0
"""Samples a period of the cut-off, after the low-pass."""

KAISER = 5.65
"""β of a Kaiser window of 60 dB."""


def _rates(x: FloatArray, order: float, step: float, time_scale: float) -> Pair:
    """D^q x and D^q D^q x, each times τ₀^(q−1); x may hold many signals in columns."""
    unit = time_scale ** (order - 1.0)
    rate = unit * from_rest(x, order, step)
    return rate, unit * from_rest(rate, order, step)


def from_rest(x: FloatArray, order: float, step: float) -> FloatArray:
    """Caputo's D^q of a signal that starts without a slope, as the solver has it: Riemann–Liouville's of its rise.

    Caputo's own would take the slope at the start from the data, and x₂ starts as t^λ, above order 1 hard to tell.
    """
    rates = derivative(x - x[:1], order, step, kind="rl")
    rates[0] = np.where(np.isfinite(rates[0]), rates[0], 0.0)
    return rates


def about_samples(u: FloatArray) -> FloatArray:
    """Of inputs that are held from each sample to the next the mean of before and after: what a low-pass sees there.

    Examples
    --------
    >>> about_samples(np.array([0.0, 1.0, 1.0])).tolist()
    [0.0, 0.5, 1.0]
    """
    return np.asarray(0.5 * (u + np.concatenate([u[:1], u[:-1]])))


def lines_over(lost: BoolArray, time: FloatArray, columns: FloatArray) -> FloatArray:
    """Columns with lines in the place of samples that are lost.

    Examples
    --------
    >>> lines_over(np.array([False, True, False]), np.arange(3.0), np.array([[1.0], [99.0], [2.0]])).ravel().tolist()
    [1.0, 1.5, 2.0]
    """
    return np.column_stack([np.interp(time, time[~lost], x[~lost]) for x in columns.T])


def longest_line(x: FloatArray, noise: float, period: float) -> float:
    """The longest gap over which x, of so much noise and that period [s], is a line within :data:`BENDS`."""
    return math.sqrt(4.0 * BENDS * noise / float(np.ptp(x))) * period / math.pi


def gaps_of(e: Experiment) -> tuple[tuple[float, float], ...]:
    """From when to when an output was not measured, or is masked, on the recording's own clock [s]."""
    return (*e.mask, *chain.from_iterable(e.blanks))


def terms_of(model: Model) -> LinearTerms:
    """The equations as columns and constants, if the model has them so."""
    if model.linear_terms is None:
        raise InputError(SAYS("other-model", model=model))
    return model.linear_terms


def own_values(model: Model, names: Sequence[str]) -> FloatArray:
    """The model's constants, shape (n_terms,)."""
    p = by_name(model.parameter_names, model.parameter_vector())
    p["cable_offset"] = -p["cable_stiffness"] * p.get("theta_rest", 0.0)
    return np.array([p[n] for n in names])


# --- filters -----------------------------------------------------------------------------------------


def _low_pass_reach(step: float, cutoff: float) -> int:
    """Samples that the low-pass takes from either side: Kaiser's (A − 7.95)/(2.285 Δω h)/2, A = 60, Δω = 2π cut-off."""
    return math.ceil((60.0 - 7.95) / (2.285 * 2.0 * math.pi * cutoff * step) / 2.0)


def _spectrum(x: FloatArray, step: float) -> Pair:
    """Frequencies above 0 [Hz] and the power of x at them; a white noise of variance σ² has σ² everywhere.

    By way of the differences, which are near 0 at a release, with a taper that keeps the start of a decay.
    """
    speed = np.diff(x)
    taper = np.cos(np.linspace(0.0, 0.5 * math.pi, len(speed)))
    power = np.abs(np.fft.rfft(speed * taper)) ** 2 / np.sum(taper**2)
    f: FloatArray = np.asarray(np.fft.rfftfreq(len(speed), step)[1:], dtype=np.float64)
    return f, np.asarray(power[1:] / (2.0 * np.sin(math.pi * f * step)) ** 2, dtype=np.float64)


# --- recordings --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Swing:
    """A recording as the regression sees it: from rest, or from before a release that lies inside it."""

    name: str
    step: float
    angles: FloatArray
    """θ and α, shape (n_samples, 2); θ is 0 where it was not recorded."""
    start: int
    """Sample of the release; 0 if it is the first."""
    drive: FloatArray | None
    """What torque_per_volt multiplies, shape (n_samples,); of one that is held between samples, the mean about each."""
    noise: FloatArray
    """Of both angles, rms [rad], shape (2,)."""
    arm: bool
    """Whether θ was recorded."""
    gaps: tuple[tuple[float, float], ...]
    """From when to when nothing was measured, or is masked: lines are there [s from the first sample]."""

    @cached_property
    def frequency(self) -> float:
        """Of the swing [Hz]: where the speed of α has most power, among what stands out of the noise."""
        f, power = _spectrum(self.angles[self.start :, 1], self.step)
        loud = power > LOUD * self.noise[1] ** 2
        return float(f[np.argmax(f**2 * power * (loud if loud.any() else 1.0))])

    @cached_property
    def cutoff(self) -> float:
        """Where the spectrum of the angles comes down to ten times the noise [Hz]."""
        frequencies = []
        for x, noise in zip(self.angles[self.start :].T, self.noise, strict=True):
            f, power = _spectrum(x, self.step)
            below = (np.convolve(power, np.ones(5) / 5.0, "same") < 10.0 * noise**2) & (f > self.frequency)
            frequencies.append(float(f[below][0]) if below.any() else 0.25 / self.step)
        return max(frequencies) if self.arm else frequencies[1]

    @cached_property
    def initial(self) -> tuple[FloatArray, FloatArray]:
        """Angles and speeds at the start, from a parabola [rad, rad/s]; speeds are 0 where it is a release."""
        first = self.angles[self.start :][: max(5, round(0.05 / self.frequency / self.step))]
        t = np.arange(len(first)) * self.step
        at_rest = np.linalg.lstsq(np.column_stack([np.ones_like(t), t**2]), first, rcond=None)[0][0]
        moving = np.polynomial.polynomial.polyfit(t, first, 2)
        top = np.ptp(self.angles, axis=0) * math.pi * self.frequency
        powers = np.vander(t, 3)
        of_noise = 3.0 * self.noise * math.sqrt(np.linalg.inv(powers.T @ powers)[1, 1])
        released = bool(np.all(np.abs(moving[1]) < np.maximum(0.25 * top.max(), of_noise)))
        return (at_rest, np.zeros(2)) if released or self.start else (moving[0], moving[1])

    @property
    def in_motion(self) -> bool:
        """Whether it starts in motion, so that what came before is missing from the memory."""
        return bool(np.any(self.initial[1] != 0.0))


def swing_of(recording: Recording, model: Model, e: Experiment | None = None) -> Swing:
    """Take what is needed out of a recording, and measure its noise; a problem's own `e` has what is masked.

    Raises
    ------
    InputError
        If α is missing or stands still, the samples are few, not all finite or on no uniform grid, or what drives the
        rig is not what the model takes.
    """
    name, signals = recording.name, recording.signals
    if "alpha" not in signals:
        raise InputError(SAYS("no-alpha", recording=recording, signals=", ".join(signals)))
    if recording.step is None:
        raise InputError(f"{name} is not on a uniform grid; type recording.resample() first.")
    (taken,) = model.inputs
    for other in {"torque", "voltage"} - {taken}:
        if np.any(signals.get(other, 0.0)):
            raise InputError(SAYS("other-input", name=name, other=other, taken=taken))
    drive, alpha = signals.get(taken), signals["alpha"]
    drive = drive if np.any(drive) else None
    release = recording.report.release if drive is None else None
    start = 0 if release is None else round((release - recording.time[0]) / recording.step)
    angles = np.column_stack([signals.get("theta", np.zeros_like(alpha)), alpha])
    e = e or Experiment.of(recording, model, [n for n in ("theta", "alpha") if n in signals])
    gaps = gaps_of(e)
    lost = within(recording.time, gaps, 1e-6 * e.step)
    if (count := int(np.sum(~lost[start:]))) < 100:
        raise InputError(f"{name}: {count} samples after the release; a regression needs at least 100.")
    if not np.all(np.isfinite(angles)):
        raise InputError(f"{name}: a sample is not a finite number; leave such samples out or fill them.")
    if np.ptp(alpha) == 0.0:
        raise InputError(f"{name}: alpha stands still, so nothing can be found; expected a swing.")
    if drive is not None and e.between.get(taken) == "hold":
        drive = about_samples(drive)
    angles = lines_over(lost, recording.time, angles)
    steps = {s.name: s.resolution or 0.0 for s in recording.report.signals}
    noise = [noise_level(x, steps.get(n, 0.0)) for n, x in zip(("theta", "alpha"), angles[start:].T, strict=True)]
    return Swing(name, recording.step, angles, start, drive=drive, noise=np.array(noise),
                 arm=float(np.ptp(angles[:, 0])) > 0.0,
                 gaps=tuple((a - recording.time[0], b - recording.time[0]) for a, b in gaps))  # fmt: skip


# --- rows: filtered, decimated, borders and standstill left out ---------------------------------------


@dataclass(frozen=True)
class Rows:
    """One recording's way from angles to rows, the same for measured, noisy and simulated angles."""

    swing: Swing
    model: Model
    names: tuple[str, ...]
    """Of the model's constants those that have a column."""
    cutoff: float
    """[Hz]"""
    window: float
    """[s]"""

    @cached_property
    def stride(self) -> int:
        """What is low-passed needs no more than OVERSAMPLED samples a period of the cut-off."""
        return max(1, int(1.0 / (OVERSAMPLED * self.cutoff * self.swing.step)))

    @cached_property
    def step(self) -> float:
        """Of the low-passed angles [s]."""
        return self.stride * self.swing.step

    @cached_property
    def past(self) -> int:
        """Low-passed samples before the record, where the filters need a past."""
        return 2 * math.ceil((self.window + 2.0 / self.cutoff) / self.step)

    @cached_property
    def hann(self) -> FloatArray:
        """The columns' window, shape (n, 1)."""
        window = np.hanning((round(self.window / self.step) | 1) + 2)[1:-1, None]
        return np.asarray(window / window.sum())

    def smooth(self, signals: FloatArray, base: FloatArray) -> FloatArray:
        """Low-pass signals that were at ``base`` before the record, shape (past + n_samples/stride, n_signals).

        Zero-phase: a Kaiser window of 60 dB with a transition as wide as twice the cut-off, for it is short: borders
        are lost.  After the record the last value goes on.
        """
        from scipy.signal import fftconvolve, firwin

        reach = _low_pass_reach(self.swing.step, self.cutoff)
        kernel = firwin(2 * reach + 1, self.cutoff, fs=1.0 / self.swing.step, window=("kaiser", KAISER))
        before, after = np.repeat(base[None], self.past * self.stride + reach, 0), np.repeat(signals[-1:], reach, 0)
        longer = np.concatenate([before, signals, after])
        return np.asarray(fftconvolve(longer, kernel[:, None], mode="valid", axes=0))[:: self.stride]

    def angles(self, noise: FloatArray | float = 0.0) -> FloatArray:
        """The measured angles, low-passed, with more noise where something moves."""
        s = self.swing
        base = s.angles[: max(1, s.start // 4)].mean(axis=0) if s.start else s.initial[0]
        return self.smooth(s.angles + noise, base)

    @cached_property
    def drive(self) -> FloatArray | None:
        """Low-passed as the angles, shape (n,)."""
        drive = self.swing.drive
        return None if drive is None else self.smooth(drive[:, None], drive[:1])[:, 0]

    @cached_property
    def kept(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Low-passed samples of the arm's and of the pendulum's rows: no borders, no gaps, and that angle moves."""
        s, smooth = self.swing, self.angles()
        border = math.ceil(_low_pass_reach(s.step, self.cutoff) / self.stride) + len(self.hann) // 2 + 1
        start = self.past + math.ceil(s.start / self.stride)
        grid = np.arange(start + border, len(smooth) - border, max(1, len(self.hann) // 4))
        longest = longest_line(s.angles[:, 1], s.noise[1], 1.0 / s.frequency)
        gaps = [(a, b) for a, b in s.gaps if b - a > longest]
        grid = grid[~within((grid - self.past) * self.step, gaps, border * self.step)]
        half = max(1, round(0.5 / s.frequency / self.step))
        swings = np.array([np.ptp(smooth[max(start, i - half) : i + half], axis=0) for i in grid]).reshape(-1, 2)
        speed = np.abs(np.gradient(smooth, self.step, axis=0)[grid])
        moves = (swings > QUIET * s.noise) & (speed > STICKS * self.model.parameter("slip_speed").value)
        return (grid[moves[:, 0]] if s.arm else grid[:0]), grid[moves[:, 1]]

    @cached_property
    def times(self) -> Blocks:
        """Of the rows, after the release [s]."""
        release = self.swing.start * self.swing.step
        return tuple(np.asarray((k - self.past) * self.step - release, dtype=np.float64) for k in self.kept)

    def __call__(self, many: Sequence[FloatArray], orders: Mapping[str, float]) -> list[Blocks]:
        """W of both equations, shapes (n_rows, n_terms), for each of many low-passed pairs of angles."""
        from scipy.signal import fftconvolve

        scale, terms = self.model.parameter("time_scale").value, terms_of(self.model)
        theta, alpha = np.stack(many, axis=-1).swapaxes(0, 1)
        both_rates = [_rates(x, orders[n], self.step, scale) for x, n in ((theta, "lambda"), (alpha, "mu"))]
        found, nothing = [], np.zeros(len(theta))
        for i in range(len(many)):
            rates = ((x[:, i], a[:, i]) for x, a in both_rates)
            both = terms.columns(self.model, theta[:, i], alpha[:, i], *rates, self.drive)
            W = (np.column_stack([columns.get(n, nothing) for n in self.names]) for columns in both)
            smooth = (fftconvolve(columns, self.hann, mode="same", axes=0) for columns in W)
            found.append(only(smooth, self.kept))
        return found


@dataclass(frozen=True)
class Data:
    """All recordings, low-passed once: as measured, and with noise added and taken away."""

    rows: tuple[Rows, ...]
    measured: tuple[FloatArray, ...]
    noisy: tuple[tuple[FloatArray, ...], ...]
    """With each draw of noise, and with its opposite behind it."""

    @classmethod
    def of(cls, rows: Sequence[Rows], factor: float = 1.0) -> Data:
        """With DRAWS draws of ``factor`` times the noise."""
        rng = np.random.default_rng(0)  # the same noise for all orders: what is minimised is smooth in them
        noisy = []
        for _ in range(DRAWS):
            errors = [factor * r.swing.noise * rng.standard_normal(r.swing.angles.shape) for r in rows]
            noisy += [tuple(r.angles(sign * e) for r, e in zip(rows, errors, strict=True)) for sign in (1, -1)]
        return cls(tuple(rows), tuple(r.angles() for r in rows), tuple(noisy))

    @property
    def model(self) -> Model:
        """Of all."""
        return self.rows[0].model

    @property
    def names(self) -> tuple[str, ...]:
        """Constants, one a column."""
        return self.rows[0].names

    @cached_property
    def own(self) -> FloatArray:
        """The model's values of them, shape (n_terms,)."""
        return own_values(self.model, self.names)

    def W(self, many: Sequence[Sequence[FloatArray]], orders: Mapping[str, float]) -> list[Blocks]:
        """Rows of all recordings, one below the other, for each of many sets of angles."""
        blocks = [r([angles[i] for angles in many], orders) for i, r in enumerate(self.rows)]
        return [_join([pairs[k] for pairs in blocks]) for k in range(len(many))]

    def system(self, orders: Mapping[str, float], draws: int = DRAWS) -> System:
        """W β = 0 at these orders."""
        measured, *noisy = self.W([self.measured, *self.noisy[: 2 * draws]], orders)
        return System(("arm", "pendulum"), measured, tuple(noisy))

    @cached_property
    def times(self) -> Blocks:
        """Of the rows [s]."""
        return _join([r.times for r in self.rows])


@dataclass(frozen=True)
class System:
    """W β = 0 of all recordings at given orders, and what noise does to it."""

    equations: tuple[str, ...]
    """Their names."""
    W: Blocks
    noisy: tuple[Blocks, ...] = ()
    """W of the angles with each draw of noise, and with its opposite behind it."""

    @cached_property
    def covariance(self) -> Blocks:
        """E[ΔWᵀ ΔW] of the noise, per equation, shape (n_terms, n_terms)."""
        sides = zip(*self.noisy, strict=True)
        changes = ([0.5 * (plus - minus) for plus, minus in zip(W[::2], W[1::2], strict=True)] for W in sides)
        return tuple(sum(change.T @ change for change in each) / len(each) for each in changes)

    def scales(self, beta: FloatArray, near: FloatArray | None = None) -> FloatArray:
        """Residual that noise makes in each equation, rms [N m]: what their rows are divided by.

        Kept within a factor of three of ``near``: else an equation whose constants shrink would weigh ever
        more, and shrink them to nothing.
        """
        pairs = zip(self.covariance, self.W, strict=True)
        own = np.array([math.sqrt(max(float(beta @ C @ beta), 1e-300) / max(len(W), 1)) for C, W in pairs])
        return own if near is None else np.clip(own, near / 3.0, near * 3.0)


def _join(parts: Sequence[Blocks]) -> Blocks:
    return tuple(map(np.concatenate, zip(*parts, strict=True)))


def only(blocks: Iterable[FloatArray], keep: Sequence[NDArray[Any]]) -> Blocks:
    """The rows to keep of each equation."""
    return tuple(W[rows] for W, rows in zip(blocks, keep, strict=True))
