"""Instruments: rows of the simulated response, which knows nothing of the measurement's noise [Janot]."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from fracid.arrays import ByName, FloatArray, by_name
from fracid.models.rigs import CLAMPED
from fracid.regression.estimators import Scaled, solve
from fracid.regression.rows import Blocks, Data, only
from fracid.solver.solve import simulate

FIRST_SWINGS = 4.0
"""How many swings the first instruments reach."""

ROUNDS = 15
"""Of instruments, at most."""

ALIKE = 0.7
"""Correlation of simulated and measured columns below which instruments are too weak."""


def instruments_of(data: Data, of: Scaled, orders: ByName) -> tuple[Blocks | None, Scaled]:
    """Instruments from the first start that leads to a response like the measured one; None if none does."""
    for start in ("tls", "huber", "model"):
        v = data.own[list(of.gauge.free)] if start == "model" else solve(start, of)[0]
        found, rescaled = _iterated(data, of, orders, v)
        if found and min(_likeness(Z, W) for Z, W in zip(found, of.system.W, strict=True) if len(W)) >= ALIKE:
            return found, rescaled
    return None, of


def _iterated(data: Data, of: Scaled, orders: ByName, v: FloatArray) -> tuple[Blocks | None, Scaled]:
    """Rows of the simulated response of the estimate, which is found again with them, over ever more swings.

    A few swings first: later ones are out of phase until the frequency is right.
    """
    near = of.system.scales(data.own)
    longest = max(float(t.max()) for t in data.times if len(t))
    horizon = FIRST_SWINGS / min(r.swing.frequency for r in data.rows)
    whole: Blocks | None = None
    for _ in range(ROUNDS):
        simulated = _simulated(data, of.gauge.beta(v), orders)
        if simulated is None:
            return None, of
        whole = data.W([simulated], orders)[0]
        keep = (data.times[0] <= horizon, data.times[1] <= horizon)
        few = of._replace(system=replace(of.system, W=only(of.system.W, keep)))
        new = solve("iv", few, only(whole, keep))[0]
        still = np.allclose(new, v, rtol=1e-4, atol=0.0)
        v, of = new, of._replace(scales=of.system.scales(of.gauge.beta(new), near))
        if still and horizon >= longest:
            break
        horizon = min(1.5 * horizon, longest) if horizon < longest else horizon
    return whole, of


def _likeness(Z: FloatArray, W: FloatArray) -> float:
    """Correlation of the columns of instruments and rows, all together."""
    unit = np.linalg.norm(W, axis=0)
    unit[unit == 0.0] = np.inf
    return float(np.sum(Z * W / unit**2) / math.sqrt(np.sum((Z / unit) ** 2) * np.sum((W / unit) ** 2)))


def _simulated(data: Data, beta: FloatArray, orders: ByName) -> list[FloatArray] | None:
    """Low-passed angles of the simulated response of each recording; None where a run diverges."""
    rows, model, values = data.rows, data.model, by_name(data.names, beta)
    friction = {n: max(values[n], 0.0) for n, kind in model.friction.items() if n in values and kind.power is not None}
    clamped = {} if any(r.swing.arm for r in rows) else {"J_theta": CLAMPED}
    parameters = {n: v for n, v in (values | friction | clamped | theta_rest_of(values)).items() if n != "cable_offset"}
    if any(not model.parameter(n).lower <= v <= model.parameter(n).upper for n, v in parameters.items()):
        return None
    model, responses = model.with_parameters(**parameters), []
    for r in rows:
        s, (angles, rates) = r.swing, r.swing.initial
        run = simulate(
            model, orders=orders, initial=[angles[0], rates[0], angles[1], rates[1]], step=s.step,
            end=(len(s.angles) - 1 - s.start) * s.step, inputs=None if s.drive is None else s.drive[s.start :],
            limit=1e4,
        )  # fmt: skip
        if not run.completed:
            return None
        held = np.repeat(angles[None], s.start, 0)
        responses.append(r.smooth(np.concatenate([held, run.states[:, [0, 2]]]), angles))
    return responses


def theta_rest_of(values: Mapping[str, float]) -> dict[str, float]:
    """The cable's rest angle from its offset."""
    if not values.get("cable_stiffness") or "cable_offset" not in values:
        return {}
    return {"theta_rest": -values["cable_offset"] / values["cable_stiffness"]}
