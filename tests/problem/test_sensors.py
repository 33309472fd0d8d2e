"""Channels that are late, scaled, offset or filtered, and samples that are not scored."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import fracid
from fracid import Experiment, Free, InputError, Problem, Recording, Sensor
from fracid.estimation.horizons import horizons
from fracid.estimation.windows import chosen_window, in_windows
from fracid.problem.costs import COSTS
from fracid.solver.inputs import low_passed

pytestmark = pytest.mark.usefixtures("without_rivals")

STEP, SAMPLES = 5e-3, 1201
T = STEP * np.arange(SAMPLES)
NOISE = 2e-4


def rhs(t, x, u, p, out):
    out[0] = x[1]
    out[1] = -p[0] * np.sin(x[0]) - p[1] * x[1] + u[0]


PENDULUM = fracid.Model(
    "pendulum", rhs, ("alpha", "rate"), ("mu", "mu"), {"alpha": 0}, ("drive",),
    (fracid.Parameter("stiffness", "1/s^2", 36.0, "g / l"), fracid.Parameter("damping", "1/s", 0.4, "friction")),
    "hanging", "a test",
)  # fmt: skip


def test_a_channel_whose_values_are_those_of_one_that_does_nothing_is_none():
    channels = {"alpha": Sensor(delay=0.0, gain=1.0)}, {"drive": Sensor(bias=0.0), "late": Sensor(delay=1e-3)}
    e = Experiment("idle", STEP, np.zeros((SAMPLES, 1)), np.zeros((1, 1)), sensors=channels[0], actuators=channels[1])
    assert (e.sensors, [*e.actuators]) == ({}, ["late"])


def swing(times, initial=(0.8, 0.0)):
    """α of the pendulum by an independent integrator, at rest before 0."""
    run = solve_ivp(lambda t, x: [x[1], -36 * np.sin(x[0]) - 0.4 * x[1]], (0, T[-1] + 1), initial, "DOP853",
                    rtol=1e-11, atol=1e-12, dense_output=True)  # fmt: skip
    return np.where(times < 0, initial[0], run.sol(np.maximum(times, 0))[0])


def filtered(times, lowpass):
    """The same after a low-pass, by the same integrator."""
    run = solve_ivp(
        lambda t, x: [x[1], -36 * np.sin(x[0]) - 0.4 * x[1], (x[0] - x[2]) / lowpass], (0, T[-1] + 1), (0.8, 0.0, 0.8),
        "DOP853", rtol=1e-11, atol=1e-12, dense_output=True,
    )  # fmt: skip
    return np.where(times < 0, 0.8, run.sol(np.maximum(times, 0))[2])


def problem(measured, sensor=None, *, order=1.0, **more):
    sensors = {} if sensor is None else {"alpha": sensor}
    e = Experiment("twin", STEP, measured[:, None], np.zeros((1, 1)), initial={"alpha": 0.8}, sensors=sensors, **more)
    return Problem(PENDULUM, (e,), {"mu": order}, {"damping": Free(0.3, 0.0, 2.0)}, initial_state="held", substeps=4)


def noisy(measured, seed=1):
    return measured + NOISE * np.random.default_rng(seed).standard_normal(len(measured))


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("truth", "sensor"),
    [
        ({"delay": 0.0033}, Sensor(delay=Free(0.0, -0.02, 0.02))),
        ({"delay": -0.0121}, Sensor(delay=Free(0.0, -0.02, 0.02))),
        ({"delay": 0.0007, "gain": 1.07, "bias": -0.01},
         Sensor(delay=Free(0.0, -0.02, 0.02), gain=Free(1.0, 0.5, 2.0), bias=Free(0.0, -0.1, 0.1))),
        ({"lowpass": 0.06}, Sensor(lowpass=Free(0.02, 0.0, 0.3))),
    ],
    ids=["late", "early", "late, scaled and offset", "filtered"],
)  # fmt: skip
def test_what_the_channel_of_a_twin_does_is_found_within_its_interval(truth, sensor):
    times = T - truth.get("delay", 0.0)
    y = filtered(times, truth["lowpass"]) if "lowpass" in truth else swing(times)
    measured = noisy(truth.get("gain", 1.0) * y + truth.get("bias", 0.0))
    fit = fracid.identify(problem(measured, sensor, order=Free(0.97, 0.8, 1.1)))
    truths = {f"{name}_alpha": value for name, value in truth.items()} | {"damping": 0.4}
    for name, value in truths.items():
        low, high = fit.parameters[name].interval95
        slack = 0.5 * (high - low)  # an interval misses one time in twenty, and four are asked for
        assert low - slack < value < high + slack, name
    assert abs(fit.orders["mu"].value - 1) < 2e-4
    if "delay" in truth:
        assert fit.parameters["delay_alpha"].unit == "s"
        assert abs(fit.parameters["delay_alpha"].value - truth["delay"]) < 0.05 * STEP
    assert fit.recordings["twin"].rmse["alpha"] == pytest.approx(NOISE, rel=0.05)


@pytest.mark.broad
def test_a_delay_that_nobody_looks_for_moves_the_order():
    late = noisy(swing(T - 5e-3))
    blind = fracid.identify(problem(late, order=Free(0.97, 0.8, 1.1)))
    fixed = fracid.identify(problem(late, Sensor(delay=5e-3), order=Free(0.97, 0.8, 1.1)))
    assert abs(blind.orders["mu"].value - 1) > 6e-4 > 2e-4 > abs(fixed.orders["mu"].value - 1)


def test_a_delay_is_exact_to_a_small_part_of_a_sample():
    for delay in (1e-7, 0.0013, 0.005, -0.0049, 0.3, -0.3):
        p = replace(problem(swing(T), Sensor(delay=delay)), parameters={"damping": 0.4})
        e = p.experiments[0]
        error = p.fitted(p.start, e)[:, 0] - swing(T - delay)
        assert abs(error).max() < 6e-5  # the run's own; the angle moves so far in 1.3 10⁻⁵ s


def test_a_channel_that_does_nothing_changes_no_bit():
    measured = noisy(swing(T))
    plain, same = problem(measured), problem(measured, Sensor())
    assert np.array_equal(plain.residuals(plain.start), same.residuals(same.start))


def test_a_low_pass_of_lines_is_exact():
    y, lowpass, h = np.array([1.0, 3.0, 2.0, 2.0]), 0.7, 0.5
    fine = solve_ivp(lambda t, z: (np.interp(t, h * np.arange(4), y) - z) / lowpass, (0, 1.5), [1.0], max_step=1e-2,
                     t_eval=h * np.arange(4), rtol=1e-10, atol=1e-12)  # fmt: skip
    assert low_passed(y, h, lowpass) == pytest.approx(fine.y[0], abs=1e-7)
    assert low_passed(y, h, 0.0) is y
    assert low_passed(y, h, 1e-12) == pytest.approx(y)


@pytest.mark.broad
def test_recordings_share_a_delay_or_have_their_own():
    delays, sensor = (0.002, 0.009), Sensor(delay=Free(0.0, -0.02, 0.02))
    records = tuple(
        Experiment(f"r{i}", STEP, noisy(swing(T - d), i)[:, None], np.zeros((1, 1)), initial={"alpha": 0.8},
                   sensors={"alpha": sensor}) for i, d in enumerate(delays)
    )  # fmt: skip
    own = Problem(PENDULUM, records, {"mu": 1.0}, {"damping": 0.4}, ("delay_alpha",), initial_state="held", substeps=4)
    assert own.names == ("delay_alpha [r0]", "delay_alpha [r1]")
    fit = fracid.identify(own)
    for r, d in zip(records, delays, strict=True):
        assert fit.recordings[r.name].parameters["delay_alpha"].value == pytest.approx(d, abs=0.05 * STEP)
    shared = replace(own, per_recording=())
    assert shared.names == ("delay_alpha",)
    assert own.with_shared(fit.x, records[:1]).names == ("delay_alpha [r0]",)
    assert shared.with_shared(np.array([0.004]), records[:1]).names == ()
    other = replace(records[1], sensors={"alpha": Sensor(delay=Free(0, -1e-3, 1e-3))})
    with pytest.raises(InputError, match=r"delay_alpha has two ranges.*per_recording = \[.delay_alpha.\]"):
        replace(shared, parameters={}, model=PENDULUM, experiments=(records[0], other))
    with pytest.raises(InputError, match="the delay of alpha is not free in r1"):
        replace(own, experiments=(records[0], replace(records[1], sensors={})))


def test_a_start_as_measured_is_freed_of_the_sensor():
    sensor = Sensor(gain=Free(1.0, 0.5, 3.0), bias=0.1)
    p = problem(2 * swing(T) + 0.1, sensor)
    e = replace(p.experiments[0], initial={})
    p = replace(p, experiments=(e,))
    assert p.unpack(np.array([0.4, 2.0]), e)[2] == pytest.approx([0.8, 0.0])


@pytest.mark.broad
def test_samples_behind_a_mask_do_not_count():
    measured = noisy(swing(T))
    spoilt = measured.copy()
    spoilt[200:400] += 1.0
    mask = ((T[200], T[300]), (T[250], T[399]))  # they may overlap
    clean, masked = problem(measured, mask=mask), problem(spoilt, mask=mask)
    assert clean.cost(clean.start) == masked.cost(masked.start)
    assert masked.experiments[0].samples == SAMPLES - 200
    outside = np.r_[measured[:200], measured[400:]]
    fitted = masked.fitted(masked.start, masked.experiments[0])[:, 0]
    simulated = np.r_[fitted[:200], fitted[400:]]
    assert masked.cost(masked.start) == pytest.approx(np.sqrt(np.mean((outside - simulated) ** 2)))
    fit = fracid.identify(masked)
    recording = fit.recordings["twin"]
    assert (recording.samples, recording.rmse["alpha"]) == (SAMPLES - 200, pytest.approx(NOISE, rel=0.1))
    assert np.flatnonzero(np.isnan(recording.residual("alpha"))).tolist() == list(range(200, 400))
    low, high = fit.parameters["damping"].interval95
    assert low - 1e-4 < 0.4 < high + 1e-4
    assert fit.cost == pytest.approx(NOISE, rel=0.1)


@pytest.mark.parametrize("cost", ["rmse", "itae", "huber", "ise"])
def test_every_cost_counts_what_is_scored_alone(cost):
    p = problem(noisy(swing(T)), mask=((0.0, T[600]),))
    p = replace(p, cost_function=COSTS[cost])
    e, r = p.experiments[0], p.errors(p.start)[0]
    assert np.all(r[:601] == 0)
    rows = p.residuals(p.start)
    value = p.cost(p.start)
    assert np.sum(rows**2) == pytest.approx(value**2 if p.cost_function.root else value, rel=1e-2)
    after = p.cost_function.value(e.time[601:], r[601:])
    assert value == pytest.approx(after, rel=1e-2)


def test_a_bridged_gap_is_never_scored():
    keep = np.r_[0:300, 340:SAMPLES]
    recording = Recording.of("twin", T[keep], {"alpha": swing(T)[keep]}).resample(STEP)
    e = Experiment.of(recording, PENDULUM, ["alpha"])
    assert np.flatnonzero(~e.scored[:, 0]).tolist() == list(range(300, 340))
    later = Experiment.of(recording.trim(1.0), PENDULUM, ["alpha"])  # on the recording's own clock
    assert np.flatnonzero(~later.scored[:, 0]).tolist() == list(range(100, 140))
    assert np.all(Experiment.of(Recording.of("twin", T, {"alpha": swing(T)}), PENDULUM, ["alpha"]).scored)


def assayed(every=20):
    """α at all times, its rate at few: both noisy, the rate with blanks."""
    run = solve_ivp(lambda t, x: [x[1], -36 * np.sin(x[0]) - 0.4 * x[1]], (0, T[-1]), (0.8, 0.0), "DOP853", t_eval=T,
                    rtol=1e-11, atol=1e-12)  # fmt: skip
    rng = np.random.default_rng(3)
    rate = run.y[1] + 0.05 * rng.standard_normal(SAMPLES)
    return noisy(run.y[0]), np.where(np.arange(SAMPLES) % every == 0, rate, np.nan)


BOTH = replace(PENDULUM, outputs={"alpha": 0, "rate": 1}, output_units={"rate": "rad/s"})


def of(signals, outputs, **options):
    units = {n: {"alpha": "rad", "rate": "rad/s"}[n] for n in signals}
    time = T[: len(next(iter(signals.values())))]
    e = Experiment.of(Recording.of("twin", time, signals, units), BOTH, outputs, {"alpha": 0.8})
    return Problem(BOTH, (e,), {"mu": 1.0}, {"damping": Free(0.3, 0.0, 2.0), "stiffness": Free(30.0, 10.0, 90.0)},
                   outputs=tuple(outputs), initial_state="held", substeps=4, **options)  # fmt: skip


@pytest.mark.parametrize("weights", ["equal", "noise"])
def test_an_output_that_is_measured_now_and_then_counts_by_its_own_samples(weights):
    alpha, rate = assayed()
    p = of({"alpha": alpha, "rate": rate}, ["alpha", "rate"], weights=weights)
    assert np.count_nonzero(p.experiments[0].scored, axis=0).tolist() == [SAMPLES, 61]
    fitted, own = p.fitted(p.start, p.experiments[0]), ~np.isnan(rate)
    squares = np.sum((alpha - fitted[:, 0]) ** 2), np.sum((rate - fitted[:, 1])[own] ** 2)
    levels = np.sqrt(squares / np.array([SAMPLES, 61]))
    likely = np.exp(np.average(np.log(levels), weights=[SAMPLES, 61]))
    mean = np.sqrt(sum(squares) / (SAMPLES + 61))
    assert p.cost(p.start) == pytest.approx(likely if weights == "noise" else mean, rel=1e-9)
    rows = p.residuals(p.start)
    assert rows @ rows == pytest.approx(2 * p.cost(p.start) ** 2, rel=1e-6)


@pytest.mark.parametrize("cost", ["rmse", "iae"])
def test_an_output_without_a_sample_in_the_first_part_of_a_record_weighs_nothing_there(cost):
    alpha, rate = assayed()
    late = of({"alpha": alpha, "rate": np.where(T > 1.0, rate, np.nan)}, ["alpha", "rate"], weights="noise",
              cost_function=COSTS[cost])  # fmt: skip
    begins = replace(late, experiments=(late.experiments[0].part(0, 100),))
    alone = of({"alpha": alpha[:100]}, ["alpha"], weights="noise", cost_function=COSTS[cost])
    errors = begins.errors(begins.start)
    assert begins.cost(begins.start) == pytest.approx(alone.criterion.cost(alone.start, [errors[0][:, :1]]))
    assert np.all(np.isfinite(begins.residuals(begins.start)))
    assert np.all(late.until(0.1).experiments[0].scored.any(axis=0))


def test_an_output_that_is_measured_later_on_may_have_moved_until_then():
    alpha, rate = assayed()
    starts = []
    for begins in (0.0, 1.0):
        p = of({"alpha": alpha, "rate": np.where(begins <= T, rate, np.nan)}, ["alpha", "rate"])
        p = replace(p, experiments=(replace(p.experiments[0], initial={}),), initial_state="rest")
        starts.append({u.target: (u.range.upper - u.range.lower) / np.nanmax(np.abs(rate)) for u in p.unknowns})
    first, late = starts
    assert first["rate"] < 0.5
    assert late["rate"] > 4.0


def test_blanks_of_an_output_leave_the_fit_of_the_rows_that_it_has():
    _, rate = assayed()
    blank, own = of({"rate": rate}, ["rate"]), ~np.isnan(rate)
    rows = Experiment("rows", STEP, rate[own, None], np.zeros((1, 1)), initial={"alpha": 0.8}, times=T[own])
    fits = [fracid.identify(p) for p in (blank, replace(blank, experiments=(rows,)))]
    for name in ("damping", "stiffness"):
        one, other = (fit.parameters[name] for fit in fits)
        assert one.value == pytest.approx(other.value, rel=1e-5)
        assert one.interval95 == pytest.approx(other.interval95, rel=1e-2)
    analyses = [fracid.residual_analysis(next(iter(fit.recordings.values())), "rate") for fit in fits]
    assert [a.samples for a in analyses] == [61, 61]
    assert analyses[0].whiteness.p_value == pytest.approx(analyses[1].whiteness.p_value, abs=0.02)
    with pytest.raises(InputError, match="measured less often"):
        fracid.bootstrap(blank, fits[0].x)


def test_one_sample_of_an_output_is_scored_and_none_is_refused():
    alpha, rate = assayed()
    single = np.where(T[600] == T, rate, np.nan)
    p = of({"alpha": alpha, "rate": single}, ["alpha", "rate"])
    few = replace(p, experiments=(p.experiments[0].part(0, 5),))  # as a window is, of 2.5 samples of an output
    assert [np.count_nonzero(q.experiments[0].scored, axis=0).tolist() for q in (p, few)] == [[SAMPLES, 1], [5, 0]]
    recording = Recording.of("twin", T, {"alpha": alpha, "rate": single}, {"alpha": "rad", "rate": "rad/s"})
    with pytest.raises(InputError, match="twin: rate has no sample beside masks, blanks and delays: leave 'rate' out"):
        Experiment.of(recording, BOTH, ["alpha", "rate"], mask=[(T[550], T[650])])


def test_an_output_that_is_measured_now_and_then_is_no_start_of_a_window_and_no_past():
    alpha, rate = assayed()
    p = of({"alpha": alpha, "rate": rate}, ["alpha", "rate"], windows=3.0)
    e = replace(p.experiments[0], initial={})
    assert chosen_window(replace(p, experiments=(replace(e, blanks=()),))) == 3.0
    with pytest.raises(InputError, match="measured now and then"):
        chosen_window(replace(p, experiments=(e,)))
    signals, units = {"alpha": alpha, "rate": rate}, {"alpha": "rad", "rate": "rad/s"}
    before, after = Recording.of("twin", T, signals, units).bridge_blanks(["rate"]).split(3.0)
    e = Experiment.of(after, BOTH, ["alpha", "rate"], before=before)
    with pytest.raises(InputError, match="nor with an output that is measured now and then"):
        replace(p, experiments=(e,), initial_state="estimate")


def test_a_held_out_output_that_is_measured_now_and_then_is_missed_by_its_own_samples():
    alpha, rate = assayed()
    p = of({"alpha": alpha, "rate": rate}, ["alpha", "rate"])
    slow = Recording.of("slow", T, {"alpha": alpha, "rate": rate + 0.12 * np.sin(T)}, {"alpha": "rad", "rate": "rad/s"})
    held_out = Experiment.of(slow, BOTH, ["alpha", "rate"], {"alpha": 0.8, "rate": 0.0})  # off by twice the noise
    assert "missed" not in [f.code for f in fracid.identify(p, validation=[held_out]).findings]


def test_a_horizon_is_counted_in_samples_that_are_scored():
    e = problem(swing(T), Sensor(delay=0.05), mask=((0.0, 1.0),)).experiments[0]
    assert e.until(0.5).samples == 101


def test_a_problem_with_sensors_travels():
    p = Problem(fracid.rotary_pendulum(), (Experiment("a", STEP, np.zeros((9, 2)), np.ones((9, 1)),
                sensors={"alpha": Sensor(delay=Free(0, -0.01, 0.01))}, actuators={"voltage": Sensor(lowpass=0.01)},
                between={"voltage": "hold"}, mask=((0.0, 0.01),)),), {"lambda": 1.0, "mu": 1.0})  # fmt: skip
    x = p.start + 1e-3
    back = pickle.loads(pickle.dumps(p))
    assert (back.names, back.cost(x)) == (p.names, p.cost(x))


@pytest.mark.parametrize(("sensor", "mask"), [(Sensor(delay=-2.5), ()), (Sensor(delay=2.5), ()), (None, ((0.0, 3.0),))])
def test_delays_longer_than_a_swing_and_masks_longer_than_a_window_leave_pieces_to_begin_with(sensor, mask):
    p = problem(swing(T), sensor, mask=mask)
    assert all(part.samples >= 100 for h in horizons(p) for part in p.until(h).experiments)
    pieces = in_windows(p).experiments
    assert pieces
    assert all(4 * part.samples >= len(part.measured) for part in pieces)


# --- inputs ----------------------------------------------------------------------------------------------


def driven(u, late=0.0, step=0.02):
    """The pendulum driven by held values by an independent integrator, each `late` after its sample."""

    def f(t, x, v):
        return [x[1], -36 * np.sin(x[0]) - 0.4 * x[1] + v]

    x, states = np.array([0.3, 0.0]), []
    for before, now in zip([u[0], *u[:-1]], u, strict=True):
        states.append(x)
        for value, span in ((before, late), (now, step - late)):
            if span > 0:
                x = solve_ivp(f, (0, span), x, "DOP853", args=(value,), rtol=1e-10, atol=1e-11).y[:, -1]
    return np.array(states)[:, 0] + NOISE * np.random.default_rng(4).standard_normal(len(u))


U = 3 * np.sin(0.3 * np.arange(500)) + np.random.default_rng(5).standard_normal(500)


def of_driven(alpha, between, actuator=None, **more):
    e = Experiment("twin", 0.02, alpha[:, None], U[:, None], initial={"alpha": 0.3}, between={"drive": between},
                   actuators={} if actuator is None else {"drive": actuator})  # fmt: skip
    free = {"stiffness": Free(35.0, 20.0, 50.0), "damping": Free(0.3, 0.0, 2.0)}
    return Problem(PENDULUM, (e,), {"mu": Free(0.98, 0.8, 1.2)}, free, initial_state="held", substeps=8, **more)


@pytest.mark.broad
def test_held_values_give_the_order_of_a_perfect_model_where_lines_do_not():
    alpha = driven(U)
    held, lines = (fracid.identify(of_driven(alpha, between)) for between in ("hold", "line"))
    low, high = held.orders["mu"].interval95
    assert low < 1 < high
    assert high - low < 1e-3
    assert held.recordings["twin"].rmse["alpha"] == pytest.approx(NOISE, rel=0.1)
    assert abs(lines.orders["mu"].value - 1) > 20 * abs(held.orders["mu"].value - 1)
    assert lines.recordings["twin"].rmse["alpha"] > 5 * NOISE


@pytest.mark.broad
def test_the_delay_and_the_gain_of_an_input_are_found():
    alpha = driven(2 * U + 0.5, late=0.0067)
    far = Sensor(delay=Free(0.0, -0.02, 0.02), gain=Free(1.5, 0.5, 4.0), bias=Free(0.0, -2.0, 2.0))
    fit = fracid.identify(of_driven(alpha, "hold", far))
    for name, truth in {"delay_drive": 0.0067, "gain_drive": 2.0, "bias_drive": 0.5}.items():
        low, high = fit.parameters[name].interval95
        assert low < truth < high, name
    assert abs(fit.parameters["delay_drive"].value - 0.0067) < 0.05 * 0.02


def test_a_voltage_is_held_if_nothing_is_said():
    time = 0.1 * np.arange(20)
    signals = {"theta": 0 * time, "alpha": 0 * time, "voltage": np.sin(time)}
    rig = fracid.rotary_pendulum()
    volts = Recording.of("twin", time, signals, {"voltage": "V"})
    assert Experiment.of(volts, rig, ["alpha"]).between == {"voltage": "hold"}
    assert Experiment.of(volts, rig, ["alpha"], between={"voltage": "line"}).between == {"voltage": "line"}
    assert Experiment.of(Recording.of("twin", time, signals, {"voltage": "1"}), rig, ["alpha"]).between == {}
    with pytest.raises(InputError, match="between drive 'held'"):
        of_driven(U, "held")


def test_what_moves_an_input_is_in_the_key_of_the_memo():
    alpha, fixed = U.copy(), Sensor(delay=1e-3)
    problems = [of_driven(alpha, b, a) for b in ("hold", "line") for a in (None, fixed, replace(fixed, gain=2.0))]
    keys = {p.simulator._key(p.start, p.experiments[0]) for p in problems}
    assert len(keys) == len(problems)


def test_a_twin_of_a_driven_recording_is_what_the_problem_simulates():
    rig, n = fracid.rotary_pendulum(), 200
    volts = np.random.default_rng(6).standard_normal((n, 1))
    for between in ("hold", "line", "band-limited"):
        e = Experiment("twin", 0.01, np.zeros((n, 2)), volts, between={"voltage": between})
        p = Problem(rig, (e,), {"lambda": 0.95, "mu": 0.9}, initial_state="held", substeps=2)
        run = fracid.Twin.of_problem(p, p.start, e).simulate()
        assert run.states[:, [0, 2]] == pytest.approx(p.fitted(p.start, e), abs=1e-12)
