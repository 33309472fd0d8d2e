"""Titin, the spring of muscle: force over length of a relaxed fibre, as titin.toml and leave_one_out.py use it.

A fibre resists a stretch at once like a spring, more the faster it is stretched, and then relaxes for minutes, with no
time of its own.  Titin's domains make a worm-like chain, whose force over its stretch z is, by Marko and Siggia,

    e(z) = 1/(4 (1 − z)²) − 1/4 + z,       z = (L − L_0)/(L_c − L_0),

from its slack length L_0 = 0.95, at which all recordings begin, towards its contour length L_c.  The model is a spring
and a *springpot* in this strain, five constants, one of which is an order:

    F = f0 + k e + c D^ν e,        0 < ν < 1: between a spring and a dashpot.

What it is compared with has Maxwell elements, springs in series with dashpots, in the springpot's place,

    F = f0 + k e + Σ c_i (e − y_i),      ẏ_i = (e − y_i)/τ_i,

one of them as large as the springpot, each further one two constants more; and two of them beside a power law of the
strain in e's place.  The length is measured; its rate, which the springpot resists, fracid takes from it.
"""

from fracid import Model, Parameter
from fracid.models.joints import Complement, maxwell, springpot

L0, LONGEST = 0.95, 1.175  # half a sarcomere at the beginning and at the end of a ramp, relative


def strain(length, contour):
    z = (length - L0) / (contour - L0)
    return 0.25 / (1.0 - z) ** 2 - 0.25 + z


def strain_rate(length, speed, contour):
    z = (length - L0) / (contour - L0)
    return (0.5 / (1.0 - z) ** 3 + 1.0) * speed / (contour - L0)


ELASTIC = (
    Parameter("f0", "1", 0.0, "force at the beginning"),
    Parameter("k", "1", 1.0, "the spring", lower=0.0),
    Parameter("contour", "1", 1.25, "contour length of the chain", lower=1.18),
)
MEASURED = {"inputs": ("length", "speed"), "input_rates": {"speed": "length"}, "zero": "",
            "source": "relaxed fibres, github beards-lab/TitinViscoelasticity"}  # fmt: skip

# --- the springpot -----------------------------------------------------------------------------------------------


def rhs(t, x, u, p, out):  # noqa: ARG001
    springpot(x, out, 0, strain_rate(u[0], u[1], p[2]), p[3])


def force(t, x, u, p):  # noqa: ARG001
    return p[0] + p[1] * strain(u[0], p[2]) + p[3] * x[0]


model = Model(
    name="springpot", rhs=rhs, states=("y",), orders=(Complement("nu"),), outputs={"force": force},
    parameters=(*ELASTIC, Parameter("c", "s^nu", 1.0, "the springpot", lower=0.0)), **MEASURED,
)  # fmt: skip

# --- one to three Maxwell elements -------------------------------------------------------------------------------


def element(i):
    return (Parameter(f"c{i}", "1", 1.0, f"stiffness of Maxwell element {i}", lower=0.0),
            Parameter(f"tau{i}", "s", 1.0, "its time constant", lower=1e-4))  # fmt: skip


def rhs1(t, x, u, p, out):  # noqa: ARG001
    maxwell(x, out, 0, strain(u[0], p[2]), p[3], p[4])


def force1(t, x, u, p):  # noqa: ARG001
    e = strain(u[0], p[2])
    return p[0] + p[1] * e + p[3] * (e - x[0])


def rhs2(t, x, u, p, out):  # noqa: ARG001
    e = strain(u[0], p[2])
    maxwell(x, out, 0, e, p[3], p[4])
    maxwell(x, out, 1, e, p[5], p[6])


def force2(t, x, u, p):  # noqa: ARG001
    e = strain(u[0], p[2])
    return p[0] + p[1] * e + p[3] * (e - x[0]) + p[5] * (e - x[1])


def rhs3(t, x, u, p, out):  # noqa: ARG001
    e = strain(u[0], p[2])
    maxwell(x, out, 0, e, p[3], p[4])
    maxwell(x, out, 1, e, p[5], p[6])
    maxwell(x, out, 2, e, p[7], p[8])


def force3(t, x, u, p):  # noqa: ARG001
    e = strain(u[0], p[2])
    return p[0] + p[1] * e + p[3] * (e - x[0]) + p[5] * (e - x[1]) + p[7] * (e - x[2])


def of_elements(count, rhs, force, elastic=ELASTIC):
    states = tuple(f"y{i}" for i in range(1, count + 1))
    return Model(
        name=f"{count} Maxwell", rhs=rhs, states=states, orders=(1.0,) * count, outputs={"force": force},
        relaxing={y: f"tau{i}" for i, y in enumerate(states, 1)},
        parameters=(*elastic, *(p for i in range(1, count + 1) for p in element(i))), **MEASURED,
    )  # fmt: skip


maxwell1 = of_elements(1, rhs1, force1)
maxwell2 = of_elements(2, rhs2, force2)
maxwell3 = of_elements(3, rhs3, force3)

# --- a power law of the strain, two Maxwell elements -------------------------------------------------------------


def power_law(length, slack, power):
    return ((length - slack) / (LONGEST - slack)) ** power - ((L0 - slack) / (LONGEST - slack)) ** power


def rhs_power(t, x, u, p, out):  # noqa: ARG001
    e = power_law(u[0], p[2], p[3])
    maxwell(x, out, 0, e, p[4], p[5])
    maxwell(x, out, 1, e, p[6], p[7])


def force_power(t, x, u, p):  # noqa: ARG001
    e = power_law(u[0], p[2], p[3])
    return p[0] + p[1] * e + p[4] * (e - x[0]) + p[6] * (e - x[1])


POWER = (
    ELASTIC[0], ELASTIC[1],
    Parameter("slack", "1", 0.8, "length from which on it resists", upper=0.949),
    Parameter("power", "-", 6.0, "of the strain", lower=1.0),
)  # fmt: skip
power2 = of_elements(2, rhs_power, force_power, POWER)
