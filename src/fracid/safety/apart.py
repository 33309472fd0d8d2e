"""A process of its own for a library that reads a stranger's file: what goes wrong in there is a sentence here.

Libraries for rare formats trust what a file says of itself: a length field makes them ask for terabytes, a damaged
offset go round in circles, a compiled part end its process.  In a process of its own each has

=========  ==========================================================================
memory     1 GiB and 16 bytes for each of the file's (where Linux or another counts it)
time       a minute of processor time and a second for each megabyte
files      to read; none is written
answer     bytes, on standard output; what it prints elsewhere is not heard
=========  ==========================================================================
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

OUT_OF_MEMORY = 3
"""Exit code."""

SECONDS, BYTES_A_SECOND = 60, 1 << 20

WAIT = 30
"""So many times as long may it take where others use the processor."""

MEMORY, MEMORY_A_BYTE = 1 << 30, 16


def answer_apart(function: str, path: Path, *words: str, packages: Sequence[str] = ()) -> bytes:
    """Call ``module:function`` of fracid's own in a new process, with a path and words; return what it answers.

    The packages are imported before the limits are set, for that takes time and memory, too.

    Raises
    ------
    ValueError
        With a clause on how it ended, where it ended otherwise.

    Examples
    --------
    >>> answer_apart("fracid.safety.door:bytes_of", Path(__file__))[:4]
    b'\"\"\"A'
    """
    size = path.stat().st_size
    limits = SECONDS + size // BYTES_A_SECOND, MEMORY + MEMORY_A_BYTE * size
    command = f"from {__name__} import _serve; _serve()"
    try:
        done = subprocess.run(  # -P: no module is looked for in the folder that one stands in
            [sys.executable, "-P", "-c", command, *map(str, limits), ",".join(packages), function, str(path), *words],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, timeout=WAIT * limits[0],
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise ValueError(f"reading it takes more than {WAIT * limits[0]} s") from None
    if done.returncode in (-getattr(signal, "SIGXCPU", 24), -9):
        raise ValueError(f"reading it takes more than {limits[0]} s of processor time")
    if done.returncode in (OUT_OF_MEMORY, -6):  # a library that is not Python's aborts
        raise ValueError("reading it takes more memory than a file of its size does")
    if done.returncode:
        raise ValueError("reading it ended the process that read it")
    return done.stdout


def _serve() -> None:
    """In the new process: import, then hold to the limits, then read."""
    heard = os.dup(1)
    os.dup2(2, 1)  # what a package prints is no answer
    seconds, memory, packages, function, path, *words = sys.argv[1:]
    for package in filter(None, packages.split(",")):
        import_module(package)
    module, name = function.split(":")
    call = getattr(import_module(module), name)
    try:
        limit(int(seconds), int(memory))
        answer = call(Path(path), *words)
        with open(heard, "wb") as out:
            out.write(answer)
    except MemoryError:
        sys.exit(OUT_OF_MEMORY)


def limit(seconds: int, memory: int) -> None:
    """Hold this process to so much more processor time [s] and memory [bytes], and keep it from writing files."""
    try:
        import resource
    except ImportError:  # Windows has none
        return
    until = int(time.process_time()) + seconds
    resource.setrlimit(resource.RLIMIT_CPU, (until, until + 1))
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if (pages := Path("/proc/self/statm")).exists():
        taken = int(pages.read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (taken + memory, taken + memory))
