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
from fracid.cli.app import WORDS, app, main

__all__ = ["app", "check", "compare", "control", "demo", "design", "draw", "export", "fit", "init", "main", "models",
           "noise", "open", "posterior", "profile", "regress", "report", "reproduce", "resid", "resume",
           "simulate"]  # fmt: skip

app.registered_commands.sort(key=lambda command: [*WORDS].index(getattr(command.callback, "__name__", "")))
