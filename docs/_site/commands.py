"""The reference of the commands, from the program's own help: what ``fracid COMMAND --help`` says, as Markdown.

It takes the place of the line ``<!-- commands -->`` in reference/cli.md, each time the site is built.
"""

import inspect

PLACE = "<!-- commands -->"

BRACES = str.maketrans("", "", "{}")
KINDS = {"int": "N", "float": "NUMBER", "Path": "FILE"}
"""What stands behind an option whose help has no word of its own for it."""


def reference():
    """Return a section for every command, in the order of the program's help."""
    from typer.main import get_command

    from fracid.cli import app

    return "\n\n".join(_section(name, command) for name, command in get_command(app).commands.items())


def _section(name, command):
    usage = command.collect_usage_pieces(command.context_class(command, info_name=f"fracid {name}"))
    parts = [f"## fracid {name}", f"```text\nfracid {name} {' '.join(usage).translate(BRACES)}\n```"]
    parts += [inspect.cleandoc(command.help or ""), _table(command.params), _examples(command.epilog)]
    return "\n\n".join(part for part in parts if part)


def _table(parameters):
    rows = [_row(parameter) for parameter in parameters if not getattr(parameter, "hidden", False)]
    return "\n".join(["| | | default |", "|---|---|---|", *rows]) if rows else ""


def _row(parameter):
    if parameter.param_type_name == "argument":
        name = f"`{parameter.metavar or parameter.name.upper()}`"
    else:
        value = "" if parameter.is_flag else f" {parameter.metavar or KINDS.get(_kind(parameter), 'TEXT')}"
        name = ", ".join(f"`{option}{value}`" for option in (*parameter.opts, *parameter.secondary_opts))
    cells = (name, plain(parameter.help or ""), _default(parameter))
    return "| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |"


def _kind(parameter):
    return getattr(parameter.type_descriptor, "annotation", str).__name__


def _default(parameter):
    if parameter.required:
        return "required"
    if parameter.name == "jobs":
        return "every processor"  # and not how many the machine has that builds the site
    value = parameter.default
    if value is None or value is False or value == () or callable(value):
        return ""
    return f"`{'yes' if value is True else value}`"


def _examples(epilog):
    lines = [line for line in (epilog or "").split("\n\n") if line.strip()]
    shown = [_example(line) for line in lines if plain(line) not in ("Examples", "Example")]
    return "```console\n" + "\n".join(shown) + "\n```" if shown else ""


def _example(line):
    """A command and, behind ``#``, what the help says of it in dim letters."""
    command, _, remark = line.partition("[dim]")
    remark = plain(remark.replace("[/dim]", "")).strip()
    remark = remark.removeprefix("# ")
    command = plain(command).rstrip()
    return f"$ {command}" + (f"  # {remark}" if remark else "")


def plain(text):
    """Return a help text without the marks for bold and dim."""
    from rich.text import Text

    return Text.from_markup(text).plain


def _read(app, _page, source):
    if PLACE in source[0]:
        app.env.note_reread()
        source[0] = source[0].replace(PLACE, reference())


def setup(app):
    """Fill the page when it is read."""
    app.connect("source-read", _read)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
