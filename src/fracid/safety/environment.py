"""What Python and its packages take from the folder that one stands in, and how the program keeps them from it.

Who unpacks a stranger's recordings goes there and types ``fracid fit rig.toml``.  Nothing in that folder was named, and
nothing of it must do anything; but

==========================  ================================================================================
file in that folder         who takes it, unasked
==========================  ================================================================================
``multiprocessing.py``, …   Python, in every process that is started to help: it looks for modules there first
``matplotlibrc``            Matplotlib, when it is imported: it may have all text set by LaTeX, with a preamble
``.numba_config.yaml``      Numba, with each compilation: it may name the folder of compiled code that is run
==========================  ================================================================================

The program holds this off: :func:`safe_children`, :func:`ignore_settings`.  From Python, where the interpreter is the
caller's, so are its surroundings; what lies beside a script or a notebook is imported by it.  ``python -m`` looks into
the folder that one stands in before a line of fracid has run: in a stranger's folder type ``fracid``.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, MutableMapping
from contextlib import AbstractContextManager, chdir, contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

SAFE = "PYTHONSAFEPATH"
"""Set, it has Python look for modules where they are installed, and not where one stands."""

NOWHERE = str(Path(__file__).parent / "no-such-file")


def safe_children() -> AbstractContextManager[None]:
    """Have processes that are started meanwhile import nothing from the folder that one stands in.

    Examples
    --------
    >>> with safe_children():
    ...     os.environ["PYTHONSAFEPATH"]
    '1'
    """
    return instead(os.environ, SAFE, "1")


@contextmanager
def instead(entries: MutableMapping[str, Any], name: str, value: Any) -> Iterator[None]:
    """Have a value under a name for as long as the block runs; then what was there before, or nothing.

    Examples
    --------
    >>> rooms = {"left": 1}
    >>> with instead(rooms, "left", 2), instead(rooms, "right", 3):
    ...     rooms
    {'left': 2, 'right': 3}
    >>> rooms
    {'left': 1}
    """
    before = {name: entries[name]} if name in entries else {}
    entries[name] = value
    try:
        yield
    finally:
        entries.update(before)
        if not before:
            entries.pop(name, None)


def ignore_settings(folder: Path) -> None:
    """Keep Matplotlib and Numba from what they would read there: import them now, from elsewhere.

    Parameters
    ----------
    folder : Path
        Where one stands, or is about to go.  Without such files there nothing is imported, which would take time.

    Examples
    --------
    >>> ignore_settings(Path("/nowhere"))
    """
    if (folder / "matplotlibrc").exists() and "matplotlib" not in sys.modules:
        _imported_elsewhere("matplotlib")
    if (folder / ".numba_config.yaml").exists():
        # Numba looks for it again and again, by this name
        vars(_imported_elsewhere("numba.core.config"))["_config_fname"] = NOWHERE


def _imported_elsewhere(name: str) -> object:
    with chdir(Path(__file__).parent):
        return import_module(name)
