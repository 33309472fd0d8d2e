r"""A channel that is late, scaled, offset or filtered: what stands between a model and its recording.

======================  ================================================================================================
of an output y          recorded is :math:`g\,F[y](t - d) + b`: the sensor measures late
of an input u           the model takes :math:`g\,F[u](t - d) + b`: the actuator acts late
======================  ================================================================================================

with the delay d [s], the gain g, the bias b and the low-pass F of first order, :math:`T\dot z = y - z`, which begins at
rest at the first value.  Of each a number or :class:`Free`; what is free is a parameter of the problem like any other,
``delay_alpha``, ``gain_theta``, ``bias_voltage``, ``lowpass_alpha``, shared by all recordings whose channel says so, or
each recording's own (``per_recording``).

A gyroscope measures an angle's rate, an accelerometer's signal is twice differentiated: ``angle_rate`` and
``angle_acceleration`` are outputs of every model that has an output ``angle``, differentiated along the run, whatever
the orders are (:func:`with_rates`).  An accelerometer on a pendulum, at the distance ``radius`` from its axis, shows
gravity too.

Outputs are *simulated* late: the run is read between its steps, by a cubic, so that a delay of a thousandth of a sample
counts as such.  What the first samples show of the time before the start, up to the delay's upper bound, is not scored.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import SMALLEST, InputError, refuse_beyond
from fracid.findings import Words
from fracid.models import Model, Parameter
from fracid.models.written.formulas import Formula
from fracid.models.written.tree import Entry, Function, Number, Return
from fracid.problem.unknowns import Free, Values, ends_of
from fracid.safety.door import own_text

SAYS = Words("problem/sensors.toml")

Quantity = Literal["delay", "gain", "bias", "lowpass", "radius"]

QUANTITIES: dict[str, str] = tomllib.loads(own_text("problem/quantities.toml"))
"""What a channel may have, and what it is."""


UNITS = {"delay": "s", "gain": "1", "lowpass": "s", "radius": "m"}
"""A bias is in the channel's."""


class Reading(NamedTuple):
    """The numbers of one channel at a point of the search."""

    delay: float = 0.0
    """[s]"""
    gain: float = 1.0
    bias: float = 0.0
    """In the channel's unit."""
    lowpass: float = 0.0
    """Time constant [s]."""
    radius: float = 0.0
    """[m]"""


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
    radius: float | Free = 0.0
    """Of an angle's acceleration that is recorded in m/s^2: how far from the axis [m]; gravity is seen too."""

    def __post_init__(self) -> None:
        """Refuse what no channel does."""
        for name in QUANTITIES:
            low, high = self.range(name)
            if not (math.isfinite(low) and math.isfinite(high)):
                raise InputError(f"{name} = {_text(low, high)} is not possible; expected finite numbers.")
            for value in (low, high):
                refuse_beyond(name, value)
        if (gain := self.range("gain"))[0] <= 0 <= gain[1]:
            raise InputError(SAYS("no-gain" if gain[0] == gain[1] else "gain-through-0", gain=_text(*gain)))
        for value in gain:
            refuse_beyond("gain's size", abs(value), SMALLEST)
        for name, what in (("lowpass", "a time constant"), ("radius", "a distance")):
            if self.range(name)[0] < 0:
                limits = _text(*self.range(name))
                raise InputError(f"{name} = {limits} {UNITS[name]} is not possible; expected {what} of 0 or more.")

    def range(self, name: str) -> tuple[float, float]:
        """Lowest and highest value, the same for a number."""
        return ends_of(getattr(self, name))

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


RATES = {"_rate": 1, "_acceleration": 2}
"""How an output is called that is another's derivative, and how often that is differentiated."""


def with_rates(model: Model, signals: Iterable[str]) -> Model:
    """Give a model those of the signals as outputs that are the rate or the acceleration of one that it has.

    Examples
    --------
    >>> import fracid
    >>> gyro = with_rates(fracid.model("pendulum"), ["angle_rate", "torque"])
    >>> gyro.derived, gyro.output_unit("angle_rate")
    ({'angle_rate': ('angle', 1)}, 'rad/s')
    """
    known = (*model.outputs, *model.inputs)
    found = {n: (n.removesuffix(end), k) for n in signals if n not in known for end, k in RATES.items()
             if n.endswith(end) and n.removesuffix(end) in model.outputs}  # fmt: skip
    functions = {n: model.outputs[of] for n, (of, _) in found.items()}
    outputs = {n: Formula(Function(n, ("t", "x", "u", "p"), (Return(Entry("x", Number(h))),)))
               if isinstance(h, int) else h for n, h in functions.items()}  # fmt: skip
    units = {n: model.output_unit(of) + ("/s" if k == 1 else "/s^2") for n, (of, k) in found.items()}
    return replace(model, outputs={**model.outputs, **outputs}, output_units={**model.output_units, **units},
                   derived={**model.derived, **found})  # fmt: skip


def integrated(signal: FloatArray, step: float | FloatArray, degree: int) -> tuple[FloatArray, FloatArray]:
    """What a derivative was taken of, and its rate, if both move about 0; shape (n_samples,) each.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(0, 2 * np.pi, 0.01)
    >>> float(abs(integrated(np.cos(t), 0.01, 1)[0] - np.sin(t)).max()) < 0.02
    True
    """
    signals = [signal]
    for _ in range(degree):
        integral = np.cumsum(step * signals[-1])
        signals.append(integral - integral.mean())
    return signals[-1], signals[-2]


def with_sensors(
    model: Model, parameters: Values, sensors: Iterable[Mapping[str, Sensor]], units: Mapping[str, str]
) -> tuple[Model, Values]:
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
    ranges, own = dict(parameters), {p.name: p for p in model.parameters}
    stated: dict[str, Free] = {}
    for channel, sensor in ((c, s) for table in sensors for c, s in table.items()):
        for name, value in sensor.free(channel).items():
            constant = _parameter(name, value, channel, units.get(channel, "1"))
            if stated.setdefault(name, value) != value:
                raise InputError(SAYS("two-ranges", name=name, one=_range(stated[name]), other=_range(value)))
            if own.setdefault(name, constant).description != constant.description:
                raise InputError(f"{name} is free, but {model.name} has a parameter of that name: free that instead.")
            ranges.setdefault(name, value)
    return (replace(model, parameters=tuple(own.values())) if len(own) > len(model.parameters) else model), ranges


def _parameter(name: str, value: Free, channel: str, unit: str) -> Parameter:
    quantity = name.partition("_")[0]
    return Parameter(
        name, UNITS.get(quantity, unit), value.start, f"{QUANTITIES[quantity]}: {channel}",
        lower=0.0 if quantity in ("lowpass", "radius") else -math.inf,
    )  # fmt: skip


def _text(low: float, high: float) -> str:
    return f"{low:g}" if low == high else f"{low:g} … {high:g}"


def _range(value: Free) -> str:
    return f"{value.lower:g} … {value.upper:g} from {value.start:g}"
