"""The recordings of materials that come with fracid, and what their pages say of them."""

import shutil
from pathlib import Path

import numpy as np
import pytest

import fracid

REAL = Path(__file__).parents[2] / "examples" / "real"


@pytest.mark.parametrize("folder", ["titin", "supercapacitor"])
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
