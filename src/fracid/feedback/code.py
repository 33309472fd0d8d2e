"""``controller.c``: a controller as a C99 function, with the values that it is held against."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fracid.export.markup import program
from fracid.feedback.swing import law_of
from fracid.safety.door import own_text
from fracid.schemas.feedback import ControlRecord
from fracid.solver.closed_loop import answers

SAMPLES = 100
"""Of the test."""


def c_controller(control: ControlRecord, columns: Sequence[str] = ()) -> str:
    """Write the controller; its test begins where a trial does and comes to the posture in waves, twice.

    `columns` say in its head how those of a recording are taken.
    """
    c, controller = control.conditions, control.design.controller
    reference = np.array([c.reference[n] for n in c.outputs])
    k = np.arange(SAMPLES)[:, None] % (SAMPLES // 2)
    errors = np.array([c.off.get(n, 0.1) for n in c.outputs]) * np.cos(0.3 * k) * np.exp(-0.2 * k)
    y, law = reference + errors, law_of(controller, c)
    return program(
        own_text("feedback/controller.c.in"), control=control, c=c, columns=columns, law=law, reference=reference,
        swings=int(controller.swing is not None), test_outputs=y, test_input=answers(law, y - reference),
    )  # fmt: skip
