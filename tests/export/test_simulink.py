"""What Simulink's To Workspace block leaves in a .mat is read as it is: each signal under its label."""

import numpy as np
import pytest
from scipy.io import savemat

import fracid
from fracid.errors import FracidError

TIME = np.arange(0, 2, 0.01)
SWING = {"theta": 0.1 * np.sin(3 * TIME), "alpha": np.cos(7 * TIME)}


def structure_with_time(path, labels, **more):
    """A struct with .time and .signals(k).values, .dimensions, .label."""
    signals = np.zeros(len(labels), dtype=[("values", "O"), ("dimensions", "O"), ("label", "O")])
    for k, (label, values) in enumerate(zip(labels, SWING.values(), strict=False)):
        signals[k] = (values[:, None], 1.0, label)
    savemat(path, {"out": {"time": TIME[:, None], "signals": signals, "blockName": "rig/To Workspace"}, **more})
    return path


@pytest.mark.parametrize(
    ("labels", "names"),
    [
        (["theta", "alpha"], ["theta", "alpha"]),
        (["", ""], ["signal1", "signal2"]),
        (["angle", "angle"], ["signal1", "signal2"]),
        (["arm angle [deg]", "alpha"], ["signal1", "alpha"]),
    ],
)
def test_each_signal_of_a_structure_with_time_is_a_column_under_its_label(tmp_path, labels, names):
    recording = fracid.load_recording(structure_with_time(tmp_path / "run.mat", labels))
    assert [*recording.signals] == names
    np.testing.assert_allclose([*recording.signals.values()], [*SWING.values()])
    np.testing.assert_allclose(recording.time, TIME)


def test_a_column_of_it_is_named_by_struct_and_label(tmp_path):
    path = structure_with_time(tmp_path / "run.mat", ["theta", "alpha"])
    columns = {"alpha": {"column": "signals.alpha", "unit": "deg"}}
    recording = fracid.load_recording(path, columns, time={"column": "time"})
    np.testing.assert_allclose(recording.signals["alpha"], np.radians(SWING["alpha"]))


def test_a_single_signal_stays_under_values(tmp_path):
    recording = fracid.load_recording(structure_with_time(tmp_path / "run.mat", ["theta"]))
    np.testing.assert_allclose(next(iter(recording.signals.values())), SWING["theta"])


def test_an_array_of_other_structs_is_no_signal(tmp_path):
    others = np.array([(np.ones(3),), (np.ones(4),)], dtype=[("gains", "O")])
    savemat(tmp_path / "run.mat", {"others": others})
    with pytest.raises(FracidError, match="no arrays of numbers"):
        fracid.load_recording(tmp_path / "run.mat")
