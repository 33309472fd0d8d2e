"""fracid identifies fractional-order and integer-order models of nonlinear systems from recordings.

>>> import fracid
>>> rig = fracid.rotary_pendulum("srv02-rotpen", zero="hanging")
>>> run = fracid.simulate(rig, orders={"lambda": 0.86, "mu": 0.91}, initial={"alpha": 0.17}, step=1e-3, end=20.0)
>>> run.outcome.value
'completed'

From a shell: ``fracid check FILE`` looks at a recording, ``fracid fit PROJECT`` identifies.
Names are imported when they are first used, so that ``import fracid`` costs nothing.
"""

import pkgutil
from importlib import import_module
from typing import Any

from fracid._version import __version__ as __version__

_LINES = (pkgutil.get_data(__name__, "__init__.pyi") or b"").decode().splitlines()
_HOME = {words[-1]: words[1] for line in _LINES if (words := line.split())[:1] == ["from"]}
"""Public name → the module that it lives in."""

__all__ = sorted(_HOME)  # noqa: PLE0605


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'fracid' has no attribute {name!r}; it has {', '.join(sorted(_HOME))}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
