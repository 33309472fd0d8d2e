"""``fracid simulate RIG|MODEL|PROJECT|RUN``: a simulated recording, as a rig's encoders would have read it."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fracid.cli.app import SAYS, How, assigned, command, each_once, say_next, typed
from fracid.cli.check import column_from_text
from fracid.errors import InputError
from fracid.units import with_time_unit

if TYPE_CHECKING:
    from rich.console import Console

    from fracid.twins.twin import Twin
    from fracid.workflows.simulation import SimulatedRecording


@command
def simulate(source: str | None = None, *, how: How) -> None:
    """Simulate a rig, a project or a run as its encoders record it.

    A run is simulated with its fitted values, a project with its starting values; the options change single values.
    Writes the recording, a figure, and a JSON file with the true values; fracid check, init and fit read the
    recording.  Exit code 0 if the simulation reaches its end, 3 if not.
    """
    source = source or how.model
    if source is None or how.model not in (None, source):
        raise InputError("Name what to simulate, a rig, project, run or model: fracid simulate --model cart-pole.")
    from fracid.workflows.simulation import simulate_twin, twin_of

    twin = _changed(twin_of(source, **how.taken(twin_of, released=how.input_ is None and not how.initial)), how)
    twin = twin if how.input_ is None else _driven(twin, how.input_, how.end)
    simulated = how.done(simulate_twin, twin, source, noise=_noise(how.noise, twin))
    record = {**simulated.result, "files": [str(path) for path in simulated.files]}
    how.answer(record, partial(_show, source, simulated))


# ------------------------------------------------------------------ from text to a twin


def quantity(text: str, option: str, *, of: str = "", bare: bool = True) -> float:
    """Parse ``10deg``, ``0.17rad``, ``2ms``, ``0.17``: SI.

    Parameters
    ----------
    text : str
    option : str
        What to type, in messages.
    of : str
        The SI unit of what is asked; any, if left out.
    bare : bool
        Whether a number without a unit is SI.

    Raises
    ------
    InputError
        For what is no number, an unknown unit, or a number without a unit where one is needed.

    Examples
    --------
    >>> round(quantity("10deg", "--initial alpha=10deg", of="rad"), 6), quantity("2ms", ""), quantity("1e-3", "--step")
    (0.174533, 0.002, 0.001)
    """
    from fracid.recording.channel import SPELLINGS, UNITS
    from fracid.recording.clock import SECONDS

    match = re.fullmatch(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([^\d\s]*)\s*", text)
    sizes = {n: size for n, (size, si) in UNITS.items() if of in ("", si) and n not in ("counts", "1")}
    sizes |= {other: sizes[n] for other, n in SPELLINGS.items() if n in sizes} | (SECONDS if of in ("", "s") else {})
    if not match or match[2] not in ("", *sizes):
        raise InputError(f"{text!r} is not possible; expected a number with its unit, e.g. {option}.")
    if not bare and not match[2]:
        typed = re.sub(r"[\d.]+deg$", f"{text.strip()}deg", option)
        raise InputError(f"{text!r} has no unit: deg or rad? Type for example {typed}.")
    return float(match[1]) * sizes.get(match[2], 1.0)


def _changed(twin: Twin, how: How) -> Twin:
    """With what the options name."""

    def state(text: str, option: str) -> float:
        angle = option.split()[1].partition("=")[0] in _angles(twin)
        return quantity(text, option, of="rad" * angle, bare=not angle)

    more, examples = vars(how), {"end": "--end 20", "step": "--step 1ms", "hold": "--hold 1"}
    fields: dict[str, Any] = {n: quantity(more[n], e, of="s") for n, e in examples.items() if more[n] is not None}
    if fields.get("hold", 0.0) < 0:
        raise InputError(f"hold = {fields['hold']:g} s is not possible; expected 0 or more.")
    if "hold" in fields and "end" not in fields:
        fields["end"] = twin.end + fields["hold"] - twin.hold
    fields |= {name: more[name] for name in ("method", "substeps") if more[name] is not None}
    return twin.changed(
        orders=assigned("--order", how.order, "mu=0.91", quantity),
        parameters=assigned("--set", how.set_, "b_alpha=2e-4", quantity),
        initial=assigned("--initial", how.initial, "alpha=10deg", state), **fields,
    )  # fmt: skip


def _angles(twin: Twin) -> list[str]:
    """The outputs whose values need a unit."""
    return [n for n in twin.model.outputs if twin.model.output_unit(n) == "rad"]


def _driven(twin: Twin, spec: str, end: str | None) -> Twin:
    """With the input of a file, ``pulse.csv,column=2``; to its end, where no other is said."""
    from fracid.workflows.simulation import driven

    file, _, fields = spec.partition(",")
    channel = column_from_text(f"input=0,{fields}")[1] if fields else {}
    return driven(twin, Path(file), channel, to_its_end=end is None)


def _noise(texts: list[str] | None, twin: Twin) -> dict[str, float]:
    """Output → standard deviation [SI]; a value without a name is that of all."""
    angles, levels = _angles(twin), list[tuple[str, float]]()
    for text in texts or ():
        name, _, value = text.rpartition("=")
        angle = (name.strip() or next(iter(twin.model.outputs))) in angles
        level = quantity(value, "--noise 0.05deg" if angle else "--noise 0.001", of="rad" * angle, bare=not angle)
        levels.append((name.strip() or "all", level))
    deviations = each_once("--noise", levels)
    of_all = dict.fromkeys(twin.model.outputs, deviations.pop("all")) if "all" in deviations else {}
    return of_all | deviations


# ------------------------------------------------------------------ from results to text


def _show(source: str, simulated: SimulatedRecording, console: Console) -> None:
    from rich.markup import escape

    from fracid.cli.check import print_signals, print_sketches

    twin, run, data, files = simulated.twin, simulated.run, simulated.recording, simulated.files
    orders = ", ".join(f"{n} {v:g}" for n, v in twin.orders.items()) or "fixed orders"
    zero = f", {twin.model.zero}" if twin.model.zero else ""
    said = SAYS("simulated", source=escape(source), model=escape(twin.model.name), zero=zero, orders=escape(orders),
                run=run, step=with_time_unit(run.step), samples=data.time.size, end=data.time[-1])  # fmt: skip
    console.print(said, soft_wrap=True)
    print_signals(console, data.report, {})
    print_sketches(console, data)
    for path in files:
        if kind := {".json": "truth", ".png": "figure", ".svg": ""}.get(path.suffix, "recording"):
            console.print(f"{kind:10} {escape(str(path))}", soft_wrap=True)
    say_next(console, (typed("check", files[0]), "look at it as at any recording"))
