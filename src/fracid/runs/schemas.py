"""The schemas of the files in a run folder: what each may contain."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

from fracid.safety.schema import Names, Pair, Shape, Word, short_text

__all__ = [
    "AMPLITUDE",
    "COMPARISON",
    "ENVIRONMENT",
    "FIT_OPTIONS",
    "PROFILES",
    "RESULT",
    "RUN",
    "STUDY",
    "end",
    "fault_of_comparison",
    "fault_of_profiles",
    "fault_of_study",
    "fitted_structure",
    "repetition",
]


# --- the files of a run folder -----------------------------------------------------------------------

NUMBER = (float, None)
"""What is not finite is written as null."""

INTERVAL = (Pair(float), None)

ESTIMATE = {
    "value": NUMBER, "unit?": str, "free": bool, "standard_error?": NUMBER, "interval95": INTERVAL,
    "white95?": INTERVAL, "at_bound?": bool, "identifiable": str, "reason?": str,
    "interval_method?": (str, None), "integer?": NUMBER,
}  # fmt: skip

RECORDING = {
    "use": Word("fit|validate"), "samples": int, "from": float, "to": float, "cost": NUMBER, "rmse": Names(NUMBER),
    "fit_percent": Names(NUMBER), "initial_state": Names(ESTIMATE), "parameters": Names(ESTIMATE),
}  # fmt: skip

DISCRETISATION = {
    "cost": NUMBER, "cost_half_step": NUMBER, "cost_second_order": NUMBER, "orders": Names(NUMBER),
    "shift": Names(NUMBER), "warning": str,
}  # fmt: skip

ALTERNATIVE = {
    "structure": str, "cost": NUMBER, "parameters": Names(NUMBER), "bic_gain_of_the_fractional_model": NUMBER,
    "effective_samples": NUMBER, "warning": str,
}  # fmt: skip

ORIGIN = Word("given|regression|Sobol [0-9]{1,9}")

START = {
    "origin": ORIGIN, "start": Names(NUMBER), "cost_on_first_swing": NUMBER, "end": Names(NUMBER), "cost": NUMBER,
    "ended": str, "joined": (ORIGIN, None), "evaluations": int,
}  # fmt: skip

SPREAD = {
    "recordings": [str], "sentences": [str],
    "unknowns": Names({"values": [NUMBER], "standard_errors": [NUMBER], "standard_deviation": NUMBER, "birge": NUMBER}),
}  # fmt: skip

TREATMENT = {
    "orders": Names(float), "shift": Names(float), "cost": float, "rmse": Names(float), "still_moving": bool,
}  # fmt: skip

CUT = {
    "as_fitted": {"orders": Names(float), "cost": float, "rmse": Names(float)}, "half_width": Names(NUMBER),
    "treatments": Names(TREATMENT), "left_out": Names(str), "rivals": [str], "range": Names(Pair(float)),
    "warnings": [str],
}  # fmt: skip

FINDING = {"code": str, "where": str, "number": NUMBER, "limit": NUMBER, "unit": str, "sentence": str}

RESULT = {
    "model": {"name": str, "zero": str, "source": str}, "method": str, "memory": str, "step": float,
    "orders": Names(ESTIMATE), "parameters": Names(ESTIMATE), "recordings": Names(RECORDING),
    "cost": {"name": str, "value": NUMBER, "outputs": [str]}, "discretisation?": (DISCRETISATION, None),
    "evaluations": int, "optimiser": str, "outcome": str, "alternative?": (ALTERNATIVE, None), "starts?": [START],
    "start_that_won?": (str, None), "spread?": (SPREAD, None), "cut?": (CUT, None), "interval_methods?": Names(str),
    "warnings": [str], "findings?": [FINDING], "seed": (int, None), "preset?": (str, None), "data_sha256": Names(str),
    "versions": Names(str), "timing?": Names(float),
}  # fmt: skip
"""result.json."""

RUN = {"kind": str, "options": dict, "inputs": Names(str), "finished": bool}
"""run.json."""

FIT_OPTIONS = {
    "project": str, "preset": (str, None), "optimiser": (str, None), "seed": (int, None), "starts": (int, None),
    "cut": bool, "executor": (str, None),
}  # fmt: skip
"""The options of a fit in it."""

ENVIRONMENT = {"versions?": Names(str), "platform?": str, "processor?": str, "command?": [str], "directory?": str}
"""environment.json."""

PROFILE = {
    "value": float, "unit": str, "interval95": Pair(NUMBER), "wald95": INTERVAL, "values": [float], "rise": [NUMBER],
    "cost": [NUMBER], "verdict": str, "sentence": str, "ends": Pair(str),
}  # fmt: skip

JOINT = {
    "names": Pair(str), "units": Pair(str), "best": Pair(float), "first": [float], "second": [float],
    "rise": [[NUMBER]], "correlation": NUMBER, "threshold": float,
}  # fmt: skip

PROFILES = {
    "cost": {"name": str, "value": float}, "minimum": Names(float), "threshold": float, "profiles": Names(PROFILE),
    "joint?": (JOINT, None), "notes": [str],
}  # fmt: skip
"""profiles.json."""

SCORE = {"rmse": Names(NUMBER), "fit_percent": Names(NUMBER), "itae": Names(NUMBER), "failed": str}

STRUCTURE = {
    "name": str, "friction": str, "fractional": bool, "paper": bool, "cost": NUMBER, "parameters": int,
    "bic_above_best": NUMBER, "orders": Names({"value": float, "interval95": INTERVAL}), "values": Names(float),
    "at_bound": [str], "outcome": str, "in_sample": Names(SCORE), "held_out": Names(SCORE),
}  # fmt: skip

WINDOW = {
    "recording": str, "from": float, "to": float, "whole": bool, "amplitude": Names(float), "orders": Names(float),
    "standard_errors": Names(NUMBER),
}  # fmt: skip

COMPARISON = {
    "verdict": str, "notes": [str], "outputs": [str], "leave_one_out": bool, "cost": str, "effective_samples": NUMBER,
    "best": Names(str), "structures": [STRUCTURE], "seed": int, "starts": int, "data_sha256?": Names(str),
    "amplitude": Names({"windows": [WINDOW], "notes": [str]}),
}  # fmt: skip
"""compare.json."""

STATISTICS = {
    "unit": str, "truth": float, "estimates": int, "bias": NUMBER, "spread": NUMBER, "claimed": NUMBER,
    "intervals": int, "held": int,
}  # fmt: skip

CELL = {
    "level": float, "resolution": float, "repetitions": int, "failures": Names(int), "stopped_short": int,
    "evaluations": float, "fractional": (int, None), "unit?": str, "unknowns": Names(STATISTICS),
}  # fmt: skip

STUDY = {"truth": Names(float), "cost": str, "optimiser": str, "seeds": int, "cells": [CELL]}
"""noise.json."""


def repetition(names: Iterable[str]) -> Shape:
    """The result of a repetition of a study of noise with these unknowns, as its journal has it.

    Examples
    --------
    >>> from fracid.safety.schema import fault_of
    >>> fault_of({"evaluations": 3, "cost_of_truth": 0.1, "failure": "", "cost": 0.1, "values": {}}, repetition(["mu"]))
    'values has no mu'
    """
    names = tuple(names)
    begun = {"evaluations": int, "cost_of_truth": NUMBER}
    found = {"values": dict.fromkeys(names, float), "standard_errors": dict.fromkeys(names, NUMBER),
             "intervals": dict.fromkeys(names, INTERVAL), "fractional": (bool, None)}  # fmt: skip
    return begun | {"failure": Word(""), "cost": float} | found, begun | {"failure": str, "cost": None}


def fitted_structure(outputs: Iterable[str]) -> Shape:
    """The fit of a structure, as the journal of a comparison has it."""
    of_each = dict.fromkeys(outputs, NUMBER)
    score = {"rmse": of_each, "fit_percent": of_each, "itae": of_each, "failed": str}
    return {
        "values": Names(float), "cost": NUMBER, "squares": NUMBER, "samples": float, "parameters": int,
        "at_bound": [str], "orders": Names(INTERVAL), "in_sample": Names(score), "held_out": Names(score),
        "outcome": str,
    }  # fmt: skip


AMPLITUDE = {"windows": [WINDOW], "notes": [str]}
"""An amplitude test, as the journal of a comparison has it."""


def end(unknowns: int, outcomes: Iterable[str]) -> Shape:
    """A start of a search with so many unknowns, as its journal has it."""
    return {
        "first_cost": NUMBER, "end": Pair(float, unknowns), "cost": NUMBER, "ended": str, "evaluations": int,
        "outcome": Word("|".join(map(re.escape, outcomes))),
    }  # fmt: skip


def fault_of_comparison(said: Mapping[str, Any]) -> str:
    """What does not fit together in a compare.json of the right shape, in words.

    Examples
    --------
    >>> fault_of_comparison({"structures": []})
    'it has no structure'
    """
    if not said["structures"]:
        return "it has no structure"
    first, names = said["structures"][0], {s["name"] for s in said["structures"]}
    for s in said["structures"]:
        for use in ("in_sample", "held_out"):
            if set(s[use]) != set(first[use]):
                return f"the recordings of {short_text(s['name'])} are others"
            if any(set(score[kind]) != set(said["outputs"]) for score in s[use].values()
                   for kind in ("rmse", "fit_percent", "itae")):  # fmt: skip
                return f"the outputs of {short_text(s['name'])} are others"
    if {s["fractional"] for s in said["structures"]} != {False, True} or not set(said["best"].values()) <= names:
        return "its best structures are not among them"
    return ""


def fault_of_profiles(said: Mapping[str, Any]) -> str:
    """The same of a profiles.json.

    Examples
    --------
    >>> fault_of_profiles({"profiles": {"mu": {"values": [1.0], "rise": [], "cost": [0.1]}}})
    'the profile of mu has lists of different lengths'
    """
    for name, p in said["profiles"].items():
        if not 0 < len(p["values"]) == len(p["rise"]) == len(p["cost"]):
            return f"the profile of {short_text(name)} has lists of different lengths"
    joint = said.get("joint")
    if joint and [len(joint["second"])] * len(joint["first"]) != [len(row) for row in joint["rise"]]:
        return "its joint profile has lists of different lengths"
    return ""


def fault_of_study(said: Mapping[str, Any]) -> str:
    """The same of a noise.json.

    Examples
    --------
    >>> fault_of_study({"truth": {"mu": 0.9}, "cells": [{"unknowns": {}}]})
    'the unknowns of its cells are others'
    """
    if not said["cells"]:
        return "it has no cell"
    if any(set(cell["unknowns"]) != set(said["truth"]) for cell in said["cells"]):
        return "the unknowns of its cells are others"
    counts = (u for cell in said["cells"] for u in cell["unknowns"].values())
    return (
        "" if all(0 <= u["held"] <= u["intervals"] <= u["estimates"] for u in counts) else "its counts are not possible"
    )
