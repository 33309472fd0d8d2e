"""Every result shows itself in eight lines, and in a notebook as a table that no text can break out of."""

import re
import sys
from contextlib import nullcontext
from dataclasses import dataclass, fields, is_dataclass, replace
from html.parser import HTMLParser

import numpy as np
import pytest

import fracid
from fracid import solve_fde
from fracid.cards import CELL, LENGTH, Card, CardDisplay
from fracid.estimation.cost_profile import CostAtBest, Profile, Profiles
from fracid.estimation.profile_walk import End
from fracid.estimation.records import Estimate, Estimates, OrderEstimate, RecordingFit
from fracid.fit import CostBlock, Fit, ModelBlock
from fracid.optimise import Outcome
from fracid.problem import Problem
from fracid.recording import Recording
from fracid.selection.comparison_records import Comparison, Row, Score
from fracid.tasks.display import counted
from fracid.tasks.progress import Observer
from twins import ORDERS, RIG, release

HOSTILE = "<script>alert('λ')</script>"
"""A name that a stranger's file may have."""
SMALL = 7
"""Fields that a record's own repr may show."""
TIME = np.arange(0, 2, 1e-2)
SWING = {"theta": 0.1 * np.cos(6 * TIME), "alpha": np.cos(6 * TIME)}


def problem():
    swing = release("twin", RIG, alpha=0.3, step=1e-2, end=1.0)
    return Problem(RIG, (swing,), ORDERS)


def fit():
    orders = {"lambda": OrderEstimate(0.9, free=True, interval95=(0.89, 0.91)), "mu": OrderEstimate(1.0)}
    recordings = {f"{HOSTILE} {k}": RecordingFit(f"{k}", "fit", TIME, SWING, SWING, 0.0, {}, {}) for k in range(20)}
    p = problem()
    return Fit(
        problem=p, x=np.zeros(0), model=ModelBlock(name=p.model.name, zero=p.model.zero, source=p.model.source),
        minimised=CostBlock(name="rmse", value=1e-3, outputs=list(p.outputs)), method=p.method, memory=p.memory.name,
        step=1e-2, substeps=1, orders=orders, recordings=recordings,
        parameters={"C1": Estimate(0.0043, "kg m^2", True)}, outcome=Outcome.CONVERGED, evaluations=9, seed=1,
        optimiser="multistart", warnings=(HOSTILE * 99,),
    )  # fmt: skip


def profile():
    values = np.linspace(0.8, 1.0, 5)
    return Profile(name=HOSTILE, unit="rad", best=0.9, values=values, rise=values, cost=values,
                   ends=(End.CROSSED, End.CROSSED), interval95=(0.85, None), wald95=(0.84, 0.96), verdict="two-sided",
                   sentence="two-sided")  # fmt: skip


def comparison():
    score = {HOSTILE: Score({"alpha": 0.01}, {"alpha": 95.0}, {"alpha": 0.1})}
    rows = tuple(Row("viscous", free, f"{HOSTILE} {k}", free, 1.0, 3, 0.0, {}, {}, (), score, {}, "")
                 for k in range(9) for free in (False, True))  # fmt: skip
    return Comparison(rows, HOSTILE, (HOSTILE,), ("alpha",), 9.0, False, "rmse", 1, 1)


def decay(t, x, u, p, out):
    out[0] = -x[0]


def trajectory():
    return solve_fde(decay, 0.8, [1.0], step=1e-2, end=1.0)


CARDS = {
    "fit": fit,
    "recording": lambda: Recording.of(HOSTILE, TIME, {f"{HOSTILE} {k}": SWING["alpha"] for k in range(20)}),
    "model": lambda: RIG,
    "problem": problem,
    "estimate": lambda: Estimate(0.9, "rad", True, interval95=(0.89, 0.91), identifiable=HOSTILE, reason=HOSTILE * 99),
    "trajectory": trajectory,
    "comparison": comparison,
    "profile": profile,
    "profiles": lambda: Profiles(
        at_best=CostAtBest(name="rmse", value=1.0),
        minimum={},
        threshold=3.84,
        profiles={f"{HOSTILE} {k}": profile() for k in range(20)},
    ),
}


class Tags(HTMLParser):
    """Which tags, and which attributes of them, a text has."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.names, self.words = set(), set(), ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        self.names |= {name for name, _ in attrs}

    def handle_data(self, data):
        self.words += data


@pytest.mark.parametrize("name", CARDS)
def test_a_result_shows_itself_in_eight_lines_of_at_most_a_thousand_characters(name):
    text = repr(CARDS[name]())
    assert text == str(CARDS[name]())
    assert 2 <= len(text.splitlines()) <= 8
    assert len(text) <= 1000


@pytest.mark.parametrize("name", CARDS)
def test_a_notebook_gets_a_table_without_scripts_whatever_the_names_are(name):
    html = Tags(table := CARDS[name]()._repr_html_())
    assert html.tags == {"table", "caption", "tr", "th", "td"}
    assert html.names == {"style"}
    assert name in ("model", "problem", "trajectory") or "<script>alert" in html.words  # as text
    colours = re.findall(r"color:([^;\"]+)", table)
    assert set(colours) == {"inherit"}  # the page's own, light or dark


def test_no_text_of_a_card_is_longer_than_its_cell_nor_hides_anything():
    card = Card("a\x1b[31m\u202e" * 900, (("what\n", "value " * 900),))
    assert all(len(line) <= LENGTH for line in card.text().splitlines())
    assert "\x1b" not in card.text() + card.html()
    assert max(map(len, re.findall(r">([^<]*)<", card.html()))) <= CELL


def test_a_fit_shows_its_orders_its_rmse_and_its_warnings():
    text = repr(fit())
    assert "λ = 0.900 ± 0.010, μ = 1 (fixed)" in text
    assert "C1 = 0.0043 kg m²" in text
    assert "1: <script>" in text
    assert "fit, RMSE of θ 0°, α 0°" in text
    assert "more rows" in text


RECORDS = {name: found for name in fracid.__all__ if is_dataclass(found := getattr(fracid, name))}


@pytest.mark.parametrize(
    "name", sorted(n for n, found in RECORDS.items() if n != "Parameter" and len(fields(found)) > SMALL)
)
def test_a_result_of_many_fields_has_a_card(name):
    assert issubclass(RECORDS[name], CardDisplay)
    assert RECORDS[name].__repr__ is CardDisplay.__repr__


def test_a_card_that_names_no_rows_has_the_fields_in_a_few_words():
    @dataclass(frozen=True, repr=False)
    class Study(CardDisplay):
        draws: np.ndarray
        level: float
        names: tuple[str, ...]
        nothing: None = None

    assert repr(Study(np.zeros((3, 1000)), 0.123456, ("a", "b"))).splitlines() == [
        "Study",
        "  draws    array of 3 × 1,000",
        "  level    0.1235",
        "  names    a, b",
        "  nothing  none",
    ]


def test_a_trajectory_shows_first_how_it_ended_and_what_is_wrong_with_it():
    ended = solve_fde(decay, 1.0, [1.0], step=3.0, end=9.0, method="gl")
    assert ended.fault is not None
    assert ended.fault.sentence[:40] in repr(ended)
    assert repr(ended).splitlines()[1].split() == ["outcome", *ended.outcome.value.split()]
    assert repr(trajectory()).splitlines()[0] == "Trajectory: completed"


def test_the_card_of_a_fit_has_the_sentence_of_its_claim():
    text = repr(replace(fit(), claim_reasons=("1 lies within the intervals.",)))
    assert re.search(r"claim +1 lies within the intervals\.", text)


def test_the_card_of_an_estimate_calls_its_verdict_a_verdict_and_writes_one_power_of_ten():
    text = repr(Estimate(1.3361e-4, "kg m^2", True, interval95=(1.327e-4, 1.3452e-4), identifiable="identifiable"))
    assert text.splitlines() == ["Estimate (1.3361 ± 0.0091)e-04 kg m²", "  verdict  identifiable"]


def test_a_fit_is_a_table_of_pandas_by_name_and_its_card_has_a_row_for_each_free_value():
    table = fit().table()
    assert table.loc["lambda", ["value", "half_width", "verdict"]].tolist() == [0.9, pytest.approx(0.01), "fixed"]
    assert table.loc["C1", "unit"] == "kg m^2"
    assert table["free"].tolist() == [True, False, True]
    assert "<td" in fit()._repr_html_().split("</table>")[1]
    assert "0.900 ± 0.010" in Tags(fit()._repr_html_()).words
    assert comparison().table()["rmse_deg"].tolist() == pytest.approx([np.degrees(0.01)] * 18)


def test_pandas_makes_a_row_of_each_estimate_and_a_series_of_them():
    pandas = pytest.importorskip("pandas")
    estimates = Estimates(fit().orders | fit().parameters)
    assert pandas.DataFrame(estimates).set_index("name").equals(fit().table().loc[list(estimates)])
    assert pandas.Series(estimates)["C1"] == estimates["C1"]


def test_without_pandas_a_table_is_a_list_of_records(monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    assert fit().table()[0] | {"half_width": None} == {
        "name": "lambda", "value": 0.9, "half_width": None, "low": 0.89, "high": 0.91, "unit": "", "verdict": "fixed",
        "free": True,
    }  # fmt: skip


def test_long_work_counts_below_the_cell_of_a_notebook_unless_progress_is_given(monkeypatch):
    heard = []

    class Told(Observer):
        def __init__(self):
            super().__init__(progress=lambda what: nullcontext(lambda p: heard.append((what, p))))

    monkeypatch.setattr("fracid.tasks.display.in_notebook", lambda: True)
    monkeypatch.setattr("fracid.tasks.display.unless_given", lambda _: Told())
    counted("steps")(lambda progress=None: progress(1))()
    counted("steps")(lambda progress=None: progress(2))(progress=lambda p: heard.append(p))
    assert heard == [("steps", 1), 2]
