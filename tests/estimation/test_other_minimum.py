"""Another minimum that is as good: a drug's exchanged rates, like branches of a circuit, a sign that nothing shows."""

import numpy as np
import pytest

import fracid

FLIP_FLOP = """
[model]
name = "drug"
[model.equations]
gut = "-ka*gut"
c = "ka*gut/V - ke*c"
[model.outputs]
c = {equals = "c", unit = "1"}
[model.parameters]
ka = {start = 0.2, lower = 0.01, upper = 9.0, unit = "1/s"}
ke = {start = 0.4, lower = 0.01, upper = 9.0, unit = "1/s"}
V = {start = 20.0, lower = 1.0, upper = 1000.0}
[[recording]]
file = "data.csv"
c = {column = "c", unit = "1"}
initial = {gut = 100.0, c = 0.0}
[fit]
substeps = 4
"""

TWO_DECAYS = """
[model]
name = "decays"
[model.equations]
fast = "-a*fast"
slow = "-b*slow"
[model.outputs]
y = {equals = "fast + slow", unit = "V"}
[model.parameters]
a = {start = 1.5, lower = 0.01, upper = 9.0, unit = "1/s"}
b = {start = 0.4, lower = 0.01, upper = 9.0, unit = "1/s"}
[[recording]]
file = "data.csv"
y = {column = "c", unit = "V"}
initial = {fast = 1.0, slow = 1.0}
[fit]
substeps = 4
"""

TWO_SIGNS = """
[model]
name = "signs"
[model.equations]
y = "-(a*a + 0.2*a)*y"
[model.outputs]
y = {equals = "y"}
[model.parameters]
a = {start = 1.5, lower = -3.0, upper = 9.0}
[[recording]]
file = "data.csv"
y = {column = "c"}
initial = {y = 1.0}
[fit]
substeps = 4
starts = 8
"""


def fitted(folder, text, time, values, seed=1, noise=0.02):
    noisy = values + noise * np.random.default_rng(seed).standard_normal(len(time))
    np.savetxt(folder / "data.csv", np.column_stack([time, noisy]), header="t,c", delimiter=",", comments="")
    (folder / "fit.toml").write_text(text)
    return fracid.identify(fracid.load_project(folder / "fit.toml"))


@pytest.mark.parametrize("wide", [True, False])
def test_rates_that_may_be_exchanged_are_not_identifiable_unless_bounds_part_them(wide, tmp_path):
    t = np.arange(0, 24, 0.2)
    curve = 100 / 30 * 0.5 / (0.5 - 0.2) * (np.exp(-0.2 * t) - np.exp(-0.5 * t))
    text = FLIP_FLOP if wide else FLIP_FLOP.replace("start = 0.2, lower = 0.01", "start = 0.6, lower = 0.35")
    found = fitted(tmp_path, text, t, curve).parameters
    for name, true in {"ka": 0.5, "ke": 0.2, "V": 30.0}.items():
        low, high = found[name].interval95
        assert low < true < high
        assert (found[name].identifiable == "practically not") == wide
    assert ("explains the recordings as well, with" in found["V"].reason) == wide


def test_branches_that_only_change_places_stay_identifiable(tmp_path):
    t = np.arange(0, 8, 0.02)
    found = fitted(tmp_path, TWO_DECAYS, t, np.exp(-2.0 * t) + np.exp(-0.3 * t)).parameters
    assert all(found[n].identifiable == "identifiable" for n in "ab")
    assert found["a"].interval95[0] < 2.0 < found["a"].interval95[1]


def test_what_another_start_found_is_said_where_nothing_can_be_exchanged(tmp_path):
    t = np.arange(0, 8, 0.02)
    low, high = fitted(tmp_path, TWO_SIGNS, t, np.exp(-2.0 * t)).parameters["a"].interval95
    assert low < -1.518 < 1.318 < high
