"""What each file of a run folder has in it, each described once: written, read and checked by it.

================================  =================================================================
:mod:`fracid.schemas.result`      ``result.json``
:mod:`fracid.schemas.files`       which is whose; ``python -m fracid.schemas`` prints a JSON Schema
:mod:`fracid.schemas.run_record`  ``run.json``, ``environment.json`` and the lines of logs
:mod:`fracid.schemas.residuals`   ``residuals.json``
:mod:`fracid.schemas.profiles`    ``profiles.json``
:mod:`fracid.schemas.draws`       ``posterior.json``
:mod:`fracid.schemas.regression`  ``regression.json``
:mod:`fracid.schemas.comparison`  ``compare.json`` and its journal's lines
:mod:`fracid.schemas.study`       ``noise.json`` and its journal's lines
================================  =================================================================

:mod:`fracid.safety.schema` says how.
"""
