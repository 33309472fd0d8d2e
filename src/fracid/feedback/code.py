"""``controller.c``: a controller as a C99 function, with the values that it is held against."""

from __future__ import annotations

import numpy as np

from fracid.arrays import FloatArray
from fracid.export.markup import program
from fracid.feedback.swing import law_of
from fracid.safety.door import own_text
from fracid.schemas.feedback import Conditions, Controller, ControlRecord
from fracid.solver.closed_loop import answers

SAMPLES = 100
"""Of the test."""


def inputs_of(controller: Controller, conditions: Conditions, errors: FloatArray) -> FloatArray:
    """What a controller gives for a row of outputs less their reference a sample, shape (n,)."""
    return np.asarray(answers(law_of(controller, conditions), np.ascontiguousarray(errors)))


def c_controller(control: ControlRecord) -> str:
    """Write the controller; its test begins where a trial does and comes to the posture in waves, twice."""
    c, controller = control.conditions, control.design.controller
    reference = np.array([c.reference[n] for n in c.outputs])
    k = np.arange(SAMPLES)[:, None] % (SAMPLES // 2)
    errors = np.array([c.off.get(n, 0.1) for n in c.outputs]) * np.cos(0.3 * k) * np.exp(-0.2 * k)
    y = reference + errors
    return program(
        own_text("feedback/controller.c.in"), control=control, c=c, law=law_of(controller, c), reference=reference,
        swings=int(controller.swing is not None), test_outputs=y, test_input=inputs_of(controller, c, y - reference),
    )  # fmt: skip
