"""What a shell completes after an option: rigs, methods, costs, optimisers, and the names that a run has.

``fracid --install-completion`` sets up bash, zsh, fish and PowerShell; commands and options it knows by itself, and
files are left to the shell.  The names stand here in words, for the tables that hold them take half a second to import,
and a completion must not be waited for; a test compares them with those tables.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import typer

from fracid.errors import InputError
from fracid.safety.schema import Names, read_as

__all__ = ["COSTS", "EXECUTORS", "FORMATS", "METHODS", "OPTIMISERS", "PRESETS", "RIGS", "ZEROS", "from_run", "one_of"]

COSTS = ("rmse", "itae", "iae", "ise", "itse", "huber")

EXECUTORS = ("threads", "processes")

FORMATS = ("matlab", "c", "csv", "json", "state-space")

METHODS = ("pi2", "pi2-implicit", "pi3", "gl", "gl-sequential", "gl-paper")

OPTIMISERS = ("multistart", "least-squares", "cma", "differential-evolution", "genetic", "nelder-mead")

PRESETS = ("paper",)

RIGS = ("srv02-rotpen", "qube-servo2", "cazzolato-prime", "odrive-furuta", "stepper-freeswing")

COLUMNS = ("alpha=", "theta=", "voltage=")

ZEROS = ("hanging", "upright")

NAMED = {"orders?": Names({"free": bool}), "parameters?": Names({"free": bool}), "recordings?": Names(dict)}
"""What counts here of a result."""


def one_of(*values: str) -> Callable[[str], list[str]]:
    """Complete to one of some words.

    Examples
    --------
    >>> one_of("hanging", "upright")("up")
    ['upright']
    """

    def complete(incomplete: str) -> list[str]:
        return [value for value in values if value.startswith(incomplete)]

    return complete


def from_run(*blocks: str) -> Callable[[typer.Context, str], list[str]]:
    """Complete to the names in some blocks of the result of the run that was typed before, such as its parameters."""

    def complete(ctx: typer.Context, incomplete: str) -> list[str]:
        # an option without its value, as it is while one completes it, leaves all other words in ctx.args
        typed = [ctx.params.get("run"), ctx.params.get("source"), *ctx.args]
        results = (_result(Path(word)) for word in typed if word)
        result: Any = next(filter(None, results), {})
        names = [name for block in blocks for name, said in result.get(block, {}).items() if _shown(block, said)]
        return [name for name in names if name.startswith(incomplete)]

    return complete


def _result(run: Path) -> Any:
    """The content of a run's result; None where there is none."""
    try:
        return read_as(run / "result.json", NAMED, "")
    except (OSError, InputError):
        return None


def _shown(block: str, said: Any) -> bool:
    """Of orders and parameters those that were free."""
    return block == "recordings" or bool(said["free"])
