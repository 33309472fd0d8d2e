r"""What friction is to those who compare structures: which rung of the ladder frees it, and what damping it stands for.

A model says of each parameter that is friction what it is, with ``friction=COULOMB.at("theta")`` in its
:class:`~fracid.models.Parameter`; where it says nothing, the beginning of the name does (:data:`BY_NAME`).  A new
element is its row in the parameters of its model, and its torque in the right-hand side; of a new kind also a
:class:`Friction`.  The ladder, the integer-order rival, the regression and the linear models ask for nothing else.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Friction:
    """An element of friction, whose strength is one parameter.

    Examples
    --------
    >>> stiction = Friction("stiction", power=0, begins=2e-3)
    >>> stiction.at("alpha").joint, stiction.dry
    ('alpha', True)
    """

    rung: str
    """The rung of the ladder that frees it, with all others of that rung."""
    power: float | None = None
    """Its torque goes with |v| to this: 0 for dry friction, 1 for viscous, 2 for drag; None where it is not of the
    speed alone, as a spring's."""
    off: float = 0.0
    """The value at which it is not there [the parameter's unit]."""
    begins: float = 0.0
    """A search begins at this part of the reach at least: at 0 a dry friction's cost has a corner."""
    rests: tuple[str, ...] = ()
    """Parameters that mean nothing without it, and that each recording has for itself."""
    joint: str = ""
    """The output that measures its joint; "" where nobody says."""
    most: float = math.inf
    """A search looks for it up to here [the parameter's unit]; up to the reach of the torques where it is infinite."""
    entries: tuple[float, ...] = ()
    """Where a search that climbs to it puts it first, one after the other [the parameter's unit, or of `part_of`]; a
    little off nothing where there are none."""
    climbed: bool = False
    """Whether its cost has minima enough that a search brings it in after all others: presliding, not drag."""
    signed: bool = False
    """Whether it may be of either sign, as a spring's rest may and a friction may not."""
    jumps: bool = False
    """Whether a little of it is far from none: to give by 1e-10 rad is a stiff spring in the place of sliding.  Small
    steps from `off` tell nothing then; a search enters elsewhere."""
    part_of: str = ""
    """The parameter in whose value `entries` and `most` are measured; "" for the parameter's own unit."""

    @property
    def dry(self) -> bool:
        """Whether it has no linear part at rest."""
        return self.power == 0

    @property
    def damps_like_an_order(self) -> bool:
        """Whether an order below 1 may stand in for it: viscous and dry friction."""
        return self.power is not None and self.power <= 1

    def at(self, joint: str) -> Friction:
        """The same at a joint, which the output of that name measures."""
        return replace(self, joint=joint)


VISCOUS = Friction("viscous", power=1)

COULOMB = Friction("Coulomb", power=0, begins=2e-3)

LOAD = Friction("load", most=1.0, begins=0.1)

PRESLIDING = Friction("presliding", most=0.5, entries=(5e-3, 5e-2), climbed=True, jumps=True)

LUGRE = Friction("LuGre", climbed=True)

DRAG = Friction("drag", power=2)

SPRING = Friction("cable", rests=("theta_rest",))

TILT = Friction("tilt", most=0.1, signed=True)

PLAY = Friction("play", most=0.2, entries=(2e-3, 1e-2), climbed=True, jumps=True)

SPRINGPOT = Friction("springpot", climbed=True)

ELASTIC = Friction("elastic arm", climbed=True)

STRIBECK_SPEED = replace(LUGRE, off=0.1, most=10.0, entries=(0.05, 0.5))

SPRINGPOT_ORDER = replace(SPRINGPOT, off=0.5, most=0.99, entries=(0.3, 0.7))

BY_NAME = {
    "b_": VISCOUS, "coulomb_": COULOMB, "load_directional_": replace(LOAD, begins=0.0, signed=True),
    "load_": LOAD, "presliding_damping_": LUGRE, "presliding_": PRESLIDING, "stiction_": LUGRE,
    "stribeck_speed_": STRIBECK_SPEED, "drag_": DRAG, "cable_": SPRING, "spring_": SPRING, "play_": PLAY,
    "elastic_damping_": ELASTIC, "elastic_": replace(ELASTIC, most=1e4, entries=(20.0, 200.0), jumps=True),
    "springpot_order_": SPRINGPOT_ORDER, "springpot_": SPRINGPOT,
}  # fmt: skip
"""How a parameter's name begins → what it is, where the model does not say."""

RUNGS = (
    "viscous",
    "Coulomb",
    "load",
    "Stribeck",
    "drag",
    "cable",
    "tilt",
    "presliding",
    "LuGre",
    "play",
    "springpot",
    "elastic arm",
)
"""Every model's first rungs, from the ground up; a model's own follow.  What is climbed to comes last: where the spring
of a cable is missing, presliding is found in its place."""
