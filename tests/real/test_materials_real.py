"""The recordings of materials that come with fracid, and what their pages say of them."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

import fracid
from fracid.problem.project import project_from_text
from helpers.materials import strip
from recordings import FOLDER, needs

ROOT = Path(__file__).parents[2]
REAL = ROOT / "examples" / "real"


@pytest.mark.parametrize("folder", ["titin", "supercapacitor", "spruce-creep"])
def test_a_licence_lies_beside_the_recordings(folder):
    assert "MIT" in (text := (REAL / folder / "LICENSE").read_text(encoding="utf-8")) or "CC BY 4.0" in text


@pytest.mark.broad
def test_titin_and_its_alternatives_cost_what_an_independent_solution_costs():
    """Springpot and Maxwell elements have closed forms over straight lines: evaluated apart from fracid, in NumPy."""
    project = fracid.load_project(REAL / "titin" / "titin.toml", trust=True)
    at = {
        "springpot": ([0.197, 0.225, 1.10, 1.254, 1.236], 0.553),
        "one Maxwell element": ([0.212, 1.789, 1.259, 1.693, 0.856], 0.841),
    }
    models = {"springpot": project.problem, **project.alternatives}
    for name, (x, cost) in at.items():
        assert models[name].cost(np.array(x)) == pytest.approx(cost, abs=3e-3)


@pytest.mark.slow
def test_titin_is_called_fractional_and_another_ramp_is_scored(tmp_path):
    folder = shutil.copytree(REAL / "titin", tmp_path / "titin")
    text = (folder / "titin.toml").read_text(encoding="utf-8")
    own = text[text.index("[[recording]]") : text.index("[[recording]]", text.index("[[recording]]") + 1)]
    another = own.replace('"0.1 s"', '"another"').replace("0.1s.csv", "another.csv") + 'use = "validate"\n'
    shutil.copy(folder / "relaxed_ramp_10s.csv", folder / "relaxed_ramp_another.csv")
    (folder / "titin.toml").write_text(text.replace("# What the order", f"{another}\n# What the order"))
    fit = fracid.identify(fracid.load_project(folder / "titin.toml", trust=True), jobs=2)
    assert fit.claim == "fractional", fit.claim_reasons
    low, high = fit.orders["nu"].interval95
    assert 0.05 < low < 0.197 < high < 0.5
    assert fit.recordings["another"].use == "validate"
    assert fit.recordings["another"].rmse == pytest.approx(fit.recordings["10 s"].rmse)


@pytest.mark.slow
@pytest.mark.parametrize(("maker", "branch"), [("maxwell", 0.0), ("eaton", 10.0)])
def test_a_supercapacitor_is_called_integer(maker, branch):
    project = fracid.load_project(REAL / "supercapacitor" / f"{maker}.toml", trust=True)
    comparison = fracid.compare(project, leave_one_out=True)
    assert comparison.claim == "integer", comparison.claim_reasons
    rows = {row.name: row for row in comparison.rows}
    assert rows["C(v) of order q, orders free"].bic - rows["one RC branch, orders 1"].bic > branch - 10.0


@needs("vhb4910")  # they have no licence
@pytest.mark.slow
def test_an_elastomers_springpot_predicts_the_half_hour_and_is_not_claimed():
    text = (REAL / "vhb4910" / "vhb4910.toml").read_text(encoding="utf-8")
    project = project_from_text(text, FOLDER / "vhb4910" / "vhb4910.toml")
    comparison = fracid.compare(project)
    assert comparison.claim == "undecided", comparison.claim_reasons
    held_out = {row.name: np.mean([score.rmse["force"] for score in row.held_out.values()])
                for row in comparison.rows}  # fmt: skip
    springpot = held_out["elastomer, orders free"]
    assert springpot == pytest.approx(0.034, abs=0.003)
    assert springpot < min(v for n, v in held_out.items() if n != "elastomer, orders free")


@pytest.mark.broad
def test_a_quarter_of_the_creep_of_spruce_determines_no_order():
    fit = fracid.identify(fracid.load_project(REAL / "spruce-creep" / "spruce.toml"))
    assert fit.claim == "undecided", fit.claim_reasons
    low, high = fit.orders["nu"].interval95
    assert low < 0.2 < 1.0 < high


@pytest.mark.broad
def test_the_project_of_the_page_reads_a_table_of_length_and_force(tmp_path):
    page = (ROOT / "docs" / "relaxation.md").read_text(encoding="utf-8")
    text = re.search(r"```toml\n(.*?)```", page, re.DOTALL)[1].replace("180.0", "20.0")
    table = np.loadtxt(strip(tmp_path).parent / "fast.csv", delimiter=",", skiprows=1)[:, :3] * [1, 1e3, 1]
    np.savetxt(tmp_path / "strip.csv", table, delimiter=",", header="t [s],stretch [mm],force [N]", comments="")
    project = project_from_text(text, tmp_path / "strip.toml")
    assert [*project.alternatives] == ["two Maxwell elements", "a stretched exponential"]
    assert [e.units for e in (*project.problem.experiments, *project.validation)] == [{"force": "N"}] * 2
    assert np.ptp(project.problem.experiments[0].inputs[:, 0]) == pytest.approx(0.5)
    assert all(np.isfinite(p.cost(p.start)) for p in (project.problem, *project.alternatives.values()))
