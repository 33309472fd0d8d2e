"""How far to believe a regression, from how large the motion was: what came out where the truth was known.

The numbers are those of the table in :mod:`fracid.regression`, simulated releases of an SRV02 with dry friction and
encoders of 4096 counts; ``python benchmarks/evidence.py regression`` prints them again.
"""

from __future__ import annotations

import math

ENCODER = 2 * math.pi / 4096 / math.sqrt(12)
"""Noise of that encoder's rounding, rms [rad]."""

LOUD = 2.0
"""So many times its noise is more than the table knows of."""

LACKS = 10.0
"""Twins leave a residual of 1.5 to 6 times the variance that noise explains (an encoder's rounding is not white)."""

MIDDLE, LARGE = math.radians(20), math.radians(45)
"""Between the table's 10°, 30° and 60°."""

SAID = {
    0.0: "the inertias were up to 14 % off, b_alpha and C6 arbitrary, the orders not identifiable: release "
         "from 60° or more, or trust a fit of the whole trajectory only",
    MIDDLE: "at given orders the inertias and the arm's friction were within 3 % where the orders were 1 and "
            "within 12 % where they were 0.86, C6 within 10 %; b_alpha was 20 to 130 % off, coulomb_alpha 50 %; orders "
            "that were searched were within 0.02, the inertias then within 12 %",
    LARGE: "at given orders the inertias were within 1 %, C6 and the arm's friction within 4 %, b_alpha within "
           "13 %, coulomb_alpha was up to 40 % off; orders that were searched were within 0.005, the inertias then "
           "within 3 %",
}  # fmt: skip
"""From which amplitude on [rad]: what the table says."""


def belief(amplitude: float, noise: float, noise_ratio: float) -> str:
    """Say what to expect of a regression on motions of this amplitude.

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
    expectation = next(SAID[least] for least in sorted(SAID, reverse=True) if amplitude >= least)
    loud = noise / ENCODER
    worse = f" Here the noise of alpha is {loud:.2g} times theirs: expect more." if loud > LOUD else ""
    lacks = "" if noise_ratio <= LACKS else (
        f" Here the residual is {noise_ratio:.2g} times what noise explains: the model lacks something (friction that "
        "sticks, say), every value is less accurate than that, and no interval shows it."
    )  # fmt: skip
    return (
        f"α swings by {math.degrees(amplitude):.3g}°. In simulated releases of this size {expectation}.{worse}{lacks}"
    )
