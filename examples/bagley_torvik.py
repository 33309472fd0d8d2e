"""A plate in a viscous fluid: Bagley and Torvik's equation, against its exact solution.

    python examples/bagley_torvik.py              # prints the errors
    python examples/bagley_torvik.py plate.png    # and draws the motion

A rigid plate on a spring, immersed in a Newtonian fluid, obeys  y'' + c D^1.5 y + k y = f(t):  the fluid that it drags
along diffuses, and so remembers.  Here it is loaded with f = k at t = 0 and settles at y = 1.

*Exact.*  The orders are multiples of 1/2, and from one to the next the derivatives compose: with
x = (y − 1, D^.5 y, y', D^1.5 y) it is D^.5 x = A x, so that x(t) = V E_.5(Λ t^.5) V⁻¹ x(0) with the eigenvalues of A.

*Solved.*  As `fracid.linear_multi_term` makes it a system: ``chain``, the default, in two states, D^1.5 y = z and
D^.5 z = f − c z − k y, and ``star`` in three; `fracid.solver.reduction` says which when.
"""

import sys

import numpy as np
from pymittagleffler import mittag_leffler  # pip install pymittagleffler

import fracid

STIFFNESS = 4.0  # k [1/s²]
DAMPINGS = (0.1, 1.0, 10.0, 100.0)  # c [s^-0.5]
STEPS = (1 / 20, 1 / 40, 1 / 80, 1 / 160)  # [s]
END = 10.0  # [s]


def load(t, u, p):  # noqa: ARG001
    """f(t): a weight put on at t = 0."""
    return p[0]


def solve(damping, step, form):
    """Time [s] and y, both of shape (n,)."""
    plate = fracid.linear_multi_term({2: 1.0, 1.5: damping, 0: STIFFNESS}, load, initial=[0.0, 0.0],
                                     parameters=[STIFFNESS], form=form)  # fmt: skip
    run = plate.solve(step=step, end=END)
    return run.time, run.states[:, plate.column[0]]


def exact(damping, time):
    """y at some times, shape (n,)."""
    A = np.diag(np.ones(3, dtype=complex), 1)
    A[3] = -STIFFNESS, 0, 0, -damping
    eigenvalues, V = np.linalg.eig(A)
    start = np.linalg.solve(V, [-1, 0, 0, 0])
    return 1 + (mittag_leffler(np.outer(time**0.5, eigenvalues), 0.5, 1.0) @ (V[0] * start)).real


def error(damping, step, form):
    """Largest error from 1 s on: before, the singular start shows."""
    time, y = solve(damping, step, form)
    late = time >= 1
    return np.abs(y[late] - exact(damping, time[late])).max()


def draw(path):
    """The motion for each damping, and what the solver makes of it at the coarsest step."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 4), layout="constrained")
    axes = figure.subplots()
    fine = np.linspace(0, END, 1001)
    for damping in DAMPINGS[:3]:
        (line,) = axes.plot(fine, exact(damping, fine), label=f"c = {damping:g}")
        axes.plot(*solve(damping, STEPS[0], "chain"), ".", markersize=3, color=line.get_color())
    axes.set(
        xlabel="t [s]", ylabel="y", title=f"A plate in a fluid: exact (lines), fracid at h = {STEPS[0]:g} s (dots)"
    )
    axes.legend()
    figure.savefig(path, dpi=150)


def main():
    """Print the errors, and draw where a path is given."""
    print("form   damping  " + "".join(f"h = 1/{round(1 / h):<8}" for h in STEPS) + "order")
    for form in ("chain", "star"):
        for damping in DAMPINGS:
            errors = [error(damping, h, form) for h in STEPS]
            row = "".join(f"{e:<12.1e}" for e in errors)
            print(f"{form:5}  {damping:<7g}  {row}{np.log2(errors[-2] / errors[-1]):.2f}")
    if len(sys.argv) > 1:
        draw(sys.argv[1])
        print(f"wrote {sys.argv[1]}")


if __name__ == "__main__":
    main()
