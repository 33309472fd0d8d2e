"""What is read takes time as its length: eight times the input, less than 24 times the time (64 for a square)."""

import gc
import hashlib
import json
import shutil
import time
from pathlib import Path

import numpy as np
import pytest

import corpus
from fracid.errors import FracidError
from fracid.problem.project import project_from_text
from fracid.recording import load_recording
from fracid.recording.readers.text import parse_text
from fracid.report import write_report
from fracid.report.index import write_index
from fracid.safety.json_files import json_of
from fracid.safety.text import csv_cell, file_stems, printable
from twins import write

WAYS = {
    "rows of text": (lambda n: parse_text("t,alpha\n" + "0.1,0.2\n" * n), 5_000),
    "columns of text": (
        lambda n: parse_text(",".join("a" * n) + "\n" + ",".join("1" * n) + "\n" + ",".join("2" * n)),
        2_000,
    ),
    "blank cells": (lambda n: parse_text("t,a,b\n" + "".join(f"{k},,\n" for k in range(n))), 3_000),
    "unknown tables of a project": (lambda n: refused("".join(f"[k{k}]\n" for k in range(n))), 3_000),
    "recordings of a project": (lambda n: refused("".join(f"[[recording]]\nx{k} = 1\n" for k in range(n))), 2_000),
    "lists of a project": (lambda n: refused(f"a = [{'{},' * n}]"), 5_000),
    "lines of a project that is no TOML": (lambda n: refused("#\n" * n + "a = b c"), 25_000),
    "lists of JSON": (lambda n: json_of("[" + "[]," * n + "1]"), 12_000),
    "names that look alike": (
        lambda n: file_stems(f"{'°' * (k % 9)}a{'°' * k}"[:150] + chr(300 + k) for k in range(n)),
        2_000,
    ),
    "letters that are not seen": (lambda n: printable("\u200b" * n), 12_000),
    "cells in a cell": (lambda n: csv_cell("=1;" * n), 5_000),
}


def refused(text):
    with pytest.raises(FracidError):
        project_from_text(text, Path("rig.toml"))


def least(way, n, tries=4):
    """The least processor time of several [s]; when garbage is looked for is Python's affair, and comes in steps."""
    times = []
    gc.disable()
    try:
        for _ in range(tries):
            begun = time.thread_time()
            way(n)
            times.append(time.thread_time() - begun)
    finally:
        gc.enable()
    return min(times)


def grows_by(way, *sizes, **tries):
    """The least that the time of `way` was seen to grow by from the first of two sizes to the second."""
    return min(least(way, sizes[1], **tries) / least(way, sizes[0], **tries) for _ in range(3))


@pytest.mark.few(3)
@pytest.mark.parametrize("name", WAYS)
def test_eight_times_the_input_takes_less_than_24_times_the_time(name):
    way, n = WAYS[name]
    assert grows_by(way, n // 4, 2 * n) < 24.0


BINARY = {
    "npz": corpus.npz, "mat": corpus.mat, "parquet": corpus.parquet,
    "h5": lambda columns: corpus.hdf5(lambda h: [h.__setitem__(*column) for column in columns.items()]),
}  # fmt: skip


@pytest.mark.broad
@pytest.mark.parametrize("kind", BINARY)
def test_eight_times_the_samples_of_a_binary_recording_take_less_than_24_times_the_time(kind, tmp_path):
    n = 10_000
    for k in (1, 8):
        time = 1e-3 * np.arange(k * n)
        columns = {"t": time, "alpha": 0.3 * np.cos(time) + 1e-3 * np.sin(1e5 * time**2)}
        (tmp_path / f"{k}.{kind}").write_bytes(BINARY[kind](columns))
    assert grows_by(lambda k: load_recording(tmp_path / f"{k}.{kind}"), 1, 8) < 24.0


def run_of(plain, folder, *, samples=200, recordings=1):
    """The run of `plain` as if it had had so many recordings of so many samples."""
    shutil.copytree(plain, folder)
    head, table = (folder / "rig.toml").read_text().split("[[recording]]")
    result = json.loads((folder / "run" / "result.json").read_text())
    entry, hashes, time = result["recordings"].pop("swing"), {}, 1e-2 * np.arange(samples)
    swing = 0.35 * np.exp(-0.3 * time) * np.cos(7 * time) + 1e-3 * np.random.default_rng(1).standard_normal(samples)
    write(folder / "swing.csv", np.column_stack([0.1 * swing, swing]), 1e-2)
    for name in (f"swing{k}" for k in range(recordings)):
        shutil.copy(folder / "swing.csv", folder / f"{name}.csv")
        head += f"[[recording]]{table.replace('swing', name)}"
        hashes[name] = hashlib.sha256((folder / "swing.csv").read_bytes()).hexdigest()
    result |= {"recordings": dict.fromkeys(hashes, entry), "data_sha256": hashes}
    (folder / "run" / "result.json").write_text(json.dumps(result))
    for path in (folder / "rig.toml", folder / "run" / "project.toml"):
        path.write_text(head)
    return folder / "run"


def test_the_index_of_eight_times_the_runs_takes_less_than_24_times_the_time(plain, tmp_path):
    n = 4
    for k in range(9 * n):
        shutil.copytree(plain / "run", tmp_path / f"{1 if k < n else 8}" / f"{k}")
    assert grows_by(lambda k: write_index(tmp_path / f"{k}"), 1, 8, tries=2) < 24.0


@pytest.mark.broad
@pytest.mark.parametrize(("of", "n"), [("samples", 5_000), ("recordings", 3)])
def test_the_page_of_eight_times_the_run_takes_less_than_24_times_the_time(of, n, plain, tmp_path):
    runs = {k: run_of(plain, tmp_path / f"{k}", **{of: k * n}) for k in (1, 8)}
    assert grows_by(lambda k: write_report(runs[k]), 1, 8, tries=2) < 24.0


@pytest.mark.broad
def test_what_takes_the_square_is_found():
    assert grows_by(lambda n: np.subtract.outer(np.arange(n), np.arange(n)), 500, 4000) > 24.0
