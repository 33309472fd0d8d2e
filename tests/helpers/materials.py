"""A strip of rubber that is stretched and held: a springpot of known order, uneven samples, noise that grows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.special import gamma

__all__ = ["MODEL", "NU", "PROJECT", "strip"]

NU, SPRING, POT, NOISE = 0.3, 2.0, 5.0, 0.01

MODEL = """
from fracid import Model, Parameter
from fracid.models.joints import Complement, maxwell, springpot


def rhs(t, x, u, p, out):
    springpot(x, out, 0, u[1], p[1])


def of_spring(length, k):
    return k * length


def force(t, x, u, p):
    return of_spring(u[0], p[0]) + p[1] * x[0]


def rhs1(t, x, u, p, out):
    maxwell(x, out, 0, u[0], p[1], p[2])


def force1(t, x, u, p):
    return of_spring(u[0], p[0]) + p[1] * (u[0] - x[0])


MEASURED = {"inputs": ("length", "speed"), "input_rates": {"speed": "length"},
            "zero": "", "source": "a test"}
SPRINGS = (Parameter("k", "N/m", 1.0, "spring", lower=0.0), Parameter("c", "N/m", 1.0, "element", lower=0.0))
model = Model(name="springpot", rhs=rhs, states=("y",), orders=(Complement("nu"),), parameters=SPRINGS,
              outputs={"force": force}, **MEASURED)
relaxation = Model(name="Maxwell", rhs=rhs1, states=("y",), orders=(1.0,), relaxing={"y": "tau"},
                   parameters=(*SPRINGS, Parameter("tau", "s", 1.0, "its time", lower=1e-6)),
                   outputs={"force": force1}, **MEASURED)
"""

PROJECT = """
[model]
name = "model.py:model"
[model.parameters]
k = { start = 1.0, lower = 0.0, upper = 20.0 }
c = { start = 3.0, lower = 0.0, upper = 20.0 }
[[recording]]
file = "fast.csv"
length = { column = "L", unit = "m" }
force = { column = "F", unit = "N", sd = "SD" }
resample = "uneven"
[[recording]]
file = "slow.csv"
length = { column = "L", unit = "m" }
force = { column = "F", unit = "N", sd = "SD" }
resample = "uneven"
[[alternative]]
name = "a Maxwell element"
model = "model.py:relaxation"
[alternative.parameters]
k = { start = 1.0, lower = 0.0, upper = 20.0 }
c = { start = 3.0, lower = 0.0, upper = 20.0 }
tau = { start = 1.0, lower = 1e-3, upper = 1e3 }
[fit]
initial_state = "held"
"""


def strip(folder: Path, seed: int = 1) -> Path:
    """Write model, recordings of a fast and a slow ramp, and their project: its path.  The force by its formula."""
    rng = np.random.default_rng(seed)
    for name, ramp, ratio in (("fast", 0.2, 1.17), ("slow", 5.0, 1.08)):
        t = np.append(np.linspace(0, ramp, 21), ramp + np.cumsum(ramp / 20 * ratio ** np.arange(40.0)))
        speed = 0.5 / ramp
        rise = t ** (1 - NU) - np.maximum(t - ramp, 0.0) ** (1 - NU)  # D^ν of a ramp that ends
        force = SPRING * np.minimum(speed * t, 0.5) + POT * speed * rise / gamma(2 - NU)
        sd = NOISE * (1 + force)
        columns = np.column_stack([t, np.minimum(speed * t, 0.5), force + sd * rng.standard_normal(len(t)), sd])
        np.savetxt(folder / f"{name}.csv", columns, delimiter=",", header="time,L,F,SD", comments="", fmt="%.12g")
    (folder / "model.py").write_text(MODEL, encoding="utf-8")
    (folder / "strip.toml").write_text(PROJECT, encoding="utf-8")
    return folder / "strip.toml"
