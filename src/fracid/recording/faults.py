r"""What may be wrong with the samples of one signal: its unit, its range, its sampling.

Degrees taken for radians
    An encoder's lattice tells: 4096 counts a turn in degrees are steps of 0.0879, and read as radians that would be
    71.5 counts a turn, which nobody sells.  Without a lattice: a pendulum that swings passes the top at most
    once a swing, so an α that goes by more than half a turn to *both* sides of its rest, again and again, is none.

Radians taken for degrees
    The lattice again: 1/57.3 of a step is 234,684 counts a turn.  Without one: swings of less than 1.6° are hardly
    worth a recording; as radians they are up to 92°.  And a pendulum's large swings are slower, those of 115° by a
    third: where swings of 2° are, and become as fast as they ought to be when they are taken for 2 rad, they are that.

Counts taken for radians
    Whole numbers: an angle that goes by dozens of radians in steps of exactly one is a counter.

Time in another unit
    A small pendulum swings with ω² = g/l.  A swing that takes 800 s is one of a pendulum 160 km long,
    or its milliseconds were taken for seconds.

A pendulum that stands still
    Its angle has one value throughout: a plug that is out, or the wrong channel.

A clock that was set
    Where samples are lost a swing has gone on meanwhile; where the clock jumped, a parabola through the samples on both
    sides fits five times as well if the gap is taken for one step.

Jumps
    What has inertia changes its speed by little from sample to sample, so the median of three neighbouring speeds, at
    its greatest, is the speed that lasts.  A step between two samples that is many times as fast is no motion: a count
    that was wrapped (a whole turn), a glitch, a zero or -9999 for what was not read, two recordings in one file.  Nor
    is a sample that lies far from both its neighbours while these agree, as where a tracker takes the wrong sign.

Repeated samples
    A logger that asks more often than the sensor answers writes each answer several times, on average half of that too
    late: an order bends for it.  A motion within one step of the encoder stands still too, but then goes on by
    one step.  Where the next sample has gone as far as those before the standstill did in the same time, and by many
    steps, the motion never stopped.  By chance 2 % of the samples look so, where noise is as strong as the motion.

Saturation
    A turning point is a parabola.  With L samples within one step q of its top, it has fallen by 4 q at L/2 samples
    beyond either end: by 3 q more.  A top that was cut off stays at *exactly* one value, and falls much faster at
    both its ends.  Held plateaus fall at one end alone, and do not come twice to the same count.  An input is
    cut off where it also comes near the limit gradually: a square wave jumps there, because it was told to.

Sampling
    A motion that is sampled often enough has no line near the highest frequency that can be seen, half the sampling
    rate (Nyquist's).  Where a signal has, there may be more beyond, and that is seen at a wrong frequency.  Power
    that is spread over all frequencies is noise, and no fault.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import groupby, islice

import numpy as np

from fracid.arrays import BoolArray, FloatArray, Signals, stretches
from fracid.findings import Finding
from fracid.recording.backwards import SAYS, counted_backwards
from fracid.recording.clock import SECONDS
from fracid.recording.dropout import dropout_finding, dropouts, without_dropouts
from fracid.recording.measures import FAMILIAR_COUNTS, GAP, SignalReport, is_pendulum
from fracid.signals.resolution import resolution
from fracid.signals.swing import final_value, quickening, stands, swing_count, swing_period
from fracid.units import with_unit

EXACT = 2e-3
"""Relative: a lattice this near to a familiar count is one."""

BOTH_SIDES = 3
"""Changes from half a turn on one side to half a turn on the other that no pendulum makes."""

HARDLY = math.radians(1.6)
"""Swings below this to each side are suspiciously small [rad]: as radians they are 92°."""

SLOWS, EXPLAINED = 0.03, 0.4
"""Of the rate: large swings of so few degrees are not slower by this, as those of so many radians are; and the part of
it that may be left when it is taken for that."""

FEW_TO_TELL = 8
"""Steps of its lattice below which a swing does not tell its period."""

FLAT = 12.0
"""Fall at both ends of a top, in steps, where a parabola falls by 3."""

RUNS = 2
"""Tops cut off at one value that are no chance."""

GRADUAL = 0.25
"""Of its range: an input that is this near its limit before it is reached was not told to jump."""

NEAR_NYQUIST = 0.05
"""Share of the power at one frequency above a quarter of the sampling rate; white noise has 0.01."""

SAMPLES_A_SWING = 8.0
"""Fewer draw no swing."""

FEW_COUNTS = 50
"""A signal that moves by fewer steps of its lattice is not looked at: it is all rounding."""

SLOW, FAST = 100.0, 1e-4
"""Lengths of pendulums that nobody swings in a laboratory [m]: 20 s and 0.02 s a swing."""

TYPICAL, UNLIKE = 0.3, 10.0
"""Of a laboratory's pendulum [m]; it is less than so many times as long, or as short."""

GRAVITY = 9.81
"""[m/s²]"""

BACK, MOST_SPIKES = 2.0, 0.05
"""Times what that speed takes it from sample to sample: further than that from both its neighbours, which agree, is no
motion; and the part of the samples that may be so."""

JUMP, FEW_JUMPS = 8.0, 0.01
"""Times the greatest speed that lasts: a sine of eight samples a period has 1.4; and of the samples: what jumps more
often is made so, as a rig with a stepper motor is."""

AROUND, JUMPED = 6, 3.0
"""Samples to each side of a gap that tell whether the clock jumped; steps of a gap that may be one."""

ALIKE, MOVED = 0.2, 0.05
"""A clock has jumped if the motion goes on so much more evenly without the gap; and of a step at full speed, what the
gap must spoil to be seen."""

REPEATED = 0.05
"""Of the samples: what noise repeats by chance is half of it at most."""

CELLS = 4.0
"""Steps, or noise, that a motion has gone on by when it had not stopped."""

LONGEST = 2**20
"""Samples whose spectrum is taken: the part that moves most."""


def signal_faults(time: FloatArray, signals: Signals, reports: Sequence[SignalReport]) -> tuple[Finding, ...]:
    """Look for the faults of the module's first screen.

    Parameters
    ----------
    time : ndarray, shape (n_samples,)
        [s]
    signals : mapping
        Name to samples, shape (n_samples,).
    reports : sequence of SignalReport
        What was measured of each.

    Returns
    -------
    tuple of Finding

    Examples
    --------
    >>> from fracid.recording import measure
    >>> t = np.arange(0, 10, 0.01)
    >>> degrees = 20 * np.cos(6 * t) * np.exp(-t / 9)      # read as radians
    >>> [f.code for f in measure(t, {"alpha": degrees}, {"alpha": "rad"}).findings]
    ['degrees-as-radians']
    """
    gone = dropouts(time, signals, {s.name: s.unit for s in reports})
    findings = [dropout_finding([*of_one], time) for _, of_one in groupby(gone, key=lambda d: d.signal)]
    whole, signals = signals, without_dropouts(signals, gone)
    angles = sum(s.unit == "rad" for s in reports)
    for s in reports:
        x = signals[s.name]
        mask = np.isfinite(x)
        pendulum = is_pendulum(s.name) or angles == 1
        if mask.sum() >= 10 and s.range == 0 and is_pendulum(s.name):
            findings.append(still(s.name, float(x[mask][0]), s.unit))
        if mask.sum() < 10 or not s.range > 0:
            continue
        x, t = (x, time) if mask.all() else (x[mask], time[mask])
        if s.unit != "rad":  # a command is held on purpose, and a voltage may jump
            findings += _saturated(s, x)
            continue
        findings += (*_unit(s, x, pendulum), *_jumps(s, t, x), *_repeated(s, t, x), *_saturated(s, whole[s.name]))
        for at, length in islice(clock_jumps(t, x), 1) if pendulum else ():
            findings.append(SAYS.finding("clock-jump", s.name, length, JUMPED * float(np.median(np.diff(t))), at=at))
        if not s.resolution or s.range >= FEW_COUNTS * s.resolution:
            findings += sampling if (sampling := list(_sampling(s, t, x))) or not pendulum else _clock(s, t, x)
    pair = {s.name: s for s in reports if s.name in ("theta", "alpha") and s.unit == "rad"}
    if len(pair) == 2 and len(time) > 1 and np.isfinite(signals["alpha"]).all():
        rest = pair["alpha"].rest if pair["alpha"].at_rest else final_value(signals["alpha"]) or 0.0
        step, about = float(np.median(np.diff(time))), signals["alpha"] - rest
        if round(rest / math.pi) % 2 and stands(about, signals["theta"], step):
            about += math.pi  # it is balanced there, with 0 where it hangs
        findings += counted_backwards(step, signals["theta"], about)
    return tuple(findings)


def still(name: str, value: float, unit: str) -> Finding:
    """A pendulum's angle that never changes.

    Examples
    --------
    >>> str(still("alpha", 0.0, "rad"))
    'alpha: it stays at 0° throughout: is its encoder connected? A model of the pendulum needs it to swing.'
    """
    return SAYS.finding("still", name, 0.0, 0.0, value=with_unit(value, unit), unit=unit)


# --- units -------------------------------------------------------------------------------------------


def _unit(s: SignalReport, x: FloatArray, pendulum: bool) -> Iterator[Finding]:
    if s.resolution is not None and abs(s.resolution - 1) < EXACT and s.range > FEW_COUNTS:
        yield SAYS.finding("counts-as-radians", s.name, s.range, float(FEW_COUNTS), turns=s.range / (2 * math.pi))
        return
    if s.resolution is not None and s.range >= FEW_COUNTS * s.resolution:
        counts = 2 * math.pi / s.resolution
        if familiar_counts(counts):
            return
        for code, factor, other in (("degrees-as-radians", 180 / math.pi, "degrees"),
                                    ("radians-as-degrees", math.pi / 180, "radians")):  # fmt: skip
            if familiar_counts(counts * factor):
                yield SAYS.finding("no-such-encoder", s.name, counts, round(counts * factor), other=other,
                                   there=counts * factor, unit=other[:3], code=code)  # fmt: skip
                return
    if not pendulum:  # an arm may turn as often as its cable allows
        return
    changes, turns = turns_to_both_sides(s, x)
    if changes >= BOTH_SIDES:
        yield SAYS.finding("degrees-as-radians", s.name, turns, 0.5, times=changes + 1)
    swing = math.degrees(0.5 * s.range)
    if math.degrees(HARDLY) <= swing < math.pi and (part := _slows(x - _middle(s, x))) > SLOWS:
        yield SAYS.finding("quicker", s.name, 100 * part, 100 * SLOWS, swing=swing, degrees=math.degrees(swing))
    elif swing < math.degrees(HARDLY):
        yield SAYS.finding("radians-as-degrees", s.name, swing, math.degrees(HARDLY), degrees=math.degrees(swing))


def _middle(s: SignalReport, x: FloatArray) -> float:
    """About what it swings."""
    return s.rest if s.at_rest else float(np.nanmedian(x))


def _slows(swing: FloatArray) -> float:
    """By which part large swings are slower than small ones, where they are radians and a pendulum explains that; 0."""
    floor = max(FEW_TO_TELL * (resolution(swing) or 0.0), 0.02 * float(np.max(np.abs(swing))))
    as_read, as_radians = quickening(swing, floor), quickening(np.degrees(swing), math.degrees(floor))
    return as_read if abs(as_radians) < EXPLAINED * as_read else 0.0


def turns_to_both_sides(s: SignalReport, x: FloatArray) -> tuple[int, float]:
    """How often it goes from beyond half a turn on one side to beyond it on the other, and how many turns it goes.

    Examples
    --------
    >>> from fracid.recording import measure
    >>> t = np.arange(0, 10, 0.01)
    >>> report = measure(t, {"alpha": 20 * np.cos(6 * t)}, {"alpha": "rad"})
    >>> turns_to_both_sides(report.signals[0], 20 * np.cos(6 * t))[0]
    19
    """
    x, around = x[np.isfinite(x)], _middle(s, x)
    side = np.sign(x - around) * (np.abs(x - around) > math.pi)
    changes = int(np.count_nonzero(np.diff(side[side != 0])))
    return changes, float(np.min(np.abs([x.max() - around, x.min() - around]))) / (2 * math.pi)


def familiar_counts(counts: float) -> bool:
    """Whether encoders of so many counts a turn are sold.

    Examples
    --------
    >>> familiar_counts(4096.1), familiar_counts(71.5)
    (True, False)
    """
    return any(abs(counts / reference - 1) < EXACT for reference in FAMILIAR_COUNTS)


# --- time --------------------------------------------------------------------------------------------


def _clock(s: SignalReport, t: FloatArray, x: FloatArray) -> Iterator[Finding]:
    """How long would a pendulum be that swings so?"""
    period = swing_period(x) * float(np.median(np.diff(t))) if swing_count(x) > 2 else math.inf
    length = GRAVITY * (period / (2 * math.pi)) ** 2
    if math.isfinite(length) and length > SLOW:
        unit = unit_of_time(length)
        far = f"{length:.3g} m" if length < 1e3 else f"{1e-3 * length:.3g} km"
        name = "wrong-clock" if unit else "counting-clock"
        yield SAYS.finding(name, s.name, length, SLOW, period=period, far=far, unit=unit)
    elif length < FAST and s.range > 2 * HARDLY:
        yield SAYS.finding("fast-clock", s.name, length, FAST, ms=1e3 * period, mm=1e3 * length)


def unit_of_time(length: float) -> str:
    """The unit in which a clock may be that has a pendulum so long, if it was taken for seconds [m]; "" for none.

    Examples
    --------
    >>> unit_of_time(2.3e5), unit_of_time(2.3e11), unit_of_time(181.0)  # frames at 30 Hz are in no unit
    ('ms', 'us', '')
    """
    units = (u for u in ("ms", "us", "ns") if TYPICAL / UNLIKE < length * SECONDS[u] ** 2 < TYPICAL * UNLIKE)
    return next(units, "")


def other_clock(length: float, column: str | None) -> tuple[str, str]:
    """The option that gives a clock as it may be, which has a pendulum so long as it was read [m], and its text.

    Examples
    --------
    >>> other_clock(2.3e5, "t"), other_clock(181.0, "frame")
    (('--time', 't,unit=ms'), ('--rate', 'HZ'))
    """
    unit = unit_of_time(length)
    return ("--time", f"{column},unit={unit}") if unit else ("--rate", "HZ")


def clock_jumps(t: FloatArray, x: FloatArray) -> Iterator[tuple[float, float]]:
    """(time, length) of the gaps of a clock beside which the motion goes on as if there were none [s].

    Where a logger has lost samples, a swing has gone on meanwhile, elsewhere and at another speed.  Where the clock was
    set, the next sample lies where one step takes it, and so does the one before.

    Examples
    --------
    >>> t = np.arange(0, 10, 0.01)
    >>> swing = np.cos(6 * t)
    >>> [*clock_jumps(np.where(t > 4, t + 0.3, t), swing)]
    [(4.0, 0.31)]
    >>> [*clock_jumps(t[(t < 4) | (t > 4.3)], swing[(t < 4) | (t > 4.3)])]
    []
    """
    dt = np.diff(t)
    if dt.size < 8 * AROUND or not np.any(dt > 0) or not np.isfinite(np.diff(x)).any():
        return
    step = float(np.median(dt[dt > 0]))
    speed = float(np.nanmax(np.abs(np.diff(x)))) / step
    index: FloatArray = (np.arange(2.0 * AROUND) - AROUND + 0.5) * step
    for k in np.flatnonzero(dt > JUMPED * step).tolist():
        near = np.arange(k - AROUND + 1, k + AROUND + 1)
        if near[0] < 0 or near[-1] >= t.size or np.sum(dt[near[:-1]] > GAP * step) > 1 or np.isnan(x[near]).any():
            continue
        as_if, as_said = _misfit(index, x[near]), _misfit(t[near] - 0.5 * (t[k] + t[k + 1]), x[near])
        if as_if < ALIKE * as_said and as_said > MOVED * speed * step:
            yield float(t[k]), round(float(dt[k]), 9)


def _misfit(t: FloatArray, x: FloatArray) -> float:
    """How far a parabola through samples is from them, root mean square."""
    scaled: FloatArray = t / float(np.max(np.abs(t)))
    return float(np.sqrt(np.mean((x - np.polyval(np.polyfit(scaled, x, 2), scaled)) ** 2)))


# --- jumps -------------------------------------------------------------------------------------------


def _jumps(s: SignalReport, t: FloatArray, x: FloatArray) -> Iterator[Finding]:
    if x.size < 16:
        return
    far = np.diff(x)
    turn = wraps(x)
    if turn.any():  # however often
        yield SAYS.finding("wrapped", s.name, float(np.max(np.abs(far))) / (2 * math.pi), 0.5,
                           often=_often(int(turn.sum())), at=t[np.argmax(turn)])  # fmt: skip
        return
    usual = float(np.median(np.diff(t)))
    steps, middle = np.maximum(np.diff(t), usual), _median_of_three(x)  # two stamps that jitter together make no motion
    lasting = float(np.max(np.abs(_median_of_three(np.diff(middle) / steps[1:-1]))))
    beside = np.abs(np.pad(x[1:-1] - middle, 1))
    least = max(0.05 * s.range, JUMP * (s.resolution or 0.0), JUMP * float(np.quantile(beside, 0.75)))
    for code, away, speed, limit, most in (("spikes", beside, beside / usual, BACK, MOST_SPIKES),
                                           ("jump", np.abs(far), np.abs(far) / steps, JUMP, FEW_JUMPS)):  # fmt: skip
        beyond = np.flatnonzero((speed > limit * lasting) & (away > least))
        if 0 < beyond.size <= max(2, most * x.size) and lasting > 0:
            yield SAYS.finding(code, s.name, float(np.max(speed[beyond])) / lasting, limit, at=t[beyond[0]],
                               far=_degrees(float(np.max(away[beyond]))), often=_often(beyond.size))  # fmt: skip
            return


def _often(count: int) -> str:
    return "once" if count == 1 else f"{count} times, first"


def _median_of_three(x: FloatArray) -> FloatArray:
    return np.asarray(np.median([x[:-2], x[1:-1], x[2:]], axis=0))


def wraps(x: FloatArray) -> BoolArray:
    """Where an angle jumps by a whole turn to the next sample, shape (n - 1,); nowhere if it jumps otherwise too.

    Examples
    --------
    >>> wraps(np.array([3.0, 3.1, -3.1, -3.0])).tolist()
    [False, True, False]
    """
    far = np.abs(np.diff(x))
    turn = np.abs(far - 2 * math.pi) < 0.1 * 2 * math.pi
    others = np.where(turn | ~np.isfinite(far), 0.0, far)
    return turn & bool(np.max(others, initial=0.0) < 0.5 * math.pi)


def _degrees(angle: float) -> str:
    return f"{math.degrees(angle):.4g}°" if abs(angle) < 1e3 else f"{angle / (2 * math.pi):.4g} turns"


# --- repeats -----------------------------------------------------------------------------------------


def _repeated(s: SignalReport, t: FloatArray, x: FloatArray) -> Iterator[Finding]:
    """The share of samples that stand still while the motion goes on, and how many do at a time; none beside a gap."""
    if x.size < 100:
        return
    step = float(np.median(np.diff(t)))
    first, last = stretches(x[1:] == x[:-1]).T
    n = last - first + 1
    inside = (first - n >= 0) & (last + 1 < x.size)
    first, last, n = first[inside], last[inside], n[inside]
    gaps = np.concatenate([[0], np.cumsum(np.diff(t) > GAP * step)])
    even = gaps[last + 1] == gaps[first - n]
    first, last, n = first[even], last[even], n[even]
    before, after = x[first] - x[first - n], x[last + 1] - x[last]
    rough = np.diff(x, 3)[: (x.size - 3) // 32 * 32].reshape(-1, 32)
    noise = math.sqrt(float(np.quantile(np.mean(rough**2, axis=1), 0.25)) / 20)  # where it is quietest
    least = CELLS * max(s.resolution or 0.0, noise)
    went_on = (before * after > 0) & (np.minimum(np.abs(before), np.abs(after)) > least)
    lengths = n[went_on & (np.abs(after) > 0.5 * np.abs(before))]
    if (share := float(lengths.sum()) / x.size) > REPEATED:
        each = float(np.median(lengths))
        yield SAYS.finding("repeated", s.name, 100 * share, 100 * REPEATED, each=each, late=0.5e3 * (each - 1) * step)


# --- range -------------------------------------------------------------------------------------------


def _saturated(s: SignalReport, x: FloatArray) -> Iterator[Finding]:
    angle = s.unit == "rad"
    q = s.resolution or (0.0 if angle else 1e-3 * s.range)
    cut = {limit: [*_flat_tops(x, limit, q, None if angle else GRADUAL * s.range)] for limit in (s.maximum, s.minimum)}
    alike = angle and abs(s.maximum + s.minimum) <= 0.5 * q  # once, and as far as on the other side: no chance either
    for limit, tops in cut.items():
        if len(tops) + alike >= RUNS:
            share = 100 * sum(stop - start for start, stop in tops) / x.size
            value = f"{math.degrees(limit):.4g}°" if angle else f"{limit:.4g} {s.unit}".rstrip(" 1")
            yield SAYS.finding("saturated" if angle else "at-limit", s.name, share, 0.0, value=value, times=len(tops))


def _flat_tops(x: FloatArray, limit: float, q: float, gradual: float | None) -> Iterator[tuple[int, int]]:
    """(start, stop) of the stretches at exactly the limit that begin and end too steeply for a turning point."""
    for start, stop in stretches(x == limit).tolist():
        half = (stop - start) // 2
        if stop - start < 3 or start - half < 0 or stop - 1 + half >= x.size:
            continue
        falls = abs(limit - x[start - half]), abs(limit - x[stop - 1 + half])
        jumps = gradual is not None and abs(limit - x[start - 1]) > gradual
        if min(falls) > FLAT * q and not jumps:
            yield start, stop


# --- sampling ------------------------------------------------------------------------------------------


def _sampling(s: SignalReport, t: FloatArray, x: FloatArray) -> Iterator[Finding]:
    if x.size < 16:
        return
    if x.size > LONGEST:
        middle = int(np.argmax(np.abs(x - s.rest)))
        first = min(max(0, middle - LONGEST // 2), x.size - LONGEST)
        t, x = t[first : first + LONGEST], x[first : first + LONGEST]
    step = float(np.median(np.diff(t)))
    power = np.abs(np.fft.rfft((x - x.mean()) * np.hanning(x.size))) ** 2
    total, band = np.concatenate([[0.0], np.cumsum(power)]), max(1, power.size // 100)
    within = (total[band:] - total[:-band])[power.size // 2 :]  # a hundredth of all frequencies
    share = float(within.max(initial=0.0)) / max(float(total[-1]), 1e-300)
    swing = x.size / max(1, int(np.argmax(power)))  # samples a period
    if share > NEAR_NYQUIST:
        yield SAYS.finding("aliased", s.name, 100 * share, 100 * NEAR_NYQUIST, quarter=0.25 / step, rate=1 / step)
    elif swing < SAMPLES_A_SWING:
        yield SAYS.finding("too-few-samples", s.name, swing, SAMPLES_A_SWING, rate=1 / step, better=20 / (swing * step))
