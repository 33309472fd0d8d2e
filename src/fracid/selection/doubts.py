"""What speaks against a claim, in clauses: one list for terminal, page and cards, so that no two of them disagree.

A claim of integer orders says that nothing here is fractional.  Beside a model that lacks something it stands on weaker
legs, and whoever reads it first has to read that with it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import zip_longest
from typing import Any

import numpy as np

from fracid.findings import Note
from fracid.optimise.base import Outcome
from fracid.selection.claim import LACKS
from fracid.units import letter

POOR = 20.0
"""A fit of less than this [%] explains next to nothing."""


LACKING = "the model lacks something"

SURELY = 2.0
"""Half-widths of its interval that a speed is from zero: one of many misses it by chance."""


def doubts(result: Mapping[str, Any]) -> dict[str, str]:
    """Heading of the report → what stands there against the claim, in a clause; nothing where none is made.

    Parameters
    ----------
    result : mapping
        The content of ``result.json``.

    Examples
    --------
    >>> result = {"claim": "integer", "orders": {}, "recordings": {}, "outcome": Outcome.CONVERGED}
    >>> doubts(result), doubts(result | {"findings": [{"code": "misfit"}]})
    ({}, {'Fit': 'the model lacks something'})
    """
    return {} if result["claim"] == "undecided" else dict(_against(result))


def claimed(claim: str, against: Mapping[str, str]) -> str:
    """The claim in a word, with what speaks against it.

    Examples
    --------
    >>> claimed("integer", {}), claimed("integer", {"Fit": "the model lacks something", "Orders": "μ is not known"})
    ('integer', 'integer, but the model lacks something, and μ is not known')
    """
    return f"{claim}, but {', and '.join(against.values())}" if against else claim


def unsaid(result: Mapping[str, Any]) -> list[Note]:
    """The warnings that the claim's reasons have not said already: of residuals that are no noise.

    Examples
    --------
    >>> said = {"warnings": ["swing: alpha: The residual is large.", "C1 lies at its bound."]}
    >>> unsaid(said | {"warning_codes": ["misfit", "verdict"], "claim_codes": ["unexplained"]})
    ['C1 lies at its bound.']
    """
    said = set() if LACKS.isdisjoint(result.get("claim_codes", ())) else {"misfit"}
    pairs = zip_longest(result["warnings"], result.get("warning_codes", ()), fillvalue="")  # none of an older version
    return [Note(warning, code) for warning, code in pairs if code not in said]


def _against(result: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    codes = {f["code"] for f in result.get("findings", ())}
    scores = {use: [v for r in result["recordings"].values() if r["use"] == use for v in r["fit_percent"].values()]
              for use in ("fit", "validate")}  # fmt: skip
    if _poor(scores["fit"]):
        yield "Fit", "the model hardly fits"
    elif codes & {"misfit", "cannot-explain"}:
        yield "Fit", LACKING
    if result["claim"] == "integer" and not result.get("alternative") and (unknown := _unknown(result)):
        yield "Orders", f"{' and '.join(unknown)} {'is' if len(unknown) == 1 else 'are'} not identifiable"
    if "missed" in codes or _poor(scores["validate"]):
        yield "Prediction", "it does not predict what was held out"
    if result["outcome"] != Outcome.CONVERGED:
        yield "Checks", "the search did not converge"
    elif (result.get("discretisation") or {}).get("warning"):
        yield "Checks", "the step bends the orders"
    if (result.get("spread") or {}).get("sentences"):
        yield "Each recording alone", "the recordings disagree"
    if result.get("cut") is not None:
        if result["cut"]["warnings"]:
            yield "Where the record begins", "the orders move with where the record begins"
    elif moving := in_motion(result):
        yield "Data", f"{' and '.join(moving)} {'begins' if len(moving) == 1 else 'begin'} in motion"


def in_motion(result: Mapping[str, Any]) -> list[str]:
    """The fitted recordings whose speed at the start is surely not zero: a memory has a past that nobody recorded.

    Examples
    --------
    >>> start = {"D^mu alpha": {"value": 1.0, "interval95": [0.8, 1.2]}}
    >>> in_motion({"recordings": {"swing": {"use": "fit", "initial_state": start}}})
    ['swing']
    """
    return [name for name, r in result["recordings"].items() if r["use"] == "fit" and any(
        n.startswith("D^") and e["interval95"] and abs(sum(e["interval95"])) > SURELY * float(np.ptp(e["interval95"]))
        for n, e in r.get("initial_state", {}).items())]  # fmt: skip


def _poor(percents: list[float | None]) -> bool:
    """Whether some output of some recording is hardly followed, or not at all."""
    return any(v is None or v < POOR for v in percents)


def _unknown(result: Mapping[str, Any]) -> list[str]:
    """The free orders that no interval is known of."""
    free = {n: e for n, e in result["orders"].items() if e["free"]}
    return [letter(n) for n, e in free.items() if e["identifiable"] != "identifiable" or not e["interval95"]]
