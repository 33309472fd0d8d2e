"""Checks of names: of recordings, which must differ, and of choices, which must be known."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from fracid.errors import InputError, unknown_name
from fracid.problem.experiment import Experiment

__all__ = ["check_choice", "refuse_twins"]


def refuse_twins(experiments: Sequence[Experiment]) -> None:
    """Refuse two recordings of one name: results go by it.

    Raises
    ------
    InputError
        Naming the first that comes twice.

    Examples
    --------
    >>> refuse_twins([])
    """
    names = [e.name for e in experiments]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"Two recordings are named {name!r}; give each its own name.")


def check_choice(what: str, name: str, known: Collection[str]) -> None:
    """Refuse a name that is none of the known ones."""
    if name not in known:
        raise unknown_name(what, name, known)
