"""Code of a user's own, ``my_rig.py:model`` or ``my.py:function``: when it is run, and what is run.

To run a file is to do whatever it says, and a project file may come from a stranger.  So:

1.  What a project file or a run folder *names* is not run before the caller has said so, with ``trust=True`` or on the
    command line with ``--trust``: :func:`refuse_untrusted`.  Nothing is remembered, for what remembers it could come
    from the stranger too.  A name that the caller types is run: to type it is to say so.
2.  What is run is what can be read.  Python would take compiled code from ``__pycache__`` beside the file where there
    is some, made from whatever; here the text alone counts, and nothing is written beside it: :func:`run_file`.

All of fracid runs a file here and nowhere else; ``tests/safety/test_safety.py`` looks for it.
"""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Sequence
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from traceback import extract_tb
from types import ModuleType
from typing import Any

from fracid.errors import InputError, NotTrusted, unknown_name
from fracid.safety.door import own_text

SAID = tomllib.loads(own_text("safety/user_code.toml"))


def is_own(name: str) -> bool:
    """Whether a name stands for a file's code, not for something built in.

    Examples
    --------
    >>> is_own("my_rig.py:model"), is_own("rotary-pendulum")
    (True, False)
    """
    return name.rpartition(":")[0].endswith(".py")


def refuse_untrusted(who: Path, names: Sequence[str], trust: bool) -> tuple[Path, ...]:
    """Let what a project file names run only if the caller trusts it.

    Parameters
    ----------
    who : Path
        The project file.
    names : sequence of str
        Of its model and its cost, built in or ``file.py:attribute``.
    trust : bool
        Whether the caller does.

    Returns
    -------
    tuple of Path
        The files that will be run; none if all is built in.

    Raises
    ------
    NotTrusted
        If there are some, and the caller does not.
    InputError
        If one is not there.

    Examples
    --------
    >>> refuse_untrusted(Path("rig.toml"), ["rotary-pendulum", "rmse"], trust=False)
    ()
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> _ = (folder / "my_rig.py").write_text("print('who knows what')")
    >>> refuse_untrusted(folder / "rig.toml", ["my_rig.py:model", "rmse"], trust=False)
    Traceback (most recent call last):
    fracid.errors.NotTrusted: ...rig.toml refers to Python code of its own: ...my_rig.py. Such code can do all that you
    can. Review it first; to run it, add --trust on the command line, trust=True in Python.
    """
    files = {who.parent / name.rpartition(":")[0]: name for name in names if is_own(name)}
    for file, name in files.items():
        if not file.is_file():
            raise InputError(f"{name!r}: there is no file {file}.")
    if files and not trust:
        them = "it" if len(files) == 1 else "them"
        raise NotTrusted(SAID["not-trusted"].format(who=who, files=" and ".join(map(str, files)), them=them))
    return tuple(files)


def run_file(file: Path, name: str) -> ModuleType:
    """Run a user's file as a module of that name; whatever it raises comes through.

    Parameters
    ----------
    file : Path
        That exists, and ends in .py.
    name : str
        Under which other parts of Python find the module.

    Examples
    --------
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "mine.py"
    >>> _ = file.write_text("answer = 42")
    >>> run_file(file, "mine_to_try").answer
    42
    """
    spec = spec_from_file_location(name, file, loader=_FromText(name, str(file)))
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    sys.modules[name] = module  # dataclasses, pickle and Numba look the module up by name
    spec.loader.exec_module(module)
    return module


def attribute_of(what: str, name: str, folder: Path, module: str) -> Any:
    """Run the file of ``file.py:attribute``, and return the attribute.

    Parameters
    ----------
    what : str
        Which it is to be, for messages: ``model``.
    name : str
    folder : Path
        What a relative file name starts from.
    module : str
        How the module's name begins.

    Raises
    ------
    InputError
        If there is no such file or attribute, or the file does not run: with its line.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> _ = (folder / "mine.py").write_text("answer = 42")
    >>> attribute_of("number", "mine.py:answer", folder, "mine_to_try_")
    42
    """
    path, _, attribute = name.rpartition(":")
    file = folder / path
    if not path.endswith(".py") or not attribute.isidentifier():
        raise InputError(f'{what} {name!r}: expected a file and a name in it, like "my_rig.py:{what}"')
    if not file.is_file():
        raise InputError(f"{what} {name!r}: there is no file {file}")
    try:
        found = run_file(file, module + file.stem)
    except Exception as error:
        raise InputError(f"{file}{_line(error, file)} does not run: {type(error).__name__}: {error}") from error
    if not hasattr(found, attribute):
        raise unknown_name(f"name in {file}", attribute, tuple(key for key in vars(found) if not key.startswith("_")))
    return getattr(found, attribute)


def _line(error: BaseException, file: Path) -> str:
    """Return ", line N" for the last line of the file that the error passed through."""
    lines = [error.lineno] if isinstance(error, SyntaxError) else []
    lines += [f.lineno for f in extract_tb(error.__traceback__) if f.filename == str(file)]
    return f", line {lines[-1]}," if lines and lines[-1] else ""


class _FromText(SourceFileLoader):
    """Compiles the file's text, whatever lies in ``__pycache__``, and leaves nothing there."""

    def path_stats(self, path: str) -> dict[str, float]:  # type: ignore[override]
        """Without a date there is no compiled code that could be as new."""
        raise OSError(path)
