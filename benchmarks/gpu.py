"""What a GPU would give: the loop of ``pi2`` compiled for it from the same Python, beside lanes on the processor.

``python benchmarks/gpu.py`` steps the rotary pendulum's release, 20,000 steps of other orders and constants a run, and
prints runs a second.  It needs numba-cuda, cupy and a card; with ``NUMBA_ENABLE_CUDASIM=1`` it steps a few runs of a
few steps in Numba's simulator, and asserts their accuracy.  Nothing in fracid uses a GPU.
"""

# ruff: noqa: ARG005 (stand-ins take what the functions take in whose place they are)

from __future__ import annotations

import os
import sys
import time
from multiprocessing import get_context
from types import CellType, FunctionType
from typing import Any, NamedTuple

import numpy as np
from numba import cuda, float64

import fracid
from fracid.solver import methods, schemes, solve
from fracid.solver.arguments import Options
from fracid.solver.loop_arguments import Run
from fracid.solver.memory import compressed
from fracid.solver.right_hand_side import compile_rhs
from fracid.solver.starting import Start, begun

SIMULATED = bool(os.environ.get("NUMBA_ENABLE_CUDASIM"))
DISTINCT, STEPS, EVERY = (2, 120, 20) if SIMULATED else (64, 20_000, 400)
STATES, BLOCK, WARP = 4, 8, int(os.environ.get("WARP", "64"))


class Kernels(NamedTuple):
    """Of all runs, the runs' axis last."""

    weights: Any
    start: Any
    z: Any
    c: Any
    first: Any
    sizes: Any
    lags: int


def look_ahead(n, head, window, sums, ahead, kernels):
    """The history of eight steps, with the powers of z made on the way."""
    run = cuda.grid(1)
    for i in range(len(ahead)):
        L, modes = kernels.sizes[i, 0], kernels.sizes[i, 1]
        a0 = a1 = a2 = a3 = a4 = a5 = a6 = a7 = 0.0
        w0, w1, w2, w3 = (kernels.weights[0, i, run], kernels.weights[1, i, run], kernels.weights[2, i, run],
                          kernels.weights[3, i, run])  # fmt: skip
        w4, w5, w6 = kernels.weights[4, i, run], kernels.weights[5, i, run], kernels.weights[6, i, run]
        for k in range(min(n - 1, L)):
            v, w7 = window[i, head - 1 - k], kernels.weights[7 + k, i, run]
            a0, a1, a2, a3 = a0 + v * w0, a1 + v * w1, a2 + v * w2, a3 + v * w3
            a4, a5, a6, a7 = a4 + v * w4, a5 + v * w5, a6 + v * w6, a7 + v * w7
            w0, w1, w2, w3, w4, w5, w6 = w1, w2, w3, w4, w5, w6, w7
        if n <= L:
            v = window[i, head - n]
            for j in range(BLOCK):
                ahead[i, j] = v * kernels.start[n - 1 + j, i, run]
        else:
            oldest = head - L - BLOCK
            if n > L + 1:
                v0, v1, v2, v3 = window[i, oldest], window[i, oldest + 1], window[i, oldest + 2], window[i, oldest + 3]
                v4, v5, v6, v7 = (window[i, oldest + 4], window[i, oldest + 5], window[i, oldest + 6],
                                  window[i, oldest + 7])  # fmt: skip
            for m in range(modes):
                z = kernels.z[m, i, run]
                if n == L + 1:
                    y = kernels.first[m, i, run] * window[i, head - n]
                else:
                    y = sums[i, m]
                    y = (((y * z + v0) * z + v1) * z + v2) * z + v3
                    y = (((y * z + v4) * z + v5) * z + v6) * z + v7
                sums[i, m] = y
                y *= kernels.c[m, i, run]
                square = z * z
                odd, fourth = y * z, square * square
                a0, a1, a2, a3 = a0 + y, a1 + odd, a2 + y * square, a3 + odd * square
                y, odd = y * fourth, odd * fourth
                a4, a5, a6, a7 = a4 + y, a5 + odd, a6 + y * square, a7 + odd * square
            for j in range(BLOCK):
                ahead[i, j] = 0.0
        ahead[i, 0] += a0
        ahead[i, 1] += a1
        ahead[i, 2] += a2
        ahead[i, 3] += a3
        ahead[i, 4] += a4
        ahead[i, 5] += a5
        ahead[i, 6] += a6
        ahead[i, 7] += a7


def enter(i, j, v, head, window, ahead, kernels):
    """A new sample, and its share of the rest of the block."""
    run = cuda.grid(1)
    window[i, head] = v
    for later in range(j + 1, BLOCK):
        ahead[i, later] += v * kernels.weights[later - j - 1, i, run]


def ported(function: Any, own: dict[str, Any]) -> Any:
    """A function of fracid and all that it calls, compiled for the GPU, some replaced."""
    code = getattr(function, "py_func", None) or getattr(function, "__wrapped__", None) or function
    names, known, cells = set(code.__code__.co_names), dict(code.__globals__), code.__closure__
    for name in names & known.keys():
        value = known[name]
        inner = getattr(value, "py_func", value)
        if name not in own and isinstance(inner, FunctionType) and inner.__module__.startswith("fracid."):
            own[name] = ported(value, own)
    if cells:  # of a right-hand side: what it closes over are its helpers and numbers
        cells = tuple(_cell(c.cell_contents, own) for c in cells)
    return cuda.jit(device=True)(FunctionType(code.__code__, known | own, code.__name__, None, cells))


def _cell(value: Any, own: dict[str, Any]) -> Any:
    inner = getattr(value, "py_func", value)
    return CellType(ported(value, own) if isinstance(inner, FunctionType) else value)


def device(function):
    """What the GPU calls."""
    return cuda.jit(device=True)(function)


def compiled(rhs: Any, parameters: int, inputs: int) -> Any:
    """The kernel: a run a thread."""
    own = {"evaluate": ported(rhs, {})}
    f = own["evaluate"]
    own["evaluate"] = device(lambda rhs, t, x, u, p, out: f(t, x, u, p, out))
    own |= {
        "look_ahead": device(look_ahead), "enter": device(enter), "flush_denormals": device(lambda: 0),
        "restore": device(lambda mode: None), "anywhere": device(lambda condition: condition),
    }  # fmt: skip
    step = ported(schemes.step_pi2, own)

    @cuda.jit
    def kernel(runs, gain, u, p, past, slope, h, steps, every, limit, bounds, kernels, corrections, relaxing, after,
               begin, x0, together, knots, parabolas, window, sums, newest, out, ended):  # fmt: skip
        k = cuda.grid(1)
        if k >= runs:
            return
        x, before, earlier = (cuda.local.array(STATES, float64), cuda.local.array(STATES, float64),
                              cuda.local.array(STATES, float64))  # fmt: skip
        last, part, scale = (cuda.local.array(STATES, float64), cuda.local.array(STATES, float64),
                             cuda.local.array(STATES, float64))  # fmt: skip
        jump, entered, share = (cuda.local.array(STATES, float64), cuda.local.array(STATES, float64),
                                cuda.local.array(STATES, float64))  # fmt: skip
        f, trial, now = (cuda.local.array(STATES, float64), cuda.local.array(STATES, float64),
                         cuda.local.array(inputs, float64))  # fmt: skip
        ahead, W = cuda.local.array((4, 8), float64), cuda.local.array((5, 8), float64)
        start = cuda.local.array((1, 4), float64)
        own_p, own_gain, own_newest = (cuda.local.array(parameters, float64), cuda.local.array(STATES, float64),
                                       cuda.local.array(STATES, float64))  # fmt: skip
        for i in range(parameters):
            own_p[i] = p[i, k]
        for i in range(STATES):
            own_gain[i], own_newest[i] = gain[i, k], newest[i, k]
            earlier[i] = last[i] = jump[i] = 0.0
        for i in range(inputs):
            now[i] = u[0, i]
        run = Run(own_gain, own_gain, u, own_p, past[:, :, k], slope[:, k], 0.0, h, steps, every, limit, bounds,
                  kernels, corrections, False, relaxing, bounds[:0], after)  # fmt: skip
        started = Start(begin[:, :, k], x0[:, k], together, knots, parabolas[:, :, :, k])
        work = ((x, before, earlier, last, part, own_newest, scale, jump, entered, share), (f, trial), now, W, start)
        ended[0, k], ended[1, k] = step(0, run, started, (window[:, :, k], sums[:, :, k], ahead), work, False,
                                        out[:, :, k])  # fmt: skip

    return kernel


def sets() -> tuple[Any, Any, Any]:
    """Distinct runs of the release."""
    rig = fracid.rotary_pendulum("srv02-rotpen", zero="hanging")
    random, values = np.random.default_rng(1), rig.parameter_vector()
    options = Options("pi2", compressed(), every=EVERY)
    rhs, u, posed = compile_rhs(rig.rhs), np.zeros((1, len(rig.inputs))), []
    for _ in range(DISTINCT):
        p = values * (1 + 0.02 * random.standard_normal(len(values)))
        orders = dict(zip(("lambda", "mu"), random.uniform(0.86, 0.9, 2), strict=True))
        q = np.array(rig.state_orders(orders, p))
        x = np.zeros(STATES)
        x[list(rig.states).index("alpha")] = random.uniform(0.5, 1.5)
        posed.append((solve.Equation(rhs, q, u, p, 1.0, (), None), solve.InitialCondition(x, None, 0.0)))
    return posed, options, rig


def again(count: int) -> None:
    """What a worker does."""
    posed, options, _ = sets()
    solve.integrate_all(posed, 1e-3, STEPS, options, range(min(count, DISTINCT)))


def main(sizes: list[int]) -> None:
    """Step on both, compare, print."""
    posed, options, _ = sets()
    args = 1e-3, STEPS, options
    solve.integrate_all(posed, *args, range(min(8, DISTINCT)))
    clock = time.perf_counter()
    expected = np.stack([t.states for t in solve.integrate_all(posed, *args, range(DISTINCT)).values()], axis=-1)
    alone = DISTINCT / (time.perf_counter() - clock)
    cores = len(os.sched_getaffinity(0))
    if not SIMULATED and not os.environ.get("SKIP"):
        with get_context("fork").Pool(cores) as pool:
            pool.map(again, [1] * cores, 1)
            clock = time.perf_counter()
            pool.map(again, [DISTINCT] * 4 * cores, 1)
            together = 4 * cores * DISTINCT / (time.perf_counter() - clock)
        print(f"CPU, lanes: {alone:.0f} runs/s on one core, {together:.0f} on {cores}, in processes", flush=True)
    clock = time.process_time()
    orders = np.stack([e.orders for e, _ in posed], axis=-1).ravel()
    all_kernels = solve._kernels(options.memory, methods.METHODS["pi2"].family, orders, STEPS, {})
    runs = [solve._run(each, *args, all_kernels) for each in posed]
    starts = begun(solve.address_of(posed[0][0].rhs), runs, "pi")
    print(f"weights and start, on the CPU: {1e3 * (time.process_time() - clock) / DISTINCT:.2f} ms a run", flush=True)
    assert len({s.together for s in starts}) == 1
    k, L, M = all_kernels, all_kernels.lags, all_kernels.modes
    table = k.table[k.of].reshape(STATES, DISTINCT, -1)
    assert not k.own[:, 1].any()
    sizes_of = k.sizes[k.of].reshape(STATES, DISTINCT, 2).max(axis=1)
    sizes_of[:, 0] = k.sizes[k.of].reshape(STATES, DISTINCT, 2)[:, 0, 0]
    assert (k.sizes[k.of].reshape(STATES, DISTINCT, 2)[..., 0] == sizes_of[:, :1]).all(), "lags differ"
    first = 2 * (L + 16)
    print("lags, modes of the states:", sizes_of.tolist(), flush=True)

    def last(a):
        return np.ascontiguousarray(np.moveaxis(a, 1, -1).swapaxes(0, 1))

    data = {
        "weights": last(table[..., 8 : L + 16]), "start": last(table[..., L + 16 + 8 : first]),
        "z": last(table[..., first + 8 * M : first + 9 * M]), "c": last(table[..., first + 10 * M :: 8]),
        "first": last(table[..., first + M : first + 2 * M]),
        "gain": np.stack([r.gain for r in runs], -1), "p": np.stack([r.p for r in runs], -1),
        "past": np.stack([r.past for r in runs], -1), "slope": np.stack([r.slope for r in runs], -1),
        "begin": np.stack([s.known for s in starts], -1), "x0": np.stack([s.x0 for s in starts], -1),
        "parabolas": np.stack([s.parabolas for s in starts], -1),
    }  # fmt: skip
    own = k.own[k.of, 0].reshape(STATES, DISTINCT)
    data["newest"] = data["gain"] * own
    if SIMULATED:
        tile, zeros, see = np.tile, np.zeros, cuda.to_device
        numbers = np.asarray
    else:
        import cupy

        tile, zeros, see, numbers = cupy.tile, cupy.zeros, cuda.as_cuda_array, cupy.asarray
    one = runs[0]
    kernel = compiled(posed[0][0].rhs.py_func, len(one.p), one.u.shape[1])
    width = min(STEPS, L + max(256, L // 4)) + 24
    for count in sizes:
        n = DISTINCT * -(-count // DISTINCT)
        times = (n // DISTINCT,)
        there = {name: tile(numbers(np.ascontiguousarray(a)), (1,) * (a.ndim - 1) + times) for name, a in data.items()}
        window, sums = zeros((STATES, width, n)), zeros((STATES, M, n))
        out, ended = zeros((STEPS // EVERY + 1, STATES, n)), zeros((2, n), dtype=np.int64)
        seen = see(out), see(ended)
        v = {name: see(a) for name, a in there.items()}
        kernels = Kernels(v["weights"], v["start"], v["z"], v["c"], v["first"], see(numbers(sizes_of)), L)
        shared = [see(numbers(a)) for a in (one.u, one.bounds, np.zeros(0, np.int64), np.zeros((0, one.u.shape[1])),
                                             starts[0].knots)]  # fmt: skip
        for attempt in range(1 if SIMULATED or count > sizes[0] else 2):
            clock = time.perf_counter()
            kernel[-(-n // WARP), WARP](
                n, v["gain"], shared[0], v["p"], v["past"], v["slope"], 1e-3, STEPS, EVERY, one.limit, shared[1],
                kernels, one.corrections, shared[2], shared[3], v["begin"], v["x0"], starts[0].together, shared[4],
                v["parabolas"], see(window), see(sums), v["newest"], *seen,
            )  # fmt: skip
            cuda.synchronize()
            seconds = time.perf_counter() - clock
            if not attempt and not SIMULATED and count == sizes[0]:
                print(f"first call, with compiling: {seconds:.1f} s", flush=True)
        found, how = seen[0].copy_to_host(), seen[1].copy_to_host()[1]
        error = np.abs(found[1:, :, :DISTINCT] - expected[1:]).max() / np.abs(expected).max()
        per = sum(a.nbytes for a in (*there.values(), window, sums, out)) / n
        bad = int((how != 0).sum())
        print(f"{n} runs: {seconds:.2f} s, {n / seconds:.0f} runs/s, {per / 1e3:.0f} kB a run, error {error:.1e}, "
              f"{bad} ended early", flush=True)  # fmt: skip
        del there, v, window, sums, out, kernels, seen
        assert error < 1e-9, "the GPU's states are not the processor's"
        assert bad == 0, "runs ended early"


if __name__ == "__main__":
    main([int(a) for a in sys.argv[1:]] or ([DISTINCT] if SIMULATED else [1024, 8192, 65536, 262144]))
