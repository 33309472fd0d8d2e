r"""What friction is to those who compare structures: which rung of the ladder frees it, and what damping it stands for.

A model says of each parameter that is friction what it is, with ``friction=COULOMB.at("theta")`` in its
:class:`~fracid.models.Parameter`; where it says nothing, the beginning of the name does (:data:`BY_NAME`).  A new
element is its row in the parameters of its model, and its torque in the right-hand side; of a new kind also a
:class:`Friction`.  The ladder, the integer-order rival, the regression and the linear models ask for nothing else.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from fracid.safety.door import own_text


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
    corner: str = ""
    """When linear models are without it: ``always``, or ``sliding``, where no presliding makes a spring of it."""

    @classmethod
    def of(cls, row: Mapping[str, Any]) -> Friction:
        """Of a row of TOML: its ``rung``, and what is otherwise than of that rung in ``friction.toml``.

        Examples
        --------
        >>> Friction.of({"rung": "play", "joint": "alpha"}) == PLAY.at("alpha")
        True
        """
        whole: dict[str, Any] = {**TABLE["rungs"].get(row["rung"], {}), **row}
        tuples: dict[str, Any] = {n: tuple(v) for n, v in whole.items() if isinstance(v, list)}
        return cls(**{**whole, **tuples})

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


TABLE = tomllib.loads(own_text("models/friction.toml"))

RUNGS = tuple(TABLE["rungs"])
"""Every model's first rungs, from the ground up; a model's own follow."""

_KINDS = (Friction.of({"rung": rung}) for rung in RUNGS if rung != "Stribeck")
VISCOUS, COULOMB, LOAD, DRAG, SPRING, TILT, PRESLIDING, LUGRE, PLAY, SPRINGPOT, ELASTIC = _KINDS

BY_NAME = {beginning: Friction.of(row) for beginning, row in TABLE["names"].items()}
"""How a parameter's name begins → what it is, where the model does not say."""
