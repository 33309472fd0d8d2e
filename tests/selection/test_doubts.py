"""What speaks against a claim is one list for terminal, page and cards."""

import pytest

from fracid.optimise import Outcome
from fracid.selection.doubts import claimed, doubts

ORDER = {"value": 1.0, "free": True, "identifiable": "identifiable", "interval95": [0.9, 1.1]}
RECORDING = {"use": "fit", "fit_percent": {"alpha": 98.0}}
RESULT = {
    "claim": "integer", "orders": {"mu": ORDER}, "outcome": Outcome.CONVERGED, "recordings": {"a": RECORDING},
    "findings": [], "discretisation": {"warning": ""}, "spread": None, "cut": None, "alternative": None,
}  # fmt: skip

AGAINST = {
    "Fit": {"findings": [{"code": "misfit"}]},
    "Orders": {"orders": {"mu": ORDER | {"identifiable": "practically not"}}},
    "Prediction": {"recordings": {"a": RECORDING, "b": {"use": "validate", "fit_percent": {"alpha": 12.0}}}},
    "Checks": {"outcome": Outcome.BUDGET_SPENT},
    "Each recording alone": {"spread": {"sentences": ["mu differs."]}},
    "Data": {"recordings": {"a": RECORDING | {"initial_state": {"D^mu alpha": {"interval95": [0.1, 0.3]}}}}},
    "Where the record begins": {"cut": {"warnings": ["mu moves."]}},
}


@pytest.mark.parametrize("heading", AGAINST)
def test_each_doubt_stands_under_the_heading_that_tells_more_of_it(heading):
    assert list(doubts(RESULT | AGAINST[heading])) == [heading]
    assert doubts(RESULT | AGAINST[heading] | {"claim": "undecided"}) == {}


def test_nothing_speaks_against_a_claim_that_is_in_order():
    assert claimed("integer", doubts(RESULT)) == "integer"


def test_a_speed_that_may_be_zero_by_chance_is_no_motion():
    nearly = {"a": RECORDING | {"initial_state": {"D^mu alpha": {"interval95": [0.01, 0.3]}}}}
    assert doubts(RESULT | {"recordings": nearly}) == {}


def test_an_order_that_no_recording_tells_is_named():
    assert doubts(RESULT | AGAINST["Orders"]) == {"Orders": "μ is not identifiable"}
