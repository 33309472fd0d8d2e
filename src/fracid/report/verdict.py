"""The verdict at the top of the report: a line for each question that a reader asks of a fit."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

from fracid.optimise.base import Outcome
from fracid.report.material import Material
from fracid.report.sentences import counted, digits, half_width_of, joined, said, search_sentence, state_letter
from fracid.safety.door import own_text
from fracid.selection.claim import LACKS, NO_FIT
from fracid.selection.doubts import POOR, doubts
from fracid.selection.integer_rival import OFF
from fracid.units import letter, number
from fracid.validation.discretisation import COARSE_STEP
from fracid.validation.residual_records import ResidualAnalysis


class Line(NamedTuple):
    """One line of the verdict."""

    about: str
    sentence: str
    good: bool
    """Whether there is nothing to look at."""


# --- the claim ------------------------------------------------------------------------------------


def verdict(material: Material) -> tuple[Line, ...]:
    """The report's first screen: claim, fit, orders, prediction, values, checks."""
    lines = (_fit(material), _orders(material), _prediction(material), _values(material), _checks(material))
    return (_claim(material, lines), *lines)


CLAIMS: dict[str, str] = tomllib.loads(own_text("report/verdict.toml"))
"""What each claim means, in words; and what a fit that is none."""


def _claim(material: Material, lines: tuple[Line, ...]) -> Line:
    """What is claimed of the rig, in one sentence; in order only where nothing on the page contradicts it."""
    claim, against = material.result["claim"], contradictions(material, lines)
    shown = {n: e for n, e in material.result["orders"].items() if claim != "fractional" or not _holds_its_integer(e)}
    values = [f"{letter(n)} = {said(e)}" for n, e in shown.items()]
    orders = joined([re.sub(" (?!=)", "\N{NO-BREAK SPACE}", value) for value in values])
    inside = {letter(n): e["integer"] for n, e in material.result["orders"].items() if _holds_its_integer(e)}
    if claim == "fractional" and inside:
        orders += f" ({_inside(list(inside), inside)})"
    reason = f"a model of integer order fits as well as {orders}" if _stand_in(material.result) else orders
    doubt = f", but {joined([f'{clause} (see {name})' for name, clause in against.items()])}" if against else ""
    means = CLAIMS["no-fit" if does_not_fit(material.result["claim_codes"]) else claim]
    return Line("Claim", f"{': '.join(filter(None, (means, reason)))}{doubt}.", claim != "undecided" and not against)


def _holds_its_integer(e: Mapping[str, Any]) -> bool:
    """Whether an order's interval includes its integer value."""
    integer, ends = e["integer"], e["interval95"]
    return bool(e["free"] and ends) and integer is not None and bool(ends[0] <= integer <= ends[1])


def does_not_fit(codes: Iterable[str]) -> bool:
    """Whether the model does not follow what it was fitted to, by the codes of its claim."""
    return not NO_FIT.isdisjoint(codes)


def _stand_in(result: Mapping[str, Any]) -> bool:
    """Whether nothing but the integer-order alternative speaks against orders that are off their integer values."""
    known = (e for e in result["orders"].values() if e["free"] and e["interval95"])
    off = any(e["integer"] is not None and not _holds_its_integer(e) for e in known)
    return result["claim"] == "integer" and off and bool(result["alternative"])


def contradictions(material: Material, lines: tuple[Line, ...]) -> dict[str, str]:
    """What on the page speaks against the claim: that of the result, and of what was looked at since."""
    result, compared = material.result, material.beside("compare.json")
    against = doubts(result)
    if result["claim"] == "fractional" and not all(line.good for line in lines if line.about == "Checks"):
        against.setdefault("Checks", "a check speaks against it")
    if result["claim"] != "undecided" and (other := compared.get("claim") or result["claim"]) != result["claim"]:
        against["Ladder"] = f"the comparison says {other}"
    return against


# --- the other five ------------------------------------------------------------------------------


def _fit(material: Material) -> Line:
    recordings, failed, percents, poor = _followed(material, "fit")
    what = "the recording" if len(recordings) == 1 else f"{len(recordings)} recordings"
    if failed:
        return Line("Fit", "No run of the model reached the end of a recording: no result is usable.", False)
    misfit = [_of_recording(where) for where in _found(material, "misfit")]
    hardly = "no" if not percents or min(percents) <= 0 else "hardly"
    doubt = f" For one of them that is {hardly} better than a constant." if poor and percents else ""
    doubt += f" The residual of {joined(misfit)} is more than noise." if misfit else ""
    lost = does_not_fit(material.result["claim_codes"])
    follows = f"does not follow {what}: it is off by" if lost else f"follows {what} to"
    sentence = f"The model {follows} {_errors(material, recordings)} rms{_fits(percents)}.{doubt}"
    return Line("Fit", sentence, not poor and not misfit and not lost)


def _followed(material: Material, use: str) -> tuple[dict[str, Any], list[str], list[float], bool]:
    """The recordings of a use, those whose run failed, each fit [%], and whether one is poor."""
    recordings = material.used(use)
    failed = [n for n, r in recordings.items() if None in r["rmse"].values()]
    percents = [v for r in recordings.values() for v in r["fit_percent"].values() if v is not None]
    return recordings, failed, percents, not percents or min(percents) < POOR


def _found(material: Material, code: str) -> list[str]:
    """Where a finding was made."""
    return [f["where"] for f in material.result["findings"] if f["code"] == code]


def _of_recording(where: str) -> str:
    """``θ of release 92°`` for ``release 92°: theta``."""
    recording, _, output = where.rpartition(": ")
    return f"{letter(output)} of {recording}"


def _fits(percents: list[float]) -> str:
    """``, a fit of 86 to 98 %``."""
    ends = dict.fromkeys((number(min(percents), ".3g"), number(max(percents), ".3g"))) if percents else ()
    return f", a fit of {' to '.join(ends)} %" if ends else ""


def _errors(material: Material, recordings: Mapping[str, Any]) -> str:
    """``0.22° (θ) and 0.21° (α)``, over recordings the worst."""
    outputs = dict.fromkeys(n for r in recordings.values() for n in r["rmse"])
    worst = {n: max(r["rmse"].get(n, 0.0) for r in recordings.values()) for n in outputs}
    errors = [f"{material.shown(n, v)} ({letter(n)})" for n, v in worst.items()]
    return f"{joined(errors)}{' at worst' if len(recordings) > 1 else ''}"


def _orders(material: Material) -> Line:
    orders, rival = material.result["orders"], material.result["alternative"]
    told = {n: said(e) if half_width_of(e) is not None else digits(e) for n, e in orders.items()}
    sentence = joined([f"{letter(n)} = {text}" for n, text in told.items()] or ["The model has none"]) + "."
    if not (free := {n: e for n, e in orders.items() if e["free"]}):
        return Line("Orders", f"{sentence}{' They were given, not found.' * bool(orders)}", True)
    if does_not_fit(material.result["claim_codes"]):
        return Line("Orders", f"{sentence} The model does not fit: they mean nothing.", False)
    if rival and rival["warning"]:
        return Line("Orders", f"{sentence} They stand in for something of integer order, see above.", False)
    if rival:
        needed = material.result["claim"] == "fractional"
        return Line("Orders", f"{sentence} {_against_integers(material, rival)}", needed)
    return Line("Orders", *_on_their_own(sentence, free, said_above=bool(material.result["claim_reasons"])))


def _on_their_own(sentence: str, free: Mapping[str, Any], *, said_above: bool) -> tuple[str, bool]:
    """What intervals alone say of the orders, and whether there is nothing to look at.

    That an interval includes the integer is left to the reasons of the claim, where there are any.
    """
    found: dict[str, dict[str, float]] = {}
    for n, e in free.items():
        found.setdefault(where(e), {})[letter(n)] = e["integer"]
    unknown, off, inside, without = ([*found.get(place, ())] for place in ("unknown", "off", "inside", "without"))
    says = [sentence]
    if unknown:
        says.append(f"{joined(unknown)} {_is(unknown)} not identifiable.")
    if off:
        values = joined([*dict.fromkeys(map(number, found["off"].values()))], "or")
        says.append(f"{joined(off)} {_is(off)} off {values}; no integer-order alternative was tried.")
    elif inside and not said_above:
        says.append(f"{_inside(inside, found['inside'])}: there is no evidence of fractional dynamics.")
    if without:
        none = joined(without, "or")
        says.append(f"The model gives {none} no integer value, so it has no integer-order alternative.")
    return " ".join(says), not unknown and not off


def where(e: Mapping[str, Any]) -> str:
    """Where a free order lies by its interval: what is off by next to nothing is neither inside nor off."""
    integer, ends = e["integer"], e["identifiable"] == "identifiable" and e["interval95"]
    if not ends or integer is None:
        return "without" if ends else "unknown"
    return "inside" if _holds_its_integer(e) else "off" if abs(sum(ends) / 2 - integer) > OFF else "near"


def _inside(names: list[str], integer: Mapping[str, float]) -> str:
    """``1 lies in the intervals of λ and μ``, ``0 lies in the interval of r``."""
    values = {integer[n] for n in names}
    if len(values) > 1:
        return f"{joined(names)} have their integer values in their intervals"
    return f"{number(values.pop())} lies in the {'interval' if len(names) == 1 else 'intervals'} of {joined(names)}"


def _is(names: list[str]) -> str:
    return "is" if len(names) == 1 else "are"


def _against_integers(material: Material, rival: Mapping[str, Any]) -> str:
    cost, own = rival["cost"], material.result["cost"]["value"]
    orders, *more = rival["structure"].split("; ")
    others = f"the nearest integer-order model ({orders} and more, see Checks)" if more else orders
    times = f"the cost is {number(cost / own, '.3g')} times as large" if cost and own else "no run ends"
    gain = counted(rival["bic_gain_of_the_fractional_model"])
    if material.result["claim"] == "undecided":  # the model may lack something that both of them need
        return f"With {others}, {times} (ΔBIC = {gain}); the claim gives the reason why that is not decisive."
    return f"The data favour fractional orders: with {others}, {times} (ΔBIC = {gain})."


def _prediction(material: Material) -> Line:
    validation, failed, percents, poor = _followed(material, "validate")
    if not validation:
        return Line("Prediction", 'Not tested: no recording was held out. Mark one with use = "validate".', False)
    if failed:
        return Line("Prediction", f"No run reached the end of {joined(failed)}, which was held out.", False)
    what, was = (next(iter(validation)), "was") if len(validation) == 1 else (f"{len(validation)} recordings", "were")
    predicts, to = ("does not predict", ": it is off by") if poor else ("predicts", ", to")
    errors = f"{to} {_errors(material, validation)} rms{_fits(percents)}"
    sentence, missed = f"It {predicts} {what}, which {was} held out{errors}", _found(material, "missed")
    doubt = "; for one signal that is hardly better than a constant" if poor else ""
    doubt += f"; it misses {joined(missed)}" if missed else ""
    structured = _structured(material, "validate")
    names = [f"{letter(a.output)}{f' of {a.recording}' * (len(validation) > 1)}" for a in structured]
    rest = f" The residual of {joined(names)} is correlated: it is not noise alone." if names else ""
    return Line("Prediction", f"{sentence}{doubt}.{rest}", not poor and not missed and not structured)


def _values(material: Material) -> Line:
    kinds, held_out = (dict(_free_kinds(material, use)) for use in ("fit", "validate"))
    moved = [letter(n) for n in moved_by_the_step(material.result)]
    sentence, all_known = _identifiable(kinds, "free values")
    if "unknown" in kinds.values():
        sentence = f"Of the {len(kinds)} free values there are no intervals"
    if moved:
        its = "its interval" if len(moved) == 1 else "their intervals"
        sentence += f", but the step moves {joined(moved)} by more than {its}"
    own = [_identifiable(held_out, "values that held-out recordings have for themselves")[0]] if held_out else []
    return Line("Values", " ".join((f"{'. '.join((sentence, *own))}.", *_forgotten(material))), all_known and not moved)


def _identifiable(kinds: Mapping[str, str], what: str) -> tuple[str, bool]:
    """How many are identifiable and which are not, and whether all are."""
    unknown = [name for name, kind in kinds.items() if kind != "identifiable"]
    known = len(kinds) - len(unknown)
    rest = f"; {_few(unknown)} {_is(unknown)} not" if unknown else ""
    return f"{known} of {len(kinds)} {what} {'is' if known == 1 else 'are'} identifiable{rest}", not unknown


def moved_by_the_step(result: Mapping[str, Any]) -> dict[str, float]:
    """Orders that half the step moves by more than their interval → by how much."""
    check = result.get("discretisation") or {}
    if not check.get("warning"):
        return {}
    halves = {n: half_width_of(result["orders"].get(n, {"interval95": None})) for n in check["shift"]}
    return {n: shift for n, shift in check["shift"].items() if (half := halves[n]) is not None and abs(shift) > half}


NAMED = 8
"""Values that a sentence has room for."""


def _few(names: list[str]) -> str:
    return joined(names if len(names) <= NAMED else [*names[: NAMED - 1], f"{len(names) - NAMED + 1} more"])


def _forgotten(material: Material) -> Iterator[str]:
    """How many rows of the tables no count includes: where a presliding joint began, which its slide erases."""
    rows = [e for r in material.result["recordings"].values() for e in r["initial_state"].values() if e["free"]]
    if count := sum(e["identifiable"] == "forgotten" for e in rows):
        yield f"Not counted: {count} initial {'value' if count == 1 else 'values'} of presliding joints."


def _free_kinds(material: Material, use: str) -> Iterator[tuple[str, str]]:
    """Each free value by name → its verdict; those that a recording has for itself with its name, where there are more.

    Orders and constants, which recordings share, are among those of ``fit``.
    """
    recordings = material.used(use)
    for block in ("orders", "parameters") if use == "fit" else ():
        yield from ((letter(n), e["identifiable"]) for n, e in material.result[block].items() if e["free"])
    for recording, r in recordings.items():
        of = f" of {recording}" if len(recordings) > 1 else ""
        own = {**r["parameters"], **{f"{state_letter(n)} at the start": e for n, e in r["initial_state"].items()}}
        yield from ((f"{letter(n)}{of}", e["identifiable"]) for n, e in own.items()
                    if e["free"] and e["identifiable"] != "forgotten")  # fmt: skip


def _checks(material: Material) -> Line:
    outcome = material.result["outcome"]
    findings = [(search_sentence(outcome), outcome == Outcome.CONVERGED), *_step(material), *_left_over(material)]
    return Line("Checks", " ".join(sentence for sentence, _ in findings), all(good for _, good in findings))


def _step(material: Material) -> Iterator[tuple[str, bool]]:
    if (check := material.result["discretisation"]) is None:
        yield "What the step does was not checked.", False
    elif check["warning"] and COARSE_STEP in material.result["claim_codes"]:
        moved = [f"{letter(n)} by {number(s, '.2g')}" for n, s in moved_by_the_step(material.result).items()]
        what = f"moves {joined(moved)}" if moved else "changes the result"
        yield f"Half the step {what}: the claim and the check of the step say more.", False
    elif check["warning"]:
        yield " ".join(filter(None, (check.get("refinement"), check["warning"]))), False
    elif check["shift"]:
        most = max(map(abs, check["shift"].values()))
        yield f"Solved at half the step, no order moves by more than {number(most, '.1g')}.", True


def _left_over(material: Material) -> Iterator[tuple[str, bool]]:
    if structured := _structured(material, "fit"):
        worst = max(structured, key=lambda a: a.whiteness.correlation_time)
        time = number(worst.whiteness.correlation_time, ".2g")
        shaken = "shaken" in (codes := material.result["claim_codes"]) and not LACKS.intersection(codes)
        why = "the noise of a recorded input explains that" if shaken else "it is not noise alone"
        yield f"The residual of {letter(worst.output)} is correlated over {time} s: {why}.", shaken
    elif tested := _tested(material, "fit"):
        white = all(a.whiteness.white for a in tested)
        yield f"The residuals are {'white noise' if white else 'noise and rounding'}.", True


def _tested(material: Material, use: str) -> list[ResidualAnalysis]:
    """The residuals of the recordings of one use that were long enough to be tested."""
    analyses = (a for outputs in material.residuals.values() for a in outputs.values())
    return [a for a in analyses if a.use == use and a.whiteness.thinning]


def _structured(material: Material, use: str) -> list[ResidualAnalysis]:
    """Those that are neither white noise nor the encoder's rounding."""
    return [a for a in _tested(material, use) if not (a.whiteness.white or a.level.rounding)]
