"""The paper's Figure 2: measured and fitted, close up where it is fast, the residual below."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.artist import setp
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fracid.arrays import FloatArray, Quanta
from fracid.estimation.records import RecordingFit
from fracid.figures import Style
from fracid.plots.appearance import (
    FITTED,
    MEASURED,
    RESIDUAL,
    angle_label,
    axis_unit,
    encoder_band,
    encoder_step,
    extent,
    finish,
    goodness,
    line,
    new,
    note,
    plain,
    style_of,
    symbol,
    title,
)
from fracid.units import with_unit

SWINGS = 6
"""That a close-up shows."""


def fitted_over_time(recording: RecordingFit, *, resolution: Quanta = None, style: str | Style = "screen") -> Figure:
    """Draw the paper's Figure 2: measured and fitted over time, the residual in a strip below.

    Parameters
    ----------
    recording : RecordingFit
        One of ``fit.recordings``; values that are not finite are shown as missing.
    resolution : mapping, optional
        Output → step of its encoder [rad], None where unknown; drawn as a band one step high.
    style : str or Style
        ``screen``, ``journal`` or one's own; see :mod:`fracid.figures`.

    Returns
    -------
    matplotlib.figure.Figure
        A panel and a strip per output; where the whole shows no single swing, beside them the
        six swings with the fastest motion.

    Examples
    --------
    >>> from fracid.estimation.records import RecordingFit
    >>> t = np.arange(0, 20, 1e-3)
    >>> swing = np.exp(-0.2 * t) * np.cos(7 * t)
    >>> twin = RecordingFit("twin", "fit", t, {"alpha": swing}, {"alpha": 0.98 * swing}, 0.01, {}, {})
    >>> [axes.get_title(loc="left") for axes in fitted_over_time(twin).axes][0]
    '$\\\\alpha$: fit 98.0 %, RMSE 0.287°'
    """
    outputs, time = tuple(recording.measured), recording.time
    steps = {n: encoder_step(resolution, n) for n in outputs}
    spans = [slice(0, time.size), *_fast_part(time, recording.measured)]
    figure = new(11 if len(spans) > 1 else 8, 1.1 + 2.9 * len(outputs), style)
    brief = style_of(figure).brief
    grid = figure.subplots(2 * len(outputs), len(spans), squeeze=False, sharex="col",
                           height_ratios=[2 if brief else 3, 1] * len(outputs),
                           width_ratios=(2, 1.3)[: len(spans)])  # fmt: skip
    headings = [f"{symbol(n)}: {goodness(recording, n, steps[n])}" for n in outputs]
    for (panels, strips), name, heading in zip(grid.reshape(len(outputs), 2, -1), outputs, headings, strict=True):
        for panel, strip, span in zip(panels, strips, spans, strict=True):
            _measured_and_fitted(panel, recording.at(span), name)
            _residual_strip(strip, recording.at(span).of(name), name, step=steps[name])
        short = brief and np.isfinite(recording.rmse[name])
        title(panels[0], f"RMSE {with_unit(recording.rmse[name], recording.unit(name))}" if short else heading, "left")
        display_unit, _ = axis_unit(recording.unit(name))
        where = angle_label(name, display_unit, recording.zero_of(name))
        panels[0].set_ylabel(where.replace(", ", ",\n") if brief else where)
        strips[0].set_ylabel(f"residual\n[{display_unit}]")
        strips[0].locator_params(axis="y", nbins=3)
        if len(spans) > 1:
            first, last = time[spans[1]][[0, -1]]
            panels[0].axvspan(first, last, color="0.93", zorder=0, label="shown close up")
            title(panels[1], f"close up, {first:.2f} to {last:.2f} s", loc="left")
    setp(grid[-1], xlabel="time [s]")
    role = "measured and fitted"
    if recording.use == "validate":
        role = "held out, predicted; at most its initial state and its own parameters were refitted"
    return finish(figure, f"{plain(recording.name)}: {role}", caption="; ".join(headings))


def _simulated(recording: RecordingFit) -> str:
    return "predicted" if recording.use == "validate" else "fitted"


def _measured_and_fitted(axes: Axes, recording: RecordingFit, name: str) -> None:
    own, (_, factor) = recording.of(name), axis_unit(recording.unit(name))
    measured, fitted = factor * own.measured[name], factor * recording.fitted[name]
    line(axes, own.time, measured, label="measured", **MEASURED)
    line(axes, recording.time, fitted, label=_simulated(recording), **FITTED)
    if not np.isfinite(fitted).any():
        note(axes, "the simulation failed: no values", 0.85)
        return
    # A simulation that runs away would press the measurement into a straight line.
    low, high = extent(measured)
    reach = 1.5 * (high - low)
    least, greatest = extent(fitted)
    if reach > 0 and (least < low - 2 * reach or greatest > high + 2 * reach):
        axes.set_ylim(low - reach, high + reach)
        ends = " to ".join(with_unit(x / factor, recording.unit(name)) for x in (least, greatest))
        note(axes, f"{_simulated(recording)} leaves the picture: {ends}".replace("-", "−"), 0.93)


def _residual_strip(axes: Axes, recording: RecordingFit, name: str, step: float | None) -> None:
    residual = axis_unit(recording.unit(name))[1] * recording.residual(name)
    if not np.isfinite(residual).any():
        note(axes, "no residual")
        axes.set_yticks([])
        return
    axes.axhline(0, color="0.6", lw=0.8)
    encoder_band(axes, step, recording.unit(name))
    name = f"residual (measured − {_simulated(recording)})"
    line(axes, recording.time, residual, label=name, **RESIDUAL)


def _fast_part(time: FloatArray, signals: Mapping[str, FloatArray]) -> tuple[slice, ...]:
    """Return the span of some swings where the motion is fastest; none where the whole shows it as well."""
    x = np.array([y - y.mean() for y in signals.values()])
    moving = x[np.ptp(x, axis=1) > 0.1 * np.ptp(x, axis=1).max()]  # what only jitters has no swings
    if time.size < 100 or not moving.size or not np.isfinite(x).all():
        return ()
    swings = int(np.abs(np.fft.rfft(moving, axis=1))[:, 1:].argmax(axis=1).max()) + 1
    length = max(SWINGS * time.size // swings, 50)
    if 2 * length > time.size:
        return ()
    # Speed over a tenth of a swing: an encoder's single counts are faster than any motion.
    lag = max(length // (10 * SWINGS), 1)
    speed2 = ((moving[:, lag:] - moving[:, :-lag]) ** 2).sum(axis=0)
    total = np.concatenate([[0.0], np.cumsum(speed2)])
    windows = total[length - lag :] - total[: total.size - length + lag]
    start = int(np.argmax(windows >= (1 - 1e-9) * windows.max()))  # the first, whatever the rounding
    return (slice(start, start + length),)
