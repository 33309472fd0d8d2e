"""One door: only safety/ opens files, and nothing goes through that has no end, or that leads elsewhere."""

import ast
import os
import socket
import sys
from collections import defaultdict
from pathlib import Path

import pytest

from fracid.safety import door
from program import run
from sources import PACKAGE, nodes

OPENING = {
    "open", "fdopen", "open_memmap", "open_code", "read_text", "read_bytes", "write_text", "write_bytes", "touch",
    "FileIO", "FileHandler", "DataSource", "os.link", "symlink", "link_to", "hardlink_to", "symlink_to", "mkfifo",
    "mknod", "copyfile", "copyfileobj", "copytree", "copy2", "shutil.copy", "shutil.move", "make_archive",
    "unpack_archive", "exec_module", "load_module", "run_path", "run_module", "np.load", "np.save", "savetxt",
    "loadtxt", "genfromtxt", "fromfile", "tofile", "fromregex", "loadmat", "savemat", "savez", "savez_compressed",
    "savefig", "read_csv", "read_excel", "read_pickle", "h5py.File", "ParquetFile", "ZipFile", "TarFile", "memory_map",
    "NamedTemporaryFile", "TemporaryFile", "SpooledTemporaryFile", "mkstemp", "getlines", "sqlite3.connect",
    "builtins", "mmap", "memmap", "gzip", "bz2", "lzma", "tarfile", "fileinput", "linecache", "shelve", "dbm",
}  # fmt: skip
"""Functions, methods and modules that open a file, make one, lead to another, or run what they are given."""

BUILTIN = {"open", "exec", "eval", "compile", "__import__", "__builtins__"}
"""The same of what is there without an import; any other name has an import, which is looked at."""

LASTS = {name.split(".")[-1] for name in OPENING} | BUILTIN
"""Looked at first: to write every attribute out takes seconds."""

ALLOWED = {
    "cli/app.py": {"webbrowser.open": "an address, for the browser"},
    "export/fmu.py": {"zipfile.ZipFile": "into memory"},
    "models/written/reading.py": {"reach.builtins": "the names that a function refers to"},
    "models/written/languages.py": {"exec": "the text of a tree that a whitelist read: its own names and mathematics",
                                    "compile": "that text, under the name of the module that has it"},
    "export/matlab.py": {"scipy.io.savemat": "into memory"},
    "plots/notebook.py": {"self.savefig": "into memory"},
    "plots/writing.py": {"figure.savefig": "into memory"},
    "recording/readers/hdf5.py": {"h5py.File": "libhdf5 opens it itself; read_table has looked that it is plain"},
    "recording/readers/numpy_files.py": {
        "zipfile.ZipFile": "what the door has opened", "archive.open": "a member of what the door has opened",
    },
    "recording/readers/packages.py": {
        "TdmsFile.open": "what the door has opened", "sqlite3.connect": "to read, in a process of its own",
        "mdf_v3.NamedTemporaryFile": "set to memory", "mdf_v4.NamedTemporaryFile": "set to memory",
        "zipfile.ZipFile": "what the door has opened", "archive.open": "a member of what the door has opened",
    },
    "recording/readers/parquet.py": {"parquet.ParquetFile": "Arrow opens it itself; read_table has looked"},
    "recording/readers/text.py": {"np.loadtxt": "a list of lines"},
    "recording/writing.py": {"scipy.io.savemat": "into memory", "np.savez_compressed": "into memory"},
    "tasks/ending.py": {"io.FileIO": "standard output, by its number"},
    "workflows/posterior_draws.py": {"np.savez_compressed": "into memory"},
}  # fmt: skip
"""File → what it names → why it may stay."""


def opens(node):
    """What a node names that opens a file, whether it calls it, hands it on or gives it another name."""
    match node:
        case ast.Name(id=name) if name in BUILTIN:
            return {name}
        case ast.Attribute(attr=last) if last in LASTS and ({last, ast.unparse(node)} & OPENING or last in BUILTIN):
            return {ast.unparse(node)} - {"re.compile", "dispatcher.compile"}  # of a pattern; Numba's, of a function
        case ast.Import(names=names) | ast.ImportFrom(names=names) if "fracid" not in ast.unparse(node):
            whole = {f"{getattr(node, 'module', '')}.{alias.name}".lstrip(".") for alias in names}
            return {name for name in whole if {name, name.split(".")[-1], name.replace("numpy.", "np.")} & OPENING}
        case ast.Call(func=ast.Name(id="getattr"), args=[_, ast.Constant(value=name), *_]) if name in OPENING | BUILTIN:
            return {name}
    return set()


def test_no_module_opens_a_file_but_by_the_door():
    found = defaultdict(set)
    for file, of_file in nodes().items():
        for name in set().union(*map(opens, of_file)) if not file.startswith("safety/") else ():
            found[file].add(name)
    assert {file: set(reasons) for file, reasons in ALLOWED.items()} == found


@pytest.mark.parametrize(
    "line", ["open('x')", "p.open('rb')", "p.read_text()", "p.read_bytes()", "io.open('x')", "os.open('x', 0)",
             "os.fdopen(3)", "os.link(a, b)", "from os import link as same", "p.hardlink_to(a)", "exec(text)",
             "compile(t, '', 'exec')", "shutil.copy(a, b)", "from shutil import copy", "from numpy import load as take",
             "np.load('x')", "np.loadtxt('x')", "np.savetxt('x', a)", "map(open, names)", "o = open", "import gzip",
             "import builtins as b", "getattr(p, 'open')()", "getattr(__builtins__, name)", "__import__('os')",
             "sqlite3.connect('x')", "logging.FileHandler('x')", "import os, mmap", "from builtins import open as o"],
)  # fmt: skip
def test_what_opens_a_file_is_found_however_it_is_written(line):
    assert set().union(*map(opens, ast.walk(ast.parse(line))))


@pytest.mark.parametrize(
    "line", ["write_text(p, t)", "re.compile('a')", "from fracid.safety.door import write_whole", "import os",
             "json.load(file)", "copy(a)", "link = 3", "getattr(a, name)"],
)  # fmt: skip
def test_what_opens_none_is_left_alone(line):
    assert not set().union(*map(opens, ast.walk(ast.parse(line))))


COMMANDS = {"check": ("swing.csv",), "fit": ("rig.toml",), "export": ("run",), "design": ("run",)}
HEARD = []
"""Package of fracid and what it opened where one stands, while a test listens: a hook stays until the process ends."""


def hear(event, words):
    if HEARD and event in {"open", "os.link", "os.symlink", "os.truncate", "shutil.copyfile", "sqlite3.connect"}:
        frame = sys._getframe()
        while frame and not frame.f_code.co_filename.startswith(str(PACKAGE)):
            frame = frame.f_back
        if frame and isinstance(words[0], str | Path) and Path(os.path.abspath(words[0])).is_relative_to(Path.cwd()):
            HEARD.append((Path(frame.f_code.co_filename).relative_to(PACKAGE).parts[0], words[0]))


@pytest.mark.broad
@pytest.mark.parametrize("command", COMMANDS)
def test_all_that_a_command_opens_is_opened_by_the_door(command, sent, capsys):
    sys.addaudithook(hear)
    HEARD.append(("safety", "nothing yet"))
    try:
        assert run(capsys, command, *COMMANDS[command])[0] == 0
        assert len(HEARD) > 1
        assert [(who, path) for who, path in HEARD if who != "safety"] == []
    finally:
        HEARD.clear()


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
@pytest.mark.parametrize("way", [door.bytes_of, door.text_of, door.opened, door.appended])
def test_what_is_no_plain_file_is_not_opened_and_not_waited_for(tmp_path, monkeypatch, kind, way):
    monkeypatch.chdir(tmp_path)  # a socket's name is short
    UNPLAIN[kind]("it")
    with pytest.raises(OSError, match=REFUSED):
        way(Path("it"))


@pytest.mark.parametrize("way", [door.appended])
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
    door.write_whole(tmp_path / "note", "new")
    assert ((tmp_path / "thesis").read_text(), (tmp_path / "note").read_text()) == ("mine", "new")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["note", "thesis"]


def test_a_name_of_any_bytes_is_written_out_in_a_text(tmp_path):
    door.write_whole(tmp_path / "note", f"of {os.fsdecode(bytes([255]))} and λ")
    assert (tmp_path / "note").read_text() == "of \\udcff and λ"


def test_no_more_is_read_than_a_file_of_its_kind_has(tmp_path):
    with (tmp_path / "huge").open("wb") as file:
        file.truncate(1 << 40)
    with pytest.raises(ValueError, match="has more than 67108864 bytes"):
        door.text_of(tmp_path / "huge")
    assert door.bytes_of(Path(__file__), os.path.getsize(__file__)) == Path(__file__).read_bytes()
