"""Recordings of real rigs, which are others' and no part of the project: in the folder that FRACID_RECORDINGS names,
else in ../shared/recordings beside the repository."""

import os
import re
from pathlib import Path

import pytest

FOLDER = Path(os.environ.get("FRACID_RECORDINGS", Path(__file__).parents[3] / "shared" / "recordings"))


def needs(rig="srv02-rotpen"):
    """Skip where the recordings of a rig are not there."""
    place = FOLDER / rig
    return pytest.mark.skipif(
        not place.is_dir(), reason=f"there is no {place} of real recordings; say where with FRACID_RECORDINGS=FOLDER"
    )


def from_there(text):
    """A project with its recordings taken from the folder."""
    return re.sub(r'^(file *= )"(.+)"', lambda m: f'{m[1]}"{next(FOLDER.rglob(m[2])).as_posix()}"', text, flags=re.M)
