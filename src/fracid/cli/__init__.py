"""The command line: ``fracid check``, ``fit``, ``demo``; one file a command, :mod:`fracid.cli.app` holds the frame."""

from fracid.cli import check, compare, demo, export, fit, init, noise, profile, regress, report, resid, resume
from fracid.cli.app import app, main

__all__ = ["app", "check", "compare", "demo", "export", "fit", "init", "main", "noise", "profile", "regress", "report",
           "resid", "resume"]  # fmt: skip
