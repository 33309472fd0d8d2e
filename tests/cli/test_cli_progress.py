"""Long work says how far it is: to people on a terminal, to programs as events, to nobody else."""

import io
import json

import pytest

from fracid.cli import progress
from fracid.cli.progress import progress_shown
from fracid.tasks.job import Progress


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def clock(monkeypatch):
    """A clock that goes on when it is told to."""
    now = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])

    def wait(seconds):
        now[0] += seconds

    return wait


def test_where_there_is_no_terminal_nothing_is_said():
    stream = io.StringIO()
    with progress_shown("repetitions", events=False, stream=stream) as tell:
        assert tell is None
    assert stream.getvalue() == ""


def test_events_come_once_a_second_and_at_the_end(clock):
    stream = io.StringIO()
    with progress_shown("repetitions", events=True, stream=stream) as tell:
        for done in range(31):
            tell(Progress(done, 30, 0, seconds=0.125 * done, best=1 / (1 + done)))
            clock(0.125)
    events = [json.loads(line) for line in stream.getvalue().splitlines()]
    assert [e["done"] for e in events] == [0, 8, 16, 24, 30]
    assert events[1] == {"event": "progress", "what": "repetitions", "done": 8, "total": 30, "earlier": 0,
                         "seconds": 1.0, "rate": 8.0, "left": 2.75, "best": 1 / 9}  # fmt: skip
    assert events[0]["left"] is None


def test_the_last_event_comes_even_if_the_work_fails(clock):
    stream = io.StringIO()

    def fails(tell):
        tell(Progress(0, 3, 0, 0.0))
        tell(Progress(1, 3, 0, 0.5))
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError), progress_shown("fits", events=True, stream=stream) as tell:
        fails(tell)
    assert [json.loads(line)["done"] for line in stream.getvalue().splitlines()] == [0, 1]


def test_an_event_of_a_search_has_no_end(clock):
    stream = io.StringIO()
    with progress_shown("evaluations", events=True, stream=stream) as tell:
        tell(Progress(18, None, 0, 2.0, 0.25))
    event = json.loads(stream.getvalue())
    assert (event["total"], event["left"], event["rate"], event["best"]) == (None, None, 9.0, 0.25)


def test_a_terminal_shows_count_rate_and_best_and_is_left_clean(monkeypatch):
    monkeypatch.setenv("COLUMNS", "160")
    monkeypatch.setenv("TERM", "xterm")
    stream = Terminal()
    with progress_shown("repetitions", events=False, stream=stream) as tell:
        tell(Progress(12, 300, 0, 4.0, 0.0123456))
    shown = stream.getvalue()
    for piece in ("repetitions, best so far 0.0123456", "12/300", "3 a second", "left"):
        assert piece in shown
    assert shown.rstrip().endswith(("\x1b[2K", "\x1b[?25h", "\x1b[1A\x1b[2K"))
