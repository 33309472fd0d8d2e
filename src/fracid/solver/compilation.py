"""How fracid compiles its loops: with Numba, for one signature each, at the first call, and kept on disk.

Numba compiles a function with a given signature when it is defined.  That is half a minute for all the schemes and
memories, of which a run needs a third; so they are compiled when they are called.  A given signature is needed all
the same: a right-hand side has to come in as a function pointer, or each would have the loops compiled for itself.

**What is kept.**  Compiled code lies where Numba keeps it: in ``__pycache__`` beside the module, or in the folder that
``NUMBA_CACHE_DIR`` names, or in the user's cache folder; the first that can be written.  A file is

    SHA-256 of (mark · content)  ·  content,

its mark says for which function, signature, processor, versions and sources it was compiled, and so does its name.
What Numba does by itself looks only at the function's own module, and believes what it reads.  Here code is
compiled anew where *any* of the modules that loops are made of has changed, and where a file is broken, torn, or
another's: written by a second process at the same time, or for another processor on a shared disk.  Where nothing can
be written, nothing is kept.
"""

from __future__ import annotations

import gc
import hashlib
import logging
import pickle
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, wraps
from pathlib import Path
from typing import Any

import llvmlite  # type: ignore[import-untyped]
import numba as nb
from numba import types
from numba.core import cgutils
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.extending import intrinsic

from fracid.safety.door import bytes_of

LOG = logging.getLogger("fracid.compilation")
"""Hears when something has to be compiled."""
LOG.setLevel(logging.INFO)

SOURCES = ("solver/*.py", "models/*.py")
"""The modules that loops are made of; ``tests/solver/test_compilation.py`` looks for others."""

_OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy"}


class _Library(JITCodeLibrary):  # type: ignore[misc]
    """Code that is optimised once, with all that it is linked from.

    Its loops over a few states gain nothing from vectors, but for those that :mod:`fracid.solver.history` writes.
    """

    def _optimize_functions(self, _: Any) -> None:
        """None is optimised alone."""

    def _optimize_final_module(self) -> None:
        passes, builder = self._codegen._module_pass_manager(loop_vectorize=False)
        passes.run(self._final_module, builder)


class _PartLibrary(_Library):
    """Code that is optimised and made for the processor where it is linked into, and not by itself as well."""

    codegen = property(lambda self: self)

    def set_env(self, *_: Any) -> None:
        """No part raises what needs it."""

    def get_pointer_to_function(self, _: str) -> int:
        """It has no wrapper for Python."""
        self._ensure_finalized()
        return 0

    def _optimize_final_module(self) -> None:
        """It is optimised with what it is linked into."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


class _Loop(Compiler):  # type: ignore[misc]
    """Compiles in nine tenths of the time that Numba takes by itself, to the same numbers."""

    made: type[_Library] = _Library

    def __init__(self, typing: Any, target: Any, library: Any, *more: Any) -> None:
        library = library or self.made(target.codegen(), "loop")
        library.enable_object_caching()
        super().__init__(typing, target, library, *more)


class _Part(_Loop):
    made = _PartLibrary


LOOP: dict[str, Any] = _OPTIONS | {"_nrt": False, "pipeline_class": _Loop}
"""Of what allocates nothing, and whose inner loops are over a few states."""

PART: dict[str, Any] = _OPTIONS | {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, "pipeline_class": _Part}
"""Of what only compiled functions call: it takes a third less time to compile."""

helper = nb.njit(**PART)

VECTOR, MATRIX, INDICES = types.float64[::1], types.float64[:, ::1], types.int64[::1]
"""The arrays of which most signatures are made."""

RHS_SIGNATURE = types.void(types.float64, *[VECTOR] * 4)
"""rhs(t, x, u, p, out): the one signature of every right-hand side."""

RHS = types.FunctionType(RHS_SIGNATURE)
"""A pointer to one."""


@intrinsic  # type: ignore[untyped-decorator]
def evaluate(_: Any, address: Any, t: Any, x: Any, u: Any, p: Any, out: Any) -> Any:  # noqa: ARG001
    """Call the right-hand side that stands at an address."""
    return types.void(types.int64, *RHS_SIGNATURE.args), lambda c, b, _, a: call_at(c, b, RHS_SIGNATURE, a[0], a[1:])


def call_at(context: Any, builder: Any, signature: Any, address: Any, args: Any) -> Any:
    """Call what has a signature and stands at an address, in the code of an intrinsic; what it raises goes on."""
    convention = context.call_conv
    kind = convention.get_function_type(signature.return_type, signature.args)
    there = builder.inttoptr(address, kind.as_pointer())
    status, _ = convention.call_function(builder, there, types.void, signature.args, args)
    with cgutils.if_unlikely(builder, status.is_error):
        convention.return_status_propagate(builder, status)
    return context.get_dummy_value()


@cache
def address_of(compiled: Any) -> int:
    """Where a function that was compiled for one signature is in memory: handing it over by Python takes 50 µs."""
    (overload,) = compiled.overloads.values()
    return int(overload.library.get_pointer_to_function(overload.fndesc.llvm_func_name))


def when_called(signature: Any, allocates: bool = True) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Compile a function for this signature when it is first called; without the interpreter's lock when it runs.

    One that allocates nothing counts no references, which is less to compile.

    Examples
    --------
    >>> from numba import float64
    >>> @when_called(float64(float64))
    ... def double(x):
    ...     return 2 * x
    >>> double(4)
    8.0
    """

    def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
        compiled = cache(lambda: kept(signature, no_cfunc_wrapper=True, **(_OPTIONS if allocates else LOOP))(function))
        return wraps(function)(lambda *arguments: compiled()(*arguments))

    return kernel


def kept(signature: Any, keep: bool = True, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile a function for this signature, or take what is kept on disk; what has no file is not kept.

    Parameters
    ----------
    signature : Numba's signature
    keep : bool
    **options
        Of ``numba.njit``.

    Examples
    --------
    >>> from numba import float64
    >>> kept(float64(float64), error_model="numpy")(lambda x: 1 / x)(4)
    0.25
    """

    def compile_it(function: Callable[..., Any]) -> Any:
        dispatcher = nb.njit(**options)(function)
        if keep and Path(function.__code__.co_filename).exists():
            with suppress(RuntimeError, OSError):  # there is no folder that can be written
                dispatcher._cache = _Cache(function)
        with _no_garbage_collection():
            dispatcher.compile(signature)
        dispatcher.disable_compile()
        return dispatcher

    return compile_it


@contextmanager
def _no_garbage_collection() -> Iterator[None]:
    """Numba makes so many objects that looking for cycles among them is a tenth of its time; they take 70 MB."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


@cache
def sources() -> str:
    """Hash of all modules that loops are made of.

    Examples
    --------
    >>> len(sources())
    64
    """
    package, digest = Path(__file__).parents[1], hashlib.sha256()
    for path in sorted(path for pattern in SOURCES for path in package.glob(pattern)):
        digest.update(hashlib.sha256(bytes_of(path)).digest())
    return digest.hexdigest()


class _Cache(FunctionCache):  # type: ignore[misc]
    """Numba's, of files that are checked; a fault in it costs the compilation and nothing else."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._cache_file = _Files(self._cache_path, self._impl.filename_base, self._impl.locator.get_source_stamp())

    def load_overload(self, signature: Any, target: Any) -> Any:
        overload = None
        with suppress(Exception):  # what was read is whole, and yet cannot be used
            overload = super().load_overload(signature, target)
        if overload is None:
            LOG.info("compiling")
        return overload

    def save_overload(self, signature: Any, compiled: Any) -> None:
        with suppress(OSError):  # no room, no right to write: it is compiled again the next time
            super().save_overload(signature, compiled)


class _Files(IndexDataCacheFile):  # type: ignore[misc]
    """A file for each signature and processor, named by them, with a digest of what it is and holds."""

    def load(self, key: Any) -> Any:
        path, mark = self._place(key)
        try:
            data = bytes_of(path)
        except (OSError, ValueError):
            return None
        digest, content = data[:32], data[32:]
        return pickle.loads(content) if digest == hashlib.sha256(mark + content).digest() else None

    def save(self, key: Any, data: Any) -> None:
        path, mark = self._place(key)
        content = self._dump(data)
        with self._open_for_write(path) as file:  # a neighbour, then renamed
            file.write(hashlib.sha256(mark + content).digest() + content)

    def flush(self) -> None:
        """Nothing is old: it is taken by its mark."""

    def _place(self, key: Any) -> tuple[Path, bytes]:
        which = hashlib.sha256(repr(key).encode()).hexdigest()
        path = Path(self._cache_path) / self._data_name_pattern.format(number=int(which[:12], 16))
        made_of = path.name, self._source_stamp, sources()
        return path, repr((which, *made_of, nb.__version__, llvmlite.__version__)).encode()
