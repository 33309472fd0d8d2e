"""What a journal has taken stays, whatever happens to the process, the file or the disk."""

import errno
import json
import os
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import fracid
from fracid.errors import InputError, Unfinished
from fracid.tasks.folder_lock import FolderLock
from fracid.tasks.journal import Journal

STUDY = {"problem": "9f2c", "seeds": 50, "levels": [0.0, 0.05]}


@pytest.fixture
def path(tmp_path):
    return tmp_path / "journal.jsonl"


def written(path, count=4):
    """A journal with some lines; gives what is done."""
    with Journal(path, STUDY) as journal:
        for seed in range(count):
            journal.append(f"seed {seed}, µ", {"cost": 0.1 + 0.2 * seed, "μ": [seed / 3, None]}, 0.5)
        return dict(journal.done)


def test_numbers_come_back_to_the_bit(path):
    done = written(path)
    with Journal(path, STUDY) as journal:
        assert journal.done == done
        assert journal.notes == ()


def test_every_line_is_in_the_file_as_soon_as_it_is_appended(path):
    with Journal(path, STUDY) as journal:
        for seed in range(3):
            journal.append(str(seed), seed)
            assert json.loads(path.read_bytes().splitlines()[-1]) == {"key": str(seed), "seconds": 0.0, "value": seed}


def test_a_line_torn_at_any_byte_is_removed_said_and_written_again(path):
    done = written(path)
    whole = path.read_bytes()
    last = len(whole.splitlines(keepends=True)[-1])
    kept, lost = dict(list(done.items())[:-1]), list(done.items())[-1]
    for cut in range(1, last):
        path.write_bytes(whole[:-cut])
        with Journal(path, STUDY) as journal:
            assert journal.done == kept
            assert "cut off in writing" in journal.notes[0]
            journal.append(*lost, 0.5)
        assert path.read_bytes() == whole


@pytest.mark.parametrize("tail", [b"\0" * 4096, b'{"key": "x", "val', b"\xff\xfe", b"{"])
def test_whatever_a_crash_leaves_at_the_end_is_removed(path, tail):
    done = written(path)
    whole = path.read_bytes()
    path.write_bytes(whole + tail)
    with Journal(path, STUDY) as journal:
        assert journal.done == done
        assert len(journal.notes) == 1
    assert path.read_bytes() == whole


@pytest.mark.parametrize("damaged", [b"\0\0\0\0", b"[1, 2]", b'{"no": "key"}'])
def test_a_damaged_line_in_the_middle_costs_its_own_repetition_alone(path, damaged):
    done = written(path)
    lines = path.read_bytes().splitlines()
    lines[2] = damaged
    path.write_bytes(b"\n".join(lines) + b"\n")
    with Journal(path, STUDY) as journal:
        assert set(done) - set(journal.done) == {"seed 1, µ"}
        assert "damaged lines (3)" in journal.notes[0]


def test_a_header_torn_in_writing_is_written_again(path):
    written(path, 0)
    whole = path.read_bytes()
    path.write_bytes(whole[:-10])
    with Journal(path, STUDY) as journal:
        assert journal.done == {}
    assert path.read_bytes() == whole


@pytest.mark.parametrize(
    ("study", "differs"),
    [
        (
            {**STUDY, "seeds": 20},
            r"another study: seeds was 50 and is 20\. Give this one another folder: --out DIR.* fracid resume",
        ),
        ({**STUDY, "counts": 4096}, r"counts was null and is 4096"),
        ({"seeds": 50, "problem": "9f2c"}, r"levels was \[0.0, 0.05\] and is null"),
    ],
)
def test_another_study_is_refused_with_what_differs(path, study, differs):
    written(path)
    with pytest.raises(InputError, match=differs):
        Journal(path, study)
    with Journal(path, STUDY) as journal:  # and let go of
        assert len(journal.done) == 4


def test_a_file_that_is_no_journal_is_left_alone(path):
    path.write_text('{"n": 1}\n')
    with pytest.raises(InputError, match=r"is no journal of this version"):
        Journal(path, STUDY)
    assert path.read_text() == '{"n": 1}\n'


def test_a_tuple_in_the_study_is_the_list_that_the_file_has(path):
    with Journal(path, {"levels": (1, 2)}):
        pass
    with Journal(path, {"levels": (1, 2)}) as journal:
        assert journal.done == {}


# --- one process a folder --------------------------------------------------------------------------

HOLDER = """
import sys, time
from pathlib import Path
from fracid.tasks.folder_lock import FolderLock
with FolderLock(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


@pytest.fixture
def holder(tmp_path):
    """Another process at work in the folder."""
    process = subprocess.Popen([sys.executable, "-c", HOLDER, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "held\n"
    yield process
    process.kill()
    process.wait()
    process.stdout.close()


def test_a_second_process_on_a_folder_is_refused_and_told_who_is_there(path, holder):
    import socket

    with pytest.raises(InputError, match=rf"number {holder.pid} on {socket.gethostname()}, since 20\d\d-.*--out DIR"):
        Journal(path, STUDY)


def test_a_killed_process_leaves_no_lock(path, holder):
    holder.kill()
    holder.wait()
    assert written(path)


@pytest.mark.skipif(sys.platform == "win32", reason="flock")
@pytest.mark.parametrize("number", [errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS])
def test_a_file_system_without_locks_keeps_nobody_out(path, monkeypatch, number):
    def without(*_):
        raise OSError(number, "no locks here")

    monkeypatch.setattr("fcntl.flock", without)
    with Journal(path, STUDY) as journal:
        journal.append("one", {"value": 1})
    assert path.read_bytes().count(b"\n") == 2


def test_no_duration_is_taken_from_the_clock_on_the_wall_which_may_go_back_or_jump():
    package = Path(fracid.__file__).parent
    wall = r"\btime\.time\(|\btime_ns\("  # a date for people may be any
    assert [path for path in package.rglob("*.py") if re.search(wall, path.read_text(encoding="utf-8"))] == []


def taken(folder):
    """What somebody is told who wants the folder; nothing where it is free."""
    try:
        with FolderLock(folder):
            return ""
    except InputError as error:
        return str(error)


def test_a_second_thread_on_a_folder_is_refused_and_has_it_afterwards(tmp_path):
    with ThreadPoolExecutor(1) as other:
        with FolderLock(tmp_path):
            assert "This process is at work in" in other.submit(taken, tmp_path).result()
        assert other.submit(taken, tmp_path).result() == ""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no forks here")
def test_a_process_that_is_forked_off_has_no_hold_and_takes_none_away(tmp_path):
    with FolderLock(tmp_path) as lock:
        pid = os.fork()
        if not pid:
            lock.__exit__()
            os._exit(int("Another process is at work in" in taken(tmp_path)))
        assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 1
        assert str(os.getpid()) in (tmp_path / ".lock").read_text()
    assert taken(tmp_path) == ""


def test_the_lock_names_who_has_it_and_no_one_afterwards(tmp_path):
    with Journal(tmp_path / "a.jsonl", STUDY):
        assert (tmp_path / ".lock").read_text()
        assert "This process is at work in" in taken(tmp_path)
    assert not (tmp_path / ".lock").read_text()


# --- a disk that will not take it ------------------------------------------------------------------

FULL = """
import resource, sys
from pathlib import Path
from fracid.errors import FracidError
from fracid.tasks.journal import Journal
if sys.argv[2] != "none":
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), int(sys.argv[2])))
try:
    with Journal(Path(sys.argv[1]) / "journal.jsonl", {"seeds": 50}) as journal:
        for seed in range(10_000):
            journal.append(f"seed {seed}", "x" * 100)
except FracidError as error:
    print(len(journal.done), error)
    sys.exit(error.exit_code)
"""


def fill(folder, limit):
    return subprocess.run([sys.executable, "-c", FULL, str(folder), limit], capture_output=True, text=True, check=False)


def still_whole(folder, count):
    with Journal(Path(folder) / "journal.jsonl", {"seeds": 50}) as journal:
        assert list(journal.done) == [f"seed {seed}" for seed in range(count)]
        assert journal.notes == ()


@pytest.mark.skipif(sys.platform == "win32", reason="RLIMIT_FSIZE")
def test_a_file_that_may_not_grow_keeps_what_it_has_and_says_so(tmp_path):
    ended = fill(tmp_path, "5000")
    assert ended.returncode == Unfinished.exit_code, ended.stderr
    count, sentence = ended.stdout.split(" ", 1)
    assert "cannot be written: File too large. What was done before is kept: make room, then type" in sentence
    assert 20 < int(count) < 50
    still_whole(tmp_path, int(count))


@pytest.fixture
def mounted(tmp_path):
    """Mount a small disk on a folder; skip where that is not allowed."""
    folders = []

    def mount(options):
        command = ["mount", "-t", "tmpfs", "-o", f"size=64k,{options}", "tmpfs", str(tmp_path)]
        try:
            if subprocess.run(command, check=False, capture_output=True).returncode:
                pytest.skip("needs the right to mount a small tmpfs")
        except OSError:
            pytest.skip("needs mount")
        folders.append(tmp_path)
        return tmp_path

    yield mount
    for folder in folders:
        subprocess.run(["umount", folder], check=True)


def test_a_full_disk_keeps_what_it_has_and_says_so(mounted):
    disk = mounted("rw")
    ended = fill(disk, "none")
    assert ended.returncode == Unfinished.exit_code, ended.stderr
    count, sentence = ended.stdout.split(" ", 1)
    assert "the disk is full. What was done before is kept: make room, then type fracid resume" in sentence
    assert int(count) > 100
    still_whole(disk, int(count))


def test_a_read_only_disk_is_said(mounted):
    with pytest.raises(InputError, match=r"cannot be written: Read-only file system\. Give another: --out DIR"):
        Journal(mounted("ro") / "journal.jsonl", STUDY)


@pytest.mark.usefixtures("heeding_modes")
def test_a_folder_without_the_right_to_write_is_said(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(InputError, match=r"cannot be written: Permission denied\. Give another: --out DIR"):
        Journal(tmp_path / "journal.jsonl", STUDY)


@pytest.mark.parametrize("place", ["missing/journal.jsonl", "file/journal.jsonl"])
def test_a_folder_that_is_none_is_said(tmp_path, place):
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"cannot be written: (No such file|Not a directory)"):
        Journal(tmp_path / place, STUDY)
