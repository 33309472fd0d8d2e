"""Which model of the library a table is of: what its columns are called says what was measured.

Each model's file has a pattern for each of its inputs and outputs (``[columns]``).  A table is of the model that has a
place for most of its columns; rates and accelerations have none, since a model knows them by their coordinates.  The
rotary pendulum comes first of those that have as many; where no column has a telling name, its columns are found by how
they move.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from fracid.errors import InputError
from fracid.findings import Words
from fracid.models.library import MODEL, table_of
from fracid.recording import Table
from fracid.recording.channel import without_unit

SAYS = Words("problem/roles.toml")

ROTARY = "rotary-pendulum"

RATE = r"dot|veloc|speed|rate|^d_|deriv|accel|^q?dq?d|^qd|stamp|offset|temp|^v_?\d*$"
"""What a model knows by another column."""

NAMELESS = r"(col(umn)?|ch(annel)?|sig(nal)?|data|var|val(ue)?|sensor|adc|enc(oder)?|unnamed.*|[a-z])?[ _:.-]*\d*"
"""Names that say nothing."""


def roles_of(model: str, columns: Sequence[str]) -> dict[str, str]:
    """Inputs and outputs of a model → the columns that are called like them.

    Examples
    --------
    >>> roles_of("joint", ["q", "qd", "tau"]), roles_of("joint", ["q/rad", "u [V]"])
    ({'angle': 'q', 'torque': 'tau'}, {'angle': 'q/rad', 'voltage': 'u [V]'})
    >>> roles_of("cart-pole", ["cart_pos", "cart_vel", "pole_angle", "force"])
    {'position': 'cart_pos', 'angle': 'pole_angle', 'force': 'force'}
    """
    patterns: dict[str, str] = table_of(model)["columns"]
    called, roles = {c: without_unit(c).lower() for c in columns}, dict[str, str]()
    for signal, pattern in patterns.items():
        free = [c for c in columns if c not in roles.values()]
        exact = [c for c in free if called[c] == signal]
        found = exact or [c for c in free if re.search(pattern, called[c]) and not re.search(RATE, called[c])]
        own = {s: p for s, p in patterns.items() if s != signal}  # "pole_pos" is the cart's only where no other is
        found.sort(key=lambda c: sum(bool(re.search(p, called[c])) for p in own.values()))
        if found:
            roles[signal] = found[0]
    return roles


def named_columns(table: Table, columns: Iterable[str], given: Mapping[str, Mapping[str, Any]]) -> dict[str, str]:
    """Return the columns of a table that were named, each with the signal that it was named for.

    Examples
    --------
    >>> import numpy as np
    >>> table = Table(np.zeros((2, 3)), ("t", "stress [MPa]", "strain"), ("", "MPa", ""), "log.csv")
    >>> named_columns(table, ["stress [MPa]", "strain"], {"force": {"column": "stress"}})
    {'stress [MPa]': 'force'}
    """
    places = {table.find(c["column"]): n for n, c in given.items() if "column" in c}
    return {c: places[j] for c in columns if places and (j := table.find(c)) in places}


def likely_models(columns: Sequence[str]) -> dict[str, dict[str, str]]:
    """Models that a table may be of → what each of its columns is; those that have most places for them.

    A rotary pendulum is the only one where it is one of them, and where the names of the columns say nothing.

    Examples
    --------
    >>> likely_models(["current", "voltage"])
    {'capacitor': {'voltage': 'voltage', 'current': 'current'}}
    >>> list(likely_models(["force", "position"])), list(likely_models(["theta", "alpha"])), likely_models(["rain"])
    (['oscillator'], ['rotary-pendulum'], {})
    """
    found = {name: roles_of(name, columns) for name in (ROTARY, *MODEL)}
    found = {n: roles for n, roles in found.items() if _whole(n, roles, len(columns))}
    if not found and nameless(columns):
        return {ROTARY: {}}
    most = max(map(len, found.values()), default=0)
    likely = {n: roles for n, roles in found.items() if len(roles) == most}
    return {ROTARY: likely[ROTARY]} if ROTARY in likely else likely


def _whole(name: str, roles: dict[str, str], columns: int) -> bool:
    """Whether the columns that the model needs are there, or one left to be found by its motion, and a measured one."""
    spec = table_of(name)
    moves = spec.get("moves", ()) if columns > len(roles) else ()
    return {*spec["needs"]} - {*moves} <= roles.keys() and bool(roles.keys() & spec["model"]["outputs"].keys())


def nameless(columns: Sequence[str]) -> bool:
    """Tell whether the names of a table's columns say nothing.

    Examples
    --------
    >>> nameless(["column 1", "ch2", "x"]), nameless(["column 1", "rain"])
    (True, False)
    """
    return all(re.fullmatch(NAMELESS, c.lower()) for c in columns)


def model_of_columns(files: str, columns: Sequence[str]) -> str:
    """The model of tables, whose names stand as they are typed, or an error that says what to type.

    Raises
    ------
    InputError
        If no model fits, or several do as well.

    Examples
    --------
    >>> model_of_columns("log.csv", ["q", "qd", "tau"]), model_of_columns("log.csv", ["column 1", "column 2"])
    ('joint', 'rotary-pendulum')
    >>> model_of_columns("log.csv", ["rain", "wind"])
    Traceback (most recent call last):
    fracid.errors.InputError: No model of the library has the columns rain, wind of log.csv. ...
    """
    likely = likely_models(columns)
    shown = ", ".join(columns[:8])
    if not likely:
        raise InputError(SAYS("none", shown=shown, files=files))
    if len(likely) > 1:
        commands = "; ".join(f"fracid init {files} --model {n}" for n in likely)
        raise InputError(f"The columns {shown} of {files} may be of {' or '.join(likely)}; say which: {commands}.")
    return next(iter(likely))
