"""Sensors that are not angles: a gyroscope, an accelerometer, a potentiometer, as a user logs them."""

import numpy as np
import pytest

import fracid
from fracid.errors import InputError
from fracid.problem.model_draft import draft_of_model
from fracid.recording.loading import inspect_recording

pytestmark = pytest.mark.usefixtures("without_rivals")

SENSORS = {"gyro": "gyro_z [rad/s]", "accelerometer": "acc_x [m/s^2]", "potentiometer": "pot [V]"}
RADIUS, GAIN, BIAS = 0.25, 0.6, 2.5


@pytest.fixture(scope="module")
def swing():
    """A pendulum of order 0.97, its angle by a spline, so that the truth of a rate needs none of what is tested."""
    from scipy.interpolate import make_interp_spline

    run = fracid.simulate(fracid.model("pendulum"), orders={"mu": 0.97}, initial={"angle": 0.8}, step=1e-3, end=8.0)
    angle = make_interp_spline(run.time, run.states[:, 0], k=5)
    t = np.arange(0.0, 7.4975, 0.005)
    acceleration = RADIUS * angle(t, 2) + 9.80665 * np.sin(angle(t))
    return t, {"gyro": angle(t, 1), "accelerometer": acceleration, "potentiometer": BIAS + GAIN * angle(t)}


def logged(folder, swing, sensor, name=None):
    t, signals = swing
    columns = np.column_stack([t - t[0], signals[sensor]])
    header = f"t [s],{name or SENSORS[sensor]}"
    np.savetxt(path := folder / f"{sensor}.csv", columns, delimiter=",", header=header, comments="", fmt="%.9g")
    return path


def project_of(folder, swing, sensor, signal, more=""):
    text = f"""[model]
name = "pendulum"
[model.orders]
mu = 1.0
[[recording]]
file = "{logged(folder, swing, sensor).name}"
{signal} = {{ column = 1{more} }}
[fit]
substeps = 5
"""
    (folder / "rig.toml").write_text(text, encoding="utf-8")
    return fracid.load_project(folder / "rig.toml")


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("sensor", "signal", "more"),
    [
        ("gyro", "angle_rate", ""),
        ("accelerometer", "angle_acceleration", f", radius = {RADIUS}"),
        ("potentiometer", "angle", f", gain = {GAIN}, bias = {BIAS}"),
    ],
)
def test_a_sensor_is_scored_as_what_it_shows_of_the_model(tmp_path, sensor, signal, more):
    run = fracid.simulate(fracid.model("pendulum"), orders={"mu": 1.0}, initial={"angle": 0.8}, step=1e-3, end=8.0)
    at = run.time[100:-100:5]
    rate, angle = run.states[100:-100:5, 1], run.states[100:-100:5, 0]
    acceleration = -(0.147 * np.sin(angle) + 2e-4 * rate) / 3e-3
    shown = {"gyro": rate, "accelerometer": RADIUS * acceleration + 9.80665 * np.sin(angle),
             "potentiometer": BIAS + GAIN * angle}  # fmt: skip
    problem = project_of(tmp_path, (at, shown), sensor, signal, more).problem
    assert problem.outputs == (signal,)
    x = problem.start.copy()
    for state, value in (("angle", angle[0]), ("rate", rate[0])):
        [i] = [i for i, n in enumerate(problem.names) if n.startswith(f"{state}(0)")]
        x[i] = value
    [error] = problem.errors(x)
    assert np.sqrt(np.mean(error**2)) < 2e-4 * np.ptp(shown[sensor])


def test_a_gyroscope_shows_the_rate_whatever_the_order_is(tmp_path, swing):
    """At order 0.97 the model's state is D^0.97 of the angle, which is 6 % off its rate."""
    problem = project_of(tmp_path, swing, "gyro", "angle_rate").problem
    model = problem.model
    assert model.derived == {"angle_rate": ("angle", 1)}
    assert model.output_unit("angle_rate") == "rad/s"
    run = fracid.simulate(fracid.model("pendulum"), orders={"mu": 0.97}, initial={"angle": 0.8}, step=1e-3, end=8.0)
    state, shown = run.states[0:7500:5, 1], swing[1]["gyro"]
    assert np.ptp(state - shown) > 0.02 * np.ptp(shown)


@pytest.mark.parametrize(
    ("sensor", "says"),
    [
        ("gyro", "Its derivative has a name of its own: type angle_rate = { ... }."),
        ("potentiometer", "Of a potentiometer type gain = ..., its V in a rad"),
    ],
)
def test_what_is_no_angle_is_not_taken_for_one(tmp_path, swing, sensor, says):
    with pytest.raises(InputError) as refused:
        project_of(tmp_path, swing, sensor, "angle")
    assert says in str(refused.value)


def test_an_accelerometer_on_a_pendulum_has_a_distance_from_its_axis(tmp_path, swing):
    with pytest.raises(InputError, match=r"Of an accelerometer type radius = \.\.\., how far it is from the axis"):
        project_of(tmp_path, swing, "accelerometer", "angle_acceleration")
    with pytest.raises(InputError, match=r"radius = -1 m is not possible; expected a distance of 0 or more"):
        project_of(tmp_path, swing, "accelerometer", "angle_acceleration", ", radius = -1.0")


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("sensor", "signal", "free"),
    [
        ("gyro", "angle_rate", ()),
        ("accelerometer", "angle_acceleration", ("radius_angle_acceleration",)),
        ("potentiometer", "angle", ("gain_angle", "bias_angle")),
    ],
)
def test_a_draft_knows_a_sensor_by_its_unit(tmp_path, swing, sensor, signal, free):
    draft = draft_of_model("pendulum", logged(tmp_path, swing, sensor), folder=tmp_path)
    (tmp_path / "rig.toml").write_text(draft.text, encoding="utf-8")
    problem = fracid.load_project(tmp_path / "rig.toml").problem
    assert problem.outputs == (signal,)
    assert {*free} <= {*problem.names}
    assert {"angle(0) [" + sensor + "]", "rate(0) [" + sensor + "]"} <= {*problem.names}


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("header", "outputs", "free"),
    [
        ("angle [V]", {"angle"}, {"gain_angle", "bias_angle"}),
        ("angle [rad],acc_x [m/s^2]", {"angle", "angle_acceleration"}, {"radius_angle_acceleration"}),
        ("acc_x [m/s^2],gyro_z [rad/s]", {"angle_acceleration", "angle_rate"}, {"radius_angle_acceleration"}),
        ("pot [V],gyro_z [rad/s]", {"angle", "angle_rate"}, {"gain_angle", "bias_angle"}),
        ("angle [rad],velocity [rad/s],pot [V]", {"angle"}, set()),  # what is made of counts, or shows them once more
        ("angle [rad],acc_x [m/s^2],acc_y [m/s^2]", {"angle", "angle_acceleration"}, {"radius_angle_acceleration"}),
    ],
)
def test_a_draft_takes_sensors_beside_each_other(tmp_path, swing, header, outputs, free):
    t, signals = swing
    of = {"V": "potentiometer", "m/s^2": "accelerometer", "rad/s": "gyro", "rad": "potentiometer"}
    columns = [signals[of[name.split("[")[1][:-1]]] for name in header.split(",")]
    np.savetxt(path := tmp_path / "log.csv", np.column_stack([t - t[0], *columns]), delimiter=",", comments="",
               header=f"t [s],{header}")  # fmt: skip
    draft = draft_of_model("pendulum", path, folder=tmp_path)
    (tmp_path / "rig.toml").write_text(draft.text, encoding="utf-8")
    problem = fracid.load_project(tmp_path / "rig.toml").problem
    assert {*problem.outputs} == outputs
    assert {n for n in problem.names if n.partition("_")[0] in ("gain", "bias", "radius")} == free
    assert ('weights = "noise"' in draft.text) == (len(outputs) > 1)
    unused = [n for n in header.split(",") if f'"{n}"' not in draft.text]
    assert not unused or f"Not used: {', '.join(map(repr, unused))}." in draft.notes


def test_where_a_swing_begins_is_integrated_from_the_rate_and_not_from_the_acceleration(tmp_path, swing):
    """An accelerometer on a pendulum sees gravity too: its double integral is no angle."""
    t, signals = swing
    starts = []
    for k, names in enumerate((["gyro"], ["gyro", "accelerometer"])):
        columns = np.column_stack([t - t[0], *(signals[n] for n in names)])
        header = ",".join(["t [s]", *(SENSORS[n] for n in names)])
        np.savetxt(path := tmp_path / f"{k}.csv", columns, delimiter=",", comments="", header=header)
        (tmp_path / "rig.toml").write_text(draft_of_model("pendulum", path, folder=tmp_path).text, encoding="utf-8")
        problem = fracid.load_project(tmp_path / "rig.toml").problem
        starts.append([v for n, v in zip(problem.names, problem.start, strict=True) if "(0)" in n])
    assert starts[0] == pytest.approx(starts[1], rel=1e-6)


@pytest.mark.parametrize(
    ("name", "unit"),
    [("acc_x [m/s^2]", "m/s^2"), ("acc_x (g)", "m/s^2"), ("gyro_deg_s", "rad/s"), ("pos_mm", "m"), ("force_N", "N"),
     ("flow [ml/min]", "1")],
)  # fmt: skip
def test_no_unit_of_another_quantity_is_read_as_degrees(tmp_path, swing, name, unit):
    found = inspect_recording(logged(tmp_path, swing, "accelerometer", name), guess_units=True)
    assert found.units == {name: unit}
    assert not any("degrees" in line for line in (*found.report.warnings, *found.report.reading))


@pytest.mark.broad
@pytest.mark.parametrize(("sensor", "least"), [("gyro", 3e-3), ("accelerometer", 3e-2), ("potentiometer", 3e-3)])
def test_the_draft_of_a_sensor_gives_the_order_and_the_inertia(tmp_path, swing, sensor, least):
    rng, (t, signals) = np.random.default_rng(3), swing
    noisy = {n: s + 1e-3 * np.ptp(s) * rng.standard_normal(len(s)) for n, s in signals.items()}
    draft = draft_of_model("pendulum", logged(tmp_path, (t, noisy), sensor), folder=tmp_path)
    (tmp_path / "rig.toml").write_text(draft.text, encoding="utf-8")
    fit = fracid.identify(fracid.load_project(tmp_path / "rig.toml"))
    low, high = fit.orders["mu"].interval95
    [rmse] = fit.recordings[sensor].rmse.values()
    assert rmse < 5e-3 * np.ptp(signals[sensor])  # the acceleration has no value at a start of order 0.97
    assert abs(fit.orders["mu"].value - 0.97) < max(3 * least, high - low)
