"""What JSON of a file is made of, and how it is read, written and checked: pydantic models with one base.

=================  ==========================================================================================
``Number``         a number or null, which is None
``Unknown``        a number or null, which is NaN
``Infinite``       a number or null, which is infinite
``Numbers``        a list of numbers, from an array too
``Array``          an array, in which null is NaN; infinite in an ``InfiniteArray`` and an ``InfiniteMatrix``
``Beside``         what is no part of the file
``Interval``       a list of two numbers; ``Ends``, of which the type knows that they are two; ``OpenInterval``
=================  ==========================================================================================

A dataclass that is a :class:`Record` is its own description: its fields are the keys, a key that is called otherwise
is an alias, and what follows from the fields may stand beside them (``computed_field``).  Where it has a method
``incoherence``, that says of what was read which parts do not fit together, or "".  A :class:`Block` describes what has
no class of its own, or is written from attributes of several.  Either

* **writes**: :func:`as_json`,
* **reads**: :func:`record_of`,
* **checks**: :func:`fault_of` names the place of the first fault, behind the limits of :mod:`fracid.safety.json_files`,
* **tells others**: the JSON Schema of :func:`fracid.runs.json_schemas.json_schema`.

What a file has beside the keys of its description is passed over.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from functools import cache, partial
from math import inf, nan
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self, TypeVar

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetPydanticSchema,
    PlainSerializer,
    TypeAdapter,
    ValidationError,
    computed_field,
)
from pydantic.json_schema import SkipJsonSchema
from pydantic_core.core_schema import CoreSchema, ValidationInfo, any_schema, with_info_after_validator_function

from fracid.arrays import FloatArray
from fracid.errors import InputError
from fracid.safety.door import opened, own_text, text_of
from fracid.safety.json_files import (
    LONGEST,
    excess_of,
    from_json,
    json_number,
    json_of,
    object_of,
    place,
    short_text,
    shown,
)

# --- values ------------------------------------------------------------------------------------------

AS_NULL = PlainSerializer(json_number, return_type=float | None)

Number = Annotated[float | None, AS_NULL]

null_as = partial(BeforeValidator, json_schema_input_type=float | None)

Unknown = Annotated[float, null_as(partial(from_json, otherwise=nan)), AS_NULL]

Infinite = Annotated[float, null_as(partial(from_json, otherwise=inf)), AS_NULL]

Pair = Field(strict=False, min_length=2, max_length=2)
"""Of a tuple: it is a list in JSON, and has two entries."""

Interval = Annotated[tuple[float, ...], Pair]

OpenInterval = Annotated[tuple[Number, ...], Pair]
"""Null on a side where it has no end."""

T = TypeVar("T")
Listed = Annotated[tuple[T, ...], Field(strict=False)]
"""A tuple, which is a list in JSON."""


Beside = Annotated[T, GetPydanticSchema(lambda _source, _handler: any_schema()), Field(exclude=True), SkipJsonSchema()]
"""What a record has beside the content of its file."""

UNREAD: Any = None
"""In its place where the file was read."""


def _listed(value: Any) -> Any:
    return value.tolist() if hasattr(value, "tolist") else value


Numbers = Annotated[list[float], BeforeValidator(_listed)]

if TYPE_CHECKING:
    Ends = tuple[float, float]
    computed = property
    Array = FloatArray
    InfiniteArray = FloatArray
    InfiniteMatrix = FloatArray
else:
    Ends = Interval  # which says of another length what is wrong
    computed = computed_field  # a property that is written with the fields
    _as_lists = PlainSerializer(lambda a: np.where(np.isfinite(a), a, None).tolist(), return_type=list[Any])
    _array = BeforeValidator(_listed), AfterValidator(np.array), _as_lists
    Array, InfiniteArray = (Annotated[list[value], *_array] for value in (Unknown, Infinite))
    InfiniteMatrix = Annotated[list[list[Infinite]], *_array]

# --- blocks ------------------------------------------------------------------------------------------


class Block(BaseModel):
    """A JSON object of a file; see the top of this module."""

    model_config = ConfigDict(from_attributes=True, strict=True, frozen=True, defer_build=True)


class Record:
    """A dataclass that describes its own JSON; see the top of this module."""

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(strict=True)

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """As of any dataclass; an object of JSON is read as one, while its values are not converted."""
        found = handler(source)
        own: Any = handler.resolve_ref_schema(found)
        while own["type"] != "dataclass":  # it is validated, too
            own = own["schema"]
        own["strict"] = False
        return with_info_after_validator_function(_together, found) if hasattr(cls, "incoherence") else found

    def to_json(self) -> dict[str, Any]:
        """Plain JSON values, angles in radians; a number that is not finite becomes null."""
        return as_json(type(self), self)

    @classmethod
    def of_json(cls, content: Mapping[str, Any]) -> Self:
        """Read the same from :meth:`to_json`.

        Examples
        --------
        >>> from fracid.selection.amplitude import AmplitudeTest
        >>> test = AmplitudeTest((), (), ("nothing swings",))
        >>> AmplitudeTest.of_json(test.to_json()) == test
        True
        """
        return record_of(cls, content)


def also_called(key: str, kind: Any) -> Any:
    """A field under what the pages call it; the other key goes with the version after this one.

    Parameters
    ----------
    key : str
        The field.
    kind : type
        Of its values.

    Examples
    --------
    >>> class Found(Block):
    ...     unknowns: dict[str, float]
    ...     free_parameters = also_called("unknowns", dict[str, float])
    >>> as_json(Found, {"unknowns": {"mu": 0.9}})
    {'unknowns': {'mu': 0.9}, 'free_parameters': {'mu': 0.9}}
    """
    return computed_field(return_type=kind, description=f"What the pages call {key}.")(property(attrgetter(key)))


Kind = TypeVar("Kind", bound=Block | Record)


described: Callable[[Any], TypeAdapter[Any]] = cache(TypeAdapter)
"""What pydantic knows of a block or a record."""


WRITING = "writing"


def _together(read: Any, info: ValidationInfo) -> Any:
    if info.context != WRITING and (fault := read.incoherence()):
        raise ValueError(fault)
    return read


def as_json(kind: type[Block | Record], record: Any) -> dict[str, Any]:
    """Plain JSON values of a record: of its attributes, or of what a mapping has by their names or by the keys.

    Examples
    --------
    >>> class Score(Block):
    ...     rmse: Infinite = Field(alias="rmse_rad")
    >>> as_json(Score, {"rmse": inf})
    {'rmse_rad': None}
    """
    own = described(kind).validate_python(record, strict=False, by_name=True, by_alias=True, context=WRITING)
    return dict(described(kind).dump_python(own, mode="json", by_alias=True))


def record_of(kind: type[Kind], content: Any) -> Kind:
    """The record, or the block, that JSON values describe.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True)
    ... class Trial(Record):
    ...     cost: Infinite
    >>> record_of(Trial, {"cost": None})
    Trial(cost=inf)
    """
    found: Kind = described(kind).validate_python(content)
    return found


# --- faults ------------------------------------------------------------------------------------------


def fault_of(value: Any, kind: type[Block | Record]) -> str:
    """Where a value of JSON is not of a block or record, in words; empty where it is.

    Examples
    --------
    >>> class Result(Block):
    ...     orders: dict[str, Number]
    >>> fault_of({"orders": {"mu": [1]}}, Result)
    'orders.mu is a list; expected a number'
    >>> fault_of({}, Result)
    'it has no orders'
    """
    if excess := excess_of(value):
        return excess
    try:
        record_of(kind, value)
    except ValidationError as error:
        return _sentence(*next(iter(faults_by_place(error).items())))
    return ""


EXPECTED = tomllib.loads(own_text("safety/schema.toml"))
"""What pydantic's faults mean; those not listed keep its words."""


def faults_by_place(error: ValidationError, alternatives: Iterable[str] = ()) -> dict[tuple[str | int, ...], list[Any]]:
    """Pydantic's faults by where they are, without its notes on which alternatives it tried.

    Parameters
    ----------
    error : ValidationError
    tried : iterable of str
        Models that are one of several alternatives.
    """
    notes, tried = {"float", "int", "str", "bool", *alternatives}, ("literal[", "dict[", "function-")
    faults: dict[tuple[str | int, ...], list[Any]] = {}
    for fault in error.errors(include_url=False):
        where = tuple(key for key in fault["loc"] if key not in notes and not str(key).startswith(tried))
        faults.setdefault(where, []).append(fault)
    return faults


def expected(faults: Iterable[Any], words: Mapping[str, str] = EXPECTED, **more: str) -> str:
    """What pydantic expected at a place, in words."""
    each = (words.get(f["type"], f["msg"]).format(**f.get("ctx", {}), **more) for f in faults)
    return " or ".join(dict.fromkeys(each))


def _sentence(where: tuple[str | int, ...], faults: list[Any]) -> str:
    """One plain sentence: where it is, what it is, and what was expected."""
    kind, value, context = (faults[0].get(key) for key in ("type", "input", "ctx"))
    if kind == "missing":
        return f"{place(where[:-1])} has no {where[-1]}"
    if kind in ("too_short", "too_long"):
        count = context.get("min_length", context.get("max_length"))
        return f"{place(where)} has {len(value)} entries; expected {count}"
    if kind == "value_error":
        return str(context["error"])
    return f"{place(where)} is {shown(value)}; expected {expected(faults)}"


def lacking(value: Mapping[str, Mapping[str, Any]], names: Iterable[str]) -> str:
    """The first of some mappings that lacks one of some names, in words.

    Examples
    --------
    >>> lacking({"values": {"mu": 0.9}, "intervals": {}}, ["mu"])
    'intervals has no mu'
    """
    names = tuple(names)
    return next((f"{key} has no {n}" for key, inner in value.items() for n in names if n not in inner), "")


# --- files -------------------------------------------------------------------------------------------


def read_as(path: Path, kind: type[Block | Record], wrote: str, missing: str = "") -> Any:
    """Read a JSON file of a run folder; gives its content, with what it may leave out and what follows from the rest.

    Parameters
    ----------
    path : Path
    kind : type of Block or Record
        What it must be.
    wrote : str
        The command that writes it again.
    missing : str, optional
        What is said where it is not there, or cannot be read; `path` and `error` are filled in.

    Raises
    ------
    OSError
        If it is not there, or cannot be read, and nothing is to be said.
    InputError
        If it is not so; says where.

    Examples
    --------
    >>> import tempfile
    >>> class Study(Block):
    ...     seeds: int
    >>> file = Path(tempfile.mkdtemp()) / "noise.json"
    >>> _ = file.write_text('{"seeds": "many"}')
    >>> read_as(file, Study, "fracid noise RUN")
    Traceback (most recent call last):
    fracid.errors.InputError: ...noise.json is damaged: seeds is 'many'; expected a whole number. Write it again: fracid
    noise RUN.
    """
    try:
        content = json_of(text_of(path))
        fault = fault_of(content, kind)
    except OSError as error:
        if not missing:
            raise
        raise InputError(missing.format(path=path, error=error.strerror or "it is no plain file")) from None
    except ValueError as error:
        fault = f"it cannot be read as JSON ({short_text(error)})"
    if fault:
        raise InputError(f"{path} is damaged: {fault}. Write it again: {wrote}.")
    return content | as_json(kind, content)


def read_if_whole(path: Path, kind: type[Block | Record]) -> dict[str, Any]:
    """Read a JSON file that may be missing or damaged; empty where it is.

    Examples
    --------
    >>> read_if_whole(Path("/nowhere/environment.json"), Block)
    {}
    """
    with suppress(OSError, InputError):
        return dict(read_as(path, kind, ""))
    return {}


def lines_of(path: Path, kind: type[Block | Record]) -> Iterator[Any]:
    """The lines of a log that are as they should be; none where there is no log, or one that cannot be read.

    Examples
    --------
    >>> list(lines_of(Path("/nowhere/evaluations.jsonl"), Block))
    []
    """
    with suppress(OSError), opened(path) as file:
        while line := file.readline(LONGEST):
            if (content := object_of(line)) is not None and not fault_of(content, kind):
                yield content
