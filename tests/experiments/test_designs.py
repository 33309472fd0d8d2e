"""Plans of experiments: what is chosen, what is predicted, what is written, what is refused."""

import json
import math
import re
from dataclasses import replace
from itertools import combinations_with_replacement

import numpy as np
import pytest

import fracid
from fracid.errors import InputError
from fracid.estimation.derivatives import jacobian
from fracid.experiments.alternatives import alternatives_of, orders_alone, rivals_of
from fracid.experiments.choice import informations, subject_of
from fracid.experiments.criteria import objective_named
from fracid.experiments.exchange import Criterion, exchange
from fracid.experiments.information import Information, Noise
from fracid.experiments.subject import subject_of_problem
from fracid.optimise import least_squares, minimise
from fracid.selection.integer_rival import freed_friction, integer_values
from fracid.twins.encoder import encoder, simulated
from fracid.workflows.planning import _as_recorded

RIG = fracid.rotary_pendulum("qube-servo2", coulomb_theta=1e-3, coulomb_alpha=1e-4)
FREE = ("lambda", "mu", "b_alpha", "coulomb_alpha")
ORDERS = {"lambda": 0.95, "mu": 0.97}
SPACE = fracid.DesignSpace(release=(10, 40, 80, 120), seconds=(2, 4), rate=100, moment=0)


@pytest.fixture(scope="module")
def plan():
    return fracid.design(RIG, SPACE, experiments=2, of=("lambda", "mu"), free=FREE, orders=ORDERS)


def joint(plan):
    """The plan's experiments as one problem, with the model's outputs for what is measured."""
    problems = [plan.subject.problem_of(c) for c in plan.experiments]
    problem = replace(problems[0], experiments=tuple(
        replace(p.experiments[0], name=f"{k}") for k, p in enumerate(problems)))  # fmt: skip
    return simulated(problem, problem.start, finer=1)


def read(problem, noise, rng):
    """The same problem with what encoders read."""
    twins = [replace(e, measured=np.column_stack([
        encoder(e.measured[:, [o]], noise[n].deviation, noise[n].step, rng)[:, 0] for o, n in
        enumerate(problem.outputs)])) for e in problem.experiments]  # fmt: skip
    return replace(problem, experiments=tuple(twins))


# --- what is predicted -------------------------------------------------------------------------------------


@pytest.mark.broad
def test_the_predicted_scatter_is_that_of_twins(plan):
    problem, rng = joint(plan), np.random.default_rng(1)
    J = np.concatenate([j.reshape(-1, len(problem.names))
                        for j in jacobian(problem, problem.start, np.arange(len(problem.names)))])  # fmt: skip
    size = np.linalg.norm(J, axis=0)
    solve = np.linalg.pinv(J / size) / size[:, None]
    estimates = np.array([
        solve @ np.concatenate([(e.measured - clean.measured).ravel() for e, clean in
                                zip(read(problem, plan.subject.noise, rng).experiments, problem.experiments,
                                    strict=True)]) for _ in range(800)
    ])  # fmt: skip
    for name in FREE:
        realised = estimates[:, problem.names.index(name)].std()
        assert realised == pytest.approx(plan.expected[name].standard_error, rel=0.1), name


def test_an_experiment_that_is_repeated_four_times_halves_the_interval():
    space = fracid.DesignSpace(release=80, seconds=4, rate=100)
    one, four = (fracid.design(RIG, space, experiments=n, free=FREE, orders=ORDERS) for n in (1, 4))
    for name in FREE:
        assert four.expected[name].standard_error == pytest.approx(one.expected[name].standard_error / 2, rel=1e-3)


def test_a_rest_tail_tells_nothing_about_friction():
    space = fracid.DesignSpace(release=40, seconds=(10, 40), rate=100, noise=0.0)
    subject = subject_of(RIG, space, free=FREE, orders=ORDERS)
    short, long = (t.covariance(subject.scale)[3, 3] for t in informations(subject, space.candidates))
    assert long > 0.9 * short  # white noise would promise a quarter


def test_what_is_recorded_already_counts(plan):
    problem = read(joint(plan), plan.subject.noise, np.random.default_rng(2))
    more = fracid.design(problem, SPACE, experiments=2, of=("mu",))
    for name in FREE:
        assert more.expected[name].standard_error_now == pytest.approx(plan.expected[name].standard_error, rel=0.35)
    gain = more.gain_over()
    assert set(gain) == set(FREE)
    assert gain["mu"] > 1.25


def test_correlated_residuals_count_as_their_effective_samples(plan):
    problem, rng = joint(plan), np.random.default_rng(3)
    slow = [replace(e, measured=e.measured + np.cumsum(1e-3 * rng.standard_normal(e.measured.shape), axis=0))
            for e in problem.experiments]  # fmt: skip
    subject = subject_of(replace(problem, experiments=tuple(slow)), SPACE)
    assert np.all(subject.excess >= 1.0)
    assert subject.excess.max() > 3.0
    assert all(n.step == 0.0 for n in subject.noise.values())


def test_a_clamped_arm_shows_no_lambda():
    space = fracid.DesignSpace(release=40, arm="clamped", seconds=2, rate=100)
    plan = fracid.design(RIG, space, experiments=1, free=FREE, orders=ORDERS)
    assert plan.expected["lambda"].interval95 is None
    assert "(not shown by this plan)" in plan.summary()
    assert plan.expected["mu"].interval95 is not None


# --- what is chosen ----------------------------------------------------------------------------------------


@pytest.mark.few(1)
@pytest.mark.parametrize("criterion", ["D", "A", "Ds"])
def test_exchange_finds_the_best_of_all_sets(plan, criterion):
    subject = plan.subject
    tables = informations(subject, SPACE.candidates)
    parts = np.array([t.curvature for t in tables]), np.array([t.scatter for t in tables])
    vague = np.diag((100 * subject.scale) ** -2.0)
    objective = objective_named(criterion, subject.scale, (0, 1))
    chosen = exchange([Criterion(objective, parts, (vague, vague))], 3)

    def value(at):
        return objective(tuple(vague + p[[*at]].sum(axis=0) for p in parts)).item()

    best = min(combinations_with_replacement(range(len(tables)), 3), key=value)
    assert value(chosen) == pytest.approx(value(best), rel=1e-9)


def test_what_exceeds_a_limit_is_excluded():
    space = replace(SPACE, limits={"alpha": np.radians(60)})
    plan = fracid.design(RIG, space, free=FREE)
    assert (plan.candidates, plan.excluded) == (4, 4)
    assert all(c.release < 60 for c in plan.experiments)
    speed = replace(SPACE, limits={"alpha_speed": 3.0})
    assert all(c.release == 10 for c in fracid.design(RIG, speed, free=FREE).experiments)


@pytest.mark.broad
def test_a_set_against_integer_orders_is_furthest_from_its_nearest_alternative():
    subject = subject_of(RIG, SPACE, free=FREE, orders=ORDERS)
    rigs = orders_alone(subject, SPACE.candidates, 2, of=())
    chosen = rigs.chosen(2)
    told = {pair: sum(math.log1p(d**2) for d in rigs.nearest(pair).values())
            for pair in combinations_with_replacement(rigs.allowed, 2)}  # fmt: skip
    assert told[chosen] == pytest.approx(max(told.values()), rel=1e-9)
    done = [SPACE.candidates[i] for i in chosen]
    table = alternatives_of(subject, done, range(len(done)), rivals_of(subject, done))
    assert {"friction", "drag", "a delay of alpha"} <= set(table.columns)
    every = table.distances([0, 1])
    assert all(d <= every["friction"] * (1 + 1e-9) for d in every.values())  # each may do what friction does


@pytest.mark.broad
def test_a_set_against_integer_orders_tells_each_order_and_not_one_for_all():
    """A clamped arm tells μ best and nothing of λ, of which a rig may be that is off in λ alone."""
    space = fracid.DesignSpace(release=(30, 150), arm=("free", "clamped"), seconds=4, rate=100, moment=0)
    options = {"free": (*FREE, "J_theta"), "orders": {"lambda": 0.95, "mu": 0.95}, "against": "integer"}
    both = fracid.design(RIG, space, experiments=2, **options)
    assert {c.arm for c in both.experiments} == {"free", "clamped"}
    assert min(both.alone.values()) > 50
    one = fracid.design(RIG, space, experiments=2, of=("mu",), **options)
    assert [*one.alone] == ["mu"]
    assert one.alone["mu"] > both.alone["mu"]


def test_the_order_that_is_off_alone_stays_where_it_is_and_the_others_are_integers():
    subject = subject_of(RIG, SPACE, free=FREE, orders={"lambda": 0.9, "mu": 0.95})
    rig = subject.at({"lambda": 1.0})
    assert rig.problem.order_starts == {"lambda": 1.0, "mu": 0.95}
    assert rig.shared[rig.names.index("lambda")].range.start == 1.0


@pytest.mark.broad
@pytest.mark.parametrize(
    ("release", "arm", "orders"),
    [
        (60, "free", ORDERS),
        ((30, 90, 150), ("free", "clamped"), {"lambda": 1.0, "mu": 0.99}),
        ((30, 90, 150), ("free", "clamped"), {"lambda": 0.98, "mu": 1.0}),
    ],
)
def test_the_distance_is_that_of_a_fit_of_the_integer_order_model(release, arm, orders):
    """Linear about its own minimum, the distance is what least squares leaves there; of a clamped arm too."""
    space = fracid.DesignSpace(release=release, arm=arm, seconds=4, rate=100, moment=0)
    plan = fracid.design(RIG, space, experiments=1, against="integer", orders=orders)
    problem = joint(plan)
    friction = freed_friction(problem)
    integer = replace(problem, orders=integer_values(problem), parameters={**problem.parameters, **friction})
    best = minimise(integer.evaluate, least_squares(integer.space, None)).best
    deviation = np.sqrt(plan.subject.noise["alpha"].variance)
    distance = np.linalg.norm(integer.errors(best.point)[0]) / deviation
    assert plan.distances["friction"] == pytest.approx(distance, rel=0.02)
    with_states = {n: plan.distances[n] for n in ("presliding", "Stribeck's friction")}
    assert max(with_states.values()) <= distance * (1 + 1e-2)  # each may do what friction does


@pytest.mark.broad
def test_a_robust_plan_is_the_same_for_any_number_of_threads():
    one, two = (fracid.design(RIG, SPACE, experiments=2, of=("mu",), free=FREE, robust=2, jobs=jobs) for jobs in (1, 2))
    assert one.experiments == two.experiments
    assert one.expected == two.expected


# --- what is shown and written -----------------------------------------------------------------------------


def test_a_plan_shows_itself_in_eight_lines_and_as_a_table(plan):
    text = repr(plan)
    assert len(text.splitlines()) <= 8
    assert "λ = 0.95" in text
    assert plan._repr_html_().startswith("<table")
    value, half = re.search(r"^  mu +(\S+) ± (\S+)$", plan.summary(), re.MULTILINE).groups()
    assert len(value) == len(half)  # both end at the same decimal
    assert json.loads(json.dumps(plan.to_json()))["criterion"] == "Ds"


@pytest.mark.broad
def test_the_sheet_is_a_project_that_fits_when_its_places_are_filled(tmp_path):
    space = replace(SPACE, moment=0.05)
    plan = fracid.design(RIG, space, experiments=2, of=("mu",), free=("mu", "b_alpha"), orders=ORDERS)
    files = {path.name for path in plan.write(tmp_path)}
    assert {"sheet.txt", "next.toml", "plan.json", "expected-1.csv", "expected.png", "intervals.png"} <= files
    problem = read(joint(plan), plan.subject.noise, np.random.default_rng(4))
    for k, e in enumerate(problem.experiments, 1):
        held = np.vstack([np.tile(e.measured[0], (50, 1)), e.measured])  # until it is let go
        signals = dict(zip(problem.outputs, held.T, strict=True))
        recording = fracid.Recording.of("twin", 0.01 * np.arange(len(held)), signals)
        fracid.save_recording(recording, tmp_path / f"recording-{k}.csv")
    fitted = replace(fracid.load_project(tmp_path / "next.toml").problem, substeps=10)
    best = minimise(fitted.evaluate, least_squares(fitted.space, None)).best
    expected, mu = plan.expected["mu"], dict(zip(fitted.names, best.point, strict=True))["mu"]
    assert abs(mu - expected.value) < 4 * expected.standard_error
    assert best.cost < 1.2 * np.sqrt(plan.subject.noise["alpha"].variance)


@pytest.mark.broad
def test_a_voltage_is_written_as_it_is_applied(tmp_path):
    voltage = fracid.Pulses(0.3, 0.3, peak=2.0)
    space = fracid.DesignSpace(seconds=2, rate=100, voltage=voltage, voltage_step=0.3)
    plan = fracid.design(RIG, space, experiments=1, free=FREE, orders=ORDERS)
    plan.write(tmp_path)
    (c,) = plan.experiments
    table = np.loadtxt(tmp_path / "voltage-1.csv", delimiter=",", skiprows=2)
    below = 0.3 * math.floor(c.voltage.peak / 0.3)  # the largest step of the amplifier within the peak
    assert table[:, 1] == pytest.approx(below * np.sign(c.voltage.signal(table[:, 0])))
    assert 'voltage = { column = "voltage", unit = "V", between = "hold" }' in (tmp_path / "next.toml").read_text(
        "utf-8"
    )


def test_a_plan_whose_signals_cannot_be_written_leaves_no_sheet_behind(tmp_path, monkeypatch):
    space = fracid.DesignSpace(seconds=1, rate=50, voltage=fracid.Pulses(0.3, 0.3, peak=0.1))
    plan = fracid.design(fracid.model("pendulum"), space, experiments=1, free=("J",), orders={"mu": 1.0})

    def refused(*_signal):
        raise InputError("This unit is not possible.")

    monkeypatch.setattr(fracid.Recording, "of", refused)
    with pytest.raises(InputError, match="This unit is not possible"):
        plan.write(tmp_path / "design")
    assert not (tmp_path / "design").exists()


def driven_by(values, name="goal"):
    """Ten seconds of a joint, one of whose inputs moves, at 20 Hz."""
    model = fracid.model("joint", gain=0.5)
    inputs = np.zeros((201, len(model.inputs)))
    inputs[:, model.inputs.index("torque_enable")] = 1.0
    inputs[:, model.inputs.index(name)] = values
    e = fracid.Experiment("log", 0.05, np.zeros((201, 1)), inputs, units={"angle": "rad"})
    return fracid.Problem(model, (e,), {"mu": 1.0}, {"J": fracid.Free(5e-3, 1e-3, 1e-2)}, outputs=("angle",))


@pytest.mark.broad
def test_what_drove_the_recordings_is_what_is_played_with_the_others_as_without_a_column():
    problem = driven_by(np.sin(np.arange(201)))
    space = fracid.DesignSpace(seconds=2, rate=50, voltage=fracid.Multisine(1.0, 1.0, 0.3, 1), around=0.7, noise=1e-3)
    (c, *_) = space.candidates
    e = subject_of(problem, space).problem_of(c).experiments[0]
    u = dict(zip(problem.model.inputs, e.inputs.T, strict=True))
    np.testing.assert_allclose(u["goal"], 0.7 + c.voltage.signal(e.time))
    assert [float(np.max(np.abs(u[n] - v))) for n, v in (("torque", 0), ("voltage", 0), ("torque_enable", 1))] == [
        0
    ] * 3


@pytest.mark.broad
def test_a_stretch_is_played_in_lines_with_the_rate_that_they_have():
    model = fracid.model("relaxation")
    e = fracid.Experiment("log", 0.1, np.zeros((3, 1)), np.zeros((1, 2)), units={"force": "N"})
    problem = fracid.Problem(model, (e,), {"nu": fracid.Free(0.3, 0.1, 0.9)}, outputs=("force",))
    space = fracid.DesignSpace(seconds=2, rate=50, voltage=fracid.Multisine(1.0, 1.0, 0.3, 1), noise=1e-3)
    played = subject_of(problem, space).problem_of(space.candidates[0]).experiments[0]
    stretch, rate = played.inputs.T
    np.testing.assert_allclose(stretch[0] + np.cumsum(rate[:-1]) / 50, stretch[1:], atol=1e-12)
    assert (played.between["stretch"], played.between["rate"]) == ("line", "hold")


def test_a_driven_model_is_planned_as_it_was_recorded_where_nothing_is_said():
    space = _as_recorded(fracid.DesignSpace(rate=200), driven_by(2.0 + np.sin(np.arange(201))), ("seconds", "voltage"))
    assert (space.seconds, space.rate, space.around) == (10.0, 200, 2.0)
    assert (space.voltage.low, space.voltage.high) == (0.2, 2.0)
    assert space.voltage.peak == pytest.approx(1.0, rel=1e-4)
    assert "peak 1, offset 2, 10 s" in str(space.candidates[0])
    still = _as_recorded(fracid.DesignSpace(), driven_by(0.0), ("seconds", "rate", "voltage"))
    assert (still.seconds, still.rate, still.voltage) == (10.0, 20.0, None)


@pytest.mark.parametrize(
    "values", [np.repeat([0.0, 12.0, 6.0], 67), np.repeat([-1.0, 2.0, 0.0], 67), np.minimum(np.arange(201), 9.0)]
)
def test_what_is_planned_stays_within_the_input_that_was_recorded(values):
    space = _as_recorded(fracid.DesignSpace(), driven_by(values), ("seconds", "rate", "voltage"))
    low, high = space.around - space.voltage.peak, space.around + space.voltage.peak
    assert np.min(values) <= low < high <= np.max(values)
    assert high - low >= 0.45 * np.ptp(values)


def oven(begin):
    """Two heated masses, of which one is measured, that begin elsewhere than at 0."""

    def rhs(t, x, u, p, out):
        out[0], out[1] = u[0] - p[0] * (x[0] - 20.0) - (x[0] - x[1]), p[0] * (x[0] - x[1])

    model = fracid.Model(
        "oven",
        rhs,
        ("plate", "block"),
        (1.0, 1.0),
        {"plate": 0},
        ("heater",),
        (fracid.Parameter("loss", "1/s", 0.5, "to the room"),),
        "",
        "",
        output_units={"plate": "K"},
    )
    inputs = (np.arange(101) // 20 % 2).astype(float)[:, None]
    log = fracid.Experiment(
        "log",
        0.1,
        np.full((101, 1), begin),
        inputs,
        between={"heater": "hold"},
        initial={"block": fracid.Free(18.0, 0.0, 40.0)},
    )
    short = fracid.Experiment("short", 0.1, np.zeros((11, 1)), np.zeros((11, 1)), initial={"block": 0.0})
    problem = fracid.Problem(model, (short, log), {}, {"loss": fracid.Free(0.5, 0.1, 2.0)}, initial_state="rest")
    return simulated(problem, problem.start, finer=1)


def test_a_plan_begins_where_the_longest_recording_did_as_fitted():
    problem = oven(22.0)
    x = problem.point({"block(0) [log]": 25.0, "plate(0) [log]": 23.0})
    space = fracid.DesignSpace(seconds=10, rate=10, voltage=fracid.Multisine(0.2, 1.0, 0.5), noise=0.05)
    planned = subject_of_problem(problem, x, space).problem_of(space.candidates[0])
    e = planned.experiments[0]
    assert (e.measured[0, 0], e.initial["block"].start, e.units) == (23.0, 25.0, {"plate": "K"})
    assert planned.fitted(planned.start, e)[0, 0] == 23.0


@pytest.mark.broad
def test_files_of_a_plan_have_the_names_and_units_of_what_is_in_them(tmp_path):
    space = fracid.DesignSpace(seconds=10, rate=10, voltage=fracid.Multisine(0.2, 1.0, 0.5), noise=0.05)
    noise = {"plate": Noise(0.05, 0.0)}
    fracid.design(read(oven(22.0), noise, np.random.default_rng(5)), space, experiments=1).write(tmp_path)
    assert (tmp_path / "heater-1.csv").exists()
    assert "plate [K],plate low [K],plate high [K]" in (tmp_path / "expected-1.csv").read_text("utf-8")
    sheet = (tmp_path / "sheet.txt").read_text("utf-8")
    assert "play heater-1.csv; " in sheet
    assert "together with the recordings so far: add those to next.toml." in sheet
    assert 'plate = { column = "plate", unit = "K" }' in (project := (tmp_path / "next.toml").read_text("utf-8"))
    assert "initial = { block = { start = 18.0, lower = 0.0, upper = 40.0 } }" in project


# --- what is refused ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"release": ()}, "release = "),
        ({"seconds": 0.01}, "fewer than 10 samples"),
        ({"arm": "loose"}, "unknown arm 'loose'; the known ones are free, clamped"),
        ({"voltage": 6.0}, r"fracid\.Multisine"),
        ({"voltage": fracid.Pulses(0.3, 0.3, peak=2.0), "voltage_step": 3.0}, "no more than the peak"),
        ({"counts": 2}, "counts a turn"),
        ({"noise": -1.0}, "0 or more"),
        ({"limits": {"theta": 0.0}}, "above 0"),
        ({"initial_state": "moving"}, "'rest', 'held' or 'estimate'"),
    ],
)
def test_what_no_experiment_can_have_is_refused(change, told):
    with pytest.raises(InputError, match=told):
        fracid.DesignSpace(**{"release": 90, **change})


@pytest.mark.parametrize(
    ("space", "options", "told"),
    [
        ({}, {"of": ("muu",)}, "there is no 'muu'"),
        ({}, {"of": ("C4",)}, "C4 is fixed"),
        ({}, {"against": "friction"}, "the known ones are integer"),
        ({}, {"criterion": "E"}, "the known ones are D, A, Ds, T"),
        ({}, {"against": "integer", "orders": {"lambda": 1.0, "mu": 1.0}}, "Every order is an integer"),
        ({"limits": {"beta": 1.0}}, {}, "unknown output in limits"),
        ({"limits": {"alpha": 1e-3}}, {}, "None of the 8 candidates is possible"),
        ({"release": 0.0}, {}, "There is no candidate"),
    ],
)
def test_what_cannot_be_designed_is_refused(space, options, told):
    with pytest.raises(InputError, match=told):
        fracid.design(RIG, replace(SPACE, **space), **{"free": FREE, "orders": ORDERS, **options})


def test_the_noise_of_outputs_that_are_no_angles_is_asked_for():
    cell = fracid.Model("cell", lambda t, x, u, p, out: out.fill(0.0), ("volts",), ("q",), {"volts": 0}, ("current",),
                        (fracid.Parameter("rate", "1/s", 1.0, "of loss"),), "", "")  # fmt: skip
    with pytest.raises(InputError, match="The outputs of cell are not known as angles of encoders: give noise"):
        fracid.design(cell, fracid.DesignSpace(voltage=fracid.Pulses(1.0, 2.0, peak=1.0)))


def test_a_sum_of_information_is_that_of_independent_experiments():
    one = Information(np.diag([1.0, 4.0]), np.diag([1.0, 4.0]))
    assert (one + one).covariance(np.ones(2)) == pytest.approx(np.diag([0.5, 0.125]))
