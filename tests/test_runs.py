"""The run folder: whole or not at all, and only where it may be."""

import json
import os
import stat
from pathlib import Path

import pytest

from fracid.errors import InputError
from fracid.runs import EVALUATIONS, FIGURES, open_folder, versions, write_text

ROOT = hasattr(os, "geteuid") and os.geteuid() == 0


def test_a_new_folder_is_made_with_its_environment(tmp_path):
    folder = open_folder(tmp_path / "a" / "b")
    environment = json.loads((folder / "environment.json").read_text())
    assert environment["versions"] == versions()
    assert set(environment) == {"versions", "platform", "command"}


def test_an_earlier_run_is_cleared_of_its_own_files_alone(tmp_path):
    folder = open_folder(tmp_path / "run")
    (folder / FIGURES).mkdir()
    own = [folder / EVALUATIONS, folder / "result.json", folder / FIGURES / "old.svg", folder / FIGURES / "old.png"]
    foreign = [folder / "notes.txt", folder / FIGURES / "notes.txt"]
    for path in (*own, *foreign):
        path.write_text("x")
    open_folder(folder)
    assert not any(path.exists() for path in own)
    assert all(path.exists() for path in foreign)


def test_a_folder_with_foreign_files_is_refused_and_left_as_it_was(tmp_path):
    (tmp_path / "thesis.tex").write_text("x")
    with pytest.raises(InputError, match=r"holds files that are not a run's; give an empty or a new folder: --out DIR"):
        open_folder(tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize("below", [(), ("deeper",)])
def test_a_file_in_the_place_of_the_folder_is_told(tmp_path, below):
    (tmp_path / "file").write_text("x")
    with pytest.raises(InputError, match="is no folder, or lies below a file; give another: --out DIR"):
        open_folder(Path(tmp_path / "file", *below))


@pytest.mark.skipif(ROOT, reason="root may write anywhere")
def test_a_folder_that_cannot_be_written_is_told(tmp_path):
    tmp_path.chmod(stat.S_IRUSR | stat.S_IXUSR)
    with pytest.raises(InputError, match=r"cannot be written: Permission denied. Give another: --out DIR"):
        open_folder(tmp_path / "run")


def test_a_disk_that_takes_nothing_is_told(tmp_path, monkeypatch):
    def full(path, text):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("fracid.runs.write_text", full)
    with pytest.raises(InputError, match="cannot be written: No space left on device"):
        open_folder(tmp_path / "run")


def test_a_file_is_written_whole_or_not_at_all(tmp_path, monkeypatch):
    path = tmp_path / "result.json"
    write_text(path, "first")

    def fails(*_):
        raise OSError(5, "Input/output error")

    monkeypatch.setattr("os.fsync", fails)
    with pytest.raises(OSError, match="Input/output"):
        write_text(path, "second")
    assert path.read_text() == "first"
    assert [p.name for p in tmp_path.iterdir()] == ["result.json"]


def test_others_may_read_a_file_as_far_as_the_umask_allows(tmp_path):
    before = os.umask(0o022)
    try:
        write_text(tmp_path / "a", "λ")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "a").stat().st_mode) == 0o644
    assert (tmp_path / "a").read_bytes() == "λ".encode()
