"""Figures.  Each function returns a matplotlib Figure; :func:`save` writes it.

============================  ============================================================================
figure                        shows
============================  ============================================================================
:func:`rig_drawing`           the paper's Figure 1 of any rig: to scale, zeros and positive senses of both angles
:func:`recording_overview`    a recording: each signal whole, and close up about its release
:func:`fitted_over_time`      the paper's Figure 2: measured and fitted, close up where it is fast, residual below
:func:`residual_plots`        the paper's Figure 3: residual over time, over the fitted value, its distribution
:func:`residual_diagnostics`  the same with speed, autocorrelation and spectrum: what the residual's tests look at
:func:`cost_plane`            the cost over the two orders: a point, or a gorge?
:func:`profiles`              the cost's rise over each unknown, all others following, and its threshold
:func:`cut_shifts`            the orders as fitted, and with something else taken for the motion before the start
:func:`ladder`                the errors of each structure in sample and held out, orders 1 against orders free
:func:`amplitudes`            each order over the amplitude of the swing: does it drift?
:func:`waterfall`             where each start of a search ended, sorted: is the lowest minimum found again?
:func:`noise_levels`          bias and spread of each unknown against the noise, and what its intervals are worth
:func:`posterior_corner`      a posterior: each parameter's, and each pair's
:func:`posterior_predictive`  how far simulations with draws of a posterior differ from the fitted one
:func:`linear_response`       a linear model about a posture: Bode's plots and the step response
:func:`design_landscape`      the expected interval after one more experiment, against its release and duration
:func:`expected_curves`       what the experiments of a plan should show, with a band
============================  ============================================================================

Every one takes ``style``, of which there are ``screen`` and ``journal`` (:mod:`fracid.figures`).  :func:`save` writes
SVG, PDF and PNG.

What they keep to: angles in degrees and a unit on every axis, with the zero of the pendulum's angle; measured pale and
broad under fitted dark and thin, so that both can be distinguished in grey and by every eye (the colours are Okabe and
Ito's); a simulation that failed is drawn as missing and said to be, never left out.

A line of many samples is drawn through the least and the greatest of each of some thousand bins: the same
ink, in a file of a few hundred kilobytes.  Clouds of points are rasterised.

Matplotlib takes longer to import than everything else of ``fracid check``: this package is imported when it draws.
No function touches pyplot, so they need no display and may run on threads.

A family of figures is one file; what they share is in :mod:`fracid.plots.appearance`.
"""

from fracid.plots.comparison import amplitudes as amplitudes
from fracid.plots.comparison import ladder as ladder
from fracid.plots.cost_profiles import profiles as profiles
from fracid.plots.feedback import control_loop as control_loop
from fracid.plots.fitted import fitted_over_time as fitted_over_time
from fracid.plots.linear import linear_response as linear_response
from fracid.plots.noise import noise_levels as noise_levels
from fracid.plots.overview import recording_overview as recording_overview
from fracid.plots.plane import cost_plane as cost_plane
from fracid.plots.planned import design_landscape as design_landscape
from fracid.plots.planned import expected_curves as expected_curves
from fracid.plots.posterior_draws import posterior_corner as posterior_corner
from fracid.plots.posterior_draws import posterior_predictive as posterior_predictive
from fracid.plots.residuals import residual_diagnostics as residual_diagnostics
from fracid.plots.residuals import residual_plots as residual_plots
from fracid.plots.rig import rig_drawing as rig_drawing
from fracid.plots.starts import waterfall as waterfall
from fracid.plots.unknown_past import cut_shifts as cut_shifts
from fracid.plots.writing import save as save
