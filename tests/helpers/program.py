"""What tests of the commands share: the program called in this process, and a folder with a run in it."""

import sys
from contextlib import contextmanager

import pytest

from fracid.cli.app import main
from fracid.identification import examination
from fracid.workflows.drawer import drawer

RELEASE = """
[model.orders]
lambda = 1.0
mu = { start = 1.0, lower = 0.9, upper = 1.1 }
[fit]
initial_state = "held"
[[recording]]
file = "swing.csv"
theta = { column = "theta", unit = "rad" }
alpha = { column = "alpha", unit = "rad" }
initial = { theta = 0.0, alpha = 0.35 }
"""
"""The project of a release whose recording, swing.csv, stands beside it: mu is free."""


@contextmanager
def no_rivals():
    """Fits end before models of integer order are tried beside them, which takes seconds: unless asked for."""
    kept = tuple(step for step in examination.STEPS if step[1] not in ("alternative", "nested"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(examination, "STEPS", kept)
        yield


def run(capsys, *arguments):
    """Return exit code, standard output and standard error of the program."""
    with pytest.raises(SystemExit) as stop:
        main([str(a) for a in arguments])
    out, err = capsys.readouterr()
    return stop.value.code or 0, out, err


class DrawnSo:
    """In the place of a fit's figures: what gets the fit."""

    def __init__(self, draw):
        self.draw = draw

    def begin(self, recordings):
        pass

    def __call__(self, fit):
        return self.draw(fit)


def leave_figures_out(patch, draw=None):
    """Fits give themselves to ``draw`` instead, if at all; and start no process, which would import matplotlib."""
    patch.setattr("fracid.workflows.fit.Drawing", lambda *_, **__: DrawnSo(draw) if draw else None)
    for module in ("cli.fit", "workflows.fit"):
        patch.setattr(f"fracid.{module}.drawer", lambda jobs: drawer(1))


def fit_in(folder, text, drawn=lambda fit: ()):
    """Write a project into a folder and fit it there, as a person would; what draws its figures gets the fit."""
    (folder / "rig.toml").write_text(text, encoding="utf-8")
    words = ["fit", "rig.toml", "--out", "run", "--json"]
    with pytest.MonkeyPatch.context() as patch, no_rivals():
        patch.setattr(sys, "argv", ["fracid", *words])  # for environment.json
        patch.chdir(folder)
        leave_figures_out(patch, drawn)
        with pytest.raises(SystemExit):
            main(words)
