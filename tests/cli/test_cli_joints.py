"""A run whose joints have states of their own, presliding's and a springpot's, goes through every command."""

import json
import re
import shutil

import numpy as np
import pytest

import fracid
from program import fit_in, run
from twins import write_release

pytestmark = pytest.mark.usefixtures("without_rivals")

TRUTH = {"coulomb_theta": 1e-2, "coulomb_alpha": 3e-4, "presliding_theta": 0.02, "presliding_alpha": 0.02,
         "springpot_alpha": 3e-4}  # fmt: skip

PROJECT = """
[model.parameters]
b_alpha = { start = 1e-4, lower = 0.0, upper = 1e-2 }
coulomb_theta = 0.01
coulomb_alpha = 3e-4
presliding_theta = 0.02
presliding_alpha = { start = 1e-2, lower = 1e-3, upper = 0.1 }
springpot_alpha = { start = 2e-4, lower = 0.0, upper = 0.1 }
[model.orders]
lambda = 1.0
mu = { start = 1.0, lower = 0.9, upper = 1.1 }
[fit]
substeps = 2
[[recording]]
file = "swing.csv"
theta = { column = "theta", unit = "rad" }
alpha = { column = "alpha", unit = "rad" }
initial = { "D^lambda theta" = 0.0, "D^mu alpha" = 0.0 }
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("joints")
    rig = fracid.rotary_pendulum("srv02-rotpen", **TRUTH)
    orders = {"lambda": 1.0, "mu": 1.0}
    write_release(folder / "swing.csv", rig, orders=orders, alpha=0.35, step=4e-3, end=3.0, finer=4, noise=1e-4)
    fit_in(folder, PROJECT)
    return folder


@pytest.fixture
def folder(made, tmp_path, monkeypatch):
    monkeypatch.chdir(shutil.copytree(made, tmp_path / "made"))
    return tmp_path / "made"


@pytest.mark.broad
def test_it_is_fitted_and_the_page_has_its_elements_and_none_that_are_off(folder, capsys):
    result = json.loads((folder / "run" / "result.json").read_text(encoding="utf-8"))
    for name in ("presliding_alpha", "springpot_alpha"):
        low, high = result["parameters"][name]["interval95"]
        assert low < TRUTH[name] < high
    (recording,) = result["recordings"].values()
    assert recording["initial_state"]["z_alpha"]["unit"] == "of presliding_alpha"
    assert [warning for warning in result["warnings"] if "z_" in warning] == []
    assert run(capsys, "report", "run")[0] == 0
    page = (folder / "run" / "report.html").read_text(encoding="utf-8")
    rows = re.findall(
        r'<th role="rowheader" scope="row"><span class="name">(?:<span class="point \w*"></span>)?([^<]*)', page
    )
    assert {"presliding_theta", "presliding_alpha", "springpot_order_alpha", "z_α at the start"} <= set(rows)
    assert not {"play_theta", "stiction_alpha", "saturation"} & set(rows)
    off = re.search(r"fixed values that are 0</summary><p>(.*?)</p>", page)[1]
    assert all(f"{name} <data" in off for name in ("play_theta", "stiction_alpha", "saturation"))


COMMANDS = {
    "reproduce": (["reproduce", "run"], []),
    "resid": (["resid", "run"], ["run/residuals.json"]),
    "export": (["export", "run", "--out", "out"], ["out/model.m", "out/fracid_model.c", "out/state_space.json"]),
    "simulate": (["simulate", "run", "--to", "twin.csv"], ["twin.csv"]),
    "simulate, another on": (["simulate", "run", "--set", "play_theta=0.01", "--to", "on.csv"], ["on.csv"]),
    "resume": (["resume", "run"], ["run/result.json"]),
    "profile": (["profile", "run", "--parameter", "presliding_alpha", "--points", "4"], ["run/profiles.json"]),
    "noise": (["noise", "run", "--levels", "0.01", "--seeds", "1", "--out", "noise"], ["noise/noise.json"]),
    "simulate, an element off": (["simulate", "run", "--set", "presliding_alpha=0", "--to", "off.csv"], ["off.csv"]),
}


@pytest.mark.broad
@pytest.mark.few(1)
@pytest.mark.parametrize("command", COMMANDS)
def test_each_command_takes_its_run(folder, capsys, command):
    words, files = COMMANDS[command]
    code, _, err = run(capsys, *words)
    assert (code, "Traceback" in err) == (0, False), err
    assert all((folder / file).stat().st_size > 0 for file in files)


@pytest.mark.broad
def test_a_state_that_the_values_leave_out_has_no_start(folder, capsys):
    code, _, err = run(capsys, "simulate", "run", "--set", "presliding_alpha=0", "--initial", "z_alpha=0.01")
    assert code == 2
    assert "unknown rotary-pendulum state 'z_alpha'" in err
    kept = fracid.load_run("run").problem.model.states
    assert {"z_theta", "z_alpha", "y_alpha"} <= set(kept)
    assert np.isfinite(fracid.load_run("run").result["cost"]["value"])
