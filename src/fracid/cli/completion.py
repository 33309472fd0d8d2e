"""What a shell completes after an option: rigs, methods, costs, optimisers, and the names that a run has.

``fracid --install-completion`` sets up bash, zsh, fish and PowerShell; commands and options it knows by itself, and
files are left to the shell.  The names are those of the tables that hold them (:data:`TABLES`), which are imported when
somebody completes, or asks for the help of a command: a program that starts must not wait for them.
"""

from __future__ import annotations

import re
import shutil
import tomllib
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from fracid.safety.door import own_text, text_if_any
from fracid.safety.environment import instead
from fracid.safety.json_files import object_of

TABLES = tomllib.loads(own_text("cli/tables.toml"))
"""Name → module of fracid and table in it; the help of an option writes ``{methods}`` for the keys of one."""


def one_of(*values: str) -> Callable[[str], list[str]]:
    """Complete to one of some words.

    Examples
    --------
    >>> one_of("hanging", "upright")("up")
    ['upright']
    """
    return lambda incomplete: [value for value in values if value.startswith(incomplete)]


def keys(table: str) -> list[str]:
    """Names in one of :data:`TABLES`, in its order.

    Examples
    --------
    >>> keys("presets")
    ['paper']
    """
    module, name = TABLES[table]
    return list(getattr(import_module(f"fracid.{module}"), name))


def key_of(table: str) -> Callable[[str], list[str]]:
    """Complete to a name in one of :data:`TABLES`, which is imported only then.

    Examples
    --------
    >>> key_of("methods")("pi2-")
    ['pi2-implicit']
    """
    return lambda incomplete: one_of(*keys(table))(incomplete)


class _Unlabelled:
    """Of which options that take no value say no type, where typer writes ``<bool>``."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Its options."""
        options: list[Any] = super().get_params(ctx)  # type: ignore[misc]
        for option in options:
            if getattr(option, "is_flag", False) and option.metavar is None:
                option.metavar = ""
        return options


class Group(_Unlabelled, TyperGroup):
    """The program."""


class WithTables(_Unlabelled, TyperCommand):
    """A command whose help has the names of the tables, read when somebody asks for it."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write them out where an option's help has ``{methods}``; lines of paragraphs are as long as there is room."""
        self.help = "\n\n".join(" ".join(part.split()) for part in (self.help or "").split("\n\n"))
        for option in self.params:
            for table in TABLES:
                if f"{{{table}}}" in (getattr(option, "help", None) or ""):
                    option.help = option.help.replace(f"{{{table}}}", ", ".join(keys(table)))  # type: ignore[attr-defined]
        examples, width = self.epilog or "", shutil.get_terminal_size().columns - 2
        wrapped = "\n\n".join(pasteable(line, width) for line in examples.split("\n\n"))
        with instead(vars(self), "epilog", wrapped):
            super().format_help(ctx, formatter)


def pasteable(example: str, width: int) -> str:
    """An example in lines no longer than `width`, if it can be: its comment above, its options on lines of their own.

    A line that ends where the terminal is full would be pasted as two commands.

    Examples
    --------
    >>> pasteable("fracid fit rig.toml --cut  [dim]# what if the record began elsewhere?[/dim]", 50).splitlines()
    ['[dim]# what if the record began elsewhere?[/dim]', 'fracid fit rig.toml --cut']
    >>> len(pasteable("fracid regress release.mat --column theta=1 --rig srv02-rotpen", 50).splitlines())
    2
    """
    if len(re.sub(r"\[/?\w+\]", "", example)) <= width:
        return example
    command, dim, comment = example.partition("  [dim]")
    lines: list[str] = []
    for part in re.split(r" (?=--|\| )", command):
        if lines and len(lines[-1]) + len(part) + 3 <= width:
            lines[-1] += f" {part}"
        else:
            lines.append(f"  {part}" if lines else part)
    return dim.strip() + comment + "\n" * bool(dim) + " \\\n".join(lines)


def from_run(*blocks: str) -> Callable[[typer.Context, str], list[str]]:
    """Complete to the names in some blocks of the result of the run that was typed before, such as its parameters."""

    def complete(ctx: typer.Context, incomplete: str) -> list[str]:
        # an option without its value, as it is while one completes it, leaves all other words in ctx.args
        typed = [ctx.params.get("run"), ctx.params.get("source"), *ctx.args]
        results = (object_of(text_if_any(Path(word) / "result.json")) for word in typed if word)
        result: Any = next(filter(None, results), {})
        blocks_of = ((block, result.get(block)) for block in blocks)
        names = [n for block, entry in blocks_of if isinstance(entry, dict) for n in entry if _shown(block, entry[n])]
        return [name for name in names if name.startswith(incomplete)]

    return complete


def _shown(block: str, entry: Any) -> bool:
    """Of orders and parameters those that were free."""
    return block == "recordings" or (isinstance(entry, dict) and entry.get("free") is True)
