"""What fracid says when a caller or a file is at fault.

::

    FracidError              has an exit code for the command line
    ├── InputError      (2)  the caller's mistake: an argument, an option, a project file
    └── DataError       (3)  a recording that fails its checks

Each message is a sentence or three: what was wrong with the value, what was
expected, what to type.  A numerical failure (a diverging run, det M = 0) is not
an error but an outcome: see :class:`fracid.simulate.Outcome`.
"""

__all__ = ["DataError", "FracidError", "InputError"]


class FracidError(Exception):
    """Base of every error that fracid raises on purpose."""

    exit_code = 1


class InputError(FracidError, ValueError):
    """The caller asked for something that cannot be done as asked."""

    exit_code = 2


class DataError(FracidError, ValueError):
    """A recording is unreadable or unfit for what was asked of it."""

    exit_code = 3
