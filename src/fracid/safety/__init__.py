"""What strangers send: texts, paths, JSON and code that may be wrong or hostile."""
