"""Folders that many tests begin with: each is made once a session, whichever process of it comes first."""

import fcntl
import os
import shutil

import numpy as np

from program import RELEASE, fit_in
from twins import write_release

TWO_RECORDINGS = """
[model.orders]
lambda = 0.8623
mu = { start = 0.9, lower = 0.7, upper = 1.2 }
[[recording]]
name = "release 20°"
file = "swing.csv"
theta = { column = "theta", unit = "rad" }
alpha = { column = "alpha", unit = "rad" }
initial = { theta = 0.0, alpha = 0.35 }
[[recording]]
name = "driven"
file = "driven.csv"
to = 1.5
theta = { column = "theta", unit = "rad" }
alpha = { column = "alpha", unit = "rad" }
voltage = { column = "voltage", unit = "V", between = "line" }
initial = { theta = 0.0, alpha = 0.0 }
use = "validate"
[fit]
initial_state = "held"
substeps = 1  # as the recordings are made
"""


def driven(n):
    """Volts at n + 1 instants: 2 sin 6 t, where the step is 5 ms."""
    return 2 * np.sin(0.03 * np.arange(n + 1))[:, None]


def plain(folder):
    """A release of 2 s, its project RELEASE, and the run."""
    write_release(folder / "swing.csv", orders={"lambda": 1.0, "mu": 0.97}, alpha=0.35, step=1e-2, end=2.0, noise=1e-3)
    fit_in(folder, RELEASE)


def two_recordings(folder):
    """A release that is fitted and a driven run that is not, and the run."""
    truth = {"orders": {"lambda": 0.8623, "mu": 0.9146}, "step": 5e-3, "end": 2.0, "noise": 1e-3}
    write_release(folder / "swing.csv", alpha=0.35, **truth)
    write_release(folder / "driven.csv", alpha=0.0, inputs=driven(400), **truth)
    fit_in(folder, TWO_RECORDINGS)


def made_once(make, factory):
    """A copy, this process's own, of a folder that ``make`` fills once for all processes of the session."""
    own = factory.getbasetemp()
    common = own.parent if "PYTEST_XDIST_WORKER" in os.environ else own
    whole, begun = common / make.__name__, common / f"{make.__name__} begun"
    with (common / f"{make.__name__}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # until it is closed
        if begun.exists() or not whole.exists():  # begun: it failed there
            shutil.rmtree(whole, ignore_errors=True)
            whole.mkdir()
            begun.touch()
            make(whole)
            begun.unlink()
    return shutil.copytree(whole, own / f"{make.__name__} of this process")
