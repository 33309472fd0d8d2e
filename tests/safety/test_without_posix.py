"""Nothing needs a call that Windows lacks: a run without them, and no use of one that is not guarded."""

import ast
import json
import os
import subprocess
import sys

import pytest

from program import RELEASE
from sources import nodes
from twins import write_release

LACKS = {
    "os": {
        "fork", "register_at_fork", "pread", "pwrite", "preadv", "pwritev", "sched_getaffinity", "getuid", "geteuid",
        "nice", "O_NONBLOCK", "O_NOFOLLOW", "O_CLOEXEC", "uname", "sysconf", "killpg", "getpgid", "setsid", "mkfifo",
        "statvfs", "wait", "fchmod", "chown", "getloadavg", "readv", "writev",
    },
    "signal": {"SIGHUP", "SIGKILL", "SIGXCPU", "SIGALRM", "SIGUSR1", "alarm", "setitimer", "pthread_sigmask"},
}  # fmt: skip
"""Module → names that it does not have on Windows."""

MODULES = ("fcntl", "resource", "termios", "tty", "pwd", "grp", "pty")
"""Modules that Windows does not have."""

GUARDED = {
    "tasks/folder_lock.py": {"os.register_at_fork", "fcntl"},  # hasattr, and msvcrt
    "cli/app.py": {"os.sched_getaffinity"},  # hasattr
    "safety/apart.py": {"resource"},  # ImportError
    "workflows/drawer.py": {"os.nice"},  # AttributeError
}
"""File → what it uses where it is there, or with a substitute."""

PROGRAM = f"""
import asyncio, concurrent.futures.process, ctypes.util, multiprocessing.popen_spawn_posix, multiprocessing.queues
import multiprocessing.resource_tracker, multiprocessing.spawn, multiprocessing.synchronize, os, signal, sys, types
import h5py, matplotlib.backends.backend_agg, matplotlib.backends.backend_svg, numba, pydantic, rich.progress
import scipy.stats, threadpoolctl, typer

class Without(types.ModuleType):
    def __init__(self, real, lacks, **own):
        self.__dict__.update(own, _real=real, _lacks=lacks)
    def __getattr__(self, name):
        if name in self._lacks:
            raise AttributeError(name)
        return getattr(self._real, name)
    def __setattr__(self, name, value):
        setattr(self._real, name, value)

for name, lacks in {LACKS!r}.items():
    sys.modules[name] = Without(sys.modules[name], lacks)
sys.modules.update(dict.fromkeys({MODULES!r}))
sys.modules["msvcrt"] = types.SimpleNamespace(LK_NBLCK=2, locking=lambda *_: None)
sys.modules["sys"] = Without(sys, set(), platform="win32")
from fracid.cli import main
if __name__ == "__main__":
    main(sys.argv[1:])
"""
"""fracid where os, signal and sys are those of Windows; what Python's own modules took of them stays."""


def used(file, tree):
    for node in tree:
        if isinstance(node, ast.Attribute) and node.attr in LACKS.get(ast.unparse(node.value), ()):
            yield f"{ast.unparse(node.value)}.{node.attr}"
        elif isinstance(node, ast.Import):
            yield from {alias.name for alias in node.names} & {*MODULES}
        elif isinstance(node, ast.ImportFrom) and node.module in LACKS:
            yield from (f"{node.module}.{a.name}" for a in node.names if a.name in LACKS[node.module])


def test_what_windows_lacks_is_used_only_where_something_stands_in_for_it():
    found = {file: names for file, tree in nodes().items() if (names := set(used(file, tree)))}
    assert found == GUARDED


@pytest.mark.broad
@pytest.mark.skipif(sys.platform == "win32", reason="there all of it is so")
def test_a_fit_runs_without_what_windows_lacks(tmp_path):
    write_release(tmp_path / "swing.csv", alpha=0.35, step=5e-3, end=2.0)
    (tmp_path / "rig.toml").write_text(RELEASE, encoding="utf-8")
    (tmp_path / "program.py").write_text(PROGRAM, encoding="utf-8")
    command = [sys.executable, "program.py", "fit", "rig.toml", "--out", "run", "--jobs", "2"]
    ended = subprocess.run(command, cwd=tmp_path, env=os.environ, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (0, "")
    assert (tmp_path / "run" / "report.html").exists()
    assert json.loads((tmp_path / "run" / "result.json").read_text(encoding="utf-8"))["orders"]
