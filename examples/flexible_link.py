"""Your own model in one file: a servo that turns a flexible link, whose root is viscoelastic.

    python examples/flexible_link.py          # makes flexible_link.csv, identifies it, draws flexible_link.png
    cd examples
    fracid fit flexible_link.toml --trust     # the same from the command line: runs/flexible_link

A motor turns a hub by θ; a thin link is clamped into it and bends by α against the hub.  The clamp gives the link the
torque −(k α + c D^q α), 0 < q < 1: a spring, and the damping of a polymer instead of a dashpot's,

    J_hub θ''          = k_m V − b θ' − f tanh(θ'/v_s) + k α + c D^q α
    J_link (θ'' + α'') =                               − k α − c D^q α

The input is the motor's voltage V, with known k_m [N m/V]; b holds the back-EMF.  The joints are sums of elements: the
hub's dry friction is ``sliding``, the clamp's polymer a ``springpot``, whose state is, as in duffing.py, z = D^q α.
"""

from pathlib import Path

import numpy as np

import fracid
from fracid import Experiment, Free, Model, Parameter, Problem
from fracid.models.joints import sliding, springpot

SLIP = 0.1  # v_s: dry friction has its full size beyond this speed [rad/s]


# --- the model: what flexible_link.toml calls "flexible_link.py:model" ----------------------------------------


def rhs(t, x, u, p, out):  # noqa: ARG001
    hub_speed, bend, bend_speed = x[1], x[2], x[3]
    J_hub, J_link, b, f, k, c, k_m = p[0], p[1], p[2], p[3], p[4], p[5], p[6]
    clamp = k * bend + springpot(x, out, 4, bend_speed, c)
    friction = b * hub_speed + sliding(hub_speed, f, 0.0, 1.0, SLIP)  # no stiction, so its speed does not matter
    out[0], out[2] = hub_speed, bend_speed
    out[1] = (k_m * u[0] - friction + clamp) / J_hub
    out[3] = -clamp / J_link - out[1]


model = Model(
    name="servo with a flexible link",
    rhs=rhs,
    states=("theta", "theta'", "alpha", "alpha'", "D^q alpha"),
    orders=(1.0, 1.0, 1.0, 1.0, "r"),
    outputs={"theta": 0, "alpha": 2},
    inputs=("voltage",),
    parameters=(
        Parameter("J_hub", "kg m^2", 2e-3, "inertia of motor, gear and hub", lower=0.0),
        Parameter("J_link", "kg m^2", 4e-3, "inertia of the link about the hub", lower=0.0),
        Parameter("b", "N m s/rad", 0.05, "viscous friction and back-EMF", lower=0.0),
        Parameter("f", "N m", 0.01, "dry friction", lower=0.0),
        Parameter("k", "N m/rad", 1.0, "stiffness of the clamp", lower=0.0),
        Parameter("c", "N m s^(1-r)", 0.02, "its fractional damping", lower=0.0),
        Parameter("k_m", "N m/V", 0.128, "torque per volt, from the data sheet"),
    ),
    zero="",
    source="an example; numbers like those of a laboratory servo",
    integer_orders={"r": 0},  # q = 1: viscous damping
)

# --- a recording of which the truth is known -----------------------------------------------------------------

TRUTH = {"r": 0.6, "J_hub": 2.1e-3, "J_link": 3.8e-3, "b": 0.06, "f": 0.02, "k": 1.3, "c": 0.03}
STEP, END = 4e-3, 8.0  # [s]
FINER = 16  # steps of the truth for each sample
NOISE = np.radians(0.05)  # of the strain gauge that measures the bend
CSV = Path(__file__).with_suffix(".csv")


def record(rng):
    """Write a voltage of steps and of a chirp through the link's resonance, and what encoder and gauge say."""
    time = np.linspace(0, END, round(END / STEP) + 1)
    steps = np.where((time > 0.1) & (time < 3.1), 1.5 * np.sign(np.sin(2 * np.pi * (time - 0.1) / 1.5)), 0.0)
    late = np.maximum(time - 3.1, 0)
    voltage = steps + 2.0 * np.sin(2 * np.pi * (1.0 * late + 0.7 * late**2))  # 1 to 8 Hz
    fine = np.linspace(0, END, FINER * round(END / STEP) + 1)
    run = fracid.simulate(
        model, orders={"r": TRUTH["r"]}, parameters={n: v for n, v in TRUTH.items() if n != "r"}, initial={},
        step=STEP / FINER, end=END, inputs=np.interp(fine, time, voltage)[:, None],
    )  # fmt: skip
    theta, alpha = run.states[::FINER, [0, 2]].T
    counts = np.rint(theta / (2 * np.pi) * 4096)
    bend = np.degrees(alpha + NOISE * rng.standard_normal(time.size))
    header = "time [s],voltage [V],theta [counts],alpha [deg]"
    columns = np.column_stack([time, voltage, counts, bend])
    np.savetxt(CSV, columns, fmt="%.6g", delimiter=",", header=header, comments="")


# --- identify it ---------------------------------------------------------------------------------------------


def problem():
    """What is known, what is free, what counts; flexible_link.toml says the same as a project file."""
    recording = fracid.load_recording(
        CSV,
        {
            "voltage": {"column": "voltage", "unit": "V"},
            "theta": {"column": "theta", "unit": "counts", "counts_per_turn": 4096},
            "alpha": {"column": "alpha", "unit": "deg"},
        },
    )
    return Problem(
        model,
        (Experiment.of(recording, model, ["theta", "alpha"], {"theta": 0.0, "alpha": 0.0},  # it starts at rest
                       between={"voltage": "line"}),),  # as it was simulated; a converter's is held
        orders={"r": Free(0.9, 0.05, 1.0)},
        parameters={
            "J_hub": Free(3e-3, 1e-4, 2e-2), "J_link": Free(3e-3, 1e-4, 2e-2), "b": Free(0.1, 0.0, 1.0),
            "f": Free(0.01, 0.0, 0.2), "k": Free(1.0, 0.1, 10.0), "c": Free(0.02, 0.0, 1.0),
        },
        outputs=("theta", "alpha"),
        initial_state="rest",
        weights="noise",  # a count of the encoder and a wiggle of the gauge are not the same error
        substeps=2,
    )  # fmt: skip


def main():
    record(np.random.default_rng(1))
    fit = fracid.identify(problem())
    for name, true in TRUTH.items():
        found = fit.orders[name] if name in fit.orders else fit.parameters[name]
        low, high = found.interval95
        print(f"{name:6} {found.value:10.5g}   95 %: {low:.5g} to {high:.5g}   truth {true:g}")
    (recording,) = fit.recordings.values()
    for output, rmse in recording.rmse.items():
        print(f"{output}: residual {np.degrees(rmse):.3f}°, fit {recording.fit_percent[output]:.1f} %")
    print(f"the clamp's order q = 1 - r is {1 - fit.orders['r'].value:.2f}")
    fit.plot().savefig(CSV.with_suffix(".png"), dpi=120)


if __name__ == "__main__":
    main()
