"""The last resort: what nobody has foreseen ends in one line that says what to send, never in a traceback."""

import errno

import pytest

from program import run

CODE = 4


@pytest.fixture
def broken(monkeypatch):
    """Have `fracid check` meet an error."""

    def with_error(error):
        def fail(*_, **__):
            raise error

        monkeypatch.setattr("fracid.recording.inspect_recording", fail)

    return with_error


@pytest.mark.parametrize(
    "error",
    [
        ZeroDivisionError("division by zero"),
        KeyError("alpha"),
        RecursionError("too deep"),
        AssertionError(),
        OSError(errno.EIO, "Input/output error"),
        ValueError("x" * 5000 + "\x1b[31m\nsecond line"),
    ],
    ids=lambda error: type(error).__name__,
)
def test_a_fault_of_fracid_itself_is_one_line_that_says_what_to_send(error, broken, capsys):
    broken(error)
    code, out, err = run(capsys, "check", "swing.csv")
    assert code == CODE
    assert out == ""
    assert err.startswith(f"error: fracid itself is at fault, not you: {type(error).__name__}")
    assert err.count("\n") == 1
    assert err.strip().isprintable()
    assert len(err) < 1000
    assert "check.py:" in err, "the line of our code in which it happened"
    assert "Please send the maintainers this line" in err


def test_a_name_that_no_disk_can_have_is_the_callers_mistake(capsys, tmp_path):
    (tmp_path / "swing.csv").write_text("t,alpha\n" + "".join(f"{k / 100},{0.3 - k / 1000}\n" for k in range(99)))
    code, out, err = run(capsys, "init", tmp_path / "swing.csv", "--yes", "--out", tmp_path / f"{'x' * 255}.toml")
    assert (code, out) == (2, "")
    assert err == f"error: {tmp_path}/{'x' * 255}.toml: File name too long. Give another path.\n"


def test_the_environment_asks_for_the_traceback(broken, capsys, monkeypatch):
    broken(ZeroDivisionError("division by zero"))
    monkeypatch.setenv("FRACID_TRACEBACK", "1")
    with pytest.raises(ZeroDivisionError):
        run(capsys, "check", "swing.csv")


@pytest.mark.parametrize(
    ("error", "lack"),
    [
        (RuntimeError("can't start new thread"), "are not enough threads"),
        (OSError(errno.EMFILE, "Too many open files"), "are too many open files"),
    ],
)
def test_too_few_threads_or_files_are_no_fault_of_fracid(error, lack, broken, capsys):
    broken(error)
    code, _, err = run(capsys, "check", "swing.csv")
    assert (code, err.startswith(f"error: there {lack}. ")) == (1, True)


def test_too_little_memory_is_no_fault_of_fracid(broken, capsys):
    broken(MemoryError("Unable to allocate 256 TiB"))
    code, _, err = run(capsys, "check", "swing.csv")
    assert (code, err) == (1, "error: there is not enough memory. Unable to allocate 256 TiB\n")
