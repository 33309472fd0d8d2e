"""What fracid says when a caller or a file is at fault.

::

    FracidError              has an exit code for the command line
    ├── InputError      (2)  the caller's mistake: an argument, an option, a project file
    │   └── NotTrusted  (2)  a project file wants to run code of its own, and nobody allowed it
    ├── DataError       (3)  a recording that fails its checks
    └── Unfinished      (1)  long work was cut short: a full disk, a dead worker, Ctrl-C; what was done is kept

Each message is a sentence or three: what was wrong with the value, what was
expected, what to type.  A numerical failure (a diverging run, det M = 0) is not
an error but an outcome: see :class:`fracid.simulate.Outcome`.
"""

__all__ = ["DataError", "FracidError", "InputError", "NotTrusted", "Unfinished"]


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
    """Long work was cut short by something outside of it; what was done is kept, and can be gone on with."""

    exit_code = 1
