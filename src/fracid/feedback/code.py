"""``controller.c``: a controller as a C99 function, with the values that it is held against."""

from __future__ import annotations

from string import Template

import numpy as np

from fracid._version import __version__
from fracid.arrays import FloatArray
from fracid.export.c import _comment, initialiser
from fracid.safety.door import own_text
from fracid.schemas.feedback import Conditions, Controller, ControlRecord

SAMPLES = 50
"""Of the test."""


def inputs_of(controller: Controller, conditions: Conditions, errors: FloatArray) -> FloatArray:
    """What a controller gives for a row of outputs less their reference a sample, shape (n,)."""
    A, B, C, D, E = (np.array(m) for m in (controller.A, controller.B, controller.C, controller.D, controller.E))
    v, u = np.zeros(len(A)), np.zeros(len(errors))
    for k, e in enumerate(errors):
        u[k] = np.clip(conditions.at_rest + C[0] @ v + D[0] @ e, conditions.least, conditions.most)
        v = A @ v + B @ e + E[:, 0] * (u[k] - conditions.at_rest)
    return u


def c_controller(control: ControlRecord) -> str:
    """Write the controller; its test begins where a trial does and comes to the posture in waves."""
    c, controller = control.conditions, control.design.controller
    reference = np.array([c.reference[n] for n in c.outputs])
    k = np.arange(SAMPLES)[:, None]
    errors = np.array([c.off.get(n, 0.1) for n in c.outputs]) * np.cos(0.3 * k) * np.exp(-0.1 * k)
    y = reference + errors
    words = {n: initialiser(getattr(controller, n)) for n in "AB"}
    words |= {n: initialiser(np.ravel(getattr(controller, n))) for n in "CDE"}
    numbers = {"rest": c.at_rest, "least": c.least, "most": c.most, "rate": 1 / c.period, "period": c.period}
    return Template(own_text("feedback/controller.c.in")).substitute(
        words, version=__version__, says=_comment(control.sentence), model=_comment(control.model),
        posture=_comment(c.posture), outputs=_comment(", ".join(c.outputs)), input=_comment(c.input),
        unit=_comment(c.unit), states=len(controller.A), count=len(c.outputs), reference=initialiser(reference),
        samples=SAMPLES, test_outputs=initialiser(y), test_input=initialiser(inputs_of(controller, c, y - reference)),
        **{n: repr(v) for n, v in numbers.items()},
    )  # fmt: skip
