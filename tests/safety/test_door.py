"""One door: only safety/ opens files, and nothing goes through that has no end, or that leads elsewhere."""

import ast
import os
import socket
from collections import defaultdict
from pathlib import Path

import pytest

from fracid.safety import door
from sources import nodes

OPENING = {
    "open", "fdopen", "read_text", "read_bytes", "write_text", "write_bytes", "FileIO", "mmap", "memmap",
    "link", "symlink", "link_to", "hardlink_to", "symlink_to", "mkfifo", "mknod", "copyfile", "copyfileobj", "copytree",
    "exec", "eval", "compile", "exec_module", "load_module", "run_path", "np.load", "shutil.copy", "shutil.move",
    "fromfile", "tofile", "genfromtxt", "loadmat", "savemat", "savez", "savez_compressed", "savefig",
    "File", "ParquetFile", "ZipFile", "read_csv", "NamedTemporaryFile", "TemporaryFile", "mkstemp",
}  # fmt: skip
"""Names of functions and methods that open a file, make one, lead to another, or run what they are given."""

ALLOWED = {
    "cli/app.py": {"webbrowser.open": "an address, for the browser"},
    "export/fmu.py": {"zipfile.ZipFile": "into memory"},
    "export/whole.py": {"(files('fracid.export') / template).read_text": "a file of this package"},
    "models/library/__init__.py": {"_FOLDER.joinpath(f'{name}.toml').read_text": "a file of this package"},
    "models/written/languages.py": {"exec": "the text of a tree that a whitelist read: its own names and mathematics"},
    "export/matlab.py": {"savemat": "into memory"},
    "plots/notebook.py": {"self.savefig": "into memory"},
    "plots/writing.py": {"figure.savefig": "into memory"},
    "recording/readers/hdf5.py": {"h5py.File": "libhdf5 opens it itself; read_table has looked that it is plain"},
    "recording/readers/numpy_files.py": {
        "zipfile.ZipFile": "what the door has opened", "archive.open": "a member of what the door has opened",
    },
    "recording/readers/packages.py": {"TdmsFile.open": "what the door has opened"},
    "recording/readers/parquet.py": {"parquet.ParquetFile": "Arrow opens it itself; read_table has looked"},
    "recording/writing.py": {"savemat": "into memory", "np.savez_compressed": "into memory"},
    "solver/compilation.py": {"dispatcher.compile": "Numba's, of a function and not of a text"},
    "workflows/posterior_draws.py": {"np.savez_compressed": "into memory"},
}  # fmt: skip
"""File → call → why it may stay."""


def opens(call, own):
    """The name of what is called, where it opens something; functions of fracid's own go through the door."""
    name = ast.unparse(call.func)
    last = name.rsplit(".", 1)[-1]
    return name if {name, last} & OPENING and name not in own and name != "re.compile" else None


def test_no_module_opens_a_file_but_by_the_door():
    found = defaultdict(set)
    for file, of_file in nodes().items():
        imports = [node for node in of_file if isinstance(node, ast.ImportFrom) and "fracid" in str(node.module)]
        own = {alias.name for node in imports for alias in node.names}
        for node in of_file:
            if isinstance(node, ast.Call) and not file.startswith("safety/") and (name := opens(node, own)):
                found[file].add(name)
    assert {file: set(reasons) for file, reasons in ALLOWED.items()} == found


@pytest.mark.parametrize(
    "line", ["open('x')", "p.read_text()", "os.link(a, b)", "os.fdopen(3)", "exec(text)", "compile(t, '', 'exec')",
             "shutil.copy(a, b)", "io.open('x')", "np.load('x')"],
)  # fmt: skip
def test_an_open_file_is_found_wherever_it_is_written(line):
    assert opens(ast.parse(line).body[0].value, {"write_text"})
    assert not opens(ast.parse("write_text(p, t)").body[0].value, {"write_text"})
    assert not opens(ast.parse("re.compile('a')").body[0].value, set())


# --- what goes through it ------------------------------------------------------------------------------


def bind(path):
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(path)


REFUSED = r"no plain file but a pipe or a device|Is a directory|symbolic links"

UNPLAIN = {
    "a pipe": os.mkfifo,
    "a folder": os.mkdir,
    "a device": lambda path: os.symlink("/dev/zero", path),
    "a socket": lambda path: bind(path),
    "a link to a pipe": lambda path: (os.mkfifo(f"{path}-pipe"), os.symlink(f"{path}-pipe", path)),
    "a link to itself": lambda path: os.symlink(path, path),
}


@pytest.mark.parametrize("kind", UNPLAIN)
@pytest.mark.parametrize("way", [door.bytes_of, door.text_of, door.opened, door.appended, door.descriptor])
def test_what_is_no_plain_file_is_not_opened_and_not_waited_for(tmp_path, monkeypatch, kind, way):
    monkeypatch.chdir(tmp_path)  # a socket's name is short
    UNPLAIN[kind]("it")
    with pytest.raises(OSError, match=REFUSED):
        way(Path("it"))


@pytest.mark.parametrize("way", [door.appended, door.descriptor])
def test_nothing_is_added_to_what_a_link_leads_to(tmp_path, way):
    (tmp_path / "thesis").write_text("mine")
    (tmp_path / "log").symlink_to(tmp_path / "thesis")
    with pytest.raises(OSError, match="symbolic links"):
        way(tmp_path / "log")


@pytest.mark.parametrize("name", ["note", ".note.1-2"])
def test_what_is_written_whole_replaces_a_link_and_leaves_what_it_leads_to(tmp_path, monkeypatch, name):
    monkeypatch.setattr("os.getpid", lambda: 1)
    monkeypatch.setattr("threading.get_ident", lambda: 2)
    (tmp_path / "thesis").write_text("mine")
    (tmp_path / name).symlink_to(tmp_path / "thesis")
    door.write_text(tmp_path / "note", "new")
    assert ((tmp_path / "thesis").read_text(), (tmp_path / "note").read_text()) == ("mine", "new")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["note", "thesis"]


def test_a_name_of_any_bytes_is_written_out_in_a_text(tmp_path):
    door.write_text(tmp_path / "note", f"of {os.fsdecode(bytes([255]))} and λ")
    assert (tmp_path / "note").read_text() == "of \\udcff and λ"


def test_no_more_is_read_than_a_file_of_its_kind_has(tmp_path):
    with (tmp_path / "huge").open("wb") as file:
        file.truncate(1 << 40)
    with pytest.raises(ValueError, match="has more than 67108864 bytes"):
        door.text_of(tmp_path / "huge")
    assert door.bytes_of(Path(__file__), os.path.getsize(__file__)) == Path(__file__).read_bytes()
