"""Long work says how far it is: to people on a terminal and in notebooks, to programs as events, to nobody else."""

import io
import json
import logging
import re
import signal
import sys
import types

import pytest

from fracid.tasks import display
from fracid.tasks.display import shown, unless_given
from fracid.tasks.job import Progress
from fracid.tasks.progress import SILENT, Observer


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def clock(monkeypatch):
    """A clock that goes on when it is told to."""
    now = [100.0]
    monkeypatch.setattr(display.time, "monotonic", lambda: now[0])

    def wait(seconds):
        now[0] += seconds

    return wait


def lines(stream):
    """What stays on a terminal, without its colours."""
    return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", stream.getvalue()).split("\n")[:-1]


def test_where_there_is_no_terminal_only_notices_and_the_result_are_told():
    stream, results = io.StringIO(), []
    with shown(stream=stream, result=results.append) as observer:
        observer.stage("search")
        with observer.progress("evaluations") as tell:
            assert tell is None
        observer.notice("The clock has gaps.")
        observer.result("run")
    assert stream.getvalue() == "The clock has gaps.\n"
    assert results == ["run"]


def test_events_come_once_a_second_and_at_the_end(clock):
    stream = io.StringIO()
    with shown(events=True, stream=stream) as observer, observer.progress("repetitions") as tell:
        for done in range(31):
            tell(Progress(done, 30, 0, seconds=0.125 * done, best=1 / (1 + done)))
            clock(0.125)
    first, *events = [json.loads(line) for line in stream.getvalue().splitlines()]
    assert first == {"event": "stage", "name": "repetitions", "seconds": 0.0}
    assert [e["done"] for e in events] == [0, 8, 16, 24, 30]
    assert events[1] == {"event": "progress", "what": "repetitions", "done": 8, "total": 30, "earlier": 0,
                         "seconds": 1.0, "rate": 8.0, "left": 2.75, "best": 1 / 9}  # fmt: skip
    assert events[0]["left"] is None


def test_a_failure_passes_and_leaves_the_terminal_clean(clock):
    stream = Terminal()

    def fails(observer):
        observer.stage("search")
        clock(1.0)
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError), shown(stream=stream) as observer:
        fails(observer)
    assert lines(stream) == []


def test_a_terminal_keeps_a_line_of_each_stage_with_what_it_came_to(clock, monkeypatch):
    monkeypatch.setenv("COLUMNS", "120")
    stream = Terminal()
    with shown(stream=stream) as observer:
        observer.stage("search")
        with observer.progress("evaluations") as tell:
            tell(Progress(100, None, 0, 0.5, None, "rad", "the first 2 of 20 s"))
            tell(Progress(1556, None, 0, 1.0, 0.056 / 57.29577951, "rad"))
        clock(1.84)
        observer.stage("a stage that is over at once")
        observer.stage("integer-order alternative")
        clock(75)
    assert lines(stream) == [
        "✓ search · 1,556 evaluations · 0.056° · 1.8 s",
        "✓ integer-order alternative · 1 min 15 s",
    ]


@pytest.mark.parametrize(
    ("progress", "text"),
    [
        (Progress(260, 300, 20, 48.0), "260 of 300 repetitions · 48 s · 6 s left"),
        (Progress(260, None, 20, 48.0), "260 repetitions · 48 s"),
        (Progress(22, 300, 20, 48.0), "22 of 300 repetitions · 48 s"),
        (Progress(260, 300, 20, 48.0, even=False, note="again"), "260 of 300 repetitions · again · 48 s"),
        (Progress(260, 300, 20, 48.0, about=True), "260 of about 300 repetitions · 48 s"),
        (Progress(299, 300, 20, 48.0), "299 of 300 repetitions · 48 s"),
    ],
)
def test_the_time_left_is_said_only_where_it_is_known(clock, progress, text):
    now = display.time.monotonic()
    stage = display._Stage("repetitions", now, "repetitions", progress, heard=now + 46)
    clock(48)
    assert stage.text() == text


def test_a_stage_that_ctrl_c_ended_has_a_cross(clock):
    stream = Terminal()
    with shown(stream=stream) as observer:
        observer.stage("search")
        clock(3)
        observer.interrupted()
        observer.stage("")
    assert lines(stream) == ["✗ search · 3.0 s · interrupted"]


def test_a_stage_that_compiles_first_says_so(clock, monkeypatch):
    notes = []
    monkeypatch.setattr(display._Events, "update", lambda _, stage: notes.append(stage.text()))
    with shown(events=True, stream=io.StringIO()) as observer:
        observer.stage("search")
        logging.getLogger("fracid.compilation").warning("compiling")
    assert notes == ["search · compiling, once on this machine · 0 s"]
    assert logging.getLogger("fracid.compilation").filters == []


def test_a_notebook_shows_the_stages_below_the_cell_and_a_script_nothing(clock, monkeypatch):
    contents = []

    class Output:
        update = staticmethod(lambda bundle, raw: contents.append(bundle["text/plain"]))

    ipython = types.SimpleNamespace(get_ipython=lambda: types.SimpleNamespace(kernel=object()))
    shell = types.SimpleNamespace(display=lambda *_, **__: Output)
    assert unless_given(None) is SILENT
    monkeypatch.setitem(sys.modules, "IPython", ipython)
    monkeypatch.setitem(sys.modules, "IPython.display", shell)
    assert unless_given(own := Observer()) is own
    observer = unless_given(None)
    observer.stage("search")
    with observer.progress("evaluations") as tell:
        clock(2)
        tell(Progress(12, None, 0, 2.0))
    assert contents[-1] == "… search · 12 evaluations · 2 s"
    observer.stage("")
    assert contents[-1] == "✓ search · 12 evaluations · 2.0 s"


def test_ctrl_c_is_answered_at_once_on_a_terminal_and_what_heard_it_before_hears_it_again(monkeypatch):
    stream = io.StringIO()
    monkeypatch.setattr(stream, "isatty", lambda: True)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt), shown(stream=stream):
            signal.raise_signal(signal.SIGINT)
        assert "stopping after what is under way" in stream.getvalue()
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)
