"""A recording at a glance, as a file: ``fracid check --out``."""

from __future__ import annotations

from pathlib import Path

from fracid.recording import Recording
from fracid.tasks.progress import Observer


def write_overview(recording: Recording, folder: Path, observer: Observer) -> Path:
    """Draw a recording with its report into a folder; gives the file.

    Raises
    ------
    InputError
        If the folder cannot be written.
    """
    observer.stage("figure")
    from fracid.plots import recording_overview, save  # takes a second to import

    return save(recording_overview(recording), folder, recording.name, formats=("png",))[0]
