r"""An encoder that drops out: its angle stays at exactly one value while the rig goes on.

An angle at rest, too, stays at exactly one value, where its encoder is coarse beside its noise.  So a standstill of
64 samples or more is a dropout only where one of these holds as well:

Jump
    The angle jumps to that value and back: to 0, say.  A jump is eight times as far as it moves from sample to sample
    beside it; what is let go accelerates, and what is caught stops where it is.  One way is enough where the angle is
    in motion on that side, and scatters there.

Lost noise
    Before, every sample scatters: by half a step q of the encoder or more (rounding alone leaves
    q/√12 = 0.29 q), in most stretches of 32 samples, with third differences that alternate as those of noise do.  Such
    scatter does not end by itself.  A rig that shakes while it moves is still when it rests, so two things more are
    asked for: the scatter is there to the last moment, and the other angle goes on by many steps, or the standstill
    begins in mid-motion, without a turning point.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fracid.arrays import BoolArray, FloatArray, Signals, stretches
from fracid.findings import Finding
from fracid.recording.backwards import SAYS
from fracid.signals.noise import white_noise
from fracid.signals.resolution import encoder_lattice, resolution
from fracid.units import with_unit

LONG = 64
"""Samples at one value: noise of half a step makes 20 of them by chance at most."""

MOST = 8
"""Standstills of a signal that are looked at, the longest first."""

NOISY = 0.5
"""Of a step of the encoder: rounding alone leaves 0.29."""

ALTERNATES = -0.4
"""Autocorrelation of third differences at one sample: noise has −0.75, a motion +1."""

STRETCH = 32
"""Samples of which a noise is measured."""

LAST, FADED = 8, 0.5
"""Stretches before a standstill in which a noise is no smaller than so: that of a shaking rig fades with its motion."""

BESIDE, FAR = 8, 8.0
"""Samples to each side that show how it moves there, and how many times that, or its step, is a jump or a motion."""

WAYS = {(True, True): ", and jumps there and back", (True, False): ", to which it jumps",
        (False, True): ", from which it jumps"}  # fmt: skip
"""Whether it jumps to a value, and from it, in words."""


@dataclass(frozen=True)
class Dropout:
    """Where an angle stays at one value for no motion of the rig."""

    signal: str
    first: int
    """The first sample that is not to be used."""
    stop: int
    """The first one that is again; the number of samples where there is none."""
    value: float
    """[rad]"""
    why: str
    """In words."""


def dropouts(time: FloatArray, signals: Signals, units: Mapping[str, str]) -> tuple[Dropout, ...]:
    """Find where angles drop out.

    Parameters
    ----------
    time : ndarray, shape (n_samples,)
        [s]
    signals, units : mappings
        Name to samples, shape (n_samples,), and name to unit; only those in rad are looked at.

    Examples
    --------
    >>> t = np.arange(0, 8, 0.004)
    >>> noise = 1e-3 * np.random.default_rng(1).standard_normal((2, t.size))
    >>> theta, alpha = 0.2 * np.sin(6 * t) + noise[0], np.cos(6 * t) + noise[1]
    >>> alpha[900:] = alpha[900]
    >>> found = dropouts(t, {"theta": theta, "alpha": alpha}, {"theta": "rad", "alpha": "rad"})
    >>> [(d.signal, d.first, d.stop) for d in found]
    [('alpha', 901, 2000)]
    """
    angles = {n: x for n, x in signals.items() if units[n] == "rad"}
    return tuple(d for n in angles for d in _of_signal(n, time, angles))


def without_dropouts(signals: Signals, found: tuple[Dropout, ...]) -> dict[str, FloatArray]:
    """Signals with NaN where they drop out.

    Examples
    --------
    >>> without_dropouts({"alpha": np.arange(4.0)}, (Dropout("alpha", 1, 3, 1.0, ""),))["alpha"].tolist()
    [0.0, nan, nan, 3.0]
    """
    sound = dict(signals)
    for d in found:
        sound[d.signal] = sound[d.signal].copy()
        sound[d.signal][d.first : d.stop] = np.nan
    return sound


def dropout_finding(found: Sequence[Dropout], time: FloatArray) -> Finding:
    """What those of one signal mean, and what to type to leave all of them out."""
    stays, typed, masks = [], list[str](), list[str]()
    for d in found:
        begin, end = float(time[d.first]), float(time[min(d.stop, time.size - 1)])
        if d.stop >= time.size:
            last = float(time[max(d.first - 1, 0)])
            when, typed = f"from {last:.6g} s on", [*typed, f"to = {last:.6g}"]
        elif d.first == 0:
            when, typed = f"until {end:.6g} s", [f"from = {end:.6g}"]
        else:
            when, masks = f"from {begin:.6g} to {end:.6g} s", [*masks, f"[{begin:.6g}, {float(time[d.stop - 1]):.6g}]"]
        stays.append(f"{with_unit(d.value, 'rad')} {when}")
    typed += [f"mask = [{', '.join(masks)}]"] if masks else []
    seconds = sum(float(time[min(d.stop, time.size - 1)] - time[d.first]) for d in found)
    return SAYS.finding("dropout", found[0].signal, seconds, 0.0, stays=" and ".join(stays), why=found[0].why,
                        typed=" and ".join(typed))  # fmt: skip


def _of_signal(name: str, time: FloatArray, angles: Signals) -> Iterator[Dropout]:
    x = angles[name]
    if not (runs := _standstills(x)):
        return
    sound = np.ones(x.size, dtype=bool)
    for a, b in runs:
        sound[a + 1 : b] = False
    lattice = encoder_lattice(x[sound & np.isfinite(x)])
    step = lattice.step if lattice else 0.0
    even = np.diff(time) <= 1.5 * np.median(np.diff(time))
    heard = x.copy()  # without those that are found: a noise is lost more than once
    for a, b in runs:
        jumps = _jumps(x, a, step, even), _jumps(x[::-1], x.size - b, step, even[::-1])
        moves = _moves(x, a, step), _moves(x[::-1], x.size - b, step)
        noisy = _scatter(heard[:a], step), _scatter(x[b:], step)
        if all(jumps) or any(all(way) for way in zip(jumps, moves, noisy, strict=True)):
            why = WAYS[jumps]
        else:
            why = _lost_noise(name, a, b, angles, noise=noisy[0], moving=moves[0])
        if why:
            heard[a + 1 : b] = np.nan
            yield Dropout(name, a if jumps[0] or a == 0 else a + 1, b, float(x[a]), why=why)


def _standstills(x: FloatArray) -> list[tuple[int, int]]:
    """(first, stop) of the longest stretches at one value, in the order of time."""
    if x.size < 2 * LONG:
        return []
    first, last = stretches(x[1:] == x[:-1]).T
    length = last - first + 1
    longest = np.argsort(-length)[:MOST]
    return sorted((int(first[k]), int(last[k]) + 1) for k in longest if LONG <= length[k] < x.size)


def _jumps(x: FloatArray, a: int, step: float, even: BoolArray) -> bool:
    """Whether it jumps from the sample before `a` to that one, beside how it moves before; not by a whole turn."""
    if a <= BESIDE or not even[a - 1]:
        return False
    jump = abs(float(x[a] - x[a - 1]))
    beside = float(np.max(np.abs(np.diff(x[a - BESIDE : a]))))
    turn = abs(jump - 2 * math.pi) < 0.2 * math.pi
    return bool(beside > 0 and jump > FAR * max(beside, step) and not turn)


def _moves(x: FloatArray, a: int, step: float) -> bool:
    """Whether it moves one way before `a`."""
    before = x[max(a - BESIDE, 0) : a]
    if before.size < BESIDE:
        return False
    far, way = abs(float(before[-1] - before[0])), np.diff(before)
    return bool(far > FAR * step and far > 0.9 * float(np.sum(np.abs(way))))


def _lost_noise(name: str, a: int, b: int, angles: Signals, noise: float, moving: bool) -> str:
    """Why a standstill after `a` is none of the rig; "" where it may be one."""
    parts = {n: x[a:b][np.isfinite(x[a:b])] for n, x in angles.items() if n != name}
    others = [n for n, x in parts.items()  # another angle moves meanwhile, by many steps and beyond its noise
              if x.size >= LONG and np.ptp(x) > FAR * max(resolution(x) or 0.0, white_noise(x))]  # fmt: skip
    if not noise or not (moving or others):
        return ""
    also = f"{others[0]} still moves" if others else "it was in mid-motion"
    return f", where its noise was {with_unit(noise, 'rad')} before and {also}"


def _scatter(x: FloatArray, step: float) -> float:
    """The noise that most stretches of a signal have; 0 where it is rounding, or a motion."""
    rough = np.diff(x, 3)
    if rough.size < 2 * STRETCH:
        return 0.0
    rows = rough[rough.size % STRETCH :].reshape(-1, STRETCH)
    power = np.mean(rows**2, axis=1)
    rows, power = rows[np.isfinite(power)], power[np.isfinite(power)]
    noise = math.sqrt(float(np.median(power)) / 20) if power.size else 0.0
    if not noise or np.min(power[-LAST:]) < FADED**2 * np.median(power):
        return 0.0
    alike = float(np.median(np.mean(rows[:, 1:] * rows[:, :-1], axis=1) / np.where(power > 0, power, np.inf)))
    return noise if noise > NOISY * step and alike < ALTERNATES else 0.0
