"""``fracid profile RUN|PROJECT``: the profile likelihood of each unknown, and its interval."""

from __future__ import annotations

from pathlib import Path

from fracid.cli.app import How, command, typed
from fracid.errors import InputError


@command
def profile(source: Path, how: How) -> None:
    """Profile likelihood: intervals from refits along each parameter.

    Fixes one parameter on a grid and refits the others.  Shows the 95 % interval of the profile beside those of the
    sandwich and of the bootstrap, and a verdict on each free parameter.  Writes profiles.json and a figure.  Exit
    code 0 when done, 3 if no run of the model reaches the end of the recording.
    """
    from fracid.workflows.profiles import run_profiles

    finished = how.done(run_profiles, source, joint=_pair(how.joint))
    if source.is_dir():
        what = "the page, with the profiles" if finished.folder == source else "the page of the run"
        after = typed("report", source, "--open", trust=how.trust), what
    else:
        after = typed("fit", source, trust=how.trust), "the whole result, with a page"
    how.tell(finished, after)


def _pair(joint: str | None) -> tuple[str, str] | None:
    if joint is None:
        return None
    names = [name.strip() for name in joint.split(",")]
    if len(names) != 2:
        raise InputError(f"--joint {joint!r} is not possible; expected two names, e.g. --joint mu,b_alpha.")
    return names[0], names[1]
