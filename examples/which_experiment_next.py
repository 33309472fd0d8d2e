"""What tells the orders from damping on each rig: the table of docs/design.md.

    python examples/which_experiment_next.py             # two minutes
    python examples/which_experiment_next.py --write     # and put it into docs/design.md

Each built-in rig has the friction that was found on real ones, or else what its source says, and orders 0.95 and 0.97.
For each the half-width of the 95 % interval of λ and of μ, and how much of the interval of μ damping makes: its
correlation with the viscous friction of the pendulum, as −1 … 1.

``plan``   the best two of all releases from 5° to 150° of 3 to 20 s, both angles
``habit``  two releases from 90°, 20 s, both angles
``paper``  two releases from 10°, 20 s, α alone: the experiment of the paper
"""

import argparse
from pathlib import Path

import numpy as np

import fracid
from fracid.models import RIGS

PAGE = Path(__file__).parent.parent / "docs" / "design.md"

ORDERS = {"lambda": 0.95, "mu": 0.97}

DESIGNS = {
    "plan": {"release": (5, 150), "seconds": (3, 6, 12, 20), "levels": 30},
    "habit": {"release": 90, "seconds": 20},
    "paper": {"release": 10, "seconds": 20, "sensors": ("alpha",)},
}


def rig_of(name):
    """The rig with friction on both joints; the arm of one is clamped."""
    model = fracid.rotary_pendulum(name)
    gravity = model.parameter("C4").value
    friction = {"coulomb_theta": 5e-3 * gravity, "coulomb_alpha": 1e-3 * gravity, **RIGS[name].fitted_friction}
    if model.parameter("J_theta").value > 100:
        friction = {n: v for n, v in friction.items() if not n.endswith("theta")}
    if friction.get("b_alpha") == 0.0:
        friction["b_alpha"] = 1e-4  # so that there is damping to tell from
    return model.with_parameters(**friction)


def row(name):
    model = rig_of(name)
    clamped = model.parameter("J_theta").value > 100
    cells, chosen = [], ""
    for design, decisions in DESIGNS.items():
        space = fracid.DesignSpace(rate=500, **decisions)
        orders = ORDERS | ({"lambda": 1.0} if clamped else {})
        free = ("mu", "C1", "b_alpha", "coulomb_alpha") if clamped else ()
        plan = fracid.design(model, space, experiments=2, of=("mu",) if clamped else ("lambda", "mu"), free=free,
                             orders=orders, jobs=2)  # fmt: skip
        names = [*plan.expected]
        cells += ["–" if clamped else half(plan, "lambda"), half(plan, "mu"), correlation(plan, names)]
        if design == "plan":
            chosen = "; ".join(f"{k} × {c.release:.3g}°, {c.seconds:g} s" for c, k in plan.repetitions.items())
    return [name, chosen, *cells]


def half(plan, name):
    error = plan.expected[name].standard_error
    return "not shown" if error is None else f"{1.96 * error:.1e}"


def correlation(plan, names):
    i, k = names.index("mu"), names.index("b_alpha")
    C = plan.covariance
    return f"{C[i, k] / np.sqrt(C[i, i] * C[k, k]):+.2f}".replace("-", "−")


def rigs():
    """The table."""
    heads = ["rig", "plan", *(f"{what}, {design}" for design in DESIGNS for what in ("λ ±", "μ ±", "with b_α"))]
    lines = [heads, ["---", "---", *["---:"] * (len(heads) - 2)], *map(row, RIGS)]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="put the table into docs/design.md")
    asked = parser.parse_args()
    made = rigs()
    print(made)
    if asked.write:
        begin, end = "<!-- rigs: begin -->", "<!-- rigs: end -->"
        before, _, rest = PAGE.read_text(encoding="utf-8").partition(begin)
        PAGE.write_text(f"{before}{begin}\n\n{made}\n{end}{rest.partition(end)[2]}", encoding="utf-8")
