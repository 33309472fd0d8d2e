"""The cost's rise over each unknown, all others following, and its threshold."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fracid.arrays import FloatArray
from fracid.errors import InputError
from fracid.figures import Style
from fracid.models import Model
from fracid.plots.appearance import (
    BLUE,
    MARKS,
    VERMILLION,
    cost_label,
    finish,
    label,
    new,
    number,
    unknown_label,
)
from fracid.quantiles import CHI2_95, NORMAL_95

if TYPE_CHECKING:
    from fracid.estimation.cost_profile import JointProfile, Profile, Profiles

CEILING = 12.0
"""Rises above this are beyond the panel of a profile."""


def profiles(profiles: Profiles, *, style: str | Style = "screen") -> Figure:
    """Draw each profile: the rise of the cost over the value, its threshold, and the parabola of the sandwich.

    Parameters
    ----------
    profiles : fracid.Profiles
        Its joint profile, where there is one, has a panel of its own, with the limit of its 95 % region.
    style : str or Style
        ``screen``, ``journal`` or one's own; see :mod:`fracid.figures`.

    Returns
    -------
    matplotlib.figure.Figure
        Where the two curves part, the interval of the sandwich is wrong; where the rise stays below the threshold
        the data do not know the value.

    Raises
    ------
    InputError
        If there is no profile.

    Examples
    --------
    >>> import fracid
    >>> from fracid.problem import Experiment, Free, Problem
    >>> rig = fracid.rotary_pendulum("srv02-rotpen")
    >>> run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=1e-2, end=2.0)
    >>> noise = 1e-3 * np.random.default_rng(1).standard_normal((201, 2))
    >>> swing = Experiment("twin", 1e-2, run.states[:, [0, 2]] + noise, np.zeros((1, 1)), initial={"alpha": 0.3})
    >>> problem = Problem(rig, (swing,), {"lambda": 0.9, "mu": Free(0.95, 0.5, 1.2)}, initial_state="held")
    >>> len(profiles(fracid.profile(problem, points=4)).axes)
    1
    """
    panels = list(profiles.profiles.values())
    count = len(panels) + (profiles.joint is not None)
    if not count:
        raise InputError("There is no profile to draw.")
    columns = min(count, 3)
    rows = -(-count // columns)
    figure = new(max(6.4, 3.9 * columns), 0.9 + 3.2 * rows, style)
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in grid[count:]:
        axes.remove()
    model, calibrated = profiles.problem.model, profiles.problem.cost_function.loss is not None
    for axes, panel in zip(grid, panels, strict=False):
        _profile(axes, panel, calibrated, model)
    if profiles.joint is not None:
        _joint_profile(grid[count - 1], profiles.joint, model)
    return finish(figure, f"Profiles of the cost, {cost_label(profiles.problem.cost_function.name)[0]}")


def _profile(axes: Axes, panel: Profile, calibrated: bool, model: Model) -> None:
    name, factor = unknown_label(panel.name, panel.unit, model)
    values, rise = factor * panel.values, np.maximum(panel.rise, 0.0)
    top = float(np.clip(1.15 * np.max(rise[np.isfinite(rise)], initial=0.0), 1.3 * CHI2_95[1], CEILING))
    axes.plot(values, rise, color=BLUE, lw=1.6, marker="o", ms=3.5, label="profile", zorder=3)
    limits = axes.get_xlim()
    if calibrated:
        axes.axhline(CHI2_95[1], color=VERMILLION, lw=1.1, label="95 % threshold, 3.84")
        ends = [factor * end if end is not None else edge for end, edge in
                zip(panel.interval95, panel.values[[0, -1]] * factor, strict=True)]  # fmt: skip
        axes.axvspan(*ends, color=BLUE, alpha=0.10, lw=0, label="95 % interval")
    if panel.wald95 is not None:
        se = factor * (panel.wald95[1] - panel.wald95[0]) / (2 * NORMAL_95)
        v = np.linspace(*limits, 200)
        parabola = ((v - factor * panel.best) / se) ** 2
        axes.plot(v, parabola, color="black", lw=1.1, ls=(0, (4, 3)), label="parabola of the sandwich", zorder=2)
    axes.plot(factor * panel.best, 0.0, ls="", label="best", **(MARKS["best"] | {"ms": 11}))
    axes.set(xlim=limits, ylim=(-0.04 * top, top))
    axes.ticklabel_format(axis="x", useOffset=False)  # 0.94998, not -2 and far off 1e-5+9.5e-1
    rises = "rise of the cost, W [–]" if calibrated else "rise, 3.84 where it doubled"
    label(axes, panel.verdict, name, rises, ticks=4)


def _joint_profile(axes: Axes, joint: JointProfile, model: Model) -> None:
    (x, across), (y, up) = (unknown_label(n, u, model) for n, u in zip(joint.names, joint.units, strict=True))
    first, second, rise = _smoothed(across * joint.first, up * joint.second, joint.rise)
    axes.contourf(first, second, np.minimum(rise, 50.0).T, levels=[0, 1, 2, 4, CHI2_95[2]], cmap="Blues_r", alpha=0.6)
    axes.contour(first, second, rise.T, levels=[CHI2_95[2]], colors=[VERMILLION], linewidths=1.4)
    axes.plot([], [], color=VERMILLION, lw=1.4, label="95 % region, 5.99")
    axes.plot(across * joint.best[0], up * joint.best[1], ls="", label="best", **(MARKS["best"] | {"ms": 11}))
    axes.ticklabel_format(useOffset=False)
    label(axes, f"together; correlation {number(joint.correlation, 2)}", x, y, ticks=4)


def _smoothed(first: FloatArray, second: FloatArray, rise: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A rise on a fine grid, by a spline that is exact for a parabola: a narrow valley falls between coarse points."""
    if not np.isfinite(rise).all() or min(rise.shape) < 4:
        return first, second, np.where(np.isfinite(rise), np.maximum(rise, 0.0), 1e3)
    from scipy.interpolate import RectBivariateSpline

    fine = np.linspace(first[0], first[-1], 200), np.linspace(second[0], second[-1], 200)
    return *fine, np.maximum(RectBivariateSpline(first, second, rise)(*fine), 0.0)
