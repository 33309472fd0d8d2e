"""What the search of a run has evaluated, from its folder."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fracid.arrays import FloatArray
from fracid.safety.schema import lines_of
from fracid.schemas.run_record import EvaluationLine

EVALUATIONS = "evaluations.jsonl"


def tried(folder: Path, names: tuple[str, str]) -> FloatArray:
    """Two unknowns at all evaluations in the log of a folder, shape (n, 2); a line that is torn is left out."""
    points = (line["point"] for line in lines_of(folder / EVALUATIONS, EvaluationLine))
    whole = (point for point in points if all(n in point for n in names))
    return np.fromiter((point[n] for point in whole for n in names), np.float64).reshape(-1, 2)
