"""The command line, ``fracid check``, ``fit`` …: one file a command; :mod:`fracid.cli.app` holds the frame."""

from fracid.cli import check, demo, export, fit, models, noise, report, resume
from fracid.cli import comparison as compare
from fracid.cli import draft as init
from fracid.cli import feedback as control
from fracid.cli import figures as draw
from fracid.cli import opening as open
from fracid.cli import planning as design
from fracid.cli import posterior_draws as posterior
from fracid.cli import profiles as profile
from fracid.cli import regression as regress
from fracid.cli import reproduction as reproduce
from fracid.cli import residuals as resid
from fracid.cli import simulation as simulate
from fracid.cli.app import app, main
from fracid.cli.completion import WithTables

__all__ = ["app", "check", "compare", "control", "demo", "design", "draw", "export", "fit", "init", "main", "models",
           "noise", "open", "posterior", "profile", "regress", "report", "reproduce", "resid", "resume",
           "simulate"]  # fmt: skip

PANELS = {
    "Look": ["check", "open", "models", "init"],
    "Identify": ["fit", "regress", "resume"],
    "Judge": ["resid", "profile", "posterior", "compare", "noise", "reproduce"],
    "Plan": ["design"],
    "Control": ["control"],
    "Take away": ["report", "draw", "export", "simulate"],
    "Try": ["demo"],
}
"""The commands in the order in which they are used, in the groups of the help."""

PLACE = {name: (place, panel) for place, (panel, name) in enumerate((p, n) for p in PANELS for n in PANELS[p])}
for command in app.registered_commands:
    command.cls = WithTables
    command.rich_help_panel = PLACE[getattr(command.callback, "__name__", "")][1]
app.registered_commands.sort(key=lambda command: PLACE[getattr(command.callback, "__name__", "")][0])
