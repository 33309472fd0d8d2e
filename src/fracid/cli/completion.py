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

from fracid.safety.json_files import json_of, text_of

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
        named = ((block, result.get(block)) for block in blocks)
        names = [n for block, said in named if isinstance(said, dict) for n in said if _shown(block, said[n])]
        return [name for name in names if name.startswith(incomplete)]

    return complete


def _result(run: Path) -> Any:
    """The content of a run's result; None where there is none."""
    try:
        content = json_of(text_of(run / "result.json"))
    except (OSError, ValueError):
        return None
    return content if isinstance(content, dict) else None


def _shown(block: str, said: Any) -> bool:
    """Of orders and parameters those that were free."""
    return block == "recordings" or (isinstance(said, dict) and said.get("free") is True)
