"""Compiled code is kept on disk, and whatever happens to it there costs time alone."""

import errno
import gc
import os
import re
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import numba
import pytest
from numba import float64
from numba.core.caching import CompileResultCacheImpl, UserProvidedCacheLocator

import fracid
from fracid.safety.user_code import run_file
from fracid.solver import compilation as compiling
from fracid.solver.compilation import SOURCES, kept

PACKAGE = Path(fracid.__file__).parent

SOURCE = "def double(x):\n    return 2.0 * x\n\n\ndef half(x):\n    return 0.5 * x\n"


@pytest.fixture
def module(tmp_path, monkeypatch):
    """Two functions with a file, compiled into a folder of the test's own and nowhere else."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(CompileResultCacheImpl, "_locator_classes", [UserProvidedCacheLocator])
    (tmp_path / "twice.py").write_text(SOURCE)
    return run_file(tmp_path / "twice.py", "twice_of_the_test")


def compiled(function):
    """The value at 21 and whether it was taken from disk; as in a new process."""
    dispatcher = kept(float64(float64), error_model="numpy")(function)
    return dispatcher(21.0), bool(dispatcher.stats.cache_hits)


def files(tmp_path):
    return sorted(path for path in (tmp_path / "cache").rglob("*") if path.is_file())


def test_what_is_compiled_is_taken_from_disk_the_next_time(module, tmp_path):
    assert compiled(module.double) == (42.0, False)
    assert compiled(module.double) == (42.0, True)
    assert compiled(module.half) == (10.5, False)
    assert len(files(tmp_path)) == 2


def flipped(place):
    def flip(content):
        changed = bytearray(content)
        changed[int(place * (len(changed) - 1))] ^= 1
        return bytes(changed)

    return flip


@pytest.mark.few(1)
@pytest.mark.parametrize(
    "broken",
    [lambda c: b"", lambda c: b"garbage" * 99, lambda c: c[:31], lambda c: c[:40], lambda c: c[:-1], lambda c: c + b"x",
     lambda c: c[32:], *map(flipped, (0.0, 0.2, 0.5, 0.9, 1.0))],
    ids=["empty", "garbage", "short", "head alone", "torn", "longer", "headless", "bit 0", "bit 20 %", "bit 50 %",
         "bit 90 %", "last bit"],
)  # fmt: skip
def test_a_broken_file_is_compiled_anew_and_mended(module, tmp_path, broken):
    compiled(module.double)
    (file,) = files(tmp_path)
    whole = file.read_bytes()
    file.write_bytes(broken(whole))
    assert compiled(module.double) == (42.0, False)
    assert compiled(module.double) == (42.0, True)
    assert files(tmp_path) == [file]


def test_a_file_of_another_function_is_not_believed(module, tmp_path):
    """Of one that is the same but for a constant: to Numba their code looks alike."""
    compiled(module.double)
    (double,) = files(tmp_path)
    compiled(module.half)
    (half,) = set(files(tmp_path)) - {double}
    half.write_bytes(double.read_bytes())
    assert compiled(module.half) == (10.5, False)


def unreadable(path):
    raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))


IN_ITS_PLACE = {
    "an empty folder": (Path.mkdir, False),
    "a folder with something in it": (lambda path: (path / "x").mkdir(parents=True), False),
    "a link to nothing": (lambda path: path.symlink_to("nothing"), True),
    "a link to itself": (lambda path: path.symlink_to(path.name), True),
    "a link to a folder": (lambda path: path.symlink_to(path.parent), True),
    "a pipe": (os.mkfifo, True),
    "a gigabyte": (lambda path: (path.touch(), os.truncate(path, 2**30)), True),
}
"""What may stand where a file was, and whether it gives way to the file once that is made again."""


@pytest.mark.few(3)
@pytest.mark.parametrize(("made", "gives_way"), IN_ITS_PLACE.values(), ids=IN_ITS_PLACE)
def test_whatever_stands_in_a_files_place_is_not_waited_for_and_costs_time_alone(module, tmp_path, made, gives_way):
    compiled(module.double)
    (file,) = files(tmp_path)
    file.unlink()
    made(file)
    assert compiled(module.double) == (42.0, False)
    assert compiled(module.double) == (42.0, gives_way)
    assert files(tmp_path) == ([file] if gives_way else [])


def test_a_file_that_may_not_be_read_is_compiled_anew(module, monkeypatch):
    compiled(module.double)
    with monkeypatch.context() as patch:
        patch.setattr(compiling, "bytes_of", unreadable)
        patch.setattr(compiling, "sources", lambda stays=compiling.sources(): stays)
        assert compiled(module.double) == (42.0, False)
    assert compiled(module.double) == (42.0, True)


def test_what_is_whole_but_cannot_be_used_is_compiled_anew(module, monkeypatch):
    compiled(module.double)
    with monkeypatch.context() as patch:
        patch.setattr(CompileResultCacheImpl, "rebuild", lambda *_: 1 / 0)
        assert compiled(module.double) == (42.0, False)


@pytest.mark.few(2)
@pytest.mark.parametrize("name", ["sources", "numba", "llvmlite"])
def test_other_sources_and_other_versions_compile_anew(module, monkeypatch, name):
    compiled(module.double)
    if name == "sources":
        monkeypatch.setattr(compiling, "sources", lambda: "others")
    else:
        monkeypatch.setattr(sys.modules[name], "__version__", "0.0")
    assert compiled(module.double) == (42.0, False)


def test_another_processor_has_a_file_of_its_own(module, tmp_path, monkeypatch):
    from numba.core.codegen import JITCPUCodegen

    compiled(module.double)
    with monkeypatch.context() as patch:
        patch.setattr(JITCPUCodegen, "magic_tuple", lambda self: ("another",))
        assert compiled(module.double) == (42.0, False)
    assert compiled(module.double) == (42.0, True)
    assert len(files(tmp_path)) == 2


def test_where_nothing_can_be_written_nothing_is_kept(module, tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "file" / "cache"))
    assert [compiled(module.double), compiled(module.double)] == [(42.0, False)] * 2


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EACCES, errno.EROFS, errno.EDQUOT])
def test_where_there_is_no_room_left_nothing_is_kept(module, tmp_path, monkeypatch, number):
    def refuse(self, path):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(compiling._Files, "_open_for_write", refuse)
    assert compiled(module.double) == (42.0, False)
    assert files(tmp_path) == []


def test_what_is_there_is_used_where_nothing_can_be_written_any_more(module, monkeypatch):
    compiled(module.double)
    monkeypatch.setattr(compiling._Files, "_open_for_write", lambda *_: pytest.fail("was written"))
    assert compiled(module.double) == (42.0, True)


def test_all_modules_with_compiled_code_are_looked_at_for_changes():
    looked_at = {path for pattern in SOURCES for path in PACKAGE.glob(pattern)}
    words = re.compile(r"^\s*@(nb\.njit|when_called|kept|helper|intrinsic|register_jitable|inline)\b|nb\.njit\(", re.M)
    with_code = {path for path in PACKAGE.rglob("*.py") if words.search(path.read_text(encoding="utf-8"))}
    assert with_code
    assert with_code <= looked_at
    assert {PACKAGE / "models" / "pendulum.py", PACKAGE / "solver" / "schemes.py"} <= looked_at


# --- the loops themselves, each case half a minute ---------------------------------------------------

RUN = """
import fracid
from hashlib import sha256
rig = fracid.rotary_pendulum("srv02-rotpen")
run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=0.01, end=3.0)
print(sha256(run.states.tobytes()).hexdigest())
"""


def begun(folder):
    environment = os.environ | {"NUMBA_CACHE_DIR": str(folder)}
    return subprocess.Popen([sys.executable, "-c", RUN], env=environment, stdout=subprocess.PIPE, text=True)


def ended(process):
    out, _ = process.communicate(timeout=900)
    assert process.returncode == 0
    return out


@pytest.mark.slow
def test_a_run_is_the_same_to_the_bit_whatever_is_kept(tmp_path):
    """Cold by two processes at once, warm, all files broken, and where nothing can be kept."""
    together = [ended(process) for process in [begun(tmp_path / "cache"), begun(tmp_path / "cache")]]
    warm = ended(begun(tmp_path / "cache"))
    kept_files = files(tmp_path)
    assert len(kept_files) > 3
    for place, file in enumerate(kept_files):
        content = file.read_bytes()
        file.write_bytes(content[: place * 1000] + b"broken" * 1000)
    broken = ended(begun(tmp_path / "cache"))
    assert {*together, warm, broken, ended(begun(tmp_path / "cache"))} == {warm}


@pytest.mark.slow
def test_the_first_run_on_a_machine_takes_seconds_of_processor(tmp_path):
    """Eight on the machine of the published times, twelve on a busy one; all that a run compiles was 22 before."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    code = RUN + "import time\nprint(time.process_time())\n"
    ended = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert float(ended.stdout.split()[-1]) < 15


def refused(x):
    return x.nothing


@pytest.mark.parametrize("function", [lambda x: abs(x), refused], ids=["compiles", "does not"])
@pytest.mark.parametrize("collects", [True, False])
def test_compiling_leaves_the_garbage_collector_as_it_was(function, collects):
    was = gc.isenabled()
    (gc.enable if collects else gc.disable)()
    try:
        with suppress(numba.TypingError):
            kept(float64(float64), keep=False)(function)
        assert gc.isenabled() == collects
    finally:
        (gc.enable if was else gc.disable)()
