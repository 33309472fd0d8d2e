"""Logs with a row for each edge of an encoder."""

from functools import cache

import numpy as np
import pytest

import fracid
from fracid.recording.loading import inspect_recording

COUNTS = 2000
COUNT = 2 * np.pi / COUNTS


def angle(t):
    return 0.8 * np.exp(-0.2 * t) * np.cos(7 * t)


@cache
def edges():
    """When the count is another, to a microsecond, and which."""
    t = np.arange(0, 8, 1e-6)
    count = np.round(angle(t) / COUNT).astype(int)
    rows = np.flatnonzero(np.diff(count)) + 1
    return t[rows], count[rows]


def logged(path, jitter=0.0, other=False):
    """Stamps of a microsecond, as an interrupt takes them; the end in microseconds, too."""
    time, count = edges()
    stamps = time + jitter * np.random.default_rng(1).uniform(-1, 1, len(time))
    columns = [np.sort(stamps), count, *([np.round(300 * np.sin(time), 3)] if other else [])]
    header = "t [s],pendulum [counts]" + ",tension [N]" * other
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.9g")
    return path


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    return logged(tmp_path_factory.mktemp("edges") / "edges.csv")


COLUMNS = {"alpha": {"column": 1, "unit": "counts", "counts_per_turn": COUNTS}}


def test_edges_are_recognised_said_and_better_than_rounding(file):
    found = inspect_recording(file, COLUMNS)
    [note] = [line for line in found.report.reading if getattr(line, "code", "") == "edges"]
    assert "is an edge of alpha, one count on" in note
    assert found.report.level == "good", found.report.warnings
    assert found.step is not None
    error = found.signals["alpha"] - angle(found.time)
    assert np.sqrt(np.mean(error**2)) < 0.1 * COUNT / np.sqrt(12)
    assert abs(error).max() < COUNT


@pytest.mark.broad
def test_a_project_and_a_guess_of_units_take_them_as_samples(file):
    assert fracid.load_recording(file, COLUMNS).step is not None
    assert "counts of 4096 a turn: its numbers are whole" in " ".join(
        inspect_recording(file, guess_units=True).report.reading
    )


def test_another_column_is_read_between_its_rows(tmp_path):
    found = inspect_recording(logged(tmp_path / "both.csv", other=True), COLUMNS | {"force": {"column": 2}})
    assert found.units["force"] == "N"
    np.testing.assert_allclose(found.signals["force"], 300 * np.sin(found.time), atol=0.5)


def test_stamps_of_a_millisecond_are_edges_too(tmp_path):
    found = inspect_recording(logged(tmp_path / "late.csv", jitter=3e-4), COLUMNS)
    assert any("is an edge of" in line for line in found.report.reading)
    assert np.sqrt(np.mean((found.signals["alpha"] - angle(found.time)) ** 2)) < COUNT / 2


def test_samples_are_no_edges(tmp_path):
    """Of an even clock, of a jittering one, of a signal that flickers by one count, and where they are meant uneven."""
    t = np.arange(0, 8, 2e-3) + np.random.default_rng(2).uniform(0, 1e-3, 4000)
    for name, time, count in (
        ("even", np.arange(0, 8, 2e-3), np.round(angle(np.arange(0, 8, 2e-3)) / COUNT)),
        ("jitter", t, np.round(angle(t) / COUNT)),
        ("flicker", t, np.arange(4000) % 2),
    ):
        np.savetxt(
            tmp_path / f"{name}.csv", np.column_stack([time, count]), delimiter=",", header="t,pendulum", comments=""
        )
        found = inspect_recording(tmp_path / f"{name}.csv", COLUMNS)
        assert not any("is an edge of" in line for line in found.report.reading), name
    assert inspect_recording(logged(tmp_path / "edges.csv"), COLUMNS, uneven=True).step is None
