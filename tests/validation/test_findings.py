"""Each fault of docs/honesty.md is made on purpose, and said with a number beyond its limit; without it nothing is."""

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import fracid
from fracid.errors import Failure, FailureReason
from fracid.estimation.covariance import half_width, uncertainty
from fracid.estimation.curvature import curvature, newton_step, start_shift
from fracid.estimation.horizons import Watch, refined
from fracid.estimation.minimum import settled
from fracid.identification import identify
from fracid.models import Parameter
from fracid.models.library import from_library
from fracid.models.written.equations import Equation, Equations
from fracid.problem import Experiment, Free, Prior, Problem, Sensor
from fracid.problem.costs import COSTS
from fracid.recording import Recording
from fracid.solver.memory import compressed, full, short
from fracid.validation.after_search import after, between_samples, noisy_start, with_start
from fracid.validation.before_search import before
from fracid.validation.discretisation import _judged
from fracid.validation.reversed_signs import _most_moved
from fracid.validation.sensor_faults import FORMS, Misreading, _fix, misreadings
from twins import COUNT, angles

pytestmark = pytest.mark.usefixtures("without_rivals")

RIG = fracid.rotary_pendulum("srv02-rotpen", coulomb_alpha=2e-4)
ORDERS = {"lambda": Free(0.97, 0.5, 1.2), "mu": Free(0.98, 0.5, 1.2)}
FREE = {n: Free(RIG.parameter(n).value, 0.3 * RIG.parameter(n).value, 3 * RIG.parameter(n).value) for n in ("C1", "C3")}
C1 = FREE["C1"].start
STEP = 5e-3
HELD = {"initial_state": "held", "initial": {"theta": 0.0, "alpha": 0.6}}
PAGE = Path(__file__).parents[2] / "docs" / "honesty.md"


def release(alpha=0.6, end=8.0, model=RIG, step=STEP, inputs=None, orders=(0.95, 0.97), seed=1):
    """θ and α of a release, as encoders of 4096 counts a turn read them with a little noise [rad], shape (n, 2)."""
    return angles(model, orders=dict(zip(ORDERS, orders, strict=True)), alpha=alpha, step=step, end=end, inputs=inputs,
                  noise=5e-4, seed=seed, counts=True)  # fmt: skip


def problem(y, model=RIG, step=STEP, inputs=None, **options):
    outputs = options.pop("outputs", ("theta", "alpha"))
    columns = np.column_stack([y[:, ("theta", "alpha").index(o)] for o in outputs])
    e = Experiment("swing", step, columns, np.zeros((1, 1)) if inputs is None else inputs,
                   initial=options.pop("initial", {}))  # fmt: skip
    return Problem(model, (e,), **{"orders": ORDERS, "parameters": FREE, "outputs": outputs} | options)


def codes(found):
    return [f.code for f in found]


def sole(found, code):
    """The one finding, of that code, whose number is beyond its limit."""
    assert codes(found) == [code] * len(found)
    assert len(found) >= 1
    return found[0]


# --- a recording alone ----------------------------------------------------------------------------------

T = np.arange(0, 12, 0.01)


def swing(degrees, frequency=1.1, decay=6.0):
    """A decaying swing [rad], without an encoder."""
    return np.radians(degrees) * np.cos(2 * np.pi * frequency * T) * np.exp(-T / decay)


def pendulum(degrees, frequency=1.1, decay=8.0):
    """A decaying swing of a pendulum [rad], whose period is that of its size."""
    angle, rate, h, swings = np.radians(degrees), 0.0, T[1] / 20, []
    for k in range(20 * T.size):
        swings += [angle] * (k % 20 == 0)
        rate -= h * ((2 * np.pi * frequency) ** 2 * np.sin(angle) + 2 * rate / decay)
        angle += h * rate
    return np.array(swings)


def counted(x, counts=4096):
    return 2 * np.pi / counts * np.rint(x * counts / (2 * np.pi))


def clipped(x, limit):
    return np.clip(x, -limit, limit)


DATA_FAULTS = {
    "degrees read as radians, by the encoder": ("degrees-as-radians", {"alpha": np.degrees(counted(swing(40)))}),
    "an arm in degrees, by the encoder": ("degrees-as-radians", {"theta": np.degrees(counted(swing(20)))}),
    "degrees read as radians, without one": ("degrees-as-radians", {"alpha": np.degrees(swing(12))}),
    "radians read as degrees, by the encoder": ("radians-as-degrees", {"alpha": np.radians(counted(swing(92)))}),
    "radians read as degrees, without one": ("radians-as-degrees", {"alpha": np.radians(swing(85))}),
    "radians read as degrees, by their period": ("radians-as-degrees", {"alpha": np.radians(pendulum(115))}),
    "an encoder that goes no further": ("saturated", {"alpha": clipped(counted(swing(60)), counted(np.radians(45)))}),
    "a sensor without steps that goes no further": ("saturated", {"alpha": clipped(swing(60), 0.7)}),
    "a motor at its limit": ("saturated", {"voltage": clipped(9 * np.sin(5 * T), 6.0), "alpha": swing(30)}),
    "too few samples a swing": ("aliased", {"alpha": swing(40, frequency=20.0)}),
    "samples that a logger repeats": ("repeated", {"alpha": counted(swing(80))[np.arange(T.size) // 3 * 3]}),
    "a sensor that goes no further, to one side once": (
        "saturated",
        {"alpha": clipped(swing(60, decay=0.8), 0.5)},
    ),
    "a line near Nyquist's frequency": ("aliased", {"alpha": swing(40) + 0.15 * np.sin(2 * np.pi * 43 * T)}),
}
NUMBERS = {  # what theory says the number is
    "degrees read as radians, by the encoder": 4096 * np.pi / 180,
    "radians read as degrees, by the encoder": 4096 * 180 / np.pi,
    "too few samples a swing": 5.0,
}


@pytest.mark.parametrize("fault", DATA_FAULTS)
def test_a_fault_of_the_samples_is_said(fault):
    code, signals = DATA_FAULTS[fault]
    units = {n: "V" if n == "voltage" else "rad" for n in signals}
    report = Recording.of("swing", T, signals, units).report
    found = sole(report.findings, code)
    assert found.number != pytest.approx(found.limit)
    assert (found.number < found.limit) == (found.unit in ("samples a swing", "counts a turn", "degrees to each side")
                                            and found.number < found.limit)  # fmt: skip
    assert found.number == pytest.approx(NUMBERS.get(fault, found.number), rel=0.02)
    assert str(found) in report.warnings
    assert report.level == "usable"
    assert json.loads(json.dumps(report.to_dict()))["findings"][0]["code"] == code


PLATEAU = np.where(T < 3, np.radians(60), swing(60)[np.maximum(0, np.arange(T.size) - 300)])
SHAKEN = PLATEAU + np.where(T < 3, 1e-3 * np.random.default_rng(1).standard_normal(T.size), 0.0)


@pytest.mark.parametrize(
    ("what", "signals"),
    {
        "a swing read by an encoder": {"alpha": counted(swing(92))},
        "a coarse encoder": {"alpha": counted(swing(92), 1024)},
        "a swing without an encoder": {"alpha": swing(92)},
        "a small swing": {"alpha": counted(swing(6))},
        "a pendulum's large swing": {"alpha": counted(pendulum(115))},
        "a pendulum's swing of two degrees": {"alpha": pendulum(2)},
        "a held plateau": {"alpha": counted(PLATEAU)},
        "a plateau that a hand shakes": {"alpha": counted(SHAKEN)},
        "a noisy swing read by an encoder": {
            "alpha": counted(swing(90) + 2e-3 * np.random.default_rng(1).standard_normal(T.size))
        },
        "an arm that sticks and slips": {"theta": counted(np.cumsum(np.maximum(0, np.sin(T)) > 0.5) * 2e-3)},
        "much noise": {"alpha": swing(40) + 0.1 * np.random.default_rng(1).standard_normal(T.size)},
        "an arm that turns and turns back": {"theta": 20 * np.sin(T), "alpha": swing(40)},
        "a pendulum that goes over the top": {"alpha": np.where(T < 5, 6 * T, 30 + swing(90))},
        "a motor told to jump": {"voltage": 5.0 * np.sign(np.sin(3 * T)), "alpha": swing(40)},
        "a motor's sine": {"voltage": np.round(5.0 * np.sin(3 * T), 2), "alpha": swing(40)},
        "a motor's pulse": {"voltage": np.where((T > 1) & (T < 2), 10.0, 0.0), "alpha": swing(40)},
        "an arm that stands still": {"theta": np.zeros(T.size), "alpha": swing(40)},
        "a release whose end is at rest": {"alpha": counted(PLATEAU * (T < 9))},
        "few counts": {"alpha": counted(swing(2), 500)},
    }.items(),
    ids=lambda v: v if isinstance(v, str) else "",
)
def test_a_good_recording_has_no_finding(what, signals):
    units = {n: "V" if n == "voltage" else "rad" for n in signals}
    assert codes(Recording.of("swing", T, signals, units).report.findings) == []


def test_a_pendulum_that_never_moves_is_said_to_be_still():
    report = Recording.of("swing", T, {"theta": swing(10), "alpha": np.full(T.size, 0.1)}).report
    assert str(sole(report.findings, "still")).startswith("alpha: it stays at 5.73° throughout")
    assert report.verdict.startswith("unfit: alpha: it stays at 5.73° throughout")


def test_a_swing_that_is_damped_within_two_and_goes_on_to_creep_is_not_too_short():
    t = np.arange(0, 20, 0.004)
    after = np.maximum(t - 1, 0)
    creep = 0.02 * after / (1 + after) ** 1.8
    alpha = np.where(t < 1, 0.2, 0.2 * np.exp(-2 * after) * np.cos(9 * after) + creep)
    noise = 1e-3 * np.random.default_rng(1).standard_normal((2, t.size))
    signals = {"theta": 0.1 * np.minimum(after, 1) / (1 + after) + noise[0], "alpha": alpha + noise[1]}
    assert "short-window" not in codes(Recording.of("swing", t, signals).report.findings)


def test_a_release_at_the_end_of_a_recording_is_too_short():
    found = sole(Recording.of("swing", T[:390], {"alpha": counted(PLATEAU)[:390]}).report.findings, "short-window")
    assert (found.number, found.limit) == (pytest.approx(1.0, abs=0.5), 3)
    assert "It ends 0.8" in str(found)


def test_what_an_input_sets_in_motion_is_not_called_released():
    volts = np.where((T > 3) & (T < 4), 10.0, 0.0)
    report = Recording.of("swing", T, {"voltage": volts, "alpha": PLATEAU}, {"voltage": "V", "alpha": "rad"}).report
    assert report.release == pytest.approx(3.0, abs=0.1)
    assert "set in motion by its input at 3" in report.verdict
    report = Recording.of("swing", T, {"push": volts, "alpha": PLATEAU}, {"push": "N", "alpha": "m"}).report
    assert "set in motion by its input at 3" in report.verdict
    later = np.where((T > 8) & (T < 9), 10.0, 0.0)
    report = Recording.of("swing", T, {"voltage": later, "alpha": PLATEAU}, {"voltage": "V", "alpha": "rad"}).report
    assert "released at 3" in report.verdict


def test_an_encoders_turning_points_are_no_saturation_however_slow_the_swing():
    for frequency in (0.05, 0.1, 0.3, 1.0):
        for counts in (512, 4096, 65536):
            slow = counted(swing(60, frequency, decay=1e6), counts)
            assert "saturated" not in codes(Recording.of("slow", T, {"alpha": slow}).report.findings)


# --- a project, before the search -------------------------------------------------------------------------

GOOD = release()
VOLTS = 3.0 * np.sin(2 * np.pi * 0.9 * STEP * np.arange(len(GOOD)))[:, None]
MOTOR = fracid.rotary_pendulum("srv02-rotpen", b_theta=0.07)
DRIVEN = release(alpha=0.1, model=MOTOR, inputs=VOLTS)


def turned(y, column):
    return y * np.where(np.arange(2) == column, -1.0, 1.0)


@pytest.mark.broad
def test_a_good_project_has_no_finding_and_its_fit_none():
    for good in (problem(GOOD), problem(DRIVEN, MOTOR, inputs=VOLTS), problem(GOOD, outputs=("alpha",))):
        assert codes(before(good)) == []
    for options in ({"method": "gl"}, {"substeps": 3}, {"initial_state": "held"}, {"weights": "noise"}):
        assert codes(before(problem(GOOD, **options))) == []
    fit = identify(problem(GOOD, **HELD))
    assert codes(fit.findings) == []
    assert fit.to_json()["findings"] == []


UPRIGHT = fracid.rotary_pendulum("srv02-rotpen", zero="upright")

TURNED = np.array([0.0, np.pi])

PROJECT_FAULTS = {
    "upright given as hanging": ("wrong-zero", 180.0, lambda: problem(GOOD + TURNED)),
    "turns and a half away": ("wrong-zero", 180.0, lambda: problem(GOOD - 5 * TURNED)),
    "hanging given as upright": ("wrong-zero", 180.0, lambda: problem(GOOD, UPRIGHT)),
    "still swinging, about upright": ("wrong-zero", 180.0, lambda: problem((GOOD + TURNED)[:900])),
    "thirty degrees off": ("wrong-zero", 30.0, lambda: problem(GOOD + TURNED / 6)),
    "theta's sign": ("wrong-sign", None, lambda: problem(turned(GOOD, 0))),
    "alpha's sign": ("wrong-sign", None, lambda: problem(turned(GOOD, 1))),
    "theta's sign, driven": ("wrong-sign", None, lambda: problem(turned(DRIVEN, 0), MOTOR, inputs=VOLTS)),
    "alpha's sign, driven": ("wrong-sign", None, lambda: problem(turned(DRIVEN, 1), MOTOR, inputs=VOLTS)),
    "degrees": ("degrees-as-radians", 4096 * np.pi / 180, lambda: problem(np.degrees(GOOD))),
    "radians as degrees": ("radians-as-degrees", 4096 * 180 / np.pi, lambda: problem(np.radians(GOOD))),
    "steps too long for the scheme": ("stiff", None, lambda: problem(
        GOOD, fracid.rotary_pendulum("srv02-rotpen", coulomb_theta=0.5, slip_speed=5e-3), method="gl")),
    "steps too few for a period": ("coarse-steps", None, lambda: problem(GOOD[::16], step=16 * STEP)),
}  # fmt: skip


@pytest.mark.few(3)
@pytest.mark.parametrize("fault", PROJECT_FAULTS)
def test_a_fault_of_the_project_is_said_before_the_search(fault):
    code, number, made = PROJECT_FAULTS[fault]
    found = sole(before(made()), code)
    assert found.where.startswith("swing")
    if number is not None:
        assert found.number == pytest.approx(number, rel=0.02)
    if code in ("wrong-zero", "wrong-sign", "stiff"):
        assert found.number > found.limit
    if code == "coarse-steps":
        assert found.number < found.limit == 20


def test_a_step_that_the_fit_chooses_is_not_judged_before_it_has(tmp_path):
    assert before(problem(GOOD[::16], step=16 * STEP), fixed_step=False) == ()
    time, heard = np.arange(0, 4, 0.08), []
    np.savez(tmp_path / "swing.npz", time=time, alpha=0.3 * np.exp(-0.1 * time) * np.cos(12 * time))
    text = """
[model.orders]
lambda = 1.0
mu = { start = 1.0, lower = 0.9, upper = 1.1 }
[[recording]]
file = "swing.npz"
alpha = { column = "alpha", unit = "rad" }
initial = { alpha = 0.3 }
[fit]
initial_state = "held"
"""
    for more, said in (("substeps = 1\n", 1), ("", 0)):
        (tmp_path / "rig.toml").write_text(text + more, encoding="utf-8")
        observer = fracid.Observer(notice=heard.append)
        fracid.run(tmp_path / "rig.toml", out=tmp_path / f"run{said}", figures=False, observer=observer)
        assert sum("steps a period" in notice for notice in heard) == said
        heard.clear()


def test_the_check_of_the_step_names_each_parameter_that_moves_by_more_than_its_interval():
    p = problem(GOOD[::4], step=4 * STEP)
    known, x = uncertainty(p, p.start), p.start
    halves = np.array([half_width(known, x, i) for i in range(len(x))])
    finer = x + halves * np.append([0.0, 2.0, 0.5, -3.0], np.zeros(len(x) - 4))
    said = _judged(p, x, known, (1.0, 1.0, 1.0), finer, substeps=1).warning
    assert ("λ" in said, "μ moves by +" in said, "C1" in said) == (False, True, False)
    assert re.search(r"Parameters that move too: C3 by −\S+\. Type substeps = 2 in \[fit\]\.$", said)


def test_the_check_of_the_step_names_no_interval_that_the_result_may_not_have():
    p = problem(GOOD[::4], step=4 * STEP)
    for known in (uncertainty(p, p.start), Failure(FailureReason.NO_FIT, "the model does not fit")):
        said = _judged(p, p.start, known, (1.0, 1.0, 1.0), p.start + 0.5, substeps=1).warning
        assert said.startswith("λ moves by +0.5")
        assert not re.search("interval|±", said)


def test_what_does_not_swing_is_not_asked_for_swings_nor_what_swings_under_a_name_that_is_empty():
    short_one, units = {"alpha": counted(PLATEAU)[:390]}, {"alpha": "V"}
    assert "short-window" not in codes(Recording.of("tank", T[:390], short_one, units).report.findings)
    reports = {"swing": Recording.of("swing", T[:390], short_one).report}
    relaxing = from_library("capacitor")
    for model, column, found in ((RIG, "alpha", ["swing"]), (relaxing, "voltage", [])):
        e = Experiment("swing", 0.01, short_one["alpha"][:, None], np.zeros((390, 1)))
        orders = dict.fromkeys(model.order_names, 1.0)
        asked = Problem(model, (e,), orders, outputs=(column,), initial_state="held")
        assert [f.where for f in before(asked, reports) if f.code == "short-window"] == found


def test_a_recording_that_an_input_of_the_model_drives_is_no_release_that_is_too_short():
    signals = {"angle": counted(PLATEAU)[:390], "torque": np.where(T[:390] > 3, np.sin(9 * T[:390]), 0.0)}
    report = Recording.of("swing", T[:390], signals, {"angle": "rad", "torque": "1"}).report
    assert "short-window" in codes(report.findings)
    e = Experiment("swing", 0.01, signals["angle"][:, None], np.outer(signals["torque"], [1.0, 0.0, 0.0, 0.0]))
    asked = Problem(fracid.model("joint"), (e,), {"mu": 1.0}, initial_state="held")
    assert "short-window" not in codes(before(asked, {"swing": report}))


def several(*signals):
    """A problem of recordings ``swing 1``, ``swing 2``, …"""
    p = problem(GOOD)
    return replace(p, experiments=tuple(replace(p.experiments[0], name=f"swing {k}", measured=y)
                                        for k, y in enumerate(signals, 1)))  # fmt: skip


OTHER = release(0.9, seed=2)


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("signals", "where"),
    [
        ((GOOD, turned(OTHER, 0)), "swing 2: theta"),
        ((turned(GOOD, 1), OTHER), "swing 1: theta"),
        ((turned(GOOD, 0), turned(OTHER, 0)), "swing 1, swing 2: theta"),
    ],
)
def test_a_sign_is_wrong_in_any_of_several_recordings(signals, where):
    found = sole(before(several(*signals)), "wrong-sign")
    assert found.where == where
    assert "the sign of theta or alpha reversed" in found.sentence  # undriven, nobody can tell which
    assert codes(before(several(GOOD, OTHER))) == []


def test_a_sign_is_looked_for_in_samples_that_lie_unevenly():
    p = problem(turned(GOOD, 0))
    uneven = replace(p.experiments[0], times=p.experiments[0].time)
    assert (
        "the sign of theta or alpha reversed" in sole(before(replace(p, experiments=(uneven,))), "wrong-sign").sentence
    )


@pytest.mark.broad
def test_a_sign_is_found_from_a_start_that_lacks_most_of_the_friction_and_is_no_delay():
    damped = RIG.with_parameters(b_theta=0.05, coulomb_theta=0.02, b_alpha=1e-3)
    start = {"b_theta": Free(0.0024, 0.0, 0.2), "coulomb_theta": Free(0.002, 0.0, 0.2), "b_alpha": Free(3e-4, 0.0, 0.2)}
    y = release(1.0, model=damped, step=2e-3, end=6.0)
    turned_round = problem(turned(y, 1), step=2e-3, parameters=FREE | start)
    assert codes(before(problem(y, step=2e-3, parameters=FREE | start))) == []
    assert codes(before(turned_round)) == ["wrong-sign"]
    fit = fracid.identify(turned_round)
    assert "late" not in codes(fit.findings)


@pytest.mark.broad
def test_of_many_recordings_those_that_move_most_are_asked_for_their_signs():
    small = [release(0.2 + 0.03 * k, seed=k) for k in range(8)]
    assert codes(before(several(*small, turned(OTHER, 0)))) == ["wrong-sign"]
    many = several(*small, GOOD, OTHER)
    assert [e.name for e in _most_moved(many)] == [f"swing {k}" for k in range(3, 11)]


def test_what_to_type_mends_it():
    """The substeps, the zero and the sign that a finding asks for leave nothing to be found."""
    coarse = problem(GOOD[::16], step=16 * STEP)
    typed = int(re.search(r"substeps = (\d+)", before(coarse)[0].sentence)[1])
    assert codes(before(replace(coarse, substeps=typed))) == []
    assert "add 3.14159 to the zero" in before(problem(GOOD + TURNED))[0].sentence
    assert 'zero = "upright"' in before(problem(GOOD + TURNED))[0].sentence
    assert codes(before(problem(turned(GOOD, 1) + TURNED, UPRIGHT))) == []
    assert "sign = -1" in before(problem(turned(GOOD, 0)))[0].sentence


def test_a_pendulum_held_upright_by_its_motor_is_no_wrong_zero():
    t = STEP * np.arange(1600)
    y = np.column_stack([0.1 * np.sin(t), np.pi + 0.01 * np.sin(5 * t)])
    held = problem(y, inputs=np.sin(7 * t)[:, None])
    assert "wrong-zero" not in codes(before(held))


def test_both_angles_turned_round_are_the_same_rig():
    assert codes(before(problem(-GOOD))) == []


def test_of_an_output_that_is_no_angle_no_degrees_are_asked():
    """An array has no unit, and an own model that says none may be a battery's."""

    def cell(t, x, u, p, out):
        out[0] = -p[0] * x[0]

    own = fracid.Model("cell", cell, ("v",), ("q",), {"V": 0}, (), (fracid.Parameter("k", "1/s", 0.1, "leak"),), "", "")
    time = np.arange(2000) * STEP
    record = fracid.Recording.of("cell", time, {"V": 6 * np.cos(6 * time)})
    e = fracid.Experiment.of(record, own, ["V"], {"v": 6.0})
    assert not before(Problem(own, (e,), {"q": ORDERS["mu"]}, outputs=("V",)))


def test_a_signal_without_a_unit_has_the_models():
    t = np.arange(2000) * 0.01
    wobble = np.clip(np.sin(6 * t), -0.5, 0.5)[:, None]
    e = fracid.Experiment("stops", 0.01, wobble, np.clip(np.sin(t), -0.4, 0.4)[:, None])
    said = " ".join(map(str, before(Problem(fracid.model("oscillator"), (e,), {"mu": 1.0}))))
    assert "displacement: it stays at 0.5 m," in said
    assert "force: it stays at 0.4 N," in said


@pytest.mark.parametrize(("output", "zero"), [("beta", ""), ("alpha", "hanging")])
def test_a_model_of_ones_own_that_falls_where_the_recording_rests_is_named(output, zero):
    def inverted(t, x, u, p, out):
        out[0] = x[1]
        out[1] = p[0] * math.sin(x[0]) - 0.4 * x[1]

    own = fracid.Model(
        name="pole", rhs=inverted, states=(output, "D^mu"), orders=("mu", "mu"), outputs={output: 0}, inputs=(),
        parameters=(fracid.Parameter("stiffness", "1/s^2", 40.0, "g over length"),), zero=zero, source="a test",
    )  # fmt: skip
    e = Experiment("swing", STEP, GOOD[:, [1]], np.zeros((1, 0)))
    found = sole(before(Problem(own, (e,), {"mu": ORDERS["mu"]}, outputs=(output,))), "wrong-zero")
    assert found.number == pytest.approx(np.sqrt(40.0) - 0.2, rel=0.02)  # e-fold growth: λ² + 0.4 λ = 40


# --- a minimum --------------------------------------------------------------------------------------------


def minimum(p):
    """Of a problem whose start is next to it, with what is known there."""
    x = refined(p, p.start, Watch()).best.point
    return x, uncertainty(p, x)


@pytest.mark.few(1)
@pytest.mark.parametrize(("memory", "moved"), [(compressed(1e-2), "lambda mu"), (compressed(1e-3), "lambda mu"),
                                               (short(20), "mu")], ids=lambda v: getattr(v, "name", ""))  # fmt: skip
def test_a_memory_that_is_too_loose_is_said_with_how_far_it_moves_the_orders(memory, moved):
    loose, good = (problem(GOOD, memory=m, parameters={}, **HELD) for m in (memory, full()))
    (x, known), (best, _) = minimum(loose), minimum(good)
    found = [f for f in after(loose, x, known) if f.code == "loose-memory"]
    assert [f.where for f in found] == moved.split()
    for f in found:  # what the projection says, another search finds
        i = loose.names.index(f.where)
        assert f.number > f.limit == 1.0
        half = max(1e-4, 1.96 * known.standard_error[i])
        assert f.number * half == pytest.approx(abs(x[i] - best[i]), rel=0.4)


@pytest.mark.few(1)
@pytest.mark.parametrize("memory", [compressed(1e-10), compressed(1e-6), full()])
def test_a_memory_that_is_tight_enough_is_not_blamed(memory):
    good = problem(GOOD, memory=memory, parameters={}, **HELD)
    assert codes(after(good, *minimum(good))) == []


SWING = fracid.simulate(RIG, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=8e-3, end=6.0)


def held(seed, state="held", noise=1e-3, **options):
    """A swing with white noise whose start is taken from it, and its minimum."""
    y = SWING.states[:, [0, 2]] + noise * np.random.default_rng(seed).standard_normal((len(SWING.time), 2))
    e = Experiment("swing", 8e-3, y, np.zeros((1, 1)), **options)
    p = Problem(RIG, (e,), {n: Free(v, 0.5, 1.2) for n, v in (("lambda", 0.9), ("mu", 0.95))}, initial_state=state)
    return p, *minimum(p)


@pytest.mark.broad
def test_a_start_that_is_taken_from_a_noisy_sample_spoils_the_intervals_where_it_is_said_and_nowhere_else():
    """Of intervals whose unknown its start's noise moves by less than half of them, all but 5 % hold the truth."""
    inside, beyond = [], []
    for seed in range(16):
        p, x, known = held(seed)
        found = curvature(p, x, np.arange(2))
        times = start_shift(p, x, found, {"swing": np.full(2, 1e-3)}) / known.standard_error
        for i, true in enumerate((0.9, 0.95)):
            holds = abs(x[i] - true) < 1.96 * known.standard_error[i]
            (beyond if times[i] > 1 else inside).append(holds)
        said = noisy_start(p, x, with_start(p, x, known))
        assert bool(said) == bool(np.any(times > 1.1)) or np.max(times) < 1.1
    assert np.mean(inside) > 0.9
    assert np.mean(beyond) < 0.8
    assert min(len(inside), len(beyond)) > 5


@pytest.mark.few(1)
@pytest.mark.parametrize("state", ["held", "measured"])
def test_the_shift_by_the_start_is_what_another_start_finds(state):
    """Noise in the samples of the start alone: the minimum moves by G ε, whose spread the projection foretells."""
    p, _, _ = held(0, "held", 0.0)
    flat = p.experiments[0].measured.copy()
    flat[:5] = flat[0]  # the slope of its first samples is that of the start, 0
    p = replace(p, experiments=(replace(p.experiments[0], measured=flat),), initial_state=state)
    x, _ = minimum(p)
    sd = start_shift(p, x, curvature(p, x, np.arange(2)), {"swing": np.full(2, 1e-6)})
    moved = []
    for seed in range(24):
        y = flat.copy()
        y[:5] += 1e-6 * np.random.default_rng(seed).standard_normal((5, 2))
        other = replace(p, experiments=(replace(p.experiments[0], measured=y),))
        moved.append(refined(other, x, Watch()).best.point - x)
    assert len(p.experiments[0].slope_weights) == 5
    assert np.sqrt(np.mean(np.square(moved), axis=0)) == pytest.approx(sd, rel=0.35)


@pytest.mark.broad
@pytest.mark.parametrize("options", [{}, {"weights": "noise"}, {"cost_function": COSTS["huber"]}],
                         ids=["a valley", "levels", "huber"])  # fmt: skip
def test_a_search_that_stopped_short_is_said_with_how_far_it_is_from_the_minimum(options):
    p = problem(GOOD, **HELD, **options)
    x = refined(p, p.start, Watch(), tolerance=1e-12).best.point
    known = uncertainty(p, x)
    assert "stopped-short" not in codes(after(p, x, known))
    size, along = np.linalg.eigh(known.covariance / np.outer(known.standard_error, known.standard_error))
    valley = along[:, np.argmax(size)] * known.standard_error  # where the data tell least
    for far in (0.2, 0.8, 2.0):
        away = x + far * 1.96 * valley / np.max(np.abs(valley / known.standard_error))
        there = uncertainty(p, away)
        found = [f for f in after(p, away, there) if f.code == "stopped-short"]
        step, cost = newton_step(p, away, curvature(p, away, np.arange(len(x))))
        assert away + step == pytest.approx(x, abs=0.1 * np.max(1.96 * known.standard_error))
        assert np.max(np.abs(away + step - x) / known.standard_error) < 0.2
        assert cost == pytest.approx(p.cost(x), rel=1e-4)
        assert bool(found) == (far > 0.5)
        for f in found:
            i = p.names.index(f.where)
            assert f.number * there.standard_error[i] == pytest.approx(abs(away - x)[i] / 1.96, rel=0.1)
            assert f.limit == 0.5
            assert "stopped short of its minimum" in f.sentence


def test_a_prior_counts_in_where_the_minimum_is():
    p = problem(GOOD, parameters={"C1": replace(FREE["C1"], prior=Prior(1.002 * C1, 5e-4 * C1))}, **HELD)
    x = refined(p, p.start, Watch(), tolerance=1e-12).best.point
    known = uncertainty(p, x)
    assert "stopped-short" not in codes(after(p, x, known))
    step, _ = newton_step(p, x + 0.5 * known.standard_error, curvature(p, x + 0.5 * known.standard_error, np.arange(3)))
    assert step / known.standard_error == pytest.approx(-0.5, abs=0.05)


@pytest.mark.broad
def test_a_search_that_spends_its_budget_is_short_of_its_minimum_and_one_that_converges_is_not():
    far = {"lambda": Free(1.15, 0.5, 1.2), "mu": Free(0.8, 0.5, 1.2)}
    p = problem(GOOD, orders=far, **HELD)
    for budget, says in ((4, True), (8, True), (100, False)):
        x = refined(p, p.start, Watch(), budget=budget).best.point
        assert ("stopped-short" in codes(after(p, x, uncertainty(p, x)))) == says


@pytest.mark.broad
def test_a_start_that_is_found_or_named_has_no_noise():
    for state, initial in (("rest", {}), ("estimate", {}), ("held", {"theta": 0.0, "alpha": 0.3})):
        p, x, known = held(1, state, initial=initial)
        assert noisy_start(p, x, with_start(p, x, known)) == ()
    p, x, known = held(1)
    known = with_start(p, x, known)
    found = sole(noisy_start(p, x, known), "noisy-start")
    assert found.number > found.limit == 1.0
    assert 'Type initial_state = "rest" in [fit], or the start that you know: initial = {' in found.sentence
    assert "noise of 0.05" in found.sentence  # 1e-3 rad, as third differences measure it
    assert "noisy-start" not in codes(after(p, x, known))  # the intervals include it: a note, and no fault


def test_the_slope_at_the_start_is_the_same_by_its_weights():
    e = problem(GOOD).experiments[0]
    v = e.slope_weights
    assert v @ e.measured[: len(v)] == pytest.approx(e.first_values()[1], rel=1e-9)


def test_a_record_too_short_for_an_order_is_said_with_its_swings():
    short_one = problem(release(alpha=0.1)[:220], parameters={"b_alpha": Free(1e-3, -1e-1, 1e-1)}, outputs=("alpha",))
    fit = identify(short_one)
    found = [f for f in fit.findings if f.code == "short-window"]
    assert found
    assert all(f.number < f.limit for f in found)
    assert all(fit.orders[f.where].identifiable != "identifiable" for f in found)


def test_an_input_that_is_held_between_samples_is_said_with_what_to_type_and_a_late_one_is_not():
    slow, noise = VOLTS[::8], 5e-4 * np.random.default_rng(1).standard_normal((len(VOLTS[::8]), 2))
    late = {"inputs": np.roll(VOLTS, 12, axis=0)}
    for drive, code in (({"inputs": np.repeat(slow, 8, axis=0)[:1601], "between": "hold"}, "between"), (late, "late")):
        orders = dict.fromkeys(ORDERS, 0.96)
        run = fracid.simulate(MOTOR, orders=orders, initial={"alpha": 0.1}, step=STEP, end=8.0, **drive)
        p = problem(run.states[::8, [0, 2]] + noise, MOTOR, step=8 * STEP, inputs=slow, parameters={}, substeps=8,
                    initial_state="held", initial={"theta": 0.0, "alpha": 0.1})  # fmt: skip
        x = refined(p, p.start, Watch()).best.point
        known = uncertainty(p, x)
        found = between_samples(p, x, known)[1] or [f for f in after(p, x, known) if f.code == "late"]
        assert codes(found) == [code]
        assert ('between = "hold"' in str(found[0])) == (code == "between")


@pytest.mark.parametrize(("way", "noise"), [("line", 3e-3), ("hold", 3e-3), ("line", 1e-3)])
def test_what_a_current_does_between_its_samples_moves_a_resistance_so_its_interval_allows_for_both(way, noise):
    t, true = 0.1 * np.arange(900), {"C0": 15.0, "R": 0.05}
    current = np.interp(t, [5, 5.1, 25, 25.1, 45, 45.1, 65, 65.1], [0, 1, 1, 0, 0, -1, -1, 0])[:, None]
    run = fracid.simulate(from_library("capacitor"), orders={"q": 0.9}, parameters=true, initial={"v": 0.0}, step=0.1,
                          end=t[-1], inputs=current, between=way)  # fmt: skip
    y = run.states[:, [0]] + true["R"] * current + noise * np.random.default_rng(3).standard_normal((len(t), 1))
    e = Experiment("cell", 0.1, y, current, between={"current": "hold"})
    free = {n: Free(v, 0.1 * v, 10 * v) for n, v in true.items()}
    model = from_library("capacitor")
    model = replace(model, parameters=tuple(replace(q, unit="") for q in model.parameters))  # as a project's own may be
    p = Problem(model, (e,), {"q": Free(0.9, 0.6, 1.2)}, free, initial_state="rest")
    x = refined(p, p.start, Watch()).best.point
    narrow = uncertainty(p, x)
    known, found, notes = between_samples(p, x, narrow)
    i = p.names.index("R")
    assert (abs(x[i] - true["R"]) > 3 * half_width(narrow, x, i)) == (way == "line")
    assert abs(x[i] - true["R"]) < half_width(known, x, i)
    assert codes(found) == ["between"] * (noise < 3e-3)  # else nothing speaks against a claim
    assert "intervals allow for both" in str((*found, *notes)[0])
    assert " ." not in str((*found, *notes)[0])


def later(x, samples):
    n = np.arange(len(x))
    return np.interp(n - samples, n, x)


def spoilt(column, change):
    y = GOOD.copy()
    y[:, column] = change(y[:, column])
    return y


MISREAD = {
    "the pendulum read two samples later": ("late", "alpha", 2 * STEP, lambda: problem(
        spoilt(1, lambda x: later(x, 2)), **HELD)),
    "the arm read two samples later": ("late", "theta", 2 * STEP, lambda: problem(
        spoilt(0, lambda x: later(x, 2)), **HELD)),
    "a voltage that is recorded too late": ("late", "voltage", -2 * STEP, lambda: problem(
        DRIVEN, MOTOR, inputs=later(VOLTS[:, 0], 2)[:, None], initial_state="rest")),
    "a pendulum's angle that is too large": ("scaled", "alpha", 0.1 / 1.1, lambda: problem(
        spoilt(1, lambda x: 1.1 * x), **HELD)),
    "a zero that is half a degree off": ("off-zero", "alpha", np.radians(0.5), lambda: problem(
        spoilt(1, lambda x: x + np.radians(0.5)), initial_state="rest")),
    "a zero that drifts by a degree": ("drifts", "alpha", np.radians(1), lambda: problem(
        spoilt(1, lambda x: x + np.linspace(0, np.radians(1), len(x))), initial_state="rest")),
}  # fmt: skip


@pytest.mark.few(1)
@pytest.mark.parametrize("fault", MISREAD)
def test_a_signal_that_was_misread_is_said_with_how_much(fault):
    code, signal, size, made = MISREAD[fault]
    p = made()
    x, known = minimum(p)
    found = sole(after(p, x, known), code)
    assert found.where == signal
    assert found.number > found.limit
    best = max(misreadings(p, x, known), key=lambda m: m.share)
    assert best.size == pytest.approx(size, rel=0.15)


@pytest.mark.broad
def test_freeing_the_zero_that_a_finding_names_moves_the_orders_as_it_says():
    """The one step of Gauss and Newton is what another search finds with alpha_rest free."""
    p = problem(spoilt(1, lambda x: x + np.radians(0.5)), initial_state="rest")
    x, known = minimum(p)
    [zero] = [m for m in misreadings(p, x, known) if (m.code, m.signal) == ("off-zero", "alpha")]
    freed = replace(p, parameters={**p.parameters, "alpha_rest": Free(0.0, -0.1, 0.1)})
    better, _ = minimum(freed)
    assert better[freed.names.index("alpha_rest")] == pytest.approx(zero.size, rel=0.05)
    i, j = p.names.index(zero.moves), freed.names.index(zero.moves)
    assert better[j] - x[i] == pytest.approx(zero.shift, abs=0.3 * abs(zero.shift) + 0.3 * known.standard_error[i])
    assert not [
        m
        for m in misreadings(freed, better, uncertainty(freed, better))
        if m.code == "off-zero" and m.signal == "alpha"
    ]


def test_a_zero_is_taken_at_rest_where_the_recording_ends_there():
    falls, zero = np.linspace(1, 0, 101), Misreading("off-zero", "angle", 0.1, 9.0, 0.9, "", 0.0, 0.0, steps=9.0)
    for y, advice in ((np.append(falls, np.zeros(50)), 'Type zero = "rest"'), (falls, "Look at zero")):
        swing = Experiment("swing", 0.01, y[:, None], np.zeros((1, 1)))
        p = Problem(from_library("pendulum"), (swing,), {"mu": 1.0}, initial_state="held")
        assert _fix(p, zero) == f"{advice} in its table, or free angle_rest."


def test_a_fault_is_sized_by_derivatives_that_hold_over_an_interval_not_by_a_jump_within_their_step():
    """A jump of 6×10⁻⁵ within a difference of 2×10⁻⁵ looks like a slope of 3: it hides a zero that is off."""
    outputs = {"y": Equation("slope*x + 3e-5*tanh((slope - 1.3)/1e-7)", unit="1")}
    line = Equations({"x": Equation("1")}, outputs).model("line", [Parameter("slope", "", 1.3, "")])
    y = np.linspace(0, 1, 101) + 0.2 + 0.05 * np.random.default_rng(1).standard_normal(101)
    e = Experiment("line", 0.01, y[:, None], np.zeros((1, 0)), initial={"x": 0.0})
    p = Problem(line, (e,), {}, {"slope": Free(1.3, 0.0, 2.0)}, initial_state="held")
    [zero] = [m for m in misreadings(p, p.start, uncertainty(p, p.start)) if m.code == "off-zero"]
    assert zero.sure > 10


@pytest.mark.parametrize("offset", [0.0, 0.02, -0.08])
def test_a_current_sensor_that_is_offset_is_told_from_an_angle_that_drifts(offset):
    t = np.arange(0, 16, 0.02)
    current = 1.5 * np.sin(2 * t + 0.1 * t**2) + 0.6 * np.sin(0.7 * t)
    run = solve_ivp(
        lambda s, x: [x[1], (0.3 * np.interp(s, t, current) - 0.02 * x[1] - 0.4 * x[0] - 1.2 * x[0] ** 3) / 0.01],
        (0, t[-1]), [0.0, 0.0], t_eval=t, rtol=1e-9, atol=1e-11, max_step=0.02,
    )  # fmt: skip
    swings = {"angle": Equation("speed"), "speed": Equation("(0.3*i - b*speed - k*angle - k3*angle**3)/J")}
    constants = {"J": 0.01, "b": 0.02, "k": 0.4, "k3": 1.2}
    rows = [Parameter(n, "", v, "") for n, v in constants.items()]
    model = Equations(swings, {"angle": Equation("angle")}, inputs={"i": "A"}).model("motor", rows)
    angle = run.y[0] + 3e-3 * run.y[0].std() * np.random.default_rng(1).standard_normal(t.size)
    e = Experiment("motor", 0.02, angle[:, None], (current + offset)[:, None])
    p = Problem(model, (e,), {}, {n: Free(v, 0.2 * v, 5 * v) for n, v in constants.items()}, substeps=2)
    x, known = minimum(p)
    found = [f for f in after(p, x, known) if f.code in ("off-zero", "drifts", "late", "scaled", "play")]
    assert [(f.code, f.where) for f in found] == [("off-zero", "i")] * (offset != 0)
    assert all("A off: that would explain" in f.sentence and "type bias = { start = 0.0," in f.sentence for f in found)
    [zero] = [m for m in misreadings(p, x, known) if (m.code, m.signal) == ("off-zero", "i")]
    assert zero.size == pytest.approx(offset, rel=0.1, abs=2e-3)
    typed = replace(e, actuators={"i": Sensor(bias=Free(0.0, -0.2, 0.2))})
    better, sure = minimum(freed := replace(p, experiments=(typed,)))
    assert better[freed.names.index("bias_i")] == pytest.approx(-offset, abs=2e-3)
    assert ("off-zero", "i") not in [(m.code, m.signal) for m in misreadings(freed, better, sure)]


STRUCTURES = {
    "dry friction that the model lacks": fracid.rotary_pendulum("srv02-rotpen", coulomb_alpha=1.5e-2),
    "a cable that the model lacks": fracid.rotary_pendulum("srv02-rotpen", cable_stiffness=0.5),
}


@pytest.mark.broad
@pytest.mark.parametrize("lacks", STRUCTURES)
def test_a_structure_that_cannot_explain_the_recording_is_said_with_its_noise(lacks):
    y = release(model=STRUCTURES[lacks], orders=(1.0, 1.0))
    poor = problem(y, fracid.rotary_pendulum("srv02-rotpen"), orders={"lambda": 1.0, "mu": 1.0}, **HELD)
    fit = identify(poor)
    found = [f for f in fit.findings if f.code == "cannot-explain"]
    assert found
    right = problem(y, STRUCTURES[lacks], orders={"lambda": 1.0, "mu": 1.0}, **HELD)
    assert codes(after(right, *minimum(right))) == []
    for f in found:
        if f.unit == "times the noise":
            noise = np.hypot(5e-4, COUNT / np.sqrt(12))
            output = f.where.split(": ")[1]
            rms = fit.recordings["swing"].rmse[output]
            assert f.number == pytest.approx(rms / noise, rel=0.2)


def test_runs_that_all_blow_up_say_when():
    fit = identify(problem(release(alpha=0.17), RIG, orders={"lambda": 0.6, "mu": 1.5}, initial_state="held"))
    found = [f for f in fit.findings if f.code == "unsettled"]
    assert fit.cost == math.inf
    assert len(found) == 1
    assert 0 < found[0].number < 8.0


def test_an_after_thought_of_a_perfect_twin_has_nothing():
    run = fracid.simulate(RIG, orders={"lambda": 0.97, "mu": 0.98}, initial={"alpha": 0.4}, step=STEP, end=6.0)
    exact = problem(run.states[:, [0, 2]], parameters={}, initial_state="held")
    assert after(exact, exact.start, Failure(FailureReason.INTERRUPTED, "not asked")) == ()


# --- how it is carried ------------------------------------------------------------------------------------


@pytest.mark.broad
def test_an_interval_includes_the_noise_of_a_start_that_is_taken_from_a_sample():
    """Over seeds the order scatters as its interval says, not as the residuals alone would have it."""
    rig = fracid.rotary_pendulum("srv02-rotpen")
    run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=4e-3, end=6.0)
    scores, alone = [], []
    for seed in range(20):
        y = run.states[:, [0, 2]] + 1e-3 * np.random.default_rng(seed).standard_normal((1501, 2))
        swing = Experiment("twin", 4e-3, y, np.zeros((1, 1)))
        p = Problem(rig, (swing,), {"lambda": 0.9, "mu": Free(0.95, 0.5, 1.2)}, initial_state="held")
        here = settled(p, p.start)
        known = uncertainty(p, here.x, near=here)
        wider = with_start(p, here.x, known)
        scores.append((here.x[0] - 0.95) / wider.standard_error[0])
        alone.append((here.x[0] - 0.95) / known.standard_error[0])
    assert 0.6 < np.std(scores) < 1.5 < np.std(alone)


def test_a_finding_is_a_warning_of_the_fit_and_stands_in_its_json():
    fit = identify(problem(GOOD + TURNED, initial_state="held"))
    found = fit.findings[0]
    assert found.code == "wrong-zero"
    assert str(found) in fit.warnings
    written = json.loads(json.dumps(fit.to_json(), allow_nan=False))["findings"]
    assert written[0] == found.to_json()
    assert written[0]["number"] == pytest.approx(180.0, abs=0.5)


def test_every_code_has_its_row_in_the_page():
    validation = ("before_search", "reversed_signs", "after_search")
    files = (*(f"validation/{name}.py" for name in validation), "solver/stiffness.py", "recording/faults.py")
    source = (Path(fracid.__file__).parent / name for name in files)
    known = {code for path in source for code in re.findall(r'Finding\(\s*"([a-z-]+)"', path.read_text("utf-8"))}
    known |= {"degrees-as-radians", "radians-as-degrees", *FORMS}
    rows = set(re.findall(r"^\| `([a-z-]+)`", PAGE.read_text(encoding="utf-8"), flags=re.M))
    assert known <= rows


@pytest.mark.broad
def test_a_pendulum_that_hangs_elsewhere_once_its_arm_has_turned_hangs_on_an_axis_that_leans():
    leaning = fracid.rotary_pendulum("srv02-rotpen", tilt_x=0.02, b_alpha=3e-3, b_theta=0.05, coulomb_theta=0.02)
    pulse = np.zeros((4001, 1))
    pulse[200:214] = 10.0
    turned = release(alpha=0.0, end=20.0, model=leaning, inputs=pulse, orders=(1.0, 1.0))
    level = release(alpha=0.0, end=20.0, model=leaning.with_parameters(tilt_x=0.0), inputs=pulse, orders=(1.0, 1.0))
    found = sole(before(problem(turned, inputs=pulse)), "tilted-axis")
    theta = turned[-1, 0]
    assert found.number == pytest.approx(math.degrees(0.02 * abs(math.sin(theta))), abs=0.1)
    assert "Free tilt_x and tilt_y in [model.parameters]" in found.sentence
    assert "tilted-axis" not in codes(before(problem(level, inputs=pulse)))
    free = {"tilt_x": Free(0.0, -0.1, 0.1), "tilt_y": Free(0.0, -0.1, 0.1)}
    assert "tilted-axis" not in codes(before(problem(turned, inputs=pulse, parameters=free)))
