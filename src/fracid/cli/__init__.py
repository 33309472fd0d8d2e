"""The command line, ``fracid check``, ``fit`` …: one file a command; :mod:`fracid.cli.app` holds the frame."""

from fracid.cli import check, compare, demo, export, fit, init, noise, profile, regress, report, resid, resume, simulate
from fracid.cli.app import app, main

__all__ = ["app", "check", "compare", "demo", "export", "fit", "init", "main", "noise", "profile", "regress", "report",
           "resid", "resume", "simulate"]  # fmt: skip

IN_USE = ["check", "init", "fit", "resid", "profile", "compare", "noise", "regress", "report", "export", "resume",
          "simulate", "demo"]  # fmt: skip
"""The commands in the order in which they are used: that of the help."""

app.registered_commands.sort(key=lambda command: IN_USE.index(getattr(command.callback, "__name__", "")))
