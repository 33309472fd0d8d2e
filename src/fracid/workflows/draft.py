"""A commented project file for a recording, written and proved to load: ``fracid init``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fracid.errors import unwritable
from fracid.files import write_text
from fracid.problem.draft import Draft, draft_project
from fracid.problem.project import load_project

__all__ = ["write_draft"]


def write_draft(file: Path, target: Path, columns: Mapping[str, Mapping[str, Any]] | None, **options: Any) -> Draft:
    """Write a project file for a recording.

    Parameters
    ----------
    file, target : Path
        The recording, and the project file.
    columns : mapping or None
        Signal → its column; None for a guess.
    options
        Of :func:`fracid.draft_project`: ``time``, ``variable``, ``rig``.

    Raises
    ------
    InputError
        As of :func:`fracid.draft_project`, if the file cannot be written, or if something stands against its fit.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> _ = (folder / "swing.csv").write_text("".join(f"{0.01 * k},{0.3 - 1e-3 * k}\\n" for k in range(99)))
    >>> "[[recording]]" in write_draft(folder / "swing.csv", folder / "rig.toml", {"alpha": {"column": 1}}).text
    True
    """
    draft = draft_project(file, columns, folder=target.parent, **options)
    try:
        write_text(target, draft.text)
    except OSError as error:
        raise unwritable(str(target), error, "Give another: --out FILE.") from None
    load_project(target)  # it runs as it is, or says what stands against it
    return draft
