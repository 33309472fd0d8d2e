"""What is read takes time as its length: twice the input, less than three times the time."""

import gc
import time
from pathlib import Path

import numpy as np
import pytest

from fracid.errors import FracidError
from fracid.problem.project import project_from_text
from fracid.recording.readers.text import parse_text
from fracid.safety.json_files import json_of
from fracid.safety.text import csv_cell, file_stems, printable

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


def least(way, n):
    """The least processor time of several [s]; when garbage is looked for is Python's affair, and comes in steps."""
    times = []
    gc.disable()
    try:
        for _ in range(4):
            begun = time.thread_time()
            way(n)
            times.append(time.thread_time() - begun)
    finally:
        gc.enable()
    return min(times)


@pytest.mark.parametrize("name", WAYS)
def test_twice_the_input_takes_less_than_three_times_the_time(name):
    way, n = WAYS[name]
    ratios = (least(way, 2 * n) / least(way, n) for _ in range(3))
    assert any(ratio < 3.0 for ratio in ratios)


def test_what_takes_the_square_is_found():
    assert least(lambda n: np.subtract.outer(np.arange(n), np.arange(n)), 2000) > 3.0 * least(
        lambda n: np.subtract.outer(np.arange(n), np.arange(n)), 1000
    )
