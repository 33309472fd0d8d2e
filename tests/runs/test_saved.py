"""A run folder gives back its problem, its values and its simulations to the last bit, or says why it cannot."""

import json
import math
import shutil

import numpy as np
import pytest

from fracid.errors import InputError
from fracid.findings import Finding
from fracid.fit import Fit
from fracid.report import write_report
from fracid.runs.saved import load_run
from fracid.safety.schema import as_json
from fracid.selection.integer_rival import Alternative, Trial
from program import fit_in
from twins import write_release

PROJECT = """
[model.parameters]
b_alpha = { start = 2e-4, lower = 0.0, upper = 1e-2 }
theta_rest = { start = 0.0, lower = -0.1, upper = 0.1 }
[model.orders]
mu = "lambda"
[[recording]]
name = "release 20°"
file = "data/twenty.csv"
theta = { column = "theta", unit = "rad" }
alpha = { column = "alpha", unit = "rad" }
[[recording]]
name = "release 10°"
file = "data/ten.csv"
theta = { column = "theta", unit = "rad" }
alpha = { column = "alpha", unit = "rad" }
use = "validate"
[fit]
initial_state = "rest"
per_recording = ["theta_rest"]
"""


def write_twin(file, alpha, seed=1):
    write_release(file, orders={"lambda": 0.95, "mu": 0.95}, alpha=alpha, step=5e-3, end=2.0, noise=1e-3, seed=seed)


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """A project, its run as `fracid fit` leaves it, and the fit itself."""
    folder = tmp_path_factory.mktemp("saved")
    (folder / "data").mkdir()
    write_twin(folder / "data" / "twenty.csv", 0.35)
    write_twin(folder / "data" / "ten.csv", 0.17, seed=2)
    kept = []
    fit_in(folder, PROJECT, lambda fit: kept.append(fit) or ())
    return folder, kept[0]


@pytest.fixture
def copy(fitted, tmp_path):
    """The project and its run, free to be spoilt."""
    folder = tmp_path / "copy"
    shutil.copytree(fitted[0], folder)
    state = json.loads((folder / "run" / "run.json").read_text(encoding="utf-8"))
    state["options"]["project"] = str(folder / "rig.toml")  # not where it was copied from
    (folder / "run" / "run.json").write_text(json.dumps(state), encoding="utf-8")
    return folder


def test_a_run_gives_its_problem_and_unknowns_back(fitted):
    folder, fit = fitted
    run = load_run(folder / "run")
    assert run.problem.names == fit.problem.names
    np.testing.assert_array_equal(run.x, fit.x)
    assert run.notes == ()


def test_a_run_shows_the_card_of_its_fit_without_simulating_anything(fitted):
    folder, fit = fitted
    run = load_run(folder / "run")
    assert repr(run).splitlines()[1:] == repr(fit).splitlines()[1:]
    assert len(repr(run)) <= 1000
    assert "release 10°" in run._repr_html_()
    assert "made" not in vars(run.recordings)


def test_a_run_has_the_attributes_of_its_fit(fitted):
    folder, fit = fitted
    run = load_run(folder / "run")
    for name in ("claim", "claim_reasons", "warnings", "findings", "cost", "outcome", "evaluations", "optimiser",
                 "seed", "opened_bounds", "discretisation", "alternative"):  # fmt: skip
        assert getattr(run, name) == getattr(fit, name), name
    assert run.claim == run.result["claim"]
    assert run.timing.keys() >= fit.timing.keys()


def test_a_run_is_the_fit_that_was_written(fitted):
    run = load_run(fitted[0] / "run")
    assert isinstance(run, Fit)
    assert run.orders.keys() == fitted[1].orders.keys()
    assert [s.origin for s in run.starts] == [s.origin for s in fitted[1].starts]
    assert run.to_json() == json.loads((fitted[0] / "run" / "result.json").read_text(encoding="utf-8"))


def test_a_result_of_before_some_of_its_keys_is_read_and_shown(copy):
    path = copy / "run" / "result.json"
    content = json.loads(path.read_text(encoding="utf-8"))
    later = ("window", "claim", "claim_reasons", "claim_codes", "opened_bounds", "alternative", "starts", "spread",
             "start_that_won", "cut", "interval_methods", "findings", "discretisation", "preset", "timing")  # fmt: skip
    old = {key: value for key, value in content.items() if key not in later}
    for order in old["orders"].values():
        del order["integer"]
    path.write_text(json.dumps(old), encoding="utf-8")
    run = load_run(copy / "run")
    assert run.claim == "undecided"
    assert {order.integer for order in run.orders.values()} == {1.0}
    assert "The recordings do not decide" in write_report(copy / "run").read_text(encoding="utf-8")


def test_a_run_reads_its_findings_and_its_alternative_back(copy):
    finding = Finding("misfit", "a: alpha", math.nan, 3.0, "roundings", "It is large.")
    trials = (Trial("friction", 0.2, 5.0, True), Trial("a delay", math.inf, math.inf))
    alternative = Alternative("every order 1", ("mu",), 0.2, {"b_alpha": 1.0}, 5.0, 100.0, "It does.", trials)
    blocks = {"findings": [finding.to_json()], "alternative": as_json(Alternative, alternative)}
    path = copy / "run" / "result.json"
    path.write_text(json.dumps(json.loads(path.read_text(encoding="utf-8")) | blocks), encoding="utf-8")
    read = load_run(copy / "run")
    assert math.isnan(read.findings[0].number)
    assert str(read.findings[0]) == str(finding)
    assert read.alternative == alternative


@pytest.mark.broad
def test_a_run_that_opened_a_bound_is_read_back_with_it(tmp_path):
    write_release(tmp_path / "swing.csv", parameters={"b_alpha": 2e-3}, orders={"lambda": 1, "mu": 1}, alpha=0.35,
                  step=1e-2, end=4.0, noise=1e-3)  # fmt: skip
    project = """
        [model.parameters]
        b_alpha = { start = 2e-4, lower = 0.0, upper = 5e-4 }
        [model.orders]
        lambda = 1.0
        mu = 1.0
        [[recording]]
        file = "swing.csv"
        alpha = { column = "alpha", unit = "rad" }
        [fit]
        initial_state = "rest"
    """
    kept = []
    fit_in(tmp_path, project, lambda fit: kept.append(fit) or ())
    run = load_run(tmp_path / "run")
    assert [b.name for b in kept[0].opened_bounds] == ["b_alpha"]
    assert run.problem.parameters == kept[0].problem.parameters
    assert run.problem.parameters["b_alpha"].upper == 5e-3
    assert run.project.problem.parameters["b_alpha"].upper == 5e-4  # as the file has it
    assert np.array_equal(run.x, kept[0].x)
    path = tmp_path / "run" / "result.json"
    path.write_text(path.read_text(encoding="utf-8").replace('"name": "b_alpha"', '"name": "C1"'), encoding="utf-8")
    with pytest.raises(InputError, match=r"A bound of 'C1' is said to be opened, and that is no free parameter"):
        load_run(tmp_path / "run")


def test_every_recording_is_simulated_to_the_same_bits_with_its_own_unknowns(fitted):
    folder, fit = fitted
    run = load_run(folder / "run")
    assert list(run.recordings) == list(fit.recordings)
    for name, before in fit.recordings.items():
        now = run.recordings[name]
        np.testing.assert_array_equal(now.time, before.time)
        for output in before.measured:
            np.testing.assert_array_equal(now.measured[output], before.measured[output])
            np.testing.assert_array_equal(now.fitted[output], before.fitted[output])
        assert (now.use, now.cost, now.sha256) == (before.use, before.cost, before.sha256)
        assert (dict(now.initial), dict(now.parameters)) == (dict(before.initial), dict(before.parameters))


def test_an_encoders_step_is_read_from_the_recordings(fitted):
    steps = load_run(fitted[0] / "run").resolutions
    assert set(steps) == {"release 20°", "release 10°"}
    assert set(steps["release 20°"]) >= {"theta", "alpha"}


def test_values_that_do_not_give_the_saved_rmse_are_told(copy):
    path = copy / "run" / "result.json"
    result = json.loads(path.read_text(encoding="utf-8"))
    result["orders"]["lambda"]["value"] += 0.02
    path.write_text(json.dumps(result), encoding="utf-8")
    notes = load_run(copy / "run").notes
    assert len(notes) == 4  # both outputs of both recordings
    assert "simulated again with the saved values, the RMSE of theta is" in notes[0]


def test_an_unknown_without_a_saved_value_stays_at_its_start_where_the_search_failed(copy):
    path = copy / "run" / "result.json"
    result = json.loads(path.read_text(encoding="utf-8"))
    result["orders"]["lambda"]["value"] = None
    path.write_text(json.dumps(result), encoding="utf-8")
    with pytest.raises(InputError, match="it has no value of lambda"):
        load_run(copy / "run")
    path.write_text(json.dumps(result | {"cost": result["cost"] | {"value": None}}), encoding="utf-8")
    assert load_run(copy / "run").x[0] == 1.0


def spoil_data(folder):
    write_twin(folder / "data" / "ten.csv", 0.17, seed=3)


def lose_result(state, rest):
    def spoil(folder):
        (folder / "run" / "result.json").write_text(rest, encoding="utf-8")
        (folder / "run" / "run.json").write_text(json.dumps(state), encoding="utf-8")

    return spoil


def lose_data(folder):
    shutil.rmtree(folder / "data")


@pytest.mark.parametrize(("spoil", "words"), [
    (spoil_data, "The recording 'release 10°' is not the one that .*run was fitted to; fit it again"),
    (lose_data, "cannot be read as the run read it: .* Put its recordings back, or fit again: fracid fit PROJECT"),
    (lambda f: (f / "run" / "result.json").unlink(), "The fit in .*run was finished, but its result.json cannot be"),
    (lose_result({"options": {"project": "rig.toml"}, "inputs": {}}, "{"), "The fit in .*run is not finished"),
    (lose_result({}, "[]"), "is no run folder: it has no result.json that can be read"),
    (lose_result([], "{"), "is no run folder: it has no result.json that can be read"),
    (lambda f: (f / "run" / "project.toml").unlink(), "is no run folder: it has no project.toml"),
    (lambda f: (f / "run" / "project.toml").write_text("[model"), "cannot be read as the run read it"),
    (lambda f: (f / "run" / "project.toml").write_text("[modell]"), "cannot be read as the run read it"),
])  # fmt: skip
def test_what_is_no_longer_the_run_is_refused(copy, spoil, words):
    spoil(copy)
    with pytest.raises(InputError, match=words):
        load_run(copy / "run")


def test_a_project_that_has_changed_since_counts_as_the_run_had_it_and_that_is_told(copy):
    (copy / "rig.toml").write_text(PROJECT.replace('initial_state = "rest"', ""), encoding="utf-8")
    run = load_run(copy / "run")
    assert run.problem.initial_state == "rest"
    (note,) = run.notes
    assert "rig.toml has changed since the run; what counts here is the run's own copy of it" in note


def test_a_project_that_is_gone_is_not_needed_where_its_recordings_are_found(copy, fitted):
    (copy / "rig.toml").unlink()
    run = load_run(copy / "run")
    assert run.notes == ()
    assert run.recordings["release 20°"].rmse == fitted[1].recordings["release 20°"].rmse


def test_recordings_beside_the_runs_own_copy_of_the_project_are_found(copy):
    (copy / "rig.toml").unlink()
    (copy / "data").rename(copy / "run" / "data")
    assert load_run(copy / "run").notes == ()


@pytest.mark.parametrize("broken", ["[1]", '{"options": 1}', "{"])
def test_either_of_what_a_run_says_of_its_project_is_enough(copy, broken):
    for lost in ("environment.json", "run.json"):
        other = copy / "run" / lost
        kept = other.read_text(encoding="utf-8")
        other.write_text(broken, encoding="utf-8")
        assert load_run(copy / "run").project.path == copy / "rig.toml"
        other.write_text(kept, encoding="utf-8")
