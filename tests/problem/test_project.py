"""The project file: every key does what it says, and what cannot be is told with its place."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from fracid.errors import DataError, FracidError, InputError
from fracid.models import rotary_pendulum
from fracid.problem import Free, Prior
from fracid.problem.project import load_project

T = np.arange(200) / 100
ALPHA, THETA, VOLTS = 20 * np.exp(-T) * np.cos(6 * T), 3 * np.sin(5 * T), 0.1 * np.sin(T)

ONE = '[[recording]]\nfile = "swing.csv"\nalpha = { column = "alpha", unit = "deg" }\n'
BOTH = ONE + 'theta = { column = "theta", unit = "deg" }\n'


@pytest.fixture
def project(tmp_path):
    """A function that writes a project file beside some recordings and reads it."""
    table = np.column_stack([T, ALPHA, THETA, VOLTS])
    np.savetxt(tmp_path / "swing.csv", table, delimiter=",", header="time,alpha,theta,volts", comments="")
    (tmp_path / "empty.csv").write_text("")
    (tmp_path / "text.csv").write_text("time,alpha\n0,1\n0.1,hello\n0.2,3\n")
    (tmp_path / "nan.csv").write_text(
        "time,alpha\n" + "".join(f"{i / 100},{'nan' if 7 <= i < 17 else i % 3}\n" for i in range(50))
    )

    def read(text, **options):
        (tmp_path / "rig.toml").write_text(text, encoding="utf-8")
        return load_project(tmp_path / "rig.toml", **options)

    return read


# --- what each key does ---------------------------------------------------------------------------------


def test_what_is_left_out_has_its_default(project):
    found = project(ONE)
    p = found.problem
    assert (p.model.name, p.model.zero, p.method, p.memory.name) == (
        *("rotary-pendulum", "hanging"),
        *("pi2", "compressed(1e-10)"),
    )
    assert p.orders == {"lambda": Free(1.0, 0.5, 1.2), "mu": Free(1.0, 0.5, 1.2)}
    assert (p.cost_function.name, p.outputs, p.initial_state, p.substeps) == ("rmse", ("alpha",), "estimate", 1)
    assert (found.optimiser, found.starts, found.seed, found.preset) == ("multistart", 1, 1, None)
    assert [e.name for e in p.experiments] == ["swing"]
    assert p.experiments[0].measured[:, 0] == pytest.approx(np.radians(ALPHA))


def test_the_model_table(project):
    found = project(
        '[model]\nname = "rotary-pendulum"\nrig = "qube-servo2"\nzero = "upright"\nactuation = "torque"\n'
        "[model.parameters]\nC4 = 0.02\nb_alpha = { start = 1e-4, lower = -1e-3, upper = 1e-3 }\n"
        "[model.orders]\nlambda = 1\nmu = { start = 0.9, lower = 0.8, upper = 1.1 }\n" + ONE
    )
    p = found.problem
    assert (p.model.zero, p.model.inputs) == ("upright", ("torque",))
    assert p.orders == {"lambda": 1.0, "mu": Free(0.9, 0.8, 1.1)}
    assert p.parameters == {"C4": 0.02, "b_alpha": Free(1e-4, -1e-3, 1e-3)}
    assert p.model.parameter("C4").value == 0.02


@pytest.mark.parametrize("tie", ['"lambda"', '{ tie = "lambda" }'])
def test_a_name_or_a_tie_ties(project, tie):
    p = project(
        '[model.parameters]\nb_theta = { start = 1e-3, lower = 0.0, upper = 1e-2 }\nb_alpha = "b_theta"\n'
        f'coulomb_alpha = {{ tie = "coulomb_theta" }}\n[model.orders]\nmu = {tie}\n' + BOTH
    ).problem
    assert p.names[:2] == ("lambda", "b_theta")
    assert p.ties == {"mu": "lambda", "b_alpha": "b_theta", "coulomb_alpha": "coulomb_theta"}
    assert p.parameter_starts["coulomb_alpha"] == p.model.parameter("coulomb_theta").value  # which the file leaves out


def test_priors_and_weights(project):
    p = project(
        "[model.parameters]\nC1 = { start = 4e-3, lower = 1e-3, upper = 1e-2, prior = { mean = 4.2e-3, sd = 1e-4 }, "
        "scale = 2e-3 }\n"
        + BOTH + 'weight = 2.5\n[fit]\nweights = "noise"\n'
    ).problem  # fmt: skip
    assert p.parameters["C1"] == Free(4e-3, 1e-3, 1e-2, Prior(4.2e-3, 1e-4), 2e-3)
    assert p.experiments[0].weight == 2.5
    assert p.weights == "noise"


def test_a_release_time_is_a_number_or_free(project):
    rest = '\n[fit]\ninitial_state = "rest"\n'
    free = project(BOTH + "release_time = { start = 0.0, lower = -0.02, upper = 0.05 }" + rest).problem
    assert free.names[-1] == "release_time [swing]"
    assert free.experiments[0].release_time == Free(0.0, -0.02, 0.05)
    assert project(BOTH + "release_time = 0.01" + rest).problem.experiments[0].release_time == 0.01


def test_an_initial_value_is_a_number_or_found_in_a_range(project):
    of = "initial = { alpha = 0.4, theta = { start = 0.1, lower = -0.2, upper = 0.3 } }"
    p = project(BOTH + of + '\n[fit]\ninitial_state = "held"').problem
    assert p.experiments[0].initial == {"alpha": 0.4, "theta": Free(0.1, -0.2, 0.3)}
    assert [u.range for u in p.unknowns if u.kind == "initial"] == [Free(0.1, -0.2, 0.3)]


def test_what_came_before_from_is_the_past_where_it_is_asked_for(project):
    cut = BOTH + 'voltage = { column = "volts", unit = "V" }\nfrom = 0.5\nto = 1.5\n'
    alone = project(cut).problem.experiments[0]
    for text in (cut + 'history = "measured"\n', cut + '[fit]\nhistory = "measured"\n'):
        e = project(text).problem.experiments[0]
        assert np.array_equal(e.measured, alone.measured)
        assert (e.start, alone.past) == (0.5, None)
        assert e.past[:, 1] == pytest.approx(np.radians(ALPHA[:50]))
        assert e.past_inputs[:, 0] == pytest.approx(VOLTS[:50])
    assert project(cut + 'history = "none"\n[fit]\nhistory = "measured"\n').problem.experiments[0].past is None
    assert project(cut + 'history = "measured"\n[fit]\npreset = "paper"\n').problem.experiments[0].past is None


def test_recordings_with_and_without_a_voltage_stand_side_by_side(project):
    p = project(BOTH + BOTH + 'name = "pulse"\nvoltage = { column = "volts", unit = "V" }\n').problem
    assert [e.inputs.shape for e in p.experiments] == [(1, 1), (200, 1)]
    assert p.experiments[1].inputs[:, 0] == pytest.approx(VOLTS)
    assert not p.experiments[0].inputs.any()


def test_the_papers_constants_are_converted(project):
    p = project("[model.parameters]\nC2 = 5e-3\nC5 = 1e-2\nI2xx = 1e-4\n" + ONE).problem
    assert p.model.parameter("C6").value == pytest.approx(4.9e-3)
    assert p.model.parameter("J_theta").value == pytest.approx(1.01e-2)


def test_the_recording_table(project):
    found = project(
        '[[recording]]\nname = "release 20°"\nfile = "swing.csv"\ntime = { column = 0 }\n'
        'theta = { column = 2, unit = "deg", sign = -1 }\nalpha = { column = 1, unit = "deg", zero = 0.1 }\n'
        'voltage = { column = "volts", unit = "V" }\nfrom = 0.5\nto = 1.5\n'
        "initial = { theta = 0.25 }\n"
    )
    (e,) = found.problem.experiments
    part = slice(50, 151)
    assert (e.name, e.start, len(e.measured)) == ("release 20°", 0.5, 101)
    assert e.measured[:, 0] == pytest.approx(-np.radians(THETA[part]))
    assert e.measured[:, 1] == pytest.approx(np.radians(ALPHA[part]) - 0.1)
    assert e.inputs[:, 0] == pytest.approx(VOLTS[part])
    assert e.initial == {"theta": 0.25}
    assert len(e.sha256) == 64
    assert "theta(0) [release 20°]" not in found.problem.names


def test_the_fit_table(project):
    found = project(
        "[model.parameters]\ntheta_rest = { start = 0.0, lower = -1.0, upper = 1.0 }\n" + BOTH +
        '[fit]\ncost = "itae"\noutputs = ["alpha"]\nper_recording = ["theta_rest"]\ninitial_state = "rest"\n'
        'method = "gl"\nmemory = "short(50)"\nsubsteps = 2\noptimiser = "genetic"\nstarts = 3\nseed = 7\n'
    )  # fmt: skip
    p = found.problem
    assert (p.cost_function.name, p.outputs, p.per_recording) == ("itae", ("alpha",), ("theta_rest",))
    assert (p.initial_state, p.method, p.memory.name, p.substeps) == ("rest", "gl", "short(50)", 2)
    assert (found.optimiser, found.starts, found.seed) == ("genetic", 3, 7)
    assert project(ONE + '[fit]\nmemory = "compressed"\ntolerance = 1e-6').problem.memory.name == "compressed(1e-06)"


def test_validation_recordings_stand_apart(project):
    second = ONE + 'name = "held out"\nuse = "validate"\n'
    found = project(ONE + second)
    assert [e.name for e in found.problem.experiments] == ["swing"]
    assert [e.name for e in found.validation] == ["held out"]
    assert [r.name for r in found.recordings] == ["swing", "held out"]


SECOND = ONE + 'name = "second"\n'


@pytest.mark.parametrize(
    ("recordings", "shared"),
    [
        (ONE + "to = 0.5\n" + SECOND + "mask = [[0.0, 0.5]]\n", []),
        (ONE + SECOND.replace('"alpha", unit = "deg"', '"theta", unit = "deg"'), []),
        (ONE + SECOND + "mask = [[0.0, 1.0]]\n", [
            "swing and second score the same samples of swing.csv from 1.01 to 1.99 s",
        ]),
        (ONE + SECOND + "from = 0.2\nto = 0.4\n" + SECOND.replace("second", "third") + "from = 0.6\n", [
            "swing and second score the same samples of swing.csv from 0.2 to 0.4 s",
            "swing and third score the same samples of swing.csv from 0.6 to 1.99 s",
        ]),
    ],
    ids=["parted by a mask", "other columns", "in part", "not neighbours"],
)  # fmt: skip
def test_recordings_that_score_the_same_samples_of_a_column_are_named_and_no_others(project, recordings, shared):
    assert [note.partition(":")[0] for note in project(recordings).notes] == shared


def test_what_a_mask_leaves_out_is_found_no_more(project, tmp_path):
    np.savetxt(tmp_path / "swing.csv", np.c_[T, np.where(np.arange(T.size) == 90, 80.0, ALPHA)], delimiter=",",
               header="time,alpha", comments="")  # fmt: skip
    at = float(T[90])
    read = [project(ONE + mask).recordings[0] for mask in ("", f"mask = [[{at - 0.001}, {at + 0.001}]]")]
    found = [[f.code for f in recording.report.findings] for recording in read]
    assert ["jump" in codes for codes in found] == [True, False]


def test_only_outputs_that_all_recordings_have_are_scored_unless_told(project):
    assert project(BOTH + ONE + 'name = "b"\n').problem.outputs == ("alpha",)
    assert project(BOTH).problem.outputs == ("theta", "alpha")


def test_resampling_is_told(project, tmp_path):
    uneven = T + 0.002 * np.sin(40 * T)
    table = np.column_stack([uneven, ALPHA])
    np.savetxt(tmp_path / "uneven.csv", table, delimiter=",", header="time,alpha", comments="")
    found = project(ONE.replace("swing", "uneven"))
    assert len(found.notes) == 1
    assert found.notes[0].startswith("uneven: ")
    with pytest.raises(InputError, match="not on a uniform grid"):
        project(ONE.replace("swing", "uneven") + "resample = false\n")


@pytest.mark.parametrize("where", ["file", "argument"])
def test_the_paper_preset_is_the_paper_to_the_letter(project, where):
    text = (
        "[model.parameters]\nC1 = { start = 4e-3, lower = 1e-3, upper = 1e-2 }\n[model.orders]\nlambda = 1.0\n"
        'mu = { start = 0.9, lower = 0.8, upper = 1.1 }\n' + BOTH +
        '[fit]\ncost = "rmse"\nmethod = "pi2"\nper_recording = ["theta_rest"]\n'
    )  # fmt: skip
    found = project(text + 'preset = "paper"\n') if where == "file" else project(text, preset="paper")
    p = found.problem
    assert (found.preset, found.optimiser) == ("paper", "genetic")
    assert (p.method, p.cost_function.name, p.outputs, p.initial_state) == ("gl-paper", "itae", ("alpha",), "held")
    assert p.names == ("lambda", "mu")  # the orders alone
    assert p.orders["mu"] == Free(0.9, 0.8, 1.1)
    assert p.parameters["C1"] == 4e-3


def test_the_paper_preset_is_refused_for_other_models(project):
    text = '[model]\nname = "two-mass"\n[model.orders]\nlambda = 1.0\nmu = 1.0\n' + BOTH
    with pytest.raises(
        InputError, match=r'preset = "paper" is the recipe for the rotary pendulum.*leave the preset out'
    ):
        project(text, preset="paper")


def test_the_paper_preset_takes_the_rigs_constants_fixes_what_else_is_free_and_says_what_differs(project):
    text = (
        '[model]\nrig = "qube-servo2"\n[model.parameters]\nC1 = { start = 4e-3, lower = 1e-5, upper = 1e-2 }\n'
        "drag_alpha = { start = 1e-3, lower = 0.0, upper = 1.0 }\nC3 = 0.0\n"
        "[model.orders]\nlambda = { start = 1.0, lower = 0.6, upper = 1.2 }\n" + BOTH +
        'release_time = { start = 0.01, lower = -0.1, upper = 0.1 }\n[fit]\nsubsteps = 4\npreset = "paper"\n'
    ).replace('"alpha" }', '"alpha", delay = { start = 0.0, lower = -0.01, upper = 0.01 } }')  # fmt: skip
    found = project(text)
    p, own = found.problem, rotary_pendulum("qube-servo2")
    assert p.names == ("lambda", "mu")
    assert p.experiments[0].release_time == 0.01
    assert (p.substeps, p.parameters) == (1, {"C3": 0.0})
    assert p.model.parameter("C1").value == own.parameter("C1").value
    assert p.model.parameter("drag_alpha").value == 0.0
    says = found.notes[-1]
    for part in ("100 Hz (the paper: 1000 Hz)", "(the paper: 20 s)", "(the paper: 10°)", "α = 0 is hanging",
                 "C3 = 0 is the file's, not the rig's", "λ in 0.6 … 1.2, μ in 0.5 … 1.2"):  # fmt: skip
        assert part in says
    assert "drag" not in says


POPULATION = """
[model]
name = "rabbits"
[model.equations]
rabbits = { equals = "-a*rabbits", order = "q" }
[model.outputs]
rabbits = { equals = "rabbits", unit = "1" }
[model.parameters]
a = { start = 1.0, lower = 0.0, upper = 9.0 }
[[recording]]
file = "rabbits.csv"
rabbits = HOW
"""


@pytest.mark.parametrize(("said", "shown"), [("m", "m"), ("V", "V"), ("K", "K"), ("kg/m^3", "1"), ("", "1")])
def test_an_output_of_a_column_without_a_unit_has_the_model_s_or_is_a_number_never_an_angle(
    project, tmp_path, said, shown
):
    table = np.column_stack([T, 500 * np.exp(-T)])
    np.savetxt(tmp_path / "rabbits.csv", table, delimiter=",", header="t,rabbits", comments="")
    problem = project(POPULATION.replace("HOW", "1").replace('unit = "1"', f'unit = "{said}"')).problem
    (e,), start = problem.experiments, problem.unknowns[-1]
    assert e.units == {"rabbits": shown}
    assert e.measured[0, 0] == 500.0
    assert (start.name, start.range.lower, start.range.upper) == ("rabbits(0) [rabbits]", 400.0, 600.0)


def test_a_header_in_another_unit_than_the_models_is_told_and_in_one_of_another_kind_refused(project, tmp_path):
    text = POPULATION.replace('unit = "1"', 'unit = "K"')
    for header in ("rabbits [degC]", "rabbits [V]"):
        table = np.column_stack([T, 500 * np.exp(-T)])
        np.savetxt(tmp_path / "rabbits.csv", table, delimiter=",", header=f"t,{header}", comments="")
        if header == "rabbits [degC]":
            (note,) = project(text.replace("HOW", "1")).notes
            assert (
                'rabbits is taken as K, the model\'s unit, which is not what its header says: type unit = "K"' in note
            )
            assert project(text.replace("HOW", '{ column = 1, unit = "K", zero = -273.15 }')).notes == ()
            assert project(text.replace("HOW", "1").replace('"K"', '"degC"')).notes == ()
            (note,) = project(text.replace("HOW", "1").replace('"K"', '"degF"')).notes
            assert 'type unit = "1" in rabbits' in note
        else:
            with pytest.raises(InputError, match="rabbits is a quantity in K of this model, and its unit is V"):
                project(text.replace("HOW", "1"))


@pytest.mark.parametrize("header", ["rabbits", "rabbits [1]"])
@pytest.mark.parametrize("how", ["1", "{ column = 1 }"])
def test_an_output_that_is_a_pure_number_is_none_of_counts_nor_an_angle(project, tmp_path, header, how):
    table = np.column_stack([T, np.rint(500 * np.exp(-T))])
    np.savetxt(tmp_path / "rabbits.csv", table, delimiter=",", header=f"t,{header}", comments="")
    (e,) = project(POPULATION.replace("HOW", how)).problem.experiments
    (recording,) = project(POPULATION.replace("HOW", how)).recordings
    assert (e.units, recording.units) == ({"rabbits": "1"}, {"rabbits": "1"})
    assert recording.report.findings == ()


def test_an_input_without_a_unit_is_in_the_model_s_and_none_of_degrees(project, tmp_path):
    table = np.column_stack([T, 500 * np.exp(-T), 20 * np.sin(9 * T)])
    np.savetxt(tmp_path / "rabbits.csv", table, delimiter=",", header="t,rabbits,fed", comments="")
    for said, unit, between in (("V", "V", "hold"), ("m s^-2", "1", "line")):
        text = POPULATION.replace("[model.equations]", f'inputs = {{ fed = "{said}" }}\n[model.equations]')
        found = project(text.replace("HOW", "1\nfed = 2"))
        assert found.recordings[0].units["fed"] == unit
        assert found.recordings[0].report.findings == ()
        assert found.problem.experiments[0].between.get("fed", "line") == between


def test_an_output_that_is_infinite_is_a_run_that_fails(project, tmp_path):
    np.savetxt(
        tmp_path / "rabbits.csv", np.column_stack([T, 500 * np.exp(-T)]), delimiter=",", header="t,n", comments=""
    )
    text = POPULATION.replace('equals = "rabbits"', 'equals = "rabbits/V"').replace("HOW", "1")
    text = text.replace("[[rec", "V = { start = 1.0, lower = 0.0, upper = 9.0 }\n[[rec")
    problem = project(text + "initial = { rabbits = 500.0 }\n").problem
    (errors,) = problem.all_errors([problem.start * [name != "V" for name in problem.names]])
    assert str(errors) == "rabbits: an output is not finite"


def test_an_order_that_has_the_name_of_a_parameter_is_refused_with_what_to_type(project):
    with pytest.raises(InputError, match=r"'a' is the name of an order and of a state, .* order = \"1 - nu\""):
        project(POPULATION.replace('"q"', '"a"').replace("HOW", "1"))


def test_a_users_cost_and_model_stand_beside_the_file(project, tmp_path):
    (tmp_path / "my.py").write_text("def worst(time, residual):\n    return float(abs(residual).max())\n")
    (tmp_path / "my_rig.py").write_text(
        "from fracid import Model, Parameter\n"
        "def rhs(t, x, u, p, out):\n    out[0] = x[1]\n    out[1] = -p[0] * x[0]\n"
        'model = Model("spring", rhs, ("alpha", "rate"), ("mu", "mu"), {"alpha": 0}, (),\n'
        '              (Parameter("k", "1/s^2", 36.0, "stiffness"),), "", "a test")\n'
    )
    found = project('[model]\nname = "my_rig.py:model"\n' + ONE + '[fit]\ncost = "my.py:worst"\n', trust=True)
    p = found.problem
    assert (p.model.name, p.cost_function.name) == ("spring", "worst")
    assert p.names == ("mu", "alpha(0) [swing]", "rate(0) [swing]")
    assert np.isfinite(p.cost(p.start))


def test_paths_are_relative_to_the_file_and_its_text_is_kept(project, tmp_path, monkeypatch):
    monkeypatch.chdir("/")
    found = project(ONE)
    assert found.text == ONE
    assert found.path == tmp_path / "rig.toml"


# --- what cannot be -------------------------------------------------------------------------------------

RANGE = r"expected a number or a table \{ start = \.\.\., lower = \.\.\., upper = \.\.\. \}"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"\[\[recording\]\] is missing"),
        ("hello world", r"is not TOML: .*line 1, column 7"),
        ("[modle]\n" + ONE, r"\[modle\] is unknown; did you mean 'model'\?"),
        ('[model]\nnmae = "x"\n' + ONE, r"\[model\] nmae is unknown; did you mean 'name'\?"),
        (ONE + '[fit]\noptimizer = "genetic"', r"\[fit\] optimizer is unknown; did you mean 'optimiser'\?"),
        (ONE + "[fit]\nxyz = 1", r"\[fit\] xyz is unknown; the known ones are cost, weights, outputs, "),
        (ONE + '[[recordin]]\nfile = "x"', r"\[recordin\] is unknown; did you mean 'recording'\?"),
        (ONE + '[fit]\ncost = "rsme"', "unknown cost 'rsme': did you mean rmse"),
        (ONE + '[fit]\noptimiser = "genetik"', "unknown optimiser 'genetik': did you mean genetic"),
        (ONE + '[fit]\ninitial_state = "estimated"', "unknown initial_state 'estimated': did you mean estimate"),
        (ONE + '[fit]\nmethod = "pi4"', "unknown method 'pi4': did you mean pi3 or pi2"),
        (ONE + '[fit]\nmemory = "ful"', "no memory 'ful'"),
        (ONE + "[fit]\ntolerance = -1.0", "the tolerance must lie between"),
        (ONE + "[fit]\nsubsteps = 0", r"\[fit\] substeps = 0; expected 1 or more"),
        (ONE + '[fit]\nsubsteps = "2"', r"\[fit\] substeps = '2'; expected a whole number"),
        (ONE + "[fit]\nseed = 1.5", r"\[fit\] seed = 1\.5; expected a whole number"),
        (ONE + '[fit]\npreset = "papr"', "unknown preset 'papr': did you mean paper"),
        (ONE + '[fit]\noutputs = ["theta"]', "swing has no signal 'theta'; it has alpha. Type theta = "),
        (ONE + '[fit]\nper_recording = ["C1"]', "per_recording names 'C1', which is not free"),
        (ONE + '[fit]\ncost = "no.py:f"', r"there is no file .*no\.py"),
        (ONE + "[model.orders]\nmu = true", rf"\[model\.orders\] mu = true; {RANGE}"),
        (ONE + "[model.orders]\nmu = [1.0]", rf"\[model\.orders\] mu = \[1\.0\]; {RANGE}"),
        ("[model]\nzero = hanging # down\n" + ONE, r'is: zero = hanging\. Put text in quotes: zero = "hanging"'),
        ("[model]\nzero = " + 400 * "h" + "\n" + ONE, r"not TOML: .*The line begins: zero = h{113}$"),
        ("[model.parameters]\nC4 = 0,194\n" + ONE, r"The line is: C4 = 0,194\. Type a decimal point: C4 = 0\.194"),
        (ONE.replace("swing.csv", "C:\\data\\x.csv"), r"or single quotes: file = 'C:\\data\\x\.csv'"),
        (ONE + '[model.parameters]\nC4 = "0.194 N m"', r"C4 = '0\.194 N m' is not possible; expected a number in SI"),
        (ONE + "[model.parameters]\nm2 = -0.1", r"parameter 'm2'\. docs/project-file\.md lists all \d+\.$"),
        (ONE.replace('"deg"', '"degrees"'), "unit = 'degrees' is not possible; expected 'deg'"),
        (ONE + '[model.orders]\nmu = "one"', "unknown order that mu is tied to 'one'; the known ones are lambda, mu"),
        (ONE + '[model.orders]\nmu = "mu"', "mu = mu goes in a circle: give one order of them a number"),
        (ONE + "[model.orders]\nmu = { tie = 1.0 }", r"\[model\.orders\.mu\] .*tie.* is unknown"),
        (ONE + '[model.parameters]\nb_alpha = "b_teta"', "that b_alpha is tied to 'b_teta': did you mean b_theta"),
        (ONE + '[model.parameters]\nb_alfa = "b_theta"', "unknown rotary-pendulum parameter 'b_alfa'"),
        (ONE + "[model.orders]\nmu = 0", r"order mu = 0\.0: expected a number between 0 and 2, both excluded"),
        (ONE + "[model.orders]\nmu = 2.5", r"order mu = 2\.5: expected a number between 0 and 2, both excluded"),
        (ONE + "[model.orders]\nmu = { start = 1.0, lower = 0.5, upper = 2.5 }", r"mu = 0\.5 … 2\.5: an order must"),
        (ONE + "[model.orders]\nmuu = 1.0", "'muu': did you mean mu"),
        (ONE + "[model.orders]\nalpha = 1.0", "'alpha'; the known ones are lambda, mu"),
        (ONE + "[model.orders]\nmu = { start = 1.0, lower = 0.5 }", r"\[model\.orders\.mu\] upper is missing\.$"),
        (ONE + "[model.orders]\nmu = { start = 1.0, lower = 0.5, uper = 1.2 }", "uper is unknown; did you mean 'up"),
        (ONE + "[model.orders]\nmu = { start = 1.0, lower = 1.5, upper = 1.2 }", "mu: start = 1, lower = 1.5, upper"),
        (ONE + "[model.parameters]\nC44 = 1.0", "unknown rotary-pendulum parameter 'C44': did you mean C4"),
        (ONE + "[model.parameters]\nC1 = -1.0", r"C1 = -1\.0 kg m\^2 is outside its physical bounds"),
        (ONE + "[model.parameters]\nC1 = nan", r"C1 = nan; expected a finite number"),
        (ONE + "[model.parameters]\nC1 = { start = 1e-3, lower = -1.0, upper = 1.0 }", "C1 is free in -1 … 1, but"),
        (ONE + "[model.parameters]\nC1 = { start = 4e-3, lower = 1e-3, upper = 1e-2, prior = { mean = 4e-3 } }",
         r"\[model\.parameters\.C1\.prior\] sd is missing"),
        (ONE + "[model.parameters]\nC1 = { start = 4e-3, lower = 1e-3, upper = 1e-2, prior = { maen = 1, sd = 1.0 } }",
         "maen is unknown; did you mean 'mean'"),
        (ONE + "[model.parameters]\nC1 = { start = 4e-3, lower = 1e-3, upper = 1e-2, prior = { mean = 1, sd = 0 } }",
         r"C1\] prior: prior = \{ mean = 1, sd = 0 \}: expected finite numbers, and sd above 0"),
        (ONE + "[model.parameters]\nC1 = { start = 4e-3, lower = 1e-3, upper = 1e-2, prior = 4e-3 }",
         r"prior = 0\.004; expected a table \{ mean = \.\.\., sd = "),
        (ONE + "release_time = 0.01", "swing: a release_time needs a start at rest.*type initial_state = \"rest\""),
        (ONE + 'release_time = "now"', "release_time = 'now'; expected a number or a table"),
        (ONE + "release_time = { start = 0.1, lower = 0.2, upper = 0.3 }", "release_time: start = 0.1, lower"),
        (BOTH + 'history = "measured"', 'swing: history = "measured" is what came before from; type from = the time'),
        (BOTH + 'history = "all"', "history = 'all'; expected 'measured' or 'none'"),
        (ONE + 'from = 0.5\nhistory = "measured"', "its past does not determine theta, D.lambda theta; a past needs"),
        (BOTH + 'from = 0.5\nhistory = "measured"\n[fit]\ninitial_state = "rest"',
         "swing has a past, so it starts in motion, but initial_state is 'rest', a start at rest"),
        (BOTH + 'from = 0.0\nhistory = "measured"', "holds 0 samples"),
        (ONE + "weight = -1.0", "swing: weight = -1; expected a number above 0.*use = \"validate\""),
        (ONE + 'weight = "big"', "weight = 'big'; expected a number"),
        (ONE + '[fit]\nweights = "noisy"', "unknown weights 'noisy': did you mean noise"),
        (ONE + "[model.parameters]\nC2 = 1e-3", "C2, C5 and I2xx go together"),
        (ONE + "[model.parameters]\nC5 = 1e-2\nI2xx = 0.0\nC2 = { start = 1e-3, lower = 0.0, upper = 1.0 }",
         "C2 is converted and cannot be fitted; free one of C1, C3"),
        ('[model]\nrig = "srv02"\n' + ONE, "unknown rig 'srv02'.*srv02-rotpen"),
        ('[model]\nzero = "down"\n' + ONE, "zero = 'down': expected 'hanging' or 'upright'"),
        ('[model]\nactuation = "pwm"\n' + ONE, r"actuation = 'pwm'; expected 'voltage' or 'torque'"),
        ('[model]\nname = "rotary"\n' + ONE, "'rotary': did you mean rotary-pendulum"),
        ('[model]\nname = "no.py:model"\n' + ONE, r"there is no file .*no\.py"),
        ("recording = 3", r"\[\[recording\]\] = 3; expected a list of tables: type \[\[recording\]\] above each"),
        (ONE + '[fit]\noutputs = "alpha"', r"\[fit\] outputs = 'alpha'; expected a list \[\"alpha\"\]"),
        (ONE + "mask = [1.5, 1.6]", r"mask: 0 = 1\.5; expected a list \[\.\.\.\]"),
        ('[[recording]]\nalpha = 1', r"\[\[recording\]\] number 1: file is missing"),
        ('[[recording]]\nfile = "swing.csv"', r"names no signal; type for example alpha = \{ column = 1"),
        (ONE.replace("swing", "swong"), r"no file .*swong\.csv: did you mean .*swing\.csv"),
        (ONE.replace('"alpha"', '"alfa"'), "has no column 'alfa'. Did you mean 'alpha'"),
        (ONE.replace("alpha =", "alfa ="), r"unknown key of .* 'alfa': did you mean alpha\?"),
        (ONE + 'beta = { column = 1 }', r"unknown key of .* 'beta'"),
        (ONE + 'torque = { column = 1 }', r'a torque, type actuation = "torque" in \[model\]'),
        (ONE.replace('"deg"', '"grad"'), "unit = 'grad' is not possible"),
        (ONE + 'use = "test"', "use = 'test'; expected 'fit' or 'validate'"),
        (ONE + 'use = "validate"', r'no \[\[recording\]\] has use = "fit"'),
        (ONE + 'from = "start"', "from = 'start'; expected a number or 'release'"),
        (ONE + "from = true", "from = true; expected a number or 'release'"),
        (ONE + "from = 99.0", "holds 0 samples; it spans 0 to 1.99 s"),
        (ONE + "initial = { alfa = 0.1 }", "unknown state in initial of swing 'alfa': did you mean alpha"),
        (ONE + 'initial = { alpha = "10 deg" }', "initial: alpha = '10 deg'; expected a number"),
        (ONE + "resample = 0", "step = 0"),
        (ONE + 'resample = "yes"', "resample = 'yes'; expected true or false or a number or 'needed'"),
        (ONE + ONE, "2 recordings are named 'swing'"),
        ('[[recording]]\nfile = "swing.csv"\nvoltage = { column = "volts" }', "share none of the outputs theta, alpha"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_told_with_its_place(project, text, message):
    with pytest.raises(InputError, match=message) as told:
        project(text)
    assert "rig.toml" in str(told.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (ONE.replace("swing", "empty"), "empty.csv is empty"),
        (ONE.replace("swing", "text"), r"text.csv, line 3, column 1 \(alpha\): 'hello' is not a number"),
        (ONE + 'from = "release"', r"no release found .*Give from as a time \[s\]"),
    ],
)
def test_an_unfit_recording_is_told(project, text, message):
    with pytest.raises(DataError, match=message):
        project(text)


def test_blanks_of_an_output_are_not_scored_however_many_they_are(project):
    problem = project(ONE.replace("swing", "nan")).problem
    assert np.flatnonzero(~problem.experiments[0].scored[:, 0]).tolist() == list(range(7, 17))


def test_a_missing_file_a_folder_and_no_utf8_are_told(tmp_path):
    for path, reason in ((tmp_path / "no.toml", "There is no .*no.toml"), (tmp_path, "folder|cannot be read")):
        with pytest.raises(InputError, match=reason):
            load_project(path)
    (tmp_path / "latin.toml").write_bytes("name = '92°'".encode("latin-1"))
    with pytest.raises(InputError, match="cannot be read: it is not UTF-8 text"):
        load_project(tmp_path / "latin.toml")


def test_no_value_of_any_kind_gives_a_foreign_error(project):
    """Every key with every kind of value: either it is taken or it is told in our words."""
    values = ["true", "-1", "0", "1e999", "nan", '""', '"x"', "[]", "[1]", "{}", "{ a = 1 }", "1979-05-27", '["alpha"]']
    tables = {
        "[model]": ["name", "rig", "zero", "actuation", "parameters", "orders"],
        "[fit]": ["cost", "outputs", "per_recording", "initial_state", "method", "memory", "tolerance", "substeps",
                  "optimiser", "starts", "seed", "preset"],
        "[model.parameters]": ["C1", "slip_speed"],
        "[model.orders]": ["mu"],
        "[model.orders.mu]": ["start"],
    }  # fmt: skip
    texts = [ONE + f"{table}\n{key} = {v}" for table, keys in tables.items() for key in keys for v in values]
    keys = ["name", "time", "from", "to", "use", "resample", "variable", "initial", "theta"]
    texts += [ONE + f"{key} = {v}\n" for key in keys for v in values]
    texts += [ONE.split("\n", 2)[0] + f"\nfile = {v}\nalpha = 1\n" for v in values]
    told = 0
    for text in texts:
        try:
            project(text)
        except FracidError:
            told += 1
    assert told > 0.6 * len(texts)


EXAMPLES = sorted((Path(__file__).parents[2] / "examples").glob("srv02-*.toml"))


@pytest.mark.few(1)
@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: p.name)
def test_the_examples_lack_nothing_but_their_recordings(path, tmp_path):
    """Each says what can be: with recordings of the columns that it names it is a problem with unknowns."""
    time = np.arange(0, 60, 0.002)
    swing = np.pi - 1.5 * np.where(time < 8, 1.0, np.exp(-0.1 * (time - 8)) * np.cos(7 * (time - 8)))
    rows = np.vstack([time, 0.1 * np.sin(7 * time), swing, np.zeros_like(time)])
    text = path.read_text(encoding="utf-8")
    for name in set(re.findall(r'file *= "(.*?)"', text)):
        savemat(tmp_path / name, {"data": rows})
    (tmp_path / path.name).write_text(text, encoding="utf-8")
    found = load_project(tmp_path / path.name)
    assert found.problem.names
    assert np.isfinite(found.problem.cost(found.problem.start))


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: p.name)
def test_an_example_without_its_recordings_says_where_they_are(path):
    with pytest.raises(InputError, match=r"no file .*\.mat\. The project says: .*github FedericoCorso"):
        load_project(path)
