"""``fracid noise RUN|PROJECT``: identify the fitted model's own recordings again: what are its intervals worth?"""

from __future__ import annotations

from pathlib import Path

from fracid.cli.app import SAYS, How, command, numbers, typed
from fracid.errors import InputError


@command
def noise(source: Path, how: How) -> None:
    """Refit simulated noisy data many times: bias, spread, coverage.

    Takes the fitted values as the true ones.  Each repetition simulates every recording with them (with a quarter of
    the fit's step), adds noise, quantises as the encoder does, and repeats the fit from the project's start.  Shows
    bias, spread and the coverage of the 95 % intervals for each free parameter.  Writes noise.json, noise.csv and a
    figure.  After an interruption the same command resumes.  Exit code 0 when done, 3 if no run of the model reaches
    the end of the recording.
    """
    sizes = None if how.levels is None else numbers("--levels", how.levels, "0.05,0.1,0.2", least=0.0)
    turns = None if how.counts is None else numbers("--counts", how.counts, "4096,20000", least=0.0)
    if few := [c for c in turns or () if 0 < c < 3]:
        raise InputError(SAYS("few-counts", counts=few[0]))
    from fracid.workflows.monte_carlo import run_noise_study

    finished = how.done(run_noise_study, source, levels=sizes, resolutions=turns, angles=True)
    verb, what = ("profile", "profile likelihood") if source.is_dir() else ("fit", "the fit")
    after = typed(verb, source, trust=how.trust), f"{what} of the measured data"
    how.tell(finished, after, table=finished.table)
