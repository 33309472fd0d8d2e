"""The swing in a sampled signal: its period and envelope, its release, its rest at the end.

A swing goes from side to side about where the signal comes to rest, or about the median of its motion where it does
not.  The *half-swings* are the samples at which it is first a tenth of its largest deviation beyond on the other side:
neither noise nor an encoder's step makes one.  The *period* is the median time between those of a side.  It
holds where the peak of a spectrum does not: with a plateau before the release, with a cable that drags the rest away,
and with noise, which dominates the spectrum of a speed.

==========================  =====================================================================
to know                     call
==========================  =====================================================================
how often it swings         :func:`swing_count`
the period of one signal    :func:`swing_period`; of several together :func:`common_period`
how large it is over time   :func:`envelope`
where the motion begins     :func:`release_time`, :func:`swing_start`, :func:`motion_start`
where each motion does      :func:`releases`
where it comes to rest      :func:`tail`
where it stays, or will     :func:`final_value`
whether it quickens         :func:`quickening`
==========================  =====================================================================
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fracid.arrays import FloatArray
from fracid.signals.noise import noise_floor, white_noise
from fracid.signals.resolution import resolution

SMOOTHED = 0.1
"""Of a balanced pendulum: accelerations are slopes over so long [s]."""

SURELY = 5.0
"""Standard errors from which on it is balanced."""

BEYOND = 0.1
"""A side is reached at this part of the largest deviation."""

CLEAR = 5.0
"""And at so many times the noise: a long tail has many samples of it."""

FEWEST = 3
"""Half-swings that make a period: one whole swing lies between them."""


def envelope(swing: FloatArray, period: int) -> FloatArray:
    """Half the range over a period about each sample [rad], shape (n,).

    Examples
    --------
    >>> t = np.arange(2000) / 100
    >>> size = envelope(3.0 + 0.5 * np.cos(2 * np.pi * t), 100)
    >>> round(float(size.min()), 3), round(float(size.max()), 3)
    (0.5, 0.5)
    """
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    return np.asarray(0.5 * (maximum_filter1d(swing, period | 1) - minimum_filter1d(swing, period | 1)))


def half_swings(signal: FloatArray) -> NDArray[np.intp]:
    """The samples at which a signal has come to the other side, shape (n_half_swings,).

    Examples
    --------
    >>> half_swings(np.cos(np.pi * np.arange(400) / 100)).tolist()  # it crosses at 50, 150, 250, 350
    [56, 152, 256, 352]
    """
    start = swing_start(signal)
    moving = signal[start:]  # without a plateau before it, which may be longer than the swing
    rest, _, at_rest = tail(moving)
    deviation = moving - (rest if at_rest else float(np.median(moving)))
    largest = float(np.max(np.abs(deviation)))
    noise = CLEAR * white_noise(moving) if moving.size > 3 else 0.0  # of few samples a swing it is the swing itself
    side = np.sign(deviation) * (np.abs(deviation) > max(BEYOND * largest, min(noise, 0.5 * largest)))
    beyond = np.flatnonzero(side)
    return np.asarray(start + beyond[1:][np.diff(side[beyond]) != 0])


def swing_count(signal: FloatArray) -> float:
    """How many swings a signal makes: half of its half-swings.

    Examples
    --------
    >>> swing_count(np.cos(np.pi * np.arange(400) / 100))
    2.0
    """
    return half_swings(signal).size / 2


def swing_period(signal: FloatArray) -> float:
    """The period [samples]; infinite where there is less than a whole swing.

    Where the signal wanders, as one that drifts or goes over the top does, the whole crosses its middle seldom: then it
    is that of its parts, of the longest in most of which it swings.

    Examples
    --------
    >>> t = np.arange(4000) / 100
    >>> swing_period(0.3 + np.exp(-0.05 * t) * np.cos(2 * np.pi * t))
    100.0
    >>> swing_period(np.exp(-t))
    inf
    """
    period, length = _period_about_the_middle(signal), signal.size // 2
    while length >= max(SHORTEST, signal.size // MOST_PARTS):
        starts = np.linspace(0, signal.size - length, min(LOOKED_AT, signal.size // length)).astype(int)
        parts = (signal[k : k + length] for k in starts)  # of which some move clearly
        moving = [p for p in parts if np.ptp(p) > max(4 * CLEAR * white_noise(p), 10 * (resolution(p) or 0.0))]
        local = [p for p in map(_period_about_the_middle, moving) if SWINGS_OF_A_PART * p <= length]
        if 2 * len(local) > len(moving):
            return float(np.median(local)) if np.median(local) < period / WANDERS else period
        length //= 2
    return period


WANDERS = 3.0
"""A period that is so many times that of most parts is none of a swing."""

SHORTEST, MOST_PARTS, LOOKED_AT, SWINGS_OF_A_PART = 64, 1024, 16, 6.0
"""Samples of the shortest part; into how many the whole is cut at most; so many are looked at; and what each has."""


def _period_about_the_middle(signal: FloatArray) -> float:
    turns = half_swings(signal)
    return float(np.median(turns[2:] - turns[:-2])) if turns.size >= FEWEST else math.inf


def common_period(signals: FloatArray) -> float:
    """The period of the signal that swings most often [samples]; infinite where none does a whole swing.

    Parameters
    ----------
    signals : array, shape (n_samples, n_signals)

    Examples
    --------
    >>> t = np.arange(4000) / 100
    >>> common_period(np.column_stack([np.exp(-t), np.cos(2 * np.pi * t)]))
    100.0
    """
    return swing_period(max(signals.T, key=swing_count))


def quickening(alpha: FloatArray, floor: float) -> float:
    """How much faster a pendulum's small swings are than its large ones, corrected for their size, as a part.

    A joint that gives before it slides is a spring to swings that are smaller than what it gives: they are quicker.
    Of a pendulum alone the half period at the amplitude A is π/ω · 2K(sin A/2)/π.

    Parameters
    ----------
    alpha : ndarray, shape (n,)
        The angle from about where it hangs, without the hand [rad].  The swings themselves say where that is: off by
        an offset they would be large and slow on one side, small and quick on the other.
    floor : float
        Amplitudes below this do not count [rad].

    Returns
    -------
    float
        0 where the record has too few swings to tell, or what it shows may be chance.

    Examples
    --------
    >>> t = np.arange(0, 60, 0.01)
    >>> abs(quickening(0.1 * np.exp(-0.05 * t) * np.cos(6 * t), 1e-3)) < 1e-3
    True
    >>> quicker = np.cos(6 * t + 0.2 * np.maximum(t - 30, 0))
    >>> round(quickening(0.1 * np.exp(-0.05 * t) * quicker, 1e-3), 3)
    0.033
    """
    from scipy.special import ellipk

    noise = min(CLEAR * white_noise(alpha), BEYOND * float(np.max(np.abs(alpha)))) if alpha.size > 3 else 0.0
    floor = max(floor, noise)  # else each sample of a long rest may be a swing
    _, extremes = half_periods(alpha, floor)
    if len(extremes) < 3:
        return 0.0
    crossings, extremes = half_periods(alpha - np.median(extremes[:-2] + 2 * extremes[1:-1] + extremes[2:]) / 4, floor)
    size = np.abs(extremes)
    swings = (size < math.pi) & (np.diff(crossings) > 0)  # what goes over the top has no period
    omega = 2 * ellipk(np.sin(0.5 * size) ** 2) / np.maximum(np.diff(crossings), 1.0)
    omega = omega[swings][np.argsort(size[swings])]
    if len(omega) < 4 * FEWEST - 1:
        return 0.0
    small, large = omega[: len(omega) // 4], omega[-(len(omega) // 4) :]
    change = np.median(small) / np.median(large) - 1
    chance = 3 * np.hypot(*(1.25 * np.std(o) / np.sqrt(len(o)) / np.median(o) for o in (small, large)))
    return float(change) if abs(change) > chance else 0.0


def half_periods(y: FloatArray, floor: float) -> tuple[FloatArray, FloatArray]:
    """Where a signal goes through zero [samples], and its furthest value between each two of these.

    What is not larger than the floor is no motion.

    Examples
    --------
    >>> crossings, extremes = half_periods(np.cos(np.pi * np.arange(400) / 100), 0.01)
    >>> crossings.round(6).tolist(), extremes.tolist()
    ([50.0, 150.0, 250.0, 350.0], [-1.0, 1.0, -1.0])
    """
    clear = np.flatnonzero(np.abs(y) > floor)
    turns = np.flatnonzero(np.signbit(y[clear[1:]]) != np.signbit(y[clear[:-1]]))
    crossings = np.array([_crossing(y, a, b) for a, b in zip(clear[turns], clear[turns + 1], strict=True)])
    return crossings, np.array([max(y[int(a) : int(b) + 1], key=abs) for a, b in pairwise(crossings)])


def _crossing(y: FloatArray, first: int, last: int) -> float:
    """Where a signal goes through zero between two samples, by the straight line through all between them."""
    k = np.arange(first, last + 1)
    slope, offset = np.polyfit(k, y[k], 1)
    return float(np.clip(-offset / slope, first, last)) if slope else 0.5 * (first + last)


def swing_start(signal: FloatArray) -> int:
    """The first sample that is a twentieth of the range away from the first one.

    Examples
    --------
    >>> swing_start(np.array([1.0, 1.0, 0.99, 0.5, 0.0]))
    3
    """
    return int(np.argmax(np.abs(signal - signal[0]) > 0.05 * np.ptp(signal)))


def motion_start(signal: FloatArray) -> int:
    """The first sample that is a hundredth of the range, and clearly more than the noise, away from the first ones.

    Examples
    --------
    >>> motion_start(np.concatenate([np.zeros(50), np.arange(50.0)]))
    51
    """
    first = float(np.median(signal[: max(1, signal.size // 200)]))
    return int(np.argmax(np.abs(signal - first) > 0.01 * np.ptp(signal) + CLEAR * noise_floor(signal)))


HELD, HELD_IN_NOISE = 0.6, 1.5
"""A plateau at least this long against the way to full speed was held; where noise hides what is slow, one so long."""

FALLING = (0.1, 0.5)
"""Of the way to full speed: where a fall has left its noise, and is still free."""

SURE, NOISY = 3.0, 0.15
"""Standard deviations of noise that are no motion; of the greatest speed, so much of them that none can be told."""


def tail(signal: FloatArray) -> tuple[float, float, bool]:
    """Return mean and peak-to-peak of the last 5 % of the samples, and whether they are at rest.

    At rest is a motion below 1 % of the whole range, or within three steps of the lattice.
    """
    x = signal[np.isfinite(signal)]
    if not x.size:
        return math.nan, math.nan, False
    end = x[-max(2, x.size // 20) :]
    motion = float(np.ptp(end))
    still = max(0.01 * float(np.ptp(x)), 3 * (resolution(x) or 0.0) * (1 + 1e-9))
    return float(np.mean(end)), motion, motion <= still


LATE_SWINGS = 2
"""In its second half, of a signal that swings about its middle to the end."""


def final_value(signal: FloatArray) -> float | None:
    """Where a signal comes to rest, or the middle about which it swings to the end; else None.

    What goes by more than a quarter of a turn, as an angle [rad], swings about nothing.

    Examples
    --------
    >>> t = np.arange(4000) / 100
    >>> round(final_value(0.3 + np.exp(-0.05 * t) * np.cos(2 * np.pi * t)), 2)
    0.3
    >>> final_value(t)
    """
    rest, _, at_rest = tail(signal)
    if at_rest:
        return rest
    late = signal[len(signal) // 2 :]
    level = 0.5 * (np.max(late) + np.min(late))
    upward = np.flatnonzero((late[:-1] < level) & (late[1:] >= level))
    if upward.size < 2:
        return None
    middle = float(np.median(late[upward[0] : upward[-1]]))  # of whole swings: half a swing more is up to 0.3 of it off
    swings = swing_count(late) >= LATE_SWINGS and float(np.max(np.abs(late - middle))) < math.pi / 2
    return middle if swings else None


def release_time(time: FloatArray, signal: FloatArray) -> tuple[float | None, str]:
    """Find the last sample of the held plateau before the fastest motion.

    Parameters
    ----------
    time, signal : ndarray, shape (n_samples,)
        Increasing time [s] and the pendulum's angle.

    Returns
    -------
    release : float or None
        [s]
    reason : str
        How long it was held, or why there is no release.

    Examples
    --------
    >>> t = np.linspace(0, 4, 401)
    >>> release_time(t, np.sin(6 * t))
    (None, 'it is not held still before its fastest motion')
    """
    finite = np.isfinite(signal)
    if np.count_nonzero(finite) < 10 or np.ptp(signal[finite]) == 0:
        return None, "nothing moves"
    t, x = time, np.interp(time, time[finite], signal[finite])  # smoothing would take a gap for a jump
    speed, level, of_speed, of_level = _speed(t, x)
    scatter = SURE * of_speed
    if scatter > NOISY * speed.max():
        return None, "its noise hides whether the pendulum is held before its fastest motion"
    fastest = int(np.argmax(speed >= 0.95 * speed.max() - scatter))  # the first, should many be alike
    slow = np.flatnonzero(speed[:fastest] < max(0.05 * speed[fastest], scatter))
    mid_swing = "it is not held still before its fastest motion"
    if not slow.size:
        return None, mid_swing
    last = int(slow[-1])
    travel, quarter = abs(level[fastest] - level[last]), t[fastest] - t[last]
    away = np.abs(level[:last] - level[last]) > max(0.05 * travel, CLEAR * of_level)
    begin = int(np.max(np.flatnonzero(away), initial=-1)) + 1
    release = last if level is x else _fall_begins(t, level, slice(begin, last + 1), fastest)
    duration = float(min(t[last], t[release]) - t[begin])
    if duration < (HELD if level is x else HELD_IN_NOISE) * quarter:
        return None, mid_swing
    return float(t[release]), f"held for {duration:.2f} s before"


AT_THE_TOP, UP = 0.9, 0.5
"""Parts of the height of a half-swing: a hand has raised it from the first on, and holds it above the second."""


def releases(time: FloatArray, signal: FloatArray) -> list[tuple[float, float]]:
    """From when to when it swings freely each time that it is held and let go [s].

    A hand that takes it raises it, perhaps through its rest, to where it holds it.  The free swing ends where it last
    passed its middle before that rise.

    Parameters
    ----------
    time, signal : ndarray, shape (n_samples,)
        As of :func:`release_time`, which has found one.

    Examples
    --------
    >>> t = np.linspace(0, 9, 901)
    >>> swing = np.where(t < 1, 0.5, 0.5 * np.exp(-(t - 1) / 2) * np.cos(6 * (t - 1)))
    >>> spans = releases(np.append(t, 9.01 + t), np.append(swing, 0.8 * swing))
    >>> [(round(start, 1), round(stop, 1)) for start, stop in spans]
    [(1.0, 8.6), (10.0, 18.0)]
    """
    finite = np.isfinite(signal)
    x = np.interp(time, time[finite], signal[finite])
    speed, *_ = _speed(time, x)
    y = x - np.median(x[speed >= np.median(speed)])  # that of all is drawn to where a hand holds it
    floor = CLEAR * noise_floor(x)
    crossings, _ = half_periods(y, max(BEYOND * float(np.max(np.abs(y))), floor))
    marks = list[int]()
    for a, b in pairwise([0, *crossings.astype(int), y.size]):
        height = np.abs(y[a:b])
        held = a + int(np.argmax(height > AT_THE_TOP * height.max()))
        release, _ = release_time(time[held:b], x[held:b])
        k = int(np.searchsorted(time, release or 0.0))
        if release is not None and abs(y[k]) > UP * height.max():
            marks.append(k)
    ends = [a + _free_until(x[a : b + 1], floor) for a, b in pairwise(marks)]
    return [(float(time[a]), float(time[b])) for a, b in zip(marks, [*ends, time.size - 1], strict=False)]


def _free_until(x: FloatArray, floor: float) -> int:
    """The last sample before a swing passes its middle for the last time before a hand raises it to its end."""
    up = (x - np.median(x)) * np.sign(x[-1] - np.median(x))
    up = up[: np.max(np.flatnonzero(up < AT_THE_TOP * up[-1]), initial=0) + 1]
    lowest = np.minimum.accumulate(up[::-1])[::-1]  # of each sample and those after it
    risen = int(np.max(np.flatnonzero(up - lowest > floor), initial=0))
    free = up[: risen + int(np.argmin(up[risen:])) + 1]
    return int(np.max(np.flatnonzero(np.diff(np.signbit(free - np.median(free)))), initial=0))


def _fall_begins(t: FloatArray, level: FloatArray, plateau: slice, fastest: int) -> int:
    """The last sample before a smoothed signal leaves a plateau: a free fall's rise is t², so its root is a line."""
    rise = np.abs(level - np.mean(level[plateau]))
    rise, last = rise / rise[fastest], int(plateau.stop) - 1
    falling = last + np.flatnonzero((rise[last:fastest] > FALLING[0]) & (rise[last:fastest] < FALLING[1]))
    if falling.size < 2:
        return last
    slope, offset = np.polyfit(t[falling], np.sqrt(rise[falling]), 1)
    moment = -offset / slope if slope > 0 else t[last]
    return int(max(plateau.start, min(fastest, np.searchsorted(t, moment) - 1)))


def _speed(t: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray, float, float]:
    """The speed of a signal, and that: by differences over 20 ms, or smoothed until noise is small; of either the
    standard deviation of the noise that is left.

    Smoothed are both ends of the difference, each by as many samples as they are from the middle; that alters neither
    the shape of a swing nor where it is slow, as long as it is a part of one.
    """
    step = float(np.median(np.diff(t)))
    # over 20 ms: one encoder step within one sample is no motion
    widest = (x.size - 1) // 2
    w = min(max(1, round(min(0.01 / step, x.size))), widest)
    noise, level = noise_floor(x), x
    speed, of_speed, of_level = _difference(t, x, w), noise / (math.sqrt(2) * w * step), noise
    m = 1
    while m < widest and SURE * of_speed > 0.05 * speed.max() and 2 * m * step * speed.max() < 0.5 * np.ptp(level):
        m = min(2 * m, widest)
        sums = np.cumsum(np.pad(x - x.mean(), (m // 2 + 1, m - 1 - m // 2), mode="symmetric"))
        level = (sums[m:] - sums[:-m]) / m + x.mean()  # of m samples about each
        speed = _difference(t, level, m)
        of_speed, of_level = noise / (math.sqrt(2) * m**1.5 * step), noise / math.sqrt(m)
    return speed, level, of_speed, of_level


def _difference(t: FloatArray, x: FloatArray, w: int) -> FloatArray:
    """|dx/dt| by central differences over w samples to each side; at the ends as beside them."""
    return np.pad(np.abs((x[2 * w :] - x[: -2 * w]) / (t[2 * w :] - t[: -2 * w])), w, mode="edge")


def slopes(y: FloatArray, samples: int, step: float) -> list[FloatArray]:
    """A signal, its speed and its acceleration: of cubics, each through so many samples (Savitzky and Golay).

    Examples
    --------
    >>> [float(x[0]) for x in np.round(slopes(np.arange(9.0) ** 2, 5, 1.0), 9)]  # at the third sample
    [4.0, 4.0, 2.0]
    """
    half = samples // 2
    cubic = np.linalg.pinv(np.vander(np.arange(-half, half + 1) / half, 4, increasing=True))
    return [np.convolve(y, cubic[k, ::-1], "valid") * math.factorial(k) / (half * step) ** k for k in range(3)]


def stands(alpha: FloatArray, theta: FloatArray | None, step: float) -> bool:
    r"""Whether a pendulum is balanced about α = 0: what drives it away, in α̈ = g sin α + c cos α θ̈ − b α̇, is sure.

    A hanging one has g below 0.  Angles in rad, shape (n_samples,); `step` in s.

    Examples
    --------
    >>> t = np.arange(0, 20, 0.01)
    >>> alpha = 0.03 * (np.sin(2 * t) + np.sin(5 * t))
    >>> stands(alpha, None, 0.01)                       # nothing but gravity moves it: it hangs
    False
    >>> arm = -0.03 * (13 / 4 * np.sin(2 * t) + 34 / 25 * np.sin(5 * t))  # θ̈ = 9 α − α̈
    >>> stands(alpha, arm, 0.01)
    True
    """
    width = max(5, round(SMOOTHED / step) | 1)
    if len(alpha) < 10 * width or np.max(np.abs(alpha)) > 1.0:
        return False
    a, rate, acceleration = slopes(alpha, width, step)
    arm = [] if theta is None else [np.cos(a) * slopes(theta, width, step)[2]]
    A = np.column_stack([np.sin(a), -rate, np.ones(len(a)), *arm])
    found, *_ = np.linalg.lstsq(A, acceleration)
    left = acceleration - A @ found
    error = math.sqrt(np.linalg.pinv(A.T @ A)[0, 0] * np.mean(left**2) * width)
    return bool(found[0] > SURELY * error)
