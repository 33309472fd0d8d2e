"""Write a recording as CSV, MATLAB, NumPy or JSON file that :func:`fracid.load_recording` reads."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from fracid.errors import InputError, writing
from fracid.recording.recording import Recording
from fracid.safety.door import write_files


def save_recording(recording: Recording, path: str | Path, *, note: str = "") -> Path:
    """Write a recording: time, then its signals in SI units, angles in radians.

    Parameters
    ----------
    recording : Recording
    path : str or Path
        Its ending says the format: ``.csv``, ``.mat`` or ``.npz``.  The folder is made if it is not there.
    note : str
        A comment that goes with the numbers: where they come from.

    Returns
    -------
    Path
        As given.

    Raises
    ------
    InputError
        For another ending, or a file that cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from fracid import load_recording
    >>> twin = Recording.of("twin", np.arange(4.0), {"alpha": np.array([0.3, 0.1, -0.1, 0.0])})
    >>> path = save_recording(twin, Path(tempfile.mkdtemp()) / "twin.csv", note="four samples")
    >>> path.read_text().splitlines()[:3]
    ['# four samples', 'time [s],alpha [rad]', '0,0.3']
    >>> bool((load_recording(path, {"alpha": "alpha"}).signals["alpha"] == twin.signals["alpha"]).all())
    True
    """
    path = Path(path)
    if path.suffix.lower() not in WRITERS:
        raise InputError(f"{path} cannot be written: its ending is {path.suffix!r}; expected {', '.join(WRITERS)}.")
    file = io.BytesIO()
    WRITERS[path.suffix.lower()](file, recording, note)
    write_files(path.parent, {path.name: file.getvalue()}, writing(str(path), "Give another file."))
    return path


def _csv(file: BinaryIO, recording: Recording, note: str) -> None:
    head = ["time [s]", *(f"{n} [{recording.units[n]}]" for n in recording.signals)]
    columns = np.column_stack([recording.time, *recording.signals.values()])
    lines = [*(f"# {line}" for line in note.splitlines()), ",".join(head)]
    lines += [",".join(repr(v).removesuffix(".0") for v in row) for row in columns.tolist()]
    file.write(("\n".join(lines) + "\n").encode())


def _arrays(recording: Recording, note: str) -> dict[str, Any]:
    return {"time": recording.time, **recording.signals, **({"note": note} if note else {})}


def _mat(file: BinaryIO, recording: Recording, note: str) -> None:
    from scipy.io import savemat

    savemat(file, _arrays(recording, note), oned_as="column", do_compression=True)


def _npz(file: BinaryIO, recording: Recording, note: str) -> None:
    np.savez_compressed(file, **_arrays(recording, note))


WRITERS: Mapping[str, Callable[[BinaryIO, Recording, str], None]] = {".csv": _csv, ".mat": _mat, ".npz": _npz}
"""Ending → what writes the bytes of such a file."""
