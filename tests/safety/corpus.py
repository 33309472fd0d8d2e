"""Good recordings in every format that fracid reads: what is spoilt for the catalogue of bad input, and for fuzzing."""

import io
import json
import sys
import zipfile
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import h5py
import numpy as np
import pyarrow
from pyarrow import parquet as parquet_files
from scipy.io import savemat
from scipy.sparse import csc_array

sys.path.insert(0, str(Path(__file__).parents[1] / "helpers"))
from logs import db3, mcap, mdf, tdms, xlsx

__all__ = ["SEEDS", "archive", "hdf5", "json_log", "mat", "mat73", "npy", "npz", "parquet", "swing", "swings", "text"]

MAT = b"MATLAB 5.0 MAT-file of a test".ljust(116)
"""How SciPy's files begin, but for the date."""


def swing(samples: int) -> dict[str, np.ndarray]:
    """A pendulum and its arm at 100 Hz."""
    t = np.arange(samples) / 100
    return {"t": t, "theta": 0.1 * np.sin(3 * t), "alpha": 0.8 * np.cos(5 * t)}


def swings() -> bytes:
    """A pendulum that swings out, its arm, and a voltage, at 50 Hz."""
    t = np.arange(120) / 50
    columns = t, 0.1 * np.sin(5 * t), 0.8 * np.exp(-0.1 * t) * np.cos(5 * t), np.sign(np.sin(t))
    return text("t,theta,alpha,u", columns)


# --- one format each --------------------------------------------------------------------------------------


def text(head: str, columns: Iterable[np.ndarray], separator: str = ",", decimal: str = ".", encoding: str = "utf-8",
         change: Callable[[list[str]], object] = lambda _: None, end: str = "\n") -> bytes:  # fmt: skip
    """Lines of cells, which may be changed in place; the first is the header."""
    rows = [[f"{x:.6f}".replace(".", decimal) for x in row] for row in zip(*columns, strict=True)]
    lines = [head.replace(",", separator), *map(separator.join, rows)]
    change(lines)
    return ("\n".join(lines) + end).encode(encoding)


def saved(save: Callable[..., object], *content: object, **options: object) -> bytes:
    """What is written to a file."""
    file = io.BytesIO()
    save(file, *content, **options)
    return file.getvalue()


def npy(array: object, **options: object) -> bytes:
    """An array of NumPy's."""
    return saved(np.save, array, **options)


def npz(content: Mapping[str, object], save: Callable[..., object] = np.savez) -> bytes:
    """An archive of arrays."""
    return saved(save, **content)


def archive(members: Iterable[tuple[str, bytes]], packing: int = zipfile.ZIP_STORED) -> bytes:
    """A zip file, without dates."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", packing) as packed:
        for name, content in members:
            packed.writestr(zipfile.ZipInfo(name), content, packing)
    return file.getvalue()


def mat(content: Mapping[str, object], **options: object) -> bytes:
    """A file of MATLAB's, of version 5 or 4."""
    raw = saved(savemat, content, **options)
    return MAT + raw[116:] if raw.startswith(b"MATLAB") else raw


def hdf5(fill: Callable[[h5py.File], object], **options: object) -> bytes:
    """A file of HDF5."""
    file = io.BytesIO()
    with h5py.File(file, "w", **options) as h:
        fill(h)
    return file.getvalue()


def mat73(fill: Callable[[h5py.File], object]) -> bytes:
    """A file of MATLAB's, of version 7.3."""
    return b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + hdf5(fill, userblock_size=512)[128:]


def vectors(h: h5py.File) -> None:
    """A swing, each signal a dataset."""
    h["t"], h["alpha"] = T, ALPHA


def parquet(table: object, **options: object) -> bytes:
    """A table of Parquet: columns by name, or one of Arrow's."""
    table = table if isinstance(table, pyarrow.Table) else pyarrow.table(table)
    return saved(lambda file: parquet_files.write_table(table, file, **options))


def json_log(columns: Mapping[str, object]) -> bytes:
    """Columns in JSON; single values stand beside them."""
    return json.dumps({n: x.tolist() if isinstance(x, np.ndarray) else x for n, x in columns.items()}).encode()


# --- seeds of every reader, which fuzzing bends -------------------------------------------------------------

GOOD = swing(40)
T, ALPHA = GOOD["t"], GOOD["alpha"]
THETA = np.round(300 * np.sin(3 * T))
COUNTED = GOOD | {"theta": THETA}
MATRIX = np.column_stack([*COUNTED.values()])


def _texts() -> list[bytes]:
    columns = [x[:16] for x in COUNTED.values()]
    comma = text("t,theta,alpha", columns)
    return [
        comma,
        text("t [s],theta [counts],alpha [rad]", columns, ";", ","),
        text("# a rig\n% of mine\nt,theta,alpha\ns,deg,rad", columns, "\t"),
        text("", columns, " "),
        comma.decode().encode("utf-16"),
        comma.replace(b"theta", b"\xb0theta"),
        b"\xef\xbb\xbf" + comma.replace(b"\n", b"\r\n"),
        b"time,a,u\n0,1,\n0.1,2,3\n0.2,,nan\n0.3,5,null\n",
    ]


def _mats() -> list[bytes]:
    counted = COUNTED | {"theta": THETA.astype(np.int16)}
    struct = {"log": {"time": T, "signals": {"values": ALPHA, "label": "alpha"}}}
    cell = np.array([1, "a", T], dtype=object)
    awkward = {"t": T, "s": csc_array(np.eye(4)), "z": ALPHA * 1j, "c": cell, "n": "name"}
    kinds = [counted, {"data": MATRIX}, struct, awkward]
    return [*map(mat, kinds), *(mat(kind, format="4") for kind in kinds[:2])]


def _arrays() -> list[np.ndarray]:
    fields = np.zeros(40, dtype=[("t", float), ("alpha", ">f4"), ("n", "<i2")])
    fields["t"], fields["alpha"] = T, ALPHA
    return [MATRIX, np.asfortranarray(np.vstack([T, ALPHA])), fields, THETA.astype(">i4")]


def _npzs() -> list[bytes]:
    kinds = [COUNTED, {"data": MATRIX}, {f"u{k}": array for k, array in enumerate(_arrays())}]
    return [npz(kind, save) for kind in kinds for save in (np.savez, np.savez_compressed)]


def _hdf5s() -> list[bytes]:
    def named(h: h5py.File) -> None:
        vectors(h)
        h["alpha"].attrs["unit"] = "rad"

    def packed(h: h5py.File) -> None:
        group = h.create_group("run/one")
        for name, x in (("t", T), ("alpha", ALPHA)):
            group.create_dataset(name, data=x, chunks=(16,), maxshape=(None,), compression="gzip", shuffle=True)

    def awkward(h: h5py.File) -> None:
        named(h)
        h["record"] = np.zeros(40, dtype=[("a", "<f8"), ("b", ">i2")])
        h["names"] = np.array([b"a", b"bc"])
        h["soft"], h["far"] = h5py.SoftLink("/t"), h5py.ExternalLink("no.h5", "/t")
        h["text"] = "variable length"
        h["matrix"] = np.zeros((3, 40))

    versions = ("earliest", "latest")
    return [*(hdf5(fill, libver=version) for fill in (named, packed, awkward) for version in versions), mat73(named)]


def _parquets() -> list[bytes]:
    plain = COUNTED | {"theta": THETA.astype(np.int64)}
    awkward = {"t": T, "who": ["me"] * 40, "gap": [None, 1.5] * 20, "when": (1e9 * T).astype("M8[ns]")}
    options: list[dict[str, object]] = [
        {"compression": "none", "use_dictionary": False}, {"compression": "none"},
        {"compression": "snappy", "data_page_version": "2.0"}, {"compression": "zstd"},
    ]  # fmt: skip
    return [parquet(table, **o) for table in (plain, awkward) for o in options]


def _jsons() -> list[bytes]:
    columns = {"timestamp": T.tolist(), "theta": THETA.tolist(), "alpha": ALPHA.tolist()}
    records = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    stamped = [{"stamp": {"sec": k, "nanosec": 7}, "q": [a, 0, None], "on": k > 9} for k, a in enumerate(ALPHA)]
    dated = [{"time": f"2024-01-01T12:00:{k}Z", "alpha": a} for k, a in enumerate(ALPHA)]
    kinds = [columns, records, {"mass": 0.49, "motor": "xl330", "entries": records}, stamped, dated]
    return [*(json.dumps(kind).encode() for kind in kinds), "\n".join(map(json.dumps, records)).encode()]


def _workbooks() -> list[bytes]:
    rows = [["t [s]", "theta [counts]", "alpha"], *MATRIX.tolist()]
    sheets = [{"Data": rows}, {"About": [["a rig"], ["of mine"]], "Data & more": [["title"], *rows]}]
    return [xlsx(of, packing) for of in sheets for packing in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)]


def _tdmss() -> list[bytes]:
    rate = {"wf_increment": 0.01, "wf_start_offset": 0.0, "unit_string": "V"}
    one = {"t": T, "alpha": ALPHA}
    other = {"alpha": (ALPHA, rate), "n": (THETA.astype(np.int16), rate), "who": ["me"] * 40}
    return [tdms({"log": one}), tdms({"log": other}), tdms({"a": one, "b": other})]


def _mdfs() -> list[bytes]:
    groups = [(T, {"alpha": (ALPHA, "rad"), "n": (THETA.astype(np.int16), "")}), (T[::10], {"u": (ALPHA[::10], "V")})]
    packed = [mdf(groups, compression=how) for how in (1, 2)]
    return [mdf(groups), *packed, mdf(groups, "4.20"), mdf(groups, "3.30"), mdf(groups[:1], "2.14")]


def _mcaps() -> list[bytes]:
    from mcap.writer import CompressionType

    commands = [(0.1, 1.0), (0.2, 2.0)]
    return [mcap(T, ALPHA, some, compression=kind) for some in ([], commands) for kind in CompressionType]


def _projects() -> list[bytes]:
    recording = '[[recording]]\nfile = "swing.csv"\ntime = { column = 0 }\nalpha = { column = 2, unit = "rad" }\n'
    whole = Path(__file__).with_name("whole.toml").read_text(encoding="utf-8")
    return [recording.encode(), whole.encode(), (recording + '[fit]\npreset = "paper"\n').encode()]


SEEDS: dict[str, Callable[[], list[bytes]]] = {
    "text": _texts, "mat": _mats, "npy": lambda: [*map(npy, _arrays())], "npz": _npzs, "hdf5": _hdf5s,
    "parquet": _parquets, "json": _jsons, "xlsx": _workbooks, "tdms": _tdmss, "mdf": _mdfs, "mcap": _mcaps,
    "db3": lambda: [db3(T, ALPHA, [(0.1, 1.0)], definitions=known) for known in (False, True)], "project": _projects,
}  # fmt: skip
"""Reader → good files of it."""
