"""How far to believe a regression, from how large the motion was: what came out where the truth was known.

The numbers are those of the table in :mod:`fracid.regression`, simulated releases of an SRV02 with dry friction and
encoders of 4096 counts; ``python benchmarks/evidence.py regression`` prints them again.
"""

from __future__ import annotations

import math

from fracid.findings import Words

SAYS = Words("regression/linear.toml")

ENCODER = 2 * math.pi / 4096 / math.sqrt(12)
"""Noise of that encoder's rounding, rms [rad]."""

LOUD = 2.0
"""So many times its noise is more than the table knows of."""

LACKS = 10.0
"""Twins leave a residual of 1.5 to 6 times the variance that noise explains (an encoder's rounding is not white)."""

MIDDLE, LARGE = math.radians(20), math.radians(45)
"""Between the table's 10°, 30° and 60°."""

SAID = {0.0: "small", MIDDLE: "middle", LARGE: "large"}
"""From which amplitude on [rad]: which line of the table."""


def belief(amplitude: float, noise: float, noise_ratio: float) -> str:
    """Say how good a regression can be on motions of this amplitude.

    Parameters
    ----------
    amplitude : float
        Half of what the pendulum moves through [rad].
    noise : float
        Of its angle, rms [rad].
    noise_ratio : float
        Variance of the residual against what noise explains.

    Examples
    --------
    >>> print(belief(math.radians(10), ENCODER, 1.0)[:83])
    α swings by 10°. In simulated releases of this size the inertias were up to 14 % of
    """
    size, loud = next(SAID[least] for least in sorted(SAID, reverse=True) if amplitude >= least), noise / ENCODER
    worse = SAYS("worse", times=loud) if loud > LOUD else ""
    lacks = "" if noise_ratio <= LACKS else SAYS("lacks", times=noise_ratio)
    return SAYS("belief", degrees=math.degrees(amplitude), expectation=SAYS(size), more=f"{worse}{lacks}")
