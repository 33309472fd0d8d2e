"""Fuzzing finds what it is meant to find; and for two minutes, in the slow group, it finds nothing."""

import ctypes
import os
import stat
import time

import numpy as np
import pytest

import fuzz
import fuzz_equations
import fuzz_folders
from fracid.errors import DataError, InputError
from fuzz_inputs import PACKAGED, READERS, input_of


@pytest.mark.few(2)
@pytest.mark.parametrize("reader", READERS)
def test_an_input_is_found_again_by_its_number(reader):
    inputs = [input_of(reader, number) for number in range(200)]
    assert inputs == [input_of(reader, number) for number in range(200)]
    assert len({raw for _, raw in inputs}) > 150


@pytest.mark.few(2)
@pytest.mark.parametrize("reader", sorted(set(READERS) - set(PACKAGED)))
def test_some_inputs_are_taken_and_most_are_refused_in_a_line(reader, tmp_path):
    outcomes = [fuzz.judge(reader, tmp_path, number) for number in range(20 if reader == "search" else 60)]
    assert [o for o in outcomes if o.startswith("!")] == []
    assert outcomes.count("taken") > 0
    assert outcomes.count("InputError") + outcomes.count("DataError") > len(outcomes) / 6


@pytest.mark.few(1)
@pytest.mark.parametrize("reader", PACKAGED)
def test_what_a_package_reads_is_taken_or_refused_in_a_line_or_stopped(reader):
    ended, failures = fuzz.fuzz_reader(reader, range(36), 300)  # a few dozen; tests/safety/fuzz.py has thousands
    assert failures == {}
    assert ended["taken"] > 0
    assert ended.total() == 36


def broken(how):
    """A way of reading that goes wrong at input 20."""

    def read(reader, number, file):
        if number == 20:
            how()
        raise DataError("It is refused.")

    return read


def fill_memory():
    np.ones(9 << 24)  # 1.1 GiB


def stand_still():
    until = time.process_time() + 60
    while time.process_time() < until:
        pass


def warn():
    import warnings

    warnings.warn("careless", stacklevel=1)


def crash():
    ctypes.string_at(0)


def say():
    os.write(1, b"careless")


FAULTS = {
    "died by SIGSEGV": crash,
    "more than 0.5 s of processor time": stand_still,
    "used 1.": fill_memory,
    "warning: careless": warn,
    "wrote: careless": say,
    "ZeroDivisionError: division by zero": lambda: 1 / 0,
}


@pytest.mark.few(1)
@pytest.mark.parametrize("told", FAULTS)
def test_what_goes_wrong_is_counted_and_told_and_the_next_inputs_are_run(told, monkeypatch, tmp_path):
    monkeypatch.setattr(fuzz, "read", broken(FAULTS[told]))
    monkeypatch.setattr(fuzz, "SECONDS", 0.5 if "processor" in told else 60.0)
    ended, failures = fuzz.fuzz_reader("npy", range(15, 30), 60, keep=tmp_path)
    assert ended == {"DataError": 14, "failed": 1}
    assert told in failures[20]
    assert (tmp_path / "npy-20.npy").read_bytes() == input_of("npy", 20)[1]


@pytest.mark.parametrize(
    ("message", "fault"),
    [("two\nlines.", "one printable line"), ("\x1b[31mred.", "one printable line"), ("x" * 800, "800 characters")],
)
def test_a_message_that_nobody_can_read_is_a_fault(message, fault):
    assert fault in fuzz.fault_of_message(message)
    assert fuzz.fault_of_message("log.csv is empty.") is None


@pytest.mark.slow
@pytest.mark.parametrize("reader", READERS)
def test_no_hostile_file_breaks_a_reader(reader, tmp_path):
    ended, failures = fuzz.fuzz_reader(reader, range(20_000), 16, keep=tmp_path)
    assert failures == {}
    assert ended.total() > 30  # a slow machine takes whole searches at 5 a second


# --- folders of folders ---------------------------------------------------------------------------------


@pytest.mark.broad
def test_a_tree_is_found_again_by_its_number_and_holds_all_kinds(tmp_path):
    kinds = set()
    for number in range(25):
        trees = []
        for place in ("one", "two"):
            scratch = tmp_path / f"{number}" / place
            scratch.mkdir(parents=True)
            words = [word.replace(str(scratch), "") for word in fuzz_folders.planted(number, scratch)]
            paths = sorted((scratch / "in").rglob("*"))
            trees.append((words, [(str(path.relative_to(scratch)), path.lstat().st_mode) for path in paths]))
            kinds |= {stat.S_IFMT(mode) for _, mode in trees[-1][1]}
        assert trees[0] == trees[1]
    assert kinds == {stat.S_IFDIR, stat.S_IFREG, stat.S_IFLNK, stat.S_IFIFO, stat.S_IFSOCK}


@pytest.mark.slow(minutes=3)
def test_no_tree_of_anything_at_all_breaks_a_command():
    ended, failures = fuzz_folders.fuzz(range(10_000), seconds=120)
    assert failures == {}
    assert sum(ended.values()) > 100


@pytest.mark.broad
def test_no_equation_of_a_hostile_project_is_run_or_takes_long():
    ended, failures = fuzz_equations.fuzz(range(1500))
    assert failures == {}
    assert ended["taken"] > 20
    assert ended["refused"] > 1000


@pytest.mark.parametrize("deed", [
    lambda text: eval("1 + 1"), lambda text: open(__file__).close(), lambda text: time.sleep(0.0) or sum(range(10**7)),
    lambda text: 1 / 0, lambda text: (_ for _ in ()).throw(InputError("a\x1b[2J")),
], ids=["runs a text", "opens a file", "takes long", "breaks", "commands a terminal"])  # fmt: skip
def test_an_equation_that_does_more_than_mean_something_is_found(deed, monkeypatch):
    monkeypatch.setattr(fuzz_equations, "_model", deed)
    assert fuzz_equations.judged("speed").startswith("!")


@pytest.mark.parametrize(
    "code", ["x.real", "f'{x}'", "lambda: 0", "x if (y := 1) else 0", "open", "[x for x in u]", "'a'"]
)
def test_code_that_is_more_than_mathematics_is_found(code):
    assert fuzz_equations._more_than_mathematics(code) != ""
