"""``controller.c``: a controller as a C99 function, with the values that it is held against."""

from __future__ import annotations

import math
from string import Template

import numpy as np

from fracid._version import __version__
from fracid.arrays import FloatArray
from fracid.export.markup import c_comment, initialiser
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
    law = law_of(controller, c)
    words = {n: initialiser(getattr(law, n)) for n in ("A", "B", "begins", "needs")}
    words |= {n: initialiser(np.ravel(getattr(law, n))) for n in "CDE"}
    words |= {f"pump_{n}": "INFINITY" if math.isinf(v) else repr(v) for n, v in law.pump._asdict().items()}
    test = {"test_outputs": initialiser(y), "test_input": initialiser(inputs_of(controller, c, y - reference))}
    numbers = {"rest": c.at_rest, "least": c.least, "most": c.most, "rate": 1 / c.period, "period": c.period}
    return Template(own_text("feedback/controller.c.in")).substitute(
        words, version=__version__, says=c_comment(control.sentence), model=c_comment(control.model),
        posture=c_comment(c.posture), outputs=c_comment(", ".join(c.outputs)), input=c_comment(c.input),
        unit=c_comment(c.unit), states=len(controller.A), count=len(c.outputs), reference=initialiser(reference),
        samples=SAMPLES, swings=int(controller.swing is not None), **test, **{n: repr(v) for n, v in numbers.items()},
    )  # fmt: skip
