"""The free parameters of a problem: a value that is fixed, Free within bounds, or Tied to another.

A :class:`Prior` is a normal density on a free parameter."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal

from fracid.errors import SMALLEST, InputError, refuse_beyond
from fracid.findings import Words
from fracid.safety.kinds import refuse_other_kinds

SAYS = Words("problem/unknowns.toml")

InitialState = Literal["estimate", "rest", "measured", "held"]

Weights = Literal["equal", "noise"]

Windows = float | Literal["auto", "none"]

FAR = 5.0
"""A search does not start further than this from a prior's mean [standard deviations]."""

NARROWEST = 1e-9
"""A range is at least this part of its bounds: derivatives are differences of values within it."""

FINEST = 1e-12
"""A typical size and a standard deviation are at least this part of the value: a step of that size must change it."""


@dataclass(frozen=True)
class Prior:
    """What is known of a value beforehand: a normal density; :mod:`fracid.problem.criterion` says how it weighs."""

    mean: float
    sd: float
    """Standard deviation, in the value's unit."""

    def __post_init__(self) -> None:
        """Refuse what is no density."""
        refuse_other_kinds(self)
        if not (math.isfinite(self.mean) and math.isfinite(self.sd) and self.sd > 0):
            raise InputError(SAYS("prior", mean=self.mean, sd=self.sd))
        refuse_beyond("the prior's mean", self.mean)
        refuse_beyond("the prior's sd", self.sd, max(FINEST * abs(self.mean), SMALLEST))


@dataclass(frozen=True)
class Free:
    """A value to be found: where the search starts and between which bounds.

    Where no scale is given, they tell it: least squares takes the start, or a hundredth of the range where that is
    more, for its typical size.
    """

    start: float
    lower: float
    upper: float
    prior: Prior | None = None
    """None: every value between the bounds is as likely as any other."""
    scale: float | None = None
    """Its typical size, by which a search measures steps; None: see above."""
    hard: bool = False
    """Whether its bounds hold where a search would go on beyond them (:mod:`fracid.problem.limits`)."""
    unit: str = field(default="", repr=False, compare=False)
    """Of a constant of a project's own equations; any other has its model's."""

    def __post_init__(self) -> None:
        """Refuse bounds that do not hold the start."""
        refuse_other_kinds(self)
        if not self.lower <= self.start <= self.upper or self.lower == self.upper:
            raise InputError(SAYS("range", start=self.start, lower=self.lower, upper=self.upper))
        finite = {n: v for n in ("lower", "start", "upper") if math.isfinite(v := float(getattr(self, n)))}
        for name, value in finite.items():
            refuse_beyond(name, value)
        largest = max(map(abs, finite.values()))
        if self.upper - self.lower < max(NARROWEST * largest, SMALLEST):
            raise InputError(SAYS("narrow", lower=self.lower, upper=self.upper, start=self.start))
        if self.scale is not None:
            refuse_beyond("scale", self.scale, FINEST * largest)
            if self.upper - self.lower < NARROWEST * self.scale:
                raise InputError(SAYS("scale", scale=self.scale, lower=self.lower, upper=self.upper))
        if self.prior is not None and math.isfinite(self.upper - self.lower):
            refuse_beyond("the prior's sd", self.prior.sd, FINEST * (self.upper - self.lower))
        if self.prior is not None and abs(self.start - self.prior.mean) > FAR * self.prior.sd:
            deviations = abs(self.start - self.prior.mean) / self.prior.sd
            raise InputError(SAYS("start-far-from-prior", start=self.start, deviations=deviations, prior=self.prior))

    def ending(self, interval: Iterable[float]) -> list[float]:
        """Its bounds at which an interval ends.

        Examples
        --------
        >>> Free(1.0, 0.5, 1.2).ending((0.9, 1.2)), Free(1.0, 0.5, 1.2).ending(())
        ([1.2], [])
        """
        return [bound for bound in (self.lower, self.upper) if any(math.isclose(bound, end) for end in interval)]


@dataclass(frozen=True)
class Tied:
    """A value that is always another's: ``"mu": Tied("lambda")``.

    Orders are tied to orders, parameters to parameters of the same unit; free or fixed, the other may itself be tied.
    """

    to: str
    """The other's name."""


Value = float | Free | Tied
"""A number is fixed."""

Values = Mapping[str, Value]
"""By the name of an order or a parameter."""


@dataclass(frozen=True)
class Unknown:
    """One entry of x."""

    name: str
    """``mu``, ``b_alpha``, ``theta_rest [release 92°]``, ``alpha(0) [release 92°]``, ``release_time [release 92°]``."""
    unit: str
    kind: Literal["order", "parameter", "initial", "time"]
    target: str
    """The order's, the parameter's or the state's own name; ``release_time``."""
    experiment: str | None
    """The recording that it belongs to; None where all share it."""
    range: Free
    complete: bool = False
    """Whether nothing but the range is possible: a presliding joint's part of what it gives."""

    @property
    def prior(self) -> Prior | None:
        """What intervals take for known beforehand: its prior, or a complete range as the normal of its variance."""
        middle, width = (self.range.lower + self.range.upper) / 2, self.range.upper - self.range.lower
        return self.range.prior or (Prior(middle, width / math.sqrt(12)) if self.complete else None)


def starting_value(value: Value) -> float:
    """Where the search starts: a number's own value."""
    assert not isinstance(value, Tied)
    return value.start if isinstance(value, Free) else float(value)


def ends_of(value: float | Free) -> tuple[float, float]:
    """The lowest and the highest that it may be: the same for a number."""
    return (value.lower, value.upper) if isinstance(value, Free) else (float(value), float(value))


def scaled(value: float | Free, factor: float) -> float | Free:
    """A number or a range times a factor.

    Examples
    --------
    >>> scaled(Free(1.0, 0.0, 3.0), -2.0)
    Free(start=-2.0, lower=-6.0, upper=-0.0, prior=None, scale=None, hard=False)
    """
    if not isinstance(value, Free):
        return factor * value
    lower, upper = sorted((factor * value.lower, factor * value.upper))
    prior = value.prior and Prior(factor * value.prior.mean, abs(factor) * value.prior.sd)
    return Free(factor * value.start, lower, upper, prior, scale=value.scale and abs(factor) * value.scale)


def root_of(what: str, name: str, values: Values) -> str:
    """Follow the ties from a name to the one that is tied to none."""
    path = [name]
    while isinstance(value := values.get(path[-1]), Tied):
        path.append(value.to)
        if value.to in path[:-1]:
            raise InputError(f"{' = '.join(path)} goes in a circle: give one {what} of them a number or a range.")
    return path[-1]
