"""The project file: a TOML text that says which model, which recordings, what is free, what counts.

::

    [model]                                      [[recording]]
    name = "rotary-pendulum"                     name  = "release 92°"
    rig  = "srv02-rotpen"                        file  = "release_92deg.mat"
    zero = "hanging"                             time  = { column = 0 }
    [model.parameters]                           theta = { column = 1, unit = "rad" }
    C4 = 0.1944                                  alpha = { column = 2, unit = "rad", zero = 3.14159265 }
    b_alpha = { start = 2e-4,                    from  = 9.85
                lower = -1e-2, upper = 1e-2 }    to    = 44.85
    [model.orders]                               use   = "fit"
    lambda = { start = 1.0,                      [fit]
               lower = 0.6, upper = 1.2 }        cost  = "rmse"
    mu = 1.0                                     initial_state = "estimate"

Beside its bounds a table may hold ``prior = { mean = ..., sd = ... }``, what is known of the value beforehand,
``scale``, its typical size, and ``hard = true``: a search that ends at a bound does not open it.
An input may hold its value between samples, or be a multisine: ``between = "hold"``, ``"line"`` or ``"band-limited"``
(:mod:`fracid.solver.inputs`); a voltage is held if nothing is said.
A channel may be late, scaled, offset or filtered: ``delay``, ``gain``, ``bias`` and ``lowpass`` in its table, each a
number or a range (:mod:`fracid.problem.sensors`); free ones are parameters, ``delay_alpha``.  ``mask = [[12.0, 12.5]]``
leaves samples out of the score.
A recording may have its ``weight`` and its ``release_time``, a number or a table [s].  With ``weights = "noise"``
in ``[fit]`` outputs count by their residual's level.  With ``history = "measured"``, there or in a recording, its
samples before ``from`` enter the memory.  :mod:`fracid.problem.past` has the formulas.

A number fixes, a table frees, another's name ties (``mu = "lambda"``, or ``{ tie = "lambda" }``: always the
same value), and what is left out keeps the rig's value; orders that are left out are
free in [0.5, 1.2], and angles that ``per_recording`` names within a radian of their value.  Paths are
relative to the file.  :func:`load_project` reads it all, recordings included; an unknown key or a value of
the wrong kind is told with its place in the file.

``preset = "paper"`` is the paper to the letter: gl-paper, ITAE on α alone, the orders alone, from a held
release, by its genetic algorithm.  It overrides whatever else the file says of these, takes the rig's constants where
the file gives a range, and says in what the project still differs (:mod:`fracid.problem.paper`).
"""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetPydanticSchema,
    InstanceOf,
    TypeAdapter,
    ValidationError,
    model_validator,
)
from pydantic_core import core_schema

from fracid.cards import Card, CardDisplay, brief, listed
from fracid.errors import InputError, NotTrusted, refuse_unknown, unknown_name
from fracid.findings import Note, Words, with_code
from fracid.models import MODELS, Model, Parameter, model_from_name
from fracid.models.written.equations import Equation, Equations, equations_in, unknown_units
from fracid.models.written.formulas import FormulaError
from fracid.optimise import MOST_STARTS, optimiser_from_name
from fracid.problem.checks import hidden_starts, refuse_twins, typed_starts
from fracid.problem.costs import cost_from_name
from fracid.problem.experiment import DEVIATION, Experiment, held_inputs
from fracid.problem.paper import differences, fixed
from fracid.problem.presets import PRESETS
from fracid.problem.problem import Problem, alternative_of
from fracid.problem.roles import ROTARY
from fracid.problem.sensors import QUANTITIES, Sensor, with_rates
from fracid.problem.unknowns import Free, Prior, Tied, Value, Values, Windows, starting_value
from fracid.recording import Recording, load_recording
from fracid.recording.channel import UNITS, Channel
from fracid.recording.loading import resampled
from fracid.safety.door import own_text, text_of
from fracid.safety.paths import path_of, refuse_mistaken
from fracid.safety.schema import EXPECTED, expected, faults_by_place
from fracid.safety.text import printable, refuse_unseen
from fracid.safety.user_code import is_own, refuse_untrusted
from fracid.solver.inputs import Between
from fracid.solver.memory import memory_from_name
from fracid.solver.methods import METHODS

SAYS = Words("problem/project.toml")

CHANNEL = tuple(field.name for field in fields(Channel))

ORDER_RANGE = Free(1.0, 0.5, 1.2)
"""Where an order is looked for when nothing is said: hanging motion is stable only below 1 + (2/π)·asin ζ."""

SPRINGPOT_RANGE = Free(0.5, 0.02, 1.0)
"""The same of a springpot's."""

ALTERNATIVE = "alternative"
"""What a model of an alternative's own equations is called."""

LARGEST_FILE = 2**22
"""Of a project [bytes]: 40,000 recordings, five seconds to take apart."""

MOST_KEYS = 1000
"""Of a table; the largest of a project names the parameters of a model."""

DEEPEST = 16
"""Tables and lists within each other."""

LONGEST_KEY = 100
"""Points in a key."""

LONGEST_LINE = 120
"""Characters of a line that is no TOML, in a message."""

LONGEST_MESSAGE = 600
"""Characters."""


class _Table(BaseModel):
    """A table of the file; unknown keys are refused, and so are texts and truth values for numbers."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True, defer_build=True)


def _read_as(table: type, record: Callable[[Any], Any]) -> GetPydanticSchema:
    """What makes a record of a table of the file, once that has been checked."""
    return GetPydanticSchema(
        lambda _, handler: core_schema.no_info_after_validator_function(record, handler.generate_schema(table))
    )


class _Prior(_Table):
    mean: float
    sd: float


class _Range(_Table):
    start: float
    lower: float
    upper: float
    unit: str = ""
    prior: Annotated[Prior, _read_as(_Prior, lambda table: Prior(**dict(table)))] | None = None
    scale: float | None = None
    hard: bool = False


_Free = Annotated[Free, _read_as(_Range, lambda table: Free(**dict(table)))]


class _Constant(_Table):
    """Of a model of equations."""

    value: float
    unit: str = ""


def _untied(table: Any) -> Any:
    """``{ tie = "lambda" }`` says the same as ``"lambda"``."""
    if not isinstance(table, dict):
        return table
    rows = {n: v for n, v in table.items() if isinstance(v, dict)}
    ties = {n: v["tie"] for n, v in rows.items() if v.keys() == {"tie"}}
    fixed = {n: _Constant(**v) for n, v in rows.items() if {"value"} <= v.keys() <= {"value", "unit"}}
    return table | {n: v for n, v in ties.items() if isinstance(v, str)} | fixed


_Value = float | _Free | InstanceOf[_Constant] | Annotated[Tied, _read_as(str, Tied)]

_Values = Annotated[dict[str, _Value], BeforeValidator(_untied)]


class _Equation(_Table):
    """A state's derivative, or an output: :class:`fracid.models.written.equations.Equation`."""

    equals: str
    order: float | str = 1.0
    unit: str = ""
    only: list[str] = []
    forgets: str = ""
    follows: str = ""
    size: str = ""


_Rows = Annotated[dict[str, Equation], _read_as(dict[str, str | _Equation], equations_in)]


class _Equations(_Table):
    """A model: its own equations, or what the values of another one's parameters and orders are."""

    definitions: Annotated[dict[str, Equation], _read_as(dict[str, str], equations_in)] = {}
    equations: _Rows = {}
    outputs: _Rows = {}
    parameters: _Values = {}
    orders: _Values = {}


class _Model(_Equations):
    name: str = "rotary-pendulum"
    rig: str | None = None
    zero: str | None = None
    actuation: Literal["voltage", "torque"] | None = None
    inputs: dict[str, str] = {}
    """Each one's unit, of a model of equations."""
    input_rates: dict[str, str] = {}
    """And the input of which it is the rate."""
    input_defaults: dict[str, float] = {}
    """And its value in a recording that has others."""
    scene: dict[str, dict[str, str | float | list[str | float]]] = {}

    @model_validator(mode="after")
    def _has_other_names(self) -> Self:
        """Signals are keys of a recording, beside its own."""
        keys = {field.alias or n for n, field in _Recording.model_fields.items()}
        for name in sorted(keys.intersection((*self.inputs, *(self.outputs or self.equations)))):
            raise ValueError(SAYS("key-of-recording", name=name))
        return self


_History = Literal["measured", "none"]


class _Recording(_Table):
    """Every other key of the table is a signal."""

    model_config = ConfigDict(extra="allow")
    name: str | None = None
    file: str
    time: dict[str, Any] | int | str | None = None
    start: float | Literal["release"] | None = Field(default=None, alias="from")
    stop: float | None = Field(default=None, alias="to")
    use: Literal["fit", "validate"] = "fit"
    resample: bool | float | Literal["needed", "uneven"] = "needed"
    variable: str | None = None
    initial: dict[str, float | _Free] = {}
    """States known at the start [rad], such as the angle of release, or to be found in a range."""
    weight: float = 1.0
    release_time: float | _Free = 0.0
    history: _History | None = None
    amplifier: Literal["on", "off"] | None = None
    """Whether the motor brakes by its back-EMF; off where nothing is said."""
    parameters: dict[str, float] = {}
    """What is known in this recording alone: a mass that was hung on, a gain that was set."""
    mask: list[list[float]] = []
    """From when to when samples are not scored, on the recording's own clock [s]."""


class _Fit(_Table):
    cost: str = "rmse"
    weights: str = "equal"
    outputs: list[str] | None = None
    per_recording: list[str] = []
    initial_state: str = "estimate"
    history: _History = "none"
    windows: Windows = "auto"
    method: str = "pi2"
    memory: str = "compressed"
    tolerance: float = 1e-10
    substeps: int | None = Field(default=None, ge=1)
    """None: chosen by the fit."""
    optimiser: str = "multistart"
    starts: int = Field(default=1, ge=1, le=MOST_STARTS)
    seed: int = Field(default=1, ge=0)
    preset: str | None = None


class _Alternative(_Equations):
    """A model of integer order that the orders are held against."""

    name: str
    model: str = ""
    """Another one's name; "" for equations, whose inputs are those of the project's model."""


class _File(_Table):
    model: _Model = _Model()
    alternative: list[_Alternative] = []
    recording: list[_Recording] = Field(min_length=1)
    fit: _Fit = _Fit()


@dataclass(frozen=True, repr=False)
class Project(CardDisplay):
    """A project file with its recordings loaded."""

    path: Path
    text: str
    """The file as it was read."""
    problem: Problem
    validation: tuple[Experiment, ...]
    """The recordings with use = "validate"."""
    recordings: tuple[Recording, ...]
    """All, in the file's order, with their reports."""
    optimiser: str
    starts: int
    seed: int
    preset: str | None
    notes: tuple[str, ...] = ()
    """What was done that the file does not say in so many words."""
    alternatives: Mapping[str, Problem] = field(default_factory=dict)
    """Models of integer order that its orders are held against, by name, on the recordings that are fitted."""
    fixed_step: bool = True
    """Whether the file says its ``substeps``, or its method is the paper's; else the fit chooses them."""
    own_code: tuple[Path, ...] = ()
    """Files of its own whose code was run: it is trusted."""

    def _card(self) -> Card:
        held_out = {e.name for e in self.validation}
        recordings = (f"{r.name}{' (validate)' * (r.name in held_out)}" for r in self.recordings)
        return Card(f"Project {self.path.name}: {self.problem.model.name}", (
            ("recordings", listed(recordings)),
            *self.problem._card().rows[1:],
            ("search", f"{self.optimiser}, {self.starts} starts, seed {self.seed}"),
            ("notes", brief(self.notes)),
        ), (("file", str(self.path)),))  # fmt: skip

    @property
    def resolutions(self) -> dict[str, dict[str, float | None]]:
        """Recording → signal → the step of its encoder [rad]; None where none is seen."""
        return {r.name: {s.name: s.resolution for s in r.report.signals} for r in self.recordings}


def load_project(path: str | Path, *, preset: str | None = None, trust: bool = False) -> Project:
    """Read a project file and the recordings that it names.

    Parameters
    ----------
    path : str or Path
    preset : str, optional
        In place of the file's own.
    trust : bool
        Run Python code that it refers to, a model or a cost in a file.  Review it first.

    Raises
    ------
    InputError
        If the file is missing, is no TOML, or says something that cannot be; with the place.
    NotTrusted
        If it names code of its own, and `trust` is not given.
    DataError
        If a recording fails its checks.

    Examples
    --------
    >>> import tempfile, numpy as np
    >>> folder = Path(tempfile.mkdtemp())
    >>> time = np.arange(0, 2, 0.01)
    >>> np.savez(folder / "swing.npz", time=time, alpha=0.1 * np.cos(6 * time))
    >>> _ = (folder / "rig.toml").write_text('[[recording]]\\nfile = "swing.npz"\\nalpha = { column = "alpha" }')
    >>> project = load_project(folder / "rig.toml")
    >>> project.problem.outputs, project.problem.names[:2]
    (('alpha',), ('lambda', 'mu'))
    """
    path = path_of(path, "'rig.toml'")
    return project_from_text(_text(path), path, preset=preset, trust=trust)


def _text(path: Path) -> str:
    """Read a project file; of a pipe or device nobody knows the end, and a recording by mistake may be large."""
    try:
        refuse_mistaken(path, "project")
        return text_of(path, LARGEST_FILE, "utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"The project file {path} cannot be read: it is not UTF-8 text; save it as UTF-8.") from None
    except (OSError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"The project file {path} cannot be read: {getattr(error, 'strerror', error)}.") from None


def project_from_text(text: str, path: Path, *, preset: str | None = None, trust: bool = False) -> Project:
    """Read a project from the text of a file; `path` says where its relative paths lead from, and is not read.

    Errors are those of :func:`load_project`.

    Examples
    --------
    >>> project_from_text("[[recording]]", Path("rig.toml"))
    Traceback (most recent call last):
    fracid.errors.InputError: rig.toml: [[recording]] number 1: file is missing.
    """
    try:
        return _project(path, text, _File.model_validate(_toml(text)), preset, trust=trust)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path} is not TOML: {_short(_not_toml(error, text))}") from None
    except ValidationError as error:
        raise InputError(f"{path}: {_short(_explain(error))}") from None
    except NotTrusted:
        raise
    except InputError as error:
        raise InputError(f"{path}: {error if isinstance(error, FormulaError) else _short(error)}") from None


def _not_toml(error: tomllib.TOMLDecodeError, text: str) -> str:
    """The parser's sentence, the line that it is about, and what was likely meant."""
    place = re.search(r"line (\d+)", str(error))
    lines = text.splitlines()
    line = lines[int(place[1]) - 1].partition("#")[0].strip() if place and int(place[1]) <= len(lines) else ""
    if len(line) > LONGEST_LINE:
        return f"{error}. The line begins: {line[:LONGEST_LINE]}"
    return f"{error}.{f' The line is: {line}' if line else ''}{_meant(line)}"


def _meant(line: str) -> str:
    """What to type in place of a line that is no TOML; "" where nobody knows."""
    key, _, value = (part.strip() for part in line.partition("="))
    if "\\" in value:
        path = value.strip("\"'")
        return f". In double quotes a \\ begins a code: type / instead, or single quotes: {key} = '{path}'"
    if number := re.fullmatch(r"([-+]?\d+),(\d+)", value):
        return f". Type a decimal point: {key} = {number[1]}.{number[2]}"
    if re.fullmatch(r"[^\W\d][\w .:/-]*", value):
        return f'. Put text in quotes: {key} = "{value}"'
    return ""


def _toml(text: str) -> dict[str, Any]:
    """Parse, and refuse what no project says and Python stumbles over: depths and whole numbers without end."""
    if any(line.partition("=")[0].count(".") > LONGEST_KEY for line in text.splitlines()):  # it takes their square
        raise InputError(f"a key has more than {LONGEST_KEY} points; a project's has two.")
    try:
        content = tomllib.loads(text)
    except RecursionError:
        raise InputError("its tables or lists lie too deep in each other; a project has three levels.") from None
    except ValueError as error:
        if isinstance(error, tomllib.TOMLDecodeError):
            raise
        raise InputError("it holds a whole number of thousands of digits.") from None
    level: list[Any] = [content]
    for _ in range(DEEPEST):
        level = [v for item in level for v in (item.values() if isinstance(item, dict) else item)]
        if any(isinstance(v, int) and v.bit_length() > 63 for v in level):
            raise InputError("it holds a whole number of more than 18 digits; write it with a point if it is meant.")
        level = [v for v in level if isinstance(v, dict | list)]
        if any(isinstance(v, dict) and len(v) > MOST_KEYS for v in (content, *level)):
            raise InputError(f"it holds a table of more than {MOST_KEYS} keys; a project has no such table.")
    if level:
        raise InputError(f"its tables or lists lie more than {DEEPEST} deep in each other; a project has three levels.")
    return content


def _short(message: object) -> str:
    """In one line that can be seen whole: what a file says may be of any length, and lie in any message."""
    line = printable(" ".join(str(message).split()))
    return line if len(line) <= LONGEST_MESSAGE else f"{line[: LONGEST_MESSAGE - 200]} … {line[-190:]}"


def _project(path: Path, text: str, content: _File, preset: str | None, trust: bool) -> Project:
    if (preset := preset or content.fit.preset) is not None:
        refuse_unknown("preset", PRESETS, preset)
    fit, paper = content.fit.model_copy(update=PRESETS.get(preset or "", {})), preset == "paper"
    named = (content.model.name, *(a.model for a in content.alternative), fit.cost)
    own_code = refuse_untrusted(path, named, trust)
    optimiser_from_name(fit.optimiser)
    model, parameters = _model(content.model, path.parent, paper)
    if paper and "alpha" not in model.outputs:
        raise InputError(SAYS("not-paper", model=model, outputs=", ".join(model.outputs)))
    model = with_rates(model, (n for r in content.recording for n in r.model_extra or {}))
    orders = _orders(content.model.orders, model)
    refuse_twins(map(_name, content.recording))  # before any is loaded: a thousand copies of one table are a slip, too
    channels = [_channels(r, model) for r in content.recording]
    pasts = [not paper and (r.history or fit.history) == "measured" for r in content.recording]
    each = zip(content.recording, channels, pasts, strict=True)
    loaded = [_load(r, c, model, path.parent, past=past, whence=_whence(text)) for r, c, past in each]
    outputs = tuple(_common_outputs(model, loaded) if fit.outputs is None else fit.outputs)
    experiments = [_experiment(one, model, outputs) for one in loaded]
    if paper:
        experiments = [fixed(e) for e in experiments]
        orders = {n: v if isinstance(v, Free) else ORDER_RANGE for n, v in orders.items()}
    used = [*zip(experiments, (r.use for r in content.recording), strict=True)]
    fitted, validation = (tuple(e for e, use in used if use == kind) for kind in ("fit", "validate"))
    if not fitted:
        raise InputError('no [[recording]] has use = "fit"; at least one must be fitted.')
    parameters |= _freed_by_recording(fit.per_recording, experiments, parameters, model)
    cost = cost_from_name(str(path.parent / fit.cost) if ".py:" in fit.cost else fit.cost)
    problem = Problem(
        model, fitted, orders, parameters, per_recording=tuple(fit.per_recording), outputs=outputs, cost_function=cost,
        initial_state=fit.initial_state, method=fit.method, memory=memory_from_name(fit.memory, fit.tolerance),  # type: ignore[arg-type]
        substeps=fit.substeps or 1, weights=fit.weights, windows=fit.windows,  # type: ignore[arg-type]
    )  # fmt: skip
    recordings = tuple(one.recording for one in loaded)
    notes = [f"{r.name}: {r.report.resampled}" for r in recordings if r.report.resampled]
    notes += _shared(loaded, experiments, outputs)
    notes += [f"{r.name}: {note}" for r in recordings for code in ("interpolated", "other-header")
              for note in with_code(r.report.reading, code)]  # fmt: skip
    starts = {e.name: hidden_starts(problem, e) for e in fitted}
    notes += [SAYS("begins-at-0", name=name, states=" and ".join(around), typed=typed_starts(around))
              for name, around in starts.items() if around]  # fmt: skip
    if content.model.equations:
        notes += unknown_units({p.name: p.unit for p in model.parameters} | {**model.input_units})
        notes += [SAYS("no-input", name=n, recording=r.name, unit=unit) for r in recordings
                  for n, unit in content.model.inputs.items()
                  if n not in (*r.signals, *model.input_rates, *model.input_defaults)]  # fmt: skip
    if paper:
        given = {n: float(v) for n, v in content.model.parameters.items() if isinstance(v, float | int)}
        notes.append(differences(problem, content.model.rig, given))
    return Project(
        path, text, problem, validation, recordings=recordings, optimiser=fit.optimiser, starts=fit.starts,
        seed=fit.seed, preset=preset, notes=tuple(notes),
        alternatives=_alternatives(content.alternative, problem, path.parent),
        fixed_step=fit.substeps is not None or METHODS[problem.method].raw, own_code=own_code,
    )  # fmt: skip


def _alternatives(specs: list[_Alternative], problem: Problem, folder: Path) -> dict[str, Problem]:
    alternatives = {refuse_unseen("the alternative's name", a.name): _alternative(a, problem, folder) for a in specs}
    if len(alternatives) < len(specs):
        raise InputError("two alternatives have the same name; give each its own.")
    return alternatives


def _alternative(spec: _Alternative, problem: Problem, folder: Path) -> Problem:
    """The same recordings with another model, every order of which is an integer."""
    base = problem.model
    shared = {"inputs": {n: base.input_units.get(n, "") for n in base.inputs}, "input_rates": {**base.input_rates},
              "input_defaults": {**base.input_defaults}}  # fmt: skip
    own = {n: getattr(spec, n) for n in _Equations.model_fields}
    if bool(spec.model) == bool(spec.equations):
        raise InputError(SAYS("alternative-without-model", spec=spec))
    named = {"name": spec.model} if spec.model else {"name": ALTERNATIVE, **shared}
    model, parameters = _model(_Model.model_construct(**own, **named), folder, paper=False)
    orders = _orders(spec.orders, model)
    outputs = tuple(n for n in problem.outputs if n in model.outputs)
    pairs = {"inputs": (problem.model.inputs, model.inputs), "outputs": (problem.outputs, outputs)}
    for kind, (ours, theirs) in pairs.items():
        if theirs != ours:
            raise InputError(SAYS("other-names", spec=spec, kind=kind, theirs=', '.join(theirs) or 'none',
                                  ours=', '.join(ours)))  # fmt: skip
    values = [*orders.values(), *(q for q in model.orders if isinstance(q, float | int))]
    if model.complements or not all(isinstance(q, float | int) and float(q).is_integer() for q in values):
        raise InputError(SAYS("orders-not-integer", spec=spec, order=(model.order_names or ("q",))[0]))
    return alternative_of(problem, model, orders, parameters)


def _model(spec: _Model, folder: Path, paper: bool) -> tuple[Model, dict[str, Value]]:
    """The model with every parameter at its start, and those of the file that are its own.

    The paper's recipe fixes what is free: at the rig's value where one is named, else at the start.
    """
    parameters = _plain(spec.parameters)
    if paper:
        parameters = {n: v.start if isinstance(v, Free) else v for n, v in parameters.items()
                      if not (isinstance(v, Free) and spec.rig is not None)}  # fmt: skip
    starts = {n: starting_value(v) for n, v in parameters.items() if not isinstance(v, Tied)}
    if spec.equations:
        return _of_equations(spec, parameters), parameters
    for key in ("inputs", "input_rates", "input_defaults", "definitions", "outputs", "scene"):
        if getattr(spec, key):
            raise InputError(SAYS("of-equations", key=key))
    model = model_from_name(spec.name, spec.rig, spec.zero, spec.actuation, parameters=starts, folder=folder)
    for name, value in parameters.items():
        if isinstance(value, Tied):
            model.parameter(name)
        if name not in model.parameter_names and isinstance(value, Free):  # the paper's C2, C5, I2xx
            raise InputError(SAYS("converted", name=name, names=", ".join(model.parameter_names)))
    return model, {n: v for n, v in parameters.items() if n in model.parameter_names}


def _of_equations(spec: _Model, parameters: Values) -> Model:
    """The model that the file's own equations are; nothing of them is run."""
    if spec.name in MODELS or is_own(spec.name):
        raise InputError(SAYS("other-model", spec=spec))
    for key in ("rig", "zero", "actuation"):
        if getattr(spec, key) is not None:
            raise InputError(f"[model] {key} means nothing for a model of equations; leave it out.")
    roots = {n: parameters.get(v.to, v) if isinstance(v, Tied) else v for n, v in parameters.items()}
    units = {n: v.unit for n, v in spec.parameters.items() if isinstance(v, Free | _Constant)}
    starts = {n: starting_value(v) for n, v in roots.items() if not isinstance(v, Tied)}
    constants = [Parameter(n, units.get(n, ""), start, "") for n, start in starts.items()]
    written = Equations(spec.equations, spec.outputs, spec.inputs, spec.definitions, scene=spec.scene)
    model = written.model(spec.name, constants)
    return replace(model, input_rates=spec.input_rates, input_defaults=spec.input_defaults)


def _plain(values: Mapping[str, _Value]) -> dict[str, Value]:
    return {n: v.value if isinstance(v, _Constant) else v for n, v in values.items()}


def _freed_by_recording(
    per_recording: list[str], experiments: list[Experiment], parameters: Values, model: Model
) -> dict[str, Value]:
    """An angle that `per_recording` names is free within a radian of its value, where no range is given for it."""
    channels = [pair for e in experiments for pair in {**e.sensors, **e.actuators}.items()]
    of_channels = {n for channel, sensor in channels for n in sensor.free(channel)}
    values = {n: parameters.get(n, model.parameter(n).value) for n in per_recording if n not in of_channels}
    numbers = {n: v for n, v in values.items() if not isinstance(v, Free | Tied)}
    return {n: Free(v, v - 1.0, v + 1.0) for n, v in numbers.items() if model.parameter(n).unit == "rad"}


class _Channels(NamedTuple):
    """The signals of a recording, the keys that pydantic did not know."""

    columns: dict[str, Any]
    """Where each is in the file, and in which unit."""
    sensors: dict[str, Sensor]
    """What stands between it and the model."""
    between: dict[str, Between]
    """What an input does between its samples."""


def _channels(spec: _Recording, model: Model) -> _Channels:
    """Part the tables of the signals."""
    channels = _Channels(dict(spec.model_extra or {}), {}, {})
    for name, table in [*channels.columns.items()]:
        if isinstance(table, dict) and name in (*model.outputs, *model.inputs):
            if "constant" in table and name in model.inputs:
                continue
            known = (*CHANNEL, *QUANTITIES, *(("between", "constant") if name in model.inputs else ("sd",)))
            refuse_unknown(f"field of {name}", known, *table)
            channels.columns[name] = {key: value for key, value in table.items() if key in CHANNEL}
            if "sd" in table:
                channels.columns[f"{name}{DEVIATION}"] = _deviation(channels.columns[name], name, table["sd"])
            values = {key: _of_sensor(name, key, value) for key, value in table.items() if key in QUANTITIES}
            try:
                channels.sensors.update({name: Sensor(**values)} if values else {})
            except InputError as error:
                raise InputError(f"[[recording]] {spec.name or spec.file}: {name}: {error}") from None
            if "between" in table:
                channels.between[name] = table["between"]
    return channels


def _deviation(channel: Mapping[str, Any], name: str, column: Any) -> dict[str, Any]:
    """The column of an output's standard deviations: in its unit, without its sign and zero."""
    if isinstance(column, bool) or not isinstance(column, int | str):
        raise InputError(SAYS("not-a-column", name=name, column=column))
    same = {key: value for key, value in channel.items() if key in ("unit", "counts_per_turn")}
    scale = channel.get("scale", 1.0)
    return {**same, "column": column, "scale": abs(scale) if isinstance(scale, int | float) else scale}


QUANTITY: TypeAdapter[float | Free] = TypeAdapter(float | _Free, config=ConfigDict(strict=True, defer_build=True))


def _of_sensor(channel: str, key: str, value: Any) -> float | Free:
    """A number, or the range of a value to be found."""
    try:
        return QUANTITY.validate_python(value)
    except ValidationError as error:
        for fault in error.errors():
            if fault["type"] == "value_error":
                raise InputError(f"{key} of {channel}: {fault['ctx']['error']}") from None
        raise InputError(SAYS("channel-value", channel=channel, key=key, value=value)) from None


def _whence(text: str) -> str:
    """What the head of a project says of where its recordings are; empty where it says nothing.

    Examples
    --------
    >>> _whence("# A release.\\n# The recordings are others' (github them/rig): put them beside this file.\\n[model]")
    "The recordings are others' (github them/rig): put them beside this file."
    """
    found = re.search(r"^# ?((?:The recordings? (?:is|are)|Recordings:) .*)$", text, re.MULTILINE)
    return "" if found is None else printable(found[1].strip())


class _Loaded(NamedTuple):
    """A ``[[recording]]``, and what is in its file."""

    spec: _Recording
    channels: _Channels
    recording: Recording
    before: Recording | None
    """What came before its start, where that is asked for."""


def _load(spec: _Recording, channels: _Channels, model: Model, folder: Path, past: bool, whence: str) -> _Loaded:
    columns = channels.columns
    signals = (*model.outputs, *model.inputs)
    for name in columns:
        if name not in signals and name.removesuffix(DEVIATION) not in model.outputs:
            known = (*signals, "from", "to", "file", "time", "use", "resample")
            other = model.name == ROTARY and name in ("voltage", "torque")
            unknown = unknown_name(f"key of [[recording]] {spec.name or spec.file}", name, known)
            raise InputError(f"{unknown}{SAYS('actuation', name=name) if other else ''}")
    if not columns:
        raise InputError(SAYS("no-signal", file=spec.name or spec.file,
                              signal=signals[-2] if len(signals) > 1 else signals[0]))  # fmt: skip
    name = _name(spec)
    if past and spec.start is None:
        raise InputError(SAYS("history-without-start", name=name))
    if isinstance(spec.start, float) and spec.stop is not None and spec.start >= spec.stop:
        raise InputError(f"{name}: from = {spec.start:g} is not before to = {spec.stop:g}.")
    if whence and not (folder / spec.file).exists():
        raise InputError(f"no file {folder / spec.file}. The project says: {whence}")
    load = partial(
        load_recording, folder / spec.file, time=spec.time, start=None if past else spec.start, stop=spec.stop,
        name=name, variable=spec.variable, resample="uneven" if spec.resample == "uneven" else None,
        outputs=[n for n in columns if n not in model.inputs],
    )  # fmt: skip
    recording = load(columns)
    headers, units = with_code(recording.report.reading, "header-taken-as"), {**model.input_units, **model.output_units}
    said = {n: model.unit_of(n) for n in signals if n in recording.assumed}  # by the model, no file
    own = {n: unit if unit in UNITS else "1" for n, unit in said.items() if unit != "rad"}
    if own:
        recording = load(columns | {n: replace(Channel.of(columns[n]), unit=unit) for n, unit in own.items()})
    held = {n for n, between in (held_inputs(recording.units, model) | channels.between).items() if between == "hold"}
    unlike = {n.where: unit for n in headers if (unit := units.get(n.where, "1")) != "1" and repr(unit) not in n}
    told = [Note(SAYS("other-header", name=n, unit=unit, typed=unit if unit in UNITS else "1"), "other-header", n)
            for n, unit in unlike.items()]  # fmt: skip
    report = replace(recording.report, reading=(*recording.report.reading, *told))
    recording = resampled(replace(recording, held=recording.held | held, report=report), spec.resample)
    recording = recording.masked(spec.mask)
    if not past:
        return _Loaded(spec, channels, recording, None)
    after = recording.trim(spec.start)
    before = recording.trim(None, after.time[0] - 0.5 * after.report.clock.step)
    return _Loaded(spec, channels, after, before)


def _experiment(loaded: _Loaded, model: Model, outputs: tuple[str, ...]) -> Experiment:
    """What a problem uses of a recording."""
    spec, channels, recording, before = loaded
    return Experiment.of(
        recording, model, outputs, spec.initial, before=before, weight=spec.weight, release_time=spec.release_time,
        sensors={n: sensor for n, sensor in channels.sensors.items() if n in outputs},
        actuators={n: sensor for n, sensor in channels.sensors.items() if n in model.inputs},
        between=channels.between, mask=spec.mask, constants=_constants(recording.name, spec, model),
    )  # fmt: skip


def _constants(recording: str, spec: _Recording, model: Model) -> dict[str, float]:
    """What a recording knows for itself; what goes by its amplifier is 0 where it does not say that this is on."""
    switches = {p.name: p.switch for p in model.parameters if p.switch}
    if spec.amplifier is not None and "amplifier" not in switches.values():
        raise InputError(SAYS("amplifier", recording=recording, spec=spec, model=model))
    refuse_unknown(f"parameter of {recording}", model.parameter_names, *spec.parameters)
    off = {n: 0.0 for n, switch in switches.items() if switch != "amplifier" or spec.amplifier != "on"}
    return off | spec.parameters


def _name(spec: _Recording) -> str:
    return refuse_unseen("the recording's name", spec.name or Path(spec.file).stem)


def _shared(loaded: list[_Loaded], experiments: list[Experiment], outputs: tuple[str, ...]) -> Iterator[str]:
    """Say which recordings score the same samples of a column: these count twice, or judge what was fitted to them."""
    columns = [{(r.sha256, spec.variable, Channel.of(channels.columns[n]).column) for n in outputs}
               for spec, channels, r, _ in loaded]  # fmt: skip
    each = [(one.recording, e, own) for one, e, own in zip(loaded, experiments, columns, strict=True)]
    for (one, e, own), (other, f, others) in combinations(each, 2):
        if own.isdisjoint(others):
            continue
        there = np.interp(one.time, other.time, np.any(f.scored, axis=1), left=0, right=0)
        both = one.time[(there > 0.5) & np.any(e.scored, axis=1)]
        if len(both) > 1:
            yield SAYS("same-samples", one=one, other=other, begin=both[0], end=both[-1])


def _orders(specs: Mapping[str, _Value], model: Model) -> dict[str, Value]:
    """Those that are left out are free."""
    refuse_unknown("order in [model.orders]", model.order_names, *specs)
    springpots = dict.fromkeys(model.springpot_orders.values(), SPRINGPOT_RANGE)
    return dict.fromkeys(model.order_names, ORDER_RANGE) | springpots | _plain(specs)


def _common_outputs(model: Model, loaded: list[_Loaded]) -> list[str]:
    outputs = [n for n in model.outputs if all(n in one.recording.signals for one in loaded)]
    if not outputs:
        raise InputError(f"the recordings share none of the outputs {', '.join(model.outputs)}; score at least one.")
    return outputs


# --- what pydantic says, in our words ----------------------------------------------------------------


TABLES = EXPECTED | tomllib.loads(own_text("problem/expected.toml"))
"""What pydantic's faults mean in TOML."""


def _explain(error: ValidationError) -> str:
    """Turn the faults into sentences, one for each place in the file."""
    found = faults_by_place(error, alternatives=["_Range", "is-instance[_Constant]", "_Equation"])
    said = {p: [f for f in of_one if f["type"] != "is_instance_of"] for p, of_one in found.items()}
    faults = {p: of_one for p, of_one in said.items() if of_one}
    outer = {p[:k] for p in faults for k in range(len(p))}
    inner = [p for p in faults if p not in outer]
    inner.sort(key=lambda p: all(fault["type"] != "extra_forbidden" for fault in faults[p]))  # unknown keys first
    return " ".join(_sentence(p, faults[p]) for p in inner[:3])


def _sentence(path: tuple[Any, ...], faults: list[Any]) -> str:
    where, kinds = _place(list(path)), [fault["type"] for fault in faults]
    if "extra_forbidden" in kinds:
        return f"{where} is unknown; {_close(path)}"
    if "value_error" in kinds:
        return f"{where}: {faults[kinds.index('value_error')]['ctx']['error']}"
    if "missing" in kinds:
        return f"{where} is missing."
    keys = next((_keys(fault) for fault in faults if fault["type"] == "model_type"), "")
    value = faults[0]["input"]
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    typed = "of tables: type [[recording]] above each" if path == ("recording",) else "[...]"
    typed = f'["{value}"]' if isinstance(value, str) else typed
    return f"{where} = {text}; expected {expected(faults, TABLES, keys=keys, typed=typed)}."


def _keys(fault: Any) -> str:
    """What the table must hold that a fault misses: ``mean = ..., sd = ...``."""
    tables: dict[str, type[_Table]] = {"_Range": _Range, "_Prior": _Prior, "_Equation": _Equation}
    table = tables.get(fault.get("ctx", {}).get("class_name", ""), _Table)
    required = [n for n, f in table.model_fields.items() if f.is_required()]
    return ", ".join(f"{n} = ..." for n in required) or "..."


def _place(path: list[Any]) -> str:
    """``["recording", 0, "file"]`` → ``[[recording]] number 1: file``."""
    if path and path[0] in ("recording", "alternative"):
        number = f" number {path[1] + 1}" if len(path) > 1 else ""
        return f"[[{path[0]}]]{number}" + "".join(f": {p}" for p in path[2:])
    table, key = ".".join(map(str, path[:-1])), str(path[-1]) if path else ""
    return f"[{table}] {key}" if table else f"[{key}]"


def _close(path: tuple[Any, ...]) -> str:
    """The nearest known key, or all of them."""
    tables: dict[tuple[Any, ...], type[_Table]] = {(): _File, ("model",): _Model, ("fit",): _Fit}
    tables |= {path[:2]: _Alternative} if path[0] == "alternative" else {}
    tables |= {path[:-1]: _Equation} if {"equations", "outputs"}.intersection(path[-3:-2]) else {}
    if path[-1] == "value":
        return SAYS("value-beside")
    table = _Prior if path[-2:-1] == ("prior",) else tables.get(path[:-1], _Range)
    keys = [*table.model_fields]
    match = difflib.get_close_matches(str(path[-1]), keys, 1)
    return f"did you mean {match[0]!r}?" if match else f"the known ones are {', '.join(keys)}."
