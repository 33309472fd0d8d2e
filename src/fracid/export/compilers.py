"""C made into shared libraries, with the compiler of this system or the one that ``ziglang`` brings."""

from __future__ import annotations

import platform
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from fracid.errors import InputError
from fracid.safety.door import bytes_of, own_text, write_whole


class Platform(NamedTuple):
    """Where a library runs."""

    folder: str
    """Of FMI 2.0; that of 3.0 is the platform's name."""
    suffix: str
    target: str
    """As zig calls it."""


PLATFORMS = {n: Platform(**row) for n, row in tomllib.loads(own_text("export/compilers.toml")).items()}

COMPILERS = ("cc", "gcc", "clang")

FLAGS = ("-std=c11", "-O2", "-ffp-contract=off", "-fPIC", "-shared", "-fvisibility=hidden", "-s")


def here() -> str:
    """This platform.

    Examples
    --------
    >>> here().count("-")
    1
    """
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(platform.machine().lower(), platform.machine().lower())
    return f"{machine}-{platform.system().lower()}"


def library_of(texts: Mapping[str, str], main: str, name: str) -> bytes | str:
    """A shared library for a platform, or why there is none.

    Parameters
    ----------
    texts : mapping
        File → content.
    main : str
        The file that is compiled.
    name : str
        Of :data:`PLATFORMS`, or this one.

    Raises
    ------
    InputError
        For sources that do not compile.

    Examples
    --------
    >>> library_of({}, "model.c", "pdp11-unix").partition(":")[0]
    'There is no C compiler here for pdp11-unix'
    """
    plain = next((path for c in COMPILERS if (path := shutil.which(c))), None)
    if find_spec("ziglang") and name in PLATFORMS:
        command = [sys.executable, "-m", "ziglang", "cc", "-target", PLATFORMS[name].target]
    elif plain and name == here():
        command = [plain]
    else:
        return (f"There is no C compiler here for {name}: only the sources are written. "
                "pip install 'fracid[fmu]' brings one for every platform.")  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        for file, text in texts.items():
            write_whole(Path(folder, file), text)
        command += [*FLAGS, main, "-o", "library", "-lm"]
        done = subprocess.run(command, cwd=folder, stdin=subprocess.DEVNULL, capture_output=True, text=True)
        if done.returncode:
            raise InputError(f"The sources do not compile for {name}: {done.stderr.strip()[:500]}")
        return bytes_of(Path(folder, "library"))
