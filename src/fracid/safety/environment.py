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
from collections.abc import Iterator
from contextlib import chdir, contextmanager
from importlib import import_module
from pathlib import Path

SAFE = "PYTHONSAFEPATH"
"""Set, it has Python look for modules where they are installed, and not where one stands."""

NOWHERE = str(Path(__file__).parent / "no-such-file")


@contextmanager
def safe_children() -> Iterator[None]:
    """Have processes that are started meanwhile import nothing from the folder that one stands in.

    Examples
    --------
    >>> with safe_children():
    ...     os.environ["PYTHONSAFEPATH"]
    '1'
    """
    before = os.environ.get(SAFE)
    os.environ[SAFE] = "1"
    try:
        yield
    finally:
        os.environ.pop(SAFE, None)
        if before is not None:
            os.environ[SAFE] = before


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
