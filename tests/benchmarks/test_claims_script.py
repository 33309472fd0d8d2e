"""The benchmark that attacks fracid's claims: what it reads out of results, and what it counts as wrong."""

import pytest

from scripts import module_of


@pytest.fixture(scope="module")
def claims():
    """benchmarks/claims.py, which is no package; it imports its neighbour."""
    return module_of("benchmarks/claims.py")


def rig(kind="play", claim="integer", *, fractional=False, determined=False):
    return {
        "kind": kind,
        "severity": 0.25,
        "fractional": fractional,
        "determined": determined,
        "claims": {"fit": claim},
    }


ORDER = {"free": True, "interval95": [0.9, 0.94]}


@pytest.mark.parametrize(
    ("result", "claim"),
    [
        ({"claim": "undecided", "alternative": None}, "undecided"),
        ({"alternative": {"warning": ""}, "orders": {"mu": ORDER}}, "fractional"),
        ({"alternative": {"warning": "The orders are no evidence."}, "orders": {"mu": ORDER}}, "integer"),
        ({"alternative": None, "orders": {"mu": ORDER | {"interval95": None}}}, "undecided"),
    ],
)
def test_the_claim_of_a_fit_is_its_own_or_what_its_sentences_say(claims, result, claim):
    assert claims.claim_of_fit(result) == claim


@pytest.mark.parametrize(
    ("verdict", "claim"),
    [
        ("Orders help on 2 of 2 held-out recordings, by 23 %: …", "fractional"),
        ("Orders help on 1 of 3 held-out recordings only, which is no evidence for them: …", "undecided"),
        ("Orders make no difference, an integer-order model predicts as well: …", "integer"),
        ("No structure predicts every held-out recording: their runs fail.", "undecided"),
    ],
)
def test_the_claim_of_a_comparison_is_what_its_verdict_begins_with(claims, verdict, claim):
    assert claims.claim_of_compare({"verdict": verdict}) == claim


def test_orders_are_determined_by_intervals_narrower_than_half_the_way_to_1(claims):
    assert claims.determined({"lambda": ORDER, "mu": ORDER}, {"lambda": 1.0, "mu": 0.9})
    assert not claims.determined({"lambda": ORDER, "mu": ORDER}, {"lambda": 0.95, "mu": 0.9})
    assert not claims.determined({"lambda": ORDER, "mu": ORDER}, {"lambda": 1.0, "mu": 1.0})


def test_one_false_claim_misses_the_bar_and_is_bold(claims):
    rigs = [rig(), rig(claim="fractional"), rig("orders", "fractional", fractional=True, determined=True)]
    assert [good for _, good in claims.bars(rigs, ("fit",))] == [False, True, True]
    assert [good for _, good in claims.bars(rigs[::2], ("fit",))] == [True, True, True]
    assert "**1**" in claims.table(rigs, ("fit",)).splitlines()[2]
    assert "**" not in claims.table(rigs[::2], ("fit",))


def test_an_unknown_kind_is_refused_with_those_there_are(claims):
    with pytest.raises(SystemExit, match="slack: expected integer, fractional or some of none, sticking"):
        claims.chosen(["slack"])
