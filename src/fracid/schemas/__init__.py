"""What files of a run folder have in them that no record says of itself.

================================  =================================================================
:mod:`fracid.schemas.run_record`  ``environment.json`` and the lines of logs
:mod:`fracid.schemas.draws`       ``posterior.json``
================================  =================================================================

Most records describe themselves (:mod:`fracid.safety.schema` says how); which file is whose stands in
:mod:`fracid.runs.json_schemas`.
"""
