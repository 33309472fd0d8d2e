"""Twins: releases of a rig whose truth is known, simulated, as a motion, as a recording of a problem and as a file."""

import numpy as np

import fracid
from fracid.estimation.records import RecordingFit
from fracid.problem import Experiment

RIG = fracid.rotary_pendulum("srv02-rotpen")
COUNT = 2 * np.pi / 4096
"""Of an encoder of 4096 counts a turn [rad]."""
ORDERS = {"lambda": 0.9, "mu": 0.95}
"""The truth, if a test names no other."""


def states(rig=RIG, *, alpha, step, end, orders=ORDERS, finer=1, **more):
    """All states of a release from `alpha` [rad], every `step` [s], simulated at a part `finer` of it: shape (n, s)."""
    run = fracid.simulate(rig, orders=orders, initial={"alpha": alpha}, step=step / finer, end=end, **more)
    assert run.completed
    return run.states[::finer]


def angles(rig=RIG, *, step, outputs=("theta", "alpha"), plateau=0.0, noise=0.0, seed=1, counts=False, **motion):
    """The outputs of a release [rad], shape (n, outputs): a plateau [s] before it, white noise, an encoder's counts."""
    y = states(rig, step=step, **motion)[:, [rig.outputs[name] for name in outputs]]
    y = np.vstack([np.tile(y[0], (round(plateau / step), 1)), y])
    y = y + noise * np.random.default_rng(seed).standard_normal(y.shape)
    return COUNT * np.round(y / COUNT) if counts else y


def release(name="twin", rig=RIG, *, alpha, step, known=True, **more):
    """A release as a problem takes it; `known`: the angles it begins with are given."""
    initial = {"theta": 0.0, "alpha": alpha} if known else {}
    return Experiment(name, step, angles(rig, alpha=alpha, step=step, **more), np.zeros((1, 1)), initial=initial)


def write(file, y, step, names=("theta", "alpha")):
    """Write columns with their time, as the ending of the file says: .csv or .npz."""
    time, columns = step * np.arange(len(y)), dict(zip(names, y.T, strict=True))
    if file.suffix == ".npz":
        np.savez(file, time=time, **columns)
    else:
        header = ",".join(("time", *columns))
        np.savetxt(file, np.column_stack([time, y]), delimiter=",", header=header, comments="", encoding="utf-8")


def write_release(file, rig=RIG, *, step, outputs=("theta", "alpha"), **more):
    """Write a release to a file; a driven one with its inputs, a column each."""
    y, inputs = angles(rig, step=step, outputs=outputs, **more), more.get("inputs")
    names = outputs if inputs is None else (*outputs, *rig.inputs)
    write(file, y if inputs is None else np.column_stack([y, inputs]), step, names)


def fit_of(fitted, residual, time, name="twin", **more):
    """What a fit keeps of a recording whose curves and residuals [rad] are these, by output."""
    measured = {output: y + residual[output] for output, y in fitted.items()}
    return RecordingFit(name, "fit", time, measured, fitted, 1e-3, {}, {}, **more)


def frictions(ladder):
    """The rungs of a ladder, in its order."""
    return tuple(dict.fromkeys(s.friction for s in ladder.structures))
