"""The command line, ``fracid check``, ``fit`` …: one file a command; :mod:`fracid.cli.app` holds the frame."""

from fracid.cli import (  # noqa: F401  (each puts its command into the app)
    check,
    comparison,
    demo,
    draft,
    export,
    feedback,
    figures,
    fit,
    models,
    noise,
    opening,
    planning,
    posterior_draws,
    profiles,
    regression,
    report,
    reproduction,
    residuals,
    resume,
    simulation,
)
from fracid.cli.app import WORDS
from fracid.cli.app import app as app
from fracid.cli.app import main as main

app.registered_commands.sort(key=lambda command: [*WORDS].index(getattr(command.callback, "__name__", "")))
