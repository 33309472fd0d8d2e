"""Your own model in one file: a hardening spring with a fractional damper (Duffing's equation).

    python examples/duffing.py            # makes duffing.csv, identifies it with the library, draws duffing.png
    cd examples
    fracid fit duffing.toml --trust       # the same from the command line: runs/duffing

A mass on a rubber mount, for instance: the rubber stiffens when it is pressed, and its damping is neither that of a
spring (order 0) nor that of a dashpot (order 1) but in between,

    x'' + c D^q x + k x + k3 x³ = u(t),      0 < q < 1,  per unit of mass.

**As states.**  A model of fracid is D^{q_i} x_i = f_i(t, x, u, p).  With r = 1 − q the damper's D^q x is the integral
of order r of the speed, so it is one state more:  D^r z = x',  z(0) = 0,  z = D^q x.  The element ``springpot`` writes
this line and returns c z.  Position and speed have ordinary derivatives, whose order is the number 1.0; the order that
is to be found has a name, "r".
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

import fracid
from fracid import Experiment, Free, Model, Parameter, Problem
from fracid.models.joints import springpot

# --- the model: what duffing.toml calls "duffing.py:model" ---------------------------------------------------


def rhs(t, x, u, p, out):  # noqa: ARG001
    """Write D^{q_i} x_i into out[i]; plain Python that Numba can compile, parameters in the order given below."""
    position, speed = x[0], x[1]
    c, k, k3 = p[0], p[1], p[2]
    out[0] = speed
    out[1] = u[0] - springpot(x, out, 2, speed, c) - k * position - k3 * position**3


model = Model(
    name="Duffing's equation with a fractional damper",
    rhs=rhs,
    states=("x", "x'", "D^q x"),
    orders=(1.0, 1.0, "r"),
    outputs={"x": 0},  # x is measured, and is the state number 0
    inputs=("force",),
    parameters=(
        Parameter("c", "1/s^(1+r)", 0.3, "damping over mass", lower=0.0),
        Parameter("k", "1/s^2", 40.0, "stiffness over mass", lower=0.0),
        Parameter("k3", "1/(m s)^2", 2000.0, "hardening over mass", lower=0.0),
    ),
    zero="",
    source="an example; the numbers are made up",
    integer_orders={"r": 0},  # without fractional calculus the damper is a dashpot, q = 1; r = 1 would be a spring
)


def dashpot_rhs(t, x, u, p, out):  # noqa: ARG001
    """The integer-order alternative by hand: a dashpot, q = 1, which fracid makes of r = 0 by itself."""
    position, speed = x[0], x[1]
    c, k, k3 = p[0], p[1], p[2]
    out[0] = speed
    out[1] = u[0] - c * speed - k * position - k3 * position**3


dashpot = replace(model, name="Duffing's equation", rhs=dashpot_rhs, states=("x", "x'"), orders=(1.0, 1.0),
                  integer_orders={})  # fmt: skip

# --- a recording of which the truth is known -----------------------------------------------------------------

TRUTH = {"r": 0.4, "c": 1.5, "k": 40.0, "k3": 9000.0}
STEP, END = 0.01, 20.0  # [s]
FINER = 16  # steps of the truth for each sample
NOISE = 5e-4  # of the sensor [m]
CSV = Path(__file__).with_suffix(".csv")


def record(rng):
    """Write a chirp from 0.3 to 3 Hz and what the sensor makes of the motion."""
    time = np.linspace(0, END, round(END / STEP) + 1)
    force = 2.0 * np.sin(2 * np.pi * (0.3 * time + (3.0 - 0.3) / (2 * END) * time**2))  # [N/kg]
    fine = np.linspace(0, END, FINER * round(END / STEP) + 1)
    run = fracid.simulate(
        model, orders={"r": TRUTH["r"]}, parameters={name: TRUTH[name] for name in ("c", "k", "k3")}, initial={},
        step=STEP / FINER, end=END, inputs=np.interp(fine, time, force)[:, None],
    )  # fmt: skip
    x = run.states[::FINER, 0] + NOISE * rng.standard_normal(time.size)
    columns = np.column_stack([time, force, 1e3 * x])
    np.savetxt(CSV, columns, fmt="%.6g", delimiter=",", header="time [s],force [1],x [mm]", comments="")


# --- identify it ---------------------------------------------------------------------------------------------


def problem(model=model):
    """What is known, what is free, what counts; duffing.toml says the same as a project file."""
    recording = fracid.load_recording(
        CSV, {"force": {"column": "force", "unit": "1"}, "x": {"column": "x", "unit": "mm"}}
    )
    return Problem(
        model,
        (Experiment.of(recording, model, ["x"]),),
        orders={name: Free(0.9, 0.05, 1.0) for name in model.order_names},
        parameters={"c": Free(0.5, 0.0, 20.0), "k": Free(20.0, 0.0, 200.0), "k3": Free(1000.0, 0.0, 5e4)},
        outputs=("x",),
        initial_state="rest",  # x(0) is found, x'(0) is 0
        substeps=4,  # with 1 fracid says that the step is too coarse: the spring is stiff where it is pressed
    )


def main():
    record(np.random.default_rng(1))
    fit = fracid.identify(problem())
    for name, true in TRUTH.items():
        found = fit.orders[name] if name in fit.orders else fit.parameters[name]
        low, high = found.interval95
        print(f"{name:3} {found.value:9.5g}   95 %: {low:.5g} to {high:.5g}   truth {true:g}")
    (recording,) = fit.recordings.values()
    print(f"the damper's order q = 1 - r is {1 - fit.orders['r'].value:.3f}")
    print(f"residual {1e3 * recording.rmse['x']:.3g} mm, noise {1e3 * NOISE:g} mm")
    dashpot_cost = fit.alternative.trials[0].cost  # the first of the integer-order models that a fit tries by itself
    print(f"the integer-order alternative, a dashpot: {1e3 * dashpot_cost:.4g} mm")
    print(
        f"the nearest of {len(fit.alternative.trials)} alternatives: {1e3 * fit.alternative.cost:.4g} mm, {fit.claim}"
    )
    by_hand = fracid.identify(problem(dashpot))
    print(f"the same by hand, with a dashpot in its place: {1e3 * by_hand.cost:.4g} mm")
    fit.plot().savefig(CSV.with_suffix(".png"), dpi=120)


if __name__ == "__main__":
    main()
