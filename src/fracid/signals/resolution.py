r"""The resolution of a sampled signal: the step of its encoder, or of the digits that it was written with.

Values of step q lie on a lattice, :math:`x = a + q k` with whole numbers k.  A file scatters them about it: 4096 counts
a turn, printed to 0.01°, are 0.08° and 0.09° apart; one count may be written in two ways; a few samples may be
interpolated.  So no single spacing decides.  Of each octave in which neighbouring values lie apart, the largest first:

1. The q of that octave is sought for which the values agree best, that is with the largest
   :math:`R(q) = |\sum_t \mathrm e^{2πi x_t/q}|` [1]_: first of the values next to their median, then of ever more of
   them, which tell it ever more finely.
2. q is believed if :data:`MOST` of the values lie nearer to the lattice than :data:`SCATTER` steps, cell by cell (a
   rest would outvote the motion), and chance does not explain it: of values that lie anywhere a part p lies within
   ± s steps of a line with the probability :math:`\mathrm e^{-n D}`, D the Kullback-Leibler divergence of p from 2 s.
3. A lattice that is :data:`BURIED` times finer than the noise is that of a file's digits, and no resolution.

References
----------
.. [1] D. G. Kendall, *Hunting quanta*, Phil. Trans. R. Soc. A 276 (1974) 231: the cosine quantogram.
"""

from __future__ import annotations

import math
from hashlib import blake2b
from typing import NamedTuple

import numpy as np

from fracid.arrays import FloatArray
from fracid.signals.noise import noise_floor, white_noise

MOST, SCATTER = 0.8, 0.2
"""So many of the values lie within so many steps of the lattice."""

COHERENT = 0.6
"""R below which values are on no lattice of this octave."""

ALIKE = 0.9
"""Of the best agreement: one as good."""

EVIDENCE = 12.0
"""−log of the probability of chance, beside the number of q that are tried."""

BURIED = 100.0
"""Times the step: noise of so much makes rounding nothing."""

EVEN = 1e-3
"""Of a step: as far again."""

RAMP, STILL = 0.8, 1e-6
"""Of the samples that move by more than that part of all: from there on a signal is an even ramp."""

EXACT, FEWEST = 1e-4, 8
"""Parts of a step by which spacings of whole counts may be off, and how many spacings say so."""

FINE = 8.0
"""Times the step of all values that those which stay are apart: then it is of printed digits."""

SEEN, COPIES = 500, 3.0
"""Values that a q is sought with at a time; how often a cell counts at most."""


class Lattice(NamedTuple):
    """Where the values of a signal lie."""

    step: float
    """q, in the signal's unit."""
    error: float
    """Its standard error."""


_FOUND: dict[bytes, Lattice | None] = {}
"""Of the digest of a signal; drafts and searches ask for one signal's up to ten times."""

KEPT = 1000
"""So many at most."""


def resolution(signal: FloatArray) -> float | None:
    """Return the spacing q of the lattice on which the values lie, None if they lie on none that matters.

    Examples
    --------
    >>> resolution(np.array([0.0, 0.3, 0.5, 0.2, 0.1]))
    0.1
    >>> resolution(np.sqrt(np.arange(100.0))) is None
    True
    """
    found = lattice(signal)
    return None if found is None else found.step


def lattice(signal: FloatArray) -> Lattice | None:
    """The lattice on which the values lie, with the doubt about its step.

    Examples
    --------
    4096 counts a turn, printed in degrees with two digits, one of them with more:

    >>> degrees = np.round(np.round(200 * np.sin(np.arange(2000) / 60)) * 360 / 4096, 2)
    >>> q, error = lattice(np.append(degrees, degrees[7] + 1e-7))
    >>> bool(abs(q - 360 / 4096) < 4 * error < 1e-4)
    True
    """
    key = blake2b(signal.tobytes(), digest_size=16).digest()
    try:
        return _FOUND[key]
    except KeyError:
        if len(_FOUND) >= KEPT:
            _FOUND.clear()
        return _FOUND.setdefault(key, _looked_for(signal))


def _looked_for(signal: FloatArray) -> Lattice | None:
    """The lattice, where nobody asked for it yet."""
    way = np.diff(signal, prepend=np.nan, append=np.nan)
    steady, moving = np.abs(np.diff(way)) <= EVEN * np.abs(way[1:]), way[:-1] != 0
    values, count = np.unique(signal[moving], return_counts=True)
    copies = count.astype(np.float64)
    going = np.abs(way[:-1]) > STILL * np.ptp(signal)
    if values.size < 2 or np.count_nonzero(going & steady) > RAMP * np.count_nonzero(going):
        return None  # of an even ramp any rate of samples makes a lattice
    spacings = np.diff(values)
    spacings = spacings[spacings > max(1e-9 * max(abs(values[0]), abs(values[-1])), 1e-12)]  # one value, written twice
    if not spacings.size:
        return None
    if values.size == 2:
        return Lattice(float(f"{spacings[0]:.12g}"), 0.0)
    whole = Lattice(1.0, 0.0) if np.array_equal(values, np.rint(values)) else None  # a counter's, whatever its noise
    if (exact := _exact(spacings)) is not None and noise_floor(signal) < BURIED * exact.step:
        return exact
    octaves, count = np.unique(np.round(np.log2(spacings)), return_counts=True)
    for octave in np.exp2(octaves[count >= min(3, 0.005 * spacings.size)])[::-1].tolist():  # but of a few small ones
        q = _agreed(values, np.minimum(copies, COPIES), octave)
        found = None if q is None else _believed(values, copies, q)
        if found is not None:
            return found if noise_floor(signal) < BURIED * found.step else whole
    return whole


def encoder_lattice(signal: FloatArray) -> Lattice | None:
    """The lattice of the values, or that of those which stay for two samples and more, where there is none but that.

    A log that was resampled in time has lines between its encoder's counts; where it stands it has the counts.  Beside
    those the lattice of all values is a fine one, of the digits that it was printed with.

    Examples
    --------
    >>> counts = 0.1 * np.round(20 * np.sin(np.arange(300) / 40))
    >>> resampled = np.interp(np.arange(0, 299, np.pi / 9), np.arange(300), counts)
    >>> resolution(resampled) is None, round(encoder_lattice(resampled).step, 9)
    (True, 0.1)
    """
    held = signal[1:][signal[1:] == signal[:-1]]
    of_all, of_held = lattice(signal), lattice(held) if np.unique(held).size > FEWEST else None
    return of_held if of_all is None or (of_held is not None and of_held.step > FINE * of_all.step) else of_all


def noise_level(signal: FloatArray, step: float | None = None) -> float:
    """The noise of a signal, but no less than the encoder's rounding q/√12 and 10⁻⁹.

    Parameters
    ----------
    signal : array, shape (n_samples,)
    step : float, optional
        The encoder's q; as :func:`resolution` has it, if left out.

    Examples
    --------
    >>> round(noise_level(np.round(np.cos(np.arange(5000) / 800), 2)) * math.sqrt(12), 3)
    0.01
    """
    q = (resolution(signal) or 0.0) if step is None else step
    white = white_noise(signal)
    return max(0.0 if math.isnan(white) else white, q / math.sqrt(12.0), 1e-9)


def _exact(spacings: FloatArray) -> Lattice | None:
    """The lattice of the smallest spacing, where all are multiples of it to the last digits: counts as they are."""
    k = np.rint(spacings / spacings.min())
    q = float(spacings.sum() / k.sum())
    if spacings.size < FEWEST or np.max(np.abs(spacings - q * k)) > EXACT * q:
        return None
    return Lattice(float(f"{q:.12g}"), 0.0)


def _agreed(values: FloatArray, weights: FloatArray, octave: float) -> float | None:
    """The q near an octave's middle at which the values agree, from those about their median to all."""
    middle = len(values) // 2
    x = values - values[middle]
    whole = max(-x[0], x[-1])
    width = max(8 * octave, min(x[min(middle + 12, len(x) - 1)], -x[max(middle - 12, 0)]))
    low, high = 2**-0.55 / octave, 2**0.55 / octave
    while True:
        near = slice(*np.searchsorted(x, [-width, width * (1 + 1e-9)]))
        few = slice(near.start, near.stop, -(-(near.stop - near.start) // SEEN))
        if (high - low) * width > 2 * SEEN:  # so few values so far apart tell no step so small
            return None
        rates = np.arange(low, high + 0.1 / width, 0.1 / width)
        R = _agreement(rates, x[few], weights[few])
        best = int(np.argmax(R))
        double = R[: np.searchsorted(rates, 0.55 * rates[best])]  # with q agrees q/2 too
        best = int(np.argmax(double)) if np.max(double, initial=0.0) > ALIKE * R[best] else best
        if R.max() < COHERENT:
            return None
        if width >= whole:
            return float(1 / rates[best])
        low, high = max(low, rates[best] - 0.3 / width), min(high, rates[best] + 0.3 / width)
        width = min(8 * width, whole)


def _agreement(rates: FloatArray, x: FloatArray, weights: FloatArray) -> FloatArray:
    """R at each of many even rates 1/q: e to a sum is a product, so that √N of N are enough."""
    some = math.isqrt(len(rates)) + 1
    coarse = np.exp(2j * np.pi * np.outer(rates[::some], x))
    fine = np.exp(2j * np.pi * np.outer(rates[:some] - rates[0], x))
    turns = np.einsum("ct,ft->cf", coarse, weights * fine)  # not by BLAS: it has threads, and few to share here
    return np.asarray(np.abs(turns.ravel()[: len(rates)]) / weights.sum())


def _believed(values: FloatArray, copies: FloatArray, q: float) -> Lattice | None:
    """The lattice through the values, where most lie on it and no chance puts them there."""
    x = values - values[len(values) // 2]
    for _ in range(2):  # lines through the nearest of them
        edge = float(np.angle(np.mean(np.exp(2j * np.pi * x / q)))) / (2 * np.pi) * q
        k = np.round((x - edge) / q)
        near = np.abs(x - edge - q * k) < SCATTER * q
        spread = float(np.sum((k[near] - k[near].mean()) ** 2))
        if not spread > 0:
            return None
        q = float((k[near] - k[near].mean()) @ x[near] / spread)
    off = np.abs((x - edge) / q - k)
    cells, cell = np.unique(k, return_inverse=True)
    weights = copies * np.minimum(1.0, COPIES / np.bincount(cell, copies)[cell])
    order = np.argsort(off)
    share = np.cumsum(weights[order]) / weights.sum()
    within = float(off[order[np.searchsorted(share, MOST)]])
    if within > SCATTER:
        return None
    chance = 2 * max(within, 1e-10)
    divergence = MOST * math.log(MOST / chance) + (1 - MOST) * math.log((1 - MOST) / (1 - chance))
    if (len(cells) - 2) * divergence < EVIDENCE + math.log(np.ptp(k)):
        return None
    error = float(np.sqrt(np.mean((x[near] - edge - q * k[near]) ** 2) / spread))
    return Lattice(float(f"{q:.12g}"), max(error, 1e-12 * q))
