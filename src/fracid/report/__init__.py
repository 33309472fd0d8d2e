"""The report: one HTML file that says what a run found, opens offline, and loads nothing from the network.

::

    material   the run, its recordings beside their simulations, the files of its folder
    verdict    the claim, and what speaks for and against it; sentences: numbers as text
    equations  the model as MathML
    samples    a recording thinned and packed; traces: what is drawn of it
    charts     a chart as data and as SVG; surface: a cost over two values; whiskers: a value with its interval
    drawing    these by templates; scene: the bodies of the model, and their still
    page       all of it into page.html.j2, with page.css and the scripts inline; frame: what every page is made with
    study      what compare, design, posterior, profile and noise found, from their records
    index      all runs of a folder side by side, and the links between their pages

Each chart, and the rig, is there as SVG: on paper, in an archive and without a script the page shows all that it says.

What comes from a file, a recording's name for one, is escaped: texts by Jinja's autoescape, data as JSON without ``<``.
The page's own scripts and styles are allowed by their hashes in a Content-Security-Policy, and nothing else is: a
script that got in by some way would not run, and nothing can be fetched.

``uPlot.iife.min.js`` and ``uPlot.min.css`` are uPlot 1.6.32 by Leon Sorokin (MIT, ``uPlot-LICENSE.txt``), as published.
"""

from fracid.report.index import INDEX as INDEX
from fracid.report.index import REPORT as REPORT
from fracid.report.index import write_index as write_index
from fracid.report.page import plane_of as plane_of
from fracid.report.page import report_page as report_page
from fracid.report.page import write_report as write_report
