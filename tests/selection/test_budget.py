"""What follows a search takes no more than twice its work, and says what it left out."""

import json
import math
from collections import Counter

import pytest

from fracid import Free, Problem, Unfinished, compare, identification, identify
from fracid.estimation import interval_walk
from fracid.estimation.covariance import uncertainty
from fracid.estimation.derivatives import jacobian
from fracid.estimation.minimum import settled
from fracid.identification import examination
from fracid.problem.simulator import Simulator
from fracid.selection import comparison, integer_alternatives
from fracid.tasks.journal import Journal
from fracid.tasks.progress import Observer
from twins import RIG, release

ORDERS = {"lambda": Free(1.0, 0.5, 1.2), "mu": Free(1.0, 0.5, 1.2)}
VALUE = {n: RIG.parameter(n).value for n in ("C1", "J_theta", "b_theta", "b_alpha")}
FREE = {n: Free(1.2 * v, 0.3 * v, 3 * v) for n, v in VALUE.items()}


def swings(count, free):
    twins = tuple(release(f"swing {k}", alpha=0.3 + 0.01 * k, step=4e-3, end=4.0, noise=1e-3, seed=k)
                  for k in range(count))  # fmt: skip
    return Problem(RIG, twins, ORDERS, free, initial_state="held")


def examined(problem, monkeypatch):
    """A fit whose alternatives get twice its search however quick that is, what they took, and what the search."""
    seen = []

    def watched(*args, watch, **options):
        found = integer_alternatives.integer_alternatives(*args, watch=watch, **options)
        seen.append((watch.work, watch.most / identification.TIMES))
        return found

    monkeypatch.setattr(identification, "LEAST", 0.0)
    monkeypatch.setattr(examination, "integer_alternatives", watched)
    fit = identify(problem)
    return fit, *seen[-1]


@pytest.mark.broad
@pytest.mark.few(1)
@pytest.mark.parametrize(("count", "free"), [(1, FREE), (1, {}), (12, {})])
def test_integer_alternatives_take_twice_the_work_of_the_search_and_a_list_that_was_cut_is_not_called_fractional(
    count, free, monkeypatch
):
    fit, took, search = examined(swings(count, free), monkeypatch)
    assert 0 < took <= 2.25 * search  # it ends after the runs that are under way
    assert fit.alternative.cut
    assert fit.claim == "undecided"
    assert "was not all tried" in fit.claim_reasons[0]
    if count > 1:
        assert fit.claim_reasons[-1] == "Models of integer order were compared on 6 of 12 recordings, 4 s of each."


@pytest.mark.broad
def test_what_is_settled_before_the_work_is_spent_stays_so(monkeypatch):
    """Friction that the model fixes at too little explains all: it's the first that is tried."""
    twin = release("swing", alpha=0.5, step=4e-3, end=4.0, noise=1e-3, orders={"lambda": 1.0, "mu": 1.0},
                   parameters={"b_alpha": 3 * VALUE["b_alpha"]})  # fmt: skip
    monkeypatch.setattr(identification, "TIMES", 50.0)
    fit, *_ = examined(Problem(RIG, (twin,), {**ORDERS, "lambda": 1.0}, initial_state="held"), monkeypatch)
    assert fit.claim == "integer"
    assert not fit.alternative.cut


@pytest.mark.broad
def test_the_alternatives_of_a_comparison_end_after_so_many_times_the_work_of_its_fits_when_it_is_gone_on_with_too(
    tmp_path, monkeypatch
):
    fitted, held_out = (release(f"swing {alpha}", alpha=alpha, step=4e-3, end=3.0, noise=1e-4,
                                orders={"lambda": 1.0, "mu": 0.95}) for alpha in (0.5, 0.3))  # fmt: skip
    problem = Problem(RIG, (fitted,), {"lambda": 1.0, "mu": Free(1.0, 0.5, 1.2)}, initial_state="held")
    seen = []

    def cut_off_once(*args, watch, **options):
        seen.append(watch)
        if len(seen) == 1:
            raise KeyboardInterrupt
        return integer_alternatives.integer_alternatives(*args, watch=watch, **options)

    monkeypatch.setattr(comparison, "LEAST", 0.0)
    monkeypatch.setattr(comparison, "TIMES", 2 / comparison.MORE)
    monkeypatch.setattr(comparison, "integer_alternatives", cut_off_once)
    options = {"validation": [held_out], "rungs": ["viscous"]}
    with Journal(tmp_path / "journal.jsonl", {}) as journal, pytest.raises(Unfinished):
        compare(problem, **options, journal=journal)
    fits = [json.loads(line)["value"] for line in (tmp_path / "journal.jsonl").read_text().splitlines()[1:]]
    work = sum(fit.get("work", 0) for fit in fits)
    with Journal(tmp_path / "journal.jsonl", {}) as journal:
        found = compare(problem, **options, journal=journal)
    assert [watch.most for watch in seen] == [2 * work] * 2
    assert 0 < seen[1].work <= 1.25 * seen[1].most  # it ends after the runs that are under way
    assert found.alternative.cut
    assert found.claim == "undecided"
    assert found.claim_reasons[0].endswith("was not all tried: it takes more than twenty times the fits.")
    assert found.claim_reasons[1].startswith("To decide: fewer or shorter recordings")


def test_the_ends_of_intervals_get_twice_the_work_of_the_search_and_those_that_were_left_are_counted(monkeypatch):
    monkeypatch.setattr(interval_walk, "OFF", 0.0)  # so that no first look is enough
    monkeypatch.setattr(interval_walk, "CLOSE", 0.0)
    monkeypatch.setattr(identification, "LEAST", 0.0)
    allowed, walked = [], interval_walk.walked

    def watched(here, known, *, most, jobs):
        allowed.append(most)
        found = walked(here, known, most=0.0, jobs=jobs)
        assert found.unwalked == 4
        return found

    monkeypatch.setattr(examination, "walked", watched)
    fit = identify(swings(1, {}), fixed_step=True)
    assert 0 < allowed[0] <= identification.TIMES * fit.evaluations
    assert any("4 may lie elsewhere" in w for w in fit.warnings)


@pytest.mark.parametrize(("most", "asked"), [(math.inf, True), (3, False)])
def test_a_walk_asks_for_derivatives_of_its_own_only_where_they_fit_into_what_is_left(most, asked, monkeypatch):
    problem, derivatives = swings(1, {}), []
    here = settled(problem, problem.start)
    known = uncertainty(problem, here.x, near=here)

    def watched(*args, **options):
        derivatives.append(args)
        return jacobian(*args, **options)

    monkeypatch.setattr(interval_walk, "EXACT", 0.0)  # so that no ground is low enough
    monkeypatch.setattr(interval_walk, "OFF", 0.0)  # nor a first look
    monkeypatch.setattr(interval_walk, "CLOSE", 0.0)
    monkeypatch.setattr(interval_walk, "jacobian", watched)
    interval_walk.walked(here, known, most=2 * most)
    assert bool(derivatives) is asked


WIDE = FREE | {n: Free(v, 0.3 * v, 3 * v) for n in ("C3", "C4", "C6") if (v := RIG.parameter(n).value)} | {
    n: Free(1e-4, 0.0, 0.01) for n in ("coulomb_theta", "coulomb_alpha", "drag_theta", "drag_alpha", "cable_stiffness")
}  # fmt: skip


def an_hour_for_its_rate():
    twin = release("long", alpha=0.5, step=4e-3, end=60.0, noise=1e-3, seed=1)
    return Problem(RIG, (twin,), ORDERS, FREE, initial_state="held")


@pytest.mark.broad
@pytest.mark.parametrize("problem", [
    pytest.param(lambda: swings(8, FREE), id="many recordings"),
    pytest.param(lambda: swings(1, WIDE), id="many unknowns"),
    pytest.param(an_hour_for_its_rate, id="a long record"),
])  # fmt: skip
def test_no_stage_after_the_search_simulates_much_more_than_twice_what_the_search_does(problem, monkeypatch):
    """It ends after the runs that are under way, and looks at the residuals of what it found."""
    steps, stage, trajectories = Counter(), ["look"], Simulator.trajectories

    def counted(self, points, e, wanted):
        steps[stage[-1]] += len(wanted) * self.steps(e) * len(self.parametrisation.model.states)
        return trajectories(self, points, e, wanted)

    monkeypatch.setattr(Simulator, "trajectories", counted)
    monkeypatch.setattr(identification, "LEAST", 0.0)
    identify(problem(), observer=Observer(stage=stage.append))
    assert {"search", "intervals"} <= set(steps)
    assert all(taken <= 3.0 * steps["search"] for taken in steps.values()), steps
