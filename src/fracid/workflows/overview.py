"""A recording at a glance, as a file: ``fracid check --out``."""

from __future__ import annotations

from pathlib import Path

from fracid.recording import Recording


def write_overview(recording: Recording, folder: Path) -> Path:
    """Draw a recording with its report into a folder; gives the file.

    Raises
    ------
    InputError
        If the folder cannot be written.
    """
    from fracid.plots import recording_overview, save

    return save(recording_overview(recording), folder, recording.name, formats=("png",))[0]
