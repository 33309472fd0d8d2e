"""The measurement behind docs/honesty.md: its parts do what they say, and every fault of the page is made."""

import re
from dataclasses import replace

import numpy as np
import pytest

from scripts import ROOT, module_of


@pytest.fixture(scope="module")
def script():
    """benchmarks/honesty.py, which is no package."""
    return module_of("benchmarks/honesty.py")


LEFT_OUT = {
    "other-unit",
    "stopped-short",
    "low-order",
    "ringing",
    "misfit",
    "missed",
    "tilted-axis",
    "clock-jump",
    "still",
    "counted-backwards",
    "dropout",
    "between",
}
"""No faults of a twin: of a search, of a scheme by itself, of physics that a model lacks and of what inputs do between
samples (benchmarks/claims.py has those), of a recording that is not fitted, does not move or loses its encoder, and of
clocks, which a twin in memory has none of."""


def test_every_fault_of_the_page_is_made(script):
    page = (ROOT / "docs" / "honesty.md").read_text(encoding="utf-8")
    assert set(re.findall(r"^\| `([a-z-]+)`", page, flags=re.M)) - LEFT_OUT == {f.code for f in script.FAULTS}


@pytest.mark.broad
def test_a_twin_without_a_fault_has_no_finding_and_its_orders_are_the_truth(script):
    said = script.ask(script.TWINS[0].problem(), ())
    assert said.findings == ()
    assert said.off < 2


@pytest.mark.broad
def test_a_fault_climbs_from_silence_to_being_said(script):
    late = next(f for f in script.FAULTS if f.what == "α read later than θ")
    row = script.climb(replace(late, ladder=(0.0, 1.0), gross=1.0, needs="drive"))
    assert row.first == (1,)
    assert row.silent < 2
    assert row.shown.code == "late"
    assert (row.gross, row.missed) == (1, ())


@pytest.mark.broad
def test_a_gross_fault_that_is_not_said_is_a_miss(script):
    late = next(f for f in script.FAULTS if f.what == "α read later than θ")
    row = script.climb(replace(late, code="blow-up", also=(), ladder=(0.0,), gross=0.0, needs="drive"))
    assert row.first == (None,)
    assert row.gross == len(row.missed) == 1


def test_play_follows_only_when_it_is_pushed(script):
    x = np.array([0.0, 1.0, 2.0, 1.5, 0.0, -2.0])
    assert script.with_play(x, 1.0).tolist() == [0.0, 0.5, 1.5, 1.5, 0.5, -1.5]
    assert script.with_play(x, 0.0).tolist() == x.tolist()
