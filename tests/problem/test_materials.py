"""Recordings of materials: uneven samples, standard deviations, rates of what was measured, other models beside."""

from dataclasses import replace

import numpy as np
import pytest

import fracid
from fracid.errors import InputError
from fracid.models.joints import Complement
from fracid.problem import Free
from helpers.materials import NU, strip


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    return fracid.load_project(strip(tmp_path_factory.mktemp("strip")), trust=True)


def changed(tmp_path, old, new):
    path = strip(tmp_path)
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")
    return path


def refusal(path):
    with pytest.raises((InputError, fracid.errors.DataError)) as refused:
        fracid.load_project(path, trust=True)
    return str(refused.value)


def test_samples_stay_where_they_are_and_the_model_is_stepped_by_the_smallest_distance(project):
    fast, _ = project.problem.experiments
    assert len(fast.measured) == len(fast.times) == 61
    assert fast.step == pytest.approx(0.01)
    assert len(fast.inputs) == fast.steps + 1
    assert 0 <= fast.steps * fast.step - fast.times[-1] < fast.step


def test_the_rate_of_a_measured_length_is_the_slope_between_its_samples(project):
    fast, slow = project.problem.experiments
    for e, ramp in ((fast, 0.2), (slow, 5.0)):
        n = round(ramp / e.step)
        np.testing.assert_allclose(e.inputs[:n, 1], 0.5 / ramp, rtol=1e-9)
        np.testing.assert_allclose(e.inputs[n + 1 :, 1], 0.0, atol=1e-12)
        assert e.between["speed"] == "hold"


@pytest.mark.broad
def test_errors_are_counted_in_the_standard_deviations_of_the_samples(project):
    problem = replace(project.problem, orders={"nu": NU}, parameters={"k": 2.0, "c": 5.0})
    together = np.concatenate(problem.errors(problem.start))
    assert 0.8 < np.std(together) < 1.2
    plain = replace(problem, experiments=tuple(replace(e, deviation=None) for e in problem.experiments))
    for e, r, raw in zip(problem.experiments, problem.errors(problem.start), plain.errors(problem.start), strict=True):
        np.testing.assert_allclose(r * e.deviation, raw)


def test_a_part_of_an_uneven_record_has_the_inputs_up_to_its_last_sample(project):
    part = project.problem.experiments[0].until(5.0)
    assert part.times[-1] <= 5.0 < project.problem.experiments[0].times[len(part.times)]
    assert len(part.inputs) == part.steps + 1
    assert np.isfinite(replace(project.problem, experiments=(part,)).cost(project.problem.start))


def test_a_springpots_order_is_an_order_by_name(project):
    model = project.problem.model
    assert model.order_names == ("nu",)
    assert model.state_orders({"nu": 0.25}).tolist() == [0.75]
    assert project.problem.orders["nu"] == Free(0.5, 0.02, 1.0)
    with pytest.raises(InputError, match=r"nu = 1.2: a springpot's lies between 0, a spring, and 1, a dashpot"):
        model.state_orders({"nu": 1.2})
    with pytest.raises(InputError, match=r"a springpot's order lies between 0, a spring, and 1"):
        replace(project.problem, orders={"nu": Free(0.5, 0.1, 1.5)})
    assert isinstance(model.orders[0], Complement)


def test_a_short_relaxation_is_stepped_without_loss(project):
    """Of τ = step/10 the spring's part of the length is τ·speed over a ramp, whatever the step."""
    model = project.alternatives["a Maxwell element"].model
    time = np.arange(0, 1, 0.01)
    run = fracid.simulate(model, orders={}, parameters={"c": 5.0, "tau": 1e-3}, initial={}, step=0.01, end=0.99,
                          inputs=np.column_stack([time, np.ones_like(time)]))  # fmt: skip
    np.testing.assert_allclose(time[20:] - run.states[20:, 0], 1e-3, rtol=2e-2)


def test_samples_that_crowd_stay_where_they_are_whether_the_project_says_so_or_not(project, tmp_path):
    unsaid = fracid.load_project(changed(tmp_path, 'resample = "uneven"\n', ""), trust=True)
    for e, said in zip(unsaid.problem.experiments, project.problem.experiments, strict=True):
        np.testing.assert_array_equal(e.times, said.times)
    on_a_grid = fracid.load_project(changed(tmp_path, 'resample = "uneven"\n', "resample = 0.1\n"), trust=True)
    assert all(e.times is None for e in on_a_grid.problem.experiments)


def test_a_recording_of_crowded_samples_is_checked_as_it_is_fitted(tmp_path):
    strip(tmp_path)
    report = fracid.load_recording(tmp_path / "fast.csv").report
    assert dict(report.rows())["jitter"] == "uneven: a fit takes the samples where they are"
    assert not report.warnings
    t = np.arange(200.0) + np.random.default_rng(1).uniform(0, 0.2, 200)
    jitters = fracid.Recording.of("log", t, {"x": np.cos(t)}).report
    assert "a fit resamples it to a uniform grid" in " ".join(jitters.warnings)


def test_a_rate_and_a_held_position_contradict_each_other(tmp_path):
    path = changed(tmp_path, '"L", unit = "m"', '"L", unit = "m", between = "hold"')
    assert "the model takes the rate of length too" in refusal(path)


def test_a_standard_deviation_of_zero_is_refused_with_its_time(tmp_path):
    path = strip(tmp_path)
    rows = (tmp_path / "fast.csv").read_text(encoding="utf-8").splitlines()
    rows[3] = ",".join([*rows[3].split(",")[:3], "0"])
    (tmp_path / "fast.csv").write_text("\n".join(rows), encoding="utf-8")
    assert "fast: a standard deviation is 0 at 0.02 s; expected numbers above 0" in refusal(path)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("[alternative.parameters]", "[alternative.orders]\nq = 0.5\n[alternative.parameters]", "unknown order"),
        ('name = "a Maxwell element"\n', "", "[[alternative]] number 1: name is missing"),
        ('model = "model.py:relaxation"', 'model = "model.py:relaxation"\nkind = 3', "kind is unknown"),
    ],
)
def test_an_alternative_that_cannot_be_is_refused(tmp_path, old, new, says):
    assert says in refusal(changed(tmp_path, old, new))


EQUATIONS = """[alternative.equations]
y = "(length - y)/tau"
[alternative.outputs]
force = { equals = "k*length + c*(length - y) + 0*speed", unit = "N" }
[alternative.parameters]"""


@pytest.mark.broad
def test_an_alternative_may_be_equations_of_the_models_inputs(project, tmp_path):
    text = strip(tmp_path).read_text(encoding="utf-8")
    written = text.replace('model = "model.py:relaxation"\n', "").replace("[alternative.parameters]", EQUATIONS)
    (tmp_path / "own.toml").write_text(written, encoding="utf-8")
    [own], [other] = (
        p.alternatives.values() for p in (fracid.load_project(tmp_path / "own.toml", trust=True), project)
    )
    assert own.model.input_rates == {"speed": "length"}
    assert own.cost(own.start) == pytest.approx(other.cost(other.start), rel=2e-3)  # the other's state knows its time
    (tmp_path / "strip.toml").write_text(text.replace('model = "model.py:relaxation"\n', ""), encoding="utf-8")
    assert "its equations, [alternative.equations]; one of the two" in refusal(tmp_path / "strip.toml")


def test_one_stamp_that_is_off_does_not_set_the_step_nor_does_rounding_end_a_run_early(tmp_path):
    path = strip(tmp_path)
    time = np.append(np.arange(3001) * 0.02, 60.021)
    force = np.column_stack([time, np.minimum(time, 0.5), time, np.ones_like(time)])
    np.savetxt(tmp_path / "fast.csv", np.insert(force, 1500, force[1499] + [1e-4, 0, 0, 0], axis=0), delimiter=",",
               header="time,L,F,SD", comments="", fmt="%.10g")  # fmt: skip
    problem = fracid.load_project(path, trust=True).problem
    assert problem.experiments[0].step == pytest.approx(0.02)
    assert np.isfinite(problem.cost(problem.start))


def test_an_input_that_does_not_change_is_a_number_and_time_may_begin_at_the_first_sample(tmp_path):
    path = changed(tmp_path, '"L", unit = "m" }', '"L", unit = "m" }\nspeed = { constant = 20.0, unit = "1" }')
    clock = 'time = { column = "time", zero = "first" }\nforce ='
    path.write_text(path.read_text(encoding="utf-8").replace("force =", clock), encoding="utf-8")
    rows = np.loadtxt(tmp_path / "fast.csv", delimiter=",", skiprows=1)
    rows[:, 0] += 7.0
    np.savetxt(tmp_path / "fast.csv", rows, delimiter=",", header="time,L,F,SD", comments="")
    fast, _ = fracid.load_project(path, trust=True).problem.experiments
    assert fast.start == 0.0
    assert np.all(fast.inputs[:, 1] == 20.0)


@pytest.mark.broad
def test_the_order_is_found_and_claimed_against_the_alternative(project):
    fit = fracid.identify(project)
    low, high = fit.orders["nu"].interval95
    assert low < NU < high
    assert fit.claim == "fractional", fit.claim_reasons
    trials = {t.name: t for t in fit.alternative.trials}
    assert trials["a Maxwell element"].cost > 1.3 * fit.cost
    assert fit.recordings["fast"].cost == pytest.approx(1.0, abs=0.3)  # in standard deviations
    assert fracid.residual_analysis(fit.recordings["slow"], "force").whiteness.white


@pytest.mark.broad
def test_a_model_without_friction_is_compared_with_its_alternatives(project):
    comparison = fracid.compare(project, leave_one_out=True)
    assert [row.name for row in comparison.rows] == [
        "springpot, orders 1", "springpot, orders free", "a Maxwell element, orders 1",
    ]  # fmt: skip
    best = comparison.best(fractional=True)
    assert all(best.held_out[n].error < row.held_out[n].error for row in comparison.rows[2:] for n in row.held_out)
    assert " N)" in comparison.verdict
    assert {"rmse", "unit"} <= comparison.lines()[0].keys()
    assert comparison.claim == "fractional", comparison.claim_reasons
