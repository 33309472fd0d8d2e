"""What a model is: a right-hand side, the orders of its states, and named parameters in SI units.

Every model of fracid, built in or a user's own, is one instance of :class:`Model`:

.. math::  D^{q_i} x_i = f_i(t, x, u, p), \\qquad i = 1 \\dots n

with x the states, :math:`q_i` the order of each state, u the inputs and p the parameters.

How to write your own (a file ``my_rig.py``, used as ``name = "my_rig.py:model"``; as a program it wants ``--trust``):

1. Write ``rhs(t, x, u, p, out)``: put :math:`D^{q_i} x_i` into ``out[i]`` and return nothing.  All four
   arrays are one-dimensional float64; ``u`` has one entry for each name in ``inputs`` (zero where nothing
   was recorded), ``p`` one for each parameter, in the order of ``parameters``.
2. Keep to what Numba compiles: numbers, ``math``, indexing, ``if`` and ``for``, and functions of your own file that
   do.  It is compiled for you, once in each process.
3. Name each state and its order.  States of one angle share an order's name: ``("mu", "mu")``.  A state whose
   order is known has the number itself: 1.0 for an ordinary derivative.  What an order is in the model without
   fractional calculus goes into ``integer_orders`` where it is not 1: a damper written as D^r z = x', z = D^(1-r) x, is
   a dashpot at r = 0 and a spring at r = 1, so ``{"r": 0}``.
4. Name the inputs.  The rate of a measured position, which a dashpot or a springpot resists, is an input too,
   ``inputs = ("length", "speed")``, and fracid finds it: ``input_rates = {"speed": "length"}``.
5. Say what is measured: of a state its index, ``outputs = {"alpha": 0}``; of anything else a function of the same
   language, ``outputs = {"force": force}`` with ``def force(t, x, u, p): return p[0] * x[0] + p[1] * x[1]``.  At a
   sample where an input jumps it sees the new value.
6. List the parameters: SI units, a value to start from, bounds only where the model means nothing beyond
   them (a fit's own bounds belong into the project file).
7. Say what angle zero is (``"hanging"``, ``"upright"`` or ``""``) and where the numbers come from.
8. What is friction is told by its name, ``b_…``, ``coulomb_…``, ``drag_…``, ``cable_…``, or by the parameter's
   ``friction`` (:mod:`fracid.models.friction`).  The other fields of :class:`Model` may stay empty: they are what the
   reports, figures and exports of our own models ask for.  The page prints the equations of any right-hand side;
   how a name is written there can be said, in a parameter's ``symbol`` and in the model's ``symbols``.

>>> import math
>>> def rhs(t, x, u, p, out):
...     out[0] = x[1]
...     out[1] = -p[0] * math.sin(x[0]) - p[1] * x[1]
>>> pendulum = Model(
...     name="simple pendulum", rhs=rhs,
...     states=("alpha", "D^mu alpha"), orders=("mu", "mu"), outputs={"alpha": 0}, inputs=(),
...     parameters=(Parameter("stiffness", "1/s^2", 9.81, "g over length", lower=0.0),
...                 Parameter("damping", "1/s", 0.2, "viscous friction over inertia")),
...     zero="hanging", source="an example")
>>> pendulum.parameter_vector({"damping": 0.3})
array([9.81, 0.3 ])
>>> pendulum.state_orders({"mu": 0.95})
array([0.95, 0.95])
"""

from __future__ import annotations

import math
from collections import namedtuple
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import InitVar, dataclass, field, replace
from functools import cached_property
from itertools import chain
from typing import Any, TypeVar

import numpy as np

from fracid.arrays import FloatArray
from fracid.cards import Card, CardDisplay, listed
from fracid.errors import InputError, is_number, refuse_unknown, unknown_name
from fracid.figures import Figure, Style, draw
from fracid.findings import Words
from fracid.models.friction import BY_NAME, Friction
from fracid.models.joints import Complement
from fracid.models.scene import Scene
from fracid.models.written.reading import read, read_outputs
from fracid.models.written.tree import Program
from fracid.safety.kinds import refuse_other_kinds
from fracid.units import letter

SAYS = Words("models/base.toml")

Output = Callable[[float, FloatArray, FloatArray, FloatArray], float]
"""``h(t, x, u, p)``: returns an output that is no state."""

RightHandSide = Callable[[float, FloatArray, FloatArray, FloatArray, FloatArray], None]
"""``rhs(t, x, u, p, out)``: writes D^{q_i} x_i into ``out[i]``, returns nothing."""

ZEROS = ("hanging", "upright", "")

T = TypeVar("T")

NEAR_0 = 1e-9
"""As which an order of 0 is solved: an equation D^0 z = f says z = f, and this one too, within 10⁻⁷ of it."""


@dataclass(frozen=True)
class Parameter:
    """A constant of a model, in SI units.

    Raises
    ------
    InputError
        If the value is not a finite number, or lies outside the bounds.

    Examples
    --------
    >>> Parameter("C1", "kg m^2", 4.3e-3, "pendulum inertia about its pivot", lower=0.0).value
    0.0043
    """

    name: str
    """As a Python identifier: what project files, results and overrides call it."""
    unit: str
    """SI, as text."""
    value: float
    """The rig's value: what holds where nobody says otherwise [unit]."""
    description: str
    """One phrase for tables."""
    lower: float = -math.inf
    """Below it the model means nothing [unit]."""
    upper: float = math.inf
    """Above it the model means nothing [unit]."""
    symbol: tuple[str, str] | None = None
    """Letter and index, as equations write it; None for the name."""
    friction: Friction | None = None
    """What it is if it is friction; None where its name is to say (:data:`fracid.models.friction.BY_NAME`)."""
    needs: tuple[str, ...] = ()
    """Parameters without one of which, not zero, it does nothing."""
    switch: str = ""
    """It acts only in recordings that say of this that it is on; "" for always."""
    rung: str = ""
    """The rung of the ladder that frees it; "" for that of its kind of friction."""
    corner: bool = False
    """Whether linear models are without it, though it is no friction: a dead zone."""

    @classmethod
    def of(cls, name: str, row: Mapping[str, Any]) -> Parameter:
        """Make one of a row of TOML: ``start``, ``unit``, ``about``, and what else it has.

        Examples
        --------
        >>> Parameter.of("C1", {"start": 4.3e-3, "unit": "kg m^2", "symbol": "C_1", "about": "inertia"}).symbol
        ('C', '1')
        """
        more = {n: row[n] for n in ("lower", "upper", "switch", "rung", "corner") if n in row}
        symbol = symbol_of(row["symbol"]) if "symbol" in row else None
        friction = Friction.of(row["friction"]) if "friction" in row else None
        return cls(name, row["unit"], row["start"], row["about"], symbol=symbol, friction=friction,
                   needs=tuple(row.get("needs", ())), **more)  # fmt: skip

    def __post_init__(self) -> None:
        """Refuse what is no number or lies outside the bounds."""
        if not self.name.isidentifier():
            raise InputError(f"a parameter's name must be a Python identifier, not {self.name!r}")
        if not is_number(self.value) or not math.isfinite(self.value):
            raise InputError(f"parameter {self.name} = {self.value!r}: expected a finite number [{self.unit}]")
        if not self.lower <= self.value <= self.upper:
            raise InputError(SAYS("beyond-bounds", p=self, unit="" if self.unit == "-" else f" {self.unit}"))


@dataclass(frozen=True)
class LinearTerms:
    """The equations as Σ columns · constants = 0, for :mod:`fracid.regression`: of an arm and a pendulum at its end."""

    names: tuple[str, ...]
    """Of the constants, in the order of the columns; ``cable_offset`` is −stiffness · rest."""
    lumped: tuple[str, ...]
    """Those that are looked for if nobody says."""
    pendulum: tuple[str, ...]
    """Those of the equation of the pendulum alone."""
    gauge: str
    """The one that is taken as known where nothing drives the rig, for then the motion tells only ratios."""
    columns: Callable[..., tuple[Mapping[str, FloatArray], Mapping[str, FloatArray]]]
    """(model, θ, α, (x₂, D^λ x₂), (x₄, D^μ x₄), drive) → the arm's and the pendulum's by name, shape (n,)."""


@dataclass(frozen=True)
class FadingState:
    """Where the numbers of a state with a finite memory stand."""

    state: int
    shares: tuple[int, ...]
    """Among the parameters: a_0 … a_n."""
    times: tuple[int, ...]
    """There too: ln τ_1 … ln τ_n."""
    held: tuple[int, ...]
    """Behind the states that are simulated: what each relaxation holds at the start."""


Angle = namedtuple("Angle", ("rest", "of_zero"), defaults=("", False))
"""What models that were written before :attr:`Model.pendulum` say of an angle: whether it is the pendulum's."""

Written = namedtuple("Written", ("of", "equations", "code"), defaults=(None, None))
"""What such models give as equations and code; both are made of the right-hand side."""


@dataclass(frozen=True, repr=False)
class Model(CardDisplay):
    """A fractional state-space model: D^{q_i} x_i = f_i(t, x, u, p).

    The module's docstring shows how to write one.

    Raises
    ------
    InputError
        If the fields do not fit together: a state without an order, an output that is no state,
        two parameters of one name, a right-hand side that cannot be called.

    Examples
    --------
    >>> from fracid.models import rotary_pendulum
    >>> model = rotary_pendulum("srv02-rotpen", zero="hanging")
    >>> model.states
    ('theta', 'D^lambda theta', 'alpha', 'D^mu alpha')
    >>> model.order_names
    ('lambda', 'mu')
    >>> model.state_orders({"lambda": 0.8623, "mu": 0.9146})
    array([0.8623, 0.8623, 0.9146, 0.9146])
    >>> model.with_parameters(b_alpha=2e-4).parameter("b_alpha").value
    0.0002
    """

    name: str
    """What tables and result files call it."""
    rhs: RightHandSide
    """Plain Python in Numba's language; see the module's docstring."""
    states: tuple[str, ...]
    """Names of the states x, shape (n_states,)."""
    orders: tuple[str | float | Complement, ...]
    """For each state the name of its order, the order itself where it is known, or of a springpot ``Complement("nu")``:
    its state has the order 1 − ν, and ν is a parameter, or else an order of that name; shape (n_states,)."""
    outputs: Mapping[str, int | Output]
    """Measured signals: name to index of the state, or to a function ``h(t, x, u, p)`` that returns the signal."""
    inputs: tuple[str, ...]
    """Names of the inputs u; empty for a model that nothing drives."""
    parameters: tuple[Parameter, ...]
    """In the order of the vector p."""
    zero: str
    """Where the pendulum angle is zero: "hanging", "upright", or "" where that has no meaning."""
    source: str
    """Where the equations and numbers come from, and which of them are guesses."""
    integer_orders: Mapping[str, float | None] = field(default_factory=dict)
    """Order → its value, 0 or 1, in the integer-order model that a fractional fit is held against; None where there is
    none.  1 for those left out."""
    angles: tuple[str, ...] | Mapping[str, Angle] = ()
    """The outputs that are angles."""
    pendulum: str = ""
    """That of which :attr:`zero` says where it is zero; "" where there is none."""
    input_units: Mapping[str, str] = field(default_factory=dict)
    """Input → its unit; SI where it says nothing."""
    output_units: Mapping[str, str] = field(default_factory=dict)
    """Output → its unit; "rad" of an angle, else 1 where it says nothing."""
    derived: Mapping[str, tuple[str, int]] = field(default_factory=dict)
    """Output that a recording has → the output of which it is the derivative, and how often that is differentiated."""
    about: str = ""
    """One line for lists of models."""
    input_rates: Mapping[str, str] = field(default_factory=dict)
    """Input → the input of which it is the rate, such as the speed of a position that was recorded: it is the slope of
    the lines between its samples where no column of its own is given."""
    input_defaults: Mapping[str, float] = field(default_factory=dict)
    """Input → its value in a recording that has other inputs and not this; 0 where it says nothing."""
    drive: str = ""
    """The parameter that makes a torque of the input; "" where there is none."""
    seen_in: Mapping[str, str] = field(default_factory=dict)
    """Order → the output without which it can hardly be seen."""
    symbols: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    """State, input or variable of the right-hand side → letter and index, as equations write it, where its name does
    not say: ``b_theta`` is b with the index θ, ``D^mu alpha`` is ω with the index α."""
    paper: str = ""
    """Whose equations the numbers in descriptions of parameters are: "(8)"."""
    scene: Scene | None = None
    """How it is drawn; None for one whose curves are all that is drawn."""
    linear_terms: LinearTerms | None = None
    """None for one that no linear regression knows."""
    relaxing: Mapping[str, str] = field(default_factory=dict)
    """State → its δ, for each :func:`fracid.models.joints.presliding` element."""
    follows: Mapping[str, str] = field(default_factory=dict)
    """State → the state with whose value it begins where nobody says: an arm stands where its hub does."""
    memories: tuple[FadingState, ...] = ()
    """Of states of order 1 that remember for finite times (:mod:`fracid.selection.finite_memory`)."""
    grown: Callable[[Model, frozenset[str]], Model] | None = None
    """(model, parameters that are not zero) → the model with the states that they need; None where it has them all."""
    written: InitVar[Written | None] = None

    def __post_init__(self, written: Written | None) -> None:
        """Check that the fields fit together, so that no later layer has to."""
        if isinstance(self.angles, Mapping):
            object.__setattr__(self, "pendulum", next((n for n, a in self.angles.items() if a.of_zero), ""))
            object.__setattr__(self, "angles", tuple(self.angles))
        refuse_other_kinds(self, f"model {self.name}: ")
        for name in ("states", "orders", "inputs", "parameters"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        _check_names(self)
        _check_shapes(self)

    @cached_property
    def output_states(self) -> dict[str, int]:
        """The outputs that are states: name to index.

        Examples
        --------
        >>> from fracid.models import rotary_pendulum
        >>> rotary_pendulum().output_states
        {'theta': 0, 'alpha': 2}
        """
        return {name: i for name, i in self.outputs.items() if isinstance(i, int)}

    @property
    def shown(self) -> dict[str, int | Output]:
        """The outputs that functions of the state give: those that are derivatives of others are not among them."""
        return {name: h for name, h in self.outputs.items() if name not in self.derived}

    @cached_property
    def friction(self) -> dict[str, Friction]:
        """What of the parameters is friction, by name, in their order.

        Examples
        --------
        >>> from fracid.models import rotary_pendulum
        >>> [name for name, kind in rotary_pendulum().friction.items() if kind.dry]
        ['coulomb_theta', 'coulomb_alpha']
        """
        kinds = ((p, p.friction or self._by_name(p.name)) for p in self.parameters)
        return {p.name: replace(kind, rung=p.rung or kind.rung) for p, kind in kinds if kind is not None}

    def _by_name(self, name: str) -> Friction | None:
        """What a parameter is by the beginning of its name, at the joint that the end of its name says; no rest is."""
        kinds = ((k, name.removeprefix(b)) for b, k in BY_NAME.items() if name.startswith(b) and name not in self.rests)
        kind, joint = next(kinds, (None, ""))
        if kind is None or joint not in self.outputs:
            return kind
        rest = self.rest_of(joint) if kind.rests else ""
        return replace(kind, joint=joint, rests=(rest,) if rest else ())

    def input_unit(self, name: str) -> str:
        """Return the unit of an input; that which its name says where the model says nothing.

        Examples
        --------
        >>> from fracid.models import rotary_pendulum
        >>> rotary_pendulum().input_unit("voltage")
        'V'
        """
        return self.input_units.get(name, {"voltage": "V", "torque": "N m"}.get(name, "1"))

    def output_unit(self, name: str) -> str:
        """Return the unit of an output.

        Examples
        --------
        >>> from fracid.models import rotary_pendulum
        >>> rotary_pendulum().output_unit("alpha")
        'rad'
        """
        angle = name in self.angles or (self.zero and name in self.output_states)
        return self.output_units.get(name, "rad" if angle else "1")

    def unit_of(self, signal: str) -> str:
        """Return the unit of an output, or else of an input.

        Examples
        --------
        >>> from fracid.models import rotary_pendulum
        >>> rotary_pendulum().unit_of("alpha"), rotary_pendulum().unit_of("voltage")
        ('rad', 'V')
        """
        return self.output_unit(signal) if signal in self.outputs else self.input_unit(signal)

    @property
    def rests(self) -> tuple[str, ...]:
        """Parameters that say where something rests, ``…_rest``: each recording has its own."""
        return tuple(name for name in self.parameter_names if name.endswith("_rest"))

    def rest_of(self, output: str) -> str:
        """The parameter that is an output's value at rest or the offset of its zero, ``…_rest``; "" for none.

        Examples
        --------
        >>> from fracid.models import rotary_pendulum
        >>> rotary_pendulum().rest_of("alpha")
        'alpha_rest'
        """
        return f"{output}_rest" if f"{output}_rest" in self.parameter_names else ""

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of the vector p."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def order_names(self) -> tuple[str, ...]:
        """Names of the orders that have one, each once, in order of appearance."""
        names = (q.parameter if isinstance(q, Complement) else q for q in self.orders)
        return tuple(dict.fromkeys(n for n in names if isinstance(n, str) and n not in self.parameter_names))

    @cached_property
    def rates(self) -> dict[int, int]:
        """For each state i that has one the state j with D^q x_i = x_j, found by asking the right-hand side.

        Not of springpots and of states that relax: the speed that drives them is that of another.

        Raises
        ------
        InputError
            If the right-hand side fails.

        Examples
        --------
        >>> from fracid.models import rotary_pendulum
        >>> rotary_pendulum().rates
        {0: 1, 2: 3}
        """
        n = len(self.states)
        x = np.sqrt(np.arange(n) + 0.5) / 10  # irrational: round constants make no state of another there
        out, rhs = np.full(n, np.nan), getattr(self.rhs, "py_func", self.rhs)
        try:
            with np.errstate(all="ignore"):
                returned = rhs(0.0, x, np.zeros(len(self.inputs)), self.parameter_vector(), out)
                getattr(returned, "close", bool)()  # of an async def, which is refused where it is compiled
        except (ArithmeticError, ValueError):  # where it has no value, as a root of a negative number
            return {}
        except Exception as error:
            raise InputError(SAYS("rhs-fails", name=self.name, kind=type(error).__name__, error=error, n=n,
                                  inputs=len(self.inputs), parameters=len(self.parameters))) from error  # fmt: skip
        driven = {*self.relaxing_states, *(i for i, q in enumerate(self.orders) if isinstance(q, Complement))}
        return {i: j for i in range(n) for j in range(n) if i != j and i not in driven and out[i] == x[j]}

    @cached_property
    def program(self) -> Program:
        """The right-hand side as a tree, of which every other language is written.

        Raises
        ------
        InputError
            If it cannot be read: with file, line, and what to write instead.

        Examples
        --------
        >>> from fracid.models import rotary_pendulum
        >>> len(rotary_pendulum().program.states)
        4
        """
        if isinstance(written := getattr(self.rhs, "tree", None), Program):
            return written
        return read(self.rhs, self.parameter_names, self.states, self.relaxing_states, inputs=len(self.inputs))

    @cached_property
    def outputs_program(self) -> Program:
        """The outputs as a tree, as :attr:`program` has the right-hand side.

        Raises
        ------
        InputError
            If one cannot be read.

        Examples
        --------
        >>> import fracid
        >>> sorted(fracid.model("capacitor").outputs_program.constants)
        ['R', 'current_rest']
        """
        return read_outputs(tuple(self.shown.values()), self.parameter_names, len(self.states), len(self.inputs))

    def integer_order(self, name: str) -> float | None:
        """Return the value of an order in the integer-order model, None where there is none.

        Examples
        --------
        >>> from fracid.models import rotary_pendulum
        >>> rotary_pendulum().integer_order("mu")
        1.0
        """
        value = self.integer_orders.get(name, 1.0)
        return None if value is None else float(value)

    def solved_at(self, name: str, otherwise: T) -> float | T:
        """Return the order with which the integer-order model is solved, 10⁻⁹ for 0; `otherwise` where none is."""
        value = self.integer_order(name)
        return otherwise if value is None else max(value, NEAR_0)

    def parameter(self, name: str) -> Parameter:
        """Return the parameter of that name.

        Raises
        ------
        InputError
            If the model has no such parameter.
        """
        refuse_unknown(f"{self.name} parameter", self.parameter_names, name)
        return self.parameters[self.parameter_names.index(name)]

    def parameter_vector(self, overrides: Mapping[str, float] | None = None) -> FloatArray:
        """Return the vector p that the right-hand side takes.

        Parameters
        ----------
        overrides
            Values that replace the model's own, by name [SI].

        Returns
        -------
        ndarray, shape (n_parameters,)
            In the order of :attr:`parameter_names`.

        Raises
        ------
        InputError
            For an unknown name, or a value that is not finite or outside its bounds.
        """
        return np.array([parameter.value for parameter in self._overridden(overrides or {})], float)

    def with_parameters(self, **values: float) -> Model:
        """Return the same model with other parameter values [SI].

        Raises
        ------
        InputError
            As :meth:`parameter_vector`.
        """
        return replace(self, parameters=self._overridden(values)).equipped()

    def equipped(self, on: Iterable[str] | None = None) -> Model:
        """Return the same model with the states that its elements need: what is off costs nothing.

        Parameters
        ----------
        on
            Names of parameters that are not zero, or may become so; None for those whose own value is not zero.

        Raises
        ------
        InputError
            If a parameter is there without the one that it acts with.

        Examples
        --------
        >>> from fracid.models import rotary_pendulum
        >>> rotary_pendulum().equipped(["presliding_theta"]).states[4:]
        ('z_theta',)
        """
        names = frozenset(p.name for p in self.parameters if p.value != 0.0) if on is None else frozenset(on)
        for p in self.parameters:
            if p.needs and p.name in names and names.isdisjoint(p.needs):
                unit = self.parameter(p.needs[0]).unit
                raise InputError(SAYS("needs", p=p, needs=" or ".join(p.needs), first=p.needs[0], unit=unit))
        return self if self.grown is None else self.grown(self, names)

    @property
    def relaxing_states(self) -> tuple[int, ...]:
        """Which states are those of presliding elements."""
        return tuple(self.states.index(name) for name in self.relaxing)

    @cached_property
    def complements(self) -> tuple[tuple[int, int], ...]:
        """(state, parameter) of each springpot: the state's order is 1 minus the parameter."""
        names = self.parameter_names
        springpots = ((i, q.parameter) for i, q in enumerate(self.orders) if isinstance(q, Complement))
        return tuple((i, names.index(nu)) for i, nu in springpots if nu in names)

    @cached_property
    def springpot_orders(self) -> dict[int, str]:
        """State → the order ν of its springpot, of those that have one by name: the state's is 1 − ν.

        Examples
        --------
        >>> def creep(t, x, u, p, out):
        ...     out[0] = u[0] * p[0]
        >>> strip = Model("strip", creep, ("y",), (Complement("nu"),), {"y": 0}, ("speed",),
        ...               (Parameter("c", "1", 2.0, "its stiffness"),), "", "an example")
        >>> strip.springpot_orders, strip.order_names, strip.state_orders({"nu": 0.25})
        ({0: 'nu'}, ('nu',), array([0.75]))
        """
        springpots = ((i, q.parameter) for i, q in enumerate(self.orders) if isinstance(q, Complement))
        return {i: nu for i, nu in springpots if nu not in self.parameter_names}

    def named_orders(self, orders: FloatArray) -> dict[str, float]:
        """Give the values by name that :meth:`state_orders` made these orders of the states of.

        Examples
        --------
        >>> from fracid.models import model
        >>> model("relaxation").named_orders(np.array([0.75]))
        {'nu': 0.25}
        """
        named = {q: v for q, v in zip(self.orders, orders.tolist(), strict=True) if isinstance(q, str)}
        return named | {nu: 1.0 - float(orders[i]) for i, nu in self.springpot_orders.items()}

    def order_called(self, name: str) -> str:
        """The order that a caller names, one of Python's keywords with an underscore behind it."""
        return name if name in self.order_names else name.rstrip("_")

    def state_orders(self, orders: Mapping[str, float], parameters: FloatArray | None = None) -> FloatArray:
        """Return the order of each state.

        Parameters
        ----------
        orders
            A value for each of :attr:`order_names`.  A trailing underscore is dropped, so that
            ``dict(lambda_=0.86, mu=0.91)`` can be written in Python.
        parameters
            The vector p, shape (n_parameters,), which springpots take their order from; the model's own if None.

        Returns
        -------
        ndarray, shape (n_states,)

        Raises
        ------
        InputError
            For a missing or unknown name, or an order outside (0, 2).
        """
        values = {self.order_called(name): order for name, order in orders.items()}
        for name, order in values.items():
            refuse_unknown(f"{self.name} order", self.order_names, name)
            if not is_number(order) or not 0.0 < order < 2.0:
                raise InputError(f"order {name} = {order!r}: expected a number between 0 and 2, both excluded")
            if name in self.springpot_orders.values() and order > 1.0:
                raise InputError(f"order {name} = {order!r}: a springpot's lies between 0, a spring, and 1, a dashpot")
        if missing := [name for name in self.order_names if name not in values]:
            example = ", ".join(f"{name!r}: 1.0" for name in self.order_names)
            raise InputError(f"the order {missing[0]!r} of the {self.name} model is missing: give {{{example}}}")
        p = self.parameter_vector() if parameters is None else parameters
        own = {i: 1.0 - p[parameter] for i, parameter in self.complements}
        own |= {i: max(1.0 - values[name], NEAR_0) for i, name in self.springpot_orders.items()}
        return np.array([own.get(i, values[q] if isinstance(q, str) else q) for i, q in enumerate(self.orders)], float)

    def state_vector(self, states: Mapping[str, float]) -> FloatArray:
        """Return the states x from values by name; those left out are zero.

        Parameters
        ----------
        states
            Values by the names in :attr:`states` [rad, rad/s^order], or by the names of the outputs.

        Returns
        -------
        ndarray, shape (n_states,)

        Raises
        ------
        InputError
            For an unknown name, or a value that is no finite number.

        Examples
        --------
        >>> from fracid.models import rotary_pendulum
        >>> rotary_pendulum().state_vector({"alpha": 0.17})
        array([0.  , 0.  , 0.17, 0.  ])
        """
        x = np.zeros(len(self.states))
        index = {**self.output_states, **{name: i for i, name in enumerate(self.states)}}
        followers = {name: states[other] for name, other in self.follows.items() if other in states}
        for name, value in {**followers, **states}.items():
            if name not in index:
                raise unknown_name(f"{self.name} state", name, self.states)
            if not is_number(value) or not math.isfinite(value):
                raise InputError(f"initial state {name} = {value!r}: expected a finite number: numpy.radians(10)")
            x[index[name]] = value
        return x

    def derivatives(self, x: FloatArray, u: FloatArray, p: FloatArray) -> FloatArray:
        """What the right-hand side says, in plain Python: behind D^q x, where states relax, the rates of those.

        NaN where it has no value, as a root of a negative number.

        Examples
        --------
        >>> from fracid.models import rotary_pendulum
        >>> rig = rotary_pendulum()
        >>> rig.derivatives(np.array([0.0, 2.0, 0.0, 0.0]), np.zeros(1), rig.parameter_vector())[0]
        np.float64(2.0)
        """
        return computed(getattr(self.rhs, "py_func", self.rhs), x, u, p, count=len(x) * (1 + bool(self.relaxing)))

    def plot(self, *, style: str | Style = "screen") -> Figure:
        """Draw the model, with zeros and positive senses of its outputs: :func:`fracid.plots.rig_drawing`.

        Parameters
        ----------
        style : str or Style
            ``screen``, ``journal`` or one's own; see :mod:`fracid.figures`.

        Raises
        ------
        InputError
            If the model has no scene.

        Examples
        --------
        >>> from fracid.models import rotary_pendulum
        >>> figure = rotary_pendulum("srv02-rotpen").plot(style="journal")
        >>> round(25.4 * figure.get_figwidth())
        88
        """
        return draw("rig_drawing", self, style=style)

    def _card(self) -> Card:
        orders = (q if isinstance(q, str) else f"{q:g}" if isinstance(q, float) else str(q) for q in self.orders)
        values = ((p.name, f"{p.value:.6g} {p.unit if p.unit != '1' else ''}".rstrip()) for p in self.parameters)
        return Card(f"Model {self.name}", (
            ("states", listed(self.states)),
            ("orders", listed(letter(q) for q in orders)),
            ("outputs", listed(letter(n) for n in self.outputs)),
            ("inputs", listed(self.inputs)),
            ("parameters", f"{len(self.parameters)}: {listed(self.parameter_names)}"),
            ("zero", f"{self.zero}, where {letter(self.pendulum)} = 0" if self.zero else "none"),
            ("source", self.source),
        ), tuple(values))  # fmt: skip

    def _overridden(self, values: Mapping[str, float]) -> tuple[Parameter, ...]:
        refuse_unknown(f"{self.name} parameter", self.parameter_names, *values)
        return tuple(replace(p, value=values[p.name]) if p.name in values else p for p in self.parameters)


def computed(f: Callable[..., None], x: FloatArray, u: FloatArray, p: FloatArray, count: int) -> FloatArray:
    """So many numbers that f writes, in plain Python; all NaN where one of them has no value.

    Examples
    --------
    >>> def outflow(t, x, u, p, out):
    ...     out[0] = math.sqrt(x[0])
    >>> computed(outflow, np.array([4.0]), np.zeros(0), np.zeros(0), count=1)
    array([2.])
    >>> computed(outflow, np.array([-4.0]), np.zeros(0), np.zeros(0), count=1)
    array([nan])
    """
    out = np.zeros(count)
    with np.errstate(all="ignore"), suppress(ArithmeticError, ValueError, TypeError):
        f(0.0, x, u, p, out)
        return np.where(np.isfinite(out).all(), out, np.nan)
    return np.full(count, np.nan)


def _check_names(model: Model) -> None:
    """Distinct names, a known zero."""
    for what in ("states", "inputs", "parameter_names"):
        names = getattr(model, what)
        if twice := [name for name in names if names.count(name) > 1]:
            raise InputError(f"model {model.name}: {twice[0]!r} stands twice in {what}; names must differ")
    for order in {*model.orders}.intersection((*model.states, *model.inputs, *model.parameter_names)):
        raise InputError(SAYS("order-taken", model=model, order=order))
    if model.zero not in ZEROS:
        raise InputError(f"model {model.name}: zero = {model.zero!r}; expected one of {ZEROS}")


def _check_output(model: Model, name: str, h: Output) -> None:
    """A function of (t, x, u, p), which gives a number."""
    sizes = f"x has {len(model.states)} entries, u has {len(model.inputs)}, p has {len(model.parameters)}"
    arguments = np.linspace(0.1, 0.2, len(model.states)), np.zeros(len(model.inputs)), model.parameter_vector()
    try:
        with np.errstate(all="ignore"):
            value = getattr(h, "py_func", h)(0.0, *arguments)
    except (ArithmeticError, ValueError):  # where it has no value, as a root of a negative number
        return
    except Exception as error:
        raise InputError(SAYS("output-fails", model=model, name=name, error=error, sizes=sizes)) from error
    if not is_number(value):
        raise InputError(f"model {model.name}: the output {name!r} returns {value!r}; expected one number")


def _check_shapes(model: Model) -> None:
    """An order for each state, a state for each output."""
    if not model.states or len(model.orders) != len(model.states):
        raise InputError(SAYS("orders-count", model=model, states=len(model.states), orders=len(model.orders)))
    for order in model.orders:
        if not isinstance(order, Complement | str) and not (is_number(order) and 0.0 < order < 2.0):
            raise InputError(SAYS("order", model=model, order=order))
    for state in model.relaxing:
        if state not in model.states or model.orders[model.states.index(state)] != 1.0:
            raise InputError(SAYS("relaxing", model=model, state=state))
    for output, index in model.outputs.items():
        if callable(index):
            _check_output(model, output, index)
        elif not isinstance(index, int) or not 0 <= index < len(model.states):
            raise InputError(SAYS("output-index", model=model, output=output, index=index, last=len(model.states) - 1))
    refuse_unknown(f"input in input_rates of {model.name}", model.inputs, *chain(*model.input_rates.items()))
    refuse_unknown(f"input in input_defaults of {model.name}", model.inputs, *model.input_defaults)
    for name, value in model.integer_orders.items():
        refuse_unknown(f"order in integer_orders of {model.name}", model.order_names, name)
        if value is not None and (not is_number(value) or value not in (0, 1)):
            raise InputError(SAYS("integer-order", model=model, name=name, value=value))


def symbol_of(text: str) -> tuple[str, str]:
    """Letter and index of ``"ω_φ"``."""
    letter, _, index = text.partition("_")
    return letter, index
