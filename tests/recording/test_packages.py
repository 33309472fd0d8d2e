"""Formats of other programs, each written by its own package and read back; and what a damaged one may not do."""

import io
import sqlite3
import zipfile
from contextlib import closing

import numpy as np
import pytest

from fracid.errors import DataError, InputError
from fracid.recording import inspect_recording, load_recording, read_table
from fracid.recording.readers import packages
from fracid.recording.readers.table import READERS
from fracid.safety import apart
from logs import answer_here, db3, mcap, mdf, tdms, xlsx

T = np.arange(200) / 100
ALPHA = 0.8 * np.cos(5 * T)
COMMANDS = [(0.5, 1.0), (1.0, -2.0)]
U = np.array(COMMANDS).T
ROWS = [["t [s]", "alpha [rad]"], *zip(T, ALPHA, strict=True)]
FILES = {
    "workbook.xlsx": lambda: xlsx({"Notes": [["my rig"]], "Run & more": [["title", ""], *ROWS]}),
    "columns.tdms": lambda: tdms({"log": {"t": T, "alpha": ALPHA}}),
    "waveform.tdms": lambda: tdms({"log": {"alpha": (ALPHA, {"wf_increment": 0.01, "unit_string": "rad"})}}),
    "plain.mf4": lambda: mdf([(T, {"alpha": (ALPHA, "rad")})]),
    "packed.mf4": lambda: mdf([(T, {"alpha": (ALPHA, "rad")})], compression=2),
    "old.mdf": lambda: mdf([(T, {"alpha": (ALPHA, "rad")})], "3.30"),
    "bag.mcap": lambda: mcap(T, ALPHA),
    "bag.db3": lambda: db3(T, ALPHA),
}
COLUMN = {"bag.mcap": "position.pendulum", "bag.db3": "position.pendulum"}


@pytest.fixture
def here(monkeypatch):
    """Packages read in this process, which is quicker."""
    monkeypatch.setattr(packages, "answer_apart", answer_here)


def written(folder, name, raw):
    (folder / name).write_bytes(raw)
    return folder / name


def assert_read(path):
    column = COLUMN.get(path.name, "alpha")
    recording = load_recording(path, {"alpha": {"column": column, "unit": "rad"}})
    np.testing.assert_array_equal(recording.signals["alpha"], ALPHA)
    np.testing.assert_allclose(recording.time, T, atol=1e-6)


@pytest.mark.parametrize("name", FILES)
def test_a_file_is_read_back_as_its_own_package_wrote_it(tmp_path, here, name):
    assert_read(written(tmp_path, name, FILES[name]()))


@pytest.mark.broad
@pytest.mark.parametrize("name", FILES)
def test_a_file_is_read_in_a_process_of_its_own(tmp_path, name):
    assert_read(written(tmp_path, name, FILES[name]()))


def test_a_sheet_is_chosen_and_the_others_are_said(tmp_path, here):
    other = [["t [s]", "alpha [rad]"], *zip(T, 2 * ALPHA, strict=True)]
    path = written(tmp_path, "two.xlsx", xlsx({"one": ROWS, "two": other}))
    assert read_table(path).notes == ("The sheet 'one' is read, and not 'two'; to take another, type variable = NAME.",)
    np.testing.assert_array_equal(read_table(path, "two").values[:, 1], 2 * ALPHA)
    with pytest.raises(InputError, match=r"two.xlsx has no sheet 'tow'. It has: 'one', 'two'."):
        read_table(path, "tow")


@pytest.mark.parametrize(
    ("declared", "says"),
    [
        ('<!DOCTYPE x [<!ENTITY e ".5">]>', "ent.xlsx declares XML entities, as no workbook does"),
        ('<!DOCTYPE x [<!ENTITY e SYSTEM "file:///etc/passwd">]>', "ent.xlsx declares XML entities"),
        ("", "ent.xlsx is damaged or is no Excel workbook .undefined entity"),
    ],
)
def test_an_entity_in_a_cell_is_refused_and_its_number_is_not_cut_short(tmp_path, here, declared, says):
    changed = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(xlsx({"Data": ROWS}))) as good, zipfile.ZipFile(changed, "w") as bad:
        for name in good.namelist():
            text = good.read(name).decode()
            if "worksheets" in name:
                text = text.replace("?>", "?>" + declared, 1).replace("<v>0.0</v>", "<v>1&e;5</v>", 1)
            bad.writestr(name, text)
    with pytest.raises(DataError, match=says):
        read_table(written(tmp_path, "ent.xlsx", changed.getvalue()))


def test_text_among_the_numbers_of_a_sheet_is_found_in_its_line(tmp_path, here):
    rows = [*ROWS[:9], [0.08, "stuck"], *ROWS[10:]]
    with pytest.raises(DataError, match=r"a.xlsx, line 10, column 1 \(alpha \[rad\]\): 'stuck' is not a number"):
        read_table(written(tmp_path, "a.xlsx", xlsx({"Data": rows})))


@pytest.mark.parametrize(
    ("name", "raw"),
    [
        ("bag.mcap", lambda: mcap(T, ALPHA, COMMANDS)), ("bag.db3", lambda: db3(T, ALPHA, COMMANDS, definitions=True)),
        ("log.mf4", lambda: mdf([(T, {"alpha": (ALPHA, "rad")}), (U[0], {"u": (U[1], "V")})])),
    ],
)  # fmt: skip
def test_a_command_with_a_clock_of_its_own_comes_onto_that_of_the_longest_and_is_held(tmp_path, here, name, raw):
    recording = inspect_recording(written(tmp_path, name, raw()), guess_units=True)
    assert recording.report.level == "good"
    command = next(x for n, x in recording.signals.items() if n in ("command.data", "u [V]"))
    np.testing.assert_array_equal(command, np.where(T < 0.5, 0.0, np.where(T < 1.0, 1.0, -2.0)))
    assert any("holds" in line or "hold the last value" in line for line in recording.report.reading)


def test_a_topic_whose_messages_nobody_defines_is_left_out_and_said(tmp_path, here):
    recording = inspect_recording(written(tmp_path, "bag.db3", db3(T, ALPHA, COMMANDS)))
    assert (
        "Left out: /command is a topic of messages that are not read, my_msgs/msg/Command." in recording.report.reading
    )


def test_the_name_of_a_message_is_shown_without_what_cannot_be_seen():
    assert packages._unread("a\x1b[2Jb") == r"is a topic of messages that are not read, a\x1b[2Jb"


@pytest.mark.parametrize("version", ["4.10", "3.30"])
def test_a_formula_that_a_file_brings_is_not_run(tmp_path, monkeypatch, here, version):
    monkeypatch.chdir(tmp_path)
    formula = "__import__('os').mkdir('ran')"
    path = written(
        tmp_path, "log.mf4", mdf([(T, {"u": (ALPHA, "V"), "alpha": (ALPHA, {"formula": formula})})], version)
    )
    table = read_table(path)
    assert table.names == ("time [s]", "u [V]")
    assert table.left_out == {
        "alpha": "is converted by a formula of the file, which is not evaluated; save it converted"
    }
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize("ending", packages.FORMATS)
def test_without_its_package_a_format_names_the_install_line(tmp_path, monkeypatch, ending):
    monkeypatch.setattr(packages, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=rf"pip install 'fracid\[{packages.FORMATS[ending].extra}\]'"):
        read_table(written(tmp_path, f"run{ending}", b"none"))


@pytest.mark.parametrize("ending", packages.FORMATS)
def test_every_format_has_its_row_and_a_damaged_file_is_told_so(tmp_path, here, ending):
    assert ending in READERS
    with pytest.raises(
        DataError, match=rf"run{ending} is damaged or is no {packages.FORMATS[ending].title} \(.+\). Save"
    ):
        read_table(written(tmp_path, f"run{ending}", b"PK\3\4 this is none of them" * 40))


ENDLESS = "WITH RECURSIVE r(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM r) SELECT x AS id, 1 AS name, 2 AS type FROM r"


@pytest.mark.broad
@pytest.mark.parametrize(
    ("view", "told"),
    [
        (f"topics AS {ENDLESS}", "more than 1 s of processor time"),
        ("topics AS SELECT zeroblob(999999999) AS id, 'a' AS name, 'b' AS type", "more"),
    ],
)
def test_a_bag_whose_tables_are_queries_without_end_is_told_so(tmp_path, monkeypatch, view, told):
    monkeypatch.setattr(apart, "SECONDS", 1)
    path = tmp_path / "bag.db3"
    with closing(sqlite3.connect(path)) as file:
        file.execute(f"CREATE VIEW {view}")
    with pytest.raises(DataError, match=rf"bag.db3 is damaged or is no bag of ROS 2 \(reading it takes {told}"):
        read_table(path)
