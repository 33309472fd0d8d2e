"""A run or a study done again into another folder, and held against the first: ``fracid reproduce``.

A fit is done again from its ``run.json``, by :func:`fracid.reproduce`.  Of a study the words of its command are done
again by whom the caller names, for only a command line reads them.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from fracid.errors import InputError
from fracid.runs.folder import JOURNAL, SAYS, open_folder, refuse_used
from fracid.runs.reproduction import Reproduction, compared, not_as_before, reproduce
from fracid.safety.door import write_files
from fracid.safety.json_files import json_document
from fracid.safety.paths import STUDIES, kind_of, refuse_mistaken
from fracid.safety.schema import Block, read_as
from fracid.tasks.display import unless_given
from fracid.tasks.folder_lock import refuse_links
from fracid.tasks.progress import Observer
from fracid.workflows.records import command_of, words_of
from fracid.workflows.resumption import ADDRESS, command_of_study, safe_words
from fracid.workflows.study import header_of

Typed = Callable[[list[str], Path], None]
"""Does what the words of a command say, in the folder where they were typed."""


def reproduce_run(
    run: Path,
    *,
    typed: Typed,
    trust: bool = False,
    out: Path | None = None,
    jobs: int = 1,
    observer: Observer | None = None,
) -> Reproduction:
    """Do a run or a study again, and compare the results value by value.

    Parameters
    ----------
    run : Path
        The folder, in which nothing is written.
    typed : function (words, folder) -> None
        Does a study's command again.
    trust, jobs, observer
        As of :func:`fracid.run`.
    out : Path, optional
        A folder for the new result; none is kept if left out.

    Raises
    ------
    InputError
        If the run cannot be done again, or `out` is not empty.
    NotTrusted
        If the project names code of its own, and `trust` is not given.

    Examples
    --------
    >>> reproduce_run(Path("nowhere/rig"), typed=lambda words, where: None)
    Traceback (most recent call last):
    fracid.errors.InputError: There is no nowhere/rig. ...
    """
    if not run.is_dir():
        refuse_mistaken(run, "run")
    if kind_of(run) is None:
        raise InputError(SAYS("not-again", run=run))
    refuse_links(run)
    if out is not None:
        refuse_used(out)  # before the time is spent
    study = next((name for name in STUDIES if (run / name).exists()), None)
    if study is not None and not (run / "result.json").exists():
        return _study_again(run, study, typed, trust, out=out, jobs=jobs)
    rerun = reproduce(run, trust=trust, jobs=jobs, observer=unless_given(observer))
    if out is not None:
        words = command_of("reproduce", run, {"out": out})
        write_files(open_folder(out, words), {"result.json": json_document(rerun.result)})
    return rerun


def _study_again(run: Path, name: str, typed: Typed, trust: bool, out: Path | None, jobs: int) -> Reproduction:
    """Type a study's command again, into another folder."""
    words, where = command_of_study(run)
    elsewhere = any(ADDRESS in word for word in words)  # on processes here in its place, which changes no result
    again = [*safe_words(run, words, "processes", trust), *(["--executor", "processes"] * elsewhere)]
    with TemporaryDirectory() as place:
        folder = Path(place) / "run" if out is None else out.resolve()
        typed([*again, *words_of({"out": folder, "jobs": jobs, "trust": trust})], where)
        headers = (_header(place / JOURNAL) for place in (run, folder))
        machines = (_read(place / "environment.json") for place in (run, folder))
        return compared(_read(run / name), _read(folder / name), not_as_before(run, *headers, *machines))


def _header(journal: Path) -> dict[str, Any]:
    if not (header := header_of(journal)):
        raise InputError(f"{journal.parent} has no journal that can be read: it cannot be done again.")
    return header


def _read(path: Path) -> dict[str, Any]:
    return dict(read_as(path, Block, "the command itself", "{path} cannot be read: there is nothing to compare."))
