"""MATLAB's files: what is read is what SciPy reads, in every version, type and order of bytes."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from scipy.io import loadmat, savemat

from fracid.errors import DataError
from fracid.recording import load_recording
from fracid.recording.readers.content import LeftOut
from fracid.recording.readers.matlab import read_mat

DTYPES = ["<f8", "<f4", "i1", "u1", "<i2", "<u2", "<i4", "<u4", "<i8", "<u8"]
shapes = arrays.array_shapes(min_dims=1, max_dims=3, max_side=6)
numbers = st.sampled_from(DTYPES).flatmap(lambda dtype: arrays.arrays(dtype, shapes))
names = st.text("abcdefghijklmnopqrstuvwxyz_", min_size=1, max_size=31).filter(lambda name: name[0] != "_")


def write(folder, content, **options):
    file = folder / "run.mat"
    savemat(file, content, **options)
    return file


@given(content=st.dictionaries(names, numbers, min_size=1, max_size=4), packed=st.booleans())
def test_version_5_is_read_as_scipy_reads_it(tmp_path_factory, content, packed):
    file = write(tmp_path_factory.mktemp("v5"), content, do_compression=packed)
    expected = loadmat(file, squeeze_me=True)
    found = read_mat(file)
    assert list(found) == [name for name in expected if not name.startswith("__")]
    for name, array in found.items():
        np.testing.assert_array_equal(array, expected[name])


@pytest.mark.broad
@given(
    content=st.dictionaries(
        names, st.sampled_from([*DTYPES[:2], "<i4", "<i2", "<u2", "u1"]).flatmap(
            lambda dtype: arrays.arrays(dtype, arrays.array_shapes(min_dims=2, max_dims=2, max_side=6))),
        min_size=1, max_size=4,
    )
)  # fmt: skip
def test_version_4_is_read_as_scipy_reads_it(tmp_path_factory, content):
    file = write(tmp_path_factory.mktemp("v4"), content, format="4")
    expected = loadmat(file, squeeze_me=True)
    for name, array in read_mat(file).items():
        np.testing.assert_array_equal(array, expected[name])


def test_structs_are_walked_and_arrays_of_them_are_lists(tmp_path):
    several = np.array([(np.ones(3), "first"), (np.zeros(4), "second")], dtype=[("values", "O"), ("label", "O")])
    file = write(tmp_path, {"log": {"t": np.arange(3.0), "inner": {"alpha": np.ones(3)}}, "signals": several})
    found = read_mat(file)
    np.testing.assert_array_equal(found["log"]["inner"]["alpha"], np.ones(3))
    assert [s["label"].text for s in found["signals"]] == ["first", "second"]
    np.testing.assert_array_equal(found["signals"][1]["values"], np.zeros(4))


def test_what_is_no_array_of_real_numbers_is_left_out_with_its_reason(tmp_path):
    content = {"z": np.ones(3) * 1j, "c": np.array([1, "a"], dtype=object), "who": "me", "f": np.zeros((0, 3))}
    found = read_mat(write(tmp_path, content))
    assert {name: item.why.split(";")[0] for name, item in found.items() if isinstance(item, LeftOut)} == {
        "z": "is complex",
        "c": "is a cell array",
        "who": "is text",
    }
    assert found["f"].size == 0


def big_endian(name, values):
    """A file of version 5 as a machine of the other order of bytes writes it."""

    def element(kind, data):
        return struct.pack(">II", kind, len(data)) + data + bytes(-len(data) % 8)

    parts = [
        element(6, struct.pack(">II", 6, 0)),
        element(5, struct.pack(">ii", len(values), 1)),
        struct.pack(">HH4s", len(name), 1, name),  # a small element
        element(9, np.asarray(values, ">f8").tobytes()),
    ]
    return b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack(">H", 0x0100) + b"MI" + element(14, b"".join(parts))


def test_files_of_the_other_byte_order_are_read(tmp_path):
    (tmp_path / "run.mat").write_bytes(big_endian(b"t", [0.0, 0.1, 0.2]) + big_endian(b"a", [1.0, 2.0, 4.0])[128:])
    recording = load_recording(tmp_path / "run.mat", {"alpha": "a"}, time="t")
    np.testing.assert_array_equal(recording.signals["alpha"], [1, 2, 4])
    header = struct.pack(">5i", 1000, 3, 2, 0, 2) + b"m\0"
    (tmp_path / "old.mat").write_bytes(header + np.array([0, 0.1, 0.2, 1, 2, 4], ">f8").tobytes())
    np.testing.assert_array_equal(
        load_recording(tmp_path / "old.mat", {"alpha": 1}, time=0).signals["alpha"], [1, 2, 4]
    )


def test_dimensions_that_are_no_whole_numbers_are_damage(tmp_path):
    raw = big_endian(b"t", [0.0, 0.1, 0.2])
    dimensions = struct.pack(">II", 5, 8)
    (tmp_path / "run.mat").write_bytes(raw.replace(dimensions, struct.pack(">II", 7, 8)))  # as single precision
    with pytest.raises(DataError, match="dimensions that are no whole numbers"):
        read_mat(tmp_path / "run.mat")


@pytest.mark.parametrize("options", [{"format": "4"}, {}, {"do_compression": True}], ids=["4", "5", "7"])
def test_a_file_cut_anywhere_is_damaged_or_holds_whole_variables(tmp_path, options):
    file = write(tmp_path, {"t": np.arange(40.0), "alpha": np.arange(40.0) ** 2}, **options)
    whole, raw = read_mat(file), file.read_bytes()
    ends, kept = range(1, len(raw), 7), 0
    for end in ends:
        file.write_bytes(raw[:end])
        try:
            found = read_mat(file)
        except DataError:
            continue
        kept += 1  # cut between two variables
        assert all(np.array_equal(found[name], whole[name]) for name in found)
    assert kept < 0.05 * len(ends)
