"""The catalogue of bad input: each row is made, read, and told in its sentence and with its exit code."""

import os
import struct
import subprocess
import sys
import zlib

import numpy as np
import pytest

import fracid
from bad_input import LARGE, MAT5, PAGE, PROJECTS, RECORDINGS, T, element, page, parquet, text
from fracid.errors import DataError, FracidError, InputError
from fracid.problem.project import load_project
from fracid.recording import load_recording, read_table
from fracid.recording.readers.table import READERS
from program import run


def names(rows):
    return [f"{row.group}: {row.wrong}" for row in rows]


def holds(told, says):
    """Whether a text holds the parts of a sentence, one after the other."""
    at = 0
    for part in says.split(" … "):
        at = told.find(part, at)
        if at < 0:
            return False
    return True


@pytest.mark.few(3)
@pytest.mark.usefixtures("heeding_modes")
@pytest.mark.parametrize("row", RECORDINGS, ids=names(RECORDINGS))
def test_a_bad_recording_is_told_and_never_a_traceback(row, tmp_path, capsys):
    path = row.write(tmp_path)
    code, out, err = run(capsys, "check", path)
    assert code == row.code, out + err
    assert holds(out + err, row.says), out + err
    assert "Traceback" not in out + err
    if code == 0 or row.wrong in ("two samples", "constant signals alone"):  # these may be drawn, and tell no model
        assert load_recording(path).time.size > 1
        return
    with pytest.raises(FracidError) as told:
        load_recording(path)
    assert told.value.exit_code == code
    assert str(told.value).isprintable()


@pytest.mark.few(2)
@pytest.mark.parametrize("row", PROJECTS, ids=names(PROJECTS))
def test_a_bad_project_is_told_and_never_a_traceback(row, tmp_path, capsys):
    (tmp_path / "swing.csv").write_bytes(text()())
    path = row.write(tmp_path)
    if row.code == 0:
        path.write_text(path.read_text(encoding="utf-8").replace("{folder}", tmp_path.name), encoding="utf-8")
        assert any(holds(note, row.says) for note in load_project(path).notes) or not row.says
        return
    code, out, err = run(capsys, "fit", path, "--out", tmp_path / "run")
    assert code == row.code, out + err
    assert holds(err, row.says), err
    assert "Traceback" not in out + err
    assert not (tmp_path / "run" / "result.json").exists()
    assert len(err) < 1000


def test_the_page_is_what_the_table_says():
    assert PAGE.read_text(encoding="utf-8") == page(), "type: python tests/safety/bad_input.py --write"


# --- what no bytes show ---------------------------------------------------------------------------------


@pytest.fixture
def log(tmp_path):
    """A good recording."""
    path = tmp_path / "log.csv"
    path.write_bytes(text()())
    return path


def more(path):
    with path.open("ab") as file:
        file.write(b"4.0,0,0\n")


@pytest.mark.parametrize(
    ("change", "error", "told"),
    [
        (more, DataError, r"log.csv changed while it was read. Is it still being written\?"),
        (os.unlink, InputError, "cannot be read: No such file or directory"),
    ],
)
def test_a_recording_that_changes_or_vanishes_while_it_is_read_is_told(log, monkeypatch, change, error, told):
    def read_and_change(path, variable):
        table = read_table(path, variable)
        change(path)
        return table

    monkeypatch.setattr("fracid.recording.loading.read_table", read_and_change)
    with pytest.raises(error, match=told):
        load_recording(log)


@pytest.mark.parametrize(
    ("fails", "error", "told"),
    [
        (PermissionError(13, "Permission denied"), InputError, r"log\.csv cannot be read: Permission denied"),
        (MemoryError(), DataError, r"log\.csv needs more memory than there is"),
    ],
)
def test_a_permission_that_is_refused_and_memory_that_there_is_not_are_told(log, monkeypatch, fails, error, told):
    def refuse(*_):
        raise fails

    monkeypatch.setitem(READERS, ".csv", refuse)
    with pytest.raises(error, match=told):
        load_recording(log)


def test_a_complex_signal_that_is_asked_for_is_told_why_it_is_none(tmp_path):
    np.savez(tmp_path / "run.npz", t=T, theta=T, alpha=1j * T)
    with pytest.raises(InputError, match=r"run\.npz: 'alpha' is complex; save its real part"):
        load_recording(tmp_path / "run.npz", {"alpha": "alpha"})
    with pytest.raises(InputError, match="has no variable 'beta'"):
        load_recording(tmp_path / "run.npz", {"alpha": "alpha"}, variable="beta")


MEBIBYTE = 1 << 20


def zeros_mat():
    """As many zeros as a file of its size may unpack to."""
    half = 4 * MEBIBYTE - 3000
    inner = element(6, struct.pack("<II", 6, 0)) + element(5, struct.pack("<ii", half, 1))
    raw = MAT5
    for name in (b"t", b"alpha"):
        packed = zlib.compress(element(14, inner + element(1, name) + element(9, bytes(8 * half))), 9)
        raw += struct.pack("<II", 15, len(packed)) + packed
    return raw + element(14, b"") * ((MEBIBYTE - len(raw)) // 8)


WORST = {
    "zeros.mat": zeros_mat,
    "columns.parquet": parquet({f"c{k}": [1.0, 2.0] for k in range(3000)}),
    "rows.csv": lambda: b"0,1\n" * (MEBIBYTE // 4),
    "blanks.csv": lambda: b"t,a,b\n" + b"".join(b"%d,,\n" % k for k in range(MEBIBYTE // 10)),
    "columns.csv": lambda: (b"1," * 9998 + b"1\n") * 52,
    "cells.csv": lambda: b"1 " * (MEBIBYTE // 2),
}

READ = """
import json, resource, sys, time
from fracid.errors import FracidError
from fracid.recording import inspect_recording
idle, begin = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
try:
    json.dumps(inspect_recording(sys.argv[1]).report.to_dict())
except FracidError:
    pass
print(time.process_time() - begin, (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - idle) / 2**20)
"""


@pytest.mark.slow
@pytest.mark.parametrize("name", WORST)
def test_the_worst_files_of_a_mebibyte_take_less_than_five_seconds_and_a_gibibyte(name, tmp_path):
    (tmp_path / name).write_bytes(WORST[name]())
    assert (tmp_path / name).stat().st_size <= 1.01 * MEBIBYTE
    done = subprocess.run([sys.executable, "-c", READ, tmp_path / name], capture_output=True, text=True, check=True)
    seconds, gibibytes = map(float, done.stdout.split())
    assert seconds < 5
    assert gibibytes < 1


@pytest.mark.slow
@pytest.mark.parametrize("name", LARGE)
def test_ten_million_samples_are_read_and_ten_thousand_recordings_are_a_project(tmp_path, name):
    _, write, call = LARGE[name]
    written, found = write(tmp_path / name), getattr(fracid, call)(tmp_path / name)
    if written is None:
        assert len(found.recordings) == 10_000
    else:
        assert found.time.size == 10**7
        alpha = next(iter(found.signals.values()))
        np.testing.assert_allclose(alpha[::100_000], written[::100_000], atol=1e-9)
