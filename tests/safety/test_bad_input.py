"""The catalogue of bad input: each row is made, read, and told in its sentence and with its exit code."""

import os
import struct
import subprocess
import sys
import zlib

import numpy as np
import pytest

from bad_input import PAGE, PROJECTS, RECORDINGS, T, element, page, parquet, text
from fracid.errors import DataError, FracidError, InputError
from fracid.problem.project import load_project
from fracid.recording import load_recording, read_table
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


@pytest.mark.few(18)
@pytest.mark.parametrize("row", RECORDINGS, ids=names(RECORDINGS))
def test_a_bad_recording_is_told_and_never_a_traceback(row, tmp_path, capsys):
    if "permission" in row.wrong and os.geteuid() == 0:
        pytest.skip("root may read everything")
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


@pytest.mark.few(12)
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


def test_a_recording_that_is_still_being_written_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "log.csv"
    path.write_bytes(text()())

    def read_and_write(path, variable):
        table = read_table(path, variable)
        with path.open("ab") as file:
            file.write(b"4.0,0,0\n")
        return table

    monkeypatch.setattr("fracid.recording.loading.read_table", read_and_write)
    with pytest.raises(DataError, match=r"log.csv changed while it was read. Is it still being written\?"):
        load_recording(path)


def test_a_recording_that_vanishes_while_it_is_read_is_told(tmp_path, monkeypatch):
    path = tmp_path / "log.csv"
    path.write_bytes(text()())

    def read_and_delete(path, variable):
        table = read_table(path, variable)
        path.unlink()
        return table

    monkeypatch.setattr("fracid.recording.loading.read_table", read_and_delete)
    with pytest.raises(InputError, match="cannot be read: No such file or directory"):
        load_recording(path)


def test_a_permission_that_is_refused_is_told(tmp_path, monkeypatch):
    path = tmp_path / "log.csv"
    path.write_bytes(text()())

    def refuse(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setitem(__import__("fracid.recording.readers.table", fromlist=["READERS"]).READERS, ".csv", refuse)
    with pytest.raises(InputError, match=r"log\.csv cannot be read: Permission denied"):
        load_recording(path)


def test_more_memory_than_there_is_is_told(tmp_path, monkeypatch):
    path = tmp_path / "log.csv"
    path.write_bytes(text()())

    def fill(*_):
        raise MemoryError

    monkeypatch.setitem(__import__("fracid.recording.readers.table", fromlist=["READERS"]).READERS, ".csv", fill)
    with pytest.raises(DataError, match=r"log\.csv needs more memory than there is"):
        load_recording(path)


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
    numbers = element(9, bytes(8 * half))
    raw = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    for name in (b"t", b"alpha"):
        packed = zlib.compress(element(14, inner + element(1, name) + numbers), 9)
        raw += struct.pack("<II", 15, len(packed)) + packed
    return raw + element(14, b"") * ((MEBIBYTE - len(raw)) // 8)


WORST = {
    "zeros.mat": zeros_mat,
    "columns.parquet": parquet(**{f"c{k}": [1.0, 2.0] for k in range(3000)}),
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
def test_ten_thousand_recordings_are_a_project(tmp_path):
    words = ['[model.orders]\nlambda = 1.0\nmu = 0.95\n[fit]\ninitial_state = "held"\n']
    for k in range(10_000):
        np.save(tmp_path / f"{k}.npy", np.column_stack([T[:20], np.cos(5 * T[:20]) + 1e-6 * k]))
        words.append(f'[[recording]]\nfile = "{k}.npy"\ntime = {{ column = 0 }}\nalpha = {{ column = 1 }}\n')
    (tmp_path / "rig.toml").write_text("".join(words))
    assert len(load_project(tmp_path / "rig.toml").recordings) == 10_000


@pytest.mark.slow
@pytest.mark.parametrize("ending", ["csv", "npz"])
def test_ten_million_samples_are_read(tmp_path, ending):
    time = np.arange(10**7) / 1000
    alpha = np.round(4096 * np.cos(time)) * 2e-4
    path = tmp_path / f"long.{ending}"
    if ending == "npz":
        np.savez(path, t=time, alpha=alpha)
    else:
        with path.open("w") as file:
            file.write("t,alpha\n")
            for k in range(0, time.size, 100_000):
                pairs = zip(time[k : k + 100_000], alpha[k : k + 100_000], strict=True)
                file.writelines(f"{t:.3f},{a:.4f}\n" for t, a in pairs)
    recording = load_recording(path)
    assert recording.time.size == 10**7
    np.testing.assert_allclose(recording.signals["alpha"][::100_000], alpha[::100_000], atol=1e-9)
