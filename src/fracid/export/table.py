"""CSV, one file a recording, and JSON: for spreadsheets and for every other program.

A CSV file has a heading with units, numbers with a point, commas between, lines that end as RFC 4180 says.  The JSON
file is the run's ``result.json`` with the recordings' curves in it.
"""

from __future__ import annotations

import csv
import json
from io import StringIO
from typing import Any

import numpy as np

from fracid.estimation.records import RecordingFit
from fracid.models import Model
from fracid.problem import Experiment
from fracid.runs.saved import SavedRun
from fracid.safety.json_files import json_number, plain
from fracid.safety.text import csv_cell, file_stems


def csv_tables(run: SavedRun) -> dict[str, str]:
    """Each recording as a table: time, then measured, fitted and residual of each output, then the inputs.

    Parameters
    ----------
    run : SavedRun

    Returns
    -------
    dict
        File name → content.  Where the simulation has no value a field is empty.

    Examples
    --------
    >>> csv_tables.__name__
    'csv_tables'
    """
    experiments = {name: e for problem in run.problems for name, (e, _) in problem.recordings.items()}
    return {f"{stem}.csv": _csv(run.recordings[name], experiments[name], run.problem.model)
            for name, stem in file_stems(run.recordings).items()}  # fmt: skip


def _csv(recording: RecordingFit, e: Experiment, model: Model) -> str:
    columns, curves = {"time [s]": recording.time}, curves_of(recording)
    for output in recording.measured:
        unit = recording.unit(output)
        columns |= {f"{output} {kind} [{unit}]": curves[kind][output] for kind in ("measured", "fitted", "residual")}
    if len(e.inputs) > 1:
        columns |= {f"{n} [{model.input_units.get(n, 'SI')}]": u for n, u in zip(model.inputs, e.inputs.T, strict=True)}
    text = StringIO()
    writer = csv.writer(text)
    writer.writerow(map(csv_cell, columns))  # of a model of one's own a name may be anything
    writer.writerows([json_number(v) for v in row] for row in np.column_stack(list(columns.values())).tolist())
    return text.getvalue()


def json_text(run: SavedRun) -> str:
    """The result with its curves, angles in radians.

    Parameters
    ----------
    run : SavedRun

    Returns
    -------
    str
        JSON, without NaN: where the simulation has no value stands null.

    Examples
    --------
    >>> json_text.__name__
    'json_text'
    """
    curves = plain({name: curves_of(r) for name, r in run.recordings.items()})
    return json.dumps({**run.result, "curves": curves}, ensure_ascii=False, allow_nan=False) + "\n"


def curves_of(recording: RecordingFit) -> dict[str, Any]:
    """A recording's use, its times, and of each output what was measured, what was fitted and the residual.

    Examples
    --------
    >>> curves_of.__name__
    'curves_of'
    """
    residual = {n: recording.residual(n) for n in recording.measured}
    measured = {n: np.where(np.isin(recording.time, recording.of(n).time), y, np.nan)
                for n, y in recording.measured.items()}  # fmt: skip
    return {"use": recording.use, "time": recording.time, "measured": measured, "fitted": recording.fitted,
            "residual": residual}  # fmt: skip
