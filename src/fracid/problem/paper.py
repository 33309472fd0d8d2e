"""What ``preset = "paper"`` fixes, and in what a project with it still differs from the paper.

The paper searches two orders and nothing else: from a plateau at 10°, 20 s at 1000 Hz, over the rig's known constants,
by (21)-(24), with the ITAE of α alone (26).  So the preset fixes all else that a project leaves free, at

- the rig's value, where the project names a rig: what a search starts from is a guess;
- the start, of constants without a rig, of a release's time, of a channel's delay, gain, bias and low-pass.

What the file says in so many words, a number for a constant, a part of a recording, a second recording, stays; and
:func:`differences` says so.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

from fracid.findings import Words
from fracid.models import Model, rotary_pendulum
from fracid.problem.experiment import Experiment
from fracid.problem.problem import Problem
from fracid.problem.sensors import QUANTITIES, Sensor
from fracid.problem.unknowns import Free, starting_value
from fracid.units import letter

SAYS = Words("problem/paper.toml")

RATE, DURATION, ANGLE = 1000.0, 20.0, math.radians(10.0)
"""Of the paper's recording [Hz, s, rad]."""

NEAR = 0.1
"""A duration and an angle are the paper's within this part."""

BEYOND = ("drag_", "cable_", "stiction_", "presliding_", "springpot_", "play_", "arm_", "hub_", "dead_", "back_")
"""How the parameters begin of what the paper's model does not have."""


def fixed(experiment: Experiment) -> Experiment:
    """A recording of which the search finds nothing: its release and what its channels do are fixed at their starts.

    Examples
    --------
    >>> import numpy as np
    >>> still = Experiment("still", 0.1, np.zeros((9, 1)), np.zeros((1, 1)), release_time=Free(0.0, -0.1, 0.1))
    >>> fixed(still).release_time
    0.0
    """

    def at_starts(channels: Mapping[str, Sensor]) -> dict[str, Sensor]:
        return {n: Sensor(*(starting_value(getattr(s, q)) for q in QUANTITIES)) for n, s in channels.items()}

    return replace(experiment, release_time=starting_value(experiment.release_time),
                   sensors=at_starts(experiment.sensors), actuators=at_starts(experiment.actuators))  # fmt: skip


def differences(problem: Problem, rig: str | None, given: Mapping[str, float]) -> str:
    """In what a problem with the preset is not the paper's, as one sentence.

    Parameters
    ----------
    problem : Problem
    rig : str or None
        The one that the project names.
    given : mapping
        The constants to which the project gives a number.

    Examples
    --------
    >>> from fracid.models import rotary_pendulum
    >>> import numpy as np
    >>> swing = Experiment("swing", 2e-3, np.radians(np.full((10_001, 1), 10.0)), np.zeros((1, 1)))
    >>> orders = {"lambda": Free(1.0, 0.5, 1.2), "mu": Free(1.0, 0.5, 1.2)}
    >>> problem = Problem(rotary_pendulum(), (swing,), orders, outputs=("alpha",), method="gl-paper")
    >>> differences(problem, "srv02-rotpen", {}).split("; ")[0]
    'This fit differs from the paper: swing has 500 Hz (the paper: 1000 Hz)'
    """
    parts = [*_of_recordings(problem), *_of_constants(problem.model, rig, given), *_of_the_recipe(problem)]
    return f"This fit differs from the paper: {'; '.join(parts)}."


def _of_recordings(problem: Problem) -> Iterator[str]:
    if len(problem.experiments) > 1:
        yield f"{len(problem.experiments)} recordings are fitted (the paper: one)"
    for e in problem.experiments:
        rate, angle = 1 / e.step, _release_angle(problem, e)
        if abs(rate / RATE - 1) > 1e-3:
            yield f"{e.name} has {rate:.4g} Hz (the paper: {RATE:.0f} Hz)"
        if abs(e.time[-1] / DURATION - 1) > NEAR:
            yield f"{e.name} takes {e.time[-1]:.3g} s (the paper: {DURATION:.0f} s)"
        if angle is not None and abs(abs(angle) / ANGLE - 1) > NEAR:
            yield f"{e.name} is let go at {math.degrees(abs(angle)):.3g}° (the paper: 10°)"
        if e.driven and problem.model.inputs:
            yield f"{e.name} is driven (the paper: let go)"
        for channel, sensor in (*e.sensors.items(), *e.actuators.items()):
            if sensor != Sensor():
                yield f"{channel} of {e.name} has a sensor of its own"


def _release_angle(problem: Problem, e: Experiment) -> float | None:
    """From where the pendulum hangs [rad]; None where it is not scored."""
    if problem.model.pendulum not in problem.outputs:
        return None
    first = float(e.measured[0, problem.outputs.index(problem.model.pendulum)])
    return math.remainder(first - (math.pi if problem.model.zero == "upright" else 0.0), 2 * math.pi)


def _of_constants(model: Model, rig: str | None, given: Mapping[str, float]) -> Iterator[str]:
    if model.name != "rotary-pendulum":
        yield f"the model is {model.name} (the paper: a rotary pendulum)"
        return
    own = {p.name: p.value for p in (rotary_pendulum(rig) if rig else rotary_pendulum()).parameters}
    changed = [f"{n} = {v:.4g}" for n, v in given.items() if not math.isclose(v, own.get(n, v), rel_tol=1e-4)]
    if rig is None:
        yield "no rig is named, so free constants are at their starts (the paper: a rig's known constants)"
    elif changed:
        yield f"{', '.join(changed)} {'is' if len(changed) == 1 else 'are'} the file's, not the rig's"
    beyond = [p.name for p in model.parameters if p.name.startswith(BEYOND) and p.value != own[p.name]]
    if beyond:
        yield f"the model has {', '.join(beyond)} (the paper: viscous and Coulomb friction)"
    yield SAYS("constants")
    if model.zero == "hanging":
        yield "α = 0 is hanging (upright in (1) as printed)"


def _of_the_recipe(problem: Problem) -> Iterator[str]:
    ranges = [f"{letter(n)} in {v.lower:g} … {v.upper:g}" for n, v in problem.orders.items() if isinstance(v, Free)]
    if ranges:
        yield f"the search is bounded, {', '.join(ranges)} (the paper gives no bounds)"
    if problem.memory.name.startswith("short"):
        yield f"the memory is {problem.memory.name} (the paper: full)"
    if problem.substeps != 1:
        yield f"a sample is {problem.substeps} steps (the paper: one)"
