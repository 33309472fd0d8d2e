"""The page of a study: what compare, control, design, posterior, profile or noise found, from the record that it wrote.

One template for all: the answer first, figures, numbers, how to reproduce it.  :data:`STUDIES` says of each file what
its page takes from it; of a comparison the curves of every structure can be chosen.
"""

from __future__ import annotations

import base64
import json
import shlex
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup

from fracid.errors import writing
from fracid.estimation.cost_profile import Profiles
from fracid.estimation.likelihood_record import Likelihood
from fracid.experiments.plan import Plan, narrower
from fracid.report.charts import Axis
from fracid.report.drawing import drawn
from fracid.report.frame import rendered
from fracid.report.samples import base64_floats
from fracid.report.sentences import counted, in_unit, interval, joined
from fracid.runs.saved import SavedRun
from fracid.safety.door import bytes_of, own_text, text_of, write_files
from fracid.safety.json_files import plain
from fracid.safety.schema import Block, Record, fault_of, read_as, read_if_whole
from fracid.schemas.draws import PosteriorBlock
from fracid.schemas.feedback import ControlRecord, margin_text
from fracid.schemas.run_record import EnvironmentBlock
from fracid.selection.comparison_records import Comparison, CurvesBlock, held_out_errors
from fracid.units import half_of, letter, number, shown_unit, to_second_digit, typeset_unit, with_unit
from fracid.validation.monte_carlo import ENOUGH, NoiseStudy
from fracid.validation.study_records import label_of

ENVIRONMENT = "environment.json"

LARGEST_FIGURE = 2**19
"""Of a drawing on a page [bytes]; of a larger one its pixels are shown."""

LADDER_WIDTH = 150
"""Of the errors of a structure, drawn in its row [px]."""


@dataclass(frozen=True)
class Found:
    """What a record says, in the words of its page."""

    answer: str
    good: bool = True
    claim: str = ""
    model: str = ""
    rmse: str = ""
    said: tuple[str, ...] = ()
    facts: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    values: Mapping[str, list[dict[str, Any]]] = field(default_factory=dict)
    """Caption → estimates."""
    tables: Mapping[str, list[dict[str, str]]] = field(default_factory=dict)
    """Caption → rows, heading → cell."""


class Study(NamedTuple):
    """What the page of a file is made of."""

    record: type[Block | Record]
    found: Callable[[Mapping[str, Any]], Found]
    heading: str
    command: str
    figures: Mapping[str, str]
    """File names without their ending, * for any text → captions."""
    texts: Sequence[str] = ()
    """Files that the page shows."""


def _compared(record: Mapping[str, Any]) -> Found:
    comparison = Comparison.of_json(record)
    memories = comparison.alternative.memories if comparison.alternative else ()
    relaxations = [
        {"in the place of the orders": f"{m.relaxations} relaxation{'s' * (m.relaxations > 1)} each",
         "ΔBIC against the orders": counted(m.gain), "as good": "yes" if m.as_well else "no"} for m in memories
    ]  # fmt: skip
    against = comparison.doubts.values()
    sentence = _SAID["claims"][comparison.claim]
    reasons = dict.fromkeys((*comparison.claim_reasons, comparison.verdict))
    drifts = (f"{name}: {sentence}" for name, test in comparison.amplitude.items() for sentence in test.sentences)
    best = comparison.best(fractional=comparison.claim == "fractional")
    return Found(
        " ".join((sentence, *(f"But {why}." for why in against))), comparison.claim != "undecided" and not against,
        comparison.claim, rmse=f"{held_out_errors(best, comparison.units)} held out" * bool(best.held_out),
        said=tuple(reasons), notes=(*comparison.notes, *drifts),
        facts=(f"{len(comparison.rows)} structures", f"cost {comparison.cost_name}", f"seed {comparison.seed}"),
        tables={"What an order is worth": relaxations} if relaxations else {},
    )  # fmt: skip


def _planned(record: Mapping[str, Any]) -> Found:
    count = len(record["experiments"])
    gains = record["gain"]
    change = {n: f"{narrower(gains[n], v['standard_error_now'])} today" for n, v in record["expected"].items()
              if gains.get(n)}  # fmt: skip
    rows = [_row(n, v, v["identifiable"], f"95 % interval {change[n]}" if n in change else "")
            for n, v in record["expected"].items()]  # fmt: skip
    away = {"Distance of the integer-order alternatives": [
        {"alternative": n, "standard deviations": number(d, ".3g")} for n, d in record["distances"].items()
    ]} if record.get("distances") else {}  # fmt: skip
    plan = Counter(str(c["text"]) for c in record["experiments"])
    todo = "; ".join(f"{times} × {text}" for text, times in plan.items())
    aims = (f"{letter(n)} {interval(record['expected'][n])}, {change[n]}" for n in record["of"] if n in change)
    each = ", ".join(f"{letter(n)} {distance:.3g}" for n, distance in (record["alone"] or {}).items())
    more = f", {record['excluded']} more excluded" * bool(record["excluded"])
    alone = [f"Where one order alone is fractional: {each}."] * ("," in each)
    return Found(
        f"{count} experiment{'s' * (count > 1)} for {record['for']}: {todo}.",
        said=(*(f"Expected 95 % interval of {aim}." for aim in aims), *alone),
        facts=(f"{record['candidates']} candidates{more}", f"criterion {record['criterion']}"),
        values={"Expected values after the plan": rows}, tables=away,
    )  # fmt: skip


def _drawn(record: Mapping[str, Any]) -> Found:
    rows = [_row(n, {**v, "value": v["median"]}, "identifiable", f"prior {_prior(v['prior'])}")
            for n, v in record["unknowns"].items()]  # fmt: skip
    evidence = record["log_evidence"]
    facts = (record["method"], f"{counted(record['effective_draws'])} effective draws", f"seed {record['seed']}")
    said = () if evidence is None else (f"Log evidence, relative to the greatest likelihood: {number(evidence)} ± "
                                        f"{number(record['evidence_error'], '.2g')} nats.",)  # fmt: skip
    return Found(record["sentence"], record["trusted"], said=said, facts=facts, notes=tuple(record["notes"]),
                 values={"Posterior: medians and central 95 % intervals": rows})  # fmt: skip


def _prior(prior: Mapping[str, Any]) -> str:
    low, high = (word if v is None else f"{v:.3g}" for word, v in (("−∞", prior["lower"]), ("∞", prior["upper"])))
    about = f"{number(prior['mean'], '.3g')} ± {number(prior['sd'], '.2g')}, " if prior["kind"] == "normal" else ""
    return f"{about}{low} … {high}"


def _profiled(record: Mapping[str, Any]) -> Found:
    beside = {} if fault_of(record, Likelihood) else record  # of what fracid profile wrote, and nobody else
    rows, found = [], beside.get("intervals", {}).get("unknowns", {})
    for name, p in record["profiles"].items():
        low, high = p["interval95"]
        ends = ((f"above {number(low, '.2g')}", low), (f"below {number(high, '.2g')}", high))
        sides = [side for side, end in ends if end is not None]
        if len(sides) < 2:
            half = half_of(p["wald95"])
            value = float(to_second_digit(p["value"], half)) if half > 0 else p["value"]
            p = {**p, "interval95": None, "value": value, "sentence": "; it lies ".join((p["sentence"], *sides))}
        known, others = p["verdict"] == "two-sided", {m: found.get(name, {}).get(m) for m in ("sandwich", "bootstrap")}
        halves = {m: half_of(both) for m, both in others.items() if isinstance(both, list) and None not in both}
        says = ", ".join(f"{m} ± {number(half, '.2g')}" for m, half in halves.items())
        verdict, reason = ("identifiable", "") if known else (p["verdict"], p["sentence"])
        rows.append(_row(name, p, verdict, says, reason))
    open_ = [letter(r["name"]) for r in rows if r["identifiable"] != "identifiable"]
    names, s = joined([letter(r["name"]) for r in rows]), "s" * (len(rows) > 1)
    closed = f"The 95 % interval{s} of {names} {'are' if s else 'is'} closed."
    answer = f"Without a closed 95 % interval: {', '.join(open_)}." if open_ else closed
    return Found(answer, not open_, facts=(f"cost {record['cost']['name']}",),
                 notes=(*record["notes"], *_beside(beside)),
                 values={"Profile likelihood: values and 95 % intervals": rows})  # fmt: skip


def _beside(record: Mapping[str, Any]) -> Iterator[str]:
    """What else is to be known of profiles: of the bootstrap, of each recording alone, of what is not identifiable."""
    bootstrap = record.get("bootstrap")
    yield from [bootstrap["warning"]] if isinstance(bootstrap, Mapping) and bootstrap["warning"] else ()
    yield from (record.get("spread") or {}).get("sentences", ())
    for name, v in record.get("identifiability", {}).items():
        if v["verdict"] not in ("identifiable", "forgotten"):
            yield f"{letter(name)}: {v['sentence']}."


def _disturbed(record: Mapping[str, Any]) -> Found:
    tables = {
        label_of(c["level"], c["resolution"], c.get("unit", "rad")): [_error(n, s) for n, s in c["unknowns"].items()]
        for c in record["cells"] if c["unknowns"]
    }  # fmt: skip
    first, *others = record["sentences"] or ["No parameter was estimated."]
    good = not record["findings"] and record["seeds"] >= ENOUGH
    how = ", ".join(filter(None, (record["optimiser"], record["cost"], record["method"])))
    facts = (how, f"{record['seeds']} repetitions a level", f"seed {record['seed']}")
    return Found(first, good, model=record["model"], said=tuple(others), facts=facts, tables=tables)


def _error(name: str, s: Mapping[str, Any]) -> dict[str, str]:
    unit = f" [{typeset_unit(s['unit'])}]" if s["unit"] else ""
    ends = s.get("coverage95")
    share = "" if ends is None else " ({:.0f}–{:.0f} %)".format(*(100 * v for v in ends))
    return {"parameter": f"{letter(name)}{unit}", "truth": number(s["truth"]), "bias": number(s["bias"], ".2g"),
            "spread": number(s["spread"], ".2g"), "standard error": number(s["claimed"], ".2g"),
            "coverage": f"{s['held']} of {s['intervals']}{share}" if s["intervals"] else number(None)}  # fmt: skip


def _controlled(record: Mapping[str, Any]) -> Found:
    c, designs = record["conditions"], (*record["tried"], record["design"])
    weights = dict.fromkeys(n for d in designs for n in d["controller"]["weights"])
    off = next(iter(c["off"]), "")
    signals = (off, c["units"].get(off, "1")), (c["input"], c["unit"])
    error, effort = (f"rms of {letter(n)} [{typeset_unit(unit)}]" for n, unit in signals)
    rows = [
        {"controller": k["kind"], **{letter(n): number(k["weights"].get(n)) for n in weights},
         "holds": f"{d['held']} of {d['draws']} draws", "gain margin [dB]": number(d["gain_margin"], ".3g"),
         "phase margin [°]": number(d["phase_margin"], ".3g"), error: number(d.get("error"), ".3g"),
         effort: number(d.get("effort"), ".3g")} for d in designs for k in [d["controller"]]
    ]  # fmt: skip
    facts = (f"{1 / c['period']:.4g} Hz", f"{c['input']} up to {with_unit(c['most'], c['unit'])}",
             f"delay {1e3 * c['delay']:.3g} ms", f"seed {record['seed']}")  # fmt: skip
    d, lost = record["design"], [t for t in record["trials"][record["worst_draw"] :][:1] if not t["holds"]]
    values = ", ".join(f"{letter(n)} = {number(v)}" for n, v in record["worst"].items())
    said = (f"Gain margin {margin_text(d['gain_margin'], record['gain_margin95'], 'dB')}.",
            f"Phase margin {margin_text(d['phase_margin'], record['phase_margin95'], '°')}.",
            *(f"The worst draw is lost after {t['until']:.3g} s: {values}." for t in lost))  # fmt: skip
    return Found(record["sentence"], record["share"] == 1.0, model=record["model"], said=said, facts=facts,
                 notes=tuple(record["notes"]), tables={"Controllers, the last over all draws": rows})  # fmt: skip


_SAID = tomllib.loads(own_text("report/studies.toml"))

STUDIES = {
    "control.json": Study(ControlRecord, _controlled, **_SAID["control.json"]),
    "compare.json": Study(Comparison, _compared, **_SAID["compare.json"]),
    "plan.json": Study(Plan, _planned, **_SAID["plan.json"]),
    "posterior.json": Study(PosteriorBlock, _drawn, **_SAID["posterior.json"]),
    "profiles.json": Study(Profiles, _profiled, **_SAID["profiles.json"]),
    "noise.json": Study(NoiseStudy, _disturbed, **_SAID["noise.json"]),
}
"""By the file that the command writes; its page is called like that, with .html."""


def _row(name: str, e: Mapping[str, Any], verdict: str, says: str, reason: str = "") -> dict[str, Any]:
    """As the macro of the report's estimates takes it."""
    return {"name": name, "says": says, "value": e["value"], "unit": e["unit"], "interval95": e["interval95"],
            "free": True, "identifiable": verdict, "reason": reason}  # fmt: skip


def studies_of(folder: Path) -> list[str]:
    """The records of studies that a folder has."""
    return [file for file in STUDIES if (folder / file).is_file() and not (folder / file).is_symlink()]


def write_study(folder: str | Path, file: str) -> Path:
    """Write the page of a study beside its record.

    Parameters
    ----------
    folder : str or Path
    file : str
        A key of :data:`STUDIES`.

    Raises
    ------
    InputError
        If the record is damaged, or the page cannot be written.

    Examples
    --------
    >>> write_study("nowhere", "compare.json")
    Traceback (most recent call last):
    fracid.errors.InputError: nowhere holds no compare.json. Write it: fracid compare.
    """
    folder, study = Path(folder), STUDIES[file]
    record, page = _record(folder, file), (folder / file).with_suffix(".html")
    found, environment = study.found(record), read_if_whole(folder / ENVIRONMENT, EnvironmentBlock)
    words, run = environment.get("command") or [], _run(folder)
    integers = _integers(run)
    for row in (row for rows in found.values.values() for row in rows if row["name"] in integers):
        row["integer"] = integers[row["name"]]
    command = words if words[:1] == [study.command] else [study.command, *_options(record, run)]
    ladder = ladder_of(record) if file == "compare.json" else None
    data = _curves(folder, record) if ladder else None
    scripts = ("theme.js", "data.js", "uPlot.iife.min.js", "charts.js", "study.js") if data else ("theme.js",)
    text = rendered(
        "study.html.j2", scripts, images=True,
        title=f"{study.heading}, {folder.resolve().name}", heading=study.heading, name=folder.resolve().name,
        file=file, command=shlex.join(["fracid", *map(str, command)]), versions=environment.get("versions", {}),
        ladder=ladder, shown=_shown(record), curves=bool(data), data=in_script(data), **vars(found),
        figures=list(figures_of(folder, study)), texts=dict(_texts(folder, study.texts)),
    )  # fmt: skip
    write_files(folder, {page.name: text}, writing(f"The page {page}"))
    return page


def read_study(folder: Path, file: str) -> tuple[Study, Found, str]:
    """What a folder's record says, and when it was begun, or else written."""
    study, record = STUDIES[file], _record(folder, file)
    environment = read_if_whole(folder / ENVIRONMENT, EnvironmentBlock)
    written = _moment((folder / file).stat().st_mtime)
    own = (environment.get("command") or [""])[0] == study.command
    return study, study.found(record), environment["started"] if own and environment.get("started") else written


def _moment(seconds: float) -> str:
    """When a file was written; one whose clock was set beyond the calendar, at its end.

    Examples
    --------
    >>> _moment(0.0), _moment(1e15)
    ('1970-01-01T00:00:00+00:00', '9999-12-31T23:59:59+00:00')
    """
    return datetime.fromtimestamp(min(max(seconds, 0.0), 253402300799.0), UTC).isoformat(timespec="seconds")


def _record(folder: Path, file: str) -> dict[str, Any]:
    command = f"fracid {STUDIES[file].command}"
    missing = f"{{path.parent}} holds no {file}. Write it: {command}."
    return dict(read_as(folder / file, STUDIES[file].record, command, missing))


def _options(record: Mapping[str, Any], run: Path | None) -> Iterator[str]:
    """What a command in the folder of another was of, as far as its record says so."""
    yield record.get("source") or ("PROJECT" if run is None else run.name if run.is_absolute() else str(run))
    for name in record.get("profiles") or ():
        yield from ("--parameter", name)
    if record.get("joint"):
        yield from ("--joint", ",".join(record["joint"]["names"]))


def _run(folder: Path) -> Path | None:
    """The run that a study is of, where the study lies in it."""
    above = folder.parent if folder.name not in ("", "..") else folder.resolve().parent
    return next((place for place in (folder, above) if (place / "result.json").exists()), None)


def _integers(run: Path | None) -> dict[str, float | None]:
    """Of each order its integer; of a study apart from its run, those of the library's models."""
    result = read_if_whole(run / "result.json", SavedRun) if run else {}
    return {n: e["integer"] for n, e in result["orders"].items()} if result else {"lambda": 1.0, "mu": 1.0}


def in_script(content: Any) -> Markup:
    """JSON that cannot leave its element: ``<`` is written as an escape, and NaN as null."""
    text = json.dumps(plain(content), ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return Markup(text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029"))


def figures_of(folder: Path, study: Study) -> Iterator[dict[str, str]]:
    """The study's drawings as addresses that hold them: an image runs no script and loads nothing."""
    for pattern, caption in study.figures.items():
        for path in sorted((folder / "figures").glob(f"{pattern}.svg")):
            for file, kind in ((path, "svg+xml"), (path.with_suffix(".png"), "png")):
                with suppress(OSError, ValueError):
                    content = base64.b64encode(bytes_of(file, LARGEST_FIGURE)).decode()
                    yield {"source": f"data:image/{kind};base64,{content}", "caption": caption, "name": path.stem}
                    break


def _texts(folder: Path, names: Sequence[str]) -> Iterator[tuple[str, str]]:
    for name in names:
        with suppress(OSError, ValueError):
            yield name, text_of(folder / name)


# --- a comparison ----------------------------------------------------------------------------------


def ladder_of(compared: Mapping[str, Any]) -> dict[str, Any]:
    """The table of ``fracid compare``: a row a structure, its errors by recording."""
    first = compared["structures"][0]
    kinds = [("in_sample", "fitted"), ("held_out", "held out")]
    columns = [(kind, label, recording) for kind, label in kinds for recording in first[kind]]
    best = set(compared["best"].values())
    rows = [
        {**s, "best": s["name"] in best, "errors": [s[kind].get(recording) for kind, _, recording in columns],
         "means": {kind: _mean(s[kind]) for kind, _ in kinds}} for s in compared["structures"]
    ]  # fmt: skip
    errors = [v for row in rows for v in row["means"].values() if v] or [1.0]
    aside = 10.0 if min(errors) == max(errors) else 1.0  # a lone one stands in the middle
    axis = Axis(min(errors) / aside, max(errors) * aside, 8, LADDER_WIDTH - 8, log=True)
    for row in rows:
        row["drawn"] = drawn("ladder.svg.j2", means=row["means"], axis=axis, width=LADDER_WIDTH)
    judged_by = "the error on held-out recordings" if first["held_out"] else "BIC"
    return {**compared, "columns": columns, "rows": rows, "judged_by": judged_by}


def _mean(scores: Mapping[str, Any]) -> float | None:
    """The geometric mean over recordings and outputs; None where one fails, or there is none."""
    values = [v for s in scores.values() for v in s["rmse"].values()]
    return float(np.exp(np.mean(np.log(values)))) if values and all(v and v > 0 for v in values) else None


def _shown(record: Mapping[str, Any]) -> Callable[[str, float, str], str]:
    units = record.get("units") or {}
    return lambda output, value, form: in_unit(value, shown_unit(units.get(output, "rad")), form)


def _curves(folder: Path, record: Mapping[str, Any]) -> dict[str, Any] | None:
    """The curves as ``study.js`` has them; None of a comparison that kept none."""
    if not (found := read_if_whole(folder / "curves.json", CurvesBlock)):
        return None
    names = [s["name"] for s in record["structures"]]
    recordings = [{
        "name": name, "heldOut": name in record["held_out"], "t": base64_floats(np.array(r["time"])),
        "outputs": [{
            "letter": letter(n), "unit": unit, "measured": _packed(y, factor),
            "simulated": [_packed(found["structures"].get(s, {}).get(name, {}).get(n), factor) for s in names],
        } for n, y in r["measured"].items() for unit, factor in [shown_unit(record["units"].get(n, "rad"))]],
    } for name, r in found["recordings"].items()]  # fmt: skip
    best = [names.index(record["best"][kind]) for kind in ("integer", "fractional")]
    return {
        "structures": names, "fractional": [s["fractional"] for s in record["structures"]], "recordings": recordings,
        "best": best, "claimed": int(record["claim"] == "fractional"),
    } if recordings else None  # fmt: skip


def _packed(y: list[float | None] | None, factor: float) -> str | None:
    return base64_floats(factor * np.array(y, dtype=float)) if y else None
