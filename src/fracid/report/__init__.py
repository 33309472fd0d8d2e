"""The report: one HTML file that says what a run found, opens offline, and asks nobody for anything.

::

    material   the run, its recordings beside their simulations, the files of its folder
    words      numbers as text; the verdict in six lines
    equations  the model as MathML
    traces     samples, thinned and packed
    rig        how large the moving pendulum is drawn
    page       all of it into page.html.j2, with page.css and the scripts inline

What comes from a file, be it a recording's name, is escaped: texts by Jinja's autoescape, data as JSON without ``<``.
The page's own scripts and styles are allowed by their hashes in a Content-Security-Policy, and nothing else is: a
script that got in by some way would not run, and nothing can be fetched.

``uPlot.iife.min.js`` and ``uPlot.min.css`` are uPlot 1.6.32 by Leon Sorokin (MIT, ``uPlot-LICENSE.txt``), as published.
"""

from fracid.report.page import REPORT, report_page, write_report

__all__ = ["REPORT", "report_page", "write_report"]
