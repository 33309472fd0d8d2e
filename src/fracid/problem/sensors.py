r"""A channel that is late, scaled, offset or filtered: what stands between a model and its recording.

======================  ================================================================================================
of an output y          recorded is :math:`g\,F[y](t - d) + b`: the sensor measures late
of an input u           the model takes :math:`g\,F[u](t - d) + b`: the actuator acts late
======================  ================================================================================================

with the delay d [s], the gain g, the bias b and the low-pass F of first order, :math:`T\dot z = y - z`, which begins at
rest at the first value.  Of each a number or :class:`Free`; what is free is a parameter of the problem like any other,
``delay_alpha``, ``gain_theta``, ``bias_voltage``, ``lowpass_alpha``, shared by all recordings whose channel says so, or
each recording's own (``per_recording``).

Outputs are *simulated* late: the run is read between its steps, by a cubic, so that a delay of a thousandth of a sample
counts as such.  What the first samples show of the time before the start, up to the delay's upper bound, is not scored.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

from fracid.errors import SMALLEST, InputError, refuse_beyond
from fracid.models import Model, Parameter
from fracid.problem.unknowns import Free, Value

Quantity = Literal["delay", "gain", "bias", "lowpass"]

QUANTITIES: dict[Quantity, str] = {
    "delay": "how late the channel is",
    "gain": "by what the channel is scaled",
    "bias": "what the channel adds",
    "lowpass": "time constant of the channel's low-pass",
}
"""What a channel may have, and what it is."""


class Reading(NamedTuple):
    """The numbers of one channel at a point of the search."""

    delay: float = 0.0
    """[s]"""
    gain: float = 1.0
    bias: float = 0.0
    """In the channel's unit."""
    lowpass: float = 0.0
    """Time constant [s]."""


@dataclass(frozen=True)
class Sensor:
    """Delay, gain, bias and low-pass of one channel; a number is fixed, :class:`Free` is estimated.

    Raises
    ------
    InputError
        For a value that is no finite number or beyond all quantities, a gain of 0, a time constant below 0.

    Examples
    --------
    >>> Sensor(delay=Free(0.0, -5e-3, 5e-3), gain=1.02).latest
    0.005
    >>> Sensor(gain=0.0)
    Traceback (most recent call last):
    fracid.errors.InputError: gain = 0 is not possible, nothing would be left of the signal; expected e.g. gain = 1.0.
    """

    delay: float | Free = 0.0
    """[s]"""
    gain: float | Free = 1.0
    bias: float | Free = 0.0
    """In the channel's unit."""
    lowpass: float | Free = 0.0
    """Time constant of a low-pass of first order [s]; 0 for none."""

    def __post_init__(self) -> None:
        """Refuse what no channel does."""
        for name in QUANTITIES:
            low, high = self.range(name)
            if not (math.isfinite(low) and math.isfinite(high)):
                raise InputError(f"{name} = {_text(low, high)} is not possible; expected finite numbers.")
            for value in (low, high):
                refuse_beyond(name, value)
        if (gain := self.range("gain"))[0] <= 0 <= gain[1]:
            raise InputError(
                f"gain = {_text(*gain)} is not possible, nothing would be left of the signal; expected e.g. gain = 1.0."
                if gain[0] == gain[1]
                else f"gain = {_text(*gain)} holds 0, where nothing is left of the signal; expected e.g. lower = 0.5."
            )
        for value in gain:
            refuse_beyond("gain's size", abs(value), SMALLEST)
        if self.range("lowpass")[0] < 0:
            raise InputError(
                f"lowpass = {_text(*self.range('lowpass'))} s is not possible; expected a time constant of 0 or more."
            )

    def range(self, name: Quantity) -> tuple[float, float]:
        """Lowest and highest value, the same for a number."""
        value = getattr(self, name)
        return (value.lower, value.upper) if isinstance(value, Free) else (float(value), float(value))

    @property
    def latest(self) -> float:
        """The longest delay [s]."""
        return max(0.0, self.range("delay")[1])

    @property
    def earliest(self) -> float:
        """By how much the channel may be early [s]."""
        return max(0.0, -self.range("delay")[0])

    def free(self, channel: str) -> dict[str, Free]:
        """Name of each quantity that is to be found → its range."""
        values = {name: getattr(self, name) for name in QUANTITIES}
        return {f"{name}_{channel}": value for name, value in values.items() if isinstance(value, Free)}

    def reading(self, channel: str, parameters: Mapping[str, float]) -> Reading:
        """Its numbers, those that are free from the parameters."""
        return Reading(*(
            parameters[f"{name}_{channel}"] if isinstance(value := getattr(self, name), Free) else float(value)
            for name in QUANTITIES
        ))  # fmt: skip


def with_sensors(
    model: Model, parameters: Mapping[str, Value], sensors: Iterable[Mapping[str, Sensor]], units: Mapping[str, str]
) -> tuple[Model, Mapping[str, Value]]:
    """Give a model the parameters of its free sensors, behind its own, and each its range where it has none yet.

    Parameters
    ----------
    model : Model
        Its right-hand side does not read them.
    parameters : mapping
        Of the problem.
    sensors : iterable of mappings
        Of each recording, channel → sensor.
    units : mapping
        Channel → unit, for its bias.

    Raises
    ------
    InputError
        If two recordings give one quantity two ranges, or the model has a parameter of that name.
    """
    more, ranges, own = list(model.parameters), dict(parameters), {p.name: p for p in model.parameters}
    stated: dict[str, Free] = {}
    for channel, sensor in ((c, s) for table in sensors for c, s in table.items()):
        for name, value in sensor.free(channel).items():
            constant = _parameter(name, value, channel, units.get(channel, "1"))
            if stated.setdefault(name, value) != value:
                raise InputError(
                    f"{name} has two ranges, {_range(stated[name])} and {_range(value)}: give every recording the "
                    f'same; where each has its own value, type per_recording = ["{name}"] as well.'
                )
            if name not in own:
                own[name] = constant
                more.append(constant)
            elif own[name].description != constant.description:
                raise InputError(f"{name} is free, but {model.name} has a parameter of that name: free that instead.")
            ranges.setdefault(name, value)
    return (model if len(more) == len(model.parameters) else replace(model, parameters=tuple(more))), ranges


def _parameter(name: str, value: Free, channel: str, unit: str) -> Parameter:
    quantity: Quantity = name.partition("_")[0]  # type: ignore[assignment]
    return Parameter(
        name, {"delay": "s", "gain": "1", "bias": unit, "lowpass": "s"}[quantity], value.start,
        f"{QUANTITIES[quantity]}: {channel}", lower=0.0 if quantity == "lowpass" else -math.inf,
    )  # fmt: skip


def _text(low: float, high: float) -> str:
    return f"{low:g}" if low == high else f"{low:g} … {high:g}"


def _range(value: Free) -> str:
    return f"{value.lower:g} … {value.upper:g} from {value.start:g}"
