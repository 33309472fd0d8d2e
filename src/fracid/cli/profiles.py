"""``fracid profile RUN|PROJECT``: the profile likelihood of each unknown, and its interval."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from fracid.cli.app import LONG, How, command, print_study, print_table, say, typed, warn
from fracid.errors import SMALLEST, Failure, InputError
from fracid.units import GREEK, half_of, to_second_digit

if TYPE_CHECKING:
    from rich.console import Console

    from fracid.estimation.cost_profile import Profile
    from fracid.workflows.profiles import FinishedProfiles


@command(*LONG)
def profile(
    source: Path,
    parameter: list[str] | None = None,
    joint: str | None = None,
    points: int = 12,
    *,
    how: How,
) -> None:
    """Profile likelihood: intervals from refits along each parameter.

    Fixes one parameter on a grid and refits the others.  Shows the 95 % interval of the profile beside those of the
    sandwich and of the bootstrap, and a verdict on each free parameter.  Writes profiles.json and a figure.  Exit
    code 0 when done, 3 if no run of the model reaches the end of the recording.
    """
    from fracid.workflows.profiles import run_profiles

    finished = how.done(run_profiles, source, parameters=parameter, joint=_pair(joint), points=points)
    if source.is_dir():
        what = "the page, with the profiles" if finished.folder == source else "the page of the run"
        after = typed("report", source, "--open", trust=how.trust), what
    else:
        after = typed("fit", source, trust=how.trust), "the whole result, with a page"
    how.answer(finished.result, partial(_show, finished, after))


def _pair(joint: str | None) -> tuple[str, str] | None:
    if joint is None:
        return None
    names = [name.strip() for name in joint.split(",")]
    if len(names) != 2:
        raise InputError(f"--joint {joint!r} is not possible; expected two names, e.g. --joint mu,b_alpha.")
    return names[0], names[1]


# ------------------------------------------------------------------ from results to text


def _show(analysis: FinishedProfiles, after: tuple[str, str], console: Console) -> None:
    from rich.markup import escape

    intervals = analysis.result["intervals"]["free_parameters"]
    rows = []
    for name, p in analysis.profiles.profiles.items():
        row = intervals[name]
        others = [_half(row.get(method)) for method in ("sandwich", "bootstrap")]
        rows.append((name, _value(p), _interval(p.interval95, p.best), *others, p.unit, p.verdict))
    print_table(console, ("", "value", "95 % by profile", "sandwich", "bootstrap", "unit", "profile"), rows)
    spread = analysis.result["spread"]
    few = "" if isinstance(analysis.bootstrap, Failure) else analysis.bootstrap.warning
    warn(console, *filter(None, (*analysis.profiles.notes, few, *(spread["sentences"] if spread else ()))))
    for name, verdict in analysis.verdicts.items():
        if verdict.kind != "forgotten" and (verdict.kind != "identifiable" or verdict.reason):
            mark = "  " if verdict.kind == "identifiable" else "[yellow]![/yellow] "
            say(console, escape(f"{GREEK.get(name, name)} {verdict.says}."), mark)
    print_study(console, analysis, after)


def _half(ends: tuple[float, float] | None) -> str:
    return "none" if ends is None else f"± {half_of(ends):.2g}"


def _value(p: Profile) -> str:
    """The value to the second digit of its interval."""
    half = _reach(p.interval95, p.best) or _reach(p.wald95 or (None, None), p.best)
    return to_second_digit(p.best, half) if half else f"{p.best:.4g}"


def _reach(ends: tuple[float | None, float | None], best: float) -> float:
    return max((abs(end - best) for end in ends if end is not None), default=0.0)


def _interval(ends: tuple[float | None, float | None], best: float) -> str:
    """Both ends, or the one that there is."""
    half = _reach(ends, best)
    low, high = (None if end is None else to_second_digit(end, half or SMALLEST) for end in ends)
    if low is None and high is None:
        return "none"
    if low is None or high is None:
        return f"< {high}" if low is None else f"> {low}"
    return f"{low} … {high}"
