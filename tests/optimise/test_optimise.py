"""The ask/tell loop and every optimiser of the table, on problems whose minimum is known."""

import json
import os
import signal
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from fracid.arrowhead import Blocks
from fracid.errors import InputError, at_least
from fracid.optimise import (
    OPTIMISERS,
    Evaluation,
    EvaluationLog,
    Outcome,
    Path,
    Space,
    as_generator,
    least_squares,
    lockstep,
    minimise,
    nelder_mead,
    optimiser_from_name,
    sobol_points,
)

SPACE = Space(("lambda", "mu"), np.full(2, 0.5), np.full(2, 1.2), np.full(2, 1.0))
TRUTH = np.array([0.8623, 0.9146])
CLOSE = {
    "least-squares": 1e-6,
    "multistart": 1e-6,
    "nelder-mead": 1e-4,
    "differential-evolution": 1e-3,
    "cma": 1e-4,
    "genetic": 0.05,
}
"""How near each comes to the minimum of a bowl."""

every = pytest.mark.parametrize("name", OPTIMISERS)


def squares(rows):
    """Make an evaluation of x -> rows; a run outside their domain (None) fails."""

    def evaluate(x):
        r = rows(x)
        return Evaluation(x, np.inf, None, "diverges") if r is None else Evaluation(x, float(r @ r), r)

    return evaluate


bowl = squares(lambda x: np.array([3.0, 1.0]) * (x - TRUTH))
two_wells = squares(lambda x: np.array([40 * (x[0] - 0.6) * (x[0] - 1.0), x[0] - 0.6, x[1] - 0.9]))
"""A well at (0.6, 0.9), cost 0, and a higher one beside the start, at (1.0, 0.9)."""


def valley(x, steep=10.0, flat=1.5, slope=0.2, tilt=0.1):
    """|.| over a valley across the two orders, as ITAE on α has it."""
    a, b = x - TRUTH
    return Evaluation(x, abs(slope * a + b) * steep + abs(a - tilt * b) * flat + 3 * a * a)


def narrow(x):
    return valley(x, 20.0, 1.0, 0.5, 0.5)


def many_starts(space, rng, *, starts=8, tolerance=1e-8):
    """Least squares from the start and from Sobol points, in lockstep."""
    points = [space.start, *sobol_points(space, starts - 1, rng)]
    searches = [least_squares(replace(space, start=x), None, tolerance=tolerance) for x in points]
    return lockstep(searches, [Path() for _ in points])


def search(name, evaluate=bowl, space=SPACE, seed=1, jobs=1, log=None, callback=None, stop=None, **options):
    rng = np.random.default_rng(seed)
    optimiser = (OPTIMISERS[name].function or many_starts)(space, rng, **options)
    return minimise(evaluate, optimiser, jobs=jobs, log=log, callback=callback, stop=stop)


def recorded(name, evaluate=bowl, **options):
    """Every evaluation of a search, in order, and its result."""
    trail = []
    result = search(name, evaluate, log=trail.extend, **options)
    return trail, result


# --- every optimiser -------------------------------------------------------------------------------


@every
def test_it_finds_the_bottom_of_a_bowl(name):
    result = search(name)
    assert np.max(np.abs(result.best.point - TRUTH)) < CLOSE[name]
    assert result.outcome in (Outcome.CONVERGED, Outcome.GENERATIONS_DONE)


@every
def test_it_finds_a_minimum_in_a_corner_of_the_bounds(name):
    result = search(name, squares(lambda x: x - np.array([0.2, 1.5])))
    np.testing.assert_allclose(result.best.point, [0.5, 1.2], atol=CLOSE[name])


@pytest.mark.parametrize("name", ["multistart", "differential-evolution", "genetic"])
def test_a_global_search_leaves_the_well_it_starts_in(name):
    np.testing.assert_allclose(search(name, two_wells).best.point, [0.6, 0.9], atol=CLOSE[name])


@pytest.mark.parametrize("name", ["least-squares", "nelder-mead"])
def test_a_local_search_stays_in_the_well_it_starts_in(name):
    np.testing.assert_allclose(search(name, two_wells).best.point, [1.0, 0.9], atol=5e-3)


@pytest.mark.few(2)
@every
def test_the_result_is_the_same_for_any_number_of_threads(name):
    def slow(x):  # so that runs end in another order than they began
        time.sleep(2e-3 * (1e3 * x[0] % 1))
        return two_wells(x)

    one, first = recorded(name, slow, jobs=1)
    four, second = recorded(name, slow, jobs=4)
    assert [e.point.tolist() for e in one] == [e.point.tolist() for e in four]
    assert first.best.point.tolist() == second.best.point.tolist()
    assert (first.outcome, first.evaluations) == (second.outcome, second.evaluations)


@pytest.mark.few(3)
@every
def test_the_seed_decides_and_numpys_global_state_is_untouched(name):
    before = np.random.get_state()[1].tolist()  # noqa: NPY002
    trails = [[e.point.tolist() for e in recorded(name, seed=seed)[0]] for seed in (1, 1, 2)]
    assert trails[0] == trails[1]
    assert (trails[0] == trails[2]) == (name in ("least-squares", "nelder-mead"))  # these draw no numbers
    assert np.random.get_state()[1].tolist() == before  # noqa: NPY002


@pytest.mark.few(3)
@every
def test_it_never_leaves_the_bounds(name):
    for evaluate in (bowl, two_wells, squares(lambda x: x - np.array([0.2, 1.5]))):
        points = np.array([e.point for e in recorded(name, evaluate)[0]])
        assert np.all((SPACE.lower <= points) & (points <= SPACE.upper))


@pytest.mark.few(1)
@pytest.mark.parametrize("name", ["least-squares", "nelder-mead", "multistart"])
@settings(max_examples=20, deadline=None)
@example(lower=0.0, width=1.0, start=0.5625, target=0.0625)
@given(
    lower=st.floats(-1e3, 1e3),
    width=st.floats(1e-6, 1e3),
    start=st.floats(0, 1),
    target=st.floats(-2, 3),
)
def test_it_never_leaves_bounds_of_any_size_and_finds_the_point_nearest_to_the_target(
    name, lower, width, start, target
):
    upper = lower + width
    space = Space(("a",), np.array([lower]), np.array([upper]), np.array([min(lower + start * width, upper)]))
    aim = lower + target * width
    trail, result = recorded(name, squares(lambda x: (x - aim) / width), space=space)
    points = np.array([e.point[0] for e in trail])
    assert np.all((lower <= points) & (points <= upper))
    assert abs(result.best.point[0] - np.clip(aim, lower, upper)) < 1e-3 * width


@every
def test_failing_runs_beside_the_minimum_do_not_stop_it(name):
    trail, result = recorded(name, squares(lambda x: None if x[0] < 0.8 else x - TRUTH), seed=3)
    assert np.max(np.abs(result.best.point - TRUTH)) < CLOSE[name]
    assert any(e.cost == np.inf for e in trail) or name in ("least-squares", "nelder-mead")


@every
@pytest.mark.parametrize("cost", [np.inf, np.nan, -np.inf])
def test_where_every_run_fails_the_outcome_says_so_and_the_last_is_given(name, cost):
    trail, result = recorded(name, lambda x: Evaluation(x, cost, x, "" if cost != np.inf else "det M = 0"))
    assert result.outcome is Outcome.ALL_FAILED
    assert result.best is trail[-1]
    assert result.best.cost == np.inf
    assert result.best.residuals is None
    assert result.best.reason == ("det M = 0" if cost == np.inf else f"the cost is {cost}")


@every
def test_a_nan_is_never_the_best(name):
    result = search(name, lambda x: bowl(x) if x[0] > 0.8 else Evaluation(x, np.nan), seed=3)
    assert np.max(np.abs(result.best.point - TRUTH)) < CLOSE[name]


@every
def test_an_error_of_the_model_reaches_the_caller_and_no_thread_is_left(name):
    def broken(x):
        raise InputError("the model is broken")

    before = threading.active_count()
    with pytest.raises(InputError, match="the model is broken"):
        search(name, broken, jobs=2)
    assert threading.active_count() == before


@every
def test_a_search_left_halfway_leaves_no_thread(name):
    before = threading.active_count()
    optimiser = (OPTIMISERS[name].function or many_starts)(SPACE, np.random.default_rng(1))
    points = next(optimiser)
    optimiser.send([bowl(x) for x in np.atleast_2d(points)])
    optimiser.close()
    assert threading.active_count() == before


@every
def test_ctrl_c_keeps_the_best_so_far_and_leaves_no_thread(name):
    before, seen = threading.active_count(), []

    def evaluate(x):
        seen.append(x)
        if len(seen) == 30:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.1)  # the main thread, waiting for this run, takes the signal meanwhile
        return valley_with_rows(x)

    trail, result = recorded(name, evaluate)
    assert result.outcome is Outcome.INTERRUPTED
    assert result.interrupted
    assert result.evaluations == len(trail) <= 30
    assert result.best.cost == min(e.cost for e in trail)
    assert threading.active_count() == before


valley_with_rows = squares(lambda x: np.array([10 * (x[1] - x[0] ** 2), 0.3 * (x[0] - 0.6), (x[0] - 0.9) ** 3]))
"""Curved, and not soon at its end: no optimiser is done with it within thirty runs."""


@every
def test_the_number_of_evaluations_is_what_was_logged(name, tmp_path):
    with EvaluationLog(tmp_path / "evaluations.jsonl") as log:
        result = search(name, two_wells, log=lambda batch: log.append(SPACE.names, batch))
    lines = [json.loads(line) for line in (tmp_path / "evaluations.jsonl").read_text().splitlines()]
    assert [line["n"] for line in lines] == list(range(1, result.evaluations + 1))
    assert min(line["cost"] for line in lines) == result.best.cost
    assert all(set(line["point"]) == set(SPACE.names) and line["seconds"] >= 0 for line in lines)


# --- the loop --------------------------------------------------------------------------------------


def points_of(*batches):
    """Yield these batches and nothing else."""
    for batch in batches:
        yield np.array(batch, dtype=float)
    return Outcome.CONVERGED


def test_of_equal_costs_the_first_is_kept():
    result = minimise(lambda x: Evaluation(x, 1.0), points_of([[1.0], [2.0]], [[3.0]]))
    assert result.best.point.tolist() == [1.0]
    assert result.evaluations == 3


def test_the_callback_gets_the_best_and_the_count_after_each_batch():
    told = []
    minimise(lambda x: Evaluation(x, float(x[0])), points_of([[3.0], [2.0]], [[4.0]], [[1.0]]),
             callback=lambda best, count: told.append((best.cost, count)))  # fmt: skip
    assert told == [(2.0, 2), (2.0, 3), (1.0, 4)]


@pytest.mark.parametrize("how", ["callback", "stop"])
def test_a_caller_can_end_the_search_after_a_batch(how):
    def interrupt(best, count):
        raise KeyboardInterrupt

    way = {"callback": interrupt} if how == "callback" else {"stop": lambda: True}
    result = search("differential-evolution", **way)
    assert result.outcome is {"callback": Outcome.INTERRUPTED, "stop": Outcome.STOPPED}[how]
    assert result.evaluations == 20


def test_an_interrupted_batch_counts_for_what_it_did():
    def evaluate(x):
        if x[0] == 3.0:
            raise KeyboardInterrupt
        return Evaluation(x, float(x[0]))

    trail = []
    result = minimise(evaluate, points_of([[5.0]], [[2.0], [3.0], [1.0]]), log=trail.extend)
    assert (result.best.cost, result.evaluations, result.outcome) == (2.0, 2, Outcome.INTERRUPTED)
    assert [e.cost for e in trail] == [5.0, 2.0]


def test_ctrl_c_before_any_run_ended_is_not_swallowed():
    def evaluate(x):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        minimise(evaluate, points_of([[1.0]]))


def test_an_optimiser_that_asks_for_nothing_is_told():
    with pytest.raises(InputError, match="ended without a point"):
        minimise(bowl, points_of())


@pytest.mark.parametrize("jobs", [0, -1, 1.5, "2", True])
def test_a_number_of_threads_that_is_none_is_told(jobs):
    with pytest.raises(InputError, match=r"jobs = .*expected a whole number, 1 or more"):
        minimise(bowl, points_of([[1.0]]), jobs=jobs)


def test_a_count_may_be_numpys():
    assert at_least("starts", np.int64(3), 1) == 3


def test_runs_of_one_batch_overlap_in_time():
    barrier = threading.Barrier(4, timeout=10)  # passes only when four runs wait at once

    def evaluate(x):
        barrier.wait()
        return Evaluation(x, 0.0)

    assert minimise(evaluate, points_of([[1.0], [2.0], [3.0], [4.0]]), jobs=4).evaluations == 4


# --- the log ---------------------------------------------------------------------------------------


def test_a_failed_run_is_logged_as_null_with_its_reason(tmp_path):
    with EvaluationLog(tmp_path / "log.jsonl") as log:
        log.append(("mu",), [Evaluation(np.array([0.9]), np.inf, None, "überläuft bei t = 3 s")])
        line = json.loads((tmp_path / "log.jsonl").read_text(encoding="utf-8"))  # flushed, not only at the end
    assert line == {"n": 1, "point": {"mu": 0.9}, "cost": None, "reason": "überläuft bei t = 3 s"} | {
        "seconds": line["seconds"]
    }


def test_a_log_goes_on_where_an_older_one_ends(tmp_path):
    for _ in range(2):
        with EvaluationLog(tmp_path / "log.jsonl") as log:
            log.append(("mu",), [Evaluation(np.array([0.9]), 1.0)] * 3)
    lines = (tmp_path / "log.jsonl").read_text().splitlines()
    assert [json.loads(line)["n"] for line in lines] == [1, 2, 3, 4, 5, 6]


def test_a_log_in_a_missing_folder_is_told(tmp_path):
    with pytest.raises(InputError, match=r"log .*none.log\.jsonl cannot be written.*Is its folder there"):
        EvaluationLog(tmp_path / "none" / "log.jsonl")


# --- the space -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["genetic", "differential-evolution", "cma"])
def test_a_global_search_refuses_an_infinite_bound(name):
    space = Space(("C4", "mu"), np.array([0.0, 0.5]), np.array([np.inf, 1.2]), np.array([1.0, 1.0]))
    with pytest.raises(InputError, match="C4 has an infinite bound; a global search needs"):
        search(name, space=space)


@pytest.mark.parametrize("name", ["least-squares", "nelder-mead", "multistart"])
def test_a_local_search_does_without_bounds(name):
    space = Space(("a", "b"), np.array([-np.inf, 0.0]), np.full(2, np.inf), np.array([0.0, 5.0]))
    result = search(name, squares(lambda x: x - np.array([-20.0, 30.0])), space=space)
    np.testing.assert_allclose(result.best.point, [-20.0, 30.0], atol=1e-2)


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("genetic", {"population": 1}, "population = 1; expected a whole number, 2 or more"),
        ("genetic", {"generations": -1}, "generations = -1; expected"),
        ("genetic", {"crossover": 1.5}, "crossover = 1.5; expected a probability"),
        ("genetic", {"mutation": -0.1}, "mutation = -0.1; expected a probability"),
        ("differential-evolution", {"population": 2}, "population = 2; expected a whole number, 5 or more"),
        ("differential-evolution", {"generations": 0}, "generations = 0; expected"),
        ("least-squares", {"budget": 0}, "budget = 0; expected"),
        ("nelder-mead", {"budget": 0}, "budget = 0; expected"),
        ("cma", {"population": 2}, "population = 2; expected a whole number, 3 or more"),
        ("cma", {"generations": 0}, "generations = 0; expected"),
        ("cma", {"width": 0.0}, "width = 0.0; expected a part of the bounds"),
        ("cma", {"tolerance": 2.0}, "tolerance = 2.0; expected a part of the bounds"),
    ],
)
def test_an_option_that_makes_no_sense_is_told(name, options, message):
    with pytest.raises(InputError, match=message):
        search(name, **options)


def test_an_unknown_optimiser_is_told_with_the_nearest_name():
    with pytest.raises(InputError, match="unknown optimiser 'genetics': did you mean genetic"):
        optimiser_from_name("genetics")
    with pytest.raises(InputError, match=r"unknown optimiser 'zzz'; the known ones are .*least-squares"):
        optimiser_from_name("zzz")


# --- functions as generators -----------------------------------------------------------------------


def test_an_error_in_the_function_reaches_the_loop():
    def run(evaluate):
        evaluate(np.zeros((2, 1)))
        raise ZeroDivisionError("in the optimiser")

    with pytest.raises(ZeroDivisionError, match="in the optimiser"):
        minimise(lambda x: Evaluation(x, 0.0), as_generator(run))


def test_closing_the_generator_ends_a_function_that_catches_every_exception():
    ended = threading.Event()

    def run(evaluate):
        try:
            while True:
                try:
                    evaluate(np.zeros((1, 1)))
                except Exception:
                    continue
        finally:
            ended.set()

    generator = as_generator(run)
    next(generator)
    generator.close()
    assert ended.is_set()


# --- the genetic algorithm -------------------------------------------------------------------------


@pytest.mark.parametrize("evaluate", [bowl, valley, lambda x: Evaluation(x, 1.0)], ids=["bowl", "valley", "plateau"])
def test_the_papers_ga_makes_exactly_520_evaluations(evaluate):
    batches = []
    result = search("genetic", evaluate, log=lambda batch: batches.append(len(batch)))
    assert result.evaluations == 520
    assert batches == [20] * 26


@pytest.mark.parametrize(("seed", "options", "third_or_so", "last", "total"), [
    (1, {}, [0.8781922837499921, 0.9229730064317583], [0.8642044658040685, 0.9142094750689085], 149.44103503631635),
    (2, {"population": 7, "crossover": 0.9, "mutation": 0.3}, [0.9602758832970506, 0.9121150219576478],
     [0.83115089210833, 0.9140240881538668], 63.65898257837943),
])  # fmt: skip
def test_the_genetic_algorithm_breeds_what_pymoo_bred(seed, options, third_or_so, last, total):
    # Recorded with pymoo 0.6.2, which did it before: its GA of SBX (0.5, 1.0, 0), PM (1.0, 0.01) and one elite.
    trail, _ = recorded("genetic", valley, seed=seed, **options)
    assert trail[60].point == pytest.approx(third_or_so, rel=1e-12)
    assert trail[-1].point == pytest.approx(last, rel=1e-12)
    assert sum(e.cost for e in trail) == pytest.approx(total, rel=1e-12)


def test_the_best_of_the_parents_never_gets_lost():
    # Bred without crossover or mutation, the best point of the first generation is there in every later herd's reach.
    trail, result = recorded("genetic", valley, crossover=0.0, mutation=0.0)
    first = {tuple(e.point) for e in trail[:20]}
    assert {tuple(e.point) for e in trail[20:]} <= first
    assert result.best.cost == min(e.cost for e in trail[:20])


def test_the_crossover_rate_is_per_pair_and_takes_all_its_genes():
    copied = []
    for seed in range(40):
        trail, _ = recorded("genetic", valley, seed=seed, mutation=0.0, generations=1)
        points = np.array([e.point for e in trail])
        genes = np.column_stack([np.isin(points[20:, i], points[:20, i]) for i in range(2)])
        np.testing.assert_array_equal(genes[:, 0], genes[:, 1])
        np.testing.assert_array_equal(genes[:10], genes[10:])  # children i and i + 10 have the same parents
        copied += genes[:10, 0].tolist()
    assert 0.44 < np.mean(copied) < 0.6  # half of the pairs, and the few that are one parent twice; 400 pairs


def test_the_mutation_rate_is_per_gene():
    changed = []
    for seed in range(40):
        trail, _ = recorded("genetic", valley, seed=seed, crossover=0.0, mutation=0.3, generations=1)
        genes = np.array([e.point for e in trail])
        changed += [~np.isin(genes[20:, i], genes[:20, i]) for i in range(2)]
    assert abs(np.mean(changed) - 0.3) < 0.04  # three standard errors of 1600 genes


def distances(points):
    return np.linalg.norm(np.array(points) - TRUTH, axis=1)


def best_of_random_points(evaluate, seed):
    points = np.random.default_rng(seed).uniform(0.5, 1.2, (520, 2))
    return min(points, key=lambda x: evaluate(x).cost)


@pytest.mark.broad
@pytest.mark.parametrize(("evaluate", "wins"), [(valley, True), (narrow, False)], ids=["valley", "narrow"])
def test_against_random_points_the_ga_is_as_good_as_its_docstring_says(evaluate, wins):
    bred = distances([search("genetic", evaluate, seed=s).best.point for s in range(30)])
    drawn = distances([best_of_random_points(evaluate, s) for s in range(30)])
    assert (np.median(bred) < 0.5 * np.median(drawn)) == wins
    assert np.quantile(bred, 0.9) > 5 * np.median(bred) or not wins  # the unlucky tenth


# --- least squares ---------------------------------------------------------------------------------


def test_the_points_of_a_jacobian_are_one_batch():
    batches = []
    result = search("least-squares", log=lambda batch: batches.append(len(batch)))
    assert batches[:2] == [1, 2]
    assert result.evaluations < 30


def test_a_banana_is_solved_to_the_last_digits():
    space = Space(("x", "y"), np.full(2, -3.0), np.full(2, 3.0), np.array([-1.2, 1.0]))
    result = search("least-squares", squares(lambda x: np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]])), space=space)
    np.testing.assert_allclose(result.best.point, [1.0, 1.0], atol=1e-8)


def test_a_trial_step_that_fails_is_taken_back():
    # Newton on atan overshoots: from 3 it would go beyond 0, where every run fails.
    space = Space(("x",), np.array([-10.0]), np.array([10.0]), np.array([3.0]))
    trail, result = recorded("least-squares", squares(lambda x: None if x[0] < 0.5 else np.arctan(x - 1)), space=space)
    assert any(e.cost == np.inf for e in trail)
    assert abs(result.best.point[0] - 1) < 1e-6
    assert result.outcome is Outcome.CONVERGED


@pytest.mark.parametrize("start", [0.1, 0.2, 0.3, 0.4, 0.6])
def test_a_search_that_failing_runs_stopped_begins_again_with_a_wide_region(start):
    # Before the wall each step that is twice as wide fails, until it is called converged there.
    space = Space(("x",), np.zeros(1), np.full(1, 9.0), np.full(1, start))
    walled = squares(lambda x: None if 1 < x[0] < 1.6 else x - 1.9)
    result = search("least-squares", walled, space=space, tolerance=1e-3)
    assert abs(result.best.point[0] - 1.9) < 1e-5
    assert result.outcome is Outcome.CONVERGED


def test_a_search_that_cannot_begin_again_where_it_ended_has_converged():
    # Next to a cliff SciPy's move of a start off its bounds may be enough: here what was left is closed for good.
    space, seen = Space(("x", "y"), np.zeros(2), np.full(2, 9.0), np.array([0.3, 1.0])), []

    def walled(x):
        if x[0] > 1 or any(np.array_equal(x, s) for s in seen):
            return None
        if all(np.abs(x - s).max() > 2e-6 for s in seen):  # no end of a difference
            seen.append(x)
        return np.array([x[0] - 1.9, x[1] - 1.01])

    result = search("least-squares", squares(walled), space=space, tolerance=1e-3)
    assert result.outcome is Outcome.CONVERGED
    assert 0.9 < result.best.point[0] <= 1


@pytest.mark.parametrize("start", [0.0, 1e-12, 1e-9, 1e-6, 1e-3, 1.0])
def test_a_search_from_zero_or_from_a_bound_gets_as_far_as_any_other(start):
    # With the unknowns unscaled SciPy called a step of 1e-10 converged.
    space = Space(("coulomb", "drag"), np.zeros(2), np.ones(2), np.full(2, start))
    evaluate = squares(lambda x: np.array([x[0] - 0.3, x[1] - 0.7, 0.1]))
    result = search("least-squares", evaluate, space=space)
    np.testing.assert_allclose(result.best.point, [0.3, 0.7], atol=1e-6)
    assert result.evaluations < 60


def test_unknowns_of_very_different_size_are_found_as_well():
    truth = np.array([1e-7, 2.0, 3e6])
    space = Space(("a", "b", "c"), np.zeros(3), 10 * truth, 2 * truth)
    result = search("least-squares", squares(lambda x: np.exp(x / truth) - np.e), space=space)
    np.testing.assert_allclose(result.best.point, truth, rtol=1e-7)


@pytest.mark.parametrize("size", [1e-21, 1e-12, 1.0, 1e9])
def test_least_squares_begins_at_its_start_in_any_unit(size):
    """SciPy moves a start that is within 1e-10 of a bound, an absolute number: all picofarads are."""
    space = Space(("C",), np.array([size]), np.array([1e3 * size]), np.array([22 * size]))
    trail, found = recorded("least-squares", squares(lambda x: x / size - 100), space=space)
    assert trail[0].point[0] == 22 * size
    assert found.best.point[0] == pytest.approx(100 * size, rel=1e-6)


@pytest.mark.parametrize("size", [1e-12, 1.0, 1e9])
def test_least_squares_takes_the_same_steps_in_any_unit(size):
    """A step was small beside the largest unknown, in whatever unit that was."""
    units = np.array([size, 1e3])
    space = Space(("C", "R"), 1e-2 * units, 1e2 * units, units)
    trail, _ = recorded("least-squares", squares(lambda x: np.exp(x / units / 3) - [3.0, 2.0]), space=space)
    first, _ = recorded("least-squares", squares(lambda x: np.exp(x / 3) - [3.0, 2.0]),
                        space=Space(("C", "R"), np.full(2, 1e-2), np.full(2, 1e2), np.ones(2)))  # fmt: skip
    np.testing.assert_allclose([e.point / units for e in trail], [e.point for e in first], rtol=1e-6)


def test_a_budget_that_is_spent_is_said():
    assert search("least-squares", valley_with_rows, budget=2).outcome is Outcome.BUDGET_SPENT
    assert search("nelder-mead", valley_with_rows, budget=20).outcome is Outcome.BUDGET_SPENT
    assert search("nelder-mead", valley_with_rows, budget=20).evaluations == 20


@pytest.mark.parametrize("name", ["least-squares", "multistart"])
def test_a_cost_without_residuals_is_told_what_to_type(name):
    with pytest.raises(InputError, match=r"no residuals for least squares: type optimiser = 'differential-evolution'"):
        search(name, valley)


@pytest.mark.parametrize("evaluate", [valley, narrow])
def test_cma_comes_down_a_narrow_valley_in_fewer_runs_than_differential_evolution(evaluate):
    runs = {name: [search(name, evaluate, seed=seed) for seed in (1, 2)] for name in ("cma", "differential-evolution")}
    assert max(distances([r.best.point for r in runs["cma"]])) < 1e-5
    counts = {name: sum(r.evaluations for r in results) for name, results in runs.items()}
    assert counts["cma"] < 0.7 * counts["differential-evolution"]


def test_cma_ends_after_the_generations_that_it_was_given():
    result = search("cma", valley, generations=3, population=7)
    assert (result.outcome, result.evaluations) == (Outcome.GENERATIONS_DONE, 21)


@pytest.mark.parametrize("name", ["nelder-mead", "differential-evolution", "cma"])
def test_a_cost_without_residuals_has_its_optimisers(name):
    assert distances([search(name, valley).best.point])[0] < 1e-3


@pytest.mark.parametrize("starts", [1, 2, 3, 8])
def test_multistart_begins_at_the_start_and_makes_as_many_as_asked(starts):
    trail, _ = recorded("multistart", squares(lambda x: None), starts=starts)
    assert trail[0].point.tolist() == SPACE.start.tolist()
    assert len({tuple(e.point) for e in trail}) == starts


def test_a_scale_takes_the_place_of_what_start_and_bounds_tell():
    space = Space(("a", "b"), np.zeros(2), np.ones(2), np.array([0.0, 0.5]))
    assert space.typical.tolist() == [0.01, 0.5]
    assert replace(space, scale=np.array([1e-4, np.nan])).typical.tolist() == [1e-4, 0.5]


def test_a_constant_that_ends_at_zero_has_the_size_of_its_start_in_any_unit():
    """A stiffness that began at 0.7 GPa had 0.01 Pa for its size at 0, and a standard error of rounding."""
    space = Space(("b", "E"), np.zeros(2), np.array([10.0, 9e9]), np.array([0.0, 0.7e9]))
    assert space.sizes(np.zeros(2)).tolist() == [0.01, 0.7e7]
    assert space.sizes(np.array([2.0, 1e9])).tolist() == [2.0, 1e9]


def test_least_squares_stops_where_no_unknown_changes_anything():
    found = minimise(lambda x: Evaluation(x, 1.0, np.array([1.0, 0.0])), least_squares(SPACE, None))
    assert found.outcome is Outcome.CONVERGED
    assert found.best.point.tolist() == SPACE.start.tolist()


def test_least_squares_stops_at_a_start_that_fits_to_the_last_bit():
    found = minimise(lambda x: Evaluation(x, 0.0, np.append(x - SPACE.start, 0.0)), least_squares(SPACE, None))
    assert (found.outcome, found.best.point.tolist()) == (Outcome.CONVERGED, SPACE.start.tolist())


# --- what is held -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("blocks", [None, Blocks(np.array([-1, 0, 1]), np.array([0, 2, 4]))])
def test_an_unknown_that_is_held_stays_at_its_start_and_is_never_moved(blocks):
    asked = []

    def evaluate(x):
        asked.append(x.copy())
        r = np.array([x[0] - 1, x[1] - 2, x[0] + x[1] - 3, x[2] - 5])
        return Evaluation(x, float(r @ r), r)

    held = np.array([False, False, True])
    space = Space(("a", "b", "c"), np.zeros(3), np.full(3, 9.0), np.array([4.0, 4.0, 0.0]), blocks=blocks, held=held)
    best = minimise(evaluate, least_squares(space, None)).best
    assert {x[2] for x in asked} == {0.0}
    np.testing.assert_allclose(best.point, [1.0, 2.0, 0.0], atol=1e-6)


@pytest.mark.parametrize("search", [least_squares, nelder_mead])
def test_what_is_held_changes_no_step_of_the_rest(search):
    asked = {2: [], 3: []}

    def evaluate(x):
        asked[len(x)].append(x[:2].tolist())
        r = np.array([10 * (x[1] - x[0] ** 2), 1 - x[0], 0.1 * (x[0] + x[1])])
        return Evaluation(x, float(r @ r), r)

    for n in asked:
        held = None if n == 2 else np.array([False, False, True])
        space = Space(tuple("abc"[:n]), np.full(n, -9.0), np.full(n, 9.0), np.array([-1.2, 1.0, 5.0])[:n], held=held)
        minimise(evaluate, search(space, None))
    assert asked[2] == asked[3]
    assert len(asked[2]) > 20


@pytest.mark.parametrize("search", [least_squares, nelder_mead])
def test_a_space_that_is_held_altogether_is_at_its_minimum(search):
    space = replace(SPACE, held=np.array([True, True]))
    found = minimise(bowl, search(space, None))
    assert found.best.point.tolist() == SPACE.start.tolist()
    assert found.outcome is Outcome.CONVERGED


@pytest.mark.parametrize(("lower", "upper"), [(0.08, 0.28), (-0.9125990569846123, -0.8125990569846123), (0.96, 1.16)])
def test_a_population_begins_at_a_bound_too(lower, upper):
    for start in (lower, upper):
        space = Space(("a",), np.array([lower]), np.array([upper]), np.array([start]))
        search = OPTIMISERS["differential-evolution"].function(space, np.random.default_rng(1), generations=2)
        assert lower <= minimise(lambda x: Evaluation(x, float(x[0] ** 2)), search).best.point[0] <= upper


def test_a_cost_whose_square_is_no_number_is_a_run_that_failed():
    space = Space(("a",), np.array([0.0]), np.array([9.0]), np.array([1.0]))
    search = OPTIMISERS["least-squares"].function(space, None)
    end = minimise(lambda x: Evaluation(x, 1e199, np.full(3, 1e199)), search)
    assert end.outcome is Outcome.ALL_FAILED
    assert end.best.reason == "the cost is 1e+199"
