"""Print the tables of docs/memory.md: exponentials, certified and measured errors, and time to build a kernel.

    python benchmarks/memory_table.py     # half a minute, half a gigabyte of memory

Counts and errors are the same on any machine but for the last digits of an error; times are not.
"""

import math
import sys
import time

import numpy as np
from certificate import certificate

from fracid.solver.exponentials import compressed_kernel
from fracid.solver.memory import compressed
from fracid.solver.solve import solve_fde

ORDERS = (0.001, 0.1, 0.5, 0.9, 0.99, 0.999, 1.001, 1.1, 1.5, 1.9, 1.999)
STEPS = (20_000, 1_000_000, 10_000_000)
TOLERANCES = (1e-6, 1e-8, 1e-10, 1e-12)
FAMILIES = ("gl", "pi")


def print_modes(lags: int) -> None:
    print(f"\nExponentials beside {lags} exact lags, for 2·10⁴ / 10⁶ / 10⁷ steps\n")
    print("| family, order | " + " | ".join(f"{tolerance:g}" for tolerance in TOLERANCES) + " |")
    print("|---" * (1 + len(TOLERANCES)) + "|")
    for family in FAMILIES:
        for order in ORDERS:
            memories = [compressed(tolerance, lags=lags) for tolerance in TOLERANCES]
            cells = [" / ".join(str(m.kernel(family, order, steps).modes) for steps in STEPS) for m in memories]
            print(f"| {family}, {order:g} | " + " | ".join(cells) + " |")


def print_certificates(tolerance: float = 1e-10, steps: int = 10_000_000) -> None:
    print(f"\nRelative errors of weights, tolerance {tolerance:g}, {steps:,} steps\n")
    print("| family, order | spacing | upper end | lower end | rounding | bound | found | at lag |")
    print("|---" * 8 + "|")
    for family in FAMILIES:
        for order in ORDERS:
            c = certificate(compressed(tolerance), family, order, steps)
            parts = (c.spacing, c.upper, c.lower, c.rounding, c.bound, c.measured)
            print(f"| {family}, {order:g} | " + " | ".join(f"{part:.1e}" for part in parts) + f" | {c.worst_lag:,} |")


def constant_force(t, x, u, p, out):  # noqa: ARG001 (the signature of every right-hand side)
    out[0] = 1.0


def print_recursion(steps: int = 10_000_000) -> None:
    print(
        f"\nRelative error of x, D^q x = 1 by pi2 over {steps:,} steps: weights and the recursion's rounding together\n"
    )
    print("| order | tolerance 1e-10 | tolerance 1e-13 |\n|---|---|---|")
    for order in (0.1, 0.5, 0.9, 0.99, 1.1, 1.5, 1.9):
        start, largest = ([0.0] if order < 1 else [[0.0, 0.0]]), []
        for tolerance in (1e-10, 1e-13):
            run = solve_fde(constant_force, order, start, step=1e-3, end=1e-3 * steps, tolerance=tolerance)
            exact = run.time[1:] ** order / math.gamma(order + 1)
            largest.append(np.abs(run.states[1:, 0] / exact - 1).max())
        print(f"| {order:g} | " + " | ".join(f"{error:.1e}" for error in largest) + " |")


def print_build_times(steps: int = 20_000, repeats: int = 2000) -> None:
    print(f"\nTime to build a kernel of {steps:,} steps, tolerance 1e-10\n")
    for family in FAMILIES:
        orders = [0.8 + 1e-6 * i for i in range(repeats)]  # each another order, as in a fit
        compressed_kernel(family, 0.7, steps, 1e-10, 8)
        start = time.perf_counter()
        for order in orders:
            compressed_kernel(family, order, steps, 1e-10, 8)
        print(f"{family}: {(time.perf_counter() - start) / repeats * 1e6:.0f} µs")


def main() -> int:
    for lags in (8, 16):
        print_modes(lags)
    print_certificates()
    print_recursion()
    print_build_times()
    return 0


if __name__ == "__main__":
    sys.exit(main())
