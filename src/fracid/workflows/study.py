"""What every study does alike: what it leaves in its folder, and the journal by which the same call goes on.

A study is a list of repetitions whose results are lines of a journal.  Its workflow says what is done, with which
settings, and what is wrong with a result; the rest is here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

from fracid.cards import Card, CardDisplay
from fracid.errors import InputError
from fracid.problem.project import Project, load_project
from fracid.report.index import write_study_page
from fracid.report.study import STUDIES
from fracid.runs.folder import FIGURES, JOURNAL, inputs_of, open_folder
from fracid.runs.saved import SavedRun, load_run
from fracid.safety.door import write_files
from fracid.safety.json_files import json_document
from fracid.safety.paths import default_folder, refuse_mistaken
from fracid.safety.schema import lines_of
from fracid.schemas.run_record import StudyLine
from fracid.tasks.journal import Journal
from fracid.tasks.progress import SILENT, Observer
from fracid.workflows.figures import Pictures, saved


@dataclass(frozen=True, repr=False)
class Written(CardDisplay):
    """What a command wrote into a folder."""

    FILE: ClassVar[str]

    folder: Path
    figures: tuple[Path, ...]
    """Empty where there was nothing to draw."""
    result: Mapping[str, Any]
    """The content of the JSON file."""

    @property
    def path(self) -> Path:
        """Path of the JSON file."""
        return self.folder / self.FILE

    @classmethod
    def written(
        cls, folder: Path, record: Mapping[str, Any], pictures: Pictures, observer: Observer,
        contents: Mapping[str, str | bytes] | None = None, **found: Any,
    ) -> Self:  # fmt: skip
        """Write what was found: the JSON file and `contents` beside it, the figures, the page if it has one."""
        observer.stage("figures")
        write_files(folder, {**(contents or {}), cls.FILE: json_document(record)})
        drawn = saved(pictures, folder / FIGURES)
        if cls.FILE in STUDIES:
            write_study_page(folder, cls.FILE)
        observer.stage("")
        return cls(folder, drawn, record, **found)


@dataclass(frozen=True, repr=False)
class Finished(Written):
    """What a study found, with its folder and a page."""

    FOUND: ClassVar[str]
    """The attribute with the result itself."""

    def _card(self) -> Card:
        card: Card = getattr(self, self.FOUND)._card()
        return card.of_folder(self.folder)

    @property
    def page(self) -> Path:
        """Path of the page, which opens offline."""
        return self.path.with_suffix(".html")


def run_or_project(source: Path, trust: bool, observer: Observer = SILENT) -> SavedRun | Project:
    """Load a run from its folder, or a project from its file.

    Raises
    ------
    InputError, NotTrusted
        As :func:`fracid.load_run` and :func:`fracid.load_project` do.
    """
    if source.suffix != ".toml":
        refuse_mistaken(source, "run")
    observer.stage("run" if source.is_dir() else "recordings")
    return load_run(source, trust=trust) if source.is_dir() else load_project(source, trust=trust)


def folder_of(out: str | Path | None, source: Path, study: str) -> Path:
    """The folder of a study: the one that is asked for, one in the run, or one that is called after the project.

    Examples
    --------
    >>> str(folder_of(None, Path("rig.toml"), "noise"))
    'runs/rig-noise'
    """
    if out is not None:
        return Path(out)
    return source / study if source.is_dir() else default_folder(f"{source.stem}-{study}")


def header_of(journal: Path) -> dict[str, Any]:
    """All that the results in a journal depend on; empty where it does not say that."""
    return next((dict(line["study"]) for line in lines_of(journal, StudyLine)), {})


def refuse_fit(folder: Path, command: str) -> None:
    """Refuse a folder with a fit, whose result would be lost.

    Raises
    ------
    InputError

    Examples
    --------
    >>> refuse_fit(Path("nowhere/rig"), "noise")
    """
    if (folder / "result.json").exists():
        raise InputError(f"{folder} holds a fit; give fracid {command} a folder of its own: --out DIR.")


def study_of(kind: str, project: Project, **settings: Any) -> dict[str, Any]:
    """All that the results of a study depend on beside their keys: what is done, how, and of what."""
    return {"kind": kind, **settings, **inputs_of(project)}


@contextmanager
def journal_of(
    folder: Path, study: Mapping[str, Any], fault: Callable[[str, Any], str], observer: Observer, counted: str,
    command: Sequence[str] | None = None,
) -> Iterator[dict[str, Any]]:  # fmt: skip
    """Open the journal of a study's folder; gives how the work is kept and told: ``journal`` and ``progress``.

    Parameters
    ----------
    folder : Path
        It must hold no fit.
    study : mapping
        All that a result depends on beside its key.
    fault : function (key, result) -> str
        What is wrong with a result that the journal has.
    observer : Observer
    counted : str
        What there are many of: ``repetitions``.
    command : sequence of str, optional
        With which the folder is made; it is there, if left out.
    """
    if command is not None:
        refuse_fit(folder, study["kind"])
        open_folder(folder, command)
    with Journal(folder / JOURNAL, study, fault) as journal, observer.progress(counted) as tell:
        observer.notices(journal.notes)
        yield {"journal": journal, "progress": tell}
