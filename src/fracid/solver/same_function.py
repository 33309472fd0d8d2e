"""When two functions are the same: equal code, and equal values of all that it refers to.

A project that is loaded twice runs its model's file twice, and each time there is a new function.  To compile it again
would take half a second and a megabyte that Numba never gives back, so what was compiled for one serves for the other.
Equal code is not enough: that of ``times(2)`` and ``times(3)`` below is equal, and so is that of a function that uses a
constant of its file, which was changed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Hashable, Iterator
from functools import lru_cache
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np


class SameCode:
    """A function as the key of a cache: equal to another of the same meaning.

    Where it refers to something whose value cannot be told, such as an object of a class, it is equal to itself alone.

    Examples
    --------
    >>> def times(k):
    ...     return lambda x: k * x
    >>> SameCode(times(2)) == SameCode(times(2)), SameCode(times(2)) == SameCode(times(3))
    (True, False)
    """

    __slots__ = ("_hash", "_meaning", "function")

    def __init__(self, function: Any) -> None:
        """Look at a function; `function` stays at hand."""
        self.function = function
        try:
            self._meaning: Hashable = _meaning(function, ())
        except _Unknown:
            self._meaning = function
        self._hash = hash(self._meaning)

    def __eq__(self, other: object) -> bool:
        """Whether the two mean the same."""
        return isinstance(other, SameCode) and self._hash == other._hash and self._meaning == other._meaning

    def __hash__(self) -> int:
        """Of the meaning."""
        return self._hash


def once_for_equals(made_of: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Make a function of a function that is asked once for all functions that mean the same.

    Examples
    --------
    >>> @once_for_equals
    ... def look(function):
    ...     print("looked")
    ...     return function(3)
    >>> def times(k):
    ...     return lambda x: k * x
    >>> look(times(2)), look(times(2))
    looked
    (6, 6)
    """
    of_equals = lru_cache(maxsize=128)(lambda key: made_of(key.function))

    @lru_cache(maxsize=128)  # asked at every simulation: the same function is found at once
    def of_one(function: Any) -> Any:
        return of_equals(SameCode(function))

    of_one.__doc__ = made_of.__doc__
    return of_one


class _Unknown(Exception):
    """Something is referred to whose value cannot be told."""


def _meaning(function: Any, within: tuple[int, ...]) -> Hashable:
    """Code, defaults, what it closes over, and the globals that it names; `within` are the functions around it."""
    if not isinstance(function, FunctionType):
        raise _Unknown
    if id(function) in within:
        return "itself", within.index(id(function))
    within = (*within, id(function))
    closed = [_value(cell.cell_contents, within) for cell in function.__closure__ or ()]
    names = sorted(set(_names(function.__code__)) & function.__globals__.keys())
    there = [(name, _value(function.__globals__[name], within)) for name in names]
    defaults = _value((function.__defaults__, tuple((function.__kwdefaults__ or {}).items())), within)
    return function.__code__, defaults, tuple(closed), tuple(there)


def _names(code: CodeType) -> Iterator[str]:
    """Names of globals, and of attributes, in a function and in those inside it."""
    yield from code.co_names
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            yield from _names(inner)


def _value(value: Any, within: tuple[int, ...]) -> Hashable:
    if value is None or isinstance(value, bool | int | float | complex | str | bytes):
        return type(value).__name__, repr(value)  # 1 is not True, and 0.0 not -0.0
    if isinstance(value, np.ndarray | np.generic) and not value.dtype.hasobject:
        array = np.ascontiguousarray(value)
        return type(value).__name__, array.dtype.str, array.shape, hashlib.sha256(array.tobytes()).hexdigest()
    if isinstance(value, tuple):
        return "tuple", tuple(_value(v, within) for v in value)
    if isinstance(value, ModuleType | type) or type(value).__name__ in ("builtin_function_or_method", "ufunc"):
        return "one of a kind", id(value)  # the package's own, there for good
    inner = getattr(value, "py_func", None)  # Numba's
    if inner is not None:
        return "compiled", repr(getattr(value, "targetoptions", None)), _meaning(inner, within)
    return _meaning(value, within)
