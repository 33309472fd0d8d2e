"""Recordings: every format and dialect, units and zeros, what is measured, what is refused."""

import math
from dataclasses import FrozenInstanceError, replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io
from hypothesis import given, settings
from hypothesis import strategies as st

from fracid.errors import DataError, InputError
from fracid.problem.draft import draft_project, guess_file, why_uneven
from fracid.recording import Channel, Recording, inspect_recording, load_recording, read_table
from fracid.recording.clock import read_clock
from fracid.recording.guess import jumps
from fracid.recording.readers.text import parse_text
from fracid.signals.resolution import resolution
from fracid.signals.swing import release_time
from recordings import FOLDER, needs

COUNT = 2 * math.pi / 4096
TIME = np.arange(400) / 100
ALPHA = np.where(TIME < 1, 0.8, 0.8 * np.cos(5 * (TIME - 1)) * np.exp(-0.5 * (TIME - 1)))
THETA = 0.1 * np.sin(3 * TIME)


# --------------------------------------------------------------------------- text dialects

finite = st.floats(-1e6, 1e6).map(lambda x: float(f"{x:.6g}"))
dialects = st.sampled_from([(",", "."), (";", ","), (";", "."), ("\t", "."), ("\t", ","), (" ", "."), ("   ", "."),
                            ("|", "."), (" | ", ",")])  # fmt: skip
headers = st.sampled_from(["none", "names", "names and units", "remarks"])


@given(
    rows=st.lists(st.tuples(finite, finite, finite), min_size=3, max_size=20),
    dialect=dialects,
    header=headers,
    newline=st.sampled_from(["\n", "\r\n"]),
    bom=st.booleans(),
)
def test_a_table_written_in_any_dialect_is_read_back(tmp_path_factory, rows, dialect, header, newline, bom):
    delimiter, decimal = dialect
    lines = {
        "none": [],
        "names": [delimiter.join(["t", "theta", "alpha"])],
        "names and units": [delimiter.join(["t", "theta", "alpha"]), delimiter.join(["s", "deg", "rad"])],
        "remarks": ["# rig 7", "logged by hand on a rainy day in autumn, twice"],
    }[header]
    lines += [delimiter.join(repr(x).replace(".", decimal) for x in row) for row in rows]
    file = tmp_path_factory.mktemp("dialect") / "log.csv"
    file.write_bytes((b"\xef\xbb\xbf" if bom else b"") + newline.join([*lines, ""]).encode())
    table = read_table(file)
    np.testing.assert_array_equal(table.values, np.array(rows))
    if header.startswith("names"):
        assert table.names == ("t", "theta", "alpha")
    if header == "names and units":
        assert table.units == ("s", "deg", "rad")


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("1,5\n2,7\n", [[1, 5], [2, 7]]),
        ("angle\n1,5\n2,7\n", [[1.5], [2.7]]),
        ("1, 2\n3, 4\n", [[1, 2], [3, 4]]),
        ("1,2,\n3,4,\n", [[1, 2], [3, 4]]),
        ("a;b\n1;\n;2\n", [[1, np.nan], [np.nan, 2]]),
        ("% x y\n1e-3 2\n\n3 +4\n", [[1e-3, 2], [3, 4]]),
        ('"t","x"\n"0","1"\n"1","2"\n', [[0, 1], [1, 2]]),
        ("a,b,c\n9, 8, 7\n1\n2\n3\n", [[1], [2], [3]]),
        ("t,x\n0,NaN\n1,null\n2,3\n", [[0, np.nan], [1, np.nan], [2, 3]]),
    ],
)
def test_awkward_texts_are_read_as_a_person_would(tmp_path, text, values):
    file = tmp_path / "log.txt"
    file.write_text(text)
    np.testing.assert_array_equal(read_table(file).values, values)


def test_a_header_in_a_comment_names_the_columns():
    assert parse_text("# t theta\n0 1\n1 2\n").names == ("t", "theta")


@pytest.mark.parametrize(
    "header",
    [
        "sep=;\nt;x",
        "sep=;\nt [s];x [mm]",
        "Logger;Rig\nXYZ;Anna\nt [s];x [mm]",
        "Logger;Rig\nXYZ;Anna\nt;x\ns;mm",
        "t [s];x [mm];",
        "TS;x\nSec;mm\n;Smp",
        '"Time\n[s]";"x\n[mm]"',
        "x-axis;1\nt;x\ns;mm",
        "Samples;800\nt;x [mm];Comment",
    ],
)
def test_names_are_the_last_line_of_words_above_the_numbers_but_for_their_units(header):
    table = parse_text(header + "\n0;1,5\n1;2,5\n2;0,5\n")
    assert [name.split()[0].lower()[0] for name in table.names] == ["t", "x"]
    assert table.units[1] == ("mm" if "mm" in header else "")
    assert parse_text("sep=;\n0;1,5\n1;2,5\n").names == ("column 0", "column 1")


@pytest.mark.parametrize(("point", "separator"), [(".", ";"), (",", ";"), (",", "\t")])
def test_whole_numbers_with_separators_between_thousands_are_no_decimals(point, separator):
    counts = [int(9000 * math.cos(k / 9)) for k in range(400)]
    rows = [f"{k}{separator}{count:,}".replace(",", point) for k, count in enumerate(counts)]
    with pytest.raises(
        DataError, match=rf"column 1 .q, p..: -?1\{point}\d\d\d may mean -?1\d\d\d, .*as -?1\{point}\d\d\d0\."
    ):
        parse_text(f"t{separator}q, p.\n" + "\n".join(rows))


def test_decimals_that_may_have_three_digits_are_read():
    for column in ([0, 1.875], [f"{2 + k / 999:.3f}" for k in range(99)], [f"{k / 8:g}" for k in range(99)]):
        assert (
            np.ptp(parse_text("t;u\n" + "".join(f"{k};{column[k % len(column)]}\n" for k in range(99))).values[:, 1])
            > 0
        )


def test_units_are_taken_from_brackets_and_a_column_is_found_without_them(tmp_path):
    file = tmp_path / "log.csv"
    file.write_text("t [ms],alpha (deg)\n0,180\n10,90\n20,0\n")
    recording = load_recording(file, {"alpha": "alpha"}, time="t [ms]")
    np.testing.assert_allclose(recording.signals["alpha"], [math.pi, math.pi / 2, 0])
    np.testing.assert_allclose(recording.time, [0, 0.01, 0.02])
    assert "as the header says" in recording.report.reading[0]
    contrary = load_recording(file, {"alpha": Channel("alpha", unit="rad")}, time="t [ms]")
    [found] = contrary.trim(0.01).report.findings
    assert (found.code, found.number) == ("other-unit", pytest.approx(180 / math.pi))
    assert "alpha: it is taken as rad, as was said, and its header says deg." in contrary.report.warnings[0]
    same = load_recording(file, {"alpha": Channel("alpha", unit="deg")}, time="t [ms]")
    scaled = load_recording(file, {"alpha": Channel("alpha", unit="rad", scale=math.pi / 180)}, time="t [ms]")
    assert not any("header" in sentence for sentence in same.report.notes + scaled.report.notes)


@pytest.mark.parametrize(("first", "bits"), [(65000, 16), (2**32 - 500, 32), (2**31 - 500, -32), (32000, -16)])
def test_a_counter_that_begins_again_is_continued_whatever_its_bits(tmp_path, first, bits):
    ticks = (first + 10 * np.arange(99)) % 2 ** abs(bits)
    if bits < 0:  # with a sign
        ticks = np.where(ticks >= 2 ** (-bits - 1), ticks - 2**-bits, ticks)
    np.savetxt(tmp_path / "log.csv", np.c_[ticks, np.arange(99) % 7], "%d", ",", header="ms,alpha", comments="")
    found = load_recording(tmp_path / "log.csv")
    assert np.diff(found.time) == pytest.approx(0.01)
    assert any("begins again at 2" in note for note in found.report.reading)


def test_a_comma_that_is_both_is_asked_for_where_there_is_no_clock(tmp_path):
    (tmp_path / "both.csv").write_text("".join(f"0,{k % 90:02d},{400 - k % 7}\n" for k in range(200)))
    with pytest.raises(InputError, match="if the comma is both the separator and the decimal sign"):
        load_recording(tmp_path / "both.csv")


def test_the_numbers_of_rows_are_no_signal_and_columns_of_one_name_are_found_as_they_are_called(tmp_path):
    rows = "".join(f"{k},{k / 100},{k % 7},{k % 5}\n" for k in range(99))
    (tmp_path / "frame.csv").write_text(",time,alpha,alpha\n" + rows)
    read = load_recording(tmp_path / "frame.csv")
    assert [*read.signals] == ["alpha (2)", "alpha (3)"]
    both = load_recording(tmp_path / "frame.csv", {"alpha": "alpha (3)", "theta": "alpha (2)"})
    assert both.signals["alpha"].max() == 4.0


@pytest.mark.parametrize(("unit", "ticks"), [("s", 1), ("ms", 10**3), ("us", 10**6), ("ns", 10**9)])
def test_dates_of_which_nobody_says_the_unit_are_read_in_that_in_which_they_are_of_this_century(tmp_path, unit, ticks):
    rows = [f"{(1706745598 + k) * ticks},{k % 7}\n" for k in range(99)]
    (tmp_path / "log.csv").write_text("time,alpha\n" + "".join(rows))
    read = load_recording(tmp_path / "log.csv")
    assert np.diff(read.time) == pytest.approx(1.0, rel=1e-5)
    assert any(f"taken as {unit}, in which its first stamp" in note for note in read.report.reading) == (ticks > 1)
    in_us = load_recording(tmp_path / "log.csv", time={"column": 0, "unit": "us"})
    assert np.ptp(in_us.time) == pytest.approx(98e-6 * ticks)


@pytest.mark.parametrize("days", [45_321.25, 739_287.25])
@pytest.mark.parametrize(("step", "seconds"), [(1e-7, 86_400), (1e-3, 1)])
def test_short_records_that_count_the_days_of_this_century_are_of_spreadsheets_and_of_matlab(days, step, seconds):
    table = parse_text("time,alpha\n" + "".join(f"{days + step * k!r},{k % 7}\n" for k in range(99)))
    stamps, _, said = read_clock(table, None)
    assert np.ptp(stamps) == pytest.approx(98 * step * seconds, rel=1e-4)
    assert any("taken as d, in which its first stamp" in note for note in said.sentences) == (seconds > 1)


@pytest.mark.parametrize("encoding", ["utf-16", "latin-1"])
def test_other_encodings_are_read(tmp_path, encoding):
    file = tmp_path / "log.csv"
    file.write_bytes("t;Winkel [°]\n0;1\n1;2\n".encode(encoding))
    assert read_table(file).units == ("", "°")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("\n\n  \n", "is empty"),
        ("hello\nworld\n", "no row of numbers"),
        ("t,x\n0,1\n1,stuck\n2,3\n", r"line 3, column 1 \(x\): 'stuck' is not a number"),
        ("t,x\n0,abc\n1,2\n2,3\n", "'abc' in column 1"),
        ("0 1\n1 2\n2\n", "line 3: 1 cell where other lines have 2"),
        ("t;x\n0;999.5\n1;1,000.5\n2;998.5\n", "'1,000.5' has a separator between its thousands: .*, as 1000.5"),
        ("t;x\n" + "0,5;1 000,5\n" * 3, "'1 000,5' has a separator between its thousands: .*, as 1000,5"),
        ('t,x\n0,"4,005.0"\n1,999.0\n2,998.0\n', "is not a number. '4,005.0' has a separator .*, as 4005.0"),
        (
            "t;x\n" + "3,990;14.130\n" * 3,
            "'3,990' or '14.130' has a separator between its thousands: .* one decimal sign",
        ),
        ("t;x\n" + "31.02.2024 00:59:57,000;1,5\n" * 3, "Expected numbers like .* dates like 2024-01-31 12:00:00"),
        ("t;x\n" + "1,010 s;0,500 V\n" * 3, "Expected numbers like 0.01 or -1.5e-3, without units"),
        ("t,x\n" + "2024-03-05 12:00:00.5 Europe/Berlin,1.5\n" * 3, "no row of numbers.*Europe/Berlin"),
        (
            "t,x\n" + "".join(f"{k},{k % 7},{k % 5}\n" for k in range(9)),
            "2 names above rows of 3 cells: is the comma both",
        ),
        ("t,x\n0,1.5\n1,2.5\nt,x\n0,1.5\n", "line 4 repeats the names above the numbers: .*Split the file there"),
        ("a\0b", "is not text"),
    ],
)
def test_text_that_is_no_recording_is_refused_with_its_place(tmp_path, text, message):
    file = tmp_path / "log.csv"
    file.write_text(text)
    with pytest.raises(DataError, match=message):
        read_table(file)


# --------------------------------------------------------------------------- binary formats


def _write_mat(version):
    def write(file, layout):
        if version == "7.3":
            _write_mat73(file, layout)
            return
        form = {"format": "4" if version == "4" else "5", "do_compression": version == "7"}
        scipy.io.savemat(
            file, {"t": TIME, "alpha": ALPHA} if layout == "vectors" else {"data": _matrix(layout)}, **form
        )

    return write


def _write_mat73(file, layout):
    with h5py.File(file, "w", userblock_size=512) as h5:
        _fill_hdf5(h5, layout)
    with file.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


def _write_hdf5(file, layout):
    with h5py.File(file, "w") as h5:
        _fill_hdf5(h5.create_group("run"), layout)


def _fill_hdf5(group, layout):
    for name, array in ({"t": TIME, "alpha": ALPHA} if layout == "vectors" else {"data": _matrix(layout)}).items():
        group[name] = array if array.ndim == 2 else array[None, :]


def _write_npz(file, layout):
    np.savez(file, **({"t": TIME, "alpha": ALPHA} if layout == "vectors" else {"data": _matrix(layout)}))


def _matrix(layout):
    matrix = np.column_stack([TIME, ALPHA])
    return matrix.T if layout == "rows" else matrix


@pytest.mark.few(8)
@pytest.mark.parametrize("layout", ["rows", "columns", "vectors"])
@pytest.mark.parametrize(
    ("ending", "write"),
    [(".mat", _write_mat(v)) for v in ("4", "5", "7", "7.3")] + [(".h5", _write_hdf5), (".npz", _write_npz)],
    ids=["mat v4", "mat v5", "mat v7", "mat v7.3", "hdf5", "npz"],
)
def test_a_binary_file_is_read_in_any_layout(tmp_path, ending, write, layout):
    file = tmp_path / f"run{ending}"
    write(file, layout)
    recording = load_recording(
        file, {"alpha": "alpha" if layout == "vectors" else 1}, time="t" if layout == "vectors" else 0
    )
    np.testing.assert_array_equal(recording.time, TIME)
    np.testing.assert_array_equal(recording.signals["alpha"], ALPHA)


def test_a_clock_beside_a_matrix_is_seen_and_the_columns_of_the_matrix_keep_their_positions(tmp_path):
    signals = np.column_stack([0.1 * np.sin(3 * TIME), ALPHA])
    scipy.io.savemat(tmp_path / "run.mat", {"out": {"time": TIME, "values": signals, "gains": np.ones(7)}})
    recording = load_recording(tmp_path / "run.mat", {"alpha": 1})
    np.testing.assert_array_equal(recording.time, TIME)
    np.testing.assert_array_equal(recording.signals["alpha"], ALPHA)
    with pytest.raises(InputError, match="'gains' has 7 numbers beside the matrix 'values'"):
        load_recording(tmp_path / "run.mat", {"alpha": "gains"})


def test_a_struct_of_a_mat_file_is_walked(tmp_path):
    scipy.io.savemat(tmp_path / "run.mat", {"log": {"t": TIME, "alpha": ALPHA}})
    assert read_table(tmp_path / "run.mat").names == ("t", "alpha")


def test_a_structured_npy_array_keeps_its_names(tmp_path):
    array = np.zeros(5, dtype=[("t", float), ("alpha", float)])
    array["t"] = np.arange(5)
    np.save(tmp_path / "run.npy", array)
    assert read_table(tmp_path / "run.npy").names == ("t", "alpha")


def test_parquet_is_read_when_pyarrow_is_there(tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    parquet.write_table(pyarrow.table({"t": TIME, "alpha": ALPHA, "who": ["me"] * len(TIME)}), tmp_path / "run.parquet")
    np.testing.assert_array_equal(load_recording(tmp_path / "run.parquet", {"alpha": "alpha"}).signals["alpha"], ALPHA)


def test_a_duration_of_parquet_is_time(tmp_path):
    pyarrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    spans = pyarrow.array(np.arange(99) * 20, pyarrow.duration("ms"))
    parquet.write_table(pyarrow.table({"t": spans, "alpha": np.arange(99) % 7}), tmp_path / "run.parquet")
    assert load_recording(tmp_path / "run.parquet").step == pytest.approx(0.02)


def test_parquet_without_pyarrow_names_the_install_line(tmp_path, monkeypatch):
    (tmp_path / "run.parquet").write_bytes(b"PAR1")
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    with pytest.raises(InputError, match=r"pip install 'fracid\[parquet\]'"):
        read_table(tmp_path / "run.parquet")


def test_several_matrices_ask_for_a_choice_and_take_it(tmp_path):
    np.savez(tmp_path / "run.npz", first=_matrix("rows"), second=2 * _matrix("rows"))
    with pytest.raises(InputError, match=r"several arrays: first 2×400, second 2×400. Choose one: variable = 'first'"):
        read_table(tmp_path / "run.npz")
    assert read_table(tmp_path / "run.npz", "second").values[-1, 0] == 2 * TIME[-1]
    with pytest.raises(InputError, match=r"no variable 'third'. It holds: first 2×400"):
        read_table(tmp_path / "run.npz", "third")


@pytest.mark.parametrize("ending", [".mat", ".npz", ".npy", ".h5", ".parquet"])
def test_a_damaged_binary_file_is_told_so(tmp_path, ending):
    file = tmp_path / f"run{ending}"
    file.write_bytes(bytes(range(256)) * 8)
    with pytest.raises(DataError, match=r"damaged|is no|no arrays"):
        read_table(file)


def test_a_mat_file_of_a_terabyte_of_nothing_is_refused_unread(tmp_path):
    with (tmp_path / "huge.mat").open("wb") as file:
        file.truncate(1 << 40)
    with pytest.raises(DataError, match="is damaged or is no MATLAB file"):
        load_recording(tmp_path / "huge.mat")


def test_a_mat_file_cut_short_is_told_so(tmp_path):
    file = tmp_path / "run.mat"
    scipy.io.savemat(file, {"data": _matrix("rows")})
    file.write_bytes(file.read_bytes()[:3000])
    with pytest.raises(DataError, match="is damaged"):
        read_table(file)


def test_a_file_that_is_not_there_or_of_no_known_kind_is_the_callers_mistake(tmp_path):
    (tmp_path / "swing.csv").write_text("0 1\n1 2\n")
    (tmp_path / "swing.docx").write_text("x")
    with pytest.raises(InputError, match=r"no file .*swin.csv: did you mean .*swing.csv\?"):
        read_table(tmp_path / "swin.csv")
    with pytest.raises(InputError, match="it is a folder"):
        read_table(tmp_path)
    with pytest.raises(InputError, match=r"unknown ending '.docx'; fracid reads .csv"):
        read_table(tmp_path / "swing.docx")


# --------------------------------------------------------------------------- channels


@given(
    raw=st.lists(st.floats(-100, 100), min_size=4, max_size=10),
    sign=st.sampled_from([1, -1]),
    scale=st.floats(0.1, 10),
    zero=st.floats(-4, 4),
    unit=st.sampled_from([("rad", 1.0), ("deg", math.pi / 180), ("turns", 2 * math.pi), ("counts", COUNT), ("V", 1.0)]),
)
def test_value_is_sign_times_scale_times_raw_minus_zero(raw, sign, scale, zero, unit):
    name, factor = unit
    channel = Channel(0, name, sign, scale, zero, counts_per_turn=4096 if name == "counts" else None)
    np.testing.assert_allclose(channel.convert(np.array(raw)), sign * scale * factor * np.array(raw) - zero, atol=1e-12)


def test_unwrapping_undoes_whole_turns_and_passes_over_blanks():
    true = np.linspace(0, 20, 200)
    wrapped = (true + math.pi) % (2 * math.pi) - math.pi
    wrapped[50] = np.nan
    unwrapped = Channel(0, "rad", unwrap=True).convert(wrapped)
    np.testing.assert_allclose(np.delete(unwrapped, 50), np.delete(true, 50), atol=1e-12)


def test_zero_rest_is_the_mean_of_a_tail_at_rest_and_refuses_one_that_moves():
    still = np.r_[np.cos(np.linspace(0, 20, 900)), np.full(100, 0.25)]
    assert Channel(0, "rad", zero="rest").convert(still)[-1] == pytest.approx(0)
    with pytest.raises(DataError, match='alpha: zero = "rest" needs a recording that ends at rest'):
        Channel(0, "rad", zero="rest").convert(np.cos(np.linspace(0, 20, 900)), "alpha")


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"column": 1, "unit": "grad"}, "unit = 'grad' is not possible; expected 'rad' 'deg'"),
        ({"column": 1, "unit": ["deg"]}, r"unit = \['deg'\] is not possible"),
        ({"column": 1, "unwrap": "yes"}, "unwrap = 'yes' is not possible; expected true or false"),
        ({"column": 1, "sign": 2}, "sign = 2 is not possible; expected 1 or -1"),
        ({"column": 1, "scale": 0}, "scale = 0"),
        ({"column": 1, "zero": "tail"}, 'expected a number .* or "rest"'),
        ({"column": 1, "zero": math.nan}, "zero = nan"),
        ({"column": 1, "fill": "linear"}, 'expected "hold"'),
        ({"column": 1, "unit": "counts"}, "counts_per_turn = None .* e.g. 4096"),
        ({"column": 1, "counts_per_turn": 0}, "counts_per_turn = 0"),
        ({"column": -1}, "column = -1"),
        ({"column": 1.5}, "column = 1.5"),
        ({"column": 1, "offset": 3}, "unknown field of alpha 'offset'; the known ones are column, unit, sign"),
        ({"unit": "deg"}, r"alpha: no column given; type e.g. alpha = \{ column = 1 \}"),
    ],
)
def test_a_channel_with_an_impossible_field_is_refused(fields, message):
    with pytest.raises(InputError, match=message):
        Channel.of(fields, "alpha")


def _csv(folder: Path, **columns) -> Path:
    file = folder / "log.csv"
    rows = zip(*columns.values(), strict=True)
    text = [",".join("" if np.isnan(x) else repr(float(x)) for x in row) for row in rows]
    file.write_text("\n".join([",".join(columns), *text]) + "\n")
    return file


def test_a_missing_column_lists_those_that_are_there(tmp_path):
    file = _csv(tmp_path, t=TIME, alpha=ALPHA)
    with pytest.raises(
        InputError, match=r"no column 'alhpa'. Did you mean 'alpha'\? Its columns, .*: 0 't', 1 'alpha'"
    ):
        load_recording(file, {"alpha": "alhpa"})
    with pytest.raises(InputError, match="no column 7"):
        load_recording(file, {"alpha": 7})


def test_a_command_logged_only_when_it_changes_is_held(tmp_path):
    command = np.full(400, np.nan)
    command[[100, 200]] = 2.0, -1.0
    file = _csv(tmp_path, t=TIME, alpha=ALPHA, u=command)
    recording = load_recording(file, {"u": {"column": "u", "unit": "V", "fill": "hold"}}, time="t")
    np.testing.assert_array_equal(recording.signals["u"], np.repeat([0.0, 2.0, -1.0], [100, 100, 200]))
    assert "398 blanks hold the last value (0 before the first)" in " ".join(recording.report.notes)
    resampled = recording.resample(0.004).signals["u"]
    assert set(np.unique(resampled)) == {0.0, 2.0, -1.0}


# --------------------------------------------------------------------------- time


@pytest.mark.parametrize(
    ("time", "message"),
    [
        ({}, None),
        ({"rate": 0}, "rate = 0 is not possible"),
        ({"rate": "fast"}, "rate = 'fast'"),
        ({"column": 0, "rate": 100}, "is not possible; expected"),
        ({"unit": "ms"}, "is not possible; expected"),
        ({"column": 0, "unit": "days"}, "unit = 'days' is not possible; expected one of s, ms"),
        ({"columm": 0}, "is not possible; expected"),
    ],
)
def test_an_impossible_time_is_refused(tmp_path, time, message):
    file = _csv(tmp_path, t=TIME, alpha=ALPHA)
    if message is None:
        assert load_recording(file, time=time).step == pytest.approx(0.01)
        return
    with pytest.raises(InputError, match=message):
        load_recording(file, {"alpha": 1}, time=time)


@pytest.mark.parametrize("columns", [{}, ["alpha"]])
def test_columns_that_name_no_signal_are_refused(tmp_path, columns):
    with pytest.raises(InputError, match=r"names no signal; expected e.g. \{'alpha': 2\}"):
        load_recording(_csv(tmp_path, t=TIME, alpha=ALPHA), columns)


def test_without_a_clock_the_rate_is_asked_for_and_the_header_shown(tmp_path):
    (tmp_path / "log.txt").write_text("start_deg, rate\n90, 1000\n3.5\n2.5\n3.0\n")
    with pytest.raises(InputError, match=r"no column increases like time. The header says: start_deg, rate | 90, 1000"):
        load_recording(tmp_path / "log.txt")
    assert load_recording(tmp_path / "log.txt", time={"rate": 1000}).step == pytest.approx(1e-3)


def test_dates_are_counted_from_the_first_and_said(tmp_path):
    file = tmp_path / "log.csv"
    file.write_text("stamp,alpha\n" + "".join(f"{1.7e9 + i / 8:.3f},{i}\n" for i in range(5)))
    recording = load_recording(file, {"alpha": 1})
    np.testing.assert_array_equal(recording.time, np.arange(5) / 8)
    assert any("counted from the first stamp" in note for note in recording.report.notes)


@pytest.mark.parametrize("name", ["ms", "t_ms", "timeMs", "time ms", "TIME_MS", "millis"])
def test_a_clock_that_is_named_by_its_unit_is_in_it(tmp_path, name):
    recording = load_recording(
        _csv(tmp_path, **{"n": np.arange(400.0), name: 1000 * TIME + 0.1 * np.sin(TIME), "alpha": ALPHA})
    )
    assert recording.time[-1] == pytest.approx(TIME[-1], abs=1e-3)
    assert f"Time is in ms, as its name {name!r} says." in recording.report.reading


@pytest.mark.parametrize(
    ("name", "unit", "seconds"),
    [("hours", "h", 3600), ("hour", "h", 3600), ("minutes", "min", 60), ("elapsed_minutes", "min", 60),
     ("days", "d", 86400), ("time_d", "d", 86400), ("time [d]", "d", 86400)],
)  # fmt: skip
def test_a_clock_in_minutes_hours_or_days_is_read_in_seconds(tmp_path, name, unit, seconds):
    recording = load_recording(_csv(tmp_path, **{name: TIME, "alpha": ALPHA}))
    assert recording.time[-1] == pytest.approx(seconds * TIME[-1])
    assert any(line.startswith((f"Time is in {unit}", f"Time is taken from {name!r} [{unit}]"))
               for line in recording.report.reading)  # fmt: skip


@pytest.mark.parametrize("name", ["h", "d"])
def test_one_letter_alone_says_no_unit_of_time(tmp_path, name):
    assert load_recording(_csv(tmp_path, **{name: TIME, "alpha": ALPHA})).time[-1] == pytest.approx(TIME[-1])


@pytest.mark.parametrize(
    ("name", "factor", "unit"),
    [("force_N", 1.0, "N"), ("theta_1_deg", np.pi / 180, "rad"), ("q_1/mrad", 1e-3, "rad"), ("v_mm/s", 1e-3, "m/s"),
     ("tau_m_mNm", 1e-3, "N m"), ("acc_x_mg", 9.80665e-3, "m/s^2"), ("a (g)", 9.80665, "m/s^2"),
     *((n, 1.0, "rad") for n in ("strain_per_kPa", "speed_per_mV", "force_N_per_mm", "k_N/mm", "J in 1/MPa",
                                 "dose_mg", "dose_mg/kg", "delay_ms/kPa"))],
)  # fmt: skip
def test_a_unit_is_taken_from_a_name_but_not_from_a_quotient_or_a_mass(tmp_path, name, factor, unit):
    recording = load_recording(_csv(tmp_path, t=TIME, **{name: ALPHA}))
    assert recording.units == {name: unit}
    np.testing.assert_allclose(recording.signals[name], factor * ALPHA, rtol=1e-6)


def test_rows_without_a_time_stamp_are_left_out_and_said(tmp_path):
    time = TIME.copy()
    time[::3] = np.nan
    recording = load_recording(_csv(tmp_path, t=time, alpha=ALPHA), {"alpha": 1}, time="t")
    assert recording.time.size == np.isfinite(time).sum()
    assert any("134 of 400 rows have no time stamp" in note for note in recording.report.notes)


def test_missing_samples_are_a_data_error_that_says_how_many_where_and_what_to_do(tmp_path):
    alpha = ALPHA.copy()
    alpha[10:50] = np.nan
    file = _csv(tmp_path, t=TIME, alpha=alpha)
    with pytest.raises(
        DataError, match=r'alpha misses 40 samples from 0.1 to 0.49 s. .*Cut them off .* an input .* fill = "hold"'
    ):
        load_recording(file, {"alpha": 1})
    assert load_recording(file, {"alpha": 1}, start=0.6).time[0] == pytest.approx(0.6)


def test_scattered_blank_cells_are_bridged_and_not_scored(tmp_path):
    alpha, theta = ALPHA.copy(), THETA.copy()
    alpha[[0, *range(20, 400, 50), 399]] = np.nan
    theta[21] = np.nan
    file = _csv(tmp_path, t=TIME, alpha=alpha, theta=theta)
    report = inspect_recording(file).report
    assert report.level == "usable"
    assert (
        "alpha misses 10 samples, at most 1 in a row (2.5 %): a fit interpolates and does not score them"
        in report.notes
    )
    whole = load_recording(file)
    assert not whole.report.faults
    assert "alpha is missing at 10 of 400 times: it is interpolated there, and not scored." in whole.report.reading
    assert (whole.time[0], whole.time[-1]) == (0.01, 3.98)
    assert whole.blanks["alpha"][0] == pytest.approx((0.195, 0.205))
    assert (len(whole.blanks["alpha"]), len(whole.blanks["theta"])) == (8, 1)
    assert whole.signals["alpha"] == pytest.approx(ALPHA[1:-1], abs=2e-3)


def test_rows_that_are_written_twice_are_left_out_and_another_value_at_the_same_time_is_a_fault(tmp_path):
    k = np.sort(np.r_[np.arange(400), 50, 50, 80])
    report = inspect_recording(_csv(tmp_path, t=TIME[k], alpha=ALPHA[k])).report
    assert report.clock.samples == 400
    assert not report.faults
    assert "3 rows repeat the one before and were left out: the same time and the same values." in report.notes
    other = ALPHA[k] + np.where(np.arange(403) == 51, 0.01, 0.0)
    assert inspect_recording(_csv(tmp_path, t=TIME[k], alpha=other)).report.clock.duplicated == (0.5, 0.5)


def test_what_init_refuses_is_not_called_usable(tmp_path):
    few = _csv(tmp_path, t=TIME[:5], alpha=ALPHA[:5])
    assert (
        inspect_recording(few).report.verdict
        == "unfit: 5 samples are too few to identify a model from: record 50 or more"
    )
    with pytest.raises(InputError, match=r"5 samples are too few to identify a model from: record 50 or more\."):
        draft_project(few, {"alpha": {"column": 1}}, folder=tmp_path)
    still = inspect_recording(_csv(tmp_path, t=TIME, alpha=0 * TIME, theta=0 * TIME)).report
    assert still.level == "unfit"
    assert "no signal moves: is this the right file, and are its sensors connected?" in still.notes


def test_blank_cells_in_a_row_are_bridged_as_their_rows_are_where_they_are_left_out(tmp_path):
    blank = np.arange(400) // 15 == 4
    cells = load_recording(_csv(tmp_path, t=TIME, alpha=np.where(blank, np.nan, ALPHA)), {"alpha": 1})
    rows = load_recording(_csv(tmp_path, t=TIME[~blank], alpha=ALPHA[~blank]), {"alpha": 1}, resample="needed")
    assert cells.report.level == rows.report.level == "usable"
    np.testing.assert_allclose(cells.signals["alpha"], rows.signals["alpha"], atol=1e-9)
    spans = (cells.blanks["alpha"], rows.bridged)
    inside = [[(a < TIME) & (b > TIME) for a, b in own] for own in spans]
    np.testing.assert_array_equal(*inside)


def test_blank_cells_of_a_command_or_many_stay_a_fault(tmp_path):
    volts = np.where(np.arange(400) == 70, np.nan, np.sign(np.sin(TIME)))
    file = _csv(tmp_path, t=TIME, alpha=np.where(np.arange(400) // 21 == 4, np.nan, ALPHA), u=volts)
    report = inspect_recording(file, {"alpha": 1, "u": {"column": 2, "unit": "V"}}).report
    assert [fault.split(" from ")[0].split(" at ")[0] for fault in report.faults] == [
        "alpha misses 21 samples", "u misses 1 sample",
    ]  # fmt: skip


def test_the_name_of_a_signal_that_fills_a_page_is_cut_in_what_is_said_of_it(tmp_path):
    (tmp_path / "log.csv").write_text(f"t,a,{'9' * 900}x\n0,1,2\n0.1,,3\n0.2,2,\n0.3,4,2\n")
    with pytest.raises(DataError, match=r"a misses 1 sample at 0.1 s\. .* 9{40}\.\.\. misses 1 sample") as said:
        load_recording(tmp_path / "log.csv")
    assert len(str(said.value)) < 700


@pytest.mark.parametrize(
    "stamps",
    ["0,1e-320,2e-320,3e-320", "-1.5e308,-0.5e308,0.5e308,1.5e308", "0,1,inf,3", "0,,,", "0,1e300,2e300,3e300"],
)
def test_a_column_of_time_that_is_no_clock_says_nothing_against_the_rate(stamps, tmp_path):
    rows = "".join(f"{t},{k % 2}\n" for k, t in enumerate(stamps.split(",")))
    (tmp_path / "log.csv").write_text(f"time,alpha\n{rows}")
    found = load_recording(tmp_path / "log.csv", {"alpha": "alpha"}, time={"rate": 100})
    assert found.time.tolist() == [0.0, 0.01, 0.02, 0.03]
    assert not found.report.findings


LONG = {
    "digits": "9" * 300_000 + "x",
    "decimals": "9" * 150_000 + "." + "9" * 150_000 + "e",
    "a rate": "sampl" * 60_000,
    "a rate's line": "sampl" + "_" * 300_000,
    "blanks": "a" + " " * 300_000 + "b",
    "a bracket": "x" * 300_000 + " [",
    "joints": "joint2" * 50_000,
}
PLACES = {
    "a name": "t,{},a\n{}",
    "a line above": "# {}, b\n5, 3\nt,x,a\n{}",
    "a unit": "t,x,a\ns,{},rad\n{}",
    "a number": "t,x,a\n{1}0.6,{0},3\n",
}


@pytest.mark.few(2)
@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("what", LONG)
def test_a_cell_of_300_000_characters_costs_no_more_than_to_read_it(what, place, tmp_path):
    rows = "".join(f"{k / 100},{k % 7},{k % 5}\n" for k in range(50))
    (tmp_path / "log.csv").write_text(PLACES[place].format(LONG[what], rows))
    if place == "a number":  # who tries all ways to cut it in two is at it for hours
        with pytest.raises(DataError, match=r"log.csv, line 52, column 1 \(x\): '.{40}\.\.\.' is not a number"):
            inspect_recording(tmp_path / "log.csv")
    else:
        assert len(max(read_table(tmp_path / "log.csv").names, key=len)) <= 200
        assert len(max(inspect_recording(tmp_path / "log.csv").signals, key=len)) <= 200
        assert guess_file(tmp_path / "log.csv")[0]["alpha"]


@pytest.mark.parametrize(("shift", "message"), [(0.0, "1 stamp repeats the one before"), (-0.5, "1 stamp goes back")])
def test_time_that_does_not_increase_is_a_data_error(tmp_path, shift, message):
    time = np.arange(20.0)
    time[7] = time[6] + shift
    with pytest.raises(DataError, match=message):
        load_recording(_csv(tmp_path, t=time, alpha=np.arange(20.0)), {"alpha": 1}, time=0)


def test_a_clock_that_mostly_repeats_is_refused_without_a_warning():
    t = np.floor(np.arange(0, 9, 0.01))
    log = Recording.of("log", t, {"angle": np.sin(t)})
    assert log.report.level == "unfit"
    assert not why_uneven(log)
    assert not jumps(t, np.arange(900) % 3.0)


@pytest.mark.parametrize(("signal", "goes_by_jumps"), [
    (lambda t: 1.0 * (t >= 5) - 1.5 * (t >= 45) + (t >= 71), True),
    (lambda t: np.sin(0.2 * t), False),
    (lambda t: np.round(20 * np.sin(0.2 * t)) / 20, False),
    (lambda t: np.exp(-np.maximum(t - 5, 0) / 5), False),
    (lambda t: np.minimum(t, 40.0), False),
])  # fmt: skip
def test_pulses_jump_and_what_is_slow_does_not_where_samples_crowd_after_each_edge(signal, goes_by_jumps):
    """The edge itself came after a long gap, and counted by its rate: a twentieth."""
    t = np.unique(np.round(np.r_[np.arange(0, 100, 2.0), np.add.outer([5, 45, 71], np.arange(0, 8, 0.05)).ravel()], 3))
    noise = 1e-3 * np.random.default_rng(1).standard_normal(len(t))
    assert jumps(t, signal(t) + noise) == goes_by_jumps


def test_a_recording_without_an_angle_says_nothing_of_a_release():
    t = np.arange(400) / 10
    cell = Recording.of("cell", t, {"voltage": 3 + t / 90 + 0.01 * np.cos(t)}, {"voltage": "V"}).report
    assert "release" not in cell.verdict
    assert "release" not in dict(cell.rows())
    swing = Recording.of("swing", t, {"alpha": np.cos(t)}).report
    assert "no release found" in swing.verdict
    assert "release" in dict(swing.rows())


@pytest.mark.parametrize(("rest", "said"), [(np.pi + 0.02, "off π"), (4.38, "")])
def test_where_an_angle_rests_is_held_against_half_a_turn_only_near_one(rest, said):
    t = np.arange(0, 20, 0.01)
    (row,) = Recording.of("log", t, {"motor": rest * -np.expm1(-3 * t)}).report.signal_rows()
    assert said in row["rest"]
    assert ("off" in row["rest"]) == bool(said)


def test_one_sample_is_too_few(tmp_path):
    (tmp_path / "log.csv").write_text("t,alpha\n0,1\n")
    with pytest.raises(DataError, match="1 sample; a recording needs at least two"):
        load_recording(tmp_path / "log.csv", {"alpha": 1}, time=0)


def test_a_long_gap_makes_a_recording_unfit_and_a_short_one_usable():
    time = np.arange(400) / 100
    short = Recording.of("short", np.delete(time, slice(200, 205)), {"alpha": np.delete(ALPHA, slice(200, 205))})
    assert short.report.level == "usable"
    assert short.report.clock.gaps == ((1.99, 0.06),)
    long = Recording.of("long", np.delete(time, slice(200, 300)), {"alpha": np.delete(ALPHA, slice(200, 300))})
    assert long.report.level == "unfit"
    with pytest.raises(DataError, match=r"a gap of 1.01 s after 1.99 s is 25 % of the recording"):
        long.resample()


# --------------------------------------------------------------------------- trim, split, resample


def test_a_held_signal_keeps_its_samples_in_a_long_record():
    """After some hours a stamp is rounded by more than 10⁻¹² s: a tenth of the samples were those before them."""
    time, u = np.round(0.3 * np.arange(100_000), 6), np.arange(100_000.0)
    log = replace(Recording.of("log", time, {"u": u}, {"u": "V"}), held=frozenset({"u"}))
    assert np.array_equal(log.resample(0.3).signals["u"], u)


def test_a_held_signal_jumps_neither_late_nor_early_by_resampling():
    """It jumped at the next point of the grid: late by half a step on the average."""
    time, u = np.arange(500) / 100 + np.random.default_rng(1).uniform(-2e-3, 2e-3, 500), np.repeat(np.arange(20.0), 25)
    log = replace(Recording.of("log", time, {"u": u}, {"u": "V"}), held=frozenset({"u"}))
    meant = np.sum(u[:-1] * np.diff(time))
    for step in (0.01, 0.003, 0.05):
        even = log.resample(step)
        beyond = (even.time[-1] + step - time[-1]) * u[-1]
        assert step * even.signals["u"].sum() == pytest.approx(meant + beyond, rel=1e-6)


def test_a_straight_line_survives_resampling_of_a_jittering_clock():
    rng = np.random.default_rng(1)
    time = np.arange(500) / 100 + rng.uniform(-2e-3, 2e-3, 500)
    line = Recording.of("line", time, {"alpha": 3 * time - 1})
    assert line.step is None
    even = line.resample()
    assert even.step == pytest.approx(0.01)
    np.testing.assert_allclose(even.signals["alpha"], 3 * even.time - 1, atol=1e-12)
    assert even.report.resampled is not None
    assert even.report.level == "usable"


def test_resampling_names_each_gap_it_bridges():
    time = np.delete(np.arange(400) / 100, slice(200, 205))
    even = Recording.of("gap", time, {"alpha": np.cos(time)}).resample()
    assert even.report.resampled is not None
    assert "The gap of 60 ms after 1.99 s was bridged by a line." in even.report.resampled


def test_a_gap_that_is_bridged_stands_still_in_no_motion():
    time = np.arange(0, 12, 0.01)
    swing = np.round(4e2 * np.exp(-time / 60) * np.cos(4 * np.pi * time)) * np.pi / 2048
    for k in (200, 700):  # a whole swing each, so that the bridge is flat
        lost = (time > time[k]) & (time < time[k] + 0.5)
        time, swing = time[~lost], swing[~lost]
    recording = Recording.of("log", time, {"alpha": swing})
    for part in (recording, recording.resample(), recording.resample().trim(1.0)):
        assert "repeated" not in [f.code for f in part.report.findings]


@pytest.mark.parametrize("jump", [0.05, 0.3, 4.0])
def test_a_clock_that_was_set_is_told_from_samples_that_are_lost(jump):
    time = np.arange(0, 100, 0.01)
    swing = np.round(4e2 * np.exp(-time / 60) * np.cos(6 * time)) * np.pi / 2048
    lost = (time > 20.0) & (time < 20.0 + jump)
    was_set = Recording.of("log", np.where(time > 20, time + jump, time), {"alpha": swing}).report.findings
    was_lost = Recording.of("log", time[~lost], {"alpha": swing[~lost]}).report.findings
    assert [f.code for f in was_set] == ["clock-jump"]
    assert was_set[0].number == pytest.approx(jump + 0.01)
    assert was_lost == ()


def test_resample_needed_leaves_a_uniform_recording_alone(tmp_path):
    file = _csv(tmp_path, t=TIME, alpha=ALPHA)
    assert load_recording(file, {"alpha": 1}, resample="needed").report.resampled is None
    assert load_recording(file, {"alpha": 1}, resample=True).report.resampled is not None
    assert load_recording(file, {"alpha": 1}, resample=0.02).step == pytest.approx(0.02)
    with pytest.raises(InputError, match="resample = 'always'"):
        load_recording(file, {"alpha": 1}, resample="always")


@pytest.mark.parametrize("step", [0.0, -1.0, 100.0, math.nan])
def test_an_impossible_step_is_refused(step):
    with pytest.raises(InputError, match=r"expected above 0 and at most 3.99 s"):
        Recording.of("twin", TIME, {"alpha": ALPHA}).resample(step)


@settings(max_examples=8)
@given(at=st.floats(0.1, 3.8))
def test_split_parts_together_are_the_whole(at):
    twin = Recording.of("twin", TIME, {"alpha": ALPHA})
    before, after = twin.split(at)
    np.testing.assert_array_equal(np.r_[before.time, after.time], TIME)
    np.testing.assert_array_equal(np.r_[before.signals["alpha"], after.signals["alpha"]], ALPHA)


def test_trimming_to_nothing_is_refused_with_the_span():
    with pytest.raises(InputError, match=r"from 7 to 9 s holds 0 samples; it spans 0 to 3.99 s"):
        Recording.of("twin", TIME, {"alpha": ALPHA}).trim(7, 9)


def test_a_recording_cannot_be_changed():
    twin = Recording.of("twin", TIME, {"alpha": ALPHA})
    with pytest.raises(FrozenInstanceError):
        twin.name = "other"
    with pytest.raises(ValueError, match="read-only"):
        twin.signals["alpha"][0] = 1.0


def test_signals_of_another_length_than_time_are_refused():
    with pytest.raises(InputError, match=r"alpha has shape \(3,\) and time \(400,\)"):
        Recording.of("twin", TIME, {"alpha": np.zeros(3)})


# --------------------------------------------------------------------------- what is measured


@pytest.mark.few(2)
@pytest.mark.parametrize("counts", [1024, 4000, 4096, 20000])
@pytest.mark.parametrize("digits", [None, 5])
def test_the_encoder_is_recognised_even_through_a_rounding_logger(counts, digits):
    q = 2 * math.pi / counts
    signal = q * np.round(np.cos(5 * np.arange(5000) / 500) / q)
    report = Recording.of(
        "twin", np.arange(5000) / 500, {"alpha": signal if digits is None else signal.round(digits)}
    ).report
    assert report.signals[0].counts_per_turn == counts


def test_a_signal_of_floating_point_has_no_resolution():
    assert resolution(np.random.default_rng(0).normal(size=2000)) is None
    assert resolution(np.zeros(10)) is None


def test_gaps_and_blank_cells_add_nothing_to_the_noise():
    time = np.arange(2000) / 250
    swing = np.cos(6 * time) + 1e-3 * np.random.default_rng(1).standard_normal(time.size)
    kept = (time < 2.4) | (time > 2.64)
    blank = np.where(np.arange(time.size) % 50 == 7, np.nan, swing)
    whole = Recording.of("whole", time, {"alpha": swing}).report.signals[0].noise
    for one in (Recording.of("gap", time[kept], {"alpha": swing[kept]}), Recording.of("blank", time, {"alpha": blank})):
        assert one.report.signals[0].noise == pytest.approx(whole, rel=0.05)


def test_the_noise_is_measured_beside_a_swing():
    t = np.arange(5000) / 500
    noisy = np.cos(6 * t) + np.random.default_rng(3).normal(scale=1e-3, size=t.size)
    assert Recording.of("twin", t, {"alpha": noisy}).report.signals[0].noise == pytest.approx(1e-3, rel=0.05)


def test_the_rest_is_given_as_its_distance_from_a_multiple_of_pi():
    signal = np.r_[2 * np.cos(np.arange(2000) / 50), np.zeros(500)] - 2 * math.pi - 0.02
    measured = Recording.of("twin", np.arange(2500) / 500, {"alpha": signal}).report.signals[0]
    assert measured.at_rest
    assert measured.rest_offset == pytest.approx(-0.02)


def _held_release(shake: float, drift: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """At rest, lifted by hand, held by a hand that shakes and drifts, let go at 5 s."""
    t = np.arange(0, 20, 0.002)
    w = np.random.default_rng(seed).uniform(3, 12, 3)
    lift = np.interp(t, [0, 2, 3.5, 20], [0, 0, 1.0, 1.0])
    hold = lift + (t > 3.5) * (drift * (t - 3.5) + shake * sum(np.sin(wi * t) for wi in w) / 3)
    free = hold[np.searchsorted(t, 5.0)] * np.cos(6.5 * (t - 5)) * np.exp(-0.2 * (t - 5))
    return t, COUNT * np.round(np.where(t < 5, hold, free) / COUNT)


@pytest.mark.parametrize(("shake", "drift"), [(0, 0), (0.005, 0), (0, 0.03), (0.005, -0.03)])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_release_is_found_though_the_hand_shakes_and_drifts(shake, drift, seed):
    release, reason = release_time(*_held_release(shake, drift, seed))
    assert release == pytest.approx(5.0, abs=0.03), reason


@given(phase=st.floats(0, 6.2), decay=st.floats(0, 0.5))
def test_a_swing_without_a_plateau_has_no_release(phase, decay):
    t = np.arange(0, 10, 0.002)
    release, reason = release_time(t, np.cos(6 * t + phase) * np.exp(-decay * t))
    assert release is None
    assert "not held still" in reason


def test_start_at_release_begins_on_the_plateau(tmp_path):
    file = _csv(tmp_path, t=TIME, alpha=ALPHA)
    recording = load_recording(file, {"alpha": 1}, start="release")
    assert recording.time[0] == pytest.approx(1.0, abs=0.03)
    with pytest.raises(DataError, match=r"no release found \(nothing moves\). Give from as a time"):
        load_recording(_csv(tmp_path, t=TIME, alpha=0 * TIME), {"alpha": 1}, time=0, start="release")


def test_guessing_takes_the_most_even_clock_and_says_all(tmp_path):
    arrival = TIME + np.random.default_rng(0).uniform(0, 0.005, TIME.size)
    file = _csv(tmp_path, arrival=arrival, stamp=TIME, alpha=ALPHA, still=0 * TIME)
    report = inspect_recording(file).report
    said = " ".join(report.reading)
    assert "Time is taken from 'stamp' [s]." in said
    assert "Left out as constant: 'still'." in said
    assert "alpha has no unit: taken as rad." in said


def test_a_unit_of_something_else_in_a_header_is_no_angle_s(tmp_path):
    file = tmp_path / "house.csv"
    table = np.column_stack([TIME, 20 + ALPHA, 5 + ALPHA, ALPHA])
    np.savetxt(file, table, delimiter=",", header="time,temp [degC],load [kOhm],beam [left]", comments="")
    assert inspect_recording(file).units == {"temp [degC]": "1", "load [kOhm]": "1", "beam [left]": "1"}


def test_a_column_named_like_time_is_the_clock_even_if_it_goes_back(tmp_path):
    time = TIME.copy()
    time[200:] -= 1.0
    recording = inspect_recording(_csv(tmp_path, counter=np.arange(400.0), time=time, alpha=ALPHA))
    [(row, at, before)] = recording.report.clock.backward
    assert (row, at, before) == (201, pytest.approx(1.0), pytest.approx(1.99))
    assert "1 stamp goes back, the first in row 201: 1 s after 1.99 s." in recording.report.faults[0]
    assert recording.report.faults[0].endswith("or split the file there.")
    assert set(recording.signals) == {"alpha"}  # what counts the rows is none


def test_few_samples_are_never_good():
    assert Recording.of("few", np.arange(30.0), {"alpha": np.arange(30.0)}).report.level == "usable"


def test_a_report_is_plain_json(tmp_path):
    import json

    report = inspect_recording(_csv(tmp_path, t=TIME, alpha=np.full(400, np.nan)), {"alpha": 1}, time=0).report
    content = json.loads(json.dumps(report.to_dict(), allow_nan=False))
    assert content["level"] == "unfit"
    assert len(content["signals"]["alpha"]["missing"]) == 400


# --------------------------------------------------------------------------- real rigs

JOINTS = "/joint_states"
SRV02 = {"theta": {"column": 1, "unit": "rad"}, "alpha": {"column": 2, "unit": "rad", "zero": math.pi}}
ODRIVE = {name: {"column": f"{JOINTS}/joint{k}/position", "unit": "rad"} for k, name in enumerate(["theta", "alpha"])}
STAMP = {"column": f"{JOINTS}/header/stamp"}
STEPPER = {"alpha": {"column": 0, "unit": "deg", "scale": 0.99}}


@needs()
@pytest.mark.parametrize(
    ("file", "columns", "time", "samples", "step", "release"),
    [
        ("srv02-rotpen/release_92deg.mat", SRV02, 0, 27896, 0.002, 9.66),
        ("srv02-rotpen/release_16deg.mat", SRV02, 0, 24546, 0.002, 7.37),
        ("srv02-rotpen/pulse_10V.mat", SRV02 | {"u": {"column": 3, "unit": "V"}}, 0, 25400, 0.002, 0.1),
        ("odrive-furuta/fall_a.csv", ODRIVE, STAMP, 20144, 0.002, 1.39),
        ("odrive-furuta/fall_b.csv", ODRIVE, STAMP, 15258, 0.002, 0.24),
        ("odrive-furuta/sine_2V.csv", ODRIVE | {"u": Channel("/effort_control/data.0", "V", fill="hold")}, STAMP, 2226,
         0.002, None),
        *((f"stepper-freeswing/pendulum_free_swing_data_0{k}.txt", STEPPER, {"rate": 1000}, 5000, 0.001, None)
          for k in (1, 2, 3)),
    ],
)  # fmt: skip
def test_every_recording_of_a_real_rig_loads_as_it_is(file, columns, time, samples, step, release):
    recording = load_recording(FOLDER / file, columns, time=time)
    assert recording.time.size == samples
    assert recording.report.release == (None if release is None else pytest.approx(release, abs=0.02))
    even = load_recording(FOLDER / file, columns, time=time, resample="needed")
    assert even.step == pytest.approx(step)
    assert (even.report.resampled is not None) == file.startswith("odrive")
    if file.startswith("srv02"):
        assert {s.counts_per_turn for s in recording.report.signals if s.unit == "rad"} == {4096}


@needs()
def test_the_43_ms_gap_of_fall_a_is_named():
    clock = load_recording(FOLDER / "odrive-furuta/fall_a.csv", ODRIVE, time=STAMP).report.clock
    assert max(length for _, length in clock.gaps) == pytest.approx(0.0428, abs=1e-4)


def test_a_comment_with_as_many_commas_as_columns_is_not_taken_for_the_header(tmp_path):
    file = tmp_path / "twin.csv"
    file.write_text("# SIMULATED, not measured\n# made by a script\ntime [s],alpha [deg]\n0,1\n1,2\n2,3\n")
    recording = load_recording(file)
    assert list(recording.signals) == ["alpha [deg]"]


def test_a_part_that_begins_at_the_release_still_knows_it():
    t = np.linspace(0, 10, 1001)
    held = Recording.of("swing", t, {"alpha": np.where(t < 4, 0.5, 0.5 * np.cos(6 * (t - 4)))})
    assert held.trim("release").report.release == held.report.release == pytest.approx(4.0, abs=0.02)
    assert held.trim(5.0).report.release is None


@pytest.mark.parametrize("what", [np.ones((9, 2)), {"t": [1.0]}, 3, None])
def test_what_is_no_path_is_called_by_its_kind_and_not_quoted(what):
    with pytest.raises(InputError, match=f"A {type(what).__name__} is no path; expected e.g. 'release.csv'"):
        load_recording(what)


@pytest.mark.parametrize("names", ["t,alpha,\n", "t,alpha\n", ""])
def test_a_delimiter_at_each_lines_end_makes_no_column(names):
    table = parse_text(f"{names}0,0.1,\n0.1,0.2,\n0.2,0.3,\n")
    assert table.values.tolist() == [[0.0, 0.1], [0.1, 0.2], [0.2, 0.3]]
    assert table.names == (("t", "alpha") if names else ("column 0", "column 1"))


def test_of_hundreds_of_columns_that_nobody_named_some_are_looked_at(tmp_path):
    rows = np.random.default_rng(1).standard_normal((40, 260))
    np.savetxt(tmp_path / "bus.csv", np.column_stack([np.arange(40) / 100, rows]), delimiter=",", fmt="%.4f")
    recording = inspect_recording(tmp_path / "bus.csv")
    assert len(recording.signals) == 200
    assert "Left out as beyond 200 signals: 60 columns; name those that are meant." in recording.report.reading


def test_counts_in_a_header_lack_the_counts_of_a_turn_and_not_a_unit(tmp_path):
    t = np.arange(2000) / 200
    file = tmp_path / "swing.csv"
    alpha = np.rint(600 * np.exp(-0.2 * t) * np.cos(6.5 * t))
    np.savetxt(
        file, np.column_stack([t, alpha]), delimiter=",", header="time [s],alpha [counts]", comments="", fmt="%g"
    )
    said = "\n".join(inspect_recording(file, guess_units=True).report.notes)
    assert "alpha [counts] says no counts a turn: taken to be counts of 4096 a turn" in said


def test_a_step_is_told_in_a_unit_that_suits_it():
    level = {"level": np.sin(np.arange(60.0))}
    for step, said in ((21600.0, "6 h"), (150.0, "2.5 min"), (5.0, "5 s"), (2e-3, "2 ms")):
        recording = Recording.of("slow", step * np.arange(60), level, {"level": "m"})
        assert f"one every {said}" in str(recording)
        assert dict(recording.report.rows())["rate"].endswith(f"(step {said})")
