r"""What the page draws of each recording: packed for the player, and as charts.

All signals of a recording share their times, so that a cursor and the moving rig can read them together: the union of
every signal's extremes (:func:`fracid.arrays.extremes`).  Times count from the first sample.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fracid.arrays import extremes
from fracid.estimation.records import RecordingFit
from fracid.recording import Recording
from fracid.report.charts import Band, Chart, Mark, Series, encoder_ticks
from fracid.report.material import Material
from fracid.report.samples import base64_floats
from fracid.report.sentences import joined
from fracid.units import letter, number
from fracid.validation.residual_records import ResidualAnalysis

POINTS = 20_001
"""Of one recording: 35 s at 500 Hz, or 20 s at 1 kHz, whole."""

ALL_POINTS = 60_000
"""Of all recordings together."""

FEWEST = 400
"""Of one, however many there are."""


def budget(recordings: int) -> int:
    """How many points one of so many recordings may have."""
    return int(min(POINTS, max(FEWEST, ALL_POINTS // max(1, recordings))))


# --- measured and simulated ----------------------------------------------------------------------


def traces(material: Material) -> list[dict[str, Any]]:
    """What the player draws of each recording."""
    return [_trace(material, r, budget(len(material.fit.recordings))) for r in material.fit.recordings.values()]


def _trace(material: Material, r: RecordingFit, points: int) -> dict[str, Any]:
    lines = [np.asarray(y, dtype=float) for n in r.measured for y in (r.measured[n], r.fitted[n])]
    at = extremes(lines, points)
    return {
        "name": r.name, "use": r.use, "samples": r.time.size, "shown": at.size, "start": float(r.time[0]),
        "t": base64_floats((r.time - r.time[0])[at]), "outputs": [_output(material, r, n, at) for n in r.measured],
    }  # fmt: skip


def _output(material: Material, r: RecordingFit, name: str, at: NDArray[np.intp]) -> dict[str, Any]:
    unit, factor, step, limit = _scale(material, r, name)
    return {
        "name": name, "letter": letter(name), "unit": unit, "perRad": factor, "step": step, "limit": limit,
        "right": encoder_ticks(limit, step), "measured": base64_floats(factor * r.measured[name][at]),
        "fitted": base64_floats(factor * r.fitted[name][at]),
    }  # fmt: skip


def _scale(material: Material, r: RecordingFit, name: str) -> tuple[str, float, float | None, float]:
    """The unit that is shown, and how many it has; the encoder's step in it, and to where the residual's axis goes."""
    unit, factor = material.unit(name)
    raw = material.project.resolutions[r.name].get(name)
    step = factor * raw if raw is not None and isfinite(raw) and raw > 0 else None
    e = factor * np.abs(r.residual(name))
    largest = float(np.max(e, initial=0.0, where=np.isfinite(e)))
    return unit, factor, step, max(1.08 * largest, 1.6 * (step or 0.0)) or 1.0


def fit_charts(material: Material, r: RecordingFit) -> Iterator[Chart]:
    """Of each output measured and simulated, and below it the residual."""
    time, clock = r.time - r.time[0], f"time after {number(r.time[0], '.6g')} s [s]" if r.time[0] else "time [s]"
    for k, name in enumerate(r.measured):
        unit, factor, step, limit = _scale(material, r, name)
        last, α, own = k == len(r.measured) - 1, letter(name), r.of(name)
        yield Chart(
            f"{α}, measured and simulated", time, "", f"{α}{_in(unit)}",
            series=(Series("measured", factor * r.measured[name], "measured"),
             Series("simulated", factor * r.fitted[name], "fitted")),
            xname="time", height=150,
        )  # fmt: skip
        yield Chart(
            residual_title(α, unit, step), own.time - r.time[0], clock if last else "", f"residual{_in(unit)}",
            series=(Series("measured − simulated", factor * own.residual(name), "residual"),), xname="time",
            bands=(Band("y", -step / 2, step / 2),) if step else (), height=140 if last else 116,
            yrange=(-limit, limit), right=encoder_ticks(limit, step), rightlabel="steps" if step else "",
        )  # fmt: skip


def residual_title(symbol: str, unit: str, step: float | None) -> str:
    """What the chart shows, and how much an encoder's step is."""
    words = "encoder step" if unit == "°" else "step"
    shown = f"{number(step, '.3g')}{unit if unit == '°' else f' {unit}'}" if step else ""
    return f"{symbol}, residual (measured − simulated)" + (f"; shaded: ± ½ {words} of {shown}" if step else "")


def _in(unit: str) -> str:
    return f" [{unit}]" if unit else ""


# --- as recorded ---------------------------------------------------------------------------------


def recorded_charts(material: Material, whole: Recording, r: RecordingFit) -> Iterator[Chart]:
    """All signals of a file, those of a unit in one chart, with the part that was used."""
    points = budget(len(material.fit.recordings)) // 2
    at = extremes([np.asarray(y, dtype=float) for y in whole.signals.values()], points)
    units = {n: material.unit(n) for n in whole.signals}
    used = float(r.time[0]), float(r.time[-1])
    marks = [Mark("x", used[0], "used", "link"), Mark("x", used[1], "", "link")]
    marks += [] if whole.report.release is None else [Mark("x", whole.report.release, "release", "mark", before=True)]
    for unit in dict.fromkeys(unit for unit, _ in units.values()):
        names = [n for n in units if units[n][0] == unit]
        yield Chart(
            joined([letter(n) for n in names]), whole.time[at], "time on the recording's clock [s]",
            f"{'angle' if unit == '°' else 'signal'}{_in(unit)}",
            series=tuple(Series(letter(n), units[n][1] * whole.signals[n][at], ("first", "second", "third")[k % 3])
                  for k, n in enumerate(names)),
            xname="time", bands=(Band("x", *used, "window"),), marks=tuple(marks), height=200,
        )  # fmt: skip


# --- residuals -----------------------------------------------------------------------------------


def residual_charts(residual: ResidualAnalysis, factor: float) -> Iterator[Chart]:
    """Autocorrelation, spectrum and normal probability plot of one residual; none where there is too little."""
    if (curves := residual.curves) is None:
        return
    ρ = Series("correlation", curves.correlation, "first")
    yield Chart("autocorrelation", curves.lag, "lag [s]", "correlation", series=(ρ,), xname="lag",
                bands=(Band("y", -curves.white, curves.white),))  # fmt: skip
    if curves.frequency.size:
        S = Series("power per Hz", factor**2 * curves.power, "first")
        marks = (Mark("x", residual.spectrum.swing, "swing"),) if residual.spectrum.swing else ()
        yield Chart("spectrum", curves.frequency, "frequency [Hz]", "power", series=(S,), xname="frequency", logx=True,
                    logy=True, marks=marks)  # fmt: skip
    lines = Series("residual", curves.ordered, "points"), Series("normal", curves.quantile, "dashed")
    yield Chart("normal probability plot", curves.quantile, "normal quantile", "residual / its spread", series=lines,
                xname="normal")  # fmt: skip
