"""Readers: a file of one format becomes a :class:`~fracid.recording.readers.table.Table` of columns."""
