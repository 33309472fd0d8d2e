"""A supercapacitor that is discharged at constant current: maxwell.toml and eaton.toml use it.

The capacity of a double layer grows with its voltage, C(v) = C0 + C1 v + C2 v², and between the terminals lies v − R i
while the current i is drawn.  Does the charge creep into the electrode's pores, so that the capacitor has an order?

    C(v) D^q v = −i                                             q = 1: an ordinary capacitor

Against it stands the ordinary capacitor with an RC branch beside it, slow pores with a time of their own,

    C(v) v' = −i − (v − v1)/R_1,        C_1 v1' = (v − v1)/R_1,

and with two of them.  The load takes some hundredths of a second to be switched on, τ w' = v − R i − w, and the voltage
w is what is recorded.
"""

from fracid import Model, Parameter


def capacity(v, p):
    return p[0] + (p[1] + p[2] * v) * v


def terminal(x, out, i, current, R, tau):
    """The voltage at the terminals, from where it is recorded; it follows within τ, without loss for the solver."""
    out[i] = (x[0] - R * current - x[i]) / tau
    if len(out) > len(x):
        out[len(x) + i] = 1.0 / tau


def rhs(t, x, u, p, out):  # noqa: ARG001
    out[0] = -u[0] / capacity(x[0], p)
    terminal(x, out, 1, u[0], p[3], p[4])


def rhs1(t, x, u, p, out):  # noqa: ARG001
    slow = (x[0] - x[2]) / p[5]
    out[0] = -(u[0] + slow) / capacity(x[0], p)
    terminal(x, out, 1, u[0], p[3], p[4])
    out[2] = slow / p[6]


def rhs2(t, x, u, p, out):  # noqa: ARG001
    slow, slower = (x[0] - x[2]) / p[5], (x[0] - x[3]) / p[7]
    out[0] = -(u[0] + slow + slower) / capacity(x[0], p)
    terminal(x, out, 1, u[0], p[3], p[4])
    out[2] = slow / p[6]
    out[3] = slower / p[8]


def cell(name, rhs, order, branches):
    of_branches = tuple(
        p for i in range(1, branches + 1) for p in (
            Parameter(f"R_{i}", "Ohm", 3.0, f"resistance of branch {i}", lower=1e-3),
            Parameter(f"C_{i}", "F", 1.0, "its capacity", lower=1e-3),
        )
    )  # fmt: skip
    slow = tuple(f"v{i}" for i in range(1, branches + 1))
    return Model(
        name=name, rhs=rhs, states=("v", "w", *slow), orders=(order, 1.0, *(1.0 for _ in slow)),
        outputs={"voltage": 1}, inputs=("current",), relaxing={"w": "tau"}, follows=dict.fromkeys(("v", *slow), "w"),
        parameters=(
            Parameter("C0", "F s^(q-1)", 20.0, "capacity when empty", lower=1e-3),
            Parameter("C1", "F s^(q-1)/V", 2.0, "how it grows with the voltage"),
            Parameter("C2", "F s^(q-1)/V^2", 0.0, "and with its square"),
            Parameter("R", "Ohm", 0.025, "resistance in series", lower=0.0),
            Parameter("tau", "s", 0.01, "until the load is on, as seen in the recordings", lower=1e-4),
            *of_branches,
        ),
        zero="", source="github Hnandreas/Supercapacitor-Discharge-Measurements-25-F-50-F-DUT-Sets-",
    )  # fmt: skip


model = cell("C(v) of order q", rhs, "q", 0)
one_branch = cell("C(v) and one RC branch", rhs1, 1.0, 1)
two_branches = cell("C(v) and two RC branches", rhs2, 1.0, 2)
