"""The program: its options that all commands share, and how it ends.

A command is one short file beside this one: parse, one call of the library, text for people or JSON
for programs.  To add one, write its options and its examples in ``cli/commands.toml`` and a function of its arguments
and of :class:`How` under ``@command`` in ``cli/NAME.py``, and import that in ``cli/__init__.py``.

Exit codes: 0 it did what was asked; 1 long work was interrupted, there is no memory or disk for it, or the reader of
the output closed the pipe; 2 the caller's mistake; 3 a recording that fails its checks; 4 a fault of fracid itself,
told in one sentence with what to send (``FRACID_TRACEBACK=1`` shows all of it).

With ``--json`` standard output holds JSON alone, and all else goes to standard error.

Heavy modules are imported inside the command that needs them: ``fracid --help`` and
``fracid check`` answer in less than half a second.
"""

from __future__ import annotations

import atexit
import errno
import gc
import json
import os
import sys
import tomllib
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import chdir, suppress
from functools import wraps
from inspect import Parameter, Signature, signature
from math import inf, isfinite
from pathlib import Path
from types import SimpleNamespace
from typing import Annotated, Any, Literal, NoReturn, TypeVar

import typer

from fracid._version import __version__
from fracid.cli.completion import Group, WithTables, from_run, key_of, one_of
from fracid.errors import DataError, FracidError, InputError, NotTrusted, Unfinished
from fracid.errors import typed as typed
from fracid.safety.door import own_text
from fracid.safety.environment import ignore_settings, safe_children
from fracid.safety.text import json_text, printable
from fracid.tasks.display import shown
from fracid.tasks.ending import ended_in_a_sentence, quiet_when_closed
from fracid.words import Sentences

SAYS = Sentences("cli/says.toml")

TRACEBACK = "FRACID_TRACEBACK"
"""Set in the environment, a fault of fracid itself ends in its traceback."""

FAULT = 4
"""The exit code of a fault of fracid itself."""

PLACES = 8
"""Lines of our own code that a fault names, the last ones."""

CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
"""Processors that this process may use: the default of --jobs."""

app = typer.Typer(
    name="fracid", cls=Group, no_args_is_help=True, pretty_exceptions_enable=False, rich_markup_mode="rich"
)

Command = TypeVar("Command", bound=Callable[..., Any])
Found = TypeVar("Found")
Tables = Mapping[str, Sequence[Mapping[str, str]]]
"""Caption → rows, heading → cell."""


WORDS: dict[str, Any] = tomllib.loads(own_text("cli/commands.toml"))
"""What the commands take, in the order and with the panels and examples of the help."""

WORDS["every"]["jobs"]["default"] = CORES

TYPES: dict[str, Any] = {
    "flag": bool, "yes-no": bool | None, "int": int | None, "float": float | None, "text": str | None,
    "path": Path | None, "list": list[str] | None,
}  # fmt: skip
"""Of options, as ``commands.toml`` calls them; a choice is among its words."""


class How(SimpleNamespace):
    """The options of a command, by the names that they have in ``commands.toml``."""

    def taken(self, work: Callable[..., Any], **more: Any) -> dict[str, Any]:
        """Those that a function of the library takes, `more` in the place of what was typed."""
        options = vars(self)
        executor, scheduler = options.get("executor"), options.get("scheduler")
        if executor is not None and scheduler is not None:
            raise InputError(f"--executor {executor} and --scheduler {scheduler} are two places; give one of the two.")
        every = options | {"executor": scheduler or executor, "command": sys.argv[1:]} | more
        return {name: every[name] for name in signature(work).parameters if name in every}

    def done(self, work: Callable[..., Found], *what: Any, **options: Any) -> Found:
        """Call it with them and with `options`, and show its stages."""
        with shown(events=self.json_) as observer:
            return work(*what, **self.taken(work, observer=observer) | options)

    def answer(self, result: Any, show: Callable[[Any], None]) -> None:
        """Print what a command found: a record for programs, or what `show` prints on a console."""
        if self.json_:
            typer.echo(json_text(result))  # no terminal obeys what its texts hold
        else:
            show(new_console())

    def tell(self, finished: Any, *steps: tuple[str, str], **more: Any) -> None:
        """Print what a study found, and what to type next; see :func:`print_found`."""
        self.answer(finished.result, lambda console: print_found(console, finished, *steps, **more))


def command(function: Command) -> Command:
    """Make a function a command of the program; its options, and the words of its arguments, are in ``commands.toml``.

    Parameters
    ----------
    function : callable
        Of the arguments that are typed without a name, and of ``how``, the options.

    Raises
    ------
    KeyError
        If the file has no words for it, or for one of its arguments and options.
    """
    own = WORDS[function.__name__]
    arguments = [p for n, p in signature(function, eval_str=True).parameters.items() if n != "how"]
    words = {n: WORDS["every"].get(n, {}) | own.get(n, {}) for n in (*(p.name for p in arguments), *own["options"])}
    taken = [p.replace(annotation=Annotated[p.annotation, _typed(p.name, **words[p.name])]) for p in arguments]
    taken += [_option(n, **words[n]) for n in own["options"]]

    @wraps(function)
    def called(**given: Any) -> Any:
        positional = {p.name: given.pop(p.name) for p in arguments}
        return function(**positional, how=How(**given))

    vars(called)["__signature__"] = Signature([p.replace(kind=Parameter.KEYWORD_ONLY) for p in taken])
    called.__annotations__ = {p.name: p.annotation for p in taken}
    heading = f"[bold]Example{'s' * (len(own['examples']) > 1)}[/bold]"
    epilog = "\n\n".join((heading, *own["examples"]))
    return app.command(cls=WithTables, epilog=epilog, rich_help_panel=own["panel"])(called)  # type: ignore[return-value]


def _option(name: str, *, type: str = "text", default: Any = None, **words: Any) -> Parameter:
    """An option, as a parameter that typer reads."""
    kind: Any = Literal[tuple(words["words"])] if type == "choice" else TYPES[type]
    default = False if type == "flag" else default
    annotation: Any = Annotated[kind, _typed(name, **words)]
    return Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


def _typed(
    name: str, *, argument: bool = False, spelled: Sequence[str] = (), table: str = "", words: Sequence[str] = (),
    of_run: Sequence[str] = (), **words_of_typer: Any,
) -> Any:  # fmt: skip
    """An option or an argument as typer has it."""
    complete = key_of(table) if table else one_of(*words) if words else from_run(*of_run) if of_run else None
    if argument:
        return typer.Argument(autocompletion=complete, **words_of_typer)
    names = spelled or [f"--{name.rstrip('_').replace('_', '-')}"]
    return typer.Option(*names, autocompletion=complete, **words_of_typer)


@quiet_when_closed()
def main(arguments: list[str] | None = None) -> None:
    """Run the program and exit with its code.

    Parameters
    ----------
    arguments : list of str, optional
        None takes the command line's.

    Raises
    ------
    SystemExit
        Always, with one of the codes at the top.

    Examples
    --------
    >>> main(["--version"])
    Traceback (most recent call last):
    SystemExit: 0
    """
    for library in ("OPENBLAS", "MKL", "OMP"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")  # the threads are fracid's: of runs, not of small matrices
    ignore_settings(Path())
    atexit.unregister(gc.freeze)
    atexit.register(gc.freeze)  # an exit looks for garbage in all that was imported, for 0.4 s
    try:
        with safe_children(), ended_in_a_sentence():
            app(args=arguments, prog_name="fracid")
    except FracidError as error:
        kind = "unfit recording" if isinstance(error, DataError) else "error"
        words = sys.argv[1:] if arguments is None else arguments
        allowed = f" Type: {typed(*words, trust=True)}" if isinstance(error, NotTrusted) else ""
        _end(f"{kind}: {printable(f'{error}{allowed}')}", error.exit_code)
    except Exception as error:
        if os.environ.get(TRACEBACK):
            raise
        if lack := _lack(error):
            _end(f"error: there {lack}. {printable(str(error))}", Unfinished.exit_code)
        if isinstance(error, OSError) and error.filename is not None:  # a disk's, or of a name that it cannot have
            _end(f"error: {printable(f'{error.filename}: {error.strerror}. Give another path.')}", InputError.exit_code)
        _end(f"error: {_last_resort(error)}", FAULT)


def _end(why: str, code: int) -> NoReturn:
    """Say why, and exit with that code."""
    sys.stderr.write(f"{why}\n")
    raise SystemExit(code) from None


def _lack(error: Exception) -> str:
    """What the machine has not enough of, where that ended the command."""
    if isinstance(error, MemoryError):
        return "is not enough memory"
    if isinstance(error, RuntimeError) and "new thread" in str(error):  # Python has no type for it
        return "are not enough threads"
    return "are too many open files" if getattr(error, "errno", 0) in (errno.EMFILE, errno.ENFILE) else ""


def _last_resort(error: Exception) -> str:
    """What nobody has foreseen, in a line that says where it happened: it may never happen again."""
    import platform
    from traceback import extract_tb

    ours = [f for f in extract_tb(error.__traceback__) if "fracid" in Path(f.filename).parts]
    places = ", ".join(f"{Path(f.filename).name}:{f.lineno}" for f in ours[-PLACES:])
    what = " ".join(str(error).split())
    what = what if len(what) <= 300 else f"{what[:300]} …"
    machine = f"Python {platform.python_version()}, {platform.system()} {platform.machine()}"
    return printable(SAYS("fault", kind=type(error).__name__, what=what, places=places, version=__version__,
                          machine=machine, traceback=TRACEBACK))  # fmt: skip


def new_console(**options: Any) -> Any:
    """Make what prints text and tables; what cannot be seen in them, a terminal's commands among it, is written out."""
    from rich.console import Console

    class Printable(Console):
        def render_str(self, text: str, **how: Any) -> Any:
            return super().render_str(printable(text), **how)

    return Printable(**{"highlight": False, **options})


def type_again(words: Sequence[str], where: Path, known_as: Sequence[str]) -> Any:
    """Do what the words of a command say, in the folder where they were typed, if it is still there; gives its code.

    The command knows itself as another one: what it leaves for a further resumption.
    """
    before = sys.argv[1:]
    sys.argv[1:] = known_as
    ignore_settings(where)
    try:
        with chdir(where if where.is_dir() else os.curdir):
            return app(args=[*words], prog_name="fracid", standalone_mode=False)
    finally:
        sys.argv[1:] = before


def each_once(option: str, pairs: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    """Collect what an option says of several names; the same name twice is a slip, and which is meant is not known.

    Raises
    ------
    InputError

    Examples
    --------
    >>> each_once("--order", [("mu", 1.0), ("lambda", 0.9)])
    {'mu': 1.0, 'lambda': 0.9}
    """
    values: dict[str, Any] = {}
    for name, value in pairs:
        if name in values:
            raise InputError(f"{option} says {name} twice, {values[name]} and {value}; say it once.")
        values[name] = value
    return values


def assigned(
    option: str, texts: list[str] | None, example: str, read: Callable[[str, str], Any] | None = None
) -> dict[str, Any]:
    """Parse the values of an option that may be repeated: numbers, or what `read` makes of a text and what to type.

    Raises
    ------
    InputError

    Examples
    --------
    >>> assigned("--order", ["mu=0.95"], "mu=1.0")
    {'mu': 0.95}
    """
    values: list[tuple[str, Any]] = []
    for text in texts or ():
        name, equals, value = text.partition("=")
        if not equals or not name.strip():
            raise InputError(f"{option} {text!r} is not possible; expected NAME=VALUE: {option} {example}.")
        line = f"{option} {name.strip()}={example.partition('=')[2]}"
        values.append((name.strip(), read(value, line) if read else numbers(option, value, example)[0]))
    return each_once(option, values)


def numbers(option: str, text: str, example: str = "5,150", *, least: float = -inf) -> tuple[float, ...]:
    """Parse the numbers of a list with commas.

    Raises
    ------
    InputError
        If they are none, not finite, or below `least`.

    Examples
    --------
    >>> numbers("--rate", "200,500")
    (200.0, 500.0)
    """
    values: tuple[float, ...] = ()
    with suppress(ValueError):
        values = tuple(float(word) for word in text.split(","))
    if not values or not all(isfinite(v) and v >= least for v in values):
        what = "with commas" if least == -inf else f"from {least:g} on"
        raise InputError(f"{option} {text!r} is not possible; expected numbers {what}: {option} {example}.")
    return values


def say(console: Any, text: str, first: str = "") -> None:
    """Print a sentence, in rich's markup: broken between words on a terminal, in one line where programs read.

    `first` stands before it, such as a mark; further lines begin behind it.
    """
    from rich.padding import Padding
    from rich.table import Column, Table
    from rich.text import Text

    indent = Text.from_markup(first).cell_len
    if not console.is_terminal or not indent:
        console.print(f"{first}{text}", soft_wrap=not console.is_terminal)
        return
    grid = Table.grid(Column(width=indent, no_wrap=True), Column(), padding=0)
    grid.add_row(first, text)
    console.print(Padding(grid, 0, expand=False))


def print_entry(console: Any, heading: str, text: str) -> None:
    """Print a line with a heading in its first nine columns, as ``result   runs/rig/result.json``."""
    from rich.markup import escape

    say(console, escape(text), f"{heading:9}")


def print_figures(console: Any, paths: Iterable[Path]) -> None:
    """Print where the figures of a run are, those of one folder in one line."""
    drawn = [path for path in paths if path.suffix in (".png", ".svg", ".pdf")]
    for folder in dict.fromkeys(path.parent for path in drawn):
        stems = dict.fromkeys(path.stem for path in drawn if path.parent == folder)
        print_entry(console, "figures", f"{folder}: {', '.join(stems)}")


def print_study(console: Any, finished: Any, *steps: tuple[str, str], **more: Path | None) -> None:
    """Print where a study left what it found, and `more` beside it but for None; its figures; what to type next."""
    for heading, path in {"result": finished.path, **more, "page": getattr(finished, "page", None)}.items():
        if path is not None:
            print_entry(console, heading, str(path))
    print_figures(console, finished.figures)
    say_next(console, *steps)


def print_found(
    console: Any, finished: Any, *steps: tuple[str, str], tables: Tables | None = None, **more: Path | None
) -> None:
    """Print what a study found, in the words of its page, after `tables` of its own, and where that is."""
    from rich.markup import escape

    from fracid.report.study import read_study

    found = read_study(finished.folder, finished.FILE)[1]
    say(console, f"[bold]{escape(found.answer)}[/bold]", "" if found.good else "[yellow]![/yellow] ")
    warn(console, *found.said, mark="")
    for caption, rows in {**(tables or {}), **found.tables}.items():
        say(console, f"[bold]{escape(caption)}[/bold]")
        print_table(console, [*rows[0]], ([*row.values()] for row in rows), fold=[*rows[0]][:1])
    for caption, values in found.values.items():
        say(console, f"[bold]{escape(caption)}[/bold]")
        print_values(console, values)
    say(console, f"[dim]{escape(' · '.join(found.facts))}[/dim]")
    warn(console, *found.notes)
    print_study(console, finished, *steps, **more)


def print_values(console: Any, estimates: Sequence[Mapping[str, Any]]) -> None:
    """Print values with their intervals, and what else is said of each, or why."""
    from fracid.estimation.records import in_words
    from fracid.report.sentences import digits, interval

    kinds = (e["identifiable"] for e in estimates)
    verdicts = ("" if kind in ("unknown", "identifiable") else in_words(kind) for kind in kinds)
    aside = ("; ".join(filter(None, (e["says"], e["reason"] or v))) for e, v in zip(estimates, verdicts, strict=True))
    cells = ((e["name"], digits(e), interval(e), e["unit"], text) for e, text in zip(estimates, aside, strict=True))
    print_table(console, ("name", "value", "95 % interval", "unit", ""), cells, fold=("name", ""))


def warn(console: Any, *sentences: str, mark: str = "[yellow]![/yellow] ") -> None:
    """Print sentences, each with a mark."""
    from rich.markup import escape

    for sentence in sentences:
        say(console, escape(sentence), mark)


def print_claim(console: Any, claim: str, reasons: Sequence[str], against: Mapping[str, str]) -> None:
    """Print what is claimed of the rig, what speaks against it, and why; green only where nothing does."""
    from rich.markup import escape

    from fracid.selection.doubts import claimed

    colour = "yellow" if claim == "undecided" or against else "green"
    lines = reasons if console.is_terminal else [" ".join(reasons)]  # one line where programs read
    say(console, f"[bold {colour}]claim: {escape(claimed(claim, against))}[/]. {escape(' '.join(lines[:1]))}")
    warn(console, *lines[1:], mark="  ")


def say_next(console: Any, *steps: tuple[str, str]) -> None:
    """Print what one would type next, and why: the last lines of a command that did what it was asked."""
    from rich.markup import escape

    for place, (command, why) in enumerate(steps):
        heading = "next" if place == 0 else ""
        if console.is_terminal and 11 + len(command) + len(why) > console.width:
            console.print(f"{heading:8} {escape(command)}", soft_wrap=True)
            say(console, f"[dim]{escape(why)}[/dim]", " " * 9)
        else:
            console.print(f"{heading:8} {escape(command)}  [dim]{escape(why)}[/dim]", soft_wrap=True)


def open_page(page: Path, choice: bool | None) -> bool:
    """Open a page in the browser; gives whether one took it.

    If nobody asked, only where somebody looks on: on a terminal with a display, and not in continuous integration.
    """
    shows = sys.platform in ("darwin", "win32") or "DISPLAY" in os.environ or "WAYLAND_DISPLAY" in os.environ
    if choice is None:
        choice = shows and sys.stdout.isatty() and "CI" not in os.environ
    import webbrowser

    return bool(choice and shows) and webbrowser.open(page.resolve().as_uri())


def print_table(console: Any, headings: Sequence[str], rows: Iterable[Sequence[str]], fold: Collection[str]) -> None:
    """Print rows without lines; the columns in `fold` are broken where the terminal is narrow.

    They are broken between words, and nowhere where programs read: a file has no edge.
    """
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    columns = [*zip(headings, *rows, strict=True)]
    widths = [max(map(len, cells)) for cells in columns]
    words = [max(len(w) for cell in cells for w in (cell.split() if cells[0] in fold else [cell]) or [""])
             for cells in columns]  # fmt: skip
    gap = 2 if sum(words) + 2 * len(words) - 2 <= console.width or not console.is_terminal else 1
    excess = sum(widths) + gap * (len(widths) - 1) - console.width if console.is_terminal else 0
    for k in sorted(range(len(widths)), key=lambda k: words[k] - widths[k]):  # what can give most first
        given = max(0, min(excess, widths[k] - words[k]))
        widths[k], excess = widths[k] - given, excess - given
    grid = Table(box=None, pad_edge=False, padding=(0, gap, 0, 0), header_style="bold")
    for name, width in zip(headings, widths, strict=True):
        grid.add_column(escape(name), overflow="fold", no_wrap=name not in fold, width=width if excess <= 0 else None)
    for row in zip(*(cells[1:] for cells in columns), strict=True):
        grid.add_row(*map(escape, row))
    (console if console.is_terminal else Console(file=console.file, width=10_000)).print(grid)


@app.callback(invoke_without_command=True, epilog=SAYS("new-here"))
def _program(
    ctx: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", help="Print the version; with --json also those of the libraries.")
    ] = False,
    json_: Annotated[bool, typer.Option("--json", hidden=True)] = False,
) -> None:
    """Identify fractional- and integer-order models of nonlinear mechanical systems from recordings."""
    if version and json_:
        from fracid.runs.environment import versions

        typer.echo(json.dumps(versions(), indent=2))
    elif version:
        typer.echo(f"fracid {__version__}")
    elif ctx.invoked_subcommand is None:
        typer.echo(ctx.get_help())
    if version:
        raise typer.Exit
