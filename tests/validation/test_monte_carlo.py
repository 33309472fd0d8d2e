"""Studies: what a repetition reads and finds, what is made of many, and that intervals keep their word."""

import json
import pickle
import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

import fracid
from fracid.errors import InputError
from fracid.estimation.windows import windowed
from fracid.models import Model, Parameter
from fracid.plots import noise_levels
from fracid.problem import Experiment, Free, Problem
from fracid.problem.costs import COSTS, Cost
from fracid.solver.memory import compressed, full, short
from fracid.tasks.tasks import run_tasks
from fracid.twins.encoder import encoder, simulated
from fracid.validation.monte_carlo import (
    Cell,
    NoiseStudy,
    Statistics,
    binomial95,
    noise_study,
    planned,
    repetition,
)

RIG = fracid.rotary_pendulum("srv02-rotpen")
COUNT = 2 * np.pi / 4096
NOISE = np.radians(0.1)
TRUTH = np.array([0.9, 0.95])


def release(free=None, *, end=2.0, step=4e-3, rig=RIG, **options):
    """A release from 0.5 rad to be simulated; what is in the recording does not matter."""
    empty = np.full((round(end / step) + 1, 2), [0.0, 0.5])
    swing = Experiment("release", step, empty, np.zeros((1, 1)), initial={"theta": 0.0, "alpha": 0.5})
    orders = {"lambda": Free(1.0, 0.5, 1.2), "mu": Free(1.0, 0.5, 1.2)}
    return Problem(rig, (swing,), **{"orders": orders, "parameters": free or {}, "initial_state": "held",
                                     "substeps": 2} | options)  # fmt: skip


def study(problem=None, truth=TRUTH, **options):
    given = {"levels": [NOISE], "resolutions": [COUNT], "seeds": 4} | options
    return noise_study(problem or release(), truth, **given)


# --- intervals keep their word -------------------------------------------------------------------------


@pytest.mark.broad
def test_orders_and_friction_lie_in_their_intervals_as_often_as_these_say():
    # the smallest part of `make coverage`: one rig, dry friction in truth and model, initial angles free
    dry = {"coulomb_theta": 2e-3, "coulomb_alpha": 2.5e-4}
    free = {n: Free(0.5 * v, 0.0, 10 * v) for n, v in dry.items()}
    problem = release(free, initial_state="rest", rig=RIG.with_parameters(**dry))
    problem = replace(problem, experiments=(replace(problem.experiments[0], initial={}),))
    truth = [0.9, 0.95, *dry.values(), 0.0, 0.5]
    (cell,) = study(problem, np.array(truth), seeds=40).cells
    assert (cell.failed, cell.stopped_short) == (0, 0)
    # of 40 exact intervals less than 33 hold the truth with a probability of 0.05 %; there are 6 unknowns
    fewest = int(stats.binom.ppf(1e-3, 40, 0.95))
    assert fewest == 33
    for s in cell.unknowns.values():
        assert s.held >= fewest, s
        assert 0.7 < s.claimed / s.spread < 1.5
        assert abs(s.bias) < 4 * s.bias_error
    held, intervals = (sum(getattr(s, what) for s in cell.unknowns.values()) for what in ("held", "intervals"))
    assert 0.90 < held / intervals < 0.99


@pytest.mark.broad
@pytest.mark.parametrize(("orders", "called"), [((1.0, 1.0), 0), ((0.9, 0.95), 6)])
def test_integer_orders_are_not_called_fractional_and_fractional_ones_are(orders, called):
    (cell,) = study(truth=np.array(orders), seeds=6, rival=True).cells
    assert cell.fractional == called


def test_what_was_not_asked_is_not_counted():
    assert study(seeds=1).cells[0].fractional is None


# --- a repetition ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("resolution", [COUNT, 0.1])
def test_an_encoder_reads_whole_steps_from_an_edge_of_its_own(resolution):
    signal = np.column_stack([np.linspace(-1, 1, 4001)] * 2)
    y = encoder(signal, 0.0, resolution, np.random.default_rng(3))
    assert np.max(np.abs(y - signal)) <= resolution / 2 * (1 + 1e-9)
    steps = np.diff(y, axis=0) / resolution
    assert steps == pytest.approx(np.round(steps), abs=1e-6)
    edges = y[0] / resolution % 1
    assert abs(edges[0] - edges[1]) > 1e-3


def test_over_all_edges_a_reading_is_unbiased_and_scatters_by_noise_and_rounding():
    rng, at_rest = np.random.default_rng(1), np.full((1, 1), 0.02)
    y = np.array([encoder(at_rest, 0.01, 0.1, rng)[0, 0] for _ in range(20_000)])
    assert np.mean(y) == pytest.approx(0.02, abs=4 * 0.03 / np.sqrt(20_000))
    assert np.std(y) == pytest.approx(np.hypot(0.01, 0.1 / np.sqrt(12)), rel=0.03)


def test_without_rounding_there_is_noise_alone_and_without_both_nothing():
    signal = np.zeros((5000, 2))
    assert np.std(encoder(signal, 0.01, 0.0, np.random.default_rng(1))) == pytest.approx(0.01, rel=0.05)
    assert np.array_equal(encoder(signal, 0.0, 0.0, np.random.default_rng(1)), signal)


def test_the_truth_is_simulated_with_steps_of_its_own_by_the_second_order_method():
    problem = release(method="gl", substeps=1)
    twin = simulated(problem, TRUTH)
    exact = fracid.simulate(RIG, orders=[0.9, 0.9, 0.95, 0.95], initial={"alpha": 0.5}, step=5e-4, end=2.0)
    assert twin.experiments[0].measured == pytest.approx(exact.states[::8, [0, 2]], abs=2e-4)
    assert problem.cost(TRUTH) > 0.1  # of the empty recording
    assert twin.method == "gl"


@pytest.mark.broad
def test_a_repetition_is_its_own_whatever_else_the_study_holds():
    small, large = study(seeds=2), study(seeds=3, levels=[2 * NOISE, NOISE], resolutions=[0.0, COUNT])
    for key, found in small.repetitions.items():
        assert large.repetitions[key] == found
    first, second, *_ = small.repetitions.values()
    assert first["values"] != second["values"]
    assert study(seeds=2, seed=2).repetitions != small.repetitions


@pytest.mark.broad
def test_processes_and_threads_find_the_same_to_the_bit():
    threads, processes = (study(seeds=2, executor=name) for name in ("threads", "processes"))
    assert processes.repetitions == threads.repetitions
    assert processes.to_json() == threads.to_json()


@pytest.mark.few(8)
@pytest.mark.parametrize("cost", COSTS)
@pytest.mark.parametrize("memory", [compressed(), compressed(1e-8, lags=16), short(300), full()], ids=lambda m: m.name)
def test_a_problem_travels_with_every_cost_and_memory(cost, memory):
    problem = simulated(release(cost_function=COSTS[cost], memory=memory, end=1.0), TRUTH)
    carried = pickle.loads(pickle.dumps(problem))
    assert carried.cost(np.array([1.0, 0.9])) == problem.cost(np.array([1.0, 0.9]))
    assert (carried.cost_function.name, carried.memory.name) == (cost, memory.name)


# --- what is made of many ----------------------------------------------------------------------------------


def test_a_parameter_whose_interval_is_its_whole_range_has_no_interval_to_count():
    idle = {"theta_rest": Free(0.1, -1.0, 1.0), "cable_stiffness": Free(0.0, 0.0, 1e-9)}
    found = study(release(idle), np.array([*TRUTH, 0.1, 0.0]), seeds=2)
    (cell,) = found.cells
    names = ("theta_rest", "cable_stiffness")
    assert [(cell.unknowns[n].intervals, cell.unknowns[n].claimed) for n in names] == [(0, None)] * 2
    assert cell.unknowns["mu"].intervals == 2


def test_statistics_are_those_of_the_repetitions():
    found = study(seeds=5)
    values = np.array([r["values"]["mu"] for r in found.repetitions.values()])
    errors = np.array([r["standard_errors"]["mu"] for r in found.repetitions.values()])
    mu = found.cells[0].unknowns["mu"]
    assert mu.bias == pytest.approx(values.mean() - 0.95)
    assert mu.spread == pytest.approx(values.std(ddof=1))
    assert mu.claimed == pytest.approx(np.sqrt(np.mean(errors**2)))
    assert mu.held == np.sum(np.abs(values - 0.95) <= stats.norm.ppf(0.975) * errors)
    assert mu.coverage == mu.held / 5
    assert mu.coverage95 == pytest.approx(stats.binomtest(mu.held, 5).proportion_ci(method="exact"))


@pytest.mark.parametrize(("held", "trials"), [(0, 7), (7, 7), (3, 7), (47, 50), (1, 1)])
def test_binomial_limits_are_exact(held, trials):
    assert binomial95(held, trials) == pytest.approx(tuple(stats.binomtest(held, trials).proportion_ci(method="exact")))


@pytest.mark.broad
def test_noise_and_coarse_encoders_widen_what_is_claimed():
    found = study(levels=[0.0, NOISE, 4 * NOISE], resolutions=[2 * np.pi / 20_000, 2 * np.pi / 500], seeds=3)
    claimed = np.array([c.unknowns["mu"].claimed for c in found.cells]).reshape(3, 2)
    assert np.all(np.diff(claimed, axis=0) > 0)
    assert np.all(claimed[:2, 1] > claimed[:2, 0])  # beside strong noise it matters no more
    assert [cell.counts for cell in found.cells[:2]] == pytest.approx([20_000, 500])


@pytest.mark.broad
def test_a_coarse_step_is_a_bias_and_is_said_with_the_remedy():
    found = study(release(substeps=1, step=8e-3), seeds=25)
    mu = found.cells[0].unknowns["mu"]
    assert abs(mu.bias) > mu.spread
    (sentence,) = [s for s in found.sentences if s.startswith("mu: ") and "contain the true value" in s]
    assert "they are too narrow at 0.1° of noise, 4096 counts" in sentence
    assert "times its spread" in sentence
    assert "substeps = 2" in found.sentences[-1]
    assert 'initial_state = "rest"' in found.sentences[-1]


@pytest.mark.broad
def test_a_scheme_of_first_order_and_a_cost_that_rounding_biases_are_named():
    found = study(release(method="gl", cost_function=COSTS["itae"]), seeds=12)
    assert found.cells[0].unknowns["mu"].coverage < 0.2
    assert 'the scheme gl, of first order (type method = "pi2" in [fit])' in found.sentences[-1]
    assert "the cost itae, which rounding biases" in found.sentences[-1]


@pytest.mark.broad
def test_a_start_that_is_taken_as_measured_claims_too_little():
    problem = release()
    held = replace(problem, experiments=(replace(problem.experiments[0], initial={}),))
    found = study(held, seeds=25, levels=[4 * NOISE])
    mu = found.cells[0].unknowns["mu"]
    assert mu.spread > 1.4 * mu.claimed
    assert mu.coverage < 0.8
    (sentence,) = [s for s in found.sentences if s.startswith("mu: ") and "contain the true value" in s]
    assert "times the standard error" in sentence


def test_a_noisy_start_is_said_before_the_study_with_its_number_and_no_other_is():
    named = release({"b_alpha": Free(1e-3, 0.0, 1e-2)})
    held = replace(named, experiments=(replace(named.experiments[0], initial={}),))
    truth = [*TRUTH, 1e-3]
    (found,) = planned(held, np.array(truth), levels=[0.0, 4 * NOISE], seeds=1).findings
    assert (found.code, found.limit) == ("noisy-start", 1.0)
    assert found.number > 1
    assert "initial = {" in found.sentence
    told = study(held, truth, seeds=1, levels=[4 * NOISE])
    assert told.sentences[0].startswith(f"{found.where}: the start is taken from the first sample")
    assert told.to_json()["findings"][0]["code"] == "noisy-start"
    rest = replace(held, initial_state="rest")
    at_rest = np.array([*truth, 0.0, 0.5])
    for other, x in ((named, truth), (rest, at_rest)):
        assert planned(other, np.array(x), levels=[4 * NOISE], seeds=1).findings == ()
    assert planned(held, np.array(truth), levels=[0.0], seeds=1).findings == ()


@pytest.mark.broad
def test_intervals_that_keep_their_word_are_said_to():
    sentences = study(seeds=25).sentences
    assert len(sentences) == 2
    assert all(s.endswith("they can be believed.") for s in sentences)


def test_so_few_repetitions_say_little():
    assert all("too few" in s for s in study(seeds=3).sentences)


def test_exceptions_are_named_with_their_chance_and_the_others_together():
    problem = release({n: Free(1e-3, 0.0, 1e-2) for n in ("b_theta", "b_alpha", "coulomb_alpha")})
    held = dict(zip(problem.names, (2, 3, 4, 4, 4), strict=True))
    unknowns = {n: Statistics("", 1.0, 4, 0.0, 1.0, 1.0, 4, count) for n, count in held.items()}
    cell = Cell(NOISE, COUNT, 4, {}, 0, 9.0, None, unknowns)
    first, others = (
        NoiseStudy(truth=held, cost_name="rmse", optimiser="multistart", seeds=4, cells=(cell,)).concluded().sentences
    )
    assert first.startswith("lambda: 2 of 4 intervals")
    assert "by chance this happens in 1.4 % of studies" in first
    assert others.startswith("mu, b_theta, b_alpha, coulomb_alpha: 75 to 100 % of their intervals of 95 %")


def test_a_search_that_stops_short_of_the_truths_cost_is_counted():
    found = study(optimiser="least-squares", options={"budget": 1}, seeds=3)
    assert found.cells[0].stopped_short == 3
    assert "stopped short of its minimum in 3 of 3 repetitions" in found.sentences[0]


def explosive_rhs(t, x, u, p, out):
    out[0] = -x[0] if p[0] < 2.0 else 1e9


EXPLOSIVE = Model(
    name="explosive", rhs=explosive_rhs, states=("y",), orders=("q",), outputs={"y": 0}, inputs=(), zero="",
    parameters=(Parameter("a", "", 1.0, "no run from 2 on"),), source="a test",
)  # fmt: skip


def explosive(start):
    swing = Experiment("fall", 0.05, np.full((41, 1), 0.5), np.zeros((1, 0)), initial={"y": 0.5})
    return Problem(EXPLOSIVE, (swing,), {"q": Free(1.0, 0.5, 1.2)}, {"a": Free(start, 0.0, 4e6)}, outputs=("y",),
                   initial_state="held")  # fmt: skip


def test_a_repetition_that_finds_no_run_is_a_failure_with_its_reason():
    found = study(explosive(3.0), np.array([0.9, 1.0]), seeds=3)
    (cell,) = found.cells
    assert cell.failed == 3
    assert all("diverged" in reason for reason in cell.failures)
    assert cell.unknowns["q"].coverage is None
    assert "3 of 3 repetitions found nothing: fall: " in found.sentences[0]
    assert "q: no repetition gave an interval." in found.sentences
    json.dumps(found.to_json(), allow_nan=False)
    with pytest.raises(InputError, match="nothing to draw"):
        found.plot()


def test_a_cost_without_intervals_still_tells_bias_and_spread():
    own = Cost("largest", function=lambda time, residual: float(np.max(np.abs(residual))))
    found = study(release(cost_function=own, end=1.0), optimiser="nelder-mead", seeds=2)
    mu = found.cells[0].unknowns["mu"]
    assert mu.spread > 0
    assert (mu.claimed, mu.intervals) == (None, 0)


@pytest.mark.broad
def test_json_and_table_hold_every_cell_and_unknown():
    found = study(levels=[0.0, NOISE], resolutions=[0.0, COUNT], seeds=2)
    content = json.loads(json.dumps(found.to_json(), allow_nan=False))
    assert [cell["counts_per_turn"] for cell in content["cells"]] == [None, 4096, None, 4096]
    assert len(content["repetitions"]) == 8
    rows = found.lines()
    assert [(row["level"], row["unknown"]) for row in rows[:4]] == [(0.0, n) for n in ("lambda", "mu")] * 2
    assert all(list(row) == list(rows[0]) for row in rows)


@pytest.mark.broad
def test_several_plans_run_together_and_each_gathers_its_own():
    one, two = (planned(release(), t, levels=[NOISE], seeds=2) for t in (TRUTH, np.array([1.0, 1.0])))
    tasks = [replace(t, key=f"{name}: {t.key}") for name, plan in (("one", one), ("two", two)) for t in plan.tasks]
    found = run_tasks(repetition, tasks)
    for name, plan in (("one", one), ("two", two)):
        mine = plan.study({t.key: found[f"{name}: {t.key}"] for t in plan.tasks})
        assert mine.to_json() == plan.run().to_json()


def test_a_study_in_newtons_says_newtons_of_its_repetitions_and_of_what_is_refused():
    model = fracid.model("relaxation")
    e = Experiment("ramp", 0.1, np.zeros((80, 1)), np.linspace(0, 1, 80)[:, None] * [0.01, 0.0], units={"force": "N"})
    p = Problem(model, (e,), {"nu": Free(0.5, 0.1, 0.9)})
    plan = planned(p, p.start, levels=[5.0], seeds=1)
    assert [task.key for task in plan.tasks] == ["5 N of noise, no rounding, repetition 1"]
    with pytest.raises(InputError, match=r"level -1 N: expected a number from 0 on"):
        planned(p, p.start, levels=[-1], seeds=1)


# --- the figure ------------------------------------------------------------------------------------------------


@pytest.mark.broad
def test_the_figure_has_a_row_for_each_unknown_and_a_mark_for_each_cell():
    found = study(levels=[NOISE, 2 * NOISE], resolutions=[0.0, COUNT], seeds=2)
    figure = noise_levels(found)
    assert len(figure.axes) == 2 * 2
    left, right = figure.axes[:2]
    assert [t.get_text() for t in figure.axes[2].get_xticklabels()] == ["0.1", "0.2"]
    drawn = sorted(
        line.get_ydata()[0] for line in left.lines if line.get_marker() in "os" and len(line.get_ydata()) == 1
    )
    assert drawn == pytest.approx(sorted(c.unknowns["lambda"].bias for c in found.cells))
    shares = sorted(line.get_ydata()[0] for line in right.lines if line.get_marker() in "os")
    assert shares == pytest.approx(sorted(100 * c.unknowns["lambda"].coverage for c in found.cells))


# --- what cannot be --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"levels": []}, "There is no level; give at least one"),
        ({"levels": [-1e-3]}, "level -0.001 rad: expected a number from 0 to π"),
        ({"levels": [float("nan")]}, "level nan rad"),
        ({"resolutions": [4096]}, "resolution 4096 rad: expected a number from 0 to π, in radians"),
        ({"levels": [1e-3, 1e-3]}, "name one twice; give each once"),
        ({"seeds": 0}, "seeds"),
        ({"optimiser": "annealing"}, "annealing"),
        ({"cost": "rsme"}, "did you mean rmse"),
        ({"executor": "process"}, "There is no executor 'process'"),
        (
            {"truth": np.array([0.9])},
            "The truth has the shape .1,.; expected 2 finite numbers, one for each of lambda, mu",
        ),
        ({"truth": np.array([0.9, np.nan])}, "every value must be a finite number"),
        ({"truth": np.array([0.9, 1.4])}, "mu = 1.4 lies outside the bounds 0.5 … 1.2, so no search can find it"),
    ],
)
def test_what_cannot_be_is_refused_with_a_sentence(options, message):
    with pytest.raises(InputError, match=message):
        study(**options)


def test_a_truth_whose_run_fails_is_refused():
    with pytest.raises(InputError, match=r"The truth cannot be simulated: fall: .* at t = "):
        study(explosive(1.0), np.array([0.9, 3.0]))


def test_a_problem_with_nothing_free_is_refused():
    with pytest.raises(InputError, match="Nothing is free"):
        study(release(orders={"lambda": 1.0, "mu": 1.0}), np.empty(0))


def test_a_measured_past_is_refused_with_what_to_type():
    problem = release(initial_state="estimate")
    past = replace(problem.experiments[0], past=np.full((50, 2), 0.5), initial={})
    moving = replace(problem, experiments=(past,))
    with pytest.raises(InputError, match=r'starts with a measured past, .* leave out history = "measured"'):
        study(moving, np.append(TRUTH, np.zeros(len(moving.names) - 2)))


def test_windows_that_remember_are_refused_without_a_word_of_history():
    problem = release(initial_state="estimate")
    whole = replace(problem, experiments=tuple(replace(e, initial={}) for e in problem.experiments))
    windows = windowed(whole, 0.5)
    with pytest.raises(InputError, match=r'^release is fitted in windows, .* windows = "none" in \[fit\]\.$'):
        study(windows, windows.start)


def test_a_model_and_a_cost_of_ones_own_stay_in_this_process():
    own = Cost("largest", function=lambda time, residual: float(np.max(np.abs(residual))))
    with pytest.raises(InputError, match=r"largest comes from a file of your own.*type --executor threads"):
        study(release(cost_function=own), executor="processes")

    def rhs(t, x, u, p, out):
        out[0] = -p[0] * x[0]

    rhs.__module__ = "fracid_user_rig"
    sys.modules["fracid_user_rig"] = sys.modules[__name__]
    try:
        mine = replace(explosive(1.0), model=replace(EXPLOSIVE, rhs=rhs))
        with pytest.raises(InputError, match="explosive comes from a file of your own"):
            study(mine, np.array([0.9, 1.0]), executor="processes")
    finally:
        del sys.modules["fracid_user_rig"]
