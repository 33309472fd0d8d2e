"""Workflows: load, compute, write the folder; what a command does, to be called from Python too.

===================================== =============================== ========================
module                                function                        command
===================================== =============================== ========================
:mod:`fracid.workflows.fit`           :func:`fracid.run`              ``fracid fit``, ``demo``
:mod:`fracid.workflows.resumption`    :func:`fracid.resume_run`       ``fracid resume``
:mod:`fracid.workflows.comparison`    :func:`fracid.run_comparison`   ``fracid compare``
:mod:`fracid.workflows.monte_carlo`   :func:`fracid.run_noise_study`  ``fracid noise``
:mod:`fracid.workflows.feedback`      :func:`fracid.run_control`      ``fracid control``
:mod:`fracid.workflows.profiles`      :func:`fracid.run_profiles`     ``fracid profile``
:mod:`fracid.workflows.residuals`     :func:`fracid.run_residuals`    ``fracid resid``
:mod:`fracid.workflows.regression`    ``run_regression``              ``fracid regress``
:mod:`fracid.workflows.simulation`    ``twin_of``, ``record_twin``    ``fracid simulate``
:mod:`fracid.workflows.reproduction`  ``compared_studies``            ``fracid reproduce``
:mod:`fracid.workflows.redrawing`     ``redraw``                      ``fracid draw``
:mod:`fracid.workflows.draft`         ``write_draft``                 ``fracid init``
===================================== =============================== ========================

None prints.  What a reader should know before the work ends goes to an :class:`fracid.Observer`; the rest is in what
the function gives.
"""
