"""What fracid says when a caller or a file is at fault.

::

    FracidError              has an exit code for the command line
    ├── InputError      (2)  the caller's mistake: an argument, an option, a project file
    │   └── NotTrusted  (2)  a project file refers to code of its own, without --trust
    ├── DataError       (3)  a recording that fails its checks
    └── Unfinished      (1)  long work was interrupted: a full disk, a dead worker, Ctrl-C; what was done is kept

Each message is a sentence or three: what was wrong with the value, what was
expected, what to type.  A numerical failure (a diverging run, det M = 0) is not
an error but an outcome, :class:`fracid.Outcome`, and what cannot give its result
for that gives a :class:`Failure` in its place.
"""

from __future__ import annotations

import difflib
import errno
import shlex
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from enum import Enum
from numbers import Integral, Real
from typing import TypeVar

Entry = TypeVar("Entry")

LARGEST = 1e100
"""No quantity and no instrument has more, in whatever unit; squares of more have no number."""

SMALLEST = 1 / LARGEST
"""No size is less, in whatever unit; one over the square of less has no number."""


class FracidError(Exception):
    """Base of every error that fracid raises on purpose."""

    exit_code = 1


class InputError(FracidError, ValueError):
    """The caller asked for something that cannot be done as asked."""

    exit_code = 2


class NotTrusted(InputError):
    """A project file names code of its own, which runs only when the caller says so: ``trust=True``, ``--trust``."""


class DataError(FracidError, ValueError):
    """A recording is unreadable or unfit for what was asked of it."""

    exit_code = 3


class Unfinished(FracidError, RuntimeError):
    """Long work was interrupted by something outside of it; finished work is kept and can be resumed."""


class FailureReason(Enum):
    """Why there is no result; the value is the kind in words."""

    RUN = "a run ends before its last sample"
    INTERRUPTED = "the search was interrupted"
    NOTHING_FREE = "nothing is free"
    AT_BOUND = "every unknown lies at a bound"
    NO_FIT = "the model does not fit"
    OWN_COST = "a user's own cost is of unknown loss"
    REFUSED = "the problem is refused"


@dataclass(frozen=True)
class Failure:
    """In place of a result: why there is none.

    Examples
    --------
    >>> failure = Failure(FailureReason.RUN, "swing: diverged at t = 1.2 s")
    >>> failure.reason is FailureReason.RUN, f"no interval: {failure}"
    (True, 'no interval: swing: diverged at t = 1.2 s')
    """

    reason: FailureReason
    """The kind."""
    detail: str
    """The sentence, without a full stop."""

    def __str__(self) -> str:
        """Give the sentence."""
        return self.detail


MOST_NAMES, MOST_CLOSE = 16, 3
"""Known names that are all written out, and close ones."""


def unknown_name(what: str, name: object, names: Collection[str]) -> InputError:
    """Return the error for a name that is not one of the known ones, with the closest of them, or all if they are few.

    Examples
    --------
    >>> print(unknown_name("rig", "abc", ("qube-servo2", "srv02-rotpen")))
    unknown rig 'abc'; the known ones are qube-servo2, srv02-rotpen
    >>> print(unknown_name("parameter", "J_teta", ("J_theta", "C1")))
    unknown parameter 'J_teta': did you mean J_theta?  The known ones are J_theta, C1
    """
    close = difflib.get_close_matches(str(name), names, n=MOST_CLOSE, cutoff=0.55)
    if len(names) > MOST_NAMES:
        hint = f": did you mean {' or '.join(close)}?" if close else "."
        return InputError(f"unknown {what} {name!r}{hint}  docs/project-file.md lists all {len(names)}.")
    everything = ", ".join(names) if names else "none"
    if not close:
        return InputError(f"unknown {what} {name!r}; the known ones are {everything}")
    return InputError(f"unknown {what} {name!r}: did you mean {' or '.join(close)}?  The known ones are {everything}")


def refuse_unknown(what: str, names: Collection[str], *given: object) -> None:
    """Refuse what is not one of the known names.

    Raises
    ------
    InputError
        As :func:`unknown_name` says.

    Examples
    --------
    >>> refuse_unknown("rig", ("qube-servo2", "srv02-rotpen"), "qube-servo2")
    """
    for name in given:
        if name not in names:
            raise unknown_name(what, name, names)


def entry_of(what: str, entries: Mapping[str, Entry], name: str) -> Entry:
    """What has a name among the known ones; an InputError names those that there are.

    Examples
    --------
    >>> entry_of("rig", {"qube-servo2": 1, "srv02-rotpen": 2}, "srv02-rotpen")
    2
    """
    refuse_unknown(what, entries, name)
    return entries[name]


def brief(value: object) -> str:
    """How a message quotes what a caller gave: in one line, and not a whole table.

    Examples
    --------
    >>> brief(list(range(1000)))
    '[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16...'
    """
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else f"{text[:57]}..."


def is_number(value: object) -> bool:
    """A real number of Python or NumPy; True and False are none."""
    return isinstance(value, Real) and not isinstance(value, bool)


def at_least(name: str, value: int, least: int, most: int | None = None) -> int:
    """Give a count back if it is one.

    Raises
    ------
    InputError
        If it is below `least`, above `most`, or no whole number.

    Examples
    --------
    >>> at_least("jobs", 4, 1)
    4
    """
    if not isinstance(value, Integral) or isinstance(value, bool) or value < least:
        raise InputError(f"{name} = {value!r}; expected a whole number, {least} or more.")
    if most is not None and value > most:
        raise InputError(f"{name} = {value!r}; expected a whole number, {most:,} at most.")
    return int(value)


def refuse_beyond(name: str, value: float, least: float = 0.0) -> None:
    """Refuse a number that no quantity has, in whatever unit: its square, or one over it, would be none.

    Parameters
    ----------
    least : float
        Above 0 for a size, which is not less than that, nor than the smallest that there is.

    Raises
    ------
    InputError
        Naming the limit.

    Examples
    --------
    >>> refuse_beyond("scale", 1e-320, 1e-12)
    Traceback (most recent call last):
    fracid.errors.InputError: scale = 9.99989e-321 is beyond what can be computed with; expected 1e-12 … 1e+100.
    """
    low = max(least, SMALLEST) if least else -LARGEST
    if not low <= value <= LARGEST:
        raise InputError(f"{name} = {value:g} is beyond what can be computed with; expected {low:g} … {LARGEST:g}.")


@contextmanager
def installed(otherwise: str) -> Iterator[None]:
    """Say what to type where a package is not installed that is imported here.

    Examples
    --------
    >>> with installed("nobody is not installed; type: pip install nobody."):
    ...     import nobody
    Traceback (most recent call last):
    fracid.errors.InputError: nobody is not installed; type: pip install nobody.
    """
    try:
        yield
    except ImportError:
        raise InputError(otherwise) from None


@contextmanager
def writing(what: str, remedy: str = "Give another: --out DIR.") -> Iterator[None]:
    """Say what cannot be written: where the disk is full no other place on it is better.

    Examples
    --------
    >>> with writing("The folder runs/rig"):
    ...     raise OSError(errno.ENOSPC, "No space left on device")
    Traceback (most recent call last):
    fracid.errors.Unfinished: The folder runs/rig cannot be written: the disk is full. Make room, then type the same
    again; what was done is kept.
    >>> with writing("The folder /etc/rig"):
    ...     raise OSError(errno.EACCES, "Permission denied")
    Traceback (most recent call last):
    fracid.errors.InputError: The folder /etc/rig cannot be written: Permission denied. Give another: --out DIR.
    """
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise Unfinished(f"{what} cannot be written: the disk is full. Make room, then type the same again; what "
                             "was done is kept.") from None  # fmt: skip
        raise InputError(f"{what} cannot be written: {error.strerror or error}. {remedy}") from None


def typed(*words: object, trust: bool = False) -> str:
    """A command as one types it, with the trust that it needs.

    Examples
    --------
    >>> print(typed("fit", "my rig.toml"))
    fracid fit 'my rig.toml'
    """
    return shlex.join(["fracid", *map(str, words), *["--trust"] * trust])
