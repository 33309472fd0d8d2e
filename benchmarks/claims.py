"""Does fracid claim only what is so?  Rigs of known truth through init, fit and compare: ``make claims``.

    python benchmarks/claims.py --quick                     # one rig of each kind, at its middle severity
    python benchmarks/claims.py --kinds play lugre none     # by name; or integer, fractional: all of these
    python benchmarks/claims.py --draws 3 --jobs 2          # three rigs of each kind and severity: hours
    python benchmarks/claims.py --json                      # all answers as JSON on standard output

The recordings come from ``independent_rigs.py``, which shares no code with fracid.  Of each rig there are one to be
fitted and one or two held out, from other heights.  Each goes through the program as a user types it: ``fracid init
--yes`` drafts the project, the held-out recordings join it with ``use = "validate"``, and ``fit`` and ``compare`` take
it untouched.  The claim is ``claim`` in ``result.json`` and ``compare.json``.

=========  =================================================================================
truth      bar
=========  =================================================================================
integer    never "fractional", from neither command
fractional "fractional" for 95 % of those whose orders are determined: where an order is off
           1, its 95 % interval is narrower than half its distance to 1
=========  =================================================================================

The exit code is 1 where a bar is missed.  Answers are kept in a folder of runs/claims that is named after the code of
fracid and of the rigs: the same command resumes, and a change of the code begins anew.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from independent_rigs import KINDS, Kind, recording, write

import fracid
from fracid.tasks.job import Progress, Task
from fracid.tasks.journal import Journal
from fracid.tasks.tasks import run_tasks

FOLDER = Path(__file__).parent.parent / "runs" / "claims"

CLAIMS = ("fractional", "undecided", "integer", "failed")

HEIGHTS = (75.0, 45.0, 100.0)
"""Angles of release [°]: the first is fitted, the others are held out."""

POWER = 0.95
"""Part of the determined fractional truths that must be called so."""


# --- what fracid claims ------------------------------------------------------------------------------------------


def claim_of_fit(result: dict[str, Any]) -> str:
    """Return the claim of a result.json; of a former one, what its sentences say of the orders."""
    if "claim" in result:
        return str(result["claim"])
    alternative = result["alternative"]
    if alternative:
        return "integer" if alternative["warning"] else "fractional"
    unclear = [e for e in result["orders"].values() if e["free"] and not e["interval95"]]
    return "undecided" if unclear else "integer"


def claim_of_compare(comparison: dict[str, Any]) -> str:
    """Return the claim of a compare.json; of a former one, what its verdict begins with."""
    if "claim" in comparison:
        return str(comparison["claim"])
    verdict = comparison["verdict"]
    if verdict.startswith("Orders help") and "only, which is no evidence" not in verdict:
        return "fractional"
    integer = ("Orders make no difference", "Orders replace", "Orders fit better")
    return "integer" if verdict.startswith(integer) else "undecided"


def determined(orders: dict[str, Any], truth: dict[str, float]) -> bool:
    """Whether every order that is off 1 has an interval narrower than half its distance to 1."""
    off = {n: truth[n] for n in ("lambda", "mu") if truth[n] != 1.0}
    intervals = {n: orders[n]["interval95"] for n in off}
    return bool(off) and all(e is not None and e[1] - e[0] < abs(1 - off[n]) / 2 for n, e in intervals.items())


# --- a rig through the program --------------------------------------------------------------------------------


def program(*arguments: str, folder: Path) -> tuple[int, str, str, float]:
    """Run fracid; exit code, both outputs and the time it takes [s]."""
    began = time.perf_counter()
    run = subprocess.run([sys.executable, "-m", "fracid", *arguments], cwd=folder, capture_output=True, text=True,
                         check=False)  # fmt: skip
    return run.returncode, run.stdout, run.stderr, time.perf_counter() - began


def project(files: list[Path]) -> str:
    """Draft a project for the first file, with the others held out; a reason where init refuses one."""
    drafts = []
    for file in files:
        code, _, errors, _ = program(
            "init", file.name, "--yes", "--force", "--out", f"{file.stem}.toml", folder=file.parent
        )
        if code:
            return f"init: {last(errors)}"
        drafts.append(file.with_suffix(".toml").read_text(encoding="utf-8"))
    block = re.compile(r"\[\[recording\]\].*?(?=\n\[fit\])", re.DOTALL)
    held_out = [re.sub(r'use = "fit"', 'use = "validate"', block.search(draft)[0]) for draft in drafts[1:]]
    with_all = block.sub(lambda found: "\n\n".join([found[0].rstrip(), *held_out]), drafts[0], count=1)
    (files[0].parent / "project.toml").write_text(with_all, encoding="utf-8")
    return ""


def last(text: str) -> str:
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith('{"event"')]
    return lines[-1].strip() if lines else "no message"


def answer(
    name: str, severity: float, seed: int, seconds: float, takes: int, commands: tuple[str, ...], folder: str
) -> dict[str, Any]:
    """Return what fracid claims of one rig, from each of the commands, with times [s]."""
    here = Path(folder) / f"{name}_{severity:g}_{seed}"
    began = time.perf_counter()
    records = [recording(name, severity, seed=seed, take=k, seconds=seconds, release=HEIGHTS[k]) for k in range(takes)]
    files = [write(record, here) for record in records]
    seconds_of = {"twin": time.perf_counter() - began}
    truth = records[0].truth
    out: dict[str, Any] = {"kind": name, "severity": severity, "seed": seed, "fractional": truth.fractional,
                           "truth": truth.orders, "claims": {}, "reasons": {}, "seconds": seconds_of}  # fmt: skip
    if refusal := project(files):
        return out | {"claims": dict.fromkeys(commands, "failed"), "reasons": {commands[0]: [refusal]}}
    readers = {"fit": claim_of_fit, "compare": claim_of_compare}
    for command in commands:
        code, text, errors, seconds_of[command] = program(command, "project.toml", "--json", "--jobs", "1", "--out",
                                                          f"run-{command}", folder=here)  # fmt: skip
        if code:
            out["claims"][command], out["reasons"][command] = "failed", [f"exit code {code}: {last(errors)}"]
            continue
        content = json.loads(text)
        out["claims"][command] = readers[command](content)
        out["reasons"][command] = content.get("claim_reasons") or [
            content.get("verdict") or "; ".join(content["warnings"])
        ]
        if command == "fit":
            out["orders"] = {n: {k: e[k] for k in ("value", "interval95")} for n, e in content["orders"].items()}
            out["determined"] = determined(out["orders"], truth.orders)
            out["rmse"] = {n: r["rmse"] for n, r in content["recordings"].items()}
    return out


# --- tables and bars --------------------------------------------------------------------------------------------


def table(answers: Iterable[dict[str, Any]], commands: tuple[str, ...]) -> str:
    """Return truth × claim, a row a kind and severity, in Markdown; what is wrong is bold."""
    rows: dict[tuple[bool, str, float], list[dict[str, Any]]] = {}
    for a in answers:
        rows.setdefault((a["fractional"], a["kind"], a["severity"]), []).append(a)
    head = [f"{command}: {claim}" for command in commands for claim in CLAIMS]
    lines = [
        "| truth | kind | severity | rigs | " + " | ".join(head) + " |",
        "|---|---|---|---:|" + "---:|" * len(head),
    ]
    for (is_fractional, name, severity), mine in sorted(rows.items(), key=lambda row: row[0][0]):
        cells = []
        for command in commands:
            counts = Counter(a["claims"].get(command, "failed") for a in mine)
            wrong = {"failed", "integer" if is_fractional else "fractional"}
            cells += [f"**{counts[c]}**" if c in wrong and counts[c] else str(counts[c] or "·") for c in CLAIMS]
        truth = "fractional" if is_fractional else "integer"
        lines.append(
            f"| {truth} | {name} | {severity:g} {KINDS[name].unit} | {len(mine)} | " + " | ".join(cells) + " |"
        )
    return "\n".join(lines)


def bars(answers: list[dict[str, Any]], commands: tuple[str, ...]) -> list[tuple[str, bool]]:
    """Return each bar in a sentence, and whether it is met."""
    lines = []
    for command in commands:
        claims = [(a, a["claims"].get(command, "failed")) for a in answers]
        integer = [claim for a, claim in claims if not a["fractional"]]
        power = [claim for a, claim in claims if a.get("determined")]
        false, failed = integer.count("fractional"), sum(claim == "failed" for _, claim in claims)
        lines.append((f'{command}: {false} false "fractional" of {len(integer)} rigs of integer order', false == 0))
        if power:
            right = power.count("fractional")
            lines.append((f"{command}: {right} of {len(power)} rigs with determined fractional orders called so",
                          right >= POWER * len(power)))  # fmt: skip
        lines.append((f"{command}: {failed} of {len(claims)} failed", failed == 0))
    return lines


# --- the run ------------------------------------------------------------------------------------------------------


def chosen(names: list[str]) -> list[Kind]:
    """Return kinds by name, or all of an order."""
    groups = {"integer": [k for k in KINDS.values() if not k.fractional],
              "fractional": [k for k in KINDS.values() if k.fractional]}  # fmt: skip
    unknown = [n for n in names if n not in KINDS and n not in groups]
    if unknown:
        raise SystemExit(f"--kinds {unknown[0]}: expected integer, fractional or some of {', '.join(KINDS)}")
    kinds = [k for n in names for k in groups.get(n, [KINDS[n]] if n in KINDS else [])] or list(KINDS.values())
    return list(dict.fromkeys(kinds))


def code() -> str:
    """Return a hash of all that answers depend on."""
    sources = [
        *sorted(Path(fracid.__file__).parent.rglob("*.py")),
        Path(__file__).with_name("independent_rigs.py"),
        Path(__file__),
    ]
    return hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()


def shown(p: Progress) -> None:
    left = f", {p.left / 60:.0f} min left" if p.left else ""
    print(f"{p.done} of {p.total} rigs{left}", file=sys.stderr, flush=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kinds", nargs="*", default=[], help="by name; integer, fractional; all if left out")
    parser.add_argument("--draws", type=int, default=1, help="rigs of each kind and severity")
    parser.add_argument("--seed", type=int, default=1, help="of the first rig")
    parser.add_argument("--quick", action="store_true", help="the middle severity, 12 s, one recording held out")
    parser.add_argument("--seconds", type=float, default=0.0, help="of each recording; 20, quick 12")
    only = parser.add_mutually_exclusive_group()
    only.add_argument("--no-compare", action="store_true", help="fit alone")
    only.add_argument("--no-fit", action="store_true", help="compare alone")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    parser.add_argument("--out", type=Path, default=FOLDER, help="folder for recordings, projects, runs and journal")
    parser.add_argument("--json", action="store_true", help="all answers as JSON on standard output")
    asked = parser.parse_args()
    seconds, takes = asked.seconds or (12.0 if asked.quick else 20.0), 2 if asked.quick else 3
    commands = ("fit", "compare")[asked.no_fit : 2 - asked.no_compare]
    study = {"code": code(), "seconds": seconds, "takes": takes, "commands": commands}
    folder = asked.out.resolve() / hashlib.sha256(json.dumps(study).encode()).hexdigest()[:12]
    tasks = [
        Task(f"{k.name} {severity:g} {seed}",
             (k.name, severity, seed, seconds, takes, commands, str(folder)))
        for seed in range(asked.seed, asked.seed + asked.draws) for k in chosen(asked.kinds)
        for severity in ([k.severities[len(k.severities) // 2]] if asked.quick else k.severities)
    ]  # fmt: skip
    folder.mkdir(parents=True, exist_ok=True)
    began = time.perf_counter()
    with Journal(folder / "journal.jsonl", study) as journal:
        answers = list(run_tasks(answer, tasks, executor="processes", jobs=asked.jobs, journal=journal,
                                 progress=shown).values())  # fmt: skip
    met = bars(answers, commands)
    text = [table(answers, commands), "", *(f"{'met   ' if good else 'MISSED'}  {line}" for line, good in met)]
    used = {c: sum(a["seconds"].get(c, 0.0) for a in answers) / len(answers) for c in ("twin", *commands)}
    text.append("a rig on average: " + ", ".join(f"{c} {s:.1f} s" for c, s in used.items())
                + f"; in all {(time.perf_counter() - began) / 60:.1f} min")  # fmt: skip
    print("\n".join(text), file=sys.stderr if asked.json else sys.stdout)
    if asked.json:
        print(json.dumps({"answers": answers, "bars": dict(met)}, indent=1))
    return 0 if all(good for _, good in met) else 1


if __name__ == "__main__":
    raise SystemExit(main())
