"""``fracid.design``: the next experiments on a rig, and their expected intervals."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fracid.arrays import ByName, FloatArray, by_name
from fracid.errors import Failure, InputError, at_least, refuse_unknown
from fracid.estimation.derivatives import jacobian
from fracid.estimation.parameter_verdicts import widest
from fracid.estimation.search import searched
from fracid.experiments.alternatives import SHORTLIST, alternatives_of, orders_alone, rivals_of, with_states
from fracid.experiments.criteria import CRITERIA, objective_named
from fracid.experiments.exchange import Criterion, exchange, of_each
from fracid.experiments.information import Information, of_samples
from fracid.experiments.plan import Plan, Value
from fracid.experiments.space import Candidate, DesignSpace, by_motion
from fracid.experiments.subject import SAYS, VAGUE, Subject, driven, subject_of_model, subject_of_problem
from fracid.findings import Note, with_code
from fracid.fit import Fit
from fracid.models import Model
from fracid.problem import Problem
from fracid.problem.project import Project
from fracid.runs.saved import SavedRun
from fracid.tasks.job import Counter, in_threads
from fracid.tasks.progress import Observer, Tell

Source = Fit | Project | Problem | Model

BEYOND = "beyond the limits"
"""Why a candidate is excluded that would travel too far or too fast."""

NOMINAL = 0.1
"""Standard deviation of a constant of which no interval is known, in typical sizes."""


def design(
    source: Source,
    space: DesignSpace,
    *,
    experiments: int = 3,
    criterion: str | None = None,
    of: Sequence[str] = (),
    against: str | None = None,
    free: Sequence[str] = (),
    orders: Mapping[str, float] | None = None,
    robust: int = 0,
    seed: int = 1,
    jobs: int = 1,
    observer: Observer | None = None,
) -> Plan:
    """Choose the next experiments on a rig.

    For each candidate the derivatives of its outputs by all free values give its information; what it has for itself,
    its initial state, is eliminated.  Information adds up, that of the recordings so far included, and the best set,
    repetition allowed, is found by exchange.

    Parameters
    ----------
    source : Fit, SavedRun, Project, Problem or Model
        What is known: a run's values, noise and recordings; a project, which is searched first, or a problem at its
        start; or a rig's constants alone.
    space : DesignSpace
        What can be done.
    experiments : int
        How many.
    criterion : {"D", "A", "Ds", "T"}, optional
        Ds where `of` names values, T with `against`, else D.
    of : sequence of str
        The values to narrow: ``("lambda", "mu")``.
    against : "integer", optional
        Choose what tells the orders from the best integer-order alternative, each of them where it alone is off; those
        that `of` names, if it names some.
    free, orders
        Of a model: the names that fits are to find, and the values of its orders.
    robust : int
        Draws of the values from their intervals, over which the criterion is averaged; 0 for the values alone.
    seed : int
        Of the draws.
    jobs : int
        Threads.
    observer : Observer, optional
        Hears each stage as it begins, and how many candidates are done.

    Returns
    -------
    Plan

    Raises
    ------
    InputError
        For what cannot be designed: an unknown name, a space in which no candidate stays within its limits.

    Examples
    --------
    >>> import fracid
    >>> space = fracid.DesignSpace(release=(10, 45, 90), seconds=5, rate=100)
    >>> plan = fracid.design(fracid.rotary_pendulum("qube-servo2"), space, experiments=2, of=("mu",),
    ...                      free=("mu", "b_alpha"))
    >>> len(plan.experiments), plan.expected["mu"].interval95[0] < 1.0 < plan.expected["mu"].interval95[1]
    (2, True)
    """
    at_least("experiments", experiments, 1, 1000)
    at_least("robust", robust, 0, 1000)
    refuse_unknown("alternative to design against", ("integer",), against or "integer")
    of = (of,) if isinstance(of, str) else of
    name = criterion or ("T" if against else "Ds" if of else "D")
    refuse_unknown("criterion", CRITERIA, name)
    if not (candidates := space.candidates):  # before a project is searched
        raise InputError(SAYS("empty-space"))
    watching = observer or Observer()
    if isinstance(source, Project):
        watching.stage("search")
    subject = subject_of(source, space, free=free, orders=orders, jobs=jobs)
    subject.check()
    unit = subject.problem.model.input_unit(driven(subject.problem))
    candidates = tuple(replace(c, unit=unit) for c in candidates)
    places = subject.places(of)
    with watching.progress("candidates") as tell:
        tables = informations(subject, candidates, progress=tell)
    if not (possible := [(c, t) for c, t in zip(candidates, tables, strict=True) if isinstance(t, Information)]):
        raise InputError(_excluded(tables))
    candidates, narrowed = tuple(c for c, _ in possible), tuple(subject.names[i] for i in places)
    told: dict[str, Mapping[str, float]] = {}
    if name == "T":
        watching.stage("integer-order models that come nearest")
        each = orders_alone(subject, candidates, experiments, of=narrowed)
        chosen = each.chosen(experiments)
        watching.stage("integer-order models of the chosen experiments")
        done = [candidates[i] for i in chosen]
        rivals = rivals_of(subject, done)
        together = alternatives_of(subject, done, range(len(done)), rivals)
        distances = {**together.distances(range(len(done))), **with_states(subject, done, rivals)}
        told = {"distances": distances, "alone": each.nearest(chosen)}
    else:
        known = subject.known(VAGUE)
        nominal = Criterion(objective_named(name, subject.scale, places), _stacked([t for _, t in possible]),
                            (known.curvature, known.scatter))  # fmt: skip
        chosen = exchange([nominal], experiments)
        if robust:
            watching.stage("values from the intervals")
            chosen = _robust(subject, candidates, nominal, chosen, draws=_drawn(subject, robust, seed))
    watching.stage("")
    return _plan(subject, possible, chosen, criterion=name, of=narrowed, excluded=len(tables) - len(possible), **told)


def subject_of(
    source: Source, space: DesignSpace, *, free: Sequence[str] = (), orders: ByName | None = None, jobs: int = 1
) -> Subject:
    """What a design is about, from whatever is there.

    Raises
    ------
    InputError
        For another type, for a search without a result, and where `free` or `orders` are given beside a run.
    """
    if isinstance(source, Model):
        return replace(subject_of_model(source, space, free=free, orders=orders), jobs=jobs)
    if free or orders:
        raise InputError("free and orders are of a model alone; a run and a project have their own.")
    if isinstance(source, SavedRun):
        return subject_of_problem(source.problem, source.x, space, name=source.folder.name,
                                  table=_tables(source.project), jobs=jobs)  # fmt: skip
    if isinstance(source, Fit):
        return subject_of_problem(source.problem, source.x, space, precision=source.uncertainty, jobs=jobs)
    if isinstance(source, Problem):
        return subject_of_problem(source, source.start, space, jobs=jobs)
    if isinstance(source, Project):
        x = searched(source, "plan with", jobs)
        return subject_of_problem(source.problem, x, space, name=source.path.stem, table=_tables(source), jobs=jobs)
    raise InputError(SAYS("no-source", kind=type(source).__name__))


def _tables(project: Project) -> dict[str, Any]:
    """The tables of a project file that a plan's own projects begin with."""
    content = tomllib.loads(project.text)
    return {"model": content.get("model", {}), "recording": content["recording"], "home": project.path.parent}


# --- the information of candidates -----------------------------------------------------------------------


def informations(
    subject: Subject, candidates: Sequence[Candidate], *, progress: Tell | None = None
) -> list[Information | str]:
    """The information of each candidate, or why it is excluded.

    Those that differ in their duration alone are the beginnings of one simulation.

    Examples
    --------
    >>> import fracid
    >>> space = DesignSpace(release=(10, 150, 30), seconds=2, rate=100, limits={"alpha": 1.0})
    >>> subject = subject_of(fracid.rotary_pendulum("qube-servo2"), space, free=("mu", "b_alpha"))
    >>> [t if isinstance(t, str) else t.curvature.shape for t in informations(subject, space.candidates)]
    [(2, 2), 'beyond the limits', (2, 2)]
    """

    tables: list[Information | str] = [""] * len(candidates)
    count = Counter(progress, len(candidates))

    def of_group(group: list[int]) -> None:
        for i, table in zip(group, _of_motion(subject, [candidates[i] for i in group]), strict=True):
            tables[i] = table
        count(len(group))

    in_threads(subject.jobs, of_group, by_motion(candidates))
    return tables


def _of_motion(subject: Subject, durations: Sequence[Candidate]) -> list[Information | str]:
    """The information of one motion, for each of its durations."""
    problem = subject.problem_of(max(durations, key=lambda c: c.seconds))
    outputs = problem.fitted(problem.start, problem.experiments[0])
    if isinstance(outputs, Failure):
        return [str(outputs) for _ in durations]
    within = [subject.space.within_limits(dict(zip(problem.outputs, outputs[: c.samples].T, strict=True)), c.rate)
              for c in durations]  # fmt: skip
    if not any(within):
        return [Note(BEYOND, "limits") for _ in durations]
    J = jacobian(problem, problem.start, np.arange(len(problem.names)))
    if isinstance(J, Failure):
        return [str(J) for _ in durations]
    own = np.array([u.experiment is not None for u in problem.unknowns])
    columns = dict(zip(problem.names, np.moveaxis(J[0], -1, 0), strict=True))
    shared = np.stack([columns.get(n, np.zeros(outputs.shape)) for n in subject.names], axis=-1)
    noise = [subject.noise_of(n) for n in problem.outputs]
    return [
        of_samples(outputs[: c.samples], shared[: c.samples], J[0][: c.samples][..., own], noise,
                   weights=problem.weights, excess=subject.excess) if possible else Note(BEYOND, "limits")
        for c, possible in zip(durations, within, strict=True)
    ]  # fmt: skip


def _excluded(tables: Sequence[Information | str]) -> str:
    reasons = [t for t in tables if isinstance(t, str)]
    common = max(set(reasons), key=reasons.count)
    advice = SAYS("advice-limits" if with_code([common], "limits") else "advice")
    return SAYS("none-possible", count=len(tables), times=reasons.count(common), common=common, advice=advice)


def _stacked(tables: Sequence[Information | str]) -> tuple[FloatArray, ...]:
    """Curvatures and scatters of candidates, each of shape (n_candidates, n, n)."""
    found = [t for t in tables if isinstance(t, Information)]
    return np.array([t.curvature for t in found]), np.array([t.scatter for t in found])


# --- robust -----------------------------------------------------------------------------------------------


def _robust(
    subject: Subject, candidates: Sequence[Candidate], nominal: Criterion, chosen: tuple[int, ...],
    draws: Sequence[FloatArray],
) -> tuple[int, ...]:  # fmt: skip
    """The best set on average over values from their intervals, of the candidates that are good at the estimates."""
    alone, beside = of_each([nominal], ()), of_each([nominal], chosen[1:])
    best = [*np.argsort(alone)[: SHORTLIST // 2], *np.argsort(beside)[: SHORTLIST // 2], *chosen]
    short = sorted({int(i) for i in best})
    drawn = (subject.at(by_name(subject.names, v)) for v in draws)
    tables = [informations(there, [candidates[i] for i in short]) for there in drawn]
    usable = [k for k in range(len(short)) if all(isinstance(t[k], Information) for t in tables)]
    if not usable:
        return chosen
    each = [replace(nominal, parts=_stacked([t[k] for k in usable])) for t in tables]
    return tuple(sorted(short[usable[i]] for i in exchange(each, len(chosen))))


def _drawn(subject: Subject, draws: int, seed: int) -> list[FloatArray]:
    """Values from their intervals, or from a tenth around a constant of which none is known; within their bounds."""
    rng = np.random.default_rng(seed)
    covariance = subject.known(NOMINAL).covariance(subject.scale)
    values, lower, upper = np.array([(u.range.start, u.range.lower, u.range.upper) for u in subject.shared]).T
    return [np.clip(rng.multivariate_normal(values, covariance, method="eigh"), lower, upper) for _ in range(draws)]


# --- the plan ---------------------------------------------------------------------------------------------


def _plan(
    subject: Subject, possible: Sequence[tuple[Candidate, Information]], chosen: tuple[int, ...], **said: Any
) -> Plan:
    """The plan of those that are chosen, with what else is said of it."""
    names, scale, base = subject.names, subject.scale, subject.known(VAGUE)
    total = sum((possible[i][1] for i in chosen), base)
    before, after = (np.sqrt(np.diag(i.covariance(scale))) for i in (base, total))
    rows = zip(subject.shared, after.tolist(), before.tolist(), scale.tolist(), strict=True)
    expected = {u.name: Value(v := u.range.start, u.unit, e if e < s else None, b if b < s else None,
                              widest=widest(subject.problem, u, v)) for u, e, b, s in rows}  # fmt: skip
    landscape = tuple((c, by_name(names, np.sqrt(np.diag((base + i).covariance(scale))))) for c, i in possible)
    return Plan(
        subject=subject, name=subject.name, experiments=tuple(possible[i][0] for i in chosen), expected=expected,
        candidates=len(possible), landscape=landscape, covariance=total.covariance(scale), **said,
    )  # fmt: skip
