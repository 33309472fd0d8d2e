r"""How far the best integer-order model stays from each candidate, in standard deviations of the noise.

With :math:`r = y - y_1`, what an integer-order model misses of the simulated experiment, and J the derivatives of its
outputs, the least :math:`\sum_e (r_e - J_e p)'W_e(r_e - J_e p)` over one p for all experiments is

.. math::  T = c - b'A^{-1}b, \qquad c = \sum_e r_e'W_er_e, \quad b = \sum_e J_e'W_er_e, \quad A = \sum_e J_e'W_eJ_e ,

initial states eliminated from each.  It is linear about the integer-order model that fits a first set of experiments
best, by least squares, and again about the one that fits the chosen set.

The alternatives are those of the claim that cost no further state: viscous and dry friction free, and beside them one
at a time what :data:`fracid.selection.integer_alternatives.ELEMENTS` has, a delay, a low-pass, a scale, drag, a cable,
a tilted axis.  T is that of the nearest.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from fracid.arrays import FloatArray
from fracid.errors import Failure, InputError
from fracid.estimation.covariance import jacobian
from fracid.experiments.criteria import distance
from fracid.experiments.exchange import averaged, exchange
from fracid.experiments.space import Candidate, DesignSpace
from fracid.experiments.subject import Subject
from fracid.optimise import least_squares, minimise
from fracid.problem import Experiment, Problem
from fracid.selection.integer_alternatives import ELEMENTS
from fracid.selection.integer_rival import freed_friction, integer_values, moving

__all__ = ["Alternatives", "alternatives_of"]

FRICTION = "friction"
"""The alternative with every order integer and friction free."""

SHORTLIST = 60
"""Candidates that are looked at again about the alternative that fits the chosen set."""

BLIND = 1e-12

VAGUE = 1e-8
"""Curvature of what no experiment shows, in typical sizes."""


@dataclass(frozen=True)
class Alternatives:
    """Sums of T for each candidate."""

    names: tuple[str, ...]
    """Of the alternatives."""
    columns: tuple[tuple[int, ...], ...]
    """Which parameters each of them may move."""
    scale: FloatArray
    """Typical size of each parameter, shape (n,)."""
    parts: tuple[FloatArray, ...]
    """c, b and A of each candidate, shapes (1, n_candidates), (1, n_candidates, n) and (1, n_candidates, n, n)."""
    base: tuple[FloatArray, ...]
    """The same of what has been recorded, shapes (1,), (1, n) and (1, n, n)."""
    allowed: tuple[int, ...]
    """Which of the candidates the parts are of."""

    def objective(self, sums: tuple[FloatArray, ...]) -> FloatArray:
        """−log T of the nearest alternative."""
        return np.asarray(-np.log(np.maximum(distance(sums, self.columns, self.scale).min(axis=-1), 1e-300)))

    def chosen(self, count: int) -> tuple[int, ...]:
        """The set whose nearest alternative is furthest."""
        return tuple(self.allowed[i] for i in exchange(self.objective, self.parts, self.base, count))

    def distances(self, chosen: Sequence[int]) -> Mapping[str, float]:
        """Alternative → its distance from a set of experiments and what has been recorded, in standard deviations."""
        at = [self.allowed.index(i) for i in chosen]
        sums = tuple((b + p[:, at].sum(axis=1))[0] for p, b in zip(self.parts, self.base, strict=True))
        return dict(zip(self.names, np.sqrt(distance(sums, self.columns, self.scale)).tolist(), strict=True))


def alternatives_of(
    subject: Subject, space: DesignSpace, candidates: Sequence[Candidate], count: int, *, jobs: int = 1
) -> Alternatives:
    """Linearise the integer-order alternatives of each candidate, twice: about a first fit, and about the chosen set's.

    Parameters
    ----------
    subject : Subject
        Of a fractional model.
    space : DesignSpace
    candidates : sequence of Candidate
    count : int
        How many experiments are chosen.
    jobs : int
        Threads.

    Raises
    ------
    InputError
        If every order is an integer already, or no run of the integer-order model ends.

    Examples
    --------
    >>> import fracid
    >>> from fracid.experiments.choice import subject_of
    >>> space = DesignSpace(release=(10, 45, 90), seconds=4, rate=100)
    >>> subject = subject_of(fracid.rotary_pendulum("qube-servo2"), space, orders={"mu": 0.95})
    >>> alternatives = alternatives_of(subject, space, space.candidates, 1)
    >>> alternatives.names[0], alternatives.parts[0].shape
    ('friction', (1, 3))
    """
    orders = subject.problem.parametrisation.order_starts
    integers = integer_values(subject.problem)
    if all(isinstance(v, float | int) and abs(v - orders[n]) < 1e-6 for n, v in integers.items() if n in orders):
        raise InputError("Every order is an integer, so that nothing is to be told from an integer-order model; give "
                         "orders = {\"mu\": 0.95} of a model, or a run whose orders are free.")  # fmt: skip
    first = _spread(candidates, 2)
    rival = _Rival(subject, space, first)
    linear = rival.linearised(candidates, range(len(candidates)), jobs)
    single = averaged(linear.objective, linear.parts, linear.base)
    chosen = linear.chosen(count)
    short = sorted({*chosen, *(linear.allowed[int(i)] for i in np.argsort(single)[:SHORTLIST])})
    again = _Rival(subject, space, [candidates[i] for i in dict.fromkeys(chosen)])
    return again.linearised(candidates, short, jobs)


def _spread(candidates: Sequence[Candidate], count: int) -> list[Candidate]:
    """A few that differ in their release, as a first set."""
    by_release = sorted(candidates, key=lambda c: (c.arm, c.voltage is not None, abs(c.release)))
    return [by_release[i] for i in np.unique(np.linspace(0, len(by_release) - 1, count).astype(int))]


class _Rival:
    """The integer-order model that fits some experiments best."""

    def __init__(self, subject: Subject, space: DesignSpace, experiments: Sequence[Candidate]) -> None:
        self.subject, self.space = subject, space
        problems = [self._simulated(c, f"planned {k}") for k, c in enumerate(experiments) if c.arm == "free"]
        problems = problems or [self._simulated(c, f"planned {k}") for k, c in enumerate(experiments)]
        data = tuple(p.experiments[0] for p in problems if p is not None)
        if not data:
            raise InputError("No run of the model reaches the end of a candidate.")
        pattern = next(p for p in problems if p is not None)
        joint = replace(pattern, experiments=data)
        self.substeps = max(p.substeps for p in problems if p is not None)
        joint = replace(joint, substeps=self.substeps)
        ranges = freed_friction(joint)
        kinds = joint.model.friction
        joints = ("", *moving(joint))
        self.friction = {n: v for n, v in ranges.items() if kinds[n].joint in joints}
        self.orders = integer_values(joint)
        joint = self._integer(joint)
        best = minimise(joint.evaluate, least_squares(joint.space, None)).best
        self.values = {u.target: v for u, v in zip(joint.unknowns, best.point.tolist(), strict=True)
                       if u.experiment is None}  # fmt: skip
        self.elements = {
            element.name: element.problem for change in ELEMENTS for element in change(joint)
            if element.possible and not element.slow and element.whole is None and element.names
        }  # fmt: skip
        self.extra = {name: tuple(n for n in p.names if n not in joint.names) for name, p in self.elements.items()}
        shared = [u for u in joint.unknowns if u.experiment is None]
        self.names = (*(u.name for u in shared), *(n for e in self.extra.values() for n in e))
        ranges = {u.name: u.range for p in (joint, *self.elements.values()) for u in p.unknowns}
        values = [self.values.get(n, 0.0) for n in self.names]
        self.scale = np.array([max(abs(v), 1e-2 * min(ranges[n].upper - ranges[n].lower, 1.0))
                               for n, v in zip(self.names, values, strict=True)])  # fmt: skip
        self.shared = len(shared)

    def _simulated(self, c: Candidate, name: str) -> Problem | None:
        """A candidate's problem, with the fractional model's outputs for what is measured."""
        p = self.subject.problem_of(c, self.space)
        outputs = p.fitted(p.start, p.experiments[0])
        if isinstance(outputs, Failure):
            return None
        return replace(p, experiments=(replace(p.experiments[0], name=name, measured=np.ascontiguousarray(outputs)),))

    def _integer(self, p: Problem) -> Problem:
        """The integer-order model of a problem's recordings, friction free."""
        parameters = {**p.parameters, **{n: v for n, v in self.friction.items()}}
        values = getattr(self, "values", {})
        starting = {
            n: replace(v, start=values[n], lower=min(v.lower, values[n]), upper=max(v.upper, values[n]))
            if n in values and not isinstance(v, float | int) and hasattr(v, "start") else v
            for n, v in parameters.items()
        }  # fmt: skip
        return replace(p, orders=self.orders, parameters=starting, memo=None)

    def linearised(self, candidates: Sequence[Candidate], which: Sequence[int], jobs: int) -> Alternatives:
        """c, b and A of each candidate that runs, and of what has been recorded."""

        def sums(i: int) -> tuple[FloatArray, ...] | None:
            p = self._simulated(candidates[i], "planned")
            return None if p is None else self._sums(p)

        with ThreadPoolExecutor(jobs) as pool:
            rows = [*pool.map(sums, which)]
        allowed = [i for i, row in zip(which, rows, strict=True) if row is not None]
        if not allowed:
            raise InputError("No run of the integer-order model reaches the end of a candidate.")
        parts = tuple(np.array([part])
                      for part in map(np.array, zip(*(r for r in rows if r is not None), strict=True)))  # fmt: skip
        n = len(self.names)
        recorded: list[FloatArray] = [np.zeros(()), np.zeros(n), VAGUE * np.diag(self.scale**-2.0)]
        at, columns = self.shared, [tuple(range(self.shared))]
        for names in self.extra.values():
            columns.append((*range(self.shared), *range(at, at + len(names))))
            at += len(names)
        return Alternatives((FRICTION, *self.extra), tuple(columns), self.scale, parts,
                            tuple(r[None] for r in recorded), tuple(allowed))  # fmt: skip

    def _sums(self, p: Problem) -> tuple[FloatArray, ...] | None:
        """c, b and A of one experiment."""
        here = self._integer(p)
        errors = here.errors(here.start)
        J = jacobian(here, here.start, np.arange(len(here.names)))
        if isinstance(errors, Failure) or isinstance(J, Failure):
            return None
        columns = {u.name: J[0][..., i] for i, u in enumerate(here.unknowns) if u.experiment is None}
        own = J[0][..., [u.experiment is not None for u in here.unknowns]]
        for change in ELEMENTS:
            for element in change(here):
                names = self.extra.get(element.name, ())
                at = [element.problem.names.index(n) for n in names if n in element.problem.names]
                if not at:
                    continue
                more = jacobian(element.problem, element.problem.start, np.array(at))
                if not isinstance(more, Failure):
                    columns |= {n: more[0][..., k] for k, n in enumerate(names)}
        still = np.zeros(errors[0].shape)
        full = -np.stack([columns.get(n, still) for n in self.names], axis=-1)
        root = np.array([1 / math.sqrt(self.subject.noise_of(n).variance) for n in p.outputs])
        r, full, own = errors[0] * root, full * root[:, None], own * root[:, None]
        flat, rows, missed = own.reshape(-1, own.shape[-1]), full.reshape(-1, len(self.names)), r.ravel()
        if flat.shape[1]:
            q, _ = np.linalg.qr(flat / np.maximum(np.linalg.norm(flat, axis=0), 1e-300))
            rows, missed = rows - q @ (q.T @ rows), missed - q @ (q.T @ missed)
        worth = 1 / float(np.exp(np.mean(np.log(self.subject.excess))))
        return worth * np.array(missed @ missed), worth * rows.T @ missed, worth * rows.T @ rows
