"""Your own model in one file: a supercapacitor, current in, voltage out.

    python examples/supercapacitor.py         # makes supercapacitor.csv, identifies it, draws supercapacitor.png
    cd examples
    fracid fit supercapacitor.toml --trust    # the same from the command line: runs/supercapacitor

The charge of a porous electrode creeps into its pores: after a pulse of current the voltage relaxes like a power of
time, for which no number of RC elements is enough and one *constant-phase element* is.  It is a capacitor of order
q < 1 whose capacity grows with the voltage, with a leak beside it,

    (C0 + C1 v) D^q v = i − g v,          q = 1: an ordinary capacitor,

and between the terminals lies v + R i.

**An output that is no state.**  A model's outputs are states, and v + R i is none.  But nobody measures it either:
before a logger's converter sits a low-pass, and what it lets through is a state, the voltage w that is logged,

    τ w' = v + R i − w,

with the filter's time constant τ from the logger's data sheet.  So R i appears where the recording has it: as a step
that the filter has rounded.
"""

from pathlib import Path

import numpy as np

import fracid
from fracid import Experiment, Free, Model, Parameter, Problem

# --- the model: what supercapacitor.toml calls "supercapacitor.py:model" --------------------------------------


def rhs(t, x, u, p, out):  # noqa: ARG001
    v, logged, current = x[0], x[1], u[0]
    C0, C1, g, R, tau = p[0], p[1], p[2], p[3], p[4]
    out[0] = (current - g * v) / (C0 + C1 * v)
    out[1] = (v + R * current - logged) / tau


model = Model(
    name="supercapacitor with a constant-phase element",
    rhs=rhs,
    states=("v", "w"),
    orders=("q", 1.0),
    outputs={"voltage": 1},
    inputs=("current",),
    parameters=(
        Parameter("C0", "F s^(q-1)", 10.0, "capacity when empty", lower=1e-6),
        Parameter("C1", "F s^(q-1)/V", 0.0, "how it grows with the voltage", lower=0.0),
        Parameter("g", "S", 0.0, "leak", lower=0.0),
        Parameter("R", "Ohm", 0.05, "resistance in series", lower=0.0),
        Parameter("tau", "s", 0.2, "time constant of the logger's low-pass, from its data sheet", lower=1e-6),
    ),
    zero="",
    source="an example; numbers like those of a cell of 15 F",
)

# --- a recording of which the truth is known -----------------------------------------------------------------

TRUTH = {"q": 0.93, "C0": 15.0, "C1": 3.0, "g": 2e-3, "R": 0.04}
STEP, END = 0.1, 240.0  # [s]
FINER = 16  # steps of the truth for each sample
NOISE = 1e-3  # of the logger [V]
CSV = Path(__file__).with_suffix(".csv")


def record(rng):
    """Write 30 s of charging, a minute of rest, 20 s of discharging, rest, a short charge, rest."""
    time = np.linspace(0, END, round(END / STEP) + 1)
    pulses = ((5, 35, 1.0), (95, 115, -1.0), (150, 170, 0.5))  # from, to [s], current [A]
    current = sum(size * ((time > start) & (time <= stop)) for start, stop, size in pulses)
    fine = np.linspace(0, END, FINER * round(END / STEP) + 1)
    run = fracid.simulate(
        model, orders={"q": TRUTH["q"]}, parameters={n: v for n, v in TRUTH.items() if n != "q"}, initial={},
        step=STEP / FINER, end=END, inputs=np.interp(fine, time, current)[:, None],
    )  # fmt: skip
    voltage = run.states[::FINER, 1] + NOISE * rng.standard_normal(time.size)
    columns = np.column_stack([time, current, 1e3 * voltage])
    header = "time [s],current [A],voltage [mV]"
    np.savetxt(CSV, columns, fmt="%.9g", delimiter=",", header=header, comments="")


# --- identify it ---------------------------------------------------------------------------------------------


def problem():
    """What is known, what is free, what counts; supercapacitor.toml says the same as a project file."""
    recording = fracid.load_recording(
        CSV, {"current": {"column": "current", "unit": "A"}, "voltage": {"column": "voltage", "unit": "mV"}}
    )
    # A fractional element remembers how it was charged.  This one was shorted overnight: it starts empty.
    cell = Experiment.of(recording, model, ["voltage"], {"w": 0.0})
    return Problem(
        model,
        (cell,),
        orders={"q": Free(1.0, 0.5, 1.0)},
        parameters={
            "C0": Free(10.0, 1.0, 100.0), "C1": Free(1.0, 0.0, 50.0), "g": Free(1e-2, 0.0, 0.1),
            "R": Free(0.1, 0.0, 1.0),
        },
        outputs=("voltage",),
        initial_state="rest",
        substeps=2,
    )  # fmt: skip


def main():
    record(np.random.default_rng(1))
    fit = fracid.identify(problem())
    for name, true in TRUTH.items():
        found = fit.orders[name] if name in fit.orders else fit.parameters[name]
        low, high = found.interval95
        print(f"{name:3} {found.value:9.5g}   95 %: {low:.5g} to {high:.5g}   truth {true:g}")
    (recording,) = fit.recordings.values()
    print(f"residual {1e3 * recording.rmse['voltage']:.2f} mV, noise {1e3 * NOISE:g} mV")
    print(f"with an ordinary capacitor, q = 1: cost {fit.alternative.cost / fit.cost:.0f} times as high")
    fit.plot().savefig(CSV.with_suffix(".png"), dpi=120)


if __name__ == "__main__":
    main()
