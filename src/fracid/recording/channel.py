"""From a column of a file to a signal: units, sign, scale, zero, unwrapping, blanks.

::

    value = sign · scale · (raw in rad) − zero

The unit decides what "raw in rad" is; other quantities are taken to SI (mV to V), and pure numbers stay
as they are.  ``zero = "rest"`` is the mean of the recording's tail, which must be at rest.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from numbers import Integral
from typing import Any

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import LARGEST, SMALLEST, DataError, InputError, brief, is_number, refuse_beyond, refuse_unknown
from fracid.findings import Words
from fracid.safety.door import own_text
from fracid.signals.swing import tail

SAYS = Words("recording/recording.toml")

TABLES = tomllib.loads(own_text("recording/units.toml"))

UNITS: dict[str, tuple[float, str]] = {n: (row["factor"], row["of"]) for n, row in TABLES["signal"].items()}
"""Each unit of a file: the factor to the unit of the signal, and that unit."""

SPELLINGS = {other: n for n, row in TABLES["signal"].items() for other in row.get("also", ())}
"""Other spellings of units in headers."""

UNIT_WORDS = frozenset(w for kind in TABLES.values() for n, row in kind.items() for w in (n, *row.get("also", ())))
"""All words of units, of time too."""

GAP = re.compile(r"\s*(_(?!([a-z]|\d+)$)|/|\bin\b)\s*")
"""Between a name and its unit: one small letter or a number behind a line is an index."""

COUNTING = frozenset({"counts", "count", "cnt", "cnts", "ticks", "tick", "pulses", "increments", "inc"})
"""Units of headers that are counts of an encoder."""

ACCELERATION = re.compile(r"accel|beschl|acc[xyz]?([^a-z]|$)|(^|[^a-z])a[xyz]?([^a-z]|$)")
"""A column that is named like an acceleration: only there g and mg are no masses."""


@dataclass(frozen=True)
class Channel:
    """How one column of a file becomes one signal.

    Raises
    ------
    InputError
        A field has a value that it cannot have.

    Examples
    --------
    A 4096-count encoder that counts backwards, hanging at 2048:

    >>> hanging = Channel(2, "counts", sign=-1, counts_per_turn=4096, zero=-np.pi)
    >>> hanging.convert(np.array([2048.0, 1024.0]))
    array([0.        , 1.57079633])
    """

    column: int | str
    """Position from 0, or name."""
    unit: str | None = None
    """A key of ``UNITS``; None takes the header's unit, and rad where it names none."""
    sign: int = 1
    """+1 or −1."""
    scale: float = 1.0
    """A factor that corrects the logger, e.g. 0.99."""
    zero: float | str = 0.0
    """Subtracted after sign and scale [rad for angles], or ``"rest"``: the tail's mean."""
    counts_per_turn: int | None = None
    """Of the encoder, after quadrature; for unit ``counts``."""
    unwrap: bool = False
    """Undo jumps of a whole turn."""
    fill: str | None = None
    """``"hold"`` keeps the last value through blanks (a command logged only when it changes)."""

    def __post_init__(self) -> None:
        """Check every field."""
        counts, column = self.counts_per_turn, self.column
        whole = isinstance(counts, Integral) and counts > 0
        place = isinstance(column, Integral) and not isinstance(column, bool) and column >= 0
        possible = {
            "unit": (self.unit is None or self.unit in list(UNITS), _units_like(self.unit)),
            "unwrap": (isinstance(self.unwrap, bool), "true or false"),
            "sign": (self.sign in (1, -1), "1 or -1"),
            "scale": (_is_finite(self.scale) and self.scale != 0, "a number other than 0"),
            "zero": (self.zero == "rest" or _is_finite(self.zero), 'a number [rad] or "rest"'),
            "fill": (self.fill in (None, "hold"), '"hold"'),
            "counts_per_turn": (whole or (counts is None and self.unit != "counts"), "a whole number > 0"
                                if counts is not None else "e.g. 4096, with unit 'counts'"),
            "column": (isinstance(column, str) or place, "a position from 0 or a name"),
        }  # fmt: skip
        for name, (fits, expected) in possible.items():
            if not fits:
                raise InputError(f"{name} = {brief(getattr(self, name))} is not possible; expected {expected}.")
        refuse_beyond("scale", abs(self.scale), SMALLEST)
        if not isinstance(self.zero, str):
            refuse_beyond("zero", self.zero)

    @classmethod
    def of(cls, spec: Channel | Mapping[str, Any] | int | str, name: str = "a channel") -> Channel:
        """Return a channel from a column or a table of fields.

        Raises
        ------
        InputError
            A field is unknown or ``column`` is missing.

        Examples
        --------
        >>> Channel.of({"column": 2, "unit": "deg"}).unit
        'deg'
        """
        if not isinstance(spec, Mapping):
            return spec if isinstance(spec, Channel) else cls(spec)
        refuse_unknown(f"field of {name}", [f.name for f in fields(cls)], *spec)
        if "column" not in spec:
            raise InputError(f"{name}: no column given; type e.g. {name} = {{ column = 1 }}.")
        return cls(**spec)

    @property
    def signal_unit(self) -> str:
        """The unit of the signal: that of the second column of ``UNITS``."""
        return UNITS[self.unit or "rad"][1]

    def convert(self, raw: FloatArray, name: str = "the signal") -> FloatArray:
        """Return the signal from the raw column.

        Parameters
        ----------
        raw : ndarray, shape (n_samples,)
            As in the file; NaN is a missing sample.
        name : str
            Of the signal, for messages.

        Returns
        -------
        ndarray, shape (n_samples,)

        Raises
        ------
        DataError
            ``zero = "rest"`` and the tail still moves.

        Examples
        --------
        >>> Channel(0, "deg", zero="rest").convert(np.full(9, 180.0)).tolist()[0]
        0.0
        """
        turns = self.counts_per_turn or 1 if self.unit == "counts" else 1
        value = UNITS[self.unit or "rad"][0] / turns * raw
        if self.unwrap:
            mask = np.isfinite(value)
            value[mask] = np.unwrap(value[mask])
        value = self.sign * self.scale * value
        return value - (_rest(value, name) if self.zero == "rest" else float(self.zero))


def constant(name: str, fields: Mapping[str, Any]) -> tuple[float, str]:
    """A signal that does not change, and that no column has: its value in SI, and its unit there.

    Raises
    ------
    InputError
        For other fields than ``constant`` and ``unit``, no number, or an unknown unit.

    Examples
    --------
    >>> constant("current", {"constant": 300, "unit": "mA"})
    (0.3, 'A')
    """
    value, unit = fields["constant"], fields.get("unit", "1")
    refuse_unknown(f"field of {name}, which is constant", ("constant", "unit"), *fields)
    if not _is_finite(value):
        raise InputError(f"{name}: constant = {value!r} is not possible; expected a number, constant = 3.0.")
    refuse_unknown(f"unit of {name}", tuple(UNITS), unit)
    factor, si = UNITS[unit]
    return factor * float(value), si


Specs = Mapping[str, Channel | Mapping[str, Any] | int | str]
"""Signal → its channel, the fields of one, or a column alone."""


def si_unit(word: str) -> str:
    """The word, where it is a signal's unit; "1" for any other, which a model of one's own may have.

    Examples
    --------
    >>> [si_unit(word) for word in ("K", "cells/ml")]
    ['K', '1']
    """
    return word if word in (of for _, of in UNITS.values()) else "1"


def header_unit(word: str, name: str = "") -> str | None:
    """Return the unit that a header's word means behind a name, None if it means none of ``UNITS``."""
    unit, mass = SPELLINGS.get(word, word), word in ("g", "mg") and not ACCELERATION.search(name.lower())
    return unit if unit in UNITS and unit not in ("1", "counts") and not mass else None


def name_and_unit_behind(name: str) -> tuple[str, str]:
    """A column's name, and the unit that it ends in, ``force_N``, ``tau / mNm``, ``phi in deg``; "" for none.

    What divides by a unit is in a quotient, which is none: ``strain_per_kPa``, ``k_N/mm``.

    Examples
    --------
    >>> [name_and_unit_behind(n)[1] for n in ("x_mm", "gyro_z_deg_s", "tau / mNm", "phi in deg", "theta_m", "phi")]
    ['mm', 'deg_s', 'mNm', 'deg', '', '']
    >>> [name_and_unit_behind(n)[1] for n in ("strain_per_kPa", "k_N/mm", "c in 1/MPa", "q_1/rad", "acc_mg", "dose_mg")]
    ['', '', '', 'rad', 'mg', '']
    """
    for gap in GAP.finditer(name):
        stem, end = name[: gap.start()], name[gap.end() :]
        if header_unit(end, name):
            before = (stem[g.end() :] for g in GAP.finditer(stem))
            quotient = any(word in UNIT_WORDS or word.lower() == "per" for word in before)
            return (name, "") if quotient else (stem, end)
    return name, ""


def without_unit(name: str) -> str:
    """A column's name without the unit behind it.

    Examples
    --------
    >>> [without_unit(n) for n in ("u [V]", "u_V", "q/rad", "theta_m")]
    ['u', 'u', 'q', 'theta_m']
    """
    return name_and_unit_behind(re.sub(r"\s*[\[(].*", "", name))[0]


def _rest(value: FloatArray, name: str) -> float:
    rest, moving, at_rest = tail(value)
    if not at_rest:
        raise DataError(SAYS("moving-tail", name=name, moving=moving))
    return rest


def _units_like(word: Any) -> str:
    """The unit that a word means, else all of them."""
    meant = header_unit(word) if isinstance(word, str) else None
    return f"{' '.join(map(repr, UNITS))}; leave out any other" if meant is None else repr(meant)


def _is_finite(value: Any) -> bool:
    return is_number(value) and math.isfinite(value)


def measurable(raw: FloatArray, scale: float = 1.0) -> tuple[FloatArray, str]:
    """Return the samples without those that no instrument gives, as they stand or scaled, and a sentence on them."""
    limit = LARGEST / max(1.0, abs(scale))
    beyond = int(np.count_nonzero(np.abs(raw) > limit))  # infinite ones too; NaN is not
    if not beyond:
        return raw, ""
    are = "samples are" if beyond > 1 else "sample is"
    return np.where(np.abs(raw) > limit, np.nan, raw), SAYS("beyond", count=beyond, are=are, limit=limit)
