r"""Integer-order state space: each fractional operator as a positive sum of lags, nonlinear and linearised.

A state of order q with :math:`τ_0^{q-1} D^q x = f` is :math:`x = x_0 + τ_0^{1-q} s^{-q} f`.  Below order 1

.. math::

    s^{-q} = \frac{\sin πq}{π} \int_0^\infty \frac{r^{-q}}{s + r}\,dr ≈ \sum_k \frac{a_k}{s + p_k}, \qquad
    a_k > 0,\; p_0 = 0 < p_1 < p_2 < …,

and so is the sum that stands for it: the :math:`a_k` are those of non-negative least squares [LH]_ for poles at equal
ratios.  Such an operator is stable and passive whatever is rounded off it.  Of an order above 1 it is 1/s times the sum
for q − 1.  All states together:

.. math::  \dot z = P z + B f(x, u), \qquad x = x_0 + C z,

P diagonal.  The data can tell from one period in the longest recording to half the sampling rate.  The poles are the
fewest with which the error from a tenth of the lower frequency to the upper is below :data:`DECIBEL` and
:data:`DEGREES`.  What is slower is off most; so is what dies within a swing, since the sum is right along the imaginary
axis.

Linearised about a posture, :math:`f ≈ F (x - x_e) + G (u - u_e)`:

.. math::  \dot z = (P + B F C)\,z + B G\,(u - u_e), \qquad x - x_e = C z,

and exactly :math:`x - x_e = (\mathrm{diag}(τ_0^{q-1} s^q) - F)^{-1} G (u - u_e)`, whose poles, zeros of the
determinant, are found from those of the sum by the secant method.  Dry friction has no linear part in motion: it is
left out, and so are the play of a gear and a motor's dead zone.  A presliding joint has one while it sticks: a spring
σ₀ and a dashpot σ₁.

References
----------
.. [LH] C. L. Lawson, R. J. Hanson, *Solving Least Squares Problems* (1974), chapter 23.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fracid.arrays import FloatArray, Pair, by_name
from fracid.errors import InputError, installed
from fracid.export.recursion import Case
from fracid.figures import Style, draw
from fracid.findings import Words
from fracid.models import Model
from fracid.problem import Problem
from fracid.solver.inputs import Driven
from fracid.solver.methods import METHODS
from fracid.solver.right_hand_side import names_time
from fracid.solver.solve import simulate, time_scale
from fracid.units import with_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from fracid.runs.saved import SavedRun

SAYS = Words("export/state_space.toml")

ComplexArray = NDArray[np.complex128]

DECIBEL, DEGREES = 0.01, 0.02
"""Errors of an operator over the data's band that are allowed; a swing that dies slowly notices five times as much."""

WIDER = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 64.0)
"""By what factor the poles may reach beyond the data's band, on each side."""

BELOW = 10.0
"""How far below the band the sum is as good: a step that is held for a recording's length drifts as slowly."""

PLACES, CHECKED = 12, 400
"""Frequencies a decade at which a sum is made, and of the band at which it is held against the operator."""

OVERDAMPED = 0.95
"""Damping from which on a pair of poles is the sums', two real poles that nearly meet."""

STIFF = 1e3
"""Poles [rad/s] from which on an explicit solver would need small steps."""

EXACT = 1e-7
"""Relative error of a simulation."""

STEPS, ROUNDED, TINY = 10.0 ** -np.arange(2, 15), 1e3 * np.finfo(float).eps, np.finfo(float).tiny
"""Steps of differences, beside a value above 1, and what rounding may do to them."""

PULLED = 1e-4
"""Of what a pendulum is pulled to its rest with, a rad off, that pulls any other output to one of its own."""


@dataclass(frozen=True)
class Operator:
    """1/s^q as partial fractions: Σ residue/(s + pole)."""

    order: float
    """q."""
    poles: FloatArray
    """[rad/s], 0 first, shape (n,)."""
    residues: FloatArray
    """Shape (n,)."""
    band: tuple[float, float]
    """Of the recording: one period in the longest to half the sampling rate [rad/s]."""

    def response(self, omega: ArrayLike) -> ComplexArray:
        """At iω."""
        s = 1j * np.asarray(omega, dtype=np.float64)
        return np.asarray((self.residues / (s[..., None] + self.poles)).sum(axis=-1))

    @cached_property
    def errors(self) -> tuple[float, float]:
        """Largest error over the band, in dB and in degrees."""
        omega = np.geomspace(*self.band, CHECKED)
        ratio = self.response(omega) * (1j * omega) ** self.order
        return float(np.abs(20 * np.log10(np.abs(ratio))).max()), float(np.abs(np.degrees(np.angle(ratio))).max())

    def __str__(self) -> str:
        """Say it in a sentence."""
        if len(self.poles) == 1:
            return "1/s is exact."
        decibel, degrees = self.errors
        return SAYS("band", own=self, count=len(self.poles) - 1, last=self.poles[-1], decibel=decibel, degrees=degrees)


MOST_POLES = 100
"""An order next to 0 takes more, and is refused."""


@lru_cache(maxsize=1024)  # a controller is tried on hundreds of draws, and a sum takes five times as long as a trial
def positive_sum(order: float, band: tuple[float, float], within: tuple[float, float] = (DECIBEL, DEGREES)) -> Operator:
    """1/s^order as a sum of lags, below order 1 with residues above 0.

    Parameters
    ----------
    order : float
        Strictly between 0 and 2.
    band : (float, float)
        Where it must be right [rad/s].
    within : (float, float)
        How right, in dB and degrees.

    Returns
    -------
    Operator
        With the fewest poles that are.

    Raises
    ------
    InputError
        If the order or the band is none, or the order is so near 0 that no sum of lags is it.

    Examples
    --------
    >>> operator = positive_sum(0.9, (0.3, 3000.0))
    >>> len(operator.poles), max(operator.errors) < 0.02, bool(operator.residues.min() > 0)
    (14, True, True)
    >>> bool(abs(operator.response(10.0) * (10j) ** 0.9 - 1) < 2e-3)
    True
    """
    if not 0 < order < 2:
        raise InputError(f"The order is {order!r}; it must lie strictly between 0 and 2.")
    if not 0 < band[0] < band[1] < math.inf:
        raise InputError(f"band = {band!r}: expected two frequencies above 0 [rad/s], the lower first.")
    if order == 1.0:
        return Operator(order, np.zeros(1), np.ones(1), band)
    low, high = wide = band[0] / BELOW, band[1]
    for count in range(2, MOST_POLES):
        for lower, higher in itertools.product(WIDER, WIDER):
            poles = np.geomspace(low / lower, high * higher, count)
            operator = Operator(order, *_fitted(order, wide, poles, within), wide)
            decibel, degrees = operator.errors
            if decibel <= within[0] and degrees <= within[1] and operator.poles[0] == 0.0:
                return replace(operator, band=band)
    raise InputError(f"1/s^{order:.6g} is no sum of {MOST_POLES} lags from {low:.3g} to {high:.3g} rad/s.")


def _fitted(order: float, band: tuple[float, float], poles: FloatArray, within: tuple[float, float]) -> Pair:
    """Poles, 0 among them, and residues of s^−order: relative errors as large, for their bounds, in size and angle."""
    from scipy.optimize import nnls

    places = math.ceil(PLACES * math.log10(band[1] / band[0])) + 2
    s, above = 1j * np.geomspace(*band, places)[:, None], order > 1
    poles = poles if above else np.append(0.0, poles)
    ratio = s ** (order - above) / (s + poles)
    if above:  # next to order 1 all that is left is nearly constant: a pole far above the band is one
        ratio = np.column_stack([ratio * poles, s ** (order - 1)])
    size, angle = math.log(10) / 20 * within[0], math.radians(within[1])
    wanted = np.repeat([1 / size, 0.0], places)
    amplitudes, _ = nnls(np.vstack([ratio.real / size, ratio.imag / angle]), wanted, maxiter=100 * len(poles))
    if above:  # a p/s/(s + p) = a/s - a/(s + p)
        poles, amplitudes = np.append(0.0, poles), np.append(amplitudes.sum(), -amplitudes[:-1])
    kept = amplitudes != 0
    return poles[kept], amplitudes[kept]


# --- models ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class LinearModel:
    """A linear model about a posture, of integer order, beside the fractional one that it stands for."""

    name: str
    """``hanging``, ``upright``; of a model of yours ``rest``."""
    about: FloatArray
    """x_e, shape (n_states,)."""
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    driven: FloatArray
    """u_e, the inputs there, shape (n_inputs,)."""
    orders: FloatArray
    """Of each state, shape (n_states,)."""
    weight: FloatArray
    """τ₀^(q−1) of each state, shape (n_states,)."""
    F: FloatArray
    """∂f/∂x, shape (n_states, n_states)."""
    G: FloatArray
    """∂f/∂u, shape (n_states, n_inputs)."""
    A: FloatArray
    """P + B F C, shape (n, n)."""
    B: FloatArray
    C: FloatArray
    """Outputs from z, shape (n_outputs, n)."""
    rows: tuple[int, ...]
    """The states that are the outputs."""

    @property
    def D(self) -> FloatArray:
        """Zero: all operators are strictly proper."""
        return np.zeros((len(self.outputs), len(self.inputs)))

    @cached_property
    def poles(self) -> ComplexArray:
        """Eigenvalues of A [rad/s], by their distance from zero."""
        eigenvalues = np.linalg.eigvals(self.A).astype(np.complex128)
        return eigenvalues[np.argsort(np.abs(eigenvalues))]

    def response(self, omega: ArrayLike) -> ComplexArray:
        """Outputs over inputs at iω, shape (n_omega, n_outputs, n_inputs)."""
        s = 1j * np.ravel(omega)[:, None, None]
        return np.asarray(self.C @ np.linalg.solve(s * np.eye(len(self.A)) - self.A, self.B[None]))

    def exact_response(self, omega: ArrayLike) -> ComplexArray:
        """The same of the fractional model."""
        return np.asarray(np.linalg.solve(self._matrix(1j * np.ravel(omega)), self.G[None])[:, list(self.rows)])

    def _matrix(self, s: ArrayLike) -> ComplexArray:
        """diag(τ₀^(q−1) s^q) − F, of each s."""
        return np.asarray(np.eye(len(self.F)) * self.weight * np.asarray(s)[..., None, None] ** self.orders - self.F)

    @cached_property
    def modes(self) -> tuple[Mode, ...]:
        """The poles that swing or grow, each beside the fractional model's own."""
        scale = float(np.abs(np.linalg.eigvals(self.F)).max()) or 1.0
        swings = (p for p in self.poles if p.imag > 0 and -p.real < OVERDAMPED * abs(p))
        telling = [*swings, *(p for p in self.poles if p.imag == 0 and p.real > 1e-6 * scale)]
        return tuple(Mode(complex(p), self._exact_pole(complex(p))) for p in telling)

    def _exact_pole(self, near: complex) -> complex | None:
        """Where the determinant is zero on the principal sheet, by the secant method."""
        from scipy.optimize import newton

        pole = newton(lambda p: complex(np.linalg.det(self._matrix(p))), near, x1=near * (1 + 1e-4), maxiter=50,
                      tol=1e-12 * abs(near), disp=False)  # fmt: skip
        return pole if abs(pole - near) < 0.2 * abs(near) else None

    def control(self) -> Any:
        """As a python-control StateSpace.

        Raises
        ------
        InputError
            Without python-control.
        """
        return _control().ss(self.A, self.B, self.C, self.D, inputs=list(self.inputs), outputs=list(self.outputs),
                             states=[f"z{i}" for i in range(len(self.A))], name=self.name)  # fmt: skip

    def to_json(self) -> dict[str, Any]:
        """Everything, as plain JSON values."""
        return {
            "inputs": list(self.inputs), "outputs": list(self.outputs),
            **{n: getattr(self, n).tolist() for n in ("about", "driven", *"ABCDFG")},
            "poles": {"real": self.poles.real.tolist(), "imag": self.poles.imag.tolist()},
            "damping": [m.to_json() for m in self.modes],
        }  # fmt: skip


@dataclass(frozen=True)
class Mode:
    """A pole that swings or grows; of a pair the one above."""

    pole: complex
    """Of the integer-order model [rad/s]."""
    exact: complex | None
    """Of the fractional model; None where none is near."""

    @property
    def frequency(self) -> float:
        """|p| [rad/s]."""
        return abs(self.pole)

    @property
    def damping(self) -> float:
        """ζ = −Re p/|p|."""
        return -self.pole.real / abs(self.pole)

    def __str__(self) -> str:
        """Say it in words."""
        own = Mode(self.exact, None) if self.exact else None
        if self.pole.imag > 0:
            exact = own and f" (the fractional model's own pole: {own.frequency:.4g} rad/s, {own.damping:.3g})"
            return f"swings at {self.frequency:.4g} rad/s with a damping of {self.damping:.3g}{exact or ''}"
        exact = own and f" (the fractional model's own: {1 / own.pole.real:.3g} s)"
        return f"falls with a time constant of {1 / self.pole.real:.3g} s{exact or ''}"

    def to_json(self) -> dict[str, Any]:
        """As plain JSON values."""
        return {"pole": [self.pole.real, self.pole.imag], "frequency": self.frequency, "damping": self.damping,
                "fractional_pole": None if self.exact is None else [self.exact.real, self.exact.imag]}  # fmt: skip


@dataclass(frozen=True)
class IntegerModel:
    """A run's model of integer order: ż = −p z + B f(x, u), x = x_0 + C z."""

    model: Model
    parameters: FloatArray
    orders: FloatArray
    operators: tuple[Operator, ...]
    """Of each state."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Output → its unit where that is not the model's."""
    around: FloatArray | None = None
    """Inputs about which the recordings are, shape (n_inputs,); 0 if left out."""

    def __post_init__(self) -> None:
        """Refuse what depends on time, as every other program does."""
        _ = names_time(self.model.rhs) and self.model.program

    def plot(self, posture: str = "hanging", *, style: str | Style = "screen") -> Figure:
        """Magnitude, phase and step response about a posture; see :func:`fracid.plots.linear_response`.

        Parameters
        ----------
        posture : str
            A key of `linear`: ``hanging`` or ``upright``.
        style : str or Style
            ``screen``, ``journal`` or one's own; see :mod:`fracid.figures`.
        """
        return draw("linear_response", self, posture, style=style)

    @cached_property
    def weight(self) -> FloatArray:
        """τ₀^(q−1) of each state."""
        return np.asarray(time_scale(self.model, self.parameters) ** (self.orders - 1))

    @cached_property
    def decay(self) -> FloatArray:
        """p, the diagonal of −P [rad/s], shape (n,)."""
        return np.concatenate([o.poles for o in self.operators])

    @cached_property
    def B(self) -> FloatArray:
        """Which z each f drives, shape (n, n_states)."""
        return np.repeat(np.eye(len(self.operators)), [len(o.poles) for o in self.operators], axis=0)

    @cached_property
    def C(self) -> FloatArray:
        """States from z, shape (n_states, n)."""
        residues = np.concatenate([o.residues / w for o, w in zip(self.operators, self.weight, strict=True)])
        return np.asarray(self.B.T * residues)

    def f(self, x: FloatArray, u: FloatArray, parameters: FloatArray | None = None) -> FloatArray:
        """The right-hand side."""
        return self.model.derivatives(x, u, self.parameters if parameters is None else parameters)[: len(x)]

    def simulate(self, x0: FloatArray, inputs: Driven, step: float, steps: int) -> FloatArray:
        """States on a grid, shape (steps + 1, n_states); NaN after a failure."""
        from scipy.integrate import solve_ivp

        before, after = inputs
        driven = len(before) > 1

        def slope(t: float, z: FloatArray) -> FloatArray:
            k = min(int(t / step), len(before) - 2)
            u = after[k] + (t / step - k) * (before[k + 1] - after[k]) if driven else before[0]
            return np.asarray(-self.decay * z + self.B @ self.f(x0 + self.C @ z, u))

        time = step * np.arange(steps + 1)
        found = solve_ivp(slope, time[[0, -1]], np.zeros(len(self.decay)), "LSODA", time, rtol=EXACT, atol=1e-2 * EXACT,
                          max_step=step if driven else np.inf)  # fmt: skip
        states = np.full((steps + 1, len(x0)), np.nan)
        states[: len(found.t)] = x0 + found.y.T @ self.C.T
        return states

    def linearised(
        self, name: str, about: FloatArray, parameters: FloatArray, inputs: FloatArray | None = None
    ) -> LinearModel:
        """About a state and inputs, 0 if left out, with these parameters in the place of the model's own.

        Central differences, within 2e-10 of the exact derivatives (a test takes these from the tree, by SymPy).

        Raises
        ------
        InputError
            If the equations have no value there or next to it, or a corner.
        """
        u = np.zeros(len(self.model.inputs)) if inputs is None else inputs
        F = _slopes(lambda x: self.f(x, u, parameters), about)
        G = _slopes(lambda v: self.f(about, v, parameters), u)
        if not np.isfinite([*F.flat, *G.flat]).all():
            raise InputError(SAYS("no-slopes", name=name))
        outputs, rows = tuple(self.model.output_states), tuple(self.model.output_states.values())
        return LinearModel(name, about, self.model.inputs, outputs, driven=u, orders=self.orders, weight=self.weight,
                           F=F, G=G, A=np.diag(-self.decay) + self.B @ F @ self.C, B=self.B @ G, C=self.C[list(rows)],
                           rows=rows)  # fmt: skip

    @cached_property
    def linear(self) -> Mapping[str, LinearModel]:
        """About hanging and upright; of a model of yours about rest near zero, with :attr:`around` or without input."""
        p = moving(self.model, self.parameters)
        if self.model.pendulum:
            driven = by_name(self.model.parameter_names, self.parameters).get(self.model.drive) != 0
            inputs = self.model.inputs if driven else ("torque",)
            return {n: replace(self.linearised(n, posture(self.model, self.parameters, n), p), inputs=inputs)
                    for n in ("hanging", "upright")}  # fmt: skip
        from scipy.optimize import root

        still = np.zeros(len(self.model.inputs))
        for u in (still if self.around is None else self.around, still):
            solution = root(lambda x, u=u: self.f(x, u, p), np.zeros(len(self.orders)))
            with suppress(InputError):
                if solution.success:
                    return {"rest": self.linearised("rest", solution.x, p, u)}
        return {}

    def step_response(self, linear: LinearModel, end: float, points: int = 2000) -> tuple[Any, ...]:
        """Time, and the outputs after a unit step, of integer order and fractional, (points + 1, n_outputs)."""
        from scipy.signal import step

        time = np.linspace(0.0, end, points + 1)
        _, integer = step((linear.A, linear.B[:, :1], linear.C, linear.D[:, :1]), T=time)
        small = 1e-6 / max(1.0, float(np.abs(linear.G).max()))  # an input too small for all but the linear part
        u = linear.driven + small * np.eye(1, len(linear.driven))
        run = simulate(self.model, orders=self.orders, initial=linear.about, step=end / points, end=end, inputs=u,
                       parameters=by_name(self.model.parameter_names, moving(self.model, self.parameters)))  # fmt: skip
        exact = np.full((points + 1, len(linear.rows)), np.nan)
        exact[: len(run.states)] = (run.states[:, list(linear.rows)] - linear.about[list(linear.rows)]) / small
        return time, integer.reshape(len(time), -1), exact

    def control(self, x0: FloatArray | None = None) -> Any:
        """As a python-control NonlinearIOSystem, whose outputs are the measured states.

        Parameters
        ----------
        x0 : ndarray, shape (n_states,), optional
            Where it starts; z is 0 there.  Zero if left out.

        Raises
        ------
        InputError
            Without python-control.
        """
        start = np.zeros(len(self.orders)) if x0 is None else np.asarray(x0, dtype=np.float64)
        rows = list(self.model.output_states.values())

        def update(_t: float, z: FloatArray, u: FloatArray, _p: Any) -> FloatArray:
            return np.asarray(-self.decay * z + self.B @ self.f(start + self.C @ z, np.atleast_1d(u)))

        def output(_t: float, z: FloatArray, _u: FloatArray, _p: Any) -> FloatArray:
            return np.asarray((start + self.C @ z)[rows])

        return _control().nlsys(update, output, inputs=list(self.model.inputs), outputs=list(self.model.output_states),
                                states=len(self.decay), name=self.model.name)  # fmt: skip

    def to_json(self) -> dict[str, Any]:
        """Operators, matrices and linear models as plain JSON values."""
        return {
            "about": SAYS("about"),
            "operators": {
                n: {"order": o.order, "poles": o.poles.tolist(), "residues": o.residues.tolist(), "band": list(o.band),
                    "error_decibel": o.errors[0], "error_degrees": o.errors[1]}
                for n, o in zip(self.model.states, self.operators, strict=True)
            },
            "decay": self.decay.tolist(), "B": self.B.tolist(), "C": self.C.tolist(),
            "linear": {n: m.to_json() for n, m in self.linear.items()},
        }  # fmt: skip

    def to_matlab(self) -> dict[str, Any]:
        """Matrices and linear models for ``results.mat``."""
        return {
            "decay": self.decay[:, None], "B": self.B, "C": self.C,
            "linear": {
                n: {**{of: getattr(m, of) for of in (*"ABCDFG", "driven")}, "about": m.about[:, None],
                    "poles": m.poles[:, None], "swings": np.array([mode.pole for mode in m.modes])}
                for n, m in self.linear.items()
            },
        }  # fmt: skip


def integer_model(run: SavedRun | Problem, x: FloatArray | None = None) -> IntegerModel:
    """Make the integer-order model of a run.

    Parameters
    ----------
    run : SavedRun or Problem
    x : ndarray, shape (n_unknowns,), optional
        The unknowns of a problem; its start if left out.

    Returns
    -------
    IntegerModel

    Examples
    --------
    >>> import fracid
    >>> swing = fracid.Experiment("twin", 2e-3, np.zeros((5000, 2)), np.zeros((1, 1)))
    >>> problem = fracid.Problem(fracid.rotary_pendulum(b_alpha=2e-4), (swing,), {"lambda": 0.9, "mu": 1.0})
    >>> found = integer_model(problem)
    >>> [len(o.poles) for o in found.operators], list(found.linear)
    ([13, 13, 1, 1], ['hanging', 'upright'])
    >>> (mode,) = found.linear["hanging"].modes
    >>> bool(abs(mode.pole - mode.exact) < 1e-2 * mode.frequency)
    True
    """
    problem, values = (run, run.start if x is None else x) if isinstance(run, Problem) else (run.problem, run.x)
    orders, parameters, *_ = problem.unpack(values, problem.experiments[0])
    cases = [Case.of(problem, values, e) for e in problem.experiments]
    band = (2 * np.pi / max(c.step * c.steps for c in cases), np.pi / min(e.step for e in problem.experiments))
    operators = {q: positive_sum(q, band) for q in set(orders.tolist())}
    u = np.concatenate([e.all_inputs for e in problem.experiments])[:, : len(problem.model.inputs)]
    around = np.where(u.min(axis=0) * u.max(axis=0) >= 0, u.mean(axis=0), 0.0)  # the mean of those that have one sign
    return IntegerModel(problem.model, parameters, orders, tuple(operators[q] for q in orders.tolist()),
                        units=problem.experiments[0].units, around=around)  # fmt: skip


def sentences(run: SavedRun, system: IntegerModel) -> Iterator[str]:
    """What an engineer should know of the integer-order model: its operators, its fidelity, its poles."""
    for operator in {o.order: o for o in system.operators}.values():
        yield str(operator)
    yield from _fidelity(run, system)
    for posture, linear in system.linear.items():
        yield from (f"About {posture} it {mode}." for mode in linear.modes)
    yield from linear_sentences(system)


def linear_sentences(system: IntegerModel) -> Iterator[str]:
    """What the linear models about a posture leave out."""
    model, p = system.model, by_name(system.model.parameter_names, system.parameters)
    smooth = by_name(model.parameter_names, moving(model, system.parameters))
    dry = [name for name, kind in model.friction.items() if kind.corner == "sliding"]
    without = ["dry friction"] * any(p[n] != smooth[n] for n in dry)
    without += [n for n in p if p[n] != smooth[n] and n not in (*dry, model.drive)]
    if without:
        yield SAYS("without", names=" and ".join(without), have="has" if len(without) == 1 else "have")
    for delta in (name for name in model.relaxing.values() if p[name] > 0):
        yield SAYS("sticks", delta=delta, value=p[delta], unit=model.parameter(delta).unit)
    if p.get(model.drive) == 0:
        yield "The motor's constant is 0: the input of the linear models is the torque on the arm [N m]."
    for linear in system.linear.values():
        if linear.driven.any():
            inputs = ", ".join(f"{n} = {v:.4g}" for n, v in zip(linear.inputs, linear.driven, strict=True))
            yield SAYS("at-means", inputs=inputs)
    if not system.linear:
        yield SAYS("no-linear")


def _fidelity(run: SavedRun, system: IntegerModel) -> Iterator[str]:
    """How far the integer-order model is off the fractional one, which a scheme of second order simulates."""
    p, e = run.problem, run.problem.experiments[0]
    if e.past is not None:
        return
    exact = (replace(p, method="pi2") if METHODS[p.method].convergence_order < 2 else p).simulate(run.x, e).states
    if not (errors := follows(system, Case.of(p, run.x, e), exact)):  # its outputs are functions of the states
        return
    if not all(map(math.isfinite, errors.values())):
        yield f"Over {e.name} the integer-order model cannot be simulated at the recording's step."
        return
    stiff = f", poles up to {system.decay.max():.2g} rad/s: take a stiff solver" if system.decay.max() > STIFF else ""
    units = {n: system.units.get(n, p.model.output_unit(n)) for n in errors}
    words = ", ".join(f"{n} {with_unit(v, units[n], '.2g')}" for n, v in errors.items())
    yield SAYS("off", e=e, states=len(system.decay), stiff=stiff, words=words)


def follows(system: IntegerModel, case: Case, exact: FloatArray) -> dict[str, float]:
    """Root mean square of integer-order less fractional outputs over one recording [rad]."""
    own = replace(system, parameters=case.parameters)
    states = own.simulate(case.past[-1], case.driven_after, case.step, case.steps)
    return {n: float(np.sqrt(np.mean((states[: len(exact), i] - exact[:, i]) ** 2)))
            for n, i in system.model.output_states.items()}  # fmt: skip


def _slopes(f: Callable[[FloatArray], FloatArray], at: FloatArray) -> FloatArray:
    """∂f/∂at by the central differences that differ least from those of a larger step; NaN at a corner.

    Examples
    --------
    >>> _slopes(np.sin, np.array([0.0])).round(9).tolist(), _slopes(np.abs, np.array([0.0])).tolist()
    ([[1.0]], [[nan]])
    """
    here, columns = f(at), []
    for d in np.eye(len(at)):
        steps = STEPS[:, None] * max(1.0, float(np.abs(at) @ d))
        up, down = (np.array([f(at + side * h * d) for h in steps]) for side in (1, -1))
        slopes = (up - down) / (2 * steps)
        bends = np.abs(up - 2 * here + down) / steps  # by how much the slopes to both sides differ
        size, rounding = np.abs(slopes), (ROUNDED * (np.abs(up) + np.abs(down)) / steps)[1:]
        apart = np.abs(np.diff(slopes, axis=0))
        grows = (apart > 0.1 * size[1:] + rounding) & (size[1:] > size[:-1])
        corner = (bends[1:] > 0.5 * bends[:-1]) & (bends[1:] > 0.01 * size[1:] + rounding)
        error = (apart + rounding + 1e-3 * bends[1:]) / (size[1:] + rounding + TINY)
        best = np.nan_to_num(error, nan=np.inf).argmin(axis=0), np.arange(len(here))
        columns.append(np.where((grows | corner)[best], np.nan, slopes[1:][best]))
    return np.ascontiguousarray(np.reshape(columns, (len(at), len(here))).T)


def posture(model: Model, parameters: FloatArray, name: str) -> FloatArray:
    """The states where a pendulum is ``hanging`` or ``upright``, every output that is pulled to its ``…_rest`` there.

    Examples
    --------
    An arm without a cable to pull it rests anywhere, whatever its `theta_rest`:

    >>> import fracid
    >>> rig = fracid.rotary_pendulum(alpha_rest=0.5, theta_rest=-1.0, cable_stiffness=0.0)
    >>> posture(rig, rig.parameter_vector(), "hanging")
    array([0. , 0. , 0.5, 0. ])
    """
    p, f = by_name(model.parameter_names, parameters), partial(model.derivatives, p=moving(model, parameters))
    u = np.zeros(len(model.inputs))
    turned = {model.pendulum: math.pi} if name != model.zero else {}
    rests = model.state_vector({n: p.get(model.rest_of(n), 0.0) for n in model.output_states})

    def pull(output: str) -> float:
        away = rests.copy()
        away[model.output_states[output]] += 1.0
        return float(np.abs(f(away, u) - f(rests, u))[: len(away)].max())

    least = PULLED * pull(model.pendulum)
    return model.state_vector({n: rests[i] * (pull(n) > least) + turned.get(n, 0.0)
                               for n, i in model.output_states.items()})  # fmt: skip


def moving(model: Model, parameters: FloatArray) -> FloatArray:
    """The constants of a model that moves about a posture: without what has a corner there.

    Joints slide, but for those whose presliding makes a spring of dry friction; gear and motor are in contact, and the
    base is level, so that both postures are at rest.  The input is the torque where a voltage does nothing.

    Examples
    --------
    >>> import fracid
    >>> model = fracid.model("pendulum", coulomb_angle=1e-3)
    >>> float(moving(model, model.parameter_vector())[model.parameter_names.index("coulomb_angle")])
    0.0
    """
    p, kinds = by_name(model.parameter_names, parameters), model.friction
    sticks = {kinds[delta].joint for delta in model.relaxing.values() if delta in kinds and p[delta] > 0}
    slides = {n for n, kind in kinds.items() if kind.corner == "sliding" and kind.joint not in sticks}
    p |= {n: kinds[n].off for n in kinds if n in slides or kinds[n].corner == "always"}
    p |= {q.name: 0.0 for q in model.parameters if q.corner}
    p |= {n: p[n] or 1.0 for n in p if n == model.drive}
    return np.array([*p.values()])


def _control() -> Any:
    with installed("python-control is not installed; type: pip install 'fracid[control]'."):
        import control
    return control
