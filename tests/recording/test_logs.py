"""Logs as loggers write them: dates, quotes, a clock that begins again, JSON."""

import json

import numpy as np
import pytest

from fracid.errors import DataError
from fracid.recording import load_recording, read_table
from fracid.recording.readers.text import parse_text
from fracid.safety.paths import kind_of

T = np.arange(200) / 100
ALPHA = np.round(0.8 * np.cos(5 * T), 4)
RECORDS = [{"timestamp": t, "position": a, "load": None if k else 0.5} for k, (t, a) in enumerate(zip(T, ALPHA))]
SERVO = {"mass": 0.49, "length": 0.1, "motor": "xl330", "entries": RECORDS}
LAYOUTS = {
    "records": json.dumps(RECORDS),
    "a record a line": "\n".join(map(json.dumps, RECORDS)),
    "the log of a servo": json.dumps(SERVO),
    "columns": json.dumps({"timestamp": T.tolist(), "position": ALPHA.tolist()}),
    "columns by row": json.dumps({n: {str(k): r[n] for k, r in enumerate(RECORDS)} for n in ("timestamp", "position")}),
    "times of ROS": json.dumps(
        [{"stamp": {"sec": 1_700_000_000 + k // 100, "nanosec": k % 100 * 10**7}, "position": a}
         for k, a in enumerate(ALPHA)]),
    "dates": json.dumps([{"time": f"2024-01-01T12:00:{t:06.3f}Z", "position": a} for t, a in zip(T, ALPHA)]),
}  # fmt: skip


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_json_log_is_read_in_any_layout(tmp_path, layout):
    (tmp_path / "log.json").write_text(LAYOUTS[layout])
    recording = load_recording(tmp_path / "log.json", {"alpha": {"column": "position", "unit": "rad"}})
    np.testing.assert_array_equal(recording.signals["alpha"], ALPHA)
    np.testing.assert_allclose(recording.time - recording.time[0], T, atol=1e-6)


def test_what_stands_beside_the_records_of_a_log_is_said_and_a_list_is_a_column_for_each_place(tmp_path):
    (tmp_path / "log.json").write_text(json.dumps(SERVO | {"entries": [r | {"q": [1, 2.5]} for r in RECORDS]}))
    table = read_table(tmp_path / "log.json")
    assert table.names == ("timestamp", "position", "load", "q.0", "q.1")
    assert table.notes == ("Beside its samples it has mass = 0.49, length = 0.1, motor = xl330.",)
    assert np.isnan(table.values[1:, 2]).all()
    assert set(table.values[:, 4]) == {2.5}


@pytest.mark.parametrize(
    ("stamp", "separator"),
    [
        ("2024-03-01 23:59:{:06.3f}", ";"), ("2024-03-01T23:59:{:06.3f}Z", ","), ("2024/03/01 23:59:{:06.3f}", "\t"),
        ("23:59:{:06.3f}", ","), ("2024-03-01 23:59:{:06.3f}", " "), ('"2024-03-01T23:59:{:06.3f}+0100"', ","),
        ("2024-03-01 12:59:{:06.3f} PM", ","), ("2024-03-01 23:59:{:06.3f} UTC", ","),
        ("01.03.2024 23:59:{:06.3f}", ";"), ("31/3/2024 23:59:{:06.3f}", ","), ("3/31/2024 11:59:{:06.3f} PM", ","),
        ("07:{:06.3f}", ","),
    ],
)  # fmt: skip
def test_date_and_time_are_seconds_in_a_text(tmp_path, stamp, separator):
    rows = (f"{stamp.format(t)}{separator}{a}" for t, a in zip(T, ALPHA, strict=True))
    (tmp_path / "log.csv").write_text("\n".join(rows) + "\n")
    recording = load_recording(tmp_path / "log.csv")
    np.testing.assert_allclose(recording.time - recording.time[0], T, atol=1e-6)
    np.testing.assert_array_equal(next(iter(recording.signals.values())), ALPHA)


@pytest.mark.parametrize(
    ("date", "order", "seconds"),
    [("28/02/2024", "day, month, year", 1709078400), ("02/28/2024", "month, day, year", 1709078400),
     ("05.03.2024", "day, month, year", 1709596800)],
)  # fmt: skip
def test_a_date_without_its_year_in_front_has_its_day_there_unless_it_cannot_and_the_order_is_said(
    date, order, seconds
):
    table = parse_text("time;alpha\n" + "".join(f"{date} 00:00:0{k};{k}.5\n" for k in range(9)))
    assert table.values[0, 0] == seconds
    assert f"Dates are read as {order}." in table.notes


ROS = [f"{k},{1_700_000_000 + k // 100},{k % 100 * 10**7},base,joint1,{a}" for k, a in enumerate(ALPHA)]


@pytest.mark.parametrize("seconds", ["secs", "sec"])
def test_a_log_of_ros_has_its_columns_of_words_left_out_and_its_stamps_joined(tmp_path, seconds):
    part = "nsecs" if seconds == "secs" else "nanosec"
    head = f"header.seq,stamp.{seconds},stamp.{part},header.frame_id,name[0],position[0]"
    (tmp_path / "log.csv").write_text("\n".join([head, *ROS, ""]))
    recording = load_recording(tmp_path / "log.csv")
    assert recording.step == pytest.approx(0.01)
    np.testing.assert_array_equal(recording.signals["position[0]"], ALPHA)
    assert recording.assumed == {"position[0]"}  # it names a place, no unit
    said = "Left out: header.frame_id is no column of numbers; name[0] is no column of numbers."
    assert {said, f"stamp is stamp.{seconds} and stamp.{part} together."} <= {*recording.report.reading}


@pytest.mark.parametrize("day", ["2024-03-0{},", ""])
def test_a_time_of_day_goes_on_after_midnight_and_the_date_beside_it_is_no_signal(tmp_path, day):
    seconds = 86399 + T
    stamps = [
        f"{day.format(1 + int(s // 86400))}{'23:59:59' if s < 86400 else '00:00:00'}.{s % 1:.2f}" for s in seconds
    ]
    rows = "\n".join(f"{s.replace('.0.', '.')},{a}" for s, a in zip(stamps, ALPHA, strict=True))
    (tmp_path / "log.csv").write_text(f"{'Date,' * bool(day)}Time,alpha\n{rows}\n")
    recording = load_recording(tmp_path / "log.csv")
    np.testing.assert_allclose(recording.time, seconds)
    assert [*recording.signals] == ["alpha"]
    assert "'Time' begins again at midnight once: the clock is continued." in recording.report.reading


def test_stamps_that_are_all_alike_are_no_edges_of_an_encoder(tmp_path):
    rows = "".join(f"2024-03-05,{k % 3}\n" for k in range(200))
    (tmp_path / "log.csv").write_text("time,alpha\n" + rows)
    with pytest.raises(ValueError, match="time does not increase"):
        load_recording(tmp_path / "log.csv")


@pytest.mark.parametrize("cell", ["1,234.5", "3 V", "0x1F"])
def test_numbers_with_something_beside_them_are_no_words(tmp_path, cell):
    rows = "\n".join(f'{t};"{cell}";{a}' for t, a in zip(T, ALPHA, strict=True))
    (tmp_path / "log.csv").write_text(f"t;u;alpha\n{rows}\n")
    with pytest.raises(DataError, match="no row of numbers"):
        read_table(tmp_path / "log.csv")


def test_a_date_above_a_table_of_numbers_is_no_sample(tmp_path):
    rows = "\n".join(f"{t},{a}" for t, a in zip(T, ALPHA, strict=True))
    (tmp_path / "log.csv").write_text(f"2024-03-01,23:59:00\nt,alpha\n{rows}\n")
    assert read_table(tmp_path / "log.csv").values.shape == (200, 2)


@pytest.mark.parametrize(
    ("head", "row"), [('"Time [s]","Angle [deg]"', '"{},{:02d}","{}"'), ('"Time, s","Angle, deg"', '"{}.{:02d}","{}"')]
)
def test_quotes_keep_commas_in_cells_and_in_names(tmp_path, head, row):
    degrees = ["40,5" if ",{:02d}" in row else "40.5", "-3", "7"] * 30
    rows = [row.format(k // 100, k % 100, a) for k, a in enumerate(degrees)]
    (tmp_path / "log.csv").write_text("\n".join([head, *rows, ""]))
    recording = load_recording(tmp_path / "log.csv", {"alpha": "Angle"})
    assert recording.signals["alpha"][0] == pytest.approx(np.radians(40.5))
    assert recording.step == pytest.approx(0.01)


@pytest.mark.parametrize("name", ["micros", "time_us"])
def test_a_counter_that_begins_again_at_two_to_the_32_is_continued_and_said(tmp_path, name):
    ticks = ((2**32 - 500_000) + 1e4 * np.arange(200)) % 2**32
    text = "\n".join(f"{t:.0f},{a}" for t, a in zip(ticks, ALPHA, strict=True))
    (tmp_path / "log.csv").write_text(f"{name},alpha\n{text}\n")
    recording = load_recording(tmp_path / "log.csv")
    assert recording.step == pytest.approx(0.01)
    assert f"{name!r} begins again at 2³² once: the clock is continued." in recording.report.reading


@pytest.mark.parametrize("bits", [8, 16, 24, 32])
def test_a_count_of_an_encoder_that_begins_again_both_ways_is_continued_and_said(tmp_path, bits):
    counts = np.round(-80 * np.cos(np.pi * T) * np.exp(-T))  # from below 0, which begins at the top
    np.savetxt(tmp_path / "log.csv", np.c_[T, counts % 2**bits], "%.10g", ",", header="t,counts", comments="")
    encoder = {"column": "counts", "unit": "counts", "counts_per_turn": 400}
    recording = load_recording(tmp_path / "log.csv", {"alpha": encoder})
    np.testing.assert_allclose(recording.signals["alpha"], 2 * np.pi / 400 * counts, atol=1e-12)
    assert any(note.startswith("'counts' begins again at 2") for note in recording.report.reading)


@pytest.mark.parametrize(
    "command", [np.where(T < 1, 255, 0), 10 * (np.arange(200) // 20 % 2) + 240 * (T > 1),
                np.random.default_rng(1).integers(0, 256, 200),
                np.where(np.arange(200) == 90, 65535, np.round(300 * np.cos(6 * T)) + 400)]
)  # fmt: skip
def test_what_jumps_otherwise_is_no_count_that_begins_again(tmp_path, command):
    np.savetxt(tmp_path / "log.csv", np.c_[T, command], "%.10g", ",", header="t,x", comments="")
    recording = load_recording(tmp_path / "log.csv", {"x": {"column": "x"}})
    np.testing.assert_array_equal(recording.signals["x"], command)


def test_two_logs_in_one_file_are_no_counter_of_milliseconds_that_begins_again(tmp_path):
    stamps = np.r_[0:60000:300, 0:60000:300]
    np.savetxt(tmp_path / "log.csv", np.c_[stamps, np.cos(stamps)], "%.10g", ",", header="t_ms,x", comments="")
    with pytest.raises(ValueError, match=r"time does not increase: .*split the file there"):
        load_recording(tmp_path / "log.csv")


def test_a_clock_of_another_kind_that_falls_back_is_not_continued(tmp_path):
    stamps = np.where(T < 1, T, T - 0.5)
    (tmp_path / "log.csv").write_text("t,a\n" + "".join(f"{t},{a}\n" for t, a in zip(stamps, ALPHA, strict=True)))
    with pytest.raises(ValueError, match="time does not increase"):
        load_recording(tmp_path / "log.csv")


def test_a_json_of_a_run_is_no_recording(tmp_path):
    for name in ("log.json", "result.json"):
        assert kind_of(tmp_path / name) is None
        (tmp_path / name).write_text("{}")
        assert kind_of(tmp_path / "log.json") == ("recording" if name == "log.json" else None)
