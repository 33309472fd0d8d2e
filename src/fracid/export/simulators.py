"""``MODEL.xml`` for MuJoCo, ``MODEL.urdf``, and a servo's ``MODEL.json`` for BAM: rigs with integer orders.

``simulators.toml`` says what the links of a rig and the values of a servo are in its constants.  What a simulator lacks
is said in the file and on the terminal with the code of the reason; a fractional order is refused, for none has one.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np

from fracid._version import __version__
from fracid.errors import InputError
from fracid.export.identified import Identified
from fracid.export.markup import xml
from fracid.findings import Words
from fracid.models.rigs import STANDARD_GRAVITY
from fracid.models.written.formulas import formula
from fracid.models.written.tree import Expression, Name, Number, mentioned
from fracid.safety.door import own_text

SAYS = Words("export/rigid.toml")

WORDS = ("joint", "kind", "parent")
"""What of a link is no formula."""


TABLE: Mapping[str, Any] = tomllib.loads(own_text("export/simulators.toml"))


@dataclass(frozen=True, kw_only=True)
class Link:
    """A rigid body and the joint that carries it; lengths, axes and places in its parent's frame, z up."""

    joint: str
    """The output that is its joint's angle or position."""
    kind: str = "hinge"
    parent: str = ""
    place: tuple[float, ...] = (0.0, 0.0, 0.0)
    """Of the joint [m]."""
    axis: tuple[float, ...] = (0.0, 0.0, 0.0)
    mass: float = 0.0
    com: tuple[float, ...] = (0.0, 0.0, 0.0)
    """From the joint to the centre of mass [m]."""
    inertia: tuple[float, ...] = (0.0, 0.0, 0.0)
    """About the centre of mass, along the axes [kg m²]."""
    zero: float = 0.0
    """What the joint shows where the link is as described [rad]."""
    damping: tuple[float, ...]
    """Viscous, and of the square of the speed."""
    friction: float = 0.0
    stiffness: float = 0.0
    rest: float = 0.0
    drive: Mapping[str, float]
    """Input → torque or force for one of its unit."""
    limit: float = 0.0
    """Largest input; 0 for none."""

    @property
    def least_inertia(self) -> tuple[float, ...]:
        """What MuJoCo takes: it wants moments above 0."""
        return tuple(max(v, 1e-12) for v in self.inertia)


class Rig(NamedTuple):
    """An identified model as links."""

    model: Identified
    links: tuple[Link, ...]
    shaft: tuple[tuple[str, ...], float, float, float] | None
    """The joints that a spring connects, its stiffness and damping, and by how much they differ where it is slack."""
    lost: tuple[str, ...]
    """What is left out, in sentences with the code of the reason."""


class _Values:
    """Formulas of the identified constants: their values, and which constants they mention."""

    def __init__(self, model: Identified, target: str) -> None:
        self.target, self.used = target, set[str]()
        self.names: dict[str, Expression] = {n: Number(q.value) for n, q in model.constants.items()}
        self.names.setdefault("g", Number(STANDARD_GRAVITY))
        self.names["hanging"] = Number(-1.0 if model.problem.model.zero == "upright" else 1.0)

    def __call__(self, text: Any) -> Any:
        """The value of a formula; of several of them a tuple."""
        if isinstance(text, list):
            return tuple(map(self, text))
        self.used.update(mentioned(formula(text, {n: Name(n) for n in self.names})))
        found = formula(text, self.names)
        if not isinstance(found, Number) or not np.isfinite(found.value):
            raise InputError(f"{text} has no value for these constants, so {self.target} cannot have them [body].")
        return float(found.value)


def rig_of(model: Identified, target: str) -> Rig:
    """The links of an identified model.

    Parameters
    ----------
    model : Identified
    target : str
        Who reads them, for messages: ``MuJoCo`` or ``URDF``.

    Raises
    ------
    InputError
        For a model that is no rig of the library, a fractional order, and constants that no rigid bodies have.

    Examples
    --------
    >>> rig_of.__name__
    'rig_of'
    """
    own = model.problem.model
    rows = TABLE.get(own.name)
    if rows is None:
        rigs = ", ".join(name for name, row in TABLE.items() if "links" in row)
        raise InputError(SAYS("no-rig", name=own.name, rigs=rigs, target=target))
    _refuse_orders(model, target)
    values = _Values(model, target)
    for name, text in rows["definitions"].items():
        values.names[name] = Number(values(text))
    links = []
    for row in rows["links"]:
        drive = {n: values(text) for n, text in row.get("drive", {}).items() if n in own.inputs}
        link = Link(**{n: v if n in WORDS else values(v) for n, v in row.items() if n != "drive"}, drive=drive)
        if link.mass <= 0 or min(link.inertia) < 0:
            raise InputError(SAYS("no-body", link=link, least=min(link.inertia)))
        links.append(link)
    spring = None
    if shaft := rows.get("shaft"):
        spring = tuple(shaft["joints"]), *(values(shaft[n]) for n in ("stiffness", "damping", "rest"))
    return Rig(model, tuple(links), spring, tuple(_lost(model, values.used, target)))


def _refuse_orders(model: Identified, target: str) -> None:
    for q in model.orders:
        if not q.name.startswith("1 - ") and q.value != 1.0:
            raise InputError(SAYS("order", q=q, target=target))


def bam(model: Identified, actuator: str) -> tuple[dict[str, float | str], list[str]]:
    """The parameters of a servo as BAM and those that load its files name them, and what they lack.

    Parameters
    ----------
    model : Identified
    actuator : str
        What BAM calls the servo: its firmware is there.

    Raises
    ------
    InputError
        For a model that is no joint with a servo's loop, and for a fractional order.

    Examples
    --------
    >>> bam.__name__
    'bam'
    """
    constants = model.constants
    if model.problem.model.name != "joint" or not constants["gain"].value:
        raise InputError(SAYS("no-servo"))
    _refuse_orders(model, "BAM")
    elements = "load_angle", "load_directional_angle", "stiction_angle"
    load, directional, stribeck = (constants[n].value != 0.0 for n in elements)
    name = f"m{5 if directional else 1 + 2 * load + stribeck}"
    values, rows = _Values(model, "BAM"), TABLE["bam"]
    written: dict[str, float | str] = {n: values(row["is"]) for n, row in rows.items() if name in row.get("of", name)}
    written |= {"model": name, "actuator": actuator, "source": f"fracid {__version__}, {model.run}"}
    return written, [*_lost(model, values.used | {"gain", "mass"}, "BAM")]


def _lost(model: Identified, used: set[str], target: str) -> Iterator[str]:
    """Constants that are not 0 and in no formula."""
    table, silent = TABLE["lost"], tuple(f"{n}_" for n in TABLE["silent"]["names"])
    for q in model.constants.values():
        if q.value == 0.0 or q.name in used or f"{q.name}_".startswith(silent):
            continue
        code, what = next((why for name, why in table.items() if q.name.startswith(name)), ("unknown", "such a term"))
        yield f"{q.name} = {q.value:.6g} {q.unit} is left out: {target} has no {what} [{code}]."


def mjcf(rig: Rig, heading: Sequence[str] = ()) -> str:
    """A model of MuJoCo.

    Examples
    --------
    >>> mjcf.__name__
    'mjcf'
    """
    model, case = rig.model.problem.model, rig.model.case
    angles = [model.output_states[link.joint] for link in rig.links]
    rates = [model.rates.get(i, i + 1) for i in angles]
    at = case.past[-1].tolist()
    places, speeds = (tuple(at[i] for i in states) for states in (angles, rates))
    return xml("mujoco.xml.in", rig=rig, heading=heading, step=min(case.step, 2e-3), places=places, speeds=speeds,
               gravity=(0.0, 0.0, -STANDARD_GRAVITY))  # fmt: skip


def urdf(rig: Rig, heading: Sequence[str] = ()) -> str:
    """A robot description; what it does not have stands in :func:`lost_in_urdf`.

    Examples
    --------
    >>> urdf.__name__
    'urdf'
    """
    return xml("robot.urdf.in", rig=rig, heading=heading)


def lost_in_urdf(rig: Rig) -> list[str]:
    """What a robot description lacks of what MuJoCo has, in sentences with codes.

    Examples
    --------
    >>> lost_in_urdf.__name__
    'lost_in_urdf'
    """
    why = TABLE["urdf"]
    found = {
        "drag": any(any(link.damping[1:]) for link in rig.links),
        "stiffness": any(link.stiffness for link in rig.links),
        "shaft": rig.shaft is not None,
        "drive": any(link.drive for link in rig.links),
        "zero": any(link.zero for link in rig.links),
    }
    return [f"URDF has no {why[n][1]} [{why[n][0]}]." for n, there in found.items() if there]


def heading(rig: Rig, said: Sequence[str]) -> list[str]:
    """The comment at the head of a file: where the constants are from, with their intervals.

    Examples
    --------
    >>> heading.__name__
    'heading'
    """
    known = [f"{q.name} = {q.value!r} {q.unit}: {q.description}" for q in rig.model.parameters if q.interval]
    return [f"Identified by fracid {__version__} from {rig.model.run}.", *known, *said]


def error_in_mujoco(rig: Rig, text: str) -> str:
    """How far MuJoCo is off fracid along the recording, or how to know, in a sentence.

    Examples
    --------
    >>> error_in_mujoco.__name__
    'error_in_mujoco'
    """
    if not find_spec("mujoco"):
        return "How far MuJoCo is off fracid was not measured: pip install mujoco, and export again."
    import mujoco

    case, model, own = rig.model.case, mujoco.MjModel.from_xml_string(text), rig.model.problem.model
    every = max(1, round(case.step / model.opt.timestep))
    model.opt.timestep = case.step / every
    data, found = mujoco.MjData(model), []
    mujoco.mj_resetDataKeyframe(model, data, 0)
    before, after = (np.broadcast_to(u, (case.steps + 1, u.shape[1])) for u in case.driven_after)
    inputs = [own.inputs.index(mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, k)) for k in range(model.nu)]
    for n in range(case.steps):
        found.append(data.qpos.copy())
        for k in range(every):
            data.ctrl[:] = (after[n] + (before[n + 1] - after[n]) * (k + 0.5) / every)[inputs]
            mujoco.mj_step(model, data)
    found.append(data.qpos.copy())
    states = rig.model.problem.simulate(rig.model.x, rig.model.problem.experiments[0]).states
    ours = states[:, [own.output_states[link.joint] for link in rig.links]]
    off = np.sqrt(np.mean((np.array(found) - ours) ** 2, axis=0))
    parts = ", ".join(
        f"{link.joint} {v:.2g} {own.output_unit(link.joint)} (of {w:.3g})"
        for link, v, w in zip(rig.links, off, np.ptp(ours, axis=0), strict=True)
    )
    return f"Along the recording {case.name!r}, MuJoCo {mujoco.__version__} is off fracid by {parts} rms."
