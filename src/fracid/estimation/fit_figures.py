"""The pictures of a fit, one call each; every one returns the matplotlib Figure.

==========================================  ===================================================================
call                                        draws
==========================================  ===================================================================
``fit.plot()``                              measured and fitted over time: the paper's Figure 2
``fit.plot_residuals()``                    what the fit leaves over: Figure 3; with ``tests=True`` all that is tested
``fit.plot_cost()``                         the cost over the two orders
``fit.plot_rig()``                          the rig to scale: Figure 1
``fit.plot_starts()``                       where each start of the search ended
==========================================  ===================================================================

A :class:`fracid.SavedRun`, which :func:`fracid.load_run` reads from a run folder, has the same ones, and a recording of
either, ``fit.recordings["release"]``, has the first two.  All take ``style="journal"``.

The figures themselves are in :mod:`fracid.plots`, which stands above what is drawn: it is imported when it is called.

>>> import numpy as np, fracid
>>> rig = fracid.rotary_pendulum("srv02-rotpen")
>>> run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.3}, step=5e-3, end=2.0)
>>> swing = fracid.Experiment("twin", 5e-3, run.states[:, [0, 2]], np.zeros((1, 1)), initial={"theta": 0, "alpha": 0.3})
>>> free = fracid.Free(1.0, 0.5, 1.2)
>>> fit = fracid.identify(fracid.Problem(rig, (swing,), {"lambda": free, "mu": free}, initial_state="held"))
>>> [round(25.4 * draw(style="journal").get_figwidth()) for draw in (fit.plot, fit.plot_residuals, fit.plot_rig)]
[88, 180, 88]
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fracid.cards import tabulated
from fracid.errors import entry_of
from fracid.estimation.records import Estimate, Estimates, RecordingFit
from fracid.estimation.starts import Start
from fracid.figures import Figure, Style, draw
from fracid.models import Model

if TYPE_CHECKING:  # the process that draws needs no solver
    from fracid.problem import Problem


class FitPictures:
    """What a fit, of this session or of a folder, can draw, and its table."""

    problem: Problem
    x: NDArray[np.float64]
    """The free parameters, shape (n_unknowns,)."""
    recordings: Mapping[str, RecordingFit]
    orders: Mapping[str, Estimate]
    parameters: Mapping[str, Estimate]
    starts: tuple[Start, ...]
    """Of the search, if it had several."""

    def table(self) -> Any:
        """Every order, parameter and value of a recording's own, a row each.

        Returns
        -------
        pandas.DataFrame, or list of dict where pandas is not installed
            By ``name``: ``value``, ``half_width`` of the 95 % interval, ``low``, ``high``, ``unit``, ``verdict``,
            ``free``; in SI units.
        """
        own = {f"{n}{mark} [{r.name}]": e for r in self.recordings.values()
               for block, mark in ((r.parameters, ""), (r.initial, "(0)")) for n, e in block.items()}  # fmt: skip
        return tabulated(Estimates({**self.orders, **self.parameters, **own}).rows(), "name")

    def plot(self, recording: str | None = None, *, style: str | Style = "screen") -> Figure:
        """Measured and fitted over time, the residual below; see :func:`fracid.plots.fitted_over_time`.

        Parameters
        ----------
        recording : str, optional
            Its name; the first if left out.
        style : str or Style
            ``screen``, ``journal`` or one's own; see :mod:`fracid.figures`.

        Raises
        ------
        InputError
            If there is no such recording.
        """
        return _one(self, recording).plot(style=style)

    def plot_residuals(
        self, recording: str | None = None, output: str | None = None, *, tests: bool = False,
        style: str | Style = "screen",
    ) -> Figure:  # fmt: skip
        """What the fit leaves over; see :func:`fracid.plots.residual_plots`.

        Parameters
        ----------
        recording : str, optional
            Its name; the first if left out.
        output : str, optional
            ``alpha`` if left out, or the first output of a model that has none.
        tests : bool
            Also what :func:`fracid.residual_analysis` looks at; see :func:`fracid.plots.residual_diagnostics`.
        style : str or Style
            As for :meth:`plot`.

        Raises
        ------
        InputError
            If there is no such recording, or it has no such output.
        """
        return _one(self, recording).plot_residuals(output, tests=tests, style=style)

    def plot_cost(self, *, points: int = 15, jobs: int = 1, style: str | Style = "screen") -> Figure:
        """The cost over the two free orders about what was found; see :func:`fracid.plots.cost_plane`.

        Parameters
        ----------
        points : int
            Along each order: so many simulations squared.
        jobs : int
            Threads.
        style : str or Style
            As for :meth:`plot`.

        Raises
        ------
        InputError
            If fewer than two orders are free.
        """
        from fracid.estimation.cost_plane import cost_plane

        plane = cost_plane(self.problem, self.x, orders=self.orders, points=points, jobs=jobs)
        first, second = (float(self.x[self.problem.free_orders[n]]) for n in plane.names)
        return plane.plot(best=(first, second), cost_name=self.problem.cost_function.name, style=style)

    def plot_rig(self, *, style: str | Style = "screen") -> Figure:
        """The model's scene with the constants as found; see :func:`fracid.plots.rig_drawing`.

        Parameters
        ----------
        style : str or Style
            As for :meth:`plot`.

        Raises
        ------
        InputError
            If the model has no scene.
        """
        return rig_as_found(self.problem.model, self.parameters).plot(style=style)

    def plot_starts(self, *, style: str | Style = "screen") -> Figure:
        """Where each start of the search ended, sorted; see :func:`fracid.plots.waterfall`.

        Parameters
        ----------
        style : str or Style
            As for :meth:`plot`.

        Raises
        ------
        InputError
            If the search was another than ``multistart``.
        """
        return draw("waterfall", self.starts, cost_name=self.problem.cost_function.name, style=style)


def _one(fit: FitPictures, name: str | None) -> RecordingFit:
    """A recording by its name, the first without one."""
    return next(iter(fit.recordings.values())) if name is None else entry_of("recording", fit.recordings, name)


def rig_as_found(model: Model, parameters: Mapping[str, Estimate]) -> Model:
    """The model with its constants as found.

    Parameters
    ----------
    model : Model
    parameters : mapping
        Those of a fit, by name.

    Returns
    -------
    Model
    """
    found = {n: e.value for n, e in parameters.items() if n in model.parameter_names and e.value is not None}
    return model.with_parameters(**found)
