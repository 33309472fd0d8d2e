r"""Does a rotary pendulum's sensor count backwards?  The arm throws its pendulum one way only.

With α and θ counted as the equations have it,

.. math:: C_1 \ddot\alpha + C_3 \cos\alpha\,\ddot\theta + b\,\dot\alpha - \tfrac12 C_6 \sin 2\alpha\,\dot\theta^2
          \pm C_4 \sin\alpha = 0,

:math:`C_1` and :math:`C_3` have one sign, whether α = 0 hangs or stands.  Both are found by least squares from slopes
of the samples, over the stretch for which both matter most; where they differ in sign, one angle has the wrong one.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fracid.arrays import FloatArray
from fracid.findings import Finding, Words
from fracid.signals.swing import slopes

SAYS = Words("recording/faults.toml")

STRETCHES = (5, 9, 17, 33, 65, 129)
"""Samples of a cubic whose slopes are taken."""

LEFT, MATTERS = 0.1, 0.5
"""Of sin α the part that may be left over, and the part of that without either acceleration that is left with both."""

MOST = 2**16
"""Samples that are looked at: those about the fastest motion of the arm."""
FARTHEST = 1e12
"""Angle [rad] that no encoder counts."""


def counted_backwards(step: float, theta: FloatArray, alpha: FloatArray) -> Iterator[Finding]:
    """Whether α or θ has the wrong sign, from their samples [rad], α about where it hangs or stands.

    Examples
    --------
    >>> import fracid
    >>> rig = fracid.rotary_pendulum("qube-servo2")
    >>> push = 2 * np.sign(np.sin(np.arange(801) / 60))[:, None]
    >>> orders, initial = {"lambda": 1, "mu": 1}, {"alpha": 0.3}
    >>> run = fracid.simulate(rig, orders=orders, initial=initial, step=5e-3, end=4.0, inputs=push)
    >>> theta, alpha = run.states[:, 0], run.states[:, 2]
    >>> [f.code for sign in (1, -1) for f in counted_backwards(5e-3, theta, sign * alpha)]
    ['counted-backwards']
    """
    if not (np.abs([theta, alpha]).max() < FARTHEST and np.ptp(theta) > 0):
        return
    at = int(np.argmax(np.abs(np.diff(theta))))
    part = slice(max(0, at - MOST // 2), at + MOST // 2)
    found = [_signs(step, theta[part], alpha[part], n) for n in STRETCHES if 4 * n < len(theta[part])]
    share, left, same = min(found, default=(1.0, 1.0, True))
    if 0 < share < MATTERS and left < LEFT and not same:  # nothing is left of an α that stays at 0
        yield SAYS.finding("counted-backwards", "alpha", 100 * left / share, 100 * left / MATTERS, turned=100 * left)


def _signs(step: float, theta: FloatArray, alpha: FloatArray, samples: int) -> tuple[float, float, bool]:
    """What is left of that without either acceleration, of sin α, and whether C1 and C3 have one sign."""
    inner = slice(samples // 2 + 1, -(samples // 2) - 1)
    both = ([x[inner] for x in slopes(y, samples, step)] for y in (alpha, theta))
    (a, speed, acceleration), (_, arm_speed, arm) = both
    columns = np.column_stack([acceleration, np.cos(a) * arm, speed, np.sin(2 * a) * arm_speed**2])
    columns /= np.maximum(np.linalg.norm(columns, axis=0), 1e-300)

    def fitted(*kept: int) -> tuple[FloatArray, float]:
        values = np.asarray(np.linalg.lstsq(columns[:, kept], np.sin(a))[0], np.float64)
        return values, float(np.mean((np.sin(a) - columns[:, kept] @ values) ** 2))

    (own, left), without = fitted(0, 1, 2, 3), min(fitted(1, 2, 3)[1], fitted(0, 2, 3)[1])
    return left / max(without, 1e-300), left / max(float(np.mean(np.sin(a) ** 2)), 1e-300), bool(own[0] * own[1] > 0)
