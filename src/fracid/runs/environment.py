"""The environment of a run: versions, processor, operating system."""

from __future__ import annotations

import platform
from functools import cache
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path

from fracid._version import __version__
from fracid.safety.door import bytes_of, text_if_any

_PACKAGES = ("numpy", "scipy", "numba")


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that a result depends on.

    Examples
    --------
    >>> sorted(versions())
    ['fracid', 'numba', 'numpy', 'python', 'scipy']
    """
    return {"python": platform.python_version(), "fracid": __version__, **{name: version(name) for name in _PACKAGES}}


@cache
def code() -> str:
    """Hash of fracid's own source: between two versions it changes often, and a result may with it.

    Examples
    --------
    >>> len(code())
    64
    """
    package, digest = Path(__file__).parents[1], sha256()
    for path in sorted([*package.rglob("*.py"), *package.rglob("*.toml")]):  # equations and their constants, too
        digest.update(sha256(path.relative_to(package).as_posix().encode() + bytes_of(path)).digest())
    return digest.hexdigest()


def machine() -> dict[str, str]:
    """System and processor, by which the last bits of a result may differ; its model, where Linux says it.

    Examples
    --------
    >>> sorted(machine())
    ['platform', 'processor']
    """
    lines = (text_if_any(Path("/proc/cpuinfo")) or "").splitlines()
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    processor = models[0] if models else platform.processor() or platform.machine()
    return {"platform": platform.platform(), "processor": processor}
