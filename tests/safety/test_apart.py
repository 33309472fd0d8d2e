"""A process of its own keeps what goes wrong in it: memory, time, a crash, words and files."""

import ctypes
import faulthandler
import os
import sys
from pathlib import Path

import numpy as np
import pytest

from fracid.safety import apart
from fracid.safety.apart import answer_apart

HERE = str(Path(__file__).parent)


@pytest.fixture(autouse=True)
def found(monkeypatch):
    """Tests are no package: the new process finds them by the path."""
    path = os.pathsep.join([HERE, *filter(None, [os.environ.get("PYTHONPATH")])])
    monkeypatch.setenv("PYTHONPATH", path)


def whole(path, *words):
    print("a word that is no answer")  # noqa: T201
    return b"%d %s" % (path.stat().st_size, " ".join(words).encode())


def fill_memory(path):
    return np.ones(2**29).tobytes()


def run_forever(path):
    while True:
        pass


def crash(path):
    faulthandler.disable()
    ctypes.string_at(0)


def write(path):
    path.with_name("written").write_bytes(bytes(2**16))


def test_the_answer_is_what_is_returned_and_nothing_that_is_printed(tmp_path):
    (tmp_path / "log").write_bytes(b"123")
    assert answer_apart("test_apart:whole", tmp_path / "log", "a", "b c") == b"3 a b c"


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("deed", "told"),
    [
        (fill_memory, "reading it takes more memory than a file of its size does"),
        (run_forever, "reading it takes more than 1 s of processor time"),
        (crash, "reading it ended the process that read it"), (write, "reading it ended the process that read it"),
    ],
)  # fmt: skip
@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere memory is not counted")
def test_what_goes_wrong_in_it_is_a_clause_here(tmp_path, monkeypatch, deed, told):
    monkeypatch.setattr(apart, "SECONDS", 1)
    (tmp_path / "log").write_bytes(b"123")
    with pytest.raises(ValueError, match=told):
        answer_apart(f"test_apart:{deed.__name__}", tmp_path / "log")
    assert not (tmp_path / "written").exists() or (tmp_path / "written").stat().st_size == 0
