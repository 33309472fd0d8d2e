"""Many starts: where they come from, what is left and why, and that the best is never worse than one start's."""

import json
from dataclasses import replace

import numpy as np
import pytest

import fracid
from fracid.errors import InputError
from fracid.estimation import horizons as horizons_of_fits
from fracid.estimation.climbing import by_windows, climbed, embedded, in_turn
from fracid.estimation.derivatives import jacobian
from fracid.estimation.horizons import Watch, growing, horizons, minimised, refined
from fracid.estimation.search import _regression_start, search
from fracid.estimation.starts import Start, final_cost, won
from fracid.experiments.alternatives import rivals_of
from fracid.experiments.choice import subject_of
from fracid.identification import identify
from fracid.optimise import (
    OPTIMISERS,
    Evaluation,
    Outcome,
    Path,
    Space,
    least_squares,
    lockstep,
    minimise,
    sobol_points,
)
from fracid.plots import waterfall
from fracid.problem import Experiment, Free, Problem
from fracid.problem.costs import cost_from_name
from fracid.selection.amplitude import amplitude_test
from fracid.tasks.journal import Journal
from program import no_rivals
from twins import release

pytestmark = pytest.mark.usefixtures("without_rivals")

MULTISTART = OPTIMISERS["multistart"]
RIG = fracid.rotary_pendulum("srv02-rotpen")
TRUE = {"coulomb_theta": 1e-2, "coulomb_alpha": 3e-4, "b_theta": 5e-3, "b_alpha": 2e-4}
WIDE = {
    "C1": Free(6e-3, 1e-3, 2e-2),
    "b_theta": Free(2.4e-3, -1.0, 1.0),
    "b_alpha": Free(2e-4, -1e-2, 1e-2),
    "coulomb_theta": Free(1e-3, 0.0, 0.1),
    "coulomb_alpha": Free(1e-4, 0.0, 1e-2),
}


def swing(end=4.0):
    return release(orders={"lambda": 0.97, "mu": 0.98}, parameters=TRUE, alpha=1.2, step=4e-3, end=end, noise=1e-3,
                   known=False)  # fmt: skip


def stiff(twin=None, **options):
    """Constants with friction, from bounds as wide as ignorance."""
    free = {"orders": {"lambda": Free(1.0, 0.6, 1.2), "mu": Free(1.0, 0.6, 1.2)}, "parameters": WIDE}
    return Problem(RIG, (twin or swing(),), **free | options)


SWINGS = Problem(RIG, (swing(end=8.0),), {"lambda": 1.0, "mu": Free(1.0, 0.6, 1.2)}, initial_state="held")


@pytest.fixture(scope="module")
def eight():
    with no_rivals():
        return identify(stiff(), starts=8, jobs=2)


# --- the starts -----------------------------------------------------------------------------------------


@pytest.mark.broad
def test_the_starts_are_the_given_one_the_regressions_and_sobol_points(eight):
    kinds = [s.origin.split()[0] for s in eight.starts]
    assert kinds == ["given", "regression", *["Sobol"] * 6]
    assert eight.starts[0].point == eight.problem.named(eight.problem.start)
    assert eight.starts[1].first_cost < eight.starts[0].first_cost  # what a regression is for
    sobol = [s.first_cost for s in eight.starts[2:]]
    assert sobol == sorted(sobol)


@pytest.mark.broad
def test_initial_states_stay_as_measured(eight):
    names = [u.name for u in eight.problem.unknowns if u.kind == "initial"]
    assert len(names) == 4
    begin = eight.problem.named(eight.problem.start)
    for start in eight.starts:
        assert all(start.point[n] == begin[n] for n in names)


@pytest.mark.broad
def test_most_starts_of_a_stiff_problem_come_to_the_truth(eight):
    assert eight.recordings["twin"].rmse["alpha"] == pytest.approx(1e-3, rel=0.1)
    costs = [final_cost(s, eight.starts) for s in eight.starts]
    assert sum(c is not None and c < 1.01 * eight.cost for c in costs) >= 4
    for name, true in TRUE.items():
        low, high = eight.parameters[name].interval95
        assert low - (high - low) < true < high + (high - low)


@pytest.mark.broad
def test_what_became_of_each_start_is_in_the_result(eight):
    content = json.loads(json.dumps(eight.to_json(), allow_nan=False))
    assert len(content["starts"]) == 8
    assert content["start_that_won"] == won(eight.starts).origin
    assert sum(s["evaluations"] for s in content["starts"]) < content["evaluations"]  # and the scoring of candidates
    for start in content["starts"]:
        assert set(start["start"]) == set(start["end"]) == set(eight.problem.names)
        assert (start["cost"] is None) == start["ended"].startswith("left after ")
        assert (start["joined"] is None) or start["cost"] is None
    assert won(eight.starts).cost == eight.cost


@pytest.mark.broad
def test_the_result_is_the_same_for_any_number_of_threads():
    p = stiff(swing(end=2.0), parameters={"C1": WIDE["C1"]})
    one, three = (identify(p, starts=4, jobs=jobs) for jobs in (1, 3))
    assert json.dumps(one.to_json()) == json.dumps(three.to_json())


@pytest.mark.broad
def test_the_seed_decides_the_sobol_points():
    p = stiff(swing(end=1.0), parameters={})
    points = [[s.point for s in search(p, MULTISTART, np.random.default_rng(seed), starts=4)[1]]
              for seed in (1, 1, 2)]  # fmt: skip
    assert points[0] == points[1] != points[2]


@pytest.mark.broad
@pytest.mark.parametrize("starts", [2, 4])
def test_many_starts_never_end_above_one(starts):
    p = stiff(swing(end=2.0), parameters={"C1": WIDE["C1"], "coulomb_theta": WIDE["coulomb_theta"]})
    one = search(p, MULTISTART, np.random.default_rng(1))[0]
    assert search(p, MULTISTART, np.random.default_rng(1), starts=starts)[0].best.cost <= one.best.cost


def test_a_record_too_short_for_a_horizon_has_many_starts_too():
    late = replace(swing(1.0), release_time=Free(0.1, 0.0, 0.5))  # the release may lie in the middle of it
    short = stiff(late, parameters={}, initial_state="held")
    assert not [*horizons(short)]
    _, made = search(short, OPTIMISERS["multistart"], np.random.default_rng(1), starts=3)
    assert len(made) >= 3


def test_what_no_quantity_has_is_not_regressed():
    twin = swing()
    huge = replace(twin, measured=1e99 * twin.measured)
    assert [origin for origin, _ in _regression_start(stiff(huge))] == []


def test_where_the_regression_does_not_apply_sobol_points_take_its_place():
    p = stiff(swing(end=2.0), parameters={"slip_speed": Free(0.05, 1e-3, 1.0)})  # not in the regression
    made = search(p, MULTISTART, np.random.default_rng(1), starts=3)[1]
    assert [s.origin.split()[0] for s in made] == ["given", "Sobol", "Sobol"]


@pytest.mark.broad
def test_ctrl_c_among_many_starts_keeps_the_best_so_far():
    p, calls = stiff(swing(end=3.0)), []

    def callback(best, n):
        calls.append(n)
        if n > 150:
            raise KeyboardInterrupt

    result, made = search(p, MULTISTART, np.random.default_rng(1), starts=4, watch=Watch(callback=callback))
    assert result.interrupted
    assert result.best.cost == p.cost(result.best.point) < p.cost(p.start)
    assert len(made) == 4
    assert all(s.cost is None for s in made)


@pytest.mark.broad
def test_an_interruption_of_any_search_ends_what_is_made_of_several(monkeypatch):
    """Half of a search is no start for the next one, nor a result."""
    told = []

    def cut_short(problem, optimiser, watch, part=""):
        told.append(part)
        return replace(minimised(problem, optimiser, watch, part), outcome=Outcome.INTERRUPTED)

    monkeypatch.setattr(horizons_of_fits, "minimised", cut_short)
    presliding = replace(SWINGS, parameters={"presliding_theta": Free(1e-3, 0.0, 0.1)})
    candidates = fracid.DesignSpace(release=30, seconds=2, rate=100)
    subject = subject_of(fracid.rotary_pendulum("stepper-freeswing"), candidates, orders={"mu": 0.95})
    for of_several in (
        lambda: climbed(presliding, Watch()),
        lambda: by_windows(replace(presliding, initial_state="estimate"), Watch()),
        lambda: rivals_of(subject, candidates.candidates),
        lambda: amplitude_test(SWINGS, SWINGS.start),
    ):
        told.clear()
        with pytest.raises(KeyboardInterrupt):
            of_several()
        assert len(told) == 1


def test_every_start_that_fails_has_its_reason():
    p = stiff(swing(end=2.0), parameters={"C3": 0.1})
    result, made = search(p, MULTISTART, np.random.default_rng(1), starts=3)
    assert result.outcome is Outcome.ALL_FAILED
    assert made[0].ended == "every run failed"
    assert won(made).cost == np.inf


def dead_band(t, x, u, p, out):
    v = u[0]
    drive = v - p[2] if v > p[2] else (v + p[2] if v < -p[2] else 0.0)
    out[0] = x[1]
    out[1] = -p[0] * x[1] + p[1] * drive


def motor_with_a_dead_band(standstill):
    """Stairs of both signs after a standstill."""
    ranges = {"a": (8.0, 0.0, 200.0), "g": (60.0, 0.0, 5000.0), "d": (1.2, 0.0, 10.0)}
    model = fracid.Model(
        name="dead", rhs=dead_band, states=("th", "w"), orders=(1.0, 1.0), outputs={"angle": 0}, inputs=("u",),
        parameters=tuple(fracid.Parameter(n, "1", *v[:1], n, lower=0.0) for n, v in ranges.items()), zero="", source="",
    )  # fmt: skip
    t = np.arange(0, standstill + 9, 0.005)
    stairs = np.array([3.0, 0.0, -5.0, 0.0, 1.5, 0.0, -2.2, 6.0, 0.0])
    u = np.where(t < standstill, 0.0, stairs[np.clip((t - standstill + 1e-9).astype(int), 0, 8)])[:, None]
    run = fracid.simulate(model, initial={}, step=0.005, end=t[-1], inputs=u, orders={})
    noise = 1e-3 * np.random.default_rng(3).standard_normal(len(run.states))
    e = Experiment("m", 0.005, run.states[:, [0]] + noise[:, None], u[: len(noise)], between={"u": "line"})
    starts = {"a": 3.0, "g": 20.0, "d": 6.5}
    parameters = {n: Free(starts[n], *v[1:]) for n, v in ranges.items()}
    return Problem(model, (e,), {}, parameters, initial_state="rest")


@pytest.mark.broad
@pytest.mark.few(1)
@pytest.mark.parametrize("standstill", [0.1, 1.0])
def test_starts_are_told_apart_though_nothing_moves_at_first(standstill):
    p = motor_with_a_dead_band(standstill)
    assert next(horizons(p)) > standstill
    result, made = search(p, MULTISTART, np.random.default_rng(1), starts=16)
    assert dict(zip(p.names[:3], result.best.point, strict=False)) == pytest.approx(
        {"a": 8.0, "g": 60.0, "d": 1.2}, rel=5e-3
    )
    assert all(s.evaluations > 1 for s in made)


def escaping(t, x, u, p, out):
    out[0] = -p[0] * x[0] + p[1] * x[0] ** 3


def escaping_model():
    """x' = −a x + b x³, which escapes in finite time from 1 where b > a."""
    return fracid.Model(
        name="escaping", rhs=escaping, states=("x",), orders=(1.0,), outputs={"x": 0}, inputs=(), zero="", source="",
        parameters=(fracid.Parameter("a", "1/s", 1.0, ""), fracid.Parameter("b", "1/s", 0.2, "")),
    )  # fmt: skip


def test_a_start_that_a_short_horizon_leads_to_where_runs_fail_goes_on_from_where_it_began():
    t = 0.02 * np.arange(201)
    rises_at_first = np.where(t < 0.3, 1 + 3 * t, 1.9 * np.exp(0.3 - t))[:, None]
    e = Experiment("x", 0.02, rises_at_first, np.zeros((1, 0)))
    free = {"a": Free(1.0, 0.0, 3.0), "b": Free(0.9, 0.0, 60.0)}
    p = Problem(escaping_model(), (e,), {}, free, initial_state="held")
    result, (start,) = search(p, MULTISTART, np.random.default_rng(1))
    assert result.outcome is Outcome.CONVERGED
    assert (start.origin, start.cost) == ("given", result.best.cost)
    assert result.best.cost < p.cost(p.start) < np.inf


def test_a_start_of_which_every_run_fails_gives_way_to_others():
    """Where one start was asked for, as by default."""
    model = escaping_model()
    run = fracid.simulate(model, orders={}, initial={"x": 1.0}, step=0.01, end=8.0)
    e = Experiment("x", 0.01, run.states, np.zeros((1, 0)))
    p = Problem(model, (e,), {}, {"a": Free(1.0, 0.0, 3.0), "b": Free(50.0, 0.0, 60.0)}, initial_state="held")
    result, made = search(p, MULTISTART, np.random.default_rng(1))
    assert made[0].ended == "every run failed"
    assert p.named(result.best.point) == pytest.approx({"a": 1.0, "b": 0.2}, abs=1e-3)


@pytest.mark.broad
def test_a_random_start_whose_run_fails_is_moved_and_not_lost():
    """From 1 on the first horizon, or on a later one."""
    model = escaping_model()
    run = fracid.simulate(model, orders={}, initial={"x": 1.0}, step=0.01, end=8.0)
    e = Experiment("x", 0.01, run.states, np.zeros((1, 0)))
    free = {"a": Free(1.0, 0.0, 3.0), "b": Free(0.9, 0.0, 60.0)}
    p = Problem(model, (e,), {}, free, initial_state="held")
    scored = sobol_points(p.space, 88, np.random.default_rng(1))
    assert np.mean([np.isinf(p.cost(x)) for x in scored]) > 0.6
    _, made = search(p, MULTISTART, np.random.default_rng(1), starts=12)
    assert len(made) == 12
    assert not [s.ended for s in made if "fails" in s.ended or "failed" in s.ended]


# --- all together ----------------------------------------------------------------------------------------

SPACE = Space(("a",), np.array([-9.0]), np.array([9.0]), np.array([1.0]))


def wells(x):
    """Minima near ±1, the left one lower."""
    r = np.array([x[0] ** 2 - 1, 0.3 * (x[0] + 1), 0.1])
    return Evaluation(x, float(r @ r), r)


def descents(*starts):
    return [least_squares(Space(("a",), SPACE.lower, SPACE.upper, np.array([a])), None) for a in starts]


def test_a_search_that_falls_into_anothers_minimum_is_left():
    paths = [Path() for _ in range(4)]
    found = minimise(wells, lockstep(descents(2.0, -3.0, 2.5, -4.0), paths))
    assert [p.joined is None for p in paths] == [True, True, False, False]
    assert (paths[2].joined, paths[3].joined) == (paths[0], paths[1])
    assert found.best.point[0] == pytest.approx(-1, abs=1e-4)
    assert found.evaluations == sum(p.evaluations for p in paths)
    assert all(paths[i].outcome is Outcome.CONVERGED for i in (0, 1))


def test_searches_that_have_not_come_down_are_not_the_same_minimum():
    """A plateau: residuals agree, and no search has found anything."""
    paths = [Path() for _ in range(3)]
    minimise(lambda x: Evaluation(x, 1.0, np.ones(3)), lockstep(descents(2.0, -3.0, 2.5), paths))
    assert [p.joined for p in paths] == [None, None, None]


def test_sobol_points_fill_bounds_by_decades_where_the_bounds_are_wide():
    space = Space(("b", "mu"), np.array([-1.0, 0.5]), np.array([1.0, 1.2]), np.array([0.002, 1.0]))
    points = sobol_points(space, 256, np.random.default_rng(1))
    assert np.all((space.lower <= points) & (points <= space.upper))
    size = np.abs(points[:, 0])
    assert all(np.count_nonzero((low < size) & (size < 10 * low)) > 20 for low in (1e-3, 1e-2, 1e-1))
    assert np.histogram(points[:, 1], 7, (0.5, 1.2))[0].min() > 25  # a narrow one evenly


# --- the waterfall -------------------------------------------------------------------------------------


def start(origin, cost, joined=None):
    return Start(origin, {}, 1.0, {}, cost, "in words", joined, 9)


FOUR = (start("given", 0.2), start("Sobol 1", None, "Sobol 2"), start("Sobol 2", 0.1), start("Sobol 7", None))


def test_a_waterfall_shows_every_start_once_by_its_final_cost():
    axes = waterfall(FOUR, cost_name="rmse").axes[0]
    drawn = {line.get_label(): line.get_xydata().tolist() for line in axes.get_lines() if line.get_marker() != "None"}
    assert drawn == {"given": [[3, 0.2]], "Sobol": [[2, 0.1]], "Sobol, left in another's minimum": [[1, 0.1]]}
    assert axes.get_title() == "2 of 4 starts at the lowest cost; 1 left for their cost"
    assert axes.get_ylabel() == "final RMSE [rad]"


def test_what_a_climb_came_to_is_drawn_and_written_as_a_start():
    climb = [start("given", 0.3), start("the simpler structure", 0.2), start("windows", 0.1)]
    drawn = [n for line in waterfall(climb).axes[0].get_lines() if not (n := line.get_label()).startswith("_")]
    assert drawn == [s.origin for s in climb]
    assert [Start.of_json(s.to_json()) for s in climb] == climb


def test_a_waterfall_of_which_nothing_arrived_is_still_a_figure():
    axes = waterfall([start("given", np.inf)]).axes[0]
    assert axes.get_title() == "0 of 1 starts at the lowest cost; 1 left for their cost"


def test_no_start_at_all_is_told():
    with pytest.raises(InputError, match="There is no start to draw"):
        waterfall([])


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("name", "options"),
    [("differential-evolution", {"generations": 2}), ("cma", {"generations": 2}), ("nelder-mead", {"budget": 12})],
)
def test_what_no_derivative_found_is_polished_by_least_squares(name, options):
    p = stiff(swing(end=2.0), parameters=TRUE, initial_state="held")
    rng = np.random.default_rng(1)
    polished, _ = search(p, OPTIMISERS[name], rng, options=options)
    best, _ = search(p, MULTISTART, rng)
    assert polished.best.cost == pytest.approx(best.best.cost, rel=1e-6)
    assert polished.best.point == pytest.approx(best.best.point, abs=1e-5)
    raw, _ = search(p, OPTIMISERS["genetic"], np.random.default_rng(1), options={"generations": 2})
    assert raw.best.cost > 1.001 * best.best.cost  # the paper's own keeps what it found


# --- starts that know nothing of each other ----------------------------------------------------------------


@pytest.mark.broad
def test_starts_on_processes_are_the_same_for_any_number_and_come_to_the_minimum_of_those_together(tmp_path):
    p = stiff(swing(end=2.0))
    found = {}
    for jobs in (1, 2):
        with Journal(tmp_path / f"{jobs}.jsonl", {}) as journal:
            result, made = search(p, MULTISTART, np.random.default_rng(1), starts=4, executor="processes",
                                  watch=Watch(jobs), journal=journal)  # fmt: skip
            assert list(journal.done) == [s.origin for s in made] or jobs == 2
        found[jobs] = result.best.cost, result.best.point.tolist(), [s.cost for s in made]
    assert found[1] == found[2]
    together, _ = search(p, MULTISTART, np.random.default_rng(1), starts=4)
    assert found[1][0] <= 1.001 * together.best.cost
    with Journal(tmp_path / "1.jsonl", {}) as journal:  # all of them are kept: nothing is done again
        again, _ = search(p, MULTISTART, np.random.default_rng(1), starts=4, executor="processes", journal=journal)
    assert again.best.point.tolist() == found[1][1]


def test_a_cost_of_ones_own_is_not_sent_to_other_processes(tmp_path):
    (tmp_path / "own.py").write_text("def mine(t, r):\n    return float(abs(r).max())\n", encoding="utf-8")
    p = stiff(swing(end=2.0), parameters=TRUE, cost_function=cost_from_name(f"{tmp_path / 'own.py'}:mine"))
    with pytest.raises(InputError, match=r"The cost 'mine' comes from a file of your own.*type --executor threads"):
        search(p, MULTISTART, np.random.default_rng(1), starts=2, executor="processes")


def test_the_least_of_sizes_is_no_higher_than_where_least_squares_lead():
    truth = {"coulomb_alpha": 1e-4, "b_alpha": 1e-4, "C3": 0.0}
    swing = release(orders={"lambda": 1.0, "mu": 1.0}, parameters=truth, alpha=0.7, step=2e-2, end=16.0, counts=True,
                    outputs=("alpha",))  # fmt: skip
    ranges = {"C1": Free(5e-3, 1e-3, 2e-2), "b_alpha": Free(3e-4, 0.0, 0.1), "coulomb_alpha": Free(2e-3, 0.0, 0.1)}
    squares = Problem(RIG.with_parameters(C3=0.0), (swing,), {"lambda": 1.0, "mu": Free(1.0, 0.6, 1.2)}, ranges,
                      outputs=("alpha",), initial_state="held")  # fmt: skip
    sizes = replace(squares, cost_function=cost_from_name("itae"))
    below = refined(sizes, growing(squares, squares.start, Watch()).best.point, Watch()).best.cost
    assert growing(sizes, sizes.start, Watch()).best.cost < below * (1 + 1e-3)  # was 42 % above


def test_the_first_horizon_holds_every_release():
    time = np.arange(300) * 0.01
    for when in (0.7, Free(0.4, 0.1, 0.7)):
        e = Experiment("late", 0.01, np.cos(20 * time)[:, None], np.zeros((1, 1)), release_time=when)
        problem = Problem(RIG, (e,), {"lambda": 1.0, "mu": Free(1.0, 0.5, 1.2)}, outputs=("alpha",),
                          initial_state="rest")  # fmt: skip
        lengths = [problem.until(horizon).experiments[0].time[-1] for horizon in horizons(problem)]
        assert min(lengths) >= 1.4


# --- elements that come in by a jump -------------------------------------------------------------------------

SPRINGS = {
    "coulomb_theta": Free(1e-2, 0.0, 0.1), "coulomb_alpha": Free(3e-4, 0.0, 1e-2),
    "presliding_theta": Free(1e-3, 0.0, 0.1), "presliding_damping_theta": Free(1e-3, 0.0, 0.1),
    "arm_stiffness": Free(50.0, 0.0, 1e3), "play_theta": Free(1e-3, 0.0, 0.1),
}  # fmt: skip


@pytest.mark.parametrize(
    ("off", "absent"),
    [
        ((), ()),
        (("presliding_theta",), ("presliding_theta", "presliding_damping_theta")),
        (("presliding_damping_theta", "coulomb_theta"), ()),
        (("arm_stiffness",), ("arm_stiffness",)),
        (("play_theta",), ("play_theta",)),
    ],
)
def test_an_element_that_is_off_and_comes_in_by_a_jump_is_absent_and_what_acts_only_with_it_too(off, absent):
    problem = stiff(parameters=SPRINGS)
    x = np.array([0.0 if n in off else v for n, v in zip(problem.names, problem.start, strict=True)])
    assert {n for n, gone in zip(problem.names, problem.absent(x), strict=True) if gone} == {*absent}


def test_a_search_from_a_joint_that_does_not_give_does_not_let_it_give_by_a_hair():
    problem = stiff(orders={"lambda": 1.0, "mu": Free(0.99, 0.6, 1.2)}, parameters={
        **{n: v.start for n, v in WIDE.items()}, "presliding_theta": Free(1e-3, 0.0, 0.1),
        "presliding_damping_theta": Free(1e-3, 0.0, 0.1),
    }, initial_state="held")  # fmt: skip
    x = np.array([0.99, 0.0, 0.0])
    best = refined(problem, x, Watch()).best
    assert best.point[1:].tolist() == [0.0, 0.0]
    assert best.cost < problem.cost(x)
    J = jacobian(problem, best.point, np.arange(3))[0]
    assert not J[..., 1:].any()
    assert J[..., 0].any()


@pytest.mark.broad
def test_the_start_of_a_motion_lies_in_a_curved_valley_that_is_left_by_finding_it_anew():
    values = {
        "torque_per_volt": 0.074, "b_angle": 0.02, "coulomb_angle": 0.049, "stiction_angle": 0.024,
        "stribeck_speed_angle": 0.3, "presliding_angle": 0.01, "presliding_damping_angle": 2.4e-3,
    }  # fmt: skip
    joint, noise, rng = fracid.model("joint", J=5e-3, gravity=0.0, **values), 3e-4, np.random.default_rng(5)
    t = np.arange(301) / 100
    swings = zip((0.3, 0.7, 1.1, 1.9, 3.1), rng.uniform(0, 2 * np.pi, 5), strict=True)
    voltage = np.where(t < 0.2, 0.0, 2 * sum(np.sin(2 * np.pi * f * t + phase) for f, phase in swings))
    u = np.column_stack([voltage * (n == "voltage") for n in joint.inputs])
    run = fracid.simulate(joint, initial={}, step=0.01, end=3.0, inputs=u, orders={"mu": 1.0})
    y = run.states[:, [0]] + noise * rng.standard_normal((301, 1))
    free = {n: Free(1.1 * v, 2e-4 * ("speed" in n), 20 * v) for n, v in values.items()}
    driven = Experiment("driven", 0.01, y, u, between={"voltage": "line"})
    p = Problem(joint, (driven,), {"mu": 1.0}, free, initial_state="estimate")
    wrong = {"angle(0) [driven]": -0.035, "rate(0) [driven]": 0.86, "z(0) [driven]": -0.86}
    x = embedded(p, values | wrong)
    assert refined(p, x, Watch(), budget=15).best.cost > 3 * noise
    assert in_turn(p, x, Watch(), budget=15).best.cost < 1.05 * noise
